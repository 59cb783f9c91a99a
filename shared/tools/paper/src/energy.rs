//! Figures 11 to 13 and Tables V and VIII: losses of moves.

use super::flight::{ClosedLoopFlight, DRIVES, Track, TrackPoint};
use super::section::{Check, Effort, Section, Table, fixed, mean, rms};
use super::stand_in;
use anyhow::{Context, Result};
use cable_robot::energy::{Best, Bounds, Cost, Current, CurrentTable, WinchEnergy};
use cable_robot::motor::Motor;
use cable_robot::{Anchors, Distribution, Matrix3, Vector3};
use plant::{Plant, PlantConfig};
use plot::{Axis, BLACK, Chart, GREY, Legend, Picture, Series, SeriesStyle};

/// Intervals of Simpson's rule, with an error of 3e-6.
const INTERVALS: usize = 64;

/// Minimum height of flown parabolas above the ground, m.
const CLEARANCE_M: f64 = 0.1;

/// Returns the moves from each corner to the next.
fn moves<const N: usize>(corners: &[[f64; 3]; N]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    (0..N).map(|k| (Vector3::from(corners[k]), Vector3::from(corners[(k + 1) % N]))).collect()
}

/// Anchors and motor for the energy of moves.
struct WinchSetup {
    anchors: Anchors,
    motor: Motor,
}

impl WinchSetup {
    fn new(anchors: &[[f64; 3]], motor: Motor) -> Result<Self> {
        Ok(Self { anchors: Anchors::new(anchors)?, motor })
    }

    fn winch_energy(&self, method: Distribution) -> WinchEnergy<'_> {
        WinchEnergy {
            anchors: &self.anchors,
            wrench_n: stand_in::weight(),
            drag_n_s2_m2: 0.0,
            limits_n: stand_in::LIMITS_N,
            method,
            current: &self.motor,
        }
    }

    /// Returns the costs of the straight line and of the optimal parabola.
    fn line_and_best(&self, method: Distribution, ends: (Vector3<f64>, Vector3<f64>)) -> Result<(Cost, Best)> {
        self.line_and_best_above(0.0, method, ends)
    }

    /// The same with the ground at this height, m.
    fn line_and_best_above(
        &self,
        ground_m: f64,
        method: Distribution,
        ends: (Vector3<f64>, Vector3<f64>),
    ) -> Result<(Cost, Best)> {
        let bounds = Bounds { ground_m: Some(ground_m), time_weight_w: 0.0 };
        let winch_energy = self.winch_energy(method);
        let best = winch_energy.best_parabola(&ends.0, &ends.1, stand_in::SPEED_M_S, INTERVALS, &bounds)?;
        Ok((best.line.context("the straight line cannot be flown")?, best))
    }
}

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
        ],
        remarks: vec![format!(
            "The table built from these runs agrees with the friction model of the robot file to {:.0} mA (root mean square).",
            1e3 * rms(&off)
        )],
        ..Section::default()
    })
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

/// Parabolas compared with lines in the three-cable configuration, computed and flown.
struct MoveComparison {
    /// Computed costs of line and best parabola.
    expected: Vec<(Cost, Best)>,
    /// Flights along the line and along the parabola.
    flown: Vec<[Track; 2]>,
}

impl MoveComparison {
    fn fly(effort: Effort) -> Result<Self> {
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
pub(super) fn flown_cost(track: &Track, resistance_ohm: f64) -> [f64; 2] {
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

fn three_words() -> String {
    format!(
        "{}, a node of 2 kg at 0.2 m/s, tensions of 1 to 150 N; moves between (3.3, 1.6, 2.45), (6.6, 1.9, 2.35) and \
         (4.9, 4.6, 2.30) m, a roughly equilateral triangle in the upper region. Flown in closed loop against the plant with \
         geared motors and ramps of speed, at least 0.1 m above the ground.",
        stand_in::THREE
    )
}

fn track_path(track: &Track, name: &str, colour: usize, onto: fn(&Vector3<f64>) -> [f64; 2]) -> Series {
    track.path(name, colour, |at| at.truth, onto)
}

/// Projects the flown paths onto a plane.
fn path_view(moves: &MoveComparison, caption: &str, y: &str, onto: fn(&Vector3<f64>) -> [f64; 2]) -> Chart {
    let anchors: Vec<[f64; 2]> = stand_in::three_cable_anchors().iter().map(|a| onto(&Vector3::from(*a))).collect();
    let mut outline = anchors.clone();
    outline.push(anchors[0]);
    // The legend is in the view that has space for it.
    let named = y == "z, m";
    let mut series = vec![
        Series::line(if named { "anchors" } else { "" }, BLACK, anchors).with_style(SeriesStyle::Discs(5)),
        Series::line("", GREY, outline).with_style(SeriesStyle::Dashed),
    ];
    for (k, tracks) in moves.flown.iter().enumerate() {
        let name = |text: &str| if k == 0 && named { text.to_owned() } else { String::new() };
        series.push(track_path(&tracks[1], &name("parabolas, flown"), 0, onto));
        series.push(track_path(&tracks[0], &name("straight lines, flown"), 1, onto));
    }
    Chart {
        caption: caption.into(),
        x: Axis::auto("x, m"),
        y: Axis::auto(y),
        series,
        equal_scale: true,
        legend: Legend::UpperLeft,
    }
}

/// Figure 12: paths.
pub fn fig12(effort: Effort) -> Result<Section> {
    let moves = MoveComparison::fly(effort)?;
    let view = |caption, y, onto| path_view(&moves, caption, y, onto);
    let charts = vec![view("from above", "y, m", |p| [p.x, p.y]), view("from the side", "z, m", |p| [p.x, p.z])];
    let distance =
        |k: usize| 1e3 * rms(&moves.flown.iter().flat_map(|tracks| tracks[k].errors_of_truth_m()).collect::<Vec<_>>());
    let deepest: Vec<f64> = moves
        .expected
        .iter()
        .zip(&moves.flown)
        .map(|((_, best), tracks)| {
            let ends = &tracks[1].instants;
            let (from, to) = (ends[0].setpoint, ends[ends.len() - 1].setpoint);
            let extent = (to - from).xy().norm();
            0.25 * best.mu_per_m * extent * extent
        })
        .collect();
    let mut table = Table::new("The moves", &["move", "optimal mu, 1/m", "sag below the middle, m"]);
    for (k, ((_, best), sag)) in moves.expected.iter().zip(&deepest).enumerate() {
        table.row([format!("{}", k + 1), fixed(best.mu_per_m, 3), fixed(*sag, 2)]);
    }
    Ok(Section {
        key: "fig12",
        title: "Figure 12: straight lines and optimised parabolas",
        claim: "Straight and optimised parabolic trajectories through the same points are executed.".into(),
        stand_in: three_words(),
        tables: vec![table],
        pictures: vec![Picture { title: String::new(), size: (1040, 480), columns: 2, charts }],
        checks: vec![
            Check::claim(
                moves.flown.iter().flatten().all(|track| track.done && track.unsteered == 0),
                format!("all {} moves are completed with every period steered", 2 * moves.flown.len()),
            ),
            Check::claim(
                distance(0) < 10.0 && distance(1) < 10.0,
                format!(
                    "the node stays within {:.1} mm RMS of the lines and {:.1} mm of the parabolas",
                    distance(0),
                    distance(1)
                ),
            ),
            Check::claim(
                deepest.iter().all(|sag| *sag > 0.1),
                "every optimal parabola sags clearly below its line".into(),
            ),
        ],
        ..Section::default()
    })
}

/// Returns the current of a motor over a flight according to statics and the friction model, A.
fn expected_current(track: &Track, motor: &Motor, cable: usize) -> Result<Vec<[f64; 2]>> {
    let anchors = stand_in::anchors(&stand_in::three_cable_anchors())?;
    track
        .instants
        .windows(3)
        .step_by(2)
        .map(|three| {
            let [before, at, after] = [three[0], three[1], three[2]];
            let structure = cable_robot::StructureMatrix::at(&anchors, &at.setpoint)?;
            let dt = after.time_s - before.time_s;
            let velocity = if dt > 0.0 { (after.setpoint - before.setpoint) / dt } else { Vector3::zeros() };
            let tension = cable_robot::tension::unique(&structure, &stand_in::weight())?;
            let line = anchors[cable] - at.setpoint;
            let reel_in = line.dot(&velocity) / line.norm();
            Ok([at.time_s, motor.current_a(tension[cable], reel_in)])
        })
        .collect()
}

/// Figure 13: current of motor 2 compared with the expected values.
pub fn fig13(effort: Effort) -> Result<Section> {
    let moves = MoveComparison::fly(effort)?;
    let motor = stand_in::geared();
    let cable = 1;
    let mut charts = Vec::new();
    let mut powers = Vec::new();
    let mut deviations = Vec::new();
    for (k, caption) in ["straight line", "optimised parabola"].into_iter().enumerate() {
        let track = &moves.flown[0][k];
        let expected = expected_current(track, &motor, cable)?;
        let measured: Vec<f64> = track.instants.windows(3).step_by(2).map(|three| three[1].current_a[cable]).collect();
        let moving: Vec<bool> = track.instants.windows(3).step_by(2).map(|three| three[1].moving).collect();
        let pick = |values: &mut dyn Iterator<Item = f64>| -> Vec<f64> {
            values.zip(&moving).filter(|(_, moving)| **moving).map(|(value, _)| value).collect()
        };
        let differences = pick(&mut expected.iter().zip(&measured).map(|(e, m)| m - e[1]));
        let sizes = pick(&mut expected.iter().map(|e| e[1]));
        deviations.push(rms(&differences) / rms(&sizes));
        powers.push(motor.resistance_ohm * mean(&pick(&mut measured.iter().map(|i| i * i))));
        charts.push(Chart {
            caption: caption.into(),
            x: Axis::auto("time, s"),
            y: Axis::auto("current of motor 2, A"),
            series: vec![
                track.over_time("measured by the drive", 0, |at| at.current_a[cable]).with_style(SeriesStyle::Line(1)),
                Series::line("expected", 1, expected),
            ],
            legend: Legend::LowerRight,
            ..Chart::default()
        });
    }
    // Both charts have the same scale.
    let top = charts.iter().flat_map(|chart| &chart.series).flat_map(|s| &s.points).fold(0.0, |m: f64, p| m.max(p[1]));
    let low = charts.iter().flat_map(|chart| &chart.series).flat_map(|s| &s.points).fold(0.0, |m: f64, p| m.min(p[1]));
    for chart in &mut charts {
        chart.y.range = Some([low * 1.1, top * 1.1]);
    }
    Ok(Section {
        key: "fig13",
        title: "Figure 13: current of motor 2 compared with the expected values",
        claim: "Measured currents are in fair agreement with the expected ones, and the mean power falls substantially with the \
                parabola."
            .into(),
        stand_in: format!("{} The first move; expected currents are quasi-static.", three_words()),
        pictures: vec![Picture { title: String::new(), size: (1040, 400), columns: 2, charts }],
        checks: vec![
            Check::claim(
                deviations.iter().all(|d| *d < 0.2),
                format!(
                    "the measured current deviates by {:.0} % (line) and {:.0} % (parabola) of the expected one, root mean square",
                    100.0 * deviations[0],
                    100.0 * deviations[1]
                ),
            ),
            Check::claim(
                powers[1] < 0.8 * powers[0],
                format!("the mean loss of motor 2 falls from {:.2} to {:.2} W", powers[0], powers[1]),
            ),
        ],
        ..Section::default()
    })
}

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
