//! The record from which the preview law identifies the drives.

use cable_control::drive_lag::{Identified, IdentifyError, LagFit, MAX_RECORD, MIN_RECORD, Record};
use cable_robot::CableVec;

/// Length of a record, s: the ramp of the speed profile and a little of the cruise.
const RECORD_S: f64 = 1.0;

/// Start of a record from which only the commands are used, s: the effect of earlier commands decays.
const SETTLE_S: f64 = 0.5;

/// Command below which a cable is at rest, m/s: smaller than the command for a position error of one encoder step.
const REST_M_S: f64 = 2e-3;

/// Records commands and velocities, and identifies a model from them.
#[derive(Debug, Clone)]
pub(super) struct Recorder {
    commands_m_s: Vec<CableVec>,
    velocities_m_s: Vec<CableVec>,
    count: usize,
    reading_s: CableVec,
    ignored: usize,
    /// Whether the robot has been at rest since the start of the record.
    resting: bool,
    fit: Option<LagFit>,
}

impl Recorder {
    pub(super) fn new() -> Self {
        let empty = vec![CableVec::zeros(0); MAX_RECORD];
        Self {
            commands_m_s: empty.clone(),
            velocities_m_s: empty,
            count: 0,
            reading_s: CableVec::zeros(0),
            ignored: 0,
            resting: true,
            fit: None,
        }
    }

    pub(super) fn drop_record(&mut self) {
        (self.count, self.resting, self.fit) = (0, true, None);
    }

    fn push(&mut self, command_m_s: CableVec, velocity_m_s: CableVec) {
        if self.count < MAX_RECORD {
            self.commands_m_s[self.count] = command_m_s;
            self.velocities_m_s[self.count] = velocity_m_s;
            self.count += 1;
        }
    }

    fn record(&self, period_s: f64) -> Record<'_> {
        Record {
            period_s,
            reading_s: self.reading_s,
            commands_m_s: &self.commands_m_s[..self.count],
            velocities_m_s: &self.velocities_m_s[..self.count],
            ignored: self.ignored,
        }
    }

    /// Processes one cycle: extends the record, or does one pass of the identification. Returns a result after the last
    /// pass.
    pub(super) fn step(
        &mut self,
        command_m_s: CableVec,
        velocity_m_s: CableVec,
        reading_s: &CableVec,
        period_s: f64,
    ) -> Option<Result<Identified, IdentifyError>> {
        if let Some(mut fit) = self.fit {
            let done = fit.pass(&self.record(period_s)).transpose();
            self.fit = Some(fit);
            if done.is_some() {
                self.drop_record();
            }
            return done;
        }
        self.ignored = (SETTLE_S / period_s).ceil() as usize;
        self.resting &= command_m_s.max_abs() <= REST_M_S;
        if self.resting && self.count >= self.ignored {
            // Wait for the start of a motion, so that the record contains all of it.
            return None;
        }
        self.reading_s = *reading_s;
        self.push(command_m_s, velocity_m_s);
        let full = self.ignored + ((RECORD_S / period_s).ceil() as usize).max(MIN_RECORD);
        if self.count < full.min(MAX_RECORD) {
            return None;
        }
        match LagFit::new(&self.record(period_s)) {
            Ok(fit) => self.fit = Some(fit),
            // A short motion or a steady cruise does not identify the drives; this is not reported.
            Err(IdentifyError::NotExcited { .. }) => self.drop_record(),
            Err(error) => {
                self.drop_record();
                return Some(Err(error));
            }
        }
        None
    }
}
