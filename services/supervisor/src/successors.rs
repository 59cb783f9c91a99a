//! `nims plug --replace`: the new program runs beside the previous one and takes over the name with its first valid
//! sample. If it ends or stays silent, the previous program continues without losing a sample.

use super::Supervisor;
use super::managed_process::AfterEnd;
use super::process_spec::ProcessSpec;
use super::refused::Decision;
use super::restarts::Restarts;
use super::successor::{Successor, is_of};
use super::table::row;
use bus::{Tap, clock};
use command::Answer;
use messages::{ProcessState, put_sentence};
use robot_state::Reason;
use robot_state::answers::detail;

/// Longest wait for the first valid sample of a new program, ns: a device may need many seconds to warm up, and the
/// requesting command waits 25 s.
const FIRST_SAMPLE_NS: u64 = 20_000_000_000;

const PREVIOUS_CONTINUES: &str = "the previous process continues";

/// Remedy for a new program that does not state why it fails.
fn cure_of(name: &str) -> String {
    format!("{PREVIOUS_CONTINUES}; if both need one device, `nims unplug {name}` first")
}

impl Supervisor {
    /// Starts a program that replaces a plugged one: beside it if that one publishes, otherwise after it has ended.
    pub(super) fn replace(&mut self, member: ProcessSpec) -> Decision {
        let name = member.name.clone();
        self.is_not_succeeded(&name)?;
        let Some((tap, mut restarts)) = self.tap_of(&name)? else {
            self.stop_one(&name, AfterEnd::Restart)?;
            if let Some(child) = self.process_set.find(&name) {
                child.member = member;
            }
            return Ok(Reason::ProcessReplaces { process: detail(name) });
        };
        restarts.record_restart();
        let child = self.spawn(&member, restarts, true)?;
        self.process_set.successors.push(Successor { child, tap, given_up: false });
        self.record_living();
        Ok(Reason::ProcessSucceeds { process: detail(name) })
    }

    /// Tap on the sensor channel of that process, and its restart counts; `None` if it publishes nothing there.
    fn tap_of(&mut self, name: &str) -> Decision<Option<(Tap, Restarts)>> {
        let channel = format!("sensor/{name}");
        let Some(child) = self.process_set.find(name) else { return Ok(None) };
        if child.asked.is_some() {
            return Err(Reason::ProcessEnding { process: detail(name) }.into());
        }
        if self.bus.channel(&channel)?.is_none() {
            return Ok(None);
        }
        let publishes = self.bus.publishers(&channel)?.iter().any(|(_, pid)| is_of(*pid, child));
        Ok(if publishes { Some((self.bus.tap(&channel)?, child.restarts)) } else { None })
    }

    /// Rejects a request for a process that is being replaced.
    pub(super) fn is_not_succeeded(&self, name: &str) -> Decision<()> {
        let waits = self.process_set.successors.iter().any(|successor| successor.child.member.name == name);
        if !waits {
            return Ok(());
        }
        Err(Reason::ProcessBeingReplaced { process: detail(name), within_s: FIRST_SAMPLE_NS as f64 * 1e-9 }.into())
    }

    /// Gives the name to a successor that has published a valid sample; gives up one that has ended or is silent too
    /// long.
    pub(super) fn poll_successors(&mut self) -> Answer {
        let now = clock::now_ns();
        let mut successors = std::mem::take(&mut self.process_set.successors);
        let mut looked = Ok(());
        for successor in &mut successors {
            looked = looked.and(self.poll_successor(successor, now));
        }
        let before = successors.len();
        successors.retain(|successor| successor.child.exit.is_none());
        let ended = before - successors.len();
        self.process_set.successors = successors;
        looked?;
        if ended > 0 {
            self.cleanup.request(now);
            self.record_living();
            self.publish_table()?;
        }
        Ok(())
    }

    fn poll_successor(&mut self, successor: &mut Successor, now: u64) -> Answer {
        let name = successor.child.member.name.clone();
        if !successor.child.is_alive() {
            if !successor.given_up {
                let ending = successor.child.ending();
                // Its own diagnostic comes last, because it states what to do.
                let why = match successor.child.last_diagnostic() {
                    Some(words) => format!("{ending} ({PREVIOUS_CONTINUES}): {words}"),
                    None => format!("{ending}; {}", cure_of(&name)),
                };
                self.give_up(successor, &why)?;
            }
            return Ok(());
        }
        if successor.given_up {
            successor.child.kill_if_overdue(now);
            return Ok(());
        }
        if successor.has_published(&self.bus)? {
            if let Some(child) = self.process_set.find(&name).filter(|child| child.asked.is_none()) {
                child.ask_to_end(AfterEnd::Restart);
                self.announcer.info(&format!("the new {name} publishes: ending the previous process"));
                self.publish_table()?;
            }
            return Ok(());
        }
        let is_asked = self.process_set.find(&name).is_some_and(|child| child.asked.is_some());
        if !is_asked && now >= successor.child.started_ns + FIRST_SAMPLE_NS {
            let why =
                format!("published no valid sample within {} s; {}", FIRST_SAMPLE_NS / 1_000_000_000, cure_of(&name));
            self.give_up(successor, &why)?;
            successor.child.ask_to_end(AfterEnd::Remove);
        }
        Ok(())
    }

    /// Gives up a new process and reports the reason on `system/process` and on the terminal.
    fn give_up(&mut self, successor: &mut Successor, why: &str) -> Answer {
        successor.given_up = true;
        self.announcer.warn(&format!("the new {} {why}", successor.child.member.name));
        let mut row = row(&successor.child, false);
        // The row informs the requesting command; the following table shows the previous process, which still runs.
        row.state = ProcessState::STATE_STOPPED;
        put_sentence(&mut row.reason, why);
        self.send_row(&mut row)?;
        self.publish_table()
    }

    /// Puts the successor in the place of a process that has ended; false if it has no successor.
    pub(super) fn succeed(&mut self, name: &str) -> bool {
        let waits = |successor: &Successor| successor.child.member.name == name && !successor.given_up;
        let Some(at) = self.process_set.successors.iter().position(waits) else { return false };
        let Successor { child, .. } = self.process_set.successors.remove(at);
        if let Some(before) = self.process_set.find(name) {
            let (died, sentence) =
                (before.has_died(), format!("{name} {}; the new one has its place", before.ending()));
            if died {
                self.announcer.error(&sentence);
                self.died.push(name.to_owned());
            } else {
                self.announcer.info(&sentence);
            }
        }
        self.process_set.insert(child);
        self.record_living();
        true
    }
}
