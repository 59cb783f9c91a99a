//! What is drawn and does not move: anchors, obstacles, keep-out boxes; and the check of a target.

use crate::drives;
use cable_robot::Vector3;
use command::{Answer, Failure};
use config::{ObstacleSection, Role, SystemFile};
use gateway_protocol::FileRow;
use serde_json::{Value, json};
use site_calibration::loads::LoadsRobot;

/// The robot of a run.
#[derive(Debug)]
pub(crate) struct Scene {
    robot: cable_robot::Robot,
    /// Encoder counts per metre of each cable.
    pub(crate) counts_per_m: Vec<f64>,
    /// Name and text of the robot file.
    pub(crate) robot_file: (String, String),
    /// For the measurements with a known weight, or why it cannot be used for them.
    pub(crate) loads: Result<LoadsRobot, String>,
    /// For browsers.
    pub(crate) value: Value,
}

impl Scene {
    /// Reads the configuration of a run, as the gateway sends it.
    ///
    /// # Errors
    /// It is not accepted.
    pub(crate) fn new(files: &[FileRow], body: &[u8]) -> Answer<Self> {
        let folder = client::unpack(files, body)?;
        let system = SystemFile::load(&folder.path().join(config::RESOLVED)).map_err(Failure::not_now)?;
        let file = system.robot_file().map_err(Failure::not_now)?;
        let robot = file.robot().map_err(Failure::not_now)?;
        let anchors: Vec<[f64; 3]> = robot.anchors().pulleys().map(|pulley| pulley.anchor.into()).collect();
        let keep_out: Vec<Value> =
            robot.keep_out().iter().map(|one| json!([vector(&one.min), vector(&one.max)])).collect();
        let text = std::fs::read_to_string(&system.robot).map_err(Failure::not_now)?;
        let value = json!({
            "type": "scene", "system": system.name, "robot": file.name, "anchors_m": anchors,
            "ground_m": robot.ground_m(), "planar": robot.is_planar(), "tension_limits_n": robot.tension_limits_n(),
            "speed_limit_m_s": robot.speed_limit_m_s(), "jog_speed_m_s": system.motor_io.jog_speed_m_s,
            "laws": laws(), "plugins": system.plugin.iter().map(|plugin| &plugin.name).collect::<Vec<_>>(),
            "supply_min_v": system.motor_io.supply_min_v, "keep_out_m": keep_out,
            "drives": drives::declared(&system, file.cable_speed_limit_m_s()),
            "robot_file": config::file::text_hash(&text),
            "obstacles": file.obstacle.iter().map(drawn).collect::<Vec<_>>(),
        });
        let name = system.robot.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let loads = LoadsRobot::new(&file, text.clone(), &name);
        Ok(Self { robot, counts_per_m: system.motor_io.counts_per_m, robot_file: (name, text), loads, value })
    }

    /// Whether the node can hang at a target, and the finding in one sentence.
    pub(crate) fn check(&self, to_m: [f64; 3]) -> (bool, String) {
        match cable_robot::motion::check_rest(&self.robot, &Vector3::from(to_m)) {
            Ok(rest) => {
                let (least, most) = (rest.least_tension_n, rest.peak_tension_n);
                (true, format!("the node can hang there, with tensions from {least:.1} to {most:.1} N"))
            }
            Err(refusal) => (false, refusal.to_string()),
        }
    }
}

/// The algorithms by role.
fn laws() -> Value {
    json!({ "controller": Role::Controller.algorithms(), "estimator": Role::Estimator.algorithms() })
}

fn vector(point: &Vector3<f64>) -> [f64; 3] {
    (*point).into()
}

/// Two corners are those of a rectangle along the axes.
fn drawn(section: &ObstacleSection) -> Value {
    let corners = match section.corners_m[..] {
        [[x0, y0], [x1, y1]] => vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
        ref more => more.to_vec(),
    };
    json!({ "center_m": section.center_m, "radius_m": section.radius_m, "corners_m": corners,
        "height_m": section.height_m })
}
