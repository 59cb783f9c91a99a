//! Validity of samples of the control chain: the only place that judges life, cycle and age.
//!
//! The header of a sample of the chain names the life of motor-io and the cycle that it belongs to. motor-io counts its
//! cycles from 1 in every life, and a channel may still hold samples of a dead or a faulty process. A consumer that
//! acts on samples therefore calls [`freshness`] and acts only on [`Freshness::Live`]; one that keeps history, such as
//! the sensor logger or an analysis, calls [`same_life`]; the recorder records everything.

use crate::{ESTIMATORS, Header, Message, MotorAuthority, NodeEstimate, SLOTS};

/// Cycles by which motor/authority may lag behind a sample: it is published just after motor/state, so one is usual,
/// and a consumer may be woken between the two.
pub const AUTHORITY_LAG: u64 = 3;

/// Validity of a sample of the chain beside the newest motor/authority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freshness {
    /// It may be acted on.
    Live,
    /// It belongs to another life of motor-io.
    OtherLife,
    /// Its cycle has not begun yet.
    Ahead,
    /// It is older than its time to live.
    Expired,
}

/// Judges a sample beside the newest motor/authority, by their headers.
#[must_use]
pub fn freshness(sample: &Header, authority: &Header, ttl_cycles: u32) -> Freshness {
    match () {
        () if !same_life(sample, authority) => Freshness::OtherLife,
        () if sample.cycle > authority.cycle.saturating_add(AUTHORITY_LAG) => Freshness::Ahead,
        () if sample.cycle.saturating_add(ttl_cycles.into()) < authority.cycle => Freshness::Expired,
        () => Freshness::Live,
    }
}

/// Returns whether both samples belong to one life: the rule for consumers of history.
#[must_use]
pub fn same_life(one: &Header, other: &Header) -> bool {
    one.life == other.life
}

/// Returns the newer of a kept and an arrived sample, by life and cycle: samples of a dead motor-io may arrive after
/// the first of its successor.
#[must_use]
pub fn newer<T: Message>(kept: Option<T>, arrived: Option<T>) -> Option<T> {
    let age = |sample: &T| (sample.header().life, sample.header().cycle);
    match (kept, arrived) {
        (Some(kept), Some(arrived)) if age(&arrived) < age(&kept) => Some(kept),
        (kept, arrived) => arrived.or(kept),
    }
}

/// Rule by which estimates are used beside an authority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Estimates that may be acted on now; see [`freshness`].
    Live {
        /// Time to live of an estimate, cycles.
        ttl_cycles: u32,
    },
    /// Estimates of the same life.
    History,
}

/// Returns the estimate whose command motor-io uses. While motor-io fades from one slot to the other, it is the mixture
/// of both in the proportion of the commands. `None` without an authority or a usable estimate; the result may be one
/// that is not `valid`.
///
/// `authority` is the newest one; `estimates` are the newest of each slot.
#[must_use]
pub fn blended_estimate(
    authority: Option<&MotorAuthority>,
    estimates: [Option<&NodeEstimate>; SLOTS],
    rule: Rule,
) -> Option<NodeEstimate> {
    // A recording without an authority: slot a, of the latest life.
    let unknown = || {
        let life = estimates.iter().flatten().map(|estimate| estimate.header.life).max().unwrap_or(0);
        let header = Header { life, ..Header::default() };
        MotorAuthority { header, fade: [1.0; crate::ROLES], ..MotorAuthority::default() }
    };
    let authority = match (authority, rule) {
        (Some(authority), _) => *authority,
        (None, Rule::History) => unknown(),
        (None, Rule::Live { .. }) => return None,
    };
    let counts = |estimate: &&NodeEstimate| match rule {
        Rule::Live { ttl_cycles } => freshness(&estimate.header, &authority.header, ttl_cycles) == Freshness::Live,
        Rule::History => same_life(&estimate.header, &authority.header),
    };
    let active = usize::from(authority.active_estimator).min(SLOTS - 1);
    let share = authority.fade[ESTIMATORS];
    let fades = (0.0..1.0).contains(&share);
    // After a fade a live consumer ignores the free slot until motor-io puts it in charge.
    let other = |estimate: &&NodeEstimate| (fades || rule == Rule::History) && counts(estimate);
    let (first, second) = (estimates[active].filter(counts), estimates[1 - active].filter(other));
    let valid = |one: &&NodeEstimate| one.valid == 1;
    let (Some(new), Some(old)) = (first.filter(valid), second.filter(valid)) else {
        return first.filter(valid).or(second.filter(valid)).or(first).or(second).copied();
    };
    if !fades || new.header.cycle != old.header.cycle {
        return Some(*new);
    }
    let mut mixed = *new;
    // A new field fails to compile here until it is decided whether it fades.
    #[rustfmt::skip]
    let NodeEstimate {
        position_m, velocity_m_s, covariance_m2, predicted_m, cable_velocity_m_s, tension_n,
        header: _, measured_m: _, phi1: _, phi2: _, residual_m: _, swing_m: _, based_on_authority: _, epoch: _,
        incarnation: _, slack: _, valid: _, cable_count: _, method: _, pad0: _, thread: _,
    } = old;
    mix(&mut mixed.position_m, position_m, share);
    mix(&mut mixed.velocity_m_s, velocity_m_s, share);
    mix(&mut mixed.covariance_m2, covariance_m2, share);
    mix(&mut mixed.predicted_m, predicted_m, share);
    mix(&mut mixed.cable_velocity_m_s, cable_velocity_m_s, share);
    mix(&mut mixed.tension_n, tension_n, share);
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

    const LIVE: Rule = Rule::Live { ttl_cycles: 3 };

    fn header(life: u64, cycle: u64) -> Header {
        Header { life, cycle, ..Header::default() }
    }

    fn estimate(cycle: u64, x: f64, valid: u8) -> NodeEstimate {
        NodeEstimate { header: header(5, cycle), position_m: [x, 0.0, 0.0], valid, ..NodeEstimate::default() }
    }

    fn authority(active_estimator: u8, fade: f64) -> MotorAuthority {
        MotorAuthority { header: header(5, 9), active_estimator, fade: [1.0, fade], ..MotorAuthority::default() }
    }

    fn x(authority: &MotorAuthority, estimates: [Option<&NodeEstimate>; 2]) -> Option<f64> {
        blended_estimate(Some(authority), estimates, LIVE).map(|estimate| estimate.position_m[0])
    }

    #[test]
    fn a_sample_stands_by_life_then_cycle_then_age() {
        let now = header(5, 100);
        for (life, cycle, expected) in [
            (5, 100, Freshness::Live),
            (5, 103, Freshness::Live),
            (5, 104, Freshness::Ahead),
            (5, 1 << 63, Freshness::Ahead),
            (5, u64::MAX, Freshness::Ahead),
            (5, 97, Freshness::Live),
            (5, 96, Freshness::Expired),
            (5, 0, Freshness::Expired),
            (4, 100, Freshness::OtherLife),
            (6, 100, Freshness::OtherLife),
            (0, u64::MAX, Freshness::OtherLife),
        ] {
            assert_eq!(freshness(&header(life, cycle), &now, 3), expected, "life {life}, cycle {cycle}");
        }
    }

    #[test]
    fn a_later_life_is_newer_whatever_its_cycle() {
        let of = |life, cycle| Some(NodeEstimate { header: header(life, cycle), ..NodeEstimate::default() });
        assert_eq!(newer(of(1, 5000), of(2, 1)), of(2, 1));
        assert_eq!(newer(of(2, 1), of(1, 5000)), of(2, 1));
        assert_eq!(newer(of(2, 1), of(2, 2)), of(2, 2));
        assert_eq!(newer(of(2, 1), None), of(2, 1));
    }

    #[test]
    fn the_slot_in_use_counts_and_a_fade_mixes() {
        let (a, b) = (estimate(9, 1.0, 1), estimate(9, 2.0, 1));
        assert_eq!(x(&authority(1, 1.0), [Some(&a), Some(&b)]), Some(2.0));
        assert_eq!(x(&authority(1, 0.25), [Some(&a), Some(&b)]), Some(1.25));
        assert_eq!(x(&authority(0, 0.25), [Some(&a), Some(&b)]), Some(1.75));
        assert_eq!(blended_estimate(None, [Some(&a), Some(&b)], LIVE), None);
    }

    #[test]
    fn one_that_is_gone_or_not_valid_is_left_out() {
        let authority = authority(0, 0.5);
        let (gone, bad, good) = (estimate(5, 1.0, 1), estimate(9, 3.0, 0), estimate(9, 2.0, 1));
        assert_eq!(x(&authority, [Some(&gone), Some(&good)]), Some(2.0));
        assert_eq!(x(&authority, [Some(&bad), Some(&good)]), Some(2.0));
        assert_eq!(x(&authority, [Some(&bad), None]), Some(3.0));
        assert_eq!(x(&authority, [Some(&gone), None]), None);
        assert_eq!(x(&authority, [None, None]), None);
    }

    #[test]
    fn history_looks_at_lives_only() {
        let authority = authority(0, 1.0);
        let old = estimate(2, 1.0, 1);
        let other = NodeEstimate { header: header(4, 9), ..estimate(9, 7.0, 1) };
        let of = |estimates| blended_estimate(Some(&authority), estimates, Rule::History).map(|one| one.position_m[0]);
        assert_eq!(of([Some(&old), None]), Some(1.0));
        assert_eq!(of([Some(&other), None]), None);
    }

    #[test]
    fn no_sample_of_the_free_slot_displaces_the_slot_in_use() {
        let authority = authority(0, 1.0);
        let lead = estimate(9, 1.0, 1);
        for cycle in [0, 8, 9, 10, 12, 13, 1 << 63, u64::MAX] {
            let forged = estimate(cycle, 7.0, 1);
            assert_eq!(x(&authority, [Some(&lead), Some(&forged)]), Some(1.0), "cycle {cycle}");
            assert_eq!(x(&authority, [None, Some(&forged)]), None, "cycle {cycle}, alone");
        }
    }
}
