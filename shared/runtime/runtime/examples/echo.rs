//! A minimal process: logs the samples on `motor/state`. Tests start it and end it.

use messages::MotorState;
use runtime::{Chassis, CommonArgs};

#[derive(clap::Parser)]
struct Args {
    #[command(flatten)]
    common: CommonArgs,
    /// Number of events to log at each sample.
    #[arg(long, default_value_t = 0)]
    burst: u32,
    /// Fail at the first sample.
    #[arg(long)]
    fail: bool,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

fn main() -> std::process::ExitCode {
    runtime::main("echo", run)
}

fn run(args: &Args, chassis: &mut Chassis) -> anyhow::Result<()> {
    let mut states = chassis.bus().subscriber::<MotorState>("motor/state")?;
    let mut waiter = chassis.waiter(&["motor/state"])?;
    chassis.ready()?;
    while chassis.running() {
        chassis.wait(&mut waiter, None)?;
        while let Some(state) = states.receive()? {
            chassis.pass_begin();
            tracing::info!(cycle = state.header.cycle, "a sample came");
            (0..args.burst).for_each(|k| tracing::debug!("event {k}"));
            anyhow::ensure!(!args.fail, "was told to fail");
            chassis.pass_end();
        }
        chassis.report_lost(states.lost());
    }
    Ok(())
}
