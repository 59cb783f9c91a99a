//! A method of estimation in a program of its own, in any language, for all cables at once.
//!
//! The first lines over the pipe are those of [`program_pipe`]. Then each line is a [`Question`], one per cycle, and
//! the answer an [`Answer`] for each cable. A cycle in which the answer to an earlier question is still missing has no
//! question: the program does not receive its readings.

use std::path::Path;
use std::sync::{Arc, Mutex};

use anyhow::ensure;
use messages::CABLES;
use program_pipe::{Complaint, Program, StartError, Waits};
use serde::{Deserialize, Serialize};

use crate::cable_estimator::{CableSample, Instant, Measurement};
use crate::readings::Measurements;

/// The readings and commands of a cycle, with one entry per cable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// Control cycle. It increases by one from question to question, or by more if samples were lost.
    pub cycle: u64,
    /// Period of the control cycle, s; 0 if it is unknown.
    #[serde(default)]
    pub period_s: f64,
    /// The instant that is asked for, ns on the monotonic clock.
    pub instant_ns: u64,
    /// Unstretched lengths from the encoders, m; `None` where this cycle has no reading.
    pub lengths_m: Vec<Option<f64>>,
    /// Times of the readings, ns on the same clock; meaningless without a reading.
    pub sampled_ns: Vec<u64>,
    /// Time from the newest reading to the instant, s; `None` before the first reading.
    pub ahead_s: Vec<Option<f64>>,
    /// Velocities commanded at the start of this cycle, m/s.
    pub commands_m_s: Vec<f64>,
    /// All earlier readings are invalid.
    pub forget: bool,
    /// The operator may have set the lengths: readings that do not fit are correct.
    pub expect_anything: bool,
}

/// One cable at the instant; see [`Measurement`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Unstretched length, m.
    pub length_m: f64,
    /// Velocity dL/dt during this cycle, m/s.
    pub velocity_m_s: f64,
    /// Velocity for that of the node, m/s; without it, motor-io's mean over 50 ms.
    #[serde(default)]
    pub steady_velocity_m_s: Option<f64>,
    /// Standard deviation of the length in addition to that of a reading, m.
    #[serde(default)]
    pub sigma_m: f64,
    /// Motor model (18).
    #[serde(default)]
    pub phi: [f64; 2],
}

impl Answer {
    /// `None` where a number is not finite: JSON has no such numbers.
    pub(crate) fn of(measurement: Measurement) -> Option<Self> {
        let Measurement { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi, .. } = measurement;
        let steady = steady_velocity_m_s.unwrap_or(0.0);
        let finite = [length_m, velocity_m_s, steady, sigma_m, phi[0], phi[1]].iter().all(|number| number.is_finite());
        finite.then_some(Self { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi })
    }

    fn measurement(self, sampled_ns: u64) -> Measurement {
        let Self { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi } = self;
        Measurement { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi, sampled_ns }
    }
}

/// The newest reading of a cable that the program received.
#[derive(Debug, Clone, Copy)]
struct Newest {
    cycle: u64,
    sampled_ns: u64,
}

/// The method of a program. A copy asks the same program.
#[derive(Clone)]
pub struct ProgramEstimator {
    program: Arc<Mutex<Program>>,
    newest: [Option<Newest>; CABLES],
    forget: bool,
    expect_anything: bool,
}

impl ProgramEstimator {
    /// Starts the program for a system.
    ///
    /// # Errors
    /// There is no such program, it fails, or it does not answer as one of an estimator.
    pub fn start(command: &str, system: &Path, cables: usize, waits: Waits) -> Result<Self, StartError> {
        let program = Arc::new(Mutex::new(Program::start("estimator", command, system, cables, waits)?));
        Ok(Self { program, newest: [None; CABLES], forget: false, expect_anything: false })
    }

    /// Where the program says what it did wrong.
    pub fn complaint(&self) -> Complaint {
        self.program.lock().map(|program| program.complaint()).unwrap_or_default()
    }

    pub(crate) fn parameters(&self) -> String {
        self.program.lock().map(|program| program.parameters()).unwrap_or_default()
    }

    pub(crate) fn forget(&mut self) {
        (self.newest, self.forget) = ([None; CABLES], true);
    }

    pub(crate) fn expect_anything(&mut self) {
        self.expect_anything = true;
    }

    /// Asks for the cables at an instant.
    pub(crate) fn at(&mut self, samples: &[CableSample], instant: &Instant) -> Measurements {
        let mut measured = [None; CABLES];
        let Ok(mut program) = self.program.lock() else { return measured };
        let Some(program) = program.ready() else { return measured };
        for (newest, sample) in self.newest.iter_mut().zip(samples).filter(|(_, sample)| sample.length_m.is_some()) {
            *newest = Some(Newest { cycle: sample.cycle, sampled_ns: sample.sampled_ns });
        }
        let newest = self.newest.iter().take(samples.len());
        let question = Question {
            cycle: instant.cycle,
            period_s: instant.period_s,
            instant_ns: instant.time_ns,
            lengths_m: samples.iter().map(|sample| sample.length_m).collect(),
            sampled_ns: samples.iter().map(|sample| sample.sampled_ns).collect(),
            ahead_s: newest
                .map(|newest| newest.map(|newest| instant.ahead_of_s(newest.sampled_ns, newest.cycle)))
                .collect(),
            commands_m_s: samples.iter().map(|sample| sample.command_m_s).collect(),
            forget: std::mem::take(&mut self.forget),
            expect_anything: std::mem::take(&mut self.expect_anything),
        };
        let accepted = "a list of an object or null for each cable, or null";
        let answer = program.answer(&question, accepted, |answers: Vec<Option<Answer>>| {
            let (got, cables) = (answers.len(), samples.len());
            ensure!(got == cables, "these are {got} for {cables} cables");
            Ok(answers)
        });
        for ((measured, answer), newest) in measured.iter_mut().zip(answer.into_iter().flatten()).zip(&self.newest) {
            *measured = answer.zip(*newest).map(|(answer, newest)| answer.measurement(newest.sampled_ns));
        }
        measured
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::path::PathBuf;
    use std::time::Duration;

    /// A program that answers each question of cycle N after `answer` with a length of N m for three cables, and N +
    /// 0.5 m where it is to forget.
    fn estimator(folder: &Path, answer: &str) -> ProgramEstimator {
        let path = folder.join("estimator.sh");
        let text = format!(
            r#"read hello
echo '{{}}'
while read question; do
    cycle=${{question#*'"cycle":'}}
    cycle=${{cycle%%,*}}
    length=$cycle.0
    case $question in *'"forget":true'*) length=$cycle.5 ;; esac
    {answer}
    one="{{\"length_m\":$length,\"velocity_m_s\":0.0}}"
    echo "[$one,$one,null]"
done
"#
        );
        std::fs::write(&path, text).unwrap();
        let system = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems/demo3.toml");
        // The machine may stand still for less than the deadline.
        let (longest, deadline) = (Duration::from_secs(60), Some(Duration::from_secs(3)));
        let waits = Waits { longest, deadline, measured: 0 };
        ProgramEstimator::start(&format!("sh {}", path.display()), &system, 3, waits).unwrap()
    }

    fn sample(cycle: u64) -> [CableSample; 3] {
        [CableSample { cycle, length_m: Some(1.0), sampled_ns: cycle * 10_000_000, command_m_s: 0.0, period_s: 0.01 };
            3]
    }

    fn ask(estimator: &mut ProgramEstimator, cycle: u64) -> Option<Measurement> {
        let instant = Instant { cycle, time_ns: cycle * 10_000_000 + 1_000_000, period_s: 0.01 };
        let measured = estimator.at(&sample(cycle), &instant);
        assert!(measured[2].is_none(), "the program has no estimate of the third cable");
        measured[0]
    }

    #[test]
    fn what_is_to_be_forgotten_is_said_with_the_first_question_after_a_late_answer() {
        let folder = tempfile::tempdir().unwrap();
        let gate = folder.path().join("gate");
        let wait = format!("if [ $cycle = 2 ]; then while [ ! -e {} ]; do sleep 0.01; done; fi", gate.display());
        let mut estimator = estimator(folder.path(), &wait);
        assert_eq!(ask(&mut estimator, 1).unwrap().length_m, 1.0);
        assert!(ask(&mut estimator, 2).is_none(), "its answer is late");
        estimator.forget();
        assert!(ask(&mut estimator, 3).is_none(), "it is not asked while an answer is missing");
        std::fs::write(&gate, "").unwrap();
        let (cycle, answer) = (4..2000)
            .find_map(|cycle| {
                std::thread::sleep(Duration::from_millis(10));
                ask(&mut estimator, cycle).map(|answer| (cycle, answer))
            })
            .unwrap();
        assert_eq!(answer.length_m, cycle as f64 + 0.5, "it forgets with this question");
        assert_eq!(answer.sampled_ns, cycle * 10_000_000);
        let next = ask(&mut estimator, cycle + 1).unwrap();
        assert_eq!(next.length_m, (cycle + 1) as f64, "and once");
        assert!(estimator.complaint().lock().unwrap().is_none());
    }

    #[test]
    fn a_number_that_is_not_finite_is_no_estimate() {
        let good = Answer { length_m: 1.0, velocity_m_s: 0.0, steady_velocity_m_s: None, sigma_m: 0.0, phi: [0.0; 2] };
        let good = good.measurement(1);
        assert!(Answer::of(good).is_some());
        for wrong in [
            Measurement { length_m: f64::NAN, ..good },
            Measurement { steady_velocity_m_s: Some(f64::INFINITY), ..good },
            Measurement { sigma_m: f64::NAN, ..good },
            Measurement { phi: [0.0, f64::NAN], ..good },
        ] {
            assert!(Answer::of(wrong).is_none(), "{wrong:?}");
        }
    }
}
