//! The control laws: from the error of the node to cable velocities.

use cable_control::drive_lag::DriveLag;
use cable_control::law::{InputWeight, LqGain, PFeedforward};
use cable_robot::{CableVec, Matrix3, NodeJacobian, Vector3};
use config::{ControlLaw, ControllerSection};
use messages::ControlStatus;
use thiserror::Error;

use crate::preview::PreviewSettings;

/// A control law with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// The paper's fixed-endpoint fixed-time law: reduces the error to zero in `horizon` cycles.
    LqEndpoint {
        /// Weight Q, times identity.
        state_weight: f64,
        /// Weight R, times identity.
        input_weight: f64,
    },
    /// Linear-quadratic preview control of each cable's length with a model of the drives' delay and lag; the paper's
    /// law while no model fits.
    Preview {
        /// Weight Q of the paper's law, times identity.
        state_weight: f64,
        /// Weight R of the paper's law, times identity.
        input_weight: f64,
        /// Settings of the preview law.
        preview: PreviewSettings,
    },
    /// Per cable: the desired velocity plus a gain times the length error.
    PFeedforward(PFeedforward),
    /// A custom law ([`crate::CableLaw`]), given to the controller separately; without one there is no answer.
    Custom,
}

/// A parameter that is not accepted.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LawError {
    /// A parameter is out of range.
    #[error("{key} is {value}; accepted: {accepted}")]
    Parameter {
        /// Key in `[controller]`.
        key: &'static str,
        /// The value.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
}

impl Law {
    /// Creates the law of `[controller]` in a system file.
    ///
    /// # Errors
    /// A parameter is out of range.
    pub fn from_section(section: &ControllerSection) -> Result<Self, LawError> {
        let &ControllerSection { state_weight, input_weight, length_gain_per_s: gain, .. } = section;
        match section.law {
            ControlLaw::LqEndpoint => Self::lq_endpoint(state_weight, input_weight),
            ControlLaw::Preview => Self::preview(section),
            ControlLaw::PFeedforward => {
                let wrong =
                    LawError::Parameter { key: "length_gain_per_s", value: gain, accepted: "above 0, at most 50" };
                PFeedforward::new(gain).map(Self::PFeedforward).map_err(|_| wrong)
            }
        }
    }

    fn preview(section: &ControllerSection) -> Result<Self, LawError> {
        let &ControllerSection { state_weight, input_weight, .. } = section;
        // The fallback has the same weights.
        Self::lq_endpoint(state_weight, input_weight)?;
        let lag = match section.drive_lag_s {
            None => None,
            Some([delay_s, lag_s]) => Some(DriveLag::new(delay_s, lag_s).map_err(|error| LawError::Parameter {
                key: "drive_lag_s",
                value: error.value,
                accepted: error.accepted,
            })?),
        };
        let preview = PreviewSettings {
            horizon: section.preview_cycles,
            move_penalty_s4: section.move_penalty_s4,
            lag,
            identify: section.identify,
            misfit_limit: section.misfit_limit,
        };
        Ok(Self::Preview { state_weight, input_weight, preview })
    }

    /// Creates the paper's law with these weights.
    ///
    /// # Errors
    /// A weight is out of range.
    pub fn lq_endpoint(state_weight: f64, input_weight: f64) -> Result<Self, LawError> {
        if !(state_weight.is_finite() && state_weight >= 0.0) {
            return Err(LawError::Parameter { key: "state_weight", value: state_weight, accepted: "0 or more" });
        }
        if !(input_weight.is_finite() && input_weight > 0.0) {
            return Err(LawError::Parameter { key: "input_weight", value: input_weight, accepted: "above 0" });
        }
        Ok(Self::LqEndpoint { state_weight, input_weight })
    }

    /// Returns the number of the law in `control/status`.
    pub fn number(&self) -> u8 {
        match self {
            Self::LqEndpoint { .. } => ControlStatus::LAW_LQ_ENDPOINT,
            Self::Preview { .. } => ControlStatus::LAW_PREVIEW,
            Self::PFeedforward(_) => ControlStatus::LAW_P_FEEDFORWARD,
            Self::Custom => ControlStatus::LAW_OTHER,
        }
    }

    /// Returns the law with a number in `control/status`; `None` for a custom law or an unknown number.
    #[must_use]
    pub fn numbered(number: u8) -> Option<ControlLaw> {
        match number {
            ControlStatus::LAW_LQ_ENDPOINT => Some(ControlLaw::LqEndpoint),
            ControlStatus::LAW_PREVIEW => Some(ControlLaw::Preview),
            ControlStatus::LAW_P_FEEDFORWARD => Some(ControlLaw::PFeedforward),
            _ => None,
        }
    }

    /// Computes the paper's law, also as the fallback of the preview law: cable velocities (m/s) that move the node by
    /// `error_m` in `horizon` cycles of `period_s`. `None` in singular geometry and for other laws.
    pub fn velocity(
        &self,
        node_jacobian: &NodeJacobian,
        error_m: &Vector3<f64>,
        period_s: f64,
        horizon: u32,
    ) -> Option<CableVec> {
        match *self {
            Self::LqEndpoint { state_weight, input_weight } | Self::Preview { state_weight, input_weight, .. } => {
                let (q, r) = (Matrix3::identity() * state_weight, InputWeight::Scalar(input_weight));
                let gain = LqGain::new(node_jacobian, period_s, &q, &r, horizon).ok()?;
                Some(gain.velocity(error_m))
            }
            Self::PFeedforward(_) | Self::Custom => None,
        }
    }
}

/// Returns whether two laws differ at most in their parameters.
pub(crate) fn is_same_kind(one: &Law, other: &Law) -> bool {
    std::mem::discriminant(one) == std::mem::discriminant(other)
}
