//! Robots in drawn worlds, with the true distance of node and cables from obstacles.

use cable_robot::{Anchors, CableVec, Obstacle, Vector3};
use config::{CalibrationFile, RobotFile, SystemFile};
use motor_box::BoxConfig;
use nims_tests::lockstep::{Chain, Lockstep, Scenario};
use nims_tests::scenarios;
use nims_truth::Args;
use plant::PlantConfig;
use plant::pulley::Guide;
use std::path::{Path, PathBuf};

/// Points of a cable at which its distance is computed.
const POINTS: u32 = 80;

/// Standard deviation of an anchor's coordinate in a drawn world, m, which a calibration there states.
pub const ANCHOR_SIGMA_M: f64 = 0.005;

pub fn system(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/systems").join(name).with_extension("toml")
}

/// The files of a robot, and the world that it is in.
#[derive(Clone)]
pub struct Drawn {
    pub file: SystemFile,
    pub robot: RobotFile,
    pub plant: PlantConfig,
}

impl Drawn {
    /// Draws a world for an example system at spread 1.
    pub fn new(name: &str, seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("system.toml");
        let args = Args { system: system(name), seed, spread: 1.0, warming: 0.0, wind: 0.0, out: Some(out.clone()) };
        nims_truth::run(&args).unwrap();
        let file = SystemFile::load(&out).unwrap();
        let robot = file.robot_file().unwrap();
        let plant = BoxConfig::from_files(&file, &robot, Path::new("/")).unwrap().plant;
        Self { file, robot, plant }
    }

    /// States the deviation of the anchors that the world was drawn with, as a calibration does.
    pub fn state_anchors(&mut self) {
        let n = 3 * self.plant.cable_count();
        let row = |i: usize| (0..n).map(|j| if i == j { ANCHOR_SIGMA_M.powi(2) } else { 0.0 }).collect();
        self.robot.calibration = Some(CalibrationFile {
            method: "survey".to_owned(),
            date: String::new(),
            verdict: "good".to_owned(),
            anchors_m: self.robot.robot.anchors_m.to_vec(),
            covariance_m2: (0..n).map(row).collect(),
            length_covariance: Vec::new(),
            scale: 1.0,
            scale_std: 0.0,
            counts_per_m: None,
            pulley: None,
            pulley_radius_m: Vec::new(),
            cable_scale: Vec::new(),
        });
    }

    /// The chain of the files in this world, before the first cycle.
    pub fn lockstep(&self) -> Lockstep {
        self.lockstep_with(Chain::from_files(&self.file, &self.robot).unwrap())
    }

    /// The same with another chain.
    pub fn lockstep_with(&self, chain: Chain) -> Lockstep {
        let robot = self.robot.robot().unwrap();
        let mission = scenarios::mission("polyline").unwrap();
        let scenario = Scenario::from_files(&self.file, robot, self.plant.clone(), mission).unwrap();
        Lockstep::with(scenario, chain).unwrap()
    }

    /// True anchors with their wheels.
    pub fn true_anchors(&self) -> Anchors {
        let radius_m = |guide: &Guide| if let Guide::Swivel { radius_m } = guide { *radius_m } else { 0.0 };
        let radii_m: Vec<f64> = self.plant.world.cables.iter().map(|cable| radius_m(&cable.guide)).collect();
        Anchors::new(&self.plant.anchors_m).unwrap().with_pulleys(&radii_m).unwrap()
    }

    /// Least true distance of the node and of the hanging cables from the bodies, m. Of a cable, `root_m` after its
    /// pulley are left out.
    pub fn least_distance_m(&self, node_m: [f64; 3], tensions_n: &CableVec, bodies: &[Obstacle], root_m: f64) -> f64 {
        let node = Vector3::from(node_m);
        let anchors = self.true_anchors();
        let mut least_m = bodies.iter().map(|body| body.distance_m(&node)).fold(f64::INFINITY, f64::min);
        for (pulley, (cable, tension_n)) in anchors.pulleys().zip(self.plant.world.cables.iter().zip(&tensions_n[..])) {
            let end = node + Vector3::from(cable.attachment_m);
            let free = pulley.cable_to(&end).unwrap();
            let start = end - free.direction * free.free_m;
            let weight_n_m = cable.mass_kg_m * self.plant.gravity_m_s2;
            let sag_m = (weight_n_m * free.free_m.powi(2) / (8.0 * tension_n.max(1e-3))).min(0.3 * free.free_m);
            for k in 0..=POINTS {
                let u = f64::from(k) / f64::from(POINTS);
                if u * free.free_m < root_m {
                    continue;
                }
                let at = start + (end - start) * u - Vector3::new(0.0, 0.0, 4.0 * sag_m * u * (1.0 - u));
                least_m = bodies.iter().map(|body| body.distance_m(&at)).fold(least_m, f64::min);
            }
        }
        least_m
    }
}

/// A number of an environment variable.
pub fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().map_or(default, |text| text.parse().unwrap())
}
