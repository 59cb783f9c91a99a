//! Whether a motor that reels in draws the current of its cable's estimated tension. A motor without load draws only
//! the current of its own friction.
//!
//! A single reading says little. A drive samples its current, its speed loop answers every step of the encoder, and
//! near a whole number of steps per cycle each reading has the same phase of that ripple: dozens of readings in a row
//! can then be as low as without load, although their mean over all phases is the current of the tension. So the
//! readings have to contradict the tension for the longer, the larger their spread is beside the tension's current.
//!
//! Near half a step the readings alternate between two phases. So a low reading that repeats one of the last two counts
//! less, unless it is lower than the ripple was a second before: without load the whole ripple is lower by the current
//! of the tension, and only then are its low phases lower than they were. In the first three seconds of reeling in that
//! is not known: a cable that breaks then is found later, and not at all under a ripple as large as the tension's
//! current.

use cable_robot::motor::Motor;
use cable_robot::rate::COUNTED_PERIOD_S;

/// Least current of a tension, A, at which the current shows the tension; readings have steps of 10 mA.
const TELLING_A: f64 = 0.1;
/// Missing share of a tension's current above which the reading contradicts the tension; a cable without load misses
/// all of it.
const LACKING_SHARE: f64 = 0.4;
/// Standard deviation of the friction without load, and of force constant and gear friction, as shares: friction
/// changes with temperature and wear, data sheets allow 10 % (docs/truth.md draws from the same). Currents that a
/// deviation of one standard deviation explains do not contradict the tension.
const FRICTION_SIGMA: f64 = 0.2;
const FORCE_SIGMA: f64 = 0.05;
const GEAR_SIGMA: f64 = 0.05;
/// Rotor and gear as a mass on the cable, kg: while the reeling in slows down, they drive the cable and the motor draws
/// less. 25 kg is a 24 V, 150 W motor (142 g cm²) geared to 40 N/A.
const INERTIA_KG: f64 = 25.0;
/// Bounds on the weight of a single reading against the tension and for it: the ripple has few high peaks and many low
/// readings, so its peaks must count.
const LACKING_MOST: f64 = 1.0;
const DRAWN_MOST: f64 = 3.0;
/// Sum of missing shares over cycles at which a cable carries no load, if the readings have no spread: a quarter of a
/// second of a broken cable. Above 250 Hz a cycle counts by its time, as [`COUNTED_PERIOD_S`] does.
const LACKING_CYCLES: f64 = 12.0;
/// Spread relative to the tension's current times this factor is the factor on [`LACKING_CYCLES`], from 1 to
/// `LONGER_MOST`. Chosen with the next ones so that the sum stays below 0.65 of it in 285 flights of drawn worlds, and
/// the median of 2053 cables that break while they are reeled in there is found after 23 cycles.
const LONGER: f64 = 2.2;
const LONGER_MOST: f64 = 4.0;
/// Difference relative to the spread below which a reading repeats one of the last two, and the weight of a low one.
const REPEATED_SHARE: f64 = 0.1;
const REPEATED_WEIGHT: f64 = 0.25;
/// The same before the lowest readings of the ripple are known, when nothing tells a broken cable from its low phases.
const EARLY_WEIGHT: f64 = 0.5;
/// Time over which the lowest reading is taken, s: several times the period at which the phases come around again. The
/// last whole one is left out, because a cable that has broken in it must not be taken for ripple before it is found.
const LOWEST_S: f64 = 1.0;
const LOWEST_COUNT: usize = 3;
/// Times over which the deviation from the model is averaged, s, and over which its spread is.
const MEAN_S: f64 = 0.2;
const SPREAD_S: f64 = 1.0;
/// Most cycles that one reading stands for; otherwise it stands for those since the last one.
const SPARSE_CYCLES: u32 = 8;

/// What the readings of a motor's current say about the load of its cable.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LoadEvidence {
    /// Missing shares of current, summed up.
    lacking: f64,
    /// Sum at which the cable carries no load.
    enough: f64,
    /// Cycles since the current was last read.
    unread: u32,
    /// The last two readings, the newest first, A.
    last_a: [f64; 2],
    /// Lowest deviations from the model in each last whole `LOWEST_S`, the newest first, and in the present one, A.
    /// Before the first, any reading may be one of the ripple.
    lowest_a: [f64; LOWEST_COUNT],
    lowest_now_a: f64,
    /// Time that the present `LOWEST_S` has taken, s.
    lowest_s: f64,
    /// Averaged deviation from the model, and averaged distance of the readings from it, A.
    mean_a: f64,
    spread_a: f64,
}

/// A cable in one cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Winding {
    /// Estimated tension, N.
    pub tension_n: f64,
    /// Speed at which it is reeled in, m/s, and by how much that falls, m/s²; 0 if it does not.
    pub reel_in_m_s: f64,
    pub slowing_m_s2: f64,
    /// Current, A, if it was read in this cycle.
    pub current_a: Option<f64>,
}

impl Default for LoadEvidence {
    fn default() -> Self {
        Self {
            lacking: 0.0,
            enough: 0.0,
            unread: 0,
            last_a: [0.0; 2],
            lowest_a: [f64::NEG_INFINITY; LOWEST_COUNT],
            lowest_now_a: f64::INFINITY,
            lowest_s: 0.0,
            mean_a: 0.0,
            spread_a: 0.0,
        }
    }
}

impl LoadEvidence {
    /// True if the cable carries no load.
    pub(crate) fn is_unloaded(&self) -> bool {
        self.lacking > 0.0 && self.lacking >= self.enough
    }

    /// Drops the sum of evidence; the ripple of the motor's current stays known.
    pub(crate) fn clear(&mut self) {
        self.lacking = 0.0;
    }

    /// Sums up how much the current contradicts the estimated tension, where it can.
    pub(crate) fn advance(&mut self, motor: &Motor, winding: &Winding, period_s: f64) {
        self.unread = self.unread.saturating_add(1);
        let Some(read_a) = winding.current_a else { return };
        let share = (period_s / COUNTED_PERIOD_S).min(1.0);
        let cycles = (share * f64::from(self.unread)).min(f64::from(SPARSE_CYCLES));
        self.unread = 0;
        let Winding { tension_n, reel_in_m_s, slowing_m_s2, .. } = *winding;
        let idle_a = motor.current_a(0.0, reel_in_m_s);
        let drawn_a = motor.current_a(tension_n, reel_in_m_s) - idle_a;
        if motor.friction_sign(reel_in_m_s) <= 0.5 || drawn_a <= TELLING_A {
            return;
        }
        let current_a = read_a + INERTIA_KG * slowing_m_s2 / motor.force_constant_n_a;
        let elapsed_s = cycles * (period_s / share);
        let deviation_a = current_a - idle_a - drawn_a;
        self.mean_a += (deviation_a - self.mean_a) * (elapsed_s / MEAN_S).min(1.0);
        self.spread_a += ((deviation_a - self.mean_a).abs() - self.spread_a) * (elapsed_s / SPREAD_S).min(1.0);
        let repeats = self.repeats(current_a) && !self.is_lowest(deviation_a);
        let repeated_weight = if self.knows_ripple() { REPEATED_WEIGHT } else { EARLY_WEIGHT };
        self.last_a = [current_a, self.last_a[0]];
        self.remember(deviation_a, elapsed_s);
        let loaded_share = 1.0 - LACKING_SHARE;
        let least_a = idle_a + loaded_share * drawn_a - margin_a(motor, tension_n, reel_in_m_s, loaded_share);
        let lacking = ((least_a - current_a) / drawn_a).clamp(-DRAWN_MOST, LACKING_MOST);
        let weight = if repeats && lacking > 0.0 { repeated_weight } else { 1.0 };
        self.lacking = (self.lacking + lacking * weight * cycles).max(0.0);
        self.enough = LACKING_CYCLES * (LONGER * self.spread_a / drawn_a).clamp(1.0, LONGER_MOST);
    }

    /// Whether a reading, A, has the phase of one of the last two.
    fn repeats(&self, current_a: f64) -> bool {
        self.last_a.iter().any(|last_a| (current_a - last_a).abs() < REPEATED_SHARE * self.spread_a)
    }

    /// Whether the lowest readings of the ripple are known.
    fn knows_ripple(&self) -> bool {
        self.lowest_a.iter().all(|lowest_a| lowest_a.is_finite())
    }

    /// Whether a deviation from the model, A, is lower than the ripple was before.
    fn is_lowest(&self, deviation_a: f64) -> bool {
        let [_, before @ ..] = self.lowest_a;
        let lowest_a = before.into_iter().fold(f64::INFINITY, f64::min);
        deviation_a <= lowest_a - REPEATED_SHARE * self.spread_a
    }

    fn remember(&mut self, deviation_a: f64, elapsed_s: f64) {
        self.lowest_now_a = self.lowest_now_a.min(deviation_a);
        self.lowest_s += elapsed_s;
        if self.lowest_s >= LOWEST_S {
            let [newest_a, older_a, _] = self.lowest_a;
            self.lowest_a = [self.lowest_now_a, newest_a, older_a];
            (self.lowest_now_a, self.lowest_s) = (f64::INFINITY, 0.0);
        }
    }
}

/// One standard deviation of the current of a share of the tension, A.
fn margin_a(motor: &Motor, tension_n: f64, reel_in_m_s: f64, share: f64) -> f64 {
    let [coulomb_n, viscous_n] = [motor.coulomb_n, motor.viscous_n_s_m * reel_in_m_s].map(|n| FRICTION_SIGMA * n);
    let force_n = FORCE_SIGMA * motor.force_constant_n_a * motor.current_a(share * tension_n, reel_in_m_s);
    let gear_n = GEAR_SIGMA * motor.gear_friction * share * tension_n;
    let squares = [coulomb_n, viscous_n, force_n, gear_n].map(|n| n * n);
    squares.iter().sum::<f64>().sqrt() / motor.force_constant_n_a
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Time after which a cable is found that never carried its load of 20 N, s; its current is read in every so many
    /// cycles.
    fn found_after_s(rate_hz: f64, every: u32) -> f64 {
        let motor = Motor::default();
        let current_a = motor.current_a(0.0, 0.2);
        let mut evidence = LoadEvidence::default();
        for cycle in 1..=10_000_u32 {
            let current_a = cycle.is_multiple_of(every).then_some(current_a);
            let winding = Winding { tension_n: 20.0, reel_in_m_s: 0.2, slowing_m_s2: 0.0, current_a };
            evidence.advance(&motor, &winding, 1.0 / rate_hz);
            if evidence.is_unloaded() {
                return f64::from(cycle) / rate_hz;
            }
        }
        f64::INFINITY
    }

    #[test]
    fn above_250_hz_evidence_takes_as_long_as_at_250_hz() {
        let at_250_hz_s = found_after_s(250.0, 1);
        assert!((0.03..0.3).contains(&at_250_hz_s), "{at_250_hz_s}");
        for (rate_hz, every) in [(333.0, 1), (500.0, 1), (500.0, 2)] {
            let found_s = found_after_s(rate_hz, every);
            assert!((found_s - at_250_hz_s).abs() < 0.012, "{rate_hz} Hz, {every}: {found_s} after {at_250_hz_s}");
        }
        // Below, the number of cycles decides.
        assert!((found_after_s(100.0, 1) / at_250_hz_s - 2.5).abs() < 0.2);
    }
}
