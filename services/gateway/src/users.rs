//! Names of local users and their groups, from the files of the system: a directory service could block the gateway.

use crate::roles::Peer;
use std::path::Path;

/// Reads the names for the credentials that the kernel states.
///
/// # Errors
/// The files cannot be read: without them, a user who may only look could get the role of a group.
pub fn peer_of(uid: u32, gid: u32, pid: u32) -> std::io::Result<Peer> {
    let read = |path: &str| std::fs::read_to_string(Path::new(path));
    Ok(described(uid, gid, pid, &read("/etc/passwd")?, &read("/etc/group")?))
}

/// passwd(5): `name:password:UID:GID:...`; group(5): `name:password:GID:user,user,...`.
fn described(uid: u32, gid: u32, pid: u32, users: &str, groups: &str) -> Peer {
    let user = users.lines().find_map(|line| {
        let fields: Vec<&str> = line.split(':').collect();
        let [name, _, number, group, ..] = fields[..] else { return None };
        (number.parse() == Ok(uid)).then(|| (name.to_owned(), group.parse().ok()))
    });
    let (name, primary): (String, Option<u32>) = user.unwrap_or_else(|| (uid.to_string(), None));
    let mut peer = Peer { uid, gid, pid, user: name, groups: Vec::new(), gids: vec![gid] };
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
