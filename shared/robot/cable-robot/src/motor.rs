//! Electrical model of a winch motor, with forces and speeds at the cable. Speeds are reel-in speeds:
//! positive winds up cable.

use crate::robot_error::{RobotError, not_negative, positive, refuse};

/// A geared winch motor, with quantities at the cable; the keys of `[motor]` in the robot file.
///
/// ```
/// use cable_robot::motor::Motor;
/// let motor = Motor::default();
/// // Lifting draws more current than lowering.
/// assert!(motor.current_a(20.0, 0.2) > motor.current_a(20.0, -0.2));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    /// Cable tension per armature current, N/A.
    pub force_constant_n_a: f64,
    /// Armature resistance, Ω.
    pub resistance_ohm: f64,
    /// Share of the tension lost in the gear: 0 for an ideal motor, near 1 for a self-locking gear.
    pub gear_friction: f64,
    /// Friction independent of load and speed, N.
    pub coulomb_n: f64,
    /// Viscous friction, N s/m.
    pub viscous_n_s_m: f64,
    /// Speed range over which friction changes its sign, m/s; 0 for an ideal sign function.
    pub transition_m_s: f64,
}

impl Default for Motor {
    /// A brushed motor with a high gear ratio on a small drum, as documented in the robot file.
    fn default() -> Self {
        Self {
            force_constant_n_a: 40.0,
            resistance_ohm: 1.2,
            gear_friction: 0.85,
            coulomb_n: 3.0,
            viscous_n_s_m: 20.0,
            transition_m_s: 0.02,
        }
    }
}

impl Motor {
    /// An ideal motor: the current is the tension divided by the force constant.
    pub fn ideal(force_constant_n_a: f64, resistance_ohm: f64) -> Self {
        Self {
            force_constant_n_a,
            resistance_ohm,
            gear_friction: 0.0,
            coulomb_n: 0.0,
            viscous_n_s_m: 0.0,
            transition_m_s: 0.02,
        }
    }

    /// Rejects parameters outside the physical range.
    pub fn check(&self) -> Result<(), RobotError> {
        positive("force_constant_n_a", self.force_constant_n_a, "a finite value above 0, in newtons per ampere")?;
        not_negative("resistance_ohm", self.resistance_ohm, "a finite resistance of 0 or more, in ohms")?;
        not_negative(
            "gear_friction",
            self.gear_friction,
            "a finite share of 0 or more, near 1 for self-locking gears",
        )?;
        not_negative("coulomb_n", self.coulomb_n, "a finite force of 0 or more, in newtons")?;
        not_negative(
            "viscous_n_s_m",
            self.viscous_n_s_m,
            "a finite value of 0 or more, in newtons per metre per second",
        )?;
        not_negative("transition_m_s", self.transition_m_s, "a finite speed of 0 or more, in metres per second")
    }

    /// Smooth sign of the speed: tanh(v / transition).
    pub fn friction_sign(&self, reel_in_m_s: f64) -> f64 {
        if reel_in_m_s == 0.0 {
            0.0
        } else if self.transition_m_s > 0.0 {
            libm::tanh(reel_in_m_s / self.transition_m_s)
        } else {
            reel_in_m_s.signum()
        }
    }

    /// Armature current, A: (T (1 + gear_friction s) + coulomb s + viscous v) / force_constant.
    ///
    /// `tension_n` in newtons, `reel_in_m_s` = -dL/dt in m/s. Quasi-static, as (22)-(23).
    pub fn current_a(&self, tension_n: f64, reel_in_m_s: f64) -> f64 {
        let s = self.friction_sign(reel_in_m_s);
        (tension_n * (1.0 + self.gear_friction * s) + self.coulomb_n * s + self.viscous_n_s_m * reel_in_m_s)
            / self.force_constant_n_a
    }

    /// Tension at which this current is drawn at this speed, N: the inverse of [`Motor::current_a`]. None for a
    /// self-locking gear, which no tension can back-drive: its current does not determine the tension.
    pub fn tension_n(&self, current_a: f64, reel_in_m_s: f64) -> Option<f64> {
        let s = self.friction_sign(reel_in_m_s);
        let share = 1.0 + self.gear_friction * s;
        let force = self.force_constant_n_a * current_a - self.coulomb_n * s - self.viscous_n_s_m * reel_in_m_s;
        (share > 1e-3).then(|| force / share)
    }

    /// Voltage at the terminals, V: I R + force_constant v. In SI units, the force per current is also the voltage that
    /// the motor generates per speed.
    pub fn voltage_v(&self, current_a: f64, reel_in_m_s: f64) -> f64 {
        current_a * self.resistance_ohm + self.force_constant_n_a * reel_in_m_s
    }

    /// Loss in the armature, W: I² R.
    pub fn loss_w(&self, current_a: f64) -> f64 {
        current_a * current_a * self.resistance_ohm
    }
}

/// Relative excess over a limit that counts as rounding.
const ROUNDING: f64 = 1e-6;

/// What a drive can deliver to its motor; infinite where it is unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveLimits {
    /// Highest continuous current, A.
    pub current_a: f64,
    /// Highest voltage, V.
    pub voltage_v: f64,
}

impl Default for DriveLimits {
    fn default() -> Self {
        Self { current_a: f64::INFINITY, voltage_v: f64::INFINITY }
    }
}

impl DriveLimits {
    /// True if the drive can deliver the current of this load. False for NaN.
    pub fn allow_current(&self, load: &DriveLoad) -> bool {
        load.current_a.abs() <= self.current_a * (1.0 + ROUNDING)
    }

    /// True if the drive can deliver the voltage of this load. False for NaN.
    pub fn allow_voltage(&self, load: &DriveLoad) -> bool {
        load.voltage_v.abs() <= self.voltage_v * (1.0 + ROUNDING)
    }

    /// Rejects limits that are not positive.
    pub fn check(&self) -> Result<(), RobotError> {
        let above_0 = |value: f64| value > 0.0;
        if !above_0(self.current_a) {
            return refuse("current_limit_a", format!("is {}", self.current_a), "a current above 0, in amperes");
        }
        if !above_0(self.voltage_v) {
            return refuse("supply_min_v", format!("leaves {} V", self.voltage_v), "a voltage above 0, in volts");
        }
        Ok(())
    }
}

/// Load of a drive: what its motor needs at a tension and a speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveLoad {
    /// Tension of the cable, N.
    pub tension_n: f64,
    /// Reel-in speed, m/s.
    pub reel_in_m_s: f64,
    /// Current, A.
    pub current_a: f64,
    /// Voltage, V.
    pub voltage_v: f64,
}

/// Efficiency of an ideal brushed motor (24): ω / (ω + I R / K_T); 0 at standstill.
///
/// `speed_rad_s` ≥ 0, `torque_constant_nm_a` > 0.
pub fn efficiency(speed_rad_s: f64, current_a: f64, resistance_ohm: f64, torque_constant_nm_a: f64) -> f64 {
    let loss = current_a * resistance_ohm / torque_constant_nm_a;
    if speed_rad_s == 0.0 { 0.0 } else { speed_rad_s / (speed_rad_s + loss) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ideal_motor_draws_tension_over_force_constant() {
        let motor = Motor::ideal(40.0, 1.2);
        for v in [-0.4, 0.0, 0.4] {
            assert!((motor.current_a(20.0, v) - 0.5).abs() < 1e-15);
        }
        assert!((motor.loss_w(0.5) - 0.3).abs() < 1e-15);
    }

    #[test]
    fn well_above_the_transition_the_full_friction_acts() {
        let motor = Motor::default();
        let expected = (20.0 * 1.85 + 3.0 + 20.0 * 0.4) / 40.0;
        assert!((motor.current_a(20.0, 0.4) - expected).abs() < 1e-9);
        let lowering = (20.0 * 0.15 - 3.0 - 8.0) / 40.0;
        assert!((motor.current_a(20.0, -0.4) - lowering).abs() < 1e-9);
    }

    #[test]
    fn tension_is_read_back_from_current() {
        let motor = Motor::default();
        for v in [-0.3, -0.01, 0.0, 0.005, 0.3] {
            let i = motor.current_a(17.0, v);
            assert!((motor.tension_n(i, v).unwrap() - 17.0).abs() < 1e-9);
        }
        let locked = Motor { gear_friction: 1.0, ..motor };
        assert_eq!(locked.tension_n(0.1, -0.4), None);
    }

    #[test]
    fn electrical_power_is_the_loss_and_the_power_at_the_cable() {
        let motor = Motor::ideal(40.0, 1.2);
        for (tension_n, reel_in_m_s) in [(20.0, 0.3), (20.0, -0.3), (0.0, 0.4), (50.0, 0.0)] {
            let current_a = motor.current_a(tension_n, reel_in_m_s);
            let power_w = motor.voltage_v(current_a, reel_in_m_s) * current_a;
            assert!((power_w - motor.loss_w(current_a) - tension_n * reel_in_m_s).abs() < 1e-12);
        }
    }

    #[test]
    fn efficiency_rises_with_speed_and_is_zero_at_standstill() {
        assert_eq!(efficiency(0.0, 1.0, 1.2, 0.05), 0.0);
        assert!((efficiency(24.0, 1.0, 1.2, 0.05) - 0.5).abs() < 1e-15);
        assert!(efficiency(100.0, 1.0, 1.2, 0.05) > efficiency(50.0, 1.0, 1.2, 0.05));
    }
}
