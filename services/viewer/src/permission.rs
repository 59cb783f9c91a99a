//! Who may look: the robot's user, root, and the users and groups of `look` in `[viewer]`.

use std::collections::BTreeSet;

use crate::peer::{Ends, Peer, peers_of};

/// Names of local users and groups: a directory service could block the viewer.
const USERS: &str = "/etc/passwd";
const GROUPS: &str = "/etc/group";
/// Users whose refusal is in the log; later ones are refused without a sentence.
const NAMED: usize = 64;

/// Decides who may look, and names each user who may not once in the log.
#[derive(Debug)]
pub(crate) struct Permission {
    own_uid: u32,
    /// Names and numbers of users and, after `@`, of groups.
    look: Vec<String>,
    named: BTreeSet<u32>,
    unreadable: bool,
}

impl Permission {
    /// The user of this process, root and those in `look` may.
    pub(crate) fn new(look: Vec<String>) -> Self {
        let own_uid = rustix::process::geteuid().as_raw();
        Self { own_uid, look, named: BTreeSet::new(), unreadable: false }
    }

    /// Returns for each connection whether the program at its other end may look. Another machine may: who sets another
    /// address than this machine's own permits its network.
    pub(crate) fn admit(&mut self, connections: &[Ends]) -> Vec<bool> {
        let judged = peers_of(connections).and_then(|peers| peers.into_iter().map(|peer| self.judge(peer)).collect());
        judged.unwrap_or_else(|error: std::io::Error| {
            if !std::mem::replace(&mut self.unreadable, true) {
                tracing::error!(
                    "no tool can connect, because it cannot be read who connects: {error}; /proc/net/tcp, {USERS} and \
                     {GROUPS} have to be readable"
                );
            }
            vec![false; connections.len()]
        })
    }

    fn judge(&mut self, peer: Peer) -> std::io::Result<bool> {
        let uid = match peer {
            Peer::Remote => return Ok(true),
            Peer::Gone => return Ok(false),
            Peer::Local(uid) => uid,
        };
        if uid == self.own_uid || uid == 0 {
            return Ok(true);
        }
        let read = std::fs::read_to_string;
        let (name, listed) = find(uid, &self.look, &read(USERS)?, &read(GROUPS)?);
        if !listed && self.named.len() < NAMED && self.named.insert(uid) {
            tracing::warn!(
                "the user {name} of this machine tried to look at the robot and was refused; permitted are this \
                 process's user, root, and [viewer] look = {:?}: add the user there, or to one of its groups",
                self.look
            );
        }
        Ok(listed)
    }
}

/// Returns the name of a user, and whether an entry lists the user or a group of the user. passwd(5):
/// `name:password:UID:GID:...`; group(5): `name:password:GID:user,user,...`.
fn find(uid: u32, look: &[String], users: &str, groups: &str) -> (String, bool) {
    let user = users.lines().find_map(|line| {
        let fields: Vec<&str> = line.split(':').collect();
        let [name, _, number, group, ..] = fields[..] else { return None };
        (number.parse() == Ok(uid)).then(|| (name.to_owned(), group.parse::<u32>().ok()))
    });
    let (name, primary) = user.unwrap_or_else(|| (uid.to_string(), None));
    let mut names = BTreeSet::from([name.clone(), uid.to_string()]);
    names.extend(primary.map(|gid| format!("@{gid}")));
    for line in groups.lines() {
        let fields: Vec<&str> = line.split(':').collect();
        let [group, _, number, members] = fields[..] else { continue };
        let Ok(gid) = number.parse::<u32>() else { continue };
        if primary == Some(gid) || members.split(',').any(|member| member == name) {
            names.extend([format!("@{group}"), format!("@{gid}")]);
        }
    }
    let listed = look.iter().any(|entry| names.contains(entry));
    (name, listed)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PASSWD: &str = "root:x:0:0:root:/root:/bin/bash\nbroken\nada:x:1000:100::/home/ada:/bin/sh\n\
                          bob:x:1001:990::/home/bob:/bin/sh\n";
    const GROUP: &str = "root:x:0:\nusers:x:100:\nnims-operators:x:990:eve,ada\nother:x:991:adamant\nbad:x:y:ada\n";

    fn listed(uid: u32, look: &str) -> bool {
        find(uid, &[look.to_owned()], PASSWD, GROUP).1
    }

    #[test]
    fn users_and_groups_are_listed_by_name_or_number() {
        for look in ["ada", "1000", "@users", "@100", "@nims-operators", "@990"] {
            assert!(listed(1000, look), "{look}");
            assert!(!listed(1002, look), "{look}");
        }
        for look in ["bob", "eve", "@other", "@991", "nims-operators", "@ada", "@1000", "@bad", "", "@", "100"] {
            assert!(!listed(1000, look), "{look}");
        }
        assert!(listed(1001, "@nims-operators"), "as the own group");
        assert_eq!(find(4242, &[], PASSWD, GROUP), ("4242".to_owned(), false));
    }

    #[test]
    fn the_own_user_root_and_other_machines_may_and_each_stranger_is_named_once() {
        let mut permission = Permission::new(Vec::new());
        let own = permission.own_uid;
        for peer in [Peer::Local(own), Peer::Local(0), Peer::Remote] {
            assert!(permission.judge(peer).unwrap(), "{peer:?}");
        }
        assert!(!permission.judge(Peer::Gone).unwrap());
        for stranger in (4_000_000..4_000_100).chain([4_000_000]) {
            assert!(!permission.judge(Peer::Local(stranger)).unwrap());
        }
        assert_eq!(permission.named.len(), NAMED);
    }
}
