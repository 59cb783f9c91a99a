//! A request to move and one to stop, in every order in which they are made and received: nothing that was asked for
//! before a stop begins after it.

use messages::{MotorAuthority as A, PlanStatus, Request};
use nims_tests::lockstep::{Cycle, Lockstep};
use nims_tests::scenarios::{Case, START_M};
use planner::mission::PathShape;

const CASE: Case = Case { robot: "lab3", mission: "polyline", motor_s: [0.03, 0.04] };
/// Where the robot is asked to go, m.
const GOAL_M: [f64; 3] = [START_M[0] + 0.3, START_M[1] + 0.2, START_M[2] + 0.2];
/// Longer than the planner offers a motion that nothing takes up, cycles.
const LONG: u64 = 700;
/// Time until a robot that is told to stop is at rest, cycles.
const BRAKING: u64 = 150;

/// Plans the move, as if the request had been made at this time, ns.
fn goto(flight: &mut Lockstep, asked_ns: u64) -> bool {
    let answer = flight.ask_planner(|planner, seen| {
        let reason = planner.goto(GOAL_M, Some(0.2), PathShape::Line, None, seen)?;
        planner.asked_at(asked_ns);
        Ok(reason)
    });
    answer.is_some_and(|answer| answer.is_ok())
}

fn moves(cycle: &Cycle) -> bool {
    cycle.sent_m_s.iter().any(|v| *v != 0.0)
}

/// Flies until the mission has ended; returns how.
fn end(flight: &mut Lockstep) -> u8 {
    (0..2000).map(|_| flight.cycle().unwrap().plan.state).find(|state| *state > PlanStatus::STATE_PAUSED).unwrap_or(0)
}

/// The move is asked for, planned, and the request made and received, in these cycles from now. Returns whether
/// anything moved before the request, and after the time for braking.
fn run(flight: &mut Lockstep, [asked, planned, stopped]: [u64; 3], request: &Request) -> [bool; 2] {
    let (mut asked_ns, mut moved) = (0, [false; 2]);
    for cycle in 0..stopped.max(planned) + LONG {
        if cycle == asked {
            asked_ns = flight.plant().time_ns();
        }
        if cycle == planned {
            assert!(goto(flight, asked_ns), "the move is refused");
        }
        if cycle == stopped {
            flight.request(request.clone());
        }
        let now = moves(&flight.cycle().unwrap());
        moved[0] |= now && cycle < stopped;
        moved[1] |= now && cycle > stopped + BRAKING;
    }
    moved
}

#[test]
fn no_move_that_was_asked_for_before_a_hold_or_a_stop_begins_after_it() {
    let mut flown = 0;
    for request in [Request::Hold, Request::Pause, Request::Stop] {
        for (first, second) in [(1, 1), (1, 8), (9, 1), (10, 23), (30, 40)] {
            // What is asked for, planned and stopped in each order.
            for order in [[first, first + second, 0], [0, first + second, first], [0, first, first + second]] {
                let case = format!("{request:?}, {order:?}");
                let mut flight = Lockstep::new(CASE.scenario(true).unwrap()).unwrap();
                flight.zero_and_arm().unwrap();
                let [before, after] = run(&mut flight, order, &request);
                let mode = flight.cycle().unwrap().authority.mode;
                let [asked, planned, stopped] = order;
                if asked > stopped {
                    assert!(after || flight.plan_status().state == PlanStatus::STATE_DONE, "{case}: it never began");
                    continue;
                }
                assert!(!after && (planned < stopped || !before), "{case}: it moved");
                assert_eq!(mode, A::MODE_HOLDING, "{case}");
                let state = flight.plan_status().state;
                if request == Request::Stop {
                    assert_eq!(state, PlanStatus::STATE_ABORTED, "{case}");
                    let now_ns = flight.plant().time_ns();
                    assert!(goto(&mut flight, now_ns), "{case}");
                } else {
                    assert_eq!(state, PlanStatus::STATE_PAUSED, "{case}");
                    flight.request(Request::Resume);
                }
                assert_eq!(end(&mut flight), PlanStatus::STATE_DONE, "{case}: it does not go on");
                flown += 1;
            }
        }
    }
    assert_eq!(flown, 30);
}
