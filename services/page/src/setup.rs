//! The guided calibration of a site for a browser: the questions and the refusals of `nims setup`.
//!
//! The browser keeps the measurements and sends them with each answer, so nothing is stored here, and it goes on after
//! this program or the tablet was restarted.

use messages::MotorState;
use serde_json::{Value, json};
use site_calibration::calibrate::{self, MeasurementsFile};
use site_calibration::robot_file::with_calibration;
use site_calibration::say;
use site_calibration::setup::captured::{self, CapturedLengths, lengths};
use site_calibration::setup::file_text;
use site_calibration::setup::guide::{Guide, NextStep, Reply};
use site_calibration::setup::map::site_map;
use site_calibration::setup::question::Question;

/// Largest measurements file, bytes: 60 points of eight cables have 8 kB.
pub(crate) const MEASUREMENTS: usize = 32 << 10;
/// Largest number of points: more than a site has, because each answer computes all of them again.
const POINTS: usize = 80;
/// Longest name of a site.
const NAME: usize = 32;

/// An answer of a browser, with what is needed to evaluate it.
#[derive(Debug, Clone)]
pub(crate) struct Given {
    /// Name of the site.
    pub(crate) name: String,
    /// The measurements so far; empty at the beginning.
    pub(crate) measurements: String,
    /// What was typed; `None` asks for the open question only.
    pub(crate) line: Option<String>,
    /// Lengths of the robot that runs, or why they cannot be used.
    pub(crate) captured: Result<CapturedLengths, String>,
    /// Name and text of the robot file of the robot that runs.
    pub(crate) robot_file: Option<(String, String)>,
    /// The date of a calibration, UTC.
    pub(crate) date: String,
}

/// The lengths of a robot, as `nims setup` captures them.
///
/// # Errors
/// One sentence: why they cannot be used.
pub(crate) fn captured(state: Option<&MotorState>, counts_per_m: Option<Vec<f64>>) -> Result<CapturedLengths, String> {
    let (Some(state), Some(counts_per_m)) = (state, counts_per_m) else {
        return Err(say!("the robot publishes no lengths; `nims status` says why"));
    };
    lengths(state, counts_per_m)
}

/// The place at which a robot hangs, as `nims setup` captures it.
///
/// # Errors
/// One sentence: why it cannot be used.
pub(crate) fn place(state: Option<&MotorState>, counts_per_m: Option<Vec<f64>>) -> Result<[f64; 3], String> {
    let (Some(state), Some(counts_per_m)) = (state, counts_per_m) else {
        return Err(say!("the robot publishes no position; `nims status` says why"));
    };
    captured::place(state, counts_per_m)
}

/// Evaluates an answer; returns what the browser shows next. It takes up to some seconds.
///
/// # Errors
/// One sentence: why the measurements cannot be continued.
pub(crate) fn step(given: &Given) -> Result<Value, String> {
    let name = given.name.as_str();
    let letters = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if name.is_empty() || name.len() > NAME || !name.chars().all(letters) {
        return Err(say!("`{name}` is no name of a site; use up to {NAME} letters, digits and -"));
    }
    let mut guide = resumed(name, &given.measurements)?;
    let reply = given.line.as_deref().map(|line| answered(&mut guide, line, &given.captured));
    let text = file_text(guide.file(), &format!("{name}.toml")).map_err(|error| error.to_string())?;
    let next = reply.as_ref().map_or(NextStep::Ask, |reply| reply.next_step);
    let finished = match next {
        NextStep::Finish => Some(finished(name, &guide, &text, given)?),
        NextStep::Ask | NextStep::Leave => None,
    };
    let message = reply.as_ref().map_or("", |reply| &reply.message);
    Ok(json!({
        "message": message, "changed": reply.as_ref().is_some_and(|reply| reply.changed),
        "question": guide.question().trim(), "open": open(guide.pending()), "measurements": text,
        "map": site_map(guide.file(), guide.pending()), "finished": finished,
    }))
}

fn resumed(name: &str, text: &str) -> Result<Guide, String> {
    if text.is_empty() {
        return Ok(Guide::default());
    }
    if text.len() > MEASUREMENTS {
        return Err(format!("{name}.toml has more than {} kB; begin a new site", MEASUREMENTS >> 10));
    }
    let path = format!("{name}.toml");
    let file: MeasurementsFile =
        config::toml_file::parse(text, path.as_ref()).map_err(|error: config::ConfigError| error.to_string())?;
    if file.point.len() > POINTS || file.range.len() + file.height.len() + file.tape.len() > POINTS {
        return Err(format!("{path} has more than {POINTS} points; calibrate it with `nims calibrate {path}`"));
    }
    Guide::resume(file).map_err(|why| format!("{path}: {why}"))
}

fn answered(guide: &mut Guide, line: &str, captured: &Result<CapturedLengths, String>) -> Reply {
    let stays = |message: String| Reply { message, changed: false, next_step: NextStep::Ask };
    if guide.takes_capture(line) {
        return match captured {
            Ok(lengths) => guide.capture(lengths),
            Err(why) => stays(format!("{}.", why.trim_end_matches('.'))),
        };
    }
    if guide.takes_touch_down(line) {
        return stays(say!(
            "A touch-down is watched by `nims setup` on the robot; here, set the node down by hand with every cable taut, and type capture."
        ));
    }
    guide.answer(line)
}

/// The files that the measurements become.
fn finished(name: &str, guide: &Guide, text: &str, given: &Given) -> Result<Value, String> {
    let result = calibrate::judge(guide.file(), guide.file().usual_method())?;
    let table = text.parse::<toml::Table>().map_err(|error| error.to_string())?;
    let calibration = calibrate::file_text(&result, table, given.date.clone())?;
    let calibration_name = format!("{name}-calibration.toml");
    let anchors = result.covariance.anchor_count();
    let robot = given.robot_file.as_ref().and_then(|(file, text)| {
        let made_from = config::file::text_hash(text);
        let text = with_calibration(text, &calibration_name).ok()?;
        Some(json!({ "name": file, "text": text, "made_from": made_from }))
    });
    Ok(json!({ "words": result.words, "pulleys": anchors,
        "calibration": { "name": calibration_name, "text": calibration }, "robot": robot }))
}

/// The open question for the drawing of its step.
fn open(question: &Question) -> Value {
    match question {
        Question::Pulleys => json!({ "kind": "pulleys" }),
        Question::Distance { from, to, needed } => {
            json!({ "kind": "distance", "from": from, "to": to, "optional": !needed })
        }
        Question::Side { pulley, from, to } => json!({ "kind": "side", "from": from, "to": to, "pulley": pulley }),
        Question::Height { pulley } => json!({ "kind": "height", "pulley": pulley, "optional": true }),
        Question::ApproximateHeight => json!({ "kind": "about" }),
        Question::PulleyRadius => json!({ "kind": "radius", "optional": true }),
        Question::PulleyTurn => json!({ "kind": "turn" }),
        Question::Points => json!({ "kind": "points", "optional": true }),
        Question::Lengths { place } => json!({ "kind": "lengths", "place": place + 1 }),
        Question::Confirmation { place } => json!({ "kind": "confirm", "place": place + 1, "optional": true }),
        Question::PointDecision { place, doubtful } => {
            json!({ "kind": "decision", "place": place + 1, "point": doubtful.point })
        }
        Question::Tape { cable } => json!({ "kind": "tape", "cable": cable, "optional": true }),
        Question::TapeDecision { .. } => json!({ "kind": "tape-decision", "optional": true }),
        Question::Finish => json!({ "kind": "finish", "optional": true }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(measurements: &str, line: Option<&str>) -> Given {
        Given {
            name: "pond".to_owned(),
            measurements: measurements.to_owned(),
            line: line.map(str::to_owned),
            captured: captured(None, None),
            robot_file: None,
            date: "2026-01-01".to_owned(),
        }
    }

    #[test]
    fn each_answer_continues_from_the_text_alone_and_refusals_are_those_of_the_guide() {
        let first = step(&given("", None)).unwrap();
        assert_eq!((&first["open"]["kind"], &first["message"]), (&json!("pulleys"), &json!("")));
        let wrong = step(&given("", Some("many"))).unwrap();
        assert_eq!((&wrong["changed"], &wrong["open"]["kind"]), (&json!(false), &json!("pulleys")));
        assert_eq!(wrong["message"].as_str().unwrap(), Guide::default().answer("many").message);
        let next = step(&given("", Some("3"))).unwrap();
        let text = next["measurements"].as_str().unwrap();
        assert_eq!(next["open"], json!({ "kind": "distance", "from": 1, "to": 2, "optional": false }));
        let again = step(&given(text, None)).unwrap();
        assert_eq!((&again["question"], &again["measurements"]), (&next["question"], &next["measurements"]));
        let back = step(&given(text, Some("undo"))).unwrap();
        assert_eq!(back["open"]["kind"], "pulleys");
    }

    #[test]
    fn what_is_no_site_is_refused_with_its_name() {
        for name in ["", "../etc", "a b", &"x".repeat(40)] {
            let refused = step(&Given { name: name.to_owned(), ..given("", None) }).unwrap_err();
            assert!(refused.contains("name of a site"), "{refused}");
        }
        let long = format!("# {}", "x".repeat(MEASUREMENTS));
        for text in ["x", "[setup]\npulleys = 9\n", "side = 1\n", &long, "[[point]]\nlengths_m = [1, 2, 3]\n"] {
            let refused = step(&given(text, None)).unwrap_err();
            assert!(refused.contains("pond.toml"), "{refused}");
        }
    }
}
