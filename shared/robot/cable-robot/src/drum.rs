//! A drum on which the cable lies in layers: how its radius, and with it the cable per turn, depends on the cable on
//! it.

use std::f64::consts::PI;

use crate::RobotError;
use crate::robot_error::{positive, refuse};

/// A layer of round cable lies in the grooves of the one below, √3/2 of a diameter higher.
const RISE_PER_DIAMETER: f64 = 0.866_025_403_784_438_6;

/// Geometry of the winches.
#[derive(Debug, Clone, PartialEq)]
pub struct DrumParts {
    /// Diameter of the circle on which the middle of the cable runs on the bare drum, m.
    pub diameter_m: f64,
    /// Diameter of the cable, m.
    pub cable_diameter_m: f64,
    /// Turns of cable that lie side by side in a layer.
    pub turns_per_layer: f64,
    /// Cable from its end on the drum to the node, m per cable.
    pub cable_m: Vec<f64>,
    /// The encoders by which the robot counts its cables count turns of the drum; otherwise they are on idlers.
    pub counted: bool,
}

/// The drum of one cable, with the mean radius of its layers: it grows by the same amount in every turn, from half a
/// layer below the bare drum's. The true one climbs by a whole layer at once. Lengths agree at the ends of layers and
/// deviate by up to an eighth of what one layer changes in between.
///
/// [`Drum::default`] is a wheel or a drum whose radius does not change.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drum {
    /// By how much the squared mean radius is below the bare one without cable, as a share.
    below: f64,
    /// Growth of the squared radius per metre on the drum, as a share of the bare one, 1/m.
    growth_per_m: f64,
    /// Cable on the drum at length 0, m.
    full_m: f64,
}

impl Drum {
    /// The drums of a robot whose cables have these lengths from drum to anchor, m.
    ///
    /// # Errors
    /// Names the key that is out of range.
    pub fn of(parts: &DrumParts, routed_length_m: &[f64]) -> Result<Vec<Self>, RobotError> {
        let DrumParts { diameter_m, cable_diameter_m, turns_per_layer, cable_m, counted: _ } = parts;
        positive("diameter_m", *diameter_m, "a finite diameter above 0, in metres")?;
        let thickest_m = 0.2 * diameter_m;
        if !(0.0..=thickest_m).contains(cable_diameter_m) {
            let accepted = "0 to a fifth of the drum's diameter, in metres";
            return refuse("cable_diameter_m", format!("is {cable_diameter_m}"), accepted);
        }
        if !(turns_per_layer.is_finite() && *turns_per_layer >= 1.0) {
            return refuse("turns_per_layer", format!("is {turns_per_layer}"), "1 or more turns");
        }
        if cable_m.len() != routed_length_m.len() {
            let problem = format!("has {} values for a robot of {} cables", cable_m.len(), routed_length_m.len());
            return refuse("cable_m", problem, "one length per cable, in metres");
        }
        // The radius grows by a layer in its turns: by rise / (2 π turns) per radian, and its square by twice that per
        // metre of cable.
        let radius_m = 0.5 * diameter_m;
        let rise_m = RISE_PER_DIAMETER * cable_diameter_m;
        let growth_per_m = rise_m / (PI * turns_per_layer * radius_m * radius_m);
        let half_layer = 0.5 * rise_m / radius_m;
        let below = half_layer * (2.0 - half_layer);
        let drum = |(cable_m, routed_m): (&f64, &f64)| {
            positive("cable_m", *cable_m, "a finite length above 0, in metres")?;
            Ok(Self { below, growth_per_m, full_m: cable_m - routed_m })
        };
        cable_m.iter().zip(routed_length_m).map(drum).collect()
    }

    /// Radius of the outermost turn relative to that of the bare drum, with `length_m` of cable beyond the anchor. A
    /// tension pulls on the motor by so much more, and the motor turns by so much slower.
    #[must_use]
    pub fn radius_ratio(&self, length_m: f64) -> f64 {
        (1.0 - self.below + self.growth_per_m * (self.full_m - length_m).max(0.0)).sqrt()
    }

    /// True for a wheel or a drum whose radius does not change.
    #[must_use]
    pub fn is_bare(&self) -> bool {
        *self == Self::default()
    }

    /// Largest share by which a turn of the true drum, which climbs by a whole layer at once, deviates from the mean
    /// radius, and largest deviation that this adds up to, m: an eighth of what a layer changes.
    #[must_use]
    pub fn layer_error(&self) -> (f64, f64) {
        // `below` is that of half a layer; a layer of the outer turns is less in relation.
        let share = 1.0 - (1.0 - self.below).sqrt();
        if self.growth_per_m > 0.0 { (share, share * share / self.growth_per_m) } else { (0.0, 0.0) }
    }

    /// Longest length that the cable allows, m; infinite for a wheel.
    #[must_use]
    pub fn longest_m(&self) -> f64 {
        if self.growth_per_m > 0.0 { self.full_m } else { f64::INFINITY }
    }

    /// Cable that leaves the drum, m, where a bare one would pay out `bare_m`, beginning with `length_m` beyond the
    /// anchor. The radius falls evenly with the turns, so this is exact over any distance.
    #[must_use]
    pub fn paid_out_m(&self, length_m: f64, bare_m: f64) -> f64 {
        bare_m * (self.radius_ratio(length_m) - 0.25 * self.growth_per_m * bare_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn drum(diameter_m: f64, cable_diameter_m: f64, turns_per_layer: f64, full_m: f64) -> Drum {
        let parts =
            DrumParts { diameter_m, cable_diameter_m, turns_per_layer, cable_m: vec![full_m + 1.5], counted: true };
        Drum::of(&parts, &[1.5]).unwrap()[0]
    }

    #[test]
    fn without_growth_not_a_bit_changes() {
        let wheel = Drum::default();
        for bare_m in [0.0, -0.0, 1.0 / 3.0, -17.123_456_789, 1e-9] {
            assert_eq!(wheel.paid_out_m(5.0, bare_m).to_bits(), bare_m.to_bits());
        }
        assert_eq!(wheel.radius_ratio(-3.0), 1.0);
    }

    /// Wound in layers turn by turn: the cable on the drum after every turn, from the bare drum.
    #[test]
    fn layers_summed_turn_by_turn_agree() {
        const TURNS: u32 = 25;
        let (diameter_m, cable_m) = (0.05, 0.001);
        let rise_m = RISE_PER_DIAMETER * cable_m;
        let turn_m = |turn: u32| 2.0 * PI * (0.5 * diameter_m + rise_m * f64::from(turn / TURNS));
        let wound_m: Vec<f64> = (0..=200).map(|n| (0..n).map(turn_m).sum()).collect();
        let drum = drum(diameter_m, cable_m, TURNS.into(), wound_m[200]);
        for n in 0..=200_u32 {
            let paid_m = drum.paid_out_m(0.0, f64::from(200 - n) * PI * diameter_m);
            let off_m = paid_m - (wound_m[200] - wound_m[n as usize]);
            let most_m = if n % TURNS == 0 { 1e-12 } else { rise_m * f64::from(TURNS) * 2.0 * PI / 8.0 };
            assert!(off_m.abs() <= most_m, "{n}: {off_m}");
        }
    }

    proptest! {
        /// Turns forth and back, in any parts, end where they began; the derivative is the radius.
        #[test]
        fn turns_add_up(
            diameter_m in 0.02..0.2_f64,
            share in 0.005..0.1_f64,
            turns in 10.0..100.0_f64,
            from_m in 0.0..20.0_f64,
            parts_m in proptest::collection::vec(-1.0..1.0_f64, 1..20),
        ) {
            let drum = drum(diameter_m, share * diameter_m, turns, 80.0);
            let stepped_m = parts_m.iter().fold(from_m, |length_m, bare_m| length_m + drum.paid_out_m(length_m, *bare_m));
            let whole_m: f64 = parts_m.iter().sum();
            prop_assert!((stepped_m - from_m - drum.paid_out_m(from_m, whole_m)).abs() < 1e-9);
            let back_m = stepped_m + drum.paid_out_m(stepped_m, -whole_m);
            prop_assert!((back_m - from_m).abs() < 1e-9, "{from_m} became {back_m}");
            let rate = drum.paid_out_m(from_m, 1e-6) / 1e-6;
            prop_assert!((rate - drum.radius_ratio(from_m)).abs() < 1e-6);
        }
    }
}
