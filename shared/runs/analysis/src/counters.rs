//! Periods of missions: how many of them were not steered, and why. `docs/counters.md` has the rules; what is here follows them.

use messages::{Message, MotorAuthority, MotorInput};
use robot_state::Periods;
use runlog::RecordedSample;
use std::collections::VecDeque;

/// Samples of one channel that wait for the other one's of the same cycle. Beyond this the other channel is not there.
const WAITING: usize = 4096;

/// What of `motor/input` the count needs.
#[derive(Debug, Clone, Copy)]
struct Tick {
    at: (u64, u64),
    tick_ns: u64,
    mission: u32,
}

/// The same of `motor/authority`.
#[derive(Debug, Clone, Copy)]
struct Word {
    at: (u64, u64),
    periods: Periods,
    period: u8,
    period_s: f64,
    motion: u32,
}

/// Counts the periods of a run, over all lives of motor-io in it. Give it every sample in the order of the file.
#[derive(Debug, Default)]
pub struct Count {
    ticks: VecDeque<Tick>,
    words: VecDeque<Word>,
    last: Option<(Tick, Word)>,
    /// Of lives that are over, and between lives.
    before: Periods,
    /// The mission that was on when the last life ended, until it is taken up again or ends.
    carried: Option<u32>,
}

impl Count {
    /// Takes a sample in; others than those of the two channels are passed over.
    pub fn note(&mut self, recorded: &RecordedSample<'_>) {
        match recorded.channel.name.as_str() {
            "motor/input" => _ = recorded.to::<MotorInput>().map(|input| self.input(&input)),
            "motor/authority" => _ = recorded.to::<MotorAuthority>().map(|authority| self.authority(&authority)),
            _ => {}
        }
    }

    /// Takes in a cycle's input.
    pub fn input(&mut self, input: &MotorInput) {
        self.ticks.push_back(Tick { at: place(input), tick_ns: input.tick_ns, mission: input.mission });
        self.pair();
    }

    /// Takes in what a cycle came to.
    pub fn authority(&mut self, authority: &MotorAuthority) {
        self.words.push_back(Word {
            at: place(authority),
            periods: Periods::of(authority),
            period: authority.period,
            period_s: authority.period_s,
            motion: authority.motion,
        });
        self.pair();
    }

    /// What it comes to so far.
    #[must_use]
    pub fn periods(&self) -> Periods {
        let mut all = self.before;
        match (&self.last, self.words.back()) {
            (Some((_, word)), _) => all.add(&word.periods),
            // Without motor/input nothing is known of the time between lives.
            (None, Some(word)) => all.add(&word.periods),
            (None, None) => {}
        }
        all
    }

    /// A cycle counts once both its samples are there: a life may end between them.
    fn pair(&mut self) {
        while let (Some(tick), Some(word)) = (self.ticks.front().copied(), self.words.front().copied()) {
            if tick.at <= word.at {
                self.ticks.pop_front();
            }
            if word.at <= tick.at {
                self.words.pop_front();
            }
            if tick.at == word.at {
                self.cycle(tick, word);
            }
        }
        if self.ticks.len() > WAITING {
            self.ticks.pop_front();
        }
        if self.words.len() > WAITING {
            self.words.pop_front();
        }
    }

    fn cycle(&mut self, tick: Tick, word: Word) {
        let skipped = |before: &Tick| {
            let periods = tick.tick_ns.saturating_sub(before.tick_ns) as f64 * 1e-9 / word.period_s;
            ((periods + 0.5) as u64).saturating_sub(1)
        };
        let mut between = 0;
        match &self.last {
            Some((before, _)) if before.at.0 == tick.at.0 => between = skipped(before),
            Some((before, then)) => {
                self.before.add(&then.periods);
                if then.motion != 0 {
                    // The life ended with its mission on: nothing steered the node until the next one began.
                    self.before.answer += skipped(before);
                    self.carried = Some(before.mission);
                }
            }
            None => {}
        }
        if let Some(mission) = self.carried {
            let on = word.period == MotorAuthority::PERIOD_NO_MISSION && tick.mission == mission && mission != 0;
            match on {
                true => self.before.answer += 1 + between,
                false => self.carried = None,
            }
        }
        self.last = Some((tick, word));
    }
}

fn place(sample: &impl Message) -> (u64, u64) {
    let header = sample.header();
    (header.life, header.cycle)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 10_000_000;

    struct Run {
        count: Count,
        authority: MotorAuthority,
    }

    impl Run {
        fn cycle(&mut self, life: u64, at: u64, mission: u32, motion: u32, period: u8) {
            if self.authority.header.life != life {
                self.authority = MotorAuthority { period_s: 0.01, ..MotorAuthority::default() };
                self.authority.header.life = life;
            }
            self.authority.header.cycle += 1;
            self.authority.motion = motion;
            self.authority.period = period;
            self.authority.steered += u64::from(period == MotorAuthority::PERIOD_STEERED);
            let mut input = MotorInput { tick_ns: at * PERIOD_NS, mission, ..MotorInput::default() };
            input.header = self.authority.header;
            self.count.authority(&self.authority);
            self.count.input(&input);
        }
    }

    #[test]
    fn dead_time_between_lives_counts_until_the_mission_ends() {
        let mut run = Run { count: Count::default(), authority: MotorAuthority::default() };
        run.cycle(1, 1, 5, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(1, 2, 5, 1, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(1, 3, 5, 1, MotorAuthority::PERIOD_STEERED);
        // The next cycle was published by half when the life ended.
        let mut half = run.authority;
        half.header.cycle += 1;
        half.steered += 1;
        run.count.authority(&half);
        // Ticks 4 to 19 never were, or nobody knows of them; 20 and 22 still belong to the mission, and 21 never ran.
        run.cycle(9, 20, 5, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(9, 22, 5, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(9, 23, 0, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(9, 24, 6, 0, MotorAuthority::PERIOD_NO_MISSION);
        let periods = run.count.periods();
        assert_eq!(periods, Periods { steered: 1, answer: 16 + 3, ..Periods::default() });
        assert_eq!(periods.leading(), "19 of 20 periods not steered");
        assert_eq!(periods.by_cause(), "computer 0, drive 0, resync 0, answer 19");
        // A life that ends at rest leaves nothing open.
        run.cycle(11, 90, 6, 0, MotorAuthority::PERIOD_NO_MISSION);
        assert_eq!(run.count.periods(), periods);
    }
}
