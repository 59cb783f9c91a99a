//! Adaptive legs: a mission is flown up to such a leg, and the map made until then determines the rest.

use cable_robot::Vector3;
use messages::FieldMap;
use survey::adaptive::{KnownCell, KnownField, PatchOptions, patches};
use survey::grid::GridSpec;

use crate::plan::{Plan, PlanError, SHORTEST_S};
use crate::scan::{Adaptive, ScanError, merit, over_patches};
use mission::{Dwell, Leg, MAX_POINTS, Mission, Polyline};

/// Splits a mission before its first adaptive leg; the second part is `None` without such a leg.
pub fn split(mission: &Mission) -> (Mission, Option<Mission>) {
    let Some(at) = mission.leg.iter().position(|leg| matches!(leg, Leg::Adaptive(_))) else {
        return (mission.clone(), None);
    };
    let of = |leg: &[Leg]| Mission { leg: leg.to_vec(), ..mission.clone() };
    (of(&mission.leg[..at]), Some(of(&mission.leg[at..])))
}

/// Plans the part of a mission before an adaptive leg by `plan`; returns the plan and its mission. A node that is at
/// the end of the part already waits there for the map, instead of an end of the mission.
///
/// # Errors
/// The error of `plan`.
pub fn planned(
    part: Mission,
    left: Option<&Mission>,
    plan: impl Fn(&Mission) -> Result<Plan, PlanError>,
) -> Result<(Plan, Mission), PlanError> {
    match plan(&part) {
        Err(PlanError::AlreadyThere) if left.is_some() => {
            let stay = staying(&part);
            plan(&stay).map(|plan| (plan, stay))
        }
        planned => planned.map(|plan| (plan, part)),
    }
}

/// Returns a part with as many legs in which the node only stays for the shortest time.
#[must_use]
pub fn staying(part: &Mission) -> Mission {
    let stay = |duration_s| Leg::Dwell(Dwell { duration_s });
    let mut leg = vec![stay(0.0); part.leg.len()];
    if let Some(last) = leg.last_mut() {
        *last = stay(SHORTEST_S);
    }
    Mission { leg, ..part.clone() }
}

/// Returns the known field of a valid map. Cells under the path of the plan count as sampled.
pub fn known(map: &FieldMap, flown: &Plan) -> Option<KnownField> {
    let (columns, rows) = (map.columns as usize, map.rows as usize);
    let count = columns.checked_mul(rows).filter(|count| (1..=FieldMap::CELLS).contains(count))?;
    if !(map.cell_m > 0.0 && map.origin_m.iter().all(|x| x.is_finite())) {
        return None;
    }
    let spec = GridSpec { origin_m: map.origin_m, cell_m: map.cell_m, columns, rows };
    let mut sampled = vec![false; count];
    for segment in &flown.segments {
        let steps = (segment.path.length() / (0.5 * map.cell_m)).ceil().max(1.0);
        for step in 0..=steps as usize {
            let at = segment.path.point(segment.path.length() * step as f64 / steps);
            if let Some((column, row)) = spec.cell_at([at.x, at.y]) {
                sampled[spec.index(column, row)] = true;
            }
        }
    }
    let cell = |at: usize| {
        let (value, sigma) = (f64::from(map.value[at]), f64::from(map.sigma[at]));
        (value.is_finite() && sigma.is_finite()).then_some(KnownCell { value, sigma, sampled: sampled[at] })
    };
    Some(KnownField { spec, cells: (0..count).map(cell).collect() })
}

/// Replaces the adaptive leg at the beginning of a mission by a path over the parts of its area that are worth a second
/// look, for a node at `from` (m).
///
/// # Errors
/// The path has more points than a leg may have.
pub fn resolved(left: &Mission, known: &KnownField, from: Vector3<f64>) -> Result<Mission, ScanError> {
    let Some(Leg::Adaptive(leg)) = left.leg.first() else { return Ok(left.clone()) };
    let way = way(leg, known, from)?;
    let first = if way.is_empty() {
        // no part is worth a second look
        Leg::Dwell(Dwell { duration_s: 0.0 })
    } else {
        let points_m = way.iter().map(|at| <[f64; 3]>::from(*at).into()).collect();
        Leg::Polyline(Polyline { points_m, speed_m_s: leg.speed_m_s })
    };
    let mut mission = left.clone();
    mission.leg[0] = first;
    Ok(mission)
}

fn way(leg: &Adaptive, known: &KnownField, from: Vector3<f64>) -> Result<Vec<Vector3<f64>>, ScanError> {
    let (a, b) = (leg.corner_m.position_m, leg.opposite_m.position_m);
    let low_m = [a[0].min(b[0]), a[1].min(b[1])];
    let high_m = [a[0].max(b[0]), a[1].max(b[1])];
    let options = PatchOptions {
        merit: merit(leg.by),
        tile_m: leg.tile_m.unwrap_or(3.0 * leg.pitch_m),
        share: leg.share,
        least: leg.least,
    };
    let chosen = patches(known, low_m, high_m, [from.x, from.y], &options);
    let way = over_patches(&chosen, a[2], leg.pitch_m, from)?;
    if way.len() > MAX_POINTS {
        return Err(ScanError::TooMany { stops: way.len() as f64 });
    }
    Ok(way)
}
