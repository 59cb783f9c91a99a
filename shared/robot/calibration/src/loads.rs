//! Stiffness of the cables, routed length and weight of the node from a known weight that is hung on the node.
//!
//! * **Sinkings**: with all drums at rest, a weight is hung on the node, and a ruler shows by how much it sinks. The
//!   cables stretch by their tension times (free + routed length) / EA. Sinkings where the cables are short and where
//!   they are long therefore tell EA and routed length apart, if the ruler is good enough for that. Poles yield too:
//!   their compliance is a further unknown.
//! * **Weighings**: the node moves up and down at one speed, without and with the weight. A gear adds friction upwards
//!   and takes it away downwards, so the mean of both currents is that of the tension. By how much it grows with the
//!   known weight gives newtons per ampere, and with them the weight of the node. The winches carry the cables too:
//!   half of each cable, and its weight times its height between its middle and the pulley.
//!
//! What the robot file states is a measurement too, with the standard deviations of [`cable_robot::Uncertainty`]. A
//! result that adds little to it is refused in one sentence: the measurements do not determine it.
//!
//! Linear in small deviations; lengths in m, forces in N, currents in A.

use cable_robot::{Anchors, CableVec, Robot, RobotParts, StructureMatrix, Vector3, elastic};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::error::{CalibrationError, check_sigma, invalid};

/// Share of the stated standard deviation above which a result adds little to the robot file, as for what a
/// calibration sets free.
const REMAINING: f64 = 0.7;

/// Standard deviation of the stiffness of one cable about that of its reel, as a share (docs/truth.md).
pub(crate) const EACH_CABLE: f64 = 0.03;

/// Standard deviation of force constants as stated in data sheets, as a share (docs/truth.md).
pub const FORCE_CONSTANT: f64 = 0.05;

/// Gauss-Newton steps; the problem is nearly linear.
const STEPS: usize = 8;

/// Last step, in standard deviations, below which an unknown is found.
const SETTLED: f64 = 1e-6;

/// Deviation of a measurement from what was found, in its standard deviations, beyond which it is no chance: one in
/// 16,000, of a handful.
const CHANCE: f64 = 4.0;

/// Change of an unknown for the difference quotient, in its standard deviations.
const PROBE: f64 = 0.05;

/// A weight hung on the node while all drums are at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sinking {
    /// Position of the node before, m.
    pub position_m: [f64; 3],
    /// The weight, N.
    pub added_n: f64,
    /// By how much the node sinks, m.
    pub sunk_m: f64,
}

/// Currents while the node moves through a position at one speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighing {
    /// Mean position of the node, m.
    pub position_m: [f64; 3],
    /// The weight that hangs on the node, N; 0 for none.
    pub added_n: f64,
    /// Mean current of each motor upwards and downwards, A; positive where it pulls the cable in.
    pub up_a: CableVec,
    /// The same downwards, A.
    pub down_a: CableVec,
}

/// Measurements with a known weight.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadMeasurements {
    /// Sinkings, perhaps none.
    pub sinkings: Vec<Sinking>,
    /// Standard deviation of a sinking, m: a ruler at a node that swings a little.
    pub sigma_sunk_m: f64,
    /// Weighings, perhaps none; with and without the weight.
    pub weighings: Vec<Weighing>,
    /// Standard deviation of a mean current, A.
    pub sigma_current_a: f64,
    /// Standard deviation of the routed lengths of the robot file, the same error for all, m: a tape along the pole.
    pub sigma_routed_m: f64,
}

impl Default for LoadMeasurements {
    fn default() -> Self {
        Self {
            sinkings: Vec::new(),
            sigma_sunk_m: 0.001,
            weighings: Vec::new(),
            sigma_current_a: 0.01,
            sigma_routed_m: 0.05,
        }
    }
}

/// An estimate, or why there is none.
#[derive(Debug, Clone, PartialEq)]
pub enum Found {
    /// Value and standard deviation.
    Determined {
        /// The value.
        value: f64,
        /// Its standard deviation.
        std: f64,
    },
    /// One sentence: the measurements do not determine it, and what would.
    Undetermined(String),
}

impl Found {
    /// Value and standard deviation, if determined.
    #[must_use]
    pub fn value(&self) -> Option<(f64, f64)> {
        match self {
            Self::Determined { value, std } => Some((*value, *std)),
            Self::Undetermined(_) => None,
        }
    }
}

/// Result of [`loads`].
#[derive(Debug, Clone, PartialEq)]
pub struct Loads {
    /// Stiffness EA, N.
    pub stiffness_n: Found,
    /// Deviation of all routed lengths from those of the robot file, m.
    pub routed_change_m: Found,
    /// Weight of the node, N.
    pub node_weight_n: Found,
}

/// Estimates what the measurements determine.
///
/// # Errors
/// `invalid_argument` for numbers out of range, for places where the node cannot hang, and for a robot file with rigid
/// cables.
pub fn loads(parts: &RobotParts, measured: &LoadMeasurements) -> Result<Loads, CalibrationError> {
    let robot = Robot::new(parts.clone()).map_err(|e| CalibrationError::InvalidArgument(e.to_string()))?;
    check(&robot, measured)?;
    let (stiffness_n, routed_change_m) = stretch(parts, &robot, measured)?;
    Ok(Loads { stiffness_n, routed_change_m, node_weight_n: weight(&robot, measured)? })
}

fn check(robot: &Robot, measured: &LoadMeasurements) -> Result<(), CalibrationError> {
    check_sigma("the standard deviation of a sinking", measured.sigma_sunk_m)?;
    check_sigma("the standard deviation of a mean current", measured.sigma_current_a)?;
    check_sigma("the standard deviation of the routed lengths", measured.sigma_routed_m)?;
    for (k, s) in measured.sinkings.iter().enumerate() {
        if !(s.added_n.is_finite() && s.added_n > 0.0 && s.sunk_m.is_finite() && s.sunk_m > 0.0) {
            let Sinking { added_n, sunk_m, .. } = s;
            return invalid(say!(
                "sinking {} is {sunk_m} m under {added_n} N; give a weight and a sinking above 0",
                k + 1
            ));
        }
    }
    for (k, w) in measured.weighings.iter().enumerate() {
        let currents = w.up_a.iter().chain(w.down_a.iter()).all(|a| a.is_finite());
        let counts = [w.up_a.len(), w.down_a.len()].iter().all(|n| *n == robot.cable_count());
        if !(currents && counts && w.added_n.is_finite() && w.added_n >= 0.0) {
            return invalid(say!(
                "weighing {} needs a weight of 0 N or more and a finite current of each of the {} motors up and down",
                k + 1,
                robot.cable_count()
            ));
        }
    }
    Ok(())
}

/// The unknowns of the stretch, in standard deviations: logarithm of EA, routed length, compliance of the poles.
type Stretch = SVector<f64, 3>;

fn stretch(parts: &RobotParts, robot: &Robot, measured: &LoadMeasurements) -> Result<(Found, Found), CalibrationError> {
    let Some(stated_n) = robot.stiffness_n() else {
        return invalid(say!(
            "the robot file has rigid cables; give stiffness_n in [lines], as the data sheet of the cable has it"
        ));
    };
    let priors = Stretch::new(robot.uncertainty().stiffness, measured.sigma_routed_m, robot.uncertainty().pole_m_n);
    let predict = |x: &Stretch| -> Result<DVector<f64>, CalibrationError> {
        let changed = RobotParts {
            stiffness_n: Some(stated_n * libm::exp(x[0] * priors[0])),
            routed_length_m: Some(robot.routed_length_m().iter().map(|m| (m + x[1] * priors[1]).max(0.0)).collect()),
            ..parts.clone()
        };
        let changed = Robot::new(changed).map_err(|e| CalibrationError::InvalidArgument(e.to_string()))?;
        let sunk = measured.sinkings.iter().enumerate();
        let sunk: Result<Vec<f64>, _> = sunk.map(|(k, s)| sinking_m(&changed, s, x[2] * priors[2], k)).collect();
        Ok(DVector::from_vec(sunk?))
    };
    let read = DVector::from_iterator(measured.sinkings.len(), measured.sinkings.iter().map(|s| s.sunk_m));
    let mut x = Stretch::zeros();
    let mut covariance = SMatrix::<f64, 3, 3>::identity();
    let mut settled = measured.sinkings.is_empty();
    if !settled {
        for _ in 0..STEPS {
            let here = predict(&x)?;
            let slope = slopes(&x, &here, predict)?;
            let per_variance = 1.0 / (measured.sigma_sunk_m * measured.sigma_sunk_m);
            let information = slope.transpose() * &slope * per_variance + DMatrix::identity(3, 3);
            let information = SMatrix::<f64, 3, 3>::from_iterator(information.iter().copied());
            let pull = slope.transpose() * (&read - &here) * per_variance;
            let Some(inverse) = information.try_inverse() else { break };
            let step = inverse * (Stretch::from_iterator(pull.iter().copied()) - x);
            (x, covariance) = (x + step, inverse);
            settled = step.norm() < SETTLED;
            if settled {
                break;
            }
        }
        let here = predict(&x)?;
        let (why, by_chance) = worst_sinking(&read, &here, measured.sigma_sunk_m);
        if !(settled && by_chance) {
            return Ok((Found::Undetermined(why.clone()), Found::Undetermined(why)));
        }
    }
    let remaining = |k: usize| covariance[(k, k)].max(0.0).sqrt();
    let value_n = stated_n * libm::exp(x[0] * priors[0]);
    // The mean of the cables; they differ from their reel.
    let each = EACH_CABLE / (robot.cable_count() as f64).sqrt();
    let share = (remaining(0) * priors[0]).hypot(each);
    let stiffness = if share > REMAINING * priors[0] {
        Found::Undetermined(say!(
            "the sinkings determine the stiffness to {:.0} %, hardly better than the {:.0} % of the robot file; hang a \
             heavier weight, and measure where the cables are long",
            100.0 * share,
            100.0 * priors[0]
        ))
    } else {
        Found::Determined { value: value_n, std: value_n * share }
    };
    let routed = if remaining(1) > REMAINING {
        Found::Undetermined(say!(
            "the sinkings determine the routed lengths to {:.2} m, hardly better than the {:.2} m of a tape; measure \
             them with a tape along the cable from drum to pulley",
            remaining(1) * priors[1],
            priors[1]
        ))
    } else {
        Found::Determined { value: x[1] * priors[1], std: remaining(1) * priors[1] }
    };
    Ok((stiffness, routed))
}

/// By how much each sinking changes with each unknown.
fn slopes(
    x: &Stretch,
    here: &DVector<f64>,
    predict: impl Fn(&Stretch) -> Result<DVector<f64>, CalibrationError>,
) -> Result<DMatrix<f64>, CalibrationError> {
    let mut slope = DMatrix::zeros(here.len(), 3);
    for k in 0..3 {
        let mut probe = *x;
        probe[k] += PROBE;
        slope.set_column(k, &((predict(&probe)? - here) / PROBE));
    }
    Ok(slope)
}

/// The sinking that fits worst, in words, and whether that is chance. `found`: by how much the node would sink.
fn worst_sinking(read: &DVector<f64>, found: &DVector<f64>, sigma_m: f64) -> (String, bool) {
    // The cables differ from their reel, which is none of the unknowns.
    let off = (read - found).zip_map(found, |off, sunk| off / sigma_m.hypot(EACH_CABLE * sunk));
    let worst = off.icamax();
    let words = say!(
        "sinking {} is {:.0} mm, but with the others the node would sink by {:.0} mm there; measure it again, or state \
         the standard deviation of the ruler",
        worst + 1,
        1e3 * read[worst],
        1e3 * found[worst]
    );
    (words, off[worst].abs() <= CHANCE)
}

/// By how much the node of a robot sinks, m.
fn sinking_m(robot: &Robot, sinking: &Sinking, pole_m_n: f64, number: usize) -> Result<f64, CalibrationError> {
    let at = Vector3::from(sinking.position_m);
    let hangs = |why: &dyn std::fmt::Display| {
        CalibrationError::InvalidArgument(say!("the node cannot hang at the place of sinking {}: {why}", number + 1))
    };
    let added = Vector3::new(0.0, 0.0, sinking.added_n);
    let rest = Vector3::zeros();
    let held = elastic::realise(robot, &at, &rest, robot.default_distribution()).map_err(|e| hangs(&e))?;
    let loaded = robot.wrench_n(&rest) + added;
    let found = elastic::equilibrium_under(robot, &held.unstretched_m, &loaded, Some(&at)).map_err(|e| hangs(&e))?;
    let mut down_m = at.z - found.position.z;
    // A pole yields along the level part of its cable, which is then shorter on its way to the node.
    for (i, column) in found.sensitivity.iter().enumerate() {
        let Ok(direction) = robot.anchors().pulley(i).direction(&at) else { continue };
        let level_sq = direction.x * direction.x + direction.y * direction.y;
        down_m -= column.z * pole_m_n * (found.tensions_n[i] - held.tensions_n[i]) * level_sq;
    }
    Ok(down_m)
}

/// Weight of the node: the vertical force of the motors' mean currents is c (W + added + cables) with c near 1.
fn weight(robot: &Robot, measured: &LoadMeasurements) -> Result<Found, CalibrationError> {
    let added: Vec<f64> = measured.weighings.iter().map(|w| w.added_n).collect();
    let (least_n, most_n) = added.iter().fold((f64::INFINITY, 0.0f64), |(a, b), n| (a.min(*n), b.max(*n)));
    if !(most_n > least_n) {
        return Ok(Found::Undetermined(say!(
            "no two weighings have different weights, so nothing determines the weight of the node; move it up and down \
             without and with a known weight"
        )));
    }
    let stated_n = robot.net_weight_n();
    let priors = [FORCE_CONSTANT, robot.uncertainty().node_weight.max(1e-6)];
    // Unknowns in standard deviations: c - 1, and the relative deviation of the weight.
    let (mut x, mut covariance) = (SVector::<f64, 2>::zeros(), SMatrix::<f64, 2, 2>::identity());
    for _ in 0..STEPS {
        let mut information = SMatrix::<f64, 2, 2>::identity();
        let mut pull = -x;
        let (c, weight_n) = (1.0 + x[0] * priors[0], stated_n * (1.0 + x[1] * priors[1]));
        for w in &measured.weighings {
            let (force_n, sigma_n) = vertical_n(robot, w, measured.sigma_current_a)?;
            let held_n = weight_n + w.added_n + cables_n(robot, w)?;
            let slope = SVector::<f64, 2>::new(held_n * priors[0], c * stated_n * priors[1]);
            information += slope * slope.transpose() / (sigma_n * sigma_n);
            pull += slope * (force_n - c * held_n) / (sigma_n * sigma_n);
        }
        let Some(inverse) = information.try_inverse() else { break };
        (x, covariance) = (x + inverse * pull, inverse);
    }
    let (c, weight_n) = (1.0 + x[0] * priors[0], stated_n * (1.0 + x[1] * priors[1]));
    for (k, w) in measured.weighings.iter().enumerate() {
        let (force_n, sigma_n) = vertical_n(robot, w, measured.sigma_current_a)?;
        let held_n = c * (weight_n + w.added_n + cables_n(robot, w)?);
        // The motors differ in their force constants, which are one of the unknowns.
        if (force_n - held_n).abs() > CHANCE * sigma_n.hypot(FORCE_CONSTANT * held_n) {
            return Ok(Found::Undetermined(say!(
                "the currents of weighing {} lift {force_n:.1} N, but with the others it would be {held_n:.1} N; move \
                 the node up and down again with that weight",
                k + 1
            )));
        }
    }
    let remaining = covariance[(1, 1)].max(0.0).sqrt();
    if remaining > REMAINING {
        return Ok(Found::Undetermined(say!(
            "the weighings determine the weight of the node to {:.1} %, hardly better than the {:.1} % of the robot \
             file; hang a heavier weight, or put the node on a scale",
            100.0 * remaining * priors[1],
            100.0 * priors[1]
        )));
    }
    let value = stated_n * (1.0 + x[1] * priors[1]);
    Ok(Found::Determined { value, std: stated_n * remaining * priors[1] })
}

/// Upward force of the mean currents up and down, and its standard deviation, N.
fn vertical_n(robot: &Robot, weighing: &Weighing, sigma_a: f64) -> Result<(f64, f64), CalibrationError> {
    let structure = structure(robot, weighing)?;
    let at = Vector3::from(weighing.position_m);
    let (mut force_n, mut variance_n2) = (0.0, 0.0);
    for (i, column) in structure.iter().enumerate() {
        let ratio = robot.drum(i).radius_ratio(robot.anchors().pulley(i).length_m(&at));
        let constant = robot.motor().force_constant_n_a / ratio;
        force_n += column.z * constant * 0.5 * (weighing.up_a[i] + weighing.down_a[i]);
        variance_n2 += 0.5 * (column.z * constant * sigma_a) * (column.z * constant * sigma_a);
    }
    Ok((force_n, variance_n2.sqrt()))
}

/// Vertical force of the winches that carries the cables themselves, N: the node holds half of each, and at the winch
/// the tension exceeds that in the middle of the cable by its weight times half of its height.
fn cables_n(robot: &Robot, weighing: &Weighing) -> Result<f64, CalibrationError> {
    let at = Vector3::from(weighing.position_m);
    let structure = structure(robot, weighing)?;
    Ok(structure
        .iter()
        .enumerate()
        .map(|(i, column)| {
            let load = robot.cable_load(i, &at);
            load.half_n + column.z * load.rise_n
        })
        .sum())
}

fn structure(robot: &Robot, weighing: &Weighing) -> Result<StructureMatrix, CalibrationError> {
    let anchors: &Anchors = robot.anchors();
    StructureMatrix::at(anchors, &Vector3::from(weighing.position_m))
        .map_err(|e| CalibrationError::InvalidArgument(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::Uncertainty;
    use proptest::prelude::*;

    fn parts() -> RobotParts {
        RobotParts {
            anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.1], [4.7, 8.6, 2.98]],
            node_mass_kg: 1.2,
            tension_limits_n: [1.0, 150.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            stiffness_n: Some(8_000.0),
            routed_length_m: Some(vec![6.0; 3]),
            uncertainty: Uncertainty { stiffness: 0.1, node_weight: 0.03, pole_m_n: 8e-5, ..Uncertainty::default() },
            ..RobotParts::default()
        }
    }

    const PLACES: [[f64; 3]; 4] = [[4.8, 3.0, 0.3], [2.0, 1.0, 0.5], [8.0, 1.0, 0.5], [4.8, 6.5, 0.5]];

    fn sinkings(truth: &RobotParts, added_n: f64) -> Vec<Sinking> {
        let robot = Robot::new(truth.clone()).unwrap();
        let sinking = |position_m| Sinking { position_m, added_n, sunk_m: 0.0 };
        PLACES.map(sinking).map(|s| Sinking { sunk_m: sinking_m(&robot, &s, 0.0, 0).unwrap(), ..s }).to_vec()
    }

    fn weighing(truth: &RobotParts, position_m: [f64; 3], added_n: f64, factor: f64) -> Weighing {
        let robot = Robot::new(truth.clone()).unwrap();
        let force = robot.wrench_n(&Vector3::zeros()) + Vector3::new(0.0, 0.0, added_n);
        let at = Vector3::from(position_m);
        let held_n = elastic::realise_under(&robot, &at, &force, robot.default_distribution()).unwrap().tensions_n;
        let motor = robot.motor();
        let at =
            |v: f64| CableVec::from_fn(3, |i| motor.current_a(held_n[i] + robot.cable_load(i, &at).rise_n, v) / factor);
        Weighing { position_m, added_n, up_a: at(0.1), down_a: at(-0.1) }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        /// Exact readings give back the truth, whatever the friction of the gear.
        #[test]
        fn exact_measurements_give_the_truth(
            stiffness in 0.8..1.25f64, routed_m in -1.0..1.0f64, weight in 0.92..1.08f64, gear in 0.0..0.95f64,
            factor in 0.9..1.1f64, cable_kg_m in 0.0..0.02f64,
        ) {
            let mut truth = parts();
            truth.cable_mass_kg_m = cable_kg_m;
            truth.stiffness_n = truth.stiffness_n.map(|n| n * stiffness);
            truth.routed_length_m = Some(vec![6.0 + routed_m; 3]);
            truth.motor.gear_friction = gear;
            let sunk = sinkings(&truth, 20.0);
            truth.node_mass_kg *= weight;
            let weighings = [0.0, 20.0].map(|added_n| weighing(&truth, PLACES[0], added_n, factor)).to_vec();
            let mut assumed = parts();
            assumed.motor.gear_friction = gear;
            assumed.cable_mass_kg_m = cable_kg_m;
            assumed.uncertainty.pole_m_n = 1e-12;
            let measured = LoadMeasurements {
                sinkings: sunk, sigma_sunk_m: 1e-7, weighings, sigma_current_a: 1e-6, sigma_routed_m: 1.0,
            };
            let found = loads(&assumed, &measured).unwrap();
            let (ea_n, ea_std_n) = found.stiffness_n.value().unwrap();
            prop_assert!((ea_n / 8_000.0 / stiffness - 1.0).abs() < 1e-3 && ea_std_n / ea_n < 0.02, "{found:?}");
            let (change_m, _) = found.routed_change_m.value().unwrap();
            prop_assert!((change_m - routed_m).abs() < 5e-3, "{found:?} {routed_m}");
            let (weight_n, _) = found.node_weight_n.value().unwrap();
            let true_n = Robot::new(truth).unwrap().net_weight_n();
            prop_assert!((weight_n / true_n - 1.0).abs() < 1e-3, "{weight_n} {true_n}");
        }
    }

    #[test]
    fn a_measurement_that_contradicts_the_others_is_named() {
        let truth = parts();
        for slip in [10.0, 0.1] {
            let mut sinkings = sinkings(&truth, 20.0);
            sinkings[1].sunk_m *= slip;
            let found = loads(&parts(), &LoadMeasurements { sinkings, ..LoadMeasurements::default() }).unwrap();
            let Found::Undetermined(why) = found.stiffness_n else { panic!("{found:?}") };
            assert!(why.contains("sinking 2"), "{why}");
        }
        let at = [4.0, 3.0, 1.0];
        let mut weighings =
            vec![weighing(&truth, at, 0.0, 1.0), weighing(&truth, at, 20.0, 1.0), weighing(&truth, at, 20.0, 1.0)];
        weighings[2].up_a.iter_mut().for_each(|current_a| *current_a *= 3.0);
        let found = loads(&parts(), &LoadMeasurements { weighings, ..LoadMeasurements::default() }).unwrap();
        assert!(matches!(&found.node_weight_n, Found::Undetermined(why) if why.contains("weighing")), "{found:?}");
    }

    #[test]
    fn what_the_measurements_do_not_determine_is_refused() {
        let found = loads(&parts(), &LoadMeasurements::default()).unwrap();
        assert_eq!([&found.stiffness_n, &found.routed_change_m, &found.node_weight_n].map(Found::value), [None; 3]);
        // A light weight and a ruler say nothing; a tape is better than any ruler for the routed length.
        let light = LoadMeasurements { sinkings: sinkings(&parts(), 1.0), ..LoadMeasurements::default() };
        let found = loads(&parts(), &light).unwrap();
        assert!(matches!(&found.stiffness_n, Found::Undetermined(why) if why.contains("heavier")), "{found:?}");
        let heavy = LoadMeasurements { sinkings: sinkings(&parts(), 40.0), ..LoadMeasurements::default() };
        let found = loads(&parts(), &heavy).unwrap();
        assert!(found.stiffness_n.value().is_some(), "{found:?}");
        assert!(matches!(&found.routed_change_m, Found::Undetermined(why) if why.contains("tape")), "{found:?}");
        let once = vec![weighing(&parts(), PLACES[0], 10.0, 1.0); 2];
        let found = loads(&parts(), &LoadMeasurements { weighings: once, ..LoadMeasurements::default() }).unwrap();
        assert_eq!(found.node_weight_n.value(), None);
        let bad = LoadMeasurements { sinkings: vec![Sinking { added_n: -1.0, ..heavy.sinkings[0] }], ..heavy };
        assert_eq!(loads(&parts(), &bad).unwrap_err().kind(), "invalid_argument");
    }
}
