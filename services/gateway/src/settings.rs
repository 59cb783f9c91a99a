//! The arguments of the gateway, and what follows from them.

use crate::plugin::unit;
use bus::Domain;
use client::Running;
use command::{Answer, Failure};
use config::{GatewaySection, PluginSection, SystemFile};
use gateway_protocol::SOCKET_ENDING;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The way of operators who are not the robot's user to the robot.
///
/// Runs as the robot's user beside `nims up`, before and after it too. See docs/gateway.md.
#[derive(Debug, clap::Parser)]
#[command(name = "gateway", version = runtime::build::description())]
pub struct Args {
    /// System file of the robot: its name, its runs folder and `[gateway]`. Default: that of the robot that has started
    /// it (`nims plug gateway -- gateway`).
    #[arg(long, value_name = "FILE")]
    pub system: Option<PathBuf>,
    /// Domain of the robot: a name, or the path of a folder; default: that of the robot that has started it, otherwise
    /// the name of the system.
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Folder of the socket NAME.sock, or the socket itself if this ends in `.sock`; default: the runtime folder of the
    /// service (RUNTIME_DIRECTORY), otherwise the state folder.
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Folder in which the tokens are stored; default: the folder `state` beside the runs.
    #[arg(long, value_name = "FOLDER")]
    pub state: Option<PathBuf>,
    /// Becomes the program of this plug-in of the system file instead, in the unit of the plug-in.
    #[arg(long, value_name = "NAME")]
    pub plugin: Option<String>,
    /// With --plugin: the unit has a network, and the plug-in has to declare it.
    #[arg(long, requires = "plugin")]
    pub network: bool,
    /// With --plugin: only checks that the system file declares it.
    #[arg(long, requires = "plugin")]
    pub declared: bool,
}

impl Args {
    /// The system file of the robot.
    ///
    /// # Errors
    /// None is named, and no robot has started this process.
    pub(crate) fn system_file(&self) -> Answer<PathBuf> {
        let of_the_robot = || {
            let domain = Domain::existing(&domain_of_the_robot()?).ok().flatten()?;
            Some(Running::read(&domain)?.system_file)
        };
        let missing = || {
            let cure =
                "name the system file of the robot, or start it with the robot by `nims plug gateway -- gateway`";
            Failure::BadInput(format!("--system is missing: {cure}"))
        };
        self.system.clone().or_else(of_the_robot).ok_or_else(missing)
    }
}

/// What the gateway needs to know.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The system file.
    pub system: PathBuf,
    /// Name of the robot.
    pub name: String,
    /// Name of the system file without its ending: that of the services, whose paths it is in.
    pub instance: String,
    /// Its domain.
    pub domain: String,
    /// The socket.
    pub socket: PathBuf,
    /// The folder of its runs.
    pub runs: PathBuf,
    /// The file of its tokens.
    pub tokens: PathBuf,
    /// The roles.
    pub section: GatewaySection,
    /// The declared plug-ins.
    pub plugins: Vec<PluginSection>,
}

impl Settings {
    /// Reads the system file.
    ///
    /// # Errors
    /// It is not accepted.
    pub fn new(args: &Args) -> Answer<Self> {
        let system = args.system_file()?;
        let file = SystemFile::load(&system).map_err(Failure::bad)?;
        let state = args.state.clone().unwrap_or_else(|| file.state_folder());
        let folder = args.socket.clone().unwrap_or_else(|| runtime_folder().unwrap_or_else(|| state.clone()));
        let is_socket = folder.extension().is_some_and(|ending| ending.to_string_lossy() == SOCKET_ENDING[1..]);
        let socket = if is_socket { folder } else { folder.join(format!("{}{SOCKET_ENDING}", file.name)) };
        Ok(Self {
            system: std::path::absolute(&system).map_err(Failure::bad)?,
            instance: instance(&system),
            domain: args.domain.clone().or_else(domain_of_the_robot).unwrap_or_else(|| file.name.clone()),
            socket,
            tokens: state.join(format!("tokens-{}.json", file.name)),
            runs: file.runs,
            name: file.name,
            section: file.gateway,
            plugins: file.plugin,
        })
    }
}

impl Settings {
    /// The plug-ins that the service manager starts with the gateway.
    #[must_use]
    pub(crate) fn started(&self) -> Vec<String> {
        let started = self.plugins.iter().filter(|plugin| plugin.start && !plugin.command.is_empty());
        started.map(|plugin| plugin.name.clone()).collect()
    }

    /// The units of the plug-ins by name.
    pub(crate) fn units(&self) -> BTreeMap<String, String> {
        let units = self.plugins.iter().map(|plugin| (plugin.name.clone(), unit(&self.instance, plugin)));
        units.collect()
    }
}

/// The name of a system file without its ending: the robot's name in units of the service manager.
pub(crate) fn instance(system: &Path) -> String {
    system.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The domain of the robot whose supervisor has started this process.
fn domain_of_the_robot() -> Option<String> {
    std::env::var(runtime::DOMAIN_VARIABLE).ok().filter(|domain| !domain.is_empty())
}

/// The folder that a service manager has made for this service.
fn runtime_folder() -> Option<PathBuf> {
    let given = std::env::var("RUNTIME_DIRECTORY").ok()?;
    given.split(':').next().filter(|first| !first.is_empty()).map(PathBuf::from)
}
