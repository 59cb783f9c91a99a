//! `nims new-sensor`: writes an example sensor that runs unchanged, as one Python file or as a Rust crate.

use command::{Answer, Failure, Output};
use serde_json::json;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// `nims new-sensor`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the sensor and of its channel sensor/NAME: 1 to 16 of a-z, 0-9, dash.
    pub name: String,
    /// Write a Rust crate instead of one Python file.
    #[arg(long)]
    pub rust: bool,
    /// The sources of nims, for a sensor in Rust. Default: the folder from which this program was built.
    #[arg(long, value_name = "FOLDER", requires = "rust")]
    pub nims: Option<PathBuf>,
}

/// The templates; the tests compile and run them unchanged.
const MANIFEST: &str = include_str!("../../../../scripts/templates/sensor/Cargo.toml");
const MAIN: &str = include_str!("../../../../scripts/templates/sensor/src/main.rs");
const DRIVER: &str = include_str!("../../../../scripts/templates/sensor/src/driver.rs");
const PYTHON: &str = include_str!("../../../../scripts/templates/sensor.py");
/// The Python module that a Python sensor imports.
const PYTHON_MODULE: &str = include_str!("../../../../scripts/python/nims_sensor.py");
/// Path from the Rust template to the libraries of nims.
const SHARED_IN_TEMPLATE: &str = "../../../shared";
/// Longest name, characters; the same as for `nims plug`.
const NAME_MAX: usize = 16;

/// Writes the sensor and returns the commands that build and start it.
///
/// # Errors
/// The name is not valid, a file of that name exists, or the sources of nims are not found.
pub fn new_sensor(asked: &Args) -> Answer<Output> {
    let name = asked.name.as_str();
    let usable = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    if !name.starts_with(|c: char| c.is_ascii_lowercase()) || name.len() > NAME_MAX || !name.bytes().all(usable) {
        return Err(Failure::BadInput(format!(
            "the name is \"{name}\"; accepted: 1 to {NAME_MAX} of a-z, 0-9 and `-`, starting with a letter"
        )));
    }
    let (written, next) = if asked.rust { rust(name, asked.nims.as_deref())? } else { python(name)? };
    let files: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
    let words = format!("wrote {}\nnext, while the robot runs:\n  {}", files.join(", "), next.join("\n  "));
    Ok(Output::new(json!({ "written": files, "next": next }), words))
}

/// Writes a Python file, and beside it the module that it imports, unless that is there.
fn python(name: &str) -> Answer<(Vec<PathBuf>, Vec<String>)> {
    let (file, module) = (PathBuf::from(format!("{name}.py")), PathBuf::from("nims_sensor.py"));
    write_new(&file, &renamed(PYTHON, name))?;
    let mut written = vec![file];
    if !module.exists() {
        write_new(&module, PYTHON_MODULE)?;
        written.push(module);
    }
    let next = vec![
        "nims plug gateway -- gateway    # once; on a control box a service is the gateway".to_owned(),
        format!("nims plug {name} -- python3 {name}.py"),
        format!("nims channel echo sensor/{name}"),
    ];
    Ok((written, next))
}

fn rust(name: &str, nims: Option<&Path>) -> Answer<(Vec<PathBuf>, Vec<String>)> {
    let shared = shared_of(nims)?;
    let folder = PathBuf::from(name);
    if folder.exists() {
        return Err(exists(&folder));
    }
    let manifest = renamed(MANIFEST, name).replace(SHARED_IN_TEMPLATE, &shared.display().to_string());
    let mut written = Vec::new();
    for (path, text) in
        [("Cargo.toml", manifest), ("src/main.rs", renamed(MAIN, name)), ("src/driver.rs", renamed(DRIVER, name))]
    {
        let path = folder.join(path);
        write_new(&path, &text)?;
        written.push(path);
    }
    let next = vec![
        format!("(cd {name} && cargo build)"),
        format!("nims plug {name} -- {name}/target/debug/{name}"),
        format!("nims channel echo sensor/{name}"),
    ];
    Ok((written, next))
}

/// Folder from which this program was built. A package names another one at its build, because its programs do not
/// contain the path of the machine that built it.
const SOURCES: &str = match option_env!("NIMS_SOURCES") {
    Some(folder) => folder,
    None => concat!(env!("CARGO_MANIFEST_DIR"), "/../../.."),
};

/// Returns the folder of the libraries that a Rust sensor depends on: in `nims`, or in the folder from which this
/// program was built.
fn shared_of(nims: Option<&Path>) -> Answer<PathBuf> {
    let root = nims.unwrap_or(Path::new(SOURCES));
    let shared = root.join("shared");
    if !shared.join("runtime/messages/Cargo.toml").is_file() {
        return Err(Failure::BadInput(format!(
            "the sources of nims are not in {}: give their folder with --nims FOLDER, or leave --rust out for a sensor in Python",
            root.display()
        )));
    }
    shared.canonicalize().map_err(Failure::not_now)
}

/// Returns a template with its placeholder names `example` and `Example` replaced.
fn renamed(template: &str, name: &str) -> String {
    let camel: String = name
        .split('-')
        .map(|word| word.chars().take(1).flat_map(char::to_uppercase).chain(word.chars().skip(1)).collect::<String>())
        .collect();
    template.replace("\"example\"", &format!("\"{name}\"")).replace("Example", &camel)
}

fn write_new(path: &Path, text: &str) -> Answer {
    let failed = |error: std::io::Error| Failure::NotNow(format!("{} cannot be written: {error}", path.display()));
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(failed)?;
    }
    match OpenOptions::new().write(true).create_new(true).open(path) {
        Ok(mut file) => file.write_all(text.as_bytes()).map_err(failed),
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => Err(exists(path)),
        Err(error) => Err(failed(error)),
    }
}

fn exists(path: &Path) -> Failure {
    Failure::BadInput(format!("{} already exists and is not overwritten: choose another name", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_replaced_everywhere_in_the_templates() {
        for template in [MANIFEST, MAIN, DRIVER, PYTHON] {
            let text = renamed(template, "soil-probe-2");
            assert!(!text.contains("xample"), "{text}");
        }
        assert!(renamed(MAIN, "soil-probe-2").contains("pub struct SoilProbe2 {"));
        assert!(renamed(PYTHON, "soil").contains("class Soil(Sample)"));
        assert_eq!(MANIFEST.matches(SHARED_IN_TEMPLATE).count(), 2);
    }
}
