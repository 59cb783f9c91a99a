//! What was recorded of one cable.

use thiserror::Error;

/// Shortest record, cycles.
pub const LEAST_CYCLES: usize = 500;
/// Least share of the record in which the cable moves.
const LEAST_MOVING: f64 = 0.1;
/// Speed from which a cable moves, m/s.
pub const MOVING_M_S: f64 = 0.01;
/// Most lost readings in a row between which a length is interpolated: at 100 Hz and 1 m/s² it is off by 0.2 mm at
/// most, about a step of an encoder.
const MOST_LOST: usize = 3;

/// Consecutive cycles of one cable; all lists have the same length.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Control period, s.
    pub period_s: f64,
    /// When the command of each cycle was sent, s.
    pub sent_s: Vec<f64>,
    /// Commanded velocity dL/dt, m/s.
    pub command_m_s: Vec<f64>,
    /// When the encoder was read, s, after the command of the same cycle; increasing, see
    /// [`Record::interpolate_lost`].
    pub read_s: Vec<f64>,
    /// Length by the encoder, m.
    pub length_m: Vec<f64>,
    /// Share of the supply on the motor, positive where it pays out; NaN: unknown.
    pub duty: Vec<f64>,
    /// Motor current, A, positive where it reels in; NaN: unknown.
    pub current_a: Vec<f64>,
    /// Supply voltage, V; NaN: unknown.
    pub supply_v: Vec<f64>,
    /// Tension by the robot's model, N; NaN: unknown.
    pub tension_n: Vec<f64>,
    /// Whether the cycle was flown in speed control.
    pub is_flown: Vec<bool>,
}

/// Why a record says nothing.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum IdentifyError {
    /// Too few cycles.
    #[error("the record has {cycles} consecutive cycles, and {LEAST_CYCLES} are needed; record a longer flight")]
    Short {
        /// Number of cycles.
        cycles: usize,
    },
    /// A command or length that is not finite, or lists of different lengths.
    #[error("the record of cycle {cycle} is not complete; record again")]
    NotFinite {
        /// Index of the cycle.
        cycle: usize,
    },
    /// The cable hardly moves.
    #[error("the cable moves in {:.0} % of the record, and {:.0} % are needed; fly a mission that moves this cable", 100.0 * .share, 100.0 * LEAST_MOVING)]
    Still {
        /// Share of the cycles in which it moves.
        share: f64,
    },
    /// The least squares have no solution.
    #[error("the motion does not determine delay and lag; fly a mission with more starts and stops")]
    NotDetermined,
}

impl Record {
    /// Number of cycles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.sent_s.len()
    }

    /// Whether it has no cycles.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sent_s.is_empty()
    }

    /// Interpolates time and length of cycles whose reading was lost, which repeat the one before. After more than
    /// three of them in a row, the cycles count as not flown.
    pub fn interpolate_lost(&mut self) {
        let Some(mut last) = self.read_s.first().map(|_| 0) else { return };
        for k in 1..self.len() {
            if self.read_s[k] <= self.read_s[last] {
                continue;
            }
            self.bridge(last, k);
            last = k;
        }
        // No reading follows: the cycles stay, so that the records of all cables have the same length.
        for k in last + 1..self.len() {
            self.read_s[k] = self.read_s[k - 1] + self.period_s;
            self.length_m[k] = self.length_m[last];
            self.is_flown[k] = false;
        }
    }

    /// Fills the cycles between two readings.
    fn bridge(&mut self, from: usize, to: usize) {
        let between = |list: &[f64], share: f64| list[from] + share * (list[to] - list[from]);
        for k in from + 1..to {
            let share = (k - from) as f64 / (to - from) as f64;
            self.read_s[k] = between(&self.read_s, share);
            self.length_m[k] = between(&self.length_m, share);
            self.is_flown[k] &= to - from <= MOST_LOST + 1;
        }
    }

    pub(crate) fn check(&self) -> Result<(), IdentifyError> {
        let cycles = self.len();
        if cycles < LEAST_CYCLES || self.period_s.is_nan() || self.period_s <= 0.0 {
            return Err(IdentifyError::Short { cycles });
        }
        let lists = [&self.command_m_s, &self.read_s, &self.length_m];
        let others = [&self.duty, &self.current_a, &self.supply_v, &self.tension_n];
        if lists.into_iter().chain(others).any(|list| list.len() != cycles) || self.is_flown.len() != cycles {
            return Err(IdentifyError::NotFinite { cycle: 0 });
        }
        let wrong = |k: &usize| {
            lists.iter().any(|list| !list[*k].is_finite())
                || !self.sent_s[*k].is_finite()
                || (*k > 0 && (self.sent_s[*k] <= self.sent_s[*k - 1] || self.read_s[*k] <= self.read_s[*k - 1]))
        };
        if let Some(cycle) = (0..cycles).find(wrong) {
            return Err(IdentifyError::NotFinite { cycle });
        }
        let moving = self.command_m_s.iter().filter(|command| command.abs() > MOVING_M_S).count();
        let share = moving as f64 / cycles as f64;
        if share < LEAST_MOVING {
            return Err(IdentifyError::Still { share });
        }
        Ok(())
    }
}
