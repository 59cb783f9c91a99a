//! `nims demo`: starts a robot on the virtual motor box, flies a mission, and writes the report.

mod flying;
mod robot;

use crate::operate::MissionText;
use crate::programs::sibling;
use analysis::accuracy::{self, Analysis};
use analysis::report::world_of;
use analysis::{accuracy_plot, portrait};
use command::{Answer, Failure, Output};
use commissioning::check::{self, Flight};
use config::SystemFile;
use planner::mission::Mission;
use robot::{Ending, Robot, StartOptions};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// `nims demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// System file; default: configs/systems/field3.toml, or /usr/share/nims/systems/field3.toml.
    pub config: Option<PathBuf>,
    /// Mission file; default: `planner.demo` of the system file.
    #[arg(long)]
    pub mission: Option<PathBuf>,
    /// Run folder; default: a new one in the runs folder of the system file.
    #[arg(long, value_name = "DIR")]
    pub run: Option<PathBuf>,
    /// Also show and fly it in a browser, until Ctrl-C.
    #[arg(long)]
    pub page: bool,
}

/// The default system file, in the project's folder.
const DEFAULT_SYSTEM: &str = "configs/systems/field3.toml";

/// What the figures of the summary mean.
const MEANING: &str = "\
meaning    estimate: how far the robot saw itself from where it should be; truth: how far it really was
           model: the difference, which the robot cannot see; a real robot shows no truth
           stated: how large the estimates say that this difference may be
           steered: control cycles in which no fresh command reached the drives, by what was late:
           this computer, the drives, their serial port, or estimator and controller";

/// Runs the demonstration and writes the report.
///
/// # Errors
/// Everything that failed, in one sentence. Before it returns, the processes are ended, the run file is closed and the
/// report is written.
pub fn run(args: &Args, domain: Option<&str>) -> Answer<Output> {
    let config = match &args.config {
        Some(config) => config.clone(),
        None => default_system()?,
    };
    let file = SystemFile::load(&config).map_err(Failure::bad)?;
    let robot_file = file.robot_file().map_err(Failure::bad)?;
    let Some(start) = check::virtual_start_m(&file, &robot_file)? else {
        return Err(Failure::BadInput(format!(
            "{} has no [motor_box]; the demonstration needs the virtual motor box: use `nims up` for a real robot",
            config.display()
        )));
    };
    let path =
        command::mission_path(args.mission.as_deref().unwrap_or(&file.planner.demo), Some(&file.planner.missions))?;
    let text = MissionText::read(&path)?;
    let mission = &text.mission;
    let flight = check::fly(mission, &file, &start)?;
    check::can_be_built(&file)?;

    let domain = domain.unwrap_or(&file.name);
    let options = StartOptions { config: &config, domain, run: args.run.as_deref(), mission: &path };
    // It ends when this process closes its standard input.
    let page = args.page.then(|| start_page(&config, domain)).transpose()?;
    let mut robot = Robot::start(&options, command::stop_flag()?)?;
    let flown = flying::fly(&mut robot, &text, &start, flight.duration_s);
    if page.is_some() {
        eprintln!("nims: the robot stays for the page; Ctrl-C ends it");
        while !robot.is_stopping() && robot.poll_after(flying::POLL).is_ok() {}
    }
    let because = flown.as_ref().err().map_or_else(|| "the mission is done".to_owned(), ToString::to_string);
    let ending = robot.end(&because)?;
    let report = Report { mission, flight: &flight, file: &file, ending: &ending };
    let aborted = flown.err();
    match report.write(aborted.as_ref().map(|_| because.as_str())) {
        Ok((output, unsound)) => Ok(output.failing(failure(aborted, &ending, Ok(unsound)))),
        Err(why) => {
            let report_failure = why.clone();
            Err(failure(aborted, &ending, Err(why)).unwrap_or(report_failure))
        }
    }
}

fn start_page(config: &Path, domain: &str) -> Answer<Child> {
    let unbuilt = |_| Failure::NotNow("the page is not built; build it with scripts/page".to_owned());
    let mut command = Command::new(sibling("nims-page").map_err(unbuilt)?);
    command.args(["start", "--parent", "--domain", domain]).arg(config).stdin(Stdio::piped()).stdout(std::io::stderr());
    command.spawn().map_err(Failure::not_now)
}

/// Returns everything that failed, and where the run is, as one sentence; `None` if nothing failed.
fn failure(aborted: Option<Failure>, ending: &Ending, report: Answer<Option<String>>) -> Option<Failure> {
    let mut parts: Vec<String> = aborted
        .iter()
        .map(|why| format!("the demonstration was aborted: {}", without_full_stop(&why.to_string())))
        .collect();
    parts.extend(ending.failed.clone());
    match report {
        Ok(unsound) => parts.extend(unsound.map(|unsound| format!("the run file is damaged: {unsound}"))),
        Err(failure) => parts.push(failure.to_string()),
    }
    if parts.is_empty() {
        return None;
    }
    let sentence = format!("{}; {}", parts.join("; "), ending.place);
    Some(match aborted {
        Some(failure) => failure.with_sentence(sentence),
        None => Failure::NotNow(sentence),
    })
}

fn without_full_stop(sentence: &str) -> &str {
    sentence.trim_end_matches('.')
}

/// The inputs of the report on a demonstration that has ended.
struct Report<'a> {
    mission: &'a Mission,
    flight: &'a Flight,
    file: &'a SystemFile,
    ending: &'a Ending,
}

impl Report<'_> {
    /// Writes the report into the run folder. Returns the output, and what is damaged in the run file, if anything.
    /// `aborted` is the reason why the mission was not completed.
    fn write(&self, aborted: Option<&str>) -> Answer<(Output, Option<String>)> {
        let Self { mission, flight, file, ending } = self;
        let run = &ending.run;
        let report = runlog::info(run).map_err(Failure::not_now)?;
        // A run without motion cannot be analysed; its report page still lists the events.
        let analysis = accuracy::analyse(run).ok();
        let picture = run.join("report.svg");
        if let Some(analysis) = &analysis {
            accuracy_plot::draw(&picture, analysis, &format!("{} on {}", mission.name, file.name))?;
            let robot = file.robot_file().map_err(Failure::bad)?.robot().map_err(Failure::bad)?;
            portrait::draw(&run.join("robot.svg"), &robot, analysis)?;
        }
        let page = run.join(analysis::report::PAGE);
        let verdict = analysis::report::report(std::slice::from_ref(run), Some(&page))?.words;
        let value = json!({
            "mission": mission.name, "system": file.name, "planned_s": flight.duration_s, "length_m": flight.length_m, "analysis": analysis,
            "recorded": { "messages": report.messages, "channels": report.channels.len(), "lost": lost(&report), "healthy": report.healthy },
            "mode": ending.mode, "run": run, "picture": analysis.as_ref().map(|_| &picture), "page": page, "died": ending.value["died"],
            "unrecorded": ending.value["unrecorded"], "broken_off": aborted,
        });
        let words = match (&analysis, aborted) {
            (Some(analysis), None) => {
                let summary = words(mission, flight, file, analysis, &report, run, &page);
                // The sentence follows the name of the run.
                let sentence =
                    verdict.lines().next().and_then(|line| line.split_once(": ")).map_or("", |(_, said)| said);
                format!("{summary}\nverdict    {sentence}\n{MEANING}")
            }
            // The verdict has the figures of the completed part.
            _ => format!("{}\nrun        {}", verdict, run.display()),
        };
        Ok((Output::new(value, words), (!report.healthy).then(|| report.verdict.join("; "))))
    }
}

/// Returns the default system file in the current folder, in a folder above this program, or of the installation.
fn default_system() -> Answer<PathBuf> {
    let program = std::env::current_exe().map_err(Failure::not_now)?;
    let projects = [Path::new("")].into_iter().chain(program.ancestors()).map(|folder| folder.join(DEFAULT_SYSTEM));
    let installed = Path::new(config::EXAMPLES).join("systems/field3.toml");
    projects.chain([installed]).find(|path| path.is_file()).ok_or_else(|| {
        Failure::BadInput(format!(
            "there is no {DEFAULT_SYSTEM} here: run `nims demo` in the project's folder, or give a system file"
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
    let millimetres = |error: &accuracy::Error, from: &str| {
        format!("RMS {:.2} mm, max {:.2} mm from the {from} while moving", 1000.0 * error.rms_m, 1000.0 * error.max_m)
    };
    let mut lines = vec![
        format!("mission    {} on {}: {:.2} m in {:.1} s", mission.name, file.name, flight.length_m, flight.duration_s),
        format!("estimate   {}", millimetres(&analysis.estimate, "setpoint")),
    ];
    if let Some(truth) = &analysis.truth {
        lines.push(format!("truth      {}", millimetres(truth, "setpoint")));
    }
    if let Some(model) = &analysis.model {
        lines.push(format!("model      {}", millimetres(model, "truth to the estimate")));
    }
    lines.push(format!("stated     {}", analysis.stated));
    lines.extend(world_of(run, &[]).map(|world| format!("world      {world}")));
    if let Some(tensions) = &analysis.tensions {
        lines.push(format!(
            "tensions   {:.1} to {:.1} N; within 15 % or 2 N of the chosen ones in {:.1} % of the samples, at most {:.2} N off",
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
