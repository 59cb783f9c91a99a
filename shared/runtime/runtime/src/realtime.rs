//! Real-time scheduling, a processor of its own, locked memory: as configured, as far as the system permits it.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity};
use thread_priority::{NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy};

use config::RealtimeSection;
use std::fs::File;
use std::io::Write;

/// What was reached; see [`apply`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Reached {
    /// SCHED_FIFO at the configured priority.
    pub fifo: bool,
    /// Bound to the configured processor.
    pub pinned: bool,
    /// Memory locked.
    pub locked: bool,
}

/// The steps above motor-io's priority: whoever is later in the chain preempts who is earlier. `None`: the role has no deadline.
#[must_use]
pub fn priority_step(role: &str) -> Option<u8> {
    match role {
        "motor-io" => Some(0),
        "estimator" => Some(1),
        "controller" => Some(2),
        _ => None,
    }
}

/// Sets up the calling thread (threads that exist already stay ordinary); what is not permitted is left out, and one sentence says what
/// and how to permit it. Of a robot only motor-io says it: who comes later in the chain speaks only where it gets less than motor-io.
pub fn apply(section: &RealtimeSection, role: &str) -> (Reached, Option<String>) {
    let (reached, warning) = match priority_step(role) {
        Some(0) => set_up(section, 0),
        Some(step) => later_in_the_chain(section, step),
        None => (Reached::default(), None),
    };
    if answers_in_a_cycle(role) && !reached.fifo {
        // Nothing to warn of: where the kernel does not know of it, everything is as before.
        bus::fair::short_turns();
    }
    (reached, warning)
}

fn later_in_the_chain(section: &RealtimeSection, step: u8) -> (Reached, Option<String>) {
    let (reached, warning) = set_up(section, step);
    if warning.is_none() {
        return (reached, None);
    }
    match set_up(section, 0) {
        // Everything that motor-io gets: what is missing is the step above it.
        (reached, None) => (reached, warning),
        (reached, Some(_)) => (reached, None),
    }
}

/// Whether a process of this role has to answer within a control cycle: the chain, and the virtual drives.
fn answers_in_a_cycle(role: &str) -> bool {
    priority_step(role).is_some() || role == "motor-box"
}

/// Sets up the calling thread as a process that it is about to start shall run, which inherits it; what is not permitted is left out, and
/// one sentence says what and how to permit it.
#[must_use]
pub fn bequeath(priority: u8, cpu: Option<usize>) -> Option<String> {
    // Locked memory is not inherited.
    set_up(&RealtimeSection { priority, cpu, ..RealtimeSection::default() }, 0).1
}

/// The kernel's PM QoS: who holds this file open with a number in it sees processors wake up within so many microseconds
/// (Documentation/power/pm_qos_interface in the kernel's sources).
const IDLE_LATENCY: &str = "/dev/cpu_dma_latency";

/// Keeps the processors from sleeping deeper than `latency_us` allows, as long as the file is held; or one sentence with the cure.
///
/// # Errors
/// Where the device cannot be written.
pub fn stay_awake(latency_us: u32) -> Result<File, String> {
    let ask = || {
        let mut file = File::options().write(true).open(IDLE_LATENCY)?;
        file.write_all(&i32::try_from(latency_us).unwrap_or(i32::MAX).to_ne_bytes())?;
        Ok::<File, std::io::Error>(file)
    };
    ask().map_err(|error| {
        format!(
            "going on with processors that sleep as deeply as they like: {IDLE_LATENCY}: {error} (scripts/install gives it to the robot's \
             user; on a machine without it leave `realtime.idle_latency_us` away)"
        )
    })
}

/// Makes the calling thread ordinary again, on any processor: for a helper that is started from the control chain, inherits its
/// priority, and would hold it up at every wait for a disk. Lowering oneself is always permitted.
pub fn ordinary() {
    // The crate's scale for niceness 0.
    const NICE_0: u8 = 47;
    let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
    if let Ok(value) = NICE_0.try_into() {
        let thread = thread_priority::unix::thread_native_id();
        // Where even the niceness may not be changed, the policy has been.
        let _ =
            thread_priority::unix::set_thread_priority_and_policy(thread, ThreadPriority::Crossplatform(value), policy);
    }
    let mut all = CpuSet::new();
    (0..CpuSet::MAX_CPU).for_each(|cpu| all.set(cpu));
    let _ = sched_setaffinity(None, &all);
}

fn set_up(section: &RealtimeSection, step: u8) -> (Reached, Option<String>) {
    let (mut reached, mut refused) = (Reached::default(), Vec::new());
    if section.priority > 0 {
        let priority = section.priority.saturating_add(step);
        match fifo(priority) {
            Ok(()) => reached.fifo = true,
            Err(_) => refused.push(format!("SCHED_FIFO priority {priority} (allow it with `LimitRTPRIO=95` in the service unit or `- rtprio 95` in /etc/security/limits.d)")),
        }
    }
    if let Some(cpu) = section.cpu {
        let mut set = CpuSet::new();
        if cpu < CpuSet::MAX_CPU {
            set.set(cpu);
        }
        match sched_setaffinity(None, &set) {
            Ok(()) => reached.pinned = true,
            Err(_) => refused.push(format!(
                "processor {cpu} (this machine or this service has no such processor: `realtime.cpu` counts from 0)"
            )),
        }
    }
    if section.lock_memory {
        // On fault: what is touched stays, and shared memory that nobody uses costs nothing.
        match mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT) {
            Ok(()) => reached.locked = true,
            Err(_) => refused.push("locked memory (allow it with `LimitMEMLOCK=infinity` in the service unit or `- memlock unlimited` in /etc/security/limits.d)".to_owned()),
        }
    }
    let warning = (!refused.is_empty())
        .then(|| format!("going on without what the system does not permit: {}", refused.join("; ")));
    (reached, warning)
}

fn fifo(priority: u8) -> Result<(), thread_priority::Error> {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let value =
        ThreadPriority::Crossplatform(priority.try_into().map_err(|_| thread_priority::Error::Priority("0 to 99"))?);
    thread_priority::unix::set_thread_priority_and_policy(thread_priority::unix::thread_native_id(), value, policy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_permitted_is_one_sentence_with_the_cure() {
        let section = RealtimeSection { cpu: Some(100_000), ..RealtimeSection::default() };
        assert_eq!(apply(&section, "recorder"), (Reached::default(), None));
        let (reached, warning) = apply(&section, "motor-io");
        assert!(!reached.pinned);
        let warning = warning.unwrap();
        assert!(warning.contains("100000") && warning.lines().count() == 1, "{warning}");
    }

    #[test]
    fn the_kernel_confirms_what_was_reached() {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        std::thread::spawn(move || {
            let section = RealtimeSection { priority: 10, cpu: Some(0), ..RealtimeSection::default() };
            let (reached, warning) = apply(&section, "estimator");
            // What is missing is said once for the robot, by motor-io.
            assert!(warning.is_none() || !(reached.fifo && reached.pinned), "{warning:?}");
            assert_eq!(scheduling(), if reached.fifo { ("11".into(), "1".into()) } else { ("0".into(), "0".into()) });
            assert!(!reached.pinned || allowed() == "0", "{}", allowed());
            // A helper that is started from here inherits all of it, and gives it back.
            let (before, after) = std::thread::spawn(|| {
                let before = (scheduling(), allowed());
                ordinary();
                (before, (scheduling(), allowed()))
            })
            .join()
            .unwrap();
            assert_eq!(before, (scheduling(), allowed()));
            assert_eq!(after.0, ("0".into(), "0".into()));
            assert!(processors == 1 || after.1 != "0", "{}", after.1);
        })
        .join()
        .unwrap();
    }

    /// proc_pid_stat(5): field 40 is the real-time priority, 41 the policy (1: SCHED_FIFO); the name in field 2 has no blank here.
    fn scheduling() -> (String, String) {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        (fields[40 - 3].to_owned(), fields[41 - 3].to_owned())
    }

    fn allowed() -> String {
        let status = std::fs::read_to_string("/proc/thread-self/status").unwrap();
        status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:\t")).unwrap().to_owned()
    }
}
