//! Between a program and a drive: passes bytes on and records them, or answers from a recording.

use crate::recording::{Chunk, Recording, Side};
use crate::replay::Replay;
use command::{Answer, Failure};
use serial::{Port, PtyLink, Transport, monotonic_ns, sleep_until};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Longest wait for the drive before bytes of the program are read, ns: what a question is later by.
const TURN_NS: u64 = 300_000;
/// Time for writing to the drive, ns.
const WRITE_NS: u64 = 100_000_000;
/// Times between two releases of a killed program's port and two writes of the file, ns.
const TIDY_NS: u64 = 250_000_000;
/// Baud rate at which a USB port is opened; it ignores it.
const USB_BAUD: u32 = 115_200;
/// Pause of a drive that is only replayed, ns.
const REPLAY_PAUSE_NS: u64 = 200_000;

/// Why a recording ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// By a signal.
    Signal,
    /// The drive is gone: the sentence about its port.
    Gone(String),
}

/// Answers of a replayed drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Questions answered, also by silence as the drive did.
    pub answered: u64,
    /// Bytes that are in no recorded question at their place.
    pub unknown_bytes: u64,
}

/// Passes bytes between a program on `link` and the drive on `port`, and records them to `out`, until `stop`. `baud` 0:
/// the port is USB.
///
/// # Errors
/// The port or the link cannot be opened, or the file is there or cannot be written.
pub fn record(port: &Path, baud: u32, link: &Path, out: &Path, stop: &AtomicBool) -> Answer<Ended> {
    let name: Arc<str> = Arc::from(port.to_string_lossy());
    let mut jack = PtyLink::new(link);
    jack.plug().map_err(Failure::not_now)?;
    let mut drive = Port::open(&name, if baud > 0 { baud } else { USB_BAUD }).map_err(Failure::not_now)?;
    let unwritable = |error: std::io::Error| Failure::NotNow(format!("{}: cannot be written ({error})", out.display()));
    let file = File::create_new(out).map_err(|error| {
        Failure::BadInput(format!("{}: cannot be made ({error}); name another with --out", out.display()))
    })?;
    let mut file = BufWriter::new(file);
    file.write_all(Recording::begin(baud).as_bytes()).map_err(unwritable)?;
    let begin_ns = monotonic_ns();
    let mut tidied_ns = begin_ns;
    let mut buffer = [0; 4096];
    let ended = loop {
        if stop.load(Ordering::Relaxed) {
            break Ended::Signal;
        }
        let Some(program) = jack.pty() else { break Ended::Signal };
        let asked = program.read(&mut buffer).map_err(Failure::not_now)?;
        if asked > 0 {
            let at_ns = monotonic_ns();
            if let Err(error) = drive.write_all(&buffer[..asked], at_ns + WRITE_NS) {
                break Ended::Gone(error.to_string());
            }
            note(&mut file, at_ns - begin_ns, Side::Program, &buffer[..asked]).map_err(unwritable)?;
        }
        match drive.read(&mut buffer, monotonic_ns() + TURN_NS) {
            Ok(0) => {}
            Ok(answered) => {
                let at_ns = monotonic_ns();
                // What does not fit is lost, as on a wire without a reader.
                program.write(&buffer[..answered]).map_err(Failure::not_now)?;
                note(&mut file, at_ns - begin_ns, Side::Drive, &buffer[..answered]).map_err(unwritable)?;
            }
            Err(error) => break Ended::Gone(error.to_string()),
        }
        let now_ns = monotonic_ns();
        if now_ns - tidied_ns > TIDY_NS {
            tidied_ns = now_ns;
            program.release_exclusive();
            file.flush().map_err(unwritable)?;
        }
    };
    jack.unplug();
    file.flush().map_err(unwritable)?;
    Ok(ended)
}

fn note(file: &mut impl Write, at_ns: u64, side: Side, bytes: &[u8]) -> std::io::Result<()> {
    writeln!(file, "{}", Chunk { at_s: at_ns as f64 * 1e-9, side, bytes: bytes.to_vec() })
}

/// Answers programs on `link` as the drive of a recording did, with its delays, until `stop`.
///
/// # Errors
/// The link cannot be made.
pub fn answer(recording: &Recording, link: &Path, stop: &AtomicBool) -> Answer<Counts> {
    let mut replay = Replay::new(recording);
    let mut jack = PtyLink::new(link);
    jack.plug().map_err(Failure::not_now)?;
    let mut due: Vec<(u64, Vec<u8>)> = Vec::new();
    let mut buffer = [0; 4096];
    let mut tidied_ns = monotonic_ns();
    while !stop.load(Ordering::Relaxed) {
        let Some(program) = jack.pty() else { break };
        let asked = program.read(&mut buffer).map_err(Failure::not_now)?;
        let now_ns = monotonic_ns();
        for byte in &buffer[..asked] {
            let answer = replay.receive(*byte).unwrap_or_default();
            due.extend(answer.iter().map(|(after_s, bytes)| (now_ns + (after_s * 1e9) as u64, bytes.clone())));
        }
        while let Some(at) = due.iter().position(|(due_ns, _)| *due_ns <= now_ns) {
            program.write(&due.remove(at).1).map_err(Failure::not_now)?;
        }
        if now_ns - tidied_ns > TIDY_NS {
            tidied_ns = now_ns;
            program.release_exclusive();
        }
        sleep_until(now_ns + REPLAY_PAUSE_NS);
    }
    jack.unplug();
    Ok(Counts { answered: replay.answered, unknown_bytes: replay.unknown_bytes })
}
