//! `nims doctor`: whether this machine can run a robot, each finding with its cure. Looks only; changes nothing.

mod judge;
mod machine;
mod probe;

pub(crate) use probe::{TMPFS, where_it_will_be};

use crate::failure::{Answer, Failure};
use crate::findings::Finding;
use config::BoxFile;
use std::path::Path;

/// Looks at the machine, for a box or for any.
///
/// # Errors
/// The box file cannot be used.
pub fn doctor(box_path: Option<&Path>) -> Answer<Vec<Finding>> {
    let box_path = box_path.map(std::path::absolute).transpose().map_err(Failure::bad)?;
    let file = box_path.as_deref().map(BoxFile::load).transpose().map_err(Failure::bad)?;
    Ok(judge::judge(&probe::probe(file.as_ref())))
}
