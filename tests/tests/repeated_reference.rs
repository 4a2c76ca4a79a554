//! A reference that begins again at its end, and teaches: each flight of it is followed better than the one before, the run can be
//! replayed to the bit, and `trainer finetune` sees what the policy saw.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;
use std::time::Duration;

use proto::recording::TickRecord;
use serde_json::Value;
use tests::laboratory::{Closed, Plan};
use tests::{Running, program, root};

/// Length of the reference in ticks.
const PERIOD: usize = 400;
const RUN: u8 = 1;

/// A closed course of 8 s: two sines, as rows of 0.1 s.
fn course() -> String {
    let rows = (0..=80).map(|k| {
        let phase = std::f64::consts::TAU * f64::from(k) / 80.0;
        format!("{:.1},{:.4},{:.4}\n", f64::from(k) / 10.0, 88.0 + 4.0 * phase.sin(), -71.0 - 2.0 * (2.0 * phase).sin())
    });
    String::from("time_s,ref_pos_kpa,ref_neg_kpa\n") + &rows.collect::<String>()
}

/// A number of flights of the course on `bench`, by a daemon with further lines of its configuration.
fn flown(lines: &str, flights: usize) -> Closed {
    let plan = Plan::new(&format!("control.auto_arm = true\nreference.repeat = true\n{lines}"));
    plan.folder.write("reference.csv", course());
    let laboratory = plan.start();
    let last = ((flights + 1) * PERIOD) as u64;
    laboratory.wait_for("that far", |reply| reply["status"]["tick"].as_u64() > Some(last));
    laboratory.close()
}

/// RMSE of each whole flight in kPa, by what was read and asked for.
fn by_flight(ticks: &[TickRecord]) -> Vec<[f64; 2]> {
    let running: Vec<&TickRecord> =
        ticks.iter().skip_while(|t| t.state != RUN).take_while(|t| t.state == RUN).collect();
    let rmse = |flight: &[&TickRecord]| {
        let mut squares = [0.0; 2];
        for t in flight {
            squares[0] += (t.p_pos_kpa - t.ref_pos_kpa).powi(2);
            squares[1] += (t.p_neg_kpa - t.ref_neg_kpa).powi(2);
        }
        squares.map(|sum: f64| (sum / flight.len() as f64).sqrt())
    };
    running.chunks_exact(PERIOD).map(rmse).collect()
}

#[test]
fn flights_teach_the_next_ones_and_the_run_replays() {
    let closed = flown("policy.active = \"fallback\"\nreference.learn = true", 28);
    let ticks = closed.ticks();
    let begins = ticks.iter().position(|t| t.state == RUN).unwrap();
    let [first, again] = [0, PERIOD].map(|k| (ticks[begins + k].ref_pos_kpa, ticks[begins + k].ref_neg_kpa));
    assert_eq!(first, again, "the reference begins again");
    let learned = by_flight(&ticks);
    closed.check_replay();

    let untaught = by_flight(&flown("policy.active = \"fallback\"", 16).ticks());
    println!("taught {learned:.3?}\nuntaught {untaught:.3?}");
    // Means of the last four: noise and the plant's play make single flights differ by a tenth.
    let last = |flights: &[[f64; 2]]| [0, 1].map(|c| flights.iter().rev().take(4).map(|f| f[c]).sum::<f64>() / 4.0);
    let (taught, alone) = (last(&learned), last(&untaught));
    assert!(taught[0] < 0.75 * alone[0] && taught[1] < 0.75 * alone[1], "{taught:?} for {alone:?} kPa");
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// Lessons of a flight are part of what a correcting policy is shown; learning on from recordings rebuilds it.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn finetune_sees_what_a_policy_saw_on_taught_flights() {
        let closed = flown("reference.learn = true", 10);
        let folder = &closed.folder;
        std::fs::create_dir(folder.join("published")).unwrap();
        let mut command = Command::new(program("trainer"));
        command.args(["finetune", "--offline", "--json", "--steps", "3900", "--updates-per-tick", "1", "--hold-plan"]);
        command.arg("--recordings").arg(folder.join("recordings")).arg("--publish").arg(folder.join("published"));
        command
            .arg("--from")
            .arg(root().join("controller/policies/default.onnx"))
            .arg("--out")
            .arg(folder.join("tuned"));
        let ended = Running::start(&mut command).wait(Duration::from_secs(300));
        assert_eq!(ended.status, Some(0), "{ended:?}");
        let summary: Value = serde_json::from_str(&ended.stdout).unwrap();
        let tally = &summary["tally"];
        assert!(tally["compared_observations"].as_u64().unwrap() >= 3800, "{summary}");
        assert_eq!(tally["same_observations"], tally["compared_observations"], "{summary}");
        closed.check_replay();
    }
}
