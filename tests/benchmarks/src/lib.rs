//! The table at the end of the benchmarks: medians as stored by criterion, and ratios of two of them.
//!
//! The benchmarks are in `benches/ratios`; `scripts/bench` runs them. Nothing here asserts a time: the table marks a
//! ratio or a time that misses its goal.
#![forbid(unsafe_code)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// A benchmark by its group and its name.
pub type Name = [&'static str; 2];

/// One row of the table.
#[derive(Debug, Clone)]
struct Row {
    what: String,
    name: Name,
    /// Number of operations in one run of the benchmark.
    per_run: f64,
    /// The benchmark to compare with, its operations per run, and the minimum ratio that is the goal.
    beside: Option<(Name, f64, Option<f64>)>,
    /// Longest time of one operation that is the goal, ns.
    most_ns: Option<f64>,
    remark: String,
}

/// Collects rows while benchmarks run, and reads their medians afterwards.
#[derive(Debug, Clone)]
pub struct Report {
    folder: PathBuf,
    rows: Vec<Row>,
}

impl Report {
    /// Rows for benchmarks whose results criterion stores in `folder`.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), rows: Vec::new() }
    }

    /// Adds a single benchmark, of which one run does `per_run` operations.
    pub fn alone(&mut self, what: &str, name: Name, per_run: usize) {
        self.add(what, name, per_run, None, None);
    }

    /// The same, with the longest time of one operation that is the goal, ns.
    pub fn bounded(&mut self, what: &str, name: Name, per_run: usize, most_ns: f64) {
        self.add(what, name, per_run, None, Some(most_ns));
    }

    /// Adds a benchmark and the one to compare it with, both with `per_run` operations per run, and the goal for the
    /// ratio.
    pub fn pair(&mut self, what: &str, name: Name, beside: Name, per_run: usize, goal: Option<f64>) {
        self.add(what, name, per_run, Some((beside, per_run as f64, goal)), None);
    }

    fn add(
        &mut self,
        what: &str,
        name: Name,
        per_run: usize,
        beside: Option<(Name, f64, Option<f64>)>,
        most_ns: Option<f64>,
    ) {
        let (what, per_run) = (what.into(), per_run as f64);
        self.rows.push(Row { what, name, per_run, beside, most_ns, remark: String::new() });
    }

    /// Adds a remark to the last row.
    pub fn remark(&mut self, text: impl Into<String>) {
        if let Some(row) = self.rows.last_mut() {
            row.remark = text.into();
        }
    }

    /// Median of one operation, ns; `None` if the benchmark was not run.
    fn median_ns(&self, [group, name]: Name, per_run: f64) -> Result<Option<f64>> {
        let path = self.folder.join(group).join(name).join("new/estimates.json");
        if !path.is_file() {
            return Ok(None);
        }
        let text = std::fs::read_to_string(&path).with_context(|| format!("{} cannot be read", path.display()))?;
        let estimates: serde_json::Value =
            serde_json::from_str(&text).with_context(|| format!("{} is no JSON", path.display()))?;
        let median = estimates["median"]["point_estimate"].as_f64();
        let median = median.with_context(|| format!("{} has no median", path.display()))?;
        Ok(Some(median / per_run))
    }

    /// The table as Markdown, without rows that were not run.
    pub fn table(&self) -> Result<String> {
        let mut text = String::from("| what | ours | beside | ratio | goal |\n|---|---|---|---|---|\n");
        for row in &self.rows {
            let Some(ours) = self.median_ns(row.name, row.per_run)? else { continue };
            let (mut beside, mut ratio, mut goal) = (String::new(), row.remark.clone(), String::new());
            if let Some(most_ns) = row.most_ns {
                let met = if ours <= most_ns { "met" } else { "missed" };
                goal = format!("{}: {met}", time(most_ns));
            }
            if let Some((name, per_run, least)) = row.beside {
                let Some(theirs) = self.median_ns(name, per_run)? else { continue };
                beside = format!("{}: {}", name[1], time(theirs));
                ratio = format!("{:.0}", theirs / ours);
                if let Some(least) = least {
                    let met = if theirs / ours >= least { "met" } else { "missed" };
                    goal = format!("{least:.0}: {met}");
                }
            }
            writeln!(text, "| {} | {} | {beside} | {ratio} | {goal} |", row.what, time(ours))?;
        }
        Ok(text)
    }
}

/// Nanoseconds with a fitting unit.
fn time(ns: f64) -> String {
    if ns < 1e3 {
        format!("{ns:.0} ns")
    } else if ns < 1e6 {
        format!("{:.2} µs", ns * 1e-3)
    } else {
        format!("{:.2} ms", ns * 1e-6)
    }
}
