//! Flags of sensor values in the manner of QARTOD: gaps, flat lines and spikes, judged by the values themselves.
//!
//! The gross range of a sensor is not recorded, so it is not judged; readings that the device marks are counted apart.

use serde::Serialize;

/// Multiple of the usual interval from which a silence is a gap.
const GAP: f64 = 5.0;
/// Shortest gap, s: a busy computer delays samples for less.
const GAP_S: f64 = 0.5;
/// Shortest time with the same value that is a flat line, s. Coarse devices repeat a value for seconds.
const FLAT_S: f64 = 60.0;
/// Multiple of the usual deviation from the mean of both neighbours by which a spike is beyond each of them. Of
/// normally distributed noise, not one in 1e15 is as large.
const SPIKE: f64 = 10.0;
/// Samples before anything is judged: until then the usual interval and deviation are not known.
const LEARNED: u64 = 20;
/// Weight of the newest sample in the usual interval and deviation.
const NEWEST: f64 = 0.02;

/// One kind of flag.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Flag {
    /// Number of flagged places.
    pub count: u64,
    /// Time of the first one, s since the start of the run.
    pub first_s: Option<f64>,
    /// The largest one: of a gap and a flat line its duration, s; of a spike its size, in the unit of the value.
    pub largest: f64,
}

impl Flag {
    fn add(&mut self, time_s: f64, size: f64) {
        self.count += 1;
        self.first_s.get_or_insert(time_s);
        self.largest = self.largest.max(size);
    }
}

/// Flags of one value of a sensor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Flags {
    /// Silences.
    pub gaps: Flag,
    /// Times with the same value, the last one included.
    pub flat_lines: Flag,
    /// Values far from both neighbours.
    pub spikes: Flag,
}

/// Judges one value of a sensor, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Quality {
    flags: Flags,
    samples: u64,
    /// The last two values, with their times; the newest last.
    last: [Option<(f64, f64)>; 2],
    interval_s: f64,
    deviation: f64,
    /// Since when the value has been the same, s.
    same_since_s: f64,
}

impl Quality {
    /// Adds a value; ignores those that are not finite.
    pub fn add(&mut self, time_s: f64, value: f64) {
        if !value.is_finite() || self.last[1].is_some_and(|(last_s, _)| time_s < last_s) {
            return;
        }
        self.samples += 1;
        let judged = self.samples > LEARNED;
        if let Some((last_s, last)) = self.last[1] {
            let interval_s = time_s - last_s;
            let gap = judged && interval_s > GAP_S.max(GAP * self.interval_s);
            if gap {
                self.flags.gaps.add(last_s, interval_s);
            } else {
                learn(&mut self.interval_s, interval_s, self.samples);
            }
            if value.to_bits() != last.to_bits() || gap {
                self.end_of_flat_line(last_s);
                self.same_since_s = time_s;
            }
            if let (Some((_, before)), false) = (self.last[0], gap) {
                self.spike(last_s, [before, last, value], judged);
            }
            // After a gap, the values before it are no neighbours.
            self.last = [if gap { None } else { self.last[1] }, Some((time_s, value))];
        } else {
            (self.last[1], self.same_since_s) = (Some((time_s, value)), time_s);
        }
    }

    fn spike(&mut self, time_s: f64, [before, middle, after]: [f64; 3], judged: bool) {
        let size = (middle - 0.5 * (before + after)).abs();
        let most = SPIKE * self.deviation;
        // A neighbour of a spike is far from it alone.
        let nearest = (middle - before).abs().min((middle - after).abs());
        let outside = (middle > before.max(after)) || (middle < before.min(after));
        let known = judged && self.deviation > 0.0;
        if known && outside && nearest > most {
            self.flags.spikes.add(time_s, size);
        } else {
            learn(&mut self.deviation, if known { size.min(most) } else { size }, self.samples);
        }
    }

    fn end_of_flat_line(&mut self, end_s: f64) {
        let flat_s = end_s - self.same_since_s;
        if flat_s >= FLAT_S {
            self.flags.flat_lines.add(self.same_since_s, flat_s);
        }
    }

    /// Returns the flags so far.
    #[must_use]
    pub fn flags(&self) -> Flags {
        let mut all = self.clone();
        if let Some((last_s, _)) = self.last[1] {
            all.end_of_flat_line(last_s);
        }
        all.flags
    }
}

/// Moves a usual value towards a new one: a mean at first, then with a fixed weight.
fn learn(usual: &mut f64, new: f64, samples: u64) {
    *usual += (new - *usual) * NEWEST.max(1.0 / samples as f64);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise of at most 0.5, the same in every run.
    fn noise(at: u32) -> f64 {
        f64::from(at.wrapping_mul(2_654_435_761) >> 8) / f64::from(1_u32 << 24) - 0.5
    }

    /// Flags of two minutes at 10 Hz.
    fn flags(value: impl Fn(u32) -> Option<f64>) -> Flags {
        let mut quality = Quality::default();
        for at in 0..1200 {
            value(at).into_iter().for_each(|value| quality.add(f64::from(at) * 0.1, value));
        }
        quality.flags()
    }

    #[test]
    fn noise_ramps_and_coarse_values_have_no_flag() {
        assert_eq!(flags(|at| Some(noise(at))), Flags::default());
        assert_eq!(flags(|at| Some(0.01 * f64::from(at) + noise(at))), Flags::default());
        assert_eq!(flags(|at| Some(f64::from(at / 100))), Flags::default());
    }

    #[test]
    fn each_fault_of_a_sensor_has_its_flag() {
        let gap = flags(|at| (!(300..350).contains(&at)).then(|| noise(at))).gaps;
        assert_eq!(gap.count, 1);
        assert!(
            (gap.largest - 5.1).abs() < 1e-6 && gap.first_s.is_some_and(|at_s| (at_s - 29.9).abs() < 1e-6),
            "{gap:?}"
        );
        let flat = flags(|at| Some(if at < 500 { noise(at) } else { 0.25 })).flat_lines;
        assert_eq!((flat.count, flat.first_s.map(f64::round)), (1, Some(50.0)));
        let spikes = flags(|at| Some(if at == 700 || at == 900 { 20.0 } else { noise(at) })).spikes;
        assert_eq!((spikes.count, spikes.first_s.map(f64::round)), (2, Some(70.0)));
        assert!((spikes.largest - 20.0).abs() < 1.0);
        let silent = flags(|_| Some(f64::NAN));
        assert_eq!(silent, Flags::default());
    }
}
