//! Patches for a finer scan: they cover every edge that a coarse scan may have seen, and nothing else.

use proptest::prelude::*;
use survey::adaptive::{KnownField, Merit, Patch, PatchOptions, patches};
use survey::grid::{GridMap, GridOptions, GridSample, GridSpec};

const LOW_M: [f64; 2] = [0.0, 0.0];
const HIGH_M: [f64; 2] = [3.0, 2.4];
const PITCH_M: f64 = 0.3;

/// A field sampled on lines along x with a pitch of 0.3 m.
fn seen(field: impl Fn([f64; 2]) -> f64) -> KnownField {
    let spec = GridSpec::covering(LOW_M, HIGH_M, 0.05).unwrap();
    let mut map = GridMap::new(spec, GridOptions { reach_m: PITCH_M, ..GridOptions::for_cell(0.05) }).unwrap();
    for line in 0..8 {
        for step in 0..300 {
            let place = [0.005 + 0.01 * f64::from(step), PITCH_M * (f64::from(line) + 0.5)];
            map.add(&GridSample { value_sigma: Some(0.001), ..GridSample::at(place, field(place)) });
        }
    }
    map.refresh_all();
    KnownField::from(&map)
}

fn options(share: f64) -> PatchOptions {
    PatchOptions { merit: Merit::Gradient, tile_m: 0.5 * PITCH_M, share, least: 0.2 }
}

fn covered(found: &[Patch], place: [f64; 2]) -> bool {
    found.iter().any(|patch| (0..2).all(|k| (patch.low_m[k]..=patch.high_m[k]).contains(&place[k])))
}

fn area_m2(found: &[Patch]) -> f64 {
    found.iter().map(|patch| (patch.high_m[0] - patch.low_m[0]) * (patch.high_m[1] - patch.low_m[1])).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// A block that at least one line crosses: a patch covers its edges at any position between the lines,
    /// and none is far away.
    #[test]
    fn every_edge_of_a_block_is_in_a_patch(
        x in 0.5..1.5f64, y in 0.5..1.2f64, width in 0.4..1.0f64, depth in 0.35..0.8f64, height in 0.1..0.5f64,
    ) {
        let inside = |[px, py]: [f64; 2]| (x..x + width).contains(&px) && (y..y + depth).contains(&py);
        let known = seen(|place| if inside(place) { height } else { 0.0 });
        let found = patches(&known, LOW_M, HIGH_M, LOW_M, &options(1.0));
        for share in 0..=20 {
            let s = f64::from(share) / 20.0;
            for edge in [[x + s * width, y], [x + s * width, y + depth], [x, y + s * depth], [x + width, y + s * depth]] {
                prop_assert!(covered(&found, edge), "{edge:?} in none of {found:?}");
            }
        }
        for far in [[x - 0.4, y], [x + width + 0.4, y], [x, y - 0.5], [x, y + depth + 0.5]] {
            prop_assert!(!covered(&found, far), "{far:?}");
        }
        // the lines of the patch cross edges that are parallel to the coarse lines
        let middle = [x + 0.5 * width, y];
        let over = found.iter().find(|patch| covered(&[**patch], middle)).unwrap();
        prop_assert!(over.along == 1);
        // patches do not overlap: the sum of their areas is the covered area
        let probes = (0..60).flat_map(|i| (0..48).map(move |k| [0.025 + 0.05 * f64::from(i), 0.025 + 0.05 * f64::from(k)]));
        let inside = probes.filter(|probe| covered(&found, *probe)).count() as f64 * 0.0025;
        prop_assert!((inside - area_m2(&found)).abs() < 1e-6);
    }

    #[test]
    fn the_share_is_kept_and_the_largest_change_comes_first(share in 0.02..1.0f64) {
        // two steps, one a tenth of the other
        let known = seen(|[x, _]| if x > 2.0 { 1.1 } else if x > 1.0 { 0.1 } else { 0.0 });
        let found = patches(&known, LOW_M, HIGH_M, LOW_M, &PatchOptions { least: 0.05, ..options(share) });
        prop_assert!(area_m2(&found) <= share * 7.2 + 1e-9);
        prop_assert!(found.iter().all(|patch| patch.along == 0));
        let (small, large) = (covered(&found, [1.0, 1.0]), covered(&found, [2.0, 1.0]));
        prop_assert!(large || share < 0.2);
        prop_assert!(!small || large);
    }
}

#[test]
fn a_level_field_has_no_patches_and_an_uncertain_one_in_its_gaps() {
    let known = seen(|_| 2.0);
    assert_eq!(patches(&known, LOW_M, HIGH_M, LOW_M, &options(1.0)), []);
    let mut unsure = known;
    for (at, cell) in unsure.cells.iter_mut().enumerate() {
        let place = unsure.spec.centre(at % unsure.spec.columns, at / unsure.spec.columns);
        if let Some(cell) = cell {
            cell.sigma = if place[0] < 0.3 { 1.0 } else { 0.01 };
        }
    }
    let by_sigma = PatchOptions { merit: Merit::Variance, ..options(1.0) };
    let found = patches(&unsure, LOW_M, HIGH_M, LOW_M, &by_sigma);
    assert!(covered(&found, [0.15, 1.0]) && !covered(&found, [0.5, 1.0]), "{found:?}");
}
