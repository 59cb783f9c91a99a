//! Mean motor currents while the node moves up and down at one speed, from samples of a robot: a
//! [`Weighing`].
//!
//! Both ways count in the middle half of the height that the node covers at full speed, so their mean height is the
//! same. Lengths in m, forces in N, currents in A.

use cable_robot::CableVec;

use super::loads::Weighing;

/// Least samples of each way: half a second at 100 Hz, in which the noise of a current averages out.
const LEAST_SAMPLES: usize = 50;

/// Least speed and height, m/s and m: below, stick-slip and swinging dominate.
const LEAST_M_S: f64 = 0.02;
const LEAST_HEIGHT_M: f64 = 0.1;

/// Greatest difference from the full speed, as a share of it. The full speed is the median: of a motion by 0.4 m the
/// ramps are a small part, and a correction of the controller is a short peak.
const FULL: f64 = 0.1;

/// Greatest level speed as a share of the vertical one, and greatest way to the side, m, of an upright motion.
const LEVEL: f64 = 0.1;
const BESIDE_M: f64 = 0.1;

/// Most samples that are kept: an hour at 100 Hz.
const MOST_SAMPLES: usize = 360_000;

/// One sample of a moving robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    /// Position of the node, m.
    pub position_m: [f64; 3],
    /// Its commanded velocity, m/s.
    pub velocity_m_s: [f64; 3],
    /// Current of each motor, A; positive where it pulls the cable in.
    pub current_a: CableVec,
}

/// Collects the samples of an upright motion.
#[derive(Debug, Clone, Default)]
pub struct UpAndDown {
    samples: Vec<Moving>,
}

impl UpAndDown {
    /// Takes a sample; one at rest, of another motion or without a position does not count.
    pub fn take(&mut self, sample: &Moving) {
        let [x, y, z] = sample.velocity_m_s;
        let finite = sample.position_m.iter().chain(sample.current_a.iter()).all(|v| v.is_finite());
        // Also false for NaN.
        let upright = z.abs() >= LEAST_M_S && libm::hypot(x, y) <= LEVEL * z.abs();
        if finite && upright && self.samples.len() < MOST_SAMPLES {
            self.samples.push(*sample);
        }
    }

    /// Returns the mean currents of both ways with this weight on the node, N.
    ///
    /// # Errors
    /// One clause: why the motion so far is no weighing, and what to do.
    pub fn weighing(&self, added_n: f64) -> Result<Weighing, String> {
        let mut speeds_m_s: Vec<f64> = self.samples.iter().map(|s| s.velocity_m_s[2].abs()).collect();
        speeds_m_s.sort_by(f64::total_cmp);
        let full_m_s = speeds_m_s.get(speeds_m_s.len() / 2).copied().unwrap_or_default();
        let is_full = |s: &&Moving| (s.velocity_m_s[2].abs() - full_m_s).abs() <= FULL * full_m_s;
        let full: Vec<&Moving> = self.samples.iter().filter(is_full).collect();
        let extent = |k: usize| {
            full.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), s| {
                (low.min(s.position_m[k]), high.max(s.position_m[k]))
            })
        };
        let [(left_m, right_m), (front_m, back_m), (low_m, high_m)] = [extent(0), extent(1), extent(2)];
        let height_m = high_m - low_m;
        // Also true without a sample.
        if !(height_m >= LEAST_HEIGHT_M) {
            return Err(say!(
                "the node has not moved up and down by {LEAST_HEIGHT_M} m at one speed of at least {LEAST_M_S} m/s; \
                 let it go 0.4 m up and down again"
            ));
        }
        if (right_m - left_m).max(back_m - front_m) > BESIDE_M {
            return Err(say!(
                "the node moved up and down at places that are more than {BESIDE_M} m apart; let it go up and down at one"
            ));
        }
        let middle = (low_m + 0.25 * height_m)..=(high_m - 0.25 * height_m);
        let mean = |up: bool| -> Option<(CableVec, [f64; 3])> {
            let way: Vec<&&Moving> =
                full.iter().filter(|s| (s.velocity_m_s[2] > 0.0) == up && middle.contains(&s.position_m[2])).collect();
            let count = way.len();
            let of = |value: &dyn Fn(&Moving) -> f64| way.iter().map(|s| value(s)).sum::<f64>() / count as f64;
            let cables = way.first()?.current_a.len();
            (count >= LEAST_SAMPLES).then(|| {
                (
                    CableVec::from_fn(cables, |i| of(&|s| s.current_a[i])),
                    [of(&|s| s.position_m[0]), of(&|s| s.position_m[1]), of(&|s| s.position_m[2])],
                )
            })
        };
        let (Some((up_a, up_m)), Some((down_a, down_m))) = (mean(true), mean(false)) else {
            return Err(say!(
                "a way has fewer than {LEAST_SAMPLES} samples in the middle of the height; let the node go up and down again"
            ));
        };
        let position_m = [0, 1, 2].map(|k| 0.5 * (up_m[k] + down_m[k]));
        Ok(Weighing { position_m, added_n, up_a, down_a })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion between 0.3 and 0.7 m, with ramps at its ends.
    fn motion(times: usize, x_m: f64) -> UpAndDown {
        let mut motion = UpAndDown::default();
        for _ in 0..times {
            for way in [1.0, -1.0] {
                for k in 0..400 {
                    let share = f64::from(k) / 400.0;
                    let speed = 0.1 * (share.min(1.0 - share) * 10.0).min(1.0);
                    let z_m = if way > 0.0 { 0.3 + 0.4 * share } else { 0.7 - 0.4 * share };
                    // The ramps have other currents, which must not count.
                    let amperes = if speed < 0.1 { 9.0 } else { 0.5 + 0.2 * way };
                    let current_a = CableVec::from_fn(3, |i| amperes + 0.1 * i as f64);
                    motion.take(&Moving {
                        position_m: [x_m, 2.0, z_m],
                        velocity_m_s: [0.0, 0.0, way * speed],
                        current_a,
                    });
                }
            }
        }
        motion
    }

    #[test]
    fn both_ways_have_their_mean_at_the_same_height() {
        let found = motion(2, 1.0).weighing(20.0).unwrap();
        assert!((found.position_m[2] - 0.5).abs() < 0.01 && found.added_n == 20.0, "{found:?}");
        for i in 0..3 {
            assert!((found.up_a[i] - 0.7 - 0.1 * i as f64).abs() < 1e-12, "{found:?}");
            assert!((found.down_a[i] - 0.3 - 0.1 * i as f64).abs() < 1e-12, "{found:?}");
        }
    }

    #[test]
    fn a_peak_of_the_command_does_not_hide_the_motion() {
        let calm = motion(2, 1.0);
        let mut peak = calm.clone();
        peak.samples[150].velocity_m_s[2] *= 3.0;
        let (calm, peak) = (calm.weighing(20.0).unwrap(), peak.weighing(20.0).unwrap());
        assert!((calm.up_a[0] - peak.up_a[0]).abs() < 1e-9 && (calm.down_a[0] - peak.down_a[0]).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_upright_motion_is_refused() {
        assert!(UpAndDown::default().weighing(0.0).is_err());
        let mut mixed = motion(1, 1.0);
        mixed.samples.extend(motion(1, 3.0).samples);
        assert!(mixed.weighing(0.0).unwrap_err().contains("apart"));
        let mut up = motion(1, 1.0);
        up.samples.retain(|s| s.velocity_m_s[2] > 0.0);
        assert!(up.weighing(0.0).unwrap_err().contains("samples"));
        // A motion to the side, at rest or without a position does not count.
        let mut other = UpAndDown::default();
        for sample in motion(1, 1.0).samples {
            let [x, y, z] = sample.velocity_m_s;
            other.take(&Moving { velocity_m_s: [x + z, y, z], ..sample });
            other.take(&Moving { velocity_m_s: [x, y, 0.0], ..sample });
            other.take(&Moving { position_m: [f64::NAN; 3], ..sample });
        }
        assert!(other.samples.is_empty());
    }
}
