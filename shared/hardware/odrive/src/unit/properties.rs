//! Properties of a board that this crate has.

use std::fmt::Write as _;

use super::Board;
use crate::codec::{PROPERTY_WIDTH, Text, error, state};

impl Board {
    /// A property as the board states it; `None` for an unknown one.
    pub(super) fn read(&self, path: &str) -> Option<Text> {
        let mut text = Text::new();
        let whole = |text: &mut Text, value: u32| write!(text, "{value}").ok();
        let decimal = |text: &mut Text, value: f64| write!(text, "{value:.6}").ok();
        let [major, minor, revision] = self.options.firmware.map(u32::from);
        match path {
            "vbus_voltage" => decimal(&mut text, self.measured.supply_v),
            "fw_version_major" => whole(&mut text, major),
            "fw_version_minor" => whole(&mut text, minor),
            "fw_version_revision" => whole(&mut text, revision),
            _ => {
                let (index, property) = axis_of(path, self.options.axes)?;
                let axis = &self.axes[index];
                match property {
                    "error" => whole(&mut text, axis.error),
                    "motor.error" | "encoder.error" | "controller.error" => whole(&mut text, 0),
                    "current_state" => whole(&mut text, axis.state),
                    "requested_state" => whole(&mut text, 0),
                    "config.enable_watchdog" => whole(&mut text, u32::from(axis.watchdog_enabled)),
                    "config.watchdog_timeout" => decimal(&mut text, f64::from(axis.watchdog_timeout_s)),
                    "controller.input_torque" => decimal(&mut text, f64::from(axis.input_torque)),
                    "controller.config.control_mode" => whole(&mut text, axis.control_mode),
                    "controller.input_vel" => decimal(&mut text, f64::from(axis.input_vel)),
                    "encoder.pos_estimate" => decimal(&mut text, self.turns(index)),
                    "motor.current_control.Iq_measured" => decimal(&mut text, self.measured.currents_a[index]),
                    _ => None,
                }
            }
        }?;
        text.truncate(text.len().min(PROPERTY_WIDTH));
        Some(text)
    }

    /// Sets a property; `None` for one that cannot be set.
    pub(super) fn write(&mut self, path: &str, value: f64) -> Option<()> {
        let (index, property) = axis_of(path, self.options.axes)?;
        let kept_s = self.kept_watchdog_s;
        let now_ns = self.now_ns;
        let axis = &mut self.axes[index];
        match property {
            "requested_state" if value == f64::from(state::CLOSED_LOOP) => {
                // A watchdog that expires before the next step of the loop counts too.
                if axis.error == 0 {
                    (axis.state, axis.fed_ns) = (state::CLOSED_LOOP, now_ns);
                } else {
                    axis.error |= error::INVALID_STATE;
                }
            }
            "requested_state" => axis.state = state::IDLE,
            "error" => axis.error = value as u32,
            "controller.input_vel" => axis.input_vel = value as f32,
            "config.watchdog_timeout" => {
                axis.watchdog_timeout_s = kept_s.unwrap_or(value as f32);
                axis.fed_ns = now_ns;
            }
            "config.enable_watchdog" => {
                axis.watchdog_enabled = value != 0.0 && kept_s != Some(0.0);
                axis.fed_ns = now_ns;
            }
            _ => return None,
        }
        Some(())
    }
}

/// Axis and property of a path, if the board has the axis.
fn axis_of(path: &str, axes: usize) -> Option<(usize, &str)> {
    let (axis, property) = path.strip_prefix("axis")?.split_once('.')?;
    let axis = axis.parse().ok()?;
    (axis < axes).then_some((axis, property))
}
