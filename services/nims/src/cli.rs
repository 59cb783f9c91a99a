//! What can be typed. Values are checked here once; behind this module a number is finite and a point has two or three.

mod bench;
mod values;

use clap::{Parser, Subcommand, ValueEnum};
use config::Point;
use std::path::PathBuf;
use values::{above_zero, assignment, finite, not_negative, numbers, point, seconds};

pub use bench::{Bench, Part};
pub use values::Numbers;

/// Run, watch and command a cable-suspended robot.
///
/// Exit code 0: answered; 2: bad input; 1: it could not be done now. Diagnostics go to stderr.
#[derive(Debug, Parser)]
#[command(name = "nims", version = runtime::build::own(), propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// The robot's domain: the name of its box, or the path of a folder; default: the only one that runs.
    #[arg(long, global = true, value_name = "NAME")]
    pub domain: Option<String>,
    /// Print one JSON object on stdout.
    #[arg(long, global = true)]
    pub json: bool,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The whole thing on the virtual motor box: up, mission, report; ends by itself.
    Demo(Demo),
    /// Start every process of a box and watch them; Ctrl-C holds the robot, stops them and closes the run file.
    Up(Up),
    /// What the robot and its processes are doing.
    Status,
    /// The same, live in the terminal; q quits.
    Top,
    /// Look at channels.
    #[command(subcommand)]
    Channel(Channel),
    /// Take the robot from Disarmed to Holding.
    Arm,
    /// Release the motors of a robot at rest: the node sinks.
    Disarm,
    /// Slow down on the path and hold, keeping the motion.
    Hold,
    /// Slow down on the path and hold, dropping the motion.
    Stop,
    /// Stop the motors at once; `reset` afterwards.
    Estop,
    /// Leave a fault or an emergency stop, once its cause is gone.
    Reset,
    /// Say where the node is now.
    Zero(Zero),
    /// After a restart: the position from before is still right.
    ConfirmPosition,
    /// Pay out one line slowly (negative: reel in).
    #[command(allow_negative_numbers = true)]
    Jog {
        /// Which line, from 1.
        #[arg(value_parser = clap::value_parser!(u8).range(1..=8))]
        cable: u8,
        /// How far, m; positive pays out.
        #[arg(value_parser = finite, allow_negative_numbers = true)]
        metres: f64,
    },
    /// Move the node to a point.
    Goto(Goto),
    /// Fly a mission.
    Run(Run),
    /// Slow down on the path, keeping the mission.
    Pause,
    /// Go on after pause or hold.
    Resume,
    /// Slow a mission down, or back to full speed.
    Speed {
        /// Percent of the planned speed, 5 to 100.
        #[arg(value_parser = finite, allow_negative_numbers = true)]
        percent: f64,
    },
    /// Start a process: a role such as controller, or a [[process]] of the box file.
    Start(Start),
    /// End a process in good order.
    StopProcess {
        /// Its name in the process table.
        process: String,
    },
    /// End a process in good order and start it again.
    Restart {
        /// Its name in the process table.
        process: String,
    },
    /// Start a program that the box file does not know, e.g. a sensor, as one of the robot's processes.
    Plug(Plug),
    /// End a process that was plugged in, and forget it.
    Unplug {
        /// Its name in the process table.
        process: String,
    },
    /// Write a sensor of one's own that runs as it is, to be changed: in Rust, or in Python.
    NewSensor(NewSensor),
    /// Break something in the virtual motor box, or a process, on purpose; `nims fault list` says what there is.
    Fault {
        /// What: `list`, or e.g. `stall 2`, `noise 1 0.01`, `stop controller`, `nan estimator`.
        #[arg(required = true, allow_negative_numbers = true)]
        words: Vec<String>,
        /// Put it right after so many seconds.
        #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
        seconds: Option<f64>,
    },
    /// Let another controller or estimator take over while the robot moves.
    Swap(Swap),
    /// Set a parameter of the controllers or estimators while the robot runs, for all of them and until the run ends; without a value,
    /// show it.
    #[command(after_help = crate::set::help())]
    Set(Set),
    /// Check a robot, box, mission, sensor or ground file; each finding with its cure.
    Check {
        /// The file.
        config: PathBuf,
        /// For a mission: the robot or box file it is meant for.
        #[arg(long = "for", value_name = "CONFIG")]
        on: Option<PathBuf>,
    },
    /// Look at this machine: memory, stale robots, limits, ports, clock, disk; each finding with its cure. Exit code 1: one would stop the robot.
    Doctor {
        /// Box file, whose ports, runs folder and scheduling are looked at too.
        config: Option<PathBuf>,
    },
    /// Measure whether this machine is good enough for a robot, each figure beside the plain way of doing the same.
    Bench(Bench),
    /// The other process of `nims bench`.
    #[command(hide = true)]
    BenchPeer {
        /// The domain of the benchmark.
        #[arg(value_name = "DOMAIN")]
        place: String,
    },
    /// Cable lengths for a position of the node.
    Ik {
        /// Robot file.
        #[arg(long)]
        config: PathBuf,
        /// Where the node is, m.
        #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
        at: Point,
    },
    /// Position of the node for cable lengths.
    Fk {
        /// Robot file.
        #[arg(long)]
        config: PathBuf,
        /// One length per cable, m.
        #[arg(long, value_name = "A,B,..", value_parser = numbers, allow_hyphen_values = true)]
        lengths: Numbers,
    },
    /// Cable tensions for a position and acceleration of the node.
    Tension(Tension),
    /// Anchors with their deviations from measurements in the field, or why these do not determine them.
    Calibrate(Calibrate),
    /// Calibrate in the field by answering one question at a time; what was answered is kept, and the same command goes on.
    Setup(Setup),
    /// What the motors draw over speed and tension, from recorded runs of raising and lowering known loads.
    MotorTable(MotorTable),
    /// What a move costs, and the parabola that costs least.
    Plan(Plan),
    /// Where the lines can hold the node at rest: volume and margins.
    Workspace(Workspace),
    /// Every formula from any language: one JSON object per line in, one per line out.
    Solve,
    /// Every figure and table of the paper from this code, on one page with what the paper claims.
    Paper {
        /// Which, such as fig3 or table8; default: all.
        figures: Vec<String>,
        /// Folder for the page and its pictures.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// The channels of a run as tables for other tools, one file each, whatever type they have.
    Export(Export),
    /// What the sensors of a run measured as maps with uncertainty: contour pictures, grids, point clouds, tables.
    Map(Map),
    /// Restore run files that were not closed or are damaged.
    Recover {
        /// Run folder, or a file that ends in .mcap.part or .mcap.
        run: PathBuf,
    },
    /// Compute a run again from what was recorded and compare every bit; with --law or --set: what would have been commanded instead.
    Replay(Replay),
    /// A run as one page: what was flown, how well, what happened; several runs side by side.
    Report {
        /// Run folders or files.
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// The page; default: report.html in the run folder (comparison.html for several runs, in the first one's).
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// What is in a run: length, channels, rates, gaps, health.
    Info {
        /// Run folder or file.
        run: PathBuf,
    },
}

/// `nims export`.
#[derive(Debug, clap::Args)]
pub struct Export {
    /// Run folder or file.
    pub run: PathBuf,
    /// Folder for the tables; default: `export` in the run folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// How they are written.
    #[arg(long, value_enum, default_value = "csv")]
    pub format: TableFormat,
    /// Only this channel; a trailing * stands for any ending. May be given several times.
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Only from this time on, s since the run began.
    #[arg(long, value_name = "SECONDS", value_parser = finite, allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Only before this time, s since the run began.
    #[arg(long, value_name = "SECONDS", value_parser = finite, allow_negative_numbers = true)]
    pub to: Option<f64>,
    /// In place of tables: as Foxglove, Lichtblick, RViz and rerun draw it in three dimensions, to this new file.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["out", "format", "channel", "from", "to"])]
    pub visualization: Option<PathBuf>,
}

/// `nims map`.
#[derive(Debug, clap::Args)]
pub struct Map {
    /// Run folder or file.
    pub run: PathBuf,
    /// Folder for the files; default: map in the run folder, or beside the run file.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Only this sensor, NAME of sensor/NAME. May be given several times.
    #[arg(long, value_name = "NAME")]
    pub sensor: Vec<String>,
    /// Side of a cell, m; default: a round size, of which about 80 cover what was measured.
    #[arg(long, value_name = "M", value_parser = above_zero)]
    pub cell: Option<f64>,
    /// How far a sample speaks for its surroundings, m: half the distance of neighbouring tracks or more; default: four cells.
    #[arg(long, value_name = "M", value_parser = above_zero)]
    pub reach: Option<f64>,
    /// Which of a sensor's values, from 1; default: as the box file says, else the first.
    #[arg(long, value_name = "N", requires = "sensor", value_parser = clap::value_parser!(u8).range(1..=8))]
    pub value: Option<u8>,
    /// The value is a distance straight down, m: map the height of what is there.
    #[arg(long, requires = "sensor")]
    pub looks_down: bool,
    /// Standard deviation of a value, in its unit; default: as the box file says, else estimated from the scatter.
    #[arg(long, value_name = "SIGMA", requires = "sensor", value_parser = above_zero)]
    pub sigma: Option<f64>,
    /// Diameter of what the sensor sees at once, m; default: as the box file says, else a point.
    #[arg(long, value_name = "M", requires = "sensor", value_parser = above_zero)]
    pub footprint: Option<f64>,
    /// Find the place of every reading anew, also where the sensor logger did so in flight.
    #[arg(long)]
    pub recompute: bool,
}

/// How tables are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TableFormat {
    /// Text, a line per sample.
    Csv,
    /// One structured NumPy array per channel, the samples as they lay in memory.
    Npy,
    /// Compressed columns for pandas, polars, DuckDB.
    Parquet,
}

impl From<TableFormat> for runlog::export::Format {
    fn from(format: TableFormat) -> Self {
        match format {
            TableFormat::Csv => Self::Csv,
            TableFormat::Npy => Self::Npy,
            TableFormat::Parquet => Self::Parquet,
        }
    }
}

/// Roles that have two slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum SlottedRole {
    /// Position and motion to velocities.
    Controller,
    /// Lengths to position.
    Estimator,
}

impl SlottedRole {
    /// Index in the arrays of samples.
    #[must_use]
    pub fn index(self) -> usize {
        match self {
            Self::Controller => messages::CONTROLLERS,
            Self::Estimator => messages::ESTIMATORS,
        }
    }
}

/// `nims swap`.
#[derive(Debug, clap::Args)]
pub struct Swap {
    /// Whose.
    #[arg(value_enum)]
    pub role: SlottedRole,
    /// Law or method, or the name of a `[[process]]` of that role; it is started in the free slot. Default: the standby that runs there.
    pub name: Option<String>,
    /// Slot of the new one. Default: the one that is not in charge.
    #[arg(long, value_enum)]
    pub slot: Option<config::Slot>,
    /// Keep the old one running, as a standby.
    #[arg(long)]
    pub keep: bool,
    /// Only admit again a slot that was set aside because it came and went.
    #[arg(long, conflicts_with_all = ["name", "keep"])]
    pub admit: bool,
}

/// `nims set`.
#[derive(Debug, clap::Args)]
pub struct Set {
    /// Which parameter, as in the box file, e.g. controller.length_gain_per_s; default: all, to be shown.
    pub key: Option<String>,
    /// Its new value, written as in the box file.
    #[arg(allow_hyphen_values = true)]
    pub value: Option<String>,
}

/// `nims demo`.
#[derive(Debug, clap::Args)]
pub struct Demo {
    /// Box file; default: configs/systems/demo3.toml.
    pub config: Option<PathBuf>,
    /// Mission file; default: the one that the box names, `demo` if it names none.
    #[arg(long)]
    pub mission: Option<PathBuf>,
    /// Run folder; default: a new one in the box's runs folder.
    #[arg(long, value_name = "DIR")]
    pub run: Option<PathBuf>,
}

/// `nims up`.
#[derive(Debug, clap::Args)]
pub struct Up {
    /// Box file.
    pub config: PathBuf,
    /// Stop after this many seconds.
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Run folder; default: a new one in the box's runs folder.
    #[arg(long, value_name = "DIR")]
    pub run: Option<PathBuf>,
}

/// `nims start`.
#[derive(Debug, clap::Args)]
pub struct Start {
    /// A role, the name of a process in the process table, or a [[process]] of the box file.
    pub process: String,
    /// For a controller or an estimator: which slot; default: the first free one.
    #[arg(long, value_enum)]
    pub slot: Option<config::Slot>,
    /// For a controller or an estimator: which law, or which [[process]]; default: as configured.
    #[arg(long)]
    pub law: Option<String>,
}

/// `nims plug`.
#[derive(Debug, clap::Args)]
pub struct Plug {
    /// What it shall be called: 1 to 16 of a-z, 0-9, dash.
    pub name: String,
    /// If a process of that name runs: start this one beside it, and end the other when this one has said its first valid sample.
    #[arg(long)]
    pub replace: bool,
    /// Program and arguments, behind `--`; {name}, {domain}, {box} and {run} stand for its name, the robot's domain, the box file, the run folder.
    #[arg(last = true, required = true)]
    pub command: Vec<String>,
}

/// `nims new-sensor`.
#[derive(Debug, clap::Args)]
pub struct NewSensor {
    /// What it is called, and its channel sensor/NAME: 1 to 16 of a-z, 0-9, dash.
    pub name: String,
    /// One file in Python in place of a folder in Rust.
    #[arg(long)]
    pub python: bool,
    /// The sources of nims, for a sensor in Rust. Default: where this program was built from.
    #[arg(long, value_name = "FOLDER", conflicts_with = "python")]
    pub nims: Option<PathBuf>,
}

/// `nims channel`.
#[derive(Debug, Subcommand)]
pub enum Channel {
    /// Every channel with its type.
    List,
    /// How often samples arrive, and how many are lost on the way.
    Hz {
        /// Channel; default: all.
        name: Option<String>,
        /// For how long to count, s.
        #[arg(long = "for", value_name = "SECONDS", default_value = "3", value_parser = seconds, allow_negative_numbers = true)]
        seconds: f64,
    },
    /// Print samples of any type as they come, one JSON object per line.
    Echo {
        /// Channel.
        name: String,
        /// Stop after this many samples.
        #[arg(long, short = 'n', value_name = "N")]
        count: Option<u64>,
        /// Stop after this many seconds.
        #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
        seconds: Option<f64>,
    },
}

/// `nims zero`: one of the two.
#[derive(Debug, clap::Args)]
#[group(required = true, multiple = false)]
pub struct Zero {
    /// The node is here, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Option<Point>,
    /// These lengths of line are paid out, m.
    #[arg(long, value_name = "A,B,..", value_parser = numbers, allow_hyphen_values = true)]
    pub lengths: Option<Numbers>,
}

/// `nims goto`.
#[derive(Debug, clap::Args)]
pub struct Goto {
    /// Where to, m.
    #[arg(value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub to: Point,
    /// Along which path.
    #[arg(long, value_enum, default_value = "line")]
    pub path: PathKind,
    /// How much a parabola sags, 1/m, above 0; default: what loses least in the motors.
    #[arg(long, value_name = "PER_M", value_parser = finite, allow_negative_numbers = true)]
    pub mu: Option<f64>,
    /// Cruise speed, m/s; default: the planner's.
    #[arg(long, value_name = "M_S", value_parser = finite, allow_negative_numbers = true)]
    pub speed: Option<f64>,
}

/// Shape of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PathKind {
    /// Straight.
    Line,
    /// A parabola in a vertical plane.
    Parabola,
    /// Sags and swings sideways so that it loses least in the motors.
    Lateral,
}

/// `nims run`.
#[derive(Debug, clap::Args)]
pub struct Run {
    /// Mission file, or the name of one in the box's missions folder.
    pub mission: PathBuf,
    /// Check the whole mission and say how long it takes, without moving.
    #[arg(long)]
    pub dry_run: bool,
    /// Fly what is left of it after it was broken off, by whatever.
    #[arg(long = "continue", conflicts_with = "dry_run")]
    pub go_on: bool,
    /// Fly it although nothing is being recorded.
    #[arg(long, conflicts_with = "dry_run")]
    pub unrecorded: bool,
    /// For a dry run without a running robot: its robot or box file.
    #[arg(long, requires = "dry_run")]
    pub config: Option<PathBuf>,
    /// For a dry run: where the mission begins, m; default: where the node is.
    #[arg(long, requires = "dry_run", value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub from: Option<Point>,
}

/// `nims tension`.
#[derive(Debug, clap::Args)]
pub struct Tension {
    /// Robot file.
    #[arg(long)]
    pub config: PathBuf,
    /// Where the node is, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Point,
    /// Acceleration of the node, m/s²; default: none.
    #[arg(long, value_name = "AX,AY,AZ|AX,AZ", value_parser = point, allow_hyphen_values = true)]
    pub accel: Option<Point>,
    /// Which of the possible tensions; default: unique for as many cables as directions, least-norm for more.
    #[arg(long, value_enum)]
    pub method: Option<Method>,
}

/// `nims calibrate`.
#[derive(Debug, clap::Args)]
pub struct Calibrate {
    /// Measurements file; configs/measurements holds commented examples.
    pub measurements: PathBuf,
    /// Which way.
    #[arg(long, value_enum, default_value = "survey")]
    pub method: CalibrationMethod,
    /// Write the calibration, its covariance and the measurements to this new file.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Do not calibrate, but say where to hold the node for so many points, and how well the anchors will be known then.
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u8).range(3..), conflicts_with = "out")]
    pub plan: Option<u8>,
    /// With --plan: about how high the pulleys are, m, where the measurements do not tell it yet.
    #[arg(long, value_name = "M", value_parser = above_zero, requires = "plan")]
    pub height: Option<f64>,
}

/// `nims setup`.
#[derive(Debug, clap::Args)]
pub struct Setup {
    /// Measurements file to begin, or to go on with.
    pub measurements: PathBuf,
    /// Where the calibration goes, a new file; default: beside the measurements, SITE-calibration.toml.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// `nims motor-table`.
#[derive(Debug, clap::Args)]
pub struct MotorTable {
    /// Run folders or files. The robot file of each run must say what hung on the lines (node_mass_kg).
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Write the table to this new file, for `table` in `[motor]` of a robot file.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Reel-in speeds of the table, m/s, rising, below 0 for paying out; default: as far as the runs go.
    #[arg(long, value_name = "A,B,..", value_parser = numbers, allow_hyphen_values = true)]
    pub speeds: Option<Numbers>,
    /// Tensions of the table, N, rising; default: as far as the runs go.
    #[arg(long, value_name = "A,B,..", value_parser = numbers)]
    pub tensions: Option<Numbers>,
}

/// `nims replay`.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("another").args(["law", "set"]).multiple(true)))]
pub struct Replay {
    /// Run folder or file.
    pub run: PathBuf,
    /// Another law for the controllers.
    #[arg(long, value_name = "LAW")]
    pub law: Option<String>,
    /// Another value for a key of the box file or the robot file, e.g. controller.horizon_cycles=30; as often as needed.
    #[arg(long, value_name = "KEY=VALUE", value_parser = assignment)]
    pub set: Vec<(String, String)>,
    /// With --law or --set: draw both velocities of each cable into this .svg or .png file.
    #[arg(long, value_name = "FILE", requires = "another")]
    pub plot: Option<PathBuf>,
}

/// Ways to calibrate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CalibrationMethod {
    /// x and y by ranges between plumb lines, heights by lengths to points of the reference plane.
    Survey,
    /// Everything at once by maximum likelihood; optionally scale and zeros of the lengths, and outliers.
    Joint,
    /// Every anchor from points with known positions.
    Gps,
}

/// `nims plan`.
#[derive(Debug, clap::Args)]
pub struct Plan {
    /// Robot file.
    #[arg(long)]
    pub config: PathBuf,
    /// Where the move starts, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub from: Point,
    /// Where it ends, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub to: Point,
    /// Along which path; default: a line, or with --mu a parabola. A parabola without --mu and a lateral path are those that cost
    /// least.
    #[arg(long, value_enum)]
    pub path: Option<PathKind>,
    /// How much the parabola sags, 1/m.
    #[arg(long, value_name = "PER_M", value_parser = finite, allow_negative_numbers = true)]
    pub mu: Option<f64>,
    /// What a second costs beside the losses in the motors, W.
    #[arg(long, value_name = "W", value_parser = not_negative, allow_negative_numbers = true, default_value = "0")]
    pub time_weight: f64,
    /// Which of the possible tensions; default: unique for as many cables as directions, least-norm for more.
    #[arg(long, value_enum)]
    pub method: Option<Method>,
    /// Cruise speed, m/s; default: the robot's limit.
    #[arg(long, value_name = "M_S", value_parser = finite, allow_negative_numbers = true)]
    pub speed: Option<f64>,
    /// Reckon with a constant speed and no accelerations, as the paper does.
    #[arg(long)]
    pub constant_speed: bool,
}

/// `nims workspace`.
#[derive(Debug, clap::Args)]
pub struct Workspace {
    /// Robot file.
    #[arg(long)]
    pub config: PathBuf,
    /// Picture of slices at several heights; of a planar robot, of its plane.
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Size of a cell, m; default: a fortieth of the longest side.
    #[arg(long, value_name = "M", value_parser = finite, allow_negative_numbers = true)]
    pub step: Option<f64>,
}

/// Which tensions are chosen among the possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// The only ones (as many cables as directions).
    Unique,
    /// Least sum of squares.
    LeastNorm,
    /// Least sum.
    MinSum,
    /// Farthest from both limits.
    Safest,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn negative_coordinates_are_not_taken_for_options() {
        for line in
            [&["nims", "goto", "-1,2,0.5"][..], &["nims", "zero", "--at", "-1,2,0.5"], &["nims", "jog", "1", "-0.1"]]
        {
            assert!(Cli::try_parse_from(line).is_ok(), "{line:?}");
        }
    }
}
