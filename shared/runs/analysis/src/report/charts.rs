//! The charts of the page. Every run gets the same ones, so that several runs can share axes side by side.

use super::events::EventKind;
use super::gather::{PathPoint, RunData};
use super::trace::Trace;
use crate::colours::{ESTIMATE, SETPOINT, TRUTH};
use cable_robot::Vector3;
use messages::MotorAuthority;
use plot::{Axis, BLACK, COLOURS, Chart, GREY, Series, SeriesStyle, css_colour, ranges, svg};
use robot_state::sentences::mode_name;

/// Purple, for quantities that do not belong to a single cable.
const ALONE: usize = 4;
/// Black, for the marks of operators.
const MARK: usize = BLACK;
/// Size of a chart over time, px.
const WIDE: (u32, u32) = (1060, 250);
/// Size of a view of the path, px.
pub(super) const VIEW: (u32, u32) = (520, 430);
/// Height of a lane of the timeline, px.
const LANE_PX: u32 = 26;
/// Height of the time axis of the timeline, px.
const AXIS_PX: u32 = 58;
/// Duration from which a run is shown in minutes, s.
const MINUTES_FROM_S: f64 = 900.0;
/// Minimum step of a drawn path as a share of its extent.
const MIN_STEP_SHARE: f64 = 1.0 / 1500.0;

/// A chart with caption and legend.
pub struct Figure {
    /// Caption.
    pub caption: String,
    /// Colour and name of each named series.
    pub key: Vec<(String, String)>,
    /// Whether it takes half the width of the page.
    pub half: bool,
    /// Whether all runs share its range of y.
    pub same_y: bool,
    size: (u32, u32),
    chart: Chart,
    /// Where operators have marked the run, in the unit of x.
    marks: Vec<f64>,
}

impl Figure {
    /// Creates a figure from a chart.
    pub(super) fn new(caption: &str, size: (u32, u32), chart: Chart) -> Self {
        let named = chart.series.iter().filter(|series| !series.name.is_empty());
        let key = named.map(|series| (css_colour(series.colour), series.name.clone())).collect();
        Self { caption: caption.to_owned(), key, half: size.0 < WIDE.0, same_y: true, size, chart, marks: Vec::new() }
    }

    /// Returns whether it has no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.chart.series.iter().all(|series| series.points.is_empty())
    }

    /// Adds the marks of operators, as lines over the whole height.
    fn with_marks(mut self, marks: &[f64]) -> Self {
        if !marks.is_empty() && !self.is_empty() {
            self.marks = marks.to_vec();
            self.key.push((css_colour(MARK), "mark".to_owned()));
        }
        self
    }

    /// Renders the figure as SVG.
    #[must_use]
    pub fn svg(&self) -> String {
        if self.marks.is_empty() {
            return svg(&self.chart, self.size);
        }
        let mut chart = self.chart.clone();
        // Several runs may share the range of y.
        let [_, [low, high]] = ranges(&chart, self.size);
        chart.y.range = Some([low, high]);
        let line = |at: &f64| Series::line("", MARK, vec![[*at, low], [*at, high]]).with_style(SeriesStyle::Dashed);
        chart.series.extend(self.marks.iter().map(line));
        svg(&chart, self.size)
    }
}

/// Sets common axes for the same figure of several runs.
pub fn share_axes<'a>(figures: impl Iterator<Item = &'a mut Figure>) {
    let mut figures: Vec<&mut Figure> = figures.filter(|figure| !figure.is_empty()).collect();
    if figures.len() < 2 {
        return;
    }
    let all: Vec<[[f64; 2]; 2]> = figures.iter().map(|figure| ranges(&figure.chart, figure.size)).collect();
    let union = |axis: usize| {
        all.iter()
            .map(|both| both[axis])
            .fold([f64::INFINITY, f64::NEG_INFINITY], |sum, one| [sum[0].min(one[0]), sum[1].max(one[1])])
    };
    let (x, y) = (union(0), union(1));
    for figure in &mut figures {
        if figure.same_y {
            figure.chart.y.range = Some(y);
        }
        if figure.chart.equal_scale {
            figure.chart.x.range = Some(x);
        }
    }
}

/// Time axis in seconds or minutes.
struct TimeAxis {
    label: &'static str,
    factor: f64,
    ends: [f64; 2],
    marks: Vec<f64>,
}

impl TimeAxis {
    fn new(run: &RunData) -> Self {
        let begin_s = run.recording.first_s;
        let end_s = begin_s + run.recording.duration_s.max(1e-3);
        let (label, factor) = match end_s < MINUTES_FROM_S {
            true => ("time since the start of the run, s", 1.0),
            false => ("time since the start of the run, min", 1.0 / 60.0),
        };
        let marks = run.events.all().iter().filter(|event| event.kind == EventKind::Mark);
        Self {
            label,
            factor,
            ends: [factor * begin_s, factor * end_s],
            marks: marks.map(|mark| factor * mark.time_s).collect(),
        }
    }

    /// Creates a figure over time, with the marks of operators.
    fn figure(&self, caption: &str, size: (u32, u32), chart: Chart) -> Figure {
        Figure::new(caption, size, chart).with_marks(&self.marks)
    }

    fn axis(&self) -> Axis {
        Axis::fixed(self.label, self.ends[0], self.ends[1])
    }

    /// Creates a chart over time; the first trace is drawn first.
    fn chart(&self, label: &str, traces: &[(&str, usize, &Trace)], factor: f64) -> Chart {
        let series = traces.iter().flat_map(|(name, colour, trace)| trace.series(name, *colour, [self.factor, factor]));
        Chart { x: self.axis(), y: Axis::auto(label), series: series.collect(), ..Chart::default() }
    }
}

/// Returns the name of a cable.
pub fn cable_name(index: usize) -> String {
    format!("cable {}", index + 1)
}

/// Path from above and from the side.
pub fn path(run: &RunData) -> Vec<Figure> {
    let planar = run.robot.as_ref().is_some_and(cable_robot::Robot::is_planar);
    let view = |caption: &str, labels: [&str; 2], onto: fn(&Vector3<f64>) -> [f64; 2]| {
        let curve = |which: usize| decimate(run.path.iter().map(|place: &PathPoint| place[which].as_ref().map(onto)));
        let series = vec![
            Series::line("setpoints", SETPOINT, curve(0)).with_style(SeriesStyle::Line(6)),
            Series::line("truth", TRUTH, curve(2)),
            Series::line("estimate", ESTIMATE, curve(1)),
        ];
        let series = series.into_iter().filter(|series| !series.points.is_empty()).collect();
        let [x, y] = labels.map(Axis::auto);
        Figure::new(caption, VIEW, Chart { x, y, series, equal_scale: true, ..Chart::default() })
    };
    let side = view("Path from the side", ["x, m", "z, m"], |p| [p.x, p.z]);
    if planar {
        return vec![side];
    }
    vec![view("Path from above", ["x, m", "y, m"], |p| [p.x, p.y]), side]
}

/// Removes points that are too close to distinguish; a missing point interrupts the line.
fn decimate(points: impl Iterator<Item = Option<[f64; 2]>>) -> Vec<[f64; 2]> {
    let points: Vec<Option<[f64; 2]>> = points.collect();
    let bound =
        |axis: usize, from: f64, take: fn(f64, f64) -> f64| points.iter().flatten().map(|p| p[axis]).fold(from, take);
    let extent = |axis| bound(axis, f64::NEG_INFINITY, f64::max) - bound(axis, f64::INFINITY, f64::min);
    let step = MIN_STEP_SHARE * extent(0).max(extent(1));
    let mut kept: Vec<[f64; 2]> = Vec::new();
    let mut skipped = None;
    for point in points {
        match (point, kept.last()) {
            (Some(p), Some(last))
                if last[0].is_finite() && (p[0] - last[0]).abs().max((p[1] - last[1]).abs()) < step =>
            {
                skipped = Some(p);
            }
            (Some(p), _) => {
                kept.push(p);
                skipped = None;
            }
            (None, last) => {
                let broken = last.is_none_or(|last| last[0].is_nan());
                kept.extend(skipped.take());
                if !broken {
                    kept.push([f64::NAN; 2]);
                }
            }
        }
    }
    kept.extend(skipped);
    kept
}

/// Site plan: anchors and the path.
pub fn site(run: &RunData) -> Vec<Figure> {
    let Some(robot) = &run.robot else { return Vec::new() };
    let planar = robot.is_planar();
    let onto = |p: &Vector3<f64>| if planar { [p.x, p.z] } else { [p.x, p.y] };
    let mut series =
        vec![Series::line("estimate", ESTIMATE, decimate(run.path.iter().map(|place| place[1].as_ref().map(onto))))];
    let last = run.path.iter().rev().find_map(|place| place[1]);
    for (i, anchor) in robot.anchors().iter().enumerate() {
        let line = last.map_or_else(Vec::new, |node| vec![onto(anchor), onto(&node)]);
        series.push(Series::line("", i, line).with_style(SeriesStyle::Line(1)));
        series.push(Series::line(&cable_name(i), i, vec![onto(anchor)]).with_style(SeriesStyle::Discs(5)));
    }
    let labels = if planar { ["x, m", "z, m"] } else { ["x, m", "y, m"] };
    let [x, y] = labels.map(Axis::auto);
    vec![Figure::new(
        "The robot: anchors, cables at the end of the run, path",
        VIEW,
        Chart { x, y, series, equal_scale: true, ..Chart::default() },
    )]
}

/// Distance from the setpoint, and of the truth from the estimate.
pub fn tracking(run: &RunData) -> Vec<Figure> {
    let time = TimeAxis::new(run);
    let [estimate, truth, model] = &run.errors;
    let mut chart = time.chart("distance, mm", &[("truth", TRUTH, truth), ("estimate", ESTIMATE, estimate)], 1000.0);
    chart.series.retain(|series| !series.points.is_empty());
    let mut figures = vec![time.figure("Distance from the setpoint while it moves", WIDE, chart)];
    if model.extremes().is_some() {
        let world = run.world.as_deref().unwrap_or("a virtual one");
        let caption = format!("Model error: distance of the truth from the estimate (world: {world})");
        let chart = time.chart("distance, mm", &[("truth from estimate", TRUTH, model)], 1000.0);
        figures.push(time.figure(&caption, WIDE, chart));
    }
    figures
}

/// Charts per cable.
pub fn cables(run: &RunData) -> Vec<Figure> {
    let time = TimeAxis::new(run);
    let names: Vec<String> = (0..run.cables.len()).map(cable_name).collect();
    let of = |pick: fn(&super::gather::CableData) -> &Trace| -> Vec<(&str, usize, &Trace)> {
        run.cables.iter().enumerate().map(|(i, cable)| (names[i].as_str(), i, pick(cable))).collect()
    };
    let figure = |caption: &str, label: &str, traces: &[(&str, usize, &Trace)]| {
        time.figure(caption, WIDE, time.chart(label, traces, 1.0))
    };
    let mut tensions = time.chart("tension, N", &of(|cable| &cable.tension), 1.0);
    if let Some(robot) = &run.robot {
        let highest =
            run.cables.iter().filter_map(|cable| cable.tension.extremes()).map(|[_, high]| high).fold(0.0, f64::max);
        for limit in robot.tension_limits_n().into_iter().filter(|limit| *limit < 1.3 * highest) {
            let ends = time.ends.map(|end| [end, limit]).to_vec();
            tensions.series.push(Series::line("limit", BLACK, ends).with_style(SeriesStyle::Dashed));
        }
    }
    vec![
        figure("Cable length", "length, m", &of(|cable| &cable.length)),
        figure("Cable speed; positive: paying out", "speed, m/s", &of(|cable| &cable.velocity)),
        time.figure("Tension (estimate)", WIDE, tensions),
        figure("Tension (truth)", "tension, N", &of(|cable| &cable.true_tension)),
        figure("Motor current", "current, A", &of(|cable| &cable.current)),
    ]
}

/// Power of all motors.
pub fn power(run: &RunData) -> Vec<Figure> {
    let [electrical, loss] = &run.power;
    let traces = [("electrical power", ALONE, electrical), ("loss in the motors", COLOURS.len() - 5, loss)];
    let time = TimeAxis::new(run);
    vec![time.figure("Power of all motors", WIDE, time.chart("power, W", &traces, 1.0))]
}

/// Timing of the control cycle.
pub fn timing(run: &RunData) -> Vec<Figure> {
    let time = TimeAxis::new(run);
    let [wake, bus, age, answer_time] = &run.times;
    let [computer, drive, resync, answer] = &run.losses;
    let times = [
        ("oldest reading to command", ALONE, &age.trace),
        ("bus exchange", 0, &bus.trace),
        ("tick to wake-up", 3, &wake.trace),
        ("publication of state to command", 1, &answer_time.trace),
    ];
    let counts = [("resync", 3, resync), ("drive", 2, drive), ("computer", 0, computer), ("answer", 1, answer)];
    vec![
        time.figure("Times within each cycle", WIDE, time.chart("time, ms", &times, 1000.0)),
        time.figure("Periods not steered, by cause", (WIDE.0, 170), time.chart("periods", &counts, 1.0)),
    ]
}

/// Returns the colour of a mode.
fn mode_colour(mode: u8) -> usize {
    match mode {
        MotorAuthority::MODE_HOLDING => 0,
        MotorAuthority::MODE_JOGGING | MotorAuthority::MODE_SOFT => 6,
        MotorAuthority::MODE_FOLLOWING => 2,
        MotorAuthority::MODE_STOPPING => 3,
        MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP => 1,
        _ => GREY,
    }
}

/// Modes, legs and slots over time.
pub fn timeline(run: &RunData) -> Vec<Figure> {
    let time = TimeAxis::new(run);
    let block =
        |lane: f64, from_s: f64, to_s: f64| [[time.factor * from_s, lane - 0.38], [time.factor * to_s, lane + 0.38]];
    let mut names = Vec::new();
    let mut series: Vec<Series> = Vec::new();
    let mut add = |name: String, colour: usize, blocks: Vec<[f64; 2]>| {
        let at = series.iter().position(|series| series.name == name && series.colour == colour);
        match at {
            Some(at) => series[at].points.extend(blocks),
            None => series.push(Series { name, colour, style: SeriesStyle::Blocks, points: blocks }),
        }
    };
    // Lanes from below: slots, legs, mode.
    for (role, name) in ["estimator", "controller"].into_iter().zip([1, 0]).map(|(name, role)| (role, name)) {
        let lane = names.len() as f64;
        names.push(name.to_owned());
        for (from_s, to_s, slots) in &run.slots {
            let (slot, colour) = if slots[role] == 0 { ("slot a", 6) } else { ("slot b", ALONE) };
            add(slot.to_owned(), colour, block(lane, *from_s, *to_s).to_vec());
        }
    }
    let lane = names.len() as f64;
    names.push("legs".to_owned());
    for (number, (from_s, to_s)) in run.legs.spans().enumerate() {
        // Adjacent legs have different colours.
        let (name, colour) = if number.is_multiple_of(2) { ("legs", GREY) } else { ("", BLACK) };
        add(name.to_owned(), colour, block(lane, from_s, to_s).to_vec());
    }
    let lane = names.len() as f64;
    names.push("mode".to_owned());
    for (from_s, to_s, mode) in &run.modes {
        add(mode_name(*mode).to_owned(), mode_colour(*mode), block(lane, *from_s, *to_s).to_vec());
    }
    let size = (WIDE.0, AXIS_PX + LANE_PX * names.len() as u32);
    let y = Axis { range: Some([-0.6, names.len() as f64 - 0.4]), names, ..Axis::default() };
    let mut figure = time.figure(
        "Mode, legs, and the slots in charge",
        size,
        Chart { x: time.axis(), y, series, ..Chart::default() },
    );
    figure.same_y = false;
    vec![figure]
}

/// Sensor values over time and along the path.
pub fn sensors(run: &RunData) -> Vec<Figure> {
    let time = TimeAxis::new(run);
    let mut figures = Vec::new();
    for (name, sensor) in run.sensors.channels() {
        for (at, (quantity, trace)) in sensor.values.iter().enumerate() {
            let caption = format!("{name}: {quantity}");
            let chart = time.chart(quantity, &[("", at, trace)], 1.0);
            figures.push(time.figure(&caption, (WIDE.0, 200), chart));
        }
        let places = sensor.places.points();
        let values = || places.iter().map(|(_, value)| *value).filter(|value| value.is_finite());
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        if places.len() < 2 || low > high {
            continue;
        }
        let what = sensor.values.first().map_or("value", |(quantity, _)| quantity.as_str());
        let share = |value: f64| if high > low { (value - low) / (high - low) } else { 0.5 };
        // No more discs than can be distinguished.
        let step = places.len().div_ceil(2500).max(1);
        let shown = || places.iter().step_by(step).filter(|(_, value)| value.is_finite());
        let views = [("from above", ["x, m", "y, m"], 1), ("from the side", ["x, m", "z, m"], 2)];
        for (view, labels, axis) in views {
            let points = shown().map(|(place, _)| [place[0], place[axis]]).collect();
            let scaled = SeriesStyle::Scaled(4, shown().map(|(_, value)| share(*value)).collect());
            let [x, y] = labels.map(Axis::auto);
            let series = vec![Series::line("", 0, points).with_style(scaled)];
            let caption = format!("{name} along the path, {view}: {what} from {low:.4} (dark) to {high:.4} (light)");
            figures.push(Figure::new(&caption, VIEW, Chart { x, y, series, equal_scale: true, ..Chart::default() }));
        }
    }
    figures
}
