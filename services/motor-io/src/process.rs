//! The process: the core, the drives and the bus, brought together once per period.

use crate::core::{Core, Observation};
use crate::drives::Drives;
use crate::inbox::Inbox;
use crate::kernel::Evidence;
use crate::position::{Keeper, PositionFile};
use crate::settings::CoreConfig;
use bus::clock::{Pacer, SECOND_NS, now_ns};
use bus::{Bus, BusError, Call, Publisher, Server, Subscriber, estop};
use config::{RobotFile, SystemFile};
use messages::{
    Energy, Heartbeat, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState, NodeEstimate, OperatorRequest,
    PlanMotion, SLOT_NAMES,
};
use robot_state::sentences::{fault_sentences, faults_of, mode_sentence};
use runtime::{BadInput, Chassis};
use std::path::Path;
use tracing::{info, warn};

/// Share of the period, from its tick, in which the drives have to answer; the rest belongs to estimator and controller.
const BUS_SHARE: f64 = 0.85;
/// Share of the period that the drives get at least, however late the cycle began.
const BUS_LEAST: f64 = 0.65;
/// Share of the period for which a command that is not there at the tick is waited for: a hiccup of the machine then costs a
/// little delay and not a cycle.
const GRACE_SHARE: f64 = 0.2;
/// Share of the period that the chain has for its answer at least, however late the drives were with what it answers to ..
const ANSWER_LEAST: f64 = 0.5;
/// .. but not longer after the tick than this share: the drives want their time too.
const GRACE_MOST: f64 = 0.4;
/// The energy changes slowly: every so many seconds.
const ENERGY_S: f64 = 0.1;
/// Drives have this long to come up without a word, s; the virtual box makes its ports while this process starts. A port that is not there
/// by then is an error; a unit that does not answer is waited for, and this process is not ready before.
const PATIENCE_S: f64 = 5.0;
/// A robot that is told to end while it moves gets this long to come to rest, s.
const LAST_STOP_S: f64 = 3.0;

impl CoreConfig {
    /// The configuration of a box and its robot.
    ///
    /// # Errors
    /// Names the key that cannot be used.
    pub fn from_files(system_file: &SystemFile, robot_file: &RobotFile) -> Result<Self, BadInput> {
        let section = &system_file.motor_io;
        let robot = robot_file.robot().map_err(|error| BadInput(error.to_string()))?;
        // The estimate is compared with this: both take the lines for the same.
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
        config.check().map_err(bad)?;
        Ok(config)
    }
}

/// Runs until the chassis is told to end. `state_folder` keeps the position over restarts.
///
/// # Errors
/// [`BadInput`] for what is configured; a sentence naming the port if the drives are not there.
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
    let mut keeper = Keeper::start(folder, &robot, &config)?;
    let restored = PositionFile::load(folder, &robot, &config).unwrap_or_else(|error| {
        warn!("{error}");
        None
    });
    let mut drives = Drives::open(&system_file, &config, chassis.bus().domain().root())?;
    for (port, reading) in drives.unwatched() {
        warn!("{port}: its drives do not report {reading}, so the faults of a cable that show in it are not detected");
    }
    let mut ports = Ports::open(chassis.bus())?;
    // A later life has a larger number; a computer that starts again begins with empty shared memory.
    let life = now_ns().max(1);
    let mut inbox = Inbox::new(config.cable_count(), config.unit_count).of_life(life);
    inbox.first((chassis.incarnation() & 0x3fff_ffff).max(1), restored);

    let period_ns = (config.period_s * 1e9).round() as u64;
    let share = |share: f64| (config.period_s * 1e9 * share) as u64;
    let (bus_ns, bus_least_ns) = (share(BUS_SHARE), share(BUS_LEAST));
    let (grace_ns, answer_least_ns, grace_most_ns) = (share(GRACE_SHARE), share(ANSWER_LEAST), share(GRACE_MOST));
    let patience = config.cycles(PATIENCE_S).into();
    let last_stop = config.cycles(LAST_STOP_S).into();
    let energy_every = u64::from(config.cycles(ENERGY_S));
    let mut core = Core::new(config);
    let mut reporter = Reporter::default();
    let mut server = chassis.bus().server(chassis.name())?;
    let mut emergency = estop::Receiver::open(chassis.bus().domain())?;
    let mut waiter = chassis.bus().waiter(&["motor/command/a", "motor/command/b"])?;
    let (mut ready, mut ending, mut published_ns) = (false, 0_u64, 0_u64);
    let mut pacer = Pacer::new(period_ns);

    for cycle in 1_u64.. {
        let tick = pacer.next();
        chassis.pass_begin();
        if !chassis.running() {
            ending += 1;
            if !core.moves() || ending > last_stop {
                break;
            }
            if ending == 1 {
                inbox.request(0, OperatorRequest::VERB_STOP, &[0.0; 8]);
            }
        }
        // Takes away the wake-ups of the last cycle; from here on a new one is not lost.
        reporter.bus(waiter.wait_until(Some(0)).map(|_| ()));
        let awaited = core.awaited_slots();
        let mut answered = ports.commands((life, cycle), awaited, &mut inbox, &mut reporter);
        let earliest_ns = tick.woke_ns.saturating_add(grace_ns);
        // By the tick and not by the wake-up: what begins later than this is the computer's lateness, and never patience.
        let latest_ns = tick.scheduled_ns.saturating_add(grace_most_ns);
        let patient_ns = published_ns.saturating_add(answer_least_ns).max(earliest_ns).min(latest_ns);
        while !answered && core.awaits_command() && now_ns() < patient_ns {
            reporter.bus(waiter.wait_until(Some(patient_ns)).map(|_| ()));
            answered = ports.commands((life, cycle), awaited, &mut inbox, &mut reporter);
        }
        let stops = emergency.take();
        if let Some(first) = stops.first() {
            inbox.emergency(stops.len(), &first.request);
        }
        let call = ports.gather(core.motion(), &mut inbox, &mut server, &mut reporter);
        let begin_ns = now_ns();
        inbox.judge_at(core.plan_time_s());
        let input = inbox.begin(cycle, tick.scheduled_ns, begin_ns);
        ports.evidence.look(drives.left_out_ns(), published_ns, input);
        let command = core.decide(input);
        drives.exchange(
            cycle,
            &command,
            tick.scheduled_ns.saturating_add(bus_ns).max(begin_ns.saturating_add(bus_least_ns)),
            input,
        );
        input.end_ns = now_ns();
        let observation = core.observe(input);
        ports.publish(observation, inbox.input(), cycle % energy_every == 0, &mut reporter);
        published_ns = now_ns();
        answer(call, &core, drives.absent(), &mut reporter);
        answer_stops(&stops, &emergency, &mut server, &core, &mut reporter);
        if ready || cycle > patience {
            reporter.look(&observation.authority);
            // Last: what is still waited for at the start is read from the end of what was said.
            reporter.drives(&mut drives);
        }
        keeper.keep(core.position(), tick.woke_ns);
        if !ready {
            let up = observation.state.unit_ok[..usize::from(observation.state.unit_count)].iter().all(|ok| *ok == 1);
            if up {
                chassis.ready()?;
                ready = true;
                let _ = drives.trouble(); // of the time while the units were being set up
                for (port, unit) in drives.units() {
                    let firmware = unit.firmware.as_ref().map_or("unknown", |firmware| firmware.as_str());
                    let watchdog_ms = unit.watchdog_ms.unwrap_or(0);
                    info!("{port}, {}: firmware {firmware}, watchdog {watchdog_ms} ms", unit.name);
                }
            } else if cycle >= patience
                && let Some(error) = drives.lost()
            {
                anyhow::bail!("the drives are not there: {error}");
            }
        }
        inbox.finish();
        chassis.report_lost(ports.lost());
        chassis.pass_end();
        reporter.bus(chassis.idle().map(|_| ()));
    }
    keeper.finish(core.position());
    Ok(())
}

/// What the process hears and says.
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
    /// Kept here so that publishing the input needs no copy on the stack each time.
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

    /// Takes in commands; true once the controller that is awaited answers the last cycle by the estimate that is awaited. A standby's
    /// answer may be there before: it is for the case that the other does not come.
    fn commands(
        &mut self,
        (life, cycle): (u64, u64),
        (controller, estimator): (usize, usize),
        inbox: &mut Inbox,
        reporter: &mut Reporter,
    ) -> bool {
        let mut awaited = false;
        for (slot, commands) in self.commands.iter_mut().enumerate() {
            // What a dead controller left behind arrives first: the answer to the last cycle counts, whenever it comes.
            let mut answered = false;
            while let Some(command) = reporter.take(commands.receive()) {
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

    /// Takes in everything else that has arrived, and at most one request.
    fn gather<'a>(
        &mut self,
        following: u32,
        inbox: &mut Inbox,
        server: &'a mut Server,
        reporter: &mut Reporter,
    ) -> Option<Call<'a>> {
        for slot in 0..SLOT_NAMES.len() {
            while let Some(estimate) = reporter.take(self.estimates[slot].receive()) {
                self.evidence.estimate(slot, &estimate);
                inbox.estimate(slot, &estimate);
            }
        }
        if let Some(motion) = reporter.take(self.motion.latest()) {
            inbox.motion(&motion, following);
        }
        if let Some(beat) = reporter.take(self.supervisor.latest()) {
            inbox.supervisor(beat.beat);
        }
        let call = if inbox.has_room() { reporter.take(server.try_next()) } else { None };
        if let Some(call) = &call {
            let request = &call.request;
            inbox.request_made(request.id, request.verb, &request.args, request.header.stamp_ns);
        }
        call
    }

    fn publish(&mut self, mut observation: Observation, input: &MotorInput, energy: bool, reporter: &mut Reporter) {
        // First what estimator and controller wait for.
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

/// Passes on what the core has answered. Whoever is not allowed to arm because a unit does not answer (`absent`) is told on which port,
/// and what comes from there; the core knows of no ports.
fn answer(call: Option<Call<'_>>, core: &Core, absent: Option<&drives::Error>, reporter: &mut Reporter) {
    let Some(call) = call else { return };
    let Some(answer) =
        core.answers().iter().find(|answer| answer.id == call.request.id && answer.verb == call.request.verb)
    else {
        reporter.bus(call.answer(
            OperatorRequest::BAD_INPUT,
            "The request holds no verb; this program and the one that asked are of different versions.",
        ));
        return;
    };
    let asks_for_drives = matches!(answer.verb, OperatorRequest::VERB_ARM | OperatorRequest::VERB_RESET);
    let sentence = match absent {
        Some(error) if asks_for_drives && !answer.is_accepted() => {
            let not_done = if answer.verb == OperatorRequest::VERB_ARM { "armed" } else { "reset" };
            format!("Not {not_done}: {error}.")
        }
        _ => answer.sentence.to_string(),
    };
    info!("request {}: {sentence}", if answer.is_accepted() { "accepted" } else { "refused" });
    reporter.bus(call.answer(answer.accepted, &sentence));
}

/// The first of the emergency stops has gone to the core; its answer is that of all.
fn answer_stops(
    stops: &[estop::Stop],
    emergency: &estop::Receiver,
    server: &mut Server,
    core: &Core,
    reporter: &mut Reporter,
) {
    let Some(first) = stops.first() else { return };
    let Some(answer) = core.answers().iter().find(|answer| answer.verb == first.request.verb) else { return };
    for stop in stops {
        emergency.answer(stop, answer.accepted, &answer.sentence);
        info!("emergency stop of process {}: {}", stop.request.pid, answer.sentence);
        reporter.bus(server.record(&stop.request, answer.accepted, &answer.sentence));
    }
}

/// Says what changes, once; and that the bus fails, not more than once a second: a robot that is held must not be dropped
/// because a sample could not be published.
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

    fn take<T>(&mut self, result: Result<Option<T>, BusError>) -> Option<T> {
        result.unwrap_or_else(|error| {
            self.bus(Err(error));
            None
        })
    }

    /// Noise comes in bursts, and a port that is gone stays gone: not more than one sentence a second, and the same one again
    /// only after a minute.
    fn drives(&mut self, drives: &mut Drives) {
        let now = now_ns();
        if now.saturating_sub(self.conditions_ns) > SECOND_NS
            && let Some(condition) = drives.condition()
        {
            self.conditions_ns = now;
            warn!("{condition}");
        }
        let Some(trouble) = drives.trouble() else { return };
        // Where it is known what is the matter with a unit, its way back is no news.
        let error = match drives.absent() {
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

    fn look(&mut self, authority: &MotorAuthority) {
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
