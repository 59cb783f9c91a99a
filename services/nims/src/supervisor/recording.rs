//! Whether the run is being recorded. That nothing is, is said at once, and once more at the end: what is not recorded is lost.

use crate::failure::Answer;
use bus::{Bus, Subscriber};
use messages::{RecorderStatus, text_of};

/// What is to be said.
#[derive(Debug, PartialEq, Eq)]
pub enum Said {
    /// Nothing is being recorded.
    Stopped(String),
    /// It goes on.
    GoesOn(String),
}

/// Follows the recorder's own account.
pub struct Recording {
    status: Subscriber<RecorderStatus>,
    ledger: Ledger,
}

impl Recording {
    /// Of the recorder of that domain.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn new(bus: &Bus) -> Answer<Self> {
        Ok(Self { status: bus.subscriber("recorder/status")?, ledger: Ledger::default() })
    }

    /// Takes in what the recorder says.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn look(&mut self, now_ns: u64) -> Answer<Vec<Said>> {
        let mut said = Vec::new();
        while let Some(row) = self.status.receive()? {
            said.extend(self.ledger.note(row.state, &text_of(&row.reason), now_ns));
        }
        Ok(said)
    }

    /// The recorder itself is in trouble.
    pub fn fails(&mut self, why: &str) {
        self.ledger.keep(why);
    }

    /// Why, each time, a part of the run was not recorded.
    #[must_use]
    pub fn troubles(&self) -> &[String] {
        &self.ledger.troubles
    }
}

/// What was not recorded, and why.
#[derive(Debug, Default)]
struct Ledger {
    /// Since when nothing is, ns.
    since_ns: Option<u64>,
    troubles: Vec<String>,
}

impl Ledger {
    fn note(&mut self, state: u8, reason: &str, now_ns: u64) -> Option<Said> {
        match (state == RecorderStatus::STATE_RECORDING, self.since_ns) {
            (false, None) => {
                self.since_ns = Some(now_ns);
                let why = if reason.is_empty() { "the recorder cannot write" } else { reason };
                self.keep(why);
                Some(Said::Stopped(format!("NOTHING IS BEING RECORDED: {why}")))
            }
            (true, Some(since_ns)) => {
                self.since_ns = None;
                let seconds = now_ns.saturating_sub(since_ns) as f64 * 1e-9;
                Some(Said::GoesOn(format!("the run is recorded again; what happened in {seconds:.1} s is not in it")))
            }
            _ => None,
        }
    }

    fn keep(&mut self, why: &str) {
        // A disk that fills again and again is one trouble.
        if !self.troubles.iter().any(|known| known == why) {
            self.troubles.push(why.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_time_is_said_once_and_kept_until_the_end() {
        let (well, full) = (RecorderStatus::STATE_RECORDING, RecorderStatus::STATE_DISK_FULL);
        let mut ledger = Ledger::default();
        assert_eq!(ledger.note(well, "", 0), None);
        assert!(matches!(ledger.note(full, "the disk is full", 1), Some(Said::Stopped(said)) if said.contains("disk")));
        assert_eq!(ledger.note(full, "the disk is full", 2), None);
        assert!(matches!(ledger.note(well, "", 2_000_000_001), Some(Said::GoesOn(said)) if said.contains("2.0 s")));
        assert_eq!(ledger.note(well, "", 3), None);
        assert!(ledger.note(RecorderStatus::STATE_FAILED, "it was removed", 4).is_some());
        assert_eq!(ledger.troubles, ["the disk is full", "it was removed"]);
    }
}
