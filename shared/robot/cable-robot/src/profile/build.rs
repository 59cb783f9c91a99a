//! Computation of a profile: trapezoids on straight paths; otherwise two passes over samples, reduced to few knots.

use super::{Knot, MAX_KNOTS, Profile, ProfileError, ProfileLimits, ROUNDING};
use crate::path::Path;

/// Samples of a curved path. With these a spiral of three turns has a sample every 2 degrees.
const SAMPLES: usize = 512;

/// Samples of a parabola, which turns by less than half a circle and has most of its samples where it turns.
const PARABOLA_SAMPLES: usize = 256;

/// Shares of the acceleration limit available to curvature, tried in this order. With 0.8 across, 0.6 remain along the
/// path everywhere (0.8² + 0.6² = 1), so that a profile can always brake before a curve. Lower shares leave more room
/// between the profile and the limit and so need fewer knots.
const ACROSS_SHARES: [f64; 4] = [0.8, 0.65, 0.5, 0.35];

/// Appends knots, ignoring those that coincide with the previous one.
struct Builder {
    knots: [Knot; MAX_KNOTS],
    count: usize,
}

impl Builder {
    fn new() -> Self {
        Self { knots: [Knot::default(); MAX_KNOTS], count: 0 }
    }

    /// Returns false if the profile is full.
    fn push(&mut self, s_m: f64, v_m_s: f64) -> bool {
        if self.count == MAX_KNOTS {
            return false;
        }
        self.knots[self.count] = Knot { s_m, v_m_s };
        self.count += 1;
        true
    }

    fn profile(&self) -> Result<Profile, ProfileError> {
        Profile::from_knots(&self.knots[..self.count])
    }
}

impl Profile {
    /// Computes the fastest profile of this kind within the limits: exact trapezoids on straight paths; otherwise a
    /// forward and a backward pass over samples, reduced to few knots that keep the limits between the samples too.
    ///
    /// On curved paths the centripetal acceleration is at most 80 % of the total limit (`ACROSS_SHARES`).
    pub fn plan(path: &Path, limits: &ProfileLimits) -> Result<Self, ProfileError> {
        limits.check()?;
        let length = path.length();
        if !(length.is_finite() && length > 0.0) {
            return Err(ProfileError::InvalidLimit {
                what: "the length of the path",
                value: length,
                accepted: "above 0 m; use a dwell to stay in place",
            });
        }
        if path.is_straight() { straight(length, limits) } else { curved(path, length, limits) }
    }
}

pub(super) fn straight(length: f64, limits: &ProfileLimits) -> Result<Profile, ProfileError> {
    let a = limits.tangential_m_s2.min(limits.total_m_s2);
    let (start2, end2) = (limits.start_m_s * limits.start_m_s, limits.end_m_s * limits.end_m_s);
    let reach = 2.0 * a * length;
    let too_fast = |end, wanted_m_s: f64, allowed2: f64| {
        Err(ProfileError::EndTooFast { end, wanted_m_s, allowed_m_s: allowed2.sqrt() })
    };
    if start2 > (end2 + reach) * (1.0 + ROUNDING) {
        return too_fast("start", limits.start_m_s, end2 + reach);
    }
    if end2 > (start2 + reach) * (1.0 + ROUNDING) {
        return too_fast("end", limits.end_m_s, start2 + reach);
    }
    let cruise2 = limits.cruise_m_s * limits.cruise_m_s;
    let peak2 = cruise2.min(0.5 * (start2 + end2 + reach)).max(start2.max(end2));
    let peak = peak2.sqrt();
    let rise = ((peak2 - start2) / (2.0 * a)).min(length);
    let fall = ((peak2 - end2) / (2.0 * a)).min(length);
    // Knots closer than this to their neighbour would only carry rounding.
    let least = 1e-12 * length;
    let mut builder = Builder::new();
    builder.push(0.0, if rise > least { limits.start_m_s } else { peak });
    if rise > least && rise < length - least {
        builder.push(rise, peak);
    }
    if fall > least && length - fall > rise + least {
        builder.push(length - fall, peak);
    }
    builder.push(length, if fall > least { limits.end_m_s } else { peak });
    builder.profile()
}

/// A sampled curved path: curvature at each sample, and v² of the profile.
struct Samples {
    /// Index of the last one.
    last: usize,
    s: [f64; SAMPLES],
    /// Largest curvature around each sample, 1/m.
    curvature: [f64; SAMPLES],
    /// v², m²/s².
    w: [f64; SAMPLES],
}

impl Samples {
    fn new(path: &Path, length: f64) -> Self {
        let is_parabola = matches!(path, Path::Parabola(_));
        let last = if is_parabola { PARABOLA_SAMPLES } else { SAMPLES } - 1;
        let mut samples = Self { last, s: [0.0; SAMPLES], curvature: [0.0; SAMPLES], w: [0.0; SAMPLES] };
        let mut at = [0.0; SAMPLES];
        let mut between = [0.0; SAMPLES];
        path.sample(&mut samples.s[..=last], &mut at[..=last]);
        samples.s[last] = length;
        // The curvature of a parabola rises up to its sharpest point, which a sample has, and falls beyond: between two
        // samples it is never above both.
        if !is_parabola {
            between = std::array::from_fn(|i| path.curvature(0.5 * (samples.s[i] + samples.s[(i + 1).min(last)])));
        }
        // Each sample covers the intervals on both its sides.
        for i in 0..=last {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(last));
            samples.curvature[i] = at[i].max(at[before]).max(at[after]).max(between[before]).max(between[i]);
        }
        samples
    }

    /// Time of the chord between two samples, s.
    fn chord_s(&self, i: usize, j: usize) -> f64 {
        2.0 * (self.s[j] - self.s[i]) / (self.w[i].sqrt() + self.w[j].sqrt())
    }

    /// Time from the start to each sample, s.
    fn times_s(&self) -> [f64; SAMPLES] {
        let mut times_s = [0.0; SAMPLES];
        for k in 1..=self.last {
            times_s[k] = times_s[k - 1] + self.chord_s(k - 1, k);
        }
        times_s
    }
}

fn curved(path: &Path, length: f64, limits: &ProfileLimits) -> Result<Profile, ProfileError> {
    if path.greatest_curvature().is_some_and(|curvature| is_gentle(curvature, limits)) {
        return straight(length, limits);
    }
    let mut samples = Samples::new(path, length);
    let mut failure = None;
    for share in ACROSS_SHARES {
        match speed_passes(&mut samples, limits, share) {
            // A start speed that is too high for a lower share may be possible with a higher one.
            Err(e) => {
                failure = failure.or(Some(e));
                break;
            }
            Ok(()) => {
                if let Some(profile) = reduce_to_knots(&samples, limits) {
                    return profile;
                }
            }
        }
    }
    if let Some(error) = failure {
        return Err(error);
    }
    // More than MAX_KNOTS knots: use one cruise speed that fits the greatest curvature.
    let sharpest = samples.curvature[..=samples.last].iter().fold(0.0, |m: f64, k| m.max(*k));
    let across = ACROSS_SHARES[0] * limits.total_m_s2;
    let cruise_m_s = limits.cruise_m_s.min((across / sharpest).sqrt());
    let tangential_m_s2 = limits.tangential_m_s2.min((limits.total_m_s2 * limits.total_m_s2 - across * across).sqrt());
    for (end, wanted_m_s) in [("start", limits.start_m_s), ("end", limits.end_m_s)] {
        if wanted_m_s > cruise_m_s {
            return Err(ProfileError::EndTooFast { end, wanted_m_s, allowed_m_s: cruise_m_s });
        }
    }
    straight(length, &ProfileLimits { cruise_m_s, tangential_m_s2, ..*limits })
}

/// True if no curve with this curvature reduces the acceleration along the path at any speed.
fn is_gentle(curvature: f64, limits: &ProfileLimits) -> bool {
    let fastest_m_s = limits.cruise_m_s.max(limits.start_m_s).max(limits.end_m_s);
    let across = fastest_m_s * fastest_m_s * curvature;
    let along = limits.tangential_m_s2.min(limits.total_m_s2);
    across <= ACROSS_SHARES[0] * limits.total_m_s2
        && across * across + along * along <= limits.total_m_s2 * limits.total_m_s2
}

/// Computes in `w` the fastest v² whose centripetal acceleration stays below `share` of the limit and whose slope stays
/// below the remaining tangential acceleration.
fn speed_passes(samples: &mut Samples, limits: &ProfileLimits, share: f64) -> Result<(), ProfileError> {
    let last = samples.last;
    let total = limits.total_m_s2;
    let ceiling = |k: f64| {
        let cruise2 = limits.cruise_m_s * limits.cruise_m_s;
        if k * cruise2 > share * total { share * total / k } else { cruise2 }
    };
    let tangential = |k: f64| {
        let across = k * ceiling(k);
        limits.tangential_m_s2.min((total * total - across * across).max(0.0).sqrt())
    };
    for i in 0..=last {
        samples.w[i] = ceiling(samples.curvature[i]);
    }
    let (start2, end2) = (limits.start_m_s * limits.start_m_s, limits.end_m_s * limits.end_m_s);
    let ends = [("start", limits.start_m_s, 0), ("end", limits.end_m_s, last)];
    for (end, wanted_m_s, i) in ends {
        if wanted_m_s * wanted_m_s > samples.w[i] * (1.0 + ROUNDING) {
            return Err(ProfileError::EndTooFast { end, wanted_m_s, allowed_m_s: samples.w[i].sqrt() });
        }
    }
    samples.w[0] = start2;
    samples.w[last] = end2;
    let gain = |samples: &Samples, i: usize| {
        let a = tangential(samples.curvature[i]).min(tangential(samples.curvature[i + 1]));
        2.0 * a * (samples.s[i + 1] - samples.s[i])
    };
    for i in 0..last {
        samples.w[i + 1] = samples.w[i + 1].min(samples.w[i] + gain(samples, i));
    }
    if samples.w[last] < end2 * (1.0 - ROUNDING) {
        return Err(ProfileError::EndTooFast {
            end: "end",
            wanted_m_s: limits.end_m_s,
            allowed_m_s: samples.w[last].sqrt(),
        });
    }
    for i in (0..last).rev() {
        samples.w[i] = samples.w[i].min(samples.w[i + 1] + gain(samples, i));
    }
    if samples.w[0] < start2 * (1.0 - ROUNDING) {
        return Err(ProfileError::EndTooFast {
            end: "start",
            wanted_m_s: limits.start_m_s,
            allowed_m_s: samples.w[0].sqrt(),
        });
    }
    Ok(())
}

/// Reduces the samples to few knots: from each knot the longest chord in v² over s that keeps the limits. None if that
/// needs too many knots. Chords are compared with the limits, not with the sampled profile: the room that the profile
/// leaves saves knots.
fn reduce_to_knots(samples: &Samples, limits: &ProfileLimits) -> Option<Result<Profile, ProfileError>> {
    let last = samples.last;
    let times_s = samples.times_s();
    let mut builder = Builder::new();
    let mut i = 0;
    builder.push(0.0, limits.start_m_s);
    while i < last {
        // The longest allowed chord; the neighbour is always allowed. Testing distant samples first
        // would cost more time.
        let mut j = i + 1;
        let mut misses = 0;
        let mut chords = Chords::from(samples, i, limits);
        chords.pass(samples, i);
        chords.pass(samples, j);
        for candidate in i + 2..=last {
            chords.pass(samples, candidate);
            // A long chord far below the samples would cost time: it may take at most 1 % longer.
            let sampled_s = times_s[candidate] - times_s[i];
            if chords.allow(samples, candidate) && samples.chord_s(i, candidate) <= 1.01 * sampled_s {
                j = candidate;
                misses = 0;
            } else {
                misses += 1;
                if misses > 24 {
                    break;
                }
            }
        }
        let v = if j == last { limits.end_m_s } else { samples.w[j].sqrt() };
        if !builder.push(if j == last { samples.s[last] } else { samples.s[j] }, v) {
            return None;
        }
        i = j;
    }
    Some(builder.profile())
}

/// Chords in v² over s from one sample, by their slope d(v²)/ds, m/s²: those that keep the limits at all samples that
/// they pass. Each sample allows an interval of slopes, because the square of the acceleration is a convex parabola of
/// the slope.
struct Chords {
    start_m: f64,
    /// v² at the start, m²/s².
    w: f64,
    cruise2: f64,
    total2: f64,
    least: f64,
    most: f64,
}

impl Chords {
    fn from(samples: &Samples, i: usize, limits: &ProfileLimits) -> Self {
        let steepest = 2.0 * limits.tangential_m_s2 * (1.0 + ROUNDING);
        Self {
            start_m: samples.s[i],
            w: samples.w[i],
            cruise2: limits.cruise_m_s * limits.cruise_m_s * (1.0 + ROUNDING),
            total2: limits.total_m_s2 * limits.total_m_s2 * (1.0 + ROUNDING),
            least: -steepest,
            most: steepest,
        }
    }

    /// Leaves those that keep the limits at this sample: v² = w + slope d below that of the cruise speed, and
    /// (slope / 2)² + (curvature v²)² below the square of the total acceleration.
    fn pass(&mut self, samples: &Samples, k: usize) {
        let d = samples.s[k] - self.start_m;
        let curvature2 = samples.curvature[k] * samples.curvature[k];
        let square = 0.25 + curvature2 * d * d;
        let half_linear = curvature2 * self.w * d;
        let constant = curvature2 * self.w * self.w - self.total2;
        // NaN, which allows nothing, if there is no such slope.
        let root = (half_linear * half_linear - square * constant).sqrt();
        let (low, high) = ((-half_linear - root) / square, (root - half_linear) / square);
        self.least = if low > self.least || low.is_nan() { low } else { self.least };
        self.most = if high < self.most || high.is_nan() { high } else { self.most };
        if d > 0.0 {
            self.most = self.most.min((self.cruise2 - self.w) / d);
        }
    }

    /// True if the chord to the last sample that was passed is one of them.
    fn allow(&self, samples: &Samples, j: usize) -> bool {
        (self.least..=self.most).contains(&((samples.w[j] - self.w) / (samples.s[j] - self.start_m)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::Spiral;
    use nalgebra::Vector3;

    #[test]
    fn the_papers_spiral_loses_little_to_the_reduction() {
        let path = Path::Spiral(Spiral {
            centre: Vector3::new(4.8, 3.0, 0.8),
            start_radius_m: 0.0,
            end_radius_m: 0.6,
            turns: 3.0,
            rise_m: 1.125,
            start_angle_rad: 0.0,
        });
        let limits = ProfileLimits::rest_to_rest(0.2, 0.5);
        let profile = Profile::plan(&path, &limits).unwrap();
        let mut samples = Samples::new(&path, path.length());
        speed_passes(&mut samples, &limits, 0.8).unwrap();
        let dense = samples.times_s()[samples.last];
        assert!(profile.duration() < 1.03 * dense, "{} {dense}", profile.duration());
        assert!(profile.knots().len() <= 16, "{}", profile.knots().len());
        assert!(profile.knots().iter().any(|k| (k.v_m_s - 0.2).abs() < 1e-6), "cruise is reached");
    }
}
