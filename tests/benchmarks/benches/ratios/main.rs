//! Times of the mathematics and of the control chain, side by side with general solvers for the same problems.
//!
//! Every pair first proves in this program that both give the same answer; a pair that does not agree ends the run. The
//! medians and ratios stand in a table at the end.

mod calibration;
mod chain;
mod random;
mod tension;

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use benchmarks::Report;
use criterion::Criterion;

fn main() -> Result<()> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("benchmarks");
    // Medians of an earlier run must not stand in for benchmarks that are left out of this one.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).with_context(|| format!("{} cannot be removed", folder.display()))?;
    }
    let mut criterion = Criterion::default()
        .output_directory(&folder)
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    let mut report = Report::new(&folder);
    tension::run(&mut criterion, &mut report)?;
    calibration::run(&mut criterion, &mut report)?;
    chain::run(&mut criterion, &mut report)?;
    criterion.final_summary();
    let table = report.table()?;
    let path = folder.join("table.md");
    std::fs::write(&path, &table).with_context(|| format!("{} cannot be written", path.display()))?;
    println!("\n{table}\nThis table: {}", path.display());
    Ok(())
}
