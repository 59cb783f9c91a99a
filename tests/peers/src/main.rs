//! Time from sending a sample until every process that sleeps for it has it, over the bus of nims and over what one
//! could use instead, and the processor time of all of them.
//!
//! Each way has a sender and receivers of its own, each a process. All send in turn, on one schedule, so that every way
//! has the same machine. `scripts/bench peers` runs it; nothing here asserts a time.
#![cfg_attr(not(feature = "cyclone"), forbid(unsafe_code))]
// The one library with an interface in C alone.
#![cfg_attr(feature = "cyclone", deny(unsafe_code))]

mod link;
mod measure;
mod place;
mod process;

use anyhow::{Context, Result, ensure};
use link::Way;
use measure::Plan;
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
        ref asked => measure::measure(plan(asked)?),
    }
}

/// Reads what is measured; what is not given has its default.
fn plan(asked: &[&str]) -> Result<Plan> {
    ensure!(
        asked.len() <= 4,
        "accepted: the number of samples of each way, then `any`, `one-core` or `two-cores`, then the number of receivers, then that of samples in a row; or nothing"
    );
    let number = |place: usize, default: u64| {
        let parsed = asked.get(place).map_or(Ok(default), |text| text.parse());
        let parsed = parsed.ok().filter(|number| *number > 0);
        parsed.with_context(|| format!("argument {} is {:?}, which is no number above 0", place + 1, asked[place]))
    };
    Ok(Plan {
        samples: number(0, 2000)?,
        cores: Place::named(asked.get(1).unwrap_or(&"any"))?,
        receivers: number(2, 1)?,
        row: number(3, 1)?,
    })
}
