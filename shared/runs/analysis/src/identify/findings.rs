//! What was identified.

use calibration::flight::FlightStiffness;
use identification::{Identified, Value};

/// What a run says of each cable, and of the node.
pub(crate) struct Findings {
    pub cables: Vec<Result<Identified, String>>,
    pub mass_kg: Option<Value>,
    pub stiffness: FlightStiffness,
    /// Seconds of the run that were used.
    pub used_s: f64,
}
