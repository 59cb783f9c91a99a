//! The deciding parts, each one life of a process after the other, fed with what was recorded.

use super::channel::{History, Why};
use super::config::Configuration;
use super::used::Used;
use controller::{Controller, Inputs};
use estimator::Estimator;
use messages::{ControlStatus, MotorAuthority, MotorCommand, MotorInput, MotorState, NodeEstimate, PlanMotion, SLOTS};
use motor_io::{Answer, Core, Observation};

/// The first sample of a process is not in the run, so nobody knows what it had learnt before.
const BEGINNING: Why = "the beginning of its process's life was not recorded";
/// The same behind a loss.
const GAP: Why = "it follows a gap in the recording";
/// Nothing of this build makes such samples.
const FOREIGN: Why = "made by a program or a law of one's own";
/// An input is not in the run.
const INPUT: Why = "what it was made from was not recorded";

/// One process after the other in the same place.
struct Life<P> {
    part: Option<P>,
    incarnation: u32,
    seq: u64,
    why: Why,
}

impl<P> Life<P> {
    fn none() -> Self {
        Self { part: None, incarnation: 0, seq: 0, why: BEGINNING }
    }

    /// The part that makes the sample of this number: a new one for the first sample of a life, the same one for the next, and none behind
    /// a gap.
    fn part(&mut self, incarnation: u32, seq: u64, begin: impl FnOnce() -> Option<P>) -> Result<&mut P, Why> {
        let same = incarnation == self.incarnation;
        if seq == 1 {
            (self.part, self.why) = (begin(), FOREIGN);
        } else if !same || seq != self.seq + 1 {
            let why = match self.why {
                // What is nobody's stays so.
                FOREIGN if same => FOREIGN,
                _ if same && self.seq > 0 => GAP,
                _ => BEGINNING,
            };
            (self.part, self.why) = (None, why);
        }
        (self.incarnation, self.seq) = (incarnation, seq);
        self.part.as_mut().ok_or(self.why)
    }

    /// What the part missed it cannot make up for.
    fn lose(&mut self, why: Why) -> Why {
        (self.part, self.why) = (None, why);
        why
    }
}

/// What was recorded lately, for those who looked at it.
pub(super) struct Recent {
    pub(super) states: History<MotorState>,
    pub(super) authorities: History<MotorAuthority>,
    pub(super) motions: History<PlanMotion>,
    pub(super) estimates: [History<NodeEstimate>; SLOTS],
    pub(super) commands: [History<MotorCommand>; SLOTS],
    pub(super) used: Used,
}

/// The sample of that cycle or beat; 0: nobody had seen one.
fn seen<T>(history: &History<T>, number: u64, time_ns: u64) -> Result<Option<&T>, Why> {
    match number {
        0 => Ok(None),
        _ => history.find(number, time_ns).map(Some).ok_or(INPUT),
    }
}

/// motor-io: safety machine and arbiter.
pub(super) struct MotorIo {
    life: Life<Core>,
    made: History<Result<Observation, Why>>,
    answers: History<Answer>,
}

impl MotorIo {
    pub(super) fn new() -> Self {
        Self { life: Life::none(), made: History::new(), answers: History::new() }
    }

    /// One cycle.
    pub(super) fn step(&mut self, time_ns: u64, input: &MotorInput, configuration: &Configuration) {
        let core = self.life.part(0, input.header.seq, || Some(configuration.core()));
        let made = core.map(|core| {
            core.decide(input);
            for answer in core.answers() {
                self.answers.push(answer.id, time_ns, *answer);
            }
            core.observe(input)
        });
        self.made.push(input.header.cycle, time_ns, made);
    }

    /// What the cycle came to.
    pub(super) fn made(&self, cycle: u64, time_ns: u64) -> Result<&Observation, Why> {
        self.made.find(cycle, time_ns).ok_or(INPUT)?.as_ref().map_err(|why| *why)
    }

    /// What it answered to a request.
    pub(super) fn answer(&self, id: u64, time_ns: u64) -> Option<&Answer> {
        self.answers.find(id, time_ns)
    }
}

/// The estimators of a slot.
pub(super) struct Estimators {
    life: Life<Estimator>,
}

impl Estimators {
    pub(super) fn new() -> Self {
        Self { life: Life::none() }
    }

    /// The step that made `recorded`, again.
    pub(super) fn step(
        &mut self,
        time_ns: u64,
        recorded: &NodeEstimate,
        recent: &Recent,
        configuration: &Configuration,
    ) -> Result<NodeEstimate, Why> {
        let NodeEstimate { header, incarnation, method, based_on_authority, .. } = *recorded;
        let config = |said: Option<&str>| configuration.estimator(incarnation, method, said);
        let begin = || config(recent.used.at_start(incarnation)).map(|config| Estimator::new(&config));
        let estimator = self.life.part(incarnation, header.seq, begin)?;
        if let Some(config) = recent.used.from(incarnation, header.seq).and_then(|said| config(Some(said))) {
            estimator.configure(&config);
        }
        let state = recent.states.find(header.cycle, time_ns).ok_or(INPUT);
        let inputs = state.and_then(|state| Ok((state, seen(&recent.authorities, based_on_authority, time_ns)?)));
        match inputs {
            Ok((state, authority)) => Ok(estimator.step(state, authority)),
            Err(why) => Err(self.life.lose(why)),
        }
    }
}

/// The controllers of a slot.
pub(super) struct Controllers {
    life: Life<Controller>,
}

impl Controllers {
    pub(super) fn new() -> Self {
        Self { life: Life::none() }
    }

    /// The step that made `recorded` and the command of the same number, again.
    pub(super) fn step(
        &mut self,
        time_ns: u64,
        recorded: &ControlStatus,
        recent: &Recent,
        configuration: &Configuration,
    ) -> Result<(MotorCommand, ControlStatus), Why> {
        let ControlStatus { header, incarnation, chosen_law, .. } = *recorded;
        let config = |said: Option<&str>| configuration.controller(incarnation, chosen_law, said);
        let begin = || config(recent.used.at_start(incarnation)).map(Controller::new);
        let controller = self.life.part(incarnation, header.seq, begin)?;
        if let Some(config) = recent.used.from(incarnation, header.seq).and_then(|said| config(Some(said))) {
            controller.configure(config, configuration.fade_s());
        }
        match inputs(time_ns, recorded, recent) {
            Ok(seen) => {
                let (command, mut status) = controller.step(&seen);
                // What had no say was not handed over.
                status.based_on_estimate = recorded.based_on_estimate;
                Ok((command, status))
            }
            Err(why) => Err(self.life.lose(why)),
        }
    }
}

/// What the controller had seen when it made `recorded`.
fn inputs<'a>(time_ns: u64, recorded: &ControlStatus, recent: &'a Recent) -> Result<Inputs<'a>, Why> {
    let cycles = recorded.based_on_estimate;
    let mut estimates = [None; SLOTS];
    for (slot, history) in recent.estimates.iter().enumerate() {
        let estimate = seen(history, cycles[slot], time_ns);
        // Without the one that was answered there is no answer. The other one decides at most which is answered, and one of a dead
        // estimator may be long ago.
        estimates[slot] = if cycles[slot] == recorded.header.cycle { estimate? } else { estimate.ok().flatten() };
    }
    Ok(Inputs {
        estimates,
        motion: seen(&recent.motions, recorded.based_on_motion, time_ns)?,
        authority: seen(&recent.authorities, recorded.based_on_authority, time_ns)?,
        state: seen(&recent.states, recorded.based_on_state, time_ns)?,
    })
}
