//! Currents that follow from lengths, and how they change with each unknown.

use cable_robot::elastic::{self, Equilibrium};
use cable_robot::{CableVec, Robot, RobotParts, Vector3};
use nalgebra::DVector;

use super::record::{Flight, FlightPart, TENTHS, WIDE};

/// Unknowns that all cables have in common; all unknowns are in their standard deviations.
pub(super) const STIFFNESS: usize = 0;
const WEIGHT: usize = 1;
const DRAG: usize = 2;
const RADIUS: usize = 3;
const STRETCHED: usize = 4;
const COMMON: usize = 5;

/// Unknowns of each cable.
const EACH: usize = 0;
const SCALE: usize = 1;
const ZERO: usize = 2;
const POLE: usize = 3;
const ANCHOR: usize = 4;
const CONSTANT: usize = 7;
const GEAR: usize = 8;
const COULOMB: usize = 9;
const VISCOUS: usize = 10;
const INERTIA: usize = 11;
const OF_CABLE: usize = 12;

/// Standard deviations of what no robot file states the deviation of.
const DRAG_SHARE: f64 = 0.3;
/// Of a length where it was set, m: a node that is held at its place by hand, and the pretension there.
const ZERO_M: f64 = 0.05;
/// Of the gear's friction, and of the shares of the others: a flight up and down tells them.
const GEAR_SHARE: f64 = 0.2;
const FRICTION_SHARE: f64 = 0.5;
/// Of coulomb and viscous friction where the robot file has none, N and N s/m.
const FRICTION_N: f64 = 1.0;
const FRICTION_N_S_M: f64 = 5.0;
/// Of rotor and gear as a mass at the cable, kg; the robot file has none.
const INERTIA_KG: f64 = 40.0;

/// Mean and standard deviation of the yielding of a pole as shares of its root mean square: it yields towards the node
/// and never away, as a half-normal distribution has it.
const POLE_MEAN: f64 = 0.80;
const POLE_SIGMA: f64 = 0.60;

/// Speed from which the friction of a winch has its full size, m/s, as a factor of the robot file's transition.
const FULL_FRICTION: f64 = 2.0;
/// Least such speed, m/s: stiction ends below it.
const LEAST_SPEED_M_S: f64 = 0.03;

/// Largest acceleration of a cable, m/s²: beyond it the inertia of the winch is most of the current.
const STEADY_M_S2: f64 = 0.1;

/// Changes for difference quotients: of lengths, m, and as shares of stiffness and forces.
const PROBE_M: f64 = 1e-4;
const PROBE_SHARE: f64 = 0.01;
const PROBE_RADIUS_M: f64 = 1e-4;

/// A current, and how its prediction changes with the unknowns.
pub(super) struct Row {
    pub cable: usize,
    /// Measured less predicted, A.
    pub residual_a: f64,
    pub slope: DVector<f64>,
}

/// The currents of an instant.
pub(super) struct Linearised {
    pub tenth: usize,
    pub rows: Vec<Row>,
}

/// What an instant is computed with, which does not depend on the unknowns.
struct Place {
    part: FlightPart,
    tenth: usize,
    at: Vector3<f64>,
    weight_n: Vector3<f64>,
    drag_n: Vector3<f64>,
    directions: Vec<Vector3<f64>>,
    by_radius: CableVec,
}

/// A robot and its flight.
pub(super) struct Model {
    parts: RobotParts,
    robot: Robot,
    stated_n: f64,
    places: Vec<Place>,
    sigmas: DVector<f64>,
    force_constants_n_a: Vec<f64>,
    slow_m_s: f64,
}

/// The same robot with another stiffness and the predictions with it.
struct Balance {
    found: Equilibrium,
    lengths_m: CableVec,
    tensions_n: CableVec,
}

impl Model {
    pub fn new(parts: &RobotParts, robot: Robot, flight: &Flight, most: usize) -> Self {
        let constants = &flight.force_constants_n_a;
        let slow_m_s = (FULL_FRICTION * robot.motor().transition_m_s).max(LEAST_SPEED_M_S);
        let mut model = Self {
            parts: parts.clone(),
            stated_n: robot.stiffness_n().unwrap_or(f64::INFINITY),
            places: Vec::new(),
            sigmas: sigmas(parts, &robot, constants),
            force_constants_n_a: constants.iter().map(|[value, _]| *value).collect(),
            slow_m_s,
            robot,
        };
        model.places = model.places_of(&flight.parts, flight.part_s, most);
        model
    }

    pub fn cables(&self) -> usize {
        self.robot.cable_count()
    }

    pub fn unknowns(&self) -> usize {
        COMMON + OF_CABLE * self.cables()
    }

    /// Number of currents of each cable that are used.
    pub fn readings(&self) -> Vec<usize> {
        let used = |cable: usize| self.places.iter().filter(|place| self.is_used(&place.part, cable)).count();
        (0..self.cables()).map(used).collect()
    }

    fn is_used(&self, part: &FlightPart, cable: usize) -> bool {
        part.reel_in_m_s[cable].abs() > self.slow_m_s
            && part.reel_in_m_s2[cable].abs() < STEADY_M_S2
            && part.current_a[cable].is_finite()
    }

    /// Instants in which a cable moves, with the motion of the node by the model.
    fn places_of(&self, parts: &[FlightPart], part_s: f64, most: usize) -> Vec<Place> {
        let mut positions: Vec<Option<Vector3<f64>>> = Vec::with_capacity(parts.len());
        for part in parts {
            let guess = positions.last().copied().flatten();
            let found = elastic::equilibrium(&self.robot, &part.lengths_m, &Vector3::zeros(), guess.as_ref());
            positions.push(found.ok().map(|found| found.position));
        }
        let moving = |k: &usize| (0..self.cables()).any(|cable| self.is_used(&parts[*k], cable));
        let used: Vec<usize> = (1..parts.len().saturating_sub(1)).filter(moving).collect();
        let step = used.len().div_ceil(most).max(1);
        let mut places = Vec::new();
        for k in used.into_iter().step_by(step) {
            let (Some(before), Some(at), Some(after)) = (positions[k - 1], positions[k], positions[k + 1]) else {
                continue;
            };
            // Across a cut the motion of the node is unknown.
            if parts[k + 1].time_s - parts[k - 1].time_s > 2.5 * part_s {
                continue;
            }
            let velocity = (after - before) / (2.0 * part_s);
            let acceleration = (after - at * 2.0 + before) / (part_s * part_s);
            let tenth = (k * TENTHS / parts.len()).min(TENTHS - 1);
            places.extend(self.place(&parts[k], tenth, at, velocity, acceleration));
        }
        places
    }

    fn place(
        &self,
        part: &FlightPart,
        tenth: usize,
        at: Vector3<f64>,
        velocity: Vector3<f64>,
        acceleration: Vector3<f64>,
    ) -> Option<Place> {
        let anchors = self.robot.anchors();
        let directions: Option<Vec<_>> = (0..self.cables()).map(|i| anchors.pulley(i).direction(&at).ok()).collect();
        let [lengths_m, wider_m] = [0.0, PROBE_RADIUS_M].map(|more_m| anchors.lengths_with_wider_m(&at, more_m));
        let by_radius = lengths_m.zip_map(&wider_m, |length_m, wider_m| {
            let change_m = wider_m - length_m;
            if change_m.is_finite() { change_m / PROBE_RADIUS_M } else { 0.0 }
        });
        let (weight_n, drag_n) = (self.robot.wrench_n(&acceleration), self.robot.drag_n(&velocity));
        Some(Place { part: *part, tenth, at, weight_n, drag_n, directions: directions?, by_radius })
    }

    /// Residuals and slopes at a point; `None` if the stiffness there is none that a robot can have.
    pub fn linear(&self, at: &DVector<f64>) -> Option<Vec<Linearised>> {
        let with = |more: f64| {
            let stiffness_n = Some(self.stated_n * libm::exp(WIDE * at[STIFFNESS] + more));
            Robot::new(RobotParts { stiffness_n, ..self.parts.clone() }).ok()
        };
        let (robot, stiffer) = (with(0.0)?, with(PROBE_SHARE)?);
        Some(self.places.iter().filter_map(|place| self.linearised(&robot, &stiffer, place, at)).collect())
    }

    fn linearised(&self, robot: &Robot, stiffer: &Robot, place: &Place, at: &DVector<f64>) -> Option<Linearised> {
        let wrench_n = place.weight_n * (1.0 + at[WEIGHT] * self.sigmas[WEIGHT])
            + place.drag_n * (1.0 + at[DRAG] * self.sigmas[DRAG]);
        let here = self.balance(robot, place, at, &wrench_n)?;
        let from = Some(&here.found.position);
        let tensions = |robot: &Robot, lengths_m: &CableVec, wrench_n: &Vector3<f64>| {
            elastic::equilibrium_under(robot, lengths_m, wrench_n, from).ok().map(|found| found.tensions_n)
        };
        let n = self.cables();
        let mut by_tension = vec![CableVec::zeros(n); self.unknowns()];
        let mut by_length = Vec::with_capacity(n);
        for j in 0..n {
            let mut longer = here.lengths_m;
            longer[j] += PROBE_M;
            let change = tensions(robot, &longer, &wrench_n)?.zip_map(&here.tensions_n, |a, b| (a - b) / PROBE_M);
            by_length.push(change);
        }
        for (j, change) in by_length.iter().enumerate() {
            for (unknown, error_m) in self.errors_m(place, j, here.tensions_n[j], robot) {
                by_tension[unknown] = by_tension[unknown].zip_map(change, |sum, slope| sum + slope * error_m);
            }
        }
        // What idlers count depends on the stiffness too.
        let counted = CableVec::from_fn(n, |i| {
            let difference_m = |of: &Robot| self.counted_m(place, i, at, of);
            here.lengths_m[i] + difference_m(stiffer) - difference_m(robot)
        });
        let share = |unknown: usize| PROBE_SHARE / self.sigmas[unknown];
        let more = |force_n: &Vector3<f64>| wrench_n + force_n * PROBE_SHARE;
        let changed = [
            (STIFFNESS, tensions(stiffer, &counted, &wrench_n)?),
            (WEIGHT, tensions(robot, &here.lengths_m, &more(&place.weight_n))?),
            (DRAG, tensions(robot, &here.lengths_m, &more(&place.drag_n))?),
        ];
        for (unknown, there) in changed.iter().filter(|(unknown, _)| self.sigmas[*unknown] > 0.0) {
            by_tension[*unknown] = there.zip_map(&here.tensions_n, |a, b| (a - b) / share(*unknown));
        }
        let used = (0..n).filter(|cable| self.is_used(&place.part, *cable));
        let rows = used.map(|cable| self.row(place, cable, at, here.tensions_n[cable], &by_tension)).collect();
        Some(Linearised { tenth: place.tenth, rows })
    }

    /// The current of a cable.
    fn row(&self, place: &Place, i: usize, at: &DVector<f64>, tension_n: f64, by_tension: &[CableVec]) -> Row {
        let (motor, of) = (self.robot.motor(), COMMON + OF_CABLE * i);
        let value = |unknown: usize| at[of + unknown] * self.sigmas[of + unknown];
        let speed_m_s = place.part.reel_in_m_s[i];
        let sign = speed_m_s.signum();
        let ratio = self.robot.drum(i).radius_ratio(place.part.lengths_m[i]);
        let constant_n_a = self.force_constants_n_a[i] * libm::exp(value(CONSTANT));
        let load_n = (tension_n + self.robot.cable_load(i, &place.at).rise_n) * ratio;
        let gear = motor.gear_friction + value(GEAR);
        let force_n = load_n * (1.0 + gear * sign)
            + (motor.coulomb_n + value(COULOMB)) * sign
            + (motor.viscous_n_s_m + value(VISCOUS)) * speed_m_s
            + value(INERTIA) * place.part.reel_in_m_s2[i];
        let current_a = force_n / constant_n_a;
        let by_load = ratio * (1.0 + gear * sign) / constant_n_a;
        let mut slope = DVector::from_iterator(by_tension.len(), by_tension.iter().map(|change| change[i] * by_load));
        let own = [
            (CONSTANT, -current_a),
            (GEAR, load_n * sign / constant_n_a),
            (COULOMB, sign / constant_n_a),
            (VISCOUS, speed_m_s / constant_n_a),
            (INERTIA, place.part.reel_in_m_s2[i] / constant_n_a),
        ];
        for (unknown, change) in own {
            slope[of + unknown] += change * self.sigmas[of + unknown];
        }
        Row { cable: i, residual_a: place.part.current_a[i] - current_a, slope }
    }

    /// The equilibrium with the errors of the lengths. Some depend on the tensions, which the second pass has.
    fn balance(&self, robot: &Robot, place: &Place, at: &DVector<f64>, wrench_n: &Vector3<f64>) -> Option<Balance> {
        let n = self.cables();
        let mut tensions_n = CableVec::zeros(n);
        let mut last = None;
        for _ in 0..2 {
            let lengths_m = CableVec::from_fn(n, |i| {
                let errors_m = self.errors_m(place, i, tensions_n[i], robot);
                // The poles are those alone whose mean is not 0.
                let mean =
                    |unknown: usize| if unknown == COMMON + OF_CABLE * i + POLE { POLE_MEAN / POLE_SIGMA } else { 0.0 };
                let error_m: f64 =
                    errors_m.iter().map(|(unknown, error_m)| (at[*unknown] + mean(*unknown)) * error_m).sum();
                // The unknown share of `STRETCHED` is among the errors.
                let stated_m = self.counted_m(place, i, &DVector::zeros(COMMON), robot);
                place.part.lengths_m[i] + stated_m + error_m
            });
            let found = elastic::equilibrium_under(robot, &lengths_m, wrench_n, Some(&place.at)).ok()?;
            tensions_n = found.tensions_n;
            last = Some(Balance { found, lengths_m, tensions_n });
        }
        last
    }

    /// Difference of the unstretched length to the stated one, because the idler counted the cable as stretched, m. The
    /// robot corrects it, where its file says so, with its own stiffness.
    fn counted_m(&self, place: &Place, i: usize, at: &DVector<f64>, robot: &Robot) -> f64 {
        let stated = if self.robot.counts_stretched(i) { 1.0 } else { 0.0 };
        let true_share = stated + at[STRETCHED] * self.sigmas[STRETCHED];
        let stiffness_n = robot.stiffness_n().unwrap_or(f64::INFINITY);
        place.part.passed_n_m[i] * (stated / self.stated_n - true_share / stiffness_n)
    }

    /// What one standard deviation of each unknown adds to the unstretched length of a cable, m.
    fn errors_m(&self, place: &Place, i: usize, tension_n: f64, robot: &Robot) -> [(usize, f64); 9] {
        let of = COMMON + OF_CABLE * i;
        let length_m = place.part.lengths_m[i];
        let direction = place.directions[i];
        let stiffness_n = robot.stiffness_n().unwrap_or(f64::INFINITY);
        let level_sq = direction.x * direction.x + direction.y * direction.y;
        let stretch_m = tension_n / stiffness_n * (length_m + self.robot.routed_length_m()[i]);
        [
            (RADIUS, -place.by_radius[i]),
            (STRETCHED, -place.part.passed_n_m[i] / stiffness_n),
            (of + EACH, -stretch_m),
            (of + SCALE, length_m),
            (of + ZERO, 1.0),
            (of + POLE, tension_n * level_sq),
            (of + ANCHOR, -direction.x),
            (of + ANCHOR + 1, -direction.y),
            (of + ANCHOR + 2, -direction.z),
        ]
        .map(|(unknown, error_m)| (unknown, error_m * self.sigmas[unknown]))
    }
}

/// Standard deviation of each unknown.
fn sigmas(parts: &RobotParts, robot: &Robot, constants: &[[f64; 2]]) -> DVector<f64> {
    let (uncertainty, motor, n) = (&parts.uncertainty, robot.motor(), robot.cable_count());
    let mut sigmas = DVector::zeros(COMMON + OF_CABLE * n);
    sigmas[STIFFNESS] = WIDE;
    sigmas[WEIGHT] = uncertainty.node_weight;
    sigmas[DRAG] = DRAG_SHARE;
    sigmas[RADIUS] = uncertainty.pulley_radius_m;
    let states_counting = robot.counts_turns() || (0..n).any(|i| robot.counts_stretched(i));
    sigmas[STRETCHED] = if states_counting { 0.0 } else { 1.0 };
    for (i, [constant_n_a, sigma_n_a]) in constants.iter().enumerate() {
        let of = COMMON + OF_CABLE * i;
        let values = [
            (EACH, crate::loads::EACH_CABLE),
            (SCALE, uncertainty.cable_scale),
            (ZERO, ZERO_M),
            (POLE, POLE_SIGMA * uncertainty.pole_m_n),
            (CONSTANT, sigma_n_a / constant_n_a),
            (GEAR, GEAR_SHARE.hypot(uncertainty.pulley_friction)),
            (COULOMB, FRICTION_SHARE * motor.coulomb_n + FRICTION_N),
            (VISCOUS, FRICTION_SHARE * motor.viscous_n_s_m + FRICTION_N_S_M),
            (INERTIA, INERTIA_KG),
        ];
        for (unknown, sigma) in values {
            sigmas[of + unknown] = sigma;
        }
        // The covariances between anchors are left out: no world of the tests has calibrated anchors.
        for axis in 0..3 {
            let calibrated_m2 =
                parts.anchor_covariance_m2.as_ref().and_then(|rows| rows.get(3 * i + axis)?.get(3 * i + axis));
            let anchor_m = calibrated_m2
                .map_or(uncertainty.anchors_m, |variance_m2| variance_m2.max(0.0).sqrt().hypot(uncertainty.anchors_m));
            sigmas[of + ANCHOR + axis] = if parts.planar && axis == 1 { 0.0 } else { anchor_m };
        }
    }
    sigmas
}
