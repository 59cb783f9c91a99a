//! Takes back the last answer. Questions have a fixed order, so it is the last item in this order that the file
//! contains.

use super::question::{pulleys, wanted};
use super::text::{listed, metres};
use super::{shape, tape};
use crate::calibrate::MeasurementsFile;

/// Takes back the last answer and returns its description; `None` if there is no answer.
pub fn undo(file: &mut MeasurementsFile) -> Option<String> {
    let points = file.point.len();
    let setup = file.setup.get_or_insert_default();
    if let Some(length) = setup.lengths_so_far_m.pop() {
        let line = setup.lengths_so_far_m.len() + 1;
        return Some(say!("cable {line} was {}", metres(length)));
    }
    let planned = wanted(file);
    if let Some(undone) = tape::undo(file, planned) {
        return Some(undone);
    }
    let setup = file.setup.get_or_insert_default();
    // A new number of points was answered after all decisions about the points at that time.
    if setup.plan.len() > 1 && setup.plan.last().is_some_and(|plan| plan[0] == points) {
        setup.plan.pop();
        return Some(say!("how many points are wanted"));
    }
    if let Some(doubt) = file.doubt.pop_if(|doubt| doubt.after == points) {
        let decided = if doubt.used { say!("to keep") } else { say!("to measure again") };
        return Some(say!("point {} was {decided}", doubt.point));
    }
    if let Some(point) = file.point.pop() {
        return Some(say!("point {points} was {} m", listed(&point.lengths_m)));
    }
    if setup.plan.pop().is_some() {
        return Some(say!("how many points are wanted"));
    }
    if let Some(turn_m) = file.pulley_turn_m.take() {
        return Some(say!("one turn of a wheel was {:.0} mm of cable", 1e3 * turn_m));
    }
    if file.pulley.take().is_some() {
        let radius_m = std::mem::take(&mut file.pulley_radius_m).first().copied();
        (file.sigma_pulley_radius_m, file.sigma_cable_scale, file.sigma_attachment_m) = (None, None, None);
        (file.sigma_offset_m, file.sigma_floor_m) = (None, None);
        return Some(match radius_m {
            Some(radius_m) => say!("the wheels measured {:.1} mm across", 2000.0 * radius_m),
            None => say!("the cables left through eyes"),
        });
    }
    let setup = file.setup.get_or_insert_default();
    if let Some(about_m) = setup.about_m.take() {
        return Some(say!("the pulleys were about {} high", metres(about_m)));
    }
    for pulley in (1..=pulleys(file)).rev() {
        let undone = height(file, pulley);
        if undone.is_some() {
            return undone;
        }
    }
    for to in (2..=pulleys(file)).rev() {
        let undone = place(file, to);
        if undone.is_some() {
            return undone;
        }
    }
    let count = file.setup.as_mut()?.pulleys.take()?;
    Some(say!("there were {count} pulleys"))
}

fn height(file: &mut MeasurementsFile, pulley: usize) -> Option<String> {
    if let Some(at) = file.height.iter().rposition(|height| height.anchor == pulley) {
        let height = file.height.remove(at);
        return Some(say!("pulley {pulley} was {} high", metres(height.m)));
    }
    let setup = file.setup.as_mut()?;
    let at = setup.unmeasured.iter().rposition(|unmeasured| *unmeasured == pulley)?;
    setup.unmeasured.remove(at);
    Some(say!("the height of pulley {pulley} was not measured"))
}

fn place(file: &mut MeasurementsFile, to: usize) -> Option<String> {
    if let Some(side) = file.range.iter_mut().filter(|r| r.from.max(r.to) == to).find_map(|r| r.side.take()) {
        return Some(say!("pulley {to} was on the {}", if side < 0 { say!("right") } else { say!("left") }));
    }
    for from in (1..to).rev() {
        if let Some(m) = shape::distance(file, from, to) {
            file.range.retain(|r| (r.from, r.to) != (from, to) && (r.from, r.to) != (to, from));
            return Some(say!("{from}-{to} was {}", metres(m)));
        }
        let setup = file.setup.as_mut()?;
        if let Some(at) = setup.skipped.iter().rposition(|pair| *pair == [from, to]) {
            setup.skipped.remove(at);
            return Some(say!("{from}-{to} was not measured"));
        }
    }
    None
}
