//! Two controllers and two estimators that start, stop, fail and send wrong values in any order. One per role is in
//! charge, no cycle is lost that a trusted slot could fill, and only accepted commands are used.
#![allow(clippy::needless_range_loop)]

use crate::rig;

use bytemuck::bytes_of;
use messages::{CABLES, MotorAuthority as A, MotorInput, MotorSlots as P, ROLE_SLOTS, SLOTS};
use motor_io::{Arbiter, ArbiterInput, ChosenCommand};
use proptest::prelude::*;

/// Answer of a process.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Lie {
    Nothing,
    NotANumber,
    Absurd,
    Stale,
    OtherEpoch,
    OtherSegment,
    NotValid,
    NoIncarnation,
}

#[derive(Debug, Clone, Copy)]
enum Event {
    Run(u32),
    Kill(usize),
    Start(usize),
    Lie(usize, Lie, u32),
    Swap(usize),
    Admit(usize),
    Move(bool),
    Epoch,
}

fn event() -> impl Strategy<Value = Event> {
    let lie = prop_oneof![
        4 => Just(Lie::Nothing), 1 => Just(Lie::NotANumber), 1 => Just(Lie::Absurd), 2 => Just(Lie::Stale), 1 => Just(Lie::OtherEpoch),
        1 => Just(Lie::OtherSegment), 2 => Just(Lie::NotValid), 1 => Just(Lie::NoIncarnation),
    ];
    let run = prop_oneof![2 => 1..6u32, 2 => 6..60u32, 3 => 100..250u32];
    prop_oneof![
        8 => run.prop_map(Event::Run),
        2 => (0..ROLE_SLOTS).prop_map(Event::Kill),
        4 => (0..ROLE_SLOTS).prop_map(Event::Start),
        3 => (0..ROLE_SLOTS, lie, prop_oneof![1..5u32, 5..40u32]).prop_map(|(seat, lie, cycles)| Event::Lie(seat, lie, cycles)),
        4 => (0..ROLE_SLOTS).prop_map(Event::Swap),
        1 => (0..ROLE_SLOTS).prop_map(Event::Admit),
        2 => prop::bool::weighted(0.8).prop_map(Event::Move),
        1 => Just(Event::Epoch),
    ]
}

/// A process in a slot.
#[derive(Debug, Clone, Copy, Default)]
struct Process {
    incarnation: u32,
    lie: Option<(Lie, u32)>,
}

const PERIOD_S: f64 = rig::PERIOD_S;
const SEGMENT: u32 = 1;

/// One cycle of the arbiter, as published.
struct Cycle {
    input: MotorInput,
    chosen: Option<ChosenCommand>,
    authority: A,
    slots: P,
    /// Incarnation that answers in each slot; 0: none.
    processes: [u32; ROLE_SLOTS],
    /// Slots whose process was trusted before.
    trusted: [bool; ROLE_SLOTS],
}

/// Processes around the arbiter, and an account of them that is independent of the arbiter's implementation.
struct World {
    arbiter: Arbiter,
    cycle: u64,
    epoch: u32,
    moving: bool,
    lives: u32,
    processes: [Option<Process>; ROLE_SLOTS],
    /// Constant answer of each controller to each estimate, m/s; it differs by process.
    velocity: [[f64; SLOTS]; SLOTS],
    sent: [f64; CABLES],
    before: A,
    slots: P,
    /// Incarnation trusted in each slot after the last cycle; 0: none.
    trusted: [u32; ROLE_SLOTS],
    announced: Option<(usize, u64)>,
    admitted: Option<usize>,
    waiting: [u64; ROLE_SLOTS],
    record: Vec<(MotorInput, ArbiterInput, Option<ChosenCommand>, A, P)>,
    swaps: u32,
}

fn is_trusted(phase: u8) -> bool {
    [P::PHASE_ACTIVE, P::PHASE_QUALIFIED, P::PHASE_SWITCHING, P::PHASE_PROBATION].contains(&phase)
}

impl World {
    fn new(velocity: [[f64; SLOTS]; SLOTS]) -> Self {
        let arbiter = Arbiter::new(&rig::config());
        let mut before = A::default();
        arbiter.describe(&mut before);
        Self {
            cycle: 1,
            epoch: 3,
            moving: false,
            lives: 0,
            processes: [None; ROLE_SLOTS],
            velocity,
            sent: [0.0; CABLES],
            slots: arbiter.slots(&before),
            arbiter,
            before,
            trusted: [0; ROLE_SLOTS],
            announced: None,
            admitted: None,
            waiting: [0; ROLE_SLOTS],
            record: Vec::new(),
            swaps: 0,
        }
    }

    /// Requests are answered within a cycle, before its sample is made.
    fn answer_requests(&mut self) {
        self.arbiter.describe(&mut self.before);
        self.slots = self.arbiter.slots(&self.before);
    }

    fn start(&mut self, seat: usize) {
        self.lives += 1;
        self.processes[seat] = Some(Process { incarnation: self.lives, lie: None });
    }

    fn input(&mut self) -> MotorInput {
        let mut input = MotorInput::default();
        input.header.cycle = self.cycle;
        let lies: [Option<Lie>; ROLE_SLOTS] =
            std::array::from_fn(|seat| self.processes[seat].and_then(|process| process.lie).map(|(lie, _)| lie));
        for e in 0..SLOTS {
            let Some(process) = self.processes[SLOTS + e].filter(|_| lies[SLOTS + e] != Some(Lie::Nothing)) else {
                continue;
            };
            let lie = lies[SLOTS + e];
            let stale = matches!(lie, Some(Lie::Stale | Lie::OtherEpoch | Lie::OtherSegment));
            input.estimate_cycle[e] = self.cycle - 1 - u64::from(stale);
            input.estimate_valid[e] = u8::from(lie != Some(Lie::NotValid));
            input.estimate_incarnation[e] = if lie == Some(Lie::NoIncarnation) { 0 } else { process.incarnation };
            input.estimate_position_m[3 * e..][..3].fill(match lie {
                Some(Lie::NotANumber) => f64::NAN,
                Some(Lie::Absurd) => f64::INFINITY,
                _ => 1.0 + 0.005 * e as f64,
            });
        }
        for c in 0..SLOTS {
            let Some(process) = self.processes[c].filter(|_| lies[c] != Some(Lie::Nothing)) else { continue };
            let lie = lies[c];
            input.command_arrived[c] = 1;
            let command = &mut input.command[c];
            command.based_on_cycle = self.cycle - 1 - u64::from(lie == Some(Lie::Stale));
            command.epoch = self.epoch - u32::from(lie == Some(Lie::OtherEpoch));
            command.incarnation = if lie == Some(Lie::NoIncarnation) { 0 } else { process.incarnation };
            command.segment = SEGMENT + u32::from(lie == Some(Lie::OtherSegment));
            for e in 0..SLOTS {
                let seen = input.estimate_cycle[e] + 1 == self.cycle && input.estimate_valid[e] == 1;
                command.valid[e] = u8::from(seen && lie != Some(Lie::NotValid));
                command.velocity_m_s[CABLES * e..][..CABLES].fill(match lie {
                    Some(Lie::NotANumber) => f64::NAN,
                    Some(Lie::Absurd) => -1e3,
                    _ => self.velocity[c][e],
                });
            }
        }
        for process in self.processes.iter_mut().flatten() {
            process.lie = process.lie.and_then(|(lie, left)| (left > 1).then(|| (lie, left - 1)));
        }
        input
    }

    /// True if a controller's answer on an estimate may be used at all.
    fn acceptable(&self, input: &MotorInput, c: usize, e: usize) -> bool {
        let command = &input.command[c];
        let position = &input.estimate_position_m[3 * e..][..3];
        input.command_arrived[c] == 1
            && command.incarnation != 0
            && command.epoch == self.epoch
            && command.based_on_cycle + 1 == self.cycle
            && (!self.moving || command.segment == SEGMENT)
            && command.valid[e] == 1
            && command.velocity_m_s[CABLES * e..][..3].iter().all(|v| v.is_finite() && v.abs() < 3.2)
            && input.estimate_cycle[e] + 1 == self.cycle
            && input.estimate_incarnation[e] != 0
            && input.estimate_valid[e] == 1
            && position.iter().all(|x| x.is_finite())
    }

    fn cycle(&mut self) -> Result<(), TestCaseError> {
        self.cycle += 1;
        let input = self.input();
        let context = ArbiterInput {
            epoch: self.epoch,
            moving: self.moving,
            sent_m_s: self.sent,
            starved: [false; messages::ROLE_SLOTS],
        };
        let chosen = self.arbiter.choose(&input, &context, |segment| segment == SEGMENT);
        let mut authority = A::default();
        self.arbiter.describe(&mut authority);
        let slots = self.arbiter.slots(&authority);
        // An estimate of an old cycle does not show which process runs now.
        let processes = std::array::from_fn(|seat| match seat {
            0 | 1 => input.command[seat].incarnation,
            _ if input.estimate_cycle[seat - SLOTS] + 1 != input.header.cycle => 0,
            _ => input.estimate_incarnation[seat - SLOTS],
        });
        let trusted = std::array::from_fn(|seat| self.trusted[seat] != 0 && self.trusted[seat] == processes[seat]);
        let now = Cycle { input, chosen, authority, slots, processes, trusted };
        self.check_choice(&now)?;
        self.check_bump(&now)?;
        self.check_phases(&now)?;
        self.check_swap(&now)?;
        for seat in 0..ROLE_SLOTS {
            // The slot in charge keeps its place during a silence without a standby.
            let in_charge = usize::from(authority.in_charge[seat / SLOTS]) == seat % SLOTS;
            if !is_trusted(slots.phase[seat]) {
                self.trusted[seat] = if in_charge { self.trusted[seat] } else { 0 };
            } else if self.trusted[seat] == 0 || !self.moving {
                let arrived = processes[seat];
                self.trusted[seat] = if arrived == 0 { self.trusted[seat] } else { arrived };
            }
        }
        if let Some(chosen) = &chosen {
            self.sent = chosen.velocity_m_s;
        }
        self.record.push((input, context, chosen, authority, slots));
        (self.before, self.slots, self.admitted) = (authority, slots, None);
        Ok(())
    }

    /// Only accepted commands are used, in flight only those of slots that were trusted before; no cycle is lost that a
    /// trusted slot could fill.
    fn check_choice(&self, now: &Cycle) -> Result<(), TestCaseError> {
        if let Some(chosen) = &now.chosen {
            let (c, e) = (chosen.controller, chosen.estimator);
            prop_assert!(self.acceptable(&now.input, c, e), "cycle {}: {c} on {e}", self.cycle);
            prop_assert_eq!(now.authority.verdict[c], A::VERDICT_ACCEPTED);
            for seat in [c, SLOTS + e] {
                prop_assert!(self.slots.phase[seat] != P::PHASE_QUARANTINED || self.admitted == Some(seat));
                prop_assert!(
                    !self.moving || now.trusted[seat],
                    "cycle {}: seat {seat} is not trusted: {:?}, {:?} {:?}, {}",
                    self.cycle,
                    self.trusted,
                    self.slots.phase,
                    now.slots.phase,
                    now.processes[seat]
                );
            }
            let active = (now.authority.active_controller, now.authority.active_estimator);
            prop_assert_eq!((usize::from(active.0), usize::from(active.1)), (c, e));
        }
        if self.moving {
            let pairs = (0..SLOTS).flat_map(|c| (0..SLOTS).map(move |e| (c, e)));
            for (c, e) in pairs {
                let could = now.trusted[c] && now.trusted[SLOTS + e] && self.acceptable(&now.input, c, e);
                prop_assert!(!could || now.chosen.is_some(), "cycle {}: {c} on {e} was there", self.cycle);
            }
        }
        Ok(())
    }

    /// Every command is one of four constant ones or between them, and the change is gradual.
    fn check_bump(&self, now: &Cycle) -> Result<(), TestCaseError> {
        let (Some(chosen), true) = (&now.chosen, self.moving) else { return Ok(()) };
        let all = self.velocity.iter().flatten().copied();
        let (low, high) =
            all.chain([self.sent[0]]).fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        let step = (high - low) * PERIOD_S / rig::config().fade_s;
        let v = chosen.velocity_m_s;
        prop_assert!(v[0] >= low - 1e-12 && v[0] <= high + 1e-12);
        let changed = (now.authority.active_controller, now.authority.active_estimator)
            != (self.before.active_controller, self.before.active_estimator);
        prop_assert!(
            (v[0] - self.sent[0]).abs() <= step + 1e-12 || (!changed && self.before.fade == [1.0; 2]),
            "from {} to {}",
            self.sent[0],
            v[0]
        );
        Ok(())
    }

    /// One slot is in charge per role, as published; quarantine is sticky; swap and probation end.
    fn check_phases(&mut self, now: &Cycle) -> Result<(), TestCaseError> {
        for role in 0..2 {
            let phases = &now.slots.phase[SLOTS * role..][..SLOTS];
            let active: Vec<usize> = (0..SLOTS).filter(|slot| phases[*slot] == P::PHASE_ACTIVE).collect();
            prop_assert!(active.len() <= 1, "{phases:?}");
            prop_assert!(active.iter().all(|slot| *slot == usize::from(now.authority.in_charge[role])));
        }
        for (seat, phase) in now.slots.phase.iter().enumerate() {
            let was = self.slots.phase[seat] == P::PHASE_QUARANTINED && self.admitted != Some(seat);
            prop_assert!(!was || *phase == P::PHASE_QUARANTINED);
            let passing = [P::PHASE_SWITCHING, P::PHASE_PROBATION].contains(phase);
            // Without answers there is nothing to try; probation counts only cycles with answers.
            let waiting = &mut self.waiting[seat];
            *waiting = if passing { *waiting + u64::from(now.chosen.is_some()) } else { 0 };
            prop_assert!(*waiting <= 120, "seat {seat} stays in phase {phase}");
        }
        Ok(())
    }

    /// A swap takes effect in the announced cycle if the new process answers, and ends.
    fn check_swap(&mut self, now: &Cycle) -> Result<(), TestCaseError> {
        let Some((seat, commit)) = self.announced else { return Ok(()) };
        let (role, slot) = (seat / SLOTS, seat % SLOTS);
        let in_charge = usize::from(now.authority.in_charge[role]);
        let announced = now.slots.commit_cycle[role];
        if self.cycle < commit {
            prop_assert!(announced == commit || now.slots.phase[seat] != P::PHASE_SWITCHING);
            if announced == 0 {
                self.announced = None;
            }
        } else {
            prop_assert_eq!(announced, 0);
            let there = self.slots.phase[seat] == P::PHASE_SWITCHING && now.trusted[seat];
            let good = now.chosen.is_some_and(|chosen| match role {
                0 => self.acceptable(&now.input, slot, chosen.estimator),
                _ => self.acceptable(&now.input, chosen.controller, slot),
            });
            prop_assert!(!(there && good) || in_charge == slot, "the swap to {seat} did not take effect");
            self.swaps += u32::from(in_charge == slot);
            self.announced = None;
        }
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn processes_start_stop_and_fail(
        events in prop::collection::vec(event(), 10..60),
        velocity in prop::array::uniform2(prop::array::uniform2(-0.05..0.05f64)),
        alone in 0..4u8,
    ) {
        let mut world = World::new(velocity);
        for seat in (0..ROLE_SLOTS).filter(|seat| alone == 0 || seat % SLOTS == 0) {
            world.start(seat);
        }
        for event in events {
            match event {
                Event::Run(cycles) => {
                    for _ in 0..cycles {
                        world.cycle()?;
                    }
                }
                Event::Kill(seat) => world.processes[seat] = None,
                Event::Start(seat) => world.start(seat),
                Event::Lie(seat, lie, cycles) => {
                    if let Some(process) = &mut world.processes[seat] {
                        process.lie = Some((lie, cycles));
                    }
                }
                Event::Swap(seat) => {
                    if let Ok(commit) = world.arbiter.announce(seat / SLOTS, seat % SLOTS, world.cycle) {
                        prop_assert_eq!(world.slots.phase[seat], P::PHASE_QUALIFIED);
                        prop_assert!(world.announced.is_none());
                        world.announced = Some((seat, commit));
                        world.answer_requests();
                    }
                }
                Event::Admit(seat) => {
                    let _ = world.arbiter.admit(seat / SLOTS, seat % SLOTS);
                    world.answer_requests();
                    world.admitted = Some(seat);
                }
                Event::Move(moving) => world.moving = moving,
                Event::Epoch => world.epoch += 1,
            }
        }
    }

    #[test]
    fn a_replay_gives_the_same_choices(events in prop::collection::vec(event(), 10..40)) {
        let mut world = World::new([[0.02, 0.03], [0.01, -0.02]]);
        (0..ROLE_SLOTS).for_each(|seat| world.start(seat));
        let mut asked = Vec::new();
        for event in events {
            match event {
                Event::Run(cycles) => (0..cycles).try_for_each(|_| world.cycle())?,
                Event::Kill(seat) => world.processes[seat] = None,
                Event::Start(seat) => world.start(seat),
                Event::Swap(seat) => {
                    let cycle = world.cycle;
                    if let Ok(commit) = world.arbiter.announce(seat / SLOTS, seat % SLOTS, cycle) {
                        world.announced = Some((seat, commit));
                        world.answer_requests();
                        asked.push((cycle, seat));
                    }
                }
                Event::Move(moving) => world.moving = moving,
                Event::Lie(..) | Event::Admit(_) | Event::Epoch => {}
            }
        }
        let mut replayed = Arbiter::new(&rig::config());
        let mut asked = asked.into_iter().peekable();
        for (input, context, chosen, account, slots) in &world.record {
            while let Some((_, seat)) = asked.next_if(|(cycle, _)| *cycle < input.header.cycle) {
                prop_assert!(replayed.announce(seat / SLOTS, seat % SLOTS, input.header.cycle - 1).is_ok());
            }
            prop_assert_eq!(&replayed.choose(input, context, |segment| segment == SEGMENT), chosen);
            let mut again = A::default();
            replayed.describe(&mut again);
            prop_assert_eq!(bytes_of(&again), bytes_of(account));
            let again_slots = replayed.slots(&again);
            prop_assert_eq!(bytes_of(&again_slots), bytes_of(slots));
        }
    }
}

/// The model proves nothing if swaps never happen in it.
#[test]
fn swaps_happen_in_the_model() {
    let mut world = World::new([[0.02, 0.03], [0.01, -0.02]]);
    (0..ROLE_SLOTS).for_each(|seat| world.start(seat));
    for seat in [1, 0, 3, 2] {
        world.moving = true;
        if world.cycle < 5 {
            world.moving = false;
        }
        for _ in 0..10 {
            world.cycle().unwrap();
        }
        world.moving = true;
        for _ in 0..250 {
            world.cycle().unwrap();
        }
        let commit = world.arbiter.announce(seat / SLOTS, seat % SLOTS, world.cycle).unwrap();
        world.announced = Some((seat, commit));
        world.answer_requests();
        for _ in 0..250 {
            world.cycle().unwrap();
        }
    }
    assert_eq!(world.swaps, 4);
}
