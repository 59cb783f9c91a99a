//! `nims solve`: all formulas for programs in any language. Reads one JSON object per line and answers each with one
//! per line, in order, until the end of the input.
//!
//! A request is `{"id": any, "op": "...", ...}`, an answer `{"id": same, "result": {..}}` or
//! `{"id": same, "error": {"kind": "...", "message": "..."}}`. An invalid request does not end the loop; unknown keys
//! are ignored. [`answer`] handles a single line.
#![forbid(unsafe_code)]

mod args;
mod calibration;
mod control;
mod energy;
mod error;
mod geometry;
mod statics;

pub use error::SolveError;

use args::Args;
use error::OperationResult;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};

/// Maximum length of a request, bytes; a longer line is answered by an error.
const LONGEST_LINE: usize = 16 << 20;

macro_rules! from_errors {
    ($($error:ty),+) => {
        $(impl From<$error> for SolveError {
            fn from(error: $error) -> Self {
                Self { kind: error.kind(), message: error.to_string() }
            }
        })+
    };
}

from_errors!(
    ::calibration::CalibrationError,
    cable_robot::energy::EnergyError,
    cable_robot::energy::TableError,
    cable_robot::KinematicsError,
    cable_control::law::LawError,
    cable_control::motor_model::FitError,
    cable_robot::tension::TensionError
);

type Operation = fn(&Args) -> OperationResult;

/// All operations by name.
const OPERATIONS: [(&str, Operation); 22] = [
    ("survey_anchors", calibration::survey_anchors),
    ("fourth_anchor", calibration::fourth_anchor),
    ("inverse_kinematics", geometry::inverse_kinematics),
    ("forward_kinematics", geometry::forward_kinematics),
    ("jacobian", geometry::jacobian),
    ("cable_velocity", geometry::cable_velocity),
    ("node_velocity", geometry::node_velocity),
    ("calibrate_heights", calibration::calibrate_heights),
    ("calibrate_joint", calibration::calibrate_joint),
    ("gps_anchor", calibration::gps_anchor),
    ("tensions", statics::tensions),
    ("distribute", statics::distribute),
    ("node_acceleration", statics::node_acceleration),
    ("fit_motor", control::fit_motor),
    ("lq_gain", control::lq_gain),
    ("motor_current", energy::motor_current),
    ("motor_efficiency", energy::motor_efficiency),
    ("parabola", energy::parabola),
    ("mu_limit", energy::mu_limit),
    ("move_energy", energy::move_energy),
    ("optimal_parabola", energy::optimal_parabola),
    ("operations", operations),
];

/// Returns the names of all operations.
fn operations(_: &Args) -> OperationResult {
    Ok(json!({ "operations": OPERATIONS.map(|(name, _)| name) }))
}

/// Answers one line.
#[must_use]
pub fn answer(line: &str) -> Value {
    let request = match parse(line) {
        Ok(Value::Object(request)) => request,
        Ok(_) => {
            return error_answer(
                Value::Null,
                &SolveError::invalid("the line is not a JSON object; send {\"id\": .., \"op\": \"..\", ..}"),
            );
        }
        Err(error) => return error_answer(Value::Null, &SolveError::invalid(format!("the line is not JSON: {error}"))),
    };
    let id = request.get("id").cloned().unwrap_or(Value::Null);
    match solve(&Args::new(&request)) {
        Ok(result) => json!({ "id": id, "result": result }),
        Err(error) => error_answer(id, &error),
    }
}

fn solve(args: &Args) -> OperationResult {
    let name = args.text("op")?;
    match OPERATIONS.iter().find(|(known, _)| *known == name) {
        Some((_, operation)) => operation(args),
        None => {
            let known: Vec<_> = OPERATIONS.iter().map(|(name, _)| *name).collect();
            Err(SolveError::invalid(format!("op is {name:?}; accepted: {}", known.join(", "))))
        }
    }
}

fn error_answer(id: Value, error: &SolveError) -> Value {
    let message: String = error.message.split_whitespace().collect::<Vec<_>>().join(" ");
    json!({ "id": id, "error": { "kind": error.kind, "message": message } })
}

/// Parses JSON; also accepts the words NaN, Infinity and -Infinity, which Python and others write, as strings. They are
/// then rejected with their key, or mean "no limit".
fn parse(line: &str) -> Result<Value, serde_json::Error> {
    serde_json::from_str(line).or_else(|error| {
        if line.contains("NaN") || line.contains("Infinity") {
            serde_json::from_str(&quote_words(line)).map_err(|_| error)
        } else {
            Err(error)
        }
    })
}

fn quote_words(line: &str) -> String {
    let mut result = String::with_capacity(line.len() + 16);
    let (mut rest, mut inside) = (line, false);
    while let Some(c) = rest.chars().next() {
        let word = ["NaN", "Infinity", "-Infinity"].into_iter().find(|w| !inside && rest.starts_with(w));
        let taken = match word {
            Some(word) => {
                result.push('"');
                result.push_str(word);
                result.push('"');
                word.len()
            }
            None => {
                let escaped = inside && c == '\\';
                inside ^= c == '"';
                let taken = if escaped { rest.chars().take(2).map(char::len_utf8).sum() } else { c.len_utf8() };
                result.push_str(&rest[..taken]);
                taken
            }
        };
        rest = &rest[taken..];
    }
    result
}

/// Answers every line of `input` on `output`. Ends with the input, or when the output is closed.
///
/// # Errors
/// The input cannot be read.
pub fn serve(input: impl Read, mut output: impl Write) -> std::io::Result<()> {
    let mut input = BufReader::new(input);
    let mut line = Vec::new();
    loop {
        line.clear();
        if input.read_until(b'\n', &mut line)? == 0 {
            return Ok(());
        }
        let value = if line.len() > LONGEST_LINE {
            error_answer(
                Value::Null,
                &SolveError::invalid(format!("the line is longer than {LONGEST_LINE} bytes; send shorter lines")),
            )
        } else {
            answer(String::from_utf8_lossy(&line).trim_end_matches(['\n', '\r']))
        };
        let mut text = value.to_string();
        text.push('\n');
        if output.write_all(text.as_bytes()).and_then(|()| output.flush()).is_err() {
            return Ok(());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(line: &str) -> (Value, String) {
        let value = answer(line);
        (value["id"].clone(), value["error"]["kind"].as_str().unwrap_or("none").to_owned())
    }

    #[test]
    fn invalid_requests_are_answered_and_the_loop_continues() {
        let text = "\n[1]\n{\"id\": 1}\n{\"id\": 2, \"op\": \"guess\"}\nnonsense\n\u{fffd}\n{\"id\": [3], \"op\": \"operations\"}\n";
        let mut output = Vec::new();
        serve(text.as_bytes(), &mut output).unwrap();
        let lines: Vec<Value> =
            String::from_utf8(output).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(lines.len(), 7);
        for line in &lines[..6] {
            assert_eq!(line["error"]["kind"], "invalid_argument", "{line}");
        }
        assert_eq!((&lines[2]["id"], &lines[3]["id"], &lines[6]["id"]), (&json!(1), &json!(2), &json!([3])));
        assert_eq!(lines[6]["result"]["operations"].as_array().unwrap().len(), OPERATIONS.len());
    }

    #[test]
    fn nan_and_infinity_words_are_rejected_with_their_key() {
        let line = r#"{"id": "NaN \" NaN", "op": "inverse_kinematics", "anchors_m": [[0,0,NaN],[1,0,0],[0,1,0]], "position_m": [0,0,-Infinity]}"#;
        assert_eq!(kind(line), (json!("NaN \" NaN"), "invalid_argument".to_owned()));
        assert_eq!(answer(line)["error"]["message"].as_str().map(|m| m.contains("anchors_m")), Some(true));
        let open = r#"{"op": "distribute", "structure_matrix": [[1, 1]], "wrench_n": [3], "limits_n": [1, Infinity]}"#;
        assert!((answer(open)["result"]["sum_n"].as_f64().unwrap() - 3.0).abs() < 1e-12);
    }

    #[test]
    fn pulleys_are_those_of_the_robot_model() {
        use cable_robot::{Anchors, Vector3, kinematics};
        let text = "[[0,0,3],[9,0,3.1],[4,8,2.9]]";
        let ask = |op: &str, rest: &str| {
            answer(&format!(r#"{{"op": "{op}", "anchors_m": {text}, "pulley_radius_m": [0.04, 0, 0.05], {rest}}}"#))
        };
        let anchors = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.1], [4.0, 8.0, 2.9]]).unwrap();
        let anchors = anchors.with_pulleys(&[0.04, 0.0, 0.05]).unwrap();
        let lengths = kinematics::inverse_kinematics(&anchors, &Vector3::new(4.0, 3.0, 1.0));
        let found = ask("inverse_kinematics", r#""position_m": [4, 3, 1]"#);
        assert_eq!(found["result"]["lengths_m"], json!(lengths.to_vec()));
        let back = ask("forward_kinematics", &format!(r#""lengths_m": {}"#, found["result"]["lengths_m"]));
        let position = back["result"]["position_m"].as_array().unwrap();
        for (k, expected) in [4.0, 3.0, 1.0].into_iter().enumerate() {
            assert!((position[k].as_f64().unwrap() - expected).abs() < 1e-9, "{back}");
        }
        let rows = ask("jacobian", r#""position_m": [4, 3, 1]"#);
        let row = kinematics::Jacobian::at(&anchors, &Vector3::new(4.0, 3.0, 1.0)).unwrap()[2];
        assert_eq!(rows["result"]["cable_jacobian"][2], json!([row.x, row.y, row.z]));
        for op in ["inverse_kinematics", "jacobian"] {
            assert_eq!(ask(op, r#""position_m": [0, 0, 1]"#)["error"]["kind"], "singular");
        }
        let bad = format!(
            r#"{{"op": "inverse_kinematics", "anchors_m": {text}, "pulley_radius_m": 40, "position_m": [4, 3, 1]}}"#
        );
        assert_eq!(kind(&bad).1, "invalid_argument");
    }

    #[test]
    fn a_closed_output_ends_the_loop_without_error() {
        struct Closed;
        impl Write for Closed {
            fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
                Err(std::io::ErrorKind::BrokenPipe.into())
            }
            fn flush(&mut self) -> std::io::Result<()> {
                Ok(())
            }
        }
        assert!(serve("{}\n{}\n".as_bytes(), Closed).is_ok());
    }
}
