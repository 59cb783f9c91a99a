//! moteus as a drive family.

use std::sync::Arc;

use drives::{Capabilities, Counters, DriveBus, Error, StopInput, UnitAnswer, UnitCommand, UnitInfo};
use serial::{PortClock, Transport};

use super::Bus;

impl<T: Transport> DriveBus for Bus<T> {
    fn port(&self) -> &Arc<str> {
        self.transport.name()
    }

    fn unit_count(&self) -> usize {
        self.units.len()
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            velocity: true,
            torque: self.units.iter().all(|unit| unit.config.torque_constant_n_m_a > 0.0),
            watchdog: true,
            speeds: false,
            currents: true,
            duties: true,
            supply: true,
            second_encoder: true,
        }
    }

    fn unit(&self, unit: usize) -> Option<UnitInfo> {
        let unit = self.units.get(unit)?;
        Some(UnitInfo {
            name: Arc::clone(&unit.name),
            firmware: unit.firmware,
            watchdog_ms: unit.setup.has_watchdog().then_some(u32::from(unit.config.watchdog_ms)),
        })
    }

    fn now_ns(&self) -> u64 {
        self.transport.now_ns()
    }

    fn clock(&self) -> Option<Arc<PortClock>> {
        self.transport.clock()
    }

    fn exchange(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        self.exchange_all(commands, deadline_ns, answers);
    }

    fn spend(&mut self, deadline_ns: u64) {
        self.spend_time(deadline_ns);
    }

    fn settle(&mut self, deadline_ns: u64) -> Result<(), Error> {
        self.settle_units(deadline_ns)
    }

    fn is_settled(&self) -> bool {
        self.units.iter().all(|unit| unit.setup.is_ready() && unit.suspect.is_none())
    }

    fn stop(&self) -> &StopInput {
        &self.stop
    }

    fn counters(&self) -> Counters {
        self.counters
    }
}
