//! The methods of estimation that can be chosen by a name, and that of a program of one's own.

use cable_control::length_filter::FilterError;
use config::EstimatorSection;
use messages::{ControlStatus, NodeEstimate};
use thiserror::Error;

use crate::cable_estimator::{CableEstimator, Parameters};
use crate::{kalman, phi};

/// Number in `node/estimate` of a method that nims does not know: as `control/status` has it for laws.
pub const METHOD_OTHER: u8 = ControlStatus::LAW_OTHER;

/// A method that nims has itself.
struct Standard {
    /// Its name in the configuration.
    name: &'static str,
    /// Its number in `node/estimate`.
    number: u8,
    /// Those of the parameters that it uses, and the defaults of the others.
    used: fn(&Parameters) -> Result<Parameters, FilterError>,
    /// A cable of which nothing is known yet.
    cable: fn(&Parameters) -> Box<dyn CableEstimator>,
}

/// All of them. Another one is a file with a [`CableEstimator`] and a row here.
const STANDARD: [Standard; 2] = [
    Standard { name: "phi", number: NodeEstimate::METHOD_PHI, used: phi::used, cable: phi::cable },
    Standard { name: "kalman", number: NodeEstimate::METHOD_KALMAN, used: kalman::used, cable: kalman::cable },
];

fn numbered(number: u8) -> Option<&'static Standard> {
    STANDARD.iter().find(|standard| standard.number == number)
}

/// How the readings of a cable become its length and velocity, with the parameters of that method. Two are equal if they compute the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    number: u8,
    parameters: Parameters,
}

/// A method or a parameter that does not exist.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MethodError {
    /// No such method.
    #[error("method is \"{0}\"; accepted: {names}", names = names())]
    Unknown(String),
    /// A parameter out of range.
    #[error("{0}")]
    Filter(#[from] FilterError),
}

/// `"phi" or "kalman"`.
fn names() -> String {
    let names: Vec<String> = STANDARD.iter().map(|standard| format!("\"{}\"", standard.name)).collect();
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => names.concat(),
    }
}

impl Method {
    /// The method that `[estimator]` of a system file chooses.
    ///
    /// # Errors
    /// One sentence: what is wrong, what is accepted.
    pub fn of(section: &EstimatorSection) -> Result<Self, MethodError> {
        let chosen = STANDARD.iter().find(|standard| standard.name == section.method);
        let chosen = chosen.ok_or_else(|| MethodError::Unknown(section.method.clone()))?;
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

    /// The name of a number, as the configuration has it; `None` for a method of one's own and for one that this build does not know.
    #[must_use]
    pub fn name_of(number: u8) -> Option<&'static str> {
        numbered(number).map(|standard| standard.name)
    }

    /// A cable of which nothing is known yet; `None` for a method of one's own.
    pub(crate) fn cable(&self) -> Option<Box<dyn CableEstimator>> {
        numbered(self.number).map(|standard| (standard.cable)(&self.parameters))
    }
}
