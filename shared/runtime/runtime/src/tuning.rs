//! Parameters that are set while the robot runs: received from the supervisor, applied in the cycle that it announced.

use std::collections::VecDeque;
use std::fmt::{Debug, Formatter};

use bus::{BusError, Subscriber};
use messages::{Header, SystemConfig, text_of};

use config::{RobotFile, SystemFile, Tuned};

/// Channel on which the supervisor publishes the set parameters.
pub const TUNED_CHANNEL: &str = "system/config/nims";

/// An announced change.
#[derive(Debug, Clone)]
pub struct Change<T> {
    /// The value that the process made from the changed configuration.
    pub made: T,
    /// Number of changes of this run up to this one.
    pub changes: u32,
    /// Life of motor-io and cycle from which the change applies.
    from: (u64, u64),
}

type Make<T> = Box<dyn FnMut(&SystemFile, &RobotFile) -> anyhow::Result<T>>;

/// Receives announced changes and returns them in their cycle.
pub struct Tuning<T> {
    announcements: Subscriber<SystemConfig>,
    file: SystemFile,
    robot: RobotFile,
    make: Make<T>,
    /// Number of changes received so far, including those in the file.
    received: u32,
    waiting: VecDeque<Change<T>>,
}

impl<T> Tuning<T> {
    /// `received`: number of changes that the file contains.
    pub(crate) fn new(
        announcements: Subscriber<SystemConfig>,
        file: SystemFile,
        robot: RobotFile,
        make: Make<T>,
        received: u32,
    ) -> Self {
        Self { announcements, file, robot, make, received, waiting: VecDeque::new() }
    }

    /// Receives and checks the changes announced since the last call. To be called in the idle time after an output,
    /// because it makes the new value.
    ///
    /// # Errors
    /// Those of receiving.
    pub fn poll(&mut self) -> Result<(), BusError> {
        while let Some(announced) = self.announcements.receive()? {
            if announced.changes <= self.received {
                continue;
            }
            self.received = announced.changes;
            match self.make_changed(&announced) {
                Ok(made) => {
                    self.waiting.push_back(Change {
                        made,
                        changes: announced.changes,
                        from: (announced.header.life, announced.from_cycle),
                    });
                }
                Err(why) => tracing::error!("change {} of the parameters is not applied: {why:#}", announced.changes),
            }
        }
        Ok(())
    }

    /// Makes the value from the configuration with all parameters set so far. The supervisor has checked them; this
    /// process checks them again.
    fn make_changed(&mut self, announced: &SystemConfig) -> anyhow::Result<T> {
        let tuned = Tuned::parse(&text_of(&announced.parameters)).map_err(anyhow::Error::msg)?;
        let file = self.file.tuned(&self.robot, &tuned).map_err(anyhow::Error::msg)?;
        (self.make)(&file, &self.robot)
    }

    /// Returns the newest change that applies in a cycle, once. Changes announced for an earlier life of motor-io apply
    /// too.
    pub fn due(&mut self, now: &Header) -> Option<Change<T>> {
        let mut due = None;
        while self.waiting.front().is_some_and(|change| change.from <= (now.life, now.cycle)) {
            due = self.waiting.pop_front();
        }
        due
    }
}

impl<T> Debug for Tuning<T> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Tuning").field("received", &self.received).finish_non_exhaustive()
    }
}
