//! Sensors that fall silent, or come back with another definition: what the report and the maps make of them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;

use analysis::map::{Args, run as map};
use analysis::report::report;
use messages::{Header, MotorAuthority, NodeEstimate, Reading, put_text};
use runlog::{Attachment, ChannelSpec, RunClock, RunWriter};
use serde_json::Value;

const PERIOD_NS: u64 = 50_000_000;
/// A minute.
const CYCLES: u64 = 1200;
const CLOCK: RunClock = RunClock { t0_unix_ns: 1_767_225_600_000_000_000, t0_mono_ns: 0 };

messages::message! {
    /// A probe.
    pub struct Probe {
        header: Header,
        moisture_percent: f64,
    }
}

messages::message! {
    /// The same probe after its program was changed.
    pub struct NewProbe {
        header: Header,
        spare_k: f64,
        temperature_c: f64,
    }
}

messages::message! {
    /// Values in an array and beside it.
    pub struct Mast {
        header: Header,
        wind_m_s: [f64; 2],
        temperature_c: f64,
    }
}

messages::message! {
    /// More values than a reading has.
    pub struct Station {
        header: Header,
        wind_m_s: [f64; 2],
        first_k: [f32; 2],
        a: f64,
        b: f64,
        c: f64,
        d: f64,
        e: f64,
        f: f64,
        g: f64,
        h: f64,
        i: f64,
        j: f64,
    }
}

/// Writes a run with a robot file, and returns the writer.
fn begin(path: &Path) -> RunWriter {
    let robot = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/robots/lab3.toml")).unwrap();
    let robot = Attachment { name: "robot.toml".into(), media_type: "application/toml".into(), data: robot };
    RunWriter::create(path, CLOCK, &Default::default(), &[robot]).unwrap()
}

/// Writes a run in which the node goes around once.
/// * `sensor/probe` has another type from 20 to 40 s;
/// * `sensor/front/left` is in millimetres from 30 s on;
/// * `sensor/lost` says nothing more from 30 s on;
/// * `sensor/mast` has an array before its last value.
fn write(path: &Path) {
    let mut writer = begin(path);
    let mut channel = |spec: ChannelSpec| writer.add_channel(&spec).unwrap();
    let channels = [
        channel(ChannelSpec::for_type::<MotorAuthority>("motor/authority")),
        channel(ChannelSpec::for_type::<NodeEstimate>("node/estimate/a")),
        channel(ChannelSpec::for_type::<Probe>("sensor/probe")),
        channel(ChannelSpec::for_type::<NewProbe>("sensor/probe")),
        channel(ChannelSpec::for_type::<Reading>("sensor/front/left")),
        channel(ChannelSpec::for_type::<Reading>("sensor/lost")),
        channel(ChannelSpec::for_type::<Mast>("sensor/mast")),
    ];
    for cycle in 1..=CYCLES {
        let stamp_ns = cycle * PERIOD_NS;
        let header = Header { life: 1, cycle, seq: cycle, oldest_input_ns: stamp_ns, ..Header::at(stamp_ns) };
        let mut put = |channel: usize, sample: &[u8]| {
            writer.write(channels[channel], cycle, stamp_ns, stamp_ns, sample).unwrap();
        };
        let (turn, noise) = (std::f64::consts::TAU * cycle as f64 / CYCLES as f64, 0.1 * (cycle as f64 * 1.7).sin());
        let authority = MotorAuthority { header, cable_count: 3, period_s: 0.05, ..Default::default() };
        put(0, bytemuck::bytes_of(&authority));
        let position_m = [4.5 + turn.cos(), 3.2 + turn.sin(), 0.8];
        put(1, bytemuck::bytes_of(&NodeEstimate { header, position_m, valid: 1, ..Default::default() }));
        let third = (cycle - 1) / (CYCLES / 3);
        if third == 1 {
            put(3, bytemuck::bytes_of(&NewProbe { header, spare_k: 280.0 + noise, temperature_c: 5.0 + noise }));
        } else {
            put(2, bytemuck::bytes_of(&Probe { header, moisture_percent: 30.0 + noise }));
        }
        let wind_m_s = [3.0 + noise, 4.0 + noise];
        put(6, bytemuck::bytes_of(&Mast { header, wind_m_s, temperature_c: 15.0 + noise }));
        let (unit, per_m) = if cycle <= CYCLES / 2 { ("m", 1.0) } else { ("mm", 1e3) };
        let mut reading = Reading { header, count: 1, ..Reading::default() };
        reading.value[0] = per_m * (0.7 + 0.1 * noise);
        put_text(&mut reading.quantity, "distance");
        put_text(&mut reading.unit, unit);
        put(4, bytemuck::bytes_of(&reading));
        if cycle <= CYCLES / 2 {
            put(5, bytemuck::bytes_of(&reading));
        }
    }
    writer.finish(&Default::default()).unwrap();
}

#[test]
fn the_report_has_the_values_of_each_definition_and_the_last_silence() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    write(&run);
    let output = report(std::slice::from_ref(&run), Some(&folder.path().join("page.html"))).unwrap();
    let sensors = output.value["runs"][0]["sensors"].as_array().unwrap();
    let values = |channel: &str| {
        let sensor = sensors.iter().find(|sensor| sensor["channel"] == channel).unwrap();
        sensor["values"].as_array().unwrap().clone()
    };
    let range = |value: &Value| [&value["range"][0], &value["range"][1]].map(|end| end.as_f64().unwrap());
    let probe: Vec<(String, [f64; 2])> =
        values("sensor/probe").iter().map(|value| (value["name"].as_str().unwrap().to_owned(), range(value))).collect();
    let wanted = [("moisture_percent", 30.0), ("spare_k", 280.0), ("temperature_c", 5.0)];
    assert_eq!(probe.len(), wanted.len(), "{probe:?}");
    for ((name, [low, high]), (wanted, about)) in probe.iter().zip(wanted) {
        assert!(name == wanted && *low > about - 0.2 && *high < about + 0.2, "{probe:?}");
    }
    // The first definition was silent while the second one spoke, and spoke again.
    let gaps = |channel: &str, value: usize| {
        let gaps = values(channel)[value]["flags"]["gaps"].clone();
        [&gaps["count"], &gaps["first_s"], &gaps["largest"]].map(|figure| figure.as_f64().map(f64::round))
    };
    assert_eq!(gaps("sensor/probe", 0), [1.0, 20.0, 20.0].map(Some));
    assert_eq!(gaps("sensor/lost", 0), [1.0, 30.0, 30.0].map(Some));
    assert_eq!(gaps("sensor/front/left", 1), [Some(0.0), None, Some(0.0)]);
    // What a sensor is no more is not silent: the second definition ended at 40 s, and metres at 30 s.
    for (channel, value) in [("sensor/probe", 1), ("sensor/probe", 2), ("sensor/front/left", 0)] {
        assert_eq!(gaps(channel, value), [Some(0.0), None, Some(0.0)], "{channel} {value}");
    }
}

#[test]
fn the_report_counts_the_values_that_it_does_not_show() {
    let folder = tempfile::tempdir().unwrap();
    let (run, page) = (folder.path().join("run.mcap"), folder.path().join("page.html"));
    let mut writer = begin(&run);
    let [station, probe] =
        [ChannelSpec::for_type::<Station>("sensor/sky<1>"), ChannelSpec::for_type::<Probe>("sensor/probe")]
            .map(|spec| writer.add_channel(&spec).unwrap());
    for cycle in 1..=100 {
        let stamp_ns = cycle * PERIOD_NS;
        let header = Header { cycle, seq: cycle, ..Header::at(stamp_ns) };
        let sample = Station { header, a: 1.0, h: 8.0, i: 9.0, ..Default::default() };
        writer.write(station, cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&sample)).unwrap();
        let sample = Probe { header, moisture_percent: 30.0 };
        writer.write(probe, cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&sample)).unwrap();
    }
    writer.finish(&Default::default()).unwrap();
    let output = report(std::slice::from_ref(&run), Some(&page)).unwrap();
    let sensors = output.value["runs"][0]["sensors"].as_array().unwrap();
    let sensor = |channel: &str| sensors.iter().find(|sensor| sensor["channel"] == channel).unwrap();
    let values = sensor("sensor/sky<1>")["values"].as_array().unwrap();
    let names: Vec<&str> = values.iter().map(|value| value["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["a", "b", "c", "d", "e", "f", "g", "h"]);
    // Two arrays of two numbers, and the ninth and tenth number.
    assert_eq!((&sensor("sensor/sky<1>")["left_out"], &sensor("sensor/probe")["left_out"]), (&6.into(), &0.into()));
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("6 further values of sensor/sky&lt;1&gt; "));
    assert!(!page.contains("further values of sensor/probe"));
}

#[test]
fn values_of_another_definition_or_unit_have_a_map_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    write(&run);
    let out = folder.path().join("map");
    let all = Args {
        run,
        out: Some(out.clone()),
        sensor: Vec::new(),
        cell: None,
        reach: None,
        value: None,
        looks_down: false,
        sigma: None,
        footprint: None,
        between: None,
        recompute: false,
    };
    let output = map(&all).unwrap();
    let maps = output.value["maps"].as_array().unwrap();
    let rows: Vec<(&str, &str, f64)> = maps
        .iter()
        .map(|map| {
            let number = |key: &str| map[key].as_f64().unwrap();
            let (name, unit) = (map["sensor"].as_str().unwrap(), map["unit"].as_str().unwrap());
            (name, unit, 0.5 * (number("low") + number("high")))
        })
        .collect();
    let wanted = [
        ("front/left", "m", 0.7),
        ("front/left@2", "mm", 700.0),
        ("lost", "m", 0.7),
        ("mast", "", 3.0),
        ("probe", "", 30.0),
        ("probe@2", "", 280.0),
    ];
    assert_eq!(rows.len(), wanted.len(), "{rows:?}");
    for (row, wanted) in rows.iter().zip(wanted) {
        assert_eq!((row.0, row.1), (wanted.0, wanted.1));
        assert!((row.2 / wanted.2 - 1.0).abs() < 0.1, "{rows:?}");
    }
    // The type that came back is decoded as before.
    let samples = |name: &str| maps.iter().find(|map| map["sensor"] == name).unwrap()["samples"].as_u64().unwrap();
    assert!((790..=800).contains(&samples("probe")) && samples("probe@2") == 400, "{}", output.words);
    for (file, column) in [("front.left@2", "distance_mm"), ("probe", "moisture_percent"), ("probe@2", "temperature_c")]
    {
        let table = std::fs::read_to_string(out.join(format!("{file}.csv"))).unwrap();
        assert!(table.lines().next().unwrap().split(',').any(|head| head == column), "{file}: {table:.200}");
    }
    // One sensor is asked for with all that it was.
    let output =
        map(&Args { sensor: vec!["probe".to_owned()], out: Some(folder.path().join("probe")), ..all.clone() }).unwrap();
    assert_eq!(output.value["maps"].as_array().unwrap().len(), 2);
    // Or with one of these, by the name of the files and of the output.
    let one = |name: &str| map(&Args { sensor: vec![name.to_owned()], sigma: Some(0.25), ..all.clone() });
    let maps = one("probe@2").unwrap().value["maps"].clone();
    assert_eq!((maps.as_array().unwrap().len(), maps[0]["sensor"].as_str()), (1, Some("probe@2")));
    assert!(one("probe@3").is_err());
}

#[test]
fn a_missing_value_of_a_sample_keeps_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    let mut writer = begin(&run);
    let [estimates, probe] =
        [ChannelSpec::for_type::<NodeEstimate>("node/estimate/a"), ChannelSpec::for_type::<NewProbe>("sensor/probe")]
            .map(|spec| writer.add_channel(&spec).unwrap());
    for cycle in 1..=CYCLES {
        let stamp_ns = cycle * PERIOD_NS;
        let header = Header { life: 1, cycle, seq: cycle, oldest_input_ns: stamp_ns, ..Header::at(stamp_ns) };
        let turn = std::f64::consts::TAU * cycle as f64 / CYCLES as f64;
        let position_m = [4.5 + turn.cos(), 3.2 + turn.sin(), 0.8];
        let estimate = NodeEstimate { header, position_m, valid: 1, ..Default::default() };
        writer.write(estimates, cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&estimate)).unwrap();
        // The second value is missing in half of the samples, and both in a quarter of them.
        let value = |is_there: bool, value: f64| if is_there { value } else { f64::NAN };
        let spare_k = value(!cycle.is_multiple_of(4), 280.0 + (cycle as f64 * 1.7).sin());
        let temperature_c = value(!cycle.is_multiple_of(2), 5.0 + (cycle as f64 * 1.3).sin());
        let sample = NewProbe { header, spare_k, temperature_c };
        writer.write(probe, cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&sample)).unwrap();
    }
    writer.finish(&Default::default()).unwrap();
    let points = |value: u8| {
        let out = folder.path().join(value.to_string());
        let args = Args {
            run: run.clone(),
            out: Some(out.clone()),
            sensor: vec!["probe".to_owned()],
            cell: None,
            reach: None,
            value: Some(value),
            looks_down: false,
            sigma: None,
            footprint: None,
            between: None,
            recompute: false,
        };
        map(&args).unwrap();
        std::fs::read_to_string(out.join("probe.ply")).unwrap().lines().skip_while(|line| *line != "end_header").count()
            - 1
    };
    let count = CYCLES as usize;
    assert_eq!([points(1), points(2)], [count - count / 4, count - count / 2]);
    let table = std::fs::read_to_string(folder.path().join("1/probe.csv")).unwrap();
    let quality = table.lines().next().unwrap().split(',').position(|name| name == "quality").unwrap();
    let invalid = table.lines().filter(|line| line.split(',').nth(quality) == Some("3")).count();
    assert_eq!((table.lines().count() - 1, invalid), (count, count / 4));
}
