//! What carries every process: its place on the bus, its life sign, its log, its end.

use std::fmt::Debug;
use std::os::fd::OwnedFd;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bus::clock::now_ns;
use bus::{Bus, BusError, Domain, Publisher, Waiter, Wake};
use messages::{Heartbeat, Message, put_text};
use signal_hook::consts::{SIGINT, SIGTERM};
use tracing::{error, info, warn};

use crate::args::{CommonArgs, Slot};
use crate::build;
use crate::config::{BoxFile, RealtimeSection};
use crate::logging::{self, Log};
use crate::output::{Output, Spoiler};
use crate::realtime::{self, Reached};
use crate::timing::Timing;
use crate::toml_file::ConfigError;

/// Five beats a second: the supervisor notices a silent process within half a second.
const BEAT_NS: u64 = 200_000_000;

/// What a dead process has left is removed within milliseconds; whoever does it may stand still meanwhile, ns.
const LEAVING_NS: u64 = 2_000_000_000;
/// Between two attempts to take the place of a dead process, ns.
const RETRY_NS: u64 = 20_000_000;

/// The supervisor tells whatever it starts, also a program without these arguments, in which domain it is and what it is called.
pub const DOMAIN_VARIABLE: &str = "NIMS_DOMAIN";
/// The same: its name.
pub const NAME_VARIABLE: &str = "NIMS_NAME";

fn from_the_supervisor(variable: &str) -> Option<String> {
    std::env::var(variable).ok().filter(|value| !value.is_empty())
}

/// Something the caller gave cannot be used; the program exits with 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);

/// Where a process is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Life {
    /// Not yet able to do its work.
    Starting,
    /// Working.
    Ready,
    /// Ending in order.
    Stopping,
}

/// The chassis of a process.
pub struct Chassis {
    bus: Bus,
    box_file: Option<BoxFile>,
    slot: Slot,
    stop: Arc<AtomicBool>,
    stop_pipe: OwnedFd,
    log: Log,
    heartbeat: Publisher<Heartbeat>,
    beat: Heartbeat,
    next_beat_ns: u64,
    timing: Timing,
    spoiler: Option<Spoiler>,
    life: Life,
}

impl Chassis {
    /// Reads the box file (if one is given), joins its domain (`--domain`, [`DOMAIN_VARIABLE`], or the name of the box), sets up signals, log, heartbeat and real-time scheduling.
    ///
    /// # Errors
    /// [`ConfigError`] for the box file, [`BadInput`] without a domain or if a process of that name already runs there, [`BusError`] otherwise.
    pub fn start(role: &str, args: &CommonArgs) -> anyhow::Result<Self> {
        let box_file = args.load_box()?;
        let named = args.domain.clone().or_else(|| from_the_supervisor(DOMAIN_VARIABLE));
        let domain = match (&named, &box_file) {
            (Some(domain), _) => domain,
            (None, Some(box_file)) => &box_file.name,
            (None, None) => {
                return Err(BadInput(
                    "no domain: give a box file with --box FILE, or a domain with --domain NAME".to_owned(),
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
                "the name `{name}` cannot be used: give 1 to 31 of a-z, 0-9 and `-` with --name"
            ))
            .into());
        }
        let domain = Domain::parse(domain)?;
        // first, so that a signal during start-up is an orderly stop too
        let (stop, stop_pipe) = stop_on_signals()?;
        let bus = Bus::join(&domain, &name)?;
        let heartbeat = take_name(&bus, &name)?;
        let log = logging::start(&bus, args.verbose)?;
        let nothing = RealtimeSection::default();
        let (reached, warning) = realtime::apply(box_file.as_ref().map_or(&nothing, |file| &file.realtime), role);
        if let Some(warning) = warning {
            warn!("{warning}");
        }
        let mut chassis = Self {
            beat: first_beat(&name, reached),
            bus,
            box_file,
            slot: args.slot,
            stop,
            stop_pipe,
            log,
            heartbeat,
            next_beat_ns: 0,
            timing: Timing::new(),
            spoiler: None,
            life: Life::Starting,
        };
        chassis.idle()?;
        Ok(chassis)
    }

    /// The bus.
    #[must_use]
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// The name of this process.
    #[must_use]
    pub fn name(&self) -> &str {
        self.bus.process()
    }

    /// The slot of its role.
    #[must_use]
    pub fn slot(&self) -> Slot {
        self.slot
    }

    /// The box file.
    ///
    /// # Errors
    /// [`BadInput`] if none was given.
    pub fn box_file(&self) -> Result<&BoxFile, BadInput> {
        self.box_file.as_ref().ok_or_else(|| BadInput("no box file: give one with --box FILE".to_owned()))
    }

    /// Non-zero random number of this process's life.
    #[must_use]
    pub fn incarnation(&self) -> u32 {
        self.beat.incarnation
    }

    /// The process can do its work from now on; published at once.
    ///
    /// # Errors
    /// Those of publishing.
    pub fn ready(&mut self) -> Result<(), BusError> {
        self.life = Life::Ready;
        self.send_beat(now_ns())
    }

    /// False once a signal, or [`Chassis::stop`], asked the process to end.
    #[must_use]
    pub fn running(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Asks the process to end, as SIGTERM does.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// A waiter for these channels that a signal wakes too, also one that came before the wait.
    ///
    /// # Errors
    /// Those of [`Bus::waiter`].
    pub fn waiter(&self, channels: &[&str]) -> Result<Waiter, BusError> {
        let mut waiter = self.bus.waiter(channels)?;
        let copy = self.stop_pipe.try_clone().map_err(|error| BusError::Failed {
            channel: "signals".to_owned(),
            what: "be waited for",
            why: error.to_string(),
        })?;
        waiter.attach(copy)?;
        Ok(waiter)
    }

    /// Does the housekeeping ([`Chassis::idle`]), then sleeps until something comes, `deadline_ns` is reached, or the next heartbeat is due;
    /// so it may return with nothing. Call it in a loop while [`Chassis::running`].
    ///
    /// # Errors
    /// Those of [`Waiter::wait_until`] and of publishing.
    pub fn wait(&mut self, waiter: &mut Waiter, deadline_ns: Option<u64>) -> Result<Wake, BusError> {
        let more_to_log = !self.idle()?;
        let due = if more_to_log { 0 } else { self.next_beat_ns };
        waiter.wait_until(Some(deadline_ns.map_or(due, |deadline| deadline.min(due))))
    }

    /// Publishes what has been logged and, if it is due, the heartbeat: a few microseconds. For loops that pace themselves: call it once
    /// per pass, in the slack. Returns true if nothing is left to be logged.
    ///
    /// # Errors
    /// Those of publishing.
    pub fn idle(&mut self) -> Result<bool, BusError> {
        let now = now_ns();
        if now >= self.next_beat_ns {
            self.send_beat(now)?;
        }
        if let Some(spoiler) = &mut self.spoiler {
            spoiler.look()?;
        }
        self.log.publish()
    }

    /// A pass of the loop begins.
    pub fn pass_begin(&mut self) {
        self.timing.begin(now_ns());
    }

    /// It ends; its duration goes into the heartbeat.
    pub fn pass_end(&mut self) {
        self.timing.end(now_ns());
    }

    /// A publisher of what the control chain goes by: the answer of a controller or an estimator. On a box with virtual drives it can be
    /// spoilt on request (`nims fault slow`, `nan`, `frozen`); the requests are taken in [`Chassis::idle`].
    ///
    /// # Errors
    /// Those of opening a channel.
    pub fn output<T: Message>(&mut self, channel: &str) -> Result<Output<T>, BusError> {
        let can_be_spoilt = self.box_file.as_ref().is_some_and(|file| file.motor_box.is_some());
        if can_be_spoilt && self.spoiler.is_none() {
            self.spoiler = Some(Spoiler::new(&self.bus)?);
        }
        Ok(Output::new(self.bus.publisher(channel)?, self.spoiler.as_ref()))
    }

    /// How long the passes took.
    #[must_use]
    pub fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Samples lost on the way to this process, over all its inputs, for the heartbeat.
    pub fn report_lost(&mut self, lost: u64) {
        self.beat.lost = lost;
    }

    fn send_beat(&mut self, now: u64) -> Result<(), BusError> {
        self.log.serve_late_listeners();
        let beat = &mut self.beat;
        (beat.header.stamp_ns, beat.header.oldest_input_ns) = (now, now);
        beat.beat += 1;
        beat.passes = self.timing.passes();
        beat.busy_p50_ns = self.timing.quantile_ns(0.5);
        beat.busy_p99_ns = self.timing.quantile_ns(0.99);
        beat.busy_max_ns = self.timing.max_ns();
        beat.state = match self.life {
            Life::Starting => Heartbeat::STATE_STARTING,
            Life::Ready => Heartbeat::STATE_READY,
            Life::Stopping => Heartbeat::STATE_STOPPING,
        };
        self.next_beat_ns = now + BEAT_NS;
        self.heartbeat.send(beat).map(|_| ())
    }
}

impl Drop for Chassis {
    /// Publishes the rest of the log and the last heartbeat.
    fn drop(&mut self) {
        self.life = Life::Stopping;
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

/// A whole process: parses its arguments, starts the chassis, runs `body`, and says in one sentence why it failed, if it did.
///
/// Exit code 0; 2 if an argument or a file cannot be used; 1 if it could not be done now.
pub fn main<A>(role: &str, body: impl FnOnce(&A, &mut Chassis) -> anyhow::Result<()>) -> ExitCode
where
    A: clap::Parser + AsRef<CommonArgs>,
{
    let args = A::parse();
    bus::make_private();
    let mut chassis = match Chassis::start(role, args.as_ref()) {
        Ok(chassis) => chassis,
        Err(error) => {
            let _ = std::io::Write::write_all(&mut std::io::stderr(), format!("{role}: {error:#}\n").as_bytes());
            return exit_code(&error);
        }
    };
    let version = <A as clap::CommandFactory>::command().get_version().unwrap_or(build::VERSION).to_owned();
    put_text(&mut chassis.beat.version, &build::described(&version));
    match body(&args, &mut chassis) {
        Ok(()) => {
            info!("ended in order");
            ExitCode::SUCCESS
        }
        Err(error) => {
            error!("{error:#}");
            exit_code(&error)
        }
    }
}

/// 2 if the error's cause is something that the caller gave, otherwise 1.
#[must_use]
pub fn exit_code(error: &anyhow::Error) -> ExitCode {
    let given = error.chain().any(|cause| {
        cause.is::<BadInput>()
            || cause.is::<ConfigError>()
            || cause.downcast_ref::<BusError>().is_some_and(BusError::is_bad_input)
    });
    ExitCode::from(if given { 2 } else { 1 })
}

fn first_beat(name: &str, reached: Reached) -> Heartbeat {
    let mut beat = Heartbeat {
        pid: std::process::id(),
        incarnation: incarnation(),
        realtime: u8::from(reached.fifo),
        locked: u8::from(reached.locked),
        pinned: u8::from(reached.pinned),
        ..Heartbeat::default()
    };
    put_text(&mut beat.name, name);
    beat
}

/// Random, never 0: the standard library's hash keys come from the system's entropy.
fn incarnation() -> u32 {
    use std::hash::{BuildHasher, RandomState};
    (RandomState::new().hash_one((std::process::id(), now_ns())) as u32).max(1)
}

/// The heartbeat of a name: whoever publishes it is the process of that name, and nobody else can be.
///
/// What a killed process of the same name has left may just be in the hands of another process that cleans up: that takes a moment.
fn take_name(bus: &Bus, name: &str) -> anyhow::Result<Publisher<Heartbeat>> {
    let give_up = now_ns() + LEAVING_NS;
    loop {
        match bus.publisher(&format!("system/heartbeat/{name}")) {
            Ok(heartbeat) => return Ok(heartbeat),
            Err(BusError::Full { .. }) if now_ns() < give_up && !lives(bus, name) => {
                bus::clock::sleep_until(now_ns() + RETRY_NS);
                bus.clean();
            }
            Err(BusError::Full { .. }) => return Err(BadInput(already_runs(bus, name)).into()),
            Err(other) => return Err(other.into()),
        }
    }
}

/// Whether another process of that name lives in the domain.
fn lives(bus: &Bus, name: &str) -> bool {
    bus.domain().alive().iter().any(|node| node.name == name && node.pid != std::process::id())
}

fn already_runs(bus: &Bus, name: &str) -> String {
    let domain = bus.domain();
    let other = domain.alive().into_iter().find(|node| node.name == name && node.pid != std::process::id());
    match other {
        Some(node) => format!(
            "a process named `{name}` already runs in the domain `{}` (process {}): stop it first, or give this one another --name",
            domain.name(),
            node.pid
        ),
        None => format!(
            "a process named `{name}` was killed in the domain `{}`, and what it left cannot be removed: end every process there and start again",
            domain.name()
        ),
    }
}

/// SIGINT and SIGTERM set the flag and make the descriptor readable for good.
fn stop_on_signals() -> anyhow::Result<(Arc<AtomicBool>, OwnedFd)> {
    let stop = Arc::new(AtomicBool::new(false));
    let (read, write) = rustix::pipe::pipe_with(rustix::pipe::PipeFlags::CLOEXEC)?;
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone())?; // before the pipe: whoever wakes sees the flag
        signal_hook::low_level::pipe::register(signal, write.try_clone()?)?;
    }
    Ok((stop, read))
}
