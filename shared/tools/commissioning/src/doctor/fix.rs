//! Applies what findings propose to write, after a question for each.

use super::realtime::{Examined, Write};
use command::{Answer, Failure};
use std::fs;
use std::io::{BufRead, IsTerminal, Write as _};
use std::path::Path;

/// Settings that systemd-tmpfiles(8) writes again at each start of the machine.
const KEPT: &str = "etc/tmpfiles.d/nims-realtime.conf";

/// A text that was written, or why it could not be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// File, absolute.
    pub file: String,
    /// Its text before.
    pub before: String,
    /// Its text now.
    pub now: String,
    /// Why it could not be written; empty if it was.
    pub failed: String,
}

impl Change {
    /// One line about it.
    pub fn line(&self) -> String {
        let Self { file, before, now, failed } = self;
        if failed.is_empty() {
            return format!("changed    {file}: {before} -> {now}");
        }
        format!("unchanged  {file}: {failed}")
    }
}

fn apply(root: &Path, write: &Write) -> Change {
    let path = root.join(&write.file);
    let read = || fs::read_to_string(&path).unwrap_or_default().trim().to_owned();
    let before = read();
    // Not created: a file of the kernel exists, or the setting does not.
    let written = fs::OpenOptions::new().write(true).truncate(true).open(&path);
    let failed = match written.and_then(|mut file| file.write_all(write.text.as_bytes())) {
        Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => {
            "only root may: sudo nims doctor --fix".into()
        }
        Err(error) => error.to_string(),
        Ok(()) if read() == write.text => String::new(),
        // The kernel may accept a text and keep its own.
        Ok(()) => format!("the kernel keeps {}", read()),
    };
    Change { file: format!("/{}", write.file), before, now: read(), failed }
}

/// Writes what the findings propose, below a root folder, where `asks` returns true; then, where it returns true again,
/// makes it last over restarts of the machine.
pub fn fix(root: &Path, found: &[Examined], asks: &mut dyn FnMut(&str) -> Answer<bool>) -> Answer<Vec<Change>> {
    let (mut changes, mut stable) = (Vec::new(), Vec::new());
    for examined in found.iter().filter(|examined| !examined.writes.is_empty()) {
        let first = examined.writes.first().map(|write| format!("write {} to /{}", write.text, write.file));
        let more = match examined.writes.len() {
            1 => String::new(),
            number => format!(" and {} more", number - 1),
        };
        if !asks(&format!("{}: {}{more}", examined.finding.finding, first.unwrap_or_default()))? {
            continue;
        }
        for write in &examined.writes {
            let change = apply(root, write);
            if change.failed.is_empty() && write.is_stable {
                stable.push(format!("w /{} - - - - {}\n", write.file, write.text));
            }
            changes.push(change);
        }
    }
    if !stable.is_empty() && asks(&format!("also after a restart of this machine: write them to /{KEPT}"))? {
        changes.push(keep(root, &stable));
    }
    Ok(changes)
}

/// Adds the lines that are not there yet.
fn keep(root: &Path, lines: &[String]) -> Change {
    let path = root.join(KEPT);
    let before = fs::read_to_string(&path).unwrap_or_default();
    let new: String = lines.iter().filter(|line| !before.contains(line.as_str())).cloned().collect();
    let written =
        path.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(&path, before.clone() + &new));
    let count = |text: &str| format!("{} lines", text.lines().count());
    let now = count(&fs::read_to_string(&path).unwrap_or_default());
    let failed = written.err().map(|error| error.to_string()).unwrap_or_default();
    Change { file: format!("/{KEPT}"), before: count(&before), now, failed }
}

/// Asks on the terminal; `--yes` needs none.
pub fn question(yes: bool, sentence: &str) -> Answer<bool> {
    if yes {
        return Ok(true);
    }
    if !std::io::stdin().is_terminal() {
        return Err(Failure::BadInput(
            "--fix asks before each change, and standard input is no terminal: --yes agrees to all".to_owned(),
        ));
    }
    eprint!("{sentence}? [y/N] ");
    let mut answer = String::new();
    std::io::stdin().lock().read_line(&mut answer).map_err(Failure::not_now)?;
    Ok(["y", "yes"].contains(&answer.trim().to_lowercase().as_str()))
}

#[cfg(test)]
mod tests {
    use super::super::kernel;
    use super::super::realtime::{Wanted, examine};
    use super::*;

    fn tree() -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (file, content) in [
            ("sys/devices/system/cpu/online", "0-1"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_available_governors", "performance powersave\n"),
            ("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave\n"),
            ("sys/devices/system/cpu/cpu1/cpufreq/scaling_available_governors", "performance powersave\n"),
            ("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n"),
            ("proc/irq/7/smp_affinity_list", "0-1\n"),
        ] {
            fs::create_dir_all(root.path().join(file).parent().unwrap()).unwrap();
            fs::write(root.path().join(file), content).unwrap();
        }
        root
    }

    fn examined(root: &Path) -> Vec<Examined> {
        examine(&kernel::read(root), &Wanted { cpu: Some(1), ..Wanted::default() })
    }

    #[test]
    fn only_what_was_agreed_to_is_changed() {
        let root = tree();
        let read = |file: &str| fs::read_to_string(root.path().join(file)).unwrap();
        let found = examined(root.path());
        let mut asked = Vec::new();
        let refuses = &mut |sentence: &str| {
            asked.push(sentence.to_owned());
            Ok(false)
        };
        assert_eq!(fix(root.path(), &found, refuses).unwrap(), []);
        assert_eq!(asked.len(), 3, "{asked:?}");
        assert!(asked[0].contains("write performance to /sys/devices/system/cpu/cpu0") && asked[0].ends_with("1 more"));
        assert_eq!(read("proc/irq/7/smp_affinity_list"), "0-1\n");
        assert!(!root.path().join("etc").exists());

        let mut agrees = |sentence: &str| Ok(sentence.contains("frequency"));
        assert_eq!(fix(root.path(), &found, &mut agrees).unwrap().len(), 2);
        assert_eq!(read("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor"), "performance");
        assert_eq!(read("sys/bus/usb-serial/devices/ttyUSB0/latency_timer"), "16\n");
    }

    #[test]
    fn a_fixed_machine_has_the_finding_no_more() {
        let root = tree();
        let found = examined(root.path());
        let changes = fix(root.path(), &found, &mut |_| Ok(true)).unwrap();
        assert!(changes.iter().all(|change| change.failed.is_empty()), "{changes:?}");
        assert_eq!(
            changes[0].line(),
            "changed    /sys/devices/system/cpu/cpu0/cpufreq/scaling_governor: powersave -> performance"
        );
        let after = examined(root.path());
        assert!(after.iter().all(|examined| examined.writes.is_empty()), "{after:?}");
        // Only what means the same after a restart is kept, once.
        let kept = fs::read_to_string(root.path().join(KEPT)).unwrap();
        assert_eq!(kept.lines().count(), 2, "{kept}");
        assert!(kept.starts_with("w /sys/devices/system/cpu/cpu0/cpufreq/scaling_governor - - - - performance\n"));
        fix(root.path(), &found, &mut |_| Ok(true)).unwrap();
        assert_eq!(fs::read_to_string(root.path().join(KEPT)).unwrap(), kept);
    }

    #[test]
    fn a_setting_that_is_gone_is_reported() {
        let root = tree();
        let found = examined(root.path());
        fs::remove_file(root.path().join("sys/bus/usb-serial/devices/ttyUSB0/latency_timer")).unwrap();
        let changes = fix(root.path(), &found, &mut |_| Ok(true)).unwrap();
        let failed: Vec<_> = changes.iter().filter(|change| !change.failed.is_empty()).collect();
        assert!(failed.len() == 1 && failed[0].line().starts_with("unchanged  /sys/bus/usb-serial"), "{failed:?}");
    }
}
