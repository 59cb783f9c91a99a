//! The controller, with the law that the system file names, or with one in a program of its own; see the library.

use std::process::ExitCode;

use controller::{Controller, process};
use runtime::VariantArgs;

fn main() -> ExitCode {
    runtime::main("controller", |args: &VariantArgs, chassis| {
        let config = process::config(chassis, args.law.as_deref())?;
        match (&args.program, &args.common.system_file) {
            (Some(program), Some(system)) => process::run_program(chassis, config, program, system),
            _ => process::run(chassis, Controller::new(config)),
        }
    })
}
