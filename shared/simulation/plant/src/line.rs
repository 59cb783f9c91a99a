//! An elastic line that cannot push, and the idler that measures it.
//!
//! `U` is the unstretched line off the drum, `L` the distance from anchor to node and `L_x` the routed part between
//! drum and anchor. The tension is `EA ((L + L_x) / U - 1)` plus a little damping, and never below zero.
//!
//! The idler sits beside the drum and turns with the line that passes over it. While the line is taut that is all line
//! that leaves the drum. A slack line stops the idler: what the drum pays out then gathers in a loose loop between the
//! two, and has to be wound up (or drawn out by the node) before the idler follows the drum again. This is why a drive
//! that closes its speed loop on the idler runs away on a broken line.

use crate::error::{PlantError, check};

/// What the lines are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineConfig {
    /// Axial stiffness EA, N. A braided 0.33 mm line has 4 to 8 kN; for a line to be called rigid take 100 kN.
    pub stiffness_n: f64,
    /// Kelvin-Voigt damping time (damping over stiffness), s. 2 ms damps a mode of 30 rad/s by 3 % of critical, the
    /// loss of a braid.
    pub damping_s: f64,
}

/// Stiffness that stands for a line without stretch, N: 10 N on 12 m give 1.2 mm.
pub const RIGID_STIFFNESS_N: f64 = 100_000.0;

impl Default for LineConfig {
    fn default() -> Self {
        Self { stiffness_n: 6000.0, damping_s: 0.002 }
    }
}

impl LineConfig {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        check("stiffness_n", self.stiffness_n, "100 N to 10 MN", |x| (100.0..=1e7).contains(&x))?;
        check("damping_s", self.damping_s, "zero to 0.1 s", |x| (0.0..=0.1).contains(&x))
    }

    /// Unstretched length of a line of stretched length `stretched_m` under `tension_n`, m.
    pub fn unstretched_m(&self, stretched_m: f64, tension_n: f64) -> f64 {
        stretched_m / (1.0 + tension_n / self.stiffness_n)
    }

    /// Tension of `unstretched_m` of line drawn to `stretched_m`, both changing at the given rates, N; never negative.
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
    /// Encoder steps per metre of line. 4096 per turn on a wheel of 15 mm radius: 43 460.
    pub counts_per_m: f64,
    /// Share of the line's motion that slips over the wheel unseen; 0.0001 to 0.005 on real ones.
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

/// The idler of one line.
#[derive(Debug, Clone, PartialEq)]
pub struct Idler {
    counts_per_m: f64,
    /// Share of the motion that is not counted.
    pub(crate) slip: f64,
    /// The encoder gives no more steps.
    pub(crate) dead: bool,
    /// Line beyond the idler, m, unstretched.
    passed_m: f64,
    /// What the wheel has turned since the start, m.
    turned_m: f64,
    offset_counts: i64,
}

impl Idler {
    /// An idler beside a drum that has `paid_out_m` off it; the encoder starts at zero.
    pub fn new(config: IdlerConfig, paid_out_m: f64) -> Self {
        Self {
            counts_per_m: config.counts_per_m,
            slip: config.slip,
            dead: false,
            passed_m: paid_out_m,
            turned_m: 0.0,
            offset_counts: 0,
        }
    }

    /// Follows the line: `paid_out_m` is off the drum, `stretched_m` is the way from the drum to the node (m), or zero
    /// when nothing pulls on the far end any more.
    pub fn follow(&mut self, paid_out_m: f64, stretched_m: f64) {
        let passed_m = self.passed_m.max(stretched_m).min(paid_out_m);
        if !self.dead {
            self.turned_m += (passed_m - self.passed_m) * (1.0 - self.slip);
        }
        self.passed_m = passed_m;
    }

    /// The encoder's count; it grows as line is paid out.
    pub fn counts(&self) -> i64 {
        (self.turned_m * self.counts_per_m).floor() as i64 + self.offset_counts
    }

    /// Makes the encoder jump by `counts`.
    pub fn jump(&mut self, counts: i64) {
        self.offset_counts += counts;
    }

    /// Line that lies loose between drum and idler, m.
    pub fn loose_m(&self, paid_out_m: f64) -> f64 {
        paid_out_m - self.passed_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tension_and_unstretched_length_are_inverse() {
        let line = LineConfig::default();
        let unstretched = line.unstretched_m(12.0, 17.0);
        assert!((line.tension_n(12.0, unstretched, 0.0, 0.0) - 17.0).abs() < 1e-9);
        assert_eq!(line.tension_n(11.9, 12.0, 5.0, 0.0), 0.0);
    }

    #[test]
    fn a_taut_line_turns_the_idler_and_a_slack_one_does_not() {
        let config = IdlerConfig { counts_per_m: 1024.0, slip: 0.0 };
        let mut idler = Idler::new(config, 10.0);
        idler.follow(10.5, 10.625);
        assert_eq!(idler.counts(), 512);
        // The node no longer takes the line: it gathers between drum and idler.
        idler.follow(11.5, 10.625);
        assert_eq!(idler.counts(), 640);
        assert_eq!(idler.loose_m(11.5), 0.875);
        // The node draws some of it out.
        idler.follow(11.5, 11.0);
        assert_eq!(idler.counts(), 1024);
        // Winding takes up the loose part first.
        idler.follow(11.0, 11.0);
        assert_eq!(idler.counts(), 1024);
        idler.follow(10.0, 11.0);
        assert_eq!(idler.counts(), 0);
    }

    #[test]
    fn slip_jump_and_death_are_seen_in_the_counts() {
        let config = IdlerConfig { counts_per_m: 1000.0, slip: 0.5 };
        let mut idler = Idler::new(config, 1.0);
        idler.follow(2.0, 3.0);
        assert_eq!(idler.counts(), 500);
        idler.jump(-70);
        assert_eq!(idler.counts(), 430);
        idler.dead = true;
        idler.follow(2.5, 3.0);
        assert_eq!(idler.counts(), 430);
    }
}
