//! The whole control chain against the plant, one cycle after the other, without processes and without a clock: much
//! faster than real time and the same bits every time.

use anyhow::{Context, Result, ensure};
use cable_robot::{CableVec, Distribution, Robot, Vector3, elastic};
use controller::{Controller, ControllerConfig, Law};
use estimator::{Estimator, EstimatorConfig};
use messages::{ControlStatus, Header, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion, PlanStatus};
use plant::{MotorInput, Plant, PlantConfig};
use planner::{Mission, Planner, PlannerConfig};
use service::motion::motion_of;

/// Time from a tick until a drive unit has answered, ns: two units at 230400 baud, 37 bytes out and 39 bytes back each.
const ANSWER_NS: u64 = 2_000_000;

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
    /// Δ of the law, cycles.
    pub horizon: u32,
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
    /// Cycles without a valid command.
    pub missed: u64,
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
    /// Encoders and drives.
    pub state: MotorState,
    /// Mode and plan clock.
    pub authority: MotorAuthority,
    /// Estimate.
    pub estimate: NodeEstimate,
    /// Command.
    pub command: MotorCommand,
    /// The controller's account.
    pub control: ControlStatus,
    /// Motion.
    pub motion: PlanMotion,
    /// The planner's account.
    pub plan: PlanStatus,
    /// True position at the tick, m.
    pub truth_m: [f64; 3],
    /// True tensions at the tick, N.
    pub truth_n: CableVec,
}

/// The chain and the plant.
pub struct Lockstep {
    scenario: Scenario,
    plant: Plant,
    estimator: Estimator,
    controller: Controller,
    planner: Planner,
    zero_m: CableVec,
    zero_counts: [i64; 8],
    authority: MotorAuthority,
    command: MotorCommand,
    motion: PlanMotion,
    missed: u64,
    estimate: Option<NodeEstimate>,
}

impl Lockstep {
    /// Sets everything up, the node hanging at the plant's start.
    pub fn new(scenario: Scenario) -> Result<Self> {
        let robot = if scenario.stretch { scenario.robot } else { scenario.robot.with_rigid_lines() };
        let plant = Plant::new(scenario.plant.clone())?;
        let start = Vector3::from(scenario.plant.start_m);
        let zero = elastic::realise(&robot, &start, &Vector3::zeros(), scenario.distribution)?;
        let mut zero_counts = [0; 8];
        for (i, counts) in zero_counts.iter_mut().enumerate().take(robot.cable_count()) {
            *counts = plant.counts(i);
        }
        let estimator = Estimator::new(&EstimatorConfig {
            robot,
            eta: 50,
            ridge: 1e-4,
            prior: [0.6, 0.4],
            sigma_length_m: 0.001,
            incarnation: 1,
        });
        let controller = Controller::new(ControllerConfig {
            robot,
            law: Law::LqEndpoint { state_weight: 0.0, input_weight: 1.0 },
            horizon: scenario.horizon,
            distribution: scenario.distribution,
            redundant_s: 0.3,
            cable_speed_limit_m_s: 2.0 * robot.speed_limit_m_s(),
            error_limit_m: 0.25,
            ttl_cycles: 3,
            incarnation: 2,
        });
        let planner = Planner::new(PlannerConfig {
            robot: scenario.robot,
            distribution: scenario.distribution,
            speed_m_s: 0.2,
            acceleration_m_s2: 0.3,
            check_step_m: 0.02,
        });
        let authority = MotorAuthority {
            period_s: scenario.period_s,
            epoch: 1,
            mode: MotorAuthority::MODE_HOLDING,
            position_known: MotorState::POSITION_KNOWN,
            cable_count: robot.cable_count() as u8,
            ..MotorAuthority::default()
        };
        Ok(Self {
            scenario,
            plant,
            estimator,
            controller,
            planner,
            zero_m: zero.unstretched_m,
            zero_counts,
            authority,
            command: MotorCommand::default(),
            motion: PlanMotion::default(),
            missed: 0,
            estimate: None,
        })
    }

    fn now_ns(&self) -> u64 {
        self.plant.time_ns()
    }

    /// Offers the mission to the planner.
    pub fn run(&mut self, mission: &Mission) -> Result<String> {
        let seen = planner::Seen {
            now_ns: self.now_ns(),
            authority: Some(&self.authority),
            estimate: self.estimate.as_ref(),
        };
        Ok(self.planner.run(mission, &seen)?)
    }

    /// One cycle.
    pub fn cycle(&mut self) -> Result<Cycle> {
        let n = self.plant.cable_count();
        let cycle = self.authority.header.cycle + 1;
        let tick_ns = self.now_ns();
        let period_ns = (self.scenario.period_s * 1e9).round() as u64;
        // Plan clock and mode, as motor-io keeps them.
        let follow = self.authority.mode == MotorAuthority::MODE_FOLLOWING;
        let accepted = self.command.based_on_cycle + 1 == cycle
            && self.command.valid[0] == 1
            && self.command.epoch == self.authority.epoch;
        if follow && !accepted {
            self.missed += 1;
        }
        if follow {
            let rate = &mut self.authority.plan_rate;
            *rate = (*rate + self.scenario.period_s / 0.5).min(1.0);
            self.authority.plan_time_s += *rate * self.scenario.period_s;
            if self.authority.plan_time_s >= self.motion.end_s + 0.5 {
                self.authority.mode = MotorAuthority::MODE_HOLDING;
                self.authority.plan_rate = 0.0;
            }
        } else if self.motion.motion > self.authority.motion
            && accepted
            && self.command.segment == self.motion.current.id
        {
            self.authority.mode = MotorAuthority::MODE_FOLLOWING;
            self.authority.motion = self.motion.motion;
            self.authority.plan_rate_target = 1.0;
        }
        let follow = self.authority.mode == MotorAuthority::MODE_FOLLOWING;
        let mut sent = [0.0; 8];
        if follow {
            sent[..n].copy_from_slice(&self.command.velocity_m_s[..n]);
        }
        let inputs: Vec<MotorInput> = sent[..n].iter().enumerate().map(|(i, v)| self.plant.speed_input(i, *v)).collect();
        let truth_m = self.plant.position_m();
        let truth_n = CableVec::from_slice(&self.plant.tensions_n())?;
        let header = Header { cycle, seq: cycle, stamp_ns: tick_ns, oldest_input_ns: tick_ns };
        let mut state = MotorState {
            header,
            command_m_s: sent,
            cable_count: n as u8,
            position_known: MotorState::POSITION_KNOWN,
            ..MotorState::default()
        };
        for unit in 0..n.div_ceil(2) {
            self.plant.step(ANSWER_NS as f64 * 1e-9, &inputs)?;
            for cable in 2 * unit..n.min(2 * unit + 2) {
                let counts = self.plant.counts(cable) - self.zero_counts[cable];
                state.counts[cable] = counts;
                state.length_m[cable] = self.zero_m[cable] + counts as f64 / self.plant.config().idlers[cable].counts_per_m;
                state.sampled_ns[cable] = self.now_ns();
                state.fresh[cable] = 1;
            }
        }
        self.authority.header = header;
        let estimate = self.estimator.step(&state, Some(&self.authority));
        self.estimate = Some(estimate);
        let seen = planner::Seen {
            now_ns: self.now_ns(),
            authority: Some(&self.authority),
            estimate: self.estimate.as_ref(),
        };
        let mut plan = PlanStatus::default();
        if cycle % 10 == 0 {
            (self.motion, plan) = self.planner.step(&seen);
        }
        let (command, control) = self.controller.step(&controller::Seen {
            estimates: [Some(&estimate), None],
            motion: Some(&self.motion),
            authority: Some(&self.authority),
        });
        self.command = command;
        let rest_ns = tick_ns + period_ns - self.now_ns();
        self.plant.step(rest_ns as f64 * 1e-9, &inputs)?;
        let authority = self.authority;
        Ok(Cycle { state, authority, estimate, command, control, motion: self.motion, plan, truth_m, truth_n })
    }
}

/// Flies the whole scenario.
pub fn fly(scenario: Scenario) -> Result<Flight> {
    let mission = scenario.mission.clone();
    let longest = (scenario.longest_s / scenario.period_s) as u64;
    let mut lockstep = Lockstep::new(scenario)?;
    for _ in 0..50 {
        lockstep.cycle()?;
    }
    lockstep.run(&mission).context("the planner refused the mission")?;
    let [mut estimate, mut truth, mut between, mut tension] = [Sum::default(); 4];
    let (mut share, mut low, mut high, mut slack, mut saturation) = (0.0f64, f64::INFINITY, 0.0f64, 0, 0.0f64);
    let mut last = None;
    let mut state = 0;
    for cycles in 1..=longest {
        let cycle = lockstep.cycle()?;
        if cycle.plan.header.stamp_ns != 0 {
            state = cycle.plan.state;
        }
        let moving = motion_of(&cycle.motion).map(|motion| motion.setpoint(cycle.authority.plan_time_s));
        if let Some(setpoint) = moving
            && cycle.authority.mode == MotorAuthority::MODE_FOLLOWING
            && !setpoint.at_rest
        {
            ensure!(cycle.estimate.valid == 1, "the estimate of cycle {} is not valid", cycle.authority.header.cycle);
            let (is, seems) = (Vector3::from(cycle.truth_m), Vector3::from(cycle.estimate.position_m));
            estimate.add((seems - setpoint.position).norm());
            truth.add((is - setpoint.position).norm());
            between.add((is - seems).norm());
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
        if matches!(state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            return Ok(Flight {
                moving_cycles: estimate.count,
                cycles,
                estimate: estimate.deviation(),
                truth: truth.deviation(),
                between: between.deviation(),
                tension_max_n: tension.max,
                tension_rms_n: tension.rms(),
                tension_share: share,
                tension_range_n: [low, high],
                slack_cycles: slack,
                missed: lockstep.missed,
                saturation,
                end_m: last.context("nothing moved")?,
                state,
            });
        }
    }
    anyhow::bail!("the mission did not end within {} s", longest as f64 * lockstep.scenario.period_s)
}
