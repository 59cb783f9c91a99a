//! What the virtual motor box has besides drives: sensors on serial ports of their own, and what they see.

use super::check::number;
use super::load::beside;
use crate::toml_file::{self, ConfigError};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// `[[motor_box.device]]`: a sensor on the node, behind a serial port of its own.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceSection {
    /// Its port is `{domain}/NAME`.
    pub name: String,
    /// What it speaks.
    pub kind: DeviceKind,
    /// Baud rate of its port.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Readings per second.
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
    /// From the measurement to the answer on its port, s.
    #[serde(default)]
    pub latency_s: f64,
    /// Where it is on the node, m.
    #[serde(default)]
    pub lever_m: [f64; 3],
    /// Standard deviation of its values, in their unit.
    #[serde(default)]
    pub noise: f64,
    /// `tfmini`: width of its beam, degrees.
    #[serde(default)]
    pub beam_deg: f64,
    /// `tfmini`: what it counts in, m: 0.01, or 0.001 for one that is set to millimetres.
    #[serde(default = "default_resolution")]
    pub resolution_m: f64,
    /// `line`: what it says, with `{0}`, `{1}` .. for the values; one that begins with `$` gets the checksum of NMEA 0183.
    #[serde(default)]
    pub template: String,
    /// `modbus`: its address, 1 to 247.
    #[serde(default = "default_unit")]
    pub unit_id: u8,
    /// `modbus`: holding and input register of the first value; each is a float32 in two registers, the high word first.
    #[serde(default)]
    pub register: u16,
    /// `line` and `modbus`: what each value is at a place.
    #[serde(default, rename = "value")]
    pub values: Vec<FieldSection>,
}

/// What a device of the virtual box speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceKind {
    /// A Benewake TFmini or TF-Luna that looks straight down: frames of nine bytes.
    Tfmini,
    /// Lines of text.
    Line,
    /// Registers over Modbus RTU.
    Modbus,
}

/// `[[motor_box.device.value]]`: a quantity that differs from place to place.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct FieldSection {
    /// At the origin.
    pub base: f64,
    /// Change per metre along x, y and z.
    pub slope_per_m: [f64; 3],
    /// A hill of Gaussian shape.
    pub peak: Option<PeakSection>,
}

/// A hill in a [`FieldSection`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PeakSection {
    /// Where it is highest, m.
    pub at_m: [f64; 3],
    /// How much it adds there.
    pub height: f64,
    /// Standard deviation of its shape, m.
    pub radius_m: f64,
}

/// A ground file: what stands on the ground under the robot.
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
    pub center_m: [f64; 2],
    /// Radius, m.
    pub radius_m: f64,
    /// From the ground to its top, m.
    pub height_m: f64,
}

/// `[[prism]]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrismSection {
    /// x and y of its middle, m.
    pub center_m: [f64; 2],
    /// Along its own axes, m.
    pub size_m: [f64; 2],
    /// From the site's x axis to its own, anticlockwise, degrees.
    #[serde(default)]
    pub angle_deg: f64,
    /// From the ground to its top, m.
    pub height_m: f64,
    /// A rectangular hole in its top.
    pub cavity: Option<CavitySection>,
}

/// `cavity` of a [`PrismSection`].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CavitySection {
    /// One corner, in the prism's own axes from its middle, m.
    pub from_m: [f64; 2],
    /// The opposite one, m.
    pub to_m: [f64; 2],
    /// From the top down, m.
    pub depth_m: f64,
}

impl GroundFile {
    /// Reads and checks a ground.
    ///
    /// # Errors
    /// One sentence that names the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let file: Self = toml_file::load(path)?;
        file.check().map_err(|problem| ConfigError::value(path, problem))?;
        Ok(file)
    }

    fn check(&self) -> Result<(), String> {
        let near = |v: f64| v.abs() <= 1000.0;
        number("ground_m", self.ground_m, "within 1000 m of 0", near)?;
        let (above, size) = ("above 0, at most 1000 m", |v: f64| v > 0.0 && v <= 1000.0);
        for cylinder in &self.cylinder {
            cylinder.center_m.iter().try_for_each(|v| number("center_m", *v, "within 1000 m of 0", near))?;
            number("radius_m", cylinder.radius_m, above, size)?;
            number("height_m", cylinder.height_m, above, size)?;
        }
        for prism in &self.prism {
            prism.center_m.iter().try_for_each(|v| number("center_m", *v, "within 1000 m of 0", near))?;
            prism.size_m.iter().try_for_each(|v| number("size_m", *v, above, size))?;
            number("angle_deg", prism.angle_deg, "-360 to 360", |v| v.abs() <= 360.0)?;
            number("height_m", prism.height_m, above, size)?;
            if let Some(cavity) = prism.cavity {
                for corner in cavity.from_m.iter().chain(&cavity.to_m) {
                    number("cavity", *corner, "corners within 1000 m of the prism's middle", near)?;
                }
                let depth = format!("above 0, at most the prism's height of {} m", prism.height_m);
                number("depth_m", cavity.depth_m, &depth, |v| v > 0.0 && v <= prism.height_m)?;
            }
        }
        Ok(())
    }
}

/// The devices of a box and the ground that they see; `folder` is that of the system file, and becomes part of the ground's path.
pub(super) fn check(
    devices: &[DeviceSection],
    ground: &mut Option<PathBuf>,
    folder: &Path,
    ports: &[String],
) -> Result<(), String> {
    if let Some(ground) = ground {
        *ground = beside(folder, ground);
        GroundFile::load(ground).map_err(|error| format!("`motor_box.ground`: {error}"))?;
    }
    for (index, device) in devices.iter().enumerate() {
        let own = &device.name;
        let fine = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        if own.is_empty() || own.len() > 16 || !own.bytes().all(fine) {
            return Err(format!("`motor_box.device.name` is \"{own}\"; accepted: 1 to 16 of a-z, 0-9 and -"));
        }
        let port = format!("{{domain}}/{own}");
        if devices[..index].iter().any(|other| other.name == *own) || ports.contains(&port) {
            return Err(format!("two ports of the virtual box are called \"{own}\"; accepted: each name once"));
        }
        of_one(device).map_err(|why| format!("device \"{own}\": {why}"))?;
    }
    Ok(())
}

fn of_one(device: &DeviceSection) -> Result<(), String> {
    if !(1200..=3_000_000).contains(&device.baud) {
        return Err(format!("`baud` is {}; accepted: 1200 to 3000000", device.baud));
    }
    number("rate_hz", device.rate_hz, "0.01 to 1000 readings per second", |v| (0.01..=1000.0).contains(&v))?;
    number("latency_s", device.latency_s, "0 to 2 s", |v| (0.0..=2.0).contains(&v))?;
    for value in device.lever_m {
        number("lever_m", value, "three lengths within 10 m", |v| v.abs() <= 10.0)?;
    }
    number("noise", device.noise, "0 to 1e6", |v| (0.0..=1e6).contains(&v))?;
    number("beam_deg", device.beam_deg, "0 to 90 degrees", |v| (0.0..=90.0).contains(&v))?;
    number("resolution_m", device.resolution_m, "0.01 or 0.001 m", |v| v == 0.01 || v == 0.001)?;
    for field in &device.values {
        let slopes = field.slope_per_m.iter();
        slopes.chain([&field.base]).try_for_each(|v| number("value", *v, "numbers within 1e9", |v| v.abs() <= 1e9))?;
        if let Some(peak) = field.peak {
            peak.at_m
                .iter()
                .chain([&peak.height])
                .try_for_each(|v| number("peak", *v, "numbers within 1e9", |v| v.abs() <= 1e9))?;
            number("radius_m", peak.radius_m, "0.001 to 1e4 m", |v| (1e-3..=1e4).contains(&v))?;
        }
    }
    if device.kind != DeviceKind::Tfmini && !(1..=8).contains(&device.values.len()) {
        return Err(format!("it has {} `value`s; accepted: 1 to 8", device.values.len()));
    }
    if device.kind == DeviceKind::Line && (device.template.is_empty() || !device.template.is_ascii()) {
        return Err("its `template` is empty or not plain ASCII; accepted: e.g. \"T={0} RH={1}\"".to_owned());
    }
    if device.kind == DeviceKind::Modbus && !(1..=247).contains(&device.unit_id) {
        return Err(format!("`unit_id` is {}; accepted: 1 to 247", device.unit_id));
    }
    Ok(())
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
