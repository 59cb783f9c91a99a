//! Units and computers that are slow.

use roboclaw::driver::WIRE_MARGIN_NS;
use roboclaw::unit::{Unit, UnitBus, UnitOptions};
use roboclaw::{Bus, Drive};
use serial::{Pipe, Transport};
use std::sync::{Arc, Mutex};

use super::clockwork::*;

/// A pipe whose clock advances by a microsecond whenever it is read, as a computer's does.
struct Ticking {
    pipe: Mutex<Pipe<Clockwork>>,
    name: Arc<str>,
}

impl Ticking {
    fn pipe(&mut self) -> &mut Pipe<Clockwork> {
        self.pipe.get_mut().unwrap()
    }
}

impl Transport for Ticking {
    fn name(&self) -> &Arc<str> {
        &self.name
    }
    fn now_ns(&self) -> u64 {
        let mut pipe = self.pipe.lock().unwrap();
        let now_ns = pipe.now_ns() + 1_000;
        pipe.wait_until(now_ns);
        now_ns
    }
    fn wait_until(&mut self, until_ns: u64) {
        self.pipe().wait_until(until_ns);
    }
    fn connection(&mut self) -> Result<u32, serial::Error> {
        self.pipe().connection()
    }
    fn write_all(&mut self, bytes: &[u8], deadline_ns: u64) -> Result<(), serial::Error> {
        self.pipe().write_all(bytes, deadline_ns)
    }
    fn read(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, serial::Error> {
        self.pipe().read(buffer, deadline_ns)
    }
    fn pending(&mut self) -> Result<usize, serial::Error> {
        self.pipe().pending()
    }
    fn clear(&mut self) -> Result<(), serial::Error> {
        self.pipe().clear()
    }
    fn is_on(&mut self, pin: serial::StatusPin) -> Result<bool, serial::Error> {
        self.pipe().is_on(pin)
    }
}

#[test]
fn answers_that_were_slow_once_do_not_keep_a_unit_from_being_set_up() {
    let bus = UnitBus::new([0x80, 0x81].map(|address| Unit::new(UnitOptions::new(address))).into());
    let pipe = Mutex::new(Pipe::new("test line", BAUD, Clockwork { bus, told: vec![Vec::new(); 2] }));
    let units = vec![unit_config(0x80), unit_config(0x81)];
    let mut bus = Bus::new(Ticking { pipe, name: "test line".into() }, &config(units)).unwrap();
    for unit in bus.transport_mut().pipe().device_mut().bus.units_mut() {
        unit.answer_late(3, WIRE_MARGIN_NS - MS);
    }
    let until_ns = 2_000 * MS;
    while !bus.is_settled() {
        // The fleet's steps between two cycles are this short.
        let _ = bus.settle(bus.transport().now_ns() + 5 * MS);
        assert!(bus.transport().now_ns() < until_ns, "never set up");
    }
}

/// A starved computer, or a slow adapter, answers later than the margin every time: it takes longer, but the units come
/// into use.
#[test]
fn answers_that_are_always_late_are_waited_for_longer_until_they_are_not() {
    let mut bus = two_units();
    for unit in units(&mut bus) {
        unit.answer_late(u32::MAX, 3 * WIRE_MARGIN_NS);
    }
    let until_ns = 2_500 * MS;
    while !bus.is_settled() {
        let _ = bus.settle(bus.transport().now_ns() + 5 * MS);
        assert!(bus.transport().now_ns() < until_ns, "never set up: {bus:?}");
    }
    println!("set up after {} ms", bus.transport().now_ns() / MS);
    // A cycle waits no longer than before.
    let mut run =
        Run { answers: bus.blank_answers(), tick_ns: bus.transport().now_ns().next_multiple_of(PERIOD_NS), bus };
    let start_ns = run.tick_ns;
    assert!(run.cycle(Drive::HOLD)[0].outcome.is_err());
    assert!(run.bus.transport().now_ns() <= start_ns + BUDGET_NS + WIRE_MARGIN_NS);
    for unit in units(&mut run.bus) {
        unit.answer_late(0, 0);
    }
    // Cycles have no time for answers that were so slow: between them the fleet continues by itself.
    while run.bus.settle(run.bus.transport().now_ns() + 5 * MS).is_err() {
        assert!(run.bus.transport().now_ns() < start_ns + 1_000 * MS, "not in use again: {:?}", run.bus);
    }
    run.tick_ns = run.bus.transport().now_ns().next_multiple_of(PERIOD_NS);
    run.recover();
    for _ in 0..10 {
        run.cycle(Drive::HOLD);
    }
    // The patience is gone: what costs the most now is a fence that is lost, as with a unit that was never late.
    let silent_until_ns = run.tick_ns + 30 * MS;
    run.bus.transport_mut().silence_until(silent_until_ns);
    assert!(run.cycle(Drive::HOLD)[0].outcome.is_err());
    let cycles = run.recover();
    assert!(cycles <= 7, "{cycles}");
}

/// Behind a slow adapter, commands and counts take nearly the whole cycle: everything else is read all the same, the
/// status of each unit at least every 16 cycles, and no cycle is lost for it.
#[test]
fn where_answers_leave_no_time_everything_is_read_all_the_same() {
    for inline in [false, true] {
        let slow = |address| UnitOptions { turnaround_ns: 1_400_000, ..UnitOptions::new(address) };
        let mut run = Run::connected(bus_of(&[slow(0x80), slow(0x81)]));
        drives::DriveBus::set_inline(&mut run.bus, inline);
        let mut oldest = 0;
        for cycle in 0..400 {
            let start_ns = run.tick_ns;
            run.cycle(Drive::Speed(cycle));
            assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()), "{inline}: {:?}", run.answers);
            assert_eq!(run.tick_ns, start_ns + PERIOD_NS, "{inline}: a cycle was lost");
            let status_ns = run.answers.iter().map(|answer| answer.report.status.at_ns).min().unwrap();
            oldest = oldest.max((start_ns - status_ns) / PERIOD_NS);
        }
        println!("inline {inline}: the status was at most {oldest} cycles old, {:?}", run.bus.counters());
        assert!(oldest <= 16, "{inline}: the status was {oldest} cycles old");
        for answer in &run.answers {
            let report = &answer.report;
            for (read_ns, bound) in [
                (report.currents_a.at_ns, 32),
                (report.duties.at_ns, 64),
                (report.supply_v.at_ns, 200),
                (report.temperature_c.at_ns, 200),
            ] {
                let age = (run.tick_ns - read_ns) / PERIOD_NS;
                assert!(age <= bound, "{inline}: {age} cycles, {report:?}");
            }
        }
    }
}

/// Share of the cycles of eight seconds at this rate that miss their deadline, and the largest age of status and duties
/// after the first two seconds, s. So many units answer after so long; commands and counts fit just into the part of a
/// period that motor-io leaves the drives.
fn at_rate(rate_hz: u64, units: u8, turnaround_ns: u64, inline: bool) -> (f64, [f64; 2]) {
    let period_ns = 1_000 * MS / rate_hz;
    let (budget_ns, cycles) = (period_ns / 100 * 85, 8 * rate_hz);
    let unit = |index| UnitOptions { turnaround_ns, ..UnitOptions::new(0x80 + index) };
    let mut run = Run::connected(bus_of(&(0..units).map(unit).collect::<Vec<_>>()));
    drives::DriveBus::set_inline(&mut run.bus, inline);
    let began_ns = run.bus.transport().now_ns().next_multiple_of(period_ns);
    let (mut late, mut oldest_s) = (0, [0.0_f64; 2]);
    for cycle in 0..cycles {
        let tick_ns = began_ns + cycle * period_ns;
        run.bus.transport_mut().wait_until(tick_ns);
        let drive = [Drive::Speed(cycle as i32); 2];
        run.bus.drive(&vec![drive; usize::from(units)], tick_ns + budget_ns, &mut run.answers);
        let missed = run.answers.iter().any(|answer| answer.outcome.is_err());
        late += u64::from(missed || run.bus.transport().now_ns() > tick_ns + budget_ns);
        run.bus.spend(tick_ns + budget_ns);
        if cycle < cycles / 4 {
            continue;
        }
        for answer in &run.answers {
            let read_ns = [answer.report.status.at_ns, answer.report.duties.at_ns];
            for (oldest_s, read_ns) in oldest_s.iter_mut().zip(read_ns) {
                *oldest_s = oldest_s.max(tick_ns.saturating_sub(read_ns) as f64 * 1e-9);
            }
        }
    }
    (late as f64 / cycles as f64, oldest_s)
}

/// Where a reading that does not fit costs a later cycle its deadline, it is rare; where it costs none, it is not.
#[test]
fn a_reading_that_costs_a_cycle_is_rare() {
    let us = |from: u64, to: u64| (from..=to).step_by(50).chain([to]);
    for (rate_hz, units, turnarounds_us, oldest_s, rarely) in [
        (200, 1, us(1_150, 1_580), 0.25, 16.0),
        (100, 1, us(3_000, 3_700), 0.25, 8.0),
        (100, 2, us(1_200, 1_580), 0.41, 8.0),
    ] {
        for (turnaround_us, inline) in turnarounds_us.flat_map(|us| [(us, false), (us, true)]) {
            let (late, [status_s, duties_s]) = at_rate(rate_hz, units, turnaround_us * 1_000, inline);
            let case = format!("{rate_hz} Hz, {units} units, inline {inline}, answers after {turnaround_us} µs");
            println!("{case}: {:.1} % late, status at most {status_s:.3} s old, duties {duties_s:.3} s", 100.0 * late);
            // A reading that outlasts its period by more than the next one has to spare delays two.
            assert!(late <= 2.0 / rarely, "{case}: {late}");
            assert!(status_s < oldest_s && duties_s < oldest_s, "{case}: {status_s} {duties_s}");
        }
    }
}
