//! Closed-loop flights: the step functions of motor-io, estimator, controller and planner against the plant.

use super::stand_in;
use anyhow::{Context, Result};
use cable_control::drive_lag::DriveLag;
use cable_robot::{Distribution, Jacobian, Robot, Vector3, elastic};
use config::EstimatorSection;
use controller::{Law, Notice};
use estimator::Method;
use lockstep::{Chain, Cycle, Lockstep, Scenario, core_config};
use messages::{MotorAuthority, PlanStatus};
use motor_io::{Core, CoreConfig};
use planner::Mission;
use plant::PlantConfig;
use plot::Series;
use segments::motion_of;

/// Encoder counts per metre of cable: a wheel of 15 mm radius with 1024 counts per turn.
const COUNTS_PER_M: f64 = 10_865.0;

/// Dynamics of the drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drives {
    /// Description.
    pub name: &'static str,
    /// Delay until a command has an effect, s.
    pub delay_s: f64,
    /// Time constant of the speed response, s.
    pub lag_s: f64,
}

/// Fast, slow and very slow drives.
pub const DRIVES: [Drives; 3] = [
    Drives { name: "30 ms delay, 40 ms lag", delay_s: 0.030, lag_s: 0.040 },
    Drives { name: "60 ms delay, 100 ms lag", delay_s: 0.060, lag_s: 0.100 },
    Drives { name: "100 ms delay, 200 ms lag", delay_s: 0.100, lag_s: 0.200 },
];

/// Configuration of a flight.
#[derive(Debug, Clone)]
pub struct ClosedLoopFlight {
    /// Initial position of the node, m.
    pub start_m: [f64; 3],
    /// Mission file.
    pub mission: String,
    /// Control period, s.
    pub period_s: f64,
    /// Δ, cycles.
    pub horizon: u32,
    /// The drives.
    pub drives: Drives,
    /// Whether stretch is compensated.
    pub stretch: bool,
    /// Stiffness of the plant's cables divided by that of the robot file.
    pub stiffness_share: f64,
    /// Encoder counts per metre of cable.
    pub counts_per_m: f64,
    /// The control law.
    pub law: Law,
}

/// One cycle of a motion.
#[derive(Debug, Clone, Copy)]
pub struct TrackPoint {
    /// Time since the start of the mission, s.
    pub time_s: f64,
    /// Setpoint of the node, m.
    pub setpoint: Vector3<f64>,
    /// Estimated position, m.
    pub estimate: Vector3<f64>,
    /// True position, m.
    pub truth: Vector3<f64>,
    /// Deviation of the measured lengths from those that hold the node at the setpoint with its acceleration, as a
    /// displacement of the node, m.
    pub by_lengths: Vector3<f64>,
    /// Number of the segment, from 1.
    pub segment: u64,
    /// Cable velocity sent, m/s.
    pub command_m_s: [f64; 8],
    /// Measured cable lengths, m.
    pub length_m: [f64; 8],
    /// Measured motor currents, A.
    pub current_a: [f64; 8],
    /// Whether the setpoint moves.
    pub moving: bool,
}

/// Recorded cycles of a flight.
#[derive(Debug, Clone)]
pub struct Track {
    /// Cycle by cycle.
    pub instants: Vec<TrackPoint>,
    /// Whether the mission was completed.
    pub done: bool,
    /// Number of periods that were not steered by a fresh command.
    pub unsteered: u64,
    /// Delay and lag identified by the controller, if any.
    pub identified: Option<DriveLag>,
}

impl ClosedLoopFlight {
    /// Creates a flight with the paper's law, stretch compensation and ten cycles per second.
    pub fn new(start_m: [f64; 3], mission: String, drives: Drives) -> Self {
        let law = Law::LqEndpoint { state_weight: 0.0, input_weight: 1.0 };
        Self {
            start_m,
            mission,
            period_s: 0.1,
            horizon: 4,
            drives,
            stretch: true,
            stiffness_share: 1.0,
            counts_per_m: COUNTS_PER_M,
            law,
        }
    }

    /// Returns the scenario for the lockstep simulation.
    pub fn scenario(&self) -> Result<Scenario> {
        let robot = stand_in::three_cable_robot()?;
        let mut plant = PlantConfig::new(stand_in::three_cable_anchors().to_vec(), self.start_m);
        plant.node.mass_kg = stand_in::MASS_KG;
        plant.start_limits_n = stand_in::LIMITS_N;
        plant.line.stiffness_n *= self.stiffness_share;
        plant.drive.delay_s = self.drives.delay_s;
        plant.drive.lag_s = self.drives.lag_s;
        plant.idlers.iter_mut().for_each(|idler| idler.counts_per_m = self.counts_per_m);
        Ok(Scenario {
            robot,
            plant,
            mission: Mission::parse(&self.mission)?,
            period_s: self.period_s,
            law: self.law,
            horizon: self.horizon,
            method: Method::from_section(&EstimatorSection::default())?,
            stretch: self.stretch,
            distribution: Distribution::Unique,
            longest_s: 300.0,
        })
    }

    /// Flies the mission. If the robot stops by itself, the track is incomplete.
    pub fn fly(&self) -> Result<Track> {
        let scenario = self.scenario()?;
        let robot = if self.stretch { scenario.robot } else { scenario.robot.with_rigid_lines() };
        let mission = scenario.mission.clone();
        let longest = (scenario.longest_s / scenario.period_s) as u64;
        let mut chain = Chain::new(&scenario)?;
        // The laws are compared even where they track poorly, so motor-io's checks of the divergence are disabled.
        let unjudged = CoreConfig { divergence_m: 10.0, correction_limit_m_s: 10.0, ..core_config(&scenario)? };
        chain.core = Core::new(unjudged);
        let mut lockstep = Lockstep::with(scenario, chain)?;
        lockstep.zero_and_arm()?;
        lockstep.run(&mission).context("the planner rejected the mission")?;
        let mut track = Track { instants: Vec::new(), done: false, unsteered: 0, identified: None };
        let mut began_s = None;
        for _ in 0..longest {
            let cycle = lockstep.cycle()?;
            if let Some(Notice::Identified(found)) = lockstep.notice() {
                track.identified.get_or_insert(found.lag);
            }
            track.unsteered = cycle.authority.unsteered();
            if let Some(instant) = instant(&cycle, &robot, &mut began_s) {
                track.instants.push(instant);
            }
            match cycle.plan.state {
                PlanStatus::STATE_DONE => {
                    track.done = true;
                    break;
                }
                PlanStatus::STATE_ABORTED => break,
                _ => {}
            }
        }
        Ok(track)
    }
}

fn instant(cycle: &Cycle, robot: &Robot, began_s: &mut Option<f64>) -> Option<TrackPoint> {
    let Cycle { authority, state, estimate, .. } = cycle;
    if authority.mode != MotorAuthority::MODE_FOLLOWING {
        return None;
    }
    let motion = motion_of(&cycle.motion)?;
    // The truth was sampled after the answers of the drives.
    let since_s = (state.header.stamp_ns - cycle.input.begin_ns) as f64 * 1e-9;
    let time_s = authority.plan_time_s + authority.plan_rate * since_s;
    let setpoint = motion.setpoint(time_s);
    let rate = authority.plan_rate;
    let held =
        elastic::realise(robot, &setpoint.position, &(setpoint.acceleration * (rate * rate)), Distribution::Unique)
            .ok()?;
    let off_m = held.unstretched_m.zip_map(&estimate.predicted_m, |wanted, is| is - wanted);
    let node_jacobian = Jacobian::at(robot.anchors(), &setpoint.position).ok()?.node_jacobian()?;
    Some(TrackPoint {
        time_s: time_s - *began_s.get_or_insert(time_s),
        setpoint: setpoint.position,
        estimate: Vector3::from(estimate.position_m),
        truth: Vector3::from(cycle.truth_m),
        by_lengths: node_jacobian.node_velocity(&off_m),
        segment: setpoint.segment_id,
        command_m_s: state.command_m_s,
        length_m: state.length_m,
        current_a: state.current_a,
        moving: !setpoint.at_rest,
    })
}

impl Track {
    /// Returns a distance of each cycle with a moving setpoint, m.
    pub fn distances(&self, of: impl Fn(&TrackPoint) -> f64) -> Vec<f64> {
        self.instants.iter().filter(|instant| instant.moving).map(of).collect()
    }

    /// Returns the distances of the estimate from the setpoint, the paper's measure, m.
    pub fn by_estimate(&self) -> Vec<f64> {
        self.distances(|instant| (instant.estimate - instant.setpoint).norm())
    }

    /// Returns the distances of the truth from the setpoint, m.
    pub fn errors_of_truth_m(&self) -> Vec<f64> {
        self.distances(|instant| (instant.truth - instant.setpoint).norm())
    }

    /// Returns the deviations of the measured lengths as displacements of the node, m.
    pub fn by_lengths(&self) -> Vec<f64> {
        self.distances(|instant| instant.by_lengths.norm())
    }

    /// Returns a quantity over time.
    pub fn over_time(&self, name: &str, colour: usize, of: impl Fn(&TrackPoint) -> f64) -> Series {
        let step = (self.instants.len() / 1500).max(1);
        let points = self.instants.iter().step_by(step).map(|instant| [instant.time_s, of(instant)]).collect();
        Series::line(name, colour, points)
    }

    /// Returns a path, projected by `onto`.
    pub fn path(
        &self,
        name: &str,
        colour: usize,
        of: impl Fn(&TrackPoint) -> Vector3<f64>,
        onto: impl Fn(&Vector3<f64>) -> [f64; 2],
    ) -> Series {
        let step = (self.instants.len() / 600).max(1);
        Series::line(name, colour, self.instants.iter().step_by(step).map(|instant| onto(&of(instant))).collect())
    }
}

/// Projects a point obliquely from above: x to the right and down, y to the right and up, z up.
pub fn oblique(point: &Vector3<f64>) -> [f64; 2] {
    // 30 degrees to each side, seen from 25 degrees above.
    const COS: f64 = 0.866_025_403_784_438_6;
    const SIN: f64 = 0.5;
    const LIFT: f64 = 0.422_618_261_740_699_4;
    const UP: f64 = 0.906_307_787_036_65;
    [COS * point.x + SIN * point.y, LIFT * (COS * point.y - SIN * point.x) + UP * point.z]
}
