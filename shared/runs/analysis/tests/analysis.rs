//! Checks the analysis against a synthetic run with known errors.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use analysis::accuracy::{Analysis, analyse};
use analysis::report::report;
use cable_robot::profile::ProfileLimits;
use cable_robot::{Path, Profile, Segment, Vector3};
use command::Failure;
use messages::{
    ControlStatus, Energy, Message, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion, TruthNode,
};
use robot_state::Periods;
use runlog::{ChannelId, ChannelSpec, RunClock, RunWriter};
use segments::segment_message;

const PERIOD_NS: u64 = 10_000_000;
const CLOCK: RunClock = RunClock { t0_unix_ns: 1_767_225_600_000_000_000, t0_mono_ns: 0 };
/// Offset of the estimate from the setpoint, m.
const ESTIMATE_OFF_M: f64 = 0.003;
/// Offset of the truth from the setpoint, m.
const TRUTH_OFF_M: f64 = 0.004;

fn stamped<T: Message>(mut sample: T, cycle: u64, stamp_ns: u64) -> T {
    let header = sample.header_mut();
    (header.cycle, header.seq, header.stamp_ns) = (cycle, cycle, stamp_ns);
    sample
}

#[test]
fn errors_are_measured_over_moving_cycles_at_the_time_of_each_sample() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = RunWriter::create(&folder.path().join("run.mcap"), CLOCK, &Default::default(), &[]).unwrap();
    let channels = [
        writer.add_channel(&ChannelSpec::for_type::<PlanMotion>("plan/motion")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<MotorAuthority>("motor/authority")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<NodeEstimate>("node/estimate/a")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<TruthNode>("truth/node")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<ControlStatus>("control/status/a")).unwrap(),
    ];
    let path = Path::line(Vector3::new(4.0, 3.0, 0.5), Vector3::new(5.0, 3.0, 0.5));
    let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
    let segment = Segment { id: 7, path, profile, start_s: 1.0 };
    let motion = PlanMotion { current: segment_message(&segment), motion: 1, ..Default::default() };
    let mut write = |channel: usize, stamp_ns: u64, sample: &[u8]| {
        writer.write(channels[channel], 1, stamp_ns, stamp_ns, sample).unwrap();
    };
    write(0, 1, bytemuck::bytes_of(&stamped(motion, 1, 1)));

    // One second at rest before and after the motion, with errors that must not count.
    let cycles = ((profile.duration() + 2.0) * 100.0) as u64;
    let mut moving = 0;
    for cycle in 1..=cycles {
        let stamp = cycle * PERIOD_NS;
        let plan_time_s = cycle as f64 * 0.01;
        let target = segment.setpoint(plan_time_s);
        let counts = !target.at_rest && target.velocity.norm() > 1e-3;
        moving += u64::from(counts);
        let authority = MotorAuthority {
            plan_time_s,
            plan_rate: 1.0,
            period_s: 0.01,
            mode: MotorAuthority::MODE_FOLLOWING,
            motion: 1,
            periods: 6,
            lost_answer: 1,
            lost_computer: 2,
            lost_resync: 3,
            ..Default::default()
        };
        write(1, stamp, bytemuck::bytes_of(&stamped(authority, cycle, stamp)));
        let off = if counts { ESTIMATE_OFF_M } else { 1.0 };
        let position = target.position + Vector3::new(0.0, off, 0.0);
        let estimate = NodeEstimate { position_m: position.into(), valid: 1, ..Default::default() };
        write(2, stamp, bytemuck::bytes_of(&stamped(estimate, cycle, stamp)));
        let chosen = ControlStatus { tension_n: [10.0; 8], valid: 1, cable_count: 3, ..Default::default() };
        write(4, stamp, bytemuck::bytes_of(&stamped(chosen, cycle, stamp)));
        // The truth is half-way between two cycles, when the setpoint has advanced by half a cycle.
        let between = segment.setpoint(plan_time_s + 0.005).position + Vector3::new(0.0, 0.0, TRUTH_OFF_M);
        let mut truth = TruthNode { position_m: between.into(), cable_count: 3, ..Default::default() };
        truth.tension_n[..3].copy_from_slice(&[10.0, 11.9, if cycle % 2 == 0 { 8.1 } else { 7.9 }]);
        write(3, stamp + 5_000_000, bytemuck::bytes_of(&stamped(truth, 0, stamp + 5_000_000)));
    }
    writer.finish(&Default::default()).unwrap();

    let found = analyse(folder.path()).unwrap();
    assert_eq!(found.cycles, cycles);
    let wanted = Periods { computer: 2, resync: 3, answer: 1, ..Periods::default() };
    assert_eq!((found.periods, found.periods.unsteered(), found.periods.all()), (wanted, 6, 6));
    assert_eq!(found.estimate.samples as u64, moving);
    let close = |found: f64, wanted: f64| (found - wanted).abs() < 1e-6;
    assert!(close(found.estimate.rms_m, ESTIMATE_OFF_M) && close(found.estimate.max_m, ESTIMATE_OFF_M));
    let truth = found.truth.unwrap();
    assert_eq!(truth.samples as u64, moving);
    assert!(close(truth.rms_m, TRUTH_OFF_M) && close(truth.max_m, TRUTH_OFF_M), "{truth:?}");
    // Estimate and truth are beside the setpoint in directions at a right angle.
    let model = found.model.unwrap();
    let apart_m = ESTIMATE_OFF_M.hypot(TRUTH_OFF_M);
    assert!(close(model.rms_m, apart_m) && close(model.max_m, apart_m), "{model:?}");
    let tensions = found.tensions.unwrap();
    assert!((tensions.as_chosen - 0.5).abs() < 0.01, "every other sample is 2.1 N off");
    assert!(close(tensions.worst_n, 2.1) && tensions.least_n == 7.9 && tensions.greatest_n == 11.9);
}

#[test]
fn a_run_without_motion_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = RunWriter::create(&folder.path().join("run.mcap"), CLOCK, &Default::default(), &[]).unwrap();
    let channel = writer.add_channel(&ChannelSpec::for_type::<MotorAuthority>("motor/authority")).unwrap();
    let rest = stamped(MotorAuthority { period_s: 0.01, ..Default::default() }, 1, PERIOD_NS);
    writer.write(channel, 1, 1, 1, bytemuck::bytes_of(&rest)).unwrap();
    writer.finish(&Default::default()).unwrap();
    let failure = analyse(folder.path()).unwrap_err();
    assert!(matches!(failure, Failure::NotNow(_)), "{failure:?}");
}

/// Writer of a synthetic run: the same leg in several motions and lives, with gaps where the test needs them.
struct Tape {
    folder: tempfile::TempDir,
    writer: RunWriter,
    channels: [ChannelId; 6],
    segment: Segment,
    stamp_ns: u64,
    seq: u64,
}

impl Tape {
    /// Creates a run with a leg of a metre along a line, which takes about 5.5 s.
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = RunWriter::create(&folder.path().join("run.mcap"), CLOCK, &Default::default(), &[]).unwrap();
        let channels = [
            writer.add_channel(&ChannelSpec::for_type::<PlanMotion>("plan/motion")).unwrap(),
            writer.add_channel(&ChannelSpec::for_type::<MotorAuthority>("motor/authority")).unwrap(),
            writer.add_channel(&ChannelSpec::for_type::<NodeEstimate>("node/estimate/a")).unwrap(),
            writer.add_channel(&ChannelSpec::for_type::<TruthNode>("truth/node")).unwrap(),
            writer.add_channel(&ChannelSpec::for_type::<Energy>("energy")).unwrap(),
            writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap(),
        ];
        let path = Path::line(Vector3::new(4.0, 3.0, 0.5), Vector3::new(5.0, 3.0, 0.5));
        let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
        let segment = Segment { id: 7, path, profile, start_s: 0.0 };
        Self { folder, writer, channels, segment, stamp_ns: 0, seq: 0 }
    }

    fn write<T: Message>(&mut self, channel: usize, mut sample: T, life: u64, cycle: u64, stamp_ns: u64) {
        let header = sample.header_mut();
        (header.life, header.cycle, header.seq, header.stamp_ns) = (life, cycle, self.seq, stamp_ns);
        self.writer.write(self.channels[channel], self.seq, stamp_ns, stamp_ns, bytemuck::bytes_of(&sample)).unwrap();
    }

    /// Writes the cycles of a motion at 100 Hz from plan time 0; outside of `recorded`, only the truth is written.
    fn motion(&mut self, life: u64, first_cycle: u64, motion: u32, recorded: impl Fn(u64) -> bool) {
        let plan = PlanMotion { current: segment_message(&self.segment), motion, epoch: motion, ..Default::default() };
        self.write(0, plan, life, 0, self.stamp_ns + 1);
        for at in 0..(100.0 * self.segment.profile.duration()) as u64 + 20 {
            self.stamp_ns += PERIOD_NS;
            self.seq += 1;
            let (plan_time_s, stamp_ns) = (at as f64 * 0.01, self.stamp_ns);
            if recorded(at) {
                let authority = MotorAuthority {
                    plan_time_s,
                    plan_rate: 1.0,
                    period_s: 0.01,
                    mode: MotorAuthority::MODE_FOLLOWING,
                    cable_count: 3,
                    motion,
                    epoch: motion,
                    ..Default::default()
                };
                self.write(1, authority, life, first_cycle + at, stamp_ns);
                let position_m = self.segment.setpoint(plan_time_s).position.into();
                let estimate = NodeEstimate { position_m, valid: 1, ..Default::default() };
                self.write(2, estimate, life, first_cycle + at, stamp_ns);
                // A joule per cycle since the start of the life.
                let (mut energy_j, counted_j) = ([0.0; 8], (first_cycle + at) as f64);
                energy_j[0] = counted_j;
                let state = MotorState { cable_count: 3, ..Default::default() };
                self.write(5, state, life, first_cycle + at, stamp_ns);
                let energy = Energy { energy_j, cable_count: 3, ..Default::default() };
                self.write(4, energy, life, first_cycle + at, stamp_ns);
            }
            let mut position = self.segment.setpoint(plan_time_s + 0.005).position;
            position.z += TRUTH_OFF_M;
            let truth = TruthNode { position_m: position.into(), cable_count: 3, ..Default::default() };
            self.write(3, truth, 0, 0, stamp_ns + 5_000_000);
        }
    }

    /// Returns the analysis, and the report as JSON and as text.
    fn finish(self) -> (Analysis, serde_json::Value, String) {
        self.writer.finish(&Default::default()).unwrap();
        let run = self.folder.path().to_path_buf();
        let command::Output { value, words, .. } = report(std::slice::from_ref(&run), None).unwrap();
        (analyse(&run).unwrap(), value["runs"][0].clone(), words)
    }
}

#[test]
fn unrecorded_time_adds_no_error_and_no_path() {
    let mut tape = Tape::new();
    // The first motion ends in the middle of its leg, and the next one is recorded from the middle of its leg.
    tape.motion(1, 1, 1, |at| at < 250);
    tape.motion(1, 1001, 2, |at| at >= 250);
    let segment = tape.segment;
    let (found, value, words) = tape.finish();
    let truth = found.truth.unwrap();
    assert!(truth.max_m < TRUTH_OFF_M + 1e-6, "{truth:?}");
    // Path counts where time does: 2.5 s of one leg, and the rest of the other.
    let at_m = |time_s: f64| segment.setpoint(time_s).path_s_m;
    let legs = value["legs"].as_array().unwrap();
    let flown: Vec<f64> = legs.iter().map(|leg| leg["flown_m"].as_f64().unwrap()).collect();
    assert_eq!(flown.len(), 2);
    assert!((flown[0] - at_m(2.49)).abs() < 1e-6 && (flown[1] - (1.0 - at_m(2.5))).abs() < 1e-6, "{flown:?}");
    assert!(legs[0]["complete"] == false && legs[1]["complete"] == true);
    let sum = value["flown_m"].as_f64().unwrap();
    assert!((sum - flown[0] - flown[1]).abs() < 1e-9, "{sum}");
    // A lower bound where samples are missing, of the path and of the time.
    assert!(words.contains("1.0 m") && words.contains("5 s") && words.matches("at least").count() >= 2, "{words}");
}

#[test]
fn a_gap_inside_a_leg_counts_neither_as_path_nor_as_time() {
    let mut tape = Tape::new();
    tape.motion(1, 1, 1, |at| !(200..300).contains(&at));
    let segment = tape.segment;
    let (found, value, _) = tape.finish();
    let at_m = |time_s: f64| segment.setpoint(time_s).path_s_m;
    let flown_m = value["legs"][0]["flown_m"].as_f64().unwrap();
    assert!((flown_m - (1.0 - at_m(3.0) + at_m(1.99))).abs() < 1e-6, "{flown_m} m");
    assert!(value["legs"][0]["complete"] == true);
    let all_s = segment.profile.duration();
    assert!((found.moving_s - (all_s - 1.01)).abs() < 0.03, "{} s of {all_s} s", found.moving_s);
    // A sample or two that are missing do not form a gap.
    let mut tape = Tape::new();
    tape.motion(1, 1, 1, |at| !(200..203).contains(&at));
    let (found, value, _) = tape.finish();
    assert!((value["legs"][0]["flown_m"].as_f64().unwrap() - 1.0).abs() < 1e-6);
    assert!(found.truth.unwrap().max_m < TRUTH_OFF_M + 1e-6);
}

#[test]
fn an_early_second_life_does_not_affect_the_first() {
    let mut tape = Tape::new();
    // The second life counts its cycles from 1 while those of the first are still waiting.
    tape.motion(1_000, 1, 1, |_| true);
    tape.motion(2_000, 1, 2, |_| true);
    let one = (100.0 * tape.segment.profile.duration()) as usize;
    let (found, value, _) = tape.finish();
    assert!(found.estimate.samples >= 2 * (one - 3) && found.estimate.max_m < 1e-9, "{:?}", found.estimate);
    assert!(found.truth.unwrap().max_m < TRUTH_OFF_M + 1e-6, "{:?}", found.truth);
    assert!((value["flown_m"].as_f64().unwrap() - 2.0).abs() < 1e-6);
    assert!(found.track.windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
}

#[test]
fn cycles_and_energy_count_over_all_lives() {
    let mut tape = Tape::new();
    (1..=3).for_each(|life| tape.motion(1_000 * life, 1, life as u32, |_| true));
    let one = (100.0 * tape.segment.profile.duration()) as u64 + 20;
    let (found, value, _) = tape.finish();
    assert_eq!(found.cycles, 3 * one);
    assert_eq!(value["cables"][0]["energy_j"].as_f64().unwrap(), 3.0 * one as f64);
    let legs = value["legs"].as_array().unwrap();
    assert!(legs.iter().all(|leg| leg["energy_j"].as_f64().is_some_and(|energy| energy > 0.0)), "{legs:?}");
}

/// The command of the controller in charge counts, of each cycle that it answered.
#[test]
fn a_run_shows_the_time_from_state_to_command() {
    const ANSWERED_NS: [u64; 2] = [150_000, 90_000];
    const CYCLES: u64 = 200;
    let folder = tempfile::tempdir().unwrap();
    let mut writer = RunWriter::create(&folder.path().join("run.mcap"), CLOCK, &Default::default(), &[]).unwrap();
    let channels = [
        writer.add_channel(&ChannelSpec::for_type::<MotorAuthority>("motor/authority")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<MotorCommand>("motor/command/a")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<MotorCommand>("motor/command/b")).unwrap(),
    ];
    for cycle in 1..=CYCLES {
        let stamp_ns = cycle * PERIOD_NS;
        let mut write = |channel: usize, log_ns: u64, sample: &[u8]| {
            writer.write(channels[channel], cycle, log_ns, log_ns, sample).unwrap();
        };
        // Slot b is in charge of the second half.
        let slot = u8::from(cycle > CYCLES / 2);
        let authority = MotorAuthority { period_s: 0.01, active_controller: slot, ..Default::default() };
        write(0, stamp_ns, bytemuck::bytes_of(&stamped(authority, cycle, stamp_ns)));
        let mut state = stamped(MotorState::default(), cycle, stamp_ns);
        state.header.published_ns = stamp_ns + 1000;
        write(1, stamp_ns + 1000, bytemuck::bytes_of(&state));
        for (slot, answered_ns) in ANSWERED_NS.into_iter().enumerate() {
            // Every tenth cycle has no answer.
            if !cycle.is_multiple_of(10) {
                let mut command = stamped(MotorCommand::default(), cycle, stamp_ns);
                command.header.published_ns = stamp_ns + 1000 + answered_ns;
                write(2 + slot, command.header.published_ns, bytemuck::bytes_of(&command));
            }
        }
    }
    writer.finish(&Default::default()).unwrap();
    let figures = analysis::report::figures(folder.path()).unwrap();
    let times = figures["times"].as_array().unwrap();
    let found = times.iter().find(|times| times["what"] == "state_to_command").unwrap();
    assert_eq!(found["samples"], CYCLES * 9 / 10);
    let [p50_ns, p99_ns] = ["p50_ns", "p99_ns"].map(|name| found[name].as_u64().unwrap());
    let close = |found_ns: u64, wanted_ns: u64| found_ns.abs_diff(wanted_ns) <= wanted_ns / 100;
    assert!(close(p50_ns, ANSWERED_NS[1]) && close(p99_ns, ANSWERED_NS[0]), "{found}");
}

#[test]
fn a_file_that_cannot_be_recovered_keeps_no_other_from_it() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    let [first, second, third] = ["run", "run-0002", "run-0003"].map(|stem| run.join(format!("{stem}.mcap.part")));
    // Its recorder holds the first one.
    let writer = RunWriter::create(&run.join("run.mcap"), CLOCK, &Default::default(), &[]).unwrap();
    std::fs::copy(&first, &second).unwrap();
    std::fs::copy(&first, &third).unwrap();
    let output = analysis::runs::recover(run).unwrap();
    let files = |key: &str, of: &str| -> Vec<String> {
        let all = output.value[key].as_array().unwrap();
        all.iter().map(|one| one[of].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(files("recovered", "source"), [&second, &third].map(|path| path.to_str().unwrap()));
    assert_eq!(files("failed", "file"), [first.to_str().unwrap()]);
    let failure = output.failure.as_ref().unwrap();
    assert!(failure.exit_code() == 1 && failure.to_string() == files("failed", "why")[0], "{failure}");
    assert!(failure.to_string().contains(first.to_str().unwrap()), "{failure}");
    assert!(first.exists() && !second.exists() && run.join("run-0003.mcap").exists());
    // Nothing else is left to recover.
    assert_eq!(analysis::runs::recover(run).unwrap_err(), *failure);
    drop(writer);
    assert_eq!(analysis::runs::recover(run).unwrap().failure, None);
}
