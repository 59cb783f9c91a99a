//! The preview law compared with the paper's law, on the same flights.

use anyhow::{Context, Result};
use cable_control::drive_lag::DriveLag;
use config::{ControlLaw, ControllerSection};
use controller::Law;

use crate::lockstep::{self, Flight, Lockstep};
use crate::scenarios::Case;

/// The drive model that the preview law gets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knowledge {
    /// Heading of its column.
    pub name: &'static str,
    /// Delay and lag as a multiple of the true ones; `None`: identified in flight.
    pub factor: Option<f64>,
    /// Whether the fallback is enabled.
    pub fallback: bool,
}

/// All columns of the comparison.
pub fn all() -> Vec<Knowledge> {
    let known = |name, factor| Knowledge { name, factor: Some(factor), fallback: true };
    vec![
        Knowledge { name: "identified", factor: None, fallback: true },
        known("exact", 1.0),
        known("-10 %", 0.9),
        known("+10 %", 1.1),
        known("-30 %", 0.7),
        known("+30 %", 1.3),
        known("half", 0.5),
        known("double", 2.0),
        Knowledge { name: "half, no fallback", factor: Some(0.5), fallback: false },
        Knowledge { name: "double, no fallback", factor: Some(2.0), fallback: false },
    ]
}

/// Headings of the rows of [`Comparison::row`].
pub const HEADING: &str = "\
|       |          | motor, ms | as identified, ms | lq-endpoint | lq-endpoint rms / preview rms (truth against setpoint), above 1: preview is better |
| robot | mission  | delay/lag | delay/lag         | rms, mm     | identified, exact, -10 %, +10 %, -30 %, +30 %, half, double; half and double without fallback |
|-------|----------|-----------|-------------------|-------------|-------|";

/// One case flown with both laws.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Result with the paper's law.
    pub paper: Flight,
    /// Delay and lag of the drives by a step test.
    pub truth: DriveLag,
    /// Result with the preview law; `None` if the robot stopped itself on the way.
    pub preview: Vec<Option<Flight>>,
}

impl Comparison {
    /// RMS error of the paper's law divided by that of the preview law, truth against setpoint; 0 if the flight was
    /// stopped.
    pub fn ratio(&self, index: usize) -> f64 {
        match self.preview.get(index) {
            Some(Some(flight)) => self.paper.truth.rms_m / flight.truth.rms_m,
            _ => 0.0,
        }
    }

    /// The comparison as a text line.
    pub fn row(&self, case: &Case) -> String {
        let ratios: Vec<String> = (0..self.preview.len()).map(|i| format!("{:5.2}", self.ratio(i))).collect();
        format!(
            "| {:5} | {:8} | {:>4.0}/{:<4.0} | {:>8.1}/{:<8.1} | {:11.3} | {} |",
            case.robot,
            case.mission,
            case.motor_s[0] * 1e3,
            case.motor_s[1] * 1e3,
            self.truth.delay_s() * 1e3,
            self.truth.lag_s() * 1e3,
            self.paper.truth.rms_m * 1e3,
            ratios.join(" "),
        )
    }
}

/// The drives as the preview law identifies them at the start of the mission.
///
/// # Errors
/// If nothing is identified within five seconds.
pub fn identified(case: &Case) -> Result<DriveLag> {
    let mut scenario = case.scenario(true)?;
    scenario.law = law(None, true)?;
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario)?;
    lockstep.zero_and_arm()?;
    lockstep.run(&mission)?;
    for _ in 0..500 {
        lockstep.cycle()?;
        if let Some(controller::Notice::Identified(found)) = lockstep.notice() {
            return Ok(found.lag);
        }
    }
    anyhow::bail!("no model of the drives within five seconds of flight")
}

/// The preview law with or without a model, and with or without the fallback.
///
/// # Errors
/// If the model is out of range.
pub fn law(model: Option<DriveLag>, fallback: bool) -> Result<Law> {
    let section = ControllerSection {
        law: ControlLaw::Preview,
        drive_lag_s: model.map(|model| [model.delay_s(), model.lag_s()]),
        // The test judges the given model, not the identified one.
        identify: model.is_none(),
        misfit_limit: if fallback { ControllerSection::default().misfit_limit } else { f64::INFINITY },
        ..ControllerSection::default()
    };
    Ok(Law::from_section(&section)?)
}

/// Flies a case with the paper's law and with the preview law.
///
/// # Errors
/// If a flight with the paper's law fails.
pub fn compare(case: &Case, knowledge: &[Knowledge]) -> Result<Comparison> {
    let paper = lockstep::fly(case.scenario(true)?).context("with lq-endpoint")?;
    let truth = identified(case)?;
    let mut preview = Vec::new();
    for known in knowledge {
        let mut scenario = case.scenario(true)?;
        scenario.law = law(known.factor.map(|factor| truth.scaled(factor)), known.fallback)?;
        preview.push(lockstep::fly(scenario).ok());
    }
    Ok(Comparison { paper, truth, preview })
}
