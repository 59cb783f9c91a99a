//! `nims demo`: the whole robot on the virtual motor box, from nothing to a report.

mod flying;
mod robot;

use crate::operate::{self, MissionText};
use analysis::accuracy::{self, Analysis};
use analysis::accuracy_plot;
use command::{Answer, Failure, Output};
use commissioning::check::{self, Flight};
use config::SystemFile;
use planner::mission::Mission;
use robot::{Ending, Robot, Wanted};
use serde_json::json;
use std::path::{Path, PathBuf};

/// `nims demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// System file; default: configs/systems/demo3.toml.
    pub config: Option<PathBuf>,
    /// Mission file; default: the one that the box names, `demo` if it names none.
    #[arg(long)]
    pub mission: Option<PathBuf>,
    /// Run folder; default: a new one in the box's runs folder.
    #[arg(long, value_name = "DIR")]
    pub run: Option<PathBuf>,
}

/// Where the demonstration's system file stands in the project.
const DEFAULT_BOX: &str = "configs/systems/demo3.toml";
/// Runs the demonstration, and reports.
///
/// # Errors
/// Whatever did not work; the processes have ended by then, the run file is closed and the report is written.
pub fn run(asked: &Args, domain: Option<&str>) -> Answer<Output> {
    let config = match &asked.config {
        Some(config) => config.clone(),
        None => default_box()?,
    };
    let file = SystemFile::load(&config).map_err(Failure::bad)?;
    let Some(start) = file.motor_box.as_ref().map(|section| section.start_m.position_m) else {
        return Err(Failure::BadInput(format!(
            "{} has no [motor_box], and a demonstration flies on the virtual motor box only: use `nims up` for a real robot",
            config.display()
        )));
    };
    let path =
        operate::mission_path(asked.mission.as_deref().unwrap_or(&file.planner.demo), Some(&file.planner.missions))?;
    let text = MissionText::read(&path)?;
    let mission = &text.mission;
    let flight = check::fly(mission, &file, &start)?;
    check::can_be_built(&file)?;

    let domain = domain.unwrap_or(&file.name);
    let wanted = Wanted { config: &config, domain, run: asked.run.as_deref(), mission: &path };
    let mut robot = Robot::start(&wanted, command::stop_flag()?)?;
    let flown = flying::fly(&mut robot, &text, &start, flight.duration_s);
    let because = flown.as_ref().err().map_or_else(|| "the mission was done".to_owned(), ToString::to_string);
    let ending = robot.end(&because)?;
    let told = Told { mission, flight: &flight, file: &file, ending: &ending };
    let broken_off = flown.err();
    match told.report(broken_off.as_ref().map(|_| because.as_str())) {
        Ok((output, unsound)) => Ok(output.failing(failure(broken_off, &ending, Ok(unsound)))),
        Err(why) => {
            let why_not = why.clone();
            Err(failure(broken_off, &ending, Err(why)).unwrap_or(why_not))
        }
    }
}

/// How the demonstration failed, if it did: all that went wrong, and where the run is, in one sentence.
fn failure(broken_off: Option<Failure>, ending: &Ending, told: Answer<Option<String>>) -> Option<Failure> {
    let exit = broken_off.clone();
    let mut parts: Vec<String> = broken_off
        .iter()
        .map(|why| format!("the demonstration was broken off: {}", end_of(&why.to_string())))
        .collect();
    parts.extend(ending.failed.clone());
    match told {
        Ok(unsound) => parts.extend(unsound.map(|unsound| format!("the run file is not sound: {unsound}"))),
        Err(failure) => parts.push(failure.to_string()),
    }
    if parts.is_empty() {
        return None;
    }
    let sentence = format!("{}; {}", parts.join("; "), ending.place);
    Some(match exit {
        Some(Failure::BadInput(_)) => Failure::BadInput(sentence),
        _ => Failure::NotNow(sentence),
    })
}

/// Without the full stop, where the sentence goes on.
fn end_of(sentence: &str) -> &str {
    sentence.trim_end_matches('.')
}

/// What there is to tell about a demonstration that has ended.
struct Told<'a> {
    mission: &'a Mission,
    flight: &'a Flight,
    file: &'a SystemFile,
    ending: &'a Ending,
}

impl Told<'_> {
    /// Writes the report into the run folder and prints it, also of a mission that was `broken_off`; what of the run file is not sound.
    fn report(&self, broken_off: Option<&str>) -> Answer<(Output, Option<String>)> {
        let Self { mission, flight, file, ending } = self;
        let run = &ending.run;
        let report = runlog::info(run).map_err(Failure::not_now)?;
        // Where nothing moved, there is nothing to draw; the page says what happened instead.
        let analysis = accuracy::analyse(run).ok();
        let picture = run.join("report.svg");
        if let Some(analysis) = &analysis {
            accuracy_plot::draw(&picture, analysis, &format!("{} on {}", mission.name, file.name))?;
        }
        let page = run.join(analysis::report::PAGE);
        let verdict = analysis::report::report(std::slice::from_ref(run), Some(&page))?.words;
        let value = json!({
            "mission": mission.name, "box": file.name, "planned_s": flight.duration_s, "length_m": flight.length_m, "analysis": analysis,
            "recorded": { "messages": report.messages, "channels": report.channels.len(), "lost": lost(&report), "healthy": report.healthy },
            "mode": ending.mode, "run": run, "picture": analysis.as_ref().map(|_| &picture), "page": page, "died": ending.value["died"],
            "unrecorded": ending.value["unrecorded"], "broken_off": broken_off,
        });
        let words = match (&analysis, broken_off) {
            (Some(analysis), None) => words(mission, flight, file, analysis, &report, run, &page),
            // The verdict has the figures of what was flown.
            _ => format!("{}\nrun        {}", verdict, run.display()),
        };
        std::fs::write(run.join("report.json"), format!("{value:#}\n")).map_err(Failure::not_now)?;
        Ok((Output::new(value, words), (!report.healthy).then(|| report.verdict.join("; "))))
    }
}

/// The box of the demonstration, from the present folder or from where this program was built.
fn default_box() -> Answer<PathBuf> {
    let here = PathBuf::from(DEFAULT_BOX);
    if here.is_file() {
        return Ok(here);
    }
    let own = std::env::current_exe().map_err(Failure::not_now)?;
    own.ancestors().map(|folder| folder.join(DEFAULT_BOX)).find(|path| path.is_file()).ok_or_else(|| {
        Failure::BadInput(format!(
            "there is no {DEFAULT_BOX} here: run it in the project's folder, or name a system file"
        ))
    })
}

fn lost(report: &runlog::RunReport) -> u64 {
    report.channels.iter().map(|channel| channel.lost).sum()
}

fn words(
    mission: &Mission,
    flight: &Flight,
    file: &SystemFile,
    analysis: &Analysis,
    report: &runlog::RunReport,
    run: &Path,
    page: &Path,
) -> String {
    let millimetres = |error: &accuracy::Error| {
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
    lines.push(format!("steered    {}: {}", analysis.periods.leading(), analysis.periods.by_cause()));
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
