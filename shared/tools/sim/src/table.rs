//! The table of the flights, as text and as JSON.

use std::fmt::Write as _;
use std::path::Path;

use lockstep::{Deviation, Flight};
use serde_json::{Value, json};

use crate::fly::{Ended, Flown, is_completed};
use crate::groups;
use crate::variants::Variant;

/// Heads of the columns after the name of the flight.
const HEADS: [&str; 8] =
    ["tracking, mm", "truth, mm", "model error, mm", "within", "tension, N", "slack", "step, mm/s", "energy, J"];
/// What the heads mean, below the table.
const LEGEND: &str = "tracking: estimate to setpoint; truth: true position to setpoint; model error: true position to \
    estimate (RMS / largest). within: share of the cycles whose truth is within two standard deviations of the \
    estimate. slack: cycles with a slack cable. step: largest change of a cable's command between two cycles.";

/// Returns the flights as JSON.
pub(crate) fn json(rows: &[(&Variant, &Flown)]) -> Value {
    let flights: Vec<Value> = rows
        .iter()
        .map(|(variant, flown)| {
            let values: serde_json::Map<String, Value> =
                variant.own.iter().chain(&variant.arguments).map(|own| (own.key.clone(), json!(own.value))).collect();
            let mut row = json!({
                "number": variant.number,
                "name": variant.name(),
                "folder": variant.folder_name(),
                "values": values,
                "program": variant.commands.law,
                "estimator_program": variant.commands.estimator,
                "world": variant.world,
            });
            match &flown.ended {
                Ended::Failed(why) => row["failed"] = json!(why),
                Ended::Done(flight) => {
                    figures(&mut row, flight, flown.period_s);
                    row["gave_up"] = if flown.gave_up.is_empty() { Value::Null } else { json!(flown.gave_up) };
                }
            }
            row
        })
        .collect();
    let groups: Vec<Value> = groups::groups(rows).iter().map(groups::Group::json).collect();
    json!({ "flights": flights, "over_worlds": groups })
}

fn figures(row: &mut Value, flight: &Flight, period_s: f64) {
    let deviation = |deviation: Deviation| json!({ "rms_m": deviation.rms_m, "max_m": deviation.max_m });
    row["completed"] = json!(is_completed(flight));
    row["duration_s"] = json!(flight.cycles as f64 * period_s);
    row["tracking"] = deviation(flight.estimate);
    row["truth"] = deviation(flight.truth);
    row["model_error"] = deviation(flight.between);
    row["stated_two_sigma"] = deviation(flight.stated);
    row["within"] = json!(flight.covered);
    row["tension_n"] = json!(flight.tension_range_n);
    row["slack_cycles"] = json!(flight.slack_cycles);
    row["unsteered_cycles"] = json!(flight.unsteered);
    row["saturation"] = json!(flight.saturation);
    row["step_m_s"] = json!(flight.step_m_s);
    row["energy_j"] = json!(flight.energy_j);
}

fn columns(flight: &Flight) -> [String; 8] {
    let mm = |deviation: Deviation| format!("{:.2} / {:.2}", deviation.rms_m * 1e3, deviation.max_m * 1e3);
    let [low, high] = flight.tension_range_n;
    [
        mm(flight.estimate),
        mm(flight.truth),
        mm(flight.between),
        format!("{:.0} %", flight.covered * 100.0),
        format!("{low:.1} to {high:.1}"),
        flight.slack_cycles.to_string(),
        format!("{:.1}", flight.step_m_s * 1e3),
        format!("{:.1}", flight.energy_j),
    ]
}

/// Formats lines in columns: the first one left, the others right.
fn aligned(lines: &[Vec<String>]) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| lines.iter().filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
    let mut text = String::new();
    for line in lines {
        let cells = line.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| match column {
            0 => format!("{cell:width$}"),
            _ => format!("{cell:>width$}"),
        });
        let line = cells.collect::<Vec<_>>().join("  ");
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}

/// Returns the table for a terminal.
pub(crate) fn text(rows: &[(&Variant, &Flown)], out: Option<&Path>) -> String {
    let mut lines: Vec<Vec<String>> = vec![std::iter::once("flight").chain(HEADS).map(str::to_owned).collect()];
    let mut failed = String::new();
    for (variant, flown) in rows {
        let mut line = vec![variant.name()];
        match &flown.ended {
            Ended::Done(flight) => {
                line.extend(columns(flight));
                if !is_completed(flight) {
                    let why = match flown.gave_up.as_str() {
                        "" => "the mission did not end in time".to_owned(),
                        why => format!("the robot gave up the mission: {why}"),
                    };
                    let _ = writeln!(failed, "{}: {why}", variant.name());
                }
            }
            Ended::Failed(why) => {
                line.push("not flown".to_owned());
                let _ = writeln!(failed, "{}: {why}", variant.name());
            }
        }
        lines.push(line);
    }
    let mut text = aligned(&lines);
    let _ = write!(text, "{failed}{LEGEND}");
    let groups = groups::groups(rows);
    if !groups.is_empty() {
        let mut lines: Vec<Vec<String>> = Vec::new();
        lines.push(std::iter::once("over the worlds").chain(groups::HEADS).map(str::to_owned).collect());
        lines.extend(groups.iter().map(groups::Group::line));
        let _ = write!(text, "\n\n{}{}", aligned(&lines), groups::LEGEND);
    }
    if let Some(out) = out {
        let _ = write!(text, "\nruns and charts: {}; `nims report` opens each run", out.display());
    }
    text
}
