use super::*;
use messages::put_text;

const FOLLOWING: u8 = MotorAuthority::MODE_FOLLOWING;
const STOPPING: u8 = MotorAuthority::MODE_STOPPING;
const HOLDING: u8 = MotorAuthority::MODE_HOLDING;
const FAULTED: u8 = MotorAuthority::MODE_FAULTED;

/// Runs cycles of 10 ms from a time on, s, in one mode with faults; the cables move below that time.
fn fly(incidents: &mut Incidents, [from_s, to_s]: [f64; 2], mode: u8, faults: u32, moves_to_s: f64) {
    fly_as(incidents, [from_s, to_s], moves_to_s, MotorAuthority { mode, faults, ..MotorAuthority::default() });
}

fn fly_as(incidents: &mut Incidents, [from_s, to_s]: [f64; 2], moves_to_s: f64, mut authority: MotorAuthority) {
    for cycle in (100.0 * from_s).round() as u64..(100.0 * to_s).round() as u64 {
        let time_s = 0.01 * cycle as f64;
        let mut state = MotorState::default();
        state.velocity_m_s[0] = if time_s < moves_to_s { 0.1 } else { 0.0 };
        authority.header.cycle = cycle;
        incidents.cycle(time_s, &authority, Some(&state));
    }
}

fn asks(incidents: &mut Incidents, time_s: f64, verb: u8, text: &str) {
    let mut request = OperatorRequest { answered: 1, accepted: OperatorRequest::ACCEPTED, ..Default::default() };
    request.body.verb = verb;
    put_text(&mut request.text, text);
    put_text(&mut request.requester, "ada");
    incidents.request(time_s, &request);
}

fn row(incidents: &mut Incidents, time_s: f64, name: &str, role: &str, state: u8, reason: &str) {
    let mut row = ProcessState { state, pid: 7, slot: 1, ..ProcessState::default() };
    put_text(&mut row.name, name);
    put_text(&mut row.role, role);
    put_text(&mut row.reason, reason);
    incidents.process(time_s, &row);
}

fn one(incidents: &Incidents) -> Incident {
    let (mut all, left_out) = incidents.all();
    assert_eq!((all.len(), left_out), (1, 0), "{all:?}");
    all.remove(0)
}

#[test]
fn a_controller_that_was_killed_on_request_is_one_sentence() {
    let mut incidents = Incidents::default();
    row(&mut incidents, 0.0, "my-law", "controller", ProcessState::STATE_READY, "");
    fly(&mut incidents, [0.0, 2.0], FOLLOWING, 0, 9.0);
    asks(&mut incidents, 1.9, RequestBody::VERB_FAULT, "kill my-law");
    let lost = MotorAuthority::FAULT_COMMAND_LOST;
    fly(&mut incidents, [2.0, 2.5], STOPPING, lost, 2.4);
    fly(&mut incidents, [2.5, 4.0], HOLDING, lost, 0.0);
    row(
        &mut incidents,
        1.92,
        "my-law",
        "controller",
        ProcessState::STATE_DIED,
        "was ended by signal 9; starting again in 1.0 s",
    );
    fly(&mut incidents, [4.0, 5.0], FOLLOWING, 0, 9.0);
    let found = one(&incidents);
    assert_eq!((found.time_s, found.cycle), (2.0, 200));
    assert_eq!(found.of, ["process my-law in slot a"]);
    assert_eq!(
        found.sentence,
        "At 2.00 s, while the robot followed its motion, the controller stopped answering (process my-law in slot a), because \
         my-law was ended by signal 9 and ada asked for the fault \"kill my-law\": the robot braked on its path (the cables \
         stood 0.40 s later), held from 2.50 s on and moved again from 4.00 s on."
    );
    assert_eq!(found.did.iter().map(|step| step.time_s).collect::<Vec<_>>(), [2.0, 2.5, 4.0]);
}

#[test]
fn a_drive_and_a_cable_are_named_and_what_was_released_too() {
    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 9.0);
    let mut authority =
        MotorAuthority { mode: FAULTED, faults: MotorAuthority::FAULT_STALL, ..MotorAuthority::default() };
    authority.fault_cable[1] = 1;
    fly_as(&mut incidents, [1.0, 2.0], 1.1, authority);
    // A second later, so an incident for itself.
    authority.faults |= MotorAuthority::FAULT_LOST_UNIT;
    authority.fault_unit[0] = 1;
    fly_as(&mut incidents, [2.0, 3.0], 0.0, authority);
    let (all, _) = incidents.all();
    assert_eq!(all.len(), 2);
    assert_eq!((&all[0].of[..], &all[1].of[..]), (&["cable 2".to_owned()][..], &["drive unit 1".to_owned()][..]));
    let said: Vec<&str> = all.iter().map(|incident| incident.sentence.as_str()).collect();
    assert_eq!(
        said,
        [
            "At 1.00 s, while the robot followed its motion, a motor pushes hard and its cable does not move (cable 2): the \
             robot stopped its cables at once, released cable 2 and held the others (the cables stood 0.10 s later).",
            "At 2.00 s, while the robot was stopped by a fault, a drive unit does not answer (drive unit 1): the robot stayed \
             stopped.",
        ]
    );
}

#[test]
fn a_standby_that_takes_over_is_no_fault_but_an_incident() {
    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 2.0], FOLLOWING, 0, 9.0);
    row(&mut incidents, 2.03, "controller", "controller", ProcessState::STATE_DIED, "was ended by signal 11: no gain");
    let standby = MotorAuthority { mode: FOLLOWING, in_charge: [1, 0], ..MotorAuthority::default() };
    fly_as(&mut incidents, [2.0, 5.0], 9.0, standby);
    let found = one(&incidents);
    assert_eq!(
        found.sentence,
        "At 2.03 s, while the robot followed its motion, controller was ended by signal 11 (its last words: no gain): the robot \
         used the controller in slot b from 2.00 s on and went on with its motion."
    );
}

#[test]
fn late_commands_and_emergency_stops_have_their_causes() {
    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 9.0);
    let (faults, mode) = (MotorAuthority::FAULT_COMMAND_LOST, STOPPING);
    let verdict = [MotorAuthority::VERDICT_STALE, MotorAuthority::VERDICT_NONE];
    fly_as(&mut incidents, [1.0, 2.0], 0.0, MotorAuthority { mode, faults, verdict, ..MotorAuthority::default() });
    assert_eq!(one(&incidents).causes, ["the command answers an earlier cycle"]);

    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 9.0);
    fly(&mut incidents, [1.0, 2.0], MotorAuthority::MODE_EMERGENCY_STOP, 0, 1.2);
    asks(&mut incidents, 1.01, RequestBody::VERB_ESTOP, "");
    // What was asked for long before is no cause.
    asks(&mut incidents, 0.2, RequestBody::VERB_FAULT, "stall 2");
    assert_eq!(
        one(&incidents).sentence,
        "At 1.00 s, while the robot followed its motion, it was put into emergency stop, because ada asked for an emergency \
         stop: the robot stopped its motors at once (the cables stood 0.20 s later)."
    );
}

#[test]
fn a_restart_of_motor_io_is_told_and_the_list_is_bounded() {
    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 2.0], FOLLOWING, 0, 9.0);
    row(&mut incidents, 2.0, "motor-io", "motor-io", ProcessState::STATE_DIED, "was ended by signal 9");
    let mut next = MotorAuthority::default();
    next.header.life = 1;
    fly_as(&mut incidents, [3.0, 4.0], 0.0, next);
    let said = one(&incidents).sentence;
    assert!(
        said.ends_with(
            "motor-io was ended by signal 9: the robot was left to the watchdog of its drives until motor-io ran again, \
             disarmed, from 3.00 s on."
        ),
        "{said}"
    );
    for number in 0..MAX_INCIDENTS as u64 + 5 {
        let from_s = 10.0 + 4.0 * number as f64;
        fly(&mut incidents, [from_s, from_s + 2.0], HOLDING, MotorAuthority::FAULT_SLACK, 0.0);
        fly(&mut incidents, [from_s + 2.0, from_s + 4.0], HOLDING, 0, 0.0);
    }
    let (all, left_out) = incidents.all();
    assert_eq!((all.len(), left_out), (MAX_INCIDENTS, 6));
    assert_eq!(incidents.every().len(), MAX_INCIDENTS + 6);
}

#[test]
fn a_process_without_effect_on_the_mode_lets_the_robot_go_on() {
    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 30.0], FOLLOWING, 0, 99.0);
    row(&mut incidents, 10.0, "soil", "sensor", ProcessState::STATE_DIED, "was ended by signal 9");
    // Another process was ended on request.
    asks(&mut incidents, 9.0, RequestBody::VERB_FAULT, "kill recorder");
    fly(&mut incidents, [30.0, 40.0], HOLDING, 0, 0.0);
    assert_eq!(
        one(&incidents).sentence,
        "At 10.00 s, while the robot followed its motion, soil was ended by signal 9: the robot went on with its motion."
    );
}

#[test]
fn a_fault_names_the_process_of_its_time_and_not_a_later_one() {
    let mut incidents = Incidents::default();
    row(&mut incidents, 0.0, "law1", "controller", ProcessState::STATE_READY, "");
    fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 99.0);
    asks(&mut incidents, 0.9, RequestBody::VERB_FAULT, "stop law1");
    fly(&mut incidents, [1.0, 2.0], STOPPING, MotorAuthority::FAULT_COMMAND_LOST, 0.0);
    row(&mut incidents, 9.0, "law2", "controller", ProcessState::STATE_READY, "");
    let found = one(&incidents);
    assert_eq!(found.of, ["process law1 in slot a"]);
    assert_eq!(found.causes, ["ada asked for the fault \"stop law1\""]);
}

#[test]
fn a_request_for_another_process_is_no_cause_and_an_emergency_stop_is_said_with_the_fault_after_it() {
    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 2.0], FOLLOWING, 0, 99.0);
    asks(&mut incidents, 1.0, RequestBody::VERB_FAULT, "kill recorder");
    fly(&mut incidents, [2.0, 3.0], FAULTED, MotorAuthority::FAULT_LOST_UNIT, 0.0);
    assert!(one(&incidents).causes.is_empty());

    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 99.0);
    asks(&mut incidents, 1.0, RequestBody::VERB_ESTOP, "");
    let stopped = MotorAuthority::MODE_EMERGENCY_STOP;
    fly(&mut incidents, [1.0, 1.5], stopped, 0, 9.0);
    fly(&mut incidents, [1.5, 2.0], stopped, MotorAuthority::FAULT_SLACK, 0.0);
    let found = one(&incidents);
    assert_eq!((found.faults.len(), found.faults[0].as_str()), (2, "it was put into emergency stop"));
}

/// The causes of faults at 1 s, after requests at 0.5 and 0.9 s.
fn causes(requests: &[&str], change: fn(&mut MotorAuthority)) -> Vec<String> {
    let units = [(1, 128), (1, 129), (2, 128)];
    let units = units.map(|(port, address)| DriveUnit { port, address, cables: Vec::new() }).to_vec();
    let mut incidents = Incidents { units, ..Incidents::default() };
    fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 99.0);
    for (text, time_s) in requests.iter().zip([0.5, 0.9]) {
        asks(&mut incidents, time_s, RequestBody::VERB_FAULT, text);
    }
    let mut authority = MotorAuthority { mode: FAULTED, ..MotorAuthority::default() };
    change(&mut authority);
    fly_as(&mut incidents, [1.0, 2.0], 0.0, authority);
    one(&incidents).causes
}

fn clause(text: &str) -> [String; 1] {
    [format!("ada asked for the fault \"{text}\"")]
}

/// Cable 2 is slack.
fn slack(authority: &mut MotorAuthority) {
    (authority.faults, authority.fault_cable[1]) = (MotorAuthority::FAULT_SLACK, 1);
}

#[test]
fn the_request_for_the_cable_or_unit_that_failed_comes_before_a_later_one() {
    assert_eq!(causes(&["break 2", "stall 3"], slack), clause("break 2"));
    // One of the faults names no cable.
    let diverging = |authority: &mut MotorAuthority| {
        slack(authority);
        authority.faults |= MotorAuthority::FAULT_DIVERGING;
    };
    assert_eq!(causes(&["break 2", "stall 3"], diverging), clause("break 2"));
    // The third unit is the first one of the second port.
    let lost = |authority: &mut MotorAuthority| {
        (authority.faults, authority.fault_unit[2]) = (MotorAuthority::FAULT_LOST_UNIT, 1);
    };
    for text in ["mute 2 0x80", "silence 2", "supply 9"] {
        assert_eq!(causes(&[text, "mute 1 128"], lost), clause(text));
    }
    let lost: fn(&mut MotorAuthority) = |authority| authority.faults = MotorAuthority::FAULT_COMMAND_LOST;
    assert_eq!(causes(&["kill controller", "break 3"], lost), clause("kill controller"));
}

#[test]
fn without_a_request_for_what_failed_the_last_one_is_the_cause() {
    // The load of a broken cable goes to the others, one of which fails first.
    assert_eq!(causes(&["break 3"], slack), clause("break 3"));
    assert_eq!(causes(&["stall 1", "break 3"], slack), clause("break 3"));
    // The supply is that of all units, and a cable may be slack because its unit fails.
    assert_eq!(causes(&["break 3", "supply 9"], slack), clause("supply 9"));
    assert_eq!(causes(&["mute 1 128"], slack), clause("mute 1 128"));
    assert_eq!(
        causes(&["stall 3"], |authority| {
            (authority.faults, authority.fault_unit[0]) = (MotorAuthority::FAULT_DRIVE_ERROR, 1);
        }),
        clause("stall 3")
    );
    // These name neither a cable nor a unit.
    let diverging: fn(&mut MotorAuthority) = |authority| authority.faults = MotorAuthority::FAULT_DIVERGING;
    assert_eq!(causes(&["dead 3"], diverging), clause("dead 3"));
}

#[test]
fn a_wrong_output_of_one_process_is_the_cause_of_what_names_it_or_has_no_other_cause() {
    let lost: fn(&mut MotorAuthority) = |authority| authority.faults = MotorAuthority::FAULT_COMMAND_LOST;
    let planner: fn(&mut MotorAuthority) = |authority| authority.faults = MotorAuthority::FAULT_PLANNER_LOST;
    for text in ["slow controller 10", "nan controller", "frozen estimator for 0.5", "nan"] {
        assert_eq!(causes(&[text, "break 3"], lost), clause(text));
        for other in ["break 2", "stall 1"] {
            assert_eq!(causes(&[other, text], slack), clause(other), "{text}");
        }
        assert_eq!(causes(&[text], slack), clause(text));
        assert_eq!(causes(&[text], planner), clause(text));

        // The planner has died.
        let mut incidents = Incidents::default();
        fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 99.0);
        asks(&mut incidents, 0.9, RequestBody::VERB_FAULT, text);
        row(&mut incidents, 0.95, "planner", "planner", ProcessState::STATE_DIED, "was ended by signal 11");
        fly(&mut incidents, [1.0, 2.0], HOLDING, MotorAuthority::FAULT_PLANNER_LOST, 0.0);
        assert_eq!(one(&incidents).causes, ["planner was ended by signal 11"], "{text}");

        // It ends the process of that output at most.
        for (name, count) in [("soil", 0), ("controller-b", 0), (text.split(' ').nth(1).unwrap_or("x"), 1)] {
            let mut incidents = Incidents::default();
            fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 99.0);
            asks(&mut incidents, 0.9, RequestBody::VERB_FAULT, text);
            row(&mut incidents, 1.0, name, "controller", ProcessState::STATE_DIED, "was ended by signal 11");
            assert_eq!(one(&incidents).causes.len(), if text == "nan" { 0 } else { count }, "{text}: {name}");
        }
    }
}

#[test]
fn no_process_but_motor_io_dies_of_a_fault_of_the_motor_box() {
    for text in ["stall 3", "supply 9", "unplug 1", "mute 1 128"] {
        for (role, found) in [("sensor", 0), ("motor-io", 1)] {
            let mut incidents = Incidents::default();
            fly(&mut incidents, [0.0, 5.0], FOLLOWING, 0, 99.0);
            asks(&mut incidents, 1.5, RequestBody::VERB_FAULT, text);
            row(&mut incidents, 2.0, "it", role, ProcessState::STATE_DIED, "was ended by signal 9");
            assert_eq!(one(&incidents).causes.len(), found, "{text} {role}");
        }
    }
}

#[test]
fn a_fault_in_the_cycle_in_which_the_cables_come_to_rest_leaves_the_first_one_its_rest() {
    let mut incidents = Incidents::default();
    fly(&mut incidents, [0.0, 1.0], FOLLOWING, 0, 99.0);
    let lost = MotorAuthority::FAULT_LOST_UNIT;
    fly(&mut incidents, [1.0, 3.0], FAULTED, lost, 3.0);
    fly(&mut incidents, [3.0, 4.0], FAULTED, lost | MotorAuthority::FAULT_SLACK, 3.0);
    let (all, _) = incidents.all();
    assert!(all[0].sentence.ends_with("(the cables stood 2.00 s later)."), "{}", all[0].sentence);
}
