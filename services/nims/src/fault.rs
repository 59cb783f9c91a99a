//! `nims fault`: breaks something in the virtual motor box, or a process, on purpose; and what the robot makes of it.
//!
//! [`ROWS`] is the one place that says how each fault is found out, how soon, and what the robot does: `nims fault list` prints it,
//! `docs/faults.md` is that list, and the tests break things and hold the robot to it.

use bus::Bus;
use command::{Answer, Failure, Output};
use config::Role;
use messages::{MotorAuthority, Request};
use motor_box::{FaultRequest, KINDS};
use robot_state::sentences::{fault_sentences, mode_name};
use runtime::OUTPUT_FAULTS;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Duration;

/// The virtual motor box.
const MOTOR_BOX: &str = "motor-box";

/// What can be done to a process: word, signal, what it means.
const SIGNALS: [(&str, Signal, &str); 3] = [
    ("kill", Signal::KILL, "the process ends at once"),
    ("stop", Signal::STOP, "the process stands still, and everything that it holds stays as it is"),
    ("continue", Signal::CONT, "it goes on"),
];

/// How a fault is found out and what follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// The request that stands for its kind.
    pub example: &'static str,
    /// How the robot finds out.
    pub found: &'static str,
    /// Within so many control cycles of a moving robot; 0: not at all.
    pub cycles: u32,
    /// At least one of these is named; 0: it is no fault of the robot's, and `says` stands in the log.
    pub bits: u32,
    /// The mode that follows, `MotorAuthority::MODE_*`.
    pub mode: u8,
    /// What the robot does.
    pub reaction: &'static str,
    /// What is said where no fault is named.
    pub says: &'static str,
}

const FAULTED: u8 = MotorAuthority::MODE_FAULTED;
const HOLDING: u8 = MotorAuthority::MODE_HOLDING;
const FOLLOWING: u8 = MotorAuthority::MODE_FOLLOWING;

/// A bus out of step is not given up at once, because noise would do the same.
const IN_VAIN: &str = "no answer in time; the bus is brought back into step in vain for 0.4 s";
/// Stops where it is and holds.
const STOPS: &str = "stops at once and holds on all lines; the motion is dropped";
/// The same but for one line.
const LETS_GO: &str = "stops at once; this cable is let go, because its encoder does not tell the truth, and the others hold; the position has to be confirmed";
/// Stops on the path.
const ON_THE_PATH: &str = "stops on the path and holds; the motion is kept, and `resume` goes on with it";

/// A controller that has gone, or stands still.
const NO_COMMAND: &str = "no command for as many cycles as ttl_cycles";
/// An estimator that has; without an estimate there is no command either.
const NO_ESTIMATE: &str = "no estimate for as many cycles as ttl_cycles";
const ESTIMATOR_GONE: u32 = MotorAuthority::FAULT_ESTIMATE_LOST | MotorAuthority::FAULT_COMMAND_LOST;

/// An answer names the cycle that it is based on.
const OLD_COMMAND: &str =
    "its commands are based on cycles long past and are refused, for as many cycles as ttl_cycles";
/// So does an estimate.
const OLD_ESTIMATE: &str = "its estimates are of cycles long past and are not used, for as many cycles as ttl_cycles";

const fn row(
    example: &'static str,
    found: &'static str,
    cycles: u32,
    bits: u32,
    mode: u8,
    reaction: &'static str,
) -> Row {
    Row { example, found, cycles, bits, mode, reaction, says: "" }
}

/// What is no fault of the robot's, and is said by whoever sees it.
const fn noted(
    example: &'static str,
    found: &'static str,
    mode: u8,
    reaction: &'static str,
    says: &'static str,
) -> Row {
    Row { example, found, cycles: 0, bits: 0, mode, reaction, says }
}

/// Every kind of fault at least once.
pub const ROWS: [Row; 28] = [
    noted(
        "noise 1 0.0005 for 1",
        "checksums and encoder steps that cannot be; the bus is brought back into step, 50 to 100 ms each time",
        FOLLOWING,
        "goes on more slowly while readings are missing; the periods count as lost to *resync*",
        "PORT, unit 0x80: the answer to COMMAND has a wrong checksum; look for noise or two units of one address",
    ),
    row("silence 1", IN_VAIN, 60, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    row("late 1 0.05", IN_VAIN, 60, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    row("mute 1 128", IN_VAIN, 60, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    row("unplug 1", "the port is gone", 10, MotorAuthority::FAULT_LOST_UNIT, FAULTED, STOPS),
    noted(
        "plug 1",
        "the port is opened again by itself, and the units found in it",
        HOLDING,
        "holds after a reset",
        "over: A drive unit does not answer: check its power and its cable, then reset.",
    ),
    row(
        "reboot 1 128 for 0.1",
        "the unit's encoders begin at zero again",
        100,
        MotorAuthority::FAULT_UNIT_REBOOT | MotorAuthority::FAULT_LOST_UNIT,
        FAULTED,
        "stops at once and holds on all lines; the position is from before and has to be confirmed",
    ),
    row(
        "estop 1 128",
        "the unit's own status, asked for every 12 cycles for two units, every 24 where answers leave little time for it; or the port's \
         stop_pin, looked at in every cycle",
        40,
        MotorAuthority::FAULT_EMERGENCY_INPUT,
        MotorAuthority::MODE_EMERGENCY_STOP,
        "the unit lets its motors go by itself; every other line is held where it is at once, until the button is released and the robot \
         is reset",
    ),
    row(
        "supply 9",
        "five readings below supply_min_v; it is asked for every 12 cycles for two units, every 24 where answers leave little time for it",
        80,
        MotorAuthority::FAULT_SUPPLY,
        FAULTED,
        STOPS,
    ),
    row(
        "stall 2",
        "the drive pushes with more than stall_duty and the line does not move, for stall_cycles; where it was to be paid out it is slack as well",
        100,
        MotorAuthority::FAULT_STALL,
        FAULTED,
        LETS_GO,
    ),
    row(
        "dead 2",
        "the drive pushes with more than stall_duty and the line does not seem to move, for stall_cycles",
        100,
        MotorAuthority::FAULT_STALL,
        FAULTED,
        LETS_GO,
    ),
    row(
        "slip 2 1.0",
        "as an encoder that is dead, if the wheel slips wholly; a small part that slips is not found out as such: the node is then elsewhere \
         by that part of the line's motion",
        100,
        MotorAuthority::FAULT_STALL,
        FAULTED,
        LETS_GO,
    ),
    row(
        "jump 2 500",
        "a step beyond what the line's commands since the last reading explain, in two readings one after the other: 5 mm, and 30 mm/s and a \
         quarter of `cable_speed_limit_m_s` for the time between; a smaller one is not found out: the node is then elsewhere by that much",
        5,
        MotorAuthority::FAULT_ENCODER_JUMP,
        FAULTED,
        "stops at once and holds on all lines; the length stays what it was, and the position has to be confirmed",
    ),
    row(
        "break 2",
        "a line that is reeled in without the current of its tension, or paid out and not pulled",
        100,
        MotorAuthority::FAULT_SLACK,
        FAULTED,
        STOPS,
    ),
    row("stop controller", NO_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, ON_THE_PATH),
    noted(
        "continue controller",
        "commands arrive again",
        HOLDING,
        "holds; `resume` goes on with the motion",
        "over: The controller stopped answering, so the robot stopped and holds: when nims status shows it again, resume; if it does not come \
         back, end nims up and start it again.",
    ),
    row("stop estimator", NO_ESTIMATE, 10, ESTIMATOR_GONE, HOLDING, ON_THE_PATH),
    row("kill controller", NO_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, ON_THE_PATH),
    row("kill estimator", NO_ESTIMATE, 10, ESTIMATOR_GONE, HOLDING, ON_THE_PATH),
    row(
        "kill planner",
        "no sign of life for two seconds",
        250,
        MotorAuthority::FAULT_PLANNER_LOST,
        HOLDING,
        "finishes the segment that it is on and holds",
    ),
    noted(
        "kill recorder",
        "the supervisor sees its end at once and starts another, which repairs the file of the first",
        FOLLOWING,
        "the mission goes on; the channels keep over a second for the next recorder",
        "recorder was ended by signal 9",
    ),
    noted(
        "kill motor-io",
        "the drives hear nothing for as long as their own watchdog waits (watchdog_s), and stop their motors",
        MotorAuthority::MODE_DISARMED,
        "the gears hold the lines or let them run out, as `nims check` says; started again it is disarmed, with the position from before",
        "motor-io was ended by signal 9",
    ),
    row("slow controller 10", OLD_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, ON_THE_PATH),
    row("slow estimator 10", OLD_ESTIMATE, 10, MotorAuthority::FAULT_ESTIMATE_LOST, HOLDING, ON_THE_PATH),
    row(
        "nan controller",
        "a command that is no number is refused, for as many cycles as ttl_cycles",
        10,
        MotorAuthority::FAULT_COMMAND_REFUSED,
        HOLDING,
        ON_THE_PATH,
    ),
    row(
        "nan estimator",
        "an estimate that is no number is refused, for as many cycles as ttl_cycles",
        10,
        MotorAuthority::FAULT_ESTIMATE_LOST,
        HOLDING,
        ON_THE_PATH,
    ),
    row("frozen controller", OLD_COMMAND, 10, MotorAuthority::FAULT_COMMAND_LOST, HOLDING, ON_THE_PATH),
    row("frozen estimator", OLD_ESTIMATE, 10, MotorAuthority::FAULT_ESTIMATE_LOST, HOLDING, ON_THE_PATH),
];

impl Row {
    /// First word of the example: the kind.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        self.example.split(' ').next().unwrap_or_default()
    }

    /// What the operator reads, without the cables and units.
    #[must_use]
    pub fn sentence(&self) -> String {
        if self.bits == 0 { self.says.to_owned() } else { fault_sentences(self.bits).collect::<Vec<_>>().join(" ") }
    }
}

/// The arguments and the meaning of a kind.
fn kind_of(name: &str) -> (&'static str, &'static str) {
    let of_box = KINDS.iter().find(|kind| kind.name == name).map(|kind| (kind.arguments, kind.what));
    let of_process = SIGNALS.iter().find(|(word, ..)| *word == name).map(|(_, _, what)| ("PROCESS", *what));
    let of_output =
        OUTPUT_FAULTS.iter().find(|(word, ..)| *word == name).map(|(_, arguments, what)| (*arguments, *what));
    of_box.or(of_process).or(of_output).unwrap_or(("", ""))
}

/// The page `docs/faults.md`.
#[must_use]
pub fn page() -> String {
    let mut page = String::from(
        "# Faults on request\n\n\
         What `nims fault` can break on the virtual motor box, and what the robot makes of it while it moves. On real drives the command does nothing.\n\
         `nims fault KIND ... --for SECONDS` puts it right again after that time, `off` behind the words of most kinds puts it right at once.\n\
         Cables, ports and units count as in the system file, from 1; a unit is named by its address.\n\
         What is said of a controller or an estimator is so without a standby; with one, the standby's answer of the same cycle is used.\n\n\
         This page is the output of `nims fault list`. The tests break each of these things in flight and hold the robot to the number of\n\
         control cycles, the fault and the mode that stand here (`tests/tests/live/faults.rs`; the deaths of processes: `tests/tests/live/processes.rs`).\n\
         From the moment in which a line's encoder or motor is wrong (`stall`, `dead`, `slip`) to the one in which it is found out, the loop pulls the node\n\
         after that line, so that others can hang loose for as long and while the node swings back; none is pulled beyond its limit.\n\n\
         | fault | what happens | how the robot finds out | within cycles | what it does | mode | what it says |\n\
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
            row.found,
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
            "kind": row.kind(), "arguments": arguments, "what": what, "example": row.example, "found": row.found,
            "cycles": row.cycles, "faults": row.bits, "mode": mode_name(row.mode), "reaction": row.reaction, "sentence": row.sentence(),
        })
    });
    json!({ "faults": rows.collect::<Vec<_>>() })
}

/// `nims fault`: the answer and its sentence.
///
/// # Errors
/// No such fault, real drives, no such process; refused; not answered.
pub fn fault(domain: Option<&str>, words: &[String], seconds: Option<f64>) -> Answer<Output> {
    let first = words.first().map(String::as_str).unwrap_or_default();
    if first == "list" && words.len() == 1 && seconds.is_none() {
        return Ok(Output::new(list(), page().trim_end()));
    }
    let signal = SIGNALS.iter().find(|(word, ..)| *word == first);
    let sentence = match signal {
        Some((word, signal, _)) => {
            let [_, name] = words else {
                return Err(Failure::BadInput(format!("say which process: nims fault {word} PROCESS")));
            };
            if seconds.is_some_and(|seconds| *word != "stop" || !(seconds > 0.0 && seconds <= 3600.0)) {
                return Err(Failure::BadInput("--for is for `stop` here: above 0, at most 3600 seconds".to_owned()));
            }
            to_process(&virtual_only(domain)?, word, *signal, name, seconds)?
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
            client::send(&virtual_only(domain)?, &process, &Request::Fault { text })?
        }
    };
    Ok(Output::accepted(sentence))
}

/// Whose output is spoilt, and how.
fn to_output(words: &[String]) -> Answer<(String, String)> {
    let slots = [config::Slot::A, config::Slot::B];
    let names = [Role::Controller, Role::Estimator].map(|role| slots.map(|slot| role.process_name(slot))).concat();
    match words {
        [kind, process, rest @ ..] if names.contains(process) => {
            Ok((process.clone(), [std::slice::from_ref(kind), rest].concat().join(" ")))
        }
        [kind, ..] => {
            Err(Failure::BadInput(format!("say whose output: nims fault {kind} PROCESS, one of {}", names.join(", "))))
        }
        [] => Err(Failure::BadInput("say which fault; nims fault list says what there is".to_owned())),
    }
}

/// The robot that is meant, if its drives are virtual.
fn virtual_only(domain: Option<&str>) -> Answer<Bus> {
    let bus = client::join(domain)?;
    if client::box_of(&bus)?.motor_box.is_none() {
        return Err(Failure::NotNow(
            "this robot has real drives, so nothing was done: faults on request are for the virtual motor box"
                .to_owned(),
        ));
    }
    Ok(bus)
}

fn to_process(bus: &Bus, word: &str, signal: Signal, name: &str, seconds: Option<f64>) -> Answer<String> {
    let own = std::process::id();
    let alive = bus.domain().alive();
    let found = alive.iter().find(|node| node.name == name && node.pid != own).and_then(|node| {
        let pid = i32::try_from(node.pid).ok().and_then(Pid::from_raw)?;
        Some((node.pid, pid))
    });
    let Some((number, pid)) = found else {
        let mut names: Vec<&str> = alive.iter().filter(|node| node.pid != own).map(|node| node.name.as_str()).collect();
        names.sort_unstable();
        return Err(Failure::BadInput(format!("there is no process {name} here; there are {}", names.join(", "))));
    };
    kill_process(pid, signal).map_err(Failure::not_now)?;
    let mut sentence = format!("done: {word} {name} (process {number})");
    if let Some(seconds) = seconds {
        std::thread::sleep(Duration::from_secs_f64(seconds));
        kill_process(pid, Signal::CONT).map_err(Failure::not_now)?;
        let _ = write!(sentence, ", which went on after {seconds} s");
    }
    Ok(sentence)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_a_row_and_every_row_is_a_fault() {
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
            assert_eq!(row.cycles == 0, row.bits == 0, "{}: what is found out is found out by a cycle", row.example);
        }
    }
}
