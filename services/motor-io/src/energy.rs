//! Electrical power and loss per cable, and their integrals. Drives report currents averaged over milliseconds, so the
//! loss does not include the heat of their ripple.

use messages::{CABLES, Energy};

/// Integrator of power and loss.
#[derive(Debug, Clone, Default)]
pub struct EnergyMeter {
    energy_j: [f64; CABLES],
    loss_j: [f64; CABLES],
}

impl EnergyMeter {
    /// Adds a cycle: `passed_s` seconds at this current (A, positive pulls the cable in), drive output (-1 to 1,
    /// positive pays out), supply voltage (V) and armature resistance (ohm).
    pub fn add(
        &mut self,
        cables: usize,
        passed_s: f64,
        resistance_ohm: f64,
        drive: impl Fn(usize) -> (f64, f64, f64),
    ) -> Energy {
        let mut energy = Energy { cable_count: cables as u8, ..Energy::default() };
        for i in 0..cables {
            let (current_a, duty, supply_v) = drive(i);
            // Current and output have opposite signs; a driven motor takes power, a dragged one returns some.
            energy.power_w[i] = -duty * supply_v * current_a;
            energy.loss_w[i] = current_a * current_a * resistance_ohm;
            self.energy_j[i] += energy.power_w[i] * passed_s;
            debug_assert!(energy.loss_w[i] >= 0.0, "cable {i} loses {} W", energy.loss_w[i]);
            self.loss_j[i] += energy.loss_w[i] * passed_s;
        }
        energy.energy_j = self.energy_j;
        energy.loss_j = self.loss_j;
        energy
    }
}
