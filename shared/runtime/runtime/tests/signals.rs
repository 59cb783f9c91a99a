//! A signal wakes whoever waits, also one that came before the wait. Alone in its program: a signal reaches every chassis of a process.
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
    // without limit: only the signal can end this
    assert!(waiter.wait_until(None).unwrap().descriptor(0));
}
