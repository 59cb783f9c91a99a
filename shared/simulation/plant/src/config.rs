//! Configuration of the plant, with a default and its origin for every number.

use crate::drive::DriveConfig;
use crate::drum::DrumConfig;
use crate::error::{PlantError, check};
use crate::line::{CableConfig, IdlerConfig};
use crate::motor::MotorConfig;
use crate::node::NodeConfig;
use crate::world::World;
use crate::{MAX_CABLES, STANDARD_GRAVITY};

/// Configuration of the plant: geometry, parts and initial state.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantConfig {
    /// Position at which each cable leaves its last pulley, m, z up; 1 to 8 of them.
    pub anchors_m: Vec<[f64; 3]>,
    /// Whether the node is kept in the plane y = 0, by a keel in the current or by anchors on two banks.
    pub planar: bool,
    /// Cable between drum and anchor, m, one per cable; it stretches too.
    pub routed_length_m: Vec<f64>,
    /// The node.
    pub node: NodeConfig,
    /// The cables.
    pub line: CableConfig,
    /// The idlers and their encoders, one per cable.
    pub idlers: Vec<IdlerConfig>,
    /// The second encoders, one per cable: on the motor, with counts per metre of the bare drum, where the first one is
    /// on an idler, and on an idler where the first one counts turns; none: those of the default idler.
    pub second_encoders: Vec<IdlerConfig>,
    /// The drums.
    pub drum: DrumConfig,
    /// The motors with their gears.
    pub motor: MotorConfig,
    /// The speed loops of the drives.
    pub drive: DriveConfig,
    /// Open-circuit voltage of the supply, V.
    pub supply_v: f64,
    /// Inner resistance of the supply and its wiring, ohm, common to all motors.
    pub supply_resistance_ohm: f64,
    /// Acceleration of gravity, m/s².
    pub gravity_m_s2: f64,
    /// Position of the node at rest at time zero, m.
    pub start_m: [f64; 3],
    /// Tensions at the start, N, one per cable; `None`: the least-norm ones within `start_limits_n`.
    pub start_tensions_n: Option<Vec<f64>>,
    /// Smallest and largest tension at the start, N.
    pub start_limits_n: [f64; 2],
    /// Largest integration step, s; stiff cables on a light node reduce it automatically. The fastest mode of a typical
    /// plant (a rigid cable of 3 m on a node of 1 kg) is near 250 rad/s and the speed loop runs at 300 Hz; a quarter of
    /// a millisecond resolves both.
    pub substep_s: f64,
    /// Seed of the winding irregularities of the drums, and of the gusts.
    pub seed: u64,
    /// What a real robot has and its model leaves out.
    pub world: World,
}

impl PlantConfig {
    /// A plant with these anchors, the node at rest at `start_m` and defaults for all else (6 m routed per cable).
    pub fn new(anchors_m: Vec<[f64; 3]>, start_m: [f64; 3]) -> Self {
        Self {
            routed_length_m: vec![6.0; anchors_m.len()],
            idlers: vec![IdlerConfig::default(); anchors_m.len()],
            second_encoders: Vec::new(),
            anchors_m,
            planar: false,
            node: NodeConfig::default(),
            line: CableConfig::default(),
            drum: DrumConfig::default(),
            motor: MotorConfig::default(),
            drive: DriveConfig::default(),
            supply_v: 24.0,
            supply_resistance_ohm: 0.05,
            gravity_m_s2: STANDARD_GRAVITY,
            start_m,
            start_tensions_n: None,
            start_limits_n: [0.5, 1000.0],
            substep_s: 0.000_25,
            seed: 1,
            world: World::default(),
        }
    }

    /// Number of cables.
    pub fn cable_count(&self) -> usize {
        self.anchors_m.len()
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The first wrong field, with its accepted values.
    pub fn validate(&self) -> Result<(), PlantError> {
        let n = self.cable_count();
        if !(1..=MAX_CABLES).contains(&n) {
            return Err(PlantError::Anchors(n));
        }
        if self.routed_length_m.len() != n {
            return Err(PlantError::Count { key: "routed_length_m", found: self.routed_length_m.len(), expected: n });
        }
        if self.idlers.len() != n {
            return Err(PlantError::Count { key: "idlers", found: self.idlers.len(), expected: n });
        }
        if !(self.second_encoders.is_empty() || self.second_encoders.len() == n) {
            let found = self.second_encoders.len();
            return Err(PlantError::Count { key: "second_encoders", found, expected: n });
        }
        if let Some(tensions) = &self.start_tensions_n {
            if tensions.len() != n {
                return Err(PlantError::Count { key: "start_tensions_n", found: tensions.len(), expected: n });
            }
            for &tension in tensions {
                check("start_tensions_n", tension, "zero or more newtons", |t| t >= 0.0)?;
            }
        }
        for &coordinate in self.anchors_m.iter().flatten() {
            check("anchors_m", coordinate, "within 1000 m of the origin", |x| x.abs() <= 1000.0)?;
        }
        for &coordinate in &self.start_m {
            check("start_m", coordinate, "within 1000 m of the origin", |x| x.abs() <= 1000.0)?;
        }
        if self.planar {
            for point in self.anchors_m.iter().chain([&self.start_m]) {
                check("the y of a planar plant", point[1], "zero", |y| y == 0.0)?;
            }
        }
        for &routed in &self.routed_length_m {
            check("routed_length_m", routed, "zero to 1000 m", |x| (0.0..=1000.0).contains(&x))?;
        }
        check("start_limits_n", self.start_limits_n[0], "zero or more newtons", |x| x >= 0.0)?;
        let low = self.start_limits_n[0];
        check("start_limits_n", self.start_limits_n[1], "more than the lower limit", |x| x > low)?;
        check("supply_v", self.supply_v, "zero to 100 V", |x| (0.0..=100.0).contains(&x))?;
        check("supply_resistance_ohm", self.supply_resistance_ohm, "zero or more ohms", |x| x >= 0.0)?;
        check("gravity_m_s2", self.gravity_m_s2, "zero to 100 m/s²", |x| (0.0..=100.0).contains(&x))?;
        check("substep_s", self.substep_s, "1 µs to 1 ms", |x| (1e-6..=1e-3).contains(&x))?;
        self.node.validate()?;
        self.line.validate()?;
        for idler in self.idlers.iter().chain(&self.second_encoders) {
            idler.validate()?;
        }
        self.drum.validate()?;
        self.motor.validate()?;
        self.world.validate(n)?;
        self.drive.validate()
    }
}
