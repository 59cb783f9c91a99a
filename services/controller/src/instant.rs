//! Time of an estimate relative to the cycle that it belongs to.

use messages::{AUTHORITY_LAG, Header, MotorAuthority};

/// Time of an estimate relative to its cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Instant {
    /// Cycles by which the authority is older than the estimate.
    pub lag: u64,
    /// Time when the commands of the estimate's cycle were sent, ns.
    pub began_ns: u64,
    /// Time from `began_ns` to the estimate, s.
    pub since_s: f64,
}

impl Instant {
    /// Returns `None` if the authority is too old for this estimate or not plausible.
    pub fn from_sample(sample: &Header, authority: &MotorAuthority) -> Option<Self> {
        let (period_s, rate) = (authority.period_s, authority.plan_rate);
        let lag = sample.cycle.saturating_sub(authority.header.cycle);
        if !(period_s > 0.0 && period_s < 1.0 && (0.0..=1.0).contains(&rate) && lag <= AUTHORITY_LAG) {
            return None;
        }
        let began_ns = authority.header.stamp_ns.saturating_sub(authority.bus_ns);
        let since_s = sample.stamp_ns.saturating_sub(began_ns) as f64 * 1e-9;
        let since_s = since_s.clamp(period_s * lag as f64, period_s * (lag + 1) as f64) - period_s * lag as f64;
        let began_ns = began_ns.saturating_add(lag * (period_s * 1e9) as u64);
        Some(Self { lag, began_ns, since_s })
    }
}
