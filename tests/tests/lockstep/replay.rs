//! Recomputes recorded runs: the same bits, and every difference found and named.

use config::SystemFile;
use messages::Request;
use nims_sim::Tape;
use nims_tests::golden;
use nims_tests::lockstep::{Chain, ControllerOutput, Cycle, Lockstep};
use nims_tests::record;
use nims_tests::scenarios::Case;
use replay::{Changes, ChannelComparison, Replayed, instant_of, run, snapshot, state_at};
use std::path::{Path, PathBuf};

const CASE: Case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };

fn replayed(path: &Path, changes: &Changes) -> Replayed {
    run(path, changes, &mut |_| {}).unwrap()
}

fn tally<'a>(replayed: &'a Replayed, channel: &str) -> &'a ChannelComparison {
    replayed.channels.iter().find(|tally| tally.channel == channel).unwrap_or_else(|| panic!("no {channel}"))
}

fn assert_same(replayed: &Replayed, cycles: u64) {
    assert_eq!((replayed.different(), replayed.cycles), (0, cycles), "{:#?}", replayed.channels);
    assert!(replayed.channels.iter().all(|tally| tally.equal == tally.recorded && tally.equal > 0), "{replayed:#?}");
}

#[test]
fn a_recorded_flight_gives_the_same_bits_with_every_law_and_method() {
    for (name, robot, law, method) in [
        ("demo3", "lab3", "lq-endpoint", "phi"),
        ("demo4", "lab4", "lq-endpoint", "kalman"),
        ("demo3", "lab3", "preview", "kalman"),
        ("demo4", "lab4", "preview", "phi"),
        ("demo3", "lab3", "p-feedforward", "phi"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let words = [("controller", "law", law), ("estimator", "method", method)];
        let system_path = record::system_with(folder.path(), name, &words).unwrap();
        // The preview law identifies the drives on the way.
        let path = record::fly(&folder.path().join("run.mcap"), &system_path, &Case { robot, ..CASE }, 900).unwrap();
        let replayed = replayed(&path, &Changes::default());
        assert_same(&replayed, 900);
        let names: Vec<&str> = replayed.channels.iter().map(|tally| tally.channel.as_str()).collect();
        let wanted = "motor/state motor/authority motor/slots energy node/estimate/a node/estimate/b motor/command/a \
                      motor/command/b control/status/a control/status/b";
        assert_eq!(names.join(" "), wanted);
    }
}

/// A short flight, cycle by cycle, with a system file.
fn flight(folder: &Path) -> (PathBuf, Vec<(Cycle, ControllerOutput)>) {
    let system_path = record::system_with(folder, "demo3", &[]).unwrap();
    let scenario = CASE.scenario(true).unwrap();
    let chain = Chain::from_file(&SystemFile::load(&system_path).unwrap()).unwrap();
    let (mission, [x, y, z]) = (scenario.mission.clone(), scenario.plant.start_m);
    let mut lockstep = Lockstep::with(scenario, chain).unwrap();
    let mut cycles = Vec::new();
    for cycle in 1..=400 {
        match cycle {
            3 => lockstep.request(Request::ZeroAt { position_m: [x, y, z] }),
            5 => lockstep.request(Request::Arm),
            10 => drop(lockstep.run(&mission).unwrap()),
            _ => {}
        }
        let now = lockstep.cycle().unwrap();
        cycles.push((now, *lockstep.slots().outputs().next().unwrap()));
    }
    (system_path, cycles)
}

#[test]
fn one_bit_is_found_and_a_gap_is_not_hidden() {
    let folder = tempfile::tempdir().unwrap();
    let (system_path, cycles) = flight(folder.path());
    let tape = |name: &str| Tape::new(&folder.path().join(name), &system_path).unwrap();

    let mut bent = tape("bent.mcap");
    for (cycle, said) in &cycles {
        let mut said = *said;
        if cycle.input.header.cycle == 300 {
            let velocity = &mut said.command.velocity_m_s[1];
            *velocity = f64::from_bits(velocity.to_bits() ^ 1);
        }
        bent.write("motor/input", cycle.input).unwrap();
        bent.write("motor/state", cycle.state).unwrap();
        bent.write("motor/authority", cycle.authority).unwrap();
        bent.write("node/estimate/a", cycle.estimate).unwrap();
        bent.write("motor/command/a", said.command).unwrap();
        bent.write("control/status/a", said.status).unwrap();
        bent.write("plan/motion", cycle.motion).unwrap();
    }
    let bent = replayed(&bent.finish().unwrap(), &Changes::default());
    let command = tally(&bent, "motor/command/a");
    assert_eq!((bent.different(), command.different, command.equal), (1, 1, 399), "{bent:#?}");
    let first = command.first.as_ref().unwrap();
    assert_eq!((first.cycle, first.field.as_str()), (300, "velocity_m_s[1]"));
    assert_ne!(first.recorded, first.replayed);

    let mut gap = tape("gap.mcap");
    for (cycle, said) in &cycles {
        match cycle.input.header.cycle {
            // The recorder missed one sample of one channel.
            200 => gap.miss("motor/input"),
            _ => gap.write("motor/input", cycle.input).unwrap(),
        }
        gap.write("motor/state", cycle.state).unwrap();
        match cycle.input.header.cycle {
            300 => gap.miss("motor/authority"),
            _ => gap.write("motor/authority", cycle.authority).unwrap(),
        }
        gap.write("node/estimate/a", cycle.estimate).unwrap();
        gap.write("motor/command/a", said.command).unwrap();
        gap.write("control/status/a", said.status).unwrap();
        gap.write("plan/motion", cycle.motion).unwrap();
    }
    let gap = replayed(&gap.finish().unwrap(), &Changes::default());
    assert_eq!(gap.different(), 0, "{gap:#?}");
    // After the gap the inputs are unknown.
    for (channel, equal, not) in [
        ("motor/state", 199, 201),
        ("motor/authority", 199, 200),
        ("node/estimate/a", 299, 101),
        ("motor/command/a", 299, 101),
        ("control/status/a", 299, 101),
    ] {
        let tally = tally(&gap, channel);
        assert_eq!((tally.equal, tally.not_compared.values().sum::<u64>()), (equal, not), "{tally:?}");
    }
}

#[test]
fn what_is_changed_is_compared_with_what_was_commanded() {
    let folder = tempfile::tempdir().unwrap();
    let system_path = record::system_with(folder.path(), "demo3", &[]).unwrap();
    let path = record::fly(&folder.path().join("run.mcap"), &system_path, &CASE, 600).unwrap();
    let set = |key: &str, value: &str| Changes { set: vec![(key.to_owned(), value.to_owned())], ..Changes::default() };
    let instead = |changes: &Changes| replayed(&path, changes).instead.unwrap();

    // Without a change nothing differs.
    let same = instead(&set("controller.horizon_cycles", "20"));
    assert!(same.cycles > 200, "{same:?}");
    assert!(same.command_m_s.iter().chain(&same.sent_m_s).all(|spread| spread.max == 0.0), "{same:?}");

    let law = instead(&Changes { law: Some("p-feedforward".to_owned()), ..Changes::default() });
    assert_eq!(law.command_m_s.len(), 3);
    assert!(law.command_m_s.iter().all(|spread| spread.max >= spread.rms && spread.rms > 0.0), "{law:?}");
    assert!(law.sent_m_s.iter().all(|spread| spread.max == 0.0), "motor-io gets the recorded commands: {law:?}");

    // The template computes the same law in a program of its own.
    let gain = ("controller.length_gain_per_s".to_owned(), "1.5".to_owned());
    let built_in = instead(&Changes { law: Some("p-feedforward".to_owned()), set: vec![gain], ..Changes::default() });
    let program = env!("CARGO_BIN_EXE_my-law").to_owned();
    let own = instead(&Changes { program: Some(program), ..Changes::default() });
    assert_eq!(own.command_m_s, built_in.command_m_s);
    let program = Some("no-such-program".to_owned());
    let refused = run(&path, &Changes { program, ..Changes::default() }, &mut |_| {}).unwrap_err();
    assert!(refused.to_string().contains("no-such-program"), "{refused}");

    let stop = instead(&set("robot.tension_limits_n", "[2.0, 8.0]"));
    assert!(stop.cycles_of_other_mode > 100, "every cable exceeds its limit: {stop:?}");
    let method = instead(&set("estimator.method", "kalman"));
    assert!(method.position_m.max > 0.0 && method.position_m.max < 0.01, "{method:?}");
    assert!(method.command_m_s.iter().any(|spread| spread.max > 0.0), "the change reaches the controllers: {method:?}");

    let refused = run(&path, &set("controller.horizon_cycles", "0"), &mut |_| {}).unwrap_err();
    assert!(refused.to_string().contains("`controller.horizon_cycles`"), "{refused}");
    assert_eq!(refused.exit_code(), 2);
}

/// The regression net: a change of one bit of a decision fails here.
#[test]
fn the_golden_run_still_computes_to_the_same_bits() {
    let replayed = replayed(&golden::file(), &Changes::default());
    let renew = golden::RENEW;
    assert_eq!(
        replayed.different(),
        0,
        "decisions have changed; if that is intended, record the golden run again with `{renew}` and give the reason in the commit\n{:#?}",
        replayed.channels
    );
    for tally in &replayed.channels {
        assert!(
            tally.not_compared.is_empty() && tally.equal > 0,
            "the golden run does not match this build; `{renew}`\n{tally:#?}"
        );
    }
    assert_eq!(replayed.channels.len(), 10);
    let bytes = golden::file().metadata().unwrap().len();
    assert!(bytes < 500_000, "the golden run has {bytes} bytes, which is much for a repository");
}

#[test]
fn an_instant_has_the_inputs_that_each_answer_names_and_the_state_after_it() {
    let folder = tempfile::tempdir().unwrap();
    let system_path = record::system_with(folder.path(), "demo3", &[]).unwrap();
    let path = record::fly(&folder.path().join("run.mcap"), &system_path, &CASE, 900).unwrap();
    // Before the flight replaces its processes.
    let at_ns = instant_of(&path, "4.0").unwrap();
    assert_eq!(instant_of(&path, &runlog::utc(at_ns)).unwrap() / 1_000_000_000, at_ns / 1_000_000_000);
    let instant = snapshot(&path, at_ns).unwrap();
    let cycle = instant.cycle.unwrap();
    let named = |name: &str| instant.processes.iter().find(|process| process.process == name).unwrap();
    let cycles = |entries: &[replay::Entry], channel: &str| {
        let entry = entries.iter().find(|entry| entry.channel == channel);
        entry.unwrap_or_else(|| panic!("no {channel}")).sample["header.cycle"].as_u64().unwrap()
    };
    let motor_io = named("motor-io");
    assert!(cycles(&motor_io.inputs, "motor/input") == cycle && cycles(&motor_io.outputs, "motor/state") == cycle);
    let estimator = named("estimator in slot a");
    let estimated = cycles(&estimator.outputs, "node/estimate/a");
    assert!(cycle - estimated <= 1 && cycles(&estimator.inputs, "motor/state") == estimated);
    let controller = named("controller in slot a");
    let answer = &controller.outputs.iter().find(|entry| entry.channel == "control/status/a").unwrap().sample;
    assert_eq!(cycles(&controller.inputs, "node/estimate/a"), answer["based_on_estimate"][0].as_u64().unwrap());
    assert!(controller.inputs.iter().any(|entry| entry.channel == "plan/motion"));
    assert!(instant.words().contains("motor/command/a"));

    // The state is that after the cycle of the instant, not the one at the end.
    let states = state_at(&path, at_ns, &mut |_| ()).unwrap();
    let of = |name: &str| states.iter().find(|(part, _)| part == name).unwrap().1.clone();
    assert!(of("estimator in slot a").contains(&format!("last_cycle: {estimated}")), "{}", of("estimator in slot a"));
    assert!(of("motor-io").starts_with("Core") && of("controller in slot a").starts_with("Controller"));
    for wrong in ["-1", "soon", "2026-13-01 00:00:00"] {
        assert_eq!(instant_of(&path, wrong).unwrap_err().exit_code(), 2, "{wrong}");
    }
}
