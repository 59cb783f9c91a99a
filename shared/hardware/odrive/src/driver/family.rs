//! ODrive as a drive family.

use std::sync::Arc;

use drives::{Capabilities, Counters, DriveBus, Error, StopInput, UnitAnswer, UnitCommand, UnitInfo};
use serial::{PortClock, Transport};

use super::Bus;

impl<T: Transport> DriveBus for Bus<T> {
    fn port(&self) -> &Arc<str> {
        self.transport.name()
    }

    fn unit_count(&self) -> usize {
        1
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            velocity: true,
            torque: self.config.torque_constant_n_m_a > 0.0,
            watchdog: true,
            speeds: true,
            currents: true,
            // Not stated by the board in one number.
            duties: false,
            supply: true,
            second_encoder: false,
        }
    }

    fn unit(&self, unit: usize) -> Option<UnitInfo> {
        (unit == 0).then(|| UnitInfo {
            name: Arc::clone(&self.name),
            firmware: self.firmware,
            watchdog_ms: self.setup.has_watchdog().then_some(u32::from(self.config.watchdog_ms)),
        })
    }

    fn now_ns(&self) -> u64 {
        self.transport.now_ns()
    }

    fn clock(&self) -> Option<Arc<PortClock>> {
        self.transport.clock()
    }

    fn exchange(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        self.exchange_board(commands, deadline_ns, answers);
    }

    fn spend(&mut self, deadline_ns: u64) {
        self.spend_time(deadline_ns);
    }

    fn settle(&mut self, deadline_ns: u64) -> Result<(), Error> {
        self.settle_board(deadline_ns)
    }

    fn is_settled(&self) -> bool {
        self.setup.is_ready()
    }

    fn stop(&self) -> &StopInput {
        &self.stop
    }

    fn counters(&self) -> Counters {
        self.counters
    }
}
