//! Input that is not finite, too large or too small: nothing panics, and every returned result is finite.

use cable_control::law::{InputWeight, LqGain};
use cable_control::motor_model::{PRIOR, PhiModel, RIDGE, fit};
use cable_robot::elastic::{equilibrium, realise, stretched, unstretched};
use cable_robot::kinematics::{Jacobian, forward_kinematics};
use cable_robot::limits::scale_to_limits;
use cable_robot::path::{Parabola, Spiral};
use cable_robot::profile::{Knot, ProfileLimits};
use cable_robot::tension::{FourCables, distribute, least_norm};
use cable_robot::*;
use proptest::prelude::*;

fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0f64,
        1 => proptest::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, 1.0, -1.0, 1e300, -1e300, 1e-300, f64::MAX, f64::EPSILON,
        ]),
    ]
}

fn wild3() -> impl Strategy<Value = Vector3<f64>> {
    [wild(), wild(), wild()].prop_map(Vector3::from)
}

fn robot(n: usize, stiffness_n: Option<f64>) -> Robot {
    let anchors = [[0.0, 0.0, 6.0], [10.0, 0.0, 6.1], [10.2, 9.8, 6.2], [0.0, 10.0, 5.9], [5.0, -2.0, 6.0]];
    Robot::new(RobotParts {
        anchors_m: anchors[..n].to_vec(),
        node_mass_kg: 2.0,
        tension_limits_n: [1.0, 150.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n,
        ..RobotParts::default()
    })
    .unwrap()
}

fn finite(v: &Vector3<f64>) -> bool {
    v.iter().all(|x| x.is_finite())
}

fn wild_path() -> impl Strategy<Value = Path> {
    prop_oneof![
        (wild3(), wild3()).prop_map(|(a, b)| Path::line(a, b)),
        (wild3(), wild3(), wild()).prop_map(|(from, to, mu_per_m)| Path::Parabola(Parabola { from, to, mu_per_m })),
        (wild3(), wild(), wild(), wild(), wild(), wild()).prop_map(|(centre, a, b, turns, rise_m, start_angle_rad)| {
            Path::Spiral(Spiral { centre, start_radius_m: a, end_radius_m: b, turns, rise_m, start_angle_rad })
        }),
        wild3().prop_map(Path::Dwell),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn statics(n in 3usize..=5, elastic in any::<bool>(), x in wild3(), a in wild3(), l in proptest::collection::vec(wild(), 5), limits in [wild(), wild()]) {
        let robot = robot(n, elastic.then_some(6000.0));
        if let Ok(found) = forward_kinematics(robot.anchors(), &l[..n], Some(&x)) {
            prop_assert!(finite(&found.position), "{found:?}");
        }
        if let Ok(found) = equilibrium(&robot, &l[..n], &a, Some(&x)) {
            prop_assert!(finite(&found.position) && found.tensions_n.is_finite(), "{found:?}");
        }
        let _ = (stretched(&robot, &x, &l, &l), unstretched(&robot, &x, &l, &l));
        for method in [Distribution::Unique, Distribution::LeastNorm, Distribution::MinSum, Distribution::Safest] {
            if let Ok(found) = realise(&robot, &x, &a, method) {
                prop_assert!(found.unstretched_m.is_finite() && found.tensions_n.is_finite(), "{found:?}");
            }
            if let Ok(structure) = StructureMatrix::at(robot.anchors(), &x) {
                if let Ok(found) = distribute(&structure, &a, limits, method) {
                    prop_assert!(found.tensions_n.is_finite(), "{found:?}");
                }
                let _ = (FourCables::new(&structure, &a, limits).is_ok(), least_norm(&structure, &a, limits).is_ok());
            }
        }
    }

    #[test]
    fn control(x in wild3(), e in wild3(), period in wild(), q in wild(), r in wild(), horizon in 0u32..40, l in proptest::collection::vec(wild(), 12), limits in proptest::collection::vec(wild(), 3)) {
        let robot = robot(3, None);
        if let Some(b) = Jacobian::at(robot.anchors(), &x).ok().and_then(|j| j.node_jacobian())
            && let Ok(gain) = LqGain::new(&b, period, &(Matrix3::identity() * q), &InputWeight::Scalar(r), horizon)
        {
            let scaled = scale_to_limits(&gain.velocity(&e), &limits);
            prop_assert!(scaled.velocities_m_s.is_finite());
        }
        let mut model = PhiModel::new(3, RIDGE, PRIOR);
        for pair in l.windows(2) {
            model.update(pair[0], pair[1]);
            prop_assert!(model.phi().iter().all(|v| v.is_finite()));
        }
        let _ = fit(&l[..6], &l[6..], 3, RIDGE, PRIOR);
    }

    #[test]
    fn motions(path in wild_path(), cruise in wild(), a in wild(), total in wild(), ends in [wild(), wild()], t in wild(), step in wild(), knots in proptest::collection::vec((wild(), wild()), 0..5)) {
        let robot = robot(4, Some(6000.0));
        let limits = ProfileLimits { cruise_m_s: cruise, tangential_m_s2: a, total_m_s2: total, start_m_s: ends[0], end_m_s: ends[1], ..ProfileLimits::rest_to_rest(cruise, a) };
        let knots: Vec<Knot> = knots.into_iter().map(|(s_m, v_m_s)| Knot { s_m, v_m_s }).collect();
        let made = [Profile::from_knots(&knots).ok(), Profile::dwell(t).ok(), path.check().ok().and_then(|()| Profile::plan(&path, &limits).ok())];
        for profile in made.into_iter().flatten() {
            let along = profile.at(t);
            prop_assert!(along.s_m.is_finite() && along.v_m_s.is_finite(), "{along:?}");
            let _ = (profile.time_at(t), profile.speed_at(t));
            let segment = Segment { id: 1, path, profile, start_s: ends[0] };
            let setpoint = segment.setpoint(t);
            // A step far below a millimetre would only take long.
            if segment.check(&robot, Distribution::LeastNorm, if step < 1e-2 { -step.abs() } else { step }).is_ok() {
                prop_assert!(finite(&setpoint.position) && finite(&setpoint.velocity) && finite(&setpoint.acceleration), "{setpoint:?}");
            }
        }
    }
}
