//! A motion and a request to stop that arrive in any order.

use crate::rig::{self, Rig};
use messages::{MotorAuthority as A, Request};

/// Cycles from the first request to the last arrival.
const MOST: u64 = 6;

/// A robot that holds, with a controller that follows whatever motion is offered.
fn ready() -> Rig {
    let mut rig = Rig::default().ready();
    rig.controller = Some([0.05, -0.05, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.steps(5);
    rig
}

/// A motion that was asked for in cycle `asked` and arrives in cycle `offered`, and a request that was made in cycle
/// `made` and arrives in cycle `heard`, all counted from now. Returns whether a cable moved before the request, and
/// after it once the robot was at rest.
fn run(rig: &mut Rig, [asked, offered]: [u64; 2], [made, heard]: [u64; 2], request: &Request) -> [bool; 2] {
    let (begin_ns, period_ns) = (rig.now_ns, (rig.period_s * 1e9) as u64);
    // The motion is asked for a millisecond after the request where both are of one cycle.
    let at = |cycle: u64| begin_ns + cycle * period_ns;
    let (mut moved, mut rested) = ([false; 2], false);
    for cycle in 0..=MOST + 150 {
        if cycle == offered {
            rig.offer(1000.0);
            rig.motion.asked_ns = at(asked) + 1_000_000;
        }
        if cycle == heard {
            assert!(rig.inbox.request_made(9, &request.body(), at(made)));
        }
        rig.step();
        let moves = rig::speed(rig) > 0.0;
        if cycle < heard {
            moved[0] |= moves;
        } else {
            rested |= !moves;
            moved[1] |= rested && moves;
        }
    }
    moved
}

/// Every order of the four instants in which none arrives before it was sent.
fn orders() -> impl Iterator<Item = ([u64; 2], [u64; 2])> {
    let pairs = || (0..MOST).flat_map(|from| (from..MOST).map(move |to| [from, to]));
    pairs().flat_map(move |motion| pairs().map(move |stop| (motion, stop)))
}

#[test]
fn a_motion_that_was_asked_for_before_a_hold_is_paused_by_it_in_whichever_order_they_arrive() {
    let mut paused = 0;
    for request in [Request::Hold, Request::Pause] {
        for (motion, stop) in orders() {
            let case = format!("{request:?}: motion {motion:?}, stop {stop:?}");
            let mut rig = ready();
            let [before, after] = run(&mut rig, motion, stop, &request);
            assert!(!before || motion[1] < stop[1], "{case}: it moved without a motion");
            let authority = rig.seen().authority;
            // What arrived before the hold is paused by it in any case.
            if motion[0] < stop[0] || motion[1] <= stop[1] {
                assert!(!after, "{case}: it moved after the hold");
                assert_eq!((authority.mode, authority.motion), (A::MODE_HOLDING, rig.motion.motion), "{case}");
                rig.demand(Request::Resume);
                rig.steps(60);
                paused += 1;
            }
            assert_eq!((rig.mode(), rig.seen().authority.motion), (A::MODE_FOLLOWING, rig.motion.motion), "{case}");
        }
    }
    assert!(paused > 500, "{paused}");
}

#[test]
fn a_motion_that_was_asked_for_before_a_stop_never_begins_after_it() {
    for (motion, stop) in orders() {
        let case = format!("motion {motion:?}, stop {stop:?}");
        let mut rig = ready();
        let [_, after] = run(&mut rig, motion, stop, &Request::Stop);
        if motion[0] < stop[0] || motion[1] <= stop[1] {
            assert!(!after, "{case}: it moved after the stop");
            // The planner is told by the epoch, and what is asked for now begins.
            let authority = rig.seen().authority;
            assert_eq!((authority.mode, authority.motion), (A::MODE_HOLDING, 0), "{case}");
            assert!(authority.epoch > rig.motion.epoch, "{case}");
            rig.offer(1000.0);
            rig.motion.asked_ns = rig.now_ns + 1;
            rig.steps(60);
        }
        assert_eq!((rig.mode(), rig.seen().authority.motion), (A::MODE_FOLLOWING, rig.motion.motion), "{case}");
    }
}

/// A mission that waits for its map, or for its plan, goes on by itself if the hold was taken back meanwhile.
#[test]
fn a_resume_before_the_motion_arrives_takes_the_hold_back() {
    for resumed in [false, true] {
        let mut rig = ready();
        let asked_ns = rig.now_ns;
        rig.steps(5);
        rig.demand(Request::Hold);
        rig.steps(5);
        if resumed {
            // Its answer is that nothing is paused.
            assert!(rig.inbox.request_made(9, &Request::Resume.body(), rig.now_ns));
        }
        rig.steps(5);
        rig.offer(1000.0);
        rig.motion.asked_ns = asked_ns;
        rig.steps(60);
        assert_eq!(rig.mode() == A::MODE_FOLLOWING, resumed);
    }
}

/// A planner that was slow has its request from before, and the epoch of now.
#[test]
fn a_motion_that_was_asked_for_before_an_emergency_stop_or_a_new_position_never_begins() {
    let zero = rig::lengths([5.0; 3]);
    for requests in [vec![Request::Estop, Request::Reset], vec![Request::Disarm, Request::Arm], vec![zero]] {
        let mut rig = ready();
        let asked_ns = rig.now_ns;
        rig.steps(5);
        requests.iter().for_each(|request| rig.demand(request.clone()));
        rig.steps(5);
        rig.offer(1000.0);
        rig.motion.asked_ns = asked_ns;
        for _ in 0..200 {
            assert!(rig.step().sent.is_hold(), "{requests:?}");
        }
        assert_eq!((rig.mode(), rig.seen().authority.motion), (A::MODE_HOLDING, 0), "{requests:?}");
    }
}

/// One that has waited at rest, as for a map between two legs, begins paused after a hold and goes on after a resume.
#[test]
fn the_next_motion_of_a_mission_that_was_held_meanwhile_begins_paused_once() {
    let mut rig = ready();
    let asked_ns = rig.now_ns;
    rig.demand(Request::Hold);
    rig.offer(0.5);
    rig.motion.asked_ns = asked_ns;
    for _ in 0..100 {
        assert!(rig.step().sent.is_hold());
    }
    rig.demand(Request::Resume);
    rig.until(300, |rig| rig.seen().authority.motion == 0);
    rig.until(50, |rig| rig.mode() == A::MODE_HOLDING);
    rig.offer(0.5);
    rig.motion.asked_ns = asked_ns;
    rig.until(10, |rig| rig.mode() == A::MODE_FOLLOWING);
}
