//! Answers to requests, in place, because the loop does not allocate.

use robot_state::Reason;
use robot_state::answers::Detail;

/// Answer to one request.
#[derive(Debug, Clone, Copy)]
pub struct Answer {
    /// Number of the request.
    pub id: u64,
    /// Verb of the request.
    pub verb: u8,
    /// Why it is carried out or not.
    pub reason: Reason,
}

impl Answer {
    /// Returns true if the request is carried out.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        self.reason.is_accepted()
    }

    /// The answer in English.
    #[must_use]
    pub fn sentence(&self) -> Detail {
        self.reason.sentence()
    }
}

/// Two answers are equal if the bits that are recorded are.
impl PartialEq for Answer {
    fn eq(&self, other: &Self) -> bool {
        (self.id, self.verb) == (other.id, other.verb) && self.reason.answer() == other.reason.answer()
    }
}
