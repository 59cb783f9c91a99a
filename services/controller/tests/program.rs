//! A law in a program of its own that flies: late answers are dropped, and what follows is the answer to its question.

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::time::Duration;

use cable_robot::{Setpoint, Vector3};
use config::SystemFile;
use controller::program::ProgramLaw;
use controller::{CableLaw, LawInput};
use messages::NodeEstimate;

fn system() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems/demo3.toml")
}

/// A program that answers the question of cycle N after `answer` with N for each cable.
fn law(folder: &Path, answer: &str, deadline: Option<Duration>) -> ProgramLaw {
    let path = folder.join("law.sh");
    let text = format!(
        r#"read hello
printf '%s\n' '{{"parameters":"gain = 2\n"}}'
while read question; do
    cycle=${{question#*'"cycle":'}}
    cycle=${{cycle%%,*}}
    {answer}
    echo "[$cycle,$cycle,$cycle]"
done
"#
    );
    std::fs::write(&path, text).unwrap();
    ProgramLaw::start(&format!("sh {}", path.display()), &system(), 3, deadline).unwrap()
}

fn ask(law: &mut ProgramLaw, cycle: u64) -> Option<f64> {
    let robot = SystemFile::load(&system()).unwrap().robot_file().unwrap().robot().unwrap();
    let mut estimate = NodeEstimate::default();
    estimate.header.cycle = cycle;
    let zero = Vector3::zeros();
    let setpoint =
        Setpoint { position: zero, velocity: zero, acceleration: zero, segment_id: 1, path_s_m: 0.0, at_rest: true };
    let velocity = law.velocity(&LawInput {
        slot: 0,
        robot: &robot,
        period_s: 0.01,
        horizon_s: 0.2,
        estimate: &estimate,
        now: &setpoint,
        ahead: &setpoint,
        now_held: None,
        ahead_held: None,
    });
    velocity.map(|velocity| velocity[1])
}

#[test]
fn a_late_answer_is_dropped_and_the_next_one_is_that_of_its_question() {
    let folder = tempfile::tempdir().unwrap();
    // It waits for a file before the answer of cycle 2.
    let gate = folder.path().join("gate");
    let wait = format!("if [ $cycle = 2 ]; then while [ ! -e {} ]; do sleep 0.01; done; fi", gate.display());
    // The deadline is never the limit of a machine that stands still: only cycle 2 has to miss it.
    let mut law = law(folder.path(), &wait, Some(Duration::from_secs(3)));
    assert!(law.parameters().starts_with("program = \"sh ") && law.parameters().ends_with("gain = 2\n"));
    assert_eq!(ask(&mut law, 1), Some(1.0));
    assert_eq!(ask(&mut law, 2), None);
    assert_eq!(ask(&mut law, 3), None, "no question while an answer is missing");
    std::fs::write(&gate, "").unwrap();
    let next = (4..2000).find_map(|cycle| {
        std::thread::sleep(Duration::from_millis(10));
        ask(&mut law, cycle).map(|answer| (cycle as f64, answer))
    });
    let (cycle, answer) = next.unwrap();
    assert_eq!(answer, cycle);
    assert!(law.complaint().lock().unwrap().is_none());
}

#[test]
fn a_program_that_ends_is_a_complaint() {
    let folder = tempfile::tempdir().unwrap();
    let mut law = law(folder.path(), "if [ $cycle = 2 ]; then exit 3; fi", Some(Duration::from_secs(20)));
    assert_eq!((ask(&mut law, 1), ask(&mut law, 2)), (Some(1.0), None));
    assert!(law.complaint().lock().unwrap().as_ref().unwrap().contains("has ended"));
}
