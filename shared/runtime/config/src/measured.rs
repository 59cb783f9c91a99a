//! Files of measurements that a robot file names: a calibration and a motor table.

use crate::{ConfigError, Problem, PulleyKind, toml_file};
use cable_robot::energy::CurrentTable;
use serde::Deserialize;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Name of the run's system file with every key, in the run folder; every process of the run reads it.
pub const RESOLVED: &str = "resolved.toml";

/// Name of the resolved system file for the virtual motor box, which alone has `[motor_box]` with its content.
pub const MOTOR_BOX: &str = "motor-box.toml";

/// A calibration as written by `nims calibrate --out`. Other keys of the file (measurements, residuals) are information
/// for the reader.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct CalibrationFile {
    /// Method: `survey`, `joint` or `gps`.
    pub method: String,
    /// Date of the calibration, UTC.
    pub date: String,
    /// Good, usable or poor, with the reason.
    pub verdict: String,
    /// Points where the cables leave their pulleys, m.
    #[serde(deserialize_with = "crate::each_exactly")]
    pub anchors_m: Vec<[f64; 3]>,
    /// Covariance of x1, y1, z1, x2, .., m².
    pub covariance_m2: Vec<Vec<f64>>,
    /// Covariance of what the lengths depend on, per cable: x, y, z of the anchor less those of the point where the
    /// cable is tied (m), scale (share), radius (m); see [`cable_robot::RobotParts::length_covariance`]. Empty in older
    /// files and if the measurements do not state how exact scales and ties are.
    #[serde(default)]
    pub length_covariance: Vec<Vec<f64>>,
    /// Ratio of the measured lengths to the true lengths.
    #[serde(default = "one")]
    pub scale: f64,
    /// Standard deviation of `scale`; 0 if the scale was not estimated.
    #[serde(default)]
    pub scale_std: f64,
    /// Encoder counts per metre with which the lengths were computed. `None` if the lengths were measured with a tape.
    pub counts_per_m: Option<Vec<f64>>,
    /// What the cables leave from. `None` if the measurements did not state it, and in older files.
    pub pulley: Option<PulleyKind>,
    /// Radius of each pulley, m: stated or estimated. Empty for eyes.
    #[serde(default)]
    pub pulley_radius_m: Vec<f64>,
    /// Ratio of the measured length to the true length per cable, by a tape along each cable, in addition to `scale`.
    /// Empty if no cable was checked. Needs `counts_per_m`.
    #[serde(default)]
    pub cable_scale: Vec<f64>,
}

/// Largest difference between a radius of the robot file and that of a calibration with the same pulleys, m: a radius
/// measured with a ruler.
const SAME_RADIUS_M: f64 = 0.002;

/// Accepted values of `cable_scale`: beyond them, the counts are those of another wheel.
const CABLE_SCALES: RangeInclusive<f64> = 0.9..=1.1;

/// Largest relative difference between `counts_per_m` of the system file and of a calibration with the same encoders.
const SAME_ENCODERS: f64 = 0.1;

fn one() -> f64 {
    1.0
}

impl CalibrationFile {
    /// Reads a calibration. [`cable_robot::Robot::new`] checks the numbers of its anchors.
    ///
    /// # Errors
    /// The file cannot be read or parsed, or its scales fit no encoders: one sentence that names the file.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        toml_file::load_checked(path, Self::check_cable_scale)
    }

    fn check_cable_scale(&self) -> Result<(), Problem> {
        const KEY: &str = "cable_scale";
        let scales = &self.cable_scale;
        let cables = self.anchors_m.len();
        if !scales.is_empty() && scales.len() != cables {
            let clause = format!(
                "has {} values for {cables} cables; give one per cable, 1 for one without a check",
                scales.len()
            );
            return Err(Problem::with_clause(KEY, clause));
        }
        if let Some(scale) = scales.iter().find(|scale| !CABLE_SCALES.contains(scale)) {
            let clause = format!("contains {scale}; accepted: 0.9 to 1.1, or correct `counts_per_m` and check again");
            return Err(Problem::with_clause(KEY, clause));
        }
        if !scales.is_empty() && self.counts_per_m.is_none() {
            let clause = "needs `counts_per_m`, the counts with which the lengths were computed; add them";
            return Err(Problem::with_clause(KEY, clause));
        }
        Ok(())
    }

    /// Returns the encoder counts per true metre of each cable, if the calibration used the robot's encoders:
    /// `counts_per_m` counts were taken for one metre but are 1 / (`scale` x `cable_scale`) true metres.
    #[must_use]
    pub fn true_counts_per_m(&self) -> Option<Vec<f64>> {
        let of_cable = |i: usize| self.cable_scale.get(i).copied().unwrap_or(1.0);
        let counts = self.counts_per_m.as_ref()?.iter().enumerate();
        Some(counts.map(|(i, counts)| counts * self.scale * of_cable(i)).collect())
    }

    /// Returns the replacement for `counts_per_m` of a system file; `None` if the calibration did not use the encoders.
    ///
    /// # Errors
    /// The calibration was made with other encoders.
    pub(super) fn encoders(&self, configured: &[f64]) -> Result<Option<Vec<f64>>, Problem> {
        let Some(counts) = self.true_counts_per_m() else { return Ok(None) };
        let same = |(counts, configured): (&f64, &f64)| (counts / configured - 1.0).abs() <= SAME_ENCODERS;
        if counts.len() != configured.len() || !counts.iter().zip(configured).all(same) {
            let clause = format!(
                "is {configured:?}, but the calibration of {} found {counts:.1?}: these are other encoders; calibrate again",
                self.date
            );
            return Err(Problem::with_clause("motor_io.counts_per_m", clause));
        }
        Ok(Some(counts))
    }

    /// Returns the kind and the radii of the pulleys of a robot whose file states these: those of the calibration,
    /// since its anchors are right with them only; as in the robot file if the calibration states nothing.
    ///
    /// # Errors
    /// The calibration was made for other pulleys.
    pub(super) fn pulleys(
        &self,
        kind: Option<PulleyKind>,
        radii_m: &[f64],
    ) -> Result<(Option<PulleyKind>, Vec<f64>), Problem> {
        let Some(measured) = self.pulley else { return Ok((kind, radii_m.to_vec())) };
        let own = if measured == PulleyKind::Swivel { self.pulley_radius_m.as_slice() } else { &[] };
        let stated = kind == Some(PulleyKind::Swivel) && radii_m.iter().any(|r| *r > 0.0);
        let radius = |radii_m: &[f64], i: usize| radii_m.get(i).copied().unwrap_or(0.0);
        let count = own.len().max(radii_m.len());
        let apart = (0..count).any(|i| (radius(own, i) - radius(radii_m, i)).abs() > SAME_RADIUS_M);
        if stated && apart {
            let clause = format!(
                "is {radii_m:?}, but the calibration of {} holds for radii of {own:.4?}; measure them, and calibrate again with the right ones, or remove this key to use those",
                self.date
            );
            return Err(Problem::with_clause("robot.pulley_radius_m", clause));
        }
        Ok((Some(measured), own.to_vec()))
    }

    /// Returns the least certain coordinate: number of the anchor from 1, axis, standard deviation in m.
    #[must_use]
    pub fn worst(&self) -> (usize, char, f64) {
        let variances = self.covariance_m2.iter().enumerate().map(|(i, row)| (i, row.get(i).copied().unwrap_or(0.0)));
        let (at, variance) = variances.fold((0, 0.0), |worst, one| if one.1 > worst.1 { one } else { worst });
        (at / 3 + 1, ['x', 'y', 'z'][at % 3], variance.sqrt())
    }
}

/// A motor table as written by `nims motor-table --out`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct MotorTableFile {
    /// Reel-in speeds, m/s, ascending; negative pays out.
    pub speeds_m_s: Vec<f64>,
    /// Cable tensions, N, ascending.
    pub tensions_n: Vec<f64>,
    /// Armature currents, A: one row per speed, one value per tension.
    pub currents_a: Vec<Vec<f64>>,
}

impl MotorTableFile {
    /// Reads and checks a table.
    ///
    /// # Errors
    /// The file cannot be read or is no table: one sentence that names the file.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        toml_file::load_checked(path, |file: &Self| match file.table(0.0) {
            Ok(_) => Ok(()),
            Err(error) => Err(Problem::with_sentence("currents_a", error.to_string())),
        })
    }

    /// Returns the current table for motors with this armature resistance, ohm.
    ///
    /// # Errors
    /// The numbers form no valid table.
    pub fn table(&self, resistance_ohm: f64) -> Result<CurrentTable, cable_robot::energy::TableError> {
        CurrentTable::new(self.speeds_m_s.clone(), self.tensions_n.clone(), &self.currents_a, resistance_ohm)
    }
}

/// Resolves the path `named` in a file of `folder`: relative to `folder`, or, if there is no such file, the file of
/// that name in `folder` itself.
pub(super) fn resolve_named_file(folder: &Path, named: &Path) -> PathBuf {
    let relative = crate::file::join_normalized(folder, named);
    let copy = named.file_name().map(|name| folder.join(name));
    // A run folder holds copies, which take precedence over the originals.
    let is_run = folder.join(RESOLVED).is_file();
    match copy {
        Some(copy) if (is_run || !relative.is_file()) && copy.is_file() => copy,
        _ => relative,
    }
}

#[cfg(test)]
mod tests {
    use crate::file;
    use crate::toml_file::ConfigError;
    use crate::{CalibrationFile, RobotFile};
    use std::path::Path;

    const ROBOT: &str = "name = \"r\"\n[robot]\nnode_mass_kg = 1.2\ncalibration = \"../sites/pond.toml\"\n\
        tension_limits_n = [2.0, 60.0]\nspeed_limit_m_s = 0.4\nacceleration_limit_m_s2 = 0.5\n\
        [motor]\nresistance_ohm = 2.0\ntable = \"winch.toml\"\n";
    const TABLE: &str = "date = \"2026-01-01\"\nspeeds_m_s = [-0.5, 0.5]\ntensions_n = [0.0, 80.0]\n\
        currents_a = [[0.0, 0.0], [1.0, 5.0]]\n";

    fn calibration(variance: &str) -> String {
        let rows: Vec<String> = (0..9)
            .map(|i| {
                let row = (0..9).map(|j| if i == j { variance } else { "0.0" }).collect::<Vec<_>>().join(", ");
                format!("[{row}]")
            })
            .collect();
        format!(
            "date = \"2026-01-01T00:00:00Z\"\nmethod = \"survey\"\nverdict = \"good: all\"\n\
             anchors_m = [[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [4.0, 8.0, 3.0]]\ncovariance_m2 = [{}]\n\
             [measurements]\nsigma_length_m = 0.01\n",
            rows.join(", ")
        )
    }

    /// Writes `robots/robot.toml` and the folders of the files that it names, and loads it.
    fn load(folder: &Path, robot: &str) -> Result<RobotFile, ConfigError> {
        for inner in ["robots", "sites"] {
            std::fs::create_dir_all(folder.join(inner)).unwrap();
        }
        std::fs::write(folder.join("robots/robot.toml"), robot).unwrap();
        RobotFile::load(&folder.join("robots/robot.toml"))
    }

    #[test]
    fn a_robot_file_reads_anchors_and_currents_from_the_files_that_it_names() {
        let folder = tempfile::tempdir().unwrap();
        load(folder.path(), ROBOT).unwrap_err();
        std::fs::write(folder.path().join("sites/pond.toml"), calibration("4e-4")).unwrap();
        std::fs::write(folder.path().join("robots/winch.toml"), TABLE).unwrap();
        let file = load(folder.path(), ROBOT).unwrap();
        let robot = file.robot().unwrap();
        assert_eq!(robot.anchors()[2].y, 8.0);
        assert_eq!(robot.anchor_covariance_m2(1).unwrap()[(2, 2)], 4e-4);
        assert_eq!(robot.current().current_a(40.0, 0.5), Ok(3.0));
        assert_eq!(robot.current().resistance_ohm(), 2.0);
        assert_eq!(file.calibration.as_ref().unwrap().worst(), (1, 'x', 0.02));
        // A run folder holds copies of both next to the robot file.
        let run = tempfile::tempdir().unwrap();
        let named = file.named_files(&folder.path().join("robots"));
        assert_eq!(named.len(), 2);
        for original in named {
            std::fs::copy(&original, run.path().join(original.file_name().unwrap())).unwrap();
        }
        std::fs::write(run.path().join("robot.toml"), ROBOT).unwrap();
        assert_eq!(RobotFile::load(&run.path().join("robot.toml")).unwrap().robot().unwrap(), robot);
    }

    #[test]
    fn the_pulleys_of_a_calibration_are_those_of_the_robot() {
        let folder = tempfile::tempdir().unwrap();
        load(folder.path(), ROBOT).unwrap_err();
        std::fs::write(folder.path().join("robots/winch.toml"), TABLE).unwrap();
        let write = |more: &str| {
            let text = calibration("4e-4").replace("[measurements]", &format!("{more}\n[measurements]"));
            std::fs::write(folder.path().join("sites/pond.toml"), text).unwrap();
        };
        let stating = |more: &str| ROBOT.replace("[motor]", &format!("{more}\n[motor]"));
        let swivel = "pulley = \"swivel\"\npulley_radius_m = [0.025, 0.025, 0.025]";
        write(swivel);
        let file = load(folder.path(), ROBOT).unwrap();
        assert_eq!(file.robot().unwrap().anchors().radii_m(), [0.025; 3]);
        assert!(load(folder.path(), &stating(swivel)).is_ok());
        let wrong = load(folder.path(), &stating(&swivel.replace("0.025", "0.04"))).unwrap_err();
        assert!(
            matches!(&wrong, ConfigError::Text { key: Some(key), .. } if key == "robot.pulley_radius_m"),
            "{wrong:?}"
        );
        // The calibration that contradicts the robot file, with both radii.
        let date = &file.calibration.as_ref().unwrap().date;
        let named = [date.as_str(), "0.04,", "0.0250"];
        assert!(named.iter().all(|part| wrong.to_string().contains(part)), "{wrong}");
        write("pulley = \"eye\"");
        let wrong = load(folder.path(), &stating(swivel)).unwrap_err();
        assert_eq!(wrong.key(), Some("robot.pulley_radius_m"), "{wrong:?}");
        assert!(!load(folder.path(), ROBOT).unwrap().robot().unwrap().anchors().have_pulleys());
        // A calibration that states nothing, such as an older one, leaves the robot file as it is.
        write("");
        assert_eq!(load(folder.path(), &stating(swivel)).unwrap().robot().unwrap().anchors().radii_m(), [0.025; 3]);
    }

    #[test]
    fn a_calibration_with_the_robots_encoders_corrects_their_counts_once() {
        let with = |more: &str| {
            let text = calibration("1e-4").replace("[measurements]", &format!("{more}\n[measurements]"));
            toml::from_str::<CalibrationFile>(&text).unwrap()
        };
        let own = with("scale = 1.01\nscale_std = 0.001\ncounts_per_m = [10000.0, -10000.0, 5000.0]");
        // The measured lengths were 1 % too long, so a true metre has 1 % more counts.
        let counts = own.encoders(&[10000.0, -10000.0, 5000.0]).unwrap().unwrap();
        assert!(counts.iter().zip([10100.0, -10100.0, 5050.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{counts:?}");
        // The result does not depend on the counts in the system file.
        assert_eq!(own.encoders(&counts).unwrap().unwrap(), counts);
        for other in [&[10000.0, 10000.0, 5000.0][..], &[10000.0, -10000.0], &[20000.0, -20000.0, 10000.0]] {
            let sentence = own.encoders(other).unwrap_err().to_string();
            assert!(["`motor_io.counts_per_m`", &own.date].iter().all(|part| sentence.contains(part)), "{sentence}");
            assert!(sentence.contains(&format!("{other:?}")) && sentence.contains("10100.0"), "{sentence}");
        }
        // A calibration with a tape does not correct the encoders.
        assert_eq!(with("scale = 1.01\nscale_std = 0.001").encoders(&[1.0]), Ok(None));
        assert_eq!(with("").scale, 1.0);
    }

    #[test]
    fn each_cable_may_have_a_scale_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        load(folder.path(), ROBOT).unwrap_err();
        std::fs::write(folder.path().join("robots/winch.toml"), TABLE).unwrap();
        let with = |more: &str| {
            let text = calibration("1e-4").replace("[measurements]", &format!("{more}\n[measurements]"));
            std::fs::write(folder.path().join("sites/pond.toml"), text).unwrap();
            load(folder.path(), ROBOT).map(|file| file.calibration.unwrap())
        };
        let counts = "counts_per_m = [10000.0, -10000.0, 5000.0]";
        let checked = with(&format!("{counts}\ncable_scale = [1.001, 0.998, 1.0]")).unwrap();
        let found = checked.encoders(&[10000.0, -10000.0, 5000.0]).unwrap().unwrap();
        assert!(found.iter().zip([10010.0, -9980.0, 5000.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        // The check with the tape comes first, and the joint method finds what is left of all of them.
        let both = with(&format!("scale = 1.01\n{counts}\ncable_scale = [1.001, 0.998, 1.0]")).unwrap();
        let found = both.true_counts_per_m().unwrap();
        assert!(found.iter().zip([10110.1, -10079.8, 5050.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        for (scales, says) in [("[1.0, 1.0]", "3 cables"), ("[1.0, 1.2, 1.0]", "1.2"), ("[1.0, nan, 1.0]", "NaN")] {
            let sentence = with(&format!("{counts}\ncable_scale = {scales}")).unwrap_err().to_string();
            assert!(sentence.contains("cable_scale") && sentence.contains(says), "{sentence}");
        }
        let sentence = with("cable_scale = [1.001, 0.998, 1.0]").unwrap_err().to_string();
        assert!(["`cable_scale`", "`counts_per_m`"].iter().all(|key| sentence.contains(key)), "{sentence}");
    }

    #[test]
    fn files_that_do_not_match_are_rejected_with_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let sites = folder.path().join("sites/pond.toml");
        std::fs::create_dir_all(sites.parent().unwrap()).unwrap();
        let anchors = "anchors_m = [[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [4.0, 8.0, 3.0]]\n";
        let line = "calibration = \"../sites/pond.toml\"\n";
        std::fs::create_dir_all(folder.path().join("robots")).unwrap();
        let unreadable = file::ReadError::Missing.to_string();
        for (robot, site, table, file, says) in [
            (
                ROBOT.replace(line, &format!("{line}{anchors}")),
                calibration("1e-4"),
                TABLE,
                "robot.toml",
                &["anchors_m", "calibration"][..],
            ),
            (ROBOT.replace(line, ""), calibration("1e-4"), TABLE, "robot.toml", &["anchors_m", "calibration"]),
            (ROBOT.replace("pond", "lake"), calibration("1e-4"), TABLE, "lake.toml", &[&unreadable]),
            (ROBOT.into(), calibration("-1e-4"), TABLE, "robot.toml", &["covariance_m2"]),
            (ROBOT.into(), calibration("nan"), TABLE, "robot.toml", &["covariance_m2"]),
            (
                ROBOT.replace("\"winch.toml\"", "[\"winch.toml\"]"),
                calibration("1e-4"),
                TABLE,
                "robot.toml",
                &["motor.table", "3 cables"],
            ),
            (
                ROBOT.replace("\"winch.toml\"", "[\"winch.toml\", \"winch.toml\"]"),
                calibration("1e-4"),
                TABLE,
                "robot.toml",
                &["motor.table", "3 cables"],
            ),
            (ROBOT.into(), "method = \"survey\"\n".into(), TABLE, "pond.toml", &["date"]),
            (ROBOT.into(), calibration("1e-4"), "speeds_m_s = [0.0]\n", "winch.toml", &["tensions_n"]),
            (
                ROBOT.into(),
                calibration("1e-4"),
                &TABLE.replace("[-0.5, 0.5]", "[0.5, -0.5]"),
                "winch.toml",
                &["speeds_m_s"],
            ),
        ] {
            std::fs::write(&sites, site).unwrap();
            std::fs::write(folder.path().join("robots/winch.toml"), table).unwrap();
            let error = load(folder.path(), &robot).unwrap_err();
            let sentence = error.to_string();
            assert_eq!(error.path().file_name(), Some(file.as_ref()), "{sentence}");
            assert!(says.iter().all(|word| sentence.contains(word)) && !sentence.contains('\n'), "{sentence}");
        }
    }
}
