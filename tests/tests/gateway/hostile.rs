//! Clients that misbehave, and the stop that nothing delays.

use crate::rig::{Client, Gateway, OWNER};
use crate::robot::{Robot, START, steadily};
use bus::clock;
use gateway_protocol::{Accepted, Call, Origin, Reply, VERSION, encode};
use messages::{GotoPath, MotorAuthority, Request};
use robot_state::Periods;
use rustix::process::Signal;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::time::Duration;

/// Sends what no client should send.
fn malformed(number: usize) -> Vec<u8> {
    let hello = Call::Hello { version: VERSION, origin: Origin::Python, token: None, from: None }.header().unwrap();
    let other = Call::Hello { version: VERSION + 1, origin: Origin::Python, token: None, from: None }.header().unwrap();
    let greeted = |after: &[u8]| [encode(&hello, &[]), after.to_vec()].concat();
    match number % 8 {
        0 => vec![0xff; 8],
        1 => encode(b"not json", b"body"),
        2 => encode(&other, &[]),
        3 => greeted(&encode(br#"{"call":"fly","id":1}"#, &[])),
        4 => greeted(&u32::MAX.to_le_bytes()),
        5 => greeted(&[[2, 0, 0, 0], [0, 0, 0, 0xff]].concat()),
        6 => greeted(&encode(br#"{"call":"ask","id":1,"request":{"verb":"jog","cable":1}}"#, &[])),
        _ => greeted(&encode(&hello, &[])),
    }
}

#[test]
fn hostile_clients_delay_nobody() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.arm();
        let mut gateway = Gateway::joined(&robot, OWNER);
        let mut honest = gateway.client();
        robot.fly();
        let before = Periods::from_authority(&robot.last);
        // Readers that take nothing, of everything that is published.
        let Reply::Channels { channels, .. } = honest.call(&Call::Channels { id: 1 }) else { panic!() };
        let mut idle = Vec::new();
        for _ in 0..4 {
            let mut client = gateway.client();
            for (id, channel) in channels.iter().enumerate().take(60) {
                client.send(&Call::Subscribe { id: id as u64, channel: channel.name.clone(), rate_hz: None }, &[]);
            }
            idle.push(client);
        }
        // Connections beyond the number of a user, without a word.
        let silent: Vec<UnixStream> = (0..300).filter_map(|_| UnixStream::connect(&gateway.socket).ok()).collect();
        let mut closed = 0;
        for number in 0..10_000 {
            let mut client = Client::raw(&gateway.socket);
            // The gateway may close it before everything is written.
            let _ = client.stream.write_all(&malformed(number));
            if number % 100 == 0 {
                while client.next().is_some() {}
                closed += 1;
            }
        }
        assert_eq!(closed, 100);
        drop(silent);
        assert!(gateway.lives());
        // A client that comes after all of this is served, and stops the robot.
        let mut late = gateway.client();
        assert!(matches!(late.call(&Call::Robot { id: 1 }), Reply::Robot { robot: Some(_), .. }));
        assert_eq!(late.ask(Request::Stop).1, Accepted::Accepted);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        let after = Periods::from_authority(&robot.last);
        assert!(after.steered > before.steered);
        assert_eq!(after.answer, before.answer, "{after:?}");
    });
}

#[test]
fn a_slow_reader_loses_samples_and_is_told_how_many() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    robot.fly();
    let mut slow = gateway.client();
    let Reply::Channels { channels, .. } = gateway.client().call(&Call::Channels { id: 1 }) else { panic!() };
    for (id, channel) in channels.into_iter().enumerate().take(60) {
        slow.send(&Call::Subscribe { id: id as u64, channel: channel.name, rate_hz: None }, &[]);
    }
    // More than the socket and the queue hold.
    std::thread::sleep(Duration::from_secs(5));
    // It still does not read, and stops the robot.
    slow.send(&asked(99, Request::Stop), &[]);
    robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    let (mut samples, mut told) = (0_u64, 0);
    while told == 0 {
        let (reply, body) = slow.next().unwrap();
        if let Reply::Sample { dropped, .. } = reply {
            assert!(!body.is_empty());
            samples += 1;
            told = told.max(dropped);
        }
        assert!(samples < 1_000_000);
    }
}

/// Processor time of a process, s.
fn busy_s(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

/// Without a free descriptor the gateway serves those that are connected, keeps the robot, and waits without turning.
#[test]
fn three_hundred_connections_without_descriptors_change_nothing_for_those_who_are_there() {
    let mut robot = Robot::up("");
    robot.arm();
    let mut gateway = Gateway::joined(&robot, OWNER);
    let mut honest = gateway.client();
    let pid = gateway.child.id();
    let open = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count() as u64;
    let limit = rustix::process::Rlimit { current: Some(open + 3), maximum: Some(open + 3) };
    let process = rustix::process::Pid::from_child(&gateway.child);
    rustix::process::prlimit(Some(process), rustix::process::Resource::Nofile, limit).unwrap();
    let crowd: Vec<UnixStream> = (0..300).filter_map(|_| UnixStream::connect(&gateway.socket).ok()).collect();
    assert_eq!(crowd.len(), 300);
    let (before_s, begun_ns) = (busy_s(pid), clock::now_ns());
    for _ in 0..40 {
        assert!(matches!(honest.call(&Call::Robot { id: 1 }), Reply::Robot { robot: Some(_), .. }));
        assert_eq!(honest.ask(Request::Hold).1, Accepted::Accepted);
        std::thread::sleep(Duration::from_millis(100));
    }
    // A process that turns takes whole seconds of these.
    let share = (busy_s(pid) - before_s) / ((clock::now_ns() - begun_ns) as f64 * 1e-9);
    assert!(share < 0.25, "{share} of a processor for forty answers");
    assert!(gateway.lives());
    drop(crowd);
    gateway.until("a newcomer is served", |gateway| {
        let mut client = Client::raw(&gateway.socket);
        let hello = Call::Hello { version: VERSION, origin: Origin::Python, token: None, from: None };
        // It may still be closed.
        let _ = client.stream.write_all(&encode(&hello.header().unwrap(), &[]));
        matches!(client.next(), Some((Reply::Welcome { .. }, _)))
    });
    assert_eq!(honest.ask(Request::Stop).1, Accepted::Accepted);
}

fn asked(id: u64, request: Request) -> Call {
    Call::Ask { id, request, process: None, held: false, at_ns: None, pressed_ns: None }
}

/// Whatever was requested before a stop, the robot does not move after it.
#[test]
fn a_motion_that_was_requested_before_a_stop_never_begins_after_it() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.arm();
        robot.ask("motor-io", Request::ZeroAt { position_m: START });
        let gateway = Gateway::joined(&robot, OWNER);
        let mut client = gateway.client();
        let stops = [Request::Stop, Request::Hold, Request::Pause];
        // The planner takes them up only after the stop.
        for stop in &stops {
            robot.signal("planner", Signal::STOP);
            let late = Request::Goto { to_m: crate::robot::GOAL, path: GotoPath::Line, speed_m_s: Some(0.1) };
            client.send(&asked(1, late), &[]);
            // Sent to the planner, which does not answer.
            std::thread::sleep(Duration::from_millis(200));
            client.send(&asked(2, stop.clone()), &[]);
            let mut answers = Vec::new();
            while answers.len() < 2 {
                let Some((Reply::Answer { id, reason, accepted, .. }, _)) = client.next() else { panic!() };
                answers.push((id, reason, accepted));
                if id == 2 {
                    robot.signal("planner", Signal::CONT);
                }
            }
            answers.sort_by_key(|(id, ..)| *id);
            assert_eq!((answers[0].1, answers[1].2), (475, Accepted::Accepted), "{answers:?}");
            for _ in 0..20 {
                robot.for_cycles(5);
                assert_eq!(robot.last.mode, MotorAuthority::MODE_HOLDING, "{stop:?}");
            }
        }
        for round in 0..30_usize {
            let frame = |id, request| encode(&asked(id, request).header().unwrap(), &[]);
            let mut bytes = Vec::new();
            let motions = 1 + round % 4;
            for id in 0..motions {
                let target = [START[0] + 0.3, START[1], START[2] + 0.1 * (1 + id) as f64];
                let motion = match round % 5 {
                    4 => Request::Jog { cable: 1, distance_m: 0.02 },
                    _ => Request::Goto { to_m: target, path: GotoPath::Line, speed_m_s: Some(0.1) },
                };
                bytes.extend(frame(id as u64, motion));
            }
            client.stream.write_all(&bytes).unwrap();
            // While they wait, while they are planned, or when they have begun.
            std::thread::sleep(Duration::from_millis(round as u64));
            client.stream.write_all(&frame(50, stops[round % 3].clone())).unwrap();
            let mut answers = 0;
            while answers <= motions {
                let Some((Reply::Answer { id, accepted, sentence, .. }, _)) = client.next() else { panic!() };
                assert!(id != 50 || accepted == Accepted::Accepted, "{sentence}");
                answers += 1;
            }
            // A motion that began before the stop comes to rest; then none begins.
            robot.for_cycles(3);
            robot.until("at rest", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            for _ in 0..10 {
                robot.for_cycles(5);
                assert_eq!(robot.last.mode, MotorAuthority::MODE_HOLDING, "round {round}");
            }
            // Drops one that was paused.
            assert_eq!(client.ask(Request::Stop).1, Accepted::Accepted);
        }
    });
}

#[test]
fn a_stop_needs_no_place_that_others_can_take() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    robot.fly();
    // Every place of motor-io's clients that is left.
    let mut held = Vec::new();
    let buses: Vec<bus::Bus> =
        (0..40).map(|i| bus::Bus::join(&robot.domain, &format!("greedy-{i}")).unwrap()).collect();
    for bus in &buses {
        held.extend(bus.client("motor-io").ok());
    }
    assert!(held.len() < 40, "there is a place for each: {}", held.len());
    let mut client = gateway.client();
    assert_eq!(client.ask(Request::Stop).1, Accepted::Accepted);
    assert_eq!(client.ask(Request::Estop).1, Accepted::Accepted);
    robot.until("emergency stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
}
