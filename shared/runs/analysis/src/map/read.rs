//! Reads the samples of a run: those that the sensor logger recorded, and those that the same code computes from the
//! readings.

use super::flown::FlownPath;
use super::kinds::Kinds;
use super::merge::{Merge, Origin};
use crate::report::load_robot_file;
use crate::runs::progress;
use command::{Answer, Failure};
use config::{RobotFile, SensorLoggerSection};
use georeference::{Decoder, Logger, LoggerConfig};
use messages::{MotorAuthority, NodeEstimate, Sample};
use runlog::{Attachment, RecordedSample, RunClock, RunReader, system_file_text, utc};
use std::collections::HashMap;
use std::path::Path;

/// Which samples of a run are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// The recorded ones, and computed ones where the sensor logger recorded none.
    All,
    /// Every one computed again.
    Computed,
}

/// Returns the sensor settings of a run from its files.
///
/// # Errors
/// The run has no robot file, or a system file that cannot be used.
pub fn logger_config(run: &Path) -> Answer<LoggerConfig> {
    let (robot, section, _) = files_of(run)?;
    config(&robot, &section)
}

/// Resolves the sensor settings.
pub(super) fn config(robot: &RobotFile, section: &SensorLoggerSection) -> Answer<LoggerConfig> {
    Ok(LoggerConfig::from_section(section, &robot.robot().map_err(Failure::not_now)?))
}

/// Time of a run.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunTime {
    clock: Option<RunClock>,
    /// UNIX time of its first sample, ns.
    begin_ns: u64,
}

impl RunTime {
    /// Creates it from the clock of a run, and the time of its first sample for runs without one.
    pub(super) fn new(clock: Option<RunClock>, first_ns: u64) -> Self {
        // As in every other table of a run.
        Self { clock, begin_ns: clock.map_or(first_ns, |clock| clock.t0_unix_ns) }
    }

    /// Returns the UNIX time of a stamp, s; `None` if the run has no clock.
    pub(super) fn unix_s(&self, stamp_ns: u64) -> Option<f64> {
        Some(self.clock?.unix_of(stamp_ns) as f64 * 1e-9)
    }

    /// Returns UTC by ISO 8601 and the seconds since the run began of a stamp; `None` if the run has no clock.
    pub(super) fn of(&self, stamp_ns: u64) -> Option<(String, f64)> {
        let unix_ns = self.clock?.unix_of(stamp_ns);
        let seconds = utc(unix_ns).trim_end_matches(" UTC").replace(' ', "T");
        let since_s = (i128::from(unix_ns) - i128::from(self.begin_ns)) as f64 * 1e-9;
        Some((format!("{seconds}.{:06}Z", unix_ns % 1_000_000_000 / 1000), since_s))
    }
}

/// Reads the robot file of a run, the section `[sensor_logger]` of its system file, and its time.
pub(super) fn files_of(run: &Path) -> Answer<(RobotFile, SensorLoggerSection, RunTime)> {
    let mut reader = RunReader::open(run)?;
    // The attachments precede the first sample.
    let first_ns = reader.next_sample().map_err(Failure::not_now)?.map_or(0, |first| first.log_time_ns);
    let time = RunTime::new(reader.clock(), first_ns);
    let Some(robot) = load_robot_file(run, reader.attachments())?.filter(|file| file.robot().is_ok()) else {
        return Err(Failure::NotNow(format!(
            "{} has no robot.toml that this program accepts, so the robot is unknown",
            run.display()
        )));
    };
    Ok((robot, section_of(run, reader.attachments())?, time))
}

/// Returns the section `[sensor_logger]` of the system file of a run.
///
/// # Errors
/// The run cannot be read, or its system file cannot be used.
pub fn sensor_settings(run: &Path) -> Answer<SensorLoggerSection> {
    let mut reader = RunReader::open(run)?;
    // The attachments precede the first sample.
    reader.next_sample().map_err(Failure::not_now)?;
    section_of(run, reader.attachments())
}

fn section_of(run: &Path, inside: &[Attachment]) -> Answer<SensorLoggerSection> {
    let Some(text) = system_file_text(run, inside) else { return Ok(SensorLoggerSection::default()) };
    let table: toml::Table = text
        .parse()
        .map_err(|error| Failure::BadInput(format!("the system file of the run cannot be read: {error}")))?;
    match table.get("sensor_logger") {
        Some(section) => section.clone().try_into().map_err(|error| {
            Failure::BadInput(format!("[sensor_logger] in the system file of the run cannot be used: {error}"))
        }),
        None => Ok(SensorLoggerSection::default()),
    }
}

/// What was read of a run.
pub(super) struct Flown {
    /// The flown path.
    pub path: FlownPath,
    /// Names of the sensors.
    pub sensors: Vec<String>,
    /// Number of samples of all channels.
    pub read: u64,
    /// Number of samples of sensors that are left out, because their sensor has too many quantities.
    pub left_out: u64,
}

/// Passes the wanted samples of every sensor to `take` as name of the kind ([`Kinds`]), origin and sample, those of a
/// sensor in the order of their times, in memory that does not grow with the run. Reads no more than `most` samples of
/// all channels, so that a run that is still being recorded can be read twice.
///
/// # Errors
/// The run cannot be read.
pub(super) fn read_samples(
    run: &Path,
    config: &LoggerConfig,
    wanted: Wanted,
    most: u64,
    take: &mut dyn FnMut(&str, Origin, &Sample),
) -> Answer<Flown> {
    let mut reader = RunReader::open(run)?;
    let mut show = progress("reading");
    let mut kinds = Kinds::default();
    let take = &mut |sensor: &str, origin: Origin, sample: &Sample| {
        if let Some(kind) = kinds.name_of(sensor, sample) {
            take(kind, origin, sample);
        }
    };
    let mut samples = SampleReader {
        config,
        logger: Logger::new(config).map_err(Failure::not_now)?,
        numbers: HashMap::new(),
        decoded: Vec::new(),
        names: Vec::new(),
        wanted,
        waiting: Vec::new(),
        now_ns: 0,
        flown: Flown { path: FlownPath::new(), sensors: Vec::new(), read: 0, left_out: 0 },
    };
    while samples.flown.read < most {
        if samples.flown.read.is_multiple_of(4096) {
            show(reader.position(), reader.bytes());
        }
        let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? else { break };
        samples.flown.read += 1;
        samples.add(&recorded, take);
    }
    show(reader.bytes(), reader.bytes());
    samples.emit(u64::MAX, take);
    samples.release(u64::MAX, take);
    Ok(Flown { left_out: kinds.left_out, ..samples.flown })
}

/// The logger with the channels of a run.
struct SampleReader<'a> {
    config: &'a LoggerConfig,
    logger: Logger,
    /// Index of a channel's sensor in the logger by channel index; `None` if the channel cannot be used.
    numbers: HashMap<usize, Option<usize>>,
    /// Index of the channel whose type each sensor of the logger decodes.
    decoded: Vec<usize>,
    names: Vec<String>,
    wanted: Wanted,
    /// Of each sensor, by name.
    waiting: Vec<(String, Merge)>,
    now_ns: u64,
    flown: Flown,
}

impl SampleReader<'_> {
    fn add(&mut self, recorded: &RecordedSample<'_>, take: &mut dyn FnMut(&str, Origin, &Sample)) {
        let channel = recorded.channel.name.as_str();
        if let Some(slot) = ["node/estimate/a", "node/estimate/b"].iter().position(|name| *name == channel) {
            if let Some(estimate) = recorded.decode::<NodeEstimate>() {
                self.logger.estimate(slot, &estimate);
                self.now_ns = self.now_ns.max(estimate.header.stamp_ns);
                if estimate.valid == 1 {
                    self.flown.path.add(estimate.position_m);
                }
                self.emit(self.now_ns, take);
                self.release(self.now_ns, take);
            }
        } else if channel == "motor/authority" {
            if let Some(authority) = recorded.decode::<MotorAuthority>() {
                self.logger.authority(&authority);
            }
        } else if let Some(name) = channel.strip_prefix("sample/") {
            if let Some(sample) = recorded.decode::<Sample>() {
                add_name(&mut self.flown.sensors, name);
                if self.wanted == Wanted::All {
                    self.merge(name).add_recorded(&sample);
                    self.release(self.now_ns, take);
                }
            }
        } else if let Some(name) = channel.strip_prefix("sensor/") {
            let known = self.numbers.get(&recorded.index).copied();
            // Meanwhile the sensor may have had another type.
            let is_decoded =
                |number: &Option<usize>| number.is_none_or(|number| self.decoded.get(number) == Some(&recorded.index));
            let number = known.filter(is_decoded).unwrap_or_else(|| {
                add_name(&mut self.flown.sensors, name);
                let number = self.sensor(name, recorded);
                self.numbers.insert(recorded.index, number);
                number
            });
            if let Some(number) = number {
                self.logger.reading(number, recorded.sample, self.now_ns);
            }
        }
    }

    fn sensor(&mut self, name: &str, recorded: &RecordedSample<'_>) -> Option<usize> {
        let config = self.config.sensor(name)?;
        let channel = recorded.channel;
        let decoder = Decoder::new(&config, &channel.type_name, &channel.schema, recorded.sample.len()).ok()?;
        let number = self.logger.sensor(name, &config, decoder);
        if number == self.names.len() {
            self.names.push(name.to_owned());
            self.decoded.push(recorded.index);
        }
        self.decoded[number] = recorded.index;
        Some(number)
    }

    fn emit(&mut self, now_ns: u64, take: &mut dyn FnMut(&str, Origin, &Sample)) {
        while let Some((number, sample)) = self.logger.next_sample(now_ns) {
            let Some(name) = self.names.get(number).cloned() else { continue };
            match self.wanted {
                Wanted::All => {
                    let now_ns = self.now_ns;
                    self.merge(&name).add_computed(now_ns, &sample);
                }
                Wanted::Computed => take(&name, Origin::Computed, &sample),
            }
        }
    }

    fn merge(&mut self, name: &str) -> &mut Merge {
        let at = self.waiting.iter().position(|(known, _)| known == name).unwrap_or_else(|| {
            self.waiting.push((name.to_owned(), Merge::default()));
            self.waiting.len() - 1
        });
        &mut self.waiting[at].1
    }

    /// Passes the samples on that are due.
    fn release(&mut self, now_ns: u64, take: &mut dyn FnMut(&str, Origin, &Sample)) {
        for (name, merge) in &mut self.waiting {
            while let Some((origin, sample)) = merge.next(now_ns) {
                take(name, origin, &sample);
            }
        }
    }
}

fn add_name(sensors: &mut Vec<String>, name: &str) {
    if !sensors.iter().any(|known| known == name) {
        sensors.push(name.to_owned());
    }
}
