//! Control laws: from where the node is and should be to the velocity the cables answer with.

use cable_control::drive_lag::DriveLag;
use cable_control::law::{InputWeight, LqGain, PFeedforward};
use cable_robot::{CableVec, Matrix3, NodeJacobian, Vector3};
use config::{ControlLaw, ControllerSection};
use messages::ControlStatus;
use thiserror::Error;

use crate::preview::PreviewSettings;

/// A law that can be chosen by its name in the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// The paper's fixed-endpoint fixed-time law: e is brought to zero in `horizon` cycles.
    LqEndpoint {
        /// Q, times identity.
        state_weight: f64,
        /// R, times identity.
        input_weight: f64,
    },
    /// Linear-quadratic preview control of each cable's length over a model of the drives' delay and lag; the paper's
    /// law while there is no model that fits.
    Preview {
        /// Q of the fallback.
        state_weight: f64,
        /// R of the fallback.
        input_weight: f64,
        /// The preview law itself.
        preview: PreviewSettings,
    },
    /// Each line for itself: desired velocity, and a share of the length error.
    PFeedforward(PFeedforward),
    /// One that the process brought along ([`crate::CableLaw`]); without it there is no answer.
    Custom,
}

/// A parameter that is not accepted.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LawError {
    /// A parameter out of range.
    #[error("{key} is {value}; accepted: {accepted}")]
    Parameter {
        /// The key of `[controller]`.
        key: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        accepted: &'static str,
    },
}

impl Law {
    /// The law that `[controller]` of a system file chooses.
    ///
    /// # Errors
    /// One sentence: which key, what is accepted.
    pub fn of(section: &ControllerSection) -> Result<Self, LawError> {
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

    /// The paper's law with these weights.
    ///
    /// # Errors
    /// One sentence: which key, what is accepted.
    pub fn lq_endpoint(state_weight: f64, input_weight: f64) -> Result<Self, LawError> {
        if !(state_weight.is_finite() && state_weight >= 0.0) {
            return Err(LawError::Parameter { key: "state_weight", value: state_weight, accepted: "0 or more" });
        }
        if !(input_weight.is_finite() && input_weight > 0.0) {
            return Err(LawError::Parameter { key: "input_weight", value: input_weight, accepted: "above 0" });
        }
        Ok(Self::LqEndpoint { state_weight, input_weight })
    }

    /// Its number in `control/status`.
    pub fn number(&self) -> u8 {
        match self {
            Self::LqEndpoint { .. } => ControlStatus::LAW_LQ_ENDPOINT,
            Self::Preview { .. } => ControlStatus::LAW_PREVIEW,
            Self::PFeedforward(_) => ControlStatus::LAW_P_FEEDFORWARD,
            Self::Custom => ControlStatus::LAW_OTHER,
        }
    }

    /// The law of a number in `control/status`; `None` for a custom law and for a number that this build does not know.
    #[must_use]
    pub fn numbered(number: u8) -> Option<ControlLaw> {
        match number {
            ControlStatus::LAW_LQ_ENDPOINT => Some(ControlLaw::LqEndpoint),
            ControlStatus::LAW_PREVIEW => Some(ControlLaw::Preview),
            ControlStatus::LAW_P_FEEDFORWARD => Some(ControlLaw::PFeedforward),
            _ => None,
        }
    }

    /// The paper's law (the fallback of the preview law): cable velocities (m/s) that bring the node by `error_m` in `horizon` cycles of `period_s`; `None` where the
    /// geometry gives none, and for laws that are not of this kind.
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

/// Whether two laws differ at most in their parameters.
pub(crate) fn is_same_kind(one: &Law, other: &Law) -> bool {
    std::mem::discriminant(one) == std::mem::discriminant(other)
}
