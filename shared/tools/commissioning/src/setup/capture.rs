//! Lengths, places and currents of a running robot, in place of typed ones.

use cable_robot::{CableVec, STANDARD_GRAVITY};
use calibration::{Paying, TouchDown, UpAndDown, Weighing};
use client::{Place, RobotLink, Samples, link, newest, system_of};
use command::{Answer, Failure};
use messages::MotorState;
use site_calibration::setup::captured::{self, CapturedLengths, lengths, moving};
use std::time::Duration;

/// Longest wait for a sample: half a second, in which even the slowest cycle passes many times.
const PATIENCE: Duration = Duration::from_millis(500);

/// Reads the lengths of that robot.
///
/// # Errors
/// No such robot runs, or its lengths cannot be used now.
pub fn capture(robot: Place<'_>) -> Answer<CapturedLengths> {
    let link = link(robot)?;
    let counts_per_m = system_of(&link)?.motor_io.counts_per_m;
    let state = newest::<MotorState>(&link, "motor/state", PATIENCE)?
        .ok_or_else(|| Failure::NotNow("the robot publishes no lengths; `nims status` says why".to_owned()))?;
    lengths(&state, counts_per_m).map_err(Failure::NotNow)
}

/// Returns the place at which that robot hangs, m.
///
/// # Errors
/// No such robot runs, or its position cannot be used now.
pub fn place(robot: Place<'_>) -> Answer<[f64; 3]> {
    let link = link(robot)?;
    let counts_per_m = system_of(&link)?.motor_io.counts_per_m;
    let state = newest::<MotorState>(&link, "motor/state", PATIENCE)?
        .ok_or_else(|| Failure::NotNow("the robot publishes no position; `nims status` says why".to_owned()))?;
    captured::place(&state, counts_per_m).map_err(Failure::NotNow)
}

/// Takes the currents of a running robot that goes up and down.
pub struct MotionWatch {
    states: Samples<MotorState>,
    motion: UpAndDown,
}

impl MotionWatch {
    /// Begins to watch that robot.
    ///
    /// # Errors
    /// No such robot runs.
    pub fn begin(robot: Place<'_>) -> Answer<Self> {
        let link = link(robot)?;
        let mut states = link.subscriber::<MotorState>("motor/state")?;
        // Samples of before are of another motion.
        states.latest()?;
        Ok(Self { states, motion: UpAndDown::default() })
    }

    /// Takes the samples since the last call.
    ///
    /// # Errors
    /// The channel cannot be read.
    pub fn poll(&mut self) -> Answer<()> {
        while let Some(state) = self.states.receive()? {
            self.motion.take(&moving(&state));
        }
        Ok(())
    }

    /// Returns the mean currents of the motion with this weight on the node, kg.
    ///
    /// # Errors
    /// One clause: why the motion cannot be used, and what to do.
    pub fn weighing(&self, added_kg: f64) -> Result<Weighing, String> {
        self.motion.weighing(added_kg * STANDARD_GRAVITY)
    }
}

/// What a [`TouchDownWatch`] has seen.
#[derive(Debug, Clone, PartialEq)]
pub enum Seen {
    /// No touch-down so far.
    Nothing,
    /// The node touched the floor with these lengths.
    Touched(CapturedLengths),
}

/// Watches a running robot that lowers its node onto the floor.
pub struct TouchDownWatch {
    link: RobotLink,
    states: Samples<MotorState>,
    counts_per_m: Vec<f64>,
    detector: TouchDown,
}

impl TouchDownWatch {
    /// Begins to watch that robot.
    ///
    /// # Errors
    /// No such robot runs, or its lengths cannot be used now.
    pub fn begin(robot: Place<'_>) -> Answer<Self> {
        // What prevents a capture at rest prevents this one, except a motion.
        let link = link(robot)?;
        let counts_per_m = system_of(&link)?.motor_io.counts_per_m;
        let mut states = link.subscriber::<MotorState>("motor/state")?;
        // Of the samples of before, only whether lengths can be taken at all is of use.
        if let Some(state) = states.latest()? {
            let at_rest = MotorState { velocity_m_s: [0.0; messages::CABLES], ..state };
            lengths(&at_rest, counts_per_m.clone()).map_err(Failure::NotNow)?;
        }
        Ok(Self { link, states, counts_per_m, detector: TouchDown::default() })
    }

    /// Takes the samples since the last call.
    ///
    /// # Errors
    /// The channel cannot be read, or the lengths cannot be used.
    pub fn poll(&mut self) -> Answer<Seen> {
        while let Some(state) = self.states.receive()? {
            let Some(lengths_m) = touched(&mut self.detector, &state) else { continue };
            // A winch that goes on would let out loose cable. The robot stops for that by itself, a moment later.
            let answer = self.link.ask("motor-io", &messages::Request::Stop)?;
            Failure::unless_accepted(&answer).map_err(|why| {
                Failure::NotNow(format!(
                    "the node has touched the floor, and the robot was not stopped: {why}; stop it by hand"
                ))
            })?;
            let at_rest = MotorState { velocity_m_s: [0.0; messages::CABLES], ..state };
            let taken = lengths(&at_rest, self.counts_per_m.clone()).map_err(Failure::NotNow)?;
            return Ok(Seen::Touched(CapturedLengths { lengths_m: lengths_m.to_vec(), ..taken }));
        }
        Ok(Seen::Nothing)
    }
}

/// Takes one sample; returns the lengths if the node has touched the floor.
fn touched(detector: &mut TouchDown, state: &MotorState) -> Option<CableVec> {
    let cables = usize::from(state.cable_count);
    if state.fresh.iter().take(cables).any(|fresh| *fresh == 0) {
        return None;
    }
    detector.step(&Paying {
        time_s: state.header.stamp_ns as f64 * 1e-9,
        command_m_s: CableVec::from_array8(&state.command_m_s, cables),
        lengths_m: CableVec::from_array8(&state.length_m, cables),
    })
}
