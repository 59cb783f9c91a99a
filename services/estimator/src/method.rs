//! The methods of estimation that can be chosen by a name, and that of a program of one's own.

use cable_control::length_filter::FilterError;
use config::{EstimatorMethod, EstimatorSection};
use messages::{ControlStatus, NodeEstimate};

use crate::cable_estimator::{CableEstimator, Parameters};
use crate::{kalman, phi};

/// Number in `node/estimate` of a method that nims does not know: as `control/status` has it for laws.
pub const METHOD_OTHER: u8 = ControlStatus::LAW_OTHER;

/// A method that nims has itself.
struct Standard {
    /// Its name in the configuration.
    name: EstimatorMethod,
    /// Its number in `node/estimate`.
    number: u8,
    /// Those of the parameters that it uses, and the defaults of the others.
    used: fn(&Parameters) -> Result<Parameters, FilterError>,
    /// A cable of which nothing is known yet.
    cable: fn(&Parameters) -> Box<dyn CableEstimator>,
}

const PHI: Standard =
    Standard { name: EstimatorMethod::Phi, number: NodeEstimate::METHOD_PHI, used: phi::used, cable: phi::cable };
const KALMAN: Standard = Standard {
    name: EstimatorMethod::Kalman,
    number: NodeEstimate::METHOD_KALMAN,
    used: kalman::used,
    cable: kalman::cable,
};

/// Another method is a file with a [`CableEstimator`], a row above and its name here.
fn standard(method: EstimatorMethod) -> &'static Standard {
    match method {
        EstimatorMethod::Phi => &PHI,
        EstimatorMethod::Kalman => &KALMAN,
    }
}

fn numbered(number: u8) -> Option<&'static Standard> {
    EstimatorMethod::ALL.iter().map(|method| standard(*method)).find(|standard| standard.number == number)
}

/// How the readings of a cable become its length and velocity, with the parameters of that method. Two are equal if they compute the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    number: u8,
    parameters: Parameters,
}

impl Method {
    /// The method that `[estimator]` of a system file chooses.
    ///
    /// # Errors
    /// One sentence: what is wrong, what is accepted.
    pub fn of(section: &EstimatorSection) -> Result<Self, FilterError> {
        let chosen = standard(section.method);
        Ok(Self { number: chosen.number, parameters: (chosen.used)(&section.into())? })
    }

    /// That of a program of one's own, which has every parameter of `[estimator]`; the `method` there is not used.
    #[must_use]
    pub fn own(section: &EstimatorSection) -> Self {
        Self { number: METHOD_OTHER, parameters: section.into() }
    }

    /// The same parameters for a method of one's own.
    pub(crate) fn to_own(self) -> Self {
        Self { number: METHOD_OTHER, ..self }
    }

    /// Its number in `node/estimate`.
    #[must_use]
    pub fn number(&self) -> u8 {
        self.number
    }

    /// Its parameters.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The method of a number in `node/estimate`; `None` for a custom method and for an unknown number.
    #[must_use]
    pub fn numbered(number: u8) -> Option<EstimatorMethod> {
        numbered(number).map(|standard| standard.name)
    }

    /// A cable of which nothing is known yet; `None` for a method of one's own.
    pub(crate) fn cable(&self) -> Option<Box<dyn CableEstimator>> {
        numbered(self.number).map(|standard| (standard.cable)(&self.parameters))
    }
}
