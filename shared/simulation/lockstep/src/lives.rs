//! Starts and deaths of motor-io, the planner and the supervisor. (Controllers and estimators:
//! [`Slots`](super::Slots).)

use anyhow::Result;
use messages::{CABLES, PlanStatus};
use motor_io::{Core, CoreConfig};
use planner::{Inputs, Planner, PlannerConfig, Refusal};
use plant::MotorInput as DriveInput;

use super::Lockstep;

/// Time without a packet after which the drives stop their motors, s: the default of `watchdog_s`.
const WATCHDOG_S: f64 = 0.3;

impl Lockstep {
    /// Kills motor-io after the last cycle: the drives keep their commands until their watchdog stops them.
    pub fn kill_motor_io(&mut self) {
        if self.dead_s.is_none() {
            // The last cycle's position is stored on disk.
            self.beginning.restored = self.core.position().or(self.beginning.restored);
            self.dead_s = Some(0.0);
            self.requests.clear();
        }
    }

    /// Starts another life of motor-io: its cycles count from 1, and the last samples of the previous life and of its
    /// peers are still in the channels.
    ///
    /// `restored`: the stored position is available. `alive`: the drives were powered without interruption.
    pub fn start_motor_io(&mut self, config: CoreConfig, restored: bool, alive: bool) {
        self.core = Core::new(config);
        // As in the process: a later life has a larger number, independent of the duration of the previous one.
        self.life = self.life.saturating_add(1);
        (self.cycle, self.setpoints) = (0, motor_io::Setpoints::default());
        self.dead_s = None;
        self.beginning.epoch = self.beginning.epoch.wrapping_add(7919).max(1);
        self.beginning.alive = alive;
        if !restored {
            self.beginning.restored = None;
        }
    }

    /// Returns whether motor-io is running.
    pub fn motor_io_lives(&self) -> bool {
        self.dead_s.is_none()
    }

    /// Returns whether a drive does not hold its cable.
    pub fn releases_a_cable(&self) -> bool {
        self.drives[..self.plant.cable_count()].contains(&DriveInput::RELEASED)
    }

    /// Simulates a period without motor-io.
    ///
    /// # Errors
    /// An error of the plant.
    pub fn pass_without_motor_io(&mut self) -> Result<()> {
        let (n, period_s) = (self.plant.cable_count(), self.scenario.period_s);
        let dead_s = self.dead_s.unwrap_or_default() + period_s;
        self.dead_s = Some(dead_s);
        if dead_s > WATCHDOG_S {
            self.drives = [DriveInput::RELEASED; CABLES];
        }
        self.plant.step(period_s, &self.drives[..n])?;
        self.cycle += 1;
        self.step_planner_in_turn();
        Ok(())
    }

    /// Kills the planner: its last sample stays in its channel.
    pub fn kill_planner(&mut self) {
        self.planner_lives = false;
    }

    /// Starts another planner without a mission; all its counters start again.
    pub fn start_planner(&mut self, config: PlannerConfig) {
        (self.planner, self.planner_lives) = (Planner::new(config), true);
    }

    /// Returns whether the planner is running.
    pub fn planner_lives(&self) -> bool {
        self.planner_lives
    }

    /// Sends a request to the planner, which publishes the result immediately; `None` without a planner.
    ///
    /// # Errors
    /// A rejection by the planner.
    pub fn ask_planner(
        &mut self,
        ask: impl FnOnce(&mut Planner, &Inputs<'_>) -> Result<robot_state::Reason, Refusal>,
    ) -> Option<Result<robot_state::Reason, Refusal>> {
        let seen = Inputs {
            now_ns: self.plant.time_ns(),
            authority: self.authority.as_ref(),
            estimate: self.estimate.as_ref(),
            map: None,
        };
        if !self.planner_lives {
            return None;
        }
        let answer = ask(&mut self.planner, &seen);
        self.step_planner();
        Some(answer)
    }

    /// Last status of the planner.
    pub fn plan_status(&self) -> &PlanStatus {
        &self.plan
    }

    /// Starts or stops the supervisor.
    pub fn supervise(&mut self, lives: bool) {
        self.supervisor.1 = lives;
    }

    /// Returns whether the supervisor is running.
    pub fn supervised(&self) -> bool {
        self.supervisor.1
    }

    /// Returns the supervisor's beat of this cycle.
    pub(super) fn beat(&mut self) -> u64 {
        self.supervisor.0 += u64::from(self.supervisor.1);
        self.supervisor.0
    }
}
