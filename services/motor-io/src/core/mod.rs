//! The decisions of motor-io: one cycle in two halves, without a clock and without I/O.
//!
//! [`Core::decide`] is here. `follow` computes the velocities of each mode, `soft` the currents of soft mode, `settle`
//! ends a stop, a jog or a motion, `observe` is the second half of the cycle, and `still` resets the drives' loops at
//! rest.

mod account;
mod border;
mod computer;
mod follow;
mod invariants;
mod judge;
mod observe;
mod settle;
mod soft;
mod starved;
mod still;

use account::Account;
use starved::Starved;
use still::Still;

use crate::answer::Answer;
use crate::arbiter::{Arbiter, ArbiterInput, ChosenCommand};
use crate::commanded_envelope::CommandedEnvelope;
use crate::energy::EnergyMeter;
use crate::limits::Limits;
use crate::mode::{Braking, Following, Mode, Stop};
use crate::motion::Motion;
use crate::node::Node;
use crate::odometry::{Odometry, Position};
use crate::plan_clock::PlanClock;
use crate::safety::Safety;
use crate::settings::CoreConfig;
use crate::slip::Slips;
use crate::watch::Watch;
use arrayvec::ArrayVec;
use cable_robot::{CableVec, Vector3, elastic};
use messages::{CABLES, Energy, MotorAuthority, MotorInput, MotorSlots, MotorState};

/// Requests per cycle; further ones wait for the next cycle.
pub const REQUESTS: usize = 4;
/// Time from a gap in which the drives' watchdog stopped the motors until the motion continues, s.
const AFTER_GAP_S: f64 = 1.0;
/// Longest gap after which a motion continues without a request, s. A hiccup of a virtual machine is shorter.
const LONGEST_GAP_S: f64 = 1.0;

/// What the drives do in this cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveCommand {
    /// Velocity of each cable, dL/dt, m/s; all zero: the drives hold.
    pub speed_m_s: [f64; CABLES],
    /// Cables whose drive is off: duty 0 instead of a speed.
    pub released: [bool; CABLES],
    /// Radius of each drum whose turns are counted relative to that of the bare one; 1 for encoders on idlers.
    pub radius_ratio: [f64; CABLES],
    /// In soft mode the current of each motor, A, instead of a speed; positive pulls the cable in.
    pub current_a: Option<[f64; CABLES]>,
}

impl DriveCommand {
    /// Speed of a cable's encoder, m/s: of the idler's rim, or of the bare drum's.
    #[must_use]
    pub fn encoder_m_s(&self, cable: usize) -> f64 {
        self.speed_m_s[cable] / self.radius_ratio[cable]
    }

    /// Returns true if no cable moves.
    #[must_use]
    pub fn is_hold(&self) -> bool {
        self.speed_m_s == [0.0; CABLES] && self.current_a.is_none()
    }
}

/// Results of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Sample of `motor/state`.
    pub state: MotorState,
    /// Sample of `motor/authority`.
    pub authority: MotorAuthority,
    /// Sample of `motor/slots`.
    pub slots: MotorSlots,
    /// Sample of `energy`.
    pub energy: Energy,
}

/// Safety machine, arbiter and everything else that decides; see the crate's documentation. All of it follows from the
/// configuration and the sequence of [`MotorInput`]s.
#[derive(Debug, Clone)]
pub struct Core {
    pub(crate) config: CoreConfig,
    pub(crate) safety: Safety,
    pub(crate) motion: Motion,
    pub(crate) clock: PlanClock,
    pub(crate) limits: Limits,
    pub(crate) odometry: Odometry,
    pub(crate) node: Node,
    envelope: CommandedEnvelope,
    pub(crate) watch: Watch,
    pub(crate) slips: Slips,
    pub(crate) chosen: Option<ChosenCommand>,
    pub(crate) arbiter: Arbiter,
    energy: EnergyMeter,
    answers: ArrayVec<Answer, REQUESTS>,
    /// When the newest request to stop was made, ns.
    pub(crate) stopped_ns: u64,
    /// When the newest request to hold was made that no resume has followed, ns; 0: none.
    pub(crate) held_ns: u64,
    /// When the newest request was made that ended what was asked for before it, ns.
    pub(crate) ended_ns: u64,
    still: Still,
    /// A unit did not answer in the last exchange.
    unit_trouble: bool,
    supervisor: Beat,
    planner: Beat,
    timing: Timing,
    account: Account,
    starved: Starved,
    sent: DriveCommand,
    decision: Decision,
}

/// Times of the newest cycle.
#[derive(Debug, Clone, Copy, Default)]
struct Timing {
    /// False before the first cycle.
    began: bool,
    /// Begin of the cycle, ns.
    begin_ns: u64,
    /// End of the newest exchange with the drives, ns.
    end_ns: u64,
    /// Time since the cycle before began, s.
    gap_s: f64,
}

/// What the first half of a cycle decided, for the second half.
#[derive(Debug, Clone, Copy)]
struct Decision {
    /// A motion was under way when the cycle began.
    under_way: bool,
    /// A command that answers the cycle before is used.
    fresh: bool,
    /// Age of the oldest input of that command, ns; 0: no command is used.
    command_age_ns: u64,
    /// Cable velocities before the limits, m/s.
    wanted_m_s: [f64; CABLES],
    /// Cable velocities of the cycle before, m/s.
    sent_before_m_s: [f64; CABLES],
    /// Factor by which the velocity limits scaled the vector.
    scale: f64,
}

impl Decision {
    /// Nothing is decided yet.
    fn new(under_way: bool, sent_before_m_s: [f64; CABLES]) -> Self {
        Self { under_way, fresh: false, command_age_ns: 0, wanted_m_s: [0.0; CABLES], sent_before_m_s, scale: 1.0 }
    }
}

/// Liveness counter of another process.
#[derive(Debug, Clone, Copy, Default)]
struct Beat {
    value: u64,
    unchanged: u32,
}

impl Beat {
    fn record(&mut self, value: u64) {
        if value == self.value {
            self.unchanged = self.unchanged.saturating_add(1);
        } else {
            *self = Self { value, unchanged: 0 };
        }
    }

    /// Returns true if the process was running and its counter has not changed for this long.
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
            node: Node::new(config.robot),
            envelope: CommandedEnvelope::new(&config),
            watch: Watch::new(),
            slips: Slips::new(&config),
            arbiter: Arbiter::new(&config),
            energy: EnergyMeter::default(),
            chosen: None,
            answers: ArrayVec::new(),
            stopped_ns: 0,
            held_ns: 0,
            ended_ns: 0,
            still: Still::default(),
            unit_trouble: false,
            supervisor: Beat::default(),
            planner: Beat::default(),
            timing: Timing::default(),
            account: Account::default(),
            starved: Starved::default(),
            sent: DriveCommand {
                speed_m_s: [0.0; CABLES],
                released: [true; CABLES],
                radius_ratio: [1.0; CABLES],
                current_a: None,
            },
            decision: Decision::new(false, [0.0; CABLES]),
            config,
        }
    }

    /// Computes what the drives do from everything that arrived: the first half of a cycle. The drives'
    /// replies come later.
    pub fn decide(&mut self, input: &MotorInput) -> DriveCommand {
        let at_begin = self.before();
        self.answers.clear();
        // No cable moves in the cycle in which a motion begins; the next one is the first that can be steered. The
        // cycle in which the motion ends counts.
        self.decision = Decision::new(self.motion.id() != 0, self.sent.speed_m_s);
        self.keep_time(input);
        let moving = self.safety.mode().on_motion();
        self.supervisor.record(input.supervisor_beat);
        self.planner.record(input.planner_beat);
        self.motion.update(input);
        let ended = self.motion.is_over(self.clock.time_s());
        let starved = self.starved_slots();
        let context = ArbiterInput { epoch: self.safety.epoch(), moving, sent_m_s: self.sent.speed_m_s, starved };
        let motion = &self.motion;
        self.chosen = self.arbiter.choose(input, &context, |segment| motion.has(segment) || (ended && segment == 0));
        for i in 0..REQUESTS {
            if input.request[i].verb != 0 {
                let answer = self.request(input, input.request_id[i], &input.request[i], input.request_stamp_ns[i]);
                self.answers.push(answer);
            }
        }
        let wanted = self.wanted(input);
        let wanted = self.keep_correction(input, wanted);
        self.decision.wanted_m_s = wanted;
        let before = self.limits.last_speed();
        let (speed_m_s, scale) = match self.safety.mode() {
            Mode::EmergencyStop | Mode::Disarmed => {
                self.limits.zero();
                ([0.0; CABLES], 1.0)
            }
            // The drives get currents, and the limits keep what the hand does: from there the cables come to rest.
            Mode::Soft(_) => ([0.0; CABLES], 1.0),
            _ => {
                let mut limits = self.limits.clone();
                // With a fault the robot brakes as fast as the cables' limits allow.
                let node = if *self.safety.mode() == Mode::Faulted { None } else { self.node_limit() };
                let sent = limits.toward(&wanted, node.as_ref());
                if self.judge(input, &wanted) && self.keep_lengths(&wanted) && self.keep_lengths(&sent.0) {
                    self.limits = limits;
                    sent
                } else {
                    // Nothing of the command is sent.
                    (self.decision.fresh, self.decision.command_age_ns) = (false, 0);
                    self.limits.toward(&[0.0; CABLES], None)
                }
            }
        };
        self.decision.scale = scale;
        self.settle(before, &speed_m_s);
        let holds = *self.safety.mode() == Mode::Holding || self.safety.mode().is_latched();
        let resets = self.still.resets_loops(&self.config, holds && speed_m_s == [0.0; CABLES]);
        let released = if resets { [true; CABLES] } else { self.safety.released() };
        let radius_ratio = std::array::from_fn(|cable| self.odometry.radius_ratio(cable));
        let current_a = if let Mode::Soft(soft) = self.safety.mode() { Some(soft.current_a) } else { None };
        self.sent = DriveCommand { speed_m_s, released, radius_ratio, current_a };
        self.check_decision(&at_begin, before);
        self.sent
    }

    /// Answers to this cycle's requests.
    #[must_use]
    pub fn answers(&self) -> &[Answer] {
        &self.answers
    }

    /// Cable velocities before the limits, m/s.
    #[must_use]
    pub fn asked_m_s(&self) -> &[f64; CABLES] {
        &self.decision.wanted_m_s
    }

    /// Time on the plan clock, s.
    #[must_use]
    pub fn plan_time_s(&self) -> f64 {
        self.clock.time_s()
    }

    /// Number of the motion that the robot follows or can resume; 0: none.
    #[must_use]
    pub fn motion(&self) -> u32 {
        self.motion.id()
    }

    /// True while cables move because the operator or a mission asked for it.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.safety.mode().moves()
    }

    /// True if nothing was asked to move and every cable is commanded to stand still, also after a fault.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        !self.moves() && self.limits.last_speed() == 0.0
    }

    /// True while a controller steers, so that a command that is a little late is worth waiting for.
    #[must_use]
    pub fn awaits_command(&self) -> bool {
        let following = matches!(self.safety.mode(), Mode::Following(_));
        let steering = self.safety.mode().steering();
        steering.is_some_and(|steering| steering.missing() == 0) && !(following && self.unit_trouble)
    }

    /// The slots whose answer is worth waiting for: controller and estimator.
    #[must_use]
    pub fn awaited_slots(&self) -> (usize, usize) {
        self.arbiter.in_charge()
    }

    /// Number of drive units, and the unit of each cable.
    #[must_use]
    pub fn units(&self) -> (usize, [usize; CABLES]) {
        (self.config.unit_count, self.config.unit_of_cable)
    }

    /// Position to store on disk, if the lengths are valid.
    #[must_use]
    pub fn position(&self) -> Option<Position> {
        (self.odometry.position() != MotorState::POSITION_UNKNOWN && !self.odometry.only_restored()).then(|| Position {
            lengths_m: std::array::from_fn(|i| self.odometry.length_m(i)),
            counts: std::array::from_fn(|i| self.odometry.stored_counts(i)),
            zeroed_m: self.odometry.zeroed_m(),
        })
    }

    /// Takes over the position of the last life. The margins of obstacles count the errors of the lengths from where
    /// they were set then.
    fn restore(&mut self, position: Position) {
        let robot = &self.config.robot;
        let lengths_m = CableVec::from_array8(&position.zeroed_m, robot.cable_count());
        let set = lengths_m.is_finite().then(|| elastic::equilibrium(robot, &lengths_m, &Vector3::zeros(), None).ok());
        let set_at = set.flatten().map(|found| found.position);
        self.config.robot = robot.with_lengths_set_at(set_at.as_ref());
        self.odometry.restore(position);
    }

    /// Handles late begins, gaps, and the input of the first cycle.
    fn keep_time(&mut self, input: &MotorInput) {
        if !self.timing.began {
            self.timing.began = true;
            self.timing.begin_ns = input.begin_ns;
            if input.first_epoch != 0 {
                self.safety.begin_epoch(input.first_epoch);
            }
            if input.restored == 1 {
                self.restore(Position {
                    lengths_m: input.restored_m,
                    counts: input.restored_counts,
                    zeroed_m: input.restored_zeroed_m,
                });
            }
        }
        self.record_evidence(input);
        let gap_s = input.begin_ns.saturating_sub(self.timing.begin_ns) as f64 * 1e-9;
        (self.timing.gap_s, self.timing.begin_ns) = (gap_s, input.begin_ns);
        let left_out_s = self.left_out_s();
        if let Mode::Jogging(jog) = self.safety.mode_mut() {
            // The drives kept the last velocity until a new one came; `settle` has counted one period of it.
            let passed_s = gap_s.min(self.config.watchdog_s) - left_out_s;
            jog.left_m -= self.sent.speed_m_s[jog.cable] * (passed_s - self.config.period_s);
        }
        // Also a robot that a fault brakes: its motors stand, and would set out again with what is left of its
        // velocity.
        if !self.is_at_rest() {
            if gap_s > self.config.watchdog_s {
                self.restart_from_rest(gap_s > LONGEST_GAP_S);
            } else if self.watch.late_for_a_unit() >= self.config.cycles(self.config.watchdog_s) {
                // Cycles began in time, and a unit took none of their commands.
                self.restart_from_rest(true);
            }
        }
    }

    /// Restarts the motion from rest after a time in which the drives' watchdog stopped the motors.
    /// `long`: only on request.
    fn restart_from_rest(&mut self, long: bool) {
        self.limits.zero();
        self.clock.stop_at_once();
        match self.safety.mode_mut() {
            Mode::Jogging(jog) => {
                jog.cancelled = true;
                if long {
                    self.safety.record_stop(MotorAuthority::FAULT_LONG_GAP);
                }
            }
            Mode::Soft(_) => self.end_soft(MotorAuthority::FAULT_LONG_GAP),
            Mode::Following(_) if long => self.begin_stop(Stop::open(), MotorAuthority::FAULT_LONG_GAP),
            Mode::Following(Following { gap_wait, .. }) => {
                *gap_wait = self.config.cycles(AFTER_GAP_S);
                self.safety.record_stop(MotorAuthority::FAULT_LONG_GAP);
            }
            Mode::Stopping(stop) if long => stop.braking = Braking::Open,
            _ => {}
        }
    }
}
