//! A unit of its own on a UART, at the highest rates that `nims check` accepts.

use drives::{Command, CountBound, Counters, DriveBus};
use moteus::codec::Checksums;
use moteus::driver::UART_MARGIN_NS;
use moteus::unit::{Measured, Unit, UnitBus, UnitOptions};
use moteus::{Bus, BusConfig, UnitConfig};
use serial::{Pipe, Transport};

const MS: u64 = 1_000_000;
const CYCLES: u64 = 1000;
/// Share of a period in which motor-io lets the drives answer, in percent.
const BUS_PERCENT: u64 = 85;

/// Counts and slow readings of [`CYCLES`] cycles at this baud rate, each of which is answered.
fn flown(baud: u32, period_ns: u64) -> (Counters, u64) {
    let units = UnitBus::new(vec![Unit::new(UnitOptions::new(1))], Checksums::Required);
    let unit = UnitConfig {
        address: 1,
        watchdog_ms: 300,
        bound: CountBound { counts_s: 1e5, margin: 1e3 },
        torque_constant_n_m_a: 0.0,
        second: None,
    };
    let config = BusConfig {
        baud,
        margin_ns: UART_MARGIN_NS,
        checksums: Checksums::Required,
        units: vec![unit],
        stop_pin: None,
    };
    let mut bus = Bus::new(Pipe::new("moteus", baud, units), &config).unwrap();
    while bus.settle(bus.transport().now_ns() + 100 * MS).is_err() {}
    let (before, begin_ns) = (bus.counters(), bus.transport().now_ns() + MS);
    let (mut slow, mut read_ns) = (0, 0);
    for cycle in 0..CYCLES {
        let tick_ns = begin_ns + cycle * period_ns;
        assert!(bus.transport().now_ns() <= tick_ns, "cycle {cycle} is late");
        bus.transport_mut().wait_until(tick_ns);
        let supply_v = 20.0 + (cycle % 7) as f64;
        bus.transport_mut().device_mut().measure(0, &Measured { supply_v, ..Measured::default() });
        let mut answers = bus.blank_answers();
        let deadline_ns = tick_ns + period_ns * BUS_PERCENT / 100;
        bus.exchange(&[[Some(Command::HOLD), None]], deadline_ns, &mut answers);
        assert_eq!(answers[0].outcome, Ok(()), "cycle {cycle}");
        assert!(answers[0].report.counts.at_ns >= tick_ns);
        bus.spend(deadline_ns);
        let read = answers[0].report.supply_v;
        slow += u64::from(read.at_ns > read_ns);
        read_ns = read.at_ns;
    }
    let after = bus.counters();
    let left_out = after.left_out - before.left_out;
    (Counters { left_out, exchanges: after.exchanges - before.exchanges, ..after }, slow)
}

#[test]
fn at_500_hz_and_3_mbaud_every_cycle_is_answered_and_every_second_reads_what_changes_slowly() {
    let (counters, slow) = flown(3_000_000, 2 * MS);
    assert_eq!((counters.left_out, counters.timeouts, counters.exchanges), (0, 0, CYCLES + CYCLES / 2));
    // One is of the set-up.
    assert!((CYCLES / 2..=CYCLES / 2 + 1).contains(&slow), "{slow}");
}

#[test]
fn at_the_highest_rate_of_921600_baud_every_cycle_reads_what_changes_slowly() {
    // 208 Hz.
    let (counters, slow) = flown(921_600, 4_800_000);
    assert_eq!((counters.left_out, counters.timeouts, counters.exchanges), (0, 0, 2 * CYCLES));
    assert!(slow >= CYCLES - 1, "{slow}");
}
