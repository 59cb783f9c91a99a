//! `[uncertainty]` of a robot file: how well the rest of the file is known.

use crate::section::between;
use cable_robot::Uncertainty;

/// Standard deviation of an anchor and of the point where its cable is tied, m per axis: each is known to 5 mm, by a
/// laser rangefinder and by a ruler.
const ANCHORS_M: f64 = 0.007;
/// Of the radius of stated pulleys, m: a caliper across the groove.
const STATED_RADIUS_M: f64 = 0.0005;
/// Of the radius, m, where the file does not state what the cables leave from: sheaves for cords have 15 to 40 mm, and
/// this is the root of their mean square.
const UNSTATED_RADIUS_M: f64 = 0.028;
/// Of the counts per metre: a check over five metres, good to 2.5 mm.
const CABLE_SCALE: f64 = 0.0005;
/// Of EA: data sheets state it within a tenth.
const STIFFNESS: f64 = 0.1;
/// Of the weight of the node: another battery, a cable more.
const NODE_WEIGHT: f64 = 0.03;
/// Of the compliance of a pole at the anchor, m/N: slender poles to trees yield by 20 to 200 micrometres per newton.
const POLE_M_N: f64 = 9e-5;
/// Of the friction between drum and node, as a share of the tension: sheaves on ball bearings to bushes.
const PULLEY_FRICTION: f64 = 0.03;
/// Of the length of a cable since the lengths were set: 5 K of braided polyester.
const EXPANSION: f64 = 1e-4;

crate::section! {
    /// `[uncertainty]`: standard deviations of what the file states. They are part of the covariance of every estimate,
    /// and of the margins of obstacles.
    /// The defaults are those of careful work; 0 states that a value is exact.
    pub struct UncertaintySection {
        /// Of the anchors and of the points where the cables are tied to the node, m per axis. A `calibration` states
        /// its own for the anchors, and then this key is not used.
        pub anchors_m: f64 = ANCHORS_M => between(0.0, 10.0, "m"),
        /// Of the radius of the pulleys, m; the same error for all. Default: 0.5 mm if the file states `pulley`,
        /// otherwise 28 mm, because there may be any.
        pub pulley_radius_m: Option<f64> = None => between(0.0, 1.0, "m"),
        /// Of the counts per metre of each cable, as a share.
        pub cable_scale: f64 = CABLE_SCALE => between(0.0, 0.5, "as a share"),
        /// Of the stiffness EA, as a share; the same error for all cables.
        pub stiffness: f64 = STIFFNESS => between(0.0, 1.0, "as a share"),
        /// Of the weight of the node, as a share.
        pub node_weight: f64 = NODE_WEIGHT => between(0.0, 1.0, "as a share"),
        /// Of the compliance of each pole at its anchor, m/N.
        pub pole_m_n: f64 = POLE_M_N => between(0.0, 0.1, "m/N"),
        /// Of the friction of the pulleys between drum and node, as a share of the tension.
        pub pulley_friction: f64 = PULLEY_FRICTION => between(0.0, 1.0, "as a share"),
        /// Of the length of the cables since the lengths were set, by temperature and creep, as a share.
        pub expansion: f64 = EXPANSION => between(0.0, 0.1, "as a share"),
    }
}

impl UncertaintySection {
    /// Returns the standard deviations for the robot model. `stated`: whether the robot file says what the cables leave
    /// from.
    #[must_use]
    pub fn uncertainty(&self, stated: bool) -> Uncertainty {
        let Self { anchors_m, pulley_radius_m, cable_scale, stiffness, .. } = *self;
        let Self { node_weight, pole_m_n, pulley_friction, expansion, .. } = *self;
        Uncertainty {
            anchors_m,
            pulley_radius_m: pulley_radius_m.unwrap_or(if stated { STATED_RADIUS_M } else { UNSTATED_RADIUS_M }),
            cable_scale,
            stiffness,
            node_weight,
            pole_m_n,
            pulley_friction,
            expansion,
        }
    }
}
