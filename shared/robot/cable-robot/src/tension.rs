//! Distribution of the force on the node over the cables: (15)-(16), (27)-(43).
//!
//! As many cables as directions have one solution. Four cables in space have a line of solutions, T = Tp + λ N / |N|,
//! with the null vector N_k = (-1)^k det(Λ without column k) and the least-norm solution Tp; the limits cut an interval
//! out of it. This is equivalent to the paper's elimination of one cable, without its division by a determinant that
//! may vanish. More cables, and planar robots with more than two, are solved by an active set method, which takes
//! finitely many steps for any number of cables.
//!
//! Λ is 3 x N; its columns are unit vectors from the node to the anchors. The wrench b = m (a + g) of (15) and tensions
//! are in N. A [`TensionError`] gives the reason and, where limits are violated, the cable.

mod distribution;
pub mod general;
mod hold;
mod nearest;

use nalgebra::Vector3;

pub use distribution::{Distribution, TensionError, Tensions, UnknownDistribution, Violation, margin, worst_violation};
use distribution::{TOLERANCE, check_limits, check_wrench};
pub use hold::hold;

use crate::kinematics::StructureMatrix;
use crate::linalg::closed::{Four, null_vector};
use crate::{CableVec, Robot, linalg};

/// Tensions of a robot at a position with an acceleration: b = m (a + g), within the robot's limits.
pub fn at(
    robot: &Robot,
    position: &Vector3<f64>,
    acceleration_m_s2: &Vector3<f64>,
    method: Distribution,
) -> Result<Tensions, TensionError> {
    for_wrench(robot, position, &robot.wrench_n(acceleration_m_s2), method)
}

/// Tensions of a robot at a position for any force that the cables provide together, N, within the robot's limits.
/// Cables with weight carry half of it in addition.
#[inline]
pub fn for_wrench(
    robot: &Robot,
    position: &Vector3<f64>,
    wrench_n: &Vector3<f64>,
    method: Distribution,
) -> Result<Tensions, TensionError> {
    let structure = StructureMatrix::at(robot.anchors(), position)?;
    distribute(&structure, &robot.with_cables_n(position, wrench_n), robot.tension_limits_n(), method)
}

/// Acceleration of the node with these tensions (16), m/s², without drag.
pub fn node_acceleration(robot: &Robot, structure: &StructureMatrix, tensions_n: &[f64]) -> Vector3<f64> {
    (structure.force(tensions_n) - robot.wrench_n(&Vector3::zeros())) / robot.node_mass_kg()
}

/// The unique tensions of as many cables as directions (15), N, without limits.
pub fn unique(structure: &StructureMatrix, wrench_n: &Vector3<f64>) -> Result<CableVec, TensionError> {
    if structure.len() != structure.dimensions() {
        let accepted = "three cables, or two in a plane";
        return Err(TensionError::Method { method: Distribution::Unique, cables: structure.len(), accepted });
    }
    least_norm_unbounded(structure, wrench_n)
}

/// Λᵀ(ΛΛᵀ)⁻¹b: the least norm without limits (38), N. For as many cables as directions, the unique solution.
pub fn least_norm_unbounded(structure: &StructureMatrix, wrench_n: &Vector3<f64>) -> Result<CableVec, TensionError> {
    linalg::shortest(structure, structure.is_planar(), wrench_n).ok_or(TensionError::Singular)
}

/// Computes tensions within `limits_n` = [min, max] whose forces add up to the wrench, N.
///
/// ```
/// use cable_robot::Anchors;
/// use cable_robot::Distribution;
/// use cable_robot::StructureMatrix;
/// use cable_robot::Vector3;
/// use cable_robot::tension;
/// let anchors = Anchors::new(&[[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]])?;
/// let structure = StructureMatrix::at(&anchors, &Vector3::new(3.0, 4.0, 2.0))?;
/// let weight = Vector3::new(0.0, 0.0, 19.6);
/// let least = tension::distribute(&structure, &weight, [1.0, 150.0], Distribution::LeastNorm)?;
/// let sum = tension::distribute(&structure, &weight, [1.0, 150.0], Distribution::MinSum)?;
/// assert!(least.tensions_n.norm_squared() <= sum.tensions_n.norm_squared());
/// assert!(sum.tensions_n.sum() <= least.tensions_n.sum());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn distribute(
    structure: &StructureMatrix,
    wrench_n: &Vector3<f64>,
    limits_n: [f64; 2],
    method: Distribution,
) -> Result<Tensions, TensionError> {
    check_arguments(wrench_n, limits_n)?;
    let (n, directions) = (structure.len(), structure.dimensions());
    let wrong = |accepted| Err(TensionError::Method { method, cables: n, accepted });
    let tensions_n = match (n, method) {
        _ if n < directions => return wrong("any with at least as many cables as directions, three or two in a plane"),
        _ if n == directions => {
            let t = unique(structure, wrench_n)?;
            match worst_violation(&t, limits_n) {
                Some(violation) => return Err(TensionError::Infeasible(violation)),
                None => t,
            }
        }
        (_, Distribution::Unique) => return wrong("least-norm, min-sum or safest"),
        (4, _) if !structure.is_planar() => {
            let all = Line::new(structure, wrench_n)?;
            match method {
                Distribution::MinSum => FourCables::within(&all, limits_n)?.min_sum(),
                Distribution::Safest => FourCables::within(&all, limits_n)?.safest(),
                // Mostly the shortest of all solutions keeps the limits.
                _ if all.particular_n.iter().all(|t| (limits_n[0]..=limits_n[1]).contains(t)) => {
                    CableVec::from_array(all.particular_n)
                }
                _ => FourCables::within(&all, limits_n)?.least_norm(),
            }
        }
        _ => {
            let forces = general::forces(structure, wrench_n);
            general::distribute(&structure.into(), &forces[..directions], limits_n, method)?.tensions_n
        }
    };
    Ok(Tensions { tensions_n, margin_n: margin(&tensions_n, limits_n) })
}

fn check_arguments(wrench_n: &Vector3<f64>, limits_n: [f64; 2]) -> Result<(), TensionError> {
    check_limits(limits_n)?;
    check_wrench(wrench_n.as_slice())
}

/// All solutions of four cables: T = particular + λ null / |null|.
struct Line {
    /// The shortest solution, N.
    particular_n: [f64; 4],
    /// A null vector of the structure matrix, and its square.
    null: [f64; 4],
    square: f64,
}

impl Line {
    fn new(structure: &StructureMatrix, wrench_n: &Vector3<f64>) -> Result<Self, TensionError> {
        let columns = structure.first_chunk().filter(|_| structure.len() == 4 && !structure.is_planar());
        let (method, cables, accepted) = (Distribution::LeastNorm, structure.len(), "four cables in space");
        let columns = columns.ok_or(TensionError::Method { method, cables, accepted })?;
        if let Some(four) = Four::of(columns) {
            return Ok(Self { particular_n: four.shortest(wrench_n), null: four.null, square: four.square });
        }
        let (null, found_n) = (null_vector(columns), least_norm_unbounded(structure, wrench_n)?);
        let square = null.iter().map(|v| v * v).sum();
        Ok(Self { particular_n: std::array::from_fn(|i| found_n[i]), null, square })
    }
}

/// All solutions of four cables within their limits: T = particular + λ direction, low ≤ λ ≤ high.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FourCables {
    /// The least-norm solution without limits, orthogonal to the direction, N.
    pub particular_n: CableVec,
    /// The unit null vector of the structure matrix.
    pub direction: CableVec,
    /// Lowest λ, N.
    pub low_n: f64,
    /// Highest λ, N; may be infinite.
    pub high_n: f64,
    limits_n: [f64; 2],
}

impl FourCables {
    /// Computes the line of solutions and the interval (34) within the limits.
    pub fn new(structure: &StructureMatrix, wrench_n: &Vector3<f64>, limits_n: [f64; 2]) -> Result<Self, TensionError> {
        check_arguments(wrench_n, limits_n)?;
        Self::within(&Line::new(structure, wrench_n)?, limits_n)
    }

    fn within(all: &Line, limits_n: [f64; 2]) -> Result<Self, TensionError> {
        let (particular_n, per_length) = (all.particular_n, 1.0 / all.square.sqrt());
        let direction = all.null.map(|v| v * per_length);
        let [min, max] = limits_n;
        let scale = particular_n.iter().fold(min.max(1.0), |most, t| most.max(t.abs()));
        let (mut low_n, mut high_n) = (f64::NEG_INFINITY, f64::INFINITY);
        for (t, d) in particular_n.iter().zip(&direction) {
            if d.abs() < 1e-12 {
                // The tension of this cable does not depend on λ: it gives no bound, only a test.
                if *t < min - TOLERANCE * scale || *t > max + TOLERANCE * scale {
                    (low_n, high_n) = (f64::INFINITY, f64::NEG_INFINITY);
                }
                continue;
            }
            let per_d = 1.0 / d;
            let (a, b) = ((min - t) * per_d, (max - t) * per_d);
            low_n = low_n.max(a.min(b));
            high_n = high_n.min(a.max(b));
        }
        if low_n > high_n && low_n - high_n <= TOLERANCE * scale {
            let middle = 0.5 * (low_n + high_n);
            (low_n, high_n) = (middle, middle);
        }
        let (particular_n, direction) = (CableVec::from_array(particular_n), CableVec::from_array(direction));
        let line = Self { particular_n, direction, low_n, high_n, limits_n };
        // Also true for NaN.
        if !(low_n <= high_n) {
            return Err(TensionError::Infeasible(line.least_violation()));
        }
        Ok(line)
    }

    /// The tensions at λ, N.
    pub fn at(&self, lambda_n: f64) -> CableVec {
        self.particular_n.zip_map(&self.direction, |t, d| t + lambda_n * d)
    }

    /// The least norm: λ = 0, or the end of the interval nearest to it (36).
    pub fn least_norm(&self) -> CableVec {
        self.at(0.0f64.clamp(self.low_n, self.high_n))
    }

    /// The least sum: the end of the interval given by the sign of c of (37); the least norm if the sum is constant.
    pub fn min_sum(&self) -> CableVec {
        let c = self.direction.sum();
        let lambda = if c > 1e-12 {
            self.low_n
        } else if c < -1e-12 {
            self.high_n
        } else {
            return self.least_norm();
        };
        // Without an upper tension limit an end may be infinite, but only where the sum grows towards it.
        if lambda.is_finite() { self.at(lambda) } else { self.least_norm() }
    }

    /// The greatest distance to the nearest limit; the least norm if that distance is unbounded.
    pub fn safest(&self) -> CableVec {
        match self.most_even() {
            Some((lambda, _)) => self.at(lambda.clamp(self.low_n, self.high_n)),
            None => self.least_norm(),
        }
    }

    /// Tension of the last cable at both ends of the interval (34) in rising order, N.
    pub fn interval_of_last_n(&self) -> [f64; 2] {
        let last = |lambda: f64| {
            let d = self.direction[3];
            if d == 0.0 { self.particular_n[3] } else { self.particular_n[3] + lambda * d }
        };
        let (a, b) = (last(self.low_n), last(self.high_n));
        [a.min(b), a.max(b)]
    }

    /// c of (37): derivative of the sum of tensions with respect to the tension of the last cable. Infinite if the
    /// tension of the last cable is fixed.
    pub fn c(&self) -> f64 {
        self.direction.sum() / self.direction[3]
    }

    /// λ that maximises the smallest distance to a limit, and that distance. A concave piecewise linear function has
    /// its maximum where a rising and a falling piece meet; with eight pieces all pairs are tried.
    fn most_even(&self) -> Option<(f64, f64)> {
        let mut pieces = [(0.0, 0.0); 8];
        let mut count = 0;
        for (t, d) in self.particular_n.iter().zip(self.direction.iter()) {
            pieces[count] = (t - self.limits_n[0], *d);
            count += 1;
            if self.limits_n[1].is_finite() {
                pieces[count] = (self.limits_n[1] - t, -d);
                count += 1;
            }
        }
        let pieces = &pieces[..count];
        let mut best: Option<(f64, f64)> = None;
        for (p0, d0) in pieces.iter().filter(|p| p.1 > 0.0) {
            for (p1, d1) in pieces.iter().filter(|p| p.1 <= 0.0) {
                let lambda = (p1 - p0) / (d0 - d1);
                let least = pieces.iter().fold(f64::INFINITY, |m, (p, d)| m.min(p + lambda * d));
                // The maximum is a plateau if one cable does not depend on λ: take its point of least norm.
                let better = best.is_none_or(|(at, value)| {
                    least > value + 1e-12 || (least > value - 1e-12 && lambda.abs() < at.abs())
                });
                if least.is_finite() && better {
                    best = Some((lambda, least));
                }
            }
        }
        best
    }

    fn least_violation(&self) -> Violation {
        let lambda = self.most_even().map_or(0.0, |(lambda, _)| lambda);
        let tensions = self.at(lambda);
        // With the most even excess at least two cables miss by the same amount; report the first.
        worst_violation(&tensions, self.limits_n).unwrap_or(Violation {
            cable: 0,
            tension_n: tensions[0],
            limit_n: self.limits_n[0],
        })
    }
}

/// Least norm within limits for any number of cables (27), also of a planar robot.
pub fn least_norm(
    structure: &StructureMatrix,
    wrench_n: &Vector3<f64>,
    limits_n: [f64; 2],
) -> Result<CableVec, TensionError> {
    check_arguments(wrench_n, limits_n)?;
    general::least_norm(&structure.into(), &general::forces(structure, wrench_n)[..structure.dimensions()], limits_n)
}
