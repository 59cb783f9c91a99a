//! Lives and deaths of the processes beside controllers and estimators: motor-io, the planner, the supervisor.

use anyhow::Result;
use messages::{CABLES, PlanStatus};
use motor_io::{Core, CoreConfig};
use planner::{Inputs, Planner, PlannerConfig, Refusal};
use plant::MotorInput as DriveInput;

use super::Lockstep;

/// The drives stop their motors after this time without a packet, s: the default of `watchdog_s`.
const WATCHDOG_S: f64 = 0.3;

impl Lockstep {
    /// motor-io dies after the last cycle: the drives go on by what they were told, until their watchdog stops them.
    pub fn kill_motor_io(&mut self) {
        if self.dead_s.is_none() {
            // What is kept on the disk is that of the last cycle.
            self.beginning.restored = self.core.position().or(self.beginning.restored);
            self.dead_s = Some(0.0);
            self.requests.clear();
        }
    }

    /// Another life of motor-io: its cycles count from 1, and what the dead one and its peers said last is still in the channels.
    ///
    /// `restored`: it finds where the lines were. `alive`: the drives had power all the time.
    pub fn start_motor_io(&mut self, config: CoreConfig, restored: bool, alive: bool) {
        self.core = Core::new(config);
        // As in the process: a later life has a larger number, however long the one before it was.
        self.life = self.life.saturating_add(1);
        (self.cycle, self.setpoints) = (0, motor_io::Setpoints::default());
        self.dead_s = None;
        self.beginning.epoch = self.beginning.epoch.wrapping_add(7919).max(1);
        self.beginning.alive = alive;
        if !restored {
            self.beginning.restored = None;
        }
    }

    /// motor-io lives.
    pub fn motor_io_lives(&self) -> bool {
        self.dead_s.is_none()
    }

    /// A line is not held by its drive.
    pub fn lets_go(&self) -> bool {
        self.drives[..self.plant.cable_count()].contains(&DriveInput::RELEASED)
    }

    /// A period without motor-io.
    ///
    /// # Errors
    /// The plant's.
    pub fn pass_without_motor_io(&mut self) -> Result<()> {
        let (n, period_s) = (self.plant.cable_count(), self.scenario.period_s);
        let dead_s = self.dead_s.unwrap_or_default() + period_s;
        self.dead_s = Some(dead_s);
        if dead_s > WATCHDOG_S {
            self.drives = [DriveInput::RELEASED; CABLES];
        }
        self.plant.step(period_s, &self.drives[..n])?;
        self.cycle += 1;
        if self.cycle.is_multiple_of(super::PLANNER_CYCLES) {
            self.plan();
        }
        Ok(())
    }

    /// The planner dies: what it published last stays in its channel.
    pub fn kill_planner(&mut self) {
        self.planner_lives = false;
    }

    /// Another planner in its place, without a mission, that counts everything from the beginning.
    pub fn start_planner(&mut self, config: PlannerConfig) {
        (self.planner, self.planner_lives) = (Planner::new(config), true);
    }

    /// The planner lives.
    pub fn planner_lives(&self) -> bool {
        self.planner_lives
    }

    /// Something for the planner, which publishes what comes of it at once; `None` without a planner.
    ///
    /// # Errors
    /// The planner's refusal.
    pub fn ask_planner(
        &mut self,
        ask: impl FnOnce(&mut Planner, &Inputs<'_>) -> Result<String, Refusal>,
    ) -> Option<Result<String, Refusal>> {
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
        self.plan();
        Some(answer)
    }

    /// What the planner said last.
    pub fn plan_status(&self) -> &PlanStatus {
        &self.plan
    }

    /// From now on there is a supervisor, or not any more.
    pub fn supervise(&mut self, lives: bool) {
        self.supervisor.1 = lives;
    }

    /// The supervisor lives.
    pub fn supervised(&self) -> bool {
        self.supervisor.1
    }

    /// The supervisor's beat of this cycle.
    pub(super) fn beat(&mut self) -> u64 {
        self.supervisor.0 += u64::from(self.supervisor.1);
        self.supervisor.0
    }
}
