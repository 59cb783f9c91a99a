//! The progress of a mission on stderr: a bar in a terminal, otherwise a text line every few seconds.

use indicatif::{ProgressBar, ProgressStyle};
use messages::{PlanStatus, text_of};
use std::io::IsTerminal;

/// Time between two text lines, ns.
const LINE_NS: u64 = 5_000_000_000;

/// Shows the progress of a mission.
pub struct Progress {
    /// `None`: text lines.
    bar: Option<ProgressBar>,
    line_ns: Option<u64>,
    paused: bool,
}

impl Progress {
    /// Begins, in a terminal with an empty bar.
    #[must_use]
    pub fn begin() -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{msg:40} {wide_bar} {percent:>3} %")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(1000).with_style(style)
        });
        Self { bar, line_ns: None, paused: false }
    }

    /// Shows a status of the planner.
    pub fn show(&mut self, plan: &PlanStatus, now_ns: u64) {
        let line = line_of(plan);
        let Some(bar) = &self.bar else {
            let paused = plan.state == PlanStatus::STATE_PAUSED;
            let due = self.line_ns.is_none_or(|shown_ns| now_ns >= shown_ns + LINE_NS);
            // A pause is shown once, whatever it lasts.
            if if paused { !self.paused } else { due } {
                self.line_ns = Some(now_ns);
                eprintln!("{line}, {:.0} %", 100.0 * plan.progress);
            }
            self.paused = paused;
            return;
        };
        bar.set_position((1000.0 * plan.progress) as u64);
        bar.set_message(line);
    }

    /// Removes the bar.
    pub fn end(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}

fn line_of(plan: &PlanStatus) -> String {
    let mission = text_of(&plan.mission);
    let (leg, legs) = (plan.leg, plan.legs);
    let of = if legs > 1 { format!(", leg {leg} of {legs}") } else { String::new() };
    match plan.state {
        PlanStatus::STATE_PAUSED => format!("{mission}{of}, paused; `nims resume` continues"),
        _ => format!("{mission}{of}, {:.0} s left", plan.time_left_s),
    }
}
