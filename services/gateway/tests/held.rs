//! Held motions: what ends them, and that they end nothing else.

#![allow(clippy::unwrap_used, clippy::panic)]

use config::GatewaySection;
use gateway::core::*;
use gateway::roles::{Peer, Roles};
use gateway::tokens::Tokens;
use gateway_protocol::{Accepted, Call, Origin, Reply, VERSION, encode};
use messages::{GotoPath, MotorAuthority, OperatorRequest, Request, RequestAnswer, RequestBody, text_of};
use robot_state::Reason;
use robot_state::answers::detail;

const SECOND: u64 = 1_000_000_000;

fn ms(ms: u64) -> u64 {
    SECOND + ms * 1_000_000
}

fn framed(call: &Call) -> Vec<u8> {
    encode(&call.header().unwrap(), &[])
}

/// A gateway with two clients, 1 and 2, who fly.
fn core() -> Core {
    let fly = vec!["ada".to_owned(), "bob".to_owned()];
    let roles = Roles::new(900, GatewaySection { fly, ..GatewaySection::default() });
    let mut core = Core::new("lab".to_owned(), roles, Tokens::default());
    for (client, user) in [(1, "ada"), (2, "bob")] {
        let peer = Peer { uid: 1000 + client as u32, user: user.to_owned(), ..Peer::default() };
        core.step(0, Event::Connected { client, peer });
        let hello = Call::Hello { version: VERSION, origin: Origin::Command, token: None, from: None };
        core.step(0, Event::Received { client, bytes: &framed(&hello) });
    }
    core
}

fn jog() -> Request {
    Request::Jog { cable: 1, distance_m: 0.1 }
}

fn go() -> Request {
    Request::Goto { to_m: [1.0; 3], path: GotoPath::Line, speed_m_s: None }
}

fn sent(core: &mut Core, client: ClientId, now_ns: u64, call: &Call) -> Vec<Action> {
    core.step(now_ns, Event::Received { client, bytes: &framed(call) })
}

/// Requests a motion of a client; `held`: one that goes on while it sends signs.
fn asked(core: &mut Core, client: ClientId, request: Request, held: bool, now_ns: u64) -> Ticket {
    let actions =
        sent(core, client, now_ns, &Call::Ask { id: 1, request, process: None, held, at_ns: None, pressed_ns: None });
    let ask = actions.iter().find_map(|action| match action {
        Action::Ask { ticket, .. } => Some(*ticket),
        _ => None,
    });
    ask.unwrap_or_else(|| panic!("{actions:?}"))
}

fn answered(core: &mut Core, now_ns: u64, ticket: Ticket, answer: RequestAnswer) -> Vec<Action> {
    core.step(now_ns, Event::Answered { ticket, reply: Done::Answer(Box::new(answer)) })
}

fn accepted() -> RequestAnswer {
    RequestAnswer { accepted: OperatorRequest::ACCEPTED, ..RequestAnswer::default() }
}

fn moved(core: &mut Core, now_ns: u64, mode: u8, number: u32) {
    core.step(now_ns, Event::Moved(Motion { stamp_ns: now_ns, mode, number }));
}

fn release(core: &mut Core, client: ClientId, now_ns: u64) -> Vec<(u8, String)> {
    ends(&sent(core, client, now_ns, &Call::Release { id: 2 }))
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
fn a_motion_whose_answer_did_not_come_is_still_ended() {
    let unreached = Reason::RobotUnreached { why: detail("planner does not answer within 10 s") }.answer();
    for (request, end) in [(jog(), RequestBody::VERB_HOLD), (go(), RequestBody::VERB_STOP)] {
        let mut core = core();
        let ticket = asked(&mut core, 1, request.clone(), true, ms(0));
        answered(&mut core, ms(100), ticket, unreached);
        assert!(core.is_held());
        assert_eq!(ends(&core.step(ms(300), Event::Tick)), [(end, "ada".to_owned())]);
        // What was not sent, or was refused, is not ended.
        for reason in [
            Reason::OvertakenByStop,
            Reason::WaitedTooLong { within_s: 10.0 },
            Reason::RequesterGone,
            Reason::WithdrawnByStop,
            Reason::RobotMoves,
        ] {
            let ticket = asked(&mut core, 1, request.clone(), true, ms(1000));
            answered(&mut core, ms(1001), ticket, reason.answer());
            assert!(!core.is_held() && release(&mut core, 1, ms(1002)).is_empty(), "{reason}");
        }
    }
}

#[test]
fn the_end_of_a_motion_is_seen_and_its_release_ends_no_other_one() {
    let (holding, following) = (MotorAuthority::MODE_HOLDING, MotorAuthority::MODE_FOLLOWING);
    let jogging = MotorAuthority::MODE_JOGGING;
    for (request, mode, number) in [(go(), following, 7), (jog(), jogging, 0)] {
        let mut core = core();
        let ticket = asked(&mut core, 1, request.clone(), true, ms(0));
        answered(&mut core, ms(10), ticket, accepted());
        // A sample from before the answer says nothing about it.
        core.step(ms(11), Event::Moved(Motion { stamp_ns: ms(9), mode: following, number: 6 }));
        moved(&mut core, ms(12), holding, 0);
        assert!(core.is_held(), "it has not begun");
        moved(&mut core, ms(20), mode, number);
        moved(&mut core, ms(30), mode, number);
        assert!(core.is_held());
        // A pause of the move keeps it; its end does not.
        if number != 0 {
            moved(&mut core, ms(40), holding, number);
            assert!(core.is_held());
        }
        moved(&mut core, ms(50), holding, 0);
        assert!(!core.is_held());
        moved(&mut core, ms(60), following, 8);
        assert!(release(&mut core, 1, ms(70)).is_empty());
        // The next motion follows at once, between two samples.
        let ticket = asked(&mut core, 1, request, true, ms(100));
        answered(&mut core, ms(110), ticket, accepted());
        moved(&mut core, ms(120), mode, number);
        moved(&mut core, ms(130), following, 9);
        assert!(release(&mut core, 1, ms(140)).is_empty());
    }
}

#[test]
fn a_motion_of_another_client_replaces_one_that_was_held() {
    let mission = Request::Run { mission: "m".to_owned(), hash: config::mission_hash(""), continues: false };
    for other in [go(), jog(), mission] {
        let mut core = core();
        let ticket = asked(&mut core, 1, jog(), true, ms(0));
        answered(&mut core, ms(10), ticket, accepted());
        // A refused one, and one that was asked for before, replace nothing.
        let refused = asked(&mut core, 2, other.clone(), false, ms(20));
        answered(&mut core, ms(21), refused, Reason::RobotJogging.answer());
        assert!(core.is_held());
        let later = asked(&mut core, 2, other, false, ms(30));
        answered(&mut core, ms(31), later, accepted());
        assert!(!core.is_held());
        assert!(release(&mut core, 1, ms(40)).is_empty() && ends(&core.step(ms(900), Event::Tick)).is_empty());
    }
}

#[test]
fn a_release_before_the_answer_stops_no_mission_that_is_flown() {
    let following = MotorAuthority::MODE_FOLLOWING;
    for answer in [Reason::RobotMoves.answer(), accepted()] {
        let mut core = core();
        let first = asked(&mut core, 1, jog(), true, ms(0));
        answered(&mut core, ms(1), first, Reason::RobotMoves.answer());
        moved(&mut core, ms(10), following, 3);
        let ticket = asked(&mut core, 1, go(), true, ms(20));
        assert!(release(&mut core, 1, ms(30)).is_empty());
        // Only a motion that begins in spite of the other one is ended.
        let expected = match answer.accepted {
            OperatorRequest::ACCEPTED => vec![(RequestBody::VERB_STOP, "ada".to_owned())],
            _ => Vec::new(),
        };
        assert_eq!(ends(&answered(&mut core, ms(40), ticket, answer)), expected);
        // Without a motion, or without news of one, it is withdrawn at once.
        for seen_ns in [ms(90), ms(700)] {
            moved(&mut core, ms(80), MotorAuthority::MODE_HOLDING, 0);
            asked(&mut core, 1, go(), true, seen_ns);
            let stopped = release(&mut core, 1, seen_ns + 1);
            assert_eq!(stopped, [(RequestBody::VERB_STOP, "ada".to_owned())]);
        }
        moved(&mut core, ms(1000), following, 4);
        asked(&mut core, 1, go(), true, ms(1400));
        assert_eq!(release(&mut core, 1, ms(1401)).len(), 1, "what was seen is old");
    }
}

#[test]
fn what_is_old_begins_nothing_and_holds_nothing() {
    let mut core = core();
    let held =
        |at_ns| Call::Ask { id: 1, request: go(), process: None, held: true, at_ns: Some(at_ns), pressed_ns: None };
    let refused = sent(&mut core, 1, ms(300), &held(ms(0)));
    match &refused[..] {
        [Action::Send { reply: Reply::Answer { accepted, reason, .. }, .. }] => {
            assert_eq!((*accepted, *reason), (Accepted::Refused, Reason::HeldTooOld { age_s: 0.3 }.code()));
        }
        other => panic!("{other:?}"),
    }
    assert!(!core.is_held());
    // A young one begins, and its age counts.
    let begun = sent(&mut core, 1, ms(300), &held(ms(100)));
    let Some(Action::Ask { ticket, .. }) = begun.get(1) else { panic!("{begun:?}") };
    answered(&mut core, ms(301), *ticket, accepted());
    let beat = |at_ns| Call::Beat { at_ns: Some(at_ns) };
    // Signs that come late, or from the future, extend nothing beyond their instant.
    sent(&mut core, 1, ms(350), &beat(ms(40)));
    sent(&mut core, 1, ms(360), &beat(ms(60)));
    assert!(ends(&core.step(ms(399), Event::Tick)).is_empty());
    sent(&mut core, 1, ms(399), &beat(ms(200)));
    assert!(ends(&core.step(ms(499), Event::Tick)).is_empty());
    sent(&mut core, 1, ms(499), &beat(u64::MAX));
    assert!(ends(&core.step(ms(798), Event::Tick)).is_empty());
    assert_eq!(ends(&core.step(ms(799), Event::Tick)).len(), 1);
}

#[test]
fn what_motor_io_does_is_observed_while_a_client_that_held_is_there() {
    let mut core = core();
    let subscribed = |actions: &[Action]| {
        actions
            .iter()
            .any(|one| matches!(one, Action::Subscribe { client: NO_CLIENT, channel, .. } if channel == OBSERVED))
    };
    let ask =
        |client| Call::Ask { id: client, request: jog(), process: None, held: true, at_ns: None, pressed_ns: None };
    assert!(subscribed(&sent(&mut core, 1, ms(0), &ask(1))));
    assert!(!subscribed(&sent(&mut core, 2, ms(0), &ask(2))));
    let ended =
        |actions: Vec<Action>| actions.iter().any(|one| matches!(one, Action::Unsubscribe { client: NO_CLIENT, .. }));
    assert!(!ended(core.step(ms(1), Event::Gone { client: 1 })));
    assert!(ended(core.step(ms(2), Event::Gone { client: 2 })));
}

/// What is done about the deposit with motor-io, with the instant at which it is due; `None`: it is withdrawn.
fn deposits(actions: &[Action]) -> Vec<Option<(u8, u64)>> {
    let of = |action: &Action| match action {
        Action::Deposit { due_ns, request, .. } => Some(Some((request.body.verb, *due_ns))),
        Action::Withdraw => Some(None),
        _ => None,
    };
    actions.iter().filter_map(of).collect()
}

#[test]
fn what_ends_a_held_motion_is_deposited_before_it_begins_and_until_its_end_is_answered() {
    for (request, end) in [(jog(), RequestBody::VERB_HOLD), (go(), RequestBody::VERB_STOP)] {
        let mut core = core();
        let ask = Call::Ask { id: 1, request, process: None, held: true, at_ns: None, pressed_ns: None };
        let asked = sent(&mut core, 1, ms(0), &ask);
        let [Action::Deposit { .. }, Action::Ask { ticket, .. }, ..] = asked[..] else { panic!("{asked:?}") };
        assert_eq!(deposits(&asked), [Some((end, ms(300)))]);
        // It is renewed while the client sends signs, so that it is never due before.
        let (mut due_ns, mut renewals) = (ms(300), 0);
        answered(&mut core, ms(1), ticket, accepted());
        for at in (20..2000).step_by(20) {
            let mut actions = sent(&mut core, 1, ms(at), &Call::Beat { at_ns: None });
            actions.extend(core.step(ms(at), Event::Tick));
            for deposit in deposits(&actions) {
                let (verb, then_ns) = deposit.expect("the motion goes on");
                assert_eq!((verb, then_ns), (end, ms(at) + 300_000_000));
                (due_ns, renewals) = (then_ns, renewals + 1);
            }
            assert!(due_ns > ms(at) + 200_000_000, "{at}");
        }
        assert!((20..=50).contains(&renewals), "{renewals}");
        // Its end is sent; the deposit stays until that is answered, and is not renewed.
        let released = sent(&mut core, 1, ms(2000), &Call::Release { id: 2 });
        let Some(Action::Ask { ticket, .. }) = released.iter().find(|one| matches!(one, Action::Ask { .. })) else {
            panic!("{released:?}")
        };
        assert!(deposits(&released).is_empty() && deposits(&core.step(ms(2100), Event::Tick)).is_empty());
        assert!(core.is_ending());
        assert_eq!(deposits(&answered(&mut core, ms(2101), *ticket, accepted())), [None]);
        assert!(!core.is_ending() && deposits(&core.step(ms(2400), Event::Tick)).is_empty());
    }
}

/// The only request among the actions.
fn ticket(actions: &[Action]) -> Ticket {
    let asked = |action: &Action| match action {
        Action::Ask { ticket, .. } => Some(*ticket),
        _ => None,
    };
    let asked: Vec<_> = actions.iter().filter_map(asked).collect();
    let [ticket] = asked[..] else { panic!("{actions:?}") };
    ticket
}

#[test]
fn an_end_that_did_not_reach_motor_io_leaves_the_deposit_to_fall_due() {
    let why = || detail("the stop cannot be sent");
    let of_gateway = [
        Reason::RobotUnreached { why: why() },
        Reason::NotAsked { why: why() },
        Reason::NoRobotRuns { robot: detail("lab") },
        Reason::GatewayBusy { most: 16 },
    ];
    for (request, end) in [(jog(), RequestBody::VERB_HOLD), (go(), RequestBody::VERB_STOP)] {
        for reason in &of_gateway {
            let mut core = core();
            let begun = asked(&mut core, 1, request.clone(), true, ms(0));
            answered(&mut core, ms(1), begun, accepted());
            // Deposited again, due at 360 ms.
            sent(&mut core, 1, ms(60), &Call::Beat { at_ns: None });
            let lost = ticket(&sent(&mut core, 1, ms(70), &Call::Release { id: 2 }));
            assert!(deposits(&answered(&mut core, ms(71), lost, reason.answer())).is_empty(), "{reason}");
            for at in (80..1000).step_by(10) {
                assert!(deposits(&core.step(ms(at), Event::Tick)).is_empty(), "{reason} {at}");
            }
            // The next motion has a deposit of its own, which is withdrawn as ever.
            let begun = asked(&mut core, 1, request.clone(), true, ms(1000));
            answered(&mut core, ms(1001), begun, accepted());
            let ended = ticket(&sent(&mut core, 1, ms(1010), &Call::Release { id: 2 }));
            assert_eq!(deposits(&answered(&mut core, ms(1011), ended, accepted())), [None]);
            // A motion that is refused meanwhile does not take the deposit away: the first one may go on.
            let begun = asked(&mut core, 1, request.clone(), true, ms(2000));
            answered(&mut core, ms(2001), begun, accepted());
            let lost = ticket(&sent(&mut core, 1, ms(2010), &Call::Release { id: 2 }));
            answered(&mut core, ms(2011), lost, reason.answer());
            let ask =
                Call::Ask { id: 1, request: request.clone(), process: None, held: true, at_ns: None, pressed_ns: None };
            let refused = sent(&mut core, 2, ms(2020), &ask);
            assert_eq!(deposits(&refused), [Some((end, ms(2320)))]);
            let refused = answered(&mut core, ms(2021), ticket(&refused), Reason::RobotJogging.answer());
            assert!(deposits(&refused).is_empty() && deposits(&core.step(ms(2319), Event::Tick)).is_empty());
        }
    }
}

#[test]
fn a_motion_that_begins_after_its_end_is_ended_again_and_its_deposit_stays() {
    for ends_gateway in [false, true] {
        let mut core = core();
        let begun = asked(&mut core, 1, jog(), true, ms(0));
        let released = match ends_gateway {
            true => core.step(ms(10), Event::Ending),
            false => sent(&mut core, 1, ms(10), &Call::Release { id: 2 }),
        };
        // motor-io holds already, and has not read the jog.
        assert!(deposits(&answered(&mut core, ms(11), ticket(&released), accepted())).is_empty());
        assert!(core.is_ending());
        // A gateway that dies now leaves a deposit that is due after the jog has begun.
        assert_eq!(deposits(&core.step(ms(60), Event::Tick)), [Some((RequestBody::VERB_HOLD, ms(360)))]);
        let again = answered(&mut core, ms(70), begun, accepted());
        assert_eq!(ends(&again), [(RequestBody::VERB_HOLD, "ada".to_owned())]);
        assert!(deposits(&again).is_empty() && core.is_ending());
        assert_eq!(deposits(&answered(&mut core, ms(80), ticket(&again), accepted())), [None]);
        assert!(!core.is_ending());
        // One that is refused is over, and nothing is told again.
        let begun = asked(&mut core, 1, jog(), true, ms(1000));
        let released = sent(&mut core, 1, ms(1010), &Call::Release { id: 2 });
        answered(&mut core, ms(1011), ticket(&released), accepted());
        let refused = answered(&mut core, ms(1020), begun, Reason::RobotMoves.answer());
        assert!(ends(&refused).is_empty() && !core.is_ending());
        assert_eq!(deposits(&refused), [None]);
    }
}

#[test]
fn a_motion_without_a_deposit_is_not_requested() {
    let mut core = core();
    let ask = Call::Ask { id: 1, request: jog(), process: None, held: true, at_ns: None, pressed_ns: None };
    let asked_for = sent(&mut core, 1, ms(0), &ask);
    let [Action::Deposit { ticket: of, .. }, ..] = asked_for[..] else { panic!("{asked_for:?}") };
    assert_eq!(of, ticket(&asked_for));
    let refused = core.step(ms(1), Event::Undeposited { ticket: of });
    let unreached = Reason::RobotUnreached { why: detail("") }.code();
    let is_refusal = |one: &Action| matches!(one, Action::Send { client: 1, reply: Reply::Answer { accepted: Accepted::Refused, reason, .. }, .. } if *reason == unreached);
    assert!(refused.iter().any(is_refusal), "{refused:?}");
    // Nothing is held, so nothing is ended, renewed or withdrawn.
    let later = core.step(ms(900), Event::Tick);
    assert!(!core.is_held() && !core.is_ending() && release(&mut core, 1, ms(901)).is_empty());
    assert!(deposits(&refused).is_empty() && deposits(&later).is_empty() && ends(&later).is_empty());
}

#[test]
fn a_deposit_never_stops_the_motion_of_another_client() {
    let mut core = core();
    // So that motor-io is observed.
    let first = asked(&mut core, 1, jog(), true, ms(0));
    assert_eq!(deposits(&answered(&mut core, ms(1), first, Reason::RobotMoves.answer())), [None]);
    moved(&mut core, ms(10), MotorAuthority::MODE_FOLLOWING, 3);
    let ask = Call::Ask { id: 1, request: go(), process: None, held: true, at_ns: None, pressed_ns: None };
    assert!(deposits(&sent(&mut core, 1, ms(20), &ask)).is_empty());
    assert!(deposits(&core.step(ms(80), Event::Tick)).is_empty());
    // Its own motion is under way before the answer has come.
    moved(&mut core, ms(500), MotorAuthority::MODE_HOLDING, 0);
    assert_eq!(deposits(&sent(&mut core, 2, ms(510), &ask)), [Some((RequestBody::VERB_STOP, ms(810)))]);
    moved(&mut core, ms(520), MotorAuthority::MODE_FOLLOWING, 4);
    assert_eq!(deposits(&core.step(ms(570), Event::Tick)), [Some((RequestBody::VERB_STOP, ms(870)))]);
}

#[test]
fn a_gateway_that_ends_ends_what_is_held() {
    let mut core = core();
    let jogs = asked(&mut core, 1, jog(), true, ms(0));
    answered(&mut core, ms(1), jogs, accepted());
    let ending = core.step(ms(10), Event::Ending);
    assert_eq!(ends(&ending), [(RequestBody::VERB_HOLD, "ada".to_owned())]);
    let Some(Action::Ask { ticket, .. }) = ending.first() else { panic!("{ending:?}") };
    assert!(core.is_ending() && !core.is_held());
    answered(&mut core, ms(20), *ticket, accepted());
    assert!(!core.is_ending());
}

#[test]
fn a_motion_that_is_asked_for_until_the_robot_rests_does_not_begin_after_the_stop_of_another_client() {
    let mut core = core();
    let attempt = |core: &mut Core, request: Request, held: bool, now_ns: u64| {
        let (at_ns, pressed_ns) = (Some(now_ns), Some(ms(100)));
        let call = Call::Ask { id: 1, request, process: None, held, at_ns, pressed_ns };
        let actions = sent(core, 1, now_ns, &call);
        actions.into_iter().find_map(|action| match action {
            Action::Ask { ticket, .. } => Some(Ok(ticket)),
            Action::Send { reply: Reply::Answer { reason, .. }, .. } => Some(Err(reason)),
            _ => None,
        })
    };
    // A stop of before the press has no effect on it.
    sent(
        &mut core,
        2,
        ms(50),
        &Call::Ask { id: 1, request: Request::Stop, process: None, held: false, at_ns: None, pressed_ns: None },
    );
    for (request, held) in [(go(), true), (go(), false), (jog(), true)] {
        let ticket = attempt(&mut core, request, held, ms(120)).unwrap().unwrap();
        answered(&mut core, ms(121), ticket, Reason::RobotMoves.answer());
    }
    sent(
        &mut core,
        2,
        ms(200),
        &Call::Ask { id: 2, request: Request::Hold, process: None, held: false, at_ns: None, pressed_ns: None },
    );
    for (request, held) in [(go(), true), (go(), false), (jog(), true), (Request::Resume, false)] {
        assert_eq!(attempt(&mut core, request, held, ms(260)), Some(Err(Reason::OvertakenByStop.code())));
    }
    assert!(matches!(attempt(&mut core, Request::Disarm, false, ms(260)), Some(Ok(_))));
}
