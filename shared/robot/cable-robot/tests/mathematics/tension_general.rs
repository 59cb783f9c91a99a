//! Any number of directions and cables compared with an exhaustive oracle: each cable at its lower limit, at its
//! upper limit or free, the free ones by a pseudo-inverse from a singular value decomposition. The optimum of norm or
//! sum is among these.

use cable_robot::tension::general::{self, GeneralStructure};
use cable_robot::tension::{self, TensionError, margin};
use cable_robot::{Anchors, CableVec, Distribution, Vector3};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

/// All candidates within the limits, widened by `slack`.
fn candidates(a: &DMatrix<f64>, b: &DVector<f64>, [low, high]: [f64; 2], slack: f64) -> Vec<DVector<f64>> {
    let m = a.ncols();
    let mut found = Vec::new();
    for code in 0..3usize.pow(m as u32) {
        let place = |i: usize| code / 3usize.pow(i as u32) % 3;
        if (0..m).any(|i| place(i) == 1 && high.is_infinite()) {
            continue;
        }
        let free: Vec<usize> = (0..m).filter(|i| place(*i) == 2).collect();
        let mut t = DVector::from_fn(m, |i, _| [low, high, 0.0][place(i)]);
        if !free.is_empty() {
            let part = DMatrix::from_fn(a.nrows(), free.len(), |r, c| a[(r, free[c])]);
            let rest = b - a * &t;
            let inner = part.pseudo_inverse(1e-9).unwrap() * rest;
            for (k, i) in free.iter().enumerate() {
                t[*i] = inner[k];
            }
        }
        let scale = 1.0 + t.amax();
        if (a * &t - b).amax() < 1e-9 * scale && t.iter().all(|v| *v >= low - slack && *v <= high + slack) {
            found.push(t);
        }
    }
    found
}

/// A structure matrix, a force and limits; on a coarse lattice for ties, zeros and parallel cables, or generic.
fn problem() -> impl Strategy<Value = (Vec<Vec<f64>>, Vec<f64>, [f64; 2])> {
    let entry = |lattice: bool| if lattice { (-2i32..=2).prop_map(f64::from).boxed() } else { (-1.0..1.0f64).boxed() };
    (1usize..=4, 0usize..=3, any::<bool>(), any::<bool>()).prop_flat_map(move |(n, more, lattice, rest)| {
        let m = (n + more).min(6);
        (
            proptest::collection::vec(proptest::collection::vec(entry(lattice), m), n),
            proptest::collection::vec(
                if lattice { (-4i32..=4).prop_map(f64::from).boxed() } else { (-9.0..9.0f64).boxed() },
                n,
            ),
            prop_oneof![Just(0.0), Just(1.0), 0.0..2.0f64],
            prop_oneof![Just(f64::INFINITY), Just(4.0), 3.0..9.0f64, Just(0.0)],
        )
            .prop_map(move |(a, b, low, more)| {
                let b = if rest { vec![0.0; b.len()] } else { b };
                (a, b, [low, low + more])
            })
    })
}

/// `NIMS_TENSIONS` sets how many problems are drawn.
fn cases() -> ProptestConfig {
    let cases = std::env::var("NIMS_TENSIONS").ok().and_then(|n| n.parse().ok());
    ProptestConfig::with_cases(cases.unwrap_or(1500))
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn agrees_with_exhaustive_search((rows, b, limits) in problem()) {
        agrees(&rows, &b, limits)?;
    }
}

/// Compares all three distributions of a problem with the candidates.
fn agrees(rows: &[Vec<f64>], b: &[f64], limits: [f64; 2]) -> Result<(), TestCaseError> {
    let (n, m) = (rows.len(), rows[0].len());
    let a = DMatrix::from_fn(n, m, |r, c| rows[r][c]);
    let structure = GeneralStructure::new(rows).unwrap();
    let solve = |method| general::distribute(&structure, b, limits, method);
    let smallest = a.singular_values().min();
    if smallest < 1e-9 {
        prop_assert_eq!(solve(Distribution::LeastNorm), Err(TensionError::Singular));
        return Ok(());
    }
    prop_assume!(smallest > 1e-3);
    let force = DVector::from_column_slice(b);
    let all = candidates(&a, &force, limits, 1e-11);
    let loose = !candidates(&a, &force, limits, 1e-7).is_empty();
    if all.is_empty() {
        // Only the edge of the feasible set is undecided.
        if !loose {
            for method in [Distribution::LeastNorm, Distribution::MinSum, Distribution::Safest] {
                prop_assert_eq!(solve(method).unwrap_err().kind(), "infeasible");
            }
        }
        return Ok(());
    }
    let least = all.iter().min_by(|x, y| x.norm().total_cmp(&y.norm())).unwrap();
    let sum = all.iter().map(|t| t.sum()).fold(f64::INFINITY, f64::min);
    let scale = 1.0 + least.amax();
    let check = |t: &CableVec| {
        (&a * DVector::from_column_slice(t) - &force).amax() < 1e-9 * scale && margin(t, limits) > -1e-9 * scale
    };

    let found = solve(Distribution::LeastNorm).unwrap().tensions_n;
    prop_assert!(check(&found), "{found:?}");
    for (x, y) in found.iter().zip(least.iter()) {
        prop_assert!((x - y).abs() < 1e-8 * scale, "{found:?} {least:?}");
    }
    let found = solve(Distribution::MinSum).unwrap().tensions_n;
    prop_assert!(check(&found), "{found:?}");
    prop_assert!((found.sum() - sum).abs() < 1e-8 * scale, "{found:?} {sum}");

    let safe = solve(Distribution::Safest).unwrap();
    prop_assert!(check(&safe.tensions_n), "{safe:?}");
    let [low, high] = limits;
    let safer = [low + safe.margin_n + 1e-6 * scale, high - safe.margin_n - 1e-6 * scale];
    // Without an upper limit the margin may be unbounded; then the result is the least norm.
    let unbounded = high.is_infinite() && safe.tensions_n == solve(Distribution::LeastNorm).unwrap().tensions_n;
    if !unbounded && safer[1] >= safer[0] {
        prop_assert!(candidates(&a, &force, safer, 0.0).is_empty(), "{safe:?}");
    }
    Ok(())
}

#[test]
fn a_tie_of_sums_gives_the_least_norm() {
    // Two cables up, two cables down, twice: any share has the same sum.
    let structure = GeneralStructure::new(&[vec![1.0, 1.0, -1.0, -1.0]]).unwrap();
    let found = general::distribute(&structure, &[4.0], [1.0, 9.0], Distribution::MinSum).unwrap().tensions_n;
    for (t, expected) in found.iter().zip([3.0, 3.0, 1.0, 1.0]) {
        assert!((t - expected).abs() < 1e-9, "{found:?}");
    }
}

#[test]
fn nims_aq_needs_only_preload_at_rest() {
    let anchors = Anchors::planar(&[[0.0, 0.0], [12.0, 0.0], [12.0, 5.0], [0.0, 5.0]]).unwrap();
    let at = Vector3::new(4.0, 0.0, 1.5);
    let rest = tension::hold(&anchors, &at, &Vector3::zeros(), [5.0, 80.0], Distribution::LeastNorm).unwrap();
    assert!((rest.margin_n).abs() < 1e-9 && rest.tensions_n.max_abs() < 12.0, "{rest:?}");
    // Drag of 20 N against the motion to the right: the right cables carry it.
    let drag = Vector3::new(20.0, 0.0, 0.0);
    let moving = tension::hold(&anchors, &at, &drag, [5.0, 80.0], Distribution::LeastNorm).unwrap().tensions_n;
    assert!(moving[1] + moving[2] > moving[0] + moving[3] + 15.0, "{moving:?}");
    let safe = tension::hold(&anchors, &at, &Vector3::zeros(), [5.0, 80.0], Distribution::Safest).unwrap();
    assert!(safe.margin_n > 15.0, "{safe:?}");
    assert_eq!(
        tension::hold(&anchors, &anchors[1], &drag, [5.0, 80.0], Distribution::LeastNorm).unwrap_err(),
        TensionError::Singular
    );
}

#[test]
fn shapes_that_do_not_fit_are_refused() {
    for rows in
        [vec![], vec![vec![1.0, 2.0], vec![1.0]], vec![vec![1.0], vec![2.0]], vec![vec![1.0; 9]], vec![vec![f64::NAN]]]
    {
        assert_eq!(GeneralStructure::new(&rows).unwrap_err().kind(), "invalid_argument");
    }
    let structure = GeneralStructure::new(&[vec![1.0, 1.0]]).unwrap();
    for (wrench, limits, method) in [
        (vec![1.0, 2.0], [0.0, 1.0], Distribution::LeastNorm),
        (vec![f64::NAN], [0.0, 1.0], Distribution::LeastNorm),
        (vec![1.0], [1.0, 0.0], Distribution::LeastNorm),
        (vec![1.0], [0.0, 1.0], Distribution::Unique),
    ] {
        assert_eq!(general::distribute(&structure, &wrench, limits, method).unwrap_err().kind(), "invalid_argument");
    }
}

#[test]
fn nearly_parallel_cables_hold_a_force_with_large_tensions() {
    // Found by the search above: the only tensions are a thousand times the force.
    let rows = [
        vec![
            -0.3206272210633288,
            0.0,
            0.35817711026309024,
            0.9151775392213805,
            -0.8991640629815376,
            0.23997417558184045,
        ],
        vec![0.7119023391349812, 0.0, -0.1669537065510794, 0.0, -0.5211602256283485, 0.0035310880060272568],
        vec![
            -0.4652647617513043,
            -0.8951506438053969,
            0.5647637396876093,
            0.0,
            -0.7863330692662601,
            0.12624543327280152,
        ],
        vec![-0.917710473397273, 0.0, 0.009694327833678964, 0.8460442054904236, -0.8590818973104074, 0.698466692810645],
    ];
    let force = [-1.6625855380169734, 0.0, 0.0, 0.0];
    agrees(&rows, &force, [0.0, f64::INFINITY]).unwrap();
    let structure = GeneralStructure::new(&rows).unwrap();
    let held = general::distribute(&structure, &force, [0.0, f64::INFINITY], Distribution::LeastNorm).unwrap();
    for (t, expected) in
        held.tensions_n.iter().zip([2981.21690859, 0.0, 4564.83676621, 0.0, 2658.24465023, 7123.16115459])
    {
        assert!((t - expected).abs() < 1e-6, "{held:?}");
    }
}
