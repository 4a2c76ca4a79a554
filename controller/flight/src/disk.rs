//! Room on the disk, and what of old recordings is kept.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rustix::fs::statvfs;

/// A recording that was cut off is only removed once nobody has written to it for this long: it may be another
/// daemon's, at work in the same folder. Chosen: a day.
const LEFT_ALONE: Duration = Duration::from_secs(86_400);

/// Bytes that this process may still write where `path` is; `None` if the system does not tell.
pub fn free_bytes(path: &Path) -> Option<u64> {
    let about = statvfs(path).ok()?;
    Some(about.f_bavail.saturating_mul(about.f_frsize))
}

/// What is kept of old recordings; 0 keeps everything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Retention {
    /// Days after which a recording is removed.
    pub days: u64,
    /// Bytes that all recordings together may have; the oldest go first.
    pub bytes: u64,
}

impl Retention {
    /// Removes what is too old or too much of the recordings with one of these stems in the folder; returns what went.
    ///
    /// Only files named `STEM-YYYYMMDD-HHMMSS….mcap` count, so that nothing a person named himself is ever touched.
    pub fn apply(&self, directory: &Path, stems: &[&str], now: SystemTime) -> Vec<PathBuf> {
        if *self == Retention::default() {
            return Vec::new();
        }
        let mut found = recordings(directory, stems, now);
        // Newest first: what is kept is counted from there.
        found.sort_by_key(|file| std::cmp::Reverse((file.modified, file.path.clone())));
        let oldest = now.checked_sub(Duration::from_secs(self.days.saturating_mul(86_400)));
        let mut total = 0_u64;
        let mut gone = Vec::new();
        for file in found {
            total = total.saturating_add(file.bytes);
            let too_old = self.days > 0 && oldest.is_some_and(|oldest| file.modified < oldest);
            let too_much = self.bytes > 0 && total > self.bytes;
            if (too_old || too_much) && std::fs::remove_file(&file.path).is_ok() {
                gone.push(file.path);
            }
        }
        gone
    }
}

struct Found {
    path: PathBuf,
    modified: SystemTime,
    bytes: u64,
}

fn recordings(directory: &Path, stems: &[&str], now: SystemTime) -> Vec<Found> {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let unfinished = name.ends_with(".partial.mcap");
            if !stems.iter().any(|stem| is_ours(&name, stem)) {
                return None;
            }
            // Not through a link: only what lies in the folder itself.
            let about = entry.metadata().ok().filter(std::fs::Metadata::is_file)?;
            let modified = about.modified().ok()?;
            if unfinished && now.duration_since(modified).is_ok_and(|age| age < LEFT_ALONE) {
                return None;
            }
            Some(Found { path: entry.path(), modified, bytes: about.len() })
        })
        .collect()
}

/// `STEM-YYYYMMDD-HHMMSS`, perhaps a number, then `.mcap` or `.partial.mcap`.
fn is_ours(name: &str, stem: &str) -> bool {
    let Some(rest) = name.strip_prefix(stem).and_then(|rest| rest.strip_prefix('-')) else { return false };
    let Some(rest) = rest.strip_suffix(".mcap") else { return false };
    let rest = rest.strip_suffix(".partial").unwrap_or(rest);
    let mut parts = rest.split('-');
    let digits = |part: Option<&str>, length: usize| {
        part.is_some_and(|p| p.len() == length && p.bytes().all(|b| b.is_ascii_digit()))
    };
    digits(parts.next(), 8)
        && digits(parts.next(), 6)
        && parts.next().is_none_or(|number| number.bytes().all(|b| b.is_ascii_digit()))
        && parts.next().is_none()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;

    #[test]
    fn only_names_of_our_own_making_count() {
        for name in ["run-20261127-084101.mcap", "run-20261127-084101-2.mcap", "run-20261127-084101.partial.mcap"] {
            assert!(is_ours(name, "run"), "{name}");
        }
        for name in [
            "run.mcap",
            "run-best.mcap",
            "run-20261127-0841.mcap",
            "run-20261127-084101.csv",
            "run-20261127-084101-a.mcap",
            "prerun-20261127-084101.mcap",
        ] {
            assert!(!is_ours(name, "run"), "{name}");
        }
    }

    #[test]
    fn the_oldest_go_first_and_nothing_else() {
        let folder = std::env::temp_dir().join(format!("retention-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let now = SystemTime::now();
        let day = Duration::from_secs(86_400);
        for (name, days) in [
            ("run-20260101-000001.mcap", 9),
            ("run-20260101-000002.mcap", 4),
            ("run-20260101-000003.mcap", 2),
            ("run-20260101-000004.mcap", 0),
            ("run-20260101-000005.partial.mcap", 0),
            ("mine.mcap", 99),
        ] {
            let path = folder.join(name);
            std::fs::write(&path, [0; 100]).unwrap();
            let modified = now.checked_sub(day * days).unwrap();
            File::options().write(true).open(&path).unwrap().set_modified(modified).unwrap();
        }
        let names = |gone: Vec<PathBuf>| {
            let mut names: Vec<String> =
                gone.iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect();
            names.sort();
            names
        };
        assert!(Retention::default().apply(&folder, &["run"], now).is_empty(), "everything is kept by default");
        let week = Retention { days: 7, bytes: 0 };
        assert_eq!(names(week.apply(&folder, &["run"], now)), ["run-20260101-000001.mcap"]);
        let small = Retention { days: 0, bytes: 200 };
        assert_eq!(names(small.apply(&folder, &["run"], now)), ["run-20260101-000002.mcap"]);
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 4);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn the_disk_tells_how_much_room_it_has() {
        assert!(free_bytes(&std::env::temp_dir()).is_some_and(|bytes| bytes > 0));
        assert_eq!(free_bytes(Path::new("/nowhere/at/all")), None);
    }
}
