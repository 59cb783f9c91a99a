//! Figure 11: the current of a winch over speed and tension.

use crate::section::{Check, Effort, Section, fixed, mean, rms};
use crate::stand_in;
use anyhow::{Context, Result};
use cable_robot::energy::{Current, CurrentTable};
use cable_robot::motor::Motor;
use cable_robot::{Matrix3, Vector3};
use plant::{Plant, PlantConfig};
use plot::{Axis, Chart, Legend, Picture, Series, SeriesStyle};

/// Returns the current of a winch of the plant that raises (or, below zero, lowers) a load at constant speed, A: the
/// mean after the transient, as measured in the paper.
fn winch_current(tension_n: f64, reel_in_m_s: f64) -> Result<f64> {
    const RUN_S: f64 = 1.6;
    const TRANSIENT_S: f64 = 0.8;
    let travel_m = reel_in_m_s * RUN_S;
    let mut config = PlantConfig::new(vec![[0.0, 0.0, 5.0]], [0.0, 0.0, 2.0 - 0.5 * travel_m]);
    config.node.mass_kg = tension_n / stand_in::GRAVITY;
    config.gravity_m_s2 = stand_in::GRAVITY;
    config.node.drag_n_s2_m2 = 0.0;
    config.start_limits_n = [0.0, 1000.0];
    let mut plant = Plant::new(config)?;
    let mut currents = Vec::new();
    while plant.time_ns() < (RUN_S * 1e9) as u64 {
        // The input is the velocity of unstretched cable; positive pays out.
        let input = plant.speed_input(0, -reel_in_m_s);
        plant.step(0.01, &[input])?;
        if plant.time_ns() > (TRANSIENT_S * 1e9) as u64 {
            currents.push(plant.measured_current_a(0));
        }
    }
    Ok(mean(&currents))
}

/// Returns the share of the variance of y that the best quadratic of x leaves unexplained, and its curvature.
fn quadratic(points: &[[f64; 2]]) -> Option<[f64; 2]> {
    let basis = |x: f64| Vector3::new(x * x, x, 1.0);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for [x, y] in points {
        normal += basis(*x) * basis(*x).transpose();
        right += basis(*x) * *y;
    }
    let fit = normal.try_inverse()? * right;
    let middle = mean(&points.iter().map(|p| p[1]).collect::<Vec<_>>());
    let left: f64 = points.iter().map(|[x, y]| (y - fit.dot(&basis(*x))).powi(2)).sum();
    let all: f64 = points.iter().map(|[_, y]| (y - middle).powi(2)).sum();
    Some([left / all, fit.x])
}

/// Figure 11: square of the current over speed and tension.
pub fn fig11(effort: Effort) -> Result<Section> {
    let speeds = effort.select(&[-0.3, -0.25, -0.2, -0.15, -0.1, -0.05, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3]);
    let tensions = effort.select(&[5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0]);
    let rows: Vec<Vec<f64>> = speeds
        .iter()
        .map(|v| tensions.iter().map(|t| winch_current(*t, *v)).collect::<Result<Vec<_>>>())
        .collect::<Result<_>>()?;
    let motor = stand_in::geared();
    let table = CurrentTable::new(speeds.clone(), tensions.clone(), &rows, motor.resistance_ohm)?;
    // Raising at the greatest speed of the table.
    let fastest = speeds[speeds.len() - 1];
    let up: Vec<[f64; 2]> = tensions
        .iter()
        .map(|t| Ok([*t, table.current_a(*t, fastest)?.powi(2)]))
        .collect::<Result<_, cable_robot::energy::TableError>>()?;
    let [unexplained, curvature] = quadratic(&up).context("three tensions or more are needed")?;
    let (mut raising, mut lowering, mut off) = (Vec::new(), Vec::new(), Vec::new());
    for (speed, row) in speeds.iter().zip(&rows) {
        for (tension, current) in tensions.iter().zip(row) {
            let loss = current * current;
            if *speed > 0.0 {
                raising.push(loss)
            } else {
                lowering.push(loss)
            };
            off.push(current - motor.current_a(*tension, *speed));
        }
    }
    let share = mean(&lowering) / mean(&raising);
    let top = rows.iter().flatten().fold(0.0, |m: f64, i| m.max(i * i));
    let map = loss_map(&table, &speeds, &tensions, top)?;
    let lines = loss_lines(&speeds, &tensions, &rows);
    Ok(Section {
        key: "fig11",
        title: "Figure 11: square of the motor current over speed and tension",
        claim: "Raising a load takes a power that grows quadratically with tension; lowering it takes almost none."
            .into(),
        stand_in: format!(
            "{} loads raised and lowered at {} speeds by a winch of the plant (40 N/A, 1.2 ohm, gear friction 0.85, Coulomb \
             friction 3 N, viscous friction 20 N s/m); mean of the drive's own measurement after the transient.",
            tensions.len(),
            speeds.len()
        ),
        pictures: vec![Picture { title: String::new(), size: (1040, 440), columns: 2, charts: vec![map, lines] }],
        checks: vec![
            Check::claim(
                curvature > 0.0 && unexplained < 0.01,
                format!(
                    "a quadratic of tension leaves {:.2} % of the variance of I² unexplained when raising at {fastest} m/s",
                    100.0 * unexplained
                ),
            ),
            Check::claim(
                share < 0.05,
                format!("lowering costs {:.1} % of what raising costs, over the whole table", 100.0 * share),
            ),
            other_gears(&motor, &speeds, &tensions),
        ],
        remarks: vec![
            "This figure is circular: the winch of the plant integrates the formula of the robot file, with its gear \
             friction of 0.85. Only the measurement and the interpolation of the table are tested."
                .to_owned(),
            format!(
                "The table built from these runs agrees with that formula to {:.0} mA (root mean square).",
                1e3 * rms(&off)
            ),
        ],
        ..Section::default()
    })
}

/// Checks whether lowering costs almost nothing with other gears, by the formula alone.
fn other_gears(motor: &Motor, speeds: &[f64], tensions: &[f64]) -> Check {
    let share = |gear_friction: f64| {
        let motor = Motor { gear_friction, ..*motor };
        let loss = |raising: bool| {
            let picked = speeds.iter().filter(|speed| (**speed > 0.0) == raising);
            let currents = picked.flat_map(|v| tensions.iter().map(|t| motor.current_a(*t, *v)));
            mean(&currents.map(|current| current * current).collect::<Vec<_>>())
        };
        loss(false) / loss(true)
    };
    let shares: Vec<(f64, f64)> = [0.0, 0.3, 0.6, 0.95].into_iter().map(|gear| (gear, share(gear))).collect();
    let list: Vec<String> = shares.iter().map(|(gear, share)| format!("{:.0} % at {gear:.2}", 100.0 * share)).collect();
    Check::condition(
        shares.iter().all(|(_, share)| *share < 0.05),
        format!("the same holds for other gear frictions: lowering costs {}", list.join(", ")),
    )
}

/// Returns the square of the current over speed and tension as a map, A².
fn loss_map(table: &CurrentTable, speeds: &[f64], tensions: &[f64], top: f64) -> Result<Chart> {
    let fastest = speeds[speeds.len() - 1];
    let mut cells = Vec::new();
    let mut values = Vec::new();
    let (cell_v, cell_t) = (0.01, 1.0);
    let steps = |from: f64, to: f64, step: f64| {
        let count = ((to - from) / step).round() as usize;
        (0..count).map(move |i| from + (i as f64 + 0.5) * step)
    };
    for v in steps(speeds[0], fastest, cell_v) {
        for t in steps(tensions[0], tensions[tensions.len() - 1], cell_t) {
            cells.push([v, t]);
            values.push(table.current_a(t, v)?.powi(2) / top);
        }
    }
    Ok(Chart {
        caption: format!("I², from 0 (dark) to {} A² (bright)", fixed(top, 1)),
        x: Axis::fixed("reel-in speed, m/s", speeds[0], fastest),
        y: Axis::fixed("tension, N", tensions[0], tensions[tensions.len() - 1]),
        series: vec![Series {
            name: String::new(),
            colour: 0,
            style: SeriesStyle::Cells([cell_v, cell_t], values),
            points: cells,
        }],
        ..Chart::default()
    })
}

/// Returns the square of the current over tension at some speeds, A².
fn loss_lines(speeds: &[f64], tensions: &[f64], rows: &[Vec<f64>]) -> Chart {
    let fastest = speeds[speeds.len() - 1];
    let curve = |speed: f64| -> Vec<[f64; 2]> {
        speeds
            .iter()
            .position(|v| (v - speed).abs() < 1e-9)
            .map_or(Vec::new(), |k| tensions.iter().zip(&rows[k]).map(|(t, i)| [*t, i * i]).collect())
    };
    Chart {
        caption: "I² over tension".into(),
        x: Axis::auto("tension, N"),
        y: Axis::auto("A²"),
        series: [
            (fastest, 1, "raising at 0.3 m/s"),
            (0.1, 3, "raising at 0.1 m/s"),
            (speeds[0], 0, "lowering at 0.3 m/s"),
        ]
        .into_iter()
        .map(|(speed, colour, name)| Series::line(name, colour, curve(speed)).with_style(SeriesStyle::Marked))
        .filter(|series| !series.points.is_empty())
        .collect(),
        legend: Legend::UpperLeft,
        ..Chart::default()
    }
}
