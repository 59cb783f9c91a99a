//! Faults of a busy computer are attributed to it, and no others.

use crate::rig;

use messages::{MotorAuthority as A, MotorInput, Request, SLOTS};
use rig::{Rig, config_at};

const PERIOD_NS: u64 = 10_000_000;
const CONTROLLER_A: usize = 0;
const ESTIMATOR_A: usize = SLOTS;

fn following() -> Rig {
    Rig::following([0.1, -0.1, 0.05])
}

fn waits(rig: &mut Rig, seat: usize, cycles: u32) {
    for _ in 0..cycles {
        rig.chain_delay_ns[seat] += PERIOD_NS;
        rig.step();
    }
}

#[test]
fn a_starved_chain_slows_the_robot_down_without_a_stop() {
    for seat in [CONTROLLER_A, ESTIMATOR_A] {
        let mut rig = following();
        let velocity = rig.controller.take();
        waits(&mut rig, seat, 60);
        let during = rig.seen().authority;
        assert_eq!((during.mode, during.faults, during.plan_rate), (A::MODE_FOLLOWING, A::FAULT_COMPUTER, 0.0));
        assert!(rig.last.as_ref().unwrap().sent.is_hold());
        rig.controller = velocity;
        rig.steps(20);
        assert_eq!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, A::FAULT_COMPUTER));
        // The cause is shown for a second.
        rig.steps(90);
        assert_eq!((rig.mode(), rig.faults(), rig.seen().authority.plan_rate), (A::MODE_FOLLOWING, 0, 1.0));
    }
}

#[test]
fn starved_for_longer_the_robot_holds_with_that_fault_and_can_be_resumed() {
    let mut rig = following();
    let velocity = rig.controller.take();
    for _ in 0..150 {
        waits(&mut rig, ESTIMATOR_A, 1);
    }
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_HOLDING, A::FAULT_COMPUTER));
    rig.controller = velocity;
    rig.steps(3);
    rig.demand(Request::Resume);
    rig.steps(60);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, 0));
}

#[test]
fn a_dead_controller_is_not_reported_as_load_even_just_after_load() {
    let mut rig = following();
    rig.controller = None;
    rig.steps(30);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_HOLDING, A::FAULT_COMMAND_LOST));

    let mut rig = following();
    rig.controller = None;
    waits(&mut rig, CONTROLLER_A, 2);
    // A process that waits for a processor shows it in every cycle; this one does not.
    rig.steps(60);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_HOLDING, A::FAULT_COMMAND_LOST));
}

/// A hiccup of the machine takes as long at a higher rate, and so does what follows it.
#[test]
fn load_explains_missing_commands_and_faults_for_as_long_at_every_rate() {
    for rate_hz in [250.0, 500.0] {
        let cycles = |seconds: f64| (seconds * rate_hz).round() as u32;
        let following = || Rig::following_with(config_at(rate_hz), [0.1, -0.1, 0.05]);
        let mut rig = following();
        let velocity = rig.controller.take();
        waits(&mut rig, CONTROLLER_A, cycles(0.04));
        rig.steps(cycles(0.008));
        rig.controller = velocity;
        rig.steps(cycles(0.1));
        assert_eq!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, A::FAULT_COMPUTER), "{rate_hz} Hz");

        for (load_s, pause_s, named) in
            [(0.016, 0.0, 0), (0.04, 0.0, A::FAULT_COMPUTER), (0.04, 0.16, A::FAULT_COMPUTER)]
        {
            let mut rig = following();
            waits(&mut rig, ESTIMATOR_A, cycles(load_s));
            rig.steps(cycles(pause_s));
            rig.unit[1] = MotorInput::UNIT_LOST;
            rig.until(10, |rig| rig.mode() == A::MODE_FAULTED);
            assert_eq!(rig.faults(), A::FAULT_LOST_UNIT | named, "{rate_hz} Hz, load for {load_s} s");
        }
    }
}

/// The waiting slot is not the one in charge.
#[test]
fn a_starved_standby_does_not_change_the_cause() {
    let mut rig = following();
    rig.controller = None;
    waits(&mut rig, CONTROLLER_A + 1, 30);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_HOLDING, A::FAULT_COMMAND_LOST));
}

#[test]
fn a_resynchronising_unit_is_not_lost_while_motor_io_starves() {
    let mut rig = following();
    rig.unit[0] = MotorInput::UNIT_RESYNC;
    rig.estimate_valid = false;
    for _ in 0..80 {
        rig.run_delay_ns += PERIOD_NS;
        rig.step();
    }
    assert_eq!((rig.mode(), rig.faults() & A::FAULT_LOST_UNIT), (A::MODE_FOLLOWING, 0));
    // With a processor, the same silence is due to the unit.
    rig.until(60, |rig| rig.mode() == A::MODE_FAULTED);
    assert_eq!(rig.faults() & A::FAULT_LOST_UNIT, A::FAULT_LOST_UNIT);
}

#[test]
fn a_drive_without_answers_and_simultaneous_load_are_both_reported() {
    let mut rig = following();
    rig.unit[1] = MotorInput::UNIT_LOST;
    rig.until(10, |rig| rig.mode() == A::MODE_FAULTED);
    assert_eq!((rig.faults(), rig.seen().authority.fault_unit[1]), (A::FAULT_LOST_UNIT, 1));

    // The chain has no processor, but motor-io has: nothing excuses the drive.
    let mut rig = following();
    waits(&mut rig, ESTIMATOR_A, 10);
    rig.unit[1] = MotorInput::UNIT_LOST;
    waits(&mut rig, ESTIMATOR_A, 5);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FAULTED, A::FAULT_LOST_UNIT | A::FAULT_COMPUTER));

    // A hiccup of the computer shortly before explains nothing.
    let mut rig = following();
    waits(&mut rig, ESTIMATOR_A, 2);
    rig.unit[1] = MotorInput::UNIT_LOST;
    rig.steps(5);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FAULTED, A::FAULT_LOST_UNIT));

    // A drive that never answers is lost, however busy the computer is.
    let mut rig = following();
    rig.unit[1] = MotorInput::UNIT_LOST;
    for _ in 0..400 {
        rig.run_delay_ns += PERIOD_NS;
        rig.step();
    }
    assert_eq!(rig.faults() & (A::FAULT_LOST_UNIT | A::FAULT_COMPUTER), A::FAULT_LOST_UNIT | A::FAULT_COMPUTER);
}

/// Waiting for a silent drive takes the time that estimator and controller need, but no processor was missing.
#[test]
fn drives_without_answers_that_delay_the_chain_are_not_reported_as_load() {
    let mut rig = following();
    rig.controller = None;
    rig.exchange_ns = 8 * PERIOD_NS / 10;
    rig.unit[..2].fill(MotorInput::UNIT_SILENT);
    for _ in 0..100 {
        rig.step();
        assert_eq!(rig.faults() & A::FAULT_COMPUTER, 0, "mode {}, faults {:#x}", rig.mode(), rig.faults());
    }
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FAULTED, A::FAULT_LOST_UNIT));
}

#[test]
fn tensions_from_late_readings_make_no_cable_slack() {
    let mut rig = following();
    rig.tension_n[2] = 0.1;
    for _ in 0..60 {
        rig.run_delay_ns += PERIOD_NS;
        rig.step();
    }
    assert_eq!((rig.mode(), rig.faults() & A::FAULT_SLACK), (A::MODE_FOLLOWING, 0));
    rig.until(60, |rig| rig.mode() == A::MODE_FAULTED);
    assert_eq!(rig.faults(), A::FAULT_SLACK | A::FAULT_COMPUTER);
    // Without evidence, only the cable is named.
    let mut rig = following();
    rig.tension_n[2] = 0.1;
    rig.until(60, |rig| rig.mode() == A::MODE_FAULTED);
    assert_eq!(rig.faults(), A::FAULT_SLACK);
}

#[test]
fn a_slow_drive_or_one_without_answers_is_not_reported_as_load() {
    let mut rig = following();
    let before = rig.seen().authority;
    // The exchange waits for the unit until half a period after the next cycle is due, so one due time falls into it.
    (rig.unit[1], rig.exchange_ns) = (MotorInput::UNIT_SILENT, 17_000_000);
    rig.step();
    for _ in 0..20 {
        rig.step_after(PERIOD_NS as i64, 7_000_000);
    }
    let after = rig.seen().authority;
    assert_eq!((after.lost_computer, after.faults & A::FAULT_COMPUTER), (before.lost_computer, 0));
    assert!(after.lost_drive > before.lost_drive + 30, "{} periods", after.lost_drive - before.lost_drive);

    // Drives that answer late and leave the chain no time are the cause too.
    let mut rig = following();
    let before = rig.seen().authority;
    rig.controller = None;
    rig.exchange_ns = 9_500_000;
    rig.steps(2);
    let after = rig.seen().authority;
    let lost = [after.lost_computer - before.lost_computer, after.lost_drive - before.lost_drive];
    // The first missing answer is to a cycle that left enough time.
    assert_eq!((lost, after.lost_answer - before.lost_answer), ([0, 1], 1));
}
