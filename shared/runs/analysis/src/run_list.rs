//! `nims runs FOLDER`: the runs of a folder with their verdicts, and how the figures of each robot change from run to
//! run.

use crate::report::{self, FIGURES};
use command::{Answer, Failure, Output};
use config::IdentifiedFile;
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Folder of runs of the current folder.
pub const FOLDER: &str = "runs";
/// File of `nims identify` in a run folder.
const IDENTIFIED: &str = "identified/identified.toml";
/// Fewest runs of a robot that have a trend.
const FEWEST: usize = 3;

/// A figure that is followed from run to run: its place in the figures of a run, its name, and the unit and factor in
/// which the table shows it.
struct Figure {
    pointer: &'static str,
    name: &'static str,
    unit: &'static str,
    factor: f64,
}

const fn figure(pointer: &'static str, name: &'static str, unit: &'static str, factor: f64) -> Figure {
    Figure { pointer, name, unit, factor }
}

/// The followed figures. The deviation is that of the truth where there is one.
const FIGURES_OF_RUNS: [Figure; 11] = [
    figure("/deviation_rms_m", "deviation RMS", "mm", 1e3),
    figure("/wear/peak_tension_n", "peak tension", "N", 1.0),
    figure("/wear/mean_tension_n", "mean tension", "N", 1.0),
    figure("/wear/current_a", "current RMS", "A", 1.0),
    figure("/wear/misfit_m", "misfit of lengths RMS", "mm", 1e3),
    figure("/wear/drift_m", "drift of lengths", "mm", 1e3),
    figure("/wear/stiffness_n", "stiffness in the robot file", "N", 1.0),
    figure("/identified/stiffness_n", "identified stiffness EA", "N", 1.0),
    figure("/identified/node_mass_kg", "identified node mass", "kg", 1.0),
    figure("/identified/drive_lag_s", "identified delay and lag", "ms", 1e3),
    figure("/identified/force_constant_n_a", "identified force constant", "N/A", 1.0),
];

/// How a figure of a robot changes from run to run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trend {
    /// Name of the system.
    pub system: String,
    /// Name of the figure.
    pub figure: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// Number of runs that have it.
    pub runs: usize,
    /// Value of the first of these runs.
    pub first: f64,
    /// Value of the last one.
    pub last: f64,
    /// Change from run to run, by least squares.
    pub per_run: f64,
}

/// Lists the runs of a folder, oldest first. A run that cannot be read is listed with the reason, and is a failure
/// beside the output.
///
/// # Errors
/// There is no run in the folder.
pub fn list(folder: &Path) -> Answer<Output> {
    let runs = runs_of(folder)?;
    let rows: Vec<Value> = command::parallel(&runs, command::processors(), |run| row(run));
    let trends = trends(&rows);
    let words = words(&rows, &trends);
    let failure = unread(&rows);
    Ok(Output::new(json!({ "folder": folder, "runs": rows, "trends": trends }), words).failing(failure))
}

/// Returns which runs could not be read; the reasons are in their rows.
fn unread(rows: &[Value]) -> Option<Failure> {
    let names: Vec<&str> =
        rows.iter().filter(|row| !row["failed"].is_null()).filter_map(|row| row["run"].as_str()).collect();
    let sentence = format!("{} of {} runs cannot be read: {}", names.len(), rows.len(), names.join(", "));
    (!names.is_empty()).then_some(Failure::NotNow(sentence))
}

/// Returns the run folders in a folder, or the folder if it is a run, in the order of their names, which begin with the
/// date.
fn runs_of(folder: &Path) -> Answer<Vec<PathBuf>> {
    let is_run = |path: &Path| runlog::segments(path).is_ok();
    if is_run(folder) {
        return Ok(vec![folder.to_path_buf()]);
    }
    let problem = |what: &str| Failure::BadInput(format!("{}: {what}; give a folder of runs", folder.display()));
    let entries = std::fs::read_dir(folder).map_err(|error| problem(&error.to_string()))?;
    let mut runs: Vec<PathBuf> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| is_run(path)).collect();
    runs.sort();
    if runs.is_empty() { Err(problem("there is no run in it")) } else { Ok(runs) }
}

/// Returns the row of a run; of one that cannot be read, why.
fn row(run: &Path) -> Value {
    let name = run.file_name().unwrap_or(run.as_os_str()).to_string_lossy();
    let figures = match reported(run) {
        Some(figures) => figures,
        None => match report::figures(run) {
            Ok(figures) => figures,
            Err(failure) => return json!({ "run": name, "failed": failure.to_string() }),
        },
    };
    let error = ["truth", "estimate"].into_iter().find(|of| figures["analysis"][of].is_object());
    let deviation = error.map_or(&Value::Null, |of| &figures["analysis"][of]);
    json!({
        "run": name, "path": run, "system": figures["recording"]["about"]["system"],
        "started_utc": figures["recording"]["started_utc"], "duration_s": figures["recording"]["duration_s"],
        "verdict": figures["verdict"], "flown_m": figures["flown_m"], "deviation_of": error,
        "deviation_rms_m": deviation["rms_m"], "deviation_max_m": deviation["max_m"],
        "unsteered": figures["unsteered"], "faults": figures["faults"], "wear": figures["wear"],
        "identified": identified(run),
    })
}

/// Returns what `nims identify RUN --out RUN/identified` found in a run; null if it was not asked.
fn identified(run: &Path) -> Value {
    let Ok(found) = IdentifiedFile::load(&run.join(IDENTIFIED)) else { return Value::Null };
    json!({
        "stiffness_n": found.stiffness_n, "node_mass_kg": found.node_mass_kg,
        "drive_lag_s": found.drive_lag_s().map(|[delay_s, lag_s]| delay_s + lag_s),
        "force_constant_n_a": found.motor.force_constant_n_a,
    })
}

/// Returns the figures that a report left in the run folder; `None` if they are missing, older than the run or of an
/// earlier version.
fn reported(run: &Path) -> Option<Value> {
    let path = run.join(FIGURES);
    let changed = |path: &Path| path.metadata().ok()?.modified().ok();
    let written = changed(&path)?;
    let newest =
        runlog::segments(run).ok()?.iter().filter_map(|file| changed(file)).max().unwrap_or(SystemTime::UNIX_EPOCH);
    let report: Value = serde_json::from_str(&std::fs::read_to_string(&path).ok()?).ok()?;
    let [figures] = &report["runs"].as_array()?[..] else { return None };
    (written >= newest && figures["version"] == runtime::build::description()).then(|| figures.clone())
}

/// Computes the trend of each figure of each system that has enough runs.
fn trends(rows: &[Value]) -> Vec<Trend> {
    let system = |row: &Value| row["system"].as_str().unwrap_or("-").to_owned();
    let mut systems: Vec<String> = rows.iter().filter(|row| row["failed"].is_null()).map(system).collect();
    systems.sort();
    systems.dedup();
    let mut trends = Vec::new();
    for name in systems {
        for figure in &FIGURES_OF_RUNS {
            let of_system = rows.iter().filter(|row| row["failed"].is_null() && system(row) == name);
            let values: Vec<f64> =
                of_system.filter_map(|row| Some(figure.factor * row.pointer(figure.pointer)?.as_f64()?)).collect();
            let ([first, .., last], true) = (&values[..], values.len() >= FEWEST) else { continue };
            trends.push(Trend {
                system: name.clone(),
                figure: figure.name,
                unit: figure.unit,
                runs: values.len(),
                first: *first,
                last: *last,
                per_run: slope(&values),
            });
        }
    }
    trends
}

/// Returns the slope of the line with the least squares over the number of each value.
fn slope(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let (mean_at, mean) = ((count - 1.0) / 2.0, values.iter().sum::<f64>() / count);
    let (mut above, mut below) = (0.0, 0.0);
    for (at, value) in values.iter().enumerate() {
        above += (at as f64 - mean_at) * (value - mean);
        below += (at as f64 - mean_at) * (at as f64 - mean_at);
    }
    above / below
}

fn words(rows: &[Value], trends: &[Trend]) -> String {
    let head = [
        "run",
        "verdict",
        "robot",
        "s",
        "flown, m",
        "RMS, mm",
        "max, mm",
        "not steered",
        "faults",
        "peak, N",
        "RMS, A",
    ];
    let mut lines: Vec<Vec<String>> = vec![head.map(str::to_owned).to_vec()];
    let number = |value: &Value, factor: f64, digits: usize| {
        value.as_f64().map_or_else(|| "-".to_owned(), |value| format!("{:.digits$}", factor * value))
    };
    let text = |value: &Value| value.as_str().unwrap_or("-").to_owned();
    let mut below = String::new();
    for row in rows {
        if let Some(why) = row["failed"].as_str() {
            let _ = writeln!(below, "{}: {why}", text(&row["run"]));
            continue;
        }
        lines.push(vec![
            text(&row["run"]),
            text(&row["verdict"]["grade"]),
            text(&row["system"]),
            number(&row["duration_s"], 1.0, 1),
            number(&row["flown_m"], 1.0, 2),
            number(&row["deviation_rms_m"], 1e3, 2),
            number(&row["deviation_max_m"], 1e3, 2),
            number(&row["unsteered"], 1.0, 0),
            number(&row["faults"], 1.0, 0),
            number(&row["wear"]["peak_tension_n"], 1.0, 1),
            number(&row["wear"]["current_a"], 1.0, 2),
        ]);
    }
    let mut out = table(&lines);
    out.push_str(&below);
    if !trends.is_empty() {
        let mut lines = vec![["trend", "of", "runs", "first", "last", "per run", ""].map(str::to_owned).to_vec()];
        lines.extend(trends.iter().map(|trend| {
            let value = |value: f64| format!("{value:.2}");
            vec![
                trend.figure.to_owned(),
                trend.system.clone(),
                trend.runs.to_string(),
                value(trend.first),
                value(trend.last),
                format!("{:+.3}", trend.per_run),
                trend.unit.to_owned(),
            ]
        }));
        out.push('\n');
        out.push_str(&table(&lines));
    }
    out.trim_end().to_owned()
}

/// Aligns the first two columns to the left and the others to the right.
fn table(lines: &[Vec<String>]) -> String {
    let columns = lines.first().map_or(0, Vec::len);
    let width = |column: usize| lines.iter().filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
    let mut out = String::new();
    for line in lines {
        let cells = line.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| match column {
            0..=2 => format!("{cell:width$}"),
            _ => format!("{cell:>width$}"),
        });
        let _ = writeln!(out, "{}", cells.collect::<Vec<_>>().join("  ").trim_end());
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_trend_is_that_of_one_system_with_enough_runs() {
        let row = |system: &str, peak: f64| json!({ "run": "x", "system": system, "wear": { "peak_tension_n": peak } });
        let rows =
            [row("a", 10.0), row("b", 5.0), row("a", 12.0), json!({ "run": "y", "failed": "why" }), row("a", 14.0)];
        let found = trends(&rows);
        assert_eq!(found.len(), 1);
        let Trend { system, figure, runs, first, last, per_run, .. } = &found[0];
        assert_eq!((system.as_str(), *figure, *runs, *first, *last), ("a", "peak tension", 3, 10.0, 14.0));
        assert!((per_run - 2.0).abs() < 1e-12);
        let words = words(&rows, &found);
        assert!(words.contains("y: why") && words.contains("+2.000"), "{words}");
    }

    #[test]
    fn what_was_identified_in_a_run_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(identified(folder.path()), Value::Null);
        std::fs::create_dir(folder.path().join("identified")).unwrap();
        let mut rows = Vec::new();
        for stiffness_n in [6000, 5900, 5700] {
            let text = format!("delay_s = 0.03\nlag_s = 0.04\nstiffness_n = {stiffness_n}\n[motor]\ncoulomb_n = 3.0\n");
            std::fs::write(folder.path().join(IDENTIFIED), text).unwrap();
            rows.push(json!({ "run": "x", "system": "a", "identified": identified(folder.path()) }));
        }
        let found = trends(&rows);
        let of = |name: &str| found.iter().find(|trend| trend.figure == name).map(|trend| (trend.first, trend.last));
        assert_eq!(of("identified stiffness EA"), Some((6000.0, 5700.0)));
        assert!(of("identified delay and lag").is_some_and(|(first, _)| (first - 70.0).abs() < 1e-9));
        assert_eq!(of("identified node mass"), None);
    }

    #[test]
    fn a_folder_without_runs_is_bad_input() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path().to_path_buf(), folder.path().join("none")] {
            assert_eq!(list(&path).unwrap_err().exit_code(), 2);
        }
    }
}
