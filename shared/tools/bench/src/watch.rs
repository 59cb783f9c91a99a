//! Progress of the measurements, and whether they are to end.

use super::settings::Settings;
use command::{Answer, Failure, StopFlag};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Looks after whoever waits: shows how far it is, and whether it is to end.
pub(crate) struct Watch {
    pub(crate) stop: StopFlag,
    pub(crate) bar: ProgressBar,
    pub(crate) begun: Instant,
}

impl Watch {
    /// Between two looks.
    pub(crate) const LOOK: Duration = Duration::from_millis(50);

    pub(crate) fn new(stop: StopFlag, settings: &Settings) -> Self {
        let all_s: f64 = settings.parts.iter().map(|part| settings.seconds_for(*part)).sum();
        let style = ProgressStyle::with_template("{msg:6} {wide_bar} {percent:>3} %");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        // Without a terminal, the bar draws nothing.
        let bar = ProgressBar::with_draw_target(Some((all_s * 1e3) as u64), ProgressDrawTarget::stderr());
        let bar = bar.with_style(style).with_finish(ProgressFinish::AndClear);
        Self { stop, bar, begun: Instant::now() }
    }

    /// For a thread that is looked after by another.
    pub(crate) fn quiet(stop: StopFlag) -> Self {
        Self { stop, bar: ProgressBar::hidden(), begun: Instant::now() }
    }

    pub(crate) fn stop(&self) -> StopFlag {
        StopFlag::clone(&self.stop)
    }

    pub(crate) fn look(&mut self) {
        self.bar.set_position(self.begun.elapsed().as_millis() as u64);
    }

    pub(crate) fn go_on(&self) -> Answer {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Failure::NotNow("stopped before the end of the measurement".to_owned()));
        }
        Ok(())
    }
}
