//! Setpoint by which motor-io judges, from the planner's motion.

use cable_robot::Motion;
use messages::{MotorInput, PlanMotion};
use segments::motion_of;

/// The newest motion of plan/motion. The motion that the robot follows is kept when its planner dies.
#[derive(Debug, Clone, Copy, Default)]
pub struct Setpoints {
    current: Option<CurrentMotion>,
}

#[derive(Debug, Clone, Copy)]
struct CurrentMotion {
    life: u64,
    number: u32,
    beat: u64,
    motion: Motion,
}

impl Setpoints {
    /// Stores plan/motion; `following` is the number of the motion that the robot follows, 0: none.
    pub fn update(&mut self, message: &PlanMotion, following: u32) {
        let from_previous_planner = self.current.is_some_and(|current| {
            let other = (message.header.life, message.motion) != (current.life, current.number);
            following != 0 && current.number == following && (other || message.beat < current.beat)
        });
        if from_previous_planner {
            return;
        }
        let (life, number, beat) = (message.header.life, message.motion, message.beat);
        self.current = motion_of(message).map(|motion| CurrentMotion { life, number, beat, motion });
    }

    /// Writes the setpoint at a time of the plan clock into a cycle's input.
    pub fn write(&self, plan_time_s: f64, input: &mut MotorInput) {
        let current = self.current.filter(|current| current.life == input.header.life);
        input.setpoint_known = u8::from(current.is_some());
        input.motion_start_known = u8::from(current.is_some_and(|current| current.number == input.motion));
        let Some(CurrentMotion { motion, .. }) = current else { return };
        let at = motion.setpoint(plan_time_s);
        input.setpoint_m = at.position.into();
        input.setpoint_velocity_m_s = at.velocity.into();
        input.motion_start_m = motion.current.path.point(0.0).into();
    }
}
