//! Connections: their number, their beginning, their calls, and any bytes.

use super::*;

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
            assert_eq!(reason(&actions), 488);
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
