//! `controller experiment` where a daemon runs: it plays the commands, and this program looks on.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use controller::cycle::duty_source::ExperimentPhase;
use controller::experiment::Played;
use controller::experiment::command_sequence::CommandSequence;
use controller::experiment::waiting::{Obstacles, waits_for};
use controller::operator::desk::{ExperimentOutcome, ExperimentView};
use controller::operator::socket::{Ask, Reply, ask};
use flight::RecordingSummary;
use proto::recording::PERIOD_S;

use super::Failure;
use super::console::tell;
use super::experiment::foreseen;
use super::screen::Screen;

/// Between two looks at how far it is.
const LOOK: Duration = Duration::from_millis(200);
/// Time for which the daemon may not answer before this program gives up looking; the experiment does not end by that.
const PATIENCE: Duration = Duration::from_secs(10);

/// Has the daemon at `socket` play a file; the range foreseen by channel in kPa, and what came of it.
pub(super) fn play(socket: &Path, csv: &Path) -> Result<([[f64; 2]; 2], Played), Failure> {
    // Read and checked here first, with the rights of whoever asks and in full words.
    let sequence = CommandSequence::read(csv).map_err(Failure::input)?;
    let file = std::path::absolute(csv).map_err(|e| Failure::input(format!("{}: {e}", csv.display())))?;
    let csv = String::from_utf8(sequence.bytes().to_vec())
        .map_err(|_| Failure::input(format!("{}: not a text in UTF-8; save it as one", csv.display())))?;
    let reply = ask(socket, &Ask::Experiment { file, csv }).map_err(Failure::work)?;
    let begun = match (reply.error, reply.experiment) {
        (Some(error), _) if reply.bad_input => return Err(Failure::input(error)),
        (Some(error), _) => return Err(Failure::work(error)),
        (None, None) => return Err(Failure::work("the daemon did not say which experiment it began")),
        (None, Some(begun)) => begun,
    };
    tell(foreseen(&begun.file, begun.rows, begun.pump_off.as_deref(), &begun.model, begun.forecast_kpa));
    tell(
        "the running daemon plays it and goes on afterwards as before; `controller disarm` stops it, leaving does not",
    );
    let (view, outcome) = look_on(socket, begun.number)?;
    let played = played(&view, outcome)?;
    Ok((view.forecast_kpa, played))
}

/// Looks on until the experiment is over and its recording finished.
fn look_on(socket: &Path, number: u64) -> Result<(ExperimentView, ExperimentOutcome), Failure> {
    let screen = Screen::of_stderr();
    let (mut heard, mut next_line) = (Instant::now(), Instant::now());
    loop {
        match ask(socket, &Ask::Status {}) {
            Ok(reply) => {
                heard = Instant::now();
                let newest = reply.experiment.as_ref().filter(|view| view.number == number);
                let Some(view) = newest else {
                    return Err(Failure::work(
                        "the daemon no longer knows the experiment; it was started anew, or played another",
                    ));
                };
                if Instant::now() >= next_line {
                    next_line = Instant::now() + screen.every();
                    screen.show(&line(&reply, view));
                }
                if let Some(outcome) = &view.outcome {
                    screen.clear();
                    return Ok((view.clone(), outcome.clone()));
                }
            }
            Err(error) if heard.elapsed() > PATIENCE => {
                return Err(Failure::work(format!(
                    "{error} (the experiment is the daemon's; what it recorded is in its record.directory)"
                )));
            }
            Err(_) => {}
        }
        std::thread::sleep(LOOK);
    }
}

fn line(reply: &Reply, view: &ExperimentView) -> String {
    let what = match view.phase {
        Some(ExperimentPhase::Settling) => {
            let newest = reply.status.unwrap_or_default();
            let obstacles = Obstacles { fault: newest.fault, waiting: newest.waiting, bars_arming: newest.bars_arming };
            waits_for(reply.state, obstacles)
        }
        Some(ExperimentPhase::Playing) => {
            let seconds = |rows: u32| f64::from(rows) * PERIOD_S;
            format!("{:6.2} s of {:.2} s", seconds(view.reached), seconds(view.rows))
        }
        Some(ExperimentPhase::Resting) => "vents open".to_owned(),
        None => "over; the recording is being finished".to_owned(),
    };
    let Some(status) = &reply.status else { return what };
    let [pos, neg] = status.pressures_kpa.unwrap_or([f64::NAN; 2]);
    format!("{what}  {pos:+7.2} {neg:+7.2} kPa  duty {:.3} {:.3}", status.duty[0], status.duty[1])
}

fn played(view: &ExperimentView, outcome: ExperimentOutcome) -> Result<Played, Failure> {
    let ExperimentOutcome { aborted, recording, recording_problem, ticks_recorded, ticks_dropped, played } = outcome;
    let Some(path) = recording else {
        let how = aborted.map_or("it was played to its end".to_owned(), |why| format!("it was aborted: {why}"));
        let problem = recording_problem.unwrap_or_default();
        return Err(Failure::work(format!(
            "the experiment was not recorded apart ({problem}), {how}; the run's own recording has it"
        )));
    };
    let recording = RecordingSummary {
        files: vec![path.clone()],
        path,
        ticks: ticks_recorded,
        ticks_dropped,
        ..RecordingSummary::default()
    };
    Ok(Played { recording, rows: view.rows, reached: view.reached, aborted, witness: played })
}

/// Copies the recording to where it was asked for; it is then the one that is named.
pub(super) fn copy(played: &mut Played, out: &Path) -> Result<(), Failure> {
    if out.exists() {
        return Err(Failure::work(format!(
            "{}: is there already and is left alone; the recording is {}",
            out.display(),
            played.recording.path.display()
        )));
    }
    let from: PathBuf = played.recording.path.clone();
    std::fs::copy(&from, out)
        .map_err(|e| Failure::work(format!("{}: cannot be copied to {}: {e}", from.display(), out.display())))?;
    out.clone_into(&mut played.recording.path);
    Ok(())
}
