//! A signal wakes a waiter, also if it arrived before the wait. The only test of its program, because a signal reaches
//! every chassis of a process.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use runtime::{Chassis, CommonArgs};

#[test]
fn a_signal_before_the_wait_wakes_it() {
    let domain = bus::Domain::for_test();
    let args = CommonArgs { domain: Some(domain.name().to_owned()), ..Default::default() };
    let mut chassis = Chassis::start("test", &args).unwrap();
    let mut waiter = chassis.waiter(&["motor/state"]).unwrap();
    chassis.ready().unwrap();
    assert!(!chassis.wait(&mut waiter, Some(0)).unwrap().woken());
    assert!(chassis.running());
    signal_hook::low_level::raise(signal_hook::consts::SIGTERM).unwrap();
    assert!(!chassis.running());
    // Without a deadline, only the signal can end the wait.
    assert!(waiter.wait_until(None).unwrap().descriptor(0));
}
