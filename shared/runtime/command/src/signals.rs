//! The signals that request the orderly end of a program.

use crate::{Answer, Failure};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Name of the signals, for the sentence about why a program ends.
pub const SIGNAL: &str = "a signal (Ctrl-C, SIGTERM or a closed terminal)";

/// A flag that a signal sets to request the orderly end.
pub type StopFlag = Arc<AtomicBool>;

/// Returns a flag that Ctrl-C, SIGTERM and a closed terminal set.
///
/// # Errors
/// The handlers cannot be installed.
pub fn stop_flag() -> Answer<StopFlag> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let flag = StopFlag::default();
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&flag)).map_err(Failure::not_now)?;
    }
    Ok(flag)
}
