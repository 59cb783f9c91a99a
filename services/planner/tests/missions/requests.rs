//! Requests to the planner and its answers.

use crate::world::{World, config, three_lines};
use messages::{DecodeError, GotoPath, MotorAuthority, OperatorRequest, PlanStatus, Request};
use planner::progress::ProgressWriter;
use planner::{Planner, Progress, requests};
use robot_state::Reason;
use robot_state::answers::detail;

#[test]
fn requests_are_answered() {
    let world = World::ready();
    let folder = tempfile::tempdir().unwrap();
    let short = "name = \"short\"\n[[leg]]\nline = { to_m = [4.9, 3.0, 0.4] }\n";
    let run = |text: &str| {
        let hash = config::store_mission(folder.path(), text).unwrap();
        Request::Run { mission: "any".to_owned(), hash, continues: false }.encode().unwrap()
    };
    let goto = |to_m: [f64; 3], speed_m_s: Option<f64>, path: GotoPath| {
        Request::Goto { to_m, path, speed_m_s }.encode().unwrap()
    };
    let there = |path: GotoPath| goto([5.0, 3.0, 0.4], Some(0.1), path);
    let parabola = |mu_per_m: Option<f64>| GotoPath::Parabola { mu_per_m };
    let missing = Request::Run { mission: "none".to_owned(), hash: [9; 32], continues: false }.encode().unwrap();
    let mut unknown = Request::Arm.encode().unwrap();
    unknown.body.verb = 99;
    let mut no_path = there(GotoPath::Line);
    no_path.body.path = 7;
    let motor_io = Request::Arm.encode().unwrap();
    let refused = |request: &OperatorRequest| {
        requests::answer(&mut Planner::new(config()), request, || true, folder.path(), &world.seen())
    };
    for request in [
        run(short),
        goto([5.0, 3.0, 0.4], None, GotoPath::Line),
        there(parabola(Some(0.2))),
        there(parabola(None)),
        there(GotoPath::Lateral),
    ] {
        assert!(matches!(refused(&request), Reason::Planned { continues: false, .. }), "{}", refused(&request));
    }
    let of_key = |request: &OperatorRequest| match refused(request) {
        Reason::MissionValue { leg, key, why } => {
            assert!(why.contains(key.as_str()), "{why}");
            (leg, key.to_string())
        }
        other => panic!("{other:?}"),
    };
    assert_eq!(of_key(&there(parabola(Some(f64::NAN)))), (Some(1), "mu_per_m".to_owned()));
    assert_eq!(of_key(&goto([5.0, 3.0, 0.4], Some(-0.1), GotoPath::Line)), (Some(1), "speed_m_s".to_owned()));
    assert_eq!(of_key(&goto([f64::NAN, 3.0, 0.4], None, GotoPath::Line)), (Some(1), "to_m".to_owned()));
    let line_1 = refused(&run("name = 3\n"));
    assert!(matches!(&line_1, Reason::MissionInvalid { why } if why.contains("line 1")), "{line_1}");
    assert!(matches!(refused(&missing), Reason::CopyUnreadable { .. }));
    let path_7 = DecodeError::Field { verb: no_path.body.verb, field: "path", value: 7 };
    assert_eq!(refused(&no_path), Reason::Undecodable { why: detail(path_7) });
    assert_eq!(refused(&unknown), Reason::Undecodable { why: detail(DecodeError::Verb(99)) });
    assert!(matches!(refused(&goto([50.0, 3.0, 0.4], None, GotoPath::Line)), Reason::PlanLimit { leg: 1, .. }));
    assert!(
        matches!(refused(&motor_io), Reason::OtherProcess { takes } if ["goto", "run"].iter().all(|v| takes.contains(v)))
    );
    // A copy that was changed after the request is not flown.
    let request = run(short);
    let copy = config::mission_copy(folder.path(), &request.hash);
    std::fs::write(copy, short.replace("0.4", "0.9")).unwrap();
    let mut planner = Planner::new(config());
    let reason = requests::answer(&mut planner, &request, || true, folder.path(), &world.seen());
    assert!(matches!(reason, Reason::CopyChanged { .. }), "{reason:?}");
    assert_eq!(planner.step(&world.seen()).0.motion, 0);
    // A motion whose requester has timed out is not started.
    let mut planner = Planner::new(config());
    let reason = requests::answer(&mut planner, &run(short), || false, folder.path(), &world.seen());
    assert_eq!(reason, Reason::RequesterTimedOut);
    let (motion, status) = planner.step(&world.seen());
    assert_eq!((motion.motion, motion.current.id, status.state), (0, 0, PlanStatus::STATE_REFUSED));
    // What can be asked again later is no bad input.
    let mut disarmed = World::ready();
    disarmed.authority.mode = MotorAuthority::MODE_DISARMED;
    let here = goto([4.8, 3.0, 0.3], None, GotoPath::Line);
    for (world, request) in [(&disarmed, run(short)), (&world, here)] {
        let reason = requests::answer(&mut Planner::new(config()), &request, || true, folder.path(), &world.seen());
        assert!(matches!(reason, Reason::RobotDisarmed | Reason::AlreadyThere), "{reason:?}");
        assert_eq!(reason.accepted(), OperatorRequest::REFUSED);
    }
}

/// Neither a mission whose requester has timed out nor one that motor-io does not take up replaces the one before it.
#[test]
fn a_mission_that_never_moves_leaves_the_one_before_it_to_be_continued() {
    let folder = tempfile::tempdir().unwrap();
    let short = "name = \"short\"\n[[leg]]\nline = { to_m = [4.9, 3.0, 0.4] }\n";
    let hash = config::store_mission(folder.path(), short).unwrap();
    let run = Request::Run { mission: "any".to_owned(), hash, continues: false }.encode().unwrap();
    let (mut world, mut planner) = (World::ready(), Planner::new(config()));
    planner.run(&three_lines(), &world.seen()).unwrap();
    let (motion, _) = planner.step(&world.seen());
    for time_s in [4.0, 4.5] {
        world.follow(&motion, time_s);
        planner.step(&world.seen());
    }
    world.authority = MotorAuthority { mode: MotorAuthority::MODE_HOLDING, motion: 0, epoch: 7, ..world.authority };
    assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_ABORTED);
    let begun = planner.progress().cloned();
    assert!(begun.as_ref().is_some_and(|progress| progress.along > 0.05), "{begun:?}");
    let reason = requests::answer(&mut planner, &run, || false, folder.path(), &world.seen());
    assert_eq!((reason, planner.progress()), (Reason::RequesterTimedOut, begun.as_ref()));
    let reason = requests::answer(&mut planner, &run, || true, folder.path(), &world.seen());
    assert!(matches!(reason, Reason::Planned { .. }), "{reason}");
    assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_READY);
    assert_ne!(planner.progress(), begun.as_ref());
    world.pass(6.0);
    assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_ABORTED);
    assert_eq!(planner.progress(), begun.as_ref());
    assert!(planner.go_on(&three_lines(), &world.seen()).is_ok());
}

/// A first mission that never moves leaves nothing that a restarted planner takes for an unfinished mission.
#[test]
fn a_first_mission_that_never_moves_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let start = || ProgressWriter::start(folder.path(), "lab").unwrap();
    let stored = || Progress::load(folder.path(), "lab").unwrap();
    let (mut world, mut planner, mut keeper) = (World::ready(), Planner::new(config()), start());
    planner.run(&three_lines(), &world.seen()).unwrap();
    keeper.store(planner.progress(), 1_000_000_000);
    let begun = planner.progress().cloned();
    assert!(begun.is_some());
    drop(keeper);
    assert_eq!(stored(), begun);
    // A planner that remembers nothing leaves the file alone, which may be one that cannot be read.
    let mut keeper = start();
    keeper.store(None, 2_000_000_000);
    drop(keeper);
    assert_eq!(stored(), begun);
    let mut keeper = start();
    keeper.store(planner.progress(), 3_000_000_000);
    planner.step(&world.seen());
    world.pass(6.0);
    assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_ABORTED);
    assert_eq!(planner.progress(), None);
    let until = std::time::Instant::now() + std::time::Duration::from_secs(20);
    // While the first one is being written, there may be no room; the passes after it try again.
    while stored().is_some() && std::time::Instant::now() < until {
        keeper.store(planner.progress(), 3_000_000_001);
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    drop(keeper);
    assert_eq!(stored(), None);
    let mut keeper = start();
    keeper.store(begun.as_ref(), 4_000_000_000);
    drop(keeper);
    assert_eq!(stored(), begun);
}

/// A motion states when it was asked for. One that motor-io takes up without beginning it, because of a hold, is paused
/// and waits for as long as the operator does.
#[test]
fn a_motion_states_when_it_was_asked_for_and_waits_for_a_resume_where_it_is_held_from_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let (mut world, mut planner) = (World::ready(), Planner::new(config()));
    let path = messages::GotoPath::Line;
    let mut goto = Request::Goto { to_m: [4.9, 3.0, 0.4], path, speed_m_s: None }.encode().unwrap();
    goto.header.stamp_ns = world.seen().now_ns - 700_000_000;
    let reason = requests::answer(&mut planner, &goto, || true, folder.path(), &world.seen());
    assert!(matches!(reason, Reason::Planned { .. }), "{reason}");
    let (motion, status) = planner.step(&world.seen());
    assert_eq!((motion.asked_ns, status.state), (goto.header.stamp_ns, PlanStatus::STATE_READY));
    world.authority.motion = motion.motion;
    for _ in 0..20 {
        world.pass(1.0);
        assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_PAUSED);
    }
    world.follow(&motion, 4.0);
    assert_eq!(planner.step(&world.seen()).1.state, PlanStatus::STATE_RUNNING);
}
