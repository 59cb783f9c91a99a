//! An elastic cable that cannot push, and the idler that measures it.
//!
//! `U` is the unstretched cable off the drum, `L` the distance from anchor to node and `L_x` the routed part between
//! drum and anchor. The tension is `EA ((L + L_x) / U - 1)` plus a little damping, and never below zero.
//!
//! The idler is next to the drum and turns with the cable that passes over it. While the cable is taut, this is all
//! cable that leaves the drum. A slack cable stops the idler: the cable that the drum then pays out forms a loose loop
//! between the two, which has to be wound up (or pulled out by the node) before the idler follows the drum again.
//! Therefore a drive whose speed loop uses the idler runs away with a broken cable.

use crate::error::{PlantError, check};

/// Material of the cables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableConfig {
    /// Axial stiffness EA, N. A braided 0.33 mm cable has 4 to 8 kN; 100 kN approximates a rigid cable.
    pub stiffness_n: f64,
    /// Kelvin-Voigt damping time (damping over stiffness), s. 2 ms damps a mode of 30 rad/s by 3 % of critical, a
    /// typical value of braided cable.
    pub damping_s: f64,
}

/// Stiffness that approximates a cable without stretch, N: 10 N on 12 m give 1.2 mm.
pub const RIGID_STIFFNESS_N: f64 = 100_000.0;

impl Default for CableConfig {
    fn default() -> Self {
        Self { stiffness_n: 6000.0, damping_s: 0.002 }
    }
}

impl CableConfig {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        check("stiffness_n", self.stiffness_n, "100 N to 10 MN", |x| (100.0..=1e7).contains(&x))?;
        check("damping_s", self.damping_s, "zero to 0.1 s", |x| (0.0..=0.1).contains(&x))
    }

    /// Unstretched length of a cable of stretched length `stretched_m` under `tension_n`, m.
    pub fn unstretched_m(&self, stretched_m: f64, tension_n: f64) -> f64 {
        stretched_m / (1.0 + tension_n / self.stiffness_n)
    }

    /// Tension of `unstretched_m` of cable stretched to `stretched_m`, both changing at the given rates,
    /// N; never negative.
    pub fn tension_n(&self, stretched_m: f64, unstretched_m: f64, stretched_m_s: f64, unstretched_m_s: f64) -> f64 {
        let strain = stretched_m / unstretched_m - 1.0;
        if strain <= 0.0 {
            return 0.0;
        }
        let strain_rate = (stretched_m_s - unstretched_m_s * stretched_m / unstretched_m) / unstretched_m;
        (self.stiffness_n * (strain + self.damping_s * strain_rate)).max(0.0)
    }
}

/// The idler and its encoder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdlerConfig {
    /// Encoder steps per metre of cable. 4096 per turn on a wheel of 15 mm radius: 43 460.
    pub counts_per_m: f64,
    /// Share of the cable's motion that slips over the wheel; 0.0001 to 0.005 for real idlers.
    pub slip: f64,
}

impl Default for IdlerConfig {
    fn default() -> Self {
        Self { counts_per_m: 43_460.0, slip: 0.0 }
    }
}

impl IdlerConfig {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        check("counts_per_m", self.counts_per_m, "1 to 10 million per metre", |x| (1.0..=1e7).contains(&x))?;
        check("slip", self.slip, "zero to one", |x| (0.0..=1.0).contains(&x))
    }
}

/// The idler of one cable.
#[derive(Debug, Clone, PartialEq)]
pub struct Idler {
    counts_per_m: f64,
    /// Share of the motion that is not counted.
    pub(crate) slip: f64,
    /// Whether the encoder has stopped counting.
    pub(crate) dead: bool,
    /// Length on the wheel of a metre of unstretched cable, m: 1 if the idler counts unstretched cable.
    pub(crate) stretch: f64,
    /// Cable that has passed the idler, m, unstretched.
    passed_m: f64,
    /// Rotation of the wheel since the start, m.
    turned_m: f64,
    offset_counts: i64,
}

impl Idler {
    /// An idler next to a drum with `paid_out_m` paid out; the encoder starts at zero and has `scale` times the
    /// configured counts.
    pub fn new(config: IdlerConfig, scale: f64, paid_out_m: f64) -> Self {
        Self {
            counts_per_m: config.counts_per_m * scale,
            slip: config.slip,
            dead: false,
            stretch: 1.0,
            passed_m: paid_out_m,
            turned_m: 0.0,
            offset_counts: 0,
        }
    }

    /// Sets the cable off the drum without turning the wheel.
    pub(crate) fn restart(&mut self, paid_out_m: f64) {
        self.passed_m = paid_out_m;
    }

    /// Updates the idler: `paid_out_m` is off the drum, `stretched_m` is the distance from the drum to the node along
    /// the cable (m), or zero if nothing pulls on the far end.
    pub fn follow(&mut self, paid_out_m: f64, stretched_m: f64) {
        let passed_m = self.passed_m.max(stretched_m).min(paid_out_m);
        if !self.dead {
            self.turned_m += (passed_m - self.passed_m) * (1.0 - self.slip) * self.stretch;
        }
        self.passed_m = passed_m;
    }

    /// Updates an encoder on the motor: the bare drum would have paid out `bare_m`.
    pub(crate) fn turn(&mut self, bare_m: f64) {
        if !self.dead {
            self.turned_m += bare_m;
        }
    }

    /// Encoder count; it increases as cable is paid out.
    pub fn counts(&self) -> i64 {
        (self.turned_m * self.counts_per_m).floor() as i64 + self.offset_counts
    }

    /// Makes the encoder jump by `counts`.
    pub fn jump(&mut self, counts: i64) {
        self.offset_counts += counts;
    }

    /// Loose cable between drum and idler, m.
    pub fn loose_m(&self, paid_out_m: f64) -> f64 {
        paid_out_m - self.passed_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tension_and_unstretched_length_are_inverse() {
        let line = CableConfig::default();
        let unstretched = line.unstretched_m(12.0, 17.0);
        assert!((line.tension_n(12.0, unstretched, 0.0, 0.0) - 17.0).abs() < 1e-9);
        assert_eq!(line.tension_n(11.9, 12.0, 5.0, 0.0), 0.0);
    }

    #[test]
    fn a_taut_line_turns_the_idler_and_a_slack_one_does_not() {
        let config = IdlerConfig { counts_per_m: 1024.0, slip: 0.0 };
        let mut idler = Idler::new(config, 1.0, 10.0);
        idler.follow(10.5, 10.625);
        assert_eq!(idler.counts(), 512);
        // The node no longer takes up the cable: it collects between drum and idler.
        idler.follow(11.5, 10.625);
        assert_eq!(idler.counts(), 640);
        assert_eq!(idler.loose_m(11.5), 0.875);
        // The node pulls some of it out.
        idler.follow(11.5, 11.0);
        assert_eq!(idler.counts(), 1024);
        // Winding takes up the loose part first.
        idler.follow(11.0, 11.0);
        assert_eq!(idler.counts(), 1024);
        idler.follow(10.0, 11.0);
        assert_eq!(idler.counts(), 0);
    }

    #[test]
    fn slip_jump_and_failure_change_the_counts() {
        let config = IdlerConfig { counts_per_m: 1000.0, slip: 0.5 };
        let mut idler = Idler::new(config, 1.0, 1.0);
        idler.follow(2.0, 3.0);
        assert_eq!(idler.counts(), 500);
        idler.jump(-70);
        assert_eq!(idler.counts(), 430);
        idler.dead = true;
        idler.follow(2.5, 3.0);
        assert_eq!(idler.counts(), 430);
    }
}
