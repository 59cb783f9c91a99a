//! A motion: path and speed profile placed on the plan clock, setpoints at any time, and the check of a whole
//! segment before it starts.
//!
//! Positions in m, velocities in m/s, accelerations in m/s², plan time in s. A check returns a [`Report`] or a
//! [`Refusal`] with the position on the path and the violated limit, including tensions after (15)-(16).

use core::fmt;

use nalgebra::Vector3;
use thiserror::Error;

use crate::kinematics::{Jacobian, inverse_kinematics};
use crate::motor::DriveLoad;
use crate::path::{Path, PathPoint, Walk};
use crate::profile::{Profile, slope, speed_between};
use crate::tension::{TensionError, Violation};
use crate::{CableVec, Contact, Distribution, Robot, elastic, tension};

/// Largest difference between the arc lengths of path and profile, m: a message may have rounded the profile.
const LENGTH_TOLERANCE_M: f64 = 1e-6;

/// Relative excess over a limit that counts as rounding.
const ROUNDING: f64 = 1e-6;

/// Share of the acceleration limit up to which a segment passes: profiles keep the limit at samples of the curvature,
/// and between samples the excess is at most 1 %.
pub(crate) const ACCELERATION_EXCESS: f64 = 1.01;

/// Largest number of samples of a check: in longer segments the step grows.
const MAX_SAMPLES: f64 = 1e5;

/// A move: path, speed and start time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Number of the segment, unique within a run.
    pub id: u64,
    /// Geometry.
    pub path: Path,
    /// Speed over arc length.
    pub profile: Profile,
    /// Start on the plan clock, s.
    pub start_s: f64,
}

/// Desired state of the node at a plan time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Velocity, m/s.
    pub velocity: Vector3<f64>,
    /// Acceleration, m/s².
    pub acceleration: Vector3<f64>,
    /// Segment that the setpoint belongs to.
    pub segment_id: u64,
    /// Arc length along that segment, m.
    pub path_s_m: f64,
    /// True before the start and after the end of the segment, when the setpoint rests.
    pub at_rest: bool,
}

impl Segment {
    /// Plan time of the end, s.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.profile.duration()
    }

    /// Computes the setpoint at a plan time, s; before the start and after the end it rests there.
    pub fn setpoint(&self, plan_time_s: f64) -> Setpoint {
        self.setpoint_on(&mut self.path.walk(), plan_time_s)
    }

    /// [`Segment::setpoint`] on a walk along the path.
    pub(crate) fn setpoint_on(&self, walk: &mut Walk, plan_time_s: f64) -> Setpoint {
        let t = plan_time_s - self.start_s;
        let along = self.profile.at(t);
        let point = walk.at(along.s_m);
        let at_rest = !(t >= 0.0 && t <= self.profile.duration()) || self.profile.length() == 0.0;
        let (velocity, acceleration) = derivatives(&point, along.v_m_s, along.a_m_s2);
        Setpoint { position: point.position, velocity, acceleration, segment_id: self.id, path_s_m: along.s_m, at_rest }
    }

    /// Checks the whole segment against the robot's limits before it starts: tensions with the acceleration of the
    /// profile and the drag, and at rest (16), cable speeds, lengths, ground, keep-out boxes, speed and
    /// acceleration of the node. Samples are at most `step_m` apart along the path; at every knot both adjacent
    /// accelerations are checked.
    ///
    /// At a constant plan rate r, acceleration and drag are r² times those of the profile, and the forces of feasible
    /// tensions form a convex set. A segment that is feasible at full rate and at rest is therefore feasible at every
    /// constant rate between. Not included is the acceleration of a ramp from one rate to another, the velocity times
    /// the change of the rate: tension limits need room for that of `ramp_s` of motor-io.
    ///
    /// ```
    /// use cable_robot::*;
    /// # let robot = Robot::new(RobotParts {
    /// #     anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]], node_mass_kg: 1.2,
    /// #     tension_limits_n: [2.0, 60.0], speed_limit_m_s: 0.4, acceleration_limit_m_s2: 0.5, ..RobotParts::default()
    /// # })?;
    /// let path = Path::line(Vector3::new(4.0, 2.0, 1.0), Vector3::new(5.0, 3.0, 2.9));
    /// let profile = Profile::plan(&path, &profile::ProfileLimits::rest_to_rest(0.2, 0.4))?;
    /// let segment = Segment { id: 1, path, profile, start_s: 0.0 };
    /// let refusal = segment.check(&robot, Distribution::Unique, 0.01).unwrap_err();
    /// let motion::Cause::Tension(violation) = refusal.cause else { panic!("{refusal}") };
    /// assert!(violation.limit_n == 60.0 && violation.tension_n > 60.0, "{refusal}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn check(&self, robot: &Robot, distribution: Distribution, step_m: f64) -> Result<Report, Refusal> {
        let refuse_at_start = |cause| Refusal { position: self.path.start(), path_s_m: 0.0, cause };
        let path_m = self.path.length();
        if !(step_m.is_finite() && step_m > 0.0) {
            return Err(refuse_at_start(Cause::BadStep { step_m }));
        }
        if !self.start_s.is_finite() {
            return Err(refuse_at_start(Cause::BadStart { start_s: self.start_s }));
        }
        if let Err(error) = self.path.check() {
            return Err(refuse_at_start(Cause::BadPath(error)));
        }
        if !((self.profile.length() - path_m).abs() <= LENGTH_TOLERANCE_M) {
            return Err(refuse_at_start(Cause::LengthMismatch { path_m, profile_m: self.profile.length() }));
        }
        let mut report = Report::new(robot, self.profile.duration());
        let mut previous = self.path.start();
        let mut walk = self.path.walk();
        let mut sample = |s_m: f64, v: f64, a: f64| {
            let point = walk.at(s_m);
            let refuse = |cause| Refusal { position: point.position, path_s_m: s_m, cause };
            check_pose(robot, distribution, &point, v, a, &previous, &mut report).map_err(refuse)?;
            previous = point.position;
            Ok(())
        };
        sample(0.0, 0.0, 0.0)?;
        let step_m = step_m.max(path_m / MAX_SAMPLES);
        for pair in self.profile.knots().windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let a = slope(from, to);
            let count = ((to.s_m - from.s_m) / step_m).ceil().max(1.0);
            let mut i = 0.0;
            while i <= count {
                let s_m = if i < count { from.s_m + (to.s_m - from.s_m) * (i / count) } else { to.s_m };
                sample(s_m, speed_between(from, to, s_m), a)?;
                i += 1.0;
            }
        }
        Ok(report)
    }
}

fn derivatives(point: &PathPoint, v: f64, a: f64) -> (Vector3<f64>, Vector3<f64>) {
    (point.tangent * v, point.tangent * a + point.curvature * (v * v))
}

/// The current segment and its successor, if any.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The segment in progress, about to start, or just finished.
    pub current: Segment,
    /// The successor, which takes over at its own start time.
    pub next: Option<Segment>,
}

impl Motion {
    /// Computes the setpoint at a plan time, s: of the successor from its start on, otherwise of the current segment,
    /// at rest before the start and after the end.
    pub fn setpoint(&self, plan_time_s: f64) -> Setpoint {
        match &self.next {
            Some(next) if plan_time_s >= next.start_s => next.setpoint(plan_time_s),
            _ => self.current.setpoint(plan_time_s),
        }
    }

    /// Plan time at which the last known segment ends, s.
    pub fn end_s(&self) -> f64 {
        self.next.as_ref().unwrap_or(&self.current).end_s()
    }
}

/// Extreme values of a segment that passed the check.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Highest tension, N.
    pub peak_tension_n: f64,
    /// Lowest tension, N.
    pub least_tension_n: f64,
    /// Highest cable speed, m/s.
    pub peak_cable_speed_m_s: f64,
    /// Highest current of a motor, A.
    pub peak_current_a: f64,
    /// Highest voltage of a motor, V.
    pub peak_voltage_v: f64,
    /// Shortest measured length per cable, m.
    pub shortest_m: CableVec,
    /// Longest measured length per cable, m.
    pub longest_m: CableVec,
    /// Time from start to end, s.
    pub duration_s: f64,
}

impl Report {
    fn new(robot: &Robot, duration_s: f64) -> Self {
        let n = robot.cable_count();
        Self {
            peak_tension_n: 0.0,
            least_tension_n: f64::INFINITY,
            peak_cable_speed_m_s: 0.0,
            peak_current_a: 0.0,
            peak_voltage_v: 0.0,
            shortest_m: CableVec::repeat(n, f64::INFINITY),
            longest_m: CableVec::zeros(n),
            duration_s,
        }
    }
}

/// Why a check rejects a segment: position and violated limit.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "at ({:.3}, {:.3}, {:.3}) m, {:.3} m along the segment: {cause}",
    position.x, position.y, position.z, path_s_m
)]
pub struct Refusal {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Arc length along the segment, m.
    pub path_s_m: f64,
    /// Violated limit.
    pub cause: Cause,
}

/// Why the node cannot hang at rest at a position.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("the node cannot hang there: {0}")]
pub struct CannotHang(#[from] pub Refusal);

/// Checks that the node can hang at rest at a position, m, with the robot's default distribution of the tensions.
///
/// # Errors
/// The limit that it would violate there.
pub fn check_rest(robot: &Robot, position: &Vector3<f64>) -> Result<Report, CannotHang> {
    let path = Path::Dwell(*position);
    let refused = |cause| CannotHang(Refusal { position: *position, path_s_m: 0.0, cause });
    let profile = Profile::dwell(1.0).map_err(|_| refused(Cause::BadStep { step_m: 1.0 }))?;
    let rest = Segment { id: 1, path, profile, start_s: 0.0 };
    Ok(rest.check(robot, robot.default_distribution(), 1.0)?)
}

/// The limit that a segment would violate.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Cause {
    /// A tension limit.
    #[error("{0}")]
    Tension(Violation),
    /// No tensions exist: singular pose, or a distribution that does not fit the number of cables.
    #[error("{0}")]
    NoTension(TensionError),
    /// A cable would run too fast.
    #[error("cable {} would run at {speed_m_s:.3} m/s, and cable_speed_limit_m_s is {limit_m_s:.3} m/s", cable + 1)]
    CableSpeed {
        /// Index of the cable, from 0.
        cable: usize,
        /// Its speed, m/s.
        speed_m_s: f64,
        /// The limit, m/s.
        limit_m_s: f64,
    },
    /// A motor would draw too much current.
    #[error(
        "the motor of cable {} would draw {:.2} A to {}, and current_limit_a is {limit_a:.2} A",
        cable + 1, load.current_a.abs(), Work(load)
    )]
    Current {
        /// Index of the cable, from 0.
        cable: usize,
        /// What the motor would need.
        load: DriveLoad,
        /// The limit, A.
        limit_a: f64,
    },
    /// A motor would need more voltage than the drive has.
    #[error(
        "the motor of cable {} would need {:.1} V to {}, and supply_min_v less the reserve of the drive is {limit_v:.1} V",
        cable + 1, load.voltage_v.abs(), Work(load)
    )]
    Voltage {
        /// Index of the cable, from 0.
        cable: usize,
        /// What the motor would need.
        load: DriveLoad,
        /// The limit, V.
        limit_v: f64,
    },
    /// The node would move too fast.
    #[error("the node would move at {speed_m_s:.3} m/s, and the speed limit is {limit_m_s:.3} m/s")]
    NodeSpeed {
        /// Its speed, m/s.
        speed_m_s: f64,
        /// The limit, m/s.
        limit_m_s: f64,
    },
    /// The node would accelerate too much.
    #[error("the node would accelerate with {acceleration_m_s2:.3} m/s², and the limit is {limit_m_s2:.3} m/s²")]
    NodeAcceleration {
        /// Its acceleration, m/s².
        acceleration_m_s2: f64,
        /// The limit, m/s².
        limit_m_s2: f64,
    },
    /// A cable would be too short or too long.
    #[error("cable {} would be {length_m:.3} m long, and its length limits are {min_m:.3} to {max_m:.3} m", cable + 1)]
    Length {
        /// Index of the cable, from 0.
        cable: usize,
        /// Its measured length, m.
        length_m: f64,
        /// Shortest allowed, m.
        min_m: f64,
        /// Longest allowed, m.
        max_m: f64,
    },
    /// Outside the plane of a planar robot.
    #[error("the node would be {y_m:.3} m outside the plane y = 0 of this planar robot")]
    OutOfPlane {
        /// Distance from the plane, m.
        y_m: f64,
    },
    /// Below the ground.
    #[error("the node would be {below_m:.3} m below the ground limit of {ground_m:.3} m")]
    Ground {
        /// Depth below the ground limit, m.
        below_m: f64,
        /// Ground limit, m.
        ground_m: f64,
    },
    /// Inside a keep-out box.
    #[error("the node would enter keep-out box {}", number + 1)]
    KeepOut {
        /// Index of the box, from 0.
        number: usize,
    },
    /// The node or a cable would touch an obstacle.
    #[error(
        "{} would come closer than {clearance_m:.2} m to obstacle {}",
        Body(contact.cable), contact.obstacle + 1
    )]
    Obstacle {
        /// What touches what.
        contact: Contact,
        /// The least distance: the clearance and the bound of the position, m.
        clearance_m: f64,
    },
    /// The path is not valid.
    #[error("{0}")]
    BadPath(crate::path::PathError),
    /// The lengths of path and profile differ.
    #[error("the path is {path_m:.6} m long and the speed profile {profile_m:.6} m; plan the profile for this path")]
    LengthMismatch {
        /// Length of the path, m.
        path_m: f64,
        /// Length of the profile, m.
        profile_m: f64,
    },
    /// The start time is not a number.
    #[error("the segment starts at plan time {start_s} s; give a finite time")]
    BadStart {
        /// The start, s.
        start_s: f64,
    },
    /// The step of the check is not a positive number.
    #[error("the step of the check is {step_m} m; accepted: a finite step above 0 m")]
    BadStep {
        /// The step, m.
        step_m: f64,
    },
}

/// The node or a cable, as a subject.
struct Body(Option<usize>);

impl fmt::Display for Body {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(cable) => write!(f, "cable {}", cable + 1),
            None => f.write_str("the node"),
        }
    }
}

/// What a motor has to do, as a clause.
struct Work<'a>(&'a DriveLoad);

impl fmt::Display for Work<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let DriveLoad { tension_n, reel_in_m_s, .. } = *self.0;
        if reel_in_m_s == 0.0 {
            return write!(f, "hold {tension_n:.1} N");
        }
        let direction = if reel_in_m_s > 0.0 { "reel in" } else { "pay out" };
        write!(f, "{direction} at {:.3} m/s under {tension_n:.1} N", reel_in_m_s.abs())
    }
}

impl Cause {
    /// True if a lower speed of the node can help.
    pub fn depends_on_speed(&self) -> bool {
        match self {
            Self::Current { load, .. } | Self::Voltage { load, .. } => load.reel_in_m_s != 0.0,
            Self::CableSpeed { .. } => true,
            _ => false,
        }
    }
}

fn check_drive(robot: &Robot, cable: usize, load: DriveLoad, report: &mut Report) -> Result<(), Cause> {
    let limits = robot.drive_limits();
    if !limits.allow_current(&load) {
        return Err(Cause::Current { cable, load, limit_a: limits.current_a });
    }
    if !limits.allow_voltage(&load) {
        return Err(Cause::Voltage { cable, load, limit_v: limits.voltage_v });
    }
    report.peak_current_a = report.peak_current_a.max(load.current_a.abs());
    report.peak_voltage_v = report.peak_voltage_v.max(load.voltage_v.abs());
    Ok(())
}

/// Checks where the node is, and what it passed since the position before.
fn check_place(
    robot: &Robot,
    distribution: Distribution,
    position: &Vector3<f64>,
    previous: &Vector3<f64>,
) -> Result<(), Cause> {
    let below_m = robot.ground_m() - position.z;
    // Also true for NaN.
    if !(below_m <= 1e-9) {
        return Err(Cause::Ground { below_m, ground_m: robot.ground_m() });
    }
    // Rounding of paths is far below this.
    if robot.is_planar() && !(position.y.abs() <= 1e-9) {
        return Err(Cause::OutOfPlane { y_m: position.y });
    }
    if let Some(number) = robot.keep_out().iter().position(|b| b.touches(previous, position)) {
        return Err(Cause::KeepOut { number });
    }
    if let Some(contact) = robot.contact(previous, position, distribution) {
        return Err(Cause::Obstacle { contact, clearance_m: robot.obstacle_margin_m(position, distribution) });
    }
    Ok(())
}

fn check_pose(
    robot: &Robot,
    distribution: Distribution,
    point: &PathPoint,
    v: f64,
    a: f64,
    previous: &Vector3<f64>,
    report: &mut Report,
) -> Result<(), Cause> {
    let (velocity, acceleration) = derivatives(point, v, a);
    let position = &point.position;
    check_place(robot, distribution, position, previous)?;
    let limit_m_s = robot.speed_limit_m_s();
    if v > limit_m_s * (1.0 + ROUNDING) {
        return Err(Cause::NodeSpeed { speed_m_s: v, limit_m_s });
    }
    let limit_m_s2 = robot.acceleration_limit_m_s2();
    let acceleration_m_s2 = acceleration.norm();
    if acceleration_m_s2 > limit_m_s2 * ACCELERATION_EXCESS {
        return Err(Cause::NodeAcceleration { acceleration_m_s2, limit_m_s2 });
    }
    let jacobian = Jacobian::at(robot.anchors(), position).map_err(|e| Cause::NoTension(e.into()))?;
    let structure = jacobian.structure_matrix();
    let tensions_under = |wrench_n: &Vector3<f64>| {
        tension::distribute(&structure, wrench_n, robot.tension_limits_n(), distribution)
            .map(|found| found.tensions_n)
            .map_err(|error| match error {
                TensionError::Infeasible(violation) => Cause::Tension(violation),
                other => Cause::NoTension(other),
            })
    };
    let rest_n = robot.with_cables_n(position, &robot.wrench_n(&Vector3::zeros()));
    let moving_n = robot.with_cables_n(position, &robot.moving_wrench_n(&velocity, &acceleration));
    let resting = tensions_under(&rest_n)?;
    let tensions = if moving_n != rest_n { tensions_under(&moving_n)? } else { resting };
    let speeds = jacobian.cable_velocity(&velocity);
    let lengths = elastic::unstretched(robot, position, &inverse_kinematics(robot.anchors(), position), &tensions);
    let cable_limit_m_s = robot.cable_speed_limit_m_s();
    for (cable, (speed, length_m)) in speeds.iter().zip(lengths.iter()).enumerate() {
        if speed.abs() > cable_limit_m_s * (1.0 + ROUNDING) {
            return Err(Cause::CableSpeed { cable, speed_m_s: speed.abs(), limit_m_s: cable_limit_m_s });
        }
        let [min_m, max_m] = robot.length_limits_m()[cable];
        if !(*length_m >= min_m && *length_m <= max_m) {
            return Err(Cause::Length { cable, length_m: *length_m, min_m, max_m });
        }
        let rise_n = robot.cable_load(cable, position).rise_n;
        check_drive(robot, cable, robot.drive_load(cable, resting[cable] + rise_n, 0.0), report)?;
        check_drive(robot, cable, robot.drive_load(cable, tensions[cable] + rise_n, -speed), report)?;
        report.shortest_m[cable] = report.shortest_m[cable].min(*length_m);
        report.longest_m[cable] = report.longest_m[cable].max(*length_m);
        report.peak_cable_speed_m_s = report.peak_cable_speed_m_s.max(speed.abs());
        report.peak_tension_n = report.peak_tension_n.max(tensions[cable]).max(resting[cable]);
        report.least_tension_n = report.least_tension_n.min(tensions[cable]).min(resting[cable]);
    }
    Ok(())
}
