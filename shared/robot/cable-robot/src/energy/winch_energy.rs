//! The I²R loss of a move: tension from the pose, current from tension and reel-in speed, Simpson's rule along the
//! path. Tensions in N (distributed by [`crate::tension`]), currents in A, losses in W and J. A pose that the cables
//! cannot hold within their limits is an [`EnergyError`] with the position.
//!
//! ```
//! use cable_robot::{Anchors, Distribution, Vector3, energy::WinchEnergy, motor::Motor, path::Parabola};
//! let anchors = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [4.5, 8.0, 3.0]])?;
//! let motor = Motor::ideal(40.0, 1.2);
//! let winch_energy = WinchEnergy {
//!     anchors: &anchors,
//!     wrench_n: Vector3::new(0.0, 0.0, 19.62),
//!     drag_n_s2_m2: 0.0,
//!     cable_weight_n_m: 0.0,
//!     limits_n: [1.0, 150.0],
//!     method: Distribution::Unique,
//!     current: &motor,
//! };
//! let line = Parabola { from: Vector3::new(4.0, 2.0, 1.0), to: Vector3::new(5.0, 2.0, 1.0), mu_per_m: 0.0 };
//! let cost = winch_energy.constant_speed(&line, 0.2, 32)?;
//! assert!((cost.duration_s - 5.0).abs() < 1e-9 && (cost.length_m - 1.0).abs() < 1e-9);
//! // At twice the speed the move takes half the time, and an ideal motor has the same power loss.
//! let quick = winch_energy.constant_speed(&line, 0.4, 32)?;
//! assert!((quick.energy_j - 0.5 * cost.energy_j).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use nalgebra::Vector3;

use super::parabola::{self, FractionPoint};
use super::{Current, EnergyError};
use crate::path::Parabola;
use crate::profile::Profile;
use crate::tension::{TensionError, hold, worst_violation};
use crate::{Anchors, CableVec, Distribution, Path, Segment, sag};

/// Largest number of Simpson intervals; 64 have an error of 3e-6 with the default motor.
pub const MAX_INTERVALS: usize = 100_000;

/// Cost of a move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    /// Loss in the armatures of all motors, J.
    pub energy_j: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Arc length, m.
    pub length_m: f64,
    /// Highest tension, N.
    pub peak_tension_n: f64,
    /// Highest current of a motor, by magnitude, A.
    pub peak_current_a: f64,
    /// Smallest distance of a tension to a limit, N.
    pub margin_n: f64,
}

impl Cost {
    /// Mean loss, W.
    pub fn mean_power_w(&self) -> f64 {
        if self.duration_s > 0.0 { self.energy_j / self.duration_s } else { 0.0 }
    }
}

/// The properties of a robot that determine the cost of its moves.
pub struct WinchEnergy<'a> {
    /// Anchors with their pulleys, in space or in the x-z plane.
    pub anchors: &'a Anchors,
    /// Force that the cables provide at rest, m g less buoyancy, N.
    pub wrench_n: Vector3<f64>,
    /// Drag of the node divided by its squared speed, N s²/m²; 0 in air.
    pub drag_n_s2_m2: f64,
    /// Weight of the cables, N/m, half of which the node carries; 0 for cables that are too light to matter.
    pub cable_weight_n_m: f64,
    /// Lowest and highest tension, N.
    pub limits_n: [f64; 2],
    /// Tension distribution. A move has to keep the limits with any method.
    pub method: Distribution,
    /// The motors.
    pub current: &'a dyn Current,
}

/// Tensions, currents and loss at one point of a move.
struct InstantCost {
    loss_w: f64,
    tensions_n: CableVec,
    margin_n: f64,
    peak_a: f64,
}

impl WinchEnergy<'_> {
    /// Cost of a parabola at constant speed, quasi-static as in the paper: ∫ R Σ I² dt with dt = |dX/du| / v du, by
    /// Simpson's rule over the horizontal fraction u with an even number of intervals.
    pub fn constant_speed(&self, path: &Parabola, speed_m_s: f64, intervals: usize) -> Result<Cost, EnergyError> {
        parabola::check(path)?;
        check_speed(speed_m_s)?;
        check_intervals(intervals)?;
        self.integrate(path, speed_m_s, intervals)
    }

    /// [`WinchEnergy::constant_speed`] without the check of the arguments.
    pub(super) fn integrate(&self, path: &Parabola, speed_m_s: f64, intervals: usize) -> Result<Cost, EnergyError> {
        self.integrate_by(|u| parabola::at_fraction(path, u), parabola::length_m(path), speed_m_s, intervals)
    }

    /// Like [`WinchEnergy::integrate`] for any path by a fraction u from 0 to 1 with |dX/du| > 0 everywhere,
    /// and its length, m.
    pub(super) fn integrate_by(
        &self,
        at_fraction: impl Fn(f64) -> FractionPoint,
        length_m: f64,
        speed_m_s: f64,
        intervals: usize,
    ) -> Result<Cost, EnergyError> {
        let mut sum = Sum::new();
        for i in 0..=intervals {
            let at = at_fraction(i as f64 / intervals as f64);
            let per_u = at.tangent.norm();
            // |dX/du| > 0 on a vertical parabola too, because its ends are apart.
            let velocity = at.tangent * (speed_m_s / per_u);
            let instant = self.instant(&at.position, &velocity, &self.wrench_n)?;
            sum.add(&instant, weight(i, intervals) * per_u / speed_m_s);
        }
        Ok(sum.cost(3.0 * intervals as f64, length_m / speed_m_s, length_m))
    }

    /// Cost of a path with a speed profile, including the forces that accelerate a node of `mass_kg`. Simpson's rule
    /// over time, in each piece between two knots with at least two of about `intervals` intervals. A dwell costs
    /// its holding current.
    pub fn along_profile(
        &self,
        path: &Path,
        profile: &Profile,
        mass_kg: f64,
        intervals: usize,
    ) -> Result<Cost, EnergyError> {
        check_intervals(intervals)?;
        let segment = Segment { id: 0, path: *path, profile: *profile, start_s: 0.0 };
        let duration_s = profile.duration();
        let mut total = Sum::new();
        let knots = profile.knots();
        if knots.len() < 2 {
            total.add(&self.instant(&path.start(), &Vector3::zeros(), &self.wrench_n)?, duration_s);
        }
        let mut from_s = 0.0;
        let mut walk = path.walk();
        for pair in knots.windows(2) {
            let to_s = profile.time_at(pair[1].s_m);
            let pieces = 2 * (1 + (0.5 * intervals as f64 * (to_s - from_s) / duration_s) as usize);
            for i in 0..=pieces {
                // Each piece has its own acceleration: evaluate its ends just inside the piece.
                let inside = (i as f64 / pieces as f64).clamp(1e-9, 1.0 - 1e-9);
                let setpoint = segment.setpoint_on(&mut walk, from_s + (to_s - from_s) * inside);
                let wrench = self.wrench_n + setpoint.acceleration * mass_kg;
                let instant = self.instant(&setpoint.position, &setpoint.velocity, &wrench)?;
                total.add(&instant, weight(i, pieces) * (to_s - from_s) / (3.0 * pieces as f64));
            }
            from_s = to_s;
        }
        Ok(total.cost(1.0, duration_s, path.length()))
    }

    /// Tensions, currents and loss at a pose in motion, including drag.
    fn instant(
        &self,
        position: &Vector3<f64>,
        velocity_m_s: &Vector3<f64>,
        wrench_n: &Vector3<f64>,
    ) -> Result<InstantCost, EnergyError> {
        let fail = |why| EnergyError::Tension { x: position.x, y: position.y, z: position.z, why };
        let mut wrench_n = wrench_n + velocity_m_s * (self.drag_n_s2_m2 * velocity_m_s.norm());
        if self.cable_weight_n_m != 0.0 {
            wrench_n.z += sag::carried_n(self.anchors, position, self.cable_weight_n_m);
        }
        let held = hold(self.anchors, position, &wrench_n, self.limits_n, self.method).map_err(fail)?;
        if let Some(violation) = worst_violation(&held.tensions_n, self.limits_n) {
            return Err(fail(TensionError::Infeasible(violation)));
        }
        let (mut square, mut peak_a) = (0.0, 0.0f64);
        for (cable, (pulley, tension)) in self.anchors.pulleys().zip(held.tensions_n.iter()).enumerate() {
            // Eyes keep the order of operations that decides the last bit.
            let reel_in = if pulley.radius_m == 0.0 {
                let line = pulley.anchor - position;
                line.dot(velocity_m_s) / line.norm()
            } else {
                let direction = pulley.direction(position).map_err(|_| fail(TensionError::Singular))?;
                -direction.dot(velocity_m_s)
            };
            let current = match self.current.drum(cable) {
                drum if drum.is_bare() => self.current.current_of_a(cable, *tension, reel_in)?,
                drum => {
                    let ratio = drum.radius_ratio(pulley.length_m(position));
                    self.current.current_of_a(cable, tension * ratio, reel_in / ratio)?
                }
            };
            square += current * current;
            peak_a = peak_a.max(current.abs());
        }
        let loss_w = square * self.current.resistance_ohm();
        Ok(InstantCost { loss_w, tensions_n: held.tensions_n, margin_n: held.margin_n, peak_a })
    }
}

/// Simpson weights 1, 4, 2, 4, .., 1.
fn weight(i: usize, intervals: usize) -> f64 {
    if i == 0 || i == intervals {
        1.0
    } else if i % 2 == 1 {
        4.0
    } else {
        2.0
    }
}

struct Sum {
    weighted: f64,
    peak_tension_n: f64,
    peak_current_a: f64,
    margin_n: f64,
}

impl Sum {
    fn new() -> Self {
        Self { weighted: 0.0, peak_tension_n: 0.0, peak_current_a: 0.0, margin_n: f64::INFINITY }
    }

    fn add(&mut self, instant: &InstantCost, weight: f64) {
        self.weighted += weight * instant.loss_w;
        self.peak_tension_n = instant.tensions_n.iter().fold(self.peak_tension_n, |m, t| m.max(*t));
        self.peak_current_a = self.peak_current_a.max(instant.peak_a);
        self.margin_n = self.margin_n.min(instant.margin_n);
    }

    fn cost(&self, divisor: f64, duration_s: f64, length_m: f64) -> Cost {
        Cost {
            energy_j: self.weighted / divisor,
            duration_s,
            length_m,
            peak_tension_n: self.peak_tension_n,
            peak_current_a: self.peak_current_a,
            margin_n: self.margin_n,
        }
    }
}

pub(super) fn check_speed(speed_m_s: f64) -> Result<(), EnergyError> {
    if speed_m_s > 0.0 && speed_m_s <= 1e3 {
        return Ok(());
    }
    let (what, accepted) = ("speed_m_s", "a speed above 0 m/s, at most 1000 m/s");
    Err(EnergyError::InvalidArgument { what, value: speed_m_s, accepted })
}

pub(super) fn check_intervals(intervals: usize) -> Result<(), EnergyError> {
    if (2..=MAX_INTERVALS).contains(&intervals) && intervals.is_multiple_of(2) {
        return Ok(());
    }
    let (what, accepted) = ("intervals", "an even number from 2 to 100000");
    Err(EnergyError::InvalidArgument { what, value: intervals as f64, accepted })
}
