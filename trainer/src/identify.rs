//! `trainer identify`: a rig's parameters from recordings, with uncertainties and in plain words.
//!
//! The fit itself stands in the crate `fit`; here are files, progress and what is said.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fit::data::quality::seconds_are_no_count;
use fit::data::{Role, each_once};
use fit::identify::{
    Accuracy, Identified, IdentifySettings, Step, determined, figures, noise_in_words, not_good, run as identify,
    table, undetermined, verdict,
};
use fit::objective::Runaway;
use fit::parameters::End;
use proto::output::same_file;
use proto::recording::{PERIOD_S, Recording, short_name};
use proto::rig_file::{FitEnding, rename_fitted};
use proto::{output, rig_file};
use serde_json::{Map, Value, json};

use crate::failure::{Failure, tell};
use crate::interruptible::Interruptible;
use crate::rig_choice::load_for_rows;
use crate::stdout;
use crate::work_shown::WorkShown;

/// Refusal of the sign for standard output, which holds the table.
const NO_FILE: &str = "standard output holds the table; name a file for the rig (./- for one that is called so)";

/// Fits a rig's parameters to recordings and writes the rig with the fitted ones.
///
/// Check valves by the simplex method and valves by linear least squares, as in the paper; then all parameters
/// together. Every parameter gets an uncertainty, and what the recordings do not determine is said. About a fifth of
/// the rows is not fitted: open-loop simulations of those (validation data) show how good it is. Ordinary recordings
/// will do (random holds, tracking); 20 s at least, and both duties must move.
#[derive(Debug, Args)]
#[command(after_help = "Exit status: 0 written; 1 written and still off by ten times the noise or more, or
with a parameter at an end of what it can be, or not written because it is worse
than before; 2 wrong use or input.

Example:
  trainer identify --rig dual_pressure run1.mcap run2.csv --out lab.toml")]
pub(crate) struct IdentifyArgs {
    /// Rig to start from: a built-in name (dual_pressure, the paper's; bench, as built) or a TOML file. Its
    /// parameters are taken as known to a few per cent
    #[arg(long, value_name = "RIG", default_value = "dual_pressure")]
    rig: String,
    /// Recordings: the daemon's MCAP, or what loggers write at any rate (docs/recordings.md)
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// Rig file to write: the same rig with the fitted parameters
    #[arg(long, value_name = "RIG", value_parser = stdout::no_sign(NO_FILE))]
    out: PathBuf,
    /// Cores to use (all by default)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Print the results as one JSON object instead of a table and words
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &IdentifyArgs) -> Result<(), Failure> {
    let rig = load_for_rows(&args.rig)?;
    // All are read before anything is fitted, so that a bad file shows at once.
    let recordings =
        args.recordings.iter().map(|path| Recording::read_for(path, &rig)).collect::<Result<Vec<_>, _>>()?;
    if args.recordings.iter().any(|path| same_file(path, &args.out)) {
        return Err(Failure::OverRecording { out: args.out.display().to_string() });
    }
    if same_file(Path::new(&args.rig), &args.out) {
        return Err(Failure::OverRig { out: args.out.display().to_string() });
    }
    let work = Interruptible::begin()?;
    work.undisturbed(|| output::check_file(&args.out, ROOM))?;
    seconds_are_no_count(&rig, &recordings)?;
    let (recordings, copies) = each_once(recordings);
    for note in recordings.iter().flat_map(Recording::notes).chain(&copies) {
        tell(note);
    }
    let settings =
        IdentifySettings { threads: args.threads.map(|n| n.try_into().unwrap_or(1)), ..IdentifySettings::default() };
    let identified = {
        let mut shown = Shown::new();
        identify(&rig, &recordings, &settings, &mut |step| shown.show(step))?
    };
    if let Some(change) = identified.change {
        tell(change.note());
    }
    let worse = identified.is_worse();
    let out = args.out.display().to_string();
    if !worse {
        let mut found = identified.fitted.rig.clone();
        rename_fitted(&mut found, FitEnding::Identified, &identified_from(&recordings));
        work.write(|| rig_file::save(&args.out, &found))?;
    }
    if args.json {
        let written = if worse { Value::Null } else { json!(out) };
        stdout::say_json(&json_of(&identified, &rig.name, (&recordings, &copies), &written))?;
    } else {
        stdout::say(&words(&identified, &recordings, &out))?;
    }
    if worse {
        let [before_kpa, after_kpa] = identified.before_and_after_kpa();
        return Err(Failure::WorseThanBefore { before_kpa, after_kpa, out });
    }
    not_good(&identified).map_or(Ok(()), |why| Err(Failure::InPart { why, out }))
}

/// Room in bytes that a rig file needs.
const ROOM: u64 = 1 << 16;

/// Rounds of refinement that a fit takes, and how many times as long as a round the tests after it: the median of what was
/// measured on the open sets (docs/diagnose-results.md).
const ROUNDS: usize = 12;
const TESTS_OVER_A_ROUND: f64 = 2.0;
/// Rounds after which one knows how long a round is.
const KNOWN_AFTER: usize = 2;

/// Work that is being done, and the time that it will take.
struct Shown {
    work: WorkShown,
    begun: Instant,
    refining: Option<Instant>,
}

impl Shown {
    fn new() -> Self {
        Shown { work: WorkShown::begin("checking the recordings"), begun: Instant::now(), refining: None }
    }

    fn show(&mut self, step: Step) {
        match step {
            Step::Checking => self.work.stage("checking the recordings"),
            Step::Paper => self.work.stage("the paper's procedure"),
            Step::Refining { round } => {
                self.work.stage("refining all parameters together");
                let since = *self.refining.get_or_insert_with(Instant::now);
                if round >= KNOWN_AFTER {
                    let a_round = since.elapsed().div_f64(round as f64);
                    let ahead = ROUNDS.max(round) as f64 - round as f64 + TESTS_OVER_A_ROUND;
                    self.work.expect(self.begun.elapsed() + a_round.mul_f64(ahead));
                }
            }
            Step::Testing => self.work.stage("testing on validation data"),
        }
    }
}

/// Sentence of the file about itself.
fn identified_from(recordings: &[Recording]) -> String {
    let names: Vec<String> =
        recordings.iter().map(|r| short_name(r.source(), recordings.iter().map(Recording::source))).collect();
    format!("Parameters identified from {}.", names.join(", "))
}

fn seconds(identified: &Identified, roles: &[Role]) -> f64 {
    roles.iter().map(|role| identified.split.rows(*role)).sum::<usize>() as f64 * PERIOD_S
}

/// Everything for a reader, in the order in which it is asked for.
fn words(identified: &Identified, recordings: &[Recording], out: &str) -> String {
    let mut text = String::new();
    let mut line = |l: &str| {
        text.push_str(l);
        text.push('\n');
    };
    let (fitted, kept) = (seconds(identified, &[Role::Fit, Role::Select]), seconds(identified, &[Role::HeldOut]));
    let files =
        if recordings.len() == 1 { "1 recording".to_owned() } else { format!("{} recordings", recordings.len()) };
    line(&format!("{files}: {fitted:.0} s fitted, {kept:.0} s of validation data"));
    for (channel, noise) in identified.channels.iter().zip(&identified.noise) {
        let steps = if noise.step_kpa > 0.0 { format!(", steps of {:.4} kPa", noise.step_kpa) } else { String::new() };
        line(&format!("{channel}: {}{steps}", noise_in_words(noise)));
    }
    line("");
    line(table(identified).trim_end());
    line("");
    line(figures(identified).trim_end());
    let part = |head: &str, said: Vec<String>| -> String {
        if said.is_empty() { String::new() } else { format!("\n{head}\n- {}\n", said.join("\n- ")) }
    };
    let doubts: Vec<String> = identified.quality.doubts().map(ToString::to_string).collect();
    text.push_str(&part("What these recordings determine:", determined(&identified.fitted)));
    text.push_str(&part("What these recordings do not determine:", undetermined(&identified.fitted)));
    text.push_str(&part("What is doubtful about them:", doubts));
    text.push_str(&part("What to make of it:", verdict(identified)));
    if !identified.is_worse() {
        text.push_str(&format!("\n{out}: written\n"));
    }
    text
}

/// A column's channel: `pos` for `p_pos_kpa`, otherwise the column itself.
fn channel(column: &str) -> &str {
    column.strip_prefix("p_").and_then(|rest| rest.strip_suffix("_kpa")).unwrap_or(column)
}

fn json_of(identified: &Identified, rig: &str, (recordings, copies): (&[Recording], &[String]), out: &Value) -> Value {
    let not_good = not_good(identified);
    let parameters: Vec<Value> = identified
        .fitted
        .estimates
        .iter()
        .enumerate()
        .map(|(index, e)| {
            let [low, high] = e.interval();
            // Of what has no limit nothing is stated but what it is beyond.
            let (sd, [low, high], open) = match identified.fitted.runaway(index) {
                None => (Some(e.sd), [Some(low), Some(high)], None),
                Some(Runaway { end: End::High, beyond, .. }) => (None, [Some(beyond), None], Some("high")),
                Some(Runaway { end: End::Low, beyond, .. }) => (None, [None, Some(beyond)], Some("low")),
            };
            json!({
                "parameter": e.parameter.path, "unit": e.parameter.unit(), "rig_file": e.parameter.mean,
                "value": e.value, "sd": sd, "low": low, "high": high, "no_limit": open,
                "shift_in_prior_sd": e.shift, "sd_over_prior_sd": e.undetermined,
            })
        })
        .collect();
    let mut noise = Map::new();
    for (column, of) in identified.channels.iter().zip(&identified.noise) {
        noise.insert(format!("{}_sigma_kpa", channel(column)), json!(of.sigma_kpa));
        noise.insert(format!("{}_step_kpa", channel(column)), json!(of.step_kpa));
    }
    let paper = identified.paper.as_ref().map(|paper| {
        let valves: Vec<Value> = paper
            .valves
            .iter()
            .map(|v| {
                json!({
                    "valve": v.valve, "volume": v.volume, "volume_l": v.coefficients[0],
                    "input_area_mm2": v.coefficients[1], "pressure_area_mm2_per_n": v.coefficients[2],
                    "spring_area_mm2": v.coefficients[3], "windows": v.windows,
                })
            })
            .collect();
        let [inlet, outlet] = paper.check_areas_mm2;
        json!({ "inlet_check_area_mm2": inlet, "outlet_check_area_mm2": outlet, "valves": valves })
    });
    json!({
        "rig": rig, "out": out,
        "recordings": recordings.iter().map(Recording::source).collect::<Vec<_>>(),
        "left_out": copies,
        "fitted_s": seconds(identified, &[Role::Fit, Role::Select]),
        "kept_back_s": seconds(identified, &[Role::HeldOut]),
        "tested_on_fitted_rows": identified.tested_on_fitted,
        "noise": noise, "parameters": parameters, "paper": paper,
        "before": errors(&identified.before, &identified.channels),
        "after": errors(&identified.after, &identified.channels),
        "converged": identified.fitted.converged,
        "good": !identified.is_worse() && not_good.is_none(),
        "not_good": not_good,
        "determined": determined(&identified.fitted),
        "not_determined": undetermined(&identified.fitted),
        "notes": identified.change.map(|change| change.note()).into_iter().collect::<Vec<_>>(),
        "doubts": identified.quality.doubts().map(ToString::to_string).collect::<Vec<_>>(),
        "remarks": verdict(identified),
    })
}

fn errors(accuracy: &Accuracy, channels: &[String]) -> Value {
    let horizon = |errors: &[fit::simulate::ChannelError]| {
        let mut object = Map::new();
        for (column, error) in channels.iter().zip(errors) {
            let channel = channel(column);
            object.insert(format!("{channel}_rmse_kpa"), json!(error.rmse_kpa));
            object.insert(format!("{channel}_bias_kpa"), json!(error.bias_kpa));
            object.insert(format!("{channel}_max_error_kpa"), json!(error.worst_kpa));
        }
        Value::Object(object)
    };
    json!({
        "free": horizon(&accuracy.free), "ten_seconds": horizon(&accuracy.ten_seconds),
        "one_second": horizon(&accuracy.one_second),
    })
}
