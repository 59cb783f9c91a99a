//! The routes of the server, and what every request has to satisfy.

use crate::app::{App, Offered};
use crate::here::{self, Ends};
use crate::link::Browser;
use crate::{plain, session, stops};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{DefaultBodyLimit, Extension, Path, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::{any, get, post};
use gateway_protocol::{Accepted, Reply};
use messages::Request as Asked;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio::sync::mpsc;
use tokio::time::timeout;

/// Longest message of a browser, bytes: a mission of a thousand legs has 100 kB.
const MESSAGE: usize = 256 << 10;
/// Bytes of a file that are read at once.
const PIECE: usize = 64 << 10;
/// A download of which nothing is taken for this time is ended: its file may be of a run that was deleted.
const TAKEN: Duration = Duration::from_secs(30);

/// Nothing from elsewhere, no script in the page itself, no page around it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
    manifest-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'";
/// What the browser sends with every answer.
const HEADERS: [(&str, &str); 5] = [
    ("content-security-policy", POLICY),
    ("x-content-type-options", "nosniff"),
    // With `no-referrer` browsers would send the origin null with the forms of the plain page.
    ("referrer-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    ("permissions-policy", "camera=(), microphone=(), geolocation=(), gamepad=(self)"),
];
/// And beside it, except with a file of a run: its policy puts it into a sandbox, where it has no origin, and a browser
/// may refuse a page without one that asks for this.
const OPENER: (&str, &str) = ("cross-origin-opener-policy", "same-origin");
/// Where files of runs are.
const FILES: &str = "/download/";

/// Address of the browser, beside each request.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Peer(pub(crate) IpAddr);

/// The routes.
pub(crate) fn router(app: Arc<App>) -> Router {
    Router::new()
        .route("/", get(front))
        .route("/plain", get(plain_page))
        .route("/plain/{verb}", post(plain_stop))
        .route("/ws", any(upgrade))
        .route("/download/{ticket}", get(download))
        .route(here::PATH, get(opened_here))
        .route("/{file}", get(asset))
        .layer(DefaultBodyLimit::max(1024))
        .layer(from_fn_with_state(Arc::clone(&app), guard))
        .with_state(app)
}

/// Refuses requests for another machine and from other pages, and adds the headers.
async fn guard(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let host = host_of(request.headers(), request.uri());
    let wanted = host.as_deref().is_some_and(|host| is_this_machine(host, &app.names));
    let own = from_own_page(request.headers(), host.as_deref());
    let headers = headers(request.uri().path());
    let mut response = match (wanted, own) {
        (false, _) => {
            let why = "this name is not one of this machine; use its address, or start the page with --name\n";
            (StatusCode::MISDIRECTED_REQUEST, why).into_response()
        }
        (true, false) => (StatusCode::FORBIDDEN, "a page of another server may not use this one\n").into_response(),
        (true, true) => next.run(request).await,
    };
    for (name, value) in headers {
        // A file of a run has a policy of its own.
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    response.headers_mut().entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

fn headers(path: &str) -> impl Iterator<Item = (&'static str, &'static str)> + use<> {
    HEADERS.into_iter().chain((!path.starts_with(FILES)).then_some(OPENER))
}

/// Host and port as the browser names them.
pub(crate) fn host_of(headers: &HeaderMap, uri: &Uri) -> Option<String> {
    let given = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    given.or(uri.authority().map(|authority| authority.as_str())).map(str::to_ascii_lowercase)
}

/// Whether a host is an address, which no foreign name server can make one of this machine, or a name of this machine.
pub(crate) fn is_this_machine(host: &str, names: &[String]) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.rsplit_once(':').map_or(host, |(name, _)| name),
    };
    name.parse::<IpAddr>().is_ok() || names.iter().any(|known| known == name)
}

/// Whether a request comes from a page of this server, or from no page.
fn from_own_page(headers: &HeaderMap, host: Option<&str>) -> bool {
    let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    let same = |origin: &str| {
        let origin = origin.to_ascii_lowercase();
        origin.split_once("://").is_some_and(|(_, named)| Some(named) == host)
    };
    match (text("origin"), text("sec-fetch-site")) {
        (Some(origin), _) => same(origin),
        (None, Some(site)) => matches!(site, "same-origin" | "none"),
        (None, None) => true,
    }
}

async fn front(State(app): State<Arc<App>>) -> Response {
    match app.assets.get("index.html") {
        Some(found) => found,
        None => Redirect::to("/plain").into_response(),
    }
}

/// The browser that `start` opens: it is paired if it is of this user.
async fn opened_here(State(app): State<Arc<App>>, ends: Option<Extension<Ends>>) -> Redirect {
    match ends.and_then(|Extension(ends)| app.here.take(ends)) {
        Some(code) => Redirect::to(&format!("/#code={code}")),
        None => Redirect::to("/"),
    }
}

async fn asset(State(app): State<Arc<App>>, Path(file): Path<String>) -> Response {
    app.assets.get(&file).unwrap_or_else(|| (StatusCode::NOT_FOUND, "there is no such file\n").into_response())
}

async fn plain_page(State(app): State<Arc<App>>) -> Response {
    plain::page(&app.topics.live(), app.assets.are_there(), None)
}

async fn plain_stop(State(app): State<Arc<App>>, from: Option<Extension<Peer>>, Path(verb): Path<String>) -> Response {
    let request = match verb.as_str() {
        "stop" => Asked::Stop,
        "estop" => Asked::Estop,
        _ => return (StatusCode::NOT_FOUND, "the plain page has stop and estop\n").into_response(),
    };
    let browser = Browser { token: None, from: from.map(|Extension(Peer(ip))| ip) };
    let (status, sentence) = match stops::stop(&app, &browser, request).await {
        Ok(Reply::Answer { accepted: Accepted::Accepted, sentence, .. }) => (StatusCode::OK, sentence),
        Ok(Reply::Answer { sentence, .. }) => (StatusCode::OK, format!("refused: {sentence}")),
        Ok(_) => {
            let sentence = "the gateway's reply is of another kind; use the page of the same installation";
            (StatusCode::BAD_GATEWAY, sentence.to_owned())
        }
        Err(failure) => (StatusCode::SERVICE_UNAVAILABLE, failure.to_string()),
    };
    (status, plain::page(&app.topics.live(), app.assets.are_there(), Some(&sentence))).into_response()
}

async fn upgrade(
    State(app): State<Arc<App>>,
    from: Option<Extension<Peer>>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    // A browser always names the page that opens the conversation.
    if !headers.contains_key(header::ORIGIN) {
        return (StatusCode::FORBIDDEN, "a conversation is opened by the page\n").into_response();
    }
    let from = from.map(|Extension(Peer(ip))| ip);
    let Some(visit) = app.conversations.begin(from) else {
        let why = "too many pages of this address are being opened; try again\n";
        return (StatusCode::SERVICE_UNAVAILABLE, why).into_response();
    };
    upgrade.max_message_size(MESSAGE).max_frame_size(MESSAGE).max_write_buffer_size(4 * MESSAGE).on_upgrade(
        async move |socket| {
            session::converse(socket, app, from, visit).await;
        },
    )
}

/// A file of a run that a browser shows: its styles and pictures, and nothing that acts, also for this page.
const SHOWN_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; \
    frame-ancestors 'none'; base-uri 'none'; form-action 'none'; sandbox";

/// The kind of a file that a browser shows; other files are downloaded.
fn shown_kind(name: &str) -> Option<&'static str> {
    Some(match name.rsplit('.').next()? {
        "html" => "text/html; charset=utf-8",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "txt" | "toml" | "json" => "text/plain; charset=utf-8",
        _ => return None,
    })
}

async fn download(State(app): State<Arc<App>>, Path(ticket): Path<String>) -> Response {
    let Some(Offered { file, name, bytes, shown, .. }) = app.downloads.fetch(&ticket) else {
        return (StatusCode::NOT_FOUND, "this download has ended; ask for it again on the page\n").into_response();
    };
    let (pieces, fed) = mpsc::channel(1);
    tokio::spawn(feed(tokio::fs::File::from_std(file), pieces, TAKEN));
    let pieces = futures_util::stream::unfold(fed, async |mut fed| Some((fed.recv().await?, fed)));
    let plain: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
    let kind = shown_kind(&plain).filter(|_| shown);
    let placed = if kind.is_some() { "inline" } else { "attachment" };
    let headers = [
        (header::CONTENT_TYPE, kind.unwrap_or("application/octet-stream").to_owned()),
        (header::CONTENT_DISPOSITION, format!("{placed}; filename=\"{plain}\"")),
        (header::CONTENT_LENGTH, bytes.to_string()),
        (header::CONTENT_SECURITY_POLICY, SHOWN_POLICY.to_owned()),
    ];
    (headers, Body::from_stream(pieces)).into_response()
}

/// Reads a file for a browser, and closes it when the browser takes nothing for that time.
async fn feed(mut file: tokio::fs::File, pieces: mpsc::Sender<std::io::Result<Bytes>>, limit: Duration) {
    loop {
        let mut piece = vec![0; PIECE];
        let read = file.read(&mut piece).await;
        let (piece, is_last) = match read {
            Ok(0) => return,
            Ok(length) => {
                piece.truncate(length);
                (Ok(Bytes::from(piece)), false)
            }
            Err(error) => (Err(error), true),
        };
        if !matches!(timeout(limit, pieces.send(piece)).await, Ok(Ok(()))) || is_last {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_a_run_has_no_policy_for_openers() {
        assert!(headers("/").chain(headers("/page.js")).filter(|row| *row == OPENER).count() == 2);
        assert!(!headers("/download/0123").any(|row| row == OPENER) && headers("/download/0123").eq(HEADERS));
    }

    #[test]
    fn a_file_of_which_nothing_is_taken_is_closed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        std::fs::write(&path, vec![7; 5 * PIECE]).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let open = || tokio::fs::File::from_std(std::fs::File::open(&path).unwrap());
            let (pieces, mut fed) = mpsc::channel(1);
            feed(open(), pieces, Duration::from_millis(50)).await;
            // One was taken up, and no more follow.
            assert!(fed.recv().await.is_some() && fed.recv().await.is_none());
            let (pieces, mut fed) = mpsc::channel(1);
            tokio::spawn(feed(open(), pieces, Duration::from_secs(60)));
            let mut bytes = 0;
            while let Some(piece) = fed.recv().await {
                bytes += piece.unwrap().len();
            }
            assert_eq!(bytes, 5 * PIECE);
        });
    }

    #[test]
    fn only_this_machine_is_served() {
        let names = ["localhost".to_owned(), "box.local".to_owned()];
        for host in ["10.0.0.1:8766", "[::1]:8766", "localhost:80", "box.local", "127.0.0.1"] {
            assert!(is_this_machine(host, &names), "{host}");
        }
        for host in ["evil.example:8766", "", "box", "localhost.evil.example", "10.0.0.1.evil.example"] {
            assert!(!is_this_machine(host, &names), "{host}");
        }
    }

    #[test]
    fn only_the_own_page_is_served() {
        let of = |rows: &[(&'static str, &'static str)]| {
            let headers = rows.iter().map(|(name, value)| (name.parse().unwrap(), HeaderValue::from_static(value)));
            from_own_page(&headers.collect(), Some("10.0.0.1:8766"))
        };
        assert!(of(&[]) && of(&[("origin", "https://10.0.0.1:8766")]) && of(&[("sec-fetch-site", "none")]));
        for wrong in [
            ("origin", "https://evil.example"),
            ("origin", "null"),
            ("origin", "https://10.0.0.1:1"),
            ("origin", "https://10.0.0.1:8766.evil.example"),
            ("sec-fetch-site", "cross-site"),
            ("sec-fetch-site", "same-site"),
        ] {
            assert!(!of(&[wrong]), "{wrong:?}");
        }
    }
}
