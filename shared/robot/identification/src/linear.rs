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

/// Two-stage least squares (instrumental variables): `row x = value`, where the row is noisy and the instruments are
/// not. Noise of a row pulls ordinary least squares away from the truth, however long the record is.
pub(crate) struct Instrumented {
    parts: Vec<(DMatrix<f64>, DMatrix<f64>)>,
    instruments: usize,
    unknowns: usize,
}

impl Instrumented {
    pub fn new(instruments: usize, unknowns: usize) -> Self {
        let part = || (DMatrix::zeros(instruments, instruments), DMatrix::zeros(instruments, unknowns + 1));
        Self { parts: (0..PARTS).map(|_| part()).collect(), instruments, unknowns }
    }

    /// Adds `row x = value` to a part.
    pub fn add(&mut self, part: usize, instruments: &[f64], row: &[f64], value: f64) {
        let (square, cross) = &mut self.parts[part];
        for i in 0..self.instruments {
            for j in 0..self.instruments {
                square[(i, j)] += instruments[i] * instruments[j];
            }
            for (j, other) in row.iter().chain([&value]).enumerate() {
                cross[(i, j)] += instruments[i] * other;
            }
        }
    }

    /// Solution without a part, or of all.
    pub fn solve(&self, without: Option<usize>) -> Option<Vec<f64>> {
        let mut square = DMatrix::zeros(self.instruments, self.instruments);
        let mut cross = DMatrix::zeros(self.instruments, self.unknowns + 1);
        for (part, (one, other)) in self.parts.iter().enumerate() {
            if Some(part) != without {
                square += one;
                cross += other;
            }
        }
        // What of rows and values the instruments explain.
        let explained = cross.transpose() * square.cholesky()?.solve(&cross);
        let matrix = explained.view((0, 0), (self.unknowns, self.unknowns)).into_owned();
        let vector = explained.view((0, self.unknowns), (self.unknowns, 1)).into_owned();
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
    fn noise_of_a_row_does_not_pull_the_solution_where_instruments_are_given() {
        let (mut plain, mut instrumented) = (Equations::new(1), Instrumented::new(1, 1));
        for k in 0..10_000 {
            let known = f64::from(k % 7) - 3.0;
            // As large as what is known, and without a share of it.
            let noisy = known + if k / 7 % 2 == 0 { 2.0 } else { -2.0 };
            plain.add(part_of(k as usize, 10_000), &[noisy], 1.2 * known);
            instrumented.add(part_of(k as usize, 10_000), &[known], &[noisy], 1.2 * known);
        }
        let [plain, found] = [plain.solve(None), instrumented.solve(None)].map(|solved| solved.unwrap()[0]);
        assert!(plain < 0.7 && (found - 1.2).abs() < 0.01, "{plain} {found}");
    }

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
