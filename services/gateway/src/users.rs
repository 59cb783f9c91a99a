//! Names of local users and their groups, from the files of the system: a directory service could block the gateway.

use crate::plugin::PluginUnit;
use crate::roles::Peer;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use rustix::time::Timespec;
use std::path::Path;

/// Reads the names for the credentials that the kernel states.
///
/// # Errors
/// The files cannot be read: without them, a user who may only look could get the role of a group.
pub fn peer_of(uid: u32, gid: u32, pid: u32) -> std::io::Result<Peer> {
    let read = |path: &str| std::fs::read_to_string(Path::new(path));
    let unit = plugin_unit_of(uid, pid);
    Ok(Peer { unit, ..described(uid, gid, pid, &read("/etc/passwd")?, &read("/etc/group")?) })
}

/// The unit of the plug-in that has connected. `None` also where its process has ended already: then it is no plug-in.
/// Each unit has a user of its own, so that another process that got the number in between is recognized by its user.
fn plugin_unit_of(uid: u32, pid: u32) -> Option<PluginUnit> {
    let process = pidfd_open(Pid::from_raw(i32::try_from(pid).ok()?)?, PidfdFlags::empty()).ok()?;
    let unit = PluginUnit::of_groups(&std::fs::read_to_string(format!("/proc/{pid}/cgroup")).ok()?)?;
    let is_its_user = user_of(&std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?) == Some(uid);
    // Readable once the process has ended.
    let now = Timespec { tv_sec: 0, tv_nsec: 0 };
    let lives = poll(&mut [PollFd::new(&process, PollFlags::IN)], Some(&now)) == Ok(0);
    (is_its_user && lives).then_some(unit)
}

/// The effective user in `/proc/PID/status`.
fn user_of(status: &str) -> Option<u32> {
    let line = status.lines().find_map(|line| line.strip_prefix("Uid:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// passwd(5): `name:password:UID:GID:...`; group(5): `name:password:GID:user,user,...`.
fn described(uid: u32, gid: u32, pid: u32, users: &str, groups: &str) -> Peer {
    let user = users.lines().find_map(|line| {
        let fields: Vec<&str> = line.split(':').collect();
        let [name, _, number, group, ..] = fields[..] else { return None };
        (number.parse() == Ok(uid)).then(|| (name.to_owned(), group.parse().ok()))
    });
    let (name, primary): (String, Option<u32>) = user.unwrap_or_else(|| (uid.to_string(), None));
    let mut peer = Peer { uid, gid, pid, user: name, groups: Vec::new(), gids: vec![gid], unit: None };
    peer.gids.extend(primary.filter(|primary| *primary != gid));
    for line in groups.lines() {
        let fields: Vec<&str> = line.split(':').collect();
        let [group, _, number, members] = fields[..] else { continue };
        let Ok(number) = number.parse() else { continue };
        if peer.gids.contains(&number) || members.split(',').any(|member| member == peer.user) {
            peer.groups.push(group.to_owned());
            if !peer.gids.contains(&number) {
                peer.gids.push(number);
            }
        }
    }
    peer
}

#[cfg(test)]
mod tests {
    use super::*;

    const USERS: &str = "root:x:0:0:root:/root:/bin/bash\nbroken\nada:x:1000:100::/home/ada:/bin/sh\n";
    const GROUPS: &str = "root:x:0:\nusers:x:100:\nnims-operators:x:990:bob,ada\nother:x:991:adamant\nbad:x:y:ada\n";

    #[test]
    fn this_test_is_no_plug_in_and_has_its_own_user() {
        let own = std::fs::read_to_string("/proc/self/status").unwrap();
        assert_eq!(user_of(&own), Some(rustix::process::geteuid().as_raw()));
        assert_eq!(user_of("Uid:\t1\t2\t3\t4\n"), Some(2));
        assert_eq!((user_of(""), user_of("Uid:\n"), user_of("Uid: a b")), (None, None, None));
        assert_eq!(peer_of(1, 1, std::process::id()).unwrap().unit, None);
    }

    #[test]
    fn a_user_has_its_own_groups_and_that_of_the_process() {
        let ada = described(1000, 100, 7, USERS, GROUPS);
        assert_eq!((ada.user.as_str(), ada.pid), ("ada", 7));
        assert_eq!(ada.groups, ["users", "nims-operators"]);
        // A process that was started in another group, e.g. by `sg`.
        assert_eq!(described(1000, 991, 7, USERS, GROUPS).groups, ["users", "nims-operators", "other"]);
        let unknown = described(4242, 4242, 7, USERS, GROUPS);
        assert_eq!((unknown.user.as_str(), unknown.groups.len(), unknown.gids), ("4242", 0, vec![4242]));
    }
}
