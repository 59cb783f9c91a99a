//! Requests of the operator to a process, each with one answer.

use std::time::Duration;

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{BackpressureStrategy, CallbackProgression, MessagingPattern, PortFactory as _, ipc};
use iceoryx2::service::builder::request_response::RequestResponseOpenOrCreateError;
use iceoryx2::service::port_factory::{request_response, server::ServerCreateError};
use messages::{OperatorRequest, RequestAnswer};

use crate::clock::{now_ns, sleep_until};
use crate::error::PlaceKind;
use crate::node::{Bus, failed, seconds};
use crate::places::{Refused, listed};
use crate::requester::sign;
use crate::shm_sample::ShmSample;
use crate::{BusError, Publisher};

type Request = ShmSample<OperatorRequest>;
type Factory = request_response::PortFactory<ipc::Service, Request, (), Request, ()>;

/// Commands of operators at once, each a process of its own; some of the places are kept for those that stop the robot.
const CLIENTS: usize = 24;
/// Requests of one client that a process has not answered, and responses to each.
const PENDING: usize = 2;
const RESPONSES: usize = 1;
/// What a process that answers takes: an answer for each request that may be under way, and its connections.
const MEMORY_BYTES: usize = 512 << 10;
/// How often a client looks for the answer: far shorter than a person notices.
const LOOK_NS: u64 = 2_000_000;
/// Where every request and its answer are published.
const REQUESTS: &str = "operator/request";

/// The channel name to wait for with [`Bus::waiter`]: woken by every request to that process.
#[must_use]
pub fn request_event(process: &str) -> String {
    format!("system/request/{process}")
}

/// Answers requests; polled, never blocking. Publishes each request and its answer on `operator/request`.
#[derive(Debug)]
pub struct Server {
    port: iceoryx2::port::server::Server<ipc::Service, Request, (), Request, ()>,
    log: Publisher<OperatorRequest>,
    event: String,
}

/// A request that waits for its answer.
#[derive(Debug)]
pub struct Call<'a> {
    /// What is asked.
    pub request: OperatorRequest,
    /// Why the request is not on `operator/request`, where it could not be published: no reason not to carry it out.
    pub unlogged: Option<BusError>,
    active: ActiveRequest<ipc::Service, Request, (), Request, ()>,
    log: &'a mut Publisher<OperatorRequest>,
}

/// Asks one process.
#[derive(Debug)]
pub struct Client {
    port: iceoryx2::port::client::Client<ipc::Service, Request, (), Request, ()>,
    service: Factory,
    notifier: Notifier<ipc::Service>,
    process: String,
    domain: String,
    asked: u64,
}

impl Bus {
    fn open_requests(&self, process: &str) -> Result<Factory, BusError> {
        let channel = request_event(process);
        let name = crate::node::service_name(&channel)?;
        self.need(MEMORY_BYTES, &channel)?;
        let give_up = now_ns() + 4 * crate::clock::SECOND_NS;
        loop {
            let made = self
                .node
                .service_builder(&name)
                .request_response::<Request, Request>()
                .max_servers(1)
                .max_clients(CLIENTS)
                .max_nodes(CLIENTS + 8)
                .max_active_requests_per_client(PENDING)
                .max_response_buffer_size(RESPONSES)
                .max_borrowed_responses_per_pending_response(RESPONSES)
                .max_loaned_requests(1)
                .enable_safe_overflow_for_requests(true)
                .enable_safe_overflow_for_responses(true)
                // a stop that was asked for while the process stood still is not forgotten with the one who asked
                .enable_fire_and_forget_requests(true)
                .open_or_create();
            match made {
                Ok(service) => return Ok(service),
                Err(RequestResponseOpenOrCreateError::RequestResponseOpenError(
                    iceoryx2::service::builder::request_response::RequestResponseOpenError::IncompatibleRequestOrResponseType,
                )) => {
                    return Err(BusError::TypeMismatch {
                        channel,
                        found: "another OperatorRequest".to_owned(),
                        wanted: <OperatorRequest as messages::Message>::type_name().to_owned(),
                        holders: process.to_owned(),
                    });
                }
                Err(error) if now_ns() > give_up => return Err(failed(&channel, "be opened", &error)),
                Err(_) => {
                    self.domain().remove_half_made();
                    sleep_until(now_ns() + LOOK_NS);
                }
            }
        }
    }

    /// Answers requests to `process`, normally this process's own name. Wait for [`request_event`] to be woken.
    ///
    /// # Errors
    /// [`BusError::Full`] if a process of that name answers already.
    pub fn server(&self, process: &str) -> Result<Server, BusError> {
        let event = request_event(process);
        let service = self.open_requests(process)?;
        let make = || {
            service
                .server_builder()
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .name(&self.port_name)
                .create()
        };
        let refused = |error| match error {
            ServerCreateError::ExceedsMaxSupportedServers => BusError::Full {
                channel: event.clone(),
                limit: 1,
                what: PlaceKind::Server,
                holders: format!("another `{process}`"),
            },
            other => failed(&event, "be answered", &other),
        };
        let port = self.whole(&event, || make().or_else(|_| self.after_cleaning(make)).map_err(refused))?;
        Ok(Server { port, log: self.publisher(REQUESTS)?, event })
    }

    /// Asks `process`.
    ///
    /// # Errors
    /// Those of opening a channel; that nobody answers shows in [`Client::ask`].
    pub fn client(&self, process: &str) -> Result<Client, BusError> {
        let event = request_event(process);
        let service = self.open_requests(process)?;
        let make = || {
            service
                .client_builder()
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .name(&self.port_name)
                .create()
        };
        let taken = || {
            listed(|note| {
                service.dynamic_config().list_clients(|port| {
                    note(port.client_name);
                    CallbackProgression::Continue
                });
            })
        };
        let refused = |refused| match refused {
            Refused::NoPlace(limit) => self.full(&event, MessagingPattern::RequestResponse, limit, PlaceKind::Clients),
            Refused::Error(error) => failed(&event, "be asked", &error),
        };
        let port = self.whole(&event, || self.take_place(CLIENTS, taken, make).map_err(refused))?;
        let notifier = self.notifier(&event)?;
        Ok(Client {
            port,
            service,
            notifier,
            process: process.to_owned(),
            domain: self.domain().name().to_owned(),
            asked: 0,
        })
    }
}

impl Server {
    /// The next request, if one has come. A call that is dropped unanswered lets its client wait in vain.
    ///
    /// # Errors
    /// [`BusError::Failed`] only if shared memory is damaged.
    pub fn try_next(&mut self) -> Result<Option<Call<'_>>, BusError> {
        // a first failure means that one client has just died
        let active = self
            .port
            .receive()
            .or_else(|_| self.port.receive())
            .map_err(|error| failed(&self.event, "receive", &error))?;
        let Some(active) = active else { return Ok(None) };
        let ShmSample(request) = *active.payload();
        let mut published = request;
        let unlogged = self.log.send(&mut published).err();
        Ok(Some(Call { request, unlogged, active, log: &mut self.log }))
    }

    /// Publishes a request that has come another way, and its answer.
    ///
    /// # Errors
    /// [`BusError::Failed`] if they could not be published.
    pub fn record(&mut self, request: &OperatorRequest, answer: &RequestAnswer) -> Result<(), BusError> {
        let mut published = *request;
        self.log.send(&mut published)?;
        published.put_answer(answer);
        published.header.stamp_ns = now_ns();
        self.log.send(&mut published).map(|_| ())
    }

    /// The event that a request raises: give it to [`Bus::waiter`].
    #[must_use]
    pub fn event(&self) -> &str {
        &self.event
    }
}

impl Call<'_> {
    /// False once the client has gone, or has given up waiting.
    #[must_use]
    pub fn is_awaited(&self) -> bool {
        self.active.is_connected()
    }

    /// Sends the answer and publishes it. A client that has gone meanwhile is no error.
    ///
    /// # Errors
    /// [`BusError::Failed`] if the request or its answer could not be published; the client has the answer all the same.
    pub fn answer(self, answer: &RequestAnswer) -> Result<(), BusError> {
        let (mut answer, given) = (self.request, answer);
        answer.put_answer(given);
        answer.header.stamp_ns = now_ns();
        let _ = self.active.send_copy(ShmSample(answer));
        let logged = self.log.send(&mut answer).map(|_| ());
        self.unlogged.map_or(logged, Err)
    }
}

impl Client {
    /// Sends a request and waits for the answer: the same request with `answered`, `accepted` and `answer` filled in.
    ///
    /// Fills in `header`, `pid`, `uid` and, where they are empty, `id` and `requester`.
    ///
    /// # Errors
    /// [`BusError::NoServer`] at once if nobody answers under that name, [`BusError::NoAnswer`] after `timeout` or as soon as the process dies.
    pub fn ask(&mut self, request: &OperatorRequest, timeout: Duration) -> Result<OperatorRequest, BusError> {
        self.ask_aloud(request, timeout, timeout, || ())
    }

    /// [`Client::ask`], but calls `uneasy` once if there is no answer after `patience`, and goes on waiting.
    ///
    /// # Errors
    /// As [`Client::ask`].
    pub fn ask_aloud(
        &mut self,
        request: &OperatorRequest,
        timeout: Duration,
        patience: Duration,
        uneasy: impl FnOnce(),
    ) -> Result<OperatorRequest, BusError> {
        let absent = || BusError::NoServer { process: self.process.clone(), domain: self.domain.clone() };
        if self.service.dynamic_config().number_of_servers() == 0 {
            return Err(absent());
        }
        self.asked += 1;
        let mut sent = *request;
        sent.header.seq = self.asked;
        sign(&mut sent);
        let started = sent.header.stamp_ns;
        let pending = self
            .port
            .send_copy(ShmSample(sent))
            .map_err(|error| failed(&request_event(&self.process), "be asked", &error))?;
        let _ = self.notifier.notify();
        if pending.number_of_server_connections() == 0 {
            return Err(absent());
        }
        let late = |why| BusError::NoAnswer { process: self.process.clone(), seconds: seconds(timeout), why };
        let after = |time: Duration| started + time.as_nanos().min(u128::from(u64::MAX / 4)) as u64;
        let (deadline, uneasy_at) = (after(timeout), after(patience));
        let mut uneasy = Some(uneasy);
        loop {
            match pending.receive() {
                Ok(Some(answer)) => return Ok(answer.payload().0),
                Ok(None) => {}
                Err(error) => return Err(failed(&request_event(&self.process), "be answered", &error)),
            }
            if now_ns() >= deadline {
                return Err(late("is busy or has died"));
            }
            if now_ns() >= uneasy_at
                && let Some(say) = uneasy.take()
            {
                say();
            }
            if self.service.dynamic_config().number_of_servers() == 0 {
                return Err(late("has ended meanwhile"));
            }
            sleep_until(now_ns() + LOOK_NS);
        }
    }

    /// Ends this client without taking its unanswered requests back: a process that has stood still meanwhile still finds them, until the
    /// next sweep. For a program that is about to end.
    pub fn leave_behind(self) {
        std::mem::forget(self);
    }
}
