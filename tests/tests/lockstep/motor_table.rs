//! `nims motor-table` from runs that raise and lower known loads against the plant, compared with the plant's motors.

use analysis::motor_table::Args;
use cable_robot::motor::Motor;
use cable_robot::{Robot, RobotParts, Vector3};
use command::values::Numbers;
use config::{MotorTableFile, RobotFile};
use messages::{Message, MotorAuthority, MotorState, NodeEstimate, PlanStatus};
use nims_tests::lockstep::Lockstep;
use nims_tests::scenarios::{self, Case};
use planner::Mission;
use plant::motor::MotorConfig;
use plant::world::CableWorld;
use runlog::{ChannelSpec, RunClock, RunWriter};
use std::path::Path;

/// Up and down in two places and across, at five speeds: the slowest over a hand's breadth at several heights, with
/// quick moves between.
fn mission() -> Mission {
    let mut text = "name = \"hoist\"\n".to_owned();
    let mut leg = |points: &str, speed: f64| {
        text += &format!("[[leg]]\npolyline = {{ points_m = {points}, speed_m_s = {speed} }}\n");
    };
    for (x, y) in [(4.8, 3.0), (3.0, 1.6), (4.7, 5.5)] {
        for z in [0.4, 1.0, 1.6] {
            leg(&format!("[[{x:?}, {y:?}, {z:?}]]"), 0.4);
            leg(&format!("[[{x:?}, {y:?}, {:?}], [{x:?}, {y:?}, {z:?}]]", z + 0.25), 0.05);
        }
    }
    for speed in [0.1, 0.2, 0.3, 0.4] {
        for points in [
            "[[4.8, 3.0, 1.9], [4.8, 3.0, 0.4]]",
            "[[3.0, 1.6, 0.5], [3.0, 1.6, 1.8], [3.0, 1.6, 0.4]]",
            "[[7.0, 1.8, 1.6], [3.2, 2.0, 1.4], [4.7, 5.5, 1.7], [4.8, 3.0, 0.4]]",
        ] {
            leg(points, speed);
        }
    }
    Mission::parse(&text).unwrap()
}

/// Flies the mission with a load of this mass and records the content of a run file.
fn record(mass_kg: f64, mission: &Mission, run: &Path) {
    record_with(mass_kg, mission, run, Vec::new());
}

/// The same with a motor of its own for each cable.
fn record_with(mass_kg: f64, mission: &Mission, run: &Path, motors: Vec<MotorConfig>) {
    let mut scenario = Case { robot: "lab3", mission: "demo", motor_s: [0.030, 0.040] }.scenario(true).unwrap();
    let parts = RobotParts {
        anchors_m: scenario.robot.anchors().iter().map(|a| (*a).into()).collect(),
        node_mass_kg: mass_kg,
        tension_limits_n: [1.0, 120.0],
        speed_limit_m_s: 0.5,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: scenario.robot.stiffness_n(),
        routed_length_m: Some(scenario.robot.routed_length_m().to_vec()),
        ..RobotParts::default()
    };
    scenario.robot = Robot::new(parts).unwrap();
    scenario.plant.node.mass_kg = mass_kg;
    scenario.plant.start_limits_n = [1.0, 120.0];
    let cable = |motor| CableWorld { motor: Some(motor), ..CableWorld::default() };
    scenario.plant.world.cables = motors.into_iter().map(cable).collect();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(mission).unwrap();
    let mut writer = RunWriter::create(run, RunClock::now(), &Default::default(), &[]).unwrap();
    let channels = [
        writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<MotorAuthority>("motor/authority")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<NodeEstimate>("node/estimate/a")).unwrap(),
    ];
    loop {
        let cycle = lockstep.cycle().unwrap();
        let stamp = cycle.state.header().stamp_ns;
        let samples: [&[u8]; 3] = [
            bytemuck::bytes_of(&cycle.state),
            bytemuck::bytes_of(&cycle.authority),
            bytemuck::bytes_of(&cycle.estimate),
        ];
        for (channel, sample) in channels.iter().zip(samples) {
            writer.write(*channel, 1, stamp, stamp, sample).unwrap();
        }
        match cycle.plan.state {
            PlanStatus::STATE_DONE => break,
            PlanStatus::STATE_ABORTED => panic!("{}", messages::text_of(&cycle.plan.reason)),
            _ => {}
        }
    }
    writer.finish(&Default::default()).unwrap();
}

#[test]
fn a_table_from_recorded_runs_is_the_plants_own_friction() {
    let folder = tempfile::tempdir().unwrap();
    let mission = mission();
    let runs = [1.2, 3.0].map(|mass_kg| (mass_kg, folder.path().join(format!("{mass_kg}kg.mcap"))));
    std::thread::scope(|scope| {
        for (mass_kg, run) in &runs {
            scope.spawn(|| record(*mass_kg, &mission, run));
        }
    });
    let runs = runs.map(|(_, run)| run).to_vec();
    let out = folder.path().join("winch.toml");
    let asked = Args { runs: runs.clone(), out: out.clone(), cable: None, speeds: None, tensions: None };
    let command::Output { value, words, .. } = analysis::motor_table::run(&asked).unwrap();
    println!("{words}");

    // In the form that a robot file contains.
    let text = std::fs::read_to_string("../configs/robots/lab3.toml").unwrap();
    let robot_file = folder.path().join("robot.toml");
    std::fs::write(&robot_file, text.replace("[motor] ", "[motor]\ntable = \"winch.toml\" ")).unwrap();
    let robot = RobotFile::load(&robot_file).unwrap().robot().unwrap();
    let table = robot.motor_table(0).expect("the robot file names the table");
    let (speeds, tensions) = (table.speeds_m_s(), table.tensions_n());
    assert!(speeds[0] <= -0.15 && speeds[speeds.len() - 1] >= 0.15, "{speeds:?}");
    assert!(tensions[tensions.len() - 1] - tensions[0] >= 15.0, "{tensions:?}");

    // Everywhere inside, also between its points. The plant's drums grow with the cable on them, so its cables load the
    // motors up to a few percent more than the bare drums of the model.
    let motor = Motor::default();
    let (mut squares, mut worst, mut count) = (0.0, 0.0f64, 0);
    for i in 0..=40 {
        for j in 0..=20 {
            let v = speeds[0] + (speeds[speeds.len() - 1] - speeds[0]) * f64::from(i) / 40.0;
            let t = tensions[0] + (tensions[tensions.len() - 1] - tensions[0]) * f64::from(j) / 20.0;
            let off = robot.current().current_a(t, v).unwrap() - motor.current_a(t, v);
            (squares, worst, count) = (squares + off * off, worst.max(off.abs()), count + 1);
        }
    }
    let rms = (squares / f64::from(count)).sqrt();
    let largest = motor.current_a(tensions[tensions.len() - 1], speeds[speeds.len() - 1]);
    println!("against the plant's friction: {rms:.3} A rms, {worst:.3} A at most, of up to {largest:.2} A");
    assert!(rms < 0.05 && worst < 0.2, "{rms} {worst}");
    assert!(value["rms_residual_a"].as_f64().unwrap() < 0.1, "{value}");

    // The cost of a move comes from the table: outside the measured speeds it is unknown.
    let fast = |robot: &Robot| {
        let (from, to) = (Vector3::new(3.5, 2.0, 1.6), Vector3::new(6.0, 2.2, 1.6));
        cable_robot::energy::flight::best_parabola(robot, cable_robot::Distribution::Unique, &from, &to, 2.0, 0.0)
    };
    assert!(fast(&scenarios::robot("lab3").unwrap()).is_ok());
    assert_eq!(fast(&robot).unwrap_err().kind(), "out_of_range");

    // An existing file is never overwritten, and uncovered ranges are reported.
    assert_eq!(analysis::motor_table::run(&asked).unwrap_err().exit_code(), 2);
    let far = Args { out: folder.path().join("far.toml"), tensions: Some(Numbers(vec![5.0, 20.0, 110.0])), ..asked };
    let failure = analysis::motor_table::run(&far).unwrap_err();
    // The tension that the run does not have is named.
    assert!(failure.exit_code() == 2 && failure.to_string().contains("110"), "{failure}");
    assert!(!far.out.exists());
    assert!(MotorTableFile::load(&out).is_ok());
}

#[test]
fn a_run_that_only_hangs_or_only_lowers_is_refused_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("short.mcap");
    let mission = Mission::parse("name = \"short\"\n[[leg]]\nline = { to_m = [4.8, 3.0, 0.8] }\n").unwrap();
    record(1.2, &mission, &run);
    let out = folder.path().join("winch.toml");
    let asked = Args { runs: vec![run], out: out.clone(), cable: None, speeds: None, tensions: None };
    let failure = analysis::motor_table::run(&asked).unwrap_err();
    let sentence = failure.to_string();
    assert!(failure.exit_code() == 2 && !sentence.contains('\n'), "{sentence}");
    assert!(!out.exists());
}

/// Motors of which one needs a quarter more current per newton: each table shows its own motor, and energy and planner
/// use it.
#[test]
fn each_motor_has_its_own_table() {
    let folder = tempfile::tempdir().unwrap();
    let base = Case { robot: "lab3", mission: "demo", motor_s: [0.030, 0.040] }.scenario(true).unwrap().plant.motor;
    let weak = MotorConfig { force_constant_n_a: base.force_constant_n_a / 1.25, ..base };
    let runs = [1.2, 3.0].map(|mass_kg| (mass_kg, folder.path().join(format!("{mass_kg}kg.mcap"))));
    let mission = mission();
    std::thread::scope(|scope| {
        for (mass_kg, run) in &runs {
            scope.spawn(|| record_with(*mass_kg, &mission, run, vec![base, weak, base]));
        }
    });
    let runs = runs.map(|(_, run)| run).to_vec();
    for cable in 1..=3 {
        let out = folder.path().join(format!("winch{cable}.toml"));
        let asked = Args { runs: runs.clone(), out, cable: Some(cable), speeds: None, tensions: None };
        analysis::motor_table::run(&asked).unwrap();
    }
    let text = std::fs::read_to_string("../configs/robots/lab3.toml").unwrap();
    let load = |table: &str| {
        let path = folder.path().join("robot.toml");
        std::fs::write(&path, text.replace("[motor] ", &format!("[motor]\ntable = {table} "))).unwrap();
        RobotFile::load(&path)
    };
    let file = load("[\"winch1.toml\", \"winch2.toml\", \"winch3.toml\"]").unwrap();
    assert_eq!(file.named_files(folder.path()).len(), 3);
    let robot = file.robot().unwrap();
    // In the middle of what each motor's table covers, relative to the plant's first motor.
    let model = Motor::default();
    let ratios = [0, 1, 2].map(|cable| {
        let tensions_n = robot.motor_table(cable).unwrap().tensions_n();
        let tension_n = 0.5 * (tensions_n[0] + tensions_n[tensions_n.len() - 1]);
        robot.current().current_of_a(cable, tension_n, 0.08).unwrap() / model.current_a(tension_n, 0.08)
    });
    println!("{ratios:.3?}");
    for (ratio, expected) in ratios.into_iter().zip([1.0, 1.25, 1.0]) {
        assert!((ratio / expected - 1.0).abs() < 0.06, "{ratios:?}");
    }
    let loss_j = |robot: &Robot| {
        let (from, to) = (Vector3::new(3.5, 2.0, 1.4), Vector3::new(5.5, 2.2, 1.4));
        let unique = cable_robot::Distribution::Unique;
        cable_robot::energy::flight::best_parabola(robot, unique, &from, &to, 0.2, 0.0).unwrap().line.unwrap().energy_j
    };
    // Energy along a move needs tables of every tension there.
    for (name, most_a) in [("one", 4.0), ("two", 8.0)] {
        let currents = format!("currents_a = [[0.0, {most_a:?}], [0.0, {most_a:?}]]");
        let table = format!("speeds_m_s = [-1.0, 1.0]\ntensions_n = [0.0, 200.0]\n{currents}\n");
        std::fs::write(folder.path().join(format!("{name}.toml")), table).unwrap();
    }
    let loss_with = |tables: &str| loss_j(&load(tables).unwrap().robot().unwrap());
    let all = ["\"one.toml\"", "[\"one.toml\", \"two.toml\", \"one.toml\"]", "\"two.toml\""].map(loss_with);
    assert!(all[1] > 1.05 * all[0] && all[2] > 1.05 * all[1], "{all:?}");
    assert!((all[2] / all[0] - 4.0).abs() < 1e-9, "{all:?}");
    // Two of three are no answer.
    let two = load("[\"winch1.toml\", \"winch2.toml\"]");
    let sentence = two.map_or_else(|error| error.to_string(), |file| file.robot().unwrap_err().to_string());
    assert!(sentence.contains("3 cables"), "{sentence}");
}
