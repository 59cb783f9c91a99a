//! Collects all data of the page in one pass over the run, in memory that does not grow with the run.

use super::deviation::Deviations;
use super::events::Events;
use super::in_charge::InCharge;
use super::legs::Legs;
use super::losses::Losses;
use super::samples::Sensors;
use super::trace::{DecimatedPoints, Trace};
use super::wear::WearSum;
use crate::accuracy::{AccuracySum, Analysis, Distances};
use crate::counters::PeriodCounter;
use crate::incidents::Incidents;
use crate::run_time::RunTime;
use crate::tracker::{Cycle, Tracker};
use cable_robot::{Robot, Vector3};
use command::{Answer, Failure};
use georeference::SensorMap;
use hdrhistogram::Histogram;
use messages::{
    CABLES, Heartbeat, LogEvent, MotorAuthority, MotorState, OperatorRequest, PlanStatus, ProcessState, RecorderStatus,
    SystemConfig, text_of,
};
use robot_state::{DriveUnit, Periods, Reason};
use runlog::{RecordedSample, RunInspection, RunReader, RunReport};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Minimum silence of the control cycle that interrupts a curve, s.
const CYCLE_GAP_S: f64 = 0.5;
/// Channels that the page needs, with the part that is missing without them.
const NEEDED_CHANNELS: [(&str, &str); 7] = [
    ("motor/authority", "modes, timing and legs"),
    ("motor/state", "lengths, speeds and currents of the cables"),
    ("node/estimate/", "the flown path"),
    ("control/status/", "the chosen tensions"),
    ("plan/motion", "setpoints and legs"),
    ("energy", "power and energy"),
    ("recorder/status", "the recorder's statistics"),
];

/// Times of one step of the cycle.
pub struct StepTimes {
    /// Over the run, s.
    pub trace: Trace,
    /// Distribution, ns.
    pub all: Histogram<u64>,
}

impl StepTimes {
    /// `None` only for invalid bounds of the histogram.
    fn new() -> Option<Self> {
        // Up to a minute, with two significant digits.
        Histogram::new_with_bounds(1, 60_000_000_000, 2).ok().map(|all| Self { trace: Trace::new(CYCLE_GAP_S), all })
    }

    fn add(&mut self, time_s: f64, ns: u64) {
        self.trace.add(time_s, ns as f64 * 1e-9);
        self.all.saturating_record(ns);
    }
}

/// Data of one cable.
pub struct CableData {
    /// Cable length, m.
    pub length: Trace,
    /// Measured dL/dt, m/s.
    pub velocity: Trace,
    /// Estimated tension, N.
    pub tension: Trace,
    /// True tension, N.
    pub true_tension: Trace,
    /// Motor current, A.
    pub current: Trace,
    /// Electrical energy since the start, J.
    pub energy_j: f64,
    /// Loss in the motor since the start, J.
    pub loss_j: f64,
    /// Difference of commanded and measured velocity during motions, m/s.
    pub lag: Distances,
}

impl CableData {
    fn new() -> Self {
        let trace = || Trace::new(CYCLE_GAP_S);
        Self {
            length: trace(),
            velocity: trace(),
            tension: trace(),
            true_tension: trace(),
            current: trace(),
            energy_j: 0.0,
            loss_j: 0.0,
            lag: Distances::default(),
        }
    }

    /// Adds the values of a cycle for the cable with this index.
    fn add(&mut self, time_s: f64, cycle: &Cycle<'_>, index: usize) {
        if let Some(state) = cycle.state {
            // While the position is unknown, the values count from zero and are not lengths.
            if state.position_known != MotorState::POSITION_UNKNOWN {
                self.length.add(time_s, state.length_m[index]);
            }
            self.velocity.add(time_s, state.velocity_m_s[index]);
            self.current.add(time_s, state.current_a[index]);
            if cycle.moving {
                self.lag.add((state.command_m_s[index] - state.velocity_m_s[index]).abs());
            }
        }
        if let Some(estimate) = cycle.estimate {
            self.tension.add(time_s, estimate.tension_n[index]);
        }
        if let Some(energy) = cycle.energy {
            (self.energy_j, self.loss_j) = (energy.energy_j[index], energy.loss_j[index]);
        }
    }
}

/// Last status of a mission.
pub struct Mission {
    /// `PlanStatus::STATE_*`.
    pub state: u8,
    /// Name of the mission.
    pub name: String,
    /// Completed share, 0 to 1.
    pub progress: f64,
    /// Reason for an abort or a rejection; `None` also in a run of an earlier version.
    pub why: Option<Reason>,
    /// The same as a sentence.
    pub sentence: String,
    /// Start of the current state, s since the start of the run.
    pub since_s: f64,
}

/// Setpoint, estimate and truth of one cycle, m.
pub type PathPoint = [Option<Vector3<f64>>; 3];

/// Data of a run.
pub struct RunData {
    /// Name of the folder or file.
    pub name: String,
    /// Contents and condition of the files.
    pub recording: RunReport,
    /// Missing data, one sentence each.
    pub lacks: Vec<String>,
    /// The robot, if its file is available.
    pub robot: Option<Robot>,
    /// Name of the world of a virtual run.
    pub world: Option<String>,
    /// Accuracy; `None` if nothing moved.
    pub analysis: Option<Analysis>,
    /// Last `motor/authority`.
    pub authority: Option<MotorAuthority>,
    /// Data of the cables.
    pub cables: Vec<CableData>,
    /// Distance of estimate and truth from the setpoint, and of the truth from the estimate, m.
    pub errors: [Trace; 3],
    /// Decimated path.
    pub path: Vec<PathPoint>,
    /// Electrical power and loss of all motors, W.
    pub power: [Trace; 2],
    /// Periods of missions over all lives of motor-io.
    pub periods: Periods,
    /// Accumulated lost periods, by cause.
    pub losses: [Trace; 4],
    /// Stretches of lost periods.
    pub lost: Losses,
    /// Times of a cycle: tick to wake-up, bus exchange, oldest reading to command, publication of the state to that of
    /// the command that answers it.
    pub times: [StepTimes; 4],
    /// Rate of the plan clock.
    pub rate: Trace,
    /// Modes with start and end, s.
    pub modes: Vec<(f64, f64, u8)>,
    /// Slots in charge of controller and estimator with start and end, s.
    pub slots: Vec<(f64, f64, [u8; 2])>,
    /// Flown legs.
    pub legs: Legs,
    /// Largest deviations of the run and of its legs.
    pub deviations: Deviations,
    /// Controllers and estimators in charge.
    pub in_charge: InCharge,
    /// Drive units as they answered at the start of each life of motor-io, without repetition.
    pub units: Vec<DriveUnit>,
    /// Sums of the figures that are compared with other runs.
    pub wear: WearSum,
    /// Events.
    pub events: Events,
    /// Faults with their causes and what followed.
    pub incidents: Incidents,
    /// Last heartbeat of each process.
    pub processes: BTreeMap<String, Heartbeat>,
    /// Sensor readings and samples.
    pub sensors: Sensors,
    /// Sensor maps, by sensor name.
    pub maps: BTreeMap<String, SensorMap>,
    /// Last recorder status of each channel.
    pub recorder: BTreeMap<String, RecorderStatus>,
    /// Least free disk space, bytes.
    pub least_free_bytes: Option<u64>,
    /// Last status of the mission.
    pub mission: Option<Mission>,
    /// Unrecorded time before the first and after the last sample according to the supervisor, s.
    pub unrecorded_ends_s: [f64; 2],
    /// Reason for the end of the run from its manifest.
    pub end_reason: Option<String>,
    /// Number of times that each mission was completed.
    pub missions: BTreeMap<String, u32>,
}

impl RunData {
    /// Returns the unrecorded time of the run, s.
    #[must_use]
    pub fn unrecorded_s(&self) -> f64 {
        self.recording.unrecorded_s + self.unrecorded_ends_s.iter().sum::<f64>()
    }

    /// Returns a time since the start of the run as UTC.
    #[must_use]
    pub fn utc(&self, time_s: f64) -> Option<String> {
        let begin_ns = self.recording.begin_unix_ns?;
        Some(runlog::utc(begin_ns.saturating_add_signed((time_s * 1e9) as i64)))
    }

    /// Extends the last spans of mode and slots to this cycle, or starts new ones.
    fn mode_and_slots(&mut self, time_s: f64, authority: &MotorAuthority) {
        let same = |last: Option<&mut (f64, f64, u8)>| {
            last.is_some_and(|(_, to_s, mode)| {
                let same = *mode == authority.mode;
                *to_s = time_s;
                same
            })
        };
        if !same(self.modes.last_mut()) {
            self.modes.push((time_s, time_s, authority.mode));
        }
        let charge = [authority.active_controller, authority.active_estimator];
        match self.slots.last_mut() {
            Some((_, to_s, slots)) if *slots == charge => *to_s = time_s,
            last => {
                if let Some((_, to_s, _)) = last {
                    *to_s = time_s;
                }
                self.slots.push((time_s, time_s, charge));
            }
        }
    }
}

/// Reads a run; `between`: a time whose deviations are explained too, s since the start of the run. Calls `progress`
/// with the completed share, 0 to 1.
///
/// # Errors
/// The run does not exist or cannot be read.
pub fn gather(run: &Path, between: Option<[f64; 2]>, progress: &mut dyn FnMut(f64)) -> Answer<RunData> {
    let mut reader = RunReader::open(run)?;
    let mut inspection = RunInspection::default();
    let mut tracker = Tracker::default();
    let mut collector = Collector::new()?;
    collector.time = RunTime::new(reader.begin_ns());
    collector.data.deviations = Deviations::new(between);
    // A system file that this program does not accept leaves the ranges of the sensors unknown.
    collector.data.sensors = Sensors::new(crate::map::sensor_settings(run).unwrap_or_default());
    let mut other_version = BTreeSet::new();
    let mut number = 0_u64;
    loop {
        if number.is_multiple_of(4096) {
            progress(reader.position() as f64 / reader.bytes().max(1) as f64);
        }
        number += 1;
        let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? else { break };
        inspection.observe(&recorded);
        collector.clock(&recorded);
        collector.count.record(&recorded);
        let known = tracker.record(&recorded, &mut |cycle: &Cycle<'_>| collector.cycle(cycle))
            && collector.outside_cycles(&recorded);
        if !known {
            other_version.insert(recorded.channel.name.clone());
        }
    }
    tracker.finish(&mut |cycle: &Cycle<'_>| collector.cycle(cycle));
    let recording = inspection.report(&reader);
    let robot = super::robot::robot_of(run, reader.attachments())?;
    let mut data = collector.close(run, recording, robot, &other_version);
    data.incidents.name_units(run, reader.attachments());
    data.world = super::robot::world_of(run, reader.attachments());
    data.maps = super::maps::maps_of(run, &data.sensors);
    Ok(data)
}

/// Returns an empty run.
#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) fn blank() -> RunData {
    Collector::new().unwrap().data
}

/// Collects the samples of a run.
struct Collector {
    time: RunTime,
    last_s: f64,
    /// Time of the last cycle, s.
    cycle_s: Option<f64>,
    tally: AccuracySum,
    count: PeriodCounter,
    path: DecimatedPoints<PathPoint>,
    data: RunData,
}

impl Collector {
    fn new() -> Answer<Self> {
        let times =
            || StepTimes::new().ok_or_else(|| Failure::NotNow("the histogram of times cannot be created".to_owned()));
        let trace = || Trace::new(CYCLE_GAP_S);
        let data = RunData {
            name: String::new(),
            recording: RunReport::default(),
            lacks: Vec::new(),
            robot: None,
            world: None,
            analysis: None,
            authority: None,
            cables: Vec::new(),
            errors: [trace(), trace(), trace()],
            path: Vec::new(),
            power: [trace(), trace()],
            periods: Periods::default(),
            losses: [trace(), trace(), trace(), trace()],
            lost: Losses::default(),
            times: [times()?, times()?, times()?, times()?],
            rate: trace(),
            modes: Vec::new(),
            slots: Vec::new(),
            legs: Legs::default(),
            deviations: Deviations::default(),
            in_charge: InCharge::default(),
            units: Vec::new(),
            wear: WearSum::default(),
            events: Events::default(),
            incidents: Incidents::default(),
            processes: BTreeMap::new(),
            sensors: Sensors::default(),
            maps: BTreeMap::new(),
            recorder: BTreeMap::new(),
            least_free_bytes: None,
            mission: None,
            unrecorded_ends_s: [0.0; 2],
            end_reason: None,
            missions: BTreeMap::new(),
        };
        Ok(Self {
            time: RunTime::default(),
            last_s: 0.0,
            cycle_s: None,
            tally: AccuracySum::default(),
            count: PeriodCounter::default(),
            path: DecimatedPoints::default(),
            data,
        })
    }

    fn clock(&mut self, recorded: &RecordedSample<'_>) {
        self.time.observe(recorded);
        self.last_s = self.last_s.max(self.logged_s(recorded));
    }

    /// Returns the log time of a sample since the start, s.
    fn logged_s(&self, recorded: &RecordedSample<'_>) -> f64 {
        self.time.logged_s(recorded.log_time_ns)
    }

    /// Returns the time of a stamp since the start, s.
    fn time_s(&self, stamp_ns: u64) -> f64 {
        self.time.stamped_s(stamp_ns)
    }

    fn cycle(&mut self, cycle: &Cycle<'_>) {
        let authority = cycle.authority;
        let time_s = self.time_s(authority.header.stamp_ns);
        self.cycle_s = Some(time_s);
        let count = usize::from(authority.cable_count).min(CABLES);
        while self.data.cables.len() < count {
            self.data.cables.push(CableData::new());
        }
        self.path_and_errors(time_s, cycle);
        let data = &mut self.data;
        for (i, cable) in data.cables.iter_mut().enumerate() {
            cable.add(time_s, cycle, i);
        }
        if let Some(energy) = cycle.energy {
            data.power[0].add(time_s, energy.power_w[..count].iter().sum());
            data.power[1].add(time_s, energy.loss_w[..count].iter().sum());
        }
        for (trace, (_, count)) in data.losses.iter_mut().zip(self.count.periods().causes()) {
            trace.add(time_s, count as f64);
        }
        // 0 in a cycle that used no command.
        let age_ns = cycle.segment.is_some().then_some(authority.command_age_ns).filter(|age_ns| *age_ns > 0);
        let steps_ns = [Some(authority.wake_ns), Some(authority.bus_ns), age_ns, cycle.answered_ns];
        for (times, ns) in data.times.iter_mut().zip(steps_ns) {
            if let Some(ns) = ns {
                times.add(time_s, ns);
            }
        }
        data.rate.add(time_s, authority.plan_rate);
        data.mode_and_slots(time_s, authority);
        data.events.cycle(time_s, authority);
        data.incidents.cycle(time_s, authority, cycle.state);
        data.lost.cycle(time_s, authority);
        data.legs.cycle(time_s, cycle);
        data.deviations.cycle(time_s, cycle, cycle.segment.and_then(|_| data.legs.current()));
        data.in_charge.cycle(time_s, cycle);
        data.wear.cycle(cycle);
        if let Some(estimate) = cycle.estimate {
            data.sensors.node_at(estimate);
        }
        data.authority = Some(*authority);
    }

    /// Adds the positions of a cycle, their errors, and the true tensions.
    fn path_and_errors(&mut self, time_s: f64, cycle: &Cycle<'_>) {
        if let Some(point) = self.tally.add(cycle) {
            self.data.errors[0].add(time_s, (point.estimate - point.setpoint).norm());
            point.model_off_m.iter().for_each(|off_m| self.data.errors[2].add(time_s, *off_m));
            self.path.add([Some(point.setpoint), Some(point.estimate), point.truth]);
        } else if let Some(estimate) = cycle.estimate {
            self.path.add([
                None,
                Some(Vector3::from(estimate.position_m)),
                cycle.truth.first().map(|truth| Vector3::from(truth.position_m)),
            ]);
        }
        for truth in cycle.truth {
            let at_s = self.time_s(truth.header.stamp_ns);
            for (cable, tension_n) in self.data.cables.iter_mut().zip(&truth.tension_n) {
                cable.true_tension.add(at_s, *tension_n);
            }
            if cycle.moving
                && let Some(target) = cycle.setpoint_at(truth.header.stamp_ns)
            {
                self.data.errors[1].add(at_s, (Vector3::from(truth.position_m) - target.position).norm());
            }
        }
    }

    /// Collects a sample that belongs to no cycle. Returns false for another version of a known channel's type.
    fn outside_cycles(&mut self, recorded: &RecordedSample<'_>) -> bool {
        let time_s = self.logged_s(recorded);
        let data = &mut self.data;
        let name = recorded.channel.name.as_str();
        if let Some(process) = name.strip_prefix("system/heartbeat/") {
            let Some(beat) = recorded.decode::<Heartbeat>() else { return false };
            data.processes.insert(process.to_owned(), beat);
            return true;
        }
        if name.starts_with("system/log/") {
            let Some(event) = recorded.decode::<LogEvent>() else { return false };
            let unit = DriveUnit::from_log(&text_of(&event.text)).filter(|unit| !data.units.contains(unit));
            data.units.extend(unit);
            data.events.log(time_s, &event);
            return true;
        }
        if name.starts_with("system/config/") {
            return recorded.decode::<SystemConfig>().map(|config| data.in_charge.config(&config)).is_some();
        }
        if name.starts_with("sensor/") || name.starts_with("sample/") {
            data.sensors.record(time_s, recorded);
            return true;
        }
        match name {
            "operator/request" => {
                let Some(request) = recorded.decode::<OperatorRequest>() else { return false };
                data.events.request(time_s, &request);
                data.incidents.request(time_s, &request);
                true
            }
            "system/process" => {
                let Some(process) = recorded.decode::<ProcessState>() else { return false };
                data.events.process(time_s, &process);
                data.incidents.process(time_s, &process);
                true
            }
            "plan/status" => {
                let Some(status) = recorded.decode::<PlanStatus>() else { return false };
                let mission = text_of(&status.mission);
                if data.events.plan(time_s, &status) && status.state == PlanStatus::STATE_DONE {
                    *data.missions.entry(mission.clone()).or_default() += 1;
                }
                if status.state != PlanStatus::STATE_IDLE {
                    let (state, progress, sentence) = (status.state, status.progress, text_of(&status.reason));
                    let same = data.mission.as_ref().filter(|known| known.state == state && known.name == mission);
                    let since_s = same.map_or(time_s, |known| known.since_s);
                    data.mission = Some(Mission {
                        state,
                        name: mission,
                        progress,
                        why: Reason::from_status(&status),
                        sentence,
                        since_s,
                    });
                }
                true
            }
            "recorder/status" => {
                let Some(status) = recorded.decode::<RecorderStatus>() else { return false };
                let free = data.least_free_bytes.unwrap_or(u64::MAX).min(status.disk_free_bytes);
                data.least_free_bytes = Some(free);
                data.recorder.insert(text_of(&status.channel), status);
                true
            }
            _ => true,
        }
    }

    fn close(
        self,
        run: &Path,
        recording: RunReport,
        robot: Option<Robot>,
        other_version: &BTreeSet<String>,
    ) -> RunData {
        let mut data = self.data;
        let name = run.canonicalize().unwrap_or_else(|_| run.to_path_buf());
        data.name = name.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for (channel, what) in NEEDED_CHANNELS {
            let there = recording.channels.iter().any(|one| one.name.starts_with(channel));
            if !there {
                data.lacks.push(format!("The run has no channel {channel}, so {what} cannot be shown."));
            }
        }
        if !other_version.is_empty() {
            let names: Vec<&str> = other_version.iter().map(String::as_str).collect();
            data.lacks.push(format!(
                "{}: recorded with another message version and not shown; the nims version that recorded the run can show them.",
                names.join(", ")
            ));
        }
        if robot.is_none() {
            data.lacks.push(
                "The run has no robot.toml, so anchors and limits are not shown, and moves are not compared with straight lines."
                    .to_owned(),
            );
        }
        if !recording.channels.iter().any(|one| one.name == "truth/node") {
            data.lacks.push(
                "The run has no truth (only the virtual motor box publishes it), so errors are those of the estimate."
                    .to_owned(),
            );
        }
        data.path = self.path.points().to_vec();
        data.periods = self.count.periods();
        data.analysis = self.tally.result(Vec::new(), data.periods);
        data.unrecorded_ends_s = crate::runs::unrecorded_ends_s(run, &recording);
        data.end_reason = crate::runs::end_reason(run);
        // At the end of a run its sensors may end before the recorder.
        let stopping_s = crate::runs::stopping_unix_ns(run).map(|at_ns| self.time.logged_s(at_ns));
        let ends = self.cycle_s.into_iter().chain(stopping_s);
        data.sensors.close(ends.fold(self.last_s, f64::min));
        data.recording = recording;
        data.robot = robot;
        data.events.close();
        data.deviations.close();
        data
    }
}
