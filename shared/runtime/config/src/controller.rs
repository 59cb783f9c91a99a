//! `[controller]`: the control laws and their parameters.

use crate::section::{above, between, switch};
use cable_robot::control_bounds::{MAX_LENGTH_GAIN, MAX_PREVIEW};
use cable_robot::{Distribution, Robot};

crate::choice! {
    /// The control laws of the program `controller`.
    pub enum ControlLaw {
        /// The paper's fixed-endpoint fixed-time law.
        LqEndpoint = "lq-endpoint",
        /// Preview control with a model of the drives' delay and lag; `lq-endpoint` while the model does not fit.
        Preview = "preview",
        /// Per cable: the desired velocity plus a gain times the length error.
        PFeedforward = "p-feedforward",
    }
}

crate::choice! {
    /// Choice of the tensions of a robot with redundant cables.
    pub enum TensionDistribution {
        /// Smallest sum of squares.
        LeastNorm = "least-norm",
        /// Smallest sum.
        MinSum = "min-sum",
        /// Largest distance to both limits.
        Safest = "safest",
    }
}

crate::section! {
    /// `[controller]`.
    pub struct ControllerSection {
        /// `lq-endpoint`: the paper's fixed-endpoint fixed-time law. `preview`: preview control with a model of the
        /// drives' delay and lag; `lq-endpoint` while the model does not fit. `p-feedforward`: per cable, the desired
        /// velocity plus a gain times the length error.
        pub law: ControlLaw = ControlLaw::LqEndpoint,
        /// `lq-endpoint`: horizon Delta, cycles. It is best near 2 (delay + lag) / period + 3, and unstable below a
        /// third of that.
        pub horizon_cycles: usize = 20 => between(1.0, 200.0, "").live(),
        /// `lq-endpoint`: state weight Q, a scalar times identity. Q > 0 leads on ramps; 0 is best.
        pub state_weight: f64 = 0.0 => between(0.0, 1e9, "").live(),
        /// `lq-endpoint`: input weight R, a scalar times identity.
        pub input_weight: f64 = 1.0 => between(1e-9, 1e9, "").live(),
        /// Tension distribution of redundant cables: `least-norm`, `min-sum` or `safest`.
        pub distribution: TensionDistribution = TensionDistribution::LeastNorm,
        /// Time constant of the loop on the redundant length mode of more than three cables, s.
        pub redundant_s: f64 = 0.3 => between(0.05, 60.0, "s").live(),
        /// `p-feedforward`: gain from length error to velocity, 1/s. The node does not overshoot up to about
        /// 1 / (3 (delay + lag)); with drives of 60 ms delay and 100 ms lag the loop is unstable from about 14.
        pub length_gain_per_s: f64 = 3.0 => above(0.0, MAX_LENGTH_GAIN, "per second").live(),
        /// Correct for the stretch of the cables (needs `stiffness_n` in the robot file).
        pub stretch: bool = true,
        /// Distance from the setpoint beyond which the controller gives no output, m. The robot then stops and holds.
        pub error_limit_m: f64 = 0.25 => between(0.01, 5.0, "m").live(),
        /// `preview`: cycles of preview beyond the delay.
        pub preview_cycles: usize = 40 => between(2.0, MAX_PREVIEW as f64, "").live(),
        /// `preview`: cost of a squared acceleration of the command relative to a squared length error, s⁴. The
        /// bandwidth of the feedback is about this value to the power -1/4, in rad/s; the known motion is followed
        /// faster than that.
        pub move_penalty_s4: f64 = 1e-5 => between(1e-9, 1.0, "s⁴").live(),
        /// `preview`: `[delay, lag]` of the drives, s. Without it `lq-endpoint` is used until they are identified.
        #[serde(default, deserialize_with = "crate::exactly_if_given")]
        pub drive_lag_s: Option<[f64; 2]> = None => between(0.0, 0.5, "s").each("two times").live(),
        /// `preview`: identify delay and lag while the robot moves.
        pub identify: bool = true => switch().live(),
        /// `preview`: misfit above which `lq-endpoint` is used; about the relative error of delay plus lag.
        pub misfit_limit: f64 = 0.25 => above(0.0, 1.0, "").live(),
    }
}

impl ControllerSection {
    /// Returns the tension distribution for a robot; without redundant cables the tensions are unique.
    #[must_use]
    pub fn distribution_for(&self, robot: &Robot) -> Distribution {
        match (robot.redundancy(), self.distribution) {
            (0, _) => Distribution::Unique,
            (_, TensionDistribution::LeastNorm) => Distribution::LeastNorm,
            (_, TensionDistribution::MinSum) => Distribution::MinSum,
            (_, TensionDistribution::Safest) => Distribution::Safest,
        }
    }
}
