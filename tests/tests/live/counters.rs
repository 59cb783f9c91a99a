//! Compares the injected causes with those that motor-io publishes, and checks that an independent reader of the run
//! file computes the same numbers over two lives of motor-io.

use crate::robot::{Robot, root, steadily};
use analysis::counters::PeriodCounter;
use messages::{MotorAuthority, Request};
use nims_tests::python;
use robot_state::Periods;
use rustix::process::Signal;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde_json::Value;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Time for which a process is stopped.
const STOPPED: Duration = Duration::from_millis(500);
/// Least share of the periods of that time; the rest is the time to stop a process and to detect it.
const MOST: u64 = 30;
/// Busy threads beside the robot, and for how long.
const BUSY: usize = 8;
const BUSY_FOR: Duration = Duration::from_secs(3);

fn mission_under_way(robot: &mut Robot) {
    let mut mission = "name = \"to and fro\"\nspeed_m_s = 0.15\n".to_owned();
    for _ in 0..40 {
        mission +=
            "[[leg]]\npolyline = { points_m = [[5.6, 3.4, 0.6], [4.8, 4.0, 0.9], [4.0, 3.4, 0.6], [4.8, 3.0, 0.3]] }\n";
    }
    std::fs::write(robot.folder().join("fro.toml"), mission).unwrap();
    robot.arm();
    robot.until_reported("the mission is accepted", |robot| robot.nims(&["run", "./fro.toml"]).status.success());
    going_on(robot);
}

/// Waits until the robot follows its motion at full rate again; if it holds because of the disturbance, requests a
/// resume.
fn going_on(robot: &mut Robot) {
    for _ in 0..50 {
        robot.for_cycles(30);
        let MotorAuthority { mode, faults, plan_rate, .. } = robot.last;
        match mode {
            MotorAuthority::MODE_FOLLOWING if faults == 0 && plan_rate == 1.0 => return,
            MotorAuthority::MODE_HOLDING => _ = robot.request("motor-io", &Request::Resume),
            _ => {}
        }
    }
    panic!("it does not go on: mode {}, faults {:#x}\n{}", robot.last.mode, robot.last.faults, robot.printed());
}

/// Disturbs a robot in flight; returns the periods until it flies again.
fn row(robot: &mut Robot, injected: &str, inject: impl FnOnce(&mut Robot)) -> Periods {
    robot.poll();
    let before = Periods::from_authority(&robot.last);
    inject(robot);
    going_on(robot);
    robot.poll();
    assert_eq!(robot.last.periods, robot.last.steered + robot.last.paused + robot.last.unsteered());
    let after = Periods::from_authority(&robot.last);
    let grown = Periods {
        steered: after.steered - before.steered,
        paused: after.paused - before.paused,
        computer: after.computer - before.computer,
        drive: after.drive - before.drive,
        resync: after.resync - before.resync,
        answer: after.answer - before.answer,
    };
    let Periods { steered, paused, computer, drive, resync, answer } = grown;
    println!("| {injected:44} | {steered:7} | {paused:6} | {computer:8} | {drive:5} | {resync:6} | {answer:6} |");
    grown
}

fn stopped(robot: &mut Robot, process: &str) {
    robot.signal(process, Signal::STOP);
    std::thread::sleep(STOPPED);
    robot.signal(process, Signal::CONT);
}

/// Threads that load every processor of the robot.
fn busy() {
    let ended = Arc::new(AtomicBool::new(false));
    let permitted = sched_getaffinity(None).unwrap();
    let processors: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|processor| permitted.is_set(*processor)).collect();
    let threads: Vec<_> = (0..BUSY)
        .map(|number| {
            let (ended, processor) = (ended.clone(), processors[number % processors.len()]);
            std::thread::spawn(move || {
                let mut own = CpuSet::new();
                own.set(processor);
                sched_setaffinity(None, &own).unwrap();
                while !ended.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            })
        })
        .collect();
    std::thread::sleep(BUSY_FOR);
    ended.store(true, Ordering::Relaxed);
    threads.into_iter().for_each(|thread| thread.join().unwrap());
}

#[test]
fn what_is_injected_is_named_and_a_foreign_reader_counts_the_same_over_two_lives() {
    steadily(|| {
        let mut robot = Robot::up("");
        mission_under_way(&mut robot);
        println!(
            "| injected                                     | steered | paused | computer | drive | resync | answer |"
        );
        println!("|---|---|---|---|---|---|---|");
        row(&mut robot, "nothing", |robot| robot.for_cycles(100));
        let paused = row(&mut robot, "an operator's pause of a second", |robot| {
            robot.ask("motor-io", Request::Pause);
            robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            robot.for_cycles(100);
        });
        assert!(paused.paused >= 95, "{paused:?}");
        let own = row(&mut robot, "SIGSTOP of motor-io for 0.5 s", |robot| stopped(robot, "motor-io"));
        assert!(own.computer >= MOST, "{own:?}");
        for process in ["estimator", "controller"] {
            let named =
                row(&mut robot, &format!("SIGSTOP of the {process} for 0.5 s"), |robot| stopped(robot, process));
            assert!(named.answer >= MOST, "{named:?}");
        }
        let late = row(&mut robot, "an estimator that is ten cycles late", |robot| {
            robot.fault_of("estimator", "slow 10 for 0.5");
            robot.until("it holds", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        });
        assert!(late.answer > 0, "{late:?}");
        // A series of lost periods keeps the cause of its first one. If the computer is short of time in exactly that
        // period, the series does not name the drives, and the drive is silenced again. An answer that was under way is
        // cut short, which is a resynchronisation. After a silence of about half of the watchdog's time its driver has
        // to stop it, and it is lost.
        let silenced = (0..3).any(|_| {
            let silent =
                row(&mut robot, "a drive that is silent for 0.12 s", |robot| robot.fault("silence 1 for 0.12"));
            assert!(silent.drive + silent.resync + silent.computer >= 10, "{silent:?}");
            silent.drive + silent.resync >= 10
        });
        assert!(silenced, "three times the computer instead of the drive");
        let noise = row(&mut robot, "noise for a second", |robot| {
            robot.fault("noise 1 0.0005 for 1");
            robot.for_cycles(100);
        });
        assert!(noise.drive + noise.resync > 0, "{noise:?}");
        row(&mut robot, &format!("{BUSY} busy loops for 3 s"), |_| busy());

        // Another life: the time without motor-io belongs to the mission that it interrupted.
        let first_life = Periods::from_authority(&robot.last);
        robot.signal("motor-io", Signal::KILL);
        std::thread::sleep(Duration::from_millis(700));
        robot.accepted(&["start", "motor-io"]);
        let life = robot.last.header.life;
        robot.until("another life", |robot| robot.last.header.life != life && robot.last.header.cycle > 50);
        robot.down(Signal::INT);

        let (ours, lives) = counted_alike(&robot);
        assert!(ours.answer >= first_life.answer + 60, "{ours:?}, {first_life:?}");
        assert_eq!(lives, 2);
    });
}

/// The periods of a robot's finished run, which an independent reader must count alike, and motor-io's lives.
pub fn counted_alike(robot: &Robot) -> (Periods, u64) {
    let (ours, theirs) = (counted(robot), foreign(robot));
    println!("{}: {}", ours.leading(), ours.by_cause());
    let fields = [
        ("steered", ours.steered),
        ("paused", ours.paused),
        ("computer", ours.computer),
        ("drive", ours.drive),
        ("resync", ours.resync),
        ("answer", ours.answer),
        ("unsteered", ours.unsteered()),
        ("all", ours.all()),
    ];
    for (name, value) in fields {
        assert_eq!(theirs[name].as_u64(), Some(value), "{name}: {theirs}");
    }
    assert_eq!(theirs["different"].as_u64(), Some(0), "{theirs}");
    (ours, theirs["lives"].as_u64().unwrap())
}

fn counted(robot: &Robot) -> Periods {
    let (mut reader, mut count) = (runlog::RunReader::open(&robot.run()).unwrap(), PeriodCounter::default());
    while let Some(recorded) = reader.next_sample().unwrap() {
        count.record(&recorded);
    }
    count.periods()
}

fn foreign(robot: &Robot) -> Value {
    let script = root().join("tests/python/count_periods.py");
    let output = Command::new(python()).arg(script).arg(robot.run()).output().unwrap();
    println!("{}", String::from_utf8_lossy(&output.stdout));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&[output.stdout, output.stderr].concat()));
    serde_json::from_slice(&output.stdout).unwrap()
}
