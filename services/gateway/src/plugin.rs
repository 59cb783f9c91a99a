//! Plug-ins: programs of the system file that another user runs. The service manager starts them, each in a unit of a
//! template, because the robot's user has no right to start a program as another user.

use command::{Answer, Failure};
use config::SystemFile;
use robot_state::Reason;
use robot_state::answers::detail;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

/// Folder that exists where systemd runs.
const SYSTEMD: &str = "/run/systemd/system";

/// What to do with a plug-in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verb {
    /// Start it, if it does not run.
    Start,
    /// Stop it.
    Stop,
    /// Stop and start it.
    Restart,
}

impl Verb {
    fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Stop => "stop",
            Self::Restart => "restart",
        }
    }
}

/// Name of the unit of a plug-in.
#[must_use]
pub fn unit(robot: &str, plugin: &str) -> String {
    format!("nims-plugin@{robot}:{plugin}.service")
}

/// Asks the service manager, which asks polkit whether the robot's user may.
pub(crate) fn carry_out(robot: &str, plugin: &str, verb: Verb) -> Reason {
    let failed =
        |why: &str| Reason::PluginFailed { plugin: detail(plugin), verb: detail(verb.name()), why: detail(why) };
    if !Path::new(SYSTEMD).is_dir() {
        return failed("systemd does not run here; start its program by hand, as another user of the socket's group");
    }
    let unit = unit(robot, plugin);
    let asked = Command::new("systemctl").args(["--no-ask-password", "--quiet", verb.name(), &unit]).output();
    match asked {
        Ok(output) if output.status.success() => match verb {
            Verb::Stop => Reason::PluginStopped { plugin: detail(plugin) },
            Verb::Start | Verb::Restart => Reason::PluginStarted { plugin: detail(plugin), unit: detail(unit) },
        },
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            failed(said.lines().next().unwrap_or("systemctl gives no reason"))
        }
        Err(error) => failed(&format!("systemctl: {error}")),
    }
}

/// Becomes the program of a plug-in, with the gateway's socket and its own name in its environment. To be called as the
/// user of the plug-ins.
///
/// # Errors
/// The system file declares no such program, or it cannot be started; on success it does not return.
pub fn exec(system: &Path, plugin: &str, socket: &Path) -> Answer {
    let file = SystemFile::load(system).map_err(Failure::bad)?;
    let unknown =
        || Failure::BadInput(format!("{} declares no [[plugin]] \"{plugin}\" with a command", system.display()));
    let declared = file.plugin.iter().find(|one| one.name == plugin).ok_or_else(unknown)?;
    let (program, arguments) = declared.command.split_first().ok_or_else(unknown)?;
    let error = Command::new(program)
        .args(arguments)
        .env("NIMS_GATEWAY", socket)
        .env("NIMS_NAME", plugin)
        .env_remove("NIMS_TOKEN")
        .exec();
    Err(Failure::NotNow(format!("{program} cannot be started: {error}")))
}
