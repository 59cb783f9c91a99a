//! Position of the node by motor-io's own lengths, and the velocity with which commands move it.
//!
//! motor-io judges motions by this position and not by an estimate, because an estimator may be late, wrong, or of
//! another life. It is the elastic equilibrium of the lengths at rest, computed once per cycle without allocation.

use cable_robot::{CableVec, Jacobian, NodeJacobian, Robot, Vector3, elastic};
use messages::{CABLES, MotorState};

/// Position of the node, if its lengths state one.
#[derive(Debug, Clone)]
pub struct Node {
    robot: Robot,
    held: Option<Rest>,
}

/// A position at rest and its sensitivity to the lengths.
#[derive(Debug, Clone, Copy)]
struct Rest {
    position_m: Vector3<f64>,
    lengths_m: CableVec,
    tensions_n: CableVec,
    sensitivity: NodeJacobian,
    /// Whether the position is known, and not one that has to be confirmed.
    certain: bool,
}

/// Two positions at rest, before and after a change of the lengths.
#[derive(Debug, Clone, Copy)]
pub struct Way {
    /// Position and tensions before, m and N.
    pub from: (Vector3<f64>, CableVec),
    /// Position and tensions after, m and N.
    pub to: (Vector3<f64>, CableVec),
}

impl Node {
    /// Position unknown.
    #[must_use]
    pub fn new(robot: Robot) -> Self {
        Self { robot, held: None }
    }

    /// Computes the position for this cycle's unstretched lengths, m; `position`: one of `MotorState::POSITION_*`.
    pub fn observe(&mut self, lengths_m: &[f64; CABLES], position: u8) {
        let certain = position == MotorState::POSITION_KNOWN;
        // A position that had to be confirmed is not where the search for a known one begins.
        let guess = self.held.filter(|held| held.certain == certain).map(|held| held.position_m);
        self.held = (position != MotorState::POSITION_UNKNOWN).then_some(()).and_then(|()| {
            let lengths_m = CableVec::from_array8(lengths_m, self.robot.cable_count());
            let found = self.rest(&lengths_m, guess.as_ref())?;
            let finite = found.position.iter().all(|x| x.is_finite())
                && found.sensitivity.iter().all(|column| column.iter().all(|x| x.is_finite()));
            finite.then_some(Rest {
                position_m: found.position,
                lengths_m,
                tensions_n: found.tensions_n,
                sensitivity: found.sensitivity,
                certain,
            })
        });
    }

    fn rest(&self, lengths_m: &CableVec, guess: Option<&Vector3<f64>>) -> Option<elastic::Equilibrium> {
        let wrench_n = self.robot.wrench_n(&Vector3::zeros());
        elastic::equilibrium_under(&self.robot, lengths_m, &wrench_n, guess).ok()
    }

    fn known(&self) -> Option<&Rest> {
        self.held.as_ref().filter(|held| held.certain)
    }

    /// Where the node is at rest now and after a change of the lengths, m. The present position may be one that has to
    /// be confirmed; `None`: unknown, or the lengths fit no position. Where the lengths after the change fit no
    /// position, the node moves along the tangent of its path, under the present tensions.
    #[must_use]
    pub fn way(&self, change_m: &[f64; CABLES]) -> Option<Way> {
        let held = self.held.as_ref()?;
        let lengths_m = CableVec::from_fn(held.lengths_m.len(), |i| held.lengths_m[i] + change_m[i]);
        let found = self.rest(&lengths_m, Some(&held.position_m)).map(|found| (found.position, found.tensions_n));
        let found = found.filter(|(position_m, _)| position_m.iter().all(|x| x.is_finite()));
        let along = || (held.position_m + held.sensitivity.node_velocity(change_m), held.tensions_n);
        Some(Way { from: (held.position_m, held.tensions_n), to: found.unwrap_or_else(along) })
    }

    /// Way of the node per way of a cable, counted from 0, alone; `None` as for [`Self::way`].
    #[must_use]
    pub fn way_per_cable(&self, cable: usize) -> Option<f64> {
        let mut unit = [0.0; CABLES];
        unit[cable] = 1.0;
        self.held.map(|held| held.sensitivity.node_velocity(&unit).norm())
    }

    /// Position of the node, m; `None`: unknown, or the lengths fit no position.
    #[must_use]
    pub fn position_m(&self) -> Option<Vector3<f64>> {
        self.known().map(|known| known.position_m)
    }

    /// Strains T / EA of the cables whose idlers count them stretched, with their numbers from 0.
    pub fn counted_strains(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let known = self.known().zip(self.robot.stiffness_n());
        let strains = known.into_iter().flat_map(|(known, stiffness_n)| {
            known.tensions_n.iter().map(move |tension_n| tension_n.max(0.0) / stiffness_n).enumerate()
        });
        strains.filter(|(cable, strain)| self.robot.counts_stretched(*cable) && strain.is_finite())
    }

    /// Change of the position per change of the lengths.
    #[must_use]
    pub fn sensitivity(&self) -> Option<&NodeJacobian> {
        self.known().map(|known| &known.sensitivity)
    }

    /// Velocity of the node for these cable velocities, m/s.
    #[must_use]
    pub fn velocity_of(&self, cables_m_s: &[f64]) -> Option<Vector3<f64>> {
        self.known().map(|known| known.sensitivity.node_velocity(cables_m_s))
    }

    /// Cable velocities for this velocity of the node, m/s: equation (14), with rigid cables.
    #[must_use]
    pub fn cables_for(&self, velocity_m_s: &Vector3<f64>) -> Option<[f64; CABLES]> {
        let jacobian = Jacobian::at(self.robot.anchors(), &self.known()?.position_m).ok()?;
        Some(jacobian.cable_velocity(velocity_m_s).to_array8())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::RobotParts;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Position and tensions after a way are those of the lengths after it, also before they are confirmed.
        #[test]
        fn a_way_leads_to_the_position_and_the_tensions_of_its_lengths(
            lengths_m in [5.7..6.3f64, 5.7..6.3f64, 5.7..6.3f64],
            cable in 0..3usize,
            change_m in -0.1..0.1f64,
            certain in any::<bool>(),
        ) {
            let robot = Robot::new(RobotParts {
                anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
                node_mass_kg: 0.3,
                tension_limits_n: [2.0, 60.0],
                speed_limit_m_s: 0.4,
                acceleration_limit_m_s2: 0.5,
                stiffness_n: Some(6000.0),
                cable_mass_kg_m: 0.05,
                ..RobotParts::default()
            })
            .unwrap();
            let mut node = Node::new(robot);
            let [mut all_m, mut way_m] = [[0.0; CABLES]; 2];
            all_m[..3].copy_from_slice(&lengths_m);
            way_m[cable] = change_m;
            node.observe(&all_m, if certain { MotorState::POSITION_KNOWN } else { MotorState::POSITION_RESTORED });
            prop_assert_eq!(node.position_m().is_some(), certain);
            let way = node.way(&way_m).unwrap();
            let at = |add_m: f64| {
                let mut lengths_m = lengths_m;
                lengths_m[cable] += add_m;
                elastic::equilibrium(&robot, &lengths_m, &Vector3::zeros(), None).unwrap()
            };
            for ((position_m, tensions_n), found) in [(way.from, at(0.0)), (way.to, at(change_m))] {
                prop_assert!((position_m - found.position).norm() < 1e-6);
                for (tension_n, found_n) in tensions_n.iter().zip(found.tensions_n.iter()) {
                    prop_assert!((tension_n - found_n).abs() < 1e-4, "{tension_n} {found_n}");
                }
            }
        }
    }
}
