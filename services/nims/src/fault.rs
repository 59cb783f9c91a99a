//! `nims fault`: causes faults in the virtual motor box or in a process.
//!
//! [`ROWS`] is the only specification of how and how soon the robot detects each fault, and of its reaction: `nims
//! fault list` prints it, `docs/faults.md` is that output, and the tests cause the faults and compare the robot's
//! behaviour with it.

use client::{Place, RobotLink};
use command::{Answer, Failure, Output};
use config::Role;
use messages::{MotorAuthority, Request};
use motor_box::{FaultRequest, KINDS};
use robot_state::sentences::{fault_sentences, mode_name};
use runtime::OUTPUT_FAULTS;
use rustix::process::{Pid, Signal, kill_process, test_kill_process};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Duration;

/// Process name of the virtual motor box.
const MOTOR_BOX: &str = "motor-box";

/// Faults of a process: word, signal that is sent, effect.
const SIGNALS: [(&str, Signal, &str); 3] = [
    ("kill", Signal::KILL, "the process ends at once (SIGKILL)"),
    ("stop", Signal::STOP, "the process is suspended (SIGSTOP); it keeps its locks and memory"),
    ("continue", Signal::CONT, "the process continues (SIGCONT)"),
];

/// Detection of a fault and the robot's reaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// Example request of this kind of fault.
    pub example: &'static str,
    /// How the robot detects it.
    pub detection: &'static str,
    /// Number of control cycles in which a moving robot detects it; 0: it is no fault of the robot.
    pub cycles: u32,
    /// Fault bits, of which at least one is set; 0: it is no fault of the robot, and `log` appears in the log.
    pub bits: u32,
    /// The resulting mode, `MotorAuthority::MODE_*`.
    pub mode: u8,
    /// What the robot does.
    pub reaction: &'static str,
    /// Log sentence, if `bits` is 0.
    pub log: &'static str,
}

const FAULTED: u8 = MotorAuthority::MODE_FAULTED;
const HOLDING: u8 = MotorAuthority::MODE_HOLDING;
const FOLLOWING: u8 = MotorAuthority::MODE_FOLLOWING;

/// Detection of a silent drive unit. motor-io resynchronises first, because noise causes the same symptom.
const RESYNC_FAILS: &str = "no answer in time; bus resynchronisation fails for 0.4 s";
/// Reaction: an immediate stop.
const STOPS: &str = "stops at once and holds all cables; the motion is dropped";
/// Reaction: an immediate stop that releases the faulty cable.
const RELEASES_CABLE: &str =
    "stops at once; releases this cable, whose encoder is wrong, and holds the others; the position must be confirmed";
/// Reaction: a stop on the path.
const STOPS_ON_PATH: &str = "stops on the path and holds; the motion is kept, and `resume` continues it";

/// Detection of a controller that has ended or is suspended.
const NO_COMMAND: &str = "no command for ttl_cycles cycles";
/// Detection of an estimator that has ended or is suspended.
const NO_ESTIMATE: &str = "no estimate for ttl_cycles cycles";
/// Without an estimate there is no command either, so either fault may be named.
const ESTIMATOR_LOST: u32 = MotorAuthority::FAULT_ESTIMATE_LOST | MotorAuthority::FAULT_COMMAND_LOST;

/// Detection of a late controller: a command carries the cycle that it is based on.
const OLD_COMMAND: &str = "its commands are based on old cycles and are rejected, for ttl_cycles cycles";
/// Detection of a late estimator: an estimate carries the cycle that it is based on.
const OLD_ESTIMATE: &str = "its estimates are based on old cycles and are rejected, for ttl_cycles cycles";

const fn row(
    example: &'static str,
    detection: &'static str,
    cycles: u32,
    bits: u32,
    mode: u8,
    reaction: &'static str,
) -> Row {
    Row { example, detection, cycles, bits, mode, reaction, log: "" }
}

/// An event that is no fault of the robot and only appears in the log.
const fn logged_row(
    example: &'static str,
    detection: &'static str,
    mode: u8,
    reaction: &'static str,
    log: &'static str,
) -> Row {
    Row { example, detection, cycles: 0, bits: 0, mode, reaction, log }
}

/// The table of faults: every kind at least once.
pub const ROWS: [Row; 28] = [
    logged_row(
        "noise 1 0.0005 for 1",
        "wrong checksums and implausible encoder steps; the bus is resynchronised, 50 to 100 ms each time",
        FOLLOWING,
        "slows down while readings are missing; the periods count as lost to *resync*",
        "PORT, unit 0x80: the answer to COMMAND has a wrong checksum; look for noise or two units of one address",
    ),
    row("silence 1", RESYNC_FAILS, 60, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    row("late 1 0.05", RESYNC_FAILS, 60, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    row("mute 1 128", RESYNC_FAILS, 60, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    row("unplug 1", "the port has disappeared", 10, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    logged_row(
        "plug 1",
        "motor-io opens the port again and finds its units",
        HOLDING,
        "holds after a reset",
        "over: A drive unit does not answer: check its power and its cable, then reset.",
    ),
    row(
        "reboot 1 128 for 0.1",
        "the unit's encoders restart at zero",
        100,
        MotorAuthority::FAULT_UNIT_REBOOT | MotorAuthority::FAULT_LOST_UNIT,
        FAULTED,
        "stops at once and holds all cables; the position from before must be confirmed",
    ),
    row(
        "estop 1 128",
        "the unit's status, read every 12 cycles for two units, every 24 if answers leave little time, every 8 if they leave none; or the port's stop_pin, read in \
         every cycle",
        40,
        MotorAuthority::FAULT_EMERGENCY_INPUT,
        MotorAuthority::MODE_EMERGENCY_STOP,
        "the unit itself releases its motors; all other cables are held at once, until the button is released and the robot is reset",
    ),
    row(
        "supply 9",
        "five readings below supply_min_v; read every 12 cycles for two units, every 24 if answers leave little time, every 96 if they leave none",
        80,
        MotorAuthority::FAULT_SUPPLY,
        FAULTED,
        STOPS,
    ),
    row(
        "stall 2",
        "the drive's duty exceeds stall_duty while the cable does not move, for stall_cycles; a cable that should pay out is slack too",
        100,
        MotorAuthority::FAULT_STALL,
        FAULTED,
        RELEASES_CABLE,
    ),
    row(
        "dead 2",
        "the drive's duty exceeds stall_duty while the cable seems not to move, for stall_cycles",
        100,
        MotorAuthority::FAULT_STALL,
        FAULTED,
        RELEASES_CABLE,
    ),
    row(
        "slip 2 1.0",
        "as `dead`, if the wheel slips completely; two encoders find a smaller one (docs/drives.md), one does not: the position is then \
         wrong by that part of the cable's motion",
        100,
        MotorAuthority::FAULT_STALL,
        FAULTED,
        RELEASES_CABLE,
    ),
    row(
        "jump 2 500",
        "in two consecutive readings, a step that exceeds the motion explained by the commands since the last reading by more than 5 mm \
         plus 30 mm/s and a quarter of `cable_speed_limit_m_s` times the time between; a smaller step is not detected: the position is \
         then wrong by that much",
        5,
        MotorAuthority::FAULT_ENCODER_JUMP,
        FAULTED,
        "stops at once and holds all cables; the step is not added to the length, and the position must be confirmed",
    ),
    row(
        "break 2",
        "the cable is reeled in without the current that its tension needs, or paid out without being pulled",
        100,
        MotorAuthority::FAULT_SLACK,
        FAULTED,
        STOPS,
    ),
    row("stop controller", NO_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, STOPS_ON_PATH),
    logged_row(
        "continue controller",
        "commands arrive again",
        HOLDING,
        "holds; `resume` continues the motion",
        "over: The controller stopped answering, so the robot stopped and holds: when nims status shows it again, resume; if it does not come \
         back, end nims up and start it again.",
    ),
    row("stop estimator", NO_ESTIMATE, 10, ESTIMATOR_LOST, HOLDING, STOPS_ON_PATH),
    row("kill controller", NO_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, STOPS_ON_PATH),
    row("kill estimator", NO_ESTIMATE, 10, ESTIMATOR_LOST, HOLDING, STOPS_ON_PATH),
    row(
        "kill planner",
        "no heartbeat for two seconds",
        250,
        MotorAuthority::FAULT_PLANNER_LOST,
        HOLDING,
        "finishes the current segment and holds",
    ),
    logged_row(
        "kill recorder",
        "the supervisor detects the end at once and restarts the recorder, which repairs the run file",
        FOLLOWING,
        "the mission continues; the channels store more than a second of samples for the next recorder",
        "recorder was ended by signal 9",
    ),
    logged_row(
        "kill motor-io",
        "the drives receive no command for watchdog_s, and their watchdog stops the motors",
        MotorAuthority::MODE_DISARMED,
        "the gears hold the cables or let them run out, see `nims check`; after its restart motor-io is disarmed, with the position from \
         before",
        "motor-io was ended by signal 9",
    ),
    row("slow controller 10", OLD_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, STOPS_ON_PATH),
    row("slow estimator 10", OLD_ESTIMATE, 10, MotorAuthority::FAULT_ESTIMATE_LOST, HOLDING, STOPS_ON_PATH),
    row(
        "nan controller",
        "commands that are NaN are rejected, for ttl_cycles cycles",
        10,
        MotorAuthority::FAULT_COMMAND_REFUSED,
        HOLDING,
        STOPS_ON_PATH,
    ),
    row(
        "nan estimator",
        "estimates that are NaN are rejected, for ttl_cycles cycles",
        10,
        MotorAuthority::FAULT_ESTIMATE_LOST,
        HOLDING,
        STOPS_ON_PATH,
    ),
    row("frozen controller", OLD_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, STOPS_ON_PATH),
    row("frozen estimator", OLD_ESTIMATE, 10, MotorAuthority::FAULT_ESTIMATE_LOST, HOLDING, STOPS_ON_PATH),
];

impl Row {
    /// Returns the kind of fault: the first word of the example.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        self.example.split(' ').next().unwrap_or_default()
    }

    /// Returns the sentences that the operator reads, without the names of cables and units.
    #[must_use]
    pub fn sentence(&self) -> String {
        if self.bits == 0 { self.log.to_owned() } else { fault_sentences(self.bits).collect::<Vec<_>>().join(" ") }
    }
}

/// Returns the arguments and the effect of a kind of fault.
fn kind_of(name: &str) -> (&'static str, &'static str) {
    let of_box = KINDS.iter().find(|kind| kind.name == name).map(|kind| (kind.arguments, kind.what));
    let of_process = SIGNALS.iter().find(|(word, ..)| *word == name).map(|(_, _, what)| ("PROCESS", *what));
    let of_output =
        OUTPUT_FAULTS.iter().find(|(word, ..)| *word == name).map(|(_, arguments, what)| (*arguments, *what));
    of_box.or(of_process).or(of_output).unwrap_or(("", ""))
}

/// Returns the page `docs/faults.md`.
#[must_use]
pub fn page() -> String {
    let mut page = String::from(
        "# Faults on request\n\n\
         `nims fault` causes these faults on the virtual motor box. The table lists the reaction of a moving robot. Real drives reject the command.\n\
         `nims fault KIND ... --for SECONDS` ends the fault after that time; for most kinds, `off` as the last word ends it at once.\n\
         Cables and ports are numbered from 1, as in the system file; a unit is named by its address.\n\
         The rows of controllers and estimators apply without a standby; with one, the robot uses the standby's output of the same cycle.\n\n\
         This page is the output of `nims fault list`. The tests cause each fault in flight and check the number of control cycles, the\n\
         fault and the mode (`tests/tests/live/faults.rs`; deaths of processes: `tests/tests/live/processes.rs`).\n\
         Until a wrong encoder or motor (`stall`, `dead`, `slip`) is detected, the controller pulls the node after that cable. Other cables can\n\
         be slack during that time and while the node swings back; no tension exceeds its limit.\n\n\
         | fault | what happens | detection | within cycles | reaction | mode | message |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for row in &ROWS {
        let (arguments, what) = kind_of(row.kind());
        let cycles = if row.cycles == 0 { "-".to_owned() } else { row.cycles.to_string() };
        let sentence = row.sentence();
        let _ = writeln!(
            page,
            "| `{} {arguments}`, e.g. `{}` | {what} | {} | {cycles} | {} | {} | {sentence} |",
            row.kind(),
            row.example,
            row.detection,
            row.reaction,
            mode_name(row.mode),
        );
    }
    page
}

fn list() -> Value {
    let rows = ROWS.iter().map(|row| {
        let (arguments, what) = kind_of(row.kind());
        json!({
            "kind": row.kind(), "arguments": arguments, "what": what, "example": row.example, "found": row.detection,
            "cycles": row.cycles, "faults": row.bits, "mode": mode_name(row.mode), "reaction": row.reaction, "sentence": row.sentence(),
        })
    });
    json!({ "faults": rows.collect::<Vec<_>>() })
}

/// Causes the fault, or lists the faults.
///
/// # Errors
/// There is no such fault or process, the robot has real drives, or the request is refused or not answered.
pub fn fault(place: Place<'_>, words: &[String], seconds: Option<f64>) -> Answer<Output> {
    let first = words.first().map(String::as_str).unwrap_or_default();
    if first == "list" && words.len() == 1 && seconds.is_none() {
        return Ok(Output::new(list(), page().trim_end()));
    }
    let signal = SIGNALS.iter().find(|(word, ..)| *word == first);
    let sentence = match signal {
        Some((word, signal, _)) => {
            let [_, name] = words else {
                return Err(Failure::BadInput(format!("the process is missing: nims fault {word} PROCESS")));
            };
            if seconds.is_some_and(|seconds| *word != "stop" || !(seconds > 0.0 && seconds <= 3600.0)) {
                let accepted =
                    "for faults of processes, --for is accepted with `stop` only: above 0, at most 3600 seconds";
                return Err(Failure::BadInput(accepted.to_owned()));
            }
            to_process(&virtual_only(place)?, word, *signal, name, seconds)?
        }
        None => {
            let of_output = OUTPUT_FAULTS.iter().any(|(word, ..)| *word == first);
            let (process, mut text) =
                if of_output { to_output(words)? } else { (MOTOR_BOX.to_owned(), words.join(" ")) };
            if let Some(seconds) = seconds {
                let _ = write!(text, " for {seconds}");
            }
            if !of_output {
                text.parse::<FaultRequest>().map_err(Failure::bad)?;
            }
            client::send(&virtual_only(place)?, &process, &Request::Fault { text })?
        }
    };
    Ok(Output::accepted(sentence))
}

/// Returns the process whose output is to be faulty, and the request to it.
fn to_output(words: &[String]) -> Answer<(String, String)> {
    let slots = messages::Slot::ALL;
    let names = [Role::Controller, Role::Estimator].map(|role| slots.map(|slot| role.process_name(slot))).concat();
    match words {
        [kind, process, rest @ ..] if names.contains(process) => {
            Ok((process.clone(), [std::slice::from_ref(kind), rest].concat().join(" ")))
        }
        [kind, ..] => {
            let names = names.join(", ");
            Err(Failure::BadInput(format!("the process is missing: nims fault {kind} PROCESS, one of {names}")))
        }
        [] => Err(Failure::BadInput("the fault is missing; nims fault list lists the faults".to_owned())),
    }
}

/// Joins the robot.
///
/// # Errors
/// Its drives are not virtual.
fn virtual_only(place: Place<'_>) -> Answer<RobotLink> {
    let link = client::link(place)?;
    if client::system_of(&link)?.motor_box.is_none() {
        return Err(Failure::NotNow(
            "this robot has real drives, so nothing was done: nims fault works with the virtual motor box only"
                .to_owned(),
        ));
    }
    Ok(link)
}

fn to_process(link: &RobotLink, word: &str, signal: Signal, name: &str, seconds: Option<f64>) -> Answer<String> {
    let own = std::process::id();
    let alive = link.alive()?;
    let found = alive.iter().find(|node| node.name == name && node.pid != own).and_then(|node| {
        let pid = i32::try_from(node.pid).ok().and_then(Pid::from_raw)?;
        Some((node.pid, pid))
    });
    let Some((number, pid)) = found else {
        let mut names: Vec<&str> = alive.iter().filter(|node| node.pid != own).map(|node| node.name.as_str()).collect();
        names.sort_unstable();
        return Err(Failure::BadInput(format!("there is no process {name} here; there are {}", names.join(", "))));
    };
    test_kill_process(pid).map_err(Failure::not_now)?;
    // The supervisor may be the process that cannot answer afterwards, or that could not before.
    let continues = signal == Signal::CONT;
    let mut record = if continues { String::new() } else { put_on_record(link, word, name) };
    kill_process(pid, signal).map_err(Failure::not_now)?;
    if continues {
        record = put_on_record(link, word, name);
    }
    let mut sentence = format!("done: {word} {name} (process {number})");
    if let Some(seconds) = seconds {
        std::thread::sleep(Duration::from_secs_f64(seconds));
        kill_process(pid, Signal::CONT).map_err(Failure::not_now)?;
        record.push_str(&put_on_record(link, "continue", name));
        let _ = write!(sentence, ", which went on after {seconds} s");
    }
    Ok(sentence + &record)
}

/// Records a fault of a process on `operator/request`, by the supervisor. Without one the fault is not on record, and
/// happens all the same: returns what to say then, otherwise nothing.
fn put_on_record(link: &RobotLink, word: &str, name: &str) -> String {
    let request = Request::Fault { text: format!("{word} {name}") };
    match client::send(link, client::SUPERVISOR, &request) {
        Ok(_) => String::new(),
        Err(error) => format!("; {word} {name} is not on record: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_a_row_and_every_row_is_a_valid_request() {
        let of_process = SIGNALS.iter().map(|(word, ..)| *word).chain(OUTPUT_FAULTS.iter().map(|(word, ..)| *word));
        for name in KINDS.iter().map(|kind| kind.name).chain(of_process) {
            assert!(ROWS.iter().any(|row| row.kind() == name), "{name} is not in the table");
        }
        for row in &ROWS {
            assert!(!kind_of(row.kind()).1.is_empty(), "{}", row.example);
            let of_process = SIGNALS.iter().any(|(word, ..)| *word == row.kind());
            let words: Vec<String> = row.example.split(' ').map(str::to_owned).collect();
            assert!(
                of_process || row.example.parse::<FaultRequest>().is_ok() || to_output(&words).is_ok(),
                "{}",
                row.example
            );
            assert_eq!(row.cycles == 0, row.bits == 0, "{}: every detected fault has a number of cycles", row.example);
        }
    }
}
