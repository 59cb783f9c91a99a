//! Fills snapshots from the bus.

use super::snapshot::{ChannelRow, Recording, Scale, Snapshot};
use bus::{Bus, Domain, Party, Subscriber, clock};
use client::Running;
use command::Answer;
use messages::{
    ControlStatus, Heartbeat, Message, MotorAuthority, MotorSlots, MotorState, NodeEstimate, PlanStatus, ProcessState,
    RecorderStatus, SLOT_NAMES, SLOTS, text_of,
};
use std::collections::BTreeMap;

/// The name under which it joins a domain.
const NAME: &str = "nims-top";
/// Names of those who only look on: where nobody else is, no robot runs.
const ONLOOKERS: [&str; 2] = [NAME, "nims-command"];
/// How often it looks whether the robot is still, or again, there, ns.
const LOOK_NS: u64 = 1_000_000_000;
/// The recorder's rows come once a second; over this many a rate is steady enough to be read.
const RATE_ROWS: usize = 4;

/// The newest of everything that a robot says.
pub struct Feed {
    bus: Bus,
    domain: Domain,
    run: String,
    scale: Scale,
    looked_ns: u64,
    authority: Newest<MotorAuthority>,
    state: Newest<MotorState>,
    slots: Newest<MotorSlots>,
    estimate: [Newest<NodeEstimate>; SLOTS],
    control: [Newest<ControlStatus>; SLOTS],
    plan: Newest<PlanStatus>,
    table: Subscriber<ProcessState>,
    rows: BTreeMap<String, ProcessState>,
    beats: BTreeMap<String, Newest<Heartbeat>>,
    recorder: Subscriber<RecorderStatus>,
    channels: BTreeMap<String, Counted>,
    recording: Option<Recording>,
}

struct Newest<T: Message> {
    subscriber: Subscriber<T>,
    sample: Option<T>,
}

impl<T: Message> Newest<T> {
    fn of(bus: &Bus, channel: &str) -> Answer<Self> {
        Ok(Self { subscriber: bus.subscriber(channel)?, sample: None })
    }

    fn look(&mut self) -> Answer<Option<T>> {
        self.sample = self.subscriber.latest()?.or(self.sample);
        Ok(self.sample)
    }
}

/// The recorder's last rows of a channel: when, and how many messages until then.
#[derive(Debug, Default)]
struct Counted {
    rows: Vec<(u64, u64)>,
    lost: u64,
}

impl Counted {
    fn note(&mut self, stamp_ns: u64, messages: u64, lost: u64) {
        // a new recorder counts from the beginning
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
    /// Joins the robot that is meant.
    ///
    /// # Errors
    /// No robot runs, or several do.
    pub fn join(name: Option<&str>) -> Answer<Self> {
        let domain = client::domain(name)?;
        if !is_alive(&domain) {
            return Err(command::Failure::NotNow(format!("no robot runs in the domain `{}`", domain.name())));
        }
        let bus = Bus::join_as(&domain, NAME, Party::Guest)?;
        let slot = |kind: &str, slot: usize| format!("{kind}/{}", SLOT_NAMES[slot]);
        Ok(Self {
            run: Running::of(&domain).map(|running| running.run.display().to_string()).unwrap_or_default(),
            scale: scale(&bus).unwrap_or_default(),
            looked_ns: clock::now_ns(),
            authority: Newest::of(&bus, "motor/authority")?,
            state: Newest::of(&bus, "motor/state")?,
            slots: Newest::of(&bus, "motor/slots")?,
            estimate: [Newest::of(&bus, &slot("node/estimate", 0))?, Newest::of(&bus, &slot("node/estimate", 1))?],
            control: [Newest::of(&bus, &slot("control/status", 0))?, Newest::of(&bus, &slot("control/status", 1))?],
            plan: Newest::of(&bus, "plan/status")?,
            table: bus.subscriber("system/process")?,
            rows: BTreeMap::new(),
            beats: BTreeMap::new(),
            recorder: bus.subscriber("recorder/status")?,
            channels: BTreeMap::new(),
            recording: None,
            domain,
            bus,
        })
    }

    /// Whether the robot is still there; looks once a second.
    pub fn is_alive(&mut self) -> bool {
        let now = clock::now_ns();
        if now < self.looked_ns + LOOK_NS {
            return true;
        }
        self.looked_ns = now;
        is_alive(&self.domain)
    }

    /// Takes in what has come.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn look(&mut self) -> Answer<Snapshot> {
        while let Some(row) = self.table.receive()? {
            let name = text_of(&row.name);
            if row.state == ProcessState::STATE_GONE {
                self.rows.remove(&name);
                self.beats.remove(&name);
                continue;
            }
            if row.pid != 0 && !self.beats.contains_key(&name) {
                self.beats.insert(name.clone(), Newest::of(&self.bus, &format!("system/heartbeat/{name}"))?);
            }
            self.rows.insert(name, row);
        }
        while let Some(row) = self.recorder.receive()? {
            let stamp_ns = row.header.stamp_ns;
            self.channels.entry(text_of(&row.channel)).or_default().note(stamp_ns, row.messages, row.lost);
            self.recording = Some(Recording {
                why: client::unrecorded_of(&row),
                bytes: row.total_bytes,
                lost: 0,
                free_bytes: row.disk_free_bytes,
                stamp_ns,
            });
        }
        let lost = self.channels.values().map(|counted| counted.lost).sum();
        let mut processes = Vec::with_capacity(self.rows.len());
        for (name, row) in &self.rows {
            let beat = self.beats.get_mut(name).map(Newest::look).transpose()?.flatten();
            processes.push((*row, beat.filter(|beat| beat.pid == row.pid)));
        }
        // In the order in which they were started.
        processes.sort_by_key(|(row, _)| (row.pid == 0, row.started_ns));
        let [estimate_a, estimate_b] = &mut self.estimate;
        let [control_a, control_b] = &mut self.control;
        Ok(Snapshot {
            now_ns: clock::now_ns(),
            domain: Some(self.domain.name().to_owned()),
            waiting: String::new(),
            run: self.run.clone(),
            scale: self.scale,
            authority: self.authority.look()?,
            state: self.state.look()?,
            slots: self.slots.look()?,
            estimate: [estimate_a.look()?, estimate_b.look()?],
            control: [control_a.look()?, control_b.look()?],
            plan: self.plan.look()?,
            processes,
            channels: self
                .channels
                .iter()
                .map(|(name, counted)| ChannelRow { name: name.clone(), hz: counted.hz(), lost: counted.lost })
                .collect(),
            recording: self.recording.clone().map(|recording| Recording { lost, ..recording }),
        })
    }
}

fn is_alive(domain: &Domain) -> bool {
    domain.alive().iter().any(|node| !ONLOOKERS.contains(&node.name.as_str()))
}

/// What the robot's file says of its limits.
fn scale(bus: &Bus) -> Option<Scale> {
    let file = client::box_of(bus).ok()?.robot_file().ok()?;
    let robot = file.robot().ok()?;
    let anchors = robot.anchors();
    let apart = anchors.iter().flat_map(|a| anchors.iter().map(move |b| (a - b).norm()));
    Some(Scale {
        length_m: apart.fold(1.0, f64::max),
        tension_n: robot.tension_limits_n(),
        current_a: file.motor.current_limit_a,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_counted_over_the_last_rows_and_begins_anew_with_a_new_recorder() {
        let mut counted = Counted::default();
        assert_eq!(counted.hz(), 0.0);
        for second in 1..=10_u64 {
            // slower from the fifth second on
            let messages = if second <= 5 { 100 * second } else { 500 + 10 * (second - 5) };
            counted.note(second * 1_000_000_000, messages, second);
        }
        assert_eq!((counted.hz(), counted.lost), (10.0, 10));
        counted.note(11_000_000_000, 3, 0);
        assert_eq!(counted.hz(), 0.0);
        counted.note(12_000_000_000, 53, 0);
        assert_eq!((counted.hz(), counted.lost), (50.0, 0));
    }
}
