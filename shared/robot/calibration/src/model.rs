//! All measurements as equations of all unknowns, linear about an estimate, with the tangent geometry of the pulleys.
//!
//! The measured length of cable i at point j is `(k + e_i) L(a_i, c_j + t_i; r_i + q) + o_i`: scale k and deviation e_i
//! of the cable's own, anchor a_i, point c_j of the plane, attachment t_i, radius r_i with a common deviation q, zero
//! o_i. Every row is divided by its standard deviation; what is known beforehand about an unknown is a row too.
//!
//! The x and y of a point, and the height of the floor there, occur only in the rows of that point. A rotation of these
//! rows (QR) confines them to two or three rows, so the others form a small system of the shared unknowns, however many
//! points there are.

use nalgebra::{DMatrix, DVector, Vector3};

use super::covariance::{AnchorCovariance, LengthCovariance, PER_CABLE, RADIUS, SCALE};
use super::joint::Loss;
use super::measurements::{Calibration, Measurements, Method};
use super::survey::free_index;
use cable_robot::CableVec;
use cable_robot::pulley::Pulley;

/// Step of the difference quotient with respect to the radius, m. The length is smooth in the radius over metres.
const RADIUS_STEP_M: f64 = 1e-4;

/// Least share of the standard deviation of a length that is not the floor.
const LEAST_READING: f64 = 0.3;

/// An unknown of the diagonal of R below this share of its column is undetermined.
const DEPENDENT: f64 = 1e-9;

/// Which unknowns there are besides anchors and points.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Layout {
    pub(crate) n: usize,
    pub(crate) scale: bool,
    pub(crate) offsets: bool,
    pub(crate) radius: bool,
    pub(crate) cable_scales: bool,
    pub(crate) attachments: bool,
    /// The floor has a height of its own at each point.
    pub(crate) floor: bool,
}

impl Layout {
    /// The unknowns of these measurements: for the joint method all that have a standard deviation, for others those
    /// that only widen the result.
    pub(crate) fn new(measured: &Measurements, method: Method) -> Self {
        let joint = method == Method::Joint;
        Self {
            n: measured.cable_count,
            scale: joint && measured.sigma_scale.is_some(),
            offsets: joint && measured.sigma_offset_m.is_some(),
            radius: measured.sigma_pulley_radius_m.is_some() && has_pulleys(measured),
            cable_scales: measured.sigma_cable_scale.is_some(),
            attachments: measured.sigma_attachment_m.is_some(),
            floor: measured.sigma_floor_m.is_some(),
        }
    }

    /// True if there are unknowns that only this model has.
    pub(crate) fn is_extended(&self) -> bool {
        self.radius || self.cable_scales || self.attachments || self.floor
    }

    /// Number of unknowns of each point.
    pub(crate) fn of_point(&self) -> usize {
        2 + usize::from(self.floor)
    }

    /// Number of coordinates of anchors, which come first: all but the three that define the frame.
    pub(crate) fn coordinates(&self) -> usize {
        3 * self.n - 3
    }
    pub(crate) fn anchor(&self, anchor: usize, axis: usize) -> Option<usize> {
        if axis == 2 { Some(anchor) } else { free_index(anchor, axis).map(|k| self.n + k) }
    }
    pub(crate) fn scale(&self) -> Option<usize> {
        self.scale.then(|| self.coordinates())
    }
    pub(crate) fn offset(&self, cable: usize) -> Option<usize> {
        self.offsets.then(|| self.coordinates() + usize::from(self.scale) + cable)
    }
    fn before_radius(&self) -> usize {
        self.coordinates() + usize::from(self.scale) + if self.offsets { self.n } else { 0 }
    }
    pub(crate) fn radius(&self) -> Option<usize> {
        self.radius.then(|| self.before_radius())
    }
    pub(crate) fn cable_scale(&self, cable: usize) -> Option<usize> {
        self.cable_scales.then(|| self.before_radius() + usize::from(self.radius) + cable)
    }
    pub(crate) fn attachment(&self, cable: usize, axis: usize) -> Option<usize> {
        let before = self.before_radius() + usize::from(self.radius) + if self.cable_scales { self.n } else { 0 };
        self.attachments.then(|| before + 3 * cable + axis)
    }
    pub(crate) fn count(&self) -> usize {
        let shared = self.before_radius() + usize::from(self.radius);
        shared + self.n * (usize::from(self.cable_scales) + 3 * usize::from(self.attachments))
    }
}

/// True if a cable runs over a pulley.
pub(crate) fn has_pulleys(measured: &Measurements) -> bool {
    measured.pulley_radius_m.iter().any(|r| *r > 0.0)
}

/// Values of all unknowns.
#[derive(Debug, Clone)]
pub(crate) struct State {
    pub(crate) anchors_m: Vec<[f64; 3]>,
    /// The points; z is the height of the floor.
    pub(crate) points_m: Vec<[f64; 3]>,
    pub(crate) scale: f64,
    pub(crate) offsets_m: Vec<f64>,
    pub(crate) radius_change_m: f64,
    pub(crate) cable_scales: Vec<f64>,
    pub(crate) attachments_m: Vec<Vector3<f64>>,
}

impl State {
    /// The estimate of a calibration.
    pub(crate) fn from_calibration(found: &Calibration) -> Self {
        let n = found.anchors_m.len();
        Self {
            anchors_m: found.anchors_m.clone(),
            points_m: found.points_m.iter().map(|p| [p[0], p[1], 0.0]).collect(),
            scale: found.scale,
            offsets_m: found.offsets_m.to_vec(),
            radius_change_m: 0.0,
            cable_scales: vec![0.0; n],
            attachments_m: vec![Vector3::zeros(); n],
        }
    }

    /// The state after a step of the shared unknowns and the points.
    pub(crate) fn stepped(&self, layout: &Layout, shared: &DVector<f64>, points: &[[f64; 3]]) -> Self {
        let mut next = self.clone();
        let add = |value: &mut f64, at: Option<usize>| {
            if let Some(p) = at {
                *value += shared[p];
            }
        };
        for i in 0..layout.n {
            for k in 0..3 {
                add(&mut next.anchors_m[i][k], layout.anchor(i, k));
                add(&mut next.attachments_m[i][k], layout.attachment(i, k));
            }
            add(&mut next.offsets_m[i], layout.offset(i));
            add(&mut next.cable_scales[i], layout.cable_scale(i));
        }
        add(&mut next.scale, layout.scale());
        add(&mut next.radius_change_m, layout.radius());
        for (c, step) in next.points_m.iter_mut().zip(points) {
            *c = [0, 1, 2].map(|k| c[k] + step[k]);
        }
        next
    }
}

/// One modelled length with its derivatives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cable {
    /// As measured: with scale and zero, m.
    pub(crate) measured_m: f64,
    /// True length, m.
    pub(crate) length_m: f64,
    /// Measured divided by true length, without the zero.
    pub(crate) gain: f64,
    /// Derivative of the true length with respect to the position of the node.
    pub(crate) direction: Vector3<f64>,
    /// Derivative of the true length with respect to the radius.
    pub(crate) by_radius: f64,
}

/// Measurements about a state.
#[derive(Clone, Copy)]
pub(crate) struct Model<'a> {
    pub(crate) measured: &'a Measurements,
    pub(crate) layout: Layout,
    pub(crate) loss: Loss,
}

/// The equations of the shared unknowns: `rows x = right`, and what the points need.
pub(crate) struct Reduced {
    /// Equations of the shared unknowns.
    pub(crate) rows: DMatrix<f64>,
    /// Further columns that were given, in the same equations.
    pub(crate) fields: DMatrix<f64>,
    pub(crate) right: DVector<f64>,
    /// For each point: R of its unknowns, and the equations of them.
    points: Vec<PointRows>,
    /// Sum of squares before any step, without lengths that a robust loss has practically excluded; and their number.
    pub(crate) chi_squared: f64,
    pub(crate) equations: usize,
}

struct PointRows {
    r: DMatrix<f64>,
    shared: DMatrix<f64>,
    right: DVector<f64>,
}

/// A length with a lower weight does not count for the scatter of the others.
const LEAST_WEIGHT: f64 = 0.1;

impl Model<'_> {
    /// Computes cable i at point j; None where it has no direction.
    pub(crate) fn cable(&self, state: &State, i: usize, j: usize) -> Option<Cable> {
        let known_m = self.measured.pulley_radius_m.get(i).copied().unwrap_or(0.0);
        let radius_m = if known_m > 0.0 { (known_m + state.radius_change_m).max(0.0) } else { 0.0 };
        let anchor = Vector3::from(state.anchors_m[i]);
        let node = Vector3::from(state.points_m[j]) + state.attachments_m[i];
        let with = |radius_m: f64| Pulley::new(anchor, radius_m);
        let cable = with(radius_m).cable_to(&node).ok()?;
        let back_m = RADIUS_STEP_M.min(radius_m);
        let by_radius = (with(radius_m + RADIUS_STEP_M).length_m(&node) - with(radius_m - back_m).length_m(&node))
            / (RADIUS_STEP_M + back_m);
        let gain = state.scale + state.cable_scales[i];
        Some(Cable {
            measured_m: gain * cable.length_m + state.offsets_m[i],
            length_m: cable.length_m,
            gain,
            direction: cable.direction,
            by_radius,
        })
    }

    /// Standard deviation of a length without that of the floor, if the floor has unknowns of its own, m.
    fn sigma_reading_m(&self) -> f64 {
        let all_m = self.measured.sigma_length_m;
        let floor_m = self.measured.sigma_floor_m.unwrap_or(0.0);
        (all_m * all_m - floor_m * floor_m).max((LEAST_READING * all_m).powi(2)).sqrt()
    }

    /// Half the sum of losses; infinite where a cable has no direction.
    pub(crate) fn cost(&self, state: &State) -> f64 {
        let (mut cost, sigma_m) = (0.0, self.sigma_reading_m());
        for (j, point) in self.measured.lengths_m.iter().enumerate() {
            for (i, l) in point.iter().enumerate() {
                let Some(cable) = self.cable(state, i, j) else { return f64::INFINITY };
                cost += self.loss.evaluate((cable.measured_m - l) / sigma_m).0;
            }
            cost += self.measured.sigma_floor_m.map_or(0.0, |sigma| 0.5 * (state.points_m[j][2] / sigma).powi(2));
        }
        self.for_each_shared_row(state, |right, _| cost += 0.5 * right * right);
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// Calls back with the right-hand side and the derivatives of every row without a point: ranges, heights, and what
    /// is known beforehand.
    fn for_each_shared_row(&self, state: &State, mut each: impl FnMut(f64, &[(usize, f64)])) {
        let layout = &self.layout;
        for r in &self.measured.ranges {
            let (a, b) = (state.anchors_m[r.from], state.anchors_m[r.to]);
            let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
            let d = (dx * dx + dy * dy).sqrt().max(1e-9);
            let (ux, uy) = (dx / d / r.sigma_m, dy / d / r.sigma_m);
            let ends = [(r.from, 0, ux), (r.from, 1, uy), (r.to, 0, -ux), (r.to, 1, -uy)];
            let row: Vec<_> = ends.iter().filter_map(|(i, k, v)| Some((layout.anchor(*i, *k)?, *v))).collect();
            each((r.m - d) / r.sigma_m, &row);
        }
        for h in &self.measured.heights {
            let i = h.anchor;
            let known_m = self.measured.pulley_radius_m.get(i).copied().unwrap_or(0.0);
            let over_wheel_m =
                if known_m > 0.0 { std::f64::consts::PI * (known_m + state.radius_change_m) } else { 0.0 };
            let length_m = state.anchors_m[i][2] + over_wheel_m;
            let mut row = Vec::with_capacity(5);
            let (mut modelled_m, mut gain) = (state.anchors_m[i][2], 1.0);
            if h.by_line {
                gain = state.scale + state.cable_scales[i];
                modelled_m = gain * length_m + state.offsets_m[i];
                let wheel = if known_m > 0.0 { gain * std::f64::consts::PI } else { 0.0 };
                let shared = [
                    (layout.scale(), length_m),
                    (layout.cable_scale(i), length_m),
                    (layout.offset(i), 1.0),
                    (layout.radius(), wheel),
                ];
                row.extend(shared.iter().filter_map(|(p, v)| Some(((*p)?, v / h.sigma_m))));
            }
            row.push((i, gain / h.sigma_m));
            each((h.m - modelled_m) / h.sigma_m, &row);
        }
        let mut prior = |at: Option<usize>, value: f64, sigma: Option<f64>| {
            if let (Some(p), Some(sigma)) = (at, sigma) {
                each(-value / sigma, &[(p, 1.0 / sigma)]);
            }
        };
        prior(layout.scale(), state.scale - 1.0, self.measured.sigma_scale);
        prior(layout.radius(), state.radius_change_m, self.measured.sigma_pulley_radius_m);
        for i in 0..layout.n {
            prior(layout.offset(i), state.offsets_m[i], self.measured.sigma_offset_m);
            prior(layout.cable_scale(i), state.cable_scales[i], self.measured.sigma_cable_scale);
            for k in 0..3 {
                prior(layout.attachment(i, k), state.attachments_m[i][k], self.measured.sigma_attachment_m);
            }
        }
    }

    /// Derivatives of a measured length with respect to the shared unknowns, not yet divided by its standard deviation.
    fn shared_row(&self, i: usize, cable: &Cable, mut each: impl FnMut(usize, f64)) {
        let layout = &self.layout;
        for k in 0..3 {
            let v = cable.gain * cable.direction[k];
            for (at, v) in [(layout.anchor(i, k), -v), (layout.attachment(i, k), v)] {
                if let Some(p) = at {
                    each(p, v);
                }
            }
        }
        let known = self.measured.pulley_radius_m.get(i).is_some_and(|r| *r > 0.0);
        let by_radius = if known { cable.gain * cable.by_radius } else { 0.0 };
        for (at, v) in [
            (layout.scale(), cable.length_m),
            (layout.cable_scale(i), cable.length_m),
            (layout.offset(i), 1.0),
            (layout.radius(), by_radius),
        ] {
            if let Some(p) = at {
                each(p, v);
            }
        }
    }

    /// Linearises about a state and eliminates the points. `field(i, j, cable)` gives further columns as effects on the
    /// measured length of cable i at point j, m. None where a cable has no direction or a point is undetermined.
    pub(crate) fn reduce(
        &self,
        state: &State,
        field_count: usize,
        field: impl Fn(usize, usize, &Cable) -> Vec<f64>,
    ) -> Option<Reduced> {
        let (n, shared) = (self.layout.n, self.layout.count());
        let width = shared + field_count + 1;
        let (mut rows, mut points) = (Vec::new(), Vec::new());
        let (mut chi_squared, mut equations) = (0.0, 0);
        let (sigma_m, unknowns) = (self.sigma_reading_m(), self.layout.of_point());
        for (j, lengths) in self.measured.lengths_m.iter().enumerate() {
            let mut block = DMatrix::zeros(n + unknowns - 2, width);
            let mut own = DMatrix::zeros(n + unknowns - 2, unknowns);
            for (i, l) in lengths.iter().enumerate() {
                let cable = self.cable(state, i, j)?;
                let right = (l - cable.measured_m) / sigma_m;
                let weight = self.loss.evaluate(right).1;
                if weight >= LEAST_WEIGHT {
                    chi_squared += right * right;
                    equations += 1;
                }
                let per = weight.sqrt() / sigma_m;
                self.shared_row(i, &cable, |p, v| block[(i, p)] += per * v);
                for (k, v) in field(i, j, &cable).iter().enumerate() {
                    block[(i, shared + k)] = per * v;
                }
                block[(i, width - 1)] = weight.sqrt() * right;
                for k in 0..unknowns {
                    own[(i, k)] = per * cable.gain * cable.direction[k];
                }
            }
            if let Some(sigma_m) = self.measured.sigma_floor_m {
                let right = -state.points_m[j][2] / sigma_m;
                (own[(n, 2)], block[(n, width - 1)]) = (1.0 / sigma_m, right);
                chi_squared += right * right;
                equations += 1;
            }
            let scale = own.amax();
            let qr = own.qr();
            qr.q_tr_mul(&mut block);
            let r = qr.r();
            if !(0..unknowns).all(|k| r[(k, k)].abs() > DEPENDENT * scale) {
                return None;
            }
            points.push(PointRows {
                r,
                shared: block.view((0, 0), (unknowns, shared)).into_owned(),
                right: block.view((0, width - 1), (unknowns, 1)).column(0).into_owned(),
            });
            rows.extend((unknowns..block.nrows()).map(|k| block.row(k).into_owned()));
        }
        self.for_each_shared_row(state, |right, entries| {
            let mut row = DMatrix::zeros(1, width).row(0).into_owned();
            for (p, v) in entries {
                row[*p] += v;
            }
            row[width - 1] = right;
            chi_squared += right * right;
            equations += 1;
            rows.push(row);
        });
        let all = DMatrix::from_fn(rows.len(), width, |a, b| rows[a][b]);
        Some(Reduced {
            rows: all.columns(0, shared).into_owned(),
            fields: all.columns(shared, field_count).into_owned(),
            right: all.column(width - 1).into_owned(),
            points,
            chi_squared,
            equations,
        })
    }
}

/// Solution of the equations of the shared unknowns.
pub(crate) struct Solution {
    pub(crate) step: DVector<f64>,
    /// Covariance of the shared unknowns.
    pub(crate) covariance: DMatrix<f64>,
    /// What the unknowns leave of the right-hand side and of the fields, in an orthonormal frame of these remainders.
    pub(crate) right_left: DVector<f64>,
    pub(crate) fields_left: DMatrix<f64>,
    /// Change of the unknowns for one unit of each field that the lengths contain and the model does not.
    pub(crate) by_field: DMatrix<f64>,
}

impl Reduced {
    /// Solves by QR with columns scaled to one; None if the equations do not determine an unknown.
    pub(crate) fn solve(&self) -> Option<Solution> {
        let (count, m) = (self.rows.ncols(), self.rows.nrows());
        if m < count {
            return None;
        }
        let norms: Vec<f64> = self.rows.column_iter().map(|c| c.norm()).collect();
        if norms.iter().any(|v| !(*v > 0.0 && v.is_finite())) {
            return None;
        }
        let scaled = DMatrix::from_fn(m, count, |a, b| self.rows[(a, b)] / norms[b]);
        let qr = scaled.qr();
        let (mut right, mut fields) = (self.right.clone(), self.fields.clone());
        qr.q_tr_mul(&mut right);
        qr.q_tr_mul(&mut fields);
        let r = qr.r();
        if (0..count).any(|k| !(r[(k, k)].abs() > DEPENDENT)) {
            return None;
        }
        let mut inverse = r.solve_upper_triangular(&DMatrix::identity(count, count))?;
        for (mut row, norm) in inverse.row_iter_mut().zip(&norms) {
            row /= *norm;
        }
        Some(Solution {
            step: &inverse * right.rows(0, count),
            by_field: &inverse * fields.rows(0, count),
            covariance: &inverse * inverse.transpose(),
            right_left: right.rows(count, m - count).into_owned(),
            fields_left: fields.rows(count, m - count).into_owned(),
        })
    }

    /// Steps of the points for a step of the shared unknowns.
    pub(crate) fn point_steps(&self, shared: &DVector<f64>) -> Vec<[f64; 3]> {
        let step = |point: &PointRows| {
            let solved = point.r.solve_upper_triangular(&(&point.right - &point.shared * shared));
            [0, 1, 2].map(|k| solved.as_ref().and_then(|s| s.get(k)).copied().unwrap_or(0.0))
        };
        self.points.iter().map(step).collect()
    }
}

/// Covariance of all coordinates of the anchors from that of the shared unknowns.
pub(crate) fn anchor_covariance(layout: &Layout, covariance: &DMatrix<f64>) -> AnchorCovariance {
    let at = |k: usize| layout.anchor(k / 3, k % 3);
    AnchorCovariance::new(DMatrix::from_fn(3 * layout.n, 3 * layout.n, |a, b| match (at(a), at(b)) {
        (Some(p), Some(q)) => covariance[(p, q)],
        _ => 0.0,
    }))
}

/// Covariance of what the lengths of the calibrated robot depend on, in the order of [`super::LengthCovariance`], from
/// that of the shared unknowns. None unless ties and scales of cables are among these: without them, it is unknown how
/// they are wrong together with the anchors.
///
/// The robot takes the estimated anchors, scale and radius, and neither the estimated ties nor the scales of the
/// cables: these are known to their stated deviations only. Their estimates are independent of the errors that remain
/// of all others, as for every estimate of this kind, so a tie covaries with them as the error of its estimate does,
/// with the opposite sign.
pub(crate) fn length_covariance(
    layout: &Layout,
    measured: &Measurements,
    covariance: &DMatrix<f64>,
) -> Option<LengthCovariance> {
    let (tie_m, scale) = (measured.sigma_attachment_m?, measured.sigma_cable_scale?);
    let of = |p: Option<usize>, q: Option<usize>| match (p, q) {
        (Some(p), Some(q)) => covariance[(p, q)],
        _ => 0.0,
    };
    let entry = |a: usize, b: usize| {
        let own = if a == b { 1.0 } else { 0.0 };
        // Estimated unknowns, and the one that stays at zero with its sign in the error of this quantity.
        let parts = |k: usize| match (k / PER_CABLE, k % PER_CABLE) {
            (i, SCALE) => (layout.scale(), layout.cable_scale(i), -1.0),
            (_, RADIUS) => (layout.radius(), None, 1.0),
            (i, axis) => (layout.anchor(i, axis), layout.attachment(i, axis), 1.0),
        };
        let ((p, p_zero, p_sign), (q, q_zero, q_sign)) = (parts(a), parts(b));
        let prior = match a % PER_CABLE {
            SCALE => scale * scale,
            RADIUS => 0.0,
            _ => tie_m * tie_m,
        };
        of(p, q) - q_sign * of(p, q_zero) - p_sign * of(p_zero, q) + own * prior
    };
    let size = PER_CABLE * layout.n;
    Some(LengthCovariance::new(DMatrix::from_fn(size, size, entry)))
}

/// Residuals: measured minus modelled length, m.
pub(crate) fn residuals_m(model: &Model, state: &State) -> Vec<CableVec> {
    let residual = |j: usize, i: usize, l: f64| model.cable(state, i, j).map_or(f64::NAN, |c| l - c.measured_m);
    (model.measured.lengths_m.iter().enumerate())
        .map(|(j, l)| CableVec::from_fn(l.len(), |i| residual(j, i, l[i])))
        .collect()
}
