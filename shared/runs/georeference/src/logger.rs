//! Readings wait for the estimate that is newer than they are, and become samples.

use messages::{MotorAuthority, NodeEstimate, Rule, SLOTS, Sample, blended_estimate, newer};
use std::collections::VecDeque;
use survey::SurveyError;
use survey::track::{Fix, Placing, Track, TrackOptions};

use crate::decode::Said;
use crate::{Decoder, LoggerConfig, SensorConfig};

/// Readings of one sensor that wait at most: what its channel holds, 2.5 s at 100 Hz.
const WAITING: usize = 256;

/// What became of the readings of a sensor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Readings taken.
    pub readings: u64,
    /// They have a place now.
    pub samples: u64,
    /// They said nothing new (stale).
    pub passed_over: u64,
    /// They were not what the channel's type says.
    pub malformed: u64,
    /// No estimate came that is newer, in the time that a reading waits, or too many were waiting.
    pub unplaced: u64,
    /// They were older than every estimate that is kept.
    pub old: u64,
    /// The estimates around them were too far apart, or the position was given anew between them.
    pub gaps: u64,
}

struct Sensor {
    name: String,
    decoder: Decoder,
    time_sigma_s: f64,
    /// With the time of arrival, ns.
    waiting: VecDeque<(u64, Said)>,
    counts: Counts,
}

/// Takes in estimates and readings, and gives samples.
pub struct Logger {
    track: Track,
    estimates: [Option<NodeEstimate>; SLOTS],
    authority: Option<MotorAuthority>,
    sensors: Vec<Sensor>,
    wait_ns: u64,
    /// Whose turn it is.
    turn: usize,
}

impl Logger {
    /// Without sensors.
    ///
    /// # Errors
    /// None with the track's own options.
    pub fn new(config: &LoggerConfig) -> Result<Self, SurveyError> {
        Ok(Self {
            track: Track::new(TrackOptions::default())?,
            estimates: [None; SLOTS],
            authority: None,
            sensors: Vec::new(),
            wait_ns: (config.section.wait_s * 1e9) as u64,
            turn: 0,
        })
    }

    /// Which slots are in charge.
    pub fn authority(&mut self, authority: &MotorAuthority) {
        self.authority = newer(self.authority, Some(*authority));
    }

    /// An estimate of a slot. Where there are two, what counts is what the robot acts on.
    pub fn estimate(&mut self, slot: usize, estimate: &NodeEstimate) {
        let Some(newest) = self.estimates.get_mut(slot) else { return };
        *newest = Some(*estimate);
        let [a, b] = &self.estimates;
        let newest = [a.as_ref(), b.as_ref()];
        let Some(node) = blended_estimate(self.authority.as_ref(), newest, Rule::History) else { return };
        if node.valid == 1 {
            self.track.note(&Fix {
                stamp_ns: node.header.stamp_ns,
                position_m: node.position_m,
                velocity_m_s: node.velocity_m_s,
                covariance_m2: node.covariance_m2,
                residual_m: node.residual_m,
                epoch: node.epoch,
            });
        }
    }

    /// A sensor from now on; its number. One that has come again, perhaps with another type, keeps its number and its counts.
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
        });
        self.sensors.len() - 1
    }

    /// A reading of a sensor, as it lies in memory, that arrived at `now_ns`.
    pub fn reading(&mut self, sensor: usize, bytes: &[u8], now_ns: u64) {
        let Some(sensor) = self.sensors.get_mut(sensor) else { return };
        sensor.counts.readings += 1;
        let Some(said) = sensor.decoder.decode(bytes) else {
            let malformed = bytes.len() != sensor.decoder.size();
            *(if malformed { &mut sensor.counts.malformed } else { &mut sensor.counts.passed_over }) += 1;
            return;
        };
        if sensor.waiting.len() == WAITING {
            sensor.waiting.pop_front();
            sensor.counts.unplaced += 1;
        }
        sensor.waiting.push_back((now_ns, said));
    }

    /// The next sample that is ready at `now_ns`, with the number of its sensor.
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
        while let Some((arrived_ns, said)) = sensor.waiting.front() {
            let placing = self.track.at(said.sample.header.stamp_ns, sensor.time_sigma_s, said.lever_m);
            let place = match placing {
                Placing::Early if now_ns < arrived_ns.saturating_add(self.wait_ns) => return None,
                Placing::At(place) => Some(place),
                Placing::Early => {
                    sensor.counts.unplaced += 1;
                    None
                }
                Placing::Old => {
                    sensor.counts.old += 1;
                    None
                }
                Placing::Gap => {
                    sensor.counts.gaps += 1;
                    None
                }
            };
            let mut sample = said.sample;
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

    /// Names and counts of the sensors, by their numbers.
    pub fn counts(&self) -> impl Iterator<Item = (&str, Counts)> {
        self.sensors.iter().map(|sensor| (sensor.name.as_str(), sensor.counts))
    }
}
