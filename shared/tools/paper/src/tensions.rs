//! Figures 14 to 16: distribution of the weight among four cables along a parabola.

use super::section::{Check, Effort, Section, Table, fixed, mean};
use super::stand_in;
use anyhow::Result;
use cable_robot::energy::parabola::at_fraction;
use cable_robot::path::Parabola;
use cable_robot::tension::FourCables;
use cable_robot::{Anchors, CableVec, StructureMatrix, Vector3};
use plot::{Axis, BLACK, Chart, GREY, Legend, Picture, Series, SeriesStyle};

/// µ of the parabola of Figures 14 to 16, 1/m: a sag of 0.6 m on 5 m.
const MU_PER_M: f64 = 0.1;

// The number of steps is odd, so that no point lies in the middle, where the symmetric configuration has a tie.

/// Both distributions along the parabola from the first to the second corner.
struct TensionProfiles {
    /// Fraction of the way, 0 to 1.
    at: Vec<f64>,
    least_norm: Vec<CableVec>,
    min_sum: Vec<CableVec>,
    /// c of (37).
    c: Vec<f64>,
    /// Feasible interval of the last cable's tension, N.
    interval_n: Vec<[f64; 2]>,
}

impl TensionProfiles {
    fn new(anchors: &[[f64; 3]], steps: usize) -> Result<Self> {
        let anchors: Anchors = stand_in::anchors(anchors)?;
        let [from, to] = [0, 1].map(|k| Vector3::from(stand_in::SQUARE_PATH[k]));
        let path = Parabola { from, to, mu_per_m: MU_PER_M };
        let mut along =
            Self { at: Vec::new(), least_norm: Vec::new(), min_sum: Vec::new(), c: Vec::new(), interval_n: Vec::new() };
        for i in 0..=steps {
            let at = i as f64 / steps as f64;
            let structure = StructureMatrix::at(&anchors, &at_fraction(&path, at).position)?;
            let line = FourCables::new(&structure, &stand_in::weight(), stand_in::LIMITS_N)?;
            along.at.push(at);
            along.least_norm.push(line.least_norm());
            along.min_sum.push(line.min_sum());
            along.c.push(line.c());
            along.interval_n.push(line.interval_of_last_n());
        }
        Ok(along)
    }

    fn curve(&self, of: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
        (0..self.at.len()).map(|i| [self.at[i], of(i)]).collect()
    }

    /// Returns position, cable and size of the largest change of a tension between adjacent points, N.
    fn largest_step(tensions: &[CableVec]) -> (usize, usize, f64) {
        let mut largest = (0, 0, 0.0);
        for (i, pair) in tensions.windows(2).enumerate() {
            for (cable, (after, before)) in pair[1].iter().zip(pair[0].iter()).enumerate() {
                let step = (after - before).abs();
                if step > largest.2 {
                    largest = (i, cable, step);
                }
            }
        }
        largest
    }
}

fn stand_in_words() -> String {
    format!("{}; the parabola from (2.5, 2.5, 4) to (7.5, 2.5, 4) m with mu = 0.1 per metre.", stand_in::FOUR)
}

fn tension_axis() -> Axis {
    Axis::auto("tension, N")
}

/// Splits a curve at a jump, so that no line is drawn through it.
fn split_at_jump(mut points: Vec<[f64; 2]>, jump: Option<usize>) -> Vec<[f64; 2]> {
    if let Some(i) = jump {
        points.insert(i + 1, [f64::NAN, f64::NAN]);
    }
    points
}

/// Returns charts of the sums and of the single tensions; `jump` is the point before the jump of the least sum, if any.
fn tension_charts(along: &TensionProfiles, jump: Option<usize>) -> Vec<Chart> {
    let sums = Chart {
        caption: "sum of tensions".into(),
        x: Axis::fixed("fraction of the way", 0.0, 1.0),
        y: tension_axis(),
        series: vec![
            Series::line("least norm", 0, along.curve(|i| along.least_norm[i].sum())),
            Series::line("least sum (LP)", 1, along.curve(|i| along.min_sum[i].sum())).with_style(SeriesStyle::Dashed),
        ],
        ..Chart::default()
    };
    let mut series = Vec::new();
    for cable in 0..4 {
        let lines = split_at_jump(along.curve(|i| along.min_sum[i][cable]), jump);
        series.push(Series::line(&format!("cable {}, least sum", cable + 1), cable, lines));
    }
    for cable in 0..4 {
        series
            .push(Series::line("", cable, along.curve(|i| along.least_norm[i][cable])).with_style(SeriesStyle::Dashed));
    }
    let single = Chart {
        caption: "single cables: least sum (solid), least norm (dashed)".into(),
        x: Axis::fixed("fraction of the way", 0.0, 1.0),
        y: Axis::fixed("tension, N", 0.0, 40.0),
        series,
        legend: Legend::UpperRight,
        ..Chart::default()
    };
    vec![sums, single]
}

/// Figure 14: sums and single tensions.
pub fn fig14(effort: Effort) -> Result<Section> {
    let along = TensionProfiles::new(&stand_in::SQUARE, effort.trials(2000) + 1)?;
    let (at, cable, step_n) = TensionProfiles::largest_step(&along.min_sum);
    let jumps = step_n > 1.0;
    let jump = jumps.then_some(at);
    let smooth_n = TensionProfiles::largest_step(&along.least_norm).2;
    let ratios: Vec<f64> = along.least_norm.iter().zip(&along.min_sum).map(|(ln, lp)| ln.sum() / lp.sum()).collect();
    let (ratio, worst) = (mean(&ratios), ratios.iter().fold(0.0, |m: f64, r| m.max(*r)));
    let (ln, lp) = (tension_range(&along.least_norm), tension_range(&along.min_sum));
    let at_bound = share_at_lower_limit(&along.min_sum);
    let uneven = TensionProfiles::new(&stand_in::UNEVEN, effort.trials(2000) + 1)?;
    let (uneven_at, _, uneven_n) = TensionProfiles::largest_step(&uneven.min_sum);
    Ok(Section {
        key: "fig14",
        title: "Figure 14: sum of tensions and single tensions along a parabola",
        claim:
            "The sum of least-norm tensions is very close to the least possible sum. Least-sum tensions jump halfway \
                and are either very low or very high; least-norm tensions lie between."
                .into(),
        stand_in: stand_in_words(),
        tables: vec![fig14_table([ln, lp], [smooth_n, step_n])],
        pictures: vec![Picture {
            title: String::new(),
            size: (1040, 440),
            columns: 2,
            charts: tension_charts(&along, jump),
        }],
        checks: vec![
            Check::claim(
                ratio < 1.05,
                format!(
                    "the least-norm sum is {:.1} % above the least sum on average, {:.1} % at most",
                    100.0 * (ratio - 1.0),
                    100.0 * (worst - 1.0)
                ),
            ),
            Check::claim(
                jumps,
                format!("with least sum, cable {} jumps by {step_n:.1} N at u = {:.3}", cable + 1, along.at[at]),
            ),
            Check::claim(
                (along.at[at] - 0.5).abs() < 0.01,
                "the jump is halfway, because the four anchors are symmetric about the middle of the path".into(),
            ),
            Check::claim(
                smooth_n * 20.0 < step_n,
                format!("least norm changes by at most {smooth_n:.3} N between adjacent points"),
            ),
            Check::claim(
                lp[0] < ln[0] && lp[1] >= ln[1],
                format!(
                    "least sum spans {:.1} to {:.1} N and has a cable at its lower limit on {:.0} % of the way; least norm \
                     spans {:.1} to {:.1} N",
                    lp[0],
                    lp[1],
                    100.0 * at_bound,
                    ln[0],
                    ln[1]
                ),
            ),
        ],
        remarks: vec![format!(
            "Under four uneven anchors the largest step is {uneven_n:.1} N at u = {:.2}: \u{201c}halfway\u{201d} is a property of \
             symmetric anchors, the jump is not.",
            uneven.at[uneven_at]
        )],
        ratio: None,
    })
}

/// Returns the least and the greatest tension, N.
fn tension_range(tensions: &[CableVec]) -> [f64; 2] {
    let low = tensions.iter().flat_map(|t| t.iter()).fold(f64::INFINITY, |m: f64, t| m.min(*t));
    let high = tensions.iter().flat_map(|t| t.iter()).fold(0.0, |m: f64, t| m.max(*t));
    [low, high]
}

/// Returns the share of the points with a cable at its lower limit.
fn share_at_lower_limit(tensions: &[CableVec]) -> f64 {
    let count = tensions.iter().filter(|t| t.iter().any(|v| *v < stand_in::LIMITS_N[0] + 1e-6)).count();
    count as f64 / tensions.len() as f64
}

/// Returns a table of the ranges and the largest steps with least norm and least sum.
fn fig14_table([ln, lp]: [[f64; 2]; 2], [smooth_n, step_n]: [f64; 2]) -> Table {
    let mut table = Table::new("Along the parabola", &["", "least norm", "least sum"]);
    table.row(["lowest tension, N".into(), fixed(ln[0], 2), fixed(lp[0], 2)]);
    table.row(["highest tension, N".into(), fixed(ln[1], 2), fixed(lp[1], 2)]);
    table.row(["largest step between adjacent points, N".into(), fixed(smooth_n, 3), fixed(step_n, 2)]);
    table
}

/// Figure 15: sums of squares.
pub fn fig15(effort: Effort) -> Result<Section> {
    let along = TensionProfiles::new(&stand_in::SQUARE, effort.trials(2000) + 1)?;
    let ratios: Vec<f64> =
        along.least_norm.iter().zip(&along.min_sum).map(|(ln, lp)| ln.norm_squared() / lp.norm_squared()).collect();
    let (ratio, best) = (mean(&ratios), ratios.iter().fold(f64::INFINITY, |m: f64, r| m.min(*r)));
    let never_more = ratios.iter().all(|r| *r <= 1.0 + 1e-12);
    let chart = Chart {
        caption: "sum of squares of tensions".into(),
        x: Axis::fixed("fraction of the way", 0.0, 1.0),
        y: Axis::fixed("N²", 0.0, 1800.0),
        series: vec![
            Series::line("least sum (LP)", 1, along.curve(|i| along.min_sum[i].norm_squared())),
            Series::line("least norm", 0, along.curve(|i| along.least_norm[i].norm_squared())),
        ],
        ..Chart::default()
    };
    let mut table = Table::new("Sum of squares, least norm over least sum", &["mean", "least", "most"]);
    let most = ratios.iter().fold(0.0, |m: f64, r| m.max(*r));
    table.row([fixed(ratio, 3), fixed(best, 3), fixed(most, 3)]);
    Ok(Section {
        key: "fig15",
        title: "Figure 15: sum of squares of tensions along a parabola",
        claim: "The sum of squares, which the I²R loss follows, is significantly smaller with least-norm tensions."
            .into(),
        stand_in: stand_in_words(),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (760, 420), columns: 1, charts: vec![chart] }],
        checks: vec![
            Check::claim(never_more, "least norm never has the larger sum of squares".into()),
            Check::claim(
                ratio < 0.9,
                format!("it saves {:.0} % on average and up to {:.0} %", 100.0 * (1.0 - ratio), 100.0 * (1.0 - best)),
            ),
        ],
        ..Section::default()
    })
}

/// Figure 16: origin of the least-sum jump.
pub fn fig16(effort: Effort) -> Result<Section> {
    let along = TensionProfiles::new(&stand_in::SQUARE, effort.trials(2000) + 1)?;
    let (at, ..) = TensionProfiles::largest_step(&along.min_sum);
    let last = |tensions: &[CableVec], i: usize| tensions[i][3];
    let width = |i: usize| along.interval_n[i][1] - along.interval_n[i][0];
    let place = |tensions: &[CableVec], i: usize| (last(tensions, i) - along.interval_n[i][0]) / width(i);
    let jump = Some(at);
    let operating = Chart {
        caption: "tension of cable 4 in its feasible interval".into(),
        x: Axis::fixed("fraction of the way", 0.0, 1.0),
        y: Axis::fixed("tension, N", 0.0, 36.0),
        series: vec![
            Series::line("feasible from", GREY, along.curve(|i| along.interval_n[i][0])),
            Series::line("feasible to", BLACK, along.curve(|i| along.interval_n[i][1])),
            Series::line("least sum (LP)", 1, split_at_jump(along.curve(|i| last(&along.min_sum, i)), jump))
                .with_style(SeriesStyle::Dashed),
            Series::line("least norm", 0, along.curve(|i| last(&along.least_norm, i))),
        ],
        ..Chart::default()
    };
    let slope = Chart {
        caption: "c of (37): derivative of the sum by this tension".into(),
        x: Axis::fixed("fraction of the way", 0.0, 1.0),
        y: Axis::auto("c"),
        series: vec![Series::line("", 2, along.curve(|i| along.c[i]))],
        ..Chart::default()
    };
    // Evaluated next to the crossing: at the crossing c is zero and all points of the interval have the same sum.
    let (before, after) = (at.saturating_sub(1), (at + 2).min(along.at.len() - 1));
    let changes_sign = along.c[before] * along.c[after] < 0.0;
    let from_end_to_end = (place(&along.min_sum, before) - place(&along.min_sum, after)).abs();
    let calm = (place(&along.least_norm, before) - place(&along.least_norm, after)).abs();
    Ok(Section {
        key: "fig16",
        title: "Figure 16: how least-sum tensions become discontinuous",
        claim: "Where c of (37) changes its sign, the least sum moves from one end of the feasible interval to the other, while \
                the least norm moves by an infinitesimal amount."
            .into(),
        stand_in: stand_in_words(),
        pictures: vec![Picture { title: String::new(), size: (1040, 440), columns: 2, charts: vec![operating, slope] }],
        checks: vec![
            Check::claim(
                changes_sign,
                format!("c goes from {:+.4} to {:+.4} where least sum jumps", along.c[before], along.c[after]),
            ),
            Check::claim(
                from_end_to_end > 0.99,
                format!("least sum moves over {:.0} % of the feasible interval there", 100.0 * from_end_to_end),
            ),
            Check::claim(calm < 0.02, format!("least norm moves over {:.2} % of it", 100.0 * calm)),
        ],
        remarks: vec![
            "Where c is exactly zero, all feasible points have the same sum; the library then returns the one of least norm."
                .into(),
        ],
        ..Section::default()
    })
}
