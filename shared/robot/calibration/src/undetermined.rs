//! Reasons why measurements do not determine the anchors.

use thiserror::Error;

/// Missing information in measurements. Anchors are counted from 1.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Undetermined {
    /// No range defines the x axis.
    #[error("there is no range between anchors 1 and 2, which define the x axis; measure it")]
    NoBaseline,
    /// An anchor with fewer than two ranges from known anchors.
    #[error("anchor {anchor} has {ranges} range(s) from anchors with known positions; measure ranges to two more")]
    FewRanges {
        /// Number of the anchor.
        anchor: usize,
        /// Number of ranges from known anchors.
        ranges: usize,
    },
    /// An anchor whose ranges start from anchors on one line.
    #[error("the anchors with ranges to anchor {anchor} lie on one line; measure a range from another one")]
    RangesOnALine {
        /// Number of the anchor.
        anchor: usize,
    },
    /// A network of ranges that is not rigid.
    #[error("the ranges do not determine a rigid network; measure one between each pair of anchors")]
    LooseRanges,
    /// One or two points; three are needed.
    #[error(
        "{points} point(s) cannot determine the heights, whatever the number of cables; measure at least three that are \
         not on one line"
    )]
    FewPoints {
        /// Number of points.
        points: usize,
    },
    /// Points on one line, with any noise.
    #[error(
        "the points lie on one line, which leaves the heights undetermined whatever the number of cables; \
         add points on both sides of it"
    )]
    OnALine,
    /// Points whose distances from one line may be noise.
    #[error(
        "the points lie on one line within the accuracy of the lengths ({across_m:.3} m across it, of which noise explains \
         {noise_m:.3} m), which leaves the heights undetermined whatever the number of cables; add points on both sides of that line"
    )]
    OnALineInNoise {
        /// Spread across the line, root mean square, m.
        across_m: f64,
        /// Spread explained by noise, m.
        noise_m: f64,
    },
    /// Points so near to one line that a height is not determined well enough.
    #[error(
        "the points lie nearly on one line ({across_m:.2} m across and {along_m:.2} m along it, root mean square), which \
         leaves the height of anchor {anchor} uncertain by {std_m:.2} m; add points on both sides of that line{}", limit_clause(*limit_m)
    )]
    NearALine {
        /// Spread across the line, root mean square, m.
        across_m: f64,
        /// Spread along the line, m.
        along_m: f64,
        /// Number of the anchor.
        anchor: usize,
        /// Standard deviation of the height, m.
        std_m: f64,
        /// Accepted standard deviation, m, if known.
        limit_m: Option<f64>,
    },
    /// Points near one line that do not determine all unknowns.
    #[error(
        "the points lie on one line or nearly so ({across_m:.3} m across, {along_m:.3} m along it, root mean square), \
         which leaves the anchors undetermined; add points on both sides of that line"
    )]
    OpenNearALine {
        /// Spread across the line, root mean square, m.
        across_m: f64,
        /// Spread along the line, m.
        along_m: f64,
    },
    /// An unknown is not determined, for another reason than points on a line.
    #[error(
        "the measurements do not determine all unknowns; add points, ranges between anchors or directly measured heights, or do \
         not estimate scale and zeros"
    )]
    Open,
    /// A coordinate is not determined well enough.
    #[error(
        "these measurements leave {axis} of anchor {anchor} uncertain by {std_m:.2} m{}; spread the points \
         to the corners below the anchors, add points, or measure more exactly", limit_clause(Some(*limit_m))
    )]
    Uncertain {
        /// Coordinate: x, y or z.
        axis: char,
        /// Number of the anchor.
        anchor: usize,
        /// Standard deviation, m.
        std_m: f64,
        /// Accepted standard deviation, m.
        limit_m: f64,
    },
    /// One or two known points; three are needed.
    #[error(
        "{points} point(s) with known positions cannot determine an anchor; measure at least three that are not on one line"
    )]
    FewKnownPoints {
        /// Number of points.
        points: usize,
    },
    /// Known points in one plane with the anchor.
    #[error(
        "the points and the anchor lie in one plane, so the anchor is not determined; add points outside that plane"
    )]
    InAPlane,
    /// Another method would determine the anchors.
    #[error("{0}; or use the joint method, which takes the measured heights into account")]
    WithoutHeights(Box<Undetermined>),
}

impl Undetermined {
    /// True if the points lie too near to one line, so that points beside it help.
    #[must_use]
    pub fn is_line(&self) -> bool {
        match self {
            Self::OnALine | Self::OnALineInNoise { .. } | Self::NearALine { .. } | Self::OpenNearALine { .. } => true,
            Self::WithoutHeights(why) => why.is_line(),
            _ => false,
        }
    }
}

/// Two equally good positions. Anchors are counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Ambiguity {
    /// Positions of a fourth anchor with two ranges.
    #[error(
        "two ranges allow two positions of the fourth anchor; give its side of the line from anchor 1 to anchor 2, \
         or a third range"
    )]
    Fourth,
    /// Positions of an anchor with two ranges in a network.
    #[error(
        "two ranges allow two positions of anchor {anchor}; give its side of the line from anchor {from} to anchor {to} \
         (1 left, -1 right), or a third range"
    )]
    Anchor {
        /// Number of the anchor.
        anchor: usize,
        /// First anchor of the line.
        from: usize,
        /// Second anchor of the line.
        to: usize,
    },
    /// Positions on both sides of a vertical plane through the points.
    #[error("the points lie in a vertical plane, which allows two anchors at the same height; move one of the points")]
    VerticalPlane,
}

fn limit_clause(limit_m: Option<f64>) -> String {
    limit_m.map_or_else(String::new, |limit| format!(" (more than {limit} m is refused)"))
}
