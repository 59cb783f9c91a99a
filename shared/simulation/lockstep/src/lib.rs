//! The complete control chain with the plant, cycle by cycle in one thread, without processes and without a clock: much
//! faster than real time, with the same bits in every run.
#![forbid(unsafe_code)]

mod chain;
mod flight;
mod lives;
mod slots;
mod tally;

pub use chain::{Chain, core_config};
pub use flight::{Cycle, Deviation, Flight, Observed, Scenario};
pub use slots::{ControllerOutput, Slots};

use anyhow::{Context, Result, ensure};
use cable_robot::{CableVec, rate};
use controller::{Controller, Notice};
use messages::{CABLES, Header, MotorAuthority, MotorInput, NodeEstimate, PlanMotion, PlanStatus, Request, UNITS};
use motor_io::{Answer, Core, Position, Setpoints};
use planner::{Mission, Planner};
use plant::{MotorInput as DriveInput, Plant};
use robot_state::Reason;

use crate::tally::Tally;

// Lengths of the same arrays.
const _: () = assert!(plant::MAX_CABLES == messages::CABLES);

/// Time from the question of a drive unit to its answer, ns: two units at 230400 baud, 37 bytes out and 39 bytes back
/// each. Units that need more than the period one after another share it: such a robot has more ports or quicker ones.
const ANSWER_NS: u64 = 2_000_000;

/// Periods below this one have a port for each unit, ns: `nims check` accepts no port with two units above 250 Hz. The
/// units then answer at the same time ..
const APART_BELOW_NS: u64 = 4_000_000;
/// .. after this share of the period, in percent: 0.8 of 2 ms. One of the drive families takes 0.82 ms at 3 Mbaud, of
/// which the 156 bytes of a cycle are 0.52.
const APART_PERCENT: u64 = 40;

/// Time between two steps of the planner, s.
const PLANNER_S: f64 = 0.1;

/// Initial state of a life of motor-io.
#[derive(Debug, Clone, Copy)]
struct LifeStart {
    epoch: u32,
    restored: Option<Position>,
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

    /// Steps the planner in a cycle that is its turn.
    fn step_planner_in_turn(&mut self) {
        if self.cycle.is_multiple_of(rate::cycles(PLANNER_S, self.scenario.period_s).into()) {
            self.step_planner();
        }
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
        self.zero_and_arm_observed(&mut |_| Ok(()))
    }

    /// The same; `observe` sees each cycle after it was computed.
    ///
    /// # Errors
    /// The robot does not hold after arming, or `observe` fails.
    pub fn zero_and_arm_observed(&mut self, observe: &mut impl FnMut(&Observed<'_>) -> Result<()>) -> Result<()> {
        self.observed_cycle(observe)?;
        let position_m = self.plant.position_m();
        self.request(Request::ZeroAt { position_m });
        self.observed_cycle(observe)?;
        self.request(Request::Arm);
        for _ in 0..50 {
            self.observed_cycle(observe)?;
        }
        let mode = self.authority.map_or(0, |authority| authority.mode);
        ensure!(mode == MotorAuthority::MODE_HOLDING, "the robot is in mode {mode} after arming");
        Ok(())
    }

    fn observed_cycle(&mut self, observe: &mut impl FnMut(&Observed<'_>) -> Result<()>) -> Result<Cycle> {
        let cycle = self.cycle()?;
        observe(&Observed { cycle: &cycle, slots: &self.slots })?;
        Ok(cycle)
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
        if let Some(Position { lengths_m, counts, zeroed_m }) = restored {
            (input.restored, input.restored_m, input.restored_counts) = (1, lengths_m, counts);
            input.restored_zeroed_m = zeroed_m;
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
        input.motion_asked_ns = self.motion.asked_ns;
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

    /// Sends the commands to the drive units, one after another within the period or all at once, and reads their
    /// answers.
    fn exchange(&mut self, period_ns: u64, inputs: &[DriveInput], input: &mut MotorInput) -> Result<()> {
        let n = inputs.len();
        let (units, unit_of_cable) = self.core.units();
        let apart = period_ns < APART_BELOW_NS;
        let share_ns = period_ns / units.max(1) as u64;
        let answer_ns = if apart { period_ns * APART_PERCENT / 100 } else { ANSWER_NS.min(share_ns) };
        input.cable_count = n as u8;
        input.unit_count = units as u8;
        for unit in 0..units {
            if unit == 0 || !apart {
                self.plant.step(answer_ns as f64 * 1e-9, inputs)?;
            }
            input.unit[unit] = MotorInput::UNIT_OK;
            input.slow_fresh[unit] = MotorInput::SLOW_ALL;
            input.supply_v[unit] = self.plant.voltage_v();
            for cable in (0..n).filter(|cable| unit_of_cable[*cable] == unit) {
                input.counts[cable] = self.plant.counts(cable);
                input.second_counts[cable] = self.plant.second_counts(cable);
                input.second[cable] = MotorInput::SECOND_CONTINUED;
                input.sampled_ns[cable] = self.plant.time_ns();
                input.current_a[cable] = self.plant.measured_current_a(cable);
                input.duty[cable] = self.plant.duty(cable);
            }
        }
        Ok(())
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
                *drive = match sent.current_a {
                    Some(current_a) => DriveInput::Current(-current_a[i]),
                    None => self.plant.speed_input(i, sent.encoder_m_s(i)),
                };
            }
        }
        self.drives = inputs;
        self.exchange(period_ns, &inputs[..n], &mut input)?;
        input.end_ns = self.plant.time_ns();
        let (truth_m, truth_m_s) = (self.plant.position_m(), self.plant.velocity_m_s());
        let truth_n = CableVec::from_slice(&self.plant.tensions_n())?;
        let observed = self.core.observe(&input);
        let (state, authority, energy) = (observed.state, observed.authority, observed.energy);
        self.slots.estimate(&state, &authority);
        self.planner.follow_zero(&state);
        self.estimate = self.slots.blended(&authority);
        self.authority = Some(authority);
        self.step_planner_in_turn();
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
    let chain = change(Chain::new(&scenario)?);
    fly_chain(scenario, chain, |_| Ok(()))
}

/// Flies the whole scenario with this chain; `observe` sees each cycle after it was computed.
pub fn fly_chain(
    scenario: Scenario,
    chain: Chain,
    mut observe: impl FnMut(&Observed<'_>) -> Result<()>,
) -> Result<Flight> {
    let mission = scenario.mission.clone();
    let longest = (scenario.longest_s / scenario.period_s) as u64;
    let mut lockstep = Lockstep::with(scenario, chain)?;
    lockstep.zero_and_arm_observed(&mut observe)?;
    lockstep.run(&mission).context("the planner rejected the mission")?;
    let mut tally = Tally::default();
    for cycles in 1..=longest {
        let cycle = lockstep.observed_cycle(&mut observe)?;
        tally.add(&cycle)?;
        if matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            return tally.finish(cycles, &cycle);
        }
    }
    anyhow::bail!("the mission did not end within {} s", longest as f64 * lockstep.scenario.period_s)
}
