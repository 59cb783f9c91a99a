//! Mission files: a list of legs.

use std::path::Path;

use config::{FileKind, Point};
use config::{file, toml_file};
use robot_state::Reason;
use robot_state::answers::detail;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::pattern::{Adaptive, DwellPoints, Profile, Raster, Transect};

/// Most legs of a mission; a longer one is a scan pattern that belongs in one polyline.
pub const MAX_LEGS: usize = 200;

/// Longest name of a mission, bytes: sentences contain it.
const LONGEST_NAME: usize = 100;

/// Most points of a polyline.
pub const MAX_POINTS: usize = 1000;

/// A mission file as written; lengths in metres, z up. Points are `[x, y, z]`, or `[x, z]` for a planar robot.
///
/// ```
/// let mission = mission::Mission::parse(r#"
/// name = "up and round"
/// speed_m_s = 0.2
/// [[leg]]
/// line = { to_m = [4.8, 3.0, 0.5] }
/// [[leg]]
/// spiral = { rise_m = 1.125, radius_m = 0.60, turns = 4.0 }
/// [[leg]]
/// dwell = { duration_s = 2.0 }
/// "#)?;
/// assert_eq!(mission.leg.len(), 3);
/// # Ok::<(), mission::MissionError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mission {
    /// Name of the mission.
    pub name: String,
    /// Cruise speed of the node for legs without a speed, m/s; default: `planner.speed_m_s` of the system file.
    pub speed_m_s: Option<f64>,
    /// Tangential acceleration, m/s²; default: `planner.acceleration_m_s2` of the system file.
    pub acceleration_m_s2: Option<f64>,
    /// Path of `line` and `polyline` legs: straight lines, parabolas with the least loss in the motors, or paths that
    /// also swing sideways (`lateral`); default line.
    #[serde(default)]
    pub path: PathShape,
    /// Cost of a second beside the losses in the motors in the choice of a sag, W; default 0.
    #[serde(default)]
    pub time_weight_w: f64,
    /// Points are relative to the start of the mission, instead of the origin; default false.
    #[serde(default)]
    pub relative: bool,
    /// The legs, flown in this order; the node comes to rest between them.
    pub leg: Vec<Leg>,
}

/// Shape of the moves of a mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PathShape {
    /// Straight lines.
    #[default]
    Line,
    /// Parabolas with the least loss in the motors.
    Parabola,
    /// Paths that sag and swing sideways for the least loss in the motors; useful with self-locking gears.
    Lateral,
}

/// One `[[leg]]`: exactly one of these keys.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Leg {
    /// A straight line.
    Line(Line),
    /// Straight lines from point to point, at rest at each.
    Polyline(Polyline),
    /// A parabola in a vertical plane.
    Parabola(Parabola),
    /// A spiral that begins in its own axis.
    Spiral(Spiral),
    /// A stay at the present position.
    Dwell(Dwell),
    /// Parallel lines over a rectangle.
    Raster(Raster),
    /// A list of points with a stay at each.
    DwellPoints(DwellPoints),
    /// A straight line with optional stays.
    Transect(Transect),
    /// A straight line up or down.
    Profile(Profile),
    /// Fine lines over the parts of an area that a map marks as worth a second look.
    Adaptive(Adaptive),
}

/// `line = { .. }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Position of the end, m.
    pub to_m: Point,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// `polyline = { .. }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Polyline {
    /// The points one after the other, m.
    pub points_m: Vec<Point>,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// `parabola = { .. }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parabola {
    /// Position of the end, m.
    pub to_m: Point,
    /// Sag below the straight line: µ of (25), 1/m; default: the value with the least loss in the motors.
    pub mu_per_m: Option<f64>,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// `spiral = { .. }`: from the present point, the radius grows from 0 while it rises.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spiral {
    /// Height gained, m; negative descends.
    pub rise_m: f64,
    /// Radius at the end, m.
    pub radius_m: f64,
    /// Turns, counter-clockwise seen from above; negative is clockwise.
    pub turns: f64,
    /// Cruise speed, m/s; less where the curvature asks for it.
    pub speed_m_s: Option<f64>,
}

/// `dwell = { .. }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dwell {
    /// For how long, s.
    pub duration_s: f64,
}

/// A mission file that cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MissionError {
    /// The file cannot be read.
    #[error("mission file {path} cannot be read: {why}; give the path of a TOML file")]
    Unreadable {
        /// Path as given.
        path: String,
        /// Error of the operating system.
        why: String,
    },
    /// The file is not a mission.
    #[error("{0}")]
    Malformed(String),
    /// A value is outside its accepted range.
    #[error("{place}mission \"{mission}\"{}: {key} is {value}; accepted: {accepted}", of_leg(*.leg))]
    Value {
        /// `file, line 3: `, as far as it is known.
        place: String,
        /// Name of the mission.
        mission: String,
        /// Number of the leg, from 1; `None`: a key of the mission itself.
        leg: Option<usize>,
        /// The key.
        key: &'static str,
        /// Its value.
        value: String,
        /// Accepted values.
        accepted: &'static str,
    },
}

impl MissionError {
    /// Returns the answer to a request for this mission: the same one from every process that reads missions.
    #[must_use]
    pub fn reason(&self) -> Reason {
        let why = detail(self);
        match *self {
            Self::Value { leg, key, .. } => Reason::MissionValue { leg, key: detail(key), why },
            Self::Malformed(_) | Self::Unreadable { .. } => Reason::MissionInvalid { why },
        }
    }
}

/// A leg as part of a sentence.
fn of_leg(leg: Option<usize>) -> String {
    leg.map_or_else(String::new, |leg| format!(", leg {leg}"))
}

impl Mission {
    /// Reads and checks a mission file.
    ///
    /// # Errors
    /// One sentence: the file, the line, the key and what is accepted there.
    pub fn read(path: &Path) -> Result<Self, MissionError> {
        Self::read_with_text(path).map(|(mission, _)| mission)
    }

    /// [`Mission::read`], and the text of the file.
    ///
    /// # Errors
    /// As [`Mission::read`].
    pub fn read_with_text(path: &Path) -> Result<(Self, String), MissionError> {
        let text = file::read_text(path)
            .map_err(|why| MissionError::Unreadable { path: path.display().to_string(), why: why.to_string() })?;
        FileKind::Mission.expect_text(path, &text).map_err(|error| MissionError::Malformed(error.to_string()))?;
        let mission = Self::parse(&text).map_err(|error| match error {
            MissionError::Malformed(why) => MissionError::Malformed(format!("{}, {why}", path.display())),
            MissionError::Value { place, mission, leg, key, value, accepted } => {
                let place = match place.is_empty() {
                    true => format!("{}: ", path.display()),
                    false => format!("{}, {place}", path.display()),
                };
                MissionError::Value { place, mission, leg, key, value, accepted }
            }
            unreadable @ MissionError::Unreadable { .. } => unreadable,
        })?;
        Ok((mission, text))
    }

    /// Reads and checks the text of a mission file.
    ///
    /// # Errors
    /// One sentence: the line, the key and what is accepted there.
    pub fn parse(text: &str) -> Result<Self, MissionError> {
        let mission: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].matches('\n').count() + 1);
            let why = error.message().replace('\n', " ");
            MissionError::Malformed(format!("line {line}: {why}"))
        })?;
        mission.checked().map_err(|error| match error {
            MissionError::Value { mission, leg, key, value, accepted, .. } => {
                let way = leg.map_or_else(|| key.to_owned(), |leg| format!("leg.{}.{key}", leg - 1));
                let place = toml_file::line_of(text, &way).map_or_else(String::new, |line| format!("line {line}: "));
                MissionError::Value { place, mission, leg, key, value, accepted }
            }
            other => other,
        })
    }

    /// Returns the mission if every value is valid.
    ///
    /// # Errors
    /// One sentence: the leg, the key and what is accepted there.
    pub fn checked(self) -> Result<Self, MissionError> {
        self.check()?;
        Ok(self)
    }

    fn check(&self) -> Result<(), MissionError> {
        let nowhere = || None;
        if self.name.trim().is_empty() || self.name.len() > LONGEST_NAME {
            let given = if self.name.len() > LONGEST_NAME { "too long" } else { "empty" };
            let named = Self { name: self.name.chars().take(20).collect(), ..self.clone() };
            return Err(named.wrong(nowhere(), "name", given.into(), "a name of at most 100 bytes"));
        }
        if self.leg.is_empty() || self.leg.len() > MAX_LEGS {
            return Err(self.wrong(nowhere(), "leg", format!("there {} times", self.leg.len()), "1 to 200 legs"));
        }
        self.speed(nowhere(), self.speed_m_s)?;
        if let Some(a) = self.acceleration_m_s2 {
            self.range(nowhere(), "acceleration_m_s2", a, 1e-3, 100.0, "0.001 to 100 m/s²")?;
        }
        self.range(nowhere(), "time_weight_w", self.time_weight_w, 0.0, 1e6, "0 to 1e6 W")?;
        self.leg.iter().enumerate().try_for_each(|(i, leg)| self.check_leg(i, leg))
    }

    /// Checks the leg at index `i`.
    fn check_leg(&self, i: usize, leg: &Leg) -> Result<(), MissionError> {
        let here = || Some(i + 1);
        match leg {
            Leg::Line(l) => {
                self.point(here(), "to_m", &l.to_m)?;
                self.speed(here(), l.speed_m_s)?;
            }
            Leg::Polyline(l) => {
                self.points(here(), &l.points_m)?;
                self.speed(here(), l.speed_m_s)?;
            }
            Leg::Parabola(l) => {
                self.point(here(), "to_m", &l.to_m)?;
                if let Some(mu) = l.mu_per_m {
                    self.range(here(), "mu_per_m", mu, -10.0, 10.0, "-10 to 10 per metre")?;
                }
                self.speed(here(), l.speed_m_s)?;
            }
            Leg::Spiral(l) => {
                self.range(here(), "rise_m", l.rise_m, -1000.0, 1000.0, "-1000 to 1000 m")?;
                self.range(here(), "radius_m", l.radius_m, 0.01, 1000.0, "0.01 to 1000 m")?;
                self.range(here(), "turns", l.turns.abs(), 0.01, 1000.0, "0.01 to 1000, or negative for clockwise")?;
                self.speed(here(), l.speed_m_s)?;
            }
            Leg::Dwell(l) => self.stay(here(), "duration_s", l.duration_s)?,
            Leg::Raster(l) => {
                self.point(here(), "corner_m", &l.corner_m)?;
                self.point(here(), "opposite_m", &l.opposite_m)?;
                self.range(here(), "pitch_m", l.pitch_m, 1e-3, 1000.0, "0.001 to 1000 m")?;
                self.range(here(), "overlap", l.overlap, 0.0, 0.9, "0 to 0.9, a share of pitch_m")?;
                self.speed(here(), l.speed_m_s)?;
            }
            Leg::Adaptive(l) => self.adaptive(i, l)?,
            Leg::DwellPoints(l) => {
                self.points(here(), &l.points_m)?;
                self.stay(here(), "duration_s", l.duration_s)?;
                self.speed(here(), l.speed_m_s)?;
            }
            Leg::Transect(l) => {
                self.point(here(), "from_m", &l.from_m)?;
                self.point(here(), "to_m", &l.to_m)?;
                self.steps(here(), l.step_m, l.dwell_s)?;
                self.speed(here(), l.speed_m_s)?;
            }
            Leg::Profile(l) => {
                self.point(here(), "at_m", &l.at_m)?;
                self.range(here(), "rise_m", l.rise_m, -1000.0, 1000.0, "-1000 to 1000 m")?;
                self.steps(here(), l.step_m, l.dwell_s)?;
                self.speed(here(), l.speed_m_s)?;
            }
        }
        Ok(())
    }

    fn wrong(&self, leg: Option<usize>, key: &'static str, value: String, accepted: &'static str) -> MissionError {
        MissionError::Value { place: String::new(), mission: self.name.clone(), leg, key, value, accepted }
    }

    fn range(
        &self,
        leg: Option<usize>,
        key: &'static str,
        value: f64,
        low: f64,
        high: f64,
        accepted: &'static str,
    ) -> Result<(), MissionError> {
        let given = || config::Given(value).to_string();
        if (low..=high).contains(&value) { Ok(()) } else { Err(self.wrong(leg, key, given(), accepted)) }
    }

    fn point(&self, leg: Option<usize>, key: &'static str, point: &Point) -> Result<(), MissionError> {
        let accepted = "[x, y, z] in metres, each within 10 km";
        let point = point.position_m;
        if point.iter().all(|x| x.abs() <= 1e4) {
            return Ok(());
        }
        Err(self.wrong(leg, key, format!("{point:?}"), accepted))
    }

    fn points(&self, leg: Option<usize>, points_m: &[Point]) -> Result<(), MissionError> {
        if points_m.is_empty() || points_m.len() > MAX_POINTS {
            let value = format!("a list of {} points", points_m.len());
            return Err(self.wrong(leg, "points_m", value, "1 to 1000 points"));
        }
        points_m.iter().try_for_each(|p| self.point(leg, "points_m", p))
    }

    fn adaptive(&self, number: usize, l: &Adaptive) -> Result<(), MissionError> {
        let here = || Some(number + 1);
        if number == 0 || self.relative {
            let accepted = "a leg that makes the map before it, and relative = false";
            return Err(self.wrong(here(), "adaptive", "the first leg, or the points are relative".into(), accepted));
        }
        if l.map.is_empty() || l.map.len() > 32 {
            return Err(self.wrong(
                here(),
                "map",
                format!("\"{}\"", l.map),
                "the name of a map, map/NAME without map/",
            ));
        }
        self.point(here(), "corner_m", &l.corner_m)?;
        self.point(here(), "opposite_m", &l.opposite_m)?;
        let (a, b) = (l.corner_m.position_m, l.opposite_m.position_m);
        if a[2] != b[2] || a[0] == b[0] || a[1] == b[1] {
            let accepted = "a corner at the height of corner_m, and elsewhere in x and y";
            return Err(self.wrong(here(), "opposite_m", format!("{b:?}"), accepted));
        }
        self.range(here(), "pitch_m", l.pitch_m, 1e-3, 1000.0, "0.001 to 1000 m")?;
        if let Some(tile_m) = l.tile_m {
            self.range(here(), "tile_m", tile_m, 1e-3, 1000.0, "0.001 to 1000 m")?;
        }
        self.range(here(), "share", l.share, 0.0, 1.0, "0 to 1")?;
        self.range(here(), "least", l.least, 0.0, 1.0, "0 to 1")?;
        self.speed(here(), l.speed_m_s)
    }

    fn stay(&self, leg: Option<usize>, key: &'static str, duration_s: f64) -> Result<(), MissionError> {
        self.range(leg, key, duration_s, 0.0, 86_400.0, "0 to 86400 s")
    }

    fn steps(&self, leg: Option<usize>, step_m: Option<f64>, dwell_s: f64) -> Result<(), MissionError> {
        self.stay(leg, "dwell_s", dwell_s)?;
        step_m.map_or(Ok(()), |step_m| self.range(leg, "step_m", step_m, 1e-3, 1000.0, "0.001 to 1000 m"))
    }

    fn speed(&self, leg: Option<usize>, speed: Option<f64>) -> Result<(), MissionError> {
        match speed {
            Some(v) => self.range(leg, "speed_m_s", v, 1e-3, 100.0, "0.001 to 100 m/s"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"
name = "demo"
speed_m_s = 0.2
[[leg]]
line = { to_m = [1.0, 2.0, 3.0], speed_m_s = 0.1 }
[[leg]]
polyline = { points_m = [[1.0, 2.0, 2.0], [2.0, 2.0, 2.0]] }
[[leg]]
parabola = { to_m = [3.0, 3.0, 2.0], mu_per_m = 0.1 }
[[leg]]
spiral = { rise_m = 1.125, radius_m = 0.60, turns = 4 }
[[leg]]
dwell = { duration_s = 2.0 }
[[leg]]
raster = { corner_m = [1, 1, 1], opposite_m = [2, 2, 1], pitch_m = 0.2, overlap = 0.5, along = "y" }
[[leg]]
dwell_points = { points_m = [[1.5, 1, 1], [1, 1, 1]], duration_s = 3.0 }
[[leg]]
transect = { from_m = [1, 1, 1], to_m = [2, 1, 1], step_m = 0.25, dwell_s = 1.0 }
[[leg]]
profile = { at_m = [1, 1, 2], rise_m = -1.5 }
"#;

    #[test]
    fn every_kind_of_leg_is_read_and_written() {
        let mission = Mission::parse(GOOD).unwrap();
        assert_eq!(mission.leg.len(), 9);
        assert_eq!(Mission::parse(&toml::to_string(&mission).unwrap()).unwrap(), mission);
        assert_eq!(mission.leg[4], Leg::Dwell(Dwell { duration_s: 2.0 }));
        assert!(!mission.relative);
    }

    #[test]
    fn a_wrong_file_is_rejected_in_one_sentence_with_the_place() {
        for (from, to, says) in [
            ("speed_m_s = 0.2", "sped_m_s = 0.2", &["line 3", "sped_m_s", "speed_m_s"][..]),
            ("name = \"demo\"", "", &["name"]),
            ("name = \"demo\"", "name = \" \"", &["line 2", "name", "accepted"]),
            ("dwell = { duration_s = 2.0 }", "dwel = { duration_s = 2.0 }", &["line 13", "dwel", "dwell"]),
            (
                "dwell = { duration_s = 2.0 }",
                "dwell = { duration_s = nan }",
                &["line 13", "leg 5", "duration_s", "NaN", "accepted"],
            ),
            ("duration_s = 2.0", "duration_ms = 2.0", &["line 13", "duration_ms", "duration_s"]),
            ("[1.0, 2.0, 3.0]", "[1.0]", &["line 5", "x, y and z"]),
            ("[1.0, 2.0, 3.0]", "[1.0, inf, 3.0]", &["line 5", "leg 1", "to_m", "inf", "metres"]),
            ("[1.0, 2.0, 3.0]", "[1.0, \"2\", 3.0]", &["line 5", "string"]),
            ("speed_m_s = 0.1", "speed_m_s = -0.1", &["line 5", "leg 1", "speed_m_s", "-0.1"]),
            ("speed_m_s = 0.2", "speed_m_s = 0.0", &["line 3", "speed_m_s is 0"]),
            ("speed_m_s = 0.2", "speed_m_s = 1.7e150", &["line 3", "speed_m_s is 1.7e150;", "0.001 to 100"]),
            (
                "speed_m_s = 0.2",
                "acceleration_m_s2 = 1.7e150",
                &["line 3", "acceleration_m_s2 is 1.7e150;", "100 m/s²"],
            ),
            ("duration_s = 2.0", "duration_s = 1.7e150", &["line 13", "duration_s is 1.7e150;", "86400"]),
            ("rise_m = -1.5", "rise_m = -1.7e150", &["leg 9", "rise_m is -1.7e150;"]),
            ("[[1.0, 2.0, 2.0], [2.0, 2.0, 2.0]]", "[]", &["leg 2", "points_m"]),
            ("radius_m = 0.60", "radius_m = 0.0", &["leg 4", "radius_m"]),
            ("turns = 4", "turns = 0", &["leg 4", "turns"]),
            ("dwell = { duration_s = 2.0 }", "", &["line 12"]),
            ("pitch_m = 0.2", "pitch_m = 0.0", &["leg 6", "pitch_m", "0.001"]),
            ("overlap = 0.5", "overlap = 1.0", &["leg 6", "overlap", "0.9"]),
            ("along = \"y\"", "along = \"north\"", &["line 15", "north", "`x`, `y`"]),
            ("opposite_m = [2, 2, 1], ", "", &["line 15", "opposite_m"]),
            ("[[1.5, 1, 1], [1, 1, 1]]", "[]", &["leg 7", "points_m"]),
            ("step_m = 0.25", "step_m = -1", &["leg 8", "step_m"]),
            ("dwell_s = 1.0", "dwell_s = -1.0", &["line 19", "leg 8", "dwell_s"]),
            ("rise_m = -1.5", "rise_m = nan", &["line 21", "leg 9", "rise_m"]),
            ("name = \"demo\"", "name = ", &["line 2"]),
        ] {
            assert!(GOOD.contains(from));
            let sentence = Mission::parse(&GOOD.replace(from, to)).unwrap_err().to_string();
            for word in says {
                assert!(sentence.contains(word), "{word:?} is not in {sentence:?}");
            }
            assert!(!sentence.contains('\n'));
        }
    }

    /// The sentence begins with the file and the text line of the leg, whatever follows the leg.
    #[test]
    fn a_bad_value_of_a_file_is_named_by_file_line_and_key() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.toml");
        let text = format!("{GOOD}[[leg]]\n\n# back\n[leg.line]\nto_m = [1.0, 2.0, 3.0]\nspeed_m_s = -0.5\n");
        std::fs::write(&path, text).unwrap();
        let sentence = Mission::read(&path).unwrap_err().to_string();
        let start = format!("{}, line 27: mission \"demo\", leg 10: speed_m_s is -0.5; accepted: ", path.display());
        assert!(sentence.starts_with(&start), "{sentence}");
        std::fs::write(&path, "name = 3\n").unwrap();
        let sentence = Mission::read(&path).unwrap_err().to_string();
        assert!(sentence.starts_with(&format!("{}, line 1: ", path.display())), "{sentence}");
    }

    #[test]
    fn a_missing_file_is_named() {
        let sentence = Mission::read(Path::new("no/such.toml")).unwrap_err().to_string();
        assert!(sentence.contains("no/such.toml") && sentence.contains("TOML"));
    }
}
