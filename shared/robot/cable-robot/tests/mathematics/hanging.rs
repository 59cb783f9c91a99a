//! The whole node on cables with weight, against exact elastic catenaries (Irvine, "Cable Structures", 1981, section
//! 1.4), solved numerically here without the library.

use cable_robot::elastic::{equilibrium, realise};
use cable_robot::modes::stiffness_n_m;
use cable_robot::{CableVec, Matrix3, Robot, RobotParts, Vector3};
use proptest::prelude::*;

const G: f64 = 9.80665;

/// A robot with cables of polyethylene: fibre of 970 kg/m³ that fills 80 % of the section.
struct HangingRobot {
    robot: Robot,
    mass_kg_m: f64,
    /// Corners of the places to hang at.
    low_m: [f64; 3],
    high_m: [f64; 3],
}

fn hanging_robot(
    anchors_m: &[[f64; 3]],
    mass_kg: f64,
    limits_n: [f64; 2],
    diameter_m: f64,
    routed_m: &[f64],
) -> HangingRobot {
    let area_m2 = 0.25 * std::f64::consts::PI * diameter_m * diameter_m;
    let mass_kg_m = 970.0 * 0.8 * area_m2;
    let robot = Robot::new(RobotParts {
        anchors_m: anchors_m.to_vec(),
        node_mass_kg: mass_kg,
        tension_limits_n: limits_n,
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.4,
        // 35 GPa of a braid's section.
        stiffness_n: Some(35e9 * area_m2),
        routed_length_m: Some(routed_m.to_vec()),
        cable_mass_kg_m: mass_kg_m,
        ..RobotParts::default()
    })
    .unwrap();
    let reach = |k: usize, pick: fn(f64, f64) -> f64| anchors_m.iter().map(|a| a[k]).reduce(pick).unwrap();
    let [x, y] = [0, 1].map(|k| (reach(k, f64::min), reach(k, f64::max)));
    let inside = |(low, high): (f64, f64), share: f64| low + share * (high - low);
    let lowest = reach(2, f64::min);
    HangingRobot {
        robot,
        mass_kg_m,
        low_m: [inside(x, 0.2), inside(y, 0.2), 0.1 * lowest],
        high_m: [inside(x, 0.8), inside(y, 0.8), 0.6 * lowest],
    }
}

/// The robots of 10 m, of 30 x 20 m and of 80 x 20 m in `configs/`.
fn sites() -> [HangingRobot; 3] {
    let small = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
    let river = [[0.0, 0.0, 6.2], [30.2, 0.4, 6.6], [29.6, 20.3, 6.0], [0.3, 19.8, 6.4]];
    let forest = [[0.0, 0.0, 15.2], [80.3, 0.6, 16.1], [79.6, 20.4, 14.8], [0.5, 19.7, 15.6]];
    [
        hanging_robot(&small, 1.2, [2.0, 60.0], 0.000_33, &[6.0; 3]),
        hanging_robot(&river, 2.5, [5.0, 150.0], 0.001, &[22.0, 22.0, 42.0, 42.0]),
        hanging_robot(&forest, 5.0, [8.0, 250.0], 0.0015, &[16.0, 16.0, 36.0, 36.0]),
    ]
}

impl HangingRobot {
    fn place(&self, share: [f64; 3]) -> Vector3<f64> {
        Vector3::from_fn(|k, _| self.low_m[k] + share[k] * (self.high_m[k] - self.low_m[k]))
    }

    fn weightless(&self) -> Robot {
        with_mass(self, 0.0)
    }
}

fn with_mass(hanging: &HangingRobot, mass_kg_m: f64) -> Robot {
    let robot = &hanging.robot;
    Robot::new(RobotParts {
        anchors_m: robot.anchors().iter().map(|a| [a.x, a.y, a.z]).collect(),
        node_mass_kg: robot.node_mass_kg(),
        tension_limits_n: robot.tension_limits_n(),
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.4,
        stiffness_n: robot.stiffness_n(),
        routed_length_m: Some(robot.routed_length_m().to_vec()),
        cable_mass_kg_m: mass_kg_m,
        ..RobotParts::default()
    })
    .unwrap()
}

/// One exact cable: total unstretched length from drum to node, routed part, EA, weight per unstretched metre.
#[derive(Clone, Copy)]
struct Catenary {
    total_m: f64,
    routed_m: f64,
    ea: f64,
    w: f64,
}

impl Catenary {
    /// Horizontal and vertical distance from node to anchor for the forces (H, V) at the node.
    fn span(&self, [h, v]: [f64; 2]) -> [f64; 2] {
        let mut free = self.total_m - self.routed_m;
        for _ in 0..20 {
            let top = (h * h + (v + self.w * free).powi(2)).sqrt();
            free = self.total_m - self.routed_m / (1.0 + top / self.ea);
        }
        let above = v + self.w * free;
        let across = h * free / self.ea + h / self.w * ((above / h).asinh() - (v / h).asinh());
        let up = (v * free + 0.5 * self.w * free * free) / self.ea
            + ((h * h + above * above).sqrt() - (h * h + v * v).sqrt()) / self.w;
        [across, up]
    }

    /// Forces (H, V) at the node for a span, by Newton with differences.
    fn forces(&self, [across, up]: [f64; 2], near: [f64; 2]) -> [f64; 2] {
        let [mut h, mut v] = near;
        for _ in 0..100 {
            let [a, b] = self.span([h, v]);
            let (ra, rb) = (across - a, up - b);
            let e = 1e-6 * (h.abs() + v.abs());
            let (p, m) = (self.span([h + e, v]), self.span([h - e, v]));
            let (q, n) = (self.span([h, v + e]), self.span([h, v - e]));
            let j = [
                [(p[0] - m[0]) / (2.0 * e), (q[0] - n[0]) / (2.0 * e)],
                [(p[1] - m[1]) / (2.0 * e), (q[1] - n[1]) / (2.0 * e)],
            ];
            let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
            let (dh, dv) = ((ra * j[1][1] - rb * j[0][1]) / det, (rb * j[0][0] - ra * j[1][0]) / det);
            let share = if h + dh > 0.2 * h { 1.0 } else { 0.8 * h / -dh };
            (h, v) = (h + share * dh, v + share * dv);
            if ra.abs() + rb.abs() < 1e-11 * (across + up) {
                break;
            }
        }
        [h, v]
    }
}

/// Force on the node at `x` on exact catenaries with these measured lengths, N, with its weight; `near` has the forces
/// (H, V) of the cables at a place near `x`, and takes those at `x`.
fn force_n<'a>(
    hanging: &'a HangingRobot,
    unstretched_m: &'a CableVec,
) -> impl Fn(&Vector3<f64>, &mut Vec<[f64; 2]>) -> Vector3<f64> {
    let robot = &hanging.robot;
    let (w, ea) = (hanging.mass_kg_m * G, robot.stiffness_n().unwrap());
    move |x, near| {
        let mut sum = Vector3::new(0.0, 0.0, -robot.net_weight_n());
        for (i, a) in robot.anchors().iter().enumerate() {
            let d = a - x;
            let p = (d.x * d.x + d.y * d.y).sqrt();
            let routed_m = robot.routed_length_m()[i];
            let cable = Catenary { total_m: unstretched_m[i] + routed_m, routed_m, ea, w };
            near[i] = cable.forces([p, d.z], near[i]);
            let [h, v] = near[i];
            sum += Vector3::new(h * d.x / p, h * d.y / p, v);
        }
        sum
    }
}

/// Forces (H, V) of straight cables with half of their weights.
fn straight_forces(hanging: &HangingRobot, at: &Vector3<f64>, tensions_n: &CableVec) -> Vec<[f64; 2]> {
    let w = hanging.mass_kg_m * G;
    let of = |(a, t): (&Vector3<f64>, &f64)| {
        let d = a - at;
        [t * (d.x * d.x + d.y * d.y).sqrt() / d.norm(), t * d.z / d.norm() - 0.5 * w * d.norm()]
    };
    hanging.robot.anchors().iter().zip(tensions_n.iter()).map(of).collect()
}

/// Where the node hangs on exact catenaries with these measured lengths.
fn hangs_exactly(
    hanging: &HangingRobot,
    unstretched_m: &CableVec,
    start: Vector3<f64>,
    tensions_n: &CableVec,
) -> Vector3<f64> {
    let mut near = straight_forces(hanging, &start, tensions_n);
    let force = force_n(hanging, unstretched_m);
    let mut x = start;
    for _ in 0..50 {
        let f = force(&x, &mut near);
        let e = 1e-4;
        let columns = [0, 1, 2].map(|k| {
            let step = Vector3::from_fn(|i, _| if i == k { e } else { 0.0 });
            (force(&(x + step), &mut near) - force(&(x - step), &mut near)) / (2.0 * e)
        });
        let step = Matrix3::from_columns(&columns).try_inverse().unwrap() * f;
        x -= step * (1.0f64).min(0.5 / step.norm());
        if step.norm() < 1e-9 {
            break;
        }
    }
    assert!(force(&x, &mut near).norm() < 1e-4, "the oracle has not converged: {}", force(&x, &mut near).norm());
    x
}

/// Errors of the first order and of cables without weight at a place, m; None where the cables cannot hold the node.
fn errors_m(hanging: &HangingRobot, p: &Vector3<f64>) -> Option<[f64; 2]> {
    let zero = Vector3::zeros();
    let distribution = hanging.robot.default_distribution();
    let held = realise(&hanging.robot, p, &zero, distribution).ok()?;
    let exact = hangs_exactly(hanging, &held.unstretched_m, *p, &held.tensions_n);
    // What a weightless model commands in the same world.
    let light = realise(&hanging.weightless(), p, &zero, distribution).ok()?;
    let ignored = hangs_exactly(hanging, &light.unstretched_m, *p, &light.tensions_n);
    Some([(exact - p).norm(), (ignored - p).norm()])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    /// The bounds are about twice the largest errors over a grid (`cargo test .. -- --nocapture sag`).
    #[test]
    fn the_first_order_is_enough_at_every_size(which in 0usize..3, share in [0.0..1.0f64, 0.0..1.0f64, 0.0..1.0f64]) {
        let hanging = &sites()[which];
        if let Some([first, _]) = errors_m(hanging, &hanging.place(share)) {
            let bound_m = [1e-5, 4e-4, 4e-3][which];
            prop_assert!(first < bound_m, "{which}: {first}");
        }
    }

    #[test]
    fn the_equilibrium_undoes_the_realisation(which in 0usize..3, share in [0.0..1.0f64, 0.0..1.0f64, 0.0..1.0f64]) {
        let HangingRobot { robot, .. } = &sites()[which];
        let (p, zero) = (sites()[which].place(share), Vector3::zeros());
        if let Ok(held) = realise(robot, &p, &zero, robot.default_distribution()) {
            let there = held.unstretched_m;
            prop_assert_eq!(there, held.unstretched_m);
            for near in [None, Some(p + Vector3::new(0.3, -0.2, 0.1))] {
                let found = equilibrium(robot, &held.unstretched_m, &zero, near.as_ref()).unwrap();
                prop_assert!((found.position - p).norm() < 1e-6, "{:?} {p:?}", found.position);
                let apart = found.tensions_n.zip_map(&held.tensions_n, |a, b| a - b).max_abs();
                prop_assert!(apart < 1e-4 && !found.any_slack(), "{apart}");
            }
        }
    }
}

/// The frequencies of the node follow from this matrix. A bow that straightens makes a cable softer than its stretch
/// alone.
#[test]
fn the_stiffness_of_the_node_is_that_of_exact_catenaries() {
    for (which, hanging) in sites().iter().enumerate() {
        let p = hanging.place([0.4, 0.5, 0.3]);
        let held = realise(&hanging.robot, &p, &Vector3::zeros(), hanging.robot.default_distribution()).unwrap();
        let found = stiffness_n_m(&hanging.robot, &p, &held.tensions_n).unwrap();
        let force = force_n(hanging, &held.unstretched_m);
        let mut near = straight_forces(hanging, &p, &held.tensions_n);
        let e = 1e-4;
        let columns = [0, 1, 2].map(|k| {
            let step = Vector3::from_fn(|i, _| if i == k { e } else { 0.0 });
            (force(&(p - step), &mut near) - force(&(p + step), &mut near)) / (2.0 * e)
        });
        let exact = Matrix3::from_columns(&columns);
        let off = (found - exact).norm() / exact.norm();
        let weightless = stiffness_n_m(&hanging.weightless(), &p, &held.tensions_n).unwrap();
        let ignored = (weightless - exact).norm() / exact.norm();
        println!("robot {which}: stiffness off by {:.2} %, without weight by {:.2} %", 100.0 * off, 100.0 * ignored);
        assert!(off < 0.002 && off <= ignored + 1e-4, "robot {which}: {found} {exact}");
    }
}

#[test]
fn sag_matters_on_long_cables_and_the_first_order_removes_it() {
    for (which, hanging) in sites().iter().enumerate() {
        let mut all: Vec<[f64; 2]> = Vec::new();
        for i in 0..5 {
            for j in 0..5 {
                for k in 0..3 {
                    let share = [f64::from(i) / 4.0, f64::from(j) / 4.0, f64::from(k) / 2.0];
                    all.extend(errors_m(hanging, &hanging.place(share)));
                }
            }
        }
        let rms = |which: usize| (all.iter().map(|e| e[which] * e[which]).sum::<f64>() / all.len() as f64).sqrt();
        let max = |which: usize| all.iter().map(|e| e[which]).fold(0.0, f64::max);
        println!(
            "robot {which}, {} places, mm RMS / max: first order {:.4} / {:.4}, without weight {:.3} / {:.3}",
            all.len(),
            1e3 * rms(0),
            1e3 * max(0),
            1e3 * rms(1),
            1e3 * max(1)
        );
        assert!(all.len() > 10 && rms(0) < 0.1 * rms(1), "robot {which}");
    }
}

/// On high masts the routed parts carry the weight of the free cables too: without that the node hangs lower.
#[test]
fn the_routed_part_carries_the_free_cable() {
    let masts = [[0.0, 0.0, 40.0], [40.0, 0.0, 41.0], [20.0, 35.0, 40.5]];
    let hanging = hanging_robot(&masts, 3.0, [2.0, 200.0], 0.002, &[45.0; 3]);
    let robot = &hanging.robot;
    let (mut with_m, mut without_m) = (0.0f64, 0.0f64);
    for share in [[0.3, 0.3, 0.0], [0.5, 0.4, 0.3], [0.6, 0.2, 0.6]] {
        let p = hanging.place(share);
        let held = realise(robot, &p, &Vector3::zeros(), robot.default_distribution()).unwrap();
        let error_m = |lengths_m: &CableVec| (hangs_exactly(&hanging, lengths_m, p, &held.tensions_n) - p).norm();
        with_m = with_m.max(error_m(&held.unstretched_m));
        let uncarried_m = CableVec::from_fn(3, |i| {
            let rise_n = robot.cable_load(i, &p).rise_n;
            assert!(rise_n > 0.2 && rise_n < 1.0, "{rise_n}");
            held.unstretched_m[i] + rise_n * robot.routed_length_m()[i] / robot.stiffness_n().unwrap()
        });
        without_m = without_m.max(error_m(&uncarried_m));
    }
    println!("{:.3} mm, and {:.3} mm without what the routed part carries", 1e3 * with_m, 1e3 * without_m);
    assert!(with_m < 0.5 * without_m, "{with_m} {without_m}");
}
