//! The command `nims replay`: progress bar, table, verdict.

use super::{Changes, Replayed, instant_of, run, snapshot, state_at};
use command::values::assignment;
use command::{Answer, Failure, Output};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Instant;

/// `nims replay`.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("another").args(["law", "program", "set"]).multiple(true)))]
pub struct Args {
    /// Run folder or file.
    pub run: PathBuf,
    /// Replace the control law.
    #[arg(long, value_name = "LAW")]
    pub law: Option<String>,
    /// Replace the law by a custom one: the command of its program, as for `nims sim`.
    #[arg(long, value_name = "COMMAND", conflicts_with = "law")]
    pub program: Option<String>,
    /// Replace the value of a key of the system file or the robot file, e.g. controller.horizon_cycles=30; repeatable.
    #[arg(long, value_name = "KEY=VALUE", value_parser = assignment)]
    pub set: Vec<(String, String)>,
    /// With --law, --program or --set: plot recorded and changed velocities of each cable to this .svg or .png file.
    #[arg(long, value_name = "FILE", requires = "another")]
    pub plot: Option<PathBuf>,
    /// Instead: show what every process had received and published at this time, in seconds since the start of the run
    /// or as UTC.
    #[arg(long, value_name = "TIME", conflicts_with_all = ["law", "program", "set", "plot"], allow_negative_numbers = true)]
    pub at: Option<String>,
    /// With --at: also the internal state of motor-io, estimators and controllers, by a replay up to then.
    #[arg(long, requires = "at")]
    pub state: bool,
}

/// Steps of the progress bar.
const STEPS: f64 = 1000.0;

/// Runs `nims replay`.
///
/// # Errors
/// The run cannot be read; or, without changes, samples differ from the recorded ones or none could be compared.
pub fn replay(args: &Args) -> Answer<Output> {
    if let Some(at) = &args.at {
        return show_at(args, at);
    }
    let changes = Changes { law: args.law.clone(), program: args.program.clone(), set: args.set.clone() };
    let bar = progress_bar();
    let began = Instant::now();
    let replayed = run(&args.run, &changes, &mut |share| bar.set_position((STEPS * share) as u64))?;
    bar.finish_and_clear();
    let took_s = began.elapsed().as_secs_f64();
    // With changes everything differs, so only the size of the differences is reported.
    let mut words = if replayed.instead.is_some() { Vec::new() } else { table(&replayed) };
    words.push(format!(
        "{} cycles, {:.1} s of robot time, replayed in {took_s:.2} s, {:.0} times faster",
        replayed.cycles,
        replayed.flown_s,
        replayed.flown_s / took_s.max(1e-3)
    ));
    if let (Some(instead), Some(path)) = (&replayed.instead, &args.plot) {
        instead.draw(path, &format!("{}: recorded, and with {}", args.run.display(), change_list(&changes)))?;
        words.push(format!("plot: {}", path.display()));
    }
    if let Some(instead) = &replayed.instead {
        words.push(format!("with {}, {}", change_list(&changes), instead.words()));
    }
    let (equal, different) = (replayed.equal(), replayed.different());
    let verdict = match (&replayed.instead, different, equal) {
        (Some(_), ..) => None,
        (None, 0, 0) => Some(format!("no sample in {} could be compared", args.run.display())),
        (None, 0, _) => None,
        (None, ..) => Some(format!("{different} samples differ from the recorded ones")),
    };
    if verdict.is_none() && replayed.instead.is_none() {
        words.push(format!("{equal} replayed samples are equal to the recorded ones, bit for bit"));
    }
    Ok(Output::new(value(args, &replayed, took_s), words.join("\n")).failing(verdict.map(Failure::NotNow)))
}

fn progress_bar() -> ProgressBar {
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(STEPS as u64) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("replaying the run {wide_bar} {percent:>3} %");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Shows the processes at an instant.
fn show_at(args: &Args, at: &str) -> Answer<Output> {
    if !args.run.exists() {
        let run = args.run.display();
        return Err(Failure::BadInput(format!("{run} does not exist; give a run folder or a run file")));
    }
    let at_ns = instant_of(&args.run, at)?;
    let snapshot = snapshot(&args.run, at_ns)?;
    let (mut words, mut value) = (snapshot.words(), json!(snapshot));
    if args.state {
        let bar = progress_bar();
        let states = state_at(&args.run, at_ns, &mut |share| bar.set_position((STEPS * share) as u64))?;
        bar.finish_and_clear();
        words.extend(states.iter().map(|(part, state)| format!("\n\nstate of {part}\n{state}")));
        let states = states.into_iter().map(|(part, state)| (part, Value::String(state)));
        value["state"] = Value::Object(states.collect());
    }
    Ok(Output::new(value, words))
}

fn change_list(changes: &Changes) -> String {
    let law = changes.law.iter().map(|law| format!("law {law}"));
    let program = changes.program.iter().map(|program| format!("program {program}"));
    law.chain(program)
        .chain(changes.set.iter().map(|(key, value)| format!("{key} = {value}")))
        .collect::<Vec<_>>()
        .join(", ")
}

fn table(replayed: &Replayed) -> Vec<String> {
    let mut lines = vec!["channel            recorded      equal  different  not compared".to_owned()];
    for tally in &replayed.channels {
        let left: u64 = tally.not_compared.values().sum();
        let row = format!(
            "{:<17} {:>9}  {:>9}  {:>9}  {left:>12}",
            tally.channel, tally.recorded, tally.equal, tally.different
        );
        lines.push(row);
    }
    for tally in &replayed.channels {
        let channel = &tally.channel;
        if tally.definition_changed {
            lines.push(format!("{channel}: its definition has changed since; only the common fields were compared"));
        }
        lines.extend(tally.not_compared.iter().map(|(why, count)| format!("{channel}: {count} not compared: {why}")));
        if let Some(first) = &tally.first {
            lines.push(format!(
                "{channel}: first difference in cycle {} at {:.2} s: {} was {} and is now {}",
                first.cycle, first.time_s, first.field, first.recorded, first.replayed
            ));
        }
    }
    if replayed.channels.iter().any(|tally| tally.definition_changed) {
        let build = replayed.recorded_by.as_deref().unwrap_or("an unnamed version");
        lines.push(format!("definitions have changed since: nims {build} recorded the run and can replay all of it"));
    }
    lines.extend(replayed.damage.iter().map(|damage| format!("not readable: {damage}")));
    lines
}

fn value(args: &Args, replayed: &Replayed, took_s: f64) -> Value {
    let mut value = json!({
        "run": args.run,
        "cycles": replayed.cycles,
        "flown_s": replayed.flown_s,
        "took_s": took_s,
        "equal": replayed.equal(),
        "different": replayed.different(),
        "channels": replayed.channels,
        "damage": replayed.damage,
    });
    if let Some(instead) = &replayed.instead {
        value["instead"] = json!(instead);
    }
    value
}
