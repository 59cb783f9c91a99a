//! File permissions: only its user can access what a robot creates, and move the robot.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "live/robot/mod.rs"]
mod robot;

use bus::Subscriber;
use messages::{MotorAuthority, OperatorRequest, Request};
use robot::{Robot, program};
use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};

/// A user other than the present one.
const STRANGER: u32 = 65533;
/// Others, in the group of the gateway's socket: one who flies, one who only looks, and the user of the plug-ins.
const OPERATOR: u32 = 65532;
const OPERATORS: u32 = 65531;
const LOOKER: u32 = 65530;
const PLUGIN: u32 = 65529;

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

/// Users of the table in docs/access.md: one who flies, one who only looks, and one outside the group of the socket.
const USERS: [(&str, u32, u32); 3] =
    [("operator", OPERATOR, OPERATORS), ("look-only", LOOKER, OPERATORS), ("stranger", STRANGER, STRANGER)];

/// The gateway of a robot for other users, and what they need: homes that no other user may enter, programs.
struct Others<'a> {
    nims: &'a Path,
    memory: &'a Path,
    port: PathBuf,
    socket: PathBuf,
    folder: tempfile::TempDir,
    homes: Vec<tempfile::TempDir>,
    _gateway: Ended,
}

impl<'a> Others<'a> {
    fn with(robot: &mut Robot, nims: &'a Path, memory: &'a Path) -> Self {
        let folder = open_folder();
        let (socket, system) = (folder.path().join("robot.sock"), robot.folder().join("configs/systems/gateway.toml"));
        let text = fs::read_to_string(robot.folder().join("configs/systems/demo3.toml")).unwrap();
        let more = format!(
            "[gateway]\nfly = [\"@{OPERATORS}\"]\nlook = [\"{LOOKER}\"]\npublish = [\"{PLUGIN}\"]\n[[plugin]]\nname = \
             \"soil\"\nquantity = [\"moisture\"]\nunit = [\"%\"]\n"
        );
        fs::write(&system, format!("runs = \"../..\"\n{text}\n{more}")).unwrap();
        let mut gateway = command_as(0, OPERATORS, &program().with_file_name("gateway"));
        gateway.arg("--system").arg(&system).arg("--socket").arg(&socket).args(["--domain", robot.domain.name()]);
        let gateway = Ended(gateway.stderr(std::process::Stdio::null()).spawn().unwrap());
        robot.until_reported("the gateway listens", |_| socket.exists());
        for (name, text) in [("leaf.py", LEAF.to_owned()), ("nims_sensor.py", sensor_module())] {
            fs::write(folder.path().join(name), text).unwrap();
            fs::set_permissions(folder.path().join(name), PermissionsExt::from_mode(0o644)).unwrap();
        }
        let homes = USERS.map(|(_, user, _)| {
            // A mission in a home that the robot's user could enter only as root.
            let home = open_folder();
            let mission = home.path().join("own.toml");
            fs::write(&mission, "name = \"own\"\n[[leg]]\nline = { to_m = [4.9, 3.1, 0.4] }\n").unwrap();
            for (path, mode) in [(mission.as_path(), 0o600), (home.path(), 0o700)] {
                fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
                std::os::unix::fs::chown(path, Some(user), None).unwrap();
            }
            home
        });
        let port = fs::read_link(robot.domain.root().join("drive0")).unwrap();
        let others = Self { nims, memory, port, socket, folder, homes: homes.into(), _gateway: gateway };
        robot.until_reported("the gateway has joined the robot", |_| others.run(0, &["status"]).status.success());
        others
    }

    /// `nims` as one of the users.
    fn run(&self, user: usize, args: &[&str]) -> Output {
        let (_, uid, gid) = USERS[user];
        let mut command = command_as(uid, gid, self.nims);
        command.arg("--gateway").arg(&self.socket).args(args).current_dir(self.homes[user].path()).output().unwrap()
    }

    /// A line of the shell as one of the users.
    fn sh(&self, user: usize, line: &str) -> Output {
        let (_, uid, gid) = USERS[user];
        command_as(uid, gid, Path::new("/bin/sh")).args(["-c", line]).current_dir("/").output().unwrap()
    }

    /// Thirty actions and more: what it is called in docs/access.md, and how it is tried. What is allowed may fail for
    /// another reason, e.g. because the robot moves; no command refuses one of them by itself.
    fn actions(&self, robot: &Robot) -> Vec<(&'static str, Attempt)> {
        let nims = |words: &[&str]| Attempt::Nims(words.iter().map(|&word| word.to_owned()).collect());
        let present = robot.run().file_name().unwrap().to_str().unwrap().to_owned();
        let (run, memory, domain) = (robot.run(), self.memory.display(), robot.domain.root().display().to_string());
        let pid = robot.domain.alive().iter().find(|node| node.name == "motor-io").unwrap().pid;
        let folder = self.folder.path().display();
        vec![
            ("see the state", nims(&["status"])),
            ("list the channels", nims(&["channel", "list"])),
            ("read a channel", nims(&["channel", "hz", "motor/state", "--for", "0.2"])),
            ("list the finished runs", nims(&["runs"])),
            ("hold", nims(&["hold"])),
            ("pause", nims(&["pause"])),
            ("resume", nims(&["resume"])),
            ("stop", nims(&["stop"])),
            ("arm", nims(&["arm"])),
            ("zero the position", nims(&["zero", "--at", "4.8,3.0,0.3"])),
            ("confirm the position", nims(&["confirm-position"])),
            ("jog a cable", nims(&["jog", "1", "0.02"])),
            ("fly to a point", nims(&["goto", "4.9,3.1,0.5"])),
            ("fly an own mission", nims(&["run", "own.toml"])),
            ("change the speed", nims(&["speed", "50"])),
            ("change a parameter", nims(&["set", "controller.horizon_cycles", "3"])),
            ("swap the controller", nims(&["swap", "controller", "default"])),
            ("restart a process", nims(&["restart", "nothing"])),
            ("cause a fault", nims(&["fault", "noise", "1", "0.001", "--for", "1"])),
            ("unplug a sensor", nims(&["unplug", "nothing"])),
            ("plug in a program", nims(&["plug", "shell", "--", "/bin/sh"])),
            (
                "publish as a sensor",
                Attempt::Shell(format!("/usr/bin/python3 -B {folder}/leaf.py {}", self.socket.display())),
            ),
            ("manage tokens", nims(&["token", "list"])),
            ("copy the run that is recorded", nims(&["fetch", &present, "copy"])),
            ("copy a folder that is no run", nims(&["fetch", "../state", "copy"])),
            ("read the robot's memory", Attempt::Shell(format!("head -c 1 < {memory}"))),
            ("write the robot's memory", Attempt::Shell(format!(": >> {memory}"))),
            ("enter the robot's domain", Attempt::Shell(format!("ls {domain}/"))),
            ("read the folder of the run", Attempt::Shell(format!("ls {}/", run.display()))),
            ("open a port of the drives", Attempt::Shell(format!("head -c 1 < {}", self.port.display()))),
            ("signal a process", Attempt::Shell(format!("kill -STOP {pid}"))),
            ("read the memory of a process", Attempt::Shell(format!("head -c 1 /proc/{pid}/mem"))),
            ("take the place of the gateway's socket", Attempt::Shell(format!("mv {0}/robot.sock {0}/old", folder))),
            ("emergency stop", nims(&["estop"])),
            ("reset", nims(&["reset"])),
            ("disarm", nims(&["disarm"])),
        ]
    }

    /// Returns whether the attempt was let through: it succeeds, or a process of the robot has answered this user. The
    /// gateway's refusal and a closed socket are none, and then the robot was not asked. Anything else proves nothing,
    /// and fails.
    fn passes(&self, user: usize, name: &str, attempt: &Attempt, requests: &mut Subscriber<OperatorRequest>) -> bool {
        while requests.receive().unwrap().is_some() {}
        let output = match attempt {
            Attempt::Nims(words) => self.run(user, &words.iter().map(String::as_str).collect::<Vec<_>>()),
            Attempt::Shell(line) => return self.sh(user, line).status.success(),
        };
        let sentence = String::from_utf8_lossy(&output.stderr).into_owned();
        let refused = ["closed to this user", " may not ", "no finished run"].iter().any(|why| sentence.contains(why));
        let (mut reached, mut reasons) = (false, Vec::new());
        // The robot publishes a request, and again with its answer, which the command has already.
        for _ in 0..if output.status.success() || refused { 1 } else { 1000 } {
            while let Some(request) = requests.receive().unwrap() {
                let is_own = request.uid == USERS[user].1;
                reached |= is_own;
                reasons.extend((is_own && request.answered == 1).then_some(request.reason));
            }
            if !reasons.is_empty() {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let answered = !reasons.is_empty() && reasons.iter().all(|reason| !(450..500).contains(reason));
        println!("{} tries to {name}: {:?}, the robot's reasons {reasons:?}, {sentence}", USERS[user].0, output.status);
        match refused {
            true => assert!(!output.status.success() && !reached, "{name}: {reasons:?} {sentence}"),
            false => assert!(output.status.success() || answered, "{name}: {reasons:?} {sentence}"),
        }
        !refused
    }
}

/// A sensor that declares its own message and ends with 0 if a sample was taken.
const LEAF: &str = "import ctypes, sys, nims_sensor\n\
class Leaf(nims_sensor.Sample):\n    _fields_ = [('area_m2', ctypes.c_double, 'Area, m2.')]\n\
with nims_sensor.Sensor('leaf', Leaf, gateway=sys.argv[1]) as sensor:\n    sys.exit(0 if sensor.send(area_m2=1.0) else 1)\n";

fn sensor_module() -> String {
    fs::read_to_string(robot::root().join("scripts/python/nims_sensor.py")).unwrap()
}

/// How an action is tried.
enum Attempt {
    Nims(Vec<String>),
    Shell(String),
}

/// The table of docs/access.md is what each user can do: every action is tried as each of them.
fn every_action_is_tried_as_each_user(robot: &mut Robot, others: &Others<'_>) {
    let actions = others.actions(robot);
    assert!(actions.len() >= 30);
    let mut table = String::from("| action | operator | look-only | stranger |\n|---|---|---|---|\n");
    // The stranger first, so that the others cannot have left a way open.
    let mut passed = vec![[false; USERS.len()]; actions.len()];
    let mut requests = robot.bus.subscriber::<OperatorRequest>("operator/request").unwrap();
    for user in (0..USERS.len()).rev() {
        for ((name, attempt), passed) in actions.iter().zip(&mut passed) {
            passed[user] = others.passes(user, name, attempt, &mut requests);
        }
    }
    for ((name, _), passed) in actions.iter().zip(&passed) {
        let words = passed.map(|passed| if passed { "allowed" } else { "refused" });
        table.push_str(&format!("| {name} | {} |\n", words.join(" | ")));
    }
    println!("{table}");
    let page = fs::read_to_string(robot::root().join("docs/access.md")).unwrap();
    assert!(page.contains(&table), "docs/access.md has another table than\n{table}");
}

/// A plug-in runs as a user of its own: it delivers its readings, and can do nothing else.
fn a_plug_in_delivers_readings_and_nothing_else(robot: &mut Robot, others: &Others<'_>) {
    let module = others.folder.path().join("nims_gateway.py");
    fs::copy(robot::root().join("scripts/python/nims_gateway.py"), &module).unwrap();
    fs::set_permissions(&module, PermissionsExt::from_mode(0o644)).unwrap();
    let script = "import nims_gateway, time\nwith nims_gateway.Sensor() as sensor:\n    for value in range(5):\n        \
                  assert sensor.send([value])\n        time.sleep(0.2)\n    for name in 'other', '../soil':\n        \
                  sensor.name = name\n        try:\n            sensor.send([0.0])\n        except \
                  nims_gateway.Refused as refused:\n            print(refused.reason)\n";
    let mut readings = robot.bus.subscriber::<messages::Reading>("sensor/soil").unwrap();
    let run_as = |user: u32, program: &Path, args: &[&str]| {
        let mut command = command_as(user, OPERATORS, program);
        command.args(args).current_dir("/").env("NIMS_GATEWAY", &others.socket).env("NIMS_NAME", "soil");
        command.env("PYTHONPATH", others.folder.path()).env("PYTHONDONTWRITEBYTECODE", "1").output().unwrap()
    };
    let python = Path::new("/usr/bin/python3");
    let plugin = |program: &Path, args: &[&str]| run_as(PLUGIN, program, args);
    let running = std::thread::scope(|scope| {
        let running = scope.spawn(|| plugin(python, &["-c", script]));
        let mut values = Vec::new();
        while !running.is_finished() {
            values.extend(std::iter::from_fn(|| readings.receive().unwrap()).map(|reading| reading.value[0]));
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert_eq!(values, [0.0, 1.0, 2.0, 3.0, 4.0]);
        running.join().unwrap()
    });
    assert!(running.status.success(), "{}", String::from_utf8_lossy(&running.stderr));
    assert_eq!(String::from_utf8_lossy(&running.stdout), "465\n465\n");
    let socket = others.socket.to_str().unwrap();
    for args in [&["hold"][..], &["arm"], &["goto", "4.9,3.1,0.4"], &["plug", "x", "--", "/bin/sh"], &["token", "list"]]
    {
        let output = plugin(others.nims, &[&["--gateway", socket], args].concat());
        assert!(String::from_utf8_lossy(&output.stderr).contains(" may not "), "{args:?}");
    }
    let line = format!("head -c 1 < {}", others.memory.display());
    assert!(!plugin(Path::new("/bin/sh"), &["-c", &line]).status.success());
    // No other user can pretend to be one.
    let output = run_as(OPERATOR, python, &["-c", script]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("may not publish"), "{said}");
}

/// What an operator can do through the gateway, whose socket only the operators' group can open, and nothing more.
fn operator_uses_the_gateway(robot: &mut Robot, others: &Others<'_>) {
    for args in [&["hold"][..], &["stop"], &["channel", "list"], &["runs"]] {
        let output = others.run(0, args);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    // Once the robot has come to rest. It would wait for a resume after a stop of the machine's.
    std::thread::scope(|scope| {
        let flying = scope.spawn(|| (0..100).any(|_| others.run(0, &["run", "own.toml", "--wait"]).status.success()));
        while !flying.is_finished() {
            robot.keep_flying();
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        assert!(flying.join().unwrap(), "the mission is not flown");
    });
}

/// After the end of a run, a user who may look reads it without being able to enter its folder.
fn a_finished_run_is_reported_to_whoever_may_look(robot: &mut Robot, others: &Others<'_>) {
    robot.down(rustix::process::Signal::INT);
    let run = robot.run();
    let name = run.file_name().unwrap().to_str().unwrap().to_owned();
    robot.until_reported("the run is finished", |_| {
        String::from_utf8_lossy(&others.run(0, &["runs"]).stdout).contains(&name)
    });
    for user in 0..USERS.len() {
        let (info, report) = (others.run(user, &["info", &name]), others.run(user, &["report", &name]));
        let may = user != 2;
        assert_eq!(info.status.success(), may, "{}", String::from_utf8_lossy(&info.stderr));
        assert_eq!(report.status.success(), may, "{}", String::from_utf8_lossy(&report.stderr));
        assert_eq!(others.homes[user].path().join(format!("{name}.html")).exists(), may);
        assert!(!others.sh(user, &format!("ls {}/", run.display())).status.success());
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
    // If every user may read the programs, an unprivileged user can run them.
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
    let others = Others::with(&mut robot, &nims, &memory[0]);
    operator_uses_the_gateway(&mut robot, &others);
    a_plug_in_delivers_readings_and_nothing_else(&mut robot, &others);
    robot.fly();
    robot.until("the motion continues", |robot| robot.last.header.cycle > 300);
    assert!(matches!(robot.last.mode, MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_HOLDING));
    assert_eq!(robot.last.faults, 0);
    every_action_is_tried_as_each_user(&mut robot, &others);
    a_finished_run_is_reported_to_whoever_may_look(&mut robot, &others);
}

/// Another user has made a folder with the name of the robot's domain before it starts: it does not start there, and
/// puts nothing into it.
#[test]
fn a_domain_that_another_user_has_prepared_is_refused() {
    if !rustix::process::geteuid().is_root() {
        return notes::left_out("names that another user has taken", "only root can act as another user");
    }
    let name = format!("squat{}", std::process::id() % 100_000);
    let folder = PathBuf::from(format!("/dev/shm/nims-0-{name}"));
    let made = stranger(Path::new("/bin/mkdir"), &["--mode=777", folder.to_str().unwrap()]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let configs = tempfile::tempdir().unwrap();
    let system = robot::copy_configs(configs.path()).join("systems/demo3.toml");
    let output = Command::new(program()).arg("up").arg(&system).args(["--domain", &name]).output().unwrap();
    let (sentence, left) =
        (String::from_utf8_lossy(&output.stderr).into_owned(), fs::read_dir(&folder).unwrap().count());
    fs::remove_dir(&folder).unwrap();
    assert!(!output.status.success() && sentence.contains(&name), "{sentence}");
    assert_eq!(left, 0, "{sentence}");
}

/// On a control box the robots' `/dev/shm` is a file system in a folder that other users cannot enter
/// (`run-nims-shm.mount`): no other user fills it, takes names in it or reads it, before the start and while the robot
/// runs.
#[test]
fn nobody_else_fills_or_enters_the_memory_of_the_services() {
    if !rustix::process::geteuid().is_root() {
        return notes::left_out(
            "the memory of the services as another user",
            "only root can mount and act as another user",
        );
    }
    let copy = open_folder();
    let nims = copy.path().join("nims");
    fs::copy(program(), &nims).unwrap();
    fs::set_permissions(&nims, PermissionsExt::from_mode(0o755)).unwrap();
    let configs = tempfile::tempdir().unwrap();
    let system = robot::copy_configs(configs.path()).join("systems/demo3.toml");
    let script = robot::root().join("tests/scripts/private-memory");
    let mut command = Command::new("unshare");
    command.args(["--mount", "--propagation", "private", "--"]).arg(script);
    let output = command.arg(program()).arg(&system).arg(configs.path()).arg(STRANGER.to_string()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    if said.contains("unshare failed") || said.contains("mount: ") {
        return notes::left_out("the memory of the services as another user", "no file system can be mounted here");
    }
    assert!(output.status.success(), "{said}");
    assert_eq!(said.matches("refused: ").count(), 10, "{said}");
    assert!(said.contains("filled: public memory") && said.contains("robot: still runs"), "{said}");
}
