//! A law in a program of its own that answers over a pipe, cycle by cycle, for flights in lockstep (`nims sim`).
//!
//! The first lines are those of [`program_pipe`]. Then each line is a [`Question`], and the answer the cable velocities
//! in m/s, or `null` for no answer to this estimate.

use std::io::{BufRead, Write};

use cable_robot::elastic::Realisation;
use cable_robot::{CableVec, Robot, Setpoint};
use config::SystemFile;
use messages::{CABLES, NodeEstimate};
use program_pipe::{Hello, Parameters};
use serde::{Deserialize, Serialize};

use crate::custom_law::{CableLaw, LawInput};

/// A setpoint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Wanted {
    /// Position, m.
    pub position_m: [f64; 3],
    /// Velocity, m/s.
    pub velocity_m_s: [f64; 3],
    /// Acceleration, m/s².
    pub acceleration_m_s2: [f64; 3],
    /// Segment of the motion.
    pub segment_id: u64,
    /// Arc length along it, m.
    pub path_s_m: f64,
    /// True before the start and after the end of the segment.
    pub at_rest: bool,
}

/// What holds the node at a setpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Unstretched lengths, m.
    pub unstretched_m: Vec<f64>,
    /// Straight lengths, m.
    pub lengths_m: Vec<f64>,
    /// Tensions, N.
    pub tensions_n: Vec<f64>,
}

/// The input of a law; see [`LawInput`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// Slot of the estimate.
    pub slot: usize,
    /// Cycle of the estimate.
    pub cycle: u64,
    /// Period of the control cycle, s.
    pub period_s: f64,
    /// Time from `now` to `ahead`, s.
    pub horizon_s: f64,
    /// Estimated position, m.
    pub position_m: [f64; 3],
    /// Estimated velocity, m/s.
    pub velocity_m_s: [f64; 3],
    /// Covariance of the position, row by row, m².
    pub covariance_m2: [f64; 9],
    /// Estimated unstretched lengths, m.
    pub lengths_m: Vec<f64>,
    /// Estimated tensions, N.
    pub tensions_n: Vec<f64>,
    /// Desired unstretched lengths, m; `None` if the cables cannot hold the node at the setpoint.
    pub desired_lengths_m: Option<Vec<f64>>,
    /// Desired velocities of the unstretched lengths, m/s; `None` as above.
    pub desired_velocities_m_s: Option<Vec<f64>>,
    /// Setpoint at the instant of the estimate.
    pub now: Wanted,
    /// Setpoint at the end of the horizon.
    pub ahead: Wanted,
    /// What holds the node at `now`.
    pub now_held: Option<Held>,
    /// What holds the node at `ahead`.
    pub ahead_held: Option<Held>,
}

impl From<&Setpoint> for Wanted {
    fn from(setpoint: &Setpoint) -> Self {
        Self {
            position_m: setpoint.position.into(),
            velocity_m_s: setpoint.velocity.into(),
            acceleration_m_s2: setpoint.acceleration.into(),
            segment_id: setpoint.segment_id,
            path_s_m: setpoint.path_s_m,
            at_rest: setpoint.at_rest,
        }
    }
}

impl From<Wanted> for Setpoint {
    fn from(wanted: Wanted) -> Self {
        Self {
            position: wanted.position_m.into(),
            velocity: wanted.velocity_m_s.into(),
            acceleration: wanted.acceleration_m_s2.into(),
            segment_id: wanted.segment_id,
            path_s_m: wanted.path_s_m,
            at_rest: wanted.at_rest,
        }
    }
}

impl From<&Realisation> for Held {
    fn from(held: &Realisation) -> Self {
        Self {
            unstretched_m: held.unstretched_m.to_vec(),
            lengths_m: held.lengths_m.to_vec(),
            tensions_n: held.tensions_n.to_vec(),
        }
    }
}

impl Held {
    fn realisation(&self) -> Option<Realisation> {
        let vector = |values: &[f64]| CableVec::from_slice(values).ok();
        Some(Realisation {
            unstretched_m: vector(&self.unstretched_m)?,
            lengths_m: vector(&self.lengths_m)?,
            tensions_n: vector(&self.tensions_n)?,
        })
    }
}

impl From<&LawInput<'_>> for Question {
    fn from(input: &LawInput<'_>) -> Self {
        let cables = input.robot.cable_count();
        Self {
            slot: input.slot,
            cycle: input.estimate.header.cycle,
            period_s: input.period_s,
            horizon_s: input.horizon_s,
            position_m: input.estimate.position_m,
            velocity_m_s: input.estimate.velocity_m_s,
            covariance_m2: input.estimate.covariance_m2,
            lengths_m: input.lengths_m().to_vec(),
            tensions_n: input.estimate.tension_n.iter().take(cables).copied().collect(),
            desired_lengths_m: input.desired_lengths_m().map(|lengths| lengths.to_vec()),
            desired_velocities_m_s: input.desired_velocities_m_s().map(|speeds| speeds.to_vec()),
            now: input.now.into(),
            ahead: input.ahead.into(),
            now_held: input.now_held.map(Held::from),
            ahead_held: input.ahead_held.map(Held::from),
        }
    }
}

impl Question {
    fn answer(&self, robot: &Robot, law: &mut dyn CableLaw) -> Option<CableVec> {
        let mut estimate = NodeEstimate {
            position_m: self.position_m,
            velocity_m_s: self.velocity_m_s,
            covariance_m2: self.covariance_m2,
            cable_count: robot.cable_count() as u8,
            valid: 1,
            ..NodeEstimate::default()
        };
        estimate.header.cycle = self.cycle;
        fill(&mut estimate.predicted_m, &self.lengths_m);
        fill(&mut estimate.tension_n, &self.tensions_n);
        let (now, ahead) = (self.now.into(), self.ahead.into());
        let held = |held: &Option<Held>| held.as_ref().and_then(Held::realisation);
        let (now_held, ahead_held) = (held(&self.now_held), held(&self.ahead_held));
        law.velocity(&LawInput {
            slot: self.slot,
            robot,
            period_s: self.period_s,
            horizon_s: self.horizon_s,
            estimate: &estimate,
            now: &now,
            ahead: &ahead,
            now_held: now_held.as_ref(),
            ahead_held: ahead_held.as_ref(),
        })
    }
}

fn fill(into: &mut [f64; CABLES], values: &[f64]) {
    into.iter_mut().zip(values).for_each(|(into, value)| *into = *value);
}

/// Answers over these streams until the other side closes them.
///
/// # Errors
/// A line that is none of this protocol, a system file that is not accepted, or a stream that fails.
pub fn serve(law: &mut dyn CableLaw, questions: impl BufRead, answers: impl Write) -> anyhow::Result<()> {
    let parameters = Parameters { parameters: law.parameters() };
    let begin = |Hello { system, .. }| Ok((SystemFile::load(&system)?.robot_file()?.robot()?, parameters));
    program_pipe::serve(questions, answers, begin, |robot: &mut Robot, question: Question| {
        let velocity = question.answer(robot, law).map(|velocity| velocity.to_vec());
        // JSON has no other numbers, and a velocity that is none of them is no answer.
        velocity.filter(|velocity| velocity.iter().all(|number| number.is_finite()))
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use cable_robot::Vector3;
    use std::path::Path;

    /// Answers in the cycles 1, 2 and 3.
    struct Answers([Option<[f64; 3]>; 3]);

    impl CableLaw for Answers {
        fn velocity(&mut self, asked: &LawInput<'_>) -> Option<CableVec> {
            let answer = self.0[asked.estimate.header.cycle as usize - 1]?;
            CableVec::from_slice(&answer).ok()
        }
    }

    #[test]
    fn an_answer_that_is_not_finite_is_none() {
        let system = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems/demo3.toml");
        let zero = Vector3::zeros();
        let setpoint = Setpoint {
            position: zero,
            velocity: zero,
            acceleration: zero,
            segment_id: 1,
            path_s_m: 0.0,
            at_rest: true,
        };
        let robot = SystemFile::load(&system).unwrap().robot_file().unwrap().robot().unwrap();
        let mut lines = vec![serde_json::to_string(&Hello { system, cables: 3 }).unwrap()];
        for cycle in 1..=3 {
            let mut estimate = NodeEstimate::default();
            estimate.header.cycle = cycle;
            let (now_held, ahead_held) = (None, None);
            let (period_s, horizon_s, estimate) = (0.01, 0.2, &estimate);
            let (robot, now, ahead) = (&robot, &setpoint, &setpoint);
            let input = LawInput { slot: 0, robot, period_s, horizon_s, estimate, now, ahead, now_held, ahead_held };
            lines.push(serde_json::to_string(&Question::from(&input)).unwrap());
        }
        let mut law = Answers([Some([0.25; 3]), Some([0.25, f64::NAN, 0.25]), Some([f64::INFINITY; 3])]);
        let mut answers = Vec::new();
        serve(&mut law, lines.join("\n").as_bytes(), &mut answers).unwrap();
        let answers = String::from_utf8(answers).unwrap();
        assert_eq!(answers.lines().skip(1).collect::<Vec<_>>(), ["[0.25,0.25,0.25]", "null", "null"]);
    }
}
