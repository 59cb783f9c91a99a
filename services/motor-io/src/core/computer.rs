//! Collects the evidence of a starved computer in every cycle, and answers whether something coincides with it.

use super::starved::Evidence;
use super::{Core, LONGEST_GAP_S};
use messages::faults::Faults;
use messages::{MotorAuthority, MotorInput, SEATS, SLOTS};

/// A cycle that begins later than this share of a period after it could have is late: patience for an answer never lasts so long. It could
/// have begun at its tick, or at the end of the exchange before, if that lasted longer.
const LATE_SHARE: f64 = 0.5;

/// Share of a period that estimator and controller need for an answer; a thread that waited longer than this for a processor had no time.
const CHAIN_SHARE: f64 = 0.3;

/// Share of a period that an exchange with the drives may take: more leaves estimator and controller too little.
const EXCHANGE_SHARE: f64 = 1.0 - CHAIN_SHARE;

/// Evidence older than this does not explain that a command is still missing: who waits for a processor shows it in every cycle, and a
/// process that has died beside a hiccup does not.
const RECENT_CYCLES: u32 = 3;

/// Of the last 64 periods so many have to show evidence for a fault to coincide with it: one late tick explains no fault.
const COINCIDES: u32 = 6;

/// How long the robot says that it was the computer, after it goes on, s.
const SAID_S: f64 = 1.0;

/// Faults that a starved computer can bring about by itself: what was not read in time, or not answered in time, looks like each of them.
const EXPLAINED: u32 = MotorAuthority::FAULT_LOST_UNIT
    | MotorAuthority::FAULT_SLACK
    | MotorAuthority::FAULT_STALL
    | MotorAuthority::FAULT_RUNAWAY
    | MotorAuthority::FAULT_ENCODER_JUMP
    | MotorAuthority::FAULT_LENGTH_LIMIT;

impl Core {
    /// Takes in the evidence of a cycle. Has to run before `begin_ns` takes this cycle's time, which it compares with the last one's.
    pub(super) fn note_evidence(&mut self, input: &MotorInput) {
        let period_s = self.config.period_s;
        let since_s = |then_ns: u64| input.begin_ns.saturating_sub(then_ns) as f64 * 1e-9;
        let grown = |now_ns: u64, then_ns: u64| now_ns.saturating_sub(then_ns) as f64 * 1e-9 > CHAIN_SHARE * period_s;
        let waited = |now_ns: u64, then_ns: u64| then_ns != 0 && grown(now_ns, then_ns);
        let starved = &mut self.starved;
        let could_ns = input.tick_ns.max(self.timing.end_ns);
        let late_tick = since_s(could_ns) > LATE_SHARE * period_s;
        let own_wait = waited(input.run_delay_ns, starved.run_delay_ns);
        starved.left_out_s = input.box_left_out_ns.saturating_sub(starved.box_left_out_ns) as f64 * 1e-9;
        let left_out = starved.left_out_s > CHAIN_SHARE * period_s;
        // A long exchange alone is no evidence: drives take their time, and this program waits for answers.
        let held_up = starved.now.late_tick || own_wait || left_out;
        starved.now = Evidence {
            late_tick,
            overrun: held_up && !grown(input.begin_ns, self.timing.end_ns),
            slow_drives: self.timing.end_ns.saturating_sub(self.timing.begin_ns) as f64 * 1e-9
                > EXCHANGE_SHARE * period_s,
            waited: own_wait,
            left_out,
            chain: std::array::from_fn(|seat| waited(input.chain_delay_ns[seat], starved.chain_delay_ns[seat])),
        };
        (starved.run_delay_ns, starved.chain_delay_ns) = (input.run_delay_ns, input.chain_delay_ns);
        starved.box_left_out_ns = input.box_left_out_ns;

        // A whole period passed between the end of the exchange and the tick: this program slept through another one.
        let slept =
            self.timing.end_ns != 0 && input.tick_ns.saturating_sub(self.timing.end_ns) as f64 * 1e-9 > period_s;
        let own = starved.now.of_drives() || slept;
        let in_charge = self.arbiter.in_charge();
        let age = |age: u32, evidence: bool| if evidence { 0 } else { age.saturating_add(1) };
        starved.own_age = age(starved.own_age, own);
        let evidence = own || starved.now.of_chain(in_charge);
        starved.age = age(starved.age, evidence);
        let passed = (since_s(self.timing.begin_ns) / period_s + 0.5).clamp(1.0, 64.0) as u32;
        let these = if evidence { u64::MAX } else { 0 };
        starved.recent = starved.recent.checked_shl(passed).unwrap_or(0) | these.checked_shr(64 - passed).unwrap_or(0);
    }

    /// Time that the virtual box left out between this cycle and the one before, s: nothing moved in it.
    pub(super) fn left_out_s(&self) -> f64 {
        self.starved.left_out_s
    }

    /// What this cycle shows.
    pub(super) fn evidence(&self) -> Evidence {
        self.starved.now
    }

    /// True where the replies of this cycle say nothing about the drives, because this program did not get to hear them in time.
    pub(super) fn starves(&self) -> bool {
        self.starved.own_age <= 1
    }

    /// True where the estimates of this cycle may come from readings that were late.
    pub(super) fn chain_starves(&self) -> bool {
        self.starved.within(0)
    }

    /// Controllers and estimators that may have had no processor, or no time, to answer to the cycle before, each beside the one in charge of the
    /// other role.
    pub(super) fn starved_seats(&self) -> [bool; SEATS] {
        let (controller, estimator) = self.arbiter.in_charge();
        std::array::from_fn(|seat| {
            let pair = if seat < SLOTS { (seat, estimator) } else { (controller, seat - SLOTS) };
            self.starved.now.slow_drives || self.starved.now.of_chain(pair)
        })
    }

    /// A command is missing for too long, for so many cycles: true if that is the computer's doing, and the robot slows down and waits for the next one.
    pub(super) fn waits_for_the_computer(&mut self, missing: u32) -> bool {
        let recent = missing.min(RECENT_CYCLES);
        let waits = missing <= self.config.cycles(LONGEST_GAP_S) && self.starved.within(recent);
        if waits {
            self.safety.note_stop(MotorAuthority::FAULT_COMPUTER);
            self.starved.said = self.config.cycles(SAID_S);
        }
        waits
    }

    /// Commands are missing for good: whether the computer is the cause, instead of `cause`.
    pub(super) fn or_the_computer(&mut self, cause: u32) -> u32 {
        if self.starved.within(RECENT_CYCLES) {
            return MotorAuthority::FAULT_COMPUTER;
        }
        self.safety.clear_stops(MotorAuthority::FAULT_COMPUTER);
        cause
    }

    /// A command is there again.
    pub(super) fn note_command(&mut self) {
        if self.starved.said > 0 {
            self.starved.said -= 1;
            if self.starved.said == 0 {
                self.safety.clear_stops(MotorAuthority::FAULT_COMPUTER);
            }
        }
    }

    /// Names the computer beside a fault that it can have brought about.
    pub(super) fn name_the_computer(&self, found: &mut Faults) {
        if found.bits & EXPLAINED != 0 && self.starved.recent.count_ones() >= COINCIDES {
            found.robot(MotorAuthority::FAULT_COMPUTER);
        }
    }
}
