//! Behaviour and answers of the robot in each mode.

use crate::rig;

use messages::{MotorAuthority as A, MotorInput, MotorState, Request};
use rig::Rig;
use robot_state::Reason;

fn speed(rig: &Rig) -> f64 {
    rig.last.as_ref().unwrap().sent.speed_m_s.iter().fold(0.0, |most: f64, v| most.max(v.abs()))
}

#[test]
fn it_starts_disarmed_with_released_drives() {
    let mut rig = Rig::default();
    rig.steps(5);
    assert_eq!((rig.mode(), rig.faults()), (A::MODE_DISARMED, 0));
    assert_eq!(rig.last.as_ref().unwrap().sent.released, [true; 8]);
    assert_eq!(rig.seen().state.position_known, MotorState::POSITION_UNKNOWN);
}

#[test]
fn arming_is_rejected_while_a_unit_is_missing_and_the_unit_is_named() {
    let mut rig = Rig::default();
    rig.unit[1] = MotorInput::UNIT_LOST;
    rig.steps(10);
    assert_eq!(
        (rig.mode(), rig.faults(), rig.seen().authority.fault_unit[1]),
        (A::MODE_DISARMED, A::FAULT_LOST_UNIT, 1)
    );
    let reason = rig.reason(Request::Arm);
    assert!(matches!(reason, Reason::NotArmedFaults { .. }), "{reason}");
    rig.unit[1] = MotorInput::UNIT_OK;
    rig.steps(5);
    assert_eq!(rig.faults(), 0);
    rig.demand(Request::Arm);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    assert_eq!(rig.last.as_ref().unwrap().sent.released[..3], [false; 3]);
}

#[test]
fn a_motion_is_followed_from_its_start_to_rest() {
    let mut rig = Rig::default().ready();
    rig.offer(2.0);
    rig.controller = Some([0.05, -0.05, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let began = rig.seen().authority.plan_time_s;
    rig.until(5, |rig| rig.mode() == A::MODE_FOLLOWING);
    rig.until(300, |rig| rig.seen().authority.plan_time_s >= began + 2.0);
    rig.controller = Some([0.0; 8]);
    rig.until(120, |rig| rig.mode() == A::MODE_HOLDING);
    let authority = rig.seen().authority;
    assert_eq!((authority.motion, authority.faults, authority.lost_answer), (0, 0, 0));
    // A finished motion does not begin again.
    rig.steps(50);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    // A new one does.
    rig.offer(2.0);
    rig.until(5, |rig| rig.mode() == A::MODE_FOLLOWING);
}

#[test]
fn a_motion_that_grows_is_one_motion() {
    let mut rig = Rig::following([0.01, 0.0, -0.01]);
    let started = rig.seen().authority.plan_time_s;
    rig.motion.current.start_s = started + 5.0;
    rig.motion.current.id += 1;
    rig.motion.end_s += 5.0;
    rig.steps(300);
    assert_eq!(rig.mode(), A::MODE_FOLLOWING);
    assert!((rig.seen().authority.plan_time_s - started - 3.0).abs() < 1e-9);
}

#[test]
fn nothing_starts_without_position_epoch_controller_or_a_new_start() {
    let start = |spoil: fn(&mut Rig)| {
        let mut rig = Rig::default().ready();
        rig.offer(5.0);
        spoil(&mut rig);
        rig.steps(50);
        rig.mode() == A::MODE_FOLLOWING
    };
    assert!(start(|_| {}));
    assert!(!start(|rig| rig.motion.epoch += 1));
    assert!(!start(|rig| rig.motion.motion = 0));
    assert!(!start(|rig| rig.motion.current.start_s -= 1.0));
    assert!(!start(|rig| rig.motion.end_s = f64::NAN));
    assert!(!start(|rig| rig.controller = None));
    assert!(!start(|rig| rig.estimate_valid = false));
    let mut unknown = Rig::default();
    unknown.steps(3);
    unknown.demand(Request::Arm);
    unknown.offer(5.0);
    unknown.steps(20);
    assert_eq!(unknown.mode(), A::MODE_HOLDING);
}

#[test]
fn pause_keeps_the_motion_and_resume_continues_it() {
    let mut rig = Rig::following([0.02, -0.02, 0.0]);
    let epoch = rig.seen().authority.epoch;
    rig.demand(Request::Pause);
    rig.until(100, |rig| rig.seen().authority.plan_rate == 0.0);
    rig.controller = Some([0.0; 8]);
    rig.until(100, |rig| rig.mode() == A::MODE_HOLDING);
    let paused = rig.seen().authority;
    assert_eq!((paused.epoch, paused.motion), (epoch, rig.motion.motion));
    rig.steps(100);
    assert_eq!((rig.mode(), rig.seen().authority.plan_time_s), (A::MODE_HOLDING, paused.plan_time_s));
    rig.demand(Request::Resume);
    rig.until(70, |rig| rig.seen().authority.plan_rate == 1.0);
    assert_eq!(rig.mode(), A::MODE_FOLLOWING);
}

#[test]
fn stop_ends_the_motion_on_the_path() {
    let mut rig = Rig::following([0.02, -0.02, 0.0]);
    let epoch = rig.seen().authority.epoch;
    rig.demand(Request::Stop);
    assert_eq!(rig.mode(), A::MODE_STOPPING);
    let cycles = rig.until(200, |rig| rig.mode() == A::MODE_HOLDING);
    assert!(cycles < 60, "{cycles}");
    assert!(rig.seen().authority.epoch > epoch);
    rig.steps(50);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    let (accepted, sentence) = rig.ask(Request::Resume);
    assert!(!accepted, "{sentence}");
}

#[test]
fn the_speed_is_a_ramp_of_the_plan_clock() {
    let mut rig = Rig::following([0.02, 0.0, 0.0]);
    rig.demand(Request::Speed { rate: 0.25 });
    rig.steps(60);
    assert_eq!(rig.seen().authority.plan_rate, 0.25);
    for bad in [0.0, 0.01, 1.5, f64::NAN] {
        let (accepted, sentence) = rig.ask(Request::Speed { rate: bad });
        assert!(!accepted && sentence.contains("accepted"), "{sentence}");
    }
}

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
    rig.until(30, |rig| speed(rig) == 0.0);
    assert!(rig.seen().state.length_m[0] < 14.0);
    rig.demand(Request::Reset);
    rig.demand(Request::Jog { cable: 1, distance_m: -0.3 });
    rig.until(900, |rig| rig.mode() == A::MODE_HOLDING);
    assert_eq!(rig.faults(), 0);
}

#[test]
fn the_emergency_stop_is_at_once_and_stays_until_reset() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    rig.demand(Request::Estop);
    assert_eq!((rig.mode(), speed(&rig)), (A::MODE_EMERGENCY_STOP, 0.0));
    assert_eq!(rig.last.as_ref().unwrap().sent.released[..3], [false; 3]);
    let jog = Request::Jog { cable: 1, distance_m: 0.1 };
    for request in [Request::Arm, jog, Request::Resume, rig::lengths([1.0, 0.1, 5.0])] {
        assert!(!rig.ask(request).0);
        assert_eq!(rig.mode(), A::MODE_EMERGENCY_STOP);
    }
    rig.demand(Request::Reset);
    assert_eq!(rig.mode(), A::MODE_HOLDING);
    // With the drives off, it does not switch them on.
    let mut rig = Rig::default();
    rig.steps(3);
    rig.demand(Request::Estop);
    assert_eq!(rig.last.as_ref().unwrap().sent.released, [true; 8]);
    rig.demand(Request::Reset);
    assert_eq!(rig.mode(), A::MODE_DISARMED);
}

#[test]
fn disarming_needs_rest() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    assert_eq!(rig.reason(Request::Disarm), Reason::NotDisarmedMoving);
    rig.demand(Request::Stop);
    rig.until(200, |rig| rig.mode() == A::MODE_HOLDING);
    rig.demand(Request::Disarm);
    assert_eq!(rig.mode(), A::MODE_DISARMED);
}

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

/// The node is at its speed limit, and at its new place the same cable velocities are a little faster. What takes the
/// node back to its limit and a new command together keep the limit of a cable's acceleration.
#[test]
fn at_the_speed_limit_of_the_node_a_new_command_keeps_the_acceleration_of_a_cable() {
    let config = rig::config();
    let most_m_s = config.cable_acceleration_m_s2 * config.period_s + 1e-12;
    let mut rig = Rig::new(config).ready();
    let command = |v: [f64; 3]| Some([v[0], v[1], v[2], 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.offer(11.759_301_072_106_826);
    rig.step_after(0, 0);
    rig.controller = command([0.266_395_668_240_470_95, 0.424_498_403_726_251_47, 0.215_063_633_540_831_22]);
    for _ in 0..191 {
        rig.step_after(0, 0);
    }
    assert_eq!(rig.mode(), A::MODE_FOLLOWING);
    let mut before_m_s = rig.last.as_ref().unwrap().sent.speed_m_s;
    rig.controller = command([0.251_763_454_684_670_2, 0.0, 0.328_918_206_485_084_4]);
    for _ in 0..20 {
        let sent_m_s = rig.step_after(0, 0).sent.speed_m_s;
        for (i, (now, before)) in sent_m_s.iter().zip(before_m_s).enumerate() {
            assert!((now - before).abs() <= most_m_s, "cable {i}: {before} to {now}");
        }
        before_m_s = sent_m_s;
    }
}

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

#[test]
fn every_request_is_answered_with_a_sentence_in_every_mode() {
    let modes: [fn() -> Rig; 6] = [
        || {
            let mut rig = Rig::default();
            rig.steps(3);
            rig
        },
        || Rig::default().ready(),
        || {
            let mut rig = Rig::default().ready();
            rig.demand(Request::Jog { cable: 1, distance_m: 0.5 });
            rig
        },
        || Rig::following([0.1, 0.0, 0.0]),
        || {
            let mut rig = Rig::following([0.1, 0.0, 0.0]);
            rig.status[0] = 0x40;
            rig.steps(30);
            assert_eq!(rig.mode(), A::MODE_FAULTED);
            rig
        },
        || {
            let mut rig = Rig::following([0.1, 0.0, 0.0]);
            rig.demand(Request::Estop);
            rig
        },
    ];
    for make in modes {
        for verb in 1..=255 {
            let mut rig = make();
            let mode = rig.mode();
            let (_, sentence) = rig.ask_body(&rig::body(verb, [1.0, 0.1, 5.0]));
            assert!(sentence.len() > 5 && sentence.ends_with('.'), "verb {verb} in mode {mode}: {sentence}");
            if verb > 30 {
                break;
            }
        }
    }
}
