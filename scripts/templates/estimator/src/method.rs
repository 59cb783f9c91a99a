//! The method: change this file. As it is, it is an alpha-beta filter.

use estimator::{CableEstimator, CableSample, Instant, Measurement};

/// One cable: the length is extrapolated with a velocity, and each reading corrects both by a share of the difference.
#[derive(Debug, Clone)]
pub struct MyEstimator {
    /// Share of the difference that corrects the length.
    pub alpha: f64,
    /// Share of the difference, per time between two readings, that corrects the velocity.
    pub beta: f64,
    /// `None` before the first reading.
    state: Option<State>,
    /// The next reading may differ by any amount: start from it.
    begin: bool,
}

#[derive(Debug, Clone, Copy)]
struct State {
    length_m: f64,
    velocity_m_s: f64,
    /// When the newest reading was taken, ns, and its cycle.
    sampled_ns: u64,
    cycle: u64,
}

impl Default for MyEstimator {
    /// T. R. Benedict and G. W. Bordner (1962): beta = alpha² / (2 - alpha) follows a change quickly with little noise.
    fn default() -> Self {
        let alpha = 0.5;
        Self { alpha, beta: alpha * alpha / (2.0 - alpha), state: None, begin: false }
    }
}

impl CableEstimator for MyEstimator {
    /// Called in every cycle, for each cable.
    fn read(&mut self, sample: &CableSample) {
        let &CableSample { cycle, sampled_ns, .. } = sample;
        let Some(length_m) = sample.length_m else { return };
        let begin = std::mem::take(&mut self.begin);
        // After a long silence, or where the lengths were set again, it begins at rest with the reading.
        let last = self.state.filter(|last| !begin && sample.instant().bridges(last.cycle));
        let passed_s = last.map_or(0.0, |last| sampled_ns.saturating_sub(last.sampled_ns) as f64 * 1e-9);
        self.state = Some(match last {
            Some(last) if passed_s > 0.0 => {
                let expected_m = last.length_m + last.velocity_m_s * passed_s;
                let difference_m = length_m - expected_m;
                State {
                    length_m: expected_m + self.alpha * difference_m,
                    velocity_m_s: last.velocity_m_s + self.beta * difference_m / passed_s,
                    sampled_ns,
                    cycle,
                }
            }
            _ => State { length_m, velocity_m_s: 0.0, sampled_ns, cycle },
        });
    }

    /// Called after `read`: the length and the velocity dL/dt (above 0: pays out) at an instant of the same cycle.
    fn at(&self, instant: &Instant) -> Option<Measurement> {
        let state = self.state?;
        let moved_m = state.velocity_m_s * instant.ahead_of_s(state.sampled_ns, state.cycle);
        Some(Measurement {
            length_m: state.length_m + moved_m,
            velocity_m_s: state.velocity_m_s,
            // The velocity of the filter is smooth enough for that of the node.
            steady_velocity_m_s: Some(state.velocity_m_s),
            // Assumed: half of the extrapolation.
            sigma_m: 0.5 * moved_m.abs(),
            phi: [0.0; 2],
            sampled_ns: state.sampled_ns,
        })
    }

    /// Called when all earlier readings are invalid.
    fn forget(&mut self) {
        self.state = None;
    }

    /// Called where the operator may have set the lengths again.
    fn expect_anything(&mut self) {
        self.begin = true;
    }

    /// Recorded in the run file, so that a run contains the constants it used.
    fn constants(&self) -> String {
        format!("alpha = {:?}\nbeta = {:?}\n", self.alpha, self.beta)
    }
}
