//! Three cables: as many equations as unknowns, which need no normal equations.

use nalgebra::Vector3;
use wide::f64x2;

use super::equations::{Equations, sum};
use crate::Anchors;
use crate::pulley::Both;

/// Volume of the unit vectors below which the pose is too near the plane of the anchors for plain steps: there the sine
/// of the angle between plane and cables is about this.
const LEAST_VOLUME: f64 = 1e-2;

/// Differences of the lengths of three cables at a position.
pub(super) struct Square {
    cables: [Both; 2],
    off_m: [f64; 3],
    /// Columns of the inverse of the Jacobian.
    inverse: [Vector3<f64>; 3],
    volume: f64,
}

impl Square {
    #[inline(always)]
    pub(super) fn at(anchors: &Anchors, lengths_m: &[f64; 3], x: &Vector3<f64>) -> Option<Self> {
        let cables = [anchors.both_cables(0, x)?, anchors.both_cables(1, x)?];
        let [[ux, vx], [uy, vy], [uz, vz]] = cables[0].direction.map(f64x2::to_array);
        let [[wx, _], [wy, _], [wz, _]] = cables[1].direction.map(f64x2::to_array);
        let [u, v, w] = [Vector3::new(ux, uy, uz), Vector3::new(vx, vy, vz), Vector3::new(wx, wy, wz)];
        let across = [v.cross(&w), w.cross(&u), u.cross(&v)];
        let volume = u.dot(&across[0]);
        // Also true for NaN.
        if !(volume.abs() >= LEAST_VOLUME) {
            return None;
        }
        let per_volume = 1.0 / volume;
        let ([first_m, second_m], [third_m, _]) = (cables[0].length.to_array(), cables[1].length.to_array());
        let off_m = [first_m - lengths_m[0], second_m - lengths_m[1], third_m - lengths_m[2]];
        Some(Self { cables, off_m, inverse: across.map(|across| across * per_volume), volume })
    }

    #[inline(always)]
    fn times(&self, off_m: [f64; 3]) -> Vector3<f64> {
        let [u, v, w] = &self.inverse;
        u * off_m[0] + v * off_m[1] + w * off_m[2]
    }
}

impl Equations for Square {
    #[inline(always)]
    fn step(&self) -> Vector3<f64> {
        self.times(self.off_m)
    }

    /// A step changes each length by its difference, and in addition by half of its second derivative.
    #[inline(always)]
    fn correction(&self, step: &Vector3<f64>) -> (Vector3<f64>, f64) {
        let [x, y] = [step.x, step.y].map(f64x2::splat);
        let square = f64x2::splat(step.norm_squared());
        let [first, second, third] = self.off_m;
        let along = [f64x2::new([first, second]), f64x2::splat(third)];
        let bow = [0, 1].map(|k| {
            let Both { per_free, bend, across: [ax, ay], .. } = self.cables[k];
            let across = ax * x + ay * y;
            (((square - along[k] * along[k]) * per_free + bend * (across * across)) * f64x2::splat(0.5)).to_array()
        });
        (self.times([bow[0][0], bow[0][1], bow[1][0]]), 0.0)
    }

    fn cost_after(&self, _: &Vector3<f64>) -> f64 {
        0.0
    }

    /// The trace of Jᵀ J is 3, and its determinant the square of the volume.
    #[inline(always)]
    fn least_eigenvalue(&self) -> f64 {
        4.0 / 9.0 * self.volume * self.volume
    }

    /// Exact lengths leave no differences.
    fn curved(&self) -> f64 {
        0.0
    }

    #[inline(always)]
    fn change_per_m(&self) -> f64 {
        let [first, second] = self.cables.map(|both| both.per_free + both.bend.abs());
        2.0 * (sum(first) + second.to_array()[0])
    }
}
