//! Topics that were written into one table, each in rows of its own: a merged bag of messages, a plotting program's export.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};

const HEADER: &str = "__time,u_pos,u_neg,p_pos_kpa,p_neg_kpa";
const SAMPLES: usize = 300;

fn read(rows: &[(f64, String)]) -> Result<Recording, RecordingError> {
    let mut rows = rows.to_vec();
    rows.sort_by(|one, other| one.0.total_cmp(&other.0));
    let lines: String = rows.iter().map(|(time_s, cells)| format!("{time_s:.6},{cells}\n")).collect();
    Recording::parse_for("x.csv", format!("{HEADER}\n{lines}").as_bytes(), &Rig::builtin("dual_pressure").unwrap())
}

fn duty(k: usize) -> f64 {
    0.5 + 0.05 * (k % 7) as f64
}

fn pressure(time_s: f64) -> f64 {
    90.0 + 10.0 * (2.0 * time_s).sin()
}

/// Commands every `command_ms`, readings every 20 ms later by `skew_s`.
fn merged(command_ms: usize, skew_s: f64) -> Vec<(f64, String)> {
    let commands =
        (0..SAMPLES * 20 / command_ms).map(|k| (1e-3 * (k * command_ms) as f64, format!("{:.2},0.8,,", duty(k))));
    let readings = (0..SAMPLES).map(|k| {
        let t = 0.02 * k as f64 + skew_s;
        (t, format!(",,{:.5},{:.5}", pressure(t), 20.0 - pressure(t)))
    });
    commands.chain(readings).collect()
}

#[test]
fn sensors_keep_their_own_rate_whatever_rows_stand_between() {
    for (command_ms, skew_s) in [(20, 0.001), (20, 0.003), (20, 0.01), (20, 0.017), (100, 0.004), (40, 0.019)] {
        let of = read(&merged(command_ms, skew_s)).unwrap_or_else(|error| panic!("{command_ms} {skew_s}: {error}"));
        let notes = of.notes().join("\n");
        assert!(
            notes.contains("rows of their own") && !notes.contains("nothing faster"),
            "{command_ms} {skew_s}: {notes}"
        );
        assert!((of.sampling_s() - 0.02).abs() < 1e-9 && of.measured().is_none(), "{command_ms} {skew_s}: {notes}");
        assert_eq!((of.rows(), of.segments().len()), (SAMPLES, 1), "{command_ms} {skew_s}");
        let [u, p] = of.require(["u_pos", "p_pos_kpa"]).unwrap();
        let each = command_ms / 20;
        for row in 0..SAMPLES - each {
            assert!((p[row] - pressure(0.02 * row as f64 + skew_s)).abs() < 1e-4, "{row}");
            // What acts from a reading to the next: the command in force, and the next one from when it comes.
            let rest = if (row + 1).is_multiple_of(each) { skew_s / 0.02 } else { 0.0 };
            let expected = (1.0 - rest) * duty(row / each) + rest * duty(row / each + 1);
            assert!((u[row] - expected).abs() < 1e-3, "{command_ms} {skew_s}, row {row}: {} {expected}", u[row]);
        }
    }
}

#[test]
fn each_channel_may_have_stamps_of_its_own() {
    let mut rows = Vec::new();
    for k in 0..SAMPLES {
        let t = 0.02 * k as f64;
        rows.push((t, format!("{:.2},,,", duty(k))));
        rows.push((t + 0.001, ",0.8,,".to_owned()));
        rows.push((t + 0.004, format!(",,{:.5},", pressure(t + 0.004))));
        rows.push((t + 0.007, format!(",,,{:.5}", 20.0 - pressure(t + 0.007))));
    }
    let of = read(&rows).unwrap();
    assert!((of.sampling_s() - 0.02).abs() < 1e-9 && of.segments().len() == 1, "{:?}", of.notes());
    let [p, n] = of.require(["p_pos_kpa", "p_neg_kpa"]).unwrap();
    // One sensor's readings are on straight lines at the other's times: h²/8 · p'' with h = 20 ms.
    let off = p.iter().zip(n).map(|(p, n)| (p + n - 20.0).abs()).fold(0.0, f64::max);
    assert!(off < 0.02_f64.powi(2) / 8.0 * 40.0 + 0.07, "{off}");
    // A sensor that is read in another half of the file than the other is none that a run begins with.
    let turns = rows.iter().filter(|(t, cells)| !cells.starts_with(",,,") || *t > 3.0);
    let turns: Vec<_> =
        turns.filter(|(t, cells)| cells.starts_with(",,,") || !cells.starts_with(",,") || *t < 3.0).cloned().collect();
    let said = read(&turns).unwrap_err().to_string();
    assert!(said.contains("in other rows than the other sensors"), "{said}");
}

/// Each topic is written 50 times a second, and its sensor is read less often: at rates that go into it, and at one that does not.
#[test]
fn topics_that_repeat_their_readings_are_read_as_often_as_their_sensors() {
    for (every, told) in [
        ([0.1, 0.1], ["100 ms (each reading stands there 5 times)", "100 ms (each reading stands there 5 times)"]),
        ([0.08, 0.1], ["80 ms (each reading stands there 4 times)", "100 ms (each reading stands there 5 times)"]),
        ([0.02, 0.1], ["", "100 ms (each reading stands there 5 times)"]),
        ([0.05, 0.1], ["50 ms (each reading stands there 2 or 3 times)", "100 ms (each reading stands there 5 times)"]),
    ] {
        let held = |t: f64, every: f64| pressure(((t + 1e-6) / every).floor() * every);
        let mut rows = Vec::new();
        for k in 0..4 * SAMPLES {
            let t = 0.02 * k as f64;
            rows.push((t, format!("{:.2},0.8,,", duty(k))));
            rows.push((t + 0.004, format!(",,{:.5},", held(t, every[0]))));
            rows.push((t + 0.007, format!(",,,{:.5}", 20.0 - held(t, every[1]))));
        }
        let of = read(&rows).unwrap_or_else(|error| panic!("{every:?}: {error}"));
        let notes = of.notes().join("\n");
        for (name, told) in ["p_pos_kpa", "p_neg_kpa"].into_iter().zip(told) {
            assert_eq!(
                notes.contains(&format!("{name} was read every {told}")),
                !told.is_empty(),
                "{every:?}: {notes}"
            );
        }
        assert!((of.sampling_s() - 0.1).abs() < 1e-6, "{every:?}: {} {notes}", of.sampling_s());
        let [p, n] = of.require(["p_pos_kpa", "p_neg_kpa"]).unwrap();
        let is_measured = |row: usize| of.measured().is_some_and(|measured| measured[row]);
        let read = (0..of.rows()).filter(|row| is_measured(*row));
        assert!(read.clone().count().abs_diff(4 * SAMPLES / 5) <= 2, "{every:?}");
        for row in read {
            // The last reading of each sensor is at most a step old, and the lines between are straight: 20 kPa/s at most.
            let age_s = 0.02 + 0.007;
            assert!((n[row] - 20.0 + pressure(of.time_s()[row])).abs() < 20.0 * age_s, "{every:?}, row {row}");
            assert!((p[row] - pressure(of.time_s()[row])).abs() < 20.0 * age_s + 0.05, "{every:?}, row {row}");
        }
    }
}

#[test]
fn rows_of_one_time_are_put_together() {
    let of = read(&merged(20, 0.0)).unwrap();
    assert!(of.notes().join("\n").contains("rows of one time put together"), "{:?}", of.notes());
    assert_eq!((of.rows(), of.measured()), (SAMPLES, None));
    assert!((of.column("u_pos").unwrap()[6] - duty(6)).abs() < 1e-9);
}

/// Whole seconds over fifty samples each: none of them is lost in another one, and the stamps are what is refused.
#[test]
fn samples_of_one_coarse_time_do_not_become_one() {
    let coarse: Vec<(f64, String)> = (0..SAMPLES)
        .flat_map(|k| {
            let (stamp_s, p) = ((k / 50) as f64, pressure(0.02 * k as f64));
            [(stamp_s, format!(",,{p:.5},{:.5}", 20.0 - p)), (stamp_s, format!("{:.2},0.8,,", duty(k)))]
        })
        .collect();
    let said = read(&coarse).unwrap_err().to_string();
    assert!(said.contains("the times are rounded"), "{said}");
}
