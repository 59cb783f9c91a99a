//! The right of the robot's user to start plug-ins: the rule of polkit, and the files it relies on.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn host(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("configs/host").join(name)
}

/// Evaluates the rule as polkit does, for each `user action verb unit`; what it asks `polkit.spawn` is in the answer.
/// Only `nims-plugin@lab_soil` and `nims-plugin-network@lab_air` are declared.
const POLKIT: &str = r#"
const fs = require("fs");
let rule, asked;
const polkit = {
    Result: { YES: "yes", NO: "no", NOT_HANDLED: null },
    addRule: (one) => { rule = one; },
    spawn: (words) => {
        asked = words.join(" ");
        if (!/--declared (nims-plugin@lab_soil|nims-plugin-network@lab_air)$/.test(asked)) throw new Error("not declared");
    },
};
new Function("polkit", fs.readFileSync(process.argv[1], "utf8"))(polkit);
for (const line of process.argv.slice(2)) {
    const [user, id, verb, unit] = line.split(" ");
    asked = "nothing";
    const lookup = (key) => ({ verb: verb === "-" ? undefined : verb, unit: unit === "-" ? undefined : unit })[key];
    console.log(`${rule({ id, lookup }, { user })}, asked ${asked}`);
}
"#;

#[test]
fn polkit_lets_the_robots_user_start_declared_plug_ins_and_nothing_else() {
    const UNITS: &str = "org.freedesktop.systemd1.manage-units";
    let soil = "nims-plugin@lab_soil";
    let mut cases: Vec<(String, String)> = Vec::new();
    for verb in ["start", "stop", "restart"] {
        for unit in [soil, "nims-plugin-network@lab_air"] {
            let asked = format!("yes, asked /opt/nims/current/bin/nims-plugin --declared {unit}");
            cases.push((format!("nims {UNITS} {verb} {unit}.service"), asked));
        }
        // Declared, but for the other template; not declared; of another robot.
        for unit in
            ["nims-plugin-network@lab_soil", "nims-plugin@lab_air", "nims-plugin@lab_shell", "nims-plugin@x_soil"]
        {
            let asked = format!("no, asked /opt/nims/current/bin/nims-plugin --declared {unit}");
            cases.push((format!("nims {UNITS} {verb} {unit}.service"), asked));
        }
        for unit in [
            "-",
            "ssh.service",
            "nims@lab.service",
            "nims-gateway@lab.service",
            "nims-plugin@lab.service",
            "nims-plugin@lab_soil.socket",
            "nims-plugin@lab_soil.service.d",
            "nims-plugin@lab_../soil.service",
            "nims-plugin@lab_so:il.service",
            "xnims-plugin@lab_soil.service",
            "nims-plugin-other@lab_soil.service",
        ] {
            cases.push((format!("nims {UNITS} {verb} {unit}"), "null, asked nothing".to_owned()));
        }
        cases.push((format!("ada {UNITS} {verb} {soil}.service"), "null, asked nothing".to_owned()));
    }
    for verb in ["-", "reload", "kill", "set-property", "reset-failed", "clean", "freeze", "mount-image", "ref", ""] {
        cases.push((format!("nims {UNITS} {verb} {soil}.service"), "null, asked nothing".to_owned()));
    }
    for action in ["org.freedesktop.systemd1.manage-unit-files", "org.freedesktop.systemd1.reload-daemon", "x"] {
        cases.push((format!("nims {action} start {soil}.service"), "null, asked nothing".to_owned()));
    }
    let mut node = Command::new("node");
    node.args(["-e", POLKIT]).arg(host("polkit.rules")).args(cases.iter().map(|(case, _)| case));
    let Ok(output) = node.output() else {
        return notes::left_out("the rule of polkit", "there is no node, which evaluates it");
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let found: Vec<&str> = said.lines().collect();
    assert_eq!(found.len(), cases.len());
    for ((case, expected), found) in cases.iter().zip(found) {
        assert_eq!(found, expected, "{case}");
    }
}

/// The rule names what only the files of the templates confine, so neither is installed without the other.
#[test]
fn the_rule_and_both_templates_are_installed_together() {
    let list = fs::read_to_string(host("files")).unwrap();
    let row = |source: &str, to: &str| {
        let found = list.lines().any(|line| {
            let fields: Vec<&str> = line.split_whitespace().collect();
            // Without `?`: a missing one ends the installation before its first file.
            fields[..] == ["0644", &format!("configs/host/{source}"), to]
        });
        assert!(found, "configs/host/files puts no {source} to {to}");
    };
    let units = "/usr/lib/systemd/system/";
    row("polkit.rules", "/usr/share/polkit-1/rules.d/60-nims.rules");
    row("nims-plugin@.service", units);
    row("nims-plugin@.service", &format!("{units}nims-plugin-network@.service"));
    row("nims-plugin-network.conf", &format!("{units}nims-plugin-network@.service.d/"));
    let script = fs::read_to_string(host("nims-plugin")).unwrap();
    assert!(script.contains(&format!("\"{units}$template@.service\"")), "nims-plugin --declared looks elsewhere");
    // What no plug-in has, and what only one with a declared network has.
    let template = fs::read_to_string(host("nims-plugin@.service")).unwrap();
    for line in [
        "DynamicUser=yes",
        "User=_%i",
        "PrivateNetwork=yes",
        "PrivateDevices=yes",
        "CapabilityBoundingSet=",
        "NoNewPrivileges=yes",
        "RestrictAddressFamilies=AF_UNIX",
        "ProtectControlGroups=yes",
        "ProtectProc=invisible",
    ] {
        assert!(template.lines().any(|one| one == line), "nims-plugin@.service lacks {line}");
    }
    assert!(!template.contains("Delegate="), "a plug-in can leave its group");
    let network = fs::read_to_string(host("nims-plugin-network.conf")).unwrap();
    let keys: Vec<&str> = network.lines().filter_map(|line| line.split_once('=')).map(|(key, _)| key).collect();
    assert_eq!(keys, ["# A plug-in whose [[plugin]] has `network ", "PrivateNetwork", "RestrictAddressFamilies"]);
}

fn nims_plugin(words: &[&str]) -> Output {
    Command::new("sh").arg(host("nims-plugin")).args(words).output().unwrap()
}

#[test]
fn a_name_that_is_no_unit_of_a_plug_in_is_refused_before_anything_is_read() {
    for word in [
        "",
        "lab_soil",
        "nims-plugin@lab",
        "nims-plugin@_soil",
        "nims-plugin@lab_",
        "nims-plugin@../x_soil",
        "nims@lab_soil",
        "nims-plugin@lab_a b",
    ] {
        for words in [&["--declared", word][..], &[word]] {
            let output = nims_plugin(words);
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.code() == Some(2) && said.starts_with("nims-plugin: "), "{words:?}: {said}");
        }
    }
}
