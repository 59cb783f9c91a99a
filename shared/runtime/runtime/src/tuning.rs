//! Parameters that are set while the robot runs: heard from the supervisor, due in the cycle that it announced.

use std::collections::VecDeque;
use std::fmt::{Debug, Formatter};

use bus::{BusError, Subscriber};
use messages::{Header, SystemConfig, text_of};

use config::{RobotFile, SystemFile, Tuned};

/// Where the supervisor says what was set.
pub const TUNED_CHANNEL: &str = "system/config/nims";

/// A change that was announced.
#[derive(Debug, Clone)]
pub struct Change<T> {
    /// What the process makes of the box as it is from then on.
    pub made: T,
    /// Changes of this run that are in it.
    pub changes: u32,
    /// Life of motor-io, and cycle.
    from: (u64, u64),
}

type Make<T> = Box<dyn FnMut(&SystemFile, &RobotFile) -> anyhow::Result<T>>;

/// Hears what is set, and holds it back until its cycle.
pub struct Tuning<T> {
    said: Subscriber<SystemConfig>,
    file: SystemFile,
    robot: RobotFile,
    make: Make<T>,
    heard: u32,
    waiting: VecDeque<Change<T>>,
}

impl<T> Tuning<T> {
    /// `heard`: changes that are in the file.
    pub(crate) fn new(
        said: Subscriber<SystemConfig>,
        file: SystemFile,
        robot: RobotFile,
        make: Make<T>,
        heard: u32,
    ) -> Self {
        Self { said, file, robot, make, heard, waiting: VecDeque::new() }
    }

    /// Takes what was announced since the last call; for the slack behind an answer, because a change is read, checked and made here.
    ///
    /// # Errors
    /// Those of receiving.
    pub fn hear(&mut self) -> Result<(), BusError> {
        while let Some(said) = self.said.receive()? {
            if said.changes <= self.heard {
                continue;
            }
            self.heard = said.changes;
            match self.read(&said) {
                Ok(made) => {
                    self.waiting.push_back(Change {
                        made,
                        changes: said.changes,
                        from: (said.header.life, said.from_cycle),
                    });
                }
                Err(why) => tracing::error!("change {} of the parameters is not taken up: {why:#}", said.changes),
            }
        }
        Ok(())
    }

    /// What the supervisor says is all that was set so far, and it has checked it; this process takes nothing unchecked all the same.
    fn read(&mut self, said: &SystemConfig) -> anyhow::Result<T> {
        let tuned = Tuned::parse(&text_of(&said.parameters)).map_err(anyhow::Error::msg)?;
        let file = self.file.tuned(&self.robot, &tuned).map_err(anyhow::Error::msg)?;
        (self.make)(&file, &self.robot)
    }

    /// The newest change that holds in a cycle, once. In a later life of motor-io every change of an earlier one holds.
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
        formatter.debug_struct("Tuning").field("heard", &self.heard).finish_non_exhaustive()
    }
}
