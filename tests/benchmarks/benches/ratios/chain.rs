//! The steps of the control chain, one cycle each, over a recorded flight; its parts; and the plant relative to real
//! time.

use std::hint::black_box;

use anyhow::{Result, ensure};
use benchmarks::Report;
use cable_control::drive_lag::{DriveLag, LagFit, Record};
use cable_control::law::{InputWeight, LqGain};
use cable_robot::kinematics::{Jacobian, forward_kinematics, inverse_kinematics};
use cable_robot::{Anchors, CableVec, Matrix3, Robot, Vector3, elastic, tension};
use controller::{Inputs, Law};
use criterion::measurement::WallTime;
use criterion::{BatchSize, BenchmarkGroup, Criterion};
use lockstep::{Chain, Cycle, Lockstep, Scenario};
use nims_tests::scenarios::{self, Case};
use plant::{MotorInput, Plant};

use crate::random::Random;

/// Cycles of the flight: ten seconds, most of them in motion.
const CYCLES: usize = 1000;

/// Cycles between two steps of the planner: its process asks it at most 20 times a second.
const PLANNER_CYCLES: u64 = 5;

/// The part of the chain that computes between the readings of a cycle and its command, and its goal, ns: a thousandth
/// of a cycle at 500 Hz.
const TOGETHER: &str = "estimator, controller and planner";
const MOST_NS: f64 = 2_000.0;

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

/// Positions in the room at which the node can hang.
fn poses(robot: &Robot) -> Vec<Vector3<f64>> {
    let mut random = Random(3);
    std::iter::from_fn(|| {
        Some(Vector3::new(2.0 + 6.0 * random.next(), 1.0 + 5.0 * random.next(), 0.3 + 1.5 * random.next()))
    })
    .filter(|at| tension::at(robot, at, &Vector3::zeros(), robot.default_distribution()).is_ok())
    .take(POSES)
    .collect()
}

/// From the position of the last cycle to the present one, m.
fn near() -> Vector3<f64> {
    Vector3::new(0.002, -0.001, 0.001)
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
        let poses = poses(&robot);
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
                both.filter(|(l, at)| forward_kinematics(anchors, black_box(l), Some(&(*at + near()))).is_ok()).count()
            });
        });
        elastic_part(&mut group, elastic_name, &robot, &poses)?;
        group.bench_function(lq, |bencher| {
            bencher.iter(|| {
                poses.iter().fold(0.0, |sum, at| {
                    let gain = Jacobian::at(anchors, black_box(at))
                        .ok()
                        .and_then(|j| j.node_jacobian())
                        .and_then(|b| LqGain::new(&b, 0.01, &Matrix3::zeros(), &InputWeight::Scalar(1.0), 17).ok());
                    sum + gain.map_or(f64::NAN, |gain| gain.velocity(&near())[0])
                })
            });
        });
        report.alone(&format!("position from lengths, {fk}"), ["parts", fk], POSES);
        report.alone(&format!("position near that of the last cycle, {hinted}"), ["parts", hinted], POSES);
        let what = format!("position and tensions of elastic lines, {elastic_name}");
        report.alone(&what, ["parts", elastic_name], POSES);
        report.alone(&format!("Jacobian, gain and command, {lq}"), ["parts", lq], POSES);
    }
    group.finish();
    Ok(())
}

/// Position and tensions from the lengths of elastic lines.
fn elastic_part(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: &str,
    robot: &Robot,
    poses: &[Vector3<f64>],
) -> Result<()> {
    let paid_out = |at: &Vector3<f64>| {
        elastic::realise(robot, at, &Vector3::zeros(), robot.default_distribution()).map(|held| held.unstretched_m)
    };
    let paid_out: Vec<_> = poses.iter().map(paid_out).collect::<Result<_, _>>()?;
    for (lengths, at) in paid_out.iter().zip(poses) {
        let found = elastic::equilibrium(robot, lengths, &Vector3::zeros(), Some(&(at + near())))?.position;
        ensure!((found - at).norm() < 1e-6, "the equilibrium of {name} is at {found:?} instead of {at:?}");
    }
    group.bench_function(name, |bencher| {
        bencher.iter(|| {
            let both = paid_out.iter().zip(poses);
            both.filter(|(lengths, at)| {
                elastic::equilibrium(robot, black_box(lengths), &Vector3::zeros(), Some(&(*at + near()))).is_ok()
            })
            .count()
        });
    });
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

/// A flight: its cycles, and the one before it, in which the mission is planned.
struct Recorded {
    before: Cycle,
    cycles: Vec<Cycle>,
}

fn flight(scenario: &Scenario) -> Result<Recorded> {
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario.clone())?;
    lockstep.zero_and_arm()?;
    let before = lockstep.cycle()?;
    lockstep.run(&mission)?;
    let cycles: Vec<Cycle> = (0..CYCLES).map(|_| lockstep.cycle()).collect::<Result<_>>()?;
    let answered = cycles.iter().filter(|cycle| cycle.command.valid[0] == 1 && cycle.control.valid == 1).count();
    ensure!(answered > CYCLES / 2, "the flight has only {answered} commands");
    Ok(Recorded { before, cycles })
}

/// What the planner sees of a cycle.
fn seen(cycle: &Cycle) -> planner::Inputs<'_> {
    let (authority, estimate) = (Some(&cycle.authority), Some(&cycle.estimate));
    planner::Inputs { now_ns: cycle.input.end_ns, authority, estimate, map: None }
}

/// The deciding parts at the begin of the flight: the planner has the mission, the others are new.
fn at_the_begin(scenario: &Scenario, flown: &Recorded) -> Result<Chain> {
    let mut chain = Chain::new(scenario)?;
    chain.planner.follow_zero(&flown.before.state);
    chain.planner.step(&seen(&flown.before));
    chain.planner.run(&scenario.mission, &seen(&flown.before))?;
    Ok(chain)
}

fn estimate(chain: &mut Chain, cycle: &Cycle) {
    black_box(chain.estimator.step(&cycle.state, Some(&cycle.authority)));
}

fn control(chain: &mut Chain, cycle: &Cycle) {
    black_box(chain.controller.step(&Inputs {
        estimates: [Some(&cycle.estimate), None],
        motion: Some(&cycle.motion),
        authority: Some(&cycle.authority),
        state: Some(&cycle.state),
    }));
}

/// As its process does, the planner is asked in one of so many cycles.
fn plan(chain: &mut Chain, cycle: &Cycle) {
    if cycle.input.header.cycle.is_multiple_of(PLANNER_CYCLES) {
        black_box(chain.planner.step(&seen(cycle)));
    }
}

/// The flight through a part of the chain.
fn part(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: &str,
    (scenario, flown): (&Scenario, &Recorded),
    step: impl Fn(&mut Chain, &Cycle),
) -> Result<()> {
    let mut chain = at_the_begin(scenario, flown)?;
    flown.cycles.iter().for_each(|cycle| plan(&mut chain, cycle));
    let flies = flown.cycles.last().is_some_and(|last| chain.planner.step(&seen(last)).1.state == last.plan.state);
    ensure!(flies, "the planner of the benchmark does not follow the flight");
    group.bench_function(name, |bencher| {
        bencher.iter_batched(
            || at_the_begin(scenario, flown).ok(),
            |chain| {
                chain.map(|mut chain| {
                    flown.cycles.iter().for_each(|cycle| step(&mut chain, cycle));
                    chain
                })
            },
            BatchSize::LargeInput,
        );
    });
    Ok(())
}

/// The steps of motor-io, estimator, controller and planner.
fn steps(
    criterion: &mut Criterion,
    report: &mut Report,
    (robot, words): (&'static str, &str),
    preview: Law,
) -> Result<()> {
    let scenario = Case { robot, mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true)?;
    let with_preview = Scenario { law: preview, ..scenario.clone() };
    let plain = &(&scenario, &flight(&scenario)?);
    let previewed = &(&with_preview, &flight(&with_preview)?);
    let mut group = criterion.benchmark_group(robot);
    part(&mut group, "motor-io", *plain, |chain, cycle| {
        black_box(chain.core.decide(&cycle.input));
        black_box(chain.core.observe(&cycle.input));
    })?;
    part(&mut group, "estimator", *plain, estimate)?;
    part(&mut group, "controller, lq-endpoint", *plain, control)?;
    part(&mut group, "controller, preview", *previewed, control)?;
    part(&mut group, "planner", *plain, plan)?;
    part(&mut group, TOGETHER, *plain, |chain, cycle| {
        estimate(chain, cycle);
        control(chain, cycle);
        plan(chain, cycle);
    })?;
    group.finish();
    for name in ["motor-io", "estimator", "controller, lq-endpoint", "controller, preview", "planner"] {
        report.alone(&format!("a cycle of {name}, {words}"), [robot, name], CYCLES);
    }
    report.bounded(&format!("a cycle of {TOGETHER}, {words}"), [robot, TOGETHER], CYCLES, MOST_NS);
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
