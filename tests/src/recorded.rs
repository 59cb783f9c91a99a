//! Runs of any length with everything that a report shows: missions in lockstep, their truth, a sensor.

use anyhow::Result;
use messages::{PlanStatus, Reading, Request, put_text};
use nims_sim::{Tape, true_node};
use std::path::Path;

use crate::lockstep::{Cycle, Lockstep};
use crate::scenarios::Case;

/// Cycles between two readings of the sensor, and between two progress samples of the planner.
const SLOW_CYCLES: u64 = 10;
/// Cycles at rest before the mission is flown again.
const REST_CYCLES: u64 = 50;

/// Flies the mission repeatedly for so many seconds and writes everything that is recorded. `truth`: with the truth
/// that the virtual motor box publishes.
///
/// # Errors
/// If a file is wrong, the flight fails, or writing fails.
pub fn record(path: &Path, system_path: &Path, case: &Case, seconds: f64, truth: bool) -> Result<()> {
    let scenario = case.scenario(true)?;
    let mission = scenario.mission.clone();
    let cycles = (seconds / scenario.period_s) as u64;
    let [x, y, z] = scenario.plant.start_m;
    let mut lockstep = Lockstep::new(scenario)?;
    let mut tape = Tape::new(path, system_path)?;
    let mut rest = 0;
    for number in 1..=cycles {
        match number {
            10 => lockstep.request(Request::ZeroAt { position_m: [x, y, z] }),
            20 => lockstep.request(Request::Arm),
            _ => {}
        }
        if rest == REST_CYCLES {
            lockstep.run(&mission)?;
            rest = 0;
        }
        let now = lockstep.cycle()?;
        let flies = [PlanStatus::STATE_READY, PlanStatus::STATE_RUNNING, PlanStatus::STATE_PAUSED];
        rest = if number <= REST_CYCLES || flies.contains(&now.plan.state) { 0 } else { rest + 1 };
        tape.cycle(&now, lockstep.slots())?;
        if number.is_multiple_of(SLOW_CYCLES) {
            let mut plan = now.plan;
            plan.header.stamp_ns = now.state.header.stamp_ns;
            tape.write("plan/status", plan)?;
            tape.write("sensor/height", height(&now))?;
        }
        if truth {
            tape.write("truth/node", true_node(&now))?;
        }
    }
    tape.finish()?;
    Ok(())
}

fn height(cycle: &Cycle) -> Reading {
    let mut reading = Reading { header: cycle.state.header, count: 1, ..Reading::default() };
    reading.value[0] = cycle.truth_m[2];
    put_text(&mut reading.quantity, "height");
    put_text(&mut reading.unit, "m");
    reading
}
