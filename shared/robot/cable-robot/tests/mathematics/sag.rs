//! Cables with weight, compared with robots whose cables hang exactly: each cable is summed up from short elastic
//! pieces, from the node to the anchor and on to the drum.

use cable_robot::catenary::Span;
use cable_robot::sag::{Load, SHALLOW};
use cable_robot::*;
use proptest::prelude::*;

/// Intervals of Simpson's rule along a cable.
const PIECES: usize = 64;

/// A test robot: anchors, node mass (kg), cable mass (kg/m), EA (N), least tension (N), routed cable (m).
struct Case {
    name: &'static str,
    anchors_m: [[f64; 3]; 4],
    node_mass_kg: f64,
    cable_mass_kg_m: f64,
    stiffness_n: f64,
    least_n: f64,
    routed_m: f64,
    /// Largest distance of the exact node from where the first order puts it, m; and the least that the position is
    /// wrong without weight somewhere in the workspace.
    first_order_m: f64,
    weightless_m: f64,
}

/// Braids of 0.33, 1 and 1.5 mm in diameter: polyethylene of 970 kg/m³ that fills 80 % of the section.
const CASES: [Case; 3] = [
    Case {
        name: "10 m",
        anchors_m: [[0.0, 0.0, 6.0], [10.0, 0.0, 6.1], [10.2, 9.8, 6.2], [0.0, 10.0, 5.9]],
        node_mass_kg: 1.2,
        cable_mass_kg_m: 66e-6,
        stiffness_n: 6000.0,
        least_n: 2.0,
        routed_m: 6.0,
        first_order_m: 1e-5,
        weightless_m: 5e-5,
    },
    Case {
        name: "30 x 20 m",
        anchors_m: [[0.0, 0.0, 6.2], [30.2, 0.4, 6.6], [29.6, 20.3, 6.0], [0.3, 19.8, 6.4]],
        node_mass_kg: 2.5,
        cable_mass_kg_m: 0.61e-3,
        stiffness_n: 30e3,
        least_n: 5.0,
        routed_m: 22.0,
        first_order_m: 1e-4,
        weightless_m: 1e-3,
    },
    Case {
        name: "80 x 20 m",
        anchors_m: [[0.0, 0.0, 15.2], [80.3, 0.6, 16.1], [79.6, 20.4, 14.8], [0.5, 19.7, 15.6]],
        node_mass_kg: 5.0,
        cable_mass_kg_m: 1.37e-3,
        stiffness_n: 60e3,
        least_n: 8.0,
        routed_m: 16.0,
        first_order_m: 3e-4,
        weightless_m: 5e-3,
    },
];

impl Case {
    fn robot(&self, cables: usize, mass_kg_m: f64) -> Robot {
        Robot::new(RobotParts {
            anchors_m: self.anchors_m[..cables].to_vec(),
            node_mass_kg: self.node_mass_kg,
            tension_limits_n: [self.least_n, 500.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            stiffness_n: Some(self.stiffness_n),
            routed_length_m: Some(vec![self.routed_m; cables]),
            cable_mass_kg_m: mass_kg_m,
            ..RobotParts::default()
        })
        .unwrap()
    }

    /// A point between the first `cables` anchors at a share of their height.
    fn point(&self, cables: usize, shares: [f64; 3]) -> Vector3<f64> {
        let [a, b, c, d] = self.anchors_m.map(Vector3::from);
        let [s, t, up] = shares;
        let level = if cables == 3 {
            // Inside the triangle.
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            let (s, t) = (0.1 + 0.7 * s, 0.1 + 0.7 * t);
            b + (a - b) * s + (c - b) * t
        } else {
            let (s, t) = (0.15 + 0.7 * s, 0.15 + 0.7 * t);
            (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t
        };
        Vector3::new(level.x, level.y, a.z * (0.1 + 0.5 * up))
    }

    fn distribution(cables: usize) -> Distribution {
        if cables == 3 { Distribution::Unique } else { Distribution::LeastNorm }
    }
}

/// Where the end of a cable is relative to the node, in the vertical plane of the cable, and its tension there: summed
/// up from the node with the force (`pull`, `lift`) of the cable on it.
fn end(pull: f64, lift: f64, length: f64, w: f64, ea: f64) -> ([f64; 2], f64) {
    let piece = |k: usize| {
        let up = lift + w * length * k as f64 / PIECES as f64;
        let tension = pull.hypot(up);
        let stretched = (1.0 + tension / ea) / tension;
        [pull * stretched, up * stretched]
    };
    let weight = |k: usize| if k == 0 || k == PIECES { 1.0 } else { 2.0 + 2.0 * (k % 2) as f64 };
    let mut at = [0.0; 2];
    for k in 0..=PIECES {
        let [x, z] = piece(k);
        at[0] += weight(k) * x * length / (3.0 * PIECES as f64);
        at[1] += weight(k) * z * length / (3.0 * PIECES as f64);
    }
    (at, pull.hypot(lift + w * length))
}

/// The force of a cable on the node at `position`, horizontal toward the anchor and up: Newton steps with numerical
/// derivatives on its ends, and on the unstretched length beyond the anchor.
fn pull_of(robot: &Robot, i: usize, position: &Vector3<f64>, unstretched_m: f64, start: [f64; 2]) -> [f64; 2] {
    let (ea, w, routed) = (robot.stiffness_n().unwrap(), robot.cable_weight_n_m(), robot.routed_length_m()[i]);
    let to = robot.anchors()[i] - position;
    let level = to.x.hypot(to.y);
    let miss = |[pull, lift]: [f64; 2]| {
        // The routed part, under the tension at the anchor, stays; what it does not take up is on the way to the node.
        let mut length = unstretched_m;
        for _ in 0..3 {
            let (_, tension) = end(pull, lift, length, w, ea);
            length = unstretched_m + routed - routed / (1.0 + tension / ea);
        }
        let ([x, z], _) = end(pull, lift, length, w, ea);
        [x - level, z - to.z]
    };
    let mut force = start;
    for _ in 0..30 {
        let off = miss(force);
        let step = 1e-6 * force[0].hypot(force[1]);
        let by = [[step, 0.0], [0.0, step]].map(|[a, b]| {
            let (up, down) = (miss([force[0] + a, force[1] + b]), miss([force[0] - a, force[1] - b]));
            [(up[0] - down[0]) / (2.0 * step), (up[1] - down[1]) / (2.0 * step)]
        });
        let det = by[0][0] * by[1][1] - by[1][0] * by[0][1];
        force[0] -= (off[0] * by[1][1] - off[1] * by[1][0]) / det;
        force[1] -= (off[1] * by[0][0] - off[0] * by[0][1]) / det;
        if off[0].hypot(off[1]) < 1e-12 {
            break;
        }
    }
    force
}

/// Where the node hangs with these unstretched lengths, m: the balance of exactly hanging cables.
fn exact_node(robot: &Robot, unstretched_m: &[f64], tensions_n: &[f64], near: &Vector3<f64>) -> Vector3<f64> {
    let balance = |x: &Vector3<f64>| {
        let mut sum = Vector3::new(0.0, 0.0, -robot.net_weight_n());
        for i in 0..robot.cable_count() {
            let to = robot.anchors()[i] - x;
            let level = to.x.hypot(to.y);
            let start = [tensions_n[i] * level / to.norm(), tensions_n[i] * to.z / to.norm()];
            let [pull, lift] = pull_of(robot, i, x, unstretched_m[i], start);
            sum += Vector3::new(pull * to.x / level, pull * to.y / level, lift);
        }
        sum
    };
    let mut x = *near;
    for _ in 0..20 {
        let off = balance(&x);
        let columns = [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|d| (balance(&(x + d * 1e-5)) - balance(&(x - d * 1e-5))) / 2e-5);
        let step = Matrix3::from_columns(&columns).lu().solve(&off).unwrap();
        x -= step;
        if step.norm() < 1e-9 {
            break;
        }
    }
    x
}

/// How far the exact node is from where the model of a robot puts it, m, and its largest sag ratio.
fn miss(case: &Case, cables: usize, modelled_kg_m: f64, at: &Vector3<f64>) -> Option<(f64, f64)> {
    let (model, real) = (case.robot(cables, modelled_kg_m), case.robot(cables, case.cable_mass_kg_m));
    let held = elastic::realise(&model, at, &Vector3::zeros(), Case::distribution(cables)).ok()?;
    let sags = (0..cables).map(|i| {
        let chord = (real.anchors()[i] - at).norm();
        real.cable_weight_n_m() * chord / (8.0 * held.tensions_n[i])
    });
    let hangs = exact_node(&real, &held.unstretched_m, &held.tensions_n, at);
    Some(((hangs - at).norm(), sags.fold(0.0, f64::max)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn commanded_lengths_put_the_node_where_exact_cables_hang(shares in prop::array::uniform3(0.0..1.0_f64), cables in 3..=4_usize) {
        for case in &CASES {
            let at = case.point(cables, shares);
            let Some((off, sag)) = miss(case, cables, case.cable_mass_kg_m, &at) else { continue };
            prop_assert!(sag > SHALLOW || off < case.first_order_m, "{}: {off} m at {at:?}, sag {sag}", case.name);
        }
    }

    #[test]
    fn forward_and_inverse_agree_with_weight(shares in prop::array::uniform3(0.0..1.0_f64), cables in 3..=4_usize, heavy in 0.0..4.0_f64, stretches in any::<bool>()) {
        for case in &CASES {
            let at = case.point(cables, shares);
            let robot = case.robot(cables, heavy * case.cable_mass_kg_m);
            let robot = if stretches || cables == 4 { robot } else { robot.with_rigid_lines() };
            let still = Vector3::zeros();
            let Ok(held) = elastic::realise(&robot, &at, &still, Case::distribution(cables)) else { continue };
            let near = at + Vector3::new(0.3, -0.2, 0.1);
            for guess in [None, Some(&near)] {
                let found = elastic::equilibrium(&robot, &held.unstretched_m, &still, guess).unwrap();
                prop_assert!((found.position - at).norm() < 1e-7, "{}: {:?} for {at:?}", case.name, found.position);
                prop_assert!(found.tensions_n.iter().zip(held.tensions_n.iter()).all(|(a, b)| (a - b).abs() < 1e-4));
                prop_assert!(found.iterations < 20 && !found.any_slack(), "{} iterations", found.iterations);
            }
        }
    }

    #[test]
    fn sensitivity_is_the_derivative_of_the_position(shares in prop::array::uniform3(0.0..1.0_f64), cables in 3..=4_usize) {
        for case in &CASES {
            let at = case.point(cables, shares);
            let robot = case.robot(cables, case.cable_mass_kg_m);
            let still = Vector3::zeros();
            let Ok(held) = elastic::realise(&robot, &at, &still, Case::distribution(cables)) else { continue };
            let found = elastic::equilibrium(&robot, &held.unstretched_m, &still, Some(&at)).unwrap();
            for i in 0..cables {
                let moved = |by: f64| {
                    let mut lengths = held.unstretched_m;
                    lengths[i] += by;
                    elastic::equilibrium(&robot, &lengths, &still, Some(&at)).unwrap().position
                };
                let numerical = (moved(1e-4) - moved(-1e-4)) / 2e-4;
                let off = (found.sensitivity[i] - numerical).norm();
                // Bow and weight are held fixed, which costs a share of about the sag ratio.
                prop_assert!(off < 0.02 * numerical.norm(), "{}: {:?}, not {numerical:?}", case.name, found.sensitivity[i]);
            }
        }
    }

    #[test]
    fn the_bow_of_a_shallow_cable_is_that_of_the_catenary(slope in -1.5..1.5_f64, sag in 0.001..SHALLOW, chord in 1.0..100.0_f64, w in 1e-3..1.0_f64) {
        let direction = Vector3::new(slope.cos(), 0.0, -slope.sin());
        let pulley = pulley::Pulley::new(Vector3::zeros(), 0.0);
        let load = Load::at(&pulley, &(direction * chord), w);
        let tension = w * chord / (8.0 * sag);
        let span = Span { level_m: chord * slope.cos(), rise_m: chord * slope.sin(), weight_n_m: w, stiffness_n: f64::INFINITY };
        let hangs = span.hang(tension * slope.cos()).unwrap();
        let bow = hangs.unstretched_m - chord;
        prop_assert!((load.bow_m(tension) / bow - 1.0).abs() < 24.0 * sag * sag + 1e-9 / bow, "{} for {bow}", load.bow_m(tension));
        // The summed cable ends where the formula puts it.
        let ([x, z], _) = end(tension * slope.cos(), hangs.lift_n, hangs.unstretched_m, w, f64::INFINITY);
        prop_assert!((x - span.level_m).abs() + (z - span.rise_m).abs() < 1e-6 * chord);
    }
}

#[test]
fn a_model_without_weight_misses_by_the_bows() {
    for case in &CASES {
        let mut worst: [f64; 3] = [0.0; 3];
        for cables in 3..=4 {
            for step in 0..27 {
                let at = case.point(cables, [step % 3, step / 3 % 3, step / 9].map(|k| 0.5 * k as f64));
                let with = miss(case, cables, case.cable_mass_kg_m, &at).unwrap_or_default();
                let without = miss(case, cables, 0.0, &at).unwrap_or_default();
                worst = [worst[0].max(without.0), worst[1].max(with.0), worst[2].max(with.1)];
            }
        }
        println!("{}: {worst:.5?} m without weight, m to first order, sag ratio", case.name);
        assert!(worst[0] > case.weightless_m && worst[1] < case.first_order_m, "{}: {worst:?}", case.name);
    }
}

#[test]
fn no_weight_changes_no_bit() {
    for case in &CASES {
        let at = case.point(4, [0.3, 0.6, 0.4]);
        let robot = case.robot(4, 0.0);
        assert_eq!(robot.cable_load(0, &at), Load::default());
        let wrench = Vector3::new(-0.0, 0.0, 3.0);
        assert_eq!(robot.with_cables_n(&at, &wrench).map(f64::to_bits), wrench.map(f64::to_bits));
    }
}
