//! Records every channel to the files of one run; see the library.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use bus::CHANNELS_EVENT;
use config::RecorderSection;
use recorder::{Recorder, Settings, recover_leftovers};
use runtime::{BadInput, Chassis, CommonArgs, build};

/// Records every channel of a domain until a stop is requested.
#[derive(clap::Parser)]
#[command(name = "recorder")]
struct Args {
    #[command(flatten)]
    common: CommonArgs,
    /// Folder of the run; must exist. The run file stores a copy of its configuration files.
    #[arg(long, value_name = "DIR")]
    run: PathBuf,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

fn main() -> ExitCode {
    runtime::main("recorder", run)
}

fn run(args: &Args, chassis: &mut Chassis) -> anyhow::Result<()> {
    if !args.run.is_dir() {
        return Err(BadInput(format!("--run {}: there is no such folder; create it first", args.run.display())).into());
    }
    let section = chassis.system_file().map_or_else(|_| RecorderSection::default(), |file| file.recorder.clone());
    let settings = Settings::new(&section, args.run.clone(), about(chassis, &args.run));
    let mut waiter = chassis.waiter(&[CHANNELS_EVENT])?;
    let mut recorder = Recorder::open(chassis.bus(), settings, section.exclude)?;
    recover_leftovers(recorder.session());
    chassis.ready()?;
    while chassis.running() {
        let wake = chassis.wait(&mut waiter, Some(recorder.next_poll_ns()))?;
        chassis.pass_begin();
        recorder.poll(chassis.bus(), wake.channel(0))?;
        chassis.pass_end();
        chassis.report_lost(recorder.lost());
    }
    recorder.close(chassis.bus(), "stopped")?;
    Ok(())
}

/// Returns facts about the run that are stored in the run file: versions, host, domain.
fn about(chassis: &Chassis, folder: &Path) -> BTreeMap<String, String> {
    let system = |name: &str| fs::read_to_string(format!("/proc/sys/kernel/{name}")).unwrap_or_default();
    let mut about = BTreeMap::from([
        ("run".to_owned(), folder.file_name().unwrap_or_default().to_string_lossy().into_owned()),
        ("nims_version".to_owned(), build::VERSION.to_owned()),
        ("host".to_owned(), system("hostname").trim().to_owned()),
        ("kernel".to_owned(), system("osrelease").trim().to_owned()),
        ("build".to_owned(), build::PROFILE.to_owned()),
        ("recorder_pid".to_owned(), std::process::id().to_string()),
        ("domain".to_owned(), chassis.bus().domain().name().to_owned()),
    ]);
    if let Some((commit, dirty)) = build::commit() {
        about.insert("git_commit".to_owned(), commit.to_owned());
        about.insert("git_dirty".to_owned(), dirty.to_string());
    }
    if let Ok(file) = chassis.system_file() {
        about.insert("system".to_owned(), file.name.clone());
    }
    about
}
