//! Kriging of a cell without samples of its own, from the cells with samples around it.

use super::moments::Moments;
use super::spec::GridSpec;

/// Neighbours per octant: the nearest ones, so that no side of a cell is left out.
const PER_OCTANT: usize = 2;
/// Largest number of data: the neighbours and the cell itself.
const MOST: usize = 8 * PER_OCTANT + 1;
/// Shapes of the variogram, see [`shapes`].
const SHAPES: usize = 4;
/// Scales of the variogram, and the ratio of the variance of each to the next: from two of those ratios above the
/// variance of all values down to seven below it.
const SCALES: usize = 10;
const SCALE_RATIO: f64 = 4.0;
const SCALES_ABOVE: i32 = 2;
/// Number of variograms: each shape with each scale.
pub(super) const VARIOGRAMS: usize = SHAPES * SCALES;
/// Constant of the covariance over the largest value of the variogram. Kriging with an unknown mean does not depend on
/// it; it makes the matrix positive definite.
const PLATEAU: f64 = 8.0;
/// Share of the variance that keeps the matrix of a smooth variogram invertible.
const JITTER: f64 = 1e-9;
/// Variograms of less prior weight are left out: they change nothing and take time.
const LEAST_WEIGHT: f64 = 3e-3;
/// Weight of the uniform prior of the variograms, in neighbourhoods.
const UNIFORM: f64 = 0.3;
/// Rounds of expectation and maximization; more change no prior by more than its sampling.
const ROUNDS: usize = 12;

/// Weights of the variograms, which sum to 1.
pub(super) type Weights = [f64; VARIOGRAMS];

/// A cell with samples, as a datum.
#[derive(Debug, Clone, Copy, Default)]
struct Datum {
    /// Mean position from the centre of the estimated cell, cells.
    at: [f64; 2],
    value: f64,
    /// Variance of the value by noise.
    noise: f64,
}

impl Datum {
    fn new(at: [f64; 2], cell: &Moments, noise: f64) -> Self {
        let weight = cell.design[0];
        Self { at, value: cell.values[0] / weight, noise: noise / (weight * cell.share()) }
    }
}

/// Data around a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Neighbours {
    data: [Datum; MOST],
    count: usize,
    /// Distance at which the variograms of one scale have the same value, cells.
    range: f64,
}

/// Where to look for neighbours.
#[derive(Debug, Clone, Copy)]
pub(super) struct Search<'a> {
    pub spec: &'a GridSpec,
    pub moments: &'a [Moments],
    /// Variance of a value of weight 1.
    pub noise: f64,
    /// Largest distance of neighbours, cells.
    pub reach: f64,
    /// Distance at which the variograms of one scale have the same value, cells.
    pub range: f64,
}

/// Values of the variograms of every shape at a distance squared: linear, as a field with edges has it, and three
/// differentiable ones (the Cauchy model with exponent 2) of growing range. They need no function beyond quotient and
/// root, so every processor computes the same bits.
fn shapes(square: f64, range: f64) -> [f64; SHAPES] {
    let cauchy = |ranges: f64| {
        let u = square / (ranges * ranges * range * range);
        // 1 - (1 + u)^-2 without cancellation
        u * (2.0 + u) / ((1.0 + u) * (1.0 + u))
    };
    [square.sqrt(), cauchy(1.0), cauchy(2.5), cauchy(6.0)]
}

/// A cell that was estimated from its neighbours.
pub(super) struct Kriged {
    pub value: f64,
    pub variance: f64,
    /// Distance of the nearest datum, cells.
    pub nearest: f64,
}

impl Search<'_> {
    /// The nearest cells with samples in each octant around a cell, farther than `beyond` cells from its centre;
    /// `None` if there is none.
    pub fn around(&self, at: usize, beyond: f64) -> Option<Neighbours> {
        let (column, row) = ((at % self.spec.columns) as isize, (at / self.spec.columns) as isize);
        let cells = (self.reach + 0.5).ceil() as isize;
        let mut nearest = [[(f64::INFINITY, Datum::default()); PER_OCTANT]; 8];
        let within = |i: isize, count: usize| (i - cells).max(0)..(i + cells + 1).min(count as isize);
        for r in within(row, self.spec.rows) {
            for c in within(column, self.spec.columns) {
                let cell = &self.moments[self.spec.index(c as usize, r as usize)];
                if cell.count == 0 {
                    continue;
                }
                let mean = cell.mean();
                let (x, y) = ((c - column) as f64 + mean[0], (r - row) as f64 + mean[1]);
                let square = x * x + y * y;
                if square > self.reach * self.reach || square <= beyond * beyond {
                    continue;
                }
                let octant = usize::from(x < 0.0) + 2 * usize::from(y < 0.0) + 4 * usize::from(x.abs() < y.abs());
                let mut new = (square, Datum::new([x, y], cell, self.noise));
                for kept in &mut nearest[octant] {
                    if new.0 < kept.0 {
                        std::mem::swap(&mut new, kept);
                    }
                }
            }
        }
        let mut found = Neighbours { data: [Datum::default(); MOST], count: 0, range: self.range };
        nearest.iter().flatten().filter(|(square, _)| square.is_finite()).for_each(|(_, datum)| found.push(*datum));
        (found.count > 0).then_some(found)
    }

    /// Logarithms of the likelihood of every variogram, from the data around a cell with samples and from its own. The
    /// neighbours are farther than `beyond` cells, so that the variogram is judged at such distances too.
    pub fn evidence(&self, at: usize, beyond: f64, unit: f64) -> Option<Weights> {
        let mut data = self.around(at, beyond)?;
        data.push(Datum::new(self.moments[at].mean(), &self.moments[at], self.noise));
        let answers = data.answers(unit, None);
        Some(answers.map(|answer| answer.map_or(f64::NEG_INFINITY, |answer| answer.likelihood)))
    }

    /// Estimates the centre of a cell with all variograms, in the proportion of their posterior weights. The value is
    /// within those of the neighbours.
    pub fn estimate(&self, at: usize, unit: f64, prior: &Weights) -> Option<Kriged> {
        let data = self.around(at, 0.0)?;
        let answers = data.answers(unit, Some(prior));
        let likelihoods = answers.map(|answer| answer.map_or(f64::NEG_INFINITY, |answer| answer.likelihood));
        let weights = posterior(&likelihoods, prior)?;
        let mean = |of: &dyn Fn(&Answer) -> f64| -> f64 {
            weights.iter().zip(&answers).filter_map(|(weight, answer)| Some(weight * of(answer.as_ref()?))).sum()
        };
        let value = mean(&|answer| answer.value);
        let variance = mean(&|answer| answer.variance + (answer.value - value) * (answer.value - value));
        let [low, high] = data.range();
        let within = value.clamp(low, high);
        // what the neighbours do not allow may be true all the same
        let variance = variance + (value - within) * (value - within);
        value.is_finite().then(|| Kriged { value: within, variance, nearest: data.nearest() })
    }
}

impl Neighbours {
    fn push(&mut self, datum: Datum) {
        self.data[self.count] = datum;
        self.count += 1;
    }

    fn data(&self) -> &[Datum] {
        &self.data[..self.count]
    }

    /// Distance of the nearest datum, cells.
    fn nearest(&self) -> f64 {
        let square = self.data().iter().map(|datum| datum.at[0] * datum.at[0] + datum.at[1] * datum.at[1]);
        square.fold(f64::INFINITY, f64::min).sqrt()
    }

    /// Lowest and highest value.
    fn range(&self) -> [f64; 2] {
        let values = self.data().iter().map(|datum| datum.value);
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
    }

    /// What every variogram gives that the prior does not leave out.
    fn answers(&self, unit: f64, prior: Option<&Weights>) -> [Option<Answer>; VARIOGRAMS] {
        let data = self.data();
        let mut apart = [[[0.0; MOST]; MOST]; SHAPES];
        let mut centre = [[0.0; MOST]; SHAPES];
        let mut most = [0.0_f64; SHAPES];
        for (i, a) in data.iter().enumerate() {
            for (j, b) in data[..i].iter().enumerate() {
                let d = [a.at[0] - b.at[0], a.at[1] - b.at[1]];
                for (shape, value) in shapes(d[0] * d[0] + d[1] * d[1], self.range).into_iter().enumerate() {
                    apart[shape][i][j] = value;
                    most[shape] = most[shape].max(value);
                }
            }
            for (shape, value) in shapes(a.at[0] * a.at[0] + a.at[1] * a.at[1], self.range).into_iter().enumerate() {
                centre[shape][i] = value;
                most[shape] = most[shape].max(value);
            }
        }
        let full = shapes(self.range * self.range, self.range);
        std::array::from_fn(|of| {
            if prior.is_some_and(|prior| prior[of] < LEAST_WEIGHT) {
                return None;
            }
            let shape = of / SCALES;
            krige(data, &apart[shape], &centre[shape], PLATEAU * most[shape], scaled(unit, full[shape], of))
        })
    }
}

/// What kriging with one variogram gives.
#[derive(Debug, Clone, Copy)]
struct Answer {
    /// Logarithm of the restricted likelihood: that of the differences of the data.
    likelihood: f64,
    value: f64,
    variance: f64,
}

/// Ordinary kriging at the centre, by a Cholesky factor; `None` if the matrix has none.
fn krige(
    data: &[Datum],
    apart: &[[f64; MOST]; MOST],
    centre: &[f64; MOST],
    plateau: f64,
    variance: f64,
) -> Option<Answer> {
    let mut factor = [[0.0; MOST]; MOST];
    // the factor's inverse times values, ones, and covariances with the centre
    let mut solved = [[0.0; 3]; MOST];
    let mut determinant = 0.0;
    for (i, datum) in data.iter().enumerate() {
        for j in 0..i {
            let known: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            factor[i][j] = (variance * (plateau - apart[i][j]) - known) / factor[j][j];
        }
        let known: f64 = factor[i][..i].iter().map(|of| of * of).sum();
        let pivot = variance * plateau * (1.0 + JITTER) + datum.noise - known;
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        factor[i][i] = pivot.sqrt();
        determinant += libm::log(pivot);
        let right = [datum.value, 1.0, variance * (plateau - centre[i])];
        for (of, right) in right.into_iter().enumerate() {
            let known: f64 = (0..i).map(|k| factor[i][k] * solved[k][of]).sum();
            solved[i][of] = (right - known) / factor[i][i];
        }
    }
    let dot = |a: usize, b: usize| solved[..data.len()].iter().map(|of| of[a] * of[b]).sum::<f64>();
    let (values, ones, covariances) = (0, 1, 2);
    let information = dot(ones, ones);
    let mean = dot(values, ones) / information;
    let short = 1.0 - dot(ones, covariances);
    Some(Answer {
        likelihood: -0.5
            * (determinant + libm::log(information) + (dot(values, values) - dot(values, ones) * mean).max(0.0)),
        value: mean * short + dot(values, covariances),
        variance: (variance * plateau - dot(covariances, covariances) + short * short / information).max(0.0),
    })
}

/// Mean square of the change of the field over a distance in cells, over all variograms.
pub(super) fn change(weights: &Weights, unit: f64, cells: f64, range: f64) -> f64 {
    let (here, full) = (shapes(cells * cells, range), shapes(range * range, range));
    let of = |(of, weight): (usize, &f64)| weight * 2.0 * here[of / SCALES] * scaled(unit, full[of / SCALES], of);
    weights.iter().enumerate().map(of).sum()
}

/// Factor of a variogram's shape whose value at the range is `full`.
fn scaled(unit: f64, full: f64, of: usize) -> f64 {
    unit / full * SCALE_RATIO.powi(SCALES_ABOVE - (of % SCALES) as i32)
}

/// Posterior weights of the variograms from logarithms of their likelihoods; `None` if none is possible.
fn posterior(likelihoods: &Weights, prior: &Weights) -> Option<Weights> {
    let most = likelihoods.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !most.is_finite() {
        return None;
    }
    let mut weights = [0.0; VARIOGRAMS];
    for ((weight, likelihood), prior) in weights.iter_mut().zip(likelihoods).zip(prior) {
        *weight = prior * libm::exp(likelihood - most);
    }
    let sum: f64 = weights.iter().sum();
    (sum > 0.0).then(|| weights.map(|weight| weight / sum))
}

/// Prior weights of the variograms: those that make the evidence of all neighbourhoods likely, by expectation and
/// maximization (empirical Bayes).
pub(super) fn learn(evidence: &[Weights]) -> Weights {
    let mut prior = [1.0 / VARIOGRAMS as f64; VARIOGRAMS];
    for _ in 0..ROUNDS {
        let mut sum = [UNIFORM / VARIOGRAMS as f64; VARIOGRAMS];
        for weights in evidence.iter().filter_map(|likelihoods| posterior(likelihoods, &prior)) {
            sum.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight);
        }
        let all: f64 = sum.iter().sum();
        prior = sum.map(|sum| sum / all);
    }
    prior
}
