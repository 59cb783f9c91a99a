//! The deciding part of motor-io: one cycle in two halves, without a clock, without I/O.

use crate::answer::Answer;
use crate::arbiter::{Arbiter, Chosen};
use crate::config::CoreConfig;
use crate::energy::EnergyMeter;
use crate::faults::Faults;
use crate::limits::Limits;
use crate::motion::Motion;
use crate::odometry::{Odometry, Reading};
use crate::plan_clock::PlanClock;
use crate::safety::{Mode, Safety};
use crate::watch::{Situation, Watch};
use arrayvec::ArrayVec;
use messages::{CABLES, Energy, Header, MotorAuthority, MotorInput, MotorState};

/// Requests taken in one cycle; more wait for the next.
pub const REQUESTS: usize = 4;
/// Time after a gap in which the drives' watchdog stopped the motors, before the motion goes on by itself, s.
const AFTER_GAP_S: f64 = 1.0;
/// A gap longer than this is no hiccup of a virtual machine: who knows what has happened meanwhile. Somebody has to resume, s.
const LONGEST_GAP_S: f64 = 1.0;
/// So long without answers for which this program was too late, and the robot stops on its path, s.
const LATE_S: f64 = 0.4;
/// A planner that does not publish the motion any more is gone after so many cycles; fewer, and it may just be about to.
const ORPHANED_CYCLES: u32 = 5;
/// How far a jog may come beyond a length limit before it is a fault: its end was checked, and readings have steps, m.
const JOG_MARGIN_M: f64 = 0.01;

/// Longest wait for the last millimetres of a controlled stop, s.
const REST_S: f64 = 1.0;
/// A tick that came more than this many periods after the last one leaves a gap in the motion worth looking at.
const GAP_PERIODS: f64 = 1.5;

/// Drives react after up to 0.16 s (delay and lag), and the readings are a cycle old, s.
const REACTION_S: f64 = 0.2;

/// What the drives are to do in this cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveCommand {
    /// Velocity of each cable, dL/dt, m/s; all zero: the drives hold.
    pub speed_m_s: [f64; CABLES],
    /// Cables that are let go: duty 0 instead of a speed.
    pub released: [bool; CABLES],
}

impl DriveCommand {
    /// True if nothing is to move.
    #[must_use]
    pub fn is_hold(&self) -> bool {
        self.speed_m_s == [0.0; CABLES]
    }
}

/// What the cycle came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// For `motor/state`.
    pub state: MotorState,
    /// For `motor/authority`.
    pub authority: MotorAuthority,
    /// For `energy`.
    pub energy: Energy,
}

/// How the robot comes to rest in [`Mode::Stopping`].
#[derive(Debug, Clone, Copy, Default)]
struct Stop {
    /// Without a controller: the vector shrinks to zero.
    open: bool,
    /// The motion is given up, not kept.
    dropped: bool,
    /// Cycles at standstill of the plan clock.
    waited: u32,
}

/// One cable on its way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Jog {
    /// Cable, from 0.
    pub(crate) cable: usize,
    /// How far it still has to go, m.
    pub(crate) left_m: f64,
    /// Comes to rest where it is.
    pub(crate) cancelled: bool,
}

/// See the crate's text. Everything it does follows from its configuration and the sequence of [`MotorInput`]s.
#[derive(Debug, Clone)]
pub struct Core {
    pub(crate) config: CoreConfig,
    pub(crate) safety: Safety,
    pub(crate) motion: Motion,
    pub(crate) clock: PlanClock,
    pub(crate) limits: Limits,
    pub(crate) odometry: Odometry,
    pub(crate) watch: Watch,
    pub(crate) chosen: Option<Chosen>,
    pub(crate) pausing: bool,
    pub(crate) jog: Option<Jog>,
    arbiter: Arbiter,
    energy: EnergyMeter,
    stop: Stop,
    answers: ArrayVec<Answer, REQUESTS>,
    /// Velocities of the last command that was used, and the plan clock's rate then.
    good: ([f64; CABLES], f64),
    ttl_cycles: u32,
    missing: u32,
    settled: u32,
    gap_wait: u32,
    gap_s: f64,
    unit_trouble: bool,
    supervisor: Beat,
    planner: Beat,
    began: bool,
    begin_ns: u64,
    sent: DriveCommand,
    sent_before: [f64; CABLES],
    scale: f64,
    command_age_ns: u64,
    missed: u64,
    late: u64,
    skipped: u64,
}

/// A sign of life that has to change.
#[derive(Debug, Clone, Copy, Default)]
struct Beat {
    value: u64,
    unchanged: u32,
}

impl Beat {
    fn note(&mut self, value: u64) {
        if value == self.value {
            self.unchanged = self.unchanged.saturating_add(1);
        } else {
            *self = Self { value, unchanged: 0 };
        }
    }

    /// Was there, and is not any more.
    fn lost(&self, cycles: u32) -> bool {
        self.value != 0 && self.unchanged > cycles
    }
}

impl Core {
    /// Disarmed, position unknown, plan clock at 0.
    #[must_use]
    pub fn new(config: CoreConfig) -> Self {
        Self {
            safety: Safety::new(),
            motion: Motion::default(),
            clock: PlanClock::new(config.period_s),
            limits: Limits::new(config.cable_speed_m_s, config.cable_acceleration_m_s2, config.period_s),
            odometry: Odometry::new(&config),
            watch: Watch::new(),
            arbiter: Arbiter::new(config.cable_count(), config.cable_speed_m_s),
            energy: EnergyMeter::default(),
            chosen: None,
            pausing: false,
            jog: None,
            stop: Stop::default(),
            answers: ArrayVec::new(),
            good: ([0.0; CABLES], 0.0),
            ttl_cycles: config.ttl_cycles,
            missing: 0,
            settled: 0,
            gap_wait: 0,
            gap_s: 0.0,
            unit_trouble: false,
            supervisor: Beat::default(),
            planner: Beat::default(),
            began: false,
            begin_ns: 0,
            sent: DriveCommand { speed_m_s: [0.0; CABLES], released: [true; CABLES] },
            sent_before: [0.0; CABLES],
            scale: 1.0,
            command_age_ns: 0,
            missed: 0,
            late: 0,
            skipped: 0,
            config,
        }
    }

    /// First half of a cycle: from what arrived (never from the drives' replies, which come later) to what is sent.
    pub fn decide(&mut self, input: &MotorInput) -> DriveCommand {
        self.answers.clear();
        self.keep_time(input);
        let moving = matches!(self.safety.mode(), Mode::Following | Mode::Stopping);
        self.chosen = self.arbiter.choose(input, self.safety.epoch(), moving);
        self.supervisor.note(input.supervisor_beat);
        self.planner.note(input.planner_beat);
        self.motion.note(input);
        for i in 0..REQUESTS {
            if input.request_verb[i] != 0 {
                let mut args = [0.0; 8];
                args.copy_from_slice(&input.request_args[i * 8..][..8]);
                let age_s = match input.request_stamp_ns[i] {
                    0 => 0.0,
                    made_ns => input.begin_ns.saturating_sub(made_ns) as f64 * 1e-9,
                };
                let answer = self.request(input, input.request_id[i], input.request_verb[i], &args, age_s);
                self.answers.push(answer);
            }
        }
        self.command_age_ns = 0;
        let wanted = self.wanted(input);
        self.sent_before = self.sent.speed_m_s;
        let before = self.limits.last_speed();
        let (speed_m_s, scale) = match self.safety.mode() {
            Mode::EmergencyStop | Mode::Disarmed => {
                self.limits.zero();
                ([0.0; CABLES], 1.0)
            }
            _ => {
                let last = self.limits.clone();
                let sent = self.limits.toward(&wanted);
                if self.keep_lengths(&wanted) && self.keep_lengths(&sent.0) {
                    sent
                } else {
                    self.limits = last;
                    self.limits.toward(&[0.0; CABLES])
                }
            }
        };
        self.scale = scale;
        self.settle(before, &speed_m_s);
        self.sent = DriveCommand { speed_m_s, released: self.safety.released() };
        self.sent
    }

    /// The answers to this cycle's requests.
    #[must_use]
    pub fn answers(&self) -> &[Answer] {
        &self.answers
    }

    /// Present mode.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.safety.mode()
    }

    /// True while the robot moves by a controller's commands, so that one that is a little late is worth waiting for.
    #[must_use]
    pub fn awaits_command(&self) -> bool {
        match self.safety.mode() {
            Mode::Following => !self.unit_trouble && self.missing == 0,
            Mode::Stopping => !self.stop.open && self.missing == 0,
            _ => false,
        }
    }

    /// What would have to be kept on disk: lengths and counts, if the lengths mean something.
    #[must_use]
    pub fn position(&self) -> Option<([f64; CABLES], [i64; CABLES])> {
        (self.odometry.position() != MotorState::POSITION_UNKNOWN && !self.odometry.only_restored()).then(|| {
            (std::array::from_fn(|i| self.odometry.length_m(i)), std::array::from_fn(|i| self.odometry.counts(i)))
        })
    }

    /// Late ticks, gaps, and what only the first cycle brings.
    fn keep_time(&mut self, input: &MotorInput) {
        if !self.began {
            self.began = true;
            self.begin_ns = input.begin_ns;
            if input.first_epoch != 0 {
                self.safety.begin_epoch(input.first_epoch);
            }
            if input.restored == 1 {
                self.odometry.restore(input.restored_m, input.restored_counts);
            }
        }
        let period_s = self.config.period_s;
        if input.begin_ns.saturating_sub(input.tick_ns) as f64 * 1e-9 > 0.5 * period_s {
            self.late += 1;
        }
        self.gap_s = input.begin_ns.saturating_sub(self.begin_ns) as f64 * 1e-9;
        self.begin_ns = input.begin_ns;
        let moving = matches!(self.safety.mode(), Mode::Following | Mode::Stopping | Mode::Jogging);
        if moving && self.gap_s > self.config.watchdog_s {
            // The drives stopped by themselves: from here the robot starts again, from rest.
            self.limits.zero();
            self.clock.stand();
            self.cancel_jog();
            if self.gap_s > LONGEST_GAP_S && self.safety.mode() != Mode::Jogging {
                if self.safety.mode() == Mode::Following {
                    self.begin_stop(false, MotorAuthority::FAULT_LONG_GAP);
                }
                self.stop.open = true;
            } else if self.safety.mode() == Mode::Following {
                self.gap_wait = self.config.cycles(AFTER_GAP_S);
                self.safety.note_stop(MotorAuthority::FAULT_LONG_GAP);
            }
        }
    }

    /// The velocities the mode asks for.
    fn wanted(&mut self, input: &MotorInput) -> [f64; CABLES] {
        match self.safety.mode() {
            Mode::Holding => {
                self.start(input);
                [0.0; CABLES]
            }
            Mode::Jogging => self.jogging(),
            Mode::Following => self.following(input),
            Mode::Stopping => self.stopping(input),
            Mode::Disarmed | Mode::Faulted | Mode::EmergencyStop => [0.0; CABLES],
        }
    }

    /// Begins a motion that is offered, if a controller follows it already.
    fn start(&mut self, input: &MotorInput) {
        let follows = self.chosen.is_some_and(|chosen| chosen.segment == input.motion_segment);
        if follows
            && self.who_is_lost() == 0
            && self.odometry.position() == MotorState::POSITION_KNOWN
            && !self.unit_trouble
            && self.motion.offered(input, self.safety.epoch(), self.clock.time_s(), self.config.period_s)
        {
            self.motion.begin(input);
            self.follow();
        }
    }

    /// Supervisor and planner, where they were there and are not any more; bits of faults.
    pub(crate) fn who_is_lost(&self) -> u32 {
        let cycles = self.config.cycles(self.config.beat_s);
        let bit = |beat: &Beat, bit: u32| if beat.lost(cycles) { bit } else { 0 };
        bit(&self.supervisor, MotorAuthority::FAULT_SUPERVISOR_LOST)
            | bit(&self.planner, MotorAuthority::FAULT_PLANNER_LOST)
    }

    /// From Holding to Following, for the first time or again.
    pub(crate) fn follow(&mut self) {
        self.safety.clear_stops(crate::faults::STOPS);
        self.motion.resume();
        self.pausing = false;
        self.missing = 0;
        self.settled = 0;
        self.gap_wait = 0;
        self.stop = Stop::default();
        self.good = ([0.0; CABLES], 0.0);
        self.safety.enter(Mode::Following);
    }

    fn following(&mut self, input: &MotorInput) -> [f64; CABLES] {
        let lost = self.who_is_lost();
        if lost & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            self.begin_stop(false, MotorAuthority::FAULT_SUPERVISOR_LOST);
            return self.stopping(input);
        }
        if self.watch.late() > self.config.cycles(LATE_S) {
            // This program does not get to speak with the drives: it comes to rest while it still does now and then.
            self.begin_stop(false, MotorAuthority::FAULT_LONG_GAP);
            return self.stopping(input);
        }
        if lost != 0 || (self.motion.orphaned() > ORPHANED_CYCLES && !self.motion.ended(self.clock.time_s())) {
            // What is known of the motion is flown to its end; see `settle`.
            self.safety.note_stop(MotorAuthority::FAULT_PLANNER_LOST);
        }
        let ended = self.motion.ended(self.clock.time_s());
        self.settled = if ended { self.settled.saturating_add(1) } else { 0 };
        let run = !self.pausing && !ended && !self.unit_trouble && self.gap_wait == 0;
        self.clock.set_ease(self.watch.ease());
        let usable = self.chosen.filter(|chosen| self.motion.has(chosen.segment) || (ended && chosen.segment == 0));
        match usable {
            Some(chosen) => {
                self.use_command(input, &chosen);
                if self.gap_wait > 0 && !self.unit_trouble {
                    self.gap_wait -= 1;
                    if self.gap_wait == 0 {
                        self.safety.clear_stops(MotorAuthority::FAULT_LONG_GAP);
                    }
                }
                self.clock.advance(run, self.config.ramp_s);
                self.good = (chosen.velocity_m_s, self.clock.rate());
                chosen.velocity_m_s
            }
            None if self.unit_trouble => {
                // Without this cycle's readings no controller can answer. The drives go on, and so does the plan, slower.
                self.clock.advance(false, self.config.ramp_s);
                self.last_good()
            }
            None => {
                self.missed += 1;
                self.missing += 1;
                if self.missing > self.ttl_cycles {
                    self.begin_stop(false, self.why_missing(input));
                    self.stop.open = true;
                    return [0.0; CABLES];
                }
                self.clock.advance(run, self.config.ramp_s);
                self.last_good()
            }
        }
    }

    fn stopping(&mut self, input: &MotorInput) -> [f64; CABLES] {
        if self.stop.open {
            return [0.0; CABLES];
        }
        let usable = self.chosen.filter(|chosen| self.motion.has(chosen.segment));
        self.clock.advance(false, self.config.stop_s);
        if let Some(chosen) = usable {
            self.use_command(input, &chosen);
            self.good = (chosen.velocity_m_s, self.clock.rate());
            return chosen.velocity_m_s;
        }
        self.missing += 1;
        if self.missing > self.ttl_cycles && !self.unit_trouble {
            self.stop.open = true;
        }
        self.last_good()
    }

    fn use_command(&mut self, input: &MotorInput, chosen: &Chosen) {
        self.motion.follow(if chosen.segment == 0 { self.motion.segment() } else { chosen.segment });
        self.missing = 0;
        self.ttl_cycles = self.config.ttl_cycles.min(chosen.ttl_cycles);
        self.command_age_ns = input.begin_ns.saturating_sub(chosen.oldest_input_ns);
    }

    /// The last command that was used, slowed down as far as the plan clock has been since.
    fn last_good(&self) -> [f64; CABLES] {
        let (velocity, rate) = self.good;
        let factor = if rate > 0.0 { (self.clock.rate() / rate).min(1.0) } else { 0.0 };
        velocity.map(|v| v * factor)
    }

    fn why_missing(&self, input: &MotorInput) -> u32 {
        let estimator = self.arbiter.active_estimator();
        if input.estimate_cycle[estimator].saturating_add(1) < input.header.cycle {
            // The controller has nothing to answer to.
            return MotorAuthority::FAULT_ESTIMATE_LOST;
        }
        if self.motion.orphaned() > 0 {
            return MotorAuthority::FAULT_PLANNER_LOST;
        }
        match self.arbiter.verdict()[self.arbiter.active_controller()] {
            MotorAuthority::VERDICT_NO_ESTIMATE => MotorAuthority::FAULT_ESTIMATE_LOST,
            MotorAuthority::VERDICT_NOT_FINITE | MotorAuthority::VERDICT_OUT_OF_LIMITS => {
                MotorAuthority::FAULT_COMMAND_REFUSED
            }
            _ => MotorAuthority::FAULT_COMMAND_LOST,
        }
    }

    /// Comes to rest on the path. `cause` 0: somebody asked for it.
    pub(crate) fn begin_stop(&mut self, dropped: bool, cause: u32) {
        self.safety.note_stop(cause);
        self.stop = Stop { open: false, dropped, waited: 0 };
        self.safety.enter(Mode::Stopping);
    }

    /// A stop under way is to give up the motion after all.
    pub(crate) fn drop_motion_after_stop(&mut self) {
        self.stop.dropped = true;
    }

    /// Everything ends here: fault or emergency.
    pub(crate) fn abandon(&mut self) {
        self.motion.finish(self.clock.time_s());
        self.pausing = false;
        self.jog = None;
        self.gap_wait = 0;
        if self.safety.mode() == Mode::EmergencyStop {
            self.clock.stand();
        }
    }

    /// The cable comes to rest where it is.
    pub(crate) fn cancel_jog(&mut self) {
        if let Some(jog) = &mut self.jog {
            jog.cancelled = true;
        }
    }

    fn jogging(&mut self) -> [f64; CABLES] {
        if self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            self.safety.note_stop(MotorAuthority::FAULT_SUPERVISOR_LOST);
            self.cancel_jog();
        }
        let mut wanted = [0.0; CABLES];
        if let Some(Jog { cable, left_m, cancelled: false }) = self.jog {
            // Slows down as it comes near, gently: a quarter of what the cable may do.
            let near = (0.5 * self.config.cable_acceleration_m_s2 * left_m.abs()).sqrt();
            let speed = self.config.jog_speed_m_s.min(near).min(left_m.abs() / self.config.period_s);
            wanted[cable] = speed.copysign(left_m);
        }
        wanted
    }

    /// No cable runs beyond its length limits: where one would, the whole robot stops.
    fn keep_lengths(&mut self, speed_m_s: &[f64; CABLES]) -> bool {
        let mode = self.safety.mode();
        if !matches!(mode, Mode::Following | Mode::Stopping | Mode::Jogging)
            || self.odometry.position() == MotorState::POSITION_UNKNOWN
        {
            return true;
        }
        let mut found = Faults::default();
        for (i, [low, high]) in self.config.robot.length_limits_m().iter().enumerate() {
            let (length, v) = (self.odometry.length_m(i), speed_m_s[i]);
            let braking = match mode {
                Mode::Jogging => -JOG_MARGIN_M,
                _ => v * v / (2.0 * self.config.cable_acceleration_m_s2) + v.abs() * REACTION_S,
            };
            if (v > 0.0 && length + braking > *high) || (v < 0.0 && length - braking < *low) {
                found.cable(MotorAuthority::FAULT_LENGTH_LIMIT, i);
            }
        }
        if !found.is_empty() && self.safety.found(&found) {
            self.abandon();
        }
        found.is_empty()
    }

    /// After the velocities are fixed: has a stop, a jog or a motion come to its end?
    fn settle(&mut self, before: f64, sent: &[f64; CABLES]) {
        let speed = self.limits.last_speed();
        let gentle = speed <= self.limits.step();
        let uncontrolled =
            self.safety.mode() == Mode::Faulted || (self.safety.mode() == Mode::Stopping && self.stop.open);
        if uncontrolled {
            if before > 0.0 {
                self.clock.shrink(speed / before);
            }
            if speed == 0.0 {
                self.clock.stand();
            }
        }
        match self.safety.mode() {
            Mode::Stopping if self.stop.open && speed == 0.0 => self.rest(),
            Mode::Stopping if !self.stop.open && self.clock.rate() == 0.0 => {
                self.stop.waited += 1;
                if gentle || self.stop.waited > self.config.cycles(REST_S) {
                    // What is left of the velocity, at most one step, goes in the next cycle.
                    self.stop.open = true;
                }
            }
            Mode::Following if self.pausing && self.clock.rate() == 0.0 => {
                self.stop.waited += 1;
                if gentle || self.stop.waited > self.config.cycles(REST_S) {
                    self.begin_stop(false, 0);
                    self.stop.open = true;
                }
            }
            Mode::Following if self.clock.rate() == 0.0 && self.settled >= self.config.cycles(self.config.settle_s) => {
                self.stop.waited += 1;
                if gentle || self.stop.waited > self.config.cycles(REST_S) {
                    let short = self.motion.cut_short(self.config.period_s);
                    self.begin_stop(false, if short { MotorAuthority::FAULT_PLANNER_LOST } else { 0 });
                    self.motion.finish(self.clock.time_s());
                    self.stop.open = true;
                }
            }
            Mode::Following if !self.pausing && self.settled == 0 => self.stop.waited = 0,
            Mode::Jogging => {
                let over = self.jog.as_mut().is_none_or(|jog| {
                    jog.left_m -= sent[jog.cable] * self.config.period_s;
                    speed == 0.0 && (jog.cancelled || jog.left_m.abs() < 1e-6)
                });
                if over {
                    self.jog = None;
                    self.safety.enter(Mode::Holding);
                }
            }
            _ => {}
        }
    }

    /// At rest after Stopping.
    fn rest(&mut self) {
        self.clock.stand();
        self.pausing = false;
        if self.stop.dropped {
            self.motion.finish(self.clock.time_s());
            self.safety.bump();
        } else {
            self.motion.suspend();
        }
        self.safety.enter(Mode::Holding);
    }

    /// Second half of a cycle: the drives' replies.
    pub fn observe(&mut self, input: &MotorInput) -> Observation {
        let n = self.config.cable_count();
        let mut found = Faults::default();
        let back = self.watch.units(&self.config, input, &mut found);
        let ok: [bool; CABLES] =
            std::array::from_fn(|i| i < n && input.unit[self.config.unit_of_cable[i]] == MotorInput::UNIT_OK);
        self.unit_trouble = input.unit[..self.config.unit_count].iter().any(|unit| *unit != MotorInput::UNIT_OK);
        if self.unit_trouble && self.safety.energised() {
            self.skipped += 1;
        }
        let before: [f64; CABLES] = std::array::from_fn(|i| self.odometry.length_m(i));
        self.odometry.alive(std::array::from_fn(|i| input.unit_alive[self.config.unit_of_cable[i]] == 1));
        let mut fresh = [false; CABLES];
        for i in 0..n {
            let unit = self.config.unit_of_cable[i];
            if input.unit[unit] == MotorInput::UNIT_REBOOTED {
                self.odometry.rebase(i, input.counts[i], input.sampled_ns[i]);
            } else if ok[i] {
                match self.odometry.read(i, input.counts[i], input.sampled_ns[i], back[unit]) {
                    Reading::Good => fresh[i] = true,
                    Reading::Doubtful => {}
                    Reading::Jumped => found.cable(MotorAuthority::FAULT_ENCODER_JUMP, i),
                    Reading::MovedWhileAway => fresh[i] = true,
                }
            }
        }
        let velocity: [f64; CABLES] = std::array::from_fn(|i| if i < n { self.odometry.velocity_m_s(i) } else { 0.0 });
        let situation = Situation {
            energised: self.safety.energised(),
            following: matches!(self.safety.mode(), Mode::Following | Mode::Stopping),
            sent_m_s: self.sent.speed_m_s,
            released: self.sent.released,
            estimator: self.chosen.map_or(self.arbiter.active_estimator(), |chosen| chosen.estimator),
        };
        self.watch.cables(&self.config, input, &situation, &velocity, &fresh, &mut found);
        if self.safety.found(&found) {
            self.abandon();
        }
        self.catch_up(n, &before, &fresh);
        let state = self.state(input, &velocity, &fresh);
        let supply = self.watch.supply_v();
        let passed_s = self.gap_s.min(self.config.watchdog_s);
        let mut energy = self.energy.add(n, passed_s, self.config.robot.motor().resistance_ohm, |i| {
            (self.watch.current_a(i), self.watch.duty(i), supply[self.config.unit_of_cable[i]])
        });
        energy.header = state.header;
        Observation { state, authority: self.authority(input, &state.header), energy }
    }

    /// If this machine stood still, the drives went on by the last command: the plan follows them as far as the encoders show, or
    /// else the controller would drive the node back.
    fn catch_up(&mut self, n: usize, before: &[f64; CABLES], fresh: &[bool; CABLES]) {
        let period_s = self.config.period_s;
        let gap = self.gap_s > GAP_PERIODS * period_s && self.gap_s <= self.config.watchdog_s;
        if !gap || self.safety.mode() != Mode::Following || !fresh[..n].iter().all(|fresh| *fresh) {
            return;
        }
        let (mut along, mut square) = (0.0, 0.0);
        for (i, (before, v)) in before.iter().zip(&self.sent_before).enumerate().take(n) {
            along += (self.odometry.length_m(i) - before) * v;
            square += v * v;
        }
        // Below 5 mm/s there is nothing to catch up with.
        if square > 2.5e-5 {
            self.clock.catch_up((along / square - period_s).clamp(0.0, self.gap_s - period_s));
        }
    }

    fn state(&self, input: &MotorInput, velocity: &[f64; CABLES], fresh: &[bool; CABLES]) -> MotorState {
        let (n, units) = (self.config.cable_count(), self.config.unit_count);
        let mut state = MotorState {
            velocity_m_s: *velocity,
            command_m_s: self.sent.speed_m_s,
            status: self.watch.status(),
            supply_v: self.watch.supply_v(),
            fresh: fresh.map(u8::from),
            cable_count: n as u8,
            unit_count: units as u8,
            position_known: self.odometry.position(),
            ..MotorState::default()
        };
        for i in 0..n {
            state.sampled_ns[i] = self.odometry.sampled_ns(i);
            state.counts[i] = self.odometry.counts(i);
            state.length_m[i] = self.odometry.length_m(i);
            state.current_a[i] = self.watch.current_a(i);
            state.duty[i] = self.watch.duty(i);
        }
        for i in 0..units {
            state.unit_ok[i] = u8::from(input.unit[i] == MotorInput::UNIT_OK);
        }
        let oldest = state.sampled_ns[..n].iter().copied().min().unwrap_or(0);
        let newest = state.sampled_ns[..n].iter().copied().max().unwrap_or(0);
        state.header = Header { cycle: input.header.cycle, seq: 0, stamp_ns: newest, oldest_input_ns: oldest };
        state
    }

    fn authority(&self, input: &MotorInput, header: &Header) -> MotorAuthority {
        let faults = self.safety.faults();
        MotorAuthority {
            header: Header { stamp_ns: input.end_ns, ..*header },
            plan_time_s: self.clock.time_s(),
            plan_rate: self.clock.rate(),
            plan_rate_target: self.clock.target(),
            period_s: self.config.period_s,
            scale: self.scale,
            missed: self.missed,
            late: self.late,
            skipped: self.skipped,
            bus_ns: input.end_ns.saturating_sub(input.begin_ns),
            wake_ns: input.begin_ns.saturating_sub(input.tick_ns),
            command_age_ns: self.command_age_ns,
            faults: faults.bits,
            epoch: self.safety.epoch(),
            segment: self.motion.segment(),
            motion: self.motion.id(),
            mode: self.safety.mode() as u8,
            active_controller: self.chosen.map_or(self.arbiter.active_controller(), |chosen| chosen.controller) as u8,
            active_estimator: self.chosen.map_or(self.arbiter.active_estimator(), |chosen| chosen.estimator) as u8,
            verdict: self.arbiter.verdict(),
            position_known: self.odometry.position(),
            fault_cable: faults.cables.map(u8::from),
            fault_unit: faults.units.map(u8::from),
            cable_count: self.config.cable_count() as u8,
            ..MotorAuthority::default()
        }
    }
}
