//! No function of the control loop allocates: a counting allocator checks each of them.

use crate::counting;

use std::hint::black_box;

use cable_control::law::{InputWeight, LqGain};
use cable_control::motor_model::{PRIOR, PhiModel, RIDGE};
use cable_robot::elastic::{equilibrium, equilibrium_under, realise_under};
use cable_robot::kinematics::{Jacobian, forward_kinematics, inverse_kinematics};
use cable_robot::limits::scale_to_limits;
use cable_robot::path::Spiral;
use cable_robot::profile::ProfileLimits;
use cable_robot::*;
use counting::allocations;

/// A planar robot with a floating node and two cables from below.
fn planar(n: usize, stiffness_n: Option<f64>) -> Robot {
    let points = [[0.0, 4.2], [10.0, 4.2], [10.0, 0.3], [0.0, 0.3], [5.0, 5.0]];
    Robot::new(RobotParts {
        anchors_m: points[..n].iter().map(|[x, z]| [*x, 0.0, *z]).collect(),
        planar: true,
        node_mass_kg: 6.0,
        net_weight_n: Some(0.0),
        drag_n_s2_m2: 25.0,
        tension_limits_n: [10.0, 80.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n,
        ..RobotParts::default()
    })
    .unwrap()
}

fn robot(n: usize, stiffness_n: Option<f64>) -> Robot {
    let anchors_m = (0..n)
        .map(|i| {
            let angle = 2.0 * std::f64::consts::PI * i as f64 / n as f64;
            [5.0 + 5.0 * angle.cos(), 5.0 + 5.0 * angle.sin(), 5.0 + 0.1 * (i % 3) as f64]
        })
        .collect();
    Robot::new(RobotParts {
        anchors_m,
        node_mass_kg: 2.0,
        tension_limits_n: [0.5, 150.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n,
        ..RobotParts::default()
    })
    .unwrap()
}

#[test]
fn a_cycle_of_estimation_and_control_does_not_allocate() {
    let spiral = Path::Spiral(Spiral {
        centre: Vector3::new(5.0, 5.0, 1.0),
        start_radius_m: 0.0,
        end_radius_m: 0.6,
        turns: 3.0,
        rise_m: 1.125,
        start_angle_rad: 0.0,
    });
    let line = Path::line(Vector3::new(3.0, 0.0, 1.0), Vector3::new(7.0, 0.0, 3.0));
    let hanging = [(3, None), (3, Some(6000.0)), (4, None), (4, Some(6000.0)), (8, Some(6000.0))];
    let floating = [(4, None), (4, Some(12_000.0)), (5, Some(12_000.0))];
    let all = hanging.map(|(n, stiffness)| (robot(n, stiffness), spiral)).into_iter();
    for (robot, path) in all.chain(floating.map(|(n, stiffness)| (planar(n, stiffness), line))) {
        let (n, stiffness) = (robot.cable_count(), robot.stiffness_n());
        let method = robot.default_distribution();
        let mut phi = PhiModel::new(10, RIDGE, PRIOR);
        let count = allocations(|| {
            let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
            let segment = Segment { id: 1, path, profile, start_s: 2.0 };
            let report = segment.check(&robot, method, 0.05).unwrap();
            black_box(report);
            let motion = Motion {
                current: segment,
                next: Some(Segment {
                    id: 2,
                    path: Path::Dwell(path.end()),
                    profile: Profile::dwell(1.0).unwrap(),
                    start_s: segment.end_s(),
                }),
            };
            let mut guess = path.start();
            for cycle in 0..200 {
                let setpoint = motion.setpoint(f64::from(cycle) * 0.15);
                let wrench = robot.moving_wrench_n(&setpoint.velocity, &setpoint.acceleration);
                let held = realise_under(&robot, &setpoint.position, &wrench, method).unwrap();
                let found = equilibrium_under(&robot, &held.unstretched_m, &wrench, Some(&guess)).unwrap();
                guess = found.position;
                black_box(found.covariance(&CableVec::repeat(n, 1e-3)));
                let lengths = inverse_kinematics(robot.anchors(), &setpoint.position);
                black_box(forward_kinematics(robot.anchors(), &lengths, Some(&guess)).unwrap());
                let jacobian = Jacobian::at(robot.anchors(), &guess).unwrap();
                let b = jacobian.node_jacobian().unwrap();
                let gain = LqGain::new(&b, 0.01, &Matrix3::identity(), &InputWeight::Scalar(1.0), 5).unwrap();
                let u = gain.velocity(&(setpoint.position - guess));
                let scaled = scale_to_limits(&u, &[0.4; 8]);
                phi.update(scaled.velocities_m_s[0], 0.9 * scaled.velocities_m_s[0]);
                black_box(phi.predict_length(5.0, 0.1, 0.01));
            }
            // Errors are values too; only formatting them allocates.
            black_box(equilibrium(&robot, &[f64::NAN; 8][..n], &Vector3::zeros(), None).is_err());
            black_box(segment.check(&robot, method, f64::NAN).is_err());
        });
        assert_eq!(count, 0, "{n} cables, stiffness {stiffness:?}");
    }
}
