//! Lines that stretch. The measured length l is unstretched line paid out beyond the routed part Lx; with the stiffness
//! EA, straight-line length L and tension T belong together by (L + Lx) = (l + Lx)(1 + T / EA). Rigid lines: l = L.
//!
//! Lengths and positions in m, tensions and EA in N; one entry per cable. Accelerations enter with (15)-(16), the choice of tensions
//! with (27)-(37). A pose that nothing holds is a [`crate::tension::TensionError`], lengths that no equilibrium has an [`ElasticError`].

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::kinematics::{
    Jacobian, KinematicsError, LONGEST_M, NodeJacobian, StructureMatrix, forward_kinematics, inverse_kinematics,
};
use crate::tension::{self, TensionError};
use crate::{CableVec, Distribution, MAX_CABLES, Robot, linalg};

/// Coordinates (m) and forces (N) beyond this are a wrong unit or an error.
const LARGEST: f64 = 1e6;

/// Bound of the equilibrium iteration; from the last cycle's position it needs two or three.
const MAX_ITERATIONS: usize = 100;

/// Measured lengths that stretch to these straight-line lengths under these tensions, m; as many as the robot has cables.
pub fn unstretched(robot: &Robot, lengths_m: &[f64], tensions_n: &[f64]) -> CableVec {
    let routed = robot.routed_length_m();
    CableVec::from_fn(routed.len().min(lengths_m.len()).min(tensions_n.len()), |i| match robot.stiffness_n() {
        None => lengths_m[i],
        Some(ea) => (lengths_m[i] + routed[i]) / (1.0 + tensions_n[i] / ea) - routed[i],
    })
}

/// Straight-line lengths to which these measured lengths stretch under these tensions, m; as many as the robot has cables.
pub fn stretched(robot: &Robot, unstretched_m: &[f64], tensions_n: &[f64]) -> CableVec {
    let routed = robot.routed_length_m();
    CableVec::from_fn(routed.len().min(unstretched_m.len()).min(tensions_n.len()), |i| match robot.stiffness_n() {
        None => unstretched_m[i],
        Some(ea) => (unstretched_m[i] + routed[i]) * (1.0 + tensions_n[i] / ea) - routed[i],
    })
}

/// What the winches have to hold so that the node is at a position with a chosen distribution of tension.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Realisation {
    /// Measured (unstretched) lengths, m: what is commanded.
    pub unstretched_m: CableVec,
    /// Straight-line lengths, m.
    pub lengths_m: CableVec,
    /// Tensions, N.
    pub tensions_n: CableVec,
}

/// Measured lengths that put the node at a position, accelerating, with the chosen distribution.
///
/// ```
/// use cable_robot::*;
/// # let robot = Robot::new(RobotParts {
/// #     anchors_m: vec![[0.0, 0.0, 6.0], [10.0, 0.0, 6.1], [10.2, 9.8, 6.2], [0.0, 10.0, 5.9]], node_mass_kg: 2.0,
/// #     tension_limits_n: [1.0, 150.0], speed_limit_m_s: 0.4, acceleration_limit_m_s2: 0.5,
/// #     stiffness_n: Some(6000.0), routed_length_m: Some(vec![6.0; 4]), ..RobotParts::default()
/// # })?;
/// let position = Vector3::new(4.0, 4.5, 1.5);
/// let held = elastic::realise(&robot, &position, &Vector3::zeros(), Distribution::LeastNorm)?;
/// let hangs = elastic::equilibrium(&robot, &held.unstretched_m, &Vector3::zeros(), None)?;
/// assert!((hangs.position - position).norm() < 1e-7);
/// assert!((hangs.tensions_n[0] - held.tensions_n[0]).abs() < 1e-5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn realise(
    robot: &Robot,
    position: &Vector3<f64>,
    acceleration_m_s2: &Vector3<f64>,
    distribution: Distribution,
) -> Result<Realisation, TensionError> {
    realise_under(robot, position, &robot.wrench_n(acceleration_m_s2), distribution)
}

/// The same under any force that the lines have to provide together, N: with the drag of a node that moves, say.
pub fn realise_under(
    robot: &Robot,
    position: &Vector3<f64>,
    wrench_n: &Vector3<f64>,
    distribution: Distribution,
) -> Result<Realisation, TensionError> {
    let tensions_n = tension::under(robot, position, wrench_n, distribution)?.tensions_n;
    let lengths_m = inverse_kinematics(robot.anchors(), position);
    Ok(Realisation { unstretched_m: unstretched(robot, &lengths_m, &tensions_n), lengths_m, tensions_n })
}

/// No equilibrium found.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ElasticError {
    /// The rigid case failed.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
    /// A measured length leaves no line to stretch.
    #[error("cable {} has a measured length of {length_m} m, which with its routed part is no line; check the lengths", cable + 1)]
    NoLine {
        /// Index of the cable, from 0.
        cable: usize,
        /// The measured length, m.
        length_m: f64,
    },
    /// The guess or the force on the node is not a number, or no force or position on Earth.
    #[error("{what} is not finite or beyond 1e6; give numbers in SI units")]
    NotFinite {
        /// Which.
        what: &'static str,
    },
    /// The iteration ended short of balance.
    #[error(
        "no equilibrium found in {MAX_ITERATIONS} iterations: {residual_n:.3e} N are out of balance; check lengths and stiffness"
    )]
    NotConverged {
        /// Force out of balance, N.
        residual_n: f64,
    },
}

/// Where the node hangs with measured lengths given, and how the lines pull there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Equilibrium {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Tensions, N; 0 for a slack line.
    pub tensions_n: CableVec,
    /// Straight-line lengths, m.
    pub lengths_m: CableVec,
    /// Which lines are slack; unused ones are false.
    pub slack: [bool; MAX_CABLES],
    /// Elastic lines: force out of balance, N. Rigid lines: RMS of the lengths that do not fit, m.
    pub residual: f64,
    /// Newton steps taken from the start that led here; 0 for rigid lines.
    pub iterations: usize,
    /// How the position follows the measured lengths, dX/dl, 3 x N; zero columns for slack lines.
    pub sensitivity: NodeJacobian,
}

impl Equilibrium {
    /// Covariance of the position, m², for independent errors of the measured lengths of these standard deviations, m.
    pub fn covariance(&self, sigma_length_m: &[f64]) -> Matrix3<f64> {
        self.sensitivity.covariance(sigma_length_m)
    }

    /// Covariance of the position, m², that the anchors' own covariance brings with it: Σ B_i B_j' (e_i' C_ij e_j) with the
    /// lines' unit vectors e. The same in every cycle, so that no averaging removes it; None if the robot's calibration states
    /// none. That elastic lines turn with their anchors is neglected: a few percent of the deviation, a sixth close below the
    /// anchors. Where the position was told (and the lengths reckoned from it) the true error is smaller.
    pub fn covariance_by_anchors(&self, robot: &Robot) -> Option<Matrix3<f64>> {
        let anchors = robot.anchors();
        let mut sum = Matrix3::zeros();
        for (i, column_i) in self.sensitivity.iter().enumerate() {
            for (j, column_j) in self.sensitivity.iter().enumerate() {
                let between = robot.anchor_covariance_m2(i, j)?;
                let unit = |k: usize| (self.position - anchors[k]).normalize();
                sum += linalg::outer(column_i, column_j) * unit(i).dot(&(between * unit(j)));
            }
        }
        Some(sum)
    }

    /// True if any line is slack.
    pub fn any_slack(&self) -> bool {
        self.slack.iter().any(|s| *s)
    }
}

/// The elastic equilibrium: the position at which Σ T_i (-u_i) = m (g + a), T_i = max(0, EA ((L_i + Lx)/(l_i + Lx) - 1)).
///
/// It is the minimum of a convex potential (a stretched line's energy grows convexly with the position, and lines cannot
/// push), so it is unique wherever lines are taut in every direction, and damped Newton finds it from anywhere; `guess` (the
/// last cycle's position) saves steps. For rigid lines it is forward kinematics near the guess, with the unique or the
/// least-norm tensions.
pub fn equilibrium(
    robot: &Robot,
    unstretched_m: &[f64],
    acceleration_m_s2: &Vector3<f64>,
    guess: Option<&Vector3<f64>>,
) -> Result<Equilibrium, ElasticError> {
    equilibrium_under(robot, unstretched_m, &robot.wrench_n(acceleration_m_s2), guess)
}

/// The same under any force that the lines provide together, N: with the drag of a node that moves, say.
pub fn equilibrium_under(
    robot: &Robot,
    unstretched_m: &[f64],
    wrench_n: &Vector3<f64>,
    guess: Option<&Vector3<f64>>,
) -> Result<Equilibrium, ElasticError> {
    let n = robot.cable_count();
    if unstretched_m.len() != n {
        return Err(KinematicsError::WrongCount { given: unstretched_m.len(), cables: n }.into());
    }
    if !wrench_n.iter().all(|v| v.abs() <= LARGEST) {
        return Err(ElasticError::NotFinite { what: "the force on the node" });
    }
    if guess.is_some_and(|g| !g.iter().all(|v| v.abs() <= LARGEST)) {
        return Err(ElasticError::NotFinite { what: "the guess of the position" });
    }
    let Some(stiffness) = robot.stiffness_n() else {
        return rigid(robot, unstretched_m, wrench_n, guess);
    };
    for (cable, (l, routed)) in unstretched_m.iter().zip(robot.routed_length_m().iter()).enumerate() {
        if !(*l > 0.0 && *l <= LONGEST_M && l + routed > 1e-3) {
            return Err(ElasticError::NoLine { cable, length_m: *l });
        }
    }
    let mut wrench = *wrench_n;
    if robot.is_planar() {
        wrench.y = 0.0;
    }
    let lines = Lines { robot, unstretched_m, stiffness, wrench };
    let found = lines.balance(lines.start(guess));
    // A guess far away from very stiff lines can cost more steps than there are; the lengths themselves know better.
    if found.is_err() && guess.is_some() { lines.balance(lines.start(None)) } else { found }
}

struct Lines<'a> {
    robot: &'a Robot,
    unstretched_m: &'a [f64],
    stiffness: f64,
    wrench: Vector3<f64>,
}

struct Balance {
    /// Gradient of the potential: minus the force out of balance, N.
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
    potential: f64,
}

impl Lines<'_> {
    /// From a guess, or from where the rigid lines would meet, or below the middle of the anchors.
    fn start(&self, guess: Option<&Vector3<f64>>) -> Vector3<f64> {
        if let Some(guess) = guess {
            let y = if self.robot.is_planar() { 0.0 } else { guess.y };
            return Vector3::new(guess.x, y, guess.z);
        }
        let anchors = self.robot.anchors();
        if let Ok(found) = forward_kinematics(anchors, self.unstretched_m, None) {
            return found.position;
        }
        let middle = anchors.iter().fold(Vector3::zeros(), |sum, a| sum + a) / anchors.len() as f64;
        let longest = self.unstretched_m.iter().fold(0.0, |m: f64, l| m.max(*l));
        middle - Vector3::new(0.0, 0.0, 0.5 * longest)
    }

    /// Unstretched line from drum to node, and how much longer than it the straight line with the routed part is.
    fn line(&self, i: usize, x: &Vector3<f64>) -> (f64, f64, Vector3<f64>, f64) {
        let d = x - self.robot.anchors()[i];
        let length = d.norm();
        let u = if length > 0.0 { d / length } else { Vector3::zeros() };
        let total = self.unstretched_m[i] + self.robot.routed_length_m()[i];
        // The routed part cancels: L + Lx - (l + Lx).
        (total, length - self.unstretched_m[i], u, length)
    }

    fn at(&self, x: &Vector3<f64>) -> Balance {
        let mut balance = Balance { gradient: self.wrench, hessian: Matrix3::zeros(), potential: self.wrench.dot(x) };
        for i in 0..self.robot.cable_count() {
            let (total, stretch, u, length) = self.line(i, x);
            if stretch <= 0.0 || length == 0.0 {
                continue;
            }
            let k = self.stiffness / total;
            let tension = k * stretch;
            balance.potential += 0.5 * tension * stretch;
            balance.gradient += u * tension;
            let across = tension / length;
            balance.hessian += linalg::outer(&u, &u) * (k - across) + Matrix3::identity() * across;
        }
        balance
    }

    fn balance(&self, start: Vector3<f64>) -> Result<Equilibrium, ElasticError> {
        let anchors = self.robot.anchors();
        // Forces are differences of lengths times stiffness, so their rounding grows with both.
        let longest = self.unstretched_m.iter().fold(1.0, |m: f64, l| m.max(*l));
        let tolerance = 1e-10 * (1.0 + self.wrench.norm()) + 1e-15 * self.stiffness * longest;
        let softest = (0..anchors.len()).fold(f64::INFINITY, |m, i| m.min(self.stiffness / self.line(i, &start).0));
        let mut x = start;
        let mut now = self.at(&x);
        let mut damping = 0.0;
        let mut iterations = 0;
        while now.gradient.norm() > tolerance && iterations < MAX_ITERATIONS {
            iterations += 1;
            // A node that hangs on fewer taut lines than there are directions has soft directions: damped, it falls until one is taut.
            let floor = if damping > 0.0 { damping } else { 1e-12 * softest };
            let Some(mut step) = linalg::solve_spd(&(now.hessian + Matrix3::identity() * floor), &now.gradient) else {
                damping = (10.0 * damping).max(1e-6 * softest);
                continue;
            };
            // No step beyond the size of the machine.
            if step.norm() > longest {
                step *= longest / step.norm();
            }
            let mut share = 1.0;
            let mut accepted = false;
            for _ in 0..30 {
                let next = x - step * share;
                let there = self.at(&next);
                // Near the end the potential drowns in its own rounding: then the gradient decides.
                let falls = there.potential <= now.potential - 1e-4 * share * now.gradient.dot(&step);
                if falls || there.gradient.norm() < 0.5 * now.gradient.norm() {
                    (x, now, accepted) = (next, there, true);
                    break;
                }
                share *= 0.5;
            }
            if !accepted {
                if damping > 1e6 * softest {
                    break;
                }
                damping = (10.0 * damping).max(1e-6 * softest);
            } else {
                damping = if damping > 1e-9 * softest { 0.1 * damping } else { 0.0 };
            }
        }
        let residual = now.gradient.norm();
        // Also true for NaN.
        if !(residual <= 1e3 * tolerance) {
            return Err(ElasticError::NotConverged { residual_n: residual });
        }
        Ok(self.describe(x, &now, iterations))
    }

    fn describe(&self, x: Vector3<f64>, balance: &Balance, iterations: usize) -> Equilibrium {
        let n = self.robot.cable_count();
        let mut slack = [false; MAX_CABLES];
        let mut columns = [Vector3::zeros(); MAX_CABLES];
        let mut tensions_n = CableVec::zeros(n);
        let mut lengths_m = CableVec::zeros(n);
        for i in 0..n {
            let (total, stretch, u, length) = self.line(i, &x);
            lengths_m[i] = length;
            slack[i] = stretch <= 0.0;
            if !slack[i] {
                tensions_n[i] = self.stiffness * stretch / total;
                // H dX = u (-dT/dl) dl, with dT/dl = -EA (L + Lx) / (l + Lx)².
                let pull = self.stiffness * (total + stretch) / (total * total);
                columns[i] = linalg::solve_spd(&balance.hessian, &(u * pull)).unwrap_or_else(Vector3::zeros);
            }
        }
        Equilibrium {
            position: x,
            tensions_n,
            lengths_m,
            slack,
            residual: balance.gradient.norm(),
            iterations,
            sensitivity: NodeJacobian { columns, len: n, planar: self.robot.is_planar() },
        }
    }
}

fn rigid(
    robot: &Robot,
    lengths_m: &[f64],
    wrench_n: &Vector3<f64>,
    guess: Option<&Vector3<f64>>,
) -> Result<Equilibrium, ElasticError> {
    let anchors = robot.anchors();
    let found = forward_kinematics(anchors, lengths_m, guess)?;
    let jacobian = Jacobian::at(anchors, &found.position)?;
    let sensitivity = jacobian.node_jacobian().ok_or_else(|| KinematicsError::singular(&found.position))?;
    let structure: StructureMatrix = jacobian.structure_matrix();
    let free = || tension::least_norm_unbounded(&structure, wrench_n);
    let tensions_n =
        if robot.redundancy() == 0 { free() } else { tension::least_norm(&structure, wrench_n, [0.0, f64::INFINITY]) }
            .or_else(|_| free())
            .unwrap_or_else(|_| CableVec::zeros(anchors.len()));
    let mut slack = [false; MAX_CABLES];
    for (s, t) in slack.iter_mut().zip(tensions_n.iter()) {
        *s = *t <= 0.0;
    }
    Ok(Equilibrium {
        position: found.position,
        tensions_n,
        lengths_m: inverse_kinematics(anchors, &found.position),
        slack,
        residual: found.residual_rms_m,
        iterations: 0,
        sensitivity,
    })
}
