//! A method of estimation of one's own. `README.md` beside it says how to fly with it.

mod method;

use std::process::ExitCode;

fn main() -> ExitCode {
    estimator::process::main_with(estimator::program!(), Box::new(method::MyEstimator::default()))
}
