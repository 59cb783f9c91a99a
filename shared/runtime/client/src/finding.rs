//! Finding the way to a robot.

use crate::link::{Gateway, RobotLink};
use crate::robot;
use bus::{Bus, Participant};
use command::{Answer, Failure};
use gateway_protocol::{SOCKET_ENDING, SOCKETS};
use std::path::{Path, PathBuf};

/// Environment variable with the socket of a gateway, as `--gateway`.
pub const GATEWAY_VARIABLE: &str = "NIMS_GATEWAY";
/// Name under which a command joins a domain.
const NAME: &str = "nims-command";

/// Where the robot of a command is.
#[derive(Debug, Clone, Copy, Default)]
pub struct Place<'a> {
    /// Domain; `None`: that of the only running robot.
    pub domain: Option<&'a str>,
    /// Socket of a gateway; `None`: only where no robot of this user is meant.
    pub gateway: Option<&'a Path>,
}

/// Returns the way to a robot: shared memory if a robot of this user runs, otherwise the gateway, which stderr names.
///
/// # Errors
/// No robot runs, several run and none is named, or the robot is out of reach for this user.
pub fn link(place: Place<'_>) -> Answer<RobotLink> {
    link_as(place, Participant::Command)
}

/// [`link`] as another party: a command that stops the robot may take every place, an observer leaves places free.
///
/// # Errors
/// As [`link`].
pub fn link_as(place: Place<'_>, party: Participant) -> Answer<RobotLink> {
    if let Some(path) = given(place) {
        return Ok(RobotLink::Gateway(Gateway::connect(&path)?));
    }
    link_in(Path::new(SOCKETS), place, party)
}

fn link_in(sockets: &Path, place: Place<'_>, party: Participant) -> Answer<RobotLink> {
    bus::make_private();
    match robot::domain(place.domain) {
        // A failure of this user's own robot is the answer: the gateway may be that of another robot.
        Ok(domain) => Ok(Bus::join_as(&domain, NAME, party)?.into()),
        Err(failure) => Ok(RobotLink::Gateway(instead(sockets, place, failure)?)),
    }
}

/// Returns the gateway that a command uses by itself, if no robot of this user is meant.
fn instead(sockets: &Path, place: Place<'_>, failure: Failure) -> Answer<Gateway> {
    if robot::runs(place.domain) {
        return Err(failure);
    }
    let gateway = gateway_for(sockets, place, failure)?;
    eprintln!("nims: through the gateway of {}", gateway.0.robot());
    Ok(gateway)
}

/// Returns the gateway of a robot, also if its shared memory could be joined.
///
/// # Errors
/// There is none, or several and none is named.
pub fn gateway(place: Place<'_>) -> Answer<Gateway> {
    match given(place) {
        Some(path) => Gateway::connect(&path),
        None => {
            let none = Failure::NotNow(format!("no gateway runs here; sockets lie in {SOCKETS}"));
            gateway_for(Path::new(SOCKETS), place, none)
        }
    }
}

/// Sends an emergency stop, without a place on the bus and without shared memory, or through the robot's gateway. It
/// warns after a second without an answer, keeps trying, and leaves the request for a suspended motor-io.
///
/// # Errors
/// motor-io does not run, or does not answer.
pub fn emergency_stop(place: Place<'_>) -> Answer<String> {
    let stopped = |gateway: Gateway| Failure::unless_accepted(&gateway.emergency_stop()?);
    if let Some(path) = given(place) {
        return robot::helped(Gateway::connect(&path).and_then(stopped));
    }
    match robot::listening(place.domain) {
        Ok(domain) => robot::emergency_stop(&domain),
        Err(failure) => robot::helped(instead(Path::new(SOCKETS), place, failure).and_then(stopped)),
    }
}

/// Returns the socket of the gateway of a robot, without connecting to it.
///
/// # Errors
/// There is none, or several and none is named.
pub fn gateway_socket(place: Place<'_>) -> Answer<PathBuf> {
    if let Some(path) = given(place) {
        return Ok(path);
    }
    let mut found = sockets(Path::new(SOCKETS), place.domain);
    match (found.pop(), found.len()) {
        (Some(only), 0) => Ok(only),
        (Some(_), _) => {
            Err(Failure::NotNow(format!("several robots have a gateway in {SOCKETS}; name one with --gateway")))
        }
        (None, _) => Err(Failure::NotNow(format!("no gateway runs here; sockets lie in {SOCKETS}"))),
    }
}

fn given(place: Place<'_>) -> Option<PathBuf> {
    let of_environment = || std::env::var_os(GATEWAY_VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from);
    // A domain that is named on the command line is meant.
    let unnamed = place.domain.is_none();
    place.gateway.map(Path::to_owned).or_else(|| of_environment().filter(|_| unnamed))
}

/// Returns the gateway that stands for a robot out of reach; without one, the robot's own failure is the reason.
fn gateway_for(folder: &Path, place: Place<'_>, failure: Failure) -> Answer<Gateway> {
    let sockets = sockets(folder, place.domain);
    let mut found = Vec::new();
    let mut closed = None;
    for path in &sockets {
        match Gateway::connect(path) {
            Ok(gateway) => found.push(gateway),
            Err(why) => closed = Some(why),
        }
    }
    match (found.pop(), found.is_empty()) {
        (Some(only), true) => Ok(only),
        (Some(last), false) => {
            let names = found.iter().chain([&last]).map(|gateway| gateway.0.robot()).collect::<Vec<_>>().join(", ");
            Err(Failure::NotNow(format!("several robots have a gateway ({names}): choose one with --domain NAME")))
        }
        (None, _) => Err(closed.unwrap_or(failure)),
    }
}

/// Returns the sockets of a domain in a folder, or all of them. The domain of a service is `/run/nims-NAME`; a robot in
/// another folder has none here.
fn sockets(folder: &Path, domain: Option<&str>) -> Vec<PathBuf> {
    let wanted = domain.map(|domain| {
        let name = domain.strip_prefix("/run/nims-").unwrap_or(domain);
        format!("{name}{SOCKET_ENDING}")
    });
    let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let is_wanted = |name: &str| name.ends_with(SOCKET_ENDING) && wanted.as_ref().is_none_or(|wanted| wanted == name);
    let mut paths: Vec<PathBuf> =
        names.filter(|name| name.to_str().is_some_and(is_wanted)).map(|name| folder.join(name)).collect();
    paths.sort();
    paths
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::Domain;
    use gateway_protocol::{Reply, VERSION, encode};
    use std::io::Write;

    #[test]
    fn a_service_is_found_by_its_name_and_by_its_domain() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["lab.sock", "field.sock", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let of = |domain| {
            let found = sockets(folder.path(), domain);
            found.iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(of(None), ["field.sock", "lab.sock"]);
        assert_eq!(of(Some("lab")), ["lab.sock"]);
        assert_eq!(of(Some("/run/nims-lab")), ["lab.sock"]);
        assert_eq!(of(Some("other")), [""; 0]);
        // Another folder is another robot.
        assert_eq!(of(Some("../lab")), [""; 0]);
        assert_eq!(of(Some("/home/ada/lab")), [""; 0]);
        assert_eq!(of(Some("/home/ada/nims-lab")), [""; 0]);
    }

    /// Serves connections that say hello as the gateway of `lab`.
    fn gateway_of_lab(socket: &Path) {
        let listener = std::os::unix::net::UnixListener::bind(socket).unwrap();
        std::thread::spawn(move || {
            let mut kept = Vec::new();
            for stream in listener.incoming() {
                let mut stream = stream.unwrap();
                let named = || "lab".to_owned();
                let welcome = Reply::Welcome { version: VERSION, robot: named(), user: named(), role: named() };
                stream.write_all(&encode(&welcome.header(), &[])).unwrap();
                kept.push(stream);
            }
        });
    }

    #[test]
    fn a_failure_of_the_own_robot_never_leads_to_the_gateway_of_another_one() {
        let folder = tempfile::tempdir().unwrap();
        let domain = Domain::for_test();
        for name in ["lab", domain.name()] {
            gateway_of_lab(&folder.path().join(format!("{name}{SOCKET_ENDING}")));
        }
        fn place(name: &str) -> Place<'_> {
            Place { domain: Some(name), gateway: None }
        }
        let failed = || Failure::NotNow("no place is free".to_owned());
        let go = |name| link_in(folder.path(), place(name), Participant::Guest);
        // No robot of this user runs in this domain.
        let absent = go("lab").unwrap();
        assert!(matches!(&absent, RobotLink::Gateway(gateway) if gateway.0.robot() == "lab"), "{absent:?}");
        assert!(instead(folder.path(), place(domain.name()), failed()).is_ok());
        // One runs, and cannot be joined, or is one of several.
        let _robot = Bus::join(&domain, "motor-io").unwrap();
        assert_eq!(instead(folder.path(), place(domain.name()), failed()).err(), Some(failed()));
        assert_eq!(instead(folder.path(), Place::default(), failed()).err(), Some(failed()));
        assert!(matches!(go(domain.name()), Ok(RobotLink::Bus(_))));
    }
}
