//! Cycles in order: what is sent, what is asked, what is left out, what configuration is refused.

use drives::{AXES, Capabilities, Command, DriveBus, DriveStatus, Error, InvalidConfig};
use roboclaw::codec::Write;
use roboclaw::unit::{Measured, Target, UnitBus, UnitOptions};
use roboclaw::{Bus, Drive, Status, StatusWidth, UnitConfig, watchdog_tenths};
use serial::{Device, Pipe, Transport, WireQueue};

use super::clockwork::*;

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
    assert_eq!(bus.version(0).unwrap().as_str(), "USB Roboclaw 2x15a v4.2.4");
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
    run.bus.transport_mut().wait_until(tick_ns);
    // The two commands and encoders take about 2.6 ms at this baud.
    run.bus.cycle(&[[Drive::HOLD; 2]; 2], tick_ns + 3 * MS, &mut run.answers);
    assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()));
    assert!(run.bus.counters().left_out > 0);
    assert!(run.bus.transport().now_ns() <= tick_ns + 3 * MS);
}

#[test]
fn where_time_is_always_short_the_status_is_read_all_the_same() {
    let mut run = Run::connected(two_units());
    for _ in 0..96 {
        let tick_ns = run.tick_ns;
        run.bus.transport_mut().wait_until(tick_ns);
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
    let now_ns = run.bus.transport().now_ns();
    run.bus.cycle(&[[Drive::Speed(5); 2]; 2], now_ns, &mut run.answers);
    assert!(matches!(run.answers[0].outcome, Err(Error::TooLate { .. })));
    assert_eq!(run.bus.counters().exchanges, sent);
}

#[test]
fn motors_of_one_unit_can_be_told_different_things() {
    let mut run = Run::connected(two_units());
    let deadline_ns = run.tick_ns + BUDGET_NS;
    run.bus.transport_mut().wait_until(run.tick_ns);
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
        assert_eq!(known.value, DriveStatus(DriveStatus::OVER_CURRENT_2_WARNING), "{width:?}");
        units(&mut run.bus)[0]
            .measure(&Measured { status: Status(Status::MAIN_VOLTAGE_LOW_WARNING), ..Measured::default() });
        for _ in 0..12 {
            run.cycle(Drive::HOLD);
        }
        assert_eq!(run.bus.report(0).unwrap().status.value, DriveStatus(DriveStatus::SUPPLY_LOW_WARNING));
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
        let mut reply = WireQueue::new(0);
        for &byte in packet.iter() {
            bus.transport_mut().device_mut().receive(0, byte, &mut reply);
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

#[test]
fn configurations_that_cannot_be_meant_are_refused() {
    let refuse = |units: Vec<UnitConfig>| {
        let device = Clockwork { bus: UnitBus::new(Vec::new()), told: Vec::new() };
        Bus::new(Pipe::new("test line", BAUD, device), &config(units)).unwrap_err()
    };
    let wrong = |what| Error::Configuration { port: "test line".into(), what };
    assert_eq!(refuse(vec![]), wrong(InvalidConfig::NoUnits));
    for address in [0x7f, 0x88] {
        let misfit = InvalidConfig::Address { given: address, accepted: "128 to 135 (0x80 to 0x87)" };
        assert_eq!(refuse(vec![unit_config(address)]), wrong(misfit));
    }
    assert_eq!(refuse(vec![unit_config(0x80), unit_config(0x80)]), wrong(InvalidConfig::AddressTwice));
    let off = refuse(vec![UnitConfig { watchdog_tenths: 0, ..unit_config(0x80) }]);
    assert!(matches!(off, Error::Configuration { what: InvalidConfig::Watchdog { given_ms: 0, .. }, .. }), "{off}");
    assert_eq!([0.1, 0.3, 25.5].map(watchdog_tenths), [Ok(1), Ok(3), Ok(255)]);
    for (seconds, given_ms) in [(0.0, 0), (0.04, 40), (0.25, 250), (25.6, 25_600), (-1.0, 0), (f64::NAN, 0)] {
        let misfit = watchdog_tenths(seconds).unwrap_err();
        assert!(
            matches!(misfit, InvalidConfig::Watchdog { given_ms: given, .. } if given == given_ms),
            "{seconds}: {misfit}"
        );
    }
}

/// The trait sends what the driver's own interface sends, and refuses what the units do not have.
#[test]
fn neutral_commands_are_the_same_packets() {
    let told = |speed: Option<f64>| {
        let mut run = Run::connected(two_units());
        run.bus.transport_mut().wait_until(run.tick_ns);
        let deadline_ns = run.tick_ns + BUDGET_NS;
        match speed {
            Some(counts_s) => {
                let command = [[Some(Command::Velocity(counts_s)), Some(Command::Release)], [None; AXES]];
                run.bus.exchange(&command, deadline_ns, &mut run.answers);
                run.bus.spend(deadline_ns);
            }
            None => {
                let drives = [[Drive::Speed(-123), Drive::RELEASE], [Drive::Idle; 2]];
                run.bus.cycle(&drives, deadline_ns, &mut run.answers);
            }
        }
        assert!(run.answers.iter().all(|answer| answer.outcome.is_ok()));
        (run.bus.transport().counts(), run.bus.transport().now_ns(), format!("{:?}", units(&mut run.bus)))
    };
    assert_eq!(told(Some(-123.4)), told(None));

    let mut run = Run::connected(two_units());
    let needed = Capabilities { velocity: true, watchdog: true, ..Capabilities::NONE };
    assert_eq!(run.bus.capabilities().first_missing(needed), None);
    let info = run.bus.unit(1).unwrap();
    assert_eq!((&*info.name, info.watchdog_ms), ("unit 0x81", Some(300)));
    assert_eq!(info.firmware.unwrap().as_str(), "USB Roboclaw 2x15a v4.2.4");
    let torque = [[Some(Command::Torque(1.0)), None], [Some(Command::HOLD); AXES]];
    let deadline_ns = run.bus.now_ns() + BUDGET_NS;
    run.bus.exchange(&torque, deadline_ns, &mut run.answers);
    assert!(matches!(run.answers[0].outcome, Err(Error::Unsupported { .. })), "{:?}", run.answers[0]);
    assert_eq!(run.answers[1].outcome, Ok(()));
    assert_eq!(units(&mut run.bus)[0].target(roboclaw::codec::Motor::One), Target::Duty(0.0));
}
