//! Roles: what a client may request, by its user and groups as the kernel knows them.

use crate::plugin::PluginUnit;
use config::GatewaySection;
use gateway_protocol::Origin;
use messages::{OperatorRequest, Request};
use std::net::IpAddr;

/// Role of a client, in ascending order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// May read channels, lists and finished runs.
    Look,
    /// May also hold and stop.
    Stop,
    /// May also do everything that moves the robot.
    Fly,
    /// The robot's user and root: may also start any program as the robot's user, and manage tokens.
    Owner,
}

impl Role {
    /// Every role that a token can have.
    pub const OF_TOKENS: [Self; 3] = [Self::Look, Self::Stop, Self::Fly];

    /// Name in files, replies and sentences.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Look => "look",
            Self::Stop => "stop",
            Self::Fly => "fly",
            Self::Owner => "owner",
        }
    }

    /// The role of a token of that name.
    #[must_use]
    pub fn of_token(name: &str) -> Option<Self> {
        Self::OF_TOKENS.into_iter().find(|role| role.name() == name)
    }

    /// Returns `role` of [`OperatorRequest`].
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Look | Self::Stop => OperatorRequest::ROLE_OBSERVER,
            Self::Fly => OperatorRequest::ROLE_OPERATOR,
            Self::Owner => OperatorRequest::ROLE_ENGINEER,
        }
    }
}

/// The process at the other end of a connection.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Peer {
    /// User.
    pub uid: u32,
    /// Group of the process.
    pub gid: u32,
    /// Process id.
    pub pid: u32,
    /// Name of the user; its number if it has none.
    pub user: String,
    /// Names of the user's groups and of the group of the process.
    pub groups: Vec<String>,
    /// Numbers of the same groups.
    pub gids: Vec<u32>,
    /// The unit of the service manager in which the process runs, where that of a plug-in.
    pub unit: Option<PluginUnit>,
}

/// The configured roles.
#[derive(Debug, Clone)]
pub struct Roles {
    owner_uid: u32,
    section: GatewaySection,
}

impl Roles {
    /// Roles for the robot of this user.
    #[must_use]
    pub fn new(owner_uid: u32, section: GatewaySection) -> Self {
        Self { owner_uid, section }
    }

    /// Returns the role of a peer: a plug-in looks, whatever user it has; otherwise that of its user if the user is
    /// listed; otherwise the robot's user and root own the robot, and others have the highest role of their groups.
    #[must_use]
    pub fn of(&self, peer: &Peer) -> Role {
        if peer.unit.is_some() {
            return Role::Look;
        }
        let lists =
            [(Role::Look, &self.section.look), (Role::Stop, &self.section.stop), (Role::Fly, &self.section.fly)];
        // The lowest role of a user who is listed twice.
        let own = lists.iter().find(|(_, entries)| entries.iter().any(|entry| is_user(peer, entry)));
        if let Some((role, _)) = own {
            return *role;
        }
        if peer.uid == self.owner_uid || peer.uid == 0 {
            return Role::Owner;
        }
        // Who publishes reaches the socket by a group, and gets no role by it.
        if self.section.publish.iter().any(|entry| is_user(peer, entry)) {
            return Role::Look;
        }
        let of_group = lists.iter().rev().find(|(_, entries)| entries.iter().any(|entry| is_group(peer, entry)));
        of_group.map_or(Role::Look, |(role, _)| *role)
    }
}

impl Roles {
    /// Returns the time without a person who may fly after which a motion is held, ns; `None`: it goes on.
    #[must_use]
    pub fn hold_without_operator_ns(&self) -> Option<u64> {
        let after_s = self.section.hold_without_operator_s;
        (after_s > 0.0).then_some((after_s * 1e9) as u64)
    }

    /// Returns the role of a connection that names no person. A page acts for everyone who opens it, so without a token
    /// it stops at most, also where it runs as the robot's user.
    #[must_use]
    pub fn without_token(&self, peer: &Peer, origin: Origin) -> Role {
        match origin {
            Origin::Page => self.of(peer).min(Role::Stop),
            Origin::Command | Origin::Python => self.of(peer),
        }
    }

    /// Returns whether a peer that is no plug-in of the service manager may publish readings of any declared sensor: a
    /// listed user, the robot's user and root. A page acts for everyone who opens it, so it publishes nothing.
    #[must_use]
    pub fn may_publish(&self, peer: &Peer, origin: Origin) -> bool {
        if origin == Origin::Page {
            return false;
        }
        self.section.publish.iter().any(|entry| is_user(peer, entry)) || self.of(peer) == Role::Owner
    }
}

fn is_user(peer: &Peer, entry: &str) -> bool {
    !entry.starts_with('@') && (entry == peer.user || entry.parse() == Ok(peer.uid))
}

fn is_group(peer: &Peer, entry: &str) -> bool {
    let Some(group) = entry.strip_prefix('@') else { return false };
    peer.groups.iter().any(|name| name == group) || group.parse().is_ok_and(|gid| peer.gids.contains(&gid))
}

/// Returns the role that a request needs.
#[must_use]
pub fn needed(request: &Request) -> Role {
    match request {
        Request::Hold | Request::Pause | Request::Stop | Request::Estop | Request::Mark { .. } => Role::Stop,
        // It runs any program as the robot's user.
        Request::Plug { .. } => Role::Owner,
        Request::Arm
        | Request::Disarm
        | Request::Reset
        | Request::ZeroAt { .. }
        | Request::ZeroLengths { .. }
        | Request::ConfirmPosition
        | Request::Jog { .. }
        | Request::Soft
        | Request::Resume
        | Request::Speed { .. }
        | Request::Swap { .. }
        | Request::Admit { .. }
        | Request::Goto { .. }
        | Request::Run { .. }
        | Request::Fault { .. }
        | Request::StartProcess { .. }
        | Request::StopProcess { .. }
        | Request::RestartProcess { .. }
        | Request::Unplug { .. }
        | Request::Set { .. } => Role::Fly,
    }
}

/// What a request does, for a sentence: `ada may not arm the robot`.
#[must_use]
pub fn deed(request: &Request) -> &'static str {
    match request {
        Request::Arm => "arm the robot",
        Request::Disarm => "disarm the robot",
        Request::Hold | Request::Pause => "hold the robot",
        Request::Stop | Request::Estop => "stop the robot",
        Request::Reset => "reset the robot",
        Request::ZeroAt { .. } | Request::ZeroLengths { .. } => "zero the robot",
        Request::ConfirmPosition => "confirm the position",
        Request::Jog { .. } => "jog a cable",
        Request::Soft => "make the robot soft",
        Request::Resume => "resume the motion",
        Request::Speed { .. } => "set the speed",
        Request::Swap { .. } | Request::Admit { .. } => "swap processes",
        Request::Goto { .. } => "move the node",
        Request::Run { .. } => "fly a mission",
        Request::Fault { .. } => "cause a fault",
        Request::StartProcess { .. } => "start a process",
        Request::StopProcess { .. } => "stop a process",
        Request::RestartProcess { .. } => "restart a process",
        Request::Plug { .. } => "plug in a program",
        Request::Unplug { .. } => "unplug a process",
        Request::Mark { .. } => "mark the run",
        Request::Set { .. } => "set a parameter",
    }
}

/// Who requested something, and from where, in so many bytes: `ada@10.0.0.7`. Of a long address the end is kept, which
/// tells browsers of one network apart.
#[must_use]
pub(crate) fn requester(user: &str, from: Option<IpAddr>, room: usize) -> String {
    let Some(from) = from.map(|from| from.to_canonical().to_string()) else { return user.to_owned() };
    let left = room.saturating_sub(user.len() + 1);
    match from.len().checked_sub(left) {
        None | Some(0) => format!("{user}@{from}"),
        Some(_) if left < 8 => user.to_owned(),
        Some(over) => format!("{user}@..{}", &from[over + 2..]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peer(uid: u32, user: &str, groups: &[&str], gids: &[u32]) -> Peer {
        let groups = groups.iter().map(|&group| group.to_owned()).collect();
        Peer { uid, gid: uid, pid: 1, user: user.to_owned(), groups, gids: gids.to_vec(), unit: None }
    }

    fn roles(fly: &[&str], stop: &[&str], look: &[&str]) -> Roles {
        let list = |entries: &[&str]| entries.iter().map(|&entry| entry.to_owned()).collect();
        Roles::new(
            900,
            GatewaySection { fly: list(fly), stop: list(stop), look: list(look), ..GatewaySection::default() },
        )
    }

    #[test]
    fn by_default_operators_fly_the_owner_owns_and_others_look() {
        let roles = Roles::new(900, GatewaySection::default());
        for (peer, role) in [
            (peer(900, "nims", &[], &[]), Role::Owner),
            (peer(0, "root", &[], &[]), Role::Owner),
            (peer(1000, "ada", &["users", "nims-operators"], &[]), Role::Fly),
            (peer(1001, "bob", &["users"], &[]), Role::Look),
            // A user is no group, and no user has an empty name.
            (peer(1002, "nims-operators", &[], &[]), Role::Look),
            (peer(1003, "", &[""], &[]), Role::Look),
        ] {
            assert_eq!(roles.of(&peer), role, "{peer:?}");
        }
    }

    #[test]
    fn a_listed_user_has_that_role_and_a_group_the_highest() {
        let roles = roles(&["@pilots", "carl"], &["@77", "1004"], &["eve", "900"]);
        for (peer, role) in [
            (peer(1000, "eve", &["pilots"], &[]), Role::Look),
            (peer(1001, "ada", &["pilots"], &[77]), Role::Fly),
            (peer(1002, "bob", &[], &[5, 77]), Role::Stop),
            (peer(1003, "carl", &[], &[]), Role::Fly),
            (peer(1004, "dora", &["pilots"], &[]), Role::Stop),
            // So that the robot's user can try each role.
            (peer(900, "nims", &["pilots"], &[]), Role::Look),
            (peer(77, "fred", &[], &[]), Role::Look),
        ] {
            assert_eq!(roles.of(&peer), role, "{peer:?}");
        }
    }

    #[test]
    fn a_page_without_a_token_stops_at_most() {
        let roles = Roles::new(900, GatewaySection::default());
        for (uid, user, role) in [(900, "nims", Role::Stop), (700, "nims-page", Role::Stop), (701, "bob", Role::Look)] {
            assert_eq!(roles.without_token(&peer(uid, user, &[], &[]), Origin::Page), role, "{user}");
        }
        let pilot = peer(1000, "ada", &["nims-operators"], &[]);
        assert_eq!(roles.without_token(&pilot, Origin::Page), Role::Stop);
        assert_eq!(roles.without_token(&pilot, Origin::Command), Role::Fly);
    }

    #[test]
    fn only_the_user_of_the_plug_ins_and_the_owner_publish() {
        let roles = Roles::new(900, GatewaySection { look: vec!["901".to_owned()], ..GatewaySection::default() });
        let plugin = peer(800, "nims-plugin", &["nims-operators"], &[]);
        assert!(roles.may_publish(&plugin, Origin::Python));
        let owner = peer(900, "nims", &[], &[]);
        assert!(!roles.may_publish(&plugin, Origin::Page) && !roles.may_publish(&owner, Origin::Page));
        assert!(
            roles.may_publish(&owner, Origin::Command)
                && roles.may_publish(&peer(0, "root", &[], &[]), Origin::Command)
        );
        for (uid, user) in [(1000, "ada"), (901, "eve"), (1001, "nims-plugin2")] {
            let other = peer(uid, user, &["nims-operators", "nims-plugin"], &[]);
            assert!(!roles.may_publish(&other, Origin::Python), "{user}");
        }
        // It moves nothing, also where the group of the socket would let it.
        assert_eq!(roles.of(&plugin), Role::Look);
        // A unit of a plug-in that runs as another user, by a drop-in, is still one.
        let unit = PluginUnit::parse("nims-plugin@lab_soil.service");
        assert_eq!(roles.of(&Peer { unit, ..peer(900, "nims", &[], &[]) }), Role::Look);
    }

    #[test]
    fn a_requester_has_its_address_as_far_as_there_is_room() {
        let at = |user: &str, from: &str| requester(user, Some(from.parse().unwrap()), 32);
        assert_eq!(requester("ada", None, 32), "ada");
        assert_eq!(
            (at("ada", "10.0.0.7").as_str(), at("ada", "::ffff:10.0.0.7").as_str()),
            ("ada@10.0.0.7", "ada@10.0.0.7")
        );
        let long = at("ada", "2001:db8:1111:2222:3333:4444:5555:6666");
        assert!(long.len() == 32 && long.starts_with("ada@..") && long.ends_with(":4444:5555:6666"), "{long}");
        let name = "a".repeat(28);
        assert_eq!(at(&name, "10.0.0.7"), name);
    }

    #[test]
    fn a_role_may_do_what_the_lower_ones_may() {
        assert!(Role::Look < Role::Stop && Role::Stop < Role::Fly && Role::Fly < Role::Owner);
        assert_eq!(needed(&Request::Estop), Role::Stop);
        assert_eq!(needed(&Request::Disarm), Role::Fly);
    }
}
