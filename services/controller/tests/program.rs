//! A law in a program of its own that flies: late answers are dropped, and what follows is the answer to its question.

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::time::Duration;

use cable_robot::{Setpoint, Vector3};
use config::SystemFile;
use controller::program::{ProgramLaw, StartError, Waits};
use controller::{CableLaw, LawInput};
use messages::NodeEstimate;

fn system() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems/demo3.toml")
}

/// The waits of a flight whose answers count from the first one.
fn at_once(longest_s: u64, deadline_s: u64) -> Waits {
    let (longest, deadline) = (Duration::from_secs(longest_s), Some(Duration::from_secs(deadline_s)));
    Waits { longest, deadline, measured: 0 }
}

/// A program that answers the question of cycle N after `answer` with N for each cable.
fn law(folder: &Path, answer: &str, waits: Waits) -> ProgramLaw {
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
    ProgramLaw::start(&format!("sh {}", path.display()), &system(), 3, waits).unwrap()
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
    let mut law = law(folder.path(), &wait, at_once(60, 3));
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
fn answers_count_after_the_deadline_was_kept_for_long_enough() {
    let folder = tempfile::tempdir().unwrap();
    let gate = folder.path().join("gate");
    let wait = format!("if [ $cycle = 3 ]; then while [ ! -e {} ]; do sleep 0.01; done; fi", gate.display());
    // The machine may stand still for less than the deadline; only cycle 3 has to miss it.
    let mut law = law(folder.path(), &wait, Waits { longest: Duration::from_secs(60), measured: 10, ..at_once(60, 3) });
    for cycle in 1..=3 {
        assert_eq!(ask(&mut law, cycle), None, "cycle {cycle}");
    }
    std::fs::write(&gate, "").unwrap();
    // A cycle that finds the late answer missing is another late one: then it begins again.
    let answers = (4..2000).map(|cycle| {
        std::thread::sleep(Duration::from_millis(10));
        ask(&mut law, cycle)
    });
    let unused = answers.take_while(Option::is_none).count();
    assert!((10..1900).contains(&unused), "{unused} answers were not used");
}

#[test]
fn a_program_that_ends_is_a_complaint() {
    let folder = tempfile::tempdir().unwrap();
    let mut law = law(folder.path(), "if [ $cycle = 2 ]; then exit 3; fi", at_once(10, 20));
    assert_eq!((ask(&mut law, 1), ask(&mut law, 2)), (Some(1.0), None));
    assert!(law.complaint().lock().unwrap().as_ref().unwrap().contains("has ended"));
    assert_eq!(ask(&mut law, 3), None, "it is not asked again");
}

#[test]
fn a_program_that_hangs_is_given_up() {
    let folder = tempfile::tempdir().unwrap();
    let mut law = law(folder.path(), "if [ $cycle = 2 ]; then exec sleep 600; fi", at_once(5, 2));
    assert_eq!((ask(&mut law, 1), ask(&mut law, 2)), (Some(1.0), None));
    assert!(law.complaint().lock().unwrap().is_none(), "the first late answer is dropped");
    let complaint = (3..3000).find_map(|cycle| {
        std::thread::sleep(Duration::from_millis(10));
        assert_eq!(ask(&mut law, cycle), None);
        law.complaint().lock().unwrap().clone()
    });
    assert!(complaint.unwrap().contains("has not answered within 5 s"));
}

#[test]
fn a_line_without_end_is_a_complaint() {
    let folder = tempfile::tempdir().unwrap();
    let mut law = law(folder.path(), "exec tr '\\0' x < /dev/zero", at_once(10, 20));
    assert_eq!(ask(&mut law, 1), None);
    let complaint = law.complaint().lock().unwrap().clone().unwrap();
    assert!(complaint.contains("a line of more than 65536 bytes") && complaint.len() < 500, "{complaint}");
}

#[test]
fn a_program_that_does_not_read_blocks_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let blind = "while :; do sleep 0.01; echo '[1,1,1]'; done";
    let mut law = law(folder.path(), blind, at_once(10, 20));
    let complaint = (1..10_000).find_map(|cycle| {
        ask(&mut law, cycle);
        law.complaint().lock().unwrap().clone()
    });
    // Where the machine stands still for a moment, a second answer is found first.
    let complaint = complaint.unwrap();
    assert!(complaint.contains("does not read") || complaint.contains("without a question"), "{complaint}");
}

#[test]
fn only_a_wrong_command_or_a_wrong_first_answer_is_bad_input() {
    let start = |command: &str| {
        let waits = Waits { longest: Duration::from_secs(1), ..Waits::in_lockstep() };
        ProgramLaw::start(command, &system(), 3, waits).err().unwrap()
    };
    for (command, part) in [("", "is empty"), ("no-such-program", "does not start")] {
        let error = start(command);
        assert!(matches!(&error, StartError::NotOne(why) if why.contains(part)), "{error:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    let script = |text: &str| {
        let path = folder.path().join("law.sh");
        std::fs::write(&path, text).unwrap();
        format!("sh {}", path.display())
    };
    let hangs = start(&script("exec sleep 600"));
    assert!(matches!(&hangs, StartError::Fails(why) if why.contains("has not answered within 1 s")), "{hangs:?}");
    let waits = Waits::in_lockstep();
    let wrong = ProgramLaw::start(&script("echo hello; exec sleep 600"), &system(), 3, waits).err().unwrap();
    assert!(matches!(&wrong, StartError::NotOne(why) if why.contains("does not answer as the law")), "{wrong:?}");
    let ends = ProgramLaw::start(&script("exit 3"), &system(), 3, waits).err().unwrap();
    assert!(matches!(&ends, StartError::Fails(why) if why.contains("has ended")), "{ends:?}");
}

/// The processors of a status of a process.
fn processors(status: &str) -> String {
    let line = status.lines().find(|line| line.starts_with("Cpus_allowed_list:"));
    line.unwrap().split_whitespace().nth(1).unwrap().to_owned()
}

#[test]
fn a_program_in_flight_is_not_bound_to_the_processor_of_the_control_thread() {
    let all = processors(&std::fs::read_to_string("/proc/thread-self/status").unwrap());
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("status");
    let keep = format!("cat /proc/self/status > {}", file.display());
    let (one, mut law) = std::thread::scope(|scope| {
        let bound = scope.spawn(|| {
            let first = rustix::thread::sched_getaffinity(None).unwrap();
            let cpu = (0..rustix::thread::CpuSet::MAX_CPU).find(|cpu| first.is_set(*cpu)).unwrap();
            let mut set = rustix::thread::CpuSet::new();
            set.set(cpu);
            rustix::thread::sched_setaffinity(None, &set).unwrap();
            (cpu.to_string(), law(folder.path(), &keep, at_once(10, 20)))
        });
        bound.join().unwrap()
    });
    assert_eq!(ask(&mut law, 1), Some(1.0));
    let of_law = processors(&std::fs::read_to_string(&file).unwrap());
    // A machine with one processor shows nothing.
    assert!(all == one || of_law != one, "{of_law}");
}
