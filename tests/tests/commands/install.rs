//! `scripts/install` into a folder: the installed files, upgrade, roll-back, removal, and the quota of the runs.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// Every program of the workspace.
fn workspace() -> Vec<String> {
    let services = fs::read_dir(project().join("services")).unwrap().map(|entry| entry.unwrap().path());
    let own = |folder: &PathBuf| !fs::read_to_string(folder.join("Cargo.toml")).unwrap().contains("[workspace]");
    let programs = services.filter(|folder| folder.join("src/main.rs").exists()).filter(own);
    programs.map(|folder| folder.file_name().unwrap().to_str().unwrap().to_owned()).collect()
}

/// A folder with programs that print `word`.
fn programs(folder: &Path, word: &str) -> PathBuf {
    let folder = folder.join(word);
    fs::create_dir(&folder).unwrap();
    for program in workspace() {
        let path = folder.join(program);
        fs::write(&path, format!("#!/bin/sh\necho {word}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }
    folder
}

/// Adds the page to the programs of a folder, as `scripts/page` does.
fn build_page(programs: &Path) {
    fs::create_dir(programs.join("page")).unwrap();
    fs::write(programs.join("page/index.html"), "page").unwrap();
    fs::copy(programs.join("nims"), programs.join("nims-page")).unwrap();
    let mut command = Command::new("bash");
    let noted = command.args(["-c", ". scripts/common.sh; note_version \"$0\" nims-page"]).arg(programs);
    assert!(noted.current_dir(project()).status().unwrap().success());
}

fn install(root: &Path, more: &[&str]) -> Output {
    Command::new(project().join("scripts/install")).arg("--root").arg(root).args(more).output().unwrap()
}

/// Every file and link below a folder.
fn files_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        if entry.file_type().unwrap().is_dir() { files_below(&entry.path(), found) } else { found.push(entry.path()) }
    }
}

fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout)
}

fn current_output(root: &Path) -> String {
    // The link of a control box is absolute; below a test folder only its last part is meaningful.
    let version = fs::read_link(root.join("opt/nims/current")).unwrap();
    fs::read_to_string(root.join("opt/nims").join(version).join("bin/nims")).unwrap()
}

fn every_example_keeps_its_runs_where_the_service_may_write(root: &Path) {
    let examples = fs::read_dir(root.join("etc/nims/systems")).unwrap();
    let examples: Vec<PathBuf> = examples.map(|entry| entry.unwrap().path()).collect();
    assert!(examples.len() > 5, "{examples:?}");
    for example in examples {
        let file = config::SystemFile::load(&example).unwrap();
        assert_eq!(file.runs, Path::new("/var/lib/nims/runs"), "{}", example.display());
    }
}

#[test]
fn installed_upgraded_rolled_back_and_removed() {
    let folder = tempfile::Builder::new().prefix("with spaces ").tempdir().unwrap();
    let root = folder.path().join("root");
    let old = programs(folder.path(), "old");
    build_page(&old);
    let output = install(&root, &["--programs", old.to_str().unwrap()]);
    assert!(output.status.success(), "{}", printed(&output));
    assert!(current_output(&root).contains("old"));
    assert_eq!(fs::read_link(root.join("usr/bin/nims")).unwrap(), Path::new("/opt/nims/current/bin/nims"));
    // Operators use the gateway, and no rule of sudo.
    assert!(root.join("usr/lib/systemd/system/nims-gateway@.service").is_file());
    assert!(!root.join("etc/sudoers.d/nims").exists());
    // The page was built, and the live view was not.
    let bin = root.join("opt/nims").join(fs::read_link(root.join("opt/nims/current")).unwrap()).join("bin");
    assert!(bin.join("nims-page").is_file() && bin.join("page/index.html").is_file());
    assert!(root.join("usr/lib/systemd/system/nims-page@.service").is_file());
    assert!(root.join("usr/lib/sysusers.d/nims-page.conf").is_file());
    assert!(!bin.join("viewer").exists());
    let boxed = root.join("etc/nims/systems/demo3.toml");
    every_example_keeps_its_runs_where_the_service_may_write(&root);

    let output = install(&root, &["--roll-back"]);
    assert!(!output.status.success(), "there is no earlier version: {}", printed(&output));

    // An earlier version under another name, as an upgrade finds it; the operator's changes are kept.
    let current = fs::read_link(root.join("opt/nims/current")).unwrap();
    fs::rename(root.join("opt/nims").join(&current), root.join("opt/nims/0.0.1")).unwrap();
    fs::remove_file(root.join("opt/nims/current")).unwrap();
    symlink("0.0.1", root.join("opt/nims/current")).unwrap();
    fs::write(&boxed, "# mine\n").unwrap();
    let new = programs(folder.path(), "new");
    assert!(install(&root, &["--programs", new.to_str().unwrap()]).status.success());
    assert!(current_output(&root).contains("new"));
    assert_eq!(fs::read_to_string(&boxed).unwrap(), "# mine\n");
    assert!(install(&root, &["--roll-back"]).status.success());
    assert!(current_output(&root).contains("old"));

    let run = root.join("var/lib/nims/runs/2026-01-01T00-00-00Z-lab");
    fs::create_dir_all(&run).unwrap();
    assert!(install(&root, &["--remove"]).status.success());
    assert!(run.is_dir() && boxed.is_file());
    let mut left = Vec::new();
    files_below(&root, &mut left);
    left.retain(|path| !path.starts_with(root.join("etc/nims")) && !path.starts_with(root.join("var/lib/nims")));
    assert!(left.is_empty(), "not removed: {left:?}");
}

/// Runs `nims-version` in a folder that stands for the root.
fn nims_version(root: &Path, words: &[&str]) -> Output {
    Command::new(project().join("configs/host/nims-version")).args(words).env("NIMS_ROOT", root).output().unwrap()
}

#[test]
fn a_machine_keeps_the_current_version_and_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    let bin = programs(folder.path(), "any");
    let versions = || {
        let entries = fs::read_dir(root.join("opt/nims")).unwrap().map(|entry| entry.unwrap());
        let mut names: Vec<String> = entries
            .filter(|entry| entry.file_type().unwrap().is_dir())
            .map(|entry| entry.file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    };
    for version in ["1.0.0", "1.1.0", "1.2.0"] {
        let package = folder.path().join("usr/lib/nims").join(version);
        fs::create_dir_all(package.join("bin")).unwrap();
        fs::copy(bin.join("nims"), package.join("bin/nims")).unwrap();
        fs::create_dir_all(root.join("usr/share/nims")).unwrap();
        for kind in ["systems", "robots", "missions", "sensors", "ground"] {
            let examples = root.join("usr/share/nims").join(kind);
            fs::create_dir_all(&examples).unwrap();
            fs::write(examples.join(format!("{version}.toml")), "# runs = \"../../runs\"\n").unwrap();
        }
        let output = nims_version(&root, &["add", package.to_str().unwrap()]);
        assert!(output.status.success(), "{}", printed(&output));
    }
    assert_eq!(versions(), ["1.1.0", "1.2.0"]);
    let current = || fs::read_link(root.join("opt/nims/current")).unwrap();
    assert_eq!(current(), Path::new("1.2.0"));
    // The examples are those of the first installation, and an operator may remove them for good.
    let systems: Vec<_> = fs::read_dir(root.join("etc/nims/systems")).unwrap().collect();
    assert_eq!(systems.len(), 1);

    assert!(nims_version(&root, &["roll-back"]).status.success());
    assert_eq!(current(), Path::new("1.1.0"));
    assert!(nims_version(&root, &["roll-back"]).status.success(), "and back again");
    assert_eq!((current(), versions().len()), (PathBuf::from("1.2.0"), 2));
    assert_eq!(nims_version(&root, &["armed"]).status.code(), Some(1), "no robot runs in a folder");
    let output = nims_version(&root, &["add", folder.path().to_str().unwrap()]);
    assert!(!output.status.success() && printed(&output).contains("bin/nims"), "{}", printed(&output));
}

/// The script reads `nims status --json`: its word for a robot that is not armed is that of the command.
#[test]
fn the_script_recognizes_a_robot_that_is_not_armed() {
    let word = robot_state::sentences::mode_name(messages::MotorAuthority::MODE_DISARMED);
    let script = fs::read_to_string(project().join("configs/host/nims-version")).unwrap();
    assert!(script.contains(&format!("*'\"mode\":\"{word}\"'*)")), "nims-version does not look for \"{word}\"");
}

#[test]
fn a_page_of_another_commit_is_not_installed_beside_the_gateway() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    let some = programs(folder.path(), "some");
    build_page(&some);
    for version in [Some("0.1.0+20260101000000.0123456789\n"), None] {
        let noted = some.join("nims-page.version");
        match version {
            Some(version) => fs::write(noted, version).unwrap(),
            None => fs::remove_file(noted).unwrap(),
        }
        let output = install(&root, &["--programs", some.to_str().unwrap()]);
        assert!(
            !output.status.success() && printed(&output).contains("scripts/page --release"),
            "{}",
            printed(&output)
        );
        assert!(!root.join("opt/nims").exists());
    }
}

/// What bash prints with the functions of the scripts.
fn in_bash(text: &str, words: &[&str]) -> String {
    let mut command = Command::new("bash");
    command.args(["-c", &format!("set -euo pipefail; . scripts/common.sh; {text}"), "bash"]).args(words);
    let output = command.current_dir(project()).env_remove("NIMS_COMMIT").output().unwrap();
    assert!(output.status.success(), "{}", printed(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn programs_of_another_version_become_no_package() {
    if Command::new("dpkg-deb").arg("--version").output().is_err() {
        return notes::left_out("programs of another version become no package", "there is no dpkg-deb");
    }
    let folder = tempfile::Builder::new().prefix("with spaces ").tempdir().unwrap();
    let some = programs(folder.path(), "some");
    let package = || {
        let mut command = Command::new(project().join("scripts/package"));
        command.arg("--programs").arg(&some).arg("--out").arg(folder.path().join("out"));
        printed(&command.env("SOURCE_DATE_EPOCH", "0").env_remove("NIMS_COMMIT").output().unwrap())
    };
    let state = |program: &str, version: &str| {
        fs::write(some.join(program), format!("#!/bin/sh\necho {program} {version}\n")).unwrap();
    };
    let version = in_bash("stated_version \"$(nims_version)\"", &[]);
    for program in workspace() {
        state(&program, version.trim());
    }
    // Now the man pages are next, whose program is not there.
    let said = package();
    assert!(!said.contains("version") && said.contains("nims-manual"), "{said}");
    for other in ["0.1.0 release 0123456789", "0.1.0 debug", ""] {
        state("planner", other);
        let said = package();
        assert!(said.contains("/planner") && said.contains(version.trim()), "{said}");
    }
    assert_eq!(fs::read_dir(folder.path().join("out")).unwrap().count(), 0);
}

#[test]
fn the_scripts_read_versions_and_quote_paths() {
    for (version, stated) in [
        ("0.1.0+20261126000000.0123456789", "0.1.0 release 0123456789"),
        ("0.1.0+20261126000000.0123456789.dirty", "0.1.0 release 0123456789-dirty"),
        ("0.1.0", "0.1.0 release"),
    ] {
        assert_eq!(in_bash("stated_version \"$1\"", &[version]).trim_end(), stated);
    }
    // As the crate cc splits CFLAGS.
    for word in ["-f=/plain", "-f=/with two  spaces", "-f=/it's \"$HOME\" \\x"] {
        let quoted = in_bash("shell_word \"$1\"", &[word]);
        assert_eq!(in_bash(&format!("printf '%s\\n' {quoted} {quoted}"), &[]), format!("{word}\n{word}\n"));
    }
}

#[test]
fn the_list_of_files_names_every_program_of_the_robot() {
    let list = fs::read_to_string(project().join("configs/host/files")).unwrap();
    for program in workspace() {
        assert!(list.contains(&format!("@bin@/{program} ")), "configs/host/files lacks {program}");
    }
    for (part, program) in [("viewer", "viewer"), ("page", "nims-page")] {
        let list = fs::read_to_string(project().join("configs/host").join(format!("files-{part}"))).unwrap();
        assert!(list.contains(&format!("@bin@/{program} ")), "configs/host/files-{part} lacks {program}");
    }
}

#[test]
fn missing_or_unknown_items_are_reported_and_nothing_is_installed() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    let some = programs(folder.path(), "some");
    fs::remove_file(some.join("planner")).unwrap();
    let output = install(&root, &["--programs", some.to_str().unwrap()]);
    assert!(!output.status.success() && printed(&output).contains("planner"), "{}", printed(&output));
    assert!(!root.join("opt/nims/current").exists());
    let output = install(&root, &["--everything"]);
    assert!(!output.status.success() && printed(&output).contains("--everything"), "{}", printed(&output));
}

/// Largest exposure by `systemd-analyze security`, in tenths of its scale from 0 to 10.
const MOST_EXPOSURE: u32 = 25;

fn exposure(unit: &Path) -> Output {
    let threshold = format!("--threshold={MOST_EXPOSURE}");
    let mut command = Command::new("systemd-analyze");
    command.args(["security", "--no-pager", "--offline=true", &threshold]).arg(unit).output().unwrap()
}

#[test]
fn the_service_manager_accepts_the_units() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    let some = programs(folder.path(), "some");
    build_page(&some);
    assert!(install(&root, &["--programs", some.to_str().unwrap()]).status.success());
    if Command::new("systemd-analyze").arg("--version").output().is_err() {
        return notes::left_out("the service manager accepts the units", "there is no systemd-analyze");
    }
    let version = fs::read_link(root.join("opt/nims/current")).unwrap();
    let bin = root.join("opt/nims").join(version).join("bin");
    let units = folder.path().join("units");
    fs::create_dir(&units).unwrap();
    for (unit, name) in [
        ("nims@.service", "nims@lab.service"),
        ("nims-gateway@.service", "nims-gateway@lab.service"),
        ("nims-plugin@.service", "nims-plugin@lab_soil.service"),
        ("nims-plugin-network@.service", "nims-plugin-network@lab_soil.service"),
        ("nims-page@.service", "nims-page@lab.service"),
        ("run-nims-shm.mount", "run-nims-shm.mount"),
        ("nims-runs.service", "nims-runs.service"),
        ("nims-runs.timer", "nims-runs.timer"),
    ] {
        let text = fs::read_to_string(root.join("usr/lib/systemd/system").join(unit)).unwrap();
        // The programs are below the folder, and the log's socket belongs to a running systemd.
        let text = text.replace("/opt/nims/current/bin", bin.to_str().unwrap()).replace("LogNamespace=nims\n", "");
        fs::write(units.join(name), text).unwrap();
    }
    let verify = |name: &str| {
        let mut command = Command::new("systemd-analyze");
        command
            .args(["verify", "--man=no"])
            .arg(units.join(name))
            .env("SYSTEMD_UNIT_PATH", format!("{}:", units.display()));
        printed(&command.output().unwrap())
    };
    for name in [
        "nims@lab.service",
        "nims-gateway@lab.service",
        "nims-plugin@lab_soil.service",
        "nims-plugin-network@lab_soil.service",
        "nims-page@lab.service",
        "run-nims-shm.mount",
        "nims-runs.service",
        "nims-runs.timer",
    ] {
        let complaints = verify(name);
        let ours: Vec<&str> = complaints.lines().filter(|line| line.contains("nims")).collect();
        assert!(ours.is_empty(), "{ours:?}");
    }
    for unit in
        ["nims@.service", "nims-gateway@.service", "nims-plugin@.service", "nims-page@.service", "nims-runs.service"]
    {
        let judged = exposure(&root.join("usr/lib/systemd/system").join(unit));
        assert!(judged.status.success(), "{unit}: {}", String::from_utf8_lossy(&judged.stdout));
    }
    // A unit that is not confined fails.
    fs::write(units.join("nims-open.service"), "[Service]\nExecStart=/bin/true\n").unwrap();
    assert!(!exposure(&units.join("nims-open.service")).status.success(), "systemd-analyze accepts everything");
    // It would report an error.
    fs::write(units.join("nims-wrong.service"), "[Service]\nExecStart=/nowhere/nims\nRestart=perhaps\n").unwrap();
    assert!(verify("nims-wrong.service").contains("nims-wrong"), "systemd-analyze accepts everything");
}

#[test]
fn the_oldest_finished_runs_make_room_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path();
    let make = |name: &str, file: &str| {
        fs::create_dir(runs.join(name)).unwrap();
        // a sparse file would not count
        fs::write(runs.join(name).join(file), vec![1u8; 300_000]).unwrap();
    };
    make("2026-01-01T00-00-00Z-lab", "run.mcap");
    make("2026-01-02T00-00-00Z-lab", "run.mcap.part");
    make("2026-01-03T00-00-00Z-lab", "run.mcap");
    make("2026-01-04T00-00-00Z-lab", "run.mcap");
    make("0-notes", "notes.txt");
    let script = fs::read_to_string(project().join("configs/host/nims-runs-quota")).unwrap();
    let tried = runs.join("quota");
    // Gigabytes are too large for a test, so here a unit is 100 kB.
    assert!(script.contains("most * 1000000"));
    fs::write(&tried, script.replace("most * 1000000", "most * 100")).unwrap();
    let keep = |most: &str| Command::new("sh").arg(&tried).arg(runs).arg(most).output().unwrap();
    let left = || {
        let mut left: Vec<String> =
            fs::read_dir(runs).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        left.retain(|name| name.contains('T') || name.contains("notes"));
        left.sort();
        left
    };
    assert!(keep("0").status.success());
    assert_eq!(left().len(), 5);
    // The rest of a deleted run counts for no other one, and goes.
    make(".deleted-2026-01-01T00-00-00Z-old", "run.mcap");
    // As an interrupted recovery leaves it, and as one that runs.
    let [dead, living] = [3, 4].map(|day| runs.join(format!("2026-01-0{day}T00-00-00Z-lab/run.mcap.recovering")));
    fs::write(&living, "").unwrap();
    fs::write(&dead, vec![1u8; 300_000]).unwrap();
    let hours_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(7200);
    fs::File::open(&dead).unwrap().set_modified(hours_ago).unwrap();
    let output = keep("14");
    assert!(living.exists() && !dead.exists());
    assert!(printed(&output).contains("2026-01-01"), "{}", printed(&output));
    assert_eq!(left().len(), 4);
    assert!(keep("1").status.success());
    assert_eq!(left(), ["0-notes", "2026-01-02T00-00-00Z-lab", "2026-01-04T00-00-00Z-lab"]);
    assert_eq!(keep("many").status.code(), Some(2));
}

#[test]
fn a_run_that_cannot_be_removed_keeps_no_other_one() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    for day in 1..=3 {
        let run = runs.join(format!("2026-01-0{day}T00-00-00Z-lab"));
        fs::create_dir_all(&run).unwrap();
        fs::write(run.join("run.mcap"), vec![1u8; 300_000]).unwrap();
    }
    let script = fs::read_to_string(project().join("configs/host/nims-runs-quota")).unwrap();
    fs::write(folder.path().join("quota"), script.replace("most * 1000000", "most * 100")).unwrap();
    // Files of root in a run.
    let rm = folder.path().join("rm");
    fs::write(&rm, "#!/bin/sh\ncase $* in *2026-01-01*) exit 1 ;; esac\nPATH=/usr/bin:/bin exec rm \"$@\"\n").unwrap();
    fs::set_permissions(&rm, fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap());
    let mut command = Command::new("sh");
    let output = command.arg(folder.path().join("quota")).arg(&runs).arg("1").env("PATH", path).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", printed(&output));
    let left = |day: u32| runs.join(format!("2026-01-0{day}T00-00-00Z-lab")).exists();
    assert_eq!([1, 2, 3].map(left), [true, false, true], "{}", printed(&output));
}

#[test]
fn an_update_of_a_library_restarts_no_robot() {
    let settings = project().join("configs/host/needrestart.conf");
    // As needrestart reads the file and looks up a service.
    let judge = r#"our %nrconf; do shift; die $@ if $@; my %rc = %{$nrconf{override_rc}};
        for my $unit (@ARGV) { print "$unit\n" if grep { $unit =~ /$_/ && !$rc{$_} } keys %rc }"#;
    let kept =
        ["nims@lab.service", "nims-gateway@lab.service", "nims-page@lab.service", "nims-plugin@lab_soil.service"];
    let output = Command::new("perl").args(["-e", judge]).arg(settings).args(kept).arg("ssh.service").output();
    let Ok(output) = output else {
        return notes::left_out("an update of a library restarts no robot", "there is no perl");
    };
    assert_eq!(printed(&output).lines().collect::<Vec<_>>(), kept);
}

/// No robot, whatever its name, shares a folder of systemd with another service than its own.
#[test]
fn no_robot_takes_the_folder_of_other_services() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    let some = programs(folder.path(), "some");
    build_page(&some);
    assert!(install(&root, &["--programs", some.to_str().unwrap()]).status.success());
    let units = root.join("usr/lib/systemd/system");
    let folders = |unit: &Path| -> Vec<String> {
        let text = fs::read_to_string(unit).unwrap();
        let keys = ["RuntimeDirectory=", "StateDirectory=", "CacheDirectory=", "LogsDirectory="];
        text.lines().filter(|line| keys.iter().any(|key| line.starts_with(key))).map(str::to_owned).collect()
    };
    let robot = fs::read_to_string(units.join("nims@.service")).unwrap();
    assert!(robot.contains("AssertPathExists=!/usr/lib/systemd/system/nims-%i@.service\n"));
    let own = folders(&units.join("nims@.service"));
    for entry in fs::read_dir(&units).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_file()) {
        let file = entry.file_name().unwrap().to_str().unwrap();
        for other in folders(&entry).iter().filter(|_| file != "nims@.service") {
            for pattern in &own {
                let (begin, end) = pattern.split_once("%i").unwrap_or((pattern, ""));
                let name = other.strip_prefix(begin).and_then(|rest| rest.strip_suffix(end));
                // Such a robot is refused, because the unit of that name is there.
                let refused = name.is_some_and(|name| file == format!("nims-{name}@.service"));
                let shared = match pattern.contains("%i") {
                    true => name.is_some_and(|name| !name.contains('/')),
                    false => pattern == other,
                };
                assert!(!shared || refused, "{file}: {other} and {pattern}");
            }
        }
    }
}

#[test]
fn the_user_of_the_robot_can_read_what_a_cautious_root_installs() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    let some = programs(folder.path(), "some");
    let script = format!("umask 077; exec {}/scripts/install --root \"$0\" --programs \"$1\"", project().display());
    let output = Command::new("sh").args(["-c", &script]).arg(&root).arg(&some).output().unwrap();
    assert!(output.status.success(), "{}", printed(&output));
    let mut left = vec![root.join("opt"), root.join("etc"), root.join("usr")];
    while let Some(path) = left.pop() {
        let metadata = fs::symlink_metadata(&path).unwrap();
        if metadata.is_symlink() || path.ends_with("opt/nims/.lock") {
            continue;
        }
        let wanted = if metadata.is_dir() { 0o005 } else { 0o004 };
        assert_eq!(metadata.permissions().mode() & wanted, wanted, "{}", path.display());
        if metadata.is_dir() {
            left.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        }
    }
}
