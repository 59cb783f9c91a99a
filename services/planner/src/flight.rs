//! Mission being flown: the part that motor-io follows, the part before it, and an upper bound of the rest.

use messages::MotorAuthority;
use robot_state::Reason;
use robot_state::answers::detail;

use crate::inputs::Inputs;
use crate::plan::{Plan, PlannerConfig};
use mission::{Leg, Mission};

/// Upper bound of the legs from the next adaptive one on: its whole area.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LaterCost {
    /// Longest duration, s.
    pub time_s: f64,
    /// Loss in the motors, J; `None` where it is not known.
    pub energy_j: Option<f64>,
}

impl LaterCost {
    /// Returns the bound of a separate plan.
    pub(crate) fn from_plan(plan: &Plan, config: &PlannerConfig) -> Self {
        Self { time_s: plan.end_s() - plan.start_s(), energy_j: plan.energy_j(config) }
    }

    /// Returns the bound of a whole plan without its first part.
    pub(crate) fn between(all: &Plan, first: &Plan, config: &PlannerConfig) -> Self {
        let energy_j = all.energy_j(config).zip(first.energy_j(config)).map(|(all_j, first_j)| all_j - first_j);
        Self { time_s: all.end_s() - first.end_s(), energy_j }
    }
}

/// Mission being flown.
#[derive(Debug, Clone)]
pub(crate) struct Flight {
    pub plan: Plan,
    /// Duration flown in earlier parts of the mission, s.
    pub before_s: f64,
    /// Completed share of the mission, 0 to 1, as last published. It never decreases, although a second look may take
    /// longer than its bound and a continued mission begins with the way back.
    pub share: f64,
    /// The paths of this part and of those before it, for the maps of them.
    pub whole: Plan,
    /// The whole part was flown before: the node only waits for a map, and the stored point of the path stays.
    pub flown: bool,
    /// Rest of the mission, beginning with an adaptive leg; its bound; number of legs before this part.
    pub left: Option<Mission>,
    pub later: LaterCost,
    pub legs_before: u32,
    /// Since when it has waited for a map at its end.
    pub waits_ns: Option<u64>,
    /// A mission whose progress is stored, not a single move.
    pub kept: bool,
    pub name: String,
    pub motion: u32,
    /// Number of the mission, from its acceptance to its end.
    pub mission: u32,
    /// Life and epoch of motor-io for which it was planned.
    pub life: u64,
    pub epoch: u32,
    pub current: usize,
    pub accepted_ns: u64,
    /// When its request was made, ns: before it was accepted.
    pub asked_ns: u64,
    pub taken_up: bool,
}

impl Flight {
    pub(crate) fn new(
        name: String,
        plan: Plan,
        whole: Plan,
        kept: bool,
        authority: &MotorAuthority,
        seen: &Inputs<'_>,
    ) -> Self {
        Self {
            plan,
            before_s: 0.0,
            share: 0.0,
            whole,
            flown: false,
            left: None,
            later: LaterCost::default(),
            legs_before: 0,
            waits_ns: None,
            kept,
            name,
            motion: 0,
            mission: 0,
            life: authority.header.life,
            epoch: authority.epoch,
            current: 0,
            accepted_ns: seen.now_ns,
            asked_ns: seen.now_ns,
            taken_up: false,
        }
    }

    /// Returns the duration flown at a time on the plan clock, s; at most until the end of this part.
    pub(crate) fn flown_s(&self, time_s: f64) -> f64 {
        let (start_s, end_s) = (self.plan.start_s(), self.plan.end_s());
        self.before_s + (time_s - start_s).clamp(0.0, end_s - start_s)
    }

    /// Returns the completed share at a time on the plan clock, 0 to 1.
    pub(crate) fn share_at(&self, time_s: f64) -> f64 {
        let whole_s = self.flown_s(f64::INFINITY) + self.later.time_s;
        let share = if whole_s > 0.0 { self.flown_s(time_s) / whole_s } else { 1.0 };
        share.max(self.share)
    }

    /// Returns the name of the map that its next leg needs.
    pub(crate) fn map(&self) -> Option<&str> {
        match self.left.as_ref()?.leg.first()? {
            Leg::Adaptive(leg) => Some(&leg.map),
            _ => None,
        }
    }

    /// Returns the reason of its end where that map did not come in time.
    pub(crate) fn without_map(&self, within_s: f64) -> Reason {
        Reason::EndedWithoutMap { map: detail(self.map().unwrap_or_default()), within_s }
    }

    /// Returns the answer to its request; `continues`: it is the rest of a mission.
    pub(crate) fn accepted(&self, continues: bool, config: &PlannerConfig) -> Reason {
        let plan = &self.plan;
        Reason::Planned {
            continues,
            segments: plan.segments.len(),
            length_m: plan.length_m(),
            duration_s: plan.end_s() - plan.start_s(),
            energy_j: plan.energy_j(config),
            later: self.left.as_ref().map(|_| (self.later.time_s, self.later.energy_j)),
            mission: detail(&self.name),
        }
    }
}
