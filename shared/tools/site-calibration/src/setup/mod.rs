//! The guided field calibration, one question at a time. No input and output: the measurements are the whole state.

pub mod captured;
mod doubt;
pub mod guide;
pub mod loads;
pub mod map;
pub mod numbers;
pub mod question;
mod shape;
mod tape;
pub mod text;
mod undo;

use crate::calibrate::MeasurementsFile;

/// Formats the measurements as a file of that name, with an explanatory header.
///
/// # Errors
/// A value that TOML cannot hold.
pub fn file_text(file: &MeasurementsFile, name: &str) -> Result<String, toml::ser::Error> {
    let body = toml::to_string(file)?;
    Ok(format!(
        "# Measurements of a site, lengths in metres, written by `nims setup {name}`, which also continues them (and drops comments\n\
         # added here); `nims calibrate {name}` reads them too. configs/measurements/lab3.toml explains every key.\n\n{body}"
    ))
}
