//! Small words.

/// A length to the centimetre, or to the millimetre where that says more.
pub fn metres(m: f64) -> String {
    if m < 0.1 { format!("{m:.3} m") } else { format!("{m:.2} m") }
}

/// `a, b and c`.
pub fn joined(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [only] => only.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// Lengths as they are read from the lines.
pub fn listed(lengths_m: &[f64]) -> String {
    let each: Vec<String> = lengths_m.iter().map(|m| format!("{m:.2}")).collect();
    each.join(", ")
}
