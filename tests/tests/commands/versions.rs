//! What an installation does to robots that run: `nims-version` and the scripts of the packages in a folder that stands
//! for a machine, with its processes and its service manager.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

const OLD: &str = "0.1.0+20261126000000.a";
const NEW: &str = "0.1.0+20261201000000.b";

fn host(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("configs/host").join(name)
}

fn program(path: &Path, script: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
}

fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout)
}

/// A machine with systemd.
struct Machine {
    folder: tempfile::TempDir,
}

impl Machine {
    /// One on which this version is installed.
    fn with(version: &str) -> Self {
        let machine = Self { folder: tempfile::tempdir().unwrap() };
        fs::create_dir_all(machine.path("run/systemd/system")).unwrap();
        fs::create_dir_all(machine.path("proc")).unwrap();
        fs::create_dir_all(machine.path("var/lib")).unwrap();
        for kind in ["systems", "robots", "missions", "sensors", "ground"] {
            let example = machine.path("usr/share/nims").join(kind).join("any.toml");
            fs::create_dir_all(example.parent().unwrap()).unwrap();
            fs::write(example, "").unwrap();
        }
        // What it is asked goes to a file; it answers from another one.
        let asked = r#"echo "$(basename "$0") $*" >>"$NIMS_ROOT/asked""#;
        let answer = r#"case "$*" in list-units*) cat "$NIMS_ROOT/units" ;; *is-enabled*) test -e "$NIMS_ROOT/enabled" ;; "stop nims-page"*) test ! -e "$NIMS_ROOT/late" || mv "$NIMS_ROOT/late" "$NIMS_ROOT/mode-lab" ;; esac"#;
        for command in ["systemctl", "systemd-sysusers", "systemd-tmpfiles", "deb-systemd-helper", "udevadm"] {
            program(&machine.path("fake").join(command), &format!("{asked}\n{answer}"));
        }
        fs::write(machine.path("units"), "").unwrap();
        let output = machine.add(version);
        assert!(output.status.success(), "{}", printed(&output));
        machine.asked();
        machine
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        let path = format!("{}:{}", self.path("fake").display(), std::env::var("PATH").unwrap());
        command.env("NIMS_ROOT", self.folder.path()).env("PATH", path);
        command
    }

    fn nims_version(&self, words: &[&str]) -> Output {
        self.command(host("nims-version")).args(words).output().unwrap()
    }

    /// The files of a version, as dpkg unpacks them.
    fn unpack(&self, version: &str, content: &str) -> PathBuf {
        let folder = self.path("usr/lib/nims").join(version);
        for name in ["nims", "supervisor", "motor-io", "gateway"] {
            program(&folder.join("bin").join(name), content);
        }
        program(&folder.join("bin/nims-at"), r#"cat "$NIMS_ROOT/mode-$1""#);
        fs::copy(host("nims-version"), folder.join("bin/nims-version")).unwrap();
        folder
    }

    fn add(&self, version: &str) -> Output {
        let folder = self.unpack(version, version);
        self.nims_version(&["add", folder.to_str().unwrap()])
    }

    fn current(&self) -> String {
        fs::read_link(self.path("opt/nims/current")).unwrap().into_os_string().into_string().unwrap()
    }

    /// A process that runs a program of a version, in a unit or in the session of a user.
    fn process(&self, id: u32, version: &str, program: &str, unit: Option<&str>) {
        let folder = self.path("proc").join(id.to_string());
        fs::create_dir_all(&folder).unwrap();
        let program = self.path("opt/nims").join(version).join("bin").join(program);
        symlink(program, folder.join("exe")).unwrap();
        let group = unit.map_or("user.slice/user-1000.slice/session-1.scope".to_owned(), |unit| {
            format!("system.slice/system-{}.slice/{unit}", unit.split('@').next().unwrap())
        });
        fs::write(folder.join("cgroup"), format!("0::/{group}\n")).unwrap();
    }

    fn ends(&self, id: u32) {
        fs::remove_dir_all(self.path("proc").join(id.to_string())).unwrap();
    }

    /// The robot of a service, in a mode; empty: it does not answer.
    fn robot(&self, id: u32, version: &str, name: &str, mode: &str) {
        let unit = format!("nims@{name}.service");
        self.process(id, version, "supervisor", Some(&unit));
        self.process(id + 1, version, "motor-io", Some(&unit));
        let status = if mode.is_empty() { String::new() } else { format!("{{\"mode\":\"{mode}\"}}") };
        fs::write(self.path(&format!("mode-{name}")), status).unwrap();
    }

    /// What was asked since the last call.
    fn asked(&self) -> Vec<String> {
        let asked = fs::read_to_string(self.path("asked")).unwrap_or_default();
        let _ = fs::remove_file(self.path("asked"));
        asked.lines().map(str::to_owned).collect()
    }

    /// Runs a script of a package, whose paths are below the folder.
    fn script(&self, name: &str, words: &[&str]) -> Output {
        let mut text = fs::read_to_string(host("debian").join(name)).unwrap().replace("@VERSION@", NEW);
        for folder in [
            "/usr/lib/nims",
            "/opt/nims",
            "/run/systemd",
            "/run/udev",
            "/var/lib/nims-page",
            "/etc/systemd",
            "/etc/sudoers.d",
            "/proc",
        ] {
            text = text.replace(folder, self.path(&folder[1..]).to_str().unwrap());
        }
        let script = self.path("script");
        program(&script, text.trim_start_matches("#!/bin/sh"));
        self.command(script).args(words).output().unwrap()
    }
}

#[test]
fn a_version_of_which_a_program_runs_is_not_replaced() {
    let machine = Machine::with(OLD);
    let installed = machine.path("opt/nims").join(OLD).join("bin/nims");
    for (program, unit) in
        [("motor-io", Some("nims@lab.service")), ("supervisor", None), ("gateway", Some("nims-gateway@lab.service"))]
    {
        machine.process(7, OLD, program, unit);
        // the same files again: nothing to say
        let output = machine.add(OLD);
        assert!(output.status.success() && printed(&output).is_empty(), "{program}: {}", printed(&output));
        let folder = machine.unpack(OLD, "other");
        let output = machine.nims_version(&["add", folder.to_str().unwrap()]);
        assert!(output.status.success() && printed(&output).contains(OLD), "{program}: {}", printed(&output));
        assert!(printed(&output).contains("systemctl stop"), "{}", printed(&output));
        assert!(fs::read_to_string(&installed).unwrap().contains(OLD), "{program}: replaced");
        machine.ends(7);
    }
    assert_eq!((machine.current(), machine.asked()), (OLD.to_owned(), Vec::new()));
    let folder = machine.unpack(OLD, "other");
    assert!(machine.nims_version(&["add", folder.to_str().unwrap()]).status.success());
    assert!(fs::read_to_string(&installed).unwrap().contains("other"));
    assert_eq!(machine.current(), OLD);
}

/// Programs of a container have the paths of the machine.
#[test]
fn a_version_that_is_not_here_is_installed_whatever_runs() {
    let machine = Machine::with(OLD);
    machine.process(7, NEW, "gateway", Some("nims-gateway@lab.service"));
    let output = machine.add(NEW);
    assert!(output.status.success(), "{}", printed(&output));
    assert_eq!(machine.current(), NEW);
    assert!(machine.path("opt/nims").join(NEW).join("bin/nims").exists());
}

#[test]
fn the_version_changes_while_no_robot_of_a_service_runs() {
    for mode in ["disarmed", "holding", ""] {
        let machine = Machine::with(OLD);
        machine.robot(10, OLD, "lab", mode);
        machine.process(20, OLD, "gateway", Some("nims-gateway@lab.service"));
        let output = machine.add(NEW);
        let told = printed(&output);
        assert!(output.status.success(), "{told}");
        assert!(told.contains(NEW) && told.contains("systemctl stop nims@lab && systemctl start nims@lab\n"), "{told}");
        // Gateway and page stay with their robot.
        assert_eq!((machine.current(), machine.asked()), (OLD.to_owned(), Vec::new()), "{mode}");
        assert!(machine.path("opt/nims").join(NEW).join("bin/nims").exists());
        // A motor-io that is left without its supervisor is a robot too.
        machine.ends(10);
        assert!(machine.nims_version(&["settle"]).status.success());
        assert_eq!(machine.current(), OLD);
        machine.ends(11);
        assert!(machine.nims_version(&["settle"]).status.success());
        assert_eq!(machine.current(), NEW);
        let asked = machine.asked();
        assert_eq!(asked, ["systemctl --no-block try-restart nims-gateway@*.service nims-page@*.service"]);
        assert!(machine.path("opt/nims").join(OLD).is_dir(), "the version to roll back to");
    }
}

#[test]
fn a_robot_that_was_started_by_hand_holds_no_upgrade_back() {
    let machine = Machine::with(OLD);
    machine.process(5, OLD, "supervisor", None);
    machine.process(6, OLD, "motor-io", None);
    assert!(machine.add(NEW).status.success());
    assert_eq!(machine.current(), NEW);
}

#[test]
fn robots_that_are_armed_or_cannot_be_asked_are_named() {
    let machine = Machine::with(OLD);
    let armed = || {
        let output = machine.nims_version(&["armed"]);
        (output.status.code(), printed(&output))
    };
    assert_eq!(armed(), (Some(1), String::new()));
    machine.process(3, OLD, "gateway", Some("nims-gateway@lab.service"));
    machine.robot(10, OLD, "lab", "disarmed");
    assert_eq!(armed(), (Some(1), String::new()));
    machine.robot(20, OLD, "river", "following");
    machine.robot(30, OLD, "silent", "");
    machine.process(40, OLD, "supervisor", None);
    let (code, names) = armed();
    let mut names: Vec<&str> = names.lines().collect();
    names.sort_unstable();
    assert_eq!((code, names), (Some(0), vec!["process 40 (started by hand)", "river", "silent"]));
}

#[test]
fn the_package_is_removed_only_while_no_robot_is_armed() {
    let machine = Machine::with(NEW);
    machine.process(5, NEW, "motor-io", None);
    let output = machine.script("prerm", &["remove"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(printed(&output).contains("process 5"), "{}", printed(&output));
    assert_eq!(machine.asked(), Vec::<String>::new());
    assert!(machine.script("prerm", &["upgrade", NEW]).status.success(), "an upgrade ends nothing");
    machine.ends(5);
    machine.robot(10, NEW, "lab", "holding");
    let output = machine.script("prerm", &["remove"]);
    assert!(output.status.code() == Some(1) && printed(&output).contains("lab"), "{}", printed(&output));
    fs::write(machine.path("mode-lab"), "{\"mode\":\"disarmed\"}").unwrap();
    let output = machine.script("prerm", &["remove"]);
    assert!(output.status.success(), "{}", printed(&output));
    let asked = machine.asked();
    let place = |words: &str| asked.iter().position(|line| line.starts_with(words)).expect(words);
    assert!(place("systemctl stop nims-page@*") < place("systemctl stop nims@*"), "{asked:?}");
    assert!(place("systemctl stop nims@*") < place("systemctl stop run-nims-shm.mount"), "{asked:?}");
}

#[test]
fn a_robot_that_is_armed_during_a_removal_stays() {
    let machine = Machine::with(NEW);
    machine.robot(10, NEW, "lab", "disarmed");
    fs::write(machine.path("units"), "nims-gateway@lab.service loaded active running nims\n").unwrap();
    fs::write(machine.path("late"), "{\"mode\":\"holding\"}").unwrap();
    let output = machine.script("prerm", &["remove"]);
    assert!(output.status.code() == Some(1) && printed(&output).contains("lab"), "{}", printed(&output));
    let asked = machine.asked();
    assert!(!asked.iter().any(|line| line.starts_with("systemctl stop nims@")), "{asked:?}");
    assert_eq!(asked.last().unwrap(), "systemctl start nims-gateway@lab.service");
}

#[test]
fn a_version_comes_back_after_an_interrupted_copy() {
    let machine = Machine::with(OLD);
    let version = machine.path("opt/nims").join(OLD);
    fs::rename(&version, machine.path(&format!("opt/nims/.old-{OLD}"))).unwrap();
    assert!(machine.nims_version(&["settle"]).status.success());
    assert!(version.join("bin/nims").exists());
    // One that was replaced before the interruption is removed.
    fs::create_dir(machine.path(&format!("opt/nims/.old-{OLD}"))).unwrap();
    assert!(machine.nims_version(&["settle"]).status.success());
    assert!(version.join("bin/nims").exists() && !machine.path(&format!("opt/nims/.old-{OLD}")).exists());
}

#[test]
fn an_installation_enables_nothing_that_was_disabled() {
    if Command::new("dpkg").arg("--version").output().is_err() {
        return notes::left_out("an installation enables nothing that was disabled", "there is no dpkg");
    }
    let machine = Machine::with(OLD);
    machine.unpack(NEW, NEW);
    fs::write(machine.path("units"), "nims@lab.service loaded active running nims\n").unwrap();
    let configure = |before: &str| {
        machine.asked();
        let output = machine.script("postinst", &["configure", before]);
        assert!(output.status.success(), "{}", printed(&output));
        machine.asked()
    };
    let has = |asked: &[String], words: &str| asked.iter().any(|line| line.contains(words));
    let asked = configure(OLD);
    assert!(!has(&asked, "nims-gateway@lab") && !has(&asked, "start nims-runs.timer"), "{asked:?}");
    // Before there were gateways, sudo was the way to a robot.
    let asked = configure("0.1.0+20251101000000.c");
    assert!(has(&asked, "enable --now nims-gateway@lab.service"), "{asked:?}");
    fs::write(machine.path("enabled"), "").unwrap();
    let asked = configure("");
    assert!(!has(&asked, "nims-gateway@lab") && has(&asked, "start nims-runs.timer"), "{asked:?}");
}

/// Without it, the settings of the present devices would wait for the next boot.
#[test]
fn an_installation_applies_each_rule_to_the_devices_that_are_there() {
    let machine = Machine::with(OLD);
    machine.unpack(NEW, NEW);
    fs::create_dir_all(machine.path("run/udev")).unwrap();
    let control = std::os::unix::net::UnixListener::bind(machine.path("run/udev/control")).unwrap();
    let output = machine.script("postinst", &["configure"]);
    assert!(output.status.success(), "{}", printed(&output));
    drop(control);
    let asked = machine.asked();
    let trigger = asked.iter().find(|line| line.starts_with("udevadm trigger")).expect("udevadm trigger");
    let script = fs::read_to_string(host("../../scripts/install")).unwrap();
    assert!(script.contains(trigger.as_str()), "scripts/install asks for something else than {trigger}");
    let rules = fs::read_to_string(host("70-nims.rules")).unwrap();
    // The subsystem of the one device that has no condition on it.
    assert!(rules.contains("KERNEL==\"cpu_dma_latency\"") && trigger.contains("--subsystem-match=misc"), "{trigger}");
    for (_, rest) in rules.match_indices("SUBSYSTEM").map(|(at, word)| rules[at..].split_at(word.len())) {
        let subsystem = rest.split('"').nth(1).unwrap();
        assert!(trigger.split(' ').any(|word| word == format!("--subsystem-match={subsystem}")), "{subsystem}");
    }
}

/// A program that is running, which nothing can write to.
struct Busy(Child);

impl Drop for Busy {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_page_is_replaced_while_it_runs() {
    let machine = Machine::with(OLD);
    let folder = machine.unpack(NEW, NEW);
    fs::create_dir(folder.join("bin/page")).unwrap();
    fs::write(folder.join("bin/page/index.html"), "new").unwrap();
    // `nims` comes first, and brings a page that the service starts before the package of the page is configured.
    fs::copy("/bin/bash", folder.join("bin/nims-page")).unwrap();
    assert!(machine.nims_version(&["add", folder.to_str().unwrap()]).status.success());
    let bin = machine.path("opt/nims").join(NEW).join("bin");
    let waiting = ["-c", "read line"];
    let mut page = Busy(Command::new(bin.join("nims-page")).args(waiting).stdin(Stdio::piped()).spawn().unwrap());
    fs::remove_dir_all(bin.join("page")).unwrap();
    let output = machine.script("page/postinst", &["configure", OLD]);
    assert!(output.status.success(), "{}", printed(&output));
    assert!(page.0.try_wait().unwrap().is_none(), "the page still ran");
    assert_eq!(fs::read_to_string(bin.join("page/index.html")).unwrap(), "new");
    assert!(machine.asked().iter().any(|line| line.contains("try-restart nims-page@*.service")));
}

/// `apt install` of the package nims alone removes those of its parts. A page that was stopped on purpose stays so.
#[test]
fn the_page_of_a_robot_that_runs_comes_back_after_its_removal() {
    let machine = Machine::with(OLD);
    let folder = machine.unpack(NEW, NEW);
    for name in ["nims-page", "viewer"] {
        program(&folder.join("bin").join(name), NEW);
    }
    fs::create_dir(folder.join("bin/page")).unwrap();
    fs::write(folder.join("bin/page/index.html"), "page").unwrap();
    assert!(machine.nims_version(&["add", folder.to_str().unwrap()]).status.success());
    let bin = machine.path("opt/nims").join(NEW).join("bin");
    let there = || ["nims-page", "page/index.html", "viewer"].map(|name| bin.join(name).exists());
    let remove = || {
        for part in ["page", "viewer"] {
            let output = machine.script(&format!("{part}/prerm"), &["remove"]);
            assert!(output.status.success(), "{}", printed(&output));
        }
    };
    machine.robot(10, NEW, "lab", "holding");
    let started = |words: &[&str]| {
        let output = machine.script("page/postinst", words);
        assert!(output.status.success(), "{}", printed(&output));
        let asked = machine.asked();
        asked.into_iter().filter(|line| line.starts_with("systemctl start")).collect::<Vec<_>>()
    };
    let wants = machine.path("etc/systemd/system/multi-user.target.wants");
    fs::create_dir_all(&wants).unwrap();
    symlink("/lib/systemd/system/nims-page@.service", wants.join("nims-page@enabled.service")).unwrap();
    // As systemctl lists those that run.
    let cases = [
        (["configure", NEW], vec!["lab", r"far\x2driver"]),
        (["abort-remove", ""], vec!["lab"]),
        (["configure", NEW], Vec::new()),
    ];
    for (words, running) in cases {
        let units = running.iter().map(|name| format!("nims-page@{name}.service loaded active running nims\n"));
        fs::write(machine.path("units"), units.collect::<String>()).unwrap();
        remove();
        assert_eq!(there(), [true; 3]);
        let asked = machine.asked();
        let place = |words: &str| asked.iter().position(|line| line.starts_with(words)).expect(words);
        assert!(place("systemctl list-units") < place("systemctl stop nims-page@*.service"), "{asked:?}");
        let expected: Vec<_> = running.iter().map(|name| format!("systemctl start nims-page@{name}.service")).collect();
        assert_eq!(started(&words), expected);
        assert!(machine.script("page/prerm", &["upgrade", NEW]).status.success());
        assert_eq!(started(&["configure", NEW]), Vec::<String>::new(), "an upgrade of the page alone");
    }
    // Packages before there was a list ended the pages without one.
    assert_eq!(started(&["configure", OLD]), ["systemctl start nims-page@enabled.service"]);
    // A removal that is repeated after an interruption finds nothing that runs.
    fs::write(machine.path("units"), "nims-page@lab.service loaded active running nims\n").unwrap();
    remove();
    fs::write(machine.path("units"), "").unwrap();
    remove();
    machine.asked();
    assert_eq!(started(&["configure", NEW]), ["systemctl start nims-page@lab.service"]);
    fs::write(machine.path("var/lib/nims-page.ended"), "").unwrap();
    assert!(machine.script("page/postrm", &["purge"]).status.success());
    assert!(!machine.path("var/lib/nims-page.ended").exists());
    machine.ends(10);
    machine.ends(11);
    remove();
    assert_eq!(there(), [false; 3]);
}

#[test]
fn an_installation_by_the_script_is_removed_only_while_no_robot_is_armed() {
    let machine = Machine::with(OLD);
    machine.process(5, OLD, "motor-io", None);
    let install = host("../../scripts/install");
    let remove =
        || machine.command(&install).arg("--root").arg(machine.folder.path()).arg("--remove").output().unwrap();
    let output = remove();
    assert!(!output.status.success() && printed(&output).contains("process 5"), "{}", printed(&output));
    assert!(machine.path("opt/nims/current").exists());
    machine.ends(5);
    let output = remove();
    assert!(output.status.success(), "{}", printed(&output));
    assert!(!machine.path("opt/nims").exists());
}
