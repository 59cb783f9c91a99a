//! The figures of a run as JSON.

use super::gather::RunData;
use super::html::RunAssessment;
use super::losses::Stretch;
use serde_json::{Value, json};

/// Returns the figures of a run.
pub fn value(assessment: &RunAssessment) -> Value {
    let RunAssessment { run, verdict, legs, deviations, between } = assessment;
    let times: Vec<Value> = ["wake", "bus", "command_age", "state_to_command"]
        .into_iter()
        .zip(&run.times)
        .map(|(name, times)| {
            // A histogram without samples has zeros, which would keep any limit.
            let some = |ns: u64| (!times.all.is_empty()).then_some(ns);
            let ns = |share: f64| some(times.all.value_at_quantile(share));
            json!({ "what": name, "samples": times.all.len(), "p50_ns": ns(0.5), "p99_ns": ns(0.99), "max_ns": some(times.all.max()) })
        })
        .collect();
    let cables: Vec<Value> = run
        .cables
        .iter()
        .map(|cable| {
            json!({
                "length_m": cable.length.extremes(), "velocity_m_s": cable.velocity.extremes(), "tension_n": cable.tension.extremes(),
                "true_tension_n": cable.true_tension.extremes(), "current_a": cable.current.extremes(),
                "energy_j": cable.energy_j, "loss_j": cable.loss_j,
            })
        })
        .collect();
    let sensors: Vec<Value> = run
        .sensors
        .channels()
        .iter()
        .map(|(name, sensor)| {
            json!({
                "channel": name, "samples": sensor.samples, "doubtful": sensor.doubtful, "values": sensor.extremes(),
                "left_out": sensor.left_out(),
            })
        })
        .collect();
    let events: Vec<Value> = run
        .events
        .all()
        .iter()
        .map(|event| {
            json!({
                "time_s": event.time_s, "utc": run.utc(event.time_s), "kind": event.kind, "text": event.text,
                "requester": event.requester, "times": event.times,
            })
        })
        .collect();
    let (incidents, more_incidents) = run.incidents.all();
    let incidents: Vec<Value> = incidents
        .iter()
        .map(|incident| {
            let mut value = json!(incident);
            value["utc"] = json!(run.utc(incident.time_s));
            value
        })
        .collect();
    let lost: Vec<Value> = run.lost.stretches().iter().map(|stretch| lost(run, stretch)).collect();
    // Lists have limits, so that a page stays readable.
    let left_out = json!({ "legs": run.legs.left_out, "events": run.events.left_out, "incidents": more_incidents, "in_charge": run.in_charge.left_out, "lost": run.lost.left_out });
    json!({
        "run": run.name, "verdict": verdict, "analysis": run.analysis, "flown_m": run.legs.flown_m(), "legs": legs, "cables": cables,
        "times": times, "faults": run.events.faults, "events": events, "incidents": incidents, "sensors": sensors, "missions_done": run.missions,
        "deviations": deviations, "between": between, "in_charge": run.in_charge.spans(), "drive_units": run.units, "world": run.world, "unsteered": run.periods.unsteered(), "lost": lost, "version": runtime::build::description(),
        "wear": run.wear.result(run.robot.as_ref()), "lacks": run.lacks, "left_out": left_out, "recording": { "healthy": run.recording.healthy, "verdict": run.recording.verdict,
            "started_utc": run.recording.started, "duration_s": run.recording.duration_s, "messages": run.recording.messages,
            "unrecorded_s": run.unrecorded_s(), "about": run.recording.about },
    })
}

fn lost(run: &RunData, stretch: &Stretch) -> Value {
    let Stretch { from_s, to_s, cycles, cause, periods } = stretch;
    json!({
        "from_s": from_s, "to_s": to_s, "utc": run.utc(*from_s), "cycles": cycles, "cause": cause, "periods": periods,
    })
}
