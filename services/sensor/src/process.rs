//! The process: a line that heals itself, the sensor behind it, and its channel.

use std::path::Path;

use messages::Reading;
use runtime::{BadInput, Chassis, now_ns};
use serial::{ReopeningPort, Transport};
use tracing::{info, warn};

use crate::{Sensor, SensorFile};

/// Longest wait for bytes, ns: bounds how late the end of the process, a question or a stale mark can be.
const WAIT_NS: u64 = 20_000_000;
/// Pause while the device is not there, ns.
const PAUSE_NS: u64 = 50_000_000;
/// Time for a question to be taken, ns.
const WRITE_NS: u64 = 100_000_000;
/// Between two words about bad frames, ns.
const COMPLAIN_NS: u64 = 10_000_000_000;

/// Lives until it is asked to end: readings on `sensor/NAME`, whether the device is there or not.
///
/// # Errors
/// The file cannot be used, or the channel is taken.
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
    let (mut complained_ns, mut bad) = (now_ns(), 0);
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
                    warn!("{error}; looking for it again and again");
                }
                chassis.wait(&mut waiter, Some(now_ns() + PAUSE_NS))?;
            }
        }
        let now = now_ns();
        if let Some(mut stale) = sensor.look(now) {
            out.send(&mut stale)?;
        }
        let bad_now = sensor.counts().1;
        if bad_now > bad && now >= complained_ns + COMPLAIN_NS {
            warn!("{} bad frames since the last word about them: check baud rate, wiring and file", bad_now - bad);
            (complained_ns, bad) = (now, bad_now);
        }
        chassis.idle()?;
    }
    Ok(())
}

/// Asks if it has to, and takes what comes; an error shows at the next look at the connection.
fn exchange(line: &mut ReopeningPort, sensor: &mut Sensor, chassis: &mut Chassis) -> Vec<Reading> {
    let now = now_ns();
    if let Some(question) = sensor.question(now) {
        let _ = line.write_all(question, now + WRITE_NS);
    }
    let mut buffer = [0; 256];
    let Ok(count) = line.read(&mut buffer, now + WAIT_NS) else { return Vec::new() };
    chassis.pass_begin();
    let now = now_ns();
    let readings = buffer[..count].iter().filter_map(|byte| sensor.take(*byte, now)).collect();
    chassis.pass_end();
    readings
}
