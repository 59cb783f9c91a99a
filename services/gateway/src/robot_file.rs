//! A robot file that a client hands over as text. It is checked as `nims check` does, and takes the place of the one
//! that the system file names; the one before it is kept beside it. The robot reads it at its next start.
//!
//! No name of a client becomes a path: the robot file and a calibration are named here, and a text may name no other
//! files than the present one does.

use crate::make::{aside, ended, last_line, printed};
use bus::{Bus, Domain, Participant, clock};
use client::Running;
use config::{RobotFile, SystemFile, file, toml_file};
use gateway_protocol::FindingRow;
use messages::MotorAuthority;
use robot_state::Reason;
use robot_state::answers::detail;
use site_calibration::robot_file::with_calibration;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest time for the check, which reads some files.
const LONGEST: Duration = Duration::from_secs(30);
/// Longest wait behind other work: with the check and twice the mode it ends within the minute for which a page waits.
const WAITED: Duration = Duration::from_secs(25);
/// Largest size of what the check prints, bytes.
const FINDINGS: u64 = 1 << 20;
/// Most files of one kind beside a robot file.
const NAMES: usize = 100;
/// Time in which a running robot publishes its mode, ns: more than hundred of its cycles.
const MODE_NS: u64 = 2_000_000_000;

/// What a client hands over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RobotTexts {
    /// The robot file.
    pub robot: String,
    /// A calibration from which it takes its anchors.
    pub calibration: Option<String>,
    /// SHA-256 of the robot file that they were made from, if it is known.
    pub made_from: Option<String>,
}

/// Stores the robot file of a system file; returns the answer. `domain`: that of the robot; `waited`: since the call.
pub(crate) fn store(system: &Path, domain: &str, texts: &RobotTexts, waited: Duration) -> Reason {
    let nims = std::env::current_exe().map(|path| path.with_file_name("nims"));
    let stored = nims.map_err(|error| refused(&error)).and_then(|nims| {
        // The page has told its person by then that it failed.
        if waited > WAITED {
            let why = format!("the gateway was busy with other files for {} s; try again", waited.as_secs());
            return Err(refused(&why));
        }
        let is_armed = || is_armed(domain);
        if is_armed() {
            return Err(in_use(&SystemFile::load(system).map_err(|error| refused(&error))?.robot));
        }
        store_by((&nims, system), flown(domain).as_deref(), texts, &is_armed)
    });
    stored.unwrap_or_else(|reason| *reason)
}

/// The robot file with which the robot of a domain was started, if one runs.
fn flown(domain: &str) -> Option<String> {
    let running = Running::read(&Domain::existing(domain).ok().flatten()?)?;
    file::read_text(&running.run.join("robot.toml")).ok()
}

/// Stores it with the check of this program for this system file, unless the robot `is_armed` after the check.
fn store_by(
    (nims, system): (&Path, &Path),
    flown: Option<&str>,
    texts: &RobotTexts,
    is_armed: &dyn Fn() -> bool,
) -> Result<Reason, Box<Reason>> {
    let present = SystemFile::load(system).map_err(|error| refused(&error))?.robot;
    let before = file::read_text(&present).map_err(|error| refused(&error))?;
    let (text, calibration) = match &texts.calibration {
        None => (texts.robot.clone(), None),
        Some(calibration) => {
            let path = beside(&present, "calibration", |path| same(path, calibration))?;
            (with_calibration(&texts.robot, &name_of(&path)).map_err(|why| refused(&why))?, Some((path, calibration)))
        }
    };
    names_no_other_files(&text, (&present, &before), calibration.is_some())?;
    states_nothing_in_vain(&text, (&present, &before))?;
    // What a client hands over is made from what the robot flies with.
    if text != before && flown.is_some_and(|flown| flown != before) {
        let name = name_of(&present);
        return Err(refused(&format!(
            "{name} was changed since the robot was started; start the robot again, then repeat this"
        )));
    }
    // A text that was offered before another one was stored would undo that one.
    if text != before && texts.made_from.as_ref().is_some_and(|hash| *hash != file::text_hash(&before)) {
        let name = name_of(&present);
        return Err(refused(&format!(
            "{name} is not the file from which this one was made; answer the last question again"
        )));
    }
    let made = calibration.filter(|(path, _)| !path.exists());
    if let Some((path, text)) = &made {
        create(path, text, &present)?;
    }
    let stored = checked_and_replaced((nims, system), (&present, &before), &text, is_armed);
    if let (Err(_), Some((path, _))) = (&stored, &made) {
        let _ = fs::remove_file(path);
    }
    stored
}

/// Puts a text in the place of the present robot file, if the system can be used with it.
fn checked_and_replaced(
    (nims, system): (&Path, &Path),
    (present, before): (&Path, &str),
    text: &str,
    is_armed: &dyn Fn() -> bool,
) -> Result<Reason, Box<Reason>> {
    let name = detail(name_of(present));
    if text == before {
        return Ok(Reason::RobotFileSame { file: name });
    }
    // In the folder of the robot file, because the files that it names are found from there.
    let candidate = present.with_file_name(format!(".{}.candidate.toml", stem_of(present)));
    let write = || {
        file::replace(&candidate, text)?;
        as_readable(&fs::File::open(&candidate)?, present)
    };
    let written = write().map_err(|error| cannot(present, &error));
    let replaced = written.and_then(|()| check(nims, system, &candidate, present)).and_then(|()| {
        // The check takes long enough to arm the robot.
        if is_armed() {
            return Err(in_use(present));
        }
        let kept = beside(present, "before", |_| false)?;
        create(&kept, before, present)?;
        fs::rename(&candidate, present).map_err(|error| cannot(present, &error))?;
        Ok(Reason::RobotFileStored { file: name, kept: detail(name_of(&kept)) })
    });
    let _ = fs::remove_file(&candidate);
    replaced
}

/// Runs `nims check` for the system with this robot file; its first error is the reason.
fn check(nims: &Path, system: &Path, candidate: &Path, present: &Path) -> Result<(), Box<Reason>> {
    let mut found = command::temporary_file().map_err(|error| refused(&error))?;
    let mut command = aside(nims);
    command.arg("check").arg(system).arg("--robot").arg(candidate);
    command.stdout(found.try_clone().map_err(|error| refused(&error))?);
    let Some((status, sentence)) = ended(&mut command, LONGEST)? else {
        return Err(refused(&format!("nims check takes more than {} s; try again", LONGEST.as_secs())));
    };
    if status.success() {
        return Ok(());
    }
    let checked = serde_json::from_slice::<Checked>(&printed(&mut found, FINDINGS)).unwrap_or_default();
    let error = checked.findings.into_iter().find(|one| one.level == "error");
    let why = error.map_or_else(
        || last_line(&sentence, "nims check does not accept it"),
        |one| format!("{}; {}", one.finding, one.cure),
    );
    // The person knows the file by its own name.
    let why = why.replace(&candidate.display().to_string(), &name_of(present));
    Err(refused(&why.strip_prefix("nims: ").unwrap_or(&why)))
}

/// What `nims check` prints.
#[derive(Default, serde::Deserialize)]
struct Checked {
    findings: Vec<FindingRow>,
}

/// Refuses a text that names other files than the present one; a calibration that came with it is named here.
fn names_no_other_files(
    text: &str,
    (present, before): (&Path, &str),
    with_calibration: bool,
) -> Result<(), Box<Reason>> {
    let name = PathBuf::from(name_of(present));
    let parsed = |text: &str| toml_file::parse::<RobotFile>(text, &name).map_err(|error| refused(&error));
    let (new, old) = (parsed(text)?, parsed(before)?);
    for ((key, new), (_, old)) in new.names_of_files().into_iter().zip(old.names_of_files()) {
        let is_own = with_calibration && key == "robot.calibration";
        if !new.is_empty() && new != old && !is_own {
            return Err(refused(&format!("{key} names a file; a robot file from here names those of the present one")));
        }
    }
    Ok(())
}

/// Refuses a text that changes a value which the identified file of the present robot file replaces: what was measured
/// now would have no effect.
fn states_nothing_in_vain(text: &str, (present, before): (&Path, &str)) -> Result<(), Box<Reason>> {
    // Without a present file that loads, the check of the text says what is wrong.
    let Ok(file) = RobotFile::load(present) else { return Ok(()) };
    let Some(identified) = &file.robot.identified else { return Ok(()) };
    let table = |text: &str| text.parse::<toml::Table>().map_err(|error| refused(&error.message()));
    let (new, old) = (table(text)?, table(before)?);
    let of = |table: &toml::Table, dotted: &str| {
        let (section, key) = dotted.split_once('.')?;
        table.get(section)?.get(key).cloned()
    };
    // A text that no longer names the identified file states its own values.
    if of(&new, "robot.identified").is_none() {
        return Ok(());
    }
    let vain: Vec<&str> =
        file.replaced.iter().map(|one| one.key).filter(|key| of(&new, key) != of(&old, key)).collect();
    if vain.is_empty() {
        return Ok(());
    }
    let (keys, name) = (vain.join(" and "), name_of(identified));
    Err(refused(&format!("{name} takes the place of {keys}; delete that from {name}, then repeat this")))
}

/// Whether a robot runs here that is not disarmed, or does not say so.
fn is_armed(domain: &str) -> bool {
    let Ok(Some(domain)) = Domain::existing(domain) else { return false };
    if !bus::estop::is_heard(&domain) {
        return false;
    }
    let Ok(guests) = Bus::join_as(&domain, "gateway", Participant::Guest) else { return true };
    let Ok(mut modes) = guests.subscriber::<MotorAuthority>("motor/authority") else { return true };
    let give_up = clock::now_ns() + MODE_NS;
    while clock::now_ns() < give_up {
        if let Ok(Some(seen)) = modes.receive() {
            return seen.mode != MotorAuthority::MODE_DISARMED;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

/// A free name beside the robot file, or that of a file that `fits`.
fn beside(present: &Path, what: &str, fits: impl Fn(&Path) -> bool) -> Result<PathBuf, Box<Reason>> {
    let stem = stem_of(present);
    let path = |number: usize| match number {
        1 => present.with_file_name(format!("{stem}-{what}.toml")),
        number => present.with_file_name(format!("{stem}-{what}-{number}.toml")),
    };
    let full = || refused(&format!("there are {NAMES} files {stem}-{what} already; remove some"));
    (1..=NAMES).map(path).find(|path| !path.exists() || fits(path)).ok_or_else(full)
}

fn same(path: &Path, text: &str) -> bool {
    file::read_text(path).is_ok_and(|found| found == text)
}

/// Gives a file the permissions of the present robot file: the service creates files for its own user alone.
fn as_readable(file: &fs::File, present: &Path) -> std::io::Result<()> {
    let mode = fs::metadata(present)?.permissions().mode() & 0o777;
    file.set_permissions(fs::Permissions::from_mode(mode))?;
    file.sync_all()
}

/// Creates a file beside the present robot file, which is on the disk afterwards.
fn create(path: &Path, text: &str, present: &Path) -> Result<(), Box<Reason>> {
    let write = || {
        let mut new = OpenOptions::new().write(true).create_new(true).open(path)?;
        new.write_all(text.as_bytes())?;
        as_readable(&new, present)?;
        fs::File::open(file::folder_of(path))?.sync_all()
    };
    write().map_err(|error| cannot(path, &error))
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn stem_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn in_use(present: &Path) -> Box<Reason> {
    Box::new(Reason::RobotFileInUse { file: detail(name_of(present)) })
}

fn cannot(path: &Path, error: &std::io::Error) -> Box<Reason> {
    refused(&format!("{} cannot be written: {error}", path.display()))
}

fn refused(why: &dyn std::fmt::Display) -> Box<Reason> {
    Box::new(Reason::RobotFileRefused { why: detail(why) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A system with its robot file, and a program in place of `nims`.
    struct Site {
        folder: tempfile::TempDir,
        nims: PathBuf,
        system: PathBuf,
        robot: PathBuf,
    }

    fn site(script: &str) -> Site {
        let folder = tempfile::tempdir().unwrap();
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let (system, robot) = (folder.path().join("systems/demo3.toml"), folder.path().join("robots/lab3.toml"));
        for (from, to) in [("systems/demo3.toml", &system), ("robots/lab3.toml", &robot)] {
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            fs::copy(configs.join(from), to).unwrap();
        }
        let nims = folder.path().join("nims");
        fs::write(&nims, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&nims, fs::Permissions::from_mode(0o700)).unwrap();
        Site { folder, nims, system, robot }
    }

    /// A calibration of that date, with standard deviations of 1 cm.
    fn calibration(date: &str) -> String {
        let row = |i: usize| format!("{:?}", (0..9).map(|j| if i == j { 1e-4 } else { 0.0 }).collect::<Vec<f64>>());
        let rows: Vec<_> = (0..9).map(row).collect();
        format!(
            "method = \"survey\"\ndate = \"{date}\"\nverdict = \"good\"\nanchors_m = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.1], \
             [4.7, 8.6, 2.98]]\ncovariance_m2 = [{}]\n",
            rows.join(", ")
        )
    }

    impl Site {
        fn store(&self, robot: &str, calibration: Option<&str>) -> Result<Reason, Box<Reason>> {
            let texts =
                RobotTexts { robot: robot.to_owned(), calibration: calibration.map(str::to_owned), made_from: None };
            store_by((&self.nims, &self.system), None, &texts, &|| false)
        }

        fn text(&self) -> String {
            fs::read_to_string(&self.robot).unwrap()
        }

        fn files(&self) -> Vec<String> {
            let entries = fs::read_dir(self.robot.parent().unwrap()).unwrap();
            let mut names: Vec<_> =
                entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
            names.sort();
            names
        }
    }

    #[test]
    fn what_the_check_accepts_takes_the_place_and_the_one_before_is_kept() {
        let site = site("test \"$2 $4\" = 'check --robot' && grep -q heavier \"$5\"");
        let before = site.text();
        let heavier = format!("{before}# heavier\n");
        let stored = site.store(&heavier, None).unwrap();
        assert!(format!("{stored:?}").contains("lab3-before.toml"), "{stored:?}");
        assert_eq!((site.text(), site.files()), (heavier.clone(), vec!["lab3-before.toml".into(), "lab3.toml".into()]));
        assert_eq!(fs::read_to_string(site.robot.with_file_name("lab3-before.toml")).unwrap(), before);
        assert_eq!(site.store(&heavier, None).unwrap().code(), 484);
        // The next ones get names of their own, and an equal calibration is not stored twice.
        let (first, second) = (calibration("2026-01-01"), calibration("2026-01-02"));
        site.store(&heavier, Some(&first)).unwrap();
        assert!(
            site.text().contains("calibration = \"lab3-calibration.toml\"") && !site.text().contains("anchors_m = [")
        );
        assert_eq!(site.store(&heavier, Some(&first)).unwrap().code(), 484);
        site.store(&heavier, Some(&second)).unwrap();
        assert!(site.text().contains("calibration = \"lab3-calibration-2.toml\""));
        assert_eq!(site.files().len(), 6, "{:?}", site.files());
        assert!(site.folder.path().join("systems").read_dir().unwrap().count() == 1);
    }

    #[test]
    fn new_files_are_readable_as_the_robot_file_was() {
        let site = site("exit 0");
        // One that no usual mask of a process gives.
        fs::set_permissions(&site.robot, fs::Permissions::from_mode(0o646)).unwrap();
        site.store(&site.text(), Some(&calibration("2026-01-01"))).unwrap();
        assert_eq!(site.files(), ["lab3-before.toml", "lab3-calibration.toml", "lab3.toml"]);
        for name in site.files() {
            let mode = fs::metadata(site.robot.with_file_name(&name)).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o646, "{name}");
        }
    }

    #[test]
    fn what_the_check_refuses_changes_nothing() {
        let finding = r#"{"findings":[{"level":"note","finding":"a","cure":""},{"level":"error","finding":"too heavy","cure":"take less"}]}"#;
        for (script, words) in [
            (format!("echo '{finding}'; exit 2"), "too heavy; take less"),
            ("echo \"nims: $5: [robot] is missing\" >&2; exit 2".to_owned(), "lab3.toml: [robot] is missing"),
        ] {
            let site = site(&script);
            let before = site.text();
            for calibration in [None, Some("method = 1\n")] {
                let reason = site.store(&format!("{before}# more\n"), calibration).unwrap_err();
                assert!(format!("{reason:?}").contains(words), "{reason:?}");
                assert_eq!((site.text(), site.files()), (before.clone(), vec!["lab3.toml".to_owned()]));
            }
        }
    }

    #[test]
    fn a_store_that_comes_late_or_while_the_robot_is_armed_changes_nothing() {
        let site = site("touch \"${0%nims}checked\"");
        let before = site.text();
        let texts = RobotTexts {
            robot: format!("{before}# more\n"),
            calibration: Some("method = 1\n".to_owned()),
            made_from: None,
        };
        // It is armed during the check.
        let is_armed = || site.folder.path().join("checked").exists();
        assert!(!is_armed());
        let reason = store_by((&site.nims, &site.system), None, &texts, &is_armed).unwrap_err();
        assert_eq!(reason.code(), 485);
        let late = store(&site.system, "no-robot-of-this-name", &texts, WAITED + Duration::from_secs(1));
        assert!(late.code() == 486 && format!("{late:?}").contains("busy with other files for 26 s"), "{late:?}");
        assert_eq!((site.text(), site.files()), (before, vec!["lab3.toml".to_owned()]));
    }

    #[test]
    fn a_change_since_the_start_of_the_robot_is_not_overwritten() {
        let site = site("exit 0");
        let before = site.text();
        let store = |flown: &str, text: &str| {
            let texts = RobotTexts { robot: text.to_owned(), calibration: None, made_from: None };
            store_by((&site.nims, &site.system), Some(flown), &texts, &|| false)
        };
        assert_eq!(store("older", &format!("{before}# more\n")).unwrap_err().code(), 486);
        assert_eq!(store("older", &before).unwrap().code(), 484);
        assert_eq!(store(&before, &format!("{before}# more\n")).unwrap().code(), 483);
    }

    #[test]
    fn a_text_that_was_made_from_another_robot_file_does_not_replace_this_one() {
        let site = site("exit 0");
        let before = site.text();
        let made_from = Some(file::text_hash(&before));
        let store = |more: &str, calibration: Option<&str>| {
            let (robot, calibration) = (format!("{before}{more}"), calibration.map(str::to_owned));
            let texts = RobotTexts { robot, calibration, made_from: made_from.clone() };
            store_by((&site.nims, &site.system), None, &texts, &|| false)
        };
        assert_eq!(store("# weighed\n", None).unwrap().code(), 483);
        // The same once more changes nothing, and what was made from the file of before is refused.
        assert_eq!(store("# weighed\n", None).unwrap().code(), 484);
        let kept = (site.text(), site.files());
        for calibration in [None, Some("method = 1\n")] {
            let reason = store("# calibrated\n", calibration).unwrap_err();
            assert!(reason.code() == 486 && format!("{reason:?}").contains("was made"), "{reason:?}");
        }
        assert_eq!((site.text(), site.files()), kept);
    }

    #[test]
    fn a_text_names_no_file_of_its_own() {
        let site = site("exit 0");
        let before = site.text();
        let named = before.replacen("[robot]\n", "[robot]\ncalibration = \"../../etc/passwd\"\n", 1);
        assert_ne!(named, before);
        let table = before.replacen("[motor] ", "[motor]\ntable = \"/etc/passwd\" # ", 1);
        assert_ne!(table, before);
        let identified = before.replacen("[robot]\n", "[robot]\nidentified = \"/etc/passwd\"\n", 1);
        assert_ne!(identified, before);
        for (text, calibration) in [
            (&named, None),
            (&table, None),
            (&table, Some("method = 1\n")),
            (&identified, None),
            (&identified, Some("method = 1\n")),
            (&"x".to_owned(), None),
        ] {
            assert_eq!(site.store(text, calibration).unwrap_err().code(), 486, "{text}");
            assert_eq!(site.files(), ["lab3.toml"]);
        }
        // A calibration that came with it replaces the name.
        site.store(&named, Some("method = 1\n")).unwrap();
        assert!(!site.text().contains("passwd"));
    }

    #[test]
    fn what_the_identified_file_replaces_is_not_stored_in_vain() {
        let site = site("exit 0");
        let found = site.robot.with_file_name("found.toml");
        fs::write(&found, "node_mass_kg = 1.25\n").unwrap();
        let named = site.text().replacen("[robot]\n", "[robot]\nidentified = \"found.toml\"\n", 1);
        fs::write(&site.robot, &named).unwrap();
        let weighed = named.replacen("node_mass_kg = 1.2 ", "node_mass_kg = 1.3 ", 1);
        assert_ne!(weighed, named);
        let reason = site.store(&weighed, None).unwrap_err();
        let words = format!("{reason:?}");
        assert!(
            reason.code() == 486 && words.contains("robot.node_mass_kg") && words.contains("found.toml"),
            "{words}"
        );
        assert_eq!((site.text(), site.files()), (named.clone(), vec!["found.toml".to_owned(), "lab3.toml".to_owned()]));
        // Other keys are stored, and this one once the identified file lacks it.
        let stiff = named.replacen("stiffness_n = 6000", "stiffness_n = 6500", 1);
        assert_ne!(stiff, named);
        assert_eq!(site.store(&stiff, None).unwrap().code(), 483);
        fs::write(&found, "delay_s = 0.03\nlag_s = 0.04\n").unwrap();
        assert_eq!(site.store(&weighed, None).unwrap().code(), 483);
    }
}
