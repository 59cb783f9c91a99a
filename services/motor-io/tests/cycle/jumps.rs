//! Encoder jumps, especially while a unit does not answer. A change that commands explain is no jump; any other is one.

use crate::rig;

use messages::{CABLES, MotorAuthority as A, MotorInput, MotorState};
use proptest::prelude::*;
use rig::Rig;

/// Counts per metre of the first cable.
const COUNTS_PER_M: f64 = 10_000.0;

/// A jump of the first cable while its unit does not answer for this many cycles.
fn jumped(speed_m_s: f64, metres: f64, cycles: u32) -> Rig {
    let mut rig = Rig::following([speed_m_s, -0.1, 0.05]);
    rig.unit[0] = MotorInput::UNIT_RESYNC;
    rig.steps(cycles);
    rig.unit[0] = MotorInput::UNIT_OK;
    rig.count_offset[0] = (metres * COUNTS_PER_M) as i64;
    rig.steps(3);
    rig
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn a_jump_is_found_after_any_time_without_readings(
        speed_m_s in -0.2..0.2f64,
        cycles in 0..12u32,
        more_m in 0.003..0.3f64,
        out in any::<bool>(),
    ) {
        // Possible motion of the cable until the second reading, in either direction: as commanded, none, or 0.23 m/s
        // more.
        let least_m = 0.005 + (speed_m_s.abs() + 0.23) * f64::from(cycles + 2) * rig::PERIOD_S;
        let metres = (least_m + more_m) * if out { 1.0 } else { -1.0 };
        let rig = jumped(speed_m_s, metres, cycles);
        prop_assert_eq!((rig.mode(), rig.faults()), (A::MODE_FAULTED, A::FAULT_ENCODER_JUMP));
        let state = rig.seen().state;
        prop_assert_eq!(state.position_known, MotorState::POSITION_RESTORED);
        // The length continues from the last good reading; only the motion without readings is missing.
        let lacks_m = (state.length_m[0] - rig.length_m[0]).abs();
        prop_assert!(lacks_m <= speed_m_s.abs() * f64::from(cycles + 4) * rig::PERIOD_S + 1e-3, "{lacks_m} m");
    }

    #[test]
    fn commanded_motion_of_a_drive_is_no_jump(
        lag_s in 0.011..0.08f64,
        delay_cycles in 0..6usize,
        events in prop::collection::vec((prop::array::uniform3(-0.8..0.8f64), 1..60u32, 0..6u32, 0..80u32), 1..20),
    ) {
        let mut rig = Rig::default();
        (rig.lag_s, rig.delay_cycles) = (lag_s, delay_cycles);
        let mut rig = rig.ready();
        rig.offer(1000.0);
        for (velocity, cycles, kind, away) in events {
            let mut all = [0.0; CABLES];
            all[..3].copy_from_slice(&velocity);
            rig.controller = Some(all);
            rig.steps(cycles);
            match kind {
                // A port without answers; commands may arrive or not.
                0 | 1 => {
                    rig.unit[0] = if kind == 0 { MotorInput::UNIT_RESYNC } else { MotorInput::UNIT_LOST };
                    rig.deaf = [away % 2 == 0; CABLES];
                    rig.steps(away);
                    rig.unit[0] = MotorInput::UNIT_OK;
                    rig.deaf = [false; CABLES];
                }
                // The computer stands still.
                2 => {
                    rig.step_after(i64::from(away) * 10_000_000, 50_000);
                }
                _ => {}
            }
            rig.step();
            prop_assert_eq!(&rig.seen().state.fresh[..3], &[1, 1, 1], "{}", rig.faults());
            prop_assert_eq!(rig.faults() & A::FAULT_ENCODER_JUMP, 0);
            if rig.mode() == A::MODE_FAULTED {
                rig.steps(100);
                rig.demand(messages::Request::Reset);
            }
            if rig.mode() != A::MODE_FOLLOWING {
                rig.offer(1000.0);
            }
        }
    }
}

#[test]
fn a_released_cable_may_be_moved_by_hand() {
    let mut rig = Rig::default().ready();
    rig.demand(messages::Request::Disarm);
    for _ in 0..50 {
        rig.length_m[1] += 0.009;
        rig.step();
        assert_eq!(rig.seen().state.fresh[1], 1);
    }
    // And its motion meanwhile is no fault once it is held.
    rig.length_m[1] += 0.009;
    rig.demand(messages::Request::Arm);
    rig.length_m[1] += 0.009;
    rig.steps(60);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_HOLDING, 0));
    assert!((rig.seen().state.length_m[1] - rig.length_m[1]).abs() < 2e-4);
}
