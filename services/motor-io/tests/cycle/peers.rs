//! Controllers, estimators, planner and supervisor that are missing or restarted.

use crate::rig;

use messages::{MotorAuthority as A, Request};
use rig::Rig;

#[test]
fn a_dead_controller_stops_the_robot_on_the_path_and_the_motion_can_be_resumed() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    rig.controller = None;
    rig.until(20, |rig| rig.mode() == A::MODE_STOPPING);
    // Two cycles are bridged, and the third is the stop; all of them count.
    assert_eq!(rig.seen().authority.lost_answer, 3);
    rig.until(30, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_COMMAND_LOST);
    let (accepted, sentence) = rig.ask(Request::Resume);
    assert!(!accepted && sentence.contains("controller"), "{sentence}");
    // A new controller may continue, but only on request.
    rig.incarnation += 1;
    rig.controller = Some([0.0; 8]);
    rig.steps(100);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    rig.demand(Request::Resume);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, 0));
}

#[test]
fn one_missing_command_is_bridged_and_counted() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    let velocity = rig.controller.take();
    rig.step();
    rig.controller = velocity;
    rig.steps(20);
    assert_eq!((rig.mode(), rig.seen().authority.lost_answer, rig.faults()), (A::MODE_FOLLOWING, 1, 0));
}

#[test]
fn an_invalid_estimate_has_another_fault_than_a_dead_controller() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    rig.estimate_valid = false;
    rig.until(60, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_ESTIMATE_LOST);
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    rig.controller = Some([f64::NAN; 8]);
    rig.until(60, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_COMMAND_REFUSED);
}

#[test]
fn a_lost_supervisor_stops_the_robot_on_its_path() {
    let mut rig = Rig::following([0.02, 0.0, 0.0]);
    rig.supervisor = None;
    let cycles = rig.until(300, |rig| rig.mode() == A::MODE_STOPPING);
    assert!((190..=210).contains(&cycles), "{cycles}");
    rig.until(200, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_SUPERVISOR_LOST);
}

#[test]
fn without_a_planner_the_known_part_of_the_motion_is_finished() {
    let mut rig = Rig::default().ready();
    rig.offer(4.0);
    // The known segments are flown to their end.
    rig.motion.end_s += 100.0;
    rig.controller = Some([0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.until(5, |rig| rig.mode() == A::MODE_FOLLOWING);
    rig.steps(30);
    rig.planner = false;
    rig.steps(250);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, A::FAULT_PLANNER_LOST));
    rig.until(400, |rig| rig.mode() == A::MODE_HOLDING);
    assert!(rig.seen().authority.plan_time_s >= 4.0 && rig.seen().authority.plan_time_s < 5.0);
    assert_eq!(rig.faults(), A::FAULT_PLANNER_LOST);
}

#[test]
fn a_restarted_planner_does_not_take_the_motion_over() {
    let mut rig = Rig::following([0.05, 0.0, 0.0]);
    // A restarted planner: another motion, other segments, and the controller follows them.
    rig.motion.motion = 900;
    rig.motion.current.id = 901;
    rig.until(60, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_PLANNER_LOST);
}

#[test]
fn a_dead_estimator_is_not_reported_as_a_dead_controller() {
    let mut rig = Rig::following([0.05, -0.05, 0.0]);
    rig.estimator_alone = false;
    rig.controller = None;
    rig.until(60, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_ESTIMATE_LOST);
    let mut rig = Rig::following([0.05, -0.05, 0.0]);
    rig.controller = None;
    rig.until(60, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_COMMAND_LOST);
}

#[test]
fn without_a_supervisor_no_jog_or_motion_begins() {
    let mut rig = Rig::default().ready();
    rig.demand(Request::Jog { cable: 1, distance_m: 1.5 });
    rig.steps(50);
    let beat = rig.supervisor.take();
    rig.until(260, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_SUPERVISOR_LOST);
    let (accepted, sentence) = rig.ask(Request::Jog { cable: 1, distance_m: 0.1 });
    assert!(!accepted && sentence.contains("supervisor"), "{sentence}");
    rig.offer(5.0);
    rig.steps(50);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    rig.supervisor = beat;
    rig.steps(3);
    rig.until(10, |rig| rig.mode() == A::MODE_FOLLOWING);
}

#[test]
fn a_restarted_planner_is_named_and_the_known_motion_is_flown() {
    let mut rig = Rig::default().ready();
    rig.offer(3.0);
    let mut all = [0.0; 8];
    all[0] = 0.02;
    rig.controller = Some(all);
    rig.until(10, |rig| rig.mode() == A::MODE_FOLLOWING);
    rig.steps(100);
    let kept = rig.motion.current.id;
    rig.motion = messages::PlanMotion { beat: 0, ..Default::default() };
    rig.segment = Some(kept);
    rig.steps(10);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_FOLLOWING, A::FAULT_PLANNER_LOST));
    rig.until(400, |rig| rig.seen().authority.plan_rate == 0.0);
    rig.controller = Some([0.0; 8]);
    rig.until(200, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), A::FAULT_PLANNER_LOST);
    assert!(rig.seen().authority.plan_time_s >= 3.0);
}
