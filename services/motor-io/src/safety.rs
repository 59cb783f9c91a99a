//! Modes, faults and the epoch: what the robot may do, and why it does not.
//!
//! ```text
//!              arm                 plan/motion + a controller that follows it
//!   Disarmed ------> Holding ---------------------------------------------> Following
//!      ^  disarm      ^  ^ \ jog                                      stop /   | pause, end of motion
//!      +--------------+  |  +--> Jogging --+        Stopping <------------+    |
//!                        +-----------------+------------+----------------------+
//!   any mode but Disarmed -- fault --> Faulted -- reset --> Holding
//!   any mode -- estop --> EmergencyStop -- reset --> Holding, or Disarmed where the drives were off
//! ```
//!
//! A reset leads to Holding and not to Disarmed, because drives that let go let the node sink. The lines stay held through every
//! fault; only a cable whose encoder does not tell the truth is let go. Lost commands, estimates or supervisors are no faults of the
//! robot: it stops on the path and holds, the motion is kept, and `resume` goes on with it once the cause is gone.

use crate::mode::Mode;
use messages::faults::{Faults, HARD, LASTING, STOPS};
use messages::{CABLES, MotorAuthority};

/// See the module's text.
#[derive(Debug, Clone)]
pub struct Safety {
    mode: Mode,
    energised: bool,
    latched: Faults,
    live: Faults,
    epoch: u32,
}

impl Safety {
    /// Disarmed, without a fault, in epoch 1.
    #[must_use]
    pub fn new() -> Self {
        Self { mode: Mode::Disarmed, energised: false, latched: Faults::default(), live: Faults::default(), epoch: 1 }
    }

    /// True while cables move because the operator or a mission asked for it.
    #[must_use]
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// State of the present mode, to change it. Only [`Safety::enter`] changes the mode itself.
    pub fn mode_mut(&mut self) -> &mut Mode {
        &mut self.mode
    }

    /// The drives hold or move.
    #[must_use]
    pub fn energised(&self) -> bool {
        self.energised
    }

    /// Commands and motions for another epoch are refused.
    #[must_use]
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Begins with another epoch than 1.
    pub fn begin_epoch(&mut self, epoch: u32) {
        self.epoch = epoch.max(1);
    }

    /// Everything computed before this moment is void.
    pub fn bump(&mut self) {
        self.epoch = self.epoch.checked_add(1).unwrap_or(1);
    }

    /// Cables at duty 0.
    #[must_use]
    pub fn released(&self) -> [bool; CABLES] {
        if self.energised { self.latched.release } else { [true; CABLES] }
    }

    /// Latched faults; while disarmed also what would prevent arming.
    #[must_use]
    pub fn faults(&self) -> Faults {
        let mut all = self.latched;
        if self.mode == Mode::Disarmed {
            let mut live = self.live;
            live.bits &= LASTING;
            live.release = [false; CABLES];
            if live.bits != 0 {
                all.add(&live);
            }
        }
        all
    }

    /// Conditions that persist right now and keep a reset or arming waiting.
    #[must_use]
    pub fn lasting(&self) -> Faults {
        Faults { bits: self.live.bits & LASTING, ..self.live }
    }

    /// Takes what was found in this cycle. True if the robot has to stop for it now.
    pub fn found(&mut self, found: &Faults) -> bool {
        self.live = *found;
        if self.mode == Mode::Disarmed || found.bits & HARD == 0 {
            return false;
        }
        self.latched.add(found);
        let emergency = found.bits & MotorAuthority::FAULT_EMERGENCY_INPUT != 0;
        match self.mode {
            Mode::EmergencyStop => false,
            Mode::Faulted if !emergency => false,
            _ => {
                self.mode = if emergency { Mode::EmergencyStop } else { Mode::Faulted };
                self.bump();
                true
            }
        }
    }

    /// Notes why the robot stops on the path.
    pub fn note_stop(&mut self, bits: u32) {
        self.latched.bits |= bits & STOPS;
    }

    /// The causes of a stop are over.
    pub fn clear_stops(&mut self, bits: u32) {
        self.latched.bits &= !(bits & STOPS);
    }

    /// The robot may not move otherwise than the new mode says. Never leads out of a latched mode; [`Safety::reset`] does.
    pub fn enter(&mut self, mode: Mode) {
        if !self.mode.is_latched() || mode == Mode::EmergencyStop {
            self.mode = mode;
        }
    }

    /// The drives hold from now on.
    pub fn arm(&mut self) {
        self.energised = true;
        self.clear_stops(STOPS);
        self.enter(Mode::Holding);
        self.bump();
    }

    /// The drives let go. A latched mode stays.
    pub fn disarm(&mut self) {
        self.energised = false;
        self.enter(Mode::Disarmed);
        self.bump();
    }

    /// Out of a latched mode, where its causes are gone; else false.
    pub fn reset(&mut self) -> bool {
        if self.live.bits & LASTING != 0 {
            return false;
        }
        self.latched = Faults::default();
        self.mode = if self.energised { Mode::Holding } else { Mode::Disarmed };
        self.bump();
        true
    }
}

impl Default for Safety {
    fn default() -> Self {
        Self::new()
    }
}
