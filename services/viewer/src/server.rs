//! Accepts tools, and carries messages between them and the hub, in a thread of its own.

use std::io::Write;
use std::net::{SocketAddr, TcpListener as StdListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use futures_util::{FutureExt, Sink, SinkExt, StreamExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tokio_tungstenite::tungstenite::http::{HeaderValue, StatusCode, header::SEC_WEBSOCKET_PROTOCOL};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::{WebSocketStream, accept_hdr_async_with_config};

use crate::hub::Hub;
use crate::outbox::Outbox;
use crate::peer::Ends;
use crate::permission::Permission;
use crate::protocol::VERSIONS;

/// Largest number of tools at once, with those that have not finished their first request.
const TOOLS: usize = 16;
/// Longest time from the connection to the end of the first request.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// Longest time until a tool has taken one message: a tool that has stopped reading would keep its place for ever. The
/// largest message takes 10 s at 13 Mbit/s.
const SENDING: Duration = Duration::from_secs(10);
/// Largest request of a tool, bytes: a subscription to ten thousand channels has less.
const REQUEST_BYTES: usize = 1 << 20;
/// Largest number of connections that are judged together; more do not wait to be accepted.
const AT_ONCE: usize = 128;
/// Pause after refused connections, in times of the processor time that they took: who connects again and again gets
/// at most a fifth of a processor.
const PAUSE: u32 = 4;
/// Pause after the kernel cannot accept, e.g. because this process has too many open files.
const AGAIN: Duration = Duration::from_millis(100);

/// The thread; dropping it ends every connection, also that of a tool that has stopped reading.
#[derive(Debug)]
pub(crate) struct Server {
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts to accept.
    ///
    /// # Errors
    /// The operating system gives no thread or no event queue.
    pub(crate) fn start(listener: StdListener, hub: Arc<Hub>, permission: Permission) -> std::io::Result<Self> {
        listener.set_nonblocking(true)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        let (end, ended) = oneshot::channel();
        let thread = std::thread::Builder::new().name("tools".to_owned()).spawn(move || {
            runtime.block_on(async {
                match TcpListener::from_std(listener) {
                    Ok(listener) => tokio::select! {
                        () = accept(&listener, &hub, permission) => {}
                        _ = ended => {}
                    },
                    Err(error) => tracing::error!("no tool can connect: {error}; start the viewer again"),
                }
            });
        })?;
        Ok(Self { end: Some(end), thread: Some(thread) })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

async fn accept(listener: &TcpListener, hub: &Arc<Hub>, mut permission: Permission) {
    let places = Arc::new(Semaphore::new(TOOLS));
    let (mut full, mut failing) = (false, false);
    loop {
        let mut streams = Vec::new();
        match listener.accept().await {
            Ok((stream, _)) => streams.push(stream),
            Err(error) => {
                if !std::mem::replace(&mut failing, true) {
                    tracing::warn!("a tool cannot connect, retrying: {error}");
                }
                tokio::time::sleep(AGAIN).await;
                continue;
            }
        }
        failing = false;
        let begun = processor_time();
        while streams.len() < AT_ONCE
            && let Some(Ok((stream, _))) = listener.accept().now_or_never()
        {
            streams.push(stream);
        }
        // Both are unknown only of a connection that has ended already.
        let ends = |stream: &TcpStream| Some(Ends { own: stream.local_addr().ok()?, peer: stream.peer_addr().ok()? });
        let (ends, streams): (Vec<Ends>, Vec<TcpStream>) =
            streams.into_iter().filter_map(|stream| Some((ends(&stream)?, stream))).unzip();
        let mut refused = false;
        // Nothing is read from a connection and nothing is sent to it before.
        for ((admitted, Ends { peer, .. }), stream) in permission.admit(&ends).into_iter().zip(&ends).zip(streams) {
            match (admitted, places.clone().try_acquire_owned()) {
                (true, Ok(place)) => {
                    full = false;
                    tokio::spawn(serve(stream, *peer, hub.clone(), place));
                    continue;
                }
                (true, Err(_)) => {
                    if !std::mem::replace(&mut full, true) {
                        tracing::warn!("a tool at {peer} is refused, because {TOOLS} are connected; close one of them");
                    }
                    turn_away(stream, "503 Service Unavailable", "The viewer has no place for another tool.");
                }
                (false, _) => turn_away(stream, "403 Forbidden", "This user may not look; see the log of the viewer."),
            }
            refused = true;
        }
        if refused || ends.is_empty() {
            tokio::time::sleep(processor_time().saturating_sub(begun) * PAUSE).await;
        }
    }
}

/// Processor time of this thread so far.
fn processor_time() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec.unsigned_abs() as u32)
}

/// Answers without reading the request. If the request has arrived already, the kernel resets the connection after the
/// answer, and the tool may see the reset alone.
fn turn_away(stream: TcpStream, status: &str, sentence: &str) {
    let answer = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{sentence}\n",
        sentence.len() + 1
    );
    // Not by the runtime: whether it takes a new connection for one that can be written to is not documented. The write
    // does not block.
    let _ = stream.into_std().and_then(|mut stream| stream.write(answer.as_bytes()));
}

async fn serve(stream: TcpStream, peer: SocketAddr, hub: Arc<Hub>, _place: OwnedSemaphorePermit) {
    let _ = stream.set_nodelay(true);
    let config = WebSocketConfig::default().max_message_size(Some(REQUEST_BYTES)).max_frame_size(Some(REQUEST_BYTES));
    let handshake = accept_hdr_async_with_config(stream, choose_version, Some(config));
    let socket = match tokio::time::timeout(HANDSHAKE, handshake).await {
        Ok(Ok(socket)) => socket,
        Ok(Err(error)) => return tracing::debug!("no tool at {peer}: {error}"),
        Err(_) => return tracing::debug!("no tool at {peer}: no request in {HANDSHAKE:?}"),
    };
    let connected = Connected::to(&hub);
    let number = connected.number;
    tracing::debug!("tool {number} at {peer} has connected");
    let (sink, mut requests) = WebSocketStream::split(socket);
    let receive = async {
        while let Some(Ok(message)) = requests.next().await {
            if let Message::Text(text) = message {
                hub.request(number, &text);
            }
        }
    };
    tokio::select! {
        () = receive => {}
        () = send_all(&connected.outbox, sink, SENDING) => {}
    }
    tracing::debug!("tool {number} at {peer} has disconnected");
}

/// Sends what is in the outbox until the connection ends, or the tool does not take a message within `longest`.
async fn send_all(outbox: &Outbox, mut sink: impl Sink<Message> + Unpin, longest: Duration) {
    while let Ok(message) = outbox.next().await {
        match tokio::time::timeout(longest, sink.send(message)).await {
            Ok(Ok(())) => {}
            Ok(Err(_)) => return,
            Err(_) => return tracing::debug!("a tool has not taken a message in {longest:?}"),
        }
    }
}

/// A tool in the hub. Dropping it removes the tool, also after a panic of its connection.
struct Connected<'a> {
    hub: &'a Hub,
    number: u64,
    outbox: Arc<Outbox>,
}

impl<'a> Connected<'a> {
    fn to(hub: &'a Hub) -> Self {
        let (number, outbox) = hub.connect();
        Self { hub, number, outbox }
    }
}

impl Drop for Connected<'_> {
    fn drop(&mut self) {
        self.hub.disconnect(self.number);
    }
}

/// Answers with the version of the protocol, of those that the tool offers.
// The type of the answer is given.
#[allow(clippy::result_large_err)]
fn choose_version(request: &Request, mut response: Response) -> Result<Response, ErrorResponse> {
    let lists = request.headers().get_all(SEC_WEBSOCKET_PROTOCOL).iter();
    let offered: Vec<&str> =
        lists.filter_map(|list| list.to_str().ok()).flat_map(|list| list.split(',').map(str::trim)).collect();
    match VERSIONS.into_iter().find(|version| offered.contains(version)) {
        Some(version) => {
            response.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(version));
            Ok(response)
        }
        None => {
            let mut refused = ErrorResponse::new(Some(format!("The viewer speaks {}.\n", VERSIONS.join(" and "))));
            *refused.status_mut() = StatusCode::BAD_REQUEST;
            Err(refused)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    /// Both ends of a connection: that of the tool, and that of the server.
    async fn connection() -> (std::net::TcpStream, TcpStream) {
        let listener = TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
        let tool = std::net::TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        (tool, listener.accept().await.unwrap().0)
    }

    fn run<R>(what: impl Future<Output = R>) -> R {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(what)
    }

    #[test]
    fn a_tool_that_stops_reading_is_disconnected() {
        run(async {
            let (tool, stream) = connection().await;
            let socket =
                WebSocketStream::from_raw_socket(stream, tokio_tungstenite::tungstenite::protocol::Role::Server, None);
            let outbox = Outbox::default();
            // More than the kernel keeps for a connection on which the other end reads nothing.
            outbox.push_sample(vec![0; 64 << 20]);
            let sending = send_all(&outbox, socket.await, Duration::from_millis(100));
            let ended = tokio::time::timeout(Duration::from_secs(60), sending).await;
            assert!(ended.is_ok(), "the server still waits for a tool that does not read");
            drop(tool);
        });
    }

    #[test]
    fn a_tool_that_reads_first_receives_why_it_is_turned_away() {
        run(async {
            let (mut tool, stream) = connection().await;
            turn_away(stream, "403 Forbidden", "No.");
            let mut answer = String::new();
            tool.read_to_string(&mut answer).unwrap();
            assert!(answer.starts_with("HTTP/1.1 403 Forbidden\r\n") && answer.ends_with("\r\n\r\nNo.\n"), "{answer}");
        });
    }

    #[test]
    fn a_panic_of_a_connection_removes_its_tool() {
        let hub = Arc::new(Hub::new("test", String::new()));
        let of_thread = hub.clone();
        let ended = std::thread::spawn(move || {
            let connected = Connected::to(&of_thread);
            of_thread.request(connected.number, r#"{"op":"subscribeConnectionGraph"}"#);
            assert!(!of_thread.draws_graph(), "as intended by this test");
        });
        assert!(ended.join().is_err());
        assert!(!hub.draws_graph(), "its tool is still there");
    }
}
