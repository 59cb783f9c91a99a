//! The motion that is followed, and what it asks for at an instant.

use cable_robot::elastic::Realisation;
use cable_robot::{Motion, Setpoint, Vector3, tension};
use messages::{ControlStatus, MotorAuthority, PlanMotion, same_life};
use segments::motion_of;

use crate::instant::Instant;
use crate::settings::ControllerConfig;

/// The motion of the last plan/motion.
#[derive(Debug, Clone)]
pub(crate) struct CurrentMotion {
    beat: u64,
    number: u32,
    epoch: u32,
    motion: Option<Motion>,
}

impl CurrentMotion {
    /// Replaces `current` by the motion of a message, if it is to be followed, and returns the motion; `None` without a
    /// motion of the present epoch.
    ///
    /// The current motion is followed as long as the epoch is valid, even if its planner dies and a restarted planner
    /// publishes something else.
    pub fn update<'a>(
        current: &'a mut Option<Self>,
        message: Option<&PlanMotion>,
        authority: &MotorAuthority,
    ) -> Option<&'a Motion> {
        let message = message.filter(|message| {
            message.motion != 0 && message.epoch == authority.epoch && same_life(&message.header, &authority.header)
        });
        // By reference: a motion has some kilobytes.
        let orphaned = current.as_ref().is_some_and(|current| {
            let under_way =
                authority.motion != 0 && (authority.motion, authority.epoch) == (current.number, current.epoch);
            under_way && message.is_none_or(|message| message.motion != current.number || message.beat < current.beat)
        });
        if !orphaned {
            let message = message?;
            // A restarted planner counts beats and motions from the beginning.
            let (beat, number, epoch) = (message.beat, message.motion, message.epoch);
            if current.as_ref().is_none_or(|is| (is.beat, is.number, is.epoch) != (beat, number, epoch)) {
                *current = Some(Self { beat, number, epoch, motion: motion_of(message) });
            }
        }
        current.as_ref()?.motion()
    }

    /// Returns the motion, if it was valid.
    pub fn motion(&self) -> Option<&Motion> {
        self.motion.as_ref()
    }
}

/// Setpoints now and at the end of the horizon, with the lengths and tensions for each.
pub(crate) struct Target {
    pub now: Setpoint,
    pub ahead: Setpoint,
    pub now_held: Option<Realisation>,
    pub ahead_held: Option<Realisation>,
}

impl Target {
    /// Returns the target of a motion at the instant of an estimate.
    #[inline]
    pub fn at(config: &ControllerConfig, motion: &Motion, authority: &MotorAuthority, instant: &Instant) -> Self {
        let (period_s, rate) = (authority.period_s, authority.plan_rate);
        // The plan time is that of the start of the cycle; the estimate is some milliseconds later, when the encoders
        // were read.
        let now_s = authority.plan_time_s + rate * (instant.since_s + period_s * instant.lag as f64);
        let now = at_rate(motion, now_s, rate);
        let ahead = at_rate(motion, now_s + rate * period_s * f64::from(config.horizon), rate);
        Self { now_held: realise(config, &now), ahead_held: realise(config, &ahead), now, ahead }
    }

    /// Writes the setpoint and the tensions that hold it into a status.
    pub fn describe(&self, status: &mut ControlStatus) {
        status.setpoint_m = self.now.position.into();
        status.setpoint_velocity_m_s = self.now.velocity.into();
        if let Some(held) = &self.now_held {
            status.tension_n = held.tensions_n.to_array8();
        }
    }
}

/// Returns lengths and tensions at a setpoint. If the tension limits cannot be met with acceleration and drag, returns
/// those at rest: the planner has checked the motion, so the limits are exceeded only slightly.
#[inline]
pub(crate) fn realise(config: &ControllerConfig, setpoint: &Setpoint) -> Option<Realisation> {
    let ControllerConfig { robot, distribution, .. } = config;
    let moving_n = robot.moving_wrench_n(&setpoint.velocity, &setpoint.acceleration);
    let held = tension::for_wrench(robot, &setpoint.position, &moving_n, *distribution)
        .or_else(|_| tension::at(robot, &setpoint.position, &Vector3::zeros(), *distribution));
    Some(Realisation::with_tensions(robot, &setpoint.position, held.ok()?.tensions_n))
}

/// Returns the setpoint on a plan clock that runs at `rate`: a slower motion along the same path.
pub(crate) fn at_rate(motion: &Motion, time_s: f64, rate: f64) -> Setpoint {
    let at = motion.setpoint(time_s);
    Setpoint { velocity: at.velocity * rate, acceleration: at.acceleration * (rate * rate), ..at }
}
