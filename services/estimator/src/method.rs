//! How the readings of one line become its length and velocity: the paper's motor model, or a Kalman filter.

use cable_control::length_filter::{FilterError, FilterSettings};
use config::EstimatorSection;
use messages::{MotorState, NodeEstimate};
use thiserror::Error;

use crate::{kalman, phi};

/// A method that can be chosen by its name in the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// The paper's: a reading is taken as it is and carried on with the motor model (18), learnt while it runs.
    Phi {
        /// Rows of the sliding window of (19).
        eta: usize,
        /// Pull towards `prior`, (m/s)².
        ridge: f64,
        /// `[φ1, φ2]` of a window that says nothing.
        prior: [f64; 2],
    },
    /// A Kalman filter on length and velocity of each line, with the drive's command as its input.
    Kalman(FilterSettings),
}

/// A method or a parameter that does not exist.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MethodError {
    /// No such method.
    #[error("method is \"{0}\"; accepted: \"phi\" or \"kalman\"")]
    Unknown(String),
    /// A parameter out of range.
    #[error("{0}")]
    Filter(#[from] FilterError),
}

impl Method {
    /// The method that `[estimator]` of a box file chooses.
    ///
    /// # Errors
    /// One sentence: what is wrong, what is accepted.
    pub fn of(section: &EstimatorSection) -> Result<Self, MethodError> {
        let &EstimatorSection { eta, ridge, prior, .. } = section;
        match section.method.as_str() {
            "phi" => Ok(Self::Phi { eta, ridge, prior }),
            "kalman" => Ok(Self::Kalman(FilterSettings::new(
                section.drive_lag_s,
                section.acceleration_sigma_m_s2,
                section.reading_sigma_m,
            )?)),
            other => Err(MethodError::Unknown(other.to_owned())),
        }
    }

    /// Its number in `node/estimate`.
    #[must_use]
    pub fn number(&self) -> u8 {
        match self {
            Self::Phi { .. } => NodeEstimate::METHOD_PHI,
            Self::Kalman(_) => NodeEstimate::METHOD_KALMAN,
        }
    }

    /// The name of a number, as the configuration has it; `None` for one that this build does not know.
    #[must_use]
    pub fn name_of(number: u8) -> Option<&'static str> {
        match number {
            NodeEstimate::METHOD_PHI => Some("phi"),
            NodeEstimate::METHOD_KALMAN => Some("kalman"),
            _ => None,
        }
    }

    /// A line of which nothing is known yet.
    pub(crate) fn line(&self) -> Line {
        match *self {
            Self::Phi { eta, ridge, prior } => Line::Phi(Box::new(phi::Line::new(eta, ridge, prior))),
            Self::Kalman(settings) => Line::Kalman(kalman::Line::new(settings)),
        }
    }
}

/// One line at the instant of the sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Found {
    /// Unstretched length, m.
    pub length_m: f64,
    /// Velocity during the present cycle, m/s.
    pub velocity_m_s: f64,
    /// Velocity for the node's own, m/s; `None`: motor-io's over 50 ms, because one encoder step in one cycle is a large
    /// velocity and a model without memory shows it.
    pub steady_m_s: Option<f64>,
    /// Standard deviation that comes on top of a reading's own, m.
    pub sigma_m: f64,
    /// `[φ1, φ2]`; zeros where there is no such model.
    pub phi: [f64; 2],
    /// When the newest reading in it was taken, ns.
    pub sampled_ns: u64,
}

/// What is remembered of one line.
#[derive(Debug, Clone)]
pub(crate) enum Line {
    Phi(Box<phi::Line>),
    Kalman(kalman::Line),
}

impl Line {
    /// Takes the reading of this cycle, if there is one, and the command sent in it.
    pub(crate) fn read(&mut self, state: &MotorState, i: usize) {
        match self {
            Self::Phi(line) => line.read(state, i),
            Self::Kalman(line) => line.read(state, i),
        }
    }

    /// Where the line is at an instant of a cycle; `None` without a reading that is new enough.
    pub(crate) fn at(&self, cycle: u64, instant_ns: u64) -> Option<Found> {
        match self {
            Self::Phi(line) => line.at(cycle, instant_ns),
            Self::Kalman(line) => line.at(cycle, instant_ns),
        }
    }

    /// Other parameters of the same method; what is remembered stays.
    pub(crate) fn retune(&mut self, method: &Method) {
        match (self, *method) {
            (Self::Phi(line), Method::Phi { eta, ridge, prior }) => line.retune(eta, ridge, prior),
            (Self::Kalman(line), Method::Kalman(settings)) => line.retune(settings),
            (Self::Phi(_), Method::Kalman(_)) | (Self::Kalman(_), Method::Phi { .. }) => {}
        }
    }

    /// The next reading may be anywhere.
    pub(crate) fn expect_anything(&mut self) {
        if let Self::Kalman(line) = self {
            line.expect_anything();
        }
    }

    /// What was read is void.
    pub(crate) fn forget(&mut self) {
        match self {
            Self::Phi(line) => line.forget(),
            Self::Kalman(line) => line.forget(),
        }
    }
}

/// From a reading to an instant of the same or a later cycle, s. Signed: the instant may lie before the reading. A clock that
/// jumped must not throw the node about: at 250 Hz to 10 Hz no cycle is longer than this.
pub(crate) fn ahead_s(instant_ns: u64, sampled_ns: u64, silent: u64) -> f64 {
    let ahead_s = if instant_ns >= sampled_ns {
        (instant_ns - sampled_ns) as f64 * 1e-9
    } else {
        -((sampled_ns - instant_ns) as f64 * 1e-9)
    };
    ahead_s.clamp(-0.1, 0.1 * (1 + silent) as f64)
}
