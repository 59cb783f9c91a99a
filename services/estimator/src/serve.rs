//! The other side of the pipe: a custom method that answers `nims sim` in the program that also flies.

use std::io::{BufRead, Write};

use anyhow::ensure;
use config::SystemFile;
use messages::CABLES;
use program_pipe::{Hello, Parameters};

use crate::cable_estimator::{CableEstimator, CableSample, Instant};
use crate::cables::Cables;
use crate::method::Method;
use crate::program::{Answer, Question};
use crate::readings::Readings;

/// Answers over these streams until the other side closes them. Each cable gets a copy of `cable`.
///
/// # Errors
/// A line that is none of this protocol, a system file that is not accepted, or a stream that fails.
pub fn serve(cable: Box<dyn CableEstimator>, questions: impl BufRead, answers: impl Write) -> anyhow::Result<()> {
    program_pipe::serve(questions, answers, |hello| Served::begin(cable, &hello), Served::answer)
}

/// The cables of the system.
struct Served {
    count: usize,
    /// Period of the control cycles in the system file, s.
    period_s: f64,
    cables: Cables,
    readings: Readings,
}

impl Served {
    fn begin(mut cable: Box<dyn CableEstimator>, hello: &Hello) -> anyhow::Result<(Self, Parameters)> {
        let count = hello.cables;
        ensure!(count <= CABLES, "the system has {count} cables; accepted: at most {CABLES}");
        let system = SystemFile::load(&hello.system)?;
        cable.retune(Method::custom(&system.estimator).parameters());
        let parameters = Parameters { parameters: cable.constants() };
        let cables = Cables::each(Some(cable), count);
        Ok((Self { count, period_s: 1.0 / system.rate_hz, cables, readings: Readings::default() }, parameters))
    }

    fn answer(&mut self, question: Question) -> Vec<Option<Answer>> {
        if question.forget {
            self.readings.forget();
            self.cables.forget();
        }
        if question.expect_anything {
            self.cables.expect_anything();
        }
        // A nims before this field does not send it.
        let period_s = if question.period_s > 0.0 { question.period_s } else { self.period_s };
        let of_cables = question.lengths_m.iter().zip(&question.sampled_ns).zip(&question.commands_m_s);
        let samples: Vec<CableSample> = of_cables
            .map(|((length_m, sampled_ns), command_m_s)| CableSample {
                cycle: question.cycle,
                length_m: *length_m,
                sampled_ns: *sampled_ns,
                command_m_s: *command_m_s,
                period_s,
            })
            .collect();
        let instant = Instant { cycle: question.cycle, time_ns: question.instant_ns, period_s };
        let measured = self.cables.measure(&mut self.readings, &samples, &instant);
        measured.iter().take(self.count).map(|at| at.and_then(Answer::of)).collect()
    }
}
