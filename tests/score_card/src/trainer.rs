//! Runs the program that is judged: by its path, on files, within a time limit.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

/// The program.
#[derive(Debug, Clone, PartialEq)]
pub struct Trainer {
    /// Path.
    pub program: PathBuf,
    /// Rig to start from: a file or a built-in name.
    pub rig: String,
    /// True where `diagnose` is asked to be quick.
    pub quick: bool,
    /// It is ended after this long.
    pub limit: Duration,
}

/// Time and memory of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Took {
    /// Time on the wall (s).
    pub wall_s: f64,
    /// Processor time of all its threads (s), where the system tells it: fairer on a busy machine.
    pub cpu_s: Option<f64>,
}

/// Why a run gave nothing.
#[derive(Debug, thiserror::Error)]
pub enum TrainerError {
    /// It could not be started.
    #[error("{}: cannot be run: {source}; give the path of the trainer that is to be judged", program.display())]
    Start {
        /// The program.
        program: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// It said no.
    #[error("{what} ended with status {status}: {said}")]
    Failed {
        /// The subcommand.
        what: &'static str,
        /// Status.
        status: String,
        /// Last line.
        said: String,
    },
    /// It took too long.
    #[error("{what} was ended after {limit_s:.0} s")]
    TooLong {
        /// The subcommand.
        what: &'static str,
        /// The limit (s).
        limit_s: f64,
    },
}

impl Trainer {
    /// `diagnose`: answers in `out`.
    ///
    /// # Errors
    /// It cannot be started, fails, or takes too long.
    pub fn diagnose(&self, recordings: &[PathBuf], out: &Path) -> Result<Took, TrainerError> {
        let mut arguments: Vec<OsString> = vec!["--rig".into(), self.rig.clone().into()];
        arguments.extend(recordings.iter().map(|file| file.clone().into_os_string()));
        arguments.extend(["--out".into(), out.as_os_str().to_owned(), "--json".into()]);
        if self.quick {
            arguments.push("--quick".into());
        }
        self.run("diagnose", &arguments, out)
    }

    /// `identify`: the parameters alone, fitted; the peer that names nothing.
    ///
    /// # Errors
    /// As [`Trainer::diagnose`].
    pub fn identify(&self, recordings: &[PathBuf], out: &Path) -> Result<Took, TrainerError> {
        let mut arguments: Vec<OsString> = vec!["--rig".into(), self.rig.clone().into()];
        arguments.extend(recordings.iter().map(|file| file.clone().into_os_string()));
        arguments.extend(["--out".into(), out.as_os_str().to_owned(), "--json".into()]);
        self.run("identify", &arguments, out.parent().unwrap_or(Path::new(".")))
    }

    /// `simulate`: a free run of a rig file (or of the rig to start from) under a recording's commands.
    ///
    /// # Errors
    /// As [`Trainer::diagnose`].
    pub fn simulate(&self, rig: Option<&Path>, inputs: &Path, out: &Path) -> Result<Took, TrainerError> {
        let rig = rig.map_or_else(|| self.rig.clone().into(), |rig| rig.as_os_str().to_owned());
        let arguments = [
            "--rig".into(),
            rig,
            "--inputs".into(),
            inputs.as_os_str().to_owned(),
            "--out".into(),
            out.as_os_str().to_owned(),
            "--json".into(),
        ];
        self.run("simulate", &arguments, out.parent().unwrap_or(Path::new(".")))
    }

    fn run(&self, what: &'static str, arguments: &[OsString], folder: &Path) -> Result<Took, TrainerError> {
        let fail = |source| TrainerError::Start { program: self.program.clone(), source };
        fs::create_dir_all(folder).map_err(fail)?;
        let errors = folder.join(format!("{what}.stderr"));
        let mut child = Command::new(&self.program)
            .arg(what)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(File::create(folder.join(format!("{what}.stdout"))).map_err(fail)?)
            .stderr(File::create(&errors).map_err(fail)?)
            .spawn()
            .map_err(fail)?;
        let start = Instant::now();
        let mut cpu_s = None;
        let status = loop {
            cpu_s = processor_time_s(&child).or(cpu_s);
            if let Some(status) = child.try_wait().map_err(fail)? {
                break status;
            }
            if start.elapsed() > self.limit {
                child.kill().map_err(fail)?;
                child.wait().map_err(fail)?;
                return Err(TrainerError::TooLong { what, limit_s: self.limit.as_secs_f64() });
            }
            std::thread::sleep(POLL);
        };
        if status.success() {
            return Ok(Took { wall_s: start.elapsed().as_secs_f64(), cpu_s });
        }
        let said = fs::read_to_string(&errors).unwrap_or_default();
        let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("nothing said").to_owned();
        let status = status.code().map_or_else(|| "signal".to_owned(), |code| code.to_string());
        Err(TrainerError::Failed { what, status, said: last })
    }
}

/// Time between two looks at a run.
const POLL: Duration = Duration::from_millis(25);
/// Clock ticks of `/proc` per second; 100 on every Linux that is built today.
const TICKS_PER_S: f64 = 100.0;

/// User and system time of a process so far, from `/proc` (fields 14 and 15 of `stat`).
fn processor_time_s(child: &Child) -> Option<f64> {
    let stat = fs::read_to_string(format!("/proc/{}/stat", child.id())).ok()?;
    // The name in parentheses may hold blanks.
    let after = stat.rsplit_once(')')?.1;
    let fields: Vec<&str> = after.split_whitespace().collect();
    let ticks: f64 = fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?;
    Some(ticks / TICKS_PER_S)
}
