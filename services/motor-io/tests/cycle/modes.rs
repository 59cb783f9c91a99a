//! Behaviour and answers of the robot in each mode.

use crate::rig;

use messages::{MotorAuthority as A, MotorInput, MotorState, Request};
use rig::Rig;
use robot_state::Reason;

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
fn the_emergency_stop_is_at_once_and_stays_until_reset() {
    let mut rig = Rig::following([0.1, -0.1, 0.05]);
    rig.demand(Request::Estop);
    assert_eq!((rig.mode(), rig::speed(&rig)), (A::MODE_EMERGENCY_STOP, 0.0));
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
