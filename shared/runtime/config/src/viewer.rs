//! `[viewer]`: the keys of the live view.

use serde::{Deserialize, Serialize};
use std::net::{IpAddr, Ipv4Addr};

/// `[viewer]`: the optional process that shows every channel live, see `docs/looking.md`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct ViewerSection {
    /// Address to listen on; default: only this machine. There is no password, so use another address only in a network
    /// whose members may all see the data.
    pub address: IpAddr,
    /// TCP port; 0: any free port.
    pub port: u16,
    /// Largest number of samples per second and channel sent to a tool, 1 to 200. Short bursts pass; of a faster
    /// channel the newest samples are sent.
    pub rate_hz: f64,
}

impl Default for ViewerSection {
    fn default() -> Self {
        Self { address: IpAddr::V4(Ipv4Addr::LOCALHOST), port: 8765, rate_hz: 50.0 }
    }
}
