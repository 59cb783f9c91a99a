//! Classification of a mission's periods: `docs/counters.md`, rule by rule.

use crate::rig;

use messages::{MotorAuthority as A, MotorInput as I, Request, SLOTS};
use rig::Rig;

const VELOCITY: [f64; 3] = [0.1, -0.1, 0.05];

/// Periods lost to computer, drive, resync and answer.
fn lost(rig: &Rig) -> [u64; 4] {
    let A { lost_computer, lost_drive, lost_resync, lost_answer, periods, steered, paused, .. } = rig.seen().authority;
    let lost = [lost_computer, lost_drive, lost_resync, lost_answer];
    assert_eq!(periods, steered + paused + lost.iter().sum::<u64>());
    lost
}

/// One cycle without a command.
fn without_an_answer(rig: &mut Rig) {
    let velocity = rig.controller.take();
    rig.step();
    rig.controller = velocity;
}

#[test]
fn a_flight_is_steered_from_its_first_period_to_its_last() {
    let mut rig = Rig::default().ready();
    rig.offer(2.0);
    rig.until(10, |rig| rig.mode() == A::MODE_FOLLOWING);
    assert_eq!((rig.seen().authority.periods, rig.seen().authority.period), (0, A::PERIOD_NO_MISSION));
    rig.until(600, |rig| rig.mode() == A::MODE_HOLDING && rig.seen().authority.motion == 0);
    rig.steps(50);
    let authority = rig.seen().authority;
    assert_eq!((lost(&rig), authority.paused), ([0; 4], 0));
    assert!((200..500).contains(&authority.steered) && authority.period == A::PERIOD_NO_MISSION);
}

#[test]
fn a_missing_answer_counts_as_the_computers_only_if_the_process_in_charge_had_no_processor() {
    let mut rig = Rig::following(VELOCITY);
    rig.chain_delay_ns = [1; 4];
    rig.step();
    without_an_answer(&mut rig);
    assert_eq!(lost(&rig), [0, 0, 0, 1]);
    rig.step();
    // Three tenths of a period are enough, and a standby is not awaited.
    rig.chain_delay_ns[SLOTS] += 2_900_000;
    rig.chain_delay_ns[1] += 9_000_000;
    without_an_answer(&mut rig);
    assert_eq!(lost(&rig), [0, 0, 0, 2]);
    for seat in [0, SLOTS] {
        let before = lost(&rig);
        rig.step();
        rig.chain_delay_ns[seat] += 3_100_000;
        without_an_answer(&mut rig);
        assert_eq!((lost(&rig)[0], lost(&rig)[3]), (before[0] + 1, before[3]));
    }
    // A wait without effect costs nothing.
    rig.chain_delay_ns[SLOTS] += 9_000_000;
    rig.steps(3);
    assert_eq!(lost(&rig), [2, 0, 0, 2]);
}

#[test]
fn a_hold_counts_by_its_cause() {
    for (delay_ns, stops) in [(0, [0, 0, 0, 1]), (9_000_000, [1, 0, 0, 0])] {
        let mut rig = Rig::following(VELOCITY);
        rig.chain_delay_ns = [1; 4];
        rig.steps(2);
        rig.controller = None;
        let before = rig.seen().authority.periods;
        for _ in 0..400 {
            rig.chain_delay_ns[0] += delay_ns;
            rig.step();
        }
        assert_ne!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, 0));
        let counted = rig.seen().authority.periods - before;
        assert_eq!((counted, lost(&rig)), (400, stops.map(|share: u64| share * 400)));
    }
}

#[test]
fn one_late_answer_that_load_does_not_explain_classifies_the_whole_gap() {
    let mut rig = Rig::following(VELOCITY);
    rig.chain_delay_ns = [1; 4];
    rig.steps(2);
    rig.controller = None;
    rig.step();
    rig.chain_delay_ns[0] += 9_000_000;
    rig.step();
    assert_eq!(lost(&rig), [1, 0, 0, 1]);
    // The robot holds, and the faults name the busy computer.
    rig.chain_delay_ns[0] += 9_000_000;
    rig.steps(300);
    assert_ne!(rig.faults(), 0);
    let [computer, _, _, answer] = lost(&rig);
    assert_eq!((computer, answer), (2, 300));
}

#[test]
fn a_pause_of_any_length_counts_as_paused_in_every_process() {
    let mut rig = Rig::following(VELOCITY);
    rig.demand(Request::Pause);
    rig.until(200, |rig| rig.mode() == A::MODE_HOLDING);
    let before = rig.seen().authority;
    rig.controller = None;
    rig.steps(100);
    rig.step_after(990_000_000, 50_000);
    let after = rig.seen().authority;
    assert_eq!((after.period, after.paused - before.paused), (A::PERIOD_PAUSED, 200));
    assert_eq!((lost(&rig), after.steered), ([0; 4], before.steered));
}

#[test]
fn a_drive_without_answers_is_the_cause_of_resynchronising_its_port() {
    for (outcome, cause) in [(I::UNIT_SILENT, 1), (I::UNIT_RESYNC, 2)] {
        for held_up in [false, true] {
            let mut rig = Rig::following(VELOCITY);
            rig.unit[0] = outcome;
            rig.inbox.input_mut().box_left_out_ns += if held_up { 9_000_000 } else { 0 };
            rig.step();
            // Without it, the wait takes until the next cycle is due.
            rig.step_after(-3_500_000, 50_000);
            rig.step_after(3_500_000, 50_000);
            rig.estimate_valid = false;
            rig.unit[0] = I::UNIT_RESYNC;
            rig.steps(5);
            rig.unit[0] = I::UNIT_OK;
            // Nothing could answer to the cycle before.
            rig.step();
            let mut wanted = [0; 4];
            wanted[if held_up && outcome == I::UNIT_RESYNC { 0 } else { cause }] = 9;
            if held_up && outcome == I::UNIT_SILENT {
                // Without a delay of the computer, a silent drive is the cause.
                wanted = [1, 8, 0, 0];
            }
            assert_eq!(lost(&rig), wanted, "{outcome}, {held_up}");
        }
    }
}

#[test]
fn the_cycle_that_ends_a_mission_and_the_gap_before_it_count() {
    let mut rig = Rig::following(VELOCITY);
    let before = rig.seen().authority;
    assert!(rig.inbox.request(1, &Request::Estop.body()));
    // The begin itself is late by whole periods, which causes another stop.
    rig.step_after(20_000_000_000, 50_000);
    let after = rig.seen().authority;
    assert_eq!((after.mode, after.motion), (A::MODE_EMERGENCY_STOP, 0));
    assert_eq!((after.periods - before.periods, lost(&rig)), (2001, [2001, 0, 0, 0]));
    rig.steps(10);
    assert_eq!((rig.seen().authority.period, rig.seen().authority.periods), (A::PERIOD_NO_MISSION, after.periods));
}
