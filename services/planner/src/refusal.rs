//! Refusals of the planner, each with its reason in the catalogue of answers.

use config::MissionCopyError;
use mission::MissionError;
use robot_state::Reason;
use robot_state::answers::detail;
use thiserror::Error;

use crate::plan::PlanError;

/// Reason for which a request is refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refusal {
    /// The robot or the mission is not ready.
    #[error("{0}")]
    NotReady(Box<Reason>),
    /// The motion breaks a limit, or is invalid.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A value of the mission is invalid.
    #[error(transparent)]
    Mission(#[from] MissionError),
}

impl Refusal {
    /// Returns the answer to the request.
    #[must_use]
    pub fn reason(&self) -> Reason {
        match self {
            Self::NotReady(reason) => **reason,
            Self::Mission(error) => error.reason(),
            Self::Plan(error) => error.reason(),
        }
    }

    /// Returns whether this robot cannot carry out the request in any state.
    #[must_use]
    pub fn is_bad_input(&self) -> bool {
        self.reason().is_bad_input()
    }
}

/// Returns the reason for which the copy of a mission cannot be used.
pub(crate) fn reason_of_copy_error(error: &MissionCopyError) -> Reason {
    match error {
        MissionCopyError::OtherContent { path } => Reason::CopyChanged { copy: detail(path.display()) },
        MissionCopyError::Unreadable { path, why } => {
            Reason::CopyUnreadable { copy: detail(path.display()), why: detail(why) }
        }
        MissionCopyError::NotStored { path, .. } | MissionCopyError::Full { path } => {
            Reason::CopyUnreadable { copy: detail(path.display()), why: detail(error) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::ScanError;
    use cable_robot::Vector3;
    use cable_robot::energy::EnergyError;
    use cable_robot::motion::Cause;
    use cable_robot::path::PathError;
    use cable_robot::profile::ProfileError;

    #[test]
    fn each_refusal_has_its_own_reason() {
        let cause = Cause::CableSpeed { cable: 1, speed_m_s: 0.5, limit_m_s: 0.4 };
        let refusal = cable_robot::motion::Refusal { position: Vector3::new(1.0, 2.0, 3.0), path_s_m: 0.5, cause };
        let errors = [
            PlanError::Refused {
                leg: 1,
                segment: " from [1, 2, 3] to [4, 5, 6]".to_owned(),
                refusal: Box::new(refusal),
                feasible_m_s: Some(0.375),
            },
            PlanError::TooFast { leg: 2, speed_m_s: 0.5, limit_m_s: 0.4 },
            PlanError::TooHard { asked_m_s2: 0.75, limit_m_s2: 0.5 },
            PlanError::Path { leg: 3, error: PathError::TooShort { length_m: 1e-9 } },
            PlanError::Profile {
                leg: 4,
                error: ProfileError::InvalidLimit { what: "speed", value: -1.0, accepted: "positive" },
            },
            PlanError::Point { leg: 5, why: "a point of this robot has 3 coordinates".to_owned() },
            PlanError::NoPath { leg: 6, error: EnergyError::NoDistance },
            PlanError::Scan { leg: 7, error: ScanError::NoArea },
            PlanError::OtherPlan,
            PlanError::TooLong,
            PlanError::AlreadyThere,
            PlanError::NoStart { x: 1.5, y: 2.0, z: -0.25 },
        ];
        let codes: std::collections::BTreeSet<u16> = errors.iter().map(|error| error.reason().code()).collect();
        assert_eq!(codes.len(), errors.len());
    }
}
