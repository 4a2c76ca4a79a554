//! The folder of a run.
//!
//! | file | holds |
//! | --- | --- |
//! | `settings.toml` | the settings in force, every key |
//! | `rig.toml`, `model.toml` | what was trained on, and the model behind MPObs |
//! | `metrics.jsonl`, `events.out.tfevents.*` | the learning curve |
//! | `checkpoint.bin`, `replay/` | everything to go on from; replaced as a whole or not at all |
//! | `policy.bin` | the policy of the last checkpoint or of the end |
//! | `policy.onnx` | the same for the daemon, once the run has ended |
//! | `report.html` | the learning curve as a page |
//! | `start.bin` | the policy that a run of `trainer improve` began with |
//! | `summary.json` | figures of the end: steps, time, speed, memory, evaluations |

use std::path::{Path, PathBuf};

use proto::atomic_file;

use crate::TrainingError;
use crate::settings::TrainingSettings;

/// Room that a new run must have (bytes): its first checkpoint, replay and report. Measured: 8.4 and 9.4 MB after 6,000 steps of the
/// presets `correction` and `paper`.
const LEAST_ROOM_BYTES: u64 = 12 << 20;

/// The folder of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunFiles {
    folder: PathBuf,
}

impl RunFiles {
    /// The folder of a new run.
    ///
    /// # Errors
    /// If it cannot be made or written, or holds a run or a file of one already: nothing is overwritten, and nothing old is
    /// left to be taken for new.
    pub fn create(folder: &Path) -> Result<Self, TrainingError> {
        let files = RunFiles { folder: folder.to_owned() };
        let problem = |problem: String| TrainingError::File { file: folder.display().to_string(), problem };
        if files.checkpoint().exists() {
            return Err(problem("holds a run already; go on with --resume, or give --out another folder".into()));
        }
        if let Some(old) = files.outputs().into_iter().find(|path| path.exists()) {
            let name = old.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Err(problem(format!(
                "holds {name} of an older run already; give --out another folder, or remove what is in it"
            )));
        }
        proto::output::check_folder(folder, LEAST_ROOM_BYTES)?;
        std::fs::create_dir_all(folder).map_err(|error| problem(format!("cannot be made: {error}")))?;
        Ok(files)
    }

    /// The names in a folder that may not be there yet.
    pub(crate) fn at(folder: &Path) -> Self {
        RunFiles { folder: folder.to_owned() }
    }

    /// Every file that a run writes.
    fn outputs(&self) -> [PathBuf; 12] {
        [
            self.settings(),
            self.rig(),
            self.model(),
            self.metrics(),
            self.events(),
            self.replay(),
            self.checkpoint(),
            self.policy(),
            self.start(),
            self.onnx(),
            self.report(),
            self.summary(),
        ]
    }

    /// The folder of a run that was begun.
    ///
    /// # Errors
    /// If there is no checkpoint in it.
    pub fn open(folder: &Path) -> Result<Self, TrainingError> {
        let files = RunFiles { folder: folder.to_owned() };
        if !files.checkpoint().is_file() {
            return Err(TrainingError::File {
                file: files.checkpoint().display().to_string(),
                problem: "is not there; --resume takes the folder of a run that has written a checkpoint".into(),
            });
        }
        Ok(files)
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The settings in force.
    pub fn settings(&self) -> PathBuf {
        self.folder.join("settings.toml")
    }

    /// File of the rig that was trained on.
    pub fn rig(&self) -> PathBuf {
        self.folder.join("rig.toml")
    }

    /// The model behind MPObs.
    pub fn model(&self) -> PathBuf {
        self.folder.join("model.toml")
    }

    /// The learning curve.
    pub fn metrics(&self) -> PathBuf {
        self.folder.join("metrics.jsonl")
    }

    /// The learning curve for TensorBoard.
    pub fn events(&self) -> PathBuf {
        self.folder.join("events.out.tfevents.training")
    }

    /// Everything to go on from.
    pub fn checkpoint(&self) -> PathBuf {
        self.folder.join("checkpoint.bin")
    }

    /// The replay's rows, in pieces.
    pub fn replay(&self) -> PathBuf {
        self.folder.join("replay")
    }

    /// The policy.
    pub fn policy(&self) -> PathBuf {
        self.folder.join("policy.bin")
    }

    /// The policy that the run began with.
    pub fn start(&self) -> PathBuf {
        self.folder.join("start.bin")
    }

    /// The policy for the daemon.
    pub fn onnx(&self) -> PathBuf {
        self.folder.join("policy.onnx")
    }

    /// The page.
    pub fn report(&self) -> PathBuf {
        self.folder.join("report.html")
    }

    /// Figures of the end.
    pub fn summary(&self) -> PathBuf {
        self.folder.join("summary.json")
    }

    /// Reads the settings of a run that was begun.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn read_settings(&self) -> Result<TrainingSettings, TrainingError> {
        let path = self.settings();
        let text = std::fs::read_to_string(&path).map_err(|error| TrainingError::File {
            file: path.display().to_string(),
            problem: format!("cannot be read: {error}"),
        })?;
        TrainingSettings::parse(&path.display().to_string(), &text)
    }

    /// Writes a file of the run as a whole or not at all.
    ///
    /// # Errors
    /// If the disk is full or the folder is gone, by file.
    pub fn write(path: &Path, bytes: &[u8]) -> Result<(), TrainingError> {
        Ok(atomic_file::write(path, bytes)?)
    }
}
