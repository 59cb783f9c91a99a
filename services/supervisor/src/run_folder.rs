//! The folder of a run: run files, the configuration in use, diagnostics, and a manifest.

use super::copies::{Copies, MANIFEST, SharedCopies};
use command::{Answer, Failure};
use config::file::replace;
use config::{MOTOR_BOX, MotorBoxTable, RESOLVED, SystemFile};
use runtime::build;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

const RESOLVED_HEAD: &str = "# The system file at the start of the run: every key, defaults included; `robot` is the robot file in this folder.\n\
                             # Every process of the run reads it, except the virtual motor box, which alone reads the true world.\n\n";
const MOTOR_BOX_HEAD: &str =
    "# resolved.toml with the content of [motor_box]: only the virtual motor box reads it.\n\n";

/// The folder of a run.
#[derive(Debug, Clone)]
pub struct RunFolder {
    path: PathBuf,
    manifest: Value,
    copies: SharedCopies,
}

impl RunFolder {
    /// Creates the folder, `RUNS/DATE-TIME-NAME` unless one is given, with copies of the configuration.
    ///
    /// # Errors
    /// It cannot be created, or the given folder is not empty.
    pub fn create(file: &SystemFile, system_path: &Path, given: Option<&Path>, mission: Option<&Path>) -> Answer<Self> {
        let now = bus::clock::unix_ns();
        let path = match given {
            Some(path) => path.to_path_buf(),
            None => free(&file.runs.join(format!("{}-{}", stamp(now), file.name))),
        };
        if path.is_file() {
            return Err(Failure::BadInput(format!(
                "--run {}: this is a file; give a folder that is empty or does not exist",
                path.display()
            )));
        }
        if fs::read_dir(&path).is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(Failure::BadInput(format!(
                "--run {}: the folder is not empty; give a folder that is empty or does not exist",
                path.display()
            )));
        }
        let mut copies = copies_of(file)?;
        for (original, name) in [(Some(system_path), runlog::SYSTEM_FILE), (mission, "mission.toml")] {
            let Some(original) = original else { continue };
            let bytes = fs::read(original).map_err(|error| {
                Failure::BadInput(format!("the file {} cannot be read: {error}", original.display()))
            })?;
            copies.insert(name, bytes);
        }
        let failed = |what: &Path, error: std::io::Error| {
            Failure::NotNow(format!("{} cannot be written: {error}", what.display()))
        };
        let log = path.join("log");
        fs::create_dir_all(&log).map_err(|error| failed(&log, error))?;
        let path = path.canonicalize().map_err(|error| failed(&path, error))?;
        copies.write(&path).map_err(|(copy, error)| failed(&copy, error))?;
        let manifest = json!({
            "name": file.name,
            "system": system_path.file_name().map(|name| name.to_string_lossy()),
            "robot": file.robot.file_name().map(|name| name.to_string_lossy()),
            "virtual": file.motor_box.is_some(),
            "rate_hz": file.rate_hz,
            "nims_version": build::VERSION,
            "build": build::PROFILE,
            "git_commit": build::commit().map(|(commit, _)| commit),
            "git_dirty": build::commit().map(|(_, dirty)| dirty),
            "started_utc": runlog::utc(now),
        });
        let folder = Self { path, manifest, copies: SharedCopies::new(copies) };
        folder.write()?;
        Ok(folder)
    }

    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The resolved system file, which the processes read.
    #[must_use]
    pub fn resolved(&self) -> PathBuf {
        self.path.join(RESOLVED)
    }

    /// The resolved system file for the virtual motor box, if there is one.
    #[must_use]
    pub fn for_motor_box(&self) -> PathBuf {
        self.path.join(MOTOR_BOX)
    }

    /// Copies of the configuration.
    pub(super) fn copies(&self) -> &SharedCopies {
        &self.copies
    }

    /// File for the diagnostics of a process.
    #[must_use]
    pub fn log(&self, process: &str) -> PathBuf {
        self.path.join("log").join(format!("{process}.txt"))
    }

    /// Records when the recorder was first ready, on the clock of the run.
    pub fn record_first_recording(&mut self, unix_ns: u64) {
        if self.manifest["recording_unix_ns"].is_null() {
            self.manifest["recording_unix_ns"] = json!(unix_ns);
        }
    }

    /// Records when the processes are requested to end, on the clock of the run: until then the recorder must run.
    pub fn record_stopping(&mut self, unix_ns: u64) {
        self.manifest["stopping_unix_ns"] = json!(unix_ns);
    }

    /// Completes the manifest with the reason for the end and the exit of each process.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn close(&mut self, because: &str, processes: Value) -> Answer {
        self.manifest["ended_utc"] = json!(runlog::utc(bus::clock::unix_ns()));
        self.manifest["ended_because"] = json!(because);
        self.record_processes(processes);
        let files = runlog::segments(&self.path).unwrap_or_default();
        let names = files.iter().filter_map(|file| Some(file.file_name()?.to_string_lossy()));
        self.manifest["files"] = names.collect();
        self.write()
    }

    /// Records the running processes.
    pub fn record_processes(&mut self, processes: Value) {
        self.manifest["processes"] = processes;
    }

    /// Path and content of the manifest so far.
    #[must_use]
    pub fn manifest(&self) -> (PathBuf, String) {
        (self.path.join(MANIFEST), format!("{:#}\n", self.manifest))
    }

    fn write(&self) -> Answer {
        let (path, text) = self.manifest();
        replace(&path, text).map_err(|error| Failure::NotNow(format!("{} cannot be written: {error}", path.display())))
    }
}

/// What a start that fails leaves of its run: the whole folder, or nothing.
#[derive(Debug)]
pub struct Leftover(Option<PathBuf>);

impl Leftover {
    /// Until [`Self::keep`] is called, dropping it removes the folder if `is_removed`.
    pub fn of(folder: &RunFolder, is_removed: bool) -> Self {
        Self(is_removed.then(|| folder.path.clone()))
    }

    /// Whether the folder will be removed.
    #[must_use]
    pub fn is_removed(&self) -> bool {
        self.0.is_some()
    }

    /// The run has begun.
    pub fn keep(&mut self) {
        self.0 = None;
    }
}

impl Drop for Leftover {
    fn drop(&mut self) {
        if let Some(run) = &self.0 {
            // What cannot be removed is a run like any other.
            let _ = fs::remove_dir_all(run);
        }
    }
}

/// The configuration that every process of the run reads. Only the copy for the virtual motor box contains the true
/// world. The recorder attaches it to the run file, which is then
/// complete without other files.
fn copies_of(file: &SystemFile) -> Answer<Copies> {
    let robot = file.robot_file().map_err(Failure::bad)?;
    let named = robot.named_files(file.robot.parent().unwrap_or(Path::new("")));
    let ground = file.motor_box.as_ref().and_then(MotorBoxTable::ground);
    let mut copies = Copies::default();
    for (original, name) in [(Some(file.robot.as_path()), "robot.toml"), (ground.as_deref(), "ground.toml")] {
        original.map(|original| copies.read(original, name.as_ref())).transpose()?;
    }
    for original in &named {
        copies.read(original, Path::new(original.file_name().unwrap_or_default()))?;
    }
    let text = |file: &SystemFile| file.resolved("robot.toml").map_err(Failure::NotNow);
    copies.add(RESOLVED, format!("{RESOLVED_HEAD}{}", text(&file.without_truth())?));
    if file.motor_box.is_some() {
        copies.add(MOTOR_BOX, format!("{MOTOR_BOX_HEAD}{}", text(file)?));
    }
    Ok(copies)
}

/// `2026-03-01T14-05-09Z`: sorts by time and is a file name everywhere.
fn stamp(unix_ns: u64) -> String {
    runlog::utc(unix_ns).trim_end_matches(" UTC").replace(' ', "T").replace(':', "-") + "Z"
}

/// The path, with a number appended if it exists.
fn free(path: &Path) -> PathBuf {
    let mut candidate = path.to_path_buf();
    let mut number = 2;
    while candidate.exists() {
        let mut name = path.as_os_str().to_owned();
        name.push(format!("-{number}"));
        candidate = PathBuf::from(name);
        number += 1;
    }
    candidate
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_copy_for_the_motor_box_has_the_true_world_and_the_run_keeps_it() {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let place = tempfile::tempdir().unwrap();
        let original = place.path().join("system.toml");
        let text = fs::read_to_string(configs.join("systems/demo3.toml")).unwrap();
        let robot = configs.join("robots/lab3.toml").canonicalize().unwrap();
        let text = text.replace("../robots/lab3.toml", &robot.to_string_lossy());
        let truth = "stiffness_n = 5555.0\n\n[motor_box.truth]\nnode_mass_kg = 1.2345\n";
        fs::write(&original, text.replace("[motor_box] ", &format!("[motor_box]\n{truth}# "))).unwrap();
        let mut file = SystemFile::load(&original).unwrap();
        file.runs = place.path().join("runs");
        let folder = RunFolder::create(&file, &original, None, None).unwrap();
        for entry in fs::read_dir(folder.path()).unwrap() {
            let path = entry.unwrap().path();
            let Ok(text) = fs::read_to_string(&path) else { continue };
            let has_all = text.contains("node_mass_kg = 1.2345") && text.contains("stiffness_n = 5555");
            let may = ["motor-box.toml", "system.toml"].iter().any(|name| path.ends_with(name));
            assert_eq!(has_all, may, "{}", path.display());
        }
        let chain = SystemFile::load(&folder.resolved()).unwrap();
        assert!(chain.motor_box.is_some_and(|table| format!("{table:?}") == "{}"), "only its presence is left");
        let whole = SystemFile::load(&folder.for_motor_box()).unwrap();
        assert_eq!(format!("{:?}", whole.motor_box), format!("{:?}", file.motor_box));
    }
}
