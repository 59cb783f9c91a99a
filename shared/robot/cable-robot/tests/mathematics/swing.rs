//! Modes of vibration and shaped profiles compared with integrated motions.

use cable_robot::elastic::{equilibrium_under, realise};
use cable_robot::modes::{Modes, stiffness_n_m};
use cable_robot::profile::ProfileLimits;
use cable_robot::{Distribution, Path, Profile, PulleyKind, Robot, RobotParts, Vector3};
use proptest::prelude::*;
use std::f64::consts::PI;

fn robot(cables: usize, radius_m: f64) -> Robot {
    let anchors = [[0.0, 0.0, 6.0], [30.4, 0.3, 6.3], [29.7, 18.9, 5.8], [-0.5, 19.4, 6.1]];
    Robot::new(RobotParts {
        anchors_m: anchors[..cables].to_vec(),
        node_mass_kg: 2.0,
        tension_limits_n: [1.0, 300.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(20_000.0),
        routed_length_m: Some(vec![6.0; cables]),
        pulley: if radius_m > 0.0 { PulleyKind::Swivel } else { PulleyKind::Eye },
        pulley_radius_m: (radius_m > 0.0).then(|| vec![radius_m; cables]),
        ..RobotParts::default()
    })
    .unwrap()
}

fn pose() -> impl Strategy<Value = Vector3<f64>> {
    [15.0..22.0f64, 4.0..8.0f64, 0.5..4.0f64].prop_map(Vector3::from)
}

/// Largest swing after a profile of an oscillator of a period that rests before, m. The acceleration is constant from
/// knot to knot, for which the motion is known exactly.
fn swing_after_m(profile: &Profile, period_s: f64) -> f64 {
    let omega = 2.0 * PI / period_s;
    let times: Vec<f64> = profile.knots().iter().map(|knot| profile.time_at(knot.s_m)).collect();
    let (mut x, mut v) = (0.0_f64, 0.0_f64);
    for pair in times.windows(2) {
        let dt = pair[1] - pair[0];
        let rest = -profile.at(0.5 * (pair[0] + pair[1])).a_m_s2 / (omega * omega);
        let (sin, cos) = (omega * dt).sin_cos();
        (x, v) = (rest + (x - rest) * cos + v / omega * sin, v * cos - (x - rest) * omega * sin);
    }
    x.hypot(v / omega)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// A small force moves the node by the inverse of the stiffness.
    #[test]
    fn the_stiffness_is_that_of_the_equilibrium(cables in 3usize..=4, eye in any::<bool>(), x in pose(), toward in 0usize..3) {
        let robot = robot(cables, if eye { 0.0 } else { 0.05 });
        let held = realise(&robot, &x, &Vector3::zeros(), Distribution::LeastNorm);
        prop_assume!(held.is_ok());
        let held = held.unwrap();
        let stiffness = stiffness_n_m(&robot, &x, &held.tensions_n).unwrap();
        let mut force = Vector3::zeros();
        force[toward] = 1e-3;
        let rest = equilibrium_under(&robot, &held.unstretched_m, &robot.wrench_n(&Vector3::zeros()), Some(&x)).unwrap();
        // The cables provide the wrench, so the node is pulled the other way.
        let pulled = equilibrium_under(&robot, &held.unstretched_m, &(robot.wrench_n(&Vector3::zeros()) - force), Some(&x)).unwrap();
        let moved = pulled.position - rest.position;
        prop_assert!((stiffness * moved - force).norm() < 1e-3 * force.norm(), "{stiffness} {moved}");
    }

    /// A node that is let go beside its place returns along each mode after half a period on the other side.
    #[test]
    fn a_displaced_node_swings_with_the_period_of_the_mode(cables in 3usize..=4, x in pose(), which in 0usize..3) {
        let robot = robot(cables, 0.0);
        let held = realise(&robot, &x, &Vector3::zeros(), Distribution::LeastNorm);
        prop_assume!(held.is_ok());
        let held = held.unwrap();
        let mode = Modes::at(&robot, &x, &held.tensions_n).unwrap()[which];
        let start = mode.direction * 1e-4;
        let (mut at, mut velocity) = (start, Vector3::zeros());
        let steps = 2000;
        let dt = 0.5 * mode.period_s() / f64::from(steps);
        let acceleration = |at: &Vector3<f64>| {
            let mut force = -robot.wrench_n(&Vector3::zeros());
            for i in 0..cables {
                let d = x + at - robot.anchors()[i];
                let free = held.unstretched_m[i] + 6.0;
                force -= d / d.norm() * (20_000.0 * ((d.norm() + 6.0) / free - 1.0));
            }
            force / 2.0
        };
        for _ in 0..steps {
            velocity += acceleration(&at) * dt;
            at += velocity * dt;
        }
        prop_assert!((at + start).norm() < 0.02 * start.norm(), "{at} {start}");
    }

    /// A shaped profile leaves no swing of its period, and at most 0.15 of that of one within 20 %.
    #[test]
    fn a_shaped_profile_leaves_no_swing(length in 0.05..30.0f64, speed in 0.05..1.0f64, acceleration in 0.05..1.0f64, period in 0.2..2.0f64, other in 0.8..1.2f64) {
        let path = Path::line(Vector3::zeros(), Vector3::new(length, 0.0, 0.0));
        let plain = Profile::plan(&path, &ProfileLimits::rest_to_rest(speed, acceleration)).unwrap();
        let shaped = plain.shaped(period).unwrap();
        prop_assert!((shaped.duration() - plain.duration().max(0.5 * period) - period).abs() < 1e-6);
        prop_assert!((shaped.length() - length).abs() < 1e-9);
        // The largest swing that jumps of this acceleration can add up to: four of them.
        let jump_m = acceleration * (period / (2.0 * PI)).powi(2);
        prop_assert!(swing_after_m(&shaped, period) < 4.0 * jump_m * 1e-3, "{}", swing_after_m(&shaped, period));
        let near = swing_after_m(&shaped, period * other);
        prop_assert!(near < 4.0 * jump_m * other * other * 0.15, "{near} {jump_m}");
        for step in 0..=1000 {
            let at = shaped.at(shaped.duration() * f64::from(step) / 1000.0);
            prop_assert!(at.v_m_s <= speed * (1.0 + 1e-9) && at.a_m_s2.abs() <= acceleration * (1.0 + 1e-6), "{at:?}");
        }
    }
}

#[test]
fn profiles_that_cannot_be_shaped() {
    let path = Path::line(Vector3::zeros(), Vector3::new(2.0, 0.0, 0.0));
    let plain = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
    for period_s in [0.0, -1.0, f64::NAN] {
        assert_eq!(plain.shaped(period_s), None);
    }
    assert_eq!(Profile::dwell(1.0).unwrap().shaped(0.5), None);
    let moving = ProfileLimits { end_m_s: 0.1, ..ProfileLimits::rest_to_rest(0.2, 0.4) };
    assert_eq!(Profile::plan(&path, &moving).unwrap().shaped(0.5), None);
    // Twelve knots become 36, more than a message has.
    let once = plain.shaped(0.37).unwrap();
    assert!(once.knots().len() == 12 && once.shaped(0.31).is_none());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// At the turn of a deep parabola the copies of a profile meet at other speeds than where it slows down.
    #[test]
    fn a_shaped_profile_keeps_the_limit_at_the_sharpest_bend(
        from in [13.0..17.0f64, 4.0..8.0f64, 2.0..4.0f64], way in [1.0..8.0f64, 0.0..4.0f64, -1.0..1.0f64], mu_per_m in 0.05..8.0f64, cruise in 0.1..0.4f64,
    ) {
        let robot = robot(4, 0.0);
        let from = Vector3::from(from);
        let path = Path::Parabola(cable_robot::path::Parabola { from, to: from + Vector3::from(way), mu_per_m });
        let limits = ProfileLimits::rest_to_rest(cruise, 0.5);
        let plain = Profile::plan(&path, &limits).unwrap();
        let shaped = cable_robot::swing::shaped(&robot, Distribution::LeastNorm, &path, plain, 0.0);
        prop_assume!(shaped != plain);
        let acceleration = |profile: &Profile, t: f64| {
            let at = profile.at(t);
            (at.v_m_s * at.v_m_s * path.curvature(at.s_m)).hypot(at.a_m_s2)
        };
        let worst = |profile: &Profile| (0..=4000).map(|i| acceleration(profile, profile.duration() * f64::from(i) / 4000.0)).fold(0.0, f64::max);
        prop_assert!(worst(&plain) <= 0.505);
        prop_assert!(worst(&shaped) <= 0.505, "{} {}", worst(&plain), worst(&shaped));
    }
}
