//! Formatting of durations and shares.

/// Formats a duration with three digits and a suitable unit.
#[must_use]
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 0.999_5e-6 => format!("{} ns", digits(s * 1e9)),
        s if s < 0.999_5e-3 => format!("{} µs", digits(s * 1e6)),
        s if s < 0.999_5 => format!("{} ms", digits(s * 1e3)),
        s => format!("{} s", digits(s)),
    }
}

/// Formats a share as a percentage.
#[must_use]
pub fn percent(share: f64) -> String {
    format!("{} %", digits(share * 100.0))
}

/// Formats three digits, or all digits before the decimal point, without trailing zeros.
pub fn digits(value: f64) -> String {
    let decimals = match value {
        value if value >= 99.95 => 0,
        value if value >= 9.995 => 1,
        _ => 2,
    };
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
