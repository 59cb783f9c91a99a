//! Swaps and deaths at instants of a mission: the flight is forked at each instant, and the result is compared with the
//! required bounds.

use anyhow::{Context, Result, ensure};
use cable_control::law::PFeedforward;
use config::{EstimatorMethod, EstimatorSection};
use controller::{ControllerConfig, Law};
use estimator::{EstimatorConfig, Method};
use messages::{
    CABLES, CONTROLLERS, ESTIMATORS, MotorAuthority, MotorSlots, PlanStatus, Request, SLOTS, Slot, SlotRole,
};

use crate::lockstep::{Chain, Cycle, Lockstep};
use crate::scenarios::Case;

/// What happens at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blow {
    /// A swap of the controllers is requested.
    SwapControllers,
    /// A swap of the estimators is requested.
    SwapEstimators,
    /// The controller in charge dies.
    KillController,
    /// The estimator in charge dies.
    KillEstimator,
}

/// All kinds of events.
pub const BLOWS: [Blow; 4] = [Blow::SwapControllers, Blow::SwapEstimators, Blow::KillController, Blow::KillEstimator];

/// Cycles that are checked after an event: announcement, fade and a margin.
const WATCHED: u64 = 45;

/// Result of all instants of a mission.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tally {
    /// Instants tried.
    pub instants: u64,
    /// Periods that were not steered by a fresh command.
    pub unsteered: u64,
    /// Events after which the other slot was not in charge, or the robot did not continue.
    pub failed: u64,
    /// How much more a cable's velocity changed within a cycle than in the undisturbed flight, as a share of the
    /// robot's acceleration limit x period; of the arbiter's choice, before motor-io's limits.
    pub step_share: f64,
    /// Largest change in a cycle, the undisturbed flight's change included, and that of the undisturbed flight alone;
    /// in the same unit.
    pub whole_share: [f64; 2],
    /// Cycles in which motor-io's limits changed the command, and the same for the undisturbed flight.
    pub limited: [u64; 2],
    /// Largest difference of the sent velocities from those of the undisturbed flight, m/s.
    pub beside_m_s: f64,
}

/// A mission with two of every process, where slots b are standbys.
///
/// # Errors
/// If the configuration or the mission is invalid.
pub fn doubled(case: &Case, law: Option<Law>) -> Result<Lockstep> {
    let scenario = case.scenario(true)?;
    let Chain { controller, .. } = Chain::new(&scenario)?;
    let plain = Law::PFeedforward(PFeedforward::new(2.0)?);
    let config = ControllerConfig { law: law.unwrap_or(plain), ..*controller.config() };
    let section = EstimatorSection { method: EstimatorMethod::Kalman, ..EstimatorSection::default() };
    let method = Method::from_section(&section)?;
    let estimator = EstimatorConfig {
        robot: scenario.robot,
        method,
        sigma_length_m: section.sigma_length_m,
        incarnation: 1,
        thread: 0,
    };
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario)?;
    lockstep.slots_mut().start_controller(1, &config);
    lockstep.slots_mut().start_estimator(1, &estimator, method);
    lockstep.zero_and_arm()?;
    for _ in 0..150 {
        lockstep.cycle()?;
    }
    lockstep.run(&mission)?;
    Ok(lockstep)
}

/// Flies to the end, and applies every event in a fork of the flight at `instants` instants, evenly spread over it.
///
/// # Errors
/// If the undisturbed flight fails.
pub fn try_all(mut lockstep: Lockstep, instants: u64, acceleration_step_m_s: f64) -> Result<[Tally; 4]> {
    let flight = undisturbed(lockstep.fork().context("this law cannot be forked")?)?;
    let following = |cycle: &Cycle| cycle.authority.mode == MotorAuthority::MODE_FOLLOWING;
    let first = flight.iter().position(following).context("the robot never moves")?;
    let last =
        flight.iter().rposition(following).context("the robot never moves")?.saturating_sub(WATCHED as usize + 1);
    ensure!(first < last, "the robot moves for only {} cycles", last.abs_diff(first));
    let mut tallies = [Tally::default(); 4];
    let mut done = 0;
    for (i, now) in flight.iter().enumerate() {
        lockstep.cycle()?;
        let due = (i.saturating_sub(first) as u64 + 1) * instants / (last - first) as u64;
        if i < first || i >= last || due <= done {
            continue;
        }
        done = due;
        for (blow, tally) in BLOWS.iter().zip(&mut tallies) {
            let fork = lockstep.fork().context("this law cannot be forked")?;
            strike(fork, *blow, done % 2 == 0, now, &flight[i + 1..], acceleration_step_m_s, tally)?;
        }
    }
    Ok(tallies)
}

fn undisturbed(mut lockstep: Lockstep) -> Result<Vec<Cycle>> {
    let mut cycles = Vec::new();
    loop {
        let cycle = lockstep.cycle()?;
        let over = matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED);
        cycles.push(cycle);
        if over {
            return Ok(cycles);
        }
        ensure!(cycles.len() < 100_000, "the mission does not end");
    }
}

fn strike(
    mut lockstep: Lockstep,
    blow: Blow,
    unheard: bool,
    now: &Cycle,
    flight: &[Cycle],
    acceleration_step_m_s: f64,
    tally: &mut Tally,
) -> Result<()> {
    let role = if matches!(blow, Blow::SwapControllers | Blow::KillController) { CONTROLLERS } else { ESTIMATORS };
    let lead = usize::from(now.authority.in_charge[role]);
    match blow {
        Blow::SwapControllers | Blow::SwapEstimators => {
            lockstep.request(Request::Swap { role: SlotRole::ALL[role], slot: Slot::ALL[1 - lead] });
        }
        Blow::KillController | Blow::KillEstimator => lockstep.slots_mut().kill(role, lead, unheard),
    }
    let (mut end, mut undisturbed) = (*now, *now);
    for same in flight.iter().take(WATCHED as usize) {
        let before = std::mem::replace(&mut end, lockstep.cycle()?);
        let step = |cable: usize, [one, other]: [&Cycle; 2]| (one.asked_m_s[cable] - other.asked_m_s[cable]).abs();
        for cable in 0..CABLES {
            let (here, there) = (step(cable, [&end, &before]), step(cable, [same, &undisturbed]));
            let more = |most: f64, m_s: f64| most.max(m_s / acceleration_step_m_s);
            tally.step_share = more(tally.step_share, here - there);
            let [all, flight] = tally.whole_share;
            tally.whole_share = [more(all, here), more(flight, there)];
        }
        for (count, cycle) in tally.limited.iter_mut().zip([&end, same]) {
            *count += u64::from(cycle.asked_m_s != cycle.sent_m_s);
        }
        let beside = end.sent_m_s.iter().zip(&same.sent_m_s).map(|(v, other)| (v - other).abs());
        tally.beside_m_s = beside.fold(tally.beside_m_s, f64::max);
        undisturbed = *same;
    }
    tally.instants += 1;
    tally.unsteered += end.authority.unsteered() - now.authority.unsteered();
    let went_on = end.authority.mode == MotorAuthority::MODE_FOLLOWING;
    let other = usize::from(end.authority.in_charge[role]) == 1 - lead;
    let active = end.slots.phase[SLOTS * role + 1 - lead] == MotorSlots::PHASE_ACTIVE;
    tally.failed += u64::from(!(went_on && other && active));
    Ok(())
}
