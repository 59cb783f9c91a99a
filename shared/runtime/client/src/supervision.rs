//! What the operator can ask of the supervisor, and how it travels in a request: one line of its text for each part.

use command::{Answer, Failure};
use config::Slot;
use messages::{OperatorRequest, put_text, text_of};
use std::path::PathBuf;

/// The name under which the supervisor joins the domain and is asked.
pub const SUPERVISOR: &str = "nims";

/// A request to the supervisor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SupervisorCommand {
    /// Start a process that does not run: a role (`controller`), a process of the table, or a `[[process]]` of the system file.
    Start {
        /// Which.
        name: String,
        /// For a controller or an estimator: the slot; otherwise the first free one.
        slot: Option<Slot>,
        /// For a controller or an estimator: a law, or the name of a `[[process]]` of that role; otherwise as configured.
        law: Option<String>,
    },
    /// End a process in good order.
    Stop {
        /// Which.
        name: String,
    },
    /// End a process in good order, if it runs, and start it again.
    Restart {
        /// Which.
        name: String,
    },
    /// Start a program that the system file does not know.
    Plug {
        /// What it shall be called.
        name: String,
        /// Where it runs.
        folder: PathBuf,
        /// Program and arguments.
        command: Vec<String>,
        /// In the place of one of that name, which is ended first.
        replace: bool,
    },
    /// End a process and forget it.
    Unplug {
        /// Which.
        name: String,
    },
    /// Another value of a parameter, for every process of its role, until the run ends.
    Set {
        /// Its key in the system file.
        key: String,
        /// As TOML.
        value: String,
    },
}

impl SupervisorCommand {
    /// The name in the request.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Start { name, .. }
            | Self::Stop { name }
            | Self::Restart { name }
            | Self::Plug { name, .. }
            | Self::Unplug { name } => name,
            Self::Set { key, .. } => key,
        }
    }

    /// The request as it travels.
    ///
    /// # Errors
    /// A part that has a line break, or more text than a request holds.
    pub fn to_request(&self) -> Answer<OperatorRequest> {
        let (verb, parts) = match self {
            Self::Start { name, slot, law } => (
                OperatorRequest::VERB_START_PROCESS,
                vec![
                    name.clone(),
                    slot.map(Slot::name).unwrap_or_default().to_owned(),
                    law.clone().unwrap_or_default(),
                ],
            ),
            Self::Stop { name } => (OperatorRequest::VERB_STOP_PROCESS, vec![name.clone()]),
            Self::Restart { name } => (OperatorRequest::VERB_RESTART_PROCESS, vec![name.clone()]),
            Self::Plug { name, folder, command, .. } => {
                let folder = folder.to_str().ok_or_else(|| {
                    Failure::BadInput(format!(
                        "the folder {} is no plain text; start from another one",
                        folder.display()
                    ))
                })?;
                let mut parts = vec![name.clone(), folder.to_owned()];
                parts.extend(command.iter().cloned());
                (OperatorRequest::VERB_PLUG, parts)
            }
            Self::Unplug { name } => (OperatorRequest::VERB_UNPLUG, vec![name.clone()]),
            Self::Set { key, value } => (OperatorRequest::VERB_SET, vec![key.clone(), value.clone()]),
        };
        if let Some(part) = parts.iter().find(|part| part.contains(['\n', '\0'])) {
            return Err(Failure::BadInput(format!("{part:?} has a line break, which a request cannot hold")));
        }
        let text = parts.join("\n");
        let mut request = crate::requests::plain(verb);
        request.args[0] = f64::from(u8::from(matches!(self, Self::Plug { replace: true, .. })));
        if text.len() > request.text.len() {
            return Err(Failure::BadInput(format!(
                "the command has {} bytes with its folder, and a request holds {}: put it into a script",
                text.len(),
                request.text.len()
            )));
        }
        put_text(&mut request.text, &text);
        Ok(request)
    }

    /// What a request asks; `None` if it is not for the supervisor, or cannot be understood.
    #[must_use]
    pub fn from_request(request: &OperatorRequest) -> Option<Self> {
        let text = text_of(&request.text);
        let mut parts = text.split('\n').map(str::to_owned);
        let name = parts.next().filter(|name| !name.is_empty())?;
        Some(match request.verb {
            OperatorRequest::VERB_START_PROCESS => {
                let slot = match parts.next().as_deref() {
                    None | Some("") => None,
                    Some(given) => Some([Slot::A, Slot::B].into_iter().find(|slot| slot.name() == given)?),
                };
                Self::Start { name, slot, law: parts.next().filter(|law| !law.is_empty()) }
            }
            OperatorRequest::VERB_STOP_PROCESS => Self::Stop { name },
            OperatorRequest::VERB_RESTART_PROCESS => Self::Restart { name },
            OperatorRequest::VERB_PLUG => {
                let folder = PathBuf::from(parts.next()?);
                Self::Plug { name, folder, command: parts.collect(), replace: request.args[0] == 1.0 }
            }
            OperatorRequest::VERB_UNPLUG => Self::Unplug { name },
            OperatorRequest::VERB_SET => Self::Set { key: name, value: parts.next()? },
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_asked_arrives() {
        let name = || "controller".to_owned();
        for asked in [
            SupervisorCommand::Start { name: name(), slot: None, law: None },
            SupervisorCommand::Start { name: name(), slot: Some(Slot::B), law: None },
            SupervisorCommand::Start { name: name(), slot: None, law: Some("preview".to_owned()) },
            SupervisorCommand::Start { name: name(), slot: Some(Slot::A), law: Some("preview".to_owned()) },
            SupervisorCommand::Stop { name: name() },
            SupervisorCommand::Restart { name: name() },
            SupervisorCommand::Plug {
                name: "wind".to_owned(),
                folder: "/home/someone".into(),
                command: vec!["python3".to_owned(), "wind.py".to_owned(), String::new(), "--port x".to_owned()],
                replace: true,
            },
            SupervisorCommand::Unplug { name: "wind".to_owned() },
            SupervisorCommand::Set { key: "controller.drive_lag_s".to_owned(), value: "[0.03, 0.04]".to_owned() },
        ] {
            assert_eq!(SupervisorCommand::from_request(&asked.to_request().unwrap()), Some(asked));
        }
    }

    #[test]
    fn what_a_request_cannot_hold_is_refused_and_not_cut() {
        let plug = |argument: String| SupervisorCommand::Plug {
            name: "wind".to_owned(),
            folder: "/".into(),
            command: vec!["sh".to_owned(), argument],
            replace: false,
        };
        assert!(plug("a\nb".to_owned()).to_request().is_err());
        assert!(plug("x".repeat(600)).to_request().unwrap_err().to_string().contains("512"));
        assert!(plug("x".repeat(500)).to_request().is_ok());
    }

    #[test]
    fn what_is_for_someone_else_or_has_no_sense_is_not_understood() {
        let mut request = SupervisorCommand::Stop { name: "planner".to_owned() }.to_request().unwrap();
        request.verb = OperatorRequest::VERB_ARM;
        assert_eq!(SupervisorCommand::from_request(&request), None);
        request.verb = OperatorRequest::VERB_START_PROCESS;
        put_text(&mut request.text, "controller\nc");
        assert_eq!(SupervisorCommand::from_request(&request), None, "there is no slot c");
        put_text(&mut request.text, "");
        assert_eq!(SupervisorCommand::from_request(&request), None);
    }
}
