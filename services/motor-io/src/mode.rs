//! The modes of the robot, each with the state that has a meaning only in it.

use messages::{CABLES, MotorAuthority};

/// What the robot does; `safety` has the picture of the transitions.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant)] // in place: the loop does not allocate, so nothing is boxed
pub enum Mode {
    /// The drives are off.
    Disarmed,
    /// The drives hold; nothing moves.
    Holding,
    /// One cable moves slowly.
    Jogging(Jog),
    /// The robot follows a motion by the commands of a controller.
    Following(Following),
    /// The cables carry the node and yield to a hand.
    Soft(Soft),
    /// The robot comes to rest.
    Stopping(Stop),
    /// A fault: the robot comes to rest and stays there until a reset.
    Faulted,
    /// Zero velocity at once, until a reset.
    EmergencyStop,
}

impl Mode {
    /// Number of the mode in `motor/authority`.
    #[must_use]
    pub fn number(&self) -> u8 {
        match self {
            Self::Disarmed => MotorAuthority::MODE_DISARMED,
            Self::Holding => MotorAuthority::MODE_HOLDING,
            Self::Jogging(_) => MotorAuthority::MODE_JOGGING,
            Self::Following(_) => MotorAuthority::MODE_FOLLOWING,
            Self::Soft(_) => MotorAuthority::MODE_SOFT,
            Self::Stopping(_) => MotorAuthority::MODE_STOPPING,
            Self::Faulted => MotorAuthority::MODE_FAULTED,
            Self::EmergencyStop => MotorAuthority::MODE_EMERGENCY_STOP,
        }
    }

    /// True if cables move because the operator or a mission asked for it.
    #[must_use]
    pub fn moves(&self) -> bool {
        matches!(self, Self::Jogging(_) | Self::Soft(_)) || self.on_motion()
    }

    /// True while the robot follows a motion or stops in it.
    #[must_use]
    pub fn on_motion(&self) -> bool {
        matches!(self, Self::Following(_) | Self::Stopping(_))
    }

    /// True if only a reset ends the mode.
    #[must_use]
    pub fn is_latched(&self) -> bool {
        matches!(self, Self::Faulted | Self::EmergencyStop)
    }

    /// The use of commands, in the modes in which a controller steers.
    #[must_use]
    pub fn steering(&self) -> Option<&Steering> {
        match self {
            Self::Following(Following { steering, .. })
            | Self::Stopping(Stop { braking: Braking::OnPath { steering, .. }, .. }) => Some(steering),
            _ => None,
        }
    }

    /// The same, to change it.
    pub fn steering_mut(&mut self) -> Option<&mut Steering> {
        match self {
            Self::Following(Following { steering, .. })
            | Self::Stopping(Stop { braking: Braking::OnPath { steering, .. }, .. }) => Some(steering),
            _ => None,
        }
    }
}

/// State of [`Mode::Jogging`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jog {
    /// Cable, from 0.
    pub cable: usize,
    /// Length still to pay out, m; negative: to reel in.
    pub left_m: f64,
    /// The cable comes to rest where it is.
    pub cancelled: bool,
}

/// State of [`Mode::Soft`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Soft {
    /// Lengths of the cables as last read, m, and the times of their readings, ns.
    pub lengths_m: [f64; CABLES],
    pub sampled_ns: [u64; CABLES],
    /// Velocity of each cable over about two cycles, m/s.
    pub velocity_m_s: [f64; CABLES],
    /// Where the node would be at rest, m: a hand that pulls it away takes this point along.
    pub rest_m: [f64; 3],
    /// Currents of the motors, A; positive pulls the cable in.
    pub current_a: [f64; CABLES],
    /// By how much the currents that held the node before differed, A.
    pub begin_a: [f64; CABLES],
    /// Cycles since the beginning.
    pub begun: u32,
    /// Cycles in a row in which a cable was too fast.
    pub fast: u32,
    /// Cycles in a row in which a unit was not read.
    pub unread: u32,
}

/// State of the use of a controller's commands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steering {
    /// Velocities of the last command that was used, m/s; zero: none yet.
    velocity_m_s: [f64; CABLES],
    /// Rate of the plan clock when that command was used.
    rate: f64,
    /// Time to live of that command, cycles.
    ttl_cycles: u32,
    /// Cycles in a row without a command, those with missing readings excepted.
    missing: u32,
    /// Cycles in a row in which commands have moved the node away from its setpoint.
    pub diverging: u32,
}

impl Steering {
    /// At rest, with the time to live of the command that the motion starts with.
    #[must_use]
    pub fn from_rest(ttl_cycles: u32) -> Self {
        Self { velocity_m_s: [0.0; CABLES], rate: 0.0, ttl_cycles, missing: 0, diverging: 0 }
    }

    /// Records a command that is used, and the rate of the plan clock.
    pub fn record(&mut self, velocity_m_s: &[f64; CABLES], rate: f64, ttl_cycles: u32) {
        debug_assert!(velocity_m_s.iter().all(|v| v.is_finite()), "a command is not finite: {velocity_m_s:?}");
        *self = Self { velocity_m_s: *velocity_m_s, rate, ttl_cycles, missing: 0, ..*self };
    }

    /// Records a cycle without a command. Returns true once the last command has outlived its time.
    pub fn record_missing(&mut self) -> bool {
        self.missing += 1;
        self.missing >= self.ttl_cycles
    }

    /// Cycles in a row without a command, those with missing readings excepted.
    #[must_use]
    pub fn missing(&self) -> u32 {
        self.missing
    }

    /// The last command that was used, slowed down as far as the plan clock has been since, m/s.
    #[must_use]
    pub fn last_slowed_to(&self, rate: f64) -> [f64; CABLES] {
        let factor = if self.rate > 0.0 { (rate / self.rate).min(1.0) } else { 0.0 };
        self.velocity_m_s.map(|v| v * factor)
    }
}

/// State of [`Mode::Following`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Following {
    /// Use of commands.
    pub steering: Steering,
    /// The operator asked for a pause: the plan clock ramps to standstill.
    pub pausing: bool,
    /// Cycles since the setpoint reached the end of the motion; 0: it has not.
    pub settled: u32,
    /// Cycles for which the cables have been awaited at rest, with the plan clock at standstill.
    pub waited: u32,
    /// Remaining cycles with a command after a gap before the plan clock continues.
    pub gap_wait: u32,
}

impl Following {
    /// State at the start of a motion, or where it continues.
    #[must_use]
    pub fn from_rest(ttl_cycles: u32) -> Self {
        Self { steering: Steering::from_rest(ttl_cycles), pausing: false, settled: 0, waited: 0, gap_wait: 0 }
    }
}

/// State of [`Mode::Stopping`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// The motion is given up at rest; otherwise it is kept, so that it can be resumed.
    pub dropped: bool,
    /// What brakes the robot.
    pub braking: Braking,
}

/// What brings the robot to rest in [`Mode::Stopping`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Braking {
    /// The plan clock ramps to standstill, and the controller's commands keep the node on its path.
    OnPath {
        /// Use of commands.
        steering: Steering,
        /// Cycles for which the cables have been awaited at rest, with the plan clock at standstill.
        waited: u32,
    },
    /// Without a controller: the velocity vector shrinks to zero.
    Open,
}

impl Stop {
    /// A stop on the path, after which the motion can be resumed.
    #[must_use]
    pub fn on_path(steering: Steering) -> Self {
        Self { dropped: false, braking: Braking::OnPath { steering, waited: 0 } }
    }

    /// A stop without a controller, after which the motion can be resumed.
    #[must_use]
    pub fn open() -> Self {
        Self { dropped: false, braking: Braking::Open }
    }
}
