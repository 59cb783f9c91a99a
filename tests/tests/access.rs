//! File permissions: only its user can access what a robot creates, and move the robot.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "live/robot/mod.rs"]
mod robot;

use messages::{MotorAuthority, Request};
use robot::{Robot, program};
use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};

/// A user other than the present one.
const STRANGER: u32 = 65533;
/// Another one, in the group of the gateway's socket.
const OPERATOR: u32 = 65532;
const OPERATORS: u32 = 65531;

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
    command_as(STRANGER, STRANGER, program).args(args).current_dir("/").output().unwrap()
}

fn command_as(user: u32, group: u32, program: &Path) -> Command {
    let mut command = Command::new("setpriv");
    command.args([format!("--reuid={user}"), format!("--regid={group}"), "--clear-groups".to_owned()]);
    command.arg("--").arg(program);
    command
}

/// A folder that everyone may enter.
fn open_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o755)).unwrap();
    folder
}

/// A process that is ended when this value is dropped.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// What an operator can do through the gateway, whose socket only the operators' group can open, and nothing more.
fn operator_uses_the_gateway(robot: &mut Robot, nims: &Path, memory: &Path) {
    let folder = open_folder();
    let (socket, system) = (folder.path().join("robot.sock"), robot.folder().join("configs/systems/gateway.toml"));
    let text = fs::read_to_string(robot.folder().join("configs/systems/demo3.toml")).unwrap();
    fs::write(&system, format!("runs = \"../..\"\n{text}\n[gateway]\nfly = [\"@{OPERATORS}\"]\n")).unwrap();
    let mut gateway = command_as(0, OPERATORS, &program().with_file_name("gateway"));
    gateway.arg("--system").arg(&system).arg("--socket").arg(&socket).args(["--domain", robot.domain.name()]);
    let _gateway = Ended(gateway.stderr(std::process::Stdio::null()).spawn().unwrap());
    robot.until_reported("the gateway listens", |_| socket.exists());
    // The operator's mission is in a home that the robot's user could enter only as root.
    let home = open_folder();
    fs::write(home.path().join("own.toml"), "name = \"own\"\n[[leg]]\nline = { to_m = [4.9, 3.1, 0.4] }\n").unwrap();
    fs::set_permissions(home.path().join("own.toml"), PermissionsExt::from_mode(0o600)).unwrap();
    std::os::unix::fs::chown(home.path().join("own.toml"), Some(OPERATOR), None).unwrap();
    std::os::unix::fs::chown(home.path(), Some(OPERATOR), None).unwrap();
    fs::set_permissions(home.path(), PermissionsExt::from_mode(0o700)).unwrap();
    let run = |user, group, args: &[&str]| {
        let mut command = command_as(user, group, nims);
        command.arg("--gateway").arg(&socket).args(args).current_dir(if user == OPERATOR {
            home.path()
        } else {
            "/".as_ref()
        });
        command.output().unwrap()
    };
    let operator = |args: &[&str]| run(OPERATOR, OPERATORS, args);
    robot.until_reported("the gateway has joined the robot", |_| operator(&["status"]).status.success());
    for args in [&["hold"][..], &["stop"], &["channel", "list"], &["runs"]] {
        let output = operator(args);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    // Once the robot has come to rest.
    robot.until_reported("the mission is flown", |_| operator(&["run", "own.toml", "--wait"]).status.success());
    // No shell as the robot's user, no token, no run that is being recorded, no path of its own.
    let present = robot.run().file_name().unwrap().to_str().unwrap().to_owned();
    for args in [
        &["plug", "shell", "--", "/bin/sh"][..],
        &["token", "add", "own", "fly"],
        &["fetch", &present],
        &["fetch", "../state"],
    ] {
        let output = operator(args);
        assert!(!output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stdout));
    }
    let sh = Path::new("/bin/sh");
    for what in [memory, robot.domain.root(), &robot.run()] {
        let script = format!("exec ls {0}/ || exec head -c 1 < {0}", what.display());
        assert!(!command_as(OPERATOR, OPERATORS, sh).args(["-c", &script]).output().unwrap().status.success());
    }
    // A stranger is not let in.
    for args in [&["status"][..], &["estop"]] {
        let output = run(STRANGER, STRANGER, args);
        let sentence = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && sentence.contains("closed to this user"), "{sentence}");
    }
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
    let copy = open_folder();
    let nims = copy.path().join("nims");
    fs::copy(program(), &nims).unwrap();
    fs::set_permissions(&nims, PermissionsExt::from_mode(0o755)).unwrap();
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
    operator_uses_the_gateway(&mut robot, &nims, &memory[0]);
    robot.fly();
    robot.until("the motion continues", |robot| robot.last.header.cycle > 300);
    assert!(matches!(robot.last.mode, MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_HOLDING));
    assert_eq!(robot.last.faults, 0);
}
