//! The record of a flight, and what is known of the stiffness before it.

use cable_robot::CableVec;

/// Standard deviation of the logarithm of the stiffness before the flight: that of a kind of cable, such as 4000 to
/// 8000 N for braided polyethylene of 0.33 mm.
pub const WIDE: f64 = 0.3;

/// Parts of the flight for the jackknife.
pub(super) const TENTHS: usize = 10;

/// Means over a short time of a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightPart {
    /// Middle of it, s.
    pub time_s: f64,
    /// Lengths by the encoders, m, as if they had been set once only.
    pub lengths_m: CableVec,
    /// Modelled tension times cable that has passed the idlers since the beginning, N m; positive where it was paid
    /// out.
    pub passed_n_m: CableVec,
    /// Speed of reeling in, m/s.
    pub reel_in_m_s: CableVec,
    /// Its change, m/s².
    pub reel_in_m_s2: CableVec,
    /// Motor currents, A; positive where they reel in; NaN: unknown.
    pub current_a: CableVec,
}

/// The record of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// Its parts in order.
    pub parts: Vec<FlightPart>,
    /// Duration of each of them, s.
    pub part_s: f64,
    /// Force constant of each winch and its standard deviation, N/A.
    pub force_constants_n_a: Vec<[f64; 2]>,
}
