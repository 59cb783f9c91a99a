//! The end of a run: stops the robot, ends the processes in order, and completes the run files.

use super::copies::MANIFEST;
use super::managed_process::{ManagedProcess, ending};
use super::unfinished_runs::parts;
use super::{RunOutcome, Supervisor, stale_processes};
use bus::BusError;
use bus::clock::{self, WallClock};
use client::RUNNING_FILE;
use config::Role;
use config::file::replace;
use messages::{Heartbeat, MotorAuthority, OperatorRequest, Request, put_text};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;

/// Time for the robot to come to rest at the end of a run, ns: the longest stop ramp and a margin.
const REST_NS: u64 = 6_000_000_000;
/// From the last command to standing drums, ns: several times a drive's delay and lag.
const SETTLE_NS: u64 = 500_000_000;

/// Longest wait for motor-io's answer to the stop request.
const ANSWER: Duration = Duration::from_secs(1);
/// Longest wait for the run's disk, once the processes have ended; a service has 30 s for the whole end. A memory card
/// can stand still for a second or two.
const DISK: Duration = Duration::from_secs(5);
/// Longest wait for starts that were given up; their program is ended when its disk answers.
const LATE_STARTS: Duration = Duration::from_secs(1);
/// Longest wait for the recovery of earlier runs, once the robot is at rest and its processes have ended.
const UNFINISHED_RUNS: Duration = Duration::from_secs(5);

/// Whether the robot moves or ramps down.
pub(super) fn moves(authority: &MotorAuthority) -> bool {
    matches!(
        authority.mode,
        MotorAuthority::MODE_FOLLOWING
            | MotorAuthority::MODE_JOGGING
            | MotorAuthority::MODE_STOPPING
            | MotorAuthority::MODE_SOFT
    )
}

impl Supervisor {
    /// Stops the robot, ends every process, the recorder last, and closes the run.
    #[must_use]
    pub fn end(mut self, because: &str) -> RunOutcome {
        self.manager.stopping();
        self.mission.end(because);
        self.stop_robot();
        let mode = self.last_authority.map(|authority| authority.mode);
        let (died, run) = (std::mem::take(&mut self.died), self.folder.path().to_path_buf());
        let unfinished = self.mission.unfinished(self.last_authority.as_ref());
        self.close(because);
        let unrecorded = self.recording.gap_reasons();
        let Self {
            process_set,
            domain,
            bus,
            announcer,
            settings,
            heartbeat,
            table,
            authority,
            heartbeats,
            server,
            waiter,
            claim,
            requests,
            stopper,
            recording,
            mission,
            ..
        } = self;
        drop((
            process_set,
            announcer,
            settings,
            heartbeat,
            table,
            authority,
            heartbeats,
            server,
            waiter,
            requests,
            stopper,
            recording,
            mission,
            bus,
        ));
        // While a viewer still holds the domain, only the remains of killed processes are removed; the next start
        // removes the rest.
        let _ = domain.sweep();
        let _ = domain.release(claim);
        RunOutcome { run, died, unrecorded, unfinished, mode }
    }

    /// Requests a stop on the path and waits until the robot is at rest. If this fails, the drives still hold.
    fn stop_robot(&mut self) {
        if !self.process_set.iter_mut().any(|child| child.member.role == Role::MotorIo && child.is_alive()) {
            return;
        }
        if self.poll().is_err() || !self.last_authority.as_ref().is_some_and(moves) {
            return;
        }
        let (body, origin) = (Request::Stop.body(), OperatorRequest::ORIGIN_SUPERVISOR);
        let mut stop = OperatorRequest { body, origin, ..OperatorRequest::default() };
        put_text(&mut stop.requester, "supervisor");
        if let Err(error) = self.ask_to_stop(&stop) {
            self.announcer.warn(&format!("the stop request to motor-io failed: {error}"));
        }
        let give_up = clock::now_ns() + REST_NS;
        while clock::now_ns() < give_up {
            clock::sleep_until(clock::now_ns() + 20_000_000);
            if self.poll().is_err() || !self.last_authority.as_ref().is_some_and(moves) {
                // The drives lag behind their commands; the run file also shows them come to rest.
                clock::sleep_until(clock::now_ns() + SETTLE_NS);
                return;
            }
        }
        self.announcer.warn("the robot did not come to rest in time; the processes end now, and the drives hold");
    }

    /// Sends the request through the client that was opened at the start, which also reaches a restarted motor-io; if
    /// that fails, through a new one.
    fn ask_to_stop(&mut self, stop: &OperatorRequest) -> Result<OperatorRequest, BusError> {
        let asked = self.stopper.as_mut().map(|client| client.ask(stop, ANSWER));
        match asked {
            Some(answer @ (Ok(_) | Err(BusError::NoAnswer { .. }))) => answer,
            Some(Err(_)) | None => self.bus.client(client::MOTOR_IO)?.ask(stop, ANSWER),
        }
    }

    /// Ends the processes, recovers run files that were not closed, and completes the manifest.
    pub(super) fn close(&mut self, because: &str) {
        self.beat.state = Heartbeat::STATE_STOPPING;
        let now = self.run_unix_ns();
        self.folder.record_stopping(now);
        let mut process_set = std::mem::take(&mut self.process_set);
        let mut killed = Vec::new();
        // While the others end, the recorder still records, and motor-io still receives the supervisor's heartbeat.
        process_set.end(
            |_| {
                let _ = self.heartbeat_if_due();
                let _ = self.poll_recording();
            },
            |name| killed.push(name.to_owned()),
        );
        self.process_set = process_set;
        for name in killed {
            self.announcer.warn(&format!("{name} did not end in time and was killed"));
        }
        for name in self.file_work.finish(LATE_STARTS) {
            self.announcer.warn(&format!(
                "the start of {name} still waits for a disk that does not answer; its program may begin later, without supervision"
            ));
        }
        // The recorder publishes its final count of lost samples as it ends.
        let _ = self.poll_recording();
        self.check_recorder_exit();
        let _ = self.publish_table();
        // The run folder may have been removed since the last poll.
        self.restore_folder();
        let (troubles, is_written) = self.archive.finish(DISK);
        for trouble in troubles {
            self.announcer.warn(&trouble);
        }
        if is_written {
            self.complete_run(because);
        } else if self.run_answers() {
            self.announcer.warn("files of processes or missions are not copied: their disk does not answer");
            self.complete_run(because);
        } else {
            let run = self.folder.path().display();
            let why =
                format!("the disk of {run} does not answer: its manifest is not completed, and files may be open");
            self.recording.record_failure(&why);
            self.announcer.error(&why);
        }
        // Only this process is left in the domain; the next start removes its names.
        let _ = std::fs::remove_file(self.domain.root().join(RUNNING_FILE));
        let _ = self.domain.set_wall_clock(None);
        let _ = stale_processes::record(&self.domain, &[]);
    }

    /// Whether the manifest can be written, or is refused, in time.
    fn run_answers(&mut self) -> bool {
        let ((path, text), copies) = (self.folder.manifest(), self.folder.copies().clone());
        let work = move || {
            let _alone = copies.alone();
            replace(&path, text)
        };
        let pending = self.file_work.begin(MANIFEST, work, drop);
        pending.is_ok_and(|pending| matches!(pending.wait(DISK), Ok(Some(_))))
    }

    /// Recovers run files that were not closed, and completes the manifest.
    fn complete_run(&mut self, because: &str) {
        let run = self.folder.path().to_path_buf();
        // Every mission that was started has a copy of its own in the archive.
        let _ = std::fs::remove_dir_all(run.join(config::INBOX));
        self.recover(&run);
        let events = self.unfinished_runs.finish(UNFINISHED_RUNS);
        self.report_recovery(events);
        let processes = self.processes();
        if let Err(failure) = self.folder.close(because, processes) {
            self.recording.record_failure(&failure.to_string());
            self.announcer.error(&failure.to_string());
        }
    }

    /// A recorder that did not exit cleanly has lost its buffers.
    fn check_recorder_exit(&mut self) {
        let unclosed = |child: &ManagedProcess| match child.exit {
            Some(exit) if exit.success() && !child.has_died() => None,
            Some(_) => Some(format!("the recorder {}, so the end of the run may be missing", child.ending())),
            None => Some("the recorder does not end, so the end of the run may be missing".to_owned()),
        };
        // A recorder that was never ready has recorded nothing.
        let recorders = |child: &&ManagedProcess| child.member.role == Role::Recorder && child.ready_ns.is_some();
        let whys: Vec<String> = self.process_set.iter().filter(recorders).filter_map(unclosed).collect();
        for why in whys {
            self.recording.record_failure(&why);
            self.announcer.error(&why);
        }
    }

    /// The present time on the clock of the run, UNIX ns.
    pub(super) fn run_unix_ns(&self) -> u64 {
        let clock = self.domain.wall_clock().unwrap_or_else(WallClock::now);
        clock::now_ns().saturating_add_signed(clock.offset_ns())
    }

    /// The processes of the run, as the manifest lists them.
    fn processes(&self) -> Value {
        self.process_set
            .iter()
            .map(|child| {
                let (member, ended) = (&child.member, child.exit.map(ending));
                json!({
                    "name": member.name, "role": member.role.name(), "law": member.law, "pid": child.pid,
                    "program": member.program, "version": child.version, "program_bytes": child.program.map(|(bytes, _)| bytes),
                    "program_utc": child.program.map(|(_, changed)| utc(changed)),
                    "restarts": child.restarts.total, "ended": ended,
                })
            })
            .collect()
    }

    /// Writes the running processes into the manifest, so that an interrupted run still lists its programs.
    pub(super) fn record_processes(&mut self) {
        let processes = self.processes();
        self.folder.record_processes(processes);
        let (path, text) = self.folder.manifest();
        self.archive.write(path, text);
    }

    /// Closes the run files that a recorder left open.
    fn recover(&mut self, run: &Path) {
        for part in parts(run) {
            match runlog::recover_leaving(&part, self.context.file.recorder.min_free_bytes, &mut |_, _| {}) {
                Ok(_) => {
                    let why = format!("{} was not closed by its recorder and has been recovered", part.display());
                    if !self.recording.has_reason_for(&part) {
                        self.recording.record_failure(&why);
                    }
                    self.announcer.warn(&why);
                }
                Err(error) => {
                    let why = format!(
                        "{} could not be recovered: {error}; try again with `nims recover {}`",
                        part.display(),
                        run.display()
                    );
                    self.recording.record_failure(&why);
                    self.announcer.error(&why);
                }
            }
        }
    }
}

fn utc(time: std::time::SystemTime) -> String {
    let since = time.duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    runlog::utc(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}
