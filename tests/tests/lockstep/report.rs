//! `nims report` of runs that are generated here, so that the correct content is known.

use analysis::accuracy::analyse;
use analysis::incidents::Incidents;
use analysis::report::report;
use command::Failure;
use messages::{MotorAuthority, OperatorRequest, ProcessState, RequestBody, put_text};
use motor_box::{FaultRequest, KINDS, Kind};
use nims_sim::Tape;
use nims_tests::lockstep::Lockstep;
use nims_tests::recorded::record;
use nims_tests::scenarios::Case;
use runlog::export::{ExportRequest, Format, export};
use std::path::{Path, PathBuf};

/// Long enough for the first legs of the mission.
const SECONDS: f64 = 14.0;

fn run(folder: &Path, name: &str, robot: &'static str, boxed: &str, truth: bool) -> PathBuf {
    let case = Case { robot, mission: "polyline", motor_s: [0.030, 0.040] };
    let run = folder.join(name);
    std::fs::create_dir_all(&run).unwrap();
    let system_path = format!("{}/../configs/systems/{boxed}.toml", env!("CARGO_MANIFEST_DIR"));
    record(&run.join("run.mcap"), Path::new(&system_path), &case, SECONDS, truth).unwrap();
    run
}

/// A self-contained page that draws no invalid number.
fn sound(page: &str) {
    for foreign in ["http:", "https:", "<script", "src=", "url(", "@import"] {
        assert!(!page.contains(foreign), "the page names {foreign}");
    }
    for wrong in ["NaN", "inf ", "infm"] {
        assert!(!page.contains(wrong), "the page holds {wrong}");
    }
    for tag in ["svg", "figure", "table", "section", "div", "main"] {
        let (open, close) = (page.matches(&format!("<{tag}")).count(), page.matches(&format!("</{tag}>")).count());
        assert_eq!(open, close, "<{tag}>");
    }
}

#[test]
fn one_run_several_and_a_torn_one() {
    let folder = tempfile::tempdir().unwrap();
    let three = run(folder.path(), "three", "lab3", "demo3", true);
    let four = run(folder.path(), "four", "lab4", "demo4", false);

    let command::Output { value, words, .. } = report(std::slice::from_ref(&three), None).unwrap();
    let page = std::fs::read_to_string(three.join("report.html")).unwrap();
    sound(&page);
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    let one = &value["runs"][0];
    // as in the demonstration's report
    let analysis = serde_json::to_value(analyse(&three).unwrap()).unwrap();
    assert_eq!(one["analysis"], analysis);
    assert!(one["analysis"]["truth"]["rms_m"].as_f64().unwrap() < 0.01);
    assert_eq!(one["recording"]["healthy"], true);
    assert_eq!(one["faults"], 0);
    let legs = one["legs"].as_array().unwrap();
    assert!(legs.len() >= 2 && legs[0]["complete"] == true, "{legs:?}");
    let first = &legs[0];
    let (flown, planned) = (first["duration_s"].as_f64().unwrap(), first["planned_s"].as_f64().unwrap());
    assert!(flown >= planned && flown < planned + 1.0, "{flown} s where {planned} s were planned");
    // A straight line costs the reference value by the model, and about the same by the currents.
    let (reckoned, straight) = (first["reckoned_j"].as_f64().unwrap(), first["straight_j"].as_f64().unwrap());
    assert!((reckoned / straight - 1.0).abs() < 0.02, "{reckoned} J, {straight} J");
    let lost = first["loss_j"].as_f64().unwrap();
    assert!(lost > 0.3 * reckoned && lost < 3.0 * reckoned, "{lost} J by the currents, {reckoned} J by the model");
    assert_eq!(one["sensors"][0]["channel"], "sensor/height");
    // The page itself is tested here and below: its figures, and the cables and runs that they show.
    for seen in [
        "Path from above",
        "Tension (truth)",
        "Power of all motors",
        "sensor/height along the path",
        "cable 3",
        "Following",
    ] {
        assert!(page.contains(seen), "{seen}");
    }
    assert!(!page.contains("cable 4"));
    // Nothing failed; the recording ends before the mission does.
    assert_eq!(one["verdict"]["grade"], "remarks", "{words}");

    // Without truth, and cut off in the middle.
    let bytes = std::fs::read(four.join("run.mcap")).unwrap();
    std::fs::write(four.join("run.mcap"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let value = report(&[three.clone(), four.clone()], Some(&folder.path().join("both.html"))).unwrap().value;
    let page = std::fs::read_to_string(folder.path().join("both.html")).unwrap();
    sound(&page);
    assert_eq!(value["runs"][1]["recording"]["healthy"], false);
    assert!(value["runs"][1]["analysis"]["truth"].is_null());
    assert!(page.contains("three and four") && page.contains("cable 4") && page.contains("The run has no truth"));
    // The same axes on both sides.
    let ticks = |caption: &str, which: usize| -> String {
        let figure = page.split(&format!("<b>{caption}</b>")).nth(which).unwrap();
        figure
            .split("</figure>")
            .next()
            .unwrap()
            .split("text-anchor=\"end\">")
            .skip(1)
            .map(|t| t.split('<').next().unwrap())
            .collect::<Vec<_>>()
            .join(" ")
    };
    assert_eq!(ticks("Motor current", 1), ticks("Motor current", 2));
}

/// A time that one of them states finds its cycle in the others.
#[test]
fn all_outputs_count_seconds_from_the_start_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = run(folder.path(), "three", "lab3", "demo3", true);
    let figures = report(std::slice::from_ref(&run), None).unwrap().value;
    let worst = &figures["runs"][0]["deviations"][0];
    let (at_s, cycle) = (worst["at_s"].as_f64().unwrap(), worst["cycle"].as_u64().unwrap());
    let at_ns = replay::instant_of(&run, &at_s.to_string()).unwrap();
    assert_eq!(replay::snapshot(&run, at_ns).unwrap().cycle, Some(cycle));
    // The exported row of that time, and of that time only.
    let request = ExportRequest {
        format: Format::Csv,
        folder: folder.path().join("tables"),
        channels: vec!["motor/authority".to_owned()],
        from_s: at_s - 1e-6,
        to_s: at_s + 1e-6,
    };
    let exported = export(&run, &request, &mut |_, _| ()).unwrap();
    let text = std::fs::read_to_string(&exported.tables[0].file).unwrap();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let column = rows[0].iter().position(|name| *name == "cycle").unwrap();
    assert_eq!((rows.len(), rows[1][column]), (2, cycle.to_string().as_str()), "{text}");
    // The channel of the last sample ends where the run ends.
    let info = runlog::info(&run).unwrap();
    let last_s = info.channels.iter().map(|channel| channel.last_s).fold(0.0, f64::max);
    assert!((info.first_s + info.duration_s - last_s).abs() < 1e-6, "{} s", info.first_s);
    let last_ns = replay::instant_of(&run, &last_s.to_string()).unwrap();
    assert_eq!(Some(last_ns), info.started_unix_ns.map(|first_ns| first_ns + (info.duration_s * 1e9).round() as u64));
}

#[test]
fn what_is_no_run_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let nothing = report(&[folder.path().join("nothing")], None).unwrap_err();
    assert!(matches!(&nothing, Failure::BadInput(named) if named.contains("nothing")), "{nothing:?}");
    let empty = report(&[folder.path().to_path_buf()], None).unwrap_err();
    assert!(empty.to_string().contains(folder.path().to_str().unwrap()), "{empty}");
}

/// A motor that stalls in flight: the report, its page and the instant tell the same in one sentence.
#[test]
fn a_fault_is_told_in_one_sentence_by_the_report_and_at_its_instant() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("stall");
    std::fs::create_dir_all(&run).unwrap();
    let scenario = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true).unwrap();
    let mission = scenario.mission.clone();
    let system_path = format!("{}/../configs/systems/demo3.toml", env!("CARGO_MANIFEST_DIR"));
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    let mut tape = Tape::new(&run.join("run.mcap"), Path::new(&system_path)).unwrap();
    for number in 0..1200 {
        if number == 800 {
            lockstep.plant_mut().apply(plant::Fault::Stall { cable: 1, on: true }).unwrap();
        }
        let now = lockstep.cycle().unwrap();
        tape.cycle(&now, lockstep.slots()).unwrap();
    }
    tape.finish().unwrap();

    let told = report(std::slice::from_ref(&run), None).unwrap();
    let figures = &told.value["runs"][0];
    let (incidents, incident) = (figures["incidents"].as_array().unwrap(), &figures["incidents"][0]);
    assert_eq!((incidents.len(), &incident["of"]), (1, &serde_json::json!(["cable 2"])), "{incidents:?}");
    let (sentence, time_s) = (incident["sentence"].as_str().unwrap(), incident["time_s"].as_f64().unwrap());
    assert!(sentence.contains("followed its motion") && sentence.contains("released cable 2"), "{sentence}");
    assert!(incident["utc"].is_string() && incident["cycle"].as_u64().unwrap() > 800, "{incident}");
    assert!(told.words.contains(&format!("fault      {sentence}")), "{}", told.words);
    assert!(std::fs::read_to_string(run.join("report.html")).unwrap().contains(sentence));

    let at = |at_s: f64| {
        let at_ns = replay::instant_of(&run, &at_s.to_string()).unwrap();
        replay::snapshot(&run, at_ns).unwrap()
    };
    assert_eq!(at(time_s - 1.0).happened, None);
    let after = at(time_s + 0.5);
    assert_eq!(after.happened.as_ref().map(|incident| incident.sentence.as_str()), Some(sentence));
    assert!(after.words().contains(&format!("\nfault: {sentence}\n")), "{}", after.words());
}

/// A request of this kind for cable 2, for port 2 or for unit 128 on it.
fn asked(kind: &Kind) -> String {
    let values = [("CABLE", "2"), ("PORT", "2"), ("ADDRESS", "128"), ("SHARE", "0.5"), ("PROBABILITY", "0.5")];
    let values = [&values[..], &[("SECONDS", "0.1"), ("COUNTS", "50"), ("VOLTS", "9")]].concat();
    let word = |word: &str| values.iter().find(|(name, _)| *name == word).unwrap().1;
    let text = [kind.name].into_iter().chain(kind.arguments.split(' ').map(word)).collect::<Vec<_>>().join(" ");
    assert!(text.parse::<FaultRequest>().is_ok(), "{text}");
    text
}

fn ask(incidents: &mut Incidents, time_s: f64, text: &str) {
    let mut request = OperatorRequest { answered: 1, accepted: OperatorRequest::ACCEPTED, ..Default::default() };
    request.body.verb = RequestBody::VERB_FAULT;
    put_text(&mut request.text, text);
    incidents.request(time_s, &request);
}

/// The report reads the requests for faults of the virtual motor box, whose kinds it cannot take from there.
#[test]
fn the_report_reads_what_each_fault_of_the_motor_box_names() {
    let folder = tempfile::tempdir().unwrap();
    let system = "[[motor_io.ports]]\nunits = [{ address = 128 }]\n[[motor_io.ports]]\nunits = [{ address = 128 }]\n";
    std::fs::write(folder.path().join(runlog::SYSTEM_FILE), system).unwrap();
    let mut authority = MotorAuthority::default();
    (authority.fault_cable[1], authority.fault_unit[1]) = (1, 1);
    // A repair is no cause.
    for kind in KINDS.iter().filter(|kind| kind.name != "plug") {
        let text = asked(kind);
        let faults = if kind.arguments.starts_with("CABLE") {
            MotorAuthority::FAULT_SLACK
        } else {
            MotorAuthority::FAULT_LOST_UNIT
        };
        let mut incidents = Incidents::default();
        incidents.name_units(folder.path(), &[]);
        incidents.cycle(0.0, &MotorAuthority::default(), None);
        ask(&mut incidents, 0.5, &text);
        ask(&mut incidents, 0.6, if faults == MotorAuthority::FAULT_SLACK { "break 1" } else { "mute 1 128" });
        incidents.cycle(1.0, &MotorAuthority { faults, ..authority }, None);
        let causes = incidents.all().0.remove(0).causes;
        assert!(causes.len() == 1 && causes[0].contains(&text), "{text}: {causes:?}");

        for (role, count) in [("sensor", 0), ("motor-io", 1)] {
            let mut incidents = Incidents::default();
            ask(&mut incidents, 0.5, &text);
            let mut row = ProcessState { state: ProcessState::STATE_DIED, ..Default::default() };
            put_text(&mut row.name, "it");
            put_text(&mut row.role, role);
            incidents.process(1.0, &row);
            assert_eq!(incidents.all().0[0].causes.len(), count, "{text}, {role}");
        }
    }
}
