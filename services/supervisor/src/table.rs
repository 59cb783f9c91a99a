//! The process table: one row per process on `system/process`, each published once a second, part by part, and on its
//! change.

use super::Supervisor;
use super::cures::{LossState, cure};
use super::managed_process::ManagedProcess;
use bus::clock;
use command::Answer;
use config::{ProcessSection, Role};
use messages::{ProcessState, Slot, put_sentence, put_text};
use std::os::unix::process::ExitStatusExt;

/// Period of the table, ns.
const TABLE_NS: u64 = 1_000_000_000;
/// Parts in which the table is published again within its period. A reader has room for 512 rows: one that looks ten
/// times a second receives all rows of the largest robot.
const PARTS: usize = 10;

impl Supervisor {
    /// Publishes the next part of the rows if it is due.
    pub(super) fn refresh_table(&mut self) -> Answer {
        if clock::now_ns() < self.last_part_ns + TABLE_NS / PARTS as u64 {
            return Ok(());
        }
        self.last_part_ns = clock::now_ns();
        for mut row in self.rows(self.next_part, PARTS) {
            self.send_row(&mut row)?;
        }
        self.next_part = (self.next_part + 1) % PARTS;
        Ok(())
    }

    /// Publishes the rows that have changed: of hundreds of processes that become ready one after another, all rows
    /// would overflow the buffers.
    pub(super) fn publish_table(&mut self) -> Answer {
        for mut row in self.rows(0, 1) {
            if self.published_rows.get(&row.name) != Some(&row) {
                self.send_row(&mut row)?;
            }
        }
        Ok(())
    }

    /// The rows of one of so many parts of the table.
    fn rows(&self, part: usize, parts: usize) -> Vec<ProcessState> {
        let running = self.process_set.iter().skip(part).step_by(parts);
        let running = running.map(|child| row(child, self.process_set.standby_of(&child.member).is_some()));
        let asleep = self.context.file.process.iter().skip(part).step_by(parts).filter(|section| {
            !section.start && !self.process_set.iter().any(|child| child.member.has_name(&section.name))
        });
        running.chain(asleep.map(not_started)).collect()
    }

    /// The last row of a process that leaves the table.
    pub(super) fn publish_farewell(&mut self, name: &str) -> Answer {
        let mut row = ProcessState { state: ProcessState::STATE_GONE, ..ProcessState::default() };
        put_text(&mut row.name, name);
        self.send_row(&mut row)?;
        self.published_rows.remove(&row.name);
        Ok(())
    }

    /// Publishes a row whose header is not filled yet.
    pub(super) fn send_row(&mut self, row: &mut ProcessState) -> Answer {
        self.published_rows.insert(row.name, *row);
        row.header.stamp_ns = clock::now_ns();
        row.header.oldest_input_ns = row.header.stamp_ns;
        self.table.send(row)?;
        Ok(())
    }
}

/// The row of a process; `replaced`: a standby has taken over its work.
pub(super) fn row(child: &ManagedProcess, replaced: bool) -> ProcessState {
    let member = &child.member;
    let mut row = ProcessState {
        started_ns: child.started_ns,
        pid: child.pid,
        restarts: child.restarts.total,
        exit_code: child.exit.and_then(|exit| exit.code()).unwrap_or(-1),
        signal: child.exit.and_then(|exit| exit.signal()).unwrap_or(0),
        state: child.state(),
        slot: slot_number(member.slot),
        ..ProcessState::default()
    };
    put_text(&mut row.name, &member.name);
    put_text(&mut row.role, member.role.name());
    put_text(&mut row.law, member.law.as_deref().or(member.alias.as_deref()).unwrap_or_default());
    put_sentence(&mut row.reason, &reason(child, replaced));
    row
}

fn not_started(section: &ProcessSection) -> ProcessState {
    let mut row = ProcessState { exit_code: -1, state: ProcessState::STATE_STOPPED, ..ProcessState::default() };
    put_text(&mut row.name, &section.name);
    put_text(&mut row.role, section.role.name());
    let with = if section.role.has_slots() {
        format!("`nims swap {} {}`", section.role.name(), section.name)
    } else {
        format!("`nims start {}`", section.name)
    };
    put_sentence(&mut row.reason, &format!("not started; {with} starts it"));
    row
}

/// 0: no slot, 1: a, 2: b.
fn slot_number(slot: Option<Slot>) -> u8 {
    slot.map_or(0, |slot| 1 + slot.index() as u8)
}

/// Reason for the state of a process, and the remedy; the state itself already shows that it is silent.
fn reason(child: &ManagedProcess, replaced: bool) -> String {
    match (child.exit, child.asked) {
        (Some(exit), Some(_)) if exit.success() => "ended on request".to_owned(),
        (Some(exit), _) => {
            let words = child.last_diagnostic().filter(|_| !exit.success()).map(|words| format!(": {words}"));
            let again = child
                .again_ns
                .map(|at| format!("; starting again in {:.1} s", at.saturating_sub(clock::now_ns()) as f64 * 1e-9));
            let why = if child.gave_up { "; it died too often to be restarted" } else { "" };
            format!("{}{why}{}{}", child.ending(), again.unwrap_or_default(), words.unwrap_or_default())
        }
        (None, Some(_)) => "is ending on request".to_owned(),
        (None, None) if child.hangs => {
            let member = &child.member;
            let fate = if member.restart.again { LossState::Terminated } else { LossState::Hangs };
            let cure = cure(&member.name, member.role, fate, replaced);
            cure.unwrap_or_else(|| "it was stopped or it hangs".to_owned())
        }
        (None, None) if child.blocked => "it waits for its disk".to_owned(),
        (None, None) if child.silent => "it gets no processor time".to_owned(),
        (None, None) if child.overdue => "does not become ready; see its log in the run folder".to_owned(),
        (None, None) if child.member.role == Role::Other && child.ready_ns.is_none() => {
            "sends no heartbeat, so only its end will be noticed".to_owned()
        }
        (None, None) => String::new(),
    }
}
