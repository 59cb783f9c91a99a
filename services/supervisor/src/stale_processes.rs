//! Processes that outlived their supervisor: the next supervisor finds and ends them.

use bus::Domain;
use command::{Answer, Failure};
use config::Role;
use messages::Slot;
use rustix::process::{Pid, Signal, kill_process, test_kill_process};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// File in the domain's folder in which the supervisor lists the processes that it started.
const FILE: &str = "children.json";
/// Time for a stale process to end after SIGTERM: motor-io first stops the robot, and the recorder writes its buffers.
const PATIENCE: Duration = Duration::from_secs(8);
/// Bytes of a program's name in `/proc/PID/comm`.
const COMM_BYTES: usize = 15;

/// Identity of a process; the start time distinguishes it from a later process with the same id.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessIdentity {
    /// Name on the bus.
    pub name: String,
    /// Process id.
    pub pid: u32,
    /// Start time in the kernel's ticks since boot.
    pub start_ticks: u64,
}

impl ProcessIdentity {
    /// The process of this id, if it runs.
    #[must_use]
    pub fn now(name: &str, pid: u32) -> Option<Self> {
        Some(Self { name: name.to_owned(), pid, start_ticks: start_ticks(pid)? })
    }

    fn lives(&self) -> bool {
        start_ticks(self.pid) == Some(self.start_ticks)
    }

    /// Its place in the order of the end.
    fn stage(&self) -> u8 {
        match standard_program(&self.name) {
            Some("motor-io") => 0,
            Some("recorder") => 2,
            _ => 1,
        }
    }

    fn signal(&self, signal: Signal) {
        if self.lives()
            && let Some(pid) = Pid::from_raw(self.pid.cast_signed())
        {
            // It may just have ended; then the signal has no target.
            let _ = kill_process(pid, signal);
        }
    }
}

/// Field 22 of /proc/PID/stat. The name in field 2 may contain blanks and parentheses, so counting starts after the
/// last parenthesis.
fn start_ticks(pid: u32) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    let state = fields.next()?;
    if state == "Z" { None } else { fields.nth(18)?.parse().ok() }
}

/// Whether the process of this id runs the program of that name: any program can join a domain under any name.
fn runs(pid: u32, program: &str) -> bool {
    let comm = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    !comm.is_empty() && comm.trim_end() == &program[..program.len().min(COMM_BYTES)]
}

/// The standard program that joins a domain under that name.
fn standard_program(name: &str) -> Option<&'static str> {
    let of = |role: Role| name == role.process_name(Slot::A) || role.has_slots() && name == role.process_name(Slot::B);
    Role::STANDARD.iter().find(|(_, role)| of(*role)).map(|(program, _)| *program)
}

/// Writes a file in the domain's folder atomically.
///
/// # Errors
/// The folder cannot be written.
pub fn write(domain: &Domain, name: &str, text: &str) -> Answer {
    let path = domain.root().join(name);
    let fresh = domain.root().join(format!("{name}.new"));
    std::fs::write(&fresh, text)
        .and_then(|()| std::fs::rename(&fresh, &path))
        .map_err(|error| Failure::NotNow(format!("{} cannot be written: {error}", path.display())))
}

/// Writes the list of started processes.
///
/// # Errors
/// The folder of the domain cannot be written.
pub fn record(domain: &Domain, started: &[ProcessIdentity]) -> Answer {
    let text = serde_json::to_string(started).map_err(Failure::not_now)?;
    write(domain, FILE, &text)
}

/// Ends these at once, with SIGKILL those that do not end in time.
fn end_all(stale: &[ProcessIdentity]) {
    for signal in [Signal::TERM, Signal::KILL] {
        for process in stale {
            process.signal(signal);
        }
        let deadline = Instant::now() + PATIENCE;
        while stale.iter().any(ProcessIdentity::lives) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Ends the processes that an earlier supervisor of this domain left running, and returns their names. motor-io ends
/// first, because it brings the robot to rest and the others are of use to it until then; the recorder ends last.
///
/// Call it only while holding the claim of the domain.
///
/// # Errors
/// A process cannot be ended.
pub fn end(domain: &Domain) -> Answer<Vec<String>> {
    let written = std::fs::read_to_string(domain.root().join(FILE)).unwrap_or_default();
    let mut stale: Vec<ProcessIdentity> = serde_json::from_str(&written).unwrap_or_default();
    for node in domain.alive() {
        // A foreign process that joined the domain by itself is left running.
        let known = stale.iter().any(|process| process.pid == node.pid);
        if !known && standard_program(&node.name).is_some_and(|program| runs(node.pid, program)) {
            stale.extend(ProcessIdentity::now(&node.name, node.pid));
        }
    }
    stale.retain(ProcessIdentity::lives);
    stale.sort_by_key(ProcessIdentity::stage);
    for stage in stale.chunk_by(|a, b| a.stage() == b.stage()) {
        end_all(stage);
    }
    if let Some(process) = stale.iter().find(|process| process.lives()) {
        let owner = Pid::from_raw(process.pid.cast_signed()).is_some_and(|pid| test_kill_process(pid).is_ok());
        let cure = if owner { "end it by hand" } else { "it belongs to another user: end it as that user" };
        return Err(Failure::NotNow(format!(
            "{} (process {}) of an earlier run does not end: {cure}",
            process.name, process.pid
        )));
    }
    Ok(stale.into_iter().map(|process| process.name).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_identified_by_its_start_time() {
        let own = ProcessIdentity::now("test", std::process::id()).unwrap();
        assert!(own.lives());
        assert!(!ProcessIdentity { start_ticks: own.start_ticks + 1, ..own.clone() }.lives());
        assert!(!ProcessIdentity { pid: u32::MAX / 2, ..own }.lives());
    }

    #[test]
    fn a_process_that_only_has_the_name_is_not_ended() {
        let domain = Domain::for_test();
        // this test program, in the place of a controller
        let bus = bus::Bus::join(&domain, "controller").unwrap();
        assert!(end(&domain).unwrap().is_empty());
        drop(bus);
        assert!(!runs(std::process::id(), "controller"));
        let comm = std::fs::read_to_string("/proc/self/comm").unwrap();
        assert!(runs(std::process::id(), comm.trim_end()));
    }

    #[test]
    fn a_second_controller_is_a_standard_program_too() {
        assert_eq!(standard_program("controller-b"), Some("controller"));
        assert_eq!(standard_program("estimator"), Some("estimator"));
        assert_eq!(standard_program("planner-b"), None);
        assert_eq!(standard_program("rangefinder"), None);
    }

    #[test]
    fn the_list_is_replaced_at_once() {
        let domain = Domain::for_test();
        record(&domain, &[]).unwrap();
        record(&domain, &[]).unwrap();
        let names: Vec<_> = std::fs::read_dir(domain.root()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names, [FILE], "no temporary file remains");
    }

    #[test]
    fn motor_io_ends_before_all_others_and_the_recorder_last() {
        let domain = Domain::for_test();
        let order = domain.root().join("order");
        let names = ["recorder", "controller-b", "motor-io", "rangefinder"];
        let mut children: Vec<_> = names
            .iter()
            .map(|name| {
                let up = domain.root().join(format!("{name}.up"));
                let script = format!(
                    "trap 'echo {name} >> {}; exit' TERM; touch {}; while :; do sleep 0.01; done",
                    order.display(),
                    up.display()
                );
                let child = std::process::Command::new("sh").args(["-c", &script]).spawn().unwrap();
                let give_up = Instant::now() + Duration::from_secs(20);
                while !up.exists() {
                    assert!(Instant::now() < give_up);
                    std::thread::sleep(Duration::from_millis(2));
                }
                child
            })
            .collect();
        let started: Vec<_> =
            names.iter().zip(&children).map(|(name, child)| ProcessIdentity::now(name, child.id()).unwrap()).collect();
        record(&domain, &started).unwrap();
        assert_eq!(end(&domain).unwrap().len(), names.len());
        for child in &mut children {
            assert!(child.wait().unwrap().success());
        }
        let ended = std::fs::read_to_string(&order).unwrap();
        let ended: Vec<&str> = ended.lines().collect();
        assert_eq!((ended.len(), ended.first(), ended.last()), (4, Some(&"motor-io"), Some(&"recorder")), "{ended:?}");
    }

    #[test]
    fn stale_processes_are_ended_and_named() {
        let domain = Domain::for_test();
        let mut sleeper = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        record(&domain, &[ProcessIdentity::now("sleeper", sleeper.id()).unwrap()]).unwrap();
        assert_eq!(end(&domain).unwrap(), ["sleeper"]);
        assert!(!sleeper.wait().unwrap().success());
        assert!(end(&domain).unwrap().is_empty());
    }
}
