//! Refusals of requests, each with its reason in the catalogue of answers.

use bus::BusError;
use command::Failure;
use robot_state::Reason;
use robot_state::answers::detail;
use std::fmt::Display;

/// Refusal of a request.
#[derive(Debug)]
pub struct Refused(pub Box<Reason>);

/// Answer to a request, or what it needs.
pub type Decision<T = Reason> = Result<T, Refused>;

impl From<Reason> for Refused {
    fn from(reason: Reason) -> Self {
        Self(Box::new(reason))
    }
}

impl From<BusError> for Refused {
    fn from(error: BusError) -> Self {
        bus_failed(error)
    }
}

/// At start-up there is no request to answer.
impl From<Refused> for Failure {
    fn from(Refused(reason): Refused) -> Self {
        if reason.is_bad_input() { Self::BadInput(reason.to_string()) } else { Self::NotNow(reason.to_string()) }
    }
}

/// A process cannot be started.
pub fn not_started(process: &str, why: impl Display) -> Refused {
    Reason::ProcessNotStarted { process: detail(process), why: detail(why) }.into()
}

/// The supervisor cannot publish or receive what the request needs.
pub fn bus_failed(error: impl Display) -> Refused {
    Reason::SupervisorBus { why: detail(error) }.into()
}
