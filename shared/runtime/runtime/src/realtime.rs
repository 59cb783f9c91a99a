//! Real-time scheduling, CPU affinity and locked memory: as configured, as far as the system permits.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity};
use thread_priority::{NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy};

use config::RealtimeSection;
use std::fs::File;
use std::io::Write;

/// Settings that are in effect; see [`apply`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AppliedSettings {
    /// SCHED_FIFO at the configured priority.
    pub fifo: bool,
    /// Bound to the configured CPU.
    pub pinned: bool,
    /// Memory locked.
    pub locked: bool,
}

/// Returns the priority of a role above that of motor-io: a process later in the control chain preempts an earlier one.
/// `None` for roles without a deadline.
#[must_use]
pub fn priority_step(role: &str) -> Option<u8> {
    match role {
        "motor-io" => Some(0),
        "estimator" => Some(1),
        "controller" => Some(2),
        _ => None,
    }
}

/// Applies the settings to the calling thread; existing other threads are not changed. Settings that the system does
/// not permit are skipped, and the returned sentence names them and how to permit them. To avoid repetitions, only
/// motor-io returns it; an estimator or controller does so only if it is permitted less than motor-io.
pub fn apply(section: &RealtimeSection, role: &str) -> (AppliedSettings, Option<String>) {
    let (reached, warning) = match priority_step(role) {
        Some(0) => set_up(section, 0),
        Some(step) => later_in_the_chain(section, step),
        None => (AppliedSettings::default(), None),
    };
    if answers_in_a_cycle(role) && !reached.fifo {
        // Without the support of the kernel nothing changes, so there is no warning.
        bus::fair::short_turns();
    }
    (reached, warning)
}

fn later_in_the_chain(section: &RealtimeSection, step: u8) -> (AppliedSettings, Option<String>) {
    let (reached, warning) = set_up(section, step);
    if warning.is_none() {
        return (reached, None);
    }
    match set_up(section, 0) {
        // motor-io's settings are permitted, but not the higher priority.
        (reached, None) => (reached, warning),
        (reached, Some(_)) => (reached, None),
    }
}

/// Returns whether a process of this role has to respond within a control cycle: the control chain and the virtual
/// motor box.
fn answers_in_a_cycle(role: &str) -> bool {
    priority_step(role).is_some() || role == "motor-box"
}

/// Applies the settings of a process to the calling thread before it starts the process, which inherits them. Settings
/// that the system does not permit are skipped, and the returned sentence names them and how to permit them.
#[must_use]
pub fn apply_for_child(priority: u8, cpu: Option<usize>) -> Option<String> {
    // Locked memory is not inherited.
    set_up(&RealtimeSection { priority, cpu, ..RealtimeSection::default() }, 0).1
}

/// The kernel's PM QoS interface: while a process holds this file open, the CPUs wake up within the number of
/// microseconds written to it (Documentation/power/pm_qos_interface in the kernel's sources).
const IDLE_LATENCY: &str = "/dev/cpu_dma_latency";

/// Limits the idle states of the CPUs to a wake-up latency of `latency_us`, as long as the returned file is open.
///
/// # Errors
/// The device cannot be written: one sentence with the cure.
pub fn stay_awake(latency_us: u32) -> Result<File, String> {
    let ask = || {
        let mut file = File::options().write(true).open(IDLE_LATENCY)?;
        file.write_all(&i32::try_from(latency_us).unwrap_or(i32::MAX).to_ne_bytes())?;
        Ok::<File, std::io::Error>(file)
    };
    ask().map_err(|error| {
        format!(
            "the idle latency of the processors is not limited: {IDLE_LATENCY}: {error} (scripts/install gives the robot's user access; on a \
             machine without this device remove `realtime.idle_latency_us`)"
        )
    })
}

/// Resets the calling thread to ordinary scheduling on any CPU. For helper threads of the control chain, which inherit
/// its priority and would delay it. Lowering the priority is always permitted.
pub fn ordinary() {
    // Nice value 0 on the scale of the crate thread_priority.
    const NICE_0: u8 = 47;
    let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
    if let Ok(value) = NICE_0.try_into() {
        let thread = thread_priority::unix::thread_native_id();
        // If the nice value may not be changed, the policy is changed anyway.
        let _ =
            thread_priority::unix::set_thread_priority_and_policy(thread, ThreadPriority::Crossplatform(value), policy);
    }
    let mut all = CpuSet::new();
    (0..CpuSet::MAX_CPU).for_each(|cpu| all.set(cpu));
    let _ = sched_setaffinity(None, &all);
}

fn set_up(section: &RealtimeSection, step: u8) -> (AppliedSettings, Option<String>) {
    let (mut reached, mut refused) = (AppliedSettings::default(), Vec::new());
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
        // ONFAULT: only used pages are locked, so unused shared memory takes no RAM.
        match mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT) {
            Ok(()) => reached.locked = true,
            Err(_) => refused.push("locked memory (allow it with `LimitMEMLOCK=infinity` in the service unit or `- memlock unlimited` in /etc/security/limits.d)".to_owned()),
        }
    }
    let warning = (!refused.is_empty())
        .then(|| format!("running without settings that the system does not permit: {}", refused.join("; ")));
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
    fn settings_that_are_not_permitted_cause_one_sentence_with_the_cure() {
        let section = RealtimeSection { cpu: Some(100_000), ..RealtimeSection::default() };
        assert_eq!(apply(&section, "recorder"), (AppliedSettings::default(), None));
        let (reached, warning) = apply(&section, "motor-io");
        assert!(!reached.pinned);
        let warning = warning.unwrap();
        assert!(warning.contains("100000") && warning.lines().count() == 1, "{warning}");
    }

    #[test]
    fn the_kernel_confirms_the_settings_in_effect() {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        std::thread::spawn(move || {
            let section = RealtimeSection { priority: 10, cpu: Some(0), ..RealtimeSection::default() };
            let (reached, warning) = apply(&section, "estimator");
            // Only motor-io reports missing permissions.
            assert!(warning.is_none() || !(reached.fifo && reached.pinned), "{warning:?}");
            assert_eq!(scheduling(), if reached.fifo { ("11".into(), "1".into()) } else { ("0".into(), "0".into()) });
            assert!(!reached.pinned || allowed() == "0", "{}", allowed());
            // A helper thread inherits the settings, and `ordinary` resets them.
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

    /// Real-time priority and policy (1: SCHED_FIFO), fields 40 and 41 of proc_pid_stat(5); the name in field 2 has no
    /// space.
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
