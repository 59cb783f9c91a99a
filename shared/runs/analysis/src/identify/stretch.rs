//! Stretches of consecutive cycles, without their long rests.

use identification::{MOVING_M_S, Record};
use messages::{CABLES, MotorAuthority, MotorState};

/// Longest stretch, s: ten minutes say as much as an hour.
const LONGEST_S: f64 = 600.0;
/// What is kept of a rest after a motion, and before the next one, s: far longer than delay and lag.
const REST_S: f64 = 5.0;

/// Step of a length at rest, in one cycle, from which it was set again, m: more than the drives settle by. The cycles
/// beside it have less than the other one.
const SET_M: f64 = 0.0005;
const STILL_M: f64 = 0.0002;

/// Samples of a cycle.
#[derive(Default)]
pub(super) struct Row {
    pub begin_ns: Option<u64>,
    pub state: Option<Box<MotorState>>,
    /// Mode and control period, s.
    pub mode: Option<(u8, f64)>,
    pub tension_n: Option<[f64; CABLES]>,
}

/// The longest stretch so far and the present one.
pub(super) struct Stretches {
    best: Stretch,
    now: Stretch,
    last: Option<(u64, u64)>,
    unit_of_cable: [Option<usize>; CABLES],
}

impl Stretches {
    pub fn new(unit_of_cable: [Option<usize>; CABLES]) -> Self {
        Self { best: Stretch::default(), now: Stretch::default(), last: None, unit_of_cable }
    }

    /// Adds the row of a life and cycle, which follows all others.
    pub fn add(&mut self, place: (u64, u64), row: &Row) {
        let (life, cycle) = place;
        let complete = (row.begin_ns, row.state.as_deref().filter(|state| state.position_known > 0), row.mode);
        let (Some(begin_ns), Some(state), Some((mode, period_s))) = complete else {
            self.last = None;
            return;
        };
        if self.last != Some((life, cycle.wrapping_sub(1))) {
            let ended = std::mem::replace(&mut self.now, Stretch::new(period_s, usize::from(state.cable_count)));
            self.keep_longer(ended);
        }
        self.last = Some(place);
        for (cable, record) in self.now.cables.iter_mut().enumerate() {
            let supply_v = self.unit_of_cable[cable].and_then(|unit| state.supply_v.get(unit));
            push(record, cable, begin_ns, state, mode, row.tension_n);
            record.supply_v.push(supply_v.copied().unwrap_or(f64::NAN));
        }
        self.now.is_cut.push(false);
        self.now.cut_rest();
    }

    /// Whether no later cycle is used.
    pub fn are_full(&self) -> bool {
        self.now.len() as f64 * self.now.period_s >= LONGEST_S
    }

    fn keep_longer(&mut self, other: Stretch) {
        if other.len() > self.best.len() {
            self.best = other;
        }
    }

    /// The records of the longest stretch.
    pub fn longest(mut self) -> Vec<Record> {
        let now = std::mem::take(&mut self.now);
        self.keep_longer(now);
        self.best.joined()
    }
}

/// Consecutive cycles.
#[derive(Default)]
struct Stretch {
    period_s: f64,
    cables: Vec<Record>,
    /// Whether cycles before this one were cut out.
    is_cut: Vec<bool>,
    /// Cycles since the last motion of a cable.
    rested: usize,
}

impl Stretch {
    fn new(period_s: f64, cables: usize) -> Self {
        let record = || Record { period_s, ..Record::default() };
        Self { period_s, cables: (0..cables.min(CABLES)).map(|_| record()).collect(), ..Self::default() }
    }

    fn len(&self) -> usize {
        self.is_cut.len()
    }

    /// Cuts a cycle from the middle of a long rest.
    fn cut_rest(&mut self) {
        let moves = |record: &Record| record.command_m_s.last().is_some_and(|command| command.abs() > MOVING_M_S);
        self.rested = if self.cables.iter().any(moves) { 0 } else { self.rested + 1 };
        let kept = (REST_S / self.period_s).ceil();
        if !kept.is_finite() || self.rested <= 2 * kept as usize {
            return;
        }
        let at = self.len() - kept as usize - 1;
        for record in &mut self.cables {
            remove(record, at);
        }
        self.is_cut.remove(at);
        self.is_cut[at] = true;
        self.rested -= 1;
    }

    /// The records, in which the cycles after a cut follow those before it.
    fn joined(self) -> Vec<Record> {
        let Self { period_s, mut cables, is_cut, .. } = self;
        for record in &mut cables {
            let (mut shift_s, mut before_s) = (0.0, 0.0);
            for (k, is_cut) in is_cut.iter().enumerate() {
                let sent_s = record.sent_s[k];
                if *is_cut {
                    shift_s += sent_s - before_s - period_s;
                    // The length may have changed meanwhile.
                    record.is_flown[k] = false;
                }
                before_s = sent_s;
                record.sent_s[k] -= shift_s;
                record.read_s[k] -= shift_s;
            }
            record.interpolate_lost();
        }
        undo_setting(&mut cables);
        cables
    }
}

/// Undoes that lengths were set again while all cables rested: no cable moved then.
fn undo_setting(cables: &mut [Record]) {
    let cycles = cables.iter().map(Record::len).min().unwrap_or(0);
    let largest_m = |cables: &[Record], k: usize| {
        cables.iter().map(|record| (record.length_m[k] - record.length_m[k - 1]).abs()).fold(0.0, f64::max)
    };
    for k in 2..cycles.saturating_sub(1) {
        let rests = |record: &Record| record.command_m_s[k - 1..=k].iter().all(|command| command.abs() < MOVING_M_S);
        let is_alone = [k - 1, k + 1].iter().all(|beside| largest_m(cables, *beside) < STILL_M);
        if largest_m(cables, k) < SET_M || !is_alone || !cables.iter().all(rests) {
            continue;
        }
        for record in cables.iter_mut() {
            let step_m = record.length_m[k] - record.length_m[k - 1];
            record.length_m[k..].iter_mut().for_each(|length_m| *length_m -= step_m);
        }
    }
}

fn remove(record: &mut Record, at: usize) {
    let Record { sent_s, command_m_s, read_s, length_m, duty, current_a, supply_v, tension_n, .. } = record;
    for list in [sent_s, command_m_s, read_s, length_m, duty, current_a, supply_v, tension_n] {
        list.remove(at);
    }
    record.is_flown.remove(at);
}

fn push(
    record: &mut Record,
    cable: usize,
    begin_ns: u64,
    state: &MotorState,
    mode: u8,
    tension_n: Option<[f64; CABLES]>,
) {
    record.sent_s.push(begin_ns as f64 * 1e-9);
    record.command_m_s.push(state.command_m_s[cable]);
    record.read_s.push(state.sampled_ns[cable] as f64 * 1e-9);
    record.length_m.push(state.length_m[cable]);
    record.duty.push(state.duty[cable]);
    record.current_a.push(state.current_a[cable]);
    record.tension_n.push(tension_n.map_or(f64::NAN, |tension_n| tension_n[cable]));
    let speeds = [
        MotorAuthority::MODE_HOLDING,
        MotorAuthority::MODE_JOGGING,
        MotorAuthority::MODE_FOLLOWING,
        MotorAuthority::MODE_STOPPING,
    ];
    record.is_flown.push(speeds.contains(&mode));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of one cable on the second unit, with this command.
    fn row(cycle: u64, command_m_s: f64) -> Row {
        let mut state = MotorState { position_known: 1, cable_count: 1, ..MotorState::default() };
        (state.command_m_s[0], state.sampled_ns[0]) = (command_m_s, cycle * 10_000_000 + 4_000_000);
        (state.supply_v[0], state.supply_v[1]) = (11.0, 12.0);
        let mode = Some((MotorAuthority::MODE_FOLLOWING, 0.01));
        Row { begin_ns: Some(cycle * 10_000_000), state: Some(Box::new(state)), mode, tension_n: None }
    }

    fn stretches() -> Stretches {
        let mut units = [None; CABLES];
        units[0] = Some(1);
        Stretches::new(units)
    }

    #[test]
    fn an_hour_of_rest_between_motions_is_cut() {
        let mut stretches = stretches();
        // A minute of motion, an hour of rest, and a minute of motion.
        for cycle in 1..=372_000 {
            let moves = cycle <= 6000 || cycle > 366_000;
            stretches.add((1, cycle), &row(cycle, if moves { 0.1 } else { 0.0 }));
            assert!(stretches.now.len() <= 13_001);
        }
        let records = stretches.longest();
        let [record] = records.as_slice() else { panic!("one cable") };
        assert_eq!(record.len(), 13_000);
        assert!(record.sent_s.is_sorted_by(|before, after| (after - before - 0.01).abs() < 1e-6));
        assert!(record.read_s.is_sorted_by(|before, after| (after - before - 0.01).abs() < 1e-6));
        let not: Vec<usize> = (0..record.len()).filter(|k| !record.is_flown[*k]).collect();
        assert_eq!(not, [6500], "the cut alone");
        assert!(record.supply_v.iter().all(|supply_v| *supply_v == 12.0));
    }

    #[test]
    fn the_longest_stretch_is_kept_and_none_is_longer_than_ten_minutes() {
        let mut stretches = stretches();
        for cycle in (1..=800).chain(1000..=1600).chain(1602..=1700) {
            stretches.add((1, cycle), &row(cycle, 0.1));
        }
        assert_eq!(stretches.longest()[0].len(), 800);
        let mut stretches = self::stretches();
        let full = (1..100_000).find(|cycle| {
            stretches.add((1, *cycle), &row(*cycle, 0.1));
            stretches.are_full()
        });
        assert_eq!(full, Some(60_000));
    }

    #[test]
    fn a_lost_reading_does_not_end_a_stretch() {
        let mut stretches = stretches();
        for cycle in 1..=1000 {
            let mut row = row(cycle, 0.1);
            // An answer that is lost in each fiftieth cycle.
            if let Some(state) = row.state.as_mut().filter(|_| cycle % 50 == 0) {
                state.sampled_ns[0] -= 10_000_000;
            }
            stretches.add((1, cycle), &row);
        }
        let record = stretches.longest().remove(0);
        assert_eq!(record.len(), 1000);
        let readings = record.read_s.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(readings.take(998).all(|step_s| (step_s - 0.01).abs() < 1e-6));
        assert!(record.is_flown[..999].iter().all(|flown| *flown) && !record.is_flown[999]);
    }

    #[test]
    fn lengths_that_are_set_at_rest_move_no_cable() {
        let mut stretches = stretches();
        for cycle in 1..=2000 {
            let moves = !(400..=1200).contains(&cycle);
            let mut row = row(cycle, if moves { 0.1 } else { 0.0 });
            if let Some(state) = &mut row.state {
                let moved_m = 0.001 * (cycle.min(400) + cycle.max(1200)) as f64;
                state.length_m[0] = moved_m + if cycle >= 800 { 0.02 } else { 0.0 };
            }
            stretches.add((1, cycle), &row);
        }
        let record = stretches.longest().remove(0);
        let gone_m = record.length_m[1999] - record.length_m[0];
        assert!((gone_m - 1.199).abs() < 1e-9, "{gone_m}");
    }

    #[test]
    fn the_supply_of_an_unknown_unit_is_unknown() {
        let mut stretches = Stretches::new([None; CABLES]);
        stretches.add((1, 1), &row(1, 0.1));
        assert!(stretches.longest()[0].supply_v[0].is_nan());
    }
}
