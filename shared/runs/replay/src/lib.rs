//! `nims replay`: recomputes the decisions of a run from its recorded inputs with the same steps.
//!
//! motor-io's safety machine and arbiter work on `motor/input`, estimators on `motor/state` and the `motor/authority`
//! that their estimates name, controllers on the samples that `control/status` names, each with the parameters that it
//! reported (`system/config/NAME`). Each part gets its recorded inputs, not the recomputed outputs of another part, so
//! a difference stays where it arises. A process that was started during the run begins with its first sample.
#![forbid(unsafe_code)]

mod at;
mod changes;
mod channel;
mod command_line;
mod comparison;
mod config;
mod earlier;
mod parts;
mod reported;
mod sample;

pub use at::{Entry, Process, Snapshot, instant_of, snapshot};
pub use changes::Changes;
pub use channel::{ChannelComparison, Difference};
pub use command_line::{Args, replay};
pub use comparison::{Comparison, Spread};
pub use sample::sample_value;

use channel::{Channel, History};
use command::{Answer, Failure};
use comparison::Collector;
use config::Configuration;
use earlier::EarlierRequests;
use messages::{
    ControlStatus, Energy, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState, NodeEstimate,
    OperatorRequest, PlanMotion, SLOT_NAMES, SLOTS, SystemConfig, text_of,
};
use parts::{Controllers, Estimators, MotorIo, Recent};
use reported::ReportedParameters;
use robot_state::Reason;
use runlog::{RecordedSample, RunReader};
use std::path::Path;

/// Delay between reading and processing a sample, ns: by then all its inputs have been read and processed too. Samples
/// of one cycle are within some milliseconds of each other in the file, in no particular order.
const INPUTS_BEHIND_NS: u64 = 400_000_000;
/// The same delay for estimates, which controllers need.
const ESTIMATES_BEHIND_NS: u64 = 700_000_000;
/// The same delay for all other samples.
const BEHIND_NS: u64 = 1_000_000_000;
/// Interval of run time between two passes of processing, ns.
const EVERY_NS: u64 = 20_000_000;

/// Result of a replay.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Replayed {
    /// Channels with recorded samples.
    pub channels: Vec<ChannelComparison>,
    /// Number of control cycles.
    pub cycles: u64,
    /// Time from the first to the last cycle, s.
    pub flown_s: f64,
    /// Unreadable parts of the run, one sentence each.
    pub damage: Vec<String>,
    /// With changes: their effect.
    pub instead: Option<Comparison>,
    /// Version of the build that recorded the run.
    pub recorded_by: Option<String>,
}

impl Replayed {
    /// Returns the number of samples that are equal bit for bit.
    #[must_use]
    pub fn equal(&self) -> u64 {
        self.channels.iter().map(|tally| tally.equal).sum()
    }

    /// Returns the number of samples that differ.
    #[must_use]
    pub fn different(&self) -> u64 {
        self.channels.iter().map(|tally| tally.different).sum()
    }
}

/// Replays a run; calls `progress` repeatedly with the completed share, 0 to 1.
///
/// # Errors
/// The run does not exist or has no configuration, a change cannot be applied, or the program of a law fails.
pub fn run(path: &Path, changes: &Changes, progress: &mut dyn FnMut(f64)) -> Answer<Replayed> {
    if !path.exists() {
        return Err(Failure::BadInput(format!("{} does not exist; give a run folder or a run file", path.display())));
    }
    let mut reader = RunReader::open(path).map_err(Failure::bad)?;
    // The attachments with the configuration precede the first sample.
    reader.next_sample().map_err(Failure::not_now)?;
    let configuration = Configuration::from_attachments(reader.attachments(), changes)?;
    let recorded_by = reader.metadata().get("nims_version").cloned();
    let total = reader.bytes().max(1) as f64;
    let mut reader = RunReader::open(path).map_err(Failure::bad)?;
    let mut replay = Replay { begin_ns: reader.begin_ns(), ..Replay::new(configuration, !changes.is_empty()) };
    let mut count = 0_u64;
    while let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? {
        replay.add(&recorded);
        replay.configuration.check_law()?;
        count += 1;
        if count.is_multiple_of(4096) {
            progress(reader.position() as f64 / total);
        }
    }
    let damage = reader.damage().iter().map(|(file, damage)| format!("{}: {}", file.display(), damage.why));
    let damage: Vec<String> = damage.collect();
    Ok(Replayed { damage, recorded_by, ..replay.end()? })
}

/// Replays a run up to a UNIX time in ns and returns the internal state of each deciding part after its last step, as
/// text; calls `progress` with the completed share of that time, 0 to 1.
///
/// # Errors
/// The run does not exist or has no configuration.
pub fn state_at(path: &Path, at_ns: u64, progress: &mut dyn FnMut(f64)) -> Answer<Vec<(String, String)>> {
    let mut reader = RunReader::open(path).map_err(Failure::bad)?;
    reader.next_sample().map_err(Failure::not_now)?;
    let configuration = Configuration::from_attachments(reader.attachments(), &Changes::default())?;
    let mut reader = RunReader::open(path).map_err(Failure::bad)?;
    let mut replay = Replay { compares: false, ..Replay::new(configuration, false) };
    let mut count = 0_u64;
    while let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? {
        // Samples that were published by then follow in the file for some milliseconds.
        if recorded.log_time_ns > at_ns.saturating_add(BEHIND_NS) {
            break;
        }
        if recorded.log_time_ns <= at_ns {
            replay.add(&recorded);
        }
        count += 1;
        if count.is_multiple_of(4096) {
            let begin_ns = replay.begin_ns.unwrap_or(recorded.log_time_ns);
            let all = at_ns.saturating_sub(begin_ns).max(1) as f64;
            progress(recorded.log_time_ns.saturating_sub(begin_ns) as f64 / all);
        }
    }
    replay.process(u64::MAX);
    let parts = std::iter::once(("motor-io".to_owned(), replay.motor_io.state()));
    let slots = |role: &str| SLOT_NAMES.map(|slot| format!("{role} in slot {slot}"));
    let estimators = slots("estimator").into_iter().zip(replay.estimators.iter().map(Estimators::state));
    let controllers = slots("controller").into_iter().zip(replay.controllers.iter().map(Controllers::state));
    Ok(parts.chain(estimators).chain(controllers).filter_map(|(name, state)| Some((name, state?))).collect())
}

/// All deciding parts and all channels.
struct Replay {
    configuration: Configuration,
    collector: Option<Collector>,
    /// Whether results are compared with the recorded ones.
    compares: bool,
    motor_io: MotorIo,
    estimators: [Estimators; SLOTS],
    controllers: [Controllers; SLOTS],
    recent: Recent,
    reported: Channel<SystemConfig>,
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
    /// UNIX time from which the run counts, ns; without a clock the log time of its first sample.
    begin_ns: Option<u64>,
    newest_ns: u64,
    processed_ns: u64,
    cycles: u64,
    first_and_last_ns: Option<(u64, u64)>,
}

/// Splits a channel's name into the name without its slot, and the index of the slot; 0 for a channel without slots.
fn name_and_slot(channel: &str) -> (&str, usize) {
    match channel.rsplit_once('/') {
        Some((name, slot)) if slot == SLOT_NAMES[0] => (name, 0),
        Some((name, slot)) if slot == SLOT_NAMES[1] => (name, 1),
        _ => (channel, 0),
    }
}

fn channel_per_slot<T: messages::Message>(beginning: &str) -> [Channel<T>; SLOTS] {
    SLOT_NAMES.map(|slot| Channel::new(&format!("{beginning}/{slot}")))
}

impl Replay {
    fn new(configuration: Configuration, changed: bool) -> Self {
        Self {
            compares: true,
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
                reported: ReportedParameters::default(),
            },
            reported: Channel::new("system/config"),
            input: Channel::new("motor/input"),
            motion: Channel::new("plan/motion"),
            state: Channel::new("motor/state"),
            authority: Channel::new("motor/authority"),
            slots: Channel::new("motor/slots"),
            energy: Channel::new("energy"),
            request: Channel::new("operator/request"),
            earlier: EarlierRequests::default(),
            estimate: channel_per_slot("node/estimate"),
            command: channel_per_slot("motor/command"),
            control: channel_per_slot("control/status"),
            begin_ns: None,
            newest_ns: 0,
            processed_ns: 0,
            cycles: 0,
            first_and_last_ns: None,
        }
    }

    /// Processes the next sample of the run.
    fn add(&mut self, recorded: &RecordedSample<'_>) {
        // A sample may repeat an old stamp (a cycle without a reading), so the newest log time so far is used.
        self.newest_ns = self.newest_ns.max(recorded.log_time_ns);
        let time_ns = self.newest_ns;
        let t0_ns = *self.begin_ns.get_or_insert(time_ns);
        self.store(recorded, time_ns, t0_ns);
        if time_ns >= self.processed_ns + EVERY_NS {
            self.processed_ns = time_ns;
            self.process(time_ns);
        }
    }

    /// Decodes a sample and stores it until it is compared or used as an input.
    fn store(&mut self, recorded: &RecordedSample<'_>, time_ns: u64, t0_ns: u64) {
        let (name, slot) = name_and_slot(&recorded.channel.name);
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
                    self.estimate[slot].wait_in_order(time_ns, estimate, |estimate| estimate.incarnation);
                }
            }
            "motor/command" => {
                if let Some(command) = self.command[slot].read(recorded, t0_ns) {
                    self.recent.commands[slot].push(command.header.seq, time_ns, command);
                }
            }
            "control/status" => {
                if let Some(status) = self.control[slot].read(recorded, t0_ns) {
                    self.control[slot].wait_in_order(time_ns, status, |status| status.incarnation);
                }
            }
            name if name.starts_with("system/config/") => {
                if let Some(report) = self.reported.read(recorded, t0_ns) {
                    self.recent.reported.record(&report);
                }
            }
            _ => {}
        }
    }

    /// Processes everything that is far enough behind.
    fn process(&mut self, now_ns: u64) {
        while let Some((time_ns, input)) = self.input.next_due(now_ns.saturating_sub(INPUTS_BEHIND_NS)) {
            self.motor_io.step(time_ns, &input, &self.configuration);
        }
        for slot in 0..SLOTS {
            self.compare_estimates(slot, now_ns.saturating_sub(ESTIMATES_BEHIND_NS));
        }
        self.compare_motor_io(now_ns.saturating_sub(BEHIND_NS));
        for slot in 0..SLOTS {
            self.compare_controls(slot, now_ns.saturating_sub(BEHIND_NS));
        }
    }

    fn compare_motor_io(&mut self, until_ns: u64) {
        if !self.compares {
            return self.leave_out();
        }
        while let Some((time_ns, state)) = self.state.next_due(until_ns) {
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
        while let Some((time_ns, authority)) = self.authority.next_due(until_ns) {
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
        while let Some((time_ns, slots)) = self.slots.next_due(until_ns) {
            match self.motor_io.made(slots.header.cycle, time_ns) {
                Ok(made) => self.slots.compare(time_ns, &slots, made.slots),
                Err(why) => self.slots.skip(why),
            }
        }
        while let Some((time_ns, energy)) = self.energy.next_due(until_ns) {
            match self.motor_io.made(energy.header.cycle, time_ns) {
                Ok(made) => self.energy.compare(time_ns, &energy, made.energy),
                Err(why) => self.energy.skip(why),
            }
        }
        while let Some((time_ns, request)) = self.request.next_due(until_ns) {
            self.compare_answer(time_ns, &request);
        }
    }

    /// Leaves out the comparison of motor-io's results.
    fn leave_out(&mut self) {
        while self.state.next_due(u64::MAX).is_some() {}
        while self.authority.next_due(u64::MAX).is_some() {}
        while self.slots.next_due(u64::MAX).is_some() {}
        while self.energy.next_due(u64::MAX).is_some() {}
        while self.request.next_due(u64::MAX).is_some() {}
    }

    /// Compares an answer of motor-io; answers of other processes on the channel are skipped.
    fn compare_answer(&mut self, time_ns: u64, request: &OperatorRequest) {
        let answer = self.motor_io.answer(request.id, time_ns);
        let Some(answer) = answer.filter(|answer| request.answered == 1 && answer.verb == request.body.verb) else {
            return;
        };
        // Which drive is absent and why is known to the process alone.
        let by_drives =
            matches!(Reason::from_request(request), Some(Reason::NotArmedDrive { .. } | Reason::NotResetDrive { .. }));
        if by_drives && !answer.is_accepted() {
            return;
        }
        let word = |accepted: bool| if accepted { "accepted" } else { "refused" };
        let was = format!("{} ({}): {}", word(request.accepted == 1), request.reason, text_of(&request.answer));
        let is = format!("{} ({}): {}", word(answer.is_accepted()), answer.reason.code(), answer.reason);
        self.request.compare_text(time_ns, request.header.cycle, "answer", &was, &is);
    }

    fn compare_estimates(&mut self, slot: usize, until_ns: u64) {
        while let Some((time_ns, estimate)) = self.estimate[slot].next_due(until_ns) {
            let again = self.estimators[slot].step(time_ns, &estimate, &self.recent, &self.configuration);
            let mut input = estimate;
            match again {
                Ok(mut made) => {
                    // The kernel's thread id is not a result of the step.
                    made.thread = estimate.thread;
                    if let Some(collector) = &mut self.collector {
                        collector.estimate(&estimate, &made);
                        // A changed estimator also changes the inputs of the controllers.
                        input = made;
                    }
                    if self.compares {
                        self.estimate[slot].compare(time_ns, &estimate, made);
                    }
                }
                Err(why) => self.estimate[slot].skip(why),
            }
            self.recent.estimates[slot].push(input.header.cycle, time_ns, input);
        }
    }

    fn compare_controls(&mut self, slot: usize, until_ns: u64) {
        while let Some((time_ns, status)) = self.control[slot].next_due(until_ns) {
            let again = self.controllers[slot].step(time_ns, &status, &self.recent, &self.configuration);
            if !self.compares {
                continue;
            }
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

    /// Processes the remaining samples and returns the result.
    fn end(mut self) -> Answer<Replayed> {
        self.process(u64::MAX);
        self.configuration.check_law()?;
        let Self { state, authority, slots, energy, request, estimate, command, control, .. } = self;
        let motor_io = [state.end(), authority.end(), slots.end(), energy.end(), request.end_of_some()];
        let estimators = estimate.map(Channel::end);
        let controllers = [command.map(Channel::end), control.map(Channel::end)].into_iter().flatten();
        let (first_ns, last_ns) = self.first_and_last_ns.unwrap_or_default();
        Ok(Replayed {
            channels: motor_io.into_iter().chain(estimators).chain(controllers).flatten().collect(),
            cycles: self.cycles,
            flown_s: last_ns.saturating_sub(first_ns) as f64 * 1e-9,
            damage: Vec::new(),
            instead: self.collector.map(Collector::end),
            recorded_by: None,
        })
    }
}
