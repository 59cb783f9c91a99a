//! Position of the node by motor-io's own lengths, and the velocity with which commands move it.
//!
//! motor-io judges motions by this position and not by an estimate, because an estimator may be late, wrong, or of
//! another life. It is the elastic equilibrium of the lengths at rest, computed once per cycle without allocation.

use cable_robot::{CableVec, Jacobian, NodeJacobian, Robot, Vector3, elastic};
use messages::CABLES;

/// Position of the node, if it is known.
#[derive(Debug, Clone)]
pub struct Node {
    robot: Robot,
    known: Option<Known>,
}

/// A position and its sensitivity to the lengths.
#[derive(Debug, Clone, Copy)]
struct Known {
    position_m: Vector3<f64>,
    tensions_n: CableVec,
    sensitivity: NodeJacobian,
}

impl Node {
    /// Position unknown.
    #[must_use]
    pub fn new(robot: Robot) -> Self {
        Self { robot, known: None }
    }

    /// Computes the position for this cycle's unstretched lengths, m; `known`: they are valid.
    pub fn observe(&mut self, lengths_m: &[f64; CABLES], known: bool) {
        let guess = self.known.map(|known| known.position_m);
        self.known = known.then_some(()).and_then(|()| {
            let lengths = CableVec::from_array8(lengths_m, self.robot.cable_count());
            let wrench_n = self.robot.wrench_n(&Vector3::zeros());
            let found = elastic::equilibrium_under(&self.robot, &lengths, &wrench_n, guess.as_ref()).ok()?;
            let finite = found.position.iter().all(|x| x.is_finite())
                && found.sensitivity.iter().all(|column| column.iter().all(|x| x.is_finite()));
            finite.then_some(Known {
                position_m: found.position,
                tensions_n: found.tensions_n,
                sensitivity: found.sensitivity,
            })
        });
    }

    /// Position of the node, m; `None`: unknown, or the lengths fit no position.
    #[must_use]
    pub fn position_m(&self) -> Option<Vector3<f64>> {
        self.known.map(|known| known.position_m)
    }

    /// Position of the node, m, and the tensions of the cables at rest, N; `None` as for [`Self::position_m`].
    #[must_use]
    pub fn held(&self) -> Option<(Vector3<f64>, &CableVec)> {
        self.known.as_ref().map(|known| (known.position_m, &known.tensions_n))
    }

    /// Strains T / EA of the cables whose idlers count them stretched, with their numbers from 0.
    pub fn counted_strains(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let known = self.known.as_ref().zip(self.robot.stiffness_n());
        let strains = known.into_iter().flat_map(|(known, stiffness_n)| {
            known.tensions_n.iter().map(move |tension_n| tension_n.max(0.0) / stiffness_n).enumerate()
        });
        strains.filter(|(cable, strain)| self.robot.counts_stretched(*cable) && strain.is_finite())
    }

    /// Change of the position per change of the lengths.
    #[must_use]
    pub fn sensitivity(&self) -> Option<&NodeJacobian> {
        self.known.as_ref().map(|known| &known.sensitivity)
    }

    /// Velocity of the node for these cable velocities, m/s.
    #[must_use]
    pub fn velocity_of(&self, cables_m_s: &[f64]) -> Option<Vector3<f64>> {
        self.known.map(|known| known.sensitivity.node_velocity(cables_m_s))
    }

    /// Cable velocities for this velocity of the node, m/s: equation (14), with rigid cables.
    #[must_use]
    pub fn cables_for(&self, velocity_m_s: &Vector3<f64>) -> Option<[f64; CABLES]> {
        let jacobian = Jacobian::at(self.robot.anchors(), &self.known?.position_m).ok()?;
        Some(jacobian.cable_velocity(velocity_m_s).to_array8())
    }
}
