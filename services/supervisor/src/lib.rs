//! Starts, watches and stops the processes of a system.
//!
//! Architecture invariant: the supervisor is not in the control loop. It may die at any instant: motor-io then stops
//! the robot on its path and holds it, and the next supervisor of the domain ends the processes that are left.
//!
//! Architecture invariant: the supervisor never blocks on one process while others run. Its own heartbeat would stop,
//! and motor-io would stop the robot. Nor does it block on a disk: files of the run are written on the thread of the
//! archive, and a process is started on a thread of its own, for which the loop waits 1.5 s at most.
#![forbid(unsafe_code)]

mod announcer;
mod archive;
mod cleanup;
mod closing;
mod copies;
mod cures;
mod file_work;
mod heartbeats;
mod managed_process;
mod mission;
mod process_set;
mod process_spec;
mod program;
mod recording;
mod refused;
mod requests;
mod restarts;
mod run_folder;
mod service_manager;
mod settings;
mod stale_processes;
mod starting;
mod successor;
mod successors;
mod table;
mod tuning;
mod unfinished_runs;
mod wakeup;
mod watching;

pub use cures::consequence;
pub use program::{Args, run};
pub use run_folder::RunFolder;

use announcer::Announcer;
use archive::Archive;
use bus::{Bus, Claim, Client, Domain, Newest, Publisher, Server, Subscriber, Waiter};
use cleanup::Cleanup;
use config::SystemFile;
use evidence::busy;
use file_work::FileWork;
use heartbeats::Heartbeats;
use messages::{Heartbeat, MotorAuthority, OperatorRequest, ProcessState};
use mission::Missions;
use process_set::ProcessSet;
use process_spec::RunContext;
use recording::Recording;
use service_manager::ServiceManager;
use settings::Settings;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use unfinished_runs::UnfinishedRuns;
use wakeup::Wakeup;

/// What a supervisor starts.
#[derive(Debug, Clone, Copy)]
pub struct StartOptions<'a> {
    /// System file.
    pub system_path: &'a Path,
    /// Run folder; `None`: a new one in the system's runs folder.
    pub run: Option<&'a Path>,
    /// Domain; `None`: the name of the system.
    pub domain: Option<&'a str>,
    /// Mission that the caller will start; a copy is stored in the run folder.
    pub mission: Option<&'a Path>,
}

/// How a run ended.
#[derive(Debug)]
pub struct RunOutcome {
    /// The folder of the run.
    pub run: PathBuf,
    /// Names of the processes that died unexpectedly.
    pub died: Vec<String>,
    /// One sentence for each reason why a part of the run was not recorded.
    pub unrecorded: Vec<String>,
    /// The mission that was not completed, with its progress and the reason.
    pub unfinished: Option<String>,
    /// Last mode that motor-io published.
    pub mode: Option<u8>,
}

impl RunOutcome {
    /// Where the run is, as a clause; it distinguishes a run folder that was removed.
    #[must_use]
    pub fn place(&self) -> String {
        let run = self.run.display();
        if self.run.is_dir() { format!("the run is in {run}") } else { format!("the run folder {run} was removed") }
    }

    /// What failed during the run, in one sentence; `None` if nothing did.
    #[must_use]
    pub fn failed(&self) -> Option<String> {
        let mut parts = Vec::new();
        if !self.unrecorded.is_empty() {
            parts.push(format!("not all of the run was recorded ({})", self.unrecorded.join(", and ")));
        }
        if !self.died.is_empty() {
            let log = self.run.join("log");
            let see = if log.is_dir() { format!("; see {}", log.display()) } else { String::new() };
            parts.push(format!("died during the run: {}{see}", self.died.join(", ")));
        }
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

/// The running processes of one system. Dropping it without [`Supervisor::end`] also ends them.
pub struct Supervisor {
    // First, so that it is dropped first: its processes publish while they end and need the domain for that.
    process_set: ProcessSet,
    settings: Settings,
    context: RunContext,
    folder: RunFolder,
    archive: Archive,
    file_work: FileWork,
    unfinished_runs: UnfinishedRuns,
    wakeup: Wakeup,
    heartbeats: Heartbeats,
    cleanup: Cleanup,
    died: Vec<String>,
    announcer: Announcer,
    manager: ServiceManager,
    busy: busy::Watch,
    heartbeat: Publisher<Heartbeat>,
    table: Publisher<ProcessState>,
    /// Last published row of each process, by name.
    published_rows: HashMap<[u8; 32], ProcessState>,
    authority: Newest<MotorAuthority>,
    last_authority: Option<MotorAuthority>,
    recording: Recording,
    mission: Missions,
    requests: Subscriber<OperatorRequest>,
    /// Client for the stop request at the end; opened early, because shared memory may be exhausted by then.
    stopper: Option<Client>,
    beat: Heartbeat,
    last_beat_ns: u64,
    last_part_ns: u64,
    next_part: usize,
    server: Option<Server>,
    waiter: Waiter,
    bus: Bus,
    domain: Domain,
    claim: Claim,
}

impl Supervisor {
    /// The bus of the domain.
    #[must_use]
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// The system file of the run.
    #[must_use]
    pub fn system_file(&self) -> &SystemFile {
        &self.context.file
    }

    /// The folder of the run.
    #[must_use]
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// The last `motor/authority` that was received.
    #[must_use]
    pub fn authority(&self) -> Option<&MotorAuthority> {
        self.last_authority.as_ref()
    }

    /// Names of the processes that died so far.
    #[must_use]
    pub fn died(&self) -> &[String] {
        &self.died
    }

    /// A vital process that has died and has no standby.
    #[must_use]
    pub fn dead_and_vital(&self) -> Option<&str> {
        let replaced = |role| self.process_set.has_ready(role);
        let dead = self.process_set.iter().find(|child| {
            child.exit.is_some()
                && child.member.is_vital()
                && !(child.member.slot.is_some() && replaced(child.member.role))
        });
        dead.map(|child| child.member.name.as_str())
    }

    /// Prints a warning and publishes it on the log channel, and so in the run file.
    pub fn warn(&mut self, sentence: &str) {
        self.announcer.warn(sentence);
    }

    /// Whether a signal or the parent has requested the end.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.wakeup.stop.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_folder_that_was_removed_is_not_named_as_a_place_to_look() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        std::fs::create_dir_all(run.join("log")).unwrap();
        let (died, unrecorded) = (vec!["planner".to_owned()], Vec::new());
        let ending = RunOutcome { run: run.clone(), died, unrecorded, unfinished: None, mode: None };
        let (there, failed) = (ending.place(), ending.failed().unwrap());
        assert!(there.ends_with(run.to_str().unwrap()), "{there}");
        assert!(failed.contains("planner") && failed.ends_with("run/log"), "{failed}");
        std::fs::remove_dir_all(&run).unwrap();
        // The folder is named, and no longer as the place where the run is.
        let (removed, failed) = (ending.place(), ending.failed().unwrap());
        assert!(removed.contains(run.to_str().unwrap()) && !removed.ends_with(run.to_str().unwrap()), "{removed}");
        assert!(failed.ends_with("planner") && !failed.contains("run/log"), "{failed}");
    }
}
