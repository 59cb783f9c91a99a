//! Results of the benchmark.

use super::args::Part;
use super::{chain, disk, judge, round_trip, tick};
use commissioning::finding::Finding;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Results of the measured parts.
pub(crate) struct BenchReport {
    pub(crate) rate_hz: f64,
    pub(crate) runs: PathBuf,
    pub(crate) beside: bool,
    pub(crate) tick: Option<tick::TickResult>,
    pub(crate) bus: Option<round_trip::BusResult>,
    pub(crate) chain: Option<chain::ChainResult>,
    pub(crate) disk: Option<disk::DiskResult>,
}

impl BenchReport {
    pub(crate) fn verdicts(&self) -> Vec<(Part, Finding)> {
        let rate_hz = self.rate_hz;
        [
            self.tick.as_ref().map(|found| (Part::Tick, judge::tick_finding(found, rate_hz))),
            self.bus.as_ref().map(|found| (Part::Bus, judge::bus_finding(found, rate_hz))),
            self.chain.as_ref().map(|found| (Part::Chain, judge::chain_finding(found, rate_hz))),
            self.disk.as_ref().map(|found| (Part::Disk, judge::disk_finding(found, rate_hz))),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    pub(crate) fn to_json(&self) -> Value {
        let mut value = json!({ "rate_hz": self.rate_hz, "period_s": 1.0 / self.rate_hz, "beside_robot": self.beside });
        let parts = [json!(self.tick), json!(self.bus), json!(self.chain), json!(self.disk)];
        for (part, mut found) in Part::ALL.into_iter().zip(parts).filter(|(_, found)| !found.is_null()) {
            let verdict = self.verdicts().into_iter().find(|(judged, _)| *judged == part);
            found["verdict"] = json!(verdict.map(|(_, finding)| finding));
            value[part.name()] = found;
        }
        value
    }
}
