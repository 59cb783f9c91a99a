//! One process under supervision: started in a group of its own, so that Ctrl-C reaches only the supervisor.

use super::crew::Member;
use crate::failure::{Answer, Failure};
use rustix::process::{Pid, Signal, kill_process};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child as Process, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Lines of a process's diagnostics that are kept to explain its death.
const KEPT_LINES: usize = 20;

/// A started process.
#[derive(Debug)]
pub struct Child {
    /// What it is.
    pub member: Member,
    /// Its process id.
    pub pid: u32,
    /// When it was started, CLOCK_MONOTONIC, ns.
    pub started_ns: u64,
    /// How often it was started again.
    pub restarts: u32,
    /// Whether it has said that it is ready.
    pub ready: bool,
    /// How it ended, once it has.
    pub exit: Option<ExitStatus>,
    process: Process,
    lines: Arc<Mutex<VecDeque<String>>>,
    reader: Option<JoinHandle<()>>,
}

impl Child {
    /// Starts a process; what it says goes to a file of the run folder, and its last words are kept.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(member: &Member, log: &Path, restarts: u32) -> Answer<Self> {
        let failed = |error: std::io::Error| Failure::NotNow(format!("{} could not be started: {error}", member.name));
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(log).map_err(failed)?;
        let mut process = Command::new(&member.program)
            .args(&member.args)
            .stdin(Stdio::null())
            .stdout(Stdio::from(file.try_clone().map_err(failed)?))
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()
            .map_err(failed)?;
        let lines = Arc::new(Mutex::new(VecDeque::with_capacity(KEPT_LINES)));
        let reader = process.stderr.take().map(|stderr| {
            let lines = Arc::clone(&lines);
            std::thread::spawn(move || {
                for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                    // A full disk takes the text of the diagnostics; they are also on system/log.
                    let _ = writeln!(file, "{line}");
                    let mut kept = lines.lock().unwrap_or_else(PoisonError::into_inner);
                    if kept.len() == KEPT_LINES {
                        kept.pop_front();
                    }
                    kept.push_back(line);
                }
            })
        });
        let pid = process.id();
        let started_ns = bus::clock::now_ns();
        Ok(Self { member: member.clone(), pid, started_ns, restarts, ready: false, exit: None, process, lines, reader })
    }

    /// Whether it still runs; notes how it ended.
    pub fn is_alive(&mut self) -> bool {
        if self.exit.is_none()
            && let Ok(Some(status)) = self.process.try_wait()
        {
            self.exit = Some(status);
            if let Some(reader) = self.reader.take().filter(JoinHandle::is_finished) {
                let _ = reader.join();
            }
        }
        self.exit.is_none()
    }

    /// The last thing it said before it ended.
    #[must_use]
    pub fn last_words(&self) -> Option<String> {
        // the reader may still be at the last line
        std::thread::sleep(std::time::Duration::from_millis(20));
        let kept = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().rev().find(|line| !line.trim().is_empty()).map(|line| line.trim().to_owned())
    }

    /// Asks it to end in good order.
    pub fn ask_to_end(&self) {
        self.signal(Signal::TERM);
    }

    /// Ends it at once.
    pub fn kill(&self) {
        self.signal(Signal::KILL);
    }

    fn signal(&self, signal: Signal) {
        if self.exit.is_none()
            && let Some(pid) = Pid::from_raw(self.pid.cast_signed())
        {
            // It may have ended in this instant; then there is nothing to signal.
            let _ = kill_process(pid, signal);
        }
    }
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
