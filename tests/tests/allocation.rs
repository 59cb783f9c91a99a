//! Fresh deciding parts that receive a recorded flight again allocate nothing. `replay` checks that they compute the
//! same bits.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../../shared/robot/cable-robot/tests/mathematics/counting/mod.rs"]
mod counting;
/// The template for a custom estimation method.
#[path = "../../scripts/templates/estimator/src/method.rs"]
mod method;

use cable_control::law::PFeedforward;
use config::{EstimatorSection, SystemFile};
use controller::Law;
use counting::allocations;
use drives::{AXES, Command, DriveBus, UnitAnswer, UnitCommand, UnitReport};
use estimator::{Estimator, Method};
use messages::Request;
use motor_box::{BoxConfig, MotorBox};
use motor_io::{CoreConfig, open_port};
use nims_tests::lockstep::{Chain, Cycle, Lockstep};
use nims_tests::scenarios::{self, Case};
use planner::mission::PathShape;
use std::array::from_fn;
use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flight with all kinds of events: zeroing, arming, moving, a pause, resuming, a stop.
fn flight(robot: &'static str, shape: PathShape, law: Option<Law>, method: &str) -> (Chain, Vec<Cycle>) {
    let mut scenario = match robot {
        "aq4" => scenarios::planar().unwrap(),
        _ => Case { robot, mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true).unwrap(),
    };
    scenario.mission.path = shape;
    scenario.law = law.unwrap_or(scenario.law);
    scenario.method =
        Method::from_section(&EstimatorSection { method: method.parse().unwrap(), ..EstimatorSection::default() })
            .unwrap();
    let chain = Chain::new(&scenario).unwrap();
    let mission = scenario.mission.clone();
    let [x, y, z] = scenario.plant.start_m;
    let mut lockstep = Lockstep::new(scenario).unwrap();
    let mut cycles = Vec::new();
    for cycle in 1..=1200 {
        match cycle {
            10 => lockstep.request(Request::ZeroAt { position_m: [x, y, z] }),
            20 => lockstep.request(Request::Arm),
            50 => drop(lockstep.run(&mission).unwrap()),
            500 => lockstep.request(Request::Pause),
            700 => lockstep.request(Request::Resume),
            1000 => lockstep.request(Request::Stop),
            _ => {}
        }
        cycles.push(lockstep.cycle().unwrap());
    }
    (chain, cycles)
}

#[test]
fn estimation_control_and_arbitration_allocate_nothing() {
    // The preview law identifies the drives on the way.
    let preview = nims_tests::laws::law(None, true).unwrap();
    let plain = Law::PFeedforward(PFeedforward::new(2.0).unwrap());
    let own =
        |chain: &Chain| Estimator::with_method(chain.estimator.config(), Box::new(method::MyEstimator::default()));
    for (robot, shape, law, method) in [
        ("lab3", PathShape::Line, None, "phi"),
        ("lab4", PathShape::Line, None, "phi"),
        ("lab3", PathShape::Parabola, Some(preview), "phi"),
        ("lab4", PathShape::Lateral, Some(preview), "kalman"),
        ("lab3", PathShape::Line, Some(plain), "kalman"),
        ("aq4", PathShape::Line, None, "phi"),
    ] {
        let (mut chain, cycles) = flight(robot, shape, law, method);
        let mut own = own(&chain);
        let count = allocations(|| {
            for cycle in &cycles {
                black_box(own.step(&cycle.state, Some(&cycle.authority)));
                chain.core.decide(&cycle.input);
                black_box(chain.core.observe(&cycle.input));
                black_box(chain.estimator.step(&cycle.state, Some(&cycle.authority)));
                black_box(chain.controller.step(&controller::Inputs {
                    estimates: [Some(&cycle.estimate), None],
                    motion: Some(&cycle.motion),
                    authority: Some(&cycle.authority),
                    state: Some(&cycle.state),
                }));
            }
        });
        assert_eq!(count, 0, "{robot}, {shape:?}, {law:?}, {method}");
        assert!(cycles.iter().any(|cycle| cycle.control.error_norm_m > 0.0));
    }
}

/// Ends the other thread when the test is over or has failed.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Cycles in which a bus is counted, after as many in which its buffers grow.
const COUNTED: usize = 100;

/// Every family on a pseudo-terminal: command and counts, and the readings between cycles. The virtual units are in
/// another thread.
#[test]
fn the_drives_of_every_family_are_driven_without_allocations() {
    for name in ["demo3", "moteus4", "odrive4", "roboteq3", "quick3"] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../configs/systems/{name}.toml"));
        let file = SystemFile::load(&path).unwrap();
        let robot = file.robot_file().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let mut motor_box = MotorBox::new(&BoxConfig::from_files(&file, &robot, folder.path()).unwrap()).unwrap();
        let config = CoreConfig::from_files(&file, &robot).unwrap();
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let _ends = Ends(&stop);
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    motor_box.run_until(motor_box.real_ns() + 10_000_000).unwrap();
                }
            });
            let port = &file.motor_io.ports[0];
            let at = port.path.replace("{domain}", &folder.path().to_string_lossy());
            let connected = port.units.iter().map(|unit| unit.cables.len());
            let hold: Vec<_> =
                connected.map(|n| from_fn::<_, AXES, _>(|motor| (motor < n).then_some(Command::HOLD))).collect();
            let counted = counted_cycles(open_port(port, &at, &config).unwrap(), &hold);
            assert_eq!(counted, Ok(0), "{name}");
        });
    }
}

/// Allocations of [`COUNTED`] cycles in which every unit answered in time.
fn counted_cycles(mut bus: Box<dyn DriveBus>, hold: &[UnitCommand]) -> Result<u64, String> {
    let blank = UnitAnswer { outcome: Ok(()), report: UnitReport::default() };
    let mut answers = vec![blank; bus.unit_count()];
    let (mut good, mut counted) = (0, 0);
    for _ in 0..5000 {
        let (begin_ns, timeouts) = (bus.now_ns(), bus.counters().timeouts);
        let count = allocations(|| {
            bus.exchange(hold, begin_ns + 9_000_000, &mut answers);
            bus.spend(begin_ns + 10_000_000);
        });
        if !bus.is_settled() {
            let _ = bus.settle(bus.now_ns() + 5_000_000);
        } else if bus.counters().timeouts == timeouts && answers.iter().all(|answer| answer.outcome.is_ok()) {
            good += 1;
            counted += if good > COUNTED { count } else { 0 };
            if good == 2 * COUNTED {
                return Ok(counted);
            }
        }
    }
    Err(format!("only {good} good cycles: {answers:?}"))
}
