//! The supervisor in the foreground, as `nims up` runs it.

use crate::wakeup::{Stopper, Wakeup};
use crate::{RunOutcome, StartOptions, Supervisor, stale_processes};
use bus::{Domain, clock};
use command::values::seconds;
use command::{Answer, Failure, Output};
use config::SystemFile;
use robot_state::sentences::mode_name;
use serde_json::{Value, json};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The page of a run, which `nims report` makes.
const PAGE: &str = "report.html";
/// Largest run whose page is made automatically, bytes: the page of a larger run takes too long.
const LARGE: u64 = 300_000_000;

/// Command-line arguments of `nims up`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// System file.
    pub config: PathBuf,
    /// Stop after this many seconds.
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Run folder; default: a new one in the system's runs folder.
    #[arg(long, value_name = "DIR")]
    pub run: Option<PathBuf>,
    /// Start nothing: bring the robot of a dead supervisor to rest and end its processes in order, as every start does
    /// first. A service calls it after its end.
    #[arg(long, conflicts_with_all = ["seconds", "run"])]
    pub end_remaining: bool,
    /// Also show and fly the robot in a browser, by the program nims-page, which scripts/page builds. Nothing depends
    /// on it.
    #[arg(long)]
    pub page: bool,
    /// Mission that will be flown; a copy is stored in the run folder.
    #[arg(long, hide = true)]
    pub mission: Option<PathBuf>,
    /// Started by another program: end at the end of standard input, whose text is the reason, and report a failure on
    /// stdout.
    #[arg(long, hide = true)]
    pub parent: bool,
}

/// Starts the robot, watches it until its end is requested, and ends it.
///
/// # Errors
/// It did not come up, or the supervisor itself failed.
pub fn run(args: &Args, domain: Option<&str>) -> Answer<Output> {
    if args.end_remaining {
        return end_remaining(&args.config, domain);
    }
    let (ending, watched) = match watch(args, domain) {
        Err(failure) if args.parent => return Ok(Output::json(failed(&failure))),
        other => other?,
    };
    let run = &ending.run;
    let mode = ending.mode.map_or("unknown", mode_name);
    let mut words = vec![format!("the robot is left in mode {mode}; {}", ending.place())];
    // The page shows why a mission was not completed.
    let page = ending.unfinished.as_ref().map(|_| page(run));
    words.extend(ending.unfinished.clone());
    match &page {
        Some(Ok(page)) => words.push(format!("page       {}", page.display())),
        Some(Err(sentence)) => words.push(sentence.clone()),
        None => {}
    }
    let value = json!({
        "run": run, "mode": mode, "died": ending.died, "unrecorded": ending.unrecorded, "unfinished": ending.unfinished,
        "page": page.and_then(Result::ok),
    });
    let failure = watched.err().or_else(|| ending.failed().map(Failure::NotNow));
    let output = Output::new(value, words.join("\n"));
    if args.parent {
        let mut value = output.value;
        value["place"] = json!(ending.place());
        value["failed"] = json!(failure.map(|failure| failure.to_string()));
        return Ok(Output::json(value));
    }
    Ok(output.failing(failure))
}

/// Ends what an earlier supervisor of the domain left.
///
/// # Errors
/// The robot runs under a living supervisor, or a process cannot be ended.
fn end_remaining(config: &Path, domain: Option<&str>) -> Answer<Output> {
    bus::make_private();
    let domain = match domain {
        Some(name) => Domain::parse(name)?,
        None => Domain::parse(&SystemFile::load(config).map_err(Failure::bad)?.name)?,
    };
    let claim = domain.claim()?;
    let ended = stale_processes::end(&domain)?;
    domain.sweep()?;
    let _ = domain.release(claim);
    let text = if ended.is_empty() { "nothing remained".to_owned() } else { format!("ended: {}", ended.join(", ")) };
    Ok(Output::new(json!({ "ended": ended }), text))
}

/// The failure as JSON, for the parent program.
fn failed(failure: &Failure) -> Value {
    json!({ "failed": failure.to_string(), "bad_input": failure.exit_code() == 2 })
}

/// Lets every process check its part of the system file, so that errors appear before any process is started.
fn accepted(config: &Path) -> Answer {
    let nims = std::env::current_exe().map_err(Failure::not_now)?.with_file_name("nims");
    if !nims.is_file() {
        return Ok(());
    }
    let checked = Command::new(nims).args(["check", "--accepted"]).arg(config).stdin(Stdio::null()).output();
    let checked = checked.map_err(Failure::not_now)?;
    if checked.status.success() {
        return Ok(());
    }
    let sentence = String::from_utf8_lossy(&checked.stderr);
    Err(Failure::BadInput(sentence.trim().trim_start_matches("nims: ").to_owned()))
}

/// Starts the page beside the robot, with a gateway of its own.
fn start_page(config: &Path, domain: Option<&str>) -> Answer<Child> {
    let program = std::env::current_exe().map_err(Failure::not_now)?.with_file_name("nims-page");
    if !program.is_file() {
        return Err(Failure::NotNow(
            "the page is not built; build it with scripts/page, or leave --page out".to_owned(),
        ));
    }
    let mut command = Command::new(program);
    command.args(["start", "--parent"]).args(domain.into_iter().flat_map(|domain| ["--domain", domain]));
    command.arg(config).stdin(Stdio::piped()).stdout(std::io::stderr()).spawn().map_err(Failure::not_now)
}

/// Makes the page of a run with the `nims` beside this program; the error names the command that makes it.
fn page(run: &Path) -> Result<PathBuf, String> {
    let cure = || format!("`nims report {}` makes its page", run.display());
    let nims = std::env::current_exe().map_err(|_| cure())?.with_file_name("nims");
    let bytes: u64 = std::fs::read_dir(run)
        .map_err(|_| cure())?
        .flatten()
        .filter_map(|file| file.metadata().ok())
        .map(|file| file.len())
        .sum();
    if bytes > LARGE {
        return Err(format!("the run has {:.0} MB: {}", bytes as f64 * 1e-6, cure()));
    }
    let made = Command::new(nims).arg("report").arg(run).stdout(Stdio::null()).stderr(Stdio::null()).status();
    let page = run.join(PAGE);
    if made.is_ok_and(|status| status.success()) && page.is_file() { Ok(page) } else { Err(cure()) }
}

/// Starts, watches and ends the robot; returns how the run ended and the supervisor's own failure.
///
/// # Errors
/// A process did not come up.
fn watch(asked: &Args, domain: Option<&str>) -> Answer<(RunOutcome, Answer)> {
    let wanted = StartOptions {
        system_path: &asked.config,
        run: asked.run.as_deref(),
        domain,
        mission: asked.mission.as_deref(),
    };
    let began = clock::now_ns();
    accepted(&asked.config)?;
    let wakeup = Wakeup::of_signals()?;
    let reason = if asked.parent { parent_reason(wakeup.stopper()?) } else { Arc::default() };
    // It ends when this process closes its standard input.
    let _page = asked.page.then(|| start_page(&asked.config, domain)).transpose()?;
    let mut supervisor = Supervisor::start(&wanted, wakeup)?;
    supervisor.announcer.info(&format!(
        "{} is ready to arm after {:.2} s and runs in {}; Ctrl-C ends it",
        supervisor.context.file.name,
        (clock::now_ns() - began) as f64 * 1e-9,
        supervisor.folder.path().display()
    ));
    let watched = supervisor.watch(asked.seconds.map_or(Duration::MAX, Duration::from_secs_f64));
    let because = match &watched {
        Err(failure) => failure.to_string(),
        Ok(()) if supervisor.is_stopping() => {
            let reason = reason.lock().unwrap_or_else(PoisonError::into_inner).take();
            reason.unwrap_or_else(|| command::SIGNAL.to_owned())
        }
        Ok(()) => "the time given by --for is over".to_owned(),
    };
    // Also after a failure, so that no process outlives its supervisor.
    let ending = supervisor.end(&because);
    Ok((ending, watched))
}

/// Reads standard input on its own thread and requests the end of the run when it ends; its text is the reason.
fn parent_reason(stopper: Stopper) -> Arc<Mutex<Option<String>>> {
    let reason = Arc::new(Mutex::new(None));
    let told = Arc::clone(&reason);
    std::thread::spawn(move || {
        let mut text = String::new();
        let _ = std::io::stdin().read_to_string(&mut text);
        let because = if text.trim().is_empty() { "its parent ended".to_owned() } else { text.trim().to_owned() };
        *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(because);
        stopper.stop();
    });
    reason
}
