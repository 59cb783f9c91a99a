//! What the robot did after a fault, from the changes of its mode and of the processes in charge.

use messages::{MotorAuthority, ROLES, SLOT_NAMES};
use robot_state::sentences::ROLE_NAMES;
use serde::Serialize;

/// Largest number of changes of each kind that are kept, a few hundred kilobytes.
const MAX_CHANGES: usize = 10_000;
/// Time around a fault in which a change of the process in charge belongs to it, s: a cross-fade and a probation.
const SWAPS_S: [f64; 2] = [0.5, 3.0];

/// What the robot did at a time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Step {
    /// Time since the start of the run, s.
    pub time_s: f64,
    /// The predicate of a sentence.
    pub what: String,
}

/// A role with another slot in charge.
#[derive(Debug, Clone)]
struct Charge {
    time_s: f64,
    role: usize,
    slot: u8,
}

/// The changes of a run.
#[derive(Debug, Clone, Default)]
pub(super) struct Timeline {
    /// Time and mode of each change, also of the first cycle of each life.
    modes: Vec<(f64, u8)>,
    charges: Vec<Charge>,
    /// Begin of each life of motor-io after the first one.
    lives: Vec<f64>,
}

/// A stretch of the timeline that begins with a fault.
pub(super) struct Aftermath<'a> {
    /// Begin, s since the start of the run.
    pub(super) from_s: f64,
    /// Time of the next fault, s since the start of the run.
    pub(super) end_s: f64,
    /// Time after the begin in which the mode changes if the fault has an effect on it, s.
    pub(super) within_s: f64,
    /// Mode before it.
    pub(super) before: u8,
    /// When all cables stood, s since the start of the run.
    pub(super) rest_s: Option<f64>,
    /// Numbers of the cables whose drives were released.
    pub(super) released: &'a [usize],
}

impl Timeline {
    /// Records a control cycle and the one before.
    pub(super) fn cycle(&mut self, time_s: f64, last: Option<&MotorAuthority>, authority: &MotorAuthority) {
        let same_life = last.filter(|last| last.header.life == authority.header.life);
        if last.is_some() && same_life.is_none() && self.lives.len() < MAX_CHANGES {
            self.lives.push(time_s);
        }
        if same_life.is_none_or(|last| last.mode != authority.mode) && self.modes.len() < MAX_CHANGES {
            self.modes.push((time_s, authority.mode));
        }
        let changed = |role: &usize| same_life.is_some_and(|last| last.in_charge[*role] != authority.in_charge[*role]);
        for role in (0..ROLES).filter(changed).take(MAX_CHANGES.saturating_sub(self.charges.len())) {
            self.charges.push(Charge { time_s, role, slot: authority.in_charge[role] });
        }
    }

    /// Returns the mode at a time, s since the start of the run.
    pub(super) fn mode_at(&self, time_s: f64) -> u8 {
        let begun = self.modes.iter().rev().find(|(from_s, _)| *from_s <= time_s);
        begun.map_or(MotorAuthority::MODE_DISARMED, |(_, mode)| *mode)
    }

    /// Returns what the robot did until it moved again, was disarmed or had the next fault.
    pub(super) fn steps(&self, after: &Aftermath<'_>) -> Vec<Step> {
        let &Aftermath { from_s, end_s, within_s, mut before, .. } = after;
        let mut did = Vec::new();
        for charge in self.charges.iter().filter(|one| one.time_s < end_s) {
            if (from_s - SWAPS_S[0]..=from_s + SWAPS_S[1]).contains(&charge.time_s) {
                let Charge { time_s, role, slot } = *charge;
                let slot = SLOT_NAMES[usize::from(slot).min(SLOT_NAMES.len() - 1)];
                let what = format!("used the {} in slot {slot} from {time_s:.2} s on", ROLE_NAMES[role]);
                did.push(Step { time_s, what });
            }
        }
        let mut changes = self.modes.iter().filter(|(time_s, _)| (from_s..end_s).contains(time_s)).peekable();
        if changes.peek().is_none_or(|(time_s, _)| *time_s > from_s + within_s) {
            did.push(Step { time_s: from_s, what: unchanged(before).to_owned() });
            return did;
        }
        for &(time_s, mode) in changes {
            let restarted = self.lives.contains(&time_s);
            let what = if restarted { restarted_words(time_s, mode) } else { words(after, before, time_s, mode) };
            did.push(Step { time_s, what });
            let moves = [MotorAuthority::MODE_FOLLOWING, MotorAuthority::MODE_JOGGING, MotorAuthority::MODE_SOFT];
            if moves.contains(&mode) || mode == MotorAuthority::MODE_DISARMED {
                return did;
            }
            before = mode;
        }
        did
    }
}

/// Returns what a robot does that stays in its mode.
fn unchanged(mode: u8) -> &'static str {
    match mode {
        MotorAuthority::MODE_FOLLOWING => "went on with its motion",
        MotorAuthority::MODE_DISARMED => "stayed disarmed",
        MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP => "stayed stopped",
        MotorAuthority::MODE_STOPPING => "went on braking",
        MotorAuthority::MODE_JOGGING => "went on with its jog",
        MotorAuthority::MODE_SOFT => "stayed in soft mode",
        _ => "went on holding",
    }
}

fn restarted_words(time_s: f64, mode: u8) -> String {
    let mode = robot_state::sentences::mode_name(mode);
    format!("was left to the watchdog of its drives until motor-io ran again, {mode}, from {time_s:.2} s on")
}

/// Returns what a change of the mode means for the robot.
fn words(after: &Aftermath<'_>, before: u8, time_s: f64, mode: u8) -> String {
    let later = |rest_s: f64| format!(" (the cables stood {:.2} s later)", rest_s - after.from_s);
    let rest = after.rest_s.map_or_else(String::new, later);
    match mode {
        MotorAuthority::MODE_STOPPING => format!("braked on its path{rest}"),
        MotorAuthority::MODE_FAULTED => match after.released {
            [] => format!("stopped its cables at once and held them{rest}"),
            released => {
                let names: Vec<String> = released.iter().map(ToString::to_string).collect();
                let plural = if released.len() > 1 { "s" } else { "" };
                let names = names.join(", ");
                format!("stopped its cables at once, released cable{plural} {names} and held the others{rest}")
            }
        },
        MotorAuthority::MODE_EMERGENCY_STOP => format!("stopped its motors at once{rest}"),
        MotorAuthority::MODE_HOLDING
            if [MotorAuthority::MODE_FAULTED, MotorAuthority::MODE_EMERGENCY_STOP].contains(&before) =>
        {
            format!("was reset at {time_s:.2} s")
        }
        MotorAuthority::MODE_HOLDING => format!("held from {time_s:.2} s on"),
        MotorAuthority::MODE_FOLLOWING => format!("moved again from {time_s:.2} s on"),
        MotorAuthority::MODE_JOGGING => format!("was jogged from {time_s:.2} s on"),
        MotorAuthority::MODE_SOFT => format!("was in soft mode from {time_s:.2} s on"),
        MotorAuthority::MODE_DISARMED => format!("was disarmed at {time_s:.2} s"),
        _ => format!("was in a mode unknown to this program from {time_s:.2} s on"),
    }
}

/// Returns what the robot does in a mode, for a subordinate clause in the past.
pub(super) fn during(mode: u8) -> &'static str {
    match mode {
        MotorAuthority::MODE_DISARMED => "was disarmed",
        MotorAuthority::MODE_JOGGING => "jogged a cable",
        MotorAuthority::MODE_SOFT => "was in soft mode",
        MotorAuthority::MODE_FOLLOWING => "followed its motion",
        MotorAuthority::MODE_STOPPING => "braked on its path",
        MotorAuthority::MODE_FAULTED => "was stopped by a fault",
        MotorAuthority::MODE_EMERGENCY_STOP => "was in emergency stop",
        _ => "held",
    }
}
