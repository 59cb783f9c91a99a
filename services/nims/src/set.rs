//! `nims set`: another value of a parameter while the robot runs.

use command::{Answer, Failure, Output};

use bus::{Bus, Subscriber, clock};
use commissioning::check;
use config::{EstimatorSection, RobotFile, Role, Slot, SystemFile, TUNABLE, Tuned};
use controller::ControllerConfig;
use estimator::EstimatorConfig;
use messages::{ProcessState, Request, SystemConfig, text_of};
use runtime::TUNED_CHANNEL;
use serde_json::json;
use std::collections::BTreeMap;
use std::time::Duration;

/// `nims set`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Which parameter, as in the system file, e.g. controller.length_gain_per_s; default: all, to be shown.
    pub key: Option<String>,
    /// Its new value, written as in the system file.
    #[arg(allow_hyphen_values = true)]
    pub value: Option<String>,
}

/// How long a process may take to say that it has taken a change up, ns: it is announced a tenth of a second ahead.
const TAKEN_NS: u64 = 5_000_000_000;
/// The parameter of which `nims check` warns where it does not fit the drives.
const HORIZON: &str = "controller.horizon_cycles";
/// The process table comes once a second; a stall of the machine may come between, ns.
const TABLE_NS: u64 = 1_500_000_000;
/// How long the supervisor may take to say what is set.
const SAID: Duration = Duration::from_secs(1);

/// The parameters that can be set, as the help shows them and `docs/tuning.md` has them.
#[must_use]
pub fn table() -> String {
    let rows = TUNABLE.iter().map(|one| format!("  {:<36} {:<30} {}\n", one.key, one.accepted, one.what));
    rows.collect()
}

/// The help behind the arguments.
#[must_use]
pub fn help() -> String {
    format!("Parameters, and the values that they take:\n{}", table())
}

/// Sets, shows one, or shows all.
///
/// # Errors
/// Refused, with the reason, or a process does not take it up.
pub fn set(domain: Option<&str>, asked: &Args) -> Answer<Output> {
    let bus = client::join(domain)?;
    let Some(key) = &asked.key else { return show(&bus, None) };
    let Some(value) = &asked.value else { return show(&bus, Some(key)) };
    let mut followers = followers(&bus, key)?;
    let (before, after, robot) = changed(&bus, key, value)?;
    let request = Request::Set { key: key.clone(), value: value.clone() };
    let sentence = client::send(&bus, client::SUPERVISOR, &request)?;
    let said = client::newest::<SystemConfig>(&bus, TUNED_CHANNEL, SAID)?.unwrap_or_default();
    follow(&bus, &mut followers, said.changes)?;
    let sentence = format!("{sentence}{}", remarks(&bus, key, &before, &after, &robot)?);
    let value = json!({ "accepted": true, "answer": sentence, "key": key, "changes": said.changes,
        "from_cycle": said.from_cycle, "taken_up_by": followers.iter().map(|one| &one.name).collect::<Vec<_>>() });
    Ok(Output::new(value, format!("{sentence}.")))
}

/// The system as it is and with the change; refused where a law or a method cannot work with it.
fn changed(bus: &Bus, key: &str, value: &str) -> Answer<(SystemFile, SystemFile, RobotFile)> {
    let begun = client::box_of(bus)?;
    let robot = begun.robot_file().map_err(Failure::not_now)?;
    let said = client::newest::<SystemConfig>(bus, TUNED_CHANNEL, SAID)?.unwrap_or_default();
    let tuned = Tuned::parse(&text_of(&said.parameters)).map_err(Failure::NotNow)?;
    let before = begun.tuned(&robot, &tuned).map_err(Failure::NotNow)?;
    let after = tuned.with(key, value).and_then(|tuned| begun.tuned(&robot, &tuned)).map_err(Failure::BadInput)?;
    check::chain_can_be_built(&after, &robot)?;
    Ok((before, after, robot))
}

/// What else there is to know about a change: laws that do not use it, and a horizon that does not fit the drives.
fn remarks(bus: &Bus, key: &str, before: &SystemFile, after: &SystemFile, robot: &RobotFile) -> Answer<String> {
    let role = key.split('.').next().unwrap_or_default();
    let mut idle: Vec<String> = Vec::new();
    for law in laws_of(bus, role)? {
        idle.extend(
            unchanged(role, &law, before, after, robot)
                .into_iter()
                .filter(|law| !idle.contains(law))
                .collect::<Vec<_>>(),
        );
    }
    let idle = if idle.is_empty() { String::new() } else { format!("; {} does not use it", idle.join(" or ")) };
    let warning = check::horizon(after).filter(|_| key == HORIZON);
    let warning = warning.map_or(String::new(), |found| format!("; warning: {}; {}", found.finding, found.cure));
    Ok(idle + &warning)
}

/// The laws or methods of a role's processes by the process table; empty for one that is as configured.
fn laws_of(bus: &Bus, role: &str) -> Answer<Vec<String>> {
    let mut rows = bus.subscriber::<ProcessState>("system/process")?;
    let alive = bus.domain().alive();
    let (mut laws, give_up) = (BTreeMap::new(), clock::now_ns() + TABLE_NS);
    let missing = |laws: &BTreeMap<String, String>| {
        let names =
            role_of(role).map(|role| [Slot::A, Slot::B].map(|slot| role.process_name(slot))).unwrap_or_default();
        alive.iter().any(|node| names.contains(&node.name) && !laws.contains_key(&node.name))
    };
    while missing(&laws) && clock::now_ns() < give_up {
        while let Some(row) = rows.receive()? {
            if row.pid != 0 && text_of(&row.role) == role {
                laws.insert(text_of(&row.name), text_of(&row.law));
            }
        }
        clock::sleep_until(clock::now_ns() + 10_000_000);
    }
    Ok(laws.into_values().collect())
}

fn role_of(name: &str) -> Option<Role> {
    [Role::Controller, Role::Estimator].into_iter().find(|role| role.name() == name)
}

/// The law or method of a process, where it is the same with the change as without it. What a program of one's own uses is not known.
fn unchanged(role: &str, law: &str, before: &SystemFile, after: &SystemFile, robot: &RobotFile) -> Option<String> {
    match role {
        "controller" => {
            let law = if law.is_empty() { before.controller.law } else { law.parse().ok()? };
            let config = |file: &SystemFile| {
                let mut file = file.clone();
                file.controller.law = law;
                ControllerConfig::of(&file, robot, 1).ok()
            };
            (config(before).is_some() && config(before) == config(after)).then(|| law.name().to_owned())
        }
        "estimator" => {
            let method = if law.is_empty() { before.estimator.method } else { law.parse().ok()? };
            let config = |file: &SystemFile| {
                let section = EstimatorSection { method, ..file.estimator.clone() };
                EstimatorConfig::of(&section, robot.robot().ok()?, 1).ok()
            };
            (config(before).is_some() && config(before) == config(after)).then(|| method.name().to_owned())
        }
        _ => None,
    }
}

/// A process that has to take the change up.
struct Follower {
    name: String,
    said: Subscriber<SystemConfig>,
    changes: u32,
}

/// The processes of the parameter's role that run.
fn followers(bus: &Bus, key: &str) -> Answer<Vec<Follower>> {
    let roles = [Role::Controller, Role::Estimator].into_iter();
    let alive: Vec<String> = bus.domain().alive().into_iter().map(|node| node.name).collect();
    let mut followers = Vec::new();
    for role in roles.filter(|role| key.split('.').next() == Some(role.name())) {
        for name in [Slot::A, Slot::B].map(|slot| role.process_name(slot)) {
            if alive.contains(&name) {
                let said = bus.subscriber(&format!("system/config/{name}"))?;
                followers.push(Follower { name, said, changes: 0 });
            }
        }
    }
    Ok(followers)
}

/// Waits until each says that it works with this change. One that has ended meanwhile will begin with it.
fn follow(bus: &Bus, followers: &mut [Follower], changes: u32) -> Answer {
    let give_up = clock::now_ns() + TAKEN_NS;
    loop {
        for one in followers.iter_mut() {
            one.changes = one.said.latest()?.map_or(one.changes, |said| said.changes);
        }
        let late: Vec<&str> =
            followers.iter().filter(|one| one.changes < changes).map(|one| one.name.as_str()).collect();
        if late.is_empty() {
            return Ok(());
        }
        if clock::now_ns() >= give_up {
            let alive: Vec<String> = bus.domain().alive().into_iter().map(|node| node.name).collect();
            let late: Vec<&str> = late.into_iter().filter(|name| alive.iter().any(|one| one == name)).collect();
            if late.is_empty() {
                return Ok(());
            }
            return Err(Failure::NotNow(format!(
                "it is set, but {} has not taken it up: look at its log, or start it again with `nims restart`",
                late.join(", ")
            )));
        }
        clock::sleep_until(clock::now_ns() + 10_000_000);
    }
}

/// What the parameters are now.
fn show(bus: &Bus, key: Option<&str>) -> Answer<Output> {
    let begun = client::box_of(bus)?;
    let robot: RobotFile = begun.robot_file().map_err(Failure::not_now)?;
    let said = client::newest::<SystemConfig>(bus, TUNED_CHANNEL, SAID)?.unwrap_or_default();
    let tuned = Tuned::parse(&text_of(&said.parameters)).map_err(Failure::NotNow)?;
    let file: SystemFile = begun.tuned(&robot, &tuned).map_err(Failure::NotNow)?;
    if let Some(key) = key {
        // The reason why not, in the words of a change.
        tuned.with(key, "0").map_err(Failure::BadInput)?;
    }
    let (mut value, mut lines) = (json!({}), Vec::new());
    for one in TUNABLE.iter().filter(|one| key.is_none_or(|key| key == one.key)) {
        let (was, is) = (begun.value_of(one.key), file.value_of(one.key));
        let shown = |value: &str| if value.is_empty() { "not given".to_owned() } else { value.to_owned() };
        let set = if was == is { String::new() } else { format!("  (set; the file says {})", shown(&was)) };
        lines.push(format!("{:<36} {:<12} {}{set}", one.key, shown(&is), one.what));
        value[one.key] = json!({ "value": is, "file": was, "accepted": one.accepted });
    }
    Ok(Output::new(value, lines.join("\n")))
}
