//! Plug-ins: programs of the system file that another user runs. The service manager starts them, each in a unit of a
//! template, because the robot's user has no right to start a program as another user.

use config::PluginSection;
use robot_state::Reason;
use robot_state::answers::detail;
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

/// Templates of the units: without a network, and with it.
pub(crate) const TEMPLATE: &str = "nims-plugin";
pub(crate) const WITH_NETWORK: &str = "nims-plugin-network";
/// Most characters of the names of a robot's file and a plug-in together: the unit's user is `_ROBOT_NAME`, and the
/// name of a user has at most 31.
pub(crate) const NAMES: usize = 29;
/// Ending of a unit's name.
const SERVICE: &str = ".service";

/// Name of the unit of a plug-in. `robot`: the name of the system file without its ending, as in the robot's service.
#[must_use]
pub fn unit(robot: &str, plugin: &PluginSection) -> String {
    let template = if plugin.network { WITH_NETWORK } else { TEMPLATE };
    format!("{template}@{robot}_{}{SERVICE}", plugin.name)
}

/// A unit of a plug-in, by its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PluginUnit {
    /// The name of the robot's system file without its ending.
    pub robot: String,
    /// Name of the plug-in.
    pub plugin: String,
}

impl PluginUnit {
    /// Reads the name of a unit; `None` if it is not that of a plug-in.
    #[must_use]
    pub fn parse(unit: &str) -> Option<Self> {
        let (template, instance) = unit.strip_suffix(SERVICE)?.split_once('@')?;
        // The name of a plug-in has no `_`.
        let (robot, plugin) = instance.rsplit_once('_')?;
        let is_ours = template == TEMPLATE || template == WITH_NETWORK;
        is_ours.then(|| Self { robot: robot.to_owned(), plugin: plugin.to_owned() })
    }

    /// Reads the unit in the control groups of a process, as `/proc/PID/cgroup` lists them. Only the service manager
    /// puts a process into the group of a unit, and a unit without delegation cannot leave it.
    #[must_use]
    pub fn of_groups(groups: &str) -> Option<Self> {
        let path = groups.lines().find_map(|line| {
            let (_, rest) = line.split_once(':')?;
            let (controllers, path) = rest.split_once(':')?;
            (controllers.is_empty() || controllers == "name=systemd").then_some(path)
        })?;
        // Below slices; what is further below is made by the unit itself, e.g. by the manager of a user.
        let mut parts = path.split('/').filter(|part| !part.is_empty());
        Self::parse(parts.find(|part| !part.ends_with(".slice"))?)
    }
}

/// Asks the service manager, which asks polkit whether the robot's user may.
pub(crate) fn carry_out(unit: &str, plugin: &str, verb: Verb) -> Reason {
    let failed =
        |why: &str| Reason::PluginFailed { plugin: detail(plugin), verb: detail(verb.name()), why: detail(why) };
    if !Path::new(SYSTEMD).is_dir() {
        return failed("systemd does not run here; start its program by hand, as another user of the socket's group");
    }
    let asked = Command::new("systemctl").args(["--no-ask-password", "--quiet", verb.name(), unit]).output();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_names_its_robot_and_its_plug_in() {
        for network in [false, true] {
            let section = PluginSection { name: "soil-2".to_owned(), network, ..PluginSection::default() };
            let (robot, plugin) = ("lab-1".to_owned(), "soil-2".to_owned());
            assert_eq!(PluginUnit::parse(&unit("lab-1", &section)), Some(PluginUnit { robot, plugin }));
        }
        for other in
            ["nims@lab.service", "nims-plugin@lab.service", "nims-plugin@lab_soil.scope", "x@lab_soil.service", ""]
        {
            assert_eq!(PluginUnit::parse(other), None, "{other}");
        }
    }

    #[test]
    fn the_unit_of_a_process_is_the_one_that_the_service_manager_made() {
        let named = |groups: &str| PluginUnit::of_groups(groups).map(|unit| unit.plugin);
        let soil = Some("soil".to_owned());
        assert_eq!(named("0::/system.slice/system-nims\\x2dplugin.slice/nims-plugin@lab_soil.service\n"), soil);
        assert_eq!(named("0::/system.slice/nims-plugin-network@lab_soil.service/sub\n"), soil);
        let both = "12:cpu:/\n1:name=systemd:/system.slice/nims-plugin@lab_soil.service\n0::/\n";
        assert_eq!(named(both), soil);
        // A user can make a group of any name below its own manager, and a service with delegation below itself.
        for forged in [
            "0::/user.slice/user-800.slice/user@800.service/app.slice/nims-plugin@lab_soil.service\n",
            "0::/system.slice/docker.service/nims-plugin@lab_soil.service\n",
            "0::/user.slice/user-800.slice/session-3.scope/nims-plugin@lab_soil.service\n",
            "0::/nims-plugin/nims-plugin@lab_soil.service\n",
            "0::/\n",
            "",
            "nonsense",
        ] {
            assert_eq!(named(forged), None, "{forged}");
        }
    }
}
