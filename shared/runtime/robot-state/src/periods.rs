//! Counts of the periods of missions: steered, paused, and lost by cause. `docs/counters.md` has the rules.

use messages::MotorAuthority;
use serde::Serialize;

/// Periods of missions, by class.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Periods {
    /// A fresh command reached every drive.
    pub steered: u64,
    /// At rest because an operator paused.
    pub paused: u64,
    /// Lost: a program did not get the processor, by evidence from the kernel.
    pub computer: u64,
    /// Lost: a drive did not answer in time.
    pub drive: u64,
    /// Lost: a serial port was being resynchronised.
    pub resync: u64,
    /// Lost: no valid command, for any other reason.
    pub answer: u64,
}

impl Periods {
    /// Returns the counts of motor-io since its life began.
    #[must_use]
    pub fn from_authority(authority: &MotorAuthority) -> Self {
        Self {
            steered: authority.steered,
            paused: authority.paused,
            computer: authority.lost_computer,
            drive: authority.lost_drive,
            resync: authority.lost_resync,
            answer: authority.lost_answer,
        }
    }

    /// Returns the leading number: periods in which the node was not steered by a fresh command.
    #[must_use]
    pub fn unsteered(&self) -> u64 {
        self.causes().iter().map(|(_, count)| count).sum()
    }

    /// Returns the number of all periods of missions, pauses excluded.
    #[must_use]
    pub fn all(&self) -> u64 {
        self.steered + self.unsteered()
    }

    /// Returns the causes and their counts.
    #[must_use]
    pub fn causes(&self) -> [(&'static str, u64); 4] {
        [("computer", self.computer), ("drive", self.drive), ("resync", self.resync), ("answer", self.answer)]
    }

    /// `3 of 6282 periods not steered`
    #[must_use]
    pub fn leading(&self) -> String {
        format!("{} of {} periods not steered", self.unsteered(), self.all())
    }

    /// `computer 3, drive 0, resync 0, answer 0`
    #[must_use]
    pub fn by_cause(&self) -> String {
        self.causes().map(|(cause, count)| format!("{cause} {count}")).join(", ")
    }

    /// Returns the leading number with the causes that occurred.
    #[must_use]
    pub fn summary(&self) -> String {
        let causes = self.causes().into_iter().filter(|(_, count)| *count > 0);
        let causes: Vec<String> = causes.map(|(cause, count)| format!("{cause} {count}")).collect();
        match (self.all(), causes.is_empty()) {
            (0, _) => "no period of a mission yet".to_owned(),
            (_, true) => self.leading(),
            _ => format!("{} ({})", self.leading(), causes.join(", ")),
        }
    }

    /// Adds the counts of another set.
    pub fn add(&mut self, other: &Self) {
        self.steered += other.steered;
        self.paused += other.paused;
        self.computer += other.computer;
        self.drive += other.drive;
        self.resync += other.resync;
        self.answer += other.answer;
    }
}
