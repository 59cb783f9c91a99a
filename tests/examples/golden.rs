//! Flies the golden run again and writes it over the one in `tests/golden`, which the test `replay` computes again. To
//! be done after a change that is meant to change what estimator, controller, arbiter or safety machine decide; say in
//! the commit why they do.

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
