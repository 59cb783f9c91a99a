//! Improvement: paths that deviate sideways as well as down, computed and flown.

use super::super::energy::flown_cost;
use super::super::flight::{ClosedLoopFlight, DRIVES, Track};
use super::super::section::{Check, Effort, Section, Table, fixed, mean};
use super::super::stand_in;
use anyhow::Result;
use cable_robot::energy::{BestLateral, Bounds, WinchEnergy};
use cable_robot::{Distribution, Vector3};

/// Intervals of Simpson's rule, with an error of 3e-6.
const INTERVALS: usize = 64;

/// Losses of the flown paths of one move, each from rest to rest.
struct FlownMove {
    /// Loss of the line divided by that of the parabola.
    line: f64,
    /// Loss of the lateral path divided by that of the parabola.
    lateral: f64,
    expected: f64,
    complete: bool,
}

fn fly(ends: (Vector3<f64>, Vector3<f64>), path: &str) -> Result<Track> {
    let [x, y, z]: [f64; 3] = ends.1.into();
    let mission = format!(
        "name = \"move\"\nspeed_m_s = {}\npath = \"{path}\"\n[[leg]]\nline = {{ to_m = [{x}, {y}, {z}] }}\n",
        stand_in::SPEED_M_S
    );
    ClosedLoopFlight { period_s: 0.02, horizon: 10, ..ClosedLoopFlight::new(ends.0.into(), mission, DRIVES[0]) }.fly()
}

fn flown(ends: (Vector3<f64>, Vector3<f64>), expected: f64) -> Result<FlownMove> {
    let tracks = ["line", "parabola", "lateral"].map(|path| fly(ends, path));
    let [line, parabola, lateral] = tracks;
    let (line, parabola, lateral) = (line?, parabola?, lateral?);
    let loss = |track: &Track| flown_cost(track, stand_in::geared().resistance_ohm)[0];
    Ok(FlownMove {
        line: loss(&line) / loss(&parabola),
        lateral: loss(&lateral) / loss(&parabola),
        expected,
        complete: [&line, &parabola, &lateral].iter().all(|track| track.done && track.unsteered == 0),
    })
}

/// Computed savings by motor (ideal, geared) as shares of the parabola's loss, and the flown moves.
struct Savings {
    table: Table,
    /// Savings with lateral deviation.
    saved: [Vec<f64>; 2],
    /// Savings in the vertical plane.
    vertical: [Vec<f64>; 2],
    moves: Vec<FlownMove>,
}

fn savings(effort: Effort) -> Result<Savings> {
    let bounds = Bounds { ground_m: Some(0.0), time_weight_w: 0.0 };
    let mut table = Table::new(
        "Best path of three harmonics down and three sideways, compared with the best parabola",
        &[
            "anchors",
            "motors",
            "move",
            "parabola, J",
            "saved in the vertical plane",
            "saved with lateral deviation",
            "deviation, m",
            "time ratio",
        ],
    );
    let mut saved = [Vec::new(), Vec::new()];
    let mut vertical = [Vec::new(), Vec::new()];
    let mut moves = Vec::new();
    let three = stand_in::three_cable_anchors();
    let rigs = [
        ("three", &three[..], &stand_in::TRIANGLE_PATH[..], Distribution::Unique),
        ("four", &stand_in::UNEVEN[..], &stand_in::SQUARE_PATH[..], Distribution::LeastNorm),
    ];
    for (place, anchors, corners, method) in &rigs {
        let anchors = cable_robot::Anchors::new(anchors)?;
        for (which, (name, motor)) in
            [("ideal", stand_in::ideal()), ("geared", stand_in::geared())].into_iter().enumerate()
        {
            let winch_energy = WinchEnergy {
                anchors: &anchors,
                wrench_n: stand_in::weight(),
                drag_n_s2_m2: 0.0,
                cable_weight_n_m: 0.0,
                limits_n: stand_in::LIMITS_N,
                method: *method,
                current: &motor,
            };
            for k in effort.select(&(0..corners.len()).collect::<Vec<_>>()) {
                let ends = (Vector3::from(corners[k]), Vector3::from(corners[(k + 1) % corners.len()]));
                let BestLateral { lateral, parabola, upright } =
                    winch_energy.best_lateral(&ends.0, &ends.1, stand_in::SPEED_M_S, INTERVALS, &bounds)?;
                let parabola = parabola.cost;
                let (swing, cost) = lateral.map_or((0.0, upright), |(bow, cost)| (bow.side_m[0], cost));
                let share = |of: f64| 1.0 - of / parabola.energy_j;
                vertical[which].push(share(upright.energy_j));
                saved[which].push(share(cost.energy_j));
                table.row([
                    (*place).into(),
                    name.into(),
                    (k + 1).to_string(),
                    fixed(parabola.energy_j, 2),
                    format!("{:.1} %", 100.0 * share(upright.energy_j)),
                    format!("{:.1} %", 100.0 * share(cost.energy_j)),
                    fixed(swing, 2),
                    fixed(cost.duration_s / parabola.duration_s, 2),
                ]);
                if (*place, name) == ("three", "geared") {
                    moves.push(flown(ends, cost.energy_j / parabola.energy_j)?);
                }
            }
        }
    }
    Ok(Savings { table, saved, vertical, moves })
}

/// Returns the range of shares as percentages.
fn percent(values: &[f64]) -> String {
    let low = values.iter().fold(f64::INFINITY, |m: f64, v| m.min(*v));
    let high = values.iter().fold(f64::NEG_INFINITY, |m: f64, v| m.max(*v));
    format!("{:.0} to {:.0} %", 100.0 * low, 100.0 * high)
}

/// Paths that deviate sideways too.
pub fn lateral(effort: Effort) -> Result<Section> {
    let savings = savings(effort)?;
    let mut flights = Table::new(
        "Flown with three cables and geared motors: loss over that of the flown parabola",
        &["move", "line", "lateral path", "lateral path, computed"],
    );
    for (k, flown) in savings.moves.iter().enumerate() {
        flights.row([(k + 1).to_string(), fixed(flown.line, 2), fixed(flown.lateral, 3), fixed(flown.expected, 3)]);
    }
    Ok(Section {
        key: "lateral",
        title: "Improvement: paths that deviate sideways",
        claim: "The paper found richer paths than parabolas in a vertical plane to yield negligible improvements. With self-locking \
                gears, lowering takes almost no energy but raising much, and a path that also deviates sideways saves more."
            .into(),
        stand_in: format!(
            "{}, the triangle; {} (uneven), the square. Computed, quasi-static. Flown by the planner with `path = \"lateral\"` in \
             closed loop against the plant, from rest to rest.",
            stand_in::THREE,
            stand_in::FOUR
        ),
        tables: vec![savings.table.clone(), flights],
        checks: checks(&savings),
        ratio: Some(format!("{} less loss with geared motors", percent(&savings.saved[1]))),
        ..Section::default()
    })
}

fn checks(Savings { saved: [ideal, geared], vertical, moves, .. }: &Savings) -> Vec<Check> {
    let flown_saving: Vec<f64> = moves.iter().map(|flown| 1.0 - flown.lateral).collect();
    vec![
        Check::claim(
            mean(geared) > 0.1,
            format!(
                "with geared motors such a path saves {} of the best parabola's loss, {:.0} % on average ({} without leaving the \
                 vertical plane)",
                percent(geared),
                100.0 * mean(geared),
                percent(&vertical[1])
            ),
        ),
        Check::claim(
            mean(ideal) < 0.03,
            format!(
                "with ideal motors the improvement is negligible, as in the paper: {}, {:.0} % on average",
                percent(ideal),
                100.0 * mean(ideal)
            ),
        ),
        Check::claim(
            moves.iter().all(|flown| flown.complete && flown.lateral < 1.0),
            format!("flown, they save {} of the flown parabola's loss", percent(&flown_saving)),
        ),
        Check::condition(
            geared.iter().all(|share| *share > 0.1),
            "with geared motors it saves more than 10 % on every move".into(),
        ),
    ]
}
