//! The configuration stored in the run file, with the requested changes.

use super::changes::Changes;
use command::{Answer, Failure};
use config::{ControlLaw, EstimatorMethod, RobotFile, SystemFile};
use controller::program::{Complaint, ProgramLaw, StartError, Waits};
use controller::{Controller, ControllerConfig, Law};
use estimator::{EstimatorConfig, Method};
use motor_io::{Core, CoreConfig};
use runlog::{Attachment, SYSTEM_FILE, is_system_file};
use std::borrow::Cow;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};
use tempfile::TempDir;
use toml::{Table, Value};

/// File name under which the recorder stores the robot file.
const ROBOT: &str = "robot.toml";
/// Tables of the robot file; all other keys belong to the system file.
const ROBOT_TABLES: [&str; 4] = ["robot", "lines", "motor", "site"];

/// Configuration of the deciding parts.
#[derive(Debug, Clone)]
pub(super) struct Configuration {
    file: SystemFile,
    robot: RobotFile,
    core: CoreConfig,
    /// Whether the requested law differs from the one that a process was started with.
    law_changed: bool,
    /// The same for the estimation method.
    method_changed: bool,
    /// Requested changes of the `[controller]` and `[estimator]` sections.
    sections_changed: Vec<(String, String)>,
    /// Custom law in place of the recorded one.
    program: Option<Program>,
}

/// A custom law, and the folder with the files that it reads.
#[derive(Debug, Clone)]
struct Program {
    command: String,
    folder: Arc<TempDir>,
    /// Of each controller that was started with it.
    complaints: Arc<Mutex<Vec<Complaint>>>,
}

impl Configuration {
    /// Reads the recorded configuration and applies the changes.
    ///
    /// # Errors
    /// The run has no configuration, it cannot be used, or a change cannot be applied.
    pub(super) fn from_attachments(attachments: &[Attachment], changes: &Changes) -> Answer<Self> {
        let folder = Arc::new(command::temporary_folder()?);
        // The name of an attachment must not lead out of the folder.
        for (attachment, name) in attachments.iter().filter_map(|one| Some((one, Path::new(&one.name).file_name()?))) {
            let name = if name.to_str().is_some_and(is_system_file) { Path::new(SYSTEM_FILE) } else { Path::new(name) };
            fs::write(folder.path().join(name), &attachment.data).map_err(Failure::not_now)?;
        }
        let plain = |problem: &dyn std::fmt::Display| {
            Failure::bad(problem.to_string().replace(&format!("{}/", folder.path().display()), "the run's "))
        };
        let table = |name: &str| -> Answer<Table> {
            let text = fs::read_to_string(folder.path().join(name))
                .map_err(|_| Failure::BadInput(format!("the run file has no {name}, so the run cannot be replayed")))?;
            text.parse().map_err(|error| plain(&format!("{name}: {error}")))
        };
        let (mut file, mut robot) = (table(SYSTEM_FILE)?, table(ROBOT)?);
        file.insert("robot".to_owned(), Value::String(ROBOT.to_owned()));
        for (key, value) in &changes.set {
            let first = key.split('.').next().unwrap_or_default();
            let into = if ROBOT_TABLES.contains(&first) { &mut robot } else { &mut file };
            set(into, key, value)?;
        }
        let mut changed: Vec<&str> = changes.set.iter().map(|(key, _)| key.as_str()).collect();
        if let Some(law) = &changes.law {
            set(&mut file, "controller.law", law)?;
            changed.push("controller.law");
        }
        for (name, table) in [(SYSTEM_FILE, file), (ROBOT, robot)] {
            let text = toml::to_string(&table).map_err(Failure::not_now)?;
            fs::write(folder.path().join(name), text).map_err(Failure::not_now)?;
        }
        let file = SystemFile::load(&folder.path().join(SYSTEM_FILE)).map_err(|error| plain(&error))?;
        let robot = file.robot_file().map_err(|error| plain(&error))?;
        let replaced = |key: &&String| robot.replaced.iter().any(|one| one.key == key.as_str());
        if let Some(key) = changes.set.iter().map(|(key, _)| key).find(replaced) {
            return Err(Failure::BadInput(format!(
                "--set {key} has no effect, because the run's identified file takes its place; set another key"
            )));
        }
        let core = CoreConfig::from_files(&file, &robot).map_err(|error| plain(&error))?;
        let this = Self {
            core,
            law_changed: changed.contains(&"controller.law"),
            method_changed: changed.contains(&"estimator.method"),
            sections_changed: changes.set.iter().filter(|(key, _)| is_of_a_section(key)).cloned().collect(),
            file,
            robot,
            program: changes.program.clone().map(|command| Program {
                command,
                folder: Arc::clone(&folder),
                complaints: Arc::default(),
            }),
        };
        this.law().transpose().map_err(|error| match error {
            StartError::NotOne(_) => plain(&error),
            StartError::Fails(_) => Failure::not_now(error),
        })?;
        this.controller_config(1, None).map_err(|error| plain(&format!("[controller] {error}")))?;
        this.estimator_config(1, None).map_err(|error| plain(&format!("[estimator] {error}")))?;
        Ok(this)
    }

    /// Returns the number of cables.
    pub(super) fn cables(&self) -> usize {
        self.core.cable_count()
    }

    /// Creates the deciding part of motor-io.
    pub(super) fn core(&self) -> Core {
        Core::new(self.core.clone())
    }

    /// Returns the configuration of an estimator from the method in its estimates and its reported parameters.
    pub(super) fn estimator(&self, incarnation: u32, method: u8, parameters: Option<&str>) -> Option<EstimatorConfig> {
        let method = Method::numbered(method)?;
        self.with_sections(parameters)?.estimator_config(incarnation, Some(method)).ok()
    }

    /// Returns the configuration of a controller from the law in its answers and its reported parameters.
    pub(super) fn controller(&self, incarnation: u32, law: u8, parameters: Option<&str>) -> Option<ControllerConfig> {
        let law = Law::numbered(law);
        // A custom law that was flown can only be replayed by its program.
        if law.is_none() && self.program.is_none() {
            return None;
        }
        self.with_sections(parameters)?.controller_config(incarnation, law).ok()
    }

    /// Starts the program with the custom law, if there is one.
    fn law(&self) -> Option<Result<ProgramLaw, StartError>> {
        let Program { command, folder, .. } = self.program.as_ref()?;
        let system = folder.path().join(SYSTEM_FILE);
        Some(ProgramLaw::start(command, &system, self.core.cable_count(), Waits::in_lockstep()))
    }

    /// Checks that the program of the custom law, if there is one, has answered each question.
    ///
    /// # Errors
    /// Its complaint: a law without answers would be compared as one that commands nothing.
    pub(super) fn check_law(&self) -> Answer {
        let Some(complaints) = self.program.as_ref().and_then(|program| program.complaints.lock().ok()) else {
            return Ok(());
        };
        let first = complaints.iter().find_map(|complaint| complaint.lock().ok()?.clone());
        first.map_or(Ok(()), |complaint| Err(Failure::NotNow(complaint)))
    }

    /// Keeps the complaint of a program that was started.
    fn watch(&self, complaint: Complaint) {
        if let Some(mut complaints) = self.program.as_ref().and_then(|program| program.complaints.lock().ok()) {
            complaints.push(complaint);
        }
    }

    /// Creates a controller, with the custom law if there is one.
    pub(super) fn start(&self, config: ControllerConfig) -> Option<Controller> {
        match self.law() {
            Some(Ok(law)) => {
                self.watch(law.complaint());
                Some(Controller::with_law(config, Box::new(law)))
            }
            Some(Err(error)) => {
                self.watch(Arc::new(Mutex::new(Some(error.to_string()))));
                None
            }
            None => Some(Controller::new(config)),
        }
    }

    /// Returns the time in which a controller fades from old parameters to new ones, s.
    pub(super) fn fade_s(&self) -> f64 {
        self.file.arbiter.fade_s
    }

    /// Returns this configuration with reported sections and the requested changes; `None` if they are invalid.
    fn with_sections(&self, parameters: Option<&str>) -> Option<Cow<'_, Self>> {
        let Some(parameters) = parameters else { return Some(Cow::Borrowed(self)) };
        let mut sections: Table = parameters.parse().ok()?;
        for (key, value) in &self.sections_changed {
            set(&mut sections, key, value).ok()?;
        }
        let mut with = self.clone();
        let mut remove = |name: &str| sections.remove(name);
        if let Some(section) = remove("controller") {
            let law = with.file.controller.law;
            with.file.controller = section.try_into().ok()?;
            if self.law_changed {
                with.file.controller.law = law;
            }
        }
        if let Some(section) = remove("estimator") {
            let method = with.file.estimator.method;
            with.file.estimator = section.try_into().ok()?;
            if self.method_changed {
                with.file.estimator.method = method;
            }
        }
        Some(Cow::Owned(with))
    }

    fn estimator_config(&self, incarnation: u32, method: Option<EstimatorMethod>) -> anyhow::Result<EstimatorConfig> {
        let mut section = self.file.estimator;
        if let Some(method) = method.filter(|_| !self.method_changed) {
            section.method = method;
        }
        Ok(EstimatorConfig::from_section(&section, self.robot.robot()?, incarnation)?)
    }

    fn controller_config(&self, incarnation: u32, law: Option<ControlLaw>) -> anyhow::Result<ControllerConfig> {
        let mut file = self.file.clone();
        if let Some(law) = law.filter(|_| !self.law_changed) {
            file.controller.law = law;
        }
        ControllerConfig::from_files(&file, &self.robot, incarnation)
    }
}

fn is_of_a_section(key: &str) -> bool {
    key.starts_with("controller.") || key.starts_with("estimator.")
}

/// Sets a dotted key to a value in TOML syntax or to a bare word.
fn set(table: &mut Table, key: &str, value: &str) -> Answer {
    let value = match format!("value = {value}").parse::<Table>() {
        Ok(mut read) => read.remove("value").unwrap_or_else(|| Value::String(value.to_owned())),
        Err(_) => Value::String(value.to_owned()),
    };
    let mut at = table;
    let mut names = key.split('.').peekable();
    while let Some(name) = names.next() {
        if names.peek().is_none() {
            at.insert(name.to_owned(), value);
            break;
        }
        let inner = at.entry(name).or_insert_with(|| Value::Table(Table::new()));
        let Value::Table(inner) = inner else {
            return Err(Failure::BadInput(format!("--set {key}: `{name}` is not a table of the configuration")));
        };
        at = inner;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_parsed_as_toml_and_bare_words_as_strings() {
        let mut table: Table = "name = \"x\"\n[controller]\nhorizon_cycles = 20".parse().unwrap();
        for (key, value) in
            [("controller.horizon_cycles", "30"), ("controller.law", "preview"), ("estimator.prior", "[0.5, 0.5]")]
        {
            set(&mut table, key, value).unwrap();
        }
        let wanted =
            "name = \"x\"\n[controller]\nhorizon_cycles = 30\nlaw = \"preview\"\n[estimator]\nprior = [0.5, 0.5]";
        assert_eq!(table, wanted.parse::<Table>().unwrap());
        let why = set(&mut table, "name.inner", "1").unwrap_err().to_string();
        assert!(["--set", "name.inner", "`name`"].iter().all(|part| why.contains(part)), "{why}");
    }
}
