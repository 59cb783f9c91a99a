//! One estimate out of two slots, the same for everybody who needs one.

use crate::{ESTIMATORS, MotorAuthority, NodeEstimate, SLOTS};

/// An estimate that is older than the newest one by more than so many cycles comes from an estimator that is gone: what wakes
/// a consumer may be the quicker of two.
const BEHIND_CYCLES: u64 = 3;

/// The estimate to act on: the one whose command motor-io uses; while motor-io fades from one slot to the other, both, mixed in the
/// same proportion as the commands. `None` if there is none at all; the result may be one that is not `valid`.
///
/// `authority` is the newest one, or `None` before the first: then slot a counts. `estimates` are the newest of each slot.
#[must_use]
pub fn blended_estimate(
    authority: Option<&MotorAuthority>,
    estimates: [Option<&NodeEstimate>; SLOTS],
) -> Option<NodeEstimate> {
    let active = authority.map_or(0, |authority| usize::from(authority.active_estimator).min(SLOTS - 1));
    let newest = estimates.iter().flatten().map(|estimate| estimate.header.cycle).max()?;
    let alive = |slot: usize| estimates[slot].filter(|one| one.header.cycle.saturating_add(BEHIND_CYCLES) >= newest);
    let (first, second) = (alive(active), alive(1 - active));
    let valid = |one: &&NodeEstimate| one.valid == 1;
    let (Some(new), Some(old)) = (first.filter(valid), second.filter(valid)) else {
        return first.filter(valid).or(second.filter(valid)).or(first).or(second).copied();
    };
    let share = authority.map_or(1.0, |authority| authority.fade[ESTIMATORS]);
    if !(0.0..1.0).contains(&share) || new.header.cycle != old.header.cycle {
        return Some(*new);
    }
    let mut mixed = *new;
    mix(&mut mixed.position_m, &old.position_m, share);
    mix(&mut mixed.velocity_m_s, &old.velocity_m_s, share);
    mix(&mut mixed.covariance_m2, &old.covariance_m2, share);
    mix(&mut mixed.predicted_m, &old.predicted_m, share);
    mix(&mut mixed.cable_velocity_m_s, &old.cable_velocity_m_s, share);
    mix(&mut mixed.tension_n, &old.tension_n, share);
    mixed.header.oldest_input_ns = new.header.oldest_input_ns.min(old.header.oldest_input_ns);
    Some(mixed)
}

fn mix<const N: usize>(new: &mut [f64; N], old: &[f64; N], share: f64) {
    for (new, old) in new.iter_mut().zip(old) {
        *new = old + share * (*new - old);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(cycle: u64, x: f64, valid: u8) -> NodeEstimate {
        let mut estimate = NodeEstimate { position_m: [x, 0.0, 0.0], valid, ..NodeEstimate::default() };
        estimate.header.cycle = cycle;
        estimate
    }

    fn x(authority: Option<&MotorAuthority>, estimates: [Option<&NodeEstimate>; 2]) -> Option<f64> {
        blended_estimate(authority, estimates).map(|estimate| estimate.position_m[0])
    }

    #[test]
    fn the_slot_in_use_counts_and_a_fade_mixes() {
        let (a, b) = (estimate(9, 1.0, 1), estimate(9, 2.0, 1));
        let mut authority = MotorAuthority { active_estimator: 1, fade: [1.0, 1.0], ..MotorAuthority::default() };
        assert_eq!(x(Some(&authority), [Some(&a), Some(&b)]), Some(2.0));
        authority.fade[1] = 0.25;
        assert_eq!(x(Some(&authority), [Some(&a), Some(&b)]), Some(1.25));
        authority.active_estimator = 0;
        assert_eq!(x(Some(&authority), [Some(&a), Some(&b)]), Some(1.75));
        assert_eq!(x(None, [Some(&a), Some(&b)]), Some(1.0));
    }

    #[test]
    fn one_that_is_gone_or_not_valid_is_left_out() {
        let authority = MotorAuthority { fade: [1.0, 0.5], ..MotorAuthority::default() };
        let (gone, bad, good) = (estimate(5, 1.0, 1), estimate(9, 3.0, 0), estimate(9, 2.0, 1));
        assert_eq!(x(Some(&authority), [Some(&gone), Some(&good)]), Some(2.0));
        assert_eq!(x(Some(&authority), [Some(&bad), Some(&good)]), Some(2.0));
        assert_eq!(x(Some(&authority), [Some(&bad), None]), Some(3.0));
        assert_eq!(x(Some(&authority), [Some(&gone), None]), Some(1.0));
        assert_eq!(x(Some(&authority), [None, None]), None);
    }
}
