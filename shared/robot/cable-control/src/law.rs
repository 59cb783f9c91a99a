//! The control law of section VI-B: optimal feedback to a fixed final state in a fixed time, with a receding horizon.
//!
//! The error e = desired position Δ cycles ahead minus current position obeys e' = e - Ts B u (17). The law minimises Σ
//! eᵀQe + uᵀRu over Δ cycles with e = 0 at their end. Its cost-to-go is infinite at the end, so the recursion uses its
//! inverse W, which is 0 there: M = (W + S)⁻¹, S = Ts² B R⁻¹ Bᵀ; P = Q + M; W = P⁻¹; u = Ts R⁻¹ Bᵀ M e.
//!
//! With Q = 0, M is (Δ S)⁻¹; with as many cables as directions, u = J e / (Δ Ts) for any R.
//!
//! Errors in m, velocities in m/s, the period in s; B is 3 x N, Q 3 x 3, R N x N or a number, the gain K N x 3. Invalid
//! weights, a horizon of 0 and a B of deficient rank are a [`LawError`].
//!
//! For comparison, [`PFeedforward`] is a simple law that controls each cable independently.

mod steps;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use cable_robot::kinematics::NodeJacobian;
use cable_robot::linalg;
use cable_robot::{CableVec, MAX_CABLES};
use steps::{after_horizon, inverse_spd};

/// Longest horizon, cycles: ten seconds at 100 Hz. Bounds the recursion.
pub const MAX_HORIZON: u32 = 1000;

/// Error of a gain that cannot be computed.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum LawError {
    /// A parameter outside its range.
    #[error("{what} is {value}; accepted: {accepted}")]
    InvalidArgument {
        /// Name of the parameter.
        what: &'static str,
        /// Value of the parameter.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
    /// B does not have full rank.
    #[error("the node cannot be moved in every direction from here: it is in the plane of the anchors or at one")]
    Singular,
}

impl LawError {
    /// Error kind for programs: `singular` or `invalid_argument`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Singular => "singular",
            Self::InvalidArgument { .. } => "invalid_argument",
        }
    }
}

/// The weight R of cable velocities; positive definite.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a box would allocate, and there is one of these per controller")]
pub enum InputWeight {
    /// The same for every cable.
    Scalar(f64),
    /// One per cable.
    Diagonal(CableVec),
    /// A symmetric matrix, N x N, row by row.
    Full([[f64; MAX_CABLES]; MAX_CABLES]),
}

/// The feedback gain K, N x 3: u = K e. Of a planar robot, N x 2: the middle column is 0.
///
/// ```
/// use cable_robot::Anchors;
/// use cable_robot::Matrix3;
/// use cable_robot::NodeJacobian;
/// use cable_robot::Vector3;
/// use cable_robot::kinematics::Jacobian;
/// use cable_control::law::{InputWeight, LqGain};
/// let anchors = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.1], [4.0, 8.0, 2.9]])?;
/// let jacobian = Jacobian::at(&anchors, &Vector3::new(4.0, 3.0, 1.0))?;
/// let b = NodeJacobian::at(&anchors, &Vector3::new(4.0, 3.0, 1.0))?;
/// let gain = LqGain::new(&b, 0.01, &Matrix3::zeros(), &InputWeight::Scalar(1.0), 4)?;
/// let error = Vector3::new(0.01, -0.02, 0.005);
/// let (u, expected) = (gain.velocity(&error), jacobian.cable_velocity(&error));
/// assert!((u[0] - expected[0] / (4.0 * 0.01)).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LqGain {
    rows: [Vector3<f64>; MAX_CABLES],
    len: usize,
}

impl LqGain {
    /// Computes the gain for the first of `horizon` (Δ ≥ 1) cycles of `period_s`.
    ///
    /// `state_weight` is Q, symmetric and positive semidefinite; `input_weight` is R.
    pub fn new(
        node_jacobian: &NodeJacobian,
        period_s: f64,
        state_weight: &Matrix3<f64>,
        input_weight: &InputWeight,
        horizon: u32,
    ) -> Result<Self, LawError> {
        let n = node_jacobian.len();
        if !(period_s.is_finite() && period_s > 0.0) {
            return invalid("the period", period_s, "a finite time above 0 s");
        }
        if !(1..=MAX_HORIZON).contains(&horizon) {
            return invalid("the horizon", f64::from(horizon), "1 to 1000 cycles");
        }
        if let Some(value) = state_weight.iter().find(|v| !v.is_finite()) {
            return invalid("an entry of the state weight", *value, "finite numbers");
        }
        if !is_positive_semidefinite(state_weight) {
            return invalid("the smallest pivot of the state weight", -1.0, "a symmetric positive semidefinite matrix");
        }
        // G = R⁻¹ Bᵀ, N x 3.
        let rows = weighted_transpose(node_jacobian, input_weight)?;
        let mut s = node_jacobian.iter().zip(&rows).fold(Matrix3::zeros(), |s, (b, g)| s + linalg::outer(b, g))
            * (period_s * period_s);
        let mut state_weight = *state_weight;
        if node_jacobian.is_planar() {
            // A direction that no cable moves would make S singular. Replace it by an independent one; the y of every
            // row of G is 0, so that it does not contribute to the result.
            s[(1, 1)] = 0.5 * (s[(0, 0)] + s[(2, 2)]);
            for k in [0, 2] {
                (state_weight[(1, k)], state_weight[(k, 1)]) = (0.0, 0.0);
            }
        }
        let m = if state_weight.iter().all(|q| *q == 0.0) {
            // W = 0, S, 2 S, ..
            inverse_spd(&(s * f64::from(horizon)))
        } else {
            after_horizon(&s, &state_weight, horizon)
        };
        let m = m.ok_or(LawError::Singular)?;
        let mut gain = Self { rows: [Vector3::zeros(); MAX_CABLES], len: n };
        for (row, g) in gain.rows.iter_mut().zip(&rows).take(n) {
            // M is symmetric: gᵀM = (M g)ᵀ.
            *row = m * g * period_s;
        }
        Ok(gain)
    }

    /// Cable velocities dL/dt for an error (desired minus actual position, m), m/s.
    pub fn velocity(&self, error_m: &Vector3<f64>) -> CableVec {
        CableVec::from_fn(self.len, |i| self.rows[i].dot(error_m))
    }

    /// Rows of K, one per cable, 1/s.
    pub fn rows(&self) -> &[Vector3<f64>] {
        &self.rows[..self.len]
    }
}

pub use cable_robot::control_bounds::MAX_LENGTH_GAIN;

/// Proportional feedback on lengths with feedforward of the desired velocity: u = dl*/dt + g (l* - l), each
/// cable independently.
///
/// Drives with a delay D and a lag τ are stable below g₀ = w √(1 + τ²w²), where w solves wD + atan(τw) = π/2, and have
/// no overshoot up to about 1 / (3 (D + τ)).
///
/// ```
/// use cable_robot::CableVec;
/// use cable_control::law::PFeedforward;
/// let law = PFeedforward::new(2.0)?;
/// let [speed, desired, actual] = [[0.1, -0.2, 0.0], [5.0, 6.0, 7.0], [4.99, 6.0, 7.01]];
/// let u = law.velocity(&speed, &desired, &actual);
/// assert!((u[0] - 0.12).abs() < 1e-12 && (u[1] + 0.2).abs() < 1e-12 && (u[2] + 0.02).abs() < 1e-12);
/// # Ok::<(), cable_control::law::LawError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PFeedforward {
    gain_per_s: f64,
}

impl PFeedforward {
    /// Builds the law with the gain g, 1/s.
    ///
    /// # Errors
    /// A gain that is not finite, not above 0 or above [`MAX_LENGTH_GAIN`].
    pub fn new(gain_per_s: f64) -> Result<Self, LawError> {
        if !(gain_per_s > 0.0 && gain_per_s <= MAX_LENGTH_GAIN) {
            return invalid("the gain", gain_per_s, "above 0, at most 50 per second");
        }
        Ok(Self { gain_per_s })
    }

    /// g, 1/s.
    pub fn gain_per_s(&self) -> f64 {
        self.gain_per_s
    }

    /// Cable velocities, m/s, from the desired ones, m/s, and the desired and actual lengths, m; as many as
    /// the shortest slice.
    pub fn velocity(&self, desired_m_s: &[f64], desired_m: &[f64], actual_m: &[f64]) -> CableVec {
        let n = desired_m_s.len().min(desired_m.len()).min(actual_m.len());
        CableVec::from_fn(n, |i| desired_m_s[i] + self.gain_per_s * (desired_m[i] - actual_m[i]))
    }
}

fn invalid<T>(what: &'static str, value: f64, accepted: &'static str) -> Result<T, LawError> {
    Err(LawError::InvalidArgument { what, value, accepted })
}

fn is_positive_semidefinite(q: &Matrix3<f64>) -> bool {
    let scale = q.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let symmetric = (0..3).all(|i| (0..i).all(|j| (q[(i, j)] - q[(j, i)]).abs() <= 1e-12 * scale));
    // Positive definite after a shift by more than rounding.
    let shifted = q + Matrix3::identity() * (1e-12 * scale);
    scale == 0.0 || symmetric && linalg::solve_spd(&shifted, &Vector3::zeros()).is_some()
}

/// R⁻¹ Bᵀ: one row per cable.
fn weighted_transpose(b: &NodeJacobian, weight: &InputWeight) -> Result<[Vector3<f64>; MAX_CABLES], LawError> {
    const ACCEPTED: &str = "finite weights above 0; as a matrix symmetric and positive definite";
    let n = b.len();
    let mut rows = [Vector3::zeros(); MAX_CABLES];
    let scalar = |r: f64| if r.is_finite() && r > 0.0 { Ok(r) } else { invalid("the input weight", r, ACCEPTED) };
    match weight {
        InputWeight::Scalar(r) => {
            let r = scalar(*r)?;
            for i in 0..n {
                rows[i] = b[i] / r;
            }
        }
        InputWeight::Diagonal(r) => {
            if r.len() != n {
                return invalid("the number of input weights", r.len() as f64, "one per cable");
            }
            for i in 0..n {
                rows[i] = b[i] / scalar(r[i])?;
            }
        }
        InputWeight::Full(r) => {
            for i in 0..n {
                for j in 0..i {
                    if !((r[i][j] - r[j][i]).abs() <= 1e-12 * (r[i][i].abs() + r[j][j].abs())) {
                        return invalid("the asymmetry of the input weight", r[i][j] - r[j][i], ACCEPTED);
                    }
                }
            }
            // Cholesky, then forward and backward substitution for all three columns together.
            let mut l = [[0.0; MAX_CABLES]; MAX_CABLES];
            for i in 0..n {
                for j in 0..=i {
                    let rest = r[i][j] - linalg::dot(&l[i][..j], &l[j][..j]);
                    l[i][j] = if i == j { scalar(rest)?.sqrt() } else { rest / l[j][j] };
                }
            }
            for i in 0..n {
                let mut v = b[i];
                for (j, row) in rows.iter().enumerate().take(i) {
                    v -= row * l[i][j];
                }
                rows[i] = v / l[i][i];
            }
            for i in (0..n).rev() {
                let mut v = rows[i];
                for j in i + 1..n {
                    v -= rows[j] * l[j][i];
                }
                rows[i] = v / l[i][i];
            }
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::Anchors;
    use cable_robot::kinematics::Jacobian;
    use proptest::prelude::*;

    fn jacobian(four: bool, p: &Vector3<f64>) -> Jacobian {
        let mut anchors = vec![[0.0, 0.0, 3.0], [9.0, 0.0, 3.1], [8.0, 8.0, 2.9]];
        if four {
            anchors.push([0.0, 9.0, 3.2]);
        }
        Jacobian::at(&Anchors::new(&anchors).unwrap(), p).unwrap()
    }

    fn inside() -> impl Strategy<Value = Vector3<f64>> {
        [3.0..6.0f64, 1.0..5.0f64, 0.0..2.0f64].prop_map(Vector3::from)
    }

    /// The finite-horizon problem as one linear system: unknowns u_0..u_{Δ-1} and a multiplier for e_Δ = 0, solved by
    /// Gaussian elimination. Shares no code with the recursion.
    fn brute_force(
        b: &NodeJacobian,
        ts: f64,
        q: &Matrix3<f64>,
        r: &[Vec<f64>],
        delta: usize,
        e0: &Vector3<f64>,
    ) -> Vec<f64> {
        let n = b.len();
        let size = n * delta + 3;
        let mut a = vec![vec![0.0; size + 1]; size];
        // e_k = e0 - Ts B Σ_{j<k} u_j. Cost gradient for u_j: R u_j - Ts Bᵀ Σ_{k>j}^{Δ-1} Q e_k - Ts Bᵀ λ = 0.
        for j in 0..delta {
            for i in 0..n {
                let row = j * n + i;
                for k in 0..n {
                    a[row][j * n + k] += r[i][k];
                }
                for later in j + 1..delta {
                    a[row][size] += ts * b[i].dot(&(q * e0));
                    for earlier in 0..later {
                        for k in 0..n {
                            a[row][earlier * n + k] += ts * ts * b[i].dot(&(q * b[k]));
                        }
                    }
                }
                for k in 0..3 {
                    a[row][n * delta + k] -= ts * b[i][k];
                }
            }
        }
        for k in 0..3 {
            let row = n * delta + k;
            for j in 0..delta {
                for i in 0..n {
                    a[row][j * n + i] = ts * b[i][k];
                }
            }
            a[row][size] = e0[k];
        }
        for c in 0..size {
            let pivot = (c..size).max_by(|x, y| a[*x][c].abs().total_cmp(&a[*y][c].abs())).unwrap();
            a.swap(c, pivot);
            for row in 0..size {
                if row != c {
                    let f = a[row][c] / a[c][c];
                    for k in c..=size {
                        let v = a[c][k];
                        a[row][k] -= f * v;
                    }
                }
            }
        }
        (0..n).map(|i| a[i][size] / a[i][i]).collect()
    }

    /// M step by step.
    fn recursion(s: &Matrix3<f64>, state_weight: &Matrix3<f64>, horizon: u32) -> Option<Matrix3<f64>> {
        let mut m = inverse_spd(s)?;
        for _ in 1..horizon {
            let w = inverse_spd(&(state_weight + m))?;
            m = inverse_spd(&(w + s))?;
        }
        Some(m)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn doubled_steps_end_where_the_recursion_ends(
            four in any::<bool>(), p in inside(), horizon in 1u32..=1000, period_s in 1e-3..0.1f64, r in 0.01..100.0f64,
            q in proptest::array::uniform3(0.0..1000.0f64), small in -12..=0,
        ) {
            let b = jacobian(four, &p).node_jacobian().unwrap();
            let s = b.iter().fold(Matrix3::zeros(), |s, b| s + linalg::outer(b, b)) * (period_s * period_s / r);
            let q = Matrix3::from_diagonal(&Vector3::from(q)) * libm::pow(10.0, f64::from(small));
            let expected = recursion(&s, &q, horizon).unwrap();
            let found = after_horizon(&s, &q, horizon).unwrap();
            prop_assert!((found - expected).norm() <= 1e-9 * expected.norm(), "{found} {expected}");
        }

        #[test]
        fn without_a_state_weight_the_closed_form_is_the_end_of_the_recursion(
            four in any::<bool>(), p in inside(), horizon in 1u32..=200, period_s in 1e-3..0.1f64, r in 0.01..100.0f64,
        ) {
            let b = jacobian(four, &p).node_jacobian().unwrap();
            let zero = Matrix3::zeros();
            let gain = LqGain::new(&b, period_s, &zero, &InputWeight::Scalar(r), horizon).unwrap();
            let s = b.iter().fold(zero, |s, b| s + linalg::outer(b, b)) * (period_s * period_s / r);
            let m = recursion(&s, &zero, horizon).unwrap();
            for (row, b) in gain.rows().iter().zip(b.iter()) {
                let expected = m * b * (period_s / r);
                prop_assert!((row - expected).norm() <= 1e-9 * expected.norm(), "{row} {expected}");
            }
        }

        #[test]
        fn first_input_is_that_of_the_whole_problem(
            four in any::<bool>(), p in inside(), e in inside(), delta in 1u32..7, q in 0.0..50.0f64, qz in 0.0..50.0f64, r in 0.1..5.0f64, rx in -0.3..0.3f64,
        ) {
            let b = jacobian(four, &p).node_jacobian().unwrap();
            let n = b.len();
            let mut weight = Matrix3::identity() * q;
            weight[(2, 2)] = qz;
            let mut full = [[0.0; MAX_CABLES]; MAX_CABLES];
            for i in 0..n {
                for j in 0..n {
                    full[i][j] = if i == j { r * (1.0 + i as f64) } else { rx * r };
                }
            }
            let e = e * 0.01;
            let gain = LqGain::new(&b, 0.1, &weight, &InputWeight::Full(full), delta).unwrap();
            let expected = brute_force(&b, 0.1, &weight, &full.map(|row| row.to_vec()), delta as usize, &e);
            for (u, x) in gain.velocity(&e).iter().zip(&expected) {
                prop_assert!((u - x).abs() < 1e-8 * (1.0 + x.abs()), "{u} {x}");
            }
        }

        #[test]
        fn isotropic_closed_form(p in inside(), e in inside(), delta in 1u32..30, q in 0.01..100.0f64, r in 0.1..5.0f64) {
            // One direction: power iteration on B Bᵀ and its inverse finds the singular vectors of B.
            let ts = 0.05;
            let b = jacobian(false, &p).node_jacobian().unwrap();
            let bbt = b.iter().fold(Matrix3::zeros(), |s, c| s + linalg::outer(c, c));
            let mut u = Vector3::new(0.3, 0.5, 0.8);
            for _ in 0..4000 {
                u = (bbt * u).normalize();
            }
            let s2 = (bbt * u).dot(&u);
            prop_assume!((bbt * u - u * s2).norm() < 1e-10);
            let theta = libm::acosh(1.0 + 0.5 * q * ts * ts * s2 / r);
            let d = f64::from(delta);
            let kappa = 1.0 - libm::sinh((d - 1.0) * theta) / libm::sinh(d * theta);
            let e = u * e.norm() * 0.01;
            let gain = LqGain::new(&b, ts, &(Matrix3::identity() * q), &InputWeight::Scalar(r), delta).unwrap();
            let expected = jacobian(false, &p).cable_velocity(&(e * (kappa / ts)));
            for (a, x) in gain.velocity(&e).iter().zip(expected.iter()) {
                prop_assert!((a - x).abs() < 1e-7 * (1.0 + x.abs()), "{a} {x}");
            }
        }

        #[test]
        fn without_state_weight_it_is_the_error_over_the_horizon(p in inside(), e in inside(), delta in 1u32..200, weights in proptest::collection::vec(0.1..9.0f64, 3)) {
            let j = jacobian(false, &p);
            let b = j.node_jacobian().unwrap();
            let weight = InputWeight::Diagonal(CableVec::from_slice(&weights).unwrap());
            let u = LqGain::new(&b, 0.01, &Matrix3::zeros(), &weight, delta).unwrap().velocity(&e);
            for (a, x) in u.iter().zip(j.cable_velocity(&e).iter()) {
                prop_assert!((a * f64::from(delta) * 0.01 - x).abs() < 1e-9);
            }
        }

        #[test]
        fn repeated_application_to_the_model_ends_at_zero(four in any::<bool>(), p in inside(), delta in 1u32..12, q in 0.0..20.0f64) {
            let b = jacobian(four, &p).node_jacobian().unwrap();
            let mut e = Vector3::new(0.05, -0.02, 0.03);
            for left in (1..=delta).rev() {
                let gain = LqGain::new(&b, 0.1, &(Matrix3::identity() * q), &InputWeight::Scalar(1.0), left).unwrap();
                e -= b.node_velocity(&gain.velocity(&e)) * 0.1;
            }
            prop_assert!(e.norm() < 1e-10, "{e:?}");
        }
    }

    /// One cable whose drive has the delay and the lag of the slowest supported drives, simulated in milliseconds,
    /// with the law every ten: the largest overshoot after a step of the length, and the error after four seconds, as
    /// shares of the step.
    fn step_response(gain_per_s: f64, delay_ms: usize, lag_s: f64) -> (f64, f64) {
        let law = PFeedforward::new(gain_per_s).unwrap();
        let (mut length, mut speed, mut sent) = (0.0, 0.0, vec![0.0; delay_ms + 1]);
        let (mut command, mut overshoot) = (0.0, 0.0f64);
        for ms in 0..4000 {
            if ms % 10 == 0 {
                command = law.velocity(&[0.0], &[1.0], &[length])[0];
            }
            sent.rotate_right(1);
            sent[0] = command;
            speed += 0.001 * (sent[delay_ms] - speed) / lag_s;
            length += 0.001 * speed;
            overshoot = overshoot.max(length - 1.0);
        }
        (overshoot, (1.0 - length).abs())
    }

    #[test]
    fn proportional_feedforward_is_stable_with_slow_drives_up_to_its_documented_bound() {
        let (overshoot, left) = step_response(2.0, 60, 0.100);
        assert!(overshoot < 0.01 && left < 0.01, "{overshoot} {left}");
        let (overshoot, left) = step_response(3.0, 60, 0.100);
        assert!(overshoot < 0.05 && left < 0.01, "{overshoot} {left}");
        // w D + atan(τ w) = π/2, with half a hold cycle added to the delay.
        let (delay, lag) = (0.065, 0.100);
        let (mut low, mut high) = (0.0f64, 1000.0f64);
        for _ in 0..60 {
            let w = 0.5 * (low + high);
            if w * delay + libm::atan(lag * w) < std::f64::consts::FRAC_PI_2 { low = w } else { high = w }
        }
        let bound = low * (1.0 + lag * lag * low * low).sqrt();
        assert!(step_response(0.8 * bound, 60, lag).1 < 0.5, "{bound}");
        assert!(step_response(1.2 * bound, 60, lag).1 > 1.0, "{bound}");
    }

    #[test]
    fn gains_out_of_range_are_refused() {
        for gain in [0.0, -1.0, 51.0, f64::NAN, f64::INFINITY] {
            assert_eq!(PFeedforward::new(gain).unwrap_err().kind(), "invalid_argument");
        }
    }

    #[test]
    fn bad_parameters_are_refused() {
        let b = jacobian(false, &Vector3::new(4.0, 3.0, 1.0)).node_jacobian().unwrap();
        let zero = Matrix3::zeros();
        let one = InputWeight::Scalar(1.0);
        let mut full = [[0.0; MAX_CABLES]; MAX_CABLES];
        full[0][0] = 1.0;
        let few = InputWeight::Diagonal(CableVec::repeat(2, 1.0));
        for result in [
            LqGain::new(&b, 0.0, &zero, &one, 3),
            LqGain::new(&b, f64::NAN, &zero, &one, 3),
            LqGain::new(&b, 0.01, &zero, &one, 0),
            LqGain::new(&b, 0.01, &zero, &InputWeight::Scalar(0.0), 3),
            LqGain::new(&b, 0.01, &zero, &InputWeight::Full(full), 3),
            LqGain::new(&b, 0.01, &zero, &few, 3),
            LqGain::new(&b, 0.01, &(Matrix3::identity() * -1.0), &one, 3),
        ] {
            assert_eq!(result.unwrap_err().kind(), "invalid_argument");
        }
        let flat = NodeJacobian::from_columns(&[Vector3::x(), Vector3::y(), Vector3::x()]);
        assert_eq!(LqGain::new(&flat, 0.01, &zero, &one, 3).unwrap_err(), LawError::Singular);
    }
}
