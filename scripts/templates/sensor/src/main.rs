//! A sensor: its message, and the loop that reads the device and publishes. The device is in `driver.rs`.

mod driver;

use driver::Device;
use messages::Header;
use runtime::{Args, Chassis, now_ns};
use std::process::ExitCode;

/// Readings of the device per second.
const RATE_HZ: f64 = 10.0;

messages::message! {
    /// A reading of the device: your fields, with their units in their names.
    pub struct Example {
        header: Header,
        value_v: f64,
        samples: [f64; 4],
    }
}

fn main() -> ExitCode {
    runtime::main("example", run)
}

fn run(_: &Args, chassis: &mut Chassis) -> anyhow::Result<()> {
    let mut device = Device::open()?;
    let mut out = chassis.bus().publisher::<Example>(&format!("sensor/{}", chassis.name()))?;
    let mut schedule = chassis.loop_schedule(RATE_HZ)?;
    chassis.ready()?;
    while chassis.wait_for_turn(&mut schedule)? {
        let (value_v, samples) = device.read()?;
        out.send(&mut Example { header: Header::at(now_ns()), value_v, samples })?;
    }
    Ok(())
}
