//! The scheduling that `[realtime]` asks for, and how much of it this machine permits.

use serde::Serialize;
use service::config::{RealtimeSection, Role};
use service::realtime;
use std::fs::File;

/// Without a box file: what the control chain is best given. It is not asked for a processor of its own, because only the box's owner
/// knows which is free.
pub fn best() -> RealtimeSection {
    RealtimeSection { priority: 50, idle_latency_us: Some(0), ..RealtimeSection::default() }
}

/// What was reached.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Reached {
    /// SCHED_FIFO at this priority; `null`: ordinary.
    pub fifo_priority: Option<u8>,
    /// Bound to this processor; `null`: any.
    pub cpu: Option<usize>,
    /// Memory is locked.
    pub memory_locked: bool,
    /// Longest time that a processor may take to wake up, µs; `null`: as the system likes.
    pub idle_latency_us: Option<u32>,
    /// What was asked for and is not permitted, each with its cure.
    pub refused: Vec<String>,
}

/// Sets up the calling thread as motor-io is; the file keeps the processors awake as long as it is held.
pub fn apply(section: &RealtimeSection) -> (Reached, Option<File>) {
    let (reached, refused) = realtime::apply(section, Role::MotorIo.name());
    let awake = section.idle_latency_us.map(realtime::stay_awake);
    let (awake, sleepy) = match awake {
        Some(Ok(file)) => (Some(file), None),
        Some(Err(sentence)) => (None, Some(sentence)),
        None => (None, None),
    };
    let found = Reached {
        fifo_priority: reached.fifo.then_some(section.priority),
        cpu: section.cpu.filter(|_| reached.pinned),
        memory_locked: reached.locked,
        idle_latency_us: section.idle_latency_us.filter(|_| awake.is_some()),
        refused: [refused, sleepy].into_iter().flatten().collect(),
    };
    (found, awake)
}

impl Reached {
    /// In words, a line for what was reached, and one for each thing that was not.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let mut parts = vec![match self.fifo_priority {
            Some(priority) => format!("SCHED_FIFO priority {priority}"),
            None => "ordinary priority".to_owned(),
        }];
        parts.extend(self.cpu.map(|cpu| format!("on processor {cpu}")));
        if self.memory_locked {
            parts.push("memory locked".to_owned());
        }
        parts.extend(self.idle_latency_us.map(|latency| match latency {
            0 => "processors kept awake".to_owned(),
            latency => format!("processors awake within {latency} µs"),
        }));
        let mut lines = vec![format!("scheduled as motor-io: {}", parts.join(", "))];
        lines.extend(self.refused.iter().cloned());
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_refused_is_said_and_not_claimed() {
        let section = RealtimeSection { cpu: Some(100_000), ..RealtimeSection::default() };
        let (reached, _) = std::thread::spawn(move || apply(&section)).join().unwrap();
        assert_eq!((reached.fifo_priority, reached.cpu, reached.idle_latency_us), (None, None, None));
        let words = reached.words();
        assert_eq!(words.len(), 2, "{words:?}");
        assert!(words[0].contains("ordinary") && words[1].contains("100000"), "{words:?}");
    }

    #[test]
    fn what_was_reached_is_all_named() {
        let reached = Reached {
            fifo_priority: Some(50),
            cpu: Some(1),
            memory_locked: true,
            idle_latency_us: Some(20),
            refused: Vec::new(),
        };
        let words = reached.words().join("\n");
        for word in ["priority 50", "processor 1", "locked", "20 µs"] {
            assert!(words.contains(word), "{words}");
        }
    }
}
