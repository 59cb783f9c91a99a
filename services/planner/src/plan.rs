//! Checked segments of a mission: every refusal happens here, before anything moves.

mod builder;

use cable_robot::energy::{EnergyError, flight};
use cable_robot::motion::{Refusal, Report};
use cable_robot::path::PathError;
use cable_robot::profile::ProfileError;
use cable_robot::{Distribution, Robot, Segment, Vector3};
use config::SystemFile;
use robot_state::Reason;
use robot_state::answers::detail;
use std::fmt;

use crate::scan::ScanError;

/// Most segments of a mission.
pub const MAX_SEGMENTS: usize = 2000;

/// A leg that ends closer than this to its start is skipped, m: the repeatability of the robot.
const THERE_M: f64 = 0.001;

/// Shortest segment, s; a shorter one is flown more slowly. A controller's horizon (0.2 s) and a lost sample of
/// `plan/motion` (0.1 s) together must not reach beyond the next segment.
pub const SHORTEST_S: f64 = 0.5;

/// Configuration of the planner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannerConfig {
    /// The robot.
    pub robot: Robot,
    /// Distribution of tensions for the check.
    pub distribution: Distribution,
    /// Cruise speed for missions without a speed, m/s.
    pub speed_m_s: f64,
    /// Tangential acceleration for missions without one, m/s².
    pub acceleration_m_s2: f64,
    /// Distance between checked points of a path, m.
    pub check_step_m: f64,
    /// Swing of the node above which a move is shaped, m.
    pub swing_limit_m: f64,
}

impl PlannerConfig {
    /// Returns the configuration of a system file and its robot.
    pub fn from_files(file: &SystemFile, robot: Robot) -> Self {
        Self {
            robot,
            distribution: file.controller.distribution_for(&robot),
            speed_m_s: file.planner.speed_m_s,
            acceleration_m_s2: file.planner.acceleration_m_s2,
            check_step_m: file.planner.check_step_m,
            swing_limit_m: file.planner.swing_limit_m,
        }
    }
}

/// Reason for which a mission cannot be planned; its sentence is that of [`PlanError::reason`].
#[derive(Debug, Clone, PartialEq)]
pub enum PlanError {
    /// A segment breaks a limit.
    Refused {
        /// The leg, from 1.
        leg: usize,
        /// Ends of the segment: ` from [..] to [..]`.
        segment: String,
        /// Place, limit and excess.
        refusal: Box<Refusal>,
        /// Speed at which the segment can be flown, m/s; `None` if speed is not the reason, or if none is low enough.
        feasible_m_s: Option<f64>,
    },
    /// A speed above the robot's limit.
    TooFast {
        /// The leg, from 1.
        leg: usize,
        /// Requested speed, m/s.
        speed_m_s: f64,
        /// Allowed speed, m/s.
        limit_m_s: f64,
    },
    /// An acceleration above the robot's limit.
    TooHard {
        /// Requested acceleration, m/s².
        asked_m_s2: f64,
        /// Allowed acceleration, m/s².
        limit_m_s2: f64,
    },
    /// An invalid path.
    Path {
        /// The leg, from 1.
        leg: usize,
        /// Cause.
        error: PathError,
    },
    /// An impossible profile.
    Profile {
        /// The leg, from 1.
        leg: usize,
        /// Cause.
        error: ProfileError,
    },
    /// A planar point for a spatial robot, or a point outside the plane of a planar one.
    Point {
        /// The leg, from 1.
        leg: usize,
        /// Cause.
        why: String,
    },
    /// No path that saves energy can be flown.
    NoPath {
        /// The leg, from 1.
        leg: usize,
        /// Cause.
        error: EnergyError,
    },
    /// An invalid pattern.
    Scan {
        /// The leg, from 1.
        leg: usize,
        /// Cause.
        error: ScanError,
    },
    /// The interrupted mission was planned with another configuration.
    OtherPlan,
    /// More than [`MAX_SEGMENTS`] segments.
    TooLong,
    /// The node is already at the end.
    AlreadyThere,
    /// The start is not a valid position.
    NoStart {
        /// As estimated.
        x: f64,
        /// As estimated.
        y: f64,
        /// As estimated.
        z: f64,
    },
}

impl PlanError {
    /// Returns the reason in the catalogue of answers.
    #[must_use]
    pub fn reason(&self) -> Reason {
        match *self {
            Self::Refused { leg, ref segment, ref refusal, feasible_m_s } => {
                Reason::PlanLimit { leg, segment: detail(segment), why: detail(refusal), feasible_m_s }
            }
            Self::TooFast { leg, speed_m_s, limit_m_s } => Reason::PlanTooFast { leg, speed_m_s, limit_m_s },
            Self::TooHard { asked_m_s2, limit_m_s2 } => Reason::PlanTooHard { asked_m_s2, limit_m_s2 },
            Self::Path { leg, ref error } => Reason::PlanPath { leg, why: detail(error) },
            Self::Profile { leg, ref error } => Reason::PlanProfile { leg, why: detail(error) },
            Self::Point { leg, ref why } => Reason::PlanPoint { leg, why: detail(why) },
            Self::NoPath { leg, ref error } => Reason::PlanEnergy { leg, why: detail(error) },
            Self::Scan { leg, ref error } => Reason::PlanPattern { leg, why: detail(error) },
            Self::TooLong => Reason::PlanTooLong { most: MAX_SEGMENTS },
            Self::OtherPlan => Reason::PlanOther,
            Self::AlreadyThere => Reason::AlreadyThere,
            Self::NoStart { x, y, z } => Reason::NoStart { position_m: [x, y, z] },
        }
    }
}

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.reason().fmt(f)
    }
}

impl std::error::Error for PlanError {}

/// Point on the path of a mission, independent of where its flight began.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mark {
    /// Number of the segment in the plan of the whole mission, from 0.
    pub segment: usize,
    /// Position on the segment: arc length, m; of a dwell the time, s.
    pub along: f64,
}

/// Planned mission.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Segments that follow each other without a gap, each from rest to rest.
    pub segments: Vec<Segment>,
    /// Leg of each segment, from 1.
    pub legs: Vec<u32>,
    /// Result of the check of each segment.
    pub reports: Vec<Report>,
    /// Point on the path of the mission at which each segment begins.
    pub marks: Vec<Mark>,
    /// Number of legs of the mission.
    pub leg_count: u32,
}

impl Plan {
    /// Returns the point of the path that is reached at a time on the plan clock, s, and its position, m; before the
    /// start the beginning, after the end the end. On the way back to an interrupted mission it is the point of the
    /// interruption.
    pub fn reached(&self, time_s: f64) -> (Mark, Vector3<f64>) {
        let number = self.segments.iter().rposition(|segment| segment.start_s <= time_s).unwrap_or(0);
        let (Some(segment), Some(mark)) = (self.segments.get(number), self.marks.get(number)) else {
            return (Mark::default(), Vector3::zeros());
        };
        if self.marks.get(number + 1).is_some_and(|next| next == mark) {
            return (*mark, segment.path.end());
        }
        let passed_s = (time_s - segment.start_s).clamp(0.0, segment.profile.duration());
        if let cable_robot::Path::Dwell(at) = segment.path {
            return (Mark { along: mark.along + passed_s, ..*mark }, at);
        }
        let s_m = segment.profile.at(passed_s).s_m;
        (Mark { along: mark.along + s_m, ..*mark }, segment.path.point(s_m))
    }

    /// Returns the start on the plan clock, s.
    pub fn start_s(&self) -> f64 {
        self.segments.first().map_or(0.0, |segment| segment.start_s)
    }

    /// Returns the end on the plan clock, s.
    pub fn end_s(&self) -> f64 {
        self.segments.last().map_or(0.0, Segment::end_s)
    }

    /// Returns the position of the end, m.
    pub fn end(&self) -> Vector3<f64> {
        self.segments.last().map_or_else(Vector3::zeros, |segment| segment.path.end())
    }

    /// Returns the length of the path, m.
    pub fn length_m(&self) -> f64 {
        self.segments.iter().map(|segment| segment.path.length()).sum()
    }

    /// Returns the loss in the motors by their model, J; `None` where a measured table does not cover it.
    pub fn energy_j(&self, config: &PlannerConfig) -> Option<f64> {
        let cost =
            |segment: &Segment| flight::along(&config.robot, config.distribution, &segment.path, &segment.profile);
        self.segments.iter().map(|segment| cost(segment).ok().map(|cost| cost.energy_j)).sum()
    }
}
