//! `[[process]]`: processes with their roles, and the algorithms of the standard programs.

use crate::choice::UnknownChoice;
use crate::controller::ControlLaw;
use crate::estimator::EstimatorMethod;
use crate::names;
use crate::problem::Problem;
use crate::section::between;
use messages::Slot;
use serde::{Deserialize, Serialize};

crate::choice! {
    /// Role of a process. It determines the consequences of its death.
    pub enum Role {
        /// The virtual motor box.
        MotorBox = "motor-box",
        /// The process that controls the drives.
        MotorIo = "motor-io",
        /// An estimator.
        Estimator = "estimator",
        /// A controller.
        Controller = "controller",
        /// The planner.
        Planner = "planner",
        /// The recorder.
        Recorder = "recorder",
        /// Any other process, e.g. a sensor.
        Other = "other",
    }
}

impl Role {
    /// Every role with a standard process, with the name of the role, of the process and of its program.
    pub const STANDARD: [(&'static str, Self); 6] = [
        (Self::MotorIo.name(), Self::MotorIo),
        (Self::Estimator.name(), Self::Estimator),
        (Self::Controller.name(), Self::Controller),
        (Self::Planner.name(), Self::Planner),
        (Self::Recorder.name(), Self::Recorder),
        (Self::MotorBox.name(), Self::MotorBox),
    ];

    /// Returns the names of the algorithms of the standard program: laws of the controller, methods of the estimator.
    #[must_use]
    pub fn algorithms(self) -> &'static [&'static str] {
        match self {
            Self::Controller => ControlLaw::NAMES,
            Self::Estimator => EstimatorMethod::NAMES,
            _ => &[],
        }
    }

    /// Returns whether the role has two slots, so that a process can be swapped for another while both run.
    #[must_use]
    pub fn has_slots(self) -> bool {
        matches!(self, Self::Controller | Self::Estimator)
    }

    /// Returns the name of the standard process in a slot.
    #[must_use]
    pub fn process_name(self, slot: Slot) -> String {
        match slot {
            Slot::A => self.name().to_owned(),
            Slot::B => format!("{}-b", self.name()),
        }
    }
}

/// The algorithm of the standard program of a role with slots: a law of the controller or a method of the estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "&'static str")]
pub enum Algorithm {
    /// A law of the program `controller`.
    Law(ControlLaw),
    /// A method of the program `estimator`.
    Method(EstimatorMethod),
}

impl Algorithm {
    /// Returns the role whose standard program implements it.
    #[must_use]
    pub const fn role(self) -> Role {
        match self {
            Self::Law(_) => Role::Controller,
            Self::Method(_) => Role::Estimator,
        }
    }

    /// Returns the name in configuration files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Law(law) => law.name(),
            Self::Method(method) => method.name(),
        }
    }
}

impl From<Algorithm> for &'static str {
    fn from(algorithm: Algorithm) -> Self {
        algorithm.name()
    }
}

impl TryFrom<String> for Algorithm {
    type Error = UnknownChoice;

    fn try_from(given: String) -> Result<Self, UnknownChoice> {
        let law = given.parse().map(Self::Law).ok();
        law.or_else(|| given.parse().map(Self::Method).ok())
            .ok_or_else(|| UnknownChoice { given, accepted: [ControlLaw::NAMES, EstimatorMethod::NAMES].concat() })
    }
}

crate::section! {
    /// `[[process]]`.
    pub struct ProcessSection {
        /// Unique name, e.g. `rangefinder`.
        pub name: String = String::new(),
        /// Role of the process; default `other`.
        pub role: Role = Role::Other,
        /// Program and arguments. A name without a slash is searched in the folder of `nims`, then in PATH; a relative
        /// path starts at the folder of the system file, which is also the working folder. `{name}`, `{domain}`,
        /// `{system}` and `{run}` are replaced by the name of the process, the robot's domain, the run's copy of the
        /// system file and the run folder. A `.toml` file among the arguments is replaced by the run's copy of it.
        /// Empty, for a controller or an estimator: the standard program.
        pub command: Vec<String> = Vec::new(),
        /// Slot of a controller or estimator. Default: a, or b for a standby.
        #[serde(with = "crate::slot")]
        pub slot: Option<Slot> = None,
        /// A second controller or estimator, in slot b, that takes over when the first one dies.
        pub standby: bool = false,
        /// Law or method of a controller or estimator without a `command`; default: as configured.
        pub law: Option<Algorithm> = None,
        /// False: started only by `nims start` or `nims swap`.
        pub start: bool = true,
        /// Restart the process when it dies. Default: true for a recorder and for a role with a standby, otherwise
        /// false.
        pub restart: Option<bool> = None,
        /// Pause before a restart, s; doubles with each restart, up to 30 s.
        pub restart_pause_s: f64 = 0.5 => between(0.1, 30.0, "s"),
        /// Largest number of consecutive restarts; a recorder is restarted without limit.
        pub restart_limit: u32 = 3 => between(1.0, 1000.0, ""),
        /// Time for which a process must be ready to reset the count of its restarts, s.
        pub restart_forgive_s: f64 = 60.0 => between(0.1, 3600.0, "s"),
        /// SCHED_FIFO priority, 1 to 90; 0: ordinary. That of the control chain is in `[realtime]`.
        pub priority: u8 = 0 => between(0.0, 90.0, "(0: ordinary)"),
        /// CPU of the process; default: any.
        pub cpu: Option<usize> = None,
    }
}

impl ProcessSection {
    /// Returns the slot; only controllers and estimators have one.
    #[must_use]
    pub fn slot(&self) -> Slot {
        self.slot.unwrap_or(if self.standby { Slot::B } else { Slot::A })
    }
}

/// Checks the processes of a system file.
pub(crate) fn check(list: &[ProcessSection]) -> Result<(), Problem> {
    for (index, process) in list.iter().enumerate() {
        let here =
            |problem: Problem| problem.within(&format!("process.{index}"), &format!("process \"{}\"", process.name));
        process_name(&process.name, process.role, process.slot()).map_err(here)?;
        if list[..index].iter().any(|other| other.name == process.name) {
            let sentence = format!("two processes are called \"{}\"; accepted: each name once", process.name);
            return Err(here(Problem::with_sentence("name", sentence)));
        }
        place_of_process(process, &list[..index]).map_err(here)?;
        process_keys(process).map_err(here)?;
    }
    Ok(())
}

/// Checks that a role has at most one process, or one in each slot.
fn place_of_process(process: &ProcessSection, others: &[ProcessSection]) -> Result<(), Problem> {
    let slots = process.role.has_slots();
    let same_place = |other: &&ProcessSection| {
        other.start && other.role == process.role && (!slots || other.slot() == process.slot())
    };
    if process.role == Role::Other || !process.start {
        return Ok(());
    }
    let Some(other) = others.iter().find(same_place) else { return Ok(()) };
    let place = if slots { format!(" in slot {}", process.slot().name()) } else { String::new() };
    let sentence = format!(
        "the processes \"{}\" and \"{}\" both have the `role` \"{}\"{place}; accepted: one, which replaces the standard process; give the other `start = false`{}",
        other.name,
        process.name,
        process.role.name(),
        if slots { " or `standby = true`" } else { "" }
    );
    Err(Problem::with_sentence("role", sentence))
}

/// Rejects reserved names: each standard name belongs to its role and slot.
pub(crate) fn process_name(given: &str, role: Role, slot: Slot) -> Result<(), Problem> {
    let refuse = |sentence: String| Err(Problem::with_sentence("name", sentence));
    names::check("name", given)?;
    if given == "nims" {
        return refuse("the process name \"nims\" belongs to the supervisor; choose another name".to_owned());
    }
    for (_, owner) in Role::STANDARD {
        let of_slot = |slot| owner.process_name(slot) == given;
        if owner != role && (of_slot(Slot::A) || owner.has_slots() && of_slot(Slot::B)) {
            let owner = owner.name();
            return refuse(format!("the process name \"{given}\" belongs to the role {owner}; choose another name"));
        }
        if owner == role && role.has_slots() && Slot::ALL.iter().any(|other| *other != slot && of_slot(*other)) {
            return refuse(format!("the process name \"{given}\" belongs to the other slot; choose another name"));
        }
    }
    Ok(())
}

fn process_keys(process: &ProcessSection) -> Result<(), Problem> {
    let own = &process.name;
    let (role, slots) = (process.role, process.role.has_slots());
    if process.command.first().is_some_and(String::is_empty) || process.command.is_empty() && !slots {
        return Err(Problem::with_clause("command", "is empty; accepted: a program and its arguments"));
    }
    if !slots && (process.slot.is_some() || process.standby || process.law.is_some()) {
        return Err(Problem::with_sentence(
            "role",
            format!(
                "process \"{own}\" has `slot`, `standby` or `law`; accepted: only with the roles controller and estimator"
            ),
        ));
    }
    if process.standby && process.slot() == Slot::A {
        let sentence = format!("the standby \"{own}\" is in slot a; accepted: slot b");
        return Err(Problem::with_sentence("slot", sentence));
    }
    if process.law.is_some() && !process.command.is_empty() {
        let sentence = format!("process \"{own}\" has a `law` and a `command`; accepted: one of them");
        return Err(Problem::with_sentence("law", sentence));
    }
    if let Some(law) = process.law.filter(|law| law.role() != role) {
        let accepted = role.algorithms().join(", ");
        return Err(Problem::with_clause("law", format!("is \"{}\"; accepted: {accepted}", law.name())));
    }
    process.check_ranges("")?;
    if matches!(role, Role::MotorIo | Role::Estimator | Role::Controller)
        && (process.priority > 0 || process.cpu.is_some())
    {
        let sentence =
            format!("process \"{own}\" belongs to the control chain; set its `priority` and `cpu` in [realtime]");
        return Err(Problem::with_sentence(if process.priority > 0 { "priority" } else { "cpu" }, sentence));
    }
    Ok(())
}
