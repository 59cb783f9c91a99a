//! Motions: setpoints over time, and refusals with position, cable and excess.

use cable_robot::motion::Cause;
use cable_robot::motor::DriveLimits;
use cable_robot::path::{Parabola, Spiral};
use cable_robot::profile::ProfileLimits;
use cable_robot::{
    Distribution, Motion, Obstacle, Path, Profile, Robot, RobotParts, Segment, Vector3, kinematics, tension,
};
use proptest::prelude::*;

fn parts() -> RobotParts {
    RobotParts {
        anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
        node_mass_kg: 1.2,
        tension_limits_n: [1.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; 3]),
        ..RobotParts::default()
    }
}

fn segment(id: u64, path: Path, start_s: f64) -> Segment {
    let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
    Segment { id, path, profile, start_s }
}

fn at(x: f64, y: f64, z: f64) -> Vector3<f64> {
    Vector3::new(x, y, z)
}

fn check(parts: RobotParts, segment: &Segment) -> Result<cable_robot::motion::Report, cable_robot::motion::Refusal> {
    segment.check(&Robot::new(parts).unwrap(), Distribution::Unique, 0.01)
}

fn paths() -> impl Strategy<Value = Path> {
    let point = || [3.0..6.0f64, 2.0..4.0f64, 0.3..1.5f64].prop_map(Vector3::from);
    prop_oneof![
        (point(), point()).prop_map(|(a, b)| Path::line(a, b)),
        (point(), point(), 0.0..0.2f64).prop_map(|(from, to, mu_per_m)| Path::Parabola(Parabola {
            from,
            to,
            mu_per_m
        })),
        (point(), 0.1..3.0f64).prop_map(|(centre, turns)| Path::Spiral(Spiral {
            centre,
            start_radius_m: 0.0,
            end_radius_m: 0.6,
            turns,
            rise_m: 0.5,
            start_angle_rad: 1.0
        })),
    ]
    .prop_filter("a path", |p| p.check().is_ok() && p.length() > 0.1)
}

proptest! {
    #[test]
    fn velocity_and_acceleration_are_the_derivatives(path in paths(), u in 0.001..0.999f64) {
        let s = segment(1, path, 3.0);
        let t = 3.0 + u * s.profile.duration();
        let h = 1e-5;
        let (a, m, b) = (s.setpoint(t - h), s.setpoint(t), s.setpoint(t + h));
        prop_assert!(((b.position - a.position) / (2.0 * h) - m.velocity).norm() < 1e-4);
        // Acceleration jumps at knots; elsewhere it is the derivative.
        if (a.acceleration - b.acceleration).norm() < 1e-2 {
            prop_assert!(((b.velocity - a.velocity) / (2.0 * h) - m.acceleration).norm() < 2e-2);
        }
        prop_assert!(m.velocity.norm() <= 0.2 + 1e-9 && m.acceleration.norm() <= 0.4 * 1.01);
        prop_assert!(!m.at_rest);
    }

    #[test]
    fn no_setpoint_jumps(path in paths(), next in paths()) {
        // The successor starts where the first ends.
        let first = segment(1, path, 1.0);
        let shifted = Path::line(path.end(), path.end() + (next.end() - next.start()).normalize() * 0.3);
        let second = segment(2, shifted, first.end_s() + 0.5);
        let motion = Motion { current: first, next: Some(second) };
        let end = motion.end_s() + 1.0;
        let n = 3000;
        let mut before = motion.setpoint(0.0);
        for i in 1..=n {
            let now = motion.setpoint(end * i as f64 / n as f64);
            let dt = end / n as f64;
            prop_assert!((now.position - before.position).norm() <= 0.2 * dt + 1e-9);
            prop_assert!((now.velocity - before.velocity).norm() <= 0.45 * dt + 1e-6);
            before = now;
        }
        prop_assert!((before.position - shifted.end()).norm() < 1e-12 && before.at_rest);
        prop_assert_eq!(before.velocity, Vector3::zeros());
    }

    #[test]
    fn accepted_segments_keep_their_limits_everywhere(path in paths()) {
        let robot = Robot::new(parts()).unwrap();
        let s = segment(1, path, 0.0);
        let Ok(report) = s.check(&robot, Distribution::Unique, 0.01) else { return Ok(()) };
        for i in 0..=500 {
            let p = s.setpoint(s.profile.duration() * i as f64 / 500.0);
            let t = tension::at(&robot, &p.position, &p.acceleration, Distribution::Unique).unwrap().tensions_n;
            for rate in [0.0, 0.3, 0.7] {
                let slowed = p.acceleration * (rate * rate);
                prop_assert!(tension::at(&robot, &p.position, &slowed, Distribution::Unique).is_ok());
            }
            prop_assert!(t.iter().all(|t| *t <= report.peak_tension_n * 1.02 && *t >= report.least_tension_n * 0.98));
            let speeds = kinematics::Jacobian::at(robot.anchors(), &p.position).unwrap().cable_velocity(&p.velocity);
            prop_assert!(speeds.max_abs() <= report.peak_cable_speed_m_s * 1.01 + 1e-9);
        }
    }
}

#[test]
fn a_motion_rests_before_its_start_and_after_its_end() {
    let path = Path::line(at(4.0, 2.0, 1.0), at(5.0, 3.0, 1.2));
    let motion = Motion { current: segment(7, path, 10.0), next: None };
    let before = motion.setpoint(-5.0);
    assert_eq!(
        (before.position, before.velocity, before.acceleration),
        (at(4.0, 2.0, 1.0), Vector3::zeros(), Vector3::zeros())
    );
    assert!(before.at_rest && before.segment_id == 7);
    let after = motion.setpoint(1e6);
    assert_eq!(
        (after.position, after.velocity, after.acceleration),
        (at(5.0, 3.0, 1.2), Vector3::zeros(), Vector3::zeros())
    );
    assert!(after.at_rest && (after.path_s_m - path.length()).abs() < 1e-12);
    // A clock that is not a number does not move it.
    assert_eq!(motion.setpoint(f64::NAN).velocity, Vector3::zeros());
}

#[test]
fn a_good_segment_is_accepted_with_its_margins() {
    let report = check(parts(), &segment(1, Path::line(at(4.0, 2.0, 0.5), at(5.5, 3.5, 1.0)), 0.0)).unwrap();
    assert!(report.least_tension_n >= 1.0 && report.peak_tension_n <= 60.0);
    assert!(report.peak_cable_speed_m_s <= 0.2 && report.peak_cable_speed_m_s > 0.05);
    assert!(report.shortest_m.iter().zip(report.longest_m.iter()).all(|(a, b)| a < b && *a > 1.0));
}

#[test]
fn every_refusal_names_its_position_and_cause() {
    let fine = segment(1, Path::line(at(4.0, 2.0, 0.5), at(5.5, 3.5, 1.0)), 0.0);
    let up = segment(1, Path::line(at(4.5, 3.0, 1.0), at(4.5, 3.0, 2.95)), 0.0);
    let out = segment(1, Path::line(at(4.5, 3.0, 1.0), at(4.5, -3.0, 1.0)), 0.0);
    let down = segment(1, Path::line(at(4.5, 3.0, 1.0), at(4.5, 3.0, -0.2)), 0.0);
    let dwell =
        Segment { id: 1, path: Path::Dwell(at(4.5, 3.0, -0.2)), profile: Profile::dwell(2.0).unwrap(), start_s: 0.0 };
    let boxed = RobotParts { keep_out_m: vec![[[9.0; 3], [9.5; 3]], [[4.7, 2.7, 0.6], [4.72, 2.72, 0.9]]], ..parts() };
    let slow = RobotParts { speed_limit_m_s: 0.1, ..parts() };
    let reluctant = RobotParts { cable_speed_limit_m_s: Some(0.1), ..parts() };
    let gentle = RobotParts { acceleration_limit_m_s2: 0.2, ..parts() };
    let short = RobotParts { length_limits_m: Some(vec![[0.5, 5.5]; 3]), ..parts() };
    type Expected = fn(&Cause) -> bool;
    let cases: [(_, Expected, &[&str]); 11] = [
        (check(parts(), &up), |cause| matches!(cause, Cause::Tension(v) if v.tension_n > v.limit_n), &["60.00 N"]),
        (check(parts(), &out), |cause| matches!(cause, Cause::Tension(v) if v.tension_n < v.limit_n), &["1.00 N"]),
        (check(parts(), &down), |cause| matches!(cause, Cause::Ground { .. }), &["0.000 m"]),
        (check(parts(), &dwell), |cause| matches!(cause, Cause::Ground { .. }), &["0.000 m", "0.200 m"]),
        (check(boxed, &fine), |cause| matches!(cause, Cause::KeepOut { number: 1 }), &["2"]),
        (check(slow, &fine), |cause| matches!(cause, Cause::NodeSpeed { .. }), &["0.100 m/s"]),
        (
            check(reluctant, &fine),
            |cause| matches!(cause, Cause::CableSpeed { .. }),
            &["cable_speed_limit_m_s", "0.100 m/s"],
        ),
        (check(gentle, &fine), |cause| matches!(cause, Cause::NodeAcceleration { .. }), &["0.200 m/s²"]),
        (check(short, &fine), |cause| matches!(cause, Cause::Length { .. }), &["0.500", "5.500 m"]),
        (
            check(parts(), &Segment { profile: up.profile, ..fine }),
            |cause| matches!(cause, Cause::LengthMismatch { .. }),
            &["1.95"],
        ),
        (
            check(parts(), &Segment { start_s: f64::NAN, ..fine }),
            |cause| matches!(cause, Cause::BadStart { .. }),
            &["NaN"],
        ),
    ];
    for (result, expected, numbers) in cases {
        let refusal = result.unwrap_err();
        assert!(expected(&refusal.cause), "{refusal:?}");
        let (sentence, cause, place) = (refusal.to_string(), refusal.cause.to_string(), refusal.position);
        assert!(numbers.iter().all(|number| cause.contains(number)), "{cause}");
        let place = format!("({:.3}, {:.3}, {:.3}) m", place.x, place.y, place.z);
        assert!(sentence.contains(&place) && sentence.contains(&format!("{:.3} m", refusal.path_s_m)), "{sentence}");
        assert!(sentence.ends_with(&cause), "{sentence}");
    }
}

#[test]
fn a_refusal_names_the_first_bad_position() {
    let up = segment(1, Path::line(at(4.5, 3.0, 1.0), at(4.5, 3.0, 2.95)), 0.0);
    let robot = Robot::new(parts()).unwrap();
    let refusal = up.check(&robot, Distribution::Unique, 0.001).unwrap_err();
    let Cause::Tension(violation) = refusal.cause else { panic!("{refusal}") };
    assert!(violation.excess_n() < 1.0 && violation.limit_n == 60.0, "{refusal}");
    let just_before = refusal.position - at(0.0, 0.0, 0.01);
    assert!(tension::at(&robot, &just_before, &Vector3::zeros(), Distribution::Unique).is_ok());
}

#[test]
fn a_thin_box_between_samples_is_detected() {
    let fine = segment(1, Path::line(at(4.0, 2.0, 0.5), at(5.5, 3.5, 1.0)), 0.0);
    let thin = RobotParts { keep_out_m: vec![[[4.7503, 2.0, 0.0], [4.7504, 3.5, 3.0]]], ..parts() };
    let refusal = fine.check(&Robot::new(thin).unwrap(), Distribution::Unique, 0.2).unwrap_err();
    assert_eq!(refusal.cause, Cause::KeepOut { number: 0 });
}

/// Largest current and voltage of any motor along a segment, in motion and if the node rests there, from the formulas
/// of the robot file at 2,000 instants.
fn motor_peaks(robot: &Robot, segment: &Segment) -> [f64; 2] {
    let m = robot.motor();
    let mut peaks = [0.0f64; 2];
    for i in 0..=2000 {
        let setpoint = segment.setpoint(segment.start_s + segment.profile.duration() * f64::from(i) / 2000.0);
        let directions: Vec<_> = robot.anchors().iter().map(|a| (a - setpoint.position).normalize()).collect();
        let columns = nalgebra::Matrix3::from_columns(&directions);
        for (velocity, acceleration) in [(setpoint.velocity, setpoint.acceleration), Default::default()] {
            let force = (acceleration + at(0.0, 0.0, cable_robot::STANDARD_GRAVITY)) * robot.node_mass_kg();
            let tensions = columns.lu().solve(&force).unwrap();
            for (direction, tension) in directions.iter().zip(tensions.iter()) {
                let v = direction.dot(&velocity);
                let s = (v / m.transition_m_s).tanh();
                let torque = tension * (1.0 + m.gear_friction * s) + m.coulomb_n * s + m.viscous_n_s_m * v;
                let current = torque / m.force_constant_n_a;
                let voltage = current * m.resistance_ohm + m.force_constant_n_a * v;
                peaks = [peaks[0].max(current.abs()), peaks[1].max(voltage.abs())];
            }
        }
    }
    peaks
}

proptest! {
    #[test]
    fn what_the_motors_cannot_do_is_rejected(path in paths(), current_a in 0.2..1.5f64, voltage_v in 4.0..14.0f64) {
        let segment = segment(1, path, 0.0);
        let free = Robot::new(parts()).unwrap();
        prop_assume!(segment.check(&free, Distribution::Unique, 0.01).is_ok());
        let [peak_a, peak_v] = motor_peaks(&free, &segment);
        let limited = RobotParts { drive_limits: DriveLimits { current_a, voltage_v }, ..parts() };
        match check(limited, &segment) {
            Ok(report) => {
                prop_assert!(peak_a <= current_a * 1.01 && peak_v <= voltage_v * 1.01);
                prop_assert!((report.peak_current_a / peak_a - 1.0).abs() < 0.01, "{} {peak_a}", report.peak_current_a);
                prop_assert!((report.peak_voltage_v / peak_v - 1.0).abs() < 0.01, "{} {peak_v}", report.peak_voltage_v);
            }
            Err(refusal) => match refusal.cause {
                Cause::Current { load, limit_a, .. } => {
                    prop_assert!(limit_a == current_a && load.current_a.abs() > current_a && peak_a > current_a * 0.99);
                }
                Cause::Voltage { load, limit_v, .. } => {
                    prop_assert!(limit_v == voltage_v && load.voltage_v.abs() > voltage_v && peak_v > voltage_v * 0.99);
                }
                other => prop_assert!(false, "{other}"),
            },
        }
    }
}

/// Least distance of the node and of every cable from an obstacle along a segment, m, at 300 instants and 200 points of
/// each cable.
fn least_distance_m(robot: &Robot, segment: &Segment, obstacle: &Obstacle) -> f64 {
    let mut least_m = f64::INFINITY;
    for i in 0..=300 {
        let node = segment.path.point(segment.path.length() * f64::from(i) / 300.0);
        for anchor in robot.anchors().iter() {
            for k in 0..=200 {
                least_m = least_m.min(obstacle.distance_m(&(anchor + (node - anchor) * (f64::from(k) / 200.0))));
            }
        }
    }
    least_m
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn no_accepted_path_brings_node_or_cables_near_a_trunk(
        path in paths(), x in 1.0..8.0f64, y in 0.5..7.0f64, radius_m in 0.1..0.4f64, top_m in 0.5..3.0f64,
    ) {
        const CLEARANCE_M: f64 = 0.15;
        let trunk = Obstacle::cylinder([x, y], radius_m, [0.0, top_m]).unwrap();
        let wood = RobotParts { obstacles: vec![trunk], clearance_m: CLEARANCE_M, ..parts() };
        let robot = Robot::new(wood.clone()).unwrap();
        // At an anchor beside the trunk the clearance is smaller.
        prop_assume!(robot.anchors().iter().all(|anchor| trunk.distance_m(anchor) > 2.5 * CLEARANCE_M));
        let segment = segment(1, path, 0.0);
        prop_assume!(check(parts(), &segment).is_ok());
        let least_m = least_distance_m(&robot, &segment, &trunk);
        match check(wood, &segment) {
            Ok(_) => prop_assert!(least_m >= CLEARANCE_M, "{least_m}"),
            Err(refusal) => {
                let Cause::Obstacle { contact, .. } = refusal.cause else { panic!("{refusal}") };
                prop_assert!(contact.obstacle == 0 && least_m < (CLEARANCE_M + 0.02) * std::f64::consts::SQRT_2, "{least_m}");
            }
        }
    }
}

#[test]
fn a_trunk_carries_its_own_cable_and_is_in_the_way_of_the_others() {
    let segment = segment(1, Path::line(at(4.0, 2.0, 0.5), at(5.5, 3.5, 1.0)), 0.0);
    let wood = |x, y| RobotParts {
        obstacles: vec![Obstacle::cylinder([x, y], 0.2, [0.0, 5.0]).unwrap()],
        clearance_m: 0.1,
        ..parts()
    };
    // Around an anchor, behind it, and between another anchor and the node.
    check(wood(0.0, 0.0), &segment).unwrap();
    check(wood(-0.3, 0.0), &segment).unwrap();
    check(wood(-0.16, -0.16), &segment).unwrap();
    // In front of the anchor, however close.
    for distance in [0.15, 0.21, 0.3, 0.5] {
        let refusal = check(wood(0.9 * distance, 0.45 * distance), &segment);
        let inside = distance < 0.2;
        assert_eq!(refusal.is_ok(), inside, "{distance} m");
    }
    // A wall that carries the pulley, and along which the cable runs.
    let wall = Obstacle::prism(&[[-0.1, -0.1], [4.0, 1.7], [4.0, 1.9], [-0.1, 0.1]], [0.0, 5.0]).unwrap();
    let along = check(RobotParts { obstacles: vec![wall], clearance_m: 0.1, ..parts() }, &segment).unwrap_err();
    let Cause::Obstacle { contact, .. } = along.cause else { panic!("{along}") };
    assert_eq!(contact.cable, Some(0), "{along}");
    let refusal = check(wood(2.0, 1.2), &segment).unwrap_err();
    let Cause::Obstacle { contact, .. } = refusal.cause else { panic!("{refusal}") };
    assert_eq!(contact.cable, Some(0), "{refusal}");
    let refusal = check(wood(5.5, 3.5), &segment).unwrap_err();
    assert!(matches!(refusal.cause, Cause::Obstacle { .. }), "{refusal}");
}
