//! The files of the built page, read once at the start: no request opens a path.

use axum::body::Bytes;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest number of files, and of bytes of all together: the built page has 5 files and less than 1 MB.
const FILES: usize = 32;
const BYTES: u64 = 8 << 20;

#[derive(Debug)]
struct File {
    bytes: Bytes,
    kind: &'static str,
    /// The bytes are those of gzip.
    packed: bool,
}

/// The files by name.
#[derive(Debug, Default)]
pub(crate) struct Assets(BTreeMap<String, File>);

/// Folder of the built page if none is given: beside the program.
pub(crate) fn folder(given: Option<&Path>) -> PathBuf {
    let beside = || std::env::current_exe().ok().and_then(|program| program.parent().map(|folder| folder.join("page")));
    given.map(Path::to_owned).or_else(beside).unwrap_or_default()
}

impl Assets {
    /// Reads the files of a folder; none if it is not there.
    pub(crate) fn read(folder: &Path) -> Self {
        let mut files = BTreeMap::new();
        let mut room = BYTES;
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten().take(FILES) {
            let Ok(name) = entry.file_name().into_string() else { continue };
            let (plain, packed) = name.strip_suffix(".gz").map_or((name.as_str(), false), |plain| (plain, true));
            let Some(kind) = kind_of(plain) else { continue };
            let Ok(facts) = entry.metadata() else { continue };
            if !facts.is_file() || facts.len() > room {
                continue;
            }
            let Ok(bytes) = std::fs::read(entry.path()) else { continue };
            room = room.saturating_sub(bytes.len() as u64);
            files.insert(plain.to_owned(), File { bytes: Bytes::from(bytes), kind, packed });
        }
        Self(files)
    }

    /// Whether the page was built.
    pub(crate) fn are_there(&self) -> bool {
        self.0.contains_key("index.html")
    }

    /// The answer with a file.
    pub(crate) fn get(&self, name: &str) -> Option<Response> {
        let file = self.0.get(name)?;
        let mut response = file.bytes.clone().into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(file.kind));
        if file.packed {
            // Every browser that can show the page takes it.
            headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        }
        Some(response)
    }
}

fn kind_of(name: &str) -> Option<&'static str> {
    Some(match name.rsplit('.').next()? {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "webmanifest" => "application/manifest+json",
        "txt" => "text/plain; charset=utf-8",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_known_kinds_are_served() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("index.html", "a"), ("page.js.gz", "b"), ("key.pem", "c"), (".html", "d")] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        std::fs::create_dir(folder.path().join("x.js")).unwrap();
        let assets = Assets::read(folder.path());
        assert!(assets.are_there());
        assert_eq!(assets.get("page.js").unwrap().headers()["content-encoding"], "gzip");
        for absent in ["key.pem", "x.js", "../index.html", "page.js.gz", ""] {
            assert!(assets.get(absent).is_none(), "{absent}");
        }
        assert!(!Assets::read(Path::new("/nowhere")).are_there());
    }
}
