//! The scheduling that `[realtime]` requests, and how much of it this machine permits.

use config::{RealtimeSection, Role};
use runtime::realtime;
use serde::Serialize;
use std::fs::File;

/// The roles that answer within a cycle, in the order of the chain.
const ROLES: [Role; 4] = [Role::MotorIo, Role::Estimator, Role::Controller, Role::MotorBox];

/// Returns the recommended scheduling of the control chain without a system file. It does not pin a processor, because
/// only the owner of the system knows which one is free.
pub fn recommended() -> RealtimeSection {
    RealtimeSection { priority: 50, idle_latency_us: Some(0), ..RealtimeSection::default() }
}

/// Scheduling that was achieved.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct AchievedScheduling {
    /// SCHED_FIFO priority; `null`: ordinary scheduling.
    pub fifo_priority: Option<u8>,
    /// Pinned processor; `null`: any.
    pub cpu: Option<usize>,
    /// Whether memory is locked.
    pub memory_locked: bool,
    /// Maximum wake-up latency of a processor, µs; `null`: system default.
    pub idle_latency_us: Option<u32>,
    /// Refused settings, each with a remedy.
    pub refused: Vec<String>,
    /// Priority of each process that answers within a cycle.
    pub given: Vec<GrantedPriority>,
}

/// Priority of a process of the robot according to the kernel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GrantedPriority {
    /// Role of the process.
    pub role: &'static str,
    /// SCHED_FIFO priority requested by the system file; `null`: none.
    pub asked: Option<u8>,
    /// SCHED_FIFO priority granted by the kernel; `null`: ordinary.
    pub got: Option<u8>,
}

/// Configures one thread per role and reads its priority from the kernel.
fn given(section: &RealtimeSection) -> Vec<GrantedPriority> {
    let of = |role: Role| {
        let section = section.clone();
        let asked = realtime::priority_step(role.name())
            .filter(|_| section.priority > 0)
            .map(|step| section.priority.saturating_add(step));
        let tried = std::thread::spawn(move || {
            // Undo the inherited scheduling, which the supervisor's children do not have.
            realtime::ordinary();
            realtime::apply(&section, role.name());
            kernel_priority()
        });
        GrantedPriority { role: role.name(), asked, got: tried.join().ok().flatten() }
    };
    ROLES.into_iter().map(of).collect()
}

/// Returns the real-time priority of this thread. In proc_pid_stat(5), field 40 is the priority and 41 the policy (1:
/// SCHED_FIFO); the name in field 2 may contain any character.
fn kernel_priority() -> Option<u8> {
    let stat = std::fs::read_to_string("/proc/thread-self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
    let of = |number: usize| fields.get(number - 3).copied();
    if of(41)? == "1" { of(40)?.parse().ok() } else { None }
}

/// Schedules the calling thread like motor-io; the returned file keeps the processors awake while it is open.
pub fn apply(section: &RealtimeSection) -> (AchievedScheduling, Option<File>) {
    let (reached, refused) = realtime::apply(section, Role::MotorIo.name());
    let awake = section.idle_latency_us.map(realtime::stay_awake);
    let (awake, sleepy) = match awake {
        Some(Ok(file)) => (Some(file), None),
        Some(Err(sentence)) => (None, Some(sentence)),
        None => (None, None),
    };
    let found = AchievedScheduling {
        fifo_priority: reached.fifo.then_some(section.priority),
        cpu: section.cpu.filter(|_| reached.pinned),
        memory_locked: reached.locked,
        idle_latency_us: section.idle_latency_us.filter(|_| awake.is_some()),
        refused: [refused, sleepy].into_iter().flatten().collect(),
        given: given(section),
    };
    (found, awake)
}

impl AchievedScheduling {
    /// Returns one line for the achieved scheduling and one for each refused setting.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut parts = vec![match self.fifo_priority {
            Some(priority) => format!("SCHED_FIFO priority {priority}"),
            None => "ordinary priority".to_owned(),
        }];
        parts.extend(self.cpu.map(|cpu| format!("on processor {cpu}")));
        if self.memory_locked {
            parts.push("memory locked".to_owned());
        }
        parts.extend(self.idle_latency_us.map(|latency| match latency {
            0 => "processors kept awake".to_owned(),
            latency => format!("processors awake within {latency} µs"),
        }));
        let mut lines = vec![format!("scheduled like motor-io: {}", parts.join(", "))];
        if !self.given.is_empty() {
            let each: Vec<String> = self.given.iter().map(GrantedPriority::words).collect();
            lines.push(format!("priorities granted by the kernel: {}", each.join(", ")));
        }
        lines.extend(self.refused.iter().cloned());
        lines
    }
}

impl GrantedPriority {
    fn words(&self) -> String {
        match (self.got, self.asked) {
            (Some(got), Some(asked)) if got == asked => format!("{} {got}", self.role),
            (Some(got), Some(asked)) => format!("{} {got} instead of {asked}", self.role),
            (Some(got), None) => format!("{} {got}, which was not requested", self.role),
            (None, Some(asked)) => format!("{} ordinary instead of {asked}", self.role),
            (None, None) => format!("{} ordinary", self.role),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn granted_priorities_are_read_from_the_kernel() {
        let section = RealtimeSection { priority: 10, ..RealtimeSection::default() };
        let found = given(&section);
        assert_eq!(found.iter().map(|given| given.asked).collect::<Vec<_>>(), [Some(10), Some(11), Some(12), None]);
        // No priority is granted that was not requested, whatever the rights of this user.
        assert!(found.iter().all(|given| given.got.is_none() || given.got <= given.asked), "{found:?}");
        let words = GrantedPriority { role: "estimator", asked: Some(51), got: Some(50) }.words();
        let places: Vec<_> = ["estimator", "50", "51"].iter().filter_map(|part| words.find(part)).collect();
        assert!(places.len() == 3 && places.is_sorted(), "{words}");
    }

    #[test]
    fn refused_settings_are_reported() {
        let section = RealtimeSection { cpu: Some(100_000), ..RealtimeSection::default() };
        let (reached, _) = std::thread::spawn(move || apply(&section)).join().unwrap();
        assert_eq!((reached.fifo_priority, reached.cpu, reached.idle_latency_us), (None, None, None));
        let words = reached.lines();
        assert_eq!(words.len(), 3, "{words:?}");
        assert!(words[0].contains("ordinary") && words[1].contains("motor-box"), "{words:?}");
        assert!(words[2].contains("100000"), "{words:?}");
    }

    #[test]
    fn achieved_settings_are_all_listed() {
        let reached = AchievedScheduling {
            fifo_priority: Some(50),
            cpu: Some(1),
            memory_locked: true,
            idle_latency_us: Some(20),
            refused: Vec::new(),
            given: Vec::new(),
        };
        let words = reached.lines().join("\n");
        for word in ["priority 50", "processor 1", "locked", "20 µs"] {
            assert!(words.contains(word), "{words}");
        }
    }
}
