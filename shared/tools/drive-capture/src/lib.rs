//! `nims drive-capture`: evidence from real drives, for people who do not have them.
//!
//! It stands between a program (motor-io, or the maker's own) and the serial port of a drive, and writes every byte
//! with its time into a text file. From such a file it states how fast and how completely the drive answered, which is
//! what the virtual motor box needs, and it offers a port that answers as the drive did.
//!
//! Invariants:
//! * Bytes pass as they are, in order, also those that no known drive would send.
//! * Nothing is sent to the drive that the program did not send.
//! * A recording is text that people can read; any of its lines but the first may be removed, and a last one that was
//!   cut off is passed over.
#![forbid(unsafe_code)]

mod question;
mod recording;
mod relay;
mod replay;
mod timing;

pub use recording::{Chunk, Recording, Side};
pub use relay::{Counts, Ended, answer, record};
pub use replay::Replay;
pub use timing::{Timing, timing};

use command::{Answer, Failure, Output};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Command-line arguments of `nims drive-capture`.
#[derive(Debug, Clone, clap::Args)]
#[command(group(clap::ArgGroup::new("what").args(["port", "show", "replay"]).required(true)))]
pub struct Args {
    /// Serial port of the drive, to record.
    pub port: Option<PathBuf>,
    /// State how the drive of a recording answered.
    #[arg(long, value_name = "FILE")]
    pub show: Option<PathBuf>,
    /// Offer a port that answers as the drive of a recording did.
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,
    /// Baud rate of the port.
    #[arg(long, default_value_t = 230_400)]
    pub baud: u32,
    /// The port is USB: it has no baud rate, and bytes take no time.
    #[arg(long, conflicts_with = "baud")]
    pub usb: bool,
    /// File to record to; it must not exist.
    #[arg(long, value_name = "FILE", default_value = "drive.capture")]
    pub out: PathBuf,
    /// Name of the port that the program opens instead.
    #[arg(long, value_name = "PATH", default_value = "drive-port")]
    pub link: PathBuf,
}

/// Records until a signal or until the drive is gone, shows a recording, or answers from one until a signal.
///
/// # Errors
/// A port or a file that cannot be opened, or a file that is not a recording.
pub fn run(args: &Args) -> Answer<Output> {
    if let Some(path) = &args.show {
        return show(path);
    }
    if let Some(path) = &args.replay {
        let recording = Recording::load(path)?;
        let link = args.link.display();
        eprintln!("{link} answers as the drive of {}; Ctrl-C ends it", path.display());
        let counts = answer(&recording, &args.link, &*command::stop_flag()?)?;
        let words = format!(
            "{} questions were answered, {} bytes were in no recorded question",
            counts.answered, counts.unknown_bytes
        );
        return Ok(Output::new(json!({ "answered": counts.answered, "unknown_bytes": counts.unknown_bytes }), words));
    }
    let port = args.port.as_deref().unwrap_or(Path::new(""));
    let stop = command::stop_flag()?;
    let link = args.link.display();
    eprintln!(
        "recording {} to {}; give {link} to the program as its port; Ctrl-C ends it",
        port.display(),
        args.out.display()
    );
    let baud = if args.usb { 0 } else { args.baud };
    let ended = record(port, baud, &args.link, &args.out, &stop)?;
    let shown = show(&args.out)?;
    match ended {
        Ended::Signal => Ok(shown),
        Ended::Gone(error) => Ok(shown.failing(Some(Failure::NotNow(error)))),
    }
}

fn show(path: &Path) -> Answer<Output> {
    let recording = Recording::load(path)?;
    let timing = timing(&recording);
    Ok(Output::new(timing.to_json(), timing.to_string()))
}

#[cfg(test)]
mod tests {
    use clap::Args as _;

    fn accepted(line: &str) -> bool {
        let command = super::Args::augment_args(clap::Command::new("drive-capture"));
        command.try_get_matches_from(["drive-capture"].into_iter().chain(line.split_whitespace())).is_ok()
    }

    #[test]
    fn one_of_port_recording_to_show_and_recording_to_replay_is_given() {
        for line in [
            "/dev/ttyACM0",
            "/dev/serial/by-id/drive --baud 230400 --out bench.capture --link /tmp/drive0",
            "/dev/ttyACM0 --usb",
            "--show bench.capture",
            "--replay bench.capture --link /tmp/drive0",
        ] {
            assert!(accepted(line), "{line}");
        }
        for line in [
            "",
            "--link /tmp/drive0",
            "/dev/ttyACM0 --usb --baud 9600",
            "/dev/ttyACM0 --show bench.capture",
            "--show a --replay b",
        ] {
            assert!(!accepted(line), "{line}");
        }
    }
}
