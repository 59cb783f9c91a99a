//! Where the processes of a way run.

use anyhow::{Result, bail};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Real-time priority of both ends on cores of their own choice.
const PRIORITY: &str = "50";

/// Where the processes of a way run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Where the kernel puts them.
    Any,
    /// All on the first processor, with real-time priority.
    OneCore,
    /// The sender on the first and the receivers on the second processor, with real-time priority; both are kept awake.
    TwoCores,
}

impl Place {
    /// Returns the place of a name.
    pub fn named(name: &str) -> Result<Self> {
        Ok(match name {
            "any" => Self::Any,
            "one-core" => Self::OneCore,
            "two-cores" => Self::TwoCores,
            _ => bail!("{name} is no place; accepted: any, one-core, two-cores"),
        })
    }

    /// Returns the command of this program as sender or receiver.
    pub fn command(self, program: &Path, role: &str) -> Command {
        let core = match (self, role) {
            (Self::Any, _) => return Command::new(program),
            (Self::TwoCores, "receive") => "1",
            _ => "0",
        };
        let mut command = Command::new("chrt");
        command.args(["-f", PRIORITY, "taskset", "-c", core]).arg(program);
        command
    }

    /// Starts what keeps two processors awake, at the lowest priority.
    pub fn keep_awake(self, program: &Path) -> Result<Vec<Spinning>> {
        let cores: &[&str] = if self == Self::TwoCores { &["0", "1"] } else { &[] };
        let spin = |core: &&str| {
            let mut command = Command::new("chrt");
            command.args(["-i", "0", "taskset", "-c", core]).arg(program).arg("spin").stdin(Stdio::null());
            Ok(Spinning(command.spawn()?))
        };
        cores.iter().map(spin).collect()
    }
}

/// A process that keeps a processor awake; killed when dropped.
pub struct Spinning(Child);

impl Drop for Spinning {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
