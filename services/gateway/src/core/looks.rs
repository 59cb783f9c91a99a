//! What is found out or made for a client.

use super::{Core, Holder, OPENS_PER_S};
use crate::events::{Action, ClientId, Question};
use crate::robot_file::RobotTexts;
use crate::roles::Role;
use robot_state::Reason;
use robot_state::answers::detail;

impl Core {
    /// Begins to store the robot file in the body of a call, and the calibration after it.
    pub(super) fn robot_file(
        &mut self,
        now_ns: u64,
        (client, id): (ClientId, u64),
        holder: &Holder,
        (mut body, calibration_bytes): (Vec<u8>, Option<usize>),
        made_from: Option<String>,
    ) {
        let begins = calibration_bytes.map_or(Some(body.len()), |bytes| body.len().checked_sub(bytes));
        let rest = begins.map(|begins| body.split_off(begins)).unwrap_or_default();
        match (begins, String::from_utf8(body), String::from_utf8(rest)) {
            (Some(_), Ok(robot), Ok(calibration)) => {
                let texts = RobotTexts { robot, calibration: calibration_bytes.map(|_| calibration), made_from };
                self.look(now_ns, client, id, holder, Question::RobotFile(Box::new(texts)));
            }
            _ => {
                let why = detail("the body is not the text of a robot file with that of its calibration");
                self.refuse(client, id, Reason::NotAsked { why });
            }
        }
    }

    pub(super) fn look(&mut self, now_ns: u64, client: ClientId, id: u64, holder: &Holder, what: Question) {
        if let Some(verb) = of_pilots(&what).filter(|_| holder.role < Role::Fly) {
            let (needs, user, has) = (Role::Fly.name(), detail(&holder.user), holder.role.name());
            let (verb, needs, has) = (detail(verb), detail(needs), detail(has));
            return self.refuse(client, id, Reason::NotPermitted { verb, needs, user, has });
        }
        let Some(connection) = self.connections.get_mut(&client) else { return };
        let (lists, works) = (matches!(what, Question::Runs | Question::Files(_)), of_pilots(&what).is_some());
        if (lists && connection.listing.is_some()) || (works && connection.working.is_some()) {
            return self.refuse(client, id, Reason::GatewayBusy { most: 1 });
        }
        if matches!(what, Question::Open(..)) && !connection.opens.spend(now_ns) {
            return self.refuse(client, id, Reason::AskedTooOften { per_s: OPENS_PER_S });
        }
        connection.unanswered += 1;
        let ticket = self.ticket(client, id);
        if let Some(connection) = self.connections.get_mut(&client) {
            connection.listing = if lists { Some(ticket) } else { connection.listing };
            connection.working = if works { Some(ticket) } else { connection.working };
        }
        self.actions.push(Action::Look { ticket, what });
    }
}

/// What changes the folder of the runs or the robot file, or takes the machine for a while, for a sentence.
fn of_pilots(what: &Question) -> Option<&'static str> {
    match what {
        Question::Make(..) => Some("make files of a run"),
        Question::Remove(_) => Some("delete a run"),
        Question::Doctor => Some("check the machine"),
        Question::RobotFile(_) => Some("store a robot file"),
        _ => None,
    }
}
