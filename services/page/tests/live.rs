//! The page in front of a real robot and its gateway: what a browser without a token may do, what the holder of a token
//! may, and that a motion ends that is held no more.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod rig;

use rig::{Browser, LONG, Rig, ready};
use rustix::process::Signal;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Instant;

const START: [f64; 3] = [4.8, 3.0, 0.3];

fn plain(verb: &str) -> Value {
    json!({ "verb": verb })
}

#[test]
fn a_browser_looks_and_stops_and_the_holder_of_a_token_flies() {
    let rig = Rig::up();
    let mut visitor = rig.browser(None);
    assert_eq!((&visitor.welcome["role"], &visitor.welcome["paired"]), (&json!("stop"), &json!(false)));
    let scene = visitor.until("the robot is drawn", |told| told["type"] == "scene");
    assert_eq!((scene["system"].as_str(), scene["anchors_m"].as_array().map(Vec::len)), (Some("demo3"), Some(3)));
    let refused = visitor.ask(plain("arm"));
    assert_eq!((&refused["accepted"], &refused["reason"]), (&json!("refused"), &json!(450)), "{refused}");

    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    assert_eq!((&flyer.welcome["user"], &flyer.welcome["role"]), (&json!("tablet"), &json!("fly")));
    ready(&mut flyer, START);
    for (to_m, possible) in [([5.4, 3.6, 0.7], true), ([4.8, 3.0, 3.0], false)] {
        let found = flyer.call(json!({ "call": "check", "to_m": to_m }));
        assert_eq!(found["possible"], json!(possible), "{found}");
    }
    let go = json!({ "verb": "goto", "to_m": [5.4, 3.6, 0.7], "path": { "shape": "line" }, "speed_m_s": 0.1 });
    assert_eq!(flyer.ask(go)["accepted"], "accepted");
    visitor.until_state("it flies", |state| state["mode"] == "following");
    // A visitor stops it, and the run names the page.
    let stopped = visitor.ask(plain("stop"));
    assert_eq!(stopped["accepted"], "accepted", "{stopped}");
    visitor.until_state("it holds", |state| state["mode"] == "holding");
    let known = |told: &Value| told["processes"].as_array().is_some_and(|rows| rows.len() > 3);
    visitor.until("who flies", |told| told["type"] == "robot" && told["flyer"]["name"] == "tablet" && known(told));

    // Every role stops, also one that may only look.
    let mut looker = rig.browser(Some(&rig.token("phone", "look")));
    let history = looker.until("what was before it came", |told| told["type"] == "history");
    let rows = history["rows"].as_array().unwrap();
    assert!(rows.iter().any(|row| row[1]["mode"].is_string()), "{history}");
    assert_eq!(looker.ask(plain("reset"))["reason"], 450);
    assert_eq!(looker.ask(plain("estop"))["accepted"], "accepted");
    looker.until_state("emergency stop", |state| state["mode"] == "emergency stop");

    // A token that was taken back opens nothing.
    rig.revoke("tablet");
    flyer.until_closed();
    let forged = rig.browser(Some(&"0".repeat(64)));
    assert_eq!((&forged.welcome["role"], forged.welcome["sentence"].is_string()), (&json!("stop"), true));
}

#[test]
fn a_motion_that_is_not_held_any_more_ends() {
    let rig = Rig::up();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    ready(&mut flyer, START);
    let move_on = json!({ "verb": "goto", "to_m": [5.4, 3.6, 0.7], "path": { "shape": "line" }, "speed_m_s": 0.05 });
    let jog = json!({ "verb": "jog", "cable": 1, "distance_m": -0.5 });
    // By the end of the signs, by a release, and by the end of the conversation.
    for (request, mode) in [(&move_on, "following"), (&jog, "jogging")] {
        for way in ["silence", "release", "gone"] {
            flyer.hold_until(request, mode);
            match way {
                "release" => flyer.send(&json!({ "call": "release" })),
                "gone" => flyer = rig.browser(Some(&rig.token(&format!("{mode}-tablet"), "fly"))),
                _ => {}
            }
            flyer.until_state("it holds", |state| state["mode"] == "holding");
        }
    }
    // What cannot be held is not requested, and what was refused ends nothing.
    let refused = flyer.call(json!({ "call": "held", "request": plain("disarm") }));
    assert_eq!(refused["accepted"], "bad-input");
    flyer.insist(&json!({ "call": "ask", "request": move_on }));
    flyer.until_state("it flies", |state| state["mode"] == "following");
    assert_eq!(flyer.call(json!({ "call": "held", "request": jog }))["accepted"], "refused");
    flyer.send(&json!({ "call": "release" }));
    assert_eq!(flyer.call(json!({ "call": "check", "to_m": START }))["possible"], true);
    let state = flyer.until_state("a state after that", |_| true);
    assert_eq!(state["mode"], "following");
}

#[test]
fn a_code_pairs_one_browser_and_one_person_flies_at_a_time() {
    let rig = Rig::up();
    let code = rig.code("ada", "fly");
    let mut visitor = rig.browser(None);
    let wrong = visitor.call(json!({ "call": "pair", "code": "0000-0000" }));
    assert_eq!(wrong["reason"], 481, "{wrong}");
    let paired = visitor.call(json!({ "call": "pair", "code": code.to_lowercase() }));
    let mut ada = rig.browser(paired["secret"].as_str());
    assert_eq!((&ada.welcome["user"], &ada.welcome["role"]), (&json!("ada"), &json!("fly")), "{paired}");
    let tokens = rig.page_json(&["tokens"]);
    assert_eq!((&tokens["tokens"][0]["name"], &tokens["tokens"][0]["role"]), (&json!("ada"), &json!("fly")));
    let mut bob = rig.browser(Some(&rig.token("bob", "fly")));
    ready(&mut ada, START);
    // Both see who flies, and who asks to take over; a stop is open to all.
    bob.until("who flies", |told| told["reply"] == "seat" && told["flyer"] == "ada");
    let go = json!({ "verb": "goto", "to_m": [5.4, 3.6, 0.7], "path": { "shape": "line" }, "speed_m_s": 0.1 });
    assert_eq!(bob.ask(go.clone())["reason"], 479);
    assert_eq!(ada.ask(go.clone())["accepted"], "accepted");
    assert_eq!(bob.ask(plain("stop"))["accepted"], "accepted");
    assert_eq!(bob.call(json!({ "call": "seat", "what": "ask" }))["reply"], "done");
    ada.until("who asks", |told| told["reply"] == "seat" && told["asks"] == "bob");
    assert_eq!(ada.call(json!({ "call": "seat", "what": "give" }))["reply"], "done");
    bob.until_state("it holds", |state| state["mode"] == "holding");
    assert_eq!(bob.ask(go)["accepted"], "accepted");
    assert_eq!(ada.ask(plain("resume"))["reason"], 479);
    // Wrong codes close the pairing for a time, also for the right one.
    let open = rig.code("eve", "fly");
    let reasons: Vec<Value> =
        (0..5).map(|_| visitor.call(json!({ "call": "pair", "code": "0000-0000" }))["reason"].clone()).collect();
    assert_eq!(reasons, [481, 481, 481, 481, 482]);
    assert_eq!(visitor.call(json!({ "call": "pair", "code": open }))["reason"], 482);
}

#[test]
fn one_command_starts_page_and_gateway_and_ends_with_its_parent() {
    let (printed, well) = rig::started_and_ended();
    assert!(printed.contains("http://127.0.0.1:") && well, "{printed}");
}

#[test]
fn what_comes_late_begins_and_holds_no_motion() {
    let rig = Rig::up();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    ready(&mut flyer, START);
    let jog = json!({ "verb": "jog", "cable": 1, "distance_m": -0.5 });
    // As after a connection that stood still: the press is old, or the picture by which it was made.
    for (made, seen, reason) in [(-400.0, -100.0, 478), (0.0, -1200.0, 487)] {
        let now_ms = flyer.sign()["made_ms"].as_f64().unwrap();
        let sign = json!({ "made_ms": now_ms + made, "seen_ms": now_ms + seen });
        let answer = flyer.call(json!({ "call": "held", "request": jog, "sign": sign }));
        assert_eq!((&answer["accepted"], &answer["reason"]), (&json!("refused"), &json!(reason)), "{answer}");
    }
    // Signs that come late do not hold what was begun.
    flyer.hold_until(&jog, "jogging");
    let late = flyer.sign();
    let mut mode = Value::Null;
    for _ in 0..200 {
        flyer.send(&json!({ "call": "beat", "sign": late }));
        mode = flyer.until_state("a state", |_| true)["mode"].clone();
        if mode == "holding" {
            break;
        }
    }
    assert_eq!(mode, "holding");
}

#[test]
fn a_stop_waits_for_nothing_and_the_next_motion_only_for_rest() {
    let rig = Rig::up();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    ready(&mut flyer, START);
    let go = |z: f64| json!({ "verb": "goto", "to_m": [5.4, 3.6, z], "path": { "shape": "line" }, "speed_m_s": 0.1 });
    for round in 0..10 {
        let accepted = flyer.ask(go(0.7 + 0.01 * f64::from(round)));
        assert_eq!(accepted["accepted"], "accepted", "{accepted}");
        flyer.until_state("it flies", |state| state["mode"] == "following");
        // A long text is on its way to the gateway when the stop comes.
        let text = format!("# {}\n", "x".repeat(200_000));
        flyer.send(&json!({ "call": "fly", "id": 1_000_000, "name": "long", "text": text }));
        let stopped = flyer.ask(plain("stop"));
        assert_eq!(stopped["accepted"], "accepted", "{stopped}");
        // The robot rests as soon as a state says so, and takes the next motion at once.
        flyer.until_state("it holds", |state| state["mode"] == "holding");
    }
}

#[test]
fn a_motion_that_is_asked_for_again_does_not_begin_after_the_stop_of_another() {
    let rig = Rig::up();
    let (mut flyer, mut visitor) = (rig.browser(Some(&rig.token("tablet", "fly"))), rig.browser(None));
    ready(&mut flyer, START);
    let go = |z: f64| json!({ "verb": "goto", "to_m": [5.4, 3.6, z], "path": { "shape": "line" }, "speed_m_s": 0.05 });
    // On a machine that stands still the sign of a held motion comes too late.
    let in_time = |flyer: &mut Browser, attempt: &Value| {
        let begun = Instant::now();
        loop {
            flyer.until_state("a state", |_| true);
            let answer = flyer.call(attempt.clone());
            if ![478, 487].map(Value::from).contains(&answer["reason"]) {
                return answer;
            }
            assert!(begun.elapsed() < LONG, "{answer}");
        }
    };
    for (press, stop) in [(1, "of a browser"), (3, "of the command line")] {
        flyer.insist(&json!({ "call": "ask", "request": go(0.7) }));
        flyer.until_state("it flies", |state| state["mode"] == "following");
        // As the page does after a release: it asks again until the robot rests.
        let attempts = [
            json!({ "call": "ask", "request": go(0.8), "press": press }),
            json!({ "call": "held", "request": go(0.8), "press": press }),
        ];
        for attempt in &attempts {
            let early = in_time(&mut flyer, attempt);
            assert!([203, 209].map(Value::from).contains(&early["reason"]), "{early}");
        }
        if stop == "of a browser" {
            assert_eq!(visitor.ask(plain("stop"))["accepted"], "accepted");
        } else {
            rig.command("stop");
        }
        flyer.until_state("it holds", |state| state["mode"] == "holding");
        for attempt in &attempts {
            let late = in_time(&mut flyer, attempt);
            assert_eq!(late["reason"], 474, "{stop}: {late}");
        }
        // Another press begins a motion.
        flyer.insist(&json!({ "call": "ask", "request": go(0.8), "press": press + 1 }));
        flyer.until_state("it flies", |state| state["mode"] == "following");
        assert_eq!(flyer.ask(plain("stop"))["accepted"], "accepted");
        flyer.until_state("it holds", |state| state["mode"] == "holding");
    }
}

#[test]
fn a_held_motion_ends_also_when_the_page_hangs_or_dies() {
    let rig = Rig::up();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    ready(&mut flyer, START);
    let move_on = json!({ "verb": "goto", "to_m": [5.4, 3.6, 0.7], "path": { "shape": "line" }, "speed_m_s": 0.05 });
    flyer.hold_until(&move_on, "following");
    rig.signal_page(Signal::STOP);
    rig.until_mode("holding");
    rig.signal_page(Signal::CONT);
    flyer.hold_until(&move_on, "following");
    rig.signal_page(Signal::KILL);
    rig.until_mode("holding");
}

fn http(rig: &Rig, head: &str) -> String {
    let mut stream = TcpStream::connect(&rig.address).unwrap();
    stream.write_all(head.as_bytes()).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    text
}

#[test]
fn a_stranger_gets_nothing_and_the_plain_page_stops() {
    let rig = Rig::up();
    let own = format!("Host: {}\r\nConnection: close\r\n", rig.address);
    let foreign = "Host: evil.example\r\nConnection: close\r\n";
    let status = |head: String| http(&rig, &head).lines().next().unwrap_or_default().to_owned();
    assert!(status(format!("GET /plain HTTP/1.1\r\n{own}\r\n")).contains("200"));
    assert!(status(format!("GET /plain HTTP/1.1\r\n{foreign}\r\n")).contains("421"));
    assert!(status(format!("POST /plain/estop HTTP/1.1\r\n{own}Origin: http://evil.example\r\n\r\n")).contains("403"));
    assert!(status(format!("GET /../Cargo.toml HTTP/1.1\r\n{own}\r\n")).contains("404"));
    let upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n";
    for origin in ["", "Origin: http://evil.example\r\n"] {
        let head = format!("GET /ws HTTP/1.1\r\nHost: {}\r\n{upgrade}{origin}\r\n", rig.address);
        let mut stream = TcpStream::connect(&rig.address).unwrap();
        stream.write_all(head.as_bytes()).unwrap();
        let mut line = [0; 12];
        stream.read_exact(&mut line).unwrap();
        assert_eq!(String::from_utf8_lossy(&line), "HTTP/1.1 403", "{origin}");
    }
    let page = http(&rig, &format!("GET /plain HTTP/1.1\r\n{own}\r\n"));
    assert!(page.contains("default-src 'none'") && !page.contains("<script"), "{page}");
    let mut browser = rig.browser(None);
    browser.until_state("it is up", |state| state["mode"] == "disarmed");
    let stopped = http(&rig, &format!("POST /plain/estop HTTP/1.1\r\n{own}Content-Length: 0\r\n\r\n"));
    assert!(stopped.contains("200 OK"), "{stopped}");
    browser.until_state("emergency stop", |state| state["mode"] == "emergency stop");
}

#[test]
fn a_finished_run_is_downloaded_once_for_each_time_it_is_asked_for() {
    let mut rig = Rig::up();
    let mut browser = rig.browser(None);
    browser.until_state("the robot is up", |state| state["cycle"]["number"].as_u64().is_some_and(|cycle| cycle > 50));
    let run = rig.end_robot();
    let runs = browser.call(json!({ "call": "runs" }));
    assert_eq!(runs["runs"][0]["name"], "first", "{runs}");
    let files = browser.call(json!({ "call": "files", "run": "first" }));
    let named = |name: &str| files["files"].as_array().unwrap().iter().any(|file| file["name"] == name);
    assert!(named("manifest.json") && named("run.mcap"), "{files}");
    for name in ["manifest.json", "run.mcap"] {
        let offered = browser.call(json!({ "call": "open", "run": "first", "file": name }));
        let get = format!(
            "GET {} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
            offered["path"].as_str().unwrap(),
            rig.address
        );
        let fetch = || {
            let mut stream = TcpStream::connect(&rig.address).unwrap();
            stream.write_all(get.as_bytes()).unwrap();
            let mut bytes = Vec::new();
            stream.read_to_end(&mut bytes).unwrap();
            bytes
        };
        let (bytes, written) = (fetch(), std::fs::read(run.join(name)).unwrap());
        assert!(bytes.ends_with(&written) && bytes.starts_with(b"HTTP/1.1 200"), "{name}: {} bytes", bytes.len());
        assert!(fetch().starts_with(b"HTTP/1.1 404"), "{name} a second time");
    }
    // No name leads elsewhere.
    for file in ["../../configs/systems/demo3.toml", "/etc/passwd", ""] {
        assert_eq!(browser.call(json!({ "call": "open", "run": "first", "file": file }))["reply"], "answer", "{file}");
    }
}

#[test]
fn files_of_a_run_are_made_and_shown_where_nothing_acts_and_a_run_is_deleted() {
    let mut rig = Rig::up();
    let (mut flyer, mut visitor) = (rig.browser(Some(&rig.token("tablet", "fly"))), rig.browser(None));
    visitor.until_state("the robot is up", |state| state["cycle"]["number"].as_u64().is_some_and(|cycle| cycle > 50));
    // The run that is recorded is none of the finished ones.
    let call = |call: &str| json!({ "call": call, "run": "first" });
    assert_eq!(flyer.call(call("remove"))["reason"], 461);
    let run = rig.end_robot();
    let make = json!({ "call": "make", "run": "first", "what": "report" });
    for refused in [&make, &call("remove")] {
        assert_eq!(visitor.call(refused.clone())["reason"], 450);
    }
    let runs = visitor.call(json!({ "call": "runs" }));
    assert!(runs["disk"]["free"].as_u64().is_some_and(|free| free > 0), "{runs}");
    assert_eq!(flyer.call(make)["reply"], "done");
    let figures: Value = serde_json::from_slice(&std::fs::read(run.join("report.json")).unwrap()).unwrap();
    assert!(figures["runs"][0]["verdict"]["sentence"].is_string(), "{figures}");
    // The report is shown with a policy of its own; what is no page is downloaded.
    for (file, kind, placed) in [("report.html", "text/html", "inline"), ("run.mcap", "octet-stream", "attachment")] {
        let offered = visitor.call(json!({ "call": "open", "run": "first", "file": file, "show": true }));
        let path = offered["path"].as_str().unwrap();
        let mut stream = TcpStream::connect(&rig.address).unwrap();
        let head = format!("GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", rig.address);
        stream.write_all(head.as_bytes()).unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let text = String::from_utf8_lossy(&bytes).to_ascii_lowercase();
        let head = text.split("\r\n\r\n").next().unwrap();
        assert!(head.contains("sandbox") && !head.contains("allow-") && head.contains("nosniff"), "{head}");
        assert!(head.contains(kind) && head.contains(placed), "{head}");
    }
    assert_eq!(flyer.call(call("remove"))["reply"], "done");
    assert!(!run.exists() && visitor.call(json!({ "call": "runs" }))["runs"] == json!([]));
}

#[test]
fn a_site_is_calibrated_by_the_questions_of_the_command_line() {
    let rig = Rig::up();
    let (mut flyer, mut visitor) = (rig.browser(Some(&rig.token("tablet", "fly"))), rig.browser(None));
    let step = |measurements: &str, line: Value| json!({ "call": "setup", "name": "pond", "measurements": measurements, "line": line });
    assert_eq!(visitor.call(step("", Value::Null))["accepted"], "refused");
    let first = flyer.call(step("", Value::Null));
    assert_eq!((&first["reply"], &first["open"]["kind"]), (&json!("setup"), &json!("pulleys")), "{first}");
    // Three poles, eyes, heights by tape, and the lengths of the robot in place of typed ones.
    let mut text = first["measurements"].as_str().unwrap().to_owned();
    for line in ["many", "3", "8.0", "10.0", "6.0", "l", "3", "3", "3", "", ""] {
        let next = flyer.call(step(&text, json!(line)));
        assert_eq!(next["changed"], json!(line != "many"), "{line}: {next}");
        text = next["measurements"].as_str().unwrap().to_owned();
    }
    // Without a zero the lengths of the robot mean nothing; before it is up, it has none.
    let begun = Instant::now();
    loop {
        let early = flyer.call(step(&text, json!("capture")));
        assert!(early["changed"] == false && begun.elapsed() < LONG, "{early}");
        if early["message"].as_str().unwrap().contains("nims zero") {
            break;
        }
        flyer.until_state("a state", |_| true);
    }
    ready(&mut flyer, START);
    // The lengths that the page has may be of the moment before.
    let begun = Instant::now();
    while flyer.call(step(&text, json!("capture")))["message"].as_str().unwrap().contains("nims zero") {
        assert!(begun.elapsed() < LONG, "the zero is not seen");
        flyer.until_state("a state", |_| true);
    }
    // What is no file of measurements is refused in one sentence.
    assert!(flyer.call(step("x = 1", Value::Null))["sentence"].as_str().unwrap().contains("pond.toml"));
    // Too long ones are not evaluated, and of many answers at once only the first ones.
    let long = flyer.call(step(&"#".repeat(33 << 10), Value::Null));
    assert!(long["sentence"].as_str().unwrap().contains("32 kB"), "{long}");
    let ids = 1_000..1_040_u64;
    for id in ids.clone() {
        let mut call = step(&text, Value::Null);
        call["id"] = json!(id);
        flyer.send(&call);
    }
    let own = |told: &Value| told["reply"].is_string() && told["id"].as_u64().is_some_and(|id| id >= 1_000);
    let told: Vec<Value> = ids.map(|_| flyer.until("an answer", own)).collect();
    let refused =
        told.iter().filter(|told| told["sentence"].as_str().is_some_and(|why| why.contains("being evaluated")));
    let (refused, all) = (refused.count(), told.len());
    assert!(refused > 0 && refused < all, "{refused} of {all}");
}

#[test]
fn a_node_is_weighed_by_the_currents_of_the_robot_that_goes_up_and_down() {
    let rig = Rig::up();
    let (mut flyer, mut visitor) = (rig.browser(Some(&rig.token("tablet", "fly"))), rig.browser(None));
    let weigh = |text: &str, line: Value, after_ms: Option<f64>| json!({ "call": "weigh", "measurements": text, "line": line, "after_ms": after_ms });
    assert_eq!(visitor.call(weigh("", Value::Null, None))["accepted"], "refused");
    ready(&mut flyer, START);
    let mut text = String::new();
    for (line, kind) in [("2 kg", "hang"), ("", "motion"), ("capture", "up")] {
        let begun = Instant::now();
        let mut next = flyer.call(weigh(&text, json!(line), None));
        // The place that the page has may be of the moment before.
        while next["changed"] != true {
            assert!(begun.elapsed() < LONG, "{line}: {next}");
            flyer.until_state("a state", |_| true);
            next = flyer.call(weigh(&text, json!(line), None));
        }
        assert_eq!(next["open"]["kind"], kind, "{next}");
        text = next["measurements"].as_str().unwrap().to_owned();
    }
    let since_ms = flyer.until_state("a state", |state| state["at_ms"].is_f64())["at_ms"].as_f64().unwrap();
    let unbegun = flyer.call(weigh(&text, json!("watch"), None));
    assert!(unbegun["message"].as_str().is_some_and(|why| why.contains("counting begins")), "{unbegun}");
    let early = flyer.call(weigh(&text, json!("watch"), Some(since_ms)));
    assert_eq!(early["changed"], false, "{early}");
    // As often as it takes: on a machine that stands still the page gets fewer samples of each way.
    for round in 0..12 {
        for z_m in [START[2] + 0.4, START[2]] {
            let to_m = [START[0], START[1], z_m];
            let goto = json!({ "verb": "goto", "to_m": to_m, "path": { "shape": "line" }, "speed_m_s": 0.1 });
            flyer.insist(&json!({ "call": "ask", "request": goto }));
            flyer.until_state("it moves", |state| state["mode"] == "following");
            flyer.until_state("it is there", |state| state["mode"] == "holding");
        }
        let told = flyer.call(weigh(&text, json!("watch"), Some(since_ms)));
        if told["changed"] == true {
            // Upwards the motors also overcome friction.
            let message = told["message"].as_str().unwrap();
            assert!(message.starts_with("Up ") && told["measurements"].as_str().unwrap().contains("up_a"), "{told}");
            assert_eq!(told["open"], json!({ "kind": "up", "weight": true }));
            // What moved before does not count for the next question.
            let now_ms = flyer.until_state("a state", |_| true)["at_ms"].as_f64().unwrap();
            let again = flyer.call(weigh(told["measurements"].as_str().unwrap(), json!("watch"), Some(now_ms)));
            assert_eq!(again["changed"], false, "{again}");
            return;
        }
        assert!(round < 11, "{told}");
    }
}

#[test]
fn the_charts_have_the_minutes_before_they_were_opened_and_requests_say_from_where() {
    let rig = Rig::up();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    ready(&mut flyer, START);
    let mut late = rig.browser(None);
    let asked = late.until("the request", |told| told["type"] == "request" && told["who"] == "tablet@127.0.0.1");
    assert!(asked["at_ms"].is_f64(), "{asked}");
    let series = json!({ "call": "series", "channel": "motor/state", "field": "length_m 2", "after_ms": -1.0 });
    let mut values = Vec::new();
    while values.len() < 6 {
        late.until_state("a state", |_| true);
        values = late.call(series.clone())["values"].as_array().cloned().unwrap_or_default();
    }
    assert!(values.iter().all(|value| value.as_f64().is_some_and(|m| m > 1.0)), "{values:?}");
    let fields = late.call(json!({ "call": "fields" }));
    assert!(fields["channels"]["motor/authority"].as_array().is_some_and(|names| names.contains(&json!("mode"))));
    assert_eq!(
        late.call(json!({ "call": "series", "channel": "x", "field": "y", "after_ms": 0 }))["accepted"],
        "refused"
    );
}

#[test]
fn a_browser_that_never_reads_delays_no_other_and_its_stop_counts() {
    let rig = Rig::up();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    ready(&mut flyer, START);
    let mut deaf: Vec<Browser> = (0..8).map(|_| rig.browser(None)).collect();
    // Each asks for more than the buffers between them hold, and takes none of it.
    let fields = json!({ "call": "fields", "id": 1 });
    let ask = |deaf: &mut Vec<Browser>, flyer: &mut Browser| {
        deaf.retain_mut(|browser| (0..4).all(|_| browser.try_send(&fields)));
        flyer.until_state("a state", |_| true);
    };
    (0..10).for_each(|_| ask(&mut deaf, &mut flyer));
    let go = json!({ "verb": "goto", "to_m": [5.4, 3.6, 0.7], "path": { "shape": "line" }, "speed_m_s": 0.1 });
    flyer.insist(&json!({ "call": "ask", "request": go }));
    flyer.until_state("it flies", |state| state["mode"] == "following");
    assert!(deaf[0].try_send(&json!({ "call": "ask", "id": 9, "request": { "verb": "stop" } })));
    flyer.until_state("it holds", |state| state["mode"] == "holding");
    // A conversation of which nothing is taken ends.
    let begun = Instant::now();
    while !deaf.is_empty() {
        assert!(begun.elapsed() < LONG, "{} conversations go on", deaf.len());
        ask(&mut deaf, &mut flyer);
    }
    assert!(rig.page_memory_mb() < 60.0, "{} MB", rig.page_memory_mb());
}

#[test]
fn other_machines_are_served_over_https_only() {
    let rig = Rig::up_at("0.0.0.0");
    let own = format!("Host: {}\r\nConnection: close\r\n", rig.address);
    for path in ["/", "/plain", "/ws"] {
        let answer = http(&rig, &format!("GET {path} HTTP/1.1\r\n{own}\r\n"));
        assert!(
            answer.starts_with("HTTP/1.1 307") && answer.contains(&format!("https://{}/", rig.address)),
            "{answer}"
        );
    }
    let foreign = http(&rig, "GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n");
    assert!(foreign.starts_with("HTTP/1.1 421"), "{foreign}");
}

#[test]
fn a_hostile_browser_is_bounded_and_disturbs_no_other() {
    let rig = Rig::up();
    let mut honest = rig.browser(None);
    // Nonsense is answered or ends its own conversation.
    for text in [
        "",
        "[]",
        "{\"call\":\"hello\"}",
        "{\"call\":\"token-list\",\"id\":1}",
        "{\"call\":\"ask\",\"id\":-1}",
        "\u{0}",
    ] {
        rig.browser(None).send_text(text);
    }
    // Ten thousand messages that are none, as text and as bytes, each conversation until it is ended.
    let (mut sent, mut random) = (0, 0x9e37_79b9_7f4a_7c15_u64);
    while sent < 10_000 {
        let mut wrong = rig.browser(None);
        for _ in 0..200 {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            let bytes: Vec<u8> = random.to_le_bytes().repeat(1 + random as usize % 40);
            let text = format!("{{\"call\":\"{}\"", String::from_utf8_lossy(&bytes));
            if !(if random % 50 == 0 { wrong.try_send_bytes(bytes) } else { wrong.try_send_text(&text) }) {
                break;
            }
            sent += 1;
        }
    }
    // Connections that say nothing take the places of their address, and none of a conversation.
    let idle: Vec<TcpStream> = (0..1000).filter_map(|_| TcpStream::connect(&rig.address).ok()).collect();
    assert_eq!(honest.ask(plain("hold"))["reply"], "answer");
    drop(idle);
    let mut flood = rig.browser(None);
    for _ in 0..1000 {
        if !flood.try_send(&json!({ "call": "check", "id": 1, "to_m": START })) {
            break;
        }
    }
    flood.until_closed();
    let mut long = rig.browser(None);
    long.try_send(&json!({ "call": "fly", "id": 1, "name": "x", "text": "x".repeat(1 << 20) }));
    long.until_closed();
    // More browsers than there are places for strangers, and with tokens that are none; a paired one finds another.
    let token = rig.token("late", "fly");
    let forged = "0".repeat(64);
    let mut open: Vec<Browser> = Vec::new();
    while let Some(browser) =
        rig.try_browser(Some(&forged).filter(|_| open.len().is_multiple_of(2)).map(String::as_str))
    {
        open.push(browser);
        assert!(open.len() <= 16, "no bound");
    }
    let paired = rig.try_browser(Some(&token)).expect("a place for the holder of a token");
    assert_eq!(paired.welcome["paired"], true);
    honest.until_state("the honest one goes on", |state| state["mode"] == "disarmed");
    assert_eq!(honest.ask(plain("estop"))["accepted"], "accepted");
    honest.until_state("emergency stop", |state| state["mode"] == "emergency stop");
}
