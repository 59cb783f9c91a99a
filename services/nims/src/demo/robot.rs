//! The robot of the demonstration: starts a supervisor, monitors its processes, and ends it.

use crate::programs::sibling;
use bus::{Bus, Domain, Newest, Participant, clock};
use client::{RobotLink, Running, SUPERVISOR, Samples};
use command::{Answer, Failure, StopFlag};
use messages::{Heartbeat, MotorAuthority, ProcessState, text_of};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The name under which the demonstration joins the domain.
const NAME: &str = "nims-demo";
/// Time between two checks whether the robot is ready, ns.
const POLL_NS: u64 = 10_000_000;

/// Options of the supervisor.
pub struct StartOptions<'a> {
    /// System file.
    pub config: &'a Path,
    /// Name of the domain.
    pub domain: &'a str,
    /// Run folder; `None`: a new one.
    pub run: Option<&'a Path>,
    /// Mission file; the supervisor stores a copy in the run.
    pub mission: &'a Path,
}

/// How the run ended, by the supervisor's answer.
#[derive(Debug, Clone, Default)]
pub struct Ending {
    /// The folder of the run.
    pub run: PathBuf,
    /// Part of a sentence that names the folder of the run.
    pub place: String,
    /// Mode of motor-io at the end.
    pub mode: String,
    /// What failed during the run, in one sentence.
    pub failed: Option<String>,
    /// The supervisor's whole answer.
    pub value: Value,
}

/// A running supervisor, which is a child process.
pub struct Robot {
    child: Child,
    stdin: Option<ChildStdin>,
    link: RobotLink,
    stop: StopFlag,
    authority: Newest<MotorAuthority>,
    last_authority: Option<MotorAuthority>,
    table: Samples<ProcessState>,
    rows: BTreeMap<String, ProcessState>,
}

impl Robot {
    /// Starts the supervisor and waits until every process is ready.
    ///
    /// # Errors
    /// The supervisor has ended, with its reason, or a signal ended the start.
    pub fn start(options: &StartOptions<'_>, stop: StopFlag) -> Answer<Self> {
        let mut command = Command::new(sibling("supervisor")?);
        command.arg(options.config).arg("--mission").arg(options.mission).args(["--domain", options.domain]);
        if let Some(run) = options.run {
            command.arg("--run").arg(run);
        }
        command.args(["--parent", "--json"]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().map_err(Failure::not_now)?;
        let stdin = child.stdin.take();
        let domain = Domain::parse(options.domain)?;
        while Running::read(&domain).is_none_or(|running| running.pid != child.id()) {
            wait_for_start(&mut child, &stop)?;
        }
        let bus = Bus::join_as(&domain, NAME, Participant::Command)?;
        let authority = bus.newest("motor/authority")?;
        let link = RobotLink::from(bus);
        let mut beats = link.subscriber::<Heartbeat>(&format!("system/heartbeat/{SUPERVISOR}"))?;
        let ready = |beat: &Heartbeat| beat.state == Heartbeat::STATE_READY;
        let own = child.id();
        while beats.latest()?.is_none_or(|beat| beat.pid != own || !ready(&beat)) {
            wait_for_start(&mut child, &stop)?;
        }
        let table = link.subscriber("system/process")?;
        Ok(Self { child, stdin, link, stop, authority, last_authority: None, table, rows: BTreeMap::new() })
    }

    /// The way to it.
    pub fn link(&self) -> &RobotLink {
        &self.link
    }

    /// Newest state of motor-io.
    pub fn authority(&self) -> Option<&MotorAuthority> {
        self.last_authority.as_ref()
    }

    /// Returns whether a signal has requested the end.
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Sleeps, then receives the new samples.
    ///
    /// # Errors
    /// Shared memory fails, or the supervisor has ended.
    pub fn poll_after(&mut self, time: Duration) -> Answer {
        clock::sleep_until(clock::now_ns() + time.as_nanos() as u64);
        self.last_authority = messages::newer(self.last_authority, self.authority.latest()?);
        while let Some(row) = self.table.receive()? {
            self.rows.insert(text_of(&row.name), row);
        }
        match self.child.try_wait() {
            Ok(Some(_)) if !self.is_stopping() => Err(Failure::NotNow("the supervisor has ended".to_owned())),
            _ => Ok(()),
        }
    }

    /// Returns a process that the mission needs and that has died without a replacement.
    pub fn dead_required_process(&self) -> Option<String> {
        let over = |row: &ProcessState| [ProcessState::STATE_DIED, ProcessState::STATE_GAVE_UP].contains(&row.state);
        let required = |role: &str| ["motor-box", "motor-io", "estimator", "controller", "planner"].contains(&role);
        let replaced = |row: &ProcessState| {
            row.slot != 0
                && self.rows.values().any(|other| other.role == row.role && other.state == ProcessState::STATE_READY)
        };
        let dead = self.rows.values().find(|row| over(row) && required(&text_of(&row.role)) && !replaced(row));
        dead.map(|row| text_of(&row.name))
    }

    /// Ends the supervisor, which logs the reason, and returns its answer.
    ///
    /// # Errors
    /// The supervisor gave no answer.
    pub fn end(self, because: &str) -> Answer<Ending> {
        let Self { mut child, stdin, link, authority, table, .. } = self;
        drop((authority, table, link));
        if let Some(mut stdin) = stdin {
            // The write fails if the supervisor has already ended.
            let _ = stdin.write_all(because.as_bytes());
        }
        let answer = answer_of(&mut child)?;
        let text = |key: &str| answer[key].as_str().map(str::to_owned);
        let run = text("run").unwrap_or_default();
        Ok(Ending {
            place: text("place").unwrap_or_else(|| format!("the run is in {run}")),
            run: run.into(),
            mode: text("mode").unwrap_or_else(|| "unknown".to_owned()),
            failed: text("failed"),
            value: answer,
        })
    }
}

/// Waits for [`POLL_NS`].
///
/// # Errors
/// The supervisor has ended, with its reason, or a signal has requested the end.
fn wait_for_start(child: &mut Child, stop: &StopFlag) -> Answer {
    if stop.load(Ordering::Relaxed) {
        // The supervisor ends its processes when its standard input, which this process holds, is closed.
        return Err(Failure::NotNow(format!("stopped by {}", command::SIGNAL)));
    }
    if child.try_wait().map_err(Failure::not_now)?.is_some() {
        let answer = answer_of(child)?;
        let sentence = answer["failed"].as_str().unwrap_or("the supervisor has ended").to_owned();
        return Err(if answer["bad_input"] == true { Failure::BadInput(sentence) } else { Failure::NotNow(sentence) });
    }
    clock::sleep_until(clock::now_ns() + POLL_NS);
    Ok(())
}

/// Waits for the end of the supervisor and reads its answer.
fn answer_of(child: &mut Child) -> Answer<Value> {
    let mut text = String::new();
    if let Some(mut stdout) = child.stdout.take() {
        stdout.read_to_string(&mut text).map_err(Failure::not_now)?;
    }
    child.wait().map_err(Failure::not_now)?;
    serde_json::from_str(&text)
        .map_err(|_| Failure::NotNow("the supervisor ended without an answer; see its messages above".to_owned()))
}
