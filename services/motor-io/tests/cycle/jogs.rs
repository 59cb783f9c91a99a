//! Jogs of one cable, and the limits of its length.

use crate::rig;

use messages::{MotorAuthority as A, Request};
use rig::Rig;
use robot_state::Reason;

#[test]
fn jogging_moves_one_cable_the_distance_and_no_other() {
    let mut rig = Rig::default();
    rig.steps(3);
    rig.demand(Request::Arm);
    let before = rig.length_m;
    rig.demand(Request::Jog { cable: 2, distance_m: -0.123 });
    assert_eq!(rig.mode(), A::MODE_JOGGING);
    rig.until(600, |rig| rig.mode() == A::MODE_HOLDING);
    rig.steps(50);
    assert!((rig.length_m[1] - before[1] + 0.123).abs() < 1e-4, "{}", rig.length_m[1] - before[1]);
    assert_eq!((rig.length_m[0], rig.length_m[2]), (before[0], before[2]));
    for number in [0, 4, 255] {
        let reason = rig.reason(Request::Jog { cable: number, distance_m: 0.1 });
        assert_eq!(reason, Reason::NoCable { cable: usize::from(number), cables: 3 });
    }
    assert_eq!(
        rig.reason(Request::Jog { cable: 1, distance_m: 2.5 }),
        Reason::NoDistance { distance_m: 2.5, most_m: 2.0 }
    );
    let reason = rig.reason(Request::Jog { cable: 1, distance_m: f64::NAN });
    assert!(matches!(reason, Reason::NoDistance { distance_m, .. } if distance_m.is_nan()), "{reason:?}");
    rig.demand(Request::Jog { cable: 1, distance_m: 1.0 });
    rig.steps(20);
    rig.demand(Request::Hold);
    rig.until(20, |rig| rig.mode() == A::MODE_HOLDING);
}

#[test]
fn a_jog_has_the_requested_length_after_a_stall_of_the_machine() {
    let mut rig = Rig::default();
    rig.steps(3);
    rig.demand(Request::Arm);
    let before = rig.length_m;
    rig.demand(Request::Jog { cable: 2, distance_m: -0.05 });
    rig.steps(50);
    rig.step_after(150_000_000, 150_000_000);
    rig.until(600, |rig| rig.mode() == A::MODE_HOLDING);
    rig.steps(50);
    assert!((rig.length_m[1] - before[1] + 0.05).abs() < 1e-3, "{}", rig.length_m[1] - before[1]);
}

#[test]
fn a_jog_beyond_the_length_limit_is_rejected_once_lengths_are_known() {
    let mut rig = Rig::default().ready();
    rig.demand(rig::lengths([13.5, 5.0, 5.0]));
    let (accepted, sentence) = rig.ask(Request::Jog { cable: 1, distance_m: 0.8 });
    assert!(!accepted && sentence.contains("14"), "{sentence}");
    rig.demand(Request::Jog { cable: 1, distance_m: -0.2 });
}

#[test]
fn reaching_a_length_limit_stops_every_cable_and_the_way_back_is_accepted() {
    let mut rig = Rig::default().ready();
    rig.demand(rig::lengths([13.5, 5.0, 5.0]));
    rig.offer(100.0);
    rig.controller = Some([0.3, -0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.until(300, |rig| rig.mode() == A::MODE_FAULTED);
    assert_eq!((rig.faults(), rig.seen().authority.fault_cable[0]), (A::FAULT_LENGTH_LIMIT, 1));
    rig.until(30, |rig| rig::speed(rig) == 0.0);
    assert!(rig.seen().state.length_m[0] < 14.0);
    rig.demand(Request::Reset);
    rig.demand(Request::Jog { cable: 1, distance_m: -0.3 });
    rig.until(900, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), 0);
}

#[test]
fn a_jog_up_to_the_length_limit_is_made() {
    let mut rig = Rig::default();
    rig.steps(3);
    rig.demand(rig::lengths([13.9, 5.0, 5.0]));
    rig.demand(Request::Arm);
    let (accepted, sentence) = rig.ask(Request::Jog { cable: 1, distance_m: 0.11 });
    assert!(!accepted && sentence.contains("14"), "{sentence}");
    rig.demand(Request::Jog { cable: 1, distance_m: 0.1 });
    rig.until(600, |rig| rig.mode() == A::MODE_HOLDING);
    rig.steps(30);
    assert_eq!(rig.faults(), 0);
    assert!((rig.seen().state.length_m[0] - 14.0).abs() < 0.002, "{}", rig.seen().state.length_m[0]);
}
