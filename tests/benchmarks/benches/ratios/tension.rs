//! Tensions of four cables, including the structure matrix, compared with an interior-point method for the least norm
//! and a simplex method for the least sum; and the energy-optimal parabola.

use std::hint::black_box;

use anyhow::{Context, Result, ensure};
use benchmarks::Report;
use cable_robot::energy::{Bounds, WinchEnergy};
use cable_robot::motor::Motor;
use cable_robot::{Anchors, Distribution, StructureMatrix, Vector3, tension};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};
use criterion::{BatchSize, Criterion};
use microlp::{ComparisonOp, OptimizationDirection, Problem};

use crate::random::Random;

/// Four asymmetric anchors in a wood, m.
const ANCHORS_M: [[f64; 3]; 4] = [[0.0, 0.0, 6.0], [10.4, 0.3, 6.3], [9.7, 8.9, 5.8], [-0.5, 9.4, 6.1]];
/// Three anchors of a lab, m.
const LAB_M: [[f64; 3]; 3] = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
const LIMITS_N: [f64; 2] = [1.0, 150.0];
const POSES: usize = 64;

/// Weight of 2 kg, N.
fn weight() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, 2.0 * 9.81)
}

fn ours(anchors: &Anchors, at: &Vector3<f64>, method: Distribution) -> Result<[f64; 4]> {
    let structure = StructureMatrix::at(anchors, at)?;
    let found = tension::distribute(&structure, &weight(), LIMITS_N, method)?;
    Ok([0, 1, 2, 3].map(|i| found.tensions_n[i]))
}

/// Unit vectors from the node to the anchors, computed without the project's kinematics.
fn pulls(at: &Vector3<f64>) -> [Vector3<f64>; 4] {
    ANCHORS_M.map(|anchor| (Vector3::from(anchor) - at).normalize())
}

/// The least norm as a quadratic program, ready to solve.
fn quadratic(at: &Vector3<f64>, settings: &DefaultSettings<f64>) -> Result<DefaultSolver<f64>> {
    let [low, high] = LIMITS_N;
    let pulls = pulls(at);
    let mut rows = vec![[0.0; 4]; 11];
    let mut right = vec![0.0; 11];
    for axis in 0..3 {
        rows[axis] = pulls.map(|pull| pull[axis]);
        right[axis] = weight()[axis];
    }
    for i in 0..4 {
        rows[3 + i][i] = 1.0;
        right[3 + i] = high;
        rows[7 + i][i] = -1.0;
        right[7 + i] = -low;
    }
    let (p, a) = (CscMatrix::identity(4), CscMatrix::from(&rows));
    let cones = [ZeroConeT(3), NonnegativeConeT(8)];
    DefaultSolver::new(&p, &[0.0; 4], &a, &right, &cones, settings.clone()).context("the quadratic program is refused")
}

fn least_norm_by_interior_point(at: &Vector3<f64>, settings: &DefaultSettings<f64>) -> Result<[f64; 4]> {
    let mut solver = quadratic(at, settings)?;
    solver.solve();
    ensure!(solver.solution.status == SolverStatus::Solved, "the quadratic program ended {:?}", solver.solution.status);
    Ok([0, 1, 2, 3].map(|i| solver.solution.x[i]))
}

/// The least sum as a linear program.
fn linear(at: &Vector3<f64>) -> Problem {
    let [low, high] = LIMITS_N;
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let variables = [(); 4].map(|()| problem.add_var(1.0, (low, high)));
    let pulls = pulls(at);
    for axis in 0..3 {
        let row = [0, 1, 2, 3].map(|i| (variables[i], pulls[i][axis]));
        problem.add_constraint(&row, ComparisonOp::Eq, weight()[axis]);
    }
    problem
}

fn least_sum_by_simplex(problem: &Problem) -> Result<f64> {
    let solution = problem.solve()?.into_solution().ok().context("the simplex method was interrupted")?;
    Ok(solution.objective())
}

/// Positions below the anchors at which four cables hold the node.
fn poses(anchors: &Anchors) -> Vec<Vector3<f64>> {
    let mut random = Random(1);
    std::iter::from_fn(|| {
        Some(Vector3::new(0.5 + 9.0 * random.next(), 0.5 + 8.0 * random.next(), 0.5 + 4.5 * random.next()))
    })
    .filter(|at| ours(anchors, at, Distribution::LeastNorm).is_ok())
    .take(POSES)
    .collect()
}

/// Runs the benchmarks of this file.
pub fn run(criterion: &mut Criterion, report: &mut Report) -> Result<()> {
    let anchors = Anchors::new(&ANCHORS_M)?;
    let settings = DefaultSettingsBuilder::default().verbose(false).build()?;
    let poses = poses(&anchors);
    for at in &poses {
        let (ours_n, theirs_n) =
            (ours(&anchors, at, Distribution::LeastNorm)?, least_norm_by_interior_point(at, &settings)?);
        let apart = ours_n.iter().zip(theirs_n).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
        ensure!(apart < 1e-3, "least norm at {at:?}: {ours_n:?} N, by the interior-point method {theirs_n:?} N");
        let (sum_n, simplex_n) =
            (ours(&anchors, at, Distribution::MinSum)?.iter().sum::<f64>(), least_sum_by_simplex(&linear(at))?);
        ensure!(
            (sum_n - simplex_n).abs() < 1e-6,
            "least sum at {at:?}: {sum_n} N, by the simplex method {simplex_n} N"
        );
    }

    let mut group = criterion.benchmark_group("tension");
    for (name, method) in [("least norm", Distribution::LeastNorm), ("least sum", Distribution::MinSum)] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| poses.iter().filter(|at| ours(&anchors, black_box(at), method).is_ok()).count());
        });
    }
    group.bench_function("Clarabel", |bencher| {
        bencher
            .iter(|| poses.iter().filter(|at| least_norm_by_interior_point(black_box(at), &settings).is_ok()).count());
    });
    group.bench_function("Clarabel, solving only", |bencher| {
        bencher.iter_batched(
            || poses.iter().filter_map(|at| quadratic(at, &settings).ok()).collect::<Vec<_>>(),
            |mut solvers| {
                solvers.iter_mut().for_each(IPSolver::solve);
                solvers
            },
            BatchSize::LargeInput,
        );
    });
    group.bench_function("simplex", |bencher| {
        bencher.iter(|| poses.iter().filter(|at| least_sum_by_simplex(&linear(black_box(at))).is_ok()).count());
    });
    group.bench_function("simplex, solving only", |bencher| {
        bencher.iter_batched(
            || poses.iter().map(linear).collect::<Vec<_>>(),
            |problems| problems.iter().filter(|problem| least_sum_by_simplex(problem).is_ok()).count(),
            BatchSize::LargeInput,
        );
    });
    group.finish();
    let norm = ["tension", "least norm"];
    report.pair("least-norm tensions, four cables", norm, ["tension", "Clarabel"], POSES, Some(100.0));
    report.pair("the same", norm, ["tension", "Clarabel, solving only"], POSES, Some(100.0));
    report.pair("the same", norm, ["tension", "simplex"], POSES, Some(30.0));
    report.pair("the same", norm, ["tension", "simplex, solving only"], POSES, Some(30.0));
    report.pair("least-sum tensions, four cables", ["tension", "least sum"], ["tension", "simplex"], POSES, Some(30.0));
    parabola(criterion, report)
}

/// The parabola with the least cost.
fn parabola(criterion: &mut Criterion, report: &mut Report) -> Result<()> {
    let (motor, bounds) = (Motor::default(), Bounds { ground_m: Some(0.0), time_weight_w: 0.0 });
    let (four, three) = (Anchors::new(&ANCHORS_M)?, Anchors::new(&LAB_M)?);
    let mut group = criterion.benchmark_group("parabola");
    for (name, what, anchors, method, from, to) in [
        (
            "three",
            "optimal parabola, three cables",
            &three,
            Distribution::Unique,
            Vector3::new(3.3, 1.6, 2.2),
            Vector3::new(6.6, 1.9, 2.1),
        ),
        (
            "four",
            "optimal parabola, four cables",
            &four,
            Distribution::LeastNorm,
            Vector3::new(2.5, 2.5, 4.0),
            Vector3::new(7.5, 2.5, 4.0),
        ),
    ] {
        let hoist = WinchEnergy {
            anchors,
            wrench_n: weight(),
            drag_n_s2_m2: 0.0,
            cable_weight_n_m: 0.0,
            limits_n: LIMITS_N,
            method,
            current: &motor,
        };
        let best = || hoist.best_parabola(black_box(&from), black_box(&to), 0.2, 64, &bounds);
        // At least as good as the best of a thousand parabolas.
        let found = best()?;
        let ground = cable_robot::energy::parabola::mu_limit(&from, &to, 0.0)?.context("no ground")?;
        let least = (0..=1000)
            .filter_map(|i| {
                let path = cable_robot::path::Parabola { from, to, mu_per_m: ground * f64::from(i) / 1000.0 };
                hoist.constant_speed(&path, 0.2, 64).ok()
            })
            .fold(f64::INFINITY, |least: f64, cost| least.min(cost.energy_j));
        let energy_j = found.cost.energy_j;
        ensure!(energy_j <= least * (1.0 + 1e-6), "{what}: {energy_j} J, and one of a thousand takes {least} J");
        group.bench_function(name, |bencher| bencher.iter(best));
        report.alone(what, ["parabola", name], 1);
    }
    group.finish();
    Ok(())
}
