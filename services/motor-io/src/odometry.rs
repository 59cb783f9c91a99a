//! Encoder counts to cable lengths: zero points, jumps, and how far the position can be trusted.
//!
//! An idler turns with the cable as stretched as it passes: at the tension T, a metre of counts is 1 / (1 + T / EA)
//! metres of unstretched cable. With `counts_stretched` in the robot file, each increment of the counts is
//! converted with the strain of the cycle before. No formula of the present counts and tensions alone can replace this
//! sum: a cable that is reeled in tight and paid out loose has not the same length as before when its counts are. The
//! sum is here and not in an estimator, because lengths outlive estimators, and the store keeps them across restarts.
//!
//! An encoder on the motor counts turns of the drum, which winds the more cable the more of it is on the drum already:
//! with `[drum]` in the robot file, the counts from a known length are converted with the mean radius of the layers.
//!
//! This is the only place that judges whether a count is credible, by `OVER_SPEED` and `JUMP_MARGIN_M`. A count
//! beyond them is used only when the next one agrees with it, and then the position needs confirmation.

use crate::settings::CoreConfig;
use cable_robot::Drum;
use drives::CountBound;
use messages::{CABLES, MotorState};

/// Fastest credible cable, as a multiple of the robot's cable speed limit.
///
/// A count is stamped with the time of its request and read later: a cable at its limit whose count is read half a
/// period late moves 1.5 times as far as its stamps allow. Drives need no further allowance: in the golden run no cable
/// is faster than its largest command. A restart of a unit or a flipped high bit exceeds the bound by far.
const OVER_SPEED: f64 = 1.5;
/// Credible motion in no time, m: a few encoder steps and the spring of an idler wheel.
const JUMP_MARGIN_M: f64 = 0.005;
/// Motion of a cable while its unit was lost, m, above which the position needs confirmation.
const RETURN_TOLERANCE_M: f64 = 0.005;
/// Time over which a velocity is measured, ns.
const VELOCITY_WINDOW_NS: u64 = 50_000_000;
/// Readings kept for a velocity: those of the window at 500 cycles per second.
const HISTORY: usize = 32;

/// Credible motion of a unit's counts, for its cables (from 1): the bound of [`Odometry::read`] in counts.
///
/// The unit's driver does not judge counts by it. It holds back the first sample beyond it, to find out whether the
/// unit restarted.
#[must_use]
pub(crate) fn count_bound(config: &CoreConfig, cables: &[usize]) -> CountBound {
    let counts = cables.iter().filter_map(|cable| config.counts_per_m.get(cable.wrapping_sub(1)));
    let finest = counts.fold(0.0, |most: f64, counts| most.max(counts.abs()));
    CountBound { counts_s: OVER_SPEED * config.cable_speed_m_s * finest, margin: JUMP_MARGIN_M * finest }
}

/// The same of second encoders.
#[must_use]
pub(crate) fn second_bound(config: &CoreConfig, cables: &[usize]) -> CountBound {
    let second = config.second.as_ref();
    let counts = cables.iter().filter_map(|cable| second?.counts_per_m.get(cable.wrapping_sub(1)));
    let finest = counts.fold(0.0, |most: f64, counts| most.max(counts.abs()));
    CountBound { counts_s: OVER_SPEED * config.cable_speed_m_s * finest, margin: JUMP_MARGIN_M * finest }
}

/// In place of a count in [`Position`]: the count of this life does not continue in the next one.
///
/// Drivers continue the counts of a unit over its restart, but the unit itself began at zero again, and the next life
/// begins with what the unit has counted.
pub const NOT_COUNTED: i64 = i64::MIN;

/// Verdict on one reading of one cable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reading {
    /// Credible and used.
    Good,
    /// Not credible and not used; the next one decides.
    Doubtful,
    /// The count has jumped and stays there: the length continues from the last good one and needs confirmation.
    Jumped,
    /// The unit is back, and the cable has moved meanwhile: the length needs confirmation.
    MovedWhileAway,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cable {
    seen: bool,
    counts: i64,
    sampled_ns: u64,
    candidate: Option<i64>,
    zero_counts: i64,
    zero_m: f64,
    length_m: f64,
    /// Strain T / EA of the cable that passes; always 0 for a cable that is counted unstretched.
    strain: f64,
    velocity_m_s: f64,
    history: [(u64, i64); HISTORY],
    newest: usize,
    held: usize,
}

/// What the next life of motor-io needs to know about the lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Unstretched length of each cable beyond the routed part, m.
    pub lengths_m: [f64; CABLES],
    /// Encoder count of each cable at that time, or [`NOT_COUNTED`].
    pub counts: [i64; CABLES],
    /// The lengths as they were last set, m; NaN: unknown.
    pub zeroed_m: [f64; CABLES],
}

/// Lengths and velocities of all cables from their counts.
#[derive(Debug, Clone)]
pub struct Odometry {
    cables: [Cable; CABLES],
    count: usize,
    winds: [Wind; CABLES],
    fastest_m_s: f64,
    position: u8,
    restore: Option<Position>,
    /// Cables whose unit has been counting since the last life of motor-io.
    alive: [bool; CABLES],
    /// Cables whose unit has restarted in this life of motor-io.
    restarted: [bool; CABLES],
    /// The lengths were restored, and not confirmed since.
    only_restored: bool,
    /// The lengths as they were set, perhaps in the life before; NaN before that.
    zeroed_m: [f64; CABLES],
}

impl Odometry {
    /// Odometry with unknown lengths.
    #[must_use]
    pub fn new(config: &CoreConfig) -> Self {
        Self {
            cables: [Cable::default(); CABLES],
            count: config.cable_count(),
            winds: std::array::from_fn(|i| Wind {
                counts_per_m: config.counts_per_m[i],
                drum: config.robot.counted(i),
            }),
            fastest_m_s: config.cable_speed_m_s,
            position: MotorState::POSITION_UNKNOWN,
            restore: None,
            alive: [false; CABLES],
            restarted: [false; CABLES],
            only_restored: false,
            zeroed_m: std::array::from_fn(|i| if i < config.cable_count() { f64::NAN } else { 0.0 }),
        }
    }

    /// Sets the position of the last life; used as soon as every cable has been read.
    pub fn restore(&mut self, position: Position) {
        if position.lengths_m[..self.count].iter().all(|l| l.is_finite()) {
            self.restore = Some(position);
        }
    }

    /// Sets the cables whose unit was running before this process first addressed it.
    pub fn alive(&mut self, alive: [bool; CABLES]) {
        self.alive = alive;
    }

    /// True while the lengths are restored ones that were neither confirmed nor set.
    #[must_use]
    pub fn only_restored(&self) -> bool {
        self.only_restored
    }

    /// Judges and uses one cable's reading. `away`: its unit was lost until now; `drift_m_s`: least and largest
    /// velocity that its commands explain, `None` where nothing holds the cable.
    pub fn read(
        &mut self,
        cable: usize,
        counts: i64,
        sampled_ns: u64,
        away: bool,
        drift_m_s: Option<[f64; 2]>,
    ) -> Reading {
        let wind = self.winds[cable];
        let it = &mut self.cables[cable];
        if !it.seen {
            *it = Cable { seen: true, counts, zero_counts: counts, zero_m: it.length_m, ..*it };
            it.apply(counts, sampled_ns, wind);
            self.try_restore();
            return Reading::Good;
        }
        let passed_s = sampled_ns.saturating_sub(it.sampled_ns) as f64 * 1e-9;
        let fastest_m_s = OVER_SPEED * self.fastest_m_s;
        let [low_m_s, high_m_s] = drift_m_s.unwrap_or([-fastest_m_s, fastest_m_s]);
        let explained = low_m_s * passed_s - JUMP_MARGIN_M..=high_m_s * passed_s + JUMP_MARGIN_M;
        let moved = wind.metres(it.length_m, counts, it.counts);
        if explained.contains(&moved) {
            it.candidate = None;
            it.apply(counts, sampled_ns, wind);
            if away && moved.abs() > RETURN_TOLERANCE_M {
                self.doubt();
                return Reading::MovedWhileAway;
            }
            return Reading::Good;
        }
        // The cable can have moved here from the last doubtful count: two agree, so the count has jumped.
        let reach = fastest_m_s * passed_s + JUMP_MARGIN_M;
        match it.candidate {
            Some(candidate) if wind.metres(it.length_m, counts, candidate).abs() <= reach => {
                self.continue_from(cable, counts, sampled_ns);
                Reading::Jumped
            }
            _ => {
                it.candidate = Some(counts);
                Reading::Doubtful
            }
        }
    }

    /// Restarts the counts of a cable after a reboot of its unit: the length stays and needs confirmation.
    pub fn rebase(&mut self, cable: usize, counts: i64, sampled_ns: u64) {
        self.restarted[cable] = true;
        self.continue_from(cable, counts, sampled_ns);
    }

    /// Continues the length of a cable from another count.
    fn continue_from(&mut self, cable: usize, counts: i64, sampled_ns: u64) {
        let wind = self.winds[cable];
        let it = &mut self.cables[cable];
        *it = Cable { seen: true, counts, zero_counts: counts, zero_m: it.length_m, candidate: None, held: 0, ..*it };
        it.apply(counts, sampled_ns, wind);
        it.velocity_m_s = 0.0;
        self.doubt();
    }

    /// Sets the strain at which the cable passes from now on. Cables that are counted unstretched need no call.
    pub fn set_strain(&mut self, cable: usize, strain: f64) {
        self.cables[cable].strain = strain;
    }

    /// Marks the lengths as in need of confirmation.
    pub fn doubt(&mut self) {
        if self.position == MotorState::POSITION_KNOWN {
            self.position = MotorState::POSITION_RESTORED;
        }
    }

    fn try_restore(&mut self) {
        if !self.cables[..self.count].iter().all(|it| it.seen) {
            return;
        }
        if let Some(Position { lengths_m, counts, zeroed_m }) = self.restore.take() {
            // A unit that was running all the time has continued to count. The count of a unit that was switched on
            // since says nothing about the time before, however near it is to the stored one.
            for (i, it) in self.cables.iter_mut().enumerate().take(self.count) {
                let counted = self.alive[i] && counts[i] != NOT_COUNTED;
                // A unit counts in 32 bits, and the count of the life before was continued beyond their end.
                let moved = i64::from(it.counts.wrapping_sub(counts[i]) as i32);
                let moved_m = self.winds[i].metres(lengths_m[i], moved, 0);
                it.zero_m = lengths_m[i] + if counted { moved_m } else { 0.0 };
                it.zero_counts = it.counts;
                it.length_m = it.zero_m;
            }
            self.zeroed_m = zeroed_m;
            self.position = MotorState::POSITION_RESTORED;
            self.only_restored = true;
        }
    }

    /// True once every cable has been read.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.cables[..self.count].iter().all(|it| it.seen)
    }

    /// Sets the present lengths.
    pub fn set(&mut self, lengths_m: &[f64]) {
        for (it, length_m) in self.cables[..self.count].iter_mut().zip(lengths_m) {
            *it = Cable { zero_counts: it.counts, zero_m: *length_m, length_m: *length_m, candidate: None, ..*it };
        }
        self.zeroed_m = std::array::from_fn(|i| lengths_m.get(i).copied().unwrap_or_default());
        self.position = MotorState::POSITION_KNOWN;
        self.restore = None;
        self.only_restored = false;
    }

    /// Confirms the restored lengths.
    pub fn confirm(&mut self) {
        if self.position == MotorState::POSITION_RESTORED {
            self.position = MotorState::POSITION_KNOWN;
            self.only_restored = false;
        }
    }

    /// One of `MotorState::POSITION_*`.
    #[must_use]
    pub fn position(&self) -> u8 {
        self.position
    }

    /// Unstretched cable paid out beyond the routed part, m; counted from the start of the process while the position
    /// is unknown.
    #[must_use]
    pub fn length_m(&self, cable: usize) -> f64 {
        self.cables[cable].length_m
    }

    /// The lengths as they were last set, m; NaN: unknown.
    #[must_use]
    pub fn zeroed_m(&self) -> [f64; CABLES] {
        self.zeroed_m
    }

    /// Velocity of a cable over the last 50 ms, m/s.
    #[must_use]
    pub fn velocity_m_s(&self, cable: usize) -> f64 {
        self.cables[cable].velocity_m_s
    }

    /// Radius of the drum that a cable's encoder counts, relative to that of the bare one; 1 for an idler.
    #[must_use]
    pub fn radius_ratio(&self, cable: usize) -> f64 {
        self.winds[cable].drum.radius_ratio(self.cables[cable].length_m)
    }

    /// Last used count.
    #[must_use]
    pub fn counts(&self, cable: usize) -> i64 {
        self.cables[cable].counts
    }

    /// What the next life compares the count of a cable with.
    #[must_use]
    pub fn stored_counts(&self, cable: usize) -> i64 {
        if self.restarted[cable] { NOT_COUNTED } else { self.cables[cable].counts }
    }

    /// Time of the last used count, ns.
    #[must_use]
    pub fn sampled_ns(&self, cable: usize) -> u64 {
        self.cables[cable].sampled_ns
    }
}

impl Cable {
    fn apply(&mut self, counts: i64, sampled_ns: u64, wind: Wind) {
        if self.strain != 0.0 {
            // What was counted before had other strains.
            (self.zero_m, self.zero_counts) = (self.length_m, self.counts);
            self.length_m = self.zero_m + wind.metres(self.zero_m, counts, self.zero_counts) / (1.0 + self.strain);
        } else {
            self.length_m = self.zero_m + wind.metres(self.zero_m, counts, self.zero_counts);
        }
        self.counts = counts;
        self.sampled_ns = sampled_ns;
        self.newest = (self.newest + 1) % HISTORY;
        self.history[self.newest] = (sampled_ns, counts);
        self.held = (self.held + 1).min(HISTORY);
        // Oldest reading within the window, or else the previous one.
        let mut back = 1.min(self.held - 1);
        for age in 1..self.held {
            let (then_ns, _) = self.history[(self.newest + HISTORY - age) % HISTORY];
            if sampled_ns.saturating_sub(then_ns) <= VELOCITY_WINDOW_NS {
                back = age;
            }
        }
        let (then_ns, then) = self.history[(self.newest + HISTORY - back) % HISTORY];
        let passed_ns = sampled_ns.saturating_sub(then_ns);
        let counted_m = wind.metres_near(self.length_m, counts, then);
        let counted_m_s = if passed_ns > 0 { counted_m / (passed_ns as f64 * 1e-9) } else { 0.0 };
        self.velocity_m_s = if self.strain != 0.0 { counted_m_s / (1.0 + self.strain) } else { counted_m_s };
    }
}

/// What the counts of a cable mean.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wind {
    /// Of an idler, or of the bare drum.
    pub(crate) counts_per_m: f64,
    pub(crate) drum: Drum,
}

impl Wind {
    /// Cable paid out between two counts, m; at the first of them `length_m` was.
    pub(crate) fn metres(&self, length_m: f64, counts: i64, from: i64) -> f64 {
        self.drum.paid_out_m(length_m, counts.wrapping_sub(from) as f64 / self.counts_per_m)
    }

    /// Cable of one step of the encoder on a full drum, m.
    pub(crate) fn step_m(&self) -> f64 {
        self.drum.radius_ratio(0.0) / self.counts_per_m.abs()
    }

    /// Cable paid out between two counts that are at most some turns from `length_m`, m.
    fn metres_near(&self, length_m: f64, counts: i64, from: i64) -> f64 {
        self.drum.radius_ratio(length_m) * (counts.wrapping_sub(from) as f64 / self.counts_per_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The velocity is that over 50 ms at every rate, and not over a shorter time where there are more readings.
    #[test]
    fn a_velocity_is_measured_over_the_whole_window_at_every_rate() {
        let wind = Wind { counts_per_m: 10_865.0, drum: Drum::default() };
        for rate_hz in [100_u64, 250, 500] {
            let period_ns = 1_000_000_000 / rate_hz;
            let mut cable = Cable { seen: true, ..Cable::default() };
            // Half a millimetre, five steps of the encoder, in one cycle after a second of rest.
            for cycle in 0..rate_hz {
                cable.apply(0, cycle * period_ns, wind);
            }
            cable.apply(5, rate_hz * period_ns, wind);
            let (moved_m, window_s) = (5.0 / wind.counts_per_m, VELOCITY_WINDOW_NS as f64 * 1e-9);
            let short_s = moved_m / cable.velocity_m_s - window_s;
            assert!(short_s <= 1e-9 && short_s > -1.0 / rate_hz as f64, "{rate_hz} Hz: {}", cable.velocity_m_s);
        }
    }

    /// A cable is paid out and reeled in at strains that differ, as on every loop of a mission. The encoder turns with
    /// the stretched cable; the length has to be that of the cable, however often the loop is flown.
    #[test]
    fn stretched_counts_lose_no_cable_in_loops() {
        let wind = Wind { counts_per_m: 10_000.0, drum: Drum::default() };
        let mut cable = Cable { seen: true, zero_m: 5.0, length_m: 5.0, ..Cable::default() };
        let (mut turned_m, mut off_drum_m, mut sampled_ns) = (0.0_f64, 5.0_f64, 0);
        for step in 0..20_000 {
            let phase = f64::from(step) * std::f64::consts::TAU / 1000.0;
            // Tight while reeling in, loose while paying out.
            let (moved_m, strain) = (0.01 * phase.cos(), 0.002 - 0.0015 * phase.cos());
            off_drum_m += moved_m;
            turned_m += moved_m * (1.0 + strain);
            cable.strain = strain;
            sampled_ns += 10_000_000;
            cable.apply((turned_m * wind.counts_per_m).round() as i64, sampled_ns, wind);
        }
        // Half a count per reading would be 0.05 mm; the counts alone are 0.3 m of cable off.
        assert!((cable.length_m - off_drum_m).abs() < 5e-5, "{} for {off_drum_m}", cable.length_m);
        assert!((turned_m - (off_drum_m - 5.0)).abs() > 0.1, "{turned_m}");
    }
}
