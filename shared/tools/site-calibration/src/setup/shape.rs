//! Plausibility of the distances between pulleys: triangles, and the shape that they form together.

use super::text::{joined, metres};
use crate::calibrate::MeasurementsFile;
use calibration::{Measurements, Method, Range, Side, Survey, survey_network};

/// Tolerance of the triangle inequality for nearly collinear pulleys, in standard deviations of a distance.
const SLACK_SIGMAS: f64 = 7.0;

/// Misfit of a distance to the best shape that is reported, in standard deviations.
const MISFIT_SIGMAS: f64 = 4.0;

/// Returns the measured distance between two plumb lines, m.
pub fn distance(file: &MeasurementsFile, a: usize, b: usize) -> Option<f64> {
    file.range.iter().find(|r| (r.from, r.to) == (a, b) || (r.from, r.to) == (b, a)).map(|r| r.m)
}

/// Returns the pulleys with a lower number whose distance to this one was measured.
pub fn reached(file: &MeasurementsFile, pulley: usize) -> Vec<usize> {
    (1..pulley).filter(|lower| distance(file, *lower, pulley).is_some()).collect()
}

/// Rejects the newest distance, from `a` to `b`, if it violates the triangle inequality with two others.
///
/// # Errors
/// One sentence that names the three distances.
pub fn check_triangles(file: &MeasurementsFile, a: usize, b: usize) -> Result<(), String> {
    let sigma_m = file.sigma_range_m.unwrap_or_default();
    for c in (1..b).filter(|c| *c != a) {
        let (Some(ab), Some(ac), Some(bc)) = (distance(file, a, b), distance(file, a, c), distance(file, b, c)) else {
            continue;
        };
        let name = |from: usize, to: usize| format!("{}-{}", from.min(to), from.max(to));
        let mut sides = [(ab, name(a, b)), (ac, name(a, c)), (bc, name(b, c))];
        sides.sort_by(|p, q| p.1.cmp(&q.1));
        let longest = sides.iter().max_by(|p, q| p.0.total_cmp(&q.0)).map(|side| side.1.clone()).unwrap_or_default();
        let sum: f64 = sides.iter().map(|side| side.0).sum();
        let most = ab.max(ac).max(bc);
        if most > sum - most + SLACK_SIGMAS * sigma_m {
            let all: Vec<String> = sides.iter().map(|(m, name)| format!("{name} ({})", metres(*m))).collect();
            return Err(say!(
                "the distances {} do not fit: {longest} is longer than the other two together; measure {} again, or \
                 take back an earlier one with undo",
                joined(&all),
                name(a, b)
            ));
        }
    }
    Ok(())
}

/// Computes the shape of the first `count` pulleys from their distances; pulleys without an answered side are assumed
/// left.
///
/// # Errors
/// One sentence: why they form no shape.
pub fn survey(file: &MeasurementsFile, count: usize) -> Result<Survey, String> {
    if count < 3 {
        return Err(say!("two pulleys form no shape"));
    }
    let measured = file.measurements(Method::Survey)?;
    let ranges: Vec<Range> = measured.ranges.iter().filter(|r| r.from.max(r.to) < count).copied().collect();
    let sides: Vec<Option<Side>> =
        measured.sides.iter().take(count).map(|side| Some(side.unwrap_or_default())).collect();
    survey_network(count, &ranges, &sides).map_err(|error| error.to_string())
}

/// Returns a message if the distances to this pulley contradict each other.
pub fn contradiction(file: &MeasurementsFile, survey: &Survey, pulley: usize) -> Option<String> {
    let measured: Measurements = file.measurements(Method::Survey).ok()?;
    let xy = &survey.anchors_xy_m;
    let off = |r: &&Range| {
        let (a, b) = (xy[r.from], xy[r.to]);
        ((a[0] - b[0]).hypot(a[1] - b[1]) - r.m).abs()
    };
    let within = measured.ranges.iter().filter(|r| r.from.max(r.to) < pulley);
    let worst = within.max_by(|p, q| (off(p) / p.sigma_m).total_cmp(&(off(q) / q.sigma_m)))?;
    (survey.degrees_of_freedom > 0 && off(&worst) > MISFIT_SIGMAS * worst.sigma_m).then(|| {
        say!(
            "These distances do not quite fit: even in the best shape, {}-{} is off by {}. If one of them may be wrong, \
             take them back with undo.",
            worst.from.min(worst.to) + 1,
            worst.from.max(worst.to) + 1,
            metres(off(&worst))
        )
    })
}

/// Rejects cable lengths of a point that contradict each other: two cables that are too short to meet.
///
/// # Errors
/// One sentence that names the two cables.
pub fn check_lengths(anchors: &[[f64; 3]], lengths_m: &[f64], slack_m: f64) -> Result<(), String> {
    for (i, a) in anchors.iter().enumerate() {
        for (j, b) in anchors.iter().enumerate().skip(i + 1) {
            let apart = (a[0] - b[0]).hypot(a[1] - b[1]);
            if let (Some(first), Some(second)) = (lengths_m.get(i), lengths_m.get(j))
                && first + second + slack_m < apart
            {
                return Err(say!(
                    "cables {} and {} cannot meet: {} and {} together are less than the {} between their pulleys; read them again",
                    i + 1,
                    j + 1,
                    metres(*first),
                    metres(*second),
                    metres(apart)
                ));
            }
        }
    }
    Ok(())
}
