//! Cables that stretch. The measured length l is the unstretched cable paid out beyond the routed part Lx.
//! With the stiffness EA, the length L of [`crate::pulley`] (a straight line from an eye) and tension T are related by
//! (L + Lx) = (l + Lx)(1 + T / EA). Rigid cables: l = L. Pulleys turn without friction, so the tension is the same on
//! both sides. Cables with weight are longer than their chord by the bow of [`crate::sag`]: L + bow(T) takes the place
//! of L, and the cables carry half of their own weight beside the force on the node. Every force of this module is the
//! force on the node alone.
//!
//! Lengths and positions in m, tensions and EA in N; one entry per cable. Accelerations enter with (15)-(16), the
//! choice of tensions with (27)-(37). A pose that no tensions can hold is a [`crate::tension::TensionError`]; lengths
//! without an equilibrium are an [`ElasticError`].

mod springs;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::kinematics::{
    Jacobian, KinematicsError, LONGEST_M, NodeJacobian, StructureMatrix, check_pulleys, forward_kinematics,
    inverse_kinematics,
};
use crate::linalg::{self, SymmetricInverse};
use crate::pulley::CableGeometry;
use crate::sag::{self, Load};
use crate::tension::{self, TensionError};
use crate::{CableVec, Distribution, MAX_CABLES, Robot};
use springs::{AllSprings, Balance, Described};

/// Coordinates (m) and forces (N) beyond this are in a wrong unit or erroneous.
const LARGEST: f64 = 1e6;

/// Bound of the equilibrium iteration, which needs two or three steps from the last cycle's position.
const MAX_ITERATIONS: usize = 100;

/// Unstretched (measured) lengths of cables with these tensions, m, for the node at a position with these straight-line
/// lengths; as many as the robot has cables.
#[inline]
pub fn unstretched(robot: &Robot, position: &Vector3<f64>, lengths_m: &[f64], tensions_n: &[f64]) -> CableVec {
    let routed = robot.routed_length_m();
    CableVec::from_fn(routed.len().min(lengths_m.len()).min(tensions_n.len()), |i| {
        let load = robot.cable_load(i, position);
        let length_m = lengths_m[i] + load.bow_m(tensions_n[i]);
        match robot.stiffness_n() {
            None => length_m,
            Some(ea) => (length_m - load.rise_n * routed[i] / ea + routed[i]) / (1.0 + tensions_n[i] / ea) - routed[i],
        }
    })
}

/// Straight-line lengths of cables with these measured lengths and tensions, m, for the node at a position, which
/// affects only cables with weight; as many as the robot has cables.
pub fn stretched(robot: &Robot, position: &Vector3<f64>, unstretched_m: &[f64], tensions_n: &[f64]) -> CableVec {
    let routed = robot.routed_length_m();
    CableVec::from_fn(routed.len().min(unstretched_m.len()).min(tensions_n.len()), |i| {
        let load = robot.cable_load(i, position);
        let bow_m = load.bow_m(tensions_n[i]);
        match robot.stiffness_n() {
            None => unstretched_m[i] - bow_m,
            Some(ea) => {
                let carried_m = load.rise_n * routed[i] / ea;
                (unstretched_m[i] + routed[i]) * (1.0 + tensions_n[i] / ea) - routed[i] - bow_m + carried_m
            }
        }
    })
}

/// Cable lengths and tensions that hold the node at a position with a chosen tension distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Realisation {
    /// Measured (unstretched) lengths to be commanded, m.
    pub unstretched_m: CableVec,
    /// Straight-line lengths, m.
    pub lengths_m: CableVec,
    /// Tensions, N.
    pub tensions_n: CableVec,
}

/// Computes the measured lengths that hold the node at a position with an acceleration and the chosen distribution.
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

/// Like [`realise`], for any force that the cables provide together, N, for example including the
/// drag of a moving node.
pub fn realise_under(
    robot: &Robot,
    position: &Vector3<f64>,
    wrench_n: &Vector3<f64>,
    distribution: Distribution,
) -> Result<Realisation, TensionError> {
    let held = tension::for_wrench(robot, position, wrench_n, distribution)?;
    Ok(Realisation::with_tensions(robot, position, held.tensions_n))
}

impl Realisation {
    /// The lengths of cables with these tensions, N, to a position, m.
    #[inline]
    pub fn with_tensions(robot: &Robot, position: &Vector3<f64>, tensions_n: CableVec) -> Self {
        let lengths_m = inverse_kinematics(robot.anchors(), position);
        let unstretched_m = unstretched(robot, position, &lengths_m, &tensions_n);
        Self { unstretched_m, lengths_m, tensions_n }
    }
}

/// Error of the elastic equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ElasticError {
    /// Error of the kinematics of rigid cables.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
    /// A measured length plus its routed part is not positive.
    #[error("cable {} has a measured length of {length_m} m, and its length with the routed part is not positive; check the lengths", cable + 1)]
    NoLine {
        /// Index of the cable, from 0.
        cable: usize,
        /// The measured length, m.
        length_m: f64,
    },
    /// The guess or the force on the node is not finite, or too large to be real.
    #[error("{what} is not finite or beyond 1e6; give numbers in SI units")]
    NotFinite {
        /// The wrong argument.
        what: &'static str,
    },
    /// The iteration ended without balanced forces.
    #[error(
        "no equilibrium found in {MAX_ITERATIONS} iterations: {residual_n:.3e} N are out of balance; check lengths and stiffness"
    )]
    NotConverged {
        /// Remaining force, N.
        residual_n: f64,
    },
}

/// Equilibrium position and tensions for given measured lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Equilibrium {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Tensions, N; 0 for a slack cable without weight.
    pub tensions_n: CableVec,
    /// Straight-line lengths, m.
    pub lengths_m: CableVec,
    /// Whether each cable is slack: without tension, or, with weight, under less tension than half of its weight, so
    /// that it sags by more than a quarter of its length. Unused entries are false.
    pub slack: [bool; MAX_CABLES],
    /// Elastic cables: remaining force, N. Rigid cables: RMS of the length residuals, m.
    pub residual: f64,
    /// Newton steps from the starting point; 0 for rigid cables.
    pub iterations: usize,
    /// Sensitivity of the position to the measured lengths, dX/dl, 3 x N; zero columns for slack cables.
    pub sensitivity: NodeJacobian,
    /// Force per displacement of the node while the drums stand still, N/m, without slack cables; None for rigid ones.
    pub stiffness_n_m: Option<Matrix3<f64>>,
}

impl Equilibrium {
    /// Covariance of the position, m², for independent errors of the measured lengths with these
    /// standard deviations, m.
    pub fn covariance(&self, sigma_length_m: &[f64]) -> Matrix3<f64> {
        self.sensitivity.covariance(sigma_length_m)
    }

    /// True if any cable is slack.
    pub fn any_slack(&self) -> bool {
        self.slack.iter().any(|s| *s)
    }
}

/// Computes the elastic equilibrium: the position at which Σ T_i (-u_i) = m (g + a), T_i = max(0, EA ((L_i +
/// Lx)/(l_i + Lx) - 1)).
///
/// The position minimises a convex potential (the energy of a stretched cable is convex in the position, and cables
/// cannot push; with pulleys this holds everywhere except within about two radii of a pulley's axis, see
/// [`crate::pulley`]). It is therefore unique wherever cables are taut in every direction, and damped Newton steps find
/// it from any start; `guess` (the last cycle's position) saves steps. For rigid cables this is forward kinematics near
/// the guess, with the unique or the least-norm tensions.
///
/// With cables that have weight, each step holds bow and half weight at those of its start, for which the potential is
/// as convex. They depend on the position by a share of its change of about the sag ratio, so the steps still converge.
pub fn equilibrium(
    robot: &Robot,
    unstretched_m: &[f64],
    acceleration_m_s2: &Vector3<f64>,
    guess: Option<&Vector3<f64>>,
) -> Result<Equilibrium, ElasticError> {
    equilibrium_under(robot, unstretched_m, &robot.wrench_n(acceleration_m_s2), guess)
}

/// Like [`equilibrium`], for any force that the cables provide together, N, for example including the
/// drag of a moving node.
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
        let hung = if robot.cable_weight_n_m() == 0.0 { rigid } else { rigid_with_weight };
        return hung(robot, unstretched_m, wrench_n, guess);
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
    let springs = AllSprings::new(robot, unstretched_m, stiffness);
    let cables = ElasticCables { robot, unstretched_m, stiffness, wrench, springs };
    let found = cables.balance(cables.start(guess));
    // With very stiff cables and a distant guess the iteration can reach its bound: start from the lengths instead.
    if found.is_err() && guess.is_some() { cables.balance(cables.start(None)) } else { found }
}

struct ElasticCables<'a> {
    robot: &'a Robot,
    unstretched_m: &'a [f64],
    stiffness: f64,
    wrench: Vector3<f64>,
    /// The cables as they are without weight.
    springs: AllSprings,
}

/// What the weight of each cable does at the start of a step.
type Loads = [Load; MAX_CABLES];

impl ElasticCables<'_> {
    /// Starting point: the guess, or the position of rigid cables, or a point below the centre of the anchors.
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

    /// Unstretched length from drum to node, m.
    fn total(&self, i: usize) -> f64 {
        self.unstretched_m[i] + self.robot.routed_length_m()[i]
    }

    /// Stretch of the routed part by the weight of the free cable, m.
    fn carried_m(&self, i: usize, load: &Load) -> f64 {
        load.rise_n * self.robot.routed_length_m()[i] / self.stiffness
    }

    /// Loads of the cables at a position; None without weight.
    fn loads(&self, x: &Vector3<f64>) -> Option<Loads> {
        let weight_n_m = self.robot.cable_weight_n_m();
        (weight_n_m != 0.0).then(|| sag::loads(self.robot.anchors(), x, weight_n_m))
    }

    fn evaluate(&self, x: &Vector3<f64>, loads: Option<&Loads>) -> Balance {
        let anchors = self.robot.anchors();
        let mut balance = Balance { gradient: self.wrench, hessian: Matrix3::zeros(), potential: self.wrench.dot(x) };
        // No step ends where a cable has no direction, because NaN is never lower.
        match loads {
            None => self.springs.add(&mut balance, anchors, x),
            Some(loads) => anchors.each_cable(x, |i, cable| self.add(&mut balance, x, &loads[i], i, cable)),
        }
        balance
    }

    /// Adds the pull of a cable with weight.
    #[inline(always)]
    fn add(&self, balance: &mut Balance, x: &Vector3<f64>, load: &Load, i: usize, cable: &CableGeometry) {
        let CableGeometry { length_m: length, direction: u, free_m, bend_per_m, across: a } = cable;
        let (total, stretch) = (self.total(i), length - self.unstretched_m[i]);
        let mut k = self.stiffness / total;
        let tension;
        if load.bow_n2_m > 0.0 {
            let softness = total / self.stiffness;
            tension = load.tension_n(stretch - self.carried_m(i, load), softness);
            k = 1.0 / load.softness_m_n(tension, softness);
            balance.potential += load.energy_j(tension, softness) + load.half_n * x.z;
            balance.gradient.z += load.half_n;
        } else {
            if stretch <= 0.0 || *length == 0.0 {
                return;
            }
            tension = k * stretch;
            balance.potential += 0.5 * tension * stretch;
        }
        balance.gradient += u * tension;
        let across = tension / free_m;
        balance.hessian += linalg::outer(u, u) * (k - across) + Matrix3::identity() * across;
        if *bend_per_m != 0.0 {
            balance.hessian += linalg::outer(a, a) * (bend_per_m * tension);
        }
    }

    fn balance(&self, start: Vector3<f64>) -> Result<Equilibrium, ElasticError> {
        let anchors = self.robot.anchors();
        // Forces are length differences times stiffness, so their rounding errors grow with both.
        let longest = self.unstretched_m.iter().fold(1.0, |m: f64, l| m.max(*l));
        let tolerance = 1e-10 * (1.0 + self.wrench.norm()) + 1e-15 * self.stiffness * longest;
        let softest = self.springs.softest(anchors.len());
        let mut x = start;
        check_pulleys(anchors, &x)?;
        let mut loads = self.loads(&x);
        let mut now = self.evaluate(&x, loads.as_ref());
        let mut damping = 0.0;
        let mut iterations = 0;
        while now.gradient.norm() > tolerance && iterations < MAX_ITERATIONS {
            iterations += 1;
            // A node on fewer taut cables than directions has soft directions: the damped step lets it fall
            // until a cable is taut.
            let floor = if damping > 0.0 { damping } else { 1e-12 * softest };
            let Some(mut step) = linalg::solve_spd(&(now.hessian + Matrix3::identity() * floor), &now.gradient) else {
                damping = (10.0 * damping).max(1e-6 * softest);
                continue;
            };
            // Limit the step to the size of the robot.
            if step.norm() > longest {
                step *= longest / step.norm();
            }
            let mut share = 1.0;
            let mut accepted = false;
            for _ in 0..30 {
                let next = x - step * share;
                let there = self.evaluate(&next, loads.as_ref());
                // Near the minimum, rounding hides the decrease of the potential: then the gradient decides.
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
                if loads.is_some() {
                    loads = self.loads(&x);
                    now = self.evaluate(&x, loads.as_ref());
                }
            }
        }
        let residual = now.gradient.norm();
        // Also true for NaN.
        if !(residual <= 1e3 * tolerance) {
            return Err(ElasticError::NotConverged { residual_n: residual });
        }
        Ok(self.describe(x, &now, loads.as_ref(), iterations))
    }

    fn describe(&self, x: Vector3<f64>, balance: &Balance, loads: Option<&Loads>, iterations: usize) -> Equilibrium {
        let (n, anchors) = (self.robot.cable_count(), self.robot.anchors());
        let mut found = self.springs.describe(anchors, &x, &balance.hessian);
        let mut slack = [false; MAX_CABLES];
        for (slack, tension_n) in slack.iter_mut().zip(found.tensions_n.iter()) {
            *slack = *tension_n <= 0.0;
        }
        if let Some(loads) = loads {
            let inverse = SymmetricInverse::of(&balance.hessian);
            anchors.each_cable(&x, |i, cable| {
                let load = &loads[i];
                if load.bow_n2_m > 0.0 {
                    let softness = self.total(i) / self.stiffness;
                    let stretch = cable.length_m - self.unstretched_m[i] - self.carried_m(i, load);
                    let tension_n = load.tension_n(stretch, softness);
                    // H dX = u (-dT/dl) dl, with softness T = L + bow(T) - l and the softness (l + Lx) / EA.
                    let pull = (1.0 + tension_n / self.stiffness) / load.softness_m_n(tension_n, softness);
                    let moved = inverse.map(|inverse| inverse.times(&(cable.direction * pull)));
                    found.columns[i] = moved.unwrap_or_else(Vector3::zeros);
                    (found.tensions_n[i], slack[i]) = (tension_n, tension_n < load.half_n);
                }
            });
        }
        let Described { lengths_m, tensions_n, columns } = found;
        Equilibrium {
            position: x,
            tensions_n,
            lengths_m,
            slack,
            residual: balance.gradient.norm(),
            iterations,
            sensitivity: NodeJacobian { columns, len: n, planar: self.robot.is_planar() },
            stiffness_n_m: Some(balance.hessian),
        }
    }
}

/// Rigid cables with weight: the bows follow from the tensions, and these from the position. A step changes a bow by
/// its share of twice the relative change of the tension, which is about that of the length.
fn rigid_with_weight(
    robot: &Robot,
    lengths_m: &[f64],
    wrench_n: &Vector3<f64>,
    guess: Option<&Vector3<f64>>,
) -> Result<Equilibrium, ElasticError> {
    let n = robot.cable_count();
    let mut chords_m = CableVec::from_fn(n, |i| lengths_m[i]);
    let mut carried_n = *wrench_n;
    let mut near = guess.copied();
    for _ in 0..MAX_ITERATIONS {
        let found = rigid(robot, &chords_m, &carried_n, near.as_ref())?;
        let next_m = stretched(robot, &found.position, lengths_m, &found.tensions_n);
        let change_m = next_m.zip_map(&chords_m, |a, b| a - b).max_abs();
        // Also true for NaN.
        if !next_m.iter().all(|length_m| *length_m > 0.0) {
            break;
        }
        (chords_m, near) = (next_m, Some(found.position));
        carried_n = robot.with_cables_n(&found.position, wrench_n);
        if change_m <= 1e-12 * (1.0 + chords_m.max_abs()) {
            let mut found = found;
            for i in 0..n {
                found.slack[i] = found.tensions_n[i] < robot.cable_load(i, &found.position).half_n;
            }
            return Ok(found);
        }
    }
    Err(ElasticError::NotConverged { residual_n: f64::NAN })
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
    let pulling = || {
        let pulled = tension::distribute(&structure, wrench_n, [0.0, f64::INFINITY], Distribution::LeastNorm);
        pulled.map(|found| found.tensions_n)
    };
    let tensions_n = if robot.redundancy() == 0 { free() } else { pulling().or_else(|_| free()) }
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
        stiffness_n_m: None,
    })
}
