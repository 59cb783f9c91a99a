//! `nims swap`: replaces the controller or estimator in charge while the robot moves.
//!
//! The new process is started in the slot that is not in charge, qualifies while the other one is in charge, and takes
//! over in a cycle that motor-io announces. The old process runs for another second, in case the new one fails, and is
//! then ended, unless the system has a standby.

use crate::processes;
use bus::clock;
use client::{LinkWaiter, MOTOR_IO, Place, RobotLink, Samples};
use command::{Answer, Failure, Output};
use config::Role;
use messages::{MotorSlots, ProcessState, Request, SLOTS, Slot, SlotRole, text_of};
use robot_state::sentences;
use serde_json::json;
use std::collections::BTreeMap;

/// `nims swap`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Role to swap.
    #[arg(value_parser = config::slot_role_argument())]
    pub role: SlotRole,
    /// Law or method, or the name of a `[[process]]` of the role, to start in the free slot. Default: the standby that
    /// runs there.
    pub name: Option<String>,
    /// Slot of the new process. Default: the one that is not in charge.
    #[arg(long, value_parser = config::slot_argument())]
    pub slot: Option<Slot>,
    /// Keep the old process running, as a standby.
    #[arg(long)]
    pub keep: bool,
    /// Only re-admit a slot that was quarantined after repeated failures.
    #[arg(long, conflicts_with_all = ["name", "keep"])]
    pub admit: bool,
}

/// Swaps the controller or estimator in charge, or re-admits a slot.
///
/// # Errors
/// The request is refused, with the reason, or the swap fails.
pub fn run(place: Place<'_>, args: &Args) -> Answer<Output> {
    let link = client::link(place)?;
    if args.admit { admit(&link, args) } else { swap(&link, args) }
}

/// Name that selects the configured law.
const DEFAULT: &str = "default";
/// Longest time for the new process to qualify, s; normally one second.
const QUALIFY_S: f64 = 20.0;
/// Longest time to wait for a row of the process table, s; each is published once a second.
const TABLE_S: f64 = 1.5;
/// Longest time from the announcement to the end of the probation, s; normally little more than one second.
const SWAP_S: f64 = 10.0;

/// Swaps, and prints the progress on stderr if that is a terminal.
///
/// # Errors
/// The new process could not be started, did not qualify, was refused, or failed just after it had taken over; each
/// with the reason.
fn swap(link: &RobotLink, asked: &Args) -> Answer<Output> {
    let mut robot = Robot::observe(link, asked)?;
    let lead = robot.lead()?;
    let slot = asked.slot.map_or(1 - lead, Slot::index);
    if slot == lead {
        return Err(Failure::BadInput(format!(
            "the {} in slot {} is in charge: use the other slot for the new one",
            robot.role_name(),
            name_of(slot).name()
        )));
    }
    let (new, old) = (robot.role.process_name(name_of(slot)), robot.role.process_name(name_of(lead)));
    if let Some(law) = asked.name.as_deref().filter(|law| *law != DEFAULT) {
        // Check the law before a process is ended to free the slot.
        client::system_of(link)?.process_for(robot.role, law).map_err(Failure::bad)?;
    }
    if let Some(law) = &asked.name {
        robot.end(&new)?;
        robot.admit(slot)?;
        let start = Request::StartProcess {
            name: robot.role.name().to_owned(),
            slot: Some(name_of(slot)),
            law: (law != DEFAULT).then(|| law.clone()),
        };
        robot.change(&start)?;
    }
    let outcome = robot.qualify(slot, &new).and_then(|()| robot.take_over(slot));
    if let Err(failure) = outcome {
        if asked.name.is_some() && !asked.keep {
            // End the new process. Report the reason of the failed swap even if this fails.
            let _ = robot.end(&new);
        }
        return Err(failure);
    }
    let keep = asked.keep || robot.keeps_standby()?;
    if !keep {
        robot.end(&old)?;
    }
    let rest = if keep { format!("{old} stands by") } else { format!("{old} has ended") };
    let sentence = format!("{new} is in charge; {rest}.");
    Ok(Output::new(
        json!({ "accepted": true, "answer": sentence, "slot": name_of(slot).name(), "standby": keep }),
        sentence,
    ))
}

fn name_of(slot: usize) -> Slot {
    if slot == 0 { Slot::A } else { Slot::B }
}

/// The state of the robot during a swap.
struct Robot<'a> {
    link: &'a RobotLink,
    index: usize,
    role: Role,
    slots: Samples<MotorSlots>,
    /// The rows of the process table, except while a change is followed.
    processes: Option<Samples<ProcessState>>,
    table: BTreeMap<String, ProcessState>,
    waiter: LinkWaiter,
    newest: Option<MotorSlots>,
    prints_progress: bool,
    last_printed: String,
}

impl<'a> Robot<'a> {
    fn observe(link: &'a RobotLink, asked: &Args) -> Answer<Self> {
        Ok(Self {
            link,
            index: asked.role.index(),
            role: asked.role.into(),
            slots: link.subscriber("motor/slots")?,
            processes: Some(link.subscriber("system/process")?),
            table: BTreeMap::new(),
            waiter: link.waiter(&["motor/slots"])?,
            newest: None,
            prints_progress: std::io::IsTerminal::is_terminal(&std::io::stderr()),
            last_printed: String::new(),
        })
    }

    fn role_name(&self) -> &'static str {
        sentences::ROLE_NAMES[self.index]
    }

    /// Prints a text that differs from the last one, if stderr is a terminal.
    fn print_progress(&mut self, text: &str) {
        if self.prints_progress && self.last_printed != text {
            self.last_printed = text.to_owned();
            eprintln!("nims: {text}");
        }
    }

    /// Waits for the next samples, and returns the newest of motor-io.
    fn poll(&mut self) -> Answer<Option<MotorSlots>> {
        self.waiter.wait_until(Some(clock::now_ns() + clock::SECOND_NS / 10))?;
        if let Some(processes) = &mut self.processes {
            while let Some(row) = processes.receive()? {
                self.table.insert(text_of(&row.name), row);
            }
        }
        self.newest = self.slots.latest()?.or(self.newest);
        Ok(self.newest)
    }

    /// Polls until `done` returns a result; `None` after `seconds`.
    fn until<T>(
        &mut self,
        seconds: f64,
        mut done: impl FnMut(&mut Self, &MotorSlots) -> Answer<Option<T>>,
    ) -> Answer<Option<T>> {
        let give_up = clock::now_ns() + (seconds * 1e9) as u64;
        while clock::now_ns() < give_up {
            if let Some(slots) = self.poll()?
                && let Some(found) = done(self, &slots)?
            {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// The slot in charge.
    fn lead(&mut self) -> Answer<usize> {
        let role = self.index;
        self.until(1.0, |_, slots| Ok(Some(usize::from(slots.in_charge[role]).min(SLOTS - 1))))?
            .ok_or_else(|| Failure::NotNow("no message from motor-io; a swap needs it, see nims status".to_owned()))
    }

    fn state_of(&self, process: &str) -> Option<u8> {
        self.table.get(process).map(|row| row.state)
    }

    fn runs(&self, process: &str) -> bool {
        use ProcessState as P;
        let alive = [P::STATE_STARTING, P::STATE_READY, P::STATE_STOPPING, P::STATE_SILENT];
        self.state_of(process).is_some_and(|state| alive.contains(&state))
    }

    /// Ends a process, if it runs.
    fn end(&mut self, process: &str) -> Answer {
        let name = process.to_owned();
        self.until(TABLE_S, |robot, _| Ok(robot.table.contains_key(&name).then_some(())))?;
        if !self.runs(process) {
            return Ok(());
        }
        self.change(&Request::StopProcess { name })
    }

    /// Requests a change of the processes, and follows it to its end.
    fn change(&mut self, command: &Request) -> Answer {
        // Through a gateway, a connection has one subscription of a channel.
        self.processes = None;
        let followed = processes::send_and_follow(self.link, command);
        self.processes = Some(self.link.subscriber("system/process")?);
        self.print_progress(&followed?.words);
        Ok(())
    }

    /// Admits a slot regardless of its former failures.
    fn admit(&mut self, slot: usize) -> Answer {
        let request = Request::Admit { role: SlotRole::ALL[self.index], slot: name_of(slot) };
        client::send(self.link, MOTOR_IO, &request).map(|_| ())
    }

    /// Waits until the slot holds a standby.
    fn qualify(&mut self, slot: usize, process: &str) -> Answer {
        let index = SLOTS * self.index + slot;
        let process = process.to_owned();
        let occupied = self.until(TABLE_S, |robot, slots| {
            Ok((robot.runs(&process) || slots.phase[index] != MotorSlots::PHASE_EMPTY).then_some(()))
        })?;
        if occupied.is_none() {
            let role = self.role_name();
            return Err(Failure::NotNow(format!("no {role} runs in that slot; start one with nims swap {role} LAW")));
        }
        let qualified = self.until(QUALIFY_S, |robot, slots| {
            robot.print_progress(&progress(robot.index, index, slots));
            if robot.state_of(&process) == Some(ProcessState::STATE_GAVE_UP) {
                return Err(Failure::NotNow(format!("{process} does not run: see its log")));
            }
            Ok(match slots.phase[index] {
                MotorSlots::PHASE_QUALIFIED | MotorSlots::PHASE_QUARANTINED => Some(()),
                _ => None,
            })
        })?;
        if qualified.is_none() {
            self.print_progress("the new process does not qualify");
        }
        // The answer of motor-io to the request to swap contains the reason.
        Ok(())
    }

    /// Requests the swap, and waits until the end of the probation.
    fn take_over(&mut self, slot: usize) -> Answer {
        let (role, index) = (self.index, SLOTS * self.index + slot);
        let request = Request::Swap { role: SlotRole::ALL[role], slot: name_of(slot) };
        let answer = client::send(self.link, MOTOR_IO, &request)?;
        self.print_progress(&answer);
        // Ignore samples from before the request.
        let requested_in = self.newest.map_or(0, |slots| slots.header.cycle) + 2;
        let other = SLOTS * role + (1 - slot);
        let done = self.until(SWAP_S, |robot, slots| {
            if slots.header.cycle <= requested_in {
                return Ok(None);
            }
            robot.print_progress(&progress(role, index, slots));
            let in_charge = usize::from(slots.in_charge[role]) == slot;
            if !in_charge && slots.commit_cycle[role] == 0 {
                let cause = slots.cause[index];
                let phrase = sentences::cause_phrase(role, cause);
                let why = if phrase.is_empty() { "had no output in the announced cycle" } else { phrase };
                return Err(Failure::NotNow(format!(
                    "not swapped: the new {} {why}, so the old one is in charge; {}",
                    robot.role_name(),
                    cure(cause)
                )));
            }
            let over = slots.phase[other] != MotorSlots::PHASE_PROBATION && slots.fade[role] >= 1.0;
            Ok((in_charge && over).then_some(()))
        })?;
        done.ok_or_else(|| Failure::NotNow("the swap timed out; see nims status".to_owned()))
    }

    /// Returns whether the system file has a standby for this role.
    fn keeps_standby(&self) -> Answer<bool> {
        let file = client::system_of(self.link)?;
        Ok(file.process.iter().any(|section| section.role == self.role && section.standby))
    }
}

/// Returns what to do after a swap that failed for this cause.
fn cure(cause: u8) -> &'static str {
    match cause {
        // One late answer is enough.
        MotorSlots::CAUSE_NONE | MotorSlots::CAUSE_ABSENT | MotorSlots::CAUSE_PROBATION => {
            "give the same command again, because a busy computer delays single answers; if it fails again, end what \
             else runs on the computer, and see in the log of the new one how long its answers take"
        }
        MotorSlots::CAUSE_RESTARTED => "see in its log why it ended, then give the same command again",
        _ => "look at its log and its configuration before the next swap",
    }
}

/// Returns the phase of a slot with its progress, in words.
pub(crate) fn progress(role: usize, index: usize, slots: &MotorSlots) -> String {
    let name = sentences::phase_name(slots.phase[index]);
    match slots.phase[index] {
        MotorSlots::PHASE_SHADOW => {
            let unit = if role == 0 { "m/s" } else { "m" };
            let deviation = slots.deviation[index].max(0.0);
            let (well, all) = (slots.good_cycles[index], slots.qualify_cycles);
            format!("{name}: {well} of {all} cycles, {deviation:.3} {unit} from the one in charge")
        }
        MotorSlots::PHASE_SWITCHING => format!("{name}: takes over in cycle {}", slots.commit_cycle[role]),
        MotorSlots::PHASE_ACTIVE if slots.fade[role] < 1.0 => {
            format!("{name}: {:.0} % of the command", 100.0 * slots.fade[role])
        }
        _ => name.to_owned(),
    }
}

/// Re-admits a quarantined slot: `nims swap ROLE --admit`.
///
/// # Errors
/// motor-io does not answer.
fn admit(link: &RobotLink, asked: &Args) -> Answer<Output> {
    let mut robot = Robot::observe(link, asked)?;
    let slot = match asked.slot {
        Some(slot) => slot.index(),
        None => 1 - robot.lead()?,
    };
    let request = Request::Admit { role: SlotRole::ALL[robot.index], slot: name_of(slot) };
    let sentence = client::send(link, MOTOR_IO, &request)?;
    Ok(Output::accepted(sentence))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_after_a_late_answer_the_same_swap_is_asked_for_again_at_once() {
        let again = |cause: u8| cure(cause).starts_with("give the same command again");
        let causes: Vec<u8> = (MotorSlots::CAUSE_NONE..=MotorSlots::CAUSE_PROBATION).collect();
        let late: Vec<u8> = causes.iter().copied().filter(|cause| again(*cause)).collect();
        assert_eq!(late, [MotorSlots::CAUSE_NONE, MotorSlots::CAUSE_ABSENT, MotorSlots::CAUSE_PROBATION]);
        for cause in causes {
            assert!(!sentences::cause_phrase(0, cause).contains("; "), "a second remedy");
            assert!(!cure(cause).ends_with('.'), "the sentence goes on");
        }
    }

    #[test]
    fn the_progress_of_a_slot_is_described() {
        let mut slots = MotorSlots { qualify_cycles: 100, ..MotorSlots::default() };
        slots.phase[3] = MotorSlots::PHASE_SHADOW;
        slots.good_cycles[3] = 40;
        slots.deviation[3] = 0.002;
        let shadow = progress(1, 3, &slots);
        assert!(["shadow", "40 of 100", "0.002 m"].iter().all(|part| shadow.contains(part)), "{shadow}");
        slots.phase[3] = MotorSlots::PHASE_ACTIVE;
        slots.fade = [1.0, 0.3];
        let active = progress(1, 3, &slots);
        assert!(active.starts_with("active") && active.contains("30 %"), "{active}");
    }
}
