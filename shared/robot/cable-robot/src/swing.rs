//! Profiles that do not make the node swing on its cables.

use nalgebra::Vector3;

use crate::modes::Modes;
use crate::motion::ACCELERATION_EXCESS;
use crate::profile::{slope, speed_between};
use crate::{Distribution, Path, Profile, Robot, tension};

/// Samples of a path at which a shaped profile is compared with the limit of the acceleration. A parabola that is
/// twenty times as deep as wide has the largest acceleration at most 0.2 % above that of its samples.
const SAMPLES: usize = 2048;
/// Share of the limit that leaves room for this.
const AT_SAMPLES: f64 = 0.998;

/// Returns the profile, shaped where its accelerations would make the node swing by more than the limit, m.
pub fn shaped(robot: &Robot, distribution: Distribution, path: &Path, profile: Profile, limit_m: f64) -> Profile {
    let Some(period_s) = swing_period_s(robot, distribution, path, &profile, limit_m) else { return profile };
    profile.shaped(period_s).filter(|shaped| keeps_limit(robot, path, shaped)).unwrap_or(profile)
}

/// Returns the period of the mode that swings most after the jumps of the acceleration, s: the mean of those at both
/// ends, where most jumps are. None if no swing exceeds the limit.
fn swing_period_s(
    robot: &Robot,
    distribution: Distribution,
    path: &Path,
    profile: &Profile,
    limit_m: f64,
) -> Option<f64> {
    let steepest_m_s2 = steepest_m_s2(profile);
    let (mut largest_m, mut weighted, mut weights) = (0.0_f64, 0.0, 0.0);
    for s_m in [0.0, path.length()] {
        let at = path.point(s_m);
        // The check refuses what cannot be held.
        let held = tension::at(robot, &at, &Vector3::zeros(), distribution).ok()?;
        let acceleration_m_s2 = path.tangent(s_m) * steepest_m_s2;
        let mode = Modes::at(robot, &at, &held.tensions_n)?.largest(&acceleration_m_s2);
        let swing_m = mode.swing_m(&acceleration_m_s2);
        largest_m = largest_m.max(swing_m);
        weighted += swing_m * mode.period_s();
        weights += swing_m;
    }
    (largest_m > limit_m && weights > 0.0).then(|| weighted / weights)
}

/// Largest tangential acceleration of a profile, m/s².
fn steepest_m_s2(profile: &Profile) -> f64 {
    profile.knots().windows(2).map(|pair| slope(pair[0], pair[1]).abs()).fold(0.0, f64::max)
}

/// On a curved path the copies of a profile reach a bend at other times, and their mean passes it faster than a profile
/// that slows down there.
fn keeps_limit(robot: &Robot, path: &Path, profile: &Profile) -> bool {
    if path.is_straight() {
        return true;
    }
    let limit_m_s2 = robot.acceleration_limit_m_s2() * ACCELERATION_EXCESS * AT_SAMPLES;
    let within = |across_m_s2: f64, along_m_s2: f64| {
        across_m_s2 * across_m_s2 + along_m_s2 * along_m_s2 <= limit_m_s2 * limit_m_s2
    };
    let fastest_m_s = profile.knots().iter().map(|knot| knot.v_m_s).fold(0.0, f64::max);
    let bends_gently = |curvature| within(fastest_m_s * fastest_m_s * curvature, steepest_m_s2(profile));
    if path.greatest_curvature().is_some_and(bends_gently) {
        return true;
    }
    let (mut arc_lengths_m, mut curvatures) = ([0.0; SAMPLES], [0.0; SAMPLES]);
    path.sample(&mut arc_lengths_m, &mut curvatures);
    profile.knots().windows(2).all(|pair| {
        let (from, to) = (pair[0], pair[1]);
        let along_m_s2 = slope(from, to);
        let keeps = |s_m: f64, curvature: f64| {
            let v_m_s = speed_between(from, to, s_m);
            within(v_m_s * v_m_s * curvature, along_m_s2)
        };
        let [first, end] = [from.s_m, to.s_m].map(|knot_m| arc_lengths_m.partition_point(|s_m| *s_m < knot_m));
        [from.s_m, to.s_m].iter().all(|s_m| keeps(*s_m, path.curvature(*s_m)))
            && (first..end).all(|i| keeps(arc_lengths_m[i], curvatures[i]))
    })
}
