//! Scanning missions: their length and duration, their refusals, and the continuation of an interrupted
//! mission.

use cable_robot::motion::Cause;
use cable_robot::{Distribution, Path, Robot, RobotParts, Segment, Vector3};
use messages::{FieldMap, Header, MotorAuthority, MotorState, NodeEstimate, PlanMotion, PlanStatus, Request};
use planner::mission::Mission;
use planner::plan::{Plan, PlanError};
use planner::scan::ScanError;
use planner::{Inputs, Planner, PlannerConfig, Progress, dry_run, requests};
use proptest::prelude::*;
use robot_state::Reason;
use robot_state::answers::detail;

const START_M: [f64; 3] = [4.8, 3.0, 0.5];

fn config() -> PlannerConfig {
    let robot = Robot::new(RobotParts {
        anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
        node_mass_kg: 1.2,
        tension_limits_n: [2.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        ..RobotParts::default()
    })
    .unwrap();
    PlannerConfig {
        robot,
        distribution: Distribution::Unique,
        speed_m_s: 0.2,
        acceleration_m_s2: 0.3,
        check_step_m: 0.02,
        swing_limit_m: 0.005,
    }
}

fn mission(text: &str) -> Mission {
    Mission::parse(&format!("name = \"scan\"\n{text}")).unwrap()
}

const EVERYTHING: &str = r#"
[[leg]]
raster = { corner_m = [4.2, 2.6, 0.8], opposite_m = [5.4, 3.4, 0.8], pitch_m = 0.3, overlap = 0.25 }
[[leg]]
dwell_points = { points_m = [[4.6, 3.0, 0.6], [5.0, 3.2, 0.6]], duration_s = 1.5 }
[[leg]]
parabola = { to_m = [4.2, 2.8, 0.9], mu_per_m = 0.1 }
[[leg]]
transect = { from_m = [4.2, 2.8, 0.9], to_m = [5.2, 3.2, 0.9], step_m = 0.4, dwell_s = 1.0 }
[[leg]]
profile = { at_m = [4.8, 3.0, 1.2], rise_m = -0.8, step_m = 0.4, dwell_s = 0.7 }
[[leg]]
spiral = { rise_m = 0.4, radius_m = 0.3, turns = 2.0 }
"#;

/// A robot that holds at a place, or follows.
struct World {
    authority: MotorAuthority,
    estimate: NodeEstimate,
    /// Reported progress of the mission.
    share: f64,
}

impl World {
    fn at(position_m: [f64; 3]) -> Self {
        let header = Header { cycle: 1000, seq: 1000, ..Header::at(10_000_000_000) };
        let authority = MotorAuthority {
            header,
            plan_time_s: 2.0,
            epoch: 6,
            mode: MotorAuthority::MODE_HOLDING,
            position_known: MotorState::POSITION_KNOWN,
            ..MotorAuthority::default()
        };
        let estimate = NodeEstimate { header, position_m, valid: 1, ..NodeEstimate::default() };
        Self { authority, estimate, share: 0.0 }
    }

    fn seen(&self) -> Inputs<'_> {
        let now_ns = self.authority.header.stamp_ns + 1_000_000;
        Inputs { now_ns, authority: Some(&self.authority), estimate: Some(&self.estimate), map: None }
    }

    /// One pass of the planner, whose reported progress never decreases.
    fn step(&mut self, planner: &mut Planner) -> (PlanMotion, PlanStatus) {
        let (motion, status) = planner.step(&self.seen());
        assert!((self.share..=1.0).contains(&status.progress), "{} after {}", status.progress, self.share);
        self.share = status.progress;
        (motion, status)
    }

    /// Flies the planner's motion until a time on the plan clock, and gives it up there or lets it end.
    fn fly(&mut self, planner: &mut Planner, until_s: f64) -> PlanStatus {
        let (motion, _) = self.step(planner);
        self.authority.motion = motion.motion;
        (self.authority.plan_rate, self.authority.plan_rate_target) = (1.0, 1.0);
        self.authority.mode = MotorAuthority::MODE_FOLLOWING;
        let begun_s = self.authority.plan_time_s;
        for step in 0..=20 {
            self.authority.plan_time_s = begun_s + (until_s - begun_s) * f64::from(step) / 20.0;
            self.step(planner);
        }
        self.authority.mode = MotorAuthority::MODE_HOLDING;
        self.authority.motion = 0;
        if until_s < motion.end_s {
            self.authority.epoch += 1;
        }
        self.step(planner).1
    }
}

fn position(segments: &[Segment], time_s: f64) -> Vector3<f64> {
    let segment = segments.iter().rfind(|segment| segment.start_s <= time_s).unwrap();
    segment.setpoint(time_s).position
}

fn measured_m(segments: &[Segment]) -> f64 {
    segments.iter().map(|segment| segment.path.length()).sum()
}

fn dwelt_s(segments: &[Segment]) -> f64 {
    let dwells = segments.iter().filter(|segment| matches!(segment.path, Path::Dwell(_)));
    dwells.map(|segment| segment.profile.duration()).sum()
}

#[test]
fn the_answer_to_a_scan_gives_its_length_and_duration() {
    let summary = dry_run(&mission(EVERYTHING), &config(), START_M).unwrap();
    // four lines of 1.2 m, 0.2 m apart
    let raster = dry_run(
        &mission("[[leg]]\nraster = { corner_m = [4.2, 2.6, 0.8], opposite_m = [5.4, 3.4, 0.8], pitch_m = 0.2 }"),
        &config(),
        [4.2, 2.7, 0.8],
    )
    .unwrap();
    assert!((raster.length_m - (4.0 * 1.2 + 3.0 * 0.2)).abs() < 1e-9, "{raster:?}");
    assert_eq!(raster.segments, 7);
    assert!(summary.duration_s > raster.duration_s + 2.0 * 1.5 + 4.0 * 1.0 + 3.0 * 0.7);
    let (all_j, part_j) = (summary.energy_j.unwrap(), raster.energy_j.unwrap());
    assert!(part_j > 0.0 && all_j > part_j);
    // Holding costs too: a stay of ten seconds about a third of ten stays of three.
    let dwell = |duration_s: f64| {
        let text = format!("[[leg]]\ndwell = {{ duration_s = {duration_s} }}");
        dry_run(&mission(&text), &config(), START_M).unwrap().energy_j.unwrap()
    };
    assert!(dwell(10.0) > 0.0 && (dwell(30.0) - 3.0 * dwell(10.0)).abs() < 1e-9);
}

#[test]
fn a_scan_beyond_the_limits_is_rejected_with_place_and_excess() {
    let refusal = |leg: &str| dry_run(&mission(&format!("[[leg]]\n{leg}")), &config(), START_M).unwrap_err();
    let cause = |leg: &str| match refusal(leg) {
        PlanError::Refused { leg: 1, refusal, .. } => {
            assert!(refusal.path_s_m >= 0.0 && refusal.position.iter().all(|value| value.is_finite()), "{refusal}");
            refusal.cause
        }
        other => panic!("{leg}: {other:?}"),
    };
    let pattern = |leg: &str| match refusal(leg) {
        PlanError::Scan { leg: 1, error } => error,
        other => panic!("{leg}: {other:?}"),
    };
    let wide = cause("raster = { corner_m = [4, 3, 0.5], opposite_m = [9.7, 4, 0.5], pitch_m = 0.2 }");
    assert!(matches!(wide, Cause::Tension(_)), "{wide:?}");
    let tilted = pattern("raster = { corner_m = [4, 3, 0.5], opposite_m = [5, 4, 0.6], pitch_m = 0.2 }");
    assert_eq!(tilted, ScanError::Box);
    let across = pattern("raster = { corner_m = [4, 3, 0.5], opposite_m = [5, 4, 0.5], pitch_m = 0.2, along = \"z\" }");
    assert_eq!(across, ScanError::Across { axis: "z" });
    let fine = pattern("raster = { corner_m = [4, 3, 0.5], opposite_m = [5, 4, 0.5], pitch_m = 0.001 }");
    assert!(matches!(fine, ScanError::TooFine { lines } if (1000.0..=1001.0).contains(&lines)), "{fine:?}");
    let planar = refusal("raster = { corner_m = [4, 0.5], opposite_m = [5, 1.5], pitch_m = 0.2 }");
    assert!(matches!(planar, PlanError::Point { leg: 1, .. }), "{planar:?}");
    let below = cause("profile = { at_m = [4.8, 3, 0.5], rise_m = -0.9 }");
    assert!(matches!(below, Cause::Ground { below_m, .. } if below_m > 0.0), "{below:?}");
    let high = cause("transect = { from_m = [4.8, 3, 0.5], to_m = [4.8, 3, 2.95], dwell_s = 1 }");
    assert!(matches!(high, Cause::Tension(limit) if limit.limit_n == 60.0 && limit.excess_n() > 0.0), "{high:?}");
    let stay = cause("dwell_points = { points_m = [[4.8, 3, 0.5], [5, 3, -0.5]], duration_s = 1 }");
    assert!(matches!(stay, Cause::Ground { below_m, .. } if below_m > 0.0), "{stay:?}");
}

#[test]
fn continuing_needs_the_same_mission_begun_and_not_done() {
    let scan = mission(EVERYTHING);
    let mut world = World::at(START_M);
    let mut planner = Planner::new(config());
    let refused = |planner: &mut Planner, world: &World, mission: &Mission| {
        planner.go_on(mission, &world.seen()).unwrap_err().reason()
    };
    let name = detail(&scan.name);
    assert_eq!(refused(&mut planner, &world, &scan), Reason::MissionNotBegun { mission: name });
    planner.run(&scan, &world.seen()).unwrap();
    assert_eq!(world.fly(&mut planner, 20.0).state, PlanStatus::STATE_ABORTED);
    // a single move in between changes nothing
    let share = std::mem::take(&mut world.share);
    planner.goto([4.9, 3.0, 0.6], None, planner::mission::PathShape::Line, None, &world.seen()).unwrap();
    let end_s = planner.step(&world.seen()).0.end_s;
    assert_eq!(world.fly(&mut planner, end_s + 0.1).state, PlanStatus::STATE_DONE);
    (world.estimate.position_m, world.share) = ([4.9, 3.0, 0.6], share);
    let other = Mission { speed_m_s: Some(0.1), ..scan.clone() };
    assert_eq!(refused(&mut planner, &world, &other), Reason::MissionChanged { mission: name });
    let mut elsewhere = Planner::new(PlannerConfig { check_step_m: 0.05, ..config() });
    let moved = Progress { at_m: [1.0, 1.0, 1.0], ..planner.progress().unwrap().clone() };
    elsewhere.remember(moved);
    let (_, status) = elsewhere.step(&world.seen());
    assert_eq!(Reason::from_status(&status), Some(Reason::LeftUnfinished { mission: name }));
    assert_eq!(refused(&mut elsewhere, &world, &scan), Reason::PlanOther);
    // by request
    let run = tempfile::tempdir().unwrap();
    let hash = config::store_mission(run.path(), &toml::to_string(&scan).unwrap()).unwrap();
    let request = Request::Run { mission: "scan".to_owned(), hash, continues: true }.encode().unwrap();
    let reason = requests::answer(&mut planner, &request, || true, run.path(), &world.seen());
    assert!(matches!(reason, Reason::Planned { continues: true, .. }), "{reason:?}");
    let end_s = planner.step(&world.seen()).0.end_s;
    let done = world.fly(&mut planner, end_s + 0.1);
    assert_eq!((done.state, done.progress), (PlanStatus::STATE_DONE, 1.0));
    assert_eq!(refused(&mut planner, &world, &scan), Reason::MissionDone { mission: name });
}

const ADAPTIVE: &str = r#"
[[leg]]
raster = { corner_m = [4.2, 2.6, 0.8], opposite_m = [5.7, 3.8, 0.8], pitch_m = 0.3, along = "x" }
[[leg]]
adaptive = { map = "height", corner_m = [4.2, 2.6, 0.8], opposite_m = [5.7, 3.8, 0.8], pitch_m = 0.05, tile_m = 0.15, speed_m_s = 0.3 }
[[leg]]
line = { to_m = [4.8, 3.0, 0.5] }
"#;

/// A map of level ground with a block on it from (4.6, 3.0) on to x = 5.2 and y = 3.5.
fn block(stamp_ns: u64) -> Box<FieldMap> {
    let mut map =
        Box::new(FieldMap { origin_m: [4.0, 2.5], cell_m: 0.05, columns: 40, rows: 30, ..FieldMap::default() });
    map.header.stamp_ns = stamp_ns;
    for at in 0..1200 {
        let (x, y) = (4.025 + 0.05 * (at % 40) as f64, 2.525 + 0.05 * (at / 40) as f64);
        map.value[at] = if (4.6..5.2).contains(&x) && (3.0..3.5).contains(&y) { 0.3 } else { 0.0 };
        map.sigma[at] = 0.01;
    }
    map
}

#[test]
fn an_adaptive_leg_waits_for_its_map_and_continues_after_an_interruption() {
    let (scan, config) = (mission(ADAPTIVE), config());
    let mut world = World::at(START_M);
    let mut planner = Planner::new(config);
    let planned = planner.run(&scan, &world.seen()).unwrap();
    assert_eq!(planner.wants_map(), Some("height"));
    let all_j = dry_run(&scan, &config, START_M).unwrap().energy_j.unwrap();
    // The sentence itself: the energy of the present and of the later legs together.
    assert!(matches!(planned, Reason::Planned { continues: false, later: Some(_), .. }), "{planned}");
    assert!(planned.sentence().ends_with(&format!(", {all_j:.0} J in all")), "{planned}");
    let (first, status) = planner.step(&world.seen());
    assert_eq!((status.leg, status.legs), (1, 3));
    let waiting = world.fly(&mut planner, first.end_s + 0.1);
    assert!(waiting.state == PlanStatus::STATE_RUNNING && waiting.progress < 1.0 && waiting.time_left_s > 0.0);
    // a map that was made before the legs had ended does not know all of them
    let now_ns = world.seen().now_ns;
    let old = block(now_ns - 1);
    assert_eq!(planner.step(&Inputs { map: Some(&old), ..world.seen() }).0.motion, first.motion);
    let mut none = planner.clone();
    let new = block(now_ns + 1);
    let (motion, status) = planner.step(&Inputs { map: Some(&new), ..world.seen() });
    assert_eq!((motion.motion, planner.wants_map()), (first.motion + 1, None));
    assert_eq!(motion.asked_ns, first.asked_ns, "it is of the same request");
    assert_eq!((status.leg, status.legs, status.state), (2, 3, PlanStatus::STATE_READY));
    let coarse_s = first.end_s - first.current.start_s;
    assert!(status.progress >= waiting.progress && (status.elapsed_s - coarse_s).abs() < 1e-9, "{status:?}");
    let second = planner.segments().to_vec();
    let whole = dry_run(&scan, &config, START_M).unwrap();
    let (coarse_m, fine_m) = (4.0 * 1.5 + 3.0 * 0.3, measured_m(&second));
    assert!(fine_m + coarse_m < 0.75 * whole.length_m, "{fine_m} m of {} m", whole.length_m);
    for edge in [[4.6, 3.2], [5.2, 3.2], [4.9, 3.0], [4.9, 3.5]] {
        let at = Vector3::new(edge[0], edge[1], 0.8);
        let from = |segment: &Segment| {
            let steps = 0..=(segment.path.length() / 0.01) as usize;
            steps.map(|step| (segment.path.point(0.01 * step as f64) - at).norm()).fold(f64::INFINITY, f64::min)
        };
        assert!(second.iter().map(from).fold(f64::INFINITY, f64::min) < 0.04, "{edge:?} is not looked at again");
    }
    // broken off in the middle of the fine lines, and everything ends
    world.estimate.position_m = second[0].path.start().into();
    let until_s = 0.5 * (motion.current.start_s + motion.end_s);
    let broken = world.fly(&mut planner, until_s);
    assert_eq!(broken.state, PlanStatus::STATE_ABORTED);
    let kept = toml::to_string(planner.progress().unwrap()).unwrap();
    let mut again = Planner::new(config);
    again.remember(toml::from_str(&kept).unwrap());
    let here = position(&second, until_s);
    world = World { share: world.share, ..World::at(here.into()) };
    let planned = again.go_on(&scan, &world.seen()).unwrap();
    assert!(matches!(planned, Reason::Planned { continues: true, .. }) && again.wants_map().is_none(), "{planned}");
    let (_, status) = world.step(&mut again);
    assert!((status.elapsed_s - broken.elapsed_s).abs() < 1e-6 && status.progress > 0.5, "{status:?}");
    let rest = again.segments().to_vec();
    assert!((rest[0].path.start() - here).norm() < 0.002);
    let flown_m: f64 = second
        .iter()
        .filter(|segment| segment.start_s < until_s)
        .map(|segment| segment.profile.at((until_s - segment.start_s).min(segment.profile.duration())).s_m)
        .sum();
    assert!((measured_m(&rest) - (fine_m - flown_m)).abs() < 0.005);
    let end_s = again.step(&world.seen()).0.end_s;
    assert_eq!(world.fly(&mut again, end_s + 0.1).state, PlanStatus::STATE_DONE);
    assert!(again.progress().unwrap().done);
    // no process makes a map
    let still = World::at(START_M);
    let late = Inputs { now_ns: now_ns + 60_000_000_000, ..still.seen() };
    let mut authority = MotorAuthority { plan_time_s: first.end_s + 1.0, ..still.authority };
    authority.header.stamp_ns = late.now_ns;
    let (_, status) = none.step(&Inputs { authority: Some(&authority), ..late });
    assert_eq!(status.state, PlanStatus::STATE_ABORTED);
    let without_map = Reason::EndedWithoutMap { map: detail("height"), within_s: 20.0 };
    assert_eq!(Reason::from_status(&status), Some(without_map));
}

/// A second adaptive leg, of another map, and a leg after it.
const TWICE: &str = r#"
[[leg]]
raster = { corner_m = [4.2, 2.6, 0.8], opposite_m = [5.7, 3.8, 0.8], pitch_m = 0.3, along = "x" }
[[leg]]
adaptive = { map = "level", corner_m = [4.2, 2.6, 0.8], opposite_m = [5.7, 3.8, 0.8], pitch_m = 0.05, tile_m = 0.15, speed_m_s = 0.3 }
[[leg]]
adaptive = { map = "height", corner_m = [4.2, 2.6, 0.8], opposite_m = [5.7, 3.8, 0.8], pitch_m = 0.05, tile_m = 0.15, speed_m_s = 0.3 }
[[leg]]
line = { to_m = [4.8, 3.0, 0.5] }
"#;

/// The same map without the block.
fn level(stamp_ns: u64) -> Box<FieldMap> {
    let mut map = block(stamp_ns);
    map.value.fill(0.0);
    map
}

/// A map without a part that is worth a second look ends its own leg, and not the mission.
#[test]
fn the_next_adaptive_leg_is_flown_after_one_with_nothing_to_look_at() {
    let mut world = World::at(START_M);
    let mut planner = Planner::new(config());
    planner.run(&mission(TWICE), &world.seen()).unwrap();
    let (first, _) = planner.step(&world.seen());
    world.fly(&mut planner, first.end_s + 0.1);
    assert_eq!(planner.wants_map(), Some("level"));
    let map = level(world.seen().now_ns + 1);
    let (stay, status) = planner.step(&Inputs { map: Some(&map), ..world.seen() });
    assert_eq!((status.leg, status.legs, status.state), (2, 4, PlanStatus::STATE_READY));
    assert_eq!((planner.wants_map(), planner.segments().len()), (Some("height"), 1));
    world.estimate.position_m = planner.segments()[0].path.end().into();
    world.fly(&mut planner, stay.end_s + 0.1);
    let map = block(world.seen().now_ns + 1);
    let (_, status) = planner.step(&Inputs { map: Some(&map), ..world.seen() });
    assert_eq!((status.leg, status.legs, planner.wants_map()), (3, 4, None));
    // The coarse lines before the stay still tell where the block is.
    let way = planner.segments();
    let fine_m = measured_m(way);
    assert!(fine_m > 5.0, "{fine_m}");
    assert!((way[way.len() - 1].path.end() - Vector3::new(4.8, 3.0, 0.5)).norm() < 1e-9);
}

/// A node that is already where the legs before the first map end waits there, instead of a refusal.
#[test]
fn an_adaptive_leg_is_flown_where_the_legs_before_it_have_no_way() {
    let world = World::at(START_M);
    let mut planner = Planner::new(config());
    let [x, y, z] = START_M;
    let [_, rest] = ADAPTIVE.split("[[leg]]\nadaptive").collect::<Vec<_>>()[..] else { unreachable!() };
    let there = mission(&format!("[[leg]]\nline = {{ to_m = [{x}, {y}, {z}] }}\n[[leg]]\nadaptive{rest}"));
    planner.run(&there, &world.seen()).unwrap();
    assert_eq!((planner.wants_map(), planner.segments().len()), (Some("height"), 1));
}

/// After an interruption too, the lines of all parts say where the next map has samples.
#[test]
fn a_continued_mission_knows_its_earlier_lines_in_the_next_map() {
    // Flies until a time, and gets a map with a step at x = 5.6; the length of what it chooses, m.
    let chosen_m = |planner: &mut Planner, world: &mut World, end_s: f64| {
        world.fly(planner, end_s + 0.1);
        assert_eq!(planner.wants_map(), Some("height"));
        let mut map = level(world.seen().now_ns + 1);
        (0..1200).filter(|at| at % 40 >= 32).for_each(|at| map.value[at] = 0.3);
        let (_, status) = planner.step(&Inputs { map: Some(&map), ..world.seen() });
        assert_eq!((status.leg, status.legs, status.state), (3, 4, PlanStatus::STATE_READY));
        measured_m(planner.segments())
    };
    let scan = mission(TWICE);
    let (mut world, mut planner) = (World::at(START_M), Planner::new(config()));
    planner.run(&scan, &world.seen()).unwrap();
    let (first, _) = planner.step(&world.seen());
    world.fly(&mut planner, first.end_s + 0.1);
    let map = block(world.seen().now_ns + 1);
    let (second, _) = planner.step(&Inputs { map: Some(&map), ..world.seen() });
    let fine = planner.segments().to_vec();
    let mut other = World { share: world.share, ..World::at(START_M) };
    other.authority = world.authority;
    let unbroken_m = chosen_m(&mut planner.clone(), &mut other, second.end_s);
    let until_s = 0.5 * (second.current.start_s + second.end_s);
    assert_eq!(world.fly(&mut planner, until_s).state, PlanStatus::STATE_ABORTED);
    let text = toml::to_string(planner.progress().unwrap()).unwrap();
    let progress: Progress = toml::from_str(&text).unwrap();
    // Parts that are no plan together: they reach below the ground.
    let mut broken = progress.before.clone().unwrap();
    broken.start_m[2] = -5.0;
    assert!(Plan::new(&broken.mission, &config(), broken.start_m.into(), 0.0, 1).is_err());
    // A file of an earlier version does not have them.
    for (before, all) in [(progress.before.clone(), true), (None, false), (Some(broken), false)] {
        let mut again = Planner::new(config());
        again.remember(Progress { before, ..progress.clone() });
        world = World { share: world.share, ..World::at(position(&fine, until_s).into()) };
        again.go_on(&scan, &world.seen()).unwrap();
        let (rest, _) = world.step(&mut again);
        let mut here = World { share: world.share, ..World::at(START_M) };
        here.authority = world.authority;
        let continued_m = chosen_m(&mut again, &mut here, rest.end_s);
        assert_eq!((continued_m - unbroken_m).abs() < 1e-9, all, "{continued_m} m instead of {unbroken_m} m");
    }
}

/// Broken off again and again while it waits for its map, and found elsewhere, a mission still waits at the same leg.
#[test]
fn a_mission_that_waits_for_its_map_is_continued_as_often_as_it_is_broken_off() {
    let scan = mission(&format!("[[leg]]\nline = {{ to_m = [4.3, 2.7, 0.8] }}\n{ADAPTIVE}"));
    let mut world = World::at(START_M);
    let mut planner = Planner::new(config());
    planner.run(&scan, &world.seen()).unwrap();
    let end_m: [f64; 3] = planner.segments().last().unwrap().path.end().into();
    let (first, _) = planner.step(&world.seen());
    world.fly(&mut planner, first.end_s + 0.1);
    for away_m in [0.0, 0.2, 0.4] {
        world.authority.epoch += 1;
        assert_eq!(world.step(&mut planner).1.state, PlanStatus::STATE_ABORTED);
        let text = toml::to_string(planner.progress().unwrap()).unwrap();
        planner = Planner::new(config());
        planner.remember(toml::from_str(&text).unwrap());
        world = World { share: world.share, ..World::at([end_m[0], end_m[1] + away_m, end_m[2]]) };
        planner.go_on(&scan, &world.seen()).unwrap();
        let (stay, status) = world.step(&mut planner);
        assert_eq!((planner.wants_map(), status.leg, status.legs), (Some("height"), 2, 4), "{away_m}");
        assert_eq!(world.fly(&mut planner, stay.end_s + 0.1).state, PlanStatus::STATE_RUNNING);
    }
    let map = block(world.seen().now_ns + 1);
    let (_, status) = planner.step(&Inputs { map: Some(&map), ..world.seen() });
    assert_eq!((status.leg, status.legs, planner.wants_map()), (3, 4, None));
    assert!(measured_m(planner.segments()) > 5.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Broken off twice anywhere, by whatever, and found elsewhere: what is flown then is what was left, no more and no
    /// less.
    #[test]
    fn after_an_interruption_exactly_the_rest_is_flown(
        first in 0.0..1.0f64,
        second in 0.0..1.0f64,
        away in prop_oneof![Just(0.0), 0.0..0.003f64, 0.003..0.3f64],
    ) {
        let (scan, config) = (mission(EVERYTHING), config());
        let whole = Plan::new(&scan, &config, Vector3::from(START_M), 2.0, 1).unwrap();
        let mut world = World::at(START_M);
        let mut planner = Planner::new(config);
        planner.run(&scan, &world.seen()).unwrap();
        let mut left_m = measured_m(&whole.segments);
        let mut left_s = dwelt_s(&whole.segments);
        let mut segments = whole.segments.clone();
        for share in [first, second] {
            let (begin_s, end_s) = (segments[0].start_s, segments[segments.len() - 1].end_s());
            let until_s = begin_s + share * (end_s - begin_s);
            let status = world.fly(&mut planner, until_s);
            prop_assert!(status.state == PlanStatus::STATE_ABORTED);
            let stopped_at = position(&segments, until_s);
            let text = toml::to_string(planner.progress().unwrap()).unwrap();
            // everything ends; another planner knows what was kept
            planner = Planner::new(config);
            planner.remember(toml::from_str(&text).unwrap());
            world = World { share: world.share, ..World::at([stopped_at.x, stopped_at.y, stopped_at.z + away]) };
            if let Err(refusal) = planner.go_on(&scan, &world.seen()) {
                let done = Reason::MissionDone { mission: detail(&scan.name) };
                prop_assert!(refusal.reason() == done && (stopped_at - whole.end()).norm() < 0.002);
                return Ok(());
            }
            let rest = planner.segments().to_vec();
            let here = Vector3::from(world.estimate.position_m);
            // From where it is there is a way back, but not for less than a millimetre; what is left may be less than
            // that, too.
            let off_m = (rest[0].path.start() - here).norm();
            let back = usize::from(away > 0.0 && off_m < 1e-9);
            prop_assert!(off_m < 0.001 && (back == 1 || away < 0.002), "begins {off_m} m off");
            let done = planner.progress().unwrap().at_m;
            // The way back goes to where it was, unless what is left there is shorter than a millimetre or a stay too
            // short to fly.
            let begins = rest[back].path.start();
            prop_assert!((begins - Vector3::from(done)).norm() < 0.002, "{begins:?} {done:?}");
            let (now_m, now_s) = (measured_m(&rest[back..]), dwelt_s(&rest));
            let passed: f64 = segments.iter().filter(|s| s.start_s < until_s).map(|s| {
                if matches!(s.path, Path::Dwell(_)) { 0.0 } else { s.profile.at((until_s - s.start_s).min(s.profile.duration())).s_m }
            }).sum();
            let way_back_m = measured_m(&segments) - left_m;
            let flown_m = (passed - way_back_m).max(0.0);
            prop_assert!((now_m - (left_m - flown_m)).abs() < 0.003, "{now_m} of {left_m}, flown {flown_m}");
            prop_assert!(now_s <= left_s + 1e-9);
            for pair in rest.windows(2) {
                prop_assert!((pair[0].path.end() - pair[1].path.start()).norm() < 1e-9);
                prop_assert!((pair[0].end_s() - pair[1].start_s).abs() < 1e-9);
            }
            prop_assert!((rest[rest.len() - 1].path.end() - whole.end()).norm() < 1e-9);
            (left_m, left_s, segments) = (now_m, now_s, rest);
        }
    }
}
