//! Kinds of what the cables truly leave from.

use config::PulleyKind;
use plant::pulley::Guide;

config::choice! {
    /// What the cables truly leave from.
    pub enum TrueGuide {
        /// A point.
        Eye = "eye",
        /// A wheel that turns about the vertical axis through the anchor.
        Swivel = "swivel",
        /// A wheel in a vertical plane.
        Fixed = "fixed",
    }
}

impl TrueGuide {
    /// Returns the kind that the robot file assumes.
    #[must_use]
    pub const fn assumed(kind: PulleyKind) -> Self {
        match kind {
            PulleyKind::Eye => Self::Eye,
            PulleyKind::Swivel => Self::Swivel,
        }
    }

    /// Returns the guide of a cable in the plant; the azimuth is that of the wheel's centre from the anchor.
    #[must_use]
    pub const fn guide(self, radius_m: f64, azimuth_rad: f64) -> Guide {
        match self {
            Self::Eye => Guide::Eye,
            Self::Swivel => Guide::Swivel { radius_m },
            Self::Fixed => Guide::Fixed { radius_m, azimuth_rad },
        }
    }
}
