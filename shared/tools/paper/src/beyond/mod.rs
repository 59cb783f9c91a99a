//! Improvements over the paper, each compared with its method in the same run.

mod joint;
mod lateral;
mod placement;
mod preview;
mod stretch;

pub use joint::joint;
pub use lateral::lateral;
pub use placement::placement;
pub use preview::preview;
pub use stretch::stretch;

fn format_ratio(ratio: f64) -> String {
    format!("{ratio:.1}")
}

/// Returns the range of ratios as text.
fn ratio_range(ratios: &[f64]) -> String {
    let low = ratios.iter().fold(f64::INFINITY, |m: f64, r| m.min(*r));
    let high = ratios.iter().fold(0.0, |m: f64, r| m.max(*r));
    if format_ratio(low) == format_ratio(high) {
        return format!("{} times", format_ratio(low));
    }
    format!("{} to {} times", format_ratio(low), format_ratio(high))
}
