//! Encoder counts to line lengths: zero points, jumps, and how far the position can be trusted.

use crate::settings::CoreConfig;
use drives::CountBound;
use messages::{CABLES, MotorState};

/// Fastest believable cable, as a multiple of the robot's cable speed limit: the only bound on encoder counts.
const OVER_SPEED: f64 = 1.5;
/// Motion that is believed in no time at all, m: a few encoder steps and the spring of an idler wheel.
const JUMP_MARGIN_M: f64 = 0.005;
/// After a unit was away, its line may have moved by this much before somebody has to look, m.
const RETURN_TOLERANCE_M: f64 = 0.005;
/// Time over which a measured velocity is taken, ns.
const VELOCITY_WINDOW_NS: u64 = 50_000_000;
/// Readings kept for it: enough for 250 cycles per second.
const HISTORY: usize = 16;

/// Motion of the counts of a unit that its drive needs not explain, for the unit's cables (from 1).
///
/// The bound is the one that [`Odometry::read`] applies in metres. The drive's driver does not judge counts by it: it holds one sample
/// back to find out whether the unit restarted.
#[must_use]
pub(crate) fn count_bound(config: &CoreConfig, cables: &[usize]) -> CountBound {
    let counts = cables.iter().filter_map(|cable| config.counts_per_m.get(cable.wrapping_sub(1)));
    let finest = counts.fold(0.0, |most: f64, counts| most.max(counts.abs()));
    CountBound { counts_s: OVER_SPEED * config.cable_speed_m_s * finest, margin: JUMP_MARGIN_M * finest }
}

/// What one reading of one cable came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reading {
    /// Taken.
    Good,
    /// Not credible; not used. The next one decides.
    Doubtful,
    /// The count has jumped, and stays there: the length goes on from the last good one and needs confirmation.
    Jumped,
    /// The unit is back, and the line has moved in the meantime: the length needs confirmation.
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
    velocity_m_s: f64,
    history: [(u64, i64); HISTORY],
    newest: usize,
    held: usize,
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct Odometry {
    cables: [Cable; CABLES],
    count: usize,
    counts_per_m: [f64; CABLES],
    fastest_m_s: f64,
    position: u8,
    restore: Option<([f64; CABLES], [i64; CABLES])>,
    /// Cables whose unit has counted on since the last life of this process.
    alive: [bool; CABLES],
    /// What is known is only what was restored.
    only_restored: bool,
}

impl Odometry {
    /// Lengths unknown.
    #[must_use]
    pub fn new(config: &CoreConfig) -> Self {
        Self {
            cables: [Cable::default(); CABLES],
            count: config.cable_count(),
            counts_per_m: config.counts_per_m,
            fastest_m_s: config.cable_speed_m_s,
            position: MotorState::POSITION_UNKNOWN,
            restore: None,
            alive: [false; CABLES],
            only_restored: false,
        }
    }

    /// Lengths and counts from before this process started; used as soon as every cable has been read.
    pub fn restore(&mut self, lengths_m: [f64; CABLES], counts: [i64; CABLES]) {
        if lengths_m[..self.count].iter().all(|l| l.is_finite()) {
            self.restore = Some((lengths_m, counts));
        }
    }

    /// Cables whose unit was running already when this process first spoke to it.
    pub fn alive(&mut self, alive: [bool; CABLES]) {
        self.alive = alive;
    }

    /// True while the lengths are those from before, and nobody has confirmed them or set others.
    #[must_use]
    pub fn only_restored(&self) -> bool {
        self.only_restored
    }

    /// Takes one cable's reading. `away`: its unit had been lost until now; `drift_m_s`: least and largest velocity that its commands
    /// explain, None where nothing holds the line.
    pub fn read(
        &mut self,
        cable: usize,
        counts: i64,
        sampled_ns: u64,
        away: bool,
        drift_m_s: Option<[f64; 2]>,
    ) -> Reading {
        let scale = self.counts_per_m[cable];
        let it = &mut self.cables[cable];
        if !it.seen {
            *it = Cable { seen: true, zero_counts: counts, zero_m: it.length_m, ..*it };
            it.take(counts, sampled_ns, scale);
            self.try_restore();
            return Reading::Good;
        }
        let passed_s = sampled_ns.saturating_sub(it.sampled_ns) as f64 * 1e-9;
        let fastest_m_s = OVER_SPEED * self.fastest_m_s;
        let [low_m_s, high_m_s] = drift_m_s.unwrap_or([-fastest_m_s, fastest_m_s]);
        let explained = low_m_s * passed_s - JUMP_MARGIN_M..=high_m_s * passed_s + JUMP_MARGIN_M;
        let moved = metres(counts, it.counts, scale);
        if explained.contains(&moved) {
            it.candidate = None;
            it.take(counts, sampled_ns, scale);
            if away && moved.abs() > RETURN_TOLERANCE_M {
                self.doubt();
                return Reading::MovedWhileAway;
            }
            return Reading::Good;
        }
        // A line could have come here from the last doubtful one: two agree, so the count really is there now.
        let reach = fastest_m_s * passed_s + JUMP_MARGIN_M;
        match it.candidate {
            Some(candidate) if metres(counts, candidate, scale).abs() <= reach => {
                self.rebase(cable, counts, sampled_ns);
                Reading::Jumped
            }
            _ => {
                it.candidate = Some(counts);
                Reading::Doubtful
            }
        }
    }

    /// The unit's counter began anew (it was rebooted): the length stays, and needs confirmation.
    pub fn rebase(&mut self, cable: usize, counts: i64, sampled_ns: u64) {
        let scale = self.counts_per_m[cable];
        let it = &mut self.cables[cable];
        *it = Cable { seen: true, zero_counts: counts, zero_m: it.length_m, candidate: None, held: 0, ..*it };
        it.take(counts, sampled_ns, scale);
        it.velocity_m_s = 0.0;
        self.doubt();
    }

    /// The lengths may not be right any more, and need confirmation.
    pub fn doubt(&mut self) {
        if self.position == MotorState::POSITION_KNOWN {
            self.position = MotorState::POSITION_FROM_BEFORE_THE_CUT;
        }
    }

    fn try_restore(&mut self) {
        if !self.cables[..self.count].iter().all(|it| it.seen) {
            return;
        }
        if let Some((lengths_m, counts)) = self.restore.take() {
            // A unit that was running all the time has counted on; the count of one that was switched on anew says nothing about the
            // time before, however near to the stored one it may be.
            for (i, it) in self.cables.iter_mut().enumerate().take(self.count) {
                let moved_m = metres(it.counts, counts[i], self.counts_per_m[i]);
                it.zero_m = lengths_m[i] + if self.alive[i] { moved_m } else { 0.0 };
                it.zero_counts = it.counts;
                it.length_m = it.zero_m;
            }
            self.position = MotorState::POSITION_FROM_BEFORE_THE_CUT;
            self.only_restored = true;
        }
    }

    /// True once every cable has been read.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.cables[..self.count].iter().all(|it| it.seen)
    }

    /// The lengths at this moment are these.
    pub fn set(&mut self, lengths_m: &[f64]) {
        for (it, length_m) in self.cables[..self.count].iter_mut().zip(lengths_m) {
            *it = Cable { zero_counts: it.counts, zero_m: *length_m, length_m: *length_m, candidate: None, ..*it };
        }
        self.position = MotorState::POSITION_KNOWN;
        self.restore = None;
        self.only_restored = false;
    }

    /// Somebody has looked: the lengths from before are right.
    pub fn confirm(&mut self) {
        if self.position == MotorState::POSITION_FROM_BEFORE_THE_CUT {
            self.position = MotorState::POSITION_KNOWN;
            self.only_restored = false;
        }
    }

    /// One of `MotorState::POSITION_*`.
    #[must_use]
    pub fn position(&self) -> u8 {
        self.position
    }

    /// Unstretched line paid out beyond the routed part, m; counted from the start of the process while the position is unknown.
    #[must_use]
    pub fn length_m(&self, cable: usize) -> f64 {
        self.cables[cable].length_m
    }

    /// Over the last 50 ms, m/s.
    #[must_use]
    pub fn velocity_m_s(&self, cable: usize) -> f64 {
        self.cables[cable].velocity_m_s
    }

    /// Last good count.
    #[must_use]
    pub fn counts(&self, cable: usize) -> i64 {
        self.cables[cable].counts
    }

    /// When it was read, ns.
    #[must_use]
    pub fn sampled_ns(&self, cable: usize) -> u64 {
        self.cables[cable].sampled_ns
    }
}

impl Cable {
    fn take(&mut self, counts: i64, sampled_ns: u64, scale: f64) {
        self.counts = counts;
        self.sampled_ns = sampled_ns;
        self.length_m = self.zero_m + metres(counts, self.zero_counts, scale);
        self.newest = (self.newest + 1) % HISTORY;
        self.history[self.newest] = (sampled_ns, counts);
        self.held = (self.held + 1).min(HISTORY);
        // The oldest reading within the window, or else the one before this.
        let mut back = 1.min(self.held - 1);
        for age in 1..self.held {
            let (then_ns, _) = self.history[(self.newest + HISTORY - age) % HISTORY];
            if sampled_ns.saturating_sub(then_ns) <= VELOCITY_WINDOW_NS {
                back = age;
            }
        }
        let (then_ns, then) = self.history[(self.newest + HISTORY - back) % HISTORY];
        let passed_ns = sampled_ns.saturating_sub(then_ns);
        self.velocity_m_s = if passed_ns > 0 { metres(counts, then, scale) / (passed_ns as f64 * 1e-9) } else { 0.0 };
    }
}

fn metres(counts: i64, from: i64, counts_per_m: f64) -> f64 {
    counts.wrapping_sub(from) as f64 / counts_per_m
}
