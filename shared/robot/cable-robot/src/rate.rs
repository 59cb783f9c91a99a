//! Numbers of control cycles that stand for times.

/// Shortest period in which a number of cycles stands for a time, s: the numbers were chosen and tried at 100 to 250
/// Hz. At higher rates a condition of the robot or a hiccup of the machine still lasts as long, over more cycles.
pub const COUNTED_PERIOD_S: f64 = 0.004;

/// Returns a time as a whole number of cycles of this period, at least 1.
#[must_use]
pub fn cycles(seconds: f64, period_s: f64) -> u32 {
    (seconds / period_s + 0.5).clamp(1.0, 1e6) as u32
}

/// Returns the number of cycles of a condition that has to last for `count`: so many at up to 250 Hz, and at higher
/// rates those of the same time as at 250 Hz.
///
/// ```
/// use cable_robot::rate::lasting;
/// assert_eq!([20.0, 100.0, 250.0, 500.0].map(|rate_hz| lasting(3, 1.0 / rate_hz)), [3, 3, 3, 6]);
/// ```
///
/// Without a period, as in a sample that has none yet, the number is that at up to 250 Hz.
#[must_use]
pub fn lasting(count: u32, period_s: f64) -> u32 {
    if period_s > 0.0 { count.max(cycles(f64::from(count) * COUNTED_PERIOD_S, period_s)) } else { count }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_cycles_stands_for_their_time_above_250_hz() {
        let rates_hz = [10.0, 100.0, 250.0, 400.0, 500.0];
        assert_eq!(rates_hz.map(|rate_hz| lasting(20, 1.0 / rate_hz)), [20, 20, 20, 32, 40]);
        assert_eq!([0.0, -1.0, f64::NAN].map(|period_s| lasting(20, period_s)), [20; 3]);
    }

    #[test]
    fn a_time_is_a_whole_number_of_cycles_and_never_none() {
        assert_eq!([20.0, 100.0, 500.0].map(|rate_hz| cycles(0.1, 1.0 / rate_hz)), [2, 10, 50]);
        assert_eq!(cycles(0.001, 0.01), 1);
    }
}
