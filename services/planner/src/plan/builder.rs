//! Segments of a mission, made and checked one after the other.

use cable_robot::energy::flight;
use cable_robot::path;
use cable_robot::profile::{Knot, MAX_KNOTS, ProfileError, ProfileLimits};
use cable_robot::{Path, Profile, Segment, Vector3};
use service::config::Point;

use super::{MAX_SEGMENTS, Mark, Plan, PlanError, PlannerConfig, SHORTEST_S, THERE_M};
use crate::mission::{Leg, Mission, PathShape};
use crate::scan::{self, Stop};

/// Shares of the sag or swing that loses least, tried in this order: it is found for a constant speed, and the accelerations at both
/// ends may ask for less.
const SAG_SHARES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];

/// Makes segments, one after the other.
pub(super) struct Builder<'a> {
    config: &'a PlannerConfig,
    tangential_m_s2: f64,
    default_m_s: Option<f64>,
    shape: PathShape,
    time_weight_w: f64,
    at: Vector3<f64>,
    time_s: f64,
    next_id: u32,
    /// Where on the way of the whole mission the next segment begins; its own number where none is said.
    mark: Option<Mark>,
    plan: Plan,
}

impl<'a> Builder<'a> {
    /// Begins at `start` (m), at `start_s` on the plan clock, with segments numbered from `first_id`.
    pub fn new(
        mission: &Mission,
        config: &'a PlannerConfig,
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
        let plan = Plan {
            segments: Vec::new(),
            legs: Vec::new(),
            reports: Vec::new(),
            marks: Vec::new(),
            leg_count: mission.leg.len() as u32,
        };
        Ok(Self {
            config,
            tangential_m_s2: asked_m_s2.min(limit_m_s2),
            default_m_s: mission.speed_m_s,
            shape: mission.path,
            time_weight_w: mission.time_weight_w,
            at: start,
            time_s: start_s,
            next_id: first_id,
            mark: None,
            plan,
        })
    }

    /// What was built.
    pub fn plan(self) -> Result<Plan, PlanError> {
        if self.plan.segments.is_empty() { Err(PlanError::AlreadyThere) } else { Ok(self.plan) }
    }

    /// The rest of a plan from a point of its way on, and the straight way to it.
    pub fn rest(&mut self, whole: &Plan, from: Mark) -> Result<(), PlanError> {
        let left = whole.segments.iter().zip(&whole.legs).enumerate().skip(from.segment);
        for (number, (segment, leg)) in left {
            let leg = *leg as usize;
            let along = if number == from.segment { from.along } else { 0.0 };
            let rest = match segment.path {
                Path::Dwell(_) if segment.profile.duration() - along < SHORTEST_S => None,
                path @ Path::Dwell(_) => Some(path),
                // What has no parts is flown once more as a whole.
                path @ Path::Lateral(_) if path.length() - along > THERE_M => Some(path),
                // So little of a turn that it is no spiral is as good as straight.
                path => path
                    .rest_from(along)
                    .or_else(|| Some(Path::line(path.point(along), path.end())))
                    .filter(|rest| rest.length() > THERE_M),
            };
            let Some(path) = rest else { continue };
            let along = if matches!(path, Path::Lateral(_)) { 0.0 } else { along };
            self.mark = Some(Mark { segment: number, along });
            if (path.start() - self.at).norm() >= THERE_M {
                self.path(leg, Path::line(self.at, path.start()), None)?;
            }
            // Also where that is not worth a way: what follows hangs together.
            self.at = path.start();
            self.mark = Some(Mark { segment: number, along });
            if along == 0.0 {
                self.push(leg, path, segment.profile)?;
            } else if let Path::Dwell(_) = path {
                self.dwell(leg, segment.profile.duration() - along)?;
            } else {
                let cruise_m_s = segment.profile.knots().iter().map(|knot| knot.v_m_s).fold(0.0, f64::max);
                self.path(leg, path, Some(cruise_m_s))?;
            }
        }
        Ok(())
    }

    /// Plans one leg, from where the last one ended.
    pub fn leg(&mut self, number: usize, leg: &Leg, origin: Vector3<f64>) -> Result<(), PlanError> {
        let scan = |error| PlanError::Scan { leg: number, error };
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
            Leg::Dwell(l) => self.dwell(number, l.duration_s),
            Leg::Raster(l) => {
                let [corner, opposite] = [&l.corner_m, &l.opposite_m].map(|p| self.point(number, p));
                let points =
                    scan::raster(origin + corner?, origin + opposite?, l.spacing_m(), l.along).map_err(scan)?;
                let stops: Vec<Stop> = points.into_iter().map(|at| Stop { at, dwell_s: 0.0 }).collect();
                self.stops(number, &stops, l.speed_m_s)
            }
            // What it will be only the map can tell: no more than all of the area.
            Leg::Adaptive(l) => {
                let [corner, opposite] = [&l.corner_m, &l.opposite_m].map(|p| self.point(number, p));
                let points = scan::raster(origin + corner?, origin + opposite?, l.pitch_m, None).map_err(scan)?;
                let stops: Vec<Stop> = points.into_iter().map(|at| Stop { at, dwell_s: 0.0 }).collect();
                self.stops(number, &stops, l.speed_m_s)
            }
            Leg::DwellPoints(l) => l.points_m.iter().try_for_each(|p| {
                let to = origin + self.point(number, p)?;
                self.line(number, to, l.speed_m_s)?;
                self.dwell(number, l.duration_s)
            }),
            Leg::Transect(l) => {
                let [from, to] = [&l.from_m, &l.to_m].map(|p| self.point(number, p));
                let stops = scan::transect(origin + from?, origin + to?, l.step_m, l.dwell_s).map_err(scan)?;
                self.stops(number, &stops, l.speed_m_s)
            }
            Leg::Profile(l) => {
                let from = origin + self.point(number, &l.at_m)?;
                let to = from + Vector3::new(0.0, 0.0, l.rise_m);
                let stops = scan::transect(from, to, l.step_m, l.dwell_s).map_err(scan)?;
                self.stops(number, &stops, l.speed_m_s)
            }
        }
    }

    /// To the first stop as the mission's moves are, then straight from one to the next: what is measured on the way is on a line.
    fn stops(&mut self, number: usize, stops: &[Stop], speed_m_s: Option<f64>) -> Result<(), PlanError> {
        for (i, stop) in stops.iter().enumerate() {
            if i == 0 {
                self.line(number, stop.at, speed_m_s)?;
            } else if (stop.at - self.at).norm() >= THERE_M {
                self.path(number, Path::line(self.at, stop.at), speed_m_s)?;
            }
            self.dwell(number, stop.dwell_s)?;
        }
        Ok(())
    }

    fn dwell(&mut self, leg: usize, duration_s: f64) -> Result<(), PlanError> {
        if duration_s == 0.0 {
            return Ok(());
        }
        let profile = Profile::dwell(duration_s.max(SHORTEST_S)).map_err(|error| PlanError::Profile { leg, error })?;
        self.push(leg, Path::Dwell(self.at), profile)
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
        self.plan.marks.push(self.mark.take().unwrap_or(Mark { segment: self.plan.marks.len(), along: 0.0 }));
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
