//! The operator's command; what it does stands in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    nims::main(std::env::args_os())
}
