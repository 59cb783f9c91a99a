//! The standard methods of estimation by name, and custom methods.

use cable_control::length_filter::FilterError;
use config::{EstimatorMethod, EstimatorSection};
use messages::ControlStatus;

use crate::cable_estimator::{CableEstimator, Parameters};

mod kalman;
mod phi;

/// Number of a custom method in `node/estimate`; the same as that of a custom law in `control/status`.
pub const METHOD_OTHER: u8 = ControlStatus::LAW_OTHER;

/// A method of the standard program.
struct StandardMethod {
    /// Returns the parameters with those that the method does not use at their defaults.
    used: fn(&Parameters) -> Result<Parameters, FilterError>,
    /// Creates the estimator of a cable without readings.
    cable: fn(&Parameters) -> Box<dyn CableEstimator>,
}

/// Returns the row of a method. A further method needs a file with a [`CableEstimator`], its name and parameters in
/// `[estimator]`, and a row here.
fn standard(method: EstimatorMethod) -> StandardMethod {
    match method {
        EstimatorMethod::Phi => StandardMethod { used: phi::used, cable: phi::cable },
        EstimatorMethod::Kalman => StandardMethod { used: kalman::used, cable: kalman::cable },
    }
}

/// Returns the number of a standard method in `node/estimate`: its place among the names, from 1.
fn number_of(method: EstimatorMethod) -> u8 {
    let index = EstimatorMethod::ALL.iter().position(|other| *other == method);
    index.and_then(|index| u8::try_from(index + 1).ok()).unwrap_or(METHOD_OTHER)
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
        let parameters = (standard(section.method).used)(section)?;
        Ok(Self { number: number_of(section.method), parameters })
    }

    /// Creates a custom method, which has every parameter of the standard methods. The other keys of `[estimator]` are
    /// not parameters of a method; they have their defaults here.
    #[must_use]
    pub fn custom(section: &EstimatorSection) -> Self {
        let Parameters { method, stretch, sigma_length_m, ttl_cycles, .. } = Parameters::default();
        Self {
            number: METHOD_OTHER,
            parameters: Parameters { method, stretch, sigma_length_m, ttl_cycles, ..*section },
        }
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
        let index = usize::from(number).checked_sub(1)?;
        EstimatorMethod::ALL.get(index).copied()
    }

    /// Creates the estimator of a cable without readings; `None` for a custom method.
    pub(crate) fn cable(&self) -> Option<Box<dyn CableEstimator>> {
        Self::numbered(self.number).map(|method| (standard(method).cable)(&self.parameters))
    }
}
