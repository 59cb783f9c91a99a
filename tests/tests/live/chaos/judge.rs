//! Judges a chaos series by its run files: detection, tensions, and forbidden motion.
//!
//! Two effects do not count as failures, and the table shows how long they last. When an encoder gives wrong counts,
//! its drive runs away for the quarter of a second until detection, the node is thrown about, and the other cables are
//! slack for moments while it swings. When one of three cables breaks, the other two cannot carry the node, and hang
//! loose once it has come down.

use messages::faults::MAY_RELEASE;
use messages::{MotorAuthority, TruthNode};
use robot_state::sentences::fault_sentences;
use runlog::RunReader;
use std::fmt::Write;
use std::path::Path;

/// Longest time from the beginning of a hold until the drums stand, ns: the longest stop and the drives' lag.
const SETTLED_NS: u64 = 1_000_000_000;
/// Time after which a node that a drive has thrown about hangs on taut cables again, ns.
const SWUNG_NS: u64 = 3_000_000_000;
/// Height below which a node has come down, m.
const DOWN_M: f64 = 0.01;
/// Time between two samples of truth, s.
const TRUTH_S: f64 = 0.01;
/// Motion below this does not count: ten steps of the encoder, m.
const STILL_M: f64 = 0.001;

/// One fault that was injected.
#[derive(Debug)]
pub struct Blow {
    pub what: String,
    pub standby: bool,
    /// For a controller or an estimator with a standby: role and slot in charge before.
    pub lead: Option<(usize, u8)>,
    pub bits: u32,
    /// Largest number of cycles until detection, if that does not depend on the motion.
    pub within: Option<u64>,
    pub cable: Option<usize>,
    /// Its encoder gives wrong counts, so that its drive runs away until detection.
    pub runs_away: bool,
    /// It is broken, and nothing carries the node in its place.
    pub breaks: bool,
    pub at_ns: u64,
    /// Newest cycle before it.
    pub cycle: u64,
    /// Time when the robot flew on, ns.
    pub back_ns: u64,
    /// Largest distance of the node from the robot's estimate after the fault, m.
    pub off_m: Option<f64>,
}

/// The samples of a run that the judgement needs.
pub struct Evidence {
    cycles: Vec<MotorAuthority>,
    truth: Vec<TruthNode>,
}

/// Verdict on a fault by the run file.
#[derive(Debug, Default, Clone)]
pub struct Verdict {
    pub cycles: Option<u64>,
    pub named: u32,
    /// Largest tension of the cables that were not broken on purpose, and of all cables, N.
    pub peak_n: f64,
    pub peak_all_n: f64,
    /// Time that any of the other cables was slack, s.
    pub slack_s: f64,
}

impl Evidence {
    /// Reads a run to its end; errors of its files are added to `complaints`.
    pub fn read(run: &Path, complaints: &mut Vec<String>) -> Self {
        let mut evidence = Self { cycles: Vec::new(), truth: Vec::new() };
        let mut reader = RunReader::open(run).unwrap();
        while let Some(recorded) = reader.next_sample().unwrap() {
            match recorded.channel.name.as_str() {
                "motor/authority" => evidence.cycles.extend(recorded.decode::<MotorAuthority>()),
                "truth/node" => evidence.truth.extend(recorded.decode::<TruthNode>()),
                _ => {}
            }
        }
        for (path, finished, _) in reader.files() {
            if !finished {
                complaints.push(format!("{} was never closed", path.display()));
            }
        }
        for (path, damage) in reader.damage() {
            complaints.push(format!("{} is damaged: {damage:?}", path.display()));
        }
        evidence
    }

    /// Judges one fault by the time from it to `end_ns`.
    pub fn judge(&self, blow: &Blow, end_ns: u64, limit_n: f64, complaints: &mut Vec<String>) -> Verdict {
        let mut verdict = Verdict::default();
        let during = |stamp_ns: u64| stamp_ns > blow.at_ns && stamp_ns <= end_ns;
        let cycles = || self.cycles.iter().filter(|cycle| during(cycle.header.stamp_ns));
        let found = match blow.lead {
            Some((role, slot)) => cycles().find(|cycle| cycle.in_charge[role] != slot),
            None => cycles().find(|cycle| cycle.faults & blow.bits != 0),
        };
        if let Some(found) = found {
            verdict.cycles = Some(found.header.cycle.saturating_sub(blow.cycle));
            verdict.named = found.faults;
        }
        let complain = |text: String| format!("{}{}: {text}", blow.what, if blow.standby { ", standby" } else { "" });
        if blow.lead.is_some() || blow.bits != 0 {
            match (verdict.cycles, blow.within) {
                (None, _) => complaints.push(complain("was not detected".to_owned())),
                (Some(cycles), Some(within)) if cycles > within => {
                    complaints.push(complain(format!("was detected after {cycles} cycles, not within {within}")));
                }
                _ => {}
            }
        }
        if blow.lead.is_some() {
            // The standby took over without a stop. A stop by itself is due to this machine.
            let watched: Vec<_> = cycles().take(100).collect();
            let late = watched.windows(2).any(|two| two[1].lost_computer > two[0].lost_computer);
            let stopped = watched.iter().any(|cycle| cycle.mode != MotorAuthority::MODE_FOLLOWING);
            if stopped && !late {
                complaints.push(complain("stopped the robot although there was a standby".to_owned()));
            }
        }
        let (mut slack, mut loose) = ([0u32; 8], [0u32; 8]);
        let swings_ns =
            if blow.runs_away { found.map_or(u64::MAX, |found| found.header.stamp_ns + SWUNG_NS) } else { 0 };
        let mut down = false;
        for sample in self.truth.iter().filter(|sample| during(sample.header.stamp_ns)) {
            down |= blow.breaks && sample.position_m[2] < DOWN_M;
            for (i, tension) in sample.tension_n[..usize::from(sample.cable_count)].iter().enumerate() {
                verdict.peak_all_n = verdict.peak_all_n.max(*tension);
                if blow.cable != Some(i) {
                    verdict.peak_n = verdict.peak_n.max(*tension);
                    let is_slack = sample.slack[i] == 1;
                    slack[i] += u32::from(is_slack && sample.header.stamp_ns > swings_ns && !down);
                    loose[i] += u32::from(is_slack);
                }
            }
        }
        verdict.slack_s = TRUTH_S * f64::from(loose.into_iter().max().unwrap_or(0));
        if verdict.peak_all_n > limit_n {
            complaints.push(complain(format!("{:.1} N on a cable", verdict.peak_all_n)));
        }
        for (i, samples) in slack.iter().enumerate().filter(|(_, samples)| **samples > 0) {
            complaints.push(complain(format!("cable {} slack in {samples} samples", i + 1)));
        }
        if let Some(off_m) = blow.off_m {
            complaints.push(complain(format!(
                "afterwards the node is {:.0} mm from the position that the robot reports as known",
                1e3 * off_m
            )));
        }
        verdict
    }

    /// While the robot holds, no drum turns, except that of a released cable.
    pub fn nothing_moves_while_held(&self, complaints: &mut Vec<String>) {
        let held =
            |cycle: &MotorAuthority| matches!(cycle.mode, MotorAuthority::MODE_HOLDING | MotorAuthority::MODE_FAULTED);
        for hold in self.cycles.chunk_by(|before, now| {
            held(before) == held(now) && now.header.stamp_ns.saturating_sub(before.header.stamp_ns) < SETTLED_NS / 2
        }) {
            let (first, last) = (&hold[0], &hold[hold.len() - 1]);
            if !held(first) || last.header.stamp_ns < first.header.stamp_ns + SETTLED_NS {
                continue;
            }
            let span = first.header.stamp_ns + SETTLED_NS..=last.header.stamp_ns;
            for i in 0..usize::from(first.cable_count) {
                if hold.iter().any(|cycle| cycle.faults & MAY_RELEASE != 0 && cycle.fault_cable[i] == 1) {
                    continue;
                }
                let lengths = self.truth.iter().filter(|sample| span.contains(&sample.header.stamp_ns));
                let (low, high) = lengths.fold((f64::MAX, f64::MIN), |(low, high), sample| {
                    (low.min(sample.length_m[i]), high.max(sample.length_m[i]))
                });
                if high - low > STILL_M {
                    let named: Vec<String> = fault_sentences(last.faults).collect();
                    complaints.push(format!(
                        "cycles {} to {}: cable {} moves by {:.1} mm while the robot holds ({})",
                        first.header.cycle,
                        last.header.cycle,
                        i + 1,
                        1e3 * (high - low),
                        named.join(" ")
                    ));
                }
            }
        }
    }
}

/// Every fault with its verdict, and the worst of each kind, in Markdown.
pub fn table(judged: &[(Blow, Verdict)]) -> String {
    let mut text = String::from(
        "| fault | standby | found after, cycles | named | peak on the surviving lines, N | on any line, N | others slack, s | back after, s |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let mut kinds: Vec<(String, Vec<&Verdict>)> = Vec::new();
    for (blow, verdict) in judged {
        let cycles = verdict.cycles.map_or("-".to_owned(), |cycles| cycles.to_string());
        let named: Vec<String> = fault_sentences(verdict.named)
            .map(|sentence| sentence.split(':').next().unwrap_or_default().to_owned())
            .collect();
        let back_s = blow.back_ns.saturating_sub(blow.at_ns) as f64 * 1e-9;
        let _ = writeln!(
            text,
            "| {} | {} | {cycles} | {} | {:.1} | {:.1} | {:.2} | {} |",
            blow.what,
            if blow.standby { "yes" } else { "" },
            named.join("; "),
            verdict.peak_n,
            verdict.peak_all_n,
            verdict.slack_s,
            if blow.back_ns == 0 { "-".to_owned() } else { format!("{back_s:.1}") },
        );
        let mut words = blow.what.split(' ');
        let kind = [words.next(), words.next().filter(|word| word.parse::<f64>().is_err())];
        let kind = format!(
            "{}{}",
            kind.into_iter().flatten().collect::<Vec<_>>().join(" "),
            if blow.lead.is_some() { ", standby" } else { "" }
        );
        match kinds.iter_mut().find(|(name, _)| *name == kind) {
            Some((_, verdicts)) => verdicts.push(verdict),
            None => kinds.push((kind, vec![verdict])),
        }
    }
    kinds.sort_by(|one, other| one.0.cmp(&other.0));
    text += "\n| kind | times | found after, cycles | peak on the surviving lines, N | others slack, s |\n|---|---|---|---|---|\n";
    for (kind, verdicts) in kinds {
        let cycles: Vec<u64> = verdicts.iter().filter_map(|verdict| verdict.cycles).collect();
        let range = match (cycles.iter().min(), cycles.iter().max()) {
            (Some(low), Some(high)) => format!("{low} to {high}"),
            _ => "-".to_owned(),
        };
        let peak = verdicts.iter().fold(0.0, |most: f64, verdict| most.max(verdict.peak_n));
        let slack_s = verdicts.iter().fold(0.0, |most: f64, verdict| most.max(verdict.slack_s));
        let _ = writeln!(text, "| {kind} | {} | {range} | {peak:.1} | {slack_s:.2} |", verdicts.len());
    }
    text
}
