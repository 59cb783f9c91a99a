//! What each period of a mission counts as: steered, paused, or lost to one of four causes.
//!
//! A mission's periods are those of wall-clock time, from the cycle after which its motion is taken up to the one in which it ends. Periods
//! that never ran count too. Causes are disjoint and add up, so that another program can count the same from `motor/input` and
//! `motor/authority`: `docs/counters.md` has the rules one by one, and what is here follows their order.

use super::starved::Evidence;
use messages::faults::STOPS;
use messages::{MotorAuthority, MotorInput, UNITS};

/// Stops because another program was not there.
const ABSENCE: u32 = MotorAuthority::FAULT_SUPERVISOR_LOST | MotorAuthority::FAULT_PLANNER_LOST;

/// What the account has to know of a cycle beside its input.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cycle {
    /// A motion was followed, or kept to go on with, when the cycle began.
    pub under_way: bool,
    /// A valid answer to the cycle before was used.
    pub fresh: bool,
    /// The robot is at rest or comes to rest by itself at the end of the cycle: no command is asked for.
    pub at_rest: bool,
    /// The plan clock stands.
    pub resting: bool,
    /// Why the robot was stopped; bits.
    pub faults: u32,
    /// Of a starved computer.
    pub evidence: Evidence,
    /// Slots in charge: controller and estimator.
    pub in_charge: (usize, usize),
    /// Control period, s.
    pub period_s: f64,
}

/// Counts periods. One per life of motor-io.
#[derive(Debug, Clone, Default)]
pub(super) struct Account {
    counts: [u64; 7],
    period: u8,
    /// Cause of the last lost period: it stays the cause for as long as the robot holds because of it.
    cause: u8,
    /// What kept a unit from answering in the cycle before: no command can answer to that cycle.
    trouble: Option<u8>,
    tick_ns: u64,
    begin_ns: u64,
    end_ns: u64,
}

impl Account {
    /// Closes a cycle, after the drives have answered.
    pub(super) fn close(&mut self, input: &MotorInput, cycle: &Cycle) {
        let (before, trouble_before) = (self.period, self.trouble);
        let (trouble, cause) = self.judge(input, cycle);
        self.period = match () {
            () if !cycle.under_way => MotorAuthority::PERIOD_NO_MISSION,
            () if cycle.fresh && trouble.is_none() => MotorAuthority::PERIOD_STEERED,
            () if cycle.at_rest && cycle.resting && cycle.faults & STOPS == 0 => MotorAuthority::PERIOD_PAUSED,
            () => cause,
        };
        if !cycle.under_way {
            self.cause = 0;
        } else if self.period == cause {
            self.remember(before);
        }
        self.trouble = trouble;
        self.counts[usize::from(self.period)] += 1;
        if cycle.under_way {
            // What a period is that never ran follows from the cycle before.
            let (skipped, overrun) = self.skipped(input, cycle.period_s);
            let paused = before == MotorAuthority::PERIOD_PAUSED;
            let of = |cause| usize::from(if paused { before } else { cause });
            self.counts[of(MotorAuthority::PERIOD_LOST_COMPUTER)] += skipped - overrun;
            self.counts[of(trouble_before.unwrap_or_else(|| slow(cycle)))] += overrun;
        }
        (self.tick_ns, self.begin_ns, self.end_ns) = (input.tick_ns, input.begin_ns, input.end_ns);
    }

    /// What keeps a unit from answering in this cycle, and the cause of the period if it is lost.
    fn judge(&self, input: &MotorInput, cycle: &Cycle) -> (Option<u8>, u8) {
        let unless_held_up =
            |cause| if cycle.evidence.of_drives() { MotorAuthority::PERIOD_LOST_COMPUTER } else { cause };
        let trouble = trouble(&input.unit[..usize::from(input.unit_count).min(UNITS)]).map(|what| match what {
            // What broke the step is the cause of the way back into it.
            Trouble::Resync => self.trouble.unwrap_or_else(|| unless_held_up(MotorAuthority::PERIOD_LOST_RESYNC)),
            Trouble::Silent => unless_held_up(MotorAuthority::PERIOD_LOST_DRIVE),
            Trouble::Lost => MotorAuthority::PERIOD_LOST_DRIVE,
            Trouble::Late => MotorAuthority::PERIOD_LOST_COMPUTER,
        });
        // No answer to the cycle before is the computer's fault only where the kernel says so.
        let silence = match () {
            () if cycle.evidence.of_chain(cycle.in_charge) => MotorAuthority::PERIOD_LOST_COMPUTER,
            () if cycle.evidence.slow_drives() => MotorAuthority::PERIOD_LOST_DRIVE,
            () => MotorAuthority::PERIOD_LOST_ANSWER,
        };
        let cause = match () {
            () if cycle.at_rest && !cycle.fresh && cycle.faults & STOPS != 0 => self.cause_of_stop(cycle.faults),
            () => trouble.or(self.trouble).unwrap_or(silence),
        };
        (trouble, cause)
    }

    /// The robot is stopped, or holds, because of what was lost before.
    fn cause_of_stop(&self, faults: u32) -> u8 {
        match () {
            () if faults & MotorAuthority::FAULT_LONG_GAP != 0 => MotorAuthority::PERIOD_LOST_COMPUTER,
            () if faults & ABSENCE != 0 || self.cause == 0 => MotorAuthority::PERIOD_LOST_ANSWER,
            // FAULT_COMPUTER says what coincided; an answer that was missing without it is still one.
            () => self.cause,
        }
    }

    /// Keeps the cause of a lost period. Of lost periods in a row, one for which the computer has no evidence speaks for all.
    fn remember(&mut self, before: u8) {
        let row = before >= MotorAuthority::PERIOD_LOST_COMPUTER && self.cause == MotorAuthority::PERIOD_LOST_ANSWER;
        if !(row && self.period == MotorAuthority::PERIOD_LOST_COMPUTER) {
            self.cause = self.period;
        }
    }

    /// Periods between the last tick and this one that never ran, for ticks are due at whole periods; and of how many the tick fell
    /// into the exchange before.
    fn skipped(&self, input: &MotorInput, period_s: f64) -> (u64, u64) {
        if self.tick_ns == 0 {
            return (0, 0);
        }
        let periods = |until_ns: u64| until_ns.saturating_sub(self.tick_ns) as f64 * 1e-9 / period_s;
        let skipped = ((periods(input.tick_ns) + 0.5) as u64).saturating_sub(1);
        let overrun = (periods(self.end_ns) as u64).saturating_sub(periods(self.begin_ns) as u64);
        (skipped, skipped.min(overrun))
    }

    /// Writes what it came to.
    pub(super) fn describe(&self, authority: &mut MotorAuthority) {
        let of = |period: u8| self.counts[usize::from(period)];
        authority.period = self.period;
        authority.steered = of(MotorAuthority::PERIOD_STEERED);
        authority.paused = of(MotorAuthority::PERIOD_PAUSED);
        authority.lost_computer = of(MotorAuthority::PERIOD_LOST_COMPUTER);
        authority.lost_drive = of(MotorAuthority::PERIOD_LOST_DRIVE);
        authority.lost_resync = of(MotorAuthority::PERIOD_LOST_RESYNC);
        authority.lost_answer = of(MotorAuthority::PERIOD_LOST_ANSWER);
        authority.periods = self.counts[1..].iter().sum();
    }
}

/// Why an exchange took longer than a period although every unit answered.
fn slow(cycle: &Cycle) -> u8 {
    if cycle.evidence.of_drives() { MotorAuthority::PERIOD_LOST_COMPUTER } else { MotorAuthority::PERIOD_LOST_DRIVE }
}

/// What keeps a unit from answering.
enum Trouble {
    /// It is gone, or was restarted.
    Lost,
    /// It did not answer in time.
    Silent,
    /// Its port is being brought back into step.
    Resync,
    /// This program was too late to ask.
    Late,
}

/// The worst of all units.
fn trouble(units: &[u8]) -> Option<Trouble> {
    let any = |outcomes: &[u8]| units.iter().any(|unit| outcomes.contains(unit));
    match () {
        () if any(&[MotorInput::UNIT_ABSENT, MotorInput::UNIT_LOST, MotorInput::UNIT_REBOOTED]) => Some(Trouble::Lost),
        () if any(&[MotorInput::UNIT_SILENT]) => Some(Trouble::Silent),
        () if any(&[MotorInput::UNIT_RESYNC]) => Some(Trouble::Resync),
        () if any(&[MotorInput::UNIT_LATE]) => Some(Trouble::Late),
        () => None,
    }
}
