//! Improvement: compensation of cable stretch.

use super::super::flight::{ClosedLoopFlight, DRIVES, Track};
use super::super::section::{Check, Effort, Section, Table, fixed, mean};
use super::super::{control, stand_in};
use anyhow::Result;
use plot::{Axis, Chart, Legend, Picture, Series, SeriesStyle};

/// Returns the deflection of the node after a climb with cables stiffer by this factor than in the robot file, mm
/// (positive: too low), and the track.
fn deflection(stretch: bool, stiffness_share: f64, height_m: f64) -> Result<(f64, Track)> {
    let mission = format!(
        "name = \"climb\"\nspeed_m_s = 0.2\n[[leg]]\nline = {{ to_m = [4.8, 3.0, {height_m}] }}\n[[leg]]\ndwell = {{ duration_s = 1.0 }}\n"
    );
    let track = ClosedLoopFlight {
        period_s: 0.02,
        horizon: 10,
        stretch,
        stiffness_share,
        ..ClosedLoopFlight::new(control::START_M, mission, DRIVES[0])
    }
    .fly()?;
    anyhow::ensure!(track.done, "the climb to {height_m} m was not completed");
    let last: Vec<f64> = track.instants.iter().rev().take(25).map(|at| at.setpoint.z - at.truth.z).collect();
    Ok((1e3 * mean(&last), track))
}

/// True stiffness divided by that of a robot file which is 20 % too high.
const SHARE: f64 = 1.0 / 1.2;

/// Stretch compensation.
pub fn stretch(effort: Effort) -> Result<Section> {
    let heights: &[f64] = match effort {
        Effort::Full => &[0.8, 1.3, 1.8, 2.2, 2.4],
        Effort::Quick => &[0.6, 0.9],
    };
    let mut table = Table::new(
        "Deflection of the node after a climb from 0.3 m, mm",
        &[
            "height, m",
            "rigid cables assumed",
            "compensated",
            "compensated, assumed stiffness 20 % too high",
            "share removed then",
        ],
    );
    let mut curves = [const { Vec::<[f64; 2]>::new() }; 3];
    let mut shares = Vec::new();
    let (mut left_mm, mut all_mm) = (0.0, 0.0);
    let mut exact: f64 = 0.0;
    for height in heights {
        let [rigid, right, wrong] =
            [(false, 1.0), (true, 1.0), (true, SHARE)].map(|(stretch, share)| deflection(stretch, share, *height));
        // Softer cables also increase the uncompensated deflection, which is the reference here.
        let softer = deflection(false, SHARE, *height)?.0;
        let (rigid, right, wrong) = (rigid?.0, right?.0, wrong?.0);
        for (curve, value) in curves.iter_mut().zip([rigid, right, wrong]) {
            curve.push([*height, value]);
        }
        left_mm += wrong.abs();
        all_mm += softer.abs();
        shares.push(1.0 - wrong.abs() / softer.abs());
        exact = exact.max(right.abs() / rigid.abs());
        table.row([
            fixed(*height, 1),
            fixed(rigid, 1),
            fixed(right, 1),
            fixed(wrong, 1),
            format!("{:.0} %", 100.0 * shares[shares.len() - 1]),
        ]);
    }
    let (low, high) = (curves[0][0][1], curves[0][curves[0].len() - 1][1]);
    let removed = 1.0 - left_mm / all_mm;
    let least = shares.iter().fold(f64::INFINITY, |m: f64, s| m.min(*s));
    Ok(Section {
        key: "stretch",
        title: "Improvement: compensation of cable stretch",
        claim: "The paper found no deflection near the floor and neglects stretch. Higher up, cables carry several times the tension; \
                commanding unstretched lengths removes most of the deflection, even with an approximate stiffness."
            .into(),
        stand_in: format!(
            "Closed-loop flights: {}, a node of 2 kg, cables with EA = 6 kN and 6 m between drum and pulley; position set \
             at a height of 0.3 m, then a climb.",
            stand_in::THREE
        ),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (760, 400), columns: 1, charts: vec![chart(curves)] }],
        checks: checks(heights, [low, high], exact, removed, least),
        ratio: Some(format!("{:.0} % of the deflection removed with an assumed stiffness 20 % too high", 100.0 * removed)),
        ..Section::default()
    })
}

fn chart(curves: [Vec<[f64; 2]>; 3]) -> Chart {
    let names = ["rigid cables assumed", "compensated", "compensated, assumed 20 % too stiff"];
    Chart {
        caption: "deflection of the node".into(),
        x: Axis::auto("height after the climb, m"),
        y: Axis::auto("mm too low"),
        series: curves
            .into_iter()
            .zip(names)
            .zip([1, 0, 3])
            .map(|((points, name), colour)| Series::line(name, colour, points).with_style(SeriesStyle::Marked))
            .collect(),
        legend: Legend::UpperLeft,
        ..Chart::default()
    }
}

/// Checks the deflection at the lowest and the highest position, mm, the greatest remaining share with the correct
/// stiffness, and the total and the least share removed with the wrong one.
fn checks(heights: &[f64], [low, high]: [f64; 2], exact: f64, removed: f64, least: f64) -> Vec<Check> {
    vec![
        Check::claim(
            high > 3.0 * low,
            format!(
                "without compensation the node hangs {low:.0} mm too low at {} m and {high:.0} mm at {} m",
                heights[0],
                heights[heights.len() - 1]
            ),
        ),
        Check::claim(
            exact < 0.2,
            format!("with the correct stiffness, at most {:.0} % of the deflection remains", 100.0 * exact),
        ),
        Check::claim(
            removed > 0.8,
            format!(
                "with an assumed stiffness 20 % too high, {:.0} % of the total deflection is removed, and at least {:.0} %",
                100.0 * removed,
                100.0 * least
            ),
        ),
    ]
}
