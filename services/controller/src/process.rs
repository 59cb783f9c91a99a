//! The process of a controller: waits for `node/estimate/*` and publishes `motor/command/SLOT`.

use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use config::{RobotFile, SystemFile};
use messages::{
    ControlStatus, Freshness, Header, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion, SLOT_NAMES,
    SLOTS, freshness, newer,
};
use runtime::{Args, BadInput, Change, Chassis, FirstOutput, Program, Tuning};

use crate::program::{ProgramLaw, StartError, Waits};
use crate::{CableLaw, Controller, ControllerConfig, Inputs, Law, lockstep};

/// Runs a whole process with a custom law.
///
/// Horizon, limits and tension distribution are those of `[controller]` in the system file; its `law` is not used.
/// `program` is [`program!()`](macro@crate::program), so that the run identifies the program and not nims. With
/// [`program_pipe::ARGUMENT`] the same program answers `nims sim` instead.
pub fn main_with(program: Program, mut law: Box<dyn CableLaw>) -> ExitCode {
    let served = program_pipe::serve_if_asked(|questions, answers| lockstep::serve(law.as_mut(), questions, answers));
    if let Some(code) = served {
        return code;
    }
    runtime::main("controller", move |_: &Args, chassis| {
        chassis.is_program(&program);
        let config = config(chassis, None)?;
        run(chassis, Controller::with_law(config, law))
    })
}

/// Returns the configuration of the controller from the system file, with `law` instead of its law if one is given.
///
/// # Errors
/// There is no system file, or the law or a weight is not accepted.
pub fn config(chassis: &Chassis, law: Option<&str>) -> anyhow::Result<ControllerConfig> {
    let mut file = chassis.system_file()?.clone();
    if let Some(law) = law {
        file.controller.law = law.parse().map_err(|error| BadInput(format!("[controller] law {error}")))?;
    }
    ControllerConfig::from_files(&file, &file.robot_file()?, chassis.incarnation())
        .map(|config| ControllerConfig { thread: std::process::id(), ..config })
        .map_err(|error| BadInput(format!("[controller] {error}")).into())
}

/// Share of the period that the program of a law has for its answer: the rest is for the drives and the estimator.
const PROGRAM_SHARE: f64 = 0.5;

/// Runs with the law of a program in any language; see [`ProgramLaw`].
///
/// # Errors
/// The program fails, and those of the bus.
pub fn run_program(
    chassis: &mut Chassis,
    config: ControllerConfig,
    command: &str,
    system: &Path,
) -> anyhow::Result<()> {
    let deadline = Duration::from_secs_f64(PROGRAM_SHARE * chassis.system_file()?.period_s());
    let law = ProgramLaw::start(command, system, config.robot.cable_count(), Waits::in_flight(deadline))
        .map_err(StartError::failure)?;
    let complaint = law.complaint();
    run_checked(chassis, Controller::with_law(config, Box::new(law)), || program_pipe::check(&complaint))
}

/// Law and parameters of this controller: declares them for the run file, and receives changes of the parameters.
struct LawInUse {
    law: String,
    fade_s: f64,
    tuning: Tuning<(ControllerConfig, String)>,
}

impl LawInUse {
    fn declare(chassis: &mut Chassis, controller: &Controller) -> anyhow::Result<Self> {
        let (config, own) = (*controller.config(), controller.own_parameters());
        let named = Law::numbered(config.law.number());
        let program = || std::env::current_exe().ok()?.file_name().map(|name| name.to_string_lossy().into_owned());
        let law = named.map(|law| law.name().to_owned()).or_else(program).unwrap_or_default();
        let make = move |file: &SystemFile, robot: &RobotFile| {
            let mut file = file.clone();
            if let Some(law) = named {
                file.controller.law = law;
            }
            let own = if own.is_empty() { String::new() } else { format!("\n[law]\n{own}") };
            let text = format!("{}{own}", file.sections(&["controller"]));
            Ok((ControllerConfig::from_files(&file, robot, config.incarnation)?, text))
        };
        let file = chassis.system_file()?.clone();
        let (_, text) = make(&file, &file.robot_file()?)?;
        let in_use = Self { law, fade_s: file.arbiter.fade_s, tuning: chassis.tuning(make)? };
        let since = FirstOutput { seq: 1, changes: chassis.changes(), ..FirstOutput::default() };
        chassis.uses_since(&in_use.law, &text, since)?;
        Ok(in_use)
    }

    /// Returns a change that applies in the cycle of the newest live estimate.
    fn due(
        &mut self,
        controller: &Controller,
        newest: &[Option<NodeEstimate>; SLOTS],
        authority: Option<&MotorAuthority>,
    ) -> Option<Change<(ControllerConfig, String)>> {
        let (ttl_cycles, authority) = (controller.config().estimate_ttl_cycles, &authority?.header);
        let headers = newest.iter().flatten().map(|estimate| &estimate.header);
        let live = headers.filter(|header| freshness(header, authority, ttl_cycles) == Freshness::Live);
        self.tuning.due(live.max_by_key(|header| header.cycle)?)
    }
}

/// Computes and publishes a command in every cycle until the end of the process is requested.
///
/// # Errors
/// Those of the bus.
pub fn run(chassis: &mut Chassis, controller: Controller) -> anyhow::Result<()> {
    run_checked(chassis, controller, || Ok(()))
}

/// The same, as long as `check` succeeds in each cycle.
fn run_checked(
    chassis: &mut Chassis,
    mut controller: Controller,
    mut check: impl FnMut() -> anyhow::Result<()>,
) -> anyhow::Result<()> {
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
    let (mut newest, mut motion, mut authority, mut state) = ([None::<NodeEstimate>; 2], None, None, None);
    let mut in_use = LawInUse::declare(chassis, &controller)?;
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
        authority = newer(authority, authorities.latest()?);
        state = newer(state, states.latest()?);
        if new {
            chassis.pass_begin();
            let inputs = Inputs {
                estimates: [newest[0].as_ref(), newest[1].as_ref()],
                motion: motion.as_ref(),
                authority: authority.as_ref(),
                state: state.as_ref(),
            };
            let change = in_use.due(&controller, &newest, authority.as_ref());
            if let Some(change) = &change {
                controller.configure(change.made.0, in_use.fade_s);
            }
            let (mut command, mut status) = controller.step(&inputs);
            check()?;
            commands.send(&mut command)?;
            statuses.send(&mut status)?;
            chassis.pass_end();
            if let Some(change) = change {
                let Header { life, cycle, .. } = status.header;
                let since = FirstOutput { life, cycle, seq: statuses.seq(), changes: change.changes };
                chassis.uses_since(&in_use.law, &change.made.1, since)?;
            }
            in_use.tuning.poll()?;
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
