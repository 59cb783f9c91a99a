//! The folder of a domain: which files are created, removed, and left unchanged.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use bus::{Bus, BusError, Domain, UnusableFolder};
use messages::{OperatorRequest, Request};
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::time::Duration;

fn in_memory() -> tempfile::TempDir {
    tempfile::Builder::new().prefix("nims-f").tempdir_in("/dev/shm").unwrap()
}

fn refused(root: &Path) -> UnusableFolder {
    match Domain::from_root(root).unwrap_err() {
        BusError::DomainFolder { path, why } if path == root => why,
        other => panic!("{other}"),
    }
}

#[test]
fn a_folder_with_other_files_is_rejected_and_not_modified() {
    let place = in_memory();
    fs::create_dir(place.path().join("photos")).unwrap();
    fs::write(place.path().join("photos/one"), "1").unwrap();
    fs::set_permissions(place.path(), fs::Permissions::from_mode(0o755)).unwrap();
    assert_eq!(refused(place.path()), UnusableFolder::OtherFiles);
    assert!(Domain::existing(place.path().to_str().unwrap()).unwrap().is_none(), "it is no domain");
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
    assert_eq!(fs::metadata(place.path()).unwrap().permissions().mode() & 0o777, 0o755);
    assert!(place.path().join("photos/one").is_file());
}

#[test]
fn a_folder_that_others_may_enter_is_rejected_and_keeps_its_mode() {
    let place = in_memory();
    fs::set_permissions(place.path(), fs::Permissions::from_mode(0o755)).unwrap();
    assert_eq!(refused(place.path()), UnusableFolder::Open { mode: 0o755 });
    assert_eq!(fs::metadata(place.path()).unwrap().permissions().mode() & 0o777, 0o755);
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);
}

#[test]
fn a_folder_on_a_disk_is_rejected() {
    let on_disk = Path::new("/").join(format!("nims-{}", std::process::id()));
    if rustix::fs::statfs("/").unwrap().f_type == 0x0102_1994 {
        return notes::left_out("a domain's folder on a disk is refused", "the root of this machine is in memory");
    }
    assert_eq!(refused(&on_disk), UnusableFolder::NotInMemory);
    assert!(!on_disk.exists());
}

#[test]
fn a_sweep_removes_only_files_of_the_domain() {
    let place = in_memory();
    let domain = Domain::from_root(&place.path().join("robot")).unwrap();
    drop(Bus::join(&domain, "test").unwrap());
    let root = domain.root();
    fs::write(root.join("notes.txt"), "mine").unwrap();
    fs::create_dir(root.join("photos")).unwrap();
    symlink("/etc/hostname", root.join("link")).unwrap();
    symlink("/dev/pts/99999", root.join("drives1")).unwrap();
    for own in ["children.json", "running.json", "drives1.time"] {
        fs::write(root.join(own), "").unwrap();
    }
    // The folder is marked, so it is accepted although it contains other files.
    let domain = Domain::parse(domain.name()).unwrap();
    assert!(domain.sweep().unwrap().files >= 4);
    let mut left: Vec<String> =
        fs::read_dir(root).unwrap().map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    left.sort();
    assert_eq!(left, [".nims-domain", "link", "notes.txt", "photos"]);
}

#[test]
fn a_domain_that_is_given_up_leaves_no_files_and_can_be_claimed_again() {
    let domain = Domain::new(&format!("f{}", std::process::id())).unwrap();
    let claim = domain.claim().unwrap();
    let bus = Bus::join(&domain, "test").unwrap();
    let _port = bus.subscriber::<OperatorRequest>("operator/request").unwrap();
    drop((_port, bus));
    assert!(domain.release(claim));
    assert!(!domain.root().exists());
    let ours = |entry: &fs::DirEntry| entry.file_name().to_string_lossy().starts_with(domain.prefix());
    assert_eq!(fs::read_dir("/dev/shm").unwrap().flatten().filter(ours).count(), 0);
    // The same value, whose folder was removed.
    let claim = domain.claim().unwrap();
    assert!(matches!(domain.claim(), Err(BusError::Claimed { .. })));
    let bus = Bus::join(&domain, "observer").unwrap();
    assert!(!domain.release(claim), "a process runs in it");
    assert!(domain.root().exists());
    drop(bus);
    assert!(domain.release(domain.claim().unwrap()));
}

#[test]
fn a_suspended_process_receives_a_stop_request_when_it_continues() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "motor-io").unwrap();
    let mut server = bus.server("motor-io").unwrap();
    let commands = Bus::join(&domain, "nims-command").unwrap();
    let request = Request::Estop.encode().unwrap();
    // A client whose program timed out and ended while the server was suspended.
    let mut client = commands.client("motor-io").unwrap();
    let mut calls = 0;
    let before = bus::clock::now_ns();
    let error = client.ask_aloud(&request, Duration::from_millis(60), Duration::from_millis(20), || calls += 1);
    assert!(matches!(error, Err(BusError::NoAnswer { .. })), "{error:?}");
    assert_eq!(calls, 1, "called once, before the timeout");
    client.leave_behind();
    let call = server.try_next().unwrap().expect("the request is still there");
    assert_eq!(call.request.body, Request::Estop.body());
    assert!(call.request.header.stamp_ns >= before, "the stamp is the time of the request");
    assert!(call.unlogged.is_none());
    call.answer(&answer(messages::OperatorRequest::ACCEPTED, "stopped")).unwrap();
    assert!(server.try_next().unwrap().is_none());
}

/// An answer without a reason of the catalogue.
fn answer(accepted: u8, text: &str) -> messages::RequestAnswer {
    let mut answer = messages::RequestAnswer { accepted, ..Default::default() };
    messages::put_text(&mut answer.text, text);
    answer
}
