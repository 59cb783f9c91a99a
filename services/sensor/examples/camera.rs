//! A camera as a plug-in: publishes pictures as blobs, which Foxglove and other tools show.
//!
//! ```text
//! cargo build --release -p sensor --example camera
//! nims plug camera -- target/release/examples/camera --rate 30 --most-bytes 400000 FOLDER
//! ```
//!
//! The pictures here are the JPEG files of a folder, in the order of their names, again and again. For a camera,
//! replace [`pictures`] by what delivers its pictures.
#![forbid(unsafe_code)]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use bus::clock::WallClock;
use messages::Header;
use messages::blob::{BlobType, compressed_image};
use runtime::{BadInput, Chassis, CommonArgs, now_ns};

/// Bytes around a picture in its message, at most.
const AROUND_BYTES: usize = 100;

/// Publish the JPEG files of a folder as the pictures of a camera.
#[derive(clap::Parser)]
#[command(name = "camera")]
struct Args {
    #[command(flatten)]
    common: CommonArgs,
    /// Pictures per second.
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f64,
    /// Size of the largest picture, bytes: memory is reserved for it.
    #[arg(long, value_name = "BYTES", default_value_t = 400_000)]
    most_bytes: usize,
    /// Folder with JPEG files.
    folder: PathBuf,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

fn main() -> ExitCode {
    runtime::main("camera", run)
}

fn run(args: &Args, chassis: &mut Chassis) -> anyhow::Result<()> {
    let pictures = pictures(&args.folder)?;
    // The name under which it was plugged is that of the channel.
    let channel = format!("blob/{}", chassis.name());
    let most_bytes = args.most_bytes + AROUND_BYTES;
    let mut out = chassis.bus().blob_publisher(&channel, BlobType::CompressedImage, most_bytes, args.rate)?;
    let clock = chassis.bus().domain().wall_clock().unwrap_or_else(WallClock::now);
    let mut schedule = chassis.loop_schedule(args.rate)?;
    let mut body = Vec::new();
    chassis.ready()?;
    for picture in pictures.iter().cycle() {
        if !chassis.wait_for_turn(&mut schedule)? {
            break;
        }
        // A camera states when it took the picture.
        let taken_ns = now_ns();
        let unix_ns = clock.unix_ns + taken_ns.saturating_sub(clock.mono_ns);
        compressed_image(&mut body, unix_ns, "node", "jpeg", picture);
        out.send(Header::at(taken_ns), &body)?;
    }
    Ok(())
}

fn pictures(folder: &Path) -> anyhow::Result<Vec<Vec<u8>>> {
    let listed = std::fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let mut paths: Vec<PathBuf> = listed.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "jpg" || ending == "jpeg"));
    paths.sort();
    if paths.is_empty() {
        let what = format!("{} has no JPEG file (*.jpg); name a folder with some", folder.display());
        return Err(BadInput(what).into());
    }
    paths.iter().map(|path| std::fs::read(path).with_context(|| format!("{} cannot be read", path.display()))).collect()
}
