//! A recorded run as commands read it back: its ticks, what was in control, on what model, along which reference.

use std::path::{Path, PathBuf};

pub use proto::recording::attached;

use flight::{CodeNames, FlightInfo, FlightStatistics, Pacing, RunYardstick, StatisticsOptions};
use model::rig::Rig;
use proto::recording::{
    Arrival, LogTime, McapContent, ReadMcapError, Recording, RecordingError, TickInput, TickRecord, parse_mcap,
    unpacked,
};
use proto::reference::Reference;
use proto::regular_file;
use proto::wire::Mode;

use crate::operator::notice::fault_name;
use crate::state::State;
use crate::yardstick::{Trial, yardstick};

/// Reason why a file cannot be read back as a run.
#[derive(Debug, thiserror::Error)]
pub enum RunFileError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// An MCAP file that is no recording of the controller.
    #[error(transparent)]
    Mcap(#[from] ReadMcapError),
    /// A table that is no recording.
    #[error(transparent)]
    Table(#[from] RecordingError),
}

/// A recorded run.
#[derive(Debug, Clone)]
pub struct RunFile {
    /// The file.
    pub path: PathBuf,
    /// Content.
    pub content: McapContent,
}

impl RunFile {
    /// Reads a recording of the daemon, or a table (CSV) with its columns, as far as that goes: a table has no times of
    /// computing, no predictions and no faults.
    ///
    /// # Errors
    /// The file cannot be read or is neither.
    pub fn read(path: &Path) -> Result<Self, RunFileError> {
        let bytes = bytes_of(path)?;
        let content = if is_mcap(path, &bytes) {
            parse_mcap(&path.display().to_string(), &bytes)?
        } else {
            from_table(&Recording::read(path)?)
        };
        Ok(RunFile { path: path.to_owned(), content })
    }

    /// Tells whether a file is an MCAP file, as the daemon writes, and no table.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn is_of_the_daemon(path: &Path) -> Result<bool, RunFileError> {
        Ok(is_mcap(path, &bytes_of(path)?))
    }

    /// Pacing of the run: in lockstep there were no deadlines.
    pub fn pacing(&self) -> Pacing {
        let lockstep = self.content.metadata.get("log_time").is_some_and(|text| text.starts_with("tick"));
        if lockstep { Pacing::Lockstep } else { Pacing::Realtime }
    }

    /// The bytes of a file inside, by its name; the first of that name counts.
    pub fn attachment(&self, name: &str) -> Option<&[u8]> {
        self.attachments(name).next()
    }

    /// The bytes of all files of a name inside, in the order in which they came.
    pub fn attachments(&self, name: &str) -> impl Iterator<Item = &[u8]> {
        self.content.attachments.iter().filter(move |file| file.name == name).map(|file| file.data.as_slice())
    }

    /// Tells whether a file of this name inside is damaged.
    pub fn is_damaged_inside(&self, name: &str) -> bool {
        self.content.damaged_attachments.iter().any(|damaged| damaged == name)
    }

    /// Notes on what could not be read, but for those on damaged files inside, with which no tick is lost.
    pub fn notes_on_ticks(&self) -> impl Iterator<Item = &String> {
        let on_files = &self.content.attachment_notes;
        self.content.notes.iter().enumerate().filter(|(at, _)| !on_files.contains(at)).map(|(_, note)| note)
    }

    /// Number of the recording among those of its run, from 1.
    pub fn part(&self) -> u32 {
        self.content.metadata.get("part").and_then(|part| part.parse().ok()).unwrap_or(1)
    }

    /// Tells whether it is the recording that an experiment leaves beside that of its run.
    pub fn is_experiment_alone(&self) -> bool {
        self.content.metadata.contains_key("experiment") && self.attachment(attached::EFFECTIVE).is_none()
    }

    /// The model that was behind predictions and feed-forward.
    pub fn model(&self) -> Option<Rig> {
        self.rig(attached::MODEL).or_else(|| Rig::builtin(self.content.metadata.get("model_rig")?).ok())
    }

    /// The rig behind the emulated cRIO; `None` for a real one.
    pub fn plant(&self) -> Option<Rig> {
        self.rig(attached::PLANT)
    }

    /// The reference that was followed from arming on.
    pub fn reference(&self) -> Option<Reference> {
        match self.attachment(attached::REFERENCE) {
            Some(bytes) => Reference::parse(attached::REFERENCE, bytes).ok(),
            None => (self.content.metadata.get("reference")? == crate::daemon::PAPERS_REFERENCE).then(Reference::paper),
        }
    }

    /// Errors of the feed-forward PI on the run's rig, or on its model where the rig was real, along its reference;
    /// `None` where the recording does not say enough, or the reference changed on the way.
    pub fn yardstick(&self) -> Option<RunYardstick> {
        let changes = |tick: &TickRecord| {
            TickInput::of(tick.inputs)
                .any(|input| matches!(input, TickInput::Reference | TickInput::Model | TickInput::Experiment))
        };
        if self.content.ticks.iter().any(changes) {
            return None;
        }
        // Without the rig that was emulated, for one, it would be held against what is reached on a real one.
        if [attached::MODEL, attached::PLANT, attached::REFERENCE].iter().any(|name| self.is_damaged_inside(name)) {
            return None;
        }
        let (model, plant, reference) = (self.model()?, self.plant(), self.reference()?);
        let seed = self.content.metadata.get("seed").and_then(|seed| seed.parse().ok()).unwrap_or(1);
        let options = StatisticsOptions { pacing: self.pacing(), ..StatisticsOptions::default() };
        let steered = FlightStatistics::of(&self.content.ticks, options).counts().steered;
        let seconds = steered as f64 / 50.0;
        yardstick(Trial { rig: plant.as_ref(), model: &model, reference, seconds, seed }).ok()
    }

    /// Facts that a report gives about the run beside its ticks.
    pub fn info(&self, title: &str, options: StatisticsOptions) -> FlightInfo {
        let codes = CodeNames { state: State::name, fault: fault_name };
        FlightInfo::from_recording(title, &self.content, codes, options)
    }

    fn rig(&self, name: &str) -> Option<Rig> {
        Rig::from_toml(std::str::from_utf8(self.attachment(name)?).ok()?).ok()
    }
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, RunFileError> {
    let read = |source| RunFileError::Read { file: path.to_owned(), source };
    let bytes = regular_file::read(path, proto::recording::MOST_BYTES).map_err(read)?;
    Ok(unpacked(&path.display().to_string(), &bytes)?.into_owned())
}

/// Tells whether these are the first bytes of every MCAP file, or its name says so.
fn is_mcap(path: &Path, bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x89, b'M', b'C', b'A', b'P'])
        || path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mcap"))
}

/// A table's rows as ticks in control, paced by nothing.
fn from_table(table: &Recording) -> McapContent {
    let column = |name: &str| table.column(name).unwrap_or_default();
    let at = |values: &[f64], row: usize, absent: f64| values.get(row).copied().unwrap_or(absent);
    let [u_pos, u_neg, p_pos, p_neg] = ["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"].map(column);
    let [ref_pos, ref_neg, pump_on, mode] = ["ref_pos_kpa", "ref_neg_kpa", "pump_on", "mode"].map(column);
    let first_s = table.time_s().first().copied().unwrap_or(0.0);
    let ticks = table.time_s().iter().enumerate().map(|(row, time_s)| TickRecord {
        session: 1,
        tick: ((time_s - first_s) * 50.0).round() as u32,
        receive_ns: ((time_s - first_s) * 1e9).round() as u64,
        arrival: Arrival::InTime,
        p_pos_kpa: at(p_pos, row, f64::NAN),
        p_neg_kpa: at(p_neg, row, f64::NAN),
        ref_pos_kpa: at(ref_pos, row, f64::NAN),
        ref_neg_kpa: at(ref_neg, row, f64::NAN),
        u_pos: at(u_pos, row, f64::NAN),
        u_neg: at(u_neg, row, f64::NAN),
        pump_on: at(pump_on, row, 1.0) != 0.0,
        mode: at(mode, row, f64::from(Mode::Run.code())) as u8,
        state: State::Run.code(),
        ..TickRecord::default()
    });
    let metadata = [("log_time".to_owned(), LogTime::Tick.words().to_owned())].into();
    McapContent { ticks: ticks.collect(), metadata, notes: table.notes().to_vec(), ..McapContent::default() }
}
