//! What was recorded of a flight, fed again to fresh deciding parts, gives the same bits and allocates nothing.
#![allow(clippy::unwrap_used, clippy::expect_used, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use controller::Law;
use messages::OperatorRequest;
use nims_tests::lockstep::{Chain, Cycle, Lockstep};
use nims_tests::scenarios::Case;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: hands every call to the system's allocator unchanged; the count is a plain thread-local number.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above, that is from the system's allocator.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A flight with all that happens in one: zeroing, arming, moving, a pause, going on, a stop.
fn flight(robot: &'static str, law: Option<Law>) -> (Chain, Vec<Cycle>) {
    let mut scenario = Case { robot, mission: "polyline", motor_s: [0.030, 0.040] }.scenario(true).unwrap();
    scenario.law = law.unwrap_or(scenario.law);
    let chain = Chain::new(&scenario).unwrap();
    let mission = scenario.mission.clone();
    let [x, y, z] = scenario.plant.start_m;
    let mut lockstep = Lockstep::new(scenario).unwrap();
    let mut cycles = Vec::new();
    for cycle in 1..=1200 {
        match cycle {
            10 => lockstep.request(OperatorRequest::VERB_ZERO_AT, [x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0]),
            20 => lockstep.request(OperatorRequest::VERB_ARM, [0.0; 8]),
            50 => drop(lockstep.run(&mission).unwrap()),
            500 => lockstep.request(OperatorRequest::VERB_PAUSE, [0.0; 8]),
            700 => lockstep.request(OperatorRequest::VERB_RESUME, [0.0; 8]),
            1000 => lockstep.request(OperatorRequest::VERB_STOP, [0.0; 8]),
            _ => {}
        }
        cycles.push(lockstep.cycle().unwrap());
    }
    (chain, cycles)
}

#[test]
fn recorded_samples_give_the_same_bits_and_allocate_nothing() {
    // The preview law identifies the drives on the way.
    let preview = nims_tests::laws::law(None, true).unwrap();
    for (robot, law) in [("lab3", None), ("lab4", None), ("lab3", Some(preview)), ("lab4", Some(preview))] {
        let (mut chain, cycles) = flight(robot, law);
        for cycle in &cycles {
            let before = COUNT.with(Cell::get);
            chain.core.decide(&cycle.input);
            let observed = chain.core.observe(&cycle.input);
            let estimate = chain.estimator.step(&cycle.state, Some(&cycle.authority));
            let (command, control) = chain.controller.step(&controller::Seen {
                estimates: [Some(&cycle.estimate), None],
                motion: Some(&cycle.motion),
                authority: Some(&cycle.authority),
                state: Some(&cycle.state),
            });
            assert_eq!(COUNT.with(Cell::get), before, "cycle {} allocates", cycle.input.header.cycle);
            assert_eq!(bytes(&observed.state), bytes(&cycle.state));
            assert_eq!(bytes(&observed.authority), bytes(&cycle.authority));
            assert_eq!(bytes(&estimate), bytes(&cycle.estimate));
            assert_eq!(bytes(&command), bytes(&cycle.command));
            assert_eq!(bytes(&control), bytes(&cycle.control));
        }
        assert!(cycles.iter().any(|cycle| cycle.control.error_norm_m > 0.0));
    }
}

fn bytes<T: bytemuck::Pod>(sample: &T) -> &[u8] {
    bytemuck::bytes_of(sample)
}
