//! Tracking accuracy of a run, from the run file alone.

use crate::counters::PeriodCounter;
use crate::tracker::{Cycle, Tracker};
use cable_robot::Vector3;
use command::{Answer, Failure};
use messages::{ControlStatus, MotorAuthority, TruthNode};
use robot_state::Periods;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Relative deviation of a tension from the chosen one that counts as equal.
const TENSION_SHARE: f64 = 0.15;
/// Absolute deviation that counts as equal, N.
const TENSION_N: f64 = 2.0;

/// Root mean square and maximum of a position error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Error {
    /// Root mean square, m.
    pub rms_m: f64,
    /// Maximum, m.
    pub max_m: f64,
    /// Number of samples.
    pub samples: usize,
}

/// How far the estimates state that the truth may be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stated {
    /// Root mean square of two standard deviations over all axes together, m.
    pub rms_m: f64,
    /// Share of the cycles in which the truth is within two standard deviations on every axis; only with a truth.
    pub covered: Option<f64>,
}

impl fmt::Display for Stated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "within {:.1} mm (two standard deviations)", 1e3 * self.rms_m)?;
        self.covered.map_or(Ok(()), |covered| write!(f, ", and so it is in {:.0} % of the cycles", 100.0 * covered))
    }
}

/// True tensions compared with the chosen ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tensions {
    /// Share of the samples in which every cable is within 15 % or 2 N of the chosen tension.
    pub as_chosen: f64,
    /// Largest deviation, N.
    pub worst_n: f64,
    /// Least tension of a cable, N.
    pub least_n: f64,
    /// Greatest tension of a cable, N.
    pub greatest_n: f64,
}

/// Accuracy of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Analysis {
    /// Time in which the setpoint moved, s.
    pub moving_s: f64,
    /// Tracking error: estimate from the setpoint, over moving cycles.
    pub estimate: Error,
    /// Model error: truth from the estimate, over moving cycles. The robot cannot see it.
    pub model: Option<Error>,
    /// What the estimates state of this error, over moving cycles.
    pub stated: Stated,
    /// Error of the truth from the setpoint, over moving cycles, including those without a valid estimate; only the
    /// virtual motor box publishes the truth.
    pub truth: Option<Error>,
    /// True tensions over moving cycles.
    pub tensions: Option<Tensions>,
    /// Number of control cycles.
    pub cycles: u64,
    /// Periods of missions: steered, paused, and lost by cause.
    pub periods: Periods,
    /// Points for plots.
    #[serde(skip)]
    pub track: Vec<TrackPoint>,
}

/// One moving cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// Time since the first moving cycle, s.
    pub time_s: f64,
    /// Setpoint, m.
    pub setpoint: Vector3<f64>,
    /// Estimated position, m.
    pub estimate: Vector3<f64>,
    /// True position at the next sample of the truth, m.
    pub truth: Option<Vector3<f64>>,
    /// Distance of the true position from the setpoint at the time of its own sample, m.
    pub truth_off_m: Option<f64>,
    /// Distance of the true position from the estimate at that time, m.
    pub model_off_m: Option<f64>,
}

/// Accumulates the cycles of a run.
#[derive(Default)]
pub struct AccuracySum {
    last: Option<MotorAuthority>,
    /// From the first to the last cycle, in each life.
    cycles: u64,
    moving: u64,
    begin_ns: Option<u64>,
    estimate: Distances,
    model: Distances,
    stated: Distances,
    covered: u64,
    truth: Distances,
    tensions: TensionSum,
}

impl AccuracySum {
    /// Adds the next cycle; returns a point for plots if the setpoint moves.
    pub fn add(&mut self, cycle: &Cycle<'_>) -> Option<TrackPoint> {
        let now = cycle.authority;
        let before = self.last.replace(*now).filter(|last| last.header.life == now.header.life);
        self.cycles += before.map_or(1, |last| now.header.cycle.saturating_sub(last.header.cycle));
        let (Some(setpoint), Some(_), true) = (cycle.setpoint, cycle.next, cycle.moving) else { return None };
        // Compare every true position between this cycle and the next with the setpoint of its own time, also without
        // an estimate.
        let mut nearest = None;
        for truth in cycle.truth {
            let Some(target) = cycle.setpoint_at(truth.header.stamp_ns) else { continue };
            let position = Vector3::from(truth.position_m);
            let off = position - target.position;
            self.truth.add(off.norm());
            nearest.get_or_insert((position, off));
            if let Some(control) = cycle.control {
                self.tensions.add(truth, control);
            }
        }
        let estimate = cycle.estimate?;
        let begin_ns = *self.begin_ns.get_or_insert(now.header.stamp_ns);
        let position = Vector3::from(estimate.position_m);
        // The truth lies up to a period after the estimate. The setpoint moves on with the node, so the difference of
        // the two distances from it is the error at one time.
        let model_off = nearest.map(|(_, off)| off - (position - setpoint.position));
        let model_off_m = model_off.map(|off| off.norm());
        model_off_m.iter().for_each(|off_m| self.model.add(*off_m));
        let two_sigma_m = estimate.two_sigma_m();
        self.stated.add(Vector3::from(two_sigma_m).norm());
        self.covered += u64::from(model_off.is_some_and(|off| (0..3).all(|i| off[i].abs() <= two_sigma_m[i])));
        let point = TrackPoint {
            time_s: now.header.stamp_ns.saturating_sub(begin_ns) as f64 * 1e-9,
            setpoint: setpoint.position,
            estimate: position,
            truth: nearest.map(|(position, _)| position),
            truth_off_m: nearest.map(|(_, off)| off.norm()),
            model_off_m,
        };
        self.moving += 1;
        self.estimate.add((point.estimate - point.setpoint).norm());
        Some(point)
    }

    /// Returns the accuracy; `None` without cycles or motion.
    #[must_use]
    pub fn result(&self, track: Vec<TrackPoint>, periods: Periods) -> Option<Analysis> {
        let last = self.last.as_ref()?;
        Some(Analysis {
            moving_s: self.moving as f64 * last.period_s,
            estimate: self.estimate.result()?,
            model: self.model.result(),
            stated: Stated {
                rms_m: self.stated.result()?.rms_m,
                covered: self.model.result().map(|model| self.covered as f64 / model.samples as f64),
            },
            truth: self.truth.result(),
            tensions: self.tensions.result(),
            cycles: self.cycles,
            periods,
            track,
        })
    }
}

/// Reads a run and computes its accuracy.
///
/// # Errors
/// The run cannot be read, or nothing moved in it.
pub fn analyse(run: &Path) -> Answer<Analysis> {
    let (mut tracker, mut tally, mut track) = (Tracker::default(), AccuracySum::default(), Vec::new());
    let mut count = PeriodCounter::default();
    let mut each = |cycle: &Cycle<'_>| track.extend(tally.add(cycle));
    let mut reader = runlog::RunReader::open(run).map_err(Failure::not_now)?;
    while let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? {
        count.record(&recorded);
        tracker.record(&recorded, &mut each);
    }
    tracker.finish(&mut each);
    if tally.last.is_none() {
        return Err(Failure::NotNow(format!(
            "{} has no channel motor/authority, so it cannot be analysed",
            run.display()
        )));
    }
    tally.result(track, count.periods()).ok_or_else(|| Failure::NotNow(format!("nothing moved in {}", run.display())))
}

/// Accumulates distances.
#[derive(Debug, Clone, Copy, Default)]
pub struct Distances {
    squares: f64,
    max_m: f64,
    samples: usize,
}

impl Distances {
    /// Adds a distance, m. One that is not finite is left out: it would hide all others.
    pub fn add(&mut self, distance_m: f64) {
        if !distance_m.is_finite() {
            return;
        }
        self.squares += distance_m * distance_m;
        self.max_m = self.max_m.max(distance_m);
        self.samples += 1;
    }

    /// Returns the error; `None` without samples.
    #[must_use]
    pub fn result(&self) -> Option<Error> {
        let rms_m = (self.squares / self.samples.max(1) as f64).sqrt();
        (self.samples > 0).then_some(Error { rms_m, max_m: self.max_m, samples: self.samples })
    }
}

struct TensionSum {
    samples: u64,
    good: u64,
    worst_n: f64,
    least_n: f64,
    greatest_n: f64,
}

impl Default for TensionSum {
    fn default() -> Self {
        Self { samples: 0, good: 0, worst_n: 0.0, least_n: f64::INFINITY, greatest_n: 0.0 }
    }
}

impl TensionSum {
    fn add(&mut self, truth: &TruthNode, chosen: &ControlStatus) {
        let cables = usize::from(truth.cable_count).min(truth.tension_n.len());
        if chosen.valid != 1 || chosen.tension_n[..cables].iter().all(|tension| *tension == 0.0) {
            return;
        }
        self.samples += 1;
        let mut good = true;
        for (real, wanted) in truth.tension_n[..cables].iter().zip(&chosen.tension_n) {
            let off = (real - wanted).abs();
            good &= off <= (TENSION_SHARE * wanted).max(TENSION_N);
            self.worst_n = self.worst_n.max(off);
            self.least_n = self.least_n.min(*real);
            self.greatest_n = self.greatest_n.max(*real);
        }
        self.good += u64::from(good);
    }

    fn result(&self) -> Option<Tensions> {
        (self.samples > 0).then(|| Tensions {
            as_chosen: self.good as f64 / self.samples as f64,
            worst_n: self.worst_n,
            least_n: self.least_n,
            greatest_n: self.greatest_n,
        })
    }
}
