//! Starts the processes of a system file, each when the processes that it needs are ready.

use super::announcer::Announcer;
use super::archive::Archive;
use super::cleanup::Cleanup;
use super::copies::Restored;
use super::file_work::FileWork;
use super::heartbeats::Heartbeats;
use super::managed_process::{ManagedProcess, Start, ending};
use super::mission::Missions;
use super::process_set::ProcessSet;
use super::process_spec::{ProcessSpec, RunContext};
use super::recording::Recording;
use super::refused::{Decision, bus_failed, not_started};
use super::restarts::Restarts;
use super::run_folder::{Leftover, RunFolder};
use super::service_manager::ServiceManager;
use super::settings::Settings;
use super::stale_processes::{self, ProcessIdentity};
use super::unfinished_runs::UnfinishedRuns;
use super::wakeup::Wakeup;
use super::{StartOptions, Supervisor};
use bus::clock::{self, WallClock};
use bus::{Bus, Claim, Domain, FormerPlaces};
use client::{RUNNING_FILE, Running, SUPERVISOR};
use command::{Answer, Failure, StopFlag};
use config::{Role, SystemFile};
use evidence::busy;
use evidence::busy::SystemLoad;
use messages::{Heartbeat, put_text};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Longest time from the start of a process to its readiness, ns. motor-io may have to find and query the drives first.
pub(super) const READY_NS: u64 = 20_000_000_000;
/// Longest time for one process, from the wait for its disk to its readiness, and a margin.
const START_OF_ONE: Duration = Duration::from_nanos(2 * READY_NS + 5_000_000_000);
/// Time after which a warning names the processes that are not ready yet, ns.
const WAIT_WARNING_NS: u64 = 3_000_000_000;
/// Free shared memory that the start of a process requires: motor-io, which publishes most, takes 3 MB.
const PROCESS_BYTES: usize = 3 << 20;
/// As [`PROCESS_BYTES`], for a plugged process: its samples may be large. It rejects by itself what does not fit.
const SENSOR_BYTES: usize = 6 << 20;
/// Longest wait of a service for a device, ns; less than its `TimeoutStartSec=90`, which the start of each process
/// extends.
const DEVICE_NS: u64 = 30_000_000_000;
/// Pause between two looks for a device, ns.
const DEVICE_POLL_NS: u64 = 100_000_000;
/// Pause between two looks at the heartbeat while file work is waited for: half of its period.
const BESIDE: Duration = Duration::from_millis(100);
/// Polling period during the start, ns: it adds to the time until the robot is up.
const POLL_NS: u64 = 2_000_000;

/// Result of the file work for a process.
struct Started {
    restored: Restored,
    /// The process, and what it could not be given.
    child: Decision<(ManagedProcess, Option<String>)>,
    /// Its files that belong into the run folder.
    files: Vec<PathBuf>,
}

/// Loads the context of a run from the run's copy of the configuration.
fn site_of_run(folder: &RunFolder, archive: &Archive, system_path: &Path, domain: &Domain) -> Answer<RunContext> {
    let config = folder.resolved();
    let file = SystemFile::load(&config).map_err(Failure::not_now)?;
    let mut context = RunContext {
        file,
        system_path: system_path.to_path_buf(),
        config,
        motor_box_config: folder.for_motor_box(),
        copies: BTreeMap::new(),
        domain: domain.name().to_owned(),
        run: folder.path().to_path_buf(),
    };
    for (process, original) in context.files_of_commands() {
        if let Some(copy) = archive.copy_for(&process, original.clone(), Archive::deadline()) {
            context.copies.insert(original, copy);
        }
    }
    Ok(context)
}

impl Supervisor {
    /// Cleans up the domain, creates the run folder, and starts every process when those that it needs are ready.
    ///
    /// # Errors
    /// The domain is taken, or a process does not come up; the processes that were started are stopped again.
    pub(super) fn start(wanted: &StartOptions<'_>, wakeup: Wakeup) -> Answer<Self> {
        // Applies to runs, position and shared memory, also those of the started processes.
        bus::make_private();
        // Measured before the robot's own processes load the machine.
        let busy = SystemLoad::read();
        let system_path = std::path::absolute(wanted.system_path).map_err(Failure::bad)?;
        let file = SystemFile::load(&system_path).map_err(Failure::bad)?;
        let mut manager = ServiceManager::of_environment();
        let is_service = manager.is_there();
        wait_for_ports(&file, &mut manager, &wakeup.stop)?;
        let domain = Domain::parse(wanted.domain.unwrap_or(&file.name))?;
        let claim = domain.claim()?;
        // Every process reads it when it joins: first, because an observer may join at any time.
        domain.set_processes(file.bus.processes)?;
        let earlier = Running::read(&domain);
        let orphans = stale_processes::end(&domain)?;
        domain.sweep()?;
        let folder = RunFolder::create(&file, &system_path, wanted.run, wanted.mission)?;
        // Recorder, visualization and viewer convert stamps to calendar time with this pair.
        let clock = runlog::RunClock::now();
        domain.set_wall_clock(Some(WallClock { unix_ns: clock.t0_unix_ns, mono_ns: clock.t0_mono_ns }))?;
        let run = folder.path().to_path_buf();
        // A service starts again and again while the drives have no power. A run for each attempt would make the quota
        // remove the flights.
        let mut leftover = Leftover::of(&folder, is_service && wanted.run.is_none());
        let archive = Archive::open(&run, folder.copies().clone()).map_err(Failure::not_now)?;
        let context = site_of_run(&folder, &archive, &system_path, &domain)?;
        let members = context.members()?;

        let bus = Bus::join(&domain, SUPERVISOR)?;
        let running = Running { pid: std::process::id(), system_file: system_path, run };
        let text = serde_json::to_string(&running).map_err(Failure::not_now)?;
        stale_processes::write(&domain, RUNNING_FILE, &text)?;

        let mut supervisor = Self::assemble(bus, domain, claim, context, folder, archive, wakeup)?;
        if let Some(warning) = busy.warning() {
            supervisor.announcer.warn(&warning);
        }
        if let Some(excess) = supervisor.context.file.excess() {
            supervisor.announcer.warn(&format!("{excess}; {}", excess.cure()));
        }
        supervisor.report_former_places();
        if !orphans.is_empty() {
            supervisor.announcer.warn(&format!("ended processes of an earlier supervisor: {}", orphans.join(", ")));
        }
        if let Err(failure) = supervisor.bring_up(members) {
            supervisor.manager.stopping();
            supervisor.close("a process did not come up");
            if leftover.is_removed() {
                supervisor.print_diagnostics();
                return Err(failure);
            }
            let run = supervisor.folder.path().display();
            let in_run = format!("{failure}; the run is in {run}");
            return Err(failure.with_sentence(in_run));
        }
        // If this fails, the end of the run tries again.
        supervisor.stopper = supervisor.bus.client(client::MOTOR_IO).ok();
        supervisor.beat.state = Heartbeat::STATE_READY;
        supervisor.record_processes();
        supervisor.recover_unfinished_runs(earlier);
        supervisor.report_status();
        supervisor.manager.ready();
        leftover.keep();
        Ok(supervisor)
    }

    fn assemble(
        bus: Bus,
        domain: Domain,
        claim: Claim,
        context: RunContext,
        folder: RunFolder,
        archive: Archive,
        wakeup: Wakeup,
    ) -> Answer<Self> {
        let mut beat = Heartbeat {
            pid: std::process::id(),
            incarnation: incarnation(),
            state: Heartbeat::STATE_STARTING,
            ..Default::default()
        };
        put_text(&mut beat.name, SUPERVISOR);
        let server = bus.server(SUPERVISOR)?;
        let settings = Settings::new(&bus, &context, beat.incarnation)?;
        let mut waiter = bus.waiter(&[server.event()])?;
        waiter.attach(wakeup.descriptor()?)?;
        Ok(Self {
            process_set: ProcessSet::default(),
            settings,
            context,
            folder,
            archive,
            file_work: FileWork::default(),
            unfinished_runs: UnfinishedRuns::default(),
            wakeup,
            heartbeats: Heartbeats::default(),
            cleanup: Cleanup::new(&domain),
            died: Vec::new(),
            announcer: Announcer::new(&bus)?,
            manager: ServiceManager::of_environment(),
            busy: busy::Watch::new(),
            heartbeat: bus.publisher(&format!("system/heartbeat/{SUPERVISOR}"))?,
            table: bus.publisher("system/process")?,
            published_rows: HashMap::new(),
            authority: bus.newest("motor/authority")?,
            last_authority: None,
            recording: Recording::new(&bus)?,
            mission: Missions::new(&bus)?,
            requests: bus.subscriber("operator/request")?,
            stopper: None,
            beat,
            last_beat_ns: 0,
            last_part_ns: 0,
            next_part: 0,
            waiter,
            server: Some(server),
            bus,
            domain,
            claim,
        })
    }

    /// Reports places that were reserved before this start, for another number of processes.
    fn report_former_places(&mut self) {
        let Some(FormerPlaces { processes, stated, holders }) = self.bus.former_places() else { return };
        let holders = if holders.is_empty() { "one that has ended".to_owned() } else { holders.join(", ") };
        self.announcer.warn(&format!(
            "the robot has places for {processes} processes, not for the {stated} of `processes` of [bus], because of programs from before its start: {holders}; end them and start the robot again"
        ));
    }

    /// Starts to close the run files that earlier runs left open. `earlier` is only a hint: a power cut erases it.
    fn recover_unfinished_runs(&mut self, earlier: Option<Running>) {
        let present = self.folder.path().to_path_buf();
        let mut folders = vec![self.context.file.runs.clone()];
        folders.extend(present.parent().map(Path::to_path_buf));
        let runs = earlier.into_iter().map(|earlier| earlier.run).collect();
        match UnfinishedRuns::recover(folders, runs, present, self.context.file.recorder.min_free_bytes) {
            Ok(unfinished_runs) => self.unfinished_runs = unfinished_runs,
            Err(error) => self.announcer.error(&format!("earlier runs could not be recovered: {error}")),
        }
    }

    /// Starts all processes and waits until they are ready.
    fn bring_up(&mut self, mut waiting: Vec<ProcessSpec>) -> Answer {
        let mut named = clock::now_ns() + WAIT_WARNING_NS;
        loop {
            let may_start = |member: &ProcessSpec| self.is_ready_for(member) && !needs_one_of(member, &waiting);
            let (now, later): (Vec<ProcessSpec>, Vec<ProcessSpec>) = waiting.iter().cloned().partition(may_start);
            waiting = later;
            for member in now {
                self.manager.extend_start(START_OF_ONE);
                self.launch(&member, Restarts::default())?;
                // Starting hundreds takes longer than motor-io waits for a sign of life.
                self.heartbeat_if_due()?;
            }
            self.poll_heartbeats()?;
            self.heartbeat_if_due()?;
            self.refresh_table()?;
            let mut missing = Vec::new();
            for child in self.process_set.iter_mut().filter(|child| child.member.sends_heartbeats) {
                if !child.is_alive() {
                    let status = child.exit.map(ending).unwrap_or_default();
                    let code = child.exit.and_then(|exit| exit.code());
                    let sentence = format!(
                        "{} did not come up: {}",
                        child.member.name,
                        child.last_diagnostic().unwrap_or(&status)
                    );
                    return Err(if code == Some(2) { Failure::bad(sentence) } else { Failure::not_now(sentence) });
                }
                if child.ready_ns.is_none() {
                    if clock::now_ns() >= child.started_ns + READY_NS {
                        let log = self.folder.log(&child.member.name);
                        let why = child.last_line().unwrap_or_else(|| format!("see {}", log.display()));
                        return Err(Failure::NotNow(format!(
                            "{} does not become ready within {} s: {why}",
                            child.member.name,
                            READY_NS / 1_000_000_000,
                        )));
                    }
                    missing.push(match child.last_line() {
                        Some(line) if clock::now_ns() >= named => format!("{} ({line})", child.member.name),
                        _ => child.member.name.clone(),
                    });
                }
            }
            if waiting.is_empty() && missing.is_empty() {
                return self.publish_table();
            }
            self.manager.set_status(&format!("starting: waiting for {}", missing.join(", ")));
            if self.is_stopping() {
                return Err(Failure::NotNow("stopped while starting".to_owned()));
            }
            if clock::now_ns() >= named {
                named = u64::MAX;
                self.announcer.warn(&format!("still waiting for {}", missing.join(", ")));
            }
            clock::sleep_until(clock::now_ns() + POLL_NS);
        }
    }

    /// Prints the last lines of the processes that did not come up, for the log of the service: their own is removed
    /// with the run.
    fn print_diagnostics(&mut self) {
        let missing = |child: &&ManagedProcess| child.ready_ns.is_none() || child.has_died();
        let said = |child: &ManagedProcess| {
            child.last_lines().into_iter().map(|line| format!("{}: {line}", child.member.name)).collect::<Vec<_>>()
        };
        for line in self.process_set.iter().filter(missing).flat_map(said).collect::<Vec<_>>() {
            self.announcer.info(&line);
        }
    }

    /// Whether all started processes of the roles that it needs are ready.
    fn is_ready_for(&self, member: &ProcessSpec) -> bool {
        let needs = member.starts_after();
        self.process_set
            .iter()
            .filter(|child| child.member.sends_heartbeats && needs.contains(&child.member.role))
            .all(|child| child.ready_ns.is_some())
    }

    /// Starts one process, which replaces an earlier incarnation.
    pub(super) fn launch(&mut self, member: &ProcessSpec, restarts: Restarts) -> Decision<()> {
        let child = self.spawn(member, restarts, false)?;
        self.process_set.insert(child);
        self.record_living();
        Ok(())
    }

    /// Starts one process. `succeeds`: another process of its name still runs.
    pub(super) fn spawn(
        &mut self,
        member: &ProcessSpec,
        restarts: Restarts,
        succeeds: bool,
    ) -> Decision<ManagedProcess> {
        let bytes = if member.role == Role::Other { SENSOR_BYTES } else { PROCESS_BYTES };
        self.bus.room_for(bytes, &member.name).map_err(|why| not_started(&member.name, why))?;
        self.heartbeats.listen(&self.bus, &member.name).map_err(|why| not_started(&member.name, why))?;
        let started = self.settings.configured(member, &self.context.config);
        let (domain, changes) = (self.context.domain.clone(), self.settings.changes());
        let (run, log) = (self.folder.path().to_path_buf(), self.folder.log(&member.name));
        let copies = self.folder.copies().clone();
        let work = move || {
            // A removed run folder must not prevent the start of a process.
            let _ = std::fs::create_dir_all(run.join("log"));
            let restored = copies.restore(&run);
            let with = Start { domain: &domain, changes, succeeds, log: &log };
            let child = ManagedProcess::start(&started, with, restarts);
            Started { restored, child, files: started.files_to_copy(&run) }
        };
        let undo = |late: Started| {
            if let Ok((child, _)) = late.child {
                child.end_late();
            }
        };
        let Started { restored, child, files } = self.in_time(&member.name, work, undo)?;
        self.report_restored(&restored);
        let (mut child, warning) = child?;
        // Keeps the original arguments: its next start includes the parameters that are set until then.
        child.member = member.clone();
        for file in files {
            self.archive.copy_process_file(&member.name, file);
        }
        if let Some(warning) = warning {
            self.announcer.warn(&format!("{}: {warning}", member.name));
        }
        Ok(child)
    }

    /// Does file work for a process beside the loop, and waits for the result no longer than the other processes may be
    /// without supervision.
    pub(super) fn in_time<T: Send + 'static>(
        &mut self,
        process: &str,
        work: impl FnOnce() -> T + Send + 'static,
        undo: impl FnOnce(T) + Send + 'static,
    ) -> Decision<T> {
        let pending = self.file_work.begin(process, work, undo).map_err(|why| not_started(process, why))?;
        let is_starting = self.beat.state == Heartbeat::STATE_STARTING;
        let patience = if is_starting { Duration::from_nanos(READY_NS) } else { self.file_work.patience() };
        let give_up = Instant::now() + patience;
        loop {
            self.heartbeat_if_due().map_err(bus_failed)?;
            let left = give_up.saturating_duration_since(Instant::now());
            if let Some(result) = pending.wait(left.min(BESIDE)).map_err(|why| not_started(process, why))? {
                pending.end();
                return Ok(result);
            }
            let is_cancelled = is_starting && self.is_stopping();
            if left.is_zero() || is_cancelled {
                self.file_work.give_up(process, pending);
                if is_cancelled {
                    return Err(not_started(process, "stopped while starting"));
                }
                return Err(not_started(process, "the disk of the run or of its program does not answer"));
            }
        }
    }

    /// Records the running processes, for the run folder and for the next supervisor.
    pub(super) fn record_living(&mut self) {
        if self.beat.state == Heartbeat::STATE_READY {
            self.record_processes();
        }
        let successors = self.process_set.successors.iter().map(|successor| &successor.child);
        let started: Vec<ProcessIdentity> = (self.process_set.iter().chain(successors))
            .filter(|child| child.exit.is_none())
            .filter_map(|child| child.identity.clone())
            .collect();
        // Not fatal: the processes run, and the next supervisor also finds them in the domain.
        if let Err(failure) = stale_processes::record(&self.domain, &started) {
            self.announcer.warn(&failure.to_string());
        }
    }

    /// Restores a removed run folder with everything that the supervisor still holds of the run.
    pub(super) fn restore_folder(&self) {
        self.archive.restore(self.folder.manifest());
    }

    /// Reports what the start of a process restored in the run folder, and restores the rest of a removed one.
    fn report_restored(&mut self, restored: &Restored) {
        if restored.gone && restored.back.is_ok() {
            self.restore_folder();
        }
        if let Some(sentence) = restored.sentence(self.folder.path()) {
            self.announcer.warn(&sentence);
        }
    }
}

/// Whether it needs a role of which a process is not started yet.
fn needs_one_of(member: &ProcessSpec, waiting: &[ProcessSpec]) -> bool {
    waiting.iter().any(|other| member.starts_after().contains(&other.role))
}

/// Checks that every configured device exists. A service waits for one whose hub gets its power later: its manager
/// would start it again every few seconds, day and night, and fill the log.
fn wait_for_ports(file: &SystemFile, manager: &mut ServiceManager, stop: &StopFlag) -> Answer {
    let give_up = clock::now_ns() + DEVICE_NS;
    loop {
        let found = ports_are_there(file, manager.is_there());
        let Err(Failure::NotNow(sentence)) = &found else { return found };
        if clock::now_ns() >= give_up || stop.load(Ordering::Relaxed) {
            return found;
        }
        manager.set_status(&format!("waiting: {sentence}"));
        clock::sleep_until(clock::now_ns() + DEVICE_POLL_NS);
    }
}

/// Checks that every configured device exists; the virtual motor box creates its own. A service may find it later.
fn ports_are_there(file: &SystemFile, is_service: bool) -> Answer {
    for (index, port) in file.motor_io.ports.iter().enumerate() {
        let number = index + 1;
        if port.path.contains("{domain}") {
            if file.motor_box.is_none() {
                return Err(Failure::BadInput(format!(
                    "port {number} is on the virtual motor box, and the system file has no [motor_box]: give the path of the real device, or add [motor_box]"
                )));
            }
        } else if !Path::new(&port.path).exists() {
            let sentence = format!(
                "port {number}: there is no device {}; plug in the drives (/dev/serial/by-id has stable names)",
                port.path
            );
            return Err(if is_service { Failure::NotNow(sentence) } else { Failure::BadInput(sentence) });
        }
    }
    Ok(())
}

/// Number that distinguishes this incarnation of the supervisor from earlier ones; never 0.
fn incarnation() -> u32 {
    (clock::unix_ns() as u32 ^ std::process::id().rotate_left(16)).max(1)
}
