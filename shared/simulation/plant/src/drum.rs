//! A drum whose radius grows with every layer of cable wound on it.

use crate::error::{PlantError, check};

/// Number of layers in the table of a drum; more cable stays on the last one.
const LAYERS: usize = 32;

/// Each layer sinks into the grooves of the one below: for round cable in a hexagonal arrangement it rises by
/// √3/2 = 0.87 diameters.
const RISE_PER_DIAMETER: f64 = 0.87;

/// Geometry of the drums.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrumConfig {
    /// Radius to the middle of the cable on the bare drum, m.
    pub radius_m: f64,
    /// Diameter of the cable, m.
    pub line_diameter_m: f64,
    /// Turns in one layer: a 40 mm drum with a pitch of 1.2 diameters has 117 of 0.285 mm.
    pub turns_per_layer: f64,
    /// Cable on the drum when nothing is paid out, m.
    pub capacity_m: f64,
    /// Winding irregularity relative to the diameter of the cable: the largest radius error of each turn.
    pub lay_noise: f64,
}

impl Default for DrumConfig {
    fn default() -> Self {
        Self { radius_m: 0.020, line_diameter_m: 0.000_285, turns_per_layer: 117.0, capacity_m: 40.0, lay_noise: 0.25 }
    }
}

impl DrumConfig {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        check("radius_m", self.radius_m, "more than zero and at most 1 m", |x| x > 0.0 && x <= 1.0)?;
        let radius = self.radius_m;
        check("line_diameter_m", self.line_diameter_m, "zero to the drum's radius", |x| (0.0..=radius).contains(&x))?;
        check("turns_per_layer", self.turns_per_layer, "one or more", |x| x >= 1.0)?;
        check("capacity_m", self.capacity_m, "more than zero", |x| x > 0.0)?;
        check("lay_noise", self.lay_noise, "zero to one", |x| (0.0..=1.0).contains(&x))
    }
}

/// One drum.
#[derive(Debug, Clone, PartialEq)]
pub struct Drum {
    config: DrumConfig,
    seed: u64,
    /// Wound cable at the beginning of each layer, m.
    layer_starts_m: [f64; LAYERS],
}

impl Drum {
    /// A drum; `seed` selects its winding irregularities.
    pub fn new(config: DrumConfig, seed: u64) -> Self {
        let mut layer_starts_m = [0.0; LAYERS];
        for layer in 1..LAYERS {
            let radius = layer_radius(&config, layer - 1);
            layer_starts_m[layer] =
                layer_starts_m[layer - 1] + 2.0 * core::f64::consts::PI * radius * config.turns_per_layer;
        }
        Self { config, seed, layer_starts_m }
    }

    /// Ratio of the effective radius to the bare one with `paid_out_m` of cable off the drum.
    pub fn radius_ratio(&self, paid_out_m: f64) -> f64 {
        let wound_m = (self.config.capacity_m - paid_out_m).max(0.0);
        let layer = self.layer_starts_m.partition_point(|&start| start <= wound_m).saturating_sub(1);
        let turn_m = 2.0 * core::f64::consts::PI * layer_radius(&self.config, layer);
        let turns = (wound_m - self.layer_starts_m[layer]) / turn_m;
        // The cable climbs onto a new layer during its first turn; otherwise the speed would jump.
        let climb = if layer == 0 { 1.0 } else { turns.min(1.0) };
        let below = layer_radius(&self.config, layer.saturating_sub(1));
        let radius = below + (layer_radius(&self.config, layer) - below) * climb;
        let turn = layer as f64 * self.config.turns_per_layer + turns;
        let here = noise(self.seed, turn as u64);
        let next = noise(self.seed, turn as u64 + 1);
        let lay = here + (next - here) * turn.fract();
        (radius + lay * self.config.lay_noise * self.config.line_diameter_m) / self.config.radius_m
    }
}

fn layer_radius(config: &DrumConfig, layer: usize) -> f64 {
    config.radius_m + RISE_PER_DIAMETER * config.line_diameter_m * layer as f64
}

/// A number in [-1, 1] that depends only on its arguments (the finaliser of splitmix64).
fn noise(seed: u64, turn: u64) -> f64 {
    let mut z = seed.wrapping_add(turn.wrapping_mul(0x9E37_79B9_7F4A_7C15));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_layer_adds_the_documented_share() {
        let config = DrumConfig { lay_noise: 0.0, ..DrumConfig::default() };
        let drum = Drum::new(config, 1);
        let first = drum.radius_ratio(config.capacity_m - 5.0);
        let second = drum.radius_ratio(config.capacity_m - 20.0);
        assert_eq!(first, 1.0);
        assert!((second - 1.0124).abs() < 1e-4, "{second}");
    }

    #[test]
    fn the_radius_has_no_jump() {
        let config = DrumConfig::default();
        let drum = Drum::new(config, 7);
        let mut last = drum.radius_ratio(0.0);
        for i in 1..40_000 {
            let ratio = drum.radius_ratio(f64::from(i) * 0.001);
            assert!((ratio - last).abs() < 2e-4, "at {i} mm: {last} {ratio}");
            assert!((0.98..1.08).contains(&ratio));
            last = ratio;
        }
    }
}
