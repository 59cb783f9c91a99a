//! Effect of a changed law or parameter on the commands, with each part on its own recorded inputs.

use command::{Answer, Failure};
use messages::{CABLES, MotorAuthority, MotorCommand, MotorState, NodeEstimate};
use plot::{Axis, Chart, GREY, Legend, Picture, Series, SeriesStyle};
use serde::Serialize;
use std::path::Path;

/// Maximum number of points per curve; more than pixels only enlarge the file.
const POINTS: usize = 4000;
/// Pause that interrupts a curve, s.
const PAUSE_S: f64 = 0.5;

/// Accumulated difference of one quantity over many cycles.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct DifferenceSum {
    squares: f64,
    max: f64,
    count: u64,
}

impl DifferenceSum {
    fn add(&mut self, difference: f64) {
        self.squares += difference * difference;
        self.max = self.max.max(difference.abs());
        self.count += 1;
    }

    fn spread(&self) -> Spread {
        Spread { rms: (self.squares / self.count.max(1) as f64).sqrt(), max: self.max }
    }
}

/// Magnitude of differences.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Root mean square.
    pub rms: f64,
    /// Maximum.
    pub max: f64,
}

/// Differences over the cycles in which the robot followed a motion with the compared controller and estimate.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Comparison {
    /// Cycles with a command from both.
    pub cycles: u64,
    /// Cycles with a command only in the recording.
    pub only_recorded: u64,
    /// Cycles with a command only from the changed controller.
    pub only_new: u64,
    /// Difference of the commanded velocity per cable, m/s.
    pub command_m_s: Vec<Spread>,
    /// Difference of the velocity that motor-io sends for the recorded commands, per cable, m/s.
    pub sent_m_s: Vec<Spread>,
    /// Distance between the estimated positions, m.
    pub position_m: Spread,
    /// Cycles in which motor-io is in a different mode.
    pub cycles_of_other_mode: u64,
    #[serde(skip)]
    curve: Curve,
}

/// Commands over time, decimated as their number grows.
#[derive(Clone, Default, PartialEq)]
struct Curve {
    points: Vec<(f64, [f64; CABLES], [f64; CABLES])>,
    stride: u64,
}

impl std::fmt::Debug for Curve {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} points", self.points.len())
    }
}

impl Curve {
    fn push(&mut self, number: u64, time_s: f64, recorded: [f64; CABLES], new: [f64; CABLES]) {
        self.stride = self.stride.max(1);
        if !number.is_multiple_of(self.stride) {
            return;
        }
        self.points.push((time_s, recorded, new));
        if self.points.len() > POINTS {
            let mut keep = false;
            self.points.retain(|_| {
                keep = !keep;
                keep
            });
            self.stride *= 2;
        }
    }
}

/// Accumulates the differences of a replay.
#[derive(Debug, Default)]
pub(super) struct Collector {
    cables: usize,
    command: [DifferenceSum; CABLES],
    sent: [DifferenceSum; CABLES],
    position: DifferenceSum,
    instead: Comparison,
}

impl Collector {
    pub(super) fn new(cables: usize) -> Self {
        Self { cables, ..Self::default() }
    }

    /// Records a controller's answer to a cycle, recorded and recomputed.
    pub(super) fn command(
        &mut self,
        time_s: f64,
        slot: usize,
        authority: &MotorAuthority,
        recorded: &MotorCommand,
        new: &MotorCommand,
    ) {
        let row = usize::from(authority.active_estimator);
        let counts = authority.mode == MotorAuthority::MODE_FOLLOWING
            && usize::from(authority.active_controller) == slot
            && row < recorded.valid.len();
        if !counts {
            return;
        }
        match (recorded.valid[row] == 1, new.valid[row] == 1) {
            (true, true) => {}
            (true, false) => return self.instead.only_recorded += 1,
            (false, true) => return self.instead.only_new += 1,
            (false, false) => return,
        }
        let of = |command: &MotorCommand| -> [f64; CABLES] {
            std::array::from_fn(|i| command.velocity_m_s[CABLES * row + i])
        };
        let (was, is) = (of(recorded), of(new));
        for i in 0..self.cables {
            self.command[i].add(is[i] - was[i]);
        }
        self.instead.curve.push(self.instead.cycles, time_s, was, is);
        self.instead.cycles += 1;
    }

    /// Records the velocities that motor-io sent in a cycle in which it followed a motion.
    pub(super) fn sent(&mut self, authority: &MotorAuthority, recorded: &MotorState, new: &MotorState) {
        if authority.mode == MotorAuthority::MODE_FOLLOWING {
            for i in 0..self.cables {
                self.sent[i].add(new.command_m_s[i] - recorded.command_m_s[i]);
            }
        }
    }

    /// Records the modes of motor-io, recorded and recomputed.
    pub(super) fn mode(&mut self, recorded: &MotorAuthority, new: &MotorAuthority) {
        self.instead.cycles_of_other_mode += u64::from(recorded.mode != new.mode);
    }

    /// Records an estimate, recorded and recomputed.
    pub(super) fn estimate(&mut self, recorded: &NodeEstimate, new: &NodeEstimate) {
        if recorded.valid == 1 && new.valid == 1 {
            let squares = recorded.position_m.iter().zip(&new.position_m).map(|(a, b)| (a - b) * (a - b));
            self.position.add(squares.sum::<f64>().sqrt());
        }
    }

    pub(super) fn end(self) -> Comparison {
        let spreads = |sums: &[DifferenceSum; CABLES]| sums[..self.cables].iter().map(DifferenceSum::spread).collect();
        Comparison {
            command_m_s: spreads(&self.command),
            sent_m_s: spreads(&self.sent),
            position_m: self.position.spread(),
            ..self.instead
        }
    }
}

impl Comparison {
    /// Returns the differences as a text table.
    pub(super) fn words(&self) -> String {
        let mm = |spread: &Spread| format!("{:>10.3} {:>10.3}", 1e3 * spread.rms, 1e3 * spread.max);
        let mut lines = vec![
            format!("over {} cycles with a motion and a command from both:", self.cycles),
            "cable   commanded, mm/s         sent, mm/s".to_owned(),
            "               RMS        max        RMS        max".to_owned(),
        ];
        for (cable, (command, sent)) in self.command_m_s.iter().zip(&self.sent_m_s).enumerate() {
            lines.push(format!("{:<7} {} {}", cable + 1, mm(command), mm(sent)));
        }
        let position = &self.position_m;
        lines.push(format!(
            "estimated position: difference RMS {:.3} mm, max {:.3} mm; motor-io in a different mode in {} cycles",
            1e3 * position.rms,
            1e3 * position.max,
            self.cycles_of_other_mode
        ));
        for (count, who) in [(self.only_recorded, "recorded"), (self.only_new, "changed")] {
            if count > 0 {
                lines.push(format!("in {count} cycles only the {who} controller sent a command"));
            }
        }
        lines.join("\n")
    }

    /// Plots both velocities of each cable over time to `.svg` or `.png`.
    ///
    /// # Errors
    /// An unknown file extension, no data, or a file that cannot be written.
    pub(super) fn draw(&self, path: &Path, title: &str) -> Answer {
        let save = match path.extension().and_then(|ending| ending.to_str()) {
            Some("svg") => plot::save_svg,
            Some("png") => plot::save_png,
            _ => {
                return Err(Failure::BadInput(format!(
                    "--plot is {}; accepted: a file that ends in .svg or .png",
                    path.display()
                )));
            }
        };
        let Some((begin_s, ..)) = self.curve.points.first() else {
            return Err(Failure::NotNow(
                "there is nothing to plot: the robot followed no motion in this run".to_owned(),
            ));
        };
        let charts = (0..self.command_m_s.len()).map(|i| {
            let line = |new: bool| {
                let mut points: Vec<[f64; 2]> = Vec::new();
                for (time_s, was, is) in &self.curve.points {
                    let time_s = time_s - begin_s;
                    if points.last().is_some_and(|last| time_s - last[0] > PAUSE_S * self.curve.stride as f64) {
                        points.push([time_s, f64::NAN]);
                    }
                    points.push([time_s, 1e3 * if new { is[i] } else { was[i] }]);
                }
                points
            };
            Chart {
                caption: format!("cable {}", i + 1),
                x: Axis::auto("time, s"),
                y: Axis::auto("velocity, mm/s"),
                series: vec![
                    Series::line("recorded", GREY, line(false)),
                    Series::line("changed", i, line(true)).with_style(SeriesStyle::Line(1)),
                ],
                legend: Legend::LowerLeft,
                ..Chart::default()
            }
        });
        let charts: Vec<Chart> = charts.collect();
        let size = (1100, 60 + 220 * charts.len() as u32);
        save(path, &Picture { title: title.to_owned(), size, columns: 1, charts })
    }
}
