//! `[arbiter]`: qualification of standby controllers and estimators, and swaps.

use crate::section::between;

crate::section! {
    /// `[arbiter]`.
    pub struct ArbiterSection {
        /// Time for which a second controller or estimator must publish good output to qualify as standby, s.
        pub qualify_s: f64 = 1.0 => between(0.1, 60.0, "s"),
        /// Largest deviation of a standby's command from that of the controller in charge, as a fraction of the robot's
        /// `cable_speed_limit_m_s`.
        pub command_bound: f64 = 0.15 => between(0.001, 1.0, ""),
        /// Largest mean deviation of a standby's command, as a fraction of the command; at least `bias_bound_m_s` is
        /// allowed.
        pub bias_share: f64 = 0.25 => between(0.001, 1.0, ""),
        /// Mean deviation that is always allowed, m/s; see `bias_share`.
        pub bias_bound_m_s: f64 = 0.05 => between(0.001, 10.0, "m/s"),
        /// Largest deviation of a standby's estimate from that of the estimator in charge, m.
        pub estimate_bound_m: f64 = 0.02 => between(1e-4, 1.0, "m"),
        /// Time from the announcement of a swap to the cycle in which it takes effect, s.
        pub announce_s: f64 = 0.1 => between(0.0, 10.0, "s"),
        /// Time in which one command fades into another, s.
        pub fade_s: f64 = 0.25 => between(0.0, 10.0, "s"),
        /// Time after a swap during which one missed cycle reverts it, s; cycles missed for lack of CPU time do not
        /// count.
        pub probation_s: f64 = 1.0 => between(0.0, 60.0, "s"),
        /// Number of failures after which a standby is quarantined until it is admitted again.
        pub quarantine_falls: u8 = 3 => between(1.0, 100.0, ""),
        /// Time of good output after which the count of failures is reset, s.
        pub forgive_s: f64 = 10.0 => between(0.1, 3600.0, "s"),
    }
}
