//! One cycle of the supervisor: its heartbeat, the processes and their heartbeats, requests, and restarts.

use super::Supervisor;
use super::cures::{LossState, consequence, cure};
use super::heartbeats::Change;
use super::managed_process::{AfterEnd, ManagedProcess};
use super::process_spec::ProcessSpec;
use super::recording::RecordingEvent;
use super::refused::Refused;
use super::restarts::{Restarts, Verdict};
use super::starting::READY_NS;
use super::unfinished_runs::RecoveryEvent;
use bus::clock;
use command::Answer;
use config::Role;
use evidence::busy;
use messages::{Heartbeat, OperatorRequest, Request, newer};
use robot_state::sentences::mode_name;
use std::time::Duration;

/// Polling period of the processes and their heartbeats, ns. The end of a process and a request end a wait at once.
const POLL_NS: u64 = 100_000_000;
/// The same while a process starts, is being replaced, or is suspected to be silent, ns.
const EARLY_POLL_NS: u64 = 50_000_000;
/// Period of the supervisor's heartbeat, ns: motor-io treats it as dead after two seconds without one.
const BEAT_NS: u64 = 200_000_000;
/// Pause before a start that failed for lack of memory, processes or files is repeated, ns.
const RETRY_NS: u64 = 2_000_000_000;

impl Supervisor {
    /// Supervises the processes for this time, or until the end is requested.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn watch(&mut self, time: Duration) -> Answer {
        let deadline = clock::now_ns().saturating_add(time.as_nanos().min(u128::from(u64::MAX)) as u64);
        loop {
            self.poll()?;
            self.serve()?;
            self.report_status();
            self.manager.supervised();
            let now = clock::now_ns();
            if now >= deadline || self.is_stopping() {
                return Ok(());
            }
            if self.waiter.wait_until(Some(deadline.min(self.next_poll_ns(now))))?.descriptor(0) {
                self.wakeup.clear();
            }
        }
    }

    /// When the next cycle is due if nothing wakes the loop before.
    fn next_poll_ns(&self, now_ns: u64) -> u64 {
        let starting =
            |child: &ManagedProcess| child.member.sends_heartbeats && child.ready_ns.is_none() && child.exit.is_none();
        let early = !self.process_set.successors.is_empty()
            || self.heartbeats.suspects()
            || self.process_set.iter().any(starting);
        let restarts = self.process_set.iter().filter_map(|child| child.again_ns).min();
        let poll_ns = now_ns + if early { EARLY_POLL_NS } else { POLL_NS };
        restarts.map_or(poll_ns, |at_ns| at_ns.clamp(now_ns, poll_ns))
    }

    /// One cycle without requests.
    pub(super) fn poll(&mut self) -> Answer {
        self.poll_heartbeats()?;
        self.poll_children()?;
        self.poll_successors()?;
        self.last_authority = newer(self.last_authority, self.authority.latest()?);
        self.poll_run_files()?;
        self.poll_computer_load();
        self.settings.update()?;
        self.heartbeat_if_due()?;
        self.refresh_table()
    }

    pub(super) fn poll_heartbeats(&mut self) -> Answer {
        let changes = self.heartbeats.poll(&mut self.process_set)?;
        for change in &changes {
            match change {
                Change::Ready(name) => {
                    self.announcer.info(&format!("{name} is ready"));
                    if self.process_set.find(name).is_some_and(|child| child.member.role == Role::Recorder) {
                        let now = self.run_unix_ns();
                        self.folder.record_first_recording(now);
                    }
                }
                Change::Silent(name, seconds) => self.handle_hang(name, *seconds),
                Change::Starved(name, seconds) => self.announcer.warn(&format!(
                    "{name} has shown no sign of life for {seconds} s, because it gets no processor time: look for other programs that load this machine"
                )),
                Change::Blocked(name, seconds) => self.announcer.warn(&format!(
                    "{name} has shown no sign of life for {seconds} s, because it waits for its disk: it is not killed and continues when the disk answers; check the disk and what else writes to it"
                )),
                Change::Back(name) => self.announcer.warn(&format!("{name} is back")),
            }
        }
        if self.beat.state == Heartbeat::STATE_READY && changes.iter().any(|change| matches!(change, Change::Ready(_)))
        {
            self.record_processes();
        }
        if changes.is_empty() { Ok(()) } else { self.publish_table() }
    }

    /// Reports a process that hangs, and kills it if its policy restarts it.
    fn handle_hang(&mut self, name: &str, seconds: u64) {
        let Some(child) = self.process_set.find(name) else { return };
        let (member, again) = (child.member.clone(), child.member.restart.again);
        if again {
            child.end_hung();
        }
        let means = self.consequence_of(&member, if again { LossState::Terminated } else { LossState::Hangs }, "");
        let sentence =
            format!("{name} has shown no sign of life for {seconds} s, because it was stopped or hangs: {means}");
        if member.role == Role::Recorder {
            self.recording.record_failure(&format!("the recorder sent no heartbeat for {seconds} s"));
        }
        self.announcer.error(&sentence);
    }

    /// Reports when the computer becomes too busy for the robot, and when it recovers.
    fn poll_computer_load(&mut self) {
        match self.busy.poll(clock::now_ns()) {
            Some(busy::Change::Busy(share)) => {
                let share = 100.0 * share;
                self.announcer.warn(&format!(
                    "the computer is busy: something had to wait for a processor in {share:.0} % of the last two seconds; {}",
                    busy::CURE
                ));
            }
            Some(busy::Change::Over) => self.announcer.info("the computer is no longer busy"),
            None => {}
        }
    }

    /// Updates the run folder, and reports the recovery of earlier runs.
    fn poll_run_files(&mut self) -> Answer {
        while let Some(request) = self.requests.receive()? {
            if (request.answered, request.accepted) == (1, OperatorRequest::ACCEPTED)
                && let Ok(Request::Run { mission, hash, .. }) = Request::decode(&request)
            {
                self.archive.copy_mission(&mission, config::mission_copy(self.folder.path(), &hash));
            }
        }
        self.poll_recording()?;
        if let Some(sentence) = self.mission.poll(self.last_authority.as_ref())? {
            self.announcer.error(&sentence);
        }
        for report in self.archive.take_reports() {
            self.announcer.warn(&report);
        }
        let news = self.unfinished_runs.new_events();
        self.report_recovery(news);
        Ok(())
    }

    /// Reports gaps and losses of the recording.
    pub(super) fn poll_recording(&mut self) -> Answer {
        for said in self.recording.poll(clock::now_ns())? {
            match said {
                RecordingEvent::Stopped(sentence) => {
                    self.announcer.error(&sentence);
                    // The recorder waits a second before it begins the next file; until then the files that it attaches
                    // are restored.
                    self.restore_folder();
                }
                RecordingEvent::Resumed(sentence) => {
                    self.announcer.warn(&sentence);
                    self.restore_folder();
                }
                RecordingEvent::Lost(sentence) => self.announcer.warn(&sentence),
            }
        }
        Ok(())
    }

    /// Reports the recovery of earlier runs.
    pub(super) fn report_recovery(&mut self, news: Vec<RecoveryEvent>) {
        for news in news {
            match news {
                RecoveryEvent::Started(sentence) => self.announcer.info(&sentence),
                RecoveryEvent::Recovered(sentence) => self.announcer.warn(&sentence),
                RecoveryEvent::Failed(sentence) => self.announcer.error(&sentence),
            }
        }
    }

    fn poll_children(&mut self) -> Answer {
        let now = clock::now_ns();
        let (mut ended, mut due) = (Vec::new(), Vec::new());
        for child in self.process_set.iter_mut() {
            if child.exit.is_none() && !child.is_alive() {
                ended.push(child.member.name.clone());
            }
            if child.kill_if_overdue(now) {
                self.announcer.warn(&format!("{} did not end in time and is killed", child.member.name));
            }
            let starting = child.member.sends_heartbeats && child.ready_ns.is_none() && child.exit.is_none();
            if starting && !child.overdue && child.asked.is_none() && now >= child.started_ns + READY_NS {
                child.overdue = true;
                self.announcer.warn(&format!(
                    "{} does not become ready within {} s: see {}",
                    child.member.name,
                    READY_NS / 1_000_000_000,
                    self.folder.log(&child.member.name).display()
                ));
            }
            if child.again_ns.is_some_and(|at| at <= now) {
                child.again_ns = None;
                due.push((child.member.clone(), child.restarts));
            }
        }
        for name in &ended {
            self.has_ended(name)?;
        }
        if !ended.is_empty() {
            self.cleanup.request(now);
            self.publish_table()?;
        }
        if let Some(why) = self.cleanup.poll(now) {
            self.announcer.warn(&format!("the remains of a dead process in shared memory are not removed yet: {why}"));
        }
        for (member, restarts) in due {
            self.start_again(&member, restarts)?;
        }
        Ok(())
    }

    /// Reports how a process ended, and decides what follows.
    fn has_ended(&mut self, name: &str) -> Answer {
        if self.succeed(name) {
            return Ok(());
        }
        let Some(child) = self.process_set.find(name) else { return Ok(()) };
        let (member, asked) = (child.member.clone(), child.asked);
        let how = child.ending();
        match asked {
            Some((_, then)) => {
                self.announcer.info(&format!("{name} {how}, as requested"));
                match then {
                    AfterEnd::Stay => {}
                    AfterEnd::Restart => {
                        let restarts = child.restarts;
                        self.start_again(&member, restarts)?;
                    }
                    AfterEnd::Remove => self.forget(name)?,
                }
            }
            None => {
                let died = child.has_died();
                // The last diagnostic of a hung process does not explain its end.
                let words = child.last_diagnostic().filter(|_| !child.hung).map(|words| format!(" ({words})"));
                let words = words.unwrap_or_default();
                let well_ns = child.ready_ns.map_or(0, |ready_ns| clock::now_ns().saturating_sub(ready_ns));
                let verdict = child.restarts.decide(&member.restart, well_ns);
                let (next, fate) = match verdict {
                    Verdict::Never => (String::new(), LossState::Dead),
                    Verdict::After(pause_ns) => {
                        child.again_ns = Some(clock::now_ns() + pause_ns);
                        (format!("; it is started again in {:.1} s", pause_ns as f64 * 1e-9), LossState::Restarts)
                    }
                    Verdict::GaveUp => {
                        child.gave_up = true;
                        ("; it died too often to be restarted automatically".to_owned(), LossState::Dead)
                    }
                };
                if died {
                    let means = self.consequence_of(&member, fate, &next);
                    self.announcer.error(&format!("{name} {how}{words}: {means}"));
                    self.died.push(name.to_owned());
                } else {
                    self.announcer.warn(&format!("{name} {how}{words}{next}"));
                }
            }
        }
        Ok(())
    }

    /// Removes an ended process from the table.
    pub(super) fn forget(&mut self, name: &str) -> Answer {
        self.process_set.remove(|child| child.member.name == name && child.exit.is_some());
        self.heartbeats.unsubscribe(name);
        self.publish_farewell(name)
    }

    fn start_again(&mut self, member: &ProcessSpec, mut restarts: Restarts) -> Answer {
        restarts.record_restart();
        self.announcer.warn(&format!("starting {} again", member.name));
        // A failed restart must not stop the supervision of the other processes.
        if let Err(Refused(reason)) = self.launch(member, restarts) {
            self.announcer.warn(&format!("{reason}; trying again in {} s", RETRY_NS / 1_000_000_000));
            if let Some(child) = self.process_set.find(&member.name).filter(|child| child.exit.is_some()) {
                child.again_ns = Some(clock::now_ns() + RETRY_NS);
            }
        }
        self.publish_table()
    }

    /// Consequence of the loss of that process, the automatic action `next`, and the remedy.
    fn consequence_of(&self, member: &ProcessSpec, fate: LossState, next: &str) -> String {
        let other = self.process_set.standby_of(member);
        let means = match other {
            Some(other) => format!("{} continues", other.member.name),
            None => consequence(member.role, self.context.file.motor_io.watchdog_s),
        };
        match cure(&member.name, member.role, fate, other.is_some()) {
            Some(cure) => format!("{means}{next}; {cure}"),
            None => format!("{means}{next}"),
        }
    }

    /// Gives the service manager the line that `systemctl status` shows.
    pub(super) fn report_status(&mut self) {
        if !self.manager.is_there() {
            return;
        }
        let mode = self.last_authority.map_or("starting", |authority| mode_name(authority.mode));
        let running = self.process_set.iter().filter(|child| child.exit.is_none()).count();
        let died = if self.died.is_empty() { String::new() } else { format!("; died: {}", self.died.join(", ")) };
        let run = self.folder.path().display();
        self.manager.set_status(&format!("{mode}; {running} processes{died}; {run}"));
    }

    /// Publishes the supervisor's heartbeat if it is due.
    pub(super) fn heartbeat_if_due(&mut self) -> Answer {
        let now = clock::now_ns();
        if now >= self.last_beat_ns + BEAT_NS {
            self.last_beat_ns = now;
            self.beat.beat += 1;
            self.beat.passes = self.beat.beat;
            self.beat.header.stamp_ns = now;
            self.beat.header.oldest_input_ns = now;
            self.heartbeat.send(&mut self.beat)?;
        }
        Ok(())
    }
}
