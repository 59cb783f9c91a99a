//! The robot of the demonstration: a supervisor that was started for it, and what its processes say.

use crate::programs::sibling;
use bus::{Bus, Domain, Party, Subscriber, clock};
use client::{Running, SUPERVISOR};
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
/// How often it looks whether the robot is up, ns.
const LOOK_NS: u64 = 10_000_000;

/// What is to be started.
pub struct Wanted<'a> {
    /// System file.
    pub config: &'a Path,
    /// Name of the domain.
    pub domain: &'a str,
    /// Run folder, if not a new one.
    pub run: Option<&'a Path>,
    /// Mission that is flown, to be kept with the run.
    pub mission: &'a Path,
}

/// How the run ended, as the supervisor says.
#[derive(Debug, Clone, Default)]
pub struct Ending {
    /// The folder of the run.
    pub run: PathBuf,
    /// Where the run is, as a part of a sentence.
    pub place: String,
    /// Mode of motor-io at the end.
    pub mode: String,
    /// What went wrong on the way, in one sentence.
    pub failed: Option<String>,
    /// The whole answer.
    pub value: Value,
}

/// A supervisor that runs, as its child.
pub struct Robot {
    child: Child,
    stdin: Option<ChildStdin>,
    bus: Bus,
    stop: StopFlag,
    authority: Subscriber<MotorAuthority>,
    last_authority: Option<MotorAuthority>,
    table: Subscriber<ProcessState>,
    rows: BTreeMap<String, ProcessState>,
}

impl Robot {
    /// Starts the supervisor and waits until every process is ready.
    ///
    /// # Errors
    /// It does not come up, or a signal asks to end: why.
    pub fn start(wanted: &Wanted<'_>, stop: StopFlag) -> Answer<Self> {
        let mut command = Command::new(sibling("supervisor")?);
        command.arg(wanted.config).arg("--mission").arg(wanted.mission).args(["--domain", wanted.domain]);
        if let Some(run) = wanted.run {
            command.arg("--run").arg(run);
        }
        command.args(["--parent", "--json"]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().map_err(Failure::not_now)?;
        let stdin = child.stdin.take();
        let domain = Domain::parse(wanted.domain)?;
        while Running::of(&domain).is_none_or(|running| running.pid != child.id()) {
            still_starting(&mut child, &stop)?;
        }
        let bus = Bus::join_as(&domain, NAME, Party::Command)?;
        let mut beats = bus.subscriber::<Heartbeat>(&format!("system/heartbeat/{SUPERVISOR}"))?;
        let ready = |beat: &Heartbeat| beat.state == Heartbeat::STATE_READY;
        let own = child.id();
        while beats.latest()?.is_none_or(|beat| beat.pid != own || !ready(&beat)) {
            still_starting(&mut child, &stop)?;
        }
        let (authority, table) = (bus.subscriber("motor/authority")?, bus.subscriber("system/process")?);
        Ok(Self { child, stdin, bus, stop, authority, last_authority: None, table, rows: BTreeMap::new() })
    }

    /// The bus of its domain.
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// What motor-io said last.
    pub fn authority(&self) -> Option<&MotorAuthority> {
        self.last_authority.as_ref()
    }

    /// Whether a signal asks to end.
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Sleeps and takes in what was said meanwhile.
    ///
    /// # Errors
    /// Shared memory fails, or the supervisor has ended.
    pub fn look(&mut self, time: Duration) -> Answer {
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

    /// A process without which the robot cannot go on, which has died and is not replaced.
    pub fn dead_and_vital(&self) -> Option<String> {
        let over = |row: &ProcessState| [ProcessState::STATE_DIED, ProcessState::STATE_GAVE_UP].contains(&row.state);
        let vital = |role: &str| ["motor-box", "motor-io", "estimator", "controller", "planner"].contains(&role);
        let replaced = |row: &ProcessState| {
            row.slot != 0
                && self.rows.values().any(|other| other.role == row.role && other.state == ProcessState::STATE_READY)
        };
        let dead = self.rows.values().find(|row| over(row) && vital(&text_of(&row.role)) && !replaced(row));
        dead.map(|row| text_of(&row.name))
    }

    /// Ends the robot for this reason, and says how that went.
    ///
    /// # Errors
    /// The supervisor did not say how.
    pub fn end(self, because: &str) -> Answer<Ending> {
        let Self { mut child, stdin, bus, authority, table, .. } = self;
        drop((authority, table, bus));
        if let Some(mut stdin) = stdin {
            // A supervisor that has ended by itself does not read it.
            let _ = stdin.write_all(because.as_bytes());
        }
        let said = answer_of(&mut child)?;
        let text = |key: &str| said[key].as_str().map(str::to_owned);
        let run = text("run").unwrap_or_default();
        Ok(Ending {
            place: text("place").unwrap_or_else(|| format!("the run is in {run}")),
            run: run.into(),
            mode: text("mode").unwrap_or_else(|| "unknown".to_owned()),
            failed: text("failed"),
            value: said,
        })
    }
}

/// Waits a moment; why the supervisor does not come up.
fn still_starting(child: &mut Child, stop: &StopFlag) -> Answer {
    if stop.load(Ordering::Relaxed) {
        // Its standard input ends with this process, and it ends what it has started.
        return Err(Failure::NotNow(format!("it was stopped by {}", command::SIGNAL)));
    }
    if child.try_wait().map_err(Failure::not_now)?.is_some() {
        let said = answer_of(child)?;
        let sentence = said["failed"].as_str().unwrap_or("the supervisor has ended").to_owned();
        return Err(if said["bad_input"] == true { Failure::BadInput(sentence) } else { Failure::NotNow(sentence) });
    }
    clock::sleep_until(clock::now_ns() + LOOK_NS);
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
        .map_err(|_| Failure::NotNow("the supervisor ended without saying how; see its messages above".to_owned()))
}
