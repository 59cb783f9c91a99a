//! The core of the gateway: roles, limits and the protocol, with any bytes.

#![allow(clippy::unwrap_used, clippy::panic)]

use config::{GatewaySection, PluginSection};
use gateway::core::*;
use gateway::plugin::{PluginUnit, Verb};
use gateway::roles::{Peer, Roles};
use gateway::tokens::Tokens;
use gateway_protocol::{
    Accepted, CALL_LIMITS, Call, Origin, Published, ReadingQuality, Reply, RunFiles, VERSION, encode,
};
use messages::{GotoPath, OperatorRequest, Request, RequestAnswer, RequestBody, Slot, SlotRole, text_of};
use proptest::collection::vec;
use proptest::prelude::*;
use std::collections::BTreeSet;

const OWNER: u32 = 900;
const SECOND: u64 = 1_000_000_000;

fn core() -> Core {
    let list = |name: &str| vec![name.to_owned()];
    let (fly, stop, look, publish) = (list("ada"), list("bob"), list("eve"), list("plugin"));
    let section = GatewaySection { fly, stop, look, publish, ..GatewaySection::default() };
    Core::new("lab".to_owned(), Roles::new(OWNER, section), Tokens::default())
}

fn peer(user: &str) -> Peer {
    let uid = match user {
        "nims" => OWNER,
        other => 1000 + u32::from(other.as_bytes()[0]),
    };
    Peer { uid, gid: uid, pid: 7, user: user.to_owned(), gids: vec![uid], ..Peer::default() }
}

fn framed(call: &Call, body: &[u8]) -> Vec<u8> {
    encode(&call.header().unwrap(), body)
}

fn hello() -> Vec<u8> {
    framed(&Call::Hello { version: VERSION, origin: Origin::Command, token: None, from: None }, &[])
}

fn ask(id: u64, request: Request) -> Vec<u8> {
    framed(&Call::Ask { id, request, process: None, held: false, at_ns: None }, &[])
}

/// A client of that user that has said hello.
fn connected(core: &mut Core, client: ClientId, user: &str) {
    core.step(0, Event::Connected { client, peer: peer(user) });
    let actions = core.step(0, Event::Received { client, bytes: &hello() });
    assert!(matches!(&actions[..], [Action::Send { reply: Reply::Welcome { .. }, .. }]), "{actions:?}");
}

/// The reason of the only reply.
fn reason(actions: &[Action]) -> u16 {
    match actions {
        [Action::Send { reply: Reply::Answer { reason, accepted, .. }, .. }, ..] if *accepted != Accepted::Accepted => {
            *reason
        }
        _ => panic!("{actions:?}"),
    }
}

/// One of every request.
fn requests() -> Vec<Request> {
    let name = || "controller".to_owned();
    let hash = config::mission_hash("");
    vec![
        Request::Arm,
        Request::Disarm,
        Request::Hold,
        Request::Stop,
        Request::Estop,
        Request::Reset,
        Request::ZeroAt { position_m: [1.0, 2.0, 3.0] },
        Request::ZeroLengths { lengths_m: [1.0, 2.0, 3.0].into_iter().collect() },
        Request::ConfirmPosition,
        Request::Jog { cable: 1, distance_m: 0.1 },
        Request::Soft,
        Request::Pause,
        Request::Resume,
        Request::Speed { rate: 0.5 },
        Request::Swap { role: SlotRole::Controller, slot: Slot::B },
        Request::Admit { role: SlotRole::Estimator, slot: Slot::A },
        Request::Goto { to_m: [1.0, 2.0, 3.0], path: messages::GotoPath::Line, speed_m_s: None },
        Request::Run { mission: "m".to_owned(), hash, continues: false },
        Request::Fault { text: "stall 2".to_owned() },
        Request::StartProcess { name: name(), slot: None, law: None },
        Request::StopProcess { name: name() },
        Request::RestartProcess { name: name() },
        Request::Plug { name: name(), folder: "/".to_owned(), command: vec!["sh".to_owned()], replace: false },
        Request::Unplug { name: name() },
        Request::Set { key: "controller.horizon_cycles".to_owned(), value: "3".to_owned() },
    ]
}

#[test]
fn a_request_passes_only_with_its_role_and_names_its_user() {
    let stops = ["hold", "stop", "estop", "pause"];
    let verbs: BTreeSet<u8> = requests().iter().map(Request::verb).collect();
    assert_eq!(verbs.len(), 25, "a request is missing here");
    for (user, number) in [
        ("eve", OperatorRequest::ROLE_OBSERVER),
        ("zoe", OperatorRequest::ROLE_OBSERVER),
        ("bob", OperatorRequest::ROLE_OBSERVER),
        ("ada", OperatorRequest::ROLE_OPERATOR),
        ("nims", OperatorRequest::ROLE_ENGINEER),
    ] {
        for request in requests() {
            let mut core = core();
            connected(&mut core, 1, user);
            let actions = core.step(0, Event::Received { client: 1, bytes: &ask(5, request.clone()) });
            let header = String::from_utf8_lossy(&ask(5, request.clone())).into_owned();
            let is_stop = stops.iter().any(|stop| header.contains(&format!("\"verb\":\"{stop}\"")));
            let may = match user {
                "nims" => true,
                "ada" => !matches!(request, Request::Plug { .. }),
                "bob" => is_stop,
                _ => false,
            };
            let sent = match &actions[..] {
                [Action::Ask { request, .. }] if request.body.verb != RequestBody::VERB_ESTOP => request,
                [Action::Estop { request, .. }] => request,
                refused => {
                    assert!(!may, "{user}: {request:?}: {actions:?}");
                    assert!(matches!(reason(refused), 450 | 451));
                    continue;
                }
            };
            assert!(may, "{user}: {request:?}");
            assert_eq!(Request::decode(sent).unwrap(), request);
            assert_eq!((text_of(&sent.requester).as_str(), sent.uid, sent.pid), (user, peer(user).uid, 7));
            assert_eq!((sent.role, sent.origin), (number, OperatorRequest::ORIGIN_COMMAND));
        }
    }
}

#[test]
fn every_request_goes_to_the_process_that_carries_it_out() {
    let mut core = core();
    connected(&mut core, 1, "nims");
    let mut seen = BTreeSet::new();
    for (id, request) in requests().into_iter().enumerate() {
        let (id, bytes) = (id as u64, ask(id as u64, request));
        for action in core.step(id * SECOND, Event::Received { client: 1, bytes: &bytes }) {
            if let Action::Ask { ticket, process, .. } = action {
                seen.insert(process);
                let answer = Done::Answer(Box::default());
                core.step(0, Event::Answered { ticket, reply: answer });
            }
        }
    }
    let all = ["motor-box", "motor-io", "nims", "planner"];
    assert_eq!(seen.iter().map(String::as_str).collect::<Vec<_>>(), all);
    // Another process is named only for a fault of its output.
    let fault = |process: &str| Call::Ask {
        id: 9,
        request: Request::Fault { text: "nan".to_owned() },
        process: Some(process.to_owned()),
        held: false,
        at_ns: None,
    };
    let mut go = |call: &Call| core.step(99 * SECOND, Event::Received { client: 1, bytes: &framed(call, &[]) });
    assert!(matches!(&go(&fault("controller-b"))[..], [Action::Ask { process, .. }] if process == "controller-b"));
    assert_eq!(reason(&go(&fault("planner"))), 456);
    let arm = Call::Ask { id: 9, request: Request::Arm, process: Some("planner".to_owned()), held: false, at_ns: None };
    assert_eq!(reason(&go(&arm)), 456);
}

/// The requests that the gateway makes by itself, with their requesters.
fn ends(actions: &[Action]) -> Vec<(u8, String)> {
    let asked = |action: &Action| match action {
        Action::Ask { request, .. } => Some((request.body.verb, text_of(&request.requester))),
        _ => None,
    };
    actions.iter().filter_map(asked).collect()
}

#[test]
fn a_held_motion_ends_with_its_signs_its_release_and_its_connection() {
    let jog = Request::Jog { cable: 1, distance_m: 0.1 };
    let go = Request::Goto { to_m: [1.0; 3], path: GotoPath::Line, speed_m_s: None };
    let ms = |ms: u64| SECOND + ms * 1_000_000;
    for (request, end) in [(jog, RequestBody::VERB_HOLD), (go, RequestBody::VERB_STOP)] {
        let ended = vec![(end, "nims".to_owned())];
        let begun = |core: &mut Core| {
            connected(core, 1, "nims");
            held(core, &request, ms(0))
        };
        let accepted =
            || Done::Answer(Box::new(RequestAnswer { accepted: OperatorRequest::ACCEPTED, ..Default::default() }));
        // Without a sign for 0.3 s, and not before.
        let mut core = crate::core();
        let ticket = begun(&mut core);
        core.step(ms(1), Event::Answered { ticket, reply: accepted() });
        assert!(ends(&core.step(ms(250), Event::Tick)).is_empty() && core.is_held());
        core.step(ms(290), Event::Received { client: 1, bytes: &framed(&Call::Beat { at_ns: None }, &[]) });
        assert!(ends(&core.step(ms(589), Event::Tick)).is_empty());
        assert_eq!(ends(&core.step(ms(590), Event::Tick)), ended);
        assert!(ends(&core.step(ms(5000), Event::Tick)).is_empty() && !core.is_held());
        // By its release; by the end of the connection, also before the answer.
        let ticket = held(&mut core, &request, ms(6000));
        core.step(ms(6001), Event::Answered { ticket, reply: accepted() });
        let release = framed(&Call::Release { id: 2 }, &[]);
        assert_eq!(ends(&core.step(ms(6002), Event::Received { client: 1, bytes: &release })), ended);
        held(&mut core, &request, ms(6100));
        let gone = core.step(ms(6101), Event::Gone { client: 1 });
        assert_eq!(ends(&gone), ended);
        // What ends it is carried out, although its client is gone.
        let Some(Action::Ask { ticket, .. }) = gone.first() else { panic!("{gone:?}") };
        assert!(
            core.is_wanted(*ticket)
                && core.step(ms(6102), Event::Answered { ticket: *ticket, reply: accepted() }).is_empty()
        );
        // A refused one ends nothing.
        let mut core = crate::core();
        let ticket = begun(&mut core);
        core.step(ms(1), Event::Answered { ticket, reply: Done::Answer(Box::default()) });
        assert!(ends(&core.step(ms(900), Event::Gone { client: 1 })).is_empty());
    }
    let mut core = core();
    connected(&mut core, 1, "nims");
    let arm = framed(&Call::Ask { id: 1, request: Request::Arm, process: None, held: true, at_ns: None }, &[]);
    assert_eq!(reason(&core.step(0, Event::Received { client: 1, bytes: &arm })), 456);
}

/// Requests a motion that is held, as client 1.
fn held(core: &mut Core, request: &Request, now_ns: u64) -> Ticket {
    let call = framed(&Call::Ask { id: 1, request: request.clone(), process: None, held: true, at_ns: None }, &[]);
    let actions = core.step(now_ns, Event::Received { client: 1, bytes: &call });
    let Some(Action::Ask { ticket, .. }) = actions.first() else { panic!("{actions:?}") };
    *ticket
}

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

#[test]
fn a_mission_is_flown_only_with_its_text() {
    let mut core = core();
    connected(&mut core, 1, "ada");
    let hash = config::mission_hash("name = \"low\"");
    let run = |core: &mut Core, body: &[u8]| {
        let request = Request::Run { mission: "low".to_owned(), hash, continues: false };
        let call = framed(&Call::Ask { id: 1, request, process: None, held: false, at_ns: None }, body);
        core.step(0, Event::Received { client: 1, bytes: &call })
    };
    for body in [&b""[..], b"name = \"high\"", &[0xff, 0xfe]] {
        assert_eq!(reason(&run(&mut core, body)), 460);
    }
    let actions = run(&mut core, b"name = \"low\"");
    assert!(matches!(&actions[..], [Action::Ask { mission: Some(text), .. }] if text == "name = \"low\""));
}

#[test]
fn a_stop_passes_when_nothing_else_does() {
    let mut core = core();
    connected(&mut core, 1, "ada");
    let (mut passed, mut refused) = (0, 0);
    for id in 0..1000 {
        match &core.step(0, Event::Received { client: 1, bytes: &ask(id, Request::Reset) })[..] {
            [Action::Ask { .. }] => passed += 1,
            busy => {
                assert_eq!(reason(busy), 453);
                refused += 1;
            }
        }
    }
    assert_eq!((passed, refused), (UNANSWERED, 1000 - UNANSWERED));
    for id in 0..1000 {
        let stop = core.step(0, Event::Received { client: 1, bytes: &ask(id, Request::Stop) });
        let estop = core.step(0, Event::Received { client: 1, bytes: &ask(id, Request::Estop) });
        assert!(matches!((&stop[..], &estop[..]), ([Action::Ask { .. }], [Action::Estop { .. }])));
    }
}

#[test]
fn connections_are_bounded_and_a_new_one_of_a_user_takes_the_place_of_an_idle_one() {
    let mut core = core();
    let mut closed = BTreeSet::new();
    for client in 1..=300 {
        for action in core.step(client, Event::Connected { client, peer: peer("eve") }) {
            if let Action::Close { client } = action {
                closed.insert(client);
                core.step(client, Event::Gone { client });
            }
        }
    }
    // The newest are left.
    let left = CONNECTIONS_OF_A_USER as u64;
    assert_eq!(closed.iter().copied().collect::<Vec<_>>(), (1..=300 - left).collect::<Vec<_>>());
    // Another user is not affected.
    connected(&mut core, 301, "ada");
    let arm = core.step(0, Event::Received { client: 301, bytes: &ask(1, Request::Arm) });
    assert!(matches!(arm[..], [Action::Ask { .. }]));
}

#[test]
fn a_connection_begins_with_hello_in_time_and_of_the_same_version() {
    let version = |version| framed(&Call::Hello { version, origin: Origin::Python, token: None, from: None }, &[]);
    for (bytes, expected) in [
        (ask(1, Request::Stop), 457),
        (version(VERSION + 1), 458),
        (version(0), 458),
        (encode(b"{}", &[]), 457),
        (encode(b"not json", &[]), 457),
        (vec![0xff; 8], 457),
    ] {
        let mut core = core();
        core.step(0, Event::Connected { client: 1, peer: peer("ada") });
        let actions = core.step(0, Event::Received { client: 1, bytes: &bytes });
        assert_eq!(reason(&actions), expected);
        assert!(matches!(actions.last(), Some(Action::Close { client: 1 })));
        // Nothing of a closed connection is read.
        assert!(core.step(0, Event::Received { client: 1, bytes: &hello() }).is_empty());
    }
    let mut core = core();
    core.step(0, Event::Connected { client: 1, peer: peer("ada") });
    connected(&mut core, 2, "ada");
    assert!(core.step(9 * SECOND, Event::Tick).is_empty());
    assert!(matches!(core.step(10 * SECOND, Event::Tick)[..], [Action::Close { client: 1 }]));
}

/// Changes the tokens as the client 1; a second change waits for the end of the first.
fn changed(core: &mut Core, call: &Call, stored: Result<(), String>) -> Vec<Action> {
    let mut actions = core.step(0, Event::Received { client: 1, bytes: &framed(call, &[]) });
    let Some(Action::StoreTokens(change)) = actions.pop() else { panic!("{actions:?}") };
    assert!(actions.is_empty(), "a reply comes before the change is stored: {actions:?}");
    let second = Call::TokenAdd { id: 8, name: "second".to_owned(), role: "look".to_owned() };
    assert_eq!(reason(&core.step(0, Event::Received { client: 1, bytes: &framed(&second, &[]) })), 453);
    core.step(0, Event::Stored { change, stored })
}

#[test]
fn a_client_opens_ten_files_at_once_and_makes_one_list() {
    let mut core = core();
    connected(&mut core, 1, "eve");
    let mut go = |call: Call, now| core.step(now, Event::Received { client: 1, bytes: &framed(&call, &[]) });
    let list = go(Call::Runs { id: 1 }, 0);
    let [Action::Look { ticket, .. }] = list[..] else { panic!("{list:?}") };
    assert_eq!(reason(&go(Call::Files { id: 2, run: "run".to_owned() }, 0)), 453);
    core.step(0, Event::Answered { ticket, reply: Done::Answer(Box::default()) });
    let mut opened = 0;
    for id in 0..100 {
        let open = Call::Open { id, run: "run".to_owned(), file: "run.mcap".to_owned() };
        let actions = core.step(0, Event::Received { client: 1, bytes: &framed(&open, &[]) });
        if let [Action::Look { ticket, .. }] = actions[..] {
            opened += 1;
            core.step(0, Event::Answered { ticket, reply: Done::Answer(Box::default()) });
        } else {
            assert_eq!(reason(&actions), 453);
        }
    }
    assert_eq!(opened, 10);
    let again = core.step(0, Event::Received { client: 1, bytes: &framed(&Call::Runs { id: 3 }, &[]) });
    assert!(matches!(again[..], [Action::Look { .. }]), "{again:?}");
}

#[test]
fn only_who_may_fly_makes_and_deletes_files_of_runs_one_after_the_other() {
    let run = || "run".to_owned();
    let calls = |id| {
        [Call::Make { id, run: run(), what: RunFiles::Report }, Call::Remove { id, run: run() }, Call::Doctor { id }]
    };
    for (user, may) in [("eve", false), ("zoe", false), ("bob", false), ("ada", true), ("nims", true)] {
        for call in calls(1) {
            let mut core = core();
            connected(&mut core, 1, user);
            let actions = core.step(0, Event::Received { client: 1, bytes: &framed(&call, &[]) });
            if !may {
                assert_eq!(reason(&actions), 450, "{user}: {call:?}");
                continue;
            }
            let [Action::Look { ticket, .. }] = actions[..] else { panic!("{user}: {actions:?}") };
            // Meanwhile lists are made, and nothing else of the kind.
            for call in calls(2) {
                let more = core.step(0, Event::Received { client: 1, bytes: &framed(&call, &[]) });
                assert_eq!(reason(&more), 453, "{call:?}");
            }
            let list = core.step(0, Event::Received { client: 1, bytes: &framed(&Call::Runs { id: 3 }, &[]) });
            assert!(matches!(list[..], [Action::Look { .. }]), "{list:?}");
            core.step(0, Event::Answered { ticket, reply: Done::Answer(Box::default()) });
            let next = core.step(0, Event::Received { client: 1, bytes: &framed(&Call::Doctor { id: 4 }, &[]) });
            assert!(matches!(next[..], [Action::Look { .. }]), "{next:?}");
        }
    }
}

#[test]
fn a_connection_has_one_subscription_of_a_channel() {
    let mut core = core();
    connected(&mut core, 1, "eve");
    connected(&mut core, 2, "eve");
    let mut go = |client, call: Call| core.step(0, Event::Received { client, bytes: &framed(&call, &[]) });
    let subscribe = |id, name: &str| Call::Subscribe { id, channel: name.to_owned(), rate_hz: None };
    let subscribed = |actions: &[Action]| matches!(actions, [Action::Send { .. }, Action::Subscribe { .. }]);
    assert!(subscribed(&go(1, subscribe(1, "motor/state"))));
    let second = go(1, subscribe(2, "motor/state"));
    assert_eq!(reason(&second), 456);
    let [Action::Send { reply: Reply::Answer { sentence, .. }, .. }] = &second[..] else { panic!("{second:?}") };
    assert!(sentence.contains("subscription 1") && sentence.contains("motor/state"), "{sentence}");
    assert_eq!(reason(&go(1, subscribe(1, "motor/input"))), 456);
    // Another connection, another channel, and the same one after its end.
    assert!(subscribed(&go(2, subscribe(2, "motor/state"))));
    assert!(subscribed(&go(1, subscribe(3, "motor/input"))));
    go(1, Call::Unsubscribe { id: 4, subscription: 1 });
    assert!(subscribed(&go(1, subscribe(5, "motor/state"))));
    for id in 10..10 + SUBSCRIPTIONS as u64 - 2 {
        assert!(subscribed(&go(1, subscribe(id, &format!("sensor/{id}")))));
    }
    assert_eq!(reason(&go(1, subscribe(999, "sensor/more"))), 464);
}

#[test]
fn the_calls_of_a_client_that_is_gone_are_not_wanted() {
    let mut core = core();
    connected(&mut core, 1, "ada");
    let asked = core.step(0, Event::Received { client: 1, bytes: &ask(1, Request::Arm) });
    let [Action::Ask { ticket, .. }] = asked[..] else { panic!("{asked:?}") };
    assert!(core.is_wanted(ticket));
    core.step(0, Event::Gone { client: 1 });
    assert!(!core.is_wanted(ticket));
}

#[test]
fn a_token_gives_its_role_until_it_is_revoked() {
    let mut core = core();
    connected(&mut core, 1, "nims");
    let add = Call::TokenAdd { id: 3, name: "tablet".to_owned(), role: "stop".to_owned() };
    // A token that could not be stored is not valid, and its secret is not told.
    let failed = changed(&mut core, &add, Err("the disk is full".to_owned()));
    assert_eq!(reason(&failed), 463);
    let list = core.step(0, Event::Received { client: 1, bytes: &framed(&Call::TokenList { id: 1 }, &[]) });
    assert!(matches!(&list[..], [Action::Send { reply: Reply::Tokens { tokens, .. }, .. }] if tokens.is_empty()));
    let actions = changed(&mut core, &add, Ok(()));
    let [Action::Send { reply: Reply::Token { id: 3, secret }, .. }] = &actions[..] else { panic!("{actions:?}") };
    let with = |core: &mut Core, client, secret: &str| {
        let token = Some(secret.to_owned());
        core.step(0, Event::Connected { client, peer: peer("eve") });
        let from = Some("10.0.0.7".parse().unwrap());
        let bytes = framed(&Call::Hello { version: VERSION, origin: Origin::Page, token, from }, &[]);
        core.step(0, Event::Received { client, bytes: &bytes })
    };
    assert_eq!(reason(&with(&mut core, 2, "guess")), 459);
    let welcome = with(&mut core, 3, secret);
    let [Action::Send { reply: Reply::Welcome { role, user, .. }, .. }] = &welcome[..] else { panic!("{welcome:?}") };
    assert_eq!((role.as_str(), user.as_str()), ("stop", "tablet"));
    let stop = core.step(0, Event::Received { client: 3, bytes: &ask(1, Request::Stop) });
    let [Action::Ask { request, .. }] = &stop[..] else { panic!("{stop:?}") };
    let page = OperatorRequest::ORIGIN_PAGE;
    assert_eq!((text_of(&request.requester).as_str(), request.origin), ("tablet@10.0.0.7", page));
    assert_eq!(reason(&core.step(0, Event::Received { client: 3, bytes: &ask(1, Request::Arm) })), 450);
    // Only the owner manages tokens.
    let list = framed(&Call::TokenList { id: 1 }, &[]);
    assert_eq!(reason(&core.step(0, Event::Received { client: 3, bytes: &list })), 451);
    let revoke = Call::TokenRevoke { id: 4, name: "tablet".to_owned() };
    assert_eq!(reason(&changed(&mut core, &revoke, Err("the disk is full".to_owned()))), 463);
    let revoked = changed(&mut core, &revoke, Ok(()));
    assert!(revoked.iter().any(|action| matches!(action, Action::Close { client: 3 })), "{revoked:?}");
    assert!(core.step(0, Event::Received { client: 3, bytes: &ask(1, Request::Stop) }).is_empty());
    assert_eq!(reason(&with(&mut core, 4, secret)), 459);
}

#[test]
fn an_answer_reaches_its_own_client_only() {
    let mut core = core();
    connected(&mut core, 1, "ada");
    connected(&mut core, 2, "ada");
    let mut ticket_of = |client, id| match core.step(0, Event::Received { client, bytes: &ask(id, Request::Arm) })[..] {
        [Action::Ask { ticket, .. }] => ticket,
        ref other => panic!("{other:?}"),
    };
    let (first, second) = (ticket_of(1, 40), ticket_of(2, 40));
    core.step(0, Event::Gone { client: 1 });
    let answer = || Done::Answer(Box::new(RequestAnswer { accepted: 1, ..RequestAnswer::default() }));
    assert!(core.step(0, Event::Answered { ticket: first, reply: answer() }).is_empty());
    let sent = core.step(0, Event::Answered { ticket: second, reply: answer() });
    assert!(matches!(&sent[..], [Action::Send { client: 2, reply: Reply::Answer { id: 40, .. }, .. }]), "{sent:?}");
    assert!(core.step(0, Event::Answered { ticket: second, reply: answer() }).is_empty());
}

/// Bytes that are partly frames: random ones alone hardly ever get beyond the first length.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let text = "[\\x00-\\x7f]{0,60}".prop_map(|text| encode(text.as_bytes(), b"body"));
    let json = "\\{\"call\":\"(ask|robot|open|subscribe|hello)\",\"id\":[0-9]{1,3}(,\"[a-z]{1,8}\":[0-9]{1,3}){0,3}\\}"
        .prop_map(|text| encode(text.as_bytes(), &[]));
    let ask = prop::sample::select(requests()).prop_map(|request| ask(1, request));
    let piece = prop_oneof![vec(any::<u8>(), 0..40), text, json, ask, Just(hello())];
    vec(piece, 0..12).prop_map(|pieces| pieces.concat())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_panic_or_reach_the_robot_without_a_role(
        bytes in stream(),
        piece in 1..200_usize,
        greeted in any::<bool>(),
    ) {
        let mut core = core();
        core.step(0, Event::Connected { client: 1, peer: peer("eve") });
        if greeted {
            core.step(0, Event::Received { client: 1, bytes: &hello() });
        }
        for bytes in bytes.chunks(piece) {
            for action in core.step(1, Event::Received { client: 1, bytes }) {
                let moves = matches!(action, Action::Ask { .. } | Action::Estop { .. } | Action::StoreTokens(_));
                prop_assert!(!moves, "{:?}", action);
            }
        }
        let left = core.step(2, Event::Gone { client: 1 });
        prop_assert!(left.is_empty());
    }

    #[test]
    fn a_frame_beyond_the_limits_closes_the_connection(more in 1..u32::MAX / 2) {
        let mut core = core();
        connected(&mut core, 1, "ada");
        let header = (CALL_LIMITS.header as u32).saturating_add(more);
        let actions = core.step(0, Event::Received { client: 1, bytes: &header.to_le_bytes() });
        prop_assert_eq!(reason(&actions), 457);
    }
}
