//! The catalogue of answers: every reason for which a process accepts or refuses a request, with its number, its
//! parameters and its English sentence.
//!
//! A process answers with a [`Reason`]. The sample on `operator/request` carries its number, its parameters and the
//! sentence, so that a program acts on the number and an analyst reads the sentence in the run. `plan/status` carries
//! the reason for which a mission was refused or ended in the same way. Numbers are never reused, and a reason whose
//! parameters change gets a new number. Where a refusal is made from an error of a library (a mission file that cannot
//! be parsed, a program that does not start), the text parameter `why` holds the error's own sentence, the only source
//! of its words; the reason names what was requested beside it.

use std::fmt::{self, Display, Formatter};

use messages::faults::Faults;
use messages::{MotorAuthority, OperatorRequest, PlanStatus, RequestAnswer, Slot, SlotRole, put_sentence};

use crate::parameter::{Parameter, Reader, Writer};
use crate::sentences::{FaultList, ROLE_NAMES, StandbyRefusal};
use crate::stop::Stop;

pub use crate::parameter::{Detail, detail};

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

/// The speed at which a rejected segment can be flown, as a clause.
struct SpeedAdvice(Option<f64>);

impl Display for SpeedAdvice {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |speed_m_s| write!(f, "; this segment can be flown at {speed_m_s:.3} m/s"))
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

/// A value of a key; an empty one was not given.
struct OrNone<'a>(&'a str);

impl Display for OrNone<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_empty() { "not given" } else { self.0 })
    }
}

/// The other cure where a process has slots.
struct OrSwap(Option<SlotRole>);

impl Display for OrSwap {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |role| write!(f, ", or swap it for another with `nims swap {}`", role_name(role)))
    }
}

/// The node, 0, or a cable by its number from 1.
struct NodeOrCable(usize);

impl Display for NodeOrCable {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => f.write_str("the node"),
            cable => write!(f, "cable {cable}"),
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
            fn encode(&self, into: &mut Writer<'_>) {
                match self { $( Self::$name $({ $($field),* })? => { $( $( Parameter::encode($field, into); )* )? } ),* }
            }

            #[allow(unused_variables)] // reasons without parameters
            fn decode(code: u16, from: &mut Reader<'_>) -> Option<Self> {
                Some(match code {
                    $( $code => Self::$name $({ $($field: Parameter::decode(from)?),* })?, )*
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
    3 ForPlanner BAD_INPUT, "Motions are planned by the planner; send this request to it.";
    4 ForMotorBox BAD_INPUT, "Faults are made by the virtual motor box; send this request to it.";
    5 ForSupervisor BAD_INPUT, "Processes are managed by the supervisor; send this request to it.";
    6 OtherProcess { takes: Detail } BAD_INPUT, "this process takes {takes} only; send this request to another process";

    // motor-io
    10 Armed ACCEPTED, "Armed: the drives hold the cables.";
    11 ArmedRestored ACCEPTED, "Armed: the drives hold the cables; the position needs a confirmation, because motor-io was started or a fault made it doubtful: look where the node is, and confirm it or zero before a motion.";
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
    120 NotJoggedBorder { cable: usize, part: usize, obstacle: usize } REFUSED, "Not jogged: cable {cable} would bring {} closer to obstacle {obstacle}, whose border it has reached; jog the other way or another cable, or zero the node if it is elsewhere.", NodeOrCable(*part);
    121 NotJoggedBox { cable: usize, number: usize } REFUSED, "Not jogged: cable {cable} would bring the node closer to keep-out box {number}, whose border it has reached; jog the other way or another cable, or zero the node if it is elsewhere.";

    160 Soft ACCEPTED, "Soft: the cables carry the node and yield to a hand; `nims hold` ends it.";
    161 AlreadySoft ACCEPTED, "Already soft; `nims hold` ends it.";
    162 SoftEnds ACCEPTED, "The cables hold.";
    163 NotSoftMoving REFUSED, "Not soft: the robot moves; stop first.";
    164 NotSoftDisarmed REFUSED, "Not soft: the drives are off; arm first.";
    165 NotSoftFault REFUSED, "Not soft: the robot is stopped by a fault; reset it first.";
    166 NotSoftFaults { faults: Faults } REFUSED, "Not soft: {}.", FaultList(faults);
    167 NotSoftPaused REFUSED, "Not soft: a motion is paused; stop to give it up first.";
    168 NotSoftPosition REFUSED, "Not soft: the position is not known; zero the robot, or confirm its position, first.";
    169 NotSoftYet REFUSED, "Not soft: the drives have not held the node for some seconds, a cable still moves, or a drive did not answer; try again in a few seconds.";
    170 NotSoftDrives { port: usize } REFUSED, "Not soft: the drives on port {port} take no torque, or the system file does not state torque_constant_n_m_a of the port; docs/drives.md says which do.";
    171 NotSoftGear { cable: usize, pull_n: f64, most_n: f64 } REFUSED, "Not soft: by gear_friction and coulomb_n of the robot file cable {cable} yields to {pull_n:.0} N only, and its limit is {most_n} N; a gear that holds its cable cannot be led by hand.";
    172 NotSoftTensions { why: Detail } REFUSED, "Not soft: the node cannot hang freely here: {why}.";
    173 NotSoftBorder REFUSED, "Not soft: the node or a cable is at a border; jog or move it away first.";

    130 SpeedSet { rate: f64 } ACCEPTED, "Motions run at {:.0} % of their planned speed.", rate * 100.0;
    131 NoSpeed { rate: f64, slowest: f64 } BAD_INPUT, "{} is no speed; accepted: a fraction from {slowest} to 1.", Given(*rate);

    140 Swapping { role: SlotRole, slot: Slot, cycle: u64 } ACCEPTED, "The {} in slot {} takes over in cycle {cycle}.", role_name(*role), slot.name();
    141 InCharge { role: SlotRole, slot: Slot } ACCEPTED, "The {} in slot {} is in charge already.", role_name(*role), slot.name();
    142 SwapUnderWay REFUSED, "Not swapped: another swap is under way; try again in a second.";
    143 SwapMovesOff { role: SlotRole, slot: Slot, off_m: f64, within_s: f64, most_m: f64 } REFUSED, "Not swapped: the {} in slot {} would move the node {off_m:.2} m off its path within {within_s:.1} s (accepted: {most_m} m); look at its configuration, or swap where the robot holds.", role_name(*role), slot.name();
    144 NotSwapped { slot: Slot, why: StandbyRefusal } REFUSED, "Not swapped: the {} in slot {} {why}.", ROLE_NAMES.get(why.role).unwrap_or(&"process"), slot.name();
    145 Admitted { role: SlotRole, slot: Slot } ACCEPTED, "The {} in slot {} is admitted again; it qualifies from the beginning.", role_name(*role), slot.name();
    146 NotQuarantined { role: SlotRole, slot: Slot } ACCEPTED, "The {} in slot {} was not quarantined.", role_name(*role), slot.name();

    // planner; 220 held the sentence alone
    200 Planned { continues: bool, segments: usize, length_m: f64, duration_s: f64, energy_j: Option<f64>, later: Option<(f64, Option<f64>)>, mission: Detail } ACCEPTED, "mission \"{mission}\" {}: {segments} {}, {length_m:.2} m, {duration_s:.1} s{}{}", if *continues { "continues" } else { "accepted" }, if *segments == 1 { "segment" } else { "segments" }, Energy(*energy_j), Later(*later, *energy_j);
    201 MotorIoAbsent REFUSED, "motor-io does not answer; start the robot with nims up";
    202 MissionPaused { mission: Detail } REFUSED, "mission \"{mission}\" is paused; resume it with nims resume, or give it up with nims stop";
    203 MissionRuns { mission: Detail } REFUSED, "mission \"{mission}\" is being flown; wait for its end, or give it up with nims stop";
    204 ForeignMotion REFUSED, "motor-io still has the motion of a planner that has ended; give it up with nims stop";
    205 RobotDisarmed REFUSED, "the robot is disarmed; arm it with nims arm";
    206 RobotJogging REFUSED, "a cable is being jogged; wait until it has stopped";
    207 RobotFaulted REFUSED, "the robot has a fault; nims status names it, nims reset clears it once its cause is gone";
    208 RobotEmergencyStop REFUSED, "the emergency stop is on; release it and nims reset";
    219 RobotSoft REFUSED, "the robot is soft and led by hand; hold it with nims hold";
    209 RobotMoves REFUSED, "the robot is moving; wait until it holds, or stop it with nims stop";
    210 PositionRestored REFUSED, "the position needs a confirmation, because motor-io was started or a fault made it doubtful; look whether the node is where nims status says, then nims confirm-position, or nims zero --at x,y,z";
    211 PositionUnknown REFUSED, "the position is not known; set it with nims zero --at x,y,z";
    212 NoEstimate REFUSED, "the position estimate is missing or stale; see nims status for the estimator and the drives";
    213 MissionNotBegun { mission: Detail } REFUSED, "mission \"{mission}\" was not begun; run it without --continue";
    214 MissionChanged { mission: Detail } REFUSED, "mission \"{mission}\" was changed since it was begun; run it from its beginning, without --continue";
    215 MissionDone { mission: Detail } REFUSED, "mission \"{mission}\" is done; nothing is left of it, run it without --continue";
    216 RequesterTimedOut REFUSED, "not started: the request timed out, or a stop withdrew it, while the motion was being planned; request it again, or fly a shorter mission";
    221 MissionInvalid { why: Detail } BAD_INPUT, "{why}";
    222 CopyUnreadable { copy: Detail, why: Detail } BAD_INPUT, "the copy {copy} of the mission cannot be read: {why}; request the mission again";
    223 CopyChanged { copy: Detail } BAD_INPUT, "{copy} is not the mission that was requested: its SHA-256 differs; request the mission again";
    224 MissionValue { leg: Option<usize>, key: Detail, why: Detail } BAD_INPUT, "{why}";
    // 230 to 241 held these classes without their parameters
    250 PlanLimit { leg: usize, segment: Detail, why: Detail, feasible_m_s: Option<f64> } BAD_INPUT, "leg {leg}{segment}: {why}{}", SpeedAdvice(*feasible_m_s);
    251 PlanTooFast { leg: usize, speed_m_s: f64, limit_m_s: f64 } BAD_INPUT, "leg {leg} asks for {speed_m_s} m/s, above the robot's speed_limit_m_s of {limit_m_s} m/s; ask for less";
    252 PlanTooHard { asked_m_s2: f64, limit_m_s2: f64 } BAD_INPUT, "the mission asks for {asked_m_s2} m/s², above the robot's acceleration_limit_m_s2 of {limit_m_s2} m/s²; ask for less";
    253 PlanPath { leg: usize, why: Detail } BAD_INPUT, "leg {leg}: {why}";
    254 PlanProfile { leg: usize, why: Detail } BAD_INPUT, "leg {leg}: {why}";
    255 PlanPoint { leg: usize, why: Detail } BAD_INPUT, "leg {leg}: {why}";
    256 PlanEnergy { leg: usize, why: Detail } BAD_INPUT, "leg {leg}: no path that saves energy can be flown: {why}";
    257 PlanPattern { leg: usize, why: Detail } BAD_INPUT, "leg {leg}: {why}";
    258 PlanTooLong { most: usize } BAD_INPUT, "the mission has more than {most} segments; split it into several missions";
    259 PlanOther REFUSED, "the rest of the mission is unknown: the robot or the planner was configured otherwise when it began; run it from the beginning";
    260 AlreadyThere REFUSED, "the node is already there";
    261 NoStart { position_m: [f64; 3] } REFUSED, "the position of the node is not known ({} {} {}); set it with nims zero --at x,y,z", position_m[0], position_m[1], position_m[2];

    // supervisor
    300 ProcessStarts { process: Detail } ACCEPTED, "starting {process}";
    301 ProcessEnds { process: Detail } ACCEPTED, "ending {process}";
    302 ProcessRestarts { process: Detail } ACCEPTED, "ending {process}, to start it again";
    303 ProcessUnplugs { process: Detail } ACCEPTED, "ending {process}, to unplug it";
    304 ProcessReplaces { process: Detail } ACCEPTED, "ending {process}, to start the new one in its place";
    305 ProcessSucceeds { process: Detail } ACCEPTED, "starting the new {process} beside the running one, until it has published its first sample";
    306 ProcessStays { process: Detail } ACCEPTED, "{process} is not started again";
    307 ProcessUnplugged { process: Detail } ACCEPTED, "{process} is unplugged";
    // 308, 320 and 321 held sentences alone
    309 ParameterUnchanged { key: Detail, value: Detail } ACCEPTED, "{key} is {value} already";
    310 ParameterChanged { cycle: u64, key: Detail, value: Detail, before: Detail } ACCEPTED, "{key} is {value} from cycle {cycle} on (before: {}), in every {}, until this run ends", OrNone(before), key.split('.').next().unwrap_or_default();
    311 Marked { mark: Detail } ACCEPTED, "marked: {mark}";
    324 UnknownProcess { process: Detail, known: Detail } BAD_INPUT, "there is no process \"{process}\" here; there are {known}";
    325 NameTaken { process: Detail } BAD_INPUT, "the name \"{process}\" is taken; choose another, or see `nims status`";
    326 NameRuns { process: Detail } BAD_INPUT, "the name \"{process}\" is taken; choose another, or unplug that process first, or put this one in its place with --replace";
    327 NameInvalid { process: Detail, most: usize } BAD_INPUT, "the name \"{process}\" cannot be used; accepted: 1 to {most} of a-z, 0-9 and `-`";
    328 CommandEmpty { process: Detail } BAD_INPUT, "the command of process \"{process}\" is empty; give a program and its arguments";
    329 ProgramIsFolder { process: Detail, program: Detail } BAD_INPUT, "process \"{process}\": {program} is a folder; name a program";
    330 NoProgram { process: Detail, program: Detail } BAD_INPUT, "process \"{process}\": there is no program {program}{}", if program.contains('/') { "" } else { ", neither in the folder of nims nor in PATH" };
    331 NotBuilt { program: Detail } REFUSED, "there is no program {program}: build all of them with `cargo build --workspace`";
    332 OwnPathUnknown { why: Detail } REFUSED, "the path of the supervisor's own program cannot be read: {why}; start nims with its full path";
    // 333 held the sentence alone
    334 LawUnknown { role: SlotRole, law: Detail, why: Detail } BAD_INPUT, "{why}";
    340 NotPluggable { process: Detail, role: Detail } BAD_INPUT, "{process} is the robot's {role}, which cannot be unplugged; `nims stop-process {process}` ends it";
    341 InOtherSlot { process: Detail, slot: Slot, given: Slot } BAD_INPUT, "{process} is in slot {}, not {}", slot.name(), given.name();
    342 HasOwnLaw { process: Detail } BAD_INPUT, "the process \"{process}\" of the system file has its own law; leave out the law of the request";
    343 NoSlotNoLaw { process: Detail } BAD_INPUT, "{process} has no slot and no law; only controllers and estimators have them";
    344 NoMotorBox BAD_INPUT, "this system has real drives and no virtual motor box";
    345 SlotsTaken { role: SlotRole } REFUSED, "both slots of the role {0} are taken: first stop the one that is not in charge, with `nims stop-process {0}` or `nims stop-process {0}-b`", role_name(*role);
    346 ProcessRunning { process: Detail, pid: u32 } REFUSED, "{process} runs already (process {pid}); `nims restart {process}` ends it first";
    347 ProcessNotRunning { process: Detail } REFUSED, "{process} does not run";
    348 ProcessEnding { process: Detail } REFUSED, "{process} is ending already";
    349 ProcessNeeded { process: Detail, role: Option<SlotRole> } REFUSED, "the robot moves and needs {process}: hold first with `nims hold`{}", OrSwap(*role);
    350 ProcessBeingReplaced { process: Detail, within_s: f64 } REFUSED, "{process} is being replaced: try again when the new process publishes or has been ended, which takes {within_s:.0} s at most";
    351 ProcessNotStarted { process: Detail, why: Detail } REFUSED, "{process} could not be started: {why}";
    352 SupervisorBus { why: Detail } REFUSED, "the supervisor cannot use its channels: {why}";
    360 ParameterInvalid { key: Detail, why: Detail } BAD_INPUT, "{why}";
    361 ParameterNotRecorded { key: Detail, before: Detail, why: Detail } REFUSED, "{key} stays {before}, because the change cannot be recorded: {why}";

    // faults on request
    400 FaultDone { fault: Detail } ACCEPTED, "done: {fault}";
    // 401 held the sentence alone
    402 FaultInvalid { why: Detail } BAD_INPUT, "{why}";
    403 FaultFailed { fault: Detail, why: Detail } REFUSED, "the fault \"{fault}\" was not made: {why}";

    // the gateway
    450 NotPermitted { verb: Detail, needs: Detail, user: Detail, has: Detail } REFUSED, "{user} may not {verb}: it needs the role {needs}, and {user} has the role {has}; ask the person who runs this robot";
    451 OwnerOnly { verb: Detail, user: Detail } REFUSED, "{user} may not {verb} through the gateway: only the robot's user and root may; for a program, declare it as a process in the system file and start it with nims start";
    452 NoRobotRuns { robot: Detail } REFUSED, "no robot runs here: the gateway of {robot} waits for the next start; start it with its service, or with nims up";
    453 GatewayBusy { most: usize } REFUSED, "{most} requests are unanswered already; wait for their answers, then try again";
    454 ConnectionsFull { most: usize } REFUSED, "the gateway has {most} connections already; close one, then try again";
    455 RobotUnreached { why: Detail } REFUSED, "{why}";
    456 NotAsked { why: Detail } BAD_INPUT, "{why}";
    457 NotACall { why: Detail } BAD_INPUT, "the gateway cannot read this: {why}";
    458 OtherProtocol { given: u64, spoken: u32 } BAD_INPUT, "the gateway's protocol has version {spoken}, and the client speaks version {given}; use the nims of the same installation";
    459 TokenInvalid REFUSED, "the token is unknown, or it was revoked; ask the person who runs this robot for a new one";
    460 MissionMissing BAD_INPUT, "the text of the mission is missing, or is not the one of the hash; send it with the request";
    461 NoFinishedRun { run: Detail } BAD_INPUT, "there is no finished run \"{run}\" here; nims runs lists them";
    462 NoRunFile { run: Detail, file: Detail } BAD_INPUT, "the run \"{run}\" has no file \"{file}\"; the list of its files has their names";
    463 DiskRefused { why: Detail } REFUSED, "{why}";
    464 TooManySubscriptions { most: usize } REFUSED, "a connection has at most {most} subscriptions; end one, then try again";
    465 SensorNotDeclared { sensor: Detail } BAD_INPUT, "the system file declares no plug-in \"{sensor}\"; add it there, and start the gateway again";
    466 SensorTaken { sensor: Detail } REFUSED, "another connection publishes sensor/{sensor}; end it first";
    467 ReadingsTooOften { rate_hz: f64 } REFUSED, "readings come too often; accepted: {rate_hz} per second, the rate_hz of the plug-in in the system file";
    468 NotPublisher { user: Detail } REFUSED, "{user} may not publish readings: only the users that publish of the gateway names may, and the robot's user; ask the person who runs this robot";
    469 PluginStarted { plugin: Detail, unit: Detail } ACCEPTED, "{plugin} runs, in {unit}";
    470 PluginStopped { plugin: Detail } ACCEPTED, "{plugin} is stopped";
    471 PluginFailed { plugin: Detail, verb: Detail, why: Detail } REFUSED, "{plugin}: no {verb}: {why}";
    472 SensorOfAnother { plugin: Detail, sensor: Detail } REFUSED, "{plugin} may not publish sensor/{sensor}: a plug-in delivers the readings of its own name only; send them under the name that the system file declares for it";
    473 SensorTakenTooOften { sensor: Detail } REFUSED, "connections take sensor/{sensor} too often; keep one open, and try again in a second";
    474 OvertakenByStop REFUSED, "the robot was told to stop after this request, so it is not carried out; ask again";
    475 WithdrawnByStop REFUSED, "the robot was told to stop while this motion was being planned, so it was withdrawn; ask again";
    476 WaitedTooLong { within_s: f64 } REFUSED, "the request has waited for {within_s:.0} s and was not sent; look at the robot, then ask again";
    477 RequesterGone REFUSED, "its client is gone, so the request was not sent";
    478 HeldTooOld { age_s: f64 } REFUSED, "the connection stood still: this motion was asked for {age_s:.1} s ago, so it was not begun; press again";
    479 SeatTaken { flyer: Detail } REFUSED, "{flyer} flies now; ask to take over, then try again";
    480 SeatAsked { asks: Detail } REFUSED, "{asks} has asked to take over already; try again in ten seconds";
    481 CodeInvalid { left: usize } REFUSED, "the code is unknown, was used, or is older than ten minutes; {left} more attempts, or ask for a new code";
    482 PairingLocked { for_s: f64 } REFUSED, "too many wrong codes were given; wait for {for_s:.0} s, then try again";
    483 RobotFileStored { file: Detail, kept: Detail } ACCEPTED, "{file} is stored, and the one before it is kept as {kept}; the robot uses it from its next start";
    484 RobotFileSame { file: Detail } ACCEPTED, "{file} is the same already";
    485 RobotFileInUse { file: Detail } REFUSED, "{file} is not changed while the robot is armed; disarm the robot, then try again";
    486 RobotFileRefused { why: Detail } BAD_INPUT, "the robot file is not stored: {why}";
    487 HeldUnseen { age_s: f64 } REFUSED, "the data on the screen was {age_s:.1} s old, so this motion was not begun; press again when it is newer";
    488 AskedTooOften { per_s: f64 } REFUSED, "this is asked for too often; accepted: {per_s} per second";

    // ends of missions; their verdict has no meaning. A plan of an adaptive leg that breaks a limit ends its mission
    // with the reason of that limit.
    500 LeftUnfinished { mission: Detail } REFUSED, "mission \"{mission}\" was left unfinished; nims run with --continue flies the rest";
    501 EndedByEmergencyStop { faults: Faults } REFUSED, "{}", Stop { what: "emergency stop", faults, which: MotorAuthority::FAULT_EMERGENCY_INPUT };
    502 EndedByFault { faults: Faults } REFUSED, "{}", Stop { what: "a fault stopped the robot", faults, which: u32::MAX };
    503 EndedByDisarm REFUSED, "the robot was disarmed";
    504 EndedByRestart REFUSED, "motor-io was restarted";
    505 EndedAfterFault { faults: Faults } REFUSED, "{}", Stop { what: "the robot was stopped after this", faults, which: u32::MAX };
    506 EndedByStop REFUSED, "the robot was stopped";
    510 EndedWithoutMap { map: Detail, within_s: f64 } REFUSED, "no map \"{map}\" came for the adaptive leg within {within_s:.0} s; is the sensor-logger running, and is there a map of that name? See nims channel list";
    511 EndedOffStart REFUSED, "the position of the node by motor-io differs from the estimate, so the motion was not started; see nims status, restart the estimator, and try again";
    512 EndedNotTakenUp { within_s: f64 } REFUSED, "the motion was not taken up within {within_s:.0} s; is the controller running? See nims status";
    513 EndedCommandsRefused { within_s: f64 } REFUSED, "the motion was not taken up within {within_s:.0} s, because the controller sent NaN or commands far beyond the limits; swap to another controller, then start a new motion";
}

/// A sentence of the catalogue without its cure, which follows the first semicolon.
#[must_use]
pub fn without_cure(sentence: &str) -> &str {
    sentence.split_once("; ").map_or(sentence, |(clause, _)| clause)
}

impl Reason {
    /// True where the request is carried out.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        self.accepted() == OperatorRequest::ACCEPTED
    }

    /// True where what was given makes no sense here, whenever it is requested.
    #[must_use]
    pub fn is_bad_input(&self) -> bool {
        self.accepted() == OperatorRequest::BAD_INPUT
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
        self.encode(&mut Writer::new(&mut answer));
        put_sentence(&mut answer.text, &self.sentence());
        answer
    }

    /// The sentence without its cure: see [`without_cure`].
    #[must_use]
    pub fn clause(&self) -> String {
        without_cure(&self.to_string()).to_owned()
    }

    /// The reason of a recorded answer; `None` for a number that this program does not know, or an unanswered request.
    /// A text parameter longer than its field comes back shortened.
    #[must_use]
    pub fn from_request(request: &OperatorRequest) -> Option<Self> {
        Self::recorded(&request.recorded_answer()?)
    }

    /// The reason for which a mission was refused or ended, in the same way; `None` also in a run of an earlier
    /// version, which has the sentence alone.
    #[must_use]
    pub fn from_status(status: &PlanStatus) -> Option<Self> {
        Self::recorded(&status.recorded_reason()?)
    }

    fn recorded(answer: &RequestAnswer) -> Option<Self> {
        Self::decode(answer.reason, &mut Reader::new(answer))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sentences::{FAULTS, FaultText, fault_sentences, mode_sentence, verdict_sentence};
    use messages::{MORE, text_of};
    use std::collections::BTreeSet;

    fn sentence_of(bit: u32) -> String {
        fault_sentences(bit).collect()
    }

    #[test]
    fn every_reason_travels_with_its_parameters() {
        for reason in Reason::examples() {
            let (mut request, answer) = (OperatorRequest::default(), reason.answer());
            request.put_answer(&answer);
            assert_eq!(Reason::from_request(&request), Some(reason));
            assert_eq!(text_of(&request.answer), reason.to_string());
            assert_eq!((request.accepted, request.reason), (reason.accepted(), reason.code()));
            let mut status = PlanStatus::default();
            status.put_reason(&answer);
            assert_eq!(Reason::from_status(&status), Some(reason));
            status.put_reason(&RequestAnswer::default());
            assert_eq!(status, PlanStatus::default());
            let mut copy = answer;
            let mut writer = Writer::new(&mut copy);
            reason.encode(&mut writer);
            assert!(writer.numbers <= 6 && writer.values <= 6, "{reason:?} has too many parameters");
        }
        assert_eq!(Reason::from_request(&OperatorRequest::default()), None);
    }

    /// Every answer, and the faults, modes and verdicts in their sentences, word for word.
    #[test]
    fn the_sentences_are_those_of_the_file() {
        let answers =
            Reason::examples().into_iter().map(|reason| (format!("answer {}", reason.code()), reason.to_string()));
        let faults = FAULTS.iter().map(|FaultText { bit, .. }| {
            let faults = Faults { bits: *bit, cables: [true; 8], units: [true; 8], ..Faults::default() };
            (format!("fault {bit:#x}"), [sentence_of(*bit), Reason::EndedByFault { faults }.to_string()].join(" | "))
        });
        let modes = (0..=7).map(|mode| (format!("mode {mode}"), mode_sentence(mode).to_owned()));
        let verdicts = (0..=11).map(|verdict| (format!("verdict {verdict}"), verdict_sentence(verdict).to_owned()));
        sentences::compare(env!("CARGO_MANIFEST_DIR"), answers.chain(faults).chain(modes).chain(verdicts));
    }

    #[test]
    fn numbers_are_unique_and_every_reason_has_a_row() {
        let codes: BTreeSet<u16> = CATALOGUE.iter().map(|(code, ..)| *code).collect();
        assert_eq!((codes.len(), CATALOGUE.len()), (Reason::examples().len(), Reason::examples().len()));
        assert!(!codes.contains(&0));
    }

    #[test]
    fn an_answer_holds_the_cures_of_whatever_has_failed() {
        let all = FAULTS.iter().fold(0, |all, fault| all | fault.bit);
        let faults = Faults { bits: all, cables: [true; 8], units: [true; 8], ..Faults::default() };
        let answer = Reason::NotArmedFaults { faults }.sentence();
        // The command that lists them all.
        assert!(!answer.contains(MORE) && answer.contains("nims status"), "{answer}");
        for FaultText { bit, clause, cure, .. } in FAULTS {
            let faults = Faults { bits: bit, cables: [true; 8], units: [true; 8], ..Faults::default() };
            let answer = Reason::NotArmedFaults { faults }.sentence();
            assert!(answer.contains(clause) && answer.contains(cure) && !answer.contains(MORE), "{answer}");
        }
    }
}
