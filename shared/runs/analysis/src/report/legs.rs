//! Flown legs: a leg is one segment of the plan, from rest to rest.

use super::explain::Explanation;
use crate::accuracy::{Distances, Error};
use crate::tracker::Cycle;
use cable_robot::energy::WinchEnergy;
use cable_robot::profile::{Profile, ProfileLimits};
use cable_robot::{Distribution, Path, Robot, Segment, Vector3};
use messages::MotorAuthority;
use serde::Serialize;

/// Maximum number of stored legs; of a run with more, the first ones are kept.
const MAX_LEGS: usize = 500;
/// Intervals of Simpson's rule for the modelled cost.
const INTERVALS: usize = 64;

/// A flown leg.
#[derive(Debug, Clone)]
pub struct Leg {
    life: u64,
    epoch: u32,
    motion: u32,
    segment: Segment,
    /// Time of the first cycle, s since the start of the run.
    pub from_s: f64,
    /// Time of the last cycle, s since the start of the run.
    pub to_s: f64,
    estimate: Distances,
    truth: Distances,
    /// Energy and loss of all motors at the start and at the end, J.
    energy_j: Option<[[f64; 2]; 2]>,
    peak_tension_n: f64,
    /// Path covered by the setpoint between consecutive recorded cycles, m.
    flown_m: f64,
    complete: bool,
}

/// A leg in the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LegReport {
    /// Number, from 1.
    pub number: usize,
    /// Kind of the path: line, parabola, ...
    pub kind: &'static str,
    /// Start, m.
    pub from_m: [f64; 3],
    /// End, m.
    pub to_m: [f64; 3],
    /// Planned path length, m.
    pub length_m: f64,
    /// Path length that was flown and recorded, m.
    pub flown_m: f64,
    /// Flown duration, s.
    pub duration_s: f64,
    /// Planned duration, s.
    pub planned_s: f64,
    /// Highest planned speed, m/s.
    pub cruise_m_s: f64,
    /// Start time, s since the start of the run.
    pub begin_s: f64,
    /// Error of the estimate from the moving setpoint.
    pub estimate: Option<Error>,
    /// Error of the truth from the moving setpoint.
    pub truth: Option<Error>,
    /// Highest estimated tension, N.
    pub peak_tension_n: f64,
    /// Electrical energy of all motors, J.
    pub energy_j: Option<f64>,
    /// Loss in all motors (I²R), J.
    pub loss_j: Option<f64>,
    /// Loss over duration, W.
    pub mean_loss_w: Option<f64>,
    /// Loss by the motor model for the planned path, J.
    pub reckoned_j: Option<f64>,
    /// Loss by the motor model for the straight line between the same points at the same speed, J.
    pub straight_j: Option<f64>,
    /// Whether it was flown to its end.
    pub complete: bool,
    /// The largest deviations of estimate and truth, with what the record shows while they rose.
    pub deviations: Vec<Explanation>,
}

impl LegReport {
    /// Returns the remark for an incomplete leg; `now` is the current activity on it, if any.
    #[must_use]
    pub fn unfinished(&self, now: Option<&str>) -> String {
        if self.complete { String::new() } else { format!(" ({})", now.unwrap_or("cut")) }
    }
}

/// All flown legs of a run.
#[derive(Debug, Clone, Default)]
pub struct Legs {
    legs: Vec<Leg>,
    /// Number of legs beyond the limit.
    pub left_out: usize,
    last: Option<LegKey>,
    /// Whether the last cycle is followed by the next one without a gap in the file.
    contiguous: bool,
    /// Path flown and recorded on all legs, including those beyond the limit, m.
    flown_m: f64,
    /// Last path position of the setpoint on the current leg, m; `None` before its first cycle.
    at_m: Option<f64>,
}

/// Identity of a leg: life of motor-io, epoch, motion and segment.
type LegKey = (u64, u32, u32, u64);

impl Legs {
    /// Adds a cycle.
    pub fn cycle(&mut self, time_s: f64, cycle: &Cycle<'_>) {
        self.update(time_s, cycle);
        self.contiguous = cycle.next.is_some();
    }

    fn update(&mut self, time_s: f64, cycle: &Cycle<'_>) {
        let Some(segment) = cycle.segment else {
            return self.follow_stop(cycle.authority);
        };
        let key = (cycle.authority.header.life, cycle.authority.epoch, cycle.authority.motion, segment.id);
        if self.last != Some(key) {
            self.complete_previous(key);
            // If the previous cycle is in the file, the leg is recorded from its start; otherwise from its first
            // recorded cycle.
            (self.last, self.at_m) = (Some(key), self.contiguous.then_some(0.0));
            if self.legs.len() == MAX_LEGS {
                self.left_out += 1;
            } else {
                self.legs.push(Leg {
                    life: key.0,
                    epoch: key.1,
                    motion: key.2,
                    segment: *segment,
                    from_s: time_s,
                    to_s: time_s,
                    estimate: Distances::default(),
                    truth: Distances::default(),
                    energy_j: None,
                    peak_tension_n: 0.0,
                    flown_m: 0.0,
                    complete: false,
                });
            }
        }
        self.advance(segment, cycle.authority);
        let Some(leg) = self.legs.last_mut().filter(|leg| leg.key() == key) else { return };
        leg.to_s = time_s;
        leg.complete |= cycle.authority.plan_time_s >= segment.end_s() - cycle.authority.period_s;
        let count = usize::from(cycle.authority.cable_count);
        if let Some(energy) = cycle.energy {
            let sum = |values: &[f64]| values.iter().take(count).sum::<f64>();
            let now = [sum(&energy.energy_j), sum(&energy.loss_j)];
            leg.energy_j = Some([leg.energy_j.map_or(now, |[begin, _]| begin), now]);
        }
        if let Some(estimate) = cycle.estimate {
            leg.peak_tension_n = estimate.tension_n.iter().take(count).copied().fold(leg.peak_tension_n, f64::max);
        }
        let (Some(setpoint), Some(_), true) = (cycle.setpoint, cycle.next, cycle.moving) else { return };
        if let Some(estimate) = cycle.estimate {
            leg.estimate.add((Vector3::from(estimate.position_m) - setpoint.position).norm());
        }
        for truth in cycle.truth {
            if let Some(target) = cycle.setpoint_at(truth.header.stamp_ns) {
                leg.truth.add((Vector3::from(truth.position_m) - target.position).norm());
            }
        }
    }

    /// Adds the stopping distance on the leg that the robot followed.
    fn follow_stop(&mut self, authority: &MotorAuthority) {
        let key = (authority.header.life, authority.epoch, authority.motion, u64::from(authority.segment));
        if authority.mode != MotorAuthority::MODE_STOPPING || self.last != Some(key) {
            return;
        }
        if let Some(segment) = self.legs.last().filter(|leg| leg.key() == key).map(|leg| leg.segment) {
            self.advance(&segment, authority);
        }
    }

    /// Completes the previous leg of the same motion, because the next leg starts where it ends.
    fn complete_previous(&mut self, key: LegKey) {
        let same = |other: &LegKey| (other.0, other.1, other.2) == (key.0, key.1, key.2);
        let Some(last) = self.last.filter(same) else { return };
        if let Some(leg) = self.legs.last_mut().filter(|leg| leg.key() == last) {
            leg.complete = true;
            let length_m = leg.segment.path.length();
            self.advance_to(length_m);
        }
    }

    /// Adds the progress of the setpoint on the current leg.
    fn advance(&mut self, segment: &Segment, authority: &MotorAuthority) {
        let length_m = segment.path.length();
        let at_end = authority.plan_time_s >= segment.end_s() - authority.period_s;
        let now_m = if at_end { length_m } else { segment.setpoint(authority.plan_time_s).path_s_m };
        self.advance_to(now_m.clamp(0.0, length_m));
    }

    /// Sets the path position on the current leg. Like time, path counts only between consecutive cycles in the file.
    fn advance_to(&mut self, now_m: f64) {
        let from_m = self.at_m.filter(|_| self.contiguous).unwrap_or(now_m);
        let flown_m = (now_m - from_m).max(0.0);
        self.at_m = Some(now_m.max(from_m));
        self.flown_m += flown_m;
        if let Some(leg) = self.legs.last_mut().filter(|leg| Some(leg.key()) == self.last) {
            leg.flown_m += flown_m;
        }
    }

    /// Returns the index of the leg of the last cycle; `None` beyond the limit.
    pub fn current(&self) -> Option<usize> {
        let at = self.legs.len().checked_sub(1)?;
        (Some(self.legs[at].key()) == self.last).then_some(at)
    }

    /// Returns start and end of each leg, s.
    pub fn spans(&self) -> impl Iterator<Item = (f64, f64)> {
        self.legs.iter().map(|leg| (leg.from_s, leg.to_s))
    }

    /// Returns the flown and recorded path length, including aborted legs, m.
    #[must_use]
    pub fn flown_m(&self) -> f64 {
        self.flown_m
    }

    /// Returns the reports of all stored legs, with their cost by the robot's model.
    #[must_use]
    pub fn reports(&self, robot: Option<&Robot>) -> Vec<LegReport> {
        self.legs.iter().enumerate().map(|(at, leg)| leg.report(at + 1, robot)).collect()
    }
}

impl Leg {
    fn key(&self) -> LegKey {
        (self.life, self.epoch, self.motion, self.segment.id)
    }

    fn report(&self, number: usize, robot: Option<&Robot>) -> LegReport {
        let Segment { path, profile, .. } = &self.segment;
        let cruise_m_s = profile.knots().iter().map(|knot| knot.v_m_s).fold(0.0, f64::max);
        let spent = self.energy_j.map(|[begin, end]| [end[0] - begin[0], end[1] - begin[1]]);
        let duration_s = self.to_s - self.from_s;
        let moves = path.length() > 0.0;
        let straight = match path {
            Path::Spiral(_) => None,
            _ => straight_line(path, profile),
        };
        LegReport {
            number,
            kind: kind(path),
            from_m: path.start().into(),
            to_m: path.end().into(),
            length_m: path.length(),
            flown_m: self.flown_m,
            duration_s,
            planned_s: profile.duration(),
            cruise_m_s,
            begin_s: self.from_s,
            estimate: self.estimate.result(),
            truth: self.truth.result(),
            peak_tension_n: self.peak_tension_n,
            energy_j: spent.map(|spent| spent[0]),
            loss_j: spent.map(|spent| spent[1]),
            mean_loss_w: spent.filter(|_| duration_s > 0.0).map(|spent| spent[1] / duration_s),
            reckoned_j: robot.filter(|_| moves).and_then(|robot| modelled_loss(robot, path, profile)),
            straight_j: robot
                .zip(straight.filter(|_| moves))
                .and_then(|(robot, (path, profile))| modelled_loss(robot, &path, &profile)),
            complete: self.complete,
            deviations: Vec::new(),
        }
    }
}

fn kind(path: &Path) -> &'static str {
    match path {
        Path::Dwell(_) => "dwell",
        Path::Line(_) => "line",
        Path::Parabola(_) => "parabola",
        Path::Spiral(_) => "spiral",
        Path::Lateral(_) => "lateral",
    }
}

/// Returns the straight line between the same points with the cruise speed and the acceleration of the profile.
fn straight_line(path: &Path, profile: &Profile) -> Option<(Path, Profile)> {
    let line = Path::line(path.start(), path.end());
    let knots = profile.knots();
    let cruise_m_s = knots.iter().map(|knot| knot.v_m_s).fold(0.0, f64::max);
    let first = knots.get(1)?;
    let acceleration = first.v_m_s * first.v_m_s / (2.0 * first.s_m);
    let limits = ProfileLimits::rest_to_rest(cruise_m_s, acceleration);
    Some((line, Profile::plan(&line, &limits).ok()?))
}

/// Returns the loss in the motors by their model, J; `None` where the robot cannot hold the node.
fn modelled_loss(robot: &Robot, path: &Path, profile: &Profile) -> Option<f64> {
    let method: Distribution = robot.default_distribution();
    let winch_energy = WinchEnergy {
        anchors: robot.anchors(),
        wrench_n: robot.wrench_n(&Vector3::zeros()),
        drag_n_s2_m2: robot.drag_n_s2_m2(),
        cable_weight_n_m: robot.cable_weight_n_m(),
        limits_n: robot.tension_limits_n(),
        method,
        current: robot.current(),
    };
    winch_energy.along_profile(path, profile, robot.node_mass_kg(), INTERVALS).ok().map(|cost| cost.energy_j)
}
