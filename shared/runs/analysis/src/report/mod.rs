//! `nims report`: one page about a run, or about several side by side, that a field team understands at once.

mod charts;
mod completeness;
mod events;
mod gather;
mod html;
mod legs;
mod map_charts;
mod maps;
mod robot;
mod samples;
mod trace;
mod verdict;

pub use robot::{load_robot_file, robot_of, world_of};

use command::{Answer, Failure, Output};
use html::RunAssessment;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

/// Name of the page in a run folder.
pub const PAGE: &str = "report.html";

/// Runs `nims report`.
///
/// # Errors
/// A run does not exist or cannot be read, or the page cannot be written.
pub fn report(runs: &[PathBuf], out: Option<&Path>) -> Answer<Output> {
    let Some(first) = runs.first() else {
        return Err(Failure::BadInput("give a run folder or a run file".to_owned()));
    };
    for run in runs {
        crate::runs::require_run(run)?;
    }
    let path = out.map_or_else(|| place(first, runs.len() > 1), Path::to_path_buf);
    let mut assessments = Vec::new();
    for run in runs {
        assessments.push(judge(run)?);
    }
    std::fs::write(&path, html::page(&assessments))
        .map_err(|error| Failure::NotNow(format!("the page {} cannot be written: {error}", path.display())))?;
    let values: Vec<Value> = assessments.iter().map(value).collect();
    let mut words: Vec<String> = assessments
        .iter()
        .map(|assessment| format!("{}: {}", assessment.run.name, assessment.verdict.sentence))
        .collect();
    words.push(format!("page       {}", path.display()));
    Ok(Output::new(json!({ "page": path, "runs": values }), words.join("\n")))
}

fn judge(run: &Path) -> Answer<RunAssessment> {
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(1000) } else { ProgressBar::hidden() };
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} %") {
        bar.set_style(style);
    }
    bar.set_message(run.display().to_string());
    let data = gather::gather(run, &mut |share| bar.set_position((1000.0 * share) as u64));
    bar.finish_and_clear();
    let run = data?;
    let legs = run.legs.reports(run.robot.as_ref());
    let verdict = verdict::verdict(&run);
    Ok(RunAssessment { run, verdict, legs })
}

/// Returns the default path of the page: in the run folder, or next to the run file.
fn place(run: &Path, several: bool) -> PathBuf {
    let name = if several { "comparison.html" } else { PAGE };
    if run.is_dir() {
        return run.join(name);
    }
    let text = run.to_string_lossy();
    let stem = text.trim_end_matches(runlog::PART_ENDING).trim_end_matches(runlog::FILE_ENDING);
    PathBuf::from(format!("{stem}-{name}"))
}

fn value(assessment: &RunAssessment) -> Value {
    let RunAssessment { run, verdict, legs } = assessment;
    let times: Vec<Value> = ["wake", "bus", "command_age"]
        .into_iter()
        .zip(&run.times)
        .map(|(name, times)| {
            let ns = |share: f64| times.all.value_at_quantile(share);
            json!({ "what": name, "samples": times.all.len(), "p50_ns": ns(0.5), "p99_ns": ns(0.99), "max_ns": times.all.max() })
        })
        .collect();
    let cables: Vec<Value> = run
        .cables
        .iter()
        .map(|cable| {
            json!({
                "length_m": cable.length.extremes(), "velocity_m_s": cable.velocity.extremes(), "tension_n": cable.tension.extremes(),
                "true_tension_n": cable.true_tension.extremes(), "current_a": cable.current.extremes(),
                "energy_j": cable.energy_j, "loss_j": cable.loss_j,
            })
        })
        .collect();
    let sensors: Vec<Value> = run
        .sensors
        .channels()
        .iter()
        .map(|(name, sensor)| json!({ "channel": name, "samples": sensor.samples, "doubtful": sensor.doubtful }))
        .collect();
    json!({
        "run": run.name, "verdict": verdict, "analysis": run.analysis, "flown_m": run.legs.flown_m(), "legs": legs, "cables": cables,
        "times": times, "faults": run.events.faults, "events": run.events.all(), "sensors": sensors, "missions_done": run.missions,
        "lacks": run.lacks, "recording": { "healthy": run.recording.healthy, "verdict": run.recording.verdict,
            "duration_s": run.recording.duration_s, "messages": run.recording.messages },
    })
}
