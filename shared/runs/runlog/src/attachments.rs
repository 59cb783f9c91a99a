//! Files that describe a run: they lie in its folder and are attached to its run files.

use std::fs;
use std::path::{Path, PathBuf};

use crate::Attachment;

/// The run's copy of the system file.
pub const SYSTEM_FILE: &str = "system.toml";
/// The name of that copy in older runs.
const FORMER_SYSTEM_FILE: &str = "box.toml";
/// Subfolders of a run for files added while it runs, numbered in order of arrival: the missions that were executed,
/// and the configuration files of processes started later.
pub const ATTACHED_FOLDERS: [&str; 2] = ["missions", "processes"];
/// File name extensions that are attached.
pub const ATTACHED_ENDINGS: [&str; 6] = ["toml", "json", "yaml", "yml", "py", "sh"];

/// The files of a run folder to attach to its run files: the configuration sorted by name, then the later files by
/// number.
#[must_use]
pub fn run_attachments(folder: &Path) -> Vec<Attachment> {
    let of = |place: Option<&str>| {
        let mut paths = files_in(&place.map_or_else(|| folder.to_owned(), |place| folder.join(place)));
        paths.sort_by_cached_key(|path| (number(path), path.clone()));
        paths.into_iter().filter_map(move |path| attachment(&path, place)).collect::<Vec<_>>()
    };
    [None].into_iter().chain(ATTACHED_FOLDERS.into_iter().map(Some)).flat_map(of).collect()
}

/// Returns whether a file of a run is the copy of the system file, by its name.
#[must_use]
pub fn is_system_file(name: &str) -> bool {
    name == SYSTEM_FILE || name == FORMER_SYSTEM_FILE
}

/// Returns the text of a run's system file: from the folder of the run, else from the attachments of its run file.
#[must_use]
pub fn system_file_text(run: &Path, attachments: &[Attachment]) -> Option<String> {
    let folder = if run.is_dir() { Some(run) } else { run.parent() };
    let names = [SYSTEM_FILE, FORMER_SYSTEM_FILE];
    let beside = folder.and_then(|folder| names.iter().find_map(|name| fs::read_to_string(folder.join(name)).ok()));
    beside.or_else(|| {
        let attached = attachments.iter().find(|one| is_system_file(&one.name))?;
        Some(String::from_utf8_lossy(&attached.data).into_owned())
    })
}

fn files_in(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_file())
        .collect()
}

/// The leading number of a file name: 12 for `12-name.toml`, 0 where there is none.
fn number(path: &Path) -> u64 {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.split_once('-').and_then(|(number, _)| number.parse().ok()).unwrap_or(0)
}

fn attachment(path: &Path, place: Option<&str>) -> Option<Attachment> {
    let ending = path.extension()?.to_str().filter(|ending| ATTACHED_ENDINGS.contains(ending))?;
    let media_type = match ending {
        "py" => "text/x-python".to_owned(),
        "sh" => "text/x-shellscript".to_owned(),
        "yml" => "application/yaml".to_owned(),
        other => format!("application/{other}"),
    };
    let name = path.file_name()?.to_str()?;
    let name = place.map_or_else(|| name.to_owned(), |place| format!("{place}/{name}"));
    Some(Attachment { name, media_type, data: fs::read(path).ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_file_is_read_from_the_folder_or_else_from_the_attachments() {
        let folder = tempfile::tempdir().unwrap();
        let attached = |name: &str| {
            [Attachment { name: name.into(), media_type: "application/toml".into(), data: b"attached".to_vec() }]
        };
        let text = |attachments: &[Attachment]| system_file_text(folder.path(), attachments);
        assert_eq!(text(&attached("robot.toml")), None);
        for name in [SYSTEM_FILE, FORMER_SYSTEM_FILE] {
            assert!(is_system_file(name));
            assert_eq!(text(&attached(name)).as_deref(), Some("attached"));
        }
        for name in [FORMER_SYSTEM_FILE, SYSTEM_FILE] {
            fs::write(folder.path().join(name), name).unwrap();
            assert_eq!(text(&attached(SYSTEM_FILE)).as_deref(), Some(name));
            let run_file = folder.path().join("run.mcap");
            assert_eq!(system_file_text(&run_file, &[]).as_deref(), Some(name), "beside a run file");
        }
    }

    #[test]
    fn the_configuration_comes_first_and_then_what_was_flown_in_its_order() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, name).unwrap();
        };
        for name in ["missions/10-a.toml", "missions/2-b.toml", "robot.toml", "system.toml", "processes/1-wind-wind.py"]
        {
            write(name);
        }
        for left_out in ["run.mcap", "missions/3-c.toml.new", "log/x.txt", "export/tables.json"] {
            write(left_out);
        }
        let kept = run_attachments(folder.path());
        let names: Vec<&str> = kept.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(
            names,
            ["robot.toml", "system.toml", "missions/2-b.toml", "missions/10-a.toml", "processes/1-wind-wind.py"]
        );
        assert!(kept.iter().all(|file| file.data == file.name.as_bytes()));
        assert_eq!((kept[0].media_type.as_str(), kept[4].media_type.as_str()), ("application/toml", "text/x-python"));
    }
}
