//! Collection of the evidence of a busy computer in every cycle, and the decisions that depend on it.

use super::starved::Evidence;
use super::{Core, LONGEST_GAP_S};
use messages::faults::Faults;
use messages::{MotorAuthority, MotorInput, ROLE_SLOTS, SLOTS};

/// Share of a period after which a cycle begins late. It can begin at its scheduled time, or at the end of a longer
/// previous exchange. The wait for an answer is always shorter.
const LATE_SHARE: f64 = 0.5;

/// Share of a period that estimator and controller need for an answer. A thread that waited longer for a processor had
/// no time.
const CHAIN_SHARE: f64 = 0.3;

/// Share of a period that an exchange with the drives may take; more leaves estimator and controller too little.
const EXCHANGE_SHARE: f64 = 1.0 - CHAIN_SHARE;

/// Age beyond which evidence does not explain a missing command, cycles, at more than 250 Hz as long. A process that
/// waits for a processor shows it in every cycle; one that died during a hiccup does not.
const RECENT_CYCLES: u32 = 3;

/// Periods with evidence, of the last `WITHIN`, from which a fault coincides with it; at more than 250 Hz both are as
/// long. One late begin explains no fault.
const COINCIDES: u32 = 6;
const WITHIN: u32 = 64;

/// Time for which the cause is shown after the robot continues, s.
const SAID_S: f64 = 1.0;

/// Faults that a busy computer alone can cause: a late reading or answer looks like each of them.
const EXPLAINED: u32 = MotorAuthority::FAULT_LOST_UNIT
    | MotorAuthority::FAULT_SLACK
    | MotorAuthority::FAULT_STALL
    | MotorAuthority::FAULT_RUNAWAY
    | MotorAuthority::FAULT_ENCODER_JUMP
    | MotorAuthority::FAULT_LENGTH_LIMIT;

impl Core {
    /// Records the evidence of a cycle. Runs before the new `begin_ns` replaces the previous one, which it needs.
    pub(super) fn record_evidence(&mut self, input: &MotorInput) {
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
        // A long exchange alone is no evidence: drives take their time, and motor-io waits for answers.
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

        // A whole period passed between the end of the exchange and the scheduled begin: motor-io slept through one.
        let slept =
            self.timing.end_ns != 0 && input.tick_ns.saturating_sub(self.timing.end_ns) as f64 * 1e-9 > period_s;
        let own = starved.now.of_drives() || slept;
        let in_charge = self.arbiter.in_charge();
        let age = |age: u32, evidence: bool| if evidence { 0 } else { age.saturating_add(1) };
        starved.own_age = age(starved.own_age, own);
        let evidence = own || starved.now.of_chain(in_charge);
        starved.age = age(starved.age, evidence);
        let passed = (since_s(self.timing.begin_ns) / period_s + 0.5).clamp(1.0, f64::from(u128::BITS)) as u32;
        let these = if evidence { u128::MAX } else { 0 };
        starved.recent =
            starved.recent.checked_shl(passed).unwrap_or(0) | these.checked_shr(u128::BITS - passed).unwrap_or(0);
    }

    /// Time that the virtual motor box left out since the previous cycle, s: nothing moved in it.
    pub(super) fn left_out_s(&self) -> f64 {
        self.starved.left_out_s
    }

    /// Evidence of this cycle.
    pub(super) fn evidence(&self) -> Evidence {
        self.starved.now
    }

    /// True if the replies of this cycle show nothing about the drives, because motor-io could not read them in time.
    pub(super) fn starves(&self) -> bool {
        self.starved.own_age <= 1
    }

    /// True if the estimates of this cycle may come from late readings.
    pub(super) fn chain_starves(&self) -> bool {
        self.starved.within(0)
    }

    /// Controllers and estimators that may have had no processor or no time to answer to the previous cycle, each
    /// beside the one in charge of the other role.
    pub(super) fn starved_slots(&self) -> [bool; ROLE_SLOTS] {
        let (controller, estimator) = self.arbiter.in_charge();
        std::array::from_fn(|seat| {
            let pair = if seat < SLOTS { (seat, estimator) } else { (controller, seat - SLOTS) };
            self.starved.now.slow_drives || self.starved.now.of_chain(pair)
        })
    }

    /// Returns true if the computer explains why commands have been missing for so many cycles. The robot then slows
    /// down and waits for the next command.
    pub(super) fn waits_for_the_computer(&mut self, missing: u32) -> bool {
        let recent = missing.min(self.config.lasting(RECENT_CYCLES));
        let waits = missing <= self.config.cycles(LONGEST_GAP_S) && self.starved.within(recent);
        if waits {
            self.safety.record_stop(MotorAuthority::FAULT_COMPUTER);
            self.starved.named_cycles = self.config.cycles(SAID_S);
        }
        waits
    }

    /// Returns the cause of a stop without commands: the computer, with evidence, or else `cause`.
    pub(super) fn or_the_computer(&mut self, cause: u32) -> u32 {
        if self.starved.within(self.config.lasting(RECENT_CYCLES)) {
            return MotorAuthority::FAULT_COMPUTER;
        }
        self.safety.clear_stops(MotorAuthority::FAULT_COMPUTER);
        cause
    }

    /// Counts down the time for which the cause is shown, once commands arrive again.
    pub(super) fn record_command(&mut self) {
        if self.starved.named_cycles > 0 {
            self.starved.named_cycles -= 1;
            if self.starved.named_cycles == 0 {
                self.safety.clear_stops(MotorAuthority::FAULT_COMPUTER);
            }
        }
    }

    /// Adds the computer to a fault that it can have caused.
    pub(super) fn name_the_computer(&self, found: &mut Faults) {
        let [coincides, within] = [COINCIDES, WITHIN].map(|cycles| self.config.lasting(cycles));
        // The newest are in the lowest bits, and the oldest of all would be pushed out.
        let recent = self.starved.recent << u128::BITS.saturating_sub(within);
        if found.bits & EXPLAINED != 0 && recent.count_ones() >= coincides {
            found.robot(MotorAuthority::FAULT_COMPUTER);
        }
    }
}
