//! Stalls of the computer, gaps between cycles, and requests that are late.

use crate::rig;

use messages::{MotorAuthority as A, Request};
use rig::Rig;
use robot_state::Reason;

#[test]
fn a_stall_counts_as_the_computers_and_the_plan_catches_up_with_the_drives() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    let before = rig.seen().authority;
    rig.step_after(190_000_000, 190_000_000);
    let after = rig.seen().authority;
    // Its command was fresh. The lost periods are those that never ran, and the next cycle counts them.
    assert_eq!((after.mode, after.period, after.unsteered()), (A::MODE_FOLLOWING, A::PERIOD_STEERED, 0));
    rig.step();
    let then = rig.seen().authority;
    assert_eq!((then.lost_computer, then.unsteered(), then.periods), (19, 19, before.periods + 21));
    assert!((after.plan_time_s - before.plan_time_s - 0.2).abs() < 0.02, "{}", after.plan_time_s - before.plan_time_s);
}

#[test]
fn a_command_missing_after_a_stall_of_the_machine_counts_as_the_computers() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    let before = rig.seen().authority;
    let velocity = rig.controller.take();
    rig.step_after(30_000_000, 30_000_000);
    let after = rig.seen().authority;
    assert_eq!((after.mode, after.lost_answer, after.lost_computer), (A::MODE_FOLLOWING, 0, before.lost_computer + 1));
    // Back on schedule at once: the chain had no time to answer since the state was published.
    rig.step_after(-5_000_000, 50_000);
    let after = rig.seen().authority;
    // Two periods never ran.
    assert_eq!((after.mode, after.lost_answer, after.lost_computer), (A::MODE_FOLLOWING, 0, before.lost_computer + 4));
    // From here on it has the time.
    rig.controller = velocity;
    rig.step();
    rig.controller = None;
    rig.step();
    assert_eq!((rig.seen().authority.lost_answer, rig.seen().authority.lost_computer), (1, before.lost_computer + 4));
}

#[test]
fn the_plan_does_not_catch_up_after_a_stall_that_includes_the_drives() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    let before = rig.seen().authority;
    let frozen = rig.length_m;
    rig.step_after(190_000_000, 190_000_000);
    // The drives' motion is removed, as in a virtual motor box that stood still too.
    let mut rig = {
        rig.length_m = frozen;
        rig
    };
    rig.steps(3);
    assert!(rig.seen().authority.plan_time_s - before.plan_time_s < 0.25);
}

#[test]
fn after_a_gap_beyond_the_watchdog_the_robot_waits_and_continues() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    rig.velocity_m_s = [0.0; 8];
    rig.step_after(500_000_000, 500_000_000);
    let authority = rig.seen().authority;
    assert_eq!((authority.mode, authority.plan_rate), (A::MODE_FOLLOWING, 0.0));
    assert_eq!(authority.faults, A::FAULT_LONG_GAP);
    rig.steps(160);
    assert_eq!((rig.faults(), rig.seen().authority.plan_rate, rig.mode()), (0, 1.0, A::MODE_FOLLOWING));
}

#[test]
fn after_a_long_gap_the_robot_holds_until_a_resume() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    rig.velocity_m_s = [0.0; 8];
    rig.step_after(1_500_000_000, 1_500_000_000);
    rig.steps(300);
    let authority = rig.seen().authority;
    assert_eq!((authority.mode, authority.plan_rate, authority.faults), (A::MODE_HOLDING, 0.0, A::FAULT_LONG_GAP));
    assert_eq!(authority.motion, rig.motion.motion);
    rig.demand(Request::Resume);
    rig.steps(100);
    assert_eq!((rig.faults(), rig.mode()), (0, A::MODE_FOLLOWING));
}

#[test]
fn a_late_request_can_only_bring_the_robot_to_rest() {
    for request in [Request::Arm, Request::Jog { cable: 1, distance_m: 0.1 }, Request::Resume] {
        let mut rig = Rig::default().ready();
        let made_ns = rig.now_ns;
        rig.steps(600);
        assert!(rig.inbox.request_made(1, &request.body(), made_ns));
        let answer = rig.step().answers[0];
        assert!(matches!(answer.reason, Reason::TooLate { age_s } if age_s > 5.0), "{answer:?}");
        assert_eq!(rig.mode(), A::MODE_HOLDING);
    }
    let mut rig = Rig::following([0.02, 0.0, 0.0]);
    let made_ns = rig.now_ns;
    rig.steps(600);
    assert!(rig.inbox.request_made(1, &Request::Stop.body(), made_ns));
    assert!(rig.step().answers[0].is_accepted());
    assert_eq!(rig.mode(), A::MODE_STOPPING);
}

/// Stops and other requests take different ways, so either may arrive first.
#[test]
fn a_motion_that_was_requested_before_a_stop_does_not_begin_after_it() {
    for stop in [Request::Estop, Request::Stop, Request::Hold] {
        let jog = Request::Jog { cable: 1, distance_m: 0.1 };
        for request in [Request::Reset, Request::Arm, Request::Resume, Request::Soft, jog] {
            let mut rig = Rig::default().ready();
            let made_ns = rig.now_ns + 1;
            rig.steps(2);
            // Both in one cycle, the stop first, as motor-io reads them.
            assert!(rig.inbox.request_made(1, &stop.body(), made_ns + 1));
            assert!(rig.inbox.request_made(2, &request.body(), made_ns));
            assert_eq!(rig.step().answers[1].reason, Reason::OvertakenByStop, "{request:?} after {stop:?}");
            let mode = rig.mode();
            // The other one a cycle later.
            assert!(rig.inbox.request_made(3, &request.body(), made_ns));
            assert_eq!(rig.step().answers[0].reason, Reason::OvertakenByStop, "{request:?} after {stop:?}");
            assert_eq!(rig.mode(), mode);
        }
    }
    // A reset that was made afterwards is one, also where the stop states a time to come.
    for ahead_ns in [0, 1_000_000_000_000] {
        let mut rig = Rig::default().ready();
        assert!(rig.inbox.request_made(1, &Request::Estop.body(), rig.now_ns + ahead_ns));
        rig.step();
        assert_eq!(rig.mode(), A::MODE_EMERGENCY_STOP);
        assert!(rig.inbox.request_made(2, &Request::Reset.body(), rig.now_ns + 1));
        rig.step();
        assert_eq!(rig.mode(), A::MODE_HOLDING);
    }
}

/// The drives' watchdog has stopped the motors, so nothing is left to brake.
#[test]
fn after_a_gap_beyond_the_watchdog_a_braking_robot_stays_at_rest() {
    let mut rig = Rig::following([0.3, -0.3, 0.15]);
    rig.steps(100);
    rig.status[1] = 0x40;
    rig.until(50, |rig| rig.mode() == A::MODE_FAULTED);
    rig.step();
    assert!(rig::speed(&rig) > 0.0 && !rig.core.is_at_rest());
    rig.velocity_m_s = [0.0; 8];
    rig.step_after(500_000_000, 500_000_000);
    assert_eq!((rig.mode(), rig::speed(&rig)), (A::MODE_FAULTED, 0.0));
    assert!(rig.core.is_at_rest());
}
