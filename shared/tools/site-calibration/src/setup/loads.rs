//! The questions after a calibration: stiffness of the cables and weight of the node, from a known weight that is hung
//! on the node. No input and output; the state is the file of `nims loads`, and the robot file is read by the caller.

use super::guide::{NextStep, Reply, refused, sentence};
use super::numbers::{self, Bounds, excerpt};
use super::text::listed;
use crate::loads::{self, LoadsFile, LoadsRobot, LoadsSetup, SinkingEntry, WeighingEntry};
use calibration::Weighing;
use config::Point;
use std::path::PathBuf;

/// Accepted weights, kg: what moves a node by more than a ruler's error, and a person.
const WEIGHT_KG: [f64; 2] = [0.05, 200.0];

/// Accepted sinkings: a millimetre on a ruler, and a step.
const SUNK: Bounds = Bounds { least_m: 0.001, most_m: 2.0 };

/// Largest accepted current, A: more than any drive of this size.
const MOST_A: f64 = 100.0;

/// Weighings that are asked for: without and with the weight.
const WEIGHINGS: usize = 2;

/// Places that tell the routed length apart from the stiffness; fewer are accepted.
const PLACES: usize = 4;

/// The open question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoadsQuestion {
    /// The robot file; Enter skips the step.
    Robot,
    /// Mass of the weight.
    Weight,
    /// Place of the next sinking.
    Place,
    /// By how much the node sank there.
    Sunk,
    /// Place of the motion up and down.
    MotionPlace,
    /// Currents upwards.
    Up,
    /// Currents downwards.
    Down,
    /// Whether the result is written.
    Finish,
}

/// The measurements with a weight so far.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadsGuide {
    file: LoadsFile,
    robot: Option<LoadsRobot>,
    /// The robot is that which runs, so it is not asked for.
    is_given: bool,
}

impl LoadsGuide {
    /// Begins the measurements, or continues those of a file, with the robot that it names.
    ///
    /// # Errors
    /// One clause: why the file cannot be continued.
    pub fn new(file: Option<LoadsFile>, robot: Option<LoadsRobot>) -> Result<Self, String> {
        let begun = LoadsFile { setup: Some(LoadsSetup::default()), ..LoadsFile::default() };
        let guide = Self { file: file.unwrap_or(begun), robot, is_given: false };
        if let Some(robot) = &guide.robot {
            guide.file.measurements(robot.robot())?;
        }
        Ok(guide)
    }

    /// Begins or continues the measurements of the robot that runs, whose file has this name.
    ///
    /// # Errors
    /// One clause: why the file cannot be continued.
    pub fn of_running(file: Option<LoadsFile>, name: &str, robot: LoadsRobot) -> Result<Self, String> {
        let guide = Self::new(file, Some(robot))?;
        if !guide.file.robot.as_os_str().is_empty() && guide.file.robot.as_os_str() != name {
            let other = guide.file.robot.display();
            return Err(say!("it is of the robot file {other}, and the robot flies with {name}; begin again"));
        }
        Ok(Self { file: LoadsFile { robot: name.into(), ..guide.file }, is_given: true, ..guide })
    }

    /// The measurements so far.
    pub fn file(&self) -> &LoadsFile {
        &self.file
    }

    /// True if the step was skipped, or not begun.
    pub fn is_skipped(&self) -> bool {
        self.robot.is_none()
    }

    fn progress(&self) -> LoadsSetup {
        self.file.setup.clone().unwrap_or_default()
    }

    /// The open question.
    pub fn open(&self) -> LoadsQuestion {
        let setup = self.progress();
        let placed = setup.position_m.is_some() || !setup.lengths_m.is_empty();
        match () {
            () if self.robot.is_none() => LoadsQuestion::Robot,
            () if self.file.added_kg.is_none() => LoadsQuestion::Weight,
            () if !setup.places_done && placed => LoadsQuestion::Sunk,
            () if !setup.places_done => LoadsQuestion::Place,
            () if setup.motions_done || self.file.weighing.len() >= WEIGHINGS => LoadsQuestion::Finish,
            () if !placed && self.file.weighing.is_empty() => LoadsQuestion::MotionPlace,
            () if setup.up_a.is_empty() => LoadsQuestion::Up,
            () => LoadsQuestion::Down,
        }
    }

    /// Text of the open question.
    pub fn question(&self) -> String {
        match self.open() {
            LoadsQuestion::Robot => say!(
                "A known weight on the node gives the stiffness of the cables and the weight of the node. The robot file must \
                 have this calibration. Which robot file is it (Enter: not now)?"
            ),
            LoadsQuestion::Weight => {
                say!("How heavy is the weight (one to two times the node shows most; like 2 kg or 2000 g)?")
            }
            LoadsQuestion::Place => say!(
                "Place {}: let the node hang still without the weight, at places where the cables are short and where they are long. How \
                 long are the cables there, or capture (Enter: no more places; {PLACES} to 6 are good)?",
                self.file.sinking.len() + 1
            ),
            LoadsQuestion::Sunk => {
                say!("Hang the weight on the node while no winch turns. By how much does the node sink (like 63 mm)?")
            }
            LoadsQuestion::MotionPlace => say!(
                "Let the node go up and down by 0.4 m at one speed, some times. How long are the cables in the middle of \
                 that motion, or capture (Enter: the currents are not measured, so the weight of the node stays unknown)?"
            ),
            LoadsQuestion::Up => {
                let with = if self.file.weighing.is_empty() {
                    say!("without the weight")
                } else {
                    say!("with the weight on it")
                };
                say!(
                    "Up and down {with}: what is the mean current of each motor on the way up, in A, positive where it pulls the cable in? Or \
                     type watch, and let the robot go up and down."
                )
            }
            LoadsQuestion::Down => say!("And on the way down?"),
            LoadsQuestion::Finish => {
                say!("Press Enter to write what is determined into the robot file, or type more for further places:")
            }
        }
    }

    /// Whether this line names the robot file, which the caller reads.
    pub fn takes_robot(&self, line: &str) -> bool {
        let line = line.trim().to_lowercase();
        self.open() == LoadsQuestion::Robot && !["", "undo", "quit", "exit"].contains(&line.as_str())
    }

    /// Takes the robot file, with the path that the measurements name it by.
    pub fn take_robot(&mut self, path: PathBuf, robot: LoadsRobot) -> Reply {
        (self.file.robot, self.robot) = (path, Some(robot));
        reply(String::new(), true, NextStep::Ask)
    }

    /// Whether this line asks for the place at which the running robot hangs.
    pub fn takes_capture(&self, line: &str) -> bool {
        line.trim().eq_ignore_ascii_case("capture")
            && matches!(self.open(), LoadsQuestion::Place | LoadsQuestion::MotionPlace)
    }

    /// Whether this line asks for the currents of the running robot.
    pub fn takes_watch(&self, line: &str) -> bool {
        line.trim().eq_ignore_ascii_case("watch") && self.open() == LoadsQuestion::Up
    }

    /// Weight on the node during the motion that is asked about, kg.
    pub fn motion_kg(&self) -> f64 {
        if self.file.weighing.is_empty() { 0.0 } else { self.file.added_kg.unwrap_or_default() }
    }

    /// Applies a typed line.
    pub fn answer(&mut self, line: &str) -> Reply {
        let line = line.trim();
        let lower = line.to_lowercase();
        match lower.as_str() {
            "quit" | "exit" => return reply(String::new(), false, NextStep::Leave),
            "undo" => {
                return match self.undo() {
                    Some(what) => reply(say!("Taken back: {what}."), true, NextStep::Ask),
                    None => refused(say!("There is no answer to take back.")),
                };
            }
            _ => {}
        }
        match self.open() {
            LoadsQuestion::Robot | LoadsQuestion::Finish if line.is_empty() => {
                return reply(String::new(), false, NextStep::Finish);
            }
            _ => {}
        }
        let before = self.clone();
        match self.apply(line).and_then(|()| self.check()) {
            Ok(()) => reply(self.progress_words(), true, NextStep::Ask),
            Err(why) => {
                *self = before;
                refused(sentence(&why))
            }
        }
    }

    /// Takes the place at which the running robot hangs.
    pub fn capture(&mut self, position_m: [f64; 3]) -> Reply {
        let before = self.clone();
        self.file.setup.get_or_insert_default().position_m = Some(self.point(position_m));
        match self.check() {
            Ok(()) => reply(say!("Captured {} m.", listed(&position_m)), true, NextStep::Ask),
            Err(why) => {
                *self = before;
                refused(sentence(&why))
            }
        }
    }

    /// Takes the mean currents of a motion of the running robot.
    pub fn watched(&mut self, weighing: &Weighing) -> Reply {
        let position_m = Some(self.point(weighing.position_m));
        let added_kg = self.motion_kg();
        let (up_a, down_a) = (weighing.up_a.to_vec(), weighing.down_a.to_vec());
        let said = say!("Up {} A, down {} A.", listed(&up_a), listed(&down_a));
        self.file.weighing.push(WeighingEntry { position_m, lengths_m: Vec::new(), added_kg, up_a, down_a });
        let setup = self.file.setup.get_or_insert_default();
        (setup.position_m, setup.lengths_m) = (None, Vec::new());
        reply(format!("{said}\n{}", self.progress_words()).trim_end().to_owned(), true, NextStep::Ask)
    }

    fn point(&self, position_m: [f64; 3]) -> Point {
        Point { position_m, planar: self.robot.as_ref().is_some_and(|robot| robot.robot().is_planar()) }
    }

    fn apply(&mut self, line: &str) -> Result<(), String> {
        let open = self.open();
        let cables = self.robot.as_ref().map_or(0, |robot| robot.robot().cable_count());
        let setup = self.file.setup.get_or_insert_default();
        match open {
            // The caller reads it.
            LoadsQuestion::Robot => {}
            LoadsQuestion::Weight => self.file.added_kg = Some(weight_kg(line)?),
            LoadsQuestion::Place if line.is_empty() => setup.places_done = true,
            LoadsQuestion::MotionPlace if line.is_empty() => setup.motions_done = true,
            LoadsQuestion::Place | LoadsQuestion::MotionPlace => {
                setup.lengths_m = numbers::lengths(line, numbers::LENGTH)?;
            }
            LoadsQuestion::Sunk => {
                let sunk_m = numbers::small(&say!("the sinking"), line, SUNK)?;
                let (position_m, lengths_m) = (setup.position_m.take(), std::mem::take(&mut setup.lengths_m));
                self.file.sinking.push(SinkingEntry { position_m, lengths_m, added_kg: None, sunk_m });
            }
            LoadsQuestion::Up => setup.up_a = currents_a(line, cables)?,
            LoadsQuestion::Down => {
                let down_a = currents_a(line, cables)?;
                let up_a = std::mem::take(&mut setup.up_a);
                let (mut position_m, mut lengths_m) = (setup.position_m.take(), std::mem::take(&mut setup.lengths_m));
                // Both motions are at the same place.
                if let Some(first) = self.file.weighing.first() {
                    (position_m, lengths_m) = (first.position_m, first.lengths_m.clone());
                }
                let added_kg = self.motion_kg();
                self.file.weighing.push(WeighingEntry { position_m, lengths_m, added_kg, up_a, down_a });
            }
            LoadsQuestion::Finish if line.eq_ignore_ascii_case("more") => {
                (setup.places_done, setup.motions_done) = (false, true);
            }
            LoadsQuestion::Finish => return Err(say!("`{}` is neither Enter nor more", excerpt(line))),
        }
        Ok(())
    }

    /// Refuses measurements that cannot be used, the open place included.
    fn check(&self) -> Result<(), String> {
        let (Some(robot), setup) = (self.robot.as_ref().map(LoadsRobot::robot), self.progress()) else {
            return Ok(());
        };
        if setup.position_m.is_some() || !setup.lengths_m.is_empty() {
            loads::position(setup.position_m.as_ref(), &setup.lengths_m, robot)?;
        }
        self.file.measurements(robot).map(|_| ())
    }

    /// What is determined so far; nothing before the end of the places.
    fn progress_words(&self) -> String {
        if self.open() != LoadsQuestion::Finish {
            return String::new();
        }
        match self.robot.as_ref().map(|robot| loads::judge(&self.file, robot)) {
            Some(Ok(found)) => found.words.trim_end().to_owned(),
            Some(Err(why)) => sentence(&why),
            None => String::new(),
        }
    }

    fn undo(&mut self) -> Option<String> {
        let setup = self.file.setup.get_or_insert_default();
        if std::mem::take(&mut setup.motions_done) {
            return Some(say!("the end of the currents"));
        }
        if !setup.up_a.is_empty() {
            setup.up_a.clear();
            return Some(say!("the currents upwards"));
        }
        if setup.position_m.take().is_some() || !std::mem::take(&mut setup.lengths_m).is_empty() {
            return Some(say!("the place"));
        }
        if self.file.weighing.pop().is_some() {
            return Some(say!("the last motion up and down"));
        }
        if std::mem::take(&mut setup.places_done) {
            return Some(say!("the end of the places"));
        }
        if self.file.sinking.pop().is_some() {
            return Some(say!("place {}", self.file.sinking.len() + 1));
        }
        if self.file.added_kg.take().is_some() {
            return Some(say!("the weight"));
        }
        if self.is_given {
            return None;
        }
        self.robot.take()?;
        self.file.robot = PathBuf::new();
        Some(say!("the robot file"))
    }
}

fn reply(message: String, changed: bool, next_step: NextStep) -> Reply {
    Reply { message, changed, next_step }
}

fn weight_kg(line: &str) -> Result<f64, String> {
    let [least, most] = WEIGHT_KG;
    let lower = line.to_lowercase().replace(',', ".");
    let (number, unit) = match lower.strip_suffix("kg") {
        Some(number) => (number, 1.0),
        None => lower.strip_suffix('g').map_or((lower.as_str(), 1.0), |number| (number, 1e-3)),
    };
    let kg = number.trim().parse::<f64>().ok().map(|number| unit * number).filter(|kg| (least..=most).contains(kg));
    kg.ok_or_else(|| say!("`{}` is not a weight of {least} to {most} kg", excerpt(line)))
}

fn currents_a(line: &str, motors: usize) -> Result<Vec<f64>, String> {
    let decimal = |part: &str| part.trim_end_matches(['A', 'a', ',', ';']).replace(',', ".");
    let read: Vec<Option<f64>> = line.split_whitespace().map(|part| decimal(part).parse().ok()).collect();
    let sound = read.iter().all(|a| a.is_some_and(|a: f64| a.abs() <= MOST_A));
    if read.len() != motors || !sound {
        return Err(say!("`{}` is not one current for each of the {motors} motors, in A", excerpt(line)));
    }
    Ok(read.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::{RobotFile, toml_file};
    use std::path::Path;

    const LAB3: &str = include_str!("../../../../../configs/robots/lab3.toml");

    fn lab3() -> LoadsRobot {
        let file: RobotFile = toml_file::parse(LAB3, Path::new("lab3.toml")).unwrap();
        LoadsRobot::new(&file, LAB3.to_owned(), "lab3.toml").unwrap()
    }

    fn guide() -> LoadsGuide {
        LoadsGuide::new(None, None).unwrap()
    }

    /// What a dialogue does with a line.
    fn typed(guide: &mut LoadsGuide, line: &str) -> Reply {
        if guide.takes_robot(line) { guide.take_robot(line.into(), lab3()) } else { guide.answer(line) }
    }

    /// The measurements of configs/measurements/loads3.toml.
    const TYPED: [&str; 13] = [
        "lab3.toml",
        "2 kg",
        "5.246 6.884 6.855",
        "63,5 mm",
        "3.840 8.001 7.987",
        "4.6 cm",
        "",
        "4.9 6.7 7.1",
        "0.545 0.549 0.566",
        "-0.065 -0.065 -0.063",
        "1,254 1,264 1,308",
        "-0.006 -0.005 -0.001",
        "more",
    ];

    #[test]
    fn typed_measurements_are_those_of_a_file() {
        let mut guide = guide();
        for (k, line) in TYPED.iter().take(12).enumerate() {
            // Every answer is on the disk, and another life continues from it.
            let text = loads::file_text(guide.file(), "site-loads.toml").unwrap();
            let read: LoadsFile = toml_file::parse(&text, Path::new("site-loads.toml")).unwrap();
            assert_eq!(LoadsGuide::new(Some(read), guide.robot.clone()).unwrap(), guide, "before answer {k}");
            let reply = typed(&mut guide, line);
            assert!(reply.changed, "{line}: {}", reply.message);
            if k == 11 {
                assert!(reply.message.contains("stiffness EA") && reply.message.contains("95 %"), "{}", reply.message);
            }
        }
        assert_eq!(guide.open(), LoadsQuestion::Finish);
        let file = guide.file();
        assert_eq!((file.added_kg, file.sinking.len(), file.weighing.len()), (Some(2.0), 2, 2));
        assert_eq!((file.sinking[0].sunk_m, file.weighing[1].added_kg), (0.0635, 2.0));
        assert_eq!(file.weighing[1].lengths_m, [4.9, 6.7, 7.1]);
        assert_eq!(guide.answer("").next_step, NextStep::Finish);
    }

    #[test]
    fn undo_takes_back_every_answer() {
        let mut guide = guide();
        let begun = guide.clone();
        let mut stages = Vec::new();
        for line in TYPED {
            stages.push(guide.open());
            assert!(typed(&mut guide, line).changed, "{line}");
        }
        assert_eq!(guide.open(), LoadsQuestion::Place);
        for _ in 0..40 {
            if !guide.answer("undo").changed {
                break;
            }
        }
        assert_eq!(guide, begun);
        assert!(stages.contains(&LoadsQuestion::MotionPlace) && stages.contains(&LoadsQuestion::Down));
    }

    #[test]
    fn what_cannot_be_used_is_asked_again() {
        let mut guide = guide();
        let refused = |guide: &mut LoadsGuide, line: &str| {
            let (before, reply) = (guide.clone(), guide.answer(line));
            assert!(!reply.changed && *guide == before && reply.next_step == NextStep::Ask, "{line}");
            reply.message
        };
        assert!(!guide.takes_robot(" ") && !guide.takes_robot("undo"));
        assert!(typed(&mut guide, "lab3.toml").changed);
        assert!(refused(&mut guide, "two").contains("two"));
        assert!(refused(&mut guide, "2000 kg").contains("2000"));
        assert!(guide.answer("2000g").changed && guide.file().added_kg == Some(2.0));
        assert!(refused(&mut guide, "5 6").contains('3'));
        assert!(guide.answer("5.246 6.884 6.855").changed);
        assert!(refused(&mut guide, "9 m").contains('9'));
        assert!(guide.answer("63 mm").changed && guide.answer("").changed);
        assert!(guide.takes_capture("Capture") && guide.capture([4.8, 3.0, 0.5]).changed);
        assert!(refused(&mut guide, "0.5 0.5").contains('3'));
        assert!(guide.takes_watch("watch"));
        assert_eq!(guide.answer("quit").next_step, NextStep::Leave);
    }

    #[test]
    fn an_empty_line_skips_the_step() {
        let mut guide = guide();
        assert_eq!(guide.answer(" ").next_step, NextStep::Finish);
        assert!(guide.is_skipped());
    }

    #[test]
    fn the_robot_that_runs_is_neither_asked_for_nor_taken_back() {
        let mut guide = LoadsGuide::of_running(None, "lab3.toml", lab3()).unwrap();
        assert_eq!(guide.open(), LoadsQuestion::Weight);
        assert!(guide.answer("2 kg").changed && guide.answer("undo").changed);
        assert!(!guide.answer("undo").changed && guide.open() == LoadsQuestion::Weight);
        let other = LoadsFile { robot: "pond.toml".into(), ..guide.file().clone() };
        assert!(LoadsGuide::of_running(Some(other), "lab3.toml", lab3()).unwrap_err().contains("pond.toml"));
    }
}
