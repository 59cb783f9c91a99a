//! Findings about how late the control chain may wake up: each has its remedy, and those that a file of the kernel
//! decides, and that a restart of the machine undoes, also have what to write there. Pure.
//! docs/real-time.md explains them.

use super::kernel::{Kernel, Preemption, WORKERS_MASK, format_cpus, mask_of};
use crate::finding::{Finding, note, warning};
use std::path::PathBuf;

/// Wake-up time of an idle state that takes a considerable part of a cycle of 4 ms, µs.
const DEEP_IDLE_US: u32 = 100;
/// Acceptable delay of received bytes by a serial adapter, ms.
const LATENCY_MS: u32 = 1;
/// Rate above which an ordinary kernel is late too often under load, Hz: on a Raspberry Pi 5 it was up to 9 ms late,
/// more than two periods of 250 Hz.
const RATE_OF_ORDINARY_KERNEL_HZ: f64 = 100.0;
/// First id of users who log in; systemd removes nothing of those before it (SYS_UID_MAX of login.defs).
const FIRST_ORDINARY_USER: u32 = 1000;

/// What the system file asks of the machine.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Wanted {
    /// Control rate, Hz; 0 without a system file.
    pub rate_hz: f64,
    /// Keys of `[realtime]` that the system file leaves out, of those that give the control chain precedence.
    pub left_out: Vec<&'static str>,
    /// Processor of the control chain.
    pub cpu: Option<usize>,
    /// Whether the processors are kept from deep sleep.
    pub keeps_awake: bool,
    /// The folder of the runs, where they are recorded to an SD card.
    pub runs_on_sd_card: Option<PathBuf>,
    /// The user who runs the robot.
    pub user: u32,
    /// Whether the user's processes may outlive a session: systemd lets this user linger.
    pub lingers: bool,
}

/// One text to write into a file of the kernel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Write {
    /// File, relative to the root folder.
    pub file: String,
    /// Text.
    pub text: String,
    /// Whether the file has the same meaning after a restart of the machine.
    pub is_stable: bool,
}

/// A finding, and what cures it at once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Examined {
    /// Finding.
    pub finding: Finding,
    /// What to write; empty where the remedy is a person's.
    pub writes: Vec<Write>,
}

impl From<Finding> for Examined {
    fn from(finding: Finding) -> Self {
        Self { finding, writes: Vec::new() }
    }
}

/// Examines a kernel.
#[must_use]
pub fn examine(kernel: &Kernel, wanted: &Wanted) -> Vec<Examined> {
    let mut found = vec![preemption(kernel, wanted)];
    if !wanted.left_out.is_empty() {
        let keys = wanted.left_out.join(", ");
        found.push(note(format!("[realtime] of the system file leaves out {keys}; see docs/real-time.md")).into());
    }
    found.extend(governors(kernel));
    found.extend(idle(kernel, wanted));
    found.extend(wanted.cpu.and_then(|cpu| isolation(kernel, cpu)));
    found.extend(wanted.cpu.and_then(|cpu| interrupts(kernel, cpu)));
    found.extend(wanted.cpu.and_then(|cpu| workers(kernel, cpu)));
    found.extend(kernel.adapters.iter().filter_map(|adapter| {
        let (name, latency_ms) = (&adapter.name, adapter.latency_ms);
        let collects = format!("the adapter of /dev/{name} collects received bytes for {latency_ms} ms");
        let write = Write {
            file: format!("sys/bus/usb-serial/devices/{name}/latency_timer"),
            text: LATENCY_MS.to_string(),
            is_stable: false,
        };
        (latency_ms > LATENCY_MS).then(|| Examined {
            finding: match adapter.is_writable {
                true => note(format!("{collects}; a robot that opens it sets {LATENCY_MS} ms")),
                false => warning(
                    collects,
                    "add the udev rule SUBSYSTEM==\"usb-serial\", ATTR{latency_timer}=\"1\", as the package does",
                ),
            },
            writes: vec![write],
        })
    }));
    if let Some(runs) = &wanted.runs_on_sd_card {
        let card = "runs are recorded to an SD card, which stops for up to seconds and wears out".to_owned();
        // Not another folder: a service may write to no other one.
        let cure = format!("mount an SSD, NVMe or USB disk at {}, as docs/real-time.md says", runs.display());
        found.push(warning(card, &cure).into());
    }
    if kernel.removes_ipc && wanted.user >= FIRST_ORDINARY_USER && !wanted.lingers {
        found.push(
            warning(
                "systemd removes this user's shared memory at the end of the last session (RemoveIPC), also of a running robot"
                    .to_owned(),
                "run the robot as a service, or `loginctl enable-linger`, or set `RemoveIPC=no` in /etc/systemd/logind.conf",
            )
            .into(),
        );
    }
    found
}

fn preemption(kernel: &Kernel, wanted: &Wanted) -> Examined {
    let release = &kernel.release;
    let kind = match kernel.preemption {
        Preemption::RealTime => return note(format!("kernel {release} with PREEMPT_RT")).into(),
        Preemption::Full => "preemptible, without PREEMPT_RT",
        Preemption::Voluntary => "without preemption of its own code",
        Preemption::Unknown => "without PREEMPT_RT",
    };
    if wanted.rate_hz <= RATE_OF_ORDINARY_KERNEL_HZ {
        return note(format!("kernel {release} {kind}; `nims bench` measures whether it keeps time")).into();
    }
    let rate_hz = wanted.rate_hz;
    warning(
        format!("kernel {release} {kind}: at {rate_hz} Hz under load it may be late by more than a period"),
        "install the kernel with PREEMPT_RT of your distribution (Debian: linux-image-rt-amd64 or -arm64), see docs/real-time.md",
    )
    .into()
}

fn governors(kernel: &Kernel) -> Option<Examined> {
    let slow: Vec<_> = kernel.governors.iter().filter(|governor| governor.now != "performance").collect();
    let first = slow.first()?;
    let finding = warning(
        format!(
            "{} of {} processors change their frequency ({}), which delays wake-ups",
            slow.len(),
            kernel.governors.len(),
            first.now
        ),
        "`nims doctor --fix` as root, or `cpupower frequency-set -g performance`",
    );
    let writes = slow.iter().filter(|governor| governor.offers_performance).map(|governor| Write {
        file: format!("sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor", governor.cpu),
        text: "performance".to_owned(),
        is_stable: true,
    });
    Some(Examined { finding, writes: writes.collect() })
}

fn idle(kernel: &Kernel, wanted: &Wanted) -> Option<Examined> {
    let deepest_us = kernel.deepest_idle_us.filter(|latency_us| *latency_us > DEEP_IDLE_US && !wanted.keeps_awake)?;
    Some(
        warning(
            format!("idle processors sleep so deeply that they need up to {deepest_us} µs to wake up"),
            "set `idle_latency_us = 0` in [realtime] of the system file, or at most 100",
        )
        .into(),
    )
}

fn isolation(kernel: &Kernel, cpu: usize) -> Option<Examined> {
    let (isolated, ticks) = (kernel.isolated.contains(&cpu), !kernel.without_tick.contains(&cpu));
    let missing = match (isolated, ticks) {
        (true, false) => return None,
        (true, true) => format!("processor {cpu} of the control chain has a periodic tick"),
        (false, _) => format!("other programs run on processor {cpu} of the control chain, too"),
    };
    let others: Vec<usize> = kernel.online.iter().copied().filter(|other| *other != cpu).collect();
    let cure = if others.is_empty() {
        "leave `realtime.cpu` out: this machine has one processor".to_owned()
    } else {
        format!(
            "add `isolcpus={cpu} nohz_full={cpu} rcu_nocbs={cpu} irqaffinity={}` to the kernel's command line, then restart the machine",
            format_cpus(&others)
        )
    };
    Some(warning(missing, &cure).into())
}

fn interrupts(kernel: &Kernel, cpu: usize) -> Option<Examined> {
    let others: Vec<usize> = kernel.online.iter().copied().filter(|other| *other != cpu).collect();
    let on_it: Vec<_> = kernel.interrupts.iter().filter(|interrupt| interrupt.cpus.contains(&cpu)).collect();
    // An interrupt that only this processor may handle belongs to it, as its timer does.
    let movable: Vec<_> = on_it.iter().filter(|interrupt| interrupt.cpus.len() > 1).collect();
    if movable.is_empty() || others.is_empty() {
        return None;
    }
    let finding = warning(
        format!("{} interrupts may be handled by processor {cpu} of the control chain", movable.len()),
        "`nims doctor --fix` as root, and `irqaffinity=` on the kernel's command line; stop irqbalance",
    );
    let writes = movable.iter().map(|interrupt| {
        let rest: Vec<usize> = interrupt.cpus.iter().copied().filter(|other| *other != cpu).collect();
        Write {
            file: format!("proc/irq/{}/smp_affinity_list", interrupt.number),
            text: format_cpus(&rest),
            is_stable: false,
        }
    });
    Some(Examined { finding, writes: writes.collect() })
}

/// A byte that a serial port receives reaches the program through a worker of the kernel with ordinary priority
/// (`flush_to_ldisc`, on an unbound workqueue). On a busy processor it waits for milliseconds, and the answer of a
/// drive with it. The control chain waits for that answer, so its own processor is free for the worker.
fn workers(kernel: &Kernel, cpu: usize) -> Option<Examined> {
    let mask = mask_of(cpu, &kernel.workers_mask).filter(|mask| *mask != kernel.workers_mask)?;
    let finding = warning(
        format!(
            "workers of the kernel, which pass on what serial ports receive, may wait for other programs: they are not only on processor {cpu} of the control chain"
        ),
        "`nims doctor --fix` as root",
    );
    let write = Write { file: format!("sys/{WORKERS_MASK}"), text: mask, is_stable: true };
    Some(Examined { finding, writes: vec![write] })
}

#[cfg(test)]
mod tests {
    use super::super::kernel::{Adapter, Governor, Interrupt};
    use super::*;
    use crate::finding::Level;

    fn sound() -> Kernel {
        Kernel {
            release: "6.12.25-rt".to_owned(),
            preemption: Preemption::RealTime,
            isolated: vec![3],
            without_tick: vec![3],
            online: vec![0, 1, 2, 3],
            governors: (0..4)
                .map(|cpu| Governor { cpu, now: "performance".to_owned(), offers_performance: true })
                .collect(),
            deepest_idle_us: Some(2),
            interrupts: vec![Interrupt { number: 1, cpus: vec![0, 1] }, Interrupt { number: 2, cpus: vec![3] }],
            adapters: vec![Adapter { name: "ttyUSB0".to_owned(), latency_ms: 1, is_writable: false }],
            workers_mask: "8".to_owned(),
            ..Kernel::default()
        }
    }

    const WANTED: Wanted = Wanted {
        rate_hz: 250.0,
        left_out: Vec::new(),
        cpu: Some(3),
        keeps_awake: false,
        runs_on_sd_card: None,
        user: 999,
        lingers: false,
    };

    #[test]
    fn a_sound_machine_has_one_note() {
        let found = examine(&sound(), &WANTED);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].finding.level == Level::Note && found[0].finding.finding.contains("PREEMPT_RT"));
    }

    /// Expects that one change gives exactly one warning with these words, and these writes.
    fn found(words: &[&str], writes: &[(&str, &str)], change: impl Fn(&mut Kernel, &mut Wanted)) {
        let (mut kernel, mut wanted) = (sound(), WANTED);
        change(&mut kernel, &mut wanted);
        let all = examine(&kernel, &wanted);
        let bad: Vec<_> = all.iter().filter(|examined| examined.finding.level != Level::Note).collect();
        let [only] = bad.as_slice() else { panic!("{words:?}: {all:?}") };
        assert!(only.finding.level == Level::Warning && !only.finding.cure.is_empty(), "{only:?}");
        for word in words {
            assert!(
                format!("{} {}", only.finding.finding, only.finding.cure).contains(word),
                "no {word:?} in {only:?}"
            );
        }
        let made: Vec<_> = only.writes.iter().map(|write| (&*write.file, &*write.text)).collect();
        assert_eq!(made, writes);
    }

    #[test]
    fn each_defect_has_one_finding_with_a_remedy() {
        found(&["250 Hz", "linux-image-rt"], &[], |kernel, _| kernel.preemption = Preemption::Full);
        found(&["without preemption"], &[], |kernel, _| kernel.preemption = Preemption::Voluntary);
        let file = "sys/devices/system/cpu/cpu2/cpufreq/scaling_governor";
        found(&["1 of 4", "powersave", "cpupower"], &[(file, "performance")], |kernel, _| {
            kernel.governors[2].now = "powersave".to_owned();
        });
        found(&["schedutil"], &[], |kernel, _| {
            kernel.governors[0] = Governor { cpu: 0, now: "schedutil".to_owned(), offers_performance: false };
        });
        found(&["900 µs", "idle_latency_us"], &[], |kernel, _| kernel.deepest_idle_us = Some(900));
        found(&["isolcpus=3", "irqaffinity=0,1,2"], &[], |kernel, _| kernel.isolated.clear());
        found(&["periodic tick", "nohz_full=3"], &[], |kernel, _| kernel.without_tick.clear());
        found(&["1 interrupts", "processor 3"], &[("proc/irq/7/smp_affinity_list", "0,2")], |kernel, _| {
            kernel.interrupts.push(Interrupt { number: 7, cpus: vec![0, 2, 3] });
        });
        let timer = "sys/bus/usb-serial/devices/ttyUSB0/latency_timer";
        found(&["16 ms", "udev", "latency_timer"], &[(timer, "1")], |kernel, _| kernel.adapters[0].latency_ms = 16);
        let workers = "sys/devices/virtual/workqueue/cpumask";
        found(&["serial ports", "processor 3"], &[(workers, "8")], |kernel, _| kernel.workers_mask = "f".to_owned());
        found(&["serial ports", "processor 3"], &[(workers, "8")], |kernel, _| kernel.workers_mask = "7".to_owned());
        found(&["SD card", "mount", "/var/lib/nims/runs"], &[], |_, wanted| {
            wanted.runs_on_sd_card = Some("/var/lib/nims/runs".into());
        });
        found(&["RemoveIPC", "enable-linger"], &[], |kernel, wanted| {
            (kernel.removes_ipc, wanted.user) = (true, 1000);
        });
    }

    #[test]
    fn what_does_no_harm_is_no_warning() {
        let quiet = |change: &dyn Fn(&mut Kernel, &mut Wanted)| {
            let (mut kernel, mut wanted) = (sound(), WANTED);
            change(&mut kernel, &mut wanted);
            let found = examine(&kernel, &wanted);
            assert!(found.iter().all(|examined| examined.finding.level == Level::Note), "{found:?}");
            found
        };
        // An ordinary kernel at 100 Hz; deep sleep that the system file prevents; no processor of its own.
        quiet(&|kernel, wanted| (kernel.preemption, wanted.rate_hz) = (Preemption::Full, 100.0));
        quiet(&|kernel, wanted| (kernel.deepest_idle_us, wanted.keeps_awake) = (Some(900), true));
        quiet(&|kernel, wanted| {
            kernel.isolated.clear();
            kernel.interrupts.push(Interrupt { number: 7, cpus: vec![0, 3] });
            wanted.cpu = None;
        });
        let found = quiet(&|_, wanted| (wanted.cpu, wanted.left_out) = (None, vec!["lock_memory", "cpu"]));
        assert!(found.len() == 2 && found[1].finding.finding.contains("lock_memory, cpu"), "{found:?}");
        // A kernel that does not tell where its workers are.
        quiet(&|kernel, _| kernel.workers_mask.clear());
        // A service's user, and one who lingers.
        quiet(&|kernel, _| kernel.removes_ipc = true);
        quiet(&|kernel, wanted| (kernel.removes_ipc, wanted.user, wanted.lingers) = (true, 1000, true));
        // motor-io sets the timer itself if it may; it can still be set before.
        let found = quiet(&|kernel, _| {
            kernel.adapters[0] = Adapter { name: "ttyUSB1".to_owned(), latency_ms: 16, is_writable: true };
        });
        assert_eq!(found[1].writes.len(), 1);
    }
}
