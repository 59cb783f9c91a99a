//! The heartbeats of the processes: who is ready, and who is silent.

use super::crew::Crew;
use crate::failure::Answer;
use bus::{Bus, Subscriber, clock};
use messages::{Heartbeat, text_of};
use std::collections::BTreeMap;

/// Heartbeats come five times a second; a process without one for this long hangs, ns.
const SILENT_NS: u64 = 2_000_000_000;
/// A process that has been silent for this long is looked at more closely, ns.
const SUSPECT_NS: u64 = 500_000_000;
/// Longer than this between two looks, and it is this program, with the rest of the machine, that stood still, ns.
const LOOKED_NS: u64 = 250_000_000;

/// Heartbeats by the name of their process.
#[derive(Default)]
pub struct Beats {
    heard: BTreeMap<String, Heard>,
    awake: Awake,
}

struct Heard {
    subscriber: Subscriber<Heartbeat>,
    /// The last one: when, on the clock of [`Awake`], and of which process.
    last: Option<(u64, u32)>,
    /// When it began to be suspect, on the same clock, and how it had been scheduled until then.
    suspect: Option<(u64, Scheduled)>,
}

/// A clock that runs only while this program does: what passes while the whole machine stands still is nobody's silence.
#[derive(Debug, Default)]
struct Awake {
    ns: u64,
    looked_ns: Option<u64>,
}

impl Awake {
    fn look(&mut self, now_ns: u64) -> u64 {
        let since_ns = self.looked_ns.replace(now_ns).map_or(0, |looked_ns| now_ns.saturating_sub(looked_ns));
        self.ns += since_ns.min(LOOKED_NS);
        self.ns
    }
}

/// What has changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// A process has said for the first time that it is ready.
    Ready(String),
    /// It has shown no sign of life for so many seconds, though the machine had time for it.
    Silent(String, u64),
    /// It has shown none, because the machine had no time for it.
    Starved(String, u64),
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
            self.heard.insert(name.to_owned(), Heard { subscriber, last: None, suspect: None });
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
        let awake_ns = self.awake.look(now);
        let mut changes = Vec::new();
        for child in crew.iter_mut() {
            let Some(heard) = self.heard.get_mut(&child.member.name) else { continue };
            while let Some(beat) = heard.subscriber.receive()? {
                // An earlier life, or a stranger of that name, says nothing about this one.
                if beat.pid != child.pid {
                    continue;
                }
                (heard.last, heard.suspect) = (Some((awake_ns, beat.pid)), None);
                if beat.state == Heartbeat::STATE_READY && child.ready_ns.is_none() {
                    child.ready_ns = Some(now);
                    child.version = Some(text_of(&beat.version)).filter(|version| !version.is_empty());
                    changes.push(Change::Ready(child.member.name.clone()));
                }
            }
            let expected = child.ready_ns.is_some() && child.exit.is_none() && child.asked.is_none();
            let silent_ns = match heard.last {
                Some((at_ns, pid)) if pid == child.pid && expected => awake_ns.saturating_sub(at_ns),
                _ => 0,
            };
            let starved = heard.is_starved(child.pid, silent_ns, awake_ns);
            let (silent, hangs) = (silent_ns > SILENT_NS, silent_ns > SILENT_NS && !starved);
            if (silent, hangs) == (child.silent, child.hangs) {
                continue;
            }
            (child.silent, child.hangs) = (silent, hangs);
            let (name, seconds) = (child.member.name.clone(), SILENT_NS / 1_000_000_000);
            changes.push(match (silent, hangs) {
                (false, _) => Change::Back(name),
                (true, false) => Change::Starved(name, seconds),
                (true, true) => Change::Silent(name, seconds),
            });
        }
        Ok(changes)
    }
}

impl Heard {
    /// Whether the machine had no time for the process while it was silent: since it began to be suspect, it waited for a processor for
    /// more than half of the time, or it waits now and has hardly run. One that was stopped, or waits for something that never comes,
    /// waits for no processor, and one that runs in a circle has it.
    fn is_starved(&mut self, pid: u32, silent_ns: u64, awake_ns: u64) -> bool {
        if silent_ns < SUSPECT_NS {
            self.suspect = None;
            return false;
        }
        let Some(now) = Scheduled::now(pid) else { return false };
        let (since_ns, before) = *self.suspect.get_or_insert((awake_ns, now));
        now.starved_since(&before, awake_ns.saturating_sub(since_ns))
    }
}

/// How the kernel has scheduled a process.
#[derive(Debug, Clone, Copy)]
struct Scheduled {
    ran_ns: u64,
    /// Without the time that it waits at present.
    waited_ns: u64,
    /// It runs, or waits for a processor.
    runnable: bool,
}

impl Scheduled {
    /// `None` where the kernel does not say.
    fn now(pid: u32) -> Option<Self> {
        let schedstat = std::fs::read_to_string(format!("/proc/{pid}/schedstat")).ok()?;
        let mut fields = schedstat.split_whitespace().map(str::parse::<u64>);
        let (ran_ns, waited_ns) = (fields.next()?.ok()?, fields.next()?.ok()?);
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // Behind the name in parentheses, which may hold anything.
        let runnable = stat.rsplit_once(')')?.1.trim_start().starts_with('R');
        Some(Self { ran_ns, waited_ns, runnable })
    }

    fn starved_since(&self, before: &Self, passed_ns: u64) -> bool {
        let waited_ns = self.waited_ns.saturating_sub(before.waited_ns);
        let ran_ns = self.ran_ns.saturating_sub(before.ran_ns);
        2 * waited_ns > passed_ns || (self.runnable && 2 * ran_ns < passed_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_passes_while_the_machine_stands_still_is_no_silence() {
        let mut awake = Awake::default();
        let mut now_ns = 1_000_000_000_000;
        awake.look(now_ns);
        for _ in 0..10 {
            now_ns += 50_000_000;
            awake.look(now_ns);
        }
        assert_eq!(awake.ns, 500_000_000);
        awake.look(now_ns + 3_600_000_000_000);
        assert_eq!(awake.ns, 500_000_000 + LOOKED_NS, "an hour of standstill");
    }

    #[test]
    fn only_one_that_waits_for_a_processor_is_starved() {
        const PASSED_NS: u64 = 1_500_000_000;
        let before = Scheduled { ran_ns: 7, waited_ns: 5, runnable: true };
        let now = |ran_ns: u64, waited_ns: u64, runnable: bool| {
            Scheduled { ran_ns: 7 + ran_ns, waited_ns: 5 + waited_ns, runnable }.starved_since(&before, PASSED_NS)
        };
        assert!(!now(0, 0, false), "stopped, or asleep");
        assert!(!now(PASSED_NS, 0, true), "it runs in a circle");
        assert!(now(0, 0, true), "it waits and has not run at all");
        assert!(now(PASSED_NS / 6, PASSED_NS / 2 + 1, true), "one of many that want to run");
    }

    #[test]
    fn the_kernel_says_how_a_process_is_scheduled() {
        assert!(Scheduled::now(std::process::id()).is_some_and(|now| now.ran_ns > 0));
        assert!(Scheduled::now(u32::MAX / 2).is_none());
    }
}
