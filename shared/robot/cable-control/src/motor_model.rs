//! Response of a winch to its commands, identified in operation (18)-(20): v̂' = φ1 v_desired + φ2 v̂, per cable,
//! over a sliding window.
//!
//! A window at rest or at constant speed contains no information about φ; then the last φ is kept. Encoder steps make
//! plain least squares worse than no model, so the fit is regularised towards a prior (a ridge), and its result is
//! clamped to the physical range of a speed-controlled winch.
//!
//! Velocities in m/s, φ dimensionless, the ridge in (m/s)². Data that do not determine φ are a [`FitError`]; in
//! operation the last φ is kept instead.

use thiserror::Error;

pub use cable_robot::control_bounds::MAX_WINDOW;

/// φ before any identification: commands act immediately, as in the comparison of the paper's Table III.
pub const INITIAL_PHI: [f64; 2] = [1.0, 0.0];

/// Prior of a geared winch at ten cycles per second, from simulated winches with 30 ms delay and 40 ms lag.
pub const PRIOR: [f64; 2] = [0.6, 0.4];

/// Ridge, (m/s)²: large relative to encoder steps of 0.1 mm in a window of ten cycles, small relative to
/// real speed changes.
pub const RIDGE: f64 = 1e-4;

/// Smallest ratio of the eigenvalues of a window that excites φ.
const LEAST_EXCITATION: f64 = 1e-4;

/// Mean square speed below which a window counts as standstill, (m/s)²: 2 mm/s.
const STANDSTILL: f64 = 4e-6;

/// Range of the steady gain φ1 / (1 - φ2): a drive with its own speed loop reaches the commanded speed.
const STEADY_GAIN_RANGE: [f64; 2] = [0.85, 1.15];

/// Range of φ2: above, the model would have a memory of seconds; below 0 it would oscillate.
const PHI2_RANGE: [f64; 2] = [0.0, 0.95];

/// Why a fit is not determined.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum FitError {
    /// Not enough samples.
    #[error("{given} samples were given, and a window of {window} needs {}", window + 2)]
    InsufficientData {
        /// Number of samples given.
        given: usize,
        /// Window η, cycles.
        window: usize,
    },
    /// The speeds do not change enough to distinguish φ1 from φ2.
    #[error(
        "the speeds do not change enough to distinguish the two weights; give a ridge or a run with changes of speed"
    )]
    RankDeficient,
    /// Invalid arguments.
    #[error("{what}; give finite speeds, as many actual as desired, a window of 1 or more and a ridge of 0 or more")]
    InvalidArgument {
        /// Description of the problem.
        what: &'static str,
    },
}

impl FitError {
    /// Error kind for programs: `insufficient_data`, `rank_deficient` or `invalid_argument`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::InsufficientData { .. } => "insufficient_data",
            Self::RankDeficient => "rank_deficient",
            Self::InvalidArgument { .. } => "invalid_argument",
        }
    }
}

/// Sums of the normal equations of (20).
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    dd: f64,
    da: f64,
    aa: f64,
    dy: f64,
    ay: f64,
}

impl Sums {
    /// Adds a row of V̄ (desired speed, previous actual speed) and of Ψ̄ (actual speed).
    fn add(&mut self, desired: f64, before: f64, actual: f64) {
        self.dd += desired * desired;
        self.da += desired * before;
        self.aa += before * before;
        self.dy += desired * actual;
        self.ay += before * actual;
    }

    /// Smaller and larger eigenvalue of V̄ᵀV̄.
    fn eigenvalues(&self) -> (f64, f64) {
        let half = 0.5 * (self.dd + self.aa);
        let difference = 0.5 * (self.dd - self.aa);
        let root = (difference * difference + self.da * self.da).sqrt();
        let larger = half + root;
        // The product is accurate where the difference would cancel.
        let smaller = if larger > 0.0 { ((self.dd * self.aa - self.da * self.da) / larger).max(0.0) } else { 0.0 };
        (smaller, larger)
    }

    fn solve(&self, ridge: f64, prior: [f64; 2]) -> Option<[f64; 2]> {
        let (dd, aa) = (self.dd + ridge, self.aa + ridge);
        let (dy, ay) = (self.dy + ridge * prior[0], self.ay + ridge * prior[1]);
        let det = dd * aa - self.da * self.da;
        let phi = [(aa * dy - self.da * ay) / det, (dd * ay - self.da * dy) / det];
        (det > 1e-13 * dd * aa && phi.iter().all(|v| v.is_finite())).then_some(phi)
    }
}

/// Computes Φ of (20) from the last η + 1 rows of a record: `desired[n]` is the speed commanded for cycle
/// n, `actual[n]` the speed in it, both m/s. A ridge, (m/s)², pulls towards the prior; 0 is the paper's
/// plain least squares.
///
/// ```
/// use cable_control::motor_model::fit;
/// let desired = [0.0, 0.1, 0.2, 0.2, 0.0, -0.1];
/// let mut actual = [0.0; 6];
/// for n in 1..6 {
///     actual[n] = 0.7 * desired[n] + 0.3 * actual[n - 1];
/// }
/// let phi = fit(&desired, &actual, 4, 0.0, [0.0, 0.0])?;
/// assert!((phi[0] - 0.7).abs() < 1e-12 && (phi[1] - 0.3).abs() < 1e-12);
/// # Ok::<(), cable_control::motor_model::FitError>(())
/// ```
pub fn fit(
    desired_m_s: &[f64],
    actual_m_s: &[f64],
    window: usize,
    ridge: f64,
    prior: [f64; 2],
) -> Result<[f64; 2], FitError> {
    let given = desired_m_s.len();
    if given != actual_m_s.len() {
        return Err(FitError::InvalidArgument { what: "there are more speeds of one kind than of the other" });
    }
    if window == 0 {
        return Err(FitError::InvalidArgument { what: "the window is 0" });
    }
    if !(ridge.is_finite() && ridge >= 0.0 && prior.iter().all(|v| v.is_finite())) {
        return Err(FitError::InvalidArgument { what: "ridge or prior is negative or not finite" });
    }
    if !desired_m_s.iter().chain(actual_m_s).all(|v| v.is_finite()) {
        return Err(FitError::InvalidArgument { what: "a speed is not finite" });
    }
    if given < window.saturating_add(2) {
        return Err(FitError::InsufficientData { given, window });
    }
    let mut sums = Sums::default();
    for n in given - window - 1..given {
        sums.add(desired_m_s[n], actual_m_s[n - 1], actual_m_s[n]);
    }
    sums.solve(ridge, prior).ok_or(FitError::RankDeficient)
}

/// Model of one cable's winch.
///
/// ```
/// use cable_control::motor_model::{PRIOR, PhiModel, RIDGE};
/// let mut model = PhiModel::new(10, RIDGE, PRIOR);
/// assert_eq!(model.predict(0.2), 0.2); // before any identification, commands act immediately
/// model.update(0.2, 0.1);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhiModel {
    /// Rows of the window: desired, previous actual, actual.
    rows: [[f64; 3]; MAX_WINDOW + 1],
    capacity: usize,
    count: usize,
    next: usize,
    ridge: f64,
    prior: [f64; 2],
    phi: [f64; 2],
    last_actual: Option<f64>,
    learnt: bool,
}

impl PhiModel {
    /// Builds a model with a window of η + 1 rows (η limited to 1..=[`MAX_WINDOW`]) and a ridge,
    /// (m/s)², towards a prior.
    pub fn new(eta: usize, ridge: f64, prior: [f64; 2]) -> Self {
        Self {
            rows: [[0.0; 3]; MAX_WINDOW + 1],
            capacity: eta.clamp(1, MAX_WINDOW) + 1,
            count: 0,
            next: 0,
            ridge: if ridge.is_finite() { ridge.max(0.0) } else { RIDGE },
            prior,
            phi: INITIAL_PHI,
            last_actual: None,
            learnt: false,
        }
    }

    /// Changes window, ridge and prior: φ is kept until the next fit, and the newest rows that fit into
    /// the window remain.
    pub fn retune(&mut self, eta: usize, ridge: f64, prior: [f64; 2]) {
        let fresh = Self::new(eta, ridge, prior);
        let kept = self.count.min(fresh.capacity);
        let oldest = self.next + self.capacity - kept;
        let mut rows = fresh.rows;
        for (i, row) in rows[..kept].iter_mut().enumerate() {
            *row = self.rows[(oldest + i) % self.capacity];
        }
        *self = Self {
            rows,
            count: kept,
            next: kept % fresh.capacity,
            phi: self.phi,
            last_actual: self.last_actual,
            learnt: self.learnt,
            ..fresh
        };
    }

    /// Adds the speed that was commanded for a cycle and the speed that was measured in it, m/s, and updates φ. A value
    /// that is not finite interrupts the record: the window restarts and φ is kept.
    pub fn update(&mut self, commanded_m_s: f64, actual_m_s: f64) {
        if !(commanded_m_s.is_finite() && actual_m_s.is_finite()) {
            self.forget_window();
            return;
        }
        if let Some(before) = self.last_actual {
            self.rows[self.next] = [commanded_m_s, before, actual_m_s];
            self.next = (self.next + 1) % self.capacity;
            self.count = (self.count + 1).min(self.capacity);
        }
        self.last_actual = Some(actual_m_s);
        if self.count == self.capacity {
            self.refit();
        }
    }

    /// Handles a gap in the record: the window restarts and φ is kept.
    pub fn forget_window(&mut self) {
        (self.count, self.next, self.last_actual) = (0, 0, None);
    }

    /// Predicted speed in the next cycle for a command (18), m/s.
    pub fn predict(&self, commanded_m_s: f64) -> f64 {
        match self.last_actual {
            Some(actual) => self.phi[0] * commanded_m_s + self.phi[1] * actual,
            None => commanded_m_s,
        }
    }

    /// Predicted length at the end of the next cycle, m.
    pub fn predict_length(&self, length_m: f64, commanded_m_s: f64, period_s: f64) -> f64 {
        length_m + self.predict(commanded_m_s) * period_s
    }

    /// [φ1, φ2].
    pub fn phi(&self) -> [f64; 2] {
        self.phi
    }

    /// True once a window has determined φ.
    pub fn is_identified(&self) -> bool {
        self.learnt
    }

    fn refit(&mut self) {
        // Sum over the whole window each time: a running sum would accumulate rounding errors for hours.
        let mut sums = Sums::default();
        for [desired, before, actual] in &self.rows[..self.count] {
            sums.add(*desired, *before, *actual);
        }
        let (smaller, larger) = sums.eigenvalues();
        if larger < STANDSTILL * self.count as f64 || smaller < LEAST_EXCITATION * larger {
            return;
        }
        if let Some(phi) = sums.solve(self.ridge, self.prior) {
            let memory = phi[1].clamp(PHI2_RANGE[0], PHI2_RANGE[1]);
            let direct = phi[0].clamp(STEADY_GAIN_RANGE[0] * (1.0 - memory), STEADY_GAIN_RANGE[1] * (1.0 - memory));
            self.phi = [direct, memory];
            self.learnt = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// After a change of window the model gives the same result as one that had this window from the beginning.
        #[test]
        fn another_window_keeps_the_newest_rows_and_phi(
            // A window at rest contains no information and leaves φ unchanged.
            speeds in proptest::collection::vec((0.05..0.3f64, -0.3..0.3f64), 40..200),
            windows in (2..60usize, 2..60usize),
        ) {
            let (mut changed, mut other) = (PhiModel::new(windows.0, RIDGE, PRIOR), PhiModel::new(windows.1, 0.01, INITIAL_PHI));
            for (command, actual) in &speeds {
                changed.update(*command, *actual);
                other.update(*command, *actual);
            }
            let before = changed.phi();
            changed.retune(windows.1, 0.01, INITIAL_PHI);
            prop_assert_eq!(changed.phi(), before);
            for (command, actual) in speeds.iter().cycle().take(windows.1 + 1) {
                changed.update(*command, *actual);
                other.update(*command, *actual);
            }
            // The rows are in another order, which rounds differently.
            for (is, wanted) in changed.phi().iter().zip(other.phi()) {
                prop_assert!((is - wanted).abs() < 1e-9, "{is} {wanted}");
            }
            prop_assert!((changed.predict(0.1) - other.predict(0.1)).abs() < 1e-9);
        }
    }

    /// An exact winch with first-order lag (18), read through encoder steps.
    fn run(
        model: &mut PhiModel,
        phi: [f64; 2],
        commands: impl Iterator<Item = f64>,
        period: f64,
        step: f64,
    ) -> (f64, f64) {
        let (mut v, mut length, mut seen) = (0.0, 0.0f64, 0.0f64);
        let (mut error, mut naive) = (0.0, 0.0);
        for command in commands {
            let expected = model.predict(command);
            v = phi[0] * command + phi[1] * v;
            length += v * period;
            let now = if step > 0.0 { (length / step).round() * step } else { length };
            let actual = (now - seen) / period;
            seen = now;
            error += (expected - actual).abs();
            naive += (command - actual).abs();
            model.update(command, actual);
        }
        (error, naive)
    }

    fn wave(n: usize) -> impl Iterator<Item = f64> {
        (0..n).map(|i| 0.2 * libm::sin(i as f64 * 0.31) + 0.05 * libm::sin(i as f64 * 1.7))
    }

    proptest! {
        #[test]
        fn a_first_order_winch_is_identified(phi2 in 0.05..0.9f64) {
            let truth = [1.0 - phi2, phi2];
            let mut model = PhiModel::new(10, 1e-9, PRIOR);
            run(&mut model, truth, wave(60), 0.1, 0.0);
            prop_assert!((model.phi()[0] - truth[0]).abs() < 1e-4 && (model.phi()[1] - truth[1]).abs() < 1e-4, "{:?}", model.phi());
        }

        #[test]
        fn a_fit_solves_the_normal_equations(rows in proptest::collection::vec((-0.4..0.4f64, -0.4..0.4f64), 8..20)) {
            let (desired, actual): (Vec<f64>, Vec<f64>) = rows.into_iter().unzip();
            let window = desired.len() - 2;
            let phi = fit(&desired, &actual, window, 0.0, PRIOR);
            prop_assume!(phi.is_ok());
            let phi = phi.unwrap();
            let cost = |p: [f64; 2]| -> f64 { (1..desired.len()).map(|n| { let e = p[0] * desired[n] + p[1] * actual[n - 1] - actual[n]; e * e }).sum() };
            for d in [[1e-4, 0.0], [-1e-4, 0.0], [0.0, 1e-4], [0.0, -1e-4]] {
                prop_assert!(cost(phi) <= cost([phi[0] + d[0], phi[1] + d[1]]) + 1e-15);
            }
        }

        #[test]
        fn phi_stays_in_the_range_of_a_winch(rows in proptest::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 1..200)) {
            let mut model = PhiModel::new(10, RIDGE, PRIOR);
            for (c, a) in rows {
                model.update(c, a);
                let [direct, memory] = model.phi();
                let gain = direct / (1.0 - memory);
                prop_assert!((0.0..=0.95).contains(&memory) && (0.849..=1.151).contains(&gain), "{direct} {memory}");
            }
        }
    }

    #[test]
    fn standstill_and_constant_speed_keep_phi() {
        let mut model = PhiModel::new(10, RIDGE, PRIOR);
        run(&mut model, [0.5, 0.5], std::iter::repeat_n(0.0, 50), 0.1, 1e-4);
        assert_eq!((model.phi(), model.is_identified()), (INITIAL_PHI, false));
        let flat = |speed| std::iter::repeat_n(speed, 200);
        run(&mut model, [0.5, 0.5], wave(60).chain(flat(0.0)), 0.1, 1e-4);
        assert!((model.phi()[1] - 0.5).abs() < 0.15, "{:?}", model.phi());
        run(&mut model, [0.5, 0.5], wave(60).chain(flat(0.2)), 0.1, 1e-4);
        assert!((model.phi()[1] - 0.5).abs() < 0.15, "{:?}", model.phi());
    }

    #[test]
    fn with_coarse_encoder_steps_it_is_better_than_no_model() {
        for (phi2, step) in [(0.3, 1e-4), (0.5, 1e-3), (0.8, 1e-3)] {
            let mut model = PhiModel::new(10, RIDGE, PRIOR);
            let (error, naive) = run(&mut model, [1.0 - phi2, phi2], wave(400), 0.1, step);
            assert!(error < 0.8 * naive, "{phi2} {step}: {error} {naive}");
        }
    }

    #[test]
    fn a_gap_keeps_phi_and_restarts_the_window() {
        let mut model = PhiModel::new(5, RIDGE, PRIOR);
        run(&mut model, [0.5, 0.5], wave(40), 0.1, 0.0);
        let learnt = model.phi();
        model.update(f64::NAN, 0.1);
        assert_eq!((model.phi(), model.predict(0.3)), (learnt, 0.3));
    }

    #[test]
    fn fits_that_are_not_determined_are_refused() {
        let flat = [0.2; 20];
        assert_eq!(fit(&flat, &flat, 10, 0.0, PRIOR).unwrap_err().kind(), "rank_deficient");
        assert!(fit(&flat, &flat, 10, 1e-4, PRIOR).is_ok());
        assert_eq!(fit(&flat[..5], &flat[..5], 10, 0.0, PRIOR).unwrap_err().kind(), "insufficient_data");
        assert_eq!(fit(&flat, &flat[..5], 10, 0.0, PRIOR).unwrap_err().kind(), "invalid_argument");
        assert_eq!(fit(&[f64::NAN; 20], &flat, 10, 0.0, PRIOR).unwrap_err().kind(), "invalid_argument");
        assert_eq!(fit(&flat, &flat, 0, 0.0, PRIOR).unwrap_err().kind(), "invalid_argument");
    }
}
