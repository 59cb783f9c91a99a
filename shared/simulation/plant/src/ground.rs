//! Surroundings of the node for sensors: objects on the ground, and quantities that vary with position.

use libm::{cos, exp, sin, tan};

/// Number of rays of a beam in addition to the central one.
const RAYS: usize = 6;

/// Objects on level ground.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ground {
    /// Height of the ground, m.
    pub ground_m: f64,
    /// Upright cylinders.
    pub cylinders: Vec<Cylinder>,
    /// Upright rectangular prisms.
    pub prisms: Vec<Prism>,
}

/// An upright cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// x and y of its axis, m.
    pub center_m: [f64; 2],
    /// Radius, m.
    pub radius_m: f64,
    /// Height of the top above the ground, m.
    pub height_m: f64,
}

/// An upright rectangular prism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prism {
    /// x and y of its centre, m.
    pub center_m: [f64; 2],
    /// Size along its own axes, m.
    pub size_m: [f64; 2],
    /// Angle from the site's x axis to its own, anticlockwise, rad.
    pub angle_rad: f64,
    /// Height of the top above the ground, m.
    pub height_m: f64,
    /// Cavity in its top.
    pub cavity: Option<Cavity>,
}

/// A rectangular hole in the top of a prism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cavity {
    /// One corner, relative to the centre in the prism's own axes, m.
    pub from_m: [f64; 2],
    /// The opposite corner, m.
    pub to_m: [f64; 2],
    /// Depth below the top, m.
    pub depth_m: f64,
}

impl Ground {
    /// Height of the visible surface at a position, m.
    #[must_use]
    pub fn height_m(&self, [x, y]: [f64; 2]) -> f64 {
        let cylinders = self.cylinders.iter().filter_map(|cylinder| cylinder.top_m([x, y]));
        let prisms = self.prisms.iter().filter_map(|prism| prism.top_m([x, y]));
        self.ground_m + cylinders.chain(prisms).fold(0.0, f64::max)
    }

    /// Distance measured by a downward rangefinder at `from_m`, m: the mean over a beam with the angle `beam_rad`. The
    /// radius of the beam is evaluated at the height below its centre.
    #[must_use]
    pub fn distance_m(&self, from_m: [f64; 3], beam_rad: f64) -> f64 {
        let [x, y, z] = from_m;
        let middle_m = z - self.height_m([x, y]);
        if beam_rad <= 0.0 {
            return middle_m;
        }
        // Rays at two thirds of the radius approximate the mean over the disc.
        let radius_m = tan(beam_rad / 2.0) * middle_m.max(0.0) * (2.0 / 3.0);
        let ray = |at: usize| {
            let angle = at as f64 * std::f64::consts::TAU / RAYS as f64;
            z - self.height_m([x + radius_m * cos(angle), y + radius_m * sin(angle)])
        };
        (middle_m + (0..RAYS).map(ray).sum::<f64>()) / (RAYS + 1) as f64
    }
}

impl Cylinder {
    fn top_m(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let (x, y) = (x - self.center_m[0], y - self.center_m[1]);
        (x * x + y * y <= self.radius_m * self.radius_m).then_some(self.height_m)
    }
}

impl Prism {
    fn top_m(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let (x, y) = (x - self.center_m[0], y - self.center_m[1]);
        let (s, c) = (sin(self.angle_rad), cos(self.angle_rad));
        let own = [c * x + s * y, c * y - s * x];
        let inside = own.iter().zip(self.size_m).all(|(at, size)| at.abs() <= size / 2.0);
        let deep = |cavity: &Cavity| {
            let within = |axis: usize| {
                let (a, b) = (cavity.from_m[axis], cavity.to_m[axis]);
                (a.min(b)..=a.max(b)).contains(&own[axis])
            };
            within(0) && within(1)
        };
        let cut_m = self.cavity.filter(deep).map_or(0.0, |cavity| cavity.depth_m);
        inside.then_some((self.height_m - cut_m).max(0.0))
    }
}

/// A quantity that varies with position, for example a temperature: a value, a slope, and an optional peak.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Field {
    /// Value at the origin, without the peak.
    pub base: f64,
    /// Change per metre along x, y and z.
    pub slope_per_m: [f64; 3],
    /// Gaussian peak.
    pub peak: Option<Peak>,
}

/// Gaussian peak of a [`Field`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Position of the maximum, m.
    pub at_m: [f64; 3],
    /// Amplitude.
    pub height: f64,
    /// Standard deviation of the shape, m.
    pub radius_m: f64,
}

impl Field {
    /// Value at a position.
    #[must_use]
    pub fn value(&self, place_m: [f64; 3]) -> f64 {
        let slope: f64 = self.slope_per_m.iter().zip(place_m).map(|(slope, at)| slope * at).sum();
        let peak = self.peak.map_or(0.0, |peak| {
            let square: f64 = peak.at_m.iter().zip(place_m).map(|(top, at)| (at - top) * (at - top)).sum();
            peak.height * exp(-square / (2.0 * peak.radius_m * peak.radius_m))
        });
        self.base + slope + peak
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ground() -> Ground {
        let cavity = Cavity { from_m: [0.5, 0.25], to_m: [0.1, 0.0], depth_m: 0.3 };
        Ground {
            ground_m: 0.1,
            cylinders: vec![Cylinder { center_m: [1.0, 1.0], radius_m: 0.5, height_m: 0.4 }],
            prisms: vec![Prism {
                center_m: [3.0, 1.0],
                size_m: [1.0, 0.5],
                angle_rad: std::f64::consts::FRAC_PI_2,
                height_m: 0.6,
                cavity: Some(cavity),
            }],
        }
    }

    #[test]
    fn heights_are_those_of_what_stands_there() {
        let ground = ground();
        let height = |x: f64, y: f64| (ground.height_m([x, y]) * 1e6).round() / 1e6;
        assert_eq!(height(0.0, 0.0), 0.1);
        assert_eq!(height(1.49, 1.0), 0.5);
        assert_eq!(height(1.51, 1.0), 0.1);
        // rotated by 90 degrees: its length is along y, and the cavity at +x, +y in its own axes is
        // at -x, +y of the site
        assert_eq!(height(3.0, 0.6), 0.7);
        assert_eq!(height(3.4, 1.0), 0.1);
        assert_eq!(height(2.8, 1.4), 0.4);
        assert_eq!(height(3.2, 1.4), 0.7);
    }

    #[test]
    fn a_beam_smears_an_edge_and_nothing_else() {
        let ground = ground();
        let distance = |x: f64, beam: f64| ground.distance_m([x, 1.0, 2.1], beam);
        assert!((distance(1.0, 0.0) - 1.6).abs() < 1e-12);
        assert!((distance(1.0, 0.1) - 1.6).abs() < 1e-12, "all of the beam is on the top");
        let at_edge = distance(1.499, 0.1);
        assert!(at_edge > 1.65 && at_edge < 1.95, "{at_edge}");
    }

    #[test]
    fn a_field_has_a_slope_and_a_peak() {
        let peak = Peak { at_m: [1.0, 0.0, 0.0], height: 5.0, radius_m: 0.5 };
        let field = Field { base: 20.0, slope_per_m: [0.0, 2.0, 0.0], peak: Some(peak) };
        assert_eq!(field.value([1.0, 0.0, 0.0]), 25.0);
        assert!((field.value([1.5, 0.0, 0.0]) - 20.0 - 5.0 * (-0.5_f64).exp()).abs() < 1e-12);
        assert!((field.value([100.0, 3.0, 0.0]) - 26.0).abs() < 1e-12);
    }
}
