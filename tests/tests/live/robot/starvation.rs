//! Whether the machine kept the robot's threads waiting.

use super::{Robot, run_of};
use messages::{MotorAuthority, MotorInput};
use std::collections::HashMap;

/// Cycles with a long wait, and lost periods, within so many consecutive cycles that show a starved robot.
const STARVED_CYCLES: u64 = 3;
const CLOSE_CYCLES: usize = 10;
/// A thread that waited longer than this for a processor had no time for its part of the cycle, ns: motor-io's share of
/// the period.
const LONG_WAIT_NS: u64 = 3_000_000;

impl Robot {
    /// The kernel's figures in the run files of a robot without injected faults, if they explain lost periods: cycles
    /// close together in which the kernel kept threads of the robot waiting for a processor, and in which as many
    /// periods were lost.
    pub(super) fn starvation(&self) -> Option<String> {
        if self.broken {
            return None;
        }
        (1..=self.runs).find_map(|run| {
            let folder = run_of(self.folder.path(), run);
            let inputs: Vec<(u64, MotorInput)> = runlog::read_channel(&folder, "motor/input").unwrap_or_default();
            let samples: Vec<(u64, MotorAuthority)> =
                runlog::read_channel(&folder, "motor/authority").unwrap_or_default();
            let waited = inputs.windows(2).map(|pair| waited_ns(&pair[0].1, &pair[1].1));
            let waits: HashMap<u64, u64> =
                inputs.iter().skip(1).map(|(_, input)| input.header.cycle).zip(waited).collect();
            samples.windows(CLOSE_CYCLES).find_map(|window| {
                let lost = |sample: &MotorAuthority| sample.lost_computer + sample.lost_on_ports();
                let lost = lost(&window[CLOSE_CYCLES - 1].1).saturating_sub(lost(&window[0].1));
                let waits = window.iter().filter_map(|(_, sample)| waits.get(&sample.header.cycle));
                let waited_ns: u64 = waits.filter(|wait| **wait > LONG_WAIT_NS).sum();
                (lost >= STARVED_CYCLES && waited_ns >= STARVED_CYCLES * LONG_WAIT_NS).then(|| {
                    let (cycle, waited_ms) = (window[0].1.header.cycle, waited_ns / 1_000_000);
                    format!(
                        "its threads waited {waited_ms} ms for a processor within {CLOSE_CYCLES} cycles from {cycle} on"
                    )
                })
            })
        })
    }
}

/// The longest time that one of the threads of the robot or of the virtual motor box waited for a processor from one
/// cycle to the next, ns.
fn waited_ns(before: &MotorInput, after: &MotorInput) -> u64 {
    let own = [(before.run_delay_ns, after.run_delay_ns), (before.box_left_out_ns, after.box_left_out_ns)];
    let chain = before.chain_delay_ns.into_iter().zip(after.chain_delay_ns);
    // A previous figure of 0 means unknown.
    let grown = own.into_iter().chain(chain).filter(|(before, _)| *before != 0);
    grown.map(|(before, after)| after.saturating_sub(before)).max().unwrap_or(0)
}
