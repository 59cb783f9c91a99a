//! Writes a run of any length as the recorder would, from lockstep flights: `synthetic_run FILE.mcap [SECONDS] [BOX]
//! [MISSION]`. It provides input for timing programs that read runs: an hour takes minutes to fly, and `nims report`
//! must read it within seconds.

use nims_tests::recorded::record;
use nims_tests::scenarios::Case;
use std::path::Path;

fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let arg = |at: usize, default: &str| args.get(at).cloned().unwrap_or_else(|| default.to_owned());
    let (file, seconds, name) = (arg(0, "synthetic.mcap"), arg(1, "60").parse::<f64>()?, arg(2, "demo3"));
    let mission: &'static str = Box::leak(arg(3, "demo").into_boxed_str());
    let robot = if name.ends_with('4') { "lab4" } else { "lab3" };
    let case = Case { robot, mission, motor_s: [0.030, 0.040] };
    let system_path = format!("{}/../configs/systems/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    record(Path::new(&file), Path::new(&system_path), &case, seconds, true)
}
