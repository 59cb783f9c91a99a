//! A law in a program of its own, in any language, over its standard input and output ([`crate::lockstep`]).
//!
//! `nims sim` waits for each answer. A flying controller waits until a deadline: an answer that comes later is dropped,
//! the cycle has no answer from this controller, and the arbiter judges it as any other. A law that does not keep its
//! deadline therefore never qualifies to be in charge.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use cable_robot::CableVec;

use crate::custom_law::{CableLaw, LawInput};
use crate::lockstep::{ARGUMENT, Hello, Parameters, Question};

/// Time for the first answer, and for all answers in lockstep; a program that computes a law needs a thousandth of it,
/// and one that hangs is given up.
const ANSWER: Duration = Duration::from_secs(20);
/// Answers between two reports of their times.
const REPORT_ANSWERS: usize = 6000;

/// What a law's program did wrong, for the flight that it flies.
pub type Complaint = Arc<Mutex<Option<String>>>;

/// The program and its pipe.
pub struct ProgramLaw {
    command: String,
    child: Child,
    questions: Option<ChildStdin>,
    answers: Receiver<String>,
    parameters: String,
    complaint: Complaint,
    deadline: Option<Duration>,
    /// Questions whose answers came too late, and have not come yet.
    outstanding: usize,
    times: AnswerTimes,
}

/// Times of answers since the last report.
#[derive(Debug, Default)]
struct AnswerTimes {
    taken_s: Vec<f64>,
    late: usize,
}

impl AnswerTimes {
    /// Median, 99 % and most of the answers in time, s.
    fn figures(&mut self) -> Option<[f64; 3]> {
        self.taken_s.sort_by(f64::total_cmp);
        let last = self.taken_s.len().checked_sub(1)?;
        Some([self.taken_s[last / 2], self.taken_s[last * 99 / 100], self.taken_s[last]])
    }

    fn report(&mut self) {
        if let Some(figures) = self.figures() {
            let [median_ms, most_99_ms, most_ms] = figures.map(|time_s| 1e3 * time_s);
            let (late, all) = (self.late, self.taken_s.len() + self.late);
            tracing::info!(
                "the law's program answered in {median_ms:.2} ms (median), {most_99_ms:.2} ms (99 %), {most_ms:.2} ms \
                 (most); {late} of {all} answers were too late"
            );
        }
        self.taken_s.clear();
        self.late = 0;
    }
}

impl ProgramLaw {
    /// Starts the program for a system; with a `deadline`, answers that take longer are dropped.
    ///
    /// # Errors
    /// There is no such program, or it does not answer as one with a law.
    pub fn start(command: &str, system: &Path, cables: usize, deadline: Option<Duration>) -> Result<Self> {
        let mut words = command.split_whitespace();
        let program = words.next().context("--program is empty; give the command of a law's program")?;
        let mut child = Command::new(program)
            .args(words)
            .args([ARGUMENT, "--system"])
            .arg(system)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("the law's program {program} does not start"))?;
        let (questions, answers) = (child.stdin.take(), child.stdout.take());
        // One answer, and one line too many: a program that prints without end waits.
        let (send, receive) = sync_channel(2);
        let mut law = Self {
            command: command.to_owned(),
            child,
            questions,
            answers: receive,
            parameters: String::new(),
            complaint: Complaint::default(),
            deadline: None,
            outstanding: 0,
            times: AnswerTimes::default(),
        };
        let output = answers.context("the law's program has no output")?;
        std::thread::spawn(move || {
            let lines = BufReader::new(output).lines().map_while(Result::ok);
            // Ends with the program, or when the flight does not listen any more.
            for line in lines {
                if send.send(line).is_err() {
                    return;
                }
            }
        });
        let hello = Hello { system: std::path::absolute(system)?, cables };
        let answer = law.ask(&hello)?.context("the first answer has no deadline")?;
        law.parameters = serde_json::from_str::<Parameters>(&answer)
            .with_context(|| format!("{command} does not answer as a law's program; see scripts/templates/law"))?
            .parameters;
        law.deadline = deadline;
        Ok(law)
    }

    /// Where the law says what its program did wrong.
    pub fn complaint(&self) -> Complaint {
        Arc::clone(&self.complaint)
    }

    /// Takes the answers that came too late; false while one is still missing.
    fn catch_up(&mut self) -> Result<bool> {
        let command = &self.command;
        while self.outstanding > 0 {
            match self.answers.try_recv() {
                Ok(_) => self.outstanding -= 1,
                Err(TryRecvError::Empty) => return Ok(false),
                Err(TryRecvError::Disconnected) => bail!("the law's program {command} has ended; run it by hand"),
            }
        }
        // Each later answer would be taken for that of the question before.
        if let Ok(line) = self.answers.try_recv() {
            bail!("the law's program {command} answered {line} without a question; print to stderr what is no answer");
        }
        Ok(true)
    }

    /// Returns the answer; `None`: it has not come by the deadline.
    fn ask(&mut self, question: &impl serde::Serialize) -> Result<Option<String>> {
        if !self.catch_up()? {
            self.times.late += 1;
            return Ok(None);
        }
        let command = &self.command;
        let begun = Instant::now();
        let questions = self.questions.as_mut().context("the law's program has no input")?;
        let mut line = serde_json::to_vec(question)?;
        line.push(b'\n');
        let sent = questions.write_all(&line).and_then(|()| questions.flush());
        match self.answers.recv_timeout(self.deadline.unwrap_or(ANSWER)) {
            Ok(answer) if sent.is_ok() => {
                self.times.taken_s.push(begun.elapsed().as_secs_f64());
                Ok(Some(answer))
            }
            Ok(_) | Err(RecvTimeoutError::Disconnected) => {
                bail!("the law's program {command} has ended; run it by hand to see why")
            }
            Err(_) if self.deadline.is_some() => {
                (self.outstanding, self.times.late) = (self.outstanding + 1, self.times.late + 1);
                Ok(None)
            }
            Err(_) => bail!("the law's program {command} has not answered within {} s", ANSWER.as_secs()),
        }
    }

    fn velocities(&mut self, input: &LawInput<'_>) -> Result<Option<CableVec>> {
        let Some(answer) = self.ask(&Question::from(input))? else { return Ok(None) };
        let values: Option<Vec<f64>> = serde_json::from_str(&answer).with_context(|| {
            format!("the law's program {} answers {answer}; accepted: a list of velocities, or null", self.command)
        })?;
        if self.deadline.is_some() && self.times.taken_s.len() >= REPORT_ANSWERS {
            self.times.report();
        }
        let Some(values) = values else { return Ok(None) };
        let (got, cables) = (values.len(), input.robot.cable_count());
        ensure!(got == cables, "the law's program {} answers {got} velocities for {cables} cables", self.command);
        Ok(Some(CableVec::from_slice(&values)?))
    }
}

impl CableLaw for ProgramLaw {
    fn velocity(&mut self, input: &LawInput<'_>) -> Option<CableVec> {
        self.velocities(input).unwrap_or_else(|error| {
            if let Ok(mut complaint) = self.complaint.lock() {
                complaint.get_or_insert_with(|| format!("{error:#}"));
            }
            None
        })
    }

    fn parameters(&self) -> String {
        let command = serde_json::Value::from(self.command.as_str());
        if self.deadline.is_some() {
            format!("program = {command}\n{}", self.parameters)
        } else {
            self.parameters.clone()
        }
    }
}

impl Drop for ProgramLaw {
    /// Ends the program, also one that hangs.
    fn drop(&mut self) {
        if self.deadline.is_some() {
            self.times.report();
        }
        drop(self.questions.take());
        // It has nothing to lose: a law keeps no files.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
