//! Inputs of the planner.

use messages::{FieldMap, MotorAuthority, NodeEstimate};

/// Inputs of one call of the planner.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Present time, CLOCK_MONOTONIC, ns.
    pub now_ns: u64,
    /// Newest motor/authority.
    pub authority: Option<&'a MotorAuthority>,
    /// Newest node/estimate: [`messages::blended_estimate`].
    pub estimate: Option<&'a NodeEstimate>,
    /// Newest map of the name that [`Planner::wants_map`](crate::Planner::wants_map) returns.
    pub map: Option<&'a FieldMap>,
}
