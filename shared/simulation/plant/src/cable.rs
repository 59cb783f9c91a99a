//! One winch with its cable, from the drive to the node.

use nalgebra::Vector3;

use crate::config::PlantConfig;
use crate::drive::{Drive, SpeedGains};
use crate::drum::Drum;
use crate::line::{CableConfig, Idler};
use crate::motor::{Bridge, Motor};
use crate::pulley::Path;
use crate::world::CableWorld;

/// Time constant of the current measurement of a drive, s; a drive averages over several bridge periods.
const CURRENT_FILTER_S: f64 = 0.005;

/// Time in which a pole and a cable's bow follow a changed force, s. Both have modes of some hertz with strong damping
/// (soil, air), which is below what moves the node.
const FOLLOW_S: f64 = 0.05;

/// Motion over which a pulley's friction turns from one direction to the other, m: about the presliding distance of
/// its bearing at the rim.
const PRESLIDE_M: f64 = 0.002;

/// Tension below which a drum with play in its gear stays where it is, N: the friction of its bearings.
const DRUM_FRICTION_N: f64 = 0.5;

/// Speed with which a cable pulls its drum through the play of the gear, m/s.
const THROUGH_PLAY_M_S: f64 = 0.2;

/// Tension below which the formula of a shallow bow is not used, N.
const SHALLOW_N: f64 = 0.2;

/// Least cable off the drum, m. The end of the cable on an empty drum is not modelled.
const SHORTEST_OFF_M: f64 = 0.05;

/// What acts on all cables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Surroundings {
    /// Velocity of the air, m/s; `None`: calm, and no drag on cables.
    pub air_m_s: Option<Vector3<f64>>,
    /// Change of the temperature since the start, K.
    pub warming_k: f64,
    /// Acceleration of gravity, m/s².
    pub gravity_m_s2: f64,
    /// Drag of a cable, as in [`Wind`](crate::world::Wind).
    pub cable_drag_n: f64,
}

/// One winch with its cable.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cable {
    pub anchor_m: Vector3<f64>,
    pub routed_m: f64,
    pub drive: Drive,
    pub motor: Motor,
    pub idler: Idler,
    /// The other encoder of the cable: on the motor where `idler` follows the cable, on an idler where that is on the
    /// motor.
    pub second: Idler,
    /// Share of the drum's motion that does not move the cable.
    pub drum_slip: f64,
    pub broken: bool,
    /// Unstretched cable off the drum at the temperature of the start, m, and its rate.
    pub paid_out_m: f64,
    pub paid_out_m_s: f64,
    /// Tension in the middle of the free cable, N.
    pub tension_n: f64,
    pub filtered_current_a: f64,
    /// Heat in the armature and electrical work on the motor since the start, J.
    pub loss_j: f64,
    pub averaged_loss_j: f64,
    pub electrical_j: f64,
    world: CableWorld,
    line: CableConfig,
    drum: Drum,
    diameter_m: f64,
    resistance_ohm: f64,
    /// Displacement of the anchor by its pole, m.
    pole_m: Vector3<f64>,
    /// Length by which the load of the cable changes it, m: see `bow_for`.
    bow_m: f64,
    /// Tension at the anchor beyond that in the middle of the cable, N.
    rise_n: f64,
    /// Direction of the friction of the pulleys: 1 after reeling in, -1 after paying out.
    friction_side: f64,
    /// Where the gear holds the drum, as cable off the drum, m.
    gear_m: f64,
}

impl Cable {
    /// The cable with this index at rest, without tension.
    pub fn new(config: &PlantConfig, index: usize, damping_s: f64) -> Self {
        let world = config.world.cable(index);
        let motor = world.motor.unwrap_or(config.motor);
        let line = world.line.unwrap_or(config.line);
        let line = CableConfig { damping_s: line.damping_s.min(damping_s), ..line };
        let drum = world.drum.unwrap_or(config.drum);
        let full_speed_m_s = config.supply_v.max(1.0) / motor.force_constant_n_a;
        let gains = config.drive.gains.unwrap_or(SpeedGains {
            p: 1.0,
            i: 0.25,
            d: 0.0,
            full_speed_counts_s: full_speed_m_s * config.idlers[index].counts_per_m,
        });
        Self {
            anchor_m: Vector3::from(config.anchors_m[index]),
            routed_m: config.routed_length_m[index],
            drive: Drive::new(config.drive, gains),
            motor: Motor::new(motor),
            idler: Idler::new(config.idlers[index], world.count_scale, 0.0),
            second: Idler::new(config.second_encoders.get(index).copied().unwrap_or_default(), world.second_scale, 0.0),
            drum_slip: 0.0,
            broken: false,
            paid_out_m: 0.0,
            paid_out_m_s: 0.0,
            tension_n: 0.0,
            filtered_current_a: 0.0,
            loss_j: 0.0,
            averaged_loss_j: 0.0,
            electrical_j: 0.0,
            line,
            drum: Drum::new(drum, config.seed.wrapping_mul(31).wrapping_add(index as u64)),
            diameter_m: drum.line_diameter_m,
            resistance_ohm: motor.resistance_ohm,
            pole_m: Vector3::zeros(),
            bow_m: 0.0,
            rise_n: 0.0,
            friction_side: 0.0,
            gear_m: 0.0,
            world,
        }
    }

    /// Puts the cable at rest under `tension_n`, with the node at `position_m`. Returns by how much pole and bow
    /// changed, m.
    pub fn settle(&mut self, position_m: Vector3<f64>, tension_n: f64, around: &Surroundings) -> f64 {
        let path = self.path(position_m);
        self.tension_n = tension_n;
        let load_n_m = self.load_n_m(around);
        self.rise_n = rise_n(&path, load_n_m);
        let (pole_m, bow_m) = (self.pole_for(&path), self.bow_for(&path, load_n_m));
        let change_m = (pole_m - self.pole_m).norm() + (bow_m - self.bow_m).abs();
        (self.pole_m, self.bow_m) = (pole_m, bow_m);
        let stretched_m = self.path(position_m).length_m + self.routed_m + self.bow_m;
        self.paid_out_m = self.line.unstretched_m(stretched_m, tension_n) / self.warm(around.warming_k);
        self.gear_m = self.paid_out_m;
        self.idler.restart(self.paid_out_m);
        self.second.restart(self.paid_out_m);
        change_m
    }

    /// The encoder that follows the cable.
    pub fn follower(&mut self) -> &mut Idler {
        if self.world.counts_turns { &mut self.second } else { &mut self.idler }
    }

    /// The way of the cable from its anchor to a node at `position_m`.
    pub fn path(&self, position_m: Vector3<f64>) -> Path {
        let tied_m = position_m + Vector3::from(self.world.attachment_m);
        self.world.guide.path(tied_m - (self.anchor_m + self.pole_m))
    }

    /// Advances tension, pole, bow and idler to the present state of the node and returns the force on the node, N.
    pub fn pull(
        &mut self,
        h: f64,
        position_m: Vector3<f64>,
        velocity_m_s: Vector3<f64>,
        around: &Surroundings,
    ) -> Vector3<f64> {
        let path = self.path(position_m);
        let load_n_m = self.load_n_m(around);
        if load_n_m != Vector3::zeros() {
            self.bow_m += (self.bow_for(&path, load_n_m) - self.bow_m) * (h / (h + FOLLOW_S));
            self.rise_n = rise_n(&path, load_n_m);
        }
        let stretched_m = path.length_m + self.routed_m + self.bow_m;
        let warm = self.warm(around.warming_k);
        self.tension_n = if self.broken {
            0.0
        } else {
            let stretched_m_s = path.direction.dot(&velocity_m_s);
            self.line.tension_n(stretched_m, self.paid_out_m * warm, stretched_m_s, self.paid_out_m_s)
        };
        if self.world.pulley_friction > 0.0 {
            // Tension times length, summed over the parts, is the cable's extension.
            let routed_m = self.routed_m * self.drum_side();
            self.tension_n *= stretched_m / (stretched_m - self.routed_m + routed_m);
        }
        if self.world.pole_stiffness_n_m < f64::INFINITY {
            self.pole_m += (self.pole_for(&path) - self.pole_m) * (h / (h + FOLLOW_S));
        }
        let strain = self.tension_n * self.drum_side() / self.line.stiffness_n;
        let (paid_out_m, pulled_m) = (self.paid_out_m, if self.broken { 0.0 } else { stretched_m / warm });
        let counts_stretched = self.world.counts_stretched;
        let follower = self.follower();
        if counts_stretched {
            follower.stretch = 1.0 + strain;
        }
        follower.follow(paid_out_m, pulled_m);
        let half_n = if self.broken { Vector3::zeros() } else { load_n_m * (0.5 * path.free_m) };
        half_n - path.direction * self.tension_n
    }

    /// Advances motor and drum with the drive's duty, and returns the current that the bridge takes from the supply, A.
    pub fn wind(&mut self, h: f64, voltage_v: f64) -> f64 {
        let bridge = match self.drive.commanded_a() {
            _ if self.drive.released() => Bridge::Shorted,
            Some(paying_out_a) => Bridge::Current { wanted_a: -paying_out_a, most_v: voltage_v },
            None => Bridge::Voltage(-self.drive.duty() * voltage_v),
        };
        let ratio = self.drum.radius_ratio(self.paid_out_m);
        let load_n = self.drum_tension_n();
        self.motor.step(h, bridge, load_n * ratio);
        let gear_m_s = -self.motor.reel_in_m_s() * ratio * (1.0 - self.drum_slip);
        let on_motor = if self.world.counts_turns { &mut self.idler } else { &mut self.second };
        on_motor.turn(-h * self.motor.reel_in_m_s());
        if self.world.backlash_m > 0.0 {
            self.turn_through_play(h, gear_m_s, load_n);
        } else {
            self.paid_out_m_s = gear_m_s;
            self.paid_out_m = (self.paid_out_m + h * self.paid_out_m_s).max(SHORTEST_OFF_M);
        }
        if self.world.pulley_friction > 0.0 {
            self.friction_side = (self.friction_side - 2.0 * h * self.paid_out_m_s / PRESLIDE_M).clamp(-1.0, 1.0);
        }
        let current_a = self.motor.current_a();
        self.filtered_current_a += (current_a - self.filtered_current_a) * (h / (h + CURRENT_FILTER_S));
        self.loss_j += h * current_a * current_a * self.resistance_ohm;
        self.averaged_loss_j += h * self.filtered_current_a * self.filtered_current_a * self.resistance_ohm;
        if let Bridge::Current { .. } = bridge {
            self.drive.needs_duty(-self.motor.voltage_v() / voltage_v.max(1.0));
        }
        if bridge != Bridge::Shorted {
            let u = -self.drive.duty() * voltage_v;
            self.electrical_j += h * u * current_a;
        }
        // The bridge steps the voltage down and the current up.
        (-self.drive.duty() * current_a).max(0.0)
    }

    /// The gear holds the drum against the cable's pull; a slack drum stays until the other flank moves it.
    fn turn_through_play(&mut self, h: f64, gear_m_s: f64, load_n: f64) {
        self.gear_m = (self.gear_m + h * gear_m_s).max(SHORTEST_OFF_M);
        let pulled_m = if load_n > DRUM_FRICTION_N { h * THROUGH_PLAY_M_S } else { 0.0 };
        let turned_m = (self.paid_out_m + pulled_m).clamp(self.gear_m - self.world.backlash_m, self.gear_m);
        self.paid_out_m_s = (turned_m - self.paid_out_m) / h;
        self.paid_out_m = turned_m.max(SHORTEST_OFF_M);
    }

    /// The half of the cable's weight and drag that the node carries, N.
    pub fn half_load_n(&self, position_m: Vector3<f64>, around: &Surroundings) -> Vector3<f64> {
        self.load_n_m(around) * (0.5 * self.path(position_m).free_m)
    }

    /// Energy of the stretched cable with the node at `position_m`, J.
    pub fn stretch_j(&self, position_m: Vector3<f64>) -> f64 {
        if self.broken {
            return 0.0;
        }
        let stretched_m = self.path(position_m).length_m + self.routed_m;
        let extension_m = (stretched_m - self.paid_out_m).max(0.0);
        0.5 * self.line.stiffness_n / self.paid_out_m * extension_m * extension_m
    }

    /// Tension of the routed part and of the drum, N: a hanging cable is tighter at its upper end than in its middle,
    /// and a pulley brakes it.
    pub fn drum_tension_n(&self) -> f64 {
        // A slack cable pulls nothing.
        let rise_n = if self.tension_n > 0.0 { self.rise_n } else { 0.0 };
        (self.tension_n + rise_n) * self.drum_side()
    }

    /// Tension at the drum relative to that at the node.
    fn drum_side(&self) -> f64 {
        1.0 + self.world.pulley_friction * self.friction_side
    }

    /// Unstretched length at the present temperature relative to that at the start.
    fn warm(&self, warming_k: f64) -> f64 {
        1.0 + self.world.expansion_per_k * warming_k
    }

    /// Weight and drag of the cable per metre, N/m. The speed of the cable itself is small beside that of a wind.
    fn load_n_m(&self, around: &Surroundings) -> Vector3<f64> {
        let weight = Vector3::new(0.0, 0.0, -self.world.mass_kg_m * around.gravity_m_s2);
        match around.air_m_s {
            Some(air) => weight + air * (around.cable_drag_n * self.diameter_m * air.norm()),
            None => weight,
        }
    }

    /// Length that the load of the cable adds to its chord. A shallow parabolic bow exceeds the chord by w² L³ / (24
    /// T²), with the load w across the chord. The load along the chord makes the tension at the anchor greater than
    /// that in the middle, by half of the free cable's load, and the routed part stretches under that tension.
    fn bow_for(&self, path: &Path, load_n_m: Vector3<f64>) -> f64 {
        let across = load_n_m - path.direction * load_n_m.dot(&path.direction);
        let tension_n = self.tension_n.max(SHALLOW_N);
        let routed_m = self.routed_m * rise_n(path, load_n_m) / self.line.stiffness_n;
        across.norm_squared() * path.free_m * path.free_m * path.free_m / (24.0 * tension_n * tension_n) - routed_m
    }

    /// Displacement of the anchor under the cable's horizontal pull, m.
    fn pole_for(&self, path: &Path) -> Vector3<f64> {
        let level = Vector3::new(path.direction.x, path.direction.y, 0.0);
        level * (self.tension_n / self.world.pole_stiffness_n_m)
    }
}

/// Tension at the anchor beyond that in the middle of a cable: half of the load along the free cable, N.
fn rise_n(path: &Path, load_n_m: Vector3<f64>) -> f64 {
    0.5 * load_n_m.dot(&path.direction) * path.free_m
}
