//! State of the planner: one mission at a time, from its request to the end of its last segment.

use cable_robot::rate::lasting;
use cable_robot::{CableVec, Vector3, elastic};
use messages::{
    CABLES, Header, MotorAuthority, MotorState, NodeEstimate, PlanMotion, PlanSegment, PlanStatus, put_text, same_life,
    text_of,
};
use robot_state::Reason;
use robot_state::answers::detail;
use segments::segment_message;

use crate::adaptive;
use crate::flight::{Flight, LaterCost};
use crate::inputs::Inputs;
use crate::plan::{Plan, PlanError, PlannerConfig};
use crate::progress::Progress;
use crate::refusal::Refusal;
use crate::stopped::{not_taken_up, stopped_by};
use mission::{Leg, Mission, PathShape};

/// An estimate this many cycles behind motor-io is stale, at more than 250 Hz as long: both samples reach the planner
/// on their own ways, on a machine whose hiccups do not become shorter at a higher rate.
const STALE_CYCLES: u32 = 20;

/// A continued mission is planned again: both plans agree to this at the point of the interruption, m.
const AGREES_M: f64 = 0.001;

/// A motion that motor-io does not take up within this time is withdrawn, ns. Two consecutive swaps of controllers take
/// three seconds.
const TAKE_UP_NS: u64 = 5_000_000_000;

/// Longest wait for a map at the end of a leg, ns: one is usually published every second.
const MAP_NS: u64 = 20_000_000_000;

/// Without a sample of motor-io for this time it counts as gone, ns. A shared computer may stall for 250 ms.
const SILENT_NS: u64 = 1_000_000_000;

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

    /// Plans a move to a point, m, on a path of that shape, and offers it to motor-io. A parabola may have a given µ,
    /// 1/m, in place of the one with the least loss in the motors. The default of the speed, m/s, is the configured
    /// one.
    ///
    /// # Errors
    /// The reason of the refusal; nothing moves.
    pub fn goto(
        &mut self,
        to_m: [f64; 3],
        speed_m_s: Option<f64>,
        shape: PathShape,
        mu_per_m: Option<f64>,
        seen: &Inputs<'_>,
    ) -> Result<Reason, Refusal> {
        let to = to_m.into();
        let leg = if shape == PathShape::Parabola && mu_per_m.is_some() {
            Leg::Parabola(mission::Parabola { to_m: to, mu_per_m, speed_m_s })
        } else {
            Leg::Line(mission::Line { to_m: to, speed_m_s })
        };
        let name = format!("goto {} {} {}", to_m[0], to_m[1], to_m[2]);
        let mission = Mission {
            name,
            speed_m_s: None,
            acceleration_m_s2: None,
            path: shape,
            time_weight_w: 0.0,
            relative: false,
            leg: vec![leg],
        };
        let result = self.try_run(&mission, false, seen);
        self.answered(&mission, result)
    }

    /// Plans and checks a whole mission, and offers it to motor-io.
    ///
    /// # Errors
    /// The reason of the refusal; nothing moves.
    pub fn run(&mut self, mission: &Mission, seen: &Inputs<'_>) -> Result<Reason, Refusal> {
        let result = self.try_run(mission, true, seen);
        self.answered(mission, result)
    }

    /// Plans the rest of an interrupted mission, from the point of the interruption on, and offers it to motor-io.
    ///
    /// # Errors
    /// The reason of the refusal; nothing moves.
    pub fn go_on(&mut self, mission: &Mission, seen: &Inputs<'_>) -> Result<Reason, Refusal> {
        let result = self.try_go_on(mission, seen);
        self.answered(mission, result)
    }

    /// Withdraws a motion that was planned and not offered yet, so that the mission before can still be continued;
    /// returns the answer.
    pub fn take_back(&mut self) -> Reason {
        let reason = Reason::RequesterTimedOut;
        self.flight = None;
        if let Some(before) = self.replaced.take() {
            self.progress = before;
        }
        self.status.state = PlanStatus::STATE_REFUSED;
        self.status.put_reason(&reason.answer());
        reason
    }

    fn answered(&mut self, mission: &Mission, result: Result<Reason, Refusal>) -> Result<Reason, Refusal> {
        if let Err(refusal) = &result {
            self.refused = self.refused.wrapping_add(1);
            self.status.refused = self.refused;
            // A refusal must not hide a mission that is being flown.
            if self.flight.is_none() {
                self.status.state = PlanStatus::STATE_REFUSED;
                put_text(&mut self.status.mission, &mission.name);
            }
            self.status.put_reason(&refusal.reason().answer());
        }
        result
    }

    fn try_run(&mut self, mission: &Mission, kept: bool, seen: &Inputs<'_>) -> Result<Reason, Refusal> {
        let mission = mission.clone().checked()?;
        let (authority, estimate) = self.ready(seen)?;
        let start = Vector3::from(estimate.position_m);
        // The whole mission can be flown, with the whole area of each adaptive leg.
        let all = Plan::new(&mission, &self.config, start, authority.plan_time_s, self.next_id)?;
        let (first, left) = adaptive::split(&mission);
        let (plan, first) = match &left {
            None => (all.clone(), first),
            Some(_) => adaptive::planned(first, left.as_ref(), |part| {
                Plan::new(part, &self.config, start, authority.plan_time_s, self.next_id)
            })?,
        };
        self.replaced = None;
        if kept {
            let at_m = estimate.position_m;
            let stage = left.is_some().then_some(first);
            let (segment, along, done) = (0, 0.0, false);
            let (mission, left) = (mission.clone(), left.clone());
            let (flown_s, share) = (0.0, 0.0);
            let start_m = at_m;
            let before = None;
            let progress =
                Progress { start_m, segment, along, at_m, done, flown_s, share, mission, stage, left, before };
            self.replaced = Some(self.progress.replace(progress));
        }
        let later = match left {
            Some(_) => LaterCost::between(&all, &plan, &self.config),
            None => LaterCost::default(),
        };
        let flight = Flight { later, left, ..Flight::new(mission.name, plan.clone(), plan, kept, authority, seen) };
        Ok(self.offer(flight, false))
    }

    fn try_go_on(&mut self, mission: &Mission, seen: &Inputs<'_>) -> Result<Reason, Refusal> {
        let refuse = |reason: Reason| Err(Refusal::NotReady(Box::new(reason)));
        let name = &mission.name;
        let named = || detail(name);
        let Some(progress) = self.progress.clone().filter(|progress| progress.mission.name == *name) else {
            return refuse(Reason::MissionNotBegun { mission: named() });
        };
        if progress.mission != *mission {
            return refuse(Reason::MissionChanged { mission: named() });
        }
        if progress.done {
            return refuse(Reason::MissionDone { mission: named() });
        }
        let (authority, estimate) = self.ready(seen)?;
        self.replaced = None;
        let stage = progress.stage.as_ref().unwrap_or(mission);
        let whole = Plan::new(stage, &self.config, Vector3::from(progress.start_m), 0.0, 1)?;
        let mark = progress.mark();
        let segment = whole.segments.get(mark.segment).ok_or(PlanError::OtherPlan)?;
        if (segment.path.point(mark.along) - Vector3::from(progress.at_m)).norm() > AGREES_M {
            return Err(PlanError::OtherPlan.into());
        }
        let dwells = matches!(segment.path, cable_robot::Path::Dwell(_));
        let in_segment_s = if dwells { mark.along } else { segment.profile.time_at(mark.along) };
        let before_s = progress.flown_s + segment.start_s + in_segment_s;
        let here = Vector3::from(estimate.position_m);
        let rest = whole.rest(stage, &self.config, mark, here, authority.plan_time_s, self.next_id);
        let done = rest == Err(PlanError::AlreadyThere);
        let plan = match &progress.left {
            // Only the map is missing: the robot waits for it at rest.
            Some(_) if done => {
                let stay = adaptive::staying(stage);
                Plan::new(&stay, &self.config, here, authority.plan_time_s, self.next_id)?
            }
            None if done => return refuse(Reason::MissionDone { mission: named() }),
            _ => rest?,
        };
        let later = match &progress.left {
            Some(left) => LaterCost::from_plan(&Plan::new(left, &self.config, whole.end(), 0.0, 1)?, &self.config),
            None => LaterCost::default(),
        };
        let mut flown = whole;
        // They only help the next map: joined parts that fail a check of the whole keep nothing from being flown.
        if let Some(before) = &progress.before
            && let Ok(before) = Plan::new(&before.mission, &self.config, before.start_m.into(), 0.0, 1)
        {
            flown.segments.extend(before.segments);
        }
        let legs_left = stage.leg.len() + progress.left.as_ref().map_or(0, |left| left.leg.len());
        let legs_before = mission.leg.len().saturating_sub(legs_left) as u32;
        let flight = Flight {
            before_s,
            share: progress.share,
            later,
            left: progress.left,
            legs_before,
            flown: done,
            ..Flight::new(name.clone(), plan, flown, true, authority, seen)
        };
        Ok(self.offer(flight, true))
    }

    /// Offers a motion to motor-io; returns the answer to its request.
    fn offer(&mut self, mut flight: Flight, continues: bool) -> Reason {
        let plan = &flight.plan;
        self.next_id = self.next_id.wrapping_add(plan.segments.len() as u32).max(1);
        self.motions = self.motions.wrapping_add(1).max(1);
        flight.motion = self.motions;
        if flight.mission == 0 {
            self.missions = self.missions.wrapping_add(1).max(1);
            flight.mission = self.missions;
        }
        let reason = flight.accepted(continues, &self.config);
        self.status = PlanStatus {
            refused: self.refused,
            legs: 0,
            leg: flight.legs_before + plan.legs[0],
            elapsed_s: flight.before_s,
            progress: flight.share,
            ..PlanStatus::default()
        };
        let left = flight.left.as_ref().map_or(0, |left| left.leg.len() as u32);
        self.status.legs = flight.legs_before + plan.leg_count + left;
        self.status.state = PlanStatus::STATE_READY;
        self.status.target_m = plan.end().into();
        put_text(&mut self.status.mission, &flight.name);
        self.flight = Some(flight);
        reason
    }

    /// Stores the newest valid estimate, so that a single cycle without one refuses nothing.
    fn observe(&mut self, seen: &Inputs<'_>) {
        if let (Some(authority), Some(estimate)) = (seen.authority, seen.estimate)
            && estimate.valid == 1
        {
            self.valid = Some((*estimate, authority.epoch));
        }
    }

    /// Returns authority and estimate if a motion may start now.
    fn ready<'a>(&mut self, seen: &Inputs<'a>) -> Result<(&'a MotorAuthority, NodeEstimate), Refusal> {
        self.observe(seen);
        let refuse = |reason: Reason| Err(Refusal::NotReady(Box::new(reason)));
        let Some(authority) = seen.authority else { return refuse(Reason::MotorIoAbsent) };
        if seen.now_ns.saturating_sub(authority.header.stamp_ns) > SILENT_NS {
            return refuse(Reason::MotorIoAbsent);
        }
        if let Some(flight) = &self.flight {
            let mission = detail(&flight.name);
            let paused = self.status.state == PlanStatus::STATE_PAUSED;
            return refuse(if paused { Reason::MissionPaused { mission } } else { Reason::MissionRuns { mission } });
        }
        match authority.mode {
            // Of a planner that has ended: motor-io keeps it for a resume, and takes up no other meanwhile.
            MotorAuthority::MODE_HOLDING if authority.motion != 0 => return refuse(Reason::ForeignMotion),
            MotorAuthority::MODE_HOLDING => {}
            MotorAuthority::MODE_DISARMED => return refuse(Reason::RobotDisarmed),
            MotorAuthority::MODE_JOGGING => return refuse(Reason::RobotJogging),
            MotorAuthority::MODE_SOFT => return refuse(Reason::RobotSoft),
            MotorAuthority::MODE_FAULTED => return refuse(Reason::RobotFaulted),
            MotorAuthority::MODE_EMERGENCY_STOP => return refuse(Reason::RobotEmergencyStop),
            _ => return refuse(Reason::RobotMoves),
        }
        match authority.position_known {
            MotorState::POSITION_KNOWN => {}
            MotorState::POSITION_RESTORED => return refuse(Reason::PositionRestored),
            _ => return refuse(Reason::PositionUnknown),
        }
        let stale = u64::from(lasting(STALE_CYCLES, authority.period_s));
        let fresh = |(estimate, epoch): &(NodeEstimate, u32)| {
            // another epoch may have another position of the node
            *epoch == authority.epoch
                && same_life(&estimate.header, &authority.header)
                && estimate.header.cycle.saturating_add(stale) >= authority.header.cycle
        };
        let Some((estimate, _)) = self.valid.filter(fresh) else { return refuse(Reason::NoEstimate) };
        Ok((authority, estimate))
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
        }
        self.status.header = header;
        self.status.mission_number = motion.mission;
        (motion, self.status)
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
        let (flown_s, share) = (flight.flown_s(f64::INFINITY), flight.share);
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
                let flight = Flight { before_s: flown_s, share, later, left, legs_before, mission, ..flight };
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
        } else if !flight.taken_up && now_ns.saturating_sub(flight.accepted_ns) > TAKE_UP_NS {
            Some(Err(not_taken_up(authority, seconds(TAKE_UP_NS))))
        } else {
            status.state = if !flight.taken_up {
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
