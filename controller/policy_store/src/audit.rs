//! Who did what to which policy: one JSON object a line, each with the SHA-256 of the line before it.
//!
//! The file stands beside the recordings and is only ever appended to. A line that was taken out or changed shows at the
//! next one; the file proves nothing against somebody who rewrites all of it.

use std::collections::VecDeque;
use std::fs::OpenOptions;
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use proto::recording::rfc3339;
use serde_json::json;

/// Most of a file that is read for its last line, in bytes.
const MOST_TAIL_BYTES: u64 = 64 << 10;
/// Lines that are kept while the file cannot be written (chosen: a day of a busy laboratory).
const MOST_OWED: usize = 1_000;

/// The audit record of a daemon.
#[derive(Debug)]
pub struct Audit {
    file: PathBuf,
    last: String,
    /// Lines that could not be written yet, the oldest first.
    owed: VecDeque<String>,
}

impl Audit {
    /// Goes on in `file`, which need not be there yet.
    pub fn open(file: PathBuf) -> Self {
        let last = last_line(&file).map_or_else(String::new, |line| policy::hash(line.as_bytes()).to_string());
        Audit { file, last, owed: VecDeque::new() }
    }

    /// Appends a line, behind those that could not be written before it.
    ///
    /// # Errors
    /// What the system said, with the file; the line is kept and written as soon as that goes ([`Audit::catch_up`]).
    pub fn note(&mut self, who: &str, what: &str, policy: &str, sha256: &str, detail: &str) -> Result<(), String> {
        let line = json!({
            "time": rfc3339(SystemTime::now()),
            "who": who,
            "what": what,
            "policy": policy,
            "sha256": sha256,
            "detail": detail,
            "previous": self.last,
        })
        .to_string();
        self.last = policy::hash(line.as_bytes()).to_string();
        if self.owed.len() < MOST_OWED {
            self.owed.push_back(line);
        }
        self.catch_up()
    }

    /// Lines that wait to be written.
    pub fn owed(&self) -> usize {
        self.owed.len()
    }

    /// Writes the lines that wait.
    ///
    /// # Errors
    /// What the system said, with the file.
    pub fn catch_up(&mut self) -> Result<(), String> {
        while let Some(line) = self.owed.front() {
            let written = OpenOptions::new()
                .append(true)
                .create(true)
                .mode(0o640)
                .open(&self.file)
                .and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()));
            written.map_err(|error| format!("{}: cannot be written: {error}", self.file.display()))?;
            self.owed.pop_front();
        }
        Ok(())
    }
}

fn last_line(file: &Path) -> Option<String> {
    use std::io::{Read, Seek, SeekFrom};
    let mut file = std::fs::File::open(file).ok()?;
    let length = file.metadata().ok().filter(std::fs::Metadata::is_file)?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(MOST_TAIL_BYTES))).ok()?;
    let mut tail = Vec::new();
    file.take(MOST_TAIL_BYTES).read_to_end(&mut tail).ok()?;
    let text = String::from_utf8_lossy(&tail).into_owned();
    text.lines().next_back().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_could_not_be_written_is_written_once_that_goes() {
        let folder = std::env::temp_dir().join(format!("audit-owed-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let file = folder.join("audit.jsonl");
        let mut audit = Audit::open(file.clone());
        assert!(audit.note("alice", "swap", "a", "ff", "").unwrap_err().contains("audit.jsonl"), "there is no folder");
        assert!(audit.note("bob", "swap", "b", "ee", "").is_err());
        assert_eq!(audit.owed(), 2);
        std::fs::create_dir(&folder).unwrap();
        audit.catch_up().unwrap();
        audit.note("carol", "rollback", "a", "ff", "").unwrap();
        let text = std::fs::read_to_string(&file).unwrap();
        let who: Vec<String> = text
            .lines()
            .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["who"].as_str().unwrap().to_owned())
            .collect();
        assert_eq!((who.as_slice(), audit.owed()), (["alice", "bob", "carol"].map(String::from).as_slice(), 0));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn each_line_names_the_one_before_it_also_after_a_restart() {
        let file = std::env::temp_dir().join(format!("audit-{}.jsonl", std::process::id()));
        let _ = std::fs::remove_file(&file);
        let mut audit = Audit::open(file.clone());
        audit.note("alice (uid 1000, pid 1)", "swap", "a", "ff", "").unwrap();
        audit.note("follow", "swap", "b", "ee", "").unwrap();
        Audit::open(file.clone()).note("bob", "rollback", "a", "ff", "\"quoted\"\nand broken").unwrap();
        let text = std::fs::read_to_string(&file).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3, "{text}");
        let mut before = String::new();
        for line in lines {
            let object: serde_json::Value = serde_json::from_str(line).unwrap();
            assert_eq!(object["previous"], before.as_str());
            before = policy::hash(line.as_bytes()).to_string();
        }
        std::fs::remove_file(&file).unwrap();
    }
}
