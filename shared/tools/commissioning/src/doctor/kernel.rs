//! Facts about the kernel and its settings that decide how late a thread wakes up, read below a root folder, so that
//! tests read a folder of their own.

use std::fs;
use std::path::{Path, PathBuf};

/// File below /sys with the processors of the kernel's workers that belong to none.
pub const WORKERS_MASK: &str = "devices/virtual/workqueue/cpumask";

/// How the kernel lets a thread interrupt it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Preemption {
    /// PREEMPT_RT: nearly everywhere.
    RealTime,
    /// PREEMPT, or PREEMPT_DYNAMIC in mode `full`: outside of locked sections.
    Full,
    /// At given places, or on the way back to a program.
    Voluntary,
    /// The kernel does not tell.
    #[default]
    Unknown,
}

/// Frequency governor of a processor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Governor {
    /// Processor.
    pub cpu: usize,
    /// Its governor.
    pub now: String,
    /// Whether the governor `performance` is offered.
    pub offers_performance: bool,
}

/// A serial adapter that collects received bytes before it hands them over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adapter {
    /// Its name below /dev.
    pub name: String,
    /// Longest time for which it collects, ms.
    pub latency_ms: u32,
    /// Whether this user may change it.
    pub is_writable: bool,
}

/// An interrupt, and the processors that may handle it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Interrupt {
    /// Number.
    pub number: u32,
    /// Processors.
    pub cpus: Vec<usize>,
}

/// Facts about the kernel.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Kernel {
    /// Name of the machine; empty if unknown.
    pub model: String,
    /// Release, as `uname -r` prints it.
    pub release: String,
    /// Preemption.
    pub preemption: Preemption,
    /// Command line.
    pub command_line: String,
    /// Processors that the kernel gives to no program by itself.
    pub isolated: Vec<usize>,
    /// Processors without a periodic tick.
    pub without_tick: Vec<usize>,
    /// Processors that are on.
    pub online: Vec<usize>,
    /// Governors; empty if the frequency is fixed.
    pub governors: Vec<Governor>,
    /// Longest wake-up time of an idle state that is enabled, µs; `None` if the machine has none.
    pub deepest_idle_us: Option<u32>,
    /// Interrupts.
    pub interrupts: Vec<Interrupt>,
    /// Serial adapters with a latency timer.
    pub adapters: Vec<Adapter>,
    /// Mask of the processors of the kernel's own unbound workers, as its file has it; empty if the kernel does not
    /// tell.
    pub workers_mask: String,
    /// Whether systemd runs, and removes the shared memory of ordinary users who log out.
    pub removes_ipc: bool,
}

fn text(path: &Path) -> String {
    // Names of boards end with a zero byte.
    fs::read_to_string(path)
        .unwrap_or_default()
        .trim_matches(|letter: char| letter.is_whitespace() || letter == '\0')
        .to_owned()
}

/// Reads a list of processors, as in `0-2,5`.
pub fn parse_cpus(list: &str) -> Vec<usize> {
    let range = |part: &str| match part.trim().split_once('-') {
        Some((low, high)) => Some(low.parse().ok()?..=high.parse().ok()?),
        None => part.trim().parse().ok().map(|cpu| cpu..=cpu),
    };
    list.split(',').filter_map(range).flatten().collect()
}

/// Formats a list of processors.
pub fn format_cpus(cpus: &[usize]) -> String {
    cpus.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

/// A mask of one processor with the digits and commas of another mask of the same machine; `None` if that has no digit
/// for this processor.
pub fn mask_of(cpu: usize, like: &str) -> Option<String> {
    let digits = like.chars().filter(char::is_ascii_hexdigit).count();
    let mut left = digits.checked_sub(cpu / 4 + 1)?;
    let digit = |place: char| {
        if place == ',' {
            return Some(place);
        }
        let is_its = left == 0;
        left = left.wrapping_sub(1);
        char::from_digit(if is_its { 1 << (cpu % 4) } else { 0 }, 16)
    };
    like.chars().map(digit).collect()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    found.sort();
    found
}

/// The number at the end of a name, as in `cpu12`.
fn number_after(prefix: &str, path: &Path) -> Option<usize> {
    path.file_name()?.to_str()?.strip_prefix(prefix)?.parse().ok()
}

fn preemption(root: &Path) -> Preemption {
    let version = text(&root.join("proc/version"));
    if text(&root.join("sys/kernel/realtime")) == "1" || version.contains("PREEMPT_RT") {
        return Preemption::RealTime;
    }
    // Root alone may read it; its present mode is in parentheses.
    let modes = text(&root.join("sys/kernel/debug/sched/preempt"));
    match (modes.contains("(full)") || modes.contains("(lazy)"), modes.is_empty()) {
        (true, _) => Preemption::Full,
        (false, false) => Preemption::Voluntary,
        (false, true) if version.contains("PREEMPT_DYNAMIC") => Preemption::Unknown,
        (false, true) if version.contains("PREEMPT") => Preemption::Full,
        (false, true) if version.is_empty() => Preemption::Unknown,
        (false, true) => Preemption::Voluntary,
    }
}

fn model(root: &Path) -> String {
    let cpu = text(&root.join("proc/cpuinfo"));
    let processor = cpu.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split_once(':'));
    let names = [
        text(&root.join("proc/device-tree/model")),
        text(&root.join("sys/class/dmi/id/product_name")),
        processor.map(|(_, name)| name.trim().to_owned()).unwrap_or_default(),
    ];
    let mut names: Vec<String> = names.into_iter().filter(|name| !name.is_empty()).collect();
    names.dedup();
    names.join(", ")
}

fn governors(root: &Path) -> Vec<Governor> {
    let mut found: Vec<Governor> = entries(&root.join("sys/devices/system/cpu"))
        .iter()
        .filter_map(|folder| {
            let now = text(&folder.join("cpufreq/scaling_governor"));
            let offered = text(&folder.join("cpufreq/scaling_available_governors"));
            let offers_performance = offered.split_whitespace().any(|name| name == "performance");
            let cpu = number_after("cpu", folder)?;
            (!now.is_empty()).then_some(Governor { cpu, now, offers_performance })
        })
        .collect();
    found.sort_by_key(|governor| governor.cpu);
    found
}

fn deepest_idle_us(root: &Path) -> Option<u32> {
    let states = entries(&root.join("sys/devices/system/cpu/cpu0/cpuidle"));
    let enabled = states.iter().filter(|state| text(&state.join("disable")) != "1");
    enabled.filter_map(|state| text(&state.join("latency")).parse().ok()).max()
}

fn interrupts(root: &Path) -> Vec<Interrupt> {
    let folders = entries(&root.join("proc/irq"));
    let mut found: Vec<Interrupt> = folders
        .iter()
        .filter_map(|folder| {
            let cpus = parse_cpus(&text(&folder.join("smp_affinity_list")));
            Some(Interrupt { number: folder.file_name()?.to_str()?.parse().ok()?, cpus })
        })
        .collect();
    found.sort_by_key(|interrupt| interrupt.number);
    found
}

fn adapters(root: &Path) -> Vec<Adapter> {
    let devices = entries(&root.join("sys/bus/usb-serial/devices"));
    let found = devices.iter().filter_map(|device| {
        let timer = device.join("latency_timer");
        let is_writable = rustix::fs::access(&timer, rustix::fs::Access::WRITE_OK).is_ok();
        Some(Adapter {
            name: device.file_name()?.to_str()?.to_owned(),
            latency_ms: text(&timer).parse().ok()?,
            is_writable,
        })
    });
    found.collect()
}

/// The last value of `RemoveIPC` in the files of logind.conf(5), in the order in which systemd reads them. Its default
/// is yes.
fn removes_ipc(root: &Path) -> bool {
    let main = ["usr/lib/systemd/logind.conf", "etc/systemd/logind.conf"].map(|file| root.join(file));
    let folders = ["usr/lib/systemd/logind.conf.d", "run/systemd/logind.conf.d", "etc/systemd/logind.conf.d"];
    let mut more: Vec<PathBuf> = folders.iter().flat_map(|folder| entries(&root.join(folder))).collect();
    more.retain(|file| file.extension().is_some_and(|ending| ending == "conf"));
    // by name, whatever the folder
    more.sort_by(|a, b| a.file_name().cmp(&b.file_name()));
    let lines: Vec<String> =
        main.iter().chain(&more).flat_map(|file| text(file).lines().map(str::to_owned).collect::<Vec<_>>()).collect();
    let mut values = lines.iter().filter_map(|line| line.trim().strip_prefix("RemoveIPC")?.trim().strip_prefix('='));
    let off = values.next_back().is_some_and(|value| ["no", "false", "off", "0"].contains(&value.trim()));
    root.join("run/systemd/system").is_dir() && !off
}

/// Reads the facts below a root folder.
#[must_use]
pub fn read(root: &Path) -> Kernel {
    let cpu = |file: &str| parse_cpus(&text(&root.join("sys/devices/system/cpu").join(file)));
    Kernel {
        model: model(root),
        release: text(&root.join("proc/sys/kernel/osrelease")),
        preemption: preemption(root),
        command_line: text(&root.join("proc/cmdline")),
        isolated: cpu("isolated"),
        without_tick: cpu("nohz_full"),
        online: cpu("online"),
        governors: governors(root),
        deepest_idle_us: deepest_idle_us(root),
        interrupts: interrupts(root),
        adapters: adapters(root),
        workers_mask: text(&root.join("sys").join(WORKERS_MASK)),
        removes_ipc: removes_ipc(root),
    }
}

/// Whether a folder is on an SD card, which stops for hundreds of milliseconds while it erases. `device` is the number
/// of the folder's device, as `stat` gives it: major and minor.
#[must_use]
pub fn is_on_sd_card(root: &Path, (major, minor): (u32, u32)) -> bool {
    // Of a partition, the card is the folder above.
    let device = fs::canonicalize(root.join(format!("sys/dev/block/{major}:{minor}"))).unwrap_or_default();
    device.ancestors().take(2).any(|folder| text(&folder.join("device/type")) == "SD")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root folder with these files.
    pub fn tree(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (name, content) in files {
            let path = root.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }
        root
    }

    const PI: [(&str, &str); 17] = [
        ("proc/version", "Linux version 6.12.25-v8-rt (build) #1 SMP PREEMPT_RT Debian\n"),
        ("proc/sys/kernel/osrelease", "6.12.25-v8-rt\n"),
        ("proc/cmdline", "console=tty1 isolcpus=3 nohz_full=3\n"),
        ("proc/device-tree/model", "Raspberry Pi 5 Model B Rev 1.0\0"),
        ("sys/devices/system/cpu/online", "0-3\n"),
        ("sys/devices/system/cpu/isolated", "3\n"),
        ("sys/devices/system/cpu/nohz_full", "3\n"),
        ("sys/devices/system/cpu/cpu10/cpufreq/scaling_governor", "performance\n"),
        ("sys/devices/system/cpu/cpu2/cpufreq/scaling_governor", "ondemand\n"),
        ("sys/devices/system/cpu/cpu2/cpufreq/scaling_available_governors", "ondemand performance \n"),
        ("sys/devices/system/cpu/cpu0/cpuidle/state0/latency", "1\n"),
        ("sys/devices/system/cpu/cpu0/cpuidle/state1/latency", "180\n"),
        ("sys/devices/system/cpu/cpu0/cpuidle/state2/latency", "900\n"),
        ("sys/devices/system/cpu/cpu0/cpuidle/state2/disable", "1\n"),
        ("proc/irq/106/smp_affinity_list", "0-1,3\n"),
        ("proc/irq/default_smp_affinity", "f\n"),
        ("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n"),
    ];

    #[test]
    fn the_facts_of_a_board_are_read() {
        let root = tree(&PI);
        let kernel = read(root.path());
        assert_eq!(kernel.preemption, Preemption::RealTime);
        assert_eq!((&*kernel.model, &*kernel.release), ("Raspberry Pi 5 Model B Rev 1.0", "6.12.25-v8-rt"));
        assert_eq!((kernel.online, kernel.isolated, kernel.without_tick), (vec![0, 1, 2, 3], vec![3], vec![3]));
        let governor = |cpu, now: &str, offers_performance| Governor { cpu, now: now.to_owned(), offers_performance };
        assert_eq!(kernel.governors, [governor(2, "ondemand", true), governor(10, "performance", false)]);
        assert_eq!(kernel.deepest_idle_us, Some(180), "a disabled state does not count");
        assert_eq!(kernel.interrupts, [Interrupt { number: 106, cpus: vec![0, 1, 3] }]);
        assert_eq!(kernel.adapters[0].latency_ms, 16);
    }

    #[test]
    fn preemption_is_told_apart() {
        let of = |version: &str, modes: Option<&str>| {
            let mut files = vec![("proc/version", version)];
            files.extend(modes.map(|modes| ("sys/kernel/debug/sched/preempt", modes)));
            read(tree(&files).path()).preemption
        };
        assert_eq!(of("#1 SMP PREEMPT_RT", None), Preemption::RealTime);
        assert_eq!(of("#1 SMP PREEMPT 2024", None), Preemption::Full);
        assert_eq!(of("#1 SMP PREEMPT_DYNAMIC", None), Preemption::Unknown);
        assert_eq!(of("#1 SMP PREEMPT_DYNAMIC", Some("none voluntary (full)")), Preemption::Full);
        assert_eq!(of("#1 SMP PREEMPT_DYNAMIC", Some("none (voluntary) full")), Preemption::Voluntary);
        assert_eq!(of("#1 SMP", None), Preemption::Voluntary);
        assert_eq!(of("", None), Preemption::Unknown);
        assert_eq!(read(tree(&[("sys/kernel/realtime", "1\n")]).path()).preemption, Preemption::RealTime);
    }

    #[test]
    fn the_last_word_about_ipc_counts() {
        let of = |files: &[(&str, &str)]| {
            let root = tree(files);
            fs::create_dir_all(root.path().join("run/systemd/system")).unwrap();
            read(root.path()).removes_ipc
        };
        assert!(of(&[]) && of(&[("etc/systemd/logind.conf", "[Login]\n#RemoveIPC=no\n")]));
        assert!(!of(&[("etc/systemd/logind.conf", "[Login]\nRemoveIPC=no\n")]));
        assert!(!of(&[
            ("etc/systemd/logind.conf", "RemoveIPC=yes"),
            ("etc/systemd/logind.conf.d/10-nims.conf", "RemoveIPC = no"),
            ("usr/lib/systemd/logind.conf.d/05-vendor.conf", "RemoveIPC=yes"),
        ]));
        assert!(of(&[
            ("etc/systemd/logind.conf.d/10-nims.conf", "RemoveIPC=no"),
            ("usr/lib/systemd/logind.conf.d/20-vendor.conf", "RemoveIPC=yes"),
        ]));
        assert!(!read(tree(&[]).path()).removes_ipc, "without systemd nothing is removed");
    }

    #[test]
    fn an_sd_card_is_found_from_its_partition() {
        let root = tree(&[("sys/devices/mmc0/block/mmcblk0/device/type", "SD\n")]);
        let block = root.path().join("sys/devices/mmc0/block/mmcblk0");
        fs::create_dir_all(block.join("mmcblk0p2")).unwrap();
        fs::create_dir_all(root.path().join("sys/dev/block")).unwrap();
        for (device, folder) in [("179:0", block.clone()), ("179:2", block.join("mmcblk0p2"))] {
            std::os::unix::fs::symlink(folder, root.path().join("sys/dev/block").join(device)).unwrap();
        }
        assert!(is_on_sd_card(root.path(), (179, 0)) && is_on_sd_card(root.path(), (179, 2)));
        assert!(!is_on_sd_card(root.path(), (8, 1)));
        // Memory that is soldered in is no card.
        fs::write(block.join("device/type"), "MMC\n").unwrap();
        assert!(!is_on_sd_card(root.path(), (179, 2)));
    }

    #[test]
    fn lists_of_processors_are_read() {
        assert_eq!(parse_cpus("0-2,5"), [0, 1, 2, 5]);
        assert_eq!(parse_cpus("(null)"), Vec::<usize>::new());
        assert_eq!((parse_cpus(""), parse_cpus("7")), (vec![], vec![7]));
        assert_eq!(format_cpus(&[0, 2, 3]), "0,2,3");
    }

    #[test]
    fn the_mask_of_a_processor_has_the_form_of_another() {
        assert_eq!(mask_of(0, "3").as_deref(), Some("1"));
        assert_eq!(mask_of(3, "f").as_deref(), Some("8"));
        assert_eq!(mask_of(6, "ff").as_deref(), Some("40"));
        assert_eq!(mask_of(33, "ff,ffffffff").as_deref(), Some("02,00000000"));
        assert_eq!(mask_of(4, "f"), None);
        assert_eq!(mask_of(0, ""), None);
    }
}
