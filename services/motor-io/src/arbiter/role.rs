//! Who is in charge of one role: two slots, how far each is trusted, and the way of a swap.
//!
//! ```text
//!   Empty --> Attached --> Shadow --> Qualified --> Switching --> Active
//!                ^            |           |  ^    swap is       |
//!                +---- fall --+-----------+  |    announced     | the swap takes effect
//!                |                           |                  v
//!          Quarantined                       +--- Probation <-- Active (the one before)
//! ```
//!
//! A slot that falls three times (`quarantine_falls`) without a good while between is set aside until the operator admits it again: one that comes and
//! goes is no standby. In probation the first cycle that the new one misses makes the old one Active again, by its command of the
//! same cycle. Where the computer kept the new one from running, the old one only stands in for it, for a few cycles.

use messages::{MotorSlots, SLOTS};

/// A slot in charge that gives no answer is stood in for; after more than so many cycles it has lost its place. As many cycles
/// of nothing and a standby is none any more. A hiccup of the machine is shorter.
pub const GONE_CYCLES: u32 = 3;
/// So many cycles in a row a standby may be too far from the one in charge: laws differ where the motion changes.
pub const APART_CYCLES: u32 = 10;

/// How far a slot is trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// Nobody is there.
    Empty = MotorSlots::PHASE_EMPTY,
    /// Somebody speaks, without a good answer so far.
    Attached = MotorSlots::PHASE_ATTACHED,
    /// Answers well, not yet for long enough.
    Shadow = MotorSlots::PHASE_SHADOW,
    /// A standby.
    Qualified = MotorSlots::PHASE_QUALIFIED,
    /// A swap to it is announced.
    Switching = MotorSlots::PHASE_SWITCHING,
    /// In charge.
    Active = MotorSlots::PHASE_ACTIVE,
    /// Was in charge before the swap, and is again if the new one fails.
    Probation = MotorSlots::PHASE_PROBATION,
    /// Set aside until it is admitted again.
    Quarantined = MotorSlots::PHASE_QUARANTINED,
}

impl Phase {
    /// True for a slot that is not in charge and may take over while the robot moves.
    #[must_use]
    pub fn is_standby(self) -> bool {
        matches!(self, Self::Qualified | Self::Switching | Self::Probation)
    }
}

/// What a slot came up with in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// Nothing at all.
    Silent,
    /// Something, but not for this cycle, this epoch or this motion, or without a valid result.
    Nothing,
    /// Something that must never be used; the cause, `MotorSlots::CAUSE_*`.
    Wrong(u8),
    /// A good answer.
    Good,
}

/// The account of one slot for one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// What it came up with.
    pub reply: Reply,
    /// Who: non-zero number of the process's life.
    pub incarnation: u32,
    /// How far it is from the slot in charge, as a share of what is allowed; `None`: there is nothing to compare.
    pub apart: Option<f64>,
}

impl Report {
    /// Nothing arrived.
    pub const SILENT: Self = Self { reply: Reply::Silent, incarnation: 0, apart: None };
}

/// Limits of the role's machine; times in cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Times {
    /// Good answers in a row that make a standby.
    pub qualify: u32,
    /// From the announcement of a swap to its effect.
    pub announce: u32,
    /// How long the old one stays in probation after it.
    pub probation: u32,
    /// Good answers in a row after which falls are forgiven.
    pub forgive: u32,
    /// Falls after which a slot is set aside.
    pub falls: u8,
}

/// Why a swap or an admission is not done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// It is in charge already.
    InCharge,
    /// Another swap of this role is under way.
    UnderWay,
    /// Its phase; the cause and the cycles it has answered well stand in the slot.
    NotQualified(Phase),
    /// It is not set aside.
    NotQuarantined,
}

/// What is known of a slot.
#[derive(Debug, Clone, Copy)]
pub struct Slot {
    phase: Phase,
    incarnation: u32,
    well: u32,
    absent: u32,
    silent: u32,
    outside: u32,
    falls: u8,
    cause: u8,
    /// Of the slot in charge: who speaks there now is somebody else.
    foreign_instance: bool,
}

impl Slot {
    const EMPTY: Self = Self {
        phase: Phase::Empty,
        incarnation: 0,
        well: 0,
        absent: 0,
        silent: 0,
        outside: 0,
        falls: 0,
        cause: MotorSlots::CAUSE_NONE,
        foreign_instance: false,
    };

    /// How far it is trusted. One in charge from which nothing comes any more, or somebody else, is shown as what it is.
    #[must_use]
    pub fn phase(&self) -> Phase {
        match self.phase {
            Phase::Quarantined => Phase::Quarantined,
            Phase::Active if self.silent > GONE_CYCLES => Phase::Empty,
            Phase::Active if self.foreign_instance => Phase::Attached,
            phase => phase,
        }
    }

    /// Who speaks there: number of the process's life.
    #[must_use]
    pub fn incarnation(&self) -> u32 {
        self.incarnation
    }

    /// Good answers in a row.
    #[must_use]
    pub fn well(&self) -> u32 {
        self.well
    }

    /// Falls that are not forgiven.
    #[must_use]
    pub fn falls(&self) -> u8 {
        self.falls
    }

    /// What last cost it its trust, `MotorSlots::CAUSE_*`.
    #[must_use]
    pub fn cause(&self) -> u8 {
        self.cause
    }

    /// Loses what trust it had.
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

    /// One cycle of a slot that is not in charge. `led`: the one in charge gave a good answer in this cycle, so that a missing one is
    /// this slot's own.
    fn beside(&mut self, report: &Report, led: bool, times: &Times) {
        self.silent = if report.reply == Reply::Silent { self.silent.saturating_add(1) } else { 0 };
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
                if self.absent > GONE_CYCLES && !matches!(self.phase, Phase::Empty | Phase::Attached) {
                    let silent = self.silent > 0;
                    let cause = if silent { MotorSlots::CAUSE_ABSENT } else { MotorSlots::CAUSE_NOT_VALID };
                    self.fall(cause, times);
                } else if self.silent > GONE_CYCLES && self.phase != Phase::Empty {
                    // Nobody is there to say whose fault it is, but who comes back has to qualify anew.
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
            _ if self.outside > APART_CYCLES => self.fall(MotorSlots::CAUSE_DEVIATION, times),
            _ => {}
        }
    }
}

/// The slots of a role. See the module's text.
#[derive(Debug, Clone)]
pub struct Role {
    times: Times,
    slots: [Slot; SLOTS],
    in_charge: usize,
    commit_cycle: u64,
    /// Cycles since the last swap took effect, while the old one is in probation.
    probation: Option<u32>,
}

impl Role {
    /// Two empty slots, a in charge.
    #[must_use]
    pub fn new(times: Times) -> Self {
        Self { times, slots: [Slot::EMPTY; SLOTS], in_charge: 0, commit_cycle: 0, probation: None }
    }

    /// The slot in charge.
    #[must_use]
    pub fn in_charge(&self) -> usize {
        self.in_charge
    }

    /// What is known of a slot.
    #[must_use]
    pub fn slot(&self, slot: usize) -> &Slot {
        &self.slots[slot]
    }

    /// The cycle in which an announced swap takes effect; 0: none is announced.
    #[must_use]
    pub fn commit_cycle(&self) -> u64 {
        self.commit_cycle
    }

    /// A swap is announced, or its old one is in probation.
    #[must_use]
    pub fn swapping(&self) -> bool {
        self.commit_cycle != 0 || self.probation.is_some()
    }

    /// True if an answer of this process in this slot may be used. While the robot moves only those count that are in charge or
    /// standby, and in the life in which they became so; at rest everybody who is not set aside.
    #[must_use]
    pub fn may_use(&self, slot: usize, incarnation: u32, moving: bool) -> bool {
        let Slot { phase, incarnation: known, .. } = self.slots[slot];
        phase != Phase::Quarantined
            && (!moving || ((phase == Phase::Active || phase.is_standby()) && incarnation == known))
    }

    /// One cycle: who is used in it. At the announced cycle the swap takes effect; whoever is gone is replaced.
    pub fn step(
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
            // It is not there in the very cycle that was announced: the swap is off, and may be asked for again. One that had no processor
            // is waited for.
            if !starved[side] || cycle >= self.commit_cycle.saturating_add(u64::from(GONE_CYCLES)) {
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

    /// The slot in charge in this cycle; true if its answer counts.
    fn lead(&mut self, moving: bool, report: &Report) -> bool {
        let slot = &mut self.slots[self.in_charge];
        slot.silent = if report.reply == Reply::Silent { slot.silent.saturating_add(1) } else { 0 };
        slot.foreign_instance = report.reply != Reply::Silent && slot.incarnation != report.incarnation;
        let known = slot.phase == Phase::Active && !slot.foreign_instance;
        let counts = report.reply == Reply::Good && (known || (!moving && slot.phase != Phase::Quarantined));
        if counts {
            if !known {
                *slot = Slot { phase: Phase::Active, incarnation: report.incarnation, ..Slot::EMPTY };
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

    /// Whether the slot in charge has lost its place to a standby that answers, or is only stood in for.
    fn is_over(&self, lead: usize, report: &Report, moving: bool, starved: bool) -> bool {
        let slot = &self.slots[lead];
        if slot.phase != Phase::Active {
            // At the start: whoever is to be in charge may take a moment longer than the other.
            return slot.absent > self.times.qualify;
        }
        self.probation.is_some() && !starved
            || matches!(report.reply, Reply::Wrong(_))
            || (slot.foreign_instance && moving)
            || slot.absent > GONE_CYCLES
    }

    /// `next` is in charge instead of `lead`, which failed.
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
        if old.phase == Phase::Active && old.absent <= GONE_CYCLES {
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

    /// Announces a swap to this slot; gives the cycle in which it takes effect.
    ///
    /// # Errors
    /// Why not.
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
                self.slots[slot] = Slot::EMPTY;
                Ok(())
            }
            Phase::Active => Err(Refusal::InCharge),
            _ => Err(Refusal::NotQuarantined),
        }
    }
}
