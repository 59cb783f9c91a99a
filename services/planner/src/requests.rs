//! Requests to the planner.

use std::path::Path;

use messages::{GotoPath, OperatorRequest, Request};
use robot_state::Reason;
use robot_state::answers::detail;

use crate::inputs::Inputs;
use crate::planner::Planner;
use crate::refusal::{Refusal, reason_of_copy_error};
use mission::{Mission, PathShape};

/// Carries out one request and returns the answer. A mission is read from its copy in the folder `run`.
///
/// `awaited`: whether the requester still waits for the answer. Planning takes time, and a motion whose requester has
/// timed out is not started.
pub fn answer(
    planner: &mut Planner,
    request: &OperatorRequest,
    awaited: impl Fn() -> bool,
    run: &Path,
    seen: &Inputs<'_>,
) -> Reason {
    match carry_out(planner, request, run, seen) {
        Ok(_) if !awaited() => planner.take_back(),
        Ok(reason) => {
            planner.asked_at(request.header.stamp_ns);
            reason
        }
        Err(reason) => reason,
    }
}

#[allow(clippy::result_large_err)] // both are answers
fn carry_out(
    planner: &mut Planner,
    request: &OperatorRequest,
    run: &Path,
    seen: &Inputs<'_>,
) -> Result<Reason, Reason> {
    let refused = |refusal: Refusal| refusal.reason();
    match Request::decode(request).map_err(|error| Reason::Undecodable { why: detail(error) })? {
        Request::Goto { to_m, path, speed_m_s } => {
            let (shape, mu_per_m) = match path {
                GotoPath::Line => (PathShape::Line, None),
                GotoPath::Parabola { mu_per_m } => (PathShape::Parabola, mu_per_m),
                GotoPath::Lateral => (PathShape::Lateral, None),
            };
            planner.goto(to_m, speed_m_s, shape, mu_per_m, seen).map_err(refused)
        }
        Request::Run { hash, continues, .. } => {
            let text = config::read_mission(run, &hash);
            let text = text.map_err(|error| reason_of_copy_error(&error))?;
            let mission = Mission::parse(&text).map_err(|error| error.reason())?;
            let result = if continues { planner.go_on(&mission, seen) } else { planner.run(&mission, seen) };
            result.map_err(refused)
        }
        _ => Err(Reason::OtherProcess { takes: detail("goto and run") }),
    }
}
