//! Sensors that declare messages of their own: who may, within what bounds, and with any bytes.

#![allow(clippy::unwrap_used, clippy::panic)]

use config::{GatewaySection, PluginSection};
use gateway::core::*;
use gateway::plugin::PluginUnit;
use gateway::roles::{Peer, Roles};
use gateway::tokens::Tokens;
use gateway_protocol::{Call, Origin, Published, ReadingQuality, Reply, VERSION, encode};
use messages::{Header, Message};
use proptest::collection::vec;
use proptest::prelude::*;

const OWNER: u32 = 900;
const SECOND: u64 = 1_000_000_000;
/// Not declared by this connection, not a message, another size.
const NOT_ASKED: u16 = 456;

messages::message! {
    /// A probe in the ground.
    pub struct Soil {
        header: Header,
        /// Water by volume, %.
        moisture_percent: f64,
    }
}

fn core() -> Core {
    let section = GatewaySection { publish: vec!["plugin".to_owned()], ..GatewaySection::default() };
    let roles = Roles::new(OWNER, section);
    let named = |name: &str| PluginSection { name: name.to_owned(), rate_hz: 4.0, ..PluginSection::default() };
    let word = |word: &str| vec![word.to_owned()];
    let air = PluginSection { quantity: word("speed"), unit: word("m/s"), ..named("air") };
    Core::new("lab".to_owned(), roles, Tokens::default()).with_plugins("lab", &[named("soil"), air])
}

fn connect(core: &mut Core, client: ClientId, user: &str, origin: Origin, unit: Option<&str>) {
    let uid = if user == "nims" { OWNER } else { 1000 + u32::from(user.as_bytes()[0]) };
    let unit = unit.map(|unit| PluginUnit::parse(unit).unwrap());
    let peer = Peer { uid, gid: uid, pid: 7, user: user.to_owned(), gids: vec![uid], unit, ..Peer::default() };
    core.step(0, Event::Connected { client, peer });
    let hello = Call::Hello { version: VERSION, origin, token: None, from: None };
    let bytes = encode(&hello.header().unwrap(), &[]);
    let actions = core.step(0, Event::Received { client, bytes: &bytes });
    assert!(matches!(&actions[..], [Action::Send { reply: Reply::Welcome { .. }, .. }]), "{actions:?}");
}

fn call(core: &mut Core, now_ns: u64, client: ClientId, call: &Call, body: &[u8]) -> Vec<Action> {
    let actions = core.step(now_ns, Event::Received { client, bytes: &encode(&call.header().unwrap(), body) });
    if let [Action::Declare { ticket, .. } | Action::PublishSample { ticket, .. }] = &actions[..] {
        let reply = Done::Reply(Box::new(Reply::Done { id: 0 }), Vec::new(), None);
        core.step(now_ns, Event::Answered { ticket: *ticket, reply });
    }
    actions
}

/// The reason for which a call was refused; 0 if it was carried out.
fn reason(actions: &[Action]) -> u16 {
    match actions {
        [Action::Declare { .. } | Action::PublishSample { .. } | Action::Publish { .. }] => 0,
        [Action::Send { reply: Reply::Answer { reason, sentence, .. }, .. }] => {
            assert!(!sentence.is_empty() && sentence.lines().count() == 1, "{sentence:?}");
            *reason
        }
        _ => panic!("{actions:?}"),
    }
}

fn declare(core: &mut Core, now_ns: u64, client: ClientId, sensor: &str) -> u16 {
    let declaration = Call::Declare { id: 3, sensor: sensor.to_owned(), message: "Soil".to_owned() };
    reason(&call(core, now_ns, client, &declaration, Soil::schema().as_bytes()))
}

fn sample(core: &mut Core, now_ns: u64, client: ClientId, stamp_ns: Option<u64>, bytes: usize) -> u16 {
    let sample = Call::Sample { id: 4, sensor: "soil".to_owned(), stamp_ns };
    reason(&call(core, now_ns, client, &sample, &vec![7; bytes]))
}

#[test]
fn a_sensor_is_declared_by_those_who_may_publish_it_and_added_by_the_robots_user_alone() {
    let unit = "nims-plugin@lab_soil.service";
    for (user, origin, unit, soil, other) in [
        ("plugin", Origin::Python, None, 0, 465),
        ("nims", Origin::Python, None, 0, 0),
        ("nims", Origin::Page, None, 468, 468),
        ("ada", Origin::Python, None, 468, 468),
        ("stranger", Origin::Python, Some(unit), 0, 472),
        ("nims", Origin::Python, Some(unit), 0, 472),
    ] {
        let mut core = core();
        connect(&mut core, 1, user, origin, unit);
        assert_eq!(declare(&mut core, SECOND, 1, "soil"), soil, "{user} {unit:?}");
        assert_eq!(declare(&mut core, SECOND, 1, "leaf"), other, "{user} {unit:?}");
    }
    // No name leaves the channels of sensors, and the number of added ones is bounded.
    let mut core = core();
    connect(&mut core, 1, "nims", Origin::Python, None);
    for name in ["../motor/state", "motor/state", "So il", "", "planner", "a-name-that-is-too-long-for-a-sensor"] {
        assert_eq!(declare(&mut core, SECOND, 1, name), NOT_ASKED, "{name}");
    }
    let added = |core: &mut Core| (0..40).filter(|n| declare(core, SECOND, 1, &format!("leaf-{n}")) == 0).count();
    assert_eq!(added(&mut core), 16);
    core.step(SECOND, Event::Gone { client: 1 });
    connect(&mut core, 1, "nims", Origin::Python, None);
    assert_eq!(added(&mut core), 16);
}

#[test]
fn samples_are_those_of_the_declared_message_at_the_declared_rate_from_one_connection() {
    let mut core = core();
    connect(&mut core, 1, "plugin", Origin::Python, None);
    connect(&mut core, 2, "plugin", Origin::Python, None);
    let size = size_of::<Soil>();
    let now = 20 * SECOND;
    assert_eq!(sample(&mut core, now, 1, None, size), NOT_ASKED, "before its message");
    assert_eq!(declare(&mut core, now, 1, "soil"), 0);
    assert_eq!(declare(&mut core, now, 1, "soil"), NOT_ASKED, "a second message");
    assert_eq!(declare(&mut core, now, 2, "soil"), 466);
    assert_eq!(sample(&mut core, now, 2, None, size), NOT_ASKED);
    for bytes in [0, size - 1, size + 8, 1 << 20] {
        assert_eq!(sample(&mut core, now, 1, None, bytes), NOT_ASKED);
    }
    for stamp_ns in [0, 9 * SECOND, now + 1, u64::MAX] {
        assert_eq!(sample(&mut core, now, 1, Some(stamp_ns), size), NOT_ASKED);
    }
    // Four a second after two at once.
    let passed = (0..50).filter(|_| sample(&mut core, now, 1, None, size) == 0).count();
    let later = (1..=100).filter(|step| sample(&mut core, now + step * SECOND / 100, 1, None, size) == 0).count();
    assert_eq!((passed, later, sample(&mut core, now + SECOND, 1, None, size)), (2, 4, 467));
    // The time of its measurement is that of the sample.
    let given = Call::Sample { id: 4, sensor: "soil".to_owned(), stamp_ns: Some(25 * SECOND) };
    match &call(&mut core, 26 * SECOND, 1, &given, &vec![7; size])[..] {
        [Action::PublishSample { sensor, header, sample, .. }] => {
            assert_eq!((sensor.message.type_name(), sensor.name.as_str()), (Soil::type_name(), "soil"));
            assert_eq!((header.stamp_ns, header.oldest_input_ns, sample.len()), (25 * SECOND, 25 * SECOND, size));
        }
        other => panic!("{other:?}"),
    }
    // The next connection declares its message itself.
    core.step(now, Event::Gone { client: 1 });
    assert_eq!(sample(&mut core, 30 * SECOND, 2, None, size), NOT_ASKED);
    assert_eq!(declare(&mut core, 30 * SECOND, 2, "soil"), 0);
    assert_eq!(sample(&mut core, 30 * SECOND, 2, None, size), 0);
}

#[test]
fn quantities_of_the_system_file_and_an_own_message_exclude_each_other() {
    let mut core = core();
    connect(&mut core, 1, "plugin", Origin::Python, None);
    assert_eq!(declare(&mut core, SECOND, 1, "air"), NOT_ASKED);
    let publish = |sensor: &str, values: usize| Call::Publish {
        id: 5,
        reading: Published {
            sensor: sensor.to_owned(),
            values: vec![Some(1.0); values],
            quality: ReadingQuality::Good,
            age_s: None,
        },
    };
    for values in [0, 1] {
        assert_eq!(reason(&call(&mut core, SECOND, 1, &publish("soil", values), &[])), NOT_ASKED);
    }
    assert_eq!(reason(&call(&mut core, SECOND, 1, &publish("air", 1), &[])), 0);
}

#[test]
fn connections_that_only_declare_are_slowed_down() {
    let mut core = core();
    let declared = (1..=100).filter(|client| {
        connect(&mut core, *client, "plugin", Origin::Python, None);
        let declared = declare(&mut core, SECOND, *client, "soil");
        core.step(SECOND, Event::Gone { client: *client });
        assert!([0, 473].contains(&declared), "{declared}");
        declared == 0
    });
    assert_eq!(declared.count(), 10);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    /// Every declaration and every sample, whatever is in it, is carried out or refused in one sentence.
    #[test]
    fn hostile_sensors_are_answered_and_bounded(
        tries in vec((
            "(soil|leaf|air|\\PC{0,8})",
            "(Soil|Reading|\\PC{0,8})",
            prop_oneof![
                vec(any::<u8>(), 0..200),
                Just(Soil::schema().as_bytes().to_vec()),
                "(nims_msgs/Header header\n)?((uint8|float64|string)(\\[[0-9]{0,6}\\])? [a-c]\n){0,4}".prop_map(String::into_bytes),
            ],
            any::<bool>(),
            any::<Option<u64>>(),
        ), 1..20),
    ) {
        let mut core = core();
        connect(&mut core, 1, "nims", Origin::Python, None);
        for (step, (sensor, message, body, declares, stamp_ns)) in (1..).zip(tries) {
            let given = if declares {
                Call::Declare { id: 3, sensor, message }
            } else {
                Call::Sample { id: 4, sensor, stamp_ns }
            };
            let actions = call(&mut core, step * SECOND, 1, &given, &body);
            reason(&actions);
            match &actions[..] {
                [Action::Declare { sensor, .. }] => prop_assert!(sensor.message.size() <= 64 << 10),
                [Action::PublishSample { sensor, sample, .. }] => prop_assert_eq!(sample.len(), sensor.message.size()),
                _ => {}
            }
        }
    }
}
