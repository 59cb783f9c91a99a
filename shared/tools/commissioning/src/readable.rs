//! The answers of `ik`, `fk`, `tension`, `plan` and `workspace` as text: the same values as in their JSON.

use serde_json::Value;

/// Largest number of heights that `workspace` lists.
const MOST_LEVELS: usize = 12;

/// Returns the lengths that `nims ik` found.
pub(crate) fn lengths(found: &Value) -> String {
    per_cable("length", "m", 4, &found["lengths_m"])
}

/// Returns the position that `nims fk` found.
pub(crate) fn position(found: &Value) -> String {
    let residual_mm = number(&found["residual_m"]) * 1000.0;
    format!("node at      {}\nresidual     {residual_mm:.2} mm RMS of the lengths", point(&found["position_m"], 4))
}

/// Returns the tensions that `nims tension` found, with the limits of the robot.
pub(crate) fn tensions(found: &Value, [low_n, high_n]: [f64; 2]) -> String {
    if let Some(why) = infeasible(found) {
        return why;
    }
    let rows = per_cable("tension", "N", 2, &found["tensions_n"]);
    format!("{rows}\nsum          {:.2} N; limits {low_n} to {high_n} N", number(&found["sum_n"]))
}

/// Returns the cost of a move that `nims plan` found.
pub(crate) fn plan(found: &Value) -> String {
    if let Some(why) = infeasible(found) {
        return why;
    }
    let value = |key: &str| number(&found[key]);
    let path = match (found["mu_per_m"].as_f64(), found["down_m"].as_f64()) {
        (Some(0.0), _) => "a line".to_owned(),
        (Some(mu), _) => format!("a parabola with a sag of {mu:.4} per m"),
        (None, down) => {
            format!("a curve, {:.3} m down and {:.3} m sideways", down.unwrap_or_default(), value("side_m"))
        }
    };
    let mut lines = vec![
        format!("path         {path}, {:.2} m", value("length_m")),
        format!("duration     {:.2} s", value("duration_s")),
        format!("energy       {:.2} J, mean {:.2} W", value("energy_j"), value("mean_power_w")),
        format!("tension      at most {:.1} N, {:.1} N from a limit", value("peak_tension_n"), value("margin_n")),
        format!("current      at most {:.2} A", value("peak_current_a")),
    ];
    if let Some(line_j) = found["line_energy_j"].as_f64().filter(|_| found["mu_per_m"].as_f64() != Some(0.0)) {
        lines.push(format!("as a line    {line_j:.2} J in {:.2} s", value("line_duration_s")));
    }
    lines.join("\n")
}

/// Returns the region that `nims workspace` found.
pub(crate) fn workspace(found: &Value) -> String {
    let share = number(&found["feasible_share"]) * 100.0;
    let size = match found["feasible_volume_m3"].as_f64() {
        Some(volume) => format!("volume       {volume:.1} m³"),
        None => format!("area         {:.1} m²", number(&found["feasible_area_m2"])),
    };
    let [low, high] = [0, 1].map(|corner| point(&found["box_m"][corner], 2));
    let mut lines = vec![format!("{size}, {share:.0} % of the box {low} to {high}")];
    if found["safest_position_m"].is_array() {
        lines.push(format!(
            "safest       {}, {:.1} N from a tension limit; median {:.1} N",
            point(&found["safest_position_m"], 2),
            number(&found["best_margin_n"]),
            number(&found["median_margin_n"])
        ));
    }
    let levels = found["levels"].as_array().map(Vec::as_slice).unwrap_or_default();
    let (key, head) = if levels.iter().any(|level| level["width_m"].is_number()) {
        ("width_m", "width m")
    } else {
        ("area_m2", "area m²")
    };
    lines.push(format!("\nheight m  {head:>8}  best margin N"));
    // From above, as the robot is seen.
    for level in levels.iter().step_by(levels.len().div_ceil(MOST_LEVELS).max(1)).rev() {
        let margin = level["best_margin_n"].as_f64().map_or("-".to_owned(), |margin| format!("{margin:.1}"));
        lines.push(format!("{:>8.2}  {:>8.1}  {margin:>13}", number(&level["z_m"]), number(&level[key])));
    }
    lines.join("\n")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

fn numbers(value: &Value) -> impl Iterator<Item = f64> {
    value.as_array().into_iter().flatten().map(number)
}

fn point(value: &Value, digits: usize) -> String {
    let coordinates: Vec<String> = numbers(value).map(|coordinate| format!("{coordinate:.digits$}")).collect();
    format!("[{}] m", coordinates.join(", "))
}

fn per_cable(what: &str, unit: &str, digits: usize, values: &Value) -> String {
    let rows: Vec<String> = numbers(values)
        .enumerate()
        .map(|(cable, value)| format!("cable {}      {what} {value:.digits$} {unit}", cable + 1))
        .collect();
    rows.join("\n")
}

fn infeasible(found: &Value) -> Option<String> {
    let why = found["why"].as_str().unwrap_or_default();
    (found["feasible"] == false).then(|| format!("not feasible: {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_workspace_without_a_place_to_hang_has_no_safest_point() {
        let empty = json!({
            "feasible_volume_m3": 0.0, "feasible_share": 0.0, "box_m": [[0, 0, 0], [1, 1, 1]], "median_margin_n": null,
            "best_margin_n": null, "safest_position_m": null,
            "levels": [{ "z_m": 0.5, "area_m2": 0.0, "best_margin_n": null }],
        });
        let text = workspace(&empty);
        assert!(!text.contains("safest") && !text.contains("NaN") && text.ends_with('-'), "{text}");
    }

    #[test]
    fn many_heights_are_thinned() {
        let levels: Vec<Value> = (0..40).map(|z| json!({ "z_m": z, "width_m": 1.0, "best_margin_n": 2.0 })).collect();
        let found =
            json!({ "feasible_area_m2": 1.0, "feasible_share": 1.0, "box_m": [[0, 0], [1, 1]], "levels": levels });
        let rows = workspace(&found).lines().skip(3).count();
        assert!(rows > MOST_LEVELS / 2 && rows <= MOST_LEVELS, "{rows}");
    }

    #[test]
    fn what_is_not_feasible_states_why() {
        let refused = json!({ "feasible": false, "why": "cable 2 would be slack" });
        for text in [plan(&refused), tensions(&refused, [2.0, 60.0])] {
            assert!(text.ends_with(refused["why"].as_str().unwrap()) && text.lines().count() == 1, "{text}");
        }
    }
}
