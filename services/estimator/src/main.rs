//! The estimator, with the method that the system file names, or with one in a program of its own; see the library.

use std::process::ExitCode;

use estimator::{Estimator, process};
use runtime::{CommonArgs, VariantArgs};

/// Arguments of the estimator.
#[derive(Debug, Clone, Default, clap::Parser)]
struct Args {
    #[command(flatten)]
    variant: VariantArgs,
    /// Custom method in any language: the command of its program, which answers cycle by cycle over a pipe.
    #[arg(long, value_name = "COMMAND", conflicts_with = "law")]
    program: Option<String>,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        self.variant.as_ref()
    }
}

fn main() -> ExitCode {
    runtime::main("estimator", |args: &Args, chassis| {
        let config = process::config(chassis, args.variant.law.as_deref())?;
        match (&args.program, &args.variant.common.system_file) {
            (Some(program), Some(system)) => process::run_program(chassis, &config, program, system),
            _ => process::run(chassis, Estimator::new(&config)),
        }
    })
}
