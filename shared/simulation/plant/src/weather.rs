//! The wind at the robot: the mean and gusts.

use nalgebra::Vector3;

use crate::random::Random;
use crate::world::Wind;

/// Period with which the gusts change, ns: far below their time constant.
const GUST_NS: u64 = 10_000_000;

/// Slowest air for the time constant of the gusts, m/s.
const SLOWEST_M_S: f64 = 1.0;

/// Share of the gusts across the mean wind.
const ACROSS: f64 = 0.5;

/// Gusts: a first-order Gauss-Markov process, whose spectrum falls with the square of the frequency.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Weather {
    wind: Wind,
    along: Vector3<f64>,
    across: Vector3<f64>,
    /// Gusts along and across the mean, in standard deviations.
    gusts: [f64; 2],
    next_ns: u64,
    random: Random,
}

impl Weather {
    pub fn new(wind: Wind, seed: u64) -> Self {
        let mean = Vector3::from(wind.mean_m_s);
        let level = Vector3::new(mean.x, mean.y, 0.0);
        let along = if level.norm() > 0.0 { level / level.norm() } else { Vector3::x() };
        let mut random = Random::new(seed ^ 0x5749_4e44);
        let gusts = [random.gaussian(), random.gaussian()];
        Self { wind, along, across: Vector3::z().cross(&along), gusts, next_ns: GUST_NS, random }
    }

    /// Advances the gusts to `time_ns` and returns the velocity of the air, m/s.
    pub fn air_m_s(&mut self, time_ns: u64) -> Vector3<f64> {
        if self.wind.is_calm() {
            return Vector3::zeros();
        }
        let mean = Vector3::from(self.wind.mean_m_s);
        let constant_s = self.wind.gust_length_m / mean.norm().max(SLOWEST_M_S);
        while self.next_ns <= time_ns {
            let keep = libm::exp(-(GUST_NS as f64) * 1e-9 / constant_s);
            for gust in &mut self.gusts {
                *gust = keep * *gust + libm::sqrt(1.0 - keep * keep) * self.random.gaussian();
            }
            self.next_ns += GUST_NS;
        }
        let [along, across] = self.gusts;
        mean + (self.along * along + self.across * (ACROSS * across)) * self.wind.gust_m_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The variance of the gusts and their correlation over one time constant are those of the spectrum.
    #[test]
    fn gusts_have_the_spectrum_of_a_first_order_process() {
        let wind = Wind { mean_m_s: [6.0, 0.0, 0.0], gust_m_s: 2.0, gust_length_m: 6.0, ..Wind::default() };
        let mut weather = Weather::new(wind, 3);
        let lag = 100; // one second, the time constant
        let values: Vec<f64> = (1..400_000).map(|i| weather.air_m_s(i * GUST_NS).x - 6.0).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
        let lagged = values.windows(lag + 1).map(|v| v[0] * v[lag]).sum::<f64>() / (values.len() - lag) as f64;
        assert!(mean.abs() < 0.15 && (variance - 4.0).abs() < 0.4, "{mean} {variance}");
        assert!((lagged / variance - (-1.0f64).exp()).abs() < 0.05, "{}", lagged / variance);
    }

    #[test]
    fn calm_air_does_not_move() {
        assert_eq!(Weather::new(Wind::default(), 1).air_m_s(1_000_000_000), Vector3::zeros());
    }
}
