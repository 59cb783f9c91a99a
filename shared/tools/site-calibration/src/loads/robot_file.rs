//! The robot file with what the measurements determine: comments and order of the file stay.

use cable_robot::{Robot, STANDARD_GRAVITY};
use calibration::{Found, Loads};
use toml_edit::{Array, DocumentMut, Item, Table, Value};

/// Returns the text of the robot file with the determined values and their deviations; None if nothing is determined.
///
/// # Errors
/// One clause: the text cannot be changed.
pub fn renewed(text: &str, robot: &Robot, found: &Loads) -> Result<Option<String>, String> {
    let mut document: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| error.to_string())?;
    let mut set = |section: &str, key: &str, value: Value| -> Result<(), String> {
        let table = document.entry(section).or_insert_with(|| Item::Table(Table::new()));
        let table = table.as_table_like_mut().ok_or_else(|| format!("{section} is not a section"))?;
        match table.get_mut(key).and_then(Item::as_value_mut) {
            // The comment beside it stays.
            Some(old) => {
                let decor = old.decor().clone();
                *old = value;
                *old.decor_mut() = decor;
            }
            None => drop(table.insert(key, Item::Value(value))),
        }
        Ok(())
    };
    if let Found::Determined { value, std } = found.stiffness_n {
        set("lines", "stiffness_n", rounded(value, 4).into())?;
        set("uncertainty", "stiffness", rounded(std / value, 2).into())?;
    }
    if let Found::Determined { value, .. } = found.routed_change_m {
        let routed = robot.routed_length_m().iter().map(|m| rounded((m + value).max(0.0), 4));
        set("lines", "routed_length_m", Value::Array(routed.collect::<Array>()))?;
    }
    if let Found::Determined { value, std } = found.node_weight_n {
        let buoyant = text
            .parse::<toml::Table>()
            .is_ok_and(|table| table.get("robot").and_then(|robot| robot.get("net_weight_n")).is_some());
        if buoyant {
            set("robot", "net_weight_n", rounded(value, 4).into())?;
        } else {
            set("robot", "node_mass_kg", rounded(value / STANDARD_GRAVITY, 4).into())?;
        }
        set("uncertainty", "node_weight", rounded(std / value, 2).into())?;
    }
    let text_now = document.to_string();
    Ok((text_now != text).then_some(text_now))
}

/// Rounds to significant digits, far below the deviation.
fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.places$e}", places = digits.saturating_sub(1)).parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::{RobotFile, toml_file};
    use std::path::Path;

    const LAB3: &str = include_str!("../../../../../configs/robots/lab3.toml");

    fn robot() -> Robot {
        toml_file::parse::<RobotFile>(LAB3, Path::new("lab3.toml")).unwrap().robot().unwrap()
    }

    fn loads(weight_n: f64) -> Loads {
        Loads {
            stiffness_n: Found::Determined { value: 6_543.21, std: 200.0 },
            routed_change_m: Found::Undetermined(String::new()),
            node_weight_n: Found::Determined { value: weight_n, std: 0.12 },
        }
    }

    #[test]
    fn only_the_determined_keys_change() {
        let text = renewed(LAB3, &robot(), &loads(12.0)).unwrap().unwrap();
        let file: RobotFile = toml_file::parse(&text, Path::new("lab3.toml")).unwrap();
        assert_eq!((file.lines.stiffness_n, file.uncertainty.stiffness), (Some(6543.0), 0.031));
        assert!((file.robot.node_mass_kg * STANDARD_GRAVITY - 12.0).abs() < 0.01);
        assert_eq!(file.uncertainty.node_weight, 0.01);
        // Every text line but these stays, with the comments in these lines.
        let (before, after): (Vec<&str>, Vec<&str>) = (LAB3.lines().collect(), text.lines().collect());
        let lost: Vec<&&str> = before.iter().filter(|line| !after.contains(line)).collect();
        assert_eq!(lost.len(), 2, "{lost:?}");
        assert_eq!(after.len(), before.len() + 2);
        assert!(text.contains("# EA, N; braided polyethylene") && text.contains("# node with its sensors, kg"));
        assert_eq!(renewed(&text, &robot(), &loads(12.0)).unwrap(), None);
    }

    #[test]
    fn a_weight_less_buoyancy_is_renewed_as_such() {
        let buoyant = LAB3.replace("# net_weight_n = 11.768", "net_weight_n = 5.0");
        let text = renewed(&buoyant, &robot(), &loads(5.25)).unwrap().unwrap();
        assert!(text.contains("net_weight_n = 5.25") && text.contains("node_mass_kg = 1.2 "), "{text}");
        let nothing = Found::Undetermined("too light".to_owned());
        let none = Loads { stiffness_n: nothing.clone(), routed_change_m: nothing.clone(), node_weight_n: nothing };
        assert_eq!(renewed(LAB3, &robot(), &none).unwrap(), None);
        let routed = Loads { routed_change_m: Found::Determined { value: -0.5, std: 0.1 }, ..none };
        let text = renewed(LAB3, &robot(), &routed).unwrap().unwrap();
        assert!(text.contains("routed_length_m = [5.5, 5.5, 5.5]   # cable from drum"), "{text}");
    }
}
