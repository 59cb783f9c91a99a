//! What one figure or table of the page is made of, and how its verdict follows from its numbers.

use plot::Picture;
pub use plot::page::Table;

/// One figure or table of the paper, or one place where we know better.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Section {
    /// Name on the command line.
    pub key: &'static str,
    /// Heading.
    pub title: &'static str,
    /// What the paper says, in our words.
    pub claim: String,
    /// What was computed instead of what the paper measured, with which configuration.
    pub stand_in: String,
    /// Our numbers.
    pub tables: Vec<Table>,
    /// Our pictures; file names are the key and a number.
    pub pictures: Vec<Picture>,
    /// What the verdict rests on.
    pub checks: Vec<Check>,
    /// What else is worth knowing.
    pub remarks: Vec<String>,
    /// For a section beyond the paper: how many times better than the paper's method.
    pub ratio: Option<String>,
}

/// A statement that our numbers confirm or refute.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// The statement, with our numbers in it.
    pub statement: String,
    /// Whether our numbers confirm it.
    pub held: bool,
    /// The claim itself, or a condition under which somebody might expect it.
    pub weight: Weight,
}

/// How much a check counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// Without it the claim does not hold.
    Claim,
    /// Without it the claim holds under conditions only.
    Condition,
}

impl Check {
    /// Part of the claim itself.
    pub fn claim(held: bool, statement: String) -> Self {
        Self { statement, held, weight: Weight::Claim }
    }

    /// A condition that limits the claim where it is not met.
    pub fn condition(held: bool, statement: String) -> Self {
        Self { statement, held, weight: Weight::Condition }
    }
}

/// What our numbers say about a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Everything that was checked.
    Holds,
    /// The claim, but not everywhere.
    UnderConditions,
    /// Not the claim.
    DoesNotHold,
}

impl Verdict {
    /// From checks alone: nobody writes a verdict by hand.
    pub fn of(checks: &[Check]) -> Self {
        let fails = |weight| checks.iter().any(|check| check.weight == weight && !check.held);
        if checks.is_empty() || fails(Weight::Claim) {
            Self::DoesNotHold
        } else if fails(Weight::Condition) {
            Self::UnderConditions
        } else {
            Self::Holds
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::UnderConditions => "holds under conditions",
            Self::DoesNotHold => "does not hold",
        }
    }
}

/// How much is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// For the page.
    Full,
    /// A twentieth of it, to see that everything works.
    Quick,
}

impl Effort {
    /// So many trials, or a twentieth.
    pub fn trials(self, full: usize) -> usize {
        match self {
            Self::Full => full,
            Self::Quick => (full / 20).max(2),
        }
    }

    /// All of a list, or a few of it that keep its first and its last.
    pub fn some<T: Copy>(self, all: &[T]) -> Vec<T> {
        match self {
            Self::Full => all.to_vec(),
            Self::Quick if all.len() <= 3 => all.to_vec(),
            Self::Quick => vec![all[0], all[all.len() / 2], all[all.len() - 1]],
        }
    }
}

/// A number with so many digits after the point.
pub fn fixed(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$}") } else { "-".to_owned() }
}

/// Mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Standard deviation about the mean.
pub fn deviation(values: &[f64]) -> f64 {
    let m = mean(values);
    (values.iter().map(|v| (v - m) * (v - m)).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// The middle value.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Root mean square.
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
        assert_eq!(Verdict::of(&[claim(true), condition(true)]), Verdict::Holds);
        assert_eq!(Verdict::of(&[claim(true), condition(false)]), Verdict::UnderConditions);
        assert_eq!(Verdict::of(&[claim(false), condition(true)]), Verdict::DoesNotHold);
        assert_eq!(Verdict::of(&[]), Verdict::DoesNotHold);
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
