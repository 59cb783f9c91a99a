//! Response of a cable to commands: delay, lag, speed loop.
//!
//! With the integral `U` of the delayed command, the lagged reference `r` and the speed loop's state `x`,
//! the length is `U - lag r - x`: the lag and the loop only hold back what they store, so nothing is integrated that
//! could drift.

use crate::record::Record;

/// Step of the simulation, s: a fortieth of common lags.
const STEP_S: f64 = 0.001;

/// Delay and lag, s, and the frequency of the critically damped speed loop, rad/s; infinite: it follows at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Response {
    pub delay_s: f64,
    pub lag_s: f64,
    pub loop_rad_s: f64,
}

/// What follows from a response at each reading.
pub(crate) struct Simulated {
    /// Integral of the reference, m.
    pub commanded_m: Vec<f64>,
    /// Length, m.
    pub length_m: Vec<f64>,
    /// Reference, m/s.
    pub reference_m_s: Vec<f64>,
}

/// The delayed command, whose integral over a step is exact, wherever in it the command changes.
struct Delayed<'a> {
    record: &'a Record,
    delay_s: f64,
    /// Cycle whose command acts, and the integral up to its beginning.
    at: usize,
    integral_m: f64,
}

impl Delayed<'_> {
    /// Integral up to this time, which must not go back, m.
    fn integral(&mut self, time_s: f64) -> f64 {
        let (sent, command) = (&self.record.sent_s, &self.record.command_m_s);
        let time_s = (time_s - self.delay_s).max(sent[0]);
        while self.at + 1 < sent.len() && sent[self.at + 1] <= time_s {
            self.integral_m += command[self.at] * (sent[self.at + 1] - sent[self.at]);
            self.at += 1;
        }
        self.integral_m + command[self.at] * (time_s - sent[self.at])
    }
}

impl Response {
    pub fn simulate(&self, record: &Record) -> Simulated {
        let mut delayed = Delayed { record, delay_s: self.delay_s, at: 0, integral_m: 0.0 };
        let keep = if self.lag_s > 1e-6 { libm::exp(-STEP_S / self.lag_s) } else { 0.0 };
        let speed_loop = Loop::new(self.loop_rad_s);
        let cycles = record.len();
        let mut out = Simulated {
            commanded_m: Vec::with_capacity(cycles),
            length_m: Vec::with_capacity(cycles),
            reference_m_s: Vec::with_capacity(cycles),
        };
        // State at the last step and at the one before, to interpolate between.
        let (mut time_s, mut integral_m, mut reference, mut state) = (record.sent_s[0], 0.0, 0.0, [0.0; 2]);
        let mut last = [0.0; 3];
        let mut before = last;
        for read_s in &record.read_s {
            while time_s < *read_s {
                time_s += STEP_S;
                let next_m = delayed.integral(time_s);
                let input = (next_m - integral_m) / STEP_S;
                integral_m = next_m;
                let old = reference;
                reference = input + keep * (reference - input);
                state = speed_loop.step(state, 0.5 * (old + reference));
                before = last;
                let commanded_m = integral_m - self.lag_s * reference;
                last = [commanded_m, commanded_m - state[1], reference];
            }
            let share = (time_s - read_s) / STEP_S;
            let [commanded_m, length_m, reference_m_s] =
                std::array::from_fn(|i| last[i] + share * (before[i] - last[i]));
            out.commanded_m.push(commanded_m);
            out.length_m.push(length_m);
            out.reference_m_s.push(reference_m_s);
        }
        out
    }
}

/// One step of `x'' + 2 w x' + w² x = r`, whose `x'` is what the loop holds back, exact for a constant input.
struct Loop {
    w: f64,
    decay: f64,
}

impl Loop {
    fn new(w: f64) -> Self {
        Self { w, decay: if w.is_finite() { libm::exp(-w * STEP_S) } else { 0.0 } }
    }

    fn step(&self, [x, rate]: [f64; 2], input: f64) -> [f64; 2] {
        let (w, h) = (self.w, STEP_S);
        if !w.is_finite() {
            return [0.0; 2];
        }
        let rest = input / (w * w);
        let away = x - rest;
        [rest + self.decay * (away * (1.0 + w * h) + rate * h), self.decay * (-w * w * h * away + rate * (1.0 - w * h))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Behind a ramp the length lags by delay and lag times the speed; the loop adds nothing.
    #[test]
    fn a_ramp_is_followed_late_by_delay_and_lag() {
        let cycles = 600;
        let sent_s: Vec<f64> = (0..cycles).map(|k| 0.01 * f64::from(k)).collect();
        let read_s: Vec<f64> = sent_s.iter().map(|sent| sent + 0.003).collect();
        let record = Record { period_s: 0.01, sent_s, read_s, command_m_s: vec![0.2; 600], ..Record::default() };
        for loop_rad_s in [f64::INFINITY, 60.0] {
            let out = Response { delay_s: 0.0234, lag_s: 0.04, loop_rad_s }.simulate(&record);
            let expected_m = 0.2 * (record.read_s[599] - 0.0634);
            assert!((out.length_m[599] - expected_m).abs() < 1e-9, "{} {expected_m}", out.length_m[599]);
            assert!((out.reference_m_s[599] - 0.2).abs() < 1e-9);
        }
    }
}
