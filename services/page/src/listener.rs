//! Accepts connections, a bounded number of each address, and speaks HTTP/1 on them, within TLS or without.

use crate::http::{Peer, host_of, is_this_machine};
use crate::places::Known;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustls::ServerConfig;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;

/// Connections at once: of all, and of one address. A browser opens at most six, and one for its conversation.
const CONNECTIONS: usize = 96;
const OF_AN_ADDRESS: usize = 48;
/// The same for addresses from which no holder of a token has come, so that a few of them do not take all.
const OF_STRANGERS: usize = 72;
const OF_A_STRANGER: usize = 24;
/// Time for the handshake and for the head of a request.
const PATIENCE: Duration = Duration::from_secs(10);
/// Largest head of a request, bytes.
const HEAD: usize = 16 << 10;
/// First byte of a TLS handshake.
const HANDSHAKE: u8 = 22;
/// Wait after a connection could not be accepted, e.g. without a free descriptor.
const AGAIN: Duration = Duration::from_millis(100);

/// Open connections by address.
#[derive(Debug, Default)]
struct Open {
    of: Mutex<BTreeMap<IpAddr, usize>>,
    known: Arc<Known>,
}

/// The place of a connection.
struct Place(Arc<Open>, IpAddr);

impl Open {
    fn take(self: &Arc<Self>, address: IpAddr) -> Option<Place> {
        let mut open = self.of.lock().unwrap_or_else(PoisonError::into_inner);
        let (all, own) = (open.values().sum::<usize>(), open.get(&address).copied().unwrap_or(0));
        let known = self.known.has(address);
        let (most, most_own) = if known { (CONNECTIONS, OF_AN_ADDRESS) } else { (OF_STRANGERS, OF_A_STRANGER) };
        if all >= most || own >= most_own {
            return None;
        }
        open.insert(address, own + 1);
        Some(Place(Arc::clone(self), address))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut open = self.0.of.lock().unwrap_or_else(PoisonError::into_inner);
        match open.get_mut(&self.1) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(open.remove(&self.1)),
        }
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
        let peer = Extension(Peer(address.ip().to_canonical()));
        let (tls, router, names) = (tls.clone(), router.clone().layer(peer), Arc::clone(&names));
        tokio::spawn(async move {
            connection(stream, tls, router, names).await;
            drop(place);
        });
    }
}

async fn connection(stream: TcpStream, tls: Option<TlsAcceptor>, router: Router, names: Arc<[String]>) {
    // A stop is one small packet.
    let _ = stream.set_nodelay(true);
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
