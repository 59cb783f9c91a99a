//! Accepts connections, a bounded number of each address, and speaks HTTP/1 on them, within TLS or without.

use crate::crowd::{Crowd, Most, network};
use crate::here::Ends;
use crate::http::{Peer, host_of, is_this_machine};
use crate::places::Known;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustls::ServerConfig;
use socket2::SockRef;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;

/// Connections at once. A browser opens at most six, and one for its conversation, which is none any more once it has
/// begun.
const CONNECTIONS: Most = Most { all: 96, own: 48 };
/// The same for addresses from which no holder of a token has come, so that a few of them do not take all.
const OF_STRANGERS: Most = Most { all: 72, own: 24 };
/// Time for the handshake and for the head of a request.
const PATIENCE: Duration = Duration::from_secs(10);
/// Bytes that may wait to be sent on a connection: a few states.
const UNSENT: u32 = 8 << 10;
/// Largest head of a request, bytes.
const HEAD: usize = 16 << 10;
/// First byte of a TLS handshake.
const HANDSHAKE: u8 = 22;
/// Wait after a connection could not be accepted, e.g. without a free descriptor.
const AGAIN: Duration = Duration::from_millis(100);

/// Open connections.
#[derive(Debug, Default)]
struct Open {
    of: Mutex<Crowd>,
    known: Arc<Known>,
}

/// The place of a connection.
struct Place {
    open: Arc<Open>,
    number: u64,
    leaves: Arc<Notify>,
}

/// A request that is being answered.
struct Answering<'a>(&'a Place);

impl Open {
    fn all(&self) -> MutexGuard<'_, Crowd> {
        self.of.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a place; the oldest silent connection of a stranger makes room where that is needed.
    fn take(self: &Arc<Self>, address: IpAddr) -> Option<Place> {
        let known = self.known.has(address);
        let most = if known { CONNECTIONS } else { OF_STRANGERS };
        let (number, leaves) = self.all().enter(network(address), known, most)?;
        Some(Place { open: Arc::clone(self), number, leaves })
    }
}

impl Place {
    /// Begins to answer a request. Until that has ended, perhaps a stop, the connection is not closed for another one.
    fn answering(&self) -> Answering<'_> {
        self.open.all().set_silent(self.number, false);
        Answering(self)
    }
}

impl Drop for Answering<'_> {
    fn drop(&mut self) {
        self.0.open.all().set_silent(self.0.number, true);
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.open.all().leave(self.number);
    }
}

/// Serves until the program ends.
pub(crate) async fn listen(
    listener: TcpListener,
    tls: Option<Arc<ServerConfig>>,
    router: Router,
    names: Arc<[String]>,
    known: Arc<Known>,
) {
    let (open, tls) = (Arc::new(Open { of: Mutex::default(), known }), tls.map(TlsAcceptor::from));
    loop {
        let Ok((stream, address)) = listener.accept().await else {
            tokio::time::sleep(AGAIN).await;
            continue;
        };
        // Without a place it is closed at once.
        let Some(place) = open.take(address.ip().to_canonical()) else { continue };
        let (place, tls, names) = (Arc::new(place), tls.clone(), Arc::clone(&names));
        let peer = Extension(Peer(address.ip().to_canonical()));
        let ends = stream.local_addr().map(|page| Ends { browser: address, page });
        let its = Arc::clone(&place);
        let answer = move |request: Request, next: Next| {
            let its = Arc::clone(&its);
            async move {
                let _answering = its.answering();
                next.run(request).await
            }
        };
        let mut router = router.clone().layer(peer).layer(from_fn(answer));
        if let Ok(ends) = ends {
            router = router.layer(Extension(ends));
        }
        tokio::spawn(async move {
            tokio::select! {
                () = connection(stream, tls, router, names) => {}
                () = place.leaves.notified() => {}
            }
        });
    }
}

async fn connection(stream: TcpStream, tls: Option<TlsAcceptor>, router: Router, names: Arc<[String]>) {
    // A stop is one small packet.
    let _ = stream.set_nodelay(true);
    // What waits here for a slow connection is old when it arrives: the newest state waits before it instead.
    let _ = SockRef::from(&stream).set_tcp_notsent_lowat(UNSENT);
    let Some(tls) = tls else { return http(stream, router).await };
    let mut first = [0];
    match timeout(PATIENCE, stream.peek(&mut first)).await {
        Ok(Ok(1)) if first[0] == HANDSHAKE => {
            if let Ok(Ok(stream)) = timeout(PATIENCE, tls.accept(stream)).await {
                http(stream, router).await;
            }
        }
        Ok(Ok(1)) => {
            http(stream, Router::new().fallback(async move |request: Request| to_https(&request, &names))).await
        }
        _ => {}
    }
}

async fn http(stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static, router: Router) {
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(PATIENCE)
        .max_buf_size(HEAD)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades()
        .await;
    // What a client does wrong concerns itself only.
    drop(served);
}

/// An address without `https://` was typed.
fn to_https(request: &Request<Body>, names: &[String]) -> Response {
    match host_of(request.headers(), request.uri()).filter(|host| is_this_machine(host, names)) {
        Some(host) => {
            let place = format!("https://{host}/");
            (StatusCode::TEMPORARY_REDIRECT, [(header::LOCATION, place)]).into_response()
        }
        None => StatusCode::MISDIRECTED_REQUEST.into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt;

    fn address(last: usize) -> IpAddr {
        IpAddr::from([10, 0, 0, last as u8])
    }

    /// Whether the connection is to be closed.
    fn is_told(place: &Place) -> bool {
        place.leaves.notified().now_or_never().is_some()
    }

    #[test]
    fn a_new_connection_gets_a_place_from_a_silent_one_and_not_from_one_that_is_answered() {
        let open = Arc::new(Open::default());
        let (stops, silent) = (open.take(address(1)).unwrap(), open.take(address(1)).unwrap());
        let answering = stops.answering();
        let strangers: Vec<_> = (0..1000).filter_map(|at| open.take(address(1 + at % 100))).collect();
        assert_eq!(strangers.len(), 1000);
        assert!(is_told(&silent) && !is_told(&stops));
        assert!(strangers[1000 - OF_STRANGERS.all + 1..].iter().all(|place| !is_told(place)));
        // When it has its answer, it is silent again, and the oldest.
        drop(answering);
        let next = open.take(address(101)).unwrap();
        assert!(is_told(&stops));
        // While all are answered, none makes room.
        let answering: Vec<_> = strangers.iter().chain([&next]).map(Place::answering).collect();
        assert!(open.take(address(102)).is_none());
        drop(answering);
        drop((stops, silent, strangers));
        assert!(open.take(address(102)).is_some() && !is_told(&next));
    }
}
