//! A mission from its request to its end.

use crate::world::{SECOND_NS, World, config, three_lines};
use cable_robot::{Segment, Vector3};
use messages::faults::Faults;
use messages::{MotorAuthority, MotorState, PlanStatus, text_of};
use planner::{Inputs, Planner};
use robot_state::Reason;
use robot_state::answers::detail;
use segments::segment_of;

#[test]
fn a_mission_is_offered_flown_and_done() {
    let mut world = World::ready();
    let mut planner = Planner::new(config());
    let reason = planner.run(&three_lines(), &world.seen()).unwrap();
    assert!(matches!(reason, Reason::Planned { continues: false, segments: 3, later: None, .. }), "{reason:?}");
    let (motion, status) = planner.step(&world.seen());
    assert_eq!((motion.motion, motion.epoch, status.state), (1, 6, PlanStatus::STATE_READY));
    assert_eq!(motion.current.start_s, 3.5);
    let all: Vec<Segment> = planner.segments().to_vec();
    assert_eq!((motion.current.id, motion.next.id), (all[0].id as u32, all[1].id as u32));
    assert_eq!(motion.end_s, all[2].end_s());
    let mut beat = motion.beat;
    let mut time_s = 3.5;
    while time_s < motion.end_s + 0.3 {
        world.follow(&motion, time_s);
        let (now, status) = planner.step(&world.seen());
        beat += 1;
        assert_eq!(now.beat, beat);
        assert_eq!(status.state, PlanStatus::STATE_RUNNING);
        let current = segment_of(&now.current).unwrap();
        assert!(time_s < current.end_s() || now.next.id == 0, "{time_s} s is past segment {}", current.id);
        assert!(time_s >= current.start_s - 1e-9);
        assert!((status.progress - ((time_s - 3.5) / (motion.end_s - 3.5)).min(1.0)).abs() < 1e-9);
        assert_eq!(status.leg, if time_s < all[2].start_s { 1 } else { 2 });
        time_s += 0.05;
    }
    (world.authority.mode, world.authority.motion) = (MotorAuthority::MODE_HOLDING, 0);
    let (motion, status) = planner.step(&world.seen());
    assert_eq!((motion.motion, motion.current.id, status.state), (0, 0, PlanStatus::STATE_DONE));
    planner.run(&three_lines(), &world.seen()).unwrap();
    assert_eq!(planner.step(&world.seen()).0.motion, 2, "the next mission is another motion");
}

#[test]
fn a_change_is_awaited_with_shorter_pauses() {
    let mut world = World::ready();
    let mut planner = Planner::new(config());
    let long_ns = planner.pause_ns(Some(&world.authority));
    assert_eq!(planner.pause_ns(None), long_ns);
    planner.run(&three_lines(), &world.seen()).unwrap();
    let (motion, _) = planner.step(&world.seen());
    let short_ns = planner.pause_ns(Some(&world.authority));
    assert!(short_ns < long_ns, "motor-io does not follow yet");
    let all: Vec<Segment> = planner.segments().to_vec();
    let pause_s = long_ns as f64 * 1e-9;
    let mut time_s = motion.current.start_s;
    while time_s < motion.end_s + 0.3 {
        world.follow(&motion, time_s);
        planner.step(&world.seen());
        let pause_ns = planner.pause_ns(Some(&world.authority));
        // Each end of a segment is seen after a short pause.
        let near = all.iter().any(|segment| (0.0..pause_s).contains(&(segment.end_s() - time_s)));
        assert!(!near || pause_ns == short_ns, "{time_s} s");
        let amid = all.iter().any(|one| one.start_s <= time_s && time_s < one.end_s() - 2.0 * pause_s);
        assert!(!amid || pause_ns == long_ns, "{time_s} s");
        world.authority.mode = MotorAuthority::MODE_STOPPING;
        assert_eq!(planner.pause_ns(Some(&world.authority)), short_ns, "{time_s} s");
        time_s += 0.01;
    }
    (world.authority.mode, world.authority.motion) = (MotorAuthority::MODE_HOLDING, 0);
    planner.step(&world.seen());
    assert_eq!(planner.pause_ns(Some(&world.authority)), long_ns, "the mission is done");
}

#[test]
fn every_missing_condition_is_answered_with_its_cure() {
    type Spoil = fn(&mut World);
    let cases: &[(Reason, Spoil)] = &[
        (Reason::RobotDisarmed, |w| w.authority.mode = MotorAuthority::MODE_DISARMED),
        (Reason::RobotJogging, |w| w.authority.mode = MotorAuthority::MODE_JOGGING),
        (Reason::RobotSoft, |w| w.authority.mode = MotorAuthority::MODE_SOFT),
        (Reason::RobotMoves, |w| w.authority.mode = MotorAuthority::MODE_FOLLOWING),
        (Reason::RobotMoves, |w| w.authority.mode = MotorAuthority::MODE_STOPPING),
        (Reason::RobotFaulted, |w| w.authority.mode = MotorAuthority::MODE_FAULTED),
        (Reason::RobotEmergencyStop, |w| w.authority.mode = MotorAuthority::MODE_EMERGENCY_STOP),
        (Reason::PositionUnknown, |w| w.authority.position_known = MotorState::POSITION_UNKNOWN),
        (Reason::PositionRestored, |w| w.authority.position_known = MotorState::POSITION_RESTORED),
        (Reason::NoEstimate, |w| w.estimate.valid = 0),
        (Reason::NoEstimate, |w| w.estimate.header.cycle = 900),
        (Reason::NoStart { position_m: [4.8, f64::INFINITY, 0.3] }, |w| w.estimate.position_m[1] = f64::INFINITY),
    ];
    for (expected, spoil) in cases {
        let mut world = World::ready();
        spoil(&mut world);
        let mut planner = Planner::new(config());
        let refusal = planner.run(&three_lines(), &world.seen()).unwrap_err();
        assert_eq!(refusal.reason(), *expected);
        let (motion, status) = planner.step(&world.seen());
        assert_eq!((motion.motion, status.state, status.refused), (0, PlanStatus::STATE_REFUSED, 1));
        assert_eq!((Reason::from_status(&status), status.reason_code), (Some(*expected), expected.code().into()));
        assert_eq!(text_of(&status.reason), expected.to_string());
    }
    let mut world = World::ready();
    world.estimate.position_m[1] = f64::NAN;
    let refusal = Planner::new(config()).run(&three_lines(), &world.seen()).unwrap_err();
    assert!(matches!(refusal.reason(), Reason::NoStart { .. }), "{refusal}");
    let world = World::ready();
    let mut planner = Planner::new(config());
    let refused = |planner: &mut Planner, seen: &Inputs<'_>| planner.run(&three_lines(), seen).unwrap_err().reason();
    let silent = Inputs { now_ns: world.seen().now_ns + 2 * SECOND_NS, ..world.seen() };
    assert_eq!(refused(&mut planner, &silent), Reason::MotorIoAbsent);
    let blind = Inputs { authority: None, ..world.seen() };
    assert_eq!(refused(&mut planner, &blind), Reason::MotorIoAbsent);
    let blind = Inputs { estimate: None, ..world.seen() };
    assert_eq!(refused(&mut Planner::new(config()), &blind), Reason::NoEstimate);
    // Where the last one is fresh, one that is late refuses nothing.
    assert!(planner.run(&three_lines(), &blind).is_ok());
}

#[test]
fn one_cycle_without_an_estimate_rejects_nothing_and_many_do() {
    let mut world = World::ready();
    let mut planner = Planner::new(config());
    planner.step(&world.seen());
    let spoil = |world: &mut World, cycles: u64| {
        world.authority.header.cycle += cycles;
        world.estimate.header.cycle += cycles;
        world.estimate.valid = 0;
        world.estimate.position_m = [f64::NAN; 3];
    };
    spoil(&mut world, 1);
    let mut later = planner.clone();
    planner.run(&three_lines(), &world.seen()).unwrap();
    assert!((planner.segments()[0].path.start() - Vector3::new(4.8, 3.0, 0.3)).norm() < 1e-12);
    // what was true in another epoch may be true no more
    let mut moved = later.clone();
    let epoch = MotorAuthority { epoch: 7, ..world.authority };
    let seen = Inputs { authority: Some(&epoch), ..world.seen() };
    assert_eq!(moved.run(&three_lines(), &seen).unwrap_err().reason(), Reason::NoEstimate);
    spoil(&mut world, 20);
    assert_eq!(later.run(&three_lines(), &world.seen()).unwrap_err().reason(), Reason::NoEstimate);
}

#[test]
fn one_mission_at_a_time_paused_or_not() {
    let mut world = World::ready();
    let mut planner = Planner::new(config());
    planner.run(&three_lines(), &world.seen()).unwrap();
    let (motion, _) = planner.step(&world.seen());
    world.follow(&motion, 4.5);
    planner.step(&world.seen());
    let mission = detail(&three_lines().name);
    let refused = planner.run(&three_lines(), &world.seen()).unwrap_err();
    assert_eq!(refused.reason(), Reason::MissionRuns { mission });
    let (same, status) = planner.step(&world.seen());
    assert_eq!((same.motion, status.state), (motion.motion, PlanStatus::STATE_RUNNING), "a refusal changes nothing");
    (world.authority.plan_rate, world.authority.plan_rate_target) = (0.5, 0.0);
    for mode in [MotorAuthority::MODE_FOLLOWING, MotorAuthority::MODE_STOPPING] {
        world.authority.mode = mode;
        assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_RUNNING, "it still moves");
    }
    world.authority.mode = MotorAuthority::MODE_HOLDING;
    world.authority.plan_rate = 0.0;
    let (same, status) = planner.step(&world.seen());
    assert_eq!((same.motion, status.state), (motion.motion, PlanStatus::STATE_PAUSED));
    let refused = planner.run(&three_lines(), &world.seen()).unwrap_err();
    assert_eq!(refused.reason(), Reason::MissionPaused { mission });
}

#[test]
fn a_mission_ends_with_its_epoch_with_a_fault_and_when_motor_io_does_not_start_it() {
    type Spoil = fn(&mut World);
    let mut slack = Faults::default();
    slack.cable(MotorAuthority::FAULT_SLACK, 1);
    let faults = Faults::default();
    let cases: &[(Reason, Spoil)] = &[
        (Reason::EndedByStop, |w| w.authority.epoch += 1),
        (Reason::EndedByFault { faults }, |w| w.authority.mode = MotorAuthority::MODE_FAULTED),
        (Reason::EndedByFault { faults: slack }, |w| {
            w.authority.mode = MotorAuthority::MODE_FAULTED;
            w.authority.faults = MotorAuthority::FAULT_SLACK;
            w.authority.fault_cable[1] = 1;
        }),
        (Reason::EndedByEmergencyStop { faults }, |w| w.authority.mode = MotorAuthority::MODE_EMERGENCY_STOP),
        (Reason::EndedByDisarm, |w| w.authority.mode = MotorAuthority::MODE_DISARMED),
        (Reason::EndedByRestart, |w| {
            w.authority.mode = MotorAuthority::MODE_DISARMED;
            w.authority.header.life += 1;
        }),
        (Reason::EndedOffStart, |w| w.authority.faults = MotorAuthority::FAULT_OFF_START),
        (Reason::EndedNotTakenUp { within_s: 5.0 }, |w| w.pass(6.0)),
    ];
    for (expected, spoil) in cases {
        let mut world = World::ready();
        let mut planner = Planner::new(config());
        planner.run(&three_lines(), &world.seen()).unwrap();
        assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_READY);
        spoil(&mut world);
        let (motion, status) = planner.step(&world.seen());
        assert_eq!((motion.motion, status.state), (0, PlanStatus::STATE_ABORTED), "{expected}");
        assert_eq!(Reason::from_status(&status), Some(*expected));
        assert_eq!(text_of(&status.reason), expected.to_string());
    }
}

/// motor-io keeps the motion of a planner that has ended and follows no other, so repeated requests would fail.
#[test]
fn a_motion_of_an_earlier_planner_must_be_ended_first() {
    let mut world = World::ready();
    world.authority.motion = 4;
    let mut planner = Planner::new(config());
    let refusal = planner.run(&three_lines(), &world.seen()).unwrap_err();
    assert_eq!((refusal.is_bad_input(), refusal.reason()), (false, Reason::ForeignMotion));
    world.authority.motion = 0;
    planner.run(&three_lines(), &world.seen()).unwrap();
}

#[test]
fn a_motion_that_does_not_start_ends_with_what_the_controller_lacks() {
    let within_s = 5.0;
    for (verdict, expected) in [
        (MotorAuthority::VERDICT_ABSENT, Reason::EndedNotTakenUp { within_s }),
        (MotorAuthority::VERDICT_NOT_FINITE, Reason::EndedCommandsRefused { within_s }),
    ] {
        let (mut world, mut planner) = (World::ready(), Planner::new(config()));
        planner.run(&three_lines(), &world.seen()).unwrap();
        planner.step(&world.seen());
        world.authority.verdict[0] = verdict;
        world.pass(5.1);
        let (_, status) = planner.step(&world.seen());
        assert_eq!(status.state, PlanStatus::STATE_ABORTED);
        assert_eq!(Reason::from_status(&status), Some(expected));
    }
}
