//! RoboClaw as a drive family.

use std::sync::Arc;

use drives::{
    AXES, Capabilities, Command, Counters, DriveBus, Error, Firmware, StopInput, UnitAnswer, UnitCommand, UnitInfo,
};
use serial::{PortClock, Transport};

use super::{Bus, Drive, MAX_UNITS, watchdog_ms};
use crate::codec::Version;

impl<T: Transport> DriveBus for Bus<T> {
    fn port(&self) -> &Arc<str> {
        self.name()
    }

    fn unit_count(&self) -> usize {
        self.units.len()
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            velocity: true,
            torque: false,
            watchdog: true,
            // The units measure speeds, but the cycle has no time to read them beside the counts.
            speeds: false,
            currents: true,
            duties: true,
            supply: true,
            second_encoder: false,
        }
    }

    fn unit(&self, unit: usize) -> Option<UnitInfo> {
        let unit = self.units.get(unit)?;
        Some(UnitInfo {
            name: Arc::clone(&unit.name),
            firmware: unit.version.map(firmware),
            watchdog_ms: unit.watchdog_set.then_some(watchdog_ms(unit.config.watchdog_tenths)),
        })
    }

    fn now_ns(&self) -> u64 {
        self.transport.now_ns()
    }

    fn clock(&self) -> Option<Arc<PortClock>> {
        self.transport.clock()
    }

    fn can_run_inline(&self) -> bool {
        // Reading a status pin can block in the driver of an adapter.
        self.stop_pin.is_none()
    }

    fn set_inline(&mut self, inline: bool) {
        self.inline = inline;
        self.transport.set_inline(inline);
    }

    fn exchange(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        let mut drives = [[Drive::Idle; AXES]; MAX_UNITS];
        for (drives, commands) in drives.iter_mut().zip(commands) {
            *drives = commands.map(drive_of);
        }
        self.drive(&drives, deadline_ns, answers);
        for (index, (answer, commands)) in answers.iter_mut().zip(commands).enumerate() {
            if answer.outcome.is_ok() && commands.iter().flatten().any(|command| matches!(command, Command::Torque(_)))
            {
                let (port, unit) = (self.port(), self.unit_name(index));
                answer.outcome = Err(Error::Unsupported { port, unit, what: "torque command" });
            }
        }
    }

    fn spend(&mut self, deadline_ns: u64) {
        Bus::spend(self, deadline_ns);
    }

    fn settle(&mut self, deadline_ns: u64) -> Result<(), Error> {
        Bus::settle(self, deadline_ns)
    }

    fn is_settled(&self) -> bool {
        Bus::is_settled(self)
    }

    fn stop(&self) -> &StopInput {
        &self.stop
    }

    fn counters(&self) -> Counters {
        self.counters
    }
}

/// Command of the protocol for a neutral one. Torque, which the units do not have, releases the motor.
fn drive_of(command: Option<Command>) -> Drive {
    match command {
        None => Drive::Idle,
        Some(Command::Release | Command::Torque(_)) => Drive::RELEASE,
        // `as` saturates; the speed of a NaN is 0.
        Some(Command::Velocity(counts_s)) => Drive::Speed(counts_s.round() as i32),
    }
}

fn firmware(version: Version) -> Firmware {
    // A version text has at most 46 bytes.
    Firmware::from(version.as_str()).unwrap_or_default()
}
