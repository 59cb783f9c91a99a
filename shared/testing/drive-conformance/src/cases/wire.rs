//! Noise, late, swapped and lost answers, silence, and a port that is unplugged.

use drives::{Command, DriveBus, Error};
use serial::Faults;

use crate::clockwork::Clockwork;
use crate::family::{Family, WATCHDOG_MS};
use crate::robot::{BUDGET_NS, MS, PERIOD_NS, Robot};
use crate::virtual_units::VirtualUnits;

/// Cycles of a run with faults.
const CYCLES: u32 = 1500;
/// Cycles within which a bus recovers after the last fault.
const RECOVERY: usize = 120;

/// Cycles under faults in each of which the command differs: no sample is stale, and no command counts as accepted
/// that the unit did not get. At least a third of the cycles succeed. Ends when the wire is quiet and the bus well.
fn endure<F: Family>(case: &str, begin: impl FnOnce(&mut Robot<F>), end: impl FnOnce(&mut Robot<F>)) {
    let mut robot = Robot::<F>::connected(F::UNITS);
    begin(&mut robot);
    endure_cycles(case, robot, CYCLES, speeds::<F>, end);
}

/// Another speed in each cycle.
fn speeds<F: Family>(cycle: u32) -> Command {
    let steps = (cycle - 1) % F::SPEED_STEPS + 1;
    Command::Velocity(f64::from(steps) * F::SPEED_STEP_COUNTS_S)
}

/// Ten cycles each of torques, standstill and speeds. Values come again, as a unit may have them from before.
fn torques_and_speeds<F: Family>(cycle: u32) -> Command {
    match cycle / 10 % 3 {
        0 => Command::Torque(0.1 * f64::from(cycle % 7)),
        1 => Command::HOLD,
        _ => speeds::<F>(cycle % 3 + 1),
    }
}

fn endure_cycles<F: Family>(
    case: &str,
    mut robot: Robot<F>,
    cycles: u32,
    commands: impl Fn(u32) -> Command,
    end: impl FnOnce(&mut Robot<F>),
) {
    let offset = robot.clockwork().offset;
    let mut good = 0;
    let mut last = vec![i64::MIN; F::UNITS];
    let mut accepted = robot.answers.clone();
    for cycle in 1..=cycles {
        let command = commands(cycle);
        let start_ns = robot.exchange(Some(command));
        for (unit, last) in last.iter_mut().enumerate() {
            let answer = robot.answers[unit].clone();
            assert!(answer.report.counts.value[0] >= *last, "{case}: cycle {cycle}: the counts of unit {unit} go back");
            *last = answer.report.counts.value[0];
            if answer.outcome.is_ok() {
                good += 1;
                robot.assert_fresh(unit, start_ns, offset, case);
                // It counts as commanded, so it was.
                robot.assert_drive(unit, 0, command, case);
                let before = std::mem::replace(&mut accepted[unit], answer.clone()).report;
                if F::SECOND && answer.report.second.breaks == before.second.breaks {
                    robot.assert_second(unit, before, case);
                }
            }
        }
        robot.spend(start_ns);
    }
    let all = cycles * F::UNITS as u32;
    println!("{case}: {good} of {all} answers good, {:?}", robot.bus.counters());
    assert!(good > all / 3, "{case}: only {good} of {all} answers");
    assert!(robot.answers.iter().all(|answer| answer.report.reboots == 0), "{case}: a restart that was none");
    end(&mut robot);
    let cycles = robot.recover();
    assert!(cycles <= RECOVERY, "{case}: {cycles} cycles to recover");
}

fn endure_faults<F: Family>(mixes: &[(&str, Faults)]) {
    for (seed, &(case, faults)) in mixes.iter().enumerate() {
        let quiet = |robot: &mut Robot<F>| F::pipe(&mut robot.bus).set_faults(Faults::default(), 0);
        endure::<F>(case, |robot| F::pipe(&mut robot.bus).set_faults(faults, seed as u64), quiet);
    }
}

/// Noise between cycles is discarded before anything is asked, also where it does not end.
pub fn bytes_that_answer_nothing_are_discarded<F: Family>() {
    for noise in [&[0xFF][..], &[0x00, 0x12], &[b'\n'; 40]] {
        let mut robot = Robot::<F>::connected(F::UNITS);
        F::pipe(&mut robot.bus).inject(noise);
        let start_ns = robot.exchange(Some(Command::HOLD));
        for unit in 0..F::UNITS {
            if robot.answers[unit].outcome.is_ok() {
                robot.assert_fresh(unit, start_ns, 0, "noise");
            }
        }
        robot.spend(start_ns);
        let cycles = robot.recover();
        assert!(cycles <= 5, "{cycles} cycles to recover from {} bytes", noise.len());
        assert!(robot.bus.counters().stray_bytes > 0);
    }
    let mut robot = Robot::<F>::connected(F::UNITS);
    for _ in 0..20 {
        F::pipe(&mut robot.bus).inject(&[0x55; 200]);
        // Returns in time, which `exchange` checks.
        robot.cycle(Command::Velocity(1.0));
    }
    robot.recover();
}

/// One lost answer costs at most its cycle and a few more, and no second setup.
pub fn a_lost_answer_costs_few_cycles<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    let until_ns = robot.tick_ns + MS;
    F::pipe(&mut robot.bus).silence_until(until_ns);
    let outcome = robot.cycle(Command::HOLD)[0].outcome.clone();
    match outcome {
        // Asked again within the cycle.
        Ok(()) => robot.assert_fresh(0, until_ns - MS, 0, "asked again"),
        Err(Error::Unanswered { .. }) => assert!(F::INLINE, "the answer was not waited for"),
        Err(error) => assert!(error.is_on_the_wire(), "{error:?}"),
    }
    let cycles = robot.recover();
    assert!(cycles <= 5, "{cycles} cycles");
    assert_eq!((robot.answers[0].report.setups, robot.answers[0].report.reboots), (1, 0));
    endure_faults::<F>(&[("1 % of the bytes lost", Faults { drop: 0.01, ..Faults::default() })]);
}

/// An answer that arrives after its cycle answers nothing.
pub fn a_late_answer_never_answers_a_later_question<F: Family>() {
    let late = |late, late_ns| Faults { late, late_ns, ..Faults::default() };
    // One late answer leaves no further questions behind it.
    let mut robot = Robot::<F>::connected(F::UNITS);
    let mut asked_in_ten_cycles = || {
        let before = robot.bus.counters().exchanges;
        robot.cycles(10, Command::HOLD);
        let asked = robot.bus.counters().exchanges - before;
        F::pipe(&mut robot.bus).set_faults(late(1.0, 13 * MS), 0);
        robot.cycle(Command::HOLD);
        F::pipe(&mut robot.bus).set_faults(Faults::default(), 0);
        robot.cycles(5, Command::HOLD);
        asked
    };
    let (quiet, after) = (asked_in_ten_cycles(), asked_in_ten_cycles());
    assert!(after <= quiet + 1, "{after} questions in ten cycles after a late answer, {quiet} before");
    endure_faults::<F>(&[
        ("1 % late by 13 ms", late(0.01, 13 * MS)),
        ("2 % late by 35 ms", late(0.02, 35 * MS)),
        ("1 % late by 90 ms", late(0.01, 90 * MS)),
        ("5 % late by a quarter of the answer time", late(0.05, F::ANSWER_NS / 4)),
        ("2 % late just beyond the answer time", late(0.02, F::ANSWER_NS + MS / 10)),
    ]);
}

/// An answer that arrives after the next one answers neither question.
pub fn swapped_answers_are_told_apart<F: Family>() {
    let begin = |robot: &mut Robot<F>| robot.clockwork().swap = 0.01;
    endure::<F>("1 % swapped", begin, |robot| {
        robot.clockwork().swap = 0.0;
        assert!(robot.clockwork().swapped > 10, "too few answers were swapped");
    });
}

/// Changed, doubled and inserted bytes make no command count as accepted and no sample as new.
pub fn byte_errors_neither_acknowledge_nor_age<F: Family>() {
    let mixed = Faults { corrupt: 0.002, drop: 0.001, duplicate: 0.001, insert: 0.001, late: 0.01, late_ns: 20 * MS };
    endure_faults::<F>(&[
        ("1 % of the bytes changed", Faults { corrupt: 0.01, ..Faults::default() }),
        ("1 % of the bytes doubled", Faults { duplicate: 0.01, ..Faults::default() }),
        ("1 % of the bytes inserted", Faults { insert: 0.01, ..Faults::default() }),
        ("everything at once", mixed),
    ]);
}

/// A command of another kind, or an older one with the same value, is never taken for the one that was sent. Families
/// without torque have nothing to confuse.
pub fn torques_and_speeds_are_told_apart<F: Family>() {
    let faults = [
        ("torques and speeds, 0.5 % of the bytes changed", Faults { corrupt: 0.005, ..Faults::default() }),
        ("torques and speeds, 0.5 % of the bytes lost", Faults { drop: 0.005, ..Faults::default() }),
        ("torques and speeds, 2 % late by 13 ms", Faults { late: 0.02, late_ns: 13 * MS, ..Faults::default() }),
    ];
    for (seed, (case, faults)) in faults.into_iter().enumerate() {
        let mut robot = Robot::<F>::connected(F::UNITS);
        if !robot.bus.capabilities().torque {
            return;
        }
        F::pipe(&mut robot.bus).set_faults(faults, seed as u64);
        endure_cycles(case, robot, CYCLES, torques_and_speeds::<F>, |robot| {
            F::pipe(&mut robot.bus).set_faults(Faults::default(), 0);
        });
    }
}

/// Two hours at 100 Hz, with the faults that a long flight has now and then. The counter passes its ends where it
/// wraps; where it does not, each hour begins far below zero.
pub fn two_hours_of_traffic<F: Family>() {
    const HOUR: u32 = 360_000;
    let rare = Faults { corrupt: 2e-5, drop: 1e-5, duplicate: 1e-5, insert: 1e-5, late: 1e-4, late_ns: 20 * MS };
    for hour in 1..=2 {
        let mut clockwork = Clockwork::new(F::units(F::UNITS), F::UNITS);
        clockwork.offset = if F::COUNTER_WRAPS { 0 } else { -1_800_000_000 };
        let mut robot = Robot::<F>::at(clockwork, F::UNITS);
        robot.connect();
        robot.cycle(Command::HOLD);
        F::pipe(&mut robot.bus).set_faults(rare, hour);
        endure_cycles(&format!("hour {hour}"), robot, HOUR, speeds::<F>, |robot| {
            F::pipe(&mut robot.bus).set_faults(Faults::default(), 0);
        });
    }
}

/// A unit that does not answer is named, is asked rarely, and delays the others little.
pub fn a_silent_unit_costs_the_others_little<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    robot.units().mute(0, true);
    let (mut good, mut longest, mut gap) = (0, 0, 0);
    let mut asked = 0;
    for cycle in 0..300 {
        let answers = robot.cycle(Command::Velocity(3.0));
        assert!(answers[0].outcome.is_err());
        let well = answers[1..].iter().all(|other| other.outcome.is_ok());
        good += u64::from(well);
        gap = if well { 0 } else { gap + 1 };
        longest = longest.max(gap);
        if cycle == 100 {
            asked = robot.bus.counters().timeouts;
        }
    }
    let outcome = &robot.answers[0].outcome;
    assert!(outcome.as_ref().is_err_and(Error::is_silence), "{outcome:?}");
    println!("the other unit: {good} of 300 cycles good, longest gap {longest}");
    assert!(good > 250, "only {good} of 300 cycles of the other unit");
    assert!(longest * PERIOD_NS < u64::from(WATCHDOG_MS) * MS / 2, "a gap of {longest} cycles");
    // Two seconds: a question every half second, each perhaps repeated once.
    let asked = robot.bus.counters().timeouts - asked;
    assert!((1..=10).contains(&asked), "asked {asked} times in two seconds");
    robot.units().mute(0, false);
    let cycles = robot.recover();
    assert!(cycles < RECOVERY, "{cycles} cycles to come back");
    assert_eq!(robot.answers[0].report.reboots, 0);
}

/// A unit that hears and is not heard stops within its watchdog's time: it obeys, or gets no command. That its driver
/// still asks must not keep it going. It does not move again by itself.
pub fn a_unit_that_is_not_heard_stops_in_its_watchdogs_time<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    let heard_ns = robot.tick_ns;
    robot.cycle(Command::Velocity(800.0));
    (0..F::UNITS).for_each(|unit| robot.units().mute(unit, true));
    robot.cycles(5, Command::Velocity(800.0));
    // The caller has noticed.
    let (mut stopped_ns, end_ns) = (None, robot.tick_ns + 1_000 * MS);
    while robot.tick_ns < end_ns {
        robot.cycle(Command::HOLD);
        let moves = (0..F::UNITS).any(|unit| robot.units().drive(unit, 0).moves());
        stopped_ns = if moves { None } else { stopped_ns.or(Some(robot.bus.now_ns())) };
    }
    let after_ns = stopped_ns.expect("it never stopped") - heard_ns;
    println!("stopped {} ms after the last answer", after_ns / MS);
    // Looked at once in a cycle.
    assert!(after_ns <= u64::from(WATCHDOG_MS) * MS + 2 * PERIOD_NS, "it ran on for {after_ns} ns");
    (0..F::UNITS).for_each(|unit| robot.units().mute(unit, false));
    for _ in 0..RECOVERY {
        let all = robot.cycle(Command::Velocity(800.0)).iter().all(|answer| answer.outcome.is_err());
        let moves = (0..F::UNITS).any(|unit| robot.units().drive(unit, 0).moves());
        assert!(all && !moves, "it moved again by itself: {:?}", robot.outcomes());
    }
    robot.recover();
    robot.cycle(Command::Velocity(800.0));
    robot.assert_all_ok("commanded to hold once");
}

/// A unit that stood because it was not heard moves again only after a command to hold, however long it was not heard:
/// its caller commands motion all the time, and does not know that it stood.
pub fn a_unit_that_stood_unheard_moves_only_after_a_command_to_hold<F: Family>() {
    for (muted, cycles) in [1, F::UNITS].into_iter().flat_map(|muted| (1..=60).map(move |cycles| (muted, cycles))) {
        let mut robot = Robot::<F>::connected(F::UNITS);
        robot.cycle(Command::Velocity(800.0));
        let heard_again = robot.tick_ns + cycles * PERIOD_NS;
        (0..muted).for_each(|unit| robot.units().mute(unit, true));
        let mut stood = vec![false; muted];
        let end_ns = heard_again + RECOVERY as u64 * PERIOD_NS;
        while robot.tick_ns < end_ns {
            if robot.tick_ns >= heard_again {
                (0..muted).for_each(|unit| robot.units().mute(unit, false));
            }
            robot.cycle(Command::Velocity(800.0));
            for (unit, stood) in stood.iter_mut().enumerate() {
                let moves = robot.units().drive(unit, 0).moves();
                assert!(!(*stood && moves), "unit {unit}, not heard for {cycles} cycles, moves again by itself");
                *stood |= !moves;
            }
        }
        robot.recover();
        robot.cycle(Command::Velocity(800.0));
        robot.assert_all_ok("commanded to hold once");
    }
}

/// A port that is gone costs no time; when it is back its units wait for a stop, and their counts have continued.
pub fn an_unplugged_port_is_lost_at_once_and_comes_back_interlocked<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    robot.cycle(Command::Velocity(10.0));
    F::pipe(&mut robot.bus).unplug();
    let start_ns = robot.exchange(Some(Command::Velocity(10.0)));
    assert!(robot.answers.iter().all(|answer| answer.outcome.as_ref().is_err_and(Error::is_lost)));
    assert_eq!(robot.bus.now_ns(), start_ns, "a port that is gone is waited for");
    robot.spend(start_ns);
    for _ in 0..20 {
        assert!(robot.cycle(Command::Velocity(10.0)).iter().all(|answer| answer.outcome.is_err()));
        assert!(robot.bus.settle(robot.bus.now_ns() + BUDGET_NS).is_err_and(|error| error.is_lost()));
    }
    assert!(!robot.bus.is_settled());
    F::pipe(&mut robot.bus).plug();
    robot.cycles(40, Command::Velocity(10.0));
    for unit in 0..F::UNITS {
        let answer = &robot.answers[unit];
        assert!(matches!(answer.outcome, Err(Error::Interlocked { .. })), "{answer:?}");
        assert_eq!((answer.report.reboots, answer.report.setups), (0, 2));
        robot.assert_fresh(unit, robot.tick_ns - 2 * PERIOD_NS, 0, "plugged in again");
    }
    assert_eq!(robot.bus.counters().connections, 2, "connections are counted");
    robot.cycle(Command::HOLD);
    robot.cycle(Command::Velocity(10.0));
    robot.assert_all_ok("after a stop");
}

/// A unit that restarts while its port is gone is found when it is back.
pub fn a_restart_behind_an_unplugged_port_is_counted<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    robot.cycles(5, Command::Velocity(10.0));
    let before = robot.answers[0].report.counts.value[0];
    F::pipe(&mut robot.bus).unplug();
    robot.cycles(5, Command::HOLD);
    robot.units().restart(0, 0);
    F::pipe(&mut robot.bus).plug();
    robot.recover();
    let reboots: Vec<u32> = robot.answers.iter().map(|answer| answer.report.reboots).collect();
    assert!(reboots[0] == 1 && reboots[1..].iter().all(|&other| other == 0), "{reboots:?}");
    assert!(robot.answers[0].report.counts.value[0] >= before, "the zero of its counter became a motion");
}
