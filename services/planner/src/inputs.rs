//! What the planner decides from.

use messages::{FieldMap, MotorAuthority, NodeEstimate};

/// What the planner knows when it is asked something.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Now, CLOCK_MONOTONIC, ns.
    pub now_ns: u64,
    /// Newest motor/authority.
    pub authority: Option<&'a MotorAuthority>,
    /// Newest node/estimate: [`messages::blended_estimate`].
    pub estimate: Option<&'a NodeEstimate>,
    /// Newest map of the name that [`Planner::wants_map`](crate::Planner::wants_map) gives.
    pub map: Option<&'a FieldMap>,
}
