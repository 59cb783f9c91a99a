//! Exhausted shared memory, and exhausted places of channels.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fs::File;
use std::os::unix::process::ExitStatusExt;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bus::{Bus, BusError, Client, Domain, Participant, Subscriber, THIS_PROCESS, Tap};
use messages::{LogEvent, MotorState, Quality, Request, quality_of};
use rustix::fs::{FallocateFlags, fallocate, statvfs};

const STATE: &str = "motor/state";
/// Environment variable that is set in a process with its own /dev/shm.
const OWN: &str = "NIMS_TEST_OWN_SHARED_MEMORY";

#[test]
fn created_objects_have_all_their_memory() {
    let domain = Domain::for_test();
    let [motor, recorder, other] = ["motor-io", "recorder", "other"].map(|name| Bus::join(&domain, name).unwrap());
    let mut publisher = motor.publisher::<MotorState>(STATE).unwrap();
    let _server = motor.server("motor-io").unwrap();
    let _log = motor.publisher::<LogEvent>("system/log/motor-io").unwrap();
    assert_eq!(domain.memory().unreserved, 0);
    // Later peers, and the next sample, create connections.
    let mut all = recorder.tap_with_history(STATE).unwrap();
    let mut some = other.subscriber::<MotorState>(STATE).unwrap();
    let (_client, _waiter) = (other.client("motor-io").unwrap(), other.waiter(&[STATE]).unwrap());
    for _ in 0..3 {
        publisher.send(&mut MotorState::default()).unwrap();
    }
    assert!(all.receive(|_| ()).unwrap().is_some() && some.receive().unwrap().is_some());
    let memory = domain.memory();
    assert_eq!(memory.unreserved, 0);
    assert!(memory.used > 0 && memory.used < 4_000_000, "{memory:?}");
}

#[test]
fn a_publisher_always_has_a_free_sample() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "motor-io").unwrap();
    let mut publisher = bus.publisher::<MotorState>(STATE).unwrap();
    let (mut deep, mut shallow): (Vec<Tap>, Vec<Subscriber<MotorState>>) = (Vec::new(), Vec::new());
    let mut random = 1_u64;
    for _ in 0..6_000 {
        publisher.send(&mut MotorState::default()).unwrap();
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let choice = (random >> 33) as usize;
        match choice % 16 {
            0 if deep.len() < Quality::DEEP_PLACES => deep.push(bus.tap_with_history(STATE).unwrap()),
            1 if shallow.len() + Quality::DEEP_PLACES < quality_of(STATE).subscribers => {
                shallow.push(bus.subscriber(STATE).unwrap());
            }
            2 if choice.is_multiple_of(5) => drop(deep.pop()),
            3 if choice.is_multiple_of(5) => drop(shallow.pop()),
            4 if !deep.is_empty() => {
                let place = choice % deep.len();
                while deep[place].receive(|_| ()).unwrap().is_some() {}
            }
            5..8 if !shallow.is_empty() => {
                let place = choice % shallow.len();
                shallow[place].receive().unwrap();
            }
            _ => {}
        }
    }
    // Each subscriber receives the newest samples, as many as its buffer holds.
    let newest = publisher.seq();
    for tap in &mut deep {
        let mut last = None;
        while let Some(seq) = tap.receive(|raw| raw.header.seq).unwrap() {
            last = Some(seq);
        }
        assert!(last.is_none_or(|seq| seq == newest));
    }
}

#[test]
fn observers_and_commands_leave_places_to_the_robot() {
    let domain = Domain::for_test();
    let limit = quality_of(STATE).subscribers;
    let bus = |party| Bus::join_as(&domain, "x", party).unwrap();
    let _publisher = bus(Participant::Member).publisher::<MotorState>(STATE).unwrap();
    let guests = bus(Participant::Guest);
    let looking: Vec<Tap> = (0..limit).map_while(|_| guests.tap(STATE).ok()).collect();
    assert_eq!(looking.len(), Participant::Guest.ceiling(limit));
    assert!(matches!(guests.subscriber::<MotorState>(STATE), Err(BusError::Full { .. })));
    // Without the reserved places, nine observers left none to `nims status`.
    let commands = bus(Participant::Command);
    let commanding: Vec<_> = (0..limit).map_while(|_| commands.subscriber::<MotorState>(STATE).ok()).collect();
    assert_eq!(commanding.len() + looking.len(), Participant::Command.ceiling(limit));
    let members = bus(Participant::Member);
    let controlling: Vec<_> = (0..limit).map_while(|_| members.subscriber::<MotorState>(STATE).ok()).collect();
    assert_eq!(controlling.len() + commanding.len() + looking.len(), limit);
    // The same applies to notifiers, listeners and clients.
    let _server = members.server("motor-io").unwrap();
    let clients: Vec<Client> = (0..100).map_while(|_| commands.client("motor-io").ok()).collect();
    assert!(clients.len() >= 8, "{}", clients.len());
    let refused = |error: BusError| matches!(&error, BusError::Full { holders, .. } if holders == THIS_PROCESS);
    assert!(commands.client("motor-io").is_err_and(refused), "the error names the clients");
    members.client("motor-io").expect("a place for a command that stops the robot");
    let waiting: Vec<_> = (0..100).map_while(|_| guests.waiter(&[STATE]).ok()).collect();
    assert!(waiting.len() >= 8 && members.waiter(&[STATE]).is_ok(), "{}", waiting.len());
    assert!(guests.waiter(&[STATE]).is_err_and(refused), "the error names the listeners");
}

#[test]
fn a_channel_has_a_few_deep_subscribers_and_all_others_are_shallow() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "x").unwrap();
    let mut publisher = bus.publisher::<MotorState>(STATE).unwrap();
    let mut deep: Vec<_> = (0..10).map_while(|_| bus.deep_subscriber::<MotorState>(STATE).ok()).collect();
    assert_eq!(deep.len(), Quality::DEEP_PLACES);
    assert!(matches!(bus.tap_with_history(STATE), Err(BusError::Full { .. })));
    let mut shallow = bus.subscriber::<MotorState>(STATE).unwrap();
    for _ in 0..100 {
        publisher.send(&mut MotorState::default()).unwrap();
    }
    let count = |subscriber: &mut Subscriber<MotorState>| std::iter::from_fn(|| subscriber.receive().unwrap()).count();
    assert_eq!(count(&mut deep[0]), 100);
    assert_eq!(count(&mut shallow), Quality::SHALLOW);
}

/// Runs one test of this file again in a process with its own /dev/shm of this size, and checks that no signal ends it.
/// Returns false, with a note, if this user cannot start such a process.
fn with_shared_memory(size: &str, test: &str) -> bool {
    let mount = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm");
    let unshare = |command: &str| {
        let mut unshare = Command::new("unshare");
        unshare.args(["--mount", "--map-root-user", "sh", "-c", command]);
        unshare
    };
    if !unshare(&mount).output().is_ok_and(|tried| tried.status.success()) {
        notes::left_out("full shared memory", "this user cannot mount a /dev/shm (unshare --mount --map-root-user)");
        return false;
    }
    let program = std::env::current_exe().unwrap();
    let status = unshare(&format!("{mount} && exec \"$0\" --exact --nocapture {test}"))
        .arg(program)
        .env(OWN, "1")
        .status()
        .unwrap();
    assert_eq!(status.signal(), None, "{test} was killed");
    assert!(status.success(), "{test}: {status}");
    true
}

/// Allocates all free shared memory except `but` bytes.
fn fill(file: &File, but: u64) {
    let room = statvfs("/dev/shm").unwrap();
    let free = room.f_bavail * room.f_frsize;
    if free > but {
        let _ = fallocate(file, FallocateFlags::empty(), file.metadata().unwrap().len(), free - but);
    }
}

#[test]
fn without_memory_new_objects_are_rejected_and_existing_ones_still_work() {
    if std::env::var_os(OWN).is_none() {
        with_shared_memory("64m", "without_memory_new_objects_are_rejected_and_existing_ones_still_work");
        return;
    }
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "motor-io").unwrap();
    let mut publisher = bus.publisher::<MotorState>(STATE).unwrap();
    let mut subscriber = bus.deep_subscriber::<MotorState>(STATE).unwrap();
    let filler = File::create("/dev/shm/filler").unwrap();
    let files = || std::fs::read_dir("/dev/shm").unwrap().count();
    let guest = Bus::join_as(&domain, "guest", Participant::Guest).unwrap();
    fill(&filler, 3 << 20);
    let before = files();
    assert!(matches!(guest.tap(STATE), Err(BusError::NoMemory { .. })));
    assert!(matches!(Bus::join_as(&domain, "guest", Participant::Guest), Err(BusError::NoMemory { .. })));
    assert_eq!(files(), before);
    let _tap = bus.tap(STATE).expect("the robot's processes may use the margin");
    fill(&filler, 0);
    let before = files();
    assert!(matches!(bus.publisher::<LogEvent>("system/log/x"), Err(BusError::NoMemory { .. })));
    assert!(matches!(bus.subscriber::<MotorState>(STATE), Err(BusError::NoMemory { .. })));
    assert!(matches!(bus.client("motor-io"), Err(BusError::NoMemory { .. })));
    assert!(matches!(Bus::join(&domain, "other"), Err(BusError::NoMemory { .. })));
    assert_eq!(files(), before);
    // More samples than the channel stores, so that each of its pages is written.
    for _ in 0..2_000 {
        publisher.send(&mut MotorState::default()).unwrap();
    }
    assert_eq!(std::iter::from_fn(|| subscriber.receive().unwrap()).count(), quality_of(STATE).buffer);
    let request = Request::Estop.encode().unwrap();
    let mut emergency = bus::estop::Receiver::open(&domain).unwrap();
    let mut stands = messages::RequestAnswer { accepted: 1, reason: 70, ..Default::default() };
    messages::put_text(&mut stands.detail, "It stands.");
    let answer = std::thread::scope(|scope| {
        let asked = scope.spawn(|| bus::estop::send(&domain, &request, Duration::from_secs(20), Duration::ZERO, || ()));
        while emergency.receive().iter().map(|stop| emergency.answer(stop, &stands)).count() == 0 {}
        asked.join().unwrap()
    });
    assert_eq!(answer.unwrap().recorded_answer(), Some(stands));
}

/// A thread repeatedly fills and frees shared memory while channels are created and used.
#[test]
fn channels_are_created_a_thousand_times_while_memory_is_filled() {
    if std::env::var_os(OWN).is_none() {
        with_shared_memory("8m", "channels_are_created_a_thousand_times_while_memory_is_filled");
        return;
    }
    static DONE: AtomicBool = AtomicBool::new(false);
    let filler = std::thread::spawn(|| {
        let (file, mut random, mut fills) = (File::create("/dev/shm/filler").unwrap(), 7_u64, 0_u64);
        while !DONE.load(Ordering::Relaxed) {
            fill(&file, 0);
            fills += 1;
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            std::thread::sleep(Duration::from_micros(random >> 54));
            file.set_len(0).unwrap();
            std::thread::sleep(Duration::from_micros(random >> 53));
        }
        fills
    });
    let (mut made, mut cut_short, mut refused) = (0, 0, 0);
    while made + cut_short < 1_000 {
        match make_and_use(&Domain::for_test()) {
            Ok(()) => made += 1,
            Err(BusError::NoMemory { .. }) => {
                refused += 1;
                std::thread::sleep(Duration::from_micros(50));
            }
            Err(BusError::Failed { .. } | BusError::Join { .. } | BusError::Full { .. }) => cut_short += 1,
            Err(error) => panic!("{error}"),
        }
    }
    DONE.store(true, Ordering::Relaxed);
    let fills = filler.join().unwrap();
    eprintln!("{made} made, {cut_short} cut short, {refused} refused before; memory was filled {fills} times");
    assert!(made > 0 && refused > 0 && fills > 100);
}

fn make_and_use(domain: &Domain) -> Result<(), BusError> {
    let (one, two) = (Bus::join(domain, "one")?, Bus::join(domain, "two")?);
    let mut publisher = one.publisher::<MotorState>(STATE)?;
    let mut subscriber = two.deep_subscriber::<MotorState>(STATE)?;
    for _ in 0..700 {
        publisher.send(&mut MotorState::default())?;
    }
    let received = std::iter::from_fn(|| subscriber.receive().transpose()).count();
    assert!(received > 0, "two created ports are connected");
    Ok(())
}
