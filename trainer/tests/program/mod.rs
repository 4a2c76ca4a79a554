//! The program as a user runs it, and files for it to read.

// Each test program uses its own part of this.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod paper_run;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use model::rig::Rig;

pub fn trainer() -> Command {
    Command::new(env!("CARGO_BIN_EXE_trainer"))
}

/// Words of a run and its end.
pub struct Said {
    pub out: String,
    pub err: String,
    pub status: i32,
}

impl From<Output> for Said {
    fn from(output: Output) -> Self {
        Said {
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
            status: output.status.code().expect("ended by a signal"),
        }
    }
}

pub fn run<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(args: I) -> Said {
    trainer().args(args).output().unwrap().into()
}

/// Runs what must end well, and gives its standard output.
#[track_caller]
pub fn sound<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(args: I) -> String {
    let said = run(args);
    assert_eq!(said.status, 0, "{}", said.err);
    said.out
}

/// Answer of a sound run with `--json`.
#[track_caller]
pub fn json(args: &[&str]) -> serde_json::Value {
    serde_json::from_str(&sound(args)).unwrap()
}

/// Runs what must be refused as bad input: status 2, one or two lines on standard error, nothing on standard output.
#[track_caller]
pub fn refused<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(args: I) -> String {
    let said = run(args);
    assert_eq!(said.status, 2, "{}{}", said.out, said.err);
    assert!((1..=2).contains(&said.err.lines().count()), "{}", said.err);
    assert!(said.err.lines().all(|line| line.starts_with("trainer: ")), "{}", said.err);
    assert_eq!(said.out, "");
    said.err
}

/// A folder of its own for a test, gone with it.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("trainer-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Folder(folder)
    }

    pub fn path(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().to_owned()
    }

    pub fn with(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// Settings of a run as a file, `RIG` in them [`Folder::coarse_rig`].
    pub fn settings(&self, name: &str, text: impl AsRef<str>) -> String {
        self.with(name, text.as_ref().replace("RIG", &self.coarse_rig()))
    }

    /// Writes [`coarse`], with which flights for a learning curve, most of a small run, take a quarter of the time.
    pub fn coarse_rig(&self) -> String {
        self.with("coarse.toml", coarse().to_toml().unwrap())
    }
}

/// The paper's rig in steps of 0.4 ms, a quarter of the work: pressures within 0.1 kPa of those in steps of 0.1 ms.
pub fn coarse() -> Rig {
    let mut rig = Rig::builtin("dual_pressure").unwrap();
    rig.integrator.step_ms = 0.4;
    rig
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A CSV file by column.
pub struct Csv {
    pub header: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

impl Csv {
    pub fn read(path: impl AsRef<Path>) -> Self {
        let text = std::fs::read_to_string(path).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let header = lines.next().unwrap();
        Csv { header, rows: lines.collect() }
    }

    pub fn texts(&self, name: &str) -> Vec<&str> {
        let at = self.header.iter().position(|column| column == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows.iter().map(|row| row[at].as_str()).collect()
    }

    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.texts(name).iter().map(|cell| cell.parse().unwrap()).collect()
    }
}

/// A folder beside the repository, or elsewhere if the variable says so; `None`, told on the test's output, without it.
pub fn elsewhere(variable: &str, beside: &str) -> Option<PathBuf> {
    let path = std::env::var_os(variable)
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(beside), PathBuf::from);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: no {}; set {variable} to it", path.display());
    None
}
