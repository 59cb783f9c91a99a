//! Common parts of all commands: failures, output, and the values of arguments.
//!
//! A tool defines its arguments and one function `run(&Args) -> Result<Output, Failure>`; a program parses the
//! arguments, calls the function and prints the output once ([`main`]).
//!
//! Invariants:
//! * Exit code 0: answered ("not feasible" is an answer too); 2: bad input; 1: it could not be done now.
//! * A failure is one sentence on stderr. With `--json`, stdout holds one JSON object and nothing else; that of a
//!   request that a process refused has the number of the reason.
//! * A number parsed by [`values`] is finite, and a point has two or three coordinates.
#![forbid(unsafe_code)]

mod failure;
mod missions;
mod output;
mod parallel;
pub mod points;
mod program;
mod signals;
mod temporary;
pub mod values;

pub use failure::{Answer, Failure};
pub use missions::mission_path;
pub use output::{Output, print_line};
pub use parallel::{parallel, processors};
pub use program::{main, tool};
pub use signals::{SIGNAL, StopFlag, stop_flag};
pub use temporary::{large_temporary_folder, temporary_file, temporary_folder};
