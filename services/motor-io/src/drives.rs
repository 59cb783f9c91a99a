//! Between the core and the drive units: velocities to counts per second, answers to the replies in [`MotorInput`].

use crate::core::DriveCommand;
use crate::settings::CoreConfig;
use config::{PortSection, SystemFile};
use messages::{CABLES, MotorInput, UNITS};
use roboclaw::driver::USB_MARGIN_NS;
use roboclaw::fleet::MAX_FLEET;
use roboclaw::{
    BusConfig, Drive, Error, Fleet, FleetCommand, PortConfig, Status, StatusPin, StopInput, UnitAnswer, UnitConfig,
};
use std::path::Path;

/// A motor cannot turn faster than this many times the fastest cable; an encoder that says so has jumped.
const FASTEST: f64 = 1.5;

/// In the order in which the times of reading are kept.
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
    /// When each of the slow values of a unit was last read: supply, status, currents, duties.
    slow_ns: [[u64; 4]; UNITS],
    trouble: Option<Error>,
    lost: Option<Error>,
    /// Of each unit that has not answered for several attempts: why.
    absent: [Option<Error>; UNITS],
}

impl Drives {
    /// Begins to look for the ports; returns at once. `{domain}` in a path stands for `domain_root`.
    ///
    /// # Errors
    /// Those of the configuration; a port that is not there is not one.
    pub fn open(system_file: &SystemFile, config: &CoreConfig, domain_root: &Path) -> Result<Self, Error> {
        let mut place = [(0, 0); CABLES];
        for (unit, section) in system_file.motor_io.ports.iter().flat_map(|port| &port.units).enumerate() {
            for (motor, cable) in section.cables.iter().enumerate() {
                if let Some(place) = place.get_mut(cable.wrapping_sub(1)) {
                    *place = (unit, motor);
                }
            }
        }
        let mut port = [0; UNITS];
        let on_port =
            system_file.motor_io.ports.iter().enumerate().flat_map(|(at, port)| port.units.iter().map(move |_| at));
        for (place, at) in port.iter_mut().zip(on_port) {
            *place = at;
        }
        let ports: Vec<PortConfig> =
            system_file.motor_io.ports.iter().map(|port| port_config(port, config, domain_root)).collect();
        Ok(Self {
            fleet: Fleet::open(&ports)?,
            place,
            cables: config.cable_count(),
            counts_per_m: config.counts_per_m,
            reboots: [0; UNITS],
            port,
            slow_ns: [[0; 4]; UNITS],
            trouble: None,
            lost: None,
            absent: [const { None }; UNITS],
        })
    }

    /// Sends the command, reads the encoders, and writes the answers into `input`; over by `deadline_ns`.
    pub fn exchange(&mut self, cycle: u64, command: &DriveCommand, deadline_ns: u64, input: &mut MotorInput) {
        let mut drives = [[Drive::Idle; 2]; MAX_FLEET];
        for i in 0..self.cables {
            let (unit, motor) = self.place[i];
            drives[unit][motor] = if command.released[i] {
                Drive::RELEASE
            } else {
                // `as` saturates, and the core lets only finite velocities through.
                Drive::Speed((command.speed_m_s[i] * self.counts_per_m[i]).round() as i32)
            };
        }
        let reply = self.fleet.exchange(&FleetCommand { cycle, drives }, deadline_ns);
        self.lost = reply.ports.iter().find_map(|port| port.lost.clone());
        for (unit, answer) in reply.units.iter().enumerate().take(UNITS) {
            input.unit[unit] = outcome(answer, &mut self.reboots[unit]);
            match &answer.outcome {
                Ok(()) => self.absent[unit] = None,
                Err(error) if error.is_silence() || error.is_lost() => self.absent[unit] = Some(error.clone()),
                Err(_) => {}
            }
            if let Err(error) = &answer.outcome {
                // What comes after the first error of a line is its way back.
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
            let stop = reply.ports.get(self.port[unit]).map_or(&StopInput::Unknown, |port| &port.stop);
            if *stop != StopInput::Unknown {
                // A button on the port stops all its units, as one on a unit does that one, and it is looked at in every cycle.
                input.slow_fresh[unit] |= MotorInput::SLOW_STATUS;
                input.status[unit] |= if stop.says_stop() { Status::EMERGENCY_STOP } else { 0 };
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
            // A drive's current and duty are positive where they turn the way its count rises. Ours: a current where it pulls the line
            // in, as in the motor model; a duty where line pays out.
            input.current_a[i] = -report.currents_a.value[motor] * self.counts_per_m[i].signum();
            input.duty[i] = report.duties.value[motor] * self.counts_per_m[i].signum();
        }
    }

    /// Time that virtual drives have left out so far, ns; 0 of real ones.
    #[must_use]
    pub fn left_out_ns(&self) -> u64 {
        self.fleet.left_out_ns()
    }

    /// What went wrong since the last call, the newest of it.
    pub fn trouble(&mut self) -> Option<Error> {
        self.trouble.take()
    }

    /// Why a unit that is needed does not answer: its port, and what comes from there.
    #[must_use]
    pub fn absent(&self) -> Option<&Error> {
        self.absent.iter().flatten().next()
    }

    /// The port that is not there, as of the last exchange.
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
        // This program came too late: that says nothing about the unit.
        Err(Error::Busy { .. } | Error::TooLate { .. }) => MotorInput::UNIT_LATE,
        Err(Error::NoAnswer { .. } | Error::Unanswered { .. }) => MotorInput::UNIT_SILENT,
        Err(_) => MotorInput::UNIT_RESYNC,
    }
}

fn port_config(port: &PortSection, config: &CoreConfig, domain_root: &Path) -> PortConfig {
    let unit = |section: &config::UnitSection| {
        let counts = section.cables.iter().filter_map(|cable| config.counts_per_m.get(cable.wrapping_sub(1)));
        let finest = counts.fold(0.0, |most: f64, counts| most.max(counts.abs()));
        UnitConfig {
            address: section.address,
            watchdog_tenths: (config.watchdog_s * 10.0).round() as u8,
            fastest_counts_s: (FASTEST * config.cable_speed_m_s * finest) as u32,
        }
    };
    PortConfig {
        path: port.path.replace("{domain}", &domain_root.to_string_lossy()),
        bus: BusConfig {
            baud: port.baud,
            margin_ns: USB_MARGIN_NS,
            units: port.units.iter().map(unit).collect(),
            stop_pin: port.stop_pin.and_then(|pin| StatusPin::named(pin.name())),
        },
    }
}
