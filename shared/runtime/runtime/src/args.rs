//! The command-line arguments of every process.

use std::path::PathBuf;

use config::{ConfigError, SystemFile};
use messages::Slot;

/// The arguments of every process, to be flattened into those of a program.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct CommonArgs {
    /// System file: the robot, its processes and their parameters.
    #[arg(long = "system", value_name = "FILE")]
    pub system_file: Option<PathBuf>,
    /// Name of this process; unique in its domain. Default: its role, with `-b` appended in slot b.
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Domain in shared memory: a name, or the absolute path of a folder on tmpfs. Default: the name of the system.
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Slot of this process in its role.
    #[arg(long, value_parser = config::slot_argument(), default_value = Slot::A.name())]
    pub slot: Slot,
    /// Log debug events too.
    #[arg(long, short)]
    pub verbose: bool,
}

impl CommonArgs {
    /// Returns the name of this process.
    #[must_use]
    pub fn name_for(&self, role: &str) -> String {
        match (&self.name, self.slot) {
            (Some(name), _) => name.clone(),
            (None, Slot::A) => role.to_owned(),
            (None, Slot::B) => format!("{role}-b"),
        }
    }

    /// Reads the system file, if one is given.
    ///
    /// # Errors
    /// As [`SystemFile::load`].
    pub fn load_system(&self) -> Result<Option<SystemFile>, ConfigError> {
        self.system_file.as_deref().map(SystemFile::load).transpose()
    }
}

/// The arguments of a process without additional ones.
#[derive(Debug, Clone, Default, clap::Parser)]
pub struct Args {
    /// The arguments of every process.
    #[command(flatten)]
    pub common: CommonArgs,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

/// The arguments of a controller or an estimator.
#[derive(Debug, Clone, Default, clap::Parser)]
pub struct VariantArgs {
    /// The arguments of every process.
    #[command(flatten)]
    pub common: CommonArgs,
    /// Law of the controller or method of the estimator; default: as in the system file.
    #[arg(long, value_name = "NAME")]
    pub law: Option<String>,
    /// Custom law or method in any language: the command of its program, which answers cycle by cycle over a pipe.
    #[arg(long, value_name = "COMMAND", conflicts_with = "law")]
    pub program: Option<String>,
}

impl AsRef<CommonArgs> for VariantArgs {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}
