//! Readings that change slowly: their questions are the last of a batch, and their answers are read in the time that a
//! cycle leaves.

use drives::{Error, Overdue, Timed};
use serial::Transport;

use super::Bus;
use super::parts::unacknowledged;
use crate::codec::{AXES, Answer, FULL_SPEED, Name, Numbers, fault};
use crate::status::neutral;

impl<T: Transport> Bus<T> {
    /// The last questions of the next batch.
    pub(super) fn slow_questions(&mut self) -> [Name; 2] {
        [Name::Faults, self.flags.question()]
    }

    /// Reads the answers to the last questions of a batch.
    pub(super) fn collect_tail(&mut self, deadline_ns: u64) -> Result<(), Error> {
        let Some(tail) = self.tail.take() else { return Ok(()) };
        let mut until_ns = tail.until_ns.min(deadline_ns);
        for name in tail.asks {
            let line = loop {
                match self.hear(until_ns)? {
                    Some(line) if unacknowledged(&line).is_none() => {}
                    None if until_ns < tail.until_ns && self.overdue.is_due(false, self.transport.now_ns()) => {
                        until_ns = tail.until_ns;
                    }
                    line => break line,
                }
            };
            let Some(line) = line else {
                self.counters.left_out += 1;
                return Ok(());
            };
            match Answer::parse(unacknowledged(&line).unwrap_or_default()) {
                Ok(Answer::Numbers(given, values)) if given == name => self.use_slow(name, &values, tail.at_ns),
                _ => {
                    self.counters.garbled += 1;
                    self.stray(&line);
                    return Ok(());
                }
            }
        }
        self.overdue = Overdue::default();
        Ok(())
    }

    fn use_slow(&mut self, name: Name, values: &Numbers, at_ns: u64) {
        let pair = <[i32; AXES]>::try_from(values.as_slice()).ok();
        match (name, values.as_slice(), pair) {
            (Name::Faults, [faults], _) => {
                if let Some(faults) = self.flags.faults.read(*faults) {
                    self.flags.sure = faults.cast_unsigned();
                    self.use_status(at_ns);
                }
            }
            (Name::MotorFaults, _, Some(motors)) => {
                if let Some(motors) = self.flags.motors.read(motors) {
                    self.flags.sure_motors = motors.map(i32::cast_unsigned);
                }
            }
            (Name::Watchdog, [time_ms], _) => {
                let time_ms = self.flags.watchdog.read(*time_ms);
                if time_ms.is_some_and(|time_ms| time_ms != i32::from(self.config.watchdog_ms)) {
                    self.setup.doubt();
                }
            }
            (Name::Amps, _, Some(tenths)) => {
                if let Some((tenths, at_ns)) = self.flags.amps.read(tenths, at_ns) {
                    self.report.currents_a = Timed { value: tenths.map(|tenths| f64::from(tenths) / 10.0), at_ns };
                }
            }
            (Name::Power, _, Some(power)) => {
                if let Some((power, at_ns)) = self.flags.power.read(power, at_ns) {
                    let value = power.map(|power| f64::from(power) / f64::from(FULL_SPEED));
                    self.report.duties = Timed { value, at_ns };
                }
            }
            (Name::Volts, &[internal, supply, output], _) => {
                if let Some(([_, tenths, _], at_ns)) = self.flags.volts.read([internal, supply, output], at_ns) {
                    self.report.supply_v = Timed { value: f64::from(tenths) / 10.0, at_ns };
                }
            }
            _ => self.counters.garbled += 1,
        }
    }

    /// Uses flags that were read twice.
    pub(super) fn use_flags(&mut self, faults: i32, motors: [i32; AXES], at_ns: u64) {
        (self.flags.sure, self.flags.sure_motors) = (faults.cast_unsigned(), motors.map(i32::cast_unsigned));
        self.use_status(at_ns);
    }

    fn use_status(&mut self, at_ns: u64) {
        let [one, two] = self.flags.sure_motors;
        self.report.status = Timed { value: neutral(self.flags.sure, [one, two]), at_ns };
        self.report.native_status = self.flags.sure | one << 8 | two << 16;
    }

    /// The controller reports an emergency stop.
    pub(super) fn is_stopped(&self) -> bool {
        self.flags.sure & fault::EMERGENCY_STOP != 0
    }
}
