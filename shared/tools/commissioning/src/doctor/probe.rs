//! Collects the facts about this machine without changing anything.

use super::kernel;
use super::machine::{DomainFacts, Limits, Machine, Memory, PortFacts, Runs};
use super::realtime::Wanted;
use bus::{Domain, clock};
use client::Running;
use config::{RealtimeSection, Role, SystemFile};
use evidence::busy::SystemLoad;
use rustix::fs::{Access, access, major, minor, statfs, statvfs};
use rustix::process::{Pid, Resource, geteuid, getrlimit, test_kill_process};
use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

const SHARED_MEMORY: &str = "/dev/shm";
/// `f_type` of tmpfs, statfs(2).
pub const TMPFS_MAGIC: u32 = 0x0102_1994;

/// Collects what a system needs from this machine; without a system file, what every system needs. `limits_of`: a
/// process of the robot whose limits count, or 0 if none do; without it those of this process.
pub fn probe(file: Option<&SystemFile>, limits_of: Option<u32>) -> Machine {
    let user = geteuid().as_raw();
    let limits = limits_of.map_or_else(own_limits, limits_of_process);
    let domains: Vec<Domain> = Domain::all();
    Machine {
        user,
        memory: memory(),
        ownerless: ownerless(&domains, user),
        domains: domains.iter().map(domain_facts).collect(),
        limits,
        places: file.map_or(messages::PROCESSES, |file| file.bus.processes),
        realtime_refused: file.and_then(|file| match limits_of {
            None => realtime_refused(file),
            Some(_) => realtime_not_permitted(file, &limits),
        }),
        ports: file.map(ports).unwrap_or_default(),
        clock_source: device_setting("clocksource/clocksource0/current_clocksource"),
        clock_sources: device_setting("clocksource/clocksource0/available_clocksource"),
        unix_s: clock::unix_ns() / 1_000_000_000,
        processors: std::thread::available_parallelism().map_or(1, usize::from),
        busy: Some(SystemLoad::read()),
        open_folders: Domain::open_folders(),
        runs: file.map(runs),
        programs_missing: programs_missing(file),
    }
}

fn device_setting(file: &str) -> String {
    fs::read_to_string(Path::new("/sys/devices/system").join(file)).unwrap_or_default().trim().to_owned()
}

fn memory() -> Memory {
    let room = statvfs(SHARED_MEMORY).ok();
    Memory {
        is_tmpfs: statfs(SHARED_MEMORY).is_ok_and(|found| found.f_type as u32 == TMPFS_MAGIC),
        is_writable: access(SHARED_MEMORY, Access::READ_OK | Access::WRITE_OK | Access::EXEC_OK).is_ok(),
        size_bytes: room.as_ref().map_or(0, |room| room.f_blocks.saturating_mul(room.f_frsize)),
        free_bytes: room.as_ref().map_or(0, |room| room.f_bavail.saturating_mul(room.f_frsize)),
    }
}

/// Returns size in bytes and number of this user's files whose names have the form of a domain's but match no existing
/// domain.
fn ownerless(domains: &[Domain], user: u32) -> (u64, usize) {
    let ours = |name: &str| {
        name.strip_prefix("nims")
            .and_then(|rest| rest.split_once('_'))
            .is_some_and(|(hash, _)| hash.len() == 8 && hash.bytes().all(|byte| byte.is_ascii_hexdigit()))
            && !domains.iter().any(|domain| name.starts_with(domain.prefix()))
    };
    let mut found = (0, 0);
    for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
        let Ok(data) = entry.metadata() else { continue };
        if data.is_file() && data.uid() == user && entry.file_name().to_str().is_some_and(ours) {
            found = (found.0 + data.blocks() * 512, found.1 + 1);
        }
    }
    found
}

fn domain_facts(domain: &Domain) -> DomainFacts {
    let runs =
        |running: Running| Pid::from_raw(running.pid.cast_signed()).is_some_and(|pid| test_kill_process(pid).is_ok());
    DomainFacts {
        name: domain.name().to_owned(),
        folder: domain.root().to_owned(),
        open: domain.open_to_others(),
        alive: domain.alive().into_iter().map(|node| node.name).collect(),
        dead: domain.dead(),
        is_run: Running::read(domain).is_some_and(runs),
    }
}

fn own_limits() -> Limits {
    let most = |resource| getrlimit(resource).maximum;
    Limits {
        // Every process raises its own soft limit up to the hard limit.
        open_files: most(Resource::Nofile),
        realtime_priority: most(Resource::Rtprio),
        processes: most(Resource::Nproc),
    }
}

/// The limits of another process; none where they cannot be read.
fn limits_of_process(pid: u32) -> Limits {
    limits_in(&fs::read_to_string(format!("/proc/{pid}/limits")).unwrap_or_default())
}

/// Of /proc/PID/limits, proc(5): name, soft limit, hard limit, unit.
fn limits_in(text: &str) -> Limits {
    let most = |name| text.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().nth(1)?.parse().ok());
    Limits {
        open_files: most("Max open files"),
        realtime_priority: most("Max realtime priority"),
        processes: most("Max processes"),
    }
}

/// Returns what `[realtime]` asks beyond the limits of the robot's processes.
fn realtime_not_permitted(file: &SystemFile, limits: &Limits) -> Option<String> {
    // The controller has the highest one, two above that of motor-io.
    let asked = Some(file.realtime.priority).filter(|priority| *priority > 0)? + 2;
    let most = limits.realtime_priority?;
    let refused = || format!("SCHED_FIFO priority {asked}, and the robot's processes may have {most}");
    (u64::from(asked) > most).then(refused)
}

/// Applies the settings of `[realtime]` in a temporary thread and returns the error, if any.
fn realtime_refused(file: &SystemFile) -> Option<String> {
    let section = file.realtime.clone();
    let awake = section.idle_latency_us.and_then(|latency_us| runtime::realtime::stay_awake(latency_us).err());
    let tried = std::thread::spawn(move || runtime::realtime::apply(&section, Role::MotorIo.name()).1).join();
    tried.ok().flatten().or(awake)
}

fn ports(file: &SystemFile) -> Vec<PortFacts> {
    let ports = file.motor_io.ports.iter().enumerate();
    ports
        .filter(|(_, port)| !port.path.contains("{domain}"))
        .map(|(index, port)| serial_port(index + 1, &port.path))
        .collect()
}

fn serial_port(number: usize, path: &str) -> PortFacts {
    let found = fs::metadata(path).ok();
    PortFacts {
        number,
        path: path.to_owned(),
        exists: found.is_some(),
        is_device: found.as_ref().is_some_and(|found| found.file_type().is_char_device()),
        is_usable: access(path, Access::READ_OK | Access::WRITE_OK).is_ok(),
        group: found.as_ref().map_or(0, MetadataExt::gid),
    }
}

/// Returns the runs folder or, if it does not exist yet, the nearest existing parent.
pub fn nearest_existing(runs: &Path) -> PathBuf {
    std::path::absolute(runs)
        .unwrap_or_else(|_| runs.to_owned())
        .ancestors()
        .find(|folder| folder.exists())
        .unwrap_or(Path::new("/"))
        .to_path_buf()
}

/// What the system file asks of the kernel; without one, what every system asks.
pub fn wanted(root: &Path, file: Option<&SystemFile>) -> Wanted {
    let user = geteuid().as_raw();
    let is_on_card = |file: &&SystemFile| {
        let device = fs::metadata(nearest_existing(&file.runs)).map(|found| found.dev());
        device.is_ok_and(|device| kernel::is_on_sd_card(root, (major(device), minor(device))))
    };
    let name = std::env::var("USER").unwrap_or_default();
    Wanted {
        rate_hz: file.map_or(0.0, |file| file.rate_hz),
        left_out: file.map(|file| left_out(&file.realtime)).unwrap_or_default(),
        cpu: file.and_then(|file| file.realtime.cpu),
        keeps_awake: file.is_some_and(|file| file.realtime.idle_latency_us.is_some()),
        runs_on_sd_card: file.filter(is_on_card).map(|file| file.runs.clone()),
        user,
        lingers: !name.is_empty() && root.join("var/lib/systemd/linger").join(name).exists(),
    }
}

/// Keys that give the control chain precedence and are not set.
fn left_out(section: &RealtimeSection) -> Vec<&'static str> {
    let keys =
        [("priority", section.priority > 0), ("lock_memory", section.lock_memory), ("cpu", section.cpu.is_some())];
    keys.iter().filter(|(_, is_set)| !is_set).map(|(key, _)| *key).collect()
}

fn runs(file: &SystemFile) -> Runs {
    let there = nearest_existing(&file.runs);
    let owner = fs::metadata(&there).map(|found| found.uid()).ok();
    Runs {
        folder: file.runs.clone(),
        is_writable: there.is_dir() && access(&there, Access::WRITE_OK | Access::EXEC_OK).is_ok(),
        owner: owner.filter(|owner| ![0, geteuid().as_raw()].contains(owner)).map(user_name),
        free_bytes: statvfs(&there).map_or(0, |room| room.f_bavail.saturating_mul(room.f_frsize)),
        least_bytes: file.recorder.min_free_bytes,
        open: [file.runs.clone(), file.state_folder()].iter().flat_map(|folder| open_in(folder)).collect(),
    }
}

/// The name of a user, or `#` and the number, which `sudo -u` takes too.
fn user_name(user: u32) -> String {
    let users = fs::read_to_string("/etc/passwd").unwrap_or_default();
    named(&users, user).map_or_else(|| format!("'#{user}'"), str::to_owned)
}

/// The name of a user in the text of /etc/passwd, passwd(5): `name:password:UID:..`.
fn named(users: &str, user: u32) -> Option<&str> {
    let mut lines = users.lines().map(|line| line.split(':'));
    lines.find_map(|mut fields| {
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(user)).then_some(name)
    })
}

/// Returns the entries of a folder that other users may access; empty if they may not enter the folder itself.
fn open_in(folder: &Path) -> Vec<PathBuf> {
    if !fs::metadata(folder).is_ok_and(|found| found.mode() & 0o011 != 0) {
        return Vec::new();
    }
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let open = entries.filter(|entry| entry.metadata().is_ok_and(|found| found.mode() & 0o077 != 0));
    open.map(|entry| entry.path()).collect()
}

fn programs_missing(file: Option<&SystemFile>) -> Vec<String> {
    let Ok(own) = std::env::current_exe() else { return Vec::new() };
    let wanted = Role::STANDARD.iter().filter(|(_, role)| match (role, file) {
        (Role::MotorBox, Some(file)) => file.motor_box.is_some(),
        _ => true,
    });
    wanted.filter(|(name, _)| !own.with_file_name(name).is_file()).map(|(name, _)| (*name).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn this_machine_can_be_probed() {
        let machine = probe(None, None);
        assert!(machine.memory.is_tmpfs && machine.memory.size_bytes >= machine.memory.free_bytes);
        assert!(machine.processors >= 1 && machine.unix_s > 1_700_000_000);
    }

    #[test]
    fn the_limits_of_another_process_are_those_of_the_kernel() {
        let (read, asked) = (limits_of_process(std::process::id()), own_limits());
        assert_eq!((read.open_files, read.processes), (asked.open_files, asked.processes));
        assert_eq!(read.realtime_priority, asked.realtime_priority);
        let none = limits_of_process(0);
        assert!(none.open_files.is_none() && none.realtime_priority.is_none() && none.processes.is_none());
        let read = limits_in(
            "Max open files            1024                 16384                files     \n\
             Max realtime priority     0                    90                             \n\
             Max processes             unlimited            unlimited            processes \n",
        );
        assert_eq!((read.open_files, read.realtime_priority, read.processes), (Some(16384), Some(90), None));
    }

    #[test]
    fn the_real_time_priority_is_judged_by_the_limit_of_the_robot() {
        let file = SystemFile::load(Path::new("../../../configs/systems/demo3.toml")).unwrap();
        let most = |priority| Limits { realtime_priority: priority, ..Limits::default() };
        let asked = u64::from(file.realtime.priority) + 2;
        assert!(asked > 2 && realtime_not_permitted(&file, &most(Some(asked - 1))).is_some());
        for enough in [Some(asked), None] {
            assert!(realtime_not_permitted(&file, &most(enough)).is_none());
        }
    }

    #[test]
    fn running_and_dead_processes_are_distinguished() {
        let domain = Domain::for_test();
        let bus = bus::Bus::join(&domain, "process").unwrap();
        let found = domain_facts(&domain);
        assert_eq!(found.alive, ["process"]);
        assert!(found.open.is_empty() && !found.is_run, "{found:?}");
        drop(bus);
        assert!(domain_facts(&domain).alive.is_empty());
    }

    #[test]
    fn entries_open_to_others_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("runs");
        fs::create_dir(&runs).unwrap();
        for (name, mode) in [("open", 0o750), ("private", 0o700)] {
            fs::create_dir(runs.join(name)).unwrap();
            fs::set_permissions(runs.join(name), fs::Permissions::from_mode(mode)).unwrap();
        }
        fs::set_permissions(&runs, fs::Permissions::from_mode(0o755)).unwrap();
        assert_eq!(open_in(&runs), [runs.join("open")]);
        fs::set_permissions(&runs, fs::Permissions::from_mode(0o700)).unwrap();
        assert!(open_in(&runs).is_empty(), "other users cannot enter the folder");
        assert!(open_in(&runs.join("absent")).is_empty());
    }

    #[test]
    fn the_owner_of_the_runs_is_named() {
        let users = "root:x:0:0:root:/root:/bin/bash\nbad\nnims:x:998:998::/var/lib/nims:/usr/sbin/nologin\n";
        assert_eq!((named(users, 998), named(users, 0), named(users, 5)), (Some("nims"), Some("root"), None));
    }

    #[test]
    fn ports_are_checked_for_existence_and_type() {
        let absent = serial_port(1, "/dev/there-is-none");
        assert!(!absent.exists && !absent.is_usable);
        let file = tempfile::NamedTempFile::new().unwrap();
        let file = serial_port(2, file.path().to_str().unwrap());
        assert!(file.exists && !file.is_device && file.is_usable);
        let device = serial_port(3, "/dev/null");
        assert!(device.exists && device.is_device && device.is_usable);
    }
}
