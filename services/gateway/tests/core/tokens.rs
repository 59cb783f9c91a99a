//! Tokens: their role, and their end.

use super::*;

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
fn a_code_is_used_when_its_token_is_stored_and_not_before() {
    let mut core = core();
    connected(&mut core, 1, "nims");
    let add = Call::CodeAdd { id: 1, name: "ada".to_owned(), role: "fly".to_owned() };
    let made = core.step(0, Event::Received { client: 1, bytes: &framed(&add, &[]) });
    let [Action::Send { reply: Reply::Code { code, .. }, .. }] = &made[..] else { panic!("{made:?}") };
    let give = Call::CodeUse { id: 2, code: code.clone() };
    assert_eq!(reason(&changed(&mut core, &give, Err("the disk is full".to_owned()))), 463);
    let paired = changed(&mut core, &give, Ok(()));
    assert!(matches!(&paired[..], [Action::Send { reply: Reply::Token { .. }, .. }]), "{paired:?}");
    assert_eq!(reason(&core.step(0, Event::Received { client: 1, bytes: &framed(&give, &[]) })), 481);
}
