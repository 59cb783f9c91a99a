//! Prints the processor time in s of writing a load with the `mcap` crate alone: RATE samples/s of 128 B on 100
//! channels and 20 clouds/s of 100 kB, for SECONDS. The reference for the recorder's own cost; see
//! `services/recorder/tests/load.rs`.

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use std::collections::BTreeMap;
use std::error::Error;
use std::io::BufWriter;

/// Bytes of a small sample with its CDR head.
const SMALL_BYTES: usize = 132;

fn main() -> Result<(), Box<dyn Error>> {
    let number = |at: usize| std::env::args().nth(at).and_then(|text| text.parse::<u64>().ok());
    let (Some(rate), Some(seconds)) = (number(1), number(2)) else {
        return Err("usage: bare RATE SECONDS".into());
    };
    let path = std::env::temp_dir().join(format!("nims-bare-{}.mcap", std::process::id()));
    let result = write(&path, rate, seconds);
    std::fs::remove_file(&path)?;
    println!("{:.3}", result?);
    Ok(())
}

fn write(path: &std::path::Path, rate: u64, seconds: u64) -> Result<f64, Box<dyn Error>> {
    let options = WriteOptions::new()
        .profile("ros2")
        .compression(Some(Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .chunk_size(Some(1 << 20))
        .disable_seeking(true);
    let mut writer = options.create(BufWriter::new(std::fs::File::create(path)?))?;
    let mut add = |topic: String| -> Result<u16, Box<dyn Error>> {
        let schema = writer.add_schema("load_msgs/msg/Small", "ros2msg", b"uint8[128] data\n")?;
        Ok(writer.add_channel(schema, &topic, "cdr", &BTreeMap::new())?)
    };
    let channels = (0..100).map(|at| add(format!("/motor/command/{at}"))).collect::<Result<Vec<u16>, _>>()?;
    let cloud = add("/cloud/lidar".to_owned())?;
    let begun_s = processor_s();
    let mut sequence = 0;
    each_sample(rate, seconds, |data| {
        let channel_id = if data.len() > SMALL_BYTES { cloud } else { channels[sequence as usize % channels.len()] };
        let time = sequence * 1_000_000_000 / rate;
        let header = MessageHeader { channel_id, sequence: sequence as u32, log_time: time, publish_time: time };
        sequence += u64::from(channel_id != cloud);
        Ok(writer.write_to_known_channel(&header, data)?)
    })?;
    writer.finish()?;
    let written_s = processor_s() - begun_s;
    // The same numbers are generated alone: that does not count. A reading of this clock takes as long as writing a
    // sample, so there is one at each end.
    let begun_s = processor_s();
    each_sample(rate, seconds, |data| {
        std::hint::black_box(data);
        Ok(())
    })?;
    Ok(written_s - (processor_s() - begun_s))
}

/// Generates the samples one after the other: a cloud beside every so many small ones.
fn each_sample(
    rate: u64,
    seconds: u64,
    mut take: impl FnMut(&[u8]) -> Result<(), Box<dyn Error>>,
) -> Result<(), Box<dyn Error>> {
    let mut random = 88_172_645_463_325_252_u64;
    let mut fill = |data: &mut [u8]| {
        for chunk in data[4..].chunks_exact_mut(8) {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            chunk.copy_from_slice(&(1.0 + (random >> 40) as f64 * 1e-9).to_le_bytes());
        }
    };
    let (mut small, mut large) = ([0_u8; SMALL_BYTES], vec![0_u8; 100_004]);
    for sequence in 0..rate * seconds {
        fill(&mut small);
        take(&small)?;
        if sequence % (rate / 20).max(1) == 0 {
            fill(&mut large);
            take(&large)?;
        }
    }
    Ok(())
}

fn processor_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
