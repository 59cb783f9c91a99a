//! A whole process: its heartbeats, its log, its end, and its errors at the start.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};

use bus::clock::now_ns;
use bus::{Bus, Domain, Publisher, Subscriber, Waiter};
use messages::{Heartbeat, LogEvent, Message, MotorState, text_of};

fn echo(arguments: &[&str]) -> Command {
    let examples = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("examples");
    let mut command = Command::new(examples.join("echo"));
    command.args(arguments).stderr(Stdio::piped());
    command
}

/// Runs a process that cannot start; returns its exit code and its message.
fn refused(arguments: &[&str]) -> (i32, String) {
    let output = echo(arguments).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

/// Waits for a sample that satisfies `wanted`, at most 20 s.
fn wait_for<T: Message>(subscriber: &mut Subscriber<T>, waiter: &mut Waiter, mut wanted: impl FnMut(&T) -> bool) -> T {
    let give_up = now_ns() + 20_000_000_000;
    loop {
        while let Some(sample) = subscriber.receive().unwrap() {
            if wanted(&sample) {
                return sample;
            }
        }
        assert!(now_ns() < give_up, "no such sample arrived");
        waiter.wait_until(Some(now_ns() + 100_000_000)).unwrap();
    }
}

struct Watched {
    beats: Subscriber<Heartbeat>,
    log: Subscriber<LogEvent>,
    states: Publisher<MotorState>,
    waiter: Waiter,
}

fn watch(bus: &Bus) -> Watched {
    Watched {
        beats: bus.subscriber("system/heartbeat/echo").unwrap(),
        // A whole burst may arrive while this program is not scheduled.
        log: bus.deep_subscriber("system/log/echo").unwrap(),
        states: bus.publisher("motor/state").unwrap(),
        waiter: bus.waiter(&["system/heartbeat/echo", "system/log/echo"]).unwrap(),
    }
}

/// Ends a child process with SIGTERM, as a supervisor does.
fn terminate(child: &mut std::process::Child) -> ExitStatus {
    rustix::process::kill_process(rustix::process::Pid::from_child(child), rustix::process::Signal::TERM).unwrap();
    child.wait().unwrap()
}

#[test]
fn a_process_starts_works_logs_and_ends() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut seen = watch(&bus);
    let mut child = echo(&["--domain", domain.name()]).spawn().unwrap();
    let first = wait_for(&mut seen.beats, &mut seen.waiter, |_| true);
    assert_eq!((first.state, first.beat, text_of(&first.name).as_str()), (Heartbeat::STATE_STARTING, 1, "echo"));
    assert_eq!(first.pid, child.id());
    assert_ne!(first.incarnation, 0);
    wait_for(&mut seen.beats, &mut seen.waiter, |beat| beat.state == Heartbeat::STATE_READY);
    for cycle in 1..=3 {
        let mut state = MotorState::default();
        state.header.cycle = cycle;
        seen.states.send(&mut state).unwrap();
    }
    let event = wait_for(&mut seen.log, &mut seen.waiter, |event| text_of(&event.text).contains("cycle=3"));
    assert_eq!(text_of(&event.text), "a sample came cycle=3");
    assert_eq!((event.level, text_of(&event.process).as_str()), (LogEvent::LEVEL_INFO, "echo"));
    let beat = wait_for(&mut seen.beats, &mut seen.waiter, |beat| beat.passes == 3);
    assert!(beat.busy_max_ns >= beat.busy_p50_ns && beat.busy_p50_ns > 0);
    assert_eq!((beat.incarnation, beat.lost), (first.incarnation, 0));
    assert!(terminate(&mut child).success());
    wait_for(&mut seen.log, &mut seen.waiter, |event| text_of(&event.text) == runtime::ENDED);
    let last = wait_for(&mut seen.beats, &mut seen.waiter, |beat| beat.state == Heartbeat::STATE_STOPPING);
    assert!(last.beat > beat.beat);
    let printed = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    assert!(printed.contains("INFO  echo: a sample came cycle=3\n"), "{printed}");
}

#[test]
fn a_burst_of_events_is_truncated_and_the_number_of_dropped_events_is_logged() {
    const BURST: usize = 3000;
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut seen = watch(&bus);
    let mut child = echo(&["--domain", domain.name(), "--verbose", "--burst", &BURST.to_string()]).spawn().unwrap();
    let mut stderr = child.stderr.take().unwrap();
    let printing = std::thread::spawn(move || std::io::copy(&mut stderr, &mut std::io::sink()).unwrap());
    wait_for(&mut seen.beats, &mut seen.waiter, |beat| beat.state == Heartbeat::STATE_READY);
    seen.states.send(&mut MotorState::default()).unwrap();
    let mut events = 0;
    // The only event that starts with a number: the number of dropped events.
    let number = |event: &LogEvent| text_of(&event.text).split(' ').next().and_then(|word| word.parse::<usize>().ok());
    let said = wait_for(&mut seen.log, &mut seen.waiter, |event| {
        events += usize::from(text_of(&event.text).starts_with("event "));
        event.level == LogEvent::LEVEL_WARN && number(event).is_some()
    });
    let dropped = number(&said).unwrap();
    assert_eq!((events + dropped, seen.log.lost()), (BURST, 0));
    assert!(terminate(&mut child).success());
    printing.join().unwrap();
}

#[test]
fn a_failure_is_one_sentence_on_the_terminal_and_in_the_log() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut seen = watch(&bus);
    let child = echo(&["--domain", domain.name(), "--fail"]).spawn().unwrap();
    wait_for(&mut seen.beats, &mut seen.waiter, |beat| beat.state == Heartbeat::STATE_READY);
    // A subscriber connects to a publisher when it receives, and the process may end before this test runs again.
    while seen.log.receive().unwrap().is_some() {}
    seen.states.send(&mut MotorState::default()).unwrap();
    wait_for(&mut seen.log, &mut seen.waiter, |event| {
        event.level == LogEvent::LEVEL_ERROR && text_of(&event.text) == "was told to fail"
    });
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().ends_with("ERROR echo: was told to fail\n"));
}

#[test]
fn bad_input_is_rejected_with_one_sentence_and_exit_code_2() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut seen = watch(&bus);
    let mut child = echo(&["--domain", domain.name()]).spawn().unwrap();
    wait_for(&mut seen.beats, &mut seen.waiter, |beat| beat.state == Heartbeat::STATE_READY);
    let (code, said) = refused(&["--domain", domain.name()]);
    let (place, pid) = (format!("`{}`", domain.name()), child.id().to_string());
    assert!(code == 2 && said.starts_with("echo: "), "{code} {said}");
    assert!(["`echo`", &place, &pid].iter().all(|part| said.contains(part)), "{said}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("system.toml");
    std::fs::write(&file, "name = \"x\"\nrobbot = \"lab3.toml\"\n").unwrap();
    let name = bus::BusError::DomainName { name: "a b".into(), why: bus::BadName::Characters };
    let missing = config::ConfigError::Unreadable {
        path: "/nowhere.toml".into(),
        why: config::file::read_text(Path::new("/nowhere.toml")).unwrap_err().to_string(),
    };
    let file = file.to_str().unwrap();
    let cases: [(&[&str], &[&str]); 6] = [
        (&[], &["--system", "--domain"]),
        (&["--domain", "a b"], &[&name.to_string()]),
        (&["--domain", domain.name(), "--name", "Ä"], &["`Ä`"]),
        (&["--system", "/nowhere.toml"], &[&missing.to_string()]),
        (&["--system", file], &[file, " 2: ", "`robbot`", "`robot`"]),
        (&["--slot", "c"], &["'c'", "--slot"]),
    ];
    for (arguments, parts) in cases {
        let (code, said) = refused(arguments);
        assert!(code == 2 && parts.iter().all(|part| said.contains(part)), "{arguments:?}: {code} {said}");
        // Messages of clap have their own form.
        assert!(said.starts_with("echo: ") && said.lines().count() == 1 || arguments[0] == "--slot", "{said}");
    }
    assert!(terminate(&mut child).success());
}
