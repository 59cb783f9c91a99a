//! A virtual RoboClaw on a pseudo-terminal, for any client of the protocol:
//!
//! ```text
//! cargo run -p roboclaw --example virtual_unit -- /tmp/roboclaw 115200 0x80 0x81
//! ```
//!
//! Its motors are ideal: they turn as fast as they are told, at 44 000 counts per second at full duty.
#![forbid(unsafe_code)]

use std::path::Path;

use roboclaw::codec::Motor;
use roboclaw::unit::{Target, Unit, UnitBus, UnitOptions};
use serial::{Device, PtyLink, WireQueue, monotonic_ns, sleep_until};

/// Short beside the time of one byte at most speeds.
const TICK_NS: u64 = 100_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [link, baud, addresses @ ..] = arguments.as_slice() else {
        return Err("usage: virtual_unit LINK BAUD ADDRESS ..".into());
    };
    let baud: u32 = baud.parse()?;
    let units: Result<Vec<Unit>, _> = addresses
        .iter()
        .map(|text| u8::from_str_radix(text.trim_start_matches("0x"), 16).map(|at| Unit::new(UnitOptions::new(at))))
        .collect();
    let mut line = UnitBus::new(units?);
    let mut jack = PtyLink::new(Path::new(link));
    jack.plug()?;
    let (mut arriving, mut leaving) = (WireQueue::new(baud), WireQueue::new(baud));
    let mut counts = vec![[0.0; 2]; line.units().len()];
    let mut tick_ns = monotonic_ns();
    loop {
        let now_ns = monotonic_ns();
        let Some(pty) = jack.pty() else { return Ok(()) };
        pty.release_exclusive();
        let mut buffer = [0; 256];
        let received = pty.read(&mut buffer)?;
        arriving.push(now_ns, &buffer[..received]);
        while let Some((at_ns, byte)) = arriving.pop(now_ns) {
            line.receive(at_ns, byte, &mut leaving);
        }
        line.advance(now_ns);
        while let Some((_, byte)) = leaving.pop(now_ns) {
            pty.write(&[byte])?;
        }
        let step_s = (now_ns - tick_ns) as f64 * 1e-9;
        tick_ns = now_ns;
        for (unit, counts) in line.units_mut().iter_mut().zip(&mut counts) {
            let mut measured = *unit.measured();
            for motor in [Motor::One, Motor::Two] {
                let index = motor.index();
                let full = f64::from(unit.velocity_pid(motor).counts_s_at_full_duty);
                let (speed, duty) = match unit.target(motor) {
                    Target::Speed(speed) => (speed, speed / full),
                    Target::Duty(duty) => (duty * full, duty),
                };
                counts[index] += speed * step_s;
                measured.counts[index] = counts[index] as i64;
                measured.speeds_counts_s[index] = speed;
                measured.duties[index] = duty;
                measured.currents_a[index] = duty;
            }
            unit.measure(&measured);
        }
        sleep_until(now_ns + TICK_NS);
    }
}
