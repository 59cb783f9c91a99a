//! One process under supervision: started in a group of its own, so that Ctrl-C reaches only the supervisor.

use super::process_spec::ProcessSpec;
use super::restarts::Restarts;
use bus::clock;
use command::{Answer, Failure};
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

/// Lines of a process's diagnostics that are kept to explain its death.
const STORED_LINES: usize = 20;
/// Time for a process to end in good order, ns; the recorder writes out what it holds.
pub const END_NS: u64 = 8_000_000_000;

/// What follows when a process that was asked to end has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Then {
    /// It stays in the table as stopped.
    Stay,
    /// It is started again.
    Again,
    /// It leaves the table.
    Forget,
}

/// What a process is started with.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// Its domain.
    pub domain: &'a str,
    /// How many changes of `nims set` are in the system file that it gets.
    pub changes: u32,
    /// A process of its name runs until this one has said something.
    pub succeeds: bool,
    /// Where what it says goes.
    pub log: &'a Path,
}

/// A started process.
#[derive(Debug)]
pub struct Child {
    /// What it is.
    pub member: ProcessSpec,
    /// Its process id.
    pub pid: u32,
    /// When it was started, CLOCK_MONOTONIC, ns.
    pub started_ns: u64,
    /// Its deaths so far.
    pub restarts: Restarts,
    /// When it said that it is ready.
    pub ready_ns: Option<u64>,
    /// Version of its program, as it said.
    pub version: Option<String>,
    /// It has shown no sign of life for too long.
    pub silent: bool,
    /// And the machine had time for it.
    pub hangs: bool,
    /// And it waits for its disk.
    pub blocked: bool,
    /// It was ended because it hung.
    pub hung: bool,
    /// It has been named for not getting ready.
    pub overdue: bool,
    /// When it was asked to end, and what follows.
    pub asked: Option<(u64, Then)>,
    /// When it is to be started again.
    pub again_ns: Option<u64>,
    /// It has died too often.
    pub gave_up: bool,
    /// How it ended, once it has.
    pub exit: Option<ExitStatus>,
    killed: bool,
    process: Process,
    lines: Arc<Mutex<VecDeque<String>>>,
    reader: Option<JoinHandle<()>>,
    said: Option<String>,
}

impl Child {
    /// Starts a process and tells it its domain and its name; what it says goes to a file of the run folder, and its last words are kept. Gives a sentence too if the system does
    /// not permit its priority or its processor.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(member: &ProcessSpec, with: Start<'_>, restarts: Restarts) -> Answer<(Self, Option<String>)> {
        let failed = |error: std::io::Error| {
            Failure::NotNow(format!("{} could not be started: {}: {error}", member.name, member.program.display()))
        };
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(with.log).map_err(failed)?;
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
        // A process group of its own, which is ended as a whole, and its fair part of a busy machine.
        bus::fair::own_session(&mut command);
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
                    // A full disk takes the text of the diagnostics; they are also on system/log.
                    let _ = file.write_all(&bytes);
                    let mut kept = lines.lock().unwrap_or_else(PoisonError::into_inner);
                    if kept.len() == STORED_LINES {
                        kept.pop_front();
                    }
                    kept.push_back(String::from_utf8_lossy(&bytes).trim().to_owned());
                    bytes.clear();
                }
            })
        });
        let child = Self {
            member: member.clone(),
            pid: process.id(),
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
            killed: false,
            process,
            lines,
            reader,
            said: None,
        };
        Ok((child, warning))
    }

    /// Whether it still runs; notes how it ended, and ends what it had started itself.
    pub fn is_alive(&mut self) -> bool {
        let Some(pid) = self.id().filter(|_| self.exit.is_none()) else { return false };
        // Not yet reaped, its id and its group are nobody else's.
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

    /// The last thing that it has said so far.
    #[must_use]
    pub fn last_line(&self) -> Option<String> {
        let kept = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().rev().find(|line| !line.is_empty()).cloned()
    }

    /// The last thing it said before it ended that may be the cause.
    #[must_use]
    pub fn last_diagnostic(&self) -> Option<&str> {
        self.said.as_deref()
    }

    fn collect_last_diagnostic(&mut self) -> Option<String> {
        // The reader may still be at the last line; someone else's process may hold the pipe open for ever.
        let give_up = clock::now_ns() + 20_000_000;
        while self.reader.as_ref().is_some_and(|reader| !reader.is_finished()) && clock::now_ns() < give_up {
            clock::sleep_until(clock::now_ns() + 1_000_000);
        }
        if let Some(reader) = self.reader.take_if(|reader| reader.is_finished()) {
            let _ = reader.join();
        }
        let kept = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        // What it warned of is not why a signal ended it.
        let signalled = self.exit.is_some_and(|status| status.signal().is_some());
        kept.iter().rev().find(|line| complains(line) && !(signalled && level_of(line) == "WARN")).cloned()
    }

    /// Asks it to end in good order, once.
    pub fn ask_to_end(&mut self, then: Then) {
        if self.asked.is_none() && self.is_alive() {
            self.signal(Signal::TERM);
            // a process that stands still hears it when it goes on
            self.signal(Signal::CONT);
            self.asked = Some((clock::now_ns(), then));
        }
    }

    /// Ends it at once, if it was asked to end and has had its time; true the first time.
    pub fn kill_if_overdue(&mut self, now_ns: u64) -> bool {
        let due = self.exit.is_none() && self.asked.is_some_and(|(asked_ns, _)| now_ns >= asked_ns + END_NS);
        if !due || std::mem::replace(&mut self.killed, true) {
            return false;
        }
        self.signal(Signal::KILL);
        true
    }

    /// Ends a process that hangs, at once: one that is stopped hears nothing else.
    pub fn end_hung(&mut self) {
        self.hung = true;
        self.signal(Signal::KILL);
    }

    /// How it ended, as half a sentence; empty while it lives.
    #[must_use]
    pub fn ending(&self) -> String {
        match self.exit {
            Some(_) if self.hung => "hung, without a sign of life for two seconds, and was ended".to_owned(),
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

    /// Whether it ended without being asked, and not as something that may end does.
    #[must_use]
    pub fn has_died(&self) -> bool {
        self.asked.is_none() && self.exit.is_some_and(|exit| self.member.role != Role::Other || !exit.success())
    }

    /// Its state in the process table.
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

/// Starts the program from a thread that has the priority and the processor which the process inherits.
fn spawn(command: &mut Command, member: &ProcessSpec) -> (std::io::Result<Process>, Option<String>) {
    if member.priority == 0 && member.cpu.is_none() {
        return (command.spawn(), None);
    }
    let thread = std::thread::scope(|scope| {
        let parent = scope.spawn(|| {
            let warning = runtime::realtime::bequeath(member.priority, member.cpu);
            (command.spawn(), warning)
        });
        parent.join()
    });
    thread.unwrap_or_else(|_| (Err(std::io::Error::other("the thread that starts it failed")), None))
}

/// Whether a line may be the cause of an end: a warning, an error, or one without a level, as of a panic or of a program of one's own.
fn complains(line: &str) -> bool {
    !line.is_empty() && !["TRACE", "DEBUG", "INFO"].contains(&level_of(line))
}

/// The first word of a line, which is the level of one that is logged.
fn level_of(line: &str) -> &str {
    line.split(|letter: char| !letter.is_ascii_alphabetic()).next().unwrap_or_default()
}

/// How a process ended, as half a sentence.
#[must_use]
pub fn ending(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("ended with exit code {code}"),
        (None, Some(signal)) => format!("was ended by signal {signal}"),
        (None, None) => "ended".to_owned(),
    }
}
