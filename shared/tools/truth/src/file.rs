//! The system file with the world in it: its comments and its order stay.

use command::{Answer, Failure};
use motor_box::section::TruthSection;
use std::fs;
use std::path::{Path, PathBuf};
use toml_edit::{DocumentMut, Formatted, Item, Table, Value};

/// Keys that are paths, with the path that applies if the key is left out.
const PATHS: [(&str, &str, Option<&str>); 4] = [
    ("", "robot", None),
    ("", "runs", Some("../../runs")),
    ("planner", "missions", Some("../missions")),
    ("motor_box", "ground", None),
];

/// Significant digits of a drawn number: micrometres of an anchor, and far below any deviation.
const DIGITS: usize = 7;

/// Returns the system file as it has to be written into `folder`: relative paths are absolute, unless it stays in its
/// folder.
///
/// # Errors
/// The system file cannot be read.
pub fn moved(system: &Path, folder: &Path) -> Answer<DocumentMut> {
    let text = fs::read_to_string(system).map_err(Failure::bad)?;
    let mut document: DocumentMut = text.parse().map_err(Failure::bad)?;
    let from = absolute(system.parent().unwrap_or(Path::new("")))?;
    if from != absolute(folder)? {
        for (section, key, default) in PATHS {
            make_absolute(document.as_table_mut(), section, key, default, &from);
        }
        commands_absolute(document.as_table_mut(), &from);
    }
    Ok(document)
}

/// Returns the text of the system file with the world, for a file in `folder`.
///
/// # Errors
/// The system file cannot be read, or the world cannot be written as TOML.
pub(crate) fn with_world(system: &Path, world: &TruthSection, folder: &Path) -> Answer<String> {
    let mut document = moved(system, folder)?;
    let drawn = toml::to_string(world).map_err(Failure::not_now)?;
    let mut drawn: DocumentMut = drawn.parse().map_err(Failure::not_now)?;
    // A world without spread is the model to the last bit.
    if world.seed.is_some() {
        drawn.iter_mut().filter_map(|(_, item)| item.as_value_mut()).for_each(round);
    }
    let mut truth = std::mem::take(drawn.as_table_mut());
    truth.set_position(None);
    let name = world.name.as_deref().unwrap_or_default();
    truth.decor_mut().set_prefix(format!("\n# A world that is not the robot's model: {name}, drawn by nims truth.\n"));
    if let Some(motor_box) = inner(document.as_table_mut(), "motor_box") {
        motor_box.insert("truth", Item::Table(truth));
    }
    Ok(document.to_string())
}

fn absolute(path: &Path) -> Answer<PathBuf> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    path.canonicalize()
        .map_err(|error| Failure::BadInput(format!("the folder {} is not usable: {error}", path.display())))
}

/// The table of a section, which is made if it is not there. `None` if it is something else.
fn inner<'a>(table: &'a mut Table, section: &str) -> Option<&'a mut Table> {
    let item = table.entry(section).or_insert_with(|| Item::Table(Table::new()));
    if item.is_inline_table() {
        // `motor_box = { .. }` in one line.
        *item = std::mem::take(item).into_table().map_or(Item::None, Item::Table);
    }
    item.as_table_mut()
}

fn make_absolute(table: &mut Table, section: &str, key: &str, default: Option<&str>, from: &Path) {
    let Some(table) = (if section.is_empty() { Some(table) } else { inner(table, section) }) else { return };
    let given = table.get(key).and_then(Item::as_str).or(default);
    if let Some(path) = given.map(|path| from.join(path).display().to_string()) {
        match table.get_mut(key).and_then(Item::as_value_mut) {
            Some(value) => replace(value, path),
            None => drop(table.insert(key, toml_edit::value(path))),
        }
    }
}

/// Replaces a text and keeps the comment beside it.
fn replace(value: &mut Value, text: String) {
    let decor = value.decor().clone();
    *value = Value::from(text);
    *value.decor_mut() = decor;
}

/// Programs and files of commands start at the folder of the system file.
fn commands_absolute(table: &mut Table, from: &Path) {
    let Some(processes) = table.get_mut("process").and_then(Item::as_array_of_tables_mut) else { return };
    let commands = processes.iter_mut().filter_map(|process| process.get_mut("command")?.as_array_mut());
    for argument in commands.flat_map(|command| command.iter_mut()) {
        let path = argument.as_str().map(|text| from.join(text)).filter(|path| path.is_file());
        if let Some(path) = path {
            replace(argument, path.display().to_string());
        }
    }
}

/// Rounds every number of a value.
fn round(value: &mut Value) {
    match value {
        Value::Float(number) => {
            let rounded = rounded(*number.value());
            let decor = number.decor().clone();
            *number = Formatted::new(rounded);
            *number.decor_mut() = decor;
        }
        Value::Array(values) => values.iter_mut().for_each(round),
        _ => {}
    }
}

fn rounded(number: f64) -> f64 {
    format!("{number:.digits$e}", digits = DIGITS - 1).parse().unwrap_or(number)
}

/// A written file that takes the place of another once it is put there, and is removed otherwise.
pub(crate) struct Draft {
    out: PathBuf,
    path: PathBuf,
}

impl Draft {
    /// Writes the text beside the file that it is for.
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub(crate) fn write(out: &Path, text: &str) -> Answer<Self> {
        let name = out.file_stem().unwrap_or_default().to_string_lossy();
        let path = out.with_file_name(format!("{name}-draft-{}.toml", std::process::id()));
        fs::write(&path, text).map_err(|error| not_written(out, &error))?;
        Ok(Self { out: out.to_owned(), path })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Puts it into its place, at once.
    ///
    /// # Errors
    /// The place cannot be written to.
    pub(crate) fn put(self) -> Answer {
        fs::rename(&self.path, &self.out).map_err(|error| not_written(&self.out, &error))
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        // After `put` there is none.
        let _ = fs::remove_file(&self.path);
    }
}

fn not_written(path: &Path, error: &std::io::Error) -> Failure {
    Failure::NotNow(format!("{} cannot be written: {error}", path.display()))
}
