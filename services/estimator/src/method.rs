//! The standard methods of estimation by name, and custom methods.

use cable_control::length_filter::FilterError;
use config::{EstimatorMethod, EstimatorSection};
use messages::{ControlStatus, NodeEstimate};

use crate::cable_estimator::{CableEstimator, Parameters};
use crate::{kalman, phi};

/// Number of a custom method in `node/estimate`; the same as that of a custom law in `control/status`.
pub const METHOD_OTHER: u8 = ControlStatus::LAW_OTHER;

/// A method of the standard program.
struct StandardMethod {
    /// Name in the configuration.
    name: EstimatorMethod,
    /// Number in `node/estimate`.
    number: u8,
    /// Returns the parameters with those that the method does not use at their defaults.
    used: fn(&Parameters) -> Result<Parameters, FilterError>,
    /// Creates the estimator of a cable without readings.
    cable: fn(&Parameters) -> Box<dyn CableEstimator>,
}

const PHI: StandardMethod =
    StandardMethod { name: EstimatorMethod::Phi, number: NodeEstimate::METHOD_PHI, used: phi::used, cable: phi::cable };
const KALMAN: StandardMethod = StandardMethod {
    name: EstimatorMethod::Kalman,
    number: NodeEstimate::METHOD_KALMAN,
    used: kalman::used,
    cable: kalman::cable,
};

/// Returns the row of a method. A further method needs a file with a [`CableEstimator`], a row above, and its name
/// here.
fn standard(method: EstimatorMethod) -> &'static StandardMethod {
    match method {
        EstimatorMethod::Phi => &PHI,
        EstimatorMethod::Kalman => &KALMAN,
    }
}

fn numbered(number: u8) -> Option<&'static StandardMethod> {
    EstimatorMethod::ALL.iter().map(|method| standard(*method)).find(|standard| standard.number == number)
}

/// A method with its parameters. Two values are equal if they compute the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    number: u8,
    parameters: Parameters,
}

impl Method {
    /// Creates the method of `[estimator]` in a system file.
    ///
    /// # Errors
    /// A parameter is out of range.
    pub fn from_section(section: &EstimatorSection) -> Result<Self, FilterError> {
        let chosen = standard(section.method);
        Ok(Self { number: chosen.number, parameters: (chosen.used)(&section.into())? })
    }

    /// Creates a custom method, which has every parameter of `[estimator]`; the `method` there is not used.
    #[must_use]
    pub fn custom(section: &EstimatorSection) -> Self {
        Self { number: METHOD_OTHER, parameters: section.into() }
    }

    /// Returns a custom method with the same parameters.
    pub(crate) fn to_custom(self) -> Self {
        Self { number: METHOD_OTHER, ..self }
    }

    /// Returns the number in `node/estimate`.
    #[must_use]
    pub fn number(&self) -> u8 {
        self.number
    }

    /// Returns the parameters.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Returns the method with a number in `node/estimate`; `None` for a custom method or an unknown number.
    #[must_use]
    pub fn numbered(number: u8) -> Option<EstimatorMethod> {
        numbered(number).map(|standard| standard.name)
    }

    /// Creates the estimator of a cable without readings; `None` for a custom method.
    pub(crate) fn cable(&self) -> Option<Box<dyn CableEstimator>> {
        numbered(self.number).map(|standard| (standard.cable)(&self.parameters))
    }
}
