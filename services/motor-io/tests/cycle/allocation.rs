//! The core allocates nothing after its construction, in any cycle.

use crate::counting;
use crate::rig;

use counting::allocations;
use messages::{MotorAuthority, MotorInput, Request};
use motor_io::Core;

#[test]
fn a_cycle_allocates_nothing() {
    // A flight with requests, a refusal, a lost unit and a fault, recorded.
    let mut rig = rig::Rig::following([0.1, -0.1, 0.05]);
    let mut inputs: Vec<MotorInput> = Vec::new();
    let run = Request::Run { mission: "a mission".to_owned(), hash: [1; 32], continues: false };
    let requests = [
        Request::Speed { rate: 0.5 },
        Request::Jog { cable: 1, distance_m: 0.3 },
        Request::ZeroAt { position_m: [0.5, 0.3, 0.4] },
        Request::Reset,
        run,
    ];
    for cycle in 0..400_u32 {
        if cycle % 40 == 0 {
            rig.inbox.request(1, &requests[(cycle / 40) as usize % requests.len()].body());
        }
        rig.unit[1] = if cycle == 200 { MotorInput::UNIT_RESYNC } else { MotorInput::UNIT_OK };
        rig.tension_n[0] = if cycle > 300 { 0.0 } else { 10.0 };
        inputs.push(rig.step().input);
    }
    assert_eq!(rig.mode(), MotorAuthority::MODE_FAULTED);
    let mut core: Core = rig.core.clone();
    let count = allocations(|| {
        for input in &inputs {
            let sent = core.decide(input);
            let seen = core.observe(input);
            std::hint::black_box((sent, seen, core.answers().len()));
        }
    });
    assert_eq!(count, 0);
}
