//! The weight of the cables, to first order.
//!
//! A cable of the weight w per metre hangs below its chord, the straight line from its eye or pulley to the node. While
//! the sag is small beside the chord (see [`SHALLOW`]), the cable is a parabola, as if its weight were spread over the
//! chord L:
//!
//! * each end carries half of the weight, w L / 2, straight down, and the tension T along the chord in addition;
//! * the cable is longer than the chord by the bow b = w² ρ² L / (24 T²), with the horizontal distance ρ of its ends.
//!
//! (Irvine, *Cable Structures*, 1981, sections 1.2 and 2.4; Ernst, *Der Bauingenieur* 40, 1965, who has the softness of
//! such a cable.) [`crate::catenary`] is exact and states what is neglected. The tension varies along the cable by w
//! times its height h, ± w h / 2 about T, which changes the stretch of the free cable in second order only. Routed part
//! and winch are at the upper end, under T + w h / 2.
//!
//! A cable with weight is never quite slack: with a chord shorter than its length it hangs through.
//!
//! Lengths in m, forces in N, weights in N/m.

use nalgebra::Vector3;

use crate::pulley::Pulley;
use crate::{Anchors, MAX_CABLES};

/// Largest sag, w L / (8 T) as a share of the chord, for which the first order is enough. The exact catenary differs
/// from it by at most 6 % of the bow at this share (`tests/mathematics/sag.rs`), which is less than the uncertainty of
/// the weight of a cable that may be wet.
pub const SHALLOW: f64 = 0.05;

/// Largest ratio of the true sag to the computed one: a wet braid weighs one and a half times as much as a dry one.
pub const WET: f64 = 1.5;

/// Bound of the iteration for the tension, which needs about five steps from its upper bound.
const MAX_STEPS: usize = 60;

/// What the weight of a cable does at one position of the node.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Half of the cable's weight, which the node carries, N.
    pub half_n: f64,
    /// Tension at the anchor beyond that in the middle, w h / 2, N.
    pub rise_n: f64,
    /// The bow times the squared tension, w² ρ² L / 24, N² m.
    pub bow_n2_m: f64,
}

impl Load {
    /// Computes the load of a cable with this weight per metre; zero where the cable has no direction.
    pub fn at(pulley: &Pulley, position: &Vector3<f64>, weight_n_m: f64) -> Self {
        let Ok((direction, chord_m)) = pulley.free_cable(position) else { return Self::default() };
        let level_share = (1.0 - direction.z * direction.z).max(0.0);
        let weight_n = weight_n_m * chord_m;
        let half_n = 0.5 * weight_n;
        Self { half_n, rise_n: -direction.z * half_n, bow_n2_m: weight_n * weight_n * level_share * chord_m / 24.0 }
    }

    /// Length by which the cable exceeds its chord at a tension, m; 0 for a cable without weight.
    pub fn bow_m(&self, tension_n: f64) -> f64 {
        if self.bow_n2_m == 0.0 { 0.0 } else { self.bow_n2_m / (tension_n * tension_n) }
    }

    /// Computes the tension of a cable whose chord exceeds its unstretched length by `stretch_m` and that stretches by
    /// `softness_m_n` per newton, N. It solves softness T = stretch + bow(T), which has one positive solution.
    pub(crate) fn tension_n(&self, stretch_m: f64, softness_m_n: f64) -> f64 {
        let (s, c, q) = (stretch_m, softness_m_n, self.bow_n2_m);
        if q == 0.0 {
            return (s / c).max(0.0);
        }
        // Upper bounds; from above, Newton steps on the convex cubic c T³ - s T² - q decrease monotonically.
        let hanging = libm::cbrt(q / c);
        let mut t = if s >= 0.0 { s / c + hanging } else { hanging.min((q / -s).sqrt()) };
        for _ in 0..MAX_STEPS {
            let next = t - ((c * t - s) * t * t - q) / ((3.0 * c * t - 2.0 * s) * t);
            // Also true for NaN.
            if !(next < t && next > 0.0) {
                break;
            }
            t = next;
        }
        t
    }

    /// Change of `stretch` per change of the tension at a tension, m/N: the inverse of Ernst's stiffness.
    pub(crate) fn softness_m_n(&self, tension_n: f64, softness_m_n: f64) -> f64 {
        softness_m_n + 2.0 * self.bow_m(tension_n) / tension_n
    }

    /// Energy of the stretched and lifted cable with the load held fixed, J: the integral of the tension over
    /// `stretch`, to a constant.
    pub(crate) fn energy_j(&self, tension_n: f64, softness_m_n: f64) -> f64 {
        (0.5 * softness_m_n * tension_n - 2.0 * self.bow_m(tension_n)) * tension_n
    }
}

/// Depth of a cable below the middle of its chord at a tension, w L² / (8 T), m; at most half of the chord.
pub fn sag_m(weight_n_m: f64, chord_m: f64, tension_n: f64) -> f64 {
    if weight_n_m == 0.0 {
        return 0.0;
    }
    (weight_n_m * chord_m * chord_m / (8.0 * tension_n)).min(0.5 * chord_m)
}

/// The loads of all cables.
pub(crate) fn loads(anchors: &Anchors, position: &Vector3<f64>, weight_n_m: f64) -> [Load; MAX_CABLES] {
    let mut loads = [Load::default(); MAX_CABLES];
    for (load, pulley) in loads.iter_mut().zip(anchors.pulleys()) {
        *load = Load::at(&pulley, position, weight_n_m);
    }
    loads
}

/// The half weights of all cables, which the node carries, N.
pub fn carried_n(anchors: &Anchors, position: &Vector3<f64>, weight_n_m: f64) -> f64 {
    anchors.pulleys().map(|pulley| Load::at(&pulley, position, weight_n_m).half_n).sum()
}
