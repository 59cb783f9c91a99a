//! Whether the two encoders of a cable agree: one follows the cable over an idler, the other one counts turns of the
//! drum.
//!
//! A second one that is not read any more is a fault too: a slip would not be seen.
//!
//! They part where the cable slips on the drum or over the idler, where it is broken or pinched between the two, where
//! a coupling turns on its shaft, and where an encoder fails. What they count differently is summed up in each
//! direction, less the share of their motion that the errors of drum, wheel, layers and stretch explain, and never
//! below zero: so errors in proportion to the motion add up to nothing, and a slip counts from where it begins. The sum
//! is a fault from `slip_m` on, to which come the stretch between the two encoders and their steps.
//!
//! Which of them is right, the counts do not say, with one exception: an idler that turns further than the drum was
//! turned by the cable. Then the length by an idler is still true, and the position stays. Which one turned further is
//! found out while they differ: motions of both in common say nothing. Where the drum turned
//! further, either the cable slipped on it, or the idler did not turn with the cable; and turns of a drum on which the
//! cable slipped are no length at all. Both need a confirmation.

use crate::odometry::Wind;
use crate::settings::CoreConfig;
use cable_robot::Drum;
use messages::faults::Faults;
use messages::{CABLES, MotorAuthority, MotorInput};

/// Time without a reading of a second encoder that is a fault, s: as long as the answers of a unit may be disturbed.
const UNREAD_S: f64 = 0.4;
/// Motion that shows which encoder turned further, as a share of `slip_m`: as much can be attributed wrongly where the
/// motion turns.
const TELLING_SHARE: f64 = 0.1;

/// What the first and the second encoder of a cable count differently in one direction.
#[derive(Debug, Clone, Copy, Default)]
struct Excess {
    /// Beyond what is explained, m.
    metres: f64,
    /// By how much of it the second encoder turned further than the first one, whichever way each turned, m; negative:
    /// the first one further.
    ahead_m: f64,
    /// As much as was found before, m.
    found_m: f64,
}

impl Excess {
    /// `apart_m` is the difference in this direction.
    fn add(&mut self, apart_m: f64, explained_m: f64) {
        let metres = self.metres + apart_m - explained_m;
        *self = if metres > 0.0 { Self { metres, ..*self } } else { Self::default() };
        self.attribute(0.0);
    }

    /// Attributes a part of it. What is gone was of either encoder.
    fn attribute(&mut self, ahead_m: f64) {
        self.ahead_m = (self.ahead_m + ahead_m).clamp(-self.metres, self.metres);
    }

    /// Returns true once for each such amount.
    fn exceeds(&mut self, most_m: f64) -> bool {
        let new = self.metres > self.found_m + most_m;
        if new {
            self.found_m = self.metres;
        }
        new
    }

    /// Most of it is motion of the first encoder that the second one did not make.
    fn first_turned_further(&self) -> bool {
        self.ahead_m < -0.5 * self.metres
    }
}

/// Comparison of one cable.
#[derive(Debug, Clone, Copy, Default)]
struct Cable {
    /// Counts of both encoders when they were last compared.
    last: Option<[i64; 2]>,
    /// The second one counts more cable paid out, and less.
    more: Excess,
    less: Excess,
    /// Cycles in a row in which the first encoder was read and the second one was not.
    unread: u32,
    /// Cable that each of them counted since a part was last attributed, m.
    counted_m: [f64; 2],
}

impl Cable {
    /// Adds the cable that each encoder counted in a cycle, m.
    fn add(&mut self, counted_m: [f64; 2], comparison: &Comparison) {
        let explained_m = comparison.share * counted_m[0].abs().max(counted_m[1].abs());
        let apart_m = counted_m[1] - counted_m[0];
        self.more.add(apart_m, explained_m);
        self.less.add(-apart_m, explained_m);
        for (sum_m, m) in self.counted_m.iter_mut().zip(counted_m) {
            *sum_m += m;
        }
        let most_m = self.more.metres.max(self.less.metres);
        if most_m > comparison.most_m || self.counted_m.iter().any(|m| m.abs() >= comparison.telling_m) {
            self.attribute(comparison.share);
        }
    }

    /// Attributes what the two encoders counted differently to the one that turned further, by as much as is not
    /// explained.
    fn attribute(&mut self, share: f64) {
        let [first_m, second_m] = std::mem::take(&mut self.counted_m);
        let ahead_m = second_m.abs() - first_m.abs();
        let beyond_m = (ahead_m.abs() - share * first_m.abs().max(second_m.abs())).max(0.0);
        let excess = if second_m > first_m { &mut self.more } else { &mut self.less };
        excess.attribute(beyond_m.copysign(ahead_m));
    }
}

/// What a second encoder has to be compared with.
#[derive(Debug, Clone, Copy)]
struct Comparison {
    winds: [Wind; 2],
    /// Share of the motion that is explained.
    share: f64,
    /// Sum from which it is a fault, m.
    most_m: f64,
    /// Cycles in a row without a reading that are a fault.
    unread: u32,
    /// Motion from which it shows which encoder turned further, m. At rest a cable that swings turns each of them to
    /// and fro by a step.
    telling_m: f64,
}

/// The comparison of the two encoders of each cable.
#[derive(Debug, Clone)]
pub(crate) struct Slips {
    comparisons: [Option<Comparison>; CABLES],
    cables: [Cable; CABLES],
    first_on_drum: bool,
}

/// Readings of a cycle.
pub(crate) struct Compared<'a> {
    pub(crate) input: &'a MotorInput,
    /// The count of the first encoder is of this cycle and was used.
    pub(crate) fresh: &'a [bool; CABLES],
    /// The count of the first encoder is unrelated to those before.
    pub(crate) restarted: &'a [bool; CABLES],
    /// Length before this cycle, m.
    pub(crate) length_m: &'a [f64; CABLES],
    /// The drives hold or move, and the lengths are known: a difference counts.
    pub(crate) counts: bool,
}

impl Slips {
    pub(crate) fn new(config: &CoreConfig) -> Self {
        let comparison = |cable| (cable < config.cable_count()).then(|| Comparison::new(config, cable)).flatten();
        Self {
            comparisons: std::array::from_fn(comparison),
            cables: [Cable::default(); CABLES],
            first_on_drum: config.robot.counts_turns(),
        }
    }

    /// Compares the counts of a cycle; returns true where a length needs a confirmation. What was found is found again
    /// only after as much more, so that a confirmation lasts.
    pub(crate) fn observe(&mut self, now: &Compared<'_>, found: &mut Faults) -> bool {
        let mut doubtful = false;
        for (i, (cable, comparison)) in self.cables.iter_mut().zip(&self.comparisons).enumerate() {
            let Some(comparison) = comparison else { continue };
            if !now.counts || now.restarted[i] {
                *cable = Cable::default();
            }
            if !now.fresh[i] {
                continue;
            }
            if now.input.second[i] == MotorInput::SECOND_ABSENT {
                cable.unread = cable.unread.saturating_add(u32::from(now.counts));
                if cable.unread == comparison.unread {
                    // Lengths and drives go by the first one.
                    found.cable(MotorAuthority::FAULT_SLIP, i);
                }
                continue;
            }
            cable.unread = 0;
            let counts = [now.input.counts[i], now.input.second_counts[i]];
            let last = cable.last.replace(counts);
            let Some(last) = last.filter(|_| now.input.second[i] == MotorInput::SECOND_CONTINUED) else { continue };
            if !now.counts {
                continue;
            }
            let moved_m = |k: usize| comparison.winds[k].metres(now.length_m[i], counts[k], last[k]);
            cable.add([moved_m(0), moved_m(1)], comparison);
            let Some(excess) = [&mut cable.more, &mut cable.less]
                .into_iter()
                .find_map(|it| it.exceeds(comparison.most_m).then_some(*it))
            else {
                continue;
            };
            found.cable(MotorAuthority::FAULT_SLIP, i);
            let kept = !self.first_on_drum && excess.first_turned_further();
            // The loop of the drive holds by an idler that may not turn with the cable.
            if !kept && !self.first_on_drum {
                found.release(i);
            }
            doubtful |= !kept;
        }
        doubtful
    }

    /// Forgets what was found, after a reset.
    pub(crate) fn clear(&mut self) {
        for cable in &mut self.cables {
            *cable = Cable { last: cable.last, ..Cable::default() };
        }
    }

    /// Cable that the second encoder counted more than the first one, beyond what is explained, m; NaN: there is none.
    pub(crate) fn apart_m(&self, cable: usize) -> f64 {
        match self.comparisons[cable] {
            Some(_) => self.cables[cable].more.metres - self.cables[cable].less.metres,
            None => f64::NAN,
        }
    }
}

impl Comparison {
    fn new(config: &CoreConfig, cable: usize) -> Option<Self> {
        let second = config.second.as_ref()?;
        let robot = &config.robot;
        let drum = robot.drum(cable);
        let on_second = if robot.counts_turns() { Drum::default() } else { drum };
        let winds = [
            Wind { counts_per_m: config.counts_per_m[cable], drum: robot.counted(cable) },
            Wind { counts_per_m: second.counts_per_m[cable], drum: on_second },
        ];
        let [least_n, most_n] = robot.tension_limits_n();
        let strain = |tension_n: f64| robot.stiffness_n().map_or(0.0, |stiffness_n| tension_n / stiffness_n);
        let (layers, _) = drum.layer_error();
        // A step of each encoder, of turns on the largest radius.
        let steps_m = winds[0].step_m() + second.step_counts * winds[1].step_m();
        Some(Self {
            winds,
            // An idler may count the cable as stretched, and the model takes the drum's as unstretched.
            share: second.slip_share + layers + strain(most_n),
            most_m: second.slip_m + second.idler_m * strain(most_n - least_n) + steps_m,
            unread: config.cycles(UNREAD_S),
            telling_m: TELLING_SHARE * second.slip_m + 2.0 * steps_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::SecondEncoders;
    use cable_robot::{DrumParts, Robot, RobotParts};

    const FIRST_PER_M: f64 = 10_000.0;
    const SECOND_PER_M: f64 = 100_000.0;
    const SLIP_M: f64 = 0.02;

    fn slips(on_drum: bool) -> Slips {
        let drum = DrumParts {
            diameter_m: 0.04,
            cable_diameter_m: 0.0,
            turns_per_layer: 100.0,
            cable_m: vec![30.0; 3],
            counted: on_drum,
        };
        let anchors_m = vec![[0.0, 0.0, 3.0], [6.0, 0.0, 3.0], [3.0, 5.0, 3.0]];
        let parts = RobotParts {
            anchors_m,
            node_mass_kg: 1.0,
            tension_limits_n: [1.0, 60.0],
            speed_limit_m_s: 0.5,
            acceleration_limit_m_s2: 0.5,
            drum: Some(drum),
            ..RobotParts::default()
        };
        let robot = Robot::new(parts).unwrap();
        let mut config = CoreConfig::new(robot, 0.01, &[FIRST_PER_M; 3], &[vec![0, 1], vec![2]]).unwrap();
        config.second = Some(SecondEncoders {
            counts_per_m: [-SECOND_PER_M; CABLES],
            step_counts: 10.0,
            slip_m: SLIP_M,
            slip_share: 0.05,
            idler_m: 0.0,
        });
        Slips::new(&config)
    }

    /// Turns both encoders of a cable by these distances in steps of 4 mm; the faults that are found.
    fn turn(slips: &mut Slips, first_m: f64, second_m: f64, second: u8) -> (Faults, bool) {
        let steps = (first_m.abs().max(second_m.abs()) / 0.004).ceil();
        let (mut found, mut doubtful) = (Faults::default(), false);
        let mut input = MotorInput::default();
        for step in 0..=steps as i64 {
            let share = step as f64 / steps;
            input.counts[0] = (share * first_m * FIRST_PER_M).round() as i64;
            input.second_counts[0] = (-share * second_m * SECOND_PER_M).round() as i64;
            input.second = [MotorInput::SECOND_CONTINUED; CABLES];
            // The first reading continues nothing of an earlier call.
            input.second[0] = if step == 0 { MotorInput::SECOND_RESTARTED } else { second };
            let compared = Compared {
                input: &input,
                fresh: &[true; CABLES],
                restarted: &[false; CABLES],
                length_m: &[5.0; CABLES],
                counts: true,
            };
            doubtful |= slips.observe(&compared, &mut found);
        }
        (found, doubtful)
    }

    #[test]
    fn errors_in_proportion_are_no_slip_and_slips_add_up() {
        let mut slips = slips(false);
        for _ in 0..50 {
            assert!(turn(&mut slips, 2.0, 2.09, MotorInput::SECOND_CONTINUED).0.is_empty());
            assert!(turn(&mut slips, -2.0, -1.91, MotorInput::SECOND_CONTINUED).0.is_empty());
        }
        // Twice a centimetre.
        assert!(turn(&mut slips, 0.0, 0.0125, MotorInput::SECOND_CONTINUED).0.is_empty());
        let (found, _) = turn(&mut slips, 0.0, 0.0125, MotorInput::SECOND_CONTINUED);
        assert_eq!((found.bits, found.cables[0]), (MotorAuthority::FAULT_SLIP, true));
        slips.clear();
        assert!(
            turn(&mut slips, 0.0, 0.0125, MotorInput::SECOND_CONTINUED).0.is_empty(),
            "after a reset it counts from zero"
        );
    }

    /// An idler that sticks while the drum pays out, then both move, and it sticks again.
    #[test]
    fn common_motion_between_the_halves_of_a_slip_does_not_hide_who_turned_further() {
        for common_m in [-0.15, -0.05, 0.0, 0.15] {
            for (first_m, second_m, kept) in
                [(0.0, 0.02, false), (0.0, -0.02, false), (0.02, 0.0, true), (-0.02, 0.0, true)]
            {
                let mut slips = slips(false);
                let mut move_both =
                    |first_m, second_m| turn(&mut slips, first_m, second_m, MotorInput::SECOND_CONTINUED);
                assert!(move_both(0.95 * first_m, 0.95 * second_m).0.is_empty());
                assert!(move_both(common_m, common_m).0.is_empty());
                let (found, doubtful) = move_both(first_m, second_m);
                assert_eq!(found.bits, MotorAuthority::FAULT_SLIP);
                assert_eq!((found.release[0], doubtful), (!kept, !kept), "{common_m} {first_m} {second_m}");
            }
        }
    }

    /// A cable that swings turns the idler by its steps, hour after hour.
    #[test]
    fn swinging_at_rest_does_not_hide_who_turned_further() {
        let mut slips = slips(false);
        assert!(turn(&mut slips, 0.0, 0.019, MotorInput::SECOND_CONTINUED).0.is_empty());
        for _ in 0..500 {
            turn(&mut slips, 1e-4, 0.0, MotorInput::SECOND_CONTINUED);
            turn(&mut slips, -1e-4, 0.0, MotorInput::SECOND_CONTINUED);
        }
        let (found, doubtful) = turn(&mut slips, 0.0, 0.012, MotorInput::SECOND_CONTINUED);
        assert_eq!((found.bits, found.release[0], doubtful), (MotorAuthority::FAULT_SLIP, true, true));
    }

    #[test]
    fn a_slip_is_found_once_and_again_after_as_much_more() {
        let mut slips = slips(false);
        assert!(turn(&mut slips, 0.0, 0.03, MotorInput::SECOND_CONTINUED).1);
        for _ in 0..10 {
            let (found, doubtful) = turn(&mut slips, 0.0, 0.0, MotorInput::SECOND_CONTINUED);
            assert!(found.is_empty() && !doubtful);
        }
        assert!(turn(&mut slips, 0.0, 0.03, MotorInput::SECOND_CONTINUED).1);
    }

    #[test]
    fn readings_that_continue_nothing_are_not_compared() {
        assert!(turn(&mut slips(false), 0.0, 1.0, MotorInput::SECOND_RESTARTED).0.is_empty());
        assert!(turn(&mut slips(false), 0.0, 0.15, MotorInput::SECOND_ABSENT).0.is_empty());
    }

    #[test]
    fn a_step_of_each_encoder_is_no_slip() {
        let most_m = slips(false).comparisons[0].unwrap().most_m;
        assert!((most_m - SLIP_M - 1.0 / FIRST_PER_M - 10.0 / SECOND_PER_M).abs() < 1e-12, "{most_m} m");
    }

    #[test]
    fn a_second_encoder_that_is_not_read_any_more_is_a_fault_and_the_position_stays() {
        for on_drum in [false, true] {
            let mut slips = slips(on_drum);
            for _ in 0..2 {
                let (found, doubtful) = turn(&mut slips, 0.5, 0.0, MotorInput::SECOND_ABSENT);
                assert_eq!((found.bits, found.cables[0]), (MotorAuthority::FAULT_SLIP, true));
                assert_eq!((found.release[0], doubtful), (false, false));
                slips.clear();
            }
        }
    }

    #[test]
    fn only_an_idler_that_turned_further_keeps_the_position() {
        // Drum by the first encoder; motions of idler and drum; released, and doubtful.
        for (on_drum, idler_m, drum_m, released, doubtful) in [
            (false, 0.1, 0.0, false, false),
            (false, 0.0, 0.1, true, true),
            (false, -0.02, -0.1, true, true),
            (true, 0.1, 0.0, false, true),
            (true, 0.0, 0.1, false, true),
        ] {
            let (first_m, second_m) = if on_drum { (drum_m, idler_m) } else { (idler_m, drum_m) };
            let (found, doubted) = turn(&mut slips(on_drum), first_m, second_m, MotorInput::SECOND_CONTINUED);
            assert_eq!(found.bits, MotorAuthority::FAULT_SLIP);
            assert_eq!((found.release[0], doubted), (released, doubtful), "{on_drum} {idler_m} {drum_m}");
        }
    }
}
