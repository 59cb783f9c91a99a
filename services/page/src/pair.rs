//! Pairing: a token for a browser, as an address to open, also as a QR code.

use crate::settings::{PairArgs, PlaceArgs, state_folder};
use command::{Answer, Failure, print_line};
use qrcode::QrCode;
use qrcode::render::unicode::Dense1x2;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// File in the state folder with where the page listens.
const FILE: &str = "page.json";

/// Where a page listens.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Listening {
    /// Its addresses, the first for other machines if there is one.
    pub(crate) urls: Vec<String>,
    /// SHA-256 of its certificate; `None` over plain HTTP.
    pub(crate) fingerprint: Option<String>,
}

impl Listening {
    /// Stores it for `pair`.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub(crate) fn write(&self, state: &Path) -> Answer {
        std::fs::create_dir_all(state).map_err(Failure::not_now)?;
        let text = serde_json::to_string(self).map_err(Failure::not_now)?;
        std::fs::write(state.join(FILE), text).map_err(Failure::not_now)
    }

    fn read(state: &Path) -> Option<Self> {
        serde_json::from_str(&std::fs::read_to_string(state.join(FILE)).ok()?).ok()
    }
}

/// Creates a token and prints how a browser becomes its holder.
///
/// # Errors
/// The gateway refuses the token, or the address of the page is not known.
pub fn pair(args: &PairArgs, place: &PlaceArgs) -> Answer {
    let listening = Listening::read(&state_folder(args.state.as_ref()));
    let known = listening.clone().unwrap_or_default();
    let urls = args.url.iter().cloned().chain(known.urls).collect();
    print_pairing(&Listening { urls, ..known }, place, &args.holder, &args.role).map(|_| ())
}

/// Creates a token and prints how a browser becomes its holder; returns the address. The part behind `#` is not sent to
/// any server: the page takes the token from it and keeps it.
///
/// # Errors
/// As [`pair`].
pub(crate) fn print_pairing(listening: &Listening, place: &PlaceArgs, holder: &str, role: &str) -> Answer<String> {
    let url = listening.urls.first().ok_or_else(|| {
        Failure::NotNow("it is not known where the page listens: start it, or give its address with --url".to_owned())
    })?;
    let secret = client::gateway(place.place())?.add_token(holder, role)?;
    let address = format!("{}/#token={secret}", url.trim_end_matches('/'));
    let code = QrCode::new(&address).map_err(Failure::not_now)?;
    // Light modules are printed as blocks: most terminals have a dark ground.
    let drawn = code.render::<Dense1x2>().dark_color(Dense1x2::Light).light_color(Dense1x2::Dark).build();
    let mut lines = vec![drawn, address.clone()];
    if let Some(fingerprint) = &listening.fingerprint {
        lines.push(format!("The browser warns once. Its certificate has the SHA-256 fingerprint {fingerprint}"));
    }
    lines.push(format!("This gives the role {role} to its holder; `nims token revoke {holder}` takes it back."));
    // A closed pipe wants no more of it.
    let _ = print_line(&lines.join("\n"));
    Ok(address)
}
