//! The heartbeats of the processes: who is ready, and who is silent.

use super::crew::Crew;
use crate::failure::Answer;
use bus::{Bus, Subscriber, clock};
use messages::{Heartbeat, text_of};
use std::collections::BTreeMap;

/// Heartbeats come five times a second; a process without one for this long hangs, ns.
const SILENT_NS: u64 = 2_000_000_000;

/// Heartbeats by the name of their process.
#[derive(Default)]
pub struct Beats {
    heard: BTreeMap<String, Heard>,
}

struct Heard {
    subscriber: Subscriber<Heartbeat>,
    /// The last one: when, and of which process.
    last: Option<(u64, u32)>,
}

/// What has changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// A process has said for the first time that it is ready.
    Ready(String),
    /// It has shown no sign of life for so many seconds.
    Silent(String, u64),
    /// It shows signs of life again.
    Back(String),
}

impl Beats {
    /// Listens to a process that is about to be started.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn listen(&mut self, bus: &Bus, name: &str) -> Answer {
        if !self.heard.contains_key(name) {
            let subscriber = bus.subscriber(&format!("system/heartbeat/{name}"))?;
            self.heard.insert(name.to_owned(), Heard { subscriber, last: None });
        }
        Ok(())
    }

    /// Listens to it no longer.
    pub fn forget(&mut self, name: &str) {
        self.heard.remove(name);
    }

    /// Takes in what has come, and says what has changed.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn look(&mut self, crew: &mut Crew) -> Answer<Vec<Change>> {
        let now = clock::now_ns();
        let mut changes = Vec::new();
        for child in crew.iter_mut() {
            let Some(heard) = self.heard.get_mut(&child.member.name) else { continue };
            while let Some(beat) = heard.subscriber.receive()? {
                // An earlier life, or a stranger of that name, says nothing about this one.
                if beat.pid != child.pid {
                    continue;
                }
                heard.last = Some((now, beat.pid));
                if beat.state == Heartbeat::STATE_READY && child.ready_ns.is_none() {
                    child.ready_ns = Some(now);
                    child.version = Some(text_of(&beat.version)).filter(|version| !version.is_empty());
                    changes.push(Change::Ready(child.member.name.clone()));
                }
            }
            let silent = heard.last.is_some_and(|(at, pid)| pid == child.pid && now.saturating_sub(at) > SILENT_NS)
                && child.ready_ns.is_some()
                && child.exit.is_none()
                && child.asked.is_none();
            if silent != child.silent {
                child.silent = silent;
                let name = child.member.name.clone();
                changes.push(if silent { Change::Silent(name, SILENT_NS / 1_000_000_000) } else { Change::Back(name) });
            }
        }
        Ok(changes)
    }
}
