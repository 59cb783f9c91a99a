//! The page of a robot of this user in one command: a gateway of its own, the page, a paired browser.

use crate::here::{Here, PATH};
use crate::pair::{Listening, address, pairing};
use crate::server::serve_with;
use crate::settings::{PlaceArgs, StartArgs};
use command::{Answer, Failure, StopFlag};
use rustix::process::{Pid, Signal, kill_process};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Time for the gateway to open its socket.
const OPENED: Duration = Duration::from_secs(20);
/// Time between two looks for it.
const LOOK: Duration = Duration::from_millis(50);
/// Names of the browser that is opened, and of the one that is paired by the printed code.
const HERE: &str = "here";
const TABLET: &str = "tablet";

/// A gateway that is ended with this process, and the folder of its socket.
struct Gateway {
    child: Child,
    folder: PathBuf,
    socket: PathBuf,
}

impl Gateway {
    fn start(system: &Path, domain: Option<&str>) -> Answer<Self> {
        let program = std::env::current_exe().map_err(Failure::not_now)?.with_file_name("gateway");
        if !program.is_file() {
            let path = program.display();
            return Err(Failure::NotNow(format!(
                "there is no program {path}: build all programs with `cargo build --workspace`"
            )));
        }
        let folder = std::env::temp_dir().join(format!("nims-page-{}", std::process::id()));
        std::fs::create_dir(&folder)
            .map_err(|error| Failure::NotNow(format!("the folder {} cannot be created: {error}", folder.display())))?;
        let socket = folder.join("robot.sock");
        let mut command = Command::new(program);
        command.arg("--system").arg(system).arg("--socket").arg(&socket).stdin(Stdio::null());
        command.args(domain.into_iter().flat_map(|domain| ["--domain", domain]));
        match command.spawn() {
            Ok(child) => Ok(Self { child, folder, socket }),
            Err(error) => {
                let _ = std::fs::remove_dir(&folder);
                Err(Failure::NotNow(format!("the gateway cannot be started: {error}")))
            }
        }
    }

    /// Waits for its socket.
    fn opened(&mut self, stop: &StopFlag) -> Answer {
        let begun = Instant::now();
        while !self.socket.exists() {
            if stop.load(Ordering::Relaxed) {
                return Err(Failure::NotNow("a signal has ended the start".to_owned()));
            }
            if self.child.try_wait().map_err(Failure::not_now)?.is_some() {
                return Err(Failure::NotNow("the gateway has ended; its message above says why".to_owned()));
            }
            if begun.elapsed() > OPENED {
                return Err(Failure::NotNow(format!("the gateway has no socket after {} s", OPENED.as_secs())));
            }
            std::thread::sleep(LOOK);
        }
        Ok(())
    }
}

impl Drop for Gateway {
    fn drop(&mut self) {
        let _ = kill_process(Pid::from_child(&self.child), Signal::TERM);
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Serves the page of a robot of this user until a signal ends it.
///
/// # Errors
/// The gateway cannot be started, or the page cannot be served.
pub fn start(args: &StartArgs, place: &PlaceArgs, json: bool) -> Answer {
    bus::make_private();
    // A signal must not end this process before it has ended its gateway.
    let stop = command::stop_flag()?;
    let mut gateway = Gateway::start(&args.system, place.domain.as_deref())?;
    gateway.opened(&stop)?;
    let place = PlaceArgs { gateway: Some(gateway.socket.clone()), domain: None };
    if args.parent {
        let pid = rustix::process::getpid();
        std::thread::spawn(move || {
            // Ends when the parent closes it, or with the parent.
            let _ = std::io::stdin().read_to_end(&mut Vec::new());
            let _ = kill_process(pid, Signal::TERM);
        });
    }
    serve_with(&args.serve, &place, &stop, |listening, here| {
        if let Err(failure) = introduce(&listening, &place, here, !args.no_browser, json) {
            eprintln!("nims-page: {failure}");
        }
    })
}

/// Prints how a browser is paired, and opens one where there is a desktop.
fn introduce(listening: &Listening, place: &PlaceArgs, here: &Here, opens: bool, json: bool) -> Answer {
    let gateway = client::gateway(place.place())?;
    let url = listening.urls().into_iter().next().ok_or_else(|| {
        Failure::NotNow("this machine has no address at which a browser reaches the page; give --address".to_owned())
    })?;
    for holder in [HERE, TABLET] {
        // That of an earlier start.
        let _ = gateway.revoke_token(holder);
    }
    pairing((&url, listening.fingerprint.clone()), place, TABLET, "fly")?.print(json);
    let desktop =
        ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
    if opens && desktop {
        let (_, code, _) = address(&url, place, HERE, "fly")?;
        here.put(code);
        let mut command = Command::new("xdg-open");
        command
            .arg(format!("{}{PATH}", url.trim_end_matches('/')))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        if let Err(error) = command.spawn() {
            eprintln!("nims-page: no browser could be opened ({error}); open the address above");
        }
    }
    Ok(())
}
