//! Tensions at a position, from the anchors only, of planar and spatial robots.

use nalgebra::Vector3;

use super::distribution::{TensionError, Tensions, margin};
use super::general::{self, GeneralStructure};
use crate::{Anchors, Distribution, MAX_CABLES, StructureMatrix};

/// Computes tensions that hold a node at a position, of a spatial robot or of a planar one (anchors and position in the
/// x-z plane, y = 0). [`Distribution::Unique`] ignores the limits.
pub fn hold(
    anchors: &Anchors,
    position: &Vector3<f64>,
    wrench_n: &Vector3<f64>,
    limits_n: [f64; 2],
    method: Distribution,
) -> Result<Tensions, TensionError> {
    let mut unit = [Vector3::zeros(); MAX_CABLES];
    for (u, pulley) in unit.iter_mut().zip(anchors.pulleys()) {
        *u = -pulley.direction(position).map_err(|_| TensionError::Singular)?;
    }
    let unit = &unit[..anchors.len()];
    if anchors.is_planar() {
        return general::distribute(&GeneralStructure::planar(unit), &[wrench_n.x, wrench_n.z], limits_n, method);
    }
    let structure = StructureMatrix::from_columns(unit);
    if method == Distribution::Unique {
        let tensions_n = super::unique(&structure, wrench_n)?;
        return Ok(Tensions { tensions_n, margin_n: margin(&tensions_n, limits_n) });
    }
    super::distribute(&structure, wrench_n, limits_n, method)
}
