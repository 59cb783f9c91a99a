//! A control law of one's own. `README.md` beside it says how to fly with it.

mod law;

use std::process::ExitCode;

fn main() -> ExitCode {
    controller::process::main_with(controller::program!(), Box::new(law::MyLaw::default()))
}
