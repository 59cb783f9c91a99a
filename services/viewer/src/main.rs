//! Serves every channel live to Foxglove and Lichtblick; see the library.

use std::net::IpAddr;
use std::process::ExitCode;

use bus::clock::now_ns;
use bus::{CHANNELS_EVENT, Participant};
use config::ViewerSection;
use runlog::RunClock;
use runtime::{Chassis, CommonArgs};
use viewer::{Settings, Viewer};

/// Serve every channel of a domain to Foxglove and Lichtblick until the process is ended.
#[derive(clap::Parser)]
#[command(name = "viewer")]
struct Args {
    #[command(flatten)]
    common: CommonArgs,
    /// Address to listen on. Default: `address` in [viewer] of the system file, or 127.0.0.1.
    #[arg(long, value_name = "ADDRESS")]
    address: Option<IpAddr>,
    /// TCP port; 0: any free port. Default: `port` in [viewer] of the system file, or 8765.
    #[arg(long, value_name = "PORT")]
    port: Option<u16>,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

fn main() -> ExitCode {
    runtime::main_as("viewer", Participant::Guest, run)
}

fn run(args: &Args, chassis: &mut Chassis) -> anyhow::Result<()> {
    // On Linux this sets the nice value of this thread, which its threads inherit: the viewer must not delay other
    // processes.
    let _ = rustix::process::nice(10);
    let section = chassis.system_file().map_or_else(|_| ViewerSection::default(), |file| file.viewer.clone());
    let address = args.address.unwrap_or(section.address);
    let set = chassis.bus().domain().wall_clock();
    let settings = Settings {
        name: format!("nims {}", chassis.bus().domain().name()),
        address,
        port: args.port.unwrap_or(section.port),
        rate_hz: section.rate_hz,
        look: section.look,
        clock: set.map_or_else(RunClock::now, |set| RunClock { t0_unix_ns: set.unix_ns, t0_mono_ns: set.mono_ns }),
    };
    let mut waiter = chassis.waiter(&[CHANNELS_EVENT])?;
    let mut viewer = Viewer::open(&settings)?;
    viewer.poll(chassis.bus(), true)?;
    tracing::info!("Foxglove or Lichtblick: open ws://{}", std::net::SocketAddr::new(address, viewer.port()));
    if !address.is_loopback() {
        tracing::warn!("anyone who can reach {address} over the network can see the channels; there is no password");
    }
    chassis.ready()?;
    while chassis.running() {
        let wake = chassis.wait(&mut waiter, viewer.next_poll_ns(now_ns()))?;
        chassis.pass_begin();
        viewer.poll(chassis.bus(), wake.channel(0))?;
        chassis.pass_end();
        chassis.report_lost(viewer.lost());
    }
    viewer.close();
    Ok(())
}
