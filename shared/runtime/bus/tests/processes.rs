//! Ports between processes, also after a process was killed.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod peer;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use bus::clock::now_ns;
use bus::{Bus, BusError, Domain, Subscriber, UnusableFolder, Waiter};
use messages::{MotorState, Request};
use peer::{Peer, example};

/// Receives at least `count` samples of one or more publishers and returns them, those of each publisher in order.
fn receive(count: usize, subscriber: &mut Subscriber<MotorState>, waiter: &mut Waiter) -> Vec<MotorState> {
    let give_up = Instant::now() + Duration::from_secs(20);
    let mut samples = Vec::new();
    while samples.len() < count {
        assert!(Instant::now() < give_up, "{} of {count} samples", samples.len());
        waiter.wait_until(Some(now_ns() + 100_000_000)).unwrap();
        while let Some(sample) = subscriber.receive().unwrap() {
            assert!(sample.counts.iter().all(|value| *value == sample.counts[0]), "torn");
            samples.push(sample);
        }
    }
    samples
}

#[test]
fn a_killed_publisher_is_replaced_without_a_loss_or_a_torn_sample() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut subscriber = bus.subscriber::<MotorState>("motor/state").unwrap();
    let mut waiter = bus.waiter(&["motor/state"]).unwrap();
    for life in 0..4 {
        let peer = Peer::start(domain.name(), "motor-io", "publish");
        let samples = receive(30, &mut subscriber, &mut waiter);
        if life == 0 {
            assert_eq!(samples[0].counts[0], 1);
        }
        assert_eq!(domain.alive().len(), 2);
        peer.kill();
        assert_eq!(domain.alive().len(), 1, "its death is detected at once");
    }
    while subscriber.receive().unwrap().is_some() {}
    assert_eq!((subscriber.lost(), subscriber.broken()), (0, 0));
}

#[test]
fn the_place_of_a_publisher_is_free_after_its_death_and_not_before() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let peer = Peer::start(domain.name(), "motor-io", "publish");
    let error = bus.publisher::<MotorState>("motor/state").unwrap_err();
    let pid = peer.0.id();
    let BusError::Full { holders, .. } = &error else { panic!("{error}") };
    assert!(holders.contains("motor-io") && holders.contains(&pid.to_string()), "{holders}");
    assert!(error.to_string().contains(holders.as_str()), "{error}");
    peer.kill();
    bus.publisher::<MotorState>("motor/state").unwrap();
}

#[test]
fn a_late_subscriber_counts_no_loss() {
    let domain = Domain::for_test();
    let _peer = Peer::start(domain.name(), "motor-io", "publish");
    std::thread::sleep(Duration::from_millis(50));
    let bus = Bus::join(&domain, "test").unwrap();
    let mut waiter = bus.waiter(&["motor/state"]).unwrap();
    let mut subscriber = bus.subscriber::<MotorState>("motor/state").unwrap();
    let mut tap = bus.tap("motor/state").unwrap();
    let samples = receive(50, &mut subscriber, &mut waiter);
    assert!(samples[0].header.seq > 1);
    assert!(samples.windows(2).all(|pair| pair[1].header.seq == pair[0].header.seq + 1));
    let mut tapped = 0;
    while tap.receive(|raw| assert_eq!(raw.bytes.len(), size_of::<MotorState>())).unwrap().is_some() {
        tapped += 1;
    }
    assert!(tapped > 0);
    assert_eq!((subscriber.lost(), tap.lost()), (0, 0));
}

#[test]
fn a_dead_server_is_an_error_and_never_a_hang() {
    let domain = Domain::for_test();
    let peer = Peer::start(domain.name(), "planner", "answer");
    let bus = Bus::join(&domain, "nims").unwrap();
    let mut client = bus.client("planner").unwrap();
    let request = Request::Pause.encode().unwrap();
    assert_eq!(client.ask(&request, Duration::from_secs(20)).unwrap().accepted, 1);
    peer.kill();
    // Its place is still taken, because no process has cleaned up.
    let error = client.ask(&request, Duration::from_millis(50)).unwrap_err();
    assert!(matches!(error, BusError::NoAnswer { .. } | BusError::NoServer { .. }), "{error}");
    bus.clean();
    let error = client.ask(&request, Duration::from_secs(60)).unwrap_err();
    assert!(matches!(error, BusError::NoServer { .. }), "{error}");
    // The same client reaches a successor.
    let _peer = Peer::start(domain.name(), "planner", "answer");
    assert_eq!(client.ask(&request, Duration::from_secs(20)).unwrap().accepted, 1);
}

#[test]
fn the_places_of_killed_processes_are_free_while_other_processes_clean_up() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    for round in 0..20 {
        let (server, publisher) =
            (Peer::start(domain.name(), "nims", "serve"), Peer::start(domain.name(), "motor-io", "publish"));
        server.kill();
        publisher.kill();
        std::thread::scope(|scope| {
            // A process that joins cleans up, and only one process at a time can.
            for _ in 0..3 {
                scope.spawn(|| drop(Bus::join(&domain, "joining").unwrap()));
            }
            let (server, publisher) = (bus.server("nims"), bus.publisher::<MotorState>("motor/state"));
            assert!(server.is_ok(), "round {round}: {}", server.unwrap_err());
            assert!(publisher.is_ok(), "round {round}: {}", publisher.unwrap_err());
        });
    }
}

#[test]
fn a_sweep_removes_dead_processes_and_wipes_an_empty_domain() {
    let domain = Domain::for_test();
    for _ in 0..3 {
        Peer::start(domain.name(), "silent", "silent").kill();
    }
    let bus = Bus::join(&domain, "test").unwrap();
    let peer = Peer::start(domain.name(), "motor-io", "publish");
    peer.kill();
    let swept = domain.sweep().unwrap();
    assert_eq!((swept.alive, swept.removed, swept.failed), (1, 1, 0));
    assert_eq!(domain.sweep().unwrap().removed, 0);
    // An incomplete channel: its file is empty and still writable.
    let half = domain.root().join("services").join(format!("{}0123456789abcdef.service", domain.prefix()));
    std::fs::write(&half, "").unwrap();
    std::fs::set_permissions(&half, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    domain.sweep().unwrap();
    assert!(half.exists(), "a process may still be creating it");
    std::fs::File::open(&half).unwrap().set_modified(std::time::SystemTime::now() - Duration::from_secs(10)).unwrap();
    assert_eq!(domain.sweep().unwrap().files, 1);
    drop(bus);
    Peer::start(domain.name(), "motor-io", "publish").kill();
    assert!(domain.sweep().unwrap().files > 0);
    assert_eq!(std::fs::read_dir(domain.root()).unwrap().count(), 0);
    let left = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().starts_with(domain.prefix());
    assert_eq!(std::fs::read_dir("/dev/shm").unwrap().flatten().filter(left).count(), 0);
}

#[test]
fn it_works_for_a_user_without_privileges() {
    if !rustix::process::geteuid().is_root() {
        return; // all other tests then run as such a user
    }
    // Copy the program, because other users may not be able to enter its folder.
    let place = tempfile::Builder::new().prefix("nims-peer-").tempdir_in("/tmp").unwrap();
    std::fs::set_permissions(place.path(), std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let program = place.path().join("peer");
    std::fs::copy(example(), &program).unwrap();
    let name = format!("u{}", std::process::id());
    let _clean = Leftovers(Path::new("/dev/shm").join(format!("nims-65534-{name}")));
    let as_unprivileged_user = |what: &str, process: &str| {
        let mut command = Command::new("setpriv");
        command.args(["--reuid=65534", "--regid=65534", "--clear-groups"]).arg(&program).args([&name, process, what]);
        command
    };
    let first = Peer::run(&mut as_unprivileged_user("publish", "motor-io"));
    first.kill();
    let _second = Peer::run(&mut as_unprivileged_user("publish", "motor-io"));
    // Root, which is another user, is rejected; it must not stall them.
    let error = Domain::parse(&format!("/dev/shm/nims-65534-{name}")).unwrap_err();
    assert!(
        matches!(error, BusError::DomainFolder { why: UnusableFolder::OtherUser { owner: 65534, user: 0 }, .. }),
        "{error}"
    );
}

/// Removes the objects of another user's domain when dropped.
struct Leftovers(PathBuf);

impl Drop for Leftovers {
    fn drop(&mut self) {
        let prefix = format!("nims{:08x}_", messages::hash_of(&self.0.to_string_lossy()));
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
