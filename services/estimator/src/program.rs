//! A method of estimation in a program of its own, in any language, for all cables at once.
//!
//! The first lines over the pipe are those of [`program_pipe`]. Then each line is a [`Question`], one per cycle, and
//! the answer an [`Answer`] for each cable.

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

impl From<Measurement> for Answer {
    fn from(measurement: Measurement) -> Self {
        let Measurement { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi, .. } = measurement;
        Self { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi }
    }
}

impl Answer {
    fn measurement(self, sampled_ns: u64) -> Measurement {
        let Self { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi } = self;
        Measurement { length_m, velocity_m_s, steady_velocity_m_s, sigma_m, phi, sampled_ns }
    }
}

/// The newest reading of a cable.
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
        for (newest, sample) in self.newest.iter_mut().zip(samples).filter(|(_, sample)| sample.length_m.is_some()) {
            *newest = Some(Newest { cycle: sample.cycle, sampled_ns: sample.sampled_ns });
        }
        let newest = self.newest.iter().take(samples.len());
        let question = Question {
            cycle: instant.cycle,
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
        let mut measured = [None; CABLES];
        let Ok(mut program) = self.program.lock() else { return measured };
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
