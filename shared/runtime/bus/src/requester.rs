//! Adds the sender of a request: its process and user.

use std::sync::OnceLock;

use messages::{OperatorRequest, put_text};
use rustix::process::geteuid;

use crate::clock::now_ns;

/// File with the names of local users; users of a directory service are shown by their number.
const USERS: &str = "/etc/passwd";

/// Name of the user of this process, after the first look-up.
static NAME: OnceLock<String> = OnceLock::new();

/// Fills in the fields of a request that is sent now: time, and, if they are empty, process, user, user name and id. A
/// request that is passed on for another process keeps that process and its user.
pub(crate) fn sign(request: &mut OperatorRequest) {
    if request.requester[0] == 0 {
        put_text(&mut request.requester, NAME.get_or_init(|| user_name(geteuid().as_raw())));
    }
    sign_from_memory(request);
}

/// As [`sign`], but reads no file, because that can block: before the first look-up the user is named by its number.
pub(crate) fn sign_from_memory(request: &mut OperatorRequest) {
    let now = now_ns();
    (request.header.stamp_ns, request.header.oldest_input_ns) = (now, now);
    if request.pid == 0 {
        (request.pid, request.uid) = (std::process::id(), geteuid().as_raw());
    }
    if request.requester[0] == 0 {
        match NAME.get() {
            Some(name) => put_text(&mut request.requester, name),
            None => put_text(&mut request.requester, &request.uid.to_string()),
        }
    }
    if request.id == 0 {
        request.id = now ^ (u64::from(request.pid) << 32);
    }
}

fn user_name(uid: u32) -> String {
    let users = std::fs::read_to_string(USERS).unwrap_or_default();
    name_in(&users, uid).map_or_else(|| uid.to_string(), str::to_owned)
}

/// passwd(5): `name:password:UID:...`.
fn name_in(users: &str, uid: u32) -> Option<&str> {
    users.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(uid)).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::text_of;

    #[test]
    fn user_names_are_read_from_passwd() {
        let users = "root:x:0:0:root:/root:/bin/bash\nbroken\nada:x:1000:1000::/home/ada:/bin/sh\n";
        assert_eq!((name_in(users, 1000), name_in(users, 0), name_in(users, 7)), (Some("ada"), Some("root"), None));
    }

    #[test]
    fn a_request_names_its_sender_and_keeps_an_existing_name() {
        let mut request = OperatorRequest::default();
        sign(&mut request);
        assert_eq!((request.pid, request.uid), (std::process::id(), geteuid().as_raw()));
        assert!(request.id != 0 && request.header.stamp_ns > 0 && !text_of(&request.requester).is_empty());
        put_text(&mut request.requester, "planner");
        let id = request.id;
        sign(&mut request);
        assert_eq!((text_of(&request.requester).as_str(), request.id), ("planner", id));
        let mut passed_on = OperatorRequest { pid: 7, uid: 1000, ..OperatorRequest::default() };
        put_text(&mut passed_on.requester, "ada");
        sign(&mut passed_on);
        assert_eq!((passed_on.pid, passed_on.uid, text_of(&passed_on.requester).as_str()), (7, 1000, "ada"));
    }
}
