//! Time from sending a sample until every process that sleeps for it has it, over the bus of nims and over what one
//! could use instead, and the processor time of all of them.
//!
//! Each way has a sender and receivers of its own, each a process. All send in turn, on one schedule, so that every way
//! has the same machine. `scripts/bench peers` runs it; nothing here asserts a time.
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
        ["receive", way, place, number] => process::receive(Way::named(way)?, Path::new(place), number),
        ["spin"] => loop {
            std::hint::spin_loop();
        },
        [] => measure::measure(2000, Place::Any, 1),
        [samples] => measure::measure(number(samples)?, Place::Any, 1),
        [samples, place] => measure::measure(number(samples)?, Place::named(place)?, 1),
        [samples, place, receivers] => measure::measure(number(samples)?, Place::named(place)?, number(receivers)?),
        _ => bail!(
            "accepted: the number of samples of each way, then `any`, `one-core` or `two-cores`, then the number of receivers; or nothing"
        ),
    }
}

fn number(text: &str) -> Result<u64> {
    text.parse()
        .with_context(|| format!("{text} is no number: the first argument is that of samples, the third of receivers"))
}
