//! Modes, faults and the epoch.
//!
//! ```text
//!              arm                 plan/motion + a controller that follows it
//!   Disarmed ------> Holding ---------------------------------------------> Following
//!      ^  disarm      ^  ^ \ jog                                      stop /   | pause, end of motion
//!      +--------------+  |  +--> Jogging --+        Stopping <------------+    |
//!                        +-----------------+------------+----------------------+
//!   Holding -- soft --> Soft -- hold, stop, border, cable too fast, missing readings --> Stopping
//!   any mode but Disarmed -- fault --> Faulted -- reset --> Holding
//!   any mode -- estop --> EmergencyStop -- reset --> Holding, or Disarmed where the drives were off
//! ```
//!
//! A reset leads to Holding and not to Disarmed, because the node sinks when the drives let go. The cables stay
//! held through every fault; only a cable whose encoder is wrong is released. Lost commands, estimates or
//! supervisors are not faults of the robot: it stops on the path and holds, keeps the motion, and `resume`
//! continues it once the cause is gone.

use crate::mode::Mode;
use messages::faults::{Faults, HARD, LASTING, STOPS};
use messages::{CABLES, MotorAuthority};

/// State of the safety machine.
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

    /// Present mode, to change its state. [`Safety::enter`] changes the mode itself.
    pub fn mode_mut(&mut self) -> &mut Mode {
        &mut self.mode
    }

    /// True if the drives hold or move.
    #[must_use]
    pub fn energised(&self) -> bool {
        self.energised
    }

    /// Present epoch; commands and motions for another one are rejected.
    #[must_use]
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Sets the first epoch, at least 1.
    pub fn begin_epoch(&mut self, epoch: u32) {
        self.epoch = epoch.max(1);
    }

    /// Starts a new epoch: older commands are rejected.
    pub fn start_epoch(&mut self) {
        self.epoch = self.epoch.checked_add(1).unwrap_or(1);
    }

    /// Cables at duty 0.
    #[must_use]
    pub fn released(&self) -> [bool; CABLES] {
        if self.energised { self.latched.release } else { [true; CABLES] }
    }

    /// Latched faults; while disarmed also those that would prevent arming.
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

    /// Conditions that persist and prevent a reset or arming.
    #[must_use]
    pub fn persisting(&self) -> Faults {
        Faults { bits: self.live.bits & LASTING, ..self.live }
    }

    /// Records the faults of this cycle. Returns true if the robot enters a latched mode because of them.
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
                self.start_epoch();
                true
            }
        }
    }

    /// Records why the robot stops on the path.
    pub fn record_stop(&mut self, bits: u32) {
        self.latched.bits |= bits & STOPS;
    }

    /// Clears reasons for a stop.
    pub fn clear_stops(&mut self, bits: u32) {
        self.latched.bits &= !(bits & STOPS);
    }

    /// Enters a mode. Does not leave a latched mode; [`Safety::reset`] does.
    pub fn enter(&mut self, mode: Mode) {
        debug_assert!(self.energised || !mode.moves(), "{mode:?} while the drives are off");
        if !self.mode.is_latched() || mode == Mode::EmergencyStop {
            self.mode = mode;
        }
    }

    /// Switches the drives on, and enters Holding.
    pub fn arm(&mut self) {
        self.energised = true;
        self.clear_stops(STOPS);
        self.enter(Mode::Holding);
        self.start_epoch();
    }

    /// Switches the drives off. A latched mode stays.
    pub fn disarm(&mut self) {
        self.energised = false;
        self.enter(Mode::Disarmed);
        self.start_epoch();
    }

    /// Leaves a latched mode if its causes are gone; else returns false.
    pub fn reset(&mut self) -> bool {
        if self.live.bits & LASTING != 0 {
            return false;
        }
        self.latched = Faults::default();
        self.mode = if self.energised { Mode::Holding } else { Mode::Disarmed };
        self.start_epoch();
        true
    }
}

impl Default for Safety {
    fn default() -> Self {
        Self::new()
    }
}
