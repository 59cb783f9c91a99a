//! A periodic loop, for processes that poll a device and publish its readings.

use bus::clock::{SECOND_NS, Schedule, now_ns};
use bus::{BusError, Waiter};

use crate::Chassis;

/// Smallest and largest rate, 1/s.
const RATES_HZ: [f64; 2] = [1e-3, 1e4];

/// The schedule of a periodic loop at absolute times: no drift and no bursts after a stall. Created by
/// [`Chassis::loop_schedule`].
#[derive(Debug)]
pub struct LoopSchedule {
    waiter: Waiter,
    schedule: Schedule,
}

impl Chassis {
    /// Creates a schedule of `rate_hz` turns per second (0.001 to 10 000) that starts now.
    ///
    /// # Errors
    /// Those of [`Chassis::waiter`].
    pub fn loop_schedule(&self, rate_hz: f64) -> Result<LoopSchedule, BusError> {
        let period_ns = SECOND_NS as f64 / rate_hz.clamp(RATES_HZ[0], RATES_HZ[1]);
        Ok(LoopSchedule { waiter: self.waiter(&[])?, schedule: Schedule::new(now_ns(), period_ns as u64) })
    }

    /// Waits until the next turn and does the housekeeping meanwhile; returns false when the process must end. The loop
    /// of a sensor is `while chassis.wait_for_turn(&mut schedule)? { .. }`.
    ///
    /// # Errors
    /// Those of [`Chassis::wait`].
    pub fn wait_for_turn(&mut self, schedule: &mut LoopSchedule) -> Result<bool, BusError> {
        let (due_ns, _) = schedule.schedule.next(now_ns());
        loop {
            self.wait(&mut schedule.waiter, Some(due_ns))?;
            if !self.running() || now_ns() >= due_ns {
                break;
            }
        }
        schedule.schedule.record_start(due_ns, now_ns());
        Ok(self.running())
    }
}
