//! The swing of the node on its cables, which encoders cannot measure: while the drums stand still, the node may still
//! move.
//!
//! The lengths give the position of rest x(t), where the forces balance. About it the node y of mass m moves by m
//! d²y/dt² = K (x - y) - c d(y - x)/dt with the stiffness K of [`cable_robot::modes`]. The observer integrates this
//! from the measured x(t) and starts at rest. It knows the swing that motions of the robot excite; wind and hands
//! excite more.

use cable_robot::modes::{Axes, Modes};
use cable_robot::{Matrix3, Robot, Vector3};

/// Damping relative to critical. Ropes of polyethylene and the air damp by one to three percent: the lower one states
/// rather too much swing.
const DAMPING: f64 = 0.01;

/// Longest step of the integration, s. After a longer gap the swing is unknown, and the observer starts at rest.
const LONGEST_STEP_S: f64 = 0.2;

/// Change of the position of rest that no motion explains, m: the lengths were set, or read again after a loss. Twice
/// the way at the present speed is more than a motion makes.
const JUMP_M: f64 = 0.02;

/// Position of rest of one cycle, and what holds the node there.
pub(crate) struct Rest {
    /// Time of the readings, ns.
    pub instant_ns: u64,
    /// Where the forces balance, m.
    pub position_m: Vector3<f64>,
    /// Its velocity, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Force per displacement of the node while the drums stand still, N/m; `None` for rigid cables.
    pub stiffness_n_m: Option<Matrix3<f64>>,
}

/// Swing of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Swing {
    /// Distance from the position of rest that the node reaches with its present energy, m.
    pub amplitude_m: f64,
    /// Mean square of the distance over a period, m².
    pub covariance_m2: Matrix3<f64>,
}

impl Swing {
    const NONE: Self = Self { amplitude_m: 0.0, covariance_m2: Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.) };
}

/// Follows the swing from cycle to cycle.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SwingObserver {
    last: Option<State>,
    /// Axes of the stiffness of the last cycle.
    axes: Axes,
}

#[derive(Debug, Clone, Copy)]
struct State {
    instant_ns: u64,
    /// Position of rest, m.
    rest_m: Vector3<f64>,
    /// Node relative to the position of rest, m.
    offset_m: Vector3<f64>,
    /// Velocity of the node, m/s.
    velocity_m_s: Vector3<f64>,
}

impl SwingObserver {
    /// Starts at rest with the next cycle.
    pub(crate) fn forget(&mut self) {
        *self = Self::default();
    }

    /// Integrates to this cycle, and returns the swing; none for rigid cables and where the cables do not hold the node
    /// in every direction.
    pub(crate) fn step(&mut self, robot: &Robot, rest: &Rest) -> Swing {
        let modes = rest.stiffness_n_m.and_then(|stiffness| Modes::near(robot, &stiffness, &mut self.axes));
        let Some(modes) = modes else {
            self.forget();
            return Swing::NONE;
        };
        let state = self.integrate(&modes, rest);
        self.last = Some(state);
        let relative_m_s = state.velocity_m_s - rest.velocity_m_s;
        let (mut covariance_m2, mut amplitude_sq_m2) = (Matrix3::zeros(), 0.0);
        for mode in modes.iter() {
            let (offset_m, other_m) =
                (mode.direction.dot(&state.offset_m), mode.direction.dot(&relative_m_s) / mode.angular_rad_s);
            let sq_m2 = offset_m * offset_m + other_m * other_m;
            amplitude_sq_m2 += sq_m2;
            covariance_m2 += mode.direction * mode.direction.transpose() * (0.5 * sq_m2);
        }
        Swing { amplitude_m: amplitude_sq_m2.sqrt(), covariance_m2 }
    }

    /// Integrates by the midpoint rule, which keeps the energy of an undamped swing for any step.
    fn integrate(&self, modes: &Modes, rest: &Rest) -> State {
        let at_rest = State {
            instant_ns: rest.instant_ns,
            rest_m: rest.position_m,
            offset_m: Vector3::zeros(),
            velocity_m_s: rest.velocity_m_s,
        };
        let Some(last) = self.last else { return at_rest };
        let step_s = rest.instant_ns.saturating_sub(last.instant_ns) as f64 * 1e-9;
        if !(step_s > 0.0 && step_s <= LONGEST_STEP_S) {
            return if step_s > 0.0 { at_rest } else { last };
        }
        let fastest_m_s = last.velocity_m_s.norm().max(rest.velocity_m_s.norm());
        if (rest.position_m - last.rest_m).norm() > JUMP_M + 2.0 * step_s * fastest_m_s {
            return at_rest;
        }
        // In each mode: the mean offset q and velocity w of the step obey
        // w = w0 + h/2 (-ω² q - 2 ζ ω (w - s)), q = q0 + h/2 (w - s), with the velocity s of the position of rest.
        let rest_m_s = (rest.position_m - last.rest_m) / step_s;
        let half_s = 0.5 * step_s;
        let (mut offset_m, mut velocity_m_s) = (last.offset_m, last.velocity_m_s);
        for mode in modes.iter() {
            let along = |v: &Vector3<f64>| mode.direction.dot(v);
            let (q, w, s) = (along(&last.offset_m), along(&last.velocity_m_s), along(&rest_m_s));
            let (square, damping) = (mode.angular_rad_s * mode.angular_rad_s, 2.0 * DAMPING * mode.angular_rad_s);
            let relative = (w - s - half_s * square * q) / (1.0 + half_s * damping + half_s * half_s * square);
            offset_m += mode.direction * (step_s * relative);
            velocity_m_s += mode.direction * (2.0 * (relative + s - w));
        }
        State { instant_ns: rest.instant_ns, rest_m: rest.position_m, offset_m, velocity_m_s }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use cable_robot::modes::stiffness_n_m;
    use cable_robot::{RobotParts, elastic};

    const STEP_NS: u64 = 10_000_000;

    fn robot() -> Robot {
        Robot::new(RobotParts {
            anchors_m: vec![[0.0, 0.0, 20.0], [80.0, 0.0, 21.0], [80.0, 20.0, 20.0], [0.0, 20.0, 21.0]],
            node_mass_kg: 5.0,
            tension_limits_n: [5.0, 400.0],
            speed_limit_m_s: 0.5,
            acceleration_limit_m_s2: 0.3,
            stiffness_n: Some(12_000.0),
            routed_length_m: Some(vec![10.0; 4]),
            ..RobotParts::default()
        })
        .unwrap()
    }

    /// Steps with a position of rest that moves from a place along a direction by a distance that depends on time, m.
    fn swings(direction: Vector3<f64>, seconds: f64, distance: impl Fn(f64) -> f64) -> (Modes, Vec<Swing>) {
        let (robot, start) = (robot(), Vector3::new(30.0, 8.0, 8.0));
        let tensions = elastic::realise(&robot, &start, &Vector3::zeros(), robot.default_distribution()).unwrap();
        let modes = Modes::at(&robot, &start, &tensions.tensions_n).unwrap();
        let mut observer = SwingObserver::default();
        let step = |cycle: u64| {
            let time_s = cycle as f64 * 0.01;
            let velocity_m_s = direction * ((distance(time_s + 1e-6) - distance(time_s - 1e-6)) / 2e-6);
            let position_m = start + direction * distance(time_s);
            let stiffness_n_m = stiffness_n_m(&robot, &position_m, &tensions.tensions_n);
            let rest = Rest { instant_ns: cycle * STEP_NS, position_m, velocity_m_s, stiffness_n_m };
            observer.step(&robot, &rest)
        };
        (modes, (1..=(seconds * 100.0) as u64).map(step).collect())
    }

    #[test]
    fn a_node_that_stands_or_moves_evenly_does_not_swing() {
        for speed_m_s in [0.0, 0.4] {
            let (_, swings) = swings(Vector3::x(), 5.0, |t| speed_m_s * t);
            assert!(swings.iter().all(|swing| swing.amplitude_m < 1e-6), "{speed_m_s}: {:?}", swings.last());
        }
    }

    /// A motion that stops at once leaves the amplitude v / ω in each mode, which decays with its damping.
    #[test]
    fn a_sudden_stop_leaves_the_swing_of_its_speed() {
        let (speed_m_s, stop_s) = (0.2, 1.0);
        let (modes, _) = swings(Vector3::x(), 0.01, |t| t);
        for mode in modes.iter() {
            let (_, swings) = swings(mode.direction, 7.0, |t: f64| speed_m_s * t.min(stop_s));
            for (cycle, swing) in swings.iter().enumerate().skip(110) {
                let since_s = (cycle + 1) as f64 * 0.01 - stop_s;
                let expected_m = speed_m_s / mode.angular_rad_s * (-DAMPING * mode.angular_rad_s * since_s).exp();
                assert!((swing.amplitude_m / expected_m - 1.0).abs() < 0.06, "{since_s} s: {swing:?}, {expected_m} m");
                let variance_m2 = mode.direction.dot(&(swing.covariance_m2 * mode.direction));
                assert!((2.0 * variance_m2 - swing.amplitude_m.powi(2)).abs() < 0.02 * variance_m2);
            }
        }
    }

    #[test]
    fn a_gap_starts_at_rest_again() {
        let (robot, start) = (robot(), Vector3::new(30.0, 8.0, 8.0));
        let tensions = elastic::realise(&robot, &start, &Vector3::zeros(), robot.default_distribution()).unwrap();
        let mut observer = SwingObserver::default();
        let mut at = |instant_ns, x_m| {
            let position_m = start + Vector3::new(x_m, 0.0, 0.0);
            let velocity_m_s = Vector3::zeros();
            let stiffness_n_m = stiffness_n_m(&robot, &position_m, &tensions.tensions_n);
            observer.step(&robot, &Rest { instant_ns, position_m, velocity_m_s, stiffness_n_m })
        };
        assert_eq!(at(STEP_NS, 0.0), Swing::NONE);
        assert!(at(2 * STEP_NS, 0.015).amplitude_m > 0.01);
        assert_eq!(at(2 * STEP_NS + 1_000_000_000, 0.02), Swing::NONE);
        // Nor does a place of rest that no motion explains make the node swing.
        assert_eq!(at(3 * STEP_NS + 1_000_000_000, 0.12), Swing::NONE);
    }
}
