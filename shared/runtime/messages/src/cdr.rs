//! Encoder for little-endian CDR bodies of messages of ROS 2.

/// The bytes of a body; every number is aligned to its own size.
#[derive(Debug, Default)]
pub struct Cdr(pub Vec<u8>);

macro_rules! numbers {
    ($($name:ident: $type:ty),*) => { $(
        /// Appends a number at a multiple of its size.
        pub fn $name(&mut self, value: $type) {
            self.align(size_of::<$type>());
            self.0.extend_from_slice(&value.to_le_bytes());
        }
    )* };
}

impl Cdr {
    numbers!(u8: u8, u32: u32, i32: i32, f32: f32, f64: f64);

    /// Fills with zeros up to a multiple of `size`.
    pub fn align(&mut self, size: usize) {
        self.0.resize(self.0.len().next_multiple_of(size), 0);
    }

    /// Appends a text with its length.
    pub fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }

    /// Appends numbers without their count.
    pub fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.f64(*value));
    }

    /// Appends numbers without their count.
    pub fn f32s(&mut self, values: &[f32]) {
        values.iter().for_each(|value| self.f32(*value));
    }

    /// Appends bytes with their count.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.0.extend_from_slice(bytes);
    }

    /// Appends `builtin_interfaces/Time` of a UNIX time.
    pub fn time(&mut self, unix_ns: u64) {
        self.i32(i32::try_from(unix_ns / 1_000_000_000).unwrap_or(i32::MAX));
        self.u32((unix_ns % 1_000_000_000) as u32);
    }

    /// Appends `std_msgs/Header`.
    pub fn header(&mut self, unix_ns: u64, frame: &str) {
        self.time(unix_ns);
        self.text(frame);
    }

    /// Appends `geometry_msgs/Pose` without rotation.
    pub fn pose(&mut self, position_m: &[f64; 3]) {
        self.f64s(position_m);
        self.f64s(&[0.0, 0.0, 0.0, 1.0]);
    }
}
