//! The swing of a body below the point where the cables meet, for small angles.

use nalgebra::Vector3;

use crate::world::Pendulum;

/// Angles of the body and their rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Swing {
    pendulum: Pendulum,
    /// Horizontal angle of the body's lower end from the vertical, rad, and its rate.
    angle: Vector3<f64>,
    rate: Vector3<f64>,
}

impl Swing {
    pub fn new(pendulum: Pendulum) -> Self {
        Self { pendulum, angle: Vector3::zeros(), rate: Vector3::zeros() }
    }

    /// Advances by `h` seconds while the point accelerates by `acceleration_m_s2`.
    pub fn step(&mut self, h: f64, acceleration_m_s2: Vector3<f64>, gravity_m_s2: f64) {
        let Pendulum { length_m, damping } = self.pendulum;
        if length_m <= 0.0 {
            return;
        }
        let own_rad_s = libm::sqrt(gravity_m_s2 / length_m);
        let level = Vector3::new(acceleration_m_s2.x, acceleration_m_s2.y, 0.0);
        let pull = self.angle * (-own_rad_s * own_rad_s) - self.rate * (2.0 * damping * own_rad_s) - level / length_m;
        self.rate += pull * h;
        self.angle += self.rate * h;
    }

    /// The rotation of the body as a vector, rad: a point at `lever` moves to `lever + v × lever` and second order.
    pub fn rotation(&self) -> Vector3<f64> {
        // The body's lower end, (0, 0, -1), moves by the angle.
        Vector3::new(self.angle.y, -self.angle.x, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pendulum_has_its_period_and_hangs_back_under_acceleration() {
        let mut swing = Swing::new(Pendulum { length_m: 0.3, damping: 0.0 });
        // Constant 0.3 m/s²: it swings about -a / g with the amplitude a / g.
        let (mut lowest, mut crossings, mut last) = (0.0f64, 0, 0.0);
        for _ in 0..100_000 {
            swing.step(0.0001, Vector3::new(0.3, 0.0, 0.0), 9.80665);
            lowest = lowest.min(swing.angle.x);
            let about = swing.angle.x + 0.3 / 9.80665;
            crossings += i32::from(about * last < 0.0);
            last = about;
        }
        assert!((lowest + 2.0 * 0.3 / 9.80665).abs() < 1e-4, "{lowest}");
        // 10 s with a period of 2 π √(0.3 / g) = 1.099 s: 18 zero crossings.
        assert!((17..=19).contains(&crossings), "{crossings}");
    }
}
