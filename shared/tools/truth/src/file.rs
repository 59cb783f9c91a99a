//! The system file with the world in it.

use command::{Answer, Failure};
use motor_box::section::TruthSection;
use std::fs;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Keys that are paths, with the path that applies if the key is left out.
const PATHS: [(&str, &str, Option<&str>); 4] = [
    ("", "robot", None),
    ("", "runs", Some("../../runs")),
    ("planner", "missions", Some("../missions")),
    ("motor_box", "ground", None),
];

/// Returns the text of the system file with the world, for a file in `folder`.
///
/// # Errors
/// The system file cannot be read, or the world cannot be written as TOML.
pub(crate) fn with_world(system: &Path, world: &TruthSection, folder: &Path) -> Answer<String> {
    let text = fs::read_to_string(system).map_err(Failure::bad)?;
    let mut table: Table = text.parse().map_err(Failure::bad)?;
    let from = absolute(system.parent().unwrap_or(Path::new("")))?;
    if from != absolute(folder)? {
        for (section, key, default) in PATHS {
            make_absolute(&mut table, section, key, default, &from);
        }
        commands_absolute(&mut table, &from);
    }
    let truth = Table::try_from(world).map_err(Failure::not_now)?;
    let motor_box = table.entry("motor_box").or_insert_with(|| Value::Table(Table::new()));
    if let Value::Table(motor_box) = motor_box {
        motor_box.insert("truth".to_owned(), Value::Table(truth));
    }
    let name = system.file_name().unwrap_or_default().to_string_lossy();
    let world = world.name.clone().unwrap_or_default();
    let body = toml::to_string(&table).map_err(Failure::not_now)?;
    Ok(format!("# {name} in a world that is not its model: {world}, drawn by nims truth.\n\n{body}"))
}

fn absolute(path: &Path) -> Answer<PathBuf> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    path.canonicalize()
        .map_err(|error| Failure::BadInput(format!("the folder {} is not usable: {error}", path.display())))
}

fn make_absolute(table: &mut Table, section: &str, key: &str, default: Option<&str>, from: &Path) {
    let into = if section.is_empty() {
        table
    } else {
        let inner = table.entry(section).or_insert_with(|| Value::Table(Table::new()));
        let Value::Table(inner) = inner else { return };
        inner
    };
    let given = into.get(key).and_then(Value::as_str).or(default);
    if let Some(path) = given.map(|path| from.join(path).display().to_string()) {
        into.insert(key.to_owned(), Value::String(path));
    }
}

/// Programs and files of commands start at the folder of the system file.
fn commands_absolute(table: &mut Table, from: &Path) {
    let Some(Value::Array(processes)) = table.get_mut("process") else { return };
    let commands = processes.iter_mut().filter_map(|process| process.get_mut("command")?.as_array_mut());
    for argument in commands.flatten() {
        let path = argument.as_str().map(|text| from.join(text)).filter(|path| path.is_file());
        if let Some(path) = path {
            *argument = Value::String(path.display().to_string());
        }
    }
}

pub(crate) fn write(path: &Path, text: &str) -> Answer {
    fs::write(path, text).map_err(|error| Failure::NotNow(format!("{} cannot be written: {error}", path.display())))
}

pub(crate) fn remove(path: &Path) {
    // The failure that follows matters more.
    let _ = fs::remove_file(path);
}
