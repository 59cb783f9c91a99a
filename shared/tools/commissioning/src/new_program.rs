//! `nims new-sensor`, `nims new-law`, `nims new-estimator`: write an example that runs unchanged, as one Python file or
//! as a Rust crate.

use command::{Answer, Failure, Output};
use serde_json::json;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The arguments of all these commands.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the program, and of a sensor's channel sensor/NAME: 1 to 16 of a-z, 0-9, dash.
    pub name: String,
    /// Write one Python file; the default.
    #[arg(long, conflicts_with = "rust")]
    pub python: bool,
    /// Write a Rust crate instead.
    #[arg(long)]
    pub rust: bool,
    /// The sources of nims, for a crate. Default: the folder from which this program was built.
    #[arg(long, value_name = "FOLDER", requires = "rust")]
    pub nims: Option<PathBuf>,
}

/// What can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A sensor.
    Sensor,
    /// A control law.
    Law,
    /// An estimator.
    Estimator,
}

/// The files of an example; the tests compile and run them unchanged.
struct Template {
    /// Its name in file names and texts, and in names of Rust.
    placeholder: [&'static str; 2],
    /// The Python file.
    python: &'static str,
    /// The Python modules that it imports.
    modules: &'static [(&'static str, &'static str)],
    /// The files of the crate.
    files: &'static [(&'static str, &'static str)],
}

const SENSOR: Template = Template {
    placeholder: ["example", "Example"],
    python: include_str!("../../../../scripts/templates/sensor.py"),
    modules: &[("nims_sensor.py", include_str!("../../../../scripts/python/nims_sensor.py"))],
    files: &[
        ("Cargo.toml", include_str!("../../../../scripts/templates/sensor/Cargo.toml")),
        ("src/main.rs", include_str!("../../../../scripts/templates/sensor/src/main.rs")),
        ("src/driver.rs", include_str!("../../../../scripts/templates/sensor/src/driver.rs")),
    ],
};
const LAW: Template = Template {
    placeholder: ["my-law", "MyLaw"],
    python: include_str!("../../../../scripts/templates/law.py"),
    modules: &[("nims_law.py", include_str!("../../../../scripts/python/nims_law.py"))],
    files: &[
        ("Cargo.toml", include_str!("../../../../scripts/templates/law/Cargo.toml")),
        ("README.md", include_str!("../../../../scripts/templates/law/README.md")),
        ("src/main.rs", include_str!("../../../../scripts/templates/law/src/main.rs")),
        ("src/law.rs", include_str!("../../../../scripts/templates/law/src/law.rs")),
    ],
};
const ESTIMATOR: Template = Template {
    placeholder: ["my-estimator", "MyEstimator"],
    python: include_str!("../../../../scripts/templates/estimator.py"),
    modules: &[
        ("nims_estimator.py", include_str!("../../../../scripts/python/nims_estimator.py")),
        ("nims_law.py", include_str!("../../../../scripts/python/nims_law.py")),
    ],
    files: &[
        ("Cargo.toml", include_str!("../../../../scripts/templates/estimator/Cargo.toml")),
        ("README.md", include_str!("../../../../scripts/templates/estimator/README.md")),
        ("src/main.rs", include_str!("../../../../scripts/templates/estimator/src/main.rs")),
        ("src/method.rs", include_str!("../../../../scripts/templates/estimator/src/method.rs")),
    ],
};
/// Path from a Rust template to the sources of nims.
const ROOT_IN_TEMPLATE: &str = "\"../../../";
/// Longest name, characters; the same as for `nims plug`.
const NAME_MAX: usize = 16;

impl Kind {
    fn template(self) -> &'static Template {
        match self {
            Self::Sensor => &SENSOR,
            Self::Law => &LAW,
            Self::Estimator => &ESTIMATOR,
        }
    }

    /// Returns the role of its process in a system file; a sensor is plugged in instead.
    fn role(self) -> Option<&'static str> {
        match self {
            Self::Sensor => None,
            Self::Law => Some("controller"),
            Self::Estimator => Some("estimator"),
        }
    }

    /// Returns the option of `nims sim` that flies with it.
    fn option(self) -> &'static str {
        if self == Self::Estimator { "--estimator-program" } else { "--program" }
    }

    /// Returns the name in the texts of a template replaced by another one.
    fn renamed(self, text: &str, name: &str) -> String {
        let camel: String = name
            .split('-')
            .map(|word| {
                word.chars().take(1).flat_map(char::to_uppercase).chain(word.chars().skip(1)).collect::<String>()
            })
            .collect();
        let [plain, in_rust] = self.template().placeholder;
        let text = match self {
            // The word is also one of its texts.
            Self::Sensor => text.replace(&format!("\"{plain}\""), &format!("\"{name}\"")),
            Self::Law | Self::Estimator => text.replace(plain, name),
        };
        text.replace(in_rust, &camel)
    }
}

/// Writes the example and returns the commands with which it is built and flown.
///
/// # Errors
/// The name is not valid, a file of that name exists, or the sources of nims are not found.
pub fn new_program(kind: Kind, asked: &Args) -> Answer<Output> {
    let name = asked.name.as_str();
    let usable = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    if !name.starts_with(|c: char| c.is_ascii_lowercase()) || name.len() > NAME_MAX || !name.bytes().all(usable) {
        return Err(Failure::BadInput(format!(
            "the name is \"{name}\"; accepted: 1 to {NAME_MAX} of a-z, 0-9 and `-`, starting with a letter"
        )));
    }
    let written = if asked.rust { rust(kind, name, asked.nims.as_deref())? } else { python(kind, name)? };
    let files: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
    let next = next(kind, name, asked.rust);
    let words = format!("wrote {}\n{}:\n  {}", files.join(", "), next.0, next.1.join("\n  "));
    let Some(role) = kind.role() else {
        return Ok(Output::new(json!({ "written": files, "next": next.1 }), words));
    };
    let process = process(role, name, asked.rust)?;
    let swap = format!("nims swap {role} {name}");
    let robot = match &process {
        Some(lines) => {
            format!("in a copy of its system file:\n  {}\nand while it moves:\n  {swap}", lines.join("\n  "))
        }
        None => "it starts only from a folder without spaces in its path, because its command is split at spaces: move the files to one"
            .to_owned(),
    };
    let process = process.map(|lines| lines.join("\n"));
    let words = format!("{words}\non a robot, {robot}");
    Ok(Output::new(json!({ "written": files, "next": next.1, "process": process, "swap": swap }), words))
}

/// Returns when to use the next commands, and the commands.
fn next(kind: Kind, name: &str, rust: bool) -> (&'static str, Vec<String>) {
    let build = rust.then(|| format!("(cd {name} && cargo build)"));
    let program = if rust { format!("{name}/target/debug/{name}") } else { format!("python3 {name}.py") };
    let own: Vec<String> = match kind {
        Kind::Sensor => {
            let gateway =
                "nims plug gateway -- gateway    # once; on a control box a service is the gateway".to_owned();
            // A sensor in Rust is in the robot's shared memory.
            let gateway = (!rust).then_some(gateway);
            let plug = format!("nims plug {name} -- {program}");
            gateway.into_iter().chain([plug, format!("nims channel echo sensor/{name}")]).collect()
        }
        Kind::Law | Kind::Estimator => vec![format!("nims sim SYSTEM.toml {} \"{program}\"", kind.option())],
    };
    let when = if kind == Kind::Sensor { "next, while the robot runs" } else { "next, without a robot" };
    (when, build.into_iter().chain(own).collect())
}

/// Returns the section of a system file that starts it beside the standard process of its role; `None` for a Python
/// file in a folder with spaces, because `--program` is split at them and knows no quotes.
fn process(role: &str, name: &str, rust: bool) -> Answer<Option<Vec<String>>> {
    let here = std::env::current_dir().map_err(Failure::not_now)?;
    let command = if rust {
        format!("[{:?}]", here.join(name).join("target/debug").join(name).display().to_string())
    } else {
        let script = here.join(format!("{name}.py")).display().to_string();
        if script.contains(char::is_whitespace) {
            return Ok(None);
        }
        format!("[{role:?}, \"--program\", {:?}]", format!("python3 {script}"))
    };
    Ok(Some(vec![
        "[[process]]".to_owned(),
        format!("name = {name:?}"),
        format!("role = {role:?}"),
        "slot = \"b\"".to_owned(),
        format!("command = {command}"),
    ]))
}

/// Writes a Python file, and beside it the modules that it imports, unless they are there.
fn python(kind: Kind, name: &str) -> Answer<Vec<PathBuf>> {
    let template = kind.template();
    let file = PathBuf::from(format!("{name}.py"));
    write_new(&file, &kind.renamed(template.python, name))?;
    let mut written = vec![file];
    for (module, text) in template.modules {
        let module = PathBuf::from(module);
        if !module.exists() {
            write_new(&module, text)?;
            written.push(module);
        }
    }
    Ok(written)
}

fn rust(kind: Kind, name: &str, nims: Option<&Path>) -> Answer<Vec<PathBuf>> {
    let root = format!("\"{}/", sources(nims)?.display());
    let folder = PathBuf::from(name);
    if folder.exists() {
        return Err(exists(&folder));
    }
    let mut written = Vec::new();
    for (path, text) in kind.template().files {
        let path = folder.join(path);
        write_new(&path, &kind.renamed(text, name).replace(ROOT_IN_TEMPLATE, &root))?;
        written.push(path);
    }
    Ok(written)
}

/// Folder from which this program was built. A package names another one at its build, because its programs do not
/// contain the path of the machine that built it.
const SOURCES: &str = match option_env!("NIMS_SOURCES") {
    Some(folder) => folder,
    None => concat!(env!("CARGO_MANIFEST_DIR"), "/../../.."),
};

/// Returns the folder of the libraries that a crate depends on: `nims`, or the folder from which this program was
/// built.
fn sources(nims: Option<&Path>) -> Answer<PathBuf> {
    let root = nims.unwrap_or(Path::new(SOURCES));
    if !root.join("shared/runtime/messages/Cargo.toml").is_file() {
        return Err(Failure::BadInput(format!(
            "the sources of nims are not in {}: give their folder with --nims FOLDER, or leave --rust out for one in Python",
            root.display()
        )));
    }
    root.canonicalize().map_err(Failure::not_now)
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
        for kind in [Kind::Sensor, Kind::Law, Kind::Estimator] {
            let template = kind.template();
            let [plain, in_rust] = template.placeholder;
            let mut paths = 0;
            for text in template.files.iter().map(|(_, text)| *text).chain([template.python]) {
                let own = kind.renamed(text, "soil-probe-2");
                assert!(!own.contains(plain) && !own.contains(in_rust), "{own}");
                paths += own.matches(ROOT_IN_TEMPLATE).count();
                assert_eq!(own.matches("../").count(), own.matches(ROOT_IN_TEMPLATE).count() * 3, "{own}");
            }
            assert!(paths >= 1, "{kind:?} depends on a crate of nims");
        }
        let [law, sensor] = [(Kind::Law, LAW.files[3].1), (Kind::Sensor, SENSOR.files[1].1)];
        assert!(law.0.renamed(law.1, "soil-probe-2").contains("pub struct SoilProbe2 {"));
        assert!(sensor.0.renamed(sensor.1, "soil-probe-2").contains("pub struct SoilProbe2 {"));
        assert!(Kind::Sensor.renamed(SENSOR.python, "soil").contains("class Soil(Sample)"));
    }
}
