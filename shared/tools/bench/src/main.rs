//! The program `nims bench`.

use nims_bench::peer;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut given = std::env::args().skip(1);
    if given.next().as_deref() == Some(peer::COMMAND) {
        return match peer::serve(&given.next().unwrap_or_default()) {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => {
                eprintln!("nims: {failure}");
                ExitCode::from(failure.exit_code())
            }
        };
    }
    let about = "Measure whether this machine is suitable for a robot, each figure compared with a plain alternative";
    command::tool("nims bench", runtime::build::description(), about, nims_bench::run)
}
