//! `nims replay`: what was decided in a run, computed again from what was recorded, by the very same steps.
//!
//! motor-io's safety machine and arbiter work on `motor/input`, estimators on `motor/state` and the `motor/authority` that their estimates
//! name, controllers on what `control/status` says they had seen, each with the parameters that it said it works with (`system/config/NAME`). Every part gets its recorded inputs, not what another part makes of them
//! now: a difference stays where it arises. A process that was started on the way begins with its first sample.
#![forbid(unsafe_code)]

mod channel;
mod command_line;
mod config;
mod earlier;
mod instead;
mod parts;
mod used;

pub use channel::{Difference, Tally};
pub use command_line::{Args, replay};
pub use instead::{Instead, Spread};

use channel::{Channel, History};
use command::{Answer, Failure};
use config::Configuration;
use earlier::EarlierRequests;
use instead::Collector;
use messages::{
    ControlStatus, Energy, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState, NodeEstimate,
    OperatorRequest, PlanMotion, SLOT_NAMES, SLOTS, SystemConfig, text_of,
};
use parts::{Controllers, Estimators, MotorIo, Recent};
use robot_state::Reason;
use runlog::{RecordedSample, RunReader};
use std::path::Path;
use used::Used;

/// A sample is worked on when the run is read this far beyond it, ns: by then everything that it rests on has been read and worked on too.
/// Samples of one cycle stand in the file within some milliseconds of each other, but in no certain order.
const INPUTS_BEHIND_NS: u64 = 400_000_000;
/// The same for estimates, on which controllers rest.
const ESTIMATES_BEHIND_NS: u64 = 700_000_000;
/// The same for everything else.
const BEHIND_NS: u64 = 1_000_000_000;
/// Time of the run after which there is work again.
const EVERY_NS: u64 = 20_000_000;

/// What is not as it was.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Changes {
    /// Another law for every controller.
    pub law: Option<String>,
    /// Keys of the system file or the robot file, each with its new value.
    pub set: Vec<(String, String)>,
}

impl Changes {
    /// Whether everything is as it was.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// What came of it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Replayed {
    /// Every channel of which something was recorded.
    pub channels: Vec<Tally>,
    /// Control cycles.
    pub cycles: u64,
    /// From the first to the last of them, s.
    pub flown_s: f64,
    /// What could not be read of the run, a sentence each.
    pub damage: Vec<String>,
    /// With changes: what they would have done.
    pub instead: Option<Instead>,
    /// The build that recorded the run, as it named itself.
    pub recorded_by: Option<String>,
}

impl Replayed {
    /// Samples that are the same, bit for bit.
    #[must_use]
    pub fn equal(&self) -> u64 {
        self.channels.iter().map(|tally| tally.equal).sum()
    }

    /// Samples that are not the same.
    #[must_use]
    pub fn different(&self) -> u64 {
        self.channels.iter().map(|tally| tally.different).sum()
    }
}

/// Computes a run again. `progress` is told now and then how much of it is done, 0 to 1.
///
/// # Errors
/// There is no run, it holds no configuration, or a change cannot be used.
pub fn run(path: &Path, changes: &Changes, progress: &mut dyn FnMut(f64)) -> Answer<Replayed> {
    if !path.exists() {
        return Err(Failure::BadInput(format!("there is no run {}: give a run folder or a run file", path.display())));
    }
    let mut reader = RunReader::open(path).map_err(Failure::bad)?;
    // The configuration stands before the first sample.
    reader.next_sample().map_err(Failure::not_now)?;
    let configuration = Configuration::of(reader.attachments(), changes)?;
    let recorded_by = reader.about().get("nims_version").cloned();
    let total = reader.bytes().max(1) as f64;
    let mut reader = RunReader::open(path).map_err(Failure::bad)?;
    let mut machine = Machine::new(configuration, !changes.is_empty());
    let mut count = 0_u64;
    while let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? {
        machine.take(&recorded);
        count += 1;
        if count.is_multiple_of(4096) {
            progress(reader.position() as f64 / total);
        }
    }
    let damage = reader.damage().iter().map(|(file, damage)| format!("{}: {}", file.display(), damage.why));
    let damage: Vec<String> = damage.collect();
    Ok(Replayed { damage, recorded_by, ..machine.end() })
}

/// All parts and all channels.
struct Machine {
    configuration: Configuration,
    collector: Option<Collector>,
    motor_io: MotorIo,
    estimators: [Estimators; SLOTS],
    controllers: [Controllers; SLOTS],
    recent: Recent,
    used: Channel<SystemConfig>,
    input: Channel<MotorInput>,
    motion: Channel<PlanMotion>,
    state: Channel<MotorState>,
    authority: Channel<MotorAuthority>,
    slots: Channel<MotorSlots>,
    energy: Channel<Energy>,
    request: Channel<OperatorRequest>,
    earlier: EarlierRequests,
    estimate: [Channel<NodeEstimate>; SLOTS],
    command: [Channel<MotorCommand>; SLOTS],
    control: [Channel<ControlStatus>; SLOTS],
    begin_ns: Option<u64>,
    newest_ns: u64,
    worked_ns: u64,
    cycles: u64,
    first_and_last_ns: Option<(u64, u64)>,
}

fn slotted<T: messages::Message>(beginning: &str) -> [Channel<T>; SLOTS] {
    SLOT_NAMES.map(|slot| Channel::new(&format!("{beginning}/{slot}")))
}

impl Machine {
    fn new(configuration: Configuration, changed: bool) -> Self {
        Self {
            collector: changed.then(|| Collector::new(configuration.cables())),
            configuration,
            motor_io: MotorIo::new(),
            estimators: std::array::from_fn(|_| Estimators::new()),
            controllers: std::array::from_fn(|_| Controllers::new()),
            recent: Recent {
                states: History::new(),
                authorities: History::new(),
                motions: History::new(),
                estimates: std::array::from_fn(|_| History::new()),
                commands: std::array::from_fn(|_| History::new()),
                used: Used::default(),
            },
            used: Channel::new("system/config"),
            input: Channel::new("motor/input"),
            motion: Channel::new("plan/motion"),
            state: Channel::new("motor/state"),
            authority: Channel::new("motor/authority"),
            slots: Channel::new("motor/slots"),
            energy: Channel::new("energy"),
            request: Channel::new("operator/request"),
            earlier: EarlierRequests::default(),
            estimate: slotted("node/estimate"),
            command: slotted("motor/command"),
            control: slotted("control/status"),
            begin_ns: None,
            newest_ns: 0,
            worked_ns: 0,
            cycles: 0,
            first_and_last_ns: None,
        }
    }

    /// The next sample of the run.
    fn take(&mut self, recorded: &RecordedSample<'_>) {
        // A sample may repeat an old stamp (a cycle without a reading), so what counts is its place in the file.
        self.newest_ns = self.newest_ns.max(recorded.log_time_ns);
        let time_ns = self.newest_ns;
        let t0_ns = *self.begin_ns.get_or_insert(time_ns);
        let (name, slot) = match recorded.channel.name.rsplit_once('/') {
            Some((name, slot)) if slot == SLOT_NAMES[0] => (name, 0),
            Some((name, slot)) if slot == SLOT_NAMES[1] => (name, 1),
            _ => (recorded.channel.name.as_str(), 0),
        };
        match name {
            "motor/input" => {
                if let Some(mut input) = self.input.read(recorded, t0_ns) {
                    self.earlier.fill(recorded, &mut input);
                    self.cycles += 1;
                    let (first_ns, _) = *self.first_and_last_ns.get_or_insert((time_ns, time_ns));
                    self.first_and_last_ns = Some((first_ns, time_ns));
                    self.input.wait(time_ns, input);
                }
            }
            "motor/state" => {
                if let Some(state) = self.state.read(recorded, t0_ns) {
                    self.recent.states.push(state.header.cycle, time_ns, state);
                    self.state.wait(time_ns, state);
                }
            }
            "motor/authority" => {
                if let Some(authority) = self.authority.read(recorded, t0_ns) {
                    self.recent.authorities.push(authority.header.cycle, time_ns, authority);
                    self.authority.wait(time_ns, authority);
                }
            }
            "motor/slots" => {
                if let Some(slots) = self.slots.read(recorded, t0_ns) {
                    self.slots.wait(time_ns, slots);
                }
            }
            "energy" => {
                if let Some(energy) = self.energy.read(recorded, t0_ns) {
                    self.energy.wait(time_ns, energy);
                }
            }
            "operator/request" => {
                if let Some(request) = self.request.read(recorded, t0_ns) {
                    self.request.wait(time_ns, request);
                }
            }
            "plan/motion" => {
                if let Some(motion) = self.motion.read(recorded, t0_ns) {
                    self.recent.motions.push(motion.beat, time_ns, motion);
                }
            }
            "node/estimate" => {
                if let Some(estimate) = self.estimate[slot].read(recorded, t0_ns) {
                    self.estimate[slot].wait_in_turn(time_ns, estimate, |estimate| estimate.incarnation);
                }
            }
            "motor/command" => {
                if let Some(command) = self.command[slot].read(recorded, t0_ns) {
                    self.recent.commands[slot].push(command.header.seq, time_ns, command);
                }
            }
            "control/status" => {
                if let Some(status) = self.control[slot].read(recorded, t0_ns) {
                    self.control[slot].wait_in_turn(time_ns, status, |status| status.incarnation);
                }
            }
            name if name.starts_with("system/config/") => {
                if let Some(said) = self.used.read(recorded, t0_ns) {
                    self.recent.used.note(&said);
                }
            }
            _ => {}
        }
        if time_ns >= self.worked_ns + EVERY_NS {
            self.worked_ns = time_ns;
            self.work(time_ns);
        }
    }

    /// Works on everything that is far enough behind.
    fn work(&mut self, now_ns: u64) {
        while let Some((time_ns, input)) = self.input.due(now_ns.saturating_sub(INPUTS_BEHIND_NS)) {
            self.motor_io.step(time_ns, &input, &self.configuration);
        }
        for slot in 0..SLOTS {
            self.estimates(slot, now_ns.saturating_sub(ESTIMATES_BEHIND_NS));
        }
        self.motor_io(now_ns.saturating_sub(BEHIND_NS));
        for slot in 0..SLOTS {
            self.controls(slot, now_ns.saturating_sub(BEHIND_NS));
        }
    }

    fn motor_io(&mut self, until_ns: u64) {
        while let Some((time_ns, state)) = self.state.due(until_ns) {
            match self.motor_io.made(state.header.cycle, time_ns) {
                Ok(made) => {
                    if let Some(collector) = &mut self.collector {
                        collector.sent(&made.authority, &state, &made.state);
                    }
                    self.state.compare(time_ns, &state, made.state);
                }
                Err(why) => self.state.skip(why),
            }
        }
        while let Some((time_ns, authority)) = self.authority.due(until_ns) {
            match self.motor_io.made(authority.header.cycle, time_ns) {
                Ok(made) => {
                    if let Some(collector) = &mut self.collector {
                        collector.mode(&authority, &made.authority);
                    }
                    self.authority.compare(time_ns, &authority, made.authority);
                }
                Err(why) => self.authority.skip(why),
            }
        }
        while let Some((time_ns, slots)) = self.slots.due(until_ns) {
            match self.motor_io.made(slots.header.cycle, time_ns) {
                Ok(made) => self.slots.compare(time_ns, &slots, made.slots),
                Err(why) => self.slots.skip(why),
            }
        }
        while let Some((time_ns, energy)) = self.energy.due(until_ns) {
            match self.motor_io.made(energy.header.cycle, time_ns) {
                Ok(made) => self.energy.compare(time_ns, &energy, made.energy),
                Err(why) => self.energy.skip(why),
            }
        }
        while let Some((time_ns, request)) = self.request.due(until_ns) {
            self.answer(time_ns, &request);
        }
    }

    /// Compares an answer of motor-io; other processes answer on the same channel.
    fn answer(&mut self, time_ns: u64, request: &OperatorRequest) {
        let answer = self.motor_io.answer(request.id, time_ns);
        let Some(answer) = answer.filter(|answer| request.answered == 1 && answer.verb == request.body.verb) else {
            return;
        };
        // Which drive is absent and why is known to the process alone.
        let by_drives =
            matches!(Reason::of(request), Some(Reason::NotArmedDrive { .. } | Reason::NotResetDrive { .. }));
        if by_drives && !answer.is_accepted() {
            return;
        }
        let word = |accepted: bool| if accepted { "accepted" } else { "refused" };
        let was = format!("{} ({}): {}", word(request.accepted == 1), request.reason, text_of(&request.answer));
        let is = format!("{} ({}): {}", word(answer.is_accepted()), answer.reason.code(), answer.reason);
        self.request.compare_text(time_ns, request.header.cycle, "answer", &was, &is);
    }

    fn estimates(&mut self, slot: usize, until_ns: u64) {
        while let Some((time_ns, estimate)) = self.estimate[slot].due(until_ns) {
            let again = self.estimators[slot].step(time_ns, &estimate, &self.recent, &self.configuration);
            let mut used = estimate;
            match again {
                Ok(mut made) => {
                    // The kernel's number of a thread is nothing that a step decides.
                    made.thread = estimate.thread;
                    if let Some(collector) = &mut self.collector {
                        collector.estimate(&estimate, &made);
                        // A changed estimator is a change for the controllers too.
                        used = made;
                    }
                    self.estimate[slot].compare(time_ns, &estimate, made);
                }
                Err(why) => self.estimate[slot].skip(why),
            }
            self.recent.estimates[slot].push(used.header.cycle, time_ns, used);
        }
    }

    fn controls(&mut self, slot: usize, until_ns: u64) {
        while let Some((time_ns, status)) = self.control[slot].due(until_ns) {
            let again = self.controllers[slot].step(time_ns, &status, &self.recent, &self.configuration);
            let command = self.recent.commands[slot].find(status.header.seq, time_ns).copied();
            let command = command.filter(|command| command.incarnation == status.incarnation);
            match (again, command) {
                (Ok((mut made, made_status)), command) => {
                    self.control[slot].compare(time_ns, &status, made_status);
                    let Some(command) = command else { continue };
                    made.thread = command.thread;
                    let authority = self.recent.authorities.find(status.header.cycle, time_ns);
                    if let (Some(collector), Some(authority)) = (&mut self.collector, authority) {
                        let time_s = time_ns.saturating_sub(self.begin_ns.unwrap_or(time_ns)) as f64 * 1e-9;
                        collector.command(time_s, slot, authority, &command, &made);
                    }
                    self.command[slot].compare(time_ns, &command, made);
                }
                (Err(why), command) => {
                    self.control[slot].skip(why);
                    if command.is_some() {
                        self.command[slot].skip(why);
                    }
                }
            }
        }
    }

    /// What is left, and the outcome.
    fn end(mut self) -> Replayed {
        self.work(u64::MAX);
        let Self { state, authority, slots, energy, request, estimate, command, control, .. } = self;
        let motor_io = [state.end(), authority.end(), slots.end(), energy.end(), request.end_of_some()];
        let estimators = estimate.map(Channel::end);
        let controllers = [command.map(Channel::end), control.map(Channel::end)].into_iter().flatten();
        let (first_ns, last_ns) = self.first_and_last_ns.unwrap_or_default();
        Replayed {
            channels: motor_io.into_iter().chain(estimators).chain(controllers).flatten().collect(),
            cycles: self.cycles,
            flown_s: last_ns.saturating_sub(first_ns) as f64 * 1e-9,
            damage: Vec::new(),
            instead: self.collector.map(Collector::end),
            recorded_by: None,
        }
    }
}
