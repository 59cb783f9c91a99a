//! Checks what a report says about causes, people and limits against synthetic runs in which each of them is known.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use analysis::report::{Args, report};
use analysis::run_list;
use cable_robot::profile::ProfileLimits;
use cable_robot::{Path, Profile, Segment, Vector3};
use messages::{
    ControlStatus, LogEvent, Message, MotorAuthority, MotorState, NodeEstimate, OperatorRequest, PlanMotion, Reading,
    RequestBody, SystemConfig, TruthNode, put_text,
};
use robot_state::DriveUnit;
use runlog::{ChannelId, ChannelSpec, RunClock, RunWriter};
use segments::segment_message;
use serde_json::Value;
use std::collections::HashMap;
use std::path::PathBuf;

const PERIOD_NS: u64 = 10_000_000;
/// From the start of the run to its first cycle: seconds count from the start.
const BEFORE_S: f64 = 3.0;
const CLOCK: RunClock = RunClock { t0_unix_ns: 1_767_225_600_000_000_000, t0_mono_ns: 0 };
/// Deviation outside of the bump, m.
const CALM_M: f64 = 0.001;
/// Largest deviation, m.
const PEAK_M: f64 = 0.012;
/// Cycles of the rise: its first one, its peak, and the end of the fall.
const RISE: [u64; 3] = [250, 280, 310];

/// Samples of a cycle.
#[derive(Default)]
struct Samples {
    authority: MotorAuthority,
    state: MotorState,
    control: ControlStatus,
    estimate: NodeEstimate,
}

/// A flight of a metre along a line in 5.5 s, with one rise of the deviation.
struct Flight {
    folder: tempfile::TempDir,
    writer: RunWriter,
    channels: HashMap<String, ChannelId>,
    seq: u64,
    /// Cycles that never run.
    missing: std::ops::Range<u64>,
}

impl Flight {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let about = [("system".to_owned(), "synthetic".to_owned())].into();
        let writer = RunWriter::create(&folder.path().join("run.mcap"), CLOCK, &about, &[]).unwrap();
        Self { folder, writer, channels: HashMap::new(), seq: 0, missing: 0..0 }
    }

    fn write<T: Message>(&mut self, channel: &str, mut sample: T, cycle: u64) {
        if !self.channels.contains_key(channel) {
            let id = self.writer.add_channel(&ChannelSpec::for_type::<T>(channel)).unwrap();
            self.channels.insert(channel.to_owned(), id);
        }
        self.seq += 1;
        let stamp_ns = (BEFORE_S * 1e9) as u64 + cycle * PERIOD_NS;
        let header = sample.header_mut();
        (header.life, header.cycle, header.stamp_ns) = (1, cycle, stamp_ns);
        // Some tests number the answers themselves.
        header.seq = if header.seq == 0 { cycle } else { header.seq };
        let (id, seq) = (self.channels[channel], self.seq);
        self.writer.write(id, seq, stamp_ns, stamp_ns, bytemuck::bytes_of(&sample)).unwrap();
    }

    /// Flies with what `change` makes of each cycle; `seen`: the estimate has the rise, otherwise the truth alone.
    fn fly(mut self, seen: bool, mut change: impl FnMut(u64, &mut Samples)) -> Self {
        let path = Path::line(Vector3::new(4.0, 3.0, 0.5), Vector3::new(5.0, 3.0, 0.5));
        let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
        let segment = Segment { id: 7, path, profile, start_s: 0.0 };
        self.write(
            "plan/motion",
            PlanMotion { current: segment_message(&segment), motion: 1, ..Default::default() },
            1,
        );
        for cycle in 1..(100.0 * profile.duration()) as u64 {
            let plan_time_s = cycle as f64 * 0.01;
            let target = segment.setpoint(plan_time_s).position;
            let off_m = deviation_m(cycle);
            let authority = MotorAuthority {
                plan_time_s,
                plan_rate: 1.0,
                plan_rate_target: 1.0,
                scale: 1.0,
                fade: [1.0; 2],
                period_s: 0.01,
                mode: MotorAuthority::MODE_FOLLOWING,
                cable_count: 3,
                motion: 1,
                steered: cycle,
                ..Default::default()
            };
            let mut samples = Samples { authority, ..Default::default() };
            let estimate_m = if seen { off_m } else { CALM_M };
            samples.estimate.position_m = (target + Vector3::new(0.0, estimate_m, 0.0)).into();
            (samples.estimate.valid, samples.estimate.tension_n) = (1, [20.0; 8]);
            (samples.state.cable_count, samples.control.valid) = (3, 1);
            change(cycle, &mut samples);
            let runs = !self.missing.contains(&cycle);
            let slot = if samples.authority.active_controller == 1 { "b" } else { "a" };
            if runs {
                self.write("motor/authority", samples.authority, cycle);
                self.write("motor/state", samples.state, cycle);
                self.write(&format!("control/status/{slot}"), samples.control, cycle);
                self.write("node/estimate/a", samples.estimate, cycle);
            }
            if !seen {
                let position_m = (target + Vector3::new(0.0, 0.0, off_m)).into();
                self.write("truth/node", TruthNode { position_m, cable_count: 3, ..Default::default() }, cycle);
            }
        }
        self
    }

    /// Closes the run.
    fn close(self) -> (tempfile::TempDir, PathBuf) {
        self.writer.finish(&Default::default()).unwrap();
        let run = self.folder.path().to_path_buf();
        (self.folder, run)
    }

    /// Returns the figures of the report.
    fn figures(self) -> Value {
        let (_folder, run) = self.close();
        report(std::slice::from_ref(&run), None).unwrap().value["runs"][0].clone()
    }
}

/// Rises and falls along lines.
fn deviation_m(cycle: u64) -> f64 {
    let [begin, peak, end] = RISE;
    let share = match cycle {
        at if at < begin || at > end => 0.0,
        at if at <= peak => (at - begin) as f64 / (peak - begin) as f64,
        at => (end - at) as f64 / (end - peak) as f64,
    };
    CALM_M + share * (PEAK_M - CALM_M)
}

fn kinds(explanation: &Value) -> Vec<String> {
    explanation["causes"].as_array().unwrap().iter().map(|one| one["kind"].as_str().unwrap().to_owned()).collect()
}

/// Flies with a change and returns the explanation of the run's largest deviation.
fn explained(change: impl FnMut(u64, &mut Samples)) -> Value {
    let figures = Flight::new().fly(true, change).figures();
    let explanation = figures["deviations"][0].clone();
    assert_eq!(explanation, figures["legs"][0]["deviations"][0], "the run has one leg");
    let number = |key: &str| explanation[key].as_f64().unwrap();
    assert!((number("max_m") - PEAK_M).abs() < 1e-9, "{explanation}");
    let [begin, peak, _] = RISE.map(|cycle| BEFORE_S + cycle as f64 * 0.01);
    assert!((number("at_s") - peak).abs() < 1e-6, "{explanation}");
    assert!((number("rises_from_s") - begin).abs() < 0.05, "{explanation}");
    assert_eq!(explanation["cycle"], RISE[1]);
    explanation
}

/// Counts three periods as lost to the computer from this cycle on.
fn lose_at(lost: u64) -> impl FnMut(u64, &mut Samples) {
    move |cycle, samples| samples.authority.lost_computer = if cycle >= lost { 3 } else { 0 }
}

#[test]
fn a_deviation_without_a_cause_in_the_record_says_so() {
    let explanation = explained(|_, _| ());
    assert!(kinds(&explanation).is_empty() && explanation["setpoint"] == "cruises", "{explanation}");
    assert!(explanation["sentence"].as_str().unwrap().contains("no recorded cause"));
}

#[test]
fn a_cause_is_named_only_where_it_overlaps_the_rise() {
    let explanation = explained(lose_at(258));
    assert_eq!(kinds(&explanation), ["lost"]);
    assert!(explanation["causes"][0]["text"].as_str().unwrap().contains("computer 3"), "{explanation}");
    // Just before the rise it acts on it; long before it, and after the peak, it does not.
    assert_eq!(kinds(&explained(lose_at(245))), ["lost"]);
    assert!(kinds(&explained(lose_at(100))).is_empty());
    assert!(kinds(&explained(lose_at(290))).is_empty());
}

#[test]
fn cycles_that_are_missing_explain_what_the_truth_does_meanwhile() {
    // The truth leaves the setpoint while three cycles never run; the count follows in the second cycle after them.
    let figures = Flight { missing: RISE[1] - 2..RISE[1] + 1, ..Flight::new() }
        .fly(false, |cycle, samples| samples.authority.lost_computer = if cycle > RISE[1] + 1 { 3 } else { 0 })
        .figures();
    let truth = &figures["deviations"][1];
    assert!(kinds(truth).iter().all(|kind| kind == "lost") && kinds(truth).len() == 2, "{truth}");
    assert!(truth["causes"][0]["text"].as_str().unwrap().contains("computer 3"), "{truth}");
}

#[test]
fn each_cause_has_its_kind() {
    let within = |cycle: u64| (255..265).contains(&cycle);
    let at = |change: fn(&mut Samples)| {
        kinds(&explained(move |cycle, samples| {
            if within(cycle) {
                change(samples);
            }
        }))
    };
    assert_eq!(at(|samples| samples.authority.scale = 0.8), ["saturation"]);
    assert_eq!(at(|samples| samples.control.saturation = 1.3), ["saturation"]);
    assert_eq!(at(|samples| samples.state.duty[1] = -1.0), ["voltage"]);
    assert_eq!(at(|samples| samples.estimate.slack[2] = 1), ["slack"]);
    assert_eq!(at(|samples| samples.control.law = ControlStatus::LAW_LQ_ENDPOINT), ["fallback"]);
    assert_eq!(at(|samples| samples.authority.plan_rate = 0.5), ["plan-clock"]);
    let stopped = at(|samples| (samples.authority.plan_rate, samples.authority.plan_rate_target) = (0.5, 0.0));
    assert_eq!(stopped, ["stop"]);
    assert_eq!(at(|samples| samples.authority.faults = MotorAuthority::FAULT_SUPPLY), ["fault"]);
    let swapped = explained(|cycle, samples| samples.authority.active_controller = u8::from(cycle >= 258));
    assert_eq!(kinds(&swapped), ["swap"]);
}

#[test]
fn a_swap_names_the_slot_of_the_change_also_if_it_is_taken_back() {
    let slots = |slot: fn(u64) -> u8| {
        let explanation = explained(move |cycle, samples| samples.authority.active_controller = slot(cycle));
        assert_eq!(kinds(&explanation), ["swap"]);
        let text = explanation["causes"][0]["text"].as_str().unwrap().to_owned();
        let named = text.split("slot ").skip(1).map(|after| after[..1].to_owned());
        named.collect::<Vec<_>>()
    };
    assert_eq!(slots(|cycle| u8::from(cycle >= 258)), ["b"]);
    assert_eq!(slots(|cycle| u8::from((258..266).contains(&cycle))), ["b", "a"]);
    assert_eq!(slots(|cycle| u8::from(!(258..266).contains(&cycle))), ["a", "b"]);
    // The change was before the rise, and the cross-fade goes on in it.
    let faded = explained(|cycle, samples| {
        samples.authority.active_controller = u8::from(cycle >= 100);
        samples.authority.fade[0] = if (100..260).contains(&cycle) { 0.5 } else { 1.0 };
    });
    assert!(faded["causes"][0]["text"].as_str().unwrap().ends_with("slot b"), "{faded}");
}

#[test]
fn what_is_not_finite_is_left_out_of_the_figures_of_wear() {
    let wear = |bad: f64| {
        let flown = Flight::new().fly(true, |cycle, samples| {
            (samples.state.current_a, samples.estimate.residual_m) = ([2.0; 8], 0.003);
            samples.state.position_known = 1;
            samples.state.zeroed_m[0] = f64::from(u8::from(cycle >= 200));
            samples.state.length_m[0] = if cycle >= 200 { 5.25 } else { 5.0 };
            if cycle == 150 {
                (samples.state.current_a[1], samples.estimate.residual_m) = (bad, bad);
                samples.estimate.tension_n[2] = bad;
            }
            if cycle == 200 {
                samples.state.length_m[1] = bad;
            }
        });
        flown.figures()["wear"].clone()
    };
    let near = |wear: &Value, key: &str, is: f64| {
        assert!(wear[key].as_f64().is_some_and(|value| (value - is).abs() < 1e-9), "{key} must be {is}: {wear}");
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let wear = wear(bad);
        near(&wear, "mean_tension_n", 20.0);
        near(&wear, "peak_tension_n", 20.0);
        near(&wear, "current_a", 2.0);
        near(&wear, "misfit_m", 0.003);
        near(&wear, "drift_m", 0.25);
    }
}

#[test]
fn a_deviation_that_the_estimate_does_not_see_is_a_model_error() {
    let figures = Flight::new().fly(false, |_, _| ()).figures();
    let [estimate, truth] = &figures["deviations"].as_array().unwrap()[..] else { panic!("{figures}") };
    assert!((estimate["of"].as_str(), truth["of"].as_str()) == (Some("estimate"), Some("truth")));
    assert!((truth["max_m"].as_f64().unwrap() - PEAK_M).abs() < 3e-3, "{truth}");
    assert_eq!(kinds(truth), ["model"]);
}

#[test]
fn an_asked_time_has_its_own_errors_and_causes() {
    let (_folder, run) = Flight::new().fly(true, lose_at(258)).close();
    let between = |times: [f64; 2]| {
        let args = Args { runs: vec![run.clone()], out: None, between: Some(times.to_vec()), check: None };
        args.run().map(|output| output.value["runs"][0]["between"].clone())
    };
    let rise = between([BEFORE_S + 2.0, BEFORE_S + 4.0]).unwrap();
    assert_eq!(kinds(&rise["deviations"][0]), ["lost"]);
    assert!((rise["estimate"]["max_m"].as_f64().unwrap() - PEAK_M).abs() < 1e-9, "{rise}");
    let calm = between([BEFORE_S + 3.5, BEFORE_S + 4.0]).unwrap();
    assert!((calm["estimate"]["rms_m"].as_f64().unwrap() - CALM_M).abs() < 1e-9, "{calm}");
    assert!(between([60.0, 70.0]).unwrap()["deviations"].as_array().unwrap().is_empty());
    assert_eq!(between([4.0, 2.0]).unwrap_err().exit_code(), 2);
}

#[test]
fn laws_programs_and_parameters_in_charge_are_named_over_time() {
    let mut flight = Flight::new();
    let mut config = |incarnation, from_seq, name: &str, law: &str, parameters: &str| {
        let mut config = SystemConfig { incarnation, from_seq, ..Default::default() };
        put_text(&mut config.name, name);
        put_text(&mut config.law, law);
        put_text(&mut config.program, "/opt/laws/mine");
        put_text(&mut config.parameters, parameters);
        flight.write(&format!("system/config/{name}"), config, 1);
    };
    config(11, 1, "controller-a", "lq-endpoint", "horizon_cycles = 12\ngain = 1.5");
    config(11, 100, "controller-a", "lq-endpoint", "horizon_cycles = 20\ngain = 1.5");
    config(22, 1, "controller-b", "mine", "gain = 2.0");
    let figures = flight
        .fly(true, |cycle, samples| {
            samples.control.incarnation = if cycle < 300 { 11 } else { 22 };
            samples.authority.active_controller = u8::from(cycle >= 300);
        })
        .figures();
    let all = figures["in_charge"].as_array().unwrap();
    let spans: Vec<&Value> = all.iter().filter(|span| span["role"] == "controller").collect();
    let names: Vec<_> =
        spans.iter().map(|span| (span["name"].as_str().unwrap(), span["law"].as_str().unwrap())).collect();
    assert_eq!(names, [("controller-a", "lq-endpoint"), ("controller-a", "lq-endpoint"), ("controller-b", "mine")]);
    let cycles: Vec<u64> = spans.iter().map(|span| span["from_cycle"].as_u64().unwrap()).collect();
    assert_eq!(cycles, [1, 100, 300]);
    assert_eq!(spans[1]["changed"], serde_json::json!(["horizon_cycles"]));
    assert_eq!(
        (&spans[1]["parameters"]["horizon_cycles"], &spans[2]["program"]),
        (&20.into(), &"/opt/laws/mine".into())
    );
    // Without a report of its configuration, a process is known by the number of its method.
    assert!(all.iter().any(|span| span["role"] == "estimator" && span["name"].is_null()), "{all:?}");
}

#[test]
fn drive_units_and_sensors_have_names_and_the_file_is_what_is_printed() {
    let mut flight = Flight::new();
    let unit = DriveUnit {
        port: "/dev/ttyACM0".into(),
        name: "unit 0x80".into(),
        firmware: "USB Roboclaw 2x15a v4.2.4".into(),
        watchdog_ms: 100,
    };
    let mut line = LogEvent { level: LogEvent::LEVEL_INFO, ..Default::default() };
    put_text(&mut line.text, &unit.to_string());
    flight.write("system/log/motor-io", line, 1);
    let mut reading = Reading { count: 2, ..Default::default() };
    (reading.value[0], reading.value[1]) = (3.5, 271.0);
    put_text(&mut reading.quantity, "wind speed,wind direction");
    put_text(&mut reading.unit, "m/s,deg");
    flight.write("sensor/wind", reading, 2);
    let (_folder, run) = flight.fly(true, |_, _| ()).close();
    let output = report(std::slice::from_ref(&run), None).unwrap();
    let one = &output.value["runs"][0];
    assert_eq!(one["drive_units"], serde_json::json!([unit]));
    let names: Vec<&Value> = (0..2).map(|at| &one["sensors"][0]["values"][at]["name"]).collect();
    assert_eq!(names, ["wind speed, m/s", "wind direction, deg"]);
    let page = std::fs::read_to_string(run.join("report.html")).unwrap();
    for shown in ["wind direction, deg", &unit.firmware, "no recorded cause"] {
        assert!(page.contains(shown), "{shown}");
    }
    let file = std::fs::read_to_string(run.join("report.json")).unwrap();
    assert_eq!(file, format!("{}\n", output.value));
}

#[test]
fn limits_of_a_file_are_checked_in_the_same_report() {
    let (_folder, run) = Flight::new().fly(true, |_, _| ()).close();
    let limits = run.join("limits.toml");
    let check = |text: &str| {
        std::fs::write(&limits, text).unwrap();
        Args { runs: vec![run.clone()], out: None, between: None, check: Some(limits.clone()) }.run()
    };
    let kept = check("analysis.estimate.max_m.max = 0.0121\nfaults.max = 0").unwrap();
    assert_eq!((kept.failure, kept.value["limits"].as_array().unwrap().len()), (None, 2));
    let broken = check("analysis.estimate.max_m.max = 0.011\nfaults.max = 0").unwrap();
    assert_eq!(broken.failure.as_ref().unwrap().exit_code(), 1);
    assert!(broken.words.contains("analysis.estimate.max_m") && broken.words.contains("0.011"), "{}", broken.words);
    assert_eq!(std::fs::read_to_string(run.join("report.json")).unwrap(), format!("{}\n", broken.value));
    // Every key of the example is one of a report.
    let example = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../configs/limits/flight.toml");
    let example = check(&std::fs::read_to_string(example).unwrap()).unwrap();
    assert!(example.value["limits"].as_array().unwrap().len() > 10, "{}", example.words);
    let unknown = check("analysis.estimate.maxm.max = 1").unwrap_err();
    assert!(unknown.exit_code() == 2 && unknown.to_string().contains("max_m"), "{unknown}");
}

/// A driver repeats its last reading while its device is silent; the values are apart though their names are equal.
#[test]
fn values_of_a_sensor_are_judged_one_by_one_and_not_as_repeated() {
    let mut flight = Flight::new();
    for cycle in (2..540).step_by(2) {
        let mut reading = Reading { count: 8, ..Default::default() };
        // The spike is in the sixth value only.
        let noise = 0.001 * (7 * cycle % 11) as f64;
        reading.value = std::array::from_fn(|at| at as f64 + noise + if cycle == 400 && at == 5 { 50.0 } else { 0.0 });
        reading.quality = if (200..300).contains(&cycle) { Reading::QUALITY_STALE } else { Reading::QUALITY_GOOD };
        put_text(&mut reading.quantity, "level,temperature,temperature,d,e,f,g,h");
        put_text(&mut reading.unit, "m,degC,degC");
        flight.write("sensor/probe", reading, cycle);
    }
    let figures = flight.fly(true, |_, _| ()).figures();
    let sensor = &figures["sensors"][0];
    assert_eq!((&sensor["samples"], &sensor["doubtful"]), (&Value::from(269), &Value::from(50)));
    let values = sensor["values"].as_array().unwrap();
    let names: Vec<&str> = values.iter().map(|value| value["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["level, m", "temperature [2], degC", "temperature [3], degC", "d", "e", "f", "g", "h"]);
    for (at, value) in values.iter().enumerate() {
        assert_eq!(value["flags"]["gaps"]["count"], 1, "{value}");
        assert_eq!(value["flags"]["spikes"]["count"], u64::from(at == 5), "{value}");
        assert!((value["range"][0].as_f64().unwrap() - at as f64).abs() < 0.011, "{value}");
    }
}

#[test]
fn a_step_that_was_never_measured_breaks_its_limit() {
    let (_folder, run) = Flight::new()
        .fly(true, |cycle, samples| {
            // Every other cycle uses no command, which has no age.
            samples.authority.command_age_ns = if cycle % 2 == 0 { 12_000_000 } else { 0 };
        })
        .close();
    let limits = run.join("limits.toml");
    std::fs::write(&limits, "times.command_age.max_ns.max = 13_000_000\ntimes.state_to_command.max_ns.max = 5_000_000")
        .unwrap();
    let checked = Args { runs: vec![run.clone()], out: None, between: None, check: Some(limits) }.run().unwrap();
    let broken: Vec<&Value> = checked.value["limits"].as_array().unwrap().iter().map(|row| &row["broken"]).collect();
    assert!(broken[0].is_null() && broken[1].as_str().unwrap().contains("no number in this run"), "{broken:?}");
    let times = &checked.value["runs"][0]["times"];
    assert_eq!((&times[3]["samples"], &times[3]["p50_ns"]), (&Value::from(0), &Value::Null), "{times}");
    let (samples, p50_ns) = (times[2]["samples"].as_u64().unwrap(), times[2]["p50_ns"].as_u64().unwrap());
    assert!((200..300).contains(&samples) && p50_ns.abs_diff(12_000_000) < 120_000, "{times}");
}

#[test]
fn runs_of_a_folder_are_listed_with_their_trends() {
    let folder = tempfile::tempdir().unwrap();
    for (name, tension_n) in [("1", 20.0), ("2", 30.0), ("3", 40.0)] {
        let (own, run) = Flight::new().fly(true, |_, samples| samples.estimate.tension_n = [tension_n; 8]).close();
        std::fs::create_dir(folder.path().join(name)).unwrap();
        std::fs::copy(run.join("run.mcap"), folder.path().join(name).join("run.mcap")).unwrap();
        drop(own);
    }
    std::fs::create_dir(folder.path().join("no run")).unwrap();
    let listed = run_list::list(folder.path()).unwrap();
    assert_eq!(listed.failure, None);
    let listed = listed.value;
    let rows = listed["runs"].as_array().unwrap();
    assert_eq!(rows.iter().map(|row| row["run"].as_str().unwrap()).collect::<Vec<_>>(), ["1", "2", "3"]);
    assert!(rows.iter().all(|row| row["system"] == "synthetic" && row["verdict"]["grade"].is_string()), "{rows:?}");
    assert!(rows.iter().all(|row| row["deviation_of"] == "estimate"), "{rows:?}");
    let trends = listed["trends"].as_array().unwrap();
    let peak = trends.iter().find(|trend| trend["figure"] == "peak tension").unwrap();
    assert!((peak["per_run"].as_f64().unwrap() - 10.0).abs() < 1e-9, "{peak}");
    // The figures that a report left are those that the list would compute.
    report(&[folder.path().join("2")], None).unwrap();
    assert_eq!(run_list::list(folder.path()).unwrap().value, listed);
    // One that cannot be read is among the others, and the command fails.
    std::fs::create_dir(folder.path().join("4")).unwrap();
    std::fs::write(folder.path().join("4/run.mcap"), "not a run").unwrap();
    let output = run_list::list(folder.path()).unwrap();
    let rows = output.value["runs"].as_array().unwrap();
    assert_eq!(rows[..3], listed["runs"].as_array().unwrap()[..]);
    assert_eq!((&rows[3]["run"], &output.value["trends"]), (&"4".into(), &listed["trends"]));
    let failure = output.failure.unwrap();
    assert!(failure.exit_code() == 1 && failure.to_string().contains("1 of 4 runs"), "{failure}");
    assert!(rows[3]["failed"].as_str().is_some_and(|why| output.words.contains(why)), "{}", output.words);
}

#[test]
fn charts_over_time_show_the_marks_of_operators() {
    let lines = |marks: &[u64]| {
        let mut flight = Flight::new().fly(true, |_, _| ());
        for cycle in marks {
            let mut request =
                OperatorRequest { answered: 1, accepted: OperatorRequest::ACCEPTED, ..Default::default() };
            request.body.verb = RequestBody::VERB_MARK;
            put_text(&mut request.text, &format!("a leaf moved in {cycle}"));
            flight.write("operator/request", request, *cycle);
        }
        let (_folder, run) = flight.close();
        report(std::slice::from_ref(&run), None).unwrap();
        let page = std::fs::read_to_string(run.join("report.html")).unwrap();
        (page.matches("stroke-dasharray").count(), page.matches("</i>mark</").count(), page)
    };
    let (plain, keys, _) = lines(&[]);
    assert_eq!(keys, 0);
    let (one, keys, page) = lines(&[200]);
    // The key of a section names them once.
    assert!(keys >= 3 && one >= plain + keys, "{keys} keys, {plain} and {one} dashed lines");
    assert!(page.contains("a leaf moved in 200"));
    let (two, same, _) = lines(&[200, 400]);
    assert_eq!((two, same), (plain + 2 * (one - plain), keys));
}
