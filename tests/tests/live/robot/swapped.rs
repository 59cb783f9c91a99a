//! Swaps on a machine that may be busy.

use super::Robot;
use messages::{MotorSlots, ROLES};
use robot_state::sentences::cause_phrase;

/// Most attempts of one swap.
pub const SWAPS: usize = 3;

/// When a new process was late, so that its swap was refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Late {
    /// In the cycle that was announced: it did not take over.
    Announced,
    /// Just after it had taken over: it gave the place back.
    Probation,
}

impl Late {
    /// Reads the refusal of a swap; `None` if it has another cause.
    pub fn from_refusal(why: &str) -> Option<Self> {
        // A swap without a cause was late in the announced cycle.
        let names = |cause: u8| (0..ROLES).any(|role| why.contains(cause_phrase(role, cause)));
        if names(MotorSlots::CAUSE_PROBATION) {
            return Some(Self::Probation);
        }
        let other = (MotorSlots::CAUSE_ABSENT..MotorSlots::CAUSE_PROBATION).any(names);
        (!other && why.contains("announced")).then_some(Self::Announced)
    }
}

impl Robot {
    /// Asks for a swap until it succeeds; returns the answer. A busy machine may make the new process late in one
    /// cycle, and then the swap is rightly refused.
    pub fn swapped(&self, args: &[&str]) -> String {
        for _ in 0..SWAPS {
            let output = self.nims(args);
            if output.status.success() {
                return String::from_utf8_lossy(&output.stdout).into_owned();
            }
            let why = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.code() == Some(1) && Late::from_refusal(&why).is_some(), "{why}{}", self.printed());
        }
        panic!("{args:?}: {SWAPS} times no swap\n{}", self.printed());
    }
}
