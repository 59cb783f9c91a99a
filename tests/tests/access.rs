//! File permissions: only its user can access what a robot creates, and move the robot.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "live/robot/mod.rs"]
mod robot;

use messages::{MotorAuthority, Request};
use robot::{Robot, program};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A user other than the present one.
const STRANGER: &str = "65533";

/// The folder and everything in it; a link counts as the target that it leads to.
fn all_below(folder: &Path, into: &mut Vec<PathBuf>) {
    into.push(folder.to_owned());
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_type().unwrap().is_dir() {
            all_below(&entry.path(), into);
        } else {
            into.push(entry.path());
        }
    }
}

fn open(paths: &[PathBuf]) -> Vec<String> {
    let mode = |path: &PathBuf| fs::metadata(path).map_or(0, |found| found.mode() & 0o077);
    paths.iter().filter(|path| mode(path) != 0).map(|path| format!("{} {:o}", path.display(), mode(path))).collect()
}

/// A command as another user.
fn stranger(program: &Path, args: &[&str]) -> Output {
    let ids = [format!("--reuid={STRANGER}"), format!("--regid={STRANGER}"), "--clear-groups".to_owned()];
    Command::new("setpriv").args(ids).arg("--").arg(program).args(args).current_dir("/").output().unwrap()
}

#[test]
fn only_its_user_can_access_the_files_of_a_robot_and_move_it() {
    // With the most permissive umask.
    let habit = rustix::process::umask(rustix::fs::Mode::empty());
    let mut robot = Robot::up("");
    rustix::process::umask(habit);
    robot.ask("motor-io", Request::Arm);
    robot.ask("motor-io", Request::ZeroAt { position_m: [4.8, 3.0, 0.3] });
    robot.fly();
    let root = robot.domain.root().to_owned();
    let mut shared = Vec::new();
    all_below(&root, &mut shared);
    let ports = shared.iter().filter(|path| path.is_symlink()).count();
    let memory: Vec<PathBuf> = fs::read_dir("/dev/shm")
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.file_name().unwrap().to_string_lossy().starts_with(robot.domain.prefix()))
        .collect();
    assert!(
        ports >= 1 && memory.len() > 20,
        "this test looks in the wrong place: {ports} ports, {} files",
        memory.len()
    );
    assert_eq!(open(&memory), [""; 0]);
    // The test itself created files in the folder with its user's umask; there the folder protects them.
    let own = std::process::id().to_string();
    shared.retain(|path| path == &root || !path.is_dir() && !path.to_string_lossy().contains(&own));
    assert_eq!(open(&shared), [""; 0]);
    assert!(robot.domain.open_to_others().is_empty());
    let mut kept = Vec::new();
    for folder in [robot.run(), robot.folder().join("state")] {
        all_below(&folder, &mut kept);
    }
    assert!(kept.iter().any(|path| path.ends_with("run.mcap.part")), "{kept:?}");
    assert!(kept.iter().any(|path| path.to_string_lossy().contains("position-")), "{kept:?}");
    assert_eq!(open(&kept), [""; 0]);

    if !rustix::process::geteuid().is_root() {
        return notes::left_out("what another user can do to the robot", "only root can act as another user");
    }
    // If everybody may read the programs, an unprivileged user can run them.
    let copy = tempfile::tempdir().unwrap();
    fs::set_permissions(copy.path(), std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let nims = copy.path().join("nims");
    fs::copy(program(), &nims).unwrap();
    fs::set_permissions(&nims, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let domain = root.to_str().unwrap();
    assert!(stranger(&nims, &["--version"]).status.success(), "another user can run the program");
    for command in
        [&["estop"][..], &["hold"], &["disarm"], &["status"], &["channel", "list"], &["fault", "unplug", "1"]]
    {
        let output = stranger(&nims, &[&["--domain", domain], command].concat());
        assert!(!output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stdout));
        let sentence = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(sentence.trim_end().lines().count(), 1, "{sentence}");
        // The domain, and the page about what other users can do, which no other refusal names.
        assert!(sentence.contains(domain) && sentence.contains("docs/access.md"), "{sentence}");
    }
    let pid = robot.domain.alive().iter().find(|node| node.name == "motor-io").unwrap().pid;
    let port = fs::read_link(root.join("drive0")).unwrap();
    let sh = Path::new("/bin/sh");
    for path in memory.iter().chain([&port]) {
        let path = path.display();
        assert!(!stranger(sh, &["-c", &format!("exec head -c 1 < {path}")]).status.success(), "{path} can be read");
        assert!(!stranger(sh, &["-c", &format!(": >> {path}")]).status.success(), "{path} can be written");
    }
    assert!(!stranger(sh, &["-c", &format!("kill -STOP {pid}")]).status.success());
    assert!(!stranger(sh, &["-c", &format!("head -c 1 /proc/{pid}/mem")]).status.success());
    robot.until("the motion continues", |robot| robot.last.header.cycle > 300);
    assert!(matches!(robot.last.mode, MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_HOLDING));
    assert_eq!(robot.last.faults, 0);
}
