//! A test process for the bus, which tests also kill: `peer DOMAIN PROCESS publish|answer|silent|own`.
//!
//! `publish` sends `motor/state` every millisecond, with ascending `counts`; `answer` answers requests; `silent`
//! receives them and never answers; `own` owns the domain and never sweeps it. Prints `ready` on standard output, then
//! runs until it is killed.

use bus::clock::Pacer;
use bus::{Bus, BusError, Domain};
use messages::MotorState;

fn main() -> Result<(), BusError> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [domain, process, what] = arguments.as_slice() else {
        println!("usage: peer DOMAIN PROCESS publish|answer|silent|own");
        return Ok(());
    };
    let domain = Domain::parse(domain)?;
    let _claim = (what == "own").then(|| domain.claim()).transpose()?;
    let bus = Bus::join(&domain, process)?;
    if what == "publish" { publish(&bus) } else { serve(&bus, what == "answer") }
}

fn publish(bus: &Bus) -> Result<(), BusError> {
    let mut states = bus.publisher::<MotorState>("motor/state")?;
    let mut sample = MotorState::default();
    let mut pacer = Pacer::new(1_000_000);
    println!("ready");
    loop {
        pacer.next();
        sample.counts = [sample.counts[0] + 1; 8];
        states.send(&mut sample)?;
    }
}

fn serve(bus: &Bus, answer: bool) -> Result<(), BusError> {
    let mut server = bus.server(bus.process())?;
    let mut waiter = bus.waiter(&[server.event()])?;
    println!("ready");
    loop {
        waiter.wait_until(None)?;
        while let Some(call) = server.try_next()? {
            if answer {
                call.answer(&answer_of(messages::OperatorRequest::ACCEPTED, "done"))?;
            }
        }
    }
}

/// An answer without a reason of the catalogue.
fn answer_of(accepted: u8, text: &str) -> messages::RequestAnswer {
    let mut answer = messages::RequestAnswer { accepted, ..Default::default() };
    messages::put_text(&mut answer.text, text);
    answer
}
