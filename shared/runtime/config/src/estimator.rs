//! `[estimator]`: the methods of estimation and their parameters.

use crate::section::{above, between};
use cable_robot::control_bounds::MAX_WINDOW;

crate::choice! {
    /// The methods of the program `estimator`.
    pub enum EstimatorMethod {
        /// The paper's motor model.
        Phi = "phi",
        /// A Kalman filter on length and velocity of each cable.
        Kalman = "kalman",
    }
}

crate::section! {
    /// `[estimator]`.
    #[derive(Copy)]
    pub struct EstimatorSection {
        /// Method that computes the lengths: `phi`, the paper's motor model, or `kalman`, a filter on length and
        /// velocity of each cable.
        pub method: EstimatorMethod = EstimatorMethod::Phi,
        /// `phi`: rows of the sliding window of the motor model (18)-(20).
        pub eta: usize = 50 => between(2.0, MAX_WINDOW as f64, "").live(),
        /// `phi`: weight that pulls the motor model towards `prior`, (m/s)².
        pub ridge: f64 = 1e-4 => between(0.0, 1.0, "").live(),
        /// `phi`: `[phi1, phi2]` of a window without excitation.
        #[serde(deserialize_with = "crate::exactly")]
        pub prior: [f64; 2] = [0.6, 0.4] => between(-2.0, 2.0, "").each("two numbers").live(),
        /// Correct for the stretch of the cables (needs `stiffness_n` in the robot file).
        pub stretch: bool = true,
        /// Standard deviation of a measured length, m; for the covariance.
        pub sigma_length_m: f64 = 0.001 => above(0.0, 1.0, "m").live(),
        /// `kalman`: delay and lag of the drives together, s.
        pub drive_lag_s: f64 = 0.07 => between(0.001, 1.0, "s").live(),
        /// `kalman`: standard deviation of the cable acceleration that the drive model does not explain, m/s².
        pub acceleration_sigma_m_s2: f64 = 1.0 => between(0.001, 100.0, "m/s²").live(),
        /// `kalman`: standard deviation of a single reading, m; about one encoder step.
        pub reading_sigma_m: f64 = 1e-4 => between(1e-6, 0.1, "m").live(),
        /// Age, in cycles, up to which controllers, planner and sensors may use an estimate.
        pub ttl_cycles: u32 = 3 => between(1.0, 50.0, ""),
    }
}
