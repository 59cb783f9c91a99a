//! Tension distribution compared with oracles that share no code with it: the paper's elimination of one cable
//! (28)-(36), a scan over the tension of the last cable, and Dykstra's alternating projections.

use cable_robot::kinematics::Jacobian;
use cable_robot::tension::general::{self, GeneralStructure};
use cable_robot::tension::{self, FourCables, TensionError, distribute, least_norm, least_norm_unbounded, unique};
use cable_robot::{Anchors, CableVec, Distribution, Matrix3, StructureMatrix, Vector3};
use proptest::prelude::*;

const LIMITS: [f64; 2] = [1.0, 150.0];

fn square() -> Anchors {
    Anchors::new(&[[0.0, 0.0, 6.0], [10.4, 0.3, 6.3], [9.7, 8.9, 5.8], [-0.5, 9.4, 6.1]]).unwrap()
}

fn ring(n: usize) -> Anchors {
    let points: Vec<[f64; 3]> = (0..n)
        .map(|i| {
            let angle = 2.0 * std::f64::consts::PI * i as f64 / n as f64;
            [5.0 + 5.0 * angle.cos(), 5.0 + 5.0 * angle.sin(), 5.5 + 0.3 * (i % 3) as f64]
        })
        .collect();
    Anchors::new(&points).unwrap()
}

fn pose() -> impl Strategy<Value = Vector3<f64>> {
    [-1.0..11.0f64, -1.0..11.0f64, 0.2..5.0f64].prop_map(Vector3::from)
}

fn wrench() -> impl Strategy<Value = Vector3<f64>> {
    [-2.0..2.0f64, -2.0..2.0f64, 17.0..22.0f64].prop_map(Vector3::from)
}

/// (29)-(34): tensions as a function of the last one, and the bounds on it.
struct PaperForm {
    base: Vector3<f64>,
    slope: Vector3<f64>,
    low: f64,
    high: f64,
}

fn paper_form(s: &StructureMatrix, b: &Vector3<f64>, [min, max]: [f64; 2]) -> PaperForm {
    let g = Matrix3::from_columns(&[s[0], s[1], s[2]]).try_inverse().unwrap();
    let (base, slope) = (g * b, g * s[3]);
    let (mut low, mut high) = (min, max);
    for i in 0..3 {
        let (x, y) = ((base[i] - max) / slope[i], (base[i] - min) / slope[i]);
        low = low.max(x.min(y));
        high = high.min(x.max(y));
    }
    PaperForm { base, slope, low, high }
}

impl PaperForm {
    fn at(&self, t4: f64) -> [f64; 4] {
        let t = self.base - self.slope * t4;
        [t.x, t.y, t.z, t4]
    }

    /// (35)
    fn unconstrained(&self) -> f64 {
        self.base.dot(&self.slope) / (1.0 + self.slope.norm_squared())
    }
}

fn norm2(t: &[f64]) -> f64 {
    t.iter().map(|v| v * v).sum()
}

/// Projection of the origin on {Λ T = b} ∩ box: Dykstra's alternating projections.
fn dykstra(s: &StructureMatrix, b: &Vector3<f64>, [min, max]: [f64; 2]) -> Vec<f64> {
    let n = s.len();
    let mut gram = Matrix3::zeros();
    for c in s.iter() {
        gram += c * c.transpose();
    }
    let inverse = gram.try_inverse().unwrap();
    let mut t = vec![0.0; n];
    let mut correction = vec![0.0; n];
    for _ in 0..40_000 {
        let missing = inverse * (b - s.force(&t));
        for i in 0..n {
            t[i] += s[i].dot(&missing);
        }
        let mut moved = 0.0f64;
        for i in 0..n {
            let wanted = t[i] + correction[i];
            let boxed = wanted.clamp(min, max);
            moved = moved.max((boxed - t[i]).abs());
            correction[i] = wanted - boxed;
            t[i] = boxed;
        }
        if moved < 1e-10 {
            break;
        }
    }
    t
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// The general solver decomposes the matrix and searches the limits that act; the closed form does neither.
    #[test]
    fn four_cables_have_the_tensions_of_the_general_solver(
        p in pose(), below in prop_oneof![Just(None), (-5.0..0.0f64).prop_map(Some)],
        t in proptest::collection::vec(1.0..40.0f64, 4), high in prop_oneof![Just(41.0), Just(f64::INFINITY)],
    ) {
        // Also close below the plane of level anchors, where the closed form hands over.
        let level = [[0.0, 0.0, 6.0], [10.4, 0.3, 6.0], [9.7, 8.9, 6.0], [-0.5, 9.4, 6.0]];
        let (anchors, p) = match below {
            None => (square(), p),
            Some(log) => (Anchors::new(&level).unwrap(), Vector3::new(p.x, p.y, 6.0 - 10f64.powf(log))),
        };
        let jacobian = Jacobian::at(&anchors, &p).unwrap();
        let s = jacobian.structure_matrix();
        let (b, all) = (s.force(&t), GeneralStructure::from(&s));
        let close = |found: &[f64], expected: &[f64]| {
            let largest = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
            found.iter().zip(expected).all(|(a, e)| (a - e).abs() <= 1e-9 * largest)
        };
        let found = distribute(&s, &b, [1.0, high], Distribution::LeastNorm).unwrap().tensions_n;
        let expected = general::least_norm(&all, b.as_slice(), [1.0, high]).unwrap();
        prop_assert!(close(&found, &expected), "{found:?} {expected:?}");
        let (free, expected) = (least_norm_unbounded(&s, &b).unwrap(), all.least_norm_unbounded(b.as_slice()).unwrap());
        prop_assert!(close(&free, &expected), "{free:?} {expected:?}");
        let (inverse, expected) = (jacobian.node_jacobian().unwrap(), all.pseudo_inverse().unwrap());
        let rows = inverse.iter().map(|column| <[f64; 3]>::from(-column));
        let inverse: Vec<f64> = rows.flatten().collect();
        let expected: Vec<f64> = expected[..4].iter().flat_map(|row| row[..3].to_vec()).collect();
        prop_assert!(close(&inverse, &expected), "{inverse:?} {expected:?}");
    }

    #[test]
    fn four_cables_agree_with_the_papers_form_and_a_scan(p in pose(), b in wrench()) {
        let s = StructureMatrix::at(&square(), &p).unwrap();
        let paper = paper_form(&s, &b, LIMITS);
        prop_assume!((paper.low - paper.high).abs() > 1e-6);
        let found = distribute(&s, &b, LIMITS, Distribution::LeastNorm);
        prop_assert_eq!(found.is_ok(), paper.low <= paper.high);
        if let Err(error) = found {
            prop_assert_eq!(error.kind(), "infeasible");
            let TensionError::Infeasible(why) = error else { unreachable!() };
            prop_assert!(why.excess_n() > 0.0 && why.cable < 4, "{}", why);
            return Ok(());
        }
        let least = found.unwrap().tensions_n;
        let expected = paper.at(paper.unconstrained().clamp(paper.low, paper.high));
        for (a, e) in least.iter().zip(&expected) {
            prop_assert!((a - e).abs() < 1e-7 * (1.0 + e.abs()), "{least:?} {expected:?}");
        }
        let line = FourCables::new(&s, &b, LIMITS).unwrap();
        let [low, high] = line.interval_of_last_n();
        prop_assert!((low - paper.low).abs() < 1e-6 * (1.0 + low.abs()) && (high - paper.high).abs() < 1e-6 * (1.0 + high.abs()));
        // (37)
        let c = 1.0 - (paper.slope.x + paper.slope.y + paper.slope.z);
        prop_assert!((line.c() - c).abs() < 1e-6 * (1.0 + c.abs()));

        let sum = distribute(&s, &b, LIMITS, Distribution::MinSum).unwrap();
        let safe = distribute(&s, &b, LIMITS, Distribution::Safest).unwrap();
        let total = |t: &[f64]| t.iter().sum::<f64>();
        for i in 0..=2000 {
            let t = paper.at(paper.low + (paper.high - paper.low) * i as f64 / 2000.0);
            prop_assert!(norm2(&least) <= norm2(&t) * (1.0 + 1e-9));
            prop_assert!(total(&sum.tensions_n) <= total(&t) * (1.0 + 1e-9));
            prop_assert!(safe.margin_n >= tension::margin(&t, LIMITS) - 1e-7);
        }
        for t in [&least, &sum.tensions_n, &safe.tensions_n] {
            prop_assert!((s.force(t) - b).norm() < 1e-8 * (1.0 + t.max_abs()));
            prop_assert!(tension::margin(t, LIMITS) > -1e-7);
        }
    }

    #[test]
    fn active_sets_agree_with_the_closed_form(p in pose(), b in wrench(), high in 12.0..60.0f64) {
        let s = StructureMatrix::at(&square(), &p).unwrap();
        let limits = [1.0, high];
        let closed = FourCables::new(&s, &b, limits);
        if let Ok(line) = &closed {
            prop_assume!(line.high_n - line.low_n > 1e-6);
        }
        let found = least_norm(&s, &b, limits);
        match (&closed, &found) {
            (Ok(line), Ok(t)) => {
                for (a, e) in t.iter().zip(line.least_norm().iter()) {
                    prop_assert!((a - e).abs() < 1e-6, "{t:?} {:?}", line.least_norm());
                }
            }
            (Err(a), Err(b)) => prop_assert_eq!(a.kind(), b.kind()),
            _ => {
                // They may differ only for a feasible set thinner than rounding.
                let paper = paper_form(&s, &b, limits);
                prop_assert!((paper.low - paper.high).abs() < 1e-5, "{closed:?} {found:?}");
            }
        }
    }

    #[test]
    fn three_cables_balance_or_name_the_violated_cable(p in pose(), b in wrench()) {
        let all = square();
        let anchors = Anchors::new(&[all[0].into(), all[1].into(), all[2].into()]).unwrap();
        let s = StructureMatrix::at(&anchors, &p).unwrap();
        let t = unique(&s, &b).unwrap();
        prop_assert!((s.force(&t) - b).norm() < 1e-8 * (1.0 + t.max_abs()));
        let inside = t.iter().all(|v| (LIMITS[0]..=LIMITS[1]).contains(v));
        for method in [Distribution::Unique, Distribution::LeastNorm, Distribution::MinSum, Distribution::Safest] {
            match distribute(&s, &b, LIMITS, method) {
                Ok(found) => prop_assert!(inside && found.tensions_n == t),
                Err(TensionError::Infeasible(why)) => {
                    prop_assert!(!inside);
                    prop_assert_eq!(t[why.cable], why.tension_n);
                    let worst = t.iter().map(|v| (LIMITS[0] - v).max(v - LIMITS[1])).fold(0.0, f64::max);
                    prop_assert!((why.excess_n() - worst).abs() < 1e-9);
                }
                Err(other) => prop_assert!(false, "{}", other),
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn many_cables_agree_with_alternating_projections(n in 5usize..=8, p in [2.0..8.0f64, 2.0..8.0f64, 0.5..4.0f64], b in wrench(), high in 8.0..40.0f64) {
        let s = StructureMatrix::at(&ring(n), &Vector3::from(p)).unwrap();
        let Ok(found) = distribute(&s, &b, [1.0, high], Distribution::LeastNorm) else {
            return Ok(());
        };
        let oracle = dykstra(&s, &b, [1.0, high]);
        prop_assume!((s.force(&oracle) - b).norm() < 1e-8);
        for (a, e) in found.tensions_n.iter().zip(&oracle) {
            prop_assert!((a - e).abs() < 1e-5, "{found:?} {oracle:?}");
        }
        let safe = distribute(&s, &b, [1.0, high], Distribution::Safest).unwrap();
        prop_assert!(safe.margin_n >= found.margin_n - 1e-9);
        prop_assert!((s.force(&safe.tensions_n) - b).norm() < 1e-7);
    }

    #[test]
    fn forces_of_tensions_within_limits_are_feasible(n in 4usize..=8, p in pose(), shares in proptest::collection::vec(0.0..1.0f64, 8)) {
        let s = StructureMatrix::at(&ring(n), &p).unwrap();
        let t = CableVec::from_fn(n, |i| 1.0 + 40.0 * shares[i]);
        let found = distribute(&s, &s.force(&t), [1.0, 41.0], Distribution::LeastNorm).unwrap();
        prop_assert!((s.force(&found.tensions_n) - s.force(&t)).norm() < 1e-7);
        prop_assert!(found.tensions_n.norm_squared() <= t.norm_squared() + 1e-6);
    }

    #[test]
    fn forces_beyond_the_support_are_refused(n in 4usize..=8, p in pose(), d in [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64], excess in 1e-4..5.0f64) {
        let d = Vector3::from(d);
        prop_assume!(d.norm() > 0.1);
        let d = d.normalize();
        let s = StructureMatrix::at(&ring(n), &p).unwrap();
        // No tensions within the limits give more force along d than these; the wrench requires more.
        let most = CableVec::from_fn(n, |i| if s[i].dot(&d) > 0.0 { 41.0 } else { 1.0 });
        let wrench = s.force(&most) + d * excess;
        let error = distribute(&s, &wrench, [1.0, 41.0], Distribution::LeastNorm).unwrap_err();
        prop_assert_eq!(error.kind(), "infeasible");
    }

    #[test]
    fn planar_robots_embed(t in proptest::collection::vec(2.0..20.0f64, 4), x in 1.0..9.0f64, z in -4.0..-1.0f64) {
        // Four cables in the x-z plane, the node held by preload alone: no force at rest.
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, -5.0], [0.0, -5.0]];
        let columns: Vec<Vector3<f64>> = corners.iter().map(|c| Vector3::new(c[0] - x, 0.0, c[1] - z).normalize()).collect();
        let s = StructureMatrix::from_columns(&columns);
        let wrench = s.force(&t);
        let found = least_norm(&s, &wrench, [2.0, 20.0]).unwrap();
        prop_assert!((s.force(&found) - wrench).norm() < 1e-8);
        prop_assert!(found.norm_squared() <= norm2(&t) + 1e-9);
        // The optimum cannot improve along the two null directions: T is a clamp of Λᵀy for some y.
        let free: Vec<usize> = (0..4).filter(|i| found[*i] > 2.0 + 1e-9 && found[*i] < 20.0 - 1e-9).collect();
        if free.len() >= 2 {
            let (i, j) = (free[0], free[1]);
            let det = s[i].x * s[j].z - s[i].z * s[j].x;
            let y = Vector3::new(found[i] * s[j].z - found[j] * s[i].z, 0.0, found[j] * s[i].x - found[i] * s[j].x) / det;
            for k in 0..4 {
                prop_assert!((s[k].dot(&y).clamp(2.0, 20.0) - found[k]).abs() < 1e-5 / det.abs());
            }
        }
    }
}

#[test]
fn with_equal_heights_the_least_sum_has_a_tie_in_the_middle() {
    let anchors = Anchors::new(&[[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]]).unwrap();
    let s = StructureMatrix::at(&anchors, &Vector3::new(5.0, 5.0, 3.0)).unwrap();
    let b = Vector3::new(0.0, 0.0, 19.62);
    let least = distribute(&s, &b, LIMITS, Distribution::LeastNorm).unwrap();
    let sum = distribute(&s, &b, LIMITS, Distribution::MinSum).unwrap();
    assert_eq!(least.tensions_n, sum.tensions_n);
    assert!(least.tensions_n.iter().all(|t| (t - least.tensions_n[0]).abs() < 1e-12));
}

#[test]
fn least_norm_is_continuous_where_least_sum_jumps() {
    let anchors = Anchors::new(&[[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]]).unwrap();
    let b = Vector3::new(0.0, 0.0, 2.0 * 9.81);
    let mut before: Option<[CableVec; 2]> = None;
    let (mut least_step, mut sum_step) = (0.0f64, 0.0f64);
    for i in 0..=2001 {
        // An odd number of steps, so that no sample is at the tie in the middle.
        let u = i as f64 / 2001.0;
        // A side of the square at 4 m, sagging with µ = 0.1.
        let x = 5.0 * u;
        let p = Vector3::new(2.5 + x, 2.5, 4.0 + 0.1 * x * x - 0.5 * x);
        let s = StructureMatrix::at(&anchors, &p).unwrap();
        let now =
            [Distribution::LeastNorm, Distribution::MinSum].map(|m| distribute(&s, &b, LIMITS, m).unwrap().tensions_n);
        if let Some(before) = before {
            let step = |k: usize| now[k].zip_map(&before[k], |a, b| a - b).max_abs();
            least_step = least_step.max(step(0));
            sum_step = sum_step.max(step(1));
        }
        before = Some(now);
    }
    assert!(least_step < 0.02, "{least_step}");
    assert!(sum_step > 10.0, "{sum_step}");
}

#[test]
fn methods_and_limits_that_do_not_fit_are_refused() {
    let b = Vector3::new(0.0, 0.0, 20.0);
    let s4 = StructureMatrix::at(&square(), &Vector3::new(4.0, 4.0, 2.0)).unwrap();
    let s5 = StructureMatrix::at(&ring(5), &Vector3::new(4.0, 4.0, 2.0)).unwrap();
    let nan = Vector3::new(0.0, f64::NAN, 0.0);
    for (cables, s) in [(4, &s4), (5, &s5)] {
        let error = distribute(s, &b, LIMITS, Distribution::Unique).unwrap_err();
        assert_eq!(error.kind(), "invalid_argument", "{error}");
        let TensionError::Method { method: Distribution::Unique, cables: n, accepted } = error else {
            panic!("{error}")
        };
        assert!(n == cables && error.to_string().contains(accepted), "{error}");
    }
    let cases = [(b, [2.0, 1.0], 1.0), (b, [-2.0, 1.0], -2.0), (b, [2.0, f64::NAN], f64::NAN), (nan, LIMITS, f64::NAN)];
    for (force, limits, wrong) in cases {
        let error = distribute(&s4, &force, limits, Distribution::LeastNorm).unwrap_err();
        assert_eq!(error.kind(), "invalid_argument", "{error}");
        let TensionError::InvalidArgument { value, accepted, .. } = error else { panic!("{error}") };
        assert_eq!(value.to_string(), wrong.to_string(), "{error}");
        assert!(error.to_string().contains(accepted), "{error}");
    }
    let flat = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [9.0, 8.0, 3.0], [0.0, 8.0, 3.0]]).unwrap();
    let in_plane = StructureMatrix::at(&flat, &Vector3::new(3.0, 3.0, 3.0)).unwrap();
    assert_eq!(distribute(&in_plane, &b, LIMITS, Distribution::LeastNorm).unwrap_err(), TensionError::Singular);
}

#[test]
fn all_methods_accept_an_infinite_upper_limit() {
    let b = Vector3::new(0.0, 0.0, 20.0);
    let s = StructureMatrix::at(&square(), &Vector3::new(4.0, 4.0, 2.0)).unwrap();
    for method in [Distribution::LeastNorm, Distribution::MinSum, Distribution::Safest] {
        let found = distribute(&s, &b, [1.0, f64::INFINITY], method).unwrap();
        assert!((s.force(&found.tensions_n) - b).norm() < 1e-9 && found.margin_n > -1e-9, "{method:?} {found:?}");
    }
}

#[test]
fn a_refusal_names_cable_tension_and_limit() {
    let s = StructureMatrix::at(&square(), &Vector3::new(4.0, 4.0, 5.9)).unwrap();
    let error = distribute(&s, &Vector3::new(0.0, 0.0, 20.0), [1.0, 60.0], Distribution::LeastNorm).unwrap_err();
    let TensionError::Infeasible(violation) = error else { panic!("{error}") };
    assert!(violation.limit_n == 60.0 && violation.tension_n > 60.0 && violation.cable < 4, "{violation:?}");
    let sentence = error.to_string();
    let numbers =
        [format!("{:.2} N", violation.tension_n), format!("{:.2} N", violation.excess_n()), "60.00 N".to_owned()];
    assert!(numbers.iter().all(|number| sentence.contains(number)), "{sentence}");
    assert!(sentence.contains(&format!(" {} ", violation.cable + 1)), "cables are counted from 1: {sentence}");
}

#[test]
fn distributions_parse_as_they_are_displayed() {
    for method in [Distribution::Unique, Distribution::LeastNorm, Distribution::MinSum, Distribution::Safest] {
        assert_eq!(method.to_string().parse::<Distribution>().unwrap(), method);
    }
    assert_eq!("least_norm".parse::<Distribution>().unwrap(), Distribution::LeastNorm);
    let error = "lowest".parse::<Distribution>().unwrap_err();
    assert_eq!(error.given, "lowest");
    let words = ["lowest", "unique", "least-norm", "min-sum", "safest"];
    assert!(words.iter().all(|word| error.to_string().contains(word)), "{error}");
}
