//! What sensors publish: readings, and samples of their own messages.

use super::Core;
use crate::events::{Action, ClientId, Ticket};
use crate::roles::Role;
use gateway_protocol::{Call, Origin};
use robot_state::Reason;
use robot_state::answers::detail;

impl Core {
    /// Carries out a call of a sensor.
    pub(super) fn publish_call(&mut self, now_ns: u64, client: ClientId, call: Call, body: Vec<u8>) {
        let id = call.id();
        let name = match &call {
            Call::Publish { reading, .. } => &reading.sensor,
            Call::Declare { sensor, .. } | Call::Sample { sensor, .. } => sensor,
            _ => return,
        };
        if let Err(reason) = self.may_publish(client, name) {
            return self.refuse(client, id, reason);
        }
        let made = match call {
            Call::Publish { reading, .. } => self.sensors.reading(now_ns, client, &reading).map(|sample| {
                let (sensor, reading) = (reading.sensor, Box::new(sample));
                Box::new(|ticket| Action::Publish { ticket, sensor, reading }) as Box<dyn FnOnce(Ticket) -> Action>
            }),
            Call::Declare { sensor, message, .. } => {
                let may_add = self.owns(client);
                let declared = self.sensors.declare(now_ns, client, (&sensor, &message), &body, may_add);
                declared.map(|sensor| Box::new(|ticket| Action::Declare { ticket, sensor }) as Box<_>)
            }
            Call::Sample { sensor, stamp_ns, .. } => {
                let made = self.sensors.sample(now_ns, client, &sensor, stamp_ns, body.len());
                made.map(|(sensor, header)| {
                    Box::new(move |ticket| Action::PublishSample { ticket, sensor, header, sample: body }) as Box<_>
                })
            }
            _ => return,
        };
        match made {
            Ok(action) => {
                if let Some(connection) = self.connections.get_mut(&client) {
                    connection.unanswered += 1;
                }
                let ticket = self.ticket(client, id);
                self.actions.push(action(ticket));
            }
            Err(reason) => self.refuse(client, id, reason),
        }
    }

    /// Whether a client may publish for a sensor of this name.
    #[allow(clippy::result_large_err)] // it is the answer
    fn may_publish(&self, client: ClientId, sensor: &str) -> Result<(), Reason> {
        let unknown = || Reason::NotPublisher { user: detail("a client that is gone or has not said who it is") };
        let connection = self.connections.get(&client).ok_or_else(unknown)?;
        let holder = connection.holder.as_ref().ok_or_else(unknown)?;
        match &connection.peer.unit {
            Some(unit) if unit.robot == self.instance && unit.plugin == sensor => Ok(()),
            Some(unit) => {
                let plugin = detail(format_args!("the plug-in {}_{}", unit.robot, unit.plugin));
                Err(Reason::SensorOfAnother { plugin, sensor: detail(sensor) })
            }
            // A token stands for a person, not for the program that acts for it.
            None if holder.by_token || !self.roles.may_publish(&connection.peer, holder.origin) => {
                Err(Reason::NotPublisher { user: detail(&holder.user) })
            }
            None => Ok(()),
        }
    }

    /// Whether a client is the robot's user itself, who may publish in shared memory too.
    fn owns(&self, client: ClientId) -> bool {
        self.connections.get(&client).is_some_and(|connection| {
            let is_person = connection.holder.as_ref().is_some_and(|one| !one.by_token && one.origin != Origin::Page);
            is_person && connection.peer.unit.is_none() && self.roles.of(&connection.peer) == Role::Owner
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::roles::Roles;
    use crate::tokens::Tokens;

    #[test]
    fn a_client_that_is_gone_publishes_nothing() {
        let roles = Roles::new(900, config::GatewaySection::default());
        let core = Core::new("lab".to_owned(), roles, Tokens::default());
        assert!(matches!(core.may_publish(7, "soil"), Err(Reason::NotPublisher { .. })));
    }
}
