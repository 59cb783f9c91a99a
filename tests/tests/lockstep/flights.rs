//! The whole control chain against the plant: tracking accuracy, and the conditions that stop the robot.

use cable_robot::{Robot, RobotParts, Vector3};
use config::SystemFile;
use messages::{MotorAuthority, PlanStatus, Request};
use motor_box::BoxConfig;
use nims_tests::lockstep::{Chain, Cycle, Flight, Lockstep, Scenario, fly, fly_chain};
use nims_tests::scenarios::{self, Case};
use planner::Mission;
use plant::PlantConfig;
use robot_state::Reason;
use std::collections::BTreeSet;

const QUICK: [f64; 2] = [0.030, 0.040];
const SLOW: [f64; 2] = [0.060, 0.100];

/// Flies one mission with quick and with slow motors, corrected for stretch, and checks what holds for every flight.
fn flights(robot: &'static str, mission: &'static str) {
    for motor_s in [QUICK, SLOW] {
        let case = Case { robot, mission, motor_s };
        let flight = fly(case.scenario(true).unwrap()).unwrap();
        println!("{}\n{}", scenarios::HEADING, scenarios::row(&case, true, &flight));
        let Flight { estimate, truth, .. } = flight;
        assert_eq!(flight.state, PlanStatus::STATE_DONE);
        assert!(flight.moving_cycles > 3000, "{flight:?}");
        assert!(estimate.rms_m <= 0.005, "estimate against setpoint: {estimate:?}");
        assert!(truth.rms_m <= 0.010, "truth against setpoint: {truth:?}");
        assert!(truth.max_m <= 0.020, "truth against setpoint: {truth:?}");
        // 15 % of the chosen tension or 2 N, whichever is more.
        assert!(flight.tension_share <= 1.0, "true tensions are up to {} N off", flight.tension_max_n);
        assert_eq!((flight.slack_cycles, flight.unsteered), (0, 0));
        assert!(flight.saturation < 1.0, "{flight:?}");
    }
}

#[test]
fn three_lines_follow_the_spiral() {
    flights("lab3", "spiral");
}

#[test]
fn three_lines_follow_the_polyline() {
    flights("lab3", "polyline");
}

#[test]
fn four_lines_follow_the_spiral_with_the_chosen_tensions() {
    flights("lab4", "spiral");
}

#[test]
fn four_lines_follow_the_polyline_with_the_chosen_tensions() {
    flights("lab4", "polyline");
}

/// Six cables on three drive units, whose answers one after another take longer than a period.
fn six_cables(rate_hz: f64) -> Scenario {
    let mut scenario = Case { robot: "lab4", mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
    let around = |k: u32| {
        let (y_m, x_m) = (f64::from(k) * std::f64::consts::FRAC_PI_3).sin_cos();
        [4.8 + 4.5 * x_m, 3.0 + 4.5 * y_m, 4.0]
    };
    let anchors_m: Vec<[f64; 3]> = (0..6).map(around).collect();
    let robot = scenario.robot;
    let parts = RobotParts {
        node_mass_kg: scenario.plant.node.mass_kg,
        tension_limits_n: robot.tension_limits_n(),
        speed_limit_m_s: robot.speed_limit_m_s(),
        acceleration_limit_m_s2: robot.acceleration_limit_m_s2(),
        stiffness_n: Some(6000.0),
        ..RobotParts::default()
    };
    let lengths_m = Some(vec![6.0; anchors_m.len()]);
    scenario.robot =
        Robot::new(RobotParts { anchors_m: anchors_m.clone(), routed_length_m: lengths_m, ..parts }).unwrap();
    scenario.distribution = scenario.robot.default_distribution();
    let drive = scenario.plant.drive;
    scenario.plant = PlantConfig::new(anchors_m, scenarios::START_M);
    scenario.plant.start_limits_n = scenario.robot.tension_limits_n();
    scenario.plant.drive = drive;
    scenario.plant.idlers.iter_mut().for_each(|idler| idler.counts_per_m = scenarios::COUNTS_PER_M);
    at(rate_hz, scenario)
}

fn at(rate_hz: f64, mut scenario: Scenario) -> Scenario {
    scenario.period_s = 1.0 / rate_hz;
    scenario.horizon = (2.0 * QUICK.iter().sum::<f64>() * rate_hz).round() as u32 + 3;
    scenario
}

#[test]
fn the_node_follows_its_mission_at_slow_and_at_quick_rates() {
    let lab = |robot| Case { robot, mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
    let flights = [(20.0, lab("lab3")), (200.0, lab("lab3")), (250.0, lab("lab4"))].map(|(hz, lab)| at(hz, lab));
    for scenario in flights.into_iter().chain([six_cables(200.0), six_cables(250.0)]) {
        let rate_hz = 1.0 / scenario.period_s;
        let flight = fly(scenario).unwrap_or_else(|error| panic!("{rate_hz} Hz: {error:#}"));
        println!("{rate_hz} Hz: {flight:?}");
        assert_eq!(flight.state, PlanStatus::STATE_DONE);
        assert!(flight.moving_cycles as f64 > 30.0 * rate_hz, "{rate_hz} Hz: {flight:?}");
        assert!(flight.truth.max_m <= 0.030, "{rate_hz} Hz: {:?}", flight.truth);
        assert_eq!((flight.slack_cycles, flight.unsteered), (0, 0), "{rate_hz} Hz");
    }
    // A rate beyond that of a robot is refused, also here.
    let error = fly(at(501.0, lab("lab3"))).unwrap_err().to_string();
    assert!(error.contains("period") && error.contains("500"), "{error}");
}

/// The planner of the processes goes by time, and so does that of the lockstep.
#[test]
fn the_planner_is_stepped_as_often_at_every_rate() {
    let lab = Case { robot: "lab3", mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
    for rate_hz in [20.0, 100.0, 500.0] {
        let mut lockstep = Lockstep::new(at(rate_hz, lab.clone())).unwrap();
        let beats: BTreeSet<u64> = (0..(2.0 * rate_hz) as u32).map(|_| lockstep.cycle().unwrap().motion.beat).collect();
        assert!((20..=21).contains(&beats.len()), "{rate_hz} Hz: {} steps in two seconds", beats.len());
    }
}

/// The example for 500 Hz, with the chain of its files, along a side of the room: every period is steered, and the node
/// is where the same mission has it at 100 Hz.
#[test]
fn at_500_hz_every_period_is_steered_and_the_node_follows() {
    let systems = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/systems");
    let mission = "name = \"side\"\n[[leg]]\npolyline = { points_m = [[5.4, 3.2, 0.5], [4.6, 3.6, 0.8]] }\n";
    let fly_at = |rate_hz: f64| {
        let mut file = SystemFile::load(&systems.join("quick3.toml")).unwrap();
        let robot = file.robot_file().unwrap();
        file.rate_hz = rate_hz;
        file.controller.horizon_cycles = (0.14 * rate_hz).round() as usize + 3;
        let plant = BoxConfig::from_files(&file, &robot, std::path::Path::new("/")).unwrap().plant;
        let mission = Mission::parse(mission).unwrap();
        let scenario = Scenario::from_files(&file, robot.robot().unwrap(), plant, mission).unwrap();
        fly_chain(scenario, Chain::from_files(&file, &robot).unwrap(), |seen| {
            let input = &seen.cycle.input;
            // Within what motor-io and `nims check` leave to the drives.
            anyhow::ensure!((input.end_ns - input.begin_ns) as f64 * 1e-9 < 0.8 / rate_hz, "a long exchange");
            Ok(())
        })
        .unwrap()
    };
    let (slow, quick) = (fly_at(100.0), fly_at(500.0));
    println!("100 Hz: {slow:?}\n500 Hz: {quick:?}");
    for (rate_hz, flight) in [(100.0, &slow), (500.0, &quick)] {
        assert_eq!(flight.state, PlanStatus::STATE_DONE);
        assert!(flight.moving_cycles as f64 > 5.0 * rate_hz, "{rate_hz} Hz: {flight:?}");
        assert_eq!((flight.slack_cycles, flight.unsteered), (0, 0), "{rate_hz} Hz");
        assert!(flight.truth.max_m <= 0.020, "{rate_hz} Hz: {:?}", flight.truth);
    }
    assert!(quick.truth.rms_m <= 1.5 * slow.truth.rms_m, "{:?} after {:?}", quick.truth, slow.truth);
}

/// The effect of the correction: without it the estimate still follows, but the node does not.
#[test]
fn without_correction_for_stretch_the_node_is_centimetres_off() {
    for robot in ["lab3", "lab4"] {
        let case = Case { robot, mission: "spiral", motor_s: QUICK };
        let flight = fly(case.scenario(false).unwrap()).unwrap();
        assert!(flight.estimate.rms_m <= 0.005, "{flight:?}");
        assert!((0.010..0.060).contains(&flight.truth.rms_m), "{flight:?}");
    }
}

#[test]
fn the_same_flight_gives_the_same_bits() {
    let fly_some = || {
        let scenario = Case { robot: "lab4", mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
        let mission = scenario.mission.clone();
        let mut lockstep = Lockstep::new(scenario).unwrap();
        lockstep.zero_and_arm().unwrap();
        lockstep.run(&mission).unwrap();
        (0..500).map(|_| lockstep.cycle().unwrap()).last().unwrap()
    };
    let (first, second) = (fly_some(), fly_some());
    // As bytes: a number that is not known is NaN, which equals nothing.
    assert_eq!(bytemuck::bytes_of(&first.input), bytemuck::bytes_of(&second.input));
    assert_eq!(bytemuck::bytes_of(&first.state), bytemuck::bytes_of(&second.state));
    assert_eq!(bytemuck::bytes_of(&first.authority), bytemuck::bytes_of(&second.authority));
    assert_eq!((first.estimate, first.command, first.control), (second.estimate, second.command, second.control));
    assert_eq!(first.truth_m.map(f64::to_bits), second.truth_m.map(f64::to_bits));
}

/// A mission under way.
struct Flown {
    lockstep: Lockstep,
}

impl Flown {
    fn new(robot: &'static str, mission: &'static str) -> Self {
        let scenario = Case { robot, mission, motor_s: QUICK }.scenario(true).unwrap();
        let mission = scenario.mission.clone();
        let mut lockstep = Lockstep::new(scenario).unwrap();
        lockstep.zero_and_arm().unwrap();
        lockstep.run(&mission).unwrap();
        Self { lockstep }
    }

    /// Runs so many cycles; returns the last one, and the largest distance of the truth from the setpoint on the way.
    fn cycles(&mut self, count: u64) -> (Cycle, f64) {
        let mut worst: f64 = 0.0;
        let mut last = self.lockstep.cycle().unwrap();
        for _ in 1..count {
            last = self.lockstep.cycle().unwrap();
            if last.authority.mode == MotorAuthority::MODE_FOLLOWING {
                let is = Vector3::from(last.truth_m);
                worst = worst.max((is - Vector3::from(last.control.setpoint_m)).norm());
            }
            assert!(last.truth_n.iter().all(|tension| *tension > 1.0), "cables stay taut: {:?}", last.truth_n);
        }
        (last, worst)
    }

    fn ask(&mut self, request: Request) {
        self.lockstep.request(request);
    }
}

fn speed(cycle: &Cycle) -> f64 {
    Vector3::from(cycle.estimate.velocity_m_s).norm()
}

#[test]
fn pause_resume_and_slower_stay_on_the_path() {
    let mut flown = Flown::new("lab4", "spiral");
    let (cycle, _) = flown.cycles(1500);
    assert!(speed(&cycle) > 0.15);
    flown.ask(Request::Pause);
    let (cycle, worst) = flown.cycles(300);
    assert_eq!((cycle.authority.mode, cycle.plan.state), (MotorAuthority::MODE_HOLDING, PlanStatus::STATE_PAUSED));
    assert!(speed(&cycle) < 0.005 && worst < 0.020, "{} m/s, {worst} m", speed(&cycle));
    flown.ask(Request::Resume);
    flown.ask(Request::Speed { rate: 0.4 });
    let (cycle, worst) = flown.cycles(300);
    assert_eq!((cycle.authority.mode, cycle.plan.state), (MotorAuthority::MODE_FOLLOWING, PlanStatus::STATE_RUNNING));
    assert!((speed(&cycle) - 0.08).abs() < 0.01 && worst < 0.020, "{} m/s, {worst} m", speed(&cycle));
    assert_eq!(cycle.authority.unsteered(), 0);
}

#[test]
fn stop_gives_the_mission_up_and_the_next_one_starts_from_there() {
    let mut flown = Flown::new("lab3", "spiral");
    flown.cycles(1500);
    flown.ask(Request::Stop);
    let (cycle, _) = flown.cycles(200);
    assert_eq!((cycle.authority.mode, cycle.plan.state), (MotorAuthority::MODE_HOLDING, PlanStatus::STATE_ABORTED));
    assert_eq!(cycle.motion.motion, 0, "nothing is offered any more");
    let mission = scenarios::mission("polyline").unwrap();
    flown.lockstep.run(&mission).unwrap();
    let (cycle, worst) = flown.cycles(1000);
    assert_eq!(cycle.plan.state, PlanStatus::STATE_RUNNING);
    assert!(worst < 0.020, "{worst} m");
}

#[test]
fn a_refused_mission_moves_nothing() {
    let mut flown = Flown { lockstep: armed("lab3") };
    // The drives hold: their speed loops have started again.
    flown.cycles(400);
    let mut mission = scenarios::mission("polyline").unwrap();
    let far = planner::Mission::parse("name = \"far\"\n[[leg]]\nline = { to_m = [4.8, 3.0, 2.9] }\n").unwrap();
    mission.leg.extend(far.leg);
    let reason = refusal(&mut flown.lockstep, &mission);
    assert!(matches!(reason, Reason::PlanLimit { leg: 3, .. }), "{reason}");
    let start = flown.lockstep.cycle().unwrap();
    let (end, _) = flown.cycles(300);
    assert_eq!(end.motion.motion, 0);
    assert_eq!((start.state.counts, end.state.counts), (end.state.counts, start.state.counts));
    assert_eq!(end.plan.state, PlanStatus::STATE_REFUSED);
}

/// The reason for which a mission is refused.
fn refusal(lockstep: &mut Lockstep, mission: &planner::Mission) -> Reason {
    lockstep.run(mission).unwrap_err().downcast::<planner::Refusal>().unwrap().reason()
}

fn armed(robot: &'static str) -> Lockstep {
    let scenario = Case { robot, mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep
}

#[test]
fn before_it_is_armed_or_zeroed_no_mission_is_taken() {
    let scenario = Case { robot: "lab3", mission: "polyline", motor_s: QUICK }.scenario(true).unwrap();
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    assert_eq!(refusal(&mut lockstep, &mission), Reason::MotorIoAbsent);
    lockstep.cycle().unwrap();
    assert_eq!(refusal(&mut lockstep, &mission), Reason::RobotDisarmed);
    lockstep.request(Request::Arm);
    lockstep.cycle().unwrap();
    lockstep.cycle().unwrap();
    assert_eq!(refusal(&mut lockstep, &mission), Reason::PositionUnknown);
}

/// A cable that breaks ends the motion, not the robot: the others hold. Whichever cable it is, and whether it is reeled
/// in or paid out, the robot detects a cable without load within a second.
#[test]
fn a_broken_line_is_found_and_stops_the_robot() {
    for (robot, cable, after) in
        [("lab3", 1, 1100), ("lab3", 2, 800), ("lab3", 0, 1500), ("lab4", 1, 800), ("lab4", 2, 1100), ("lab4", 3, 1100)]
    {
        let mut flown = Flown::new(robot, "polyline");
        flown.cycles(after);
        flown.lockstep.plant_mut().apply(plant::Fault::BrokenLine { cable, on: true }).unwrap();
        let mut last = flown.lockstep.cycle().unwrap();
        let mut cycles = 1;
        while last.authority.mode == MotorAuthority::MODE_FOLLOWING {
            last = flown.lockstep.cycle().unwrap();
            cycles += 1;
            assert!(cycles <= 100, "{robot}, cable {}: not detected within a second", cable + 1);
        }
        let named = last.authority.fault_cable;
        println!("{robot}, line {}: found after {cycles} cycles, naming {named:?}", cable + 1);
        assert_ne!(last.authority.faults & MotorAuthority::FAULT_SLACK, 0, "{robot}: {:#x}", last.authority.faults);
        for _ in 0..100 {
            last = flown.lockstep.cycle().unwrap();
        }
        assert_eq!(last.authority.mode, MotorAuthority::MODE_FAULTED);
        assert_eq!(last.plan.state, PlanStatus::STATE_ABORTED);
    }
}

#[test]
fn every_mission_that_comes_along_can_be_flown_by_every_robot() {
    for robot in ["lab3", "lab4"] {
        for mission in ["demo", "spiral", "polyline"] {
            let scenario = Case { robot, mission, motor_s: QUICK }.scenario(true).unwrap();
            let config = planner::PlannerConfig {
                robot: scenario.robot,
                distribution: scenario.distribution,
                speed_m_s: 0.2,
                acceleration_m_s2: 0.3,
                check_step_m: 0.02,
                swing_limit_m: 0.005,
            };
            let summary = planner::dry_run(&scenario.mission, &config, scenarios::START_M).unwrap();
            assert!(summary.duration_s < 120.0, "{summary:?}");
        }
    }
}
