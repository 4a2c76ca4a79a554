//! The loop on rigs that the programs do not know: `trainer adapt` beside a daemon, and other controllers on the same rigs.
//!
//! `loop_table RIG [RIG…] --out DIR [--programs DIR] [--seeds N] [--table]`, with rigs as [`UnknownRig::of`]
//! names them. Each runs behind the emulated cRIO in lockstep, ten times as fast as in real time at most; the daemon begins with the
//! shipped policy on the nominal model. What is there is not done again. `DIR/table.md` has a line a rig; `--table` only writes that anew.
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
fn adapt(rig: &UnknownRig, folder: &Path, programs: &Path) {
    let daemon = UnhurriedDaemon::start(rig, LEAST_TICK, folder, programs, "");
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

/// What other controllers leave on the rig: told the nominal model, and told what `adapt` found.
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

/// What any controller must leave, where the rig is known.
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

/// All of a rig that is not there yet.
fn do_rig(name: &str, out: &Path, programs: &Path, seeds: u64) {
    let folder = out.join(name.replace(':', "-"));
    std::fs::create_dir_all(&folder).unwrap();
    let folder = folder.canonicalize().unwrap();
    let rig = UnknownRig::of(name);
    if read(&folder.join("adapt/adapt.json")).is_none() {
        let began = Instant::now();
        adapt(&rig, &folder, programs);
        println!("{name}: adapt took {:.0} s", began.elapsed().as_secs_f64());
    }
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

/// `DIR/table.md` of all that is there.
fn table(out: &Path) {
    let mut folders: Vec<PathBuf> = std::fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path()).collect();
    folders.sort();
    let pair = |value: &Value| match (value[0].as_f64(), value[1].as_f64()) {
        (Some(pos), Some(neg)) => format!("{pos:.3}/{neg:.3}"),
        _ => "–".to_owned(),
    };
    let mut text = String::from(
        "| rig | fallback | observer | NMPC | shipped policy | NMPC, found | learning, found | adapt: fallback | adapt: shipped policy | adapt: trained | kept | optimum (rig; found) | min | worst kPa |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for folder in folders.iter().filter(|folder| folder.is_dir()) {
        let adapt = read(&folder.join("adapt/adapt.json")).unwrap_or_default();
        let others = read(&folder.join("others.json")).unwrap_or_default();
        let flown = |what: &str| {
            let all = adapt["flown"].as_array().cloned().unwrap_or_default();
            pair(&all.iter().find(|flown| flown["what"] == what).cloned().unwrap_or_default()["tracking"]["rmse_kpa"])
        };
        let name = folder.file_name().unwrap().to_string_lossy();
        writeln!(
            text,
            "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {}; {} | {} | {} |",
            pair(&others["fallback"]),
            pair(&others["observer"]),
            pair(&others["mpc"]),
            flown("before"),
            pair(&others["mpc, found"]),
            pair(&others["learning, found"]),
            flown("fallback on the model"),
            flown("with the model"),
            flown("with the policy"),
            adapt["kept"].as_str().unwrap_or("failed"),
            pair(&others["optimum"]),
            pair(&adapt["optimum_kpa"]),
            adapt["rig_minutes"].as_f64().map_or_else(|| "–".to_owned(), |minutes| format!("{minutes:.1}")),
            pair(&adapt["extremes_kpa"]),
        )
        .unwrap();
    }
    std::fs::write(out.join("table.md"), &text).unwrap();
    println!("{text}");
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let (mut rigs, mut out, mut programs, mut seeds, mut only_table) = (Vec::new(), None, None, 3, false);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().unwrap_or_else(|| panic!("{argument} needs a value"));
        match argument.as_str() {
            "--out" => out = Some(PathBuf::from(value())),
            "--programs" => programs = Some(PathBuf::from(value()).canonicalize().unwrap()),
            "--seeds" => seeds = value().parse().expect("a number of seeds"),
            "--table" => only_table = true,
            _ => rigs.push(argument),
        }
    }
    let out = out.unwrap_or_else(|| panic!("loop_table RIG [RIG…] --out DIR [--programs DIR] [--seeds N] [--table]"));
    std::fs::create_dir_all(&out).unwrap();
    if !only_table {
        let programs = programs.unwrap_or_else(|| tests::program("controller").parent().unwrap().to_owned());
        for rig in &rigs {
            do_rig(rig, &out, &programs, seeds);
        }
    }
    table(&out);
}
