//! Lines and parabolas, computed and flown.

use super::setup::{CLEARANCE_M, WinchSetup, moves};
use crate::flight::{ClosedLoopFlight, DRIVES, Track, TrackPoint};
use crate::section::Effort;
use crate::stand_in;
use anyhow::Result;
use cable_robot::Distribution;
use cable_robot::energy::{Best, Cost};

/// Parabolas compared with lines in the three-cable configuration, computed and flown.
pub(super) struct MoveComparison {
    /// Computed costs of line and best parabola.
    pub(super) expected: Vec<(Cost, Best)>,
    /// Flights along the line and along the parabola.
    pub(super) flown: Vec<[Track; 2]>,
}

impl MoveComparison {
    pub(super) fn fly(effort: Effort) -> Result<Self> {
        let rig = WinchSetup::new(&stand_in::three_cable_anchors(), stand_in::geared())?;
        let mut moves = moves(&stand_in::TRIANGLE_PATH);
        if effort == Effort::Quick {
            moves.truncate(1);
        }
        let (mut expected, mut flown) = (Vec::new(), Vec::new());
        for ends in moves {
            let (line, best) = rig.line_and_best_above(CLEARANCE_M, Distribution::Unique, ends)?;
            let [x, y, z]: [f64; 3] = ends.1.into();
            let fly = |leg: String| -> Result<Track> {
                let mission = format!("name = \"move\"\nspeed_m_s = {}\n[[leg]]\n{leg}\n", stand_in::SPEED_M_S);
                let track = ClosedLoopFlight {
                    period_s: 0.02,
                    horizon: 10,
                    ..ClosedLoopFlight::new(ends.0.into(), mission, DRIVES[0])
                }
                .fly()?;
                anyhow::ensure!(track.done, "the robot stopped on the way to {x}, {y}, {z}");
                Ok(track)
            };
            flown.push([
                fly(format!("line = {{ to_m = [{x}, {y}, {z}] }}"))?,
                fly(format!("parabola = {{ to_m = [{x}, {y}, {z}], mu_per_m = {} }}", best.mu_per_m))?,
            ]);
            expected.push((line, best));
        }
        Ok(Self { expected, flown })
    }
}

/// Returns loss and duration of a flown move, J and s.
pub(crate) fn flown_cost(track: &Track, resistance_ohm: f64) -> [f64; 2] {
    let moving: Vec<&TrackPoint> = track.instants.iter().filter(|at| at.moving).collect();
    let energy: f64 = moving
        .windows(2)
        .map(|pair| {
            let loss = |at: &TrackPoint| at.current_a[..3].iter().map(|i| i * i).sum::<f64>() * resistance_ohm;
            0.5 * (loss(pair[0]) + loss(pair[1])) * (pair[1].time_s - pair[0].time_s)
        })
        .sum();
    let duration = match (moving.first(), moving.last()) {
        (Some(first), Some(last)) => last.time_s - first.time_s,
        _ => f64::NAN,
    };
    [energy, duration]
}

pub(super) fn three_words() -> String {
    format!(
        "{}, a node of 2 kg at 0.2 m/s, tensions of 1 to 150 N; moves between (3.3, 1.6, 2.45), (6.6, 1.9, 2.35) and \
         (4.9, 4.6, 2.30) m, a roughly equilateral triangle in the upper region. Flown in closed loop against the plant with \
         geared motors and ramps of speed, at least 0.1 m above the ground.",
        stand_in::THREE
    )
}
