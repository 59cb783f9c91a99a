//! The last check before the motors: limits on cable velocity and acceleration.
//!
//! The whole vector is scaled, never one cable alone: clamping one of the cables that hold a node bends the path and
//! stresses the others.

use cable_robot::NodeJacobian;
use messages::CABLES;

/// Limits of the node at its present position.
#[derive(Debug, Clone, Copy)]
pub struct NodeLimit<'a> {
    /// Change of the position per change of the lengths.
    pub sensitivity: &'a NodeJacobian,
    /// Largest speed of the node, m/s.
    pub speed_m_s: f64,
    /// Largest change of its velocity per cycle, m/s.
    pub step_m_s: f64,
}

impl NodeLimit<'_> {
    fn size(&self, cables_m_s: &[f64; CABLES]) -> f64 {
        self.sensitivity.node_velocity(cables_m_s).norm()
    }
}

/// Limits of all cables, and the velocities sent last.
#[derive(Debug, Clone)]
pub struct Limits {
    speed_m_s: f64,
    step_m_s: f64,
    last: [f64; CABLES],
}

impl Limits {
    /// `speed_m_s`: largest velocity of a cable; `acceleration_m_s2`: largest change of it per second; both above 0.
    #[must_use]
    pub fn new(speed_m_s: f64, acceleration_m_s2: f64, period_s: f64) -> Self {
        Self { speed_m_s, step_m_s: acceleration_m_s2 * period_s, last: [0.0; CABLES] }
    }

    /// Largest magnitude of the velocities sent last, m/s.
    #[must_use]
    pub fn last_speed(&self) -> f64 {
        largest(&self.last)
    }

    /// Largest change per cycle, m/s.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.step_m_s
    }

    /// Returns the velocities to send for the wanted ones (finite), and the factor by which the velocity
    /// limit scaled them.
    ///
    /// The result lies between the last and the wanted vector, so it also keeps the velocity limits. But the position
    /// changes between cycles, and with it the node's velocity for the same vector: if that alone exceeds the node's
    /// speed limit, the change begins by scaling the last vector. Both are one change, for which a cable's limit holds;
    /// it also goes before the node's speed.
    pub fn toward(&mut self, wanted: &[f64; CABLES], node: Option<&NodeLimit<'_>>) -> ([f64; CABLES], f64) {
        debug_assert!(wanted.iter().all(|v| v.is_finite()), "a wanted velocity is not finite: {wanted:?}");
        let within = |size: f64, limit: f64| if size > limit { limit / size } else { 1.0 };
        let factor = within(largest(wanted), self.speed_m_s);
        let factor = node.map_or(factor, |node| factor.min(within(node.size(wanted), node.speed_m_s)));
        let target = wanted.map(|v| v * factor);
        let shrink = node.map_or(1.0, |node| within(node.size(&self.last), node.speed_m_s));
        // At most a step: so much of the fastest cable.
        let shrink = if shrink < 1.0 { shrink.max(1.0 - self.step_m_s / self.last_speed()) } else { shrink };
        let begin = self.last.map(|v| v * shrink);
        let (scaled, way) = (difference(&begin, &self.last), difference(&target, &begin));
        let left = |limit: f64, scaled: f64, way: f64| {
            if scaled + way > limit { ((limit - scaled) / way).clamp(0.0, 1.0) } else { 1.0 }
        };
        let of_cables = (0..CABLES).map(|i| left(self.step_m_s, scaled[i].abs(), way[i].abs())).fold(1.0, f64::min);
        let share =
            node.map_or(of_cables, |node| of_cables.min(left(node.step_m_s, node.size(&scaled), node.size(&way))));
        if share >= 1.0 {
            // Exactly the wanted vector, so that standstill is exactly zero.
            self.last = target;
        } else {
            let speed_m_s = self.speed_m_s;
            self.last = std::array::from_fn(|i| (begin[i] + way[i] * share).clamp(-speed_m_s, speed_m_s));
        }
        debug_assert!(factor > 0.0 && factor <= 1.0, "the velocity vector is scaled by {factor}");
        (self.last, factor)
    }

    /// Begins at velocities that something else has given the cables, each within its limit: from there they brake.
    pub fn begin(&mut self, measured_m_s: &[f64; CABLES]) {
        self.last = measured_m_s.map(|v| v.clamp(-self.speed_m_s, self.speed_m_s));
    }

    /// Sets the velocities to zero at once, regardless of the limits: for the emergency stop.
    pub fn zero(&mut self) {
        self.last = [0.0; CABLES];
    }
}

fn difference(a: &[f64; CABLES], b: &[f64; CABLES]) -> [f64; CABLES] {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Largest magnitude.
#[must_use]
pub fn largest(values: &[f64; CABLES]) -> f64 {
    values.iter().fold(0.0, |most: f64, v| most.max(v.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::Vector3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn neither_limit_is_ever_broken(wanted in prop::collection::vec(prop::array::uniform8(-5.0..5.0f64), 1..60)) {
            let mut limits = Limits::new(0.8, 2.0, 0.01);
            let mut last = [0.0; CABLES];
            for w in &wanted {
                let (v, factor) = limits.toward(w, None);
                prop_assert!(factor > 0.0 && factor <= 1.0);
                for i in 0..CABLES {
                    prop_assert!(v[i].abs() <= 0.8 + 1e-12);
                    prop_assert!((v[i] - last[i]).abs() <= 0.02 + 1e-12);
                }
                last = v;
            }
        }

        /// The node moves, so the same cable velocities make it faster from cycle to cycle.
        #[test]
        fn the_limits_hold_together_while_the_node_moves(
            wanted in prop::collection::vec(prop::array::uniform3(-0.6..0.6f64), 2..60),
            turn in prop::array::uniform3(-0.004..0.004f64),
        ) {
            let mut limits = Limits::new(0.8, 2.0, 0.01);
            let (mut last, mut gain) = ([0.0; CABLES], 0.6);
            for w in &wanted {
                gain *= 1.0 + turn[0].abs();
                let columns: Vec<Vector3<f64>> = (0..3)
                    .map(|k| Vector3::from_fn(|axis, _| if axis == k { gain } else { turn[axis] }))
                    .collect();
                let sensitivity = NodeJacobian::from_columns(&columns);
                let node = NodeLimit { sensitivity: &sensitivity, speed_m_s: 0.3, step_m_s: 0.02 };
                let (v, _) = limits.toward(&std::array::from_fn(|i| w.get(i).copied().unwrap_or(0.0)), Some(&node));
                for i in 0..CABLES {
                    prop_assert!((v[i] - last[i]).abs() <= 0.02 + 1e-12, "{last:?} to {v:?}");
                }
                prop_assert!(node.size(&v) <= 0.3 + 1e-9, "{} m/s", node.size(&v));
                last = v;
            }
        }

        #[test]
        fn the_direction_of_the_change_is_kept(wanted in prop::array::uniform8(-0.5..0.5f64)) {
            let mut limits = Limits::new(0.8, 2.0, 0.01);
            let (v, _) = limits.toward(&wanted, None);
            for i in 1..CABLES {
                prop_assert!((v[0] * wanted[i] - v[i] * wanted[0]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn standstill_is_reached_exactly() {
        let mut limits = Limits::new(0.8, 2.0, 0.01);
        limits.toward(&[0.1; CABLES], None);
        for _ in 0..3 {
            limits.toward(&[0.0; CABLES], None);
        }
        assert_eq!(limits.last_speed(), 0.0);
    }
}
