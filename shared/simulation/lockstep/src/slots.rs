//! Controllers and estimators in their slots: which are running, and their last samples.

use config::EstimatorSection;
use controller::{Controller, ControllerConfig, Inputs};
use estimator::{Estimator, EstimatorConfig, Method};
use messages::{
    CABLES, CONTROLLERS, ControlStatus, MotorAuthority, MotorCommand, MotorInput, MotorState, NodeEstimate, PlanMotion,
    Rule, SLOTS, blended_estimate,
};

/// Output of a controller for one estimate.
#[derive(Debug, Clone, Copy)]
pub struct ControllerOutput {
    /// Slot of the controller.
    pub slot: usize,
    /// Command.
    pub command: MotorCommand,
    /// Status.
    pub status: ControlStatus,
}

/// Number of controller steps per cycle: each controller runs for each estimator.
const WAKES: usize = SLOTS * SLOTS;

/// At most two controllers and two estimators.
pub struct Slots {
    pub(super) controllers: [Option<Controller>; SLOTS],
    estimators: [Option<Estimator>; SLOTS],
    commands: [Option<MotorCommand>; SLOTS],
    statuses: [ControlStatus; SLOTS],
    /// Content of each channel: the last sample, also of a process that has died since.
    estimates: [Option<NodeEstimate>; SLOTS],
    /// Whether an estimate was published in this cycle.
    new: [bool; SLOTS],
    /// Last estimate of each channel that each controller has received.
    received: [[Option<NodeEstimate>; SLOTS]; SLOTS],
    outputs: [Option<ControllerOutput>; WAKES],
    starts: u32,
}

impl Slots {
    /// Starts with one controller and one estimator, in slot a.
    pub(super) fn new(estimator: Estimator, controller: Controller) -> Self {
        Self {
            controllers: [Some(controller), None],
            estimators: [Some(estimator), None],
            commands: [None; SLOTS],
            statuses: [ControlStatus::default(); SLOTS],
            estimates: [None; SLOTS],
            new: [false; SLOTS],
            received: [[None; SLOTS]; SLOTS],
            outputs: [None; WAKES],
            starts: 100,
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

    /// Starts a controller; replaces the one in that slot.
    pub fn start_controller(&mut self, slot: usize, config: &ControllerConfig) {
        self.starts += 1;
        self.controllers[slot] = Some(Controller::new(ControllerConfig { incarnation: self.starts, ..*config }));
        self.commands[slot] = None;
        // A channel delivers its last sample to new subscribers.
        self.received[slot] = self.estimates;
    }

    /// Starts an estimator; replaces the one in that slot.
    pub fn start_estimator(&mut self, slot: usize, config: &EstimatorConfig, method: Method) {
        self.starts += 1;
        let config = EstimatorConfig { incarnation: self.starts, method, ..*config };
        self.put_estimator(slot, Estimator::new(&config));
    }

    /// Starts a given estimator; replaces the one in that slot.
    pub fn put_estimator(&mut self, slot: usize, estimator: Estimator) {
        self.estimators[slot] = Some(estimator);
        self.estimates[slot] = None;
    }

    /// Changes the parameters of a slot's controller from its next step on; returns the parameters then in use.
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

    /// Changes the parameters of a slot's estimator from its next estimate on.
    pub fn configure_estimator(&mut self, slot: usize, config: &EstimatorConfig) {
        if let Some(estimator) = &mut self.estimators[slot] {
            estimator.configure(config);
        }
    }

    /// Returns whether the process of a role in its slot is running.
    pub fn lives(&self, role: usize, slot: usize) -> bool {
        if role == CONTROLLERS { self.controllers[slot].is_some() } else { self.estimators[slot].is_some() }
    }

    /// Publishes an estimate from a program outside the control chain.
    pub fn forge_estimate(&mut self, slot: usize, estimate: NodeEstimate) {
        self.estimates[slot] = Some(estimate);
        self.new[slot] = true;
    }

    /// Publishes a command from a program outside the control chain.
    pub fn forge_command(&mut self, slot: usize, command: MotorCommand) {
        self.commands[slot] = Some(command);
    }

    /// Alters the last command of a controller, to simulate a faulty one or to answer in its place.
    pub fn alter_command(&mut self, slot: usize, alter: impl FnOnce(&mut MotorCommand)) {
        let Some(command) = &mut self.commands[slot] else { return };
        alter(command);
        let answers = self.outputs.iter_mut().flatten();
        for output in answers.filter(|output| output.slot == slot && is_same_answer(&output.command, command)) {
            output.command = *command;
        }
    }

    /// Kills a controller or an estimator ([`CONTROLLERS`], [`messages::ESTIMATORS`]) in its slot; with `unpublished`,
    /// before it has published its last sample.
    pub fn kill(&mut self, role: usize, slot: usize, unpublished: bool) {
        if role == CONTROLLERS {
            self.controllers[slot] = None;
            if unpublished {
                self.commands[slot] = None;
            }
            return;
        }
        self.estimators[slot] = None;
        if unpublished {
            self.estimates[slot] = None;
            // Without this estimate no command is based on it.
            for command in self.commands.iter_mut().flatten() {
                command.valid[slot] = 0;
            }
        }
    }

    /// Estimates of the running estimators.
    pub fn estimates(&self) -> impl Iterator<Item = (usize, &NodeEstimate)> {
        let lives = self.estimators.iter().map(Option::is_some);
        self.estimates
            .iter()
            .zip(lives)
            .enumerate()
            .filter_map(|(slot, (one, lives))| Some((slot, one.as_ref().filter(|_| lives)?)))
    }

    /// Outputs of all controllers in the last cycle, in order.
    pub fn outputs(&self) -> impl Iterator<Item = &ControllerOutput> {
        self.outputs.iter().flatten()
    }

    /// Collects the input that has arrived at the beginning of a cycle.
    pub(super) fn write_input(&mut self, input: &mut MotorInput) {
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

    /// Runs a step of every running estimator.
    pub(super) fn estimate(&mut self, state: &MotorState, authority: &MotorAuthority) {
        for (slot, estimator) in self.estimators.iter_mut().enumerate() {
            if let Some(estimator) = estimator {
                self.estimates[slot] = Some(estimator.step(state, Some(authority)));
                self.new[slot] = true;
            }
        }
    }

    /// Returns the blended estimate in use.
    pub(super) fn blended(&self, authority: &MotorAuthority) -> Option<NodeEstimate> {
        let rule = Rule::Live { ttl_cycles: EstimatorSection::default().ttl_cycles };
        blended_estimate(Some(authority), [self.estimates[0].as_ref(), self.estimates[1].as_ref()], rule)
    }

    /// Runs every running controller for each new estimate: first that of slot a, then that of slot b. Returns the
    /// output of the controller in use.
    pub(super) fn command(
        &mut self,
        state: &MotorState,
        authority: &MotorAuthority,
        motion: &PlanMotion,
    ) -> (MotorCommand, ControlStatus) {
        self.outputs = [None; WAKES];
        let new = std::mem::take(&mut self.new);
        for wake in (0..SLOTS).filter(|wake| new[*wake]) {
            for slot in 0..SLOTS {
                let Some(controller) = &mut self.controllers[slot] else { continue };
                let received = &mut self.received[slot];
                received[wake] = self.estimates[wake];
                let (command, status) = controller.step(&Inputs {
                    estimates: [received[0].as_ref(), received[1].as_ref()],
                    motion: Some(motion),
                    authority: Some(authority),
                    state: Some(state),
                });
                self.outputs[SLOTS * slot + wake] = Some(ControllerOutput { slot, command, status });
                // As in motor-io: a command for another cycle does not replace one for this cycle.
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

/// Whether two commands are the same answer, however it was altered.
fn is_same_answer(one: &MotorCommand, other: &MotorCommand) -> bool {
    one.based_on_cycle == other.based_on_cycle && one.header.seq == other.header.seq
}
