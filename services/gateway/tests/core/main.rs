//! The core of the gateway: roles, limits and the protocol, with any bytes.

#![allow(clippy::unwrap_used, clippy::panic)]

mod connections;
mod plugins;
mod requests;
mod tokens;

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
    framed(&Call::Ask { id, request, process: None, held: false, at_ns: None, pressed_ns: None }, &[])
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
        Request::Mark { text: "a leaf moved".to_owned() },
        Request::Set { key: "controller.horizon_cycles".to_owned(), value: "3".to_owned() },
    ]
}
