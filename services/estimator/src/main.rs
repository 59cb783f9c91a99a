//! The estimator: wakes on `motor/state`, answers on `node/estimate/SLOT`.

use std::process::ExitCode;

use estimator::{Estimator, EstimatorConfig};
use messages::{MotorAuthority, MotorState, NodeEstimate};
use service::{BadInput, Chassis, LawArgs};

fn main() -> ExitCode {
    service::main("estimator", run)
}

fn run(args: &LawArgs, chassis: &mut Chassis) -> anyhow::Result<()> {
    let file = chassis.box_file()?;
    let robot = file.robot_file()?.robot()?;
    let mut section = file.estimator.clone();
    if let Some(law) = &args.law {
        law.clone_into(&mut section.method);
    }
    let config = EstimatorConfig::of(&section, robot, chassis.incarnation())
        .map_err(|error| BadInput(format!("[estimator] {error}")))?;
    let mut estimator = Estimator::new(&config);
    let mut states = chassis.bus().subscriber::<MotorState>("motor/state")?;
    let mut authorities = chassis.bus().subscriber::<MotorAuthority>("motor/authority")?;
    let mut estimates = chassis.output::<NodeEstimate>(&format!("node/estimate/{}", chassis.slot().name()))?;
    let mut waiter = chassis.waiter(&["motor/state"])?;
    let mut authority = None;
    let mut rig = 0;
    chassis.ready()?;
    while chassis.running() {
        chassis.wait(&mut waiter, None)?;
        authority = authorities.latest()?.or(authority);
        while let Some(state) = states.receive()? {
            chassis.pass_begin();
            estimates.send(&mut estimator.step(&state, authority.as_ref()))?;
            chassis.pass_end();
            if usize::from(state.cable_count) != robot.cable_count() && rig != state.cable_count {
                rig = state.cable_count;
                tracing::error!(
                    "motor-io reads {rig} cables and the robot file has {}: give both the same box file",
                    robot.cable_count()
                );
            }
        }
        chassis.report_lost(states.lost() + authorities.lost());
    }
    Ok(())
}
