//! The chassis of a process: its connection to the bus, its heartbeat, its log, and its orderly end.

use std::fmt::Debug;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bus::clock::now_ns;
use bus::{Bus, BusError, Domain, Participant, Publisher, Waiter, Wake};
use messages::{Heartbeat, Message, Slot, put_text};
use signal_hook::consts::{SIGINT, SIGTERM};
use tracing::{error, info, warn};

use crate::args::CommonArgs;
use crate::bad_input::BadInput;
use crate::build::{self, Program};
use crate::declared::{DeclaredConfig, FirstOutput};
use crate::lease;
use crate::logging::{self, Log};
use crate::output::{Output, OutputFaultInjector};
use crate::realtime;
use crate::timing::Timing;
use crate::tuning::{TUNED_CHANNEL, Tuning};
use config::ConfigError;
use config::file;
use config::{RealtimeSection, RobotFile, SystemFile};

/// Time between two heartbeats, ns: the supervisor detects a silent process within half a second.
const BEAT_NS: u64 = 200_000_000;
/// Time by which a process that is awake sends its heartbeat early, ns: one that wakes at 100 Hz or more often is not
/// woken for heartbeats alone.
const EARLY_NS: u64 = 15_000_000;

/// Environment variable with the domain, which the supervisor sets for every process that it starts.
pub const DOMAIN_VARIABLE: &str = "NIMS_DOMAIN";
/// Environment variable with the name of the process, set by the supervisor.
pub const NAME_VARIABLE: &str = "NIMS_NAME";
/// Environment variable set by the supervisor if a process of the same name runs until this one has published its first
/// sample; the channels of the name are free only then.
pub const SUCCESSOR_VARIABLE: &str = "NIMS_SUCCESSOR";

/// Text of the last log event of a process that ends in an orderly way.
pub const ENDED: &str = "ended in order";

/// Environment variable with the number of changes by `nims set` that the system file contains, set by the supervisor.
pub const CHANGES_VARIABLE: &str = "NIMS_CHANGES";

fn from_the_supervisor(variable: &str) -> Option<String> {
    std::env::var(variable).ok().filter(|value| !value.is_empty())
}

/// State of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProcessStatus {
    /// The process is starting.
    Starting,
    /// The process is ready.
    Ready,
    /// The process is ending.
    Stopping,
}

/// The chassis of a process.
pub struct Chassis {
    bus: Bus,
    system_file: Option<SystemFile>,
    slot: Slot,
    stop: Arc<AtomicBool>,
    stop_pipe: OwnedFd,
    log: Log,
    declared: DeclaredConfig,
    /// `None` while a predecessor of the same name publishes.
    heartbeat: Option<Publisher<Heartbeat>>,
    beat: Heartbeat,
    next_beat_ns: u64,
    timing: Timing,
    fault_injector: Option<OutputFaultInjector>,
    life: ProcessStatus,
}

impl Chassis {
    /// Reads the system file, if one is given, joins the domain (`--domain`, [`DOMAIN_VARIABLE`], or the name of the
    /// system), and sets up signals, log, heartbeat and real-time scheduling.
    ///
    /// # Errors
    /// [`ConfigError`] for the system file, [`BadInput`] without a domain or if a process of that name already runs
    /// there, [`BusError`] otherwise.
    pub fn start(role: &str, args: &CommonArgs) -> anyhow::Result<Self> {
        Self::start_as(role, args, Participant::Member)
    }

    /// As [`Chassis::start`], as a participant of this kind, which leaves places to more important kinds.
    ///
    /// # Errors
    /// As [`Chassis::start`].
    pub fn start_as(role: &str, args: &CommonArgs, party: Participant) -> anyhow::Result<Self> {
        let system_file = args.load_system()?;
        let named = args.domain.clone().or_else(|| from_the_supervisor(DOMAIN_VARIABLE));
        let domain = match (&named, &system_file) {
            (Some(domain), _) => domain,
            (None, Some(system_file)) => &system_file.name,
            (None, None) => {
                return Err(BadInput(
                    "no domain: give a system file with --system FILE, or a domain with --domain NAME".to_owned(),
                )
                .into());
            }
        };
        let given = args.name.is_none().then(|| from_the_supervisor(NAME_VARIABLE)).flatten();
        let name = given.unwrap_or_else(|| args.name_for(role));
        if name.is_empty()
            || !name.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-')
            || name.len() > 31
        {
            return Err(BadInput(format!(
                "the process name is `{name}`; accepted: 1 to 31 of a-z, 0-9 and `-`, see --name"
            ))
            .into());
        }
        let domain = Domain::parse(domain)?;
        // First, so that a signal during the start also causes an orderly end.
        let (stop, stop_pipe) = stop_on_signals()?;
        let bus = Bus::join_as(&domain, &name, party)?;
        let beat = first_beat(&name);
        let ports = from_the_supervisor(SUCCESSOR_VARIABLE).is_none().then(|| lease::open(&bus)).transpose()?;
        let (heartbeat, port) = ports.unzip();
        let file = args.system_file.as_deref().zip(system_file.as_ref());
        let declared = DeclaredConfig::new(port, &name, beat.incarnation, role, file);
        let log = logging::start(&bus, args.verbose)?;
        if let Some(full) = bus.unannounced() {
            warn!("{full}; until then this process finds new channels, and its own are found, up to a second later");
        }
        let nothing = RealtimeSection::default();
        let (reached, warning) = realtime::apply(system_file.as_ref().map_or(&nothing, |file| &file.realtime), role);
        if let Some(warning) = warning {
            warn!("{warning}");
        }
        let beat = Heartbeat {
            realtime: u8::from(reached.fifo),
            locked: u8::from(reached.locked),
            pinned: u8::from(reached.pinned),
            ..beat
        };
        let mut chassis = Self {
            beat,
            declared,
            bus,
            system_file,
            slot: args.slot,
            stop,
            stop_pipe,
            log,
            heartbeat,
            next_beat_ns: 0,
            timing: Timing::new(),
            fault_injector: None,
            life: ProcessStatus::Starting,
        };
        chassis.idle()?;
        Ok(chassis)
    }

    /// Returns the bus.
    #[must_use]
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// Returns the name of this process.
    #[must_use]
    pub fn name(&self) -> &str {
        self.bus.process()
    }

    /// Returns the slot of this process.
    #[must_use]
    pub fn slot(&self) -> Slot {
        self.slot
    }

    /// Returns the system file.
    ///
    /// # Errors
    /// [`BadInput`] if none was given.
    pub fn system_file(&self) -> Result<&SystemFile, BadInput> {
        self.system_file.as_ref().ok_or_else(|| BadInput("no system file: give one with --system FILE".to_owned()))
    }

    /// Returns the incarnation: a random number of this run of the process, never 0.
    #[must_use]
    pub fn incarnation(&self) -> u32 {
        self.beat.incarnation
    }

    /// Declares the process ready; published at once.
    ///
    /// # Errors
    /// Those of publishing.
    pub fn ready(&mut self) -> Result<(), BusError> {
        self.declared.ready(now_ns())?;
        self.life = ProcessStatus::Ready;
        self.send_beat(now_ns())
    }

    /// Declares this process a custom program: the run stores its name, version and sources instead of the version of
    /// nims. To be called before [`Chassis::ready`].
    pub fn is_program(&mut self, program: &Program) {
        put_text(&mut self.beat.version, &program.described());
        self.declared.set_program(program);
    }

    /// Declares the law and the parameters, as TOML, that this process uses instead of those in the system file. They
    /// are published on `system/config/NAME` when the process is ready.
    pub fn uses(&mut self, law: &str, parameters: &str) {
        self.declared.uses(law, parameters);
    }

    /// As [`Chassis::uses`], with the first output to which they apply; published at once if the process is ready.
    ///
    /// # Errors
    /// Those of publishing.
    pub fn uses_since(&mut self, law: &str, parameters: &str, since: FirstOutput) -> Result<(), BusError> {
        self.declared.uses(law, parameters);
        self.declared.since(since, now_ns())
    }

    /// Declares that the process uses its own file, whose keys are its parameters. It must have read and checked the
    /// file.
    pub fn reads(&mut self, file: &Path) {
        self.declared.read(file, &[PathBuf::from(file)]);
        let keys = file::read_text(file).ok().and_then(|text| text.parse::<toml::Table>().ok());
        self.declared.uses("", &keys.and_then(|keys| toml::to_string(&keys).ok()).unwrap_or_default());
    }

    /// Receives parameters that are set while the robot runs; `make` converts the changed system file to what the
    /// process needs.
    ///
    /// # Errors
    /// [`BadInput`] without a system file; those of opening a channel.
    pub fn tuning<T>(
        &self,
        make: impl FnMut(&SystemFile, &RobotFile) -> anyhow::Result<T> + 'static,
    ) -> anyhow::Result<Tuning<T>> {
        let file = self.system_file()?.clone();
        let robot = file.robot_file()?;
        Ok(Tuning::new(self.bus.subscriber(TUNED_CHANNEL)?, file, robot, Box::new(make), self.changes()))
    }

    /// Returns the number of changes by `nims set` that the system file contains.
    #[must_use]
    pub fn changes(&self) -> u32 {
        from_the_supervisor(CHANGES_VARIABLE).and_then(|number| number.parse().ok()).unwrap_or(0)
    }

    /// Returns whether the process continues; false after a signal or [`Chassis::stop`].
    #[must_use]
    pub fn running(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Requests the end of the process, as SIGTERM does.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Creates a waiter for these channels that a signal wakes too, also if it arrived before the wait.
    ///
    /// # Errors
    /// Those of [`Bus::waiter`].
    pub fn waiter(&self, channels: &[&str]) -> Result<Waiter, BusError> {
        let mut waiter = self.bus.waiter(channels)?;
        // A process that could not announce its channels has warned already.
        if let Some(full) = waiter.deaf().filter(|_| self.bus.unannounced().is_none()) {
            warn!("{full}; until then this process finds new channels up to a second later");
        }
        let copy = self.stop_pipe.try_clone().map_err(|error| BusError::Failed {
            channel: "signals".to_owned(),
            what: "be waited for",
            why: error.to_string(),
        })?;
        waiter.attach(copy)?;
        Ok(waiter)
    }

    /// Does the housekeeping ([`Chassis::idle`]), then waits until a sample arrives, `deadline_ns` is reached, or the
    /// next heartbeat is due; so it may return without a sample. Call it in a loop while [`Chassis::running`].
    ///
    /// # Errors
    /// Those of [`Waiter::wait_until`] and of publishing.
    pub fn wait(&mut self, waiter: &mut Waiter, deadline_ns: Option<u64>) -> Result<Wake, BusError> {
        let more_to_log = !self.idle()?;
        let due = if more_to_log { 0 } else { self.next_beat_ns };
        waiter.wait_until(Some(deadline_ns.map_or(due, |deadline| deadline.min(due))))
    }

    /// Publishes log events and, if it is due or will be soon, the heartbeat; takes a few microseconds. Loops with
    /// their own pacing call it once per pass, in their idle time. Returns whether no log event is left.
    ///
    /// # Errors
    /// Those of publishing.
    pub fn idle(&mut self) -> Result<bool, BusError> {
        let now = now_ns();
        if now + EARLY_NS >= self.next_beat_ns {
            self.send_beat(now)?;
        }
        if let Some(fault_injector) = &mut self.fault_injector {
            fault_injector.poll()?;
        }
        self.log.publish()
    }

    /// Records the start of a pass of the loop.
    pub fn pass_begin(&mut self) {
        self.timing.begin(now_ns());
    }

    /// Records the end of a pass; the heartbeat contains the durations.
    pub fn pass_end(&mut self) {
        self.timing.end(now_ns());
    }

    /// Creates a publisher for the output of a controller or estimator. In a system with virtual drives it supports
    /// fault injection (`nims fault slow`, `nan`, `frozen`); [`Chassis::idle`] receives the requests.
    ///
    /// # Errors
    /// Those of opening a channel.
    pub fn output<T: Message>(&mut self, channel: &str) -> Result<Output<T>, BusError> {
        let accepts_faults = self.system_file.as_ref().is_some_and(|file| file.motor_box.is_some());
        if accepts_faults && self.fault_injector.is_none() {
            self.fault_injector = Some(OutputFaultInjector::new(&self.bus)?);
        }
        Ok(Output::new(self.bus.publisher(channel)?, self.fault_injector.as_ref()))
    }

    /// Returns the durations of the passes.
    #[must_use]
    pub fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Sets the number of samples lost over all inputs of this process, for the heartbeat.
    pub fn report_lost(&mut self, lost: u64) {
        self.beat.lost = lost;
    }

    fn send_beat(&mut self, now: u64) -> Result<(), BusError> {
        if self.heartbeat.is_none()
            && let Some((heartbeat, port)) = lease::take_over(&self.bus)?
        {
            self.heartbeat = Some(heartbeat);
            self.declared.set_port(port, now)?;
        }
        self.log.serve_late_subscribers();
        self.declared.update(now)?;
        let beat = &mut self.beat;
        (beat.header.stamp_ns, beat.header.oldest_input_ns) = (now, now);
        beat.beat += 1;
        beat.passes = self.timing.passes();
        beat.busy_p50_ns = self.timing.quantile_ns(0.5);
        beat.busy_p99_ns = self.timing.quantile_ns(0.99);
        beat.busy_max_ns = self.timing.max_ns();
        beat.state = match self.life {
            ProcessStatus::Starting => Heartbeat::STATE_STARTING,
            ProcessStatus::Ready => Heartbeat::STATE_READY,
            ProcessStatus::Stopping => Heartbeat::STATE_STOPPING,
        };
        self.next_beat_ns = now + BEAT_NS;
        self.heartbeat.as_mut().map_or(Ok(()), |port| port.send(beat).map(|_| ()))
    }
}

impl Drop for Chassis {
    /// Publishes the remaining log events and the last heartbeat.
    fn drop(&mut self) {
        self.life = ProcessStatus::Stopping;
        while matches!(self.log.publish(), Ok(false)) {}
        let _ = self.send_beat(now_ns());
        logging::flush();
    }
}

impl Debug for Chassis {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Chassis").field("bus", &self.bus).field("life", &self.life).finish_non_exhaustive()
    }
}

/// Runs a process: parses its arguments, starts the chassis, runs `body`, and reports a failure in one sentence.
///
/// Exit code 0: success; 2: an argument or a file is not accepted; 1: it could not be done now.
pub fn main<A>(role: &str, body: impl FnOnce(&A, &mut Chassis) -> anyhow::Result<()>) -> ExitCode
where
    A: clap::Parser + AsRef<CommonArgs>,
{
    main_as(role, Participant::Member, body)
}

/// As [`main`], for a participant of this kind, which leaves places to more important kinds.
pub fn main_as<A>(role: &str, party: Participant, body: impl FnOnce(&A, &mut Chassis) -> anyhow::Result<()>) -> ExitCode
where
    A: clap::Parser + AsRef<CommonArgs>,
{
    // A definition that several roles share has no name of its own.
    let command = A::command().display_name(role);
    let version = build::described(command.get_version().unwrap_or(build::VERSION));
    let command = if command.get_version().is_none() { command.version(build::description()) } else { command };
    let args = match command.try_get_matches().and_then(|given| A::from_arg_matches(&given)) {
        Ok(args) => args,
        // Also --help and --version.
        Err(error) => error.exit(),
    };
    bus::make_private();
    let mut chassis = match Chassis::start_as(role, args.as_ref(), party) {
        Ok(chassis) => chassis,
        Err(error) => {
            let _ = std::io::Write::write_all(&mut std::io::stderr(), format!("{role}: {error:#}\n").as_bytes());
            return exit_code(&error);
        }
    };
    put_text(&mut chassis.beat.version, &version);
    chassis.declared.set_version(&version);
    match body(&args, &mut chassis) {
        Ok(()) => {
            info!("{ENDED}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            error!("{error:#}");
            exit_code(&error)
        }
    }
}

/// Returns the exit code: 2 if the error is caused by bad input, otherwise 1.
#[must_use]
pub fn exit_code(error: &anyhow::Error) -> ExitCode {
    let given = error.chain().any(|cause| {
        cause.is::<BadInput>()
            || cause.is::<ConfigError>()
            || cause.downcast_ref::<BusError>().is_some_and(BusError::is_bad_input)
    });
    ExitCode::from(if given { 2 } else { 1 })
}

fn first_beat(name: &str) -> Heartbeat {
    let mut beat = Heartbeat { pid: std::process::id(), incarnation: incarnation(), ..Heartbeat::default() };
    put_text(&mut beat.name, name);
    beat
}

/// Returns a random number, never 0; the standard library takes its hash keys from the system's entropy.
fn incarnation() -> u32 {
    use std::hash::{BuildHasher, RandomState};
    (RandomState::new().hash_one((std::process::id(), now_ns())) as u32).max(1)
}

/// Makes SIGINT and SIGTERM set the flag and make the descriptor permanently readable.
fn stop_on_signals() -> anyhow::Result<(Arc<AtomicBool>, OwnedFd)> {
    let stop = Arc::new(AtomicBool::new(false));
    let (read, write) = rustix::pipe::pipe_with(rustix::pipe::PipeFlags::CLOEXEC)?;
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone())?; // before the pipe, so that a woken waiter finds the flag set
        signal_hook::low_level::pipe::register(signal, write.try_clone()?)?;
    }
    Ok((stop, read))
}
