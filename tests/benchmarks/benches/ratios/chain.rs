//! The steps of the control chain, one cycle each, over a recorded flight; its parts; and the plant relative to real
//! time.

use std::hint::black_box;

use anyhow::{Context, Result, ensure};
use benchmarks::Report;
use cable_control::drive_lag::{DriveLag, LagFit, Record};
use cable_control::law::{InputWeight, LqGain};
use cable_robot::kinematics::{Jacobian, forward_kinematics, inverse_kinematics};
use cable_robot::{Anchors, CableVec, Matrix3, Vector3, elastic};
use controller::{Inputs, Law};
use criterion::{BatchSize, Criterion};
use lockstep::{Chain, Cycle, Lockstep, Scenario};
use nims_tests::scenarios::{self, Case};
use plant::{MotorInput, Plant};

use crate::random::Random;

/// Cycles of the flight: ten seconds, most of them in motion.
const CYCLES: usize = 1000;

/// Position solutions and gains per run.
const POSES: usize = 64;

/// Runs the benchmarks of this file.
pub fn run(criterion: &mut Criterion, report: &mut Report) -> Result<()> {
    parts(criterion, report)?;
    identification(criterion, report)?;
    let preview = nims_tests::laws::law(Some(DriveLag::new(0.03, 0.04)?), false)?;
    for (robot, words) in [("lab3", "three cables"), ("lab4", "four cables")] {
        steps(criterion, report, (robot, words), preview)?;
        simulation(criterion, report, (robot, words))?;
    }
    Ok(())
}

/// Kinematics and the paper's law alone.
fn parts(criterion: &mut Criterion, report: &mut Report) -> Result<()> {
    let mut group = criterion.benchmark_group("parts");
    for (name, fk, hinted, lq, elastic_name) in [
        ("lab3", "fk3", "fk3 near", "lq-endpoint, three", "elastic, three"),
        ("lab4", "fkN", "fkN near", "lq-endpoint, four", "elastic, four"),
    ] {
        let robot = scenarios::robot(name)?;
        let anchors: &Anchors = robot.anchors();
        let mut random = Random(3);
        let poses: Vec<_> = std::iter::from_fn(|| {
            Some(Vector3::new(2.0 + 6.0 * random.next(), 1.0 + 5.0 * random.next(), 0.3 + 1.5 * random.next()))
        })
        .filter(|at| {
            let method = robot.default_distribution();
            cable_robot::tension::at(&robot, at, &Vector3::zeros(), method).is_ok()
        })
        .take(POSES)
        .collect();
        let near = Vector3::new(0.002, -0.001, 0.001);
        let lengths: Vec<_> = poses.iter().map(|at| inverse_kinematics(anchors, at)).collect();
        for (lengths, at) in lengths.iter().zip(&poses) {
            let found = forward_kinematics(anchors, lengths, None)?.position;
            ensure!((found - at).norm() < 1e-9, "forward kinematics of {name} finds {found:?} instead of {at:?}");
        }
        group.bench_function(fk, |bencher| {
            bencher.iter(|| lengths.iter().filter(|l| forward_kinematics(anchors, black_box(l), None).is_ok()).count());
        });
        group.bench_function(hinted, |bencher| {
            bencher.iter(|| {
                let both = lengths.iter().zip(&poses);
                both.filter(|(l, at)| forward_kinematics(anchors, black_box(l), Some(&(*at + near))).is_ok()).count()
            });
        });
        let paid_out: Vec<_> = poses
            .iter()
            .map(|at| {
                let method = robot.default_distribution();
                elastic::realise(&robot, at, &Vector3::zeros(), method).map(|held| held.unstretched_m)
            })
            .collect::<Result<_, _>>()?;
        for (lengths, at) in paid_out.iter().zip(&poses) {
            let found = elastic::equilibrium(&robot, lengths, &Vector3::zeros(), Some(&(at + near)))?.position;
            ensure!((found - at).norm() < 1e-6, "the equilibrium of {name} is at {found:?} instead of {at:?}");
        }
        group.bench_function(elastic_name, |bencher| {
            bencher.iter(|| {
                let both = paid_out.iter().zip(&poses);
                both.filter(|(lengths, at)| {
                    elastic::equilibrium(&robot, black_box(lengths), &Vector3::zeros(), Some(&(*at + near))).is_ok()
                })
                .count()
            });
        });
        group.bench_function(lq, |bencher| {
            bencher.iter(|| {
                poses.iter().fold(0.0, |sum, at| {
                    let gain = Jacobian::at(anchors, black_box(at))
                        .ok()
                        .and_then(|j| j.node_jacobian())
                        .and_then(|b| LqGain::new(&b, 0.01, &Matrix3::zeros(), &InputWeight::Scalar(1.0), 17).ok());
                    sum + gain.map_or(f64::NAN, |gain| gain.velocity(&near)[0])
                })
            });
        });
        report.alone(&format!("position from lengths, {fk}"), ["parts", fk], POSES);
        report.alone(&format!("position near that of the last cycle, {hinted}"), ["parts", hinted], POSES);
        report.alone(
            &format!("position and tensions of elastic lines, {elastic_name}"),
            ["parts", elastic_name],
            POSES,
        );
        report.alone(&format!("Jacobian, gain and command, {lq}"), ["parts", lq], POSES);
    }
    group.finish();
    Ok(())
}

/// One pass of the fit of delay and lag; the robot runs one per cycle.
fn identification(criterion: &mut Criterion, report: &mut Report) -> Result<()> {
    let commands: Vec<_> = (0..150).map(|k| CableVec::repeat(4, if k > 50 { 0.2 } else { 0.0 })).collect();
    let velocities: Vec<_> = (0..150).map(|k| CableVec::repeat(4, if k > 57 { 0.2 } else { 0.0 })).collect();
    let record = Record {
        period_s: 0.01,
        reading_s: CableVec::repeat(4, 0.004),
        commands_m_s: &commands,
        velocities_m_s: &velocities,
        ignored: 50,
    };
    let fit = LagFit::new(&record)?;
    criterion.benchmark_group("parts").bench_function("identification pass", |bencher| {
        bencher.iter(|| {
            let mut fit = fit;
            fit.pass(black_box(&record)).is_ok()
        });
    });
    report.alone("one pass of the identification of delay and lag, four cables", ["parts", "identification pass"], 1);
    Ok(())
}

/// A flight, cycle by cycle, with fresh deciding parts that receive it.
fn flight(scenario: &Scenario) -> Result<Vec<Cycle>> {
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario.clone())?;
    lockstep.zero_and_arm()?;
    lockstep.run(&mission)?;
    (0..CYCLES).map(|_| lockstep.cycle()).collect()
}

/// The steps of motor-io, estimator and controller.
fn steps(
    criterion: &mut Criterion,
    report: &mut Report,
    (robot, words): (&'static str, &str),
    preview: Law,
) -> Result<()> {
    let scenario = Case { robot, mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true)?;
    let with_preview = Scenario { law: preview, ..scenario.clone() };
    let cycles = flight(&scenario)?;
    let previewed = flight(&with_preview)?;
    for flown in [&cycles, &previewed] {
        let answered = flown.iter().filter(|cycle| cycle.command.valid[0] == 1 && cycle.control.valid == 1).count();
        ensure!(answered > CYCLES / 2, "the flight of {robot} has only {answered} commands");
    }
    Chain::new(&scenario).and(Chain::new(&with_preview)).context("no control chain")?;
    let fresh = |scenario: &Scenario| Chain::new(scenario).ok();
    let mut group = criterion.benchmark_group(robot);
    group.bench_function("motor-io", |bencher| {
        bencher.iter_batched(
            || fresh(&scenario),
            |chain| {
                chain.map(|mut chain| {
                    for cycle in &cycles {
                        black_box(chain.core.decide(&cycle.input));
                        black_box(chain.core.observe(&cycle.input));
                    }
                    chain
                })
            },
            BatchSize::LargeInput,
        );
    });
    group.bench_function("estimator", |bencher| {
        bencher.iter_batched(
            || fresh(&scenario),
            |chain| {
                chain.map(|mut chain| {
                    for cycle in &cycles {
                        black_box(chain.estimator.step(&cycle.state, Some(&cycle.authority)));
                    }
                    chain
                })
            },
            BatchSize::LargeInput,
        );
    });
    for (name, scenario, cycles) in
        [("controller, lq-endpoint", &scenario, &cycles), ("controller, preview", &with_preview, &previewed)]
    {
        group.bench_function(name, |bencher| {
            bencher.iter_batched(
                || fresh(scenario),
                |chain| {
                    chain.map(|mut chain| {
                        for cycle in cycles {
                            black_box(chain.controller.step(&Inputs {
                                estimates: [Some(&cycle.estimate), None],
                                motion: Some(&cycle.motion),
                                authority: Some(&cycle.authority),
                                state: Some(&cycle.state),
                            }));
                        }
                        chain
                    })
                },
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
    for name in ["motor-io", "estimator", "controller, lq-endpoint", "controller, preview"] {
        report.alone(&format!("a cycle of {name}, {words}"), [robot, name], CYCLES);
    }
    Ok(())
}

/// The plant in motion, a second of it in cycles of 10 ms.
fn simulation(criterion: &mut Criterion, report: &mut Report, (robot, words): (&'static str, &str)) -> Result<()> {
    let scenario = Case { robot, mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true)?;
    let mut plant = Plant::new(scenario.plant)?;
    let n = plant.cable_count();
    let inputs: Vec<MotorInput> = (0..n).map(|i| plant.speed_input(i, -0.02)).collect();
    plant.step(0.5, &inputs)?;
    criterion.benchmark_group(robot).bench_function("plant", |bencher| {
        bencher.iter_batched(
            || plant.clone(),
            |mut plant| {
                for _ in 0..100 {
                    if plant.step(0.01, &inputs).is_err() {
                        break;
                    }
                }
                plant
            },
            BatchSize::LargeInput,
        );
    });
    report.alone(&format!("a second of the plant, {words}"), [robot, "plant"], 1);
    report.remark("real time over this is how many times faster it runs");
    Ok(())
}
