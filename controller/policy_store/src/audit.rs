//! Audit of who did what to which policy: one JSON object a line, each with the SHA-256 of the line before it.
//!
//! The file stands beside the recordings and is only ever appended to, by a thread of its own: a disk that does not answer
//! holds nobody who has something to note. What cannot be written waits, and is told ([`Audit::problem`]). A line that was
//! taken out or changed shows at the next one; the file proves nothing against somebody who rewrites all of it.

use std::collections::VecDeque;
use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use proto::recording::rfc3339;
use proto::regular_file;
use serde_json::json;

use crate::locked;

/// Most of a file that is read for its last line, in bytes.
const MOST_TAIL_BYTES: u64 = 64 << 10;
/// Notes that wait while the file cannot be written (chosen: a day of a busy laboratory).
const MOST_WAITING: usize = 1_000;
/// Time after which a disk that works on a note counts as one that does not answer.
const SLOW: Duration = Duration::from_secs(1);
/// Time from a note that could not be written to the next try.
const RETRY: Duration = Duration::from_secs(1);
/// Between two looks whether all is written.
const LOOK: Duration = Duration::from_millis(5);
/// Between two looks of the thread while nothing is to be written; it is woken by each note.
const IDLE: Duration = Duration::from_secs(3600);

/// A note on a policy.
#[derive(Debug, Clone, PartialEq)]
struct Note {
    at: SystemTime,
    who: String,
    what: String,
    policy: String,
    sha256: String,
    detail: String,
}

/// The audit record of a daemon; cheap to clone. Once the last handle is dropped, what waits is written and the thread ends.
#[derive(Debug, Clone)]
pub struct Audit {
    handle: Arc<Handle>,
}

#[derive(Debug)]
struct Handle {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    file: PathBuf,
    queue: Mutex<Queue>,
    news: Condvar,
}

#[derive(Debug, Default)]
struct Queue {
    /// Notes that are not written yet, the oldest first.
    waiting: VecDeque<Note>,
    /// Notes that found no room.
    lost: u64,
    /// Reason why the oldest could not be written.
    problem: Option<String>,
    /// Since when the oldest is being written.
    at_work: Option<Instant>,
    /// Time at which it is tried again after it could not be.
    again_at: Option<Instant>,
    is_closed: bool,
}

impl Audit {
    /// Goes on in `file`, which need not be there yet and is not touched here.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(file: PathBuf) -> io::Result<Self> {
        let mut chain = Chain::default();
        let path = file.clone();
        Self::start_writing(file, move |note| chain.append(&path, note))
    }

    /// As [`Audit::start`], with something else that writes.
    fn start_writing(
        file: PathBuf,
        mut write: impl FnMut(&Note) -> io::Result<()> + Send + 'static,
    ) -> io::Result<Self> {
        let shared = Arc::new(Shared { file, queue: Mutex::default(), news: Condvar::new() });
        let handle = Arc::new(Handle { shared: Arc::clone(&shared) });
        std::thread::Builder::new().name("audit".to_owned()).spawn(move || {
            while let Some(note) = shared.next() {
                let written = write(&note);
                shared.settle(written);
            }
        })?;
        Ok(Audit { handle })
    }

    /// Notes something; it waits for nothing, and one that finds too many waiting is counted.
    pub fn note(&self, who: &str, what: &str, policy: &str, sha256: &str, detail: &str) {
        let [who, what, policy, sha256, detail] = [who, what, policy, sha256, detail].map(str::to_owned);
        self.handle.shared.put(Note { at: SystemTime::now(), who, what, policy, sha256, detail });
    }

    /// Waits until all that was noted is written, or cannot be, for so long at most: before the end of a daemon.
    pub fn settle(&self, most: Duration) {
        let until = Instant::now() + most;
        let queue = &self.handle.shared.queue;
        locked(queue).tell_lost();
        self.handle.shared.news.notify_all();
        let is_over = |queue: &Queue| queue.waiting.is_empty() || queue.problem.is_some();
        while !is_over(&locked(queue)) && Instant::now() < until {
            std::thread::sleep(LOOK);
        }
    }

    /// Problem of the file, one line: it cannot be written, or the disk does not answer.
    pub fn problem(&self) -> Option<String> {
        let Shared { file, queue, .. } = &*self.handle.shared;
        let queue = locked(queue);
        let why = match (&queue.problem, queue.at_work) {
            (Some(problem), _) => problem.clone(),
            (None, Some(since)) if since.elapsed() > SLOW => "the disk does not answer".to_owned(),
            _ => return None,
        };
        let lost = if queue.lost > 0 { format!(", {} more are lost", queue.lost) } else { String::new() };
        Some(format!(
            "{}: who did what cannot be written: {why}; {} lines wait{lost}, and are written once it can be",
            file.display(),
            queue.waiting.len()
        ))
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        locked(&self.shared.queue).is_closed = true;
        self.shared.news.notify_all();
    }
}

impl Queue {
    /// Notes that some found no room, behind those that did.
    fn tell_lost(&mut self) {
        let lost = std::mem::take(&mut self.lost);
        if lost > 0 {
            self.waiting.push_back(Note {
                at: SystemTime::now(),
                who: "daemon".to_owned(),
                what: "lines lost".to_owned(),
                policy: String::new(),
                sha256: String::new(),
                detail: format!("{lost} lines found no room while this file could not be written"),
            });
        }
    }
}

impl Shared {
    fn put(&self, note: Note) {
        let mut queue = locked(&self.queue);
        if queue.waiting.len() >= MOST_WAITING {
            queue.lost += 1;
            return;
        }
        queue.tell_lost();
        queue.waiting.push_back(note);
        drop(queue);
        self.news.notify_all();
    }

    /// Waits for the next note to write; `None` once there is none and will be none, or what is left cannot be written.
    fn next(&self) -> Option<Note> {
        let mut queue = locked(&self.queue);
        loop {
            if queue.is_closed && (queue.problem.is_some() || queue.waiting.is_empty()) {
                return None;
            }
            // After one that failed, whatever else is noted meanwhile.
            let pause = queue.again_at.map_or(Duration::ZERO, |at| at.saturating_duration_since(Instant::now()));
            if pause.is_zero()
                && let Some(note) = queue.waiting.front().cloned()
            {
                queue.at_work = Some(Instant::now());
                return Some(note);
            }
            let time = if pause.is_zero() { IDLE } else { pause };
            queue = self.news.wait_timeout(queue, time).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn settle(&self, written: io::Result<()>) {
        let mut queue = locked(&self.queue);
        queue.at_work = None;
        queue.again_at = written.is_err().then(|| Instant::now() + RETRY);
        queue.problem = written.err().map(|error| error.to_string());
        if queue.problem.is_none() {
            queue.waiting.pop_front();
        }
    }
}

/// The hashes that hold the lines of a file together.
#[derive(Debug, Default)]
struct Chain {
    /// Hash of the last line, empty before the first; `None` until the file was looked at.
    last: Option<String>,
}

impl Chain {
    /// Appends a note as a line. What was left unfinished at the end, by a power cut or a full disk, is a line of its own.
    fn append(&mut self, path: &Path, note: &Note) -> io::Result<()> {
        let mut file = open(path)?;
        let (line, ending) = last_line(&mut file)?;
        if ending == Ending::Unfinished {
            file.write_all(b"\n")?;
        }
        if ending == Ending::Unfinished || self.last.is_none() {
            self.last = Some(line.map_or_else(String::new, |line| policy::hash(&line).to_string()));
        }
        let mut line = json!({
            "time": rfc3339(note.at),
            "who": note.who,
            "what": note.what,
            "policy": note.policy,
            "sha256": note.sha256,
            "detail": note.detail,
            "previous": self.last,
        })
        .to_string();
        let hash = policy::hash(line.as_bytes()).to_string();
        line.push('\n');
        file.write_all(line.as_bytes())?;
        self.last = Some(hash);
        Ok(())
    }
}

/// Opens a regular file to be read and appended to, made if it is not there: a pipe or a device is refused at once.
fn open(path: &Path) -> io::Result<File> {
    let check = |about: Metadata| {
        let refused = || io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file; move it away");
        if about.is_file() { Ok(()) } else { Err(refused()) }
    };
    // Opening a device may act on it.
    if let Ok(about) = std::fs::metadata(path) {
        check(about)?;
    }
    let mut options = OpenOptions::new();
    options.read(true).append(true).create(true).mode(0o640);
    let file = regular_file::without_waiting(&mut options).open(path)?;
    check(file.metadata()?)?;
    Ok(file)
}

/// State of a file's last line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ending {
    Finished,
    Unfinished,
}

/// The last line of a file, without its end; `None` where there is none.
fn last_line(file: &mut File) -> io::Result<(Option<Vec<u8>>, Ending)> {
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(MOST_TAIL_BYTES)))?;
    let mut tail = Vec::new();
    file.take(MOST_TAIL_BYTES).read_to_end(&mut tail)?;
    if tail.is_empty() {
        return Ok((None, Ending::Finished));
    }
    let ending = if tail.ends_with(b"\n") { Ending::Finished } else { Ending::Unfinished };
    let lines = tail.strip_suffix(b"\n").unwrap_or(&tail);
    Ok((lines.rsplit(|byte| *byte == b'\n').next().map(<[u8]>::to_vec), ending))
}

#[cfg(test)]
mod tests;
