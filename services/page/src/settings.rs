//! The arguments of the page.

use client::Place;
use gateway_protocol::SOCKETS;
use std::net::{IpAddr, Ipv4Addr};
use std::path::{Path, PathBuf};

/// A robot on a tablet: a web page of the robot, over its gateway.
#[derive(Debug, clap::Parser)]
#[command(name = "nims-page", version)]
pub struct Args {
    /// Which robot.
    #[command(flatten)]
    pub place: PlaceArgs,
    /// Print one JSON object on stdout.
    #[arg(long, global = true)]
    pub json: bool,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Which robot.
#[derive(Debug, Clone, clap::Args)]
pub struct PlaceArgs {
    /// Socket of the robot's gateway; default: NIMS_GATEWAY, otherwise the only one in /run/nims-gateway.
    #[arg(long, global = true, value_name = "SOCKET")]
    pub gateway: Option<PathBuf>,
    /// Name of the robot, where several have a gateway.
    #[arg(long, global = true, value_name = "NAME")]
    pub domain: Option<String>,
}

impl PlaceArgs {
    /// The place for the functions of `client`.
    #[must_use]
    pub fn place(&self) -> Place<'_> {
        Place { domain: self.domain.as_deref(), gateway: self.gateway.as_deref() }
    }
}

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Serves the page until it is ended.
    Serve(ServeArgs),
    /// Serves the page of a robot of this user, with a gateway of its own, and opens it where there is a desktop.
    Start(StartArgs),
    /// Prints a code that pairs one browser, and an address with it, also as a QR code.
    Pair(PairArgs),
    /// Lists the browsers that are paired.
    Tokens,
    /// Ends the pairing of a browser.
    Revoke {
        /// Name of the holder.
        #[arg(value_name = "NAME")]
        holder: String,
    },
}

/// The arguments of `serve`.
#[derive(Debug, Clone, clap::Args)]
pub struct ServeArgs {
    /// Address to listen on; 0.0.0.0: all of this machine. Other machines are served over HTTPS.
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub address: IpAddr,
    /// TCP port; 0: any free port.
    #[arg(long, value_name = "PORT", default_value_t = 8766)]
    pub port: u16,
    /// A further name by which browsers reach this machine; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub name: Vec<String>,
    /// Folder with the built page; default: `page` beside this program. Without it there is a plain page.
    #[arg(long, value_name = "FOLDER")]
    pub assets: Option<PathBuf>,
    /// Folder in which the certificate is stored; default: the state folder of the service (STATE_DIRECTORY), otherwise
    /// ~/.local/state/nims-page.
    #[arg(long, value_name = "FOLDER")]
    pub state: Option<PathBuf>,
}

/// The arguments of `start`.
#[derive(Debug, Clone, clap::Args)]
pub struct StartArgs {
    /// System file of the robot, which may be started before or after.
    #[arg(value_name = "SYSTEM")]
    pub system: PathBuf,
    /// Do not open a browser.
    #[arg(long)]
    pub no_browser: bool,
    /// End when standard input is closed.
    #[arg(long)]
    pub parent: bool,
    /// How it is served.
    #[command(flatten)]
    pub serve: ServeArgs,
}

/// The arguments of `pair`.
#[derive(Debug, Clone, clap::Args)]
pub struct PairArgs {
    /// Name of the holder, as the run records it.
    #[arg(value_name = "NAME")]
    pub holder: String,
    /// Role: look, stop or fly.
    #[arg(long, value_name = "ROLE", default_value = "fly")]
    pub role: String,
    /// The page's address, such as https://10.0.0.1:8766; default: where the page of this state folder listens.
    #[arg(long, value_name = "URL")]
    pub url: Option<String>,
    /// State folder of the page, as for `serve`; default: that of the page's service (/var/lib/nims-page/NAME) where
    /// the gateway is a service.
    #[arg(long, value_name = "FOLDER")]
    pub state: Option<PathBuf>,
}

/// The state folders of the pages that run as services (`nims-page@.service`).
const OF_SERVICES: &str = "/var/lib/nims-page";

/// The state folder of the page of the robot with this gateway.
pub(crate) fn state_of(given: Option<&PathBuf>, gateway: Option<&Path>) -> PathBuf {
    let service = gateway.filter(|socket| socket.parent() == Some(Path::new(SOCKETS))).and_then(Path::file_stem);
    match (given, service) {
        (None, Some(name)) => Path::new(OF_SERVICES).join(name),
        _ => state_folder(given),
    }
}

/// The folder of the certificate and of the page's address.
#[must_use]
pub fn state_folder(given: Option<&PathBuf>) -> PathBuf {
    let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let home = || variable("HOME").unwrap_or_default().join(".local/state");
    given
        .cloned()
        .or_else(|| variable("STATE_DIRECTORY"))
        .unwrap_or_else(|| variable("XDG_STATE_HOME").unwrap_or_else(home).join("nims-page"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_of_a_service_has_the_state_folder_of_its_service() {
        let of = |gateway: &str| state_of(None, Some(Path::new(gateway)));
        assert_eq!(of("/run/nims-gateway/lab.sock"), Path::new("/var/lib/nims-page/lab"));
        for other in ["/tmp/lab.sock", "/run/nims-gateway/below/lab.sock", "lab.sock"] {
            assert_eq!(of(other), state_folder(None), "{other}");
        }
        let given = PathBuf::from("/tmp/page");
        assert_eq!(state_of(Some(&given), Some(Path::new("/run/nims-gateway/lab.sock"))), given);
    }
}
