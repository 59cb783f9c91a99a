//! A custom estimator. `README.md` in this folder explains how to fly with it.

mod method;

use std::process::ExitCode;

fn main() -> ExitCode {
    estimator::process::main_with(estimator::program!(), Box::new(method::MyEstimator::default()))
}
