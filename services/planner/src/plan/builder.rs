//! Builder of the segments of a mission: plans and checks one after the other.

use cable_robot::energy::flight;
use cable_robot::motion::Report;
use cable_robot::profile::{Knot, MAX_KNOTS, ProfileError, ProfileLimits};
use cable_robot::{Path, Profile, Segment, Vector3, path, swing};
use config::Point;

use super::{MAX_SEGMENTS, Mark, Plan, PlanError, PlannerConfig, SHORTEST_S, THERE_M};
use crate::scan::{self, Stop};
use mission::{Leg, Mission, PathShape};

/// From this length on the acceleration at both ends of a move is negligible, m.
const LONG_M: f64 = 2.0;

/// Halvings in the search for the largest share of a sag, swing or speed that can be flown: to one in 128.
const HALVINGS: usize = 7;

impl Plan {
    /// Plans and checks a whole mission that starts at `start` (m) at `start_s` on the plan clock; segments are
    /// numbered from `first_id`.
    ///
    /// # Errors
    /// The first violated limit: where, which cable, by how much.
    pub fn new(
        mission: &Mission,
        config: &PlannerConfig,
        start: Vector3<f64>,
        start_s: f64,
        first_id: u32,
    ) -> Result<Self, PlanError> {
        let mut builder = Builder::new(mission, config, start, start_s, first_id)?;
        let origin = if mission.relative { start } else { Vector3::zeros() };
        for (i, leg) in mission.leg.iter().enumerate() {
            builder.leg(i + 1, leg, origin)?;
        }
        builder.plan()
    }

    /// Plans the rest of this plan of `mission` from a point of its path on, for a node at `here` (m): straight to that
    /// point and on, from `start_s` on the plan clock, numbered from `first_id`.
    ///
    /// # Errors
    /// The way back cannot be flown, or there is no such point.
    pub fn rest(
        &self,
        mission: &Mission,
        config: &PlannerConfig,
        from: Mark,
        here: Vector3<f64>,
        start_s: f64,
        first_id: u32,
    ) -> Result<Self, PlanError> {
        let mut builder = Builder::new(mission, config, here, start_s, first_id)?;
        builder.rest(self, from)?;
        builder.plan()
    }
}

/// Builder of segments.
pub(super) struct Builder<'a> {
    config: &'a PlannerConfig,
    tangential_m_s2: f64,
    default_m_s: Option<f64>,
    shape: PathShape,
    time_weight_w: f64,
    at: Vector3<f64>,
    time_s: f64,
    next_id: u32,
    /// Point on the path of the whole mission at which the next segment begins; default: its own number.
    mark: Option<Mark>,
    plan: Plan,
}

impl<'a> Builder<'a> {
    /// Creates a builder at `start` (m), at `start_s` on the plan clock, with segments numbered from `first_id`.
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

    /// Returns the plan.
    pub fn plan(self) -> Result<Plan, PlanError> {
        if self.plan.segments.is_empty() { Err(PlanError::AlreadyThere) } else { Ok(self.plan) }
    }

    /// Adds a straight segment to a point of another plan, and the rest of that plan.
    pub fn rest(&mut self, whole: &Plan, from: Mark) -> Result<(), PlanError> {
        let left = whole.segments.iter().zip(&whole.legs).enumerate().skip(from.segment);
        for (number, (segment, leg)) in left {
            let leg = *leg as usize;
            let along = if number == from.segment { from.along } else { 0.0 };
            let rest = match segment.path {
                Path::Dwell(_) if segment.profile.duration() - along < SHORTEST_S => None,
                path @ Path::Dwell(_) => Some(path),
                // A segment that cannot be divided is flown again as a whole.
                path @ Path::Lateral(_) if path.length() - along > THERE_M => Some(path),
                // A turn that is too small for a spiral is flown straight.
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
            // Also if it is very short: the following segments must connect.
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

    /// Plans one leg from the end of the last one.
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
                    Some(0.0) => self.path(number, Path::line(self.at, to), l.speed_m_s),
                    Some(mu_per_m) => {
                        let path = Path::Parabola(path::Parabola { from: self.at, to, mu_per_m });
                        self.path(number, path, l.speed_m_s)
                    }
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
            // The map determines the path later; the whole area is the upper bound.
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

    /// Moves to the first stop on the path shape of the mission, then straight from stop to stop.
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

    /// Returns a point in the coordinates of this robot.
    fn point(&self, leg: usize, point: &Point) -> Result<Vector3<f64>, PlanError> {
        let planar = self.config.robot.is_planar();
        point.resolve(planar).map(Vector3::from).map_err(|why| PlanError::Point { leg, why })
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

    /// Returns the path with the least loss in the motors that sags and swings, as far as it can be flown; a parabola
    /// where that saves more.
    fn best_lateral(&mut self, leg: usize, to: Vector3<f64>, speed_m_s: Option<f64>) -> Result<(), PlanError> {
        let cruise_m_s = self.cruise_m_s(leg, speed_m_s)?;
        let (robot, method) = (&self.config.robot, self.config.distribution);
        let best = flight::best_lateral(robot, method, &self.at, &to, cruise_m_s, self.time_weight_w)
            .map_err(|error| PlanError::NoPath { leg, error })?;
        if let Some((bow, _)) = best.lateral {
            // It is computed for a constant speed; the accelerations at both ends may allow less.
            let swung = |share| Path::Lateral(path::Lateral::new(bow.scaled(share)));
            let share = self.share(leg, swung, speed_m_s)?;
            let cost_j = |path| self.cost_j(leg, &path, speed_m_s);
            let sagging = self.sagging(leg, to, speed_m_s).ok();
            if share > 0.0 && !sagging.is_some_and(|path| cost_j(path) < cost_j(swung(share))) {
                return self.path(leg, swung(share), speed_m_s);
            }
        }
        self.best_parabola(leg, to, speed_m_s)
    }

    /// Returns the parabola with the least loss in the motors that can be flown; for a vertical move a line.
    fn best_parabola(&mut self, leg: usize, to: Vector3<f64>, speed_m_s: Option<f64>) -> Result<(), PlanError> {
        let path = self.sagging(leg, to, speed_m_s)?;
        self.path(leg, path, speed_m_s)
    }

    /// Searches the sag µ of [`Builder::best_parabola`], 1/m.
    fn sagging(&self, leg: usize, to: Vector3<f64>, speed_m_s: Option<f64>) -> Result<Path, PlanError> {
        let limits = self.limits(leg, speed_m_s)?;
        let (robot, method, from, price_w) =
            (&self.config.robot, self.config.distribution, self.at, self.time_weight_w);
        let none = |error| PlanError::NoPath { leg, error };
        let shape = |mu_per_m| flight::parabola_or_line(&path::Parabola { from, to, mu_per_m });
        // A constant speed is computed faster, and is accurate for a long move.
        if (to - from).norm() >= LONG_M {
            let steady =
                flight::best_parabola(robot, method, &from, &to, limits.cruise_m_s, price_w).map_err(none)?.mu_per_m;
            if self.tried(leg, shape(steady), speed_m_s).is_ok() {
                return Ok(shape(steady));
            }
        }
        let step_m = self.config.check_step_m;
        let best =
            flight::best_flown_parabola(robot, method, &from, &to, &limits, step_m, price_w).map_err(none)?.mu_per_m;
        // A profile that the plan slows down has other points.
        Ok(shape(best * self.share(leg, |share| shape(share * best), speed_m_s)?))
    }

    /// Returns the largest share of the sag or swing of a path that can be flown.
    fn share(&self, leg: usize, path: impl Fn(f64) -> Path, speed_m_s: Option<f64>) -> Result<f64, PlanError> {
        let flies = |share| match self.tried(leg, path(share), speed_m_s) {
            Err(PlanError::Refused { .. }) => Ok(false),
            result => result.map(|_| true),
        };
        if flies(1.0)? {
            return Ok(1.0);
        }
        let (mut flown, mut refused) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let share = 0.5 * (flown + refused);
            if flies(share)? { flown = share } else { refused = share }
        }
        Ok(flown)
    }

    /// Returns the cost of a path with its time, J; infinite if it cannot be flown.
    fn cost_j(&self, leg: usize, path: &Path, speed_m_s: Option<f64>) -> f64 {
        let Ok(profile) = self.profile(leg, path, speed_m_s) else { return f64::INFINITY };
        flight::along(&self.config.robot, self.config.distribution, path, &profile)
            .map_or(f64::INFINITY, |cost| cost.energy_j + self.time_weight_w * cost.duration_s)
    }

    /// Returns the requested speed, or the default.
    fn cruise_m_s(&self, leg: usize, speed_m_s: Option<f64>) -> Result<f64, PlanError> {
        let limit_m_s = self.config.robot.speed_limit_m_s();
        match speed_m_s.or(self.default_m_s) {
            Some(speed_m_s) if speed_m_s > limit_m_s => Err(PlanError::TooFast { leg, speed_m_s, limit_m_s }),
            Some(speed_m_s) => Ok(speed_m_s),
            None => Ok(self.config.speed_m_s.min(limit_m_s)),
        }
    }

    fn limits(&self, leg: usize, speed_m_s: Option<f64>) -> Result<ProfileLimits, PlanError> {
        Ok(ProfileLimits {
            tangential_m_s2: self.tangential_m_s2,
            total_m_s2: self.config.robot.acceleration_limit_m_s2(),
            swing_limit_m: self.config.swing_limit_m,
            ..ProfileLimits::rest_to_rest(self.cruise_m_s(leg, speed_m_s)?, self.tangential_m_s2)
        })
    }

    fn profile(&self, leg: usize, path: &Path, speed_m_s: Option<f64>) -> Result<Profile, PlanError> {
        let robot = &self.config.robot;
        path.check().map_err(|error| PlanError::Path { leg, error })?;
        Profile::plan(path, &self.limits(leg, speed_m_s)?)
            .and_then(|profile| slowed(&profile))
            .map(|profile| swing::shaped(robot, self.config.distribution, path, profile, self.config.swing_limit_m))
            .map_err(|error| PlanError::Profile { leg, error })
    }

    /// Plans and checks a path from the present point, without adding it.
    fn tried(&self, leg: usize, path: Path, speed_m_s: Option<f64>) -> Result<(Segment, Report), PlanError> {
        self.checked(leg, path, self.profile(leg, &path, speed_m_s)?)
    }

    fn path(&mut self, leg: usize, path: Path, speed_m_s: Option<f64>) -> Result<(), PlanError> {
        let profile = self.profile(leg, &path, speed_m_s)?;
        self.push(leg, path, profile).map_err(|error| self.advised(error, path, speed_m_s))
    }

    /// Adds to a refusal the speed at which the path can be flown, if a lower one helps.
    fn advised(&self, mut error: PlanError, path: Path, speed_m_s: Option<f64>) -> PlanError {
        if let PlanError::Refused { leg, refusal, feasible_m_s, .. } = &mut error
            && refusal.cause.depends_on_speed()
        {
            *feasible_m_s = self.feasible_m_s(*leg, path, speed_m_s);
        }
        error
    }

    /// Searches a cruise speed below the rejected one at which a path can be flown, m/s; the highest, unless friction
    /// makes a slower motion harder somewhere.
    fn feasible_m_s(&self, leg: usize, path: Path, speed_m_s: Option<f64>) -> Option<f64> {
        let (mut flown_m_s, mut refused_m_s) = (0.0, self.cruise_m_s(leg, speed_m_s).ok()?);
        for _ in 0..HALVINGS {
            // To a whole millimetre per second, as the advice states it.
            let middle_m_s = (500.0 * (flown_m_s + refused_m_s)).floor() / 1000.0;
            let flies = middle_m_s > flown_m_s && self.tried(leg, path, Some(middle_m_s)).is_ok();
            if flies { flown_m_s = middle_m_s } else { refused_m_s = middle_m_s }
        }
        (flown_m_s > 0.0).then_some(flown_m_s)
    }

    fn checked(&self, leg: usize, path: Path, profile: Profile) -> Result<(Segment, Report), PlanError> {
        let segment = Segment { id: u64::from(self.next_id), path, profile, start_s: self.time_s };
        let config = self.config;
        let report = segment.check(&config.robot, config.distribution, config.check_step_m).map_err(|refusal| {
            let (a, b) = (path.start(), path.end());
            let segment = format!(" from [{:.3}, {:.3}, {:.3}] to [{:.3}, {:.3}, {:.3}]", a.x, a.y, a.z, b.x, b.y, b.z);
            PlanError::Refused { leg, segment, refusal: Box::new(refusal), feasible_m_s: None }
        })?;
        Ok((segment, report))
    }

    fn push(&mut self, leg: usize, path: Path, profile: Profile) -> Result<(), PlanError> {
        if self.plan.segments.len() == MAX_SEGMENTS {
            return Err(PlanError::TooLong);
        }
        let (segment, report) = self.checked(leg, path, profile)?;
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

/// Returns the profile, slowed down evenly if it is shorter than [`SHORTEST_S`].
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
