//! What units do by themselves: watchdogs, stops, restarts, counters.

use drives::{Command, DriveBus, DriveStatus, Error};
use serial::Transport;

use crate::clockwork::Clockwork;
use crate::family::{Family, WATCHDOG_MS};
use crate::robot::{MS, Robot};
use crate::virtual_units::VirtualUnits;

/// Cycles within which a driver must have read the status of a unit.
const STATUS_CYCLES: usize = 60;

/// A unit is in use only after its watchdog was set and read back.
pub fn a_unit_is_used_only_with_its_watchdog_read_back<F: Family>() {
    let mut robot = Robot::<F>::fresh(1);
    assert_eq!(robot.bus.unit(0).unwrap().watchdog_ms, None, "nothing was read yet");
    for _ in 0..100 {
        let outcome = robot.cycle(Command::HOLD)[0].outcome.clone();
        let watchdog_ms = robot.bus.unit(0).unwrap().watchdog_ms;
        match outcome {
            Ok(()) => {
                assert_eq!(watchdog_ms, Some(WATCHDOG_MS));
                assert_eq!((robot.answers[0].report.setups, robot.answers[0].report.was_alive), (1, false));
                return;
            }
            Err(error) => assert!(
                matches!(error, Error::Preparing { .. } | Error::Resynchronising { .. }),
                "while it is being set up: {error}"
            ),
        }
    }
    panic!("not set up in 100 cycles: {:?}", robot.outcomes());
}

/// A unit that keeps another watchdog time than the one that was set would not stop: it is never used.
pub fn a_unit_that_keeps_another_watchdog_is_refused<F: Family>() {
    for kept_ms in [0, 2 * WATCHDOG_MS] {
        let mut clockwork = Clockwork::new(F::units(1), 1);
        clockwork.units.keep_watchdog(0, kept_ms);
        let mut robot = Robot::<F>::at(clockwork, 1);
        for _ in 0..200 {
            assert!(robot.cycle(Command::HOLD)[0].outcome.is_err(), "a unit with a watchdog of {kept_ms} ms is used");
        }
        let outcome = robot.outcomes().remove(0);
        let refused = Error::WatchdogRefused {
            port: robot.bus.port().clone(),
            unit: robot.bus.unit(0).unwrap().name,
            wanted_ms: WATCHDOG_MS,
            got_ms: kept_ms,
        };
        assert_eq!(outcome, Err(refused));
        assert!(!robot.bus.is_settled() && robot.bus.unit(0).unwrap().watchdog_ms.is_none());
        assert!(!robot.units().drive(0, 0).moves());
    }
}

/// The unit stops its motors when commands cease, not before.
pub fn motors_stop_by_the_watchdog_when_commands_cease<F: Family>() {
    let torque = Robot::<F>::connected(1).bus.capabilities().torque.then_some(Command::Torque(0.5));
    for command in [Some(Command::Velocity(500.0)), torque].into_iter().flatten() {
        stop_by_the_watchdog::<F>(command);
    }
}

fn stop_by_the_watchdog<F: Family>(command: Command) {
    let mut robot = Robot::<F>::connected(F::UNITS);
    robot.cycle(command);
    // Longer than the watchdog in cycles without a gap: it does not trip.
    robot.cycles(50, command);
    robot.assert_drive(F::UNITS - 1, 0, command, "cycles without a gap");
    let last_ns = robot.bus.now_ns();
    let watchdog_ns = u64::from(WATCHDOG_MS) * MS;
    F::pipe(&mut robot.bus).wait_until(last_ns + watchdog_ns - 20 * MS);
    robot.assert_drive(F::UNITS - 1, 0, command, "before the watchdog's time");
    F::pipe(&mut robot.bus).wait_until(last_ns + watchdog_ns + 10 * MS);
    for unit in 0..F::UNITS {
        assert!(!robot.units().drive(unit, 0).moves(), "unit {unit} moves on after its watchdog");
    }
    robot.tick_ns = last_ns + watchdog_ns + 20 * MS;
    if let Command::Torque(_) = command {
        // What pulls waits for a command to hold. A speed may be obeyed: the caller begins from rest after a gap.
        robot.cycle(command);
        assert!(!robot.units().drive(0, 0).moves(), "the unit obeys {command:?} after its watchdog");
    }
    robot.recover();
    robot.cycle(command);
    robot.assert_all_ok("after the watchdog, once commanded to hold");
    robot.assert_drive(F::UNITS - 1, 0, command, "after the watchdog, once commanded to hold");
}

/// The emergency stop at a unit's own input appears in the neutral status and disappears again.
pub fn an_emergency_stop_is_reported_and_stops_the_motors<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    robot.cycle(Command::Velocity(100.0));
    let last = F::UNITS - 1;
    for pressed in [true, false] {
        robot.units().press_stop(last, pressed);
        let reported = (0..STATUS_CYCLES).any(|_| {
            let command = if pressed { Command::Velocity(100.0) } else { Command::HOLD };
            robot.cycle(command)[last].report.status.value.has(DriveStatus::EMERGENCY_STOP) == pressed
        });
        assert!(reported, "pressed {pressed}: {}", robot.answers[last].report.status.value);
        assert!(!robot.units().drive(last, 0).moves());
        for other in &robot.answers[..last] {
            assert!(!other.report.status.value.has(DriveStatus::EMERGENCY_STOP), "the other unit reports it");
        }
    }
    robot.recover();
}

/// A restarted unit is found, counted once, does not move again by itself, and its zero is no motion.
pub fn a_restart_is_counted_and_interlocked<F: Family>() {
    for down_ns in [0, 30 * MS, 400 * MS] {
        let mut robot = Robot::<F>::connected(F::UNITS);
        robot.cycles(20, Command::Velocity(50.0));
        let before = robot.answers[0].report.counts.value;
        robot.units().restart(0, down_ns);
        for _ in 0..150 {
            let answer = &robot.cycle(Command::Velocity(50.0))[0];
            assert!(answer.report.counts.value[0] >= before[0], "the zero of its counter became a motion");
            assert!(answer.outcome.is_err(), "down for {down_ns} ns: it moved again by itself");
        }
        let answer = &robot.answers[0];
        assert_eq!(answer.report.reboots, 1, "down for {down_ns} ns");
        assert!(matches!(answer.outcome, Err(Error::Interlocked { .. })), "{:?}", answer.outcome);
        assert!(robot.answers[1..].iter().all(|other| other.outcome.is_ok()));
        assert!(!robot.units().drive(0, 0).moves());
        assert_eq!(robot.bus.unit(0).unwrap().watchdog_ms, Some(WATCHDOG_MS), "its watchdog is set again");
        robot.cycle(Command::Release);
        robot.cycle(Command::Velocity(50.0));
        robot.assert_all_ok("released once, it moves again");
    }
}

/// A restart is counted once also where the unit does not keep its watchdog any more, before it or after it.
pub fn a_restart_around_a_refused_watchdog_is_counted<F: Family>() {
    let mut robot = Robot::<F>::connected(1);
    robot.units().keep_watchdog(0, 2 * WATCHDOG_MS);
    robot.cycles(100, Command::HOLD);
    robot.units().restart(0, 30 * MS);
    robot.cycles(150, Command::HOLD);
    assert!(matches!(robot.outcomes()[0], Err(Error::WatchdogRefused { .. })), "{:?}", robot.outcomes());
    assert_eq!(robot.answers[0].report.reboots, 1);
    robot.units().keep_watchdog(0, WATCHDOG_MS);
    robot.recover();
    assert_eq!(robot.answers[0].report.reboots, 1, "once, however many attempts its setup takes");
}

/// Counts continue where the counter of the unit wraps, in both directions; one that ends is reported at its end.
pub fn counts_continue_when_the_counter_wraps<F: Family>() {
    if !F::COUNTER_WRAPS {
        return counts_end_where_the_counter_ends::<F>();
    }
    for wrap in [1_i64 << (F::COUNTER_BITS - 1), 1 << F::COUNTER_BITS] {
        let mut clockwork = Clockwork::new(F::units(1), 1);
        clockwork.offset = wrap - 1_500_000;
        let mut robot = Robot::<F>::at(clockwork, 1);
        robot.connect();
        robot.cycle(Command::HOLD);
        // The first count is the unit's own, which has fewer bits.
        let at_ns = robot.answers[0].report.counts.at_ns;
        let shown = robot.clockwork().count_at(at_ns);
        let offset = (robot.answers[0].report.counts.value[0] - shown + (1 << (F::COUNTER_BITS - 1)))
            .div_euclid(1 << F::COUNTER_BITS)
            << F::COUNTER_BITS;
        let offset = offset + robot.clockwork().offset;
        for _ in 0..250 {
            let start_ns = robot.exchange(Some(Command::HOLD));
            robot.assert_all_ok("around the wrap");
            robot.assert_fresh(0, start_ns, offset, "around the wrap");
            robot.spend(start_ns);
        }
        let now_ns = robot.bus.now_ns();
        assert!(robot.clockwork().count_at(now_ns) > wrap, "the counter did not wrap in this test");
        let report = robot.answers[0].report;
        assert_eq!((report.reboots, report.jumps), (0, 0));
    }
}

/// A counter that stays at its largest number is no motor at rest: the unit is not used beyond it.
fn counts_end_where_the_counter_ends<F: Family>() {
    let end = (1_i64 << (F::COUNTER_BITS - 1)) - 1;
    let mut clockwork = Clockwork::new(F::units(1), 1);
    clockwork.offset = end - 1_500_000;
    let offset = clockwork.offset;
    let mut robot = Robot::<F>::at(clockwork, 1);
    robot.connect();
    robot.cycle(Command::HOLD);
    let mut good = 0;
    for _ in 0..250 {
        let start_ns = robot.exchange(Some(Command::HOLD));
        if robot.answers[0].outcome.is_ok() {
            robot.assert_fresh(0, start_ns, offset, "before the end of the counter");
            good += 1;
        }
        robot.spend(start_ns);
    }
    assert!((100..200).contains(&good), "{good} of 250 answers around the end of the counter");
    let outcome = robot.outcomes().remove(0);
    assert!(outcome.is_err(), "the unit is used beyond the end of its counter");
    assert!(robot.answers[0].report.counts.value[0] < end && robot.answers[0].report.reboots == 0);
}

/// A program that starts while units move continues their counts and moves nothing before a stop.
pub fn a_unit_that_moves_at_the_start_is_interlocked_and_counted<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    robot.cycles(5, Command::Velocity(2_000.0));
    let mut robot = robot.restarted_program();
    robot.connect();
    for _ in 0..20 {
        let start_ns = robot.exchange(Some(Command::Velocity(2_000.0)));
        for unit in 0..F::UNITS {
            robot.assert_fresh(unit, start_ns, 0, "units that move at the start");
            let answer = &robot.answers[unit];
            assert!(matches!(answer.outcome, Err(Error::Interlocked { .. })), "{:?}", answer.outcome);
            assert!(answer.report.was_alive && answer.report.reboots == 0 && answer.report.jumps == 0);
        }
        robot.spend(start_ns);
    }
    robot.cycle(Command::HOLD);
    assert_eq!(robot.units().drive(F::UNITS - 1, 0), Command::HOLD);
    robot.cycle(Command::Velocity(2_000.0));
    robot.assert_all_ok("after a stop");
}
