//! Consequence and remedy of the loss of a process. Terminal, process table and report use the same sentences.

use config::Role;

/// State of a lost process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LossState {
    /// It has ended and is not restarted.
    Dead,
    /// It has ended and is restarted automatically.
    Restarts,
    /// It hangs and is not ended.
    Hangs,
    /// It hangs and is killed, so that it is restarted.
    Terminated,
}

/// Returns the consequence for the robot when a process of this role is lost, as a clause for the operator.
#[must_use]
pub fn consequence(role: Role, watchdog_s: f64) -> String {
    match role {
        Role::MotorBox => "the virtual drives are gone, so motor-io reports a fault".to_owned(),
        Role::MotorIo => format!("the drives stop the motors after {watchdog_s} s"),
        Role::Estimator | Role::Controller => "the robot stops on the path and holds".to_owned(),
        Role::Planner => "the robot finishes the current segment and holds".to_owned(),
        Role::Recorder => "the mission continues, and nothing is recorded until it is back".to_owned(),
        Role::Other => "the mission continues without it".to_owned(),
    }
}

/// Returns the operator's remedy for the loss of that process; `None` if no action is needed. `replaced`: a standby has
/// taken over.
///
/// Every remedy works while `nims up` runs, because a second `nims up` is refused. The exception is the virtual motor
/// box, which restarts only with the robot.
#[must_use]
pub fn cure(name: &str, role: Role, fate: LossState, replaced: bool) -> Option<String> {
    let first = match (role, fate) {
        (Role::MotorBox, LossState::Dead) => Some("end `nims up`, and start it again".to_owned()),
        (Role::MotorBox, LossState::Hangs) => Some("end `nims up`, which ends it too, and start it again".to_owned()),
        (_, LossState::Terminated) => Some("it is ended, to be started again".to_owned()),
        (_, LossState::Hangs) => Some(format!("`nims restart {name}` ends it and starts it again")),
        (_, LossState::Restarts) => None,
        (Role::Other, LossState::Dead) => None,
        (Role::Estimator | Role::Controller, LossState::Dead) if replaced => None,
        (_, LossState::Dead) => Some(format!("`nims restart {name}` starts it again")),
    };
    let then = match role {
        Role::MotorIo => Some(
            "then `nims confirm-position`, `nims arm`, and `nims run MISSION --continue` for what is left of a mission",
        ),
        Role::Estimator | Role::Controller if !replaced => Some("then `nims resume`"),
        _ => None,
    };
    match (first, then) {
        (Some(first), Some(then)) => Some(format!("{first}, {then}")),
        (first, then) => first.or(then.map(str::to_owned)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROLES: [(&str, Role); 7] = [
        ("motor-box", Role::MotorBox),
        ("motor-io", Role::MotorIo),
        ("estimator", Role::Estimator),
        ("controller", Role::Controller),
        ("planner", Role::Planner),
        ("recorder", Role::Recorder),
        ("wind", Role::Other),
    ];

    #[test]
    fn a_process_that_is_restarted_automatically_has_no_cure_that_starts_it() {
        for (name, role) in ROLES {
            assert!(!consequence(role, 0.3).contains("nims"), "{name}");
            for fate in [LossState::Restarts, LossState::Terminated] {
                let cure = cure(name, role, fate, false).unwrap_or_default();
                let starts = ["nims restart", "nims start", "nims up"].iter().any(|words| cure.contains(words));
                assert!(!starts, "{name}: {cure}");
            }
        }
    }

    #[test]
    fn a_lost_motor_io_is_restarted_and_not_the_robot() {
        for fate in [LossState::Dead, LossState::Hangs] {
            let cure = cure("motor-io", Role::MotorIo, fate, false).unwrap();
            let steps = ["nims restart motor-io", "confirm-position", "nims arm", "nims run MISSION --continue"];
            let places: Vec<usize> = steps.iter().filter_map(|step| cure.find(step)).collect();
            assert!(places.len() == steps.len() && places.is_sorted(), "{cure}");
            assert!(!cure.contains("nims up"), "{cure}");
        }
    }

    #[test]
    fn a_lost_controller_with_a_standby_leaves_nothing_to_resume() {
        assert_eq!(cure("controller", Role::Controller, LossState::Dead, true), None);
        let alone = cure("controller", Role::Controller, LossState::Dead, false).unwrap();
        let commands = |cure: &str| cure.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(commands(&alone), ["nims restart controller", "nims resume"]);
        let restarts = cure("controller", Role::Controller, LossState::Restarts, false).unwrap();
        assert_eq!(commands(&restarts), ["nims resume"]);
        let hung = cure("controller", Role::Controller, LossState::Hangs, true).unwrap();
        assert_eq!(commands(&hung), ["nims restart controller"]);
    }

    #[test]
    fn the_sentences_are_those_of_the_file() {
        let consequences = ROLES.map(|(name, role)| (format!("{name} is lost"), consequence(role, 0.3)));
        let cures = ROLES.iter().flat_map(|&(name, role)| {
            use LossState::{Dead, Hangs, Restarts, Terminated};
            [Dead, Restarts, Hangs, Terminated].into_iter().flat_map(move |fate| {
                [false, true].map(|replaced| {
                    let cure = cure(name, role, fate, replaced).unwrap_or_else(|| "-".to_owned());
                    (format!("{name}, {fate:?}{}", if replaced { ", replaced" } else { "" }), cure)
                })
            })
        });
        sentences::compare(env!("CARGO_MANIFEST_DIR"), consequences.into_iter().chain(cures));
    }

    #[test]
    fn every_cure_fits_into_a_row_of_the_process_table() {
        let row = messages::ProcessState::default();
        for (name, role) in ROLES {
            for fate in [LossState::Dead, LossState::Restarts, LossState::Hangs, LossState::Terminated] {
                let cure = cure(name, role, fate, false).unwrap_or_default();
                assert!(cure.len() <= row.reason.len(), "{cure}");
            }
        }
    }
}
