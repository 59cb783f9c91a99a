//! The number of processes of a robot, as its owner sets it, and the memory of their places.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use bus::clock::{SECOND_NS, now_ns};
use bus::{
    Bus, BusError, CHANNELS_EVENT, ChannelWatch, Domain, Participant, PlaceKind, Publisher, TestDomain, places_bytes,
};
use messages::ros::{MarkerArray, Payload};
use messages::{Heartbeat, MotorAuthority, MotorInput, PROCESSES, Reading};

fn domain_with(processes: usize) -> TestDomain {
    let domain = Domain::for_test();
    domain.set_processes(processes).unwrap();
    domain
}

/// Joins and announces a channel of its own, as each process of a robot does with its heartbeat.
fn join(domain: &Domain, name: &str) -> (Bus, Publisher<Heartbeat>) {
    let bus = Bus::join(domain, name).unwrap();
    let heartbeat = bus.publisher(&format!("system/heartbeat/{name}")).unwrap();
    (bus, heartbeat)
}

/// Joins so many processes.
fn join_all(domain: &Domain, processes: usize) -> Vec<(Bus, Publisher<Heartbeat>)> {
    (0..processes).map(|number| join(domain, &format!("p{number}"))).collect()
}

/// The number of processes for which the domain has places, as the first process in excess is told it.
fn full_at(domain: &Domain) -> usize {
    let (excess, _heartbeat) = join(domain, "excess");
    let error = excess.unannounced().expect("the robot is full");
    let BusError::Full { channel, limit, what: PlaceKind::RobotProcesses, .. } = error else { panic!("{error}") };
    assert_eq!(channel, CHANNELS_EVENT);
    let sentence = error.to_string();
    assert!([&limit.to_string(), "`processes`", "[bus]"].iter().all(|part| sentence.contains(part)), "{sentence}");
    *limit
}

/// Bytes that the first channel takes in addition to a second one of its type: what is created for both.
fn shared_bytes<T: Payload>(domain: &Domain, bus: &Bus, name: &str) -> u64 {
    let used = || domain.memory().used;
    let begin = used();
    let _first = bus.publisher::<T>(&format!("sensor/{name}-1")).unwrap();
    let between = used();
    let _second = bus.publisher::<T>(&format!("sensor/{name}-2")).unwrap();
    (between - begin) - (used() - between)
}

#[test]
fn the_stated_memory_is_that_of_the_files() {
    for processes in [1, 64, 500, PROCESSES, 4096] {
        let domain = domain_with(processes);
        let bus = Bus::join(&domain, "test").unwrap();
        // The first channel of a process also creates the event of new channels. A short definition is in its channel.
        let announcements = shared_bytes::<Reading>(&domain, &bus, "reading");
        assert_eq!(shared_bytes::<Reading>(&domain, &bus, "other"), 0);
        let definitions = shared_bytes::<MotorAuthority>(&domain, &bus, "authority")
            + shared_bytes::<MotorInput>(&domain, &bus, "input")
            + shared_bytes::<MarkerArray>(&domain, &bus, "markers");
        assert_eq!(announcements + definitions, places_bytes(processes), "{processes}");
        assert_eq!(domain.memory().unreserved, 0);
    }
}

/// 70 are more than the 64 places of another event.
#[test]
fn a_robot_has_as_many_places_as_its_owner_states() {
    for processes in [3, 70] {
        let domain = domain_with(processes);
        let all = join_all(&domain, processes);
        assert!(all.iter().all(|(bus, _)| bus.unannounced().is_none()), "{processes}");
        assert_eq!(full_at(&domain), processes);
        // The place of a process that ends is free again.
        drop(all);
        assert!(join(&domain, "next").0.unannounced().is_none());
    }
    assert_eq!(Domain::for_test().processes(), PROCESSES);
}

/// The recorder of a full robot, started again, finds channels by looking for them.
#[test]
fn a_process_in_excess_waits_without_the_event_of_new_channels() {
    let domain = domain_with(3);
    let all = join_all(&domain, 3);
    let (excess, _heartbeat) = join(&domain, "excess");
    let mut waiter = excess.waiter(&[CHANNELS_EVENT, "sensor/soil"]).unwrap();
    let full = waiter.deaf().expect("the robot is full");
    assert!(matches!(full, BusError::Full { limit: 3, what: PlaceKind::RobotProcesses, .. }), "{full}");
    let (reader, writer) = rustix::pipe::pipe().unwrap();
    assert_eq!(waiter.attach(reader).unwrap(), 0);

    let mut soil = all[0].0.publisher::<Reading>("sensor/soil").unwrap();
    let wake = waiter.wait_until(Some(now_ns() + SECOND_NS / 20)).unwrap();
    assert!(!wake.woken(), "a new channel does not wake it");
    let new = ChannelWatch::new().new_channels(&excess).unwrap();
    assert!(new.iter().any(|channel| channel.name == "sensor/soil"), "{new:?}");
    // The other channels and descriptors keep their numbers.
    soil.send(&mut Reading::default()).unwrap();
    let wake = waiter.wait_until(Some(now_ns() + 5 * SECOND_NS)).unwrap();
    assert!(!wake.channel(0) && wake.channel(1) && !wake.descriptor(0), "{wake:?}");
    rustix::io::write(&writer, b"x").unwrap();
    let wake = waiter.wait_until(Some(now_ns() + 5 * SECOND_NS)).unwrap();
    assert!(!wake.channel(0) && !wake.channel(1) && wake.descriptor(0), "{wake:?}");
    // One that has a place hears of them.
    assert!(all[0].0.waiter(&[CHANNELS_EVENT]).unwrap().deaf().is_none());
}

/// An observer may join while the owner starts: it reserves as many places as the owner has stated.
#[test]
fn the_stated_number_outlives_a_sweep() {
    let domain = domain_with(3);
    drop(join(&domain, "former"));
    assert!(domain.sweep().unwrap().files > 0);
    assert_eq!(domain.processes(), 3);
    let (observer, _heartbeat) = join(&domain, "observer");
    assert_eq!(observer.former_places(), None);
}

/// A long definition has a place for each process too. Without one its channel is refused at once, also for observers.
#[test]
fn a_definition_is_held_by_as_many_processes() {
    let domain = domain_with(3);
    let bus = |number: usize| Bus::join_as(&domain, &format!("p{number}"), Participant::Member).unwrap();
    let publish = |bus: &Bus, number: usize| bus.publisher::<MotorInput>(&format!("sensor/input-{number}"));
    let holders: Vec<_> = (0..3)
        .map(|number| {
            let bus = bus(number);
            let publisher = publish(&bus, number).unwrap();
            (bus, publisher)
        })
        .collect();
    let error = publish(&bus(3), 3).unwrap_err();
    assert!(matches!(error, BusError::Full { limit: 3, what: PlaceKind::RobotProcesses, .. }), "{error}");
    drop(holders);
    publish(&bus(4), 4).unwrap();
}

/// Programs read the number when they join: one that joined before it was stated, or after it was stated again, meets
/// what others have created.
#[test]
fn processes_that_joined_with_other_numbers_meet() {
    for (first, second) in [(None, 3), (None, 4096), (Some(3), PROCESSES), (Some(4096), 3)] {
        let domain = Domain::for_test();
        first.into_iter().for_each(|first| domain.set_processes(first).unwrap());
        let (early, _early) = join(&domain, "early");
        let _authority = early.publisher::<MotorAuthority>("motor/authority").unwrap();
        domain.set_processes(second).unwrap();
        let (late, _late) = join(&domain, "late");
        let former = late.former_places().expect("the places of the first one");
        assert_eq!((former.processes, former.stated), (first.unwrap_or(PROCESSES), second));
        assert_eq!(early.former_places(), None);
        let _waiter = late.waiter(&[CHANNELS_EVENT]).unwrap();
        let _authority = late.subscriber::<MotorAuthority>("motor/authority").unwrap();
        assert!(early.unannounced().is_none() && late.unannounced().is_none(), "{first:?} {second}");
        if first == Some(3) {
            let _third = join(&domain, "third");
            assert_eq!(full_at(&domain), 3, "the event has the places with which it was created");
        }
    }
}
