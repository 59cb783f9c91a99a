//! Which file of a crate imports which.
//!
//! A file imports another where its code, outside of tests, names an item that the other one defines: by `use`, or by a
//! path in an expression or a type. Paths are followed through modules, `use` and re-exports to the file that defines
//! the item, so importing through a parent's `pub use` counts as importing the child. A parent that only re-exports a
//! child does not import it.

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// The position of a module in its crate: the names from the root.
type ModulePath = Vec<String>;

/// Longest path that is followed; longer than any in the tree.
const LONGEST_PATH: usize = 12;

/// Paths already followed, each with its module.
type Followed = BTreeSet<(ModulePath, Vec<String>)>;

/// A name that a `use` brings into a module.
#[derive(Debug, Clone)]
struct Import {
    path: Vec<String>,
    reexport: bool,
}

#[derive(Debug, Default)]
struct Module {
    file: PathBuf,
    /// Items defined here, other than modules.
    items: BTreeSet<String>,
    children: BTreeSet<String>,
    imports: BTreeMap<String, Import>,
    /// Modules of which a `use` takes everything.
    globs: Vec<Vec<String>>,
    /// Paths of two or more names in code, and single names.
    paths: BTreeSet<Vec<String>>,
}

/// The modules of one target, from its root file down.
#[derive(Debug, Default)]
pub struct Modules {
    modules: BTreeMap<ModulePath, Module>,
    /// Macros with `#[macro_export]`, which stand at the root.
    macros: BTreeMap<String, PathBuf>,
}

impl Modules {
    /// Reads a target from its root file, such as `src/lib.rs`.
    ///
    /// # Errors
    /// If a file cannot be read or is not Rust.
    pub fn read(root: &Path) -> io::Result<Self> {
        let mut all = Self::default();
        let folder = root.parent().unwrap_or(root).to_path_buf();
        all.read_file(root, &folder, Vec::new())?;
        Ok(all)
    }

    /// Reads a file whose child modules lie in `folder`.
    fn read_file(&mut self, file: &Path, folder: &Path, at: ModulePath) -> io::Result<()> {
        let text = fs::read_to_string(file).map_err(|e| io::Error::other(format!("{}: {e}", file.display())))?;
        let stream: TokenStream =
            text.parse().map_err(|e| io::Error::other(format!("{}: not Rust: {e}", file.display())))?;
        self.read_module(stream, file, folder, at)
    }

    fn read_module(&mut self, stream: TokenStream, file: &Path, folder: &Path, at: ModulePath) -> io::Result<()> {
        let mut reader =
            Reader { module: Module { file: file.to_path_buf(), ..Module::default() }, ..Reader::default() };
        reader.items(stream, true);
        let Reader { mut module, inner, outer, macros } = reader;
        module.children.extend(inner.iter().map(|(name, _)| name.clone()));
        module.children.extend(outer.iter().map(|(name, _)| name.clone()));
        self.modules.insert(at.clone(), module);
        self.macros.extend(macros.into_iter().map(|name| (name, file.to_path_buf())));
        let below = |name: &str| at.iter().cloned().chain([name.to_owned()]).collect::<ModulePath>();
        for (name, body) in inner {
            self.read_module(body, file, &folder.join(&name), below(&name))?;
        }
        for (name, given) in outer {
            let (flat, nested) = (folder.join(format!("{name}.rs")), folder.join(&name).join("mod.rs"));
            let path = match given {
                Some(given) => file.parent().unwrap_or(folder).join(given),
                None if flat.is_file() => flat,
                None => nested,
            };
            let own = if path.ends_with("mod.rs") {
                path.parent().unwrap_or(folder).to_path_buf()
            } else {
                folder.join(&name)
            };
            self.read_file(&path, &own, below(&name))?;
        }
        Ok(())
    }

    /// The files that each file imports, without itself, each with a name that it imports.
    #[must_use]
    pub fn imports(&self) -> Imports {
        let mut found = Imports::new();
        for (at, module) in &self.modules {
            let named = found.entry(module.file.clone()).or_default();
            let imported = module.imports.values().filter(|import| !import.reexport).map(|import| &import.path);
            for path in imported.chain(&module.paths) {
                if let Some(file) = self.file_of(at, path, &mut BTreeSet::new()).filter(|file| *file != module.file) {
                    named.entry(file).or_insert_with(|| path.join("::"));
                }
            }
        }
        found
    }

    /// The file that defines what a path in a module names; `None` for foreign paths and for modules themselves, whose
    /// items are counted where they are named.
    /// `followed` holds the paths followed so far, because names can import each other in a circle.
    fn file_of(&self, at: &ModulePath, path: &[String], followed: &mut Followed) -> Option<PathBuf> {
        // A name that is imported from below itself, as in `use a::b::a` of a foreign crate `a`, makes the path longer
        // each time.
        if path.len() > LONGEST_PATH || !followed.insert((at.clone(), path.to_vec())) {
            return None;
        }
        let (mut here, mut rest) = self.start(at, path)?;
        while let Some((name, after)) = rest.split_first() {
            let module = self.modules.get(&here)?;
            if module.children.contains(name) {
                here.push(name.clone());
                rest = after;
                continue;
            }
            if module.items.contains(name) {
                return Some(module.file.clone());
            }
            if let Some(import) = module.imports.get(name) {
                let longer: Vec<String> = import.path.iter().chain(after).cloned().collect();
                return self.file_of(&here, &longer, followed);
            }
            let from_globs = module.globs.iter().find_map(|glob| {
                let longer: Vec<String> = glob.iter().chain(rest).cloned().collect();
                self.file_of(&here, &longer, followed)
            });
            return from_globs.or_else(|| here.is_empty().then(|| self.macros.get(name).cloned()).flatten());
        }
        None
    }

    /// The module where a path begins, and the names after it; `None` if it begins in another crate.
    fn start<'a>(&self, at: &ModulePath, path: &'a [String]) -> Option<(ModulePath, &'a [String])> {
        let (first, mut rest) = path.split_first()?;
        match first.as_str() {
            "crate" => Some((Vec::new(), rest)),
            "self" => Some((at.clone(), rest)),
            "super" => {
                let mut here = at.clone();
                here.pop()?;
                while rest.first().is_some_and(|name| name == "super") {
                    here.pop()?;
                    rest = &rest[1..];
                }
                Some((here, rest))
            }
            _ => Some((at.clone(), path)),
        }
    }
}

/// The files that each file imports, and a name by which it does.
pub type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, String>>;

/// The groups of files that reach each other by their imports.
#[must_use]
pub fn rings(imports: &Imports) -> Vec<BTreeSet<PathBuf>> {
    let reached = |from: &PathBuf| {
        let mut reached = BTreeSet::new();
        let mut next = vec![from];
        while let Some(file) = next.pop() {
            let named = imports.get(file).into_iter().flat_map(BTreeMap::keys);
            next.extend(named.filter(|file| reached.insert((*file).clone())));
        }
        reached
    };
    let reach: BTreeMap<&PathBuf, BTreeSet<PathBuf>> = imports.keys().map(|file| (file, reached(file))).collect();
    let ring = |file: &PathBuf| -> BTreeSet<PathBuf> {
        let others = reach[file].iter().filter(|other| reach.get(other).is_some_and(|back| back.contains(file)));
        others.cloned().collect()
    };
    let found: BTreeSet<BTreeSet<PathBuf>> = imports.keys().map(ring).filter(|ring| !ring.is_empty()).collect();
    found.into_iter().collect()
}

/// Collects what one module defines and names.
#[derive(Default)]
struct Reader {
    module: Module,
    inner: Vec<(String, TokenStream)>,
    outer: Vec<(String, Option<String>)>,
    macros: Vec<String>,
}

impl Reader {
    /// Reads items (`top`), or the inside of one.
    fn items(&mut self, stream: TokenStream, top: bool) {
        let tokens: Vec<TokenTree> = stream.into_iter().collect();
        let mut i = 0;
        let mut attributes = Attributes::default();
        let mut public = false;
        while i < tokens.len() {
            match &tokens[i] {
                TokenTree::Punct(hash) if hash.as_char() == '#' => {
                    i = attributes.read_at(&tokens, i);
                    if attributes.test {
                        i = end_of_item(&tokens, i);
                        attributes = Attributes::default();
                    }
                }
                TokenTree::Ident(word) if word == "use" => {
                    let end = (i..tokens.len()).find(|j| is_punct(&tokens[*j], ';')).unwrap_or(tokens.len());
                    self.use_tree(&tokens[i + 1..end], Vec::new(), public);
                    (i, public, attributes) = (end + 1, false, Attributes::default());
                }
                TokenTree::Ident(word) if word == "mod" && top => {
                    let name = tokens.get(i + 1).map(ToString::to_string).unwrap_or_default();
                    match tokens.get(i + 2) {
                        Some(TokenTree::Group(body)) => self.inner.push((name, body.stream())),
                        _ => self.outer.push((name, attributes.path.take())),
                    }
                    (i, public, attributes) = (i + 3, false, Attributes::default());
                }
                TokenTree::Ident(word) if word == "macro_rules" => {
                    let name = tokens.get(i + 2).map(ToString::to_string).unwrap_or_default();
                    if attributes.exported {
                        self.macros.push(name);
                    } else if top {
                        self.module.items.insert(name);
                    }
                    (i, attributes) = (i + 3, Attributes::default());
                }
                TokenTree::Ident(word) if DEFINES.contains(&word.to_string().as_str()) => {
                    if let Some(TokenTree::Ident(name)) = tokens.get(i + 1)
                        && !DEFINES.contains(&name.to_string().as_str())
                    {
                        if top {
                            self.module.items.insert(name.to_string());
                        }
                        i += 1;
                    }
                    (i, public) = (i + 1, false);
                }
                TokenTree::Ident(word) if word == "pub" => {
                    public = true;
                    let restricted = matches!(tokens.get(i + 1), Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Parenthesis);
                    i += if restricted { 2 } else { 1 };
                }
                TokenTree::Ident(_) => (i, public) = (self.path(&tokens, i), false),
                TokenTree::Group(group) => {
                    // A macro may define items; its arguments are read as code.
                    self.items(group.stream(), false);
                    (i, public) = (i + 1, false);
                    attributes = Attributes::default();
                }
                _ => i += 1,
            }
        }
    }

    /// Reads the path that begins at `i`; returns where it ends.
    fn path(&mut self, tokens: &[TokenTree], i: usize) -> usize {
        let after_dot = i > 0 && is_punct(&tokens[i - 1], '.');
        let (path, next) = path_at(tokens, i);
        // A single lowercase word is usually a variable; the functions of a glob are called.
        let called =
            matches!(tokens.get(next), Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Parenthesis);
        let variable = path.len() == 1 && path[0].starts_with(|c: char| c.is_lowercase()) && !called;
        if !after_dot && !variable {
            self.module.paths.insert(path);
        }
        next
    }

    fn use_tree(&mut self, tokens: &[TokenTree], before: Vec<String>, reexport: bool) {
        let mut path = before;
        let mut i = 0;
        while i < tokens.len() {
            match &tokens[i] {
                TokenTree::Ident(word) if word == "as" => {
                    let name = tokens.get(i + 1).map(ToString::to_string).unwrap_or_default();
                    self.module.imports.insert(name, Import { path, reexport });
                    return;
                }
                TokenTree::Ident(word) => path.push(word.to_string()),
                TokenTree::Punct(star) if star.as_char() == '*' => {
                    self.module.globs.push(path);
                    return;
                }
                TokenTree::Group(group) => {
                    let inside: Vec<TokenTree> = group.stream().into_iter().collect();
                    for part in inside.split(|token| is_punct(token, ',')).filter(|part| !part.is_empty()) {
                        self.use_tree(part, path.clone(), reexport);
                    }
                    return;
                }
                _ => {}
            }
            i += 1;
        }
        if path.last().is_some_and(|name| name == "self") {
            path.pop();
        }
        if let Some(name) = path.last().cloned() {
            self.module.imports.insert(name, Import { path, reexport });
        }
    }
}

/// Returns whether a file has an item for tests only, anywhere but in a macro that it defines: the tests of a macro are
/// those of the crates that use it.
///
/// # Errors
/// If the text is not Rust.
pub fn has_tests(text: &str) -> io::Result<bool> {
    let stream: TokenStream = text.parse().map_err(|e| io::Error::other(format!("not Rust: {e}")))?;
    Ok(has_test_item(stream))
}

fn has_test_item(stream: TokenStream) -> bool {
    let tokens: Vec<TokenTree> = stream.into_iter().collect();
    let is_test = |i: usize| {
        let mut attributes = Attributes::default();
        attributes.read_at(&tokens, i);
        attributes.test
    };
    // As in `macro_rules! name { .. }`.
    let is_macro = |i: usize| i.checked_sub(3).is_some_and(|first| tokens[first].to_string() == "macro_rules");
    tokens.iter().enumerate().any(|(i, token)| match token {
        TokenTree::Punct(hash) if hash.as_char() == '#' => is_test(i),
        TokenTree::Group(group) => !is_macro(i) && has_test_item(group.stream()),
        _ => false,
    })
}

/// Keywords before the name of an item.
const DEFINES: [&str; 9] = ["fn", "struct", "enum", "trait", "type", "const", "static", "union", "mut"];

/// Whether attributes mark the item after them as a test or as exported.
#[derive(Default)]
struct Attributes {
    test: bool,
    exported: bool,
    path: Option<String>,
}

impl Attributes {
    /// Reads the attribute whose `#` stands at `i`; returns where it ends.
    fn read_at(&mut self, tokens: &[TokenTree], i: usize) -> usize {
        let group = tokens[i + 1..].iter().take(2).position(|t| matches!(t, TokenTree::Group(_)));
        if let Some(TokenTree::Group(group)) = group.and_then(|offset| tokens.get(i + 1 + offset)) {
            self.read(group.stream());
        }
        i + 2 + group.unwrap_or(0)
    }

    fn read(&mut self, stream: TokenStream) {
        let text = stream.to_string().replace(' ', "");
        self.test |= text == "cfg(test)" || text == "test" || text.starts_with("cfg(all(test");
        self.exported |= text.starts_with("macro_export");
        if let Some(path) = text.strip_prefix("path=") {
            self.path = Some(path.trim_matches('"').to_owned());
        }
    }
}

/// Index after the item that begins here: after its `;` or its braces.
fn end_of_item(tokens: &[TokenTree], from: usize) -> usize {
    let over = |token: &TokenTree| {
        is_punct(token, ';') || matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace)
    };
    let braces_of_use = tokens.get(from).is_some_and(|token| token.to_string() == "use");
    (from..tokens.len())
        .find(|i| if braces_of_use { is_punct(&tokens[*i], ';') } else { over(&tokens[*i]) })
        .map_or(tokens.len(), |i| i + 1)
}

/// The path that begins here, as `a::b::c`, and the index after it.
fn path_at(tokens: &[TokenTree], from: usize) -> (Vec<String>, usize) {
    let mut path = vec![tokens[from].to_string()];
    let mut i = from + 1;
    while let (Some(first), Some(second), Some(TokenTree::Ident(name))) =
        (tokens.get(i), tokens.get(i + 1), tokens.get(i + 2))
    {
        if !(is_punct(first, ':') && is_punct(second, ':')) {
            break;
        }
        path.push(name.to_string());
        i += 3;
    }
    (path, i)
}

fn is_punct(token: &TokenTree, wanted: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == wanted)
}
