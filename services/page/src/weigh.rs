//! The measurements with a known weight for a browser: the questions that `nims setup` asks after a calibration.
//!
//! As for the calibration, the browser keeps the measurements. The robot file is that of the robot that runs.

use crate::scene::Scene;
use crate::setup::MEASUREMENTS;
use cable_robot::STANDARD_GRAVITY;
use serde_json::{Value, json};
use site_calibration::loads::{LoadsFile, LoadsRobot, file_text, judge};
use site_calibration::say;
use site_calibration::setup::captured::UpAndDown;
use site_calibration::setup::guide::{NextStep, Reply, refused, sentence};
use site_calibration::setup::loads::{LoadsGuide, LoadsQuestion};
use std::sync::Arc;

/// Largest number of places and motions: each answer computes all of them again.
const ENTRIES: usize = 40;

/// An answer of a browser, with what is needed to evaluate it.
#[derive(Debug)]
pub(crate) struct Given {
    /// The measurements so far; empty at the beginning.
    pub(crate) measurements: String,
    /// What was typed; `None` asks for the open question only.
    pub(crate) line: Option<String>,
    /// The robot that runs, if its configuration is known.
    pub(crate) scene: Option<Arc<Scene>>,
    /// Where it hangs, m, or why that cannot be used.
    pub(crate) place: Result<[f64; 3], String>,
    /// How it has moved since the weight was said to hang; `None` before.
    pub(crate) motion: Option<UpAndDown>,
}

/// Evaluates an answer; returns what the browser shows next.
///
/// # Errors
/// One sentence: why the measurements cannot be continued.
pub(crate) fn step(given: &Given) -> Result<Value, String> {
    let Some(scene) = &given.scene else {
        return Err(say!("no robot runs whose node could be weighed; start it first"));
    };
    let (robot_name, robot) = (scene.robot_file.0.as_str(), scene.loads.as_ref().map_err(Clone::clone)?);
    let name = format!("{}-loads.toml", robot_name.trim_end_matches(".toml"));
    stepped(&name, robot_name, robot, given)
}

fn stepped(name: &str, robot_name: &str, robot: &LoadsRobot, given: &Given) -> Result<Value, String> {
    let file = read(name, &given.measurements)?;
    let mut guide = LoadsGuide::of_running(file, robot_name, robot.clone()).map_err(|why| format!("{name}: {why}"))?;
    let reply = given.line.as_deref().map(|line| answered(&mut guide, line, given));
    let text = file_text(guide.file(), name).map_err(|error| error.to_string())?;
    let finished = match reply.as_ref().map(|reply| reply.next_step) {
        Some(NextStep::Finish) => Some(finished(robot_name, robot, guide.file())?),
        _ => None,
    };
    let message = reply.as_ref().map_or("", |reply| &reply.message);
    Ok(json!({
        "message": message, "changed": reply.as_ref().is_some_and(|reply| reply.changed),
        "question": guide.question(), "open": open(&guide), "measurements": text, "name": name, "map": null,
        "finished": finished,
    }))
}

fn read(name: &str, text: &str) -> Result<Option<LoadsFile>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    if text.len() > MEASUREMENTS {
        return Err(format!("{name} has more than {} kB; begin again", MEASUREMENTS >> 10));
    }
    let file: LoadsFile =
        config::toml_file::parse(text, name.as_ref()).map_err(|error: config::ConfigError| error.to_string())?;
    if file.sinking.len() + file.weighing.len() > ENTRIES {
        return Err(format!("{name} has more than {ENTRIES} measurements; use `nims loads {name}`"));
    }
    Ok(Some(file))
}

fn answered(guide: &mut LoadsGuide, line: &str, given: &Given) -> Reply {
    if guide.takes_capture(line) {
        return match &given.place {
            Ok(position_m) => guide.capture(*position_m),
            Err(why) => refused(sentence(why)),
        };
    }
    if guide.takes_watch(line) {
        let Some(motion) = &given.motion else {
            return refused(sentence(&say!(
                "no motion counts yet: press the button with which counting begins, and let the node go up and down"
            )));
        };
        return match motion.weighing(guide.motion_kg() * STANDARD_GRAVITY) {
            Ok(weighing) => guide.watched(&weighing),
            Err(why) => refused(sentence(&why)),
        };
    }
    guide.answer(line)
}

/// The robot file that the measurements make.
fn finished(robot_name: &str, robot: &LoadsRobot, file: &LoadsFile) -> Result<Value, String> {
    let (found, made_from) = (judge(file, robot)?, config::file::text_hash(robot.text()));
    let robot = found.renewed.map(|text| json!({ "name": robot_name, "text": text, "made_from": made_from }));
    Ok(json!({ "words": found.words.trim_end(), "calibration": null, "robot": robot }))
}

/// The open question for the drawing of its step.
fn open(guide: &LoadsGuide) -> Value {
    let place = guide.file().sinking.len() + 1;
    match guide.open() {
        // The robot that runs is not asked for.
        LoadsQuestion::Robot | LoadsQuestion::Weight => json!({ "kind": "weight" }),
        LoadsQuestion::Place => json!({ "kind": "hang", "place": place, "optional": true }),
        LoadsQuestion::Sunk => json!({ "kind": "sunk", "place": place }),
        LoadsQuestion::MotionPlace => json!({ "kind": "motion", "optional": true }),
        LoadsQuestion::Up => json!({ "kind": "up", "weight": guide.motion_kg() > 0.0 }),
        LoadsQuestion::Down => json!({ "kind": "down", "weight": guide.motion_kg() > 0.0 }),
        LoadsQuestion::Finish => json!({ "kind": "renew", "optional": true }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::CableVec;
    use config::RobotFile;
    use site_calibration::setup::captured::Moving;

    const LAB3: &str = include_str!("../../../configs/robots/lab3.toml");

    fn lab3() -> LoadsRobot {
        let file: RobotFile = config::toml_file::parse(LAB3, "lab3.toml".as_ref()).unwrap();
        LoadsRobot::new(&file, LAB3.to_owned(), "lab3.toml").unwrap()
    }

    fn given(measurements: &str, line: Option<&str>) -> Given {
        Given {
            measurements: measurements.to_owned(),
            line: line.map(str::to_owned),
            scene: None,
            place: Err("it moves".to_owned()),
            motion: None,
        }
    }

    fn next(given: &Given) -> Result<Value, String> {
        stepped("lab3-loads.toml", "lab3.toml", &lab3(), given)
    }

    /// A motion up and down by 0.4 m at 0.1 m/s, at 20 Hz, four times.
    fn motion(lift_a: f64) -> UpAndDown {
        let mut motion = UpAndDown::default();
        for k in 0..8 * 80 {
            let (way, share) = (if k / 80 % 2 == 0 { 1.0 } else { -1.0 }, f64::from(k % 80) / 80.0);
            let z_m = 0.5 + 0.4 * if way > 0.0 { share } else { 1.0 - share };
            let current_a = CableVec::from_fn(3, |_| lift_a + 0.3 * way);
            motion.take(&Moving { position_m: [4.8, 3.0, z_m], velocity_m_s: [0.0, 0.0, 0.1 * way], current_a });
        }
        motion
    }

    #[test]
    fn a_node_is_weighed_from_answers_and_from_the_robot() {
        let mut text = String::new();
        let mut say = |line: &str, given: Given| {
            let told = next(&Given { measurements: text.clone(), line: Some(line.to_owned()), ..given }).unwrap();
            assert_eq!(told["changed"], true, "{line}: {}", told["message"]);
            text = told["measurements"].as_str().unwrap().to_owned();
            told
        };
        let typed = || given("", None);
        assert_eq!(next(&typed()).unwrap()["open"]["kind"], "weight");
        assert_eq!(say("2 kg", typed())["open"], json!({ "kind": "hang", "place": 1, "optional": true }));
        assert_eq!(say("5.246 6.884 6.855", typed())["open"]["kind"], "sunk");
        say("63,5 mm", typed());
        say("3.840 8.001 7.987", typed());
        say("4.6 cm", typed());
        assert_eq!(say("", typed())["open"]["kind"], "motion");
        let place = Given { place: Ok([4.8, 3.0, 0.7]), ..typed() };
        let asked = say("capture", place);
        assert_eq!(asked["open"], json!({ "kind": "up", "weight": false }));
        let early = next(&given(asked["measurements"].as_str().unwrap(), Some("watch"))).unwrap();
        assert!(early["message"].as_str().unwrap().contains("counting begins"), "{early}");
        let told = say("watch", Given { motion: Some(motion(0.3)), ..typed() });
        assert_eq!(told["open"], json!({ "kind": "up", "weight": true }));
        let told = say("watch", Given { motion: Some(motion(0.9)), ..typed() });
        assert_eq!(told["open"]["kind"], "renew");
        assert!(told["message"].as_str().unwrap().contains("stiffness EA"), "{}", told["message"]);
        let done = next(&given(&text, Some(""))).unwrap();
        let robot: RobotFile =
            config::toml_file::parse(done["finished"]["robot"]["text"].as_str().unwrap(), "x".as_ref()).unwrap();
        assert!(robot.lines.stiffness_n.is_some_and(|n| (n - 6000.0).abs() > 1.0), "{:?}", robot.lines.stiffness_n);
        assert_eq!(done["finished"]["robot"]["name"], "lab3.toml");
    }

    #[test]
    fn what_cannot_be_used_is_told_and_changes_nothing() {
        let begun = next(&given("", Some("2 kg"))).unwrap()["measurements"].as_str().unwrap().to_owned();
        let told = next(&given(&begun, Some("capture"))).unwrap();
        assert_eq!((&told["changed"], &told["message"]), (&json!(false), &json!("It moves.")));
        let other = begun.replace("lab3.toml", "pond.toml");
        for text in ["x", "added_kg = 1\n", &other, &format!("# {}", "x".repeat(MEASUREMENTS))] {
            assert!(next(&given(text, None)).unwrap_err().contains("lab3-loads.toml"));
        }
        assert!(step(&given("", None)).unwrap_err().contains("no robot runs"));
    }
}
