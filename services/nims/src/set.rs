//! `nims set`: shows and changes parameters while the robot runs.

use command::{Answer, Failure, Output};

use bus::clock;
use client::{Place, RobotLink, Samples};
use commissioning::check;
use config::{EstimatorSection, RobotFile, Role, SystemFile, Tuned};
use controller::ControllerConfig;
use estimator::EstimatorConfig;
use messages::{ProcessState, Request, Slot, SystemConfig, text_of};
use motor_box::MotorBoxSection;
use runtime::TUNED_CHANNEL;
use serde_json::json;
use std::collections::BTreeMap;
use std::time::Duration;

/// `nims set`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Parameter, as in the system file, e.g. controller.length_gain_per_s; default: show all.
    pub key: Option<String>,
    /// New value, written as in the system file; default: show the value.
    #[arg(allow_hyphen_values = true)]
    pub value: Option<String>,
}

/// Longest time in which a process applies a change, ns; the supervisor announces a change 0.1 s before it takes
/// effect.
const APPLY_NS: u64 = 5_000_000_000;
/// The parameter for which `nims check` warns if it does not suit the drives.
const HORIZON: &str = "controller.horizon_cycles";
/// Longest time to wait for the process table, ns: it is published once a second, and the machine may stall.
const TABLE_NS: u64 = 1_500_000_000;
/// Longest time to wait for the supervisor's sample of the set parameters.
const TUNED_TIMEOUT: Duration = Duration::from_secs(1);

/// Returns the table of parameters that can be set, for the help; `docs/tuning.md` has the same.
#[must_use]
pub fn table() -> String {
    let rows =
        config::tunable().map(|one| format!("  {:<36} {:<30} {}\n", one.key, one.accepted.to_string(), one.what));
    rows.collect()
}

/// Returns the help text after the arguments.
#[must_use]
pub fn help() -> String {
    format!("Parameters and their accepted values:\n{}", table())
}

/// Sets one parameter, shows one, or shows all.
///
/// # Errors
/// The change is refused, with the reason, or a process does not apply it in time.
pub fn set(place: Place<'_>, args: &Args) -> Answer<Output> {
    let link = client::link(place)?;
    let Some(key) = &args.key else { return show(&link, None) };
    let Some(value) = &args.value else { return show(&link, Some(key)) };
    let mut followers = followers(&link, key)?;
    let (before, after, robot) = changed(&link, key, value)?;
    let request = Request::Set { key: key.clone(), value: value.clone() };
    let sentence = client::send(&link, client::SUPERVISOR, &request)?;
    let published = client::newest::<SystemConfig>(&link, TUNED_CHANNEL, TUNED_TIMEOUT)?.unwrap_or_default();
    follow(&link, &mut followers, published.changes)?;
    let sentence = format!("{sentence}{}", remarks(&link, key, &before, &after, &robot)?);
    let value = json!({ "accepted": true, "answer": sentence, "key": key, "changes": published.changes,
        "from_cycle": published.from_cycle, "taken_up_by": followers.iter().map(|one| &one.name).collect::<Vec<_>>() });
    Ok(Output::new(value, format!("{sentence}.")))
}

/// Returns the configuration before and after the change, and the robot file.
///
/// # Errors
/// The value is out of range, or a law or method does not work with it.
fn changed(link: &RobotLink, key: &str, value: &str) -> Answer<(SystemFile, SystemFile, RobotFile)> {
    let file = client::system_of(link)?;
    let robot = file.robot_file().map_err(Failure::not_now)?;
    let published = client::newest::<SystemConfig>(link, TUNED_CHANNEL, TUNED_TIMEOUT)?.unwrap_or_default();
    let tuned = Tuned::parse(&text_of(&published.parameters)).map_err(Failure::NotNow)?;
    let before = file.tuned(&robot, &tuned).map_err(Failure::NotNow)?;
    let after = tuned.with(key, value).and_then(|tuned| file.tuned(&robot, &tuned)).map_err(Failure::BadInput)?;
    check::chain_can_be_built(&after, &robot)?;
    Ok((before, after, robot))
}

/// Returns remarks on a change: running laws that do not use the parameter, and a warning about a horizon that does not
/// suit the drives.
fn remarks(link: &RobotLink, key: &str, before: &SystemFile, after: &SystemFile, robot: &RobotFile) -> Answer<String> {
    let role = key.split('.').next().unwrap_or_default();
    let mut idle: Vec<String> = Vec::new();
    for law in laws_of(link, role)? {
        idle.extend(
            unchanged(role, &law, before, after, robot)
                .into_iter()
                .filter(|law| !idle.contains(law))
                .collect::<Vec<_>>(),
        );
    }
    let idle = if idle.is_empty() { String::new() } else { format!("; {} does not use it", idle.join(" or ")) };
    let drives = MotorBoxSection::from_file(&client::true_system_of(link)?, robot).map_err(Failure::not_now)?;
    let warning = drives.and_then(|drives| check::horizon(after, &drives)).filter(|_| key == HORIZON);
    let warning = warning.map_or(String::new(), |found| format!("; warning: {}; {}", found.finding, found.cure));
    Ok(idle + &warning)
}

/// Returns the law or method of each running process of a role, from the process table; an empty string means "as
/// configured".
fn laws_of(link: &RobotLink, role: &str) -> Answer<Vec<String>> {
    let mut rows = link.subscriber::<ProcessState>("system/process")?;
    let alive = link.alive()?;
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

/// Returns the name of the law or method if the change does not alter its configuration. `None` also for custom
/// programs, whose parameters are unknown.
fn unchanged(role: &str, law: &str, before: &SystemFile, after: &SystemFile, robot: &RobotFile) -> Option<String> {
    match role {
        "controller" => {
            let law = if law.is_empty() { before.controller.law } else { law.parse().ok()? };
            let config = |file: &SystemFile| {
                let mut file = file.clone();
                file.controller.law = law;
                ControllerConfig::from_files(&file, robot, 1).ok()
            };
            (config(before).is_some() && config(before) == config(after)).then(|| law.name().to_owned())
        }
        "estimator" => {
            let method = if law.is_empty() { before.estimator.method } else { law.parse().ok()? };
            let config = |file: &SystemFile| {
                let section = EstimatorSection { method, ..file.estimator };
                EstimatorConfig::from_section(&section, robot.robot().ok()?, 1).ok()
            };
            (config(before).is_some() && config(before) == config(after)).then(|| method.name().to_owned())
        }
        _ => None,
    }
}

/// A running process that has to apply the change.
struct Follower {
    name: String,
    config: Samples<SystemConfig>,
    /// Number of changes that it has applied.
    changes: u32,
}

/// Returns the running processes of the parameter's role.
fn followers(link: &RobotLink, key: &str) -> Answer<Vec<Follower>> {
    let roles = [Role::Controller, Role::Estimator].into_iter();
    let alive: Vec<String> = link.alive()?.into_iter().map(|node| node.name).collect();
    let mut followers = Vec::new();
    for role in roles.filter(|role| key.split('.').next() == Some(role.name())) {
        for name in [Slot::A, Slot::B].map(|slot| role.process_name(slot)) {
            if alive.contains(&name) {
                let config = link.subscriber(&format!("system/config/{name}"))?;
                followers.push(Follower { name, config, changes: 0 });
            }
        }
    }
    Ok(followers)
}

/// Waits until each process reports that it has applied the change. Processes that have ended are ignored: they start
/// with it.
fn follow(link: &RobotLink, followers: &mut [Follower], changes: u32) -> Answer {
    let give_up = clock::now_ns() + APPLY_NS;
    loop {
        for one in followers.iter_mut() {
            one.changes = one.config.latest()?.map_or(one.changes, |config| config.changes);
        }
        let late: Vec<&str> =
            followers.iter().filter(|one| one.changes < changes).map(|one| one.name.as_str()).collect();
        if late.is_empty() {
            return Ok(());
        }
        if clock::now_ns() >= give_up {
            let alive: Vec<String> = link.alive()?.into_iter().map(|node| node.name).collect();
            let late: Vec<&str> = late.into_iter().filter(|name| alive.iter().any(|one| one == name)).collect();
            if late.is_empty() {
                return Ok(());
            }
            return Err(Failure::NotNow(format!(
                "the parameter is set, but {} has not applied it: see its log, or restart it with `nims restart`",
                late.join(", ")
            )));
        }
        clock::sleep_until(clock::now_ns() + 10_000_000);
    }
}

/// Shows the current values of one parameter or of all.
fn show(link: &RobotLink, key: Option<&str>) -> Answer<Output> {
    let file = client::system_of(link)?;
    let robot: RobotFile = file.robot_file().map_err(Failure::not_now)?;
    let published = client::newest::<SystemConfig>(link, TUNED_CHANNEL, TUNED_TIMEOUT)?.unwrap_or_default();
    let tuned = Tuned::parse(&text_of(&published.parameters)).map_err(Failure::NotNow)?;
    let current: SystemFile = file.tuned(&robot, &tuned).map_err(Failure::NotNow)?;
    if let Some(key) = key {
        // Report an unknown key in the same words as a change would.
        tuned.with(key, "0").map_err(Failure::BadInput)?;
    }
    let (mut value, mut lines) = (json!({}), Vec::new());
    for one in config::tunable().filter(|one| key.is_none_or(|key| key == one.key)) {
        let (was, is) = (file.value_of(&one.key), current.value_of(&one.key));
        let shown = |value: &str| if value.is_empty() { "not given".to_owned() } else { value.to_owned() };
        let set = if was == is { String::new() } else { format!("  (set; {} in the file)", shown(&was)) };
        lines.push(format!("{:<36} {:<12} {}{set}", one.key, shown(&is), one.what));
        value[&one.key] = json!({ "value": is, "file": was, "accepted": one.accepted.to_string() });
    }
    Ok(Output::new(value, lines.join("\n")))
}
