//! What distinguishes flights: values of the files, and worlds.

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use command::{Answer, Failure};
use config::RobotFile;
use toml_edit::{DocumentMut, Item, Table, Value};

use crate::commands::Commands;
use crate::files;

/// Sections of the robot file. `robot.KEY` is a key of its `[robot]`; the system file has no section of that name.
const ROBOT_SECTIONS: [&str; 4] = ["robot", "lines", "motor", "uncertainty"];
/// Most characters of a folder's name; longer ones are cut off, and the number in front tells them apart.
const LONGEST_NAME: usize = 80;
/// Most worlds of one option.
const MOST_WORLDS: u64 = 10_000;

/// `KEY=VALUE`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assignment {
    /// Key with its section, such as `controller.horizon_cycles`.
    pub key: String,
    /// Value as in TOML; a text may do without quotes.
    pub value: String,
}

/// `KEY=A,B,C`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sweep {
    /// Key with its section.
    pub key: String,
    /// The values.
    pub values: Vec<String>,
}

/// Seeds of drawn worlds: `3`, `1,2,5` or `1..20` with both ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Worlds(pub Vec<u64>);

/// How drawn worlds are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weather {
    /// How far they are from the model.
    pub spread: f64,
    /// Mean wind, m/s.
    pub wind_m_s: f64,
    /// Warming over ten minutes, K.
    pub warming_k: f64,
}

/// One flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Number in the table, from 1.
    pub number: usize,
    /// Values that all flights have.
    common: Vec<Assignment>,
    /// Values that distinguish this flight.
    pub own: Vec<Assignment>,
    /// Those of them that are arguments of its programs.
    pub arguments: Vec<Assignment>,
    /// Its custom programs.
    pub commands: Commands,
    /// A built-in law flies beside its program.
    pub is_beside: bool,
    /// Seed of its world; `None`: that of the system file.
    pub world: Option<u64>,
    weather: Weather,
}

impl FromStr for Assignment {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, value) = text.split_once('=').ok_or("accepted: KEY=VALUE, such as controller.horizon_cycles=20")?;
        Ok(Self { key: key.trim().to_owned(), value: value.trim().to_owned() })
    }
}

impl FromStr for Sweep {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, values) =
            text.split_once('=').ok_or("accepted: KEY=A,B,C, such as controller.law=preview,lq-endpoint")?;
        let values = split(values);
        if values.iter().any(String::is_empty) {
            return Err("accepted: values with commas between them".to_owned());
        }
        Ok(Self { key: key.trim().to_owned(), values })
    }
}

impl FromStr for Worlds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.trim().parse::<u64>().map_err(|_| "accepted: 3, or 1,2,5, or 1..20".to_owned());
        let mut seeds = Vec::new();
        for part in text.split(',') {
            let (first, last) = match part.split_once("..") {
                Some((first, last)) => (number(first)?, number(last)?),
                None => (number(part)?, number(part)?),
            };
            if last < first || last - first >= MOST_WORLDS {
                return Err(format!("accepted: from a seed to a later one, at most {MOST_WORLDS}"));
            }
            seeds.extend(first..=last);
        }
        Ok(Self(seeds))
    }
}

/// Splits at commas outside of brackets and quotes: a value may be a list.
fn split(text: &str) -> Vec<String> {
    let (mut values, mut depth, mut quoted) = (vec![String::new()], 0u32, false);
    for letter in text.chars() {
        match letter {
            '"' => quoted = !quoted,
            '[' | '{' if !quoted => depth += 1,
            ']' | '}' if !quoted => depth = depth.saturating_sub(1),
            _ => {}
        }
        match (values.last_mut(), letter) {
            (_, ',') if depth == 0 && !quoted => values.push(String::new()),
            (Some(value), _) => value.push(letter),
            (None, _) => {}
        }
    }
    values.into_iter().map(|value| value.trim().to_owned()).collect()
}

/// Returns all combinations of the sweeps' values and the worlds, the last one varying fastest.
#[must_use]
pub fn product(common: &[Assignment], sweeps: &[Sweep], seeds: &[u64], weather: Weather) -> Vec<Variant> {
    let mut owns: Vec<Vec<Assignment>> = vec![Vec::new()];
    for sweep in sweeps {
        let with = |own: &Vec<Assignment>, value: &String| {
            let assignment = Assignment { key: sweep.key.clone(), value: value.clone() };
            own.iter().cloned().chain([assignment]).collect()
        };
        owns = owns.iter().flat_map(|own| sweep.values.iter().map(move |value| with(own, value))).collect();
    }
    let worlds: Vec<Option<u64>> =
        if seeds.is_empty() { vec![None] } else { seeds.iter().copied().map(Some).collect() };
    let flights = owns.into_iter().flat_map(|own| worlds.iter().map(move |&world| (own.clone(), world)));
    let numbered = flights.enumerate().map(|(index, (own, world))| Variant {
        number: index + 1,
        common: common.to_vec(),
        own,
        arguments: Vec::new(),
        commands: Commands::default(),
        is_beside: false,
        world,
        weather,
    });
    numbered.collect()
}

impl Variant {
    /// Returns the flight with custom programs, which are `commands` or a part of them. Values of `commands` alone are
    /// not set in the files.
    ///
    /// # Errors
    /// A key in a command has no value.
    pub(crate) fn with_commands(self, commands: &Commands, flown: &Commands) -> Answer<Self> {
        let (arguments, own): (Vec<_>, Vec<_>) = self.own.into_iter().partition(|own| commands.is_argument(&own.key));
        let (common_arguments, common): (Vec<_>, Vec<_>) =
            self.common.into_iter().partition(|set| commands.is_argument(&set.key));
        let all = || arguments.iter().chain(&own).chain(&common_arguments).chain(&common);
        let value = |key: &str| Some(all().find(|set| set.key == key)?.value.clone());
        let commands = flown.filled(value)?;
        Ok(Self { common, own, arguments, commands, ..self })
    }

    /// What distinguishes the flight, such as `law=preview, world 3`.
    #[must_use]
    pub fn name(&self) -> String {
        let world = self.world.map(|seed| format!("world {seed}"));
        let parts: Vec<String> = std::iter::once(self.label()).filter(|label| !label.is_empty()).chain(world).collect();
        if parts.is_empty() { "as configured".to_owned() } else { parts.join(", ") }
    }

    /// What distinguishes the flight from others in the same world; empty if nothing does.
    pub(crate) fn label(&self) -> String {
        let short = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
        let program = self.is_beside.then(|| "program".to_owned());
        let own = self.own.iter().chain(&self.arguments).map(|own| format!("{}={}", short(&own.key), own.value));
        program.into_iter().chain(own).collect::<Vec<_>>().join(", ")
    }

    /// Name of its run folder.
    #[must_use]
    pub fn folder_name(&self) -> String {
        let plain = |letter: char| if letter.is_ascii_alphanumeric() || "=.-".contains(letter) { letter } else { '-' };
        let name: String = self.name().replace(", ", "-").chars().map(plain).take(LONGEST_NAME).collect();
        format!("{:03}-{name}", self.number)
    }

    /// Writes the files into a new folder below `out`, and returns that folder.
    ///
    /// # Errors
    /// The folder exists already, or as [`Variant::write`].
    pub(crate) fn prepare(&self, system: &Path, robot: &Path, out: &Path) -> Answer<PathBuf> {
        let folder = out.join(self.folder_name());
        fs::create_dir_all(out).map_err(|error| files::cannot_write(out, &error))?;
        fs::create_dir(&folder).map_err(|error| files::cannot_write(&folder, &error))?;
        self.write(system, robot, &folder)?;
        Ok(folder)
    }

    /// Writes `system.toml`, and `robot.toml` if a value of it differs, into the folder of the flight. `robot` is the
    /// robot file of the system.
    ///
    /// # Errors
    /// A file cannot be read or written, a key has no section or no effect, or the world is not accepted.
    pub fn write(&self, system: &Path, robot: &Path, folder: &Path) -> Answer<()> {
        let mut document = nims_truth::moved(system, folder)?;
        let (robot_sets, system_sets): (Vec<&Assignment>, Vec<&Assignment>) =
            self.common.iter().chain(&self.own).partition(|set| is_of_robot(&set.key));
        if !robot_sets.is_empty() {
            let text = fs::read_to_string(robot).map_err(Failure::bad)?;
            let mut changed: DocumentMut = text.parse().map_err(Failure::bad)?;
            let file = RobotFile::load(robot).map_err(Failure::bad)?;
            robot_sets.iter().try_for_each(|assignment| has_effect(&file, &robot_sets, assignment))?;
            make_absolute(&mut changed, robot.parent().unwrap_or(Path::new("")), &file);
            robot_sets.into_iter().try_for_each(|assignment| set(changed.as_table_mut(), assignment))?;
            files::write(&folder.join("robot.toml"), changed.to_string())?;
            document.insert("robot", toml_edit::value("robot.toml"));
        }
        system_sets.into_iter().try_for_each(|assignment| set(document.as_table_mut(), assignment))?;
        let path = folder.join("system.toml");
        files::write(&path, document.to_string())?;
        if let Some(seed) = self.world {
            let Weather { spread, wind_m_s, warming_k } = self.weather;
            let out = Some(path.clone());
            nims_truth::run(&nims_truth::Args { system: path, seed, spread, warming: warming_k, wind: wind_m_s, out })?;
        }
        Ok(())
    }
}

/// Returns number and folder of the last flight in `out` that an earlier command flew; `None` without one.
#[must_use]
pub(crate) fn last_flight(out: &Path) -> Option<(usize, PathBuf)> {
    let entries = fs::read_dir(out).ok()?.filter_map(Result::ok).filter(|entry| entry.path().is_dir());
    let numbered = entries.filter_map(|entry| Some((flight_number(entry.file_name().to_str()?)?, entry.path())));
    numbered.max()
}

/// Returns the number of a flight by the name of its folder; `None` for other folders, such as those of real runs.
fn flight_number(name: &str) -> Option<usize> {
    let (number, flight) = name.split_once('-')?;
    let is_flight = number.len() >= 3 && flight.starts_with(|first: char| !first.is_ascii_digit());
    number.parse().ok().filter(|_| is_flight)
}

fn is_of_robot(key: &str) -> bool {
    key.split_once('.').is_some_and(|(section, _)| ROBOT_SECTIONS.contains(&section))
}

/// Sets one value; sections that are not there are made.
fn set(table: &mut Table, Assignment { key, value }: &Assignment) -> Answer<()> {
    let mut parts: Vec<&str> = key.split('.').collect();
    let last = parts.pop().unwrap_or_default();
    let wrong = |why: &str| Failure::BadInput(format!("{key} {why}, such as controller.horizon_cycles"));
    if last.is_empty() || parts.iter().any(|part| part.is_empty()) {
        return Err(wrong("is no key; accepted: keys with their sections"));
    }
    let mut table = table;
    for part in parts {
        let inner = table.entry(part).or_insert_with(|| Item::Table(Table::new())).as_table_mut();
        table = inner.ok_or_else(|| wrong("is inside of something that is no section; accepted: keys of sections"))?;
    }
    // What is no value of TOML is a text without its quotes.
    let value: Value = value.parse().unwrap_or_else(|_| Value::from(value.as_str()));
    table.insert(last, Item::Value(value));
    Ok(())
}

/// Refuses a value that the identified file of the robot replaces: all flights would be alike.
fn has_effect(file: &RobotFile, all: &[&Assignment], Assignment { key, .. }: &Assignment) -> Answer {
    let is_another = all.iter().any(|set| set.key == "robot.identified");
    match &file.robot.identified {
        Some(identified) if !is_another && file.replaced.iter().any(|one| one.key == key) => {
            Err(Failure::BadInput(format!(
                "{key} has no effect, because {} takes its place; delete that key there, or set another one",
                identified.display()
            )))
        }
        _ => Ok(()),
    }
}

/// The files that a robot file names stay where they are.
fn make_absolute(robot: &mut DocumentMut, folder: &Path, file: &RobotFile) {
    let absolute = |path: PathBuf| std::path::absolute(&path).unwrap_or(path).display().to_string();
    let mut resolved = file.named_files(folder).into_iter().map(absolute);
    for (dotted, named) in file.names_of_files() {
        let paths: Vec<String> = resolved.by_ref().take(named.len()).collect();
        let Some((section, key)) = dotted.split_once('.') else { continue };
        match robot.get_mut(section).and_then(|section| section.get_mut(key)).and_then(Item::as_value_mut) {
            Some(Value::Array(listed)) => *listed = paths.into_iter().collect(),
            Some(value) => *value = Value::from(paths.concat()),
            None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALM: Weather = Weather { spread: 1.0, wind_m_s: 0.0, warming_k: 0.0 };

    #[test]
    fn every_combination_is_flown_once() {
        let sweeps: Vec<Sweep> = ["a.b=1,2", "c.d=[1, 2],[3, 4],x"].iter().map(|text| text.parse().unwrap()).collect();
        let variants = product(&[], &sweeps, &[7, 8], CALM);
        let names: Vec<String> = variants.iter().map(Variant::name).collect();
        assert_eq!(names.len(), 12);
        assert_eq!(names[0], "b=1, d=[1, 2], world 7");
        assert_eq!(names[11], "b=2, d=x, world 8");
        let folders: std::collections::BTreeSet<String> = variants.iter().map(Variant::folder_name).collect();
        assert_eq!(folders.len(), 12);
        assert!(folders.iter().all(|name| !name.contains(['/', ' ', '['])), "{folders:?}");
        assert_eq!(product(&[], &[], &[], CALM).len(), 1);
    }

    #[test]
    fn flights_of_an_earlier_command_are_found_by_their_numbers() {
        let out = tempfile::tempdir().unwrap();
        assert_eq!(last_flight(&out.path().join("nothing")), None);
        for name in ["sim.json", "001-as-configured", "1000-world-7", "02-other", "2026-05-04T09-30-00Z-demo3"] {
            fs::create_dir(out.path().join(name)).unwrap();
        }
        fs::write(out.path().join("2000-a-file"), "").unwrap();
        assert_eq!(last_flight(out.path()), Some((1000, out.path().join("1000-world-7"))));
    }

    #[test]
    fn seeds_are_numbers_and_ranges() {
        assert_eq!("1..3,9".parse::<Worlds>(), Ok(Worlds(vec![1, 2, 3, 9])));
        for wrong in ["", "x", "3..1", "0..99999", "1..", "-1"] {
            assert!(wrong.parse::<Worlds>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn values_are_set_where_they_belong() {
        let mut document: DocumentMut = "name = \"a\"\n[controller]\n# why\nlaw = \"x\"\n".parse().unwrap();
        for text in ["controller.law=preview", "controller.gains=[1, 2]", "motor_box.truth.gust_m_s=2.0", "rate_hz=50"]
        {
            set(document.as_table_mut(), &text.parse().unwrap()).unwrap();
        }
        let text = document.to_string();
        for line in ["law = \"preview\"", "gains = [1, 2]", "gust_m_s = 2.0", "rate_hz = 50"] {
            assert!(text.contains(line), "{text}");
        }
        for wrong in ["controller.=1", ".law=1", "name.first=1"] {
            assert!(set(document.as_table_mut(), &wrong.parse().unwrap()).is_err(), "{wrong}");
        }
        assert!(is_of_robot("robot.node_mass_kg") && is_of_robot("lines.mass_kg_m") && !is_of_robot("robot"));
        assert!(!is_of_robot("motor_io.watchdog_s") && !is_of_robot("controller.law"));
    }
}
