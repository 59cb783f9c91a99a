//! The estimator: wakes on `motor/state`, answers on `node/estimate/SLOT`.

use std::process::ExitCode;

use config::{BoxFile, RobotFile};
use estimator::{Estimator, EstimatorConfig};
use messages::{Header, MotorAuthority, MotorState, NodeEstimate, newer};
use runtime::{BadInput, Chassis, LawArgs, Since, Tuning};

fn main() -> ExitCode {
    runtime::main("estimator", run)
}

/// An estimator as a box has it, and its section as the run file will have it.
fn made_from(
    file: &BoxFile,
    robot: &RobotFile,
    law: Option<&str>,
    incarnation: u32,
) -> anyhow::Result<(EstimatorConfig, String)> {
    let mut file = file.clone();
    if let Some(law) = law {
        law.clone_into(&mut file.estimator.method);
    }
    let config = EstimatorConfig::of(&file.estimator, robot.robot()?, incarnation)
        .map(|config| EstimatorConfig { thread: std::process::id(), ..config })
        .map_err(|error| BadInput(format!("[estimator] {error}")))?;
    Ok((config, file.sections(&["estimator"])))
}

/// The estimator, and what hears of changes of its parameters.
fn begin(args: &LawArgs, chassis: &mut Chassis) -> anyhow::Result<(Estimator, Tuning<(EstimatorConfig, String)>)> {
    let file = chassis.box_file()?.clone();
    let (law, incarnation) = (args.law.clone(), chassis.incarnation());
    let (config, text) = made_from(&file, &file.robot_file()?, law.as_deref(), incarnation)?;
    let tuning = chassis.tuning(move |file, robot| made_from(file, robot, law.as_deref(), incarnation))?;
    let since = Since { seq: 1, changes: chassis.changes(), ..Since::default() };
    chassis.uses_since(args.law.as_deref().unwrap_or(&file.estimator.method), &text, since)?;
    Ok((Estimator::new(&config), tuning))
}

fn run(args: &LawArgs, chassis: &mut Chassis) -> anyhow::Result<()> {
    let cables = chassis.box_file()?.robot_file()?.robot()?.cable_count();
    let method = args.law.clone().unwrap_or(chassis.box_file()?.estimator.method.clone());
    let (mut estimator, mut tuning) = begin(args, chassis)?;
    let mut states = chassis.bus().subscriber::<MotorState>("motor/state")?;
    let mut authorities = chassis.bus().subscriber::<MotorAuthority>("motor/authority")?;
    let mut estimates = chassis.output::<NodeEstimate>(&format!("node/estimate/{}", chassis.slot().name()))?;
    let mut waiter = chassis.waiter(&["motor/state"])?;
    let (mut authority, mut life) = (None, 0);
    let (mut rig, mut answers) = (0, 0);
    chassis.ready()?;
    while chassis.running() {
        chassis.wait(&mut waiter, None)?;
        authority = newer(authority, authorities.latest()?);
        while let Some(state) = states.receive()? {
            // What a dead motor-io left may arrive behind the first sample of its successor.
            if state.header.life < life {
                continue;
            }
            life = state.header.life;
            chassis.pass_begin();
            let change = tuning.due(&state.header);
            if let Some(change) = &change {
                estimator.configure(&change.made.0);
            }
            estimates.send(&mut estimator.step(&state, authority.as_ref()))?;
            answers += 1;
            chassis.pass_end();
            if let Some(change) = change {
                let Header { life, cycle, .. } = state.header;
                let since = Since { life, cycle, seq: answers, changes: change.changes };
                chassis.uses_since(&method, &change.made.1, since)?;
            }
            if usize::from(state.cable_count) != cables && rig != state.cable_count {
                rig = state.cable_count;
                tracing::error!(
                    "motor-io reads {rig} cables and the robot file has {cables}: give both the same box file"
                );
            }
        }
        tuning.hear()?;
        chassis.report_lost(states.lost() + authorities.lost());
    }
    Ok(())
}
