//! Reads the samples of a run: those that the sensor logger recorded, and those that the same code computes from the
//! readings.

use crate::report::load_robot_file;
use crate::runs::progress;
use command::{Answer, Failure};
use config::{RobotFile, SensorLoggerSection};
use georeference::{Decoder, Logger, LoggerConfig};
use messages::{MotorAuthority, NodeEstimate, Sample};
use runlog::{Attachment, RecordedSample, RunClock, RunReader, system_file_text, utc};
use std::collections::{HashMap, VecDeque};
use std::path::Path;

/// Minimum distance of points on the drawn path, m.
const STEP_M: f64 = 0.01;

/// Time around a recorded sample for which its sensor counts as recorded, ns: the sensor logger leaves out single
/// readings on purpose, and a restart takes longer.
const APART_NS: u64 = 2_000_000_000;
/// Age from which a stretch of recorded samples is forgotten, ns: readings arrive in about their order.
const LONG_NS: u64 = 60_000_000_000;

/// Origin of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Origin {
    /// Recorded in flight by the sensor logger.
    Recorded,
    /// Computed from readings and estimates.
    #[default]
    Computed,
}

/// Which samples of a run are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
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
    let Some(robot) = load_robot_file(run, reader.attachments()).filter(|file| file.robot().is_ok()) else {
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

/// Passes the wanted samples of every sensor to `take` as name, origin and sample, in memory that does not grow with
/// the run. Computed samples follow some seconds after the recorded ones of their time.
/// Adds the names of all sensors to `sensors` and returns the flown path.
///
/// # Errors
/// The run cannot be read.
pub fn read_samples(
    run: &Path,
    config: &LoggerConfig,
    wanted: Wanted,
    sensors: &mut Vec<String>,
    take: &mut dyn FnMut(&str, Origin, &Sample),
) -> Answer<Vec<[f64; 3]>> {
    let mut reader = RunReader::open(run)?;
    let mut show = progress("reading");
    let mut samples = SampleReader {
        config,
        logger: Logger::new(config).map_err(Failure::not_now)?,
        numbers: HashMap::new(),
        names: Vec::new(),
        wanted,
        waiting: Vec::new(),
        now_ns: 0,
        track: Vec::new(),
    };
    let mut count = 0_u64;
    loop {
        if count.is_multiple_of(4096) {
            show(reader.position(), reader.bytes());
        }
        count += 1;
        let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? else { break };
        samples.add(&recorded, sensors, take);
    }
    show(reader.bytes(), reader.bytes());
    samples.emit(u64::MAX, take);
    samples.release(u64::MAX, take);
    Ok(samples.track)
}

/// The logger with the channels of a run.
struct SampleReader<'a> {
    config: &'a LoggerConfig,
    logger: Logger,
    /// Index of a channel's sensor in the logger by channel index; `None` if the channel cannot be used.
    numbers: HashMap<usize, Option<usize>>,
    names: Vec<String>,
    wanted: Wanted,
    /// Of each sensor, by name.
    waiting: Vec<(String, Undecided)>,
    now_ns: u64,
    track: Vec<[f64; 3]>,
}

impl SampleReader<'_> {
    fn add(
        &mut self,
        recorded: &RecordedSample<'_>,
        sensors: &mut Vec<String>,
        take: &mut dyn FnMut(&str, Origin, &Sample),
    ) {
        let channel = recorded.channel.name.as_str();
        if let Some(slot) = ["node/estimate/a", "node/estimate/b"].iter().position(|name| *name == channel) {
            if let Some(estimate) = recorded.decode::<NodeEstimate>() {
                self.logger.estimate(slot, &estimate);
                self.now_ns = self.now_ns.max(estimate.header.stamp_ns);
                if estimate.valid == 1 && self.track.last().is_none_or(|last| is_apart(last, &estimate.position_m)) {
                    self.track.push(estimate.position_m);
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
                add_name(sensors, name);
                if self.wanted == Wanted::All {
                    self.undecided(name).is_recorded(sample.header.stamp_ns);
                    take(name, Origin::Recorded, &sample);
                }
            }
        } else if let Some(name) = channel.strip_prefix("sensor/") {
            if !self.numbers.contains_key(&recorded.index) {
                add_name(sensors, name);
                let number = self.sensor(name, recorded);
                self.numbers.insert(recorded.index, number);
            }
            if let Some(Some(number)) = self.numbers.get(&recorded.index) {
                self.logger.reading(*number, recorded.sample, self.now_ns);
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
        }
        Some(number)
    }

    fn emit(&mut self, now_ns: u64, take: &mut dyn FnMut(&str, Origin, &Sample)) {
        while let Some((number, sample)) = self.logger.next_sample(now_ns) {
            let Some(name) = self.names.get(number).cloned() else { continue };
            match self.wanted {
                Wanted::All => {
                    let now_ns = self.now_ns;
                    self.undecided(&name).computed.push_back((now_ns, sample));
                }
                Wanted::Computed => take(&name, Origin::Computed, &sample),
            }
        }
    }

    fn undecided(&mut self, name: &str) -> &mut Undecided {
        let at = self.waiting.iter().position(|(known, _)| known == name).unwrap_or_else(|| {
            self.waiting.push((name.to_owned(), Undecided::default()));
            self.waiting.len() - 1
        });
        &mut self.waiting[at].1
    }

    /// Passes the computed samples on whose time is known to have no recorded one.
    fn release(&mut self, now_ns: u64, take: &mut dyn FnMut(&str, Origin, &Sample)) {
        for (name, undecided) in &mut self.waiting {
            while let Some(sample) = undecided.next(now_ns) {
                take(name, Origin::Computed, &sample);
            }
        }
    }
}

/// Computed samples of a sensor that wait until it is known whether the sensor logger recorded any at their time.
#[derive(Default)]
struct Undecided {
    /// Each with the time at which it was computed, ns.
    computed: VecDeque<(u64, Sample)>,
    /// First and last stamp of stretches in which samples were recorded, ns.
    recorded: VecDeque<[u64; 2]>,
}

impl Undecided {
    fn is_recorded(&mut self, stamp_ns: u64) {
        self.forget_before(stamp_ns);
        match self.recorded.back_mut() {
            Some([from_ns, to_ns]) if is_near([*from_ns, *to_ns], stamp_ns) => {
                (*from_ns, *to_ns) = ((*from_ns).min(stamp_ns), (*to_ns).max(stamp_ns));
            }
            _ => self.recorded.push_back([stamp_ns; 2]),
        }
    }

    /// Drops the stretches long before a sample: they are no neighbours of later samples either.
    fn forget_before(&mut self, stamp_ns: u64) {
        while self.recorded.front().is_some_and(|[_, to_ns]| to_ns.saturating_add(LONG_NS) < stamp_ns) {
            self.recorded.pop_front();
        }
    }

    /// Returns the next sample that the sensor logger did not record.
    fn next(&mut self, now_ns: u64) -> Option<Sample> {
        while let Some((at_ns, sample)) = self.computed.front() {
            if at_ns.saturating_add(2 * APART_NS) > now_ns {
                return None;
            }
            let stamp_ns = sample.header.stamp_ns;
            self.forget_before(stamp_ns);
            let known = self.recorded.iter().any(|stretch| is_near(*stretch, stamp_ns));
            let (_, sample) = self.computed.pop_front()?;
            if !known {
                return Some(sample);
            }
        }
        None
    }
}

fn is_near([from_ns, to_ns]: [u64; 2], stamp_ns: u64) -> bool {
    (from_ns.saturating_sub(APART_NS)..=to_ns.saturating_add(APART_NS)).contains(&stamp_ns)
}

fn add_name(sensors: &mut Vec<String>, name: &str) {
    if !sensors.iter().any(|known| known == name) {
        sensors.push(name.to_owned());
    }
}

fn is_apart(a: &[f64; 3], b: &[f64; 3]) -> bool {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() > STEP_M * STEP_M
}
