//! The calls that manage tokens, and what they end.

use super::{Connection, Core, Holder};
use crate::codes::Codes;
use crate::events::{Action, ClientId, TokenChange};
use crate::roles::Role;
use crate::tokens::{NO_RANDOM, Tokens, random};
use gateway_protocol::{Call, Reply};
use robot_state::Reason;
use robot_state::answers::detail;

impl Core {
    pub(super) fn token_call(&mut self, client: ClientId, holder: &Holder, call: Call) {
        let id = call.id();
        if holder.role < Role::Owner {
            let (verb, user) = (detail("manage tokens"), detail(&holder.user));
            return self.refuse(client, id, Reason::OwnerOnly { verb, user });
        }
        // A second change would be made from tokens without the first one.
        if self.changing && !matches!(call, Call::TokenList { .. }) {
            return self.refuse(client, id, Reason::GatewayBusy { most: 1 });
        }
        if let Call::CodeAdd { name, role, .. } = call {
            let code = self.code(&name, &role);
            return match code {
                Ok(code) => self.send(client, Reply::Code { id, code, valid_s: Codes::VALID_S }),
                Err(why) => self.refuse(client, id, Reason::NotAsked { why: detail(why) }),
            };
        }
        let mut tokens = self.tokens.clone();
        let changed = match call {
            Call::TokenAdd { name, role, .. } => {
                tokens.add(&name, &role).map(|secret| (Reply::Token { id, secret }, None))
            }
            Call::TokenRevoke { name, .. } => tokens.revoke(&name).map(|()| (Reply::Done { id }, Some(name))),
            _ => return self.send(client, Reply::Tokens { id, tokens: self.tokens.rows() }),
        };
        self.store(client, id, tokens, changed, None);
    }

    /// Begins to store changed tokens. `paired`: the holder whose code is used with it.
    fn store(
        &mut self,
        client: ClientId,
        id: u64,
        tokens: Tokens,
        changed: Result<(Reply, Option<String>), String>,
        paired: Option<String>,
    ) {
        match changed {
            Ok((reply, revoked)) => {
                self.changing = true;
                let change = TokenChange { client, id, tokens, reply, revoked, paired };
                self.actions.push(Action::StoreTokens(Box::new(change)));
            }
            Err(why) => self.refuse(client, id, Reason::NotAsked { why: detail(why) }),
        }
    }

    fn code(&mut self, name: &str, role: &str) -> Result<String, String> {
        // So that the code cannot fail later.
        self.tokens.clone().add(name, role)?;
        self.codes.add(self.now_ns, name, role, random().ok_or(NO_RANDOM)?)
    }

    /// A token for a code: everyone who opens a page may try, a few times.
    pub(super) fn code_use(&mut self, client: ClientId, id: u64, holder: &Holder, code: &str) {
        if self.changing {
            return self.refuse(client, id, Reason::GatewayBusy { most: 1 });
        }
        match self.codes.holder(self.now_ns, holder.from, code) {
            Ok((name, role)) => {
                let mut tokens = self.tokens.clone();
                let added = tokens.add(&name, &role).map(|secret| (Reply::Token { id, secret }, None));
                self.store(client, id, tokens, added, Some(name));
            }
            Err(reason) => self.refuse(client, id, reason),
        }
    }

    pub(super) fn stored(&mut self, change: TokenChange, stored: Result<(), String>) {
        let TokenChange { client, id, tokens, reply, revoked, paired } = change;
        self.changing = false;
        if let Err(why) = stored {
            return self.refuse(client, id, Reason::DiskRefused { why: detail(why) });
        }
        self.tokens = tokens;
        paired.into_iter().for_each(|name| self.codes.used(&name));
        if let Some(name) = revoked {
            self.close_holders(&name);
        }
        self.send(client, reply);
    }

    /// Closes the connections of a token that was revoked.
    fn close_holders(&mut self, name: &str) {
        let by_it = |one: &Connection| one.holder.as_ref().is_some_and(|holder| holder.by_token && holder.user == name);
        let held: Vec<_> = self.connections.iter().filter(|(_, one)| by_it(one)).map(|(client, _)| *client).collect();
        held.into_iter().for_each(|client| self.refuse_and_close(client, Reason::TokenInvalid));
    }
}
