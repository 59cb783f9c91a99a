//! A small robot of three cables on two units: drives that follow with a lag, and a controller with given answers.
#![allow(dead_code, clippy::unwrap_used, clippy::needless_range_loop)]

use cable_robot::profile::ProfileLimits;
use cable_robot::{Path, Profile, Robot, RobotParts, Segment, Vector3};
use messages::{CABLES, MotorCommand, MotorInput, NodeEstimate, PlanMotion, PlanSegment, Request, RequestBody, UNITS};
use motor_io::{Answer, Core, CoreConfig, DriveCommand, Inbox, Observation, Position};
use robot_state::Reason;
use segments::segment_message;
use std::collections::VecDeque;

pub const PERIOD_S: f64 = 0.01;
pub const COUNTS_PER_M: [f64; 3] = [10_000.0, -10_000.0, 12_000.0];
/// Time without a command after which a drive stops its motor, s.
const WATCHDOG_S: f64 = 0.3;

/// Parts of the rig's robot.
pub fn parts() -> RobotParts {
    RobotParts {
        anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
        node_mass_kg: 1.2,
        tension_limits_n: [2.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        length_limits_m: Some(vec![[0.3, 14.0]; 3]),
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; 3]),
        ..RobotParts::default()
    }
}

pub fn config() -> CoreConfig {
    config_at(1.0 / PERIOD_S)
}

pub fn config_at(rate_hz: f64) -> CoreConfig {
    let robot = Robot::new(parts()).unwrap();
    CoreConfig::new(robot, 1.0 / rate_hz, &COUNTS_PER_M, &[vec![0, 1], vec![2]]).unwrap()
}

/// Sets the lengths of the three cables, m.
pub fn lengths(lengths_m: [f64; 3]) -> Request {
    Request::ZeroLengths { lengths_m: lengths_m.into_iter().collect() }
}

/// A position of the last life, which does not say where its lengths were set.
pub fn stored(lengths_m: [f64; CABLES], counts: [i64; CABLES]) -> Position {
    Position { lengths_m, counts, zeroed_m: [f64::NAN; CABLES] }
}

/// A request of any verb with these numbers in every field that it may read.
pub fn body(verb: u8, numbers: [f64; 3]) -> RequestBody {
    let mut body = RequestBody {
        verb,
        position_m: numbers,
        distance_m: numbers[1],
        speed_m_s: numbers[1],
        rate: numbers[0],
        cable: numbers[0] as u8,
        cable_count: 3,
        slot_role: numbers[0] as u8,
        slot: numbers[1] as u8,
        ..RequestBody::default()
    };
    body.length_m[..3].copy_from_slice(&numbers);
    body
}

/// One cycle's record.
#[derive(Clone)]
pub struct Step {
    pub input: MotorInput,
    pub sent: DriveCommand,
    pub seen: Observation,
    pub answers: Vec<Answer>,
}

pub struct Rig {
    pub core: Core,
    pub inbox: Inbox,
    pub cycle: u64,
    pub period_s: f64,
    pub now_ns: u64,
    /// How long an exchange with the drives takes.
    pub exchange_ns: u64,
    /// True lengths of the cables, m.
    pub length_m: [f64; CABLES],
    pub velocity_m_s: [f64; CABLES],
    /// Offset of the encoder counts.
    pub count_offset: [i64; CABLES],
    /// Lag of the drives, s, and the delay before it, cycles.
    pub lag_s: f64,
    pub delay_cycles: usize,
    on_the_way: VecDeque<DriveCommand>,
    /// Drives that receive no command.
    pub deaf: [bool; CABLES],
    unheard_s: [f64; CABLES],
    target_m_s: [f64; CABLES],
    /// Encoders that are stuck.
    pub dead: [bool; CABLES],
    pub unit: [u8; UNITS],
    pub status: [u32; UNITS],
    pub supply_v: f64,
    /// Slow values that are new in each cycle.
    pub slow: u8,
    /// Units that were running before.
    pub alive: [u8; UNITS],
    pub duty: [f64; CABLES],
    pub current_a: [f64; CABLES],
    pub tension_n: [f64; CABLES],
    /// Answer of the controller; `None`: it is dead.
    pub controller: Option<[f64; CABLES]>,
    /// Answer of a second controller, in slot b.
    pub second: Option<[f64; CABLES]>,
    pub estimate_valid: bool,
    /// The estimator runs although the controller is dead.
    pub estimator_alone: bool,
    /// Segment that the controller names; `None`: the planner's.
    pub segment: Option<u32>,
    pub incarnation: u32,
    pub motion: PlanMotion,
    pub planner: bool,
    pub supervisor: Option<u64>,
    /// Time that each slot of the chain, and motor-io, has waited for a processor, ns; 0: unknown.
    pub chain_delay_ns: [u64; messages::ROLE_SLOTS],
    pub run_delay_ns: u64,
    pub last: Option<Step>,
}

impl Default for Rig {
    fn default() -> Self {
        Self::new(config())
    }
}

impl Rig {
    pub fn new(config: CoreConfig) -> Self {
        let period_s = config.period_s;
        Self {
            inbox: Inbox::new(config.cable_count(), config.unit_count),
            core: Core::new(config),
            cycle: 0,
            period_s,
            now_ns: 1_000_000_000,
            exchange_ns: (0.4 * period_s * 1e9).round() as u64,
            length_m: [5.0; CABLES],
            velocity_m_s: [0.0; CABLES],
            count_offset: [0; CABLES],
            lag_s: 0.04,
            delay_cycles: 0,
            on_the_way: VecDeque::new(),
            deaf: [false; CABLES],
            unheard_s: [0.0; CABLES],
            target_m_s: [0.0; CABLES],
            dead: [false; CABLES],
            unit: [MotorInput::UNIT_OK; UNITS],
            status: [0; UNITS],
            supply_v: 12.0,
            slow: MotorInput::SLOW_ALL,
            alive: [0; UNITS],
            duty: [0.1; CABLES],
            current_a: [0.5; CABLES],
            tension_n: [10.0; CABLES],
            controller: Some([0.0; CABLES]),
            second: None,
            estimate_valid: true,
            estimator_alone: true,
            segment: None,
            incarnation: 7,
            motion: PlanMotion::default(),
            planner: true,
            supervisor: Some(1),
            chain_delay_ns: [1; messages::ROLE_SLOTS],
            run_delay_ns: 1,
            last: None,
        }
    }

    pub fn seen(&self) -> &Observation {
        &self.last.as_ref().unwrap().seen
    }

    pub fn mode(&self) -> u8 {
        self.seen().authority.mode
    }

    pub fn faults(&self) -> u32 {
        self.seen().authority.faults
    }

    /// Answers of the controllers and the estimator to the last cycle.
    fn answer(&mut self) {
        for (slot, answer) in [self.controller, self.second].into_iter().enumerate() {
            let (Some(velocity), Some(last)) = (answer, &self.last) else { continue };
            let mut command = MotorCommand {
                based_on_cycle: self.cycle - 1,
                epoch: last.seen.authority.epoch,
                incarnation: self.incarnation + slot as u32,
                segment: self.segment.unwrap_or(self.motion.current.id),
                ttl_cycles: 10,
                valid: [u8::from(self.estimate_valid), 0],
                ..MotorCommand::default()
            };
            command.header.oldest_input_ns = last.seen.state.header.oldest_input_ns;
            command.velocity_m_s[..CABLES].copy_from_slice(&velocity);
            self.inbox.command(slot, &command);
        }
        if self.last.is_some() && (self.controller.is_some() || self.estimator_alone) {
            let mut estimate = NodeEstimate {
                valid: u8::from(self.estimate_valid),
                tension_n: self.tension_n,
                incarnation: 3,
                ..NodeEstimate::default()
            };
            estimate.header.cycle = self.cycle - 1;
            self.inbox.estimate(0, &estimate);
        }
    }

    /// One cycle, `late_ns` after it was due and `gap_ns` longer than a period after the last.
    pub fn step_after(&mut self, gap_ns: i64, late_ns: u64) -> &Step {
        self.cycle += 1;
        self.now_ns = self.now_ns.saturating_add_signed((self.period_s * 1e9) as i64 + gap_ns);
        if self.planner {
            self.motion.beat += 1;
            self.inbox.motion(&self.motion, self.core.motion());
        }
        if let Some(beat) = &mut self.supervisor {
            *beat += 1;
            self.inbox.supervisor(*beat);
        }
        self.answer();
        self.inbox.judge_at(self.core.plan_time_s());
        let input = self.inbox.begin(self.cycle, self.now_ns - late_ns, self.now_ns);
        (input.chain_delay_ns, input.run_delay_ns) = (self.chain_delay_ns, self.run_delay_ns);
        let sent = self.core.decide(input);
        let answers = self.core.answers().to_vec();
        self.on_the_way.push_back(sent);
        let heard = if self.on_the_way.len() > self.delay_cycles { self.on_the_way.pop_front() } else { None };
        let passed_s = self.period_s + gap_ns as f64 * 1e-9;
        for i in 0..3 {
            self.unheard_s[i] += passed_s;
            // While the computer stood still, the drives followed the last command.
            let moved_s = passed_s.min((WATCHDOG_S - self.unheard_s[i] + passed_s).max(self.period_s));
            if let Some(heard) = heard.filter(|_| !self.deaf[i]) {
                self.target_m_s[i] = if heard.released[i] { 0.0 } else { heard.speed_m_s[i] };
                self.unheard_s[i] = 0.0;
            } else if self.unheard_s[i] > WATCHDOG_S {
                self.target_m_s[i] = 0.0;
            }
            self.velocity_m_s[i] += (self.target_m_s[i] - self.velocity_m_s[i]) * self.period_s / self.lag_s;
            self.length_m[i] += self.velocity_m_s[i] * moved_s;
            if !self.dead[i] {
                input.counts[i] = (self.length_m[i] * COUNTS_PER_M[i]).round() as i64 + self.count_offset[i];
            }
            input.sampled_ns[i] = self.now_ns + self.exchange_ns.min(4_000_000) / 4 * (i as u64 + 1);
            input.current_a[i] = self.current_a[i];
            input.duty[i] = self.duty[i];
        }
        for unit in 0..2 {
            input.unit[unit] = self.unit[unit];
            input.slow_fresh[unit] = if self.unit[unit] == MotorInput::UNIT_OK { self.slow } else { 0 };
            input.unit_alive[unit] = self.alive[unit];
            input.supply_v[unit] = self.supply_v;
            input.status[unit] = self.status[unit];
        }
        input.end_ns = self.now_ns + self.exchange_ns;
        let seen = self.core.observe(input);
        let input = *input;
        self.inbox.finish();
        self.last.insert(Step { input, sent, seen, answers })
    }

    pub fn step(&mut self) -> &Step {
        self.step_after(0, 50_000)
    }

    pub fn steps(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.step();
        }
    }

    /// Steps until `wanted`; panics after `most` cycles.
    pub fn until(&mut self, most: u32, wanted: impl Fn(&Rig) -> bool) -> u32 {
        for cycle in 0..most {
            if wanted(self) {
                return cycle;
            }
            self.step();
        }
        let authority = &self.last.as_ref().unwrap().seen.authority;
        panic!("not within {most} cycles; mode {}, faults {:#x}", authority.mode, authority.faults);
    }

    pub fn ask(&mut self, request: Request) -> (bool, String) {
        self.ask_body(&request.body())
    }

    pub fn ask_body(&mut self, body: &RequestBody) -> (bool, String) {
        let answer = self.answer_to(body);
        (answer.is_accepted(), answer.sentence().to_string())
    }

    /// The reason of the answer to a request.
    pub fn reason(&mut self, request: Request) -> Reason {
        self.answer_to(&request.body()).reason
    }

    fn answer_to(&mut self, body: &RequestBody) -> Answer {
        assert!(self.inbox.request(self.cycle + 100, body));
        self.step().answers[0]
    }

    pub fn demand(&mut self, request: Request) {
        let (accepted, sentence) = self.ask(request);
        assert!(accepted, "{sentence}");
    }

    /// Armed, position known, holding.
    pub fn ready(mut self) -> Self {
        self.steps(3);
        self.demand(lengths([5.0; 3]));
        self.demand(Request::Arm);
        self
    }

    /// A motion from now on, of so many seconds.
    pub fn offer(&mut self, seconds: f64) {
        let authority = self.seen().authority;
        self.motion.motion += 1;
        self.motion.epoch = authority.epoch;
        self.motion.current = PlanSegment {
            id: self.motion.current.id + 1,
            kind: PlanSegment::KIND_LINE,
            start_s: authority.plan_time_s,
            duration_s: seconds,
            ..PlanSegment::default()
        };
        self.motion.end_s = authority.plan_time_s + seconds;
    }

    /// A straight move from rest to rest, from now on.
    pub fn offer_line(&mut self, from: Vector3<f64>, to: Vector3<f64>, speed_m_s: f64) {
        let authority = self.seen().authority;
        let path = Path::line(from, to);
        let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(speed_m_s, 0.3)).unwrap();
        let id = u64::from(self.motion.current.id) + 1;
        let segment = Segment { id, path, profile, start_s: authority.plan_time_s };
        self.motion.motion += 1;
        self.motion.epoch = authority.epoch;
        self.motion.current = segment_message(&segment);
        self.motion.end_s = segment.end_s();
    }

    /// Following a long motion at these velocities.
    pub fn following(velocity: [f64; 3]) -> Self {
        Self::following_with(config(), velocity)
    }

    /// The same of a robot with this configuration.
    pub fn following_with(config: CoreConfig, velocity: [f64; 3]) -> Self {
        let second = config.cycles(1.0);
        let mut rig = Self::new(config).ready();
        rig.offer(1000.0);
        let mut all = [0.0; CABLES];
        all[..3].copy_from_slice(&velocity);
        rig.controller = Some(all);
        rig.until(10, |rig| rig.mode() == messages::MotorAuthority::MODE_FOLLOWING);
        rig.steps(second);
        assert_eq!(rig.seen().authority.plan_rate, 1.0);
        rig
    }
}

/// Speed of the fastest cable as commanded, m/s.
pub fn speed(rig: &Rig) -> f64 {
    rig.last.as_ref().unwrap().sent.speed_m_s.iter().fold(0.0, |most: f64, v| most.max(v.abs()))
}
