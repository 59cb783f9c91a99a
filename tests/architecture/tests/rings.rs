//! No two files of a crate import each other, directly or in a ring.

// `clippy.toml` permits `unwrap` in test functions only, and this file has helpers.
#![allow(clippy::unwrap_used)]

use architecture::modules::{Modules, rings};
use architecture::{packages, root};
use std::path::{Path, PathBuf};

/// The root files of a crate's targets.
fn targets(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = ["src/lib.rs", "src/main.rs"].map(|name| folder.join(name)).to_vec();
    for place in ["src/bin", "tests", "examples", "benches"] {
        for entry in std::fs::read_dir(folder.join(place)).into_iter().flatten() {
            let path = entry.unwrap().path();
            let is_rust = path.extension().is_some_and(|ending| ending == "rs");
            found.push(if is_rust { path } else { path.join("main.rs") });
        }
    }
    found.retain(|path| path.is_file());
    found
}

fn short(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

#[test]
fn no_two_files_of_a_crate_import_each_other() {
    let mut found = Vec::new();
    let mut edges = 0;
    for package in packages().unwrap().values() {
        for target in targets(&package.folder) {
            let imports = Modules::read(&target).unwrap().imports();
            edges += imports.values().map(|named| named.len()).sum::<usize>();
            for ring in rings(&imports) {
                found.push(format!("in {}:", short(&target)));
                for (file, named) in imports.iter().filter(|(file, _)| ring.contains(*file)) {
                    let inside = named.iter().filter(|(other, _)| ring.contains(*other));
                    found.extend(inside.map(|(other, name)| format!("  {} -> {} ({name})", short(file), short(other))));
                }
            }
        }
    }
    assert!(edges > 500, "{edges} imports found: too few");
    assert!(found.is_empty(), "files import each other:\n{}", found.join("\n"));
}

/// Returns the rings in a crate of these files.
fn rings_of(files: &[(&str, &str)]) -> Vec<Vec<String>> {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    let imports = Modules::read(&folder.path().join(files[0].0)).unwrap().imports();
    let file = |path: &PathBuf| path.strip_prefix(folder.path()).unwrap().display().to_string();
    rings(&imports).iter().map(|ring| ring.iter().map(file).collect()).collect()
}

#[test]
fn a_ring_is_found_through_re_exports_globs_and_inline_paths() {
    let lib = ("lib.rs", "mod a;\nmod b;\npub use b::{B as Other};");
    let b = ("b/mod.rs", "use super::*;\npub struct B;\nfn f() -> usize { crate::a::one() }");
    for a in [
        "use crate::Other; pub fn one() -> usize { 1 }",
        "use crate::b as c; pub fn one() -> usize { size_of::<c::B>() }",
        "pub fn one() -> usize { size_of::<super::Other>() }",
    ] {
        assert_eq!(rings_of(&[lib, ("a.rs", a), b]), [["a.rs", "b/mod.rs"]], "{a}");
    }
}

#[test]
fn re_exports_tests_and_foreign_names_make_no_ring() {
    let lib = ("lib.rs", "mod a;\nmod b;\npub use a::A;\npub struct Root;");
    let a = ("a.rs", "use b::B;\npub struct A(crate::Root);\n#[cfg(test)]\nmod tests { use crate::b::B; }");
    let b = ("b.rs", "use crate::A;\nuse fmt::a::A as Foreign;\n/// [`crate::Root`]\npub struct B(A);");
    assert_eq!(rings_of(&[lib, a, b]), Vec::<Vec<String>>::new());
}
