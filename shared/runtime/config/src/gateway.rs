//! `[gateway]`: who may do what through the gateway.

use crate::Problem;
use crate::section::between;

crate::section! {
    /// `[gateway]`: the roles of users who reach the robot through the gateway, see `docs/access.md`. An entry is the
    /// name or the number of a user or, after `@`, of a group. A user who is listed has that role; otherwise the
    /// robot's user and root own the robot, then the highest role of a listed group counts, and every other user may
    /// look.
    pub struct GatewaySection {
        /// Users and groups that may do everything that moves the robot.
        pub fly: Vec<String> = vec!["@nims-operators".to_owned()],
        /// Users and groups that may hold and stop; the page does so for everyone who opens it.
        pub stop: Vec<String> = vec!["nims-page".to_owned()],
        /// Users that may only look, although one of their groups may do more.
        pub look: Vec<String> = Vec::new(),
        /// Users that may also publish readings of the declared plug-ins; it gives them no other role.
        pub publish: Vec<String> = vec!["nims-plugin".to_owned()],
        /// Time without a connected person who may fly, by page or command, after which a motion is held, s; 0: it goes
        /// on.
        pub hold_without_operator_s: f64 = 0.0 => between(0.0, 3600.0, "s"),
    }
}

/// Checks the entries.
///
/// # Errors
/// An entry that is no name of a user or a group.
pub(super) fn check(section: &GatewaySection) -> Result<(), Problem> {
    for (key, entries) in
        [("fly", &section.fly), ("stop", &section.stop), ("look", &section.look), ("publish", &section.publish)]
    {
        check_names(&format!("gateway.{key}"), entries)?;
    }
    match section.publish.iter().find(|entry| entry.starts_with('@')) {
        Some(entry) => {
            let clause = format!("contains \"{entry}\"; accepted: users, no groups");
            Err(Problem::with_clause("gateway.publish", clause))
        }
        None => Ok(()),
    }
}

/// Checks entries of a key that lists users and groups.
///
/// # Errors
/// An entry that is no name of a user or a group.
pub(super) fn check_names(key: &str, entries: &[String]) -> Result<(), Problem> {
    let usable = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.' | b'$');
    for entry in entries {
        let name = entry.strip_prefix('@').unwrap_or(entry);
        if name.is_empty() || !name.bytes().all(usable) {
            let clause =
                format!("contains \"{entry}\"; accepted: the name or number of a user, or `@` and that of a group");
            return Err(Problem::with_clause(key, clause));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_have_names_and_numbers_of_users_and_groups() {
        let names = |entries: &[&str]| entries.iter().map(|entry| (*entry).to_owned()).collect::<Vec<_>>();
        assert!(check_names("viewer.look", &names(&["ada", "1000", "@nims-operators", "@990", "a.b-c_$"])).is_ok());
        for entry in ["", "@", "@@x", "a b", "ada:", "a/b", "é"] {
            let problem = check_names("viewer.look", &names(&["ada", entry])).unwrap_err();
            assert_eq!(problem.key(), "viewer.look");
            assert!(problem.to_string().contains(&format!("\"{entry}\"")), "{problem}");
        }
        let section = GatewaySection { publish: names(&["@plugins"]), ..GatewaySection::default() };
        assert_eq!(check(&section).unwrap_err().key(), "gateway.publish");
    }
}
