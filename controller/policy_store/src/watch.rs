//! Files of a directory that are whole.
//!
//! A publisher writes under another name (`.tmp`, a dot in front) and renames. Not everybody does, and a network file
//! system tells nobody of a rename on another machine; so the directory is read once a second, and a file counts when
//! two readings in a row found the same inode, size and times. The time of its entry's change is among them, which no program
//! can set: content that was put in place of other content of the same length and date shows there. A copy that pauses for longer
//! is told by what it holds: the store waits for a file that ends too early ([`crate::store`]). How long a file has stood still
//! is measured here, by a clock that nobody sets: a file server has another date than this machine. A signature that comes or
//! changes beside a file has the file looked at again.

use std::collections::HashMap;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use admission::signature::signature_file;

use crate::desk::FALLBACK;

/// Ending of policies.
pub const ENDING: &str = "onnx";
/// Most names that are looked at: a directory of a million files must not hold anybody up.
const MOST_NAMES: usize = 4096;

/// Look of a file from outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Look {
    inode: u64,
    size: u64,
    /// Time at which it was last written, as the writer wants it to be known: s and ns.
    written: (i64, i64),
    /// Time at which it was last changed in any way, by its file system: s and ns.
    changed: (i64, i64),
    mode: u32,
}

impl Look {
    /// Looks at a name, without following links and without opening anything.
    pub fn at(path: &Path) -> Option<Self> {
        let about = std::fs::symlink_metadata(path).ok()?;
        Some(Look {
            inode: about.ino(),
            size: about.size(),
            written: (about.mtime(), about.mtime_nsec()),
            changed: (about.ctime(), about.ctime_nsec()),
            mode: about.mode(),
        })
    }
}

/// A file that has come to rest.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settled {
    /// Name without `.onnx`.
    pub name: String,
    /// Path.
    pub path: PathBuf,
    /// Look of the file.
    pub look: Look,
    /// Time at which it was first seen to look so.
    pub since: Instant,
}

impl Settled {
    /// For how long it has been seen to stand still.
    pub fn at_rest(&self) -> Duration {
        self.since.elapsed()
    }
}

/// Watches a directory.
#[derive(Debug)]
pub struct Watcher {
    directory: PathBuf,
    /// Device and number of the folder, once it was there.
    folder: Option<(u64, u64)>,
    known: HashMap<String, Known>,
}

#[derive(Debug, Clone, Copy)]
struct Known {
    look: Look,
    /// The look of its signature, where there is one: no part of what the file is.
    signature: Option<Look>,
    /// Time at which it was first seen to look so.
    since: Instant,
    /// True where it has been handed out as it is now.
    handed: bool,
}

/// Findings of a reading of the directory.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reading {
    /// Files that have come to rest since the last reading, the one written last at the end.
    pub settled: Vec<Settled>,
    /// Names that are no longer there.
    pub gone: Vec<String>,
    /// The first file, by name, that would be a policy but for its name.
    pub misnamed: Option<String>,
    /// True where another folder has taken the place of the one that was read before.
    pub is_another_folder: bool,
    /// Reason why the directory cannot be read, or not to its end.
    pub problem: Option<String>,
}

impl Watcher {
    /// Watches `directory`, which need not be there yet.
    pub fn new(directory: PathBuf) -> Self {
        Watcher { directory, folder: None, known: HashMap::new() }
    }

    /// The directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Reads the directory; to be called once a second.
    pub fn read(&mut self) -> Reading {
        let mut reading = Reading::default();
        let mut entries = match std::fs::read_dir(&self.directory) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let mut reading = self.all_gone();
                // Before it was first there nobody had published anything yet.
                reading.problem = self.folder.map(|_| {
                    format!("{}: the folder is gone; make it again to publish policies", self.directory.display())
                });
                return reading;
            }
            Err(error) => {
                reading.problem = Some(format!("{}: cannot be read: {error}", self.directory.display()));
                return reading;
            }
        };
        let folder = std::fs::metadata(&self.directory).ok().map(|about| (about.dev(), about.ino()));
        reading.is_another_folder = self.folder.is_some() && folder.is_some() && folder != self.folder;
        self.folder = folder.or(self.folder);
        let mut seen = HashMap::new();
        for entry in entries.by_ref().take(MOST_NAMES) {
            let path = match entry {
                Ok(entry) => entry.path(),
                Err(error) => {
                    reading.problem = Some(format!("{}: cannot be read to its end: {error}", self.directory.display()));
                    break;
                }
            };
            match (policy_name(&path), Look::at(&path)) {
                (Some(name), Some(look)) => drop(seen.insert(name, (path, look))),
                (None, Some(_)) if is_published(&path) => {
                    let name = path.file_name().unwrap_or_default().to_string_lossy().escape_debug().to_string();
                    reading.misnamed = Some(reading.misnamed.take().map_or(name.clone(), |first| first.min(name)));
                }
                _ => {}
            }
        }
        if reading.problem.is_none() && entries.next().is_some() {
            reading.problem = Some(format!(
                "{}: it holds more than {MOST_NAMES} names, of which no more are looked at; move old ones elsewhere, or a new policy may not be seen",
                self.directory.display()
            ));
        }
        let mut gone: Vec<String> = self.known.keys().filter(|name| !seen.contains_key(*name)).cloned().collect();
        if reading.problem.is_some() {
            // What a reading did not come to need not be gone.
            gone.retain(|name| is_missing(&self.directory.join(format!("{name}.{ENDING}"))));
        }
        self.known.retain(|name, _| !gone.contains(name));
        reading.gone = gone;
        for (name, (path, look)) in seen {
            let signature = Look::at(&signature_file(&path));
            let same_file = self.known.get(&name).copied().filter(|known| known.look == look);
            let since = same_file.map_or_else(Instant::now, |known| known.since);
            let same = same_file.filter(|known| known.signature == signature);
            self.known.insert(name.clone(), Known { look, signature, since, handed: same.is_some() });
            if same.is_some_and(|known| !known.handed) {
                reading.settled.push(Settled { name, path, look, since });
            }
        }
        reading.settled.sort_by_key(|settled| settled.look.written);
        reading.gone.sort();
        reading
    }

    /// Hands a file out again once it has come to rest, although it looks as it did.
    pub fn again(&mut self, name: &str) {
        if let Some(known) = self.known.get_mut(name) {
            known.handed = false;
        }
    }

    fn all_gone(&mut self) -> Reading {
        let mut gone: Vec<String> = self.known.drain().map(|(name, _)| name).collect();
        gone.sort();
        Reading { gone, ..Reading::default() }
    }
}

/// Tells whether nothing stands at a path.
fn is_missing(path: &Path) -> bool {
    path.symlink_metadata().is_err_and(|error| error.kind() == std::io::ErrorKind::NotFound)
}

/// True for a file that is published as a policy, whatever its name is otherwise: not hidden and not under way.
fn is_published(path: &Path) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    path.extension().is_some_and(|ending| ending == ENDING) && !stem.starts_with('.') && !stem.ends_with(".tmp")
}

/// The policy that a name stands for: `NAME.onnx`, without a dot in front, in letters that `swap` takes; `fallback` stands for
/// no policy.
pub fn policy_name(path: &Path) -> Option<String> {
    let stem = path.file_stem()?.to_str()?;
    let sound = !stem.starts_with('.')
        && !stem.is_empty()
        && stem != FALLBACK
        && stem.len() <= 128
        && stem.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c));
    (path.extension()? == ENDING && sound && !stem.ends_with(".tmp")).then(|| stem.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("watch-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn names(reading: &Reading) -> Vec<&str> {
        reading.settled.iter().map(|s| s.name.as_str()).collect()
    }

    #[test]
    fn a_file_counts_once_it_is_at_rest_and_once_only() {
        let folder = folder("rest");
        let mut watcher = Watcher::new(folder.clone());
        let file = folder.join("first.onnx");
        std::fs::write(&file, b"half").unwrap();
        assert!(names(&watcher.read()).is_empty(), "seen for the first time");
        std::fs::write(&file, b"half and the rest").unwrap();
        assert!(names(&watcher.read()).is_empty(), "it has grown meanwhile");
        assert_eq!(names(&watcher.read()), ["first"]);
        assert!(names(&watcher.read()).is_empty(), "handed out once");
        // Published anew under the same name by a rename: another inode.
        std::fs::write(folder.join(".first.onnx.part"), b"half and the rest").unwrap();
        std::fs::rename(folder.join(".first.onnx.part"), &file).unwrap();
        assert!(names(&watcher.read()).is_empty());
        assert_eq!(names(&watcher.read()), ["first"]);
        std::fs::remove_file(&file).unwrap();
        assert_eq!(watcher.read().gone, ["first"]);
        std::fs::remove_dir_all(&folder).unwrap();
        let gone = watcher.read();
        assert!(gone.settled.is_empty() && gone.problem.is_some_and(|told| told.contains("the folder is gone")));
        let mut never_there = Watcher::new(folder);
        assert_eq!(never_there.read(), Reading::default(), "a directory that is not there yet holds nothing");
    }

    /// As `cp -p` or a synchronising program leaves it: the same name, length and date, in the same file.
    #[test]
    fn other_content_of_the_same_length_and_date_is_another_file() {
        let folder = folder("same-date");
        let mut watcher = Watcher::new(folder.clone());
        let file = folder.join("first.onnx");
        std::fs::write(&file, b"one").unwrap();
        let date = std::fs::metadata(&file).unwrap().modified().unwrap();
        watcher.read();
        assert_eq!(names(&watcher.read()), ["first"]);
        std::fs::write(&file, b"two").unwrap();
        std::fs::File::options().write(true).open(&file).unwrap().set_modified(date).unwrap();
        assert!(names(&watcher.read()).is_empty(), "it is seen to have changed");
        assert_eq!(names(&watcher.read()), ["first"]);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// Signed after it was published, as the refusal of one without a signature asks for.
    #[test]
    fn a_signature_that_comes_or_changes_has_its_file_looked_at_again() {
        let folder = folder("signed");
        let mut watcher = Watcher::new(folder.clone());
        let (file, signature) = (folder.join("first.onnx"), folder.join("first.onnx.minisig"));
        std::fs::write(&file, b"one").unwrap();
        watcher.read();
        let unsigned = watcher.read().settled.remove(0);
        for text in ["half a sig", "half a signature, and the rest"] {
            std::fs::write(&signature, text).unwrap();
            assert!(names(&watcher.read()).is_empty(), "it is seen to have changed");
            let again = watcher.read();
            assert_eq!(again.settled, std::slice::from_ref(&unsigned), "the file itself is as it was, {text}");
            assert!(names(&watcher.read()).is_empty(), "handed out once");
        }
        std::fs::remove_file(&signature).unwrap();
        watcher.read();
        assert_eq!(names(&watcher.read()), ["first"], "nor is one that is gone any more what was looked at");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// A file server may be hours ahead or behind: how long a file has stood still is no matter of dates.
    #[test]
    fn how_long_a_file_has_stood_still_is_no_matter_of_its_date() {
        let folder = folder("dated");
        let mut watcher = Watcher::new(folder.clone());
        let file = folder.join("first.onnx");
        std::fs::write(&file, b"half").unwrap();
        let ahead = std::time::SystemTime::now() + Duration::from_secs(7_200);
        std::fs::File::options().write(true).open(&file).unwrap().set_modified(ahead).unwrap();
        watcher.read();
        let settled = watcher.read().settled.remove(0);
        watcher.again("first");
        let again = watcher.read().settled.remove(0);
        assert_eq!(
            (settled.since, &settled.look),
            (again.since, &again.look),
            "it waits on from when it was first seen"
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// A folder that was never tidied: each policy leaves files beside it.
    #[test]
    fn a_folder_with_more_names_than_are_looked_at_is_told_and_what_is_there_is_not_gone() {
        let folder = folder("crowded");
        let mut watcher = Watcher::new(folder.clone());
        std::fs::write(folder.join("first.onnx"), b"one").unwrap();
        watcher.read();
        assert_eq!(names(&watcher.read()), ["first"]);
        // In whatever order the system lists them, some of these policies are beyond what is looked at.
        let crowd: Vec<PathBuf> = (0..=MOST_NAMES).map(|n| folder.join(format!("p{n}.onnx"))).collect();
        crowd.iter().for_each(|file| std::fs::write(file, b"").unwrap());
        let first = watcher.read();
        let crowded = watcher.read();
        for reading in [&first, &crowded] {
            assert!(reading.problem.as_ref().is_some_and(|told| told.contains("more than 4096 names")), "{reading:?}");
            assert!(reading.gone.is_empty(), "{:?}", reading.gone);
        }
        assert!(["p0", "p1", "p2"].iter().any(|name| names(&crowded).contains(name)), "those that are listed go on");
        // What is no longer there is gone all the same.
        std::fs::remove_file(folder.join("first.onnx")).unwrap();
        assert_eq!(watcher.read().gone, ["first"]);
        crowd.iter().for_each(|file| std::fs::remove_file(file).unwrap());
        let tidy = watcher.read();
        assert!(
            tidy.problem.is_none() && tidy.gone.len() >= MOST_NAMES - 1 && !tidy.gone.contains(&"first".to_owned())
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_policy_whose_name_cannot_be_asked_for_is_named() {
        let folder = folder("misnamed");
        for name in ["b c.onnx", "a\nb.onnx", "sound.onnx", ".hidden x.onnx", "x y.tmp.onnx", "notes x.txt"] {
            std::fs::write(folder.join(name), b"x").unwrap();
        }
        let mut watcher = Watcher::new(folder.clone());
        assert_eq!(watcher.read().misnamed.as_deref(), Some("a\\nb.onnx"));
        std::fs::remove_file(folder.join("a\nb.onnx")).unwrap();
        assert_eq!(watcher.read().misnamed.as_deref(), Some("b c.onnx"));
        std::fs::remove_file(folder.join("b c.onnx")).unwrap();
        assert_eq!(watcher.read().misnamed, None);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_is_no_published_policy_is_passed_over() {
        for name in [
            ".hidden.onnx",
            "a.onnx.tmp",
            "x.tmp.onnx",
            "notes.txt",
            "a b.onnx",
            "ü.onnx",
            ".onnx",
            "a.onnx.minisig",
            "fallback.onnx",
        ] {
            assert_eq!(policy_name(Path::new(name)), None, "{name}");
        }
        assert_eq!(policy_name(Path::new("/p/run-3_v1.2.onnx")).as_deref(), Some("run-3_v1.2"));
    }
}
