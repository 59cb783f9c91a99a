//! Lengths, places and currents of a running robot, in place of typed ones.

use cable_robot::{CableVec, STANDARD_GRAVITY};
use calibration::{Moving, Paying, TouchDown, UpAndDown, Weighing};
use client::{Place, RobotLink, Samples, link, newest, system_of};
use command::{Answer, Failure};
use messages::MotorState;
use std::time::Duration;

/// Longest wait for a sample: half a second, in which even the slowest cycle passes many times.
const PATIENCE: Duration = Duration::from_millis(500);

/// Largest velocity of a cable at rest, m/s: the resolution of the velocity of a coarse encoder.
const REST_M_S: f64 = 0.005;

/// Lengths as the robot shows them.
#[derive(Debug, Clone, PartialEq)]
pub struct CapturedLengths {
    /// One length for each cable, m.
    pub lengths_m: Vec<f64>,
    /// Encoder counts per metre with which the robot computed them.
    pub counts_per_m: Vec<f64>,
}

/// Reads the lengths of the robot in this domain, or of the only running one.
///
/// # Errors
/// No robot runs, or its lengths cannot be used now.
pub fn capture(domain: Option<&str>) -> Answer<CapturedLengths> {
    let link = link(Place { domain, ..Place::default() })?;
    let counts_per_m = system_of(&link)?.motor_io.counts_per_m;
    let state = newest::<MotorState>(&link, "motor/state", PATIENCE)?
        .ok_or_else(|| Failure::NotNow("the robot publishes no lengths; `nims status` says why".to_owned()))?;
    lengths(&state, counts_per_m).map_err(Failure::NotNow)
}

/// Returns the place at which the robot in this domain, or the only running one, hangs, m.
///
/// # Errors
/// No robot runs, or its position cannot be used now.
pub fn place(domain: Option<&str>) -> Answer<[f64; 3]> {
    let link = link(Place { domain, ..Place::default() })?;
    let counts_per_m = system_of(&link)?.motor_io.counts_per_m;
    let state = newest::<MotorState>(&link, "motor/state", PATIENCE)?
        .ok_or_else(|| Failure::NotNow("the robot publishes no position; `nims status` says why".to_owned()))?;
    lengths(&state, counts_per_m).map_err(Failure::NotNow)?;
    if !state.node_m.iter().all(|m| m.is_finite()) {
        return Err(Failure::NotNow("the lengths of the robot fit no position; `nims status` says why".to_owned()));
    }
    Ok(state.node_m)
}

/// Takes the currents of a running robot that goes up and down.
pub struct MotionWatch {
    states: Samples<MotorState>,
    motion: UpAndDown,
}

impl MotionWatch {
    /// Begins to watch the robot in this domain, or the only running one.
    ///
    /// # Errors
    /// No robot runs.
    pub fn begin(domain: Option<&str>) -> Answer<Self> {
        let link = link(Place { domain, ..Place::default() })?;
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
            self.motion.take(&Moving {
                position_m: state.node_m,
                velocity_m_s: state.node_command_m_s,
                current_a: CableVec::from_array8(&state.current_a, usize::from(state.cable_count)),
            });
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
    /// Begins to watch the robot in this domain, or the only running one.
    ///
    /// # Errors
    /// No robot runs, or its lengths cannot be used now.
    pub fn begin(domain: Option<&str>) -> Answer<Self> {
        // What prevents a capture at rest prevents this one, except a motion.
        let link = link(Place { domain, ..Place::default() })?;
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

/// Takes the lengths of a sample.
///
/// # Errors
/// One sentence: why they cannot be used.
fn lengths(state: &MotorState, counts_per_m: Vec<f64>) -> Result<CapturedLengths, String> {
    let cables = usize::from(state.cable_count).min(state.length_m.len());
    if state.position_known != MotorState::POSITION_KNOWN {
        return Err("the robot's lengths have no zero in this run; hang the node at a place that you know roughly, and set it with \
                    `nims zero --at X,Y,Z`"
            .to_owned());
    }
    if let Some(cable) = (0..cables).find(|i| state.fresh[*i] == 0) {
        return Err(format!("the encoder of cable {} does not answer; `nims status` says why", cable + 1));
    }
    if let Some(cable) =
        (0..cables).find(|i| state.velocity_m_s[*i].is_nan() || state.velocity_m_s[*i].abs() > REST_M_S)
    {
        return Err(format!("cable {} moves; hold the node still and try again", cable + 1));
    }
    if counts_per_m.len() != cables {
        return Err(format!(
            "the system file has counts_per_m of {} cables, and the robot has {cables}",
            counts_per_m.len()
        ));
    }
    Ok(CapturedLengths { lengths_m: state.length_m[..cables].to_vec(), counts_per_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> MotorState {
        let mut length_m = [0.0; 8];
        length_m[..3].copy_from_slice(&[3.1, 9.8, 9.7]);
        let position_known = MotorState::POSITION_KNOWN;
        MotorState { cable_count: 3, position_known, length_m, fresh: [1; 8], ..MotorState::default() }
    }

    #[test]
    fn lengths_are_taken_at_rest_and_with_a_zero() {
        let counts = vec![10_000.0; 3];
        let taken = lengths(&state(), counts.clone()).unwrap();
        assert_eq!((taken.lengths_m, taken.counts_per_m), (vec![3.1, 9.8, 9.7], counts.clone()));
        let refused = |change: fn(&mut MotorState)| {
            let mut state = state();
            change(&mut state);
            lengths(&state, vec![10_000.0; 3]).unwrap_err()
        };
        assert!(refused(|s| s.position_known = MotorState::POSITION_RESTORED).contains("nims zero"));
        assert!(refused(|s| s.velocity_m_s[1] = -0.02).contains("cable 2"));
        assert!(refused(|s| s.fresh[2] = 0).contains("cable 3"));
        assert!(refused(|s| s.cable_count = 4).contains("counts_per_m"));
    }
}
