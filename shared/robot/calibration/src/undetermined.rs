//! What measurements leave open.

use thiserror::Error;

/// Why measurements do not determine the anchors. Anchors are counted from 1.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Undetermined {
    /// No range gives the x axis.
    #[error("there is no range between anchors 1 and 2, which define the x axis; measure it")]
    NoBaseline,
    /// An anchor with less than two ranges from known places.
    #[error(
        "anchor {anchor} is reached by {ranges} range(s) from anchors whose place is known; measure ranges to two more"
    )]
    FewRanges {
        /// The anchor.
        anchor: usize,
        /// From known places.
        ranges: usize,
    },
    /// An anchor whose ranges begin on one line.
    #[error("the anchors with ranges to anchor {anchor} lie on one line; measure a range from another one")]
    RangesOnALine {
        /// The anchor.
        anchor: usize,
    },
    /// A network of ranges that can be bent.
    #[error("the ranges do not hold the anchors in place; measure one between each pair")]
    LooseRanges,
    /// One or two points where three are needed.
    #[error(
        "{points} point(s) cannot determine the heights, whatever the number of cables; measure at least three that are \
         not on one line"
    )]
    FewPoints {
        /// As many are given.
        points: usize,
    },
    /// Points on one line, whatever their noise.
    #[error(
        "the points lie on one line, which leaves the heights undetermined whatever the number of cables; \
         add points to its sides"
    )]
    OnALine,
    /// Points whose distances from one line may be noise.
    #[error(
        "the points lie on one line as far as the lengths can tell ({across_m:.3} m to its sides, of which noise alone makes \
         {noise_m:.3} m), which leaves the heights undetermined whatever the number of cables; add points to both sides of that line"
    )]
    OnALineInNoise {
        /// Across the line, root mean square, m.
        across_m: f64,
        /// As much of it as noise makes, m.
        noise_m: f64,
    },
    /// Points so near to one line that a height is not known well enough.
    #[error(
        "the points lie nearly on one line ({across_m:.2} m to its sides and {along_m:.2} m along it, root mean square), which \
         leaves the height of anchor {anchor} uncertain by {std_m:.2} m; add points to both sides of that line{}", refused_above(*limit_m)
    )]
    NearALine {
        /// Across the line, root mean square, m.
        across_m: f64,
        /// Along it, m.
        along_m: f64,
        /// The anchor.
        anchor: usize,
        /// Standard deviation of its height, m.
        std_m: f64,
        /// What is accepted, m, if that is known.
        limit_m: Option<f64>,
    },
    /// Points near one line that leave an unknown open.
    #[error(
        "the points lie on one line or nearly so ({across_m:.3} m to its sides, {along_m:.3} m along it, root mean square), \
         which leaves the anchors undetermined; add points to both sides of that line"
    )]
    OpenNearALine {
        /// Across the line, root mean square, m.
        across_m: f64,
        /// Along it, m.
        along_m: f64,
    },
    /// An unknown is left open, and not because of points on a line.
    #[error(
        "the measurements leave an unknown open; add points, ranges between anchors or directly measured heights, or do \
         not estimate scale and zeros"
    )]
    Open,
    /// A coordinate is not known well enough.
    #[error(
        "these measurements leave {axis} of anchor {anchor} uncertain by {std_m:.2} m{}; spread the points \
         to the corners below the anchors, add points, or measure more exactly", refused_above(Some(*limit_m))
    )]
    Uncertain {
        /// x, y or z.
        axis: char,
        /// The anchor.
        anchor: usize,
        /// Standard deviation, m.
        std_m: f64,
        /// What is accepted, m.
        limit_m: f64,
    },
    /// One or two known points where three are needed.
    #[error(
        "{points} point(s) with known positions cannot determine an anchor; measure at least three that are not on one line"
    )]
    FewKnownPoints {
        /// As many are given.
        points: usize,
    },
    /// Known points in one plane with the anchor.
    #[error("the points lie in one plane with the anchor, which leaves it open; add points beside that plane")]
    InAPlane,
    /// Another method would have an answer.
    #[error("{0}; or use the joint method, which takes the measured heights into account")]
    WithoutHeights(Box<Undetermined>),
}

impl Undetermined {
    /// Whether the points lie too near to one line, so that points beside it help.
    #[must_use]
    pub fn is_line(&self) -> bool {
        match self {
            Self::OnALine | Self::OnALineInNoise { .. } | Self::NearALine { .. } | Self::OpenNearALine { .. } => true,
            Self::WithoutHeights(why) => why.is_line(),
            _ => false,
        }
    }
}

/// Two places that fit alike. Anchors are counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum TwoPlaces {
    /// Of a fourth anchor with two ranges.
    #[error(
        "two ranges leave two places for the fourth anchor; give its side of the line from anchor 1 to anchor 2, \
         or a third range"
    )]
    Fourth,
    /// Of an anchor with two ranges in a network.
    #[error(
        "two ranges leave two places for anchor {anchor}; give its side of the line from anchor {from} to anchor {to} \
         (1 left, -1 right), or a third range"
    )]
    Anchor {
        /// The anchor.
        anchor: usize,
        /// The line from this anchor
        from: usize,
        /// to that one.
        to: usize,
    },
    /// On both sides of a vertical plane through the points.
    #[error("the points lie in a vertical plane, which leaves two anchors at the same height; move one of them")]
    VerticalPlane,
}

fn refused_above(limit_m: Option<f64>) -> String {
    limit_m.map_or_else(String::new, |limit| format!(" (more than {limit} m is refused)"))
}
