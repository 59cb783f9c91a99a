//! Selection of the parts of a coarsely scanned map that deserve a second, finer scan: those that vary most.
//!
//! # Method
//! Between two neighbouring sampled cells with different values there is an edge at an unknown position. So every
//! cell between two tracks has the merit of the change from one to the other, and a change along a track is assumed
//! to continue to the next track. The slope of a fitted map is not suitable, because the fit keeps edges by not
//! averaging across them.
//!
//! The area is divided into square tiles; the merit of a tile is the largest merit of its cells. Tiles are selected in
//! the order of their merit until their share of the area is used up or the remaining merit is too small, and
//! neighbouring ones are joined to rectangles. The scan lines of a rectangle run along the axis with the largest
//! change: lines that cross an edge locate it well, lines parallel to it only to half a pitch.

use crate::grid::{GridMap, GridSpec};

/// Merit of a part of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Merit {
    /// Change of the field between neighbouring sampled cells.
    #[default]
    Gradient,
    /// Standard deviation of the map.
    Variance,
}

/// Current knowledge of the field.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownField {
    /// Grid of the cells.
    pub spec: GridSpec,
    /// Every cell, row by row from the lowest y; `None` for unknown cells.
    pub cells: Vec<Option<KnownCell>>,
}

/// Current knowledge of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownCell {
    /// Value of the field at the centre.
    pub value: f64,
    /// Standard deviation of the value.
    pub sigma: f64,
    /// Whether the cell itself contains samples, not only its surroundings.
    pub sampled: bool,
}

impl From<&GridMap> for KnownField {
    fn from(map: &GridMap) -> Self {
        let cells = map
            .cells()
            .iter()
            .map(|cell| cell.map(|cell| KnownCell { value: cell.value, sigma: cell.sigma, sampled: cell.samples > 0 }));
        Self { spec: *map.spec(), cells: cells.collect() }
    }
}

/// Options of the selection of patches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchOptions {
    /// Merit of a cell.
    pub merit: Merit,
    /// Side of a tile, m: about the pitch of the coarse scan, because a feature seen on one line may
    /// extend to the next.
    pub tile_m: f64,
    /// Share of the area that the patches may cover, 0 to 1.
    pub share: f64,
    /// A tile is not selected if its merit is below this share of the largest merit, 0 to 1.
    pub least: f64,
}

/// A rectangle to be scanned again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Lowest x and y, m.
    pub low_m: [f64; 2],
    /// Highest x and y, m.
    pub high_m: [f64; 2],
    /// Axis of the scan lines: 0 for x, 1 for y.
    pub along: usize,
}

/// Merit of a tile, and its changes along x and along y.
#[derive(Debug, Clone, Copy, Default)]
struct Tile {
    merit: f64,
    changes: [f64; 2],
}

/// Selects the patches of a rectangle (m) of the known map that deserve a second scan, in visiting order from `from_m`:
/// always the nearest one next.
#[must_use]
pub fn patches(
    known: &KnownField,
    low_m: [f64; 2],
    high_m: [f64; 2],
    from_m: [f64; 2],
    options: &PatchOptions,
) -> Vec<Patch> {
    let count = |k: usize| ((high_m[k] - low_m[k]) / options.tile_m).round().clamp(1.0, 1000.0) as usize;
    let (columns, rows) = (count(0), count(1));
    let side = |k: usize, n: usize| (high_m[k] - low_m[k]) / n as f64;
    let size_m = [side(0, columns), side(1, rows)];
    let tiles = tiles(known, low_m, size_m, [columns, rows], options.merit);
    let mut order: Vec<usize> = (0..tiles.len()).filter(|at| tiles[*at].merit > 0.0).collect();
    order.sort_by(|a, b| tiles[*b].merit.total_cmp(&tiles[*a].merit).then(a.cmp(b)));
    let most = order.first().map_or(0.0, |at| tiles[*at].merit);
    order.retain(|at| tiles[*at].merit >= options.least * most);
    order.truncate((options.share * tiles.len() as f64).floor() as usize);
    let mut taken: Vec<Option<usize>> = vec![None; tiles.len()];
    for at in order {
        taken[at] = Some(usize::from(tiles[at].changes[1] > tiles[at].changes[0]));
    }
    let corner = |column: usize, row: usize| [low_m[0] + column as f64 * size_m[0], low_m[1] + row as f64 * size_m[1]];
    let found = rectangles(taken, columns).into_iter().map(|(along, [left, right, bottom, top])| Patch {
        low_m: corner(left, bottom),
        high_m: corner(right, top),
        along,
    });
    visiting_order(found.collect(), from_m)
}

fn tiles(
    known: &KnownField,
    low_m: [f64; 2],
    size_m: [f64; 2],
    [columns, rows]: [usize; 2],
    merit: Merit,
) -> Vec<Tile> {
    let mut tiles = vec![Tile::default(); columns * rows];
    let spec = &known.spec;
    let changes = changes(known);
    for (at, cell) in known.cells.iter().enumerate() {
        let Some(cell) = cell else { continue };
        let place = spec.centre(at % spec.columns, at / spec.columns);
        let number = |k: usize, n: usize| {
            let tile = ((place[k] - low_m[k]) / size_m[k]).floor();
            (tile >= 0.0 && tile < n as f64).then_some(tile as usize)
        };
        let (Some(column), Some(row)) = (number(0, columns), number(1, rows)) else { continue };
        let tile = &mut tiles[row * columns + column];
        let [x, y] = [0, 1].map(|k| changes[k][at]);
        let of_cell = match merit {
            Merit::Gradient => x.max(y),
            Merit::Variance => cell.sigma,
        };
        tile.merit = tile.merit.max(of_cell);
        tile.changes[0] += x;
        tile.changes[1] += y;
    }
    tiles
}

/// Change of the field along x and along y from one sampled cell to the next, for both of them and for all cells
/// between, where the edge may be as well. Changes on one track are extended to the cells between it and the next.
fn changes(known: &KnownField) -> [Vec<f64>; 2] {
    let spec = &known.spec;
    let sampled = |at: usize| known.cells[at].filter(|cell| cell.sampled).map(|cell| cell.value);
    let mut changes = [vec![0.0f64; spec.cells()], vec![0.0; spec.cells()]];
    for (along, changes) in changes.iter_mut().enumerate() {
        for_neighbours(spec, along, sampled, |line, from, to| {
            let [a, b] = [from, to].map(|i| sampled(line(i)).unwrap_or(0.0));
            // a sampled cell only has the merit of an edge of its own, unless the next cell is sampled too
            let inside = if to == from + 1 { from..to + 1 } else { from + 1..to };
            for at in inside.map(line) {
                changes[at] = changes[at].max((a - b).abs());
            }
        });
    }
    for (along, changes) in changes.iter_mut().enumerate() {
        for_neighbours(spec, 1 - along, sampled, |line, from, to| {
            let most = changes[line(from)].max(changes[line(to)]);
            for at in (from + 1..to).map(line) {
                changes[at] = changes[at].max(most);
            }
        });
    }
    changes
}

/// Visits every pair of neighbouring sampled cells on a row (`along` 0) or column (1): the index function of that row
/// or column, and the positions of the two on it.
fn for_neighbours(
    spec: &GridSpec,
    along: usize,
    sampled: impl Fn(usize) -> Option<f64>,
    mut visit: impl FnMut(&dyn Fn(usize) -> usize, usize, usize),
) {
    let (lines, length) = if along == 0 { (spec.rows, spec.columns) } else { (spec.columns, spec.rows) };
    for number in 0..lines {
        let line = |i: usize| if along == 0 { spec.index(i, number) } else { spec.index(number, i) };
        let mut last = None;
        for i in (0..length).filter(|i| sampled(line(*i)).is_some()) {
            if let Some(last) = last.replace(i) {
                visit(&line, last, i);
            }
        }
    }
}

/// Joins tiles of one direction to rectangles [left, right, bottom, top] (right and top excluded): each as long as
/// possible along its lines, then as wide as possible with that length.
fn rectangles(mut taken: Vec<Option<usize>>, columns: usize) -> Vec<(usize, [usize; 4])> {
    let rows = taken.len() / columns;
    let mut found = Vec::new();
    for at in 0..taken.len() {
        let Some(along) = taken[at] else { continue };
        let (left, bottom) = (at % columns, at / columns);
        let (mut right, mut top) = (left + 1, bottom + 1);
        let is = |taken: &[Option<usize>], column: usize, row: usize| taken[row * columns + column] == Some(along);
        let longer = |taken: &[Option<usize>], right: &mut usize, top: usize| {
            while *right < columns && (bottom..top).all(|row| is(taken, *right, row)) {
                *right += 1;
            }
        };
        let wider = |taken: &[Option<usize>], right: usize, top: &mut usize| {
            while *top < rows && (left..right).all(|column| is(taken, column, *top)) {
                *top += 1;
            }
        };
        if along == 0 {
            longer(&taken, &mut right, top);
            wider(&taken, right, &mut top);
        } else {
            wider(&taken, right, &mut top);
            longer(&taken, &mut right, top);
        }
        for row in bottom..top {
            taken[row * columns + left..row * columns + right].fill(None);
        }
        found.push((along, [left, right, bottom, top]));
    }
    found
}

/// Visiting order: always the patch with the nearest corner next.
fn visiting_order(mut left: Vec<Patch>, from_m: [f64; 2]) -> Vec<Patch> {
    let mut order = Vec::with_capacity(left.len());
    let mut here = from_m;
    while !left.is_empty() {
        let away = |patch: &Patch| {
            let [dx, dy] = [0, 1].map(|k| (here[k] - here[k].clamp(patch.low_m[k], patch.high_m[k])).abs());
            dx * dx + dy * dy
        };
        let next = (0..left.len()).min_by(|a, b| away(&left[*a]).total_cmp(&away(&left[*b]))).unwrap_or(0);
        let patch = left.swap_remove(next);
        here = [0, 1].map(|k| 0.5 * (patch.low_m[k] + patch.high_m[k]));
        order.push(patch);
    }
    order
}
