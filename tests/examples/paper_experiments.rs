//! The paper's own experiments, as the paper did them: policies trained on its nominal model, transferred to a rig that conceals its
//! physics, and flown there.
//!
//! `paper_experiments RUNS RIG --out DIR [--programs DIR] [--updates-per-tick N] [--table]`: `RUNS` holds runs of `trainer train
//! --config paper` with their policies, `RIG` is one that [`UnknownRig::of`] names. Figure 5: accuracy of the simulator on a random
//! signal, nominal and after `identify` and `diagnose` on another. Figure 6 and Table I: each policy flies the paper's reference before and after
//! `trainer finetune` has learned from 102,400 ticks of the running rig, beside the fallback. Table II: the same with 0 to 20 kg on
//! the actuator, where the rig is one of ours. What is there is not done again; `DIR/table.md` has it all, `--table` only writes it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use environment::Score;
use environment::closed_loop::{Controller, FlightPlan, PolicyController, fly_plant};
use evaluate::payload::loaded;
use law::{Fallback, FallbackSettings, PolicyLaw};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::emulator::{EmulatedPlant, Sensors, rig_and_crio};
use proto::reference::Reference;
use serde_json::{Value, json};
use tests::dice::Dice;
use tests::unhurried_daemon::UnhurriedDaemon;
use tests::unknown_rig::UnknownRig;
use training::TrainedPolicy;

/// Length of a flight and of a random signal in s.
const SECONDS: f64 = 60.0;
/// Number of sim-to-real transfer steps (paper, Table IV).
const TRANSFER_TICKS: usize = 102_400;
/// Ticks between two policies that the learner publishes: the daemon takes about as long to try one.
const PUBLISH_EVERY: &str = "5120";
/// Least time of a tick: what a learner of this size takes for an update and the daemon for its tick, on a core each.
const LEAST_TICK: Duration = Duration::from_millis(6);
/// Time after which the operator switches exploration on again, which a change of the policy ends.
const AGAIN: Duration = Duration::from_secs(2);
/// Duties between which the random signal lies: the nominal rig then rests at 50 to 137 kPa and -79 to -61 kPa gauge (`simulate`).
const SIGNAL_DUTY: [f64; 2] = [0.65, 1.0];
/// Longest and shortest time that they stand, in ticks.
const STANDS_TICKS: [f64; 2] = [25.0, 150.0];
/// Payloads of Table II in kg.
const PAYLOADS_KG: [f64; 5] = [0.0, 5.0, 10.0, 15.0, 20.0];

/// A signal of random duties, played in open loop from where the first ones settle, as a recording.
fn record_signal(rig: &UnknownRig, seed: u64, file: &Path) {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let mut dice = Dice::new(seed);
    let mut between = |[low, high]: [f64; 2]| low + dice.share() * (high - low);
    let (mut plant, mut duty, mut left) = (rig.plant(), [0.0; 2], 0);
    let scales = environment::sensor_scales(&nominal).unwrap();
    let mut sensors = Sensors::new(scales, Sensors::ADC_NOISE_V_RMS, seed);
    let mut text = String::from("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n");
    let settles = 500;
    for tick in 0..settles + (SECONDS * 50.0) as usize {
        if left == 0 {
            duty = [SIGNAL_DUTY; 2].map(&mut between);
            left = if tick == 0 { settles } else { between(STANDS_TICKS) as usize };
        }
        left -= 1;
        if tick >= settles {
            let volts = sensors.sample(plant.pressures_gauge_kpa(), [&[], &[]]);
            let [pos, neg] = [0, 1].map(|c: usize| scales[c].gauge_kpa(f64::from(volts[c])));
            let time_s = (tick - settles) as f64 / 50.0;
            writeln!(text, "{time_s:.2},{:.6},{:.6},{pos:.4},{neg:.4}", duty[0], duty[1]).unwrap();
        }
        plant.tick(duty, true);
    }
    std::fs::write(file, text).unwrap();
}

/// Figure 5: what `validate` says on the second of two random signals, with the nominal model, with one that `identify` fitted to the
/// first, and with one that `diagnose` found in it.
fn figure_5(rig: &UnknownRig, folder: &Path, programs: &Path) -> Value {
    let trainer = |arguments: &[&str]| {
        let ended = Command::new(programs.join("trainer")).args(arguments).current_dir(folder).output().unwrap();
        assert!(ended.status.code().is_some_and(|code| code <= 1), "{arguments:?}: {ended:?}");
        ended.stdout
    };
    record_signal(rig, 1, &folder.join("fitted.csv"));
    record_signal(rig, 2, &folder.join("validated.csv"));
    let validate = |rig: &str| -> Value {
        serde_json::from_slice(&trainer(&["validate", "--rig", rig, "validated.csv", "--json"])).unwrap()
    };
    let nominal = validate("dual_pressure");
    trainer(&["identify", "--rig", "dual_pressure", "fitted.csv", "--out", "identified.toml"]);
    trainer(&["diagnose", "--rig", "dual_pressure", "fitted.csv", "--out", "found"]);
    let found = if folder.join("found/rig.toml").is_file() { "found/rig.toml" } else { "dual_pressure" };
    json!({ "nominal": nominal, "identified": validate("./identified.toml"), "diagnosed": validate(found) })
}

/// The transfer: a daemon in which the policy of a run controls, exploration on, and `trainer finetune` beside it, which goes
/// on with the run's critics. An error where the daemon does not fly the policy: its reason.
fn transfer(rig: &UnknownRig, run: &Path, folder: &Path, programs: &Path, updates: &str) -> Result<(), String> {
    let run = run.canonicalize().unwrap();
    std::fs::create_dir_all(folder.join("policies")).unwrap();
    let exported = Command::new(programs.join("trainer"))
        .args(["export", "--out", "policies/untouched.onnx"])
        .arg(&run)
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(exported.status.success(), "{exported:?}");
    // A policy that stands behind the fallback flies all the same: the paper knows no fallback.
    // Nor a bound on exploration: what is drawn is the policy's own distribution, cut off at two deviations alone.
    let lines = "policy.active = \"untouched\"\npolicy.follow = \"newest\"\npolicy.when_behind = \"fly\"\n\
                 policy.exploration_max_duty = 0.1\nreference.repeat = true";
    let daemon = UnhurriedDaemon::try_start(rig, 1, LEAST_TICK, folder, programs, lines)?;
    let log = |name: &str| std::fs::File::create(folder.join(name)).unwrap();
    let steps = TRANSFER_TICKS.to_string();
    let mut finetune = daemon
        .command("trainer", &["finetune", "--recordings", "recordings", "--publish", "policies", "--from"])
        .arg(&run)
        .args(["--out", "finetuned", "--steps", &steps, "--updates-per-tick", updates])
        .args(["--publish-every", PUBLISH_EVERY, "--json"])
        .stdout(log("finetune.json"))
        .stderr(log("finetune.log"))
        .spawn()
        .unwrap();
    while finetune.try_wait().unwrap().is_none() {
        let explore = ["explore", "on", "--config", "controller.toml"];
        let _ = daemon.command("controller", &explore).output().unwrap();
        std::thread::sleep(AGAIN);
    }
    Ok(())
}

/// RMSE of the readings in kPa on the paper's reference, and how much the duties move.
fn flown(plant: &mut dyn EmulatedPlant, told: Option<&Rig>, seed: u64, controller: &mut impl Controller) -> Value {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let plan = FlightPlan {
        // The cRIO's sensors are the paper's on all of these rigs.
        rig: &nominal,
        model: told,
        reference: &Reference::paper(),
        seconds: SECONDS,
        noise_v_rms: Sensors::ADC_NOISE_V_RMS,
        seed,
    };
    let score = Score::of(&fly_plant(&plan, plant, controller, &mut || true).unwrap().unwrap().ticks);
    json!({ "rmse_kpa": score.rmse_kpa, "duty_change_rms": score.duty_change_rms })
}

/// The rigs that a policy flies: the one of the table, then with payloads where it is one of ours.
fn plants(rig: &UnknownRig) -> Vec<Box<dyn EmulatedPlant>> {
    let with =
        |kg: f64, own: &Rig| -> Box<dyn EmulatedPlant> { Box::new(rig_and_crio(&loaded(own, kg).unwrap()).unwrap().0) };
    let payloads = match rig {
        UnknownRig::Ours(own) => PAYLOADS_KG.iter().map(|kg| with(*kg, own)).collect(),
        UnknownRig::Hidden(..) => Vec::new(),
    };
    std::iter::once(rig.plant()).chain(payloads).collect()
}

fn policy_flown(rig: &UnknownRig, policy: &TrainedPolicy) -> Vec<Value> {
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let map = Arc::new(SteadyMap::new(&nominal).unwrap());
    let predicts = policy.settings().policy.variant.predicts();
    let fly_in = |mut plant: Box<dyn EmulatedPlant>| {
        let law = PolicyLaw::new(Arc::clone(&map), policy.settings().contract());
        let mut runner = policy.runner();
        let mut controller = PolicyController::new(law, |observation: &[f32]| runner.outputs(observation));
        flown(&mut *plant, predicts.then_some(&nominal), policy.settings().run.seed, &mut controller)
    };
    plants(rig).into_iter().map(fly_in).collect()
}

fn fallback_flown(rig: &UnknownRig) -> Vec<Value> {
    let map = Arc::new(SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap());
    let fly_in = |mut plant: Box<dyn EmulatedPlant>| {
        flown(&mut *plant, None, 1, &mut Fallback::new(Arc::clone(&map), FallbackSettings::default()))
    };
    plants(rig).into_iter().map(fly_in).collect()
}

fn read(path: &Path) -> Option<Value> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

fn keep(path: &Path, value: &Value) {
    std::fs::write(path, format!("{value:#}\n")).unwrap();
}

/// All of one policy that is not there yet.
fn do_policy(rig: &UnknownRig, run: &Path, folder: &Path, programs: &Path, updates: &str) {
    let before = TrainedPolicy::load(run).unwrap();
    let mut refused = None;
    if read(&folder.join("finetuned/summary.json")).is_none() {
        let _ = std::fs::remove_dir_all(folder);
        std::fs::create_dir_all(folder).unwrap();
        refused = transfer(rig, run, folder, programs, updates).err();
    }
    let transferred = match &refused {
        Some(reason) => json!({ "refused": reason }),
        None => json!(policy_flown(rig, &TrainedPolicy::load(&folder.join("finetuned")).unwrap())),
    };
    let settings = before.settings();
    keep(
        &folder.join("flown.json"),
        &json!({
            "variant": settings.policy.variant.name(), "seed": settings.run.seed,
            "untouched": policy_flown(rig, &before), "transferred": transferred,
            "summary": read(&folder.join("finetuned/summary.json")),
        }),
    );
}

/// `DIR/table.md` of all that is there.
fn table(out: &Path) {
    let pair = |value: &Value, digits: usize| match (value[0].as_f64(), value[1].as_f64()) {
        (Some(pos), Some(neg)) => format!("{pos:.digits$}/{neg:.digits$}"),
        _ => "–".to_owned(),
    };
    let figure_5 = read(&out.join("figure-5.json")).unwrap_or_default();
    let accuracy = |model: &str| {
        let overall = &figure_5[model]["overall"];
        let percent = |key: &str| overall[key].as_f64().map(|share| 100.0 * share);
        pair(&json!([percent("pos_accuracy"), percent("neg_accuracy")]), 2)
    };
    let mut text = format!(
        "Accuracy on a random signal, %: nominal {}, identified {}, diagnosed {} (paper: 91.76/90.21)\n\n\
         | policy | RMSE kPa | duty change | with 0, 5, 10, 15, 20 kg |\n| --- | --- | --- | --- |\n",
        accuracy("nominal"),
        accuracy("identified"),
        accuracy("diagnosed"),
    );
    let mut line = |name: &str, flown: &Value| {
        if let Some(reason) = flown["refused"].as_str() {
            writeln!(text, "| {name} | refused by the daemon: {reason} | | |").unwrap();
            return;
        }
        let all = flown.as_array().cloned().unwrap_or_default();
        let loads: Vec<String> = all.iter().skip(1).map(|flown| pair(&flown["rmse_kpa"], 3)).collect();
        let (rmse, change) = (pair(&flown[0]["rmse_kpa"], 3), pair(&flown[0]["duty_change_rms"], 4));
        writeln!(text, "| {name} | {rmse} | {change} | {} |", loads.join(", ")).unwrap();
    };
    line("fallback", &read(&out.join("fallback.json")).unwrap_or_default());
    let mut folders: Vec<PathBuf> = std::fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path()).collect();
    folders.sort();
    for folder in folders {
        let Some(flown) = read(&folder.join("flown.json")) else { continue };
        for what in ["untouched", "transferred"] {
            let (variant, seed) = (flown["variant"].as_str().unwrap_or_default(), &flown["seed"]);
            line(&format!("{variant}, seed {seed}, {what}"), &flown[what]);
        }
    }
    std::fs::write(out.join("table.md"), &text).unwrap();
    println!("{text}");
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let (mut named, mut out, mut programs, mut updates, mut only_table) =
        (Vec::new(), None, None, "1".to_owned(), false);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().unwrap_or_else(|| panic!("{argument} needs a value"));
        match argument.as_str() {
            "--out" => out = Some(PathBuf::from(value())),
            "--programs" => programs = Some(PathBuf::from(value()).canonicalize().unwrap()),
            "--updates-per-tick" => updates = value(),
            "--table" => only_table = true,
            _ => named.push(argument),
        }
    }
    let usage = "paper_experiments RUNS RIG --out DIR [--programs DIR] [--updates-per-tick N] [--table]";
    let ([runs, name], Some(out)) = (named.as_slice(), out) else { panic!("{usage}") };
    std::fs::create_dir_all(&out).unwrap();
    let out = out.canonicalize().unwrap();
    if !only_table {
        let programs = programs.unwrap_or_else(|| tests::program("controller").parent().unwrap().to_owned());
        let rig = UnknownRig::of(name);
        if read(&out.join("figure-5.json")).is_none() {
            keep(&out.join("figure-5.json"), &figure_5(&rig, &out, &programs));
        }
        keep(&out.join("fallback.json"), &json!(fallback_flown(&rig)));
        let mut folders: Vec<PathBuf> = std::fs::read_dir(runs).unwrap().map(|entry| entry.unwrap().path()).collect();
        folders.sort();
        for run in folders.iter().filter(|run| run.join("policy.onnx").is_file()) {
            do_policy(&rig, run, &out.join(run.file_name().unwrap()), &programs, &updates);
        }
    }
    table(&out);
}
