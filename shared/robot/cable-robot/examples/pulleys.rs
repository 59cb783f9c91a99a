//! Times of the kinematics with pulleys beside those with eyes: `cargo run --release -p cable-robot --example pulleys`.

use std::hint::black_box;
use std::time::Instant;

use cable_robot::kinematics::{Jacobian, forward_kinematics, inverse_kinematics};
use cable_robot::{Anchors, CableVec, NodeJacobian, Robot, RobotError, RobotParts, Vector3, elastic, tension};

const ANCHORS_M: [[f64; 3]; 8] = [
    [0.0, 0.0, 3.05],
    [9.9, 0.1, 3.10],
    [9.8, 8.9, 2.98],
    [0.1, 9.0, 3.02],
    [5.0, -0.5, 3.07],
    [10.4, 4.5, 3.01],
    [5.1, 9.6, 3.04],
    [-0.5, 4.4, 2.99],
];
const POSES: usize = 200;
const ROUNDS: usize = 400;
/// How far a hint is from the position: a cycle or two of motion.
const NEAR_M: Vector3<f64> = Vector3::new(0.002, -0.001, 0.001);

/// Median times of one operation with eyes (0) and with pulleys (1), ns. Rounds of the two alternate, so that both have
/// the same machine.
fn each(round: &dyn Fn(usize)) -> [f64; 2] {
    let mut times_ns = [const { Vec::new() }; 2];
    for k in 0..2 * ROUNDS {
        let from = Instant::now();
        round(k % 2);
        times_ns[k % 2].push(from.elapsed().as_nanos() as f64 / POSES as f64);
    }
    times_ns.map(|mut times_ns| {
        times_ns.sort_by(f64::total_cmp);
        times_ns[ROUNDS / 2]
    })
}

fn row(name: &str, [eyes, pulleys]: [f64; 2]) {
    println!("{name:>24} {eyes:>9.0} {pulleys:>9.0} {:>6.1}", pulleys / eyes);
}

/// Rows of lengths, Jacobians and positions for these anchors with eyes and with pulleys.
fn geometry_rows(n: usize, both: &[Anchors; 2], poses: &[Vector3<f64>]) {
    let lengths = both.map(|a| poses.iter().map(|at| inverse_kinematics(&a, at)).collect::<Vec<CableVec>>());
    row(
        &format!("lengths, {n} cables"),
        each(&|k| {
            for at in poses {
                let _ = black_box(inverse_kinematics(&both[k], black_box(at)));
            }
        }),
    );
    row(
        &format!("Jacobian, {n} cables"),
        each(&|k| {
            for at in poses {
                let _ = black_box(Jacobian::at(&both[k], black_box(at)));
            }
        }),
    );
    row(
        &format!("inverse of it, {n} cables"),
        each(&|k| {
            for at in poses {
                let _ = black_box(NodeJacobian::at(&both[k], black_box(at)));
            }
        }),
    );
    row(
        &format!("position, {n} cables"),
        each(&|k| {
            for l in &lengths[k] {
                let _ = black_box(forward_kinematics(&both[k], black_box(l), None));
            }
        }),
    );
    row(
        &format!("position near, {n} cables"),
        each(&|k| {
            for (l, at) in lengths[k].iter().zip(poses) {
                let _ = black_box(forward_kinematics(&both[k], black_box(l), Some(&(at + NEAR_M))));
            }
        }),
    );
}

/// What one cable cannot do without: one root for an eye; for a pulley two roots, a quotient and an angle, each of
/// which waits for the one before.
fn bare_row(poses: &[Vector3<f64>]) {
    row(
        "bare operations, 1 cable",
        each(&|k| {
            for at in poses {
                let at = black_box(at);
                let root = (at.x * at.x + at.y * at.y).sqrt();
                black_box(if k == 0 {
                    root
                } else {
                    let free = (at.z * at.z + root).sqrt();
                    libm::atan2(free, root / free)
                });
            }
        }),
    );
}

fn poses() -> Vec<Vector3<f64>> {
    let at = |share: f64| {
        Vector3::new(3.0 + 3.0 * share, 2.0 + 2.0 * (7.0 * share).fract(), 0.3 + 1.5 * (13.0 * share).fract())
    };
    (0..POSES).map(|i| at(i as f64 / POSES as f64)).collect()
}

fn main() -> Result<(), RobotError> {
    println!("{:>24} {:>9} {:>9} {:>6}", "ns", "eyes", "pulleys", "ratio");
    let poses = poses();
    bare_row(&poses);
    for n in [3, 4, 8] {
        let eyes = Anchors::new(&ANCHORS_M[..n])?;
        let both = [eyes, eyes.with_pulleys(&[0.04; 8][..n])?];
        geometry_rows(n, &both, &poses);
        let robot = Robot::new(RobotParts {
            anchors_m: ANCHORS_M[..n].to_vec(),
            node_mass_kg: 1.2,
            tension_limits_n: [0.0, 90.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            stiffness_n: Some(6000.0),
            routed_length_m: Some(vec![6.0; n]),
            ..RobotParts::default()
        })?;
        let robots = [robot, robot.with_pulleys(&[0.04; 8][..n])?];
        let distribution = robot.default_distribution();
        let held = robots.map(|robot| {
            let hold = |at| elastic::realise(&robot, at, &Vector3::zeros(), distribution).ok();
            let held: Vec<_> = poses.iter().filter_map(|at| Some((*at, hold(at)?.unstretched_m))).collect();
            held
        });
        row(
            &format!("tensions, {n} cables"),
            each(&|k| {
                for at in &poses {
                    let _ = black_box(tension::at(&robots[k], black_box(at), &Vector3::zeros(), distribution));
                }
            }),
        );
        let hang = |k: usize| {
            for (at, l) in &held[k] {
                let near = at + NEAR_M;
                let _ = black_box(elastic::equilibrium(&robots[k], black_box(l), &Vector3::zeros(), Some(&near)));
            }
        };
        row(&format!("equilibrium, {n} cables"), each(&hang));
    }
    Ok(())
}
