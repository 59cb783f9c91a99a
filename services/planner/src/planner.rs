//! State of the planner: one mission at a time, from its request to the end of its last segment.

mod begin;

use cable_robot::{CableVec, Vector3, elastic};
use messages::{
    CABLES, Header, MotorAuthority, MotorState, NodeEstimate, PlanMotion, PlanSegment, PlanStatus, text_of,
};
use robot_state::Reason;
use robot_state::answers::detail;
use segments::segment_message;

use crate::adaptive;
use crate::flight::{Flight, LaterCost};
use crate::inputs::Inputs;
use crate::plan::{Plan, PlanError, PlannerConfig};
use crate::progress::Progress;
use crate::stopped::{not_taken_up, stopped_by};

/// A motion that motor-io does not take up within this time is withdrawn, ns. Two consecutive swaps of controllers take
/// three seconds.
const TAKE_UP_NS: u64 = 5_000_000_000;

/// Pause between two calls of [`Planner::step`], ns: a segment takes five times as long at least.
const PAUSE_NS: u64 = 100_000_000;
/// The same while something is about to change: before motor-io follows a motion, at the end of a segment, and while
/// the robot comes to rest, ns.
const SHORT_PAUSE_NS: u64 = 50_000_000;

/// Longest wait for a map at the end of a leg, ns: one is usually published every second.
const MAP_NS: u64 = 20_000_000_000;

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

/// Planner of missions and single moves. Pure: time and samples are arguments of every call.
#[derive(Debug, Clone)]
pub struct Planner {
    config: PlannerConfig,
    flight: Option<Flight>,
    next_id: u32,
    motions: u32,
    missions: u32,
    beat: u64,
    refused: u32,
    status: PlanStatus,
    /// The newest valid estimate, and the epoch in which it arrived.
    valid: Option<(NodeEstimate, u32)>,
    progress: Option<Progress>,
    /// The progress that the last mission replaced, until another request; `None`: it replaced nothing.
    replaced: Option<Option<Progress>>,
    /// The lengths as they were set, m, as bits.
    zeroed: [u64; CABLES],
}

impl Planner {
    /// Creates a planner without a mission.
    pub fn new(config: PlannerConfig) -> Self {
        Self {
            config,
            flight: None,
            next_id: 1,
            motions: 0,
            missions: 0,
            beat: 0,
            refused: 0,
            status: PlanStatus::default(),
            valid: None,
            progress: None,
            replaced: None,
            zeroed: [f64::NAN.to_bits(); CABLES],
        }
    }

    /// Follows where the lengths were set, from which the errors of the robot file count in the margins of obstacles.
    pub fn follow_zero(&mut self, state: &MotorState) {
        let zeroed = state.zeroed_m.map(f64::to_bits);
        if zeroed == self.zeroed {
            return;
        }
        self.zeroed = zeroed;
        let robot = &self.config.robot;
        let lengths_m = CableVec::from_array8(&state.zeroed_m, robot.cable_count());
        let known =
            lengths_m.is_finite().then(|| elastic::equilibrium(robot, &lengths_m, &Vector3::zeros(), None).ok());
        let position = known.flatten().map(|found| found.position);
        self.config.robot = robot.with_lengths_set_at(position.as_ref());
    }

    /// Stores the progress of a mission of an earlier planner.
    pub fn remember(&mut self, progress: Progress) {
        if !progress.done {
            let left = Reason::LeftUnfinished { mission: detail(&progress.mission.name) };
            self.status.put_reason(&left.answer());
        }
        self.progress = Some(progress);
    }

    /// Returns the progress of the present or the last mission.
    pub fn progress(&self) -> Option<&Progress> {
        self.progress.as_ref()
    }

    /// Stores the newest valid estimate, so that a single cycle without one refuses nothing.
    fn observe(&mut self, seen: &Inputs<'_>) {
        if let (Some(authority), Some(estimate)) = (seen.authority, seen.estimate)
            && estimate.valid == 1
        {
            self.valid = Some((*estimate, authority.epoch));
        }
    }

    /// Updates the mission and returns its samples; called 10 to 20 times a second and after every request.
    pub fn step(&mut self, seen: &Inputs<'_>) -> (PlanMotion, PlanStatus) {
        self.observe(seen);
        if let Some(authority) = seen.authority {
            self.advance(authority, seen.now_ns);
            self.refine(authority, seen);
        }
        self.beat = self.beat.wrapping_add(1);
        let header = match seen.authority.map(|authority| authority.header) {
            Some(Header { life, cycle, stamp_ns, .. }) => {
                Header { life, cycle, oldest_input_ns: stamp_ns, ..Header::at(seen.now_ns) }
            }
            None => Header::at(seen.now_ns),
        };
        let mut motion = PlanMotion { header, beat: self.beat, ..PlanMotion::default() };
        if let Some(flight) = &self.flight {
            let at = |i: usize| flight.plan.segments.get(i).map_or_else(PlanSegment::default, segment_message);
            motion.current = at(flight.current);
            motion.next = at(flight.current + 1);
            motion.end_s = flight.plan.end_s();
            motion.motion = flight.motion;
            motion.epoch = flight.epoch;
            motion.mission = flight.mission;
            motion.asked_ns = flight.asked_ns;
        }
        self.status.header = header;
        self.status.mission_number = motion.mission;
        (motion, self.status)
    }

    /// Returns the pause until the next call of [`Planner::step`], ns.
    pub fn pause_ns(&self, authority: Option<&MotorAuthority>) -> u64 {
        let Some((flight, authority)) = self.flight.as_ref().zip(authority) else { return PAUSE_NS };
        let at_rest = authority.mode == MotorAuthority::MODE_HOLDING;
        let steady = at_rest || authority.mode == MotorAuthority::MODE_FOLLOWING;
        // The plan clock advances at a rate of at most 1.
        let until_s = authority.plan_time_s + seconds(PAUSE_NS + SHORT_PAUSE_NS);
        let mid_segment = flight.plan.segments.get(flight.current).is_some_and(|segment| until_s < segment.end_s());
        if flight.taken_up && steady && mid_segment { PAUSE_NS } else { SHORT_PAUSE_NS }
    }

    /// Returns the remaining segments, current first.
    pub fn segments(&self) -> &[cable_robot::Segment] {
        self.flight.as_ref().map_or(&[], |flight| &flight.plan.segments[flight.current..])
    }

    /// Returns the name of the map that the next leg of the mission needs.
    pub fn wants_map(&self) -> Option<&str> {
        self.flight.as_ref()?.map()
    }

    /// Plans an adaptive leg at the end of the legs before it, once a map includes all of them.
    fn refine(&mut self, authority: &MotorAuthority, seen: &Inputs<'_>) {
        let Some((flight, since_ns)) = self.flight.as_ref().and_then(|flight| Some((flight, flight.waits_ns?))) else {
            return;
        };
        let (Some(map), Some(left)) = (seen.map.filter(|map| map.header.stamp_ns > since_ns), &flight.left) else {
            return;
        };
        let Some(known) = adaptive::known(map, &flight.whole) else { return };
        let start = flight.plan.end();
        let legs_before = flight.legs_before + flight.plan.leg_count;
        let (name, mission) = (flight.name.clone(), flight.mission);
        let (flown_s, share, asked_ns) = (flight.flown_s(f64::INFINITY), flight.share, flight.asked_ns);
        let mut whole = flight.whole.clone();
        let planned = adaptive::resolved(left, &known, start)
            .map_err(|error| PlanError::Scan { leg: legs_before as usize + 1, error })
            .and_then(|resolved| {
                let (first, left) = adaptive::split(&resolved);
                let (plan, first) = adaptive::planned(first, left.as_ref(), |part| {
                    Plan::new(part, &self.config, start, authority.plan_time_s, self.next_id)
                })?;
                Ok((plan, first, left))
            });
        match planned {
            Ok((plan, first, left)) => {
                let later = left.as_ref().map(|left| Plan::new(left, &self.config, plan.end(), 0.0, 1));
                let later = later
                    .and_then(Result::ok)
                    .map_or(LaterCost::default(), |plan| LaterCost::from_plan(&plan, &self.config));
                if let Some(progress) = &mut self.progress {
                    progress.begin_part(start.into(), flown_s, first, left.clone());
                }
                whole.segments.extend_from_slice(&plan.segments);
                let flight = Flight::new(name, plan, whole, true, authority, seen);
                let flight = Flight { before_s: flown_s, share, later, left, legs_before, mission, asked_ns, ..flight };
                self.offer(flight, true);
            }
            Err(error) => {
                let done = error == PlanError::AlreadyThere;
                self.status.state = if done { PlanStatus::STATE_DONE } else { PlanStatus::STATE_ABORTED };
                self.status.time_left_s = 0.0;
                if done {
                    self.status.progress = 1.0;
                } else {
                    self.status.put_reason(&error.reason().answer());
                }
                if let Some(progress) = &mut self.progress {
                    progress.done = done;
                }
                self.flight = None;
            }
        }
    }

    fn advance(&mut self, authority: &MotorAuthority, now_ns: u64) {
        let Some(flight) = &mut self.flight else { return };
        let time_s = authority.plan_time_s;
        while flight.current + 1 < flight.plan.segments.len() && time_s >= flight.plan.segments[flight.current].end_s()
        {
            flight.current += 1;
        }
        let end_s = flight.plan.end_s();
        let status = &mut self.status;
        status.elapsed_s = flight.flown_s(time_s);
        flight.share = flight.share_at(time_s);
        status.progress = flight.share;
        if flight.kept
            && flight.taken_up
            && authority.epoch == flight.epoch
            && let Some(progress) = &mut self.progress
        {
            if !flight.flown {
                let (mark, at) = flight.plan.reached(time_s);
                (progress.segment, progress.along, progress.at_m) = (mark.segment, mark.along, at.into());
            }
            progress.share = flight.share;
        }
        status.leg = flight.legs_before + flight.plan.legs[flight.current];
        let rate = authority.plan_rate_target;
        status.time_left_s = ((end_s - time_s).max(0.0) + flight.later.time_s) / if rate > 0.0 { rate } else { 1.0 };
        // At rest it is one that motor-io has taken up and not begun, because of a hold after its request.
        let ours = authority.motion == flight.motion;
        flight.taken_up |= ours && authority.mode == MotorAuthority::MODE_FOLLOWING;
        if flight.taken_up || time_s > flight.plan.start_s() {
            self.replaced = None;
        }
        let moving = matches!(authority.mode, MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_STOPPING);
        let over = if (authority.header.life, authority.epoch) != (flight.life, flight.epoch) {
            Some(Err(stopped_by(authority, flight.life)))
        } else if !moving && time_s >= end_s && flight.left.is_some() && authority.mode == MotorAuthority::MODE_HOLDING
        {
            let since_ns = *flight.waits_ns.get_or_insert(now_ns);
            status.state = PlanStatus::STATE_RUNNING;
            let late = now_ns.saturating_sub(since_ns) > MAP_NS;
            if late { Some(Err(flight.without_map(seconds(MAP_NS)))) } else { None }
        } else if !moving && time_s >= end_s {
            Some(Ok(()))
        } else if !matches!(authority.mode, MotorAuthority::MODE_HOLDING) && !moving {
            Some(Err(stopped_by(authority, flight.life)))
        } else if !flight.taken_up && authority.faults & MotorAuthority::FAULT_OFF_START != 0 {
            Some(Err(Reason::EndedOffStart))
        } else if !flight.taken_up && !ours && now_ns.saturating_sub(flight.accepted_ns) > TAKE_UP_NS {
            Some(Err(not_taken_up(authority, seconds(TAKE_UP_NS))))
        } else {
            status.state = if !flight.taken_up && !ours {
                PlanStatus::STATE_READY
            } else if !moving {
                // Only at rest: a pause takes its ramp.
                PlanStatus::STATE_PAUSED
            } else {
                PlanStatus::STATE_RUNNING
            };
            None
        };
        if let Some(end) = over {
            self.end(end);
        }
    }

    /// Ends the mission, as done or for a reason. One that never began to move leaves the place to the one before it.
    fn end(&mut self, end: Result<(), Reason>) {
        let (status, done) = (&mut self.status, end.is_ok());
        status.state = if done { PlanStatus::STATE_DONE } else { PlanStatus::STATE_ABORTED };
        status.time_left_s = 0.0;
        status.put_reason(&end.err().map(|reason| reason.answer()).unwrap_or_default());
        let kept = self.flight.take().is_some_and(|flight| flight.kept);
        match self.replaced.take() {
            Some(before) if !done => self.progress = before,
            _ => {
                if let Some(progress) = self.progress.as_mut().filter(|_| kept) {
                    progress.done = done;
                }
            }
        }
    }
}

/// Returns the state of a mission in words.
pub fn state_text(status: &PlanStatus) -> String {
    let word = match status.state {
        PlanStatus::STATE_READY => "is ready",
        PlanStatus::STATE_RUNNING => "is running",
        PlanStatus::STATE_PAUSED => "is paused",
        PlanStatus::STATE_DONE => "is done",
        PlanStatus::STATE_ABORTED => "was given up",
        PlanStatus::STATE_REFUSED => "was refused",
        _ => "is idle",
    };
    match text_of(&status.reason) {
        reason if reason.is_empty() => word.to_owned(),
        reason => format!("{word}: {reason}"),
    }
}
