//! Elastic statics compared with a minimisation of the potential energy that shares no code with them, and with
//! known limiting cases.

use cable_robot::elastic::{equilibrium, realise, stretched, unstretched};
use cable_robot::kinematics::inverse_kinematics;
use cable_robot::{CableVec, Distribution, Robot, RobotParts, Vector3};
use proptest::prelude::*;

fn parts(n: usize) -> RobotParts {
    let four = [[0.0, 0.0, 6.0], [10.4, 0.3, 6.3], [9.7, 8.9, 5.8], [-0.5, 9.4, 6.1]];
    let anchors_m = match n {
        3 | 4 => four[..n].to_vec(),
        _ => (0..n)
            .map(|i| {
                let angle = 2.0 * std::f64::consts::PI * i as f64 / n as f64;
                [5.0 + 5.0 * angle.cos(), 4.5 + 5.0 * angle.sin(), 6.0 + 0.2 * (i % 3) as f64]
            })
            .collect(),
    };
    RobotParts {
        anchors_m,
        node_mass_kg: 2.0,
        tension_limits_n: [1.0, 150.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; n]),
        ..RobotParts::default()
    }
}

fn robot(n: usize) -> Robot {
    Robot::new(parts(n)).unwrap()
}

/// Poses inside the triangle of the first three anchors, so that three cables are taut too.
fn pose() -> impl Strategy<Value = Vector3<f64>> {
    [5.5..8.5f64, 1.5..4.0f64, 0.3..4.5f64].prop_map(Vector3::from)
}

fn acceleration() -> impl Strategy<Value = Vector3<f64>> {
    [-0.5..0.5f64, -0.5..0.5f64, -0.5..0.5f64].prop_map(Vector3::from)
}

/// Energy of stretched cables and weight, J.
fn energy(robot: &Robot, l: &[f64], a: &Vector3<f64>, x: &Vector3<f64>) -> f64 {
    let ea = robot.stiffness_n().unwrap();
    let lines: f64 = (0..robot.cable_count())
        .map(|i| {
            let rest = l[i] + robot.routed_length_m()[i];
            let stretch = ((x - robot.anchors()[i]).norm() - l[i]).max(0.0);
            0.5 * ea / rest * stretch * stretch
        })
        .sum();
    lines + robot.wrench_n(a).dot(x)
}

/// Minimises with shrinking steps along 26 directions: slow, without derivatives.
fn lowest(f: impl Fn(&Vector3<f64>) -> f64, start: Vector3<f64>) -> Vector3<f64> {
    let (mut x, mut best, mut step) = (start, f(&start), 0.3);
    while step > 1e-6 {
        let mut moved = false;
        for code in 0..27 {
            let d = Vector3::new((code % 3) as f64 - 1.0, (code / 3 % 3) as f64 - 1.0, (code / 9) as f64 - 1.0) * step;
            let value = f(&(x + d));
            if value < best {
                (x, best, moved) = (x + d, value, true);
            }
        }
        if !moved {
            step *= 0.6;
        }
    }
    x
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// Small anchor errors displace the node as the covariance predicts.
    #[test]
    fn anchor_covariance_propagates_to_the_position(n in 3usize..=5, rigid in any::<bool>(), x in pose(), seed in proptest::array::uniform15(-1.0..1.0f64)) {
        let mut given = parts(n);
        if rigid {
            given.stiffness_n = None;
        }
        // One common direction of error for all anchors: a covariance of rank one.
        let error: Vec<f64> = seed[..3 * n].to_vec();
        given.anchor_covariance_m2 = Some(error.iter().map(|a| error.iter().map(|b| a * b).collect()).collect());
        let robot = Robot::new(given).unwrap();
        // Near the plane of the anchors, the rotation of cables with their anchors contributes a sixth.
        prop_assume!(if rigid { n == 3 } else { x.z < 2.5 });
        let held = realise(&robot, &x, &Vector3::zeros(), robot.default_distribution());
        prop_assume!(held.is_ok());
        let lengths = held.unwrap().unstretched_m;
        let found = equilibrium(&robot, &lengths, &Vector3::zeros(), None).unwrap();
        let moved = |step: f64| {
            let anchors: Vec<[f64; 3]> = (0..n)
                .map(|i| (robot.anchors()[i] + Vector3::new(error[3 * i], error[3 * i + 1], error[3 * i + 2]) * step).into())
                .collect();
            let other = robot.with_anchors(cable_robot::Anchors::new(&anchors).unwrap()).unwrap();
            equilibrium(&other, &lengths, &Vector3::zeros(), Some(&found.position)).unwrap().position
        };
        let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        let stated = robot.uncertainty().covariance_m2(&robot, &found, None);
        // The covariance neglects the rotation of elastic cables.
        let tolerance = if rigid { 1e-4 } else { 0.1 };
        prop_assert!((stated - slope * slope.transpose()).norm() < tolerance * (0.05 + slope.norm_squared()), "{stated} {slope}");
    }

    #[test]
    fn equilibrium_undoes_realise(n in 3usize..=8, p in pose(), a in acceleration()) {
        let robot = robot(n);
        let held = realise(&robot, &p, &a, robot.default_distribution());
        prop_assume!(held.is_ok());
        let held = held.unwrap();
        let found = equilibrium(&robot, &held.unstretched_m, &a, None).unwrap();
        prop_assert!((found.position - p).norm() < 1e-7, "{found:?}");
        prop_assert!(found.tensions_n.zip_map(&held.tensions_n, |x, y| x - y).max_abs() < 1e-5);
        prop_assert!(!found.any_slack());
        // Start near the solution, as from the position of the previous cycle.
        let again = equilibrium(&robot, &held.unstretched_m, &a, Some(&(p + Vector3::new(2e-3, -1e-3, 1e-3)))).unwrap();
        prop_assert!((again.position - p).norm() < 1e-7 && again.iterations <= 4, "{}", again.iterations);
    }

    #[test]
    fn lengths_stretch_and_relax(l in proptest::collection::vec(0.5..20.0f64, 4), t in proptest::collection::vec(0.0..150.0f64, 4)) {
        let (robot, at) = (robot(4), Vector3::zeros());
        let back = unstretched(&robot, &at, &stretched(&robot, &at, &l, &t), &t);
        for i in 0..4 {
            prop_assert!((back[i] - l[i]).abs() < 1e-12 * 30.0);
        }
        prop_assert!(stretched(&robot, &at, &l, &t).iter().zip(&l).all(|(a, b)| a >= b));
    }

    #[test]
    fn equilibrium_is_found_from_anywhere(n in 3usize..=6, p in pose(), guess in [-20.0..30.0f64, -20.0..30.0f64, -30.0..40.0f64]) {
        let robot = robot(n);
        let held = realise(&robot, &p, &Vector3::zeros(), robot.default_distribution());
        prop_assume!(held.is_ok());
        let held = held.unwrap();
        let found = equilibrium(&robot, &held.unstretched_m, &Vector3::zeros(), Some(&Vector3::from(guess))).unwrap();
        prop_assert!((found.position - p).norm() < 1e-6, "{found:?}");
    }

    #[test]
    fn sensitivity_is_the_derivative(n in 3usize..=6, p in pose()) {
        let robot = robot(n);
        let held = realise(&robot, &p, &Vector3::zeros(), robot.default_distribution());
        prop_assume!(held.is_ok());
        let held = held.unwrap();
        let at = |l: &CableVec| equilibrium(&robot, l, &Vector3::zeros(), Some(&p)).unwrap();
        let here = at(&held.unstretched_m);
        for i in 0..n {
            let h = 1e-5;
            let (mut up, mut down) = (held.unstretched_m, held.unstretched_m);
            up[i] += h;
            down[i] -= h;
            let slope = (at(&up).position - at(&down).position) / (2.0 * h);
            prop_assert!((slope - here.sensitivity[i]).norm() < 2e-4 * (1.0 + slope.norm()), "{slope:?} {:?}", here.sensitivity[i]);
        }
        let sigma = CableVec::repeat(n, 1e-3);
        let covariance = here.covariance(&sigma);
        prop_assert!((covariance - covariance.transpose()).norm() < 1e-18 && covariance.trace() > 0.0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn equilibrium_has_the_least_energy_even_with_slack_cables(n in 3usize..=6, p in pose(), errors in proptest::collection::vec(-0.15..0.15f64, 6)) {
        let robot = robot(n);
        let a = Vector3::zeros();
        // Lengths that do not fit one pose: some cables too tight, some slack.
        let l = inverse_kinematics(robot.anchors(), &p).zip_map(&errors, |l, e| l + e);
        let found = equilibrium(&robot, &l, &a, None).unwrap();
        let oracle = lowest(|x| energy(&robot, &l, &a, x), p);
        let (mine, theirs) = (energy(&robot, &l, &a, &found.position), energy(&robot, &l, &a, &oracle));
        prop_assert!(mine <= theirs + 1e-6, "{mine} {theirs}");
        prop_assert!((found.position - oracle).norm() < 0.02, "{found:?} {oracle:?}");
        for i in 0..n {
            prop_assert_eq!(found.slack[i], found.tensions_n[i] == 0.0);
        }
    }
}

#[test]
fn very_stiff_cables_are_rigid_cables() {
    let stiff = Robot::new(RobotParts { stiffness_n: Some(1e8), ..parts(3) }).unwrap();
    let rigid = stiff.with_rigid_lines();
    let p = Vector3::new(7.0, 3.0, 2.0);
    let l = inverse_kinematics(rigid.anchors(), &p);
    let a = equilibrium(&stiff, &l, &Vector3::zeros(), None).unwrap();
    let b = equilibrium(&rigid, &l, &Vector3::zeros(), None).unwrap();
    assert!((a.position - b.position).norm() < 1e-4, "{a:?} {b:?}");
    assert!(a.tensions_n.zip_map(&b.tensions_n, |x, y| x - y).max_abs() < 1e-2);
    for i in 0..3 {
        assert!((a.sensitivity[i] - b.sensitivity[i]).norm() < 1e-3);
    }
}

#[test]
fn without_compensation_the_node_sags_by_centimetres() {
    // Three cables with EA 6 kN and 6 m routed length carry 2 kg: the error of treating measured lengths as
    // straight-line lengths.
    let robot = robot(3);
    let p = Vector3::new(7.0, 3.0, 2.5);
    let l = inverse_kinematics(robot.anchors(), &p);
    let sagged = equilibrium(&robot, &l, &Vector3::zeros(), None).unwrap();
    let sag = p.z - sagged.position.z;
    assert!((0.01..0.2).contains(&sag), "{sag}");
}

#[test]
fn a_long_cable_is_reported_slack() {
    let robot = robot(4);
    let p = Vector3::new(6.5, 2.5, 2.0);
    let mut l = realise(&robot, &p, &Vector3::zeros(), Distribution::LeastNorm).unwrap().unstretched_m;
    l[3] += 0.5;
    let found = equilibrium(&robot, &l, &Vector3::zeros(), Some(&p)).unwrap();
    assert!(found.slack[3] && found.tensions_n[3] == 0.0 && found.any_slack());
    assert_eq!(found.sensitivity[3], Vector3::zeros());
}

#[test]
fn a_redundant_millimetre_is_a_fifth_of_a_newton() {
    // The mode in which four cables pull against each other: far stiffer in length than the weight suggests.
    let robot = robot(4);
    let p = Vector3::new(5.0, 4.5, 2.0);
    let held = realise(&robot, &p, &Vector3::zeros(), Distribution::LeastNorm).unwrap();
    let mut l = held.unstretched_m;
    l[0] -= 1e-3;
    l[2] -= 1e-3;
    let found = equilibrium(&robot, &l, &Vector3::zeros(), Some(&p)).unwrap();
    let change = found.tensions_n[0] - held.tensions_n[0];
    assert!((0.02..1.0).contains(&change), "{change}");
}

#[test]
fn invalid_lengths_are_refused() {
    let robot = robot(3);
    let zero = Vector3::zeros();
    for l in [&[5.0, 5.0][..], &[5.0, f64::NAN, 5.0], &[5.0, -7.0, 5.0], &[5.0, 0.0, 5.0]] {
        let sentence = equilibrium(&robot, l, &zero, None).unwrap_err().to_string();
        assert!(sentence.len() > 30, "{sentence}");
    }
    let nan = Vector3::new(0.0, f64::NAN, 0.0);
    assert!(equilibrium(&robot, &[8.0, 8.0, 8.0], &nan, None).is_err());
    assert!(equilibrium(&robot, &[8.0, 8.0, 8.0], &zero, Some(&nan)).is_err());
}
