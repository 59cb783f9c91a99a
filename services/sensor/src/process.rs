//! The process: a serial port that reopens itself, the sensor, and its channel.

use std::path::Path;

use messages::Reading;
use runtime::{BadInput, Chassis, now_ns};
use serial::{ReopeningPort, Transport};
use tracing::{info, warn};

use crate::{Sensor, SensorFile};

/// Longest wait for bytes, ns: bounds the delay of the end of the process, of a request and of a stale reading.
const WAIT_NS: u64 = 20_000_000;
/// Time between two attempts to open the port, ns.
const PAUSE_NS: u64 = 50_000_000;
/// Longest time to write a request, ns.
const WRITE_NS: u64 = 100_000_000;
/// Time between two warnings about bad frames, ns.
const WARN_NS: u64 = 10_000_000_000;

/// Publishes readings on `sensor/NAME` until the end of the process is requested, with or without the device.
///
/// # Errors
/// The file is not accepted, or the channel has a publisher.
pub fn serve(path: &Path, chassis: &mut Chassis) -> anyhow::Result<()> {
    let file = SensorFile::load(path)?;
    chassis.reads(path);
    let port = file.port.replace("{domain}", &chassis.bus().domain().root().to_string_lossy());
    let mut sensor = Sensor::new(&file, now_ns()).map_err(BadInput)?;
    let mut line = ReopeningPort::new(&port, file.baud);
    let mut out = chassis.bus().publisher::<Reading>(&format!("sensor/{}", chassis.name()))?;
    let mut waiter = chassis.waiter(&[])?;
    chassis.ready()?;
    let (mut connection, mut missing) = (0, false);
    let (mut warned_ns, mut bad) = (now_ns(), 0);
    while chassis.running() {
        match line.connection() {
            Ok(number) => {
                if number != connection {
                    info!("reading {port}");
                    sensor.connected();
                }
                (connection, missing) = (number, false);
                for reading in exchange(&mut line, &mut sensor, chassis) {
                    out.send(&mut { reading })?;
                }
            }
            Err(error) => {
                if !std::mem::replace(&mut missing, true) {
                    warn!("{error}; retrying until it opens");
                }
                chassis.wait(&mut waiter, Some(now_ns() + PAUSE_NS))?;
            }
        }
        let now = now_ns();
        if let Some(mut stale) = sensor.stale_reading(now) {
            out.send(&mut stale)?;
        }
        let bad_now = sensor.counts().1;
        if bad_now > bad && now >= warned_ns + WARN_NS {
            warn!("{} bad frames since the last warning: check baud rate, wiring and sensor file", bad_now - bad);
            (warned_ns, bad) = (now, bad_now);
        }
        chassis.idle()?;
    }
    Ok(())
}

/// Sends a request if one is due, and returns the received readings; the connection reports errors at its next check.
fn exchange(line: &mut ReopeningPort, sensor: &mut Sensor, chassis: &mut Chassis) -> Vec<Reading> {
    let now = now_ns();
    if let Some(request) = sensor.request(now) {
        let _ = line.write_all(request, now + WRITE_NS);
    }
    let mut buffer = [0; 256];
    let Ok(count) = line.read(&mut buffer, now + WAIT_NS) else { return Vec::new() };
    chassis.pass_begin();
    let now = now_ns();
    let readings = buffer[..count].iter().filter_map(|byte| sensor.push(*byte, now)).collect();
    chassis.pass_end();
    readings
}
