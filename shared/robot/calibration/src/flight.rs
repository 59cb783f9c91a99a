//! Stiffness of the cables from the record of a flight.
//!
//! A robot with more cables than directions can pull its cables against each other. How far the measured lengths do
//! not fit together as those of rigid cables is their stretch, and the stiffness EA makes tensions of it, which the
//! currents of the winches show while they turn. With as many cables as directions the weight alone determines the
//! tensions, and a flight says nothing.
//!
//! What looks alike is estimated too, each with the standard deviation of [`cable_robot::Uncertainty`], or a wide one
//! where the robot file states none: anchors and points where cables are tied, radius of the pulleys, scale and zero of
//! each length, poles, what idlers count, weight and drag of the node, differences between cables, and force constant,
//! friction and inertia of each winch. The prior of the stiffness is wide ([`WIDE`]), so the robot file has a weight of
//! at most a ninth in a value that is given.
//!
//! The covariance is that of the linearised problem. A jackknife over parts of the flight adds what the model leaves
//! out and the flight shows, and [`MODEL`] what neither knows.

mod model;
mod record;

use cable_robot::{Robot, RobotParts};
use nalgebra::{DMatrix, DVector};

use crate::error::{CalibrationError, invalid};
use crate::loads::Found;
use model::{Model, STIFFNESS};
use record::TENTHS;

pub use record::{Flight, FlightPart, WIDE};

/// Largest standard deviation with which a value is given, as a share.
pub const GIVEN: f64 = 0.1;

/// A value has to be better than the robot file by this factor, as those of [`crate::loads()`].
const BETTER: f64 = 0.7;

/// What the model leaves out, as a share of the stiffness (`tests/tests/lockstep/identify_stiffness.rs`).
pub const MODEL: f64 = 0.03;

/// Time after which residuals of currents are taken for independent, s. In drawn worlds the correlation of those
/// a fifth of a second apart is below 0.2; what changes more slowly is in the jackknife.
const INDEPENDENT_S: f64 = 0.5;

/// Fewest readings of the current of each moving cable.
const LEAST_READINGS: usize = 40;

/// Most instants that are used; more of the same flight say the same.
const MOST_PARTS: usize = 300;

/// Rounds in which the noise of the currents is estimated again, and steps in each.
const ROUNDS: usize = 4;
const STEPS: usize = 6;

/// Noise of a current before anything is known of it, and the least one, A.
const FIRST_A: f64 = 0.1;
const LEAST_A: f64 = 0.003;

/// What a flight says of the stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightStiffness {
    /// Stiffness EA, N, the mean of the cables; or why there is none.
    pub stiffness_n: Found,
    /// The standard deviation that the flight leaves, as a share of the stiffness; [`WIDE`] is that before it.
    pub left: f64,
    /// The estimate, N, whether or not it is given: for studies.
    pub estimate_n: f64,
}

/// Estimates the stiffness, as far as the flight determines it.
///
/// # Errors
/// `invalid_argument` for a robot file with rigid cables or of other cables than the flight.
pub fn flight_stiffness(parts: &RobotParts, flight: &Flight) -> Result<FlightStiffness, CalibrationError> {
    let robot = Robot::new(parts.clone()).map_err(|e| CalibrationError::InvalidArgument(e.to_string()))?;
    let Some(stated_n) = robot.stiffness_n() else {
        return invalid(
            "the robot file has rigid cables; give stiffness_n in [lines], as the data sheet of the cable has it"
                .to_owned(),
        );
    };
    let cables = robot.cable_count();
    if flight.force_constants_n_a.len() != cables || flight.parts.iter().any(|part| part.lengths_m.len() != cables) {
        return invalid(format!(
            "the flight is not one of a robot with {cables} cables; take the robot file of the run"
        ));
    }
    let without =
        |why: String| FlightStiffness { stiffness_n: Found::Undetermined(why), left: WIDE, estimate_n: stated_n };
    if robot.redundancy() == 0 {
        return Ok(without(format!(
            "this run does not tell: {cables} cables carry the node with the same tensions whatever their stiffness; \
             `nims loads` measures it with a known weight"
        )));
    }
    let model = Model::new(parts, robot, flight, MOST_PARTS);
    let readings = model.readings();
    if let Some(cable) = (0..cables).find(|cable| readings[*cable] < LEAST_READINGS) {
        return Ok(without(format!(
            "this run does not tell: cable {} moves too little, or its current was not recorded; fly a mission that \
             moves every cable, or measure it with a known weight (`nims loads`)",
            cable + 1
        )));
    }
    let Some(fit) = fit(&model, (INDEPENDENT_S / flight.part_s).max(1.0)) else {
        return Ok(without(
            "this run does not tell: its lengths and currents do not fit together; measure it with a known weight \
             (`nims loads`)"
                .to_owned(),
        ));
    };
    Ok(judge(stated_n, parts.uncertainty.stiffness, &fit))
}

/// Gives the value, if the flight narrows it.
fn judge(stated_n: f64, stated_share: f64, fit: &Fit) -> FlightStiffness {
    let estimate_n = stated_n * libm::exp(WIDE * fit.at);
    let left = (WIDE * fit.posterior).hypot(WIDE * fit.jackknife).hypot(MODEL);
    // A robot file without a standard deviation is exact by its own statement, but EA is never measured exactly.
    let needed = if stated_share > 0.0 { GIVEN.min(BETTER * stated_share) } else { GIVEN };
    let stiffness_n = if left <= needed {
        Found::Determined { value: estimate_n, std: estimate_n * left }
    } else {
        Found::Undetermined(format!(
            "this run leaves it uncertain by {:.0} %, and {:.0} % are needed; other pretensions at the same places \
             tell more (jog one cable in by 2 cm, zero there again, fly the same mission once more, and the same after \
             a jog of 4 cm out, all in one run), as does a known weight (`nims loads`)",
            100.0 * left,
            100.0 * needed
        ))
    };
    FlightStiffness { stiffness_n, left, estimate_n }
}

/// The logarithm of the stiffness in units of [`WIDE`], and its standard deviations.
struct Fit {
    at: f64,
    posterior: f64,
    jackknife: f64,
}

/// Normal equations of each tenth of the flight at a point, without the prior.
struct Normal {
    tenths: Vec<(DMatrix<f64>, DVector<f64>)>,
    /// Sum of the squared residuals in their standard deviations.
    cost: f64,
    /// Root mean square of the residuals of each cable, A.
    rms_a: Vec<f64>,
}

impl Normal {
    /// `noise_a`: standard deviation of each cable's current, of which only one in `alike` is independent.
    fn at(model: &Model, at: &DVector<f64>, noise_a: &[f64], alike: f64) -> Option<Self> {
        let unknowns = model.unknowns();
        let empty = || (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        let mut tenths: Vec<_> = (0..TENTHS).map(|_| empty()).collect();
        let linear = model.linear(at)?;
        let (mut cost, mut squares, mut counts) = (0.0, vec![0.0; noise_a.len()], vec![0.0; noise_a.len()]);
        for instant in &linear {
            let (matrix, vector) = &mut tenths[instant.tenth];
            for row in &instant.rows {
                let weight = 1.0 / (noise_a[row.cable] * noise_a[row.cable] * alike);
                cost += weight * row.residual_a * row.residual_a;
                squares[row.cable] += row.residual_a * row.residual_a;
                counts[row.cable] += 1.0;
                matrix.ger(weight, &row.slope, &row.slope, 1.0);
                vector.axpy(weight * row.residual_a, &row.slope, 1.0);
            }
        }
        let rms_a = squares.iter().zip(&counts).map(|(sum, count)| (sum / f64::max(*count, 1.0)).sqrt()).collect();
        Some(Self { tenths, cost, rms_a })
    }

    /// The step to the minimum of the linearised problem, and the covariance there.
    fn step(&self, at: &DVector<f64>, without: Option<usize>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut matrix = DMatrix::identity(at.len(), at.len());
        let mut vector = -at;
        for (tenth, (information, pull)) in self.tenths.iter().enumerate() {
            if Some(tenth) != without {
                matrix += information;
                vector += pull;
            }
        }
        let covariance = matrix.cholesky()?.inverse();
        Some((&covariance * vector, covariance))
    }
}

fn fit(model: &Model, alike: f64) -> Option<Fit> {
    let mut at = DVector::zeros(model.unknowns());
    let mut noise_a = vec![FIRST_A; model.cables()];
    for _ in 0..ROUNDS {
        let mut here = Normal::at(model, &at, &noise_a, alike)?;
        for _ in 0..STEPS {
            let (step, _) = here.step(&at, None)?;
            let total = |normal: &Normal, at: &DVector<f64>| normal.cost + at.norm_squared();
            let before = total(&here, &at);
            // Where a cable becomes slack the problem has a kink, which a shorter step does not cross.
            let shorter = [1.0, 0.5, 0.25, 0.125].into_iter().find_map(|share| {
                let to = &at + &step * share;
                let there = Normal::at(model, &to, &noise_a, alike)?;
                (total(&there, &to) < before).then_some((to, there))
            });
            let Some((to, there)) = shorter else { break };
            let moved = (&to - &at).amax();
            (at, here) = (to, there);
            if moved < 1e-3 {
                break;
            }
        }
        noise_a = here.rms_a.iter().map(|rms_a| rms_a.max(LEAST_A)).collect();
    }
    let last = Normal::at(model, &at, &noise_a, alike)?;
    let (_, covariance) = last.step(&at, None)?;
    let mut left_out = [0.0; TENTHS];
    for (tenth, value) in left_out.iter_mut().enumerate() {
        *value = last.step(&at, Some(tenth))?.0[STIFFNESS];
    }
    let mean = left_out.iter().sum::<f64>() / TENTHS as f64;
    let squares = left_out.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>();
    // Efron 1982, (3.10).
    let jackknife = ((TENTHS - 1) as f64 / TENTHS as f64 * squares).sqrt();
    let posterior = covariance[(STIFFNESS, STIFFNESS)].max(0.0).sqrt();
    let found = Fit { at: at[STIFFNESS], posterior, jackknife };
    [found.at, found.posterior, found.jackknife].iter().all(|number| number.is_finite()).then_some(found)
}
