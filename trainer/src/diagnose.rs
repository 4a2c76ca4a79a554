//! `trainer diagnose`: what physics is missing from a rig's model, where, and how much better the model is with it.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use diagnose::{Diagnosis, Request, check_out_dir, work_out};
use fit::data::quality::seconds_are_no_count;
use proto::diagnosis::RigKind;
use proto::recording::Recording;

use crate::failure::{Failure, tell};
use crate::interruptible::Interruptible;
use crate::rig_choice::load_for_rows;
use crate::stdout;
use crate::work_shown::WorkShown;

/// Refusal of the sign for standard output, which holds no folder.
const NO_FOLDER: &str =
    "the answer is several files, which standard output cannot hold; name a folder (./- for one that is called so)";

/// Finds the physics that a rig's model leaves out: locates it, names it, models it, and shows the fit improve.
///
/// Writes diagnosis.json, report.html (open it in a browser), rig.toml (the rig with what was found) and, where the
/// recordings do not decide, next_experiment.csv with the commands that would. Verdicts: adequate, parameters_moved,
/// missing_physics, undecided, unknown_mechanism.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  trainer diagnose --rig dual_pressure holds.mcap triangles.csv --out found")]
pub(crate) struct DiagnoseArgs {
    /// Rig as it is known: a built-in name (dual_pressure, the paper's; bench, as built) or a TOML file
    #[arg(long, value_name = "RIG", default_value = "dual_pressure")]
    rig: String,
    /// Recordings: the daemon's MCAP or what a logger wrote, of any rate, with columns under the rig's names
    /// (time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa: s, duty 0 to 1, gauge kPa) or as the rig file's `[recording]` says; some minutes
    /// that use the range of both valves
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", value_parser = stdout::no_sign(NO_FOLDER))]
    out: PathBuf,
    /// Shorter search, for a first look: fewer candidates are followed to the end; mostly the same answer
    #[arg(long)]
    quick: bool,
    /// Print diagnosis.json instead of a summary
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &DiagnoseArgs) -> Result<(), Failure> {
    let rig = load_for_rows(&args.rig)?;
    let recordings =
        args.recordings.iter().map(|path| Recording::read_for(path, &rig)).collect::<Result<Vec<_>, _>>()?;
    let work = Interruptible::begin()?;
    work.undisturbed(|| check_out_dir(&args.out))?;
    seconds_are_no_count(&rig, &recordings)?;
    let request =
        Request { rig, rig_argument: args.rig.clone(), recordings, out_dir: args.out.clone(), quick: args.quick };
    let outcome = {
        let mut shown = Shown::new(args.quick);
        work_out(&request, &mut |what, _| shown.show(what))?
    };
    work.write(|| outcome.write(&args.out))?;
    let diagnosis = &outcome.diagnosis;
    if args.json {
        return stdout::put(&diagnosis.to_json().map_err(Failure::Json)?);
    }
    for note in &diagnosis.notes {
        tell(note);
    }
    stdout::say(&text(diagnosis, args))
}

/// The answer for people.
fn text(diagnosis: &Diagnosis, args: &DiagnoseArgs) -> String {
    let mut text = format!("{}: {}\n\n{}", diagnosis.verdict.as_str(), diagnosis.summary, fits(diagnosis));
    for group in &diagnosis.rivals {
        text.push_str(&format!("\nnot told apart: {}", group.join(", ")));
    }
    text.push_str(&format!("\nreport: {}\n", args.out.join("report.html").display()));
    text.push_str(&format!("rig:    {} ({})\n", args.out.join("rig.toml").display(), written(diagnosis)));
    text.push_str(&format!("next:   {}\n", diagnosis.next_step.why));
    for command in &diagnosis.next_step.commands {
        text.push_str(&format!("        {command}\n"));
    }
    text
}

/// A line a channel: how far off each rig is.
fn fits(diagnosis: &Diagnosis) -> String {
    let extended = diagnosis.rig.kind == RigKind::Extended;
    let channels = &diagnosis.fit_by_channel;
    let width = channels.iter().map(|fit| fit.channel.chars().count()).max().unwrap_or(0);
    let mut text = "RMSE in kPa on validation data, simulated from the commands alone (open loop)\n".to_owned();
    text.push_str(&format!("{:width$}  {:>12}  {:>17}", "", "rig as given", "parameters fitted"));
    text.push_str(if extended { "  with what was found\n" } else { "\n" });
    for fit in channels {
        text.push_str(&format!(
            "{:width$}  {:>12.3}  {:>17.3}",
            fit.channel, fit.nominal_rmse_kpa, fit.reidentified_rmse_kpa
        ));
        text.push_str(&if extended { format!("  {:>19.3}\n", fit.extended_rmse_kpa) } else { "\n".to_owned() });
    }
    text
}

fn written(diagnosis: &Diagnosis) -> String {
    match diagnosis.rig.kind {
        RigKind::AsGiven => "as given".to_owned(),
        RigKind::Fitted => format!("{}, parameters fitted", diagnosis.rig.name),
        RigKind::Extended => format!("{}, with what was found", diagnosis.rig.name),
    }
}

/// The stage whose time tells how fast this machine is on these recordings.
const FIRST_FIT: &str = "fitting the rig's own parameters";
/// Times that stage's time that all of a search took, short and whole: medians over the eight open sets (docs/diagnose-results.md).
const SHORT_OVER_FIRST_FIT: f64 = 5.0;
const WHOLE_OVER_FIRST_FIT: f64 = 10.0;

/// Work that is being done, and the time that it will take.
struct Shown {
    work: WorkShown,
    begun: Instant,
    over_first_fit: f64,
    first_fit: Option<Instant>,
}

impl Shown {
    fn new(quick: bool) -> Self {
        let over_first_fit = if quick { SHORT_OVER_FIRST_FIT } else { WHOLE_OVER_FIRST_FIT };
        Shown { work: WorkShown::begin("reading"), begun: Instant::now(), over_first_fit, first_fit: None }
    }

    fn show(&mut self, what: &str) {
        self.work.stage(what);
        if what == FIRST_FIT {
            self.first_fit = Some(Instant::now());
        } else if let Some(first_fit) = self.first_fit.take() {
            self.work.expect(self.begun.elapsed() + first_fit.elapsed().mul_f64(self.over_first_fit));
        }
    }
}
