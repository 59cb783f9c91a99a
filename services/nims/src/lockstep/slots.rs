//! Controllers and estimators in their slots: who lives, and what they said last.

use controller::{Controller, ControllerConfig, Seen};
use estimator::{Estimator, EstimatorConfig, Method};
use messages::{
    CABLES, CONTROLLERS, ControlStatus, MotorAuthority, MotorCommand, MotorInput, MotorState, NodeEstimate, PlanMotion,
    SLOTS, blended_estimate,
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
    estimates: [Option<NodeEstimate>; SLOTS],
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
    }

    /// Starts an estimator; who was in that slot is gone.
    pub fn start_estimator(&mut self, slot: usize, config: &EstimatorConfig, method: Method) {
        self.lives += 1;
        self.estimators[slot] = Some(Estimator::new(&EstimatorConfig { incarnation: self.lives, method, ..*config }));
        self.estimates[slot] = None;
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
                input.estimate_valid[slot] = estimate.valid;
                input.estimate_incarnation[slot] = estimate.incarnation;
                input.estimate_position_m[3 * slot..][..3].copy_from_slice(&estimate.position_m);
                input.estimate_tension_n[CABLES * slot..][..CABLES].copy_from_slice(&estimate.tension_n);
            }
        }
    }

    /// Every estimator that lives estimates.
    pub(super) fn estimate(&mut self, state: &MotorState, authority: &MotorAuthority) {
        for (estimator, estimate) in self.estimators.iter_mut().zip(&mut self.estimates) {
            if let Some(estimator) = estimator {
                *estimate = Some(estimator.step(state, Some(authority)));
            }
        }
    }

    /// The estimate that counts.
    pub(super) fn blended(&self, authority: &MotorAuthority) -> Option<NodeEstimate> {
        blended_estimate(Some(authority), [self.estimates[0].as_ref(), self.estimates[1].as_ref()])
    }

    /// Every controller that lives answers, as estimates come in: first to a alone, then to both. Gives what the one in use says.
    pub(super) fn command(
        &mut self,
        state: &MotorState,
        authority: &MotorAuthority,
        motion: &PlanMotion,
    ) -> (MotorCommand, ControlStatus) {
        // Nobody is woken by what came in an earlier cycle.
        let of_now = |estimate: &Option<NodeEstimate>| estimate.filter(|one| one.header.cycle == state.header.cycle);
        let (a, b) = (of_now(&self.estimates[0]), of_now(&self.estimates[1]));
        self.said = [None; WAKES];
        if a.is_none() && b.is_none() {
            return (MotorCommand::default(), ControlStatus::default());
        }
        for slot in 0..SLOTS {
            let Some(controller) = &mut self.controllers[slot] else { continue };
            let mut seen = Seen {
                estimates: [a.as_ref(), None],
                motion: Some(motion),
                authority: Some(authority),
                state: Some(state),
            };
            if a.is_some() && b.is_some() {
                let (command, status) = controller.step(&seen);
                self.said[SLOTS * slot] = Some(Said { slot, command, status });
            }
            seen.estimates[1] = b.as_ref();
            let (command, status) = controller.step(&seen);
            self.said[SLOTS * slot + 1] = Some(Said { slot, command, status });
            (self.commands[slot], self.statuses[slot]) = (Some(command), status);
        }
        let used = usize::from(authority.active_controller).min(SLOTS - 1);
        let spoke = if self.commands[used].is_some() { used } else { 1 - used };
        (self.commands[spoke].unwrap_or_default(), self.statuses[spoke])
    }
}
