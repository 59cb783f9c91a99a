//! Plug-ins: what they publish, and who starts and stops them.

use super::*;

/// The declared plug-in `soil`.
fn with_soil() -> Core {
    let word = |word: &str| vec![word.to_owned()];
    let declared =
        PluginSection { name: "soil".to_owned(), quantity: word("moisture"), unit: word("%"), ..Default::default() };
    core().with_plugins("lab", &[declared])
}

#[test]
fn a_plug_in_publishes_its_readings_and_does_nothing_else() {
    let publish = |sensor: &str| {
        let reading = Published {
            sensor: sensor.to_owned(),
            values: vec![Some(41.5)],
            quality: ReadingQuality::Doubtful,
            age_s: None,
        };
        framed(&Call::Publish { id: 3, reading }, &[])
    };
    for (user, expected) in [("plugin", 0), ("nims", 0), ("ada", 468), ("bob", 468), ("eve", 468)] {
        let mut core = with_soil();
        connected(&mut core, 1, user);
        let actions = core.step(SECOND, Event::Received { client: 1, bytes: &publish("soil") });
        match &actions[..] {
            [Action::Publish { sensor, reading, .. }] => {
                assert_eq!((expected, sensor.as_str(), reading.value[0], reading.quality), (0, "soil", 41.5, 1));
            }
            refused => assert_eq!(reason(refused), expected, "{user}"),
        }
    }
    let mut core = with_soil();
    connected(&mut core, 1, "plugin");
    assert_eq!(reason(&core.step(0, Event::Received { client: 1, bytes: &publish("node") })), 465);
    core.step(SECOND, Event::Received { client: 1, bytes: &publish("soil") });
    for request in requests() {
        let refused = core.step(60 * SECOND, Event::Received { client: 1, bytes: &ask(9, request) });
        assert!(matches!(reason(&refused), 450 | 451));
    }
    // Its channel stays, and waits for the next connection.
    assert!(core.step(SECOND, Event::Gone { client: 1 }).is_empty());
    connected(&mut core, 2, "plugin");
    let next = core.step(9 * SECOND, Event::Received { client: 2, bytes: &publish("soil") });
    assert!(matches!(&next[..], [Action::Publish { .. }]), "{next:?}");
}

/// The kernel names the unit of a process; neither its user nor the name in its readings counts for a plug-in.
#[test]
fn a_unit_publishes_its_own_sensor_only_whatever_its_user_is() {
    let section = |name: &str| PluginSection {
        name: name.to_owned(),
        quantity: vec!["moisture".to_owned()],
        unit: vec!["%".to_owned()],
        ..Default::default()
    };
    // `lab` is the robot's name, `lab-2` that of its file, which is in the units.
    let mut core = core().with_plugins("lab-2", &[section("soil"), section("air")]);
    let units = [
        "nims-plugin@lab-2_soil.service",
        "nims-plugin-network@lab-2_soil.service",
        "nims-plugin@lab-2_air.service",
        "nims-plugin@lab_soil.service",
        "nims-plugin@other_air.service",
    ];
    let mut client = 0;
    for (user, unit) in ["plugin", "nims", "stranger"].iter().flat_map(|user| units.map(|unit| (user, unit))) {
        for sensor in ["soil", "air", "node"] {
            client += 1;
            let peer = Peer { unit: PluginUnit::parse(unit), ..peer(user) };
            assert!(peer.unit.is_some());
            core.step(client * SECOND, Event::Connected { client, peer });
            core.step(client * SECOND, Event::Received { client, bytes: &hello() });
            let reading = Published {
                sensor: sensor.to_owned(),
                values: vec![Some(1.0)],
                quality: ReadingQuality::Good,
                age_s: None,
            };
            let bytes = framed(&Call::Publish { id: 3, reading }, &[]);
            let actions = core.step(client * SECOND, Event::Received { client, bytes: &bytes });
            if unit.contains(&format!("@lab-2_{sensor}.")) {
                assert!(matches!(&actions[..], [Action::Publish { .. }]), "{user} {unit} {sensor}: {actions:?}");
            } else {
                assert_eq!(reason(&actions), 472, "{user} {unit} {sensor}");
            }
            // It moves nothing either.
            let moved = core.step(client * SECOND, Event::Received { client, bytes: &ask(9, Request::Hold) });
            assert_eq!(reason(&moved), 450, "{user} {unit}");
            core.step(client * SECOND, Event::Gone { client });
        }
    }
}

#[test]
fn who_flies_starts_and_stops_a_declared_plug_in_through_the_service_manager() {
    let verb = |user: &str, request: Request| {
        let mut core = with_soil();
        connected(&mut core, 1, user);
        match &core.step(0, Event::Received { client: 1, bytes: &ask(1, request) })[..] {
            [Action::Plugin { verb, name, .. }] => Ok((*verb, name.clone())),
            [Action::Ask { process, .. }] => Err(process.clone()),
            other => Err(reason(other).to_string()),
        }
    };
    let (soil, name) = (|| "soil".to_owned(), "soil".to_owned());
    let start = || Request::StartProcess { name: soil(), slot: None, law: None };
    assert_eq!(verb("ada", start()), Ok((Verb::Start, name.clone())));
    assert_eq!(verb("ada", Request::StopProcess { name: soil() }), Ok((Verb::Stop, name.clone())));
    assert_eq!(verb("nims", Request::RestartProcess { name: soil() }), Ok((Verb::Restart, name)));
    assert_eq!(verb("bob", start()), Err("450".to_owned()));
    assert_eq!(verb("ada", Request::StopProcess { name: "recorder".to_owned() }), Err("nims".to_owned()));
}
