//! The device: change this file. As it is, it counts.

/// Your device, with its open port.
#[derive(Debug, Default)]
pub struct Device {
    count: u32,
}

impl Device {
    /// Opens the device. An error ends the program, and `nims plug` prints it: name the device and what to do.
    pub fn open() -> anyhow::Result<Self> {
        Ok(Self::default())
    }

    /// Reads the device once. It may wait for less than a second; a longer wait interrupts the heartbeat.
    pub fn read(&mut self) -> anyhow::Result<(f64, [f64; 4])> {
        let count = f64::from(self.count);
        self.count += 1;
        Ok((0.1 * count, [count, count + 1.0, count + 2.0, count + 3.0]))
    }
}
