//! The device: this is the file to change. As it is, it counts.

/// Your device; here its port would be held.
#[derive(Debug, Default)]
pub struct Device {
    count: u32,
}

impl Device {
    /// Opens the device. What fails ends the program, and `nims plug` says the sentence: name the device and what to
    /// do.
    pub fn open() -> anyhow::Result<Self> {
        Ok(Self::default())
    }

    /// Reads the device once. It may wait, but for less than a second, so that the program still shows signs of life.
    pub fn read(&mut self) -> anyhow::Result<(f64, [f64; 4])> {
        let count = f64::from(self.count);
        self.count += 1;
        Ok((0.1 * count, [count, count + 1.0, count + 2.0, count + 3.0]))
    }
}
