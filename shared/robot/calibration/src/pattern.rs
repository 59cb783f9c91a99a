//! Whether the residuals have a pattern over the workspace that an effect outside the model explains.
//!
//! Small residuals prove little: lengths over pulleys of 40 mm leave residuals of millimetres, because a wrong scale
//! and wrong heights imitate them, and put an anchor 150 mm off. The test therefore asks for the pattern. Each effect
//! has a field, the derivative of every measured length with respect to it. The part of the field that the unknowns
//! cannot imitate is compared with the same part of the residuals: an F test of the extended against the plain model,
//! which takes the scatter from the residuals themselves and not from the stated standard deviations. The level is
//! [`LEVEL`] for all effects together (Bonferroni).
//!
//! An effect is reported only if it also matters: if with it a coordinate of an anchor moves by more than its stated
//! standard deviation.

use nalgebra::{DMatrix, DVector};

use super::fisher;
use super::joint::Loss;
use super::measurements::{Calibration, Measurements, Method};
use super::model::{Cable, Layout, Model, Solution, State};

/// Probability to find a pattern where there is none, for all effects together.
pub const LEVEL: f64 = 0.01;

/// Fields whose own part is below this share of the whole cannot be separated from the unknowns.
const IMITATED: f64 = 1e-6;

/// Least share of the stated standard deviation that is taken for the scatter of lengths: a few may agree by chance.
const LEAST_SCATTER: f64 = 0.2;

/// Usual standard deviation of the zero of a cable, m: where a tape begins, and poles that yield.
const USUAL_OFFSET_M: f64 = 0.005;

/// Usual standard deviation of the scale of each cable, as a share: a check over five metres, good to 2.5 mm.
const USUAL_CABLE_SCALE: f64 = 0.0005;

/// Usual standard deviation of the point where a cable is tied, m: a ring at the node.
const USUAL_ATTACHMENT_M: f64 = 0.005;

/// An effect outside the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// Pulleys of another radius than stated, the same at all anchors.
    PulleyRadius,
    /// A common scale of all lengths.
    Scale,
    /// A zero of each cable.
    Zeros,
    /// A scale of each cable.
    CableScales,
    /// A length of each cable that is wrong with its square.
    Curvature,
    /// Points on a floor that bends.
    Floor,
}

impl Effect {
    const ALL: [Self; 6] =
        [Self::PulleyRadius, Self::Scale, Self::Zeros, Self::CableScales, Self::Curvature, Self::Floor];

    /// Number of columns of its field.
    fn columns(self, cables: usize) -> usize {
        match self {
            Self::PulleyRadius | Self::Scale => 1,
            Self::Zeros | Self::CableScales | Self::Curvature => cables,
            Self::Floor => 3,
        }
    }

    /// True if it is already an unknown.
    fn is_in(self, layout: &Layout) -> bool {
        match self {
            Self::PulleyRadius => layout.radius,
            Self::Scale => layout.scale,
            Self::Zeros => layout.offsets,
            Self::CableScales | Self::Curvature | Self::Floor => false,
        }
    }

    /// Appends the effect on the measured length of cable `i` at the point `at`, m.
    fn append(self, i: usize, at: [f64; 2], cable: &Cable, cables: usize, row: &mut Vec<f64>) {
        let own = |value: f64| (0..cables).map(move |k| if k == i { value } else { 0.0 });
        match self {
            Self::PulleyRadius => row.push(cable.gain * cable.by_radius),
            Self::Scale => row.push(cable.length_m),
            Self::Zeros => row.extend(own(1.0)),
            Self::CableScales => row.extend(own(cable.length_m)),
            Self::Curvature => row.extend(own(cable.length_m * cable.length_m)),
            Self::Floor => {
                let up = cable.gain * cable.direction.z;
                row.extend([at[0] * at[0], at[0] * at[1], at[1] * at[1]].map(|bow| up * bow));
            }
        }
    }
}

/// A pattern that the model does not explain.
#[derive(Debug, Clone, PartialEq)]
pub struct Misfit {
    /// The effect that explains the pattern best.
    pub effect: Effect,
    /// Probability of such a pattern by chance.
    pub probability: f64,
    /// Radius beyond the stated one, m, or scale beyond the estimated one; None for effects of several numbers.
    pub size: Option<f64>,
    /// Standard deviation of `size`.
    pub size_std: Option<f64>,
    /// The coordinate that moves most with the effect, relative to its standard deviation: anchor and axis from 0.
    pub anchor: usize,
    /// Axis of that coordinate: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// How far it moves, m.
    pub shift_m: f64,
}

/// Part of a field that the unknowns cannot imitate, and what it explains.
struct Explained {
    /// Coefficients of the columns.
    coefficients: DVector<f64>,
    /// Reduction of the sum of squares, and its degrees of freedom.
    gain: f64,
    rank: usize,
    /// Norm of the remaining field; for one column.
    norm: f64,
}

/// The test of one calibration.
struct Test<'a> {
    found: &'a Calibration,
    layout: Layout,
    solution: Solution,
    /// Effects with the first of their columns.
    effects: Vec<(Effect, usize)>,
}

impl<'a> Test<'a> {
    /// The test with the scatter of the lengths themselves, where it is below the stated one: what is known beforehand
    /// about other unknowns keeps its own standard deviation, and must not count as surprising beside smaller ones.
    fn with_own_scatter(measured: &'a Measurements, found: &'a Calibration) -> Option<Self> {
        let stated = Self::new(measured, found)?;
        let left = &stated.solution.right_left;
        let ratio = (left.norm_squared() / left.len().max(1) as f64).sqrt();
        let layout = &stated.layout;
        if !(layout.is_extended() || layout.scale || layout.offsets) || !(ratio < 1.0) {
            return Some(stated);
        }
        let ratio = ratio.max(LEAST_SCATTER);
        let sigma_length_m = measured.sigma_length_m * ratio;
        let sigma_floor_m = measured.sigma_floor_m.map(|sigma| sigma * ratio);
        Self::new(&Measurements { sigma_length_m, sigma_floor_m, ..measured.clone() }, found)
    }

    fn new(measured: &Measurements, found: &'a Calibration) -> Option<Self> {
        if found.method == Method::Gps || found.points_m.is_empty() {
            return None;
        }
        let layout = Layout::new(measured, found.method);
        let loss = if found.method == Method::Joint { measured.loss } else { Loss::Squared };
        let model = Model { measured, layout, loss };
        let (mut effects, mut count) = (Vec::new(), 0);
        for effect in Effect::ALL.into_iter().filter(|effect| !effect.is_in(&layout)) {
            effects.push((effect, count));
            count += effect.columns(layout.n);
        }
        let state = State::from_calibration(found);
        let reduced = model.reduce(&state, count, |i, j, cable| {
            let mut row = Vec::with_capacity(count);
            for (effect, _) in &effects {
                effect.append(i, [state.points_m[j][0], state.points_m[j][1]], cable, layout.n, &mut row);
            }
            row
        })?;
        let solution = reduced.solve()?;
        Some(Self { found, layout, solution, effects })
    }

    fn explain(&self, first: usize, columns: usize) -> Explained {
        let left = self.solution.fields_left.columns(first, columns).into_owned();
        let whole = self.solution.by_field.columns(first, columns);
        let norms: Vec<f64> = (0..columns).map(|k| left.column(k).norm() + IMITATED * whole.column(k).norm()).collect();
        let scaled = DMatrix::from_fn(left.nrows(), columns, |a, b| left[(a, b)] / norms[b].max(1e-300));
        // Without redundant measurements nothing is left; and a decomposition of NaN would not end.
        if left.nrows() == 0 || scaled.iter().chain(&self.solution.right_left).any(|v| !v.is_finite()) {
            return Explained { coefficients: DVector::zeros(columns), gain: 0.0, rank: 0, norm: 0.0 };
        }
        let svd = scaled.svd(true, true);
        let largest = svd.singular_values.max();
        let least = (1e-4 * largest).max(IMITATED);
        let rank = svd.singular_values.iter().filter(|s| **s > least).count();
        let coefficients = svd.solve(&self.solution.right_left, least).unwrap_or_else(|_| DVector::zeros(columns));
        let gain = (&left.map_with_location(|_, b, v| v / norms[b].max(1e-300)) * &coefficients).norm_squared();
        let coefficients = DVector::from_fn(columns, |k, _| coefficients[k] / norms[k].max(1e-300));
        Explained { coefficients, gain, rank, norm: if columns == 1 { left.norm() } else { 0.0 } }
    }

    /// Variance of the equations with the effect, and its degrees of freedom.
    fn variance(&self, explained: &Explained) -> Option<(f64, f64)> {
        let freedom = self.solution.right_left.len().checked_sub(explained.rank).filter(|m| *m > 0)? as f64;
        Some(((self.solution.right_left.norm_squared() - explained.gain).max(0.0) / freedom, freedom))
    }

    /// The coordinate that moves most, relative to its standard deviation, if the model has the effect.
    fn movement(&self, first: usize, coefficients: &DVector<f64>) -> (usize, usize, f64, f64) {
        let moved = self.solution.by_field.columns(first, coefficients.len()) * coefficients;
        let stds = self.found.covariance.std_m();
        let mut worst = (0, 2, 0.0, 0.0);
        for (i, std) in stds.iter().enumerate() {
            for (k, std) in std.iter().enumerate() {
                let Some(p) = self.layout.anchor(i, k) else { continue };
                let ratio = moved[p].abs() / std.max(1e-9);
                if ratio > worst.3 {
                    worst = (i, k, moved[p].abs(), ratio);
                }
            }
        }
        worst
    }
}

/// Finds the pattern that the residuals have and the model does not explain; None if there is none, or none that
/// matters, and for the GPS method.
///
/// ```
/// use cable_robot::{CableVec, Vector3, pulley::Pulley};
/// use calibration::{Effect, Measurements, Method, Range, calibrate, misfit};
/// let anchors = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.2], [10.0, 8.0, 2.9f64], [0.0, 8.0, 3.1]];
/// let mut measured = Measurements { sigma_length_m: 0.002, ..Measurements::new(4) };
/// for (from, to) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
///     let (a, b): ([f64; 3], [f64; 3]) = (anchors[from], anchors[to]);
///     measured.ranges.push(Range { from, to, m: (a[0] - b[0]).hypot(a[1] - b[1]), sigma_m: 0.002 });
/// }
/// // Lengths over pulleys of 40 mm, taken for lengths through eyes.
/// let points = [[1.0, 0.8], [9.0, 0.8], [9.0, 7.2], [1.0, 7.2], [5.0, 4.0], [3.0, 2.0]];
/// for (k, [x, y]) in points.into_iter().enumerate() {
///     measured.lengths_m.push(CableVec::from_fn(4, |i| {
///         let pulley = Pulley::new(anchors[i].into(), 0.04);
///         // Errors of 0.1 mm.
///         pulley.length_m(&Vector3::new(x, y, 0.0)) + 1e-4 * f64::from((7 * k as u32 + 3 * i as u32) % 5)
///     }));
/// }
/// let eyes = calibrate(&measured, Method::Joint)?;
/// assert!(misfit(&measured, &eyes).is_some());
/// measured.pulley_radius_m = vec![0.04; 4];
/// let pulleys = calibrate(&measured, Method::Joint)?;
/// assert_eq!(misfit(&measured, &pulleys), None);
/// # Ok::<(), calibration::CalibrationError>(())
/// ```
#[must_use]
pub fn misfit(measured: &Measurements, found: &Calibration) -> Option<Misfit> {
    let test = Test::with_own_scatter(measured, found)?;
    let level = LEVEL / test.effects.len() as f64;
    let mut best: Option<Misfit> = None;
    for (effect, first) in &test.effects {
        let explained = test.explain(*first, effect.columns(test.layout.n));
        let Some((variance, freedom)) = test.variance(&explained).filter(|_| explained.rank > 0) else { continue };
        let f = explained.gain / explained.rank as f64 / variance.max(1e-300);
        let probability = fisher::tail(f, explained.rank as f64, freedom);
        if !(probability < level) || best.as_ref().is_some_and(|best| best.probability <= probability) {
            continue;
        }
        let (anchor, axis, shift_m, ratio) = test.movement(*first, &explained.coefficients);
        if ratio < 1.0 {
            continue;
        }
        let single = explained.coefficients.len() == 1;
        best = Some(Misfit {
            effect: *effect,
            probability,
            size: single.then(|| explained.coefficients[0]),
            size_std: single.then(|| variance.sqrt() / explained.norm),
            anchor,
            axis,
            shift_m,
        });
    }
    best
}

/// Estimates a common deviation of the radii from the stated ones, from the residuals: the deviation and its standard
/// deviation, m. A zero and a scale of each cable, and the place where it is tied, have their usual uncertainty even if
/// these measurements do not state it, because the radius resembles them. None if the residuals say nothing about the
/// radius, or if it is already an unknown.
pub(crate) fn radius_beyond(measured: &Measurements, found: &Calibration) -> Option<(f64, f64)> {
    if found.method == Method::Gps {
        return None;
    }
    let usual = Measurements {
        sigma_offset_m: measured.sigma_offset_m.or(Some(USUAL_OFFSET_M)),
        sigma_cable_scale: measured.sigma_cable_scale.or(Some(USUAL_CABLE_SCALE)),
        sigma_attachment_m: measured.sigma_attachment_m.or(Some(USUAL_ATTACHMENT_M)),
        ..measured.clone()
    };
    let joint = Calibration { method: Method::Joint, ..found.clone() };
    let test = Test::new(&usual, &joint)?;
    let (_, first) = *test.effects.iter().find(|(effect, _)| *effect == Effect::PulleyRadius)?;
    let explained = test.explain(first, 1);
    // The scatter is at least the stated one: few points may agree by chance.
    let variance = test.variance(&explained).map_or(1.0, |(variance, _)| variance.max(1.0));
    let determined = explained.rank > 0 && explained.norm > 0.0;
    determined.then(|| (explained.coefficients[0], variance.sqrt() / explained.norm))
}
