//! Which controller and which estimator were in charge, when, with which law, program and parameters.

use crate::tracker::Cycle;
use messages::{ControlStatus, MotorAuthority, NodeEstimate, SLOT_NAMES, SLOTS, SystemConfig, text_of};
use serde::Serialize;
use serde_json::{Map, Value};

/// Maximum number of stored spans; of a run with more, the first ones are kept.
const MAX_SPANS: usize = 500;

/// Configuration that a process reported, from one of its samples on.
#[derive(Debug, Clone)]
struct Reported {
    incarnation: u32,
    from_seq: u64,
    name: String,
    law: String,
    program: String,
    version: String,
    sha256: String,
    parameters: Map<String, Value>,
}

/// A time with the same process, law and parameters in charge.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Span {
    /// `controller` or `estimator`.
    pub role: &'static str,
    /// Its slot, `a` or `b`.
    pub slot: &'static str,
    /// Name of the process; `None` in runs without `system/config`.
    pub name: Option<String>,
    /// Law or method.
    pub law: Option<String>,
    /// Path of the program.
    pub program: Option<String>,
    /// Its version and build.
    pub version: Option<String>,
    /// SHA-256 of the program.
    pub sha256: Option<String>,
    /// Start, s since the start of the run.
    pub from_s: f64,
    /// End, s since the start of the run.
    pub to_s: f64,
    /// First control cycle.
    pub from_cycle: u64,
    /// Parameters in use.
    pub parameters: Map<String, Value>,
    /// Parameters that differ from those of the same role before.
    pub changed: Vec<String>,
    #[serde(skip)]
    key: Key,
}

/// What distinguishes one span from the next: slot, incarnation, law, and the report in use.
type Key = (usize, u32, u8, Option<usize>);

/// Spans of a run.
#[derive(Debug, Clone, Default)]
pub struct InCharge {
    reported: Vec<Reported>,
    spans: Vec<Span>,
    /// Number of spans beyond the limit.
    pub left_out: usize,
    /// Index of the last span of each role.
    last: [Option<usize>; 2],
    /// Of each role what is in charge beyond the limit.
    unlisted: [Option<Key>; 2],
}

/// The roles by their index in `motor/authority`.
const ROLES: [&str; 2] = ["controller", "estimator"];

impl InCharge {
    /// Returns the spans in the order of their start.
    #[must_use]
    pub fn spans(&self) -> &[Span] {
        &self.spans
    }

    /// Records what a process reports of its configuration.
    pub fn config(&mut self, config: &SystemConfig) {
        let known = |one: &Reported| one.incarnation == config.incarnation && one.from_seq == config.from_seq;
        // Processes that answer no cycle are never in charge, and a new file repeats the last report.
        if config.from_seq == 0 || self.reported.iter().any(known) {
            return;
        }
        let table = text_of(&config.parameters).parse::<toml::Table>().unwrap_or_default();
        let parameters = match serde_json::to_value(table) {
            Ok(Value::Object(parameters)) => parameters,
            _ => Map::new(),
        };
        self.reported.push(Reported {
            incarnation: config.incarnation,
            from_seq: config.from_seq,
            name: text_of(&config.name),
            law: text_of(&config.law),
            program: text_of(&config.program),
            version: text_of(&config.version),
            sha256: text_of(&config.program_sha256),
            parameters,
        });
    }

    /// Extends the spans to this cycle, or starts new ones.
    pub fn cycle(&mut self, time_s: f64, cycle: &Cycle<'_>) {
        let MotorAuthority { header, active_controller, active_estimator, .. } = *cycle.authority;
        if let Some(ControlStatus { header: own, incarnation, chosen_law, .. }) = cycle.control {
            self.extend(0, active_controller, (*incarnation, own.seq, *chosen_law), time_s, header.cycle);
        }
        if let Some(NodeEstimate { header: own, incarnation, method, .. }) = cycle.estimate {
            self.extend(1, active_estimator, (*incarnation, own.seq, *method), time_s, header.cycle);
        }
    }

    fn extend(&mut self, role: usize, slot: u8, own: (u32, u64, u8), time_s: f64, cycle: u64) {
        let (incarnation, seq, law) = own;
        let slot = usize::from(slot).min(SLOTS - 1);
        let of_process = self.reported.iter().enumerate().rev();
        let report = of_process.filter(|(_, one)| one.incarnation == incarnation && one.from_seq <= seq);
        let key = (slot, incarnation, law, report.max_by_key(|(_, one)| one.from_seq).map(|(at, _)| at));
        if let Some(last) = self.last[role].and_then(|at| self.spans.get_mut(at)) {
            last.to_s = time_s;
            if last.key == key {
                return;
            }
        }
        if self.spans.len() == MAX_SPANS {
            // The last one of the role does not go on.
            self.last[role] = None;
            self.left_out += usize::from(self.unlisted[role].replace(key) != Some(key));
            return;
        }
        let span = self.span(role, key, time_s, cycle);
        self.last[role] = Some(self.spans.len());
        self.spans.push(span);
    }

    fn span(&self, role: usize, key: Key, time_s: f64, cycle: u64) -> Span {
        let (slot, _, law, report) = key;
        let report = report.and_then(|at| self.reported.get(at));
        let text = |pick: fn(&Reported) -> &String| report.map(pick).filter(|text| !text.is_empty()).cloned();
        let parameters = report.map(|report| report.parameters.clone()).unwrap_or_default();
        let before = self.last[role].and_then(|at| self.spans.get(at)).map(|last| &last.parameters);
        let changed = before.map_or_else(Vec::new, |before| {
            let keys = parameters.keys().chain(before.keys().filter(|key| !parameters.contains_key(*key)));
            keys.filter(|key| parameters.get(*key) != before.get(*key)).cloned().collect()
        });
        Span {
            role: ROLES[role],
            slot: SLOT_NAMES[slot],
            name: text(|report| &report.name),
            law: text(|report| &report.law).or_else(|| numbered(role, law)),
            program: text(|report| &report.program),
            version: text(|report| &report.version),
            sha256: text(|report| &report.sha256),
            from_s: time_s,
            to_s: time_s,
            from_cycle: cycle,
            parameters,
            changed,
            key,
        }
    }
}

/// Returns the name of a law or a method of this project by its number.
fn numbered(role: usize, number: u8) -> Option<String> {
    let name = match (role, number) {
        (0, ControlStatus::LAW_LQ_ENDPOINT) => "lq-endpoint",
        (0, ControlStatus::LAW_PREVIEW) => "preview",
        (0, ControlStatus::LAW_P_FEEDFORWARD) => "p-feedforward",
        (0, ControlStatus::LAW_OTHER) => "a custom law",
        (1, NodeEstimate::METHOD_PHI) => "phi",
        (1, NodeEstimate::METHOD_KALMAN) => "kalman",
        _ => return None,
    };
    Some(name.to_owned())
}

impl Span {
    /// Returns the parameters in one line: all of them, or those that differ from before.
    #[must_use]
    pub fn parameters_text(&self) -> String {
        let shown = self.parameters.iter().filter(|(key, _)| self.changed.is_empty() || self.changed.contains(key));
        shown.map(|(key, value)| format!("{key} = {value}")).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn changes_beyond_the_limit_are_counted() {
        let mut charge = InCharge::default();
        for change in 0..MAX_SPANS as u32 + 7 {
            for cycle in 0..3 {
                let time_s = f64::from(3 * change + cycle);
                charge.extend(0, (change % 2) as u8, (1 + change % 2, 1, 1), time_s, u64::from(3 * change + cycle));
            }
        }
        assert_eq!((charge.spans().len(), charge.left_out), (MAX_SPANS, 7));
        let last = charge.spans().last().unwrap();
        assert!((last.to_s - last.from_s - 3.0).abs() < 1e-9, "it ended with the next change: {last:?}");
    }
}
