//! The live view's own keys.

use serde::{Deserialize, Serialize};
use std::net::{IpAddr, Ipv4Addr};

/// `[viewer]`: for the optional process that shows every channel live, see `docs/looking.md`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct ViewerSection {
    /// Address it listens on. The default is this machine itself; nothing asks for a password, so give another one only in a network
    /// whose members may all look.
    pub address: IpAddr,
    /// Port; 0: any that is free.
    pub port: u16,
    /// Samples per second and channel at most that a tool is sent, 1 to 200. Short bursts pass, of what is faster the newest.
    pub rate_hz: f64,
}

impl Default for ViewerSection {
    fn default() -> Self {
        Self { address: IpAddr::V4(Ipv4Addr::LOCALHOST), port: 8765, rate_hz: 50.0 }
    }
}
