//! Hearing every channel of the domain.

use bus::{Bus, BusError, ChannelInfo, ChannelWatch, Raw, Tap};
use messages::{
    ControlStatus, Energy, Message, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState, NodeEstimate,
    OperatorRequest, PlanMotion, PlanStatus, ProcessState, TruthNode,
};
use runlog::{ChannelSpec, published_ns};

use crate::batch::{Batch, Heard};
use crate::session::Session;

/// A batch ends here, so that a burst does not take more memory than this; what is left comes with the next batch.
const BATCH_BYTES: usize = 2 << 20;

/// The taps of a recorder.
#[derive(Default)]
pub struct Listening {
    taps: Vec<(Tap, usize)>,
    watch: ChannelWatch,
    /// Channels that could not be opened, with whether that has been said.
    waiting: Vec<(ChannelInfo, bool)>,
    exclude: Vec<String>,
}

impl Listening {
    /// Listens to nothing yet. `exclude` are names of channels not to record; a trailing `*` stands for any ending.
    #[must_use]
    pub fn new(exclude: Vec<String>) -> Self {
        Self { exclude, ..Self::default() }
    }

    /// Opens what is new, and tries again what could not be opened before.
    ///
    /// # Errors
    /// The channels cannot be listed.
    pub fn discover(&mut self, bus: &Bus, session: &mut Session) -> Result<(), BusError> {
        let mut waiting = std::mem::take(&mut self.waiting);
        waiting.extend(self.watch.new_channels(bus)?.into_iter().map(|info| (info, false)));
        for (info, said) in waiting {
            let known = self.taps.iter().any(|(tap, _)| {
                tap.info().name == info.name && tap.info().type_name == info.type_name && tap.info().size == info.size
            });
            if known || self.excluded(&info.name) {
                continue;
            }
            match bus.tap_with_history(&info.name) {
                Ok(tap) => {
                    let row = session.declare(spec_of(tap.info()));
                    self.taps.push((tap, row));
                }
                // it went away again: if it comes back, it is new
                Err(BusError::NoChannel { .. }) => {}
                Err(error) => {
                    if !said {
                        tracing::warn!("channel {} is not recorded, will try again: {error}", info.name);
                    }
                    self.waiting.push((info, true));
                }
            }
        }
        Ok(())
    }

    fn excluded(&self, name: &str) -> bool {
        self.exclude.iter().any(|pattern| match pattern.strip_suffix('*') {
            Some(beginning) => name.starts_with(beginning),
            None => name == pattern,
        })
    }

    /// Takes what has arrived on every channel into the batch; true if there is more than one batch holds.
    pub fn drain(&mut self, session: &Session, batch: &mut Batch, now_ns: u64) -> bool {
        for (tap, row) in &mut self.taps {
            let has_header = session.rows().get(*row).is_some_and(crate::Row::has_header);
            let mut count = tap.received();
            loop {
                if batch.bytes() >= BATCH_BYTES {
                    return true;
                }
                count += 1;
                match tap.receive(|raw| batch.push(heard(*row, has_header, &raw, count, now_ns), raw.bytes)) {
                    Ok(Some(())) => {}
                    Ok(None) => break,
                    Err(error) => {
                        tracing::error!("{error}");
                        break;
                    }
                }
            }
        }
        false
    }
}

fn heard(row: usize, has_header: bool, raw: &Raw<'_>, count: u64, now_ns: u64) -> Heard {
    if !has_header {
        return Heard { row, logged_ns: now_ns, stamp_ns: now_ns, seq: count, missing: 0 };
    }
    let stamp_ns = raw.header.stamp_ns;
    let logged_ns = published_ns(stamp_ns, now_ns);
    let stamp_ns = if stamp_ns == 0 { logged_ns } else { stamp_ns };
    Heard { row, logged_ns, stamp_ns, seq: raw.header.seq, missing: raw.missing }
}

fn spec_of(info: &ChannelInfo) -> ChannelSpec {
    ChannelSpec {
        name: info.name.clone(),
        type_name: info.type_name.clone(),
        schema: info.schema.clone().unwrap_or_default(),
        size: info.size,
    }
}

/// Makes the channels of the control loop before their publishers do, so that not even their first sample is missed, and listens to them.
///
/// Channels of a name that only their maker knows (heartbeats, logs, sensors) are found when they appear; their history bridges the time
/// until then.
///
/// # Errors
/// As [`Listening::discover`].
pub fn listen_to_known(bus: &Bus, listening: &mut Listening, session: &mut Session) -> Result<(), BusError> {
    /// Kept until the tap holds the channel.
    fn hold<T: Message>(bus: &Bus, names: &[&str]) -> Vec<bus::Subscriber<T>> {
        // a channel that somebody has made with another type is found by discovery, like any unknown one
        names.iter().filter_map(|name| bus.subscriber::<T>(name).ok()).collect()
    }
    let _held = (
        (hold::<MotorState>(bus, &["motor/state"]), hold::<MotorAuthority>(bus, &["motor/authority"])),
        (hold::<MotorInput>(bus, &["motor/input"]), hold::<Energy>(bus, &["energy"])),
        hold::<MotorSlots>(bus, &["motor/slots"]),
        hold::<MotorCommand>(bus, &["motor/command/a", "motor/command/b"]),
        hold::<NodeEstimate>(bus, &["node/estimate/a", "node/estimate/b"]),
        hold::<ControlStatus>(bus, &["control/status/a", "control/status/b"]),
        (hold::<PlanMotion>(bus, &["plan/motion"]), hold::<PlanStatus>(bus, &["plan/status"])),
        hold::<OperatorRequest>(bus, &["operator/request"]),
        (hold::<ProcessState>(bus, &["system/process"]), hold::<TruthNode>(bus, &["truth/node"])),
    );
    listening.discover(bus, session)
}
