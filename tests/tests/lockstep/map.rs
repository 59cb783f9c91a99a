//! From a flight over known ground to its map: the error is below the map's standard deviations, whether the sensor
//! logger ran in flight or not, and independent software can read the map.

use analysis::map::{Args, logger_config, maps_of_run, run as map};
use command::{Failure, Output};
use config::SensorLoggerSection;
use georeference::{Decoder, Logger, LoggerConfig};
use messages::{Header, Message, NodeEstimate, Reading, Sample, put_text};
use motor_box::GroundFile;
use nims_sim::Tape;
use nims_tests::lockstep::Lockstep;
use nims_tests::python;
use nims_tests::scenarios::Case;
use planner::Mission;
use plant::ground::Ground;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

const LATENCY_NS: u64 = 50_000_000;
/// Noise of a reading, m.
const NOISE_M: f64 = 0.005;
/// Cycles between two readings.
const EVERY: u64 = 2;
const MISSION: &str = "name = \"scan\"\nspeed_m_s = 0.4\n[[leg]]\n\
    raster = { corner_m = [3.4, 2.1, 0.8], opposite_m = [5.6, 4.3, 0.8], pitch_m = 0.1 }\n";

messages::message! {
    /// A type that this project does not define.
    pub struct Soil {
        header: Header,
        moisture_percent: f64,
    }
}

fn configs(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs").join(file)
}

fn ground() -> Ground {
    motor_box::settings::ground_of(&GroundFile::load(&configs("ground/fig10.toml")).unwrap())
}

fn moisture(x: f64, y: f64) -> f64 {
    20.0 + 5.0 * (1.2 * x).sin() + 3.0 * y
}

/// Flies a raster over the ground with a rangefinder that looks down and a probe, and writes a run file; with
/// `sample/*` if `logged`.
fn fly(path: &Path, logged: bool) {
    fly_logged(path, |_| logged);
}

/// The same with `sample/*` in the cycles in which the sensor logger runs.
fn fly_logged(path: &Path, logged: impl Fn(u64) -> bool) {
    let case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };
    let mut scenario = case.scenario(true).unwrap();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("mission.toml"), MISSION).unwrap();
    let mission = Mission::read(&folder.path().join("mission.toml")).unwrap();
    scenario.mission = mission.clone();
    let config = LoggerConfig::from_section(&SensorLoggerSection::default(), &scenario.robot);
    let mut logger = Logger::new(&config).unwrap();
    let sensor = config.sensor("range").unwrap();
    let decoder = Decoder::new(&sensor, Reading::type_name(), Reading::schema(), size_of::<Reading>()).unwrap();
    logger.sensor("range", &sensor, decoder);

    let ground = ground();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    let mut tape = Tape::new(path, &configs("systems/demo3.toml")).unwrap();
    let mut random = 1_u64;
    let mut underway: Vec<(u64, Reading, Soil)> = Vec::new();
    let (mut seq, mut rest, mut begun) = (0, 0, false);
    for number in 1..40_000_u64 {
        if number == 2 {
            lockstep.zero_and_arm().unwrap();
            lockstep.run(&mission).unwrap();
            begun = true;
        }
        let now = lockstep.cycle().unwrap();
        tape.cycle(&now, lockstep.slots()).unwrap();
        logger.authority(&now.authority);
        logger.estimate(0, &now.estimate);
        let stamp_ns = now.estimate.header.stamp_ns;
        if number.is_multiple_of(EVERY) && now.estimate.valid == 1 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // evenly spread, of this standard deviation
            let noise = NOISE_M * 12.0_f64.sqrt() * ((random >> 11) as f64 / (1_u64 << 53) as f64 - 0.5);
            seq += 1;
            let mut header = Header::at(stamp_ns + LATENCY_NS);
            (header.oldest_input_ns, header.seq) = (stamp_ns, seq);
            let mut reading = Reading { header, count: 1, ..Reading::default() };
            reading.value[0] = ground.distance_m(now.truth_m, 0.0) + noise;
            put_text(&mut reading.quantity, "distance");
            put_text(&mut reading.unit, "m");
            let [x, y, _] = now.truth_m;
            underway.push((header.stamp_ns, reading, Soil { header, moisture_percent: moisture(x, y) }));
        }
        while underway.first().is_some_and(|(arrives_ns, ..)| *arrives_ns <= stamp_ns) {
            let (_, reading, soil) = underway.remove(0);
            tape.write("sensor/range", reading).unwrap();
            tape.write("sensor/soil", soil).unwrap();
            logger.reading(0, bytemuck::bytes_of(&reading), stamp_ns);
        }
        while let Some((_, sample)) = logger.next_sample(stamp_ns) {
            if logged(number) {
                tape.write("sample/range", sample).unwrap();
            }
        }
        let done = begun && now.plan.state == messages::PlanStatus::STATE_DONE;
        rest = if done { rest + 1 } else { 0 };
        if rest == 100 {
            tape.finish().unwrap();
            return;
        }
    }
    panic!("the scan does not end");
}

fn asked(run: &Path, out: &Path) -> Args {
    Args {
        run: run.to_owned(),
        out: Some(out.to_owned()),
        sensor: vec!["range".into()],
        cell: Some(0.05),
        reach: Some(0.2),
        value: None,
        looks_down: true,
        sigma: None,
        footprint: None,
        between: None,
        recompute: false,
    }
}

/// x, y, value, sigma of every known cell.
fn cells(folder: &Path, sensor: &str) -> Vec<[f64; 4]> {
    let text = std::fs::read_to_string(folder.join(format!("{sensor}-grid.csv"))).unwrap();
    let rows = text.lines().skip(1).map(|line| line.split(',').map(|word| word.parse().unwrap()).collect::<Vec<f64>>());
    rows.map(|row| [row[0], row[1], row[2], row[3]]).collect()
}

#[test]
fn ground_that_was_flown_over_is_on_the_map() {
    let folder = tempfile::tempdir().unwrap();
    // NIMS_KEEP: a folder in which the pictures are kept
    let out = std::env::var_os("NIMS_KEEP").map_or_else(|| folder.path().join("map"), PathBuf::from);
    let run = folder.path().join("run");
    std::fs::create_dir(&run).unwrap();
    fly(&run.join("run.mcap"), false);
    let site = "\n[site]\nlatitude_deg = 34.0722\nlongitude_deg = -118.4441\nazimuth_deg = 30.0\n";
    let robot = std::fs::read_to_string(configs("robots/lab3.toml")).unwrap() + site;
    std::fs::write(run.join("robot.toml"), robot).unwrap();
    let Output { value, words, .. } = map(&asked(&run, &out)).unwrap();
    println!("{words}");
    let told = &value["maps"][0];
    assert_eq!((told["samples_are"].as_str(), told["quantity"].as_str()), (Some("computed"), Some("height")));
    let noise = told["noise"].as_f64().unwrap();
    assert!((noise / NOISE_M - 1.0).abs() < 0.3, "the noise that was found: {noise}");

    let ground = ground();
    let (mut within, mut flat, mut steep, mut all) = (0, Vec::new(), Vec::new(), 0);
    for [x, y, height, sigma] in cells(&out, "range") {
        let truth = ground.height_m([x, y]);
        let error = height - truth;
        all += 1;
        within += u32::from(error.abs() < 2.0 * sigma + 1e-4);
        let edge = [
            [-0.1, 0.0],
            [0.1, 0.0],
            [0.0, -0.1],
            [0.0, 0.1],
            [0.07, 0.07],
            [-0.07, 0.07],
            [0.07, -0.07],
            [-0.07, -0.07],
        ]
        .iter()
        .any(|[dx, dy]| (ground.height_m([x + dx, y + dy]) - truth).abs() > 0.01);
        if edge { steep.push(error) } else { flat.push(error) }
    }
    let rms = |errors: &[f64]| (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
    println!(
        "{all} cells: {:.1} % within two standard deviations; {:.1} mm RMS on {} cells away from edges, {:.1} mm on {} beside them",
        100.0 * f64::from(within) / f64::from(all),
        1e3 * rms(&flat),
        flat.len(),
        1e3 * rms(&steep),
        steep.len()
    );
    assert!(all > 1500);
    assert!(f64::from(within) > 0.9 * f64::from(all));
    assert!(rms(&flat) < 0.004);
    assert!(rms(&steep) < 0.08);

    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = python();
    let output = Command::new(&python).arg(root.join("python/check_map.py")).arg(&out).arg("range").output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let geojson = std::fs::read_to_string(out.join("range.geojson")).unwrap();
    let cells: Value = serde_json::from_str(&geojson).unwrap();
    assert_eq!(cells["features"][0]["properties"]["unit"], "m");
    let table = std::fs::read_to_string(out.join("range.csv")).unwrap();
    let head = table.lines().next().unwrap();
    assert!(head.ends_with(",utc,t_s") && head.contains(",distance_m,"), "{head}");
    let times = table.lines().skip(1).map(|row| row.rsplit_once(',').unwrap().1.parse::<f64>().unwrap());
    let times: Vec<f64> = times.collect();
    assert!(times[0] >= 0.0 && times.windows(2).all(|two| two[0] < two[1]), "{:?}", &times[..2]);
    for ending in [".png", ".svg", "-sigma.png", "-sigma.svg"] {
        assert!(std::fs::metadata(out.join(format!("range{ending}"))).unwrap().len() > 5_000, "{ending}");
    }
}

#[test]
fn only_the_samples_between_two_heights_are_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    fly(&run, false);
    let mapped = |low_m: f64, high_m: f64| {
        map(&Args { between: Some(vec![low_m, high_m]), ..asked(&run, &folder.path().join("map")) })
    };
    // the raster is at 0.8 m, and the way to it begins at 0.3 m
    let all = mapped(0.0, 3.0).unwrap().value["maps"][0]["samples"].as_u64().unwrap();
    let raster = mapped(0.78, 0.82).unwrap().value["maps"][0]["samples"].as_u64().unwrap();
    assert!(raster < all && raster > all / 2, "{raster} of {all}");
    let table = std::fs::read_to_string(folder.path().join("map/range.csv")).unwrap();
    let heights = table.lines().skip(1).map(|row| row.split(',').nth(4).unwrap().parse::<f64>().unwrap());
    assert!(heights.clone().count() > 100 && heights.clone().all(|z| (0.78..=0.82).contains(&z)));
    let none = mapped(2.0, 3.0).unwrap_err();
    assert!(matches!(none, Failure::NotNow(_)), "{none:?}");
}

#[test]
fn the_report_of_the_flight_shows_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    fly(&run, false);
    let out = std::env::var_os("NIMS_KEEP").map_or_else(|| folder.path().to_owned(), PathBuf::from);
    let page = out.join("page.html");
    analysis::report::report(std::slice::from_ref(&run), Some(&page)).unwrap();
    let text = std::fs::read_to_string(&page).unwrap();
    // The captions themselves: map, quantity and the beginning of its range.
    assert!(text.contains("Map of range: distance from 0.") && text.contains("Map of soil: moisture_percent from "));
}

/// The page draws the map that the command writes.
#[test]
fn the_report_and_the_command_compute_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    fly(&run, true);
    assert_eq!(drawn_as_written(&run, folder.path()), ["range", "soil"]);
}

/// Names of the sensors of which the report draws the map that the command writes.
fn drawn_as_written(run: &Path, folder: &Path) -> Vec<String> {
    let all = Args { sensor: Vec::new(), cell: None, reach: None, looks_down: false, ..asked(run, folder) };
    map(&all).unwrap();
    let maps = maps_of_run(run, &logger_config(run).unwrap()).unwrap();
    for (name, drawn) in &maps {
        let written = cells(folder, name);
        let known = drawn.grid().cells().iter().flatten().count();
        assert_eq!(known, written.len(), "{name}");
        for [x, y, value, sigma] in written {
            let (column, row) = drawn.grid().spec().cell_at([x, y]).unwrap();
            let (shown, shown_sigma) = drawn.value(column, row).unwrap();
            // the table has four digits of the deviation
            assert!((shown - value).abs() <= 1e-8 * value.abs() && (shown_sigma / sigma - 1.0).abs() < 1e-3);
        }
    }
    maps.into_keys().collect()
}

#[test]
fn samples_of_the_flight_and_those_made_now_give_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    fly(&run, true);
    let (recorded, computed) = (folder.path().join("recorded"), folder.path().join("computed"));
    let Output { value, .. } = map(&asked(&run, &recorded)).unwrap();
    let origin = |value: &Value| value["maps"][0]["samples_are"].as_str().unwrap().to_owned();
    assert_eq!(origin(&value), "recorded");
    let Output { value, .. } = map(&Args { recompute: true, ..asked(&run, &computed) }).unwrap();
    assert_eq!(origin(&value), "computed");
    let (a, b) = (cells(&recorded, "range"), cells(&computed, "range"));
    assert!(a.len() == b.len() && a.len() > 1500);
    // the last readings were still under way when the flight ended
    let near = a.iter().zip(&b).filter(|(a, b)| a[..2] == b[..2] && (a[2] - b[2]).abs() < 2.0 * a[3]).count();
    assert!(near * 100 >= a.len() * 99, "{near} of {}", a.len());

    // all sensors of any type if none is named
    let all = Args { sensor: Vec::new(), looks_down: false, out: None, ..asked(&run, &recorded) };
    let Output { value, .. } = map(&all).unwrap();
    let names: Vec<&str> = value["maps"].as_array().unwrap().iter().filter_map(|map| map["sensor"].as_str()).collect();
    assert_eq!(names, ["range", "soil"]);
    for [x, y, percent, sigma] in cells(&folder.path().join("map"), "soil") {
        assert!((percent - moisture(x, y)).abs() < 4.0 * sigma + 0.02, "{x} {y} {percent} {sigma}");
    }
}

/// The sensor logger was started late, and died and was restarted on the way.
#[test]
fn what_the_sensor_logger_did_not_record_is_computed() {
    let folder = tempfile::tempdir().unwrap();
    let (run, whole) = (folder.path().join("run.mcap"), folder.path().join("whole.mcap"));
    fly_logged(&run, |cycle| (1000..3000).contains(&cycle) || cycle > 4500);
    fly(&whole, true);
    let (parts, all) = (folder.path().join("parts"), folder.path().join("all"));
    let told = map(&asked(&run, &parts)).unwrap().value["maps"][0].clone();
    let complete = map(&asked(&whole, &all)).unwrap().value["maps"][0].clone();
    assert_eq!((&told["samples_are"], &complete["samples_are"]), (&"recorded and computed".into(), &"recorded".into()));
    // At each border between the two, samples of at most two seconds are missing.
    let samples = |told: &Value| told["samples"].as_u64().unwrap();
    assert!(samples(&told) + 3 * 110 > samples(&complete) && samples(&told) <= samples(&complete), "{told}");
    assert!(told["computed"].as_u64().unwrap() > 800, "{told}");
    let (a, b) = (cells(&parts, "range"), cells(&all, "range"));
    assert!(a.len() * 100 >= b.len() * 98, "{} of {} cells", a.len(), b.len());
    // The files have the samples of both, in the order of their times.
    let table = std::fs::read_to_string(parts.join("range.csv")).unwrap();
    let stamps = table.lines().skip(1).map(|row| row.split(',').next().unwrap().parse::<u64>().unwrap());
    let stamps: Vec<u64> = stamps.collect();
    assert_eq!(stamps.len() as u64, samples(&told));
    assert!(stamps.windows(2).all(|two| two[0] < two[1]));
    let points = std::fs::read_to_string(parts.join("range.ply")).unwrap();
    let (head, points) = points.split_once("end_header\n").unwrap();
    assert!(head.contains(&format!("element vertex {}\n", points.lines().count())), "{head}");
    assert_eq!(points.lines().count(), stamps.len());
    assert_eq!(drawn_as_written(&run, &folder.path().join("as-drawn")), ["range", "soil"]);
}

#[test]
fn missing_inputs_are_reported_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let absent = map(&asked(&folder.path().join("none"), folder.path())).unwrap_err();
    assert!(matches!(absent, Failure::BadInput(_)), "{absent:?}");
    let system_path = configs("systems/demo3.toml");
    let run = folder.path().join("run.mcap");
    let mut tape = Tape::new(&run, &system_path).unwrap();
    tape.write("sensor/height", Reading::default()).unwrap();
    tape.finish().unwrap();
    let other = map(&asked(&run, folder.path())).unwrap_err();
    // The sensor of the run that can be mapped is named.
    assert!(matches!(&other, Failure::BadInput(named) if named.contains("height")), "{other:?}");
    let empty = map(&Args { sensor: Vec::new(), ..asked(&run, folder.path()) }).unwrap_err();
    assert!(matches!(empty, Failure::NotNow(_)), "{empty:?}");
}

/// Writes a run of this many cycles in which the node goes around, with a sensor that is read in each, and the samples
/// of the sensor logger, which did not run in the first minute.
fn long_run(path: &Path, cycles: u64) {
    let mut tape = Tape::new(path, &configs("systems/demo3.toml")).unwrap();
    for cycle in 1..=cycles {
        let stamp_ns = 1_000_000_000 + cycle * 10_000_000;
        // Ten seconds for one of many circles of growing and shrinking radius.
        let (turn, radius_m) = (cycle as f64 * 0.0063, 0.2 + 0.8 * (cycle % 60_000) as f64 / 60_000.0);
        let place = [4.5 + radius_m * turn.cos(), 3.2 + radius_m * turn.sin(), 0.8];
        let header = Header { oldest_input_ns: stamp_ns, cycle, ..Header::at(stamp_ns) };
        let estimate = NodeEstimate { header, position_m: place, valid: 1, ..NodeEstimate::default() };
        tape.write("node/estimate/a", estimate).unwrap();
        let mut reading = Reading { header, count: 1, ..Reading::default() };
        reading.value[0] = moisture(place[0], place[1]) + 0.1 * (cycle as f64 * 1.7).sin();
        tape.write("sensor/probe", reading).unwrap();
        if cycle > 6000 {
            let mut sample = Sample { header, position_m: place, reading_seq: cycle, count: 1, ..Sample::default() };
            sample.value[0] = reading.value[0];
            tape.write("sample/probe", sample).unwrap();
        }
    }
    tape.finish().unwrap();
}

/// Largest memory of `nims map` for this run, MiB, and what it answered.
fn memory_mib(run: &Path) -> (f64, Value) {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    let answer = run.with_extension("json");
    let mut command = Command::new(program);
    command.arg("map").arg(run).arg("--out").arg(run.with_extension("map")).arg("--json");
    let mut child = command.stdout(std::fs::File::create(&answer).unwrap()).spawn().unwrap();
    let mut most_kib = 0.0_f64;
    while child.try_wait().unwrap().is_none() {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
        let now_kib = line.and_then(|text| text.trim().parse::<f64>().ok()).unwrap_or(0.0);
        most_kib = most_kib.max(now_kib);
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(child.wait().unwrap().success());
    (most_kib / 1024.0, serde_json::from_str(&std::fs::read_to_string(answer).unwrap()).unwrap())
}

/// Each sample goes to its cell and to the files; the run of ten times the length needs no more memory.
#[test]
fn the_memory_of_a_map_does_not_grow_with_the_run() {
    let folder = tempfile::tempdir().unwrap();
    // NIMS_KEEP: a folder in which the runs are kept; NIMS_MAP_CYCLES: cycles of the long one, an hour is 360000
    let out = std::env::var_os("NIMS_KEEP").map_or_else(|| folder.path().to_owned(), PathBuf::from);
    let cycles = std::env::var("NIMS_MAP_CYCLES").ok().and_then(|text| text.parse().ok()).unwrap_or(100_000);
    let [short, long] = [cycles / 10, cycles].map(|cycles| {
        let run = out.join(format!("cycles-{cycles}.mcap"));
        long_run(&run, cycles);
        let (memory_mib, answer) = memory_mib(&run);
        let samples = answer["maps"][0]["samples"].as_u64().unwrap();
        println!("{samples} samples: {memory_mib:.1} MiB");
        // The two seconds before those of the sensor logger, and the last reading, have no sample.
        assert!(samples + 210 > cycles && samples <= cycles, "{samples} of {cycles}");
        memory_mib
    });
    assert!(long < short + 16.0, "{short:.1} MiB, {long:.1} MiB");
}
