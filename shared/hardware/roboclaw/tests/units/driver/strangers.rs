//! Ports with something else at their end than a drive: never ready, never taken for a unit, and called what they are.

use drives::{Error, UnitAnswer};
use roboclaw::{Bus, Drive};
use serial::{Device, Pipe, Random, Transport, WireQueue};

use super::clockwork::{BAUD, BUDGET_NS, MS, PERIOD_NS, config, unit_config};

/// What is at the end of the line instead of a unit.
#[derive(Debug)]
enum Stranger {
    /// Nothing.
    Mute,
    /// A loopback: the bytes themselves.
    Loopback,
    /// Acknowledges whatever comes.
    Agreeable,
    /// Says something else for every byte.
    Foreign(Random),
    /// Says something without end once it was spoken to.
    Babbler,
}

impl Device for Stranger {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        match self {
            Self::Mute => {}
            Self::Loopback => reply.push(now_ns, &[byte]),
            Self::Agreeable => reply.push(now_ns, &[0xff]),
            Self::Foreign(random) => (0..6).for_each(|_| reply.push(now_ns, &[random.bits() as u8])),
            Self::Babbler => (0..8000).for_each(|k| reply.push(now_ns + k * MS, &[k as u8])),
        }
    }
}

/// Half a minute of control cycles; the last answer.
fn driven(stranger: Stranger) -> UnitAnswer {
    let mut bus = Bus::new(Pipe::new("test line", BAUD, stranger), &config(vec![unit_config(0x80)])).unwrap();
    let mut answers = bus.blank_answers();
    for cycle in 1..=3000u64 {
        bus.transport_mut().wait_until(cycle * PERIOD_NS);
        let until_ns = bus.transport().now_ns() + BUDGET_NS;
        bus.cycle(&[[Drive::HOLD; 2]], until_ns, &mut answers);
        assert!(answers[0].outcome.is_err(), "cycle {cycle}");
        assert!(!bus.is_settled() && answers[0].report.setups == 0 && answers[0].report.counts.at_ns == 0);
        // As the thread of a line does between cycles.
        let until_ns = bus.transport().now_ns() + 5 * MS;
        let _ = bus.settle(until_ns);
    }
    answers.remove(0)
}

#[test]
fn a_port_without_a_unit_never_counts_as_one_and_is_called_what_it_is() {
    let outcome = |stranger| driven(stranger).outcome.unwrap_err();
    assert!(matches!(outcome(Stranger::Mute), Error::Silent { .. }));
    assert!(matches!(outcome(Stranger::Loopback), Error::Echo { .. }));
    assert!(matches!(outcome(Stranger::Agreeable), Error::Foreign { .. }));
    assert!(matches!(outcome(Stranger::Foreign(Random::new(7))), Error::Foreign { .. }));
    assert!(matches!(outcome(Stranger::Babbler), Error::Babble { .. }));
}

#[test]
fn every_stranger_is_named_with_its_port_and_a_cure() {
    for stranger in [Stranger::Mute, Stranger::Loopback, Stranger::Agreeable, Stranger::Babbler] {
        let error = driven(stranger).outcome.unwrap_err();
        assert!(error.is_silence(), "{error}");
        let sentence = error.to_string();
        assert!(sentence.starts_with("test line") && sentence.contains("; ") && sentence.len() < 200, "{sentence}");
    }
}
