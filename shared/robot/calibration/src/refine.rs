//! Maximum likelihood estimate with the radius of the pulleys, a scale of each cable and its attachment to the node
//! among the unknowns: Gauss-Newton from the estimate without them.

use super::Undetermined;
use super::error::{CalibrationError, undetermined};
use super::measurements::{Calibration, Measurements, Method};
use super::model::{Layout, Model, State, anchor_covariance, length_covariance, residuals_m};
use cable_robot::CableVec;

/// Bound of the iteration, which needs about five steps.
const MAX_ITERATIONS: usize = 60;

/// Largest step of an unknown at the solution, m (of scales: per length).
const SETTLED_M: f64 = 1e-10;

/// Halvings of a step that increases the cost.
const MAX_HALVINGS: usize = 20;

/// Sum of squares of an estimate in standard deviations, and its degrees of freedom.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scatter {
    pub(crate) chi_squared: f64,
    pub(crate) degrees_of_freedom: f64,
}

/// Estimates all unknowns from `start`, the estimate without those that only this model has.
///
/// # Errors
/// `rank_deficient` if the measurements do not determine an unknown.
pub(crate) fn refine(measured: &Measurements, start: Calibration) -> Result<(Calibration, Scatter), CalibrationError> {
    let layout = Layout::new(measured, Method::Joint);
    let model = Model { measured, layout, loss: measured.loss };
    let (mut state, none) = (State::from_calibration(&start), |_: usize, _: usize, _: &_| Vec::new());
    let mut cost = model.cost(&state);
    for _ in 0..MAX_ITERATIONS {
        let Some(reduced) = model.reduce(&state, 0, none) else { return undetermined(Undetermined::Open) };
        let Some(solution) = reduced.solve() else { return undetermined(Undetermined::Open) };
        let points = reduced.point_steps(&solution.step);
        let size = points.iter().flatten().fold(solution.step.amax(), |m, v| m.max(v.abs()));
        let (mut share, mut next) = (1.0, state.stepped(&layout, &solution.step, &points));
        let mut next_cost = model.cost(&next);
        for _ in 0..MAX_HALVINGS {
            // Near the minimum, rounding hides the decrease of the cost.
            if next_cost <= cost || (size < 1e-6 && next_cost.is_finite()) {
                break;
            }
            share *= 0.5;
            let points: Vec<_> = points.iter().map(|c| c.map(|v| share * v)).collect();
            next = state.stepped(&layout, &(&solution.step * share), &points);
            next_cost = model.cost(&next);
        }
        if !next_cost.is_finite() {
            return undetermined(Undetermined::Open);
        }
        (state, cost) = (next, next_cost);
        if size < SETTLED_M {
            break;
        }
    }
    finished(&model, &state, start)
}

/// The calibration at the solution.
fn finished(model: &Model, state: &State, start: Calibration) -> Result<(Calibration, Scatter), CalibrationError> {
    let (layout, measured) = (model.layout, model.measured);
    let reduced = model.reduce(state, 0, |_, _, _| Vec::new());
    let Some((reduced, solution)) = reduced.and_then(|r| r.solve().map(|s| (r, s))) else {
        return undetermined(Undetermined::Open);
    };
    if let Some(i) = state.anchors_m.iter().position(|a| !(a[2] > 0.0)) {
        let squared_height_m2 = -state.anchors_m[i][2] * state.anchors_m[i][2];
        return Err(CalibrationError::NoRealHeight { anchor: i + 1, squared_height_m2 });
    }
    let std = |p: Option<usize>| p.map_or(0.0, |p| solution.covariance[(p, p)].max(0.0).sqrt());
    let unknowns = layout.count() + layout.of_point() * measured.lengths_m.len();
    let radius = |r: &f64| if *r > 0.0 { (r + state.radius_change_m).max(0.0) } else { 0.0 };
    let found = Calibration {
        anchors_m: state.anchors_m.clone(),
        covariance: anchor_covariance(&layout, &solution.covariance),
        lengths: length_covariance(&layout, measured, &solution.covariance),
        points_m: state.points_m.iter().map(|c| [c[0], c[1], 0.0]).collect(),
        residuals_m: residuals_m(model, state),
        scale: state.scale,
        scale_std: std(layout.scale()),
        offsets_m: CableVec::from_fn(layout.n, |i| state.offsets_m[i]),
        offset_std_m: CableVec::from_fn(layout.n, |i| std(layout.offset(i))),
        pulley_radius_m: measured.pulley_radius_m.iter().map(radius).collect(),
        pulley_radius_std_m: std(layout.radius()),
        ..start
    };
    let degrees_of_freedom = reduced.equations as f64 - unknowns as f64;
    Ok((found, Scatter { chi_squared: reduced.chi_squared, degrees_of_freedom }))
}
