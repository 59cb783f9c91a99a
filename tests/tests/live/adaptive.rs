//! An adaptive leg in flight: sensor, sensor logger and planner are processes of a robot, and the live map decides what
//! is flown next. Checked by the run file and the truth.

use crate::robot::{Robot, THREE_CABLES, steadily};
use messages::{FieldMap, MotorAuthority, PlanMotion, PlanStatus, Request, TruthNode};
use robot_state::Reason;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// Level ground with a block whose corner lies within the area.
const GROUND: &str = "[[prism]]\ncenter_m = [5.33, 3.4]\nsize_m = [1.0, 1.0]\nheight_m = 0.3\n";
/// Positions of its sides within the area, m: x of the one along y, y of the one along x.
const EDGE_M: [f64; 2] = [4.83, 2.9];
const LOW_M: [f64; 2] = [4.4, 2.6];
const HIGH_M: [f64; 2] = [5.2, 3.4];
const COARSE_M: f64 = 0.2;
const FINE_M: f64 = 0.08;

const MISSION: &str = r#"name = "look-twice"
speed_m_s = 0.3
acceleration_m_s2 = 0.3
[[leg]]
raster = { corner_m = [4.4, 2.6, 0.7], opposite_m = [5.2, 3.4, 0.7], pitch_m = 0.2, along = "x" }
[[leg]]
adaptive = { map = "rangefinder", corner_m = [4.4, 2.6, 0.7], opposite_m = [5.2, 3.4, 0.7], pitch_m = 0.08, tile_m = 0.1 }
[[leg]]
line = { to_m = [4.8, 3.0, 0.3] }
"#;

/// Text after the section [motor_box] of the system file.
const DEVICES: &str = r#"
ground = "../ground/corner.toml"

[[motor_box.device]]
name = "rangefinder"
kind = "tfmini"
rate_hz = 100.0
latency_s = 0.01
resolution_m = 0.001
noise = 0.002

[[process]]
name = "rangefinder"
command = ["sensor", "rangefinder.toml"]
[[process]]
name = "sensor-logger"
command = ["sensor-logger", "--system", "{system}"]

[sensor_logger]
map_cell_m = 0.05
map_reach_m = 0.25
map_area_m = [[4.225, 2.425], [5.375, 3.575]]
[[sensor_logger.sensor]]
name = "rangefinder"
looks_down = true
"#;

const RANGEFINDER: &str =
    "port = \"{domain}/rangefinder\"\nlatency_s = 0.01\nstale_s = 0.5\n[tfmini]\nresolution_m = 0.001\n";

/// Faults that only mean that the machine delayed the control chain.
const STARVED: u32 = MotorAuthority::FAULT_COMMAND_LOST
    | MotorAuthority::FAULT_ESTIMATE_LOST
    | MotorAuthority::FAULT_LONG_GAP
    | MotorAuthority::FAULT_COMPUTER;
/// Longest duration: three minutes; the flight takes one.
const MOST_CYCLES: u64 = 18_000;

/// Distance of a place from the nearest step of the ground, m.
fn from_edge_m([x, y]: [f64; 2]) -> f64 {
    let beside = |value: f64, from: f64| (from - value).max(0.0);
    let upright = (x - EDGE_M[0]).hypot(beside(y, EDGE_M[1]));
    let level = (y - EDGE_M[1]).hypot(beside(x, EDGE_M[0]));
    upright.min(level)
}

#[test]
fn the_fine_lines_are_flown_where_the_live_map_has_edges_and_nowhere_else() {
    steadily(|| {
        let mut robot = Robot::up_with(THREE_CABLES, DEVICES, |configs| {
            std::fs::write(configs.join("ground/corner.toml"), GROUND).unwrap();
            std::fs::write(configs.join("systems/rangefinder.toml"), RANGEFINDER).unwrap();
            std::fs::write(configs.join("missions/look-twice.toml"), MISSION).unwrap();
        });
        robot.arm();
        let maps = RefCell::new(robot.bus.subscriber::<FieldMap>("map/rangefinder").unwrap());
        robot.until("a map", |_| maps.borrow_mut().latest().unwrap().is_some_and(|map| map.samples > 0));
        let mut statuses = robot.bus.subscriber::<PlanStatus>("plan/status").unwrap();
        let run = robot.mission("look-twice");
        // What the leg that waits for the map adds is part of the answer.
        let planned = robot.reason("planner", &run).expect("the planner answers");
        assert!(matches!(planned, Reason::Planned { later: Some((_, Some(_))), .. }), "{planned}");

        let last = robot.last.header.cycle + MOST_CYCLES;
        let mut status = PlanStatus::default();
        while ![PlanStatus::STATE_DONE, PlanStatus::STATE_ABORTED].contains(&status.state) {
            robot.for_cycles(20);
            assert!(robot.last.header.cycle < last, "the mission does not end\n{}", robot.printed());
            status = statuses.latest().unwrap().unwrap_or(status);
            if robot.last.mode == MotorAuthority::MODE_HOLDING && robot.last.faults & STARVED != 0 {
                robot.ask("motor-io", Request::Resume);
            }
        }
        assert_eq!(robot.named & !STARVED, 0, "{}", robot.printed());
        robot.down(rustix::process::Signal::INT);

        let run = robot.run();
        let all = |channel: &str| {
            let statuses = runlog::read_channel::<PlanStatus>(&run, channel).unwrap();
            statuses.into_iter().map(|(_, status)| status).filter(|status| status.legs == 3).collect::<Vec<_>>()
        };
        let statuses = all("plan/status");
        let end = statuses.last().expect("a mission");
        assert_eq!((end.state, end.leg, end.progress), (PlanStatus::STATE_DONE, 3, 1.0));
        for pair in statuses.windows(2) {
            assert!(pair[0].progress <= pair[1].progress && pair[0].elapsed_s <= pair[1].elapsed_s, "it falls");
        }
        let leg: BTreeMap<u64, u32> = statuses.iter().map(|status| (status.header.cycle, status.leg)).collect();
        let truth: BTreeMap<u64, [f64; 3]> = runlog::read_channel::<TruthNode>(&run, "truth/node")
            .unwrap()
            .into_iter()
            .map(|(_, node)| (node.header.stamp_ns, node.position_m))
            .collect();
        let motions = runlog::read_channel::<PlanMotion>(&run, "plan/motion").unwrap();
        let second: Vec<&PlanMotion> = motions
            .iter()
            .map(|(_, motion)| motion)
            .filter(|motion| motion.motion != 0 && leg.get(&motion.header.cycle) == Some(&2))
            .collect();
        // its first segment leads from the end of the coarse raster
        let first = second.first().expect("a second look").current.id;
        let lines = second.iter().filter(|motion| motion.current.id != first);
        let stamps: Vec<u64> = lines.map(|motion| motion.header.stamp_ns).collect();
        let (begin_ns, end_ns) = (*stamps.first().expect("fine lines"), *stamps.last().unwrap());
        let fine: Vec<[f64; 2]> = truth.range(begin_ns..=end_ns).map(|(_, at)| [at[0], at[1]]).collect();
        assert!(fine.len() > 100, "{} places of {} of the second leg", fine.len(), second.len());
        let farthest_m = fine.iter().map(|at| from_edge_m(*at)).fold(0.0, f64::max);
        let nearest_m =
            |to: [f64; 2]| fine.iter().map(|at| (at[0] - to[0]).hypot(at[1] - to[1])).fold(f64::INFINITY, f64::min);
        // At the edge of the area only one track measures.
        let rim_m = 0.5 * COARSE_M;
        let on = |step: u32, from: f64, to: f64| from + (to - rim_m - from) * f64::from(step) / 10.0;
        let up = (0..=10).map(|step| [EDGE_M[0], on(step, EDGE_M[1], HIGH_M[1])]);
        let along = (0..=10).map(|step| [on(step, EDGE_M[0], HIGH_M[0]), EDGE_M[1]]);
        let missed_m = up.chain(along).map(nearest_m).fold(0.0, f64::max);
        println!(
            "{} places of the fine lines, at most {farthest_m:.3} m from an edge; no part of an edge farther than {missed_m:.3} m from them",
            fine.len()
        );
        // Tolerance: half a pitch, and the distance between two samples of the truth; an edge may be anywhere between
        // two tracks with different values.
        assert!(missed_m < 0.5 * FINE_M + 0.02, "{missed_m}");
        assert!(farthest_m < 1.25 * COARSE_M, "{farthest_m}");
        // and there are places far from an edge that the fine lines could have covered
        assert!(from_edge_m(LOW_M) > 2.0 * COARSE_M && from_edge_m(HIGH_M) > 1.5 * COARSE_M);
    });
}
