//! What a real robot has and its model leaves out. The default is a world without any of it.

use crate::drum::DrumConfig;
use crate::error::{PlantError, check};
use crate::line::CableConfig;
use crate::motor::MotorConfig;
use crate::pulley::Guide;

/// Everything in which the world may differ from the model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct World {
    /// One per cable; none: every cable has the defaults.
    pub cables: Vec<CableWorld>,
    /// Wind.
    pub wind: Wind,
    /// Change of the temperature since the start.
    pub warming: Warming,
    /// Swing of the node below the point where the cables meet.
    pub pendulum: Pendulum,
}

/// One cable with its winch.
#[derive(Debug, Clone, PartialEq)]
pub struct CableWorld {
    /// Motor and gear; `None`: those of the plant.
    pub motor: Option<MotorConfig>,
    /// Material; `None`: that of the plant.
    pub line: Option<CableConfig>,
    /// Drum; `None`: that of the plant.
    pub drum: Option<DrumConfig>,
    /// What the cable leaves from.
    pub guide: Guide,
    /// Share of the tension that the pulleys take between drum and node, against the motion.
    pub pulley_friction: f64,
    /// Counts of the encoder relative to those of the configured idler.
    pub count_scale: f64,
    /// The same of the second encoder.
    pub second_scale: f64,
    /// Whether the idler counts the cable as stretched as it passes, instead of its unstretched length.
    pub counts_stretched: bool,
    /// Whether the encoder is on the motor and counts turns of the bare drum, instead of cable.
    pub counts_turns: bool,
    /// Where the cable is tied, relative to the node's position, m.
    pub attachment_m: [f64; 3],
    /// Mass of the cable, kg/m.
    pub mass_kg_m: f64,
    /// Thermal expansion, 1/K.
    pub expansion_per_k: f64,
    /// Horizontal stiffness of the pole at the anchor, N/m; infinity: rigid.
    pub pole_stiffness_n_m: f64,
    /// Play of the gear at the drum, m of cable.
    pub backlash_m: f64,
}

impl Default for CableWorld {
    fn default() -> Self {
        Self {
            motor: None,
            line: None,
            drum: None,
            guide: Guide::Eye,
            pulley_friction: 0.0,
            count_scale: 1.0,
            second_scale: 1.0,
            counts_stretched: false,
            counts_turns: false,
            attachment_m: [0.0; 3],
            mass_kg_m: 0.0,
            expansion_per_k: 0.0,
            pole_stiffness_n_m: f64::INFINITY,
            backlash_m: 0.0,
        }
    }
}

/// Wind on node and cables: a mean, and gusts with the longitudinal spectrum of Dryden's model of turbulence, which is
/// that of a first-order process with the time constant `gust_length_m` / speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wind {
    /// Mean velocity of the air, m/s.
    pub mean_m_s: [f64; 3],
    /// Standard deviation of the gusts along the mean wind, m/s; half of it across.
    pub gust_m_s: f64,
    /// Length scale of the gusts, m.
    pub gust_length_m: f64,
    /// Drag of a cable of 1 m length and 1 m diameter in a wind across it of 1 m/s, N. Half the density of air (1.2
    /// kg/m³) times the drag coefficient of a smooth cylinder (1.1): 0.66.
    pub cable_drag_n: f64,
}

impl Default for Wind {
    fn default() -> Self {
        Self { mean_m_s: [0.0; 3], gust_m_s: 0.0, gust_length_m: 30.0, cable_drag_n: 0.66 }
    }
}

impl Wind {
    /// Whether the air never moves.
    pub fn is_calm(&self) -> bool {
        self.mean_m_s == [0.0; 3] && self.gust_m_s == 0.0
    }
}

/// The temperature changes evenly by `change_k` over `over_s` and then stays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Warming {
    /// Change from the start, when the cables have their nominal lengths, K.
    pub change_k: f64,
    /// Duration of the change, s; 0: changed from the start on.
    pub over_s: f64,
}

impl Warming {
    /// Change of the temperature at a time after the start, K.
    pub fn at_k(&self, time_s: f64) -> f64 {
        if time_s >= self.over_s { self.change_k } else { self.change_k * time_s / self.over_s }
    }
}

/// A body that hangs below the point where the cables meet and swings there. It does not act back on the cables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pendulum {
    /// Distance from that point to the body's centre of mass, m; 0: no swing.
    pub length_m: f64,
    /// Damping relative to critical.
    pub damping: f64,
}

impl Default for Pendulum {
    fn default() -> Self {
        Self { length_m: 0.0, damping: 0.02 }
    }
}

impl World {
    /// Checks every number, for a plant with `count` cables.
    ///
    /// # Errors
    /// The first wrong field, with its accepted values.
    pub(crate) fn validate(&self, count: usize) -> Result<(), PlantError> {
        if !self.cables.is_empty() && self.cables.len() != count {
            return Err(PlantError::Count { key: "world.cables", found: self.cables.len(), expected: count });
        }
        self.cables.iter().try_for_each(CableWorld::validate)?;
        for &speed in &self.wind.mean_m_s {
            check("mean_m_s", speed, "within 60 m/s", |v| v.abs() <= 60.0)?;
        }
        check("gust_m_s", self.wind.gust_m_s, "zero to 30 m/s", |v| (0.0..=30.0).contains(&v))?;
        check("gust_length_m", self.wind.gust_length_m, "0.1 to 1000 m", |v| (0.1..=1000.0).contains(&v))?;
        check("cable_drag_n", self.wind.cable_drag_n, "zero to 1000 N", |v| (0.0..=1000.0).contains(&v))?;
        check("change_k", self.warming.change_k, "within 100 K", |v| v.abs() <= 100.0)?;
        check("over_s", self.warming.over_s, "zero to 1e6 s", |v| (0.0..=1e6).contains(&v))?;
        check("length_m", self.pendulum.length_m, "zero to 10 m", |v| (0.0..=10.0).contains(&v))?;
        check("damping", self.pendulum.damping, "zero to one", |v| (0.0..=1.0).contains(&v))
    }

    /// The world of one cable.
    pub fn cable(&self, index: usize) -> CableWorld {
        self.cables.get(index).cloned().unwrap_or_default()
    }
}

impl CableWorld {
    fn validate(&self) -> Result<(), PlantError> {
        self.motor.map_or(Ok(()), |motor| motor.validate())?;
        self.line.map_or(Ok(()), |line| line.validate())?;
        self.drum.map_or(Ok(()), |drum| drum.validate())?;
        self.guide.validate()?;
        check("pulley_friction", self.pulley_friction, "zero to 0.5", |v| (0.0..=0.5).contains(&v))?;
        check("count_scale", self.count_scale, "0.5 to 2", |v| (0.5..=2.0).contains(&v))?;
        check("second_scale", self.second_scale, "0.5 to 2", |v| (0.5..=2.0).contains(&v))?;
        for &offset in &self.attachment_m {
            check("attachment_m", offset, "within 2 m", |v| v.abs() <= 2.0)?;
        }
        check("mass_kg_m", self.mass_kg_m, "zero to 1 kg/m", |v| (0.0..=1.0).contains(&v))?;
        check("expansion_per_k", self.expansion_per_k, "within 0.001 per K", |v| v.abs() <= 1e-3)?;
        if self.pole_stiffness_n_m < f64::INFINITY {
            check("pole_stiffness_n_m", self.pole_stiffness_n_m, "500 N/m or more", |v| v >= 500.0)?;
        }
        check("backlash_m", self.backlash_m, "zero to 0.1 m", |v| (0.0..=0.1).contains(&v))
    }
}
