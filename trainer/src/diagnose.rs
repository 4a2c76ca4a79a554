//! `trainer diagnose`: what physics is missing from a rig's model, where, and how much better the model is with it.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use diagnose::{Diagnosis, NEXT_EXPERIMENT, Request};
use proto::recording::Recording;
use proto::rig_file;

use crate::failure::{Failure, tell};
use crate::stdout;

/// Finds the physics that a rig's model leaves out: locates it, names it, models it, and shows the fit improve.
///
/// Writes diagnosis.json, report.html (open it in a browser), rig.toml (the rig with what was found) and, where the
/// recordings do not decide, next_experiment.csv with the commands that would. Verdicts: adequate, parameters_moved,
/// missing_physics, undecided, unknown_mechanism.
#[derive(Debug, Args)]
#[command(after_help = "Example: trainer diagnose --rig dual_pressure holds.mcap triangles.csv --out found")]
pub(crate) struct DiagnoseArgs {
    /// Rig as it is known: a built-in name (dual_pressure, the paper's; bench, as built) or a TOML file
    #[arg(long, value_name = "RIG", default_value = "dual_pressure")]
    rig: String,
    /// Recordings: MCAP or CSV with the header time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa (s, duty 0 to 1, gauge kPa),
    /// rows 20 ms apart; some minutes that use the range of both valves
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Shorter search, for a first look: fewer candidates are followed to the end; mostly the same answer
    #[arg(long)]
    quick: bool,
    /// Print diagnosis.json instead of a summary
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &DiagnoseArgs) -> Result<(), Failure> {
    let rig = rig_file::load(&args.rig)?;
    let recordings =
        args.recordings.iter().map(|path| Recording::read_for(path, &rig)).collect::<Result<Vec<_>, _>>()?;
    // The paper's rig has its two sides; any other one its sensors' names.
    let channels = if rig.sensors.len() == 2 && rig.volumes.contains_key("positive") {
        vec!["positive".to_owned(), "negative".to_owned()]
    } else {
        rig.sensors.keys().take(2).cloned().collect()
    };
    let request = Request { rig, recordings, out_dir: args.out.clone(), quick: args.quick };
    let diagnosis = {
        let mut shown = Shown::new();
        diagnose::run(&request, &mut |what, share| shown.show(what, share))?
    };
    if args.json {
        return stdout::say(&diagnosis.to_json().map_err(Failure::Json)?);
    }
    for note in &diagnosis.notes {
        tell(note);
    }
    stdout::say(&text(&diagnosis, args, &channels))
}

/// The answer for people.
fn text(diagnosis: &Diagnosis, args: &DiagnoseArgs, channels: &[String]) -> String {
    let mut text = format!("{}: {}\n\n", diagnosis.verdict.as_str(), diagnosis.summary);
    text.push_str(&format!("{:<30}", "free run on held-out stretches"));
    for channel in channels {
        text.push_str(&format!(" {:>14}", format!("{channel} kPa")));
    }
    text.push('\n');
    let fits = [
        ("rig as given", &diagnosis.fit.nominal),
        ("parameters fitted", &diagnosis.fit.reidentified),
        ("with what was found", &diagnosis.fit.extended),
    ];
    for (name, fit) in fits {
        text.push_str(&format!("{name:<30}"));
        for (channel, rmse) in channels.iter().zip([fit.pos_rmse_kpa, fit.neg_rmse_kpa]) {
            let width = 14.max(channel.len() + 4);
            text.push_str(&format!(" {rmse:>width$.3}"));
        }
        text.push('\n');
    }
    for group in &diagnosis.rivals {
        text.push_str(&format!("\nnot told apart: {}", group.join(", ")));
    }
    text.push_str(&format!("\nreport: {}\n", args.out.join("report.html").display()));
    if diagnosis.next_experiment.is_some() {
        let path = args.out.join(NEXT_EXPERIMENT);
        text.push_str(&format!("next: controller experiment {} --config FILE\n", path.display()));
    }
    text
}

/// What is being done: one line that is written over on a terminal, a line a stage elsewhere.
struct Shown {
    terminal: bool,
    what: String,
    next: Instant,
}

const EVERY: Duration = Duration::from_millis(100);

impl Shown {
    fn new() -> Self {
        Shown { terminal: std::io::stderr().is_terminal(), what: String::new(), next: Instant::now() }
    }

    fn show(&mut self, what: &str, share: f64) {
        let now = Instant::now();
        let fresh = what != self.what;
        if !fresh && (!self.terminal || now < self.next) {
            return;
        }
        self.next = now + EVERY;
        what.clone_into(&mut self.what);
        let percent = (100.0 * share.clamp(0.0, 1.0)).round();
        let text = if self.terminal { format!("\r\x1b[K{what} {percent:.0} %") } else { format!("trainer: {what}\n") };
        // Progress that cannot be shown is no reason to stop the work.
        let _ = std::io::stderr().lock().write_all(text.as_bytes());
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        if self.terminal {
            let _ = std::io::stderr().lock().write_all(b"\r\x1b[K");
        }
    }
}
