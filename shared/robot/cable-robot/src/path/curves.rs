//! Parabolas and spirals by arc length. The arc length of both is a closed form of one function, [`arc`], which is
//! inverted by [`slope_at`].

use nalgebra::Vector3;

use super::shapes::{Parabola, PathPoint, Spiral};

/// Bound of the inversion of an arc length without a closed form, which needs about six steps.
const MAX_ITERATIONS: usize = 60;

/// Change of the slope that a middle slope predicts to 1e-4: then one of Halley's steps reaches the last bits.
const SMALL_CHANGE: f64 = 0.1;

/// Change of the slope w along a curve below which the closed form of its arc length is nearly 0/0, in √(1 + w²).
const NEARLY_STRAIGHT: f64 = 1e-3;

/// Arc length of the parabola y = w²/2 from its vertex to the slope `w`: ½ (w √(1 + w²) + asinh w).
fn arc(w: f64) -> f64 {
    let w_abs = w.abs();
    let speed = (1.0 + w_abs * w_abs).sqrt();
    (0.5 * (w_abs * speed + libm::log1p(w_abs + w_abs * w_abs / (1.0 + speed)))).copysign(w)
}

/// Slope at an arc length from the vertex: the inverse of [`arc`].
///
/// The first guess is right for short and for long arcs, and wrong by at most 2.8 % between. Halley's step takes a
/// relative error e to less than e³, so that the second one reaches the last bits.
fn slope_at(arc_length: f64) -> f64 {
    let p = arc_length.abs();
    let q = p * p;
    let ratio = (1.0 + 0.085 * q) / (1.0 + (2.0 / 3.0 + 0.085) * q + 0.25 * 0.085 * q * q);
    halley(halley(p * ratio.sqrt().sqrt(), p), p).copysign(arc_length)
}

/// One of Halley's steps towards the slope at an arc length, from a slope near it.
fn halley(w: f64, arc_length: f64) -> f64 {
    let speed_squared = 1.0 + w * w;
    let error = arc(w) - arc_length;
    w - 2.0 * error * speed_squared / (2.0 * speed_squared * speed_squared.sqrt() - error * w)
}

impl Parabola {
    /// Horizontal distance from start to end, m.
    pub fn extent(&self) -> f64 {
        let d = self.to - self.from;
        (d.x * d.x + d.y * d.y).sqrt()
    }

    /// ζ of (26): the slope at the start.
    pub fn zeta(&self) -> f64 {
        let xf = self.extent();
        (self.to.z - self.from.z) / xf - self.mu_per_m * xf
    }

    /// Curvature at the point of smallest slope, 1/m.
    pub(super) fn greatest_curvature(&self) -> f64 {
        let (start, end) = (self.zeta(), self.zeta() + 2.0 * self.mu_per_m * self.extent());
        self.curvature_at(if start * end <= 0.0 { 0.0 } else { start.abs().min(end.abs()) })
    }

    /// Curvature where the path has this slope, 1/m.
    fn curvature_at(&self, slope: f64) -> f64 {
        let stretch = 1.0 + slope * slope;
        2.0 * self.mu_per_m.abs() / (stretch * stretch.sqrt())
    }

    /// Horizontal distance from the start to the vertex, m, if that is an inner point.
    pub(super) fn vertex(&self) -> Option<f64> {
        let x = -self.zeta() / (2.0 * self.mu_per_m);
        (x > 0.0 && x < self.extent()).then_some(x)
    }

    /// Lowest height of the path, m.
    pub fn lowest_m(&self) -> f64 {
        match self.vertex() {
            Some(x) if self.mu_per_m > 0.0 => self.from.z - self.mu_per_m * x * x,
            _ => self.from.z.min(self.to.z),
        }
    }

    /// Arc length over the horizontal distances 0..x, m: between the slopes ζ and 2µx̂ + ζ.
    pub(super) fn arc_length(&self, x: f64) -> f64 {
        let start = self.zeta();
        let change = 2.0 * self.mu_per_m * x;
        let w = start + 0.5 * change;
        let speed = (1.0 + w * w).sqrt();
        if change.abs() < NEARLY_STRAIGHT * speed {
            // Midpoint series; the next term is below 1e-14.
            return x * (speed + change * change / (24.0 * speed * speed * speed));
        }
        (arc(start + change) - arc(start)) * x / change
    }

    fn is_nearly_straight(&self) -> bool {
        let slope = (self.to.z - self.from.z) / self.extent();
        (2.0 * self.mu_per_m * self.extent()).abs() < NEARLY_STRAIGHT * (1.0 + slope * slope).sqrt()
    }

    /// [`Path::sample`](super::Path::sample), evenly over the horizontal distance.
    pub(super) fn sample(&self, arc_lengths_m: &mut [f64], curvatures: &mut [f64]) {
        let (start, bend, end) = (self.zeta(), 2.0 * self.mu_per_m, self.extent());
        let last = arc_lengths_m.len() - 1;
        let vertex = self.vertex().map(|x| ((x / end * last as f64).round() as usize, x));
        let (from, nearly_straight) = (arc(start), self.is_nearly_straight());
        for (i, (s, curvature)) in arc_lengths_m.iter_mut().zip(curvatures).enumerate() {
            let sharpest = vertex.filter(|(nearest, _)| *nearest == i);
            let inner = sharpest.filter(|_| (1..last).contains(&i));
            let x = inner.map_or(end * (i as f64 / last as f64), |(_, x)| x);
            let w = start + bend * x;
            *s = if nearly_straight { self.arc_length(x) } else { (arc(w) - from) / bend };
            // An end stays where it is, and counts for a sharper point beside it.
            *curvature = self.curvature_at(if sharpest.is_some() { 0.0 } else { w });
        }
    }

    pub(super) fn at(&self, s: f64) -> PathPoint {
        if let Some(mut slopes) = Slopes::new(self) {
            return slopes.point(s);
        }
        let (start, bend, end) = (self.zeta(), 2.0 * self.mu_per_m, self.extent());
        let speed = |x: f64| (1.0 + (start + bend * x) * (start + bend * x)).sqrt();
        self.at_x(invert(|x| self.arc_length(x), speed, s, self.arc_length(end), end), start, end)
    }

    /// Point at a horizontal distance from the start, m, of a parabola with this slope at its start.
    fn at_x(&self, x: f64, start: f64, end: f64) -> PathPoint {
        let d = self.to - self.from;
        let along = Vector3::new(d.x / end, d.y / end, 0.0);
        // Rounding must not leave the end point off target.
        let position = if end - x <= f64::EPSILON * end {
            self.to
        } else {
            self.from + along * x + Vector3::new(0.0, 0.0, (self.mu_per_m * x + start) * x)
        };
        let first = along + Vector3::new(0.0, 0.0, 2.0 * self.mu_per_m * x + start);
        let second = Vector3::new(0.0, 0.0, 2.0 * self.mu_per_m);
        by_arc_length(position, first, second)
    }
}

/// Slopes of a parabola by arc length, each found from the one before if that is near.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slopes {
    parabola: Parabola,
    start: f64,
    /// Change of the slope per horizontal distance, 1/m.
    bend: f64,
    /// Horizontal distance of the end, m.
    end: f64,
    /// Bound of the length, m: the horizontal distance, and as much height as the steepest slope gains on it.
    longest: f64,
    /// [`arc`] of the start.
    from: f64,
    /// The last slope, and its arc length, m.
    last: (f64, f64),
}

impl Slopes {
    /// None for a parabola that is nearly straight.
    pub(super) fn new(parabola: &Parabola) -> Option<Self> {
        let (start, bend, end) = (parabola.zeta(), 2.0 * parabola.mu_per_m, parabola.extent());
        let longest = end * (1.0 + start.abs().max((start + bend * end).abs()));
        let (parabola, from, last) = (*parabola, arc(start), (start, 0.0));
        (!parabola.is_nearly_straight()).then_some(Self { parabola, start, bend, end, longest, from, last })
    }

    /// Point at an arc length, m.
    pub(super) fn point(&mut self, s: f64) -> PathPoint {
        // Also true for NaN.
        if !(s > 0.0) {
            return self.parabola.at_x(0.0, self.start, self.end);
        }
        let s = s.min(self.longest);
        let (before, s_before) = self.last;
        let (wanted, step) = (self.from + self.bend * s, self.bend * (s - s_before));
        let slope = if step.abs() < SMALL_CHANGE {
            let middle = before + 0.5 * step / (1.0 + before * before).sqrt();
            halley(before + step / (1.0 + middle * middle).sqrt(), wanted)
        } else {
            slope_at(wanted)
        };
        self.last = (slope, s);
        self.parabola.at_x(((slope - self.start) / self.bend).max(0.0).min(self.end), self.start, self.end)
    }
}

impl Spiral {
    /// Total angle, rad, positive.
    pub(super) fn angle(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.turns.abs()
    }

    /// Growth of radius and of height per angle, m/rad.
    pub(super) fn rates(&self) -> (f64, f64) {
        let angle = self.angle();
        ((self.end_radius_m - self.start_radius_m) / angle, self.rise_m / angle)
    }

    /// Arc length over the angles 0..θ, m: ∫ √(r² + c²) dr / a with r = r0 + aθ and c² = a² + h².
    pub(super) fn arc_length(&self, theta: f64) -> f64 {
        let (a, h) = self.rates();
        let c = (a * a + h * h).sqrt();
        let r0 = self.start_radius_m;
        let dr = a * theta;
        let r = r0 + 0.5 * dr;
        let f = (r * r + c * c).sqrt();
        if dr.abs() < NEARLY_STRAIGHT * f {
            // Nearly a helix. Midpoint series; the next term is below 1e-14.
            return if f > 0.0 { theta * (f + dr * dr * c * c / (24.0 * f * f * f)) } else { 0.0 };
        }
        (arc((r0 + dr) / c) - arc(r0 / c)) * c * c / a
    }

    /// Angle at an arc length, rad: the inverse of [`Spiral::arc_length`] within the curve.
    pub(super) fn angle_at(&self, s: f64) -> f64 {
        let (a, h) = self.rates();
        let c = (a * a + h * h).sqrt();
        let (r0, end) = (self.start_radius_m, self.angle());
        let middle = r0 + 0.5 * a * end;
        if (a * end).abs() < NEARLY_STRAIGHT * (middle * middle + c * c).sqrt() {
            let speed = |theta: f64| ((r0 + a * theta) * (r0 + a * theta) + c * c).sqrt();
            return invert(|theta| self.arc_length(theta), speed, s, self.arc_length(end), end);
        }
        // Also true for NaN.
        if !(s > 0.0) {
            return 0.0;
        }
        let s = s.min(end * (r0.max(self.end_radius_m) + c));
        ((c * slope_at(arc(r0 / c) + a * s / (c * c)) - r0) / a).max(0.0).min(end)
    }

    pub(super) fn geometry(&self, theta: f64) -> PathPoint {
        let (a, h) = self.rates();
        let r = self.start_radius_m + a * theta;
        let turn = if self.turns < 0.0 { -1.0 } else { 1.0 };
        let phi = self.start_angle_rad + turn * theta;
        let (sin, cos) = (libm::sin(phi), libm::cos(phi));
        let radial = Vector3::new(cos, sin, 0.0);
        let around = Vector3::new(-sin, cos, 0.0) * turn;
        let position = self.centre + radial * r + Vector3::new(0.0, 0.0, h * theta);
        let first = radial * a + around * r + Vector3::new(0.0, 0.0, h);
        let second = around * (2.0 * a) - radial * r;
        by_arc_length(position, first, second)
    }

    pub(super) fn at(&self, s: f64) -> PathPoint {
        self.geometry(self.angle_at(s))
    }
}

/// Computes tangent and curvature vector from derivatives with respect to any parameter.
pub(super) fn by_arc_length(position: Vector3<f64>, first: Vector3<f64>, second: Vector3<f64>) -> PathPoint {
    let speed_squared = first.norm_squared();
    let tangent = first / speed_squared.sqrt();
    let curvature = (second - tangent * tangent.dot(&second)) / speed_squared;
    PathPoint { position, tangent, curvature }
}

/// Finds the parameter in 0..=end at which the increasing function `length` is `s`: Newton steps inside a
/// shrinking bracket.
pub(super) fn invert(
    length: impl Fn(f64) -> f64,
    derivative: impl Fn(f64) -> f64,
    s: f64,
    total: f64,
    end: f64,
) -> f64 {
    if s >= total {
        return end;
    }
    // Also true for NaN.
    if !(s > 0.0) {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, end);
    let mut u = end * (s / total);
    for _ in 0..MAX_ITERATIONS {
        let error = length(u) - s;
        if error.abs() <= 1e-15 * total {
            break;
        }
        if error > 0.0 {
            high = u;
        } else {
            low = u;
        }
        let newton = u - error / derivative(u);
        let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
        let moved = (next - u).abs();
        u = next;
        if moved <= 1e-15 * end {
            break;
        }
    }
    u
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_slope_at_an_arc_length_is_the_inverse(power in -12.0..9.0f64, negative in any::<bool>()) {
            let w = if negative { -10f64.powf(power) } else { 10f64.powf(power) };
            prop_assert!((slope_at(arc(w)) / w - 1.0).abs() < 4e-15, "{}", slope_at(arc(w)) / w - 1.0);
        }

        #[test]
        fn the_point_at_an_arc_length_has_that_arc_length(
            d in [0.05..8.0f64, -4.0..4.0],
            bend in prop_oneof![-3.0..1.3f64, Just(-20.0)],
            negative in any::<bool>(),
            u in 0.0..1.0f64
        ) {
            let sign = if negative { -1.0 } else { 1.0 };
            let to = Vector3::new(d[0], 0.0, d[1]);
            let parabola = Parabola { from: Vector3::zeros(), to, mu_per_m: sign * 10f64.powf(bend) };
            let length = parabola.arc_length(parabola.extent());
            let there = parabola.at(u * length).position;
            prop_assert!((parabola.arc_length(there.x) - u * length).abs() < 1e-12 * length);
        }
    }

    #[test]
    fn the_slope_at_no_arc_length_and_at_none_is_itself() {
        assert_eq!((slope_at(0.0), arc(0.0)), (0.0, 0.0));
        assert!(slope_at(f64::NAN).is_nan());
    }
}
