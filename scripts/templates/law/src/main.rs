//! A custom control law. `README.md` in this folder explains how to fly with it.

mod law;

use std::process::ExitCode;

fn main() -> ExitCode {
    controller::process::main_with(controller::program!(), Box::new(law::MyLaw::default()))
}
