//! Starting, watching and stopping the processes of a box.
//!
//! Architecture invariant: the supervisor is not in the control loop. It may die at any instant; motor-io then brings the robot to rest
//! on its path and holds, and the next supervisor of the domain ends what was left behind.

mod child;
mod crew;
mod orphans;
mod run_folder;
mod voice;

pub use crew::{consequence, role_name};
pub use run_folder::RunFolder;

use crate::failure::{Answer, Failure};
use crate::live::{RUNNING_FILE, Running};
use crate::operate;
use bus::{Bus, Claim, Domain, Publisher, Subscriber, clock};
use child::Child;
use crew::Member;
use messages::{Heartbeat, MotorAuthority, OperatorRequest, ProcessState, put_text};
use orphans::Started;
use serde_json::{Value, json};
use service::config::{BoxFile, Role};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use voice::Voice;

/// How often children and heartbeats are looked at.
const LOOK: Duration = Duration::from_millis(100);
/// The supervisor's own beat, ns: motor-io takes two seconds without one for its death.
const BEAT_NS: u64 = 200_000_000;
/// The whole process table is published this often, ns.
const TABLE_NS: u64 = 1_000_000_000;
/// A process that has not said that it is ready by then never will, ns. Drives may need to be found and asked first.
const READY_NS: u64 = 20_000_000_000;
/// Heartbeats come five times a second; a process without one for this long hangs, ns.
const SILENT_NS: u64 = 2_000_000_000;
/// Time for the robot to come to rest when everything ends, ns: the longest stop ramp and some.
const REST_NS: u64 = 6_000_000_000;
/// From the last command to standing drums, ns: several times a drive's delay and lag.
const SETTLE_NS: u64 = 500_000_000;
/// Time for a process to end in good order, ns; the recorder writes out what it holds.
const END_NS: u64 = 8_000_000_000;
/// A process that dies this often is not started again.
const RESTARTS: u32 = 3;
/// Pause before a process is started again, ns: a fault that comes back at once must not fill the machine.
const RESTART_PAUSE_NS: u64 = 500_000_000;
/// Pause before what failed for want of memory, processes or files is tried again, ns.
const RETRY_NS: u64 = 2_000_000_000;

/// Set by a signal: end in good order.
pub type StopFlag = Arc<AtomicBool>;

/// A flag that SIGINT and SIGTERM set.
///
/// # Errors
/// The handlers cannot be installed.
pub fn stop_flag() -> Answer<StopFlag> {
    let flag = StopFlag::default();
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&flag)).map_err(Failure::not_now)?;
    }
    Ok(flag)
}

/// What is to be started.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// Box file.
    pub box_path: &'a Path,
    /// Run folder, if not a new one.
    pub run: Option<&'a Path>,
    /// Domain, if not the box's own.
    pub domain: Option<&'a str>,
    /// Mission that will be flown, to be kept with the run.
    pub mission: Option<&'a Path>,
}

/// How a run ended.
#[derive(Debug)]
pub struct Ending {
    /// The folder of the run.
    pub run: PathBuf,
    /// Names of the processes that died and were not expected to.
    pub died: Vec<String>,
    /// Mode of motor-io at the end, if it could still be asked.
    pub mode: Option<u8>,
}

/// The processes of one box, running.
pub struct Supervisor {
    file: BoxFile,
    folder: RunFolder,
    stop: StopFlag,
    children: Vec<Child>,
    beats: BTreeMap<String, Beats>,
    again: Vec<(Member, u32, u64)>,
    sweep_ns: Option<u64>,
    died: Vec<String>,
    voice: Voice,
    heartbeat: Publisher<Heartbeat>,
    table: Publisher<ProcessState>,
    authority: Subscriber<MotorAuthority>,
    last_authority: Option<MotorAuthority>,
    beat: Heartbeat,
    last_beat_ns: u64,
    last_table_ns: u64,
    bus: Bus,
    domain: Domain,
    _claim: Claim,
}

/// Heartbeats of one process.
struct Beats {
    subscriber: Subscriber<Heartbeat>,
    last: Option<Heartbeat>,
    seen_ns: u64,
    silent: bool,
}

impl Supervisor {
    /// Cleans the domain up, makes the run folder and starts every process, each when the one before is ready.
    ///
    /// # Errors
    /// The domain is taken, or a process does not come up; what was started is stopped again.
    pub fn start(wanted: &Wanted<'_>, stop: StopFlag) -> Answer<Self> {
        let box_path = std::path::absolute(wanted.box_path).map_err(Failure::bad)?;
        let file = BoxFile::load(&box_path).map_err(Failure::bad)?;
        ports_are_there(&file)?;
        crate::findings::can_be_built(&file)?;
        let domain = Domain::parse(wanted.domain.unwrap_or(&file.name))?;
        let claim = domain.claim()?;
        let earlier = Running::of(&domain);
        let orphans = orphans::end(&domain)?;
        domain.sweep()?;
        let folder = RunFolder::make(&file, &box_path, wanted.run, wanted.mission)?;
        let members = crew::crew(&file, &box_path, domain.name(), folder.path())?;

        let bus = Bus::join(&domain, "nims")?;
        let running = Running { pid: std::process::id(), box_file: box_path, run: folder.path().to_path_buf() };
        let text = serde_json::to_string(&running).map_err(Failure::not_now)?;
        orphans::write(&domain, RUNNING_FILE, &text)?;

        let mut beat = Heartbeat {
            pid: std::process::id(),
            incarnation: incarnation(),
            state: Heartbeat::STATE_STARTING,
            ..Default::default()
        };
        put_text(&mut beat.name, "nims");
        let mut supervisor = Self {
            stop,
            children: Vec::new(),
            beats: BTreeMap::new(),
            again: Vec::new(),
            sweep_ns: None,
            died: Vec::new(),
            voice: Voice::new(&bus)?,
            heartbeat: bus.publisher("system/heartbeat/nims")?,
            table: bus.publisher("system/process")?,
            authority: bus.subscriber("motor/authority")?,
            last_authority: None,
            beat,
            last_beat_ns: 0,
            last_table_ns: 0,
            file,
            folder,
            bus,
            domain,
            _claim: claim,
        };
        if !orphans.is_empty() {
            supervisor.voice.warn(&format!("ended what an earlier start had left running: {}", orphans.join(", ")));
        }
        if let Some(earlier) = earlier {
            supervisor.recover(&earlier.run);
        }
        for member in members {
            if let Err(failure) = supervisor.bring_up(&member) {
                supervisor.close("a process did not come up");
                return Err(failure);
            }
        }
        supervisor.beat.state = Heartbeat::STATE_READY;
        Ok(supervisor)
    }

    /// The bus of the domain.
    #[must_use]
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// The box that runs.
    #[must_use]
    pub fn box_file(&self) -> &BoxFile {
        &self.file
    }

    /// The folder of the run.
    #[must_use]
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// What motor-io said last.
    #[must_use]
    pub fn authority(&self) -> Option<&MotorAuthority> {
        self.last_authority.as_ref()
    }

    /// Names of the processes that died so far.
    #[must_use]
    pub fn died(&self) -> &[String] {
        &self.died
    }

    /// A process without which the robot cannot go on, and which has died.
    #[must_use]
    pub fn dead_and_vital(&self) -> Option<&str> {
        let dead = self.children.iter().find(|child| child.exit.is_some() && child.member.is_vital());
        dead.map(|child| child.member.name.as_str())
    }

    /// Whether someone wants it to end.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Looks after the children for this long, or until someone wants it to end.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn watch(&mut self, time: Duration) -> Answer {
        let deadline = clock::now_ns() + time.as_nanos() as u64;
        loop {
            self.look()?;
            let now = clock::now_ns();
            if now >= deadline || self.is_stopping() {
                return Ok(());
            }
            clock::sleep_until(deadline.min(now + LOOK.as_nanos() as u64));
        }
    }

    /// Brings the robot to rest, ends every process, the recorder last, and closes the run.
    #[must_use]
    pub fn end(mut self, because: &str) -> Ending {
        self.come_to_rest();
        let mode = self.last_authority.map(|authority| authority.mode);
        let (died, run) = (std::mem::take(&mut self.died), self.folder.path().to_path_buf());
        self.close(because);
        let Self { domain, bus, voice, heartbeat, table, authority, beats, _claim, .. } = self;
        drop((voice, heartbeat, table, authority, beats, bus));
        // If someone still looks on, only the debris of processes that were killed goes, and the rest when the domain is next used.
        let _ = domain.sweep();
        let _ = domain.retire(_claim);
        Ending { run, died, mode }
    }

    /// Starts one process and waits until it is ready.
    fn bring_up(&mut self, member: &Member) -> Answer {
        self.launch(member, 0)?;
        let give_up = clock::now_ns() + READY_NS;
        loop {
            self.look_at_beats()?;
            self.report()?;
            let Some(child) = self.children.last_mut() else { return Ok(()) };
            if !child.is_alive() {
                let status = child.exit.map(child::ending).unwrap_or_default();
                let code = child.exit.and_then(|exit| exit.code());
                let why = child.last_words().unwrap_or(status);
                let sentence = format!("{} did not come up: {why}", member.name);
                return Err(if code == Some(2) { Failure::bad(sentence) } else { Failure::not_now(sentence) });
            }
            if child.ready || !member.beats {
                child.ready = true;
                self.voice.info(&format!("{} is ready", member.name));
                return self.publish_table();
            }
            if self.is_stopping() {
                return Err(Failure::NotNow("stopped while starting".to_owned()));
            }
            if clock::now_ns() >= give_up {
                return Err(Failure::NotNow(format!(
                    "{} does not become ready within {} s: see {}",
                    member.name,
                    READY_NS / 1_000_000_000,
                    self.folder.log(&member.name).display()
                )));
            }
            clock::sleep_until(clock::now_ns() + 10_000_000);
        }
    }

    fn launch(&mut self, member: &Member, restarts: u32) -> Answer {
        if !self.beats.contains_key(&member.name) {
            let subscriber = self.bus.subscriber(&format!("system/heartbeat/{}", member.name))?;
            self.beats
                .insert(member.name.clone(), Beats { subscriber, last: None, seen_ns: clock::now_ns(), silent: false });
        }
        let child = Child::start(member, &self.folder.log(&member.name), restarts)?;
        self.children.retain(|other| other.member.name != member.name);
        self.children.push(child);
        let started: Vec<Started> = self
            .children
            .iter()
            .filter(|child| child.exit.is_none())
            .filter_map(|child| Started::now(&child.member.name, child.pid))
            .collect();
        orphans::note(&self.domain, &started)
    }

    /// One round: beat, look at the children and their heartbeats, publish.
    fn look(&mut self) -> Answer {
        self.look_at_beats()?;
        self.look_at_children()?;
        while let Some(authority) = self.authority.latest()? {
            self.last_authority = Some(authority);
        }
        self.report()
    }

    fn look_at_beats(&mut self) -> Answer {
        let now = clock::now_ns();
        for child in &mut self.children {
            let Some(beats) = self.beats.get_mut(&child.member.name) else { continue };
            while let Some(beat) = beats.subscriber.receive()? {
                if beat.pid == child.pid {
                    child.ready |= beat.state == Heartbeat::STATE_READY;
                    beats.seen_ns = now;
                    beats.last = Some(beat);
                }
            }
            let silent = child.ready
                && child.member.beats
                && child.exit.is_none()
                && now.saturating_sub(beats.seen_ns) > SILENT_NS;
            if silent != beats.silent {
                beats.silent = silent;
                let name = &child.member.name;
                self.voice.warn(&if silent {
                    format!("{name} has shown no sign of life for {} s", SILENT_NS / 1_000_000_000)
                } else {
                    format!("{name} is back")
                });
            }
        }
        Ok(())
    }

    fn look_at_children(&mut self) -> Answer {
        let now = clock::now_ns();
        let mut changed = false;
        for child in &mut self.children {
            if child.exit.is_some() || child.is_alive() {
                continue;
            }
            changed = true;
            let name = &child.member.name;
            let how = child.exit.map(child::ending).unwrap_or_default();
            let means = consequence(child.member.role, self.file.motor_io.watchdog_s);
            let words = child.last_words().map(|words| format!(" ({words})")).unwrap_or_default();
            self.voice.error(&format!("{name} {how}{words}: {means}"));
            self.died.push(name.clone());
            if child.member.restart && child.restarts < RESTARTS {
                self.again.push((child.member.clone(), child.restarts + 1, now + RESTART_PAUSE_NS));
            }
        }
        if changed {
            // What a killed process leaves in shared memory takes places that its successor needs.
            self.sweep_ns = Some(now);
            self.publish_table()?;
        }
        if self.sweep_ns.is_some_and(|due| due <= now) {
            self.sweep_ns = None;
            if let Err(error) = self.domain.sweep() {
                self.voice.warn(&format!("what a dead process left is not removed yet: {error}"));
                self.sweep_ns = Some(now + RETRY_NS);
            }
        }
        let due: Vec<_> = self.again.extract_if(.., |(_, _, at)| *at <= now).collect();
        for (member, restarts, _) in due {
            self.voice.warn(&format!("starting {} again ({restarts} of {RESTARTS})", member.name));
            // A machine without room for one more process is no reason to leave the others alone.
            if let Err(failure) = self.launch(&member, restarts) {
                self.voice.warn(&format!("{failure}; trying again in {} s", RETRY_NS / 1_000_000_000));
                self.again.push((member, restarts, now + RETRY_NS));
            }
        }
        Ok(())
    }

    /// Publishes the supervisor's own beat and, once a second, the process table.
    fn report(&mut self) -> Answer {
        let now = clock::now_ns();
        if now >= self.last_beat_ns + BEAT_NS {
            self.last_beat_ns = now;
            self.beat.beat += 1;
            self.beat.passes = self.beat.beat;
            self.beat.header.stamp_ns = now;
            self.beat.header.oldest_input_ns = now;
            self.heartbeat.send(&mut self.beat)?;
        }
        if now >= self.last_table_ns + TABLE_NS {
            self.publish_table()?;
        }
        Ok(())
    }

    fn publish_table(&mut self) -> Answer {
        let now = clock::now_ns();
        self.last_table_ns = now;
        for child in &self.children {
            let silent = self.beats.get(&child.member.name).is_some_and(|beats| beats.silent);
            let mut row = ProcessState {
                started_ns: child.started_ns,
                pid: child.pid,
                restarts: child.restarts,
                exit_code: child.exit.and_then(|exit| exit.code()).unwrap_or(-1),
                signal: child.exit.and_then(|exit| std::os::unix::process::ExitStatusExt::signal(&exit)).unwrap_or(0),
                state: match child.exit {
                    Some(exit) if exit.success() => ProcessState::STATE_STOPPED,
                    Some(_) if child.member.restart && child.restarts >= RESTARTS => ProcessState::STATE_GAVE_UP,
                    Some(_) => ProcessState::STATE_DIED,
                    None if silent => ProcessState::STATE_SILENT,
                    None if child.ready => ProcessState::STATE_READY,
                    None => ProcessState::STATE_STARTING,
                },
                ..ProcessState::default()
            };
            row.header.stamp_ns = now;
            row.header.oldest_input_ns = now;
            put_text(&mut row.name, &child.member.name);
            put_text(&mut row.role, role_name(child.member.role));
            put_text(&mut row.reason, &child.exit.map(child::ending).unwrap_or_default());
            self.table.send(&mut row)?;
        }
        Ok(())
    }

    /// Asks motor-io to stop on the path and waits until the robot is at rest. Whatever fails here, the drives still hold.
    fn come_to_rest(&mut self) {
        let at_rest = |authority: &MotorAuthority| {
            !matches!(
                authority.mode,
                MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_JOGGING | MotorAuthority::MODE_STOPPING
            )
        };
        if !self.children.iter_mut().any(|child| child.member.role == Role::MotorIo && child.is_alive()) {
            return;
        }
        if self.look().is_err() || self.last_authority.as_ref().is_none_or(at_rest) {
            return;
        }
        let stop = operate::plain(OperatorRequest::VERB_STOP);
        let asked = self.bus.client(operate::MOTOR_IO).and_then(|mut client| client.ask(&stop, Duration::from_secs(1)));
        if let Err(error) = asked {
            self.voice.warn(&format!("motor-io was not asked to stop: {error}"));
        }
        let give_up = clock::now_ns() + REST_NS;
        while clock::now_ns() < give_up {
            clock::sleep_until(clock::now_ns() + 20_000_000);
            if self.look().is_err() || self.last_authority.as_ref().is_none_or(at_rest) {
                // The drives lag behind their commands; the run file shows them come to rest too.
                clock::sleep_until(clock::now_ns() + SETTLE_NS);
                return;
            }
        }
        self.voice.warn("the robot has not come to rest in time; the processes end all the same, and the drives hold");
    }

    /// Ends the children, downstream before upstream, the recorder last; recovers what a dead recorder left; completes the manifest.
    fn close(&mut self, because: &str) {
        self.beat.state = Heartbeat::STATE_STOPPING;
        self.again.clear();
        for role in [
            Role::Planner,
            Role::Controller,
            Role::Estimator,
            Role::Other,
            Role::MotorIo,
            Role::MotorBox,
            Role::Recorder,
        ] {
            self.end_role(role);
        }
        let run = self.folder.path().to_path_buf();
        self.recover(&run);
        let processes: Vec<Value> = self
            .children
            .iter()
            .map(|child| {
                let ended = child.exit.map(child::ending);
                json!({ "name": child.member.name, "role": role_name(child.member.role), "pid": child.pid, "restarts": child.restarts, "ended": ended })
            })
            .collect();
        if let Err(failure) = self.folder.close(because, Value::Array(processes)) {
            self.voice.error(&failure.to_string());
        }
        // Nobody is left but this process, whose names the next start wipes.
        let _ = std::fs::remove_file(self.domain.root().join(RUNNING_FILE));
        let _ = orphans::note(&self.domain, &[]);
    }

    /// Closes the run files that a dead recorder left open.
    fn recover(&mut self, run: &Path) {
        for part in parts(run) {
            match runlog::recover(&part, &mut |_, _| {}) {
                Ok(_) => self
                    .voice
                    .warn(&format!("{} was not closed by its recorder and has been recovered", part.display())),
                Err(error) => self.voice.error(&format!(
                    "{} could not be recovered: {error}; try again with `nims recover {}`",
                    part.display(),
                    run.display()
                )),
            }
        }
    }

    fn end_role(&mut self, role: Role) {
        let of_role = |child: &&mut Child| child.member.role == role;
        for child in self.children.iter_mut().filter(of_role) {
            child.ask_to_end();
        }
        let give_up = clock::now_ns() + END_NS;
        loop {
            let alive = self
                .children
                .iter_mut()
                .filter(of_role)
                .filter_map(|child| child.is_alive().then_some(child.pid))
                .count();
            if alive == 0 {
                return;
            }
            if clock::now_ns() >= give_up {
                break;
            }
            // The recorder still takes what the others say while they end.
            let _ = self.report();
            clock::sleep_until(clock::now_ns() + 10_000_000);
        }
        for child in self.children.iter_mut().filter(of_role) {
            if child.is_alive() {
                self.voice.warn(&format!("{} does not end by itself and is killed", child.member.name));
                child.kill();
                let give_up = clock::now_ns() + 1_000_000_000;
                while child.is_alive() && clock::now_ns() < give_up {
                    clock::sleep_until(clock::now_ns() + 10_000_000);
                }
            }
        }
    }
}

/// Every configured device exists; the virtual box makes its own.
fn ports_are_there(file: &BoxFile) -> Answer {
    for (index, port) in file.motor_io.ports.iter().enumerate() {
        let number = index + 1;
        if port.path.contains("{domain}") {
            if file.motor_box.is_none() {
                return Err(Failure::BadInput(format!(
                    "port {number} is on the virtual motor box, and the box file has no [motor_box]: give the path of the real device, or add [motor_box]"
                )));
            }
        } else if !Path::new(&port.path).exists() {
            return Err(Failure::BadInput(format!(
                "port {number}: there is no device {}; plug the drives in (stable names stand in /dev/serial/by-id)",
                port.path
            )));
        }
    }
    Ok(())
}

/// Run files that were never closed.
fn parts(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.to_string_lossy().ends_with(runlog::PART_ENDING)).collect()
}

/// A number that tells this life of a process from its earlier ones; never 0.
fn incarnation() -> u32 {
    (clock::unix_ns() as u32 ^ std::process::id().rotate_left(16)).max(1)
}

/// `nims up`: the supervisor in the foreground.
///
/// # Errors
/// It did not come up, or a vital process died on the way.
pub fn up(asked: &crate::cli::Up, domain: Option<&str>) -> Answer<Ending> {
    if let Some(seconds) = asked.seconds.filter(|seconds| !(*seconds > 0.0 && *seconds < 1e7)) {
        return Err(Failure::BadInput(format!("--for is {seconds}; accepted: seconds above 0")));
    }
    let wanted = Wanted { box_path: &asked.config, run: asked.run.as_deref(), domain, mission: None };
    let mut supervisor = Supervisor::start(&wanted, stop_flag()?)?;
    let limit = asked.seconds.map(Duration::from_secs_f64).unwrap_or(Duration::MAX / 4);
    supervisor.voice.info(&format!(
        "{} runs in {}; Ctrl-C ends it",
        supervisor.file.name,
        supervisor.folder.path().display()
    ));
    let started = clock::now_ns();
    let mut watched = Ok(());
    while watched.is_ok()
        && !supervisor.is_stopping()
        && clock::now_ns() - started < limit.as_nanos().min(u128::from(u64::MAX)) as u64
    {
        let left = limit.saturating_sub(Duration::from_nanos(clock::now_ns() - started));
        watched = supervisor.watch(left.min(Duration::from_secs(1)));
    }
    let because = match &watched {
        Err(failure) => failure.to_string(),
        Ok(()) if supervisor.is_stopping() => "a signal".to_owned(),
        Ok(()) => "the time was over".to_owned(),
    };
    // Whatever went wrong here, no process is left without its supervisor.
    let ending = supervisor.end(&because);
    watched.map(|()| ending)
}
