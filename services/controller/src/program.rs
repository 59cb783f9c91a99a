//! A law in a program of its own, in any language, over its standard input and output ([`crate::lockstep`]).

use std::path::Path;

use anyhow::ensure;
use cable_robot::CableVec;
use program_pipe::Program;
pub use program_pipe::{Complaint, StartError, Waits};

use crate::custom_law::{CableLaw, LawInput};
use crate::lockstep::Question;

/// The law of a program.
pub struct ProgramLaw(Program);

impl ProgramLaw {
    /// Starts the program for a system.
    ///
    /// # Errors
    /// There is no such program, it fails, or it does not answer as one with a law.
    pub fn start(command: &str, system: &Path, cables: usize, waits: Waits) -> Result<Self, StartError> {
        Program::start("law", command, system, cables, waits).map(Self)
    }

    /// Where the law says what its program did wrong.
    pub fn complaint(&self) -> Complaint {
        self.0.complaint()
    }
}

impl CableLaw for ProgramLaw {
    fn velocity(&mut self, input: &LawInput<'_>) -> Option<CableVec> {
        let cables = input.robot.cable_count();
        self.0.ready()?.answer(&Question::from(input), "a list of velocities, or null", |values: Vec<f64>| {
            ensure!(values.len() == cables, "these are {} velocities for {cables} cables", values.len());
            Ok(CableVec::from_slice(&values)?)
        })
    }

    fn parameters(&self) -> String {
        self.0.parameters()
    }
}
