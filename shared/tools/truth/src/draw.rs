//! Distributions of the deviations. Their origins are in docs/truth.md.

use config::{PulleyKind, RobotFile};
use motor_box::MotorBoxSection;
use motor_box::section::{PerCable, TrueGuide, TruthSection};
use plant::random::Random;

/// Density of the fibre (polyethylene), kg/m³, and the share of a braid's section that it fills.
const FIBRE_KG_M3: f64 = 970.0;
const FILL: f64 = 0.8;

/// Mass of a soaked braid relative to a dry one.
const SOAKED: f64 = 1.5;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Number of the world.
    pub seed: u64,
    /// 0: the model itself; 1: a robot that was put up with care.
    pub spread: f64,
    /// Warming over ten minutes from the start, K.
    pub warming_k: f64,
    /// Mean wind, m/s.
    pub wind_m_s: f64,
}

/// Draws in a fixed order, so that a key keeps its deviation when others are added after it.
struct Draws {
    random: Random,
    spread: f64,
    cables: usize,
}

impl Draws {
    /// A deviation with standard deviation `sigma` at spread 1.
    fn normal(&mut self, sigma: f64) -> f64 {
        // Beyond three standard deviations a team would notice.
        self.spread * sigma * self.random.gaussian().clamp(-3.0, 3.0)
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.random.uniform()
    }

    /// An imperfection that has this range at spread 1 and is absent at 0.
    fn some(&mut self, low: f64, high: f64) -> f64 {
        self.spread * self.uniform(low, high)
    }

    fn each(&mut self, mut draw: impl FnMut(&mut Self, usize) -> f64) -> PerCable {
        PerCable::Each((0..self.cables).map(|i| draw(self, i)).collect())
    }

    /// `value` with a relative deviation.
    fn about(&mut self, value: f64, sigma: f64) -> f64 {
        value * (1.0 + self.normal(sigma)).max(0.2)
    }

    fn point(&mut self, sigma_m: f64, planar: bool) -> [f64; 3] {
        let [x, y, z] = std::array::from_fn(|_| self.normal(sigma_m));
        [x, if planar { 0.0 } else { y }, z]
    }
}

/// Draws the world of a seed.
#[must_use]
pub fn draw(options: &Options, section: &MotorBoxSection, robot: &RobotFile, counts_per_m: &[f64]) -> TruthSection {
    let planar = robot.robot.anchors_m.is_planar();
    let cables = robot.robot.anchors_m.len();
    let mut draws = Draws { random: Random::new(options.seed), spread: options.spread, cables };
    let mut truth = TruthSection {
        name: Some(format!("seed {}, spread {}", options.seed, options.spread)),
        seed: (options.spread > 0.0).then_some(options.seed),
        ..TruthSection::default()
    };
    geometry(&mut truth, &mut draws, robot, planar);
    measurement(&mut truth, &mut draws, robot, counts_per_m);
    node(&mut truth, &mut draws, section, robot, planar);
    cable(&mut truth, &mut draws, section);
    winch(&mut truth, &mut draws, section, robot);
    surroundings(&mut truth, &mut draws, options, robot, planar);
    truth
}

fn geometry(truth: &mut TruthSection, draws: &mut Draws, robot: &RobotFile, planar: bool) {
    let anchors = &robot.robot.anchors_m;
    let moved = anchors.iter().map(|anchor| {
        let error = draws.point(0.005, planar);
        std::array::from_fn(|axis| anchor[axis] + error[axis])
    });
    truth.anchors_m = Some(anchors.moved_to(moved.collect()));
    truth.pulley = Some(TrueGuide::Swivel);
    let known = (robot.robot.pulley == Some(PulleyKind::Swivel)).then_some(&robot.robot.pulley_radius_m);
    let unknown_m = draws.some(0.015, 0.040);
    truth.pulley_radius_m = Some(draws.each(|draws, i| {
        let radius_m = known.and_then(|radii| radii.get(i).copied()).unwrap_or(unknown_m);
        (radius_m + draws.normal(0.0005)).max(0.0)
    }));
    truth.pulley_friction = Some(draws.each(|draws, _| draws.some(0.01, 0.05).min(0.5)));
    let stiff = draws.spread > 0.0;
    let poles = draws.each(|draws, _| {
        let exponent = draws.uniform(libm::log(5_000.0), libm::log(50_000.0));
        (libm::exp(exponent) / draws.spread.max(1e-3)).clamp(500.0, 1e9)
    });
    truth.pole_stiffness_n_m = stiff.then_some(poles);
}

fn measurement(truth: &mut TruthSection, draws: &mut Draws, robot: &RobotFile, counts_per_m: &[f64]) {
    truth.counts_per_m = Some(draws.each(|draws, i| draws.about(counts_per_m[i].abs(), 0.0005)));
    truth.slip = Some(draws.each(|draws, _| draws.some(0.0, 0.0002)));
    truth.counts_stretched = Some(vec![draws.spread > 0.0; draws.cables]);
    let routed = &robot.lines.routed_length_m;
    truth.routed_length_m = Some(draws.each(|draws, i| {
        let length_m = routed.get(i).copied().unwrap_or(0.0);
        (length_m + draws.normal(0.05)).max(0.0)
    }));
}

fn node(truth: &mut TruthSection, draws: &mut Draws, section: &MotorBoxSection, robot: &RobotFile, planar: bool) {
    let weight = 1.0 + draws.normal(0.03);
    truth.node_mass_kg = Some(robot.robot.node_mass_kg * weight.max(0.5));
    // A floating node keeps its trim.
    truth.net_weight_n = robot.robot.net_weight_n.map(|weight_n| weight_n * weight.max(0.5));
    truth.attachments_m = Some((0..draws.cables).map(|_| draws.point(0.005, planar)).collect());
    truth.drag_n_s2_m2 = Some(draws.about(section.drag_n_s2_m2, 0.3));
    truth.pendulum_m = draws.some(0.1, 0.3);
    truth.pendulum_damping = Some(draws.uniform(0.02, 0.05));
}

fn cable(truth: &mut TruthSection, draws: &mut Draws, section: &MotorBoxSection) {
    let reel = 1.0 + draws.normal(0.1);
    truth.stiffness_n = Some(draws.each(|draws, _| draws.about(section.stiffness_n * reel.max(0.3), 0.03)));
    let area_m2 = 0.25 * core::f64::consts::PI * section.line_diameter_m * section.line_diameter_m;
    let mass_kg_m = FIBRE_KG_M3 * FILL * area_m2 * draws.spread.min(1.0);
    truth.line_mass_kg_m = Some(PerCable::All(mass_kg_m));
    truth.line_wet_mass_kg_m = Some(PerCable::All(mass_kg_m * SOAKED));
    truth.thermal_expansion_per_k = Some(PerCable::All(draws.some(-12e-6, 45e-6)));
}

fn winch(truth: &mut TruthSection, draws: &mut Draws, section: &MotorBoxSection, robot: &RobotFile) {
    let motor = &robot.motor;
    let radius_m = robot.drum.as_ref().map_or(section.drum_radius_m, |drum| 0.5 * drum.diameter_m);
    truth.drum_radius_m = Some(draws.each(|draws, _| draws.about(radius_m, 0.01)));
    truth.backlash_m = Some(draws.each(|draws, _| draws.some(0.0003, 0.001)));
    truth.stiction = Some(draws.each(|draws, _| draws.some(0.05, 0.3).min(2.0)));
    truth.gear_friction = Some(draws.each(|draws, _| draws.about(motor.gear_friction, 0.05)));
    truth.coulomb_n = Some(draws.each(|draws, _| draws.about(motor.coulomb_n, 0.2)));
    truth.viscous_n_s_m = Some(draws.each(|draws, _| draws.about(motor.viscous_n_s_m, 0.2)));
    truth.force_constant_n_a = Some(draws.each(|draws, _| draws.about(motor.force_constant_n_a, 0.05)));
    truth.resistance_ohm = Some(draws.each(|draws, _| draws.about(motor.resistance_ohm, 0.05)));
}

fn surroundings(truth: &mut TruthSection, draws: &mut Draws, options: &Options, robot: &RobotFile, planar: bool) {
    truth.ground_m = Some(robot.robot.ground_m + draws.normal(0.01));
    let heading = draws.uniform(0.0, 2.0 * core::f64::consts::PI);
    if options.warming_k != 0.0 {
        (truth.warming_k, truth.warming_s) = (options.warming_k, 600.0);
    }
    if options.wind_m_s > 0.0 {
        let (x, y) = (libm::cos(heading), libm::sin(heading));
        truth.wind_m_s =
            if planar { [options.wind_m_s * x.signum(), 0.0] } else { [options.wind_m_s * x, options.wind_m_s * y] };
        truth.gust_m_s = 0.2 * options.wind_m_s;
    }
}
