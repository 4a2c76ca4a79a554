//! The loop on rigs that the programs do not know: `trainer adapt` beside a daemon, and other controllers on the same rigs.
//!
//! `loop_table RIG [RIG…] --out DIR [--programs DIR] [--runs N] [--seeds N] [--table]`, with rigs as [`UnknownRig::of`]
//! names them. Each runs behind the emulated cRIO in lockstep, ten times as fast as in real time at most; the daemon begins with the
//! shipped policy on the nominal model. `adapt` runs N times, each with noise of its own (`--runs`); other controllers run in simulation,
//! once for each of N seeds (`--seeds`). What is there is not done again. `DIR/table.md` has a line a run and one of means; `--table` only
//! writes that anew.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use environment::closed_loop::{Controller, FlightPlan, fly_plant};
use environment::{Score, fly};
use evaluate::{Dob, Mpc, OptimalOpenLoop, RepeatedFallback, TickTimes};
use law::{Fallback, FallbackSettings};
use model::rig::Rig;
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use proto::emulator::Sensors;
use proto::reference::Reference;
use serde_json::{Value, json};
use tests::unhurried_daemon::UnhurriedDaemon;
use tests::unknown_rig::UnknownRig;

/// Length of a run in s.
const SECONDS: f64 = 60.0;
/// Runs of a reference that iterative learning has had when it counts.
const REPEATED: usize = 20;
/// Least time of a tick behind the daemon: a tenth of real time, so that what computes beside it gets the processors.
const LEAST_TICK: Duration = Duration::from_millis(2);

/// `trainer adapt` beside a daemon that controls the rig. Where the daemon vents on the way and `adapt` asks for a person, the condition
/// is acknowledged and the rig armed, as the person at it would who finds it sound.
fn adapt(rig: &UnknownRig, seed: u64, folder: &Path, programs: &Path) {
    let daemon = UnhurriedDaemon::start(rig, seed, LEAST_TICK, folder, programs);
    let log = |name: &str| std::fs::File::create(folder.join(name)).unwrap();
    let arguments = ["adapt", "--config", "controller.toml", "--out", "adapt", "--allow-experiment", "--controller"];
    let controller = programs.join("controller").display().to_string();
    let arguments: Vec<&str> = arguments.into_iter().chain([controller.as_str()]).collect();
    let mut adapt = daemon.command("trainer", &arguments);
    let mut adapt = adapt.stdout(log("adapt.log")).stderr(log("adapt.err")).spawn().unwrap();
    let mut asked = 0;
    let status = loop {
        if let Some(status) = adapt.try_wait().unwrap() {
            break status;
        }
        let said =
            [folder.join("adapt.log"), folder.join("adapt.err")].map(|file| std::fs::read_to_string(file).unwrap());
        let asks = said.concat().matches("`controller acknowledge`").count();
        if asks > asked {
            asked = asks;
            println!("acknowledged and armed, as adapt asks: {}", daemon.status()["status"]["latched"]);
            for order in ["acknowledge", "arm"] {
                let mut order = daemon.command("controller", &[order, "--config", "controller.toml"]);
                println!("{:?}", order.status().unwrap().code());
                std::thread::sleep(Duration::from_secs(2));
            }
        }
        std::thread::sleep(Duration::from_millis(500));
    };
    println!("adapt ended with {:?}", status.code());
}

/// One controller, once for each seed: RMSE of the readings in kPa, mean over the seeds.
fn flown<C: Controller>(
    rig: &UnknownRig,
    told: &Rig,
    seeds: u64,
    runs: usize,
    mut controller: impl FnMut() -> C,
) -> [f64; 2] {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let mut sums = [0.0; 2];
    for seed in 1..=seeds {
        let mut controller = controller();
        for run in 1..=runs {
            let plan = FlightPlan {
                // The cRIO's sensors are the paper's on all of these rigs.
                rig: &nominal,
                model: ShownReference::of(told).is_late().then_some(told),
                reference: &Reference::paper(),
                seconds: SECONDS,
                noise_v_rms: Sensors::ADC_NOISE_V_RMS,
                seed: seed + 1000 * (runs - run) as u64,
            };
            let flight = fly_plant(&plan, &mut *rig.plant(), &mut controller, &mut || true).unwrap().unwrap();
            if run == runs {
                let score = Score::of(&flight.ticks).rmse_kpa;
                sums = [sums[0] + score[0], sums[1] + score[1]];
            }
        }
    }
    sums.map(|sum| sum / seeds as f64)
}

/// Errors that other controllers leave on the rig: told the nominal model, and told what `adapt` found.
fn others(rig: &UnknownRig, found: &Rig, seeds: u64) -> Value {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let map = |rig: &Rig| Arc::new(SteadyMap::new(rig).unwrap());
    let fallback = |told: &Rig| {
        let map = map(told);
        flown(rig, told, seeds, 1, || Fallback::new(Arc::clone(&map), FallbackSettings::default()))
    };
    let times = Arc::new(TickTimes::default());
    let mpc = |told: &Rig| {
        let map = map(told);
        flown(rig, told, seeds, 1, || Mpc::new(&map, Arc::clone(&times)))
    };
    let dob = Dob::tuned(&map(&nominal), &nominal, Sensors::ADC_NOISE_V_RMS).unwrap();
    let learned = map(found);
    let repeated = flown(rig, found, 1, REPEATED, || RepeatedFallback::new(&learned, FallbackSettings::default()));
    json!({
        "fallback": fallback(&nominal), "fallback, found": fallback(found),
        "observer": flown(rig, &nominal, seeds, 1, || dob.clone()),
        "mpc": mpc(&nominal), "mpc, found": mpc(found),
        "learning, found": repeated,
        "optimum": optimum(rig),
    })
}

/// Error that any controller must leave, where the rig is known.
fn optimum(rig: &UnknownRig) -> Option<[f64; 2]> {
    let UnknownRig::Ours(own) = rig else { return None };
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let map = Arc::new(SteadyMap::new(&nominal).unwrap());
    let mut solved = OptimalOpenLoop::solve(&map, own, &Reference::paper(), SECONDS).unwrap();
    let plan = FlightPlan {
        rig: own,
        model: None,
        reference: &Reference::paper(),
        seconds: SECONDS,
        noise_v_rms: Sensors::ADC_NOISE_V_RMS,
        seed: 1,
    };
    Some(Score::of(&fly(&plan, &mut solved).unwrap().ticks).rmse_kpa)
}

fn read(path: &Path) -> Option<Value> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

/// Folder of a run of `adapt`: the rig's for the first, one inside it for each other.
fn folder_of(rig: &Path, run: u64) -> PathBuf {
    if run == 1 { rig.to_owned() } else { rig.join(format!("run-{run}")) }
}

/// All of a rig that is not there yet.
fn do_rig(name: &str, out: &Path, programs: &Path, runs: u64, seeds: u64) {
    let folder = out.join(name.replace(':', "-"));
    let rig = UnknownRig::of(name);
    for run in 1..=runs {
        let folder = folder_of(&folder, run);
        std::fs::create_dir_all(&folder).unwrap();
        if read(&folder.join("adapt/adapt.json")).is_none() {
            let began = Instant::now();
            adapt(&rig, run, &folder, programs);
            println!("{name}, run {run}: adapt took {:.0} s", began.elapsed().as_secs_f64());
        }
    }
    let folder = folder.canonicalize().unwrap();
    if read(&folder.join("others.json")).is_none() {
        let journal = read(&folder.join("adapt/journal.json")).unwrap_or_default();
        // As the journal names it, from where `adapt` ran.
        let found = journal["found"].as_str().map(|found| folder.join(found).join("rig.toml"));
        let found = found.and_then(|path| proto::rig_file::load(&path.display().to_string()).ok());
        let mut others = others(&rig, &found.unwrap_or_else(|| Rig::builtin("dual_pressure").unwrap()), seeds);
        others["conceals"] = json!(rig.conceals());
        std::fs::write(folder.join("others.json"), format!("{others:#}\n")).unwrap();
    }
}

/// Two errors in kPa, or two pressures; a dash where there are none.
fn pair(value: &Value) -> String {
    numbers(value).map_or_else(|| "–".to_owned(), |[pos, neg]| format!("{pos:.3}/{neg:.3}"))
}

fn numbers(value: &Value) -> Option<[f64; 2]> {
    Some([value[0].as_f64()?, value[1].as_f64()?])
}

fn one(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"))
}

/// One run of `adapt`, read back.
struct Adapted(Value);

impl Adapted {
    fn flight(&self, what: &str) -> Value {
        let all = self.0["flown"].as_array().cloned().unwrap_or_default();
        all.into_iter().find(|flown| flown["what"] == what).unwrap_or_default()
    }

    fn rmse_kpa(&self, what: &str) -> Value {
        self.flight(what)["tracking"]["rmse_kpa"].clone()
    }

    /// Errors of the run that it kept (kPa).
    fn kept_kpa(&self) -> Option<[f64; 2]> {
        numbers(&self.rmse_kpa(self.0["kept"].as_str()?))
    }

    /// Minutes of the rig until the found model was in force: those at the end of the first flight on it, less that flight.
    fn model_after_minutes(&self) -> Option<f64> {
        let flights = ["with the model", "fallback on the model"].map(|what| self.flight(what));
        let ends = flights.iter().filter_map(|flight| flight["rig_minutes"].as_f64());
        ends.reduce(f64::min).map(|end| end - SECONDS / 60.0)
    }

    /// The worst of the flights on something new, beside the flight before: both channels together, as the promise of no worse window
    /// has it.
    fn worst_flight(&self) -> Option<f64> {
        let both = |value: &Value| numbers(value).map(|[pos, neg]| pos.hypot(neg));
        let before = both(&self.rmse_kpa("before"))?;
        let new = ["with the model", "fallback on the model", "with the policy"];
        new.iter().filter_map(|what| both(&self.rmse_kpa(what))).map(|kpa| kpa / before).reduce(f64::max)
    }
}

/// `DIR/table.md` of all that is there.
fn table(out: &Path) {
    let mut folders: Vec<PathBuf> = std::fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path()).collect();
    folders.sort();
    let mut text = String::from(
        "| rig | fallback | observer | NMPC | shipped policy | NMPC, found | learning, found | adapt: shipped policy | adapt: fallback | adapt: trained | kept | optimum (rig; found) | model after min | min | worst flight | worst kPa |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let (mut before, mut kept, mut failed) = (Vec::new(), Vec::new(), 0);
    for rig in folders.iter().filter(|folder| folder.is_dir()) {
        let others = read(&rig.join("others.json")).unwrap_or_default();
        let runs = (1..).map(|run| folder_of(rig, run)).take_while(|folder| folder.is_dir());
        for folder in runs {
            let adapted = Adapted(read(&folder.join("adapt/adapt.json")).unwrap_or_default());
            let flown = |what: &str| pair(&adapted.rmse_kpa(what));
            writeln!(
                text,
                "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {}; {} | {} | {} | {} | {} |",
                folder.strip_prefix(out).unwrap().display(),
                pair(&others["fallback"]),
                pair(&others["observer"]),
                pair(&others["mpc"]),
                flown("before"),
                pair(&others["mpc, found"]),
                pair(&others["learning, found"]),
                flown("with the model"),
                flown("fallback on the model"),
                flown("with the policy"),
                adapted.0["kept"].as_str().unwrap_or("failed"),
                pair(&others["optimum"]),
                pair(&adapted.0["optimum_kpa"]),
                one(adapted.model_after_minutes()),
                one(adapted.0["rig_minutes"].as_f64()),
                adapted.worst_flight().map_or_else(|| "–".to_owned(), |times| format!("{times:.2}")),
                pair(&adapted.0["extremes_kpa"]),
            )
            .unwrap();
            match (numbers(&adapted.rmse_kpa("before")), adapted.kept_kpa()) {
                (Some(was), Some(is)) => {
                    before.push(was);
                    kept.push(is);
                }
                _ => failed += 1,
            }
        }
    }
    if !kept.is_empty() {
        let (before, after) = (spread(&before), spread(&kept));
        writeln!(text, "\n{} runs, {failed} more without a figure; before: {before}; as kept: {after}", kept.len())
            .unwrap();
    }
    std::fs::write(out.join("table.md"), &text).unwrap();
    println!("{text}");
}

/// Mean and standard deviation over runs.
fn spread(runs: &[[f64; 2]]) -> String {
    let of = |channel: usize| {
        let mean = runs.iter().map(|run| run[channel]).sum::<f64>() / runs.len() as f64;
        let squares = runs.iter().map(|run| (run[channel] - mean).powi(2)).sum::<f64>();
        format!("{mean:.3} ± {:.3}", (squares / (runs.len() as f64 - 1.0).max(1.0)).sqrt())
    };
    format!("{} / {} kPa", of(0), of(1))
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let (mut rigs, mut out, mut programs, mut only_table) = (Vec::new(), None, None, false);
    let (mut runs, mut seeds) = (1, 3);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().unwrap_or_else(|| panic!("{argument} needs a value"));
        match argument.as_str() {
            "--out" => out = Some(PathBuf::from(value())),
            "--programs" => programs = Some(PathBuf::from(value()).canonicalize().unwrap()),
            "--runs" => runs = value().parse().expect("a number of runs"),
            "--seeds" => seeds = value().parse().expect("a number of seeds"),
            "--table" => only_table = true,
            _ => rigs.push(argument),
        }
    }
    let out = out
        .unwrap_or_else(|| panic!("loop_table RIG [RIG…] --out DIR [--programs DIR] [--runs N] [--seeds N] [--table]"));
    std::fs::create_dir_all(&out).unwrap();
    if !only_table {
        let programs = programs.unwrap_or_else(|| tests::program("controller").parent().unwrap().to_owned());
        for rig in &rigs {
            do_rig(rig, &out, &programs, runs, seeds);
        }
    }
    table(&out);
}
