//! The estimator process: computes node estimates from motor states, with the method of the system file.

use std::process::ExitCode;

use estimator::{Estimator, process};
use runtime::VariantArgs;

fn main() -> ExitCode {
    runtime::main("estimator", |args: &VariantArgs, chassis| {
        let config = process::config(chassis, args.law.as_deref())?;
        process::run(chassis, Estimator::new(&config))
    })
}
