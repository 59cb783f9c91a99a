//! A brushed motor with its gear, referred to the cable.
//!
//! All quantities are referred to the cable at the bare drum's radius, as in the robot file: force per ampere, friction
//! in newtons, and a reel-in speed in metres per second. In steady motion the current is
//!
//! `I = (T (1 + μ s) + F_c s + b v) / K_f`, `s = tanh(v / v_s)`, `v > 0` reels in,
//!
//! which is the inverse of the law that [`Motor::step`] integrates. The electrical time constants of these motors are
//! below a millisecond, so the current follows the voltage immediately: `I = (u - K_f v) / R`.

use crate::error::{PlantError, check};

/// Width of the change of sign of a friction that sticks, relative to that of the smooth law.
const STICKING: f64 = 0.1;

/// Constants of a motor and its gear, referred to the cable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorConfig {
    /// Cable tension per ampere of an ideal gear, N/A; the back-EMF has the same number in V per m/s.
    pub force_constant_n_a: f64,
    /// Armature resistance, ohm.
    pub resistance_ohm: f64,
    /// Load-dependent gear friction μ: 0 ideal, near 1 self-locking.
    pub gear_friction: f64,
    /// Load-independent friction, N.
    pub coulomb_n: f64,
    /// Viscous friction, N s/m.
    pub viscous_n_s_m: f64,
    /// Speed at which most of the friction has built up, m/s.
    pub transition_m_s: f64,
    /// Inertia of rotor and gear as a mass at the cable, kg. For a 24 V, 150 W motor (142 g cm²) geared to 40 N/A it is
    /// 25 kg, for a 12 V hobby gearmotor (3e-6 kg m², 50:1, 20 mm drum) 19 kg.
    pub inertia_kg: f64,
    /// Current limit of the drive, A.
    pub current_limit_a: f64,
    /// Excess of the break-away friction over the friction in motion: 0 none. With it, a slow motor sticks and slips.
    pub stiction: f64,
    /// Speed at which the excess has fallen to 1 / e, m/s; below `transition_m_s`.
    pub stiction_m_s: f64,
}

impl Default for MotorConfig {
    fn default() -> Self {
        Self {
            force_constant_n_a: 40.0,
            resistance_ohm: 1.2,
            gear_friction: 0.85,
            coulomb_n: 3.0,
            viscous_n_s_m: 20.0,
            transition_m_s: 0.02,
            inertia_kg: 20.0,
            current_limit_a: 15.0,
            stiction: 0.0,
            stiction_m_s: 0.01,
        }
    }
}

impl MotorConfig {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        let positive = "more than zero";
        check("force_constant_n_a", self.force_constant_n_a, positive, |x| x > 0.0)?;
        check("resistance_ohm", self.resistance_ohm, positive, |x| x > 0.0)?;
        check("gear_friction", self.gear_friction, "zero or more", |x| x >= 0.0)?;
        check("coulomb_n", self.coulomb_n, "zero or more newtons", |x| x >= 0.0)?;
        check("viscous_n_s_m", self.viscous_n_s_m, "zero or more N s/m", |x| x >= 0.0)?;
        check("transition_m_s", self.transition_m_s, positive, |x| x > 0.0)?;
        check("inertia_kg", self.inertia_kg, positive, |x| x > 0.0)?;
        check("current_limit_a", self.current_limit_a, positive, |x| x > 0.0)?;
        check("stiction", self.stiction, "zero to two", |x| (0.0..=2.0).contains(&x))?;
        check("stiction_m_s", self.stiction_m_s, positive, |x| x > 0.0)
    }

    /// Steady reel-in speed of a released motor (leads shorted) under `tension_n`, m/s: zero if the gear locks,
    /// negative if the cable runs out.
    pub fn released_speed_m_s(&self, tension_n: f64) -> f64 {
        let drive_n = tension_n - (self.gear_friction * tension_n + self.coulomb_n);
        -drive_n.max(0.0) / (self.viscous_n_s_m + self.force_constant_n_a.powi(2) / self.resistance_ohm)
    }
}

/// State of the bridge at the motor's leads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bridge {
    /// A voltage in the reel-in direction, V.
    Voltage(f64),
    /// Leads shorted: the back-EMF brakes the motor.
    Shorted,
    /// A current in the reel-in direction, A, as far as the supply reaches, V.
    Current {
        /// A.
        wanted_a: f64,
        /// V.
        most_v: f64,
    },
}

/// The rotating parts of one winch.
#[derive(Debug, Clone, PartialEq)]
pub struct Motor {
    config: MotorConfig,
    /// Current limit of the configuration, A; a lower one can be set.
    most_a: f64,
    reel_in_m_s: f64,
    current_a: f64,
    /// Jammed: does not turn with any current.
    pub(crate) jammed: bool,
}

impl Motor {
    /// A motor at rest.
    pub fn new(config: MotorConfig) -> Self {
        Self { config, most_a: config.current_limit_a, reel_in_m_s: 0.0, current_a: 0.0, jammed: false }
    }

    /// Reel-in speed at the bare drum's radius, m/s.
    pub fn reel_in_m_s(&self) -> f64 {
        self.reel_in_m_s
    }

    /// Armature current, A; positive pulls on the line.
    pub fn current_a(&self) -> f64 {
        self.current_a
    }

    /// Voltage at the leads for the present current and speed, V; positive drives reeling in.
    pub(crate) fn voltage_v(&self) -> f64 {
        self.current_a * self.config.resistance_ohm + self.config.force_constant_n_a * self.reel_in_m_s
    }

    /// Sets the drive's current limit, A; never above the initial [`MotorConfig::current_limit_a`].
    pub(crate) fn limit_current(&mut self, limit_a: f64) {
        self.config.current_limit_a = limit_a.min(self.most_a);
    }

    /// Advances by `h` seconds under `load_n`, the cable tension referred to the bare drum (N).
    ///
    /// Linearly implicit in speed, so that a small inertia or a steep friction law does not cause
    /// oscillations. A motor with a voltage has the smooth friction law of the robot file. A released motor, and one
    /// with a current, has dry friction with real sticking: with the smooth law a self-locking gear would creep
    /// forever, and a measured law does not cover standstill.
    pub fn step(&mut self, h: f64, bridge: Bridge, load_n: f64) {
        let MotorConfig { force_constant_n_a: kf, resistance_ohm: r, gear_friction, coulomb_n, viscous_n_s_m, .. } =
            self.config;
        let mut friction_n = gear_friction * load_n + coulomb_n;
        let v = if self.jammed { 0.0 } else { self.reel_in_m_s };
        let mut transition_m_s = self.config.transition_m_s;
        if self.config.stiction > 0.0 {
            // Stribeck's law, which needs a sharp change of sign.
            let slow = v / self.config.stiction_m_s;
            friction_n *= 1.0 + self.config.stiction * libm::exp(-slow * slow);
            transition_m_s *= STICKING;
        }
        match bridge {
            Bridge::Voltage(u) => {
                let limit_a = self.config.current_limit_a;
                let free_a = (u - kf * v) / r;
                self.current_a = free_a.clamp(-limit_a, limit_a);
                let s = libm::tanh(v / transition_m_s);
                let force_n = kf * self.current_a - load_n - friction_n * s - viscous_n_s_m * v;
                let electrical = if free_a.abs() < limit_a { kf * kf / r } else { 0.0 };
                let slope = electrical + friction_n * (1.0 - s * s) / transition_m_s + viscous_n_s_m;
                self.reel_in_m_s = v + h * force_n / (self.config.inertia_kg + h * slope);
            }
            Bridge::Shorted => {
                self.reel_in_m_s = self.slide(h, v, -load_n, friction_n, viscous_n_s_m + kf * kf / r);
                self.current_a = -kf * self.reel_in_m_s / r;
            }
            Bridge::Current { wanted_a, most_v } => {
                let limit_a = self.config.current_limit_a;
                // The back-EMF of a fast motor leaves less of the supply.
                let within_a = wanted_a.max((-most_v - kf * v) / r).min((most_v - kf * v) / r);
                self.current_a = within_a.clamp(-limit_a, limit_a);
                self.reel_in_m_s = self.slide(h, v, kf * self.current_a - load_n, friction_n, viscous_n_s_m);
            }
        }
        if self.jammed {
            self.reel_in_m_s = 0.0;
        }
    }

    /// Speed after `h` seconds under a force and a dry friction, both N, that may hold the motor.
    fn slide(&self, h: f64, v: f64, force_n: f64, friction_n: f64, viscous_n_s_m: f64) -> f64 {
        let effective_kg = self.config.inertia_kg + h * viscous_n_s_m;
        let moving = (self.config.inertia_kg * v + h * force_n) / effective_kg;
        let braking = h * friction_n / effective_kg;
        if moving.abs() <= braking { 0.0 } else { moving - braking * moving.signum() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settle(motor: &mut Motor, bridge: Bridge, load_n: f64) {
        for _ in 0..8000 {
            motor.step(0.000_25, bridge, load_n);
        }
    }

    #[test]
    fn steady_current_is_the_robot_files_law() {
        let config = MotorConfig::default();
        for (u, load_n) in [(12.0, 4.0), (8.0, 20.0), (-6.0, 15.0), (0.3, 9.0), (-0.2, 30.0), (0.35, 10.5)] {
            let mut motor = Motor::new(config);
            settle(&mut motor, Bridge::Voltage(u), load_n);
            let v = motor.reel_in_m_s();
            let s = libm::tanh(v / config.transition_m_s);
            let expected =
                (load_n * (1.0 + config.gear_friction * s) + config.coulomb_n * s + config.viscous_n_s_m * v)
                    / config.force_constant_n_a;
            assert!(
                (motor.current_a() - expected).abs() < 1e-6,
                "u {u} load {load_n}: {} {expected}",
                motor.current_a()
            );
        }
    }

    #[test]
    fn a_locking_gear_holds_and_an_ideal_one_runs_out() {
        let mut locking = Motor::new(MotorConfig::default());
        settle(&mut locking, Bridge::Shorted, 15.0);
        assert_eq!(locking.reel_in_m_s(), 0.0);

        let ideal = MotorConfig { gear_friction: 0.0, coulomb_n: 0.0, viscous_n_s_m: 0.0, ..MotorConfig::default() };
        let mut running = Motor::new(ideal);
        settle(&mut running, Bridge::Shorted, 15.0);
        assert!((running.reel_in_m_s() + 15.0 * 1.2 / 1600.0).abs() < 1e-9);
        assert!((running.reel_in_m_s() - ideal.released_speed_m_s(15.0)).abs() < 1e-9);
    }

    /// With a current the cable stays between the tensions that the gear's friction holds, and moves beyond them.
    #[test]
    fn a_current_holds_within_the_friction_and_yields_beyond_it() {
        let config = MotorConfig { gear_friction: 0.1, coulomb_n: 1.0, ..MotorConfig::default() };
        let bridge = Bridge::Current { wanted_a: 0.25, most_v: 24.0 };
        // 10 N of pull: held from (10 - 1) / 1.1 to (10 + 1) / 0.9 N.
        for (load_n, direction) in [(8.1, 1.0), (8.3, 0.0), (12.1, 0.0), (12.4, -1.0)] {
            let mut motor = Motor::new(config);
            settle(&mut motor, bridge, load_n);
            let v = motor.reel_in_m_s();
            assert!(if direction == 0.0 { v == 0.0 } else { v * direction > 1e-4 }, "{load_n} N: {v} m/s");
            assert_eq!(motor.current_a(), 0.25);
        }
        // Without a load it is as fast as the supply allows, with less current.
        let mut motor = Motor::new(MotorConfig { coulomb_n: 0.0, viscous_n_s_m: 0.0, ..config });
        settle(&mut motor, Bridge::Current { wanted_a: 5.0, most_v: 24.0 }, 0.0);
        assert!((motor.reel_in_m_s() - 24.0 / config.force_constant_n_a).abs() < 1e-2, "{}", motor.reel_in_m_s());
    }

    #[test]
    fn a_released_motor_comes_to_rest_from_speed() {
        let mut motor = Motor::new(MotorConfig::default());
        settle(&mut motor, Bridge::Voltage(10.0), 5.0);
        assert!(motor.reel_in_m_s() > 0.2);
        settle(&mut motor, Bridge::Shorted, 5.0);
        assert_eq!(motor.reel_in_m_s(), 0.0);
    }

    #[test]
    fn a_jammed_motor_draws_its_stall_current() {
        let mut motor = Motor::new(MotorConfig::default());
        motor.jammed = true;
        settle(&mut motor, Bridge::Voltage(6.0), 5.0);
        assert_eq!(motor.reel_in_m_s(), 0.0);
        assert!((motor.current_a() - 5.0).abs() < 1e-12);
        settle(&mut motor, Bridge::Voltage(24.0), 5.0);
        assert!((motor.current_a() - 15.0).abs() < 1e-12, "limited");
    }

    #[test]
    fn a_light_rotor_does_not_ring() {
        let mut motor = Motor::new(MotorConfig { inertia_kg: 0.01, ..MotorConfig::default() });
        let mut last = 0.0;
        for _ in 0..4000 {
            motor.step(0.001, Bridge::Voltage(5.0), 10.0);
            assert!(motor.reel_in_m_s() >= last - 1e-3 && motor.reel_in_m_s() < 0.2);
            last = motor.reel_in_m_s();
        }
    }
}
