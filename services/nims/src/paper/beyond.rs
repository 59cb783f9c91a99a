//! Where we know better than the paper, each measured against its method in the same run.

use super::calibration::{Encoders, SIGMA_RANGE_M, anywhere, calibrate, errors, survey};
use super::flight::{DRIVES, Flight, Track};
use super::random::Random;
use super::section::{Check, Effort, Section, Table, fixed, mean, rms};
use super::{control, stand_in};
use crate::picture::{Axis, Chart, Legend, Look, Picture, Series};
use anyhow::{Context, Result};
use cable_robot::calibration::placement::corners;
use cable_robot::calibration::{JointInput, Loss, Range, calibrate_joint};
use cable_robot::energy::{Bounds, Hoist};
use cable_robot::motor::Motor;
use cable_robot::tension::general;
use cable_robot::{CableVec, Distribution, Vector3};
use controller::Law;
use service::config::ControllerSection;

fn times(ratio: f64) -> String {
    format!("{ratio:.1}")
}

/// The least and the largest of some ratios, in words.
fn span(ratios: &[f64]) -> String {
    let low = ratios.iter().fold(f64::INFINITY, |m: f64, r| m.min(*r));
    let high = ratios.iter().fold(0.0, |m: f64, r| m.max(*r));
    if times(low) == times(high) {
        return format!("{} times", times(low));
    }
    format!("{} to {} times", times(low), times(high))
}

/// Points at the corners instead of anywhere.
pub fn placement(effort: Effort) -> Result<Section> {
    let trials = effort.trials(3000);
    let counts = effort.some(&[3, 6, 9, 18, 20]);
    let sigma = 0.02;
    let run = |seed: u64, places: &dyn Fn(&mut Random) -> Vec<[f64; 2]>| -> Result<f64> {
        let mut random = Random::new(seed);
        let mut all = Vec::new();
        for _ in 0..trials {
            let anchors = survey(&mut random, SIGMA_RANGE_M)?;
            let points = places(&mut random);
            let lengths = Encoders::noisy(sigma).measure(&mut random, &points);
            all.push(errors(&calibrate(&anchors, &lengths)?.0)[0]);
        }
        Ok(mean(&all))
    };
    let mut table = Table::new("Mean error of the heights, mm", &["M", "anywhere", "at the corners", "ratio"]);
    let mut curves = [Vec::new(), Vec::new()];
    let mut ratios = Vec::new();
    for count in &counts {
        let (count, seed) = (*count, 1000 + *count as u64);
        let spread = run(seed, &|random| anywhere(random, count))?;
        let cornered = run(seed + 100, &|_| corners(&stand_in::three_xy(), count, 0.9))?;
        curves[0].push([count as f64, 1e3 * spread]);
        curves[1].push([count as f64, 1e3 * cornered]);
        if count > 3 {
            ratios.push(spread / cornered);
        }
        table.row([count.to_string(), fixed(1e3 * spread, 1), fixed(1e3 * cornered, 1), times(spread / cornered)]);
    }
    let (three_cornered, twenty_spread) = (curves[1][0][1], curves[0][curves[0].len() - 1][1]);
    let chart = Chart {
        caption: "mean error of the heights".into(),
        x: Axis::of("number of points M"),
        y: Axis::from_to("mm", 0.0, 60.0),
        series: curves
            .into_iter()
            .zip(["anywhere", "at the corners"])
            .enumerate()
            .map(|(k, (points, name))| Series::line(name, 1 - k, points).looking(Look::Marked))
            .collect(),
        ..Chart::default()
    };
    Ok(Section {
        key: "placement",
        title: "Beyond the paper: calibration points at the corners",
        claim: "Any point of the floor is a valid calibration point, but points near the corners of the triangle of the anchors tell \
                much more. They cost nothing extra: nobody has to measure where they are."
            .into(),
        stand_in: format!(
            "Simulated: {}; ranges and lengths with a standard deviation of 0.02 m; {trials} calibrations per value. Corners: at \
             0.9 of the way to each anchor in turn, later rounds a little nearer.",
            stand_in::THREE
        ),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (760, 400), columns: 1, charts: vec![chart] }],
        checks: vec![
            Check::claim(
                ratios.iter().all(|ratio| *ratio > 1.5),
                format!("with six points or more the error is {} smaller (with three, the mean error of random points has a heavy tail)", span(&ratios)),
            ),
            Check::claim(
                three_cornered < 1.1 * twenty_spread,
                format!("three points at the corners ({three_cornered:.1} mm) are worth {} anywhere ({twenty_spread:.1} mm)", counts[counts.len() - 1]),
            ),
        ],
        ratio: Some(span(&ratios)),
        ..Section::default()
    })
}

/// One kind of error that the joint estimator knows of.
struct Case {
    name: &'static str,
    /// Standard deviation of ranges and of lengths, m.
    sigma_range_m: f64,
    sigma_m: f64,
    scale: f64,
    zero_m: f64,
    /// Share of the lengths that are wrong by half a metre.
    outliers: f64,
    sigma_scale: Option<f64>,
    sigma_offset_m: Option<f64>,
    loss: Loss,
    /// Judged by positions rather than heights.
    positions: bool,
}

const PLAIN: Case = Case {
    name: "",
    sigma_range_m: SIGMA_RANGE_M,
    sigma_m: 0.005,
    scale: 1.0,
    zero_m: 0.0,
    outliers: 0.0,
    sigma_scale: None,
    sigma_offset_m: None,
    loss: Loss::Squared,
    positions: false,
};

const CASES: [Case; 4] = [
    Case { name: "lengths better than ranges (positions)", positions: true, ..PLAIN },
    Case { name: "all lengths 1 % too long", sigma_range_m: 0.0015, scale: 1.01, sigma_scale: Some(0.02), ..PLAIN },
    Case {
        name: "encoder zeros wrong by 5 cm",
        sigma_range_m: 0.0015,
        zero_m: 0.05,
        sigma_offset_m: Some(0.05),
        ..PLAIN
    },
    Case { name: "5 % of the lengths wrong by 0.5 m", sigma_m: 0.02, outliers: 0.05, loss: Loss::Cauchy, ..PLAIN },
];

impl Case {
    /// Mean error of the paper's method and of the joint estimator, m.
    fn run(&self, seed: u64, trials: usize, count: usize) -> Result<[f64; 2]> {
        let mut random = Random::new(seed);
        let index = usize::from(self.positions);
        let mut all = [Vec::new(), Vec::new()];
        for _ in 0..trials {
            let noise: [f64; 3] = [0, 1, 2].map(|_| self.sigma_range_m * random.normal());
            let measured = [0, 1, 2].map(|k| stand_in::RANGES_M[k] + noise[k]);
            let anchors = cable_robot::calibration::survey_anchors(measured, cable_robot::calibration::Side::Left)?;
            let points = anywhere(&mut random, count);
            let encoders = Encoders {
                sigma_m: self.sigma_m,
                scale: self.scale,
                zero_m: [0, 1, 2].map(|_| self.zero_m * random.normal()),
            };
            let mut lengths = encoders.measure(&mut random, &points);
            for point in &mut lengths {
                *point = CableVec::from_fn(3, |i| {
                    let wrong = random.uniform() < self.outliers;
                    let by = if random.uniform() < 0.5 { 0.5 } else { -0.5 };
                    point[i] + if wrong { by } else { 0.0 }
                });
            }
            let [d1, d2, d3] = measured;
            let range = |from, to, m| Range { from, to, m, sigma_m: self.sigma_range_m };
            let ranges = [range(0, 2, d1), range(0, 1, d2), range(1, 2, d3)];
            let joint = JointInput {
                ranges: &ranges,
                sigma_scale: self.sigma_scale,
                sigma_offset_m: self.sigma_offset_m,
                loss: self.loss,
                ..JointInput::new(&anchors, &lengths, self.sigma_m)
            };
            let (Ok((paper, _)), Ok(found)) = (calibrate(&anchors, &lengths), calibrate_joint(&joint)) else {
                continue;
            };
            let joint = [0, 1, 2].map(|i| found.anchors_m[i]);
            all[0].push(errors(&paper)[index]);
            all[1].push(errors(&joint)[index]);
        }
        anyhow::ensure!(all[0].len() * 2 > trials, "most calibrations with {} fail", self.name);
        Ok(all.map(|values| mean(&values)))
    }
}

/// The joint estimator.
pub fn joint(effort: Effort) -> Result<Section> {
    let trials = effort.trials(400);
    let counts = effort.some(&[10, 20, 43]);
    let mut table =
        Table::new("Mean error, mm", &["what is wrong", "M", "the paper's method", "joint estimator", "ratio"]);
    let mut best = Vec::new();
    for (k, case) in CASES.iter().enumerate() {
        let mut last = f64::NAN;
        for count in &counts {
            let [paper, joint] = case.run(1100 + 10 * k as u64 + *count as u64, trials, *count)?;
            last = paper / joint;
            table.row([
                case.name.to_owned(),
                count.to_string(),
                fixed(1e3 * paper, 1),
                fixed(1e3 * joint, 1),
                times(last),
            ]);
        }
        best.push((case.name, last));
    }
    let most = counts[counts.len() - 1];
    Ok(Section {
        key: "joint",
        title: "Beyond the paper: everything estimated together",
        claim: "Ranges, lengths, one scale and the encoder zeros in one maximum-likelihood estimate with a robust loss: what the \
                paper's cost (4) cannot see is estimated along."
            .into(),
        stand_in: format!(
            "Simulated: {}; points anywhere; ranges with a standard deviation of 2 cm (1.5 mm where a scale or zeros are wrong), \
             lengths of 5 mm (2 cm with outliers). {trials} calibrations per value. Heights, or positions where the table says so.",
            stand_in::THREE
        ),
        tables: vec![table],
        checks: best
            .iter()
            .map(|(name, ratio)| {
                Check::claim(*ratio > 1.5, format!("{name}: {} times more accurate with {most} points", times(*ratio)))
            })
            .collect(),
        ratio: Some(format!("{} with {most} points", span(&best.iter().map(|b| b.1).collect::<Vec<_>>()))),
        ..Section::default()
    })
}

/// Deflection of the node after a climb, with lines that are this much stiffer than the robot file says: mm, positive is too low.
fn deflection(stretch: bool, stiffness_share: f64, height_m: f64) -> Result<(f64, Track)> {
    let mission = format!(
        "name = \"climb\"\nspeed_m_s = 0.2\n[[leg]]\nline = {{ to_m = [4.8, 3.0, {height_m}] }}\n[[leg]]\ndwell = {{ duration_s = 1.0 }}\n"
    );
    let track = Flight {
        period_s: 0.02,
        horizon: 10,
        stretch,
        stiffness_share,
        ..Flight::new(control::START_M, mission, DRIVES[0])
    }
    .fly()?;
    anyhow::ensure!(track.done, "the climb to {height_m} m did not end");
    let last: Vec<f64> = track.instants.iter().rev().take(25).map(|at| at.setpoint.z - at.truth.z).collect();
    Ok((1e3 * mean(&last), track))
}

/// Elastic compensation.
pub fn stretch(effort: Effort) -> Result<Section> {
    let heights: &[f64] = match effort {
        Effort::Full => &[0.8, 1.3, 1.8, 2.2, 2.4],
        Effort::Quick => &[0.6, 0.9],
    };
    let mut table = Table::new(
        "How far the node hangs too low after a climb from 0.3 m, mm",
        &[
            "height, m",
            "rigid lines assumed",
            "corrected",
            "corrected, lines 20 % softer than believed",
            "share removed then",
        ],
    );
    let mut curves = [const { Vec::<[f64; 2]>::new() }; 3];
    let mut shares = Vec::new();
    let mut exact: f64 = 0.0;
    for height in heights {
        let [rigid, right, wrong] =
            [(false, 1.0), (true, 1.0), (true, 0.8)].map(|(stretch, share)| deflection(stretch, share, *height));
        // With softer lines the uncorrected deflection is larger too: that is what is compared.
        let softer = deflection(false, 0.8, *height)?.0;
        let (rigid, right, wrong) = (rigid?.0, right?.0, wrong?.0);
        for (curve, value) in curves.iter_mut().zip([rigid, right, wrong]) {
            curve.push([*height, value]);
        }
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
    let least = shares.iter().fold(f64::INFINITY, |m: f64, s| m.min(*s));
    let names = ["rigid lines assumed", "corrected", "corrected, lines 20 % softer"];
    let chart = Chart {
        caption: "deflection of the node".into(),
        x: Axis::of("height after the climb, m"),
        y: Axis::of("mm too low"),
        series: curves
            .into_iter()
            .zip(names)
            .zip([1, 0, 3])
            .map(|((points, name), colour)| Series::line(name, colour, points).looking(Look::Marked))
            .collect(),
        legend: Legend::UpperLeft,
        ..Chart::default()
    };
    Ok(Section {
        key: "stretch",
        title: "Beyond the paper: lines that stretch",
        claim: "The paper saw no deflection next to the floor and neglects stretch. Higher up lines carry several times the tension; \
                commanding unstretched lengths removes most of the deflection, even with a stiffness that is known roughly."
            .into(),
        stand_in: format!(
            "Closed-loop flights: {}, a node of 2 kg, lines with EA = 6 kN and 6 m of them between drum and pulley; position told \
             at a height of 0.3 m, then a climb.",
            stand_in::THREE
        ),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (760, 400), columns: 1, charts: vec![chart] }],
        checks: vec![
            Check::claim(
                high > 3.0 * low,
                format!("without correction the node hangs {low:.0} mm too low at {} m and {high:.0} mm at {} m", heights[0], heights[heights.len() - 1]),
            ),
            Check::claim(exact < 0.2, format!("with the right stiffness {:.0} % of the deflection or less is left", 100.0 * exact)),
            Check::claim(least > 0.7, format!("with lines 20 % softer than believed at least {:.0} % of it is removed", 100.0 * least)),
        ],
        ratio: Some(format!("{:.0} % of the deflection removed or more with a stiffness 20 % off", 100.0 * least)),
        ..Section::default()
    })
}

/// The lag-aware law with what it is told of the drives.
fn preview_law(lag_s: Option<[f64; 2]>) -> Result<Law> {
    let section = ControllerSection {
        law: "preview".into(),
        drive_lag_s: lag_s,
        identify: lag_s.is_none(),
        // Told a wrong lag, it is to show what it does with it.
        misfit_limit: if lag_s.is_some() { 1e3 } else { ControllerSection::default().misfit_limit },
        ..ControllerSection::default()
    };
    Ok(Law::of(&section)?)
}

/// Lag-aware preview control.
pub fn preview(effort: Effort) -> Result<Section> {
    /// Control period of the robot as it comes, s.
    const PERIOD_S: f64 = 0.01;
    let horizons = effort.some(&[12, 15, 18, 21, 25, 30, 36]);
    let missions = control::missions(effort);
    let (missions, drives) = match effort {
        Effort::Full => (&missions[..], &DRIVES[..2]),
        Effort::Quick => (&missions[..1], &DRIVES[1..2]),
    };
    let mut table = Table::new(
        "RMS distance of the estimate from the setpoint, mm",
        &[
            "path",
            "drives",
            "lq-endpoint, best Delta",
            "identified in flight",
            "told as identified",
            "told 10 % too much",
            "told twice",
            "ratio, identified",
            "ratio, told",
        ],
    );
    let (mut identified, mut exact, mut double, mut slow) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut traces = Vec::new();
    for (name, mission) in missions {
        for drives in drives {
            let fly = |law: Option<Law>, horizon: u32| -> Result<(f64, Track)> {
                let mut flight = Flight {
                    period_s: PERIOD_S,
                    horizon,
                    ..Flight::new(control::START_M, (*mission).to_owned(), *drives)
                };
                if let Some(law) = law {
                    flight.law = law;
                }
                let track = flight.fly()?;
                let error = if track.done { 1e3 * rms(&track.by_estimate()) } else { f64::NAN };
                Ok((error, track))
            };
            let mut paper: Option<(f64, u32, Track)> = None;
            for horizon in &horizons {
                let (error, track) = fly(None, *horizon)?;
                if error.is_finite() && paper.as_ref().is_none_or(|best| error < best.0) {
                    paper = Some((error, *horizon, track));
                }
            }
            let (paper, horizon, paper_track) = paper.context("the paper's law flew no mission to its end")?;
            let (by_itself, track) = fly(Some(preview_law(None)?), horizon)?;
            // What a step test says: the drives' speed loop adds to the delay and lag of their names.
            let model = track.identified.context("the drives were not identified in flight")?;
            let told = |share: f64| preview_law(Some([share * model.delay_s(), share * model.lag_s()]));
            let (known, _) = fly(Some(told(1.0)?), horizon)?;
            let (near, _) = fly(Some(told(1.1)?), horizon)?;
            let (far, _) = fly(Some(told(2.0)?), horizon)?;
            if traces.is_empty() {
                let off = |at: &super::flight::Instant| 1e3 * (at.estimate - at.setpoint).norm();
                traces =
                    vec![paper_track.over_time("lq-endpoint", 1, off), track.over_time("preview, identified", 0, off)];
            }
            slow.push(*drives != DRIVES[0]);
            identified.push(paper / by_itself);
            exact.push(paper / known);
            double.push(if far.is_finite() { paper / far } else { 0.0 });
            let cell = |error: f64| if error.is_finite() { fixed(error, 2) } else { "stopped by itself".into() };
            table.row([
                (*name).into(),
                drives.name.into(),
                format!("{} ({horizon})", fixed(paper, 2)),
                cell(by_itself),
                cell(known),
                cell(near),
                cell(far),
                times(paper / by_itself),
                times(paper / known),
            ]);
        }
    }
    let (of_quick, of_slow): (Vec<_>, Vec<_>) = identified.iter().zip(slow).partition(|(_, slow)| !slow);
    let [of_quick, of_slow] =
        [of_quick, of_slow].map(|of| of.into_iter().map(|(ratio, _)| *ratio).collect::<Vec<f64>>());
    let worst = double.iter().fold(f64::INFINITY, |m: f64, r| m.min(*r));
    let chart = Chart {
        caption: format!("distance from the setpoint on straight lines, {}", drives[0].name),
        x: Axis::of("time, s"),
        y: Axis::of("mm"),
        series: traces.into_iter().map(|series| series.looking(Look::Line(1))).collect(),
        ..Chart::default()
    };
    Ok(Section {
        key: "preview",
        title: "Beyond the paper: a law that knows how late the drives are",
        claim: "Linear-quadratic preview control over a model of delay and lag, identified by the robot in flight, follows more \
                closely than the paper's law with its best horizon; where no model fits, the paper's law takes over."
            .into(),
        stand_in: format!(
            "Closed-loop flights as in Figures 7 and 8, at 100 cycles a second; {}, a node of 2 kg, ramps of speed.",
            stand_in::THREE
        ),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (900, 400), columns: 1, charts: vec![chart] }],
        checks: vec![
            Check::claim(
                of_slow.iter().all(|ratio| *ratio > 1.0),
                format!("with slow drives it is better, identified in flight: {}", span(&of_slow)),
            ),
            Check::condition(
                of_quick.iter().all(|ratio| *ratio > 1.0),
                format!(
                    "with quick drives too: {}. Both laws are within a millimetre there; what is left of the preview law is one \
                     or two millimetres in the ramps of speed, which its model does not explain",
                    span(&of_quick)
                ),
            ),
            Check::condition(
                identified.iter().all(|ratio| *ratio > 3.0),
                "it is three times better everywhere".into(),
            ),
            Check::condition(
                worst > 1.0,
                format!(
                    "it is better even when told twice the delay and lag: {}; this is why the robot checks its model and falls \
                     back to the paper's law above a misfit",
                    if worst > 0.0 { format!("{} times", times(worst)) } else { "without that check it stops itself".into() }
                ),
            ),
        ],
        ratio: Some(format!("{} identified in flight, {} told beforehand", span(&identified), span(&exact))),
        ..Section::default()
    })
}

/// Three harmonics down and three to the side, m: what a path deviates from the straight line.
type Shape = [f64; 6];

/// The harmonics of the parabola that sags by this much in its middle, m.
fn parabola_shape(sag_m: f64) -> Shape {
    // 4u(1-u) = 32/pi^3 (sin(pi u) + sin(3 pi u) / 27 + ..).
    let first = sag_m * 32.0 / std::f64::consts::PI.powi(3);
    [first, 0.0, first / 27.0, 0.0, 0.0, 0.0]
}

/// Loss of a path at constant speed, J, and its duration, s; not a number where the lines cannot hold the node or the ground is
/// in the way.
fn shaped(
    anchors: &[Vector3<f64>],
    motor: &Motor,
    method: Distribution,
    (from, to): (Vector3<f64>, Vector3<f64>),
    shape: &Shape,
) -> (f64, f64) {
    const INTERVALS: usize = 64;
    let chord = to - from;
    let side = Vector3::new(-chord.y, chord.x, 0.0) / chord.xy().norm();
    let (mut energy, mut length) = (0.0, 0.0);
    for i in 0..=INTERVALS {
        let u = i as f64 / INTERVALS as f64;
        let (mut position, mut per_u) = (from + chord * u, chord);
        for k in 0..3 {
            let frequency = std::f64::consts::PI * (k + 1) as f64;
            let bow = side * shape[3 + k] - Vector3::new(0.0, 0.0, shape[k]);
            position += bow * libm::sin(frequency * u);
            per_u += bow * (frequency * libm::cos(frequency * u));
        }
        let velocity = per_u * (stand_in::SPEED_M_S / per_u.norm());
        if position.z < 0.0 {
            return (f64::NAN, f64::NAN);
        }
        let held = general::hold(anchors, false, &position, &stand_in::weight(), stand_in::LIMITS_N, method);
        let Some(held) = held.ok().filter(|held| held.margin_n >= -1e-9) else { return (f64::NAN, f64::NAN) };
        let loss: f64 = anchors
            .iter()
            .zip(held.tensions_n.iter())
            .map(|(anchor, tension)| {
                let line = anchor - position;
                motor.loss_w(motor.current_a(*tension, line.dot(&velocity) / line.norm()))
            })
            .sum();
        let simpson = if i == 0 || i == INTERVALS { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
        let step = simpson * per_u.norm() / (3.0 * INTERVALS as f64);
        energy += loss * step / stand_in::SPEED_M_S;
        length += step;
    }
    (energy, length / stand_in::SPEED_M_S)
}

/// Paths that swing sideways too.
pub fn lateral(effort: Effort) -> Result<Section> {
    let bounds = Bounds { ground_m: Some(0.0), time_weight_w: 0.0 };
    let mut table = Table::new(
        "Best path of three harmonics down and three sideways, against the best parabola",
        &[
            "anchors",
            "motors",
            "move",
            "parabola, J",
            "saved in the vertical plane",
            "saved sideways too",
            "swing, m",
            "time ratio",
        ],
    );
    let mut saved = [Vec::new(), Vec::new()];
    let mut vertical = [Vec::new(), Vec::new()];
    let three = stand_in::three();
    let rigs = [
        ("three", &three[..], &stand_in::TRIANGLE_PATH[..], Distribution::Unique),
        ("four", &stand_in::UNEVEN[..], &stand_in::SQUARE_PATH[..], Distribution::LeastNorm),
    ];
    for (place, anchors, corners, method) in &rigs {
        let anchors: Vec<Vector3<f64>> = anchors.iter().map(|a| Vector3::from(*a)).collect();
        for (which, (name, motor)) in
            [("ideal", stand_in::ideal()), ("geared", stand_in::geared())].into_iter().enumerate()
        {
            for k in 0..effort.some(&(0..corners.len()).collect::<Vec<_>>()).len().min(corners.len()) {
                let ends = (Vector3::from(corners[k]), Vector3::from(corners[(k + 1) % corners.len()]));
                let hoist = Hoist {
                    anchors: &anchors,
                    planar: false,
                    wrench_n: stand_in::weight(),
                    limits_n: stand_in::LIMITS_N,
                    method: *method,
                    current: &motor,
                };
                let best = hoist.best_parabola(&ends.0, &ends.1, stand_in::SPEED_M_S, 64, &bounds)?;
                let extent = (ends.1 - ends.0).xy().norm();
                let sag = 0.25 * best.mu_per_m * extent * extent;
                let cost = |shape: &Shape| shaped(&anchors, &motor, *method, ends, shape).0;
                let rounds = effort.trials(200);
                let upright = search(cost, &[parabola_shape(sag), parabola_shape(0.8 * sag)], 3, rounds);
                let mut starts = vec![upright];
                for swing in [-1.5, -0.5, 0.5, 1.5] {
                    let mut start = parabola_shape(0.8 * sag);
                    start[3] = swing;
                    starts.push(start);
                }
                let found = search(cost, &starts, 6, rounds);
                let vertical_j = shaped(&anchors, &motor, *method, ends, &upright).0.min(best.cost.energy_j);
                let (energy, duration) = shaped(&anchors, &motor, *method, ends, &found);
                let energy = energy.min(vertical_j);
                let vertical_share = 1.0 - vertical_j / best.cost.energy_j;
                let share = 1.0 - energy / best.cost.energy_j;
                vertical[which].push(vertical_share);
                saved[which].push(share);
                table.row([
                    (*place).into(),
                    name.into(),
                    (k + 1).to_string(),
                    fixed(best.cost.energy_j, 2),
                    format!("{:.1} %", 100.0 * vertical_share),
                    format!("{:.1} %", 100.0 * share),
                    fixed(found[3], 2),
                    fixed(duration / best.cost.duration_s, 2),
                ]);
            }
        }
    }
    let percent = |values: &[f64]| {
        let low = values.iter().fold(f64::INFINITY, |m: f64, v| m.min(*v));
        let high = values.iter().fold(f64::NEG_INFINITY, |m: f64, v| m.max(*v));
        format!("{:.0} to {:.0} %", 100.0 * low, 100.0 * high)
    };
    let [ideal, geared] = &saved;
    Ok(Section {
        key: "lateral",
        title: "Beyond the paper: paths that swing sideways",
        claim: "The paper found richer paths than parabolas in a vertical plane to yield negligible improvements. With gears that lock \
                themselves lowering is almost free and raising is dear, and a path that also swings sideways saves more."
            .into(),
        stand_in: format!("{}, the triangle; {} (uneven), the square. Computed, quasi-static.", stand_in::THREE, stand_in::FOUR),
        tables: vec![table],
        checks: vec![
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
                format!("with ideal motors the paper is right: {}, {:.0} % on average", percent(ideal), 100.0 * mean(ideal)),
            ),
            Check::condition(
                geared.iter().all(|share| *share > 0.1),
                "with geared motors it saves more than 10 % on every move".into(),
            ),
        ],
        remarks: vec!["Computed only: the planner flies parabolas in a vertical plane.".into()],
        ratio: Some(format!("{} less loss with geared motors", percent(geared))),
        ..Section::default()
    })
}

/// The least of a function of the first `count` harmonics from several starts: steps along every one in turn, each with a length
/// that grows with success and shrinks without. Not a number counts as infinite.
fn search(cost: impl Fn(&Shape) -> f64, starts: &[Shape], count: usize, rounds: usize) -> Shape {
    let value = |at: &Shape| {
        let found = cost(at);
        if found.is_nan() { f64::INFINITY } else { found }
    };
    let mut best = (starts[0], value(&starts[0]));
    for start in starts {
        let mut at = *start;
        let mut here = value(&at);
        let mut steps = [0.2; 6];
        for _ in 0..rounds {
            for k in 0..count {
                let mut moved = false;
                for direction in [1.0, -1.0] {
                    let mut next = at;
                    next[k] += direction * steps[k];
                    let found = value(&next);
                    if found < here {
                        (at, here, moved) = (next, found, true);
                        break;
                    }
                }
                steps[k] *= if moved { 1.3 } else { 0.6 };
            }
            if steps[..count].iter().all(|step| *step < 1e-4) {
                break;
            }
        }
        if here < best.1 {
            best = (at, here);
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_finds_a_minimum_off_the_axes() {
        let cost = |at: &Shape| {
            let [x, y, ..] = *at;
            if x > 3.0 { f64::NAN } else { (x - 1.0) * (x - 1.0) + (y - 0.7) * (y - 0.7) + x * y }
        };
        let found = search(cost, &[[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]], 2, 200);
        // Where the gradient vanishes: 2(x-1)+y = 0, 2(y-0.7)+x = 0.
        assert!((found[0] - 2.6 / 3.0).abs() < 5e-3 && (found[1] - 0.8 / 3.0).abs() < 5e-3, "{found:?}");
    }

    #[test]
    fn three_harmonics_are_nearly_the_parabola() {
        let shape = parabola_shape(1.0);
        for i in 0..=20 {
            let u = f64::from(i) / 20.0;
            let sum: f64 = (0..3).map(|k| shape[k] * libm::sin(std::f64::consts::PI * (k + 1) as f64 * u)).sum();
            assert!((sum - 4.0 * u * (1.0 - u)).abs() < 0.02, "{u} {sum}");
        }
    }
}
