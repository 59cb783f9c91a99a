//! Heartbeats of the processes: which are ready, and which are silent.

use super::process_set::ProcessSet;
use bus::{Bus, Subscriber, clock};
use command::Answer;
use evidence::State;
use messages::{Heartbeat, text_of};
use std::collections::BTreeMap;

/// Heartbeats come five times a second; a process without one for this long hangs, ns.
const SILENT_NS: u64 = 2_000_000_000;
/// Silence after which the scheduling of a process is examined, ns.
const SUSPECT_NS: u64 = 500_000_000;
/// A process that was blocked in the kernel within this time counts as waiting for its disk, ns: it may sleep briefly
/// between two disk accesses.
const BLOCKED_NS: u64 = 500_000_000;
/// Longest time between two polls that counts as silence, ns. Beyond it, this program or the machine stood still.
const LOOKED_NS: u64 = 250_000_000;

/// Last heartbeat of each process, by name.
#[derive(Default)]
pub struct Heartbeats {
    records: BTreeMap<String, HeartbeatRecord>,
    awake: AwakeClock,
    /// The scheduling of a process was examined in the last poll.
    suspects: bool,
}

struct HeartbeatRecord {
    subscriber: Subscriber<Heartbeat>,
    /// Time of the last heartbeat, on the [`AwakeClock`], and its process id.
    last: Option<(u64, u32)>,
    silence: SilenceAnalysis,
}

/// Scheduling of a process since its silence exceeded [`SUSPECT_NS`]; times are on the [`AwakeClock`].
#[derive(Debug, Default)]
struct SilenceAnalysis {
    /// Start of the analysis, and the scheduling until then.
    began: Option<(u64, Scheduled)>,
    /// Scheduling at the last poll.
    seen: Option<(u64, Scheduled)>,
    /// Length of the present wait for a processor: the kernel counts a wait only when it is over.
    pending_ns: u64,
    /// Time at which it was last blocked in the kernel.
    blocked_ns: Option<u64>,
}

/// Why a process is silent although it does not hang.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SilenceCause {
    /// It gets no processor time.
    Starved,
    /// It is blocked in the kernel, because its disk does not answer; even SIGKILL would not end it.
    Blocked,
}

/// A clock that runs only while this program runs, so that a standstill of the machine does not count as silence.
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

/// Change in the state of a process, by name; times in s.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// The first heartbeat in state ready has arrived.
    Ready(String),
    /// No heartbeat for this time, although it had processor time: it hangs.
    Silent(String, u64),
    /// No heartbeat for this time, because it got no processor time.
    Starved(String, u64),
    /// No heartbeat for this time, because it waits for its disk.
    Blocked(String, u64),
    /// Heartbeats arrive again.
    Back(String),
}

impl Heartbeats {
    /// Subscribes to the heartbeats of a process that is about to be started.
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

    /// Drops the subscription.
    pub fn unsubscribe(&mut self, name: &str) {
        self.records.remove(name);
    }

    /// Returns whether a process has been silent for so long that its scheduling is examined.
    #[must_use]
    pub fn suspects(&self) -> bool {
        self.suspects
    }

    /// Receives the heartbeats and returns the changes.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn poll(&mut self, process_set: &mut ProcessSet) -> Answer<Vec<Change>> {
        let now = clock::now_ns();
        let awake_ns = self.awake.poll(now);
        let mut changes = Vec::new();
        self.suspects = false;
        for child in process_set.iter_mut() {
            let Some(record) = self.records.get_mut(&child.member.name) else { continue };
            while let Some(beat) = record.subscriber.receive()? {
                // A heartbeat of an earlier incarnation, or of a foreign process of that name.
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
            self.suspects |= silent_ns >= SUSPECT_NS;
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
    /// Returns why the process is silent; `None` if it hangs or is not silent.
    fn cause(&mut self, pid: u32, silent_ns: u64, awake_ns: u64) -> Option<SilenceCause> {
        if silent_ns < SUSPECT_NS {
            self.silence = SilenceAnalysis::default();
            return None;
        }
        self.silence.classify(awake_ns, state_of(pid), Scheduled::now(pid))
    }
}

impl SilenceAnalysis {
    /// Returns the cause of the silence; `None` if the process hangs.
    ///
    /// A process that is or was just blocked in the kernel waits for its disk. It is starved if it waited for a
    /// processor for more than half of the time since the analysis began. A stopped or deadlocked process does not wait
    /// for a processor, even when it continues, and a process in an endless loop has one.
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

/// Returns the kernel's state of the process; `None` if it cannot be read.
fn state_of(pid: u32) -> Option<State> {
    evidence::Thread::with_id(pid).ok().map(|thread| thread.state())
}

/// Scheduling of a process, as the kernel counts it.
#[derive(Debug, Clone, Copy)]
struct Scheduled {
    /// Time on a processor.
    ran_ns: u64,
    /// Time of completed waits for a processor.
    waited_ns: u64,
    /// It runs or waits for a processor.
    runnable: bool,
}

impl Scheduled {
    /// Reads the present scheduling; `None` if it cannot be read.
    fn now(pid: u32) -> Option<Self> {
        let schedstat = std::fs::read_to_string(format!("/proc/{pid}/schedstat")).ok()?;
        let mut fields = schedstat.split_whitespace().map(str::parse::<u64>);
        let (ran_ns, waited_ns) = (fields.next()?.ok()?, fields.next()?.ok()?);
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The name in parentheses may contain any character, so the state is read after the last parenthesis.
        let runnable = stat.rsplit_once(')')?.1.trim_start().starts_with('R');
        Some(Self { ran_ns, waited_ns, runnable })
    }

    /// Whether it waited for a processor all the time between these two polls.
    fn waits_until(&self, next: &Self) -> bool {
        self.runnable && next.runnable && (self.ran_ns, self.waited_ns) == (next.ran_ns, next.waited_ns)
    }

    /// Whether it waited for a processor for more than half of the time that passed since `before`.
    fn starved_since(&self, before: &Self, pending_ns: u64, passed_ns: u64) -> bool {
        let waited_ns = self.waited_ns.saturating_sub(before.waited_ns).saturating_add(pending_ns);
        waited_ns.saturating_mul(2) > passed_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_of_the_machine_is_not_counted_as_a_missing_heartbeat() {
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
    fn only_a_process_that_waits_for_a_processor_is_starved() {
        const PASSED_NS: u64 = 1_500_000_000;
        let before = Scheduled { ran_ns: 7, waited_ns: 5, runnable: true };
        let now = |ran_ns: u64, waited_ns: u64, pending_ns: u64| {
            let now = Scheduled { ran_ns: 7 + ran_ns, waited_ns: 5 + waited_ns, runnable: true };
            now.starved_since(&before, pending_ns, PASSED_NS)
        };
        assert!(!now(0, 0, 0), "stopped or asleep");
        assert!(!now(PASSED_NS, 0, 0), "endless loop");
        assert!(now(0, 0, PASSED_NS), "waits without running");
        assert!(now(PASSED_NS / 6, PASSED_NS / 2 + 1, 0), "one of many runnable processes");
    }

    #[test]
    fn a_stopped_process_that_continues_has_not_waited_for_a_processor() {
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
        assert_eq!(judged, Some(SilenceCause::Starved), "runnable all the time without running");
    }

    #[test]
    fn a_process_that_waits_for_its_disk_does_not_count_as_hung() {
        let asleep = Scheduled { ran_ns: 7, waited_ns: 5, runnable: false };
        let mut silence = SilenceAnalysis::default();
        let mut judge = |ms: u64, state| silence.classify(ms * 1_000_000, Some(state), Some(asleep));
        assert_eq!(judge(1000, State::Asleep), None);
        assert_eq!(judge(1050, State::Blocked), Some(SilenceCause::Blocked));
        assert_eq!(judge(1100, State::Asleep), Some(SilenceCause::Blocked), "briefly asleep between two disk accesses");
        assert_eq!(judge(1600, State::Asleep), None, "still silent after the disk has answered");
        assert_eq!(judge(1650, State::Blocked), Some(SilenceCause::Blocked));
        assert_eq!(judge(2500, State::Stopped), None);
        let mut unknown = SilenceAnalysis::default();
        assert_eq!(unknown.classify(1, Some(State::Blocked), None), Some(SilenceCause::Blocked));
        assert_eq!(SilenceAnalysis::default().classify(1, None, None), None);
    }

    #[test]
    fn the_scheduling_of_a_process_is_read_from_the_kernel() {
        assert!(Scheduled::now(std::process::id()).is_some_and(|now| now.ran_ns > 0));
        assert!(Scheduled::now(u32::MAX / 2).is_none());
    }
}
