//! `nims bench`: every figure is present, the counts add up, and nothing is left behind, however it ends. The values of
//! the figures are not asserted.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use bus::{Bus, Domain};
use rustix::process::{Pid, Signal, getuid, kill_process};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

const SHARED_MEMORY: &str = "/dev/shm";
/// Polls a condition every ten milliseconds; the limit allows for a machine that stands still.
const LOOKS: usize = 12_000;

/// A benchmark removes the remains of killed ones, also those of another test.
static ONE_BENCH: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ONE_BENCH.lock().unwrap_or_else(PoisonError::into_inner)
}

fn nims(args: &[&str]) -> Child {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(program.is_file(), "{} is missing: run `cargo build --workspace --bins` first", program.display());
    let piped = Command::new(program).args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    piped.unwrap()
}

/// Runs `nims bench`; robots of other tests may run on this machine.
fn bench(runs: &Path, args: &[&str]) -> Child {
    let runs = runs.to_str().unwrap();
    nims(&[&["bench", "--beside", "--runs", runs], args].concat())
}

/// Its end: exit code, standard output, standard error; checks that nothing is left behind.
fn ended(child: Child, runs: &Path) -> (Option<i32>, String, String) {
    let pid = child.id();
    let Output { status, stdout, stderr } = child.wait_with_output().unwrap();
    assert_eq!(left(pid, runs), Vec::<PathBuf>::new());
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

fn memory_of(pid: u32) -> PathBuf {
    Path::new(SHARED_MEMORY).join(format!("nimsbench-{}-{pid}", getuid().as_raw()))
}

/// Remains of a benchmark in shared memory and on the disk.
fn left(pid: u32, runs: &Path) -> Vec<PathBuf> {
    let root = memory_of(pid);
    // the format that `bus` creates
    let prefix = format!("nims{:08x}_", messages::hash_of(root.to_str().unwrap()));
    let inside = |folder: &Path| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    let mut left = inside(Path::new(SHARED_MEMORY));
    left.retain(|path| *path == root || path.file_name().unwrap().to_string_lossy().starts_with(&prefix));
    left.extend(inside(runs));
    left
}

fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    for _ in 0..LOOKS {
        if is_so() {
            return;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("waited in vain: {what}");
}

fn signal(pid: u32, signal: Signal) {
    kill_process(Pid::from_raw(pid.cast_signed()).unwrap(), signal).unwrap();
}

/// The second process of a benchmark, if it runs: its parent is field 4 of /proc/PID/stat, its state field 3.
fn peer_of(parent: u32) -> Option<u32> {
    let numbers = fs::read_dir("/proc").unwrap().flatten();
    let mut numbers = numbers.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    numbers.find(|pid| {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        fields.len() > 1 && fields[0] != "Z" && fields[1] == parent.to_string()
    })
}

/// Waits until both processes of a benchmark communicate over the bus.
fn until_both_speak(child: &Child) -> u32 {
    let mut peer = None;
    until("the other process", || {
        peer = peer_of(child.id());
        peer.is_some()
    });
    let root = memory_of(child.id());
    let name = root.to_str().unwrap();
    until("two processes in the domain", || {
        Domain::existing(name).ok().flatten().is_some_and(|domain| domain.alive().len() == 2)
    });
    peer.unwrap()
}

/// All numbers, each with its path.
fn numbers(value: &Value, path: &str, found: &mut Vec<(String, f64)>) {
    match value {
        Value::Number(number) => found.push((path.to_owned(), number.as_f64().unwrap())),
        Value::Array(values) => values.iter().for_each(|value| numbers(value, path, found)),
        Value::Object(members) => {
            members.iter().for_each(|(name, value)| numbers(value, &format!("{path}/{name}"), found));
        }
        _ => {}
    }
}

#[test]
fn every_figure_is_there_and_nothing_is_left() {
    let _alone = alone();
    let runs = tempfile::tempdir().unwrap();
    let (code, out, err) = ended(bench(runs.path(), &["--json", "--rate", "200", "--seconds", "0.3"]), runs.path());
    assert_eq!(code, Some(0), "{err}");
    assert!(err.is_empty(), "drew without a terminal: {err}");
    let found: Value = serde_json::from_str(&out).unwrap();
    let mut figures = Vec::new();
    numbers(&found, "", &mut figures);
    for (path, figure) in &figures {
        let may_be_zero = ["/late", "/skipped", "/idle_latency_us", "/cpu"].iter().any(|end| path.ends_with(end));
        assert!(figure.is_finite() && (*figure > 0.0 || may_be_zero && *figure == 0.0), "{path} is {figure}");
    }
    for figure in [
        "/period_s",
        "/tick/ours/median_s",
        "/tick/ours/p9999_s",
        "/tick/plain/worst_s",
        "/tick/ratio/p999",
        "/bus/sample_bytes",
        "/bus/ours/p999_s",
        "/bus/ratio/median",
        "/chain/median_share",
        "/chain/p999_share",
        "/chain/tensions/plain/median_s",
        "/chain/tensions/ratio/median",
        "/disk/ours/mb_s",
        "/disk/ours/sync/worst_s",
        "/disk/plain/sync/worst_s",
        "/disk/ratio/median",
        "/disk/compressed_to",
    ] {
        assert!(figures.iter().any(|(path, _)| path == figure), "no {figure} in {found}");
    }
    for way in ["ours", "plain"] {
        let ticks = &found["tick"][way];
        let [count, late, skipped, periods] =
            ["count", "late", "skipped", "periods"].map(|name| ticks[name].as_u64().unwrap());
        assert_eq!(count + skipped, periods, "{ticks}");
        assert!(late <= count && periods >= 60, "{ticks}");
        for spread in [&found["bus"][way], &found["chain"]["tensions"][way], &found["disk"][way], ticks] {
            let [median, tail, worst] = ["median_s", "p999_s", "worst_s"].map(|name| spread[name].as_f64().unwrap());
            assert!(median <= tail && tail <= worst, "{spread}");
        }
    }
    assert_eq!(found["bus"]["ours"]["count"], found["bus"]["plain"]["count"]);
    assert_eq!(found["disk"]["ours"]["count"], found["disk"]["plain"]["count"]);
    assert_eq!(found["bus"]["sample_bytes"], size_of::<messages::MotorState>());
    for part in ["tick", "bus", "chain", "disk"] {
        let verdict = &found[part]["verdict"];
        let said = verdict["finding"].as_str().unwrap();
        // The part, and the rate of the system file.
        assert!(said.starts_with(&format!("{part}: ")) && said.contains("200 Hz"), "{verdict}");
        assert_eq!(verdict["level"] == "note", verdict["cure"] == "", "{verdict}");
    }
}

#[test]
fn a_certificate_needs_a_million_wake_ups_and_says_so() {
    let _alone = alone();
    let runs = tempfile::tempdir().unwrap();
    let system = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("configs/systems/demo3.toml");
    let page = tempfile::NamedTempFile::new().unwrap();
    let args = ["--json", "--certificate", page.path().to_str().unwrap(), "--system", system.to_str().unwrap()];
    let (code, out, err) = ended(bench(runs.path(), &[&args[..], &["--seconds", "0.5"]].concat()), runs.path());
    assert!(code == Some(1) && err.lines().count() == 1, "{err}");
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["verdict"], "not certified");
    assert!(
        found["reasons"].to_string().contains("needs 1000000")
            && !found["reasons"].to_string().contains("without load")
    );
    let classes = found["tick"]["ours"]["classes"].as_array().unwrap();
    let counted: u64 = classes.iter().map(|class| class[1].as_u64().unwrap()).sum();
    assert_eq!(Some(counted), found["tick"]["ours"]["count"].as_u64());
    let text = fs::read_to_string(page.path()).unwrap();
    assert!(text.contains(">not certified<") && text.contains("demo3.toml") && text.contains("</svg>"), "{text}");
    // Without a system there is nothing to certify.
    let (code, _, err) = ended(bench(runs.path(), &args[..3]), runs.path());
    assert!(code == Some(2) && err.contains("--system"), "{err}");
}

#[test]
fn only_the_requested_figures_are_measured_for_the_named_system() {
    let _alone = alone();
    let runs = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let file = root.join("configs/systems/fast3.toml");
    let args = ["--system", file.to_str().unwrap(), "--seconds", "0.05", "chain", "tick"];
    let (code, out, err) = ended(bench(runs.path(), &args), runs.path());
    assert_eq!(code, Some(0), "{err}");
    let at = |word: &str| out.find(word).unwrap_or_else(|| panic!("no {word:?} in {out}"));
    assert!(at("as motor-io waits") < at("a cycle of the control chain"), "{out}");
    at("200 Hz");
    // The requested scheduling may or may not be permitted: the report names each process with what it got.
    at("priorities granted by the kernel: motor-io");
    assert!(!out.contains("bus:") && !out.contains("disk:"), "{out}");
}

#[test]
fn ctrl_c_and_the_death_of_the_other_process_leave_nothing() {
    let _alone = alone();
    let runs = tempfile::tempdir().unwrap();
    let child = bench(runs.path(), &["bus", "--seconds", "600"]);
    signal(until_both_speak(&child), Signal::KILL);
    let (code, out, err) = ended(child, runs.path());
    assert_eq!(code, Some(1), "{err}");
    assert!(out.is_empty() && err.lines().count() == 1, "{out}{err}");

    let child = bench(runs.path(), &["bus", "--seconds", "600"]);
    until_both_speak(&child);
    signal(child.id(), Signal::INT);
    let (code, out, err) = ended(child, runs.path());
    assert_eq!(code, Some(1), "{err}");
    assert!(out.is_empty() && err.lines().count() == 1 && err.contains("stopped"), "{out}{err}");
}

#[test]
fn the_remains_of_a_killed_benchmark_are_removed_by_the_next() {
    let _alone = alone();
    let runs = tempfile::tempdir().unwrap();
    let mut child = bench(runs.path(), &["bus", "--seconds", "600"]);
    let pid = child.id();
    until_both_speak(&child);
    child.kill().unwrap();
    child.wait().unwrap();
    // another benchmark on this machine may have been as quick
    if let Some(domain) = Domain::existing(memory_of(pid).to_str().unwrap()).unwrap() {
        until("the end of the other process", || domain.alive().is_empty());
    }

    let mut killed = bench(runs.path(), &["disk", "--seconds", "600"]);
    until("a file on the disk", || !left(killed.id(), runs.path()).is_empty() || killed.try_wait().unwrap().is_some());
    killed.kill().unwrap();
    killed.wait().unwrap();

    let (code, _, err) = ended(bench(runs.path(), &["disk", "--seconds", "0.05"]), runs.path());
    assert_eq!(code, Some(0), "{err}");
    assert_eq!(left(pid, runs.path()), Vec::<PathBuf>::new());
}

#[test]
fn a_benchmark_beside_a_running_robot_requires_beside() {
    let _alone = alone();
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "motor-io").unwrap();
    let Output { status, stdout, stderr } = nims(&["bench", "chain"]).wait_with_output().unwrap();
    let err = String::from_utf8(stderr).unwrap();
    assert_eq!((status.code(), stdout.len(), err.lines().count()), (Some(1), 0, 1), "{err}");
    assert!(err.contains("--beside"), "the option is named: {err}");
    assert_eq!(domain.alive().len(), 1);
    drop(bus);
}
