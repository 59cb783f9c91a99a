//! The exact shape of one elastic cable with weight, to compare with the first order of [`crate::sag`].
//!
//! Irvine, *Cable Structures*, 1981, section 1.3: a cable of the unstretched length U, the weight w per unstretched
//! metre and the stiffness EA with the horizontal force H and the vertical force V at its lower end spans
//!
//! * ρ = H U / EA + (H / w) (asinh((V + w U) / H) - asinh(V / H)),
//! * h = U (V + w U / 2) / EA + (√(H² + (V + w U)²) - √(H² + V²)) / w.
//!
//! Lengths in m, forces in N.

/// Bound of the iteration, which needs about five steps from the first order.
const MAX_STEPS: usize = 50;

/// A cable between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Horizontal distance of the ends, m.
    pub level_m: f64,
    /// Height of the upper end above the lower one, m; negative if the first end is the higher one.
    pub rise_m: f64,
    /// Weight per unstretched metre, N/m; above 0.
    pub weight_n_m: f64,
    /// Stiffness EA, N; infinity for a rigid cable.
    pub stiffness_n: f64,
}

/// A cable that hangs in a [`Span`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hanging {
    /// Unstretched length, m.
    pub unstretched_m: f64,
    /// Force with which the cable pulls its lower end up, N; negative if it pulls down.
    pub lift_n: f64,
}

impl Span {
    /// Computes length and lift of the cable whose horizontal force is `pull_n`; None if there is no such cable, or the
    /// iteration does not find it.
    ///
    /// ```
    /// use cable_robot::catenary::Span;
    /// // Level, with a parameter H / w of 20 m: the length is 2 x 20 sinh(10 / 20) m.
    /// let span = Span { level_m: 20.0, rise_m: 0.0, weight_n_m: 0.5, stiffness_n: f64::INFINITY };
    /// let hangs = span.hang(10.0).unwrap();
    /// assert!((hangs.unstretched_m - 40.0 * 0.5_f64.sinh()).abs() < 1e-12);
    /// assert!((hangs.lift_n + 0.25 * hangs.unstretched_m).abs() < 1e-12);
    /// ```
    pub fn hang(&self, pull_n: f64) -> Option<Hanging> {
        let Self { level_m, rise_m, weight_n_m: w, stiffness_n } = *self;
        let chord_m = (level_m * level_m + rise_m * rise_m).sqrt();
        if !(pull_n > 0.0 && w > 0.0 && level_m > 0.0) {
            return None;
        }
        let mut length_m = chord_m / (1.0 + pull_n * chord_m / (level_m * stiffness_n));
        let mut low_n = pull_n * rise_m / level_m - 0.5 * w * chord_m;
        for _ in 0..MAX_STEPS {
            let high_n = low_n + w * length_m;
            let [low, high] = [low_n, high_n].map(|v| (pull_n * pull_n + v * v).sqrt());
            let per_w = pull_n / w;
            let x =
                pull_n * length_m / stiffness_n + per_w * (libm::asinh(high_n / pull_n) - libm::asinh(low_n / pull_n));
            let z = length_m * (low_n + 0.5 * w * length_m) / stiffness_n + (high - low) / w;
            let [off_x, off_z] = [x - level_m, z - rise_m];
            let x_by = [pull_n / stiffness_n + pull_n / high, per_w * (1.0 / high - 1.0 / low)];
            let z_by =
                [high_n / stiffness_n + high_n / high, length_m / stiffness_n + (high_n / high - low_n / low) / w];
            let det = x_by[0] * z_by[1] - x_by[1] * z_by[0];
            let [by_length, by_lift] =
                [(off_x * z_by[1] - off_z * x_by[1]) / det, (off_z * x_by[0] - off_x * z_by[0]) / det];
            (length_m, low_n) = (length_m - by_length, low_n - by_lift);
            if !(by_length.is_finite() && by_lift.is_finite() && length_m > 0.0) {
                return None;
            }
            if by_length.abs() <= 1e-12 * chord_m {
                return Some(Hanging { unstretched_m: length_m, lift_n: low_n });
            }
        }
        None
    }
}
