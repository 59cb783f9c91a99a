//! Requests to the planner.

use std::path::Path;

use messages::{GotoPath, OperatorRequest, Request};

use crate::inputs::Inputs;
use crate::mission::{Mission, PathShape};
use crate::planner::{Planner, Refusal};

/// Carries out one request: whether it is accepted ([`OperatorRequest::ACCEPTED`], [`OperatorRequest::REFUSED`],
/// [`OperatorRequest::BAD_INPUT`]), and the sentence that answers it. A mission is read from its copy in the folder `run`.
///
/// `awaited`: whether the requester still waits for the answer. Planning takes time, and a motion whose requester has timed out is not
/// started.
pub fn answer(
    planner: &mut Planner,
    request: &OperatorRequest,
    awaited: impl Fn() -> bool,
    run: &Path,
    seen: &Inputs<'_>,
) -> (u8, String) {
    match carry_out(planner, request, run, seen) {
        Ok(_) if !awaited() => (OperatorRequest::REFUSED, planner.take_back()),
        Ok(sentence) => (OperatorRequest::ACCEPTED, sentence),
        Err(refusal) => refusal,
    }
}

fn carry_out(
    planner: &mut Planner,
    request: &OperatorRequest,
    run: &Path,
    seen: &Inputs<'_>,
) -> Result<String, (u8, String)> {
    let bad = |sentence: String| (OperatorRequest::BAD_INPUT, sentence);
    let refused = |refusal: Refusal| {
        let verdict = if refusal.is_bad_input() { OperatorRequest::BAD_INPUT } else { OperatorRequest::REFUSED };
        (verdict, refusal.to_string())
    };
    match Request::decode(request).map_err(|error| bad(error.to_string()))? {
        Request::Goto { to_m, path, speed_m_s } => {
            let (shape, mu_per_m) = match path {
                GotoPath::Line => (PathShape::Line, None),
                GotoPath::Parabola { mu_per_m } => (PathShape::Parabola, mu_per_m),
                GotoPath::Lateral => (PathShape::Lateral, None),
            };
            planner.goto(to_m, speed_m_s, shape, mu_per_m, seen).map_err(refused)
        }
        Request::Run { hash, continues, .. } => {
            let text = config::read_mission(run, &hash).map_err(|error| bad(error.to_string()))?;
            let mission = Mission::parse(&text).map_err(|error| bad(error.to_string()))?;
            let result = if continues { planner.go_on(&mission, seen) } else { planner.run(&mission, seen) };
            result.map_err(refused)
        }
        _ => Err(bad("the planner takes goto and run only; send this request to another process".to_owned())),
    }
}
