//! Assembles the samples of each control cycle while a run is read once, in memory that does not grow with the run.

use cable_robot::{Segment, Setpoint};
use messages::{
    ControlStatus, Energy, Message, MotorAuthority, MotorCommand, MotorState, NodeEstimate, PlanMotion, Rule, SLOTS,
    TruthNode, blended_estimate,
};
use runlog::RecordedSample;
use segments::segment_of;
use std::collections::{BTreeMap, VecDeque};

/// Minimum speed of a moving setpoint, m/s; slower ones are the ends of a profile, where every law is accurate.
const MOVING_M_S: f64 = 1e-3;
/// Number of cycles that wait for late samples. The file is sorted by stamps, except for samples that the recorder
/// received one poll (20 ms) later.
const WINDOW: usize = 128;
/// Maximum distance of consecutive rows in cycles; the plan clock between them is known.
const MAX_CYCLE_STEP: u64 = 5;
/// Number of stored motions: the current one, and those of late samples.
const MOTIONS: usize = 4;

/// Samples of one control cycle.
#[derive(Debug, Clone, Copy)]
pub struct Cycle<'a> {
    /// Mode and plan clock.
    pub authority: &'a MotorAuthority,
    /// Mode and plan clock of the next cycle; `None` at the end of a run, life, epoch or motion, and before unrecorded
    /// cycles.
    pub next: Option<&'a MotorAuthority>,
    /// Encoders and drives.
    pub state: Option<&'a MotorState>,
    /// The estimate in charge, if it is valid.
    pub estimate: Option<&'a NodeEstimate>,
    /// Status of the controller in charge.
    pub control: Option<&'a ControlStatus>,
    /// Power and loss.
    pub energy: Option<&'a Energy>,
    /// Time from the publication of `motor/state` to that of the command by which the controller in charge answered it,
    /// ns; `None` without an answer, and in a run of before headers had times of publication.
    pub answered_ns: Option<u64>,
    /// Current segment; `None` unless the robot follows a motion.
    pub segment: Option<&'a Segment>,
    /// Setpoint of the node.
    pub setpoint: Option<Setpoint>,
    /// Whether the setpoint moves.
    pub moving: bool,
    /// Samples of the truth from this cycle to the next one in the file. If that one is not `next`, they have no
    /// setpoint.
    pub truth: &'a [TruthNode],
    segments: &'a [Segment],
}

impl Cycle<'_> {
    /// Returns the setpoint at the time of a true sample between two cycles; `None` without a next cycle.
    #[must_use]
    pub fn setpoint_at(&self, stamp_ns: u64) -> Option<Setpoint> {
        let (now, then) = (self.authority, self.next?);
        let span = then.header.stamp_ns.saturating_sub(now.header.stamp_ns).max(1) as f64;
        let share = stamp_ns.saturating_sub(now.header.stamp_ns) as f64 / span;
        let (now_s, then_s) = (sampled_at_s(now), sampled_at_s(then));
        let plan_time_s = now_s + share * (then_s - now_s);
        segment_at(self.segments, plan_time_s).map(|segment| segment.setpoint(plan_time_s))
    }
}

#[derive(Default)]
struct CycleRow {
    /// Life and cycle.
    place: (u64, u64),
    authority: Option<MotorAuthority>,
    state: Option<MotorState>,
    /// By slot.
    estimates: [Option<NodeEstimate>; SLOTS],
    /// By slot.
    controls: [Option<ControlStatus>; SLOTS],
    /// Times of publication of the commands, by slot, ns.
    commanded_ns: [Option<u64>; SLOTS],
    energy: Option<Energy>,
}

impl CycleRow {
    fn answered_ns(&self, slot: usize) -> Option<u64> {
        let published_ns = self.state.as_ref()?.header.published_ns;
        let commanded_ns = self.commanded_ns.get(slot).copied().flatten()?;
        (published_ns > 0 && commanded_ns > 0).then(|| commanded_ns.saturating_sub(published_ns))
    }
}

/// The segments of one motion, sorted by start time.
#[derive(Default)]
struct MotionSegments {
    epoch: u32,
    segments: Vec<Segment>,
}

/// Assembles cycles. Requires every sample of a run in order, and [`Tracker::finish`] at the end.
#[derive(Default)]
pub struct Tracker {
    rows: VecDeque<CycleRow>,
    motions: BTreeMap<u32, MotionSegments>,
    truth: VecDeque<TruthNode>,
    current_truth: Vec<TruthNode>,
    energy: EnergySum,
}

/// motor-io counts energy from its own start: adds what its earlier lives have counted.
#[derive(Default)]
struct EnergySum {
    last: Option<Energy>,
    before: Option<Energy>,
}

impl EnergySum {
    fn continued(&mut self, recorded: &RecordedSample<'_>) -> Option<Energy> {
        let mut energy = recorded.decode::<Energy>()?;
        if let Some(last) = self.last.filter(|last| last.header.life < energy.header.life) {
            self.before = Some(last);
        }
        if let Some(before) = &self.before {
            let sums = energy.energy_j.iter_mut().zip(before.energy_j);
            sums.chain(energy.loss_j.iter_mut().zip(before.loss_j)).for_each(|(sum, before)| *sum += before);
        }
        self.last = Some(energy);
        Some(energy)
    }
}

impl Tracker {
    /// Records a sample and passes completed cycles to `each`. Returns false if a known channel has a sample of another
    /// version of its type.
    pub fn record(&mut self, recorded: &RecordedSample<'_>, each: &mut impl FnMut(&Cycle<'_>)) -> bool {
        let name = recorded.channel.name.as_str();
        let slot = usize::from(name.ends_with("/b"));
        match name {
            "motor/authority" => self.store(recorded, each, |row, sample| row.authority = Some(sample)),
            "motor/state" => self.store(recorded, each, |row, sample| row.state = Some(sample)),
            "energy" => {
                let Some(energy) = self.energy.continued(recorded) else { return false };
                self.put(energy, each, |row, sample| row.energy = Some(sample))
            }
            "node/estimate/a" | "node/estimate/b" => {
                self.store(recorded, each, |row, sample| row.estimates[slot] = Some(sample))
            }
            "control/status/a" | "control/status/b" => {
                self.store(recorded, each, |row, sample| row.controls[slot] = Some(sample))
            }
            "motor/command/a" | "motor/command/b" => self.store(recorded, each, |row, sample: MotorCommand| {
                row.commanded_ns[slot] = Some(sample.header.published_ns);
            }),
            "truth/node" => recorded.decode::<TruthNode>().map(|truth| self.truth.push_back(truth)).is_some(),
            "plan/motion" => recorded.decode::<PlanMotion>().map(|motion| self.motion(&motion)).is_some(),
            _ => true,
        }
    }

    /// Passes the waiting cycles to `each`.
    pub fn finish(&mut self, each: &mut impl FnMut(&Cycle<'_>)) {
        while let Some(row) = self.rows.pop_front() {
            self.emit(&row, each);
        }
    }

    fn store<T: Message>(
        &mut self,
        recorded: &RecordedSample<'_>,
        each: &mut impl FnMut(&Cycle<'_>),
        set: impl FnOnce(&mut CycleRow, T),
    ) -> bool {
        let Some(sample) = recorded.decode::<T>() else { return false };
        self.put(sample, each, set)
    }

    fn put<T: Message>(
        &mut self,
        sample: T,
        each: &mut impl FnMut(&Cycle<'_>),
        set: impl FnOnce(&mut CycleRow, T),
    ) -> bool {
        let (life, cycle) = (sample.header().life, sample.header().cycle);
        let last = self.rows.back().map_or((0, 0), |row| row.place);
        // A sample from outside the control chain has no life: it belongs to the current one.
        let place = (if life == 0 { last.0 } else { life }, cycle);
        // In runs without lives, only the cycle number shows a restart of motor-io.
        let counts_again = place.0 == last.0 && cycle.saturating_add(10 * WINDOW as u64) < last.1;
        if place.0 > last.0 || counts_again {
            // motor-io was restarted and counts from the beginning.
            self.finish(each);
        }
        let at = self.rows.iter().rposition(|row| row.place <= place);
        match at {
            Some(at) if self.rows[at].place == place => set(&mut self.rows[at], sample),
            // A late sample of a cycle that has already been passed on.
            None if !self.rows.is_empty() => {}
            at => {
                let mut row = CycleRow { place, ..CycleRow::default() };
                set(&mut row, sample);
                self.rows.insert(at.map_or(0, |at| at + 1), row);
            }
        }
        while self.rows.len() > WINDOW {
            if let Some(row) = self.rows.pop_front() {
                self.emit(&row, each);
            }
        }
        true
    }

    fn motion(&mut self, message: &PlanMotion) {
        if message.motion == 0 {
            return;
        }
        let motion = self.motions.entry(message.motion).or_default();
        if motion.epoch != message.epoch {
            // Another planner counts its motions from the beginning.
            *motion = MotionSegments { epoch: message.epoch, segments: Vec::new() };
        }
        for one in [&message.current, &message.next] {
            let known = |segment: &Segment| segment.id == u64::from(one.id) && segment.start_s == one.start_s;
            if one.kind == 0 || motion.segments.iter().rev().any(known) {
                continue;
            }
            if let Some(segment) = segment_of(one) {
                let at = motion.segments.partition_point(|other| other.start_s <= segment.start_s);
                motion.segments.insert(at, segment);
            }
        }
        while self.motions.len() > MOTIONS {
            let oldest = self.motions.keys().copied().find(|number| *number != message.motion);
            oldest.map(|number| self.motions.remove(&number));
        }
    }

    fn emit(&mut self, row: &CycleRow, each: &mut impl FnMut(&Cycle<'_>)) {
        let Some(authority) = &row.authority else { return };
        let next = self.rows.iter().find_map(|row| row.authority.as_ref());
        self.current_truth.clear();
        let until = next.map_or(authority.header.stamp_ns, |next| next.header.stamp_ns);
        while let Some(truth) = self.truth.front().filter(|truth| truth.header.stamp_ns < until).copied() {
            self.truth.pop_front();
            if truth.header.stamp_ns >= authority.header.stamp_ns {
                self.current_truth.push(truth);
            }
        }
        let next = next.filter(|next| follows(authority, next));
        let [a, b] = &row.estimates;
        let estimate = blended_estimate(Some(authority), [a.as_ref(), b.as_ref()], Rule::History);
        let following = authority.mode == MotorAuthority::MODE_FOLLOWING;
        let motion = self.motions.get(&authority.motion).filter(|_| following);
        let segments = motion.map_or(&[][..], |motion| &motion.segments);
        let plan_time_s = sampled_at_s(authority);
        let segment = segment_at(segments, plan_time_s);
        let setpoint = segment.map(|segment| segment.setpoint(plan_time_s));
        let moving = setpoint
            .is_some_and(|setpoint| !setpoint.at_rest && setpoint.velocity.norm() * authority.plan_rate > MOVING_M_S);
        each(&Cycle {
            authority,
            next,
            state: row.state.as_ref(),
            estimate: estimate.as_ref().filter(|estimate| estimate.valid == 1),
            control: row.controls[usize::from(authority.active_controller).min(SLOTS - 1)].as_ref(),
            energy: row.energy.as_ref(),
            answered_ns: row.answered_ns(usize::from(authority.active_controller)),
            segment,
            setpoint,
            moving,
            truth: &self.current_truth,
            segments,
        });
    }
}

/// Returns the plan time at which the counts of a cycle were read, s. The plan clock is stated for the beginning of the
/// cycle, when its commands are sent.
fn sampled_at_s(authority: &MotorAuthority) -> f64 {
    authority.plan_time_s + authority.plan_rate * authority.bus_ns as f64 * 1e-9
}

/// Returns whether the plan clock ran continuously between these cycles.
fn follows(now: &MotorAuthority, next: &MotorAuthority) -> bool {
    let stretch = |authority: &MotorAuthority| (authority.header.life, authority.epoch, authority.motion);
    stretch(now) == stretch(next) && next.header.cycle.saturating_sub(now.header.cycle) <= MAX_CYCLE_STEP
}

/// Returns the segment that started last; the segments are sorted by start time.
fn segment_at(segments: &[Segment], plan_time_s: f64) -> Option<&Segment> {
    let begun = segments.partition_point(|segment| segment.start_s <= plan_time_s);
    begun.checked_sub(1).and_then(|last| segments.get(last))
}
