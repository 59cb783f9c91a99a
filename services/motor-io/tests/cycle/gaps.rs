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
