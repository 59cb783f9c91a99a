//! Motor model and control law.

use super::args::{Args, invalid_value};
use super::error::{OperationResult, SolveError};
use cable_control::law::{InputWeight, LqGain};
use cable_control::motor_model;
use cable_robot::{MAX_CABLES, Matrix3, NodeJacobian, Vector3};
use serde_json::json;

/// Fits the motor model, (18)-(20).
pub fn fit_motor(args: &Args) -> OperationResult {
    let (desired, actual) = (args.numbers("desired_m_s")?, args.numbers("actual_m_s")?);
    let ridge = args.optional("ridge")?.unwrap_or(0.0);
    let prior = match args.get("prior") {
        Some(_) => args.exactly::<2>("prior")?,
        None => motor_model::PRIOR,
    };
    let phi = motor_model::fit(&desired, &actual, args.count("window")?, ridge, prior)?;
    Ok(json!({ "phi": phi }))
}

/// Gain of the receding-horizon law with a fixed end point.
pub fn lq_gain(args: &Args) -> OperationResult {
    let b = args.matrix("node_jacobian")?;
    let (n, cables) = (b.len(), b[0].len());
    // Missing dimensions become decoupled cables that only move themselves, so the three-dimensional solver also
    // handles one or two rows.
    let dummies = 3usize.saturating_sub(n);
    if n > 3 || cables + dummies > MAX_CABLES {
        return Err(invalid_value(
            "node_jacobian",
            &format!("{n} x {cables}"),
            "1 to 3 rows (dimensions), one column per cable",
        ));
    }
    let (q, r) = (args.weight("state_weight", n)?, args.weight("input_weight", cables)?);
    let size = b.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
    let columns: Vec<Vector3<f64>> = (0..cables + dummies)
        .map(|c| {
            let entry = |k: usize| match (k < n, c < cables) {
                (true, true) => b[k][c],
                (false, false) if k - n == c - cables => size,
                _ => 0.0,
            };
            Vector3::new(entry(0), entry(1), entry(2))
        })
        .collect();
    let state = Matrix3::from_fn(|i, j| if i < n && j < n { q[i][j] } else { 0.0 });
    let mut input = [[0.0; MAX_CABLES]; MAX_CABLES];
    for (i, row) in input.iter_mut().enumerate().take(cables + dummies) {
        for (j, value) in row.iter_mut().enumerate().take(cables + dummies) {
            *value = if i < cables && j < cables {
                r[i][j]
            } else if i == j {
                r[0][0]
            } else {
                0.0
            };
        }
    }
    let horizon = u32::try_from(args.count("horizon")?).map_err(|_| SolveError::invalid("horizon is too long"))?;
    let columns = NodeJacobian::from_columns(&columns);
    let gain = LqGain::new(&columns, args.number("period_s")?, &state, &InputWeight::Full(input), horizon)?;
    let rows: Vec<Vec<f64>> = gain.rows()[..cables].iter().map(|row| row.as_slice()[..n].to_vec()).collect();
    Ok(json!({ "gain": rows }))
}
