//! Properties of a map: planes are exact, edges are preserved, standard deviations match errors, unsampled
//! cells are unknown.

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use survey::SurveyError;
use survey::grid::{Added, GridMap, GridOptions, GridSample, GridSpec};

/// Uniform and normal random numbers from a seed.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

fn spec(cell_m: f64) -> GridSpec {
    GridSpec::covering([0.0, 0.0], [3.0, 3.0], cell_m).unwrap()
}

/// Waves in the left half; in the right half a block 0.5 high with steep walls.
fn ground(x: f64, y: f64) -> f64 {
    let block = (1.8..2.6).contains(&x) && (0.9..2.1).contains(&y);
    0.1 * (2.0 * x).sin() * (1.5 * y).cos() + if block { 0.5 } else { 0.0 }
}

fn edge_distance_m(x: f64, y: f64) -> f64 {
    let (dx, dy) = ((x - 2.2).abs() - 0.4, (y - 1.5).abs() - 0.6);
    if dx < 0.0 && dy < 0.0 { -dx.max(dy) } else { (dx.max(0.0).powi(2) + dy.max(0.0).powi(2)).sqrt() }
}

/// Samples back and forth along x, on lines with a distance of `apart_m`, one every centimetre.
fn scan(apart_m: f64, noise: f64, seed: u64) -> Vec<GridSample> {
    let mut random = Random(seed);
    let lines = (3.0 / apart_m) as usize;
    let mut samples = Vec::new();
    for line in 0..lines {
        let y = (line as f64 + 0.5) * apart_m;
        for i in 0..300 {
            let x = (f64::from(i) + 0.5) * 0.01;
            samples.push(GridSample::at([x, y], ground(x, y) + noise * random.normal()));
        }
    }
    samples
}

fn options(cell_m: f64, reach_m: f64) -> GridOptions {
    GridOptions { reach_m, ..GridOptions::for_cell(cell_m) }
}

/// Errors divided by their standard deviation, of cells that are `from_m..to_m` from an edge; and the root
/// mean square error.
fn errors(map: &GridMap, from_m: f64, to_m: f64) -> (Vec<f64>, f64) {
    let (mut ratios, mut squares) = (Vec::new(), 0.0);
    for row in 0..map.spec().rows {
        for column in 0..map.spec().columns {
            let [x, y] = map.spec().centre(column, row);
            let Some(cell) = map.cell(column, row) else { continue };
            if (from_m..to_m).contains(&edge_distance_m(x, y)) {
                let error = cell.value - ground(x, y);
                ratios.push(error / cell.sigma);
                squares += error * error;
            }
        }
    }
    let rms = (squares / ratios.len() as f64).sqrt();
    (ratios, rms)
}

fn within(ratios: &[f64], sigmas: f64) -> f64 {
    ratios.iter().filter(|ratio| ratio.abs() <= sigmas).count() as f64 / ratios.len() as f64
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_plane_is_reproduced_exactly(a in -1e3..1e3_f64, b in -10.0..10.0_f64, c in -10.0..10.0_f64, seed in 1_u64..1_000_000) {
        let mut random = Random(seed);
        let samples: Vec<GridSample> = (0..2500)
            .map(|_| [3.0 * random.uniform(), 3.0 * random.uniform()])
            .map(|[x, y]| GridSample::at([x, y], a + b * x + c * y))
            .collect();
        let map = GridMap::from_samples(spec(0.15), options(0.15, 0.5), &samples).unwrap();
        let size = 1.0 + b.abs() + c.abs();
        for row in 0..20 {
            for column in 0..20 {
                let [x, y] = map.spec().centre(column, row);
                let cell = map.cell(column, row).unwrap();
                if cell.samples == 0 {
                    // never beyond its neighbours, so not exact beside the border
                    continue;
                }
                prop_assert!((cell.value - (a + b * x + c * y)).abs() < 1e-5 * size, "{cell:?}");
                prop_assert!((cell.gradient_per_m[0] - b).abs() < 1e-3 * size);
                prop_assert!((cell.gradient_per_m[1] - c).abs() < 1e-3 * size);
                prop_assert!(cell.sigma < 1e-3 * size);
            }
        }
    }

    #[test]
    fn another_unit_and_another_zero_give_the_same_map(by in 0.01..100.0_f64, plus in -1e4..1e4_f64, seed in 1_u64..1_000_000) {
        let samples = scan(0.2, 0.02, seed);
        let map = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &samples).unwrap();
        let other: Vec<GridSample> = samples.iter().map(|s| GridSample { value: by * s.value + plus, ..*s }).collect();
        let other = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &other).unwrap();
        for (a, b) in map.cells().iter().zip(other.cells()) {
            prop_assert_eq!(a.is_some(), b.is_some());
            // rounding may decide whether two intervals that just touch overlap
            if let (Some(a), Some(b)) = (a, b) && a.radius_m == b.radius_m {
                prop_assert!((by * a.value + plus - b.value).abs() < 1e-5 * by + 1e-9);
                prop_assert!((by * a.sigma - b.sigma).abs() < 1e-4 * by);
            }
        }
    }

    #[test]
    fn a_cell_without_samples_is_within_the_samples_around_it(seed in 1_u64..1_000_000) {
        let (_, samples) = crate::fields::survey(seed);
        let (cell_m, reach_m) = (0.1, 0.4);
        let map = GridMap::from_samples(spec(cell_m), options(cell_m, reach_m), &samples).unwrap();
        for row in 0..30 {
            for column in 0..30 {
                let Some(cell) = map.cell(column, row) else { continue };
                prop_assert!(cell.sigma > 0.0, "{cell:?}");
                if cell.samples == 0 {
                    let [x, y] = map.spec().centre(column, row);
                    // the samples of a cell count at their mean position
                    let near = |s: &&GridSample| (s.position_m[0] - x).hypot(s.position_m[1] - y) < 1.5 * reach_m + 2.0 * cell_m;
                    let range = samples.iter().filter(near).map(|s| s.value);
                    let [low, high] = range.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
                    prop_assert!((low - 1e-9..=high + 1e-9).contains(&cell.value), "{cell:?} {low} {high}");
                }
            }
        }
    }

    #[test]
    fn invalid_samples_are_rejected_and_change_nothing(which in 0..6_usize, bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)]) {
        let mut map = GridMap::new(spec(0.3), options(0.3, 0.5)).unwrap();
        let mut sample = GridSample { value_sigma: Some(0.1), ..GridSample::at([1.0, 1.0], 2.0) };
        match which {
            0 => sample.position_m[0] = bad,
            1 => sample.position_m[1] = bad,
            2 => sample.value = bad,
            3 => sample.value_sigma = Some(bad),
            4 => sample.position_covariance_m2[0] = bad,
            _ => sample.position_covariance_m2[2] = bad,
        }
        prop_assert_eq!(map.add(&sample), Added::Unusable);
        map.refresh_all();
        prop_assert!(map.cells().iter().all(Option::is_none));
        prop_assert_eq!(map.counts().unusable, 1);
    }
}

/// The same fit, computed from the samples by another solver.
#[test]
fn a_cell_is_the_weighted_least_squares_plane_of_its_samples() {
    let mut random = Random(7);
    // only one circle, and cells with one sample each except the tested one
    let spec = GridSpec::covering([0.0, 0.0], [0.5, 0.5], 0.1).unwrap();
    let options = GridOptions { footprint_m: 0.5, reach_m: 0.25, least_sigma: 0.0 };
    let samples: Vec<GridSample> = (0..25)
        .map(|i| {
            let place =
                [0.1 * f64::from(i % 5) + 0.1 * random.uniform(), 0.1 * f64::from(i / 5) + 0.1 * random.uniform()];
            GridSample { value_sigma: Some(0.5 + random.uniform()), ..GridSample::at(place, 100.0 + random.normal()) }
        })
        .collect();
    let map = GridMap::from_samples(spec, options, &samples).unwrap();
    let centre = [0.25, 0.25];
    let (mut rows, mut values, mut count) = (Vec::new(), Vec::new(), 0);
    for sample in &samples {
        let d: [f64; 2] = std::array::from_fn(|k| sample.position_m[k] - centre[k]);
        let inside = 1.0 - (d[0] * d[0] + d[1] * d[1]) / (0.25 * 0.25);
        if inside > 0.0 {
            // square root of the weight
            let root = inside / sample.value_sigma.unwrap();
            rows.extend([root, root * d[0], root * d[1]]);
            values.push(root * sample.value);
            count += 1;
        }
    }
    let plane =
        DMatrix::from_row_slice(count, 3, &rows).svd(true, true).solve(&DVector::from_vec(values), 1e-12).unwrap();
    let cell = map.at(centre).unwrap();
    // the slope's prior has a small effect: the values scatter by 1 without any slope
    assert!((cell.value - plane[0]).abs() < 0.03, "{cell:?} {plane}");
    assert!(
        (cell.gradient_per_m[0] - plane[1]).abs() < 1.5 && (cell.gradient_per_m[1] - plane[2]).abs() < 1.5,
        "{cell:?} {plane}"
    );
}

#[test]
fn standard_deviations_match_errors_on_smooth_ground_and_beside_edges() {
    for (noise, cell_m, apart_m) in [(0.005, 0.05, 0.05), (0.02, 0.05, 0.1), (0.05, 0.1, 0.1), (0.02, 0.1, 0.2)] {
        let map = GridMap::from_samples(spec(cell_m), options(cell_m, 4.0 * cell_m), &scan(apart_m, noise, 3)).unwrap();
        let (smooth, rms) = errors(&map, 0.3, 9.0);
        let (edges, edge_rms) = errors(&map, 0.0, 2.0 * cell_m);
        let spread = (smooth.iter().map(|ratio| ratio * ratio).sum::<f64>() / smooth.len() as f64).sqrt();
        println!(
            "noise {noise} cell {cell_m} apart {apart_m}: smooth rms {rms:.4}, {spread:.2} sigma, within 2: {:.3}; edges rms {edge_rms:.3}, within 2: {:.3}; noise found {:.4}",
            within(&smooth, 2.0),
            within(&edges, 2.0),
            map.noise()
        );
        assert!(within(&smooth, 2.0) > 0.82, "smooth ground, noise {noise}");
        assert!((0.4..1.5).contains(&spread), "smooth ground, noise {noise}: {spread}");
        assert!(within(&edges, 2.0) > 0.8, "edges, noise {noise}");
        assert!(rms < 0.7 * noise, "noise {noise} is averaged: {rms}");
        assert!((map.noise() / noise - 1.0).abs() < 0.25, "noise {noise} is found: {}", map.noise());
    }
}

/// Mean with the same kernel and one radius for all cells.
fn fixed_kernel(samples: &[GridSample], at: [f64; 2], radius_m: f64) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for sample in samples {
        let d2: f64 = (0..2).map(|k| (sample.position_m[k] - at[k]).powi(2)).sum();
        let inside = (1.0 - d2 / (radius_m * radius_m)).max(0.0);
        sum += inside * inside * sample.value;
        weights += inside * inside;
    }
    sum / weights
}

#[test]
fn edges_and_noise_have_smaller_errors_than_with_one_radius() {
    let (cell_m, noise) = (0.05, 0.03);
    let samples = scan(0.05, noise, 5);
    let map = GridMap::from_samples(spec(cell_m), options(cell_m, 0.25), &samples).unwrap();
    let fixed = |radius_m: f64, from_m: f64, to_m: f64| {
        let (mut squares, mut count) = (0.0, 0.0);
        for row in 0..map.spec().rows {
            for column in 0..map.spec().columns {
                let at = map.spec().centre(column, row);
                if (from_m..to_m).contains(&edge_distance_m(at[0], at[1])) {
                    squares += (fixed_kernel(&samples, at, radius_m) - ground(at[0], at[1])).powi(2);
                    count += 1.0;
                }
            }
        }
        f64::sqrt(squares / count)
    };
    let (edge, smooth) = (errors(&map, 0.0, 0.2).1, errors(&map, 0.3, 9.0).1);
    println!("edge {edge:.4} smooth {smooth:.4}");
    for radius_m in [0.05, 0.25] {
        println!("fixed {radius_m}: edge {:.4} smooth {:.4}", fixed(radius_m, 0.0, 0.2), fixed(radius_m, 0.3, 9.0));
    }
    assert!(edge < 0.6 * fixed(0.25, 0.0, 0.2), "the wide one blurs");
    assert!(smooth < 0.75 * fixed(0.05, 0.3, 9.0), "the narrow one keeps the noise");
}

#[test]
fn uncertain_positions_matter_on_steep_ground() {
    let place_m = 0.02;
    let mut random = Random(11);
    let samples: Vec<GridSample> = (0..4000)
        .map(|_| [3.0 * random.uniform(), 3.0 * random.uniform()])
        .map(|[x, y]| GridSample {
            position_covariance_m2: [place_m * place_m, 0.0, 4.0 * place_m * place_m],
            value_sigma: Some(1e-4),
            ..GridSample::at([x, y], 2.0 * x)
        })
        .collect();
    let map = GridMap::from_samples(spec(0.1), options(0.1, 0.3), &samples).unwrap();
    let cell = map.at([1.55, 1.55]).unwrap();
    assert!((cell.sigma / (2.0 * place_m) - 1.0).abs() < 0.05, "{cell:?}");
}

#[test]
fn unsampled_cells_are_unknown_and_cells_between_tracks_less_certain() {
    let mut map = GridMap::new(spec(0.1), options(0.1, 0.3)).unwrap();
    for i in 0..300 {
        let x = 0.01 * f64::from(i);
        assert_eq!(map.add(&GridSample::at([x, 1.05], 5.0 + 0.5 * x + 0.01 * f64::from(i % 3))), Added::Inside);
    }
    assert_eq!(map.add(&GridSample::at([3.5, 1.0], 5.0)), Added::Outside);
    assert!(map.at([1.0, 1.05]).is_none(), "samples are visible only after a refresh");
    assert!(map.refresh() && !map.refresh());
    let sigma = |y: f64| map.at([1.55, y]).map(|cell| cell.sigma);
    assert!(
        sigma(1.05) < sigma(1.15) && sigma(1.15) < sigma(1.25),
        "{:?} {:?} {:?}",
        sigma(1.05),
        sigma(1.15),
        sigma(1.25)
    );
    assert_eq!((sigma(1.45), sigma(0.05), map.at([9.0, 1.0])), (None, None, None));
    assert_eq!((map.counts().inside, map.counts().outside), (300, 1));
}

/// One track on which the field rises faster and faster; the plane through its end leads far beyond.
#[test]
fn a_map_does_not_continue_a_slope_beyond_its_samples() {
    let samples: Vec<GridSample> = (0..100)
        .map(|i| 0.02 * f64::from(i))
        .map(|t| GridSample::at([0.5 + t, 0.5 + 0.2 * t], 2.57 + 1.38 * (t / 1.98).powi(2)))
        .collect();
    let map = GridMap::from_samples(spec(0.05), options(0.05, 0.4), &samples).unwrap();
    for cell in map.cells().iter().flatten().filter(|cell| cell.samples == 0) {
        assert!((2.57 - 1e-9..=3.95 + 1e-9).contains(&cell.value) && cell.sigma > 0.0, "{cell:?}");
    }
}

#[test]
fn without_differences_only_a_stated_deviation_gives_a_map() {
    for count in [1, 40] {
        let readings = |value_sigma| {
            let places = (0..count).map(|i| [0.5 + 0.02 * f64::from(i), 1.0]);
            places.map(move |at| GridSample { value_sigma, ..GridSample::at(at, 21.5) }).collect::<Vec<_>>()
        };
        let map = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &readings(None)).unwrap();
        assert!(map.cells().iter().all(Option::is_none) && !map.has_scale(), "{count} readings");
        let map = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &readings(Some(0.2))).unwrap();
        let own = map.at([0.55, 1.05]).unwrap();
        let beside = map.at([0.55, 1.35]).unwrap();
        assert!((own.value - 21.5).abs() < 1e-9 && own.sigma > 0.0 && beside.sigma > 0.0, "{own:?} {beside:?}");
    }
}

#[test]
fn a_resolution_does_not_average_out() {
    let samples: Vec<GridSample> = (0..4000)
        .map(|i| [f64::from(i % 63) / 21.0, f64::from(i / 63) / 21.2])
        .map(|at| GridSample::at(at, (21.0 + 0.3 * at[0]).round()))
        .collect();
    let map = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &samples).unwrap();
    assert!(map.cells().iter().flatten().all(|cell| cell.sigma >= 0.99 / 12.0_f64.sqrt()));
}

#[test]
fn a_growing_map_ends_as_the_map_of_all_its_samples() {
    let samples = scan(0.2, 0.02, 9);
    let whole = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &samples).unwrap();
    let mut growing = GridMap::new(spec(0.1), options(0.1, 0.4)).unwrap();
    for (i, sample) in samples.iter().enumerate() {
        growing.add(sample);
        if i % 100 == 0 {
            growing.refresh();
        }
    }
    growing.refresh();
    for (a, b) in whole.cells().iter().zip(growing.cells()) {
        assert_eq!(a.is_some(), b.is_some());
        if let (Some(a), Some(b)) = (a, b) {
            assert!((a.value - b.value).abs() < 3.0 * a.sigma, "{a:?} {b:?}");
        }
    }
    growing.refresh_all();
    assert_eq!(whole.cells(), growing.cells());
}

#[test]
fn a_hovering_node_does_not_dominate_the_neighbours() {
    let mut samples = scan(0.1, 0.01, 13);
    let truth = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &samples).unwrap();
    samples.extend((0..20_000).map(|i| GridSample::at([0.55 + 1e-6 * f64::from(i % 7), 0.55], ground(0.55, 0.55))));
    let hovered = GridMap::from_samples(spec(0.1), options(0.1, 0.4), &samples).unwrap();
    for (a, b) in truth.cells().iter().zip(hovered.cells()) {
        let (a, b) = (a.unwrap(), b.unwrap());
        assert!((a.value - b.value).abs() < 5.0 * a.sigma.max(0.01), "{a:?} {b:?}");
    }
}

#[test]
fn an_invalid_grid_is_refused() {
    let refused = |side_m, cell_m| GridSpec::covering([0.0, 0.0], side_m, cell_m).unwrap_err();
    let wrong = |error: &SurveyError| match *error {
        SurveyError::Value { key, value, .. } => (key, value),
        SurveyError::Cells { .. } => panic!("{error}"),
    };
    assert_eq!(wrong(&refused([1.0, 1.0], 0.0)), ("cell_m", 0.0));
    assert_eq!(wrong(&refused([1.0, -1.0], 0.1)), ("side_m", -1.0));
    assert!(
        matches!(refused([1e9, 1e9], 0.1), SurveyError::Cells { columns, rows, most } if columns.saturating_mul(rows) > most)
    );
    assert!(GridSpec::covering([0.0, f64::NAN], [1.0, 1.0], 0.1).is_err());
    let bad = GridOptions { reach_m: -1.0, ..GridOptions::default() };
    assert_eq!(wrong(&GridMap::new(spec(0.1), bad).unwrap_err()), ("reach_m", -1.0));
    assert_eq!(GridSpec::covering([0.0, 0.0], [0.3, 0.7], 0.1).map(|s| (s.columns, s.rows)), Ok((3, 7)));
}
