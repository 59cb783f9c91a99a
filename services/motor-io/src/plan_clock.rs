//! The plan clock: time on which motions advance.
//!
//! Each cycle in which the robot follows advances it by `rate` x period. Pause, hold, resume, speed override and lost
//! bus cycles ramp the rate, so that no setpoint jumps. It never runs backwards during a life.

/// Lowest speed override; below it a mission would seem to stand still.
pub const SLOWEST: f64 = 0.05;

/// State of the plan clock.
#[derive(Debug, Clone)]
pub struct PlanClock {
    time_s: f64,
    rate: f64,
    target: f64,
    speed: f64,
    ease: f64,
    period_s: f64,
}

impl PlanClock {
    /// Time 0, at standstill, at full speed.
    #[must_use]
    pub fn new(period_s: f64) -> Self {
        Self { time_s: 0.0, rate: 0.0, target: 0.0, speed: 1.0, ease: 1.0, period_s }
    }

    /// Plan time, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Present rate, 0 to 1.
    #[must_use]
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Target of the rate.
    #[must_use]
    pub fn target(&self) -> f64 {
        self.target
    }

    /// Sets the speed override; returns false outside [`SLOWEST`] to 1.
    pub fn set_speed(&mut self, fraction: f64) -> bool {
        let good = (SLOWEST..=1.0).contains(&fraction);
        if good {
            self.speed = fraction;
        }
        good
    }

    /// Slows the plan down by this factor, 0 to 1, beyond the speed override: something comes near its limit.
    pub fn set_slowdown(&mut self, factor: f64) {
        self.ease = factor.clamp(0.0, 1.0);
    }

    /// Advances one cycle: ramps towards the speed override, or to standstill. `ramp_s` is the time from 0 to 1.
    pub fn advance(&mut self, run: bool, ramp_s: f64) {
        self.target = if run { self.speed * self.ease } else { 0.0 };
        let step = self.period_s / ramp_s;
        self.rate = if self.rate < self.target {
            (self.rate + step).min(self.target)
        } else {
            (self.rate - step).max(self.target)
        };
        debug_assert!((0.0..=1.0).contains(&self.rate), "the rate {} is outside 0 to 1", self.rate);
        self.time_s += self.rate * self.period_s;
    }

    /// Advances one cycle of a stop without a controller: the rate shrinks as the velocities do, so that the setpoint
    /// stays near the node.
    pub fn shrink(&mut self, factor: f64) {
        self.target = 0.0;
        self.rate *= factor.clamp(0.0, 1.0);
        self.time_s += self.rate * self.period_s;
    }

    /// Advances by this time, s, in which the drives moved the node while no cycle ran.
    pub fn catch_up(&mut self, seconds: f64) {
        self.time_s += self.rate * seconds.max(0.0);
    }

    /// Stops at once; the velocities are zero already.
    pub fn stop_at_once(&mut self) {
        self.rate = 0.0;
        self.target = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_ramps_and_time_never_runs_backwards() {
        let mut clock = PlanClock::new(0.01);
        let mut last = (clock.time_s(), clock.rate());
        for cycle in 0..1000 {
            if cycle == 300 {
                assert!(clock.set_speed(0.3));
            }
            clock.advance(!(500..700).contains(&cycle), 0.5);
            assert!(clock.time_s() >= last.0);
            assert!((clock.rate() - last.1).abs() <= 0.02 + 1e-12);
            last = (clock.time_s(), clock.rate());
        }
        assert_eq!(clock.rate(), 0.3);
    }

    #[test]
    fn a_speed_factor_outside_0_to_1_is_rejected() {
        let mut clock = PlanClock::new(0.01);
        for bad in [0.0, 0.04, 1.01, -1.0, f64::NAN, f64::INFINITY] {
            assert!(!clock.set_speed(bad));
        }
        assert_eq!(clock.speed, 1.0);
    }

    #[test]
    fn a_ramp_of_half_a_second_takes_half_a_second() {
        let mut clock = PlanClock::new(0.01);
        for _ in 0..50 {
            clock.advance(true, 0.5);
        }
        assert!((clock.rate() - 1.0).abs() < 1e-12);
        assert!((clock.time_s() - 0.255).abs() < 1e-9);
    }
}
