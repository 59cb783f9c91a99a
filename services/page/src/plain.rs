//! The page without scripts: the state in words, and STOP. It works in every browser, and without the built page.

use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde_json::Value;
use std::fmt::Write;

/// Age from which the state is said to be old, s.
const OLD_S: f64 = 1.0;

/// The page, with the answer to a request.
pub(crate) fn page(state: &Value, is_built: bool, answer: Option<&str>) -> Response {
    let mut text = String::from(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>nims</title><h1>nims</h1>\
         <form method=\"post\" action=\"/plain/stop\"><button><h1>STOP</h1></button></form>\
         <form method=\"post\" action=\"/plain/estop\"><button><h2>EMERGENCY STOP</h2></button></form>",
    );
    if let Some(answer) = answer {
        let _ = write!(text, "<h2 id=\"answer\">{}</h2><p><a href=\"/plain\">show the state</a>", escaped(answer));
    } else {
        text.push_str("<meta http-equiv=\"refresh\" content=\"1\">");
    }
    for (name, words) in words(state) {
        let _ = write!(text, "<p>{name}: <b>{}</b>", escaped(&words));
    }
    text.push_str(if is_built {
        "<p><a href=\"/\">the whole page</a></html>"
    } else {
        "<p>This is the plain page; scripts/page builds the whole one.</html>"
    });
    ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], text).into_response()
}

fn words(state: &Value) -> Vec<(&'static str, String)> {
    let text = |key: &str| state[key].as_str().map(str::to_owned);
    let Some(mode) = text("mode") else { return vec![("mode", "unknown: nothing has come from the robot".to_owned())] };
    let mut rows = Vec::new();
    if let Some(age_s) = state["age_s"].as_f64().filter(|age_s| *age_s > OLD_S) {
        rows.push(("OLD", format!("what follows is {age_s:.0} s old")));
    }
    rows.push(("mode", format!("{mode}. {}", text("mode_sentence").unwrap_or_default())));
    let faults = state["faults"].as_array().into_iter().flatten();
    rows.extend(faults.filter_map(Value::as_str).map(|fault| ("fault", fault.to_owned())));
    if let Some(at) = state["position_m"].as_array() {
        let at: Vec<String> = at.iter().filter_map(Value::as_f64).map(|m| format!("{m:.3}")).collect();
        let within_mm = state["within_m"].as_f64().unwrap_or(f64::NAN) * 1e3;
        rows.push(("node", format!("at {} m within {within_mm:.0} mm", at.join(", "))));
    }
    rows.extend(text("position").map(|sentence| ("position", sentence)));
    if let Some(supply_v) = state["supply_v"].as_f64() {
        rows.push(("supply", format!("{supply_v:.1} V")));
    }
    let mission = &state["mission"];
    match mission["silent_s"].as_f64() {
        Some(silent_s) => rows.push(("mission", format!("nothing has come from the planner for {silent_s:.0} s"))),
        None => rows.extend(mission["state"].as_str().map(|state| ("mission", state.to_owned()))),
    }
    rows
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_state_is_in_words_and_nothing_becomes_markup() {
        let state = json!({ "mode": "holding", "age_s": 4.2, "faults": ["<b>"], "position_m": [1.0, 2.0, 3.0], "within_m": 0.012 });
        let rows: Vec<String> = words(&state).into_iter().map(|(name, words)| format!("{name} {words}")).collect();
        assert!(
            rows[0].contains("4 s old") && rows.iter().any(|row| row.contains("1.000, 2.000, 3.000 m within 12 mm"))
        );
        assert_eq!(escaped("<b>&\""), "&lt;b&gt;&amp;&quot;");
        assert_eq!(words(&json!({ "mode": null })).len(), 1);
    }
}
