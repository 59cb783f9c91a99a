//! What can be typed. Values are checked here once; behind this module a number is finite and a point has three of them.

use clap::{Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Run, watch and command a cable-suspended robot.
///
/// Exit code 0: answered; 2: bad input; 1: it could not be done now. Diagnostics go to stderr.
#[derive(Debug, Parser)]
#[command(name = "nims", version, propagate_version = true)]
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
    /// Check a robot, box or mission file; each finding with its cure.
    Check {
        /// The file.
        config: PathBuf,
        /// For a mission: the robot or box file it is meant for.
        #[arg(long = "for", value_name = "CONFIG")]
        on: Option<PathBuf>,
    },
    /// Cable lengths for a position of the node.
    Ik {
        /// Robot file.
        #[arg(long)]
        config: PathBuf,
        /// Where the node is, m.
        #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
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
    /// Restore a run file that was not closed.
    Recover {
        /// Run folder, or a file that ends in .mcap.part or .mcap.
        run: PathBuf,
    },
    /// What is in a run: length, channels, rates, gaps, health.
    Info {
        /// Run folder or file.
        run: PathBuf,
    },
}

/// `nims demo`.
#[derive(Debug, clap::Args)]
pub struct Demo {
    /// Box file; default: configs/boxes/demo3.toml.
    pub config: Option<PathBuf>,
    /// Mission file; default: demo.toml of the box's missions.
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
    #[arg(long = "for", value_name = "SECONDS", value_parser = finite, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Run folder; default: a new one in the box's runs folder.
    #[arg(long, value_name = "DIR")]
    pub run: Option<PathBuf>,
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
        #[arg(long = "for", value_name = "SECONDS", default_value = "3", value_parser = finite, allow_negative_numbers = true)]
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
        #[arg(long = "for", value_name = "SECONDS", value_parser = finite, allow_negative_numbers = true)]
        seconds: Option<f64>,
    },
}

/// `nims zero`: one of the two.
#[derive(Debug, clap::Args)]
#[group(required = true, multiple = false)]
pub struct Zero {
    /// The node is here, m.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Option<Point>,
    /// These lengths of line are paid out, m.
    #[arg(long, value_name = "A,B,..", value_parser = numbers, allow_hyphen_values = true)]
    pub lengths: Option<Numbers>,
}

/// `nims goto`.
#[derive(Debug, clap::Args)]
pub struct Goto {
    /// Where to, m.
    #[arg(value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
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
}

/// `nims run`.
#[derive(Debug, clap::Args)]
pub struct Run {
    /// Mission file, or the name of one in the box's missions folder.
    pub mission: PathBuf,
    /// Check the whole mission and say how long it takes, without moving.
    #[arg(long)]
    pub dry_run: bool,
    /// For a dry run without a running robot: its robot or box file.
    #[arg(long, requires = "dry_run")]
    pub config: Option<PathBuf>,
    /// For a dry run: where the mission begins, m; default: where the node is.
    #[arg(long, requires = "dry_run", value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub from: Option<Point>,
}

/// `nims tension`.
#[derive(Debug, clap::Args)]
pub struct Tension {
    /// Robot file.
    #[arg(long)]
    pub config: PathBuf,
    /// Where the node is, m.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Point,
    /// Acceleration of the node, m/s².
    #[arg(long, value_name = "AX,AY,AZ", value_parser = point, allow_hyphen_values = true, default_value = "0,0,0")]
    pub accel: Point,
    /// Which of the possible tensions; default: unique for three cables, least-norm for more.
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
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub from: Point,
    /// Where it ends, m.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub to: Point,
    /// Along which path; default: a line, or with --mu a parabola. A parabola without --mu is the one that costs least.
    #[arg(long, value_enum)]
    pub path: Option<PathKind>,
    /// How much the parabola sags, 1/m.
    #[arg(long, value_name = "PER_M", value_parser = finite, allow_negative_numbers = true)]
    pub mu: Option<f64>,
    /// What a second costs beside the losses in the motors, W.
    #[arg(long, value_name = "W", value_parser = finite, allow_negative_numbers = true, default_value = "0")]
    pub time_weight: f64,
    /// Which of the possible tensions; default: unique for three cables, least-norm for more.
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
    /// Picture of slices at several heights.
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Size of a cell, m; default: a fortieth of the longest side.
    #[arg(long, value_name = "M", value_parser = finite, allow_negative_numbers = true)]
    pub step: Option<f64>,
}

/// Which tensions are chosen among the possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// The only ones (three cables).
    Unique,
    /// Least sum of squares.
    LeastNorm,
    /// Least sum.
    MinSum,
    /// Farthest from both limits.
    Safest,
}

/// Three finite numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point(pub [f64; 3]);

/// Finite numbers, at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

fn finite(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("`{text}` is not a number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("{text} is not a finite number")) }
}

fn numbers(text: &str) -> Result<Numbers, String> {
    text.split(',')
        .map(finite)
        .collect::<Result<_, _>>()
        .map(Numbers)
        .map_err(|why| format!("{why}; give numbers separated by commas"))
}

fn point(text: &str) -> Result<Point, String> {
    let Numbers(values) = numbers(text)?;
    let given = values.len();
    values
        .try_into()
        .map(Point)
        .map_err(|_| format!("it has {given} numbers; give three separated by commas, e.g. 4.8,3.0,0.3"))
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
    fn points_are_three_finite_numbers() {
        assert_eq!(point("-1, 2,3e-1"), Ok(Point([-1.0, 2.0, 0.3])));
        for bad in ["", "1,2", "1,2,3,4", "1,2,nan", "1,2,inf", "1;2;3", "1,2,3m"] {
            assert!(point(bad).is_err(), "{bad}");
        }
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
