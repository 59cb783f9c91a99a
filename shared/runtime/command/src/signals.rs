//! The signals that ask a program to end in good order.

use crate::{Answer, Failure};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Why a program ends that was asked to by a signal.
pub const SIGNAL: &str = "a signal (Ctrl-C, SIGTERM or a closed terminal)";

/// Set by a signal: end in good order.
pub type StopFlag = Arc<AtomicBool>;

/// A flag that Ctrl-C, a service manager's SIGTERM and a closed terminal set.
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
