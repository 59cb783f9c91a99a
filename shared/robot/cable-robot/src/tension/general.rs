//! Tension distribution for any number of directions and cables, m ≥ n: a planar robot with four cables (2 x 4) and a
//! spatial one with eight are the same problem.
//!
//! * Least norm (27): projection of the origin on the solutions within the limits, by an active set method over the
//!   redundant cables.
//! * Least sum: the best vertex of the solutions; all are tried, as in the paper's reference \[37\] for one redundant
//!   cable. If several are best, the least norm of everything with that sum.
//! * Safest: the greatest distance to the nearest limit; the least norm if that distance is unbounded.
//!
//! The structure matrix is n x m, wrench and tensions are in N; errors are those of [`crate::tension`].

use nalgebra::Vector3;

use super::distribution::{
    TOLERANCE, TensionError, Tensions, Violation, check_limits, check_wrench, margin, worst_violation,
};
use super::nearest::Solutions;
use crate::linalg::{dot, norm};
use crate::{CableVec, Distribution, MAX_CABLES, StructureMatrix};

/// Largest number of directions: the largest number of cables.
pub const MAX_ROWS: usize = MAX_CABLES;

/// A row whose part orthogonal to the others is below this share of it adds no direction.
const RANK_TOLERANCE: f64 = 1e-9;

/// Bisection steps for the margin of the safest distribution, down to rounding.
const HALVINGS: usize = 60;

/// Relative force balance in the search for the edge of the feasible set: a larger tolerance would shift the edge.
const EDGE_TOLERANCE: f64 = 1e-12;

/// One value per direction; unused entries are 0.
pub type Row = [f64; MAX_ROWS];

/// A structure matrix with n rows (directions) and m ≥ n columns (cables).
///
/// ```
/// use cable_robot::Distribution;
/// use cable_robot::tension::general::{self, GeneralStructure};
/// // A planar robot with four cables and a floating node: only preload.
/// let d = 0.5f64.sqrt();
/// let structure = GeneralStructure::new(&[vec![-d, d, d, -d], vec![d, d, -d, -d]])?;
/// let held = general::distribute(&structure, &[0.0, 0.0], [2.0, 60.0], Distribution::LeastNorm)?;
/// assert!(held.tensions_n.iter().all(|t| (t - 2.0).abs() < 1e-9));
/// # Ok::<(), cable_robot::tension::TensionError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeneralStructure {
    columns: [Row; MAX_CABLES],
    rows: usize,
    cables: usize,
}

impl GeneralStructure {
    /// Builds the matrix from its rows: 1 to 8 rows of equal length with finite values, at least as many
    /// columns, at most 8.
    pub fn new(rows: &[Vec<f64>]) -> Result<Self, TensionError> {
        let refuse = |what, value| {
            let accepted = "1 to 8 rows of equal length, at least as many and at most 8 columns";
            Err(TensionError::InvalidArgument { what, value, accepted })
        };
        if !(1..=MAX_ROWS).contains(&rows.len()) {
            return refuse("the number of rows of the structure matrix", rows.len() as f64);
        }
        let cables = rows[0].len();
        if !(rows.len()..=MAX_CABLES).contains(&cables) {
            return refuse("the number of columns of the structure matrix", cables as f64);
        }
        let mut columns = [[0.0; MAX_ROWS]; MAX_CABLES];
        for (r, row) in rows.iter().enumerate() {
            if row.len() != cables {
                return refuse("the length of a row of the structure matrix", row.len() as f64);
            }
            for (c, value) in row.iter().enumerate() {
                if !(value.abs() <= 1e9) {
                    let (what, accepted) = ("an entry of the structure matrix", "finite numbers up to 1e9");
                    return Err(TensionError::InvalidArgument { what, value: *value, accepted });
                }
                columns[c][r] = *value;
            }
        }
        Ok(Self { columns, rows: rows.len(), cables })
    }

    /// That of a planar robot in the x-z plane: two rows. `unit` are vectors from the node to the anchors, of length 1.
    pub(super) fn planar(unit: &[Vector3<f64>]) -> Self {
        let mut columns = [[0.0; MAX_ROWS]; MAX_CABLES];
        for (column, u) in columns.iter_mut().zip(unit) {
            (column[0], column[1]) = (u.x, u.z);
        }
        Self { columns, rows: 2, cables: unit.len().min(MAX_CABLES) }
    }

    /// Number of directions.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of cables.
    pub fn cables(&self) -> usize {
        self.cables
    }

    /// Force of these tensions, N, one value per row.
    pub fn force(&self, tensions_n: &[f64]) -> Row {
        let mut sum = [0.0; MAX_ROWS];
        for (column, t) in self.columns[..self.cables].iter().zip(tensions_n) {
            for r in 0..self.rows {
                sum[r] += column[r] * t;
            }
        }
        sum
    }

    /// Λᵀ(ΛΛᵀ)⁻¹b (38), N: the least norm without limits. Fails if rows are linearly dependent.
    pub fn least_norm_unbounded(&self, wrench_n: &[f64]) -> Result<CableVec, TensionError> {
        let rows = self.row_space(wrench_n);
        if rows.rank < self.rows { Err(TensionError::Singular) } else { Ok(rows.shortest_n(self.cables)) }
    }

    /// Orthonormal directions of the rows, and the forces along them: Λᵀ = Q R by Gram-Schmidt with
    /// reorthogonalisation, Rᵀ z = b. Rows that depend on earlier ones are left out.
    fn row_space(&self, wrench_n: &[f64]) -> RowSpace {
        let (n, m) = (self.rows, self.cables);
        let mut result = RowSpace { q: [[0.0; MAX_CABLES]; MAX_ROWS], z: [0.0; MAX_ROWS], rank: 0, consistent: true };
        for j in 0..n {
            let mut v = [0.0; MAX_CABLES];
            for (vi, column) in v.iter_mut().zip(&self.columns).take(m) {
                *vi = column[j];
            }
            let size = norm(&v[..m]);
            let rank = result.rank;
            let r = remove_components(&mut v, &result.q[..rank], m);
            let rest = norm(&v[..m]);
            let missing = wrench_n[j] - dot(&r[..rank], &result.z[..rank]);
            if !(rest > RANK_TOLERANCE * size) {
                let force = 1.0 + wrench_n[j].abs() + size * norm(&result.z[..rank]);
                result.consistent &= missing.abs() <= RANK_TOLERANCE * force;
                continue;
            }
            for (qk, vk) in result.q[rank].iter_mut().zip(&v) {
                *qk = vk / rest;
            }
            result.z[rank] = missing / rest;
            result.rank += 1;
        }
        result
    }

    /// All tensions with these forces; None if linearly dependent rows have forces that contradict each other.
    fn solutions(&self, wrench_n: &[f64]) -> Option<Solutions> {
        let m = self.cables;
        let mut rows = self.row_space(wrench_n);
        let particular_n = rows.consistent.then(|| rows.shortest_n(m))?;
        let redundancy = m - rows.rank;
        let mut null = [[0.0; MAX_CABLES]; MAX_CABLES];
        for k in 0..redundancy {
            // Of the axes, the one with the largest part outside of the directions so far.
            let outside = |axis: usize| 1.0 - rows.q[..rows.rank].iter().map(|q| q[axis] * q[axis]).sum::<f64>();
            let axis = (0..m).max_by(|a, b| outside(*a).total_cmp(&outside(*b)))?;
            let mut v = [0.0; MAX_CABLES];
            v[axis] = 1.0;
            remove_components(&mut v, &rows.q[..rows.rank], m);
            let size = norm(&v[..m]);
            let unit = v.map(|vk| vk / size);
            for (row, value) in null.iter_mut().zip(&unit) {
                row[k] = *value;
            }
            (rows.q[rows.rank], rows.rank) = (unit, rows.rank + 1);
        }
        Some(Solutions { particular_n, null, redundancy })
    }

    /// The pseudo-inverse: a row per cable, a column per direction. Fails if rows are linearly dependent.
    pub fn pseudo_inverse(&self) -> Result<[Row; MAX_CABLES], TensionError> {
        let mut result = [[0.0; MAX_ROWS]; MAX_CABLES];
        for c in 0..self.rows {
            let mut unit = [0.0; MAX_ROWS];
            unit[c] = 1.0;
            for (row, value) in result.iter_mut().zip(self.least_norm_unbounded(&unit)?.iter()) {
                row[c] = *value;
            }
        }
        Ok(result)
    }

    /// The matrix with a further row of ones, whose force is the sum of the tensions.
    fn with_sum_row(&self) -> Option<Self> {
        if self.rows == MAX_ROWS {
            return None;
        }
        let mut result = *self;
        for column in &mut result.columns[..self.cables] {
            column[self.rows] = 1.0;
        }
        result.rows += 1;
        Some(result)
    }
}

/// The directions of linearly independent rows.
struct RowSpace {
    q: [[f64; MAX_CABLES]; MAX_ROWS],
    /// Forces along them, N.
    z: [f64; MAX_ROWS],
    rank: usize,
    /// The forces of the dependent rows follow from the others.
    consistent: bool,
}

impl RowSpace {
    /// The least norm without limits, N.
    fn shortest_n(&self, cables: usize) -> CableVec {
        CableVec::from_fn(cables, |i| (0..self.rank).map(|j| self.q[j][i] * self.z[j]).sum())
    }
}

/// Removes the components along orthonormal directions, twice against rounding, and returns them.
fn remove_components(v: &mut [f64; MAX_CABLES], directions: &[[f64; MAX_CABLES]], m: usize) -> Row {
    let mut components = [0.0; MAX_ROWS];
    for _ in 0..2 {
        for (component, q) in components.iter_mut().zip(directions) {
            let d = dot(&q[..m], &v[..m]);
            *component += d;
            for (vk, qk) in v.iter_mut().zip(q) {
                *vk -= d * qk;
            }
        }
    }
    components
}

impl From<&StructureMatrix> for GeneralStructure {
    fn from(structure: &StructureMatrix) -> Self {
        if structure.is_planar() {
            return Self::planar(structure);
        }
        let mut columns = [[0.0; MAX_ROWS]; MAX_CABLES];
        for (column, c) in columns.iter_mut().zip(structure.iter()) {
            column[..3].copy_from_slice(c.as_slice());
        }
        Self { columns, rows: 3, cables: structure.len() }
    }
}

/// Computes tensions within `limits_n` = [min, max] whose forces add up to the wrench, N. [`Distribution::Unique`] is
/// for as many cables as directions and ignores the limits.
pub fn distribute(
    structure: &GeneralStructure,
    wrench_n: &[f64],
    limits_n: [f64; 2],
    method: Distribution,
) -> Result<Tensions, TensionError> {
    check_limits(limits_n)?;
    check_wrench(wrench_n)?;
    if wrench_n.len() != structure.rows {
        let (what, accepted) = ("the number of forces", "one per row of the structure matrix");
        return Err(TensionError::InvalidArgument { what, value: wrench_n.len() as f64, accepted });
    }
    let free = structure.least_norm_unbounded(wrench_n)?;
    let square = structure.rows == structure.cables;
    if method == Distribution::Unique && !square {
        let accepted = "least-norm, min-sum or safest; unique is for as many cables as directions";
        return Err(TensionError::Method { method, cables: structure.cables, accepted });
    }
    let tensions_n = if square {
        match worst_violation(&free, limits_n) {
            Some(violation) if method != Distribution::Unique => return Err(TensionError::Infeasible(violation)),
            _ => free,
        }
    } else {
        match method {
            Distribution::MinSum => min_sum(structure, wrench_n, limits_n)?,
            Distribution::Safest => safest(structure, wrench_n, limits_n)?,
            _ => least_norm(structure, wrench_n, limits_n)?,
        }
    };
    Ok(Tensions { tensions_n, margin_n: margin(&tensions_n, limits_n) })
}

/// Converts a force to the values for a structure matrix of space or of the plane; only as many count as it has rows.
pub(super) fn forces(structure: &StructureMatrix, wrench_n: &Vector3<f64>) -> [f64; 3] {
    if structure.is_planar() { [wrench_n.x, wrench_n.z, 0.0] } else { (*wrench_n).into() }
}

/// Computes the least norm within limits (27) by an active set method, that of `nearest.rs`.
///
/// Linearly dependent rows are allowed if the forces are consistent.
pub fn least_norm(
    structure: &GeneralStructure,
    wrench_n: &[f64],
    limits_n: [f64; 2],
) -> Result<CableVec, TensionError> {
    least_norm_within(structure, wrench_n, limits_n, TOLERANCE)
}

/// Like [`least_norm`], with limits kept to this share.
fn least_norm_within(
    structure: &GeneralStructure,
    wrench_n: &[f64],
    limits_n: [f64; 2],
    tolerance: f64,
) -> Result<CableVec, TensionError> {
    let found = structure.solutions(wrench_n).and_then(|solutions| solutions.shortest(limits_n, tolerance));
    if let Some(tensions_n) = found {
        return Ok(tensions_n);
    }
    // Report the worst cable without limits, or else the first.
    let free = structure.least_norm_unbounded(wrench_n)?;
    Err(TensionError::Infeasible(worst_violation(&free, limits_n).unwrap_or(Violation {
        cable: 0,
        tension_n: free[0],
        limit_n: limits_n[0],
    })))
}

/// Computes the least sum: the best vertex of the solutions; if several are best, the least norm of their convex hull.
pub fn min_sum(structure: &GeneralStructure, wrench_n: &[f64], limits_n: [f64; 2]) -> Result<CableVec, TensionError> {
    // Also gives the reason if there is no solution.
    let least = least_norm(structure, wrench_n, limits_n)?;
    let (n, m) = (structure.rows, structure.cables);
    let [low, high] = limits_n;
    let scale = 1.0 + least.max_abs() + low;
    let mut best: Option<(f64, CableVec)> = None;
    let mut tied = false;
    for basis in 0u32..1 << m {
        if basis.count_ones() as usize != n {
            continue;
        }
        // All combinations of lower and upper limits for the other cables.
        let others = m - n;
        for at_high in 0u32..if high.is_finite() { 1 << others } else { 1 } {
            let Some(vertex) = vertex(structure, wrench_n, limits_n, basis, at_high) else { continue };
            if !vertex.iter().all(|t| *t >= low - TOLERANCE * scale && *t <= high + TOLERANCE * scale) {
                continue;
            }
            let sum = vertex.sum();
            match &best {
                Some((least, at)) if (sum - least).abs() <= 1e-10 * scale => {
                    let apart = vertex.zip_map(at, |a, b| a - b).max_abs();
                    tied |= apart > 1e-7 * scale;
                    if sum < *least {
                        best = Some((sum, vertex));
                    }
                }
                Some((least, _)) if sum > *least => {}
                _ => (best, tied) = (Some((sum, vertex)), false),
            }
        }
    }
    match (best, tied) {
        (Some((_, vertex)), false) => Ok(vertex.map(|t| t.clamp(low, high))),
        (Some((sum, vertex)), true) => {
            let face = structure.with_sum_row().and_then(|with_sum| {
                let mut forces = [0.0; MAX_ROWS];
                forces[..n].copy_from_slice(wrench_n);
                forces[n] = sum;
                least_norm(&with_sum, &forces[..=n], limits_n).ok()
            });
            Ok(face.unwrap_or(vertex))
        }
        // At the edge of the feasible set rounding may leave no vertex; then the solution set is one point.
        (None, _) => Ok(least),
    }
}

/// Tensions with the cables outside `basis` at limits and the forces balanced by those in it; None if
/// those are singular.
fn vertex(
    structure: &GeneralStructure,
    wrench_n: &[f64],
    [low, high]: [f64; 2],
    basis: u32,
    at_high: u32,
) -> Option<CableVec> {
    let (n, m) = (structure.rows, structure.cables);
    let mut a = [[0.0; MAX_ROWS + 1]; MAX_ROWS];
    let mut result = CableVec::zeros(m);
    let mut order = [0; MAX_CABLES];
    let (mut inside, mut outside) = (0, 0);
    let mut rest = [0.0; MAX_ROWS];
    rest[..n].copy_from_slice(wrench_n);
    for i in 0..m {
        let column = &structure.columns[i];
        if basis >> i & 1 == 1 {
            for r in 0..n {
                a[r][inside] = column[r];
            }
            order[inside] = i;
            inside += 1;
        } else {
            result[i] = if at_high >> outside & 1 == 1 { high } else { low };
            outside += 1;
            for r in 0..n {
                rest[r] -= column[r] * result[i];
            }
        }
    }
    for r in 0..n {
        a[r][n] = rest[r];
    }
    eliminate(&mut a, n)?;
    for (k, i) in order[..n].iter().enumerate() {
        result[*i] = a[k][n];
    }
    Some(result)
}

/// Solves the n x n system in the left part of `a` for its column n, in place, with partial pivoting; None if a
/// pivot is rounding.
fn eliminate(a: &mut [[f64; MAX_ROWS + 1]; MAX_ROWS], n: usize) -> Option<()> {
    let size = a[..n].iter().flat_map(|row| &row[..n]).fold(0.0, |m: f64, v| m.max(v.abs()));
    for c in 0..n {
        let pivot = (c..n).max_by(|i, j| a[*i][c].abs().total_cmp(&a[*j][c].abs()))?;
        if !(a[pivot][c].abs() > 1e-11 * size) {
            return None;
        }
        a.swap(c, pivot);
        let leading = a[c];
        for (r, row) in a.iter_mut().enumerate().take(n) {
            if r != c {
                let factor = row[c] / leading[c];
                for k in c..=n {
                    row[k] -= factor * leading[k];
                }
            }
        }
    }
    for c in 0..n {
        a[c][n] /= a[c][c];
    }
    Some(())
}

/// Computes the greatest margin by bisection, and of all distributions with it the least norm.
pub fn safest(structure: &GeneralStructure, wrench_n: &[f64], limits_n: [f64; 2]) -> Result<CableVec, TensionError> {
    let [low, high] = limits_n;
    let mut best = least_norm(structure, wrench_n, limits_n)?;
    let mut lost = 0.5 * (high - low);
    if !high.is_finite() {
        // Far above any tension that the force requires: if even this margin is possible, the margin is unbounded.
        lost = 1e3 * (1.0 + best.max_abs() + low);
        if least_norm(structure, wrench_n, [low + lost, high]).is_ok() {
            return Ok(best);
        }
    }
    let mut kept = 0.0;
    for _ in 0..HALVINGS {
        let margin = 0.5 * (kept + lost);
        // At the midpoint rounding may let the limits cross.
        let inner = [low + margin, (high - margin).max(low + margin)];
        match least_norm_within(structure, wrench_n, inner, EDGE_TOLERANCE) {
            Ok(tensions) => (kept, best) = (margin, tensions),
            Err(_) => lost = margin,
        }
    }
    Ok(best)
}
