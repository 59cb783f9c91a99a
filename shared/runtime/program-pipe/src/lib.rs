//! A program in any language that answers questions over its standard input and output: a custom law or estimator.
//!
//! Both sides write lines of JSON. The first line to the program is a [`Hello`], its answer a [`Parameters`]; the
//! further lines are those of the role. Numbers are written so that the same bits are read.
//!
//! `nims sim` waits for each answer. A flying process waits until a deadline: an answer that comes later is dropped,
//! the cycle has no answer, and the arbiter judges it as any other. Answers count only after the program was measured:
//! it has kept its deadline in [`MEASURED_ANSWERS`] answers in a row. So one that does not keep it is never in charge,
//! not even where no other process answers. One that does not answer at all is given up ([`Waits`]).
//!
//! Invariants:
//! * A program that does not read, prints without end, or hangs never blocks the one that asks for longer than its
//!   wait.
//! * The next question is asked only after the answer to the last one, so a late answer is never taken for that of
//!   another question. A program that prints more than its answers fails, at the latest in the next cycle.
#![forbid(unsafe_code)]

mod serve;
mod start;

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use rustix::fs::OFlags;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

pub use serve::{serve, serve_if_asked};
pub use start::{ARGUMENT, StartError};

/// What is flown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// System file, with the robot file that it names.
    pub system: PathBuf,
    /// Number of cables.
    pub cables: usize,
}

/// Parameters of the program, for the run file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// TOML, one `key = value` per text line.
    #[serde(default)]
    pub parameters: String,
}

/// Answers between two reports of their times.
const REPORT_ANSWERS: usize = 6000;
/// Answers in time, in a row, after which the answers of a flying program count: two seconds at 50 Hz.
pub const MEASURED_ANSWERS: u32 = 100;
/// Late answers in a row that a program may have before it is measured again: a hiccup of the machine is shorter, and
/// the arbiter bridges as many. In the long run this is one late answer in 34.
const LATE_ANSWERS: u32 = 3;
/// Longest line of an answer: the parameters are a few lines, the numbers of eight cables far less.
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
    /// Answers in time, in a row, before answers count.
    pub measured: u32,
}

impl Waits {
    /// For flights in lockstep: a program that computes an answer needs a thousandth of it.
    #[must_use]
    pub fn in_lockstep() -> Self {
        Self { longest: Duration::from_secs(20), deadline: None, measured: 0 }
    }

    /// For a flying robot: half of the time that the supervisor waits until a process is ready.
    #[must_use]
    pub fn in_flight(deadline: Duration) -> Self {
        Self { longest: Duration::from_secs(10), deadline: Some(deadline), measured: MEASURED_ANSWERS }
    }
}

/// What a program did wrong, for the flight that it flies.
pub type Complaint = Arc<Mutex<Option<String>>>;

/// Returns the complaint of a program, once.
///
/// # Errors
/// The complaint.
pub fn check(complaint: &Complaint) -> Result<()> {
    let complaint = complaint.lock().ok().and_then(|mut complaint| complaint.take());
    complaint.map_or(Ok(()), |complaint| Err(anyhow::anyhow!(complaint)))
}

/// The program and its pipe.
pub struct Program {
    /// What it is in sentences: `law`, `estimator`.
    role: &'static str,
    command: String,
    child: Child,
    /// The thread that started the program ends with it, and the program with the thread.
    _keeper: SyncSender<()>,
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
    punctuality: Punctuality,
    times: AnswerTimes,
}

/// Whether the program was measured to keep its deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Punctuality {
    /// Not yet: answers in time in a row.
    Measured(u32),
    /// Yes. Each late answer adds [`MEASURED_ANSWERS`], each one in time takes [`LATE_ANSWERS`] away.
    Kept(u32),
}

impl Punctuality {
    fn is_in_time(&mut self, wanted: u32) {
        *self = match *self {
            Self::Measured(count) if count >= wanted => Self::Kept(0),
            Self::Measured(count) => Self::Measured(count + 1),
            Self::Kept(late) => Self::Kept(late.saturating_sub(LATE_ANSWERS)),
        };
    }

    fn is_late(&mut self) {
        *self = match *self {
            Self::Kept(late) if late < LATE_ANSWERS * MEASURED_ANSWERS => Self::Kept(late + MEASURED_ANSWERS),
            Self::Kept(_) | Self::Measured(_) => Self::Measured(0),
        };
    }
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

    fn report(&mut self, role: &str) {
        if let Some(figures) = self.figures() {
            let [median_ms, most_99_ms, most_ms] = figures.map(|time_s| 1e3 * time_s);
            let (late, all) = (self.late, self.taken_s.len() + self.late);
            tracing::info!(
                "the {role}'s program answered in {median_ms:.2} ms (median), {most_99_ms:.2} ms (99 %), {most_ms:.2} ms \
                 (most); {late} of {all} answers were too late"
            );
        }
        self.taken_s.clear();
        self.late = 0;
    }
}

impl Program {
    /// Starts the program of a role for a system.
    ///
    /// # Errors
    /// There is no such program, it fails, or it does not answer as one of that role.
    pub fn start(
        role: &'static str,
        command: &str,
        system: &Path,
        cables: usize,
        waits: Waits,
    ) -> Result<Self, StartError> {
        let fails = |error: anyhow::Error| StartError::Fails(format!("{error:#}"));
        let (mut child, keeper) = start::spawn(role, command, system, waits.deadline.is_some())?;
        let (questions, output) = (child.stdin.take(), child.stdout.take());
        // A program that does not read its questions must not block the one that asks: the pipe holds many of them.
        if let Some(questions) = &questions {
            rustix::fs::fcntl_setfl(questions, OFlags::NONBLOCK).map_err(|error| fails(error.into()))?;
        }
        // One answer, and one line too many: a program that prints without end waits.
        let (send, answers) = sync_channel(2);
        let mut program = Self {
            role,
            command: command.to_owned(),
            child,
            _keeper: keeper,
            questions,
            answers,
            parameters: String::new(),
            complaint: Complaint::default(),
            has_failed: false,
            waits: Waits { deadline: None, ..waits },
            unanswered_since: None,
            has_been_late: false,
            punctuality: Punctuality::Measured(0),
            times: AnswerTimes::default(),
        };
        let output = output.context("the program has no output").map_err(fails)?;
        std::thread::spawn(move || read_lines(BufReader::new(output), &send));
        let system = std::path::absolute(system).map_err(|error| fails(error.into()))?;
        let answer = program.ask(&Hello { system, cables }).map_err(fails)?;
        let answer = answer.context("the first answer has no deadline").map_err(fails)?;
        program.parameters = serde_json::from_str::<Parameters>(&answer)
            .map_err(|error| {
                StartError::NotOne(format!(
                    "{command} does not answer as the {role}'s program; see scripts/templates/{role}: {error}"
                ))
            })?
            .parameters;
        program.waits = waits;
        // The time of the first answer is that of the program's start.
        (program.punctuality, program.times) = (Punctuality::Measured(0), AnswerTimes::default());
        Ok(program)
    }

    /// Returns the parameters for the run file, in flight with the command: TOML, one `key = value` per text line.
    #[must_use]
    pub fn parameters(&self) -> String {
        let command = serde_json::Value::from(self.command.as_str());
        if self.waits.deadline.is_some() {
            format!("program = {command}\n{}", self.parameters)
        } else {
            self.parameters.clone()
        }
    }

    /// Takes the answer that came too late. `None` while it is still missing, which counts as a late answer, and after
    /// a failure: the program cannot be asked in this cycle.
    pub fn ready(&mut self) -> Option<Ready<'_>> {
        self.is_ready().then_some(Ready(self))
    }

    fn is_ready(&mut self) -> bool {
        if self.has_failed {
            return false;
        }
        let ready = self.catch_up().unwrap_or_else(|error| {
            self.fail(&error);
            false
        });
        if !ready && !self.has_failed {
            self.times.late += 1;
            self.measure(false);
        }
        ready
    }

    fn fail(&mut self, error: &anyhow::Error) {
        self.has_failed = true;
        if let Ok(mut complaint) = self.complaint.lock() {
            complaint.get_or_insert_with(|| format!("{error:#}"));
        }
    }

    fn checked<A: DeserializeOwned, T>(
        &mut self,
        question: &impl Serialize,
        accepted: &str,
        check: impl FnOnce(A) -> Result<T>,
    ) -> Result<Option<T>> {
        let Some(answer) = self.ask(question)? else { return Ok(None) };
        let (role, command) = (self.role, &self.command);
        let answers = || format!("the {role}'s program {command} answers {}; accepted: {accepted}", shown(&answer));
        let value: Option<A> = serde_json::from_str(&answer).with_context(answers)?;
        if self.waits.deadline.is_some() && self.times.taken_s.len() >= REPORT_ANSWERS {
            self.times.report(role);
        }
        let value = value.map(check).transpose().with_context(answers)?;
        Ok(value.filter(|_| matches!(self.punctuality, Punctuality::Kept(_))))
    }

    /// Counts an answer in time, or a late one.
    fn measure(&mut self, in_time: bool) {
        let before = self.punctuality;
        if in_time {
            self.punctuality.is_in_time(self.waits.measured);
        } else {
            self.punctuality.is_late();
        }
        let (role, command, measured) = (self.role, &self.command, self.waits.measured);
        match (before, self.punctuality) {
            (Punctuality::Measured(_), Punctuality::Kept(_)) if measured > 0 => tracing::info!(
                "the {role}'s program {command} has kept its deadline in {measured} answers in a row: its answers count"
            ),
            (Punctuality::Kept(_), Punctuality::Measured(_)) => tracing::warn!(
                "the {role}'s program {command} has missed its deadline too often: its answers count again after \
                 {measured} in time in a row"
            ),
            _ => {}
        }
    }

    /// Where the program says what it did wrong.
    pub fn complaint(&self) -> Complaint {
        Arc::clone(&self.complaint)
    }

    /// Takes the answer that came too late; false while it is still missing.
    fn catch_up(&mut self) -> Result<bool> {
        let (role, command) = (self.role, &self.command);
        if let Some(since) = self.unanswered_since {
            match self.answers.try_recv() {
                Ok(Ok(_)) => self.unanswered_since = None,
                Ok(Err(why)) => bail!("the {role}'s program {command} {why}"),
                Err(TryRecvError::Empty) if since.elapsed() > self.waits.longest => bail!(self.given_up()),
                Err(TryRecvError::Empty) => return Ok(false),
                Err(TryRecvError::Disconnected) => bail!("the {role}'s program {command} has ended; run it by hand"),
            }
        }
        match self.answers.try_recv() {
            // Each later answer would be taken for that of the question before.
            Ok(Ok(line)) => bail!(
                "the {role}'s program {command} answered {} without a question; print to stderr what is no answer",
                shown(&line)
            ),
            Ok(Err(why)) => bail!("the {role}'s program {command} {why}"),
            Err(_) => Ok(true),
        }
    }

    fn given_up(&self) -> String {
        let (role, command, longest_s) = (self.role, &self.command, self.waits.longest.as_secs_f64());
        format!("the {role}'s program {command} has not answered within {longest_s} s and is given up; run it by hand")
    }

    /// Returns the answer; `None`: it has not come by the deadline.
    fn ask(&mut self, question: &impl serde::Serialize) -> Result<Option<String>> {
        let (role, command) = (self.role, &self.command);
        let begun = Instant::now();
        let questions = self.questions.as_mut().context("the program has no input")?;
        let mut line = serde_json::to_vec(question)?;
        line.push(b'\n');
        let sent = questions.write_all(&line).and_then(|()| questions.flush());
        if sent.as_ref().is_err_and(|error| error.kind() == ErrorKind::WouldBlock) {
            bail!("the {role}'s program {command} does not read its questions; read one line before each answer");
        }
        match self.answers.recv_timeout(self.waits.deadline.unwrap_or(self.waits.longest)) {
            Ok(Ok(answer)) if sent.is_ok() => {
                let taken = begun.elapsed();
                // A thread that slept longer than its wait finds an answer that is too late.
                if let Some(deadline) = self.waits.deadline.filter(|deadline| taken > *deadline) {
                    self.is_late(deadline);
                    return Ok(None);
                }
                self.times.taken_s.push(taken.as_secs_f64());
                self.measure(true);
                Ok(Some(answer))
            }
            Ok(Err(why)) => bail!("the {role}'s program {command} {why}"),
            Ok(_) | Err(RecvTimeoutError::Disconnected) => {
                bail!("the {role}'s program {command} has ended; run it by hand to see why")
            }
            Err(RecvTimeoutError::Timeout) => match self.waits.deadline {
                Some(deadline) => {
                    self.unanswered_since = Some(begun);
                    self.is_late(deadline);
                    Ok(None)
                }
                None => bail!(self.given_up()),
            },
        }
    }

    fn is_late(&mut self, deadline: Duration) {
        self.times.late += 1;
        self.measure(false);
        if !std::mem::replace(&mut self.has_been_late, true) {
            tracing::warn!(
                "the {}'s program {} has missed its deadline of {:.1} ms: the cycle has no answer from it; later ones \
                 are counted",
                self.role,
                self.command,
                1e3 * deadline.as_secs_f64()
            );
        }
    }
}

/// A program that can be asked in this cycle.
pub struct Ready<'a>(&'a mut Program);

impl Ready<'_> {
    /// Asks, and returns what `check` makes of the answer. `None`: no answer in time, or `null`, or the program has
    /// failed, which is its complaint.
    pub fn answer<A: DeserializeOwned, T>(
        self,
        question: &impl Serialize,
        accepted: &str,
        check: impl FnOnce(A) -> Result<T>,
    ) -> Option<T> {
        let Self(program) = self;
        program.checked(question, accepted, check).unwrap_or_else(|error| {
            program.fail(&error);
            None
        })
    }
}

impl Drop for Program {
    /// Ends the program, also one that hangs.
    fn drop(&mut self) {
        if self.waits.deadline.is_some() {
            self.times.report(self.role);
        }
        drop(self.questions.take());
        // It has nothing to lose: a law or an estimator keeps no files.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_counts_after_enough_answers_in_a_row_and_until_it_is_late_too_often() {
        let mut one = Punctuality::Measured(0);
        let kept = |one: &Punctuality| matches!(one, Punctuality::Kept(_));
        for _ in 0..9 {
            one.is_in_time(10);
        }
        one.is_late();
        for _ in 0..10 {
            one.is_in_time(10);
            assert!(!kept(&one), "{one:?}");
        }
        one.is_in_time(10);
        assert!(kept(&one), "{one:?}");
        // One late in fifty is tolerated forever.
        for answer in 1..=10_049 {
            if answer % 50 == 0 {
                one.is_late()
            } else {
                one.is_in_time(10)
            }
            assert!(kept(&one), "answer {answer}: {one:?}");
        }
        for late in 1..=LATE_ANSWERS + 1 {
            assert!(kept(&one), "{late}");
            one.is_late();
        }
        assert_eq!(one, Punctuality::Measured(0));
    }

    #[test]
    fn in_lockstep_the_first_answer_counts() {
        let mut one = Punctuality::Measured(0);
        one.is_in_time(Waits::in_lockstep().measured);
        assert_eq!(one, Punctuality::Kept(0));
    }
}
