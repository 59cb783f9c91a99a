//! The process: opens the port, observes the robot, serves until it is ended.

use crate::app::{App, Downloads, Places};
use crate::assets::{Assets, folder};
use crate::certificate::certificate;
use crate::gather::gather;
use crate::here::Here;
use crate::http::router;
use crate::listener::listen;
use crate::observer::{Topics, observe};
use crate::pair::{Listening, reached};
use crate::places::Conversations;
use crate::settings::{PlaceArgs, ServeArgs, state_folder};
use command::{Answer, Failure, StopFlag};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::Semaphore;

/// Serves the page until a signal ends it.
///
/// # Errors
/// The address is in use or not of this machine, or the certificate cannot be made.
pub fn serve(args: &ServeArgs, place: &PlaceArgs) -> Answer {
    serve_with(args, place, &command::stop_flag()?, |_, _| {})
}

/// Serves the page; `listens` is told where, before the first browser. `stop`: a signal has come since the program
/// began.
///
/// # Errors
/// As [`serve`].
pub(crate) fn serve_with(
    args: &ServeArgs,
    place: &PlaceArgs,
    stop: &StopFlag,
    listens: impl FnOnce(Listening, &Here),
) -> Answer {
    bus::make_private();
    // The page must not delay the robot's processes.
    let _ = rustix::process::nice(10);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::not_now)?;
    runtime.block_on(run(args, place, stop, listens))
}

async fn run(args: &ServeArgs, place: &PlaceArgs, stop: &StopFlag, listens: impl FnOnce(Listening, &Here)) -> Answer {
    let awaited = |kind| signal(kind).map_err(Failure::not_now);
    let mut interrupted = awaited(SignalKind::interrupt())?;
    let mut terminated = awaited(SignalKind::terminate())?;
    let mut hung_up = awaited(SignalKind::hangup())?;
    // What comes from here on is seen below.
    if stop.load(Ordering::Relaxed) {
        return Ok(());
    }
    let address = SocketAddr::new(args.address, args.port);
    let refused = |error: std::io::Error| {
        Failure::NotNow(format!("cannot listen at {address}: {error}; choose others with --address and --port"))
    };
    let listener = TcpListener::bind(address).await.map_err(refused)?;
    let port = listener.local_addr().map_err(Failure::not_now)?.port();
    let names = names(&args.name);
    let addresses = reached(args.address);
    let state = state_folder(args.state.as_ref());
    let secure = !args.address.is_loopback();
    let made = secure
        .then(|| {
            let stated: Vec<String> = names.iter().cloned().chain(addresses.iter().map(IpAddr::to_string)).collect();
            certificate(&state, &stated)
        })
        .transpose()?;
    let fingerprint = made.as_ref().map(|made| made.fingerprint.clone());
    let listening = Listening { address: args.address, port, fingerprint };
    // Before it is said, so that a browser can be paired from then on.
    if let Err(failure) = listening.write(&state) {
        eprintln!("nims-page: `nims page pair` needs --url: {failure}");
    }
    for url in listening.urls() {
        eprintln!("nims-page: open {url}/");
    }
    if let Some(fingerprint) = &listening.fingerprint {
        eprintln!("nims-page: fingerprint of the certificate (SHA-256): {fingerprint}");
    }
    let assets = Assets::read(&folder(args.assets.as_deref()));
    if !assets.are_there() {
        eprintln!("nims-page: only the plain page is there; scripts/page builds the whole one");
    }
    let here = Arc::new(Here::default());
    listens(listening, &here);
    let topics = Arc::new(Topics::default());
    let conversations = Arc::new(Conversations::default());
    let known = Arc::clone(&conversations.known);
    let app = App {
        place: place.clone(),
        topics: Arc::clone(&topics),
        assets,
        downloads: Downloads::default(),
        names: names.clone(),
        conversations,
        stops: Places::default(),
        here,
        calibrations: Arc::new(Semaphore::new(1)),
    };
    tokio::select! {
        () = observe(Arc::clone(&topics), place.clone()) => {}
        () = gather(topics, place.clone()) => {}
        () = listen(listener, made.map(|made| made.config), router(Arc::new(app)), names.into(), known) => {}
        _ = interrupted.recv() => {}
        _ = terminated.recv() => {}
        _ = hung_up.recv() => {}
    }
    Ok(())
}

/// The names of this machine by which browsers may reach it.
fn names(given: &[String]) -> Vec<String> {
    let mut names = vec!["localhost".to_owned()];
    let host = rustix::system::uname().nodename().to_string_lossy().to_ascii_lowercase();
    if !host.is_empty() && host != "localhost" {
        names.extend([format!("{host}.local"), host]);
    }
    names.extend(given.iter().map(|name| name.to_ascii_lowercase()));
    names
}
