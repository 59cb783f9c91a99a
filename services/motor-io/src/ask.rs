//! What the units of a port answer before a robot is started, and what a builder does about it, in the words of the
//! maker's own program.
//!
//! Asking is bringing a unit into use: it is stopped, its motors are released, and its watchdog is set, as at every
//! start. Nothing moves a motor.

use config::DriveProtocol;
use drives::{DriveBus, Error};

/// One step of settling, ns.
const STEP_NS: u64 = 50_000_000;

/// What a unit answered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Asked {
    /// Its name in messages.
    pub unit: String,
    /// Its firmware, if it stated one.
    pub firmware: Option<String>,
}

/// Why the units of a port cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Trouble {
    /// What is wrong, and where.
    pub sentence: String,
    /// What to do.
    pub cure: &'static str,
}

/// Asks the units of a port for so many seconds at most.
///
/// # Errors
/// The first unit that cannot be used, and why.
pub fn ask(bus: &mut dyn DriveBus, protocol: DriveProtocol, patience_s: f64) -> Result<Vec<Asked>, Trouble> {
    let until_ns = bus.now_ns() + (patience_s * 1e9) as u64;
    let mut told = None;
    loop {
        match bus.settle(bus.now_ns() + STEP_NS) {
            Ok(()) => return Ok(units(bus)),
            // What a unit said is worth more than that it is being asked again.
            Err(error) if told.is_none() || !is_passing(&error) => told = Some(error),
            Err(_) => {}
        }
        if bus.now_ns() >= until_ns {
            let error = told.unwrap_or_else(|| Error::Unanswered { port: bus.port().clone() });
            return Err(Trouble { cure: cure(protocol, &error), sentence: error.to_string() });
        }
    }
}

fn units(bus: &dyn DriveBus) -> Vec<Asked> {
    (0..bus.unit_count())
        .filter_map(|unit| bus.unit(unit))
        .map(|unit| Asked { unit: unit.name.to_string(), firmware: unit.firmware.map(|text| text.to_string()) })
        .collect()
}

/// True for a state on the way to another one.
fn is_passing(error: &Error) -> bool {
    matches!(error, Error::Preparing { .. } | Error::Resynchronising { .. } | Error::Interlocked { .. })
}

/// What to do about a unit that cannot be used, in the words of its family.
fn cure(protocol: DriveProtocol, error: &Error) -> &'static str {
    let remedies = protocol.family().remedies;
    match error {
        Error::Serial(_) => {
            "a port that is in use belongs to a running robot, see nims status; otherwise plug it in, or correct path"
        }
        Error::Echo { .. } => remedies.echo,
        Error::WatchdogRefused { .. } => remedies.watchdog,
        Error::Foreign { .. } | Error::Babble { .. } | Error::Garbled { .. } | Error::CutShort { .. } => {
            remedies.foreign
        }
        Error::Unexpected { .. } => remedies.settings,
        _ => remedies.silent,
    }
}
