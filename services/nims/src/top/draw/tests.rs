//! Tests of the text that `nims top` draws.

use super::super::snapshot::{ChannelRow, Scale};
use super::*;
use messages::{ControlStatus, MotorSlots, MotorState, NodeEstimate, PlanStatus, put_text};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use std::path::Path;

const NOW: u64 = 1_000_000_000_000;

fn picture(snapshot: &Snapshot, width: u16, height: u16) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, snapshot)).unwrap();
    let buffer = terminal.backend().buffer().clone();
    (0..height).map(|y| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>()).collect()
}

fn line<'a>(picture: &'a [String], word: &str) -> &'a str {
    picture.iter().find(|line| line.contains(word)).unwrap_or_else(|| panic!("no {word:?} in\n{}", picture.join("\n")))
}

fn row(name: &str, state: u8) -> (ProcessState, Option<Heartbeat>) {
    let mut row = ProcessState { state, pid: 4711, exit_code: -1, ..Default::default() };
    row.header.stamp_ns = NOW;
    put_text(&mut row.name, name);
    let beat = Heartbeat { busy_p50_ns: 120_000, busy_p99_ns: 450_000, pid: 4711, ..Default::default() };
    (row, Some(beat))
}

fn flying() -> Snapshot {
    let mut authority = MotorAuthority {
        mode: MotorAuthority::MODE_FOLLOWING,
        period_s: 0.01,
        steered: 5000,
        lost_answer: 2,
        bus_ns: 3_400_000,
        command_age_ns: 12_100_000,
        plan_rate: 1.0,
        position_known: MotorState::POSITION_KNOWN,
        verdict: [MotorAuthority::VERDICT_ACCEPTED, MotorAuthority::VERDICT_STALE],
        cable_count: 3,
        ..Default::default()
    };
    authority.header.cycle = 12345;
    authority.header.stamp_ns = NOW;
    let mut state = MotorState { cable_count: 3, fresh: [1; 8], ..Default::default() };
    state.length_m[..3].copy_from_slice(&[5.0, 2.5, 10.0]);
    state.current_a[0] = 4.0;
    let mut estimate = NodeEstimate { position_m: [4.8, 3.0, 0.3], valid: 1, cable_count: 3, ..Default::default() };
    estimate.tension_n[..3].copy_from_slice(&[30.0, 1.0, 45.0]);
    estimate.header.stamp_ns = NOW;
    let mut control = ControlStatus {
        law: ControlStatus::LAW_PREVIEW,
        valid: 1,
        segment: 3,
        error_norm_m: 0.0012,
        ..Default::default()
    };
    control.header.stamp_ns = NOW;
    let mut plan = PlanStatus {
        state: PlanStatus::STATE_RUNNING,
        leg: 2,
        legs: 5,
        progress: 0.43,
        time_left_s: 12.0,
        ..Default::default()
    };
    put_text(&mut plan.mission, "survey");
    Snapshot {
        now_ns: NOW,
        domain: Some("demo3".to_owned()),
        run: "runs/today".to_owned(),
        scale: Scale { length_m: 10.0, tension_n: [2.0, 60.0], current_a: 8.0 },
        authority: Some(authority),
        state: Some(state),
        estimate: [Some(estimate), None],
        control: [Some(control), None],
        plan: Some(plan),
        processes: vec![
            row("recorder", ProcessState::STATE_READY),
            row("motor-io", ProcessState::STATE_SILENT),
            row("planner", ProcessState::STATE_DIED),
        ],
        channels: vec![
            ChannelRow { name: "motor/state".to_owned(), hz: 100.0, lost: 0 },
            ChannelRow { name: "energy".to_owned(), hz: 10.0, lost: 7 },
        ],
        recording: Some(Recording { why: None, bytes: 2_500_000, lost: 7, free_bytes: 40_000_000_000, stamp_ns: NOW }),
        ..Snapshot::default()
    }
}

/// A flight with every panel filled, to be drawn at 80 x 24.
fn full() -> Snapshot {
    let mut full = flying();
    full.run = "/var/lib/nims/runs/2026-01-01T00-00-00Z-demo3".to_owned();
    let names = ["motor-box", "estimator", "controller", "visualization", "supervisor"];
    full.processes.extend(names.map(|name| row(name, ProcessState::STATE_READY)));
    full.answer = "Pausing.".to_owned();
    full
}

/// A flight with a second controller in this phase of its swap, and an estimator in quarantine, which does not run.
fn swapping(phase: u8) -> Snapshot {
    let mut swapping = flying();
    let mut second = swapping.control[0].unwrap();
    second.law = ControlStatus::LAW_P_FEEDFORWARD;
    swapping.control[1] = Some(second);
    let mut slots = MotorSlots {
        phase: [MotorSlots::PHASE_ACTIVE, phase, MotorSlots::PHASE_ACTIVE, MotorSlots::PHASE_QUARANTINED],
        fade: [1.0; 2],
        good_cycles: [0, 40, 0, 0],
        qualify_cycles: 100,
        ..Default::default()
    };
    slots.commit_cycle[CONTROLLERS] = 12400;
    slots.cause[3] = MotorSlots::CAUSE_ABSENT;
    swapping.slots = Some(slots);
    swapping
}

/// A flight whose last samples are 5 s old.
fn silent() -> Snapshot {
    Snapshot { now_ns: NOW + 5_000_000_000, ..flying() }
}

fn faulted() -> Snapshot {
    let mut faulted = flying();
    if let Some(authority) = &mut faulted.authority {
        authority.mode = MotorAuthority::MODE_FAULTED;
        authority.faults = MotorAuthority::FAULT_SLACK | MotorAuthority::FAULT_SUPPLY;
        authority.fault_cable[1] = 1;
    }
    faulted
}

#[test]
fn every_screen_is_as_in_its_file() {
    let alone = Snapshot { now_ns: NOW, domain: Some("x".to_owned()), ..Snapshot::default() };
    let screens = [
        ("flying", flying(), 100, 40),
        ("flying in a low window", flying(), 160, 30),
        ("full", full(), 80, 24),
        ("qualifying", swapping(MotorSlots::PHASE_SHADOW), 140, 40),
        ("switching", swapping(MotorSlots::PHASE_SWITCHING), 140, 40),
        ("silent", silent(), 120, 40),
        ("alone", alone, 80, 30),
        ("faulted", faulted(), 140, 40),
        ("waiting", Snapshot::waiting(NOW, "no robot runs here: start one"), 60, 10),
    ];
    let lines = screens.into_iter().flat_map(|(name, snapshot, width, height)| {
        let picture = picture(&snapshot, width, height);
        picture.into_iter().enumerate().map(move |(row, text)| (format!("{name} {row:02}"), text.trim_end().to_owned()))
    });
    ::sentences::compare_with(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/top.txt"), lines);
}

#[test]
fn modes_faults_and_processes_fit_on_one_screen() {
    for (width, height) in [(100, 40), (160, 30)] {
        let picture = picture(&flying(), width, height);
        for (word, figure) in [
            ("FOLLOWING", "motion"),
            ("4.800, 3.000, 0.300 m", "1.2 mm"),
            ("survey", "43 %"),
            ("12345", "100 Hz"),
            ("12345", "5002"),
            ("timing", "3.4 ms"),
            ("2.5 MB", "40.0 GB"),
            ("controller a", "preview"),
            ("estimator  a", "lengths"),
            ("recorder  ", "ready"),
            ("motor-io  ", "SILENT"),
            ("planner  ", "DIED"),
            ("motor/state", "100.0 Hz"),
            ("energy", "7"),
        ] {
            let line = line(&picture, word);
            assert!(line.contains(figure), "no {figure:?} in {line:?} of\n{}", picture.join("\n"));
        }
        // Slots b are empty.
        assert!(!picture.iter().any(|line| line.contains("controller b") || line.contains("estimator  b")));
    }
}

#[test]
fn a_terminal_of_80_by_24_shows_every_panel_with_the_heads_of_its_columns() {
    let mut full = full();
    let shown = picture(&full, 80, 24);
    for (word, with) in [
        ("CABLE", &["length", "speed", "tension", "current"][..]),
        ("CONTROL", &["slot", "law", "verdict"]),
        ("PROCESS", &["state", "pid", "busy"]),
        ("FOLLOWING", &[]),
        ("4.800, 3.000, 0.300 m", &["1.2 mm"]),
        ("survey", &["43 %", "12 s", "clock 100 %"]),
        ("12345", &["100 Hz", "2 of 5002", "answer 2"]),
        ("timing", &["3.4 ms", "0.0 ms", "12.1 ms"]),
        ("2.5 MB", &["7 lost", "40.0 GB", "2026-01-01T00-00-00Z-demo3"]),
        ("10.000 m", &["45.0 N", "0.00 A"]),
        ("estimator  a", &["lengths"]),
        ("Pausing.", &[]),
    ] {
        let line = line(&shown, word);
        assert!(with.iter().all(|with| line.contains(with)), "{with:?} in {line:?} of\n{}", shown.join("\n"));
    }
    for (process, _) in &full.processes {
        line(&shown, &format!("{:<20} ", text_of(&process.name)));
    }
    // No text line of the robot is cut within a word or a number, also with the longest figures and names.
    let mut long = full.clone();
    if let (Some(authority), Some(plan)) = (&mut long.authority, &mut long.plan) {
        (authority.header.cycle, authority.steered) = (1_234_567_890, 1_234_567_800);
        (authority.lost_computer, authority.lost_drive) = (123_456, 12_345);
        authority.position_known = MotorState::POSITION_RESTORED;
        put_text(&mut plan.mission, "a-mission-with-a-long-name-of-a-survey");
    }
    let text = picture(&long, 80, 24).join(" ");
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    for whole in ["1234567890 at 100 Hz", "computer 123456, drive 12345, answer 2", "12.1 ms old", "confirm"] {
        assert!(words.contains(whole), "no {whole:?} in\n{}", picture(&long, 80, 24).join("\n"));
    }
    // A head ends where the figures below it end.
    let end = |text: &str, word: &str| text.find(word).map(|at| text[..at + word.len()].chars().count());
    let (head, first) = (line(&shown, "CABLE"), line(&shown, "5.000 m"));
    assert_eq!(end(head, "length"), end(first, "5.000"));
    assert_eq!(end(head, "current"), end(first, "4.00"));
    full.answer.clear();
    assert!(line(&picture(&full, 80, 24), "quit").contains("pause"));
}

#[test]
fn a_swap_shows_its_progress() {
    let second = |phase| line(&picture(&swapping(phase), 140, 40), "p-feedforward").to_owned();
    let (qualifying, switching) = (second(MotorSlots::PHASE_SHADOW), second(MotorSlots::PHASE_SWITCHING));
    assert!(qualifying.contains("40") && qualifying.contains("100") && !qualifying.contains("12400"), "{qualifying}");
    assert!(switching.contains("12400"), "{switching}");
    // A quarantined estimator is shown although it does not run.
    line(&picture(&swapping(MotorSlots::PHASE_SHADOW), 140, 40), "estimator  b");
}

#[test]
fn the_length_of_a_bar_is_its_fraction_of_the_full_scale() {
    let picture = picture(&flying(), 100, 40);
    let bars = |line: &str| -> Vec<usize> {
        let mut counts = vec![0; 3];
        let (mut at, mut cells) = (0, 0);
        for symbol in line.chars().filter(|symbol| "█░".contains(*symbol)) {
            counts[at] += usize::from(symbol == '█');
            cells += 1;
            if cells % BAR == 0 && at < 2 {
                at += 1;
            }
        }
        counts
    };
    assert_eq!(bars(line(&picture, "5.000 m")), [5, 5, 5]);
    assert_eq!(bars(line(&picture, "2.500 m")), [3, 0, 0]);
    assert_eq!(bars(line(&picture, "10.000 m")), [10, 8, 0]);
    for (share, filled) in [(f64::NAN, 0), (f64::INFINITY, 0), (-1.0, 0), (9.0, BAR)] {
        assert_eq!(bar(share, Color::Red).content.matches('█').count(), filled, "{share}");
    }
}

#[test]
fn stale_samples_are_not_shown_as_current() {
    let silent = picture(&silent(), 120, 40);
    let current = ["FOLLOWING", "4.800", "2.5 MB"];
    assert!(!silent.iter().any(|line| current.iter().any(|word| line.contains(word))), "{}", silent.join("\n"));
    for process in ["motor-io", "supervisor", "recorder"] {
        let named = silent.iter().filter(|line| line.contains(process));
        assert!(named.into_iter().any(|line| line.contains("5 s")), "{process} in\n{}", silent.join("\n"));
    }
}

#[test]
fn every_fault_has_its_sentence() {
    let faulted = faulted();
    let picture = picture(&faulted, 140, 40);
    line(&picture, "FAULTED");
    let sentences = robot_state::sentences::faults_of(&faulted.authority.unwrap());
    assert_eq!(sentences.len(), 2);
    for sentence in sentences {
        // A long sentence continues on the next line of the screen.
        line(&picture, sentence.split(':').next().unwrap());
    }
    assert!(picture.join("").contains("(cable 2)"));
}

#[test]
fn any_terminal_size_and_any_values_can_be_drawn() {
    let mut odd = flying();
    if let Some(state) = &mut odd.state {
        state.cable_count = 255;
        state.length_m = [f64::NAN; 8];
        state.current_a = [f64::INFINITY; 8];
    }
    if let Some(authority) = &mut odd.authority {
        (authority.active_controller, authority.active_estimator, authority.mode) = (255, 255, 255);
        authority.verdict = [255; 2];
        authority.in_charge = [255; 2];
        authority.period_s = 0.0;
    }
    odd.slots = Some(MotorSlots { phase: [255; 4], cause: [255; 4], deviation: [f64::NAN; 4], ..Default::default() });
    odd.scale.length_m = 0.0;
    for width in 1..60 {
        for height in [1, 2, 3, 7, 24] {
            picture(&odd, width, height);
            picture(&Snapshot::waiting(NOW, "nothing"), width, height);
        }
    }
}
