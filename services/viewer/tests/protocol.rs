//! The protocol as a tool speaks it: its versions, the graph and the parameters.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use std::process::Command;

use serde_json::{Value, json};
use support::with_robot;

fn tool(port: &str, samples: u32, versions: &str, requests: &Value, replies: u32) -> Value {
    let (samples, requests, replies) = (samples.to_string(), requests.to_string(), replies.to_string());
    let mut command = Command::new("python3");
    command.args(["-c", include_str!("look.py"), "127.0.0.1", port, &samples, "1", versions, &requests, &replies]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Both versions of the protocol have the same content, and a tool that speaks neither is told which.
#[test]
fn both_versions_of_the_protocol_are_spoken() {
    with_robot(&[], |port, _, _| {
        for (offered, chosen) in [
            ("foxglove.sdk.v1", "foxglove.sdk.v1"),
            ("foxglove.websocket.v1", "foxglove.websocket.v1"),
            ("foxglove.websocket.v1, foxglove.sdk.v1.1, foxglove.sdk.v1", "foxglove.sdk.v1"),
        ] {
            let tool = tool(port, 20, offered, &json!([]), 0);
            assert_eq!((&tool["protocol"], &tool["samples"]), (&chosen.into(), &json!(20)), "{tool}");
            assert!(tool["topics"].as_array().unwrap().contains(&"/motor/state".into()), "{tool}");
        }
        for other in ["other.v1", "foxglove.sdk.v2", ""] {
            let tool = tool(port, 20, other, &json!([]), 0);
            let answer = tool["answer"].as_str().unwrap();
            assert!(answer.starts_with("HTTP/1.1 400") && answer.contains("foxglove.websocket.v1"), "{tool}");
        }
    });
}

/// The updates of one kind, the oldest first.
fn of_kind<'a>(tool: &'a Value, kind: &'a str) -> impl Iterator<Item = &'a Value> {
    tool["replies"].as_array().unwrap().iter().filter(move |reply| reply["op"] == kind)
}

#[test]
fn a_tool_draws_who_publishes_and_subscribes() {
    with_robot(&[], |port, _, _| {
        let asked = json!([{"op": "subscribeConnectionGraph"}]);
        // The second update contains the subscriptions of this tool.
        let tool = tool(port, 20, "foxglove.sdk.v1", &asked, 2);
        let ends = |list: &str, ids: &str| -> Vec<Value> {
            let entries = of_kind(&tool, "connectionGraphUpdate").flat_map(|update| update[list].as_array().unwrap());
            entries.filter(|entry| entry["name"] == "/motor/state").map(|entry| entry[ids].clone()).collect()
        };
        assert_eq!(ends("publishedTopics", "publisherIds")[0], json!(["test"]), "{tool}");
        assert_eq!(ends("subscribedTopics", "subscriberIds").last(), Some(&json!(["viewer"])), "{tool}");
    });
}

#[test]
fn a_tool_reads_parameters_and_changes_none() {
    with_robot(&[], |port, _, _| {
        let name = "estimator.estimator.process_noise";
        let asked = json!([
            {"op": "setParameters", "parameters": [{"name": name, "value": -1.0}]},
            {"op": "subscribeParameterUpdates", "parameterNames": [name]},
            {"op": "getParameters", "parameterNames": [], "id": "all"},
        ]);
        let tool = tool(port, 20, "foxglove.sdk.v1", &asked, 4);
        let warning = of_kind(&tool, "status").next().unwrap();
        assert!(warning["message"].as_str().unwrap().contains("setParameters"), "{warning}");
        let answer = of_kind(&tool, "parameterValues").find(|reply| reply["id"] == "all").unwrap();
        let all = answer["parameters"].as_array().unwrap();
        let of = |name: &str| all.iter().find(|parameter| parameter["name"] == name);
        assert_eq!(of("viewer.viewer.rate_hz").unwrap()["value"], 50.0, "{answer}");
        assert_eq!(of(name).unwrap()["type"], "float64", "{answer}");
        // Each change of what it follows, and of nothing else.
        let changes: Vec<f64> = of_kind(&tool, "parameterValues")
            .filter(|reply| reply.get("id").is_none())
            .map(|reply| {
                assert_eq!(
                    (reply["parameters"].as_array().unwrap().len(), &reply["parameters"][0]["name"]),
                    (1, &name.into())
                );
                reply["parameters"][0]["value"].as_f64().unwrap()
            })
            .collect();
        assert!(changes.len() >= 2 && changes.is_sorted_by(|a, b| 0.0 <= *a && a < b), "{changes:?}");
    });
}
