//! A mission being flown: which part of it is on its way to motor-io, what was flown before, and what comes at most after it.

use messages::MotorAuthority;

use crate::inputs::Inputs;
use crate::mission::Mission;
use crate::plan::{Plan, PlannerConfig};

/// What the legs from the next adaptive one on come to, as if all of its area were worth it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Later {
    /// At most, s.
    pub time_s: f64,
    /// What the motors lose, J; none where it cannot be told.
    pub energy_j: Option<f64>,
}

impl Later {
    /// That of a plan of its own.
    pub(crate) fn of(plan: &Plan, config: &PlannerConfig) -> Self {
        Self { time_s: plan.end_s() - plan.start_s(), energy_j: plan.energy_j(config) }
    }

    /// That of a whole without its first part.
    pub(crate) fn between(all: &Plan, first: &Plan, config: &PlannerConfig) -> Self {
        let energy_j = all.energy_j(config).zip(first.energy_j(config)).map(|(all_j, first_j)| all_j - first_j);
        Self { time_s: all.end_s() - first.end_s(), energy_j }
    }
}

/// A mission being flown.
#[derive(Debug, Clone)]
pub(crate) struct Flight {
    pub plan: Plan,
    /// What was flown of the mission before, s.
    pub before_s: f64,
    /// How much of the mission is done, 0 to 1, as said last. It never falls: a second look may come out longer than was reckoned, and
    /// whoever goes on has a way back first.
    pub share: f64,
    /// The same part of the mission, all of it from its beginning.
    pub whole: Plan,
    /// What comes then, beginning with an adaptive leg, and what that comes to; legs before this part of the mission.
    pub left: Option<Mission>,
    pub later: Later,
    pub legs_before: u32,
    /// At its end, waiting for a map since then.
    pub waits_ns: Option<u64>,
    /// A mission, not a single move: how far it comes is kept.
    pub kept: bool,
    pub name: String,
    pub motion: u32,
    /// Number of the mission, the same from its acceptance to its end.
    pub mission: u32,
    /// Life and epoch of motor-io for which it was made.
    pub life: u64,
    pub epoch: u32,
    pub current: usize,
    pub accepted_ns: u64,
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
            left: None,
            later: Later::default(),
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
            taken_up: false,
        }
    }

    /// How long the mission has been flown at a time on the plan clock, s; after the end of this part until then.
    pub(crate) fn flown_s(&self, time_s: f64) -> f64 {
        let (start_s, end_s) = (self.plan.start_s(), self.plan.end_s());
        self.before_s + (time_s - start_s).clamp(0.0, end_s - start_s)
    }

    /// How much of the mission is done at a time on the plan clock, 0 to 1.
    pub(crate) fn share_at(&self, time_s: f64) -> f64 {
        let whole_s = self.flown_s(f64::INFINITY) + self.later.time_s;
        let share = if whole_s > 0.0 { self.flown_s(time_s) / whole_s } else { 1.0 };
        share.max(self.share)
    }

    /// What is said to whoever asked for it.
    pub(crate) fn sentence(&self, verb: &str, config: &PlannerConfig) -> String {
        let plan = &self.plan;
        let now_j = plan.energy_j(config);
        let energy = now_j.map_or(String::new(), |joules| format!(", about {joules:.0} J"));
        let then = match &self.left {
            Some(_) => {
                let joules = now_j.zip(self.later.energy_j);
                let energy = joules.map_or(String::new(), |(now_j, later_j)| {
                    format!(" and about {later_j:.0} J, {:.0} J in all", now_j + later_j)
                });
                format!(", then where the map is worth it: at most {:.0} s more{energy}", self.later.time_s)
            }
            None => String::new(),
        };
        format!(
            "mission \"{}\" {verb}: {} segments, {:.2} m, {:.1} s{energy}{then}",
            self.name,
            plan.segments.len(),
            plan.length_m(),
            plan.end_s() - plan.start_s()
        )
    }
}
