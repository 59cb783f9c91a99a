//! Flies the golden run again and overwrites the one in `tests/golden`, which the test `replay` recomputes. Use it
//! after an intended change of what estimator, controller, arbiter or safety machine decide, and give the reason in the
//! commit.

use nims_tests::golden;

fn main() -> anyhow::Result<()> {
    let path = golden::file();
    if path.exists() {
        std::fs::remove_file(&path)?;
    }
    golden::fly(&path)?;
    println!("{}: {} bytes", path.display(), path.metadata()?.len());
    Ok(())
}
