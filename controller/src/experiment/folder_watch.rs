//! Recordings that appear in a folder from some time on: what a recorder that ended with an error leaves there all the same.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// How the name of a file ends that is still being written, or never was finished.
const UNFINISHED: &str = ".partial.mcap";
/// How the name of every recording ends.
const RECORDING: &str = ".mcap";

/// A folder, and what lay in it when it was looked at first.
#[derive(Debug)]
pub(super) struct FolderWatch {
    folder: PathBuf,
    /// How the names of the recordings begin.
    stem: &'static str,
    before: HashSet<PathBuf>,
}

impl FolderWatch {
    /// A watch that takes all that lies in the folder now for old. A folder that is not there is empty.
    pub(super) fn start(folder: &Path, stem: &'static str) -> Self {
        let before = recordings(folder, stem).collect();
        FolderWatch { folder: folder.to_owned(), stem, before }
    }

    /// Finished recordings that have come since, the oldest first.
    pub(super) fn finished(&self) -> Vec<PathBuf> {
        let mut finished: Vec<PathBuf> = self.new_ones().filter(|path| !is_unfinished(path)).collect();
        finished.sort_by_key(|path| (path.metadata().and_then(|about| about.modified()).ok(), path.clone()));
        finished
    }

    /// Removes unfinished recordings that have come since and hold nothing: each try on a full disk leaves one.
    pub(super) fn remove_empty(&self) {
        let is_empty = |path: &PathBuf| path.metadata().is_ok_and(|about| about.is_file() && about.len() == 0);
        for path in self.new_ones().filter(|path| is_unfinished(path)).filter(is_empty) {
            // Where it cannot be removed it stays; nothing is lost with it either way.
            let _ = std::fs::remove_file(path);
        }
    }

    fn new_ones(&self) -> impl Iterator<Item = PathBuf> {
        recordings(&self.folder, self.stem).filter(|path| !self.before.contains(path))
    }
}

fn recordings(folder: &Path, stem: &'static str) -> impl Iterator<Item = PathBuf> {
    let is_recording = move |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(stem) && name.ends_with(RECORDING)
    };
    std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).filter(is_recording)
}

fn is_unfinished(path: &Path) -> bool {
    path.to_string_lossy().ends_with(UNFINISHED)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_come_since_is_found_and_only_what_is_empty_is_removed() {
        let folder = std::env::temp_dir().join(format!("folder-watch-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = |name: &str, text: &str| {
            std::fs::write(folder.join(name), text).unwrap();
            folder.join(name)
        };
        let old = [file("experiment-1.mcap", "old"), file("experiment-1-2.partial.mcap", "")];
        let watch = FolderWatch::start(&folder, "experiment");
        let (empty, begun) = (file("experiment-3.partial.mcap", ""), file("experiment-2.partial.mcap", "rows"));
        let whole = file("experiment-4.mcap", "rows");
        let others = [file("run-4.mcap", "a run"), file("run-5.partial.mcap", "")];
        watch.remove_empty();
        assert_eq!(watch.finished(), [whole]);
        assert!(!empty.exists() && begun.exists() && old.iter().chain(&others).all(|path| path.exists()));
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(watch.finished(), Vec::<PathBuf>::new(), "a folder that is gone holds nothing");
    }
}
