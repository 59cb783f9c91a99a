//! Motor currents, paths and the energy of moves.

use super::args::{Args, invalid_value};
use super::error::{OperationResult, SolveError};
use super::geometry::point_json;
use super::statics::{cable_weight_n_m, wrench};
use cable_robot::energy::{Bounds, Cost, Current, WinchEnergy, parabola as shape};
use cable_robot::path::Parabola;
use cable_robot::{Anchors, Distribution, Vector3, motor};
use serde_json::{Value, json};

/// Motor current from the friction model or a measured table.
pub fn motor_current(args: &Args) -> OperationResult {
    let (speed, tension) = (args.number("speed_m_s")?, args.number("tension_n")?);
    let current = match args.table(0.0)? {
        Some(table) => table.current_a(tension, speed)?,
        None => args.motor()?.current_a(tension, speed),
    };
    Ok(json!({ "current_a": current }))
}

/// Efficiency, (24).
pub fn motor_efficiency(args: &Args) -> OperationResult {
    let (speed, current) = (args.number("speed_rad_s")?, args.number("current_a")?);
    let (resistance, constant) = (args.not_negative("resistance_ohm")?, args.positive("torque_constant_nm_a")?);
    let efficiency = motor::efficiency(speed, current, resistance, constant);
    if efficiency.is_finite() {
        return Ok(json!({ "efficiency": efficiency }));
    }
    Err(SolveError::invalid("the electrical power is 0 at this speed and current, so the efficiency is undefined"))
}

/// Returns start and end, and whether they are planar.
fn ends(args: &Args) -> Result<(Vector3<f64>, Vector3<f64>, bool), SolveError> {
    let (from, planar) = args.first_point("from_m")?;
    Ok((from, args.vector("to_m", planar)?, planar))
}

/// Points, tangents and length of a parabola, (25)-(26).
pub fn parabola(args: &Args) -> OperationResult {
    let (from, to, planar) = ends(args)?;
    let path = Parabola { from, to, mu_per_m: args.number("mu_per_m")? };
    let fractions = args.numbers("u")?;
    if let Some(u) = fractions.iter().find(|u| !(0.0..=1.0).contains(*u)) {
        return Err(invalid_value("u", &u.to_string(), "fractions from 0 to 1"));
    }
    shape::check(&path)?;
    let points: Vec<_> = fractions.iter().map(|u| shape::at_fraction(&path, *u)).collect();
    Ok(json!({
        "points_m": points.iter().map(|p| point_json(&p.position, planar)).collect::<Vec<_>>(),
        "tangents_m": points.iter().map(|p| point_json(&p.tangent, planar)).collect::<Vec<_>>(),
        "length_m": shape::length_m(&path),
        "lowest_m": shape::lowest_m(&path),
        "zeta": if shape::is_vertical(&path) { Value::Null } else { json!(path.zeta()) },
    }))
}

/// Greatest sag above the ground; null for a vertical move, which has no sag.
pub fn mu_limit(args: &Args) -> OperationResult {
    let (from, to, _) = ends(args)?;
    Ok(json!({ "mu_per_m": shape::mu_limit(&from, &to, args.number("ground_m")?)? }))
}

/// Common arguments of the operations on moves.
struct Move {
    anchors: Anchors,
    from: Vector3<f64>,
    to: Vector3<f64>,
    wrench_n: Vector3<f64>,
    cable_weight_n_m: f64,
    limits_n: [f64; 2],
    method: Distribution,
    current: Box<dyn Current>,
    speed_m_s: f64,
    intervals: usize,
}

impl Move {
    fn new(args: &Args) -> Result<Self, SolveError> {
        let anchors = args.anchors()?.checked()?;
        let planar = anchors.is_planar();
        let motor = args.motor()?;
        let current: Box<dyn Current> = match args.table(motor.resistance_ohm)? {
            Some(table) => Box::new(table),
            None => Box::new(motor),
        };
        Ok(Self {
            from: args.vector("from_m", planar)?,
            to: args.vector("to_m", planar)?,
            wrench_n: wrench(args, planar)?,
            cable_weight_n_m: cable_weight_n_m(args)?,
            limits_n: args.limits()?,
            method: args.method()?,
            current,
            speed_m_s: args.number("speed_m_s")?,
            intervals: args.count("intervals")?,
            anchors,
        })
    }

    fn winch_energy(&self) -> WinchEnergy<'_> {
        WinchEnergy {
            anchors: &self.anchors,
            wrench_n: self.wrench_n,
            drag_n_s2_m2: 0.0,
            cable_weight_n_m: self.cable_weight_n_m,
            limits_n: self.limits_n,
            method: self.method,
            current: &*self.current,
        }
    }
}

/// I²R loss of a parabola at constant speed.
pub fn move_energy(args: &Args) -> OperationResult {
    let (request, mu_per_m) = (Move::new(args)?, args.number("mu_per_m")?);
    let path = Parabola { from: request.from, to: request.to, mu_per_m };
    let cost = request.winch_energy().constant_speed(&path, request.speed_m_s, request.intervals)?;
    Ok(json!({ "energy_j": cost.energy_j, "duration_s": cost.duration_s }))
}

/// The parabola with the least loss; the energy of the line is null where the cables cannot hold the node on it.
pub fn optimal_parabola(args: &Args) -> OperationResult {
    let request = Move::new(args)?;
    let bounds =
        Bounds { ground_m: args.optional("ground_m")?, time_weight_w: args.optional("time_weight_w")?.unwrap_or(0.0) };
    let best = request.winch_energy().best_parabola(
        &request.from,
        &request.to,
        request.speed_m_s,
        request.intervals,
        &bounds,
    )?;
    let energy = |cost: &Cost| cost.energy_j;
    Ok(json!({
        "mu_per_m": best.mu_per_m,
        "energy_j": energy(&best.cost),
        "duration_s": best.cost.duration_s,
        "line_energy_j": best.line.as_ref().map(energy),
        "line_duration_s": (request.to - request.from).norm() / request.speed_m_s,
    }))
}
