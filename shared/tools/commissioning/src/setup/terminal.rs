//! What the dialogues read from and print to.

use super::input::{InputEvent, LineReader};
use client::Place;
use command::{Answer, Failure};
use site_calibration::setup::numbers::clean;
use std::io::{self, Write};

/// What both dialogues read from and print to.
pub struct Terminal<'a> {
    /// The text lines that are typed.
    pub lines: LineReader<'a>,
    /// A terminal echoes what is typed; input from a pipe is echoed here, so that answers appear between the questions.
    pub echoes: bool,
    /// Whether the program is interrupted.
    pub stopped: &'a dyn Fn() -> bool,
    /// The robot whose lengths are captured.
    pub robot: Place<'a>,
}

impl Terminal<'_> {
    /// Asks a question; `None` at the end of the input and after Ctrl-C.
    pub fn ask(&mut self, question: &str) -> Answer<Option<String>> {
        print_question(question);
        match self.lines.next(self.stopped).map_err(Failure::not_now)? {
            InputEvent::Line(line) => {
                if !self.echoes {
                    print_message(&clean(&line));
                }
                Ok(Some(line))
            }
            InputEvent::End | InputEvent::Stopped => {
                print_message("");
                Ok(None)
            }
        }
    }

    /// Waits for a line; `ended` is called every few cycles of the robot and ends the wait too.
    pub fn until_line(&mut self, ended: &mut dyn FnMut() -> bool) -> Answer<()> {
        let stopped = self.stopped;
        self.lines.next_while_watching(&mut || ended() || stopped()).map_err(Failure::not_now)?;
        Ok(())
    }
}

/// Prints to stderr, because stdout carries the result.
pub fn print_message(words: &str) {
    let _ = writeln!(io::stderr().lock(), "{words}");
}

fn print_question(question: &str) {
    let mut err = io::stderr().lock();
    let _ = write!(err, "{question} ").and_then(|()| err.flush());
}
