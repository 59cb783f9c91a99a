//! The matrices between cables and node: J of (14), its inverse B, and Λ = -Jᵀ of (15).

use std::ops::Deref;

use nalgebra::{Matrix3, Vector3};

use super::solution::KinematicsError;
use crate::pulley::{Both, Tangents};
use crate::{Anchors, CableVec, MAX_CABLES, linalg};

/// The cable Jacobian J of (13)-(14): N x 3, each row the unit vector of a free cable toward the node; dL/dt = J dX/dt.
/// In the plane y = 0 it is N x 2: the middle column is 0 and does not count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jacobian {
    rows: [Vector3<f64>; MAX_CABLES],
    len: usize,
    planar: bool,
}

impl Jacobian {
    /// Computes J at a position. Fails where the direction of a cable is undefined: at an anchor, inside the wheel of
    /// a pulley, and on its axis.
    #[inline]
    pub fn at(anchors: &Anchors, position: &Vector3<f64>) -> Result<Self, KinematicsError> {
        let mut rows = [Vector3::zeros(); MAX_CABLES];
        fill_rows(anchors, position, &mut rows)?;
        Ok(Self { rows, len: anchors.len(), planar: anchors.is_planar() })
    }

    /// Cable velocities dL/dt for a node velocity, m/s.
    #[inline]
    pub fn cable_velocity(&self, node_velocity_m_s: &Vector3<f64>) -> CableVec {
        CableVec::from_fn(self.len, |i| self.rows[i].dot(node_velocity_m_s))
    }

    /// B: the inverse for as many cables as directions and the pseudo-inverse for more; None if the rank is below the
    /// number of directions.
    #[inline]
    pub fn node_jacobian(&self) -> Option<NodeJacobian> {
        let Self { len, planar, .. } = *self;
        linalg::pseudo_inverse(self, planar).map(|columns| NodeJacobian { columns, len, planar })
    }

    /// The structure matrix Λ = -Jᵀ of (15).
    pub fn structure_matrix(&self) -> StructureMatrix {
        let mut columns = self.rows;
        for c in &mut columns {
            *c = -*c;
        }
        StructureMatrix { columns, len: self.len, planar: self.planar }
    }
}

/// Computes the rows of J in place: results of this size are copied where they are passed on.
fn fill_rows(
    anchors: &Anchors,
    position: &Vector3<f64>,
    rows: &mut [Vector3<f64>; MAX_CABLES],
) -> Result<(), KinematicsError> {
    if rows_by_pairs(anchors, position, rows) {
        return Ok(());
    }
    for (i, (row, anchor)) in rows.iter_mut().zip(anchors.iter()).enumerate() {
        let pulley = anchors.pulley(i);
        if pulley.radius_m != 0.0 {
            *row = pulley
                .direction(position)
                .map_err(|why| KinematicsError::without_direction(why, i, &pulley, position))?;
            continue;
        }
        // The order of these operations decides the last bit, on which the replay of recorded runs depends.
        let mut d = position - anchor;
        if anchors.is_planar() {
            d.y = 0.0;
        }
        let length = d.norm();
        // Also false for NaN.
        if !(length >= 1e-9 && length.is_finite()) {
            return Err(KinematicsError::singular(position));
        }
        *row = d * (1.0 / length);
    }
    Ok(())
}

/// Computes the rows two by two. False for a robot that has both eyes and pulleys, and if a cable has no direction.
fn rows_by_pairs(anchors: &Anchors, position: &Vector3<f64>, rows: &mut [Vector3<f64>; MAX_CABLES]) -> bool {
    let Some(pairs) = anchors.pairs_of_a_kind() else { return false };
    let pulleys = anchors.have_pulleys();
    let mut all = true;
    for (rows, pair) in rows.as_chunks_mut().0.iter_mut().zip(pairs) {
        if pulleys {
            let tangents = Tangents::of(&pair, position);
            *rows = tangents.directions();
            all &= tangents.have_directions();
        } else {
            let eyes = Both::from_eyes(&pair, position);
            *rows = eyes.directions();
            all &= eyes.have_lengths();
        }
    }
    if let Some(unused) = rows.get_mut(anchors.len()) {
        *unused = Vector3::zeros();
    }
    all
}

/// Slice of the rows.
impl Deref for Jacobian {
    type Target = [Vector3<f64>];
    fn deref(&self) -> &[Vector3<f64>] {
        &self.rows[..self.len]
    }
}

/// The node Jacobian B = J⁻¹ of section IV-B, or the pseudo-inverse: 3 x N, with a row of zeros for y in the plane.
/// Also any other matrix that maps small length changes to small position changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeJacobian {
    pub(crate) columns: [Vector3<f64>; MAX_CABLES],
    pub(crate) len: usize,
    pub(crate) planar: bool,
}

impl NodeJacobian {
    /// Computes B at a position. Fails in the plane of three anchors, on the line of the anchors of a planar
    /// robot, and at an anchor.
    pub fn at(anchors: &Anchors, position: &Vector3<f64>) -> Result<Self, KinematicsError> {
        Jacobian::at(anchors, position)?.node_jacobian().ok_or_else(|| KinematicsError::singular(position))
    }

    /// Builds B of a spatial robot from its columns, one per cable; columns beyond [`MAX_CABLES`] are ignored.
    pub fn from_columns(given: &[Vector3<f64>]) -> Self {
        let len = given.len().min(MAX_CABLES);
        let mut columns = [Vector3::zeros(); MAX_CABLES];
        columns[..len].copy_from_slice(&given[..len]);
        Self { columns, len, planar: false }
    }

    /// True if the node moves in the plane y = 0 only.
    pub fn is_planar(&self) -> bool {
        self.planar
    }

    /// Node velocity for cable velocities dL/dt, m/s; their least-squares fit for more cables than directions.
    #[inline]
    pub fn node_velocity(&self, cable_velocity_m_s: &[f64]) -> Vector3<f64> {
        self.iter().zip(cable_velocity_m_s).fold(Vector3::zeros(), |sum, (c, v)| sum + c * *v)
    }

    /// Covariance of the position, m², for independent length errors with these standard deviations, m.
    pub fn covariance(&self, sigma_length_m: &[f64]) -> Matrix3<f64> {
        self.iter().zip(sigma_length_m).fold(Matrix3::zeros(), |sum, (c, s)| sum + linalg::outer(c, c) * (s * s))
    }
}

/// Slice of the columns.
impl Deref for NodeJacobian {
    type Target = [Vector3<f64>];
    fn deref(&self) -> &[Vector3<f64>] {
        &self.columns[..self.len]
    }
}

/// The structure matrix Λ of (15): 3 x N, maps tensions to the force on the node; 2 x N in the plane y = 0, where the
/// middle row is 0 and does not count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StructureMatrix {
    columns: [Vector3<f64>; MAX_CABLES],
    len: usize,
    planar: bool,
}

impl StructureMatrix {
    /// Builds Λ of a spatial robot from its columns, one per cable; columns beyond [`MAX_CABLES`] are ignored.
    pub fn from_columns(given: &[Vector3<f64>]) -> Self {
        let NodeJacobian { columns, len, planar } = NodeJacobian::from_columns(given);
        Self { columns, len, planar }
    }

    /// Number of directions of the forces: 3, or 2 in the plane y = 0.
    pub fn dimensions(&self) -> usize {
        if self.planar { 2 } else { 3 }
    }

    /// True if all forces lie in the plane y = 0.
    pub fn is_planar(&self) -> bool {
        self.planar
    }

    /// Computes Λ at a position.
    #[inline]
    pub fn at(anchors: &Anchors, position: &Vector3<f64>) -> Result<Self, KinematicsError> {
        let mut columns = [Vector3::zeros(); MAX_CABLES];
        fill_rows(anchors, position, &mut columns)?;
        for c in &mut columns {
            *c = -*c;
        }
        Ok(Self { columns, len: anchors.len(), planar: anchors.is_planar() })
    }

    /// Force of these tensions on the node, N.
    pub fn force(&self, tensions_n: &[f64]) -> Vector3<f64> {
        self.iter().zip(tensions_n).fold(Vector3::zeros(), |sum, (c, t)| sum + c * *t)
    }
}

/// Slice of the columns.
impl Deref for StructureMatrix {
    type Target = [Vector3<f64>];
    fn deref(&self) -> &[Vector3<f64>] {
        &self.columns[..self.len]
    }
}
