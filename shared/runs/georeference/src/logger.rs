//! Holds readings until a newer estimate arrives and turns them into samples.

use messages::{
    Header, MotorAuthority, NodeEstimate, Rule, SLOTS, Sample, SensorFlag, blended_estimate, name_at, newer, put_text,
    text_of,
};
use std::collections::VecDeque;
use survey::SurveyError;
use survey::track::{Fix, Track, TrackOptions, TrackPosition};

use crate::decode::{DecodedReading, VALUES};
use crate::{Decoder, Doubt, LoggerConfig, Place, Quality, SensorConfig};

/// Maximum number of waiting readings per sensor: the capacity of its channel, 2.5 s at 100 Hz.
const WAITING: usize = 256;
/// Maximum number of waiting flags; beyond it new ones are only counted in the next ones.
const FLAGS: usize = 256;

/// Readings of a sensor by outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Received readings.
    pub readings: u64,
    /// Readings that became samples with a position.
    pub samples: u64,
    /// Stale readings, which carry no new value.
    pub passed_over: u64,
    /// Readings that do not match the type of the channel.
    pub malformed: u64,
    /// Readings without a newer estimate within the waiting time, or displaced from a full queue.
    pub unplaced: u64,
    /// Readings older than all stored estimates.
    pub old: u64,
    /// Readings between estimates that are too far apart, or between which the position was set again.
    pub gaps: u64,
}

struct Sensor {
    name: String,
    decoder: Decoder,
    time_sigma_s: f64,
    /// Decoded readings with their time of arrival, ns.
    waiting: VecDeque<(u64, DecodedReading)>,
    counts: Counts,
    /// Judges of the values.
    quality: Vec<Quality>,
    /// The last reading, with its time of arrival, ns.
    last: Option<(u64, Sample)>,
}

/// Turns estimates and readings into georeferenced samples.
pub struct Logger {
    track: Track,
    estimates: [Option<NodeEstimate>; SLOTS],
    authority: Option<MotorAuthority>,
    sensors: Vec<Sensor>,
    wait_ns: u64,
    /// Index of the sensor to serve next.
    turn: usize,
    /// Flags with the index of their sensor.
    flags: VecDeque<(usize, SensorFlag)>,
}

impl Logger {
    /// Creates a logger without sensors.
    ///
    /// # Errors
    /// None with the default options of the track.
    pub fn new(config: &LoggerConfig) -> Result<Self, SurveyError> {
        Ok(Self {
            track: Track::new(TrackOptions::default())?,
            estimates: [None; SLOTS],
            authority: None,
            sensors: Vec::new(),
            wait_ns: (config.section.wait_s * 1e9) as u64,
            turn: 0,
            flags: VecDeque::with_capacity(FLAGS),
        })
    }

    /// Records which slots are in charge.
    pub fn authority(&mut self, authority: &MotorAuthority) {
        self.authority = newer(self.authority, Some(*authority));
    }

    /// Records an estimate of a slot. With two slots, the track follows the estimate that the robot acts on.
    pub fn estimate(&mut self, slot: usize, estimate: &NodeEstimate) {
        let Some(newest) = self.estimates.get_mut(slot) else { return };
        *newest = Some(*estimate);
        let [a, b] = &self.estimates;
        let newest = [a.as_ref(), b.as_ref()];
        let Some(node) = blended_estimate(self.authority.as_ref(), newest, Rule::History) else { return };
        if node.valid == 1 {
            self.track.add(&Fix {
                stamp_ns: node.header.stamp_ns,
                position_m: node.position_m,
                velocity_m_s: node.velocity_m_s,
                covariance_m2: node.covariance_m2,
                residual_m: node.residual_m,
                epoch: node.epoch,
            });
        }
    }

    /// Adds a sensor and returns its index. A sensor that reappears, perhaps with another type, keeps its index and
    /// counts.
    pub fn sensor(&mut self, name: &str, config: &SensorConfig, decoder: Decoder) -> usize {
        if let Some(known) = self.sensors.iter().position(|sensor| sensor.name == name) {
            self.sensors[known].decoder = decoder;
            return known;
        }
        self.sensors.push(Sensor {
            name: name.to_owned(),
            decoder,
            time_sigma_s: config.time_sigma_s,
            waiting: VecDeque::with_capacity(WAITING),
            counts: Counts::default(),
            quality: (0..VALUES).map(|value| Quality::new(config.section.range.get(value).copied())).collect(),
            last: None,
        });
        self.sensors.len() - 1
    }

    /// Records the raw bytes of a reading that arrived at `now_ns`.
    pub fn reading(&mut self, number: usize, bytes: &[u8], now_ns: u64) {
        let Some(sensor) = self.sensors.get_mut(number) else { return };
        sensor.counts.readings += 1;
        let Some(reading) = sensor.decoder.decode(bytes) else {
            let malformed = bytes.len() != sensor.decoder.size();
            *(if malformed { &mut sensor.counts.malformed } else { &mut sensor.counts.passed_over }) += 1;
            return;
        };
        if sensor.waiting.len() == WAITING {
            sensor.waiting.pop_front();
            sensor.counts.unplaced += 1;
        }
        sensor.waiting.push_back((now_ns, reading));
        sensor.last = Some((now_ns, reading.sample));
        let judge = |quality: &mut Quality, value: usize, found: &mut dyn FnMut(Place)| {
            // What has no value is judged by its number, which has no flags but gaps.
            let sample = &reading.sample;
            let value = if sample.count == 0 { sample.reading_seq as f64 } else { sample.value[value] };
            quality.add(sample.header.stamp_ns, value, &mut |place| found(place));
        };
        judge_values(&mut self.flags, number, sensor, now_ns, judge);
    }

    /// Records the header of a blob that arrived at `now_ns`.
    pub fn blob(&mut self, number: usize, header: &Header, now_ns: u64) {
        self.reading(number, bytemuck::bytes_of(header), now_ns);
    }

    /// Judges how long each sensor has been silent at `now_ns`.
    pub fn silence(&mut self, now_ns: u64) {
        for (number, sensor) in self.sensors.iter_mut().enumerate() {
            let Some((arrived_ns, _)) = sensor.last else { continue };
            let silence_s = now_ns.saturating_sub(arrived_ns) as f64 * 1e-9;
            let judge = |quality: &mut Quality, _, found: &mut dyn FnMut(Place)| {
                quality.silent(silence_s, &mut |place| found(place));
            };
            judge_values(&mut self.flags, number, sensor, now_ns, judge);
        }
    }

    /// Returns the next flag with the index of its sensor.
    pub fn next_flag(&mut self) -> Option<(usize, SensorFlag)> {
        self.flags.pop_front()
    }

    /// Returns the next sample that is ready at `now_ns`, with the index of its sensor.
    pub fn next_sample(&mut self, now_ns: u64) -> Option<(usize, Sample)> {
        for _ in 0..self.sensors.len() {
            if let Some(sample) = self.sample_of(self.turn, now_ns) {
                return Some((self.turn, sample));
            }
            self.turn = (self.turn + 1) % self.sensors.len();
        }
        None
    }

    fn sample_of(&mut self, sensor: usize, now_ns: u64) -> Option<Sample> {
        let sensor = self.sensors.get_mut(sensor)?;
        while let Some((arrived_ns, reading)) = sensor.waiting.front() {
            let placing = self.track.at(reading.sample.header.stamp_ns, sensor.time_sigma_s, reading.lever_m);
            let place = match placing {
                TrackPosition::Early if now_ns < arrived_ns.saturating_add(self.wait_ns) => return None,
                TrackPosition::At(place) => Some(place),
                TrackPosition::Early => {
                    sensor.counts.unplaced += 1;
                    None
                }
                TrackPosition::Old => {
                    sensor.counts.old += 1;
                    None
                }
                TrackPosition::Gap => {
                    sensor.counts.gaps += 1;
                    None
                }
            };
            let mut sample = reading.sample;
            sensor.waiting.pop_front();
            if let Some(place) = place {
                sensor.counts.samples += 1;
                sample.position_m = place.position_m;
                sample.position_std_m = place.std_m();
                return Some(sample);
            }
        }
        None
    }

    /// Returns names and counts of the sensors by index.
    pub fn counts(&self) -> impl Iterator<Item = (&str, Counts)> {
        self.sensors.iter().map(|sensor| (sensor.name.as_str(), sensor.counts))
    }
}

/// Judges each value of the last reading of a sensor, and queues what is found.
fn judge_values(
    flags: &mut VecDeque<(usize, SensorFlag)>,
    number: usize,
    sensor: &mut Sensor,
    now_ns: u64,
    judge: impl Fn(&mut Quality, usize, &mut dyn FnMut(Place)),
) {
    let Some((_, sample)) = &sensor.last else { return };
    for (value, quality) in sensor.quality.iter_mut().take(usize::from(sample.count.max(1))).enumerate() {
        let mut places = [None; Doubt::COUNT];
        judge(quality, value, &mut |place| places[usize::from(place.doubt.kind())] = Some(place));
        for place in places.into_iter().flatten().take(FLAGS - flags.len()) {
            flags.push_back((number, flag(sample, value, &place, quality.tally(place.doubt).count, now_ns)));
        }
    }
}

fn flag(sample: &Sample, value: usize, place: &Place, count: u64, now_ns: u64) -> SensorFlag {
    let mut flag = SensorFlag {
        header: Header::at(now_ns),
        begin_ns: place.begin_ns,
        end_ns: place.end_ns.unwrap_or_default(),
        size: place.size,
        count,
        kind: place.doubt.kind(),
        number: value as u8 + 1,
        ..SensorFlag::default()
    };
    put_text(&mut flag.quantity, name_at(&text_of(&sample.quantity), value));
    put_text(&mut flag.unit, name_at(&text_of(&sample.unit), value));
    flag
}
