//! The sensor file: port, protocol and values of a sensor.

use std::path::Path;

use config::toml_file::{Source, finite};
use config::{ConfigError, FileKind, Problem};
use serde::Deserialize;

use crate::VALUES;

/// Size of the field for the quantities of a reading, bytes.
const QUANTITY_BYTES: usize = 64;
/// Size of the field for the units of a reading, bytes.
const UNIT_BYTES: usize = 32;
/// Largest number of registers in one request (Modbus application protocol 1.1b3, 6.3).
const REGISTERS: u32 = 125;

/// A sensor file as written; it has exactly one of `[tfmini]`, `[line]` and `[modbus]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    /// Device, e.g. `/dev/serial/by-id/..`; `{domain}` is replaced by the robot's folder in shared memory, where the
    /// virtual motor box creates its ports.
    pub port: String,
    /// Baud rate.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Time from the measurement to the arrival of its reading, s.
    #[serde(default)]
    pub latency_s: f64,
    /// Position of the sensor relative to the node, in the axes of the site, m.
    #[serde(default)]
    #[serde(deserialize_with = "config::exactly")]
    pub lever_m: [f64; 3],
    /// Time without a reading after which the last one is repeated as stale, s.
    #[serde(default = "default_stale")]
    pub stale_s: f64,
    /// Settings of a TFmini or TF-Luna rangefinder.
    pub tfmini: Option<TfminiSection>,
    /// Settings of a device that sends text lines.
    pub line: Option<LineSection>,
    /// Settings of a Modbus device.
    pub modbus: Option<ModbusSection>,
    /// The values of `[line]` and `[modbus]`.
    #[serde(default, rename = "value")]
    pub values: Vec<ValueSection>,
}

/// The protocol of a file.
#[derive(Debug, Clone, Copy)]
pub enum ProtocolSection<'a> {
    /// `[tfmini]`.
    Tfmini(&'a TfminiSection),
    /// `[line]`.
    Line(&'a LineSection),
    /// `[modbus]`.
    Modbus(&'a ModbusSection),
}

/// `[tfmini]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TfminiSection {
    /// Unit of its distances, m: 0.01, or 0.001 for a sensor in millimetre mode.
    pub resolution_m: f64,
}

impl Default for TfminiSection {
    fn default() -> Self {
        Self { resolution_m: 0.01 }
    }
}

/// `[line]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineSection {
    /// Format of the text lines.
    pub format: LineFormat,
    /// `nmea`: name of the sentence, e.g. `MWV` from any talker or `WIMWV` from this one; other sentences are ignored.
    #[serde(default)]
    pub sentence: String,
    /// `csv`: separator of the columns.
    #[serde(default = "default_separator")]
    pub separator: char,
    /// `nmea` and `csv`: a field that marks the values as valid.
    pub valid: Option<ValidSection>,
}

/// `valid = { field = 5, is = "A" }`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidSection {
    /// Number of the field, from 1.
    pub field: usize,
    /// Its text if the values are valid.
    pub is: String,
}

config::choice! {
    /// Format of a text line.
    pub enum LineFormat {
        /// NMEA 0183 with a checksum, e.g. `$WIMWV,214.8,R,0.1,M,A*28`.
        Nmea = "nmea",
        /// Columns, e.g. `21.5,40.2`.
        Csv = "csv",
        /// Names with values, e.g. `T=21.5 RH=40.2`.
        KeyValue = "key-value",
    }
}

/// `[modbus]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModbusSection {
    /// Address of the device, 1 to 247.
    #[serde(default = "default_unit")]
    pub unit_id: u8,
    /// Table of the registers.
    #[serde(default)]
    pub table: RegisterTable,
    /// Requests per second.
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
}

config::choice! {
    /// A table of registers.
    #[derive(Default)]
    pub enum RegisterTable {
        /// Holding registers, function 3.
        #[default]
        Holding = "holding",
        /// Input registers, function 4.
        Input = "input",
    }
}

/// `[[value]]`: one value of a reading.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValueSection {
    /// Name of the quantity, e.g. `wind speed`.
    pub quantity: String,
    /// Unit, after `scale` and `offset`.
    pub unit: String,
    /// Factor applied to the value of the device.
    #[serde(default = "default_scale")]
    pub scale: f64,
    /// Offset added after the factor.
    #[serde(default)]
    pub offset: f64,
    /// `nmea` and `csv`: number of the field, from 1; the name of an NMEA sentence does not count.
    pub field: Option<usize>,
    /// `key-value`: name in the text line.
    pub key: Option<String>,
    /// `modbus`: register address as sent, from 0.
    pub register: Option<u16>,
    /// `modbus`: type of the number.
    #[serde(default)]
    pub number: NumberKind,
    /// `modbus`: whether a number of two registers has its low word first.
    #[serde(default)]
    pub swapped: bool,
}

config::choice! {
    /// Type of a number in registers.
    #[derive(Default)]
    pub enum NumberKind {
        /// Unsigned, one register.
        #[default]
        U16 = "u16",
        /// Signed, one register.
        I16 = "i16",
        /// Unsigned, two registers.
        U32 = "u32",
        /// Signed, two registers.
        I32 = "i32",
        /// Floating point, two registers.
        F32 = "f32",
    }
}

impl NumberKind {
    /// Returns the number of registers of the type.
    #[must_use]
    pub fn registers(self) -> u16 {
        match self {
            Self::U16 | Self::I16 => 1,
            Self::U32 | Self::I32 | Self::F32 => 2,
        }
    }
}

impl SensorFile {
    /// Reads and checks a sensor file.
    ///
    /// # Errors
    /// The file is not accepted: one sentence with the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let source = Source::read(path)?;
        FileKind::Sensor.expect(&source)?;
        let file: Self = source.parse()?;
        file.check().map_err(|problem| source.error(&problem))?;
        Ok(file)
    }

    /// Returns the protocol.
    #[must_use]
    pub fn protocol(&self) -> ProtocolSection<'_> {
        match (&self.tfmini, &self.line, &self.modbus) {
            (_, Some(line), _) => ProtocolSection::Line(line),
            (_, _, Some(modbus)) => ProtocolSection::Modbus(modbus),
            (Some(tfmini), ..) => ProtocolSection::Tfmini(tfmini),
            (None, None, None) => ProtocolSection::Tfmini(&TfminiSection { resolution_m: 0.01 }),
        }
    }

    /// Returns the quantities and the units of the values, in their order.
    #[must_use]
    pub fn quantities_and_units(&self) -> (Vec<&str>, Vec<&str>) {
        match self.protocol() {
            ProtocolSection::Tfmini(_) => (vec!["distance", "strength"], vec!["m", "1"]),
            _ => self.values.iter().map(|value| (value.quantity.as_str(), value.unit.as_str())).unzip(),
        }
    }

    /// Returns the number of requests per second.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.modbus.map_or(1.0, |section| section.rate_hz)
    }

    fn check(&self) -> Result<(), Problem> {
        let protocols =
            [("tfmini", self.tfmini.is_some()), ("line", self.line.is_some()), ("modbus", self.modbus.is_some())];
        let written: Vec<&str> = protocols.iter().filter(|(_, written)| *written).map(|(table, _)| *table).collect();
        if written.len() != 1 {
            let key = written.get(1).unwrap_or(&"port").to_owned();
            let sentence = "the file has none or several of [tfmini], [line] and [modbus]; accepted: one";
            return Err(Problem::with_sentence(key, sentence));
        }
        if self.port.is_empty() {
            return Err(Problem::with_clause("port", "is empty; accepted: a serial device"));
        }
        if !(1200..=3_000_000).contains(&self.baud) {
            return Err(Problem::with_clause("baud", format!("is {}; accepted: 1200 to 3000000", self.baud)));
        }
        within("latency_s", self.latency_s, "0 to 60 s", (0.0..=60.0).contains(&self.latency_s))?;
        within("stale_s", self.stale_s, "0.01 to 3600 s", (0.01..=3600.0).contains(&self.stale_s))?;
        for lever in self.lever_m {
            within("lever_m", lever, "three lengths within 100 m", lever.abs() <= 100.0)?;
        }
        if let Some(tfmini) = self.tfmini {
            let resolution_m = tfmini.resolution_m;
            let accepted = resolution_m == 0.01 || resolution_m == 0.001;
            within("tfmini.resolution_m", resolution_m, "0.01 or 0.001 m", accepted)?;
            if !self.values.is_empty() {
                let clause = "is not for [tfmini], which has a distance and a strength; accepted: none";
                return Err(Problem::with_clause("value", clause));
            }
            return Ok(());
        }
        self.check_values()?;
        match (&self.line, &self.modbus) {
            (Some(line), _) => self.check_line(line),
            (_, Some(modbus)) => self.check_modbus(modbus),
            _ => Ok(()),
        }
    }

    fn check_values(&self) -> Result<(), Problem> {
        if !(1..=VALUES).contains(&self.values.len()) {
            let sentence = format!("there are {} tables [[value]]; accepted: 1 to {VALUES}", self.values.len());
            return Err(Problem::with_sentence("value", sentence));
        }
        for (index, value) in self.values.iter().enumerate() {
            value.check().map_err(|problem| numbered(problem, index))?;
        }
        let (quantities, units) = self.quantities_and_units();
        for (key, words, room) in [("quantity", quantities, QUANTITY_BYTES), ("unit", units, UNIT_BYTES)] {
            let bytes = words.join(",").len();
            if bytes > room {
                let sentence =
                    format!("`{key}` of all values together has {bytes} bytes; accepted: {room}; use shorter words");
                return Err(Problem::with_sentence(format!("value.0.{key}"), sentence));
            }
        }
        Ok(())
    }

    fn check_line(&self, line: &LineSection) -> Result<(), Problem> {
        if line.format == LineFormat::Nmea && line.sentence.is_empty() {
            let clause = "is empty; accepted: the name of an NMEA sentence, e.g. \"MWV\"";
            return Err(Problem::with_clause("line.sentence", clause));
        }
        if line.valid.as_ref().is_some_and(|valid| valid.field == 0) {
            return Err(Problem::with_clause("line.valid", "has field 0; accepted: fields are numbered from 1"));
        }
        for (index, value) in self.values.iter().enumerate() {
            let (key, accepted, named) = match line.format {
                LineFormat::KeyValue => ("key", "`key`", value.key.as_deref().is_some_and(|key| !key.is_empty())),
                LineFormat::Nmea | LineFormat::Csv => {
                    ("field", "`field`, from 1", value.field.is_some_and(|field| field > 0))
                }
            };
            if !named {
                let sentence = format!("the value \"{}\" has no place; accepted: {accepted}", value.quantity);
                return Err(numbered(Problem::with_sentence(key, sentence), index));
            }
        }
        Ok(())
    }

    fn check_modbus(&self, modbus: &ModbusSection) -> Result<(), Problem> {
        if !(1..=247).contains(&modbus.unit_id) {
            return Err(Problem::with_clause("modbus.unit_id", format!("is {}; accepted: 1 to 247", modbus.unit_id)));
        }
        let accepted = "0.001 to 100 requests per second";
        within("modbus.rate_hz", modbus.rate_hz, accepted, (1e-3..=100.0).contains(&modbus.rate_hz))?;
        let mut range = (u32::MAX, 0);
        for (index, value) in self.values.iter().enumerate() {
            let Some(register) = value.register.map(u32::from) else {
                let sentence = format!("the value \"{}\" has no place; accepted: `register`", value.quantity);
                return Err(numbered(Problem::with_sentence("register", sentence), index));
            };
            range = (range.0.min(register), range.1.max(register + u32::from(value.number.registers())));
        }
        if range.1 > 0x1_0000 || range.1 - range.0 > REGISTERS {
            let sentence = format!(
                "`register` of the values is {} to {}; accepted: a range of at most {REGISTERS}, because one request reads all",
                range.0,
                range.1 - 1
            );
            return Err(Problem::with_sentence("value.0.register", sentence));
        }
        Ok(())
    }
}

impl ValueSection {
    fn check(&self) -> Result<(), Problem> {
        finite("scale", self.scale)?;
        finite("offset", self.offset)?;
        for (key, text) in [("quantity", &self.quantity), ("unit", &self.unit)] {
            if text.is_empty() || text.contains([',', '\0']) {
                return Err(Problem::with_clause(key, format!("is \"{text}\"; accepted: a word without commas")));
            }
        }
        Ok(())
    }
}

/// Moves a problem into the value with this index.
fn numbered(problem: Problem, index: usize) -> Problem {
    problem.within(&format!("value.{index}"), &format!("value {}", index + 1))
}

fn within(key: &str, value: f64, accepted: &str, ok: bool) -> Result<(), Problem> {
    if ok { Ok(()) } else { Err(Problem::with_clause(key, format!("is {value}; accepted: {accepted}"))) }
}

fn default_baud() -> u32 {
    115_200
}
fn default_stale() -> f64 {
    1.0
}
fn default_separator() -> char {
    ','
}
fn default_unit() -> u8 {
    1
}
fn default_rate() -> f64 {
    1.0
}
fn default_scale() -> f64 {
    1.0
}
