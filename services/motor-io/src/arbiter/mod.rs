//! Choice of the command: two slots of controllers, each answering for two slots of estimators.
//!
//! Every cycle judges each slot's command and estimate, and each role has one slot in charge ([`role`]). The command
//! is that of the controller in charge on the estimate in charge. Where one of the two fails, a standby's answer of
//! the same cycle is used, so that neither a death nor a swap costs a cycle. The change from one source to another
//! is faded ([`fade`]).

pub mod bias;
pub mod fade;
pub mod role;

use crate::limits::largest;
use crate::settings::CoreConfig;
use bias::Bias;
use fade::Fade;
use messages::{
    CABLES, CONTROLLERS, ESTIMATORS, MotorAuthority, MotorCommand, MotorInput, MotorSlots, ROLE_SLOTS, ROLES, SLOTS,
    same_life,
};
use role::{Phase, Refusal, Reply, Report, Role, SlotState, Times};

/// Multiple of the speed limit beyond which a command is wrong and not just saturated.
const ABSURD: f64 = 4.0;

/// Time constants of the average difference within the time of qualification, so that earlier
/// differences have no effect.
const BIAS_PASSES: f64 = 3.0;

/// Command of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChosenCommand {
    /// Cable velocities, m/s; finite, zero beyond the robot's cables.
    pub velocity_m_s: [f64; CABLES],
    /// Controller slot.
    pub controller: usize,
    /// Estimator slot.
    pub estimator: usize,
    /// Segment of the command; 0: none.
    pub segment: u32,
    /// Cycles for which it may be used.
    pub ttl_cycles: u32,
    /// Time of the oldest reading behind the command, ns.
    pub oldest_input_ns: u64,
}

/// State of the cycle that the arbiter needs besides the input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArbiterInput {
    /// Epoch; commands for another one are rejected.
    pub epoch: u32,
    /// A motion is followed, or stops on its path.
    pub moving: bool,
    /// Velocities sent to the drives in the previous cycle, m/s.
    pub sent_m_s: [f64; CABLES],
    /// Seats that the computer kept from running; a missing answer is not held against a newcomer there.
    pub starved: [bool; ROLE_SLOTS],
}

/// Answer of a controller to one estimate.
#[derive(Debug, Clone, Copy)]
enum Row {
    Absent,
    Wrong(u8),
    Good([f64; CABLES]),
}

impl Row {
    fn good(&self) -> Option<[f64; CABLES]> {
        if let Self::Good(velocity_m_s) = self { Some(*velocity_m_s) } else { None }
    }
}

/// Both rows of a slot's command; `Err`: the verdict on the command as a whole.
type Rows = Result<[Row; SLOTS], u8>;

/// Both roles, the fade between commands, and what is published about the slots.
#[derive(Debug, Clone)]
pub struct Arbiter {
    cables: usize,
    absurd_m_s: f64,
    bound_m_s: f64,
    bound_m: f64,
    bias_share: f64,
    bias_bound_m_s: f64,
    qualify: u32,
    roles: [Role; ROLES],
    fade: Fade,
    verdict: [u8; SLOTS],
    /// Deviations from the slot in charge, m/s and m; negative: nothing to compare.
    apart: [f64; ROLE_SLOTS],
    /// Average deviation of each controller from the one in charge.
    bias: [Bias; SLOTS],
    used: (usize, usize),
}

impl Arbiter {
    /// Empty slots, a in charge in both roles.
    #[must_use]
    pub fn new(config: &CoreConfig) -> Self {
        let times = Times {
            qualify: config.cycles(config.qualify_s),
            announce: config.cycles(config.announce_s),
            probation: config.cycles(config.probation_s),
            forgive: config.cycles(config.forgive_s),
            falls: config.quarantine_falls,
            gone: config.lasting(role::GONE_CYCLES),
            apart: config.lasting(role::APART_CYCLES),
        };
        Self {
            cables: config.cable_count(),
            absurd_m_s: ABSURD * config.cable_speed_m_s,
            bound_m_s: config.command_bound * config.cable_speed_m_s,
            bound_m: config.estimate_bound_m,
            bias_share: config.bias_share,
            bias_bound_m_s: config.bias_bound_m_s,
            qualify: times.qualify,
            roles: [Role::new(times), Role::new(times)],
            fade: Fade::new(config.cycles(config.fade_s)),
            verdict: [MotorAuthority::VERDICT_NONE; SLOTS],
            apart: [-1.0; ROLE_SLOTS],
            bias: [Bias::default(); SLOTS],
            used: (0, 0),
        }
    }

    /// Judges what arrived for this cycle and chooses a command. `follows` returns true if a command for a segment
    /// belongs to the robot's motion.
    pub fn choose(
        &mut self,
        input: &MotorInput,
        context: &ArbiterInput,
        follows: impl Fn(u32) -> bool,
    ) -> Option<ChosenCommand> {
        let cycle = input.header.cycle;
        let rows: [Rows; SLOTS] = std::array::from_fn(|slot| self.rows(input, slot, context, &follows));
        let estimates: [Reply; SLOTS] = std::array::from_fn(|slot| estimate(input, slot));
        let lead = self.in_charge();
        let of_role =
            |role: usize| -> [bool; SLOTS] { std::array::from_fn(|slot| context.starved[role * SLOTS + slot]) };
        self.compare(input, &rows, &estimates);
        let usable: [bool; SLOTS] = std::array::from_fn(|e| {
            let who = input.estimate_incarnation[e];
            estimates[e] == Reply::Good && self.roles[ESTIMATORS].may_use(e, who, context.moving)
        });
        let reports: [Report; SLOTS] = std::array::from_fn(|slot| {
            let reply = self.reply(input, slot, &rows[slot], &usable);
            let incarnation = if reply == Reply::Silent { 0 } else { input.command[slot].incarnation };
            let bias = self.bias[slot].relative(self.bias_share, self.bias_bound_m_s);
            Report { reply, incarnation, apart: share(self.apart[slot], self.bound_m_s).map(|apart| apart.max(bias)) }
        });
        let controller = self.roles[CONTROLLERS].step(cycle, context.moving, &of_role(CONTROLLERS), &reports);
        self.record_verdicts(&reports, context.moving);

        let reports: [Report; SLOTS] = std::array::from_fn(|e| {
            let answered = controller.is_some_and(|c| matches!(&rows[c], Ok(rows) if rows[e].good().is_some()));
            let reply = match estimates[e] {
                Reply::Good if !answered => Reply::Nothing,
                other => other,
            };
            let incarnation = if reply == Reply::Silent { 0 } else { input.estimate_incarnation[e] };
            Report { reply, incarnation, apart: share(self.apart[SLOTS + e], self.bound_m) }
        });
        let estimator = self.roles[ESTIMATORS].step(cycle, context.moving, &of_role(ESTIMATORS), &reports);
        let (Some(controller), Some(estimator)) = (controller, estimator) else {
            return None;
        };
        let pair = (controller, estimator);
        let known: [bool; SLOTS] = std::array::from_fn(|slot| {
            self.roles[CONTROLLERS].may_use(slot, input.command[slot].incarnation, context.moving)
        });
        let answers = |(c, e): (usize, usize)| {
            rows[c].as_ref().ok().filter(|_| known[c] && usable[e]).and_then(|rows| rows[e].good())
        };
        // Both state machines guarantee an answer here; `?` only satisfies the type checker.
        let velocity_m_s = if context.moving {
            let planned = pair == self.in_charge() && self.roles.iter().any(Role::swapping) && pair != lead;
            self.fade.step(pair, &context.sent_m_s, planned, answers)?
        } else {
            self.fade.rest(Some(pair));
            answers(pair)?
        };
        debug_assert!(velocity_m_s.iter().all(|v| v.is_finite()), "the chosen command is not finite: {velocity_m_s:?}");
        self.used = pair;
        let command = &input.command[controller];
        Some(ChosenCommand {
            velocity_m_s,
            controller,
            estimator,
            segment: command.segment,
            ttl_cycles: command.ttl_cycles,
            oldest_input_ns: command.header.oldest_input_ns,
        })
    }

    /// Returns the rows of a slot's command, or the verdict on the command as a whole.
    fn rows(&self, input: &MotorInput, slot: usize, context: &ArbiterInput, follows: &impl Fn(u32) -> bool) -> Rows {
        let command = &input.command[slot];
        if input.command_arrived[slot] == 0 {
            return Err(MotorAuthority::VERDICT_ABSENT);
        }
        if !same_life(&command.header, &input.header) {
            return Err(MotorAuthority::VERDICT_LIFE);
        }
        if command.epoch != context.epoch {
            return Err(MotorAuthority::VERDICT_EPOCH);
        }
        if command.incarnation == 0 {
            return Err(MotorAuthority::VERDICT_INCARNATION);
        }
        if command.based_on_cycle.checked_add(1) != Some(input.header.cycle) {
            return Err(MotorAuthority::VERDICT_STALE);
        }
        if context.moving && !follows(command.segment) {
            return Err(MotorAuthority::VERDICT_SEGMENT);
        }
        Ok(std::array::from_fn(|estimator| self.row(command, estimator)))
    }

    fn row(&self, command: &MotorCommand, estimator: usize) -> Row {
        if command.valid[estimator] != 1 {
            return Row::Absent;
        }
        let mut velocity_m_s = [0.0; CABLES];
        velocity_m_s[..self.cables].copy_from_slice(&command.velocity_m_s[estimator * CABLES..][..self.cables]);
        if !velocity_m_s.iter().all(|v| v.is_finite()) {
            Row::Wrong(MotorAuthority::VERDICT_NOT_FINITE)
        } else if largest(&velocity_m_s) > self.absurd_m_s {
            Row::Wrong(MotorAuthority::VERDICT_OUT_OF_LIMITS)
        } else {
            Row::Good(velocity_m_s)
        }
    }

    /// Classifies a controller's answer: good if it has a good row for a usable estimate.
    fn reply(&mut self, input: &MotorInput, slot: usize, rows: &Rows, usable: &[bool; SLOTS]) -> Reply {
        let (verdict, reply) = match rows {
            Err(MotorAuthority::VERDICT_ABSENT) => {
                let never = self.verdict[slot] == MotorAuthority::VERDICT_NONE && input.command_arrived[slot] == 0;
                (if never { MotorAuthority::VERDICT_NONE } else { MotorAuthority::VERDICT_ABSENT }, Reply::Silent)
            }
            Err(verdict) => (*verdict, Reply::Nothing),
            Ok(rows) if (0..SLOTS).any(|e| usable[e] && rows[e].good().is_some()) => {
                (MotorAuthority::VERDICT_ACCEPTED, Reply::Good)
            }
            Ok(rows) => rows
                .iter()
                .find_map(|row| match row {
                    Row::Wrong(MotorAuthority::VERDICT_NOT_FINITE) => {
                        Some((MotorAuthority::VERDICT_NOT_FINITE, Reply::Wrong(MotorSlots::CAUSE_NOT_FINITE)))
                    }
                    Row::Wrong(verdict) => Some((*verdict, Reply::Wrong(MotorSlots::CAUSE_OUT_OF_LIMITS))),
                    _ => None,
                })
                .unwrap_or((MotorAuthority::VERDICT_NO_ESTIMATE, Reply::Nothing)),
        };
        self.verdict[slot] = verdict;
        reply
    }

    /// Rejects a good command of a process that is not known in its slot while the robot moves.
    fn record_verdicts(&mut self, reports: &[Report; SLOTS], moving: bool) {
        for (slot, report) in reports.iter().enumerate() {
            if report.reply == Reply::Good && !self.roles[CONTROLLERS].may_use(slot, report.incarnation, moving) {
                self.verdict[slot] = MotorAuthority::VERDICT_INCARNATION;
            }
        }
    }

    /// Computes the deviations of the slots that are not in charge.
    fn compare(&mut self, input: &MotorInput, rows: &[Rows; SLOTS], estimates: &[Reply; SLOTS]) {
        self.apart = [-1.0; ROLE_SLOTS];
        let (controller, estimator) = self.in_charge();
        let (other, beside) = (1 - controller, 1 - estimator);
        if let (Ok(lead), Ok(side)) = (&rows[controller], &rows[other]) {
            // Compared on the estimate in charge, or, if a controller has no answer to it, on the other estimate.
            let both = |e: usize| Some((lead[e].good()?, side[e].good()?));
            if let Some((lead, side)) = both(estimator).or_else(|| both(beside)) {
                self.apart[other] = distance(&lead, &side);
                self.bias[other].add(&lead, &side, BIAS_PASSES / f64::from(self.qualify.max(1)));
            }
        }
        // One cycle without an answer does not reset the average of this process.
        let slot = self.roles[CONTROLLERS].slot(other);
        let changed = input.command_arrived[other] != 0 && input.command[other].incarnation != slot.incarnation();
        if changed || slot.phase() == Phase::Empty {
            self.bias[other] = Bias::default();
        }
        self.bias[controller] = Bias::default();
        if estimates[estimator] == Reply::Good && estimates[beside] == Reply::Good {
            let mut square = 0.0;
            for i in 0..3 {
                let difference =
                    input.estimate_position_m[3 * beside + i] - input.estimate_position_m[3 * estimator + i];
                square += difference * difference;
            }
            self.apart[SLOTS + beside] = square.sqrt();
        }
    }

    /// Average deviation of a controller from the one in charge, m/s per cable.
    #[must_use]
    pub fn bias_m_s(&self, slot: usize) -> &[f64; CABLES] {
        self.bias[slot].difference_m_s()
    }

    /// Announces a swap; returns the cycle in which it takes effect.
    ///
    /// # Errors
    /// The reason why the swap is refused.
    pub fn announce(&mut self, role: usize, slot: usize, cycle: u64) -> Result<u64, Refusal> {
        if self.roles[1 - role].swapping() {
            return Err(Refusal::UnderWay);
        }
        self.roles[role].announce(slot, cycle)
    }

    /// Takes a slot out of quarantine.
    ///
    /// # Errors
    /// The slot is not in quarantine.
    pub fn admit(&mut self, role: usize, slot: usize) -> Result<(), Refusal> {
        self.roles[role].admit(slot)
    }

    /// Slots in charge: controller and estimator.
    #[must_use]
    pub fn in_charge(&self) -> (usize, usize) {
        (self.roles[CONTROLLERS].in_charge(), self.roles[ESTIMATORS].in_charge())
    }

    /// Slots whose command was used last.
    #[must_use]
    pub fn slots_in_use(&self) -> (usize, usize) {
        self.used
    }

    /// State of a slot of a role.
    #[must_use]
    pub fn slot(&self, role: usize, slot: usize) -> &SlotState {
        self.roles[role].slot(slot)
    }

    /// Deviation of a slot from the one in charge, m/s or m; negative: nothing to compare.
    #[must_use]
    pub fn deviation(&self, role: usize, slot: usize) -> f64 {
        self.apart[SLOTS * role + slot]
    }

    /// Newest verdict on each slot.
    #[must_use]
    pub fn verdict(&self) -> [u8; SLOTS] {
        self.verdict
    }

    /// Writes the arbiter's fields of `motor/authority`.
    pub fn describe(&self, authority: &mut MotorAuthority) {
        let (used, (controller, estimator)) = (self.used, self.in_charge());
        (authority.active_controller, authority.active_estimator) = (used.0 as u8, used.1 as u8);
        authority.in_charge = [controller as u8, estimator as u8];
        authority.verdict = self.verdict;
        authority.fade = [1.0; ROLES];
        if let Some(old) = self.fade.old() {
            if old.0 != used.0 {
                authority.fade[CONTROLLERS] = self.fade.done();
            }
            if old.1 != used.1 {
                authority.fade[ESTIMATORS] = self.fade.done();
            }
        }
    }

    /// Returns `motor/slots`; `authority` is the sample that [`Arbiter::describe`] has written to.
    #[must_use]
    pub fn slots(&self, authority: &MotorAuthority) -> MotorSlots {
        let mut slots = MotorSlots {
            header: authority.header,
            commit_cycle: std::array::from_fn(|role| self.roles[role].commit_cycle()),
            fade: authority.fade,
            in_charge: authority.in_charge,
            deviation: self.apart,
            qualify_cycles: self.qualify,
            ..MotorSlots::default()
        };
        for seat in 0..ROLE_SLOTS {
            let slot = self.roles[seat / SLOTS].slot(seat % SLOTS);
            slots.phase[seat] = slot.phase() as u8;
            slots.cause[seat] = slot.cause();
            slots.failures[seat] = slot.failures();
            slots.good_cycles[seat] = slot.good_answers();
        }
        slots
    }
}

/// Classifies an estimator's answer.
fn estimate(input: &MotorInput, slot: usize) -> Reply {
    let position = &input.estimate_position_m[3 * slot..][..3];
    match () {
        () if input.estimate_life[slot] != input.header.life => Reply::Silent,
        // Without an incarnation no estimate has arrived, even though its cycle 0 fits the first cycle.
        () if input.estimate_incarnation[slot] == 0 => Reply::Silent,
        () if input.estimate_cycle[slot].checked_add(1) != Some(input.header.cycle) => Reply::Silent,
        () if input.estimate_valid[slot] != 1 => Reply::Nothing,
        () if !position.iter().all(|x| x.is_finite()) => Reply::Wrong(MotorSlots::CAUSE_NOT_FINITE),
        () => Reply::Good,
    }
}

fn distance(one: &[f64; CABLES], other: &[f64; CABLES]) -> f64 {
    one.iter().zip(other).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
}

/// A deviation as a share of what is allowed.
fn share(apart: f64, bound: f64) -> Option<f64> {
    (apart >= 0.0).then_some(apart / bound)
}

#[cfg(test)]
mod tests;
