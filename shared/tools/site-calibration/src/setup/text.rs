//! Formatting of lengths and lists.

/// Formats a length to the centimetre, or below 0.1 m to the millimetre.
pub fn metres(m: f64) -> String {
    if m < 0.1 { format!("{m:.3} m") } else { format!("{m:.2} m") }
}

/// Formats a list as `a, b and c`.
pub fn joined(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [only] => only.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// Formats cable lengths to the centimetre.
pub fn listed(lengths_m: &[f64]) -> String {
    let each: Vec<String> = lengths_m.iter().map(|m| format!("{m:.2}")).collect();
    each.join(", ")
}
