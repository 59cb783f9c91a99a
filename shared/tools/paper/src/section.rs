//! A figure or table of the page, and the computation of its verdict.

use plot::Picture;
pub use plot::page::Table;

/// A figure or table of the paper, or an improvement over it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Section {
    /// Name on the command line.
    pub key: &'static str,
    /// Heading.
    pub title: &'static str,
    /// Claim of the paper, paraphrased.
    pub claim: String,
    /// Setup of the computation that replaces the paper's measurement.
    pub stand_in: String,
    /// Tables with computed numbers.
    pub tables: Vec<Table>,
    /// Plots; file names consist of the key and a number.
    pub pictures: Vec<Picture>,
    /// Statements from which the verdict is computed.
    pub checks: Vec<Check>,
    /// Additional remarks.
    pub remarks: Vec<String>,
    /// For an improvement: factor relative to the paper's method.
    pub ratio: Option<String>,
}

/// A statement that the numbers confirm or refute.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// The statement with its numbers.
    pub statement: String,
    /// Whether the numbers confirm it.
    pub held: bool,
    /// Whether it is the claim itself or a condition.
    pub weight: Weight,
}

/// Effect of a failed check on the verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// The claim does not hold.
    Claim,
    /// The claim holds under conditions only.
    Condition,
}

impl Check {
    /// Creates a check of the claim itself.
    pub fn claim(held: bool, statement: String) -> Self {
        Self { statement, held, weight: Weight::Claim }
    }

    /// Creates a check of a condition that limits the claim.
    pub fn condition(held: bool, statement: String) -> Self {
        Self { statement, held, weight: Weight::Condition }
    }
}

/// Verdict on a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// All checks hold.
    Holds,
    /// The claim holds, but a condition fails.
    UnderConditions,
    /// The claim does not hold.
    DoesNotHold,
}

impl Verdict {
    /// Computes the verdict from the checks alone.
    pub fn from_checks(checks: &[Check]) -> Self {
        let fails = |weight| checks.iter().any(|check| check.weight == weight && !check.held);
        if checks.is_empty() || fails(Weight::Claim) {
            Self::DoesNotHold
        } else if fails(Weight::Condition) {
            Self::UnderConditions
        } else {
            Self::Holds
        }
    }

    /// Returns the verdict as text.
    pub fn text(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::UnderConditions => "holds under conditions",
            Self::DoesNotHold => "does not hold",
        }
    }
}

/// Amount of computation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// Full computation for the page.
    Full,
    /// A twentieth of it, for tests.
    Quick,
}

impl Effort {
    /// Returns the number of trials: all, or a twentieth.
    pub fn trials(self, full: usize) -> usize {
        match self {
            Self::Full => full,
            Self::Quick => (full / 20).max(2),
        }
    }

    /// Returns the whole list, or its first, middle and last element.
    pub fn select<T: Copy>(self, all: &[T]) -> Vec<T> {
        match self {
            Self::Full => all.to_vec(),
            Self::Quick if all.len() <= 3 => all.to_vec(),
            Self::Quick => vec![all[0], all[all.len() / 2], all[all.len() - 1]],
        }
    }
}

/// Formats a number with a fixed number of decimals.
pub fn fixed(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$}") } else { "-".to_owned() }
}

/// Returns the mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Returns the standard deviation about the mean.
pub fn deviation(values: &[f64]) -> f64 {
    let m = mean(values);
    (values.iter().map(|v| (v - m) * (v - m)).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Returns the median.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Returns the root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_follows_from_the_checks() {
        let claim = |held| Check::claim(held, String::new());
        let condition = |held| Check::condition(held, String::new());
        assert_eq!(Verdict::from_checks(&[claim(true), condition(true)]), Verdict::Holds);
        assert_eq!(Verdict::from_checks(&[claim(true), condition(false)]), Verdict::UnderConditions);
        assert_eq!(Verdict::from_checks(&[claim(false), condition(true)]), Verdict::DoesNotHold);
        assert_eq!(Verdict::from_checks(&[]), Verdict::DoesNotHold);
    }

    #[test]
    fn statistics() {
        let values = [3.0, -1.0, 4.0];
        assert_eq!((mean(&values), median(&values)), (2.0, 3.0));
        assert!((deviation(&values) - (14.0f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((rms(&values) - (26.0f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!(fixed(f64::NAN, 2), "-");
    }
}
