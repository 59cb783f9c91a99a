//! The least norm of all tensions T = particular + N λ within limits, for any number of redundant cables.
//!
//! The columns of N are orthonormal and orthogonal to the particular solution, so this is the point of the polyhedron
//! low ≤ T ≤ high nearest to the origin of λ. It is found by the dual active set method (D. Goldfarb and A. Idnani,
//! "A numerically stable dual method for solving strictly convex quadratic programs", Mathematical Programming 27,
//! 1983). It begins at the origin and adds the most violated limit. Each limit that it adds moves λ farther from the
//! origin, so no set of active limits returns and the number of steps is finite. At most as many limits as active ones
//! are released before the next is added. Every λ lies in the force balance itself, so large tensions of nearly
//! parallel cables cost no accuracy of the forces.

use crate::linalg::{dot, norm};
use crate::{CableVec, MAX_CABLES};

/// A limit whose normal lies in the span of the active ones up to this share of it does not move λ.
const SPAN_TOLERANCE: f64 = 1e-9;

/// Derivatives of a tension with respect to λ below this are rounding: the tension is fixed.
const FIXED_TOLERANCE: f64 = 1e-12;

/// Guard of the loop. No problem of the tests takes more than 40 steps.
const MAX_STEPS: usize = 400;

/// λ, or a vector of the same space.
type Direction = [f64; MAX_CABLES];

/// All tensions that balance a force.
pub(super) struct Solutions {
    /// The shortest of them, N.
    pub particular_n: CableVec,
    /// Row i has the derivatives of tension i with respect to λ.
    pub null: [Direction; MAX_CABLES],
    /// Number of redundant cables, the length of λ.
    pub redundancy: usize,
}

/// The active limits: orthonormal directions Q of their normals, the triangular factor R, and their multipliers.
struct Active {
    /// Limit k: 2 i is the lower one of cable i, 2 i + 1 the upper one.
    limits: [usize; MAX_CABLES],
    multipliers: [f64; MAX_CABLES],
    count: usize,
    q: [Direction; MAX_CABLES],
    r: [Direction; MAX_CABLES],
}

impl Solutions {
    /// The tensions at λ, N.
    fn at(&self, lambda: &Direction) -> CableVec {
        let d = self.redundancy;
        CableVec::from_fn(self.particular_n.len(), |i| self.particular_n[i] + dot(&self.null[i][..d], &lambda[..d]))
    }

    /// Computes the shortest tensions within the limits, which may be exceeded by the share `tolerance` of the largest
    /// force; None if there are none.
    pub fn shortest(&self, limits_n: [f64; 2], tolerance: f64) -> Option<CableVec> {
        let d = self.redundancy;
        let mut lambda = [0.0; MAX_CABLES];
        let mut active = Active::none();
        // The limit that is being added, and its multiplier.
        let mut adding: Option<(usize, f64)> = None;
        for _ in 0..MAX_STEPS {
            let tensions_n = self.at(&lambda);
            let scale = tensions_n.max_abs().max(limits_n[0]).max(1.0);
            let (limit, mut multiplier) = match adding {
                Some(pair) => pair,
                None => match self.most_violated(&tensions_n, limits_n, tolerance * scale, &active) {
                    Some(limit) => (limit, 0.0),
                    None => return Some(tensions_n.map(|t| t.clamp(limits_n[0], limits_n[1]))),
                },
            };
            let normal = self.normal(limit);
            let (along, step) = active.split(&normal, d);
            let size = norm(&normal[..d]);
            let blocking = active.first_released(&along);
            // How far the limit is exceeded, and how far it is from there to it.
            let excess = -self.distance(limit, &tensions_n, limits_n);
            let moves = size > FIXED_TOLERANCE && norm(&step[..d]) > SPAN_TOLERANCE * size;
            let full = if moves { excess / dot(&step[..d], &step[..d]) } else { f64::INFINITY };
            let (length, released) = match blocking {
                Some((at, index)) if at < full => (at, Some(index)),
                _ if moves => (full, None),
                // Neither moving nor releasing helps: the active limits exclude this one.
                _ => return None,
            };
            if moves {
                (0..d).for_each(|k| lambda[k] += length * step[k]);
            }
            for (u, share) in active.multipliers.iter_mut().zip(&along).take(active.count) {
                *u -= length * share;
            }
            multiplier += length;
            adding = match released {
                Some(index) => {
                    self.release(&mut active, index);
                    Some((limit, multiplier))
                }
                None => {
                    active.add(limit, multiplier, &normal, d);
                    lambda = self.corner(&active, limits_n);
                    None
                }
            };
        }
        None
    }

    /// The limit that is exceeded most, by more than `allowed` N and not yet active.
    fn most_violated(&self, tensions_n: &CableVec, limits_n: [f64; 2], allowed: f64, active: &Active) -> Option<usize> {
        let mut worst = None;
        let mut least = -allowed;
        for limit in 0..2 * tensions_n.len() {
            let distance = self.distance(limit, tensions_n, limits_n);
            if distance < least && !active.limits[..active.count].contains(&limit) {
                (worst, least) = (Some(limit), distance);
            }
        }
        worst
    }

    /// Distance of a tension to a limit, N; negative beyond it.
    fn distance(&self, limit: usize, tensions_n: &CableVec, [low, high]: [f64; 2]) -> f64 {
        let t = tensions_n[limit / 2];
        if limit.is_multiple_of(2) { t - low } else { high - t }
    }

    /// Derivatives of that distance with respect to λ.
    fn normal(&self, limit: usize) -> Direction {
        let row = self.null[limit / 2];
        if limit.is_multiple_of(2) { row } else { row.map(|v| -v) }
    }

    /// Removes an active limit and factorises the others again.
    fn release(&self, active: &mut Active, index: usize) {
        let before = std::mem::replace(active, Active::none());
        for k in (0..before.count).filter(|k| *k != index) {
            active.add(before.limits[k], before.multipliers[k], &self.normal(before.limits[k]), self.redundancy);
        }
    }

    /// The shortest λ at which every active tension is at its limit: without the rounding of the steps.
    fn corner(&self, active: &Active, [low, high]: [f64; 2]) -> Direction {
        let mut lambda = [0.0; MAX_CABLES];
        let mut y = [0.0; MAX_CABLES];
        for j in 0..active.count {
            let cable = active.limits[j] / 2;
            let target = if active.limits[j].is_multiple_of(2) {
                low - self.particular_n[cable]
            } else {
                self.particular_n[cable] - high
            };
            let known: f64 = (0..j).map(|i| active.r[i][j] * y[i]).sum();
            y[j] = (target - known) / active.r[j][j];
            (0..self.redundancy).for_each(|k| lambda[k] += active.q[j][k] * y[j]);
        }
        lambda
    }
}

impl Active {
    fn none() -> Self {
        let zeros = [[0.0; MAX_CABLES]; MAX_CABLES];
        Self { limits: [0; MAX_CABLES], multipliers: [0.0; MAX_CABLES], count: 0, q: zeros, r: zeros }
    }

    /// Divides a normal into its components along Q and the part orthogonal to them, which is orthogonalised twice.
    fn project(&self, normal: &Direction, d: usize) -> (Direction, Direction) {
        let (mut components, mut rest) = ([0.0; MAX_CABLES], *normal);
        for _ in 0..2 {
            for (component, q) in components.iter_mut().zip(&self.q).take(self.count) {
                let share = dot(&q[..d], &rest[..d]);
                *component += share;
                (0..d).for_each(|k| rest[k] -= share * q[k]);
            }
        }
        (components, rest)
    }

    /// Divides a normal into shares of the active normals and the direction orthogonal to all of them.
    fn split(&self, normal: &Direction, d: usize) -> (Direction, Direction) {
        let (mut shares, rest) = self.project(normal, d);
        for i in (0..self.count).rev() {
            let known: f64 = (i + 1..self.count).map(|j| self.r[i][j] * shares[j]).sum();
            shares[i] = (shares[i] - known) / self.r[i][i];
        }
        (shares, rest)
    }

    /// The step at which the first multiplier of an active limit becomes zero, and the place of this limit.
    fn first_released(&self, shares: &Direction) -> Option<(f64, usize)> {
        let mut first: Option<(f64, usize)> = None;
        for (index, share) in shares[..self.count].iter().enumerate() {
            let at = self.multipliers[index].max(0.0) / share;
            if *share > 0.0 && first.is_none_or(|(least, _)| at < least) {
                first = Some((at, index));
            }
        }
        first
    }

    fn add(&mut self, limit: usize, multiplier: f64, normal: &Direction, d: usize) {
        let (components, rest) = self.project(normal, d);
        let j = self.count;
        let size = norm(&rest[..d]);
        for (row, component) in self.r.iter_mut().zip(&components).take(j) {
            row[j] = *component;
        }
        self.r[j][j] = size;
        self.q[j] = rest.map(|v| v / size);
        (self.limits[j], self.multipliers[j]) = (limit, multiplier);
        self.count += 1;
    }
}
