//! What each process said it works with, from which of its answers on.

use messages::{SystemConfig, text_of};
use std::collections::HashMap;

/// Parameters as TOML by the life of a process, each with the number of the first answer that was made with them.
#[derive(Debug, Default)]
pub(super) struct Used(HashMap<u32, Vec<(u64, String)>>);

impl Used {
    pub(super) fn note(&mut self, said: &SystemConfig) {
        // Processes that answer no cycle are not computed again.
        if said.from_seq > 0 {
            let parameters = (said.from_seq, text_of(&said.parameters));
            let of_life = self.0.entry(said.incarnation).or_default();
            // A file that begins repeats what was said last.
            if !of_life.contains(&parameters) {
                of_life.push(parameters);
            }
        }
    }

    /// What a process began with; `None` where it did not say so, as before there was such a channel.
    pub(super) fn at_start(&self, incarnation: u32) -> Option<&str> {
        self.at(incarnation, 1)
    }

    /// What it works with from this answer on, if that is other than before.
    pub(super) fn from(&self, incarnation: u32, seq: u64) -> Option<&str> {
        if seq > 1 { self.at(incarnation, seq) } else { None }
    }

    fn at(&self, incarnation: u32, seq: u64) -> Option<&str> {
        let of_life = self.0.get(&incarnation)?;
        of_life.iter().rev().find(|(from, _)| *from == seq).map(|(_, parameters)| parameters.as_str())
    }
}
