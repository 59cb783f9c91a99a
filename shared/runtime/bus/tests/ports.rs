//! Ports within one process: delivery, losses, rejections, and allocations.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;

use bus::clock::now_ns;
use bus::{Bus, BusError, CHANNELS_EVENT, ChannelWatch, Domain, PlaceKind};
use messages::{
    Field, Header, Heartbeat, Message, MotorState, NodeEstimate, OperatorRequest, PlanMotion, Request, put_text,
    text_of,
};

/// An allocator that counts the allocations of each thread.
struct Counting;
thread_local!(static ALLOCATIONS: Cell<u64> = const { Cell::new(0) });

// SAFETY: all calls are forwarded to the system's allocator; counting does not allocate.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn soon() -> Option<u64> {
    Some(now_ns() + 2_000_000_000)
}

#[test]
fn a_sample_arrives_whole_and_in_order() {
    let domain = Domain::for_test();
    let (one, two) = (Bus::join(&domain, "one").unwrap(), Bus::join(&domain, "two").unwrap());
    let mut subscriber = two.subscriber::<MotorState>("motor/state").unwrap();
    let mut publisher = one.publisher::<MotorState>("motor/state").unwrap();
    assert!(subscriber.receive().unwrap().is_none());
    for k in 1..=20_u64 {
        let mut sample = MotorState { counts: [k as i64; 8], ..Default::default() };
        sample.header.cycle = k;
        assert_eq!(publisher.send(&mut sample).unwrap(), 1);
        assert_eq!(sample.header.seq, k);
    }
    for k in 1..=20_u64 {
        let sample = subscriber.receive().unwrap().unwrap();
        assert_eq!((sample.header.seq, sample.header.cycle, sample.counts), (k, k, [k as i64; 8]));
    }
    assert!(subscriber.receive().unwrap().is_none());
    assert_eq!((subscriber.lost(), subscriber.received()), (0, 20));
}

#[test]
fn a_slow_subscriber_loses_the_oldest_samples_and_counts_them() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let buffer = messages::quality_of("system/heartbeat/x").buffer as u64;
    let mut publisher = bus.publisher::<Heartbeat>("system/heartbeat/x").unwrap();
    let mut subscriber = bus.deep_subscriber::<Heartbeat>("system/heartbeat/x").unwrap();
    let mut send = |count: u64| (0..count).for_each(|_| assert!(publisher.send(&mut Heartbeat::default()).is_ok()));
    send(3);
    assert_eq!(subscriber.latest().unwrap().unwrap().header.seq, 3);
    send(buffer + 17);
    let first = subscriber.receive().unwrap().unwrap();
    assert_eq!((first.header.seq, subscriber.lost(), subscriber.gaps()), (3 + 17 + 1, 17, 1));
    while subscriber.receive().unwrap().is_some() {}
    assert_eq!((subscriber.lost(), subscriber.received()), (17, 3 + buffer));
}

#[test]
fn the_newest_sample_is_received_once_however_many_were_published() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut publisher = bus.publisher::<MotorState>("motor/state").unwrap();
    let mut send = |count: u64| (0..count).for_each(|_| assert!(publisher.send(&mut MotorState::default()).is_ok()));
    send(2);
    let mut newest = bus.newest::<MotorState>("motor/state").unwrap();
    let mut seq = || newest.latest().unwrap().map(|state| state.header.seq);
    for (count, expected) in [(1, Some(3)), (0, None), (1, Some(4)), (2000, Some(2004)), (0, None), (7, Some(2011))] {
        send(count);
        assert_eq!(seq(), expected, "after {count} samples");
    }
    let mut whole = bus.subscriber::<MotorState>("motor/state").unwrap();
    send(3);
    assert_eq!((seq(), whole.latest().unwrap().map(|state| state.header.seq)), (Some(2014), Some(2014)));
}

#[test]
fn a_late_subscriber_receives_the_history_and_counts_no_loss() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut publisher = bus.publisher::<PlanMotion>("plan/motion").unwrap();
    for _ in 0..10 {
        publisher.send(&mut PlanMotion::default()).unwrap();
    }
    let mut subscriber = bus.subscriber::<PlanMotion>("plan/motion").unwrap();
    publisher.update_connections();
    let history = messages::quality_of("plan/motion").late as u64;
    for k in 10 - history + 1..=10 {
        assert_eq!(subscriber.receive().unwrap().unwrap().header.seq, k);
    }
    assert!(subscriber.receive().unwrap().is_none());
    assert_eq!(subscriber.lost(), 0);
}

#[test]
fn receiving_and_waiting_allocate_nothing_and_sending_one_counter() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut publisher = bus.publisher::<MotorState>("motor/state").unwrap();
    let mut subscriber = bus.subscriber::<MotorState>("motor/state").unwrap();
    let mut waiter = bus.waiter(&["motor/state"]).unwrap();
    let mut sample = MotorState::default();
    let mut pass = || {
        let before = ALLOCATIONS.get();
        publisher.send(&mut sample).unwrap();
        let sent = ALLOCATIONS.get();
        assert!(waiter.wait_until(soon()).unwrap().channel(0));
        assert!(subscriber.receive().unwrap().is_some());
        assert!(subscriber.receive().unwrap().is_none());
        assert!(!waiter.wait_until(Some(0)).unwrap().woken());
        (sent - before, ALLOCATIONS.get() - sent)
    };
    (0..10).for_each(|_| _ = pass());
    for _ in 0..1000 {
        assert_eq!(pass(), (1, 0));
    }
}

#[test]
fn a_channel_with_one_publisher_rejects_a_second_one() {
    let domain = Domain::for_test();
    let (one, two) = (Bus::join(&domain, "motor-io").unwrap(), Bus::join(&domain, "intruder").unwrap());
    let first = one.publisher::<MotorState>("motor/state").unwrap();
    let error = two.publisher::<MotorState>("motor/state").unwrap_err();
    let BusError::Full { channel, limit: 1, what, .. } = &error else { panic!("{error}") };
    assert_eq!((channel.as_str(), *what), ("motor/state", PlaceKind::Publishers));
    drop(first);
    two.publisher::<MotorState>("motor/state").unwrap();
}

#[test]
fn another_type_on_a_channel_is_an_error_of_one_sentence() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let _publisher = bus.publisher::<MotorState>("motor/state").unwrap();
    let error = bus.subscriber::<NodeEstimate>("motor/state").unwrap_err();
    let BusError::TypeMismatch { found, wanted, .. } = &error else { panic!("{error}") };
    assert_eq!((found.as_str(), wanted.as_str()), (MotorState::type_name(), NodeEstimate::type_name()));
    assert_eq!(error.to_string().lines().count(), 1);
    // The sentence names the cure: another name for a changed sensor.
    let _sensor = bus.publisher::<messages::Reading>("sensor/soil").unwrap();
    let error = bus.publisher::<Heartbeat>("sensor/soil").unwrap_err().to_string();
    assert!(error.contains("`soil-2`") && error.lines().count() == 1, "{error}");
}

#[test]
fn invalid_names_are_rejected() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    for name in ["", "/motor", "motor//state", "Motor/State", "motor/stäte", "motor state", &"x/".repeat(40)] {
        assert!(matches!(bus.publisher::<MotorState>(name), Err(BusError::ChannelName { .. })), "{name}");
    }
    for name in ["", "a_b", "a/b", "a-name-that-is-too-long", "ü", "a b", "."] {
        assert!(matches!(Domain::new(name), Err(BusError::DomainName { .. })), "{name}");
    }
    assert!(matches!(Domain::parse(&format!("/dev/shm/{}", "x".repeat(80))), Err(BusError::DomainName { .. })));
    assert!(matches!(Domain::parse("/proc/nims"), Err(BusError::DomainFolder { .. })));
    assert!(matches!(Bus::join(&domain, &"x".repeat(70)), Err(BusError::Join { .. })));
}

#[test]
fn a_tap_receives_the_bytes_of_the_sample() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    assert!(matches!(bus.tap("node/estimate/a"), Err(BusError::NoChannel { .. })));
    let mut publisher = bus.publisher::<NodeEstimate>("node/estimate/a").unwrap();
    let mut tap = bus.tap("node/estimate/a").unwrap();
    let info = tap.info().clone();
    assert_eq!(info.type_name, NodeEstimate::type_name());
    assert_eq!(info.schema.as_deref(), Some(NodeEstimate::schema()));
    assert_eq!(info.size, size_of::<NodeEstimate>());
    assert_eq!(bus.ports("node/estimate/a").unwrap(), (1, 1));
    let own = std::process::id();
    assert_eq!(bus.publishers("node/estimate/a").unwrap().iter().map(|(_, pid)| *pid).collect::<Vec<_>>(), [own]);
    assert_eq!(bus.ends("node/estimate/a").unwrap(), (bus.publishers("node/estimate/a").unwrap(), vec![own]));
    let mut sample = NodeEstimate { position_m: [1.0, -2.0, f64::NAN], ..Default::default() };
    (sample.header.cycle, sample.header.stamp_ns) = (77, 123);
    publisher.send(&mut sample).unwrap();
    let seen = tap
        .receive(|raw| {
            assert_eq!((raw.header.seq, raw.header.cycle, raw.header.stamp_ns), (1, 77, 123));
            raw.bytes.to_vec()
        })
        .unwrap()
        .unwrap();
    assert_eq!(seen, bytemuck::bytes_of(&sample));
    assert!(tap.receive(|_| ()).unwrap().is_none());
}

#[test]
fn samples_without_sequence_numbers_cause_no_losses() {
    use messages::ros::PoseStamped;
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut poses = bus.publisher::<PoseStamped>("visualization/pose").unwrap();
    let mut states = bus.publisher::<MotorState>("motor/state").unwrap();
    let (mut without, mut with) = (bus.tap("visualization/pose").unwrap(), bus.tap("motor/state").unwrap());
    assert!(with.has_header() && !without.has_header());
    // The bytes where the header would have its sequence number vary.
    for content in [1, 100, 3, 200] {
        poses.send(&mut PoseStamped::from_body(&[content; 72]).unwrap()).unwrap();
        states.send(&mut MotorState::default()).unwrap();
    }
    let mut received = 0;
    while without.receive(|raw| assert_eq!((raw.missing, raw.header.seq), (0, 0))).unwrap().is_some() {
        received += 1;
    }
    assert_eq!((received, without.lost(), without.gaps()), (4, 0, 0));
    while with.receive(|raw| assert_ne!(raw.header.seq, 0)).unwrap().is_some() {}
    assert_eq!(with.lost(), 0);
}

#[test]
fn a_new_channel_is_announced() {
    let domain = Domain::for_test();
    let recorder = Bus::join(&domain, "recorder").unwrap();
    let mut waiter = recorder.waiter(&[CHANNELS_EVENT]).unwrap();
    let mut watch = ChannelWatch::new();
    assert!(watch.new_channels(&recorder).unwrap().is_empty());
    let other = Bus::join(&domain, "wind").unwrap();
    let publisher = other.publisher::<messages::Reading>("sensor/wind").unwrap();
    assert!(waiter.wait_until(soon()).unwrap().channel(0));
    let new = watch.new_channels(&recorder).unwrap();
    assert_eq!(new.len(), 1);
    assert_eq!((new[0].name.as_str(), new[0].holders[0].name.as_str()), ("sensor/wind", "wind"));
    assert!(watch.new_channels(&recorder).unwrap().is_empty());
    drop(publisher);
    drop(other);
    assert!(watch.new_channels(&recorder).unwrap().is_empty());
    let _again = recorder.publisher::<Heartbeat>("sensor/wind").unwrap();
    assert_eq!(
        watch.new_channels(&recorder).unwrap()[0].type_name,
        Heartbeat::type_name(),
        "created again with another type"
    );
}

/// More processes than a channel has places, each with a channel of its own and a long schema text.
#[test]
fn every_process_of_a_crowd_announces_its_channel() {
    let domain = Domain::for_test();
    let recorder = Bus::join(&domain, "recorder").unwrap();
    let mut waiter = recorder.waiter(&[CHANNELS_EVENT]).unwrap();
    let mut watch = ChannelWatch::new();
    let mut crowd = Vec::new();
    for number in 0..100 {
        let process = Bus::join(&domain, &format!("s{number}")).unwrap();
        let name = format!("system/config/s{number}");
        let publisher = process.publisher::<messages::SystemConfig>(&name).unwrap();
        assert!(waiter.wait_until(soon()).unwrap().channel(0), "{name}");
        let new = watch.new_channels(&recorder).unwrap();
        assert!(new.len() == 1 && new[0].name == name && new[0].schema.is_some(), "{new:?}");
        crowd.push((process, publisher));
    }
    drop(crowd);
}

#[test]
fn a_late_subscriber_receives_every_row_of_a_table() {
    const ROWS: u32 = 300;
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut table = bus.publisher::<messages::ProcessState>("system/process").unwrap();
    for pid in 0..ROWS {
        table.send(&mut messages::ProcessState { pid, ..Default::default() }).unwrap();
    }
    let mut subscriber = bus.subscriber::<messages::ProcessState>("system/process").unwrap();
    table.update_connections();
    let pids: Vec<u32> = std::iter::from_fn(|| subscriber.receive().unwrap()).map(|row| row.pid).collect();
    assert_eq!(pids, (0..ROWS).collect::<Vec<_>>());
}

#[test]
fn a_waiter_wakes_only_for_ready_channels_and_descriptors() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut waiter = bus.waiter(&["motor/state", "plan/motion"]).unwrap();
    let (reader, writer) = rustix::pipe::pipe().unwrap();
    assert_eq!(waiter.attach(reader).unwrap(), 0);
    let deadline = now_ns() + 3_000_000;
    assert!(!waiter.wait_until(Some(deadline)).unwrap().woken());
    assert!(now_ns() >= deadline, "woke before the deadline");
    bus.publisher::<PlanMotion>("plan/motion").unwrap().send(&mut PlanMotion::default()).unwrap();
    let wake = waiter.wait_until(soon()).unwrap();
    assert!(!wake.channel(0) && wake.channel(1) && !wake.descriptor(0));
    rustix::io::write(&writer, b"x").unwrap();
    let wake = waiter.wait_until(None).unwrap();
    assert!(!wake.channel(1) && wake.descriptor(0));
}

#[test]
fn requests_are_answered_and_published() {
    let domain = Domain::for_test();
    let process = Bus::join(&domain, "motor-io").unwrap();
    let mut log = process.subscriber::<OperatorRequest>("operator/request").unwrap();
    let mut server = process.server("motor-io").unwrap();
    assert!(matches!(process.server("motor-io"), Err(BusError::Full { .. })));
    let asking = std::thread::spawn({
        let domain = Domain::parse(domain.name()).unwrap();
        move || {
            let bus = Bus::join(&domain, "nims").unwrap();
            let mut client = bus.client("motor-io").unwrap();
            let request = Request::Jog { cable: 2, distance_m: 2.0 }.encode().unwrap();
            let answer = client.ask(&request, Duration::from_secs(5)).unwrap();
            assert_eq!((answer.answered, answer.body), (1, request.body));
            assert_eq!(answer.accepted, OperatorRequest::BAD_INPUT);
            assert_ne!(answer.id, 0);
            text_of(&answer.answer)
        }
    });
    let mut waiter = process.waiter(&[server.event()]).unwrap();
    let call = loop {
        if let Some(call) = server.try_next().unwrap() {
            break call;
        }
        waiter.wait_until(soon()).unwrap();
    };
    assert_eq!(Request::decode(&call.request), Ok(Request::Jog { cable: 2, distance_m: 2.0 }));
    assert!(call.is_awaited());
    call.answer(&answer(OperatorRequest::BAD_INPUT, "cable 2 is at its end: jog the other way")).unwrap();
    assert_eq!(asking.join().unwrap(), "cable 2 is at its end: jog the other way");
    let (asked, answered) = (log.receive().unwrap().unwrap(), log.receive().unwrap().unwrap());
    assert_eq!((asked.answered, answered.answered, asked.id), (0, 1, answered.id));
    assert_eq!((asked.pid, asked.uid), (std::process::id(), rustix::process::geteuid().as_raw()));
    assert_eq!(text_of(&asked.requester), text_of(&answered.requester));
    assert!(!text_of(&asked.requester).is_empty());
}

#[test]
fn a_missing_server_is_an_error_at_once_and_a_silent_one_after_the_timeout() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "nims").unwrap();
    let mut client = bus.client("planner").unwrap();
    let mut request = OperatorRequest::default();
    put_text(&mut request.text, "missions/spiral.toml");
    let error = client.ask(&request, Duration::from_secs(60)).unwrap_err();
    assert!(matches!(error, BusError::NoServer { .. }), "{error}");
    let mut server = bus.server("planner").unwrap();
    let error = client.ask(&request, Duration::from_millis(20)).unwrap_err();
    assert!(matches!(error, BusError::NoAnswer { .. }), "{error}");
    // The timed-out request is withdrawn, or its answer is dropped; the next request works.
    while let Some(call) = server.try_next().unwrap() {
        assert!(!call.is_awaited());
        call.answer(&answer(OperatorRequest::ACCEPTED, "too late")).unwrap();
    }
    drop(server);
    assert!(matches!(client.ask(&request, Duration::from_secs(60)), Err(BusError::NoServer { .. })));
}

#[test]
fn domains_are_isolated() {
    let (here, there) = (Domain::for_test(), Domain::for_test());
    let (one, two) = (Bus::join(&here, "x").unwrap(), Bus::join(&there, "x").unwrap());
    let mut publisher = one.publisher::<MotorState>("motor/state").unwrap();
    let mut subscriber = two.subscriber::<MotorState>("motor/state").unwrap();
    assert_eq!(publisher.send(&mut MotorState::default()).unwrap(), 0);
    assert!(subscriber.receive().unwrap().is_none());
    assert_eq!(here.alive().len(), 1);
}

#[test]
fn a_domain_has_one_owner() {
    let domain = Domain::for_test();
    let claim = domain.claim().unwrap();
    let error = domain.claim().unwrap_err();
    assert!(matches!(&error, BusError::Claimed { pid, .. } if *pid == std::process::id()), "{error}");
    drop(claim);
    let _claim = domain.claim().unwrap();
    assert_eq!(domain.sweep().unwrap(), bus::SweepReport::default());
}

#[test]
fn a_removed_test_domain_leaves_nothing() {
    let (root, prefix);
    {
        let domain = Domain::for_test();
        (root, prefix) = (domain.root().to_owned(), domain.prefix().to_owned());
        let bus = Bus::join(&domain, "test").unwrap();
        let _publisher = bus.publisher::<MotorState>("motor/state").unwrap();
    }
    assert!(!root.exists());
    let left = std::fs::read_dir("/dev/shm")
        .unwrap()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
    assert_eq!(left.count(), 0);
}

/// A type whose schema text is far longer than the attributes of a channel, with this comment behind each field.
macro_rules! long {
    ($name:ident, $comment:literal) => {
        #[repr(C)]
        #[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
        struct $name {
            header: Header,
            numbers: [f32; 300],
        }

        impl Field for $name {
            type Element = Self;
            const ROS: &'static str = "my_lab/Long";
        }

        impl Message for $name {
            const NAME: &'static str = "Long";
            fn schema() -> &'static str {
                static TEXT: std::sync::OnceLock<String> = std::sync::OnceLock::new();
                TEXT.get_or_init(|| {
                    let fields: String =
                        (0..300).map(|at| format!("float32 concentration_{at:03}{}\n", $comment)).collect();
                    let head: String = ["life", "cycle", "seq", "stamp_ns", "published_ns", "oldest_input_ns"]
                        .map(|name| format!("uint64 {name}\n"))
                        .concat();
                    format!("nims_msgs/Header header\n{fields}{}\nMSG: nims_msgs/Header\n{head}", "=".repeat(80))
                })
            }
            fn type_name() -> &'static str {
                "my_lab/Long/00000001"
            }
            fn header(&self) -> &Header {
                &self.header
            }
            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }
    };
}

long!(Long, "");
long!(LongInOtherWords, " # in ppm");

/// Two builds that explain a type in other words share its channel, and the words of its creator stay with it.
#[test]
fn two_builds_with_other_comments_share_a_channel() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let text = || bus.channel("sensor/gas").unwrap().and_then(|info| info.schema);
    let sensor = Bus::join(&domain, "sensor").unwrap();
    let mut publisher = sensor.publisher::<LongInOtherWords>("sensor/gas").unwrap();
    let logger = Bus::join(&domain, "logger").unwrap();
    let mut subscriber = logger.subscriber::<Long>("sensor/gas").unwrap();
    publisher.send(&mut LongInOtherWords { numbers: [2.5; 300], ..bytemuck::Zeroable::zeroed() }).unwrap();
    assert_eq!(subscriber.latest().unwrap().unwrap().numbers, [2.5; 300]);
    assert_eq!(text().as_deref(), Some(LongInOtherWords::schema()));
    drop((publisher, sensor));
    assert_eq!(text().as_deref(), Some(LongInOtherWords::schema()), "its creator has ended");
}

/// The definition of a type of this build travels without its comments, and is read with them.
#[test]
fn a_known_type_is_read_with_its_documentation() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let _publisher = bus.publisher::<MotorState>("motor/state").unwrap();
    let text = bus.channel("motor/state").unwrap().unwrap().schema.unwrap();
    assert_eq!(text, MotorState::schema());
    assert!(text.contains("\n# "), "{text}");
}

#[test]
fn a_long_schema_can_be_read_as_long_as_the_channel_is_open() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    assert!(Long::schema().len() > 7_000);
    let whole = |name: &str| bus.channel(name).unwrap().and_then(|info| info.schema).as_deref() == Some(Long::schema());
    let sensor = Bus::join(&domain, "sensor").unwrap();
    let _publisher = sensor.publisher::<Long>("sensor/gas").unwrap();
    assert!(whole("sensor/gas"), "read by a process that does not know the type");
    assert_eq!(bus.tap("sensor/gas").unwrap().info().schema.as_deref(), Some(Long::schema()));
    let logger = Bus::join(&domain, "logger").unwrap();
    let subscriber = logger.subscriber::<Long>("sensor/gas").unwrap();
    drop((_publisher, sensor));
    assert!(whole("sensor/gas"), "its creator has ended");
    let tap = bus.tap("sensor/gas").unwrap();
    drop((subscriber, logger));
    let again = Bus::join(&domain, "sensor").unwrap();
    let _publisher = again.publisher::<Long>("sensor/gas").unwrap();
    assert!(whole("sensor/gas"), "the channel was open only in a process that does not know the type");
    drop(tap);
}

#[test]
fn a_tap_with_history_receives_all_stored_samples() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut publisher = bus.publisher::<MotorState>("motor/state").unwrap();
    let history = messages::quality_of("motor/state").history as u64;
    for _ in 0..history + 10 {
        publisher.send(&mut MotorState::default()).unwrap();
    }
    let (mut few, mut all) = (bus.tap("motor/state").unwrap(), bus.tap_with_history("motor/state").unwrap());
    publisher.update_connections();
    let mut numbers = Vec::new();
    while let Some(seq) = all.receive(|raw| raw.header.seq).unwrap() {
        numbers.push(seq);
    }
    assert_eq!(numbers, (11..=history + 10).collect::<Vec<_>>());
    assert_eq!(few.receive(|raw| raw.header.seq).unwrap(), Some(history + 10));
    assert_eq!((all.lost(), few.lost()), (0, 0));
}

/// An answer without a reason of the catalogue.
fn answer(accepted: u8, text: &str) -> messages::RequestAnswer {
    let mut answer = messages::RequestAnswer { accepted, ..Default::default() };
    messages::put_text(&mut answer.text, text);
    answer
}
