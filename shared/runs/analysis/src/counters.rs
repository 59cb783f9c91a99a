//! Counts the periods of missions that were not steered, by cause. Implements the rules in `docs/counters.md`.

use messages::{Message, MotorAuthority, MotorInput};
use robot_state::Periods;
use runlog::RecordedSample;
use std::collections::VecDeque;

/// Maximum number of samples of one channel that wait for the other channel's sample of the same cycle. Beyond this the
/// other channel is considered missing.
const MAX_WAITING: usize = 4096;

/// Fields of `motor/input` used for counting.
#[derive(Debug, Clone, Copy)]
struct InputRecord {
    at: (u64, u64),
    tick_ns: u64,
    mission: u32,
}

/// Fields of `motor/authority` used for counting.
#[derive(Debug, Clone, Copy)]
struct AuthorityRecord {
    at: (u64, u64),
    periods: Periods,
    period: u8,
    period_s: f64,
    motion: u32,
}

/// Counts the periods of a run over all its lives of motor-io. Requires every sample in file order.
#[derive(Debug, Default)]
pub struct PeriodCounter {
    inputs: VecDeque<InputRecord>,
    authorities: VecDeque<AuthorityRecord>,
    last: Option<(InputRecord, AuthorityRecord)>,
    /// Sum over completed lives and the time between lives.
    before: Periods,
    /// Mission that was active when the last life ended, until it resumes or ends.
    carried: Option<u32>,
}

impl PeriodCounter {
    /// Records a sample; ignores other channels.
    pub fn record(&mut self, recorded: &RecordedSample<'_>) {
        match recorded.channel.name.as_str() {
            "motor/input" => _ = recorded.decode::<MotorInput>().map(|input| self.input(&input)),
            "motor/authority" => _ = recorded.decode::<MotorAuthority>().map(|authority| self.authority(&authority)),
            _ => {}
        }
    }

    /// Records the input of a cycle.
    pub fn input(&mut self, input: &MotorInput) {
        self.inputs.push_back(InputRecord {
            at: life_and_cycle(input),
            tick_ns: input.tick_ns,
            mission: input.mission,
        });
        self.pair();
    }

    /// Records the outcome of a cycle.
    pub fn authority(&mut self, authority: &MotorAuthority) {
        self.authorities.push_back(AuthorityRecord {
            at: life_and_cycle(authority),
            periods: Periods::from_authority(authority),
            period: authority.period,
            period_s: authority.period_s,
            motion: authority.motion,
        });
        self.pair();
    }

    /// Returns the counts so far.
    #[must_use]
    pub fn periods(&self) -> Periods {
        let mut all = self.before;
        match (&self.last, self.authorities.back()) {
            (Some((_, authority)), _) => all.add(&authority.periods),
            // Without motor/input, the time between lives is unknown.
            (None, Some(authority)) => all.add(&authority.periods),
            (None, None) => {}
        }
        all
    }

    /// Counts a cycle as soon as both its samples are present; a life may end between them.
    fn pair(&mut self) {
        while let (Some(input), Some(authority)) = (self.inputs.front().copied(), self.authorities.front().copied()) {
            if input.at <= authority.at {
                self.inputs.pop_front();
            }
            if authority.at <= input.at {
                self.authorities.pop_front();
            }
            if input.at == authority.at {
                self.cycle(input, authority);
            }
        }
        if self.inputs.len() > MAX_WAITING {
            self.inputs.pop_front();
        }
        if self.authorities.len() > MAX_WAITING {
            self.authorities.pop_front();
        }
    }

    fn cycle(&mut self, input: InputRecord, authority: AuthorityRecord) {
        let skipped = |before: &InputRecord| {
            let periods = input.tick_ns.saturating_sub(before.tick_ns) as f64 * 1e-9 / authority.period_s;
            ((periods + 0.5) as u64).saturating_sub(1)
        };
        let mut between = 0;
        match &self.last {
            Some((before, _)) if before.at.0 == input.at.0 => between = skipped(before),
            Some((before, then)) => {
                self.before.add(&then.periods);
                if then.motion != 0 {
                    // The life ended during its mission, so the node was not steered until the next life began.
                    self.before.answer += skipped(before);
                    self.carried = Some(before.mission);
                }
            }
            None => {}
        }
        if let Some(mission) = self.carried {
            let on = authority.period == MotorAuthority::PERIOD_NO_MISSION && input.mission == mission && mission != 0;
            match on {
                true => self.before.answer += 1 + between,
                false => self.carried = None,
            }
        }
        self.last = Some((input, authority));
    }
}

fn life_and_cycle(sample: &impl Message) -> (u64, u64) {
    let header = sample.header();
    (header.life, header.cycle)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 10_000_000;

    struct Run {
        count: PeriodCounter,
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
        let mut run = Run { count: PeriodCounter::default(), authority: MotorAuthority::default() };
        run.cycle(1, 1, 5, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(1, 2, 5, 1, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(1, 3, 5, 1, MotorAuthority::PERIOD_STEERED);
        // The life ended between the two samples of the next cycle.
        let mut half = run.authority;
        half.header.cycle += 1;
        half.steered += 1;
        run.count.authority(&half);
        // Cycles 4 to 19 did not run or were not recorded; 20 and 22 still belong to the mission, and 21 did not run.
        run.cycle(9, 20, 5, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(9, 22, 5, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(9, 23, 0, 0, MotorAuthority::PERIOD_NO_MISSION);
        run.cycle(9, 24, 6, 0, MotorAuthority::PERIOD_NO_MISSION);
        let periods = run.count.periods();
        assert_eq!(periods, Periods { steered: 1, answer: 16 + 3, ..Periods::default() });
        assert_eq!(periods.leading(), "19 of 20 periods not steered");
        assert_eq!(periods.by_cause(), "computer 0, drive 0, resync 0, answer 19");
        // A life that ends at rest adds nothing.
        run.cycle(11, 90, 6, 0, MotorAuthority::PERIOD_NO_MISSION);
        assert_eq!(run.count.periods(), periods);
    }
}
