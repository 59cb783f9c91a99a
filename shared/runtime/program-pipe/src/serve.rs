//! The other side of the pipe: a program in Rust that answers.

use std::io::{self, BufRead, StdinLock, StdoutLock, Write};
use std::process::ExitCode;

use anyhow::Result;
use serde::{Serialize, de::DeserializeOwned};

use crate::start::ARGUMENT;
use crate::{Hello, Parameters};

/// Writes a line of a program: its answer.
fn say(answers: &mut impl Write, value: &impl Serialize) -> io::Result<()> {
    serde_json::to_writer(&mut *answers, value)?;
    answers.write_all(b"\n")?;
    answers.flush()
}

/// Answers over these streams until the other side closes them: `begin` reads what is flown, `answer` answers each
/// question.
///
/// # Errors
/// A line that is none of this protocol, what `begin` refuses, or a stream that fails.
pub fn serve<S, Q: DeserializeOwned, A: Serialize>(
    questions: impl BufRead,
    mut answers: impl Write,
    begin: impl FnOnce(Hello) -> Result<(S, Parameters)>,
    mut answer: impl FnMut(&mut S, Q) -> A,
) -> Result<()> {
    let mut lines = questions.lines();
    let Some(hello) = lines.next() else { return Ok(()) };
    let (mut state, parameters) = begin(serde_json::from_str(&hello?)?)?;
    say(&mut answers, &parameters)?;
    for line in lines {
        say(&mut answers, &answer(&mut state, serde_json::from_str(&line?)?))?;
    }
    Ok(())
}

/// Runs `serve` over standard input and output if this process was started with [`ARGUMENT`], and returns how it ends.
pub fn serve_if_asked(serve: impl FnOnce(StdinLock<'static>, StdoutLock<'static>) -> Result<()>) -> Option<ExitCode> {
    std::env::args().any(|argument| argument == ARGUMENT).then(|| {
        serve(io::stdin().lock(), io::stdout().lock()).map_or_else(
            |error| {
                eprintln!("{error:#}");
                ExitCode::FAILURE
            },
            |()| ExitCode::SUCCESS,
        )
    })
}
