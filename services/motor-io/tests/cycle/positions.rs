//! Positions that are set, stored and confirmed.

use crate::rig;

use messages::{MotorAuthority as A, MotorState, Request};
use rig::Rig;
use robot_state::Reason;

#[test]
fn zeroing_at_a_position_gives_unstretched_lengths() {
    let mut rig = Rig::default();
    rig.steps(3);
    rig.demand(Request::ZeroAt { position_m: [4.8, 3.0, 0.3] });
    let state = rig.seen().state;
    assert_eq!(state.position_known, MotorState::POSITION_KNOWN);
    // By hand: straight length, tension from the 3 x 3 system, then (L + Lx) / (1 + T / EA) - Lx.
    let anchors = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
    let rows: Vec<[f64; 3]> = anchors.iter().map(|a| [a[0] - 4.8, a[1] - 3.0, a[2] - 0.3]).collect();
    let length = |r: &[f64; 3]| (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt();
    let det = |c: &[[f64; 3]; 3]| {
        c[0][0] * (c[1][1] * c[2][2] - c[1][2] * c[2][1]) - c[0][1] * (c[1][0] * c[2][2] - c[1][2] * c[2][0])
            + c[0][2] * (c[1][0] * c[2][1] - c[1][1] * c[2][0])
    };
    let unit: Vec<[f64; 3]> = rows.iter().map(|r| r.map(|v| v / length(r))).collect();
    let columns: [[f64; 3]; 3] = std::array::from_fn(|axis| std::array::from_fn(|cable| unit[cable][axis]));
    for cable in 0..3 {
        let mut replaced = columns;
        for (axis, row) in replaced.iter_mut().enumerate() {
            row[cable] = if axis == 2 { 1.2 * 9.80665 } else { 0.0 };
        }
        let tension = det(&replaced) / det(&columns);
        let wanted = (length(&rows[cable]) + 6.0) / (1.0 + tension / 6000.0) - 6.0;
        assert!((state.length_m[cable] - wanted).abs() < 1e-9, "{} {wanted}", state.length_m[cable]);
    }
    for bad in [[4.8, 3.0, 5.0], [50.0, 50.0, 1.0]] {
        let reason = rig.reason(Request::ZeroAt { position_m: bad });
        assert!(matches!(reason, Reason::CannotHang { position_m, .. } if position_m == bad), "{reason:?}");
    }
    let reason = rig.reason(Request::ZeroAt { position_m: [f64::NAN, 0.0, 0.0] });
    assert!(matches!(reason, Reason::NotAPosition { .. }), "{reason:?}");
    let after = rig.seen().state;
    assert_eq!((after.position_known, after.length_m), (MotorState::POSITION_KNOWN, state.length_m));
}

#[test]
fn the_position_from_before_the_cut_has_to_be_confirmed() {
    let mut rig = Rig::default();
    // Unit 1 was running all the time, and its encoder 1 has counted on for 0.1 m; unit 2 has been switched off and
    // starts elsewhere.
    rig.alive[0] = 1;
    let lengths_m = [4.0, 5.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    rig.inbox.first(99, Some(rig::stored(lengths_m, [49_000, -50_000, 900_000, 0, 0, 0, 0, 0])));
    rig.steps(2);
    let state = rig.seen().state;
    assert_eq!(state.position_known, MotorState::POSITION_RESTORED);
    assert!((state.length_m[0] - 4.1).abs() < 1e-9 && (state.length_m[2] - 6.0).abs() < 1e-9);
    assert_eq!(rig.seen().authority.epoch, 99);
    rig.demand(Request::Arm);
    rig.offer(5.0);
    rig.steps(20);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    rig.demand(Request::ConfirmPosition);
    rig.offer(5.0);
    rig.until(10, |rig| rig.mode() == A::MODE_FOLLOWING);
}

/// Drivers continue the counts over a restart of a unit, which itself begins at zero: the next life finds that count.
#[test]
fn a_count_from_before_a_restart_is_no_motion_in_the_next_life() {
    let mut rig = Rig::default();
    rig.steps(2);
    rig.demand(rig::lengths([5.0, 6.0, 7.0]));
    rig.unit[1] = messages::MotorInput::UNIT_REBOOTED;
    rig.step();
    rig.unit[1] = messages::MotorInput::UNIT_OK;
    rig.steps(20);
    let stored = rig.core.position().unwrap();
    assert_eq!((stored.counts[0], stored.counts[2]), (50_000, motor_io::NOT_COUNTED));
    let mut later = Rig::default();
    later.alive = [1; messages::UNITS];
    // Both units were running all the time; the one that did not restart has counted on for 0.1 m.
    later.count_offset = [1_000, 0, 5_000 - 60_000, 0, 0, 0, 0, 0];
    later.inbox.first(99, Some(stored));
    later.steps(2);
    let lengths_m = later.seen().state.length_m;
    assert!((lengths_m[0] - 5.1).abs() < 1e-9 && (lengths_m[1] - 6.0).abs() < 1e-9, "{lengths_m:?}");
    assert!((lengths_m[2] - 7.0).abs() < 1e-9, "{lengths_m:?}");
    // In that life its counts are its own again.
    later.demand(Request::ConfirmPosition);
    assert_eq!(later.core.position().unwrap().counts[2], 5_000);
}

/// A unit counts in 32 bits. What was counted beyond their end, it states from their other end on.
#[test]
fn a_count_that_wrapped_between_two_lives_continues() {
    let mut rig = Rig::default();
    rig.alive = [1; messages::UNITS];
    let end = 1_i64 << 31;
    rig.count_offset[0] = 1_000 - end - 50_000;
    rig.inbox.first(99, Some(rig::stored([5.0; 8], [end - 1_000, -50_000, 60_000, 0, 0, 0, 0, 0])));
    rig.steps(2);
    let length_m = rig.seen().state.length_m[0];
    assert!((length_m - 5.2).abs() < 1e-9, "{length_m}");
}

/// The errors of the robot's model count from where its lengths were set, also in a later life.
#[test]
fn where_the_lengths_were_set_outlives_motor_io() {
    let mut rig = Rig::default();
    rig.steps(2);
    assert!(rig.seen().state.zeroed_m[..3].iter().all(|m| m.is_nan()));
    rig.demand(rig::lengths([5.0, 6.0, 7.0]));
    let stored = rig.core.position().unwrap();
    let mut later = Rig::default();
    later.inbox.first(99, Some(stored));
    later.steps(2);
    let state = later.seen().state;
    assert_eq!(state.position_known, MotorState::POSITION_RESTORED);
    assert_eq!(state.zeroed_m[..3], [5.0, 6.0, 7.0]);
    later.demand(Request::ConfirmPosition);
    assert_eq!(later.core.position().unwrap().zeroed_m[..3], [5.0, 6.0, 7.0]);
    later.demand(rig::lengths([5.5, 6.0, 7.0]));
    assert_eq!(later.seen().state.zeroed_m[..3], [5.5, 6.0, 7.0]);
}
