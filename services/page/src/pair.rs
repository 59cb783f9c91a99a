//! Pairing: a code by which a browser gets a token, as an address to open, also as a QR code.

use crate::settings::{PairArgs, PlaceArgs, state_of};
use command::{Answer, Failure, Output};
use qrcode::QrCode;
use qrcode::render::unicode::Dense1x2;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;

/// File in the state folder with where the page listens.
const FILE: &str = "page.json";

/// Where a page listens. The addresses of the machine are none of it: they come and go with its networks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Listening {
    /// Its address, perhaps that of all networks.
    pub(crate) address: IpAddr,
    /// Its TCP port.
    pub(crate) port: u16,
    /// SHA-256 of its certificate; `None` over plain HTTP.
    pub(crate) fingerprint: Option<String>,
}

impl Listening {
    /// The addresses at which browsers reach it now, the first for other machines if there is one.
    pub(crate) fn urls(&self) -> Vec<String> {
        let scheme = if self.fingerprint.is_some() { "https" } else { "http" };
        let url = |address: &IpAddr| format!("{scheme}://{}", SocketAddr::new(*address, self.port));
        reached(self.address).iter().map(url).collect()
    }

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
pub fn pair(args: &PairArgs, place: &PlaceArgs) -> Answer<Output> {
    let state = state_of(args.state.as_ref(), client::gateway_socket(place.place()).ok().as_deref());
    let listening = Listening::read(&state);
    let url = args.url.clone().or_else(|| listening.as_ref()?.urls().into_iter().next()).ok_or_else(|| {
        let state = state.display();
        Failure::NotNow(format!(
            "it is not known where the page listens: {state}/{FILE} cannot be read; start the page, use sudo for that of a \
             service, or give its address with --url"
        ))
    })?;
    let fingerprint = listening.and_then(|listening| listening.fingerprint);
    pairing((&url, fingerprint), place, &args.holder, &args.role)
}

/// Creates a code for a browser; returns the address with it, the code, and the time for which it is valid, s. The part
/// behind `#` is not sent to any server: the page takes the code from it.
///
/// # Errors
/// The gateway refuses the holder.
pub(crate) fn address(url: &str, place: &PlaceArgs, holder: &str, role: &str) -> Answer<(String, String, f64)> {
    let (code, valid_s) = client::gateway(place.place())?.add_code(holder, role)?;
    Ok((format!("{}/#code={code}", url.trim_end_matches('/')), code, valid_s))
}

/// Creates a code; returns how a browser is paired with it at that address, with the certificate of that fingerprint.
///
/// # Errors
/// As [`address`].
pub(crate) fn pairing(
    (url, fingerprint): (&str, Option<String>),
    place: &PlaceArgs,
    holder: &str,
    role: &str,
) -> Answer<Output> {
    let (address, digits, valid_s) = address(url, place, holder, role)?;
    let code = QrCode::new(&address).map_err(Failure::not_now)?;
    // Light modules are printed as blocks: most terminals have a dark ground.
    let drawn = code.render::<Dense1x2>().dark_color(Dense1x2::Light).light_color(Dense1x2::Dark).build();
    let minutes = valid_s / 60.0;
    let code = format!("or open the page and enter the code {digits}; it is for one browser and {minutes:.0} minutes");
    let value = json!({ "holder": holder, "role": role, "address": address, "code": digits, "valid_s": valid_s,
        "fingerprint": fingerprint });
    let mut lines = vec![drawn, address, code];
    if let Some(fingerprint) = &fingerprint {
        lines.push(format!("The browser warns once. Its certificate has the SHA-256 fingerprint {fingerprint}"));
    }
    lines.push(format!("This gives the role {role} to its holder; `nims page revoke {holder}` takes it back."));
    Ok(Output::new(value, lines.join("\n")))
}

/// Lists the tokens, without their secrets.
///
/// # Errors
/// The gateway refuses it.
pub fn tokens(place: &PlaceArgs) -> Answer<Output> {
    let rows = client::gateway(place.place())?.tokens()?;
    let value = |row: &client::TokenRow| json!({ "name": row.name, "role": row.role, "created": row.created });
    let values: Vec<_> = rows.iter().map(value).collect();
    let line = |row: &client::TokenRow| format!("{:20} {:4}  since {}", row.name, row.role, row.created);
    let lines: Vec<String> = rows.iter().map(line).collect();
    let words = if lines.is_empty() { "no browser is paired".to_owned() } else { lines.join("\n") };
    Ok(Output::new(json!({ "tokens": values }), words))
}

/// Revokes a token, and ends the conversations of its holder.
///
/// # Errors
/// The gateway refuses it.
pub fn revoke(holder: &str, place: &PlaceArgs) -> Answer<Output> {
    client::gateway(place.place())?.revoke_token(holder)?;
    Ok(Output::new(json!({ "revoked": holder }), format!("{holder} is not paired any more")))
}

/// The addresses at which browsers reach a page that listens at this address, those of networks first.
pub(crate) fn reached(address: IpAddr) -> Vec<IpAddr> {
    if !address.is_unspecified() {
        return vec![address];
    }
    let found = if_addrs::get_if_addrs().unwrap_or_default();
    let mut addresses: Vec<IpAddr> = found
        .iter()
        .map(if_addrs::Interface::ip)
        .filter(|ip| ip.is_ipv4() || address.is_ipv6())
        // Those of one link need its name too, which no browser accepts.
        .filter(|ip| !matches!(ip, IpAddr::V6(six) if six.is_unicast_link_local()))
        .collect();
    addresses.sort_by_key(|ip| (ip.is_loopback(), ip.is_ipv6(), *ip));
    addresses.dedup();
    addresses
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_stored_leads_to_the_addresses_of_the_moment() {
        let folder = tempfile::tempdir().unwrap();
        let fingerprint = Some("AB:CD".to_owned());
        let all = Listening { address: IpAddr::from([0, 0, 0, 0]), port: 8766, fingerprint };
        all.write(folder.path()).unwrap();
        // Nothing of a network that may come later, or be gone.
        let text = std::fs::read_to_string(folder.path().join(FILE)).unwrap();
        assert_eq!(text, r#"{"address":"0.0.0.0","port":8766,"fingerprint":"AB:CD"}"#);
        let read = Listening::read(folder.path()).unwrap();
        assert_eq!(read, all);
        let own: Vec<IpAddr> = if_addrs::get_if_addrs().unwrap().iter().map(if_addrs::Interface::ip).collect();
        let urls = read.urls();
        assert!(!urls.is_empty());
        for url in urls {
            let address: SocketAddr = url.strip_prefix("https://").unwrap().parse().unwrap();
            assert!(own.contains(&address.ip()) && address.port() == 8766, "{url}");
        }
        let here = Listening { address: IpAddr::from([127, 0, 0, 1]), port: 80, fingerprint: None };
        assert_eq!(here.urls(), ["http://127.0.0.1:80"]);
        assert!(Listening::read(&folder.path().join("absent")).is_none());
    }
}
