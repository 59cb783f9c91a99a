//! Who removes what killed processes leave. In a program of its own: clean-ups of one process that run at the same time
//! hinder each other.
#![allow(clippy::unwrap_used)]

mod peer;

use std::time::{Duration, Instant};

use bus::{Bus, Domain};
use messages::MotorState;
use peer::Peer;

#[test]
fn joining_leaves_the_dead_to_a_living_owner_and_their_places_are_free_when_they_are_needed() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let owner = Peer::start(domain.name(), "nims", "own");
    Peer::start(domain.name(), "motor-io", "publish").kill();
    drop(Bus::join(&domain, "joining").unwrap());
    assert_eq!(domain.dead(), 1, "the owner removes it");
    drop(bus.publisher::<MotorState>("motor/state").unwrap());
    assert_eq!(domain.dead(), 0, "its place was needed");
    let silent = Peer::start(domain.name(), "planner", "silent");
    silent.kill();
    assert_eq!(domain.sweep().unwrap().removed, 1);

    // A killed owner owns nothing, also as long as its parent has not taken its exit status.
    Peer::start(domain.name(), "motor-io", "publish").kill();
    let Peer(child) = &owner;
    let pid = rustix::process::Pid::from_child(child);
    rustix::process::kill_process(pid, rustix::process::Signal::KILL).unwrap();
    let give_up = Instant::now() + Duration::from_secs(20);
    while domain.dead() > 0 {
        assert!(Instant::now() < give_up, "{} dead processes", domain.dead());
        drop(Bus::join(&domain, "joining").unwrap());
    }
    assert_eq!(domain.alive().len(), 1);
}
