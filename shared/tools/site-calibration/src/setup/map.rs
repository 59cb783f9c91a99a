//! What is known of a site so far, for a drawing from above.

use super::question::{self, Question, pulleys};
use super::shape;
use crate::calibrate::{MeasurementsFile, honest_calibration, places};
use calibration::{AnchorCovariance, Measurements, Method, placement};
use serde::Serialize;

/// Rounds of places at the corners that are tried for the next point, beside the middle of each side and of the site.
const ROUNDS: usize = 2;

/// The site from above, in the frame of the calibration: pulley 1 at the origin, pulley 2 on the x axis.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SiteMap {
    /// The pulleys whose place is known, m; a height that no measurement determines yet is a guess.
    pub anchors_m: Vec<[f64; 3]>,
    /// How well each is known; empty before the points determine it.
    pub known: Vec<Known>,
    /// Where the node was held, x and y in m.
    pub points_m: Vec<[f64; 2]>,
    /// Planned place of the point that is asked for, x and y in m.
    pub next_m: Option<[f64; 2]>,
    /// Where one more point helps most.
    pub best: Option<Best>,
}

/// How well a pulley is known: the ellipse that contains it with 95 % on the level, and its height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Known {
    /// Half of the longer and of the shorter axis, m.
    pub half_axes_m: [f64; 2],
    /// Direction of the longer axis from x towards y, rad.
    pub angle_rad: f64,
    /// Standard deviation of the height, m.
    pub height_std_m: f64,
}

/// A place for one more point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Best {
    /// x and y, m.
    pub at_m: [f64; 2],
    /// Largest standard deviation of a coordinate of a pulley now, and with a point there, m.
    pub worst_std_m: [f64; 2],
}

/// Share of the largest deviation below which one more point is worth a hint.
const WORTH: f64 = 0.995;

/// Half axes of the region of 95 % in standard deviations, on the level: the root of the quantile of chi-squared with
/// two degrees of freedom.
const IN_95: f64 = 2.447_746_83;

/// Draws what the measurements determine. `open`: the open question.
#[must_use]
pub fn site_map(file: &MeasurementsFile, open: &Question) -> SiteMap {
    let count = pulleys(file);
    if matches!(open, Question::Pulleys | Question::Distance { .. } | Question::Side { .. }) {
        return SiteMap { anchors_m: surveyed(file, count), ..SiteMap::default() };
    }
    let Some(anchors_m) = question::anchors(file) else {
        return SiteMap { anchors_m: surveyed(file, count), ..SiteMap::default() };
    };
    let next_m = match open {
        Question::Lengths { place } | Question::Confirmation { place } | Question::PointDecision { place, .. } => {
            places::spots(&anchors_m, place + 1).pop()
        }
        _ => None,
    };
    let method = file.usual_method();
    let found = file.measurements(method).ok().and_then(|measured| {
        let found = honest_calibration(&measured, method).ok()?;
        Some((measured, found))
    });
    let Some((measured, found)) = found else { return SiteMap { anchors_m, next_m, ..SiteMap::default() } };
    let points_m: Vec<[f64; 2]> = found.points_m.iter().map(|point| [point[0], point[1]]).collect();
    let known = (0..found.covariance.anchor_count()).map(|anchor| known(&found.covariance, anchor)).collect();
    let best = best(&measured, method, &found.anchors_m, &points_m);
    SiteMap { anchors_m: found.anchors_m, known, points_m, next_m, best }
}

/// The pulleys whose distances determine where they stand, with a height of zero.
fn surveyed(file: &MeasurementsFile, count: usize) -> Vec<[f64; 3]> {
    let found = (3..=count).rev().find_map(|count| shape::survey(file, count).ok());
    if let Some(survey) = found {
        return survey.anchors_xy_m.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
    }
    match shape::distance(file, 1, 2) {
        Some(m) => vec![[0.0; 3], [m, 0.0, 0.0]],
        None => Vec::new(),
    }
}

fn known(covariance: &AnchorCovariance, anchor: usize) -> Known {
    let block = covariance.block(anchor);
    let (xx, xy, yy) = (block[(0, 0)], block[(0, 1)], block[(1, 1)]);
    // The eigenvalues of a symmetric matrix of two rows.
    let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
    let axis = |variance: f64| IN_95 * variance.max(0.0).sqrt();
    Known {
        half_axes_m: [axis(mean + half), axis(mean - half)],
        angle_rad: 0.5 * (2.0 * xy).atan2(xx - yy),
        height_std_m: block[(2, 2)].max(0.0).sqrt(),
    }
}

/// Returns the place at which one more point reduces the largest deviation most.
fn best(measured: &Measurements, method: Method, anchors_m: &[[f64; 3]], points_m: &[[f64; 2]]) -> Option<Best> {
    let worst = |points: &[[f64; 2]]| {
        let predicted = placement::predict(anchors_m, points, measured, method).ok()?;
        Some(predicted.worst().2).filter(|std| std.is_finite())
    };
    let now = worst(points_m)?;
    let count = anchors_m.len();
    let middle = |a: [f64; 2], b: [f64; 2]| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let corners = places::spots(anchors_m, ROUNDS * count);
    let sides = (0..count).map(|i| middle(corners[i], corners[(i + 1) % count]));
    let mean = corners[..count]
        .iter()
        .fold([0.0; 2], |sum, at| [sum[0] + at[0] / count as f64, sum[1] + at[1] / count as f64]);
    let tried: Vec<[f64; 2]> = corners.iter().copied().chain(sides).chain([mean]).collect();
    let with = |at_m: [f64; 2]| {
        let points: Vec<[f64; 2]> = points_m.iter().copied().chain([at_m]).collect();
        Some((at_m, worst(&points)?))
    };
    let (at_m, then) = tried.into_iter().filter_map(with).min_by(|a, b| a.1.total_cmp(&b.1))?;
    // Heights that a tape measured become better by several points only.
    (then < WORTH * now).then_some(())?;
    Some(Best { at_m, worst_std_m: [now, then] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::guide::Guide;

    const SITE: [[f64; 3]; 3] = [[0.0, 0.0, 3.0], [9.0, 0.0, 3.2], [4.0, 8.0, 2.9]];

    fn far(a: [f64; 3], b: [f64; 3]) -> f64 {
        (a[0] - b[0]).hypot(a[1] - b[1])
    }

    fn map(guide: &Guide) -> SiteMap {
        site_map(guide.file(), guide.pending())
    }

    #[test]
    fn the_drawing_grows_with_the_answers() {
        let mut guide = Guide::default();
        assert_eq!(map(&guide), SiteMap::default());
        let say = |guide: &mut Guide, line: String| {
            let reply = guide.answer(&line);
            assert!(reply.changed, "{line}: {}", reply.message);
        };
        say(&mut guide, "3".to_owned());
        say(&mut guide, format!("{:.3}", far(SITE[0], SITE[1])));
        assert_eq!(map(&guide).anchors_m.len(), 2);
        say(&mut guide, format!("{:.3}", far(SITE[0], SITE[2])));
        say(&mut guide, format!("{:.3}", far(SITE[1], SITE[2])));
        say(&mut guide, "l".to_owned());
        for anchor in SITE {
            say(&mut guide, format!("{:.3}", anchor[2]));
        }
        // Eyes, and nine points.
        say(&mut guide, String::new());
        say(&mut guide, String::new());
        let mut worth_it = Vec::new();
        for place in 0..9 {
            let before = map(&guide);
            worth_it.extend(before.best);
            let at = before.next_m.unwrap();
            assert!((before.anchors_m[2][1] - 8.0).abs() < 0.01 && before.points_m.len() == place, "{before:?}");
            let lengths = places::lengths(&SITE, &[], &at).iter().map(|m| format!("{m:.3}")).collect::<Vec<_>>();
            say(&mut guide, lengths.join(" "));
        }
        let done = map(&guide);
        assert_eq!((done.known.len(), done.points_m.len(), done.next_m), (3, 9, None));
        // The frame is fixed by pulleys 1 and 2.
        assert_eq!(done.known[0].half_axes_m, [0.0; 2]);
        assert!(done.known[2].half_axes_m[0] >= done.known[2].half_axes_m[1]);
        // While there are few points, one more is worth it; in the end the heights are the worst, which a tape
        // measured.
        assert!(!worth_it.is_empty());
        assert!(worth_it.iter().all(|best| best.worst_std_m[1] < WORTH * best.worst_std_m[0]), "{worth_it:?}");
        assert_eq!(done.best, None);
    }
}
