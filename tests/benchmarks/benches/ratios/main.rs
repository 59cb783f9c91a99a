//! Times of the mathematics and of the control chain, side by side with general solvers for the same problems.
//!
//! This program first checks that both of each pair give the same answer; a mismatch ends the run. A table at the end
//! lists medians and ratios.

mod calibration;
mod chain;
mod random;
mod tension;

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use benchmarks::Report;
use criterion::Criterion;

fn main() -> Result<()> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("benchmarks");
    // Medians of an earlier run must not replace benchmarks that are left out of this one.
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
    ensure!(folder.exists(), "nothing was timed: no benchmark has these words in its name");
    let table = report.table()?;
    let path = folder.join("table.md");
    std::fs::write(&path, &table).with_context(|| format!("{} cannot be written", path.display()))?;
    println!("\n{table}\nThis table: {}", path.display());
    Ok(())
}
