//! The process around an estimator: wakes on `motor/state`, answers on `node/estimate/SLOT`.

use std::process::ExitCode;

use config::{RobotFile, SystemFile};
use messages::{Header, MotorAuthority, MotorState, NodeEstimate, newer};
use runtime::{Args, BadInput, Chassis, Program, Since, Tuning};

use crate::cable_estimator::CableEstimator;
use crate::estimator::{Estimator, EstimatorConfig};
use crate::method::Method;

/// A whole process with a method of one's own: arguments, system file, bus, everything. Each cable gets a copy of `cable`.
///
/// The system file's `[estimator]` gives it `stretch`, `sigma_length_m` and the [`Parameters`](crate::Parameters); its `method` is not used.
/// `program` is [`program!()`](crate::program), so that the run names the program itself and not nims.
pub fn main_with(program: Program, cable: Box<dyn CableEstimator>) -> ExitCode {
    runtime::main("estimator", move |_: &Args, chassis| {
        chassis.is_program(&program);
        let file = chassis.system_file()?;
        let config = EstimatorConfig::own(&file.estimator, file.robot_file()?.robot()?, chassis.incarnation());
        run(chassis, Estimator::with_method(&with_thread(config), cable))
    })
}

/// The estimator that the system file asks for, with another method (`law`) if one is given.
///
/// # Errors
/// No system file, or a method or parameter that does not exist.
pub fn config(chassis: &Chassis, law: Option<&str>) -> anyhow::Result<EstimatorConfig> {
    let mut file = chassis.system_file()?.clone();
    if let Some(law) = law {
        file.estimator.method = law.parse().map_err(|error| BadInput(format!("[estimator] method {error}")))?;
    }
    EstimatorConfig::of(&file.estimator, file.robot_file()?.robot()?, chassis.incarnation())
        .map(with_thread)
        .map_err(|error| BadInput(format!("[estimator] {error}")).into())
}

fn with_thread(config: EstimatorConfig) -> EstimatorConfig {
    EstimatorConfig { thread: std::process::id(), ..config }
}

/// What this estimator works with, for the run file and for a change of its parameters.
struct Used {
    method: String,
    tuning: Tuning<(EstimatorConfig, String)>,
}

impl Used {
    fn begin(chassis: &mut Chassis, estimator: &Estimator) -> anyhow::Result<Self> {
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
                    EstimatorConfig::of(&file.estimator, robot, config.incarnation)?
                }
                None => EstimatorConfig::own(&file.estimator, robot, config.incarnation),
            };
            Ok((made, format!("{}{constants}", file.sections(&["estimator"]))))
        };
        let file = chassis.system_file()?.clone();
        let (_, text) = make(&file, &file.robot_file()?)?;
        let used = Self { method, tuning: chassis.tuning(make)? };
        let since = Since { seq: 1, changes: chassis.changes(), ..Since::default() };
        chassis.uses_since(&used.method, &text, since)?;
        Ok(used)
    }
}

/// Answers every cycle until the process is asked to end.
///
/// # Errors
/// Those of the bus.
pub fn run(chassis: &mut Chassis, mut estimator: Estimator) -> anyhow::Result<()> {
    let cables = estimator.config().robot.cable_count();
    let mut used = Used::begin(chassis, &estimator)?;
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
            let change = used.tuning.due(&state.header);
            if let Some(change) = &change {
                estimator.configure(&change.made.0);
            }
            estimates.send(&mut estimator.step(&state, authority.as_ref()))?;
            answers += 1;
            chassis.pass_end();
            if let Some(change) = change {
                let Header { life, cycle, .. } = state.header;
                let since = Since { life, cycle, seq: answers, changes: change.changes };
                chassis.uses_since(&used.method, &change.made.1, since)?;
            }
            if usize::from(state.cable_count) != cables && rig != state.cable_count {
                rig = state.cable_count;
                tracing::error!(
                    "motor-io reads {rig} cables and the robot file has {cables}: give both the same system file"
                );
            }
        }
        used.tuning.hear()?;
        chassis.report_lost(states.lost() + authorities.lost());
    }
    Ok(())
}
