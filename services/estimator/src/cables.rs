//! Lengths and velocities of all cables in a cycle: by a method for each cable, or by a program for all of them.

use messages::CABLES;

use crate::cable_estimator::{CableEstimator, CableSample, Instant, Parameters};
use crate::program::ProgramEstimator;
use crate::readings::{Measurements, Readings};

/// What computes the cables.
#[derive(Clone)]
pub(crate) enum Cables {
    /// One method per cable; empty for a custom method that was not given.
    Each(Vec<Box<dyn CableEstimator>>),
    /// One program for all of them. A copy asks the same program.
    Program(ProgramEstimator),
}

impl Cables {
    /// The same method for each cable.
    pub(crate) fn each(method: Option<Box<dyn CableEstimator>>, cables: usize) -> Self {
        Self::Each(method.map_or_else(Vec::new, |method| vec![method; cables]))
    }

    /// Whether there is a method for this number of cables.
    pub(crate) fn are(&self, cables: usize) -> bool {
        match self {
            Self::Each(methods) => methods.len() == cables,
            Self::Program(_) => true,
        }
    }

    /// Processes the samples of a cycle: returns what is measured at its instant; `None` for a cable without a recent
    /// reading or a finite result.
    #[inline]
    pub(crate) fn measure(
        &mut self,
        readings: &mut Readings,
        samples: &[CableSample],
        instant: &Instant,
    ) -> Measurements {
        let recent = readings.recent(samples, instant);
        let mut measured = self.at(samples, &recent, instant);
        for (at, recent) in measured.iter_mut().zip(recent) {
            if !at.as_ref().is_some_and(|at| recent && at.length_m.is_finite() && at.velocity_m_s.is_finite()) {
                *at = None;
            }
        }
        measured
    }

    #[inline]
    fn at(&mut self, samples: &[CableSample], recent: &[bool; CABLES], instant: &Instant) -> Measurements {
        match self {
            Self::Each(methods) => {
                let mut measured = [None; CABLES];
                for (i, (method, sample)) in methods.iter_mut().zip(samples).enumerate() {
                    method.read(sample);
                    measured[i] = if recent[i] { method.at(instant) } else { None };
                }
                measured
            }
            Self::Program(program) => program.at(samples, instant),
        }
    }

    pub(crate) fn forget(&mut self) {
        match self {
            Self::Each(methods) => methods.iter_mut().for_each(|method| method.forget()),
            Self::Program(program) => program.forget(),
        }
    }

    pub(crate) fn expect_anything(&mut self) {
        match self {
            Self::Each(methods) => methods.iter_mut().for_each(|method| method.expect_anything()),
            Self::Program(program) => program.expect_anything(),
        }
    }

    /// A program keeps its parameters: they are its own.
    pub(crate) fn retune(&mut self, parameters: &Parameters) {
        if let Self::Each(methods) = self {
            methods.iter_mut().for_each(|method| method.retune(parameters));
        }
    }

    pub(crate) fn constants(&self) -> String {
        match self {
            Self::Each(methods) => methods.first().map(|method| method.constants()).unwrap_or_default(),
            Self::Program(program) => program.parameters(),
        }
    }
}
