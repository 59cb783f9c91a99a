//! Parameters that each process reported, with the first answer that used them.

use messages::{SystemConfig, text_of};
use std::collections::HashMap;

/// Parameters as TOML by incarnation, each with the number of the first answer that was computed with them.
#[derive(Debug, Default)]
pub(super) struct ReportedParameters(HashMap<u32, Vec<(u64, String)>>);

impl ReportedParameters {
    pub(super) fn record(&mut self, report: &SystemConfig) {
        // from_seq is 0 for processes that answer no cycles; they are not recomputed.
        if report.from_seq > 0 {
            let parameters = (report.from_seq, text_of(&report.parameters));
            let of_process = self.0.entry(report.incarnation).or_default();
            // Each new run file repeats the last report.
            if !of_process.contains(&parameters) {
                of_process.push(parameters);
            }
        }
    }

    /// Returns the initial parameters of a process; `None` in runs without this channel.
    pub(super) fn at_start(&self, incarnation: u32) -> Option<&str> {
        self.at(incarnation, 1)
    }

    /// Returns new parameters that take effect with this answer, if any.
    pub(super) fn from(&self, incarnation: u32, seq: u64) -> Option<&str> {
        if seq > 1 { self.at(incarnation, seq) } else { None }
    }

    fn at(&self, incarnation: u32, seq: u64) -> Option<&str> {
        let of_process = self.0.get(&incarnation)?;
        of_process.iter().rev().find(|(from, _)| *from == seq).map(|(_, parameters)| parameters.as_str())
    }
}
