//! Heights of the anchors from lengths to 43 points: the closed form compared with a search for the minimum of (4).

use std::hint::black_box;

use anyhow::{Context, Result, ensure};
use argmin::core::{CostFunction, Error, Executor, State};
use argmin::solver::neldermead::NelderMead;
use benchmarks::Report;
use cable_robot::CableVec;
use calibration::calibrate_heights;
use calibration::heights::closed_form;
use criterion::Criterion;

use crate::random::Random;

const POINTS: usize = 43;

/// Standard deviation of a length, m.
const SIGMA_M: f64 = 0.005;

/// Start of the search, m, and size of its first simplex relative to it: 5 %, as in MATLAB's fminsearch.
const START_M: f64 = 3.0;
const REACH: f64 = 0.05;

/// Spread of the costs in the simplex at which the search ends, m⁴. Near the minimum the cost grows by about 2500 m²
/// times the squared error of the heights, so these correspond to 20 nm, where both methods give the same answer, and
/// to 0.1 mm, which is sufficient in practice.
const ENDS_M4: [f64; 2] = [1e-12, 2.5e-5];

/// Cost (4) for given x and y of the anchors: the residual of the lengths after the best points for these heights.
#[derive(Clone)]
struct Unexplained {
    /// Anchors relative to their mean, m.
    anchors: Vec<[f64; 2]>,
    /// The rows of -(pseudo-inverse of the anchors) / 2, 1/m.
    solver: Vec<[f64; 2]>,
    /// Squared length minus squared anchor distance, m², by point.
    shares: Vec<Vec<f64>>,
}

impl Unexplained {
    fn new(anchors: &[[f64; 3]], lengths: &[CableVec]) -> Self {
        let n = anchors.len() as f64;
        let mean = [0, 1].map(|axis| anchors.iter().map(|a| a[axis]).sum::<f64>() / n);
        let anchors: Vec<_> = anchors.iter().map(|a| [a[0] - mean[0], a[1] - mean[1]]).collect();
        let sum = |f: &dyn Fn(&[f64; 2]) -> f64| anchors.iter().map(f).sum::<f64>();
        let (xx, xy, yy) = (sum(&|a| a[0] * a[0]), sum(&|a| a[0] * a[1]), sum(&|a| a[1] * a[1]));
        let scale = -0.5 / (xx * yy - xy * xy);
        let solver = anchors.iter().map(|[x, y]| [scale * (yy * x - xy * y), scale * (xx * y - xy * x)]).collect();
        let shares = lengths
            .iter()
            .map(|point| point.iter().zip(&anchors).map(|(l, [x, y])| l * l - x * x - y * y).collect())
            .collect();
        Self { anchors, solver, shares }
    }

    fn at(&self, heights_m: &[f64]) -> f64 {
        let mut sum = 0.0;
        for share in &self.shares {
            let mut point = [0.0; 2];
            for ((s, z), row) in share.iter().zip(heights_m).zip(&self.solver) {
                let rest = s - z * z;
                point[0] += row[0] * rest;
                point[1] += row[1] * rest;
            }
            for ((s, z), a) in share.iter().zip(heights_m).zip(&self.anchors) {
                let left =
                    s - z * z - point[0] * point[0] - point[1] * point[1] + 2.0 * (a[0] * point[0] + a[1] * point[1]);
                sum += left * left;
            }
        }
        sum
    }
}

impl CostFunction for Unexplained {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, heights_m: &Vec<f64>) -> Result<f64, Error> {
        Ok(self.at(heights_m))
    }
}

/// The minimum by Nelder and Mead, including the preparation of the problem, and the number of cost evaluations.
fn search(anchors: &[[f64; 3]], lengths: &[CableVec], end_m4: f64) -> Result<(Vec<f64>, u64)> {
    let start = vec![START_M; anchors.len()];
    let mut simplex = vec![start.clone()];
    for i in 0..anchors.len() {
        let mut corner = start.clone();
        corner[i] *= 1.0 + REACH;
        simplex.push(corner);
    }
    let solver = NelderMead::new(simplex).with_sd_tolerance(end_m4)?;
    let found = Executor::new(Unexplained::new(anchors, lengths), solver)
        .configure(|state| state.max_iters(5000))
        .timer(false)
        .run()?;
    let evaluations = found.problem.counts.get("cost_count").copied().unwrap_or(0);
    let best = found.state.get_best_param().context("the search found nothing")?;
    Ok((best.clone(), evaluations))
}

/// Lengths to random points below the anchors.
fn measure(anchors: &[[f64; 3]]) -> Vec<CableVec> {
    let mut random = Random(7);
    (0..POINTS)
        .map(|_| {
            let point = [1.0 + 7.5 * random.next(), 0.5 + 7.0 * random.next()];
            CableVec::from_fn(anchors.len(), |i| {
                let [x, y, z] = anchors[i];
                // Uniform, with the required standard deviation.
                let noise = SIGMA_M * 12f64.sqrt() * (random.next() - 0.5);
                ((x - point[0]).powi(2) + (y - point[1]).powi(2) + z * z).sqrt() + noise
            })
        })
        .collect()
}

/// Runs the benchmarks of this file.
pub fn run(criterion: &mut Criterion, report: &mut Report) -> Result<()> {
    let three = vec![[0.0, 0.0, 3.20], [9.8, 0.0, 3.45], [4.62, 7.84, 3.05]];
    let four = vec![[0.0, 0.0, 3.20], [9.8, 0.0, 3.45], [9.5, 8.1, 3.05], [0.3, 7.9, 3.30]];
    let mut group = criterion.benchmark_group("calibration");
    for (what, anchors, [ours, checked, theirs, roughly]) in [
        (
            "heights of three anchors from 43 points",
            three,
            ["three", "checked, three", "Nelder-Mead, three", "Nelder-Mead to 0.1 mm, three"],
        ),
        (
            "heights of four anchors from 43 points",
            four,
            ["four", "checked, four", "Nelder-Mead, four", "Nelder-Mead to 0.1 mm, four"],
        ),
    ] {
        let anchors_xy: Vec<_> = anchors.iter().map(|[x, y, _]| [*x, *y]).collect();
        let lengths = measure(&anchors);
        let closed = closed_form(&anchors_xy, &lengths)?;
        let heights_m = closed.heights_m()?;
        let cost = Unexplained::new(&anchors, &lengths);
        for (end_m4, within_m) in ENDS_M4.into_iter().zip([1e-6, 1e-3]) {
            let (searched, evaluations) = search(&anchors, &lengths, end_m4)?;
            let (ours_m4, theirs_m4) = (cost.at(&heights_m), cost.at(&searched));
            let apart = heights_m.iter().zip(&searched).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
            ensure!(
                apart < within_m
                    && ours_m4 <= theirs_m4 * (1.0 + 1e-12)
                    && (closed.cost_m4 - ours_m4).abs() < 1e-9 * ours_m4,
                "{what}: closed form {:?} m at a cost of {ours_m4} m⁴, search {searched:?} m at {theirs_m4} m⁴",
                &heights_m[..]
            );
            println!("{what}: the search takes {evaluations} evaluations and ends {apart:.1e} m from the closed form");
        }
        group.bench_function(ours, |bencher| {
            bencher.iter(|| closed_form(black_box(&anchors_xy), black_box(&lengths)));
        });
        group.bench_function(checked, |bencher| {
            bencher.iter(|| calibrate_heights(black_box(&anchors_xy), black_box(&lengths)));
        });
        for (name, end_m4) in [theirs, roughly].into_iter().zip(ENDS_M4) {
            group.bench_function(name, |bencher| {
                bencher.iter(|| search(black_box(&anchors), black_box(&lengths), end_m4));
            });
            report.pair(what, ["calibration", ours], ["calibration", name], 1, Some(100.0));
        }
        report.alone(&format!("{what}, with every check and refusal"), ["calibration", checked], 1);
    }
    group.finish();
    Ok(())
}
