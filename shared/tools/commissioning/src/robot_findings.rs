//! Findings about a robot file.

use crate::bow::Bow;
use crate::finding::{Finding, error, note, warning};
use crate::{preload, swing};
use cable_robot::energy::MotorTable;
use cable_robot::kinematics::inverse_kinematics;
use cable_robot::motor::DriveLoad;
use cable_robot::{Distribution, NodeJacobian, Robot, Vector3, sag, tension};
use command::{Answer, Failure, points};
use config::{CalibrationFile, RobotFile};

/// Minimum width of the anchors' layout as a share of its length: below it, lengths that are 5 mm off move the node by
/// more than 100 times as much.
const MIN_WIDTH_SHARE: f64 = 0.01;

/// Returns the default position of the node: below the centre of the anchors, at a quarter of the height of the lowest
/// anchor above the ground; for a node without net weight, the centre of the anchors.
pub(crate) fn middle(robot: &Robot) -> Vector3<f64> {
    let anchors = robot.anchors();
    let mut centre = anchors.iter().sum::<Vector3<f64>>() / anchors.len() as f64;
    let lowest = anchors.iter().map(|anchor| anchor.z).fold(f64::INFINITY, f64::min);
    if robot.net_weight_n() == 0.0 {
        return centre;
    }
    centre.z = robot.ground_m() + 0.25 * (lowest - robot.ground_m());
    centre
}

/// Warns of nearly collinear anchors, which leave one coordinate of the node poorly determined.
fn collinear_anchors(robot: &Robot) -> Option<Finding> {
    let [first, rest @ ..] = &robot.anchors()[..] else { return None };
    let along = rest.iter().map(|p| p - first).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
    let beside = rest.iter().map(|p| along.cross(&(p - first)).norm() / along.norm_squared()).fold(0.0, f64::max);
    (!robot.is_planar() && beside < MIN_WIDTH_SHARE).then(|| {
        let (off_m, long_m) = (beside * along.norm(), along.norm());
        warning(
            format!("the anchors lie within {off_m:.3} m of one straight line of {long_m:.1} m, so the position of the node across it is poorly determined"),
            "check anchors_m, or put one anchor farther from that line",
        )
    })
}

/// The stretch of the cable that stretches most while the node hangs in the middle.
fn stretch_finding(robot: &Robot, at: &Vector3<f64>, distribution: Distribution, stiffness_n: f64) -> Finding {
    let lengths_m = inverse_kinematics(robot.anchors(), at);
    let tensions_n = tension::at(robot, at, &Vector3::zeros(), distribution).map(|found| found.tensions_n);
    let most = tensions_n.iter().flat_map(|tensions| tensions.iter()).enumerate().map(|(i, tension_n)| {
        let cable_m = lengths_m[i] + robot.routed_length_m().get(i).copied().unwrap_or(0.0);
        (tension_n * cable_m / stiffness_n, cable_m, i + 1)
    });
    note(match most.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((stretch_m, cable_m, cable)) => {
            let stretch_mm = 1000.0 * stretch_m;
            format!(
                "in the middle cable {cable}, {cable_m:.0} m with its routed part, stretches by {stretch_mm:.0} mm; this is compensated"
            )
        }
        None => "the stretch of the cables is compensated".to_owned(),
    })
}

/// States what the weight of the cables does, and warns where the first order is not enough.
fn weight_finding(robot: &Robot, middle: &Vector3<f64>, distribution: Distribution) -> Option<Finding> {
    let bow = Bow::deepest(robot, middle, distribution)?;
    let text = bow.in_words(robot);
    if bow.sag_share <= sag::SHALLOW {
        return Some(note(text));
    }
    let most = 1.0 / sag::SHALLOW;
    Some(warning(
        format!("{text}, and the first order is enough up to a sag of 1/{most:.0}"),
        "raise the least tension in tension_limits_n, or use lighter cables",
    ))
}

/// Describes a robot and warns of what limits it.
pub(crate) fn robot(file: &RobotFile) -> Answer<Vec<Finding>> {
    let robot = file.robot().map_err(Failure::bad)?;
    let distribution = robot.default_distribution();
    let at = middle(&robot);
    let place = points::in_words(&robot, &at);
    let mut findings = Vec::new();
    match tension::at(&robot, &at, &Vector3::zeros(), distribution) {
        Ok(found) => {
            let list: Vec<String> = found.tensions_n.iter().map(|value| format!("{value:.1}")).collect();
            findings.push(note(format!("at rest in the middle, {place}, the cables carry {} N", list.join(", "))));
            findings.push(sinking_finding(&robot, &at, &found.tensions_n));
            findings.push(ceiling_finding(&robot, &at, distribution));
        }
        Err(why) => findings.push(error(
            format!("the cables cannot hold the node in the middle of the anchors, {place}: {why}"),
            "check the units of anchors_m (metres), node_mass_kg (kilograms) and tension_limits_n (newtons)",
        )),
    }
    findings.extend(swing::modes(&robot, &at, distribution).map(note));
    findings.push(match robot.stiffness_n() {
        Some(stiffness_n) => stretch_finding(&robot, &at, distribution, stiffness_n),
        None => warning(
            "the cables are treated as rigid: their stretch, some centimetres, becomes a position error".to_owned(),
            "give stiffness_n in [lines]; braided polyethylene of 0.33 mm has about 6000 N",
        ),
    });
    findings.extend(weight_finding(&robot, &at, distribution));
    if file.calibration.is_none() {
        findings.extend(preload::finding(&robot, &at, distribution));
    }
    findings.extend(collinear_anchors(&robot));
    findings.extend(file.calibration.as_ref().map(calibration_finding));
    findings.extend(file.identified_in_words().map(note));
    let tables = file.motor_tables.len();
    for cable in 0..tables {
        let whose =
            if tables > 1 { format!("the motor table of cable {}", cable + 1) } else { "the motor table".to_owned() };
        findings.extend(robot.motor_table(cable).map(|table| motor_table_finding(&robot, table, &whose)));
    }
    findings.extend(motor_finding(&robot));
    Ok(findings)
}

/// Warns of a node speed that the motors do not reach at the highest tension.
fn motor_finding(robot: &Robot) -> Option<Finding> {
    let limits = robot.drive_limits();
    let loads = (0..robot.cable_count())
        .map(|cable| robot.drive_load(cable, robot.tension_limits_n()[1], robot.speed_limit_m_s()));
    let load = loads.max_by(|a, b| a.current_a.total_cmp(&b.current_a))?;
    let excess = match load {
        DriveLoad { current_a, .. } if !limits.allow_current(&load) => {
            format!("takes {current_a:.1} A, above current_limit_a = {} A", limits.current_a)
        }
        DriveLoad { voltage_v, .. } if !limits.allow_voltage(&load) => {
            format!(
                "takes {voltage_v:.1} V, and supply_min_v less the reserve of the drive is {:.1} V",
                limits.voltage_v
            )
        }
        _ => return None,
    };
    Some(warning(
        format!("reeling in at {} m/s under {} N {excess}", load.reel_in_m_s, load.tension_n),
        "lower tension_limits_n or speed_limit_m_s, or fit larger motors; slower and lighter moves are not affected",
    ))
}

/// Describes the calibration of the anchors and its accuracy.
fn calibration_finding(file: &CalibrationFile) -> Finding {
    let (anchor, axis, std_m) = file.worst();
    let mut sentence = format!(
        "the anchors come from the calibration of {} ({}); the least certain coordinate is {axis} of anchor {anchor}, ±{std_m:.3} m",
        file.date, file.method
    );
    if file.scale_std > 0.0 {
        let then = match file.true_counts_per_m() {
            Some(counts) => format!("measured by the robot, so it uses {counts:.1?} counts per metre instead"),
            None => "not measured by the robot (no counts_per_m), so the encoder scale is unchanged".to_owned(),
        };
        sentence.push_str(&format!(
            "; the measured lengths are {:.4} ±{:.4} times the true ones and were {then}",
            file.scale, file.scale_std
        ));
    }
    if file.verdict.starts_with("poor") {
        return warning(sentence, "add points near the corners below the anchors and calibrate again before a mission");
    }
    note(sentence)
}

/// Compares the range of the motor table with the limits of the robot.
fn motor_table_finding(robot: &Robot, table: &MotorTable, whose: &str) -> Finding {
    let ends = |axis: &[f64]| [axis[0], axis[axis.len() - 1]];
    let ([slowest, fastest], [loosest, tightest]) = (ends(table.speeds_m_s()), ends(table.tensions_n()));
    let sentence = format!(
        "{whose} covers {slowest} to {fastest} m/s and {loosest} to {tightest} N; the energy of a move beyond this range is unknown"
    );
    let limit = robot.speed_limit_m_s();
    if slowest > -limit || fastest < limit {
        let cure = "record runs that raise and lower loads at speed_limit_m_s; slower moves are not affected";
        return warning(sentence, cure);
    }
    note(sentence)
}

/// Computes how fast the node sinks when the drives stop powering the motors: their leads are shorted, so only gear
/// friction and the motors' own braking hold the load.
fn sinking_finding(robot: &Robot, at: &Vector3<f64>, tensions_n: &[f64]) -> Finding {
    let pays_out: Vec<f64> = tensions_n.iter().map(|tension| unpowered_m_s(robot, *tension)).collect();
    let fastest = pays_out.iter().fold(0.0_f64, |most, speed| most.max(*speed));
    if fastest == 0.0 {
        let motor = robot.motor();
        let most = robot.tension_limits_n()[1];
        let beyond = match unpowered_m_s(robot, most) {
            0.0 => "at any load".to_owned(),
            speed => {
                let holds = motor.coulomb_n / (1.0 - motor.gear_friction) / fullest_ratio(robot);
                format!("up to {holds:.1} N per cable; at {most} N a cable would unwind at {:.1} mm/s", 1000.0 * speed)
            }
        };
        return note(format!("unpowered, the gears hold the node: sinking speed 0 mm/s ({beyond})"));
    }
    if robot.net_weight_n() == 0.0 {
        return note(format!(
            "unpowered, a cable unwinds at {:.1} mm/s until it is slack; the node does not sink",
            1000.0 * fastest
        ));
    }
    let node =
        NodeJacobian::at(robot.anchors(), at).map_or(fastest, |jacobian| jacobian.node_velocity(&pays_out).norm());
    warning(
        format!(
            "unpowered, a cable unwinds at {:.1} mm/s and the node sinks at {:.1} mm/s",
            1000.0 * fastest,
            1000.0 * node
        ),
        "support the node before `disarm`, before switching off and after a watchdog stop",
    )
}

/// Returns the speed at which a cable unwinds from a motor with shorted leads, m/s: the load less friction, divided by
/// the motor's braking; of the fullest drum, on which the load pulls hardest.
fn unpowered_m_s(robot: &Robot, tension_n: f64) -> f64 {
    let (motor, ratio) = (robot.motor(), fullest_ratio(robot));
    let pull_n = tension_n * ratio;
    let drives = pull_n - (motor.gear_friction * pull_n + motor.coulomb_n);
    let braking = motor.viscous_n_s_m + motor.force_constant_n_a.powi(2) / motor.resistance_ohm;
    ratio * drives.max(0.0) / braking
}

/// Radius of the fullest drum relative to that of the bare one.
fn fullest_ratio(robot: &Robot) -> f64 {
    let limits_m = robot.length_limits_m().iter().enumerate();
    limits_m.map(|(cable, [shortest_m, _])| robot.drum(cable).radius_ratio(*shortest_m)).fold(0.0, f64::max)
}

/// Finds the greatest feasible height of the node above `from`.
fn ceiling_finding(robot: &Robot, from: &Vector3<f64>, distribution: Distribution) -> Finding {
    let mut at = *from;
    while tension::at(robot, &at, &Vector3::zeros(), distribution).is_ok() {
        at.z += 0.01;
    }
    note(format!("in the middle the node can rise to {:.2} m within tension_limits_n", at.z - 0.01))
}
