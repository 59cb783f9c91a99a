//! Controllers and estimators in their slots: who lives, and what they said last.

use config::EstimatorSection;
use controller::{Controller, ControllerConfig, Inputs};
use estimator::{Estimator, EstimatorConfig, Method};
use messages::{
    CABLES, CONTROLLERS, ControlStatus, MotorAuthority, MotorCommand, MotorInput, MotorState, NodeEstimate, PlanMotion,
    Rule, SLOTS, blended_estimate,
};

/// What a controller said when it was woken.
#[derive(Debug, Clone, Copy)]
pub struct Said {
    /// Its slot.
    pub slot: usize,
    /// Its answer.
    pub command: MotorCommand,
    /// Its account.
    pub status: ControlStatus,
}

/// Each controller is woken by each estimator.
const WAKES: usize = SLOTS * SLOTS;

/// Two controllers and two estimators at most.
pub struct Slots {
    pub(super) controllers: [Option<Controller>; SLOTS],
    estimators: [Option<Estimator>; SLOTS],
    commands: [Option<MotorCommand>; SLOTS],
    statuses: [ControlStatus; SLOTS],
    /// What each channel holds: the last sample, also that of a process that has died since.
    estimates: [Option<NodeEstimate>; SLOTS],
    /// Published in this cycle.
    new: [bool; SLOTS],
    /// What each controller has kept of each channel.
    heard: [[Option<NodeEstimate>; SLOTS]; SLOTS],
    said: [Option<Said>; WAKES],
    lives: u32,
}

impl Slots {
    /// One of each, in slot a.
    pub(super) fn new(estimator: Estimator, controller: Controller) -> Self {
        Self {
            controllers: [Some(controller), None],
            estimators: [Some(estimator), None],
            commands: [None; SLOTS],
            statuses: [ControlStatus::default(); SLOTS],
            estimates: [None; SLOTS],
            new: [false; SLOTS],
            heard: [[None; SLOTS]; SLOTS],
            said: [None; WAKES],
            lives: 100,
        }
    }

    pub(super) fn fork(&self) -> Option<Self> {
        let mut controllers = [None, None];
        for (copy, controller) in controllers.iter_mut().zip(&self.controllers) {
            if let Some(controller) = controller {
                *copy = Some(controller.fork()?);
            }
        }
        Some(Self { controllers, estimators: self.estimators.clone(), ..*self })
    }

    /// Starts a controller; who was in that slot is gone.
    pub fn start_controller(&mut self, slot: usize, config: &ControllerConfig) {
        self.lives += 1;
        self.controllers[slot] = Some(Controller::new(ControllerConfig { incarnation: self.lives, ..*config }));
        self.commands[slot] = None;
        // A channel gives its last sample to those that come later.
        self.heard[slot] = self.estimates;
    }

    /// Starts an estimator; who was in that slot is gone.
    pub fn start_estimator(&mut self, slot: usize, config: &EstimatorConfig, method: Method) {
        self.lives += 1;
        let config = EstimatorConfig { incarnation: self.lives, method, ..*config };
        self.put_estimator(slot, Estimator::new(&config));
    }

    /// The same with an estimator that was made otherwise.
    pub fn put_estimator(&mut self, slot: usize, estimator: Estimator) {
        self.estimators[slot] = Some(estimator);
        self.estimates[slot] = None;
    }

    /// Other parameters for the controller of a slot, from its next answer on; what it then has.
    pub fn configure_controller(
        &mut self,
        slot: usize,
        change: impl FnOnce(ControllerConfig) -> ControllerConfig,
        fade_s: f64,
    ) -> Option<ControllerConfig> {
        let controller = self.controllers[slot].as_mut()?;
        let config = change(*controller.config());
        controller.configure(config, fade_s);
        Some(*controller.config())
    }

    /// Other parameters for the estimator of a slot, from its next estimate on.
    pub fn configure_estimator(&mut self, slot: usize, config: &EstimatorConfig) {
        if let Some(estimator) = &mut self.estimators[slot] {
            estimator.configure(config);
        }
    }

    /// The process of a role in its slot lives.
    pub fn lives(&self, role: usize, slot: usize) -> bool {
        if role == CONTROLLERS { self.controllers[slot].is_some() } else { self.estimators[slot].is_some() }
    }

    /// A program that is none of the robot's publishes an estimate.
    pub fn forge_estimate(&mut self, slot: usize, estimate: NodeEstimate) {
        self.estimates[slot] = Some(estimate);
        self.new[slot] = true;
    }

    /// The same with a command.
    pub fn forge_command(&mut self, slot: usize, command: MotorCommand) {
        self.commands[slot] = Some(command);
    }

    /// A controller that has gone wrong: what it has just answered becomes this.
    pub fn alter_command(&mut self, slot: usize, alter: impl FnOnce(&mut MotorCommand)) {
        if let Some(command) = &mut self.commands[slot] {
            alter(command);
        }
    }

    /// Kills a controller or an estimator ([`CONTROLLERS`], [`messages::ESTIMATORS`]) in its slot; `unheard`: before its last answer had
    /// left it.
    pub fn kill(&mut self, role: usize, slot: usize, unheard: bool) {
        if role == CONTROLLERS {
            self.controllers[slot] = None;
            if unheard {
                self.commands[slot] = None;
            }
            return;
        }
        self.estimators[slot] = None;
        if unheard {
            self.estimates[slot] = None;
            // What nobody estimated, nobody answered.
            for command in self.commands.iter_mut().flatten() {
                command.valid[slot] = 0;
            }
        }
    }

    /// The estimate of each estimator that lives.
    pub fn estimates(&self) -> impl Iterator<Item = (usize, &NodeEstimate)> {
        let lives = self.estimators.iter().map(Option::is_some);
        self.estimates
            .iter()
            .zip(lives)
            .enumerate()
            .filter_map(|(slot, (one, lives))| Some((slot, one.as_ref().filter(|_| lives)?)))
    }

    /// Everything that controllers said in the last cycle, in that order.
    pub fn said(&self) -> impl Iterator<Item = &Said> {
        self.said.iter().flatten()
    }

    /// What has arrived when a cycle begins.
    pub(super) fn arrive(&mut self, input: &mut MotorInput) {
        for slot in 0..SLOTS {
            if let Some(command) = self.commands[slot].take() {
                input.command[slot] = command;
                input.command_arrived[slot] = 1;
            }
            if let Some(estimate) = &self.estimates[slot] {
                input.estimate_cycle[slot] = estimate.header.cycle;
                input.estimate_life[slot] = estimate.header.life;
                input.estimate_valid[slot] = estimate.valid;
                input.estimate_incarnation[slot] = estimate.incarnation;
                input.estimate_position_m[3 * slot..][..3].copy_from_slice(&estimate.position_m);
                input.estimate_tension_n[CABLES * slot..][..CABLES].copy_from_slice(&estimate.tension_n);
            }
        }
    }

    /// Every estimator that lives estimates.
    pub(super) fn estimate(&mut self, state: &MotorState, authority: &MotorAuthority) {
        for (slot, estimator) in self.estimators.iter_mut().enumerate() {
            if let Some(estimator) = estimator {
                self.estimates[slot] = Some(estimator.step(state, Some(authority)));
                self.new[slot] = true;
            }
        }
    }

    /// The estimate that counts.
    pub(super) fn blended(&self, authority: &MotorAuthority) -> Option<NodeEstimate> {
        let rule = Rule::Live { ttl_cycles: EstimatorSection::default().ttl_cycles };
        blended_estimate(Some(authority), [self.estimates[0].as_ref(), self.estimates[1].as_ref()], rule)
    }

    /// Every controller that lives answers, as estimates come in: first that of a, then that of b. Gives what the one in use says.
    pub(super) fn command(
        &mut self,
        state: &MotorState,
        authority: &MotorAuthority,
        motion: &PlanMotion,
    ) -> (MotorCommand, ControlStatus) {
        self.said = [None; WAKES];
        let new = std::mem::take(&mut self.new);
        for wake in (0..SLOTS).filter(|wake| new[*wake]) {
            for slot in 0..SLOTS {
                let Some(controller) = &mut self.controllers[slot] else { continue };
                let heard = &mut self.heard[slot];
                heard[wake] = self.estimates[wake];
                let (command, status) = controller.step(&Inputs {
                    estimates: [heard[0].as_ref(), heard[1].as_ref()],
                    motion: Some(motion),
                    authority: Some(authority),
                    state: Some(state),
                });
                self.said[SLOTS * slot + wake] = Some(Said { slot, command, status });
                // As motor-io takes it in: an answer to this cycle is not displaced by one to another.
                let current = |command: &MotorCommand| command.based_on_cycle == state.header.cycle;
                if current(&command) || !self.commands[slot].as_ref().is_some_and(current) {
                    (self.commands[slot], self.statuses[slot]) = (Some(command), status);
                }
            }
        }
        let used = usize::from(authority.active_controller).min(SLOTS - 1);
        let spoke = if self.commands[used].is_some() { used } else { 1 - used };
        match self.commands[spoke] {
            Some(command) => (command, self.statuses[spoke]),
            None => Default::default(),
        }
    }
}
