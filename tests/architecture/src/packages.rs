//! The crates of the project, read from their manifests, so that the user who runs the tests needs no toolchain.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

/// A crate of the project.
#[derive(Debug)]
pub struct Package {
    /// Folder of its manifest.
    pub folder: PathBuf,
    /// First folder below the root: `shared`, `services` or `tests`.
    pub place: String,
    /// Names of its normal and build dependencies.
    pub dependencies: BTreeSet<String>,
    /// Names of its development dependencies.
    pub dev_dependencies: BTreeSet<String>,
    /// Whether it has a separate workspace.
    pub separate: bool,
}

/// The root folder of the project.
#[must_use]
pub fn root() -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).unwrap_or(own).to_path_buf()
}

/// Every crate of the project by name, including those in a separate workspace.
///
/// # Errors
/// If a manifest cannot be read, or has platform-specific dependencies, which these rules would miss.
pub fn packages() -> io::Result<BTreeMap<String, Package>> {
    let mut folders = vec![root().join("tests"), root().join("tests/architecture"), root().join("tests/benchmarks")];
    folders.extend(folders_in(&root().join("services"))?);
    for group in folders_in(&root().join("shared"))? {
        folders.extend(folders_in(&group)?);
    }
    folders.into_iter().map(package).collect()
}

fn package(folder: PathBuf) -> io::Result<(String, Package)> {
    let wrong = |problem: &str| io::Error::other(format!("{}/Cargo.toml: {problem}", folder.display()));
    let text = std::fs::read_to_string(folder.join("Cargo.toml"))?;
    let manifest: toml::Table = text.parse().map_err(|e: toml::de::Error| wrong(&e.to_string()))?;
    let names = |section: &str| -> BTreeSet<String> {
        let table = manifest.get(section).and_then(toml::Value::as_table);
        table.into_iter().flat_map(|table| table.keys().cloned()).collect()
    };
    if manifest.contains_key("target") {
        return Err(wrong("dependencies of one platform; give them for all platforms"));
    }
    let name = manifest.get("package").and_then(|package| package.get("name")).and_then(toml::Value::as_str);
    let name = name.ok_or_else(|| wrong("no package.name"))?.to_owned();
    let below = folder.strip_prefix(root()).ok().and_then(|path| path.components().next());
    let place = below.map(|first| first.as_os_str().to_string_lossy().into_owned()).unwrap_or_default();
    let mut dependencies = names("dependencies");
    dependencies.extend(names("build-dependencies"));
    let separate = manifest.contains_key("workspace") || !manifest_inherits(&manifest);
    Ok((name, Package { folder, place, dependencies, dev_dependencies: names("dev-dependencies"), separate }))
}

/// Whether the edition comes from a workspace; separate workspaces set theirs.
fn manifest_inherits(manifest: &toml::Table) -> bool {
    manifest.get("package").and_then(|package| package.get("edition")).is_some_and(toml::Value::is_table)
}

fn folders_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.join("Cargo.toml").is_file() || (path.is_dir() && folder.ends_with("shared")) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// The Rust files below a folder with their text, sorted by path.
///
/// # Errors
/// If a folder or a file cannot be read.
pub fn sources(folder: &Path) -> io::Result<Vec<(PathBuf, String)>> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = std::fs::read_to_string(&path)?;
                files.push((path, text));
            }
        }
    }
    files.sort();
    Ok(files)
}
