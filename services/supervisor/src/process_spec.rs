//! Which processes a system has, and how each is started.

use super::refused::Decision;
use super::restarts::Policy;
use config::{ProcessSection, Role, SystemFile};
use messages::{Slot, SlotRole};
use robot_state::Reason;
use robot_state::answers::detail;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Policy of a process without an entry in the system file: the defaults of `[[process]]`.
const RESTART: Policy = Policy { again: false, pause_ns: 500_000_000, limit: 3, forgiven_ns: 60_000_000_000 };
/// Longest process name, bytes: it becomes part of a channel name and of a socket path.
const NAME_MAX: usize = 16;

/// How to start one process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProcessSpec {
    /// Its name on the bus and in the process table; unique.
    pub name: String,
    /// Its name in the system file, where it replaces a standard process.
    pub alias: Option<String>,
    /// Role in the system.
    pub role: Role,
    /// Slot of a controller or an estimator.
    pub slot: Option<Slot>,
    /// Its law or method, where it differs from the configured one.
    pub law: Option<String>,
    /// Path of the program.
    pub program: PathBuf,
    /// Arguments of the program.
    pub args: Vec<OsString>,
    /// Working directory; `None`: that of the supervisor.
    pub folder: Option<PathBuf>,
    /// Whether and when it is restarted after it dies.
    pub restart: Policy,
    /// It sends heartbeats and reports when it is ready. A foreign program may never do so.
    pub sends_heartbeats: bool,
    /// SCHED_FIFO priority; 0: ordinary scheduling, or the priority in `[realtime]`.
    pub priority: u8,
    /// Processor to which it is pinned.
    pub cpu: Option<usize>,
}

impl ProcessSpec {
    /// The files that its command names, such as a script or a sensor's configuration, of which the run needs a copy.
    #[must_use]
    pub fn files_to_copy(&self, run: &Path) -> Vec<PathBuf> {
        let Some(folder) = &self.folder else { return Vec::new() };
        let arguments = self.args.iter().map(Path::new).chain([self.program.as_path()]);
        let is_kept = |path: &&Path| {
            path.extension().is_some_and(|ending| runlog::ATTACHED_ENDINGS.iter().any(|kept| ending == *kept))
        };
        let paths = arguments.filter(is_kept).map(|path| folder.join(path));
        // A copy in the run folder needs no further copy.
        paths.filter(|path| path.is_file() && !path.starts_with(run)).collect()
    }

    /// Its arguments that name a configuration file, by their place.
    #[must_use]
    pub fn configurations(&self) -> Vec<(usize, PathBuf)> {
        let folder = self.folder.clone().unwrap_or_default();
        let paths = self.args.iter().map(|argument| folder.join(argument)).enumerate();
        paths.filter(|(_, path)| is_configuration(path) && path.is_file()).collect()
    }

    /// Whether the robot cannot continue a motion without it.
    #[must_use]
    pub fn is_vital(&self) -> bool {
        !matches!(self.role, Role::Recorder | Role::Other)
    }

    /// Whether this is its name on the bus or in the system file.
    #[must_use]
    pub fn has_name(&self, name: &str) -> bool {
        self.name == name || self.alias.as_deref() == Some(name)
    }

    /// Roles whose processes must be ready before this one is started. The recorder starts first, so that it misses no
    /// sample; publishers start before motor-io, whose cycle wakes their subscribers; custom processes start last.
    #[must_use]
    pub fn starts_after(&self) -> &'static [Role] {
        match self.role {
            Role::Recorder => &[],
            Role::MotorBox | Role::Estimator | Role::Controller | Role::Planner => &[Role::Recorder],
            Role::MotorIo => &[Role::Recorder, Role::MotorBox, Role::Estimator, Role::Controller, Role::Planner],
            Role::Other => {
                &[Role::Recorder, Role::MotorBox, Role::MotorIo, Role::Estimator, Role::Controller, Role::Planner]
            }
        }
    }
}

/// What the processes of a run share.
#[derive(Debug, Clone)]
pub struct RunContext {
    /// The parsed system file.
    pub file: SystemFile,
    /// Path of the original system file; relative paths start at its folder.
    pub system_path: PathBuf,
    /// The run's copy of the system file, which the processes read; without the true world.
    pub config: PathBuf,
    /// The complete copy, which only the virtual motor box reads.
    pub motor_box_config: PathBuf,
    /// Files that commands in the system file name, and the run's copy of each.
    pub copies: BTreeMap<PathBuf, PathBuf>,
    /// The domain, in the form that `--domain` accepts.
    pub domain: String,
    /// The run folder.
    pub run: PathBuf,
}

impl RunContext {
    /// The processes that the system starts automatically, upstream before downstream.
    ///
    /// # Errors
    /// A program does not exist.
    pub fn members(&self) -> Decision<Vec<ProcessSpec>> {
        let started = self.file.started();
        let members = started.iter().map(|one| self.member(one.role, one.slot, one.section, None));
        let members = members.collect::<Decision<Vec<_>>>()?;
        // Programs that `nims start` may start later must exist too.
        for section in self.file.process.iter().filter(|process| !process.start) {
            self.configured(section, None)?;
        }
        Ok(members)
    }

    /// The `[[process]]` entry of that name.
    #[must_use]
    pub fn section(&self, name: &str) -> Option<&ProcessSection> {
        self.file.process.iter().find(|process| process.name == name)
    }

    /// The process that an entry of the system file describes; `slot` overrides the slot of a controller or an
    /// estimator.
    ///
    /// # Errors
    /// The program does not exist.
    pub fn configured(&self, section: &ProcessSection, slot: Option<Slot>) -> Decision<ProcessSpec> {
        let slot = section.role.has_slots().then(|| slot.unwrap_or(section.slot()));
        self.member(section.role, slot, Some(section), None)
    }

    /// A controller or an estimator in that slot: `law` names a law or method, or an entry of the system file.
    ///
    /// # Errors
    /// The program does not exist, or the entry has another role.
    pub fn with_law(&self, role: Role, slot: Slot, law: &str) -> Decision<ProcessSpec> {
        let unknown = |why| match slot_role(role) {
            Some(role) => Reason::LawUnknown { role, law: detail(law), why: detail(why) },
            None => Reason::NoSlotNoLaw { process: detail(role.name()) },
        };
        match self.file.process_for(role, law).map_err(unknown)? {
            Some(section) => self.configured(section, Some(slot)),
            None => self.member(role, Some(slot), None, Some(law)),
        }
    }

    /// The process of a role: its entry in the system file, or the standard program.
    ///
    /// # Errors
    /// The program does not exist.
    pub fn of_role(&self, role: Role, slot: Option<Slot>) -> Decision<ProcessSpec> {
        let takes = |process: &&ProcessSection| {
            process.start && process.role == role && slot.is_none_or(|slot| process.slot() == slot)
        };
        self.member(role, slot, self.file.process.iter().find(takes), None)
    }

    /// A program that the system file does not name.
    ///
    /// # Errors
    /// The name is not valid, or the program does not exist.
    pub fn plugged(&self, name: &str, folder: &Path, command: &[String]) -> Decision<ProcessSpec> {
        let usable = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        if name.is_empty() || name.len() > NAME_MAX || !name.bytes().all(usable) {
            return Err(Reason::NameInvalid { process: detail(name), most: NAME_MAX }.into());
        }
        let (program, args) = self.command(Role::Other, name, command, folder)?;
        Ok(ProcessSpec {
            name: name.to_owned(),
            alias: None,
            role: Role::Other,
            slot: None,
            law: None,
            program,
            args,
            folder: Some(folder.to_owned()),
            restart: RESTART,
            sends_heartbeats: false,
            priority: 0,
            cpu: None,
        })
    }

    fn member(
        &self,
        role: Role,
        slot: Option<Slot>,
        section: Option<&ProcessSection>,
        law: Option<&str>,
    ) -> Decision<ProcessSpec> {
        let name = match (role, section) {
            (Role::Other, Some(section)) => section.name.clone(),
            _ => role.process_name(slot.unwrap_or_default()),
        };
        let law = law.or(section.and_then(|section| section.law.map(config::Algorithm::name)));
        let own = section.filter(|section| !section.command.is_empty());
        let folder = own.map(|_| self.system_path.parent().unwrap_or(Path::new("/")).to_path_buf());
        let (program, mut args) = match own {
            Some(section) => {
                self.command(role, &name, &section.command, folder.as_deref().unwrap_or(Path::new("/")))?
            }
            None => (sibling_program(role.name())?, Vec::new()),
        };
        if role != Role::Other {
            args.extend(["--system".into(), self.config_of(role).into()]);
            args.extend(["--name".into(), name.clone().into(), "--domain".into(), self.domain.clone().into()]);
        }
        if slot == Some(Slot::B) {
            args.extend(["--slot".into(), Slot::B.name().into()]);
        }
        if let Some(law) = law {
            args.extend(["--law".into(), law.into()]);
        }
        if role == Role::Recorder {
            args.extend(["--run".into(), self.run.clone().into()]);
        }
        let standby = role.has_slots() && self.file.process.iter().any(|other| other.role == role && other.standby);
        // A restarted recorder begins a new file; recovery closes the previous one.
        let again = section.and_then(|section| section.restart).unwrap_or(role == Role::Recorder || standby);
        let restart = section.map_or(RESTART, |section| Policy {
            again,
            pause_ns: (section.restart_pause_s * 1e9) as u64,
            limit: section.restart_limit,
            forgiven_ns: (section.restart_forgive_s * 1e9) as u64,
        });
        // Samples that are not recorded are lost, so the recorder is restarted for as long as the robot runs.
        let limit = if role == Role::Recorder { u32::MAX } else { restart.limit };
        Ok(ProcessSpec {
            alias: section.map(|section| section.name.clone()).filter(|alias| *alias != name),
            law: law.map(str::to_owned),
            name,
            role,
            slot,
            program,
            args,
            folder,
            restart: Policy { again, limit, ..restart },
            sends_heartbeats: role != Role::Other,
            priority: section.map_or(0, |section| section.priority),
            cpu: section.and_then(|section| section.cpu),
        })
    }

    /// The copy of the system file for a process of this role.
    fn config_of(&self, role: Role) -> &Path {
        if role == Role::MotorBox { &self.motor_box_config } else { &self.config }
    }

    /// Program and arguments of a configured command, with its placeholders substituted.
    fn command(&self, role: Role, name: &str, command: &[String], folder: &Path) -> Decision<(PathBuf, Vec<OsString>)> {
        let Some((first, rest)) = command.split_first().filter(|(first, _)| !first.is_empty()) else {
            return Err(Reason::CommandEmpty { process: detail(name) }.into());
        };
        let program = if first.contains('/') {
            Some(folder.join(first)).filter(|path| path.is_file())
        } else {
            sibling_program(first).ok().or_else(|| in_path(first))
        };
        let Some(program) = program else {
            let (process, program) = (detail(name), detail(first));
            return Err(match folder.join(first).is_dir() {
                true => Reason::ProgramIsFolder { process, program },
                false => Reason::NoProgram { process, program },
            }
            .into());
        };
        let filled_in = |argument: &String| {
            OsString::from(
                argument
                    .replace("{name}", name)
                    .replace("{domain}", &self.domain)
                    .replace("{system}", &self.config_of(role).to_string_lossy())
                    .replace("{run}", &self.run.to_string_lossy()),
            )
        };
        let copied = |argument: OsString| match self.copies.get(&folder.join(&argument)) {
            Some(copy) => copy.clone().into(),
            None => argument,
        };
        Ok((program, rest.iter().map(filled_in).map(copied).collect()))
    }

    /// The configuration files that commands in the system file name, each with the name of its process.
    #[must_use]
    pub fn files_of_commands(&self) -> Vec<(String, PathBuf)> {
        let folder = self.system_path.parent().unwrap_or(Path::new("/"));
        let of_one = |section: &ProcessSection| {
            let arguments = section.command.iter().skip(1).map(Path::new);
            let files = arguments.filter(|path| is_configuration(path)).map(|path| folder.join(path));
            let name = section.name.clone();
            files.filter(|path| path.is_file()).map(move |path| (name.clone(), path)).collect::<Vec<_>>()
        };
        self.file.process.iter().flat_map(of_one).collect()
    }
}

/// The role as requests name it; `None` for a role without slots.
pub(super) fn slot_role(role: Role) -> Option<SlotRole> {
    match role {
        Role::Controller => Some(SlotRole::Controller),
        Role::Estimator => Some(SlotRole::Estimator),
        _ => None,
    }
}

/// Whether a file of this name is a configuration file.
pub(super) fn is_configuration(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "toml")
}

fn sibling_program(name: &str) -> Decision<PathBuf> {
    let own = std::env::current_exe().map_err(|why| Reason::OwnPathUnknown { why: detail(why) })?;
    let path = own.with_file_name(name);
    if path.is_file() { Ok(path) } else { Err(Reason::NotBuilt { program: detail(path.display()) }.into()) }
}

fn in_path(name: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(name)).find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_motor_box_is_started_with_the_true_world() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems/demo3.toml");
        let file = SystemFile::load(&path).unwrap();
        let (config, motor_box_config) = (PathBuf::from("/run/resolved.toml"), PathBuf::from("/run/motor-box.toml"));
        let context = RunContext {
            file,
            system_path: path,
            config: config.clone(),
            motor_box_config: motor_box_config.clone(),
            copies: BTreeMap::new(),
            domain: "demo3".to_owned(),
            run: "/run".into(),
        };
        for role in Role::ALL {
            let section = format!("name = \"p\"\nrole = \"{role}\"\ncommand = [\"/bin/true\", \"--own={{system}}\"]");
            let section: ProcessSection = toml::from_str(&section).unwrap();
            let args = context.configured(&section, None).unwrap().args;
            let (mine, other) =
                if *role == Role::MotorBox { (&motor_box_config, &config) } else { (&config, &motor_box_config) };
            let named = |path: &Path| args.iter().any(|one| one.to_string_lossy().ends_with(&*path.to_string_lossy()));
            assert!(named(mine) && !named(other), "{role}: {args:?}");
        }
        let plugged =
            context.plugged("sensor", Path::new("/"), &["/bin/true".to_owned(), "{system}".to_owned()]).unwrap();
        assert_eq!(plugged.args, [config.into_os_string()]);
    }

    #[test]
    fn what_cannot_be_started_is_refused_with_its_own_reason() {
        let system_path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems/demo3.toml");
        let context = RunContext {
            file: SystemFile::load(&system_path).unwrap(),
            config: system_path.clone(),
            system_path,
            motor_box_config: PathBuf::from("/run/motor-box.toml"),
            copies: BTreeMap::new(),
            domain: "test".to_owned(),
            run: PathBuf::from("/run"),
        };
        let plugged = |name: &str, command: &[&str]| {
            let command: Vec<String> = command.iter().map(ToString::to_string).collect();
            context.plugged(name, Path::new("/"), &command).map(|member| member.program)
        };
        let refused = |name: &str, command: &[&str]| *plugged(name, command).unwrap_err().0;
        let (process, long) = (detail("wind"), "a".repeat(NAME_MAX + 1));
        for name in ["", "Wind", "a b", &long] {
            assert_eq!(refused(name, &["sh"]), Reason::NameInvalid { process: detail(name), most: NAME_MAX });
        }
        assert_eq!(refused("wind", &[]), Reason::CommandEmpty { process });
        assert_eq!(refused("wind", &[""]), Reason::CommandEmpty { process });
        let program = detail("no-such-program");
        assert_eq!(refused("wind", &["no-such-program"]), Reason::NoProgram { process, program });
        let program = detail("/usr");
        assert_eq!(refused("wind", &["/usr"]), Reason::ProgramIsFolder { process, program });
        assert_eq!(plugged("wind", &["/bin/sh"]).unwrap(), PathBuf::from("/bin/sh"));
        let unknown = context.with_law(Role::Controller, Slot::A, "none").unwrap_err();
        assert!(matches!(*unknown.0, Reason::LawUnknown { .. }), "{unknown:?}");
    }
}
