//! Flags of sensor values in the manner of QARTOD: gaps, flat lines, spikes and values outside the sensor's range.
//!
//! The sensor logger judges live, and the report judges a recorded run, by the same steps. Readings that the device
//! itself marks are counted apart.

use messages::SensorFlag;

/// Multiple of the usual interval from which a silence is a gap.
const GAP: f64 = 5.0;
/// Shortest gap, s: a busy computer delays samples for less.
const GAP_S: f64 = 0.5;
/// Shortest time with the same value that is a flat line, s. Coarse devices repeat a value for seconds.
const FLAT_S: f64 = 60.0;
/// Multiple of the usual deviation from the mean of both neighbours by which a spike is beyond each of them. Of
/// normally distributed noise, not one in 1e15 is as large.
const SPIKE: f64 = 10.0;
/// Samples before anything but the range is judged: until then the usual interval and deviation are not known.
const LEARNED: u64 = 20;
/// Weight of the newest sample in the usual interval and deviation.
const NEWEST: f64 = 0.02;

/// Why a value is doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doubt {
    /// A silence. It begins with the last value before it and ends with the first one after it.
    Gap,
    /// The same value for a minute or longer.
    Flat,
    /// Far from both neighbours.
    Spike,
    /// Outside the range of the sensor.
    Range,
}

impl Doubt {
    /// Number of kinds.
    pub const COUNT: usize = 4;

    /// Returns its number in a [`SensorFlag`].
    #[must_use]
    pub fn kind(self) -> u8 {
        match self {
            Self::Gap => SensorFlag::KIND_GAP,
            Self::Flat => SensorFlag::KIND_FLAT,
            Self::Spike => SensorFlag::KIND_SPIKE,
            Self::Range => SensorFlag::KIND_RANGE,
        }
    }
}

/// A doubtful place in the values of a sensor. What lasts is found twice: when it is known, and when it ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Why.
    pub doubt: Doubt,
    /// Time of the first value concerned, ns.
    pub begin_ns: u64,
    /// Time of the last value concerned, ns; `None`: it lasts.
    pub end_ns: Option<u64>,
    /// Of a gap and a flat line the duration so far, s; else the distance from what is believable, in the unit of the
    /// value.
    pub size: f64,
}

/// Places of one kind.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tally {
    /// Number of places.
    pub count: u64,
    /// Begin of the first one, ns.
    pub first_ns: Option<u64>,
    /// Size of the largest one, as in [`Place::size`].
    pub largest: f64,
}

/// Judges one value of a sensor, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Quality {
    /// Least and greatest believable value.
    range: Option<[f64; 2]>,
    /// By the number of [`Doubt`].
    tallies: [Tally; Doubt::COUNT],
    /// Begin, ns, and size of the place of each kind that lasts.
    lasting: [Option<(u64, f64)>; Doubt::COUNT],
    samples: u64,
    /// The last two values, with their times; the newest last.
    last: [Option<(u64, f64)>; 2],
    interval_s: f64,
    deviation: f64,
    /// Since when the value has been the same, ns.
    same_since_ns: u64,
}

impl Quality {
    /// Creates a judge of a value with this range, if it is known.
    #[must_use]
    pub fn new(range: Option<[f64; 2]>) -> Self {
        Self { range, ..Self::default() }
    }

    /// Returns the places of one kind so far.
    #[must_use]
    pub fn tally(&self, doubt: Doubt) -> Tally {
        self.tallies[usize::from(doubt.kind())]
    }

    /// Judges a value and passes what it shows to `found`; ignores values that are not finite, and those that are
    /// older than the last one.
    pub fn add(&mut self, at_ns: u64, value: f64, found: &mut impl FnMut(Place)) {
        if !value.is_finite() || self.last[1].is_some_and(|(last_ns, _)| at_ns < last_ns) {
            return;
        }
        self.samples += 1;
        let Some((last_ns, last)) = self.last[1] else {
            (self.last[1], self.same_since_ns) = (Some((at_ns, value)), at_ns);
            self.judge_range(at_ns, at_ns, value, found);
            return;
        };
        let interval_s = seconds(at_ns - last_ns);
        let gap = self.is_gap(interval_s);
        if !gap {
            learn(&mut self.interval_s, interval_s, self.samples);
        }
        // Readings of a link that stood still arrive late, with their times of measurement.
        if gap || self.lasting[usize::from(Doubt::Gap.kind())].is_some() {
            self.place(Doubt::Gap, last_ns, Some(at_ns), interval_s, found);
        }
        if value.to_bits() != last.to_bits() || gap {
            self.judge_flat_line(last_ns, true, found);
            self.same_since_ns = at_ns;
        } else {
            self.judge_flat_line(at_ns, false, found);
        }
        if let (Some((_, before)), false) = (self.last[0], gap) {
            self.judge_spike(last_ns, [before, last, value], found);
        }
        self.judge_range(last_ns, at_ns, value, found);
        // After a gap, the values before it are no neighbours.
        self.last = [if gap { None } else { self.last[1] }, Some((at_ns, value))];
    }

    /// Judges the silence since the last value arrived, s.
    pub fn silent(&mut self, silence_s: f64, found: &mut impl FnMut(Place)) {
        let Some((last_ns, _)) = self.last[1] else { return };
        if self.lasting[usize::from(Doubt::Gap.kind())].is_none() && self.is_gap(silence_s) {
            self.place(Doubt::Gap, last_ns, None, silence_s, found);
        }
    }

    /// Judges the silence since the last value at the end of a record.
    pub fn close(&mut self, end_ns: u64, found: &mut impl FnMut(Place)) {
        let Some((last_ns, _)) = self.last[1] else { return };
        self.silent(seconds(end_ns.saturating_sub(last_ns)), found);
    }

    fn is_gap(&self, interval_s: f64) -> bool {
        self.samples > LEARNED && interval_s > GAP_S.max(GAP * self.interval_s)
    }

    fn judge_flat_line(&mut self, last_ns: u64, ended: bool, found: &mut impl FnMut(Place)) {
        let flat_s = seconds(last_ns.saturating_sub(self.same_since_ns));
        if flat_s >= FLAT_S {
            self.place(Doubt::Flat, self.same_since_ns, ended.then_some(last_ns), flat_s, found);
        }
    }

    fn judge_spike(&mut self, at_ns: u64, [before, middle, after]: [f64; 3], found: &mut impl FnMut(Place)) {
        let size = (middle - 0.5 * (before + after)).abs();
        let most = SPIKE * self.deviation;
        // A neighbour of a spike is far from it alone.
        let nearest = (middle - before).abs().min((middle - after).abs());
        let outside = (middle > before.max(after)) || (middle < before.min(after));
        let known = self.samples > LEARNED && self.deviation > 0.0;
        if known && outside && nearest > most {
            self.place(Doubt::Spike, at_ns, Some(at_ns), size, found);
        }
        // A value that stays the same says nothing about the noise. A spike counts as the largest value that is none,
        // so that the deviation follows noise that has grown.
        if size > 0.0 {
            learn(&mut self.deviation, if known { size.min(most) } else { size }, self.samples);
        }
    }

    fn judge_range(&mut self, last_ns: u64, at_ns: u64, value: f64, found: &mut impl FnMut(Place)) {
        let Some([low, high]) = self.range else { return };
        let beyond = (low - value).max(value - high);
        let lasting = self.lasting[usize::from(Doubt::Range.kind())];
        if beyond > 0.0 {
            let begin_ns = lasting.map_or(at_ns, |(begin_ns, _)| begin_ns);
            self.place(Doubt::Range, begin_ns, None, beyond, found);
        } else if let Some((begin_ns, size)) = lasting {
            self.place(Doubt::Range, begin_ns, Some(last_ns), size, found);
        }
    }

    /// Counts a place once and passes its beginning, if it lasts, and its end on.
    fn place(&mut self, doubt: Doubt, begin_ns: u64, end_ns: Option<u64>, size: f64, found: &mut impl FnMut(Place)) {
        let at = usize::from(doubt.kind());
        let (tally, lasting) = (&mut self.tallies[at], &mut self.lasting[at]);
        let known = lasting.is_some();
        let size = lasting.map_or(size, |(_, before)| size.max(before));
        *lasting = if end_ns.is_none() { Some((begin_ns, size)) } else { None };
        tally.largest = tally.largest.max(size);
        if !known {
            tally.count += 1;
            tally.first_ns.get_or_insert(begin_ns);
        }
        if !known || end_ns.is_some() {
            found(Place { doubt, begin_ns, end_ns, size });
        }
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
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

    /// Judges two minutes at 10 Hz with the range -10 to 10, and silences as the sensor logger does, every 20 ms.
    fn judged(value: impl Fn(u32) -> Option<f64>) -> (Quality, Vec<Place>) {
        let (mut quality, mut places) = (Quality::new(Some([-10.0, 10.0])), Vec::new());
        let mut last_ns = 0;
        for pass in 0..6000 {
            let now_ns = 20_000_000 * u64::from(pass);
            if let Some(value) = value(pass / 5).filter(|_| pass % 5 == 0) {
                quality.add(now_ns, value, &mut |place| places.push(place));
                last_ns = now_ns;
            }
            quality.silent(seconds(now_ns - last_ns), &mut |place| places.push(place));
        }
        (quality, places)
    }

    fn places(value: impl Fn(u32) -> Option<f64>) -> Vec<(Doubt, f64, Option<f64>, f64)> {
        let tenths = |ns: u64| (seconds(ns) * 10.0).round() / 10.0;
        let row = |place: &Place| (place.doubt, tenths(place.begin_ns), place.end_ns.map(tenths), place.size);
        judged(value).1.iter().map(row).collect()
    }

    #[test]
    fn noise_ramps_and_coarse_values_have_no_flag() {
        assert_eq!(places(|at| Some(noise(at))), []);
        assert_eq!(places(|at| Some(0.005 * f64::from(at) + noise(at))), []);
        assert_eq!(places(|at| Some(f64::from(at / 150))), []);
        assert_eq!(places(|_| Some(f64::NAN)), []);
    }

    #[test]
    fn a_silence_is_found_while_it_lasts_and_ends_with_the_next_value() {
        let found = places(|at| (!(300..350).contains(&at)).then(|| noise(at)));
        let [(Doubt::Gap, 29.9, None, size), (Doubt::Gap, 29.9, Some(35.0), whole)] = found[..] else {
            panic!("{found:?}")
        };
        assert!((0.5..0.55).contains(&size) && (whole - 5.1).abs() < 1e-9, "{found:?}");
        let gaps = judged(|at| (at < 300).then(|| noise(at))).0.tally(Doubt::Gap);
        assert_eq!(gaps.count, 1, "a sensor that stays silent");
        // In a record nothing judges the silence while it lasts.
        let mut quality = Quality::new(None);
        (0..30).for_each(|at| quality.add(1_000_000_000 * at, noise(at as u32), &mut |_| ()));
        quality.close(30_000_000_000, &mut |_| ());
        assert_eq!(quality.tally(Doubt::Gap), Tally::default());
        quality.close(50_000_000_000, &mut |_| ());
        let wanted = Tally { count: 1, first_ns: Some(29_000_000_000), largest: 21.0 };
        assert_eq!(quality.tally(Doubt::Gap), wanted);
    }

    #[test]
    fn a_silence_of_the_link_ends_although_no_measurement_is_missing() {
        let (mut quality, mut places) = (Quality::new(None), Vec::new());
        let second = |at: u64| 1_000_000_000 * at;
        (0..30).for_each(|at| quality.add(second(at), noise(at as u32), &mut |place| places.push(place)));
        quality.silent(6.0, &mut |place| places.push(place));
        (30..40).for_each(|at| quality.add(second(at), noise(at as u32), &mut |place| places.push(place)));
        let [begin, end] = places[..] else { panic!("{places:?}") };
        assert_eq!((begin.doubt, begin.begin_ns, begin.end_ns), (Doubt::Gap, second(29), None));
        assert_eq!((end.doubt, end.begin_ns, end.end_ns, end.size), (Doubt::Gap, second(29), Some(second(30)), 6.0));
        quality.silent(6.0, &mut |place| places.push(place));
        assert_eq!((places.len(), quality.tally(Doubt::Gap).count), (3, 2), "the next one is found again");
    }

    #[test]
    fn the_same_value_for_a_minute_is_found_at_once_and_ends_with_another_one() {
        let found = places(|at| Some(if (100..750).contains(&at) { 0.25 } else { noise(at) }));
        let [(Doubt::Flat, 10.0, None, minute), (Doubt::Flat, 10.0, Some(74.9), whole)] = found[..] else {
            panic!("{found:?}")
        };
        assert!((minute - 60.0).abs() < 1e-6 && (whole - 64.9).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn a_spike_is_a_place_of_one_value() {
        let found = places(|at| Some(if at == 700 || at == 900 { 8.0 } else { noise(at) }));
        assert_eq!(found.iter().map(|place| place.1).collect::<Vec<_>>(), [70.0, 90.0], "{found:?}");
        assert!(found.iter().all(|(doubt, begin, end, size)| *doubt == Doubt::Spike
            && *end == Some(*begin)
            && (7.0..9.0).contains(size)));
    }

    #[test]
    fn noise_that_has_grown_is_soon_no_spike() {
        let found = places(|at| Some(noise(at) * if at < 600 { 0.01 } else { 1.0 }));
        assert!(found.len() < 60 && found.iter().all(|place| place.1 < 75.0), "{} flags", found.len());
    }

    #[test]
    fn values_beyond_the_range_are_one_place_from_the_first_one_on() {
        let climb = |at: u32| Some(if (5..15).contains(&at) { 12.0 + f64::from(at) } else { noise(at) });
        let found = places(climb);
        assert_eq!(found[..], [(Doubt::Range, 0.5, None, 7.0), (Doubt::Range, 0.5, Some(1.4), 16.0)]);
        let tally = judged(climb).0.tally(Doubt::Range);
        assert_eq!((tally.count, tally.first_ns, tally.largest), (1, Some(500_000_000), 16.0));
    }
}
