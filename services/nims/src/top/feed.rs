//! Fills snapshots from the bus.

use super::snapshot::{ChannelRow, Recording, Scale, Snapshot};
use bus::{Participant, clock};
use client::{Place, RobotLink, Samples};
use command::Answer;
use messages::{
    ControlStatus, Heartbeat, Message, MotorAuthority, MotorSlots, MotorState, NodeEstimate, PlanStatus, ProcessState,
    RecorderStatus, Request, SLOT_NAMES, SLOTS, text_of,
};
use std::collections::BTreeMap;

/// Participants that only observe: if a domain has no others, no robot runs in it.
const OBSERVERS: [&str; 2] = ["nims-command", "gateway"];
/// Time between two checks whether the robot still runs, ns.
const CHECK_NS: u64 = 1_000_000_000;
/// Number of rows over which a rate is averaged. The recorder publishes one row per channel and second; an average over
/// fewer flickers.
const RATE_ROWS: usize = 4;

/// Subscriptions to everything that `nims top` shows, with the newest sample of each.
pub struct Feed {
    link: RobotLink,
    run: String,
    scale: Scale,
    checked_ns: u64,
    authority: Newest<MotorAuthority>,
    state: Newest<MotorState>,
    slots: Newest<MotorSlots>,
    estimate: [Newest<NodeEstimate>; SLOTS],
    control: [Newest<ControlStatus>; SLOTS],
    plan: Newest<PlanStatus>,
    table: Samples<ProcessState>,
    rows: BTreeMap<String, ProcessState>,
    beats: BTreeMap<String, Newest<Heartbeat>>,
    recorder: Samples<RecorderStatus>,
    channels: BTreeMap<String, ChannelCounts>,
    recording: Option<Recording>,
}

struct Newest<T: Message> {
    subscriber: Samples<T>,
    sample: Option<T>,
}

impl<T: Message> Newest<T> {
    fn subscribe(link: &RobotLink, channel: &str) -> Answer<Self> {
        Ok(Self { subscriber: link.subscriber(channel)?, sample: None })
    }

    fn poll(&mut self) -> Answer<Option<T>> {
        self.sample = self.subscriber.latest()?.or(self.sample);
        Ok(self.sample)
    }
}

/// The recorder's last rows of a channel: each with its stamp in ns and the number of messages until then.
#[derive(Debug, Default)]
struct ChannelCounts {
    rows: Vec<(u64, u64)>,
    lost: u64,
}

impl ChannelCounts {
    fn record(&mut self, stamp_ns: u64, messages: u64, lost: u64) {
        // A restarted recorder counts from 0.
        if self.rows.last().is_some_and(|(_, before)| *before > messages) {
            self.rows.clear();
        }
        if self.rows.len() == RATE_ROWS {
            self.rows.remove(0);
        }
        self.rows.push((stamp_ns, messages));
        self.lost = lost;
    }

    fn hz(&self) -> f64 {
        match (self.rows.first(), self.rows.last()) {
            (Some((from_ns, from)), Some((to_ns, to))) if to_ns > from_ns => {
                (to - from) as f64 / ((to_ns - from_ns) as f64 * 1e-9)
            }
            _ => 0.0,
        }
    }
}

impl Feed {
    /// Sends a request to motor-io; returns its answer or the refusal.
    pub fn request(&self, request: &Request) -> String {
        client::send(&self.link, client::MOTOR_IO, request).unwrap_or_else(|refusal| refusal.to_string())
    }

    /// Joins the domain of this name, or that of the only running robot.
    ///
    /// # Errors
    /// No robot runs, or several robots run and none is named.
    pub fn join(place: Place<'_>) -> Answer<Self> {
        let link = client::link_as(place, Participant::Guest)?;
        if !is_alive(&link) {
            return Err(command::Failure::NotNow(format!("no robot runs in the domain `{}`", link.name())));
        }
        let slot = |kind: &str, slot: usize| format!("{kind}/{}", SLOT_NAMES[slot]);
        Ok(Self {
            run: link.running()?.map(|running| running.run.display().to_string()).unwrap_or_default(),
            scale: scale(&link).unwrap_or_default(),
            checked_ns: clock::now_ns(),
            authority: Newest::subscribe(&link, "motor/authority")?,
            state: Newest::subscribe(&link, "motor/state")?,
            slots: Newest::subscribe(&link, "motor/slots")?,
            estimate: [
                Newest::subscribe(&link, &slot("node/estimate", 0))?,
                Newest::subscribe(&link, &slot("node/estimate", 1))?,
            ],
            control: [
                Newest::subscribe(&link, &slot("control/status", 0))?,
                Newest::subscribe(&link, &slot("control/status", 1))?,
            ],
            plan: Newest::subscribe(&link, "plan/status")?,
            table: link.subscriber("system/process")?,
            rows: BTreeMap::new(),
            beats: BTreeMap::new(),
            recorder: link.subscriber("recorder/status")?,
            channels: BTreeMap::new(),
            recording: None,
            link,
        })
    }

    /// Returns whether the robot still runs; checks once a second.
    pub fn is_alive(&mut self) -> bool {
        let now = clock::now_ns();
        if now < self.checked_ns + CHECK_NS {
            return true;
        }
        self.checked_ns = now;
        is_alive(&self.link)
    }

    /// Receives new samples and returns a snapshot.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn poll(&mut self) -> Answer<Snapshot> {
        while let Some(row) = self.table.receive()? {
            let name = text_of(&row.name);
            if row.state == ProcessState::STATE_GONE {
                self.rows.remove(&name);
                self.beats.remove(&name);
                continue;
            }
            if row.pid != 0 && !self.beats.contains_key(&name) {
                self.beats.insert(name.clone(), Newest::subscribe(&self.link, &format!("system/heartbeat/{name}"))?);
            }
            self.rows.insert(name, row);
        }
        while let Some(row) = self.recorder.receive()? {
            let stamp_ns = row.header.stamp_ns;
            self.channels.entry(text_of(&row.channel)).or_default().record(stamp_ns, row.messages, row.lost);
            self.recording = Some(Recording {
                why: client::unrecorded_of(&row),
                bytes: row.total_bytes,
                lost: 0,
                free_bytes: row.disk_free_bytes,
                stamp_ns,
            });
        }
        let lost = self.channels.values().map(|counts| counts.lost).sum();
        let mut processes = Vec::with_capacity(self.rows.len());
        for (name, row) in &self.rows {
            let beat = self.beats.get_mut(name).map(Newest::poll).transpose()?.flatten();
            processes.push((*row, beat.filter(|beat| beat.pid == row.pid)));
        }
        // In the order of their start; processes that do not run come last.
        processes.sort_by_key(|(row, _)| (row.pid == 0, row.started_ns));
        let [estimate_a, estimate_b] = &mut self.estimate;
        let [control_a, control_b] = &mut self.control;
        Ok(Snapshot {
            answer: String::new(),
            now_ns: clock::now_ns(),
            domain: Some(self.link.name().to_owned()),
            waiting: String::new(),
            run: self.run.clone(),
            scale: self.scale,
            authority: self.authority.poll()?,
            state: self.state.poll()?,
            slots: self.slots.poll()?,
            estimate: [estimate_a.poll()?, estimate_b.poll()?],
            control: [control_a.poll()?, control_b.poll()?],
            plan: self.plan.poll()?,
            processes,
            channels: self
                .channels
                .iter()
                .map(|(name, counts)| ChannelRow { name: name.clone(), hz: counts.hz(), lost: counts.lost })
                .collect(),
            recording: self.recording.clone().map(|recording| Recording { lost, ..recording }),
        })
    }
}

fn is_alive(link: &RobotLink) -> bool {
    link.alive().is_ok_and(|alive| alive.iter().any(|node| !OBSERVERS.contains(&node.name.as_str())))
}

/// Returns the full scale from the robot file; the longest possible cable joins the two anchors that are farthest
/// apart.
fn scale(link: &RobotLink) -> Option<Scale> {
    let file = client::system_of(link).ok()?.robot_file().ok()?;
    let robot = file.robot().ok()?;
    let anchors = robot.anchors();
    let distances_m = anchors.iter().flat_map(|a| anchors.iter().map(move |b| (a - b).norm()));
    Some(Scale {
        length_m: distances_m.fold(1.0, f64::max),
        tension_n: robot.tension_limits_n(),
        current_a: file.motor.current_limit_a,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_covers_the_last_rows_and_restarts_with_a_new_recorder() {
        let mut counts = ChannelCounts::default();
        assert_eq!(counts.hz(), 0.0);
        for second in 1..=10_u64 {
            // 100 Hz until the fifth second, then 10 Hz
            let messages = if second <= 5 { 100 * second } else { 500 + 10 * (second - 5) };
            counts.record(second * 1_000_000_000, messages, second);
        }
        assert_eq!((counts.hz(), counts.lost), (10.0, 10));
        counts.record(11_000_000_000, 3, 0);
        assert_eq!(counts.hz(), 0.0);
        counts.record(12_000_000_000, 53, 0);
        assert_eq!((counts.hz(), counts.lost), (50.0, 0));
    }
}
