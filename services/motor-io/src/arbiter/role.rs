//! State machine of one role: two slots, their phases, and the swap between them.
//!
//! ```text
//!   Empty --> Attached --> Shadow --> Qualified --> Switching --> Active
//!                ^            |           |  ^    swap is       |
//!                +---- fall --+-----------+  |    announced     | the swap takes effect
//!                |                           |                  v
//!          Quarantined                       +--- Probation <-- Active (the one before)
//! ```
//!
//! A slot that falls three times (`quarantine_falls`) without a long good period in between is quarantined until the
//! operator admits it again, because a slot that comes and goes is no standby. In probation, the first cycle that the
//! new slot misses makes the old one Active again, with its command of the same cycle. If the computer kept the new
//! slot from running, the old one only stands in for a few cycles.

use messages::{MotorSlots, SLOTS};

/// Cycles for which another slot stands in for a silent one in charge, at up to 250 Hz; after more it takes its place.
/// A standby that is silent for longer loses its phase. A hiccup of the machine is shorter.
pub const GONE_CYCLES: u32 = 3;
/// Cycles in a row for which a standby may deviate too far from the slot in charge, at up to 250 Hz: laws differ where
/// the motion changes.
pub const APART_CYCLES: u32 = 10;

/// Phase of a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// No process answers.
    Empty = MotorSlots::PHASE_EMPTY,
    /// A process answers, without a good answer so far.
    Attached = MotorSlots::PHASE_ATTACHED,
    /// Good answers, not yet for long enough.
    Shadow = MotorSlots::PHASE_SHADOW,
    /// Standby.
    Qualified = MotorSlots::PHASE_QUALIFIED,
    /// Standby to which a swap is announced.
    Switching = MotorSlots::PHASE_SWITCHING,
    /// In charge.
    Active = MotorSlots::PHASE_ACTIVE,
    /// Was in charge before the swap, and is again if the new slot fails.
    Probation = MotorSlots::PHASE_PROBATION,
    /// Excluded until the operator admits it again.
    Quarantined = MotorSlots::PHASE_QUARANTINED,
}

impl Phase {
    /// Returns true for a slot that is not in charge and may take over while the robot moves.
    #[must_use]
    pub fn is_standby(self) -> bool {
        matches!(self, Self::Qualified | Self::Switching | Self::Probation)
    }
}

/// Answer of a slot in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// No sample.
    Silent,
    /// A sample without a valid result, or for another cycle, epoch or motion.
    Nothing,
    /// A sample that must never be used; the cause, `MotorSlots::CAUSE_*`.
    Wrong(u8),
    /// Good answer.
    Good,
}

/// Observation of one slot in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Answer of the slot.
    pub reply: Reply,
    /// Incarnation of the process; 0: none.
    pub incarnation: u32,
    /// Deviation from the slot in charge, as a share of what is allowed; `None`: nothing to compare.
    pub apart: Option<f64>,
}

/// Times of the state machine, cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Times {
    /// Good answers in a row that make a standby.
    pub qualify: u32,
    /// From the announcement of a swap to its effect.
    pub announce: u32,
    /// Probation of the old slot after a swap.
    pub probation: u32,
    /// Good answers in a row after which falls are forgiven.
    pub forgive: u32,
    /// Falls after which a slot is quarantined.
    pub falls: u8,
    /// [`GONE_CYCLES`] at the robot's rate.
    pub gone: u32,
    /// [`APART_CYCLES`] at the robot's rate.
    pub apart: u32,
}

/// Reason why a swap or an admission is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The slot is in charge already.
    InCharge,
    /// Another swap of this role is under way.
    UnderWay,
    /// The slot has another phase; the slot has the cause and its good cycles.
    NotQualified(Phase),
    /// The slot is not in quarantine.
    NotQuarantined,
}

/// State of a slot.
#[derive(Debug, Clone, Copy)]
pub struct SlotState {
    phase: Phase,
    incarnation: u32,
    well: u32,
    absent: u32,
    silent: u32,
    /// It has been silent for too long.
    gone: bool,
    outside: u32,
    falls: u8,
    cause: u8,
    /// In the slot in charge, another process answers now.
    foreign_instance: bool,
}

impl SlotState {
    const EMPTY: Self = Self {
        phase: Phase::Empty,
        incarnation: 0,
        well: 0,
        absent: 0,
        silent: 0,
        gone: false,
        outside: 0,
        falls: 0,
        cause: MotorSlots::CAUSE_NONE,
        foreign_instance: false,
    };

    /// Phase of the slot. An active slot that is silent or has another process shows as Empty or Attached.
    #[must_use]
    pub fn phase(&self) -> Phase {
        match self.phase {
            Phase::Quarantined => Phase::Quarantined,
            Phase::Active if self.gone => Phase::Empty,
            Phase::Active if self.foreign_instance => Phase::Attached,
            phase => phase,
        }
    }

    /// Incarnation of the process.
    #[must_use]
    pub fn incarnation(&self) -> u32 {
        self.incarnation
    }

    /// Good answers in a row.
    #[must_use]
    pub fn good_answers(&self) -> u32 {
        self.well
    }

    /// Falls that are not forgiven.
    #[must_use]
    pub fn failures(&self) -> u8 {
        self.falls
    }

    /// Cause of its last loss of phase, `MotorSlots::CAUSE_*`.
    #[must_use]
    pub fn cause(&self) -> u8 {
        self.cause
    }

    /// Loses its phase, with a strike if it had earned one.
    fn fall(&mut self, cause: u8, times: &Times) {
        if self.phase.is_standby() || self.phase == Phase::Shadow {
            self.strike();
        }
        self.drop_to_start(cause, times);
    }

    fn strike(&mut self) {
        self.falls = self.falls.saturating_add(1);
    }

    fn drop_to_start(&mut self, cause: u8, times: &Times) {
        self.phase = match () {
            () if self.falls >= times.falls => Phase::Quarantined,
            () if self.silent > 0 => Phase::Empty,
            () => Phase::Attached,
        };
        self.cause = cause;
        (self.well, self.absent, self.outside) = (0, 0, 0);
    }

    fn count_silence(&mut self, report: &Report, times: &Times) {
        self.silent = if report.reply == Reply::Silent { self.silent.saturating_add(1) } else { 0 };
        self.gone = self.silent > times.gone;
    }

    /// One cycle of a slot that is not in charge. `led`: the slot in charge gave a good answer, so that a missing one
    /// is this slot's own failure.
    fn beside(&mut self, report: &Report, led: bool, times: &Times) {
        self.count_silence(report, times);
        if self.phase == Phase::Quarantined {
            return;
        }
        if report.reply != Reply::Silent && self.phase == Phase::Empty {
            self.phase = Phase::Attached;
            self.incarnation = report.incarnation;
            return;
        }
        match report.reply {
            Reply::Good | Reply::Nothing if report.incarnation != self.incarnation => {
                self.incarnation = report.incarnation;
                self.fall(MotorSlots::CAUSE_RESTARTED, times);
            }
            Reply::Good => {
                self.absent = 0;
                match report.apart.filter(|_| led) {
                    Some(apart) if apart <= 1.0 => self.goes_well(times),
                    Some(_) => self.is_apart(times),
                    None => {}
                }
            }
            Reply::Wrong(cause) => {
                self.incarnation = report.incarnation;
                self.fall(cause, times);
            }
            Reply::Nothing | Reply::Silent => {
                if led {
                    self.absent = self.absent.saturating_add(1);
                }
                if self.absent > times.gone && !matches!(self.phase, Phase::Empty | Phase::Attached) {
                    let silent = self.silent > 0;
                    let cause = if silent { MotorSlots::CAUSE_ABSENT } else { MotorSlots::CAUSE_NOT_VALID };
                    self.fall(cause, times);
                } else if self.gone && self.phase != Phase::Empty {
                    // Without an answer in charge the failure cannot be attributed, but the slot has to qualify again.
                    self.drop_to_start(MotorSlots::CAUSE_ABSENT, times);
                }
            }
        }
    }

    fn goes_well(&mut self, times: &Times) {
        self.outside = 0;
        self.well = self.well.saturating_add(1);
        match self.phase {
            Phase::Attached => (self.phase, self.well) = (Phase::Shadow, 1),
            Phase::Shadow if self.well >= times.qualify => {
                (self.phase, self.cause) = (Phase::Qualified, MotorSlots::CAUSE_NONE);
            }
            _ => {}
        }
        if self.well >= times.forgive {
            self.falls = 0;
        }
    }

    fn is_apart(&mut self, times: &Times) {
        self.outside = self.outside.saturating_add(1);
        match self.phase {
            Phase::Attached | Phase::Shadow => {
                self.phase = Phase::Shadow;
                self.well = 0;
                self.cause = MotorSlots::CAUSE_DEVIATION;
            }
            _ if self.outside > times.apart => self.fall(MotorSlots::CAUSE_DEVIATION, times),
            _ => {}
        }
    }
}

/// Both slots of a role.
#[derive(Debug, Clone)]
pub struct Role {
    times: Times,
    slots: [SlotState; SLOTS],
    in_charge: usize,
    commit_cycle: u64,
    /// Cycles since the last swap took effect, while the old one is in probation.
    probation: Option<u32>,
}

impl Role {
    /// Two empty slots, a in charge.
    #[must_use]
    pub fn new(times: Times) -> Self {
        Self { times, slots: [SlotState::EMPTY; SLOTS], in_charge: 0, commit_cycle: 0, probation: None }
    }

    /// The slot in charge.
    #[must_use]
    pub fn in_charge(&self) -> usize {
        self.in_charge
    }

    /// State of a slot.
    #[must_use]
    pub fn slot(&self, slot: usize) -> &SlotState {
        &self.slots[slot]
    }

    /// Cycle in which an announced swap takes effect; 0: none is announced.
    #[must_use]
    pub fn commit_cycle(&self) -> u64 {
        self.commit_cycle
    }

    /// True if a swap is announced or its old slot is in probation.
    #[must_use]
    pub fn swapping(&self) -> bool {
        self.commit_cycle != 0 || self.probation.is_some()
    }

    /// Returns true if an answer of this process in this slot may be used. While the robot moves, the slot must be in
    /// charge or standby, with the incarnation that earned it; at rest, any slot that is not in quarantine counts.
    #[must_use]
    pub fn may_use(&self, slot: usize, incarnation: u32, moving: bool) -> bool {
        let SlotState { phase, incarnation: known, .. } = self.slots[slot];
        phase != Phase::Quarantined
            && (!moving || ((phase == Phase::Active || phase.is_standby()) && incarnation == known))
    }

    /// Processes one cycle and returns the slot to use. An announced swap takes effect in its cycle; a failed slot in
    /// charge is replaced.
    pub fn step(
        &mut self,
        cycle: u64,
        moving: bool,
        starved: &[bool; SLOTS],
        reports: &[Report; SLOTS],
    ) -> Option<usize> {
        let used = self.advance(cycle, moving, starved, reports);
        debug_assert!(
            used.is_none_or(
                |slot| reports[slot].reply == Reply::Good && self.may_use(slot, reports[slot].incarnation, moving)
            ),
            "slot {used:?} is used without a good answer or a qualification: {reports:?}, {self:?}"
        );
        self.check_slots();
        used
    }

    /// Checks the relations between the slots after a cycle.
    fn check_slots(&self) {
        let (lead, side) = (self.slots[self.in_charge].phase, self.slots[1 - self.in_charge].phase);
        debug_assert!(matches!(lead, Phase::Active | Phase::Empty), "the slot in charge is {lead:?}");
        debug_assert!(side != Phase::Active, "both slots are in charge");
        debug_assert!(
            (self.commit_cycle != 0) == (side == Phase::Switching),
            "a swap is announced for cycle {}, but the other slot is {side:?}",
            self.commit_cycle
        );
        debug_assert!(
            self.probation.is_some() == (side == Phase::Probation),
            "{:?} cycles of probation, but the other slot is {side:?}",
            self.probation
        );
    }

    fn advance(
        &mut self,
        cycle: u64,
        moving: bool,
        starved: &[bool; SLOTS],
        reports: &[Report; SLOTS],
    ) -> Option<usize> {
        let (lead, side) = (self.in_charge, 1 - self.in_charge);
        let good = |slot: usize| reports[slot].reply == Reply::Good;
        let led = self.lead(moving, &reports[lead]);
        self.slots[side].beside(&reports[side], led, &self.times);
        if self.probation.is_some() && self.slots[side].phase != Phase::Probation {
            self.probation = None;
        }
        if self.commit_cycle != 0 && self.slots[side].phase != Phase::Switching {
            self.commit_cycle = 0;
        }
        let side_counts = good(side)
            && self.slots[side].incarnation == reports[side].incarnation
            && (self.slots[side].phase.is_standby() || (!moving && self.slots[side].phase != Phase::Quarantined));
        if self.commit_cycle != 0 && cycle >= self.commit_cycle {
            if side_counts {
                self.commit(side);
                return Some(side);
            }
            // The slot is missing in the announced cycle: the swap is cancelled and may be requested again. A slot
            // without a processor gets a few more cycles.
            if !starved[side] || cycle >= self.commit_cycle.saturating_add(u64::from(self.times.gone)) {
                self.commit_cycle = 0;
                self.slots[side].phase = Phase::Qualified;
            }
        }
        if led {
            self.pass_probation();
            return Some(lead);
        }
        if !side_counts {
            return None;
        }
        if self.is_over(lead, &reports[lead], moving, starved[lead]) {
            self.replace(lead, side, &reports[lead]);
        }
        Some(side)
    }

    /// Processes the slot in charge; returns true if its answer counts.
    fn lead(&mut self, moving: bool, report: &Report) -> bool {
        let slot = &mut self.slots[self.in_charge];
        slot.count_silence(report, &self.times);
        slot.foreign_instance = report.reply != Reply::Silent && slot.incarnation != report.incarnation;
        let known = slot.phase == Phase::Active && !slot.foreign_instance;
        let counts = report.reply == Reply::Good && (known || (!moving && slot.phase != Phase::Quarantined));
        if counts {
            if !known {
                *slot = SlotState { phase: Phase::Active, incarnation: report.incarnation, ..SlotState::EMPTY };
            }
            slot.absent = 0;
            slot.well = slot.well.saturating_add(1);
            if slot.well >= self.times.forgive {
                slot.falls = 0;
            }
        } else {
            slot.absent = slot.absent.saturating_add(1);
            slot.well = 0;
        }
        counts
    }

    /// Returns true if the slot in charge loses its place to a standby that answers; false if that only stands in.
    fn is_over(&self, lead: usize, report: &Report, moving: bool, starved: bool) -> bool {
        let slot = &self.slots[lead];
        if slot.phase != Phase::Active {
            // At the start, the slot in charge may take a moment longer than the other.
            return slot.absent > self.times.qualify;
        }
        self.probation.is_some() && !starved
            || matches!(report.reply, Reply::Wrong(_))
            || (slot.foreign_instance && moving)
            || slot.absent > self.times.gone
    }

    /// Puts `next` in charge instead of `lead`, which failed.
    fn replace(&mut self, lead: usize, next: usize, report: &Report) {
        let reverted = self.probation.take().is_some();
        let slot = &mut self.slots[lead];
        if slot.phase == Phase::Active {
            if reverted {
                slot.strike();
            }
            let cause = match report.reply {
                Reply::Wrong(cause) => cause,
                _ if reverted => MotorSlots::CAUSE_PROBATION,
                Reply::Silent => MotorSlots::CAUSE_ABSENT,
                _ if slot.foreign_instance => MotorSlots::CAUSE_RESTARTED,
                _ => MotorSlots::CAUSE_NOT_VALID,
            };
            slot.incarnation = report.incarnation;
            slot.drop_to_start(cause, &self.times);
        }
        self.take_charge(next);
    }

    fn take_charge(&mut self, next: usize) {
        self.commit_cycle = 0;
        self.in_charge = next;
        let slot = &mut self.slots[next];
        slot.phase = Phase::Active;
        (slot.absent, slot.outside) = (0, 0);
    }

    fn commit(&mut self, next: usize) {
        let old = &mut self.slots[1 - next];
        if old.phase == Phase::Active && old.absent <= self.times.gone {
            old.phase = Phase::Probation;
            self.probation = Some(0);
        } else if old.phase != Phase::Empty {
            old.drop_to_start(MotorSlots::CAUSE_ABSENT, &self.times);
        }
        self.take_charge(next);
    }

    fn pass_probation(&mut self) {
        if let Some(cycles) = &mut self.probation {
            *cycles += 1;
            if *cycles >= self.times.probation {
                self.probation = None;
                self.slots[1 - self.in_charge].phase = Phase::Qualified;
            }
        }
    }

    /// Announces a swap to this slot; returns the cycle in which it takes effect.
    ///
    /// # Errors
    /// The reason why the swap is refused.
    pub fn announce(&mut self, slot: usize, cycle: u64) -> Result<u64, Refusal> {
        if slot == self.in_charge && self.slots[slot].phase() == Phase::Active {
            return Err(Refusal::InCharge);
        }
        if self.swapping() {
            return Err(Refusal::UnderWay);
        }
        let target = &mut self.slots[slot];
        if target.phase() != Phase::Qualified {
            return Err(Refusal::NotQualified(target.phase()));
        }
        target.phase = Phase::Switching;
        self.commit_cycle = cycle.saturating_add(u64::from(self.times.announce));
        Ok(self.commit_cycle)
    }

    /// Takes a slot out of quarantine, and forgives its falls.
    ///
    /// # Errors
    /// [`Refusal::InCharge`], [`Refusal::NotQuarantined`]; the falls of the latter are forgiven too.
    pub fn admit(&mut self, slot: usize) -> Result<(), Refusal> {
        self.slots[slot].falls = 0;
        match self.slots[slot].phase {
            Phase::Quarantined => {
                self.slots[slot] = SlotState::EMPTY;
                Ok(())
            }
            Phase::Active => Err(Refusal::InCharge),
            _ => Err(Refusal::NotQuarantined),
        }
    }
}
