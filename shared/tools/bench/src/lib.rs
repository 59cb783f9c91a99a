//! `nims bench`: measures whether this machine is suitable for a robot, and compares the implementation with a plain
//! alternative on this machine in the same run. It needs no robot and does not access one.
//!
//! Invariants:
//! * Each figure has a peer measured in the same seconds; results are medians, tails and a ratio, because an absolute
//!   time also depends on the other load of the machine.
//! * Shared memory and files of a benchmark are private. They are removed at its end or, if it was killed, by the next
//!   benchmark.
#![forbid(unsafe_code)]

mod args;
mod certificate;
mod chain;
mod disk;
mod figures;
mod flight;
mod judge;
mod load;
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

pub use args::{Args, Load, Part};

use command::{Answer, Failure, Output};
use report::BenchReport;
use settings::Settings;
use watch::Watch;

/// Runs `nims bench`.
///
/// # Errors
/// Bad input, a running robot, a disk without space, or a failed measurement.
pub fn run(args: &Args) -> Answer<Output> {
    let settings = Settings::from_args(args)?;
    let wanted = |part: Part| settings.parts.contains(&part);
    if wanted(Part::Chain) || wanted(Part::Disk) {
        flight::scenario(&settings).map_err(Failure::bad)?;
    }
    if wanted(Part::Disk) {
        disk::check(&settings)?;
    }
    let robot = robots::running();
    if let Some(where_it_runs) = robot.as_ref().filter(|_| !args.beside) {
        return Err(Failure::NotNow(format!(
            "a robot runs on this machine ({where_it_runs}), and a benchmark would delay it; end it first, or use --beside"
        )));
    }
    bus::make_private();
    let stop = command::stop_flag()?;
    place::sweep((wanted(Part::Disk) || args.certificate.is_some()).then_some(&*settings.runs));
    let mut watch = Watch::new(stop, &settings);
    let mut report = BenchReport {
        rate_hz: settings.rate_hz,
        runs: settings.runs.clone(),
        beside: robot.is_some(),
        tick: None,
        bus: None,
        chain: None,
        disk: None,
    };
    let load = load::Running::start(settings.load, &settings.runs)?;
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
    let load = load.end()?;
    if let (Some(path), Some(found)) = (&args.certificate, &report.tick) {
        return certificate::issue(path, args.system_file.as_deref(), found, settings.rate_hz, load);
    }
    Ok(Output::new(report.to_json(), text::report(&report)))
}
