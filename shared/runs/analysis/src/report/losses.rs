//! When periods were not steered, and why.

use messages::MotorAuthority;
use robot_state::Periods;

/// Time from which two losses by the same cause are two stretches, s.
const APART_S: f64 = 0.15;
/// Largest number of stretches; a list of more is not read.
const MOST: usize = 200;
/// Stretches in one line of text.
const IN_WORDS: usize = 3;

/// Periods that were lost one after the other, to one cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Time of the first cycle that counts such a period, s since the start of the run.
    pub from_s: f64,
    /// Time of the last one, s since the start of the run.
    pub to_s: f64,
    /// Those cycles.
    pub cycles: [u64; 2],
    /// `computer`, `drive`, `resync` or `answer`.
    pub cause: &'static str,
    /// Number of periods.
    pub periods: u64,
}

/// Every stretch of a run, as motor-io counted them; what lies between two lives of motor-io is in none.
#[derive(Debug, Default)]
pub struct Losses {
    stretches: Vec<Stretch>,
    /// Stretches beyond the limit of the list.
    pub left_out: usize,
    /// Life and counts of the last cycle.
    last: Option<(u64, Periods)>,
}

impl Losses {
    /// Records a cycle.
    pub fn cycle(&mut self, time_s: f64, authority: &MotorAuthority) {
        let (life, now) = (authority.header.life, Periods::from_authority(authority));
        // The counts of a life begin with it. A run may begin later than a life: what was before is unknown.
        let before = match self.last.replace((life, now)) {
            Some((last, before)) if last == life => before,
            Some(_) => Periods::default(),
            None => now,
        };
        for ((cause, count), (_, counted)) in now.causes().into_iter().zip(before.causes()) {
            let periods = count.saturating_sub(counted);
            if periods > 0 {
                self.add(Stretch { from_s: time_s, to_s: time_s, cycles: [authority.header.cycle; 2], cause, periods });
            }
        }
    }

    fn add(&mut self, lost: Stretch) {
        let goes_on = |known: &Stretch| known.cause == lost.cause && lost.from_s - known.to_s < APART_S;
        // Another cause may lie between.
        let from = self.stretches.len().saturating_sub(2);
        match self.stretches[from..].iter().rposition(goes_on) {
            Some(at) => {
                let known = &mut self.stretches[from + at];
                (known.to_s, known.cycles[1]) = (lost.to_s, lost.cycles[1]);
                known.periods += lost.periods;
            }
            None if self.stretches.len() < MOST => self.stretches.push(lost),
            None => self.left_out += 1,
        }
    }

    /// Returns the stretches in the order of their beginning.
    #[must_use]
    pub fn stretches(&self) -> &[Stretch] {
        &self.stretches
    }

    /// Returns the longest ones in a line of text; `None` without any.
    #[must_use]
    pub fn words(&self) -> Option<String> {
        let mut longest: Vec<&Stretch> = self.stretches.iter().collect();
        longest.sort_by(|a, b| b.periods.cmp(&a.periods).then(a.from_s.total_cmp(&b.from_s)));
        let more = (longest.len() + self.left_out).saturating_sub(IN_WORDS);
        longest.truncate(IN_WORDS);
        longest.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
        let say = |one: &&Stretch| format!("{} at {:.2} s ({})", one.periods, one.from_s, one.cause);
        let listed: Vec<String> = longest.iter().map(say).collect();
        let more = if more > 0 { format!("; {more} further stretches") } else { String::new() };
        (!listed.is_empty()).then(|| format!("{}{more}", listed.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_of_one_cause_without_a_gap_are_one_stretch() {
        let mut losses = Losses::default();
        let mut authority = MotorAuthority { lost_drive: 7, ..MotorAuthority::default() };
        authority.header.life = 3;
        let mut cycle = |at: u64, life: u64, change: &dyn Fn(&mut MotorAuthority)| {
            authority.header.cycle = at;
            if authority.header.life != life {
                authority = MotorAuthority { header: authority.header, ..MotorAuthority::default() };
                authority.header.life = life;
            }
            change(&mut authority);
            losses.cycle(at as f64 * 0.01, &authority);
        };
        cycle(1, 3, &|_| ());
        // Five periods in six cycles, one of them by the computer; then one much later.
        cycle(2, 3, &|now| now.lost_drive += 2);
        cycle(3, 3, &|now| now.lost_computer += 1);
        cycle(5, 3, &|now| now.lost_drive += 1);
        cycle(7, 3, &|now| now.lost_drive += 1);
        cycle(50, 3, &|now| now.lost_drive += 1);
        // A new life counts from zero.
        cycle(60, 4, &|_| ());
        cycle(61, 4, &|now| now.lost_answer += 20);
        let rows: Vec<_> =
            losses.stretches().iter().map(|one| (one.cause, one.periods, one.cycles[0], one.cycles[1])).collect();
        assert_eq!(rows, [("drive", 4, 2, 7), ("computer", 1, 3, 3), ("drive", 1, 50, 50), ("answer", 20, 61, 61)]);
        let words = losses.words().unwrap();
        assert_eq!(words, "4 at 0.02 s (drive), 1 at 0.03 s (computer), 20 at 0.61 s (answer); 1 further stretches");
        assert_eq!(Losses::default().words(), None);
    }

    #[test]
    fn the_list_has_a_limit() {
        let mut losses = Losses::default();
        for at in 0..=250_u64 {
            let authority = MotorAuthority { lost_resync: at, ..MotorAuthority::default() };
            losses.cycle(at as f64, &authority);
        }
        assert_eq!((losses.stretches().len(), losses.left_out), (MOST, 50));
    }
}
