//! The box as a process: ports, published truth, faults on request.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use config::SystemFile;
use messages::{OperatorRequest, Request, TruthNode};
use robot_state::Reason;
use robot_state::answers::detail;
use runtime::{BadInput, Chassis};
use serde::Serialize;
use tracing::{info, warn};

use crate::{BoxConfig, BoxError, FaultRequest, LeftOut, Machine, MotorBox, MotorBoxSection};

/// Period of samples of truth, ns: that of the control cycle.
const TRUTH_NS: u64 = 10_000_000;

/// Least time left out that is logged, ns.
const WORTH_A_WORD_NS: u64 = 50_000_000;
/// Least time between two such log lines, ns.
const WORD_NS: u64 = 1_000_000_000;

/// Runs until a stop is requested: ports in the domain's folder, `truth/node` a hundred times a second, faults on
/// request.
///
/// # Errors
/// The system file is not for a virtual box, or a port or the bus failed.
pub fn serve(chassis: &mut Chassis) -> anyhow::Result<()> {
    let config = configuration(chassis.system_file()?, chassis.bus().domain().root())?;
    let parameters = parameters(chassis.system_file()?)?;
    chassis.uses("", &parameters);
    let mut motor_box = MotorBox::new(&config).map_err(bad_configuration)?;
    let mut truth = chassis.bus().publisher::<TruthNode>("truth/node")?;
    let mut requests = chassis.bus().server(chassis.name())?;
    chassis.ready()?;
    info!("{} port(s), first at {}", config.ports.len(), config.ports[0].link.display());
    let mut next_ns = motor_box.real_ns() + TRUTH_NS;
    let mut notice = Notice::default();
    while chassis.running() {
        motor_box.run_until(next_ns)?;
        if motor_box.real_ns() < next_ns {
            // Interrupted by a signal.
            continue;
        }
        chassis.pass_begin();
        truth.send(&mut sample(motor_box.machine(), motor_box.real_ns()))?;
        while let Some(call) = requests.try_next()? {
            let reason = obey(&mut motor_box, &call.request);
            call.answer(&reason.answer())?;
        }
        if let Some(sentence) = notice.sentence(&motor_box) {
            warn!("{sentence}");
        }
        chassis.pass_end();
        chassis.idle()?;
        // Missed samples are not made up for after a pause.
        next_ns = (next_ns + TRUTH_NS).max(motor_box.real_ns());
    }
    Ok(())
}

/// Runs without a bus until SIGINT or SIGTERM: only the ports of `system_file`, in `folder`.
///
/// # Errors
/// As [`serve`].
pub fn ports_only(system_file: &Path, folder: &Path) -> anyhow::Result<()> {
    let config = configuration(&SystemFile::load(system_file)?, folder)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, stop.clone())?;
    }
    let mut motor_box = MotorBox::new(&config).map_err(bad_configuration)?;
    let mut notice = Notice::default();
    while !stop.load(Ordering::Relaxed) {
        // Bounds the delay of a signal that arrives between the check and the wait.
        motor_box.run_until(motor_box.real_ns() + 100_000_000)?;
        if let Some(sentence) = notice.sentence(&motor_box) {
            eprintln!("motor-box: {sentence}");
        }
    }
    Ok(())
}

/// Log of the time that the box left out.
#[derive(Default)]
struct Notice {
    reported: LeftOut,
    said_ns: u64,
}

/// The words after the number of milliseconds that the motor box left out, in its log.
pub const LEFT_OUT: &str = "ms did not pass in the motor box";

impl Notice {
    /// Returns a log line at most once in [`WORD_NS`], if time was left out.
    fn sentence(&mut self, motor_box: &MotorBox) -> Option<String> {
        let now_ns = motor_box.real_ns();
        if now_ns < self.said_ns + WORD_NS {
            return None;
        }
        self.said_ns = now_ns;
        let left_out = motor_box.left_out();
        let reported = std::mem::replace(&mut self.reported, left_out);
        let ms = |now_ns: u64, before_ns: u64| (now_ns - before_ns) / 1_000_000;
        (left_out.total_ns() > reported.total_ns() + WORTH_A_WORD_NS).then(|| {
            format!(
                "the computer was busy with other things; {} {LEFT_OUT} (it had no time for the box for {} ms, none for motor-io for {} ms)",
                ms(left_out.total_ns(), reported.total_ns()),
                ms(left_out.box_ns, reported.box_ns),
                ms(left_out.program_ns, reported.program_ns)
            )
        })
    }
}

fn configuration(system_file: &SystemFile, folder: &Path) -> anyhow::Result<BoxConfig> {
    let robot = system_file.robot_file()?;
    Ok(BoxConfig::from_files(system_file, &robot, folder).map_err(|error| BadInput(error.to_string()))?)
}

/// The section with its defaults, for `system/config`. The true world stays out of the channels that processes of the
/// chain could read: the run folder has it.
fn parameters(system_file: &SystemFile) -> anyhow::Result<String> {
    #[derive(Serialize)]
    struct Parameters {
        rate_hz: f64,
        motor_box: MotorBoxSection,
    }
    let section = MotorBoxSection::from_file(system_file, &system_file.robot_file()?)?.unwrap_or_default();
    let motor_box = MotorBoxSection { truth: None, ..section };
    Ok(toml::to_string(&Parameters { rate_hz: system_file.rate_hz, motor_box })?)
}

/// Turns a rejected plant into bad input: the files describe it.
fn bad_configuration(error: BoxError) -> anyhow::Error {
    match error {
        BoxError::Plant(plant) => {
            BadInput(format!("the box or robot file describes no possible plant: {plant}")).into()
        }
        other => other.into(),
    }
}

fn sample(machine: &Machine, now_ns: u64) -> TruthNode {
    let plant = machine.plant();
    let mut truth = TruthNode {
        position_m: plant.position_m(),
        velocity_m_s: plant.velocity_m_s(),
        cable_count: plant.cable_count() as u8,
        ..TruthNode::default()
    };
    (truth.header.stamp_ns, truth.header.oldest_input_ns) = (now_ns, now_ns);
    fill(&mut truth.tension_n, plant.tensions_n());
    fill(&mut truth.length_m, plant.lengths_m());
    fill(&mut truth.current_a, plant.currents_a());
    fill(&mut truth.slack, plant.slack().into_iter().map(u8::from));
    truth
}

fn fill<T>(into: &mut [T], from: impl IntoIterator<Item = T>) {
    for (place, value) in into.iter_mut().zip(from) {
        *place = value;
    }
}

fn obey(motor_box: &mut MotorBox, request: &OperatorRequest) -> Reason {
    let text = match Request::decode(request) {
        Ok(Request::Fault { text }) => text,
        Ok(_) => return Reason::OtherProcess { takes: detail("faults") },
        Err(error) => return Reason::Undecodable { why: detail(error) },
    };
    let fault = match text.parse::<FaultRequest>() {
        Ok(fault) => fault,
        Err(error) => return Reason::FaultInvalid { why: detail(error) },
    };
    match motor_box.request(&fault) {
        Ok(()) => {
            info!("fault on request: {text}");
            Reason::FaultDone { fault: detail(text) }
        }
        Err(error @ (BoxError::Serial(_) | BoxError::Wait(_))) => {
            Reason::FaultFailed { fault: detail(text), why: detail(error) }
        }
        // Parts that this box does not have.
        Err(error) => Reason::FaultInvalid { why: detail(error) },
    }
}
