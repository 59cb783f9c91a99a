//! Progress bar and stop flag of the measurements.

use super::settings::Settings;
use command::{Answer, Failure, StopFlag};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Progress bar and stop flag.
pub(crate) struct Watch {
    pub(crate) stop: StopFlag,
    pub(crate) bar: ProgressBar,
    pub(crate) begun: Instant,
}

impl Watch {
    /// Interval between two updates of the progress bar.
    pub(crate) const INTERVAL: Duration = Duration::from_millis(50);

    pub(crate) fn new(stop: StopFlag, settings: &Settings) -> Self {
        let all_s: f64 = settings.parts.iter().map(|part| settings.seconds_for(*part)).sum();
        let style = ProgressStyle::with_template("{msg:6} {wide_bar} {percent:>3} %");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        // Without a terminal, the bar draws nothing.
        let bar = ProgressBar::with_draw_target(Some((all_s * 1e3) as u64), ProgressDrawTarget::stderr());
        let bar = bar.with_style(style).with_finish(ProgressFinish::AndClear);
        Self { stop, bar, begun: Instant::now() }
    }

    /// Creates a watch without a progress bar, for a worker thread.
    pub(crate) fn quiet(stop: StopFlag) -> Self {
        Self { stop, bar: ProgressBar::hidden(), begun: Instant::now() }
    }

    pub(crate) fn stop(&self) -> StopFlag {
        StopFlag::clone(&self.stop)
    }

    pub(crate) fn update(&mut self) {
        self.bar.set_position(self.begun.elapsed().as_millis() as u64);
    }

    pub(crate) fn check_stop(&self) -> Answer {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Failure::NotNow("stopped before the end of the measurement".to_owned()));
        }
        Ok(())
    }
}
