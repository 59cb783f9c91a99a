//! The processes that were started; they end downstream before upstream, the recorder last.
//!
//! Architecture invariant: the processes never outlive their `ProcessSet`. When it is dropped, also by a panic, it ends
//! them in order.

use super::managed_process::{AfterEnd, ManagedProcess};
use super::process_spec::ProcessSpec;
use super::successor::Successor;
use bus::clock;
use config::Role;

/// Order in which processes end.
const ORDER: [Role; 7] = [
    Role::Planner,
    Role::Controller,
    Role::Estimator,
    Role::Other,
    // stops a moving robot before it ends
    Role::MotorIo,
    Role::MotorBox,
    Role::Recorder,
];
/// Polling period while processes end, ns.
const POLL_NS: u64 = 5_000_000;

/// Processes in the order in which they were started.
#[derive(Debug, Default)]
pub struct ProcessSet {
    children: Vec<ManagedProcess>,
    /// Processes that will replace a running process of the same name.
    pub successors: Vec<Successor>,
}

impl ProcessSet {
    /// Adds a process, or replaces an earlier incarnation of it.
    pub fn insert(&mut self, child: ManagedProcess) {
        match self.children.iter_mut().find(|other| other.member.name == child.member.name) {
            Some(place) => *place = child,
            None => self.children.push(child),
        }
    }

    /// Removes the processes for which `which` returns true.
    pub fn remove(&mut self, which: impl Fn(&ManagedProcess) -> bool) {
        self.children.retain(|child| !which(child));
    }

    /// All processes, in the order in which they were started.
    pub fn iter(&self) -> impl Iterator<Item = &ManagedProcess> {
        self.children.iter()
    }

    /// As [`Self::iter`], mutable.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut ManagedProcess> {
        self.children.iter_mut()
    }

    /// The process of that name: its name on the bus takes precedence over its name in the system file, and a running
    /// process over an ended one.
    pub fn find(&mut self, name: &str) -> Option<&mut ManagedProcess> {
        let ranked = self.children.iter().enumerate().filter(|(_, child)| child.member.has_name(name));
        let best = ranked.max_by_key(|(_, child)| (child.member.name == name, child.exit.is_none())).map(|(at, _)| at);
        best.and_then(|at| self.children.get_mut(at))
    }

    /// Whether a process of that role runs and has reported that it is ready.
    #[must_use]
    pub fn has_ready(&self, role: Role) -> bool {
        self.children.iter().any(|child| child.member.role == role && child.exit.is_none() && child.ready_ns.is_some())
    }

    /// A ready process of the same role in the other slot.
    #[must_use]
    pub fn standby_of(&self, member: &ProcessSpec) -> Option<&ManagedProcess> {
        let stands_in = |child: &&ManagedProcess| {
            child.member.role == member.role
                && child.member.slot != member.slot
                && child.exit.is_none()
                && child.ready_ns.is_some()
        };
        if member.role.has_slots() { self.children.iter().find(stands_in) } else { None }
    }

    /// Ends all processes; calls `while_waiting` every few milliseconds, and `killed` with the name of each process
    /// that had to be killed.
    pub fn end(&mut self, mut while_waiting: impl FnMut(&Self), mut killed: impl FnMut(&str)) {
        self.children.extend(self.successors.drain(..).map(|successor| successor.child));
        for role in ORDER {
            let of_role = |child: &&mut ManagedProcess| child.member.role == role;
            for child in self.children.iter_mut().filter(of_role) {
                child.ask_to_end(AfterEnd::Stay);
            }
            while self.children.iter_mut().filter(of_role).any(|child| child.is_alive() && !child.survives()) {
                let now = clock::now_ns();
                for child in self.children.iter_mut().filter(of_role) {
                    if child.kill_if_overdue(now) {
                        killed(&child.member.name);
                    }
                }
                while_waiting(self);
                clock::sleep_until(clock::now_ns() + POLL_NS);
            }
        }
    }
}

impl Drop for ProcessSet {
    fn drop(&mut self) {
        self.end(|_| (), |_| ());
    }
}

#[cfg(test)]
mod tests {
    use super::super::managed_process::{END_NS, Start};
    use super::super::restarts::{Policy, Restarts};
    use super::*;
    use std::path::Path;

    fn member(name: &str, role: Role, script: &str) -> ProcessSpec {
        ProcessSpec {
            name: name.to_owned(),
            alias: None,
            role,
            slot: None,
            law: None,
            program: "/bin/sh".into(),
            args: vec!["-c".into(), script.into()],
            folder: None,
            restart: Policy { again: false, pause_ns: 1, limit: 1, forgiven_ns: 1 },
            sends_heartbeats: false,
            priority: 0,
            cpu: None,
        }
    }

    fn start(folder: &Path, name: &str, role: Role, script: &str) -> ManagedProcess {
        started(folder, &member(name, role, script))
    }

    fn started(folder: &Path, member: &ProcessSpec) -> ManagedProcess {
        let with = Start { domain: "test", changes: 0, succeeds: false, log: &folder.join(&member.name) };
        ManagedProcess::start(member, with, Restarts::default()).unwrap().0
    }

    fn wait_for(what: impl Fn() -> bool) {
        let give_up = clock::now_ns() + 20_000_000_000;
        while !what() {
            assert!(clock::now_ns() < give_up);
            clock::sleep_until(clock::now_ns() + 5_000_000);
        }
    }

    fn lives(pid: u32) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        !stat.is_empty() && !stat.contains(") Z")
    }

    #[test]
    fn dropping_the_set_ends_its_processes_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let order = folder.path().join("order");
        let script = |name: &str| {
            format!(
                "trap 'echo {name} >> {}; exit' TERM; touch {name}.up; while :; do sleep 0.01; done",
                order.display()
            )
        };
        let panicked = std::panic::catch_unwind(|| {
            let mut process_set = ProcessSet::default();
            for (name, role) in [("recorder", Role::Recorder), ("motor-io", Role::MotorIo), ("planner", Role::Planner)]
            {
                let mut member = member(name, role, &script(name));
                member.folder = Some(folder.path().to_owned());
                process_set.insert(started(folder.path(), &member));
                wait_for(|| folder.path().join(format!("{name}.up")).exists());
            }
            panic!("failure in the supervisor");
        });
        assert!(panicked.is_err());
        assert_eq!(std::fs::read_to_string(&order).unwrap(), "planner\nmotor-io\nrecorder\n");
    }

    #[test]
    fn the_children_of_a_process_end_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let note = folder.path().join("grandchild");
        let script = format!("sleep 1000 & echo $! > {0}.new; mv {0}.new {0}; wait", note.display());
        let mut child = start(folder.path(), "parent", Role::Other, &script);
        wait_for(|| note.exists());
        let grandchild: u32 = std::fs::read_to_string(&note).unwrap().trim().parse().unwrap();
        assert!(lives(grandchild));
        // killed from outside: the supervisor only observes the end
        rustix::process::kill_process(
            rustix::process::Pid::from_raw(child.pid.cast_signed()).unwrap(),
            rustix::process::Signal::KILL,
        )
        .unwrap();
        let give_up = clock::now_ns() + 20_000_000_000;
        while child.is_alive() {
            assert!(clock::now_ns() < give_up);
        }
        wait_for(|| !lives(grandchild));
        assert!(child.has_died());
    }

    #[test]
    fn a_stopped_process_can_be_ended() {
        let folder = tempfile::tempdir().unwrap();
        let mut process_set = ProcessSet::default();
        process_set.insert(start(folder.path(), "still", Role::Other, "kill -STOP $$; sleep 1000"));
        let pid = process_set.iter().next().unwrap().pid;
        wait_for(|| std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap().contains(") T"));
        process_set.end(|_| (), |name| panic!("{name} had to be killed"));
        assert_eq!(process_set.iter().next().unwrap().state(), messages::ProcessState::STATE_STOPPED);
    }

    #[test]
    fn a_process_that_survived_its_kill_does_not_prevent_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let note = folder.path().join("up");
        let script = format!("trap '' TERM; touch {}; while :; do sleep 0.1; done", note.display());
        let mut child = start(folder.path(), "blocked", Role::Other, &script);
        wait_for(|| note.exists());
        // Like a process that the supervisor has killed, and that is blocked in the kernel.
        child.asked = Some((0, AfterEnd::Stay));
        child.killed_ns = Some(0);
        let pid = child.pid;
        let mut process_set = ProcessSet::default();
        process_set.insert(child);
        let begun = clock::now_ns();
        process_set.end(|_| (), |name| panic!("{name} was killed again"));
        assert!(clock::now_ns() - begun < END_NS && lives(pid));
        process_set.iter_mut().for_each(ManagedProcess::end_hung);
    }

    #[test]
    fn the_last_diagnostic_is_stored() {
        let folder = tempfile::tempdir().unwrap();
        let mut child = start(
            folder.path(),
            "speaker",
            Role::Planner,
            "echo first >&2; echo the port is gone >&2; echo >&2; exit 3",
        );
        while child.is_alive() {}
        assert_eq!(child.last_diagnostic(), Some("the port is gone"));
        assert_eq!(child.state(), messages::ProcessState::STATE_DIED);
        assert_eq!(child.exit.unwrap().code(), Some(3));
        assert!(super::super::managed_process::ending(child.exit.unwrap()).ends_with(" 3"));
    }

    #[test]
    fn an_info_line_does_not_explain_an_end() {
        let folder = tempfile::tempdir().unwrap();
        let words = |name: &str, script: &str| {
            let mut child = start(folder.path(), name, Role::Recorder, script);
            while child.is_alive() {}
            child.last_diagnostic().map(str::to_owned)
        };
        assert_eq!(words("quiet", "echo 'INFO  recorder: recording to run.mcap' >&2; kill -9 $$"), None);
        let warned = "echo 'WARN  recorder: slow' >&2; echo 'INFO  recorder: ready' >&2; exit 1";
        assert_eq!(words("warned", warned).as_deref(), Some("WARN  recorder: slow"));
    }

    #[test]
    fn a_name_on_the_bus_takes_precedence_over_one_in_the_system_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut process_set = ProcessSet::default();
        let mut first = start(folder.path(), "controller-b", Role::Controller, "sleep 1000");
        first.member.alias = Some("mine".to_owned());
        process_set.insert(first);
        process_set.insert(start(folder.path(), "mine", Role::Other, "sleep 1000"));
        assert_eq!(process_set.find("mine").unwrap().member.role, Role::Other);
        assert_eq!(process_set.find("controller-b").unwrap().member.role, Role::Controller);
        assert!(process_set.find("unknown").is_none());
    }
}
