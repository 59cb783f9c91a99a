//! The node: a point mass with weight, drag in air or water, and elastic ground below it.

use nalgebra::Vector3;

use crate::error::{PlantError, check};

/// The node and its surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeConfig {
    /// Mass, kg; in water including the added mass.
    pub mass_kg: f64,
    /// Downward force at rest, N; `None`: mass times gravity. Zero for a floating node.
    pub net_weight_n: Option<f64>,
    /// Drag divided by squared speed, N s²/m². A box of 0.17 × 0.17 m in air: ½ · 1.2 · 1.1 · 0.03 = 0.02; a body of
    /// 0.05 m² in water: ½ · 1000 · 1.0 · 0.05 = 25.
    pub drag_n_s2_m2: f64,
    /// Height of the ground, m; `None`: no ground.
    pub ground_m: Option<f64>,
    /// Force per depth into the ground, N/m: 12 N of weight sink 0.6 mm into 20 kN/m.
    pub ground_stiffness_n_m: f64,
    /// Damping into the ground, N s/m.
    pub ground_damping_n_s_m: f64,
    /// Friction coefficient of the node on the ground.
    pub ground_friction: f64,
}

impl Default for NodeConfig {
    fn default() -> Self {
        Self {
            mass_kg: 1.2,
            net_weight_n: None,
            drag_n_s2_m2: 0.02,
            ground_m: Some(0.0),
            ground_stiffness_n_m: 20_000.0,
            ground_damping_n_s_m: 100.0,
            ground_friction: 0.5,
        }
    }
}

impl NodeConfig {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        check("mass_kg", self.mass_kg, "10 g to 1000 kg", |x| (0.01..=1000.0).contains(&x))?;
        check("net_weight_n", self.net_weight_n.unwrap_or(0.0), "a finite force", |_| true)?;
        check("drag_n_s2_m2", self.drag_n_s2_m2, "zero or more", |x| x >= 0.0)?;
        check("ground_m", self.ground_m.unwrap_or(0.0), "a finite height", |_| true)?;
        check("ground_stiffness_n_m", self.ground_stiffness_n_m, "zero to 1 MN/m", |x| (0.0..=1e6).contains(&x))?;
        check("ground_damping_n_s_m", self.ground_damping_n_s_m, "zero to 10 kN s/m", |x| (0.0..=1e4).contains(&x))?;
        check("ground_friction", self.ground_friction, "zero to two", |x| (0.0..=2.0).contains(&x))
    }

    /// Force of weight, drag and ground on a node at `position_m` moving at `velocity_m_s`, N.
    pub fn force_n(&self, position_m: Vector3<f64>, velocity_m_s: Vector3<f64>, gravity_m_s2: f64) -> Vector3<f64> {
        self.force_in_air_n(position_m, velocity_m_s, Vector3::zeros(), gravity_m_s2)
    }

    /// As [`NodeConfig::force_n`], in air that moves with `air_m_s`.
    pub fn force_in_air_n(
        &self,
        position_m: Vector3<f64>,
        velocity_m_s: Vector3<f64>,
        air_m_s: Vector3<f64>,
        gravity_m_s2: f64,
    ) -> Vector3<f64> {
        let weight_n = self.net_weight_n.unwrap_or(self.mass_kg * gravity_m_s2);
        let through_air_m_s = velocity_m_s - air_m_s;
        let drag = through_air_m_s * (-self.drag_n_s2_m2 * through_air_m_s.norm());
        Vector3::new(0.0, 0.0, -weight_n) + drag + self.ground_force_n(position_m, velocity_m_s)
    }

    fn ground_force_n(&self, position_m: Vector3<f64>, velocity_m_s: Vector3<f64>) -> Vector3<f64> {
        let depth_m = match self.ground_m {
            Some(ground_m) if position_m.z < ground_m => ground_m - position_m.z,
            _ => return Vector3::zeros(),
        };
        // The ground pushes and never pulls.
        let normal_n = (self.ground_stiffness_n_m * depth_m - self.ground_damping_n_s_m * velocity_m_s.z).max(0.0);
        // Dry friction, smoothed below a centimetre per second so that the step size need not resolve sticking.
        let sliding = Vector3::new(velocity_m_s.x, velocity_m_s.y, 0.0);
        let friction = sliding * (-self.ground_friction * normal_n / sliding.norm().max(0.01));
        Vector3::new(0.0, 0.0, normal_n) + friction
    }
}
