//! `trainer evaluate`: the paper's tables.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use ::evaluate::comparison::{Comparison, ControllerUnderTest, Knowledge};
use ::evaluate::join::joined;
use ::evaluate::table::Table;
use ::evaluate::{Dob, TickTimes, payload, rigs_around};
use clap::{Args, Subcommand};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::atomic_file;
use proto::reference::Reference;
use proto::rig_file::{self, RigFileError};
use training::{TrainedPolicy, TrainingError, TrainingSettings, Variant};

use crate::failure::{Failure, tell};
use crate::progress::Progress;
use crate::stdout;

/// Fills the paper's tables: runs controllers and policies on rigs and compares their tracking.
///
/// Policies are found in a folder of runs and grouped: runs that differ in nothing but their seed are one row, with
/// the spread over seeds. Every table has the clairvoyant optimum ("limit") as its last row: what any controller could reach that knows the
/// rig and the whole reference. Writes table.json, table.md and table.html.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer evaluate comparison --runs runs --out tables/comparison
  trainer evaluate ablation --runs runs --rig bench --out tables/ablation
  trainer evaluate loads --runs runs --out tables/loads
  trainer evaluate join tables/comparison/table.json limit/table.json --out tables/both")]
pub(crate) struct EvaluateArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Fallback, disturbance observer, raw policies, full policies, optimum: on each rig and on rigs drawn around the last
    Comparison(TableArgs),
    /// The four variants: with and without model-predicted observations and smooth actions (Table I)
    Ablation(TableArgs),
    /// Payloads of 0 to 20 kg on the actuator that hangs on both chambers (Table II)
    Loads(TableArgs),
    /// Puts tables of the same rigs together, made on other days or machines; nothing is run
    Join(JoinArgs),
}

#[derive(Debug, Args)]
struct JoinArgs {
    /// Tables (table.json), at least two; an entrant of several counts in the first, and must fly alike in all
    #[arg(required = true, num_args = 2.., value_name = "TABLE")]
    tables: Vec<PathBuf>,
    /// Folder for table.json, table.md and table.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the table as one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct TableArgs {
    /// Folder of runs, each with its policy.bin, or its policy.onnx and settings.toml; one that has settings alone is named
    #[arg(long, value_name = "DIR")]
    runs: Option<PathBuf>,
    /// Rig to control, name or file; may be given several times (dual_pressure, bench)
    #[arg(long, value_name = "RIG")]
    rig: Vec<String>,
    /// Model behind predictions, feed-forward and linearisation
    #[arg(long, value_name = "RIG", default_value = "dual_pressure")]
    model: String,
    /// How many rigs to draw around the last rig; 0 for none
    #[arg(long, value_name = "N", default_value_t = 20)]
    drawn: usize,
    /// Seed of the drawn rigs
    #[arg(long, value_name = "N", default_value_t = 2026)]
    drawn_seed: u64,
    /// Reference: CSV time_s,ref_pos_kpa,ref_neg_kpa, or a recording that has these columns (the paper's)
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// Length of a run in s; the first 5 s are not counted
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    seconds: f64,
    /// Noise seeds of controllers that are not trained
    #[arg(long, value_name = "N", default_value_t = 3)]
    seeds: u64,
    /// Leave out the clairvoyant optimum, which takes twenty-five runs a rig
    #[arg(long)]
    without_limit: bool,
    /// Folder for table.json, table.md and table.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the table as one JSON object
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    match &args.what {
        What::Comparison(table) => {
            let shown = |variant| matches!(variant, Variant::Raw | Variant::Both);
            fill(table, "Comparison of controllers", &shown, true, PAPER_COMPARISON, columns(table)?)
        }
        What::Ablation(table) => fill(table, "Ablation", &|_| true, false, PAPER_ABLATION, columns(table)?),
        What::Loads(table) => {
            let shown = |variant| variant == Variant::Both;
            fill(table, "Robustness over payloads", &shown, true, PAPER_LOADS, loads(table)?)
        }
        What::Join(args) => join(args),
    }
}

/// Flights of a reference that iterative learning has had when it counts, the last included.
const REPEATED_FLIGHTS: usize = 20;
/// Largest table that is joined (bytes); ours have some ten kilobytes.
const MOST_TABLE_BYTES: u64 = 64 << 20;

const PAPER_COMPARISON: &[(&str, [f64; 2])] = &[("raw RL", [2.5439, 3.0254]), ("the paper's RL", [0.6935, 0.2646])];
const PAPER_ABLATION: &[(&str, [f64; 2])] = &[
    ("raw RL", [2.5439, 3.0254]),
    ("RL with MPObs", [2.3965, 1.7714]),
    ("RL with CAPS", [2.2935, 1.4204]),
    ("the paper's RL (both)", [0.6935, 0.2646]),
];
const PAPER_LOADS: &[(&str, [f64; 2])] = &[
    ("the paper's RL, 0 kg", [0.7451, 0.1180]),
    ("the paper's RL, 5 kg", [0.7906, 0.1181]),
    ("the paper's RL, 10 kg", [0.7508, 0.1186]),
    ("the paper's RL, 15 kg", [0.7593, 0.1095]),
    ("the paper's RL, 20 kg", [0.7012, 0.1097]),
];

/// Columns of a table: a name and the rigs that it is the mean of.
type Columns = Vec<(String, Vec<Rig>)>;

fn rigs(args: &TableArgs, otherwise: &[&str]) -> Result<Vec<Rig>, Failure> {
    let names: Vec<String> =
        if args.rig.is_empty() { otherwise.iter().map(|&n| n.to_owned()).collect() } else { args.rig.clone() };
    names.iter().map(|name| Ok(rig_file::load(name)?)).collect()
}

fn columns(args: &TableArgs) -> Result<Columns, Failure> {
    let rigs = rigs(args, &["dual_pressure", "bench"])?;
    let last = rigs.last().cloned();
    let mut columns: Columns = rigs.into_iter().map(|rig| (rig.name.clone(), vec![rig])).collect();
    if let (Some(rig), 1..) = (last, args.drawn) {
        let drawn = rigs_around::rigs_around(&rig, args.drawn, args.drawn_seed).map_err(TrainingError::from)?;
        columns.push((format!("{} rigs drawn around {}", drawn.len(), rig.name), drawn));
    }
    Ok(columns)
}

fn loads(args: &TableArgs) -> Result<Columns, Failure> {
    let rigs = rigs(args, &["bench"])?;
    let mut columns = Columns::new();
    for rig in &rigs {
        for payload_kg in [0.0, 5.0, 10.0, 15.0, 20.0] {
            let loaded = payload::loaded(rig, payload_kg)
                .map_err(|problem| RigFileError::Rig { file: rig.name.clone(), problem })?;
            columns.push((format!("{}, {payload_kg} kg", rig.name), vec![loaded]));
        }
    }
    Ok(columns)
}

fn fill(
    args: &TableArgs,
    title: &str,
    shown: &dyn Fn(Variant) -> bool,
    others: bool,
    paper: &[(&str, [f64; 2])],
    columns: Columns,
) -> Result<(), Failure> {
    let model = rig_file::load(&args.model)?;
    let reference = match &args.reference {
        Some(path) => Reference::read(path)
            .map_err(|error| TrainingError::File { file: path.display().to_string(), problem: error.to_string() })?,
        None => Reference::paper(),
    };
    let noise_v_rms = proto::emulator::Sensors::ADC_NOISE_V_RMS;
    let mut entrants = Vec::new();
    let times = [Arc::new(TickTimes::default()), Arc::new(TickTimes::default())];
    if others {
        entrants.push(ControllerUnderTest::Fallback(Knowledge::Model));
        entrants.push(ControllerUnderTest::Fallback(Knowledge::Rig));
        for knowledge in [Knowledge::Model, Knowledge::Rig] {
            entrants.push(ControllerUnderTest::Repeated { knowledge, flights: REPEATED_FLIGHTS });
        }
        for (knowledge, times) in [Knowledge::Model, Knowledge::Rig].into_iter().zip(&times) {
            entrants.push(ControllerUnderTest::Mpc { knowledge, times: Arc::clone(times) });
        }
        let map = SteadyMap::new(&model).map_err(|problem| RigFileError::Rig { file: args.model.clone(), problem })?;
        entrants.push(ControllerUnderTest::Dob(Dob::tuned(&map, &model, noise_v_rms).map_err(TrainingError::from)?));
    }
    let (groups, steps) = match &args.runs {
        Some(folder) => groups(folder, shown)?,
        None => (BTreeMap::new(), Vec::new()),
    };
    entrants.extend(groups.into_values().map(|(label, policies)| ControllerUnderTest::Policies { label, policies }));
    if !args.without_limit {
        entrants.push(ControllerUnderTest::OptimalOpenLoop);
    }
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let comparison = Comparison {
        model,
        columns,
        reference,
        seconds: args.seconds,
        noise_v_rms,
        seeds: (1..=args.seeds).collect(),
        threads,
    };
    let bar: Mutex<Option<Progress>> = Mutex::new(None);
    let told = |_done: usize, all: usize| {
        if let Ok(mut bar) = bar.lock() {
            bar.get_or_insert_with(|| Progress::new("runs", all as u64)).advance(1);
        }
    };
    let rows = comparison.fly(&entrants, &told).map_err(TrainingError::from)?;
    drop(bar);
    let mut notes = steps;
    for (knowledge, times) in [Knowledge::Model, Knowledge::Rig].into_iter().zip(&times) {
        if let Some((median, p999)) = times.median_and_p999_us() {
            let who = format!("offset-free NMPC{}", knowledge.label());
            notes.push(format!("{who}: {median:.0} µs a tick in the median, {p999:.0} µs at most in 999 of 1000."));
        }
    }
    let table = Table {
        title: title.to_owned(),
        columns: comparison.columns.iter().map(|(name, _)| name.clone()).collect(),
        rows,
        paper: paper.iter().map(|(who, rmse)| ((*who).to_owned(), *rmse)).collect(),
        notes,
        provenance: vec![
            ("command".into(), command()),
            ("trainer".into(), env!("CARGO_PKG_VERSION").into()),
            ("reference".into(), args.reference.as_ref().map_or("the paper's".into(), |p| p.display().to_string())),
            ("noise".into(), format!("{noise_v_rms} V RMS and steps of the converter")),
        ],
    };
    deliver(&table, &args.out, args.json)
}

fn join(args: &JoinArgs) -> Result<(), Failure> {
    let mut tables = Vec::new();
    for path in &args.tables {
        let file = path.display().to_string();
        let wrong = |problem: String| TrainingError::File { file: file.clone(), problem };
        let text = proto::regular_file::read_text(path, MOST_TABLE_BYTES)
            .map_err(|error| wrong(format!("cannot be read: {error}")))?;
        let table: Table = serde_json::from_str(&text)
            .map_err(|error| wrong(format!("is no table of `trainer evaluate`: {error}; give a table.json")))?;
        tables.push((file, table));
    }
    let later = tables.split_off(1);
    let Some(first) = tables.pop() else { return Ok(()) };
    deliver(&joined(first, later)?, &args.out, args.json)
}

fn deliver(table: &Table, out: &Path, as_json: bool) -> Result<(), Failure> {
    write(out, table)?;
    if as_json {
        return stdout::say_json(&serde_json::json!(table));
    }
    stdout::say(&format!("{}\nwritten to {}", table.to_markdown(), out.display()))
}

fn write(folder: &Path, table: &Table) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| TrainingError::File {
        file: folder.display().to_string(),
        problem: format!("cannot be made: {error}"),
    })?;
    let json = serde_json::to_string_pretty(table).unwrap_or_default();
    atomic_file::write(&folder.join("table.json"), format!("{json}\n").as_bytes())?;
    atomic_file::write(&folder.join("table.md"), table.to_markdown().as_bytes())?;
    atomic_file::write(&folder.join("table.html"), table.to_html().as_bytes())?;
    Ok(())
}

/// The command line, without the folder that the program lies in.
fn command() -> String {
    let program = std::iter::once(env!("CARGO_BIN_NAME").to_owned());
    program.chain(std::env::args().skip(1)).collect::<Vec<_>>().join(" ")
}

/// Whether two policies of one row are no two seeds: the same seed, or the same weights under another number.
fn is_same_run(one: &TrainedPolicy, other: &TrainedPolicy) -> bool {
    one.settings().run.seed == other.settings().run.seed || one.network() == other.network()
}

fn twin_of(other: &Path, policy: &TrainedPolicy) -> String {
    format!(
        "is the run of {} once more (seed {}), and a spread over seeds would count it twice; take one of the two folders away",
        other.display(),
        policy.settings().run.seed
    )
}

/// Rows of policies by sorting key: their label, and one policy for each seed.
type Groups = BTreeMap<String, (String, Vec<Arc<TrainedPolicy>>)>;

/// The name of a run that was kept without its policy, where it would be in the table.
fn without_policy(folder: &Path, shown: &dyn Fn(Variant) -> bool) -> Option<String> {
    let file = folder.join("settings.toml");
    let settings = std::fs::read_to_string(&file).ok()?;
    let settings = TrainingSettings::parse(&file.display().to_string(), &settings).ok()?;
    shown(settings.policy.variant).then(|| Some(folder.file_name()?.to_string_lossy().into_owned()))?
}

/// What to say of runs that were kept without their policies, and how one is had again.
fn tell_lacking(folder: &Path, names: &[String]) {
    if !names.is_empty() {
        let folder = folder.display();
        tell(&format!(
            "{folder}: runs kept without their policies and not in the table ({}); `trainer train --config {folder}/NAME/settings.toml \
             --out runs/NAME` trains one anew",
            names.join(", ")
        ));
    }
}

/// Policies of a folder of runs, and a line on each group's length of training.
fn groups(folder: &Path, shown: &dyn Fn(Variant) -> bool) -> Result<(Groups, Vec<String>), Failure> {
    let unreadable = |error: std::io::Error| TrainingError::File {
        file: folder.display().to_string(),
        problem: format!("cannot be read: {error}; --runs takes the folder that holds the runs' folders"),
    };
    let (mut paths, mut lacking): (Vec<PathBuf>, Vec<String>) = (Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if TrainedPolicy::is_in(&path) {
            paths.push(path);
        } else if let Some(name) = without_policy(&path, shown) {
            lacking.push(name);
        }
    }
    paths.sort();
    lacking.sort();
    tell_lacking(folder, &lacking);
    if paths.is_empty() {
        return Err(TrainingError::File {
            file: folder.display().to_string(),
            problem: "holds no run with a policy.bin, or a policy.onnx and its settings.toml; train some first, or leave out --runs".into(),
        }
        .into());
    }
    let mut groups = Groups::new();
    let mut counted: Vec<(String, PathBuf, Arc<TrainedPolicy>)> = Vec::new();
    for path in paths {
        let policy = Arc::new(TrainedPolicy::load(&path)?);
        let settings = policy.settings();
        if !shown(settings.policy.variant) {
            continue;
        }
        // The same but for the seed: the same settings with the seed taken out.
        let mut common = settings.clone();
        common.run.seed = 0;
        let drawn = if settings.environment.mechanisms.is_empty() { "" } else { " drawn around" };
        let order = Variant::ALL.iter().position(|v| *v == settings.policy.variant).unwrap_or(0);
        let label = format!(
            "RL {} (contract {}, {} steps,{drawn} {})",
            settings.policy.variant.name(),
            settings.policy.contract,
            policy.steps(),
            settings.rig.trained_on,
        );
        let key = format!("{}{drawn}{order}{}", settings.policy.contract, common.to_toml()?);
        if let Some((_, other, _)) =
            counted.iter().find(|(group, _, other)| *group == key && is_same_run(other, &policy))
        {
            return Err(
                TrainingError::File { file: path.display().to_string(), problem: twin_of(other, &policy) }.into()
            );
        }
        counted.push((key.clone(), path, Arc::clone(&policy)));
        groups.entry(key).or_insert((label, Vec::new())).1.push(policy);
    }
    let notes = groups
        .values()
        .map(|(label, policies)| {
            let seeds: Vec<String> = policies.iter().map(|p| p.settings().run.seed.to_string()).collect();
            format!("{label}: seeds {}.", seeds.join(", "))
        })
        .collect();
    Ok((groups, notes))
}
