//! A flight with four cables between uneven poles, computed in lockstep, with all decisions of each cycle.

use super::settings::Settings;
use anyhow::{Context, Result, ensure};
use cable_robot::{Robot, RobotParts};
use controller::Law;
use estimator::Method;
use lockstep::{Cycle, Lockstep, Scenario};
use messages::Header;
use planner::Mission;
use plant::PlantConfig;

/// Tops of four asymmetric poles, as in an installation in a wood, m.
const ANCHORS_M: [[f64; 3]; 4] = [[0.0, 0.0, 6.0], [10.4, 0.3, 6.3], [9.7, 8.9, 5.8], [-0.5, 9.4, 6.1]];
/// Corners of the flown square, m.
const PATH_M: [[f64; 3]; 4] = [[2.5, 2.5, 4.0], [7.5, 2.5, 4.0], [7.5, 7.5, 4.0], [2.5, 7.5, 4.0]];
/// Mass of the node, kg.
const NODE_MASS_KG: f64 = 2.0;
/// Least and largest tension, N.
const LIMITS_N: [f64; 2] = [1.0, 150.0];
/// Speed of the node, m/s.
const SPEED_M_S: f64 = 0.2;
/// Number of cycles; the node moves after the first second.
const CYCLES: usize = 1000;
/// Delay and lag of the drives, s.
const DRIVES_S: [f64; 2] = [0.030, 0.040];
/// Encoder counts per metre of cable: a wheel of 15 mm radius with 1024 counts per turn.
const COUNTS_PER_M: f64 = 10_865.0;

/// Creates the scenario.
///
/// # Errors
/// The law or the method of the system file cannot be used.
pub fn scenario(settings: &Settings) -> Result<Scenario> {
    let robot = Robot::new(RobotParts {
        anchors_m: ANCHORS_M.to_vec(),
        node_mass_kg: NODE_MASS_KG,
        tension_limits_n: LIMITS_N,
        speed_limit_m_s: 0.5,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; ANCHORS_M.len()]),
        ..RobotParts::default()
    })?;
    let [start_m, ..] = PATH_M;
    let mut plant = PlantConfig::new(ANCHORS_M.to_vec(), start_m);
    plant.node.mass_kg = NODE_MASS_KG;
    plant.start_limits_n = LIMITS_N;
    [plant.drive.delay_s, plant.drive.lag_s] = DRIVES_S;
    plant.idlers.iter_mut().for_each(|idler| idler.counts_per_m = COUNTS_PER_M);
    let points: Vec<String> = PATH_M[1..].iter().map(|point| format!("{point:?}")).collect();
    let mission = format!(
        "name = \"bench\"\nspeed_m_s = {}\n[[leg]]\npolyline = {{ points_m = [{}] }}\n",
        SPEED_M_S,
        points.join(", ")
    );
    let period_s = 1.0 / settings.rate_hz;
    Ok(Scenario {
        robot,
        plant,
        mission: Mission::parse(&mission)?,
        period_s,
        law: Law::from_section(&settings.controller)?,
        horizon: (2.0 * DRIVES_S.iter().sum::<f64>() / period_s).round() as u32 + 3,
        method: Method::from_section(&settings.estimator)?,
        stretch: true,
        distribution: robot.default_distribution(),
        longest_s: 300.0,
    })
}

/// Flies the scenario cycle by cycle.
///
/// # Errors
/// The flight is not possible.
pub fn fly(scenario: &Scenario) -> Result<Vec<Cycle>> {
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::new(scenario.clone())?;
    lockstep.zero_and_arm()?;
    lockstep.run(&mission).context("the planner rejected the mission")?;
    let cycles = (0..CYCLES).map(|_| lockstep.cycle()).collect::<Result<Vec<_>>>()?;
    let commanded = cycles.iter().filter(|cycle| cycle.command.valid[0] == 1 && cycle.control.valid == 1).count();
    ensure!(commanded > CYCLES / 2, "the flight has only {commanded} commands");
    Ok(cycles)
}

/// Channels on which a cycle publishes and the recorder records; [`samples`] returns their bytes.
pub const CHANNELS: [&str; 8] = [
    "motor/input",
    "motor/state",
    "motor/authority",
    "motor/slots",
    "node/estimate/a",
    "motor/command/a",
    "control/status/a",
    "energy",
];

/// Returns the samples of a cycle in the order of [`CHANNELS`], each with its header.
pub fn samples(cycle: &Cycle) -> [(&Header, &[u8]); CHANNELS.len()] {
    fn one<T: messages::Message>(sample: &T) -> (&Header, &[u8]) {
        (sample.header(), bytemuck::bytes_of(sample))
    }
    [
        one(&cycle.input),
        one(&cycle.state),
        one(&cycle.authority),
        one(&cycle.slots),
        one(&cycle.estimate),
        one(&cycle.command),
        one(&cycle.control),
        one(&cycle.energy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flight_works_at_every_permitted_rate() {
        for rate_hz in [10.0, 100.0, 250.0, 500.0] {
            let settings = Settings { rate_hz, ..Settings::default() };
            let cycles = fly(&scenario(&settings).unwrap()).unwrap();
            let tensions = cycles.iter().flat_map(|cycle| cycle.truth_n.iter().copied().collect::<Vec<_>>());
            assert!(tensions.fold(f64::INFINITY, f64::min) > 0.0, "a cable is slack at {rate_hz} Hz");
            let moved = cycles.iter().map(|cycle| cycle.truth_m[0]).fold(f64::NEG_INFINITY, f64::max);
            assert!(moved > PATH_M[0][0] + 0.1, "{moved}");
        }
    }
}
