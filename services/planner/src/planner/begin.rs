//! Requests of a mission or a single move: whether it may begin, its plan, and the offer to motor-io.

use super::Planner;
use cable_robot::Vector3;
use cable_robot::rate::lasting;
use messages::{MotorAuthority, MotorState, NodeEstimate, PlanStatus, put_text, same_life};
use robot_state::Reason;
use robot_state::answers::detail;

use crate::adaptive;
use crate::flight::{Flight, LaterCost};
use crate::inputs::Inputs;
use crate::plan::{Plan, PlanError};
use crate::progress::Progress;
use crate::refusal::Refusal;
use mission::{Leg, Mission, PathShape};

/// An estimate this many cycles behind motor-io is stale, at more than 250 Hz as long: both samples reach the planner
/// on their own ways, on a machine whose hiccups do not become shorter at a higher rate.
const STALE_CYCLES: u32 = 20;

/// A continued mission is planned again: both plans agree to this at the point of the interruption, m.
const AGREES_M: f64 = 0.001;

/// Without a sample of motor-io for this time it counts as gone, ns. A shared computer may stall for 250 ms.
const SILENT_NS: u64 = 1_000_000_000;

impl Planner {
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

    /// Records when the request of the motion that was planned last was made, ns; 0: when it was planned. motor-io does
    /// not begin what was asked for before the robot was told to stop or to hold.
    pub fn asked_at(&mut self, made_ns: u64) {
        if let Some(flight) = self.flight.as_mut().filter(|_| made_ns != 0) {
            flight.asked_ns = made_ns.min(flight.accepted_ns);
        }
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
    pub(super) fn offer(&mut self, mut flight: Flight, continues: bool) -> Reason {
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
}
