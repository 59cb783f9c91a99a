//! A law in a program of its own, in any language, over its standard input and output ([`crate::lockstep`]).
//!
//! `nims sim` waits for each answer. A flying controller waits until a deadline: an answer that comes later is dropped,
//! the cycle has no answer from this controller, and the arbiter judges it as any other. A law that does not keep its
//! deadline therefore never qualifies to be in charge, and one that does not answer at all is given up ([`Waits`]).

use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use cable_robot::CableVec;
use rustix::fs::OFlags;
use thiserror::Error;

use crate::custom_law::{CableLaw, LawInput};
use crate::lockstep::{ARGUMENT, Hello, Parameters, Question};

/// Answers between two reports of their times.
const REPORT_ANSWERS: usize = 6000;
/// Longest line of an answer: the parameters of a law are a few lines, the velocities of eight cables far less.
const LONGEST_LINE_BYTES: usize = 65_536;
/// Characters of a wrong answer that are shown.
const SHOWN_CHARACTERS: usize = 200;

/// How long answers are waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Waits {
    /// Wait after which the program is given up, also for its first answer.
    pub longest: Duration,
    /// In flight, the wait after which an answer is dropped; `None`: each answer is waited for.
    pub deadline: Option<Duration>,
}

impl Waits {
    /// For flights in lockstep: a program that computes a law needs a thousandth of it.
    #[must_use]
    pub fn in_lockstep() -> Self {
        Self { longest: Duration::from_secs(20), deadline: None }
    }

    /// For a flying robot: half of the time that the supervisor waits until a controller is ready.
    #[must_use]
    pub fn in_flight(deadline: Duration) -> Self {
        Self { longest: Duration::from_secs(10), deadline: Some(deadline) }
    }
}

/// Why the program of a law does not start.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum StartError {
    /// The command, or its first answer, is not that of a law's program.
    #[error("{0}")]
    NoLaw(String),
    /// It fails, or does not answer in time.
    #[error("{0}")]
    Fails(String),
}

/// What a law's program did wrong, for the flight that it flies.
pub type Complaint = Arc<Mutex<Option<String>>>;

/// The program and its pipe.
pub struct ProgramLaw {
    command: String,
    child: Child,
    questions: Option<ChildStdin>,
    answers: Receiver<Line>,
    parameters: String,
    complaint: Complaint,
    /// It is not asked again after its complaint: a program that does not read would block the next question.
    has_failed: bool,
    waits: Waits,
    /// When the question was asked whose answer came too late, and has not come yet.
    unanswered_since: Option<Instant>,
    has_been_late: bool,
    times: AnswerTimes,
}

/// A line of the program; an error says why there are no more lines.
type Line = Result<String, String>;

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
    /// Starts the program for a system.
    ///
    /// # Errors
    /// There is no such program, it fails, or it does not answer as one with a law.
    pub fn start(command: &str, system: &Path, cables: usize, waits: Waits) -> Result<Self, StartError> {
        let fails = |error: anyhow::Error| StartError::Fails(format!("{error:#}"));
        let mut child = spawn(command, system, waits.deadline.is_some())?;
        let (questions, output) = (child.stdin.take(), child.stdout.take());
        // A program that does not read its questions must not block the one that asks: the pipe holds many of them.
        if let Some(questions) = &questions {
            rustix::fs::fcntl_setfl(questions, OFlags::NONBLOCK).map_err(|error| fails(error.into()))?;
        }
        // One answer, and one line too many: a program that prints without end waits.
        let (send, answers) = sync_channel(2);
        let mut law = Self {
            command: command.to_owned(),
            child,
            questions,
            answers,
            parameters: String::new(),
            complaint: Complaint::default(),
            has_failed: false,
            waits: Waits { deadline: None, ..waits },
            unanswered_since: None,
            has_been_late: false,
            times: AnswerTimes::default(),
        };
        let output = output.context("the law's program has no output").map_err(fails)?;
        std::thread::spawn(move || read_lines(BufReader::new(output), &send));
        let system = std::path::absolute(system).map_err(|error| fails(error.into()))?;
        let answer = law.ask(&Hello { system, cables }).map_err(fails)?;
        let answer = answer.context("the first answer has no deadline").map_err(fails)?;
        law.parameters = serde_json::from_str::<Parameters>(&answer)
            .map_err(|error| {
                StartError::NoLaw(format!(
                    "{command} does not answer as a law's program; see scripts/templates/law: {error}"
                ))
            })?
            .parameters;
        law.waits = waits;
        Ok(law)
    }

    /// Where the law says what its program did wrong.
    pub fn complaint(&self) -> Complaint {
        Arc::clone(&self.complaint)
    }

    /// Takes the answer that came too late; false while it is still missing.
    fn catch_up(&mut self) -> Result<bool> {
        let command = &self.command;
        if let Some(since) = self.unanswered_since {
            match self.answers.try_recv() {
                Ok(Ok(_)) => self.unanswered_since = None,
                Ok(Err(why)) => bail!("the law's program {command} {why}"),
                Err(TryRecvError::Empty) if since.elapsed() > self.waits.longest => bail!(self.given_up()),
                Err(TryRecvError::Empty) => return Ok(false),
                Err(TryRecvError::Disconnected) => bail!("the law's program {command} has ended; run it by hand"),
            }
        }
        match self.answers.try_recv() {
            // Each later answer would be taken for that of the question before.
            Ok(Ok(line)) => bail!(
                "the law's program {command} answered {} without a question; print to stderr what is no answer",
                shown(&line)
            ),
            Ok(Err(why)) => bail!("the law's program {command} {why}"),
            Err(_) => Ok(true),
        }
    }

    fn given_up(&self) -> String {
        let (command, longest_s) = (&self.command, self.waits.longest.as_secs_f64());
        format!("the law's program {command} has not answered within {longest_s} s and is given up; run it by hand")
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
        if sent.as_ref().is_err_and(|error| error.kind() == ErrorKind::WouldBlock) {
            bail!("the law's program {command} does not read its questions; read one line before each answer");
        }
        match self.answers.recv_timeout(self.waits.deadline.unwrap_or(self.waits.longest)) {
            Ok(Ok(answer)) if sent.is_ok() => {
                self.times.taken_s.push(begun.elapsed().as_secs_f64());
                Ok(Some(answer))
            }
            Ok(Err(why)) => bail!("the law's program {command} {why}"),
            Ok(_) | Err(RecvTimeoutError::Disconnected) => {
                bail!("the law's program {command} has ended; run it by hand to see why")
            }
            Err(RecvTimeoutError::Timeout) => match self.waits.deadline {
                Some(deadline) => {
                    self.is_late(begun, deadline);
                    Ok(None)
                }
                None => bail!(self.given_up()),
            },
        }
    }

    fn is_late(&mut self, asked: Instant, deadline: Duration) {
        self.unanswered_since = Some(asked);
        self.times.late += 1;
        if !std::mem::replace(&mut self.has_been_late, true) {
            tracing::warn!(
                "the law's program {} has missed its deadline of {:.1} ms: the cycle has no answer from it; later ones \
                 are counted",
                self.command,
                1e3 * deadline.as_secs_f64()
            );
        }
    }

    fn velocities(&mut self, input: &LawInput<'_>) -> Result<Option<CableVec>> {
        let Some(answer) = self.ask(&Question::from(input))? else { return Ok(None) };
        let values: Option<Vec<f64>> = serde_json::from_str(&answer).with_context(|| {
            let answer = shown(&answer);
            format!("the law's program {} answers {answer}; accepted: a list of velocities, or null", self.command)
        })?;
        if self.waits.deadline.is_some() && self.times.taken_s.len() >= REPORT_ANSWERS {
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
        if self.has_failed {
            return None;
        }
        self.velocities(input).unwrap_or_else(|error| {
            self.has_failed = true;
            if let Ok(mut complaint) = self.complaint.lock() {
                complaint.get_or_insert_with(|| format!("{error:#}"));
            }
            None
        })
    }

    fn parameters(&self) -> String {
        let command = serde_json::Value::from(self.command.as_str());
        if self.waits.deadline.is_some() {
            format!("program = {command}\n{}", self.parameters)
        } else {
            self.parameters.clone()
        }
    }
}

impl Drop for ProgramLaw {
    /// Ends the program, also one that hangs.
    fn drop(&mut self) {
        if self.waits.deadline.is_some() {
            self.times.report();
        }
        drop(self.questions.take());
        // It has nothing to lose: a law keeps no files.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Starts the program of a command.
fn spawn(command: &str, system: &Path, in_flight: bool) -> Result<Child, StartError> {
    let mut words = command.split_whitespace();
    let Some(program) = words.next() else {
        return Err(StartError::NoLaw("--program is empty; give the command of a law's program".to_owned()));
    };
    let mut start = Command::new(program);
    start.args(words).args([ARGUMENT, "--system"]).arg(system).stdin(Stdio::piped()).stdout(Stdio::piped());
    let child = if in_flight { ordinary(start) } else { start.spawn() };
    child.map_err(|error| {
        let why = format!("the law's program {program} does not start: {error}");
        match error.kind() {
            ErrorKind::NotFound | ErrorKind::PermissionDenied => StartError::NoLaw(why),
            _ => StartError::Fails(why),
        }
    })
}

/// Starts a program with ordinary scheduling: from the control thread it would inherit priority and processor, and a
/// law that computes without end would take them from motor-io.
fn ordinary(mut command: Command) -> io::Result<Child> {
    let start = move || {
        runtime::realtime::ordinary();
        command.spawn()
    };
    std::thread::spawn(start).join().unwrap_or_else(|_| Err(io::Error::other("its thread has ended")))
}

/// Sends each line; ends with the program, after a line that is too long, or when the flight does not listen any more.
fn read_lines(mut output: BufReader<ChildStdout>, send: &SyncSender<Line>) {
    loop {
        let mut line = Vec::new();
        let most = LONGEST_LINE_BYTES as u64 + 1;
        if !output.by_ref().take(most).read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
            return;
        }
        let is_whole = line.pop_if(|byte| *byte == b'\n').is_some();
        if line.len() > LONGEST_LINE_BYTES {
            let _ =
                send.send(Err(format!("prints a line of more than {LONGEST_LINE_BYTES} bytes; answer in one line")));
            return;
        }
        // The rest of a program that has ended is no answer.
        if !is_whole || send.send(Ok(String::from_utf8_lossy(&line).into_owned())).is_err() {
            return;
        }
    }
}

/// The beginning of an answer.
fn shown(answer: &str) -> &str {
    answer.char_indices().nth(SHOWN_CHARACTERS).map_or(answer, |(end, _)| &answer[..end])
}
