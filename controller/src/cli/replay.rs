//! `controller replay`: the control law again on the recorded inputs.

use std::path::PathBuf;

use clap::Args;
use controller::replay::part_order::in_order;
use controller::replay::run_file::RunFile;
use controller::replay::{Replay, ReplayError};
use proto::reference::Reference;
use serde_json::json;

use super::Failure;
use super::console::{say, tell};

/// Runs the control law again on the recorded inputs and compares every output bit for bit.
///
/// Frames as they came, what the operator asked for, and the configuration, model, reference and policy inside the
/// recording: from these the same program must decide the same, whatever happened. A difference names its first tick and
/// the stage of the tick that differs first.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit status: 0 every bit the same, 1 a difference, or not all was compared (the recording ends early, was cut short or is damaged), 2 it cannot be replayed.

Example:
  controller replay recordings/run-20261120-020405.mcap"
)]
pub(crate) struct ReplayArgs {
    /// Recordings (MCAP) in the order of time, the parts of one run in any; one that goes on where the one before ended continues it
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// A reference that was put in while the run went on (CSV); several in their order
    #[arg(long, value_name = "FILE")]
    reference: Vec<PathBuf>,
    /// Print one JSON object, and nothing else on standard output
    #[arg(long)]
    json: bool,
}

impl From<ReplayError> for Failure {
    fn from(error: ReplayError) -> Self {
        Failure::input(error)
    }
}

impl ReplayArgs {
    pub(super) fn run(self) -> Result<(), Failure> {
        let references: Result<Vec<Reference>, _> = self.reference.iter().map(|file| Reference::read(file)).collect();
        let mut replay = Replay::new(references.map_err(Failure::input)?);
        for path in &self.recordings {
            if !RunFile::is_of_the_daemon(path)? {
                return Err(Failure::input(format!(
                    "{}: no recording of the daemon (MCAP); a table holds no frames, and there is nothing in it to replay",
                    path.display()
                )));
            }
        }
        let ordered = in_order(self.recordings)?;
        ordered.without_ticks.into_iter().for_each(|note| replay.without_ticks(note));
        for path in ordered.recordings {
            replay.run(&RunFile::read(&path)?)?;
        }
        let found = replay.found();
        let first = found.first.as_ref().map(|first| {
            json!({
                "index": first.index,
                "session": first.session,
                "tick": first.tick,
                "stage": first.stage.name(),
                "values": first.values,
            })
        });
        if self.json {
            say(json!({
                "ticks": found.ticks,
                "numbers": found.numbers,
                "ticks_differing": found.differing,
                "first_difference": first,
                "ended_early": found.missing(),
                "notes": found.notes,
            }));
        } else {
            say(format_args!(
                "{} ticks replayed, {} numbers compared bit for bit, {} ticks differ",
                found.ticks, found.numbers, found.differing
            ));
        }
        // The last line says the first that is wrong.
        let last = if found.first.is_none() { found.missing() } else { None };
        for note in found.notes.iter().filter(|note| Some(note.as_str()) != last) {
            tell(format_args!("{note}"));
        }
        if let Some(first) = &found.first {
            return Err(Failure::not_good(format!(
                "the first difference is at tick {} of session {:08X} (the {}. of the recording), in the {}: {}",
                first.tick,
                first.session,
                first.index + 1,
                first.stage.name(),
                first.values
            )));
        }
        match found.missing() {
            Some(why) => Err(Failure::not_good(format!("not all was compared: {why}"))),
            None => Ok(()),
        }
    }
}
