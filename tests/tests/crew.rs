//! The processes of a running robot: started, ended, restarted, plugged in and unplugged by the operator, and what their states say.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use bus::{Domain, TestDomain, clock};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

fn program() -> PathBuf {
    let path = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(path.is_file(), "there is no {}: `cargo build --workspace --bins` first", path.display());
    path
}

/// A supervisor in a domain and a folder of its own.
struct Up {
    supervisor: Child,
    folder: tempfile::TempDir,
    domain: TestDomain,
}

impl Up {
    /// The three-line robot, with more text at the end of its box file.
    fn begin(more: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let configs = folder.path().join("configs");
        for place in ["robots", "boxes", "missions"] {
            std::fs::create_dir_all(configs.join(place)).unwrap();
            for entry in std::fs::read_dir(root().join("configs").join(place)).unwrap() {
                let entry = entry.unwrap();
                std::fs::copy(entry.path(), configs.join(place).join(entry.file_name())).unwrap();
            }
        }
        let file = configs.join("boxes/demo3.toml");
        let text = std::fs::read_to_string(&file).unwrap();
        std::fs::write(&file, text + more).unwrap();
        let domain = Domain::for_test();
        let supervisor = Command::new(program())
            .args(["up", "--domain", domain.name(), "--json", "--run"])
            .arg(folder.path().join("run"))
            .arg(file)
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(folder.path().join("stderr")).unwrap())
            .spawn()
            .unwrap();
        Self { supervisor, folder, domain }
    }

    fn ready(more: &str) -> Self {
        let up = Self::begin(more);
        up.until("the robot is up", |up| up.said().contains("is ready to arm"));
        up
    }

    fn said(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("stderr")).unwrap_or_default()
    }

    fn until(&self, what: &str, done: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + 40_000_000_000;
        while !done(self) {
            assert!(clock::now_ns() < give_up, "{what}: not within 40 s\n{}", self.said());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn nims(&self, args: &[&str]) -> Output {
        // Options of the robot's own command first: behind `--` they belong to the plugged program.
        Command::new(program())
            .args(["--domain", self.domain.name()])
            .args(args)
            .current_dir(self.folder.path())
            .output()
            .unwrap()
    }

    fn ask(&self, args: &[&str]) -> String {
        let output = self.nims(args);
        assert!(output.status.success(), "{args:?}: {}\n{}", String::from_utf8_lossy(&output.stderr), self.said());
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// One sentence with these words, and nothing has happened.
    fn refused(&self, args: &[&str], words: &[&str]) {
        let output = self.nims(args);
        let sentence = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{args:?} was accepted");
        assert_eq!(sentence.trim_end().lines().count(), 1, "{sentence}");
        for word in words {
            assert!(sentence.contains(word), "{args:?}: no {word:?} in {sentence}");
        }
    }

    /// A row of the process table.
    fn row(&self, name: &str) -> Option<Value> {
        let status: Value = serde_json::from_slice(&self.nims(&["status", "--json"]).stdout).unwrap_or(Value::Null);
        status["processes"].as_array()?.iter().find(|row| row["name"] == name).cloned()
    }

    fn state(&self, name: &str) -> String {
        self.row(name).map_or("no row".to_owned(), |row| row["state"].as_str().unwrap_or_default().to_owned())
    }

    fn pid(&self, name: &str) -> u64 {
        self.row(name).and_then(|row| row["pid"].as_u64()).unwrap_or(0)
    }

    fn end(&mut self) -> Option<i32> {
        signal(u64::from(self.supervisor.id()), "INT");
        let give_up = clock::now_ns() + 40_000_000_000;
        loop {
            if let Some(status) = self.supervisor.try_wait().unwrap() {
                return status.code();
            }
            assert!(clock::now_ns() < give_up, "nims up does not end\n{}", self.said());
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        if self.supervisor.try_wait().ok().flatten().is_none() {
            signal(u64::from(self.supervisor.id()), "INT");
            for _ in 0..1000 {
                if self.supervisor.try_wait().ok().flatten().is_some() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            let _ = self.supervisor.kill();
        }
        for node in self.domain.alive() {
            if node.pid != std::process::id() {
                signal(u64::from(node.pid), "KILL");
            }
        }
    }
}

fn signal(pid: u64, name: &str) {
    assert!(pid > 1, "0 would be everybody here");
    let _ = Command::new("kill").args([format!("-{name}"), pid.to_string()]).stderr(Stdio::null()).status();
}

fn lives(pid: u64) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    !stat.is_empty() && !stat.contains(") Z")
}

#[test]
fn processes_come_and_go_while_the_robot_runs() {
    let mut up = Up::ready("");
    // A second controller beside the first one, in the free slot.
    assert!(up.ask(&["start", "controller"]).contains("controller-b is ready"));
    assert_eq!(up.state("controller-b"), "ready");
    assert_eq!(up.state("controller"), "ready");
    up.refused(&["start", "controller"], &["both slots", "stop-process"]);
    up.refused(&["start", "controller", "--slot", "b"], &["controller-b runs already", "restart"]);
    let second = up.pid("controller-b");
    up.ask(&["stop-process", "controller-b"]);
    assert_eq!(up.state("controller-b"), "stopped");
    assert!(!lives(second));
    up.refused(&["stop-process", "controller-b"], &["does not run"]);

    // An ended one comes back under the same name, with another id.
    let planner = up.pid("planner");
    up.ask(&["restart", "planner"]);
    assert!(up.pid("planner") != planner && !lives(planner));
    assert_eq!(up.state("planner"), "ready");

    // Programs that the box file does not know.
    std::fs::write(up.folder.path().join("sensor.sh"), "echo $1 > plugged; exec sleep 1000\n").unwrap();
    up.ask(&["plug", "wind", "--", "sh", "sensor.sh", "{name}/{domain}"]);
    assert_eq!(up.state("wind"), "running", "it sends no heartbeat, so it is not called ready");
    let plugged = std::fs::read_to_string(up.folder.path().join("plugged")).unwrap();
    assert_eq!(plugged.trim(), format!("wind/{}", up.domain.name()));
    let wind = up.pid("wind");
    up.refused(&["plug", "wind", "--", "sleep", "1000"], &["\"wind\" is taken"]);
    up.refused(&["plug", "planner", "--", "sleep", "1000"], &["\"planner\" is taken"]);
    up.refused(&["plug", "Wind!", "--", "sleep", "1000"], &["a-z"]);
    up.refused(&["plug", "rain", "--", "no-such-program"], &["no-such-program", "PATH"]);
    up.refused(&["plug", "rain", "--", "./sensor"], &["./sensor"]);
    up.refused(&["unplug", "planner"], &["cannot be unplugged"]);
    up.refused(&["unplug", "rain"], &["no process \"rain\"", "wind"]);
    up.ask(&["unplug", "wind"]);
    assert_eq!(up.state("wind"), "no row");
    assert!(!lives(wind));
    assert_eq!(up.end(), Some(0), "nothing has died: {}", up.said());
}

#[test]
fn a_plugged_program_that_ends_at_once_says_why() {
    let mut up = Up::ready("");
    let failing = ["plug", "rain", "--", "sh", "-c", "echo the gauge is not there >&2; exit 3"];
    up.refused(&failing, &["rain", "exit code 3", "the gauge is not there"]);
    assert_eq!(up.state("rain"), "DIED");
    // The name is free again.
    up.ask(&["plug", "rain", "--", "sleep", "1000"]);
    assert_eq!(up.end(), Some(1), "a run in which rain died is no success");
}

#[test]
fn what_flies_the_robot_is_not_ended_while_it_moves() {
    let mut up = Up::ready("");
    // Just after the start, on a busy machine, a drive may still be coming up.
    up.until("it is armed", |up| up.nims(&["arm"]).status.success());
    up.ask(&["zero", "--at", "4.8,3.0,0.3"]);
    up.until("an estimate", |up| up.ask(&["status"]).contains("node       at"));
    up.ask(&["goto", "5.4,3.6,0.7", "--speed", "0.1"]);
    up.until("the move has begun", |up| up.ask(&["status"]).contains("following:"));
    for name in ["controller", "estimator", "motor-io", "motor-box"] {
        up.refused(&["stop-process", name], &["the robot moves", name, "nims hold"]);
        up.refused(&["restart", name], &["the robot moves", name]);
    }
    up.ask(&["hold"]);
    up.until("it holds", |up| up.ask(&["status"]).contains("holding:"));
    up.ask(&["restart", "controller"]);
    assert_eq!(up.state("controller"), "ready");
    assert_eq!(up.end(), Some(0), "{}", up.said());
}

#[test]
fn a_standby_is_kept_and_a_dead_one_is_started_again() {
    let more = "\n[[process]]\nname = \"second\"\nrole = \"controller\"\nstandby = true\nrestart_pause_s = 0.1\n\
                \n[[process]]\nname = \"spare\"\nrole = \"estimator\"\nstart = false\n\
                \n[[process]]\nname = \"flaky\"\ncommand = [\"sh\", \"-c\", \"sleep 0.05; exit 7\"]\nrestart = true\nrestart_pause_s = 0.1\nrestart_limit = 2\n";
    let mut up = Up::ready(more);
    assert_eq!(up.state("controller-b"), "ready");
    assert_eq!(up.state("spare"), "stopped", "it waits to be asked for");
    for name in ["controller", "controller-b"] {
        let before = up.pid(name);
        signal(before, "KILL");
        up.until("it is started again", |up| up.state(name) == "ready" && up.pid(name) != before);
    }
    assert!(up.said().contains("controller was ended by signal 9: controller-b goes on"), "{}", up.said());
    // By the name that it has in the box file too.
    up.ask(&["restart", "second"]);
    up.ask(&["start", "spare"]);
    assert_eq!(up.state("estimator-b"), "ready");
    assert_eq!(up.state("spare"), "no row", "it runs under the name of its slot");
    // What keeps dying is given up.
    up.until("flaky is given up", |up| up.state("flaky") == "DIED for good");
    assert_eq!(up.said().matches("flaky ended with exit code 7").count(), 3, "{}", up.said());
    assert_eq!(up.end(), Some(1));
}

#[test]
fn a_process_that_does_not_get_ready_is_named_and_nothing_is_left_behind() {
    let mut up = Up::begin(
        "\n[[process]]\nname = \"planner\"\nrole = \"planner\"\ncommand = [\"sh\", \"-c\", \"sleep 1000\"]\n",
    );
    up.until("it is named", |up| up.said().contains("still waiting for planner"));
    assert_eq!(up.end(), Some(1));
    assert!(up.said().contains("stopped while starting"), "{}", up.said());
    assert!(up.domain.alive().is_empty(), "{:?}", up.domain.alive());

    let up = Up::begin(
        "\n[[process]]\nname = \"planner\"\nrole = \"planner\"\ncommand = [\"sh\", \"-c\", \"echo no maps >&2; exit 1\"]\n",
    );
    up.until("it is named", |up| up.said().contains("planner did not come up: no maps"));
    up.until("nothing is left", |up| up.domain.alive().is_empty());
}

#[test]
fn a_closed_terminal_is_an_orderly_end() {
    let mut up = Up::ready("");
    signal(u64::from(up.supervisor.id()), "HUP");
    up.until("it has ended", |up| up.domain.alive().is_empty());
    assert_eq!(up.supervisor.wait().unwrap().code(), Some(0), "{}", up.said());
    assert!(up.folder.path().join("run/run.mcap").is_file());
}
