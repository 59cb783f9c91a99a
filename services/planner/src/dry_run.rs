//! Planning of a mission without flying it.

use cable_robot::Vector3;

use crate::plan::{Plan, PlanError, PlannerConfig};
use mission::Mission;

/// Figures of a mission that may be flown.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Name of the mission.
    pub mission: String,
    /// Number of legs.
    pub legs: usize,
    /// Number of segments, each from rest to rest.
    pub segments: usize,
    /// Length of the path, m.
    pub length_m: f64,
    /// Time on the plan clock, s.
    pub duration_s: f64,
    /// Loss in the motors by their model, J; `None` where a measured table does not cover it.
    pub energy_j: Option<f64>,
    /// Position of the end, m.
    pub end_m: [f64; 3],
    /// Highest tension of any cable, N.
    pub peak_tension_n: f64,
    /// Lowest tension of any cable, N.
    pub least_tension_n: f64,
    /// Highest speed of any cable, m/s.
    pub peak_cable_speed_m_s: f64,
    /// Highest current of any motor, A.
    pub peak_current_a: f64,
    /// Highest voltage of any motor, V.
    pub peak_voltage_v: f64,
}

/// Plans and checks a whole mission that would start at `start_m` (m).
///
/// # Errors
/// The error with which the planner refuses it.
pub fn dry_run(mission: &Mission, config: &PlannerConfig, start_m: [f64; 3]) -> Result<Summary, PlanError> {
    // As if the lengths were set there.
    let robot = config.robot.with_lengths_set_at(Some(&Vector3::from(start_m)));
    let config = &PlannerConfig { robot, ..*config };
    let plan = Plan::new(mission, config, Vector3::from(start_m), 0.0, 1)?;
    let highest = |f: fn(&cable_robot::motion::Report) -> f64| plan.reports.iter().map(f).fold(0.0, f64::max);
    Ok(Summary {
        mission: mission.name.clone(),
        legs: mission.leg.len(),
        segments: plan.segments.len(),
        length_m: plan.length_m(),
        duration_s: plan.end_s(),
        energy_j: plan.energy_j(config),
        end_m: plan.end().into(),
        peak_tension_n: highest(|report| report.peak_tension_n),
        least_tension_n: plan.reports.iter().map(|report| report.least_tension_n).fold(f64::INFINITY, f64::min),
        peak_cable_speed_m_s: highest(|report| report.peak_cable_speed_m_s),
        peak_current_a: highest(|report| report.peak_current_a),
        peak_voltage_v: highest(|report| report.peak_voltage_v),
    })
}
