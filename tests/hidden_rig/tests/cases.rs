//! Cases and suites: seeds fix them, files carry them, truths run them again.

#![allow(clippy::unwrap_used)] // a test that cannot go on should say where

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use hidden_rig::case::{Case, Making, Plan, make};
use hidden_rig::effects::{Kind, Place};
use hidden_rig::oracle::ask;
use hidden_rig::recording::{parse_commands, pump_on, read_commands};
use hidden_rig::suite::{Suite, make_suite, truth_file};
use hidden_rig::truth::{Class, Truth};

const TINY: Making = Making { seconds: [6.0, 6.0, 6.0, 6.0], probe_s: 4.0, nuisance_ceiling_kpa: 0.06 };

fn plan() -> Plan {
    Plan {
        name: "case_x".to_owned(),
        class: Class::Single,
        effects: vec![(Kind::ValveLag, Place::Negative)],
        level_kpa: 0.3,
        ripple_beats: false,
        seed: 5,
    }
}

/// One case for all tests that only look at it.
fn case() -> &'static Case {
    static CASE: OnceLock<Case> = OnceLock::new();
    CASE.get_or_init(|| make(&plan(), &TINY).unwrap())
}

/// A folder of this test's own, empty.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn a_seed_fixes_a_case_and_its_truth_runs_it_again() {
    let case = case();
    assert_eq!(case, &make(&plan(), &TINY).unwrap());

    // What the file says is enough to run the very same rig again.
    let file = folder("again").join("truth.json");
    case.truth.write(&file).unwrap();
    let truth = Truth::read(&file).unwrap();
    let first = &case.recordings[0];
    let rerun = truth.experiment(&first.commands());
    assert_eq!(truth, case.truth);
    assert_eq!(rerun.clean_kpa(), first.clean_kpa());
    assert_eq!(rerun, truth.experiment(&first.commands()), "an experiment repeats");
}

#[test]
fn the_effect_is_as_large_as_was_asked_for_and_nuisances_are_small() {
    let case = case();
    let [concealed] = &case.truth.truth[..] else { panic!("one effect") };
    let size = concealed.size.raw_kpa[0].max(concealed.size.raw_kpa[1]);
    assert!((size / 0.3 - 1.0).abs() < 0.1, "{size}");
    assert!((3..=6).contains(&case.truth.nuisances.len()));
    for nuisance in &case.truth.nuisances {
        assert!(nuisance.size.raw_kpa[0].max(nuisance.size.raw_kpa[1]) <= 1.3 * 0.15 * 0.3);
    }
    // Noise is what the sheet says, and quantisation; 300 readings know their spread to 4 %.
    let sigma = case.truth.build.noise.sigma_pa();
    for entry in &case.truth.recordings {
        for (noise_kpa, sigma_pa) in entry.noise_kpa.into_iter().zip(sigma) {
            let ratio = 1e3 * noise_kpa / sigma_pa;
            assert!((0.7..1.4).contains(&ratio), "{ratio}");
        }
    }
}

#[test]
fn a_recording_survives_its_file() {
    let case = case();
    let file = folder("csv").join("rec.csv");
    let recording = &case.recordings[2];
    recording.write(&file).unwrap();
    assert_eq!(read_commands(&file).unwrap(), recording.commands());
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.starts_with("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n0.000"));
    for (line, row) in text.lines().skip(1).zip(&recording.rows) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        assert!((cells[0] - row.time_s - row.late_s).abs() < 6e-5);
        assert!((cells[3] - row.read_kpa[0]).abs() < 6e-5 && (cells[4] - row.read_kpa[1]).abs() < 6e-5);
    }
}

#[test]
fn bad_commands_are_told_where_and_what() {
    let parse = |text: &str| parse_commands(Path::new("x.csv"), text.as_bytes());
    let told = |text: &str| parse(text).unwrap_err().to_string();
    assert!(told("time_s,u_pos\n0,0.5\n").contains("column u_neg is missing"));
    assert!(told("time_s,u_pos,u_neg\n").contains("no rows"));
    assert!(told("time_s,u_pos,u_neg\n0,0.5,0.5\n0.02,1.5,0.5\n").contains("line 3, column u_pos"));
    assert!(told("time_s,u_pos,u_neg\n0,0.5,0.5\n0.5,0.5,0.5\n").contains("line 3, column time_s"));
    assert!(told("time_s,u_pos,u_neg,pump_on\n0,0.5,0.5,2\n").contains("pump_on"));
    assert!(told("time_s,u_pos,u_neg\n0,0.5,NaN\n").contains("u_neg"));
    assert!(told("time_s,u_pos,u_neg\n0,0.5\n").contains("x.csv"));
    let commands = parse("u_neg,note,time_s,u_pos,pump_on\n0.4,a,0.00,0.5,1\n0.4,b,0.02,0.6,0\n").unwrap();
    assert_eq!(commands[1].duty, [0.6, 0.4]);
    assert!(commands[0].pump_on && !commands[1].pump_on);
}

#[test]
fn the_full_suite_holds_what_a_proof_needs() {
    let plans = Suite::Full.plans(7);
    let count = |class: Class| plans.iter().filter(|plan| plan.class == class).count();
    assert!(plans.len() >= 120, "{}", plans.len());
    assert!(count(Class::Nothing) + count(Class::ParametersMoved) >= 30);
    assert!(count(Class::Pair) >= 15 && count(Class::Triple) >= 5 && count(Class::Outside) >= 10);
    for kind in Kind::ALL {
        let class = if kind.in_library() { Class::Single } else { Class::Outside };
        let levels: Vec<f64> = plans
            .iter()
            .filter(|plan| plan.class == class && plan.effects[0].0 == *kind)
            .map(|plan| plan.level_kpa)
            .collect();
        assert!(levels.len() >= 2, "{}", kind.name());
    }
    for plan in &plans {
        let mut kinds: Vec<Kind> = plan.effects.iter().map(|(kind, _)| *kind).collect();
        kinds.sort_unstable();
        kinds.dedup();
        assert_eq!(kinds.len(), plan.effects.len(), "no effect twice");
    }
    // A name says nothing, and seeds are each case's own.
    let mut seeds: Vec<u64> = plans.iter().map(|plan| plan.seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), plans.len());
    assert_eq!(plans, Suite::Full.plans(7));
    assert_ne!(plans, Suite::Full.plans(8));
}

/// Recordings and truths lie apart, and nothing in what the diagnosis is given tells what is concealed.
#[test]
fn the_diagnosis_sees_no_truth_and_an_experiment_runs_from_the_command_line() {
    let out = folder("suite");
    make_suite(&[plan()], &TINY, &out, 1, &|_, _| {}).unwrap();
    let mut given: Vec<_> =
        fs::read_dir(out.join("cases/case_x")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    given.sort();
    assert_eq!(given, ["rec_a.csv", "rec_b.csv", "rec_c.csv"]);
    let listed = fs::read_to_string(out.join("cases.json")).unwrap();
    assert!(listed.contains("dual_pressure") && listed.contains("cases/case_x/rec_a.csv"));
    assert!(!listed.contains("valve") && !listed.contains("truth"));
    for aside in ["rec_c.csv", "held_out.csv", "held_out_clean.csv"] {
        assert!(out.join("truth/case_x").join(aside).exists());
    }

    // Both valves shut, pump off: an experiment from a CSV.
    let inputs = out.join("next_experiment.csv");
    let rows = (0..150).map(|k| {
        let (duty, pump) = if k < 50 { ("0.8", 1) } else { ("0", 0) };
        format!("{:.2},{duty},{duty},{pump}\n", 0.02 * f64::from(k))
    });
    fs::write(&inputs, "time_s,u_pos,u_neg,pump_on\n".to_owned() + &rows.collect::<String>()).unwrap();
    let result = out.join("result.csv");
    let run = |inputs: &Path| {
        Command::new(env!("CARGO_BIN_EXE_hidden_rig"))
            .args(["run", "--case-truth"])
            .arg(truth_file(&out, "case_x"))
            .arg("--inputs")
            .arg(inputs)
            .arg("--out")
            .arg(&result)
            .output()
            .unwrap()
    };
    assert!(run(&inputs).status.success());
    let first = fs::read(&result).unwrap();
    assert!(String::from_utf8(first.clone()).unwrap().starts_with("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,pump_on\n"));
    assert!(run(&inputs).status.success());
    assert_eq!(first, fs::read(&result).unwrap(), "the same experiment gives the same bytes");

    let missing = run(&out.join("absent.csv"));
    assert_eq!(missing.status.code(), Some(2));
    assert!(String::from_utf8(missing.stderr).unwrap().contains("absent.csv"));
}

#[test]
fn pump_on_is_written_only_where_it_was_off() {
    let case = case();
    let mut commands = pump_on(&[[0.8, 0.8]; 20]);
    commands[10].pump_on = false;
    let file = folder("pump").join("rec.csv");
    case.truth.experiment(&commands).write(&file).unwrap();
    assert_eq!(read_commands(&file).unwrap(), commands);
}

/// The oracle tells a slow valve from everything else, but not a gain that the valve's own parameters take up.
#[test]
fn the_oracle_separates_what_can_be_separated() {
    let lag = ask(&case().truth, &TINY);
    assert!(lag.separates(), "{lag:?}");
    let [sight] = &lag.effects[..] else { panic!("one effect") };
    assert!(sight.chi2 > sight.separation() && sight.rivals.windows(2).all(|pair| pair[0].chi2 <= pair[1].chi2));
    let plan = Plan { effects: vec![(Kind::SensorGain, Place::Negative)], ..plan() };
    let gain = ask(&make(&plan, &TINY).unwrap().truth, &TINY);
    assert!(!gain.separates(), "{gain:?}");
}
