//! The whole control chain against the plant, one cycle after the other, without processes and without a clock: much
//! faster than real time, and the same bits every time.
#![forbid(unsafe_code)]

mod lives;
mod slots;

pub use slots::{Said, Slots};

use anyhow::{Context, Result, ensure};
use cable_robot::{CableVec, Distribution, Robot, Vector3};
use config::{ControllerSection, EstimatorSection, PlannerSection, SystemFile};
use controller::{Controller, ControllerConfig, Law, Notice};
use estimator::{Estimator, EstimatorConfig, Method};
use messages::{
    CABLES, ControlStatus, Energy, Header, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState,
    NodeEstimate, OperatorRequest, PlanMotion, PlanStatus, UNITS,
};
use motor_io::setpoint::Setpoints;
use motor_io::{Answer, Core, CoreConfig};
use planner::{Mission, Planner, PlannerConfig};
use plant::{MotorInput as DriveInput, Plant, PlantConfig};
use segments::motion_of;

/// Time from a tick until a drive unit has answered, ns: two units at 230400 baud, 37 bytes out and 39 bytes back each.
const ANSWER_NS: u64 = 2_000_000;

/// The planner runs once in so many cycles.
const PLANNER_CYCLES: u64 = 10;

/// One flight: the robot as the software believes it to be, the plant as it is, and what is flown.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The robot file's robot.
    pub robot: Robot,
    /// The plant.
    pub plant: PlantConfig,
    /// What is flown.
    pub mission: Mission,
    /// Control period, s.
    pub period_s: f64,
    /// The control law.
    pub law: Law,
    /// Δ of the law, cycles.
    pub horizon: u32,
    /// How the estimator works.
    pub method: Method,
    /// Whether estimator, controller and zeroing correct for stretch.
    pub stretch: bool,
    /// How tensions are chosen.
    pub distribution: Distribution,
    /// Longest flight, s.
    pub longest_s: f64,
}

/// Distances over the moving cycles, m.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Deviation {
    /// Root mean square.
    pub rms_m: f64,
    /// Largest.
    pub max_m: f64,
}

/// How a flight went.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// Cycles in which the setpoint moved.
    pub moving_cycles: u64,
    /// All cycles.
    pub cycles: u64,
    /// Estimate against setpoint.
    pub estimate: Deviation,
    /// Truth against setpoint.
    pub truth: Deviation,
    /// Truth against estimate.
    pub between: Deviation,
    /// True velocity against the estimated one, RMS, m/s.
    pub velocity_rms_m_s: f64,
    /// True tension less chosen one, N: largest over cables and moving cycles, and RMS.
    pub tension_max_n: f64,
    /// See `tension_max_n`.
    pub tension_rms_n: f64,
    /// Largest tension error as a share of what is allowed: 15 % of the chosen tension or 2 N, whichever is more.
    pub tension_share: f64,
    /// Lowest and highest true tension, N.
    pub tension_range_n: [f64; 2],
    /// Cycles in which a line was slack by truth.
    pub slack_cycles: u64,
    /// Periods of the mission that were not steered by a fresh command.
    pub unsteered: u64,
    /// Largest saturation of the cable speeds.
    pub saturation: f64,
    /// Where the truth ended, m, and the setpoint.
    pub end_m: [[f64; 3]; 2],
    /// Last state of the planner.
    pub state: u8,
}

/// Sums up distances.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    squares: f64,
    max: f64,
    count: u64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.squares += value * value;
        self.max = self.max.max(value.abs());
        self.count += 1;
    }

    fn rms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares / self.count as f64).sqrt() }
    }

    fn deviation(&self) -> Deviation {
        Deviation { rms_m: self.rms(), max_m: self.max }
    }
}

/// Everything a cycle produced, for those who look closer.
#[derive(Debug, Clone, Copy)]
pub struct Cycle {
    /// What motor-io decided on.
    pub input: MotorInput,
    /// Encoders and drives.
    pub state: MotorState,
    /// Mode and plan clock.
    pub authority: MotorAuthority,
    /// How far each slot is trusted.
    pub slots: MotorSlots,
    /// Power and loss as motor-io integrates them.
    pub energy: Energy,
    /// Estimate; with two estimators that of the slot in use.
    pub estimate: NodeEstimate,
    /// Command; with two controllers that of the slot in use.
    pub command: MotorCommand,
    /// That controller's account.
    pub control: ControlStatus,
    /// What motor-io's mode and arbiter asked for, before its limits, m/s.
    pub asked_m_s: [f64; CABLES],
    /// What was sent to the drives, m/s.
    pub sent_m_s: [f64; CABLES],
    /// Motion.
    pub motion: PlanMotion,
    /// The planner's account.
    pub plan: PlanStatus,
    /// True position at the instant of the estimate, m.
    pub truth_m: [f64; 3],
    /// True velocity then, m/s.
    pub truth_m_s: [f64; 3],
    /// True tensions then, N.
    pub truth_n: CableVec,
}

/// The deciding parts of the processes of the control chain, fresh.
pub struct Chain {
    /// Of motor-io.
    pub core: Core,
    /// Of the estimator.
    pub estimator: Estimator,
    /// Of the controller.
    pub controller: Controller,
    /// Of the planner.
    pub planner: Planner,
}

/// The robot as the chain takes it.
fn believed(scenario: &Scenario) -> Robot {
    if scenario.stretch { scenario.robot } else { scenario.robot.with_rigid_lines() }
}

/// The configuration of motor-io's deciding part.
///
/// # Errors
/// Encoders, units or limits that cannot be.
pub fn core_config(scenario: &Scenario) -> Result<CoreConfig> {
    let robot = believed(scenario);
    let counts_per_m: Vec<f64> = scenario.plant.idlers.iter().map(|idler| idler.counts_per_m).collect();
    let units: Vec<Vec<usize>> =
        (0..robot.cable_count()).collect::<Vec<_>>().chunks(2).map(<[usize]>::to_vec).collect();
    let mut core = CoreConfig::new(robot, scenario.period_s, &counts_per_m, &units)?;
    core.distribution = scenario.distribution;
    Ok(core)
}

impl Chain {
    /// As the scenario says, everything else as the configuration files have it by default.
    pub fn new(scenario: &Scenario) -> Result<Self> {
        let robot = believed(scenario);
        let core = core_config(scenario)?;
        let section = ControllerSection::default();
        let controller = ControllerConfig {
            robot,
            law: scenario.law,
            horizon: scenario.horizon,
            distribution: scenario.distribution,
            redundant_s: section.redundant_s,
            cable_speed_limit_m_s: robot.cable_speed_limit_m_s(),
            error_limit_m: section.error_limit_m,
            ttl_cycles: core.ttl_cycles,
            estimate_ttl_cycles: EstimatorSection::default().ttl_cycles,
            thread: 0,
            incarnation: 2,
        };
        let PlannerSection { speed_m_s, acceleration_m_s2, check_step_m, .. } = PlannerSection::default();
        let distribution = scenario.distribution;
        Ok(Self {
            core: Core::new(core),
            estimator: Estimator::new(&EstimatorConfig {
                robot,
                method: scenario.method,
                sigma_length_m: EstimatorSection::default().sigma_length_m,
                incarnation: 1,
                thread: 0,
            }),
            controller: Controller::new(controller),
            planner: Planner::new(PlannerConfig {
                robot: scenario.robot,
                distribution,
                speed_m_s,
                acceleration_m_s2,
                check_step_m,
            }),
        })
    }
}

impl Chain {
    /// As a system file says, word for word what the processes would be made from.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn of(file: &SystemFile) -> Result<Self> {
        let robot = file.robot_file()?;
        Ok(Self {
            core: Core::new(CoreConfig::from_files(file, &robot)?),
            estimator: Estimator::new(&EstimatorConfig::of(&file.estimator, robot.robot()?, 1)?),
            controller: Controller::new(ControllerConfig::of(file, &robot, 2)?),
            planner: Planner::new(PlannerConfig::of(file, robot.robot()?)),
        })
    }
}

/// What a life of motor-io begins with.
#[derive(Debug, Clone, Copy)]
struct Beginning {
    epoch: u32,
    restored: Option<([f64; CABLES], [i64; CABLES])>,
    /// The drives were running all the time.
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
    beginning: Beginning,
    /// Time since motor-io died, s.
    dead_s: Option<f64>,
    /// What the drives were told last.
    drives: [DriveInput; CABLES],
    /// Count of the supervisor's beats, and whether it lives; 0 without one.
    supervisor: (u64, bool),
    requests: Vec<(u8, [f64; 8])>,
    authority: Option<MotorAuthority>,
    estimate: Option<NodeEstimate>,
    motion: PlanMotion,
    plan: PlanStatus,
}

impl Lockstep {
    /// Sets everything up, the node hanging at the plant's start, disarmed, position unknown.
    pub fn new(scenario: Scenario) -> Result<Self> {
        let chain = Chain::new(&scenario)?;
        Self::with(scenario, chain)
    }

    /// The same with a chain that may be made otherwise; of the scenario the plant and the period count.
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
            beginning: Beginning { epoch: 1, restored: None, alive: false },
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

    /// The plant, to break something on purpose.
    pub fn plant_mut(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// What a controller has to say since the last call.
    pub fn notice(&mut self) -> Option<Notice> {
        self.slots.controllers.iter_mut().flatten().find_map(Controller::notice)
    }

    /// Controllers and estimators.
    pub fn slots(&self) -> &Slots {
        &self.slots
    }

    /// Controllers and estimators, to start and to kill.
    pub fn slots_mut(&mut self) -> &mut Slots {
        &mut self.slots
    }

    /// The whole of it once more, to try something from here; `None` with a law of one's own.
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
    pub fn request(&mut self, verb: u8, args: [f64; 8]) {
        self.requests.push((verb, args));
    }

    /// The planner's pass, if it lives.
    fn plan(&mut self) {
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

    /// Tells motor-io where the node is (where it really is), and arms.
    pub fn zero_and_arm(&mut self) -> Result<()> {
        self.cycle()?;
        let [x, y, z] = self.plant.position_m();
        self.request(OperatorRequest::VERB_ZERO_AT, [x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0]);
        self.cycle()?;
        self.request(OperatorRequest::VERB_ARM, [0.0; 8]);
        for _ in 0..50 {
            self.cycle()?;
        }
        let mode = self.authority.map_or(0, |authority| authority.mode);
        ensure!(mode == MotorAuthority::MODE_HOLDING, "the robot is in mode {mode} after arming");
        Ok(())
    }

    /// Offers a mission to the planner, which publishes it at once.
    pub fn run(&mut self, mission: &Mission) -> Result<String> {
        let seen = planner::Inputs {
            now_ns: self.plant.time_ns(),
            authority: self.authority.as_ref(),
            estimate: self.estimate.as_ref(),
            map: None,
        };
        let sentence = self.planner.run(mission, &seen)?;
        (self.motion, self.plan) = self.planner.step(&seen);
        Ok(sentence)
    }

    /// The planner, as it is.
    pub fn planner(&self) -> &Planner {
        &self.planner
    }

    /// Answers to the requests of the last cycle.
    pub fn answers(&self) -> &[Answer] {
        self.core.answers()
    }

    /// What has arrived when cycle `cycle` begins.
    fn arrivals(&mut self, cycle: u64, tick_ns: u64) -> MotorInput {
        let Beginning { epoch, restored, alive } = self.beginning;
        let mut input = MotorInput { tick_ns, begin_ns: tick_ns, first_epoch: epoch, ..MotorInput::default() };
        input.header = Header { life: self.life, cycle, seq: cycle, ..Header::at(tick_ns) };
        if let Some((lengths_m, counts)) = restored {
            (input.restored, input.restored_m, input.restored_counts) = (1, lengths_m, counts);
        }
        input.unit_alive = [u8::from(alive); UNITS];
        input.supervisor_beat = self.beat();
        input.planner_beat = self.motion.beat;
        for (i, (verb, args)) in self.requests.drain(..self.requests.len().min(4)).enumerate() {
            input.request_id[i] = cycle;
            input.request_verb[i] = verb;
            input.request_args[8 * i..8 * i + 8].copy_from_slice(&args);
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
        self.setpoints.take(&self.motion, self.core.motion());
        self.setpoints.write(self.core.plan_time_s(), &mut input);
        self.slots.arrive(&mut input);
        input
    }

    /// One cycle.
    pub fn cycle(&mut self) -> Result<Cycle> {
        let n = self.plant.cable_count();
        ensure!(self.dead_s.is_none(), "motor-io does not live");
        self.cycle += 1;
        let cycle = self.cycle;
        let tick_ns = self.plant.time_ns();
        let period_ns = (self.scenario.period_s * 1e9).round() as u64;
        let mut input = self.arrivals(cycle, tick_ns);
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
        self.estimate = self.slots.blended(&authority);
        self.authority = Some(authority);
        if cycle.is_multiple_of(PLANNER_CYCLES) {
            self.plan();
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

/// Flies the whole scenario with a chain made from what the scenario's would be.
pub fn fly_with(scenario: Scenario, change: impl FnOnce(Chain) -> Chain) -> Result<Flight> {
    let mission = scenario.mission.clone();
    let longest = (scenario.longest_s / scenario.period_s) as u64;
    let chain = change(Chain::new(&scenario)?);
    let mut lockstep = Lockstep::with(scenario, chain)?;
    lockstep.zero_and_arm()?;
    lockstep.run(&mission).context("the planner refused the mission")?;
    let [mut estimate, mut truth, mut between, mut velocity, mut tension] = [Sum::default(); 5];
    let (mut share, mut low, mut high, mut slack, mut saturation) = (0.0f64, f64::INFINITY, 0.0f64, 0, 0.0f64);
    let mut last = None;
    for cycles in 1..=longest {
        let cycle = lockstep.cycle()?;
        let Cycle { authority, .. } = &cycle;
        // Evaluated here anew, at the instant at which the truth was sampled.
        let since_s = (cycle.state.header.stamp_ns - cycle.input.begin_ns) as f64 * 1e-9;
        let time_s = authority.plan_time_s + authority.plan_rate * since_s;
        let moving = motion_of(&cycle.motion).map(|motion| motion.setpoint(time_s));
        if let Some(setpoint) = moving
            && authority.mode == MotorAuthority::MODE_FOLLOWING
            && !setpoint.at_rest
        {
            ensure!(cycle.estimate.valid == 1, "the estimate of cycle {} is not valid", authority.header.cycle);
            let (is, seems) = (Vector3::from(cycle.truth_m), Vector3::from(cycle.estimate.position_m));
            estimate.add((seems - setpoint.position).norm());
            truth.add((is - setpoint.position).norm());
            between.add((is - seems).norm());
            velocity.add((Vector3::from(cycle.truth_m_s) - Vector3::from(cycle.estimate.velocity_m_s)).norm());
            saturation = saturation.max(cycle.control.saturation);
            for (actual, chosen) in cycle.truth_n.iter().zip(&cycle.control.tension_n) {
                let error = actual - chosen;
                tension.add(error);
                share = share.max(error.abs() / (0.15 * chosen).max(2.0));
                low = low.min(*actual);
                high = high.max(*actual);
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
