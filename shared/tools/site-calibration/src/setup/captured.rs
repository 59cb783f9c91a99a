//! Lengths, places and currents of a running robot, in place of typed ones.

use cable_robot::CableVec;
pub use calibration::{Moving, UpAndDown};
use messages::MotorState;

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

/// Takes the lengths of a sample.
///
/// # Errors
/// One sentence: why they cannot be used.
pub fn lengths(state: &MotorState, counts_per_m: Vec<f64>) -> Result<CapturedLengths, String> {
    let cables = usize::from(state.cable_count).min(state.length_m.len());
    if state.position_known != MotorState::POSITION_KNOWN {
        return Err(say!(
            "the robot's lengths have no zero in this run; hang the node at a place that you know roughly, and set it with \
                    `nims zero --at X,Y,Z`"
        ));
    }
    if let Some(cable) = (0..cables).find(|i| state.fresh[*i] == 0) {
        return Err(say!("the encoder of cable {} does not answer; `nims status` says why", cable + 1));
    }
    if let Some(cable) =
        (0..cables).find(|i| state.velocity_m_s[*i].is_nan() || state.velocity_m_s[*i].abs() > REST_M_S)
    {
        return Err(say!("cable {} moves; hold the node still and try again", cable + 1));
    }
    if counts_per_m.len() != cables {
        return Err(say!(
            "the system file has counts_per_m of {} cables, and the robot has {cables}",
            counts_per_m.len()
        ));
    }
    Ok(CapturedLengths { lengths_m: state.length_m[..cables].to_vec(), counts_per_m })
}

/// Takes the place at which the robot of a sample hangs, m.
///
/// # Errors
/// One sentence: why it cannot be used.
pub fn place(state: &MotorState, counts_per_m: Vec<f64>) -> Result<[f64; 3], String> {
    lengths(state, counts_per_m)?;
    if !state.node_m.iter().all(|m| m.is_finite()) {
        return Err(say!("the lengths of the robot fit no position; `nims status` says why"));
    }
    Ok(state.node_m)
}

/// The motion and the currents of a sample.
pub fn moving(state: &MotorState) -> Moving {
    Moving {
        position_m: state.node_m,
        velocity_m_s: state.node_command_m_s,
        current_a: CableVec::from_array8(&state.current_a, usize::from(state.cable_count)),
    }
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

    #[test]
    fn a_place_needs_lengths_that_fit() {
        let counts = vec![10_000.0; 3];
        let hangs = MotorState { node_m: [1.0, 2.0, 0.5], ..state() };
        assert_eq!(place(&hangs, counts.clone()), Ok([1.0, 2.0, 0.5]));
        assert!(place(&MotorState { node_m: [f64::NAN; 3], ..hangs }, counts.clone()).is_err());
        assert!(place(&MotorState { fresh: [0; 8], ..hangs }, counts).unwrap_err().contains("cable 1"));
    }
}
