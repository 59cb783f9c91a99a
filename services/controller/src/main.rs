//! The controller, with the law that the system file names; see the library.

use std::process::ExitCode;

use controller::{Controller, process};
use runtime::VariantArgs;

fn main() -> ExitCode {
    runtime::main("controller", |args: &VariantArgs, chassis| {
        let config = process::config(chassis, args.law.as_deref())?;
        process::run(chassis, Controller::new(config))
    })
}
