//! The causes that a record shows for a deviation, as data and as sentences.

use super::events::{EventKind, Events};
use crate::accuracy::Error;
use cable_robot::Robot;
use messages::{CABLES, SLOT_NAMES};
use robot_state::Periods;
use robot_state::answers::without_cure;
use serde::Serialize;

/// Least change of the plan clock's rate that counts.
const RATE: f64 = 0.02;
/// Scale of the commanded velocities below which a limit acted.
const SCALED: f64 = 0.999;
/// Drive output from which the voltage limits the motor.
const FULL_OUTPUT: f64 = 0.98;
/// Share of a tension limit from which a tension is at it.
const AT_LIMIT: f64 = 0.98;
/// Share of the truth's deviation below which that of the estimate does not explain it.
const SEEN: f64 = 0.5;

/// What the setpoint does at a largest deviation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// It does not move.
    Rests,
    /// Its speed grows.
    Accelerates,
    /// Its speed and its direction are constant.
    Cruises,
    /// Its direction changes.
    Turns,
    /// Its speed falls.
    Brakes,
}

impl Phase {
    fn name(self) -> &'static str {
        match self {
            Self::Rests => "rests",
            Self::Accelerates => "accelerates",
            Self::Cruises => "cruises",
            Self::Turns => "turns",
            Self::Brakes => "brakes",
        }
    }
}

/// A change of the slot in charge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Swap {
    /// The slot of the first change.
    pub to: u8,
    /// The slot in charge at the largest deviation: another one if the change was taken back.
    pub at_last: u8,
}

impl Swap {
    fn clause(self, role: &str) -> String {
        let name = |slot: u8| SLOT_NAMES.get(usize::from(slot)).copied().unwrap_or("?");
        let back =
            if self.at_last == self.to { String::new() } else { format!(" and back to slot {}", name(self.at_last)) };
        format!("the {role} in charge changed to slot {}{back}", name(self.to))
    }
}

/// What the record has from shortly before the rise of a deviation to its largest value.
#[derive(Debug, Clone)]
pub struct Rise {
    /// Begin of the rise, s since the start of the run.
    pub begin_s: f64,
    /// Time from which causes count, s.
    pub causes_from_s: f64,
    /// Time of the largest deviation, s.
    pub at_s: f64,
    /// Its control cycle.
    pub cycle: u64,
    /// What the setpoint does then.
    pub phase: Phase,
    /// Deviation of the estimate then, m.
    pub estimate_m: Option<f64>,
    /// Periods by class.
    pub lost: Periods,
    /// Longest time without a cycle, s; 0: none is missing.
    pub silent_s: f64,
    /// motor-io was restarted.
    pub restarted: bool,
    /// Least and greatest rate of the plan clock.
    pub rates: [f64; 2],
    /// The plan clock was to stand still while the setpoint moved.
    pub stops: bool,
    /// Least scale of the commanded velocities.
    pub scale: f64,
    /// Largest cable velocity asked for, over its limit.
    pub saturation: f64,
    /// The law computed with its fallback.
    pub falls_back: bool,
    /// Changes of the slots of controller and estimator.
    pub swaps: [Option<Swap>; 2],
    /// Largest drive output of each cable.
    pub duty: [f64; CABLES],
    /// Least tension of each cable, N.
    pub least_n: [f64; CABLES],
    /// Greatest tension of each cable, N.
    pub greatest_n: [f64; CABLES],
    /// Cables that were slack.
    pub slack: [bool; CABLES],
}

/// A cause in the record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Cause {
    /// `lost`, `pause`, `stop`, `plan-clock`, `saturation`, `voltage`, `tension`, `slack`, `swap`, `fallback`,
    /// `restart`, `fault`, `process`, `request` or `model`.
    pub kind: &'static str,
    /// A clause.
    pub text: String,
}

/// The largest deviation of a leg or of the run with what the record shows while it rose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Explanation {
    /// `estimate` or `truth`.
    pub of: &'static str,
    /// Largest distance from the setpoint, m.
    pub max_m: f64,
    /// When, s since the start of the run.
    pub at_s: f64,
    /// Control cycle.
    pub cycle: u64,
    /// Begin of its rise, s since the start of the run.
    pub rises_from_s: f64,
    /// What the setpoint does then.
    pub setpoint: Phase,
    /// What the record shows in the rise; empty: nothing.
    pub causes: Vec<Cause>,
    /// All of it in one sentence.
    pub sentence: String,
}

/// The deviations of an asked time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Between {
    /// Begin, s since the start of the run.
    pub from_s: f64,
    /// End, s since the start of the run.
    pub to_s: f64,
    /// Error of the estimate from the moving setpoint.
    pub estimate: Option<Error>,
    /// Error of the truth from the moving setpoint.
    pub truth: Option<Error>,
    /// The largest ones with their causes.
    pub deviations: Vec<Explanation>,
}

impl Between {
    /// Creates it from the errors of estimate and truth.
    #[must_use]
    pub fn new([from_s, to_s]: [f64; 2], [estimate, truth]: [Option<Error>; 2], deviations: Vec<Explanation>) -> Self {
        Self { from_s, to_s, estimate, truth, deviations }
    }

    /// Returns a text line for each deviation.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let time = format!("between    {} and {} s", self.from_s, self.to_s);
        let errors = [("estimate", self.estimate), ("truth", self.truth)];
        let line = |explanation: &Explanation| {
            let error = errors.iter().find(|(of, _)| *of == explanation.of).and_then(|(_, error)| *error);
            let rms = error.map_or_else(String::new, |error| format!("{:.1} mm RMS; at most ", 1e3 * error.rms_m));
            format!("{time}: {rms}{}", explanation.sentence)
        };
        match &self.deviations[..] {
            [] => vec![format!("{time}: the setpoint did not move")],
            some => some.iter().map(line).collect(),
        }
    }
}

/// Explains a largest deviation.
pub fn explain(of: &'static str, max_m: f64, rise: &Rise, robot: Option<&Robot>, events: &Events) -> Explanation {
    let mut causes = causes(rise, robot);
    for event in events.causes().filter(|event| (rise.causes_from_s..=rise.at_s).contains(&event.time_s)) {
        let text = event.text.trim_end_matches('.');
        let (kind, text) = match event.kind {
            // The cure only applies during the flight.
            EventKind::Fault => ("fault", text.split(": ").next().unwrap_or(text)),
            EventKind::Process => ("process", text),
            EventKind::Operator => ("request", without_cure(text)),
            EventKind::Mode | EventKind::Mark | EventKind::Mission | EventKind::Log => continue,
        };
        causes.push(Cause { kind, text: text.to_owned() });
    }
    // While cycles are lost, there is no estimate that could see it.
    let seen = rise.lost.unsteered() == 0 && rise.silent_s == 0.0 && of == "truth";
    if let Some(estimate_m) = rise.estimate_m.filter(|estimate_m| seen && *estimate_m < SEEN * max_m) {
        let text = format!("model error, because the estimate is only {:.1} mm from the setpoint", 1e3 * estimate_m);
        causes.push(Cause { kind: "model", text });
    }
    let why = match &causes[..] {
        [] => "no recorded cause".to_owned(),
        some => some.iter().map(|cause| cause.text.as_str()).collect::<Vec<_>>().join("; "),
    };
    let sentence = format!(
        "{:.1} mm from the setpoint ({of}) at {:.2} s, rising since {:.2} s, while the setpoint {}: {why}.",
        1e3 * max_m,
        rise.at_s,
        rise.begin_s,
        rise.phase.name()
    );
    Explanation {
        of,
        max_m,
        at_s: rise.at_s,
        cycle: rise.cycle,
        rises_from_s: rise.begin_s,
        setpoint: rise.phase,
        causes,
        sentence,
    }
}

/// Returns the causes in the samples of the control chain.
fn causes(rise: &Rise, robot: Option<&Robot>) -> Vec<Cause> {
    let mut causes = Vec::new();
    let mut add = |kind: &'static str, text: String| causes.push(Cause { kind, text });
    if rise.lost.unsteered() > 0 {
        add("lost", rise.lost.summary());
    }
    if rise.silent_s > 0.0 {
        add("lost", format!("no cycle ran for {:.3} s", rise.silent_s));
    }
    if rise.lost.paused > 0 {
        add("pause", format!("an operator paused for {} periods", rise.lost.paused));
    }
    if rise.restarted {
        add("restart", "motor-io was restarted".to_owned());
    }
    let [low, high] = rise.rates;
    let changes = high - low > RATE;
    if rise.stops && changes {
        add("stop", format!("the plan clock was braked from {high:.2} to {low:.2} for a stop, a hold or a pause"));
    } else if changes {
        add("plan-clock", format!("the plan clock's rate changed between {low:.2} and {high:.2}"));
    }
    if rise.scale < SCALED {
        let text =
            format!("the commanded velocities were scaled to {:.2} by a velocity or acceleration limit", rise.scale);
        add("saturation", text);
    }
    if rise.saturation > 1.0 {
        add("saturation", format!("the controller asked for {:.2} times a cable's velocity limit", rise.saturation));
    }
    for (role, swap) in ["controller", "estimator"].into_iter().zip(rise.swaps) {
        swap.iter().for_each(|swap| add("swap", swap.clause(role)));
    }
    if rise.falls_back {
        add("fallback", "the law computed with its fallback".to_owned());
    }
    cable_causes(rise, robot, &mut add);
    causes
}

/// Adds the causes of single cables.
fn cable_causes(rise: &Rise, robot: Option<&Robot>, add: &mut impl FnMut(&'static str, String)) {
    let limits_n = robot.map(Robot::tension_limits_n);
    for cable in 0..CABLES {
        let name = cable + 1;
        if rise.duty[cable] >= FULL_OUTPUT {
            add("voltage", format!("the drive of cable {name} was at {:.0} % of its output", 100.0 * rise.duty[cable]));
        }
        if rise.slack[cable] {
            add("slack", format!("cable {name} was slack"));
        }
        let Some([least_n, greatest_n]) = limits_n else { continue };
        let (low_n, high_n) = (rise.least_n[cable], rise.greatest_n[cable]);
        if high_n >= AT_LIMIT * greatest_n {
            add("tension", format!("cable {name} was at {high_n:.1} N, its limit is {greatest_n:.1} N"));
        }
        if low_n <= least_n && !rise.slack[cable] {
            add("tension", format!("cable {name} was at {low_n:.1} N, its least tension is {least_n:.1} N"));
        }
    }
}
