//! `nims report`: one page about a run, or about several side by side, that a field team understands at once.

mod charts;
mod completeness;
mod deviation;
mod events;
mod explain;
mod gather;
mod html;
mod in_charge;
mod legs;
mod limits;
mod losses;
mod map_charts;
mod maps;
mod robot;
mod samples;
mod tables;
mod trace;
mod value;
mod verdict;
mod wear;

pub use robot::{load_robot_file, robot_of, world_of};

pub use limits::Limits;

use command::values::not_negative;
use command::{Answer, Failure, Output};
use deviation::Scope;
use explain::{Between, Explanation};
use html::RunAssessment;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

/// Name of the page in a run folder.
pub const PAGE: &str = "report.html";
/// Name of the figures in a run folder: what `nims report --json` prints.
pub const FIGURES: &str = "report.json";

/// `nims report`.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// Run folders or files, or the names of finished runs that `nims runs` lists.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// The page; default: report.html in the run folder (for several runs: comparison.html in the folder of the first).
    /// Of a run from the gateway: RUN.html or comparison.html in the current folder. The figures are in the file of the
    /// same name that ends in .json.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Also state the deviations between two times, s since the start of the run, and their causes.
    #[arg(long, num_args = 2, value_names = ["FROM", "TO"], value_parser = not_negative, allow_negative_numbers = true)]
    pub between: Option<Vec<f64>>,
    /// Check the figures of each run against the limits of this file; exit code 1 if one is broken.
    #[arg(long, value_name = "LIMITS.toml")]
    pub check: Option<PathBuf>,
}

impl Args {
    /// Runs `nims report`.
    ///
    /// # Errors
    /// A run or the file of limits does not exist or cannot be read, or the page cannot be written. Broken limits are a
    /// failure beside the output.
    pub fn run(&self) -> Answer<Output> {
        let limits = self.check.as_deref().map(Limits::read).transpose()?;
        let between = match self.between.as_deref() {
            Some([from_s, to_s]) if from_s < to_s => Some([*from_s, *to_s]),
            Some(other) => return Err(Failure::BadInput(format!("--between is {other:?}; accepted: FROM before TO"))),
            None => None,
        };
        write(&self.runs, self.out.as_deref(), between, limits.as_ref())
    }
}

/// Writes the page of some runs.
///
/// # Errors
/// A run does not exist or cannot be read, or the page cannot be written.
pub fn report(runs: &[PathBuf], out: Option<&Path>) -> Answer<Output> {
    write(runs, out, None, None)
}

fn write(runs: &[PathBuf], out: Option<&Path>, between: Option<[f64; 2]>, limits: Option<&Limits>) -> Answer<Output> {
    let Some(first) = runs.first() else {
        return Err(Failure::BadInput("give a run folder or a run file".to_owned()));
    };
    for run in runs {
        crate::runs::require_run(run)?;
    }
    let path = out.map_or_else(|| place(first, runs.len() > 1), Path::to_path_buf);
    let figures = path.with_extension("json");
    if figures == path {
        let name = path.display();
        return Err(Failure::BadInput(format!(
            "--out is {name}, the file of the figures; give the page another ending"
        )));
    }
    let assessments = runs.iter().map(|run| judge(run, between, true)).collect::<Answer<Vec<RunAssessment>>>()?;
    let values: Vec<Value> = assessments.iter().map(value::value).collect();
    let mut words: Vec<String> = assessments.iter().flat_map(sentences).collect();
    let mut all = json!({ "page": path, "figures": figures, "runs": values });
    let checked = limits.map(|limits| limits.check(&all)).transpose()?;
    if let Some(checked) = &checked {
        words.extend(checked.words());
        all["limits"] = json!(checked.rows);
    }
    save(&path, &html::page(&assessments))?;
    let output = Output::new(all, String::new());
    save(&figures, &format!("{}\n", output.value))?;
    words.push(format!("page       {}", path.display()));
    Ok(Output { words: words.join("\n"), ..output }.failing(checked.and_then(|checked| checked.failure())))
}

fn save(path: &Path, text: &str) -> Answer {
    std::fs::write(path, text)
        .map_err(|error| Failure::NotNow(format!("{} cannot be written: {error}", path.display())))
}

/// Returns the verdict of a run, why it was farthest from its setpoint, and what happened at each fault.
fn sentences(assessment: &RunAssessment) -> Vec<String> {
    let RunAssessment { run, verdict, deviations, between, .. } = assessment;
    let mut words = vec![format!("{}: {}", run.name, verdict.sentence)];
    words.extend(deviations.last().map(|worst| format!("deviation  {}", worst.sentence)));
    words.extend(between.iter().flat_map(|between| between.words()));
    let (incidents, _) = run.incidents.all();
    words.extend(incidents.iter().map(|incident| format!("fault      {}", incident.sentence)));
    words.extend(run.lost.words().map(|lost| format!("lost       {lost}")));
    let tensions = run.cables.iter().enumerate().filter_map(|(at, cable)| Some((at + 1, cable.tension.extremes()?[1])));
    let most = tensions.max_by(|one, other| one.1.total_cmp(&other.1));
    words.extend(most.map(|(cable, tension_n)| format!("tension    cable {cable} carried most, {tension_n:.1} N")));
    words
}

/// Returns the figures of a run as `nims report --json` has them below `runs`; shows no progress.
///
/// # Errors
/// The run does not exist or cannot be read.
pub fn figures(run: &Path) -> Answer<Value> {
    crate::runs::require_run(run)?;
    Ok(value::value(&judge(run, None, false)?))
}

/// Reads and assesses a run; `shown`: with a progress bar on a terminal.
fn judge(run: &Path, between: Option<[f64; 2]>, shown: bool) -> Answer<RunAssessment> {
    let bar = if shown && std::io::stderr().is_terminal() { ProgressBar::new(1000) } else { ProgressBar::hidden() };
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} %") {
        bar.set_style(style);
    }
    bar.set_message(run.display().to_string());
    let data = gather::gather(run, between, &mut |share| bar.set_position((1000.0 * share) as u64));
    bar.finish_and_clear();
    let run = data?;
    let mut legs = run.legs.reports(run.robot.as_ref());
    let explained = |scope: Scope| -> Vec<Explanation> {
        let explain =
            |of, max_m, rise: &explain::Rise| explain::explain(of, max_m, rise, run.robot.as_ref(), &run.events);
        run.deviations.explained(scope, explain).into_iter().flatten().collect()
    };
    legs.iter_mut().enumerate().for_each(|(at, leg)| leg.deviations = explained(Scope::Leg(at)));
    let deviations = explained(Scope::Run);
    let between =
        between.map(|between| Between::new(between, run.deviations.errors_between(), explained(Scope::Between)));
    let verdict = verdict::verdict(&run);
    Ok(RunAssessment { verdict, legs, deviations, between, run })
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
