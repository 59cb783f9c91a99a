//! A mission made into checked segments: everything that can be refused is refused here, before anything moves.

use cable_robot::energy::{EnergyError, flight};
use cable_robot::motion::{Refusal, Report};
use cable_robot::path::{self, PathError};
use cable_robot::profile::{Knot, MAX_KNOTS, ProfileError, ProfileLimits};
use cable_robot::{Distribution, Path, Profile, Robot, Segment, Vector3};
use service::config::{BoxFile, Point};
use thiserror::Error;

use crate::mission::{Leg, Mission, PathShape};

/// Most segments of a mission.
pub const MAX_SEGMENTS: usize = 2000;

/// A leg that ends closer than this to where it starts is already flown, m: the repeatability of the robot.
const THERE_M: f64 = 0.001;

/// Shares of the sag or swing that loses least, tried in this order: it is found for a constant speed, and the accelerations at both
/// ends may ask for less.
const SAG_SHARES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];

/// Shortest segment, s; a shorter one is flown more slowly. A controller's horizon (0.2 s) and a lost sample of
/// `plan/motion` (0.1 s) together must not reach beyond the next segment.
pub const SHORTEST_S: f64 = 0.5;

/// What missions are planned with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannerConfig {
    /// The robot.
    pub robot: Robot,
    /// How tensions are chosen, for the check.
    pub distribution: Distribution,
    /// Cruise speed where a mission names none, m/s.
    pub speed_m_s: f64,
    /// Tangential acceleration where a mission names none, m/s².
    pub acceleration_m_s2: f64,
    /// Distance between checked points of a path, m.
    pub check_step_m: f64,
}

impl PlannerConfig {
    /// As a box file and its robot say.
    pub fn of(file: &BoxFile, robot: Robot) -> Self {
        Self {
            robot,
            distribution: file.controller.distribution_for(&robot),
            speed_m_s: file.planner.speed_m_s,
            acceleration_m_s2: file.planner.acceleration_m_s2,
            check_step_m: file.planner.check_step_m,
        }
    }
}

/// Why a mission is not flown.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlanError {
    /// A segment breaks a limit.
    #[error("leg {leg}{segment}: {refusal}")]
    Refused {
        /// The leg, from 1.
        leg: usize,
        /// ` from [..] to [..]`.
        segment: String,
        /// Where, what and how much.
        refusal: Refusal,
    },
    /// A speed above the robot's limit.
    #[error("leg {leg} asks for {speed_m_s} m/s, above the robot's speed_limit_m_s of {limit_m_s} m/s; ask for less")]
    TooFast {
        /// The leg, from 1.
        leg: usize,
        /// Asked for, m/s.
        speed_m_s: f64,
        /// Allowed, m/s.
        limit_m_s: f64,
    },
    /// An acceleration above the robot's limit.
    #[error(
        "the mission asks for {asked_m_s2} m/s², above the robot's acceleration_limit_m_s2 of {limit_m_s2} m/s²; ask for less"
    )]
    TooHard {
        /// Asked for, m/s².
        asked_m_s2: f64,
        /// Allowed, m/s².
        limit_m_s2: f64,
    },
    /// A path that is none.
    #[error("leg {leg}: {error}")]
    Path {
        /// The leg, from 1.
        leg: usize,
        /// What is wrong.
        error: PathError,
    },
    /// A profile that cannot be.
    #[error("leg {leg}: {error}")]
    Profile {
        /// The leg, from 1.
        leg: usize,
        /// What is wrong.
        error: ProfileError,
    },
    /// A point of a plane on a robot in space, or one beside the plane.
    #[error("leg {leg}: {why}")]
    Point {
        /// The leg, from 1.
        leg: usize,
        /// What is wrong.
        why: String,
    },
    /// No path that saves energy can be flown.
    #[error("leg {leg}: no path that saves energy can be flown: {error}")]
    NoPath {
        /// The leg, from 1.
        leg: usize,
        /// Why not.
        error: EnergyError,
    },
    /// More segments than are planned at once.
    #[error("the mission has more than {MAX_SEGMENTS} segments; split it into several missions")]
    TooLong,
    /// Nothing to do.
    #[error("the node is already there")]
    AlreadyThere,
    /// The start is not a place.
    #[error("the position of the node is not known ({x} {y} {z}); tell it where it is with nims zero --at x,y,z")]
    NoStart {
        /// As estimated.
        x: f64,
        /// As estimated.
        y: f64,
        /// As estimated.
        z: f64,
    },
}

/// A mission ready to fly.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Segments that follow each other without a gap, each from rest to rest.
    pub segments: Vec<Segment>,
    /// Leg of each segment, from 1.
    pub legs: Vec<u32>,
    /// What each segment comes close to.
    pub reports: Vec<Report>,
    /// How many legs the mission has.
    pub leg_count: u32,
}

impl Plan {
    /// Plans and checks a whole mission that starts at `start` (m) at `start_s` on the plan clock; segments are
    /// numbered from `first_id`.
    ///
    /// # Errors
    /// The first thing that is wrong: where, which cable, how much.
    pub fn new(
        mission: &Mission,
        config: &PlannerConfig,
        start: Vector3<f64>,
        start_s: f64,
        first_id: u32,
    ) -> Result<Self, PlanError> {
        if !start.iter().all(|x| x.is_finite()) {
            return Err(PlanError::NoStart { x: start.x, y: start.y, z: start.z });
        }
        let asked_m_s2 = mission.acceleration_m_s2.unwrap_or(config.acceleration_m_s2);
        let limit_m_s2 = config.robot.acceleration_limit_m_s2();
        if asked_m_s2 > limit_m_s2 && mission.acceleration_m_s2.is_some() {
            return Err(PlanError::TooHard { asked_m_s2, limit_m_s2 });
        }
        let origin = if mission.relative { start } else { Vector3::zeros() };
        let mut builder = Builder {
            config,
            tangential_m_s2: asked_m_s2.min(limit_m_s2),
            default_m_s: mission.speed_m_s,
            shape: mission.path,
            time_weight_w: mission.time_weight_w,
            at: start,
            time_s: start_s,
            next_id: first_id,
            plan: Self {
                segments: Vec::new(),
                legs: Vec::new(),
                reports: Vec::new(),
                leg_count: mission.leg.len() as u32,
            },
        };
        for (i, leg) in mission.leg.iter().enumerate() {
            builder.leg(i + 1, leg, origin)?;
        }
        if builder.plan.segments.is_empty() {
            return Err(PlanError::AlreadyThere);
        }
        Ok(builder.plan)
    }

    /// When it starts on the plan clock, s.
    pub fn start_s(&self) -> f64 {
        self.segments.first().map_or(0.0, |segment| segment.start_s)
    }

    /// When it ends on the plan clock, s.
    pub fn end_s(&self) -> f64 {
        self.segments.last().map_or(0.0, Segment::end_s)
    }

    /// Where it ends, m.
    pub fn end(&self) -> Vector3<f64> {
        self.segments.last().map_or_else(Vector3::zeros, |segment| segment.path.end())
    }

    /// Length of the path, m.
    pub fn length_m(&self) -> f64 {
        self.segments.iter().map(|segment| segment.path.length()).sum()
    }
}

struct Builder<'a> {
    config: &'a PlannerConfig,
    tangential_m_s2: f64,
    default_m_s: Option<f64>,
    shape: PathShape,
    time_weight_w: f64,
    at: Vector3<f64>,
    time_s: f64,
    next_id: u32,
    plan: Plan,
}

impl Builder<'_> {
    fn leg(&mut self, number: usize, leg: &Leg, origin: Vector3<f64>) -> Result<(), PlanError> {
        match leg {
            Leg::Line(l) => self.line(number, origin + self.point(number, &l.to_m)?, l.speed_m_s),
            Leg::Polyline(l) => l.points_m.iter().try_for_each(|p| {
                let to = origin + self.point(number, p)?;
                self.line(number, to, l.speed_m_s)
            }),
            Leg::Parabola(l) => {
                let to = origin + self.point(number, &l.to_m)?;
                if (to - self.at).norm() < THERE_M {
                    return Ok(());
                }
                match l.mu_per_m {
                    Some(mu_per_m) => self.path(number, parabola(self.at, to, mu_per_m), l.speed_m_s),
                    None => self.best_parabola(number, to, l.speed_m_s),
                }
            }
            Leg::Spiral(l) => {
                let path = Path::Spiral(path::Spiral {
                    centre: self.at,
                    start_radius_m: 0.0,
                    end_radius_m: l.radius_m,
                    turns: l.turns,
                    rise_m: l.rise_m,
                    start_angle_rad: 0.0,
                });
                self.path(number, path, l.speed_m_s)
            }
            Leg::Dwell(l) if l.duration_s == 0.0 => Ok(()),
            Leg::Dwell(l) => {
                let profile = Profile::dwell(l.duration_s.max(SHORTEST_S))
                    .map_err(|error| PlanError::Profile { leg: number, error })?;
                self.push(number, Path::Dwell(self.at), profile)
            }
        }
    }

    /// A point as this robot has it.
    fn point(&self, leg: usize, point: &Point) -> Result<Vector3<f64>, PlanError> {
        let planar = self.config.robot.is_planar();
        point.on(planar).map(Vector3::from).map_err(|why| PlanError::Point { leg, why })
    }

    fn line(&mut self, number: usize, to: Vector3<f64>, speed_m_s: Option<f64>) -> Result<(), PlanError> {
        if (to - self.at).norm() < THERE_M {
            return Ok(());
        }
        match self.shape {
            PathShape::Line => self.path(number, Path::line(self.at, to), speed_m_s),
            PathShape::Parabola => self.best_parabola(number, to, speed_m_s),
            PathShape::Lateral => self.best_lateral(number, to, speed_m_s),
        }
    }

    /// The path that sags and swings so that it loses least in the motors, or as much of it as can be flown; a parabola where
    /// swinging saves nothing.
    fn best_lateral(&mut self, leg: usize, to: Vector3<f64>, speed_m_s: Option<f64>) -> Result<(), PlanError> {
        let cruise_m_s = self.cruise_m_s(leg, speed_m_s)?;
        let (robot, method) = (&self.config.robot, self.config.distribution);
        let best = flight::best_lateral(robot, method, &self.at, &to, cruise_m_s, self.time_weight_w)
            .map_err(|error| PlanError::NoPath { leg, error })?;
        let Some((bow, _)) = best.lateral else {
            return self.parabola_or_less(leg, to, best.parabola.mu_per_m, speed_m_s);
        };
        for share in SAG_SHARES {
            match self.path(leg, Path::Lateral(path::Lateral::new(bow.scaled(share))), speed_m_s) {
                Err(PlanError::Refused { .. }) => {}
                result => return result,
            }
        }
        self.parabola_or_less(leg, to, best.parabola.mu_per_m, speed_m_s)
    }

    /// The parabola that loses least in the motors, or as much of its sag as can be flown; straight up and down a line.
    fn best_parabola(&mut self, leg: usize, to: Vector3<f64>, speed_m_s: Option<f64>) -> Result<(), PlanError> {
        let cruise_m_s = self.cruise_m_s(leg, speed_m_s)?;
        let (robot, method) = (&self.config.robot, self.config.distribution);
        let best = flight::best_parabola(robot, method, &self.at, &to, cruise_m_s, self.time_weight_w)
            .map_err(|error| PlanError::NoPath { leg, error })?;
        self.parabola_or_less(leg, to, best.mu_per_m, speed_m_s)
    }

    fn parabola_or_less(
        &mut self,
        leg: usize,
        to: Vector3<f64>,
        mu_per_m: f64,
        speed_m_s: Option<f64>,
    ) -> Result<(), PlanError> {
        let mut refused = None;
        for share in SAG_SHARES {
            match self.path(leg, parabola(self.at, to, share * mu_per_m), speed_m_s) {
                Err(error @ PlanError::Refused { .. }) => refused = refused.or(Some(error)),
                result => return result,
            }
        }
        self.path(leg, Path::line(self.at, to), speed_m_s).map_err(|line| refused.unwrap_or(line))
    }

    /// The speed asked for, or the default.
    fn cruise_m_s(&self, leg: usize, speed_m_s: Option<f64>) -> Result<f64, PlanError> {
        let limit_m_s = self.config.robot.speed_limit_m_s();
        match speed_m_s.or(self.default_m_s) {
            Some(speed_m_s) if speed_m_s > limit_m_s => Err(PlanError::TooFast { leg, speed_m_s, limit_m_s }),
            Some(speed_m_s) => Ok(speed_m_s),
            None => Ok(self.config.speed_m_s.min(limit_m_s)),
        }
    }

    fn path(&mut self, leg: usize, path: Path, speed_m_s: Option<f64>) -> Result<(), PlanError> {
        path.check().map_err(|error| PlanError::Path { leg, error })?;
        let cruise_m_s = self.cruise_m_s(leg, speed_m_s)?;
        let limits = ProfileLimits {
            tangential_m_s2: self.tangential_m_s2,
            total_m_s2: self.config.robot.acceleration_limit_m_s2(),
            ..ProfileLimits::rest_to_rest(cruise_m_s, self.tangential_m_s2)
        };
        let profile = Profile::plan(&path, &limits)
            .and_then(|profile| slowed(&profile))
            .map_err(|error| PlanError::Profile { leg, error })?;
        self.push(leg, path, profile)
    }

    fn push(&mut self, leg: usize, path: Path, profile: Profile) -> Result<(), PlanError> {
        if self.plan.segments.len() == MAX_SEGMENTS {
            return Err(PlanError::TooLong);
        }
        let segment = Segment { id: u64::from(self.next_id), path, profile, start_s: self.time_s };
        let config = self.config;
        let report = segment.check(&config.robot, config.distribution, config.check_step_m).map_err(|refusal| {
            let (a, b) = (path.start(), path.end());
            let segment = format!(" from [{:.3}, {:.3}, {:.3}] to [{:.3}, {:.3}, {:.3}]", a.x, a.y, a.z, b.x, b.y, b.z);
            PlanError::Refused { leg, segment, refusal }
        })?;
        self.at = path.end();
        self.time_s = segment.end_s();
        self.next_id = self.next_id.wrapping_add(1).max(1);
        self.plan.segments.push(segment);
        self.plan.legs.push(leg as u32);
        self.plan.reports.push(report);
        Ok(())
    }
}

/// A parabola, or the line where there is no sag.
fn parabola(from: Vector3<f64>, to: Vector3<f64>, mu_per_m: f64) -> Path {
    if mu_per_m == 0.0 { Path::line(from, to) } else { Path::Parabola(path::Parabola { from, to, mu_per_m }) }
}

/// The same profile, slowed down evenly if it is shorter than [`SHORTEST_S`].
fn slowed(profile: &Profile) -> Result<Profile, ProfileError> {
    let share = profile.duration() / SHORTEST_S;
    if share >= 1.0 {
        return Ok(*profile);
    }
    let mut knots = [Knot::default(); MAX_KNOTS];
    for (slow, knot) in knots.iter_mut().zip(profile.knots()) {
        *slow = Knot { s_m: knot.s_m, v_m_s: knot.v_m_s * share };
    }
    Profile::from_knots(&knots[..profile.knots().len()])
}
