//! Pairing: a code by which a browser gets a token, as an address to open, also as a QR code.

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

/// Creates a code and prints how a browser is paired with it.
///
/// # Errors
/// The gateway refuses the holder, or the address of the page is not known.
pub fn pair(args: &PairArgs, place: &PlaceArgs) -> Answer {
    let listening = Listening::read(&state_folder(args.state.as_ref()));
    let known = listening.clone().unwrap_or_default();
    let urls = args.url.iter().cloned().chain(known.urls).collect();
    print_pairing(&Listening { urls, ..known }, place, &args.holder, &args.role)
}

/// Creates a code for a browser; returns the address with it, the code, and the time for which it is valid, s. The part
/// behind `#` is not sent to any server: the page takes the code from it.
///
/// # Errors
/// As [`pair`].
pub(crate) fn address(
    listening: &Listening,
    place: &PlaceArgs,
    holder: &str,
    role: &str,
) -> Answer<(String, String, f64)> {
    let url = listening.urls.first().ok_or_else(|| {
        Failure::NotNow("it is not known where the page listens: start it, or give its address with --url".to_owned())
    })?;
    let (code, valid_s) = client::gateway(place.place())?.add_code(holder, role)?;
    Ok((format!("{}/#code={code}", url.trim_end_matches('/')), code, valid_s))
}

/// Creates a code and prints how a browser is paired with it.
///
/// # Errors
/// As [`pair`].
pub(crate) fn print_pairing(listening: &Listening, place: &PlaceArgs, holder: &str, role: &str) -> Answer {
    let (address, digits, valid_s) = address(listening, place, holder, role)?;
    let code = QrCode::new(&address).map_err(Failure::not_now)?;
    // Light modules are printed as blocks: most terminals have a dark ground.
    let drawn = code.render::<Dense1x2>().dark_color(Dense1x2::Light).light_color(Dense1x2::Dark).build();
    let minutes = valid_s / 60.0;
    let code = format!("or open the page and enter the code {digits}; it is for one browser and {minutes:.0} minutes");
    let mut lines = vec![drawn, address, code];
    if let Some(fingerprint) = &listening.fingerprint {
        lines.push(format!("The browser warns once. Its certificate has the SHA-256 fingerprint {fingerprint}"));
    }
    lines.push(format!("This gives the role {role} to its holder; `nims page revoke {holder}` takes it back."));
    // A closed pipe wants no more of it.
    let _ = print_line(&lines.join("\n"));
    Ok(())
}

/// Lists the tokens, without their secrets.
///
/// # Errors
/// The gateway refuses it.
pub fn tokens(place: &PlaceArgs) -> Answer {
    let rows = client::gateway(place.place())?.tokens()?;
    let line = |row: &client::TokenRow| format!("{:20} {:4}  since {}", row.name, row.role, row.created);
    let lines: Vec<String> = rows.iter().map(line).collect();
    let _ = print_line(&if lines.is_empty() { "no browser is paired".to_owned() } else { lines.join("\n") });
    Ok(())
}

/// Revokes a token, and ends the conversations of its holder.
///
/// # Errors
/// The gateway refuses it.
pub fn revoke(holder: &str, place: &PlaceArgs) -> Answer {
    client::gateway(place.place())?.revoke_token(holder)?;
    let _ = print_line(&format!("{holder} is not paired any more"));
    Ok(())
}
