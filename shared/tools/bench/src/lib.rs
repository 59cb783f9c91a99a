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
mod chain;
mod disk;
mod figures;
mod flight;
mod judge;
pub mod peer;
mod place;
mod robots;
mod round_trip;
mod scheduling;
mod text;
mod tick;

pub use args::{Args, Part};

use command::{Answer, Failure, Output, StopFlag};
use commissioning::check::Finding;
use config::{ControllerSection, EstimatorSection, RealtimeSection, RecorderSection, SystemFile};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Permitted control rates, Hz.
const RATES_HZ: [f64; 2] = [10.0, 250.0];
const DEFAULT_RATE_HZ: f64 = 100.0;

/// Settings of the benchmark.
#[derive(Debug, Clone)]
struct Settings {
    parts: BTreeSet<Part>,
    rate_hz: f64,
    seconds: Option<f64>,
    realtime: RealtimeSection,
    controller: ControllerSection,
    estimator: EstimatorSection,
    runs: PathBuf,
    least_bytes: u64,
    flush_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        let RecorderSection { min_free_bytes, flush_s, .. } = RecorderSection::default();
        Self {
            parts: Part::ALL.into(),
            rate_hz: DEFAULT_RATE_HZ,
            seconds: None,
            realtime: scheduling::recommended(),
            controller: ControllerSection::default(),
            estimator: EstimatorSection::default(),
            runs: PathBuf::from("."),
            least_bytes: min_free_bytes,
            flush_s,
        }
    }
}

impl Settings {
    fn of(args: &Args) -> Answer<Self> {
        let mut settings = Self { seconds: args.seconds, ..Self::default() };
        if !args.parts.is_empty() {
            settings.parts = args.parts.iter().copied().collect();
        }
        if let Some(path) = &args.system_file {
            let path = std::path::absolute(path).map_err(Failure::bad)?;
            let file = SystemFile::load(&path).map_err(Failure::bad)?;
            settings.rate_hz = file.rate_hz;
            settings.runs = commissioning::doctor::nearest_existing(&file.runs);
            settings.least_bytes = file.recorder.min_free_bytes;
            settings.flush_s = file.recorder.flush_s;
            (settings.realtime, settings.controller, settings.estimator) =
                (file.realtime, file.controller, file.estimator);
        }
        settings.rate_hz = args.rate.unwrap_or(settings.rate_hz);
        let [least, most] = RATES_HZ;
        if !(least..=most).contains(&settings.rate_hz) {
            return Err(Failure::BadInput(format!(
                "--rate is {} Hz; accepted: {least} to {most} control cycles per second",
                settings.rate_hz
            )));
        }
        if let Some(runs) = &args.runs {
            settings.runs.clone_from(runs);
        }
        Ok(settings)
    }

    fn period_ns(&self) -> u64 {
        (1e9 / self.rate_hz).round() as u64
    }

    /// Returns the duration of a part; by default it gives a thousand ticks at 100 Hz and thousands of other
    /// measurements, enough for the tail.
    fn seconds_for(&self, part: Part) -> f64 {
        self.seconds.unwrap_or(match part {
            Part::Tick => 10.0,
            Part::Bus => 3.0,
            Part::Chain => 2.0,
            Part::Disk => 3.0,
        })
    }
}

/// Progress bar and stop flag.
struct Watch {
    stop: StopFlag,
    bar: ProgressBar,
    begun: Instant,
}

impl Watch {
    /// Interval between two updates of the progress bar.
    const INTERVAL: Duration = Duration::from_millis(50);

    fn new(stop: StopFlag, settings: &Settings) -> Self {
        let all_s: f64 = settings.parts.iter().map(|part| settings.seconds_for(*part)).sum();
        let style = ProgressStyle::with_template("{msg:6} {wide_bar} {percent:>3} %");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        // Without a terminal, the bar draws nothing.
        let bar = ProgressBar::with_draw_target(Some((all_s * 1e3) as u64), ProgressDrawTarget::stderr());
        let bar = bar.with_style(style).with_finish(ProgressFinish::AndClear);
        Self { stop, bar, begun: Instant::now() }
    }

    /// Creates a watch without a progress bar, for a worker thread.
    fn quiet(stop: StopFlag) -> Self {
        Self { stop, bar: ProgressBar::hidden(), begun: Instant::now() }
    }

    fn stop(&self) -> StopFlag {
        StopFlag::clone(&self.stop)
    }

    fn update(&mut self) {
        self.bar.set_position(self.begun.elapsed().as_millis() as u64);
    }

    fn check_stop(&self) -> Answer {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Failure::NotNow("stopped before the end of the measurement".to_owned()));
        }
        Ok(())
    }
}

/// Results of the measured parts.
struct BenchReport {
    rate_hz: f64,
    runs: PathBuf,
    beside: bool,
    tick: Option<tick::TickResult>,
    bus: Option<round_trip::BusResult>,
    chain: Option<chain::ChainResult>,
    disk: Option<disk::DiskResult>,
}

impl BenchReport {
    fn verdicts(&self) -> Vec<(Part, Finding)> {
        let rate_hz = self.rate_hz;
        [
            self.tick.as_ref().map(|found| (Part::Tick, judge::tick_finding(found, rate_hz))),
            self.bus.as_ref().map(|found| (Part::Bus, judge::bus_finding(found, rate_hz))),
            self.chain.as_ref().map(|found| (Part::Chain, judge::chain_finding(found, rate_hz))),
            self.disk.as_ref().map(|found| (Part::Disk, judge::disk_finding(found, rate_hz))),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn to_json(&self) -> Value {
        let mut value = json!({ "rate_hz": self.rate_hz, "period_s": 1.0 / self.rate_hz, "beside_robot": self.beside });
        let parts = [json!(self.tick), json!(self.bus), json!(self.chain), json!(self.disk)];
        for (part, mut found) in Part::ALL.into_iter().zip(parts).filter(|(_, found)| !found.is_null()) {
            let verdict = self.verdicts().into_iter().find(|(judged, _)| *judged == part);
            found["verdict"] = json!(verdict.map(|(_, finding)| finding));
            value[part.name()] = found;
        }
        value
    }
}

/// Runs `nims bench`.
///
/// # Errors
/// Bad input, a running robot, a disk without space, or a failed measurement.
pub fn run(args: &Args) -> Answer<Output> {
    let settings = Settings::of(args)?;
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
    place::sweep(wanted(Part::Disk).then_some(&*settings.runs));
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

#[cfg(test)]
mod tests {
    use super::*;

    fn default_args() -> Args {
        Args { parts: Vec::new(), system_file: None, rate: None, seconds: None, runs: None, beside: false }
    }

    #[test]
    fn all_parts_take_less_than_twenty_seconds_by_default() {
        let settings = Settings::of(&default_args()).unwrap();
        assert_eq!(settings.parts, Part::ALL.into());
        assert!(Part::ALL.into_iter().map(|part| settings.seconds_for(part)).sum::<f64>() < 20.0);
        // A thousand ticks, so that the tail differs from the maximum.
        assert!(settings.seconds_for(Part::Tick) * settings.rate_hz >= 1000.0);
        let settings = Settings::of(&Args { seconds: Some(0.5), ..default_args() }).unwrap();
        assert!(Part::ALL.into_iter().all(|part| settings.seconds_for(part) == 0.5));
    }

    #[test]
    fn parts_are_measured_once_and_in_order() {
        let parts = vec![Part::Disk, Part::Bus, Part::Disk];
        let settings = Settings::of(&Args { parts, ..default_args() }).unwrap();
        assert_eq!(settings.parts.into_iter().collect::<Vec<_>>(), [Part::Bus, Part::Disk]);
    }

    #[test]
    fn only_permitted_rates_are_accepted() {
        for rate in [10.0, 250.0] {
            assert!(Settings::of(&Args { rate: Some(rate), ..default_args() }).is_ok());
        }
        for rate in [9.9, 250.1, -100.0, 0.0] {
            let refused = Settings::of(&Args { rate: Some(rate), ..default_args() }).unwrap_err();
            assert!(matches!(&refused, Failure::BadInput(said) if said.contains("--rate")), "{refused}");
        }
    }
}
