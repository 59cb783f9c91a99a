//! Requests of the operator to a process, each with one answer.

use std::time::Duration;

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{BackpressureStrategy, CallbackProgression, MessagingPattern, PortFactory as _, ipc};
use iceoryx2::service::builder::request_response::RequestResponseOpenOrCreateError;
use iceoryx2::service::port_factory::{request_response, server::ServerCreateError};
use messages::{OperatorRequest, RequestAnswer};

use crate::clock::{now_ns, sleep_until};
use crate::error::PlaceKind;
use crate::node::Bus;
use crate::places::{Refused, collect_listed};
use crate::requester::sign;
use crate::shm_sample::ShmSample;
use crate::{BusError, Publisher};

type Request = ShmSample<OperatorRequest>;
type Factory = request_response::PortFactory<ipc::Service, Request, (), Request, ()>;

/// Largest number of clients at once, each in its own process; some of the places are reserved for commands that stop
/// the robot.
const CLIENTS: usize = 24;
/// Largest number of unanswered requests of one client.
const PENDING: usize = 2;
/// Number of responses to each request.
const RESPONSES: usize = 1;
/// Memory of a server, bytes: an answer for each pending request, and its connections.
const MEMORY_BYTES: usize = 512 << 10;
/// Time between two polls for the answer, ns: far shorter than a person notices.
const POLL_NS: u64 = 2_000_000;
/// Channel on which every request and its answer are published.
const REQUESTS: &str = "operator/request";

/// Returns the name of the event, for [`Bus::waiter`], that every request to the process raises.
#[must_use]
pub fn request_event(process: &str) -> String {
    format!("system/request/{process}")
}

/// Receives requests without blocking. Publishes each request and its answer on `operator/request`.
#[derive(Debug)]
pub struct Server {
    port: iceoryx2::port::server::Server<ipc::Service, Request, (), Request, ()>,
    log: Publisher<OperatorRequest>,
    event: String,
}

/// A received request that must be answered.
#[derive(Debug)]
pub struct Call<'a> {
    /// The request.
    pub request: OperatorRequest,
    /// Why the request could not be published on `operator/request`. It is executed anyway.
    pub unlogged: Option<BusError>,
    active: ActiveRequest<ipc::Service, Request, (), Request, ()>,
    log: &'a mut Publisher<OperatorRequest>,
}

/// A request that was sent and has no answer yet.
#[derive(Debug)]
pub struct Pending {
    port: PendingResponse<ipc::Service, Request, (), Request, ()>,
    started_ns: u64,
    deadline_ns: u64,
}

/// Sends requests to one process.
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
        let give_up = self.give_up_ns();
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
                // A stop request to a suspended process remains if its sender ends.
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
                Err(error) if now_ns() > give_up => return Err(BusError::failed(&channel, "be opened", &error)),
                Err(_) => {
                    self.domain().remove_half_made();
                    sleep_until(now_ns() + POLL_NS);
                }
            }
        }
    }

    /// Creates the server for requests to `process`, normally this process's own name. A request raises
    /// [`request_event`].
    ///
    /// # Errors
    /// [`BusError::Full`] if the process already has a server.
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
            other => BusError::failed(&event, "be answered", &other),
        };
        let port = self.make_complete(&event, || make().or_else(|_| self.after_cleaning(make)).map_err(refused))?;
        Ok(Server { port, log: self.publisher(REQUESTS)?, event })
    }

    /// Creates a client for requests to `process`.
    ///
    /// # Errors
    /// Those of opening a channel; a missing server is an error of [`Client::ask`].
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
            collect_listed(|note| {
                service.dynamic_config().list_clients(|port| {
                    note(port.client_name);
                    CallbackProgression::Continue
                });
            })
        };
        let refused = |refused| match refused {
            Refused::NoPlace(limit) => self.full(&event, MessagingPattern::RequestResponse, limit, PlaceKind::Clients),
            Refused::Error(error) => BusError::failed(&event, "be asked", &error),
        };
        let port = self.make_complete(&event, || self.take_place(CLIENTS, taken, make).map_err(refused))?;
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
    /// Returns the next request, if there is one. If a call is dropped unanswered, its client waits until its timeout.
    ///
    /// # Errors
    /// [`BusError::Failed`] only if shared memory is damaged.
    pub fn try_next(&mut self) -> Result<Option<Call<'_>>, BusError> {
        // A first failure means that one client has just died.
        let active = self
            .port
            .receive()
            .or_else(|_| self.port.receive())
            .map_err(|error| BusError::failed(&self.event, "receive", &error))?;
        let Some(active) = active else { return Ok(None) };
        let ShmSample(request) = *active.payload();
        let mut published = request;
        let unlogged = self.log.send(&mut published).err();
        Ok(Some(Call { request, unlogged, active, log: &mut self.log }))
    }

    /// Publishes a request that was received on another path, and its answer.
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

    /// Returns the name of the event that a request raises, for [`Bus::waiter`].
    #[must_use]
    pub fn event(&self) -> &str {
        &self.event
    }
}

impl Call<'_> {
    /// Returns whether the client still waits; false if it has ended or timed out.
    #[must_use]
    pub fn is_awaited(&self) -> bool {
        self.active.is_connected()
    }

    /// Sends the answer and publishes it. It is no error if the client has ended.
    ///
    /// # Errors
    /// [`BusError::Failed`] if the request or its answer could not be published; the client receives the answer anyway.
    pub fn answer(self, answer: &RequestAnswer) -> Result<(), BusError> {
        let (mut answer, given) = (self.request, answer);
        answer.put_answer(given);
        answer.header.stamp_ns = now_ns();
        let _ = self.active.send_copy(ShmSample(answer));
        let logged = self.log.send(&mut answer).map(|_| ());
        self.unlogged.map_or(logged, Err)
    }
}

/// The instant that lies a time after another one, ns.
fn after(instant_ns: u64, time: Duration) -> u64 {
    instant_ns + time.as_nanos().min(u128::from(u64::MAX / 4)) as u64
}

impl Client {
    /// Largest number of unanswered requests.
    pub const AT_ONCE: usize = PENDING;

    /// Sends a request and waits for the answer: the same request with `answered`, `accepted` and `answer` filled in.
    ///
    /// Fills in `header` and, where they are empty, `pid` with `uid`, `id` and `requester`.
    ///
    /// # Errors
    /// [`BusError::NoServer`] at once if the process has no server, [`BusError::NoAnswer`] after `timeout` or when the
    /// process ends.
    pub fn ask(&mut self, request: &OperatorRequest, timeout: Duration) -> Result<OperatorRequest, BusError> {
        self.ask_aloud(request, timeout, timeout, || ())
    }

    /// As [`Client::ask`], but calls `uneasy` once if there is no answer after `patience`, and continues to wait.
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
        let mut pending = self.begin(request, timeout)?;
        let uneasy_at = after(pending.started_ns, patience);
        let mut uneasy = Some(uneasy);
        loop {
            if let Some(answer) = self.poll(&mut pending)? {
                return Ok(answer);
            }
            if now_ns() >= uneasy_at
                && let Some(say) = uneasy.take()
            {
                say();
            }
            sleep_until(now_ns() + POLL_NS);
        }
    }

    /// Sends a request without waiting; [`Client::poll`] returns its answer. A client has at most [`Client::AT_ONCE`]
    /// unanswered requests. Fills in the same fields as [`Client::ask`].
    ///
    /// # Errors
    /// [`BusError::NoServer`] if the process has no server, [`BusError::Failed`] with too many unanswered requests.
    pub fn begin(&mut self, request: &OperatorRequest, timeout: Duration) -> Result<Pending, BusError> {
        let absent = || BusError::NoServer { process: self.process.clone(), domain: self.domain.clone() };
        if self.service.dynamic_config().number_of_servers() == 0 {
            return Err(absent());
        }
        self.asked += 1;
        let mut sent = *request;
        sent.header.seq = self.asked;
        sign(&mut sent);
        let started_ns = sent.header.stamp_ns;
        let port = self
            .port
            .send_copy(ShmSample(sent))
            .map_err(|error| BusError::failed(&request_event(&self.process), "be asked", &error))?;
        let _ = self.notifier.notify();
        if port.number_of_server_connections() == 0 {
            return Err(absent());
        }
        Ok(Pending { port, started_ns, deadline_ns: after(started_ns, timeout) })
    }

    /// Returns the answer to a request of this client, if it has arrived; never waits.
    ///
    /// # Errors
    /// [`BusError::NoAnswer`] after the timeout or when the process has ended.
    pub fn poll(&self, pending: &mut Pending) -> Result<Option<OperatorRequest>, BusError> {
        let late = |why| {
            let seconds = (pending.deadline_ns - pending.started_ns) as f64 * 1e-9;
            BusError::NoAnswer { process: self.process.clone(), seconds, why }
        };
        match pending.port.receive() {
            Ok(Some(answer)) => return Ok(Some(answer.payload().0)),
            Ok(None) => {}
            Err(error) => return Err(BusError::failed(&request_event(&self.process), "be answered", &error)),
        }
        if now_ns() >= pending.deadline_ns {
            return Err(late("is busy or has died"));
        }
        if self.service.dynamic_config().number_of_servers() == 0 {
            return Err(late("has ended"));
        }
        Ok(None)
    }

    /// Ends this client without withdrawing its unanswered requests: a suspended process still receives them when it
    /// continues, until the next sweep. Only for a program that is about to end.
    pub fn leave_behind(self) {
        std::mem::forget(self);
    }
}
