//! Tables V and VIII: savings by parabolas and by least-norm tensions.

use super::comparison::{MoveComparison, flown_cost, three_words};
use super::setup::{WinchSetup, moves};
use crate::section::{Check, Effort, Section, Table, fixed, mean};
use crate::stand_in;
use anyhow::Result;
use cable_robot::energy::Cost;
use cable_robot::{Distribution, Vector3};
use plot::{Axis, Chart, Picture, Series, SeriesStyle};

/// Returns the height of a move and the loss of its optimal parabola as a share of the line's, with ideal motors.
fn shares_by_height(effort: Effort) -> Result<Vec<[f64; 2]>> {
    let rig = WinchSetup::new(&stand_in::three_cable_anchors(), stand_in::ideal())?;
    let mut regions = Vec::new();
    for height in effort.select(&[2.7, 2.45, 2.2, 1.9, 1.6, 1.3, 1.0, 0.7, 0.4]) {
        let (a, b) = moves(&stand_in::TRIANGLE_PATH)[0];
        let lift = |p: Vector3<f64>| Vector3::new(p.x, p.y, height);
        let (line, best) = rig.line_and_best(Distribution::Unique, (lift(a), lift(b)))?;
        regions.push([height, best.cost.energy_j / line.energy_j]);
    }
    Ok(regions)
}

/// Table V: savings by parabolas with three cables.
pub fn table5(effort: Effort) -> Result<Section> {
    let mut table = Table::new(
        "Parabola relative to the straight line: E energy, TRatio time, rho mean power",
        &["motors", "move", "mu, 1/m", "E", "TRatio", "rho"],
    );
    let mut ordered = true;
    let mut largest: f64 = 0.0;
    for (name, motor) in [("ideal", stand_in::ideal()), ("geared", stand_in::geared())] {
        let rig = WinchSetup::new(&stand_in::three_cable_anchors(), motor)?;
        for (k, ends) in moves(&stand_in::TRIANGLE_PATH).into_iter().enumerate() {
            let (line, best) = rig.line_and_best(Distribution::Unique, ends)?;
            let [e, t] = [best.cost.energy_j / line.energy_j, best.cost.duration_s / line.duration_s];
            let rho = best.cost.mean_power_w() / line.mean_power_w();
            ordered &= rho < e && e < 1.0 && 1.0 < t;
            largest = largest.max(e);
            table.row([
                format!("{name}, computed"),
                (k + 1).to_string(),
                fixed(best.mu_per_m, 3),
                fixed(e, 3),
                fixed(t, 2),
                fixed(rho, 3),
            ]);
        }
    }
    let flown = MoveComparison::fly(effort)?;
    let mut apart: f64 = 0.0;
    for (k, ((line, best), tracks)) in flown.expected.iter().zip(&flown.flown).enumerate() {
        let [[e0, t0], [e1, t1]] = [0, 1].map(|i| flown_cost(&tracks[i], stand_in::geared().resistance_ohm));
        let (e, t) = (e1 / e0, t1 / t0);
        ordered &= e / t < e && e < 1.0 && 1.0 < t;
        apart = apart.max((e - best.cost.energy_j / line.energy_j).abs());
        table.row([
            "geared, flown".into(),
            (k + 1).to_string(),
            fixed(best.mu_per_m, 3),
            fixed(e, 3),
            fixed(t, 2),
            fixed(e / t, 3),
        ]);
    }
    let regions = shares_by_height(effort)?;
    let (top, bottom) = (regions[0][1], regions[regions.len() - 1][1]);
    Ok(Section {
        key: "table5",
        title: "Table V: energy of parabolic trajectories",
        claim: "Optimised parabolas cost less energy and more time, so that mean power falls more than energy; expected and \
                measured reductions are close; the gain is large near the anchors and small near the ground."
            .into(),
        stand_in: three_words(),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (760, 400), columns: 1, charts: vec![share_chart(regions)] }],
        checks: vec![
            Check::claim(
                ordered,
                format!("rho < E < 1 < TRatio for every move, computed and flown; the largest computed E is {largest:.2}"),
            ),
            Check::claim(apart < 0.12, format!("flown and computed E differ by {apart:.3} at most")),
            Check::claim(
                top < 0.5 && bottom > 0.8,
                format!("at a height of 2.7 m a parabola costs {top:.2} of the line, at 0.4 m {bottom:.2}"),
            ),
        ],
        ..Section::default()
    })
}

fn share_chart(regions: Vec<[f64; 2]>) -> Chart {
    Chart {
        caption: "energy of the optimal parabola over that of the line, ideal motors".into(),
        x: Axis::auto("height of the move, m (anchors at 3.2 m)"),
        y: Axis::fixed("E", 0.0, 1.0),
        series: vec![Series::line("", 0, regions).with_style(SeriesStyle::Marked)],
        ..Chart::default()
    }
}

/// Table VIII: least norm and parabolas with four cables.
pub fn table8(_: Effort) -> Result<Section> {
    let mut table = Table::new(
        "I²R loss relative to least-sum tensions on the straight line",
        &[
            "anchors",
            "motors",
            "side",
            "least sum, line, J",
            "least norm, line",
            "least sum, parabola",
            "least norm, parabola",
            "TRatio",
        ],
    );
    let mut ordered = true;
    let mut gains = [Vec::new(), Vec::new()];
    for (place, anchors) in [("square", stand_in::SQUARE), ("uneven", stand_in::UNEVEN)] {
        for (which, (name, motor)) in
            [("ideal", stand_in::ideal()), ("geared", stand_in::geared())].into_iter().enumerate()
        {
            let rig = WinchSetup::new(&anchors, motor)?;
            // The four sides of the square are equivalent by symmetry.
            let sides = if place == "square" { 1 } else { 4 };
            for (k, ends) in moves(&stand_in::SQUARE_PATH).into_iter().take(sides).enumerate() {
                let (sum_line, sum_best) = rig.line_and_best(Distribution::MinSum, ends)?;
                let (norm_line, norm_best) = rig.line_and_best(Distribution::LeastNorm, ends)?;
                let of = |cost: &Cost| cost.energy_j / sum_line.energy_j;
                let [a, b, c] = [of(&norm_line), of(&sum_best.cost), of(&norm_best.cost)];
                ordered &= c < a && c < b && a < 1.0 && b < 1.0;
                gains[which].push(c);
                table.row([
                    place.into(),
                    name.into(),
                    if sides == 1 { "each".into() } else { (k + 1).to_string() },
                    fixed(sum_line.energy_j, 2),
                    fixed(a, 3),
                    fixed(b, 3),
                    fixed(c, 3),
                    fixed(norm_best.cost.duration_s / norm_line.duration_s, 2),
                ]);
            }
        }
    }
    let [ideal, geared] = gains.map(|values| mean(&values));
    Ok(Section {
        key: "table8",
        title: "Table VIII: I²R loss with least-norm and least-sum tensions",
        claim: "Least-norm tensions and parabolas each reduce the loss, together most; friction in the motors makes the gain smaller \
                but leaves it significant."
            .into(),
        stand_in: format!(
            "{}; a square of 5 m at a height of 4 m. Uneven: asymmetric anchors, as in a wood.",
            stand_in::FOUR
        ),
        tables: vec![table],
        checks: vec![
            Check::claim(ordered, "on every side and for both motors, both together have the least loss, and each alone has less than neither".into()),
            Check::claim(
                ideal < geared && geared < 0.75,
                format!("both together leave {ideal:.2} of the loss with ideal and {geared:.2} with geared motors, on average"),
            ),
        ],
        ..Section::default()
    })
}
