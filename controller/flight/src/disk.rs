//! Room on the disk, and what of old recordings is kept.

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use rustix::fs::statvfs;

/// A recording that was cut off is only removed once nobody has written to it for this long: it may be another
/// daemon's, at work in the same folder. Chosen: a day.
const LEFT_ALONE: Duration = Duration::from_secs(86_400);

/// A file that seems to be written so far ahead of now is of a time when the clock was wrong: nobody knows how old it is.
/// Chosen: a day, above what the clocks of a file server and of this machine differ by.
const CLOCK_WAS_WRONG: Duration = Duration::from_secs(86_400);

/// The date by which recordings are old: as this machine says, but never later than by the time that has passed since the
/// start, so that a clock that is set forward while the daemon runs makes no recording old.
#[derive(Debug, Clone, Copy)]
pub struct RetentionClock {
    date: SystemTime,
    since: Instant,
}

impl RetentionClock {
    /// A clock that goes from now on.
    pub fn start() -> Self {
        RetentionClock { date: SystemTime::now(), since: Instant::now() }
    }

    /// The date to go by.
    pub fn now(&self) -> SystemTime {
        self.earlier(SystemTime::now(), self.since.elapsed())
    }

    fn earlier(&self, shown: SystemTime, passed: Duration) -> SystemTime {
        self.date.checked_add(passed).map_or(shown, |counted| counted.min(shown))
    }
}

/// Bytes that this process may still write where `path` is; `None` if the system does not tell.
pub fn free_bytes(path: &Path) -> Option<u64> {
    let about = statvfs(path).ok()?;
    Some(about.f_bavail.saturating_mul(about.f_frsize))
}

/// Makes a folder for recordings, and those above it, where they are not there. Nobody but its owner and its group finds anything
/// in it, as nobody else reads a recording, whatever the umask.
///
/// # Errors
/// If it cannot be made.
pub fn make_folder(directory: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(0o750).create(directory)
}

/// Limits on old recordings that are kept; 0 keeps everything.
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
        // Newest first: what is kept is counted from there. What was written while the clock was far ahead is older than
        // whatever has been written since that was mended.
        let ahead = |file: &Found| file.modified.duration_since(now).is_ok_and(|ahead| ahead > CLOCK_WAS_WRONG);
        found.sort_by_key(|file| std::cmp::Reverse((!ahead(file), file.modified, file.path.clone())));
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
            // Written after now is written just now, by a file server whose clock is ahead.
            if unfinished && !now.duration_since(modified).is_ok_and(|age| age >= LEFT_ALONE) {
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

    /// A folder with one recording of 100 bytes for each of these ages in days; those ahead of now have negative ones.
    fn folder(name: &str, now: SystemTime, ages_days: &[(&str, i64)]) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("retention-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        for (name, days) in ages_days {
            let path = folder.join(name);
            std::fs::write(&path, [0; 100]).unwrap();
            let away = Duration::from_secs(days.unsigned_abs() * 86_400);
            let modified = if *days < 0 { now + away } else { now - away };
            File::options().write(true).open(&path).unwrap().set_modified(modified).unwrap();
        }
        folder
    }

    fn left(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_clock_that_is_set_makes_no_recording_old() {
        let clock = RetentionClock::start();
        let hour = Duration::from_secs(3_600);
        // Ten years forward after an hour, and a year back.
        assert_eq!(clock.earlier(clock.date + hour * 87_600, hour), clock.date + hour);
        assert_eq!(clock.earlier(clock.date - hour * 8_760, hour), clock.date - hour * 8_760);
        assert_eq!(clock.earlier(clock.date + hour, hour), clock.date + hour);
    }

    #[test]
    fn what_was_written_while_the_clock_was_ahead_goes_before_what_came_since() {
        let now = SystemTime::now();
        let names =
            [("run-20990101-000001.mcap", -26_000), ("run-20261101-000001.mcap", 3), ("run-20261104-000001.mcap", 0)];
        let folder = folder("ahead", now, &names);
        Retention { days: 0, bytes: 250 }.apply(&folder, &["run"], now);
        assert_eq!(left(&folder), ["run-20261101-000001.mcap", "run-20261104-000001.mcap"]);
        // The clock is set back by twenty years: everything is ahead, and what is written from then on is the newest.
        let back = now - Duration::from_secs(20 * 365 * 86_400);
        std::fs::write(folder.join("run-20061104-000001.mcap"), [0; 100]).unwrap();
        File::options().write(true).open(folder.join("run-20061104-000001.mcap")).unwrap().set_modified(back).unwrap();
        Retention { days: 1, bytes: 250 }.apply(&folder, &["run"], back);
        assert_eq!(left(&folder), ["run-20061104-000001.mcap", "run-20261104-000001.mcap"]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn an_unfinished_recording_that_is_dated_ahead_is_somebodys_at_work() {
        let now = SystemTime::now();
        let folder = folder("server", now - Duration::from_secs(5), &[("run-20261101-000001.partial.mcap", 0)]);
        Retention { days: 1, bytes: 10 }.apply(&folder, &["run"], now - Duration::from_secs(10));
        assert_eq!(left(&folder).len(), 1);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn the_disk_tells_how_much_room_it_has() {
        assert!(free_bytes(&std::env::temp_dir()).is_some_and(|bytes| bytes > 0));
        assert_eq!(free_bytes(Path::new("/nowhere/at/all")), None);
    }
}
