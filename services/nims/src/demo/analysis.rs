//! How well a run followed its setpoints, from the run file alone.

use crate::failure::{Answer, Failure};
use cable_robot::{Segment, Setpoint, Vector3};
use messages::{ControlStatus, Message, MotorAuthority, NodeEstimate, PlanMotion, TruthNode};
use serde::Serialize;
use service::motion::segment_of;
use std::collections::BTreeMap;
use std::path::Path;

/// A setpoint slower than this rests, m/s: the ends of a profile, where every law is right.
const MOVING_M_S: f64 = 1e-3;
/// Deviation of a tension from the chosen one that counts as the same: this share of it, or the next constant.
const TENSION_SHARE: f64 = 0.15;
/// See above, N.
const TENSION_N: f64 = 2.0;

/// Root mean square and maximum of an error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Error {
    /// Root mean square, m.
    pub rms_m: f64,
    /// Maximum, m.
    pub max_m: f64,
    /// How many samples.
    pub samples: usize,
}

/// Tensions that really were, against those that were chosen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tensions {
    /// Part of the samples in which every line is within 15 % or 2 N of the chosen tension.
    pub as_chosen: f64,
    /// Largest deviation, N.
    pub worst_n: f64,
    /// Least tension of any line, N.
    pub least_n: f64,
    /// Largest tension of any line, N.
    pub greatest_n: f64,
}

/// What a run comes to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Analysis {
    /// Time in which the setpoint moved, s.
    pub moving_s: f64,
    /// Estimate against setpoint, over moving cycles.
    pub estimate: Error,
    /// Truth against setpoint, over moving cycles; only the virtual box knows it.
    pub truth: Option<Error>,
    /// Tensions by truth, over moving cycles.
    pub tensions: Option<Tensions>,
    /// Control cycles.
    pub cycles: u64,
    /// Cycles without a valid command while following.
    pub missed: u64,
    /// Cycles that began late because the machine stood still.
    pub late: u64,
    /// Cycles lost to the bus.
    pub skipped: u64,
    /// For plots.
    #[serde(skip)]
    pub track: Vec<Point>,
}

/// One moving cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Time since the first one, s.
    pub time_s: f64,
    /// Where the node should be, m.
    pub setpoint: Vector3<f64>,
    /// Where it was estimated, m.
    pub estimate: Vector3<f64>,
    /// Where it was, m.
    pub truth: Option<Vector3<f64>>,
}

#[derive(Default)]
struct Collected {
    segments: BTreeMap<u32, Segment>,
    authority: Vec<MotorAuthority>,
    estimates: BTreeMap<u64, NodeEstimate>,
    truth: Vec<TruthNode>,
    chosen: BTreeMap<u64, ControlStatus>,
}

/// Reads a run and compares.
///
/// # Errors
/// It cannot be read, or nothing moved in it.
pub fn analyse(run: &Path) -> Answer<Analysis> {
    let all = collect(run)?;
    let (Some(first), Some(last)) = (all.authority.first(), all.authority.last()) else {
        return Err(Failure::NotNow(format!(
            "{} holds no motor/authority: nothing can be said about it",
            run.display()
        )));
    };
    let segments: Vec<&Segment> = all.segments.values().collect();
    let mut track = Vec::new();
    let mut truth_errors = Vec::new();
    let mut tensions = TensionTally::default();
    let mut begin_ns = None;
    let mut next_truth = 0;
    for pair in all.authority.windows(2) {
        let (now, then) = (&pair[0], &pair[1]);
        if now.mode != MotorAuthority::MODE_FOLLOWING {
            continue;
        }
        let Some(setpoint) = moving(&segments, now) else { continue };
        let Some(estimate) = all.estimates.get(&now.header.cycle).filter(|estimate| estimate.valid == 1) else {
            continue;
        };
        let begin_ns = *begin_ns.get_or_insert(now.header.stamp_ns);
        // Every true position between this cycle and the next, against the setpoint of its own time.
        let mut nearest = None;
        while let Some(truth) = all.truth.get(next_truth).filter(|truth| truth.header.stamp_ns < then.header.stamp_ns) {
            next_truth += 1;
            if truth.header.stamp_ns < now.header.stamp_ns {
                continue;
            }
            let span = then.header.stamp_ns.saturating_sub(now.header.stamp_ns).max(1) as f64;
            let share = (truth.header.stamp_ns - now.header.stamp_ns) as f64 / span;
            let plan_time = now.plan_time_s + share * (then.plan_time_s - now.plan_time_s);
            let Some(target) = setpoint_at(&segments, plan_time) else { continue };
            let position = Vector3::from(truth.position_m);
            truth_errors.push((position - target.position).norm());
            nearest.get_or_insert(position);
            if let Some(chosen) = all.chosen.get(&now.header.cycle) {
                tensions.add(truth, chosen);
            }
        }
        track.push(Point {
            time_s: (now.header.stamp_ns - begin_ns) as f64 * 1e-9,
            setpoint: setpoint.position,
            estimate: Vector3::from(estimate.position_m),
            truth: nearest,
        });
    }
    if track.is_empty() {
        return Err(Failure::NotNow(format!("nothing moved in {}", run.display())));
    }
    let period = last.period_s;
    Ok(Analysis {
        moving_s: track.len() as f64 * period,
        estimate: error(track.iter().map(|point| (point.estimate - point.setpoint).norm())),
        truth: (!truth_errors.is_empty()).then(|| error(truth_errors.iter().copied())),
        tensions: tensions.result(),
        cycles: last.header.cycle.saturating_sub(first.header.cycle) + 1,
        missed: last.missed,
        late: last.late,
        skipped: last.skipped,
        track,
    })
}

fn collect(run: &Path) -> Answer<Collected> {
    let mut all = Collected::default();
    let mut reader = runlog::RunReader::open(run).map_err(Failure::not_now)?;
    while let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? {
        match recorded.channel.name.as_str() {
            "plan/motion" => {
                if let Some(motion) = recorded.to::<PlanMotion>() {
                    for message in [&motion.current, &motion.next] {
                        if let Some(segment) = segment_of(message) {
                            all.segments.insert(message.id, segment);
                        }
                    }
                }
            }
            "motor/authority" => all.authority.extend(recorded.to::<MotorAuthority>()),
            "node/estimate/a" => {
                if let Some(estimate) = recorded.to::<NodeEstimate>() {
                    all.estimates.insert(estimate.header().cycle, estimate);
                }
            }
            "control/status/a" => {
                if let Some(status) = recorded.to::<ControlStatus>() {
                    all.chosen.insert(status.header().cycle, status);
                }
            }
            "truth/node" => all.truth.extend(recorded.to::<TruthNode>()),
            _ => {}
        }
    }
    all.truth.sort_by_key(|truth| truth.header.stamp_ns);
    Ok(all)
}

/// The setpoint at a time of the plan clock: of the segment that began last.
fn setpoint_at(segments: &[&Segment], plan_time_s: f64) -> Option<Setpoint> {
    segments
        .iter()
        .filter(|segment| segment.start_s <= plan_time_s)
        .max_by(|a, b| a.start_s.total_cmp(&b.start_s))
        .map(|segment| segment.setpoint(plan_time_s))
}

fn moving(segments: &[&Segment], authority: &MotorAuthority) -> Option<Setpoint> {
    setpoint_at(segments, authority.plan_time_s)
        .filter(|setpoint| !setpoint.at_rest && setpoint.velocity.norm() * authority.plan_rate > MOVING_M_S)
}

fn error(values: impl Iterator<Item = f64>) -> Error {
    let (mut squares, mut max_m, mut samples) = (0.0, 0.0_f64, 0_usize);
    for value in values {
        squares += value * value;
        max_m = max_m.max(value);
        samples += 1;
    }
    Error { rms_m: (squares / samples.max(1) as f64).sqrt(), max_m, samples }
}

struct TensionTally {
    samples: u64,
    good: u64,
    worst_n: f64,
    least_n: f64,
    greatest_n: f64,
}

impl Default for TensionTally {
    fn default() -> Self {
        Self { samples: 0, good: 0, worst_n: 0.0, least_n: f64::INFINITY, greatest_n: 0.0 }
    }
}

impl TensionTally {
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
