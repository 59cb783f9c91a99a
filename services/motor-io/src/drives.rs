//! Connection between the core and the drive units: velocities to counts per second, answers to the replies in
//! [`MotorInput`].

use crate::backend;
use crate::core::DriveCommand;
use crate::settings::CoreConfig;
use config::SystemFile;
use drives::{
    AXES, Capabilities, Command, DriveBus, DriveStatus, Error, Fleet, FleetCommand, MAX_FLEET, SecondEncoder,
    StopInput, UnitAnswer, UnitInfo,
};
use messages::{CABLES, MotorInput, UNITS};
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// Capabilities without which the robot cannot be driven: the control law commands velocities, and the watchdog of the
/// drives is what stops the motors when this process ends.
const NEEDED: Capabilities = Capabilities { velocity: true, watchdog: true, ..Capabilities::NONE };
/// Capabilities without which some fault of a cable is not detected.
const WATCHED: Capabilities = Capabilities { currents: true, duties: true, supply: true, ..Capabilities::NONE };

/// Values that are not read in every cycle, in the order of their times of reading.
const SLOW: [u8; 4] =
    [MotorInput::SLOW_SUPPLY, MotorInput::SLOW_STATUS, MotorInput::SLOW_CURRENT, MotorInput::SLOW_DUTY];

/// The drive units of a robot.
#[derive(Debug)]
pub struct Drives {
    fleet: Fleet,
    /// Unit and motor of each cable.
    place: [(usize, usize); CABLES],
    cables: usize,
    counts_per_m: [f64; CABLES],
    reboots: [u32; UNITS],
    /// Port of each unit.
    port: [usize; UNITS],
    /// Names of port and unit in messages.
    names: Vec<(Arc<str>, Arc<str>)>,
    /// Time of the last reading of each unit's supply, status, currents and duties, ns.
    slow_ns: [[u64; 4]; UNITS],
    trouble: Option<Error>,
    lost: Option<Error>,
    /// Reason why a unit has not answered several attempts.
    absent: [Option<Error>; UNITS],
    /// Last status of each unit, and the errors that were reported of it.
    conditions: [Conditions; UNITS],
    /// Second encoder of each cable.
    second: [Second; CABLES],
    /// A reading that the family does not offer, per port.
    unwatched: Vec<(Arc<str>, &'static str)>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Conditions {
    errors: DriveStatus,
    native: u32,
    reported: DriveStatus,
}

/// What was last read of a second encoder.
#[derive(Debug, Clone, Copy, Default)]
struct Second {
    breaks: u32,
}

impl Second {
    /// What a reading is; it belongs to counts of this time.
    fn state(&mut self, now: &SecondEncoder, counted_ns: u64) -> u8 {
        if !now.counts.is_known() || now.counts.at_ns != counted_ns {
            return MotorInput::SECOND_ABSENT;
        }
        let continued = std::mem::replace(&mut self.breaks, now.breaks) == now.breaks;
        if continued { MotorInput::SECOND_CONTINUED } else { MotorInput::SECOND_RESTARTED }
    }
}

/// Errors that a unit reports, in neutral words and with the unit's own status.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnitCondition {
    port: Arc<str>,
    unit: Arc<str>,
    errors: DriveStatus,
    native: u32,
}

impl fmt::Display for UnitCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { port, unit, errors, native } = self;
        write!(f, "{port}, {unit} reports: {errors} (its own status: {native:#x})")
    }
}

impl Drives {
    /// Starts to look for the ports; returns at once. `{domain}` in a path stands for `domain_root`.
    ///
    /// # Errors
    /// A configuration that the drive family does not have, or a family that lacks what the robot needs. A port that is
    /// not there is not an error, see [`Drives::lost`].
    pub fn open(system_file: &SystemFile, config: &CoreConfig, domain_root: &Path) -> Result<Self, Error> {
        let sections = &system_file.motor_io.ports;
        let mut place = [(0, 0); CABLES];
        for (unit, section) in sections.iter().flat_map(|port| &port.units).enumerate() {
            for (motor, cable) in section.cables.iter().enumerate().take(AXES) {
                if let Some(place) = place.get_mut(cable.wrapping_sub(1)) {
                    *place = (unit, motor);
                }
            }
        }
        let domain = domain_root.to_string_lossy();
        let buses = sections
            .iter()
            .map(|port| backend::open(port, &port.path.replace("{domain}", &domain), config))
            .collect::<Result<Vec<_>, _>>()?;
        let unwatched = buses
            .iter()
            .filter_map(|bus| Some((Arc::clone(bus.port()), bus.capabilities().first_missing(WATCHED)?)))
            .collect();
        let names = buses
            .iter()
            .flat_map(|bus| {
                (0..bus.unit_count()).filter_map(|unit| Some((Arc::clone(bus.port()), bus.unit(unit)?.name)))
            })
            .collect();
        let fleet = Fleet::open(buses, NEEDED)?;
        let mut port = [0; UNITS];
        for (unit, place) in port.iter_mut().enumerate() {
            *place = fleet.port_of(unit).unwrap_or(0);
        }
        Ok(Self {
            fleet,
            place,
            cables: config.cable_count(),
            counts_per_m: config.counts_per_m,
            reboots: [0; UNITS],
            port,
            names,
            slow_ns: [[0; 4]; UNITS],
            trouble: None,
            lost: None,
            absent: [const { None }; UNITS],
            conditions: [Conditions::default(); UNITS],
            second: [Second::default(); CABLES],
            unwatched,
        })
    }

    /// Sends the command, reads the encoders, and writes the answers into `input`; over by `deadline_ns`.
    pub fn exchange(&mut self, cycle: u64, command: &DriveCommand, deadline_ns: u64, input: &mut MotorInput) {
        let mut units = [[None; AXES]; MAX_FLEET];
        for i in 0..self.cables {
            let (unit, motor) = self.place[i];
            units[unit][motor] = Some(match command.current_a {
                _ if command.released[i] => Command::Release,
                // Positive raises the count: where that pays out, a pull is negative.
                Some(current_a) => Command::Torque(-current_a[i] * self.counts_per_m[i].signum()),
                None => Command::Velocity(command.encoder_m_s(i) * self.counts_per_m[i]),
            });
        }
        let reply = self.fleet.exchange(&FleetCommand { cycle, units }, deadline_ns);
        self.lost = reply.ports.iter().find_map(|port| port.lost.clone());
        for (unit, answer) in reply.units.iter().enumerate().take(UNITS) {
            input.unit[unit] = outcome(answer, &mut self.reboots[unit]);
            match &answer.outcome {
                Ok(()) => self.absent[unit] = None,
                Err(error) if error.is_silence() || error.is_lost() => self.absent[unit] = Some(error.clone()),
                Err(_) => {}
            }
            if let Err(error) = &answer.outcome {
                // Errors after the first one of a port belong to its resynchronisation.
                if !matches!(error, Error::Resynchronising { .. }) || self.trouble.is_none() {
                    self.trouble = Some(error.clone());
                }
            }
            let report = &answer.report;
            let read = [report.supply_v.at_ns, report.status.at_ns, report.currents_a.at_ns, report.duties.at_ns];
            input.slow_fresh[unit] = SLOW
                .iter()
                .zip(read.iter().zip(&self.slow_ns[unit]))
                .fold(0, |all, (bit, (now, then))| if now == then { all } else { all | bit });
            self.slow_ns[unit] = read;
            input.unit_alive[unit] = u8::from(report.was_alive);
            input.supply_v[unit] = if report.supply_v.is_known() { report.supply_v.value } else { f64::NAN };
            input.status[unit] = report.status.value.0;
            self.conditions[unit].errors = report.status.value.errors();
            self.conditions[unit].native = report.native_status;
            let stop = reply.ports.get(self.port[unit]).map_or(&StopInput::Unknown, |port| &port.stop);
            if *stop != StopInput::Unknown {
                // A button on the port stops all its units, as one on a unit stops that one. It is read in every cycle.
                input.slow_fresh[unit] |= MotorInput::SLOW_STATUS;
                input.status[unit] |= if stop.requires_stop() { DriveStatus::EMERGENCY_STOP } else { 0 };
            }
            if let StopInput::Unreadable(error) = stop {
                self.trouble = Some(error.clone());
            }
        }
        for i in 0..self.cables {
            let (unit, motor) = self.place[i];
            let Some(answer) = reply.units.get(unit) else { continue };
            let report = &answer.report;
            input.sampled_ns[i] = report.counts.at_ns;
            input.counts[i] = report.counts.value[motor];
            input.second_counts[i] = report.second.counts.value;
            input.second[i] = self.second[i].state(&report.second, report.counts.at_ns);
            // A drive's current and duty are positive in the direction in which its count rises. Ours: a current where
            // it pulls the cable in, as in the motor model; a duty where it pays the cable out.
            input.current_a[i] = -report.currents_a.value[motor] * self.counts_per_m[i].signum();
            input.duty[i] = report.duties.value[motor] * self.counts_per_m[i].signum();
        }
    }

    /// Uses the rest of the time of an exchange, until `early_ns` before its deadline, unless a thread of the port does
    /// so.
    pub fn spend(&mut self, early_ns: u64) {
        self.fleet.spend(early_ns);
    }

    /// Time that virtual drives have left out so far, ns; 0 for real ones.
    #[must_use]
    pub fn left_out_ns(&self) -> u64 {
        self.fleet.left_out_ns()
    }

    /// Newest failure since the last call.
    pub fn take_error(&mut self) -> Option<Error> {
        self.trouble.take()
    }

    /// Errors that a unit reports now and did not report at the last call; one unit per call.
    pub fn condition(&mut self) -> Option<UnitCondition> {
        self.conditions.iter_mut().zip(&self.names).find_map(|(now, (port, unit))| {
            let new = now.errors != now.reported;
            now.reported = now.errors;
            (new && now.errors.0 != 0).then(|| UnitCondition {
                port: Arc::clone(port),
                unit: Arc::clone(unit),
                errors: now.errors,
                native: now.native,
            })
        })
    }

    /// Port and name, firmware and watchdog of each unit, for the log.
    pub fn units(&self) -> impl Iterator<Item = (&Arc<str>, UnitInfo)> {
        self.names.iter().map(|(port, _)| port).zip(self.fleet.units())
    }

    /// Ports whose family does not offer a reading that faults are detected by, and the first such reading.
    pub fn missing_readings(&self) -> impl Iterator<Item = (&Arc<str>, &'static str)> {
        self.unwatched.iter().map(|(port, reading)| (port, *reading))
    }

    /// Reason why a unit does not answer, with its port.
    #[must_use]
    pub fn connection_error(&self) -> Option<&Error> {
        self.absent.iter().flatten().next()
    }

    /// A port that is not there, as of the last exchange.
    #[must_use]
    pub fn lost(&self) -> Option<&Error> {
        self.lost.as_ref()
    }
}

fn outcome(answer: &UnitAnswer, reboots: &mut u32) -> u8 {
    match &answer.outcome {
        Ok(()) if answer.report.reboots != *reboots => {
            *reboots = answer.report.reboots;
            MotorInput::UNIT_REBOOTED
        }
        Ok(()) => MotorInput::UNIT_OK,
        Err(error) if error.is_lost() => MotorInput::UNIT_LOST,
        Err(error) if error.is_silence() => MotorInput::UNIT_LOST,
        Err(Error::WatchdogRefused { .. }) => MotorInput::UNIT_LOST,
        // This program was too late; the unit may be fine.
        Err(Error::Busy { .. } | Error::TooLate { .. }) => MotorInput::UNIT_LATE,
        Err(Error::NoAnswer { .. } | Error::Unanswered { .. }) => MotorInput::UNIT_SILENT,
        Err(_) => MotorInput::UNIT_RESYNC,
    }
}
