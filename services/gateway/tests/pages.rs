//! Connections of pages: one person flies, browsers are paired by codes, and a motion without an operator is held.

#![allow(clippy::unwrap_used, clippy::panic)]

use config::GatewaySection;
use gateway::core::*;
use gateway::roles::{Peer, Roles};
use gateway::tokens::Tokens;
use gateway_protocol::{Accepted, Call, Origin, Reply, SeatCall, VERSION, encode};
use messages::{GotoPath, MotorAuthority, OperatorRequest, Request, RequestAnswer, RequestBody, text_of};

const SECOND: u64 = 1_000_000_000;
const OWNER: u32 = 900;

struct Gateway {
    core: Core,
    now_ns: u64,
}

impl Gateway {
    fn new(hold_without_operator_s: f64) -> Self {
        let section = GatewaySection { hold_without_operator_s, ..GatewaySection::default() };
        let core = Core::new("lab".to_owned(), Roles::new(OWNER, section), Tokens::default());
        Self { core, now_ns: SECOND }
    }

    fn step(&mut self, event: Event<'_>) -> Vec<Action> {
        self.core.step(self.now_ns, event)
    }

    fn send(&mut self, client: ClientId, call: &Call) -> Vec<Action> {
        let bytes = encode(&call.header().unwrap(), &[]);
        let mut actions = self.step(Event::Received { client, bytes: &bytes });
        // Tokens are stored at once.
        while let Some(at) = actions.iter().position(|action| matches!(action, Action::StoreTokens(_))) {
            let Action::StoreTokens(change) = actions.remove(at) else { continue };
            actions.extend(self.step(Event::Stored { change, stored: Ok(()) }));
        }
        actions
    }

    fn connect(&mut self, client: ClientId, uid: u32, origin: Origin, token: Option<String>) -> Vec<Action> {
        let peer = Peer { uid, user: format!("u{uid}"), ..Peer::default() };
        self.step(Event::Connected { client, peer });
        self.send(client, &Call::Hello { version: VERSION, origin, token, from: None })
    }

    /// A page of a new person with that role.
    fn page(&mut self, client: ClientId, name: &str, role: &str) -> Vec<Action> {
        self.connect(1000 + client, OWNER, Origin::Command, None);
        let added = self.send(1000 + client, &Call::TokenAdd { id: 1, name: name.to_owned(), role: role.to_owned() });
        let Some(Action::Send { reply: Reply::Token { secret, .. }, .. }) = added.first() else { panic!("{added:?}") };
        self.step(Event::Gone { client: 1000 + client });
        self.connect(client, 700, Origin::Page, Some(secret.clone()))
    }

    fn ask(&mut self, client: ClientId, request: Request, held: bool) -> Vec<Action> {
        self.send(client, &Call::Ask { id: 9, request, process: None, held, at_ns: None, pressed_ns: None })
    }

    fn seat(&mut self, client: ClientId, what: SeatCall) -> Vec<Action> {
        self.send(client, &Call::Seat { id: 8, what })
    }
}

fn go() -> Request {
    Request::Goto { to_m: [1.0; 3], path: GotoPath::Line, speed_m_s: None }
}

fn sent(actions: &[Action]) -> bool {
    actions.iter().any(|action| matches!(action, Action::Ask { .. } | Action::Estop { .. }))
}

fn reason(actions: &[Action]) -> u16 {
    let refused = actions.iter().find_map(|action| match action {
        Action::Send { reply: Reply::Answer { reason, accepted, .. }, .. } if *accepted != Accepted::Accepted => {
            Some(*reason)
        }
        _ => None,
    });
    refused.unwrap_or_else(|| panic!("{actions:?}"))
}

/// What clients are told of the seat: client, who flies, who asks.
fn told(actions: &[Action]) -> Vec<(ClientId, Option<&str>, Option<&str>)> {
    let seat = |action| match action {
        &Action::Send { client, reply: Reply::Seat { ref flyer, ref asks, .. }, .. } => {
            Some((client, flyer.as_deref(), asks.as_deref()))
        }
        _ => None,
    };
    actions.iter().filter_map(seat).collect()
}

#[test]
fn one_person_flies_from_pages_and_everybody_stops() {
    let mut gateway = Gateway::new(0.0);
    gateway.page(1, "ada", "fly");
    gateway.page(2, "bob", "fly");
    gateway.connect(3, 700, Origin::Page, None);
    gateway.connect(4, OWNER, Origin::Command, None);
    // The first request takes the free seat, and all pages see it.
    let begun = gateway.ask(1, Request::Arm, false);
    assert!(sent(&begun));
    assert_eq!(told(&begun), [1, 2, 3].map(|client| (client, Some("ada"), None)));
    assert_eq!(reason(&gateway.ask(2, Request::Arm, false)), 479);
    assert_eq!(reason(&gateway.ask(2, go(), true)), 479);
    // A stop is open to all, also to one who may not fly; a command of the robot's user needs no seat.
    for client in [2, 4] {
        assert!(sent(&gateway.ask(client, Request::Stop, false)) && sent(&gateway.ask(client, Request::Estop, false)));
    }
    assert!(sent(&gateway.ask(4, Request::Arm, false)));
    // Both see who asks; the seat is kept, given, or taken over after ten seconds.
    let asked = gateway.seat(2, SeatCall::Ask);
    assert_eq!(told(&asked), [1, 2, 3].map(|client| (client, Some("ada"), Some("bob"))));
    assert_eq!(told(&gateway.seat(1, SeatCall::Keep)).len(), 3);
    assert_eq!(reason(&gateway.ask(2, Request::Arm, false)), 479);
    gateway.seat(2, SeatCall::Ask);
    assert_eq!(told(&gateway.seat(1, SeatCall::Give))[0], (1, Some("bob"), None));
    assert!(sent(&gateway.ask(2, Request::Arm, false)));
    assert_eq!(reason(&gateway.ask(1, Request::Arm, false)), 479);
    gateway.seat(1, SeatCall::Ask);
    gateway.now_ns += 10 * SECOND;
    assert_eq!(told(&gateway.step(Event::Tick))[0], (1, Some("ada"), None));
    // Who has no page left leaves the seat; who comes later is told.
    assert_eq!(told(&gateway.page(5, "eve", "fly")), [(5, Some("ada"), None)]);
    assert_eq!(told(&gateway.step(Event::Gone { client: 1 }))[0], (2, None, None));
    assert_eq!(reason(&gateway.seat(3, SeatCall::Ask)), 450);
    assert_eq!(reason(&gateway.seat(4, SeatCall::Ask)), 450);
}

#[test]
fn a_motion_that_is_held_ends_when_another_person_takes_over() {
    let mut gateway = Gateway::new(0.0);
    gateway.page(1, "ada", "fly");
    gateway.page(2, "bob", "fly");
    let begun = gateway.ask(1, go(), true);
    let asked = begun.iter().find(|action| matches!(action, Action::Ask { .. }));
    let Some(Action::Ask { ticket, .. }) = asked else { panic!("{begun:?}") };
    let answer = RequestAnswer { accepted: OperatorRequest::ACCEPTED, ..RequestAnswer::default() };
    gateway.step(Event::Answered { ticket: *ticket, reply: Done::Answer(Box::new(answer)) });
    gateway.seat(2, SeatCall::Ask);
    let given = gateway.seat(1, SeatCall::Give);
    let ended = given.iter().find_map(|action| match action {
        Action::Ask { request, .. } => Some((request.body.verb, text_of(&request.requester))),
        _ => None,
    });
    assert_eq!(ended, Some((RequestBody::VERB_STOP, "ada".to_owned())));
    assert!(!gateway.core.is_held());
}

#[test]
fn a_code_pairs_one_browser_and_failures_close_the_pairing() {
    let mut gateway = Gateway::new(0.0);
    gateway.connect(1, OWNER, Origin::Command, None);
    gateway.connect(2, 700, Origin::Page, None);
    let add = |name: &str, role: &str| Call::CodeAdd { id: 1, name: name.to_owned(), role: role.to_owned() };
    assert_eq!(reason(&gateway.send(2, &add("ada", "fly"))), 451);
    assert_eq!(reason(&gateway.send(1, &add("ada", "owner"))), 456);
    let made = gateway.send(1, &add("ada", "fly"));
    let [Action::Send { reply: Reply::Code { code, .. }, .. }] = &made[..] else { panic!("{made:?}") };
    let give = |code: &str| Call::CodeUse { id: 2, code: code.to_owned() };
    assert_eq!(reason(&gateway.send(2, &give("0000-0000"))), 481);
    let paired = gateway.send(2, &give(code));
    let [Action::Send { reply: Reply::Token { secret, .. }, .. }] = &paired[..] else { panic!("{paired:?}") };
    let welcome = gateway.connect(3, 700, Origin::Page, Some(secret.clone()));
    let [Action::Send { reply: Reply::Welcome { user, role, .. }, .. }] = &welcome[..] else { panic!("{welcome:?}") };
    assert_eq!((user.as_str(), role.as_str()), ("ada", "fly"));
    // It is used, and its holder cannot get a second one.
    assert_eq!(reason(&gateway.send(2, &give(code))), 481);
    assert_eq!(reason(&gateway.send(1, &add("ada", "fly"))), 456);
    let made = gateway.send(1, &add("bob", "fly"));
    let [Action::Send { reply: Reply::Code { code, .. }, .. }] = &made[..] else { panic!("{made:?}") };
    let last = (0..4).map(|_| reason(&gateway.send(2, &give("0000-0000")))).last();
    assert_eq!(last, Some(482));
    assert_eq!(reason(&gateway.send(2, &give(code))), 482, "also the right one is refused for a minute");
    gateway.now_ns += 60 * SECOND;
    assert!(matches!(&gateway.send(2, &give(code))[..], [Action::Send { reply: Reply::Token { .. }, .. }]));
}

#[test]
fn wrong_codes_close_the_pairing_to_their_address_alone() {
    let mut gateway = Gateway::new(0.0);
    gateway.connect(1, OWNER, Origin::Command, None);
    for (client, from) in [(2, "10.0.0.66"), (3, "10.0.0.66"), (4, "10.0.0.7")] {
        let peer = Peer { uid: 700, user: "u700".to_owned(), ..Peer::default() };
        gateway.step(Event::Connected { client, peer });
        let from = Some(from.parse().unwrap());
        gateway.send(client, &Call::Hello { version: VERSION, origin: Origin::Page, token: None, from });
    }
    let made = gateway.send(1, &Call::CodeAdd { id: 1, name: "ada".to_owned(), role: "fly".to_owned() });
    let [Action::Send { reply: Reply::Code { code, .. }, .. }] = &made[..] else { panic!("{made:?}") };
    let give = |code: &str| Call::CodeUse { id: 2, code: code.to_owned() };
    // Also over another connection of that address.
    let reasons: Vec<u16> = (0..6).map(|i| reason(&gateway.send(2 + i % 2, &give("0000-0000")))).collect();
    assert_eq!(reasons, [481, 481, 481, 481, 482, 482]);
    assert!(matches!(&gateway.send(4, &give(code))[..], [Action::Send { reply: Reply::Token { .. }, .. }]));
}

#[test]
fn a_motion_without_an_operator_is_held_where_that_is_configured() {
    let (following, jogging) = (MotorAuthority::MODE_FOLLOWING, MotorAuthority::MODE_JOGGING);
    // In soft mode a person has the node in hand.
    let soft = MotorAuthority::MODE_SOFT;
    for (after_s, mode) in [(0.0, following), (0.0, jogging), (5.0, following), (5.0, jogging), (5.0, soft)] {
        let mut gateway = Gateway::new(after_s);
        gateway.page(1, "ada", "fly");
        gateway.connect(2, 700, Origin::Page, None);
        let mut held_after = |seconds: u64, moves: bool| {
            let mode = if moves { mode } else { MotorAuthority::MODE_HOLDING };
            let mut held = None;
            for second in 0..seconds {
                gateway.now_ns += SECOND;
                gateway.step(Event::Moved(Motion { stamp_ns: gateway.now_ns, mode, number: 3 }));
                for action in gateway.step(Event::Tick) {
                    if let Action::Ask { request, .. } = action {
                        assert_eq!(text_of(&request.requester), "gateway");
                        held = held.or(Some((second, request.body.verb)));
                    }
                }
            }
            (held, gateway.step(Event::Gone { client: 1 }).len())
        };
        // With an operator it goes on; a visitor is none.
        assert_eq!(held_after(20, true).0, None);
        assert_eq!(held_after(20, false).0, None);
        let held = held_after(20, true).0;
        let holds = after_s > 0.0 && mode != soft;
        assert_eq!(held, holds.then_some((5, RequestBody::VERB_HOLD)), "mode {mode} after {after_s} s");
    }
}
