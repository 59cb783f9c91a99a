//! Time from sending a sample until the process that sleeps for it has it, over the bus of nims and over what one could
//! use instead, and the processor time of both.
//!
//! Each way has a sender and a receiver process of its own. All send in turn, on one schedule, so that every way has
//! the same machine. `scripts/bench peers` runs it; nothing here asserts a time.
#![forbid(unsafe_code)]

mod link;
mod measure;
mod place;
mod process;

use anyhow::{Context, Result, bail};
use link::Way;
use place::Place;
use std::path::Path;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["send", way, place] => process::send(Way::named(way)?, Path::new(place)),
        ["receive", way, place] => process::receive(Way::named(way)?, Path::new(place)),
        ["spin"] => loop {
            std::hint::spin_loop();
        },
        [] => measure::measure(2000, Place::Any),
        [samples] => measure::measure(number(samples)?, Place::Any),
        [samples, place] => measure::measure(number(samples)?, Place::named(place)?),
        _ => bail!("accepted: the number of samples of each way, then `one-core` or `two-cores`; or nothing"),
    }
}

fn number(samples: &str) -> Result<u64> {
    samples.parse().context("the first argument is the number of samples of each way")
}
