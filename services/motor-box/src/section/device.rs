//! Simulated sensors of the virtual motor box, each on its own serial port, and the ground that they measure.

use config::{ConfigError, Problem, number, toml_file};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// `[[motor_box.device]]`: a sensor on the node, with its own serial port.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceSection {
    /// NAME of its port `{domain}/NAME`.
    pub name: String,
    /// Protocol.
    pub kind: DeviceKind,
    /// Baud rate of its port.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Readings per second.
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
    /// Time from the measurement to the answer on its port, s.
    #[serde(default)]
    pub latency_s: f64,
    /// Position relative to the node, m.
    #[serde(default)]
    #[serde(deserialize_with = "config::exactly")]
    pub lever_m: [f64; 3],
    /// Standard deviation of its values, in their unit.
    #[serde(default)]
    pub noise: f64,
    /// `tfmini`: width of the beam, degrees.
    #[serde(default)]
    pub beam_deg: f64,
    /// `tfmini`: unit of its distance, m: 0.01, or 0.001 for a sensor in millimetre mode.
    #[serde(default = "default_resolution")]
    pub resolution_m: f64,
    /// `line`: the text line, with `{0}`, `{1}` .. for the values. A line that starts with `$` gets a NMEA 0183
    /// checksum.
    #[serde(default)]
    pub template: String,
    /// `modbus`: address, 1 to 247.
    #[serde(default = "default_unit")]
    pub unit_id: u8,
    /// `modbus`: holding and input register of the first value; each value is a float32 in two registers, high word
    /// first.
    #[serde(default)]
    pub register: u16,
    /// `line` and `modbus`: each value as a function of the position.
    #[serde(default, rename = "value")]
    pub values: Vec<FieldSection>,
}

config::choice! {
    /// Protocol of a device of the virtual motor box.
    pub enum DeviceKind {
        /// A Benewake TFmini or TF-Luna rangefinder that points straight down: frames of nine bytes.
        Tfmini = "tfmini",
        /// Text lines.
        Line = "line",
        /// Registers over Modbus RTU.
        Modbus = "modbus",
    }
}

/// `[[motor_box.device.value]]`: a quantity as a function of the position.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct FieldSection {
    /// Value at the origin.
    pub base: f64,
    /// Change per metre along x, y and z.
    #[serde(deserialize_with = "config::exactly")]
    pub slope_per_m: [f64; 3],
    /// A Gaussian peak.
    pub peak: Option<PeakSection>,
}

/// A Gaussian peak in a [`FieldSection`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PeakSection {
    /// Position of the maximum, m.
    #[serde(deserialize_with = "config::exactly")]
    pub at_m: [f64; 3],
    /// Value added at the maximum.
    pub height: f64,
    /// Standard deviation of the Gaussian, m.
    pub radius_m: f64,
}

/// A ground file: the objects on the ground under the robot.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundFile {
    /// Height of the ground, m.
    #[serde(default)]
    pub ground_m: f64,
    /// Upright cylinders.
    #[serde(default)]
    pub cylinder: Vec<CylinderSection>,
    /// Upright rectangular prisms.
    #[serde(default)]
    pub prism: Vec<PrismSection>,
}

/// `[[cylinder]]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CylinderSection {
    /// x and y of its axis, m.
    #[serde(deserialize_with = "config::exactly")]
    pub center_m: [f64; 2],
    /// Radius, m.
    pub radius_m: f64,
    /// Height above the ground, m.
    pub height_m: f64,
}

/// `[[prism]]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrismSection {
    /// x and y of its centre, m.
    #[serde(deserialize_with = "config::exactly")]
    pub center_m: [f64; 2],
    /// Size along its own axes, m.
    #[serde(deserialize_with = "config::exactly")]
    pub size_m: [f64; 2],
    /// Angle from the x axis of the site to its own x axis, counterclockwise, degrees.
    #[serde(default)]
    pub angle_deg: f64,
    /// Height above the ground, m.
    pub height_m: f64,
    /// A rectangular hole in its top.
    pub cavity: Option<CavitySection>,
}

/// `cavity` of a [`PrismSection`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CavitySection {
    /// One corner, in the axes of the prism, relative to its centre, m.
    #[serde(deserialize_with = "config::exactly")]
    pub from_m: [f64; 2],
    /// The opposite corner, m.
    #[serde(deserialize_with = "config::exactly")]
    pub to_m: [f64; 2],
    /// Depth below the top, m.
    pub depth_m: f64,
}

impl GroundFile {
    /// Reads and checks a ground file.
    ///
    /// # Errors
    /// The file is not accepted: one sentence with the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        toml_file::load_checked(path, Self::check)
    }

    fn check(&self) -> Result<(), Problem> {
        let near = |v: f64| v.abs() <= 1000.0;
        number("ground_m", self.ground_m, "within 1000 m of 0", near)?;
        for (index, cylinder) in self.cylinder.iter().enumerate() {
            cylinder.check().map_err(|problem| numbered(problem, "cylinder", index))?;
        }
        for (index, prism) in self.prism.iter().enumerate() {
            prism.check().map_err(|problem| numbered(problem, "prism", index))?;
        }
        Ok(())
    }
}

/// Moves a problem into the table with this index in the array `tables`.
fn numbered(problem: Problem, tables: &str, index: usize) -> Problem {
    problem.within(&format!("{tables}.{index}"), &format!("{tables} {}", index + 1))
}

fn check_center(center_m: &[f64; 2]) -> Result<(), Problem> {
    center_m.iter().try_for_each(|v| number("center_m", *v, "within 1000 m of 0", |v| v.abs() <= 1000.0))
}

fn check_size(key: &str, value: f64) -> Result<(), Problem> {
    number(key, value, "above 0, at most 1000 m", |v| v > 0.0 && v <= 1000.0)
}

impl CylinderSection {
    fn check(&self) -> Result<(), Problem> {
        check_center(&self.center_m)?;
        check_size("radius_m", self.radius_m)?;
        check_size("height_m", self.height_m)
    }
}

impl PrismSection {
    fn check(&self) -> Result<(), Problem> {
        check_center(&self.center_m)?;
        self.size_m.iter().try_for_each(|v| check_size("size_m", *v))?;
        number("angle_deg", self.angle_deg, "-360 to 360", |v| v.abs() <= 360.0)?;
        check_size("height_m", self.height_m)?;
        if let Some(cavity) = self.cavity {
            for corner in cavity.from_m.iter().chain(&cavity.to_m) {
                number("cavity", *corner, "corners within 1000 m of the prism's centre", |v| v.abs() <= 1000.0)?;
            }
            let depth = format!("above 0, at most the prism's height of {} m", self.height_m);
            number("cavity.depth_m", cavity.depth_m, &depth, |v| v > 0.0 && v <= self.height_m)?;
        }
        Ok(())
    }
}

/// Checks the devices; `ports` are the paths of the drives' ports.
pub(super) fn check(devices: &[DeviceSection], ports: &[String]) -> Result<(), Problem> {
    for (index, device) in devices.iter().enumerate() {
        let own = &device.name;
        let here =
            |problem: Problem| problem.within(&format!("motor_box.device.{index}"), &format!("device \"{own}\""));
        let fine = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        if own.is_empty() || own.len() > 16 || !own.bytes().all(fine) {
            let sentence = format!("`motor_box.device.name` is \"{own}\"; accepted: 1 to 16 of a-z, 0-9 and -");
            return Err(here(Problem::with_sentence("name", sentence)));
        }
        let port = format!("{{domain}}/{own}");
        if devices[..index].iter().any(|other| other.name == *own) || ports.contains(&port) {
            let sentence = format!("two ports of the virtual motor box are called \"{own}\"; accepted: each name once");
            return Err(here(Problem::with_sentence("name", sentence)));
        }
        check_device(device).map_err(here)?;
    }
    Ok(())
}

fn check_device(device: &DeviceSection) -> Result<(), Problem> {
    if !(1200..=3_000_000).contains(&device.baud) {
        return Err(Problem::with_clause("baud", format!("is {}; accepted: 1200 to 3000000", device.baud)));
    }
    number("rate_hz", device.rate_hz, "0.01 to 1000 readings per second", |v| (0.01..=1000.0).contains(&v))?;
    number("latency_s", device.latency_s, "0 to 2 s", |v| (0.0..=2.0).contains(&v))?;
    for value in device.lever_m {
        number("lever_m", value, "three lengths within 10 m", |v| v.abs() <= 10.0)?;
    }
    number("noise", device.noise, "0 to 1e6", |v| (0.0..=1e6).contains(&v))?;
    number("beam_deg", device.beam_deg, "0 to 90 degrees", |v| (0.0..=90.0).contains(&v))?;
    number("resolution_m", device.resolution_m, "0.01 or 0.001 m", |v| v == 0.01 || v == 0.001)?;
    for (index, field) in device.values.iter().enumerate() {
        field.check().map_err(|problem| numbered(problem, "value", index))?;
    }
    if device.kind != DeviceKind::Tfmini && !(1..=8).contains(&device.values.len()) {
        let sentence = format!("device \"{}\" has {} `value`s; accepted: 1 to 8", device.name, device.values.len());
        return Err(Problem::with_sentence("value", sentence));
    }
    if device.kind == DeviceKind::Line && (device.template.is_empty() || !device.template.is_ascii()) {
        let clause = "is empty or not plain ASCII; accepted: e.g. \"T={0} RH={1}\"";
        return Err(Problem::with_clause("template", clause));
    }
    if device.kind == DeviceKind::Modbus && !(1..=247).contains(&device.unit_id) {
        return Err(Problem::with_clause("unit_id", format!("is {}; accepted: 1 to 247", device.unit_id)));
    }
    Ok(())
}

impl FieldSection {
    fn check(&self) -> Result<(), Problem> {
        let near = |key: &str, value: &f64| number(key, *value, "numbers within 1e9", |v| v.abs() <= 1e9);
        near("base", &self.base)?;
        self.slope_per_m.iter().try_for_each(|value| near("slope_per_m", value))?;
        if let Some(peak) = &self.peak {
            peak.at_m.iter().try_for_each(|value| near("peak.at_m", value))?;
            near("peak.height", &peak.height)?;
            number("peak.radius_m", peak.radius_m, "0.001 to 1e4 m", |v| (1e-3..=1e4).contains(&v))?;
        }
        Ok(())
    }
}

fn default_baud() -> u32 {
    115_200
}
fn default_rate() -> f64 {
    10.0
}
fn default_resolution() -> f64 {
    0.01
}
fn default_unit() -> u8 {
    1
}
