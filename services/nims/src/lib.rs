//! The operator's command: supervisor, requests, live views, and tools that need no robot.
//!
//! Invariants:
//! * It moves nothing itself: it asks motor-io and the planner, and prints their answer.
//! * Exit code 0: answered (also "not feasible", which is an answer); 2: bad input; 1: it could not be done now. A failure is one
//!   sentence on stderr. With `--json`, stdout holds one JSON object and nothing else.
//! * Bad input is found before anything is started or asked.

#![forbid(unsafe_code)]

mod answers;
mod bench;
mod busy;
mod calibrate;
mod channels;
pub mod cli;
pub mod counters;
pub mod demo;
mod doctor;
mod export;
mod failure;
pub mod fault;
pub mod findings;
pub mod live;
pub mod lockstep;
pub mod map;
pub mod motor_table;
mod new_sensor;
mod offline;
mod operate;
mod page;
pub mod paper;
pub mod picture;
pub mod plan;
pub mod points;
pub mod processes;
pub mod replay;
pub mod report;
mod runs;
mod set;
mod setup;
pub mod solve;
mod status;
pub mod supervisor;
mod swap;
mod top;
pub mod tracker;
pub mod visualization_export;
mod workspace;

pub use failure::{Answer, Failure};

use bus::Party;
use clap::Parser;
use cli::{Channel, Cli, Command};
use messages::OperatorRequest;
use serde_json::json;
use std::ffi::OsString;
use std::process::ExitCode;

/// Parses, runs, and says in one sentence what went wrong.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) if error.exit_code() == 0 => {
            // --help and --version
            let _ = error.print();
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("nims: {}", usage(&error));
            return ExitCode::from(2);
        }
    };
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("nims: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

/// The first paragraph of a complaint about the arguments, on one line.
fn usage(error: &clap::Error) -> String {
    use clap::error::ErrorKind;
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "say what to do; `nims --help` lists the commands".to_owned();
    }
    let text = error.to_string();
    let first: Vec<&str> =
        text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more")).collect();
    let sentence = first.join(" ").split_whitespace().collect::<Vec<_>>().join(" ");
    format!("{}; `nims --help` lists the commands", sentence.trim_start_matches("error: "))
}

/// Carries one command out and prints its answer.
///
/// # Errors
/// One sentence.
pub fn run(cli: &Cli) -> Answer {
    let (domain, json) = (cli.domain.as_deref(), cli.json);
    let print = |value: &serde_json::Value, words: &str| answers::print(json, value, words);
    let ask = |process: &str, verb: u8| -> Answer {
        // what brings the robot to rest may take the places that other commands leave
        let stops = matches!(
            verb,
            OperatorRequest::VERB_HOLD
                | OperatorRequest::VERB_STOP
                | OperatorRequest::VERB_PAUSE
                | OperatorRequest::VERB_DISARM
        );
        let party = if stops { Party::Member } else { Party::Command };
        let sentence = operate::send(&live::join_as(domain, party)?, process, &operate::plain(verb))?;
        print(&operate::accepted(&sentence), &sentence);
        Ok(())
    };
    let asked = |sentence: String| {
        print(&operate::accepted(&sentence), &sentence);
        Ok(())
    };
    let tell = |asked: supervisor::Asked| -> Answer {
        let (value, words) = processes::tell(&live::join(domain)?, &asked)?;
        print(&value, &words);
        Ok(())
    };
    match &cli.command {
        Command::Demo(asked) => demo::run(asked, domain, json),
        Command::Up(asked) => up(asked, domain, json),
        Command::Status => {
            let (value, words) = status::status(&live::join(domain)?)?;
            print(&value, &words);
            Ok(())
        }
        Command::Top => top::top(domain, json),
        Command::Channel(channel) => channel_command(channel, domain, json),
        Command::Arm => ask(operate::MOTOR_IO, OperatorRequest::VERB_ARM),
        Command::Disarm => ask(operate::MOTOR_IO, OperatorRequest::VERB_DISARM),
        Command::Hold => ask(operate::MOTOR_IO, OperatorRequest::VERB_HOLD),
        Command::Stop => ask(operate::MOTOR_IO, OperatorRequest::VERB_STOP),
        Command::Estop => asked(live::emergency_stop(domain)?),
        Command::Reset => ask(operate::MOTOR_IO, OperatorRequest::VERB_RESET),
        Command::ConfirmPosition => ask(operate::MOTOR_IO, OperatorRequest::VERB_CONFIRM_POSITION),
        Command::Pause => ask(operate::MOTOR_IO, OperatorRequest::VERB_PAUSE),
        Command::Resume => ask(operate::MOTOR_IO, OperatorRequest::VERB_RESUME),
        Command::Zero(zero) => asked(operate::zero(&live::join(domain)?, zero)?),
        Command::Jog { cable, metres } => asked(operate::jog(&live::join(domain)?, *cable, *metres)?),
        Command::Speed { percent } => asked(operate::speed(&live::join(domain)?, *percent)?),
        Command::Goto(goto) => asked(operate::goto(&live::join(domain)?, goto)?),
        Command::Run(mission) if mission.dry_run => {
            let (value, words) = operate::dry_run(domain, mission)?;
            print(&value, &words);
            Ok(())
        }
        Command::Run(mission) => asked(operate::run_checked(&live::join(domain)?, mission)?),
        Command::Start(start) => {
            let (value, words) = processes::start(&live::join(domain)?, start)?;
            print(&value, &words);
            Ok(())
        }
        Command::Swap(asked) => {
            let bus = live::join(domain)?;
            let (value, words) = if asked.admit { swap::admit(&bus, asked)? } else { swap::swap(&bus, asked)? };
            print(&value, &words);
            Ok(())
        }
        Command::Set(asked) => {
            let (value, words) = set::set(domain, asked)?;
            print(&value, &words);
            Ok(())
        }
        Command::StopProcess { process } => tell(supervisor::Asked::Stop { name: process.clone() }),
        Command::Restart { process } => tell(supervisor::Asked::Restart { name: process.clone() }),
        Command::Plug(plug) => {
            let (value, words) = processes::plug(&live::join(domain)?, plug)?;
            print(&value, &words);
            Ok(())
        }
        Command::NewSensor(asked) => {
            let (value, words) = new_sensor::new_sensor(asked)?;
            print(&value, &words);
            Ok(())
        }
        Command::Unplug { process } => tell(supervisor::Asked::Unplug { name: process.clone() }),
        Command::Fault { words, seconds } => {
            let (value, words) = fault::fault(domain, words, *seconds)?;
            print(&value, &words);
            Ok(())
        }
        Command::Check { config, on } => check(config, on.as_deref(), json),
        Command::Ik { config, at } => offline::ik(config, at).map(|value| answers::print(true, &value, "")),
        Command::Doctor { config } => doctor(config.as_deref(), json),
        Command::Bench(asked) => {
            let (value, words) = bench::bench(asked)?;
            print(&value, &words);
            Ok(())
        }
        Command::BenchPeer { place } => bench::peer::serve(place),
        Command::Fk { config, lengths } => offline::fk(config, lengths).map(|value| answers::print(true, &value, "")),
        Command::Tension(tension) => offline::tensions(tension).map(|value| answers::print(true, &value, "")),
        Command::Paper { figures, out } => {
            let (value, words) = paper::paper(figures, out)?;
            print(&value, &words);
            Ok(())
        }
        Command::Plan(asked) => plan::plan(asked).map(|value| answers::print(true, &value, "")),
        Command::Workspace(asked) => workspace::workspace(asked).map(|value| answers::print(true, &value, "")),
        Command::Solve => solve::serve(std::io::stdin(), std::io::stdout().lock()).map_err(Failure::not_now),
        Command::Calibrate(asked) => calibrate::calibrate(asked, json).map(|value| answers::print(true, &value, "")),
        Command::Setup(asked) => {
            let (value, words) = setup::setup(asked)?;
            print(&value, &words);
            Ok(())
        }
        Command::MotorTable(asked) => {
            let (value, words) = motor_table::motor_table(asked)?;
            print(&value, &words);
            Ok(())
        }
        Command::Export(asked) => {
            let (value, words) = match &asked.visualization {
                Some(file) => visualization_export::export_visualization(&asked.run, file)?,
                None => export::export(asked)?,
            };
            print(&value, &words);
            Ok(())
        }
        Command::Map(asked) => {
            let (value, words) = map::map(asked)?;
            print(&value, &words);
            Ok(())
        }
        Command::Recover { run } => {
            let (value, words) = runs::recover(run)?;
            print(&value, &words);
            Ok(())
        }
        Command::Replay(asked) => replay::replay(asked, json),
        Command::Report { runs, out } => {
            let (value, words) = report::report(runs, out.as_deref())?;
            print(&value, &words);
            Ok(())
        }
        Command::Info { run } => {
            let (value, words) = runs::info(run)?;
            print(&value, &words);
            Ok(())
        }
    }
}

fn up(asked: &cli::Up, domain: Option<&str>, json: bool) -> Answer {
    let (ending, watched) = supervisor::up(asked, domain)?;
    let run = &ending.run;
    let mode = ending.mode.map_or("unknown", status::mode_name);
    let mut words = vec![format!("the robot is left in mode {mode}; {}", ending.place())];
    // A mission that did not come to its end leaves a question, and the page answers it.
    let page = ending.unfinished.as_ref().map(|_| report::after(run));
    words.extend(ending.unfinished.clone());
    match &page {
        Some(Ok(page)) => words.push(format!("page       {}", page.display())),
        Some(Err(failure)) => words.push(failure.to_string()),
        None => {}
    }
    let value = json!({
        "run": run, "mode": mode, "died": ending.died, "unrecorded": ending.unrecorded, "unfinished": ending.unfinished,
        "page": page.and_then(Result::ok),
    });
    answers::print(json, &value, &words.join("\n"));
    watched?;
    match ending.failed() {
        Some(sentence) => Err(Failure::NotNow(sentence)),
        None => Ok(()),
    }
}

fn check(config: &std::path::Path, on: Option<&std::path::Path>, json: bool) -> Answer {
    let found = findings::check(config, on)?;
    answers::print(json, &findings::to_json(&found), &findings::to_words(&found));
    if findings::usable(&found) {
        return Ok(());
    }
    let errors = found.iter().filter(|finding| finding.level == findings::Level::Error).count();
    Err(Failure::BadInput(format!("{} cannot be used as it is: {errors} error(s), listed on stdout", config.display())))
}

fn doctor(config: Option<&std::path::Path>, json: bool) -> Answer {
    let found = doctor::doctor(config)?;
    answers::print(json, &findings::to_json(&found), &findings::to_words(&found));
    match found.iter().filter(|finding| finding.level == findings::Level::Error).count() {
        0 => Ok(()),
        errors => {
            Err(Failure::NotNow(format!("{errors} error(s) on this machine would stop the robot, listed on stdout")))
        }
    }
}

fn channel_command(channel: &Channel, domain: Option<&str>, json: bool) -> Answer {
    let bus = live::join_as(domain, Party::Guest)?;
    let (value, words) = match channel {
        Channel::List => channels::list(&bus)?,
        Channel::Hz { name, seconds } => channels::rates(&bus, name.as_deref(), *seconds)?,
        Channel::Echo { name, count, seconds } => return channels::echo(&bus, name, *count, *seconds),
    };
    answers::print(json, &value, &words);
    Ok(())
}
