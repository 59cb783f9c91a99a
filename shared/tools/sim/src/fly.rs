//! One flight: the chain of the system file in its folder, and its run file.

use std::path::Path;

use anyhow::{Context, Result};
use config::SystemFile;
use controller::Controller;
use controller::program::{ProgramLaw, Waits};
use estimator::Estimator;
use estimator::program::ProgramEstimator;
use lockstep::{Chain, Cycle, Flight, Observed, Scenario, fly_chain};
use messages::{MotorAuthority, PlanStatus, text_of};
use motor_box::BoxConfig;
use planner::Mission;

use crate::args::Args;
use crate::commands::Commands;
use crate::tape::{Tape, is_turn, true_node};

/// Time between two samples of `plan/status`, about as in the planner's process, s.
const PLAN_S: f64 = 0.1;
/// Time between two points of a chart, s.
const CHART_S: f64 = 0.05;

/// How a flight ended.
#[derive(Debug, Clone)]
pub(crate) enum Ended {
    /// The mission was flown, or the robot gave it up; the figures tell.
    Done(Box<Flight>),
    /// It could not be flown: why.
    Failed(String),
}

/// A flight for the table and the charts.
#[derive(Debug, Clone)]
pub(crate) struct Flown {
    pub ended: Ended,
    /// Time since arming, s, and distances of estimate and truth to the setpoint, m.
    pub distances: Vec<[f64; 3]>,
    pub period_s: f64,
    /// Why the robot gave up the mission; empty if it did not.
    pub gave_up: String,
}

/// True where the mission was flown to its end.
pub(crate) fn is_completed(flight: &Flight) -> bool {
    flight.state == PlanStatus::STATE_DONE
}

/// Flies the system file in `folder` with these programs, and records it there if the runs are kept.
pub(crate) fn fly(folder: &Path, args: &Args, commands: &Commands) -> Flown {
    let mut flown =
        Flown { ended: Ended::Failed(String::new()), distances: Vec::new(), period_s: 0.0, gave_up: String::new() };
    flown.ended = match try_fly(folder, args, commands, &mut flown) {
        Ok(flight) => Ended::Done(Box::new(flight)),
        Err(error) => Ended::Failed(format!("{error:#}")),
    };
    flown
}

fn try_fly(folder: &Path, args: &Args, commands: &Commands, flown: &mut Flown) -> Result<Flight> {
    let system = folder.join("system.toml");
    let file = SystemFile::load(&system)?;
    let (scenario, mut chain) = (scenario(&file, args)?, Chain::from_file(&file)?);
    flown.period_s = scenario.period_s;
    let mut complaints = Vec::new();
    let (cables, waits) = (scenario.robot.cable_count(), Waits::in_lockstep());
    if let Some(program) = &commands.law {
        let law = ProgramLaw::start(program, &system, cables, waits)?;
        complaints.push(law.complaint());
        chain.controller = Controller::with_law(*chain.controller.config(), Box::new(law));
    }
    if let Some(program) = &commands.estimator {
        let program = ProgramEstimator::start(program, &system, cables, waits)?;
        complaints.push(program.complaint());
        chain.estimator = Estimator::with_program(chain.estimator.config(), program);
    }
    let mut tape = match args.out {
        Some(_) => Some(Tape::new(&folder.join("run.mcap"), &system)?),
        None => None,
    };
    let flight = fly_chain(scenario, chain, |seen| {
        // A program that fails would only bring the robot to rest.
        if let Some(complaint) = complaints.iter().find_map(|complaint| complaint.lock().ok()?.clone()) {
            anyhow::bail!(complaint);
        }
        flown.distances.extend(distances(seen.cycle));
        let plan = &seen.cycle.plan;
        if plan.state == PlanStatus::STATE_ABORTED && flown.gave_up.is_empty() {
            flown.gave_up = text_of(&plan.reason);
        }
        tape.as_mut().map_or(Ok(()), |tape| record(tape, seen))
    });
    // A run that ended early is kept too: it shows why.
    let closed = tape.map(Tape::finish).transpose();
    let flight = flight?;
    closed.context("the run file cannot be closed")?;
    Ok(flight)
}

/// Everything of the flight but the chain, which is that of the system file.
pub(crate) fn scenario(file: &SystemFile, args: &Args) -> Result<Scenario> {
    let robot_file = file.robot_file()?;
    let asked = args.mission.as_deref().unwrap_or(&file.planner.demo);
    let mission = Mission::read(&command::mission_path(asked, Some(&file.planner.missions))?)?;
    let plant = BoxConfig::from_files(file, &robot_file, Path::new(""))?.plant;
    let scenario = Scenario::from_files(file, robot_file.robot()?, plant, mission)?;
    Ok(Scenario { longest_s: args.longest, ..scenario })
}

/// Writes a cycle, its plan and its truth.
pub(crate) fn record(tape: &mut Tape, seen: &Observed<'_>) -> Result<()> {
    tape.cycle(seen.cycle, seen.slots)?;
    if is_turn(seen.cycle, PLAN_S) {
        let mut plan = seen.cycle.plan;
        plan.header.stamp_ns = seen.cycle.state.header.stamp_ns;
        tape.write("plan/status", plan)?;
    }
    tape.write("truth/node", true_node(seen.cycle))
}

/// A point of the charts, in a cycle that has one.
fn distances(cycle: &Cycle) -> Option<[f64; 3]> {
    let following = cycle.authority.mode == MotorAuthority::MODE_FOLLOWING;
    (following && is_turn(cycle, CHART_S)).then(|| {
        let setpoint = cycle.control.setpoint_m;
        let distance =
            |from: &[f64; 3]| from.iter().zip(setpoint).map(|(from, to)| (from - to) * (from - to)).sum::<f64>().sqrt();
        let time_s = cycle.input.tick_ns as f64 * 1e-9;
        [time_s, distance(&cycle.estimate.position_m), distance(&cycle.truth_m)]
    })
}
