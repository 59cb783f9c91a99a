//! Questions of one batch, and what their answers mean.

use crate::codec::{Line, feedback, number};

/// Most questions of a batch.
pub(super) const MAX_ASKS: usize = 10;
/// Most lines to the board before them.
pub(super) const MAX_ORDERS: usize = 8;

/// A question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ask {
    Feedback(usize),
    /// The velocity that the axis was commanded.
    Velocity(usize),
    /// The torque that the axis was commanded.
    Torque(usize),
    /// Which of them the axis controls.
    Control(usize),
    State(usize),
    Error(usize),
    Current(usize),
    WatchdogTime(usize),
    WatchdogOn(usize),
    Supply,
    /// Part of the firmware's version.
    Version(usize),
}

/// An answer: one number, or position and velocity.
pub(super) type Value = [f64; 2];

impl Ask {
    pub(super) fn line(self) -> Line<'static> {
        match self {
            Ask::Feedback(axis) => Line::Feedback(axis),
            Ask::Velocity(axis) => Line::Read(axis, "controller.input_vel"),
            Ask::Torque(axis) => Line::Read(axis, "controller.input_torque"),
            Ask::Control(axis) => Line::Read(axis, "controller.config.control_mode"),
            Ask::State(axis) => Line::Read(axis, "current_state"),
            Ask::Error(axis) => Line::Read(axis, "error"),
            Ask::Current(axis) => Line::Read(axis, "motor.current_control.Iq_measured"),
            Ask::WatchdogTime(axis) => Line::Read(axis, "config.watchdog_timeout"),
            Ask::WatchdogOn(axis) => Line::Read(axis, "config.enable_watchdog"),
            Ask::Supply => Line::ReadBoard("vbus_voltage"),
            Ask::Version(0) => Line::ReadBoard("fw_version_major"),
            Ask::Version(1) => Line::ReadBoard("fw_version_minor"),
            Ask::Version(_) => Line::ReadBoard("fw_version_revision"),
        }
    }

    /// True for a property that is a whole number; the others have decimals.
    fn is_whole(self) -> bool {
        matches!(self, Ask::Control(_) | Ask::State(_) | Ask::Error(_) | Ask::WatchdogOn(_) | Ask::Version(_))
    }

    /// Reads the answer; `None` where it is none to this question.
    pub(super) fn answer(self, text: &str) -> Option<Value> {
        if let Ask::Feedback(_) = self {
            return feedback(text);
        }
        (text.contains('.') != self.is_whole()).then_some([number(text)?, 0.0])
    }
}
