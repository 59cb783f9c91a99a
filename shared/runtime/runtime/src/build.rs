//! Identification of this build, and of programs that are not part of nims.

use serde::Serialize;

/// Version of nims, e.g. `0.1.0`.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Build profile: `release` or `debug`.
pub const PROFILE: &str = if cfg!(debug_assertions) { "debug" } else { "release" };

/// Returns the commit of the build, if known, and whether files differed from it. Only release builds contain it; the
/// environment variable `NIMS_COMMIT` sets it for builds without git.
#[must_use]
pub fn commit() -> Option<(&'static str, bool)> {
    split(env!("NIMS_STAMP"))
}

fn split(stamp: &str) -> Option<(&str, bool)> {
    let commit = stamp.strip_suffix("-dirty");
    (!stamp.is_empty()).then(|| (commit.unwrap_or(stamp), commit.is_some()))
}

/// Returns version, profile and commit, e.g. `0.1.0 debug` or `0.1.0 release 1a2b3c4d5e-dirty`.
#[must_use]
pub fn described(version: &str) -> String {
    format!("{version} {PROFILE} {}", env!("NIMS_STAMP")).trim_end().to_owned()
}

/// Returns version, profile and commit of nims.
#[must_use]
pub fn description() -> &'static str {
    static OWN: std::sync::OnceLock<String> = std::sync::OnceLock::new();
    OWN.get_or_init(|| described(VERSION))
}

/// Identification of a program outside this workspace, which a run stores instead of version and commit of nims.
/// [`crate::program!`] creates it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Program {
    /// Name of its crate.
    pub name: &'static str,
    /// Version of its crate.
    pub version: &'static str,
    /// Folder of its sources.
    pub sources: &'static str,
}

impl Program {
    /// Returns version, profile and name, e.g. `0.1.0 debug of my-law`.
    #[must_use]
    pub fn described(&self) -> String {
        format!("{} {PROFILE} of {}", self.version, self.name)
    }

    /// Returns the TOML table `[program]`.
    #[must_use]
    pub fn to_toml(&self) -> String {
        format!("[program]\n{}", toml::to_string(self).unwrap_or_default())
    }
}

/// Creates the [`build::Program`](crate::build::Program) of the calling crate.
#[macro_export]
macro_rules! program {
    () => {
        $crate::build::Program {
            name: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            sources: env!("CARGO_MANIFEST_DIR"),
        }
    };
}

#[cfg(test)]
#[path = "../stamp.rs"]
mod stamp;

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::process::Command;

    #[test]
    fn a_build_has_a_clean_commit_a_dirty_commit_or_none() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(stamp::commit_of(folder.path()), None, "outside a checkout");
        assert_eq!(stamp::commit_of(&folder.path().join("nowhere")), None);
        let git = |arguments: &[&str]| {
            let who = ["-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false"];
            Command::new("git").arg("-C").arg(folder.path()).args(who).args(arguments).output()
        };
        if git(&["init", "-q"]).is_err() {
            return notes::left_out("the commit in a version", "there is no git");
        }
        assert_eq!(stamp::commit_of(folder.path()), None, "no commit yet");
        fs::write(folder.path().join("a"), "1").unwrap();
        git(&["add", "a"]).unwrap();
        assert!(git(&["commit", "-qm", "a"]).unwrap().status.success());
        let clean = stamp::commit_of(folder.path()).unwrap();
        let watched = stamp::watched(folder.path());
        let ends = |name: &str| watched.iter().any(|path| path.ends_with(name));
        assert!(ends("a") && ends("HEAD") && ends("logs/HEAD") && watched.len() == 3, "{watched:?}");
        assert_eq!(split(&clean), Some((clean.as_str(), false)));
        fs::write(folder.path().join("a"), "2").unwrap();
        let dirty = stamp::commit_of(folder.path()).unwrap();
        assert_eq!(split(&dirty), Some((clean.as_str(), true)));
        assert_eq!(split(""), None);
    }

    #[test]
    fn a_program_is_identified() {
        let program = Program { name: "my-law", version: "2.0.0", sources: "/home/\"you\"/my-law" };
        assert_eq!(program.described(), format!("2.0.0 {PROFILE} of my-law"));
        let table: toml::Table = program.to_toml().parse().unwrap();
        assert_eq!(table["program"]["sources"].as_str(), Some(program.sources));
        assert_eq!(crate::program!().name, "runtime");
    }

    #[test]
    fn a_description_fits_into_the_heartbeat() {
        let longest = format!("{} release {}-dirty", VERSION, "f".repeat(10));
        assert!(longest.len() <= messages::Heartbeat::default().version.len());
        assert!(described("1.2.3").starts_with("1.2.3 "));
    }
}
