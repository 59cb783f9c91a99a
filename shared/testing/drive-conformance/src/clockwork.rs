//! Encoders that show the time, and a wire that swaps answers.

use serial::{Device, Random, WireQueue};

use crate::virtual_units::VirtualUnits;

/// Currents that the units measure, A: exact in every protocol's unit.
pub(crate) const CURRENTS_A: [f64; 2] = [1.5, -0.5];

/// What the second encoder counts where the first one counts this: five turns while that one makes seven, backwards.
pub(crate) fn second_of(counts: i64) -> i64 {
    -counts * 5 / 7
}

/// Virtual units whose motor 1 counts microseconds and whose motor 2 counts them backwards.
#[derive(Debug)]
pub struct Clockwork<U> {
    /// The units.
    pub units: U,
    count: usize,
    /// Count of motor 1 at time 0.
    pub(crate) offset: i64,
    /// Probability that an answer arrives after the next one.
    pub(crate) swap: f64,
    /// Answers swapped.
    pub(crate) swapped: u64,
    /// Time of the byte by which the last unit began to move, ns.
    pub(crate) moves_from_ns: Option<u64>,
    random: Random,
    answer: WireQueue,
    held: Vec<u8>,
}

impl<U: VirtualUnits> Clockwork<U> {
    /// `count` units at time 0.
    pub(crate) fn new(units: U, count: usize) -> Self {
        Self {
            units,
            count,
            offset: 0,
            swap: 0.0,
            swapped: 0,
            moves_from_ns: None,
            random: Random::new(1),
            answer: WireQueue::new(0),
            held: Vec::new(),
        }
    }

    /// No unit: what is left in a port whose units moved to another.
    pub(crate) fn empty(units: U) -> Self {
        Self::new(units, 0)
    }

    /// Count of motor 1 at a time.
    pub(crate) fn count_at(&self, now_ns: u64) -> i64 {
        self.offset + (now_ns / 1000).cast_signed()
    }

    fn show(&mut self, now_ns: u64) {
        let counts = self.count_at(now_ns);
        for unit in 0..self.count {
            self.units.measure(unit, [counts, -counts], CURRENTS_A);
            self.units.measure_second(unit, second_of(counts));
        }
    }
}

impl<U: VirtualUnits> Device for Clockwork<U> {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.units.receive(now_ns, byte, &mut self.answer);
        let moves = self.count > 0 && self.units.drive(self.count - 1, 0).moves();
        self.moves_from_ns = if moves { self.moves_from_ns.or(Some(now_ns)) } else { None };
        let Some(at_ns) = self.answer.next_ns() else { return };
        let mut answer = Vec::new();
        while let Some((_, byte)) = self.answer.pop(u64::MAX) {
            answer.push(byte);
        }
        self.answer.clear();
        if self.held.is_empty() && self.random.chance(self.swap) {
            self.held = answer;
            self.swapped += 1;
            return;
        }
        reply.push(at_ns, &answer);
        reply.push(at_ns, &std::mem::take(&mut self.held));
    }

    fn advance(&mut self, now_ns: u64) {
        self.show(now_ns);
        self.units.advance(now_ns);
    }
}
