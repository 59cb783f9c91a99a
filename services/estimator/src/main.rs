//! The estimator, with the method that the system file names; see the library.

use std::process::ExitCode;

use estimator::{Estimator, process};
use runtime::VariantArgs;

fn main() -> ExitCode {
    runtime::main("estimator", |args: &VariantArgs, chassis| {
        let config = process::config(chassis, args.law.as_deref())?;
        process::run(chassis, Estimator::new(&config))
    })
}
