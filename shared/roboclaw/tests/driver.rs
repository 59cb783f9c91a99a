//! The driver against virtual units over a pipe with a virtual clock: in order, under faults, and after them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use roboclaw::codec::{Version, Write};
use roboclaw::driver::WIRE_MARGIN_NS;
use roboclaw::unit::{Measured, Target, Unit, UnitLine, UnitOptions};
use roboclaw::{Bus, BusConfig, Drive, Error, Status, StatusWidth, UnitAnswer, UnitConfig};
use serial::{Device, Faults, Paced, Pipe, Transport};
use std::sync::{Arc, Mutex};

const MS: u64 = 1_000_000;
const PERIOD_NS: u64 = 10 * MS;
const BUDGET_NS: u64 = 9 * MS;
const BAUD: u32 = 230_400;

/// Units whose encoders show the time: motor 1 counts microseconds, motor 2 counts them backwards. So every sample tells by itself
/// when it was taken, and a stale one cannot hide.
#[derive(Debug)]
struct Clockwork {
    line: UnitLine,
    /// Speeds each unit was told, in the order in which it was told them.
    told: Vec<Vec<f64>>,
}

impl Clockwork {
    fn show(&mut self, now_ns: u64) {
        for (index, unit) in self.line.units_mut().iter_mut().enumerate() {
            let micros = (now_ns / 1000) as i64;
            let measured = Measured { counts: [micros, -micros], currents_a: [1.5, -0.25], ..*unit.measured() };
            unit.measure(&measured);
            if let Target::Speed(speed) = unit.target(roboclaw::codec::Motor::One)
                && self.told[index].last() != Some(&speed)
            {
                self.told[index].push(speed);
            }
        }
    }
}

impl Device for Clockwork {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut Paced) {
        self.line.receive(now_ns, byte, reply);
        self.show(now_ns);
    }

    fn advance(&mut self, now_ns: u64) {
        self.show(now_ns);
        self.line.advance(now_ns);
    }
}

type TestBus = Bus<Pipe<Clockwork>>;

fn unit_config(address: u8) -> UnitConfig {
    // 1 MHz of microseconds is what the clockwork shows.
    UnitConfig { address, watchdog_tenths: 3, fastest_counts_s: 2_000_000 }
}

fn config(units: Vec<UnitConfig>) -> BusConfig {
    BusConfig { baud: BAUD, margin_ns: WIRE_MARGIN_NS, units, stop_pin: None }
}

fn bus_of(options: &[UnitOptions]) -> TestBus {
    let line = UnitLine::new(options.iter().map(|options| Unit::new(*options)).collect());
    let pipe = Pipe::new("test line", BAUD, Clockwork { line, told: vec![Vec::new(); options.len()] });
    let units = options.iter().map(|options| unit_config(options.address)).collect();
    Bus::new(pipe, &config(units)).unwrap()
}

fn two_units() -> TestBus {
    bus_of(&[UnitOptions::new(0x80), UnitOptions::new(0x81)])
}

fn units(bus: &mut TestBus) -> &mut [Unit] {
    bus.line_mut().device_mut().line.units_mut()
}

/// A bus being driven at the control rate.
struct Run {
    bus: TestBus,
    answers: Vec<UnitAnswer>,
    tick_ns: u64,
}

impl Run {
    fn connected(mut bus: TestBus) -> Run {
        let until_ns = bus.line().now_ns() + 5_000 * MS;
        while bus.settle(until_ns).is_err() {
            assert!(bus.line().now_ns() < until_ns, "never set up");
        }
        let tick_ns = bus.line().now_ns().next_multiple_of(PERIOD_NS);
        let answers = bus.blank_answers();
        let mut run = Run { bus, answers, tick_ns };
        run.cycle(Drive::HOLD);
        run
    }

    fn cycle(&mut self, drive: Drive) -> &[UnitAnswer] {
        self.bus.line_mut().wait_until(self.tick_ns);
        let start_ns = self.bus.line().now_ns();
        let count = self.bus.unit_count();
        self.bus.cycle(&vec![[drive; 2]; count], start_ns + BUDGET_NS, &mut self.answers);
        self.tick_ns = (self.bus.line().now_ns() + 1).next_multiple_of(PERIOD_NS);
        &self.answers
    }

    /// Cycles until all units are well; how many it took.
    fn recover(&mut self) -> usize {
        for cycles in 1..500 {
            if self.cycle(Drive::HOLD).iter().all(|answer| answer.outcome.is_ok()) {
                return cycles;
            }
        }
        panic!("did not recover: {:?}", self.answers);
    }
}

/// How far the clockwork's time in a sample is from the time at which the driver says it asked, ns.
fn age_ns(answer: &UnitAnswer, zero_us: i64) -> i64 {
    let counts = answer.report.counts;
    assert_eq!(counts.value[0], -counts.value[1], "two motors of one sample disagree");
    (counts.value[0] + zero_us) * 1000 - counts.at_ns as i64
}

#[test]
fn connects_and_sets_up_each_unit() {
    let mut bus = two_units();
    assert!(!bus.is_settled());
    bus.settle(200 * MS).unwrap();
    assert!(bus.is_settled());
    for unit in 0..2 {
        let report = *bus.report(unit).unwrap();
        assert_eq!((report.setups, report.reboots), (1, 0));
        assert_eq!(report.supply_v.value, 12.6);
        assert!(report.status.is_known() && report.counts.is_known());
    }
    assert_eq!(bus.identities().next().unwrap().version.unwrap().as_str(), "USB Roboclaw 2x15a v4.2.4");
    // The watchdog is what was asked for, by the unit's own word.
    for unit in units(&mut bus) {
        assert!(format!("{unit:?}").contains("watchdog_tenths: 3"));
    }
}

#[test]
fn a_cycle_fits_its_period_and_asks_for_everything_in_turn() {
    let mut run = Run::connected(two_units());
    let before = run.bus.counters();
    for cycle in 0..48 {
        for answer in run.cycle(Drive::Speed(cycle)) {
            assert_eq!(answer.outcome, Ok(()));
            // Sampled when the question of two bytes had arrived.
            let age_ns = age_ns(answer, 0);
            assert!((-1000..=200_000).contains(&age_ns), "{age_ns}");
            assert_eq!(answer.report.currents_a.value, [1.5, -0.25]);
        }
    }
    let counters = run.bus.counters();
    assert_eq!(
        (counters.left_out, counters.resyncs, counters.stray_bytes),
        (before.left_out, before.resyncs, before.stray_bytes)
    );
    // Command, encoders and currents for each unit, and one more: seven exchanges.
    assert_eq!(counters.exchanges - before.exchanges, 48 * 7);
    for unit in 0..2 {
        let report = run.bus.report(unit).unwrap();
        for (what, at_ns) in [
            ("status", report.status.at_ns),
            ("duty", report.duties.at_ns),
            ("supply", report.supply_v.at_ns),
            ("temperature", report.temperature_c.at_ns),
        ] {
            assert!(run.tick_ns - at_ns < 48 * PERIOD_NS, "{what} was not asked for");
        }
    }
}

#[test]
fn what_can_wait_is_left_out_when_there_is_no_time() {
    let mut run = Run::connected(two_units());
    let tick_ns = run.tick_ns;
    run.bus.line_mut().wait_until(tick_ns);
    // The two commands and encoders take about 2.6 ms at this baud.
    run.bus.cycle(&[[Drive::HOLD; 2]; 2], tick_ns + 3 * MS, &mut run.answers);
    assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()));
    assert!(run.bus.counters().left_out > 0);
    assert!(run.bus.line().now_ns() <= tick_ns + 3 * MS);
}

#[test]
fn where_time_is_always_short_the_status_is_read_all_the_same() {
    let mut run = Run::connected(two_units());
    for _ in 0..96 {
        let tick_ns = run.tick_ns;
        run.bus.line_mut().wait_until(tick_ns);
        let before = run.bus.counters().left_out;
        // Behind commands and encoders there is time for one question or two.
        run.bus.cycle(&[[Drive::HOLD; 2]; 2], tick_ns + 4 * MS, &mut run.answers);
        assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()));
        assert!(run.bus.counters().left_out > before, "there was time for everything");
        run.tick_ns += PERIOD_NS;
    }
    for unit in 0..2 {
        let report = run.bus.report(unit).unwrap();
        for (what, at_ns) in [("status", report.status.at_ns), ("currents", report.currents_a.at_ns)] {
            assert!(run.tick_ns - at_ns < 48 * PERIOD_NS, "{what} was not asked for");
        }
    }
}

#[test]
fn a_late_cycle_sends_nothing() {
    let mut run = Run::connected(two_units());
    let sent = run.bus.counters().exchanges;
    let now_ns = run.bus.line().now_ns();
    run.bus.cycle(&[[Drive::Speed(5); 2]; 2], now_ns, &mut run.answers);
    assert!(matches!(run.answers[0].outcome, Err(Error::TooLate { .. })));
    assert_eq!(run.bus.counters().exchanges, sent);
}

#[test]
fn motors_of_one_unit_can_be_told_different_things() {
    let mut run = Run::connected(two_units());
    let deadline_ns = run.tick_ns + BUDGET_NS;
    run.bus.line_mut().wait_until(run.tick_ns);
    let drives = [[Drive::Speed(100), Drive::RELEASE], [Drive::Idle, Drive::Duty(-16_384)]];
    run.bus.cycle(&drives, deadline_ns, &mut run.answers);
    assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()));
    use roboclaw::codec::Motor::{One, Two};
    let units = units(&mut run.bus);
    assert_eq!((units[0].target(One), units[0].target(Two)), (Target::Speed(100.0), Target::Duty(0.0)));
    assert_eq!((units[1].target(One), units[1].target(Two)), (Target::Speed(0.0), Target::Duty(-16_384.0 / 32_767.0)));
}

#[test]
fn old_and_new_firmware_report_the_same_conditions() {
    for width in [StatusWidth::Narrow, StatusWidth::Wide] {
        let mut bus = bus_of(&[UnitOptions { width, ..UnitOptions::new(0x87) }]);
        units(&mut bus)[0].measure(&Measured { status: Status(Status::OVER_CURRENT_2), ..Measured::default() });
        let mut run = Run::connected(bus);
        let known = run.bus.report(0).unwrap().status;
        assert_eq!(known.value, Status(Status::OVER_CURRENT_2), "{width:?}");
        units(&mut run.bus)[0]
            .measure(&Measured { status: Status(Status::MAIN_VOLTAGE_LOW_WARNING), ..Measured::default() });
        for _ in 0..12 {
            run.cycle(Drive::HOLD);
        }
        assert_eq!(run.bus.report(0).unwrap().status.value, Status(Status::MAIN_VOLTAGE_LOW_WARNING));
        assert_eq!(run.bus.counters().resyncs, 0);
    }
}

#[test]
fn encoders_go_on_over_the_wrap_of_their_32_bits() {
    let mut bus = bus_of(&[UnitOptions::new(0x80)]);
    // Just below the wrap, by the unit's own register.
    for (motor, count) in
        [(roboclaw::codec::Motor::One, i32::MAX - 20_000), (roboclaw::codec::Motor::Two, i32::MIN + 20_000)]
    {
        let packet = Write::SetEncoder(motor, count).encode(0x80);
        let mut reply = Paced::new(0);
        for &byte in packet.iter() {
            bus.line_mut().device_mut().receive(0, byte, &mut reply);
        }
    }
    let mut run = Run::connected(bus);
    let first = run.cycle(Drive::HOLD)[0].report.counts;
    for _ in 0..10 {
        assert_eq!(run.cycle(Drive::HOLD)[0].outcome, Ok(()));
    }
    let last = run.answers[0].report.counts;
    let elapsed_us = (last.at_ns - first.at_ns) as i64 / 1000;
    assert!(((last.value[0] - first.value[0]) - elapsed_us).abs() < 200);
    assert!(((first.value[1] - last.value[1]) - elapsed_us).abs() < 200);
    assert!(last.value[0] > i64::from(i32::MAX));
    assert_eq!(run.bus.report(0).unwrap().jumps, 0);
}

/// The heart of the matter: whatever happens to the bytes, no sample is stale and no command counts as given that was not.
#[test]
fn no_stale_sample_and_no_false_acknowledgement_under_faults() {
    let mixes = [
        ("late answers", Faults { late: 0.02, late_ns: 35 * MS, ..Faults::default() }),
        (
            "few errors",
            Faults {
                corrupt: 0.001,
                drop: 0.0005,
                duplicate: 0.0005,
                late: 0.005,
                late_ns: 35 * MS,
                ..Faults::default()
            },
        ),
        (
            "many errors",
            Faults {
                corrupt: 0.005,
                drop: 0.0025,
                duplicate: 0.0025,
                late: 0.01,
                late_ns: 20 * MS,
                ..Faults::default()
            },
        ),
        ("late just after the deadline", Faults { late: 0.05, late_ns: 13 * MS, ..Faults::default() }),
        ("very late", Faults { late: 0.02, late_ns: 90 * MS, ..Faults::default() }),
    ];
    for (seed, (name, faults)) in mixes.into_iter().enumerate() {
        let mut run = Run::connected(two_units());
        run.bus.line_mut().set_faults(faults, seed as u64);
        let mut good = 0;
        let cycles = 1500;
        let mut last_counts = [i64::MIN; 2];
        for cycle in 1..=cycles {
            let start_ns = run.tick_ns;
            run.cycle(Drive::Speed(cycle));
            for (unit, last) in last_counts.iter_mut().enumerate() {
                let answer = &run.answers[unit];
                assert!(answer.report.counts.value[0] >= *last, "{name}: time went back");
                *last = answer.report.counts.value[0];
                if answer.outcome.is_ok() {
                    good += 1;
                    assert!(answer.report.counts.at_ns >= start_ns, "{name}: a sample of an earlier cycle");
                    let age_ns = age_ns(answer, 0);
                    assert!((-1000..=300_000).contains(&age_ns), "{name}: cycle {cycle}, unit {unit}: {age_ns} ns off");
                    let told = run.bus.line().device().told[unit].last().copied();
                    assert_eq!(
                        told,
                        Some(f64::from(cycle)),
                        "{name}: cycle {cycle}, unit {unit} counts as told, but was not"
                    );
                }
            }
        }
        let counters = run.bus.counters();
        println!("{name}: {good}/{} good, {counters:?}", 2 * cycles);
        assert!(counters.resyncs > 10, "{name}: the faults did not come: {counters:?}");
        assert!(good > cycles / 3, "{name}: only {good} of {}", 2 * cycles);
        assert_eq!(run.bus.report(0).unwrap().reboots + run.bus.report(1).unwrap().reboots, 0, "{name}");
        // When the faults end, so does the trouble.
        run.bus.line_mut().set_faults(Faults::default(), 0);
        assert!(run.recover() < 120, "{name}");
    }
}

#[test]
fn one_lost_answer_costs_a_few_cycles_and_no_more() {
    let mut run = Run::connected(two_units());
    let silent_until_ns = run.tick_ns + MS;
    run.bus.line_mut().silence_until(silent_until_ns);
    assert!(matches!(run.cycle(Drive::HOLD)[0].outcome, Err(Error::NoAnswer { .. })));
    let cycles = run.recover();
    assert!(cycles <= 4, "{cycles}");
    assert_eq!(run.bus.counters().resyncs, 1);
    assert_eq!(run.bus.report(0).unwrap().setups, 1);
}

#[test]
fn a_retry_happens_within_the_cycle_when_there_is_time() {
    let mut run = Run::connected(two_units());
    run.bus.line_mut().wait_until(run.tick_ns);
    let start_ns = run.bus.line().now_ns();
    run.bus.line_mut().silence_until(start_ns + MS);
    run.bus.cycle(&[[Drive::Speed(7); 2]; 2], start_ns + 100 * MS, &mut run.answers);
    assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()), "{:?}", run.answers);
    assert_eq!(run.bus.counters().resyncs, 1);
}

#[test]
fn noise_between_cycles_is_noticed_before_anything_is_sent() {
    for noise in [&[0xFF][..], &[0x00, 0x12], &[0xFF; 40]] {
        let mut run = Run::connected(two_units());
        run.bus.line_mut().inject(noise);
        let commands = units(&mut run.bus)[0].commands();
        assert!(matches!(run.cycle(Drive::HOLD)[0].outcome, Err(Error::Stray { .. })));
        assert_eq!(units(&mut run.bus)[0].commands(), commands);
        assert_eq!(run.bus.counters().stray_bytes, noise.len() as u64);
        assert!(run.recover() <= 4);
    }
}

#[test]
fn endless_noise_holds_nobody_up() {
    let mut run = Run::connected(two_units());
    for _ in 0..20 {
        run.bus.line_mut().inject(&[0x55; 200]);
        let start_ns = run.tick_ns;
        let answers = run.cycle(Drive::Speed(1));
        assert!(answers.iter().all(|answer| answer.outcome.is_err()));
        assert!(run.bus.line().now_ns() <= start_ns + BUDGET_NS + WIRE_MARGIN_NS);
    }
    assert!(run.recover() <= 4);
}

#[test]
fn a_silent_unit_costs_the_others_little() {
    let mut run = Run::connected(two_units());
    units(&mut run.bus)[0].mute_until(u64::MAX);
    let (mut good, mut longest_gap, mut gap) = (0, 0, 0);
    for _ in 0..300 {
        let answers = run.cycle(Drive::Speed(3));
        assert!(answers[0].outcome.is_err());
        if answers[1].outcome.is_ok() {
            (good, gap) = (good + 1, 0);
        } else {
            gap += 1;
            longest_gap = longest_gap.max(gap);
        }
    }
    println!("the other unit: {good} of 300 cycles good, longest gap {longest_gap}");
    assert!(matches!(run.answers[0].outcome, Err(Error::Silent { address: 0x80, .. } | Error::Resynchronising { .. })));
    assert!(good > 250, "{good}");
    // Its watchdog of 300 ms never had to help.
    assert!(longest_gap <= 10, "{longest_gap}");
    assert_eq!(units(&mut run.bus)[1].watchdog_trips(), 0);
    units(&mut run.bus)[0].mute_until(0);
    assert!(run.recover() < 80);
    assert_eq!(run.bus.report(0).unwrap().reboots, 0);
}

#[test]
fn a_restarted_unit_is_found_out_and_its_encoders_are_not_a_movement() {
    for down_ms in [0, 30, 400] {
        let mut run = Run::connected(two_units());
        for _ in 0..20 {
            run.cycle(Drive::Speed(50));
        }
        let before = run.answers[0].report.counts.value;
        units(&mut run.bus)[0].reboot(down_ms * MS);
        let mut moved_after = false;
        for _ in 0..150 {
            let answer = &run.cycle(Drive::Speed(50))[0];
            let counts = answer.report.counts.value[0];
            assert!(counts >= before[0], "the encoders' zero was taken for a movement");
            moved_after |= answer.outcome.is_ok();
        }
        let answer = &run.answers[0];
        assert_eq!(answer.report.reboots, 1, "down for {down_ms} ms");
        assert!(!moved_after, "it moved again by itself");
        assert!(matches!(answer.outcome, Err(Error::Interlocked { .. })), "{:?}", answer.outcome);
        assert_eq!(run.answers[1].outcome, Ok(()));
        // Told to stand still once, it can be used again.
        run.cycle(Drive::RELEASE);
        assert_eq!(run.cycle(Drive::Speed(50))[0].outcome, Ok(()));
        assert!(format!("{:?}", units(&mut run.bus)[0]).contains("watchdog_tenths: 3"));
    }
}

#[test]
fn an_encoder_that_jumps_is_refused_once_and_counted_when_it_stays() {
    let mut run = Run::connected(two_units());
    run.cycle(Drive::HOLD);
    let before = run.answers[0].report.counts.value[0];
    let packet = Write::SetEncoder(roboclaw::codec::Motor::Two, 1_000_000_000).encode(0x80);
    let now_ns = run.bus.line().now_ns();
    let mut reply = Paced::new(0);
    for &byte in packet.iter() {
        run.bus.line_mut().device_mut().receive(now_ns, byte, &mut reply);
    }
    let answer = &run.cycle(Drive::HOLD)[0];
    assert!(matches!(answer.outcome, Err(Error::EncoderJump { motor: roboclaw::codec::Motor::Two, .. })), "{answer:?}");
    assert_eq!(answer.report.counts.value[0], before, "a refused sample changes nothing");
    let answer = &run.cycle(Drive::HOLD)[0];
    assert_eq!((answer.outcome.clone(), answer.report.jumps, answer.report.reboots), (Ok(()), 1, 0));
}

#[test]
fn unplugged_it_fails_at_once_and_replugged_it_waits_to_be_told_to_hold() {
    let mut run = Run::connected(two_units());
    run.cycle(Drive::Speed(10));
    run.bus.line_mut().unplug();
    let start_ns = run.tick_ns;
    assert!(run.cycle(Drive::Speed(10)).iter().all(|answer| answer.outcome.as_ref().is_err_and(Error::is_lost)));
    assert_eq!(run.bus.line().now_ns(), start_ns, "a lost line costs no time");
    for _ in 0..20 {
        run.cycle(Drive::Speed(10));
    }
    run.bus.line_mut().plug();
    for _ in 0..30 {
        run.cycle(Drive::Speed(10));
    }
    for answer in &run.answers {
        assert!(matches!(answer.outcome, Err(Error::Interlocked { .. })), "{answer:?}");
        // The encoders went on meanwhile, and the line's position with them.
        assert!((-1000..=300_000).contains(&age_ns(answer, 0)));
        assert_eq!((answer.report.reboots, answer.report.setups), (0, 2));
    }
    run.cycle(Drive::HOLD);
    assert!(run.cycle(Drive::Speed(10)).iter().all(|answer| answer.outcome.is_ok()));
}

#[test]
fn a_unit_that_stops_hearing_stops_its_motors() {
    let mut run = Run::connected(two_units());
    run.cycle(Drive::Speed(1000));
    let last_ns = run.bus.line().now_ns();
    run.bus.line_mut().wait_until(last_ns + 290 * MS);
    assert_eq!(units(&mut run.bus)[0].target(roboclaw::codec::Motor::One), Target::Speed(1000.0));
    run.bus.line_mut().wait_until(last_ns + 301 * MS);
    assert_eq!(units(&mut run.bus)[0].target(roboclaw::codec::Motor::One), Target::Duty(0.0));
    assert_eq!(units(&mut run.bus)[0].watchdog_trips(), 1);
}

#[test]
fn a_missing_unit_is_silent_and_the_present_one_works() {
    let mut bus = bus_of(&[UnitOptions { version: Version::new("other"), ..UnitOptions::new(0x80) }]);
    let config = config(vec![unit_config(0x82), unit_config(0x80)]);
    let pipe = std::mem::replace(
        bus.line_mut(),
        Pipe::new("spare", BAUD, Clockwork { line: UnitLine::new(Vec::new()), told: Vec::new() }),
    );
    let mut bus = Bus::new(pipe, &config).unwrap();
    let mut answers = bus.blank_answers();
    for tick in 1..40 {
        bus.line_mut().wait_until(tick * PERIOD_NS);
        bus.cycle(&[[Drive::HOLD; 2]; 2], tick * PERIOD_NS + BUDGET_NS, &mut answers);
    }
    assert!(matches!(answers[0].outcome, Err(Error::Silent { address: 0x82, .. })), "{answers:?}");
    assert_eq!(answers[1].outcome, Ok(()));
    assert_eq!(bus.identities().nth(1).unwrap().version.unwrap().as_str(), "other");
}

#[test]
fn configurations_that_cannot_be_meant_are_refused_in_words() {
    let refuse = |units: Vec<UnitConfig>| {
        let device = Clockwork { line: UnitLine::new(Vec::new()), told: Vec::new() };
        Bus::new(Pipe::new("test line", BAUD, device), &config(units)).unwrap_err().to_string()
    };
    assert_eq!(refuse(vec![]), "test line: no units on this line; name at least one address");
    assert!(refuse(vec![unit_config(0x7f)]).contains("between 0x80 and 0x87"));
    assert!(refuse(vec![unit_config(0x80), unit_config(0x80)]).contains("same address"));
    assert!(refuse(vec![UnitConfig { watchdog_tenths: 0, ..unit_config(0x80) }]).contains("watchdog of 0"));
}

/// A pipe whose clock goes on by a microsecond whenever it is read, as a computer's does.
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
    let line = UnitLine::new([0x80, 0x81].map(|address| Unit::new(UnitOptions::new(address))).into());
    let pipe = Mutex::new(Pipe::new("test line", BAUD, Clockwork { line, told: vec![Vec::new(); 2] }));
    let units = vec![unit_config(0x80), unit_config(0x81)];
    let mut bus = Bus::new(Ticking { pipe, name: "test line".into() }, &config(units)).unwrap();
    for unit in bus.line_mut().pipe().device_mut().line.units_mut() {
        unit.answer_late(3, WIRE_MARGIN_NS - MS);
    }
    let until_ns = 2_000 * MS;
    while !bus.is_settled() {
        // The fleet's steps between two cycles are this short.
        let _ = bus.settle(bus.line().now_ns() + 5 * MS);
        assert!(bus.line().now_ns() < until_ns, "never set up");
    }
}

/// A starved computer, or a slow adapter, answers later than the margin every time: it takes longer, but the units come into use.
#[test]
fn answers_that_are_always_late_are_waited_for_longer_until_they_are_not() {
    let mut bus = two_units();
    for unit in units(&mut bus) {
        unit.answer_late(u32::MAX, 3 * WIRE_MARGIN_NS);
    }
    let until_ns = 2_500 * MS;
    while !bus.is_settled() {
        let _ = bus.settle(bus.line().now_ns() + 5 * MS);
        assert!(bus.line().now_ns() < until_ns, "never set up: {bus:?}");
    }
    println!("set up after {} ms", bus.line().now_ns() / MS);
    // A cycle waits no longer than before.
    let mut run = Run { answers: bus.blank_answers(), tick_ns: bus.line().now_ns().next_multiple_of(PERIOD_NS), bus };
    let start_ns = run.tick_ns;
    assert!(run.cycle(Drive::HOLD)[0].outcome.is_err());
    assert!(run.bus.line().now_ns() <= start_ns + BUDGET_NS + WIRE_MARGIN_NS);
    for unit in units(&mut run.bus) {
        unit.answer_late(0, 0);
    }
    // Cycles have no time for answers that were so slow: between them the fleet goes on by itself.
    while run.bus.settle(run.bus.line().now_ns() + 5 * MS).is_err() {
        assert!(run.bus.line().now_ns() < start_ns + 1_000 * MS, "not in use again: {:?}", run.bus);
    }
    run.tick_ns = run.bus.line().now_ns().next_multiple_of(PERIOD_NS);
    run.recover();
    for _ in 0..10 {
        run.cycle(Drive::HOLD);
    }
    // The patience is gone: what costs the most now is a fence that is lost, as with a unit that was never late.
    let silent_until_ns = run.tick_ns + 30 * MS;
    run.bus.line_mut().silence_until(silent_until_ns);
    assert!(run.cycle(Drive::HOLD)[0].outcome.is_err());
    let cycles = run.recover();
    assert!(cycles <= 7, "{cycles}");
}

#[test]
fn an_open_stop_input_says_stop_and_one_that_cannot_be_read_too() {
    use roboclaw::{StatusPin, StopInput};
    let line = UnitLine::new(vec![Unit::new(UnitOptions::new(0x80))]);
    let pipe = Pipe::new("test line", BAUD, Clockwork { line, told: vec![Vec::new()] });
    let config = BusConfig { stop_pin: Some(StatusPin::Dsr), ..config(vec![unit_config(0x80)]) };
    let mut run = Run::connected(Bus::new(pipe, &config).unwrap());
    assert!(matches!(run.bus.stop(), StopInput::Unreadable(_)) && run.bus.stop().says_stop());
    for (on, wanted) in [(true, StopInput::Released), (false, StopInput::Pressed), (true, StopInput::Released)] {
        run.bus.line_mut().set_pins(on);
        assert_eq!(run.cycle(Drive::HOLD)[0].outcome, Ok(()));
        assert_eq!((run.bus.stop(), run.bus.stop().says_stop()), (&wanted, !on), "within the cycle");
    }
    // While a unit is silent it is looked at all the same.
    units(&mut run.bus)[0].mute_until(u64::MAX);
    for _ in 0..30 {
        run.cycle(Drive::HOLD);
    }
    run.bus.line_mut().set_pins(false);
    run.cycle(Drive::HOLD);
    assert_eq!(run.bus.stop(), &StopInput::Pressed);
    run.bus.line_mut().unplug();
    run.cycle(Drive::HOLD);
    assert!(run.bus.stop().says_stop(), "nobody knows where the button is");
}
