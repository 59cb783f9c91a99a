//! `[motor_box.truth]`: in what the world differs from the robot file and from `[motor_box]`.
//!
//! docs/truth.md has unit, source and default of every key.

use super::guide::TrueGuide;
use super::per_cable::PerCable;
use config::{Points, Problem, RobotFile, number};
use serde::{Deserialize, Serialize};

/// `[motor_box.truth]`. A key that is left out has the value that the robot assumes, or no effect.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct TruthSection {
    /// Name of the world, for reports.
    pub name: Option<String>,
    /// Seed of the winding on the drums and of the gusts.
    pub seed: Option<u64>,
    /// Where the cables leave for the node, or enter their wheels, m.
    pub anchors_m: Option<Points>,
    /// What the cables leave from.
    pub pulley: Option<TrueGuide>,
    /// Radius of the wheels to the middle of the cable, m.
    pub pulley_radius_m: Option<PerCable>,
    /// Direction of the centres of fixed wheels from their anchors, from x towards y, degrees.
    pub pulley_azimuth_deg: Option<PerCable>,
    /// Share of the tension that the pulleys take.
    pub pulley_friction: Option<PerCable>,
    /// Encoder counts per metre of cable.
    pub counts_per_m: Option<PerCable>,
    /// Share of the cable's motion that slips over the idler.
    pub slip: Option<PerCable>,
    /// Whether each idler counts the cable as stretched as it passes.
    pub counts_stretched: Option<Vec<bool>>,
    /// Mass of the node, kg.
    pub node_mass_kg: Option<f64>,
    /// Downward force of the node at rest, N.
    pub net_weight_n: Option<f64>,
    /// Where each cable is tied, relative to the node, m.
    #[serde(deserialize_with = "config::each_exactly_if_given")]
    pub attachments_m: Option<Vec<[f64; 3]>>,
    /// Drag of the node, N s²/m².
    pub drag_n_s2_m2: Option<f64>,
    /// Stiffness EA of the cables, N.
    pub stiffness_n: Option<PerCable>,
    /// Mass of the dry cables, kg/m.
    pub line_mass_kg_m: Option<PerCable>,
    /// Mass of the wet cables, kg/m.
    pub line_wet_mass_kg_m: Option<PerCable>,
    /// 0 for dry cables, 1 for wet ones.
    pub wetness: f64,
    /// Thermal expansion of the cables, 1/K.
    pub thermal_expansion_per_k: Option<PerCable>,
    /// Cable between drum and pulley, m.
    pub routed_length_m: Option<PerCable>,
    /// Radius of the empty drums, m.
    pub drum_radius_m: Option<PerCable>,
    /// Play of the gears at the drum, m of cable.
    pub backlash_m: Option<PerCable>,
    /// Excess of the motors' break-away friction over the friction in motion.
    pub stiction: Option<PerCable>,
    /// Friction of the gears that grows with the load.
    pub gear_friction: Option<PerCable>,
    /// Friction of the motors that does not depend on load or speed, N.
    pub coulomb_n: Option<PerCable>,
    /// Viscous friction of the motors, N s/m.
    pub viscous_n_s_m: Option<PerCable>,
    /// Tension per ampere, N/A.
    pub force_constant_n_a: Option<PerCable>,
    /// Resistance of the armatures, ohm.
    pub resistance_ohm: Option<PerCable>,
    /// Change of the temperature since the start, K.
    pub warming_k: f64,
    /// Time in which the temperature changes, s.
    pub warming_s: f64,
    /// Horizontal stiffness of the poles at the anchors, N/m.
    pub pole_stiffness_n_m: Option<PerCable>,
    /// Mean velocity of the air along x and y, m/s.
    #[serde(deserialize_with = "config::exactly")]
    pub wind_m_s: [f64; 2],
    /// Standard deviation of the gusts, m/s.
    pub gust_m_s: f64,
    /// Length scale of the gusts, m.
    pub gust_length_m: Option<f64>,
    /// Distance from the point where the cables meet to the centre of mass of the body that swings below, m.
    pub pendulum_m: f64,
    /// Damping of this swing relative to critical.
    pub pendulum_damping: Option<f64>,
    /// Height of the ground, m.
    pub ground_m: Option<f64>,
}

impl TruthSection {
    pub(super) fn check(&self, robot: &RobotFile) -> Result<(), Problem> {
        let cables = robot.robot.anchors_m.len();
        self.check_geometry(robot)?;
        let per_cable: [Rule<'_, &Option<PerCable>>; 18] = [
            ("pulley_radius_m", &self.pulley_radius_m, "0 to 1 m", |v| (0.0..=1.0).contains(&v)),
            ("pulley_azimuth_deg", &self.pulley_azimuth_deg, "-360 to 360 degrees", |v| v.abs() <= 360.0),
            ("pulley_friction", &self.pulley_friction, "0 to 0.5", |v| (0.0..=0.5).contains(&v)),
            ("slip", &self.slip, "0 to 1", |v| (0.0..=1.0).contains(&v)),
            ("stiffness_n", &self.stiffness_n, "100 to 1e7 N", |v| (100.0..=1e7).contains(&v)),
            ("line_mass_kg_m", &self.line_mass_kg_m, "0 to 1 kg/m", |v| (0.0..=1.0).contains(&v)),
            ("line_wet_mass_kg_m", &self.line_wet_mass_kg_m, "0 to 1 kg/m", |v| (0.0..=1.0).contains(&v)),
            ("thermal_expansion_per_k", &self.thermal_expansion_per_k, "within 0.001 per K", |v| v.abs() <= 1e-3),
            ("routed_length_m", &self.routed_length_m, "0 to 1000 m", |v| (0.0..=1000.0).contains(&v)),
            ("drum_radius_m", &self.drum_radius_m, "0.001 to 1 m", |v| (0.001..=1.0).contains(&v)),
            ("backlash_m", &self.backlash_m, "0 to 0.1 m", |v| (0.0..=0.1).contains(&v)),
            ("stiction", &self.stiction, "0 to 2", |v| (0.0..=2.0).contains(&v)),
            ("gear_friction", &self.gear_friction, "0 to 10", |v| (0.0..=10.0).contains(&v)),
            ("coulomb_n", &self.coulomb_n, "0 to 1000 N", |v| (0.0..=1000.0).contains(&v)),
            ("viscous_n_s_m", &self.viscous_n_s_m, "0 to 1e5 N s/m", |v| (0.0..=1e5).contains(&v)),
            ("force_constant_n_a", &self.force_constant_n_a, "0.01 to 1e4 N/A", |v| (0.01..=1e4).contains(&v)),
            ("resistance_ohm", &self.resistance_ohm, "0.001 to 1000 ohm", |v| (0.001..=1000.0).contains(&v)),
            ("pole_stiffness_n_m", &self.pole_stiffness_n_m, "500 to 1e9 N/m", |v| (500.0..=1e9).contains(&v)),
        ];
        for (name, given, accepted, ok) in per_cable {
            check_per_cable(name, given.as_ref(), cables, accepted, ok)?;
        }
        self.check_surroundings()
    }

    fn check_geometry(&self, robot: &RobotFile) -> Result<(), Problem> {
        let cables = robot.robot.anchors_m.len();
        let counted = |name: &str, found: Option<usize>| match found {
            Some(found) if found != cables => Err(Problem::with_clause(
                key(name),
                format!("has {found} values for {cables} cables; accepted: one value per cable"),
            )),
            _ => Ok(()),
        };
        counted("anchors_m", self.anchors_m.as_ref().map(|points| points.len()))?;
        counted("counts_stretched", self.counts_stretched.as_ref().map(Vec::len))?;
        counted("attachments_m", self.attachments_m.as_ref().map(Vec::len))?;
        if let Some(anchors) = &self.anchors_m {
            if anchors.is_planar() != robot.robot.anchors_m.is_planar() {
                let clause = "has points of another kind than the robot; accepted: as `anchors_m` in the robot file";
                return Err(Problem::with_clause(key("anchors_m"), clause));
            }
            for &value in anchors.iter().flatten() {
                number(&key("anchors_m"), value, "within 1000 m", |v| v.abs() <= 1000.0)?;
            }
        }
        for &value in self.attachments_m.iter().flatten().flatten() {
            number(&key("attachments_m"), value, "within 2 m", |v| v.abs() <= 2.0)?;
        }
        Ok(())
    }

    fn check_surroundings(&self) -> Result<(), Problem> {
        let all: [Rule<'_, Option<f64>>; 13] = [
            ("node_mass_kg", self.node_mass_kg, "0.01 to 1000 kg", |v| (0.01..=1000.0).contains(&v)),
            ("net_weight_n", self.net_weight_n, "within 1e4 N", |v| v.abs() <= 1e4),
            ("drag_n_s2_m2", self.drag_n_s2_m2, "0 to 1e4 N s²/m²", |v| (0.0..=1e4).contains(&v)),
            ("wetness", Some(self.wetness), "0 to 1", |v| (0.0..=1.0).contains(&v)),
            ("warming_k", Some(self.warming_k), "within 100 K", |v| v.abs() <= 100.0),
            ("warming_s", Some(self.warming_s), "0 to 1e6 s", |v| (0.0..=1e6).contains(&v)),
            ("wind_m_s", Some(self.wind_m_s[0]), "within 60 m/s", |v| v.abs() <= 60.0),
            ("wind_m_s", Some(self.wind_m_s[1]), "within 60 m/s", |v| v.abs() <= 60.0),
            ("gust_m_s", Some(self.gust_m_s), "0 to 30 m/s", |v| (0.0..=30.0).contains(&v)),
            ("gust_length_m", self.gust_length_m, "0.1 to 1000 m", |v| (0.1..=1000.0).contains(&v)),
            ("pendulum_m", Some(self.pendulum_m), "0 to 10 m", |v| (0.0..=10.0).contains(&v)),
            ("pendulum_damping", self.pendulum_damping, "0 to 1", |v| (0.0..=1.0).contains(&v)),
            ("ground_m", self.ground_m, "within 1000 m", |v| v.abs() <= 1000.0),
        ];
        for (name, value, accepted, ok) in all {
            value.map_or(Ok(()), |value| number(&key(name), value, accepted, ok))?;
        }
        Ok(())
    }

    /// Checks `counts_per_m` against the counts that the software assumes: a world in which they differ by a factor is
    /// a mistake.
    pub(super) fn check_counts(&self, assumed: &[f64]) -> Result<(), Problem> {
        let Some(counts) = &self.counts_per_m else { return Ok(()) };
        check_per_cable("counts_per_m", Some(counts), assumed.len(), "more than 0", |v| v > 0.0)?;
        for (cable, &assumed) in assumed.iter().enumerate() {
            let (low, high) = (0.5 * assumed.abs(), 2.0 * assumed.abs());
            let accepted = format!("{low} to {high}, half to twice that of [motor_io]");
            number(&key("counts_per_m"), counts.at(cable), &accepted, |v| (low..=high).contains(&v))?;
        }
        Ok(())
    }
}

/// A key, its value, what is accepted in words and as a condition.
type Rule<'a, T> = (&'a str, T, &'a str, fn(f64) -> bool);

fn key(name: &str) -> String {
    format!("motor_box.truth.{name}")
}

fn check_per_cable(
    name: &str,
    given: Option<&PerCable>,
    cables: usize,
    accepted: &str,
    ok: fn(f64) -> bool,
) -> Result<(), Problem> {
    let Some(given) = given else { return Ok(()) };
    if let PerCable::Each(values) = given
        && values.len() != cables
    {
        let clause = format!("has {} values for {cables} cables; accepted: a number, or one per cable", values.len());
        return Err(Problem::with_clause(key(name), clause));
    }
    given.values().iter().try_for_each(|&value| number(&key(name), value, accepted, ok))
}
