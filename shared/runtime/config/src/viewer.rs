//! `[viewer]`: the keys of the live view.

use crate::section::between;
use std::net::{IpAddr, Ipv4Addr};

crate::section! {
    /// `[viewer]`: the optional process that shows every channel live, see `docs/looking.md`.
    pub struct ViewerSection {
        /// Address to listen on; default: only this machine. There is no password, so use another address only in a
        /// network whose members may all see the data.
        pub address: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST),
        /// Users and, after `@`, groups of this machine that may look, by name or number, beside the user of the viewer
        /// and root.
        pub look: Vec<String> = vec!["@nims-operators".to_owned()],
        /// TCP port; 0: any free port.
        pub port: u16 = 8765,
        /// Largest number of samples per second and channel sent to a tool. Short bursts pass; of a faster channel the
        /// newest samples are sent.
        pub rate_hz: f64 = 50.0 => between(1.0, 200.0, "samples per second"),
    }
}
