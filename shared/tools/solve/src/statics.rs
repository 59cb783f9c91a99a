//! Cable tensions and the motion that they cause.

use super::args::{Args, Points, invalid_value};
use super::error::{OperationResult, SolveError};
use super::geometry::{directions, point_json, structure};
use cable_robot::tension::general::{self, GeneralStructure};
use cable_robot::tension::{self, FourCables, margin};
use cable_robot::{CableVec, Distribution, StructureMatrix, Vector3, sag};
use serde_json::{Value, json};

/// Returns the wrench m (a + g) of (15), N.
pub fn wrench(args: &Args, planar: bool) -> Result<Vector3<f64>, SolveError> {
    let mass = args.not_negative("node_mass_kg")?;
    let acceleration = match args.get("acceleration_m_s2") {
        Some(_) => args.vector("acceleration_m_s2", planar)?,
        None => Vector3::zeros(),
    };
    Ok((acceleration + Vector3::new(0.0, 0.0, args.gravity()?)) * mass)
}

/// Weight of the cables, N/m: `cable_mass_kg_m`, 0 if it is not given.
pub fn cable_weight_n_m(args: &Args) -> Result<f64, SolveError> {
    match args.get("cable_mass_kg_m") {
        Some(_) => Ok(args.not_negative("cable_mass_kg_m")? * args.gravity()?),
        None => Ok(0.0),
    }
}

/// Tensions at a position, (15), (27)-(37).
pub fn tensions(args: &Args) -> OperationResult {
    let anchors = args.anchors()?;
    let Points { points, planar, .. } = &anchors;
    let at = args.vector("position_m", *planar)?;
    let mut wrench = wrench(args, *planar)?;
    let cable_weight_n_m = cable_weight_n_m(args)?;
    let method = args.method()?;
    let bounded = args.get("limits_n").is_some();
    let limits = if bounded || method != Distribution::Unique { args.limits()? } else { [0.0, f64::INFINITY] };
    let directions = directions(&anchors, &at)?;
    // Reports a lost rank before the limits are checked.
    structure(&directions, *planar)?.pseudo_inverse()?;
    let checked = anchors.checked()?;
    if cable_weight_n_m != 0.0 {
        wrench.z += sag::carried_n(&checked, &at, cable_weight_n_m);
    }
    let found = tension::hold(&checked, &at, &wrench, limits, method)?;
    let mut result = summary(&found.tensions_n);
    result["margin_n"] = if bounded { json!(margin(&found.tensions_n, limits)) } else { Value::Null };
    if points.len() == 4 && !planar {
        let columns: Vec<Vector3<f64>> = directions.iter().map(|d| -d).collect();
        let line = FourCables::new(&StructureMatrix::from_columns(&columns), &wrench, limits)?;
        result["interval_n"] = json!(line.interval_of_last_n());
        result["unconstrained_n"] = json!(line.particular_n[3]);
        result["c"] = json!(line.c());
    }
    Ok(result)
}

fn summary(tensions_n: &CableVec) -> Value {
    json!({ "tensions_n": tensions_n.to_vec(), "sum_n": tensions_n.sum(), "norm_sq_n2": tensions_n.norm_squared() })
}

/// Tensions for any structure matrix, (27).
pub fn distribute(args: &Args) -> OperationResult {
    let structure = GeneralStructure::new(&args.matrix("structure_matrix")?)?;
    let wrench = args.numbers("wrench_n")?;
    let limits = args.limits()?;
    if wrench.len() != structure.rows() {
        let given = format!("{} numbers for {} rows", wrench.len(), structure.rows());
        return Err(invalid_value("wrench_n", &given, "one per row of structure_matrix"));
    }
    let method = args.get("method").map_or(Ok(Distribution::LeastNorm), |_| args.method())?;
    let found = general::distribute(&structure, &wrench, limits, method)?;
    Ok(summary(&found.tensions_n))
}

/// Acceleration of the node from cable tensions, (16).
pub fn node_acceleration(args: &Args) -> OperationResult {
    let anchors = args.anchors()?;
    let at = args.vector("position_m", anchors.planar)?;
    let tensions = args.per_cable("tensions_n", anchors.points.len())?;
    let (mass, gravity) = (args.positive("node_mass_kg")?, args.gravity()?);
    let rows = directions(&anchors, &at)?;
    let force = rows.iter().zip(&tensions).fold(Vector3::zeros(), |sum, (row, t)| sum - row * *t);
    let acceleration = force / mass - Vector3::new(0.0, 0.0, gravity);
    Ok(json!({ "acceleration_m_s2": point_json(&acceleration, anchors.planar) }))
}
