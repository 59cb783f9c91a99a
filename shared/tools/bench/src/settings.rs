//! Settings of the benchmark.

use super::args::{Args, Load, Part};
use super::scheduling;
use command::{Answer, Failure};
use config::{ControllerSection, EstimatorSection, RealtimeSection, RecorderSection, SystemFile};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Permitted control rates, Hz.
const RATES_HZ: [f64; 2] = [10.0, 500.0];

/// Fewest wake-ups of a certificate: the 99.99 % quantile then has a hundred later ones.
pub(crate) const CERTIFIED_WAKE_UPS: u64 = 1_000_000;

const DEFAULT_RATE_HZ: f64 = 100.0;

/// Settings of the benchmark.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    pub(crate) parts: BTreeSet<Part>,
    pub(crate) rate_hz: f64,
    pub(crate) seconds: Option<f64>,
    pub(crate) realtime: RealtimeSection,
    pub(crate) controller: ControllerSection,
    pub(crate) estimator: EstimatorSection,
    pub(crate) runs: PathBuf,
    pub(crate) least_bytes: u64,
    pub(crate) flush_s: f64,
    pub(crate) load: Load,
}

impl Default for Settings {
    fn default() -> Self {
        let RecorderSection { min_free_bytes, flush_s, .. } = RecorderSection::default();
        Self {
            parts: Part::ALL.into(),
            rate_hz: DEFAULT_RATE_HZ,
            seconds: None,
            realtime: scheduling::recommended(),
            controller: ControllerSection::default(),
            estimator: EstimatorSection::default(),
            runs: PathBuf::from("."),
            least_bytes: min_free_bytes,
            flush_s,
            load: Load::None,
        }
    }
}

impl Settings {
    pub(crate) fn from_args(args: &Args) -> Answer<Self> {
        let mut settings = Self { seconds: args.seconds, ..Self::default() };
        if !args.parts.is_empty() {
            settings.parts = args.parts.iter().copied().collect();
        }
        if args.certificate.is_some() {
            settings.parts = [Part::Tick].into();
            settings.load = args.load;
        }
        if let Some(path) = &args.system_file {
            let path = std::path::absolute(path).map_err(Failure::bad)?;
            let file = SystemFile::load(&path).map_err(Failure::bad)?;
            settings.rate_hz = file.rate_hz;
            settings.runs = commissioning::doctor::nearest_existing(&file.runs);
            settings.least_bytes = file.recorder.min_free_bytes;
            settings.flush_s = file.recorder.flush_s;
            (settings.realtime, settings.controller, settings.estimator) =
                (file.realtime, file.controller, file.estimator);
        }
        settings.rate_hz = args.rate.unwrap_or(settings.rate_hz);
        if args.certificate.is_some() {
            settings.seconds = args.seconds.or(Some(CERTIFIED_WAKE_UPS as f64 / settings.rate_hz));
        }
        let [least, most] = RATES_HZ;
        if !(least..=most).contains(&settings.rate_hz) {
            return Err(Failure::BadInput(format!(
                "--rate is {} Hz; accepted: {least} to {most} control cycles per second",
                settings.rate_hz
            )));
        }
        if let Some(runs) = &args.runs {
            settings.runs.clone_from(runs);
        }
        Ok(settings)
    }

    pub(crate) fn period_ns(&self) -> u64 {
        (1e9 / self.rate_hz).round() as u64
    }

    /// Returns the duration of a part; by default it gives a thousand ticks at 100 Hz and thousands of other
    /// measurements, enough for the tail.
    pub(crate) fn seconds_for(&self, part: Part) -> f64 {
        self.seconds.unwrap_or(match part {
            Part::Tick => 10.0,
            Part::Bus => 3.0,
            Part::Chain => 2.0,
            Part::Disk => 3.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn default_args() -> Args {
        Args {
            parts: Vec::new(),
            system_file: None,
            rate: None,
            seconds: None,
            runs: None,
            certificate: None,
            load: Load::All,
            beside: false,
        }
    }

    #[test]
    fn all_parts_take_less_than_twenty_seconds_by_default() {
        let settings = Settings::from_args(&default_args()).unwrap();
        assert_eq!(settings.parts, Part::ALL.into());
        assert!(Part::ALL.into_iter().map(|part| settings.seconds_for(part)).sum::<f64>() < 20.0);
        // A thousand ticks, so that the tail differs from the maximum.
        assert!(settings.seconds_for(Part::Tick) * settings.rate_hz >= 1000.0);
        let settings = Settings::from_args(&Args { seconds: Some(0.5), ..default_args() }).unwrap();
        assert!(Part::ALL.into_iter().all(|part| settings.seconds_for(part) == 0.5));
    }

    #[test]
    fn a_certificate_takes_a_million_wake_ups_under_load() {
        let args = Args { certificate: Some("page.html".into()), rate: Some(250.0), ..default_args() };
        let settings = Settings::from_args(&args).unwrap();
        assert_eq!((settings.seconds, settings.load), (Some(4000.0), Load::All));
        assert_eq!(settings.parts, [Part::Tick].into());
        assert_eq!(Settings::from_args(&Args { seconds: Some(3.0), ..args }).unwrap().seconds, Some(3.0));
        assert_eq!(
            Settings::from_args(&default_args()).unwrap().load,
            Load::None,
            "an ordinary benchmark adds no load"
        );
    }

    #[test]
    fn parts_are_measured_once_and_in_order() {
        let parts = vec![Part::Disk, Part::Bus, Part::Disk];
        let settings = Settings::from_args(&Args { parts, ..default_args() }).unwrap();
        assert_eq!(settings.parts.into_iter().collect::<Vec<_>>(), [Part::Bus, Part::Disk]);
    }

    #[test]
    fn only_permitted_rates_are_accepted() {
        for rate in [10.0, 500.0] {
            assert!(Settings::from_args(&Args { rate: Some(rate), ..default_args() }).is_ok());
        }
        for rate in [9.9, 500.1, -100.0, 0.0] {
            let refused = Settings::from_args(&Args { rate: Some(rate), ..default_args() }).unwrap_err();
            assert!(matches!(&refused, Failure::BadInput(said) if said.contains("--rate")), "{refused}");
        }
    }
}
