//! The complete plant, integrated in time.

use nalgebra::Vector3;

use crate::cable::{Cable, Surroundings};
use crate::config::PlantConfig;
use crate::drive::{MotorInput, SpeedGains};
use crate::error::{PlantError, check};
use crate::statics::hanging_tensions_n;
use crate::swing::Swing;
use crate::weather::Weather;

/// Shortest free cable for which step size and damping are designed, m.
const SHORTEST_FREE_M: f64 = 0.3;

/// Largest number of steps in which poles, bows and tensions at the start agree, and the change that ends them, m.
const SETTLING_STEPS: usize = 60;
const SETTLED_M: f64 = 1e-9;

/// A fault, or its end. Cables are numbered from 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// The motor jams (`on`) or turns again.
    Stall {
        /// Index of the cable.
        cable: usize,
        /// Whether the motor is jammed.
        on: bool,
    },
    /// A share of the cable's motion slips over the idler uncounted; 0 ends the fault.
    IdlerSlip {
        /// Index of the cable.
        cable: usize,
        /// Uncounted share, 0 to 1.
        share: f64,
    },
    /// A share of the drum's motion does not move the cable: it slips on the drum, or the drum on its shaft; 0 ends the
    /// fault.
    DrumSlip {
        /// Index of the cable.
        cable: usize,
        /// Share without effect, 0 to 1.
        share: f64,
    },
    /// The encoder's count jumps.
    EncoderJump {
        /// Index of the cable.
        cable: usize,
        /// Number of counts.
        counts: i64,
    },
    /// The encoder stops counting (`on`), or counts again.
    EncoderDead {
        /// Index of the cable.
        cable: usize,
        /// Whether the encoder is dead.
        on: bool,
    },
    /// The cable breaks (`on`), or is repaired with the present length.
    BrokenLine {
        /// Index of the cable.
        cable: usize,
        /// Whether the cable is broken.
        on: bool,
    },
    /// The supply changes to this open-circuit voltage, V.
    Supply {
        /// Open-circuit voltage, V.
        voltage_v: f64,
    },
}

/// Motors, drums, cables and node of a robot.
///
/// [`Plant::new`] creates a plant and [`Plant::step`] advances it; the other methods read the state or inject faults. A
/// clone is an independent plant in the same state.
#[derive(Debug, Clone, PartialEq)]
pub struct Plant {
    config: PlantConfig,
    cables: Vec<Cable>,
    weather: Weather,
    swing: Swing,
    position_m: Vector3<f64>,
    velocity_m_s: Vector3<f64>,
    /// Force of a hand on the node, N.
    hand_n: Vector3<f64>,
    supply_v: f64,
    supply_current_a: f64,
    time_ns: u64,
    substep_ns: u64,
}

impl Plant {
    /// Builds the plant with the node hanging at rest at the configured start and the motors released.
    ///
    /// # Errors
    /// An invalid configuration, or a start position at which the node cannot hang.
    pub fn new(config: PlantConfig) -> Result<Self, PlantError> {
        config.validate()?;
        // Stiff cables on a light node require finer steps: an eighth of a radian of the fastest possible mode. Damping
        // of such a mode stays below a tenth of critical, which is more than any cable has.
        let fastest_rad_s = fastest_mode_rad_s(&config);
        let substep_ns = ((config.substep_s.min(0.125 / fastest_rad_s)) * 1e9) as u64;
        let cables = (0..config.cable_count()).map(|i| Cable::new(&config, i, 0.2 / fastest_rad_s)).collect();
        let supply_v = config.supply_v;
        let mut plant = Self {
            cables,
            weather: Weather::new(config.world.wind, config.seed),
            swing: Swing::new(config.world.pendulum),
            position_m: Vector3::from(config.start_m),
            velocity_m_s: Vector3::zeros(),
            hand_n: Vector3::zeros(),
            supply_v,
            supply_current_a: 0.0,
            time_ns: 0,
            substep_ns: substep_ns.max(1),
            config,
        };
        plant.settle()?;
        Ok(plant)
    }

    /// Hangs the node at rest at the start. Poles and bows give way to the tensions, which then change a little.
    fn settle(&mut self) -> Result<(), PlantError> {
        let around = self.surroundings();
        for _ in 0..SETTLING_STEPS {
            let pulls: Vec<Vector3<f64>> =
                self.cables.iter().map(|cable| -cable.path(self.position_m).direction).collect();
            let at_rest = Vector3::zeros();
            let air = around.air_m_s.unwrap_or_default();
            let node_n = self.config.node.force_in_air_n(self.position_m, at_rest, air, around.gravity_m_s2);
            let cables_n: Vec<Vector3<f64>> =
                self.cables.iter().map(|cable| cable.half_load_n(self.position_m, &around)).collect();
            let wrench_n = -cables_n.iter().fold(node_n, |sum, half_n| sum + half_n);
            let tensions = start_tensions_n(&self.config, &pulls, wrench_n)?;
            let mut change_m = 0.0;
            for (cable, tension_n) in self.cables.iter_mut().zip(tensions) {
                change_m += cable.settle(self.position_m, tension_n, &around);
            }
            if change_m < SETTLED_M {
                break;
            }
        }
        Ok(())
    }

    fn surroundings(&mut self) -> Surroundings {
        let world = &self.config.world;
        let air_m_s = (!world.wind.is_calm()).then(|| self.weather.air_m_s(self.time_ns));
        Surroundings {
            air_m_s,
            warming_k: world.warming.at_k(self.time_ns as f64 * 1e-9),
            gravity_m_s2: self.config.gravity_m_s2,
            cable_drag_n: world.wind.cable_drag_n,
        }
    }

    /// Applies each drive's command and advances by `dt_s`, in equal steps no longer than the configured one.
    ///
    /// `dt_s` is rounded to the nearest nanosecond. A command equal to the last one changes nothing, so small and large
    /// steps give the same result except for rounding of the integration.
    ///
    /// # Errors
    /// A wrong number of inputs, an input that is not finite, or a time that is not between 0 and 3600 s.
    pub fn step(&mut self, dt_s: f64, inputs: &[MotorInput]) -> Result<(), PlantError> {
        if inputs.len() != self.cables.len() {
            return Err(PlantError::Count { key: "inputs", found: inputs.len(), expected: self.cables.len() });
        }
        check("dt_s", dt_s, "zero to 3600 s", |x| (0.0..=3600.0).contains(&x))?;
        for input in inputs {
            let (MotorInput::Speed(value) | MotorInput::Duty(value) | MotorInput::Current(value)) = input;
            check("inputs", *value, "a finite speed, duty or current", |_| true)?;
        }
        for (cable, &input) in self.cables.iter_mut().zip(inputs) {
            cable.drive.command(self.time_ns, input);
        }
        let dt_ns = (dt_s * 1e9).round() as u64;
        let steps = dt_ns.div_ceil(self.substep_ns);
        if steps == 0 {
            return Ok(());
        }
        let start_ns = self.time_ns;
        let h = dt_ns as f64 * 1e-9 / steps as f64;
        let smoothing = self.cables[0].drive.smoothing(h);
        for k in 1..=steps {
            self.time_ns = start_ns + dt_ns * k / steps;
            self.substep(h, smoothing);
        }
        Ok(())
    }

    /// Semi-implicit integration: forces from the present positions, then speeds, then positions from the new speeds.
    fn substep(&mut self, h: f64, smoothing: f64) {
        let voltage_v = self.voltage_v();
        let around = self.surroundings();
        let air = around.air_m_s.unwrap_or_default();
        let mut force =
            self.config.node.force_in_air_n(self.position_m, self.velocity_m_s, air, self.config.gravity_m_s2);
        force += self.hand_n;
        let mut drawn_a = 0.0;
        for cable in &mut self.cables {
            force += cable.pull(h, self.position_m, self.velocity_m_s, &around);
            cable.drive.advance(self.time_ns, smoothing, cable.idler.counts());
            drawn_a += cable.wind(h, voltage_v);
        }
        self.supply_current_a = drawn_a;
        if self.config.planar {
            (force.y, self.velocity_m_s.y, self.position_m.y) = (0.0, 0.0, 0.0);
        }
        self.swing.step(h, force / self.config.node.mass_kg, self.config.gravity_m_s2);
        self.velocity_m_s += force * (h / self.config.node.mass_kg);
        self.position_m += self.velocity_m_s * h;
    }

    /// Starts or ends a fault.
    ///
    /// # Errors
    /// A cable that does not exist, or a value out of range.
    pub fn apply(&mut self, fault: Fault) -> Result<(), PlantError> {
        match fault {
            Fault::Stall { cable, on } => self.cable_mut(cable)?.motor.jammed = on,
            Fault::IdlerSlip { cable, share } => {
                check("share", share, "zero to one", |x| (0.0..=1.0).contains(&x))?;
                self.cable_mut(cable)?.follower().slip = share;
            }
            Fault::DrumSlip { cable, share } => {
                check("share", share, "zero to one", |x| (0.0..=1.0).contains(&x))?;
                self.cable_mut(cable)?.drum_slip = share;
            }
            Fault::EncoderJump { cable, counts } => self.cable_mut(cable)?.idler.jump(counts),
            Fault::EncoderDead { cable, on } => self.cable_mut(cable)?.idler.dead = on,
            Fault::BrokenLine { cable, on } => self.cable_mut(cable)?.broken = on,
            Fault::Supply { voltage_v } => {
                check("voltage_v", voltage_v, "zero to 100 V", |x| (0.0..=100.0).contains(&x))?;
                self.supply_v = voltage_v;
            }
        }
        Ok(())
    }

    /// Changes the gains of one drive's speed loop.
    ///
    /// # Errors
    /// A cable that does not exist, or a gain out of range.
    pub fn set_gains(&mut self, cable: usize, gains: SpeedGains) -> Result<(), PlantError> {
        gains.validate()?;
        self.cable_mut(cable)?.drive.set_gains(gains);
        Ok(())
    }

    /// Limits the current of one motor, A.
    ///
    /// # Errors
    /// A cable that does not exist, or a limit that is not positive.
    pub fn set_current_limit(&mut self, cable: usize, limit_a: f64) -> Result<(), PlantError> {
        check("limit_a", limit_a, "more than zero", |x| x > 0.0)?;
        self.cable_mut(cable)?.motor.limit_current(limit_a);
        Ok(())
    }

    /// Moves the node with a given velocity without changing cables and motors: a push, a gust, a hand.
    pub fn push_node(&mut self, position_m: [f64; 3], velocity_m_s: [f64; 3]) {
        self.position_m = Vector3::from(position_m);
        self.velocity_m_s = Vector3::from(velocity_m_s);
    }

    fn cable_mut(&mut self, cable: usize) -> Result<&mut Cable, PlantError> {
        let count = self.cables.len();
        self.cables.get_mut(cable).ok_or(PlantError::NoSuchCable { cable, count })
    }

    /// A force on the node beside its own, N, from now on: a hand.
    pub fn pull_node(&mut self, force_n: [f64; 3]) {
        self.hand_n = Vector3::from(force_n);
    }

    /// The speed command that pays out `speed_m_s` of `cable`.
    pub fn speed_input(&self, cable: usize, speed_m_s: f64) -> MotorInput {
        MotorInput::Speed(speed_m_s * self.config.idlers[cable].counts_per_m)
    }

    /// Configuration of the plant.
    pub fn config(&self) -> &PlantConfig {
        &self.config
    }

    /// Number of cables.
    pub fn cable_count(&self) -> usize {
        self.cables.len()
    }

    /// Time since the start, ns.
    pub fn time_ns(&self) -> u64 {
        self.time_ns
    }

    /// True position of the node, m.
    pub fn position_m(&self) -> [f64; 3] {
        self.position_m.into()
    }

    /// True position of a point of the body at `lever_m` from the node while the body hangs straight, m. A body that
    /// swings below the node tilts its sensors.
    pub fn place_m(&self, lever_m: [f64; 3]) -> [f64; 3] {
        let (lever, turn) = (Vector3::from(lever_m), self.swing.rotation());
        let moved = turn.cross(&lever);
        (self.position_m + (lever + moved + turn.cross(&moved) * 0.5)).into()
    }

    /// True velocity of the node, m/s.
    pub fn velocity_m_s(&self) -> [f64; 3] {
        self.velocity_m_s.into()
    }

    /// True cable tensions in the middle of the free cables, N.
    pub fn tensions_n(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| cable.tension_n).collect()
    }

    /// True tensions of the routed parts and at the drums, N.
    pub fn drum_tensions_n(&self) -> Vec<f64> {
        self.cables.iter().map(Cable::drum_tension_n).collect()
    }

    /// True unstretched lengths beyond the routed part, m: the output of a perfect encoder.
    pub fn lengths_m(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| cable.paid_out_m - cable.routed_m).collect()
    }

    /// Distances from anchor to node, m.
    pub fn distances_m(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| (self.position_m - cable.anchor_m).norm()).collect()
    }

    /// Speed at which unstretched cable leaves each drum, m/s.
    pub fn line_speeds_m_s(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| cable.paid_out_m_s).collect()
    }

    /// Present armature currents, A; positive pulls on the cable.
    pub fn currents_a(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| cable.motor.current_a()).collect()
    }

    /// Heat in the armature of each motor since the start, J.
    pub fn losses_j(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| cable.loss_j).collect()
    }

    /// Heat in the armature computed from the averaged current of the drives, J: excludes the heat of the ripple,
    /// which no drive reports.
    pub fn averaged_losses_j(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| cable.averaged_loss_j).collect()
    }

    /// Electrical work on each motor since the start, J: the bridge's voltage times the current; power returned by a
    /// motor is negative.
    pub fn electrical_j(&self) -> Vec<f64> {
        self.cables.iter().map(|cable| cable.electrical_j).collect()
    }

    /// Tension of `cable`, N.
    pub fn tension_n(&self, cable: usize) -> f64 {
        self.cables[cable].tension_n
    }

    /// Whether each cable is slack (or broken).
    pub fn slack(&self) -> Vec<bool> {
        self.cables.iter().map(|cable| cable.tension_n <= 0.0).collect()
    }

    /// Encoder count of `cable`; it increases as cable is paid out.
    pub fn counts(&self, cable: usize) -> i64 {
        self.cables[cable].idler.counts()
    }

    /// Count of the second encoder of a cable; it increases as cable is paid out.
    pub fn second_counts(&self, cable: usize) -> i64 {
        self.cables[cable].second.counts()
    }

    /// Speed of `cable` measured by its drive over the last 1/300 s, counts per second.
    pub fn speed_counts_s(&self, cable: usize) -> f64 {
        self.cables[cable].drive.measured_counts_s()
    }

    /// Speed of `cable` averaged by its drive over about 30 ms, counts per second.
    pub fn averaged_speed_counts_s(&self, cable: usize) -> f64 {
        self.cables[cable].drive.averaged_counts_s()
    }

    /// Current of `cable` measured by its drive (averaged over some milliseconds), A; positive pulls on the cable.
    pub fn measured_current_a(&self, cable: usize) -> f64 {
        self.cables[cable].filtered_current_a
    }

    /// Duty on the motor of `cable`, -1 to 1; positive pays out.
    pub fn duty(&self, cable: usize) -> f64 {
        self.cables[cable].drive.duty()
    }

    /// Reference of the speed loop of `cable`, after delay and lag, counts per second.
    pub fn reference_counts_s(&self, cable: usize) -> f64 {
        self.cables[cable].drive.reference_counts_s()
    }

    /// Gains of the speed loop of `cable`.
    pub fn gains(&self, cable: usize) -> SpeedGains {
        self.cables[cable].drive.gains()
    }

    /// Voltage at the drives, V: the supply minus the drop at its inner resistance.
    pub fn voltage_v(&self) -> f64 {
        (self.supply_v - self.config.supply_resistance_ohm * self.supply_current_a).max(0.0)
    }

    /// Mechanical energy of node and cables, J: motion, height above zero and stretch.
    pub fn energy_j(&self) -> f64 {
        let node = &self.config.node;
        let weight_n = node.net_weight_n.unwrap_or(node.mass_kg * self.config.gravity_m_s2);
        let motion = 0.5 * node.mass_kg * self.velocity_m_s.norm_squared();
        let stretch: f64 = self.cables.iter().map(|cable| cable.stretch_j(self.position_m)).sum();
        motion + weight_n * self.position_m.z + stretch
    }
}

/// Tensions that hold the node at rest at the start, N: the configured ones if they balance the forces, otherwise the
/// least-norm ones.
fn start_tensions_n(
    config: &PlantConfig,
    pulls: &[Vector3<f64>],
    wrench_n: Vector3<f64>,
) -> Result<Vec<f64>, PlantError> {
    let Some(given) = &config.start_tensions_n else {
        let (position_m, limits_n) = (config.start_m, config.start_limits_n);
        let tensions = hanging_tensions_n(pulls, wrench_n, limits_n);
        return Ok(tensions.ok_or(PlantError::NoEquilibrium { position_m, limits_n })?.to_vec());
    };
    let held: Vector3<f64> = pulls.iter().zip(given).map(|(pull, &tension)| pull * tension).sum();
    let residual_n = (held - wrench_n).norm();
    if residual_n > 0.01 * (1.0 + wrench_n.norm()) {
        return Err(PlantError::Unbalanced { residual_n });
    }
    Ok(given.clone())
}

/// Upper bound of the frequency of the node on its cables, rad/s: all of them in one direction, at their shortest.
fn fastest_mode_rad_s(config: &PlantConfig) -> f64 {
    let of_cable = |(i, routed): (usize, &f64)| {
        let line = config.world.cables.get(i).and_then(|cable| cable.line).unwrap_or(config.line);
        line.stiffness_n / (routed + SHORTEST_FREE_M)
    };
    let stiffness_n_m: f64 = config.routed_length_m.iter().enumerate().map(of_cable).sum();
    (stiffness_n_m / config.node.mass_kg).sqrt()
}
