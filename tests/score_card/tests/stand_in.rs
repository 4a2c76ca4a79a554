//! The scorer against a program that stands in for the trainer: a script whose answers are known.

#![allow(clippy::unwrap_used)] // a test that cannot go on should say where
#![cfg(unix)] // the stand-in is a shell script

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use hidden_rig::case::{Making, Plan};
use hidden_rig::effects::{Kind, Place};
use hidden_rig::suite::{Made, make_suite};
use hidden_rig::truth::Class;
use score_card::card::Card;
use score_card::case::CaseScore;
use score_card::judge::{Name, Outcome};

/// Answers `undecided` until it is given the experiment, then names a slow negative valve; to the second case it always
/// says `missing_physics` with a leak. Free runs return the inputs, 1 kPa off for the refit and 5 kPa for the rig as given.
const STAND_IN: &str = r#"#!/bin/sh
what=$1; shift
echo "$what $*" >> "$(dirname "$0")/calls"
all="$*"
rig=; out=; inputs=
while [ $# -gt 0 ]; do
    case $1 in --rig) rig=$2; shift ;; --out) out=$2; shift ;; --inputs) inputs=$2; shift ;; esac
    shift
done
case $what in
identify) echo refit > "$out" ;;
simulate)
    case $rig in *refit*) off=1 ;; dual_pressure) off=5 ;; *) off=0 ;; esac
    awk -F, -v OFS=, -v off=$off 'NR > 1 { $4 += off; $5 += off } { print }' "$inputs" > "$out" ;;
diagnose)
    mkdir -p "$out"; echo rig > "$out/rig.toml"
    lag='{"id": "valve_lag", "where": "negative", "rivals": ["sensor_lag"], "parameters":
        {"time_constant_ms": {"value": 50, "unit": "ms", "low": 1, "high": 1000}}}'
    case $all in
    *case_001*) echo '{"verdict": "missing_physics", "mechanisms": [{"id": "chamber_leak", "where": "positive"}]}' ;;
    *case_002*) echo broken; echo 'stand-in: cannot' >&2; exit 1 ;;
    *experiment_1.csv*) echo "{\"verdict\": \"missing_physics\", \"mechanisms\": [$lag]}" ;;
    *)
        awk 'BEGIN { print "time_s,u_pos,u_neg,pump_on"; for (k = 0; k < 100; k++) printf "%.2f,0.8,0.8,1\n", 0.02 * k }' \
            > "$out/next_experiment.csv"
        echo "{\"verdict\": \"undecided\", \"rivals\": [[\"valve_lag:negative\", \"sensor_lag:negative\"]],
            \"next_experiment\": \"next_experiment.csv\"}" ;;
    esac > "$out/diagnosis.json" ;;
esac
"#;

const TINY: Making = Making { seconds: [6.0, 6.0, 6.0, 6.0], probe_s: 4.0, nuisance_ceiling_kpa: 0.06 };

fn plan(number: usize, class: Class, effects: Vec<(Kind, Place)>) -> Plan {
    let level_kpa = if effects.is_empty() { 0.0 } else { 1.0 };
    Plan { name: format!("case_{number:03}"), class, effects, level_kpa, ripple_beats: false, seed: 5 + number as u64 }
}

/// The suite and the stand-in, made once.
fn suite() -> &'static PathBuf {
    static SUITE: OnceLock<PathBuf> = OnceLock::new();
    SUITE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stand_in");
        let _ = fs::remove_dir_all(&folder);
        let lag = vec![(Kind::ValveLag, Place::Negative)];
        let plans =
            [plan(0, Class::Single, lag.clone()), plan(1, Class::Nothing, Vec::new()), plan(2, Class::Single, lag)];
        make_suite(&plans, &TINY, &folder.join("suite"), 2, &|_, _| {}).unwrap();
        Made { suite: "ci".to_owned(), seed: "5".to_owned() }.write(&folder.join("suite")).unwrap();
        let program = folder.join("trainer");
        fs::write(&program, STAND_IN).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        folder
    })
}

fn score(out: &str, more: &[&str]) -> Output {
    let folder = suite();
    let mut command = Command::new(env!("CARGO_BIN_EXE_score_card"));
    command.arg("--trainer").arg(folder.join("trainer")).arg("--suite").arg(folder.join("suite"));
    command.arg("--out").arg(folder.join(out)).args(more).output().unwrap()
}

#[test]
fn wrong_input_is_told_in_a_line() {
    let folder = suite();
    let absent = Command::new(env!("CARGO_BIN_EXE_score_card"))
        .args(["--trainer", "absent", "--suite"])
        .arg(folder.join("nowhere"))
        .arg("--out")
        .arg(folder.join("none"))
        .output()
        .unwrap();
    assert_eq!(absent.status.code(), Some(2));
    let said = String::from_utf8(absent.stderr).unwrap();
    assert!(said.lines().count() == 1 && said.contains("suite.json"), "{said}");
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_suite_is_scored_case_by_case_and_goes_on_where_it_was_cut_off() {
        let folder = suite();
        let done = score("card", &["--jobs", "2"]);
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let text = fs::read_to_string(folder.join("card/cases.jsonl")).unwrap();
        let mut cases: Vec<CaseScore> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        cases.sort_by(|a, b| a.case.cmp(&b.case));
        let [lag, null, broken] = &cases[..] else { panic!("three cases") };

        assert_eq!((lag.first, lag.last), (Outcome::Undecided, Outcome::Right));
        assert!(lag.right() && lag.experiments.len() == 1 && lag.experiments[0].safe);
        assert_eq!(lag.experiments[0].seconds, 2.0);
        // The refit is 1 kPa off and the answer as near as the noise: nearly all of the gain.
        let share = lag.held_out.share().unwrap();
        assert!((0.97..=1.0).contains(&share), "{share}");
        assert!((lag.held_out.refit_kpa.unwrap()[0] - 1.0).abs() < 0.05);
        assert_eq!(lag.numbers[0].found, 50.0);
        assert!(lag.numbers[0].truth > 1.0);

        assert_eq!((null.first, null.names[0].1), (Outcome::FalseName, Name::False));
        assert!(null.falsely_named() && !null.right());
        assert_eq!(broken.first, Outcome::Failed);
        assert!(broken.trouble.as_deref().unwrap().contains("stand-in: cannot"));

        let card: Card = serde_json::from_slice(&fs::read(folder.join("card/score_card.json")).unwrap()).unwrap();
        assert_eq!((card.cases, card.failed), (3, 1));
        assert_eq!((card.false_names_on_nulls.of_them, card.false_names_on_nulls.all), (1, 1));
        assert_eq!(card.confusion["valve_lag"]["valve_lag"], 1);
        assert_eq!((card.experiment_decides.of_them, card.experiment_decides.all), (1, 1));
        let page = fs::read_to_string(folder.join("card/score_card.md")).unwrap();
        assert!(page.contains("| false names on nulls | 1 of 1 (100 %) |") && page.contains("--suite ci --seed 5"));

        // Once more: nothing is asked again, and a line that was cut off is.
        let calls = || fs::read_to_string(folder.join("trainer").with_file_name("calls")).unwrap().lines().count();
        let before = calls();
        assert!(score("card", &[]).status.success());
        assert_eq!(calls(), before);
        let cut = &text[..text.len() - 20];
        fs::write(folder.join("card/cases.jsonl"), cut).unwrap();
        assert!(score("card", &[]).status.success());
        assert!(calls() > before);
        assert_eq!(fs::read_to_string(folder.join("card/cases.jsonl")).unwrap().lines().count(), 3);

        // The program that is judged hears of no truth but the held-out commands that it is to simulate.
        let calls = fs::read_to_string(folder.join("calls")).unwrap();
        assert!(calls.lines().filter(|call| !call.starts_with("simulate")).all(|call| !call.contains("truth")));
    }
}
