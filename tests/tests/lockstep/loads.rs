//! Stiffness and node weight from a known weight that is hung on the node, in drawn worlds.
//!
//! `NIMS_WORLDS=40 cargo test --workspace --test lockstep -- loads:: --nocapture` has more worlds.

use crate::drawn::{Drawn, number};
use cable_robot::{CableVec, Vector3};
use calibration::{LoadMeasurements, Sinking, Weighing, loads};
use messages::{MotorAuthority as A, PlanStatus};
use planner::mission::{Leg, Line, Mission, PathShape};
use plant::random::Random;
use plant::{Plant, PlantConfig};

/// The known weight, N: two kilograms.
const ADDED_N: f64 = 20.0;
/// Error of the ruler, m.
const RULER_M: f64 = 0.001;
/// Way up and down, m, its speed, m/s, and how often.
const WAY_M: f64 = 0.4;
const SPEED_M_S: f64 = 0.1;
const TIMES: usize = 4;

/// Value and standard deviation, the truth, and what the robot file states.
type Row = ((f64, f64), f64, f64);

/// Prints errors beside stated deviations; the result has to be better than the robot file, and to say how good it is.
fn report(name: &str, table: &[[Row; 2]]) {
    for (k, what) in ["stiffness", "node weight"].into_iter().enumerate() {
        let median = |share: fn(&Row) -> f64| {
            let mut all: Vec<f64> = table.iter().map(|row| share(&row[k])).collect();
            all.sort_by(f64::total_cmp);
            100.0 * all[all.len() / 2]
        };
        let inside = table.iter().filter(|row| (row[k].0.0 - row[k].1).abs() <= 1.96 * row[k].0.1).count();
        let (error, stated) = (median(|r| (r.0.0 / r.1 - 1.0).abs()), median(|r| r.0.1 / r.0.0));
        let before = median(|r| (r.2 / r.1 - 1.0).abs());
        let all = table.len();
        println!(
            "{name}, {what}: median error {error:.1} % (robot file {before:.1} %), stated {stated:.1} %, {inside} of {all} inside 95 %"
        );
        assert!(inside * 10 >= all * 8, "{name} {what}: {inside} of {all}");
        assert!(error < before, "{name} {what}: {error} % {before} %");
    }
}

/// The plant at rest at a place with more weight on the node.
fn hung(drawn: &Drawn, at: Vector3<f64>, added_n: f64) -> Option<Plant> {
    let mut config = PlantConfig { start_m: at.into(), ..drawn.plant.clone() };
    config.node.mass_kg += added_n / config.gravity_m_s2;
    config.node.net_weight_n = config.node.net_weight_n.map(|n| n + added_n);
    Plant::new(config).ok()
}

/// By how much the true node sinks under the weight, with the cable that is out: three steps of Newton's method.
fn sunk_m(drawn: &Drawn, at: Vector3<f64>) -> Option<f64> {
    let before = hung(drawn, at, 0.0)?.lengths_m();
    let off = |there: Vector3<f64>| -> Option<Vector3<f64>> {
        let lengths = hung(drawn, there, ADDED_N)?.lengths_m();
        Some(Vector3::from_fn(|i, _| lengths[i] - before[i]))
    };
    let (mut there, step_m) = (at, 1e-4);
    for _ in 0..4 {
        let here = off(there)?;
        let mut slope = cable_robot::Matrix3::zeros();
        for k in 0..3 {
            let mut probe = there;
            probe[k] += step_m;
            slope.set_column(k, &((off(probe)? - here) / step_m));
        }
        there -= slope.try_inverse()? * here;
    }
    Some(at.z - there.z)
}

/// Mean currents up and down with more weight on the node.
fn weighed(drawn: &Drawn, added_n: f64) -> Option<Weighing> {
    let mut heavier = drawn.clone();
    heavier.plant.node.mass_kg += added_n / heavier.plant.gravity_m_s2;
    heavier.plant.node.net_weight_n = heavier.plant.node.net_weight_n.map(|n| n + added_n);
    let start = Vector3::from(drawn.plant.start_m);
    let mut flight = heavier.lockstep();
    flight.zero_and_arm().unwrap();
    let leg = |z: f64| Leg::Line(Line { to_m: [start.x, start.y, start.z + z].into(), speed_m_s: Some(SPEED_M_S) });
    let mission = Mission {
        name: "up and down".to_owned(),
        speed_m_s: None,
        acceleration_m_s2: None,
        path: PathShape::Line,
        time_weight_w: 0.0,
        relative: false,
        leg: (0..TIMES).flat_map(|_| [leg(WAY_M), leg(0.0)]).collect(),
    };
    flight.run(&mission).ok()?;
    let n = drawn.plant.cable_count();
    let (mut sums, mut counts) = ([[0.0; 8]; 2], [0.0; 2]);
    for _ in 0..40_000 {
        let cycle = flight.cycle().unwrap();
        if cycle.authority.faults != 0 || cycle.plan.state == PlanStatus::STATE_ABORTED {
            return None;
        }
        if cycle.plan.state == PlanStatus::STATE_DONE {
            break;
        }
        // The middle of each way, at its full speed.
        let up_m = cycle.state.node_m[2] - start.z;
        let speed_m_s = cycle.state.node_command_m_s[2];
        let middle = (0.25 * WAY_M..0.75 * WAY_M).contains(&up_m) && cycle.authority.mode == A::MODE_FOLLOWING;
        if middle && speed_m_s.abs() > 0.9 * SPEED_M_S {
            let way = usize::from(speed_m_s < 0.0);
            counts[way] += 1.0;
            (0..n).for_each(|i| sums[way][i] += cycle.state.current_a[i]);
        }
    }
    let mean = |way: usize| CableVec::from_fn(n, |i| sums[way][i] / counts[way]);
    let position_m = [start.x, start.y, start.z + 0.5 * WAY_M];
    Some(Weighing { position_m, added_n, up_a: mean(0), down_a: mean(1) })
}

#[test]
fn stiffness_and_weight_are_found_in_drawn_worlds() {
    for name in ["demo3", "field3"] {
        let (mut table, mut undetermined) = (Vec::new(), 0);
        for seed in 1..=number("NIMS_WORLDS", 8) {
            let drawn = Drawn::new(name, seed);
            let mut random = Random::new(seed);
            let anchors = drawn.true_anchors();
            let middle = anchors.iter().sum::<Vector3<f64>>() / anchors.len() as f64;
            let mut sinkings = Vec::new();
            for anchor in anchors.iter() {
                for share in [0.2, 0.5] {
                    let out = (anchor - middle) * share;
                    let at = Vector3::new(middle.x + out.x, middle.y + out.y, 0.15 * middle.z);
                    let Some(sunk_m) = sunk_m(&drawn, at) else { continue };
                    let sunk_m = sunk_m + RULER_M * random.gaussian();
                    sinkings.push(Sinking { position_m: at.into(), added_n: ADDED_N, sunk_m });
                }
            }
            let weighings = [0.0, ADDED_N].iter().filter_map(|n| weighed(&drawn, *n)).collect();
            let measured = LoadMeasurements { sinkings, weighings, ..LoadMeasurements::default() };
            let parts = drawn.robot.parts().unwrap();
            let found = loads(&parts, &measured).unwrap();
            let cables = &drawn.plant.world.cables;
            let true_n = cables.iter().map(|c| c.line.unwrap_or(drawn.plant.line).stiffness_n).sum::<f64>()
                / cables.len() as f64;
            let file_n = drawn.robot.robot().unwrap().net_weight_n();
            let weight_n = drawn.plant.node.net_weight_n.unwrap_or(drawn.plant.node.mass_kg * drawn.plant.gravity_m_s2);
            // The ruler cannot compete with a tape for the routed length, and says so.
            assert_eq!(found.routed_change_m.value(), None, "{name} {seed}: {found:?}");
            let (Some(stiffness), Some(weight)) = (found.stiffness_n.value(), found.node_weight_n.value()) else {
                println!("{name}, world {seed}: {found:?}");
                undetermined += 1;
                continue;
            };
            table.push([(stiffness, true_n, parts.stiffness_n.unwrap()), (weight, weight_n, file_n)]);
        }
        assert!(undetermined * 10 <= table.len(), "{name}: {undetermined} undetermined");
        report(name, &table);
    }
}
