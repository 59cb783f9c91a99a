//! A request to the supervisor, followed on the process table until it has taken effect.

use crate::link::RobotLink;
use crate::robot::SUPERVISOR;
use bus::clock;
use command::{Answer, Failure};
use messages::{OperatorRequest, ProcessState, Request, put_text, text_of};
use robot_state::Reason;

/// Longest wait for a process to become ready or to end, ns: longer than the timeouts of the supervisor.
const PATIENCE_NS: u64 = 25_000_000_000;
/// A program without heartbeats that runs for this time counts as started, ns: a wrong argument ends it sooner.
const SETTLED_NS: u64 = 300_000_000;

/// Sends a request to the supervisor and waits until the process table shows the change; `seen` receives every row of
/// the process.
///
/// # Errors
/// No supervisor, refused, or the change failed or timed out.
pub fn follow(link: &RobotLink, asked: &Request, mut seen: impl FnMut(&ProcessState)) -> Answer<ProcessState> {
    let mut table = link.subscriber::<ProcessState>("system/process")?;
    let mut waiter = link.waiter(&["system/process"])?;
    let asked_ns = clock::now_ns();
    let answer = link.ask(SUPERVISOR, asked)?;
    let sentence = Failure::unless_accepted(&answer)?;
    if let Some(row) = plugin_row(&answer, asked, &sentence) {
        return Ok(row);
    }
    let give_up = clock::now_ns() + PATIENCE_NS;
    loop {
        while let Some(row) = table.receive()? {
            if !is_meant(&row, asked) || row.header.stamp_ns < asked_ns {
                continue;
            }
            seen(&row);
            match outcome(&row, asked, asked_ns) {
                Some(true) => return Ok(row),
                Some(false) => {
                    return Err(Failure::NotNow(format!("{}: {}", text_of(&row.name), text_of(&row.reason))));
                }
                None => {}
            }
        }
        if clock::now_ns() >= give_up {
            return Err(Failure::NotNow(format!("{sentence}, but this timed out; see `nims status`")));
        }
        waiter.wait_until(Some(give_up))?;
    }
}

/// The row of a plug-in, which the service manager runs: the gateway's answer comes when it has done so, and the
/// process table does not have it. Its `reason` is that answer.
fn plugin_row(answer: &OperatorRequest, asked: &Request, sentence: &str) -> Option<ProcessState> {
    let state = match Reason::from_request(answer)? {
        Reason::PluginStarted { .. } => ProcessState::STATE_RUNNING,
        Reason::PluginStopped { .. } => ProcessState::STATE_STOPPED,
        _ => return None,
    };
    let mut row = ProcessState { state, ..ProcessState::default() };
    if let Request::StartProcess { name, .. } | Request::StopProcess { name } | Request::RestartProcess { name } = asked
    {
        put_text(&mut row.name, name);
    }
    put_text(&mut row.reason, sentence);
    Some(row)
}

/// Returns whether a row belongs to the requested process, by any of its names.
fn is_meant(row: &ProcessState, asked: &Request) -> bool {
    let (Request::StartProcess { name, .. }
    | Request::StopProcess { name }
    | Request::RestartProcess { name }
    | Request::Plug { name, .. }
    | Request::Unplug { name }) = asked
    else {
        return false;
    };
    let named = text_of(&row.name) == *name || text_of(&row.law) == *name;
    match asked {
        Request::StartProcess { slot, .. } => {
            let role = text_of(&row.role) == *name;
            (named || role) && slot.is_none_or(|slot| usize::from(row.slot) == slot.index() + 1)
        }
        _ => named,
    }
}

/// Returns whether the change has succeeded; `None`: not decided yet.
fn outcome(row: &ProcessState, asked: &Request, asked_ns: u64) -> Option<bool> {
    match asked {
        Request::StopProcess { .. } => match row.state {
            ProcessState::STATE_STOPPED | ProcessState::STATE_DIED | ProcessState::STATE_GAVE_UP => Some(true),
            _ => None,
        },
        Request::Unplug { .. } => (row.state == ProcessState::STATE_GONE).then_some(true),
        Request::StartProcess { .. } | Request::RestartProcess { .. } | Request::Plug { .. } => {
            // An earlier run of the process, or another process of the same role.
            if row.started_ns < asked_ns {
                return None;
            }
            match row.state {
                ProcessState::STATE_READY => Some(true),
                ProcessState::STATE_RUNNING => {
                    (row.header.stamp_ns.saturating_sub(row.started_ns) >= SETTLED_NS).then_some(true)
                }
                ProcessState::STATE_STOPPED | ProcessState::STATE_DIED | ProcessState::STATE_GAVE_UP => Some(false),
                _ => None,
            }
        }
        // No process comes or goes.
        _ => Some(true),
    }
}

/// Returns the word for a state of the process table.
#[must_use]
pub fn state_name(state: u8) -> &'static str {
    match state {
        ProcessState::STATE_STOPPED => "stopped",
        ProcessState::STATE_STARTING => "starting",
        ProcessState::STATE_READY => "ready",
        ProcessState::STATE_STOPPING => "stopping",
        ProcessState::STATE_DIED => "DIED",
        ProcessState::STATE_SILENT => "SILENT",
        ProcessState::STATE_GAVE_UP => "DIED for good",
        ProcessState::STATE_RUNNING => "running",
        ProcessState::STATE_GONE => "gone",
        _ => "unknown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Slot, put_text};

    fn row(name: &str, role: &str, slot: u8, state: u8, started_ns: u64) -> ProcessState {
        let mut row = ProcessState { state, slot, started_ns, ..Default::default() };
        row.header.stamp_ns = started_ns;
        put_text(&mut row.name, name);
        put_text(&mut row.role, role);
        row
    }

    #[test]
    fn the_process_is_found_under_each_of_its_names() {
        let start = |name: &str, slot| Request::StartProcess { name: name.to_owned(), slot, law: None };
        let mut second = row("controller-b", "controller", 2, ProcessState::STATE_READY, 10);
        put_text(&mut second.law, "mine");
        for name in ["controller", "controller-b", "mine"] {
            assert!(is_meant(&second, &start(name, None)), "{name}");
            assert!(is_meant(&second, &start(name, Some(Slot::B))), "{name}");
            assert!(!is_meant(&second, &start(name, Some(Slot::A))), "{name}");
        }
        // `controller` does not name the one in slot b.
        assert!(!is_meant(&second, &Request::StopProcess { name: "controller".to_owned() }));
        assert!(is_meant(&second, &Request::StopProcess { name: "mine".to_owned() }));
    }

    #[test]
    fn an_earlier_life_is_not_taken_for_the_new_one() {
        let asked = Request::RestartProcess { name: "planner".to_owned() };
        let of = |state, started| outcome(&row("planner", "planner", 0, state, started), &asked, 100);
        assert_eq!(of(ProcessState::STATE_READY, 99), None);
        assert_eq!(of(ProcessState::STATE_DIED, 99), None);
        assert_eq!(of(ProcessState::STATE_STARTING, 101), None);
        assert_eq!(of(ProcessState::STATE_READY, 101), Some(true));
        assert_eq!(of(ProcessState::STATE_DIED, 101), Some(false));
    }

    #[test]
    fn a_program_without_heartbeats_has_to_run_for_a_moment() {
        let (name, command) = ("wind".to_owned(), vec!["wind".to_owned()]);
        let asked = Request::Plug { name, folder: "/".to_owned(), command, replace: false };
        let mut fresh = row("wind", "other", 0, ProcessState::STATE_RUNNING, 100);
        assert_eq!(outcome(&fresh, &asked, 100), None);
        fresh.header.stamp_ns += SETTLED_NS;
        assert_eq!(outcome(&fresh, &asked, 100), Some(true));
    }
}
