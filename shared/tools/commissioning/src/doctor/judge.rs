//! Pure evaluation of the facts: findings with their remedies.

use super::machine::{DomainFacts, Machine, PortFacts, Runs};
use crate::finding::{Finding, error, note, warning};
use std::path::PathBuf;

/// Shared memory that a robot needs at most, bytes: the files of a robot with four cables and `nims top` add up to 63
/// MB.
const MEMORY_BYTES: u64 = 128_000_000;
/// Number of open files below which no robot runs: each channel that a process uses takes about five descriptors, and
/// the recorder uses all of them.
const OPEN_FILES: u64 = 1024;
/// Minimum number of processes and threads: a system has a dozen processes with a few threads each.
const PROCESSES: u64 = 100;
/// Size of two hours of recording at about 1 MB/s, bytes.
const TWO_HOURS_BYTES: u64 = 7_200_000_000;
/// 2026-01-01, s since 1970; no version of this program is older, so an earlier clock is wrong.
const NO_EARLIER_S: u64 = 1_767_225_600;

/// Returns all findings, the most severe first.
pub fn judge(machine: &Machine) -> Vec<Finding> {
    let mut findings = Vec::new();
    memory(machine, &mut findings);
    for folder in &machine.open_folders {
        findings.push(error(
            format!("other users may enter {}, the folder of a domain, so nims does not use it", folder.display()),
            &format!("make it private: `chmod 700 {}`", folder.display()),
        ));
    }
    for domain in &machine.domains {
        findings.extend(domain_finding(domain));
    }
    limits(machine, &mut findings);
    for port in &machine.ports {
        findings.push(port_finding(port, as_owner(machine)));
    }
    clocks(machine, &mut findings);
    if let Some(busy) = machine.busy {
        findings.push(match (busy.clause(), busy.load) {
            (Some(words), _) => warning(words, evidence::busy::CURE),
            (None, Some(load)) => note(format!(
                "processors: {}, and {} threads are runnable ({:.1} on average over the last minute)",
                load.processors, load.now, load.minute
            )),
            (None, None) => note(format!("processors: {}", machine.processors)),
        });
    }
    if let Some(runs) = &machine.runs {
        findings.push(disk_finding(runs, as_owner(machine)));
        if !runs.open.is_empty() {
            let number = runs.open.len();
            findings.push(warning(
                format!("other users may read {number} runs or files of the saved position"),
                &format!("to prevent it: `chmod -R go= {}`", paths(&runs.open)),
            ));
        }
    }
    if !machine.programs_missing.is_empty() {
        findings.push(error(
            format!("missing in the folder of nims: {}", machine.programs_missing.join(", ")),
            "build all programs with `cargo build --workspace --bins`, or install them into one folder",
        ));
    }
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.level as u8));
    findings
}

/// How to examine the machine as the user whose robot it is, where this is another one.
fn as_owner(machine: &Machine) -> Option<String> {
    let owner = machine.runs.as_ref()?.owner.as_ref()?;
    Some(format!(
        "the runs belong to the user {owner}, who runs the robot; examine it as this user: `sudo -u {owner} nims doctor SYSTEM`"
    ))
}

/// Formats paths as arguments of a command; shortens a long list.
fn paths(list: &[PathBuf]) -> String {
    const MOST: usize = 4;
    let named: Vec<String> = list.iter().take(MOST).map(|path| path.display().to_string()).collect();
    named.join(" ") + if list.len() > MOST { " .." } else { "" }
}

fn megabytes(bytes: u64) -> String {
    format!("{:.0} MB", bytes as f64 * 1e-6)
}

fn memory(machine: &Machine, findings: &mut Vec<Finding>) {
    let memory = &machine.memory;
    if !memory.is_tmpfs {
        findings.push(error(
            "/dev/shm does not exist or is not a tmpfs".to_owned(),
            "mount it: `mount -t tmpfs -o mode=1777 tmpfs /dev/shm`",
        ));
    } else if !memory.is_writable {
        findings.push(error("this user may not write to /dev/shm".to_owned(), "set its mode: `chmod 1777 /dev/shm`"));
    } else if memory.free_bytes < MEMORY_BYTES {
        findings.push(error(
            format!(
                "/dev/shm has {} left of {}, but a robot needs up to {}",
                megabytes(memory.free_bytes),
                megabytes(memory.size_bytes),
                megabytes(MEMORY_BYTES)
            ),
            "remove unneeded files from it, or enlarge it: `mount -o remount,size=512M /dev/shm` (in a container: --shm-size=512m)",
        ));
    } else {
        findings.push(note(format!(
            "shared memory: {} left of {}",
            megabytes(memory.free_bytes),
            megabytes(memory.size_bytes)
        )));
    }
    if machine.user == 0 {
        findings.push(warning(
            "this user is root; other users can neither use nor remove what root leaves in shared memory".to_owned(),
            "run all programs of a robot as one ordinary user",
        ));
    }
    let (bytes, files) = machine.ownerless;
    if files > 0 {
        findings.push(warning(
            format!("{files} files ({}) in /dev/shm belong to robots that no longer exist", megabytes(bytes)),
            "while no robot runs: `find /dev/shm -maxdepth 1 -user $(id -u) -name 'nims????????_*' -delete`",
        ));
    }
}

fn domain_finding(domain: &DomainFacts) -> Option<Finding> {
    let DomainFacts { name, folder, open, alive, dead, is_run } = domain;
    let folder = folder.display();
    if let Some(first) = open.first() {
        let more = if open.len() > 1 { format!(" and {} more", open.len() - 1) } else { String::new() };
        return Some(error(
            format!(
                "other users may read or write {}{more} of the domain `{name}` and thus control the robot",
                first.display()
            ),
            &format!("remove their access: `chmod go= {}`", paths(open)),
        ));
    }
    Some(match (*is_run, alive.is_empty(), *dead) {
        (true, _, 0) => note(format!("a robot runs in the domain `{name}`: {}", alive.join(", "))),
        (true, _, dead) => warning(
            format!("in the running domain `{name}`, resources of {dead} dead processes are left"),
            "the supervisor removes them within seconds; if this persists, restart `nims up`",
        ),
        (false, false, _) => warning(
            format!("in the domain `{name}`, processes run without a supervisor: {}", alive.join(", ")),
            "`nims up` with the same system ends them and cleans up; end those that you started by hand yourself",
        ),
        (false, true, 0) => note(format!("the folder {folder} of the domain `{name}` is a harmless leftover")),
        (false, true, dead) => warning(
            format!("the domain `{name}` holds resources of {dead} killed processes"),
            "`nims up` with the same system cleans up",
        ),
    })
}

fn limits(machine: &Machine, findings: &mut Vec<Finding>) {
    let limits = &machine.limits;
    let needed = bus::recorder_files(machine.places);
    if let Some(files) = limits.open_files.filter(|files| *files < needed) {
        let level = if files < OPEN_FILES { error } else { warning };
        findings.push(level(
            format!("a process may open {files} files, but the recorder of {} processes needs {needed}", machine.places),
            &format!(
                "set `LimitNOFILE={needed}` in the service unit, or `- nofile {needed}` in /etc/security/limits.d; or lower `processes` of [bus] in the system file"
            ),
        ));
    }
    if let Some(processes) = limits.processes.filter(|processes| *processes < PROCESSES) {
        findings.push(error(
            format!("this user may have {processes} processes and threads, but a robot needs about {PROCESSES}"),
            "set `LimitNPROC=1000` in the service unit, or `- nproc 1000` in /etc/security/limits.d",
        ));
    }
    match &machine.realtime_refused {
        Some(refused) => findings.push(warning(
            format!("the system refuses a setting of [realtime], so the control chain runs without it: {refused}"),
            &as_owner(machine).unwrap_or_else(|| {
                "permit it as described, or remove it from [realtime]; without it, other programs can delay cycles"
                    .to_owned()
            }),
        )),
        None if limits.realtime_priority == Some(0) && machine.user != 0 => {
            let asked = if machine.runs.is_some() { ", and the system does not request it" } else { "" };
            findings.push(note(format!("real-time priority is not permitted to this user{asked}")));
        }
        None => {}
    }
}

fn port_finding(port: &PortFacts, as_owner: Option<String>) -> Finding {
    let PortFacts { number, path, group, .. } = port;
    if !port.exists {
        return error(
            format!("port {number}: {path} does not exist"),
            "plug the drives in; stable names are in /dev/serial/by-id",
        );
    }
    if !port.is_device {
        return error(format!("port {number}: {path} is not a serial device"), "correct `path` in the system file");
    }
    if !port.is_usable {
        return error(
            format!("port {number}: this user may not read and write {path}, which belongs to group {group}"),
            &as_owner.unwrap_or_else(|| {
                format!("`sudo usermod -aG $(getent group {group} | cut -d: -f1) $USER`, then log in again")
            }),
        );
    }
    note(format!("port {number}: {path} can be used"))
}

fn clocks(machine: &Machine, findings: &mut Vec<Finding>) {
    if machine.unix_s < NO_EARLIER_S {
        findings.push(warning(
            "the calendar clock is not set, so run folders and files get a wrong date".to_owned(),
            "set it with `timedatectl set-time`, or connect a network or a clock module",
        ));
    }
    // The clock is read at every stamp. These two sources take microseconds per read and share one register among all
    // processors.
    if ["hpet", "acpi_pm"].contains(&machine.clock_source.as_str()) {
        let better = machine
            .clock_sources
            .split_whitespace()
            .find(|source| ["tsc", "arch_sys_counter", "kvm-clock"].contains(source));
        findings.push(warning(
            format!("the kernel's clock source is {}, which is slow to read", machine.clock_source),
            &match better {
                Some(better) => {
                    format!("`echo {better} > /sys/devices/system/clocksource/clocksource0/current_clocksource`")
                }
                None => "a newer kernel or firmware may offer tsc; see the late cycles in `nims status`".to_owned(),
            },
        ));
    }
    if machine.processors == 1 {
        findings.push(warning(
            "the machine has one processor, which the control chain shares with everything else".to_owned(),
            "give the control chain a priority in [realtime], or use a machine with two processors",
        ));
    }
}

fn disk_finding(runs: &Runs, as_owner: Option<String>) -> Finding {
    let Runs { folder, is_writable, free_bytes, least_bytes, .. } = runs;
    let folder = folder.display();
    if !is_writable {
        return error(
            format!("runs cannot be written to {folder}"),
            as_owner
                .as_deref()
                .unwrap_or("correct `runs` in the system file, or make this user the owner of the folder"),
        );
    }
    if free_bytes < least_bytes {
        return error(
            format!(
                "{folder} has {} left; below {} nothing is recorded",
                megabytes(*free_bytes),
                megabytes(*least_bytes)
            ),
            "move old runs away, or set `runs` in the system file to a larger disk",
        );
    }
    let room = free_bytes - least_bytes;
    if room < TWO_HOURS_BYTES {
        return warning(
            format!(
                "{folder} has room for about {:.0} minutes of recording",
                room as f64 / TWO_HOURS_BYTES as f64 * 120.0
            ),
            "move old runs away before a long mission",
        );
    }
    note(format!("{folder} has {:.0} GB left for runs", *free_bytes as f64 * 1e-9))
}

#[cfg(test)]
mod tests {
    use super::super::machine::{Limits, Memory};
    use super::*;
    use crate::finding::Level;
    use crate::finding::usable;
    use evidence::busy::SystemLoad;
    use std::path::Path;

    fn sound() -> Machine {
        Machine {
            user: 1000,
            memory: Memory { is_tmpfs: true, is_writable: true, size_bytes: 1 << 30, free_bytes: 1 << 30 },
            limits: Limits { open_files: Some(4096), realtime_priority: Some(95), processes: None },
            places: 200,
            ports: vec![PortFacts {
                number: 1,
                path: "/dev/ttyUSB0".to_owned(),
                exists: true,
                is_device: true,
                is_usable: true,
                group: 20,
            }],
            clock_source: "tsc".to_owned(),
            clock_sources: "tsc hpet acpi_pm".to_owned(),
            unix_s: NO_EARLIER_S + 1,
            processors: 4,
            runs: Some(Runs {
                folder: "/var/lib/nims".into(),
                is_writable: true,
                owner: None,
                free_bytes: 50_000_000_000,
                least_bytes: 500_000_000,
                open: Vec::new(),
            }),
            ..Machine::default()
        }
    }

    #[test]
    fn a_sound_machine_has_only_notes() {
        let findings = judge(&sound());
        assert!(findings.iter().all(|finding| finding.level == Level::Note), "{findings:?}");
        assert!(findings.len() >= 3, "{findings:?}");
    }

    /// Expects that one change to a sound machine gives exactly one finding above a note, with this level, these words
    /// and a remedy.
    fn found(level: Level, words: &[&str], change: impl Fn(&mut Machine)) -> (String, String) {
        let mut machine = sound();
        change(&mut machine);
        let findings = judge(&machine);
        let bad: Vec<&Finding> = findings.iter().filter(|finding| finding.level != Level::Note).collect();
        let [only] = bad.as_slice() else { panic!("{words:?}: {bad:?}") };
        assert_eq!(only.level, level, "{only:?}");
        assert_eq!(usable(&findings), level != Level::Error);
        assert!(!only.cure.is_empty(), "{only:?}");
        for word in words {
            assert!(format!("{} {}", only.finding, only.cure).contains(word), "no {word:?} in {only:?}");
        }
        assert_eq!(findings[0], **only, "the most severe comes first");
        (format!("{level:?}"), format!("{} | {}", only.finding, only.cure))
    }

    #[test]
    fn the_sentences_are_those_of_the_file() {
        let mut given = Vec::new();
        each_defect_has_one_finding_with_a_remedy(&mut given);
        domains_are_classified(&mut given);
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/doctor.txt");
        sentences::compare_with(&file, given);
    }

    fn each_defect_has_one_finding_with_a_remedy(given: &mut Vec<(String, String)>) {
        given.push(found(Level::Error, &["/dev/shm", "mount -t tmpfs"], |machine| machine.memory.is_tmpfs = false));
        given.push(found(Level::Error, &["/dev/shm", "chmod 1777"], |machine| machine.memory.is_writable = false));
        given.push(found(Level::Error, &["64 MB", "--shm-size"], |machine| {
            (machine.memory.size_bytes, machine.memory.free_bytes) = (64_000_000, 64_000_000);
        }));
        given.push(found(Level::Warning, &["root"], |machine| machine.user = 0));
        given.push(found(Level::Warning, &["busy", "93 %", "[realtime]"], |machine| {
            machine.busy = Some(SystemLoad { pressure: Some(0.93), load: None });
        }));
        given.push(found(Level::Warning, &["20 MB", "find /dev/shm"], |machine| machine.ownerless = (20_000_000, 3)));
        given.push(found(Level::Error, &["256", "LimitNOFILE"], |machine| machine.limits.open_files = Some(256)));
        // 15 for each process, and 1024.
        given.push(found(Level::Warning, &["4096", "300", "LimitNOFILE=5524"], |machine| machine.places = 300));
        given.push(found(Level::Error, &["50", "LimitNPROC"], |machine| machine.limits.processes = Some(50)));
        given.push(found(Level::Warning, &["80", "[realtime]"], |machine| {
            machine.realtime_refused = Some("SCHED_FIFO priority 80".to_owned());
        }));
        given
            .push(found(Level::Error, &["port 1", "/dev/ttyUSB0", "by-id"], |machine| machine.ports[0].exists = false));
        given.push(found(Level::Error, &["/dev/ttyUSB0"], |machine| machine.ports[0].is_device = false));
        given.push(found(Level::Error, &["20", "usermod"], |machine| machine.ports[0].is_usable = false));
        given.push(found(Level::Warning, &[], |machine| machine.unix_s = 12));
        given.push(found(Level::Warning, &["hpet", "echo tsc"], |machine| machine.clock_source = "hpet".to_owned()));
        given.push(found(Level::Warning, &[], |machine| machine.processors = 1));
        let disk_finding = |machine: &mut Machine, free: u64| {
            if let Some(runs) = &mut machine.runs {
                runs.free_bytes = free;
            }
        };
        given.push(found(Level::Error, &["499 MB"], |machine| disk_finding(machine, 499_000_000)));
        given.push(found(Level::Warning, &["60"], |machine| disk_finding(machine, 500_000_000 + 3_600_000_000)));
        given.push(found(Level::Error, &[], |machine| {
            if let Some(runs) = &mut machine.runs {
                runs.is_writable = false;
            }
        }));
        // The robot of another user: no cure may take its folder, or open its ports to this user.
        let of_nims = |machine: &mut Machine| {
            if let Some(runs) = &mut machine.runs {
                runs.owner = Some("nims".to_owned());
            }
        };
        given.push(found(Level::Error, &["/var/lib/nims", "sudo -u nims nims doctor"], |machine| {
            of_nims(machine);
            machine.runs.as_mut().unwrap().is_writable = false;
        }));
        given.push(found(Level::Error, &["/dev/ttyUSB0", "sudo -u nims nims doctor"], |machine| {
            of_nims(machine);
            machine.ports[0].is_usable = false;
        }));
        given.push(found(Level::Warning, &["80", "sudo -u nims nims doctor"], |machine| {
            of_nims(machine);
            machine.realtime_refused = Some("SCHED_FIFO priority 80".to_owned());
        }));
        given.push(found(Level::Error, &["planner", "recorder", "cargo build"], |machine| {
            machine.programs_missing = vec!["planner".to_owned(), "recorder".to_owned()];
        }));
    }

    fn domains_are_classified(given: &mut Vec<(String, String)>) {
        let domain = || DomainFacts {
            name: "demo3".to_owned(),
            folder: "/dev/shm/nims-1000-demo3".into(),
            ..Default::default()
        };
        let alive = || vec!["motor-io".to_owned()];
        for quiet in [DomainFacts { is_run: true, alive: alive(), ..domain() }, domain()] {
            let finding = domain_finding(&quiet).unwrap();
            assert_eq!(finding.level, Level::Note, "{finding:?}");
        }
        given.push(found(Level::Warning, &["motor-io", "nims up"], |machine| {
            machine.domains.push(DomainFacts { alive: alive(), ..domain() });
        }));
        given.push(found(Level::Warning, &["2 ", "nims up"], |machine| {
            machine.domains.push(DomainFacts { dead: 2, ..domain() });
        }));
        given.push(found(Level::Warning, &["1 "], |machine| {
            machine.domains.push(DomainFacts { dead: 1, alive: alive(), is_run: true, ..domain() });
        }));
        given.push(found(Level::Error, &["1 ", "`demo3`", "chmod go= /dev/shm/a /dev/pts/3"], |machine| {
            machine.domains.push(DomainFacts { open: vec!["/dev/shm/a".into(), "/dev/pts/3".into()], ..domain() });
        }));
        given.push(found(Level::Error, &["chmod 700 /dev/shm/nims-1000-demo3"], |machine| {
            machine.open_folders.push("/dev/shm/nims-1000-demo3".into());
        }));
        given.push(found(Level::Warning, &["5 ", "chmod -R go= /r/0 /r/1 /r/2 /r/3 .."], |machine| {
            let open = (0..5).map(|run| format!("/r/{run}").into()).collect();
            machine.runs = machine.runs.take().map(|runs| Runs { open, ..runs });
        }));
    }
}
