//! Commands, readings and deadlines on a wire without faults.

use drives::{Capabilities, Command, DriveBus, Error, UnitReport};
use serial::{Faults, Transport};

use crate::clockwork::CURRENTS_A;
use crate::family::Family;
use crate::robot::{BUDGET_NS, MS, PERIOD_NS, Robot};
use crate::virtual_units::VirtualUnits;

/// Cycles within which a driver reads every slow value of two units at least once.
const ROUND: usize = 100;
/// Cycles without time, and those within which status and currents are read in them all the same.
const CYCLES_WITHOUT_TIME: u64 = 400;
const STATUS_CYCLES: u64 = 60;
const CURRENT_CYCLES: u64 = 200;

/// Each command arrives at every motor, and a unit without a command keeps the last one.
pub fn commands_reach_the_motors<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    let slowest = Command::Velocity(-F::SPEED_STEP_COUNTS_S);
    for command in [Command::Velocity(1000.0), slowest, Command::HOLD, Command::Release] {
        robot.cycle(command);
        robot.assert_all_ok("a command");
        for (unit, motor) in (0..F::UNITS).flat_map(|unit| (0..F::MOTORS).map(move |motor| (unit, motor))) {
            robot.assert_drive(unit, motor, command, "a command");
        }
    }
    robot.cycle(Command::Velocity(800.0));
    let start_ns = robot.exchange(None);
    robot.assert_fresh(F::UNITS - 1, start_ns, 0, "no command");
    robot.assert_all_ok("no command");
    robot.spend(start_ns);
    robot.assert_drive(F::UNITS - 1, 0, Command::Velocity(800.0), "a cycle without a command");
    if F::UNITS == 1 {
        return;
    }
    // A unit that the commands do not mention is only read.
    let commands = &robot.all(Some(Command::HOLD))[..1];
    let deadline_ns = robot.bus.now_ns() + BUDGET_NS;
    robot.bus.exchange(commands, deadline_ns, &mut robot.answers);
    robot.assert_all_ok("a command for one of two units");
    robot.assert_drive(0, 0, Command::HOLD, "a command for one of two units");
    robot.assert_drive(1, 0, Command::Velocity(800.0), "a command for the other unit");
}

/// A command that the capabilities leave out is refused, and moves nothing.
pub fn a_command_that_the_family_lacks_is_refused<F: Family>() {
    let mut robot = Robot::<F>::connected(1);
    let offered = robot.bus.capabilities();
    for (command, offers) in [(Command::Velocity(500.0), offered.velocity), (Command::Torque(1.5), offered.torque)] {
        robot.cycle(Command::HOLD);
        let outcome = robot.cycle(command)[0].outcome.clone();
        if offers {
            assert_eq!(outcome, Ok(()), "{command:?}");
            robot.assert_drive(0, 0, command, "an offered command");
        } else {
            let drive = robot.units().drive(0, 0);
            assert!(matches!(outcome, Err(Error::Unsupported { .. })), "{command:?}: {outcome:?}");
            assert!(!drive.moves(), "{command:?} is not offered, but the motor got {drive:?}");
        }
    }
}

/// NaN and infinity are no speeds: a motor gets only finite ones.
pub fn a_number_that_is_no_speed_moves_nothing<F: Family>() {
    for speed in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX] {
        let mut robot = Robot::<F>::connected(1);
        robot.cycle(Command::Velocity(speed));
        match robot.units().drive(0, 0) {
            Command::Velocity(given) => {
                assert!(given.is_finite() && (!speed.is_nan() || given == 0.0), "{speed} became {given}");
            }
            Command::Release => {}
            Command::Torque(_) => panic!("{speed} became a torque"),
        }
        robot.recover();
    }
}

/// Counts are of this cycle, and everything that the capabilities promise is read with its time.
pub fn readings_are_fresh_and_complete<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    for _ in 0..ROUND {
        let start_ns = robot.exchange(Some(Command::Velocity(40.0)));
        robot.assert_all_ok("a quiet wire");
        (0..F::UNITS).for_each(|unit| robot.assert_fresh(unit, start_ns, 0, "a quiet wire"));
        robot.spend(start_ns);
    }
    let now_ns = robot.bus.now_ns();
    robot.exchange(Some(Command::HOLD));
    let offered = robot.bus.capabilities();
    for answer in &robot.answers {
        let report = &answer.report;
        assert_eq!(known(report, offered), offered, "readings and capabilities differ: {report:?}");
        assert!(report.status.is_known() && report.status.value.errors().0 == 0, "{}", report.status.value);
        if offered.currents {
            let wanted = if F::MOTORS == 2 { CURRENTS_A } else { [CURRENTS_A[0], 0.0] };
            let got = report.currents_a.value;
            assert!(got.iter().zip(wanted).all(|(got, wanted)| (got - wanted).abs() < 0.006), "{got:?} A");
        }
        assert!(report.counts.at_ns > now_ns.saturating_sub(1) && report.setups == 1 && report.reboots == 0);
    }
}

/// A second encoder is read in the same moment as the first one; after a restart it counts from a new origin, and says
/// so.
pub fn a_second_encoder_is_read_with_the_first<F: Family>() {
    if !F::SECOND {
        return;
    }
    let mut robot = Robot::<F>::connected(F::UNITS);
    assert!(robot.bus.capabilities().second_encoder);
    for _ in 0..ROUND {
        let before: Vec<UnitReport> = robot.answers.iter().map(|answer| answer.report).collect();
        robot.cycle(Command::Velocity(40.0));
        before.into_iter().enumerate().for_each(|(unit, before)| robot.assert_second(unit, before, "a quiet wire"));
    }
    let before = robot.answers[0].report.second.breaks;
    robot.units().restart(0, 30 * MS);
    while robot.cycle(Command::HOLD)[0].report.reboots == 0 {}
    robot.recover();
    assert_ne!(robot.answers[0].report.second.breaks, before, "a restart, and its second encoder continued");
}

/// The offered readings as far as they are known; commands and watchdog as offered.
fn known(report: &UnitReport, offered: Capabilities) -> Capabilities {
    Capabilities {
        speeds: report.speeds_counts_s.is_known(),
        currents: report.currents_a.is_known(),
        duties: report.duties.is_known(),
        supply: report.supply_v.is_known(),
        ..offered
    }
}

/// A call that begins after its deadline sends nothing. Every call ends in time ([`Robot::exchange`] checks that).
pub fn nothing_is_sent_after_the_deadline<F: Family>() {
    let mut robot = Robot::<F>::connected(1);
    let (now_ns, sent) = (robot.bus.now_ns(), F::pipe(&mut robot.bus).counts().written);
    let commands = robot.all(Some(Command::Velocity(9.0)));
    robot.bus.exchange(&commands, now_ns, &mut robot.answers);
    assert!(matches!(robot.answers[0].outcome, Err(Error::TooLate { .. })), "{:?}", robot.outcomes());
    assert_eq!(F::pipe(&mut robot.bus).counts().written, sent, "bytes were written after the deadline");
    assert!(!robot.units().drive(0, 0).moves());
    robot.spend(now_ns.saturating_sub(BUDGET_NS));
    assert_eq!(robot.recover(), 1, "a cycle without time costs nothing more");
}

/// Where the answers of one unit come so late that the time is over, the other units are not commanded any more: the
/// caller may have decided otherwise meanwhile.
pub fn a_late_unit_leaves_no_late_command<F: Family>() {
    if F::UNITS == 1 {
        return;
    }
    let mut robot = Robot::<F>::connected(F::UNITS);
    F::pipe(&mut robot.bus).set_faults(Faults { late: 1.0, late_ns: BUDGET_NS + MS, ..Faults::default() }, 0);
    let start_ns = robot.exchange(Some(Command::Velocity(500.0)));
    F::pipe(&mut robot.bus).set_faults(Faults::default(), 0);
    // What was sent arrives.
    let now_ns = robot.bus.now_ns();
    F::pipe(&mut robot.bus).wait_until(now_ns + MS);
    if let Some(from_ns) = robot.clockwork().moves_from_ns {
        let late_ns = from_ns.saturating_sub(start_ns + BUDGET_NS);
        assert_eq!(late_ns, 0, "commanded after the deadline");
    }
    robot.tick_ns = (now_ns + MS).next_multiple_of(PERIOD_NS);
    robot.recover();
}

/// A status may have a stop button, so it is read also where no cycle leaves time for it; currents may wait longer. No
/// cycle is lost for it while the rest of the period suffices.
pub fn a_status_is_read_where_no_cycle_leaves_time<F: Family>() {
    let mut robot = Robot::<F>::connected(F::UNITS);
    for _ in 0..CYCLES_WITHOUT_TIME {
        robot.exchange(Some(Command::Velocity(40.0)));
        robot.assert_all_ok("no time is left");
        robot.spend_a_microsecond();
    }
    let now_ns = robot.bus.now_ns();
    let offered = robot.bus.capabilities();
    for answer in &robot.answers {
        let cycles = |at_ns: u64| (now_ns - at_ns) / PERIOD_NS;
        let (status, currents) = (cycles(answer.report.status.at_ns), cycles(answer.report.currents_a.at_ns));
        println!("status {status} cycles old, currents {currents}");
        assert!(status <= STATUS_CYCLES, "the status is {status} cycles old");
        assert!(!offered.currents || currents <= CURRENT_CYCLES, "the currents are {currents} cycles old");
    }
}
