//! The operator's requests to the planner.

use std::path::Path;

use messages::{OperatorRequest, text_of};

use crate::inputs::Inputs;
use crate::mission::{Mission, PathShape};
use crate::planner::{Planner, Refusal};

/// Carries out one request: whether it is accepted ([`OperatorRequest::ACCEPTED`], [`OperatorRequest::REFUSED`],
/// [`OperatorRequest::BAD_INPUT`]), and the sentence that answers it. Reads the mission file.
///
/// `awaited`: whether somebody still waits for the answer. Planning takes its time, and nothing is to move for somebody who was told that
/// nobody answers.
pub fn answer(
    planner: &mut Planner,
    request: &OperatorRequest,
    awaited: impl Fn() -> bool,
    missions: &Path,
    seen: &Inputs<'_>,
) -> (u8, String) {
    let bad = |sentence: String| (OperatorRequest::BAD_INPUT, sentence);
    let refused = |refusal: Refusal| {
        let verdict = if refusal.is_bad_input() { OperatorRequest::BAD_INPUT } else { OperatorRequest::REFUSED };
        (verdict, refusal.to_string())
    };
    let result = match request.verb {
        OperatorRequest::VERB_GOTO => {
            let [x, y, z, speed_m_s, path, mu_per_m, ..] = request.args;
            let shape = match path {
                0.0 => PathShape::Line,
                1.0 if mu_per_m.is_finite() => PathShape::Parabola,
                1.0 => return bad(format!("the sag is {mu_per_m}; give mu in 1/m, or 0 for what loses least")),
                2.0 => PathShape::Lateral,
                _ => {
                    return bad(format!("there is no path {path}; accepted: 0 (line), 1 (parabola) and 2 (lateral)"));
                }
            };
            planner.goto([x, y, z], speed_m_s, shape, mu_per_m, seen).map_err(refused)
        }
        OperatorRequest::VERB_RUN => Mission::read(&config::mission_file(&text_of(&request.text), missions))
            .map_err(|error| bad(error.to_string()))
            .and_then(|mission| {
                let goes_on = request.args[0] == OperatorRequest::RUN_CONTINUE;
                let result = if goes_on { planner.go_on(&mission, seen) } else { planner.run(&mission, seen) };
                result.map_err(refused)
            }),
        other => Err(bad(format!(
            "the planner has no request number {other}; accepted: {} (goto) and {} (run)",
            OperatorRequest::VERB_GOTO,
            OperatorRequest::VERB_RUN
        ))),
    };
    match result {
        Ok(_) if !awaited() => (OperatorRequest::REFUSED, planner.take_back()),
        Ok(sentence) => (OperatorRequest::ACCEPTED, sentence),
        Err(refusal) => refusal,
    }
}
