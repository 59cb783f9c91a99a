//! Cost of moves compared with an independent reference: the ratios of Tables V and VIII for substitute configurations,
//! computed by another implementation in another language. The motor tables of the paper are lost.

use cable_robot::energy::optimum::Precision;
use cable_robot::energy::{Best, Bounds, Cost, Current, CurrentTable, EnergyError, WinchEnergy};
use cable_robot::motor::Motor;
use cable_robot::path::{Parabola, Path};
use cable_robot::profile::{Profile, ProfileLimits};
use cable_robot::tension::general::GeneralStructure;
use cable_robot::tension::hold;
use cable_robot::{Anchors, Distribution, StructureMatrix, Vector3};
use proptest::prelude::*;

/// Weight of 2 kg with the g of the reference.
const WEIGHT: Vector3<f64> = Vector3::new(0.0, 0.0, 19.62);
const GROUND: Bounds = Bounds { ground_m: Some(0.0), time_weight_w: 0.0 };

fn ideal() -> Motor {
    Motor::ideal(40.0, 1.2)
}

/// Anchors on a square of 10 m at a height of 6 m.
fn square() -> Anchors {
    Anchors::new(&[[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]]).unwrap()
}

/// The corners of the square of moves, at a height of 4 m.
fn corners() -> [Vector3<f64>; 4] {
    [[2.5, 2.5, 4.0], [7.5, 2.5, 4.0], [7.5, 7.5, 4.0], [2.5, 7.5, 4.0]].map(Vector3::from)
}

/// Anchors of a triangle with sides of 9.1, 9.8 and 9.4 m.
fn triangle() -> Anchors {
    let (d1, d2, d3) = (9.1f64, 9.8f64, 9.4f64);
    let x3 = (d1 * d1 + d2 * d2 - d3 * d3) / (2.0 * d2);
    Anchors::new(&[[0.0, 0.0, 3.20], [d2, 0.0, 3.45], [x3, (d1 * d1 - x3 * x3).sqrt(), 3.05]]).unwrap()
}

fn winch_energy<'a>(anchors: &'a Anchors, method: Distribution, current: &'a dyn Current) -> WinchEnergy<'a> {
    WinchEnergy {
        anchors,
        wrench_n: WEIGHT,
        drag_n_s2_m2: 0.0,
        cable_weight_n_m: 0.0,
        limits_n: [1.0, 150.0],
        method,
        current,
    }
}

fn ratios(best: &Best) -> (f64, f64) {
    let line = best.line.unwrap();
    (best.cost.energy_j / line.energy_j, best.cost.duration_s / line.duration_s)
}

/// Asserts a value that the reference gives with this many decimals.
fn close(value: f64, expected: f64, decimals: i32) {
    assert!((value - expected).abs() < 0.6 * 10f64.powi(-decimals), "{value} {expected}");
}

#[test]
fn table_5_gains_depend_on_the_region_and_power_falls_more_than_energy() {
    let cases = [
        (0.0, ideal(), [(0.449, 1.59), (0.479, 1.55), (0.423, 1.61)]),
        (0.0, Motor::default(), [(0.455, 1.84), (0.499, 1.48), (0.455, 1.33)]),
        (0.5, ideal(), [(0.633, 1.36), (0.659, 1.33), (0.613, 1.38)]),
        (0.5, Motor::default(), [(0.656, 1.26), (0.682, 1.28), (0.647, 1.19)]),
    ];
    let anchors = triangle();
    for (lower, motor, expected) in cases {
        let points = [[3.30, 1.60, 2.45], [6.60, 1.90, 2.35], [4.90, 4.60, 2.30]]
            .map(|p| Vector3::from(p) - Vector3::new(0.0, 0.0, lower));
        let winch_energy = winch_energy(&anchors, Distribution::Unique, &motor);
        for (k, (energy, time)) in expected.into_iter().enumerate() {
            let best = winch_energy.best_parabola(&points[k], &points[(k + 1) % 3], 0.2, 64, &GROUND).unwrap();
            let (e, t) = ratios(&best);
            close(e, energy, 3);
            close(t, time, 2);
            let line = best.line.unwrap();
            assert!(best.cost.mean_power_w() / line.mean_power_w() < e && e < 1.0 && t > 1.0);
        }
    }
}

#[test]
fn table_8_least_norm_and_parabolas_save_most_together() {
    let anchors = square();
    for (motor, base, ln_line, lp_parabola, ln_parabola, mu, time) in [
        (ideal(), 28.23, 0.746, 0.659, 0.485, 0.306, 1.31),
        (Motor::default(), 62.83, 0.804, 0.649, 0.537, 0.534, 1.75),
    ] {
        for side in 0..4 {
            let (a, b) = (corners()[side], corners()[(side + 1) % 4]);
            let lp =
                winch_energy(&anchors, Distribution::MinSum, &motor).best_parabola(&a, &b, 0.2, 64, &GROUND).unwrap();
            let ln = winch_energy(&anchors, Distribution::LeastNorm, &motor)
                .best_parabola(&a, &b, 0.2, 64, &GROUND)
                .unwrap();
            let reference = lp.line.unwrap().energy_j;
            close(reference, base, 2);
            close(ln.line.unwrap().energy_j / reference, ln_line, 3);
            close(lp.cost.energy_j / reference, lp_parabola, 3);
            close(ln.cost.energy_j / reference, ln_parabola, 3);
            close(ln.mu_per_m, mu, 3);
            close(ratios(&ln).1, time, 2);
        }
    }
}

#[test]
fn figures_14_to_16_least_sum_jumps_and_least_norm_does_not() {
    let anchors = square();
    let path = Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.1 };
    let at = |u: f64, method| {
        let position = cable_robot::energy::parabola::at_fraction(&path, u).position;
        hold(&anchors, &position, &WEIGHT, [1.0, 150.0], method).unwrap().tensions_n
    };
    let (before, after) = (at(0.5 - 1e-9, Distribution::MinSum), at(0.5 + 1e-9, Distribution::MinSum));
    close((before[0] - after[0]).abs(), 10.2, 1);
    close((before[2] - after[2]).abs(), 15.5, 1);
    let mut last = at(0.0, Distribution::LeastNorm);
    for i in 1..=2000 {
        let u = f64::from(i) / 2000.0;
        let (now, sum) = (at(u, Distribution::LeastNorm), at(u, Distribution::MinSum));
        assert!(now.zip_map(&last, |a, b| a - b).max_abs() <= 0.0115, "{u}");
        assert!(now.sum() < 1.05 * sum.sum() && now.norm_squared() <= sum.norm_squared() * (1.0 + 1e-12));
        assert!(i == 1000 || sum.iter().any(|t| (t - 1.0).abs() < 1e-9), "at a limit");
        last = now;
    }
    // c = 0 at the midpoint: a tie, resolved by the least norm.
    assert!(at(0.5, Distribution::MinSum).zip_map(&at(0.5, Distribution::LeastNorm), |a, b| a - b).max_abs() < 1e-9);
}

#[test]
fn convergence_of_simpson_depends_on_the_friction_transition() {
    let anchors = square();
    // Halfway, the third cable changes from reeling in to paying out.
    let path = Parabola { from: Vector3::new(1.0, 6.0, 3.0), to: Vector3::new(9.0, 3.0, 4.0), mu_per_m: 0.05 };
    let energy = |motor: &Motor, n| {
        winch_energy(&anchors, Distribution::LeastNorm, motor).constant_speed(&path, 0.2, n).unwrap().energy_j
    };
    let error = |motor: &Motor, n| (energy(motor, n) / energy(motor, 8192) - 1.0).abs();
    for motor in [ideal(), Motor::default()] {
        assert!(error(&motor, 16) < 1e-3 && error(&motor, 32) < 1e-4 && error(&motor, 64) < 5e-6);
    }
    let hard = Motor { transition_m_s: 0.0, ..Motor::default() };
    let worst = (100..=128).map(|half| error(&hard, 2 * half)).fold(0.0, f64::max);
    assert!((3e-5..3e-3).contains(&worst), "a hard sign converges slowly: {worst}");
}

/// Minimum of a scan of µ that shares only the integrand with the optimisation.
fn scanned(winch_energy: &WinchEnergy, from: Vector3<f64>, to: Vector3<f64>, weight: f64, deepest: f64) -> f64 {
    (0..=1500)
        .filter_map(|i| {
            let mu_per_m = deepest * f64::from(i) / 1500.0;
            winch_energy.constant_speed(&Parabola { from, to, mu_per_m }, 0.2, 32).ok()
        })
        .map(|c| c.energy_j + weight * c.duration_s)
        .fold(f64::INFINITY, f64::min)
}

fn inside(height: std::ops::Range<f64>) -> impl Strategy<Value = Vector3<f64>> {
    [1.5..8.5f64, 1.5..8.5f64, height].prop_map(Vector3::from)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_finer_scan_finds_less(from in inside(0.2..5.2), to in inside(0.2..5.2), real in any::<bool>(), weight in prop_oneof![Just(0.0), 0.0..5.0f64], high in 15.0..60.0f64, lp in any::<bool>()) {
        let anchors = square();
        let motor = if real { Motor::default() } else { ideal() };
        let method = if lp { Distribution::MinSum } else { Distribution::LeastNorm };
        let winch_energy = WinchEnergy { limits_n: [1.0, high], ..winch_energy(&anchors, method, &motor) };
        let deepest = cable_robot::energy::parabola::mu_limit(&from, &to, 0.1).unwrap().unwrap();
        let bounds = Bounds { ground_m: Some(0.1), time_weight_w: weight };
        let least = scanned(&winch_energy, from, to, weight, deepest);
        match winch_energy.best_parabola(&from, &to, 0.2, 32, &bounds) {
            Ok(best) => {
                let found = best.cost.energy_j + weight * best.cost.duration_s;
                // The cost of least-sum tensions has jumps.
                let slack = if lp { 5e-3 } else { 1e-7 };
                prop_assert!(found <= least * (1.0 + slack), "{found} {least} {best:?}");
                prop_assert!(best.mu_per_m <= deepest && best.cost.peak_tension_n <= high + 1e-6 && best.cost.margin_n > -1e-6);
                if let Some(line) = best.line {
                    prop_assert!(found <= line.energy_j + weight * line.duration_s);
                }
            }
            Err(error) => {
                prop_assert!(!least.is_finite(), "{error} {least}");
                prop_assert_eq!(error.kind(), "infeasible");
            }
        }
    }

    #[test]
    fn a_long_trapezoid_costs_what_constant_speed_costs(from in inside(1.0..4.0), to in inside(1.0..4.0), mu_per_m in 0.0..0.05f64) {
        prop_assume!((to - from).xy().norm() > 2.0);
        let anchors = square();
        let motor = Motor::default();
        let winch_energy = winch_energy(&anchors, Distribution::LeastNorm, &motor);
        let parabola = Parabola { from, to, mu_per_m };
        let path = Path::Parabola(parabola);
        let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.05, 2.0)).unwrap();
        let (a, b) = (winch_energy.along_profile(&path, &profile, 2.0, 64).unwrap(), winch_energy.constant_speed(&parabola, 0.05, 64).unwrap());
        prop_assert!((a.energy_j / b.energy_j - 1.0).abs() < 0.01 && (a.duration_s / b.duration_s - 1.0).abs() < 0.01, "{a:?} {b:?}");
    }

    #[test]
    fn cost_along_a_profile_agrees_with_a_fine_sum(from in inside(1.0..4.0), to in inside(1.0..4.0), mu_per_m in 0.0..0.2f64) {
        prop_assume!((to - from).xy().norm() > 1.0);
        let anchors = square();
        let motor = Motor::default();
        let winch_energy = winch_energy(&anchors, Distribution::LeastNorm, &motor);
        let path = Path::Parabola(Parabola { from, to, mu_per_m });
        let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.3, 0.4)).unwrap();
        let n = 20_000;
        let step = profile.duration() / f64::from(n);
        let mut energy = 0.0;
        for i in 0..n {
            let along = profile.at((f64::from(i) + 0.5) * step);
            let point = path.at(along.s_m);
            let (v, a) = (point.tangent * along.v_m_s, point.tangent * along.a_m_s2 + point.curvature * along.v_m_s * along.v_m_s);
            let held = hold(&anchors, &point.position, &(WEIGHT + a * 2.0), [1.0, 150.0], Distribution::LeastNorm).unwrap();
            for (anchor, tension) in anchors.iter().zip(held.tensions_n.iter()) {
                let current = motor.current_a(*tension, (anchor - point.position).normalize().dot(&v));
                energy += motor.resistance_ohm * current * current * step;
            }
        }
        let cost: Cost = winch_energy.along_profile(&path, &profile, 2.0, 256).unwrap();
        prop_assert!((cost.energy_j / energy - 1.0).abs() < 2e-3, "{} {energy}", cost.energy_j);
        prop_assert!((cost.duration_s - profile.duration()).abs() < 1e-12);
    }
}

#[test]
fn the_deepest_of_several_minima_is_found() {
    // Two valleys, the deeper one narrow and at the far end.
    let anchors = square();
    let motor = ideal();
    let base = winch_energy(&anchors, Distribution::LeastNorm, &motor)
        .constant_speed(&Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.0 }, 0.2, 16)
        .unwrap();
    let best = cable_robot::energy::optimum::best(&corners()[0], &corners()[1], &GROUND, |path, _| {
        let near = (path.mu_per_m - 0.05) * 20.0;
        let far = (path.mu_per_m - 0.55) * 60.0;
        Ok(Cost { energy_j: 3.0 - 1.0 / (1.0 + near * near) - 1.2 / (1.0 + far * far), ..base })
    })
    .unwrap();
    assert!((best.mu_per_m - 0.55).abs() < 1e-3, "{best:?}");
}

/// The lowest place is at the edge of an infeasible interval, behind a rise and between two points of the scan.
#[test]
fn the_edge_of_an_infeasible_interval_is_searched() {
    let anchors = square();
    let motor = ideal();
    let base = winch_energy(&anchors, Distribution::LeastNorm, &motor)
        .constant_speed(&Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.0 }, 0.2, 16)
        .unwrap();
    let valleys = [
        (0.1913151835075288, 0.03208968720921646, 1.5295874126210594),
        (0.15072639150504633, 0.016439405124261522, 0.7288739886835366),
    ];
    let edge = 0.16893054369730678;
    let best = cable_robot::energy::optimum::best(&corners()[0], &corners()[1], &GROUND, |path, _| {
        if path.mu_per_m > edge && path.mu_per_m < 0.31 {
            let violation = cable_robot::tension::Violation { cable: 0, tension_n: 200.0, limit_n: 150.0 };
            let why = cable_robot::tension::TensionError::Infeasible(violation);
            return Err(EnergyError::Tension { x: 0.0, y: 0.0, z: 0.0, why });
        }
        Ok(Cost { energy_j: landscape(&valleys, path.mu_per_m), ..base })
    })
    .unwrap();
    assert!(best.mu_per_m <= edge && best.mu_per_m > edge - 1e-4, "{best:?}");
}

/// Between the points of a scan that is not made denser, two valleys beside each other pass for one.
#[test]
fn the_deeper_of_two_valleys_beside_each_other_is_found() {
    let anchors = square();
    let motor = ideal();
    let base = winch_energy(&anchors, Distribution::LeastNorm, &motor)
        .constant_speed(&Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.0 }, 0.2, 16)
        .unwrap();
    let cases = [
        (
            [
                (0.5796968904138805, 0.0157761616466248, 1.0607842257535625),
                (0.24300837709271378, 0.052274060667031115, 0.9094203814670605),
                (0.6143476950637963, 0.036175441966715266, 1.6883427752829945),
            ],
            7.9986,
        ),
        (
            [
                (0.3992603807975343, 0.018643683865116653, 0.43012738793302197),
                (0.37114030622834926, 0.018994677320080415, 0.5978298110467981),
                (0.4541491108819055, 0.05609863658474969, 0.528135461761301),
            ],
            9.0895,
        ),
    ];
    for (valleys, least) in cases {
        let found = cable_robot::energy::optimum::best(&corners()[0], &corners()[1], &GROUND, |path, _| {
            Ok(Cost { energy_j: landscape(&valleys, path.mu_per_m), ..base })
        });
        let energy_j = found.unwrap().cost.energy_j;
        assert!(energy_j < least + 1e-3, "{energy_j} {least}");
    }
}

/// A function with a few valleys wider than the distance of the scan's points, and infeasible intervals between:
/// nothing that a fine scan finds is missed. Motor costs have up to three valleys.
fn landscape(valleys: &[(f64, f64, f64)], mu: f64) -> f64 {
    valleys.iter().fold(10.0, |sum, (at, width, depth)| {
        let off = (mu - at) / width;
        sum - depth / (1.0 + off * off)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn the_deepest_valley_of_a_landscape_is_found(
        // The deepest sag above the ground here is 0.64 1/m.
        valleys in proptest::collection::vec((0.0..0.64f64, 0.015..0.1f64, 0.2..2.0f64), 2..4),
        forbidden in proptest::option::of((0.0..0.6f64, 0.02..0.3f64)),
    ) {
        let anchors = square();
        let motor = ideal();
        let base = winch_energy(&anchors, Distribution::LeastNorm, &motor)
            .constant_speed(&Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.0 }, 0.2, 16)
            .unwrap();
        let deepest = cable_robot::energy::parabola::mu_limit(&corners()[0], &corners()[1], 0.0).unwrap().unwrap();
        let barred = |mu: f64| forbidden.is_some_and(|(from, width)| mu > from && mu < from + width);
        let best = cable_robot::energy::optimum::best(&corners()[0], &corners()[1], &GROUND, |path, _| {
            if barred(path.mu_per_m) {
                let why = cable_robot::tension::TensionError::Infeasible(cable_robot::tension::Violation {
                    cable: 0, tension_n: 200.0, limit_n: 150.0,
                });
                return Err(EnergyError::Tension { x: 0.0, y: 0.0, z: 0.0, why });
            }
            Ok(Cost { energy_j: landscape(&valleys, path.mu_per_m), ..base })
        });
        let least = (0..=40_000)
            .map(|i| deepest * f64::from(i) / 40_000.0)
            .filter(|mu| !barred(*mu))
            .map(|mu| landscape(&valleys, mu))
            .fold(f64::INFINITY, f64::min);
        match best {
            Ok(best) => {
                prop_assert!(!barred(best.mu_per_m));
                prop_assert!(best.cost.energy_j <= least + 0.002 * (10.0 - least), "{} {least} {best:?}", best.cost.energy_j);
            }
            Err(error) => prop_assert!(!least.is_finite(), "{error}"),
        }
    }
}

/// A move of three cables whose cost falls up to the ground, over several places that the scan takes for low ones.
/// Golden sections to each of their ends would take 170 evaluations.
#[test]
fn a_cost_that_falls_to_the_ground_takes_few_evaluations() {
    let anchors = Anchors::new(&[[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]]).unwrap();
    let motor = Motor::default();
    let winch_energy = winch_energy(&anchors, Distribution::Unique, &motor);
    let (from, to) = (Vector3::new(3.3, 1.6, 2.2), Vector3::new(6.6, 1.9, 2.1));
    let mut fine = 0;
    let best = cable_robot::energy::optimum::best(&from, &to, &GROUND, |path, precision| {
        fine += usize::from(precision == Precision::Fine);
        winch_energy.constant_speed(path, 0.2, if precision == Precision::Fine { 64 } else { 16 })
    });
    let limit = cable_robot::energy::parabola::mu_limit(&from, &to, 0.0).unwrap().unwrap();
    assert_eq!(best.unwrap().mu_per_m, limit);
    assert!(fine <= 50, "{fine}");
}

/// A scan that leaves out what is forbidden costs a fine evaluation for each of its points there, and no valley.
#[test]
fn a_valley_beside_a_place_that_only_fine_evaluations_refuse_is_found() {
    let (anchors, motor) = (square(), ideal());
    let base = winch_energy(&anchors, Distribution::LeastNorm, &motor)
        .constant_speed(&Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.0 }, 0.2, 16)
        .unwrap();
    let why = cable_robot::tension::TensionError::Infeasible(cable_robot::tension::Violation {
        cable: 0,
        tension_n: 200.0,
        limit_n: 150.0,
    });
    // The lowest place is forbidden; of what is left, the lowest is the end of the valley or another valley.
    for (forbidden, expected) in [(0.15..0.35, 0.15), (0.1..0.64, 0.1), (0.2..0.7, 0.2), (0.0..0.28, 0.28)] {
        let best = cable_robot::energy::optimum::best(&corners()[0], &corners()[1], &GROUND, |path, precision| {
            let mu = path.mu_per_m;
            if precision == Precision::Fine && mu > forbidden.start && mu < forbidden.end {
                return Err(EnergyError::Tension { x: 0.0, y: 0.0, z: 0.0, why });
            }
            Ok(Cost { energy_j: 1.0 + (mu - 0.24).abs(), ..base })
        });
        let found = best.unwrap().mu_per_m;
        assert!((found - expected).abs() < 1e-3 && !(found > forbidden.start && found < forbidden.end), "{found}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Near an end of the range the search tries that end early; it must not take it for a minimum beside it, be it
    /// round, sharp, or a place before a step upwards.
    #[test]
    fn a_valley_near_the_ground_is_found(
        beside in prop_oneof![Just(0.0), -6.0..-1.0f64].prop_map(|power| if power < 0.0 { 10f64.powf(power) } else { 0.0 }),
        power in 1.0..3.0f64,
        step in any::<bool>(),
    ) {
        let (anchors, motor) = (square(), ideal());
        let base = winch_energy(&anchors, Distribution::LeastNorm, &motor)
            .constant_speed(&Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.0 }, 0.2, 16)
            .unwrap();
        let deepest = cable_robot::energy::parabola::mu_limit(&corners()[0], &corners()[1], 0.0).unwrap().unwrap();
        let cost = |mu: f64| {
            let off = mu / deepest - (1.0 - beside);
            1.0 + off.abs().powf(power) + if step && off > 1e-12 { 1.0 } else { 0.0 }
        };
        let found = cable_robot::energy::optimum::best(&corners()[0], &corners()[1], &GROUND, |path, _| {
            Ok(Cost { energy_j: cost(path.mu_per_m), ..base })
        });
        // The minimum is found to 1e-4 of a bracket, two distances of points of the scan, each a fortieth of the range.
        let energy_j = found.unwrap().cost.energy_j;
        prop_assert!(energy_j <= 1.0 + 5e-6, "{energy_j}");
    }
}

#[test]
fn an_infeasible_line_has_no_cost_but_a_parabola_may() {
    let anchors = square();
    let motor = ideal();
    let (from, to) = (Vector3::new(0.6, 0.6, 4.5), Vector3::new(9.4, 0.6, 4.5));
    let tight = WinchEnergy { limits_n: [1.0, 28.0], ..winch_energy(&anchors, Distribution::LeastNorm, &motor) };
    let best = tight.best_parabola(&from, &to, 0.2, 64, &GROUND).unwrap();
    assert!(best.line.is_none() && best.mu_per_m > 0.0 && best.cost.peak_tension_n <= 28.0 + 1e-6, "{best:?}");
    let tighter = WinchEnergy { limits_n: [1.0, 12.0], ..tight };
    assert_eq!(tighter.best_parabola(&from, &to, 0.2, 64, &GROUND).unwrap_err().kind(), "infeasible");
}

#[test]
fn the_weight_of_time_flattens_the_parabola() {
    let anchors = square();
    let motor = Motor::default();
    let winch_energy = winch_energy(&anchors, Distribution::LeastNorm, &motor);
    let mut last = f64::INFINITY;
    for time_weight_w in [0.0, 0.5, 1.0, 2.0, 5.0, 50.0] {
        let bounds = Bounds { time_weight_w, ..GROUND };
        let best = winch_energy.best_parabola(&corners()[0], &corners()[1], 0.2, 64, &bounds).unwrap();
        assert!(best.cost.duration_s <= last + 1e-6, "{time_weight_w}");
        last = best.cost.duration_s;
    }
    assert!(last < 25.2, "with a large weight it is nearly the line: {last}");
}

#[test]
fn a_vertical_move_is_the_line_with_the_cost_of_a_fine_sum() {
    let anchors = triangle();
    let motor = Motor::default();
    let winch_energy = winch_energy(&anchors, Distribution::Unique, &motor);
    let (from, to) = (Vector3::new(4.0, 2.5, 0.5), Vector3::new(4.0, 2.5, 1.5));
    let best = winch_energy.best_parabola(&from, &to, 0.2, 64, &GROUND).unwrap();
    assert_eq!((best.mu_per_m, Some(best.cost)), (0.0, best.line));
    // Raising costs more than lowering.
    let down = winch_energy.constant_speed(&Parabola { from: to, to: from, mu_per_m: 0.0 }, 0.2, 64).unwrap();
    assert!(best.cost.energy_j > 5.0 * down.energy_j);
    assert_eq!(best.cost.duration_s, 5.0);
}

#[test]
fn a_sampled_table_agrees_with_its_motor_and_never_extrapolates() {
    let motor = Motor::default();
    let speeds: Vec<f64> = (-250..=250).map(|i| f64::from(i) * 1e-3).collect();
    let tensions: Vec<f64> = (0..=80).map(f64::from).collect();
    let rows: Vec<Vec<f64>> =
        speeds.iter().map(|v| tensions.iter().map(|t| motor.current_a(*t, *v)).collect()).collect();
    let table = CurrentTable::new(speeds, tensions, &rows, motor.resistance_ohm).unwrap();
    let anchors = square();
    let path = Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.2 };
    let cost = |current: &dyn Current, speed| {
        winch_energy(&anchors, Distribution::LeastNorm, current).constant_speed(&path, speed, 64)
    };
    let (a, b) = (cost(&table, 0.2).unwrap().energy_j, cost(&motor, 0.2).unwrap().energy_j);
    assert!((a / b - 1.0).abs() < 1e-3, "{a} {b}");
    assert_eq!(cost(&table, 0.4).unwrap_err().kind(), "out_of_range");
}

#[test]
fn arguments_out_of_range_are_refused() {
    let anchors = square();
    let motor = ideal();
    let winch_energy = winch_energy(&anchors, Distribution::LeastNorm, &motor);
    let path = Parabola { from: corners()[0], to: corners()[1], mu_per_m: 0.1 };
    let kind = |result: Result<Cost, EnergyError>| result.unwrap_err().kind();
    for speed in [0.0, -0.2, f64::NAN, f64::INFINITY] {
        assert_eq!(kind(winch_energy.constant_speed(&path, speed, 64)), "invalid_argument");
    }
    for intervals in [0, 1, 63, 1_000_000] {
        assert_eq!(kind(winch_energy.constant_speed(&path, 0.2, intervals)), "invalid_argument");
    }
    assert_eq!(kind(winch_energy.constant_speed(&Parabola { to: path.from, ..path }, 0.2, 64)), "degenerate_geometry");
    let in_plane = Vector3::new(2.0, 3.0, 6.0);
    assert_eq!(kind(winch_energy.constant_speed(&Parabola { from: in_plane, ..path }, 0.2, 64)), "singular");
    for weight in [-1.0, f64::NAN] {
        let bounds = Bounds { time_weight_w: weight, ..GROUND };
        assert_eq!(
            winch_energy.best_parabola(&path.from, &path.to, 0.2, 64, &bounds).unwrap_err().kind(),
            "invalid_argument"
        );
    }
    let below = Bounds { ground_m: Some(4.5), ..GROUND };
    assert_eq!(
        winch_energy.best_parabola(&path.from, &path.to, 0.2, 64, &below).unwrap_err().kind(),
        "invalid_argument"
    );
    assert_eq!(
        StructureMatrix::from_columns(&anchors).len(),
        GeneralStructure::from(&StructureMatrix::from_columns(&anchors)).cables()
    );
}
