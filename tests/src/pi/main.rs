//! The law of `docs/simulation.md`, in the program of the template.

mod law;

use std::process::ExitCode;

fn main() -> ExitCode {
    controller::process::main_with(controller::program!(), Box::new(law::MyLaw::default()))
}
