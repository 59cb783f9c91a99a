//! The heartbeats of the processes: who is ready, and who is silent.

use super::process_set::ProcessSet;
use bus::{Bus, Subscriber, clock};
use command::Answer;
use evidence::State;
use messages::{Heartbeat, text_of};
use std::collections::BTreeMap;

/// Heartbeats come five times a second; a process without one for this long hangs, ns.
const SILENT_NS: u64 = 2_000_000_000;
/// A process that has been silent for this long is looked at more closely, ns.
const SUSPECT_NS: u64 = 500_000_000;
/// A process that was seen blocked in the kernel within this time still waits for its disk, ns: between two blocks it
/// may sleep for a moment.
const BLOCKED_NS: u64 = 500_000_000;
/// Longer than this between two looks, and it is this program, with the rest of the machine, that stood still, ns.
const LOOKED_NS: u64 = 250_000_000;

/// Heartbeats by the name of their process.
#[derive(Default)]
pub struct Heartbeats {
    records: BTreeMap<String, HeartbeatRecord>,
    awake: AwakeClock,
}

struct HeartbeatRecord {
    subscriber: Subscriber<Heartbeat>,
    /// The last one: when, on the clock of [`AwakeClock`], and of which process.
    last: Option<(u64, u32)>,
    silence: SilenceAnalysis,
}

/// What is known of a process since it began to be suspect, on the clock of [`AwakeClock`].
#[derive(Debug, Default)]
struct SilenceAnalysis {
    /// When it began, and how the process had been scheduled until then.
    began: Option<(u64, Scheduled)>,
    /// How it was scheduled at the last look, and for how long it has been seen waiting for a processor since: the
    /// kernel counts a wait when it is over.
    seen: Option<(u64, Scheduled)>,
    pending_ns: u64,
    /// When it was last seen blocked in the kernel.
    blocked_ns: Option<u64>,
}

/// Why a process is silent that does not hang.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SilenceCause {
    /// The machine has no time for it.
    Starved,
    /// It is blocked in the kernel: its disk does not answer. Not even a kill would end it.
    Blocked,
}

/// A clock that runs only while this program does: what passes while the whole machine stands still is nobody's
/// silence.
#[derive(Debug, Default)]
struct AwakeClock {
    ns: u64,
    looked_ns: Option<u64>,
}

impl AwakeClock {
    fn poll(&mut self, now_ns: u64) -> u64 {
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
    /// It has shown none, because it waits for its disk.
    Blocked(String, u64),
    /// It shows signs of life again.
    Back(String),
}

impl Heartbeats {
    /// Listens to a process that is about to be started.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn listen(&mut self, bus: &Bus, name: &str) -> Answer {
        if !self.records.contains_key(name) {
            let subscriber = bus.subscriber(&format!("system/heartbeat/{name}"))?;
            self.records.insert(
                name.to_owned(),
                HeartbeatRecord { subscriber, last: None, silence: SilenceAnalysis::default() },
            );
        }
        Ok(())
    }

    /// Listens to it no longer.
    pub fn forget(&mut self, name: &str) {
        self.records.remove(name);
    }

    /// Takes in what has come, and says what has changed.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn poll(&mut self, process_set: &mut ProcessSet) -> Answer<Vec<Change>> {
        let now = clock::now_ns();
        let awake_ns = self.awake.poll(now);
        let mut changes = Vec::new();
        for child in process_set.iter_mut() {
            let Some(record) = self.records.get_mut(&child.member.name) else { continue };
            while let Some(beat) = record.subscriber.receive()? {
                // An earlier life, or a stranger of that name, says nothing about this one.
                if beat.pid != child.pid {
                    continue;
                }
                record.last = Some((awake_ns, beat.pid));
                if beat.state == Heartbeat::STATE_READY && child.ready_ns.is_none() {
                    child.ready_ns = Some(now);
                    child.version = Some(text_of(&beat.version)).filter(|version| !version.is_empty());
                    changes.push(Change::Ready(child.member.name.clone()));
                }
            }
            let expected = child.ready_ns.is_some() && child.exit.is_none() && child.asked.is_none();
            let silent_ns = match record.last {
                Some((at_ns, pid)) if pid == child.pid && expected => awake_ns.saturating_sub(at_ns),
                _ => 0,
            };
            let cause = record.cause(child.pid, silent_ns, awake_ns);
            let silent = silent_ns > SILENT_NS;
            let hangs = silent && cause.is_none();
            child.blocked = silent && cause == Some(SilenceCause::Blocked);
            if (silent, hangs) == (child.silent, child.hangs) {
                continue;
            }
            (child.silent, child.hangs) = (silent, hangs);
            let (name, seconds) = (child.member.name.clone(), SILENT_NS / 1_000_000_000);
            changes.push(match (silent, cause) {
                (false, _) => Change::Back(name),
                (true, Some(SilenceCause::Starved)) => Change::Starved(name, seconds),
                (true, Some(SilenceCause::Blocked)) => Change::Blocked(name, seconds),
                (true, None) => Change::Silent(name, seconds),
            });
        }
        Ok(changes)
    }
}

impl HeartbeatRecord {
    /// Why the process is silent, if it does not hang.
    fn cause(&mut self, pid: u32, silent_ns: u64, awake_ns: u64) -> Option<SilenceCause> {
        if silent_ns < SUSPECT_NS {
            self.silence = SilenceAnalysis::default();
            return None;
        }
        self.silence.classify(awake_ns, state_of(pid), Scheduled::now(pid))
    }
}

impl SilenceAnalysis {
    /// A process that is or was just blocked in the kernel waits for its disk. The machine had no time for one that,
    /// since it began to be suspect, waited for a processor for more than half of the time. One that was stopped, or
    /// waits for something that never comes, does not, not even in the moment in which it goes on, and one that runs in
    /// a circle has its processor.
    fn classify(&mut self, awake_ns: u64, state: Option<State>, now: Option<Scheduled>) -> Option<SilenceCause> {
        if state == Some(State::Blocked) {
            self.blocked_ns = Some(awake_ns);
        }
        let starved = now.is_some_and(|now| {
            let (since_ns, before) = *self.began.get_or_insert((awake_ns, now));
            let still = self.seen.replace((awake_ns, now)).filter(|(_, seen)| seen.waits_until(&now));
            self.pending_ns = still.map_or(0, |(at_ns, _)| self.pending_ns + awake_ns.saturating_sub(at_ns));
            now.starved_since(&before, self.pending_ns, awake_ns.saturating_sub(since_ns))
        });
        if self.blocked_ns.is_some_and(|at_ns| awake_ns.saturating_sub(at_ns) < BLOCKED_NS) {
            return Some(SilenceCause::Blocked);
        }
        starved.then_some(SilenceCause::Starved)
    }
}

/// What the process does; `None` where the kernel does not say.
fn state_of(pid: u32) -> Option<State> {
    evidence::Thread::of(pid).ok().map(|thread| thread.state())
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

    /// Whether it wanted to run from this look to the next one and did not.
    fn waits_until(&self, next: &Self) -> bool {
        self.runnable && next.runnable && (self.ran_ns, self.waited_ns) == (next.ran_ns, next.waited_ns)
    }

    fn starved_since(&self, before: &Self, pending_ns: u64, passed_ns: u64) -> bool {
        let waited_ns = self.waited_ns.saturating_sub(before.waited_ns).saturating_add(pending_ns);
        waited_ns.saturating_mul(2) > passed_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_passes_while_the_machine_stands_still_is_no_silence() {
        let mut awake = AwakeClock::default();
        let mut now_ns = 1_000_000_000_000;
        awake.poll(now_ns);
        for _ in 0..10 {
            now_ns += 50_000_000;
            awake.poll(now_ns);
        }
        assert_eq!(awake.ns, 500_000_000);
        awake.poll(now_ns + 3_600_000_000_000);
        assert_eq!(awake.ns, 500_000_000 + LOOKED_NS, "an hour of standstill");
    }

    #[test]
    fn only_one_that_waits_for_a_processor_is_starved() {
        const PASSED_NS: u64 = 1_500_000_000;
        let before = Scheduled { ran_ns: 7, waited_ns: 5, runnable: true };
        let now = |ran_ns: u64, waited_ns: u64, pending_ns: u64| {
            let now = Scheduled { ran_ns: 7 + ran_ns, waited_ns: 5 + waited_ns, runnable: true };
            now.starved_since(&before, pending_ns, PASSED_NS)
        };
        assert!(!now(0, 0, 0), "stopped, or asleep");
        assert!(!now(PASSED_NS, 0, 0), "it runs in a circle");
        assert!(now(0, 0, PASSED_NS), "it waits and has not run at all");
        assert!(now(PASSED_NS / 6, PASSED_NS / 2 + 1, 0), "one of many that want to run");
    }

    #[test]
    fn one_that_was_stopped_has_not_waited_for_a_processor_when_it_goes_on() {
        let at = |ran_ns: u64, runnable: bool| Scheduled { ran_ns, waited_ns: 5, runnable };
        let mut stopped = SilenceAnalysis::default();
        for ms in (500..6600).step_by(50) {
            assert_eq!(stopped.classify(ms * 1_000_000, Some(State::Stopped), Some(at(7, false))), None, "{ms}");
        }
        for (ms, ran_ns) in [(6600, 7), (6650, 7), (6700, 30_000_000)] {
            assert_eq!(stopped.classify(ms * 1_000_000, Some(State::Runnable), Some(at(ran_ns, true))), None, "{ms}");
        }
        let mut starved = SilenceAnalysis::default();
        let mut judged = None;
        for ms in (500..2050).step_by(50) {
            judged = starved.classify(ms * 1_000_000, Some(State::Runnable), Some(at(7, true)));
        }
        assert_eq!(judged, Some(SilenceCause::Starved), "it was runnable all the time, and never ran");
    }

    #[test]
    fn one_that_waits_for_its_disk_does_not_hang() {
        let asleep = Scheduled { ran_ns: 7, waited_ns: 5, runnable: false };
        let mut silence = SilenceAnalysis::default();
        let mut judge = |ms: u64, state| silence.classify(ms * 1_000_000, Some(state), Some(asleep));
        assert_eq!(judge(1000, State::Asleep), None);
        assert_eq!(judge(1050, State::Blocked), Some(SilenceCause::Blocked));
        assert_eq!(judge(1100, State::Asleep), Some(SilenceCause::Blocked), "asleep for a moment between two blocks");
        assert_eq!(judge(1600, State::Asleep), None, "the disk has answered, and it still says nothing");
        assert_eq!(judge(1650, State::Blocked), Some(SilenceCause::Blocked));
        assert_eq!(judge(2500, State::Stopped), None);
        let mut unknown = SilenceAnalysis::default();
        assert_eq!(unknown.classify(1, Some(State::Blocked), None), Some(SilenceCause::Blocked));
        assert_eq!(SilenceAnalysis::default().classify(1, None, None), None);
    }

    #[test]
    fn the_kernel_says_how_a_process_is_scheduled() {
        assert!(Scheduled::now(std::process::id()).is_some_and(|now| now.ran_ns > 0));
        assert!(Scheduled::now(u32::MAX / 2).is_none());
    }
}
