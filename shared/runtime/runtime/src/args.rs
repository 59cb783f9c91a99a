//! The arguments that every process has.

use std::path::PathBuf;

use config::{ConfigError, Slot, SystemFile};

/// Arguments of every process; flatten them into its own.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct CommonArgs {
    /// System file: which robot, which processes, their parameters.
    #[arg(long = "system", value_name = "FILE")]
    pub system_file: Option<PathBuf>,
    /// Name of this process; unique in its domain. Default: its role, with `-b` behind it in slot b.
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Domain in shared memory: a name, or the absolute path of a folder on tmpfs. Default: the name of the box.
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Slot of its role.
    #[arg(long, value_enum, default_value_t)]
    pub slot: Slot,
    /// Log debug events too.
    #[arg(long, short)]
    pub verbose: bool,
}

impl CommonArgs {
    /// The name of this process.
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
    /// What [`SystemFile::load`] refuses.
    pub fn load_system(&self) -> Result<Option<SystemFile>, ConfigError> {
        self.system_file.as_deref().map(SystemFile::load).transpose()
    }
}

/// The arguments of a process that needs no others.
#[derive(Debug, Clone, Default, clap::Parser)]
pub struct Args {
    /// As every process.
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
    /// As every process.
    #[command(flatten)]
    pub common: CommonArgs,
    /// Law of the controller, or method of the estimator, in place of the one in the system file.
    #[arg(long, value_name = "NAME")]
    pub law: Option<String>,
}

impl AsRef<CommonArgs> for VariantArgs {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}
