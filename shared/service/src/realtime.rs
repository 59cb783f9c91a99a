//! Real-time scheduling, a processor of its own, locked memory: as configured, as far as the system permits it.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity};
use thread_priority::{RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy};

use crate::config::RealtimeSection;

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
/// and how to permit it.
pub fn apply(section: &RealtimeSection, role: &str) -> (Reached, Option<String>) {
    let (mut reached, mut refused) = (Reached::default(), Vec::new());
    let Some(step) = priority_step(role) else { return (reached, None) };
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
        let section = RealtimeSection { priority: 0, cpu: Some(100_000), lock_memory: false };
        assert_eq!(apply(&section, "recorder"), (Reached::default(), None));
        let (reached, warning) = apply(&section, "motor-io");
        assert!(!reached.pinned);
        let warning = warning.unwrap();
        assert!(warning.contains("processor 100000") && warning.lines().count() == 1, "{warning}");
    }

    #[test]
    fn the_kernel_confirms_what_was_reached() {
        std::thread::spawn(|| {
            let section = RealtimeSection { priority: 10, cpu: Some(0), lock_memory: false };
            let (reached, warning) = apply(&section, "estimator");
            assert_eq!(warning.is_none(), reached.fifo && reached.pinned, "{warning:?}");
            // proc_pid_stat(5): field 40 is the real-time priority, 41 the policy (1: SCHED_FIFO); the name in field 2 has no blank here
            let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
            let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
            let (priority, policy) = (fields[40 - 3], fields[41 - 3]);
            assert_eq!((priority, policy), if reached.fifo { ("11", "1") } else { ("0", "0") });
            let status = std::fs::read_to_string("/proc/thread-self/status").unwrap();
            let allowed = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:\t")).unwrap();
            assert!(!reached.pinned || allowed == "0", "{allowed}");
        })
        .join()
        .unwrap();
    }
}
