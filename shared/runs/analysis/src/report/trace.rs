//! Curves of any length in bounded memory: least, greatest and mean value of each time interval.

use plot::{Series, SeriesStyle};

/// Maximum number of intervals per curve, about the width of a chart in pixels.
const MAX_INTERVALS: usize = 1000;
/// Initial length of an interval, s; it doubles when the maximum number is exceeded.
const FIRST_S: f64 = 0.005;

#[derive(Debug, Clone, Copy)]
struct Interval {
    low: f64,
    high: f64,
    sum: f64,
    count: u32,
}

impl Interval {
    const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, sum: 0.0, count: 0 };

    fn merged(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            sum: self.sum + other.sum,
            count: self.count + other.count,
        }
    }
}

/// A quantity over time.
#[derive(Debug, Clone)]
pub struct Trace {
    interval_s: f64,
    intervals: Vec<Interval>,
    /// Silence that interrupts the curve, s.
    gap_s: f64,
    low: f64,
    high: f64,
}

impl Trace {
    /// Creates a curve of a quantity that is sampled at least once in `gap_s`.
    #[must_use]
    pub fn new(gap_s: f64) -> Self {
        Self { interval_s: FIRST_S, intervals: Vec::new(), gap_s, low: f64::INFINITY, high: f64::NEG_INFINITY }
    }

    /// Adds a value; ignores non-finite values and negative times.
    pub fn add(&mut self, time_s: f64, value: f64) {
        if !(value.is_finite() && time_s.is_finite() && time_s >= 0.0) {
            return;
        }
        while time_s >= self.interval_s * MAX_INTERVALS as f64 {
            self.intervals = self
                .intervals
                .chunks(2)
                .map(|pair| pair.iter().fold(Interval::EMPTY, |sum, one| sum.merged(*one)))
                .collect();
            self.interval_s *= 2.0;
        }
        let at = (time_s / self.interval_s) as usize;
        if at >= self.intervals.len() {
            self.intervals.resize(at + 1, Interval::EMPTY);
        }
        self.intervals[at] = self.intervals[at].merged(Interval { low: value, high: value, sum: value, count: 1 });
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
    }

    /// Returns the least and the greatest value; `None` without values.
    #[must_use]
    pub fn extremes(&self) -> Option<[f64; 2]> {
        (self.low <= self.high).then_some([self.low, self.high])
    }

    /// Returns the series to draw: a band from least to greatest, and the mean as a line; times and values are scaled
    /// by the factors.
    #[must_use]
    pub fn series(&self, name: &str, colour: usize, [time, value]: [f64; 2]) -> Vec<Series> {
        let (mut middle, mut low, mut high) = (Vec::new(), Vec::new(), Vec::new());
        let mut last_s = f64::INFINITY;
        for (at, one) in self.intervals.iter().enumerate().filter(|(_, one)| one.count > 0) {
            let time_s = (at as f64 + 0.5) * self.interval_s;
            if time_s - last_s > self.gap_s.max(1.5 * self.interval_s) {
                let between = [time * 0.5 * (time_s + last_s), f64::NAN];
                middle.push(between);
                low.push(between);
                high.push(f64::NAN);
            }
            last_s = time_s;
            middle.push([time * time_s, value * one.sum / f64::from(one.count)]);
            low.push([time * time_s, value * one.low]);
            high.push(value * one.high);
        }
        vec![
            Series { name: String::new(), colour, style: SeriesStyle::Band(high), points: low },
            Series { name: name.to_owned(), colour, style: SeriesStyle::Line(2), points: middle },
        ]
    }
}

/// Points of a path in bounded memory: first all, then every second, every fourth ...
#[derive(Debug, Clone, Default)]
pub struct DecimatedPoints<T> {
    every: u64,
    seen: u64,
    points: Vec<T>,
}

/// Maximum number of points of a path.
const MAX_POINTS: usize = 20_000;

impl<T> DecimatedPoints<T> {
    /// Adds a point.
    pub fn add(&mut self, point: T) {
        self.every = self.every.max(1);
        if self.seen.is_multiple_of(self.every) {
            self.points.push(point);
        }
        self.seen += 1;
        if self.points.len() >= MAX_POINTS {
            let mut keep = false;
            self.points.retain(|_| {
                keep = !keep;
                keep
            });
            self.every *= 2;
        }
    }

    /// Returns the remaining points in order.
    #[must_use]
    pub fn points(&self) -> &[T] {
        &self.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_survive_any_number_of_samples() {
        let mut trace = Trace::new(1.0);
        for i in 0..1_000_000_u32 {
            let peak = if i == 654_321 { 50.0 } else { 0.0 };
            trace.add(f64::from(i) * 0.01, libm::sin(f64::from(i)) + peak);
        }
        assert!(trace.intervals.len() <= MAX_INTERVALS && trace.intervals.len() > MAX_INTERVALS / 2 - 1);
        let count: u32 = trace.intervals.iter().map(|one| one.count).sum();
        assert_eq!(count, 1_000_000);
        let series = trace.series("x", 0, [1.0, 1.0]);
        let SeriesStyle::Band(high) = &series[0].style else { panic!("the first is the band") };
        assert!(high.iter().any(|value| *value > 48.9));
        let at = high.iter().position(|value| *value > 48.9).unwrap();
        assert!((series[0].points[at][0] - 6543.21).abs() <= trace.interval_s);
        assert_eq!(trace.extremes().map(|[low, _]| low < -0.9999), Some(true));
    }

    #[test]
    fn a_silence_interrupts_the_curve_and_invalid_values_are_ignored() {
        let mut trace = Trace::new(1.0);
        for time_s in [0.0, 0.5, 1.0, 4.0, 4.5] {
            trace.add(time_s, time_s);
        }
        trace.add(f64::NAN, 1.0);
        trace.add(2.0, f64::INFINITY);
        trace.add(-1.0, 1.0);
        let line = &trace.series("x", 0, [1.0, 2.0])[1];
        assert_eq!(line.points.len(), 6);
        assert!(line.points[3][1].is_nan());
        assert_eq!(line.points[5][1], 9.0);
        assert_eq!(Trace::new(1.0).extremes(), None);
    }

    #[test]
    fn a_decimated_path_keeps_its_start_and_order() {
        let mut path = DecimatedPoints::default();
        (0..100_000).for_each(|i| path.add(i));
        assert!(path.points().len() < MAX_POINTS && path.points().len() >= MAX_POINTS / 2);
        assert_eq!(path.points()[0], 0);
        assert!(path.points().windows(2).all(|pair| pair[1] - pair[0] == pair_step(path.points())));
    }

    fn pair_step(points: &[i32]) -> i32 {
        points[1] - points[0]
    }
}
