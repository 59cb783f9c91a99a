//! A robot file with the anchors of a calibration.

use toml_edit::{DocumentMut, value};

/// Returns the text of a robot file that takes its anchors from a calibration with this name beside it. Comments and
/// every other key stay as they are.
///
/// # Errors
/// One clause: the text is no robot file.
pub fn with_calibration(robot_file: &str, name: &str) -> Result<String, String> {
    let mut document: DocumentMut = robot_file.parse().map_err(|error| format!("it is not TOML: {error}"))?;
    let robot = document
        .get_mut("robot")
        .and_then(|section| section.as_table_like_mut())
        .ok_or_else(|| "it has no [robot]; give a robot file".to_owned())?;
    robot.remove("anchors_m");
    // A calibration states the deviations of its anchors and its own wheels.
    robot.remove("pulley_radius_m");
    robot.insert("calibration", value(name));
    Ok(document.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_anchors_become_a_calibration_and_nothing_else_changes() {
        let text = "# mine\nname = \"lab\"\n[robot]\nnode_mass_kg = 1.2 # weighed\nanchors_m = [\n  [0, 0, 3],\n]\n[motor]\nr = 1\n";
        let with = with_calibration(text, "pond-calibration.toml").unwrap();
        assert!(with.contains("calibration = \"pond-calibration.toml\"") && !with.contains("anchors_m"), "{with}");
        assert!(with.contains("# mine") && with.contains("1.2 # weighed") && with.contains("[motor]\nr = 1"), "{with}");
        assert_eq!(with_calibration(&with, "pond-calibration.toml").unwrap(), with);
        assert!(with_calibration("x = 1", "y").unwrap_err().contains("[robot]"));
        assert!(with_calibration("x = [", "y").unwrap_err().contains("TOML"));
    }
}
