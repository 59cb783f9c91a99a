//! The process: core, drives and bus, connected once per period.

use crate::answer::Answer;
use crate::core::{Core, Observation};
use crate::drives::Drives;
use crate::inbox::Inbox;
use crate::kernel::Evidence;
use crate::odometry::Position;
use crate::position::{PositionFile, PositionWriter};
use crate::settings::{CoreConfig, SecondEncoders};
use bus::clock::{Pacer, SECOND_NS, Tick, now_ns};
use bus::{Bus, BusError, Call, Publisher, Server, Subscriber, Waiter, deadman, estop};
use config::{MotorIoSection, RobotFile, SystemFile};
use messages::{
    CABLES, DecodeError, Energy, Heartbeat, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState,
    NodeEstimate, OperatorRequest, PlanMotion, Request, RequestBody, SLOT_NAMES,
};
use robot_state::answers::detail;
use robot_state::sentences::{fault_sentences, faults_of, mode_sentence};
use robot_state::{DriveUnit, Reason};
use runtime::{BadInput, Chassis};
use std::path::Path;
use tracing::{info, warn};

/// Fraction of the period, from its scheduled begin, in which the drives must answer; the rest belongs to
/// estimator and controller.
const BUS_SHARE: f64 = 0.85;
/// Least fraction of the period for the drives, however late the cycle began.
const BUS_LEAST: f64 = 0.65;
/// Fraction of the period to wait for a late command: a hiccup of the machine then costs a little
/// delay and not a cycle.
const GRACE_SHARE: f64 = 0.2;
/// Least fraction of the period for the control chain's answer, however late the drives were ..
const ANSWER_LEAST: f64 = 0.5;
/// .. but at most until this fraction after the scheduled begin, because the drives need their time too.
const GRACE_MOST: f64 = 0.4;
/// Time between two samples of the energy, which changes slowly, s.
const ENERGY_S: f64 = 0.1;
/// Time for the drives to appear without a warning, s; the virtual motor box creates its ports while motor-io starts.
/// After it, a missing port is an error. motor-io waits for a unit that does not answer, and is not ready before.
const PATIENCE_S: f64 = 5.0;
/// Longest wait for a moving robot to come to rest at the end of the process, s.
const LAST_STOP_S: f64 = 3.0;

impl CoreConfig {
    /// Creates the configuration of a system and its robot.
    ///
    /// # Errors
    /// Names the key that cannot be used.
    pub fn from_files(system_file: &SystemFile, robot_file: &RobotFile) -> Result<Self, BadInput> {
        let section = &system_file.motor_io;
        let robot = robot_file.robot().map_err(|error| BadInput(error.to_string()))?;
        // The estimate is compared with this position, so both use the same stretch.
        let robot = if system_file.estimator.stretch { robot } else { robot.with_rigid_lines() };
        let units: Vec<Vec<usize>> = section
            .ports
            .iter()
            .flat_map(|port| &port.units)
            .map(|unit| unit.cables.iter().map(|cable| cable.wrapping_sub(1)).collect())
            .collect();
        let bad = |error: crate::ConfigError| BadInput(error.to_string());
        let mut config = Self::new(robot, 1.0 / system_file.rate_hz, &section.counts_per_m, &units).map_err(bad)?;
        config.cable_speed_m_s = robot_file.cable_speed_limit_m_s();
        config.ramp_s = section.ramp_s;
        config.stop_s = 0.5 * section.ramp_s;
        config.ttl_cycles = section.ttl_cycles;
        config.jog_speed_m_s = section.jog_speed_m_s;
        config.slack_n = section.slack_n;
        config.slack_cycles = section.slack_cycles;
        config.stall_duty = section.stall_duty;
        config.stall_cycles = section.stall_cycles;
        config.supply_min_v = section.supply_min_v;
        config.watchdog_s = section.watchdog_s;
        config.node_speed_margin = section.node_speed_margin;
        config.node_acceleration_m_s2 = section.node_acceleration_limit_m_s2.unwrap_or(config.node_acceleration_m_s2);
        config.correction_limit_m_s = section.correction_limit_m_s.unwrap_or(config.correction_limit_m_s);
        config.start_bound_m = section.start_bound_m;
        config.divergence_m = section.divergence_m;
        config.divergence_s = section.divergence_s;
        let arbiter = &system_file.arbiter;
        config.qualify_s = arbiter.qualify_s;
        config.command_bound = arbiter.command_bound;
        config.bias_share = arbiter.bias_share;
        config.bias_bound_m_s = arbiter.bias_bound_m_s;
        config.estimate_bound_m = arbiter.estimate_bound_m;
        config.announce_s = arbiter.announce_s;
        config.fade_s = arbiter.fade_s;
        config.probation_s = arbiter.probation_s;
        config.quarantine_falls = arbiter.quarantine_falls;
        config.forgive_s = arbiter.forgive_s;
        config.current_limit_a = robot_file.motor.current_limit_a;
        let without = section.ports.iter().position(|port| port.torque_constant_n_m_a.is_none());
        config.port_without_torque = without.map(|index| index + 1);
        config.second = second_encoders(section, robot_file);
        config.check().map_err(bad)?;
        Ok(config)
    }
}

fn second_encoders(section: &MotorIoSection, robot_file: &RobotFile) -> Option<SecondEncoders> {
    let mut counts_per_m = [1.0; CABLES];
    for (place, counts) in counts_per_m.iter_mut().zip(&section.second_counts_per_m) {
        *place = *counts;
    }
    let idler_m = robot_file.drum.as_ref().map_or(0.0, |drum| drum.idler_m);
    let (slip_m, slip_share) = (section.slip_m, section.slip_share);
    let step_counts =
        section.ports.iter().map(|port| crate::backend::second_step_counts(port.protocol)).fold(1.0, f64::max);
    let any = !section.second_counts_per_m.is_empty();
    any.then_some(SecondEncoders { counts_per_m, step_counts, slip_m, slip_share, idler_m })
}

/// Runs until the chassis ends it. `state_folder` keeps the position over restarts.
///
/// # Errors
/// [`BadInput`] for the configuration; a sentence with the port if the drives are missing.
pub fn run(chassis: &mut Chassis, state_folder: Option<&Path>) -> anyhow::Result<()> {
    let system_file = chassis.system_file()?.clone();
    let config = CoreConfig::from_files(&system_file, &system_file.robot_file()?)?;
    let beside_runs = system_file.state_folder();
    let folder = state_folder.unwrap_or(&beside_runs);
    let robot = system_file.state_name(chassis.bus().domain().name());
    let _awake = system_file
        .realtime
        .idle_latency_us
        .and_then(|latency_us| runtime::realtime::stay_awake(latency_us).map_err(|sentence| warn!("{sentence}")).ok());
    let mut keeper = PositionWriter::start(folder, &robot, &config)?;
    let restored = PositionFile::load(folder, &robot, &config).unwrap_or_else(|error| {
        warn!("{error}");
        None
    });
    let last_stop = config.cycles(LAST_STOP_S).into();
    let period_ns = (config.period_s * 1e9).round() as u64;
    let mut process = Process::open(chassis, &system_file, config, restored)?;
    let mut ending = 0_u64;
    let mut pacer = Pacer::new(period_ns);
    for cycle in 1_u64.. {
        let tick = pacer.next();
        chassis.pass_begin();
        if !chassis.running() {
            ending += 1;
            if process.core.is_at_rest() || ending > last_stop {
                break;
            }
            if ending == 1 {
                process.inbox.request(0, &Request::Stop.body());
            }
        }
        process.wait_for_command(cycle, &tick);
        let observation = process.cycle(cycle, &tick);
        keeper.store(process.core.position(), tick.woke_ns);
        if !process.ready && process.is_up(cycle, &observation)? {
            chassis.ready()?;
        }
        process.inbox.finish();
        chassis.report_lost(process.ports.lost());
        chassis.pass_end();
        // Now nothing waits for this thread until the next cycle, which it must not delay.
        process.drives.spend(process.exchange_until_ns.saturating_sub(tick.scheduled_ns + period_ns));
        process.reporter.bus(chassis.idle().map(|_| ()));
    }
    keeper.finish(process.core.position());
    Ok(())
}

/// Time limits within a cycle, ns.
struct Limits {
    bus_ns: u64,
    bus_least_ns: u64,
    grace_ns: u64,
    answer_least_ns: u64,
    grace_most_ns: u64,
}

impl Limits {
    fn new(period_s: f64) -> Self {
        let share = |share: f64| (period_s * 1e9 * share) as u64;
        Self {
            bus_ns: share(BUS_SHARE),
            bus_least_ns: share(BUS_LEAST),
            grace_ns: share(GRACE_SHARE),
            answer_least_ns: share(ANSWER_LEAST),
            grace_most_ns: share(GRACE_MOST),
        }
    }
}

/// The core with everything that it exchanges samples with.
struct Process {
    core: Core,
    inbox: Inbox,
    drives: Drives,
    ports: Ports,
    server: Server,
    emergency: estop::Receiver,
    deadman: deadman::Receiver,
    waiter: Waiter,
    reporter: Reporter,
    life: u64,
    limits: Limits,
    /// Cycles for the drives to appear.
    patience: u64,
    /// Cycles between two samples of the energy.
    energy_every: u64,
    /// All drive units have answered.
    ready: bool,
    /// Publication time of the newest state, ns.
    published_ns: u64,
    /// Deadline of the newest exchange with the drives, ns.
    exchange_until_ns: u64,
}

impl Process {
    fn open(
        chassis: &Chassis,
        system_file: &SystemFile,
        config: CoreConfig,
        restored: Option<Position>,
    ) -> anyhow::Result<Self> {
        let bus = chassis.bus();
        let drives = Drives::open(system_file, &config, bus.domain().root())?;
        for (port, reading) in drives.missing_readings() {
            warn!(
                "{port}: its drives do not report {reading}, so the faults of a cable that show in it are not detected"
            );
        }
        // A later life has a larger number; after a restart of the computer, the shared memory is empty.
        let life = now_ns().max(1);
        let mut inbox = Inbox::new(config.cable_count(), config.unit_count).of_life(life);
        inbox.first((chassis.incarnation() & 0x3fff_ffff).max(1), restored);
        Ok(Self {
            inbox,
            drives,
            ports: Ports::open(bus)?,
            server: bus.server(chassis.name())?,
            emergency: estop::Receiver::open(bus.domain())?,
            deadman: deadman::Receiver::open(bus.domain())?,
            waiter: bus.waiter(&["motor/command/a", "motor/command/b"])?,
            reporter: Reporter::default(),
            life,
            limits: Limits::new(config.period_s),
            patience: config.cycles(PATIENCE_S).into(),
            energy_every: config.cycles(ENERGY_S).into(),
            ready: false,
            published_ns: 0,
            exchange_until_ns: 0,
            core: Core::new(config),
        })
    }

    /// Receives commands; waits for a late one while it is worth it.
    fn wait_for_command(&mut self, cycle: u64, tick: &Tick) {
        // Discards the wake-ups of the previous cycle; later ones are not lost.
        self.reporter.bus(self.waiter.wait_until(Some(0)).map(|_| ()));
        let (of, awaited) = ((self.life, cycle), self.core.awaited_slots());
        let mut answered = self.ports.commands(of, awaited, &mut self.inbox, &mut self.reporter);
        let earliest_ns = tick.woke_ns.saturating_add(self.limits.grace_ns);
        // Relative to the scheduled begin and not to the wake-up: a later begin is due to the computer, not to waiting.
        let latest_ns = tick.scheduled_ns.saturating_add(self.limits.grace_most_ns);
        let patient_ns = self.published_ns.saturating_add(self.limits.answer_least_ns).max(earliest_ns).min(latest_ns);
        while !answered && self.core.awaits_command() && now_ns() < patient_ns {
            self.reporter.bus(self.waiter.wait_until(Some(patient_ns)).map(|_| ()));
            answered = self.ports.commands(of, awaited, &mut self.inbox, &mut self.reporter);
        }
    }

    /// Decides, exchanges with the drives, publishes and answers requests.
    fn cycle(&mut self, cycle: u64, tick: &Tick) -> Observation {
        let Self { core, inbox, drives, ports, server, emergency, deadman, reporter, limits, .. } = self;
        let stops = emergency.receive();
        if let Some(first) = stops.first() {
            let newest_ns = stops.iter().map(|stop| stop.request.header.stamp_ns).max().unwrap_or_default();
            inbox.emergency(stops.len(), &first.request, newest_ns);
        }
        let overdue = deadman.overdue();
        if let Some(request) = &overdue {
            // It was deposited earlier, and stops what was requested until it fell due.
            inbox.request_made(request.id, &request.body, now_ns());
        }
        let call = ports.gather(core.motion(), inbox, server, reporter);
        let begin_ns = now_ns();
        inbox.judge_at(core.plan_time_s());
        let input = inbox.begin(cycle, tick.scheduled_ns, begin_ns);
        ports.evidence.read(drives.left_out_ns(), self.published_ns, input);
        let command = core.decide(input);
        let until_ns =
            tick.scheduled_ns.saturating_add(limits.bus_ns).max(begin_ns.saturating_add(limits.bus_least_ns));
        self.exchange_until_ns = until_ns;
        drives.exchange(cycle, &command, until_ns, input);
        input.end_ns = now_ns();
        let observation = core.observe(input);
        ports.publish(observation, inbox.input(), cycle.is_multiple_of(self.energy_every), reporter);
        self.published_ns = now_ns();
        answer(call, core, drives.connection_error(), reporter);
        answer_stops(&stops, emergency, server, core, reporter);
        record_overdue(overdue.as_ref(), server, core, reporter);
        if self.ready || cycle > self.patience {
            reporter.report(&observation.authority);
            // Last: during start-up, the reported errors show what is still missing.
            reporter.drives(drives);
        }
        observation
    }

    /// Returns true in the cycle in which all drive units answer for the first time.
    fn is_up(&mut self, cycle: u64, observation: &Observation) -> anyhow::Result<bool> {
        let state = &observation.state;
        self.ready = state.unit_ok[..usize::from(state.unit_count)].iter().all(|ok| *ok == 1);
        if self.ready {
            let _ = self.drives.take_error(); // errors during the set-up of the units
            for (port, unit) in self.drives.units() {
                let firmware = unit.firmware.as_ref().map_or("unknown", |firmware| firmware.as_str());
                let line = DriveUnit {
                    port: port.to_string(),
                    name: unit.name.to_string(),
                    firmware: firmware.to_owned(),
                    watchdog_ms: unit.watchdog_ms.unwrap_or(0).into(),
                };
                info!("{line}");
            }
        } else if cycle >= self.patience
            && let Some(error) = self.drives.lost()
        {
            anyhow::bail!("the drives are not there: {error}");
        }
        Ok(self.ready)
    }
}

/// Channels of the process.
struct Ports {
    commands: [Subscriber<MotorCommand>; 2],
    estimates: [Subscriber<NodeEstimate>; 2],
    motion: Subscriber<PlanMotion>,
    supervisor: Subscriber<Heartbeat>,
    state: Publisher<MotorState>,
    authority: Publisher<MotorAuthority>,
    slots: Publisher<MotorSlots>,
    input: Publisher<MotorInput>,
    energy: Publisher<Energy>,
    evidence: Evidence,
    /// Stored here, so that publishing the input needs no copy on the stack.
    sent_input: Box<MotorInput>,
}

impl Ports {
    fn open(bus: &Bus) -> Result<Self, BusError> {
        let [a, b] = SLOT_NAMES;
        Ok(Self {
            commands: [bus.subscriber(&format!("motor/command/{a}"))?, bus.subscriber(&format!("motor/command/{b}"))?],
            estimates: [bus.subscriber(&format!("node/estimate/{a}"))?, bus.subscriber(&format!("node/estimate/{b}"))?],
            motion: bus.subscriber("plan/motion")?,
            supervisor: bus.subscriber("system/heartbeat/nims")?,
            state: bus.publisher("motor/state")?,
            authority: bus.publisher("motor/authority")?,
            slots: bus.publisher("motor/slots")?,
            input: bus.publisher("motor/input")?,
            energy: bus.publisher("energy")?,
            evidence: Evidence::new(),
            sent_input: Box::default(),
        })
    }

    /// Receives commands; returns true once the awaited controller has answered the previous cycle with the awaited
    /// estimate. A standby's answer may arrive earlier; it is used only if the other one is missing.
    fn commands(
        &mut self,
        (life, cycle): (u64, u64),
        (controller, estimator): (usize, usize),
        inbox: &mut Inbox,
        reporter: &mut Reporter,
    ) -> bool {
        let mut awaited = false;
        for (slot, commands) in self.commands.iter_mut().enumerate() {
            // Samples of a dead controller arrive first; the answer to the previous cycle counts, whenever it arrives.
            let mut answered = false;
            while let Some(command) = reporter.received(commands.receive()) {
                self.evidence.command(slot, &command);
                let current = command.header.life == life && command.based_on_cycle.checked_add(1) == Some(cycle);
                if current || !answered {
                    inbox.command(slot, &command);
                }
                answered |= current;
                awaited |= current && slot == controller && command.valid[estimator] == 1;
            }
        }
        awaited
    }

    /// Receives everything else that has arrived, and at most one request.
    fn gather<'a>(
        &mut self,
        following: u32,
        inbox: &mut Inbox,
        server: &'a mut Server,
        reporter: &mut Reporter,
    ) -> Option<Call<'a>> {
        for slot in 0..SLOT_NAMES.len() {
            while let Some(estimate) = reporter.received(self.estimates[slot].receive()) {
                self.evidence.estimate(slot, &estimate);
                inbox.estimate(slot, &estimate);
            }
        }
        if let Some(motion) = reporter.received(self.motion.latest()) {
            inbox.motion(&motion, following);
        }
        if let Some(beat) = reporter.received(self.supervisor.latest()) {
            inbox.supervisor(beat.beat);
        }
        let call = if inbox.has_room() { reporter.received(server.try_next()) } else { None };
        if let Some(call) = &call {
            let request = &call.request;
            inbox.request_made(request.id, &request.body, request.header.stamp_ns);
        }
        call
    }

    fn publish(&mut self, mut observation: Observation, input: &MotorInput, energy: bool, reporter: &mut Reporter) {
        // First the samples for which estimator and controller wait.
        reporter.bus(self.state.send(&mut observation.state).map(|_| ()));
        reporter.bus(self.authority.send(&mut observation.authority).map(|_| ()));
        reporter.bus(self.slots.send(&mut observation.slots).map(|_| ()));
        *self.sent_input = *input;
        reporter.bus(self.input.send(&mut self.sent_input).map(|_| ()));
        if energy {
            reporter.bus(self.energy.send(&mut observation.energy).map(|_| ()));
        }
    }

    fn lost(&self) -> u64 {
        let commands: u64 = self.commands.iter().map(Subscriber::lost).sum();
        let estimates: u64 = self.estimates.iter().map(Subscriber::lost).sum();
        commands.saturating_add(estimates).saturating_add(self.motion.lost())
    }
}

/// Sends the core's answer. If a unit that does not answer (`absent`) prevents arming, the answer names its port, which
/// the core does not know.
fn answer(call: Option<Call<'_>>, core: &Core, absent: Option<&drives::Error>, reporter: &mut Reporter) {
    let Some(call) = call else { return };
    let Some(answer) =
        core.answers().iter().find(|answer| answer.id == call.request.id && answer.verb == call.request.body.verb)
    else {
        // The core answers every verb but 0.
        let why = detail(DecodeError::Verb(call.request.body.verb));
        reporter.bus(call.answer(&Reason::Undecodable { why }.answer()));
        return;
    };
    let reason = match (absent, answer.verb) {
        (Some(error), RequestBody::VERB_ARM) if !answer.is_accepted() => Reason::NotArmedDrive { why: detail(error) },
        (Some(error), RequestBody::VERB_RESET) if !answer.is_accepted() => Reason::NotResetDrive { why: detail(error) },
        _ => answer.reason,
    };
    info!("request {}: {reason}", if reason.is_accepted() { "accepted" } else { "refused" });
    reporter.bus(call.answer(&reason.answer()));
}

/// Answers all emergency stops with the core's answer to the first.
fn answer_stops(
    stops: &[estop::Stop],
    emergency: &estop::Receiver,
    server: &mut Server,
    core: &Core,
    reporter: &mut Reporter,
) {
    let Some(first) = stops.first() else { return };
    let Some(answer) = core.answers().iter().find(|answer| answer.verb == first.request.body.verb) else { return };
    let recorded = answer.reason.answer();
    for stop in stops {
        emergency.answer(stop, &recorded);
        info!("emergency stop of process {}: {}", stop.request.pid, answer.reason);
        reporter.bus(server.record(&stop.request, &recorded));
    }
}

/// Records a dead-man stop with its answer.
fn record_overdue(overdue: Option<&OperatorRequest>, server: &mut Server, core: &Core, reporter: &mut Reporter) {
    let Some(request) = overdue else { return };
    let made = |answer: &&Answer| answer.id == request.id && answer.verb == request.body.verb;
    let Some(answer) = core.answers().iter().find(made) else { return };
    warn!("the sender of a dead-man stop is silent: {}", answer.reason);
    reporter.bus(server.record(request, &answer.reason.answer()));
}

/// Logs changes once, and bus errors at most once a second: a sample that could not be published is no reason
/// to drop the robot.
#[derive(Debug, Default)]
struct Reporter {
    mode: u8,
    faults: u32,
    complained_ns: u64,
    troubled_ns: u64,
    conditions_ns: u64,
    trouble: Option<drives::Error>,
}

impl Reporter {
    fn bus(&mut self, result: Result<(), BusError>) {
        if let Err(error) = result {
            let now = now_ns();
            if now.saturating_sub(self.complained_ns) > SECOND_NS {
                self.complained_ns = now;
                warn!("{error}");
            }
        }
    }

    fn received<T>(&mut self, result: Result<Option<T>, BusError>) -> Option<T> {
        result.unwrap_or_else(|error| {
            self.bus(Err(error));
            None
        })
    }

    /// Logs at most one error a second, and the same one again only after a minute: noise comes in bursts, and a
    /// missing port stays missing.
    fn drives(&mut self, drives: &mut Drives) {
        let now = now_ns();
        if now.saturating_sub(self.conditions_ns) > SECOND_NS
            && let Some(condition) = drives.condition()
        {
            self.conditions_ns = now;
            warn!("{condition}");
        }
        let Some(trouble) = drives.take_error() else { return };
        // The reason why a unit is missing matters more than its resynchronisation.
        let error = match drives.connection_error() {
            Some(absent) if matches!(trouble, drives::Error::Resynchronising { .. }) => absent.clone(),
            _ => trouble,
        };
        let pause_ns = if self.trouble.as_ref() == Some(&error) { 60 * SECOND_NS } else { SECOND_NS };
        if now.saturating_sub(self.troubled_ns) > pause_ns {
            self.troubled_ns = now;
            warn!("{error}");
            self.trouble = Some(error);
        }
    }

    fn report(&mut self, authority: &MotorAuthority) {
        if authority.mode != self.mode {
            self.mode = authority.mode;
            info!("{}", mode_sentence(authority.mode));
        }
        let new = authority.faults & !self.faults;
        if new != 0 {
            let named = faults_of(&MotorAuthority { faults: new, ..*authority });
            named.iter().for_each(|sentence| warn!("{sentence}"));
        }
        let gone = self.faults & !authority.faults;
        if gone != 0 {
            fault_sentences(gone).for_each(|sentence| info!("over: {sentence}"));
        }
        self.faults = authority.faults;
    }
}
