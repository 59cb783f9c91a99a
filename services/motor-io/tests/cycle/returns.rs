//! What drives are sent when a unit that did not answer answers again: no motion before an operator asks for one.

use crate::rig::{self, Rig};
use messages::{MotorAuthority as A, MotorInput, Request};

/// Cycles until a unit that never answers is lost, and until the fastest cable has braked after that.
const LOST: u32 = 45;
const BRAKED: u32 = 60;

/// Robots in every mode in which a unit can get lost, with a controller that commands motion all the time.
fn robots() -> Vec<(&'static str, Rig)> {
    let moving = || Rig::following([0.1, -0.1, 0.05]);
    let (mut stopping, mut pausing, mut emergency) = (moving(), moving(), moving());
    stopping.demand(Request::Stop);
    pausing.demand(Request::Pause);
    emergency.demand(Request::Estop);
    let mut jogging = Rig::default().ready();
    jogging.demand(Request::Jog { cable: 1, distance_m: 0.5 });
    jogging.steps(20);
    let mut disarmed = Rig::default();
    disarmed.steps(5);
    let (holding, following) = (Rig::default().ready(), moving());
    vec![
        ("following", following),
        ("stopping", stopping),
        ("pausing", pausing),
        ("jogging", jogging),
        ("holding", holding),
        ("disarmed", disarmed),
        ("emergency stop", emergency),
    ]
}

#[test]
fn a_unit_that_answers_again_is_sent_no_motion_before_an_operator_asks() {
    for silence in [MotorInput::UNIT_LOST, MotorInput::UNIT_SILENT, MotorInput::UNIT_RESYNC, MotorInput::UNIT_REBOOTED]
    {
        for unit in 0..2 {
            for more in [0, 1, 5, 40] {
                for (mode, mut rig) in robots() {
                    let case = format!("{mode}, outcome {silence} of unit {unit}, {more} cycles more");
                    answers_again(&mut rig, unit, silence, more, &case);
                }
            }
        }
    }
}

/// The unit does not answer until that is a fault and for some cycles more, and then answers again.
fn answers_again(rig: &mut Rig, unit: usize, silence: u8, more: u32, case: &str) {
    let disarmed = rig.mode() == A::MODE_DISARMED;
    rig.unit[unit] = silence;
    rig.until(LOST, |rig| rig.faults() != 0 || disarmed);
    rig.steps(more);
    rig.unit[unit] = MotorInput::UNIT_OK;
    let mut before_m_s = rig::speed(rig);
    for _ in 0..BRAKED {
        rig.step();
        let now_m_s = rig::speed(rig);
        assert!(now_m_s <= before_m_s, "{case}: from {before_m_s} to {now_m_s} m/s");
        before_m_s = now_m_s;
    }
    assert_eq!(before_m_s, 0.0, "{case}");
    let requests = [Request::Hold, Request::Resume, Request::Jog { cable: 1, distance_m: 0.1 }];
    for request in requests.into_iter().map(Some).chain([None]) {
        let _ = request.map(|request| rig.reason(request));
        for _ in 0..20 {
            assert!(rig.step().sent.is_hold(), "{case}");
        }
    }
    assert!(disarmed || matches!(rig.mode(), A::MODE_FAULTED | A::MODE_EMERGENCY_STOP), "{case}: mode {}", rig.mode());
    // The operator's reset moves nothing either, although the motion of before is still offered.
    if !disarmed {
        rig.demand(Request::Reset);
        for _ in 0..100 {
            assert!(rig.step().sent.is_hold(), "{case}: after the reset");
        }
        assert_eq!((rig.mode(), rig.seen().authority.motion), (A::MODE_HOLDING, 0), "{case}");
    }
}
