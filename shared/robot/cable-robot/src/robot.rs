//! The checked configuration of a robot for all processes: geometry, mass, limits, cables and motors.

use nalgebra::{Matrix3, Vector3};

use crate::calibrated::Calibrated;
use crate::drum::Drum;
use crate::energy::{Current, MotorTable, Motors};
use crate::keep_out::{KeepOut, MAX_KEEP_OUT};
use crate::motor::{DriveLimits, DriveLoad, Motor};
use crate::obstacle::{MAX_OBSTACLES, Obstacle};
use crate::robot_error::{FARTHEST_M, RobotError, not_negative, positive, refuse};
use crate::robot_parts::{
    RobotParts, drums, keep_out_boxes, length_limits, motors, obstacle_places, routed_lengths, stretched_counts,
    with_pulleys,
};
use crate::sag::{self, Load};
use crate::uncertainty::LengthErrors;
use crate::{Anchors, CableVec, Distribution, MAX_CABLES, STANDARD_GRAVITY, Uncertainty};

/// A checked robot. It is `Copy`, so that every process and every test has its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Robot {
    anchors: Anchors,
    node_mass_kg: f64,
    net_weight_n: f64,
    drag_n_s2_m2: f64,
    tension_limits_n: [f64; 2],
    speed_limit_m_s: f64,
    cable_speed_limit_m_s: f64,
    acceleration_limit_m_s2: f64,
    ground_m: f64,
    keep_out: [KeepOut; MAX_KEEP_OUT],
    keep_out_count: usize,
    obstacles: [Option<Obstacle>; MAX_OBSTACLES],
    clearance_m: f64,
    stiffness_n: Option<f64>,
    /// Weight of the cables, N/m.
    cable_weight_n_m: f64,
    /// Bit i: the idler of cable i counts the cable as stretched as it passes.
    counts_stretched: u8,
    routed_length_m: CableVec,
    drums: [Drum; MAX_CABLES],
    /// The encoders count turns of the drums.
    counts_turns: bool,
    length_limits_m: [[f64; 2]; MAX_CABLES],
    motor: Motor,
    motors: Motors,
    drive_limits: DriveLimits,
    calibrated: Option<Calibrated>,
    uncertainty: Uncertainty,
    /// Errors of the lengths where they were set; `None`: unknown.
    errors_at_zero: Option<LengthErrors>,
}

impl Robot {
    /// Checks a description. The error names the key and the accepted values.
    pub fn new(parts: RobotParts) -> Result<Self, RobotError> {
        let anchors = if parts.planar { Anchors::in_plane(&parts.anchors_m)? } else { Anchors::new(&parts.anchors_m)? };
        let anchors = with_pulleys(anchors, parts.pulley, parts.pulley_radius_m.as_deref())?;
        let n = anchors.len();
        positive("node_mass_kg", parts.node_mass_kg, "a finite mass above 0, in kilograms")?;
        let net_weight_n = parts.net_weight_n.unwrap_or(parts.node_mass_kg * STANDARD_GRAVITY);
        if !(net_weight_n.is_finite() && net_weight_n >= 0.0) {
            return refuse("net_weight_n", format!("is {net_weight_n}"), "a finite force of 0 or more, in newtons");
        }
        not_negative("drag_n_s2_m2", parts.drag_n_s2_m2, "a finite drag of 0 or more, in N s²/m²")?;
        let [low, high] = parts.tension_limits_n;
        if !(low.is_finite() && low >= 0.0 && high > low) {
            let problem = format!("is [{low}, {high}]");
            return refuse("tension_limits_n", problem, "[min, max] in newtons with 0 <= min < max");
        }
        positive("speed_limit_m_s", parts.speed_limit_m_s, "a finite speed above 0, in metres per second")?;
        let cable_speed_limit_m_s = parts.cable_speed_limit_m_s.unwrap_or(2.0 * parts.speed_limit_m_s);
        positive("cable_speed_limit_m_s", cable_speed_limit_m_s, "a finite speed above 0, in metres per second")?;
        positive("acceleration_limit_m_s2", parts.acceleration_limit_m_s2, "a finite acceleration above 0, in m/s²")?;
        if !(parts.ground_m.is_finite() && parts.ground_m.abs() <= FARTHEST_M) {
            return refuse("ground_m", format!("is {}", parts.ground_m), "a finite height in metres");
        }
        let (keep_out, keep_out_count) = keep_out_boxes(&parts.keep_out_m)?;
        let obstacles = obstacle_places(&parts.obstacles)?;
        not_negative("clearance_m", parts.clearance_m, "a finite distance of 0 or more, in metres")?;
        if let Some(stiffness) = parts.stiffness_n {
            positive("stiffness_n", stiffness, "a finite EA above 0, in newtons, or no key for rigid cables")?;
        }
        not_negative("mass_kg_m", parts.cable_mass_kg_m, "a finite mass of 0 or more, in kilograms per metre")?;
        let counts_stretched = stretched_counts(parts.counts_stretched.as_deref(), n)?;
        let routed_length_m = routed_lengths(parts.routed_length_m.as_deref(), n)?;
        let drums = drums(parts.drum.as_ref(), &routed_length_m, counts_stretched)?;
        let length_limits_m = length_limits(parts.length_limits_m.as_deref(), &drums[..n])?;
        parts.motor.check()?;
        parts.drive_limits.check()?;
        let motors = motors(parts.motor, &parts.motor_tables, n)?.on(drums);
        parts.uncertainty.check()?;
        let calibrated = Calibrated::new(parts.anchor_covariance_m2.as_deref(), parts.length_covariance.as_deref(), n)?;
        Ok(Self {
            anchors,
            node_mass_kg: parts.node_mass_kg,
            net_weight_n,
            drag_n_s2_m2: parts.drag_n_s2_m2,
            tension_limits_n: parts.tension_limits_n,
            speed_limit_m_s: parts.speed_limit_m_s,
            cable_speed_limit_m_s,
            acceleration_limit_m_s2: parts.acceleration_limit_m_s2,
            ground_m: parts.ground_m,
            keep_out,
            keep_out_count,
            obstacles,
            clearance_m: parts.clearance_m,
            stiffness_n: parts.stiffness_n,
            cable_weight_n_m: parts.cable_mass_kg_m * STANDARD_GRAVITY,
            counts_stretched,
            routed_length_m,
            drums,
            counts_turns: parts.drum.as_ref().is_some_and(|drum| drum.counted),
            length_limits_m,
            motor: parts.motor,
            motors,
            drive_limits: parts.drive_limits,
            calibrated,
            uncertainty: parts.uncertainty,
            errors_at_zero: None,
        })
    }

    /// Number of cables.
    pub fn cable_count(&self) -> usize {
        self.anchors.len()
    }

    /// Number of directions in which the node moves: 3, or 2 in the plane y = 0.
    pub fn dimensions(&self) -> usize {
        self.anchors.dimensions()
    }

    /// True if the node moves in the plane y = 0 only.
    pub fn is_planar(&self) -> bool {
        self.anchors.is_planar()
    }

    /// Number of cables beyond the number of directions: the degrees of freedom of the tensions.
    pub fn redundancy(&self) -> usize {
        self.cable_count() - self.dimensions()
    }

    /// Default tension distribution: least norm if the robot is redundant, otherwise unique.
    pub fn default_distribution(&self) -> Distribution {
        if self.redundancy() == 0 { Distribution::Unique } else { Distribution::LeastNorm }
    }

    /// Anchor positions, m.
    pub fn anchors(&self) -> &Anchors {
        &self.anchors
    }

    /// Mass of the node, kg.
    pub fn node_mass_kg(&self) -> f64 {
        self.node_mass_kg
    }

    /// Weight less buoyancy, N.
    pub fn net_weight_n(&self) -> f64 {
        self.net_weight_n
    }

    /// Drag divided by squared speed, N s²/m².
    pub fn drag_n_s2_m2(&self) -> f64 {
        self.drag_n_s2_m2
    }

    /// Lowest and highest tension, N.
    pub fn tension_limits_n(&self) -> [f64; 2] {
        self.tension_limits_n
    }

    /// Highest speed of the node, m/s.
    pub fn speed_limit_m_s(&self) -> f64 {
        self.speed_limit_m_s
    }

    /// Highest speed of each cable, m/s.
    pub fn cable_speed_limit_m_s(&self) -> f64 {
        self.cable_speed_limit_m_s
    }

    /// Highest acceleration of the node, m/s².
    pub fn acceleration_limit_m_s2(&self) -> f64 {
        self.acceleration_limit_m_s2
    }

    /// Lowest height of the node, m.
    pub fn ground_m(&self) -> f64 {
        self.ground_m
    }

    /// Keep-out boxes.
    pub fn keep_out(&self) -> &[KeepOut] {
        &self.keep_out[..self.keep_out_count]
    }

    /// Bodies that neither the node nor a cable may touch.
    pub fn obstacles(&self) -> impl Iterator<Item = &Obstacle> {
        self.obstacles.iter().flatten()
    }

    /// Smallest distance of node and cables from every obstacle, m.
    pub fn clearance_m(&self) -> f64 {
        self.clearance_m
    }

    /// EA of the cables, N; None for rigid cables.
    pub fn stiffness_n(&self) -> Option<f64> {
        self.stiffness_n
    }

    /// Weight of the cables, N/m; 0 for cables that are too light to matter.
    pub fn cable_weight_n_m(&self) -> f64 {
        self.cable_weight_n_m
    }

    /// What the weight of a cable, counted from 0, does at a position.
    pub fn cable_load(&self, cable: usize, position: &Vector3<f64>) -> Load {
        if self.cable_weight_n_m == 0.0 {
            return Load::default();
        }
        Load::at(&self.anchors.pulley(cable), position, self.cable_weight_n_m)
    }

    /// The force that the cables provide together, N, for a force on the node alone: half of their own weight, which
    /// the node carries, in addition.
    pub fn with_cables_n(&self, position: &Vector3<f64>, wrench_n: &Vector3<f64>) -> Vector3<f64> {
        // Without weight not even the sign of a zero changes.
        if self.cable_weight_n_m == 0.0 {
            return *wrench_n;
        }
        wrench_n + Vector3::new(0.0, 0.0, sag::carried_n(&self.anchors, position, self.cable_weight_n_m))
    }

    /// True if the idler of a cable, counted from 0, counts the cable as stretched as it passes: a metre of its counts
    /// is 1 / (1 + T / EA) metres of unstretched cable.
    pub fn counts_stretched(&self, cable: usize) -> bool {
        self.counts_stretched & 1_u8.checked_shl(cable as u32).unwrap_or(0) != 0
    }

    /// Cable between drum and anchor per cable, m.
    pub fn routed_length_m(&self) -> &CableVec {
        &self.routed_length_m
    }

    /// Drum of a cable, counted from 0: how hard a tension pulls on the motor.
    pub fn drum(&self, cable: usize) -> Drum {
        self.drums.get(cable).copied().unwrap_or_default()
    }

    /// What the encoder of a cable, counted from 0, counts: turns of its drum, or the cable itself.
    pub fn counted(&self, cable: usize) -> Drum {
        if self.counts_turns { self.drum(cable) } else { Drum::default() }
    }

    /// True where the encoders by which the robot counts its cables count turns of drums.
    pub fn counts_turns(&self) -> bool {
        self.counts_turns
    }

    /// Shortest and longest measured length per cable, m.
    pub fn length_limits_m(&self) -> &[[f64; 2]] {
        &self.length_limits_m[..self.cable_count()]
    }

    /// Friction model of the winch motors.
    pub fn motor(&self) -> &Motor {
        &self.motor
    }

    /// Currents of the winch motors: measured if there are tables, otherwise by the friction model.
    pub fn current(&self) -> &dyn Current {
        &self.motors
    }

    /// Measured current of the winch motor of a cable, counted from 0, if any.
    pub fn motor_table(&self, cable: usize) -> Option<&MotorTable> {
        self.motors.table(cable)
    }

    /// What the drives can deliver to the motors.
    pub fn drive_limits(&self) -> DriveLimits {
        self.drive_limits
    }

    /// Computes what the motor of a cable, counted from 0, needs at a tension, N, and a reel-in speed, m/s: by its
    /// measured table where it covers the point, otherwise by the friction model. A drum with layers draws most current
    /// where it is full and most voltage where it is empty; both are of the length at which they are largest.
    pub fn drive_load(&self, cable: usize, tension_n: f64, reel_in_m_s: f64) -> DriveLoad {
        let at = |pull_n: f64, turn_m_s: f64| {
            let measured = self.motors.table(cable).map(|_| self.motors.current_of_a(cable, pull_n, turn_m_s));
            let current_a = measured.and_then(Result::ok).unwrap_or_else(|| self.motor.current_a(pull_n, turn_m_s));
            (current_a, self.motor.voltage_v(current_a, turn_m_s))
        };
        let drum = self.drum(cable);
        if drum.is_bare() {
            let (current_a, voltage_v) = at(tension_n, reel_in_m_s);
            return DriveLoad { tension_n, reel_in_m_s, current_a, voltage_v };
        }
        let [full, empty] = self.length_limits_m[cable].map(|length_m| {
            let ratio = drum.radius_ratio(length_m);
            at(tension_n * ratio, reel_in_m_s / ratio)
        });
        let larger = |a: f64, b: f64| if a.abs() >= b.abs() { a } else { b };
        DriveLoad { tension_n, reel_in_m_s, current_a: larger(full.0, empty.0), voltage_v: larger(full.1, empty.1) }
    }

    /// Covariance of the position of an anchor, counted from 0, by a calibration, m²; None if unknown.
    pub fn anchor_covariance_m2(&self, anchor: usize) -> Option<&Matrix3<f64>> {
        self.calibrated.as_ref().and_then(|calibrated| calibrated.anchor_m2(anchor))
    }

    /// What a calibration states of the lengths; None without one.
    pub(crate) fn calibrated(&self) -> Option<&Calibrated> {
        self.calibrated.as_ref()
    }

    /// Standard deviations of what the robot file states.
    pub fn uncertainty(&self) -> &Uncertainty {
        &self.uncertainty
    }

    /// Errors of the lengths where they were set, as [`Robot::with_lengths_set_at`] states it; `None`: unknown.
    pub(crate) fn errors_at_zero(&self) -> Option<&LengthErrors> {
        self.errors_at_zero.as_ref()
    }

    /// The same robot with these errors of the lengths where they were set.
    pub(crate) fn with_errors_at_zero(&self, errors_at_zero: Option<LengthErrors>) -> Self {
        Self { errors_at_zero, ..*self }
    }

    /// The same robot with its anchors at other positions, to try out a calibration or inject an error. The number of
    /// cables and of directions must stay the same. The pulleys stay those of this robot: `anchors` must have the same
    /// radii, or eyes, which stand for positions alone.
    pub fn with_anchors(&self, anchors: Anchors) -> Result<Self, RobotError> {
        if anchors.len() != self.anchors.len() {
            let problem = format!("has {} points for a robot of {} cables", anchors.len(), self.anchors.len());
            return refuse("anchors_m", problem, "as many points as the robot has cables");
        }
        if anchors.dimensions() != self.dimensions() {
            let problem = format!("has {} coordinates for a robot of {}", anchors.dimensions(), self.dimensions());
            return refuse("anchors_m", problem, "points with as many coordinates as the robot has");
        }
        let radii_m = self.anchors.radii_m();
        if anchors.have_pulleys() && anchors.radii_m() != radii_m {
            let problem = format!("is {:?} for a robot with {radii_m:?}", anchors.radii_m());
            return refuse("pulley_radius_m", problem, "the radii of the robot, or eyes; with_pulleys changes radii");
        }
        Ok(Self { anchors: anchors.with_pulleys(radii_m)?, ..*self })
    }

    /// The same robot with pulleys of these radii, m, at the same anchors; 0 for an eye.
    pub fn with_pulleys(&self, radii_m: &[f64]) -> Result<Self, RobotError> {
        Ok(Self { anchors: self.anchors.with_pulleys(radii_m)?, ..*self })
    }

    /// The same robot with rigid cables.
    pub fn with_rigid_lines(&self) -> Self {
        Self { stiffness_n: None, ..*self }
    }

    /// Force that the cables provide together, b = m (a + g) of (15), N; with buoyancy, b = m a + net weight.
    pub fn wrench_n(&self, acceleration_m_s2: &Vector3<f64>) -> Vector3<f64> {
        acceleration_m_s2 * self.node_mass_kg + Vector3::new(0.0, 0.0, self.net_weight_n)
    }

    /// Force that the cables provide against the drag of a moving node, c |v| v, N.
    pub fn drag_n(&self, velocity_m_s: &Vector3<f64>) -> Vector3<f64> {
        velocity_m_s * (self.drag_n_s2_m2 * velocity_m_s.norm())
    }

    /// Force that the cables provide together for a moving and accelerating node: [`Robot::wrench_n`] plus the drag, N.
    ///
    /// ```
    /// use cable_robot::*;
    /// let floats = Robot::new(RobotParts {
    ///     anchors_m: vec![[0.0, 0.0, 4.0], [6.0, 0.0, 4.0], [6.0, 0.0, 0.0], [0.0, 0.0, 0.0]], planar: true,
    ///     node_mass_kg: 6.0, net_weight_n: Some(0.0), drag_n_s2_m2: 25.0, tension_limits_n: [8.0, 80.0],
    ///     speed_limit_m_s: 0.4, acceleration_limit_m_s2: 0.3, ..RobotParts::default()
    /// })?;
    /// let force = floats.moving_wrench_n(&Vector3::new(-0.2, 0.0, 0.0), &Vector3::zeros());
    /// assert!((force - Vector3::new(-1.0, 0.0, 0.0)).norm() < 1e-12);
    /// # Ok::<(), RobotError>(())
    /// ```
    pub fn moving_wrench_n(&self, velocity_m_s: &Vector3<f64>, acceleration_m_s2: &Vector3<f64>) -> Vector3<f64> {
        self.wrench_n(acceleration_m_s2) + self.drag_n(velocity_m_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::CurrentTable;
    use crate::robot_parts::{DEFAULT_LENGTH_LIMITS_M, PulleyKind};

    fn parts() -> RobotParts {
        RobotParts {
            anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
            node_mass_kg: 1.2,
            tension_limits_n: [2.0, 60.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            ..RobotParts::default()
        }
    }

    #[test]
    fn defaults_are_the_documented_ones() {
        let robot = Robot::new(parts()).unwrap();
        assert_eq!(robot.net_weight_n(), 1.2 * STANDARD_GRAVITY);
        assert_eq!(&robot.routed_length_m()[..], &[0.0; 3]);
        assert_eq!(robot.length_limits_m(), &[DEFAULT_LENGTH_LIMITS_M; 3]);
        assert_eq!(robot.stiffness_n(), None);
    }

    fn long_table() -> Option<CurrentTable> {
        let speeds: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.01).collect();
        CurrentTable::new(speeds, vec![0.0, 1.0], &vec![vec![0.0; 2]; 100], 1.0).ok()
    }

    #[test]
    fn a_measured_table_takes_the_place_of_the_model() {
        let table =
            CurrentTable::new(vec![-1.0, 1.0], vec![0.0, 100.0], &[vec![0.0, 0.0], vec![2.0, 2.0]], 1.2).unwrap();
        let robot = Robot::new(RobotParts { motor_tables: vec![table], ..parts() }).unwrap();
        assert_eq!(robot.current().current_a(50.0, 0.0), Ok(1.0));
        assert!(robot.current().current_a(50.0, 1.1).is_err());
        let modelled = Robot::new(parts()).unwrap();
        assert_eq!(modelled.current().current_a(50.0, 1.1), Ok(modelled.motor().current_a(50.0, 1.1)));
    }

    #[test]
    fn each_motor_may_have_its_own_table() {
        let table =
            |a: f64| CurrentTable::new(vec![-1.0, 1.0], vec![0.0, 100.0], &[vec![0.0, 0.0], vec![a, a]], 1.2).unwrap();
        let tables = vec![table(1.0), table(2.0), table(4.0)];
        let robot = Robot::new(RobotParts { motor_tables: tables.clone(), ..parts() }).unwrap();
        for (cable, most_a) in [1.0, 2.0, 4.0].into_iter().enumerate() {
            assert_eq!(robot.drive_load(cable, 50.0, 1.0).current_a, most_a);
            assert_eq!(robot.current().current_of_a(cable, 50.0, 0.0), Ok(0.5 * most_a));
            assert!(robot.current().current_of_a(cable, 50.0, 1.1).is_err());
            // Beyond the table the model counts.
            assert_eq!(robot.drive_load(cable, 50.0, 1.1).current_a, robot.motor().current_a(50.0, 1.1));
        }
        let refused = Robot::new(RobotParts { motor_tables: tables[..2].to_vec(), ..parts() }).unwrap_err();
        assert!(refused.key == "table" && refused.problem.contains("3 motors"), "{refused}");
    }

    #[test]
    fn every_bad_value_is_named_with_what_is_accepted() {
        type Spoil = fn(&mut RobotParts);
        let cases: &[(&str, Spoil)] = &[
            ("anchors_m", |p| p.anchors_m.truncate(2)),
            ("anchors_m", |p| p.anchors_m = vec![[0.0, 1.0, 2.0]; 9]),
            ("anchors_m", |p| p.anchors_m[1][2] = f64::NAN),
            ("anchors_m", |p| p.anchors_m[1] = p.anchors_m[0]),
            ("node_mass_kg", |p| p.node_mass_kg = 0.0),
            ("node_mass_kg", |p| p.node_mass_kg = f64::INFINITY),
            ("anchors_m", |p| p.planar = true),
            ("clearance_m", |p| p.clearance_m = -0.1),
            ("current_limit_a", |p| p.drive_limits.current_a = 0.0),
            ("supply_min_v", |p| p.drive_limits.voltage_v = f64::NAN),
            ("obstacle", |p| {
                p.obstacles = vec![Obstacle::cylinder([0.0, 0.0], 0.2, [0.0, 1.0]).unwrap(); MAX_OBSTACLES + 1];
            }),
            ("pulley_radius_m", |p| p.pulley_radius_m = Some(vec![0.04; 3])),
            ("pulley_radius_m", |p| p.pulley = PulleyKind::Swivel),
            ("pulley_radius_m", |p| {
                (p.pulley, p.pulley_radius_m) = (PulleyKind::Swivel, Some(vec![0.04; 2]));
            }),
            ("pulley_radius_m", |p| {
                (p.pulley, p.pulley_radius_m) = (PulleyKind::Swivel, Some(vec![0.04, f64::NAN, 40.0]));
            }),
            ("net_weight_n", |p| p.net_weight_n = Some(-1.0)),
            ("drag_n_s2_m2", |p| p.drag_n_s2_m2 = -1.0),
            ("drag_n_s2_m2", |p| p.drag_n_s2_m2 = f64::NAN),
            ("tension_limits_n", |p| p.tension_limits_n = [60.0, 2.0]),
            ("tension_limits_n", |p| p.tension_limits_n = [-1.0, 2.0]),
            ("tension_limits_n", |p| p.tension_limits_n = [1.0, f64::NAN]),
            ("speed_limit_m_s", |p| p.speed_limit_m_s = -0.4),
            ("cable_speed_limit_m_s", |p| p.cable_speed_limit_m_s = Some(0.0)),
            ("acceleration_limit_m_s2", |p| p.acceleration_limit_m_s2 = f64::NAN),
            ("ground_m", |p| p.ground_m = f64::NEG_INFINITY),
            ("keep_out", |p| p.keep_out_m = vec![[[0.0; 3], [1.0, 1.0, 0.0]]]),
            ("keep_out", |p| p.keep_out_m = vec![[[0.0; 3], [1.0; 3]]; 9]),
            ("stiffness_n", |p| p.stiffness_n = Some(0.0)),
            ("mass_kg_m", |p| p.cable_mass_kg_m = -0.01),
            ("mass_kg_m", |p| p.cable_mass_kg_m = f64::NAN),
            ("counts_stretched", |p| p.counts_stretched = Some(vec![true; 2])),
            ("routed_length_m", |p| p.routed_length_m = Some(vec![6.0; 4])),
            ("routed_length_m", |p| p.routed_length_m = Some(vec![6.0, -1.0, 6.0])),
            ("length_limits_m", |p| p.length_limits_m = Some(vec![[0.1, 10.0]; 2])),
            ("length_limits_m", |p| p.length_limits_m = Some(vec![[0.1, 10.0], [5.0, 1.0], [0.1, 10.0]])),
            ("force_constant_n_a", |p| p.motor.force_constant_n_a = 0.0),
            ("table", |p| p.motor_tables = long_table().into_iter().collect()),
            ("covariance_m2", |p| p.anchor_covariance_m2 = Some(vec![vec![0.0; 9]; 8])),
            ("covariance_m2", |p| p.anchor_covariance_m2 = Some(vec![vec![1.0; 8]; 9])),
            ("covariance_m2", |p| p.anchor_covariance_m2 = Some(vec![vec![f64::NAN; 9]; 9])),
            ("covariance_m2", |p| p.anchor_covariance_m2 = Some(vec![vec![-1.0; 9]; 9])),
            ("covariance_m2", |p| {
                // Each pair may be as opposed as this, three may not.
                let row = |i: usize| (0..9).map(|j| if i == j { 1e-4 } else { -0.9e-4 }).collect();
                p.anchor_covariance_m2 = Some((0..9).map(row).collect());
            }),
            ("length_covariance", |p| p.length_covariance = Some(vec![vec![0.0; 9]; 9])),
            ("length_covariance", |p| p.length_covariance = Some(vec![vec![-1.0; 15]; 15])),
        ];
        for (key, spoil) in cases {
            let mut bad = parts();
            spoil(&mut bad);
            let error = Robot::new(bad).unwrap_err();
            assert_eq!(error.key, *key, "{error}");
            let sentence = error.to_string();
            assert!(sentence.starts_with(key) && sentence.ends_with(error.accepted), "{sentence}");
            assert!(!error.accepted.is_empty() && sentence.contains(&error.problem), "{sentence}");
        }
    }

    #[test]
    fn other_anchors_keep_the_pulleys() {
        let mut with = parts();
        (with.pulley, with.pulley_radius_m) = (PulleyKind::Swivel, Some(vec![0.04, 0.0, 0.03]));
        let robot = Robot::new(with).unwrap();
        let moved = Anchors::new(&[[0.1, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]]).unwrap();
        let other = robot.with_anchors(moved).unwrap();
        assert_eq!((other.anchors()[0].x, other.anchors().radii_m()), (0.1, robot.anchors().radii_m()));
        assert_eq!(other, robot.with_anchors(*other.anchors()).unwrap());
        let wrong = moved.with_pulleys(&[0.05; 3]).unwrap();
        assert_eq!(robot.with_anchors(wrong).unwrap_err().key, "pulley_radius_m");
        assert_eq!(robot.with_pulleys(&[0.0; 3]).unwrap(), Robot::new(parts()).unwrap());
    }
}
