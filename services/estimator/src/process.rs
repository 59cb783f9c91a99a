//! The process of an estimator: waits for `motor/state` and publishes `node/estimate/SLOT`.

use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use config::{RobotFile, SystemFile};
use messages::{Header, MotorAuthority, MotorState, NodeEstimate, newer};
use program_pipe::{StartError, Waits};
use runtime::{Args, BadInput, Chassis, FirstOutput, Program, Tuning};

use crate::cable_estimator::CableEstimator;
use crate::estimator::{Estimator, EstimatorConfig};
use crate::method::Method;
use crate::program::ProgramEstimator;
use crate::serve::serve;

/// Runs a whole process with a custom method. Each cable gets a copy of `cable`.
///
/// `stretch`, `sigma_length_m` and the [`Parameters`](crate::Parameters) are those of `[estimator]` in the system file;
/// its `method` is not used. `program` is [`program!()`](macro@crate::program), so that the run identifies the program
/// and not nims. With [`program_pipe::ARGUMENT`] the same program answers `nims sim` instead.
pub fn main_with(program: Program, cable: Box<dyn CableEstimator>) -> ExitCode {
    let served = program_pipe::serve_if_asked(|questions, answers| serve(cable.clone(), questions, answers));
    if let Some(code) = served {
        return code;
    }
    runtime::main("estimator", move |_: &Args, chassis| {
        chassis.is_program(&program);
        let file = chassis.system_file()?;
        let config =
            EstimatorConfig::for_custom_method(&file.estimator, file.robot_file()?.robot()?, chassis.incarnation());
        run(chassis, Estimator::with_method(&with_thread(config), cable))
    })
}

/// Returns the configuration of the estimator from the system file, with `law` instead of its method if one is given.
///
/// # Errors
/// There is no system file, or the method or a parameter is not accepted.
pub fn config(chassis: &Chassis, law: Option<&str>) -> anyhow::Result<EstimatorConfig> {
    let mut file = chassis.system_file()?.clone();
    if let Some(law) = law {
        file.estimator.method = law.parse().map_err(|error| BadInput(format!("[estimator] method {error}")))?;
    }
    EstimatorConfig::from_section(&file.estimator, file.robot_file()?.robot()?, chassis.incarnation())
        .map(with_thread)
        .map_err(|error| BadInput(format!("[estimator] {error}")).into())
}

fn with_thread(config: EstimatorConfig) -> EstimatorConfig {
    EstimatorConfig { thread: std::process::id(), ..config }
}

/// Share of the period that a program has for its answer: the controller, the drives and motor-io need the rest.
const PROGRAM_SHARE: f64 = 0.25;

/// Runs with the method of a program in any language; see [`ProgramEstimator`].
///
/// # Errors
/// The program fails, and those of the bus.
pub fn run_program(
    chassis: &mut Chassis,
    config: &EstimatorConfig,
    command: &str,
    system: &Path,
) -> anyhow::Result<()> {
    let deadline = Duration::from_secs_f64(PROGRAM_SHARE * chassis.system_file()?.period_s());
    let cables = config.robot.cable_count();
    let program =
        ProgramEstimator::start(command, system, cables, Waits::in_flight(deadline)).map_err(StartError::failure)?;
    let complaint = program.complaint();
    run_checked(chassis, Estimator::with_program(config, program), || program_pipe::check(&complaint))
}

/// Method and parameters of this estimator: declares them for the run file, and receives changes of the parameters.
struct MethodInUse {
    method: String,
    tuning: Tuning<(EstimatorConfig, String)>,
}

impl MethodInUse {
    fn declare(chassis: &mut Chassis, estimator: &Estimator) -> anyhow::Result<Self> {
        let (config, constants) = (*estimator.config(), estimator.constants());
        let standard = Method::numbered(config.method.number());
        let program = || std::env::current_exe().ok()?.file_name().map(|name| name.to_string_lossy().into_owned());
        let method = standard.map(|method| method.name().to_owned()).or_else(program).unwrap_or_default();
        let constants = if constants.is_empty() { constants } else { format!("\n[method]\n{constants}") };
        let make = move |file: &SystemFile, robot: &RobotFile| {
            let (mut file, robot) = (file.clone(), robot.robot()?);
            let made = match standard {
                Some(method) => {
                    file.estimator.method = method;
                    EstimatorConfig::from_section(&file.estimator, robot, config.incarnation)?
                }
                None => EstimatorConfig::for_custom_method(&file.estimator, robot, config.incarnation),
            };
            Ok((made, format!("{}{constants}", file.sections(&["estimator"]))))
        };
        let file = chassis.system_file()?.clone();
        let (_, text) = make(&file, &file.robot_file()?)?;
        let in_use = Self { method, tuning: chassis.tuning(make)? };
        let since = FirstOutput { seq: 1, changes: chassis.changes(), ..FirstOutput::default() };
        chassis.uses_since(&in_use.method, &text, since)?;
        Ok(in_use)
    }
}

/// Computes and publishes an estimate in every cycle until the end of the process is requested.
///
/// # Errors
/// Those of the bus.
pub fn run(chassis: &mut Chassis, estimator: Estimator) -> anyhow::Result<()> {
    run_checked(chassis, estimator, || Ok(()))
}

/// The same, as long as `check` succeeds in each cycle.
fn run_checked(
    chassis: &mut Chassis,
    mut estimator: Estimator,
    mut check: impl FnMut() -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let cables = estimator.config().robot.cable_count();
    let mut in_use = MethodInUse::declare(chassis, &estimator)?;
    let mut states = chassis.bus().subscriber::<MotorState>("motor/state")?;
    let mut authorities = chassis.bus().subscriber::<MotorAuthority>("motor/authority")?;
    let mut estimates = chassis.output::<NodeEstimate>(&format!("node/estimate/{}", chassis.slot().name()))?;
    let mut waiter = chassis.waiter(&["motor/state"])?;
    let (mut authority, mut life) = (None, 0);
    let (mut reported_cables, mut answers) = (0, 0);
    chassis.ready()?;
    while chassis.running() {
        chassis.wait(&mut waiter, None)?;
        authority = newer(authority, authorities.latest()?);
        while let Some(state) = states.receive()? {
            // Samples of a dead motor-io may arrive after the first sample of its successor.
            if state.header.life < life {
                continue;
            }
            life = state.header.life;
            chassis.pass_begin();
            let change = in_use.tuning.due(&state.header);
            if let Some(change) = &change {
                estimator.configure(&change.made.0);
            }
            let mut estimate = estimator.step(&state, authority.as_ref());
            check()?;
            estimates.send(&mut estimate)?;
            answers += 1;
            chassis.pass_end();
            if let Some(change) = change {
                let Header { life, cycle, .. } = state.header;
                let since = FirstOutput { life, cycle, seq: answers, changes: change.changes };
                chassis.uses_since(&in_use.method, &change.made.1, since)?;
            }
            if usize::from(state.cable_count) != cables && reported_cables != state.cable_count {
                reported_cables = state.cable_count;
                tracing::error!(
                    "motor-io reads {reported_cables} cables and the robot file has {cables}: start both with the same system file"
                );
            }
        }
        in_use.tuning.poll()?;
        chassis.report_lost(states.lost() + authorities.lost());
    }
    Ok(())
}
