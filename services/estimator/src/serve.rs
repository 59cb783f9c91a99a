//! The other side of the pipe: a custom method that answers `nims sim` in the program that also flies.

use std::io::{BufRead, Write};

use anyhow::ensure;
use config::SystemFile;
use messages::CABLES;
use program_pipe::{Hello, Parameters, say};

use crate::cable_estimator::{CableEstimator, CableSample, Instant};
use crate::cables::Cables;
use crate::method::Method;
use crate::program::{Answer, Question};
use crate::readings::Readings;

/// Answers over these streams until the other side closes them. Each cable gets a copy of `cable`.
///
/// # Errors
/// A line that is none of this protocol, a system file that is not accepted, or a stream that fails.
pub fn serve(
    mut cable: Box<dyn CableEstimator>,
    questions: impl BufRead,
    mut answers: impl Write,
) -> anyhow::Result<()> {
    let mut lines = questions.lines();
    let Some(hello) = lines.next() else { return Ok(()) };
    let Hello { system, cables: count } = serde_json::from_str(&hello?)?;
    ensure!(count <= CABLES, "the system has {count} cables; accepted: at most {CABLES}");
    cable.retune(Method::custom(&SystemFile::load(&system)?.estimator).parameters());
    say(&mut answers, &Parameters { parameters: cable.constants() })?;
    let (mut cables, mut readings) = (Cables::each(Some(cable), count), Readings::default());
    for line in lines {
        let question: Question = serde_json::from_str(&line?)?;
        if question.forget {
            readings.forget();
            cables.forget();
        }
        if question.expect_anything {
            cables.expect_anything();
        }
        let of_cables = question.lengths_m.iter().zip(&question.sampled_ns).zip(&question.commands_m_s);
        let samples: Vec<CableSample> = of_cables
            .map(|((length_m, sampled_ns), command_m_s)| CableSample {
                cycle: question.cycle,
                length_m: *length_m,
                sampled_ns: *sampled_ns,
                command_m_s: *command_m_s,
            })
            .collect();
        let instant = Instant { cycle: question.cycle, time_ns: question.instant_ns };
        let measured = cables.measure(&mut readings, &samples, &instant);
        let answer: Vec<Option<Answer>> = measured.iter().take(count).map(|at| at.and_then(Answer::of)).collect();
        say(&mut answers, &answer)?;
    }
    Ok(())
}
