//! A law in a program of its own, over its standard input and output.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use cable_robot::CableVec;
use controller::lockstep::{ARGUMENT, Hello, Parameters, Question};
use controller::{CableLaw, LawInput};

/// Time for an answer; a program that computes a law needs a thousandth of it, and one that hangs is given up.
const ANSWER: Duration = Duration::from_secs(20);

/// What a law's program did wrong, for the flight that it flies.
pub(crate) type Complaint = Arc<Mutex<Option<String>>>;

/// The program and its pipe.
pub(crate) struct ProgramLaw {
    command: String,
    child: Child,
    questions: Option<ChildStdin>,
    answers: Receiver<String>,
    parameters: String,
    complaint: Complaint,
}

impl ProgramLaw {
    /// Starts the program for a system.
    ///
    /// # Errors
    /// There is no such program, or it does not answer as one with a law.
    pub fn start(command: &str, system: &Path, cables: usize) -> Result<Self> {
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
        law.parameters = serde_json::from_str::<Parameters>(&law.ask(&hello)?)
            .with_context(|| format!("{command} does not answer as a law's program; see scripts/templates/law"))?
            .parameters;
        Ok(law)
    }

    /// Where the law says what its program did wrong.
    pub fn complaint(&self) -> Complaint {
        Arc::clone(&self.complaint)
    }

    fn ask(&mut self, question: &impl serde::Serialize) -> Result<String> {
        let command = &self.command;
        // Each later answer would be taken for that of the question before.
        if let Ok(line) = self.answers.try_recv() {
            bail!("the law's program {command} answered {line} without a question; print to stderr what is no answer");
        }
        let questions = self.questions.as_mut().context("the law's program has no input")?;
        let mut line = serde_json::to_vec(question)?;
        line.push(b'\n');
        let sent = questions.write_all(&line).and_then(|()| questions.flush());
        match self.answers.recv_timeout(ANSWER) {
            Ok(answer) if sent.is_ok() => Ok(answer),
            Ok(_) | Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => {
                bail!("the law's program {command} has ended; run it by hand to see why")
            }
            Err(_) => bail!("the law's program {command} has not answered within {} s", ANSWER.as_secs()),
        }
    }

    fn velocities(&mut self, input: &LawInput<'_>) -> Result<Option<CableVec>> {
        let answer = self.ask(&Question::from(input))?;
        let values: Option<Vec<f64>> = serde_json::from_str(&answer).with_context(|| {
            format!("the law's program {} answers {answer}; accepted: a list of velocities, or null", self.command)
        })?;
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
        self.parameters.clone()
    }
}

impl Drop for ProgramLaw {
    /// Ends the program, also one that hangs.
    fn drop(&mut self) {
        drop(self.questions.take());
        // It has nothing to lose: a law keeps no files.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
