//! The planner: what it takes, what it refuses, and how a mission goes on.

use cable_robot::energy::{WinchEnergy, flight};
use cable_robot::motion::Cause;
use cable_robot::motor::DriveLimits;
use cable_robot::profile::ProfileLimits;
use cable_robot::{Distribution, Path, Robot, RobotParts, Segment, Vector3};
use messages::faults::Faults;
use messages::{
    GotoPath, Header, MotorAuthority, MotorState, NodeEstimate, OperatorRequest, PlanMotion, PlanStatus, Request,
    text_of,
};
use planner::mission::{Leg, Line, Mission, Parabola, PathShape, Polyline, Spiral};
use planner::plan::{Plan, PlanError, SHORTEST_S};
use planner::{Inputs, Planner, PlannerConfig, dry_run, requests};
use proptest::prelude::*;
use robot_state::Reason;
use robot_state::answers::detail;
use segments::segment_of;

const SECOND_NS: u64 = 1_000_000_000;

fn parts() -> RobotParts {
    RobotParts {
        anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
        node_mass_kg: 1.2,
        tension_limits_n: [2.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        keep_out_m: vec![[[6.5, 1.0, 0.0], [7.0, 1.5, 1.0]]],
        ..RobotParts::default()
    }
}

fn config() -> PlannerConfig {
    config_of(parts())
}

fn config_of(parts: RobotParts) -> PlannerConfig {
    PlannerConfig {
        robot: Robot::new(parts).unwrap(),
        distribution: Distribution::Unique,
        speed_m_s: 0.2,
        acceleration_m_s2: 0.3,
        check_step_m: 0.02,
        swing_limit_m: 0.005,
    }
}

/// A robot that holds, ready for a mission, at a plan time.
struct World {
    authority: MotorAuthority,
    estimate: NodeEstimate,
}

impl World {
    fn ready() -> Self {
        let header = Header { cycle: 1000, seq: 1000, ..Header::at(10 * SECOND_NS) };
        let authority = MotorAuthority {
            header,
            plan_time_s: 3.5,
            period_s: 0.01,
            epoch: 6,
            mode: MotorAuthority::MODE_HOLDING,
            position_known: MotorState::POSITION_KNOWN,
            cable_count: 3,
            ..MotorAuthority::default()
        };
        let estimate =
            NodeEstimate { header, position_m: [4.8, 3.0, 0.3], valid: 1, cable_count: 3, ..NodeEstimate::default() };
        Self { authority, estimate }
    }

    fn seen(&self) -> Inputs<'_> {
        let now_ns = self.authority.header.stamp_ns + 1_000_000;
        Inputs { now_ns, authority: Some(&self.authority), estimate: Some(&self.estimate), map: None }
    }

    /// motor-io follows the motion, at a plan time.
    fn follow(&mut self, motion: &PlanMotion, plan_time_s: f64) {
        self.authority.mode = MotorAuthority::MODE_FOLLOWING;
        self.authority.motion = motion.motion;
        (self.authority.plan_rate, self.authority.plan_rate_target) = (1.0, 1.0);
        self.pass(plan_time_s - self.authority.plan_time_s);
        self.authority.plan_time_s = plan_time_s;
    }

    fn pass(&mut self, seconds: f64) {
        self.authority.header.stamp_ns += (seconds.max(0.0) * 1e9) as u64;
    }
}

fn mission(text: &str) -> Mission {
    Mission::parse(&format!("name = \"test\"\n{text}")).unwrap()
}

fn three_lines() -> Mission {
    mission(
        "[[leg]]\npolyline = { points_m = [[5.2, 3.0, 0.3], [5.2, 3.4, 0.5]] }\n[[leg]]\nline = { to_m = [4.8, 3.0, 0.4] }\n",
    )
}

/// Contiguous, at rest at every border, none too short, and every one passes the check.
fn sound(segments: &[Segment], config: &PlannerConfig) -> Result<(), TestCaseError> {
    for segment in segments {
        let check = segment.check(&config.robot, config.distribution, config.check_step_m);
        prop_assert!(check.is_ok(), "{check:?}");
        prop_assert!(segment.profile.duration() >= SHORTEST_S * (1.0 - 1e-9));
    }
    for pair in segments.windows(2) {
        let [before, after] = pair else { unreachable!() };
        prop_assert!((before.path.end() - after.path.start()).norm() < 1e-9);
        prop_assert!((before.end_s() - after.start_s).abs() < 1e-9);
        prop_assert!(before.id + 1 == after.id);
        let (end, start) = (before.setpoint(before.end_s()), after.setpoint(after.start_s));
        prop_assert!((end.position - start.position).norm() < 1e-9);
        prop_assert!(end.velocity.norm() < 1e-6 && start.velocity.norm() < 1e-6);
    }
    Ok(())
}

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
fn every_missing_condition_is_answered_with_its_cure() {
    type Spoil = fn(&mut World);
    let cases: &[(Reason, Spoil)] = &[
        (Reason::RobotDisarmed, |w| w.authority.mode = MotorAuthority::MODE_DISARMED),
        (Reason::RobotJogging, |w| w.authority.mode = MotorAuthority::MODE_JOGGING),
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
        assert_eq!((Reason::of_plan(&status), status.reason_code), (Some(*expected), expected.code().into()));
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
        assert_eq!(Reason::of_plan(&status), Some(*expected));
        assert_eq!(text_of(&status.reason), expected.to_string());
    }
}

#[test]
fn a_parabola_that_loses_least_sags_below_the_line_and_a_vertical_one_is_a_line() {
    let start = Vector3::new(3.0, 2.0, 2.0);
    let plan = |text: &str| Plan::new(&mission(text), &config(), start, 0.0, 1).unwrap();
    let lowest = |plan: &Plan| {
        let path = plan.segments[0].path;
        (0..=100).map(|i| path.point(path.length() * f64::from(i) / 100.0).z).fold(f64::INFINITY, f64::min)
    };
    let leg = plan("[[leg]]\nparabola = { to_m = [6.0, 2.5, 2.0] }");
    assert!(lowest(&leg) < 1.7, "{}", lowest(&leg));
    // The same for every line of a mission, and a price on time makes it sag less.
    let all = plan("path = \"parabola\"\n[[leg]]\nline = { to_m = [6.0, 2.5, 2.0] }");
    assert_eq!(all.segments, leg.segments);
    let fast = plan("path = \"parabola\"\ntime_weight_w = 20.0\n[[leg]]\npolyline = { points_m = [[6.0, 2.5, 2.0]] }");
    assert!(lowest(&fast) > lowest(&leg) + 0.05 && fast.end_s() < leg.end_s());
    let up = plan("path = \"parabola\"\n[[leg]]\nline = { to_m = [3.0, 2.0, 1.0] }");
    assert_eq!(up.segments[0].path, Path::line(start, Vector3::new(3.0, 2.0, 1.0)));
    let error = Mission::parse("name = \"x\"\npath = \"arc\"\n[[leg]]\nline = { to_m = [6.0, 2.5, 2.0] }").unwrap_err();
    assert!(error.to_string().contains("parabola"), "{error}");
}

/// Also where a line would be slack at the sag that a constant speed asks for, which knows nothing of the start and the
/// end: no parabola of a fine scan over all that can be flown costs less than the one that is flown.
#[test]
fn the_flown_parabola_has_the_least_loss() {
    let (start, end) = (Vector3::new(3.0, 2.0, 2.0), Vector3::new(6.0, 2.5, 2.0));
    let shape = |mu_per_m| flight::parabola_or_line(&cable_robot::path::Parabola { from: start, to: end, mu_per_m });
    let limits = ProfileLimits { total_m_s2: 0.5, ..ProfileLimits::rest_to_rest(0.2, 0.3) };
    let free = config();
    let steady = flight::best_parabola(&free.robot, free.distribution, &start, &end, 0.2, 0.0).unwrap().mu_per_m;
    let [line, sagging] = [0.0, steady].map(|mu_per_m| {
        let path = shape(mu_per_m);
        let profile = cable_robot::Profile::plan(&path, &limits).unwrap();
        Segment { id: 1, path, profile, start_s: 0.0 }.check(&free.robot, free.distribution, 0.02).unwrap()
    });
    let tauter =
        RobotParts { tension_limits_n: [0.5 * (line.least_tension_n + sagging.least_tension_n), 60.0], ..parts() };
    for (what, parts) in [("free", parts()), ("tauter", tauter)] {
        let config = config_of(parts);
        let (robot, method) = (&config.robot, config.distribution);
        let cost_j = |path: &Path| flight::flown(robot, method, path, &limits, 0.02, 64).map(|cost| cost.energy_j);
        let scan = (0..=600).map(|i| f64::from(i) * 2e-3).filter_map(|mu| Some((cost_j(&shape(mu)).ok()?, mu)));
        let (least_j, at) = scan.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let text = mission("[[leg]]\nparabola = { to_m = [6.0, 2.5, 2.0] }");
        let plan = Plan::new(&text, &config, start, 0.0, 1).unwrap();
        sound(&plan.segments, &config).unwrap();
        let flown_j = cost_j(&plan.segments[0].path).unwrap();
        let mu = if let Path::Parabola(path) = plan.segments[0].path { path.mu_per_m } else { 0.0 };
        let refused = cost_j(&shape(steady)).is_err();
        println!(
            "{what}: {flown_j:.4} J at {mu:.4} per metre; of a scan {least_j:.4} J at {at:.4}; {steady:.4} refused: {refused}"
        );
        assert!(flown_j <= 1.002 * least_j, "{what}: {flown_j} J, and {least_j} J at {at} per metre");
    }
}

/// With its accelerations a lateral path costs less than the parabola, which costs less than the line; what is sent is
/// what was checked.
#[test]
fn a_lateral_path_loses_less_than_a_parabola_and_a_vertical_one_is_a_line() {
    let config = config();
    let robot = &config.robot;
    let start = Vector3::new(3.0, 2.0, 2.0);
    let plan = |text: &str| Plan::new(&mission(text), &config, start, 0.0, 1).unwrap();
    let winch_energy = WinchEnergy {
        anchors: robot.anchors(),
        wrench_n: robot.wrench_n(&Vector3::zeros()),
        drag_n_s2_m2: 0.0,
        cable_weight_n_m: 0.0,
        limits_n: robot.tension_limits_n(),
        method: Distribution::Unique,
        current: robot.current(),
    };
    let loss_j = |plan: &Plan| {
        let segment = &plan.segments[0];
        winch_energy.along_profile(&segment.path, &segment.profile, robot.node_mass_kg(), 256).unwrap().energy_j
    };
    let [line, parabola, lateral] = ["line", "parabola", "lateral"]
        .map(|path| plan(&format!("path = \"{path}\"\n[[leg]]\nline = {{ to_m = [6.0, 2.5, 2.0] }}")));
    assert!(matches!(lateral.segments[0].path, Path::Lateral(_)), "{:?}", lateral.segments[0].path);
    let [line_j, parabola_j, lateral_j] = [&line, &parabola, &lateral].map(loss_j);
    println!("line {line_j:.2} J, parabola {parabola_j:.2} J, lateral {lateral_j:.2} J");
    assert!(lateral_j < 0.95 * parabola_j && parabola_j < 0.9 * line_j, "{line_j} {parabola_j} {lateral_j}");
    sound(&lateral.segments, &config).unwrap();
    let sent = segment_of(&segments::segment_message(&lateral.segments[0])).unwrap();
    assert_eq!(sent, lateral.segments[0]);
    let up = plan("path = \"lateral\"\n[[leg]]\nline = { to_m = [3.0, 2.0, 1.0] }");
    assert_eq!(up.segments[0].path, Path::line(start, Vector3::new(3.0, 2.0, 1.0)));
}

#[test]
fn a_rejection_names_the_place_the_cable_and_the_excess() {
    let start = [4.8, 3.0, 0.3];
    for (text, says) in [
        ("[[leg]]\nline = { to_m = [4.8, 3.0, 2.95] }", &["leg 1", "cable", "above", "60.00 N", "m along"][..]),
        ("[[leg]]\nline = { to_m = [4.8, 3.0, -0.1] }", &["leg 1", "ground"]),
        ("[[leg]]\nline = { to_m = [9.7, 0.1, 0.3] }", &["leg 1", "below the lower limit of 2.00 N"]),
        (
            "[[leg]]\nline = { to_m = [4.9, 3.0, 0.3] }\n[[leg]]\nline = { to_m = [6.75, 1.25, 0.5] }",
            &["leg 2", "keep"],
        ),
        ("speed_m_s = 0.5\n[[leg]]\nline = { to_m = [4.9, 3.0, 0.3] }", &["leg 1", "0.5 m/s", "0.4"]),
        ("acceleration_m_s2 = 2.0\n[[leg]]\nline = { to_m = [4.9, 3.0, 0.3] }", &["2 m/s²", "0.5"]),
        ("[[leg]]\nline = { to_m = [4.8, 3.0, 0.3] }", &["already there"]),
        ("[[leg]]\nparabola = { to_m = [4.8, 3.0, 1.3], mu_per_m = 0.1 }", &["leg 1", "line"]),
        ("[[leg]]\nspiral = { rise_m = 2.7, radius_m = 0.6, turns = 3 }", &["leg 1", "cable"]),
    ] {
        let sentence = dry_run(&mission(text), &config(), start).unwrap_err().to_string();
        for word in says {
            assert!(sentence.contains(word), "{word:?} is not in {sentence:?}");
        }
        assert!(!sentence.contains('\n'));
    }
}

#[test]
fn a_dry_run_gives_length_duration_and_energy() {
    let text =
        "[[leg]]\nspiral = { rise_m = 1.125, radius_m = 0.60, turns = 4 }\n[[leg]]\ndwell = { duration_s = 2.0 }";
    let summary = dry_run(&mission(text), &config(), [4.8, 3.0, 0.3]).unwrap();
    assert_eq!((summary.legs, summary.segments), (2, 2));
    // Archimedes: about π R turns, a little more for the rise.
    assert!((7.5..7.9).contains(&summary.length_m), "{summary:?}");
    assert!(summary.duration_s > summary.length_m / 0.2 + 2.0 && summary.duration_s < summary.length_m / 0.2 + 10.0);
    assert!((summary.end_m[0] - 5.4).abs() < 1e-9 && (summary.end_m[2] - 1.425).abs() < 1e-9);
    assert!(summary.least_tension_n > 2.0 && summary.peak_tension_n < 60.0);
    assert!(summary.peak_cable_speed_m_s <= 0.2);
}

/// The limit of the lines is the robot file's own, not that of the node: where it is lower, the plan is refused, and
/// not slowed in flight.
#[test]
fn a_cable_faster_than_its_limit_is_rejected_with_place_cable_and_excess() {
    // Straight to the first anchor: its line runs as fast as the node.
    let text = "[[leg]]\nline = { to_m = [3.8, 2.375, 1.2], speed_m_s = 0.2 }";
    let limited = |cable_speed_limit_m_s| {
        let config = config_of(RobotParts { cable_speed_limit_m_s, ..parts() });
        dry_run(&mission(text), &config, [4.8, 3.0, 0.3])
    };
    let peak_m_s = limited(None).unwrap().peak_cable_speed_m_s;
    assert!(peak_m_s > 0.15, "{peak_m_s}");
    assert!(limited(Some(1.001 * peak_m_s)).is_ok());
    let sentence = limited(Some(0.15)).unwrap_err().to_string();
    for word in
        ["leg 1", "at (", "m along the segment", "cable 1 would run at 0.1", "cable_speed_limit_m_s is 0.150 m/s"]
    {
        assert!(sentence.contains(word), "no {word:?} in {sentence}");
    }
}

#[test]
fn points_may_count_from_the_start() {
    let text = "relative = true\n[[leg]]\npolyline = { points_m = [[0.2, 0.0, 0.1], [0.0, 0.3, 0.1]] }";
    let summary = dry_run(&mission(text), &config(), [4.8, 3.0, 0.3]).unwrap();
    assert!((summary.end_m[1] - 3.3).abs() < 1e-12 && (summary.end_m[2] - 0.4).abs() < 1e-12);
}

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
    assert!(matches!(&refused(&no_path), Reason::Undecodable { why } if why.contains("path is 7")));
    assert!(matches!(&refused(&unknown), Reason::Undecodable { why } if why.contains("99")));
    assert!(matches!(refused(&goto([50.0, 3.0, 0.4], None, GotoPath::Line)), Reason::PlanLimit { leg: 1, .. }));
    assert_eq!(refused(&motor_io), Reason::OtherProcess { takes: detail("goto and run") });
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

fn point() -> impl Strategy<Value = [f64; 3]> {
    prop_oneof![4 => (3.5..6.0f64, 2.0..4.0f64, 0.1..2.0f64), 1 => (0.0..10.0f64, 0.0..9.0f64, -0.2..3.0f64)]
        .prop_map(|(x, y, z)| [x, y, z])
}

fn leg() -> impl Strategy<Value = Leg> {
    let speed = || proptest::option::of(0.01..0.45f64);
    prop_oneof![
        (point(), speed()).prop_map(|(to_m, speed_m_s)| Leg::Line(Line { to_m: to_m.into(), speed_m_s })),
        (proptest::collection::vec(point(), 1..5), speed()).prop_map(|(points_m, speed_m_s)| Leg::Polyline(Polyline {
            points_m: points_m.into_iter().map(Into::into).collect(),
            speed_m_s,
        })),
        (point(), proptest::option::of(-0.2..0.4f64), speed())
            .prop_map(|(to_m, mu_per_m, speed_m_s)| Leg::Parabola(Parabola { to_m: to_m.into(), mu_per_m, speed_m_s })),
        (-0.5..1.0f64, 0.05..0.8f64, -4.0..4.0f64, speed()).prop_map(|(rise_m, radius_m, turns, speed_m_s)| {
            Leg::Spiral(Spiral { rise_m, radius_m, turns, speed_m_s })
        }),
        (0.0..3.0f64).prop_map(|duration_s| Leg::Dwell(planner::mission::Dwell { duration_s })),
        // Moves of millimetres, whose profiles have to be stretched.
        (-0.01..0.01f64).prop_map(|d| Leg::Line(Line { to_m: [4.8 + d, 3.0, 0.31].into(), speed_m_s: None })),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn published_plans_pass_the_check_and_rejected_ones_move_nothing(
        leg in proptest::collection::vec(leg(), 1..6),
        path in prop_oneof![3 => Just(PathShape::Line), 1 => Just(PathShape::Parabola)],
        acceleration_m_s2 in proptest::option::of(0.05..0.6f64),
    ) {
        let mission = Mission {
            name: "any".into(),
            speed_m_s: None,
            acceleration_m_s2,
            path,
            time_weight_w: 0.0,
            relative: false,
            leg,
        };
        let world = World::ready();
        let config = config();
        let mut planner = Planner::new(config);
        match planner.run(&mission, &world.seen()) {
            Ok(_) => {
                sound(planner.segments(), &config)?;
                let (motion, _) = planner.step(&world.seen());
                // What a controller makes of the message is what was checked.
                let sent = segment_of(&motion.current).unwrap();
                sound(&[sent], &config)?;
                let first = planner.segments()[0];
                for i in 0..=20 {
                    let time_s = first.start_s + first.profile.duration() * f64::from(i) / 20.0;
                    prop_assert!((sent.setpoint(time_s).position - first.setpoint(time_s).position).norm() < 1e-9);
                }
                prop_assert!((first.path.start().x - 4.8).abs() < 1e-9);
            }
            Err(refusal) => {
                let sentence = refusal.to_string();
                prop_assert!(!sentence.is_empty() && !sentence.contains('\n'));
                let (motion, status) = planner.step(&world.seen());
                prop_assert_eq!((motion.motion, motion.current.id, status.state), (0, 0, PlanStatus::STATE_REFUSED));
            }
        }
    }
}

/// motor-io keeps a motion of a planner that has ended and takes up no other: asking again and again would be in vain.
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
        assert_eq!(Reason::of_plan(&status), Some(expected));
    }
}

#[test]
fn a_speed_beyond_the_motors_is_rejected_with_the_highest_that_can_be_flown() {
    let drive_limits = DriveLimits { current_a: 5.0, voltage_v: 19.0 };
    let config = config_of(RobotParts { speed_limit_m_s: 1.0, drive_limits, ..parts() });
    let mission = |speed_m_s: f64| {
        Mission::parse(&format!(
            "name = \"up\"\nspeed_m_s = {speed_m_s}\n[[leg]]\nline = {{ to_m = [3.0, 1.6, 1.8] }}\n"
        ))
        .unwrap()
    };
    let plan = |speed_m_s| Plan::new(&mission(speed_m_s), &config, Vector3::new(6.0, 3.0, 0.4), 0.0, 1);
    let Err(PlanError::Refused { leg: 1, refusal, feasible_m_s: Some(feasible_m_s), .. }) = plan(1.0) else {
        panic!("{:?}", plan(1.0))
    };
    let Cause::Voltage { cable, load, limit_v } = refusal.cause else { panic!("{refusal}") };
    assert!(cable < 3 && limit_v == 19.0 && load.voltage_v.abs() > 19.0, "{refusal}");
    // At constant speed the motors generate 40 V per m/s.
    assert!((0.3..0.6).contains(&feasible_m_s), "{feasible_m_s}");
    plan(feasible_m_s).unwrap();
    // The advice is accurate to a 128th of the rejected speed.
    assert!(matches!(plan(feasible_m_s + 0.01), Err(PlanError::Refused { .. })), "{feasible_m_s}");
}
