//! One supervised process, started in its own process group, so that Ctrl-C reaches only the supervisor.

use super::process_spec::ProcessSpec;
use super::refused::{Decision, not_started};
use super::restarts::Restarts;
use super::service_manager;
use super::stale_processes::ProcessIdentity;
use bus::clock;
use config::Role;
use messages::ProcessState;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child as Process, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::SystemTime;

/// Text lines of a process's diagnostics that are stored to explain its death.
const STORED_LINES: usize = 20;
/// Time for a process to end after SIGTERM, ns; the recorder writes its buffers in it.
pub const END_NS: u64 = 8_000_000_000;
/// Longest wait for the end after SIGKILL, ns.
const KILLED_NS: u64 = 1_000_000_000;

/// What follows when a process that was requested to end has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AfterEnd {
    /// It stays in the table as stopped.
    Stay,
    /// It is restarted.
    Restart,
    /// It leaves the table.
    Remove,
}

/// Settings that differ from one start of a process to the next.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// The robot's domain.
    pub domain: &'a str,
    /// Number of `nims set` changes in the system file that it reads.
    pub changes: u32,
    /// Another process of its name runs until this one has published its first sample.
    pub succeeds: bool,
    /// File for its diagnostics.
    pub log: &'a Path,
}

/// A started process.
#[derive(Debug)]
pub struct ManagedProcess {
    /// How it was started.
    pub member: ProcessSpec,
    /// Process id.
    pub pid: u32,
    /// Size and time of its program as it was started, bytes.
    pub program: Option<(u64, SystemTime)>,
    /// Its identity, for the next supervisor; `None` if it ended at once.
    pub identity: Option<ProcessIdentity>,
    /// When it was started, CLOCK_MONOTONIC, ns.
    pub started_ns: u64,
    /// Count of its deaths and restarts.
    pub restarts: Restarts,
    /// When its first heartbeat in state ready arrived, ns.
    pub ready_ns: Option<u64>,
    /// Version of its program, from its heartbeat.
    pub version: Option<String>,
    /// Its last heartbeat is too old.
    pub silent: bool,
    /// It is silent although it had processor time.
    pub hangs: bool,
    /// It is silent because it is blocked on a disk.
    pub blocked: bool,
    /// It was killed because it hung.
    pub hung: bool,
    /// A warning that it does not become ready was published.
    pub overdue: bool,
    /// When it was requested to end, ns, and what follows.
    pub asked: Option<(u64, AfterEnd)>,
    /// When it will be restarted, ns.
    pub again_ns: Option<u64>,
    /// It died too often to be restarted.
    pub gave_up: bool,
    /// Exit status, once it has ended.
    pub exit: Option<ExitStatus>,
    /// When it was killed because it was overdue, ns.
    pub killed_ns: Option<u64>,
    process: Process,
    lines: Arc<Mutex<VecDeque<String>>>,
    reader: Option<JoinHandle<()>>,
    said: Option<String>,
}

impl ManagedProcess {
    /// Starts a process with its domain and name. Its output goes to a file in the run folder, and its last lines are
    /// kept. Also returns a warning if the system does not permit its priority or its processor.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(member: &ProcessSpec, with: Start<'_>, restarts: Restarts) -> Decision<(Self, Option<String>)> {
        let failed =
            |error: std::io::Error| not_started(&member.name, format_args!("{}: {error}", member.program.display()));
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(with.log).map_err(failed)?;
        let program = std::fs::metadata(&member.program).ok();
        let mut command = Command::new(&member.program);
        command
            .args(&member.args)
            .env(runtime::DOMAIN_VARIABLE, with.domain)
            .env(runtime::NAME_VARIABLE, &member.name)
            .env(runtime::CHANGES_VARIABLE, with.changes.to_string())
            .env(runtime::SUCCESSOR_VARIABLE, if with.succeeds { "1" } else { "" })
            .stdin(Stdio::null())
            .stdout(Stdio::from(file.try_clone().map_err(failed)?))
            .stderr(Stdio::piped());
        // Its own session: the process group can be ended as a whole, and the scheduler groups it fairly.
        bus::fair::own_session(&mut command);
        service_manager::hide_from(&mut command);
        if let Some(folder) = &member.folder {
            command.current_dir(folder);
        }
        let (spawned, warning) = spawn(&mut command, member);
        let mut process = spawned.map_err(failed)?;
        let lines = Arc::new(Mutex::new(VecDeque::with_capacity(STORED_LINES)));
        let reader = process.stderr.take().map(|stderr| {
            let lines = Arc::clone(&lines);
            std::thread::spawn(move || {
                let mut reader = BufReader::new(stderr);
                let mut bytes = Vec::new();
                while reader.read_until(b'\n', &mut bytes).is_ok_and(|read| read > 0) {
                    store(&lines, &bytes);
                    // On a full disk the diagnostics are lost here; they are also on system/log.
                    let _ = file.write_all(&bytes);
                    bytes.clear();
                }
            })
        });
        let child = Self {
            member: member.clone(),
            pid: process.id(),
            program: program.and_then(|file| Some((file.len(), file.modified().ok()?))),
            identity: ProcessIdentity::now(&member.name, process.id()),
            started_ns: clock::now_ns(),
            restarts,
            ready_ns: None,
            version: None,
            silent: false,
            hangs: false,
            blocked: false,
            hung: false,
            overdue: false,
            asked: None,
            again_ns: None,
            gave_up: false,
            exit: None,
            killed_ns: None,
            process,
            lines,
            reader,
            said: None,
        };
        Ok((child, warning))
    }

    /// Whether it still runs. Once it has ended, stores its exit status and kills the rest of its process group.
    pub fn is_alive(&mut self) -> bool {
        let Some(pid) = self.id().filter(|_| self.exit.is_none()) else { return false };
        // Until it is reaped, its process id and its group cannot be reused.
        let peek = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        if !matches!(waitid(WaitId::Pid(pid), peek), Ok(None)) {
            let _ = kill_process_group(pid, Signal::KILL);
            if let Ok(Some(status)) = self.process.try_wait() {
                self.exit = Some(status);
                (self.silent, self.hangs, self.blocked) = (false, false, false);
                self.said = self.collect_last_diagnostic();
            }
        }
        self.exit.is_none()
    }

    /// The last text line of its diagnostics so far.
    #[must_use]
    pub fn last_line(&self) -> Option<String> {
        let kept = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().rev().find(|line| !line.is_empty()).cloned()
    }

    /// The last text lines of its diagnostics so far.
    #[must_use]
    pub fn last_lines(&self) -> Vec<String> {
        let kept = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().filter(|line| !line.is_empty()).cloned().collect()
    }

    /// The last diagnostic before it ended that may be the cause.
    #[must_use]
    pub fn last_diagnostic(&self) -> Option<&str> {
        self.said.as_deref()
    }

    fn collect_last_diagnostic(&mut self) -> Option<String> {
        // The reader may not have read the last line yet; a grandchild may hold the pipe open indefinitely.
        let give_up = clock::now_ns() + 20_000_000;
        while self.reader.as_ref().is_some_and(|reader| !reader.is_finished()) && clock::now_ns() < give_up {
            clock::sleep_until(clock::now_ns() + 1_000_000);
        }
        if let Some(reader) = self.reader.take_if(|reader| reader.is_finished()) {
            let _ = reader.join();
        }
        let kept = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        // A warning does not explain an end by a signal.
        let signalled = self.exit.is_some_and(|status| status.signal().is_some());
        kept.iter().rev().find(|line| complains(line) && !(signalled && level_of(line) == "WARN")).cloned()
    }

    /// Requests it to end with SIGTERM, once.
    pub fn ask_to_end(&mut self, then: AfterEnd) {
        if self.asked.is_none() && self.is_alive() {
            self.signal(Signal::TERM);
            // a stopped process receives SIGTERM only when it continues
            self.signal(Signal::CONT);
            self.asked = Some((clock::now_ns(), then));
        }
    }

    /// Kills it if it was requested to end more than [`END_NS`] ago; true the first time.
    pub fn kill_if_overdue(&mut self, now_ns: u64) -> bool {
        let due = self.exit.is_none() && self.asked.is_some_and(|(asked_ns, _)| now_ns >= asked_ns + END_NS);
        if !due || self.killed_ns.is_some() {
            return false;
        }
        self.killed_ns = Some(now_ns);
        self.signal(Signal::KILL);
        true
    }

    /// Whether it was killed because it was overdue, and has not ended since: blocked in the kernel, a process survives
    /// even SIGKILL.
    #[must_use]
    pub fn survives(&self) -> bool {
        self.exit.is_none() && self.killed_ns.is_some_and(|killed_ns| clock::now_ns() >= killed_ns + KILLED_NS)
    }

    /// Kills a process that hangs: a stopped process receives no other signal.
    pub fn end_hung(&mut self) {
        self.hung = true;
        self.signal(Signal::KILL);
    }

    /// Ends a process that was started too late to be supervised.
    pub fn end_late(mut self) {
        self.signal(Signal::KILL);
        let _ = self.process.wait();
    }

    /// How it ended, as a clause; empty while it runs.
    #[must_use]
    pub fn ending(&self) -> String {
        match self.exit {
            Some(_) if self.hung => "hung, without a heartbeat for two seconds, and was killed".to_owned(),
            Some(exit) => ending(exit),
            None => String::new(),
        }
    }

    fn id(&self) -> Option<Pid> {
        Pid::from_raw(self.pid.cast_signed())
    }

    fn signal(&self, signal: Signal) {
        if self.exit.is_none()
            && let Some(pid) = self.id()
        {
            // It may have ended in this instant; then there is nothing to signal.
            let _ = kill_process_group(pid, signal);
        }
    }

    /// Whether it ended without a request; a custom process may end with exit code 0.
    #[must_use]
    pub fn has_died(&self) -> bool {
        self.asked.is_none() && self.exit.is_some_and(|exit| self.member.role != Role::Other || !exit.success())
    }

    /// Its `ProcessState::STATE_*` in the process table.
    #[must_use]
    pub fn state(&self) -> u8 {
        match self.exit {
            Some(_) if self.gave_up => ProcessState::STATE_GAVE_UP,
            Some(_) if self.has_died() => ProcessState::STATE_DIED,
            Some(_) => ProcessState::STATE_STOPPED,
            None if self.asked.is_some() => ProcessState::STATE_STOPPING,
            None if self.silent => ProcessState::STATE_SILENT,
            None if self.ready_ns.is_some() => ProcessState::STATE_READY,
            None if self.member.sends_heartbeats => ProcessState::STATE_STARTING,
            None => ProcessState::STATE_RUNNING,
        }
    }
}

/// Stores a text line of the diagnostics.
fn store(lines: &Mutex<VecDeque<String>>, bytes: &[u8]) {
    let mut kept = lines.lock().unwrap_or_else(PoisonError::into_inner);
    if kept.len() == STORED_LINES {
        kept.pop_front();
    }
    kept.push_back(String::from_utf8_lossy(bytes).trim().to_owned());
}

/// Starts the program from a thread whose priority and processor affinity the process inherits.
fn spawn(command: &mut Command, member: &ProcessSpec) -> (std::io::Result<Process>, Option<String>) {
    if member.priority == 0 && member.cpu.is_none() {
        return (command.spawn(), None);
    }
    let thread = std::thread::scope(|scope| {
        let parent = scope.spawn(|| {
            let warning = runtime::realtime::apply_for_child(member.priority, member.cpu);
            (command.spawn(), warning)
        });
        parent.join()
    });
    thread.unwrap_or_else(|_| (Err(std::io::Error::other("the thread that starts it failed")), None))
}

/// Whether a text line may explain an end: a warning, an error, or a line without a level, as a panic prints it.
fn complains(line: &str) -> bool {
    !line.is_empty() && !["TRACE", "DEBUG", "INFO"].contains(&level_of(line))
}

/// The first word of a text line: the level, if it is a log line.
fn level_of(line: &str) -> &str {
    line.split(|letter: char| !letter.is_ascii_alphabetic()).next().unwrap_or_default()
}

/// How a process ended, as a clause.
#[must_use]
pub fn ending(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("ended with exit code {code}"),
        (None, Some(signal)) => format!("was ended by signal {signal}"),
        (None, None) => "ended".to_owned(),
    }
}
