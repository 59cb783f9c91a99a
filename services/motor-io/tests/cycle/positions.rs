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
