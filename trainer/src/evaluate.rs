//! `trainer evaluate`: the paper's tables.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use ::evaluate::comparison::{Comparison, ControllerUnderTest, Knowledge};
use ::evaluate::join::joined;
use ::evaluate::table::Table;
use ::evaluate::{Dob, SKIPPED_S, TickTimes, payload, rigs_around};
use clap::builder::RangedU64ValueParser;
use clap::{Args, Subcommand};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::emulator::load_for_loop;
use proto::output;
use proto::reference::Reference;
use proto::rig_file::RigFileError;
use training::{TrainingError, Variant};

use crate::failure::Failure;
use crate::interruptible::Interruptible;
use crate::progress::Progress;
use crate::run_groups::groups;
use crate::stdout;

/// Fills the paper's tables: runs controllers and policies on rigs and compares their tracking.
///
/// Policies are found in a folder of runs and grouped: runs that differ in nothing but their seed are one row, with
/// the spread over seeds. The last row of a table is the clairvoyant optimum, unless it is left out: what any controller could
/// reach that knows the rig and the whole reference. Writes table.json, table.md and table.html.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer evaluate comparison --runs runs --out tables/comparison
  trainer evaluate ablation --runs runs --rig bench --out tables/ablation
  trainer evaluate loads --runs runs --out tables/loads
  trainer evaluate join tables/comparison/table.json optimum/table.json \\
    --out tables/both")]
pub(crate) struct EvaluateArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Fallback, iterative learning, MPC, disturbance observer, raw policies, full policies, optimum: on each rig and on rigs
    /// randomised around the last
    Comparison(RigsTableArgs),
    /// The four variants: with and without model-predicted observations and smooth actions (Table I)
    Ablation(RigsTableArgs),
    /// Payloads of 0 to 20 kg on the actuator that hangs on both chambers (Table II), for the controllers of a comparison
    Loads(LoadsTableArgs),
    /// Puts tables of the same rigs together, made on other days or machines; nothing is run
    Join(JoinArgs),
}

#[derive(Debug, Args)]
struct JoinArgs {
    /// Tables (table.json), at least two; a controller in several counts in the first, and must track alike in all
    #[arg(required = true, num_args = 2.., value_name = "TABLE")]
    tables: Vec<PathBuf>,
    /// Folder for table.json, table.md and table.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the table as one JSON object
    #[arg(long)]
    json: bool,
}

// The structs below have plain comments: a documented one that is flattened would give its words to the command's help.

// A table whose columns are rigs.
#[derive(Debug, Args)]
struct RigsTableArgs {
    /// Rig to control, name or file; may be given several times (dual_pressure, bench)
    #[arg(long, value_name = "RIG")]
    rig: Vec<String>,
    /// Number of rigs to draw around the last rig; 0 for none
    #[arg(long = "randomised", alias = "drawn", value_name = "N", default_value_t = 20, value_parser = RangedU64ValueParser::<usize>::new().range(0..=1000))]
    drawn: usize,
    /// Seed of the randomised rigs
    #[arg(long = "randomised-seed", alias = "drawn-seed", value_name = "N", default_value_t = 2026)]
    drawn_seed: u64,
    #[command(flatten)]
    table: TableArgs,
}

// A table whose columns are payloads on rigs.
#[derive(Debug, Args)]
struct LoadsTableArgs {
    /// Rig to hang payloads on, name or file; may be given several times (bench)
    #[arg(long, value_name = "RIG")]
    rig: Vec<String>,
    #[command(flatten)]
    table: TableArgs,
}

// What every table takes.
#[derive(Debug, Args)]
struct TableArgs {
    /// Folder of runs, each with its policy.bin, or its policy.onnx and settings.toml; one that has settings alone is named
    #[arg(long, value_name = "DIR")]
    runs: Option<PathBuf>,
    /// Model behind predictions, feed-forward and linearisation
    #[arg(long, value_name = "RIG", default_value = "dual_pressure")]
    model: String,
    /// Reference: CSV time_s,ref_pos_kpa,ref_neg_kpa, or a recording that has these columns (the paper's)
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// Length of a run in s; the first 5 s are not counted
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = length)]
    seconds: f64,
    /// Noise seeds of controllers that are not trained
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Leave out the clairvoyant optimum, which takes twenty-five runs a rig
    #[arg(long = "without-optimum", alias = "without-limit")]
    without_optimum: bool,
    /// Folder for table.json, table.md and table.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the table as one JSON object
    #[arg(long)]
    json: bool,
}

/// Length of a run (s): more than what is not counted, and no more than a run's ticks have room for in memory.
fn length(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    let shortest = SKIPPED_S + 1.0;
    if (shortest..=LONGEST_S).contains(&seconds) {
        Ok(seconds)
    } else {
        Err(format!("give {shortest} to {LONGEST_S} s; the first {SKIPPED_S} s are not counted"))
    }
}

pub(crate) fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    match &args.what {
        What::Comparison(args) => {
            let shown = |variant| matches!(variant, Variant::Raw | Variant::Both);
            fill(&args.table, "Comparison of controllers", &shown, true, PAPER_COMPARISON, columns(args)?)
        }
        What::Ablation(args) => fill(&args.table, "Ablation", &|_| true, false, PAPER_ABLATION, columns(args)?),
        What::Loads(args) => {
            let shown = |variant| variant == Variant::Both;
            fill(&args.table, "Robustness over payloads", &shown, true, PAPER_LOADS, loads(args)?)
        }
        What::Join(args) => join(args),
    }
}

/// Longest run (s): an hour.
const LONGEST_S: f64 = 3600.0;
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

/// The rigs that are asked for, each with the name or the file that it was asked for by.
fn rigs(asked: &[String], otherwise: &[&str]) -> Result<Vec<(String, Rig)>, Failure> {
    let names: Vec<String> =
        if asked.is_empty() { otherwise.iter().map(|&n| n.to_owned()).collect() } else { asked.to_vec() };
    let loaded = |name: String| Ok((name.clone(), load_for_loop(&name, Some("--rig"))?));
    names.into_iter().map(loaded).collect()
}

fn columns(args: &RigsTableArgs) -> Result<Columns, Failure> {
    let rigs = rigs(&args.rig, &["dual_pressure", "bench"])?;
    let last = rigs.last().map(|(_, rig)| rig.clone());
    let mut columns: Columns = rigs.into_iter().map(|(_, rig)| (rig.name.clone(), vec![rig])).collect();
    if let (Some(rig), 1..) = (last, args.drawn) {
        let drawn = rigs_around::rigs_around(&rig, args.drawn, args.drawn_seed).map_err(TrainingError::from)?;
        let rigs = if drawn.len() == 1 { "1 rig".to_owned() } else { format!("{} rigs", drawn.len()) };
        columns.push((format!("{rigs} randomised around {}", rig.name), drawn));
    }
    Ok(columns)
}

fn loads(args: &LoadsTableArgs) -> Result<Columns, Failure> {
    let rigs = rigs(&args.rig, &["bench"])?;
    let mut columns = Columns::new();
    for (file, rig) in &rigs {
        for payload_kg in [0.0, 5.0, 10.0, 15.0, 20.0] {
            let loaded = payload::loaded(rig, payload_kg)
                .map_err(|problem| RigFileError::Rig { file: format!("{file} (--rig)"), problem })?;
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
    let work = begin(&args.out)?;
    let model = load_for_loop(&args.model, Some("--model"))?;
    let reference = match &args.reference {
        Some(path) => Reference::read(path)?,
        None => Reference::paper(),
    };
    // Refused before anything is tuned, which takes a while.
    let (groups, steps) = match &args.runs {
        Some(folder) => groups(folder, shown)?,
        None => (BTreeMap::new(), Vec::new()),
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
    entrants.extend(groups.into_values().map(|(label, policies)| ControllerUnderTest::Policies { label, policies }));
    if !args.without_optimum {
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
            notes.push(format!(
                "{who}: {median:.0} µs a tick in the median, {p999:.0} µs or less in 999 of 1000 ticks."
            ));
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
    deliver(&work, &table, &args.out, Printed::with(args.json))
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
    let work = begin(&args.out)?;
    let later = tables.split_off(1);
    let Some(first) = tables.pop() else { return Ok(()) };
    deliver(&work, &joined(first, later)?, &args.out, Printed::with(args.json))
}

/// Room that a table needs at most, in bytes; ours have some ten kilobytes in three files.
const TABLE_BYTES: u64 = 1 << 20;

/// Listens for Ctrl-C from here on, and refuses a folder that cannot hold the table before anything is worked out.
fn begin(out: &Path) -> Result<Interruptible, Failure> {
    let work = Interruptible::begin()?;
    work.undisturbed(|| output::check_folder(out, TABLE_BYTES))?;
    Ok(work)
}

/// Parts of a table that are printed.
#[derive(Debug, Clone, Copy)]
enum Printed {
    Markdown,
    Json,
}

impl Printed {
    /// Parts that `--json` asks for.
    fn with(json: bool) -> Self {
        if json { Printed::Json } else { Printed::Markdown }
    }
}

/// Writes a table and prints it.
fn deliver(work: &Interruptible, table: &Table, out: &Path, printed: Printed) -> Result<(), Failure> {
    work.write(|| write(out, table))?;
    match printed {
        Printed::Json => stdout::say_json(&serde_json::json!(table)),
        Printed::Markdown => stdout::say(&format!("{}\nwritten to {}", table.to_markdown(), out.display())),
    }
}

fn write(folder: &Path, table: &Table) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(table).map_err(Failure::Json)? + "\n";
    let (markdown, page) = (table.to_markdown(), table.to_html());
    let files = [
        ("table.md", Some(markdown.as_bytes())),
        ("table.html", Some(page.as_bytes())),
        ("table.json", Some(json.as_bytes())),
    ];
    Ok(output::replace(folder, &files)?)
}

/// The command line, without the folder that the program lies in.
fn command() -> String {
    let program = std::iter::once(env!("CARGO_BIN_NAME").to_owned());
    program.chain(std::env::args().skip(1)).collect::<Vec<_>>().join(" ")
}
