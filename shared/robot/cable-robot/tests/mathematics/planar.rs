//! Robots in the plane y = 0: two directions, two to eight cables, so up to six degrees of freedom of the tensions.

use cable_control::law::{InputWeight, LqGain};
use cable_robot::kinematics::{Jacobian, forward_kinematics, inverse_kinematics};
use cable_robot::motion::Cause;
use cable_robot::profile::ProfileLimits;
use cable_robot::tension::{self, TensionError};
use cable_robot::*;
use proptest::prelude::*;

/// Corners of an area of 8 x 4 m in a stream, then points between them.
const POINTS: [[f64; 2]; 8] =
    [[0.0, 4.2], [8.0, 4.0], [8.1, 0.3], [-0.1, 0.2], [4.0, 4.5], [3.9, -0.2], [8.3, 2.0], [-0.2, 2.2]];

fn parts(cables: usize) -> RobotParts {
    RobotParts {
        anchors_m: POINTS[..cables].iter().map(|[x, z]| [*x, 0.0, *z]).collect(),
        planar: true,
        node_mass_kg: 6.0,
        net_weight_n: Some(0.0),
        drag_n_s2_m2: 25.0,
        tension_limits_n: [10.0, 80.0],
        speed_limit_m_s: 0.3,
        acceleration_limit_m_s2: 0.3,
        stiffness_n: Some(12_000.0),
        routed_length_m: Some(vec![4.0; cables]),
        ..RobotParts::default()
    }
}

fn robot(cables: usize) -> Robot {
    Robot::new(parts(cables)).unwrap()
}

fn inside() -> impl Strategy<Value = Vector3<f64>> {
    (1.0..7.0f64, 0.8..3.5f64).prop_map(|(x, z)| Vector3::new(x, 0.0, z))
}

fn in_plane(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    (-size..size, -size..size).prop_map(|(x, z)| Vector3::new(x, 0.0, z))
}

#[test]
fn directions_and_redundancy_are_those_of_the_plane() {
    for cables in 2..=8 {
        let robot = robot(cables);
        assert_eq!((robot.dimensions(), robot.redundancy(), robot.is_planar()), (2, cables - 2, true));
        let expected = if cables == 2 { Distribution::Unique } else { Distribution::LeastNorm };
        assert_eq!(robot.default_distribution(), expected);
    }
    let space = Anchors::new(&[[0.0, 0.0, 4.0], [8.0, 0.0, 4.0], [8.0, 3.0, 0.0], [0.0, 2.0, 0.0]]).unwrap();
    assert_eq!(robot(4).with_anchors(space).unwrap_err().key, "anchors_m");
}

proptest! {
    #[test]
    fn kinematics_agree_with_finite_differences(cables in 3usize..=8, p in inside()) {
        let robot = robot(cables);
        let anchors = robot.anchors();
        let lengths = inverse_kinematics(anchors, &p);
        let found = forward_kinematics(anchors, &lengths, Some(&(p + Vector3::new(0.3, 0.0, -0.2)))).unwrap();
        prop_assert!((found.position - p).norm() < 1e-9);
        let j = Jacobian::at(anchors, &p).unwrap();
        let h = 1e-5;
        for (k, d) in [(0, Vector3::new(h, 0.0, 0.0)), (2, Vector3::new(0.0, 0.0, h))] {
            let (up, down) = (inverse_kinematics(anchors, &(p + d)), inverse_kinematics(anchors, &(p - d)));
            for i in 0..cables {
                prop_assert!(((up[i] - down[i]) / (2.0 * h) - j[i][k]).abs() < 1e-8);
                prop_assert_eq!(j[i].y, 0.0);
            }
        }
        // B is the derivative of the least-squares position with respect to the lengths.
        let b = j.node_jacobian().unwrap();
        for i in 0..cables {
            let shifted = |by: f64| {
                let mut l = lengths;
                l[i] += by;
                forward_kinematics(anchors, &l, Some(&p)).unwrap().position
            };
            let slope = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
            prop_assert!((slope - b[i]).norm() < 1e-6, "{slope:?} {:?}", b[i]);
        }
        let v = Vector3::new(0.1, 0.0, -0.2);
        prop_assert!((b.node_velocity(&j.cable_velocity(&v)) - v).norm() < 1e-12);
    }

    /// Four cables have a plane of solutions. A grid over all of it, by Cramer's rule: its best point is not better
    /// than the computed optimum, and not worse than the grid spacing explains.
    #[test]
    fn tensions_agree_with_a_scan_of_both_redundant_modes(p in inside(), force in in_plane(12.0), high in 25.0..80.0f64) {
        let robot = robot(4);
        let structure = StructureMatrix::at(robot.anchors(), &p).unwrap();
        let limits = [10.0, high];
        let (a, b, c, d) = (structure[0].x, structure[1].x, structure[0].z, structure[1].z);
        let det = a * d - b * c;
        let steps = 160;
        let at = |k: usize| limits[0] + (limits[1] - limits[0]) * k as f64 / steps as f64;
        let (mut norm, mut sum, mut margin) = (f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..=steps {
            for k in 0..=steps {
                let (t3, t4) = (at(i), at(k));
                let rest = force - structure[2] * t3 - structure[3] * t4;
                let t = [(rest.x * d - b * rest.z) / det, (a * rest.z - c * rest.x) / det, t3, t4];
                let least = tension::margin(&t, limits);
                if least >= 0.0 {
                    norm = norm.min(t.iter().map(|t| t * t).sum());
                    sum = sum.min(t.iter().sum());
                    margin = margin.max(least);
                }
            }
        }
        let solved = |method| tension::distribute(&structure, &force, limits, method);
        let Ok(found) = solved(Distribution::LeastNorm) else {
            prop_assert!(norm.is_infinite(), "missed a solution of norm {norm}");
            return Ok(());
        };
        // A change of both free tensions by half a step changes the others by at most this.
        let reach = 0.5 * (limits[1] - limits[0]) / steps as f64 * (1.0 + 4.0 / det.abs());
        for (method, grid) in [(Distribution::LeastNorm, norm), (Distribution::MinSum, sum), (Distribution::Safest, -margin)] {
            let found = solved(method).unwrap();
            let t = &found.tensions_n;
            prop_assert!((structure.force(t) - force).norm() < 1e-7, "{method} leaves a force");
            prop_assert!(found.margin_n >= -1e-7);
            let value = match method {
                Distribution::LeastNorm => t.norm_squared(),
                Distribution::MinSum => t.sum(),
                _ => -found.margin_n,
            };
            prop_assert!(value <= grid + 1e-6 * (1.0 + grid.abs()), "{method}: {value}, and {grid} on the grid");
        }
        // The grid comes close to the optimum if the set of solutions is wider than its steps.
        if solved(Distribution::Safest).unwrap().margin_n > 2.0 * reach {
            prop_assert!(norm <= found.tensions_n.norm_squared() + 8.0 * high * reach, "{norm} {:?}", found.tensions_n);
        }
    }

    #[test]
    fn equilibrium_undoes_realise(cables in 4usize..=8, mut p in inside(), v in in_plane(0.2), a in in_plane(0.2)) {
        // Below that, cables from the bottom anchors cannot pull down against five from above.
        p.z = p.z.max(1.4);
        let robot = robot(cables);
        let wrench = robot.moving_wrench_n(&v, &a);
        prop_assert!((wrench - (a * 6.0 + v * (25.0 * v.norm()))).norm() < 1e-12);
        let held = elastic::realise_under(&robot, &p, &wrench, Distribution::LeastNorm).unwrap();
        let guess = p + Vector3::new(0.2, 0.0, 0.1);
        let found = elastic::equilibrium_under(&robot, &held.unstretched_m, &wrench, Some(&guess)).unwrap();
        prop_assert!((found.position - p).norm() < 1e-7, "{found:?}");
        prop_assert_eq!(found.position.y, 0.0);
        for (is, chosen) in found.tensions_n.iter().zip(held.tensions_n.iter()) {
            prop_assert!((is - chosen).abs() < 1e-3 && *chosen >= 10.0 - 1e-6);
        }
        // Numerical derivative of the position with respect to the lengths.
        for i in 0..cables {
            let moved = |by: f64| {
                let mut l = held.unstretched_m;
                l[i] += by;
                elastic::equilibrium_under(&robot, &l, &wrench, Some(&p)).unwrap().position
            };
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            prop_assert!((slope - found.sensitivity[i]).norm() < 1e-4, "{slope:?} {:?}", found.sensitivity[i]);
        }
    }

    /// Applied with a shrinking horizon, the law brings the error to zero in time for any weights.
    #[test]
    fn the_law_reaches_zero_at_its_horizon(cables in 2usize..=8, p in inside(), e0 in in_plane(0.05), q in 0.0..200.0f64, horizon in 1u32..12) {
        let b = Jacobian::at(robot(cables).anchors(), &p).unwrap().node_jacobian().unwrap();
        let mut e = e0;
        for left in (1..=horizon).rev() {
            let gain = LqGain::new(&b, 0.01, &(Matrix3::identity() * q), &InputWeight::Scalar(1.0), left).unwrap();
            let u = gain.velocity(&e);
            if q == 0.0 || horizon == 1 {
                prop_assert!((b.node_velocity(&u) - e / (0.01 * f64::from(left))).norm() < 1e-9);
            }
            prop_assert!(gain.rows().iter().all(|row| row.y == 0.0));
            e -= b.node_velocity(&u) * 0.01;
        }
        prop_assert!(e.norm() < 1e-10, "{e:?}");
    }
}

#[test]
fn two_suspended_cables_have_one_solution() {
    let mut parts = parts(2);
    (parts.net_weight_n, parts.tension_limits_n) = (None, [1.0, 200.0]);
    let robot = Robot::new(parts).unwrap();
    let p = Vector3::new(3.0, 0.0, 1.5);
    let found = tension::at(&robot, &p, &Vector3::zeros(), Distribution::Unique).unwrap();
    let structure = StructureMatrix::at(robot.anchors(), &p).unwrap();
    assert!((structure.force(&found.tensions_n) - Vector3::new(0.0, 0.0, 6.0 * STANDARD_GRAVITY)).norm() < 1e-9);
    let held = elastic::realise(&robot, &p, &Vector3::zeros(), Distribution::Unique).unwrap();
    let hangs = elastic::equilibrium(&robot, &held.unstretched_m, &Vector3::zeros(), None).unwrap();
    assert!((hangs.position - p).norm() < 1e-7, "{hangs:?}");
    // On the line through the anchors nothing carries the weight.
    let between = Vector3::new(4.0, 0.0, 4.1);
    assert_eq!(
        StructureMatrix::at(robot.anchors(), &between).map(|s| tension::unique(&s, &p)),
        Ok(Err(TensionError::Singular))
    );
}

#[test]
fn the_check_of_a_motion_includes_drag() {
    let segment = |to: Vector3<f64>, speed| {
        let path = Path::line(Vector3::new(2.5, 0.0, 2.0), to);
        let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(speed, 0.2)).unwrap();
        Segment { id: 1, path, profile, start_s: 0.0 }
    };
    let along = segment(Vector3::new(5.5, 0.0, 2.0), 0.2);
    let report = |drag_n_s2_m2| {
        let robot = Robot::new(RobotParts { drag_n_s2_m2, ..parts(4) }).unwrap();
        along.check(&robot, Distribution::LeastNorm, 0.02).map(|report| report.peak_tension_n)
    };
    let (air, water, syrup) = (report(0.0).unwrap(), report(250.0).unwrap(), report(5000.0));
    assert!(water > air + 2.0, "{air} N in air, {water} N in water");
    assert!(matches!(syrup.unwrap_err().cause, Cause::Tension(_)));
    let beside = segment(Vector3::new(5.5, 0.3, 2.0), 0.2).check(&robot(4), Distribution::LeastNorm, 0.02).unwrap_err();
    assert!(matches!(beside.cause, Cause::OutOfPlane { y_m } if y_m > 0.0), "{beside}");
}
