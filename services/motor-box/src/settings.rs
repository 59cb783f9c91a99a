//! Configuration of the virtual box from the system file and the robot file.

use std::path::{Path, PathBuf};

use config::{DriveProtocol, MotorIoSection, RobotFile, SystemFile, Wire};
use plant::PlantConfig;
use plant::ground::{Cavity, Cylinder, Field, Ground, Peak, Prism};
use plant::line::IdlerConfig;
use plant::motor::MotorConfig;

use crate::device::{DeviceConfig, DeviceKind};
pub use crate::error::ConfigError;
use crate::section::{DeviceKind as Speaks, DeviceSection, FieldSection, GroundFile, MotorBoxSection, TruthSection};
use crate::world;

/// Placeholder for the domain's folder in a port's path.
const DOMAIN: &str = "{domain}";

/// Current limit of a drive as a multiple of its motor's continuous current; three is usual for brushed motors.
const PEAK_CURRENT_RATIO: f64 = 3.0;

/// One drive unit.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitConfig {
    /// Address of the unit on its port.
    pub address: u8,
    /// Cables (from 0) on motor 1 and motor 2.
    pub cables: [Option<usize>; 2],
    /// Input of a second encoder of its one cable.
    pub second_encoder: Option<u8>,
}

/// One serial port with the units on it.
#[derive(Debug, Clone, PartialEq)]
pub struct PortConfig {
    /// Name under which programs open it.
    pub link: PathBuf,
    /// Family of the units.
    pub family: DriveProtocol,
    /// How they are connected.
    pub wire: Wire,
    /// Baud rate of the wire.
    pub baud: u32,
    /// Torque that the units state per ampere, N m/A.
    pub torque_constant_n_m_a: Option<f64>,
    /// Units on the wire.
    pub units: Vec<UnitConfig>,
}

/// Configuration of the virtual motor box.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxConfig {
    /// The physics.
    pub plant: PlantConfig,
    /// Per cable: the count falls as cable pays out.
    pub reversed: Vec<bool>,
    /// The same of second encoders; empty: there are none.
    pub second_reversed: Vec<bool>,
    /// Serial ports of the drives.
    pub ports: Vec<PortConfig>,
    /// Time that a unit takes to answer, ns.
    pub turnaround_ns: u64,
    /// Control period of the program that drives the units, ns.
    pub period_ns: u64,
    /// Sensors on the node.
    pub devices: Vec<DeviceConfig>,
    /// Ground under the node, which the sensors measure.
    pub ground: Ground,
}

impl BoxConfig {
    /// Configuration from `system_file` and its `robot`, with its ports in `folder`.
    ///
    /// # Errors
    /// The system file is for real hardware, some of its ports are, or its `[motor_box]` is not accepted.
    pub fn from_files(system_file: &SystemFile, robot: &RobotFile, folder: &Path) -> Result<Self, ConfigError> {
        let section =
            MotorBoxSection::from_file(system_file, robot).map_err(|error| ConfigError::File(error.to_string()))?;
        let section = &section.ok_or(ConfigError::NoSection)?;
        let MotorIoSection { counts_per_m, second_counts_per_m, .. } = &system_file.motor_io;
        Ok(Self {
            plant: plant_config(section, robot, counts_per_m, second_counts_per_m),
            reversed: counts_per_m.iter().map(|&counts| counts < 0.0).collect(),
            second_reversed: second_counts_per_m.iter().map(|&counts| counts < 0.0).collect(),
            ports: port_configs(system_file, folder)?,
            turnaround_ns: (section.turnaround_s * 1e9).round() as u64,
            period_ns: (system_file.period_s() * 1e9).round() as u64,
            devices: section.device.iter().map(|device| device_config(device, folder)).collect(),
            ground: match &section.ground {
                Some(path) => ground_of(&GroundFile::load(path).map_err(|error| ConfigError::File(error.to_string()))?),
                None => {
                    let truth_m = section.truth.as_ref().and_then(|truth| truth.ground_m);
                    Ground { ground_m: truth_m.unwrap_or(robot.robot.ground_m), ..Ground::default() }
                }
            },
        })
    }
}

fn plant_config(
    section: &MotorBoxSection,
    robot: &RobotFile,
    counts_per_m: &[f64],
    second_counts_per_m: &[f64],
) -> PlantConfig {
    let mut config = PlantConfig::new(robot.robot.anchors_m.to_vec(), section.start_m.position_m);
    config.planar = robot.robot.anchors_m.is_planar();
    config.routed_length_m = robot.lines.routed_length_m.clone();
    config.routed_length_m.resize(config.cable_count(), 0.0);
    config.node.mass_kg = robot.robot.node_mass_kg;
    config.node.net_weight_n = robot.robot.net_weight_n;
    config.node.drag_n_s2_m2 = section.drag_n_s2_m2;
    config.node.ground_m = Some(robot.robot.ground_m);
    config.line.stiffness_n = section.stiffness_n;
    config.drum.radius_m = section.drum_radius_m;
    config.drum.line_diameter_m = section.line_diameter_m;
    // The drum of the robot file; a world has its own radius.
    if let Some(drum) = &robot.drum {
        config.drum.radius_m = 0.5 * drum.diameter_m;
        config.drum.line_diameter_m = drum.cable_diameter_m;
        config.drum.turns_per_layer = drum.turns_per_layer;
    }
    let longest_m = robot.robot.length_limits_m[1].min(100.0);
    config.drum.capacity_m = config.drum.capacity_m.max(longest_m + 10.0);
    config.drive.delay_s = section.delay_s;
    config.drive.lag_s = section.lag_s;
    config.supply_v = section.supply_v;
    config.seed = section.seed;
    config.motor = MotorConfig {
        force_constant_n_a: robot.motor.force_constant_n_a,
        resistance_ohm: robot.motor.resistance_ohm,
        gear_friction: robot.motor.gear_friction,
        coulomb_n: robot.motor.coulomb_n,
        viscous_n_s_m: robot.motor.viscous_n_s_m,
        transition_m_s: robot.motor.transition_m_s,
        current_limit_a: robot.motor.current_limit_a * PEAK_CURRENT_RATIO,
        ..MotorConfig::default()
    };
    let encoder = |counts: &f64| IdlerConfig { counts_per_m: counts.abs(), ..IdlerConfig::default() };
    config.idlers = counts_per_m.iter().map(encoder).collect();
    config.second_encoders = second_counts_per_m.iter().map(encoder).collect();
    config.start_limits_n = robot.robot.tension_limits_n;
    // Without the section, wheels, weight and counts of the robot file are part of the world too.
    let truth = section.truth.as_ref();
    let lines = &robot.lines;
    let more = !robot.robot.pulley_radius_m.is_empty()
        || lines.mass_kg_m > 0.0
        || lines.counts_stretched.any()
        || robot.drum.is_some();
    if truth.is_some() || more {
        world::apply(truth.unwrap_or(&TruthSection::default()), robot, counts_per_m, &mut config);
    }
    config
}

fn device_config(section: &DeviceSection, folder: &Path) -> DeviceConfig {
    let fields = || section.values.iter().map(field).collect();
    DeviceConfig {
        link: folder.join(&section.name),
        baud: section.baud,
        period_ns: (1e9 / section.rate_hz).round() as u64,
        latency_ns: (section.latency_s * 1e9).round() as u64,
        lever_m: section.lever_m,
        noise: section.noise,
        kind: match section.kind {
            Speaks::Tfmini => {
                DeviceKind::Tfmini { beam_rad: section.beam_deg.to_radians(), resolution_m: section.resolution_m }
            }
            Speaks::Line => DeviceKind::Line { template: section.template.clone(), fields: fields() },
            Speaks::Modbus => {
                DeviceKind::Modbus { unit_id: section.unit_id, register: section.register, fields: fields() }
            }
        },
    }
}

fn field(section: &FieldSection) -> Field {
    let peak = section.peak.map(|peak| Peak { at_m: peak.at_m, height: peak.height, radius_m: peak.radius_m });
    Field { base: section.base, slope_per_m: section.slope_per_m, peak }
}

/// Ground of a ground file.
#[must_use]
pub fn ground_of(file: &GroundFile) -> Ground {
    let cylinders = file.cylinder.iter().map(|section| Cylinder {
        center_m: section.center_m,
        radius_m: section.radius_m,
        height_m: section.height_m,
    });
    let prisms = file.prism.iter().map(|section| Prism {
        center_m: section.center_m,
        size_m: section.size_m,
        angle_rad: section.angle_deg.to_radians(),
        height_m: section.height_m,
        cavity: section.cavity.map(|cavity| Cavity {
            from_m: cavity.from_m,
            to_m: cavity.to_m,
            depth_m: cavity.depth_m,
        }),
    });
    Ground { ground_m: file.ground_m, cylinders: cylinders.collect(), prisms: prisms.collect() }
}

fn port_configs(system_file: &SystemFile, folder: &Path) -> Result<Vec<PortConfig>, ConfigError> {
    let mut ports = Vec::new();
    for port in &system_file.motor_io.ports {
        let name = port
            .path
            .strip_prefix(DOMAIN)
            .map(|rest| rest.trim_start_matches('/'))
            .filter(|rest| !rest.is_empty() && !rest.contains(".."))
            .ok_or_else(|| ConfigError::NotOurPort(port.path.clone()))?;
        let units = port
            .units
            .iter()
            .map(|unit| {
                let on_motor = |motor: usize| unit.cables.get(motor).and_then(|cable| cable.checked_sub(1));
                UnitConfig {
                    address: unit.address,
                    cables: [on_motor(0), on_motor(1)],
                    second_encoder: unit.second_encoder,
                }
            })
            .collect();
        ports.push(PortConfig {
            link: folder.join(name),
            family: port.protocol,
            wire: port.wire,
            baud: port.baud,
            torque_constant_n_m_a: port.torque_constant_n_m_a,
            units,
        });
    }
    Ok(ports)
}
