//! The process around a controller: wakes on `node/estimate/*`, answers on `motor/command/SLOT`.

use std::process::ExitCode;

use messages::{ControlStatus, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion, SLOT_NAMES};
use service::{Args, BadInput, Chassis};

use crate::{CableLaw, Controller, ControllerConfig, Seen};

/// A whole process with a law of one's own: arguments, box file, bus, everything.
///
/// The box file's `[controller]` gives it the horizon, the limits and the distribution of tensions; its `law` is not used.
pub fn main_with(law: Box<dyn CableLaw>) -> ExitCode {
    service::main("controller", |_: &Args, chassis| {
        let config = config(chassis, None)?;
        run(chassis, Controller::with_law(config, law))
    })
}

/// The controller that the box file asks for, with another `law` if one is given.
///
/// # Errors
/// No box file, or a law or weight that does not exist.
pub fn config(chassis: &Chassis, law: Option<&str>) -> anyhow::Result<ControllerConfig> {
    let mut file = chassis.box_file()?.clone();
    if let Some(law) = law {
        law.clone_into(&mut file.controller.law);
    }
    ControllerConfig::of(&file, &file.robot_file()?, chassis.incarnation())
        .map_err(|error| BadInput(format!("[controller] {error}")).into())
}

/// Answers every cycle until the process is asked to end.
///
/// # Errors
/// Those of the bus.
pub fn run(chassis: &mut Chassis, mut controller: Controller) -> anyhow::Result<()> {
    let slot = chassis.slot().name();
    let mut commands = chassis.output::<MotorCommand>(&format!("motor/command/{slot}"))?;
    let bus = chassis.bus();
    let channels = SLOT_NAMES.map(|slot| format!("node/estimate/{slot}"));
    let mut estimates = [bus.subscriber::<NodeEstimate>(&channels[0])?, bus.subscriber::<NodeEstimate>(&channels[1])?];
    let mut motions = bus.subscriber::<PlanMotion>("plan/motion")?;
    let mut authorities = bus.subscriber::<MotorAuthority>("motor/authority")?;
    let mut states = bus.subscriber::<MotorState>("motor/state")?;
    let mut statuses = bus.publisher::<ControlStatus>(&format!("control/status/{slot}"))?;
    let mut waiter = chassis.waiter(&[&channels[0], &channels[1]])?;
    let (mut newest, mut motion, mut authority, mut state) = ([None; 2], None, None, None);
    chassis.ready()?;
    while chassis.running() {
        chassis.wait(&mut waiter, None)?;
        let mut new = false;
        for (newest, estimates) in newest.iter_mut().zip(&mut estimates) {
            if let Some(estimate) = estimates.latest()? {
                (*newest, new) = (Some(estimate), true);
            }
        }
        motion = motions.latest()?.or(motion);
        authority = authorities.latest()?.or(authority);
        state = states.latest()?.or(state);
        if new {
            chassis.pass_begin();
            let seen = Seen {
                estimates: [newest[0].as_ref(), newest[1].as_ref()],
                motion: motion.as_ref(),
                authority: authority.as_ref(),
                state: state.as_ref(),
            };
            let (mut command, mut status) = controller.step(&seen);
            commands.send(&mut command)?;
            statuses.send(&mut status)?;
            chassis.pass_end();
            match controller.notice() {
                Some(notice) if notice.is_warning() => tracing::warn!("{notice}"),
                Some(notice) => tracing::info!("{notice}"),
                None => {}
            }
        }
        chassis.report_lost(estimates[0].lost() + estimates[1].lost() + motions.lost() + authorities.lost());
    }
    Ok(())
}
