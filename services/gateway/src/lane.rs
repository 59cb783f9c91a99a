//! Requests to one process of the robot: those that wait, those that were sent, and their answers.

use crate::events::Ticket;
use bus::{BusError, Client, Pending};
use client::ANSWER;
use messages::{OperatorRequest, RequestAnswer, RequestBody};
use robot_state::Reason;
use robot_state::answers::detail;
use std::collections::VecDeque;

/// Largest number of requests to one process that wait for the answers to earlier ones.
const WAITING: usize = 16;

/// Requests to one process. Those that stop the robot have a client of their own, which no other request can fill.
pub(crate) struct Lane {
    client: Client,
    pending: Vec<(Vec<Ticket>, Pending)>,
    waiting: VecDeque<Waiting>,
    /// Answers that have arrived otherwise than by a poll.
    answered: Vec<(Ticket, Box<RequestAnswer>)>,
}

/// A request that waits for its turn. Equal stops wait as one.
#[derive(Debug)]
pub(crate) struct Waiting {
    pub(crate) tickets: Vec<Ticket>,
    pub(crate) request: Box<OperatorRequest>,
    pub(crate) asked_ns: u64,
}

impl Waiting {
    /// Why it is not sent any more: it would begin a motion that its client does not expect any longer. `stopped` is
    /// the last call that stops the robot.
    pub(crate) fn refusal(&self, now_ns: u64, stopped: Ticket, is_wanted: impl Fn(Ticket) -> bool) -> Option<Reason> {
        if self.request.body.is_stop() {
            return None;
        }
        let disarms = self.request.body.verb == RequestBody::VERB_DISARM;
        if !disarms && self.tickets.iter().any(|ticket| *ticket < stopped) {
            return Some(Reason::OvertakenByStop);
        }
        if now_ns >= self.asked_ns + ANSWER.as_nanos() as u64 {
            return Some(Reason::WaitedTooLong { within_s: ANSWER.as_secs_f64() });
        }
        if !self.tickets.iter().any(|ticket| is_wanted(*ticket)) {
            return Some(Reason::RequesterGone);
        }
        None
    }
}

impl Lane {
    pub(crate) fn new(client: Client) -> Self {
        Self { client, pending: Vec::new(), waiting: VecDeque::new(), answered: Vec::new() }
    }

    /// Adds a request. A stop is never refused: it waits together with an equal one.
    pub(crate) fn add(&mut self, added: Waiting) -> Result<(), Box<RequestAnswer>> {
        let verb = added.request.body.verb;
        if added.request.body.is_stop() {
            match self.waiting.iter_mut().find(|one| one.request.body.verb == verb) {
                Some(equal) => equal.tickets.extend(added.tickets),
                None => self.waiting.push_back(added),
            }
        } else if self.waiting.len() >= WAITING {
            return Err(Box::new(Reason::GatewayBusy { most: WAITING }.answer()));
        } else {
            self.waiting.push_back(added);
        }
        Ok(())
    }

    /// Returns whether requests were sent that have no answer yet.
    pub(crate) fn has_sent(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Returns whether it needs a poll.
    pub(crate) fn is_busy(&self) -> bool {
        self.has_sent() || !self.waiting.is_empty() || !self.answered.is_empty()
    }

    /// The calls without an answer.
    pub(crate) fn unanswered(&self) -> impl Iterator<Item = Ticket> {
        let sent = self.pending.iter().flat_map(|(tickets, _)| tickets).copied();
        sent.chain(self.waiting.iter().flat_map(|waiting| &waiting.tickets).copied())
    }

    /// Withdraws the requests that were sent and have no answer: their process sees that no client waits for them.
    pub(crate) fn withdraw(&mut self) {
        self.receive();
        let answer = Box::new(Reason::WithdrawnByStop.answer());
        let withdrawn = self.pending.drain(..).flat_map(|(tickets, _)| tickets);
        self.answered.extend(withdrawn.map(|ticket| (ticket, answer.clone())));
    }

    fn receive(&mut self) {
        let (client, answered) = (&self.client, &mut self.answered);
        self.pending.retain_mut(|(tickets, pending)| {
            let answer = match client.poll(pending) {
                Ok(None) => return true,
                Ok(Some(answered)) => Box::new(answered.recorded_answer().unwrap_or_default()),
                Err(error) => failed(&error),
            };
            answered.extend(tickets.iter().map(|ticket| (*ticket, answer.clone())));
            false
        });
    }

    /// Sends what waits, and adds the answers that have arrived. `refusal`: why a request is not sent any more.
    pub(crate) fn poll(
        &mut self,
        refusal: impl Fn(&Waiting) -> Option<Reason>,
        now_ns: u64,
        answers: &mut Vec<(Ticket, Box<RequestAnswer>)>,
    ) {
        self.receive();
        answers.append(&mut self.answered);
        while self.pending.len() < Client::AT_ONCE
            && let Some(waiting) = self.waiting.pop_front()
        {
            let answer = match refusal(&waiting) {
                Some(reason) => Box::new(reason.answer()),
                None => {
                    // A stop always gets the whole time.
                    let waited = std::time::Duration::from_nanos(now_ns.saturating_sub(waiting.asked_ns));
                    let rest = if waiting.request.body.is_stop() { ANSWER } else { ANSWER.saturating_sub(waited) };
                    match self.client.begin(&waiting.request, rest) {
                        Ok(pending) => {
                            self.pending.push((waiting.tickets, pending));
                            continue;
                        }
                        Err(error) => failed(&error),
                    }
                }
            };
            answers.extend(waiting.tickets.iter().map(|ticket| (*ticket, answer.clone())));
        }
    }
}

/// The answer for a request that did not reach its process.
pub(crate) fn failed(error: &BusError) -> Box<RequestAnswer> {
    let why = detail(error);
    let reason = if error.is_bad_input() { Reason::NotAsked { why } } else { Reason::RobotUnreached { why } };
    Box::new(reason.answer())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::{Bus, Domain};
    use client::MOTOR_IO;
    use messages::Request;

    fn waiting(ticket: Ticket, request: Request) -> Waiting {
        Waiting { tickets: vec![ticket], request: Box::new(request.encode().unwrap()), asked_ns: 1000 }
    }

    #[test]
    fn a_motion_does_not_start_after_a_stop_or_without_its_client() {
        let late_ns = 1000 + ANSWER.as_nanos() as u64;
        let why = |request: Request, now_ns, stopped, wanted| waiting(7, request).refusal(now_ns, stopped, |_| wanted);
        assert_eq!(why(Request::Resume, 2000, 6, true), None);
        assert_eq!(why(Request::Resume, 2000, 8, true), Some(Reason::OvertakenByStop));
        let too_long = Reason::WaitedTooLong { within_s: ANSWER.as_secs_f64() };
        assert_eq!(why(Request::Resume, late_ns, 6, true), Some(too_long));
        assert_eq!(why(Request::Resume, 2000, 6, false), Some(Reason::RequesterGone));
        // A motion that a stop has overtaken is called so, however long it has waited.
        assert_eq!(why(Request::Resume, late_ns, 8, false), Some(Reason::OvertakenByStop));
        // A stop is sent in any case.
        for stop in [Request::Stop, Request::Hold, Request::Pause] {
            assert_eq!(why(stop, late_ns, 8, false), None);
        }
    }

    #[test]
    fn a_withdrawn_request_is_answered_and_its_process_sees_that_nobody_waits() {
        let domain = Domain::for_test();
        let bus = Bus::join(&domain, "planner").unwrap();
        let mut planner = bus.server("planner").unwrap();
        let mut lane = Lane::new(Bus::join(&domain, "gateway").unwrap().client("planner").unwrap());
        lane.add(waiting(1, Request::Resume)).unwrap();
        lane.add(waiting(2, Request::Reset)).unwrap();
        let mut answers = Vec::new();
        lane.poll(|_| None, 1000, &mut answers);
        // The first one is answered, and its answer is not lost.
        planner.try_next().unwrap().unwrap().answer(&Reason::Resumed.answer()).unwrap();
        assert!(answers.is_empty() && lane.has_sent());
        lane.withdraw();
        assert!(!lane.has_sent() && lane.is_busy());
        lane.poll(|_| None, 1000, &mut answers);
        let reasons: Vec<_> = answers.iter().map(|(ticket, answer)| (*ticket, answer.reason)).collect();
        assert_eq!(reasons, [(1, Reason::Resumed.code()), (2, Reason::WithdrawnByStop.code())]);
        assert!(planner.try_next().unwrap().is_none_or(|call| !call.is_awaited()));
    }

    #[test]
    fn stops_are_never_refused_and_equal_ones_wait_as_one() {
        let domain = Domain::for_test();
        let bus = Bus::join(&domain, "gateway").unwrap();
        let mut lane = Lane::new(bus.client(MOTOR_IO).unwrap());
        for ticket in 0..1000 {
            let request = if ticket % 2 == 0 { Request::Stop } else { Request::Hold };
            lane.add(waiting(ticket, request)).unwrap();
        }
        assert_eq!(lane.waiting.iter().map(|one| one.tickets.len()).collect::<Vec<_>>(), [500, 500]);
        let refused = (0..1000).filter(|ticket| lane.add(waiting(*ticket, Request::Reset)).is_err()).count();
        assert_eq!(lane.waiting.len() + refused, 1002);
        // Without a motor-io, each of them gets an answer.
        let mut answers = Vec::new();
        let give_up = bus::clock::now_ns() + 2 * ANSWER.as_nanos() as u64;
        while !lane.pending.is_empty() || !lane.waiting.is_empty() {
            lane.poll(|_| None, 1000, &mut answers);
            assert!(bus::clock::now_ns() < give_up);
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        assert_eq!(answers.len() + refused, 2000);
    }
}
