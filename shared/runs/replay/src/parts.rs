//! The deciding parts, one instance per incarnation of a process, fed with the recorded inputs.

use super::channel::{History, SkipReason};
use super::config::Configuration;
use super::reported::ReportedParameters;
use controller::{Controller, Inputs};
use estimator::Estimator;
use messages::{ControlStatus, MotorAuthority, MotorCommand, MotorInput, MotorState, NodeEstimate, PlanMotion, SLOTS};
use motor_io::{Answer, Core, Observation};

/// The first sample of an incarnation is missing, so the state at its first recorded sample is unknown.
const BEGINNING: SkipReason = "the start of its process was not recorded";
/// The same after a loss.
const GAP: SkipReason = "it follows a gap in the recording";
/// This build has no code that computes such samples.
const FOREIGN: SkipReason = "computed by a custom program, law or estimator";
/// An input is missing in the run.
const INPUT: SkipReason = "one of its inputs was not recorded";

/// The incarnations of a process in one slot, one after the other.
struct Incarnations<P> {
    part: Option<P>,
    incarnation: u32,
    seq: u64,
    why: SkipReason,
}

impl<P> Incarnations<P> {
    fn new() -> Self {
        Self { part: None, incarnation: 0, seq: 0, why: BEGINNING }
    }

    /// Returns the part that computes the sample with this number: a new one for the first sample of an incarnation,
    /// the same one for the next sample, and none after a gap.
    fn part(&mut self, incarnation: u32, seq: u64, begin: impl FnOnce() -> Option<P>) -> Result<&mut P, SkipReason> {
        let same = incarnation == self.incarnation;
        if seq == 1 {
            (self.part, self.why) = (begin(), FOREIGN);
        } else if !same || seq != self.seq + 1 {
            let why = match self.why {
                // A custom program stays one for its whole incarnation.
                FOREIGN if same => FOREIGN,
                _ if same && self.seq > 0 => GAP,
                _ => BEGINNING,
            };
            (self.part, self.why) = (None, why);
        }
        (self.incarnation, self.seq) = (incarnation, seq);
        self.part.as_mut().ok_or(self.why)
    }

    /// Returns the state of the part as text; of one that does not compute now, why.
    fn state(&self) -> Option<String>
    where
        P: std::fmt::Debug,
    {
        match &self.part {
            Some(part) => Some(without_configuration(&format!("{part:#?}"))),
            None => (self.seq > 0).then(|| self.why.to_owned()),
        }
    }

    /// Discards the part, because it missed an input and cannot continue.
    fn lose(&mut self, why: SkipReason) -> SkipReason {
        (self.part, self.why) = (None, why);
        why
    }
}

/// Leaves out the configuration of a part, which the run file has in full and which would hide the rest.
fn without_configuration(state: &str) -> String {
    let mut inside = false;
    let mut kept = Vec::new();
    for line in state.lines() {
        inside |= line.starts_with("    config: ");
        if !inside {
            kept.push(line);
        }
        inside &= line != "    },";
    }
    kept.join("\n")
}

/// Recently recorded samples, indexed for the parts that used them.
pub(super) struct Recent {
    pub(super) states: History<MotorState>,
    pub(super) authorities: History<MotorAuthority>,
    pub(super) motions: History<PlanMotion>,
    pub(super) estimates: [History<NodeEstimate>; SLOTS],
    pub(super) commands: [History<MotorCommand>; SLOTS],
    pub(super) reported: ReportedParameters,
}

/// Returns the sample of that cycle or beat; 0 means that the process had not received one.
fn received<T>(history: &History<T>, number: u64, time_ns: u64) -> Result<Option<&T>, SkipReason> {
    match number {
        0 => Ok(None),
        _ => history.find(number, time_ns).map(Some).ok_or(INPUT),
    }
}

/// motor-io: safety machine and arbiter.
pub(super) struct MotorIo {
    incarnations: Incarnations<Core>,
    made: History<Result<Observation, SkipReason>>,
    answers: History<Answer>,
}

impl MotorIo {
    /// Returns the internal state as text; `None` without a sample.
    pub(super) fn state(&self) -> Option<String> {
        self.incarnations.state()
    }

    pub(super) fn new() -> Self {
        Self { incarnations: Incarnations::new(), made: History::new(), answers: History::new() }
    }

    /// Computes one cycle.
    pub(super) fn step(&mut self, time_ns: u64, input: &MotorInput, configuration: &Configuration) {
        let core = self.incarnations.part(0, input.header.seq, || Some(configuration.core()));
        let made = core.map(|core| {
            core.decide(input);
            for answer in core.answers() {
                self.answers.push(answer.id, time_ns, *answer);
            }
            core.observe(input)
        });
        self.made.push(input.header.cycle, time_ns, made);
    }

    /// Returns the outcome of a cycle.
    pub(super) fn made(&self, cycle: u64, time_ns: u64) -> Result<&Observation, SkipReason> {
        self.made.find(cycle, time_ns).ok_or(INPUT)?.as_ref().map_err(|why| *why)
    }

    /// Returns the answer to a request.
    pub(super) fn answer(&self, id: u64, time_ns: u64) -> Option<&Answer> {
        self.answers.find(id, time_ns)
    }
}

/// The estimators of a slot.
pub(super) struct Estimators {
    incarnations: Incarnations<Estimator>,
}

impl Estimators {
    /// Returns the internal state as text; `None` without a sample.
    pub(super) fn state(&self) -> Option<String> {
        self.incarnations.state()
    }

    pub(super) fn new() -> Self {
        Self { incarnations: Incarnations::new() }
    }

    /// Recomputes the step that produced `recorded`.
    pub(super) fn step(
        &mut self,
        time_ns: u64,
        recorded: &NodeEstimate,
        recent: &Recent,
        configuration: &Configuration,
    ) -> Result<NodeEstimate, SkipReason> {
        let NodeEstimate { header, incarnation, method, based_on_authority, .. } = *recorded;
        let config = |parameters: Option<&str>| configuration.estimator(incarnation, method, parameters);
        let begin = || config(recent.reported.at_start(incarnation)).map(|config| Estimator::new(&config));
        let estimator = self.incarnations.part(incarnation, header.seq, begin)?;
        if let Some(config) =
            recent.reported.from(incarnation, header.seq).and_then(|parameters| config(Some(parameters)))
        {
            estimator.configure(&config);
        }
        let state = recent.states.find(header.cycle, time_ns).ok_or(INPUT);
        let inputs = state.and_then(|state| Ok((state, received(&recent.authorities, based_on_authority, time_ns)?)));
        match inputs {
            Ok((state, authority)) => Ok(estimator.step(state, authority)),
            Err(why) => Err(self.incarnations.lose(why)),
        }
    }
}

/// The controllers of a slot.
pub(super) struct Controllers {
    incarnations: Incarnations<Controller>,
}

impl Controllers {
    /// Returns the internal state as text; `None` without a sample.
    pub(super) fn state(&self) -> Option<String> {
        self.incarnations.state()
    }

    pub(super) fn new() -> Self {
        Self { incarnations: Incarnations::new() }
    }

    /// Recomputes the step that produced `recorded` and the command of the same number.
    pub(super) fn step(
        &mut self,
        time_ns: u64,
        recorded: &ControlStatus,
        recent: &Recent,
        configuration: &Configuration,
    ) -> Result<(MotorCommand, ControlStatus), SkipReason> {
        let ControlStatus { header, incarnation, chosen_law, .. } = *recorded;
        let config = |parameters: Option<&str>| configuration.controller(incarnation, chosen_law, parameters);
        let begin = || configuration.start(config(recent.reported.at_start(incarnation))?);
        let controller = self.incarnations.part(incarnation, header.seq, begin)?;
        if let Some(config) =
            recent.reported.from(incarnation, header.seq).and_then(|parameters| config(Some(parameters)))
        {
            controller.configure(config, configuration.fade_s());
        }
        match inputs(time_ns, recorded, recent) {
            Ok(inputs) => {
                let (command, mut status) = controller.step(&inputs);
                // An estimate that had no effect was not passed to the step.
                status.based_on_estimate = recorded.based_on_estimate;
                Ok((command, status))
            }
            Err(why) => Err(self.incarnations.lose(why)),
        }
    }
}

/// Returns the inputs that the controller had when it computed `recorded`.
fn inputs<'a>(time_ns: u64, recorded: &ControlStatus, recent: &'a Recent) -> Result<Inputs<'a>, SkipReason> {
    let cycles = recorded.based_on_estimate;
    let mut estimates = [None; SLOTS];
    for (slot, history) in recent.estimates.iter().enumerate() {
        let estimate = received(history, cycles[slot], time_ns);
        // The estimate of the answered cycle is required. The other one only affects which is answered; that of a dead
        // estimator may be too old to be found.
        estimates[slot] = if cycles[slot] == recorded.header.cycle { estimate? } else { estimate.ok().flatten() };
    }
    Ok(Inputs {
        estimates,
        motion: received(&recent.motions, recorded.based_on_motion, time_ns)?,
        authority: received(&recent.authorities, recorded.based_on_authority, time_ns)?,
        state: received(&recent.states, recorded.based_on_state, time_ns)?,
    })
}
