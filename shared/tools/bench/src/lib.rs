//! `nims bench`: measures whether this machine is good enough for a robot, and compares nims with the plain way of
//! doing the same on this machine in the same run. It needs no robot and affects none.
//!
//! Invariants:
//! * Every figure stands beside a reference measured in the same seconds, as medians, tails and a ratio: an absolute
//!   time also depends on what else the machine does.
//! * A benchmark uses its own shared memory and files; they are removed when it ends, or by the next one if it was
//!   killed.
#![forbid(unsafe_code)]

mod args;
mod chain;
mod disk;
mod figures;
mod flight;
mod judge;
pub mod peer;
mod place;
mod report;
mod robots;
mod round_trip;
mod scheduling;
mod settings;
mod text;
mod tick;
mod watch;
mod words;

pub use args::{Args, Part};

use command::{Answer, Failure, Output};
use report::Report;
use settings::Settings;
use watch::Watch;

/// `nims bench`.
///
/// # Errors
/// Bad input; a robot that runs; a disk without room; or whatever could not be measured now.
pub fn run(asked: &Args) -> Answer<Output> {
    let settings = Settings::of(asked)?;
    let wanted = |part: Part| settings.parts.contains(&part);
    if wanted(Part::Chain) || wanted(Part::Disk) {
        flight::scenario(&settings).map_err(Failure::bad)?;
    }
    if wanted(Part::Disk) {
        disk::check(&settings)?;
    }
    let robot = robots::running();
    if let Some(where_it_runs) = robot.as_ref().filter(|_| !asked.beside) {
        return Err(Failure::NotNow(format!(
            "a robot runs on this machine ({where_it_runs}), and this would take its time: end it first, or say --beside"
        )));
    }
    bus::make_private();
    let stop = command::stop_flag()?;
    place::sweep(wanted(Part::Disk).then_some(&*settings.runs));
    let mut watch = Watch::new(stop, &settings);
    let mut report = Report {
        rate_hz: settings.rate_hz,
        runs: settings.runs.clone(),
        beside: robot.is_some(),
        tick: None,
        bus: None,
        chain: None,
        disk: None,
    };
    for part in &settings.parts {
        watch.bar.set_message(part.name());
        let seconds = settings.seconds_for(*part);
        match part {
            Part::Tick => report.tick = Some(tick::measure(&settings, seconds, &mut watch)?),
            Part::Bus => report.bus = Some(round_trip::measure(&settings, seconds, &mut watch)?),
            Part::Chain => report.chain = Some(chain::measure(&settings, seconds, &mut watch)?),
            Part::Disk => report.disk = Some(disk::measure(&settings, seconds, &mut watch)?),
        }
    }
    watch.bar.finish_and_clear();
    Ok(Output::new(report.to_json(), text::report(&report)))
}
