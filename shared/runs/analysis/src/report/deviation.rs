//! Why the node was farthest from its setpoint: what the record shows while the largest deviation rose.
//!
//! A cause is named only if it lies in the rise or [`LEAD_S`] before it. Without one, the explanation says so: the
//! record has neither the wind nor what the model leaves out.

use super::explain::{Explanation, Phase, Rise, Swap};
use crate::accuracy::{Distances, Error};
use crate::tracker::Cycle;
use cable_robot::Vector3;
use messages::{CABLES, MotorAuthority};
use robot_state::Periods;
use std::collections::VecDeque;

/// Time before a largest deviation in which the beginning of its rise is looked for, s.
const HISTORY_S: f64 = 3.0;
/// Time from a cause to the beginning of the rise, s: a command acts in the next cycle, and a drive follows after its
/// delay and lag, together about 0.1 s.
const LEAD_S: f64 = 0.15;
/// Share of a rise below which it has not begun: above the noise of encoders.
const FOOT_SHARE: f64 = 0.1;
/// Share of a rise to which the deviation was higher before, where an earlier rise had ended.
const EARLIER_SHARE: f64 = 0.5;
/// Least acceleration of the setpoint that counts as a change of speed or direction, m/s².
const TURNING_M_S2: f64 = 0.02;

/// Deviations that are explained: of the estimate, which the robot sees, and of the truth.
pub const DEVIATIONS: [&str; 2] = ["estimate", "truth"];

/// What the record has of one cycle.
#[derive(Debug, Clone, Copy)]
struct Moment {
    time_s: f64,
    cycle: u64,
    life: u64,
    /// Deviation of estimate and truth, m; `None` while the setpoint does not move.
    off_m: [Option<f64>; 2],
    periods: Periods,
    /// From this cycle to its largest deviation of the truth, s: the truth goes on while cycles are lost.
    truth_after_s: f64,
    /// Periods as the next cycle counts them, with those lost before it.
    periods_after: Periods,
    /// Time to the next cycle if cycles are missing between them, s; otherwise 0.
    silent_s: f64,
    rate: f64,
    rate_target: f64,
    scale: f64,
    saturation: f64,
    falls_back: bool,
    fades: [bool; 2],
    in_charge: [u8; 2],
    duty: [f64; CABLES],
    tension_n: [f64; CABLES],
    slack: [bool; CABLES],
    phase: Phase,
}

impl Moment {
    fn new(time_s: f64, cycle: &Cycle<'_>) -> Self {
        let MotorAuthority { header, plan_rate, plan_rate_target, scale, .. } = *cycle.authority;
        let count = usize::from(cycle.authority.cable_count).min(CABLES);
        let (mut duty, mut tension_n, mut slack) = ([0.0; CABLES], [f64::NAN; CABLES], [false; CABLES]);
        if let Some(state) = cycle.state {
            duty[..count].copy_from_slice(&state.duty[..count]);
        }
        if let Some(estimate) = cycle.estimate {
            tension_n[..count].copy_from_slice(&estimate.tension_n[..count]);
            slack.iter_mut().zip(&estimate.slack[..count]).for_each(|(slack, is)| *slack = *is == 1);
        }
        let (off_m, truth_after_s) = deviations(cycle);
        Self {
            time_s,
            cycle: header.cycle,
            life: header.life,
            off_m,
            periods: Periods::from_authority(cycle.authority),
            truth_after_s,
            periods_after: Periods::from_authority(cycle.next.unwrap_or(cycle.authority)),
            silent_s: silence(cycle),
            rate: plan_rate,
            rate_target: plan_rate_target,
            // Runs of before have no such field, and nothing is scaled to nothing.
            scale: if scale > 0.0 { scale } else { 1.0 },
            saturation: cycle.control.map_or(0.0, |control| control.saturation),
            falls_back: cycle.control.is_some_and(|control| control.law != control.chosen_law),
            fades: cycle.authority.fade.map(|fade| fade > 0.0 && fade < 1.0),
            in_charge: [cycle.authority.active_controller, cycle.authority.active_estimator],
            duty,
            tension_n,
            slack,
            phase: phase(cycle),
        }
    }
}

/// Returns the deviations of estimate and truth in a cycle whose setpoint moves, and the time from the cycle to the
/// latter, s.
fn deviations(cycle: &Cycle<'_>) -> ([Option<f64>; 2], f64) {
    let (Some(setpoint), Some(_), true) = (cycle.setpoint, cycle.next, cycle.moving) else { return ([None; 2], 0.0) };
    let estimate = cycle.estimate.map(|estimate| (Vector3::from(estimate.position_m) - setpoint.position).norm());
    let off = |truth: &messages::TruthNode| {
        let stamp_ns = truth.header.stamp_ns;
        let target = cycle.setpoint_at(stamp_ns)?;
        let after_s = stamp_ns.saturating_sub(cycle.authority.header.stamp_ns) as f64 * 1e-9;
        Some(((Vector3::from(truth.position_m) - target.position).norm(), after_s))
    };
    let truth = cycle.truth.iter().filter_map(off).max_by(|one, other| one.0.total_cmp(&other.0));
    ([estimate, truth.map(|(off_m, _)| off_m)], truth.map_or(0.0, |(_, after_s)| after_s))
}

/// Returns the time to the next cycle if it is later than a period and a half, s; otherwise 0.
fn silence(cycle: &Cycle<'_>) -> f64 {
    let next = cycle.next.map_or(0, |next| next.header.stamp_ns);
    let silent_s = next.saturating_sub(cycle.authority.header.stamp_ns) as f64 * 1e-9;
    if silent_s > 1.5 * cycle.authority.period_s { silent_s } else { 0.0 }
}

/// Returns what the setpoint does.
fn phase(cycle: &Cycle<'_>) -> Phase {
    let Some(setpoint) = cycle.setpoint.filter(|_| cycle.moving) else { return Phase::Rests };
    let along = setpoint.acceleration.dot(&setpoint.velocity) / setpoint.velocity.norm().max(f64::MIN_POSITIVE);
    match (along, setpoint.acceleration.norm()) {
        (along, _) if along > TURNING_M_S2 => Phase::Accelerates,
        (along, _) if along < -TURNING_M_S2 => Phase::Brakes,
        (_, all) if all > TURNING_M_S2 => Phase::Turns,
        _ => Phase::Cruises,
    }
}

/// The largest deviation of a leg or of the run.
#[derive(Debug, Clone)]
struct Peak {
    off_m: f64,
    at_s: f64,
    rise: Option<Rise>,
}

/// Largest deviations of the run and of each leg, with their rises. Its memory grows with the number of legs only.
#[derive(Debug, Clone, Default)]
pub struct Deviations {
    recent: VecDeque<Moment>,
    /// By place (the run, then each leg) and deviation.
    peaks: Vec<[Option<Peak>; 2]>,
    /// Places whose largest deviation is the newest one, so that its rise may go on: of the run, the asked time, a leg.
    open: [[Option<usize>; 2]; 3],
    /// The asked time, s since the start of the run, with its errors.
    between: Option<([f64; 2], [Distances; 2])>,
}

/// What a largest deviation is that of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// The whole run.
    Run,
    /// The asked time.
    Between,
    /// The leg with this index.
    Leg(usize),
}

impl Scope {
    /// Returns its place among the peaks.
    fn place(self) -> usize {
        match self {
            Self::Run => 0,
            Self::Between => 1,
            Self::Leg(index) => index + 2,
        }
    }
}

impl Deviations {
    /// Creates it for a run, and for a time in it, s since its start.
    #[must_use]
    pub fn new(between: Option<[f64; 2]>) -> Self {
        Self { between: between.map(|between| (between, Default::default())), ..Self::default() }
    }

    /// Returns the errors of estimate and truth in the asked time.
    #[must_use]
    pub fn errors_between(&self) -> [Option<Error>; 2] {
        self.between.map_or([None; 2], |(_, errors)| errors.map(|sum| sum.result()))
    }

    /// Adds a cycle on a leg with this index; `None` where there is none.
    pub fn cycle(&mut self, time_s: f64, cycle: &Cycle<'_>, leg: Option<usize>) {
        let moment = Moment::new(time_s, cycle);
        let within = self.between.as_mut().filter(|([from_s, to_s], _)| (*from_s..*to_s).contains(&time_s));
        let scopes = [cycle.segment.map(|_| Scope::Run), within.as_ref().map(|_| Scope::Between), leg.map(Scope::Leg)];
        if let Some((_, errors)) = within {
            let sums = errors.iter_mut().zip(moment.off_m);
            sums.for_each(|(sum, off_m)| off_m.iter().for_each(|off_m| sum.add(*off_m)));
        }
        let places = scopes.map(|scope| scope.map(Scope::place));
        for (scope, place) in places.into_iter().enumerate() {
            for which in 0..DEVIATIONS.len() {
                self.raise(scope, place, which, &moment);
            }
        }
        self.recent.push_back(moment);
        while self.recent.front().is_some_and(|first| first.time_s < time_s - HISTORY_S || first.time_s > time_s) {
            self.recent.pop_front();
        }
    }

    /// Raises the largest deviation of a place, or explains it where it has ended.
    fn raise(&mut self, scope: usize, place: Option<usize>, which: usize, moment: &Moment) {
        let known = place.and_then(|place| self.peaks.get(place)?[which].as_ref()).map_or(0.0, |peak| peak.off_m);
        let larger = place.zip(moment.off_m[which]).filter(|(_, off_m)| *off_m > known);
        if self.open[scope][which].is_some_and(|open| larger.is_none_or(|(place, _)| place != open)) {
            self.end_of_rise(scope, which, Some(moment));
        }
        if let Some((place, off_m)) = larger {
            if self.peaks.len() <= place {
                self.peaks.resize(place + 1, [None, None]);
            }
            self.peaks[place][which] = Some(Peak { off_m, at_s: moment.time_s, rise: None });
            self.open[scope][which] = Some(place);
        }
    }

    /// Keeps what the record shows in the rise of an open peak; `after`: the cycle after it.
    fn end_of_rise(&mut self, scope: usize, which: usize, after: Option<&Moment>) {
        let Some(place) = self.open[scope][which].take() else { return };
        let Some(peak) = self.peaks.get_mut(place).and_then(|peaks| peaks[which].as_mut()) else { return };
        let until = self.recent.partition_point(|moment| moment.time_s <= peak.at_s);
        let moments: Vec<Moment> = self.recent.iter().take(until).copied().collect();
        peak.rise = rise(&moments, which, after);
    }

    /// Ends the open rises; to be called at the end of a run.
    pub fn close(&mut self) {
        for scope in 0..self.open.len() {
            for which in 0..DEVIATIONS.len() {
                self.end_of_rise(scope, which, None);
            }
        }
    }

    /// Explains the largest deviations of estimate and truth.
    pub fn explained(
        &self,
        scope: Scope,
        explain: impl Fn(&'static str, f64, &Rise) -> Explanation,
    ) -> [Option<Explanation>; 2] {
        let peaks = self.peaks.get(scope.place());
        std::array::from_fn(|which| {
            let peak = peaks?[which].as_ref()?;
            Some(explain(DEVIATIONS[which], peak.off_m, peak.rise.as_ref()?))
        })
    }
}

/// Returns the index of the first moment of the rise to the last one.
fn begin_of_rise(moments: &[Moment], which: usize) -> usize {
    let peak_m = moments.last().and_then(|last| last.off_m[which]).unwrap_or(0.0);
    let (mut least_m, mut trough) = (peak_m, moments.len().saturating_sub(1));
    for (at, moment) in moments.iter().enumerate().rev() {
        let gap = moments.get(at + 1).is_some_and(|next| next.life != moment.life);
        let Some(off_m) = moment.off_m[which].filter(|_| !gap) else {
            // The setpoint began to move here.
            (trough, least_m) =
                (at + 1, least_m.min(moments.get(at + 1).and_then(|next| next.off_m[which]).unwrap_or(0.0)));
            break;
        };
        if off_m < least_m {
            (least_m, trough) = (off_m, at);
        } else if off_m > least_m + EARLIER_SHARE * (peak_m - least_m) && peak_m > least_m && at < trough {
            break;
        }
    }
    let foot_m = least_m + FOOT_SHARE * (peak_m - least_m);
    let below = |moment: &Moment| moment.off_m[which].is_some_and(|off_m| off_m <= foot_m);
    let trough = trough.min(moments.len().saturating_sub(1));
    moments[trough..].iter().rposition(below).map_or(trough, |at| trough + at)
}

/// Sums up what the record has of the rise to the last of these moments; `after`: the cycle after it.
fn rise(moments: &[Moment], which: usize, after: Option<&Moment>) -> Option<Rise> {
    let last = moments.last()?;
    let from_s = moments.get(begin_of_rise(moments, which))?.time_s;
    let first = moments.partition_point(|moment| moment.time_s < from_s - LEAD_S);
    let before = first.checked_sub(1).and_then(|at| moments.get(at));
    let window = moments.get(first..)?;
    let base = before.or(window.first()).filter(|base| base.life == last.life);
    let of_truth = DEVIATIONS[which] == "truth";
    let (ends_s, periods) = match after.filter(|after| after.life == last.life && last.silent_s > 0.0) {
        _ if !of_truth => (last.time_s, last.periods),
        // Periods that never ran are counted in the cycle after the one that came late.
        Some(after) => (last.time_s + last.truth_after_s, after.periods_after),
        None => (last.time_s + last.truth_after_s, last.periods_after),
    };
    // The estimate of a cycle is older than the silence after it.
    let silences = &window[..window.len() - usize::from(!of_truth)];
    let low = |value: fn(&Moment) -> f64| window.iter().map(value).fold(f64::INFINITY, f64::min);
    let high = |value: fn(&Moment) -> f64| window.iter().map(value).fold(f64::NEG_INFINITY, f64::max);
    let each = |value: &dyn Fn(&Moment, usize) -> f64, take: fn(f64, f64) -> f64, from: f64| -> [f64; CABLES] {
        std::array::from_fn(|cable| window.iter().map(|moment| value(moment, cable)).fold(from, take))
    };
    let swaps = std::array::from_fn(|role| {
        let at_last = last.in_charge[role];
        let slots = || window.iter().map(|moment| moment.in_charge[role]);
        let change = slots().zip(slots().skip(1)).find(|(before, slot)| before != slot);
        // A cross-fade may go on after a change before the rise.
        let fades = window.iter().any(|moment| moment.fades[role]).then_some(at_last);
        change.map(|(_, slot)| slot).or(fades).map(|to| Swap { to, at_last })
    });
    Some(Rise {
        begin_s: from_s,
        causes_from_s: window.first()?.time_s,
        at_s: ends_s,
        cycle: last.cycle,
        phase: last.phase,
        estimate_m: last.off_m[0],
        lost: base.map_or_else(Periods::default, |base| since(&base.periods, &periods)),
        silent_s: silences.iter().map(|moment| moment.silent_s).fold(0.0, f64::max),
        restarted: window.iter().any(|moment| moment.life != last.life),
        rates: [low(|moment| moment.rate), high(|moment| moment.rate)],
        stops: window.iter().any(|moment| moment.rate_target == 0.0 && moment.off_m[which].is_some()),
        scale: low(|moment| moment.scale),
        saturation: high(|moment| moment.saturation),
        falls_back: window.iter().any(|moment| moment.falls_back),
        swaps,
        duty: each(&|moment, cable| moment.duty[cable].abs(), f64::max, 0.0),
        least_n: each(&|moment, cable| moment.tension_n[cable], f64::min, f64::INFINITY),
        greatest_n: each(&|moment, cable| moment.tension_n[cable], f64::max, f64::NEG_INFINITY),
        slack: std::array::from_fn(|cable| window.iter().any(|moment| moment.slack[cable])),
    })
}

/// Returns the periods from one count to a later one of the same life.
fn since(before: &Periods, now: &Periods) -> Periods {
    Periods {
        steered: now.steered.saturating_sub(before.steered),
        paused: now.paused.saturating_sub(before.paused),
        computer: now.computer.saturating_sub(before.computer),
        drive: now.drive.saturating_sub(before.drive),
        resync: now.resync.saturating_sub(before.resync),
        answer: now.answer.saturating_sub(before.answer),
    }
}
