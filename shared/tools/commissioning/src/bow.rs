//! The deepest bow of the cables under their own weight, compared with an exact catenary.

use cable_robot::catenary::Span;
use cable_robot::{Distribution, Robot, Vector3, tension};
use command::points;

/// The bow of a cable for the node at a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bow {
    /// Number of the cable, from 1.
    pub cable: usize,
    /// Position of the node, m.
    pub at: Vector3<f64>,
    /// Sag as a share of the length: w L / (8 T).
    pub sag_share: f64,
    /// Length by which the cable exceeds the straight line to first order, m.
    pub bow_m: f64,
    /// Difference to a catenary with the same horizontal force, m.
    pub off_m: f64,
}

impl Bow {
    /// Returns the deepest bow with the node at `middle` and halfway from there to each anchor, where the longest
    /// cables carry least; `None` for cables without weight.
    pub fn deepest(robot: &Robot, middle: &Vector3<f64>, distribution: Distribution) -> Option<Self> {
        if robot.cable_weight_n_m() == 0.0 {
            return None;
        }
        let outward = robot.anchors().iter().map(|anchor| {
            let halfway = 0.5 * (middle + anchor);
            Vector3::new(halfway.x, halfway.y, middle.z)
        });
        let bows = std::iter::once(*middle).chain(outward).filter_map(|at| {
            let held = tension::at(robot, &at, &Vector3::zeros(), distribution).ok()?;
            (0..robot.cable_count()).filter_map(|i| Self::new(robot, i, &at, held.tensions_n[i])).max_by(Self::order)
        });
        bows.max_by(Self::order)
    }

    fn new(robot: &Robot, cable: usize, at: &Vector3<f64>, tension_n: f64) -> Option<Self> {
        let free = robot.anchors().pulley(cable).cable_to(at).ok()?;
        let chord = -free.direction * free.free_m;
        let (level_m, weight_n_m) = (chord.xy().norm(), robot.cable_weight_n_m());
        let span = Span { level_m, rise_m: chord.z, weight_n_m, stiffness_n: f64::INFINITY };
        let bow_m = robot.cable_load(cable, at).bow_m(tension_n);
        let hangs = span.hang(tension_n * level_m / free.free_m)?;
        Some(Self {
            cable: cable + 1,
            at: *at,
            sag_share: weight_n_m * free.free_m / (8.0 * tension_n),
            bow_m,
            off_m: (hangs.unstretched_m - free.free_m - bow_m).abs(),
        })
    }

    fn order(a: &Self, b: &Self) -> std::cmp::Ordering {
        a.sag_share.total_cmp(&b.sag_share)
    }

    /// Describes the bow and what the first order neglects.
    pub fn in_words(&self, robot: &Robot) -> String {
        let Self { cable, at, sag_share, bow_m, off_m } = self;
        let (place, sag, bow_mm, off_mm) =
            (points::in_words(robot, at), 1.0 / sag_share, 1000.0 * bow_m, 1000.0 * off_m);
        format!(
            "the weight of the cables is compensated to first order: with the node at {place} cable {cable} sags by \
             1/{sag:.0} of its length and is {bow_mm:.1} mm longer than straight; a catenary differs by {off_mm:.2} mm"
        )
    }
}
