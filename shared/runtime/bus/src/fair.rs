//! Scheduling settings that need no privileges and reduce the wake-up latency of processes.
//!
//! Two effects delay a process that sleeps most of the time. If the kernel groups processes by session
//! (`sched_autogroup`), a process shares the CPU time of its group with all processes started from the same terminal;
//! [`own_session`] gives it its own group. Among processes of equal priority the kernel prefers those with the shortest
//! time slice (EEVDF, Linux 6.12 and later); [`short_turns`] requests a short one.
//!
//! Measured with 12 busy loops on two CPUs, started from the same terminal: a thread that works for 0.7 ms every 5 ms
//! woke up 18 ms late in the median without both settings, and 0.1 ms late with them.

use std::os::unix::process::CommandExt;
use std::process::Command;

/// Requested time slice, ns: the smallest that the kernel accepts.
const TURN_NS: u64 = 100_000;

/// `SCHED_OTHER` of sched(7).
const ORDINARY: u32 = 0;

/// The first version of `struct sched_attr`, see sched_setattr(2).
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
struct Attributes {
    size: u32,
    policy: u32,
    flags: u64,
    nice: i32,
    priority: u32,
    runtime: u64,
    deadline: u64,
    period: u64,
}

/// Makes `command` start its process as the leader of a new session and process group.
#[allow(unsafe_code)]
pub fn own_session(command: &mut Command) {
    // SAFETY: between fork and exec only setsid(2) is called, which is async-signal-safe and allocates nothing.
    unsafe {
        command.pre_exec(|| {
            // A process that was just forked leads no group, so this does not fail; a failure would only cost latency.
            let _ = rustix::process::setsid();
            Ok(())
        });
    }
}

/// Requests short time slices for the calling thread and the threads that it starts. Returns whether they are in
/// effect; false for a thread with real-time priority and with an older kernel.
#[allow(unsafe_code)]
pub fn short_turns() -> bool {
    const SIZE: u32 = size_of::<Attributes>() as u32;
    let mut present = Attributes { size: SIZE, ..Attributes::default() };
    // SAFETY: the kernel writes at most SIZE bytes to a struct of that size, which lives on this stack; 0 is the
    // calling thread.
    let read = unsafe { libc::syscall(libc::SYS_sched_getattr, 0, &raw mut present, SIZE, 0) };
    if read != 0 || present.policy != ORDINARY {
        return false;
    }
    let wanted = Attributes { size: SIZE, runtime: TURN_NS, deadline: 0, period: 0, ..present };
    // SAFETY: the kernel reads `size` bytes of the struct, which is its actual size.
    unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const wanted, 0) == 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_with_its_own_session_is_its_leader() {
        let mut command = Command::new("sleep");
        command.arg("10");
        own_session(&mut command);
        let mut child = command.spawn().unwrap();
        let pid = rustix::process::Pid::from_child(&child);
        let session = rustix::process::getsid(Some(pid));
        let _ = child.kill();
        let _ = child.wait();
        assert_eq!(session, Ok(pid));
    }

    #[test]
    fn short_turns_do_not_change_the_nice_value() {
        std::thread::spawn(|| {
            let before = rustix::process::getpriority_process(None);
            short_turns();
            assert_eq!(rustix::process::getpriority_process(None), before);
        })
        .join()
        .unwrap();
    }
}
