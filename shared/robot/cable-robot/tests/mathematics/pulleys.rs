//! Swivelling pulleys compared with numeric constructions of the wheel, and eyes with a copy of the formula for points.

use std::f64::consts::PI;

use cable_robot::energy::WinchEnergy;
use cable_robot::kinematics::{Pair, forward_kinematics, inverse_kinematics, lengths_at, mirror_position, trilaterate};
use cable_robot::motor::Motor;
use cable_robot::path::{Parabola, Path};
use cable_robot::profile::{Profile, ProfileLimits};
use cable_robot::pulley::{NoDirection, Pulley};
use cable_robot::{
    Anchors, CableVec, Distribution, Jacobian, KinematicsError, PulleyKind, Robot, RobotParts, Segment, Vector3,
    elastic, tension,
};
use proptest::prelude::*;

use crate::counting;

const HEIGHT_M: f64 = 3.0;

/// Point of the wheel after an arc from where the cable enters, in (outward, up) from the anchor; clockwise over the
/// top.
fn on_wheel(r: f64, arc: f64) -> [f64; 2] {
    [r - r * arc.cos(), r * arc.sin()]
}

/// Wrapped angle of the tangent to (p, z), found by bisection: the first arc at which the free cable is perpendicular
/// to the radius.
fn touching_arc(r: f64, p: f64, z: f64) -> f64 {
    let off = |arc: f64| {
        let [x, y] = on_wheel(r, arc);
        ((x - r) * (p - r) + y * z) / r - r
    };
    let step = 1e-3;
    let first = (0..6300).map(|i| f64::from(i) * step).find(|arc| off(arc + step) >= 0.0).unwrap();
    let (mut low, mut high) = (first, first + step);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if off(middle) < 0.0 { low = middle } else { high = middle }
    }
    high
}

/// Length of a taut string from the anchor over a wheel of many corners: it runs from corner to corner as long as the
/// next edge turns left of the node, because a string only turns right.
fn string_length(r: f64, p: f64, z: f64) -> f64 {
    const CORNERS: u32 = 100_000;
    let corner = |i: u32| on_wheel(r, 2.0 * PI * f64::from(i) / f64::from(CORNERS));
    let mut length = 0.0;
    for i in 0..CORNERS {
        let ([ax, ay], [bx, by]) = (corner(i), corner(i + 1));
        let left = (p - ax) * (by - ay) - (z - ay) * (bx - ax) > 0.0;
        if !left {
            return length + (p - ax).hypot(z - ay);
        }
        length += (bx - ax).hypot(by - ay);
    }
    f64::NAN
}

/// Anchors at the corners of a slightly irregular polygon.
fn anchors(n: usize, off: &[f64; 24], radii: &[f64]) -> Anchors {
    let points: Vec<[f64; 3]> = (0..n)
        .map(|i| {
            let angle = 2.0 * PI * i as f64 / n as f64;
            [6.0 * angle.cos() + off[3 * i], 6.0 * angle.sin() + off[3 * i + 1], HEIGHT_M + off[3 * i + 2]]
        })
        .collect();
    Anchors::new(&points).unwrap().with_pulleys(&radii[..n]).unwrap()
}

fn planar(n: usize, radii: &[f64]) -> Anchors {
    let points = [[0.0, 4.2], [8.0, 4.0], [8.1, 0.3], [-0.1, 0.1], [4.0, 5.5]];
    Anchors::planar(&points[..n]).unwrap().with_pulleys(&radii[..n]).unwrap()
}

fn offsets() -> impl Strategy<Value = [f64; 24]> {
    prop::array::uniform24(-0.3..0.3f64)
}

fn radii() -> impl Strategy<Value = [f64; 8]> {
    // One in four is an eye.
    prop::array::uniform8(prop_oneof![1 => Just(0.0), 3 => 0.005..0.1f64])
}

fn inside() -> impl Strategy<Value = Vector3<f64>> {
    [-3.0..3.0f64, -3.0..3.0f64, -1.0..2.5f64].prop_map(Vector3::from)
}

fn in_plane() -> impl Strategy<Value = Vector3<f64>> {
    (0.6..7.4f64, 0.5..3.7f64).prop_map(|(x, z)| Vector3::new(x, 0.0, z))
}

proptest! {
    #[test]
    fn the_touching_point_is_where_a_tangent_is_found_numerically(
        r in 0.005..0.2f64, p in 0.001..6.0f64, z in -5.0..3.0f64, azimuth in 0.0..6.2f64,
    ) {
        prop_assume!((p - r).hypot(z) > 1.001 * r);
        let anchor = Vector3::new(1.0, -2.0, 3.0);
        let outward = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let node = anchor + outward * p + Vector3::z() * z;
        let cable = Pulley::new(anchor, r).cable_to(&node).unwrap();
        let arc = touching_arc(r, p, z);
        let [x, y] = on_wheel(r, arc);
        let free = node - (anchor + outward * x + Vector3::z() * y);
        prop_assert!((cable.length_m - free.norm() - r * arc).abs() < 1e-9, "{cable:?} {arc}");
        prop_assert!((cable.free_m - free.norm()).abs() < 1e-7);
        prop_assert!((cable.direction - free / free.norm()).norm() < 1e-6);
        // The cable leaves the wheel in the direction in which it runs over it.
        let along = outward * arc.sin() + Vector3::z() * arc.cos();
        prop_assert!(cable.direction.dot(&along) > 1.0 - 1e-9);
        // The formula with two angles.
        let c = (p - r).hypot(z);
        let angle = PI + (-z).atan2(p - r) - (r / c).acos();
        prop_assert!((cable.length_m - (c * c - r * r).sqrt() - r * angle).abs() < 1e-9);
    }

    #[test]
    fn the_direction_is_the_derivative_of_the_length_and_the_curvature_that_of_the_direction(
        n in 3usize..=8, off in offsets(), r in radii(), p in inside(),
    ) {
        let anchors = anchors(n, &off, &r);
        let j = Jacobian::at(&anchors, &p).unwrap();
        let h = 1e-5;
        for k in 0..3 {
            let mut d = Vector3::zeros();
            d[k] = h;
            let (up, down) = (inverse_kinematics(&anchors, &(p + d)), inverse_kinematics(&anchors, &(p - d)));
            let (j_up, j_down) = (Jacobian::at(&anchors, &(p + d)).unwrap(), Jacobian::at(&anchors, &(p - d)).unwrap());
            for i in 0..n {
                prop_assert!(((up[i] - down[i]) / (2.0 * h) - j[i][k]).abs() < 1e-8);
                let second = (j_up[i] - j_down[i]) / (2.0 * h);
                let curvature = anchors.pulley(i).cable_to(&p).unwrap().curvature();
                prop_assert!((second - curvature.column(k)).norm() < 1e-7, "{second} {curvature}");
            }
        }
        for row in j.iter() {
            prop_assert!((row.norm() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_planar_direction_is_the_derivative_too(n in 2usize..=5, r in radii(), p in in_plane()) {
        let anchors = planar(n, &r);
        // Not on the vertical axis of the fifth anchor.
        prop_assume!((p.x - 4.0).abs() > 0.25);
        let j = Jacobian::at(&anchors, &p).unwrap();
        let h = 1e-5;
        for d in [Vector3::new(h, 0.0, 0.0), Vector3::new(0.0, 0.0, h)] {
            let (up, down) = (inverse_kinematics(&anchors, &(p + d)), inverse_kinematics(&anchors, &(p - d)));
            let (j_up, j_down) = (Jacobian::at(&anchors, &(p + d)).unwrap(), Jacobian::at(&anchors, &(p - d)).unwrap());
            for i in 0..n {
                prop_assert!(((up[i] - down[i]) / (2.0 * h) - j[i].dot(&(d / h))).abs() < 1e-8);
                prop_assert_eq!(j[i].y, 0.0);
                let second = (j_up[i] - j_down[i]) / (2.0 * h);
                let curvature = anchors.pulley(i).cable_to(&p).unwrap().curvature() * (d / h);
                prop_assert!((second - curvature).norm() < 1e-5, "{second} {curvature}");
            }
        }
    }

    #[test]
    fn forward_undoes_inverse(n in 3usize..=8, off in offsets(), r in radii(), p in inside(), hint in inside()) {
        let anchors = anchors(n, &off, &r);
        let l = lengths_at(&anchors, &p).unwrap();
        for near in [None, Some(p), Some(hint)] {
            let found = forward_kinematics(&anchors, &l, near.as_ref()).unwrap();
            prop_assert!((found.position - p).norm() < 1e-8, "{found:?} {p:?}");
            prop_assert!(found.residual_rms_m < 1e-9);
        }
    }

    #[test]
    fn forward_undoes_inverse_in_the_plane(n in 2usize..=5, r in radii(), p in in_plane()) {
        let anchors = planar(n, &r);
        prop_assume!((p.x - 4.0).abs() > 0.25);
        let l = lengths_at(&anchors, &p).unwrap();
        let found = forward_kinematics(&anchors, &l, Some(&(p + Vector3::new(0.1, 0.0, -0.1)))).unwrap();
        prop_assert!((found.position - p).norm() < 1e-6, "{found:?} {p:?}");
        let lower = forward_kinematics(&anchors, &l, None).unwrap();
        prop_assert!((lower.position - p).norm() < 1e-6 || n == 2, "{lower:?} {p:?}");
    }

    #[test]
    fn noisy_lengths_end_at_a_stationary_point(
        n in 4usize..=8, off in offsets(), r in radii(), p in inside(), noise in prop::array::uniform8(-0.02..0.02f64),
    ) {
        let anchors = anchors(n, &off, &r);
        let l = inverse_kinematics(&anchors, &p).zip_map(&noise, |l, e| l + e);
        let found = forward_kinematics(&anchors, &l, None).unwrap();
        let (j, at) = (Jacobian::at(&anchors, &found.position).unwrap(), inverse_kinematics(&anchors, &found.position));
        let gradient = (0..n).fold(Vector3::zeros(), |g, i| g + j[i] * (at[i] - l[i]));
        prop_assert!(gradient.norm() < 1e-8 && found.residual_rms_m <= 0.02, "{gradient:?}");
    }

    #[test]
    fn the_length_is_convex_outside_two_radii(
        r in 0.005..0.1f64, a in inside(), b in inside(), share in 0.0..1.0f64,
    ) {
        let pulley = Pulley::new(Vector3::new(-3.0 - 2.0 * r, 0.0, 3.0), r);
        let between = a + (b - a) * share;
        let chord = pulley.length_m(&a) + (pulley.length_m(&b) - pulley.length_m(&a)) * share;
        prop_assert!(pulley.length_m(&between) <= chord + 1e-12);
    }

    #[test]
    fn eyes_are_computed_by_the_formula_for_points_bit_for_bit(n in 3usize..=8, off in offsets(), p in inside()) {
        let anchors = anchors(n, &off, &[0.0; 8]);
        let l = inverse_kinematics(&anchors, &p);
        let j = Jacobian::at(&anchors, &p).unwrap();
        for i in 0..n {
            let d = p - anchors[i];
            let length = (d.x * d.x + d.y * d.y + d.z * d.z).sqrt();
            prop_assert_eq!(l[i].to_bits(), length.to_bits());
            let row = [d.x * (1.0 / length), d.y * (1.0 / length), d.z * (1.0 / length)];
            prop_assert_eq!(<[f64; 3]>::from(j[i]).map(f64::to_bits), row.map(f64::to_bits));
        }
        if n == 3 {
            let found = forward_kinematics(&anchors, &l, None).unwrap().position;
            let Pair { points: [a, b], .. } =
                trilaterate([anchors[0], anchors[1], anchors[2]], [l[0], l[1], l[2]]).unwrap();
            prop_assert_eq!(found, if a.z <= b.z { a } else { b });
        }
        let weight = Vector3::new(0.0, 0.0, 19.6);
        let unit: Vec<Vector3<f64>> = (0..n).map(|i| (anchors[i] - p) / (anchors[i] - p).norm()).collect();
        let method = if n == 3 { Distribution::Unique } else { Distribution::LeastNorm };
        let limits = [0.0, f64::INFINITY];
        let frozen = tension::distribute(&cable_robot::StructureMatrix::from_columns(&unit), &weight, limits, method);
        if let Ok(frozen) = frozen {
            prop_assert_eq!(tension::hold(&anchors, &p, &weight, limits, method).unwrap(), frozen);
        }
    }

    #[test]
    fn elastic_cables_balance_the_weight_and_their_sensitivity_is_a_derivative(r in radii(), p in inside()) {
        let robot = robot(&r);
        let Ok(held) = elastic::realise(&robot, &p, &Vector3::zeros(), Distribution::LeastNorm) else { return Ok(()) };
        let hangs = |l: &CableVec| elastic::equilibrium(&robot, l, &Vector3::zeros(), Some(&p)).unwrap();
        let found = hangs(&held.unstretched_m);
        prop_assert!((found.position - p).norm() < 1e-6, "{found:?}");
        let h = 1e-5;
        for i in 0..4 {
            let shifted = |by: f64| {
                let mut l = held.unstretched_m;
                l[i] += by;
                hangs(&l).position
            };
            let slope = (shifted(h) - shifted(-h)) / (2.0 * h);
            prop_assert!((slope - found.sensitivity[i]).norm() < 1e-3 * (1.0 + slope.norm()), "{slope} {:?}", found.sensitivity[i]);
        }
    }
}

fn robot(radii: &[f64]) -> Robot {
    Robot::new(RobotParts {
        anchors_m: vec![[-5.0, -5.0, 4.05], [5.0, -4.9, 4.10], [4.9, 5.1, 3.98], [-5.1, 5.0, 4.02]],
        pulley: PulleyKind::Swivel,
        pulley_radius_m: Some(radii[..4].to_vec()),
        node_mass_kg: 1.2,
        tension_limits_n: [0.5, 90.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        ground_m: -2.0,
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; 4]),
        ..RobotParts::default()
    })
    .unwrap()
}

#[test]
fn the_length_is_that_of_a_string_over_a_polygon() {
    for r in [0.02, 0.05, 0.1, 0.3] {
        for (p, z) in [(0.8, -0.1), (1.0, 0.0), (2.0, -3.0), (0.7, -2.0), (3.0, 1.5), (5.0, -0.5), (1.0, 4.0)] {
            let pulley = Pulley { anchor: Vector3::zeros(), radius_m: r, planar: true };
            for side in [-1.0, 1.0] {
                let length = pulley.length_m(&Vector3::new(side * p, 0.0, z));
                let string = string_length(r, p, z);
                assert!((length - string).abs() < 1e-8, "r {r}, ({p}, {z}): {length} {string}");
            }
        }
    }
}

#[test]
fn nothing_jumps_where_the_node_passes_below_the_wheels_centre_or_the_radius_vanishes() {
    let r = 0.05;
    let pulley = Pulley::new(Vector3::zeros(), r);
    for z in [-3.0, -0.3, 0.3, 3.0] {
        let at = |p: f64| pulley.cable_to(&Vector3::new(p, 0.0, z)).unwrap();
        for p in [r, 2.0 * r] {
            let (before, after) = (at(p - 1e-9), at(p + 1e-9));
            assert!((before.length_m - after.length_m).abs() < 1e-8);
            assert!((before.direction - after.direction).norm() < 1e-7);
            assert!((before.curvature() - after.curvature()).norm() < 1e-4);
        }
        // Near the axis the length tends to its value there.
        let near = at(1e-6).length_m;
        assert!((near - pulley.length_m(&Vector3::new(0.0, 0.0, z))).abs() < 2e-6);
    }
    let node = Vector3::new(2.0, 1.0, -1.5);
    let thin = Pulley { radius_m: 1e-9, ..pulley }.cable_to(&node).unwrap();
    let eye = Pulley { radius_m: 0.0, ..pulley }.cable_to(&node).unwrap();
    assert!((thin.length_m - eye.length_m).abs() < 4e-9 && (thin.direction - eye.direction).norm() < 1e-8);
    assert!((thin.curvature() - eye.curvature()).norm() < 1e-8);
}

#[test]
fn poses_without_a_direction_are_typed_errors() {
    let anchors = anchors(3, &[0.0; 24], &[0.05; 8]);
    let at = |x: f64, z: f64| anchors[0] + Vector3::new(x, 0.0, z);
    let inside = lengths_at(&anchors, &at(-0.06, 0.01)).unwrap_err();
    assert!(matches!(inside, KinematicsError::InsidePulley { cable: 1, .. }), "{inside}");
    let axis = lengths_at(&anchors, &at(0.0, -1.0)).unwrap_err();
    assert!(matches!(axis, KinematicsError::OnPulleyAxis { cable: 1, .. }), "{axis}");
    for position in [at(-0.06, 0.01), at(0.0, -1.0)] {
        assert_eq!(Jacobian::at(&anchors, &position).unwrap_err().kind(), "singular");
        let held = tension::hold(&anchors, &position, &Vector3::z(), [0.0, 9.0], Distribution::Unique);
        assert_eq!(held.unwrap_err().kind(), "singular");
    }
    assert!(inverse_kinematics(&anchors, &at(-0.06, 0.01))[0].is_nan());
    assert_eq!(anchors.pulley(0).cable_to(&Vector3::repeat(f64::NAN)).unwrap_err(), NoDirection::AtAnchor);
    for (lengths, kind) in [
        (&[1.0, 1.0, 1.0][..], "unreachable"),
        (&[5.0, 5.0], "invalid_argument"),
        (&[5.0, f64::NAN, 5.0], "invalid_argument"),
        (&[5.0, -5.0, 5.0], "invalid_argument"),
    ] {
        assert_eq!(forward_kinematics(&anchors, lengths, None).unwrap_err().kind(), kind);
    }
}

#[test]
fn three_cables_have_a_lower_and_an_upper_position() {
    let anchors = anchors(3, &[0.05; 24], &[0.04; 8]);
    let p = Vector3::new(0.7, -0.4, 1.0);
    let l = inverse_kinematics(&anchors, &p);
    let lower = forward_kinematics(&anchors, &l, None).unwrap();
    let mirror = mirror_position(&anchors, &l, &lower.position).unwrap();
    assert!((lower.position - p).norm() < 1e-9 && mirror.z > HEIGHT_M);
    assert!(inverse_kinematics(&anchors, &mirror).iter().zip(l.iter()).all(|(a, b)| (a - b).abs() < 1e-9));
    let upper = forward_kinematics(&anchors, &l, Some(&mirror)).unwrap();
    assert!((upper.position - mirror).norm() < 1e-9);
    assert!((mirror_position(&anchors, &l, &upper.position).unwrap() - p).norm() < 1e-9);
    assert_eq!(mirror_position(&anchors, &l[..2], &p), None);
}

#[test]
fn checks_and_energy_of_a_move_use_the_pulleys() {
    let robot = robot(&[0.1; 4]);
    let (from, to) = (Vector3::new(-2.0, -1.0, 0.5), Vector3::new(2.0, 1.5, 0.5));
    let path = Path::line(from, to);
    let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
    let segment = Segment { id: 1, path, profile, start_s: 0.0 };
    let report = segment.check(&robot, Distribution::LeastNorm, 0.01).unwrap();
    let start = elastic::realise(&robot, &from, &Vector3::zeros(), Distribution::LeastNorm).unwrap();
    let held = tension::at(&robot, &from, &Vector3::zeros(), Distribution::LeastNorm).unwrap();
    let stretched = elastic::stretched(&robot, &from, &start.unstretched_m, &held.tensions_n);
    for i in 0..4 {
        assert!((stretched[i] - robot.anchors().pulley(i).length_m(&from)).abs() < 1e-12);
        assert!(report.shortest_m[i] <= start.unstretched_m[i] && start.unstretched_m[i] <= report.longest_m[i]);
    }
    let motor = Motor::ideal(40.0, 1.2);
    let energy = |anchors: &Anchors| {
        let winch_energy = WinchEnergy {
            anchors,
            wrench_n: robot.wrench_n(&Vector3::zeros()),
            drag_n_s2_m2: 0.0,
            cable_weight_n_m: 0.0,
            limits_n: robot.tension_limits_n(),
            method: Distribution::LeastNorm,
            current: &motor,
        };
        let line = Parabola { from, to, mu_per_m: 0.0 };
        winch_energy.constant_speed(&line, 0.2, 64).unwrap().energy_j
    };
    // Simpson's rule with the tensions of the structure matrix: ideal motors lose R (T / k)².
    let loss = |u: f64| {
        let at = from + (to - from) * u;
        let t = tension::at(&robot, &at, &Vector3::zeros(), Distribution::LeastNorm).unwrap().tensions_n;
        1.2 * t.norm_squared() / (40.0 * 40.0)
    };
    let n = 256;
    let weight = |i: u32| {
        if i == 0 || i == n {
            1.0
        } else if i % 2 == 1 {
            4.0
        } else {
            2.0
        }
    };
    let sum: f64 = (0..=n).map(|i| weight(i) * loss(f64::from(i) / f64::from(n))).sum();
    let expected = sum / (3.0 * f64::from(n)) * (to - from).norm() / 0.2;
    assert!((energy(robot.anchors()) / expected - 1.0).abs() < 1e-6);
    let eyes = robot.anchors().with_pulleys(&[0.0; 4]).unwrap();
    assert!((energy(&eyes) / expected - 1.0).abs() > 1e-4);
}

#[test]
fn pulleys_allocate_nothing() {
    let robot = robot(&[0.04; 4]);
    let p = Vector3::new(0.3, 0.4, 1.0);
    let held = elastic::realise(&robot, &p, &Vector3::zeros(), Distribution::LeastNorm).unwrap();
    let used = counting::allocations(|| {
        let l = inverse_kinematics(robot.anchors(), &p);
        let found = forward_kinematics(robot.anchors(), &l, Some(&p)).unwrap();
        let hangs = elastic::equilibrium(&robot, &held.unstretched_m, &Vector3::zeros(), None).unwrap();
        assert!((found.position - hangs.position).norm() < 1e-6);
    });
    assert_eq!(used, 0);
}
