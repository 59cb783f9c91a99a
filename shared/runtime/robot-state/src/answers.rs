//! The catalogue of answers: every reason for which a process accepts or refuses a request, with its number, its
//! parameters and its English sentence.
//!
//! A process answers with a [`Reason`]. The sample on `operator/request` carries its number, its parameters and the
//! sentence, so that a program acts on the number and an analyst reads the sentence in the run. Numbers are never
//! reused. Reasons of motor-io are typed throughout. Where a refusal is made from an error of a library (a plan that
//! breaks a limit, a process that does not start), the number names the class and the text parameter `why` holds the
//! error's own sentence.

use std::fmt::{self, Display, Formatter};

use arrayvec::ArrayString;
use messages::faults::Faults;
use messages::{DETAIL_BYTES, MORE, OperatorRequest, RequestAnswer, Slot, SlotRole, parted, put_sentence, text_of};

use crate::sentences::{FaultList, ROLE_NAMES, StandbyRefusal};

/// Text parameter of a reason.
pub type Detail = ArrayString<DETAIL_BYTES>;

/// Text of a reason or of its parameter, in a fixed place: nothing is allocated. A text that does not fit loses what
/// stands before its cure: see [`parted`].
#[must_use]
pub fn detail(text: impl Display) -> Detail {
    use fmt::Write;
    struct Cut<'a>(&'a mut ArrayString<{ 4 * DETAIL_BYTES }>);
    impl Write for Cut<'_> {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            let mut end = text.len().min(self.0.remaining_capacity());
            while !text.is_char_boundary(end) {
                end -= 1;
            }
            self.0.push_str(&text[..end]);
            Ok(())
        }
    }
    let mut draft = ArrayString::new();
    // Cut never fails.
    let _ = write!(Cut(&mut draft), "{text}");
    let mut detail = Detail::new();
    let (end, from) =
        if draft.len() > DETAIL_BYTES { parted(&draft, DETAIL_BYTES) } else { (draft.len(), draft.len()) };
    let parts = [&draft[..end], if from > end { MORE } else { "" }, &draft[from..]];
    // They fit: `parted` leaves room for all three.
    parts.iter().for_each(|part| detail.push_str(part));
    detail
}

/// A parameter of a reason, as it stands in the sample.
trait Parameter: Sized {
    fn put(&self, into: &mut Writer<'_>);
    fn take(from: &mut Reader<'_>) -> Option<Self>;
    #[cfg(test)]
    fn example() -> Self;
}

/// Writes parameters in their order.
struct Writer<'a> {
    answer: &'a mut RequestAnswer,
    numbers: usize,
    values: usize,
}

impl Writer<'_> {
    fn number(&mut self, number: u64) {
        if let Some(place) = self.answer.number.get_mut(self.numbers) {
            *place = number;
        }
        self.numbers += 1;
    }

    fn value(&mut self, value: f64) {
        if let Some(place) = self.answer.value.get_mut(self.values) {
            *place = value;
        }
        self.values += 1;
    }
}

/// Reads parameters in their order.
struct Reader<'a> {
    answer: &'a RequestAnswer,
    numbers: usize,
    values: usize,
}

impl Reader<'_> {
    fn number(&mut self) -> Option<u64> {
        self.numbers += 1;
        self.answer.number.get(self.numbers - 1).copied()
    }

    fn value(&mut self) -> Option<f64> {
        self.values += 1;
        self.answer.value.get(self.values - 1).copied()
    }
}

macro_rules! number {
    ($($type:ty),*) => { $(impl Parameter for $type {
        fn put(&self, into: &mut Writer<'_>) {
            into.number(*self as u64);
        }
        fn take(from: &mut Reader<'_>) -> Option<Self> {
            Self::try_from(from.number()?).ok()
        }
        #[cfg(test)]
        fn example() -> Self {
            3
        }
    })* };
}
number!(u8, u32, u64, usize);

impl Parameter for bool {
    fn put(&self, into: &mut Writer<'_>) {
        into.number(u64::from(*self));
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        from.number().map(|number| number == 1)
    }
    #[cfg(test)]
    fn example() -> Self {
        true
    }
}

impl Parameter for f64 {
    fn put(&self, into: &mut Writer<'_>) {
        into.value(*self);
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        from.value()
    }
    #[cfg(test)]
    fn example() -> Self {
        0.25
    }
}

impl Parameter for [f64; 3] {
    fn put(&self, into: &mut Writer<'_>) {
        self.iter().for_each(|value| into.value(*value));
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        Some([from.value()?, from.value()?, from.value()?])
    }
    #[cfg(test)]
    fn example() -> Self {
        [1.0, -2.5, 0.75]
    }
}

/// A number that says whether it is there, and then the parameter.
impl<T: Parameter> Parameter for Option<T> {
    fn put(&self, into: &mut Writer<'_>) {
        self.is_some().put(into);
        self.iter().for_each(|value| value.put(into));
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        if bool::take(from)? { T::take(from).map(Some) } else { Some(None) }
    }
    #[cfg(test)]
    fn example() -> Self {
        Some(T::example())
    }
}

impl<A: Parameter, B: Parameter> Parameter for (A, B) {
    fn put(&self, into: &mut Writer<'_>) {
        self.0.put(into);
        self.1.put(into);
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        Some((A::take(from)?, B::take(from)?))
    }
    #[cfg(test)]
    fn example() -> Self {
        (A::example(), B::example())
    }
}

/// Parameters that are recorded as their index in `ALL`; each with its example for tests.
macro_rules! by_index {
    ($($kind:ident: $example:ident),+) => {$(
        impl Parameter for $kind {
            fn put(&self, into: &mut Writer<'_>) {
                self.index().put(into);
            }
            fn take(from: &mut Reader<'_>) -> Option<Self> {
                Self::ALL.get(usize::take(from)?).copied()
            }
            #[cfg(test)]
            fn example() -> Self {
                Self::$example
            }
        }
    )+};
}

by_index!(SlotRole: Estimator, Slot: B);

/// The bits, and the cables and units as masks.
impl Parameter for Faults {
    fn put(&self, into: &mut Writer<'_>) {
        let mask = |named: &[bool]| named.iter().rev().fold(0_u64, |mask, named| mask << 1 | u64::from(*named));
        self.bits.put(into);
        into.number(mask(&self.cables));
        into.number(mask(&self.units));
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        let bits = u32::take(from)?;
        let (cables, units) = (from.number()?, from.number()?);
        let named = |mask: u64| std::array::from_fn(|i| mask >> i & 1 == 1);
        Some(Self { bits, cables: named(cables), units: named(units), ..Self::default() })
    }
    #[cfg(test)]
    fn example() -> Self {
        let mut faults = Self::default();
        faults.cable(messages::MotorAuthority::FAULT_SLACK, 2);
        faults.unit(messages::MotorAuthority::FAULT_SUPPLY, 1);
        faults
    }
}

impl Parameter for StandbyRefusal {
    fn put(&self, into: &mut Writer<'_>) {
        self.role.put(into);
        self.phase.put(into);
        self.cause.put(into);
        self.verdict.put(into);
        self.well_s.put(into);
        self.qualify_s.put(into);
        self.moves_off.put(into);
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            role: usize::take(from)?,
            phase: u8::take(from)?,
            cause: u8::take(from)?,
            verdict: u8::take(from)?,
            well_s: f64::take(from)?,
            qualify_s: f64::take(from)?,
            moves_off: Parameter::take(from)?,
        })
    }
    #[cfg(test)]
    fn example() -> Self {
        let phase = messages::MotorSlots::PHASE_SHADOW;
        Self { role: 1, phase, cause: 4, verdict: 2, well_s: 0.0, qualify_s: 1.0, moves_off: Some((0.5, 2.0)) }
    }
}

impl Parameter for Detail {
    fn put(&self, into: &mut Writer<'_>) {
        put_sentence(&mut into.answer.detail, self);
    }
    fn take(from: &mut Reader<'_>) -> Option<Self> {
        Some(detail(text_of(&from.answer.detail)))
    }
    #[cfg(test)]
    fn example() -> Self {
        detail("this is why; do that")
    }
}

/// A number as it was given; huge and tiny ones in powers of ten, so that they leave room for the rest of the sentence.
struct Given(f64);

impl Display for Given {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if self.0.abs() < 1e6 && (self.0 == 0.0 || self.0.abs() > 1e-6) {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:e}", self.0)
        }
    }
}

/// Energy of a plan, as the rest of a sentence; empty where the model of the motors does not cover it.
struct Energy(Option<f64>);

impl Display for Energy {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |joules| write!(f, ", about {joules:.0} J"))
    }
}

/// What a plan may add at adaptive legs: time, s, and energy, J, beside the energy of the plan itself.
struct Later(Option<(f64, Option<f64>)>, Option<f64>);

impl Display for Later {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Some((time_s, later_j)) = self.0 else { return Ok(()) };
        write!(f, ", then where the map is worth it: at most {time_s:.0} s more")?;
        match later_j.zip(self.1) {
            Some((later_j, now_j)) => write!(f, " and about {later_j:.0} J, {:.0} J in all", now_j + later_j),
            None => Ok(()),
        }
    }
}

fn role_name(role: SlotRole) -> &'static str {
    ROLE_NAMES[role.index()]
}

macro_rules! answers {
    ($($code:literal $name:ident $({ $($field:ident : $type:ty),* })? $accepted:ident, $text:literal $(, $argument:expr)*;)*) => {
        /// Why a request is accepted or refused, with the parameters of the sentence.
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[allow(missing_docs)] // the sentence and the unit suffix say it
        #[allow(clippy::large_enum_variant)] // a text in a fixed place: motor-io answers without allocation
        pub enum Reason { $( #[doc = $text] $name $({ $($field: $type),* })? ),* }

        /// Number, verdict ([`OperatorRequest`]'s `accepted`) and sentence of every reason.
        pub const CATALOGUE: &[(u16, u8, &str)] = &[$(($code, OperatorRequest::$accepted, $text)),*];

        impl Reason {
            /// The number, as it stands in `operator/request`.
            #[must_use]
            pub fn code(&self) -> u16 {
                match self { $( Self::$name { .. } => $code ),* }
            }

            /// [`OperatorRequest::ACCEPTED`], [`OperatorRequest::REFUSED`] (it cannot be done now) or
            /// [`OperatorRequest::BAD_INPUT`] (what was given makes no sense here, whenever it is requested).
            #[must_use]
            pub fn accepted(&self) -> u8 {
                match self { $( Self::$name { .. } => OperatorRequest::$accepted ),* }
            }

            #[allow(unused_variables)] // reasons without parameters
            fn put(&self, into: &mut Writer<'_>) {
                match self { $( Self::$name $({ $($field),* })? => { $( $( Parameter::put($field, into); )* )? } ),* }
            }

            #[allow(unused_variables)] // reasons without parameters
            fn take(code: u16, from: &mut Reader<'_>) -> Option<Self> {
                Some(match code {
                    $( $code => Self::$name $({ $($field: Parameter::take(from)?),* })?, )*
                    _ => return None,
                })
            }

            #[cfg(test)]
            fn examples() -> Vec<Self> {
                vec![$( Self::$name $({ $($field: Parameter::example()),* })? ),*]
            }
        }

        impl Display for Reason {
            #[allow(unused_variables)] // parameters that only some sentences show
            fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
                match self { $( Self::$name $({ $($field),* })? => write!(f, $text $(, $argument)*) ),* }
            }
        }
    };
}

answers! {
    // any process
    1 Undecodable { why: Detail } BAD_INPUT, "Not done: {why}.";
    2 TooLate { age_s: f64 } REFUSED, "Not done: the request arrived {age_s:.0} s after it was made, and the robot may be elsewhere by now; request it again.";
    3 OfPlanner BAD_INPUT, "Motions are planned by the planner; send this request to it.";
    4 OfMotorBox BAD_INPUT, "Faults are made by the virtual motor box; send this request to it.";
    5 OfSupervisor BAD_INPUT, "Processes are managed by the supervisor; send this request to it.";
    6 OtherProcess { takes: Detail } BAD_INPUT, "this process takes {takes} only; send this request to another process";

    // motor-io
    10 Armed ACCEPTED, "Armed: the drives hold the cables.";
    11 ArmedRestored ACCEPTED, "Armed: the drives hold the cables; the position was kept from before motor-io was started, so look where the node is and confirm it or zero before a motion.";
    12 ArmedUnknown ACCEPTED, "Armed: the drives hold the cables; the position is unknown, so zero before a motion.";
    13 AlreadyArmed ACCEPTED, "Already armed.";
    14 NotArmedStopped REFUSED, "Not armed: the robot is stopped by a fault; reset it first.";
    15 NotArmedFaults { faults: Faults } REFUSED, "Not armed: {}.", FaultList(faults);
    16 NotArmedEncoders REFUSED, "Not armed: not every encoder has been read yet; try again in a second.";
    17 NotArmedDrive { why: Detail } REFUSED, "Not armed: {why}.";

    20 Disarmed ACCEPTED, "Disarmed: the drives have released the cables, and the node may sink.";
    21 DisarmedFaulted ACCEPTED, "The drives have released the cables, and the node may sink; the fault stays until it is reset.";
    22 AlreadyDisarmed ACCEPTED, "Already disarmed.";
    23 NotDisarmedMoving REFUSED, "Not disarmed: the robot moves; stop first.";
    24 NotDisarmedYet REFUSED, "Not disarmed: the robot is still coming to rest; try again in a second.";

    30 Pausing ACCEPTED, "Pausing: the robot comes to rest on its path and holds; resume continues, stop gives the motion up.";
    31 JogEnds ACCEPTED, "The cable comes to rest and holds.";
    32 AlreadyHolding ACCEPTED, "Already holding.";
    33 AlreadyStopping ACCEPTED, "Already coming to rest.";
    34 NotHeld REFUSED, "The drives are off, so nothing can be held; arm first.";
    35 StoppedByFault ACCEPTED, "Already stopped by a fault; reset it to go on.";

    40 Resumed ACCEPTED, "Going on.";
    41 MotionRuns ACCEPTED, "The motion is running.";
    42 ResumedMotion ACCEPTED, "Going on where the motion was left.";
    43 NotResumedFaults { faults: Faults } REFUSED, "Not resumed: {}.", FaultList(faults);
    44 NotResumedPosition REFUSED, "Not resumed: the position needs confirmation; confirm it or zero, then start a new motion.";
    45 NotResumedMotion REFUSED, "Not resumed: the planner no longer has this motion; stop, then start a new one.";
    46 NotResumedController REFUSED, "Not resumed: no controller answers for this motion; look at nims status which process is missing.";
    47 NotResumedAway { off_m: f64, most_m: f64 } REFUSED, "Not resumed: the node is {off_m:.2} m from where the motion was left (accepted: {most_m} m); stop, then start a new motion.";
    48 NothingPaused REFUSED, "There is no paused motion to resume.";
    49 NotResumedStopping REFUSED, "The robot is coming to rest; resume when it holds.";
    50 NotResumedJogging REFUSED, "A cable is being jogged; there is no paused motion.";
    51 NotResumedDisarmed REFUSED, "The drives are off and no motion is kept; arm and start a new one.";
    52 NotResumedFault REFUSED, "A fault has ended the motion; reset it, then start a new one.";

    60 Stopping ACCEPTED, "Stopping on the path; the motion is given up.";
    61 StoppingDropped ACCEPTED, "Already coming to rest; the motion is given up.";
    62 RestDropped ACCEPTED, "At rest; the paused motion is given up.";
    63 AlreadyAtRest ACCEPTED, "Already at rest.";
    64 NothingMoves ACCEPTED, "Nothing moves: the drives are off.";

    70 EmergencyStop ACCEPTED, "Emergency stop: every cable is held where it is; reset goes back to holding.";
    71 EmergencyStopOff ACCEPTED, "Emergency stop: the drives are off and stay off until reset.";

    80 Reset ACCEPTED, "Reset: the robot holds.";
    81 ResetUncertain ACCEPTED, "Reset: the robot holds; its position is not certain, so confirm it or zero before a motion.";
    82 ResetDisarmed ACCEPTED, "Reset: the robot is disarmed.";
    83 NotResetMoving REFUSED, "Nothing is reset while the robot moves; stop first.";
    84 NotResetYet REFUSED, "Not reset: the robot is still coming to rest; try again in a second.";
    85 NotResetFaults { faults: Faults } REFUSED, "Not reset: {}.", FaultList(faults);
    86 NotResetDrive { why: Detail } REFUSED, "Not reset: {why}.";

    90 ZeroedAt { position_m: [f64; 3] } ACCEPTED, "The node is at [{}, {}, {}] now.", position_m[0], position_m[1], position_m[2];
    91 ZeroedLengths { cables: usize } ACCEPTED, "The lengths of the {cables} cables are set.";
    92 NotZeroedMoving REFUSED, "Not zeroed: the robot moves; stop first.";
    93 NotZeroedFault REFUSED, "Not zeroed: the robot is stopped by a fault; reset it first.";
    94 NotZeroedEncoders REFUSED, "Not zeroed: not every encoder has been read yet; try again in a second.";
    95 NotAPosition { position_m: [f64; 3] } BAD_INPUT, "Not zeroed: [{}, {}, {}] is no position; give x, y and z in metres.", Given(position_m[0]), Given(position_m[1]), Given(position_m[2]);
    96 OutOfPlane { y_m: f64 } BAD_INPUT, "Not zeroed: y is {}, and this robot moves in the plane y = 0; give x and z.", Given(*y_m);
    97 CannotHang { position_m: [f64; 3], why: Detail } BAD_INPUT, "Not zeroed: the node cannot hang freely at [{}, {}, {}]: {why}.", position_m[0], position_m[1], position_m[2];
    98 LengthLimit { cable: usize, length_m: f64, low_m: f64, high_m: f64 } BAD_INPUT, "Not zeroed: cable {cable} would be {} m long; accepted: {low_m} to {high_m} m.", Given(*length_m);
    99 LengthCount { given: usize, cables: usize } BAD_INPUT, "Not zeroed: {given} lengths are given, and this robot has {cables} cables; give one length per cable.";

    100 Confirmed ACCEPTED, "The restored position is confirmed.";
    101 PositionKnown ACCEPTED, "The position is known; there is nothing to confirm.";
    102 NoPosition REFUSED, "There is no position to confirm; zero the robot where it is.";
    103 NotConfirmedMoving REFUSED, "Not confirmed: the robot moves; stop first.";

    110 Jogging { cable: usize, distance_m: f64 } ACCEPTED, "Cable {cable} {} {:.3} m.", if *distance_m > 0.0 { "pays out" } else { "reels in" }, distance_m.abs();
    111 NoCable { cable: usize, cables: usize } BAD_INPUT, "Not jogged: there is no cable {cable}; accepted: 1 to {cables}.";
    112 NoDistance { distance_m: f64, most_m: f64 } BAD_INPUT, "Not jogged: {} m is no distance for a jog; accepted: up to {most_m} m, positive pays cable out, negative reels in.", Given(*distance_m);
    113 AlreadyJogging REFUSED, "Not jogged: a cable is being jogged; wait until it holds.";
    114 NotJoggedMoving REFUSED, "Not jogged: the robot moves; stop first.";
    115 NotJoggedDisarmed REFUSED, "Not jogged: the drives are off; arm first.";
    116 NotJoggedFault REFUSED, "Not jogged: the robot is stopped by a fault; reset it first.";
    117 NotJoggedFaults { faults: Faults } REFUSED, "Not jogged: {}.", FaultList(faults);
    118 NotJoggedPaused REFUSED, "Not jogged: a motion is paused; stop to give it up first.";
    119 NotJoggedLimit { cable: usize, now_m: f64, then_m: f64, low_m: f64, high_m: f64 } REFUSED, "Not jogged: cable {cable} is {now_m:.3} m long and would be {then_m:.3} m; accepted: {low_m} to {high_m} m.";

    130 SpeedSet { rate: f64 } ACCEPTED, "Motions run at {:.0} % of their planned speed.", rate * 100.0;
    131 NoSpeed { rate: f64, slowest: f64 } BAD_INPUT, "{} is no speed; accepted: a fraction from {slowest} to 1.", Given(*rate);

    140 Swapping { role: SlotRole, slot: Slot, cycle: u64 } ACCEPTED, "The {} in slot {} takes over in cycle {cycle}.", role_name(*role), slot.name();
    141 InCharge { role: SlotRole, slot: Slot } ACCEPTED, "The {} in slot {} is in charge already.", role_name(*role), slot.name();
    142 SwapUnderWay REFUSED, "Not swapped: another swap is under way; try again in a second.";
    143 SwapMovesOff { role: SlotRole, slot: Slot, off_m: f64, within_s: f64, most_m: f64 } REFUSED, "Not swapped: the {} in slot {} would move the node {off_m:.2} m off its path within {within_s:.1} s (accepted: {most_m} m); look at its configuration, or swap where the robot holds.", role_name(*role), slot.name();
    144 NotSwapped { slot: Slot, why: StandbyRefusal } REFUSED, "Not swapped: the {} in slot {} {why}.", ROLE_NAMES.get(why.role).unwrap_or(&"process"), slot.name();
    145 Admitted { role: SlotRole, slot: Slot } ACCEPTED, "The {} in slot {} is admitted again; it qualifies from the beginning.", role_name(*role), slot.name();
    146 NotQuarantined { role: SlotRole, slot: Slot } ACCEPTED, "The {} in slot {} was not quarantined.", role_name(*role), slot.name();

    // planner
    200 Planned { continues: bool, segments: usize, length_m: f64, duration_s: f64, energy_j: Option<f64>, later: Option<(f64, Option<f64>)>, mission: Detail } ACCEPTED, "mission \"{mission}\" {}: {segments} segments, {length_m:.2} m, {duration_s:.1} s{}{}", if *continues { "goes on" } else { "accepted" }, Energy(*energy_j), Later(*later, *energy_j);
    201 MotorIoAbsent REFUSED, "motor-io does not answer; start the robot with nims up";
    202 MissionPaused { mission: Detail } REFUSED, "mission \"{mission}\" is paused; resume it with nims resume, or give it up with nims stop";
    203 MissionRuns { mission: Detail } REFUSED, "mission \"{mission}\" is being flown; wait for its end, or give it up with nims stop";
    204 ForeignMotion REFUSED, "a motion of a planner that has ended is still kept; give it up with nims stop";
    205 RobotDisarmed REFUSED, "the robot is disarmed; arm it with nims arm";
    206 RobotJogging REFUSED, "a cable is being jogged; wait until it has stopped";
    207 RobotFaulted REFUSED, "the robot has a fault; nims status names it, nims reset clears it once its cause is gone";
    208 RobotEmergencyStop REFUSED, "the emergency stop is on; release it and nims reset";
    209 RobotMoves REFUSED, "the robot is moving; wait until it holds, or stop it with nims stop";
    210 PositionRestored REFUSED, "the position was kept from before motor-io was started; look whether the node is where nims status says, then nims confirm-position, or nims zero --at x,y,z";
    211 PositionUnknown REFUSED, "the position is not known; set it with nims zero --at x,y,z";
    212 NoEstimate REFUSED, "the position estimate is missing or stale; see nims status for the estimator and the drives";
    213 MissionNotBegun { mission: Detail } REFUSED, "mission \"{mission}\" was not begun; run it without --continue";
    214 MissionChanged { mission: Detail } REFUSED, "mission \"{mission}\" was changed since it was begun; run it from its beginning, without --continue";
    215 MissionDone { mission: Detail } REFUSED, "mission \"{mission}\" is done; nothing is left of it, run it without --continue";
    216 RequesterTimedOut REFUSED, "not started: the request timed out while the motion was being planned; request it again, or fly a shorter mission";
    220 CopyUnusable { why: Detail } BAD_INPUT, "{why}";
    221 MissionInvalid { why: Detail } BAD_INPUT, "{why}";
    230 PlanLimit { why: Detail } BAD_INPUT, "{why}";
    231 PlanTooFast { why: Detail } BAD_INPUT, "{why}";
    232 PlanTooHard { why: Detail } BAD_INPUT, "{why}";
    233 PlanPath { why: Detail } BAD_INPUT, "{why}";
    234 PlanProfile { why: Detail } BAD_INPUT, "{why}";
    235 PlanPoint { why: Detail } BAD_INPUT, "{why}";
    236 PlanEnergy { why: Detail } BAD_INPUT, "{why}";
    237 PlanPattern { why: Detail } BAD_INPUT, "{why}";
    238 PlanTooLong { why: Detail } BAD_INPUT, "{why}";
    239 PlanOther { why: Detail } REFUSED, "{why}";
    240 AlreadyThere { why: Detail } REFUSED, "{why}";
    241 NoStart { why: Detail } REFUSED, "{why}";

    // supervisor
    300 ProcessStarts { process: Detail } ACCEPTED, "starting {process}";
    301 ProcessEnds { process: Detail } ACCEPTED, "ending {process}";
    302 ProcessRestarts { process: Detail } ACCEPTED, "ending {process}, to start it again";
    303 ProcessUnplugs { process: Detail } ACCEPTED, "ending {process}, to unplug it";
    304 ProcessReplaces { process: Detail } ACCEPTED, "ending {process}, to start the new one in its place";
    305 ProcessSucceeds { process: Detail } ACCEPTED, "starting the new {process} beside the running one, until it has published its first sample";
    306 ProcessStays { process: Detail } ACCEPTED, "{process} is not started again";
    307 ProcessUnplugged { process: Detail } ACCEPTED, "{process} is unplugged";
    308 ParameterSet { what: Detail } ACCEPTED, "{what}";
    320 SupervisorRefuses { why: Detail } REFUSED, "{why}";
    321 SupervisorBadInput { why: Detail } BAD_INPUT, "{why}";

    // faults on request
    400 FaultDone { fault: Detail } ACCEPTED, "done: {fault}";
    401 FaultRefused { why: Detail } REFUSED, "{why}";
    402 FaultInvalid { why: Detail } BAD_INPUT, "{why}";
}

impl Reason {
    /// True where the request is carried out.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        self.accepted() == OperatorRequest::ACCEPTED
    }

    /// The sentence, in a fixed place.
    #[must_use]
    pub fn sentence(&self) -> Detail {
        detail(self)
    }

    /// The answer as it is sent and recorded.
    #[must_use]
    pub fn answer(&self) -> RequestAnswer {
        let mut answer = RequestAnswer { accepted: self.accepted(), reason: self.code(), ..RequestAnswer::default() };
        self.put(&mut Writer { answer: &mut answer, numbers: 0, values: 0 });
        put_sentence(&mut answer.text, &self.sentence());
        answer
    }

    /// The reason of a recorded answer; `None` for a number that this program does not know, or an unanswered request.
    /// A text parameter longer than its field comes back shortened.
    #[must_use]
    pub fn of(request: &OperatorRequest) -> Option<Self> {
        let answer = request.recorded_answer()?;
        Self::take(answer.reason, &mut Reader { answer: &answer, numbers: 0, values: 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sentences::FAULTS;
    use std::collections::BTreeSet;

    #[test]
    fn every_reason_travels_with_its_parameters() {
        for reason in Reason::examples() {
            let (mut request, answer) = (OperatorRequest::default(), reason.answer());
            request.put_answer(&answer);
            assert_eq!(Reason::of(&request), Some(reason));
            assert_eq!(text_of(&request.answer), reason.to_string());
            assert_eq!((request.accepted, request.reason), (reason.accepted(), reason.code()));
            let mut writer = Writer { answer: &mut answer.clone(), numbers: 0, values: 0 };
            reason.put(&mut writer);
            assert!(writer.numbers <= 6 && writer.values <= 6, "{reason:?} has too many parameters");
        }
        assert_eq!(Reason::of(&OperatorRequest::default()), None);
    }

    #[test]
    fn numbers_are_unique_and_every_reason_has_a_row() {
        let codes: BTreeSet<u16> = CATALOGUE.iter().map(|(code, ..)| *code).collect();
        assert_eq!((codes.len(), CATALOGUE.len()), (Reason::examples().len(), Reason::examples().len()));
        assert!(!codes.contains(&0));
    }

    #[test]
    fn an_answer_holds_the_cures_of_whatever_has_failed() {
        let all = FAULTS.iter().fold(0, |all, (bit, _, _)| all | bit);
        let faults = Faults { bits: all, cables: [true; 8], units: [true; 8], ..Faults::default() };
        let answer = Reason::NotArmedFaults { faults }.sentence();
        assert!(!answer.contains(MORE) && answer.ends_with("names with their cures."), "{answer}");
        for (bit, what, cure) in FAULTS {
            let faults = Faults { bits: bit, cables: [true; 8], units: [true; 8], ..Faults::default() };
            let answer = Reason::NotArmedFaults { faults }.sentence();
            assert!(answer.contains(what) && answer.contains(cure) && !answer.contains(MORE), "{answer}");
        }
    }

    #[test]
    fn a_long_sentence_ends_at_a_word_or_at_least_a_character() {
        let words = detail(format!("{} end.", "word ".repeat(200)));
        assert!(words.ends_with("word ...") && words.len() > DETAIL_BYTES - 10, "{words}");
        assert!(detail("ü".repeat(400)).ends_with("ü ..."));
        let whole = "x".repeat(DETAIL_BYTES);
        assert_eq!(detail(&whole).as_str(), whole);
    }
}
