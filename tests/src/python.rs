//! The Python interpreter with the packages that the tests compare with.

use std::path::{Path, PathBuf};

/// The interpreter in `NIMS_PYTHON`, or that of `.venv`.
///
/// # Panics
/// If there is no such interpreter.
#[must_use]
pub fn python() -> PathBuf {
    let own = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../.venv/bin/python");
    let python = std::env::var_os("NIMS_PYTHON").map_or_else(own, PathBuf::from);
    assert!(
        python.exists(),
        "{}: run scripts/test, which creates it, or set NIMS_PYTHON to another interpreter",
        python.display()
    );
    python
}
