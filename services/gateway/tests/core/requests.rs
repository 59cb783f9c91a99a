//! Requests: their roles, their destinations, held motions, missions and stops.

use super::*;

#[test]
fn a_request_passes_only_with_its_role_and_names_its_user() {
    let stops = ["hold", "stop", "estop", "pause", "mark"];
    let verbs: BTreeSet<u8> = requests().iter().map(Request::verb).collect();
    assert_eq!(verbs.len(), 26, "a request is missing here");
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
        pressed_ns: None,
    };
    let mut go = |call: &Call| core.step(99 * SECOND, Event::Received { client: 1, bytes: &framed(call, &[]) });
    assert!(matches!(&go(&fault("controller-b"))[..], [Action::Ask { process, .. }] if process == "controller-b"));
    assert_eq!(reason(&go(&fault("planner"))), 456);
    let arm = Call::Ask {
        id: 9,
        request: Request::Arm,
        process: Some("planner".to_owned()),
        held: false,
        at_ns: None,
        pressed_ns: None,
    };
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
    let arm = framed(
        &Call::Ask { id: 1, request: Request::Arm, process: None, held: true, at_ns: None, pressed_ns: None },
        &[],
    );
    assert_eq!(reason(&core.step(0, Event::Received { client: 1, bytes: &arm })), 456);
}

/// Requests a motion that is held, as client 1.
fn held(core: &mut Core, request: &Request, now_ns: u64) -> Ticket {
    let call = framed(
        &Call::Ask { id: 1, request: request.clone(), process: None, held: true, at_ns: None, pressed_ns: None },
        &[],
    );
    let actions = core.step(now_ns, Event::Received { client: 1, bytes: &call });
    // What ends it is deposited before.
    let [Action::Deposit { .. }, Action::Ask { ticket, .. }, ..] = &actions[..] else { panic!("{actions:?}") };
    *ticket
}

#[test]
fn a_mission_is_flown_only_with_its_text() {
    let mut core = core();
    connected(&mut core, 1, "ada");
    let hash = config::mission_hash("name = \"low\"");
    let run = |core: &mut Core, body: &[u8]| {
        let request = Request::Run { mission: "low".to_owned(), hash, continues: false };
        let call =
            framed(&Call::Ask { id: 1, request, process: None, held: false, at_ns: None, pressed_ns: None }, body);
        core.step(0, Event::Received { client: 1, bytes: &call })
    };
    for body in [&b""[..], b"name = \"high\"", &[0xff, 0xfe]] {
        assert_eq!(reason(&run(&mut core, body)), 460);
    }
    let actions = run(&mut core, b"name = \"low\"");
    assert!(matches!(&actions[..], [Action::Ask { mission: Some(text), .. }] if text == "name = \"low\""));
}

#[test]
fn marks_keep_within_the_limits_of_calls_and_those_of_strangers_are_few() {
    let mark = |core: &mut Core, client, now_ns| {
        let bytes = ask(9, Request::Mark { text: "x".to_owned() });
        core.step(now_ns, Event::Received { client, bytes: &bytes })
    };
    // Who may fly: as many as calls may wait.
    let mut core = core();
    connected(&mut core, 1, "ada");
    let sent = (0..300).filter(|_| matches!(mark(&mut core, 1, 0)[..], [Action::Ask { .. }])).count();
    assert_eq!(sent, UNANSWERED);
    // Who may only stop: a few of all connections, however many they are, and then one a second.
    let mut core = crate::core();
    let mut sent = |now_ns| {
        let mut tickets = Vec::new();
        for client in 1..=20 {
            if now_ns == 0 {
                connected(&mut core, client, "bob");
            }
            for _ in 0..20 {
                match &mark(&mut core, client, now_ns)[..] {
                    [Action::Ask { ticket, .. }] => tickets.push(*ticket),
                    refused => assert_eq!(reason(refused), 488),
                }
            }
        }
        let count = tickets.len();
        for ticket in tickets {
            core.step(now_ns, Event::Answered { ticket, reply: Done::Answer(Box::default()) });
        }
        count
    };
    assert_eq!((sent(0), sent(SECOND), sent(100 * SECOND)), (5, 1, 5));
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
