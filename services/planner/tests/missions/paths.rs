//! Paths of least loss, and random missions.

use crate::world::{World, config, config_of, mission, parts, sound};
use cable_robot::energy::{WinchEnergy, flight};
use cable_robot::profile::ProfileLimits;
use cable_robot::{Distribution, Path, RobotParts, Segment, Vector3};
use messages::PlanStatus;
use planner::Planner;
use planner::mission::{Leg, Line, Mission, MissionError, Parabola, PathShape, Polyline, Spiral};
use planner::plan::Plan;
use proptest::prelude::*;
use segments::segment_of;

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
    assert!(matches!(error, MissionError::Malformed(_)), "{error:?}");
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
        let cost_j =
            |path: &Path| flight::flown(robot, method, path, &limits, Some(0.02), 64).map(|cost| cost.energy_j);
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Where the line is impossible, the best sag is often the least one that is possible, above all if time is dear.
    #[test]
    fn a_move_that_a_range_of_sags_permits_is_flown(
        from in [4.0..6.0f64, 1.5..3.0f64, 1.7..2.1f64], way in [-3.0..-1.0f64, -1.0..1.0f64, -0.1..0.1f64],
        share in 0.05..0.95f64, time_weight_w in prop_oneof![Just(0.0), Just(1000.0)],
    ) {
        let (from, to) = (Vector3::from(from), Vector3::from(from) + Vector3::from(way));
        let free = config();
        let peak_n = |mu_per_m: f64| {
            let path = flight::parabola_or_line(&cable_robot::path::Parabola { from, to, mu_per_m });
            let profile = cable_robot::Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.3)).unwrap();
            let segment = Segment { id: 1, path, profile, start_s: 0.0 };
            segment.check(&free.robot, free.distribution, 0.02).map_or(f64::INFINITY, |report| report.peak_tension_n)
        };
        // A limit between the highest tension on the line and the least one of all sags.
        let deepest = cable_robot::energy::parabola::mu_limit(&from, &to, free.robot.ground_m()).unwrap().unwrap();
        let peaks: Vec<f64> = (0..=80).map(|i| peak_n(deepest * f64::from(i) / 80.0)).collect();
        let least_n = peaks.iter().copied().fold(f64::INFINITY, f64::min);
        prop_assume!(peaks[0].is_finite() && peaks[0] > 1.001 * least_n);
        let limit_n = least_n + share * (peaks[0] - least_n);
        let permitted = peaks.windows(3).any(|three| three.iter().all(|peak_n| *peak_n < limit_n));
        prop_assume!(permitted);
        let config = config_of(RobotParts { tension_limits_n: [2.0, limit_n], ..parts() });
        let text = format!("time_weight_w = {time_weight_w:?}\n[[leg]]\nparabola = {{ to_m = [{}, {}, {}] }}", to.x, to.y, to.z);
        let plan = Plan::new(&mission(&text), &config, from, 0.0, 1);
        prop_assert!(plan.is_ok(), "{limit_n} N: {}", plan.unwrap_err());
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
