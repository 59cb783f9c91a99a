//! The complete control chain with the plant, cycle by cycle in one thread, without processes and without a clock: much
//! faster than real time, with the same bits in every run.
#![forbid(unsafe_code)]

mod chain;
mod flight;
mod lives;
mod slots;

pub use chain::{Chain, core_config};
pub use flight::{Cycle, Deviation, Flight, Scenario};
pub use slots::{ControllerOutput, Slots};

use anyhow::{Context, Result, ensure};
use cable_robot::{CableVec, Vector3};
use controller::{Controller, Notice};
use messages::{CABLES, Header, MotorAuthority, MotorInput, NodeEstimate, PlanMotion, PlanStatus, Request, UNITS};
use motor_io::{Answer, Core, Setpoints};
use planner::{Mission, Planner};
use plant::{MotorInput as DriveInput, Plant};
use robot_state::Reason;
use segments::motion_of;

use crate::flight::Sum;

// Lengths of the same arrays.
const _: () = assert!(plant::MAX_CABLES == messages::CABLES);

/// Time from the start of a cycle to the answer of a drive unit, ns: two units at 230400 baud, 37 bytes out and
/// 39 bytes back each.
const ANSWER_NS: u64 = 2_000_000;

/// Number of cycles per step of the planner.
const PLANNER_CYCLES: u64 = 10;

/// Initial state of a life of motor-io.
#[derive(Debug, Clone, Copy)]
struct LifeStart {
    epoch: u32,
    restored: Option<([f64; CABLES], [i64; CABLES])>,
    /// Whether the drives were powered without interruption.
    alive: bool,
}

/// The chain and the plant.
pub struct Lockstep {
    scenario: Scenario,
    plant: Plant,
    core: Core,
    slots: Slots,
    planner: Planner,
    setpoints: Setpoints,
    planner_lives: bool,
    life: u64,
    cycle: u64,
    beginning: LifeStart,
    /// Time since the death of motor-io, s.
    dead_s: Option<f64>,
    /// Last commands of the drives.
    drives: [DriveInput; CABLES],
    /// Count of the supervisor's beats, and whether it is running; 0 without a supervisor.
    supervisor: (u64, bool),
    requests: Vec<Request>,
    authority: Option<MotorAuthority>,
    estimate: Option<NodeEstimate>,
    motion: PlanMotion,
    plan: PlanStatus,
}

impl Lockstep {
    /// Creates chain and plant with the node at rest at the plant's start, disarmed and without a known position.
    pub fn new(scenario: Scenario) -> Result<Self> {
        let chain = Chain::new(&scenario)?;
        Self::with(scenario, chain)
    }

    /// Like [`Lockstep::new`] with another chain; only plant and period of the scenario are used.
    pub fn with(scenario: Scenario, chain: Chain) -> Result<Self> {
        let plant = Plant::new(scenario.plant.clone())?;
        let Chain { core, estimator, controller, planner } = chain;
        Ok(Self {
            scenario,
            plant,
            core,
            slots: Slots::new(estimator, controller),
            planner,
            setpoints: Setpoints::default(),
            planner_lives: true,
            life: 1,
            cycle: 0,
            beginning: LifeStart { epoch: 1, restored: None, alive: false },
            dead_s: None,
            drives: [DriveInput::RELEASED; CABLES],
            supervisor: (0, false),
            requests: Vec::new(),
            authority: None,
            estimate: None,
            motion: PlanMotion::default(),
            plan: PlanStatus::default(),
        })
    }

    /// The plant.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The plant, to inject faults.
    pub fn plant_mut(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// Next notice of a controller since the last call.
    pub fn notice(&mut self) -> Option<Notice> {
        self.slots.controllers.iter_mut().flatten().find_map(Controller::notice)
    }

    /// Controllers and estimators.
    pub fn slots(&self) -> &Slots {
        &self.slots
    }

    /// Controllers and estimators, to start and kill them.
    pub fn slots_mut(&mut self) -> &mut Slots {
        &mut self.slots
    }

    /// A copy with which to try out a continuation; `None` with a custom law.
    pub fn fork(&self) -> Option<Self> {
        Some(Self {
            scenario: self.scenario.clone(),
            plant: self.plant.clone(),
            core: self.core.clone(),
            slots: self.slots.fork()?,
            planner: self.planner.clone(),
            requests: self.requests.clone(),
            ..*self
        })
    }

    /// Asks motor-io for something in the next cycle (at most four requests per cycle).
    pub fn request(&mut self, request: Request) {
        self.requests.push(request);
    }

    /// Runs a step of the planner, if it is running.
    fn step_planner(&mut self) {
        let seen = planner::Inputs {
            now_ns: self.plant.time_ns(),
            authority: self.authority.as_ref(),
            estimate: self.estimate.as_ref(),
            map: None,
        };
        if self.planner_lives {
            (self.motion, self.plan) = self.planner.step(&seen);
        }
    }

    /// Zeroes motor-io at the true position of the node, and arms.
    pub fn zero_and_arm(&mut self) -> Result<()> {
        self.cycle()?;
        let [x, y, z] = self.plant.position_m();
        self.request(Request::ZeroAt { position_m: [x, y, z] });
        self.cycle()?;
        self.request(Request::Arm);
        for _ in 0..50 {
            self.cycle()?;
        }
        let mode = self.authority.map_or(0, |authority| authority.mode);
        ensure!(mode == MotorAuthority::MODE_HOLDING, "the robot is in mode {mode} after arming");
        Ok(())
    }

    /// Starts a mission in the planner, which publishes it immediately.
    pub fn run(&mut self, mission: &Mission) -> Result<Reason> {
        let seen = planner::Inputs {
            now_ns: self.plant.time_ns(),
            authority: self.authority.as_ref(),
            estimate: self.estimate.as_ref(),
            map: None,
        };
        let reason = self.planner.run(mission, &seen)?;
        (self.motion, self.plan) = self.planner.step(&seen);
        Ok(reason)
    }

    /// The planner.
    pub fn planner(&self) -> &Planner {
        &self.planner
    }

    /// Answers to the requests of the last cycle.
    pub fn answers(&self) -> &[Answer] {
        self.core.answers()
    }

    /// Collects the input that has arrived at the beginning of `cycle`.
    fn collect_input(&mut self, cycle: u64, tick_ns: u64) -> MotorInput {
        let LifeStart { epoch, restored, alive } = self.beginning;
        let mut input = MotorInput { tick_ns, begin_ns: tick_ns, first_epoch: epoch, ..MotorInput::default() };
        input.header = Header { life: self.life, cycle, seq: cycle, ..Header::at(tick_ns) };
        if let Some((lengths_m, counts)) = restored {
            (input.restored, input.restored_m, input.restored_counts) = (1, lengths_m, counts);
        }
        input.unit_alive = [u8::from(alive); UNITS];
        input.supervisor_beat = self.beat();
        input.planner_beat = self.motion.beat;
        for (i, request) in self.requests.drain(..self.requests.len().min(4)).enumerate() {
            input.request_id[i] = cycle;
            input.request[i] = request.body();
        }
        let PlanMotion { current, next, .. } = &self.motion;
        let last = if next.id != 0 { next } else { current };
        input.motion = self.motion.motion;
        input.motion_life = self.motion.header.life;
        input.mission = self.motion.mission;
        input.motion_epoch = self.motion.epoch;
        input.motion_segment = current.id;
        input.motion_start_s = current.start_s;
        input.motion_end_s = self.motion.end_s;
        input.motion_known_s = last.start_s + last.duration_s;
        self.setpoints.update(&self.motion, self.core.motion());
        self.setpoints.write(self.core.plan_time_s(), &mut input);
        self.slots.write_input(&mut input);
        input
    }

    /// Runs one cycle.
    pub fn cycle(&mut self) -> Result<Cycle> {
        let n = self.plant.cable_count();
        ensure!(self.dead_s.is_none(), "motor-io is not running; start it first");
        self.cycle += 1;
        let cycle = self.cycle;
        let tick_ns = self.plant.time_ns();
        let period_ns = (self.scenario.period_s * 1e9).round() as u64;
        let mut input = self.collect_input(cycle, tick_ns);
        let sent = self.core.decide(&input);
        let asked_m_s = *self.core.asked_m_s();
        let mut inputs = [DriveInput::RELEASED; CABLES];
        for (i, drive) in inputs.iter_mut().enumerate().take(n) {
            if !sent.released[i] {
                *drive = self.plant.speed_input(i, sent.speed_m_s[i]);
            }
        }
        self.drives = inputs;
        input.cable_count = n as u8;
        input.unit_count = n.div_ceil(2) as u8;
        for unit in 0..n.div_ceil(2) {
            self.plant.step(ANSWER_NS as f64 * 1e-9, &inputs[..n])?;
            input.unit[unit] = MotorInput::UNIT_OK;
            input.slow_fresh[unit] = MotorInput::SLOW_ALL;
            input.supply_v[unit] = self.plant.voltage_v();
            for cable in 2 * unit..n.min(2 * unit + 2) {
                input.counts[cable] = self.plant.counts(cable);
                input.sampled_ns[cable] = self.plant.time_ns();
                input.current_a[cable] = self.plant.measured_current_a(cable);
                input.duty[cable] = self.plant.duty(cable);
            }
        }
        input.end_ns = self.plant.time_ns();
        let (truth_m, truth_m_s) = (self.plant.position_m(), self.plant.velocity_m_s());
        let truth_n = CableVec::from_slice(&self.plant.tensions_n())?;
        let observed = self.core.observe(&input);
        let (state, authority, energy) = (observed.state, observed.authority, observed.energy);
        self.slots.estimate(&state, &authority);
        self.planner.follow_zero(&state);
        self.estimate = self.slots.blended(&authority);
        self.authority = Some(authority);
        if cycle.is_multiple_of(PLANNER_CYCLES) {
            self.step_planner();
        }
        let (command, control) = self.slots.command(&state, &authority, &self.motion);
        let estimate = self.estimate.unwrap_or_default();
        let rest_ns = tick_ns + period_ns - self.plant.time_ns();
        self.plant.step(rest_ns as f64 * 1e-9, &inputs[..n])?;
        let (motion, plan) = (self.motion, self.plan);
        Ok(Cycle {
            input,
            state,
            authority,
            slots: observed.slots,
            energy,
            estimate,
            command,
            control,
            asked_m_s,
            sent_m_s: sent.speed_m_s,
            motion,
            plan,
            truth_m,
            truth_m_s,
            truth_n,
        })
    }
}

/// Flies the whole scenario.
pub fn fly(scenario: Scenario) -> Result<Flight> {
    fly_with(scenario, |chain| chain)
}

/// Flies the whole scenario with a modified chain.
pub fn fly_with(scenario: Scenario, change: impl FnOnce(Chain) -> Chain) -> Result<Flight> {
    let mission = scenario.mission.clone();
    let longest = (scenario.longest_s / scenario.period_s) as u64;
    let chain = change(Chain::new(&scenario)?);
    let mut lockstep = Lockstep::with(scenario, chain)?;
    lockstep.zero_and_arm()?;
    lockstep.run(&mission).context("the planner rejected the mission")?;
    let [mut estimate, mut truth, mut between, mut stated, mut velocity, mut tension] = [Sum::default(); 6];
    let (mut share, mut low, mut high, mut slack, mut saturation) = (0.0f64, f64::INFINITY, 0.0f64, 0, 0.0f64);
    let (mut last, mut covered) = (None, 0);
    for cycles in 1..=longest {
        let cycle = lockstep.cycle()?;
        let Cycle { authority, .. } = &cycle;
        // Evaluate the setpoint at the time at which the truth was sampled.
        let since_s = (cycle.state.header.stamp_ns - cycle.input.begin_ns) as f64 * 1e-9;
        let time_s = authority.plan_time_s + authority.plan_rate * since_s;
        let moving = motion_of(&cycle.motion).map(|motion| motion.setpoint(time_s));
        if let Some(setpoint) = moving
            && authority.mode == MotorAuthority::MODE_FOLLOWING
            && !setpoint.at_rest
        {
            ensure!(cycle.estimate.valid == 1, "the estimate of cycle {} is not valid", authority.header.cycle);
            let (actual, estimated) = (Vector3::from(cycle.truth_m), Vector3::from(cycle.estimate.position_m));
            estimate.add((estimated - setpoint.position).norm());
            truth.add((actual - setpoint.position).norm());
            between.add((actual - estimated).norm());
            covered += u64::from(cycle.covers_truth());
            stated.add(cycle.stated_m());
            velocity.add((Vector3::from(cycle.truth_m_s) - Vector3::from(cycle.estimate.velocity_m_s)).norm());
            saturation = saturation.max(cycle.control.saturation);
            for (true_n, chosen) in cycle.truth_n.iter().zip(&cycle.control.tension_n) {
                let error = true_n - chosen;
                tension.add(error);
                share = share.max(error.abs() / (0.15 * chosen).max(2.0));
                low = low.min(*true_n);
                high = high.max(*true_n);
            }
            slack += u64::from(cycle.truth_n.iter().any(|t| *t <= 0.0));
            last = Some([cycle.truth_m, setpoint.position.into()]);
        }
        let state = cycle.plan.state;
        if matches!(state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            return Ok(Flight {
                moving_cycles: estimate.count,
                cycles,
                estimate: estimate.deviation(),
                truth: truth.deviation(),
                between: between.deviation(),
                covered: covered as f64 / estimate.count as f64,
                stated: stated.deviation(),
                velocity_rms_m_s: velocity.rms(),
                tension_max_n: tension.max,
                tension_rms_n: tension.rms(),
                tension_share: share,
                tension_range_n: [low, high],
                slack_cycles: slack,
                unsteered: cycle.authority.unsteered(),
                saturation,
                end_m: last.context("nothing moved")?,
                state,
            });
        }
    }
    anyhow::bail!("the mission did not end within {} s", longest as f64 * lockstep.scenario.period_s)
}
