//! `nims sim`: flights of a virtual robot in lockstep, side by side.
//!
//! A flight is the whole control chain of the system file (the decisions of motor-io, estimator, controller and
//! planner) against the virtual world of its `[motor_box]`, cycle by cycle in one thread, without processes and without
//! a clock.
//! A flight differs from the others in values of the files ([`variants`]) and in its world.
//!
//! Invariants:
//! * The same files, options and seeds give the same figures and the same samples, however many threads fly.
//! * A value is set in a copy of the files, which are then read and checked as always: `nims sim` accepts what
//!   `nims up` accepts, and flies it with the same numbers.
//! * A flight that fails says why in the table; the others go on.
#![forbid(unsafe_code)]

mod args;
mod commands;
mod files;
mod fly;
mod groups;
mod observation;
mod page;
mod steps;
mod table;
mod tape;
pub mod variants;

pub use args::Args;
pub use tape::{Tape, true_node};

use std::path::PathBuf;

use command::{Answer, Failure, Output};
use config::SystemFile;
use files::write;
use fly::{Ended, Flown};
use indicatif::{ProgressBar, ProgressStyle};
use variants::Variant;

/// Flies every variant and returns their table.
///
/// # Errors
/// A file or an option that is not accepted, a folder that has flights already or cannot be written; and, beside the
/// table, a flight that did not reach the end of its mission.
pub fn run(args: &Args) -> Answer<Output> {
    // The folder of a table alone is needed only while it flies.
    let (_temporary, folder) = match &args.out {
        Some(out) => (None, out.clone()),
        None => {
            let folder = command::temporary_folder()?;
            let path = folder.path().to_path_buf();
            (Some(folder), path)
        }
    };
    if args.steps {
        steps::serve(args, &folder, std::io::stdin().lock(), std::io::BufWriter::new(std::io::stdout().lock()))?;
        return Ok(Output::new(serde_json::Value::Null, ""));
    }
    if let (Some(out), Some((_, flight))) = (&args.out, variants::last_flight(&folder)) {
        return Err(Failure::BadInput(format!(
            "{} has flights already, such as {}; choose another folder with --out, or remove it",
            out.display(),
            flight.display()
        )));
    }
    let variants = args.variants()?;
    let file = SystemFile::load(&args.system).map_err(Failure::bad)?;
    let prepared = |variant| Ok((variant, Variant::prepare(variant, &args.system, &file.robot, &folder)?));
    let prepared = variants.iter().map(prepared).collect::<Answer<Vec<(&Variant, PathBuf)>>>()?;
    let progress = progress(variants.len());
    let flown = command::parallel(&prepared, args.jobs.unwrap_or_else(command::processors), |(variant, folder)| {
        let flown = fly::fly(folder, args, &variant.commands);
        progress.inc(1);
        flown
    });
    progress.finish_and_clear();
    let rows: Vec<(&Variant, &Flown)> = variants.iter().zip(&flown).collect();
    let value = table::json(&rows);
    if args.out.is_some() {
        let text = format!("{value:#}\n");
        write(&folder.join("sim.json"), text)?;
        page::write(&folder, &rows)?;
    }
    let reached = |flown: &Flown| matches!(&flown.ended, Ended::Done(flight) if fly::is_completed(flight));
    let failed = rows.iter().filter(|(_, flown)| !reached(flown)).count();
    let failure = (failed > 0)
        .then(|| Failure::NotNow(format!("{failed} of {} flights did not reach the end of the mission", rows.len())));
    Ok(Output::new(value, table::text(&rows, args.out.as_deref())).failing(failure))
}

fn progress(flights: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} flights, {elapsed}, {eta} left");
    ProgressBar::new(flights as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
