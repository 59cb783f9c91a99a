//! Requests to the supervisor while the robot runs. They are answered at once; the process table shows the outcome.

use super::Supervisor;
use super::archive::Archive;
use super::closing::moves;
use super::managed_process::{AfterEnd, ManagedProcess};
use super::process_spec::{ProcessSpec, RunContext, slot_role};
use super::refused::{Decision, bus_failed};
use super::restarts::Restarts;
use bus::{Server, clock};
use client::SUPERVISOR;
use command::Answer;
use config::Role;
use messages::{CONTROLLERS, ESTIMATORS, MotorAuthority, Request, Slot};
use robot_state::Reason;
use robot_state::answers::detail;
use std::path::PathBuf;

/// Silence of motor-io beyond the drives' watchdog after which nothing moves, ns: a shared machine can stand still for
/// 250 ms.
const SILENT_NS: u64 = 1_000_000_000;

impl Supervisor {
    /// Answers the requests that arrived since the last call.
    pub(super) fn serve(&mut self) -> Answer {
        let Some(mut server) = self.server.take() else { return Ok(()) };
        let served = self.serve_from(&mut server);
        self.server = Some(server);
        served
    }

    fn serve_from(&mut self, server: &mut Server) -> Answer {
        while let Some(call) = server.try_next()? {
            // Each request may wait for a disk, and motor-io waits 2 s for a sign of life.
            self.heartbeat_if_due()?;
            let answer = match Request::decode(&call.request) {
                Ok(request) => self.carry_out(&request),
                Err(error) => Ok(Reason::Undecodable { why: detail(error) }),
            };
            let reason = answer.unwrap_or_else(|refused| *refused.0);
            self.announcer.info(&format!("asked: {reason}"));
            // An answer that cannot be sent must not stop the supervisor.
            if let Err(error) = call.answer(&reason.answer()) {
                self.announcer.warn(&error.to_string());
            }
            self.publish_table()?;
        }
        Ok(())
    }

    fn carry_out(&mut self, request: &Request) -> Decision {
        match request {
            Request::StartProcess { name, slot, law } => {
                let member = self.which(name, *slot, law.as_deref())?;
                self.begin(&member)
            }
            Request::StopProcess { name } => self.stop_one(name, AfterEnd::Stay),
            Request::RestartProcess { name } => {
                let Some(child) = self.process_set.find(name) else {
                    let member = self.which(name, None, None)?;
                    return self.begin(&member);
                };
                if child.is_alive() {
                    self.stop_one(name, AfterEnd::Restart)
                } else {
                    let member = child.member.clone();
                    self.begin(&member)
                }
            }
            Request::Plug { name, folder, command, replace } => {
                let runs = self
                    .process_set
                    .find(name)
                    .is_some_and(|child| child.member.role == Role::Other && child.is_alive());
                // A process of the system file that was unplugged, because its device accepts only one program.
                let is_asleep = !self.process_set.find(name).is_some_and(ManagedProcess::is_alive)
                    && self.context.section(name).is_some_and(|section| section.role == Role::Other);
                if self.is_taken(name) && !(*replace && (runs || is_asleep)) {
                    let process = detail(name);
                    return Err(match runs {
                        true => Reason::NameRuns { process },
                        false => Reason::NameTaken { process },
                    }
                    .into());
                }
                let member = self.plugged(name, folder, command)?;
                if runs { self.replace(member) } else { self.begin(&member) }
            }
            Request::Unplug { name } => {
                let role = self.process_set.find(name).map(|child| child.member.role);
                match role {
                    Some(Role::Other) => self.stop_one(name, AfterEnd::Remove),
                    Some(role) => Err(Reason::NotPluggable { process: detail(name), role: detail(role.name()) }.into()),
                    None => Err(self.unknown(name).into()),
                }
            }
            Request::Set { key, value } => self.set(key, value),
            // `nims fault` sends the signal itself; the request is its record.
            Request::Fault { text } => Ok(Reason::FaultDone { fault: detail(text) }),
            // The recorder has the request itself.
            Request::Mark { text } => Ok(Reason::Marked { mark: detail(text) }),
            _ => Ok(Reason::OtherProcess { takes: detail("requests for processes and parameters") }),
        }
    }

    /// A plugged program; the configuration files in its command are replaced by the run's copies.
    fn plugged(&mut self, name: &str, folder: &str, command: &[String]) -> Decision<ProcessSpec> {
        let (context, own, folder, command) =
            (self.context.clone(), name.to_owned(), PathBuf::from(folder), command.to_vec());
        let work = move || {
            let member = context.plugged(&own, &folder, &command)?;
            let files = member.configurations();
            Ok((member, files))
        };
        let (mut member, files) = self.in_time(name, work, drop::<Decision<_>>)??;
        let give_up = Archive::deadline();
        for (at, path) in files {
            if let (Some(copy), Some(argument)) = (self.archive.copy_for(name, path, give_up), member.args.get_mut(at))
            {
                *argument = copy.into();
            }
        }
        Ok(member)
    }

    /// Whether the name is not available for a plugged process.
    fn is_taken(&mut self, name: &str) -> bool {
        let standard = Role::STANDARD.iter().any(|(_, role)| {
            role.process_name(Slot::A) == name || role.has_slots() && role.process_name(Slot::B) == name
        });
        let alive = self.process_set.find(name).is_some_and(ManagedProcess::is_alive);
        name == SUPERVISOR || standard || alive || self.context.section(name).is_some()
    }

    /// Finds the process that a request names, and how to start it.
    fn which(&mut self, name: &str, slot: Option<Slot>, law: Option<&str>) -> Decision<ProcessSpec> {
        let slotted = Role::STANDARD.iter().map(|(_, role)| *role).filter(|role| role.has_slots()).find_map(|role| {
            if role.process_name(Slot::B) == name {
                Some((role, Some(Slot::B)))
            } else {
                (role.name() == name).then_some((role, None))
            }
        });
        if let Some((role, own)) = slotted {
            if let (Some(own), Some(slot)) = (own, slot)
                && own != slot
            {
                let [slot, given] = [own, slot].map(|slot| messages::Slot::ALL[slot.index()]);
                return Err(Reason::InOtherSlot { process: detail(name), slot, given }.into());
            }
            let slot = match own.or(slot) {
                Some(slot) => slot,
                None => self.free_slot(role)?,
            };
            return match law {
                Some(law) => {
                    let law = law.to_owned();
                    self.looked_up(name, move |context| context.with_law(role, slot, &law))
                }
                None => match self.process_set.find(&role.process_name(slot)) {
                    Some(child) => Ok(child.member.clone()),
                    None => self.looked_up(name, move |context| context.of_role(role, Some(slot))),
                },
            };
        }
        if let Some(section) = self.context.section(name).cloned() {
            if !section.role.has_slots() {
                refuse_slot_and_law(name, slot, law)?;
                return self.looked_up(name, move |context| context.configured(&section, None));
            }
            if law.is_some() {
                return Err(Reason::HasOwnLaw { process: detail(name) }.into());
            }
            let slot = match slot.or(section.slot) {
                Some(slot) => slot,
                None => self.free_slot(section.role)?,
            };
            return self.looked_up(name, move |context| context.configured(&section, Some(slot)));
        }
        refuse_slot_and_law(name, slot, law)?;
        if let Some(child) = self.process_set.find(name) {
            return Ok(child.member.clone());
        }
        match Role::STANDARD.iter().find(|(standard, _)| *standard == name) {
            Some((_, Role::MotorBox)) if self.context.file.motor_box.is_none() => Err(Reason::NoMotorBox.into()),
            Some((_, role)) => self.looked_up(name, |context| context.of_role(*role, None)),
            None => Err(self.unknown(name).into()),
        }
    }

    /// How to start a process whose program may be on a disk that does not answer.
    fn looked_up(
        &mut self,
        name: &str,
        look: impl FnOnce(&RunContext) -> Decision<ProcessSpec> + Send + 'static,
    ) -> Decision<ProcessSpec> {
        let context = self.context.clone();
        self.in_time(name, move || look(&context), drop::<Decision<_>>)?
    }

    /// The first slot of a role without a running process.
    fn free_slot(&mut self, role: Role) -> Decision<Slot> {
        let taken = |supervisor: &mut Self, slot| {
            supervisor.process_set.find(&role.process_name(slot)).is_some_and(ManagedProcess::is_alive)
        };
        [Slot::A, Slot::B].into_iter().find(|slot| !taken(self, *slot)).ok_or_else(|| {
            match slot_role(role) {
                Some(role) => Reason::SlotsTaken { role },
                None => Reason::NoSlotNoLaw { process: detail(role.name()) },
            }
            .into()
        })
    }

    fn begin(&mut self, member: &ProcessSpec) -> Decision {
        let name = &member.name;
        let mut restarts = Restarts::default();
        let in_its_place = self.process_set.iter_mut().find(|child| child.member.name == *name);
        if let Some(child) = in_its_place {
            if child.is_alive() {
                return Err(Reason::ProcessRunning { process: detail(name), pid: child.pid }.into());
            }
            restarts.total = child.restarts.total;
            restarts.record_restart();
        }
        self.launch(member, restarts)?;
        if let Some(alias) = &member.alias {
            // From now on the table lists it under the name of its slot.
            self.publish_farewell(alias).map_err(bus_failed)?;
        }
        let law = member.law.as_deref().or(member.alias.as_deref());
        let process = law.map_or_else(|| detail(name), |law| detail(format_args!("{name} with {law}")));
        Ok(Reason::ProcessStarts { process })
    }

    pub(super) fn stop_one(&mut self, name: &str, then: AfterEnd) -> Decision {
        let authority = self.last_authority;
        self.is_not_succeeded(name)?;
        let Some(child) = self.process_set.find(name) else { return Err(self.unknown(name).into()) };
        let (name, alive) = (child.member.name.clone(), child.is_alive());
        if !alive {
            if child.again_ns.take().is_some() && then == AfterEnd::Stay {
                return Ok(Reason::ProcessStays { process: detail(name) });
            }
            if then == AfterEnd::Remove {
                self.forget(&name).map_err(bus_failed)?;
                return Ok(Reason::ProcessUnplugged { process: detail(name) });
            }
            return Err(Reason::ProcessNotRunning { process: detail(name) }.into());
        }
        if child.asked.is_some() {
            return Err(Reason::ProcessEnding { process: detail(name) }.into());
        }
        let (member, hangs) = (child.member.clone(), child.hangs);
        // The last status of a hung motor-io is outdated: the watchdog of the drives has stopped the motors.
        let watchdog_s = self.context.file.motor_io.watchdog_s;
        let present = authority.filter(|authority| !hangs || is_present(authority, watchdog_s, clock::now_ns()));
        if present.is_some_and(|authority| flies(&member, &authority)) {
            return Err(Reason::ProcessNeeded { process: detail(name), role: slot_role(member.role) }.into());
        }
        let Some(child) = self.process_set.find(&name) else { return Err(self.unknown(&name).into()) };
        child.ask_to_end(then);
        Ok(match then {
            AfterEnd::Stay => Reason::ProcessEnds { process: detail(name) },
            AfterEnd::Restart => Reason::ProcessRestarts { process: detail(name) },
            AfterEnd::Remove => Reason::ProcessUnplugs { process: detail(name) },
        })
    }

    fn unknown(&self, name: &str) -> Reason {
        let mut known: Vec<&str> = self.process_set.iter().map(|child| child.member.name.as_str()).collect();
        known.extend(self.context.file.process.iter().map(|section| section.name.as_str()));
        known.sort_unstable();
        known.dedup();
        Reason::UnknownProcess { process: detail(name), known: detail(known.join(", ")) }
    }
}

fn refuse_slot_and_law(name: &str, slot: Option<Slot>, law: Option<&str>) -> Decision<()> {
    if slot.is_none() && law.is_none() {
        return Ok(());
    }
    Err(Reason::NoSlotNoLaw { process: detail(name) }.into())
}

/// Whether the status of motor-io is recent enough that the drives may still move.
fn is_present(authority: &MotorAuthority, watchdog_s: f64, now_ns: u64) -> bool {
    now_ns.saturating_sub(authority.header.stamp_ns) < (watchdog_s * 1e9) as u64 + SILENT_NS
}

/// Whether the robot moves and would stop without that process.
fn flies(member: &ProcessSpec, authority: &MotorAuthority) -> bool {
    let active = |slot: u8| member.slot.is_some_and(|own| own.index() == usize::from(slot));
    moves(authority)
        && match member.role {
            Role::MotorIo | Role::MotorBox => true,
            Role::Controller => active(authority.in_charge[CONTROLLERS]),
            Role::Estimator => active(authority.in_charge[ESTIMATORS]),
            Role::Planner | Role::Recorder | Role::Other => false,
        }
}

#[cfg(test)]
mod tests {
    use super::super::restarts::Policy;
    use super::*;

    #[test]
    fn an_old_state_of_motor_io_is_not_used() {
        let mut authority = MotorAuthority::default();
        authority.header.stamp_ns = 5 * SILENT_NS;
        assert!(is_present(&authority, 0.3, 6 * SILENT_NS));
        assert!(!is_present(&authority, 0.3, 7 * SILENT_NS));
        assert!(is_present(&authority, 2.0, 7 * SILENT_NS), "the drives may still move");
    }

    #[test]
    fn only_processes_in_charge_of_a_moving_robot_cannot_be_ended() {
        let member = |role, slot| ProcessSpec {
            name: "x".to_owned(),
            alias: None,
            role,
            slot,
            law: None,
            program: "/bin/true".into(),
            args: Vec::new(),
            folder: None,
            restart: Policy { again: false, pause_ns: 1, limit: 1, forgiven_ns: 1 },
            sends_heartbeats: true,
            priority: 0,
            cpu: None,
        };
        let mut authority = MotorAuthority { in_charge: [1, 0], ..Default::default() };
        let cases = [
            (Role::Controller, Some(Slot::A), false),
            (Role::Controller, Some(Slot::B), true),
            (Role::Estimator, Some(Slot::A), true),
            (Role::Estimator, Some(Slot::B), false),
            (Role::MotorIo, None, true),
            (Role::MotorBox, None, true),
            (Role::Planner, None, false),
            (Role::Recorder, None, false),
            (Role::Other, None, false),
        ];
        for (role, slot, expected) in cases {
            for mode in [MotorAuthority::MODE_FOLLOWING, MotorAuthority::MODE_JOGGING, MotorAuthority::MODE_STOPPING] {
                authority.mode = mode;
                assert_eq!(flies(&member(role, slot), &authority), expected, "{role:?} {slot:?}");
            }
            for mode in [MotorAuthority::MODE_HOLDING, MotorAuthority::MODE_DISARMED, MotorAuthority::MODE_FAULTED] {
                authority.mode = mode;
                assert!(!flies(&member(role, slot), &authority), "{role:?} {slot:?}");
            }
        }
    }
}
