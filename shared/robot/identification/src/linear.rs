//! Least squares with few unknowns, added up part by part, so that each part can be left out.

use nalgebra::{DMatrix, DVector};

/// Parts of a record for the jackknife: enough for a standard deviation, each longer than any swing.
pub(crate) const PARTS: usize = 10;

/// Normal equations of each part.
pub(crate) struct Equations {
    parts: Vec<(DMatrix<f64>, DVector<f64>)>,
    unknowns: usize,
}

impl Equations {
    pub fn new(unknowns: usize) -> Self {
        let part = || (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        Self { parts: (0..PARTS).map(|_| part()).collect(), unknowns }
    }

    /// Adds `row x = value` to a part.
    pub fn add(&mut self, part: usize, row: &[f64], value: f64) {
        let (matrix, vector) = &mut self.parts[part];
        for i in 0..self.unknowns {
            for j in 0..self.unknowns {
                matrix[(i, j)] += row[i] * row[j];
            }
            vector[i] += row[i] * value;
        }
    }

    /// Solution without a part, or of all.
    pub fn solve(&self, without: Option<usize>) -> Option<Vec<f64>> {
        let mut matrix = DMatrix::zeros(self.unknowns, self.unknowns);
        let mut vector = DVector::zeros(self.unknowns);
        for (part, (one, other)) in self.parts.iter().enumerate() {
            if Some(part) != without {
                matrix += one;
                vector += other;
            }
        }
        let solved = matrix.cholesky()?.solve(&vector);
        solved.iter().all(|value| value.is_finite()).then(|| solved.iter().copied().collect())
    }
}

/// The same number of all parts and without each of them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Spread {
    pub all: f64,
    pub without: [f64; PARTS],
}

impl Spread {
    /// Computes it with a function of the part that is left out.
    pub fn of(compute: impl Fn(Option<usize>) -> Option<f64>) -> Option<Self> {
        let mut without = [0.0; PARTS];
        for (part, value) in without.iter_mut().enumerate() {
            *value = compute(Some(part))?;
        }
        Some(Self { all: compute(None)?, without })
    }

    /// Standard deviation of the jackknife (Efron 1982, (3.10)).
    pub fn sigma(&self) -> f64 {
        let mean = self.without.iter().sum::<f64>() / PARTS as f64;
        let squares = self.without.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>();
        ((PARTS - 1) as f64 / PARTS as f64 * squares).sqrt()
    }
}

/// Part of a sample.
pub(crate) fn part_of(index: usize, count: usize) -> usize {
    (index * PARTS / count.max(1)).min(PARTS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_jackknife_states_the_spread_of_a_mean() {
        // Means of parts are ±1 around 3; their mean has the deviation 1 / sqrt(9).
        let mut equations = Equations::new(1);
        for k in 0..1000 {
            let part = part_of(k, 1000);
            equations.add(part, &[1.0], 3.0 + if part.is_multiple_of(2) { 1.0 } else { -1.0 });
        }
        let spread = Spread::of(|part| Some(equations.solve(part)?[0])).unwrap();
        assert!((spread.all - 3.0).abs() < 1e-12 && (spread.sigma() - 1.0 / 3.0).abs() < 1e-9);
    }
}
