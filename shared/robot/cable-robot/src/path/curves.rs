//! Parabolas and spirals: both have a closed form of the arc length, which is inverted numerically.

use nalgebra::Vector3;

use super::shapes::{Parabola, PathPoint, Spiral};

/// Bound of the inversion of the arc length, which needs about six steps.
const MAX_ITERATIONS: usize = 60;

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
        let slope = if start * end <= 0.0 { 0.0 } else { start.abs().min(end.abs()) };
        let stretch = 1.0 + slope * slope;
        2.0 * self.mu_per_m.abs() / (stretch * stretch.sqrt())
    }

    /// Lowest height of the path, m.
    pub fn lowest_m(&self) -> f64 {
        let ends = self.from.z.min(self.to.z);
        let vertex = -self.zeta() / (2.0 * self.mu_per_m);
        if self.mu_per_m > 0.0 && vertex > 0.0 && vertex < self.extent() {
            self.from.z - self.mu_per_m * vertex * vertex
        } else {
            ends
        }
    }

    /// Arc length over the horizontal distances 0..x, m: [w √(1+w²) + asinh w] / 4µ between the slopes w = 2µx̂ + ζ.
    pub(super) fn arc_length(&self, x: f64) -> f64 {
        let w0 = self.zeta();
        let dw = 2.0 * self.mu_per_m * x;
        if dw.abs() < 1e-3 {
            // µ -> 0: the closed form is 0/0. Midpoint series; the next term is below 1e-15.
            let w = w0 + 0.5 * dw;
            let f = (1.0 + w * w).sqrt();
            return x * (f + dw * dw / (24.0 * f * f * f));
        }
        let primitive = |w: f64| 0.5 * (w * (1.0 + w * w).sqrt() + libm::asinh(w));
        (primitive(w0 + dw) - primitive(w0)) * x / dw
    }

    pub(super) fn at(&self, s: f64) -> PathPoint {
        let xf = self.extent();
        let zeta = self.zeta();
        let slope = |x: f64| 2.0 * self.mu_per_m * x + zeta;
        let speed = |x: f64| (1.0 + slope(x) * slope(x)).sqrt();
        let total = self.arc_length(xf);
        let x = invert(|x| self.arc_length(x), speed, s, total, xf);
        let d = self.to - self.from;
        let along = Vector3::new(d.x / xf, d.y / xf, 0.0);
        let position = if s >= total {
            self.to
        } else {
            self.from + along * x + Vector3::new(0.0, 0.0, (self.mu_per_m * x + zeta) * x)
        };
        let first = along + Vector3::new(0.0, 0.0, slope(x));
        let second = Vector3::new(0.0, 0.0, 2.0 * self.mu_per_m);
        by_arc_length(position, first, second)
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
        if dr.abs() < 1e-3 * f {
            // Nearly a helix: the closed form is 0/0. Midpoint series; the next term is below 1e-14.
            return if f > 0.0 { theta * (f + dr * dr * c * c / (24.0 * f * f * f)) } else { 0.0 };
        }
        let primitive = |r: f64| 0.5 * (r * (r * r + c * c).sqrt() + c * c * libm::asinh(r / c));
        (primitive(r0 + dr) - primitive(r0)) / a
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
        let (a, h) = self.rates();
        let end = self.angle();
        let speed = |theta: f64| {
            let r = self.start_radius_m + a * theta;
            (r * r + a * a + h * h).sqrt()
        };
        self.geometry(invert(|t| self.arc_length(t), speed, s, self.arc_length(end), end))
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
