//! `nims demo`: the whole robot on the virtual motor box, from nothing to a report.

pub mod analysis;
mod plot;

use crate::cli::Demo;
use crate::failure::{Answer, Failure};
use crate::supervisor::{self, Supervisor, Wanted};
use crate::{answers, findings, operate, status};
use analysis::Analysis;
use bus::clock;
use indicatif::{ProgressBar, ProgressStyle};
use messages::{MotorAuthority, NodeEstimate, OperatorRequest, PlanStatus, text_of};
use planner::mission::Mission;
use serde_json::json;
use service::config::BoxFile;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Where the demonstration's box file stands in the project.
const DEFAULT_BOX: &str = "configs/boxes/demo3.toml";
/// How long a request is repeated while the robot is not ready for it: drives answer, an estimate settles.
const SETTLE: Duration = Duration::from_secs(5);
/// A mission that is this much later than planned does not end any more, s: ramps, and stalls of the machine.
const OVERTIME_S: f64 = 30.0;
/// How often progress is shown.
const LOOK: Duration = Duration::from_millis(100);
/// Time for the robot to hold after the last segment.
const REST: Duration = Duration::from_secs(5);

/// Runs the demonstration and prints its report.
///
/// # Errors
/// Whatever did not work; the processes have ended by then and the run file is closed.
pub fn run(asked: &Demo, domain: Option<&str>, json: bool) -> Answer {
    let config = match &asked.config {
        Some(config) => config.clone(),
        None => default_box()?,
    };
    let file = BoxFile::load(&config).map_err(Failure::bad)?;
    let Some(start) = file.motor_box.as_ref().map(|section| section.start_m.position_m) else {
        return Err(Failure::BadInput(format!(
            "{} has no [motor_box], and a demonstration flies on the virtual motor box only: use `nims up` for a real robot",
            config.display()
        )));
    };
    let mission_path =
        operate::mission_path(asked.mission.as_deref().unwrap_or(&file.planner.demo), Some(&file.planner.missions))?;
    let mission = Mission::read(&mission_path).map_err(Failure::bad)?;
    let flight = findings::fly(&mission, &file, &start)?;

    let wanted = Wanted { box_path: &config, run: asked.run.as_deref(), domain, mission: Some(&mission_path) };
    let mut supervisor = Supervisor::start(&wanted, supervisor::stop_flag()?)?;
    let flown = fly(&mut supervisor, &mission_path, &start, flight.duration_s);
    let ending = supervisor.end(if flown.is_ok() { "the mission was done" } else { "the mission was not done" });
    flown?;

    let report = runlog::info(&ending.run).map_err(Failure::not_now)?;
    let analysis = analysis::analyse(&ending.run)?;
    let picture = ending.run.join("report.svg");
    plot::draw(&picture, &analysis, &format!("{} on {}", mission.name, file.name))?;
    let page = ending.run.join(crate::report::PAGE);
    crate::report::report(std::slice::from_ref(&ending.run), Some(&page))?;
    let mode = ending.mode.map_or("unknown", status::mode_name);
    let value = json!({
        "mission": mission.name, "box": file.name, "planned_s": flight.duration_s, "length_m": flight.length_m, "analysis": analysis,
        "recorded": { "messages": report.messages, "channels": report.channels.len(), "lost": lost(&report), "healthy": report.healthy },
        "mode": mode, "run": ending.run, "picture": picture, "page": page, "died": ending.died,
    });
    let words = words(&mission, &flight, &file, &analysis, &report, &ending.run, &page);
    answers::print(json, &value, &words);
    std::fs::write(ending.run.join("report.json"), format!("{value:#}\n")).map_err(Failure::not_now)?;
    if !ending.died.is_empty() {
        return Err(Failure::NotNow(format!(
            "died on the way: {}; see {}/log",
            ending.died.join(", "),
            ending.run.display()
        )));
    }
    if !report.healthy {
        return Err(Failure::NotNow(format!("the run file is not sound: {}", report.verdict.join("; "))));
    }
    Ok(())
}

/// The box of the demonstration, from the present folder or from where this program was built.
fn default_box() -> Answer<PathBuf> {
    let here = PathBuf::from(DEFAULT_BOX);
    if here.is_file() {
        return Ok(here);
    }
    let own = std::env::current_exe().map_err(Failure::not_now)?;
    own.ancestors().map(|folder| folder.join(DEFAULT_BOX)).find(|path| path.is_file()).ok_or_else(|| {
        Failure::BadInput(format!("there is no {DEFAULT_BOX} here: run it in the project's folder, or name a box file"))
    })
}

/// Arms, says where the node is, flies the mission and waits for its end.
fn fly(supervisor: &mut Supervisor, mission: &Path, start: &[f64; 3], planned_s: f64) -> Answer {
    insist(supervisor, operate::MOTOR_IO, &operate::plain(OperatorRequest::VERB_ARM))?;
    insist(supervisor, operate::MOTOR_IO, &operate::with_args(OperatorRequest::VERB_ZERO_AT, start)?)?;
    let mut estimates = supervisor.bus().subscriber::<NodeEstimate>("node/estimate/a")?;
    wait(supervisor, SETTLE, "the estimator gives no position", |_| {
        Ok(estimates.latest()?.is_some_and(|estimate| estimate.valid == 1))
    })?;
    let mut plans = supervisor.bus().subscriber::<PlanStatus>("plan/status")?;
    insist(supervisor, operate::PLANNER, &operate::run_request(mission, false)?)?;

    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(1000) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("{msg:40} {wide_bar} {percent:>3} %")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.set_style(style);
    let give_up = clock::now_ns() + ((planned_s + OVERTIME_S) * 1e9) as u64;
    let mut running = false;
    loop {
        supervisor.watch(LOOK)?;
        going_on(supervisor)?;
        if let Some(plan) = plans.latest()? {
            let reason = text_of(&plan.reason);
            match plan.state {
                PlanStatus::STATE_RUNNING => running = true,
                PlanStatus::STATE_DONE if running => break,
                PlanStatus::STATE_ABORTED | PlanStatus::STATE_REFUSED => {
                    return Err(Failure::NotNow(format!("the mission was broken off: {reason}")));
                }
                _ => {}
            }
            bar.set_position((1000.0 * plan.progress) as u64);
            bar.set_message(format!(
                "{}, leg {} of {}, {:.0} s left",
                text_of(&plan.mission),
                plan.leg,
                plan.legs,
                plan.time_left_s
            ));
        }
        if clock::now_ns() >= give_up {
            return Err(Failure::NotNow(format!("the mission should have taken {planned_s:.0} s and does not end")));
        }
    }
    bar.finish_and_clear();
    wait(supervisor, REST, "the robot does not come to rest", |supervisor| {
        Ok(supervisor.authority().is_some_and(|authority| authority.mode == MotorAuthority::MODE_HOLDING))
    })
}

/// Asks until it is accepted: just after the start a process may not be ready for it yet.
fn insist(supervisor: &mut Supervisor, process: &str, request: &OperatorRequest) -> Answer {
    let give_up = clock::now_ns() + SETTLE.as_nanos() as u64;
    loop {
        match operate::send(supervisor.bus(), process, request) {
            Ok(_) => return Ok(()),
            Err(failure) if clock::now_ns() >= give_up => return Err(failure),
            Err(_) => {
                supervisor.watch(LOOK)?;
                going_on(supervisor)?;
            }
        }
    }
}

fn wait(
    supervisor: &mut Supervisor,
    patience: Duration,
    what: &str,
    mut done: impl FnMut(&Supervisor) -> Answer<bool>,
) -> Answer {
    let give_up = clock::now_ns() + patience.as_nanos() as u64;
    while !done(supervisor)? {
        if clock::now_ns() >= give_up {
            return Err(Failure::NotNow(format!("{what} within {} s", patience.as_secs())));
        }
        supervisor.watch(LOOK)?;
        going_on(supervisor)?;
    }
    Ok(())
}

/// Whether there is still a point in waiting.
fn going_on(supervisor: &Supervisor) -> Answer {
    if supervisor.is_stopping() {
        return Err(Failure::NotNow("stopped before the mission was done".to_owned()));
    }
    if let Some(authority) = supervisor.authority()
        && matches!(authority.mode, MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP)
    {
        return Err(Failure::NotNow(format!(
            "the robot has stopped: {}",
            motor_io::sentences::faults_of(authority).join(" ")
        )));
    }
    match supervisor.dead_and_vital() {
        Some(name) => Err(Failure::NotNow(format!("{name} has died, so the mission cannot be done"))),
        None => Ok(()),
    }
}

fn lost(report: &runlog::RunReport) -> u64 {
    report.channels.iter().map(|channel| channel.lost).sum()
}

fn words(
    mission: &Mission,
    flight: &findings::Flight,
    file: &BoxFile,
    analysis: &Analysis,
    report: &runlog::RunReport,
    run: &Path,
    page: &Path,
) -> String {
    let millimetres = |error: &analysis::Error| {
        format!(
            "RMS {:.2} mm, max {:.2} mm from the setpoint while it moves",
            1000.0 * error.rms_m,
            1000.0 * error.max_m
        )
    };
    let mut lines = vec![
        format!("mission    {} on {}: {:.2} m in {:.1} s", mission.name, file.name, flight.length_m, flight.duration_s),
        format!("estimate   {}", millimetres(&analysis.estimate)),
    ];
    if let Some(truth) = &analysis.truth {
        lines.push(format!("truth      {}", millimetres(truth)));
    }
    if let Some(tensions) = &analysis.tensions {
        lines.push(format!(
            "tensions   {:.1} to {:.1} N; as chosen within 15 % or 2 N in {:.1} % of the samples, at most {:.2} N off",
            tensions.least_n,
            tensions.greatest_n,
            100.0 * tensions.as_chosen,
            tensions.worst_n
        ));
    }
    lines.push(format!(
        "cycles     {} at {:.0} Hz: {} missed, {} late, {} skipped",
        analysis.cycles, file.rate_hz, analysis.missed, analysis.late, analysis.skipped
    ));
    let bytes: u64 = report.files.iter().map(|file| file.bytes).sum();
    lines.push(format!(
        "recorded   {} messages on {} channels in {:.1} MB, {} lost",
        report.messages,
        report.channels.len(),
        bytes as f64 * 1e-6,
        lost(report)
    ));
    lines.push(format!("run        {}", run.display()));
    lines.push(format!("page       {}", page.display()));
    lines.join("\n")
}
